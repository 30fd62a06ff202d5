//! The common base of the chip's modules.

use crate::clock::Clock;
use crate::config::Config;
use crate::event::AirEvent;
use crate::interrupts::Interrupts;
use crate::registers::{EN, Registers, TARGET, reg};
use crate::report::{Kind, Report, Reports, Space};
use crate::rng::SplitMix;
use crate::schedule::{Due, Schedule};

/// Counters of the chip's activity, for a report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Frames that the chip sent to their last bit.
    pub sent: u64,
    /// Frames that the chip received up to the end-of-reception interrupt (I_rxe), with or without errors.
    pub received: u64,
    /// Received frames with a CRC error.
    pub crc_errors: u64,
    /// Frames that broke off during their reception.
    pub broken: u64,
    /// Frames that the receiver did not accept, for example because it was masked, off, or set to another mode or rate.
    pub missed: u64,
    /// Frames that began while the FIFO still held unread bytes of the frame before. Those bytes were lost.
    pub overwritten: u64,
}

#[derive(Clone, Debug)]
pub(crate) struct Core {
    config: Config,
    clock: Clock,
    now: u64,
    powered: bool,
    oscillator: bool,
    registers: Registers,
    interrupts: Interrupts,
    withheld: u32,
    schedule: Schedule,
    /// The random generator for every value that varies on silicon.
    rng: SplitMix,
    reports: Reports,
    outbox: Vec<(u64, AirEvent)>,
    statistics: Statistics,
}

impl Core {
    pub(crate) fn new(config: Config) -> Self {
        Self {
            clock: Clock::new(config.crystal_ppb),
            rng: SplitMix::new(config.seed),
            config,
            now: 0,
            powered: true,
            oscillator: false,
            registers: Registers::new(),
            interrupts: Interrupts::new(),
            withheld: 0,
            schedule: Schedule::new(),
            reports: Reports::default(),
            outbox: Vec::new(),
            statistics: Statistics::default(),
        }
    }

    pub(crate) fn config(&self) -> &Config {
        &self.config
    }

    pub(crate) fn clock(&self) -> Clock {
        self.clock
    }

    pub(crate) fn scatter(&mut self, most: u64) -> u64 {
        self.rng.up_to(most)
    }

    pub(crate) fn now(&self) -> u64 {
        self.now
    }

    pub(crate) fn reach(&mut self, now: u64) {
        self.now = self.now.max(now);
    }

    /// Removes the first deadline if it is due at `now` or before, and advances the chip's time to that deadline.
    pub(crate) fn take_due(&mut self, now: u64) -> Option<Due> {
        let (at, what) = self.schedule.take(now)?;
        self.reach(at);
        Some(what)
    }

    pub(crate) fn next_due(&self) -> Option<u64> {
        self.schedule.next()
    }

    pub(crate) fn plan(&mut self, what: Due, at: u64) {
        self.schedule.plan(what, at);
    }

    pub(crate) fn plan_in(&mut self, what: Due, ns: u64) {
        self.schedule.plan(what, self.now.saturating_add(ns));
    }

    pub(crate) fn cancel(&mut self, what: Due) {
        self.schedule.cancel(what);
    }

    pub(crate) fn running(&self, what: Due) -> bool {
        self.schedule.running(what)
    }

    pub(crate) fn powered(&self) -> bool {
        self.powered
    }

    pub(crate) fn set_powered(&mut self, powered: bool) {
        self.powered = powered;
        self.pin_follows();
    }

    pub(crate) fn oscillator(&self) -> bool {
        self.oscillator
    }

    pub(crate) fn set_oscillator(&mut self, stable: bool) {
        self.oscillator = stable;
    }

    pub(crate) fn set_default(&mut self) {
        self.registers.reset();
        self.registers.set(Space::B, reg::B_DRIVER_TIMING as u8, self.config.driver_timing_display);
        self.interrupts.clear();
        self.oscillator = false;
    }

