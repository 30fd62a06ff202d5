//! The counters of the second port, which a debugger or the bench reads from RAM by symbol.

use crate::triple::Scrubbed;

firmware_common::counters! {
    /// The static `DPR_HOLD_TELEMETRY` in the program with the feature `hold`: 32-bit counters in this order, all zero
    /// at start. Totals wrap.
    pub struct HoldTelemetry {
        /// Frames that were received from the hold's front end, accepted or not.
        frames,
        /// Frames that were accepted.
        accepted,
        /// Frames that were rejected.
        rejected,
        /// Answers that were sent.
        answers,
        /// Answers whose first bytes were not loaded in time; they were given up.
        answers_missed,
        /// Answers that were given up because the field went or another frame began.
        answers_overtaken,
        /// Faults of the front end, and frames that began but were not delivered.
        faults,
        /// How often the front end began to listen after a bring-up.
        bring_ups,
        /// Windows in which the budget was used up.
        rests,
        /// Frames that were dropped because no clean buffer was at hand.
        overruns,
        /// Buffers that were scrubbed.
        scrubs,
        /// Stuck bits found by scrubs.
        scrub_faults,
        /// Receive buffers that were taken out of use because of stuck bits.
        buffers_out_of_use,
        /// 1 if the port is out of use because its SPI did not stop, otherwise 0.
        out_of_use,
        /// The most calls of the port's tasks in a window of the budget.
        calls_most,
        /// The most bytes on the port's SPI in a window of the budget.
        bytes_most,
        /// The longest run of a task of the port, processor cycles, including what preempted it.
        worst_cycles,
        /// The longest time from a frame's end until the answer waited for its instant, µs.
        armed_worst_us,
    }
}

impl HoldTelemetry {
    /// Counts the result of scrubs.
    pub fn scrubbed(&self, found: Scrubbed) {
        self.scrubs.add(found.buffers);
        self.scrub_faults.add(found.stuck_bits);
        self.buffers_out_of_use.add(found.out_of_use);
    }
}

const _: () = assert!(size_of::<HoldTelemetry>() == 4 * HoldTelemetry::NAMES.len());
