//! What the firmware counts about itself, for a debugger or the bench to read from RAM by symbol.

use crate::triple::Scrubbed;

firmware_common::counters! {
    /// The static `DPR_TELEMETRY` in the image: 32-bit counters in this order, all zero at start. Totals wrap.
    pub struct Telemetry {
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
        /// Receive buffers and images taken out of use because of stuck bits.
        buffers_out_of_use,
        /// Faults of the RFID front end, and frames that began but were not delivered.
        rf_faults,
        /// Times the front end was brought up again after a fault.
        rf_recoveries,
        /// Frames lost because commit and scrub were late by a cycle.
        overruns,
        /// SSI transactions in which the image was shown.
        ssi_transactions,
        /// What a flight controller did and may not do, of all kinds ([`profile::port_status`]); stays at `u32::MAX`.
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
        /// SSI transactions that clocked more bytes in than fit into a receive area; those were dropped. A transaction
        /// that reads more than 80 bytes does so always.
        ssi_overflows,
        /// Times an image expired in hardware because none replaced it in time.
        images_expired,
        /// Why the firmware stopped itself before this start: a code of `firmware_common::last_stop`, 0 if it did not.
        last_stop,
        /// Passes over flash.
        flash_passes,
        /// Those of them that found it changed.
        flash_faults,
        /// Objects of published images that were found changed.
        image_faults,
        /// Passes over RAM in use.
        ram_passes,
        /// Times at which RAM in use did not hold what was written, at the start too.
        ram_errors,
        /// Times the transactions that are granted between two images were used up.
        ssi_budgets_spent,
        /// Transactions whose object was dropped because two before it still waited to be judged.
        ssi_objects_dropped,
        /// Uplinks stored since start or since they were cleared.
        uplinks_accepted,
        /// 1 if the last uplink or command that came in was refused, else 0.
        uplink_rejected,
        /// Longest run of the port task, processor cycles, with what preempted it.
        port_worst_cycles,
        /// Times the front end lost the sender's field.
        field_losses,
        /// Times the front end was brought up anew since nothing had been heard for long.
        rf_silences,
        /// The last register of the front end that did not read as it was set: its address (with 0x40 in space B) in
        /// bits 23 to 16, then what it was set to, then what it read as; 0 if there was none.
        rf_register,
    }
}

impl Telemetry {
    /// Counts what scrubs did and found.
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
    fn scrubbed_buffers_stuck_bits_and_buffers_out_of_use_add_up_each_in_its_counter() {
        let telemetry = Telemetry::new();
        telemetry.scrubbed(Scrubbed { buffers: 2, stuck_bits: 0, out_of_use: 0 });
        telemetry.scrubbed(Scrubbed { buffers: 3, stuck_bits: 7, out_of_use: 1 });
        let counted = [&telemetry.scrubs, &telemetry.scrub_faults, &telemetry.buffers_out_of_use].map(Counter::get);
        assert_eq!(counted, [5, 7, 1]);
    }
}
