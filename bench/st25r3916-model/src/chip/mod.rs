//! The chip as a whole, and the order in which its events happen.
//!
//! Everything that the chip does without its controller is a deadline in one small table; `advance` carries out the
//! deadlines in order of time. The number of a frame's bytes in the FIFO is calculated when the FIFO is accessed.
//!
//! | covered | DS13541 |
//! |---|---|
//! | power-up, oscillator start and I_osc | Power-on, Operating modes |
//! | effects of field, frames, sending, receiving and FIFO on each other | each module's section |
//!
//! The submodules are `bus` (bytes over SPI), `controller` (clock and bits of a controller), `commands` and `file` (the
//! register file).

mod bus;
mod commands;
mod controller;
mod file;

use std::collections::VecDeque;

use crate::core::{Core, Statistics};
use crate::event::AirEvent;
use crate::field::{self, Field};
use crate::fifo::{CAPACITY, Fifo};
use crate::interrupts::{IrqEdge, Withheld, irq};
use crate::outgoing::Outgoing;
use crate::receiver::Receiver;
use crate::registers::{RX_EN, TX_EN, reg};
use crate::report::{Report, Space};
use crate::schedule::Due;
use crate::spi::Spi;
use crate::transmitter::Transmitter;
use crate::{Config, supply, timers};

pub use controller::{SpiFrame, SpiMode};

/// One ST25R3916 or ST25R3916B in virtual time.
///
/// All times are virtual ns. The chip treats an instant before its present time as its present time.
#[derive(Clone, Debug)]
pub struct Chip {
    core: Core,
    field: Field,
    fifo: Fifo,
    transmitter: Transmitter,
    receiver: Receiver,
    spi: Spi,
    /// Events of the air that have yet to take effect: the instant of the effect, the instant of the event, and the
    /// event.
    inbox: VecDeque<(u64, u64, AirEvent)>,
    /// The register that the measurement under way will set when it ends, and the register's new value.
    measuring: Option<(Space, u8, u8)>,
    transmits: Vec<u64>,
    /// The last bits on MOSI and MISO. In a wrong SPI mode, chip or controller reads these in place of the next ones.
    last_bits: (bool, bool),
}

impl Chip {
    /// Returns a chip that has a supply from time 0 and its registers at their reset values.
    pub fn new(config: Config) -> Self {
        let mut chip = Self {
            core: Core::new(config),
            field: Field::default(),
            fifo: Fifo::new(),
            transmitter: Transmitter::default(),
            receiver: Receiver::new(),
            spi: Spi::default(),
            inbox: VecDeque::new(),
            measuring: None,
            transmits: vec![],
            last_bits: (false, false),
        };
        chip.set_default();
        chip
    }

    /// Returns the chip's configuration.
    pub fn config(&self) -> &Config {
        self.core.config()
    }

    /// Returns the chip's present virtual time, ns.
    pub fn now(&self) -> u64 {
        self.core.now()
    }

    /// Switches the supply on: every register takes its reset value. Foreign carriers and frames remain on the air.
    pub fn power_on(&mut self, now: u64) {
        self.advance(now);
        if !self.core.powered() {
            self.core.set_powered(true);
            self.set_default();
        }
    }

    /// Switches the supply off: the field goes off, a frame breaks off, IRQ and MISO go low, and registers are lost.
    pub fn power_off(&mut self, now: u64) {
        self.advance(now);
        if self.core.powered() {
            self.set_default();
            self.spi.power_off();
            self.core.set_powered(false);
        }
    }

    /// Whether the chip's supply is on.
    pub fn is_powered(&self) -> bool {
        self.core.powered()
    }

    /// Whether the chip's own carrier is on.
    pub fn field_on(&self) -> bool {
        self.field.own()
    }

    /// Whether the chip has a frame on the air.
    pub fn is_transmitting(&self) -> bool {
        self.transmitter.on_air()
    }

    /// Returns the instant of the chip's next internal event, ns, not before [`Chip::now`]; `None` if there is none.
    pub fn next_event(&self) -> Option<u64> {
        self.core.next_due().map(|next| next.max(self.core.now()))
    }

