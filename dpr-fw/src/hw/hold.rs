//! Drives the hold's front end with SPIM2, EGU3 and TIMER4.
//!
//! The edge of the front end's IRQ raises no GPIOTE interrupt. It triggers EGU3 through PPI, and the interrupt of EGU3
//! calls the task `hold_irq`. So this front end calls no task of HORUS's port, and while the interrupt of EGU3 is
//! masked, its IRQ calls no task at all.
//!
//! An answer starts at a fixed instant without a task. The transmit command is set up in SPIM2 with the chip selected;
//! a compare of TIMER4 then starts the transfer through PPI. The end of the transfer raises chip select, also through
//! PPI, and the chip executes the command. The PPI channels are always enabled, because tasks have no access to the
//! PPI. So the compare register holds an instant in the past, except while an answer is armed ([`AnswerPort::park`]).
//!
//! `tests/interleavings/hold.rs` makes the same register accesses on a model and explores every order of events. A
//! change of this file needs the same change there.

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

pub(crate) struct Hold;

pub(crate) type HoldPort = Port<Hold>;
pub(crate) type HoldResponder = Responder<HoldPort>;
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

/// Sets the compare that starts an answer to an instant that has just passed. The counter reaches it again after 71
/// minutes.
fn park() {
    // SAFETY: the pointer to the peripheral is valid for ever. Only the hold's tasks use this register, and they do not
    // interrupt each other.
    let timer = unsafe { &*pac::TIMER4::ptr() };
    // SAFETY: the compare register takes any value.
    timer.cc[HOLD_ANSWER_COMPARE].write(|w| unsafe { w.bits(Hold::now_us().wrapping_sub(1)) });
}

/// Stops the timer that starts answers, for the safe state.
pub(super) fn stop() {
    // SAFETY: the pointer to the peripheral is valid for ever, and nothing of the port runs any more.
    let timer = unsafe { &*pac::TIMER4::ptr() };
    // SAFETY: 1 is a valid value of a task register.
    timer.tasks_stop.write(|w| unsafe { w.bits(1) });
}

/// Chip select of the hold's front end, which GPIOTE drives. At the end of a transfer PPI also raises it.
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

pub(crate) struct Answers {
    memory: &'static mut AnswerMemory,
    /// The value of TIMER4 at which the armed transfer starts; `None` if none is armed.
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
        // The load command replaces the byte before the data: a byte that was already loaded, or the first byte of the
        // memory.
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
        // Not covered: only this line, an instant for the answer that has passed: `arm` refuses such an instant.
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
        // Not covered: a counter that has passed the compare value meanwhile: a task of a higher priority would have to
        // begin within these few instructions.
        if is_passed(0) && self.timer.events_compare[HOLD_ANSWER_COMPARE].read().bits() == 0 {
            // The task was preempted until the counter had passed the compare value, so the timer will not start the
            // transfer in time.
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

pub(crate) struct HoldEdge(pac::EGU3);

impl HoldEdge {
    pub(super) fn new(egu: pac::EGU3) -> Self {
        egu.intenset.write(|w| w.triggered0().set());
        Self(egu)
    }

    /// Clears the interrupt of the IRQ's edge. No edge is lost, because the driver reads the level of the pin.
    pub(crate) fn clear(&mut self) {
        take_event!(self.0.events_triggered[0]);
    }
}

const _: () = assert!(WAIT_COMPARE != HOLD_ANSWER_COMPARE && NOW_CAPTURE != HOLD_ANSWER_COMPARE);
