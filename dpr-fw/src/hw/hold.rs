//! The second port's registers: SPIM2, EGU3 and TIMER4, by which the hold's front end is reached.
//!
//! The IRQ's edge calls the task `hold_irq` by GPIOTE without an interrupt, PPI and EGU3. So the front end cannot call
//! a task of HORUS's, and once EGU3's interrupt is masked it calls none.
//!
//! An answer starts at a fixed instant: the transmit command is set up in SPIM2 with the chip selected, and a compare
//! of TIMER4 starts the transfer through PPI. The chip carries out a command when chip select rises; the transfer's end
//! lets it rise, also through PPI. So no task comes between. The tasks cannot reach the PPI, whose channels are always
//! enabled; so the compare register holds a past instant except while an answer is armed ([`AnswerPort::park`]).
//!
//! `tests/interleavings/hold.rs` makes the same register accesses in the same order on a model, and every order of
//! events is explored there. Whoever changes this file has to change that file, too.

use core::convert::Infallible;

use dpr_fw::{
    hold::{AnswerMemory, AnswerPort, Responder, Shared},
    rf::LEAD,
    task::Task,
};
use embedded_hal::digital::{ErrorType, OutputPin};
use nrf52840_hal::pac;
use profile::hold::Answer;
use st25r3916::{command, Answerer};

use super::{
    rf::{Port, Sends, Wiring},
    take_event,
    time::SHORTEST_US,
};
use crate::board::{HOLD_ANSWER_COMPARE, HOLD_SELECT_CHANNEL, NOW_CAPTURE, WAIT_COMPARE};

/// The hold's front end.
pub(crate) struct Hold;

/// The port of the hold's front end.
pub(crate) type HoldPort = Port<Hold>;
/// The state of the tasks of the second port.
pub(crate) type HoldResponder = Responder<HoldPort>;
/// The state that they share with the task `port`.
pub(crate) type HoldShared = Shared;

impl Wiring for Hold {
    type Spim = pac::SPIM2;
    type Timer = pac::TIMER4;
    type Select = HoldSelect;
    type Sends = Answers;
    const TIMER_TASK: Task = Task::hold_timer;

    fn now_us() -> u32 {
        // SAFETY: the pointer to the peripheral is valid for ever; only the hold's tasks, which do not interrupt each
        // other, call this.
        let timer = unsafe { &*pac::TIMER4::ptr() };
        // SAFETY: 1 is a valid value of a task register.
        timer.tasks_capture[NOW_CAPTURE].write(|w| unsafe { w.bits(1) });
        timer.cc[NOW_CAPTURE].read().bits()
    }
}

/// Sets the compare that starts an answer to an instant that has just passed. The counter comes back to it after 71
/// minutes.
fn park() {
    // SAFETY: the pointer to the peripheral is valid for ever; only the hold's tasks, which do not interrupt each other,
    // use this register.
    let timer = unsafe { &*pac::TIMER4::ptr() };
    // SAFETY: the compare register takes any value.
    timer.cc[HOLD_ANSWER_COMPARE].write(|w| unsafe { w.bits(Hold::now_us().wrapping_sub(1)) });
}

/// Chip select of the hold's front end, which GPIOTE drives. It also rises by itself at the end of a transfer.
pub(crate) struct HoldSelect;

impl ErrorType for HoldSelect {
    type Error = Infallible;
}

impl OutputPin for HoldSelect {
    fn set_low(&mut self) -> Result<(), Infallible> {
        // SAFETY: the pointer to the peripheral is valid for ever, and the task register acts only on this channel.
        let gpiote = unsafe { &*pac::GPIOTE::ptr() };
        // SAFETY: 1 is a valid value of a task register.
        gpiote.tasks_clr[HOLD_SELECT_CHANNEL].write(|w| unsafe { w.bits(1) });
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        // SAFETY: the pointer to the peripheral is valid for ever, and the task register acts only on this channel.
        let gpiote = unsafe { &*pac::GPIOTE::ptr() };
        // SAFETY: 1 is a valid value of a task register.
        gpiote.tasks_set[HOLD_SELECT_CHANNEL].write(|w| unsafe { w.bits(1) });
        Ok(())
    }
}

