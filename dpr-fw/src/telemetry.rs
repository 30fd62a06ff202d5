//! The firmware's counters. A debugger or the bench reads them from RAM by their symbol.

use crate::triple::Scrubbed;

firmware_common::counters! {
    /// The static `DPR_TELEMETRY`: 32-bit counters in this order, all zero at start. Totals wrap.
    pub struct Telemetry {
        /// Received frames with the length of one of this profile's frames.
        frames_received,
        /// Frames whose deadline passed.
        frames_missed,
        /// HORUS's objects that were accepted.
        objects_accepted,
        /// HORUS's objects that were rejected.
        objects_rejected,
        /// Frames of a length that no frame of the profile has.
        wrong_length,
        /// Frames for which the front end reported a CRC-16, framing or FIFO error. They are judged like any other.
        chip_crc_flags,
        /// Receive buffers and images that were scrubbed.
        scrubs,
        /// Stuck bits found by scrubs.
        scrub_faults,
        /// Receive buffers and images that were taken out of use because of stuck bits.
        buffers_out_of_use,
        /// Faults of the RFID front end, and frames that began but were not delivered.
        rf_faults,
        /// How often the front end was brought up again after a fault.
        rf_recoveries,
        /// Frames that were lost because no clean receive buffer was left.
        overruns,
        /// SSI transactions in which the image was shown.
        ssi_transactions,
        /// Access violations of all kinds ([`profile::port_status`]), saturating.
        access_violations,
        /// Images that were published.
        publications,
        /// Images that became readable for the next SSI transaction.
        images_readable,
        /// The longest run of the SSI task, processor cycles.
        ssi_worst_cycles,
        /// The longest run of the commit task, processor cycles, including the tasks that preempted it.
        commit_worst_cycles,
        /// The time from the end of the last frame to the publication of its image, µs.
        rxe_to_publish_us,
        /// The longest time from the end of a frame to the publication of its image, µs.
        rxe_to_publish_worst_us,
        /// SSI transactions during which more bytes were clocked out than their window had. They read 0xFF at the end.
        ssi_over_reads,
        /// SSI transactions during which more than a receive area's 80 bytes came in, as in every longer read.
        ssi_overflows,
        /// How often an image expired in hardware because none replaced it in time.
        images_expired,
        /// Why the firmware stopped itself before this start: a code of `firmware_common::last_stop`, or 0.
        last_stop,
        /// Complete passes of the patrol over flash.
        flash_passes,
        /// Passes over flash that found the program changed.
        flash_faults,
        /// Objects of published images that were found changed.
        image_faults,
        /// Complete passes of the patrol over the RAM in use.
        ram_passes,
        /// How often a word of RAM in use did not hold the value that was written to it. The test at the start counts
        /// as well.
        ram_errors,
        /// How often the budget of transactions between two images was used up.
        ssi_budgets_spent,
        /// Transactions whose object was dropped because two earlier ones still waited to be judged.
        ssi_objects_dropped,
        /// Uplinks stored since start or since the counters were cleared.
        uplinks_accepted,
        /// 1 if the last uplink or command that came in was refused, otherwise 0.
        uplink_rejected,
        /// The longest run of the port task, processor cycles, including the tasks that preempted it.
        port_worst_cycles,
        /// How often the front end lost the sender's field.
        field_losses,
        /// How often the front end was brought up again because it had received nothing for long.
        rf_silences,
        /// The last front end register whose value differed from the one that was set, or 0 if none. Bits 23 to 16 hold
        /// its address (plus 0x40 in space B), bits 15 to 8 the value that was set, bits 7 to 0 the value that was
        /// read.
        rf_register,
    }
}

impl Telemetry {
    /// Adds the result of scrubs to the counters.
    pub fn scrubbed(&self, found: Scrubbed) {
        self.scrubs.add(found.buffers);
        self.scrub_faults.add(found.stuck_bits);
        self.buffers_out_of_use.add(found.out_of_use);
    }
}

const _: () = assert!(size_of::<Telemetry>() == 4 * Telemetry::NAMES.len());

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_common::counter::Counter;

    #[test]
    fn the_results_of_scrubs_add_up_each_in_its_counter() {
        let telemetry = Telemetry::new();
        telemetry.scrubbed(Scrubbed { buffers: 2, stuck_bits: 0, out_of_use: 0 });
        telemetry.scrubbed(Scrubbed { buffers: 3, stuck_bits: 7, out_of_use: 1 });
        let counted = [&telemetry.scrubs, &telemetry.scrub_faults, &telemetry.buffers_out_of_use].map(Counter::get);
        assert_eq!(counted, [5, 7, 1]);
    }
}
