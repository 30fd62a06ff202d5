//! Counters in RAM for whoever looks from outside
//!
//! The firmware exports one [`Telemetry`] under the symbol `HORUS_TELEMETRY`. A debugger, or the bench,
//! reads it from RAM by that symbol; nothing in the firmware depends on it. All counters wrap.

use core::sync::atomic::{AtomicU32, Ordering};

use profile::MAX_RECEIVERS;

/// One counter, or one high-water mark.
#[derive(Debug, Default)]
#[repr(transparent)]
pub struct Counter(AtomicU32);

impl Counter {
    /// Zero.
    #[must_use]
    pub const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// One more.
    pub fn count(&self) {
        self.add(1);
    }

    /// `n` more; wraps.
    pub fn add(&self, n: u32) {
        self.0.fetch_add(n, Ordering::Relaxed);
    }

    /// Takes the value of a counter kept elsewhere.
    pub fn set(&self, value: u32) {
        self.0.store(value, Ordering::Relaxed);
    }

    /// Raises the mark to `value` if that is higher.
    pub fn worst(&self, value: u32) {
        self.0.fetch_max(value, Ordering::Relaxed);
    }

    /// The value.
    #[must_use]
    pub fn get(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }
}

/// What one receiver's line has carried.
#[derive(Debug, Default)]
#[repr(C)]
pub struct Line {
    /// Bytes the DMA has delivered.
    pub bytes: Counter,
    /// Bytes lost because the ring lapped its reader.
    pub overruns: Counter,
    /// Framing, noise and overrun errors the UART has reported.
    pub uart_errors: Counter,
    /// UBX messages with a valid checksum.
    pub messages: Counter,
    /// UBX messages with a wrong checksum.
    pub damaged: Counter,
    /// UBX messages longer than the parser's buffer, or with a field that their kind does not have.
    pub unusable: Counter,
    /// Bytes that belonged to no message of use: NMEA, UBX of other kinds, noise, damage.
    pub skipped: Counter,
}

impl Line {
    const fn new() -> Self {
        Self {
            bytes: Counter::new(),
            overruns: Counter::new(),
            uart_errors: Counter::new(),
            messages: Counter::new(),
            damaged: Counter::new(),
            unusable: Counter::new(),
            skipped: Counter::new(),
        }
    }
}

/// Everything that is counted. Plain 32-bit words in this order, whatever the number of receivers.
#[derive(Debug, Default)]
#[repr(C)]
pub struct Telemetry {
    /// Ticks since the start.
    pub cycles: Counter,
    /// Ticks at which the cycle before had not ended.
    pub cycle_overruns: Counter,
    /// Frames fired and confirmed by the chip (I_txe).
    pub frames_sent: Counter,
    /// Slots that passed without a frame to fire.
    pub frames_skipped: Counter,
    /// Faults of the radio front end.
    pub rf_faults: Counter,
    /// Times the front end has come back from a fault.
    pub rf_recoveries: Counter,
    /// Resets by the watchdog since power-up.
    pub watchdog_resets: Counter,
    /// Worst time to fill and seal a profile, core cycles (144 MHz).
    pub worst_fill_cycles: Counter,
    /// Best and worst time from a slot's compare match to its command's byte in the SPI's transmit
    /// register, timer ticks (72 MHz): their difference is the jitter.
    pub best_fire_ticks: Counter,
    /// See [`Telemetry::best_fire_ticks`].
    pub worst_fire_ticks: Counter,
    /// GPS1 to GPS5; lines that are not fitted stay zero.
    pub lines: [Line; MAX_RECEIVERS],
}

impl Telemetry {
    /// All zero.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            cycles: Counter::new(),
            cycle_overruns: Counter::new(),
            frames_sent: Counter::new(),
            frames_skipped: Counter::new(),
            rf_faults: Counter::new(),
            rf_recoveries: Counter::new(),
            watchdog_resets: Counter::new(),
            worst_fill_cycles: Counter::new(),
            best_fire_ticks: Counter(AtomicU32::new(u32::MAX)),
            worst_fire_ticks: Counter::new(),
            lines: [const { Line::new() }; MAX_RECEIVERS],
        }
    }

    /// A slot's command left `ticks` after its compare match.
    pub fn fired(&self, ticks: u32) {
        self.best_fire_ticks.0.fetch_min(ticks, Ordering::Relaxed);
        self.worst_fire_ticks.worst(ticks);
    }
}

const _: () = assert!(size_of::<Telemetry>() == 4 * (10 + 7 * MAX_RECEIVERS));
