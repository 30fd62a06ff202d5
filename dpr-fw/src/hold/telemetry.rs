//! The counters of the second port. A debugger or the bench reads them from RAM by their symbol.

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
        /// Answers that were dropped because their first bytes were not loaded in time.
        answers_missed,
        /// Answers that were dropped because the hold's field ended or another frame began.
        answers_overtaken,
        /// Faults of the front end, and frames that began but could not be read.
        faults,
        /// How often the front end began to listen after a bring-up.
        bring_ups,
        /// Windows of the [`Budget`](super::Budget) in which the budget was used up.
        rests,
        /// Frames that were dropped because no cleared buffer was left.
        overruns,
        /// Buffers that were scrubbed, that is cleared and tested for stuck bits.
        scrubs,
        /// Stuck bits found by scrubs.
        scrub_faults,
        /// Receive buffers that were taken out of use because of stuck bits.
        buffers_out_of_use,
        /// 1 if the second port is out of use because its SPI did not stop, otherwise 0.
        out_of_use,
        /// The most calls of the port's tasks in a window of the budget.
        calls_most,
        /// The most bytes on the port's SPI in a window of the budget.
        bytes_most,
        /// The longest run of a task of the second port, processor cycles, including the tasks that preempted it.
        worst_cycles,
        /// The longest time from the end of a frame until the answer was armed, µs.
        armed_worst_us,
    }
}

impl HoldTelemetry {
    /// Counts what scrubs have found.
    pub fn scrubbed(&self, found: Scrubbed) {
        self.scrubs.add(found.buffers);
        self.scrub_faults.add(found.stuck_bits);
        self.buffers_out_of_use.add(found.out_of_use);
    }
}

const _: () = assert!(size_of::<HoldTelemetry>() == 4 * HoldTelemetry::NAMES.len());