    /// Advances the chip to `now` (virtual ns), and carries out every internal event up to and including that instant.
    pub fn advance(&mut self, now: u64) {
        while let Some(what) = self.core.take_due(now) {
            self.fall_due(what);
        }
        self.core.reach(now);
    }

    /// Whether [`Chip::take_air`] would return an event.
    pub fn has_air(&self) -> bool {
        self.core.has_air()
    }

    /// Returns the events that the chip has put on the air since the last call, in order, with their instants (ns).
    pub fn take_air(&mut self) -> impl Iterator<Item = (u64, AirEvent)> + '_ {
        self.core.take_air()
    }

    /// Passes an event on the air at `at` (virtual ns) to the chip. It takes effect at that instant, or at once if the
    /// instant is past. The instants of a frame's bits stay exact in either case.
    pub fn hear(&mut self, at: u64, event: &AirEvent) {
        let effect = at.max(self.core.now());
        let place = self.inbox.partition_point(|(t, _, _)| *t <= effect);
        self.inbox.insert(place, (effect, at, event.clone()));
        self.plan_hearing();
        self.advance(self.core.now());
    }

    /// Returns the level of the IRQ pin at the chip's present time: high while an unmasked interrupt bit is set.
    pub fn irq(&self) -> bool {
        self.core.irq()
    }

    /// Returns the instant of the IRQ pin's last change, virtual ns, which may lie within the byte that was read last.
    pub fn irq_since(&self) -> u64 {
        self.core.interrupts().since()
    }

    /// Returns the level of the IRQ pin if it has changed since the last call. The first call always returns it.
    pub fn take_irq_change(&mut self) -> Option<bool> {
        self.core.interrupts_mut().take_change()
    }

    /// Returns the changes of the IRQ pin since the last call (at most the last 64) with their exact instants, even
    /// those that calls of [`Chip::irq`] can miss.
    pub fn take_irq_edges(&mut self) -> impl Iterator<Item = IrqEdge> + '_ {
        self.core.interrupts_mut().take_edges()
    }

    /// Whether [`Chip::take_irq_edges`] would return a change.
    #[must_use]
    pub fn has_irq_edges(&self) -> bool {
        self.core.interrupts().has_edges()
    }

    /// Returns the findings so far: uses that the model does not cover or that the data sheet does not allow.
    pub fn reports(&self) -> &[Report] {
        self.core.reports()
    }

    /// Removes and returns the findings. A kind of finding that occurs again later is reported again.
    pub fn take_reports(&mut self) -> Vec<Report> {
        self.core.take_reports()
    }

    /// Prevents these interrupts, and no others, from now on. Pending interrupts stay pending.
    pub fn withhold(&mut self, interrupts: Withheld) {
        self.core.withhold(interrupts.bits());
    }

    /// Returns the counters of the chip's activity.
    pub fn statistics(&self) -> Statistics {
        self.core.statistics()
    }

    fn plan_hearing(&mut self) {
        match self.inbox.front() {
            Some((at, ..)) => self.core.plan(Due::Heard, *at),
            None => self.core.cancel(Due::Heard),
        }
    }

    fn fall_due(&mut self, what: Due) {
        let Self { core, fifo, transmitter, receiver, field, .. } = self;
        match what {
            Due::Osc => {
                core.set_oscillator(true);
                core.raise(irq::OSC);
                self.field_follows();
            }
            Due::FieldOn => {
                core.set_a(reg::OPERATION, core.a(reg::OPERATION) | TX_EN);
                self.field_follows();
                field::start_guard(&mut self.core);
            }
            Due::FieldDetect => field.detect(core),
            Due::Heard => {
                if let Some((_, at, event)) = self.inbox.pop_front() {
                    self.plan_hearing();
                    self.heard(at, event);
                }
            }
            Due::TxStart => transmitter.starts(core, fifo),
            Due::TxMore => transmitter.goes_on(core, fifo),
            Due::TxLevel => transmitter.level(core, fifo),
            Due::TxEnd => {
                transmitter.ends(core, fifo);
                if core.config().transmit_unmasks && !core.target() {
                    receiver.unmask(core.now());
                }
            }
            Due::RxStart => receiver.starts(core, fifo, field, transmitter.busy()),
            Due::RxLevel => receiver.level(core, fifo),
            Due::RxEnd => receiver.ends(core, fifo),
            Due::Apon => core.raise(irq::APON),
            Due::Guard => core.raise(irq::CAT),
            Due::CommandDone => {
                if let Some((space, address, value)) = self.measuring.take() {
                    core.registers_mut().set(space, address, value);
                }
                core.raise(irq::DCT);
            }
            Due::MaskReceive => receiver.mask_timer_ends(core.now()),
            Due::NoResponse => core.raise(irq::NRE),
            Due::GeneralPurpose => core.raise(irq::GPE),
            Due::WakeUp => timers::wake_up(core),
            Due::Answer => {
                let answer = Outgoing::automatic_answer(core);
                self.send(answer);
            }
        }
    }

    fn heard(&mut self, at: u64, event: AirEvent) {
        let Self { core, fifo, receiver, field, .. } = self;
        match event {
            AirEvent::FieldOn => field.outside_is(core, true),
            AirEvent::FieldOff => {
                field.outside_is(core, false);
                receiver.signal_lost(core, fifo, at);
            }
            AirEvent::FrameStart(frame) => receiver.frame_starts(core, fifo, at, frame),
            AirEvent::Bytes(chunk) => receiver.frame_goes_on(core, fifo, &chunk),
            AirEvent::FrameEnd { bits } => receiver.frame_ends(core, fifo, at, bits),
        }
    }

    fn set_default(&mut self) {
        self.break_off();
        self.receiver.set_default(self.core.now());
        self.core.set_default();
        self.fifo.clear();
        self.measuring = None;
        self.field_follows();
        self.field.forget();
        self.core.cancel_all();
        self.plan_hearing();
        self.core.pin_follows();
    }

    fn operation_changed(&mut self) {
        if !self.core.enabled() {
            self.core.set_oscillator(false);
            let dues =
                [Due::Osc, Due::MaskReceive, Due::NoResponse, Due::GeneralPurpose, Due::CommandDone, Due::Answer];
            for due in dues {
                self.core.cancel(due);
            }
            self.measuring = None;
            self.break_off();
            self.let_go();
        } else if !self.core.oscillator() && !self.core.running(Due::Osc) {
            let startup = self.core.config().oscillator_startup_ns;
            self.core.plan_in(Due::Osc, startup);
        }
        if !self.core.operates(RX_EN) {
            self.let_go();
        } else if self.core.oscillator() {
            supply::suits(&mut self.core);
        }
        self.field_follows();
        supply::tuning_suits(&mut self.core, &self.field);
        self.field.look(&mut self.core);
    }

    fn field_follows(&mut self) {
        let on = Field::wanted(&self.core);
        if on == self.field.own() {
            return;
        }
        if !on {
            self.break_off();
            self.let_go();
        }
        self.field.switch(&mut self.core, on);
        if on {
            supply::suits(&mut self.core);
            supply::tuning_suits(&mut self.core, &self.field);
        }
        self.field.look(&mut self.core);
    }

    /// Sends a frame. The chip is half duplex, so it loses a frame that arrives meanwhile.
    fn send(&mut self, mut frame: Outgoing) {
        if self.transmitter.admits(&mut self.core, &self.field, &mut frame) {
            self.let_go();
            let answers = frame.is_answer();
            let start = self.transmitter.send(&mut self.core, &mut self.fifo, frame);
            if answers {
                self.receiver.answers(&mut self.core, start);
            }
        }
    }

    fn break_off(&mut self) {
        self.transmitter.break_off(&mut self.core, &mut self.fifo);
    }

    fn let_go(&mut self) {
        self.receiver.abort(&mut self.core, &mut self.fifo);
    }

    /// Updates the FIFO: removes the bytes that were sent, and adds those that were received.
    fn settle(&mut self) {
        self.transmitter.settle(&self.core, &mut self.fifo);
        self.receiver.settle(&mut self.core, &mut self.fifo);
    }

    fn fifo_level(&self) -> usize {
        let (leaving, arriving) = (self.transmitter.leaving(&self.core), self.receiver.arriving(&self.core));
        (self.fifo.len().saturating_sub(leaving) + arriving).min(CAPACITY)
    }
}
