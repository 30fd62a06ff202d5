//! The counters that the firmware keeps of itself, which a debugger or the bench reads from RAM by symbol.

firmware_common::counters! {
    /// The static `HOLD_TELEMETRY` in the program: 32-bit counters in this order, all zero at start. Totals wrap.
    pub struct Telemetry {
        /// Cycles since the start.
        cycles,
        /// Frames that were sent.
        frames_sent,
        /// Cycles whose frame was not sent, since the front end was not prepared for it.
        frames_skipped,
        /// Answers that came, with or without errors.
        answers,
        /// Frames after which no answer began in time.
        silences,
        /// Answers that began and were not delivered: too late, too long, too short or without an end.
        answers_dropped,
        /// Answers that had another length than those of the DPR.
        answers_foreign,
        /// Commands that were carried out.
        commands_done,
        /// Commands that the hold's limits forbade.
        commands_refused,
        /// Faults of the front end.
        rf_faults,
        /// How often the front end was brought up again after a fault.
        rf_recoveries,
        /// The last register of the front end that did not read as it was set, or 0 if none: its address (with 0x40 in
        /// space B) in bits 23 to 16, then the value that was set, then the value that was read.
        rf_register,
        /// Measurements of temperature and humidity.
        climate_readings,
        /// Failed measurements of temperature and humidity.
        climate_faults,
        /// Samples of the accelerometer.
        vibration_samples,
        /// Failed readings of the accelerometer.
        vibration_faults,
        /// How often the accelerometer had more samples than its FIFO holds.
        vibration_overruns,
        /// How often the I2C bus was recovered.
        bus_recoveries,
        /// Why the firmware stopped itself before this start: a code of `firmware_common::last_stop`, 0 if it did not.
        last_stop,
        /// Passes of the patrol over flash.
        flash_passes,
        /// Passes over flash that found it changed.
        flash_faults,
        /// Passes of the patrol over the RAM in use.
        ram_passes,
        /// How often a word of the RAM in use did not hold what was written to it, also at the start.
        ram_errors,
        /// The longest time from the tick's task to the sealed object, processor cycles.
        fill_worst_cycles,
        /// The longest run of the sensors' task, µs, including what preempted it.
        sensors_worst_us,
    }
}

const _: () = assert!(size_of::<Telemetry>() == 4 * Telemetry::NAMES.len());
