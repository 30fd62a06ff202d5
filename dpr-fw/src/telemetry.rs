//! What the firmware counts about itself, for a debugger or the bench to read from RAM by symbol.

use firmware_common::counter::Counter;

macro_rules! telemetry {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// The static `DPR_TELEMETRY` in the image: 32-bit counters in this order, all zero at start. Totals wrap.
        #[derive(Debug, Default)]
        #[repr(C)]
        pub struct Telemetry {
            $($(#[$doc])* pub $name: Counter,)*
        }

        impl Telemetry {
            /// All zero.
            #[must_use]
            pub const fn new() -> Self {
                Self { $($name: Counter::new(),)* }
            }

            /// Names of the counters, in their order in memory.
            pub const NAMES: &'static [&'static str] = &[$(stringify!($name),)*];
        }
    };
}

telemetry! {
    /// Frames of a right length.
    frames_received,
    /// Frames whose deadline passed.
    frames_missed,
    /// Objects accepted.
    objects_accepted,
    /// Objects rejected, each by itself.
    objects_rejected,
    /// Frames rejected outright.
    wrong_length,
    /// Frames for which the front end reported a CRC-16, framing or FIFO error; they are judged like any other.
    chip_crc_flags,
    /// Buffers scrubbed, receive buffers and images.
    scrubs,
    /// Stuck bits found by scrubs.
    scrub_faults,
    /// Faults of the RFID front end, and frames that began but were not delivered.
    rf_faults,
    /// Times the front end was brought up again after a fault.
    rf_recoveries,
    /// Frames lost because commit and scrub were late by a cycle.
    overruns,
    /// SSI transactions in which the image was shown.
    ssi_transactions,
    /// Requests that were refused, and times the transaction budget was used up.
    access_violations,
    /// Images published.
    publications,
    /// Images that became readable for the next SSI transaction.
    images_readable,
    /// Longest SSI interrupt, processor cycles.
    ssi_worst_cycles,
    /// Longest commit, frame or deadline, processor cycles, with what preempted it.
    commit_worst_cycles,
    /// From the end of the last frame to its publication, µs. (The cycle counter stands still while the processor
    /// sleeps.)
    rxe_to_publish_us,
    /// The longest of those, µs.
    rxe_to_publish_worst_us,
    /// SSI transactions that clocked more bytes out than their window had; those read 0xFF.
    ssi_over_reads,
    /// SSI transactions that clocked more bytes in than a request and an uplink object have; those were dropped. A
    /// transaction that reads more than 72 bytes does so always.
    ssi_overflows,
    /// Times an image expired in hardware because none replaced it in time.
    images_expired,
}

impl Telemetry {
    /// Counts `buffers` scrubbed and the stuck bits found in them.
    pub fn scrubbed(&self, buffers: u32, stuck_bits: u32) {
        self.scrubs.add(buffers);
        self.scrub_faults.add(stuck_bits);
    }
}

const _: () = assert!(size_of::<Telemetry>() == 4 * Telemetry::NAMES.len());

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scrubbed_buffers_and_stuck_bits_add_up_each_in_its_counter() {
        let telemetry = Telemetry::new();
        telemetry.scrubbed(2, 0);
        telemetry.scrubbed(3, 7);
        assert_eq!((telemetry.scrubs.get(), telemetry.scrub_faults.get()), (5, 7));
    }
}