    pub(crate) fn cancel_all(&mut self) {
        self.schedule = Schedule::new();
    }

    pub(crate) fn registers(&self) -> &Registers {
        &self.registers
    }

    pub(crate) fn registers_mut(&mut self) -> &mut Registers {
        &mut self.registers
    }

    pub(crate) fn a(&self, i: usize) -> u8 {
        self.registers.a(i)
    }

    pub(crate) fn set_a(&mut self, i: usize, value: u8) {
        self.registers.set(Space::A, i as u8, value);
    }

    pub(crate) fn operates(&self, bits: u8) -> bool {
        self.a(reg::OPERATION) & bits == bits
    }

    pub(crate) fn enabled(&self) -> bool {
        self.operates(EN)
    }

    pub(crate) fn target(&self) -> bool {
        self.a(reg::MODE) & TARGET != 0
    }

    /// Returns the operation mode om (register 03, bits 6:3).
    pub(crate) fn operation_mode(&self) -> u8 {
        (self.a(reg::MODE) >> 3) & 0x0F
    }

    /// Whether the bit lm_ext or lm_dri (register B28) connects a load modulator.
    pub(crate) fn load_modulator(&self) -> bool {
        self.registers.b(reg::B_AUX_MOD) & 0x30 != 0
    }

    pub(crate) fn interrupts(&self) -> &Interrupts {
        &self.interrupts
    }

    pub(crate) fn interrupts_mut(&mut self) -> &mut Interrupts {
        &mut self.interrupts
    }

    /// Returns the interrupt bits that are not masked; none without a supply.
    fn unmasked(&self) -> u32 {
        if self.powered { !self.registers.interrupt_mask() } else { 0 }
    }

    pub(crate) fn irq(&self) -> bool {
        self.interrupts.pending() & self.unmasked() != 0
    }

    pub(crate) fn raise(&mut self, bits: u32) {
        let unmasked = self.unmasked();
        self.interrupts.raise(bits & !self.withheld, unmasked, self.now);
    }

    pub(crate) fn interrupts_were_read(&mut self, bits: u32, at: u64) {
        let unmasked = self.unmasked();
        self.interrupts.were_read(bits, unmasked, at);
    }

    pub(crate) fn flip_interrupts(&mut self, bits: u32) {
        let unmasked = self.unmasked();
        self.interrupts.flip(bits, unmasked, self.now);
    }

    /// Prevents these interrupt bits, and no others, from being set from now on. Bits that are already set stay set.
    pub(crate) fn withhold(&mut self, bits: u32) {
        self.withheld = bits;
    }

    pub(crate) fn clear_interrupts(&mut self) {
        self.interrupts.clear();
        self.pin_follows();
    }

    /// Sets the level of the IRQ pin after a change of a mask, of the supply or of the pending interrupt bits.
    pub(crate) fn pin_follows(&mut self) {
        let unmasked = self.unmasked();
        self.interrupts.follows(unmasked, self.now);
    }

    pub(crate) fn note(&mut self, kind: Kind) {
        self.reports.note(self.now, kind);
    }

    pub(crate) fn reports(&self) -> &[Report] {
        self.reports.all()
    }

    pub(crate) fn take_reports(&mut self) -> Vec<Report> {
        self.reports.take()
    }

    pub(crate) fn emit(&mut self, event: AirEvent) {
        self.outbox.push((self.now, event));
    }

    pub(crate) fn has_air(&self) -> bool {
        !self.outbox.is_empty()
    }

    pub(crate) fn take_air(&mut self) -> impl Iterator<Item = (u64, AirEvent)> + '_ {
        self.outbox.drain(..)
    }

    pub(crate) fn statistics(&self) -> Statistics {
        self.statistics
    }

    pub(crate) fn statistics_mut(&mut self) -> &mut Statistics {
        &mut self.statistics
    }
}
