//! The firmware's counters. A debugger or the bench reads them from RAM by their symbol.

firmware_common::counters! {
    /// The static `HOLD_TELEMETRY` of the program: 32-bit counters in this order, all zero at the start. Totals wrap.
    pub struct Telemetry {
        /// Cycles since the start.
        cycles,
        /// Frames that were sent.
        frames_sent,
        /// Cycles without a frame, because the front end was not prepared in time.
        frames_skipped,
        /// Answers that were received, with or without errors.
        answers,
        /// Frames after which no answer began in time.
        silences,
        /// Answers that began but were not delivered: too late, too long, too short or without an end.
        answers_dropped,
        /// Answers of another length than the DPR's answers have.
        answers_foreign,
        /// Commands that were executed.
        commands_done,
        /// Commands that were refused.
        commands_refused,
        /// Faults of the front end.
        rf_faults,
        /// How often the front end was brought up again after a fault.
        rf_recoveries,
        /// The last front end register whose value differed from the one that was set, or 0 if none. Bits 23 to 16 hold
        /// its address (plus 0x40 in space B), bits 15 to 8 the value that was set, bits 7 to 0 the value that was
        /// read.
        rf_register,
        /// Measurements of temperature and humidity.
        climate_readings,
        /// Failed measurements of temperature and humidity.
        climate_faults,
        /// Samples of the accelerometer.
        vibration_samples,
        /// Failed readings of the accelerometer.
        vibration_faults,
        /// How often the accelerometer's FIFO overran.
        vibration_overruns,
        /// How often the I2C bus was recovered.
        bus_recoveries,
        /// Why the firmware stopped itself before this start: a code of `firmware_common::last_stop`, or 0.
        last_stop,
        /// Complete passes of the patrol over flash.
        flash_passes,
        /// Passes over flash that found the program changed.
        flash_faults,
        /// Complete passes of the patrol over the RAM in use.
        ram_passes,
        /// How often a word of the RAM in use did not hold the value that was written to it. The test at the start
        /// counts as well.
        ram_errors,
        /// The longest time from the start of the task `cycle` to the sealed Hold-Status, processor cycles.
        fill_worst_cycles,
        /// The longest run of the task `sensors`, µs, including the tasks that preempted it.
        sensors_worst_us,
    }
}

const _: () = assert!(size_of::<Telemetry>() == 4 * Telemetry::NAMES.len());
