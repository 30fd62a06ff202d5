//! Counters in RAM that a debugger or the bench reads
//!
//! The firmware exports one [`Telemetry`] under the symbol `HORUS_TELEMETRY`, by which a debugger or the bench reads
//! it. All counters wrap. New counters are added at the end.

use firmware_common::counter::Counter;
use profile::MAX_RECEIVERS;

firmware_common::counters! {
    /// The counts of one receiver's line.
    pub struct Line {
        /// Bytes that DMA has delivered.
        bytes,
        /// Bytes lost because the ring's writer overwrote them before they were read.
        overruns,
        /// Framing, noise and overrun errors that the UART has reported.
        uart_errors,
        /// UBX messages with a valid checksum.
        messages,
        /// UBX messages with a wrong checksum.
        damaged,
        /// UBX messages that are longer than the parser's buffer, or have a field that their kind does not have.
        unusable,
        /// Bytes that belonged to no useful message: NMEA, UBX of other kinds, noise, damage.
        skipped,
    }
}

firmware_common::counters! {
    /// The counts of the source of one receiver's bytes, and the receiver's response to its configuration.
    pub struct Source {
        /// The receiver's [`Standing`](crate::configuration::Standing) as a number. It is not a count.
        configuration,
        /// Recoveries of an I2C bus, or how often an SPI was set up anew.
        recoveries,
        /// Transactions that had not ended by the next tick.
        timed_out,
        /// Transactions that a receiver on I2C did not acknowledge, or that lost the arbitration.
        refused,
    }
}

/// All counters of the firmware: 32-bit words in this order, whatever the number of receivers.
#[derive(Debug, Default)]
#[repr(C)]
pub struct Telemetry {
    /// Ticks since the start.
    pub cycles: Counter,
    /// Ticks at which the cycle before had not ended.
    pub cycle_overruns: Counter,
    /// Frames that were fired and whose end the chip reported.
    pub frames_sent: Counter,
    /// Slots that passed without a frame to fire.
    pub frames_skipped: Counter,
    /// Faults of the front end.
    pub rf_faults: Counter,
    /// How often the front end has recovered from a fault.
    pub rf_recoveries: Counter,
    /// Resets by the watchdog since power-up.
    pub watchdog_resets: Counter,
    /// The longest time to fill and seal a profile, core cycles (144 MHz).
    pub worst_fill_cycles: Counter,
    /// The shortest time from a slot's compare match to the command's byte in the SPI's transmit register, timer ticks
    /// (72 MHz). The longest such time minus the shortest is the jitter.
    pub best_fire_ticks: Counter,
    /// The longest time from a slot's compare match to the command's byte in the SPI's transmit register, timer ticks.
    pub worst_fire_ticks: Counter,
    /// The lines of GPS1 to GPS5; the counts of receivers that are not fitted stay zero.
    pub lines: [Line; MAX_RECEIVERS],
    /// Why the processor last started: a [`profile::ResetReason`] as a number.
    pub reset_reason: Counter,
    /// 1 if HORUS runs on its internal oscillator because the external clock is missing, otherwise 0.
    pub without_crystal: Counter,
    /// Why the firmware stopped itself before this start: a code of `firmware_common::last_stop`; 0 if it did not.
    pub last_stop: Counter,
    /// Passes of the memory checks over flash.
    pub flash_passes: Counter,
    /// Passes of the memory checks over the RAM in use.
    pub ram_passes: Counter,
    /// How often a word of the RAM in use did not hold the value that was written to it.
    pub ram_errors: Counter,
    /// Frames during which the front end's FIFO ran dry or overflowed.
    pub fifo_errors: Counter,
    /// The sources of GPS1 to GPS5; the counts of receivers that are not fitted stay zero.
    pub sources: [Source; MAX_RECEIVERS],
    /// Frames whose end (I_txe) the chip did not report. They count as sent, since their time was over and the FIFO was
    /// empty.
    pub frames_unconfirmed: Counter,
    /// The last register of the front end that read back another value than the one set; 0 if none did. Bits 23 to 16
    /// are its address (with 0x40 in space B), bits 15 to 8 the value that was set, bits 7 to 0 the value that was
    /// read.
    pub rf_register: Counter,
}

impl Telemetry {
    /// Returns the counters of a start, which are all zero.
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
            best_fire_ticks: Counter::starting_at(u32::MAX),
            worst_fire_ticks: Counter::new(),
            lines: [const { Line::new() }; MAX_RECEIVERS],
            reset_reason: Counter::new(),
            without_crystal: Counter::new(),
            last_stop: Counter::new(),
            flash_passes: Counter::new(),
            ram_passes: Counter::new(),
            ram_errors: Counter::new(),
            fifo_errors: Counter::new(),
            sources: [const { Source::new() }; MAX_RECEIVERS],
            frames_unconfirmed: Counter::new(),
            rf_register: Counter::new(),
        }
    }

    /// Records that a slot's command left `ticks` (of 72 MHz) after its compare match.
    pub fn record_fire(&self, ticks: u32) {
        self.best_fire_ticks.record_min(ticks);
        self.worst_fire_ticks.record_max(ticks);
    }
}

const _: () = assert!(size_of::<Telemetry>() == 4 * (10 + 7 * MAX_RECEIVERS + 7 + 4 * MAX_RECEIVERS + 2));
// The bench and debuggers read the counters at fixed offsets.
const _: () = assert!(core::mem::offset_of!(Telemetry, lines) == 40);