/// The answer that is sent, and the instant of its start.
pub(crate) struct Answers {
    memory: &'static mut AnswerMemory,
    /// The counter of TIMER4 at which the transfer that is set up starts.
    armed: Option<u32>,
    carried: u32,
    broken: bool,
}

impl Answers {
    pub(super) fn new(memory: &'static mut AnswerMemory) -> Self {
        Self { memory, armed: None, carried: 0, broken: false }
    }
}

impl Sends for Answers {
    fn load(&mut self, offset: usize, len: usize) -> Option<&[u8]> {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(self.memory.as_mut_slice());
        // The command overwrites a byte that was loaded before, or that stands before the answer.
        let place = bytes.get_mut(LEAD + offset..LEAD + offset + 1 + len)?;
        place[0] = command::FIFO_LOAD;
        Some(place)
    }

    fn is_armed(&self) -> bool {
        self.armed.is_some()
    }

    fn carries(&mut self, bytes: usize) {
        self.carried += bytes as u32;
    }

    fn disarm(&mut self) {
        if self.armed.take().is_some() {
            park();
        }
    }

    fn limit_us(&self, us: u32, now_us: u32) -> u32 {
        us + self.armed.map_or(0, |at_us| at_us.wrapping_sub(now_us).cast_signed().max(0).cast_unsigned())
    }

    fn does_not_stop(&mut self) {
        self.broken = true;
    }
}

impl AnswerPort for HoldPort {
    fn now_us(&mut self) -> u32 {
        Hold::now_us()
    }

    fn put(&mut self, answer: &Answer) {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(self.sends.memory.as_mut_slice());
        bytes[LEAD + 1..].copy_from_slice(answer.as_bytes());
    }

    fn arm(&mut self, at_us: u32) -> bool {
        let is_passed = |before_us: u32| at_us.wrapping_sub(Hold::now_us()).cast_signed() <= before_us.cast_signed();
        if is_passed(SHORTEST_US) {
            return false;
        }
        self.set_up_short(&Answerer::transmit());
        self.timer.events_compare[HOLD_ANSWER_COMPARE].reset();
        // SAFETY: the compare register takes any value.
        self.timer.cc[HOLD_ANSWER_COMPARE].write(|w| unsafe { w.bits(at_us) });
        if is_passed(0) && self.timer.events_compare[HOLD_ANSWER_COMPARE].read().bits() == 0 {
            // Another task was longer than was left, and the counter has passed the value before it was set.
            park();
            self.finish();
            return false;
        }
        self.sends.armed = Some(at_us);
        true
    }

    fn park(&mut self) {
        if !self.sends.is_armed() {
            park();
        }
    }

    fn rest(&mut self) {
        self.spim.intenclr.write(|w| w.end().clear());
        self.timer.intenclr.write(|w| w.compare0().clear());
        // SAFETY: the pointer to the peripheral is valid for ever, and only the hold's tasks use it.
        let egu = unsafe { &*pac::EGU3::ptr() };
        egu.intenclr.write(|w| w.triggered0().clear());
    }

    fn wake(&mut self) {
        self.spim.intenset.write(|w| w.end().set());
        self.timer.intenset.write(|w| w.compare0().set());
        // SAFETY: the pointer to the peripheral is valid for ever, and only the hold's tasks use it.
        let egu = unsafe { &*pac::EGU3::ptr() };
        egu.intenset.write(|w| w.triggered0().set());
    }

    fn take_carried(&mut self) -> u32 {
        core::mem::take(&mut self.sends.carried)
    }

    fn is_broken(&self) -> bool {
        self.sends.broken
    }
}

/// The interrupt of the IRQ pin of the hold's front end.
pub(crate) struct HoldEdge(pac::EGU3);

impl HoldEdge {
    pub(super) fn new(egu: pac::EGU3) -> Self {
        egu.intenset.write(|w| w.triggered0().set());
        Self(egu)
    }

    /// Clears the interrupt. The driver's state machine then reads the pin's level, not the edge.
    pub(crate) fn clear(&mut self) {
        take_event!(self.0.events_triggered[0]);
    }
}

const _: () = assert!(WAIT_COMPARE != HOLD_ANSWER_COMPARE && NOW_CAPTURE != HOLD_ANSWER_COMPARE);
