//! The limits that the judge holds every run against: the design's numbers, in ns unless stated otherwise.

/// The largest spread, peak to peak, of the time from a HORUS tick to its transmit command, which takes effect when
/// chip select rises: docs/design.md#timing.
pub const TICK_TO_COMMAND_JITTER: u64 = 100;
/// The largest spread, peak to peak, of the time from a HORUS tick to its transmit command on the pessimistic clock,
/// where an interrupt may come during the longest instruction: docs/design.md#timing.
pub const TICK_TO_COMMAND_JITTER_PESSIMISTIC: u64 = 1_000;
/// The largest spread, peak to peak, of the time from a HORUS tick to the first bit on air. The front end itself
/// scatters by up to 2.3 µs: see docs/design.md#timing.
pub const TICK_TO_AIR_JITTER: u64 = 3_000;
/// The longest time from a frame's last bit until its image is readable, where the listener reads its FIFO while the
/// FIFO fills. This bound holds whatever the flight controller does: docs/design.md#timing.
pub const LAST_BIT_TO_READABLE: u64 = 100_000;
/// The longest time from the end of an SSI transaction until the DPR is ready for the next one: docs/design.md#timing.
/// The DPR must also put a new image into its SPI peripheral within this time.
pub const SSI_READY: u64 = 10_000;
/// The longest time from the instant at which HORUS takes a sample until the flight controller can read that sample. A
/// sample is readable before its successor is taken.
pub const SAMPLE_TO_READABLE: u64 = 10_000_000;
/// The length of a cycle: docs/design.md#timing.
pub const CYCLE: u64 = 10_000_000;
/// The load is not judged in a run that is shorter than this, because the work of a start would be most of what a
/// processor does in such a run.
pub const LOAD_FROM: u64 = 300_000_000;
/// The longest processor time that a start of HORUS takes. The test of its memory, the check of its program and the
/// whole set-up take 36 ms on the pessimistic clock. The bound of the load applies to the time after the start.
pub const HORUS_START_WORK: u64 = 40_000_000;
/// The longest processor time that a start of the DPR takes; 17 ms were measured on the pessimistic clock.
pub const DPR_START_WORK: u64 = 20_000_000;
/// The highest processor load allowed, in ten thousandths: docs/design.md#timing.
pub const LOAD_PER_10_000: u32 = 1_000;

/// The greatest share of the DPR's time, in ten thousandths, that its second port may take in addition.
pub const HOLD_LOAD_PER_10_000: u32 = 150;
/// How long after a frame's end the DPR counts the next frame as missed: docs/design.md#publication.
pub const FRAME_DEADLINE: u64 = 12_500_000;
/// How long an image that is not replaced stays readable after its publication: docs/design.md#publication.
pub const EXPIRY: u64 = 25_000_000;
/// The longest time from power-on or reset until a board does its work, which for HORUS is the first tick and for the
/// DPR the first readiness. HORUS compares its flash with its CRC (4 to 6 ms), starts its oscillators and waits one
/// cycle. The watchdog of either board would bite after 100 ms.
pub const START: u64 = 100_000_000;

// ---- Bounds that the rules of the sending side add

/// The greatest difference between 10 ms and the time between two ticks. Without its crystal HORUS runs on an
/// oscillator that is trimmed to 1 % and may be off by 2 % over temperature (docs/design.md#status-words, bit 7).
/// Another 0.1 % is added for the clock that measures the time between ticks.
pub const TICK_TOLERANCE: u64 = 210_000;
/// The largest spread, peak to peak, of the time between two ticks while HORUS runs without a restart. It is small
/// because HORUS's timer counts one oscillator.
pub const TICK_WIDTH: u64 = 1_000;
/// How long after a tick, one and a half cycles, the judge reports the next tick as missing.
pub const TICK_MISSING: u64 = CYCLE + CYCLE / 2;
/// The longest time from a transmit command to the first preamble bit. In recordings the front end takes 3 to 5 µs; its
/// data sheet states no bound. If no frame begins within this time after a command, the command had none.
pub const COMMAND_TO_AIR: u64 = 100_000;
/// The longest air time of a frame: 5.003 ms at 424 kbit/s (254 bytes, `profile::air`), and 2 % for the clock.
pub const FRAME_LONGEST: u64 = 5_100_000;
/// The longest time from a transmit command to the end of its frame. At the front end's lowest rate, 106 kbit/s, the
/// longest frame takes 20 ms. A frame is logged at its end, so after this time it is certain that a command had no
/// frame.
pub const COMMAND_TO_END: u64 = 20_500_000;
/// The longest time after a lost frame at which HORUS may take the field down to bring its front end up again. HORUS
/// does that after the second lost frame in a row.
pub const FIELD_RECOVERY: u64 = 2 * CYCLE + CYCLE / 2;
/// How long no frame is required after the field has come back. HORUS checks its front end before the next tick's
/// frame, so the cycle in which the field came back has no frame.
pub const FIELD_READY: u64 = CYCLE;
/// The longest time after the field at the DPR's antenna has gone or come until Link-Status must state the change. It
/// covers two publications without a frame, 12.5 ms each, and the time that the front end takes to detect the change.
pub const FIELD_TOLD: u64 = 30_000_000;
/// The longest time that HORUS's watchdog takes to bite: 100 ms of an oscillator of nominally 32 kHz that may run at 17
/// kHz (DS9405).
pub const WATCHDOG_LONGEST: u64 = 190_000_000;
/// The longest time that HORUS's watchdog takes to bite if HORUS has not fed it since its start. HORUS first feeds it
/// within [`WATCHDOG_FED`] after a start. The watchdog begins with 4096 periods of 4 cycles of its oscillator (RM0090
/// 21.3), which are 512 ms at 32 kHz.
pub const FIRST_WATCHDOG_LONGEST: u64 = 970_000_000;
/// The longest time after a start of HORUS until HORUS first feeds its watchdog: see [`FIRST_WATCHDOG_LONGEST`].
pub const WATCHDOG_FED: u64 = 40_000_000;
/// The longest time that the DPR's watchdog takes to bite: 100 ms of an RC oscillator of 32.768 kHz that may be off by
/// 2 % (nRF52840 PS 5.4). Another 2 % is allowed, because chips were seen that barely keep the specified 2 %.
pub const DPR_WATCHDOG_LONGEST: u64 = 104_000_000;
/// For HORUS and for the DPR, how long after the death of a task the board's watchdog may still be fed, because that
/// task had checked in before. Every task of HORUS checks in once a cycle. The DPR's SSI task may check in only at the
/// end of a transaction (`dpr_fw::ssi`), and a flight controller that misbehaves may delay that end. The delay has no
/// limit if the scrub task is dead, because that task asks the SSI task to check in. Unless the watchdog is fed just
/// before, it then bites earlier than after this time.
pub const CHECKED_IN: [u64; 2] = [FRAME_DEADLINE + CYCLE, DPR_WATCHDOG_LONGEST];
/// How long after a tick an arriving message may still be in that tick's objects. HORUS takes the values of its objects
/// between the tick and the first slot, which is at most 0.12 ms later (docs/design.md#timing and
/// `profile::air::send_slot_us`). A margin is included. A message that arrives between the tick and this time may be in
/// the objects or not.
pub const SAMPLED_AFTER_TICK: u64 = 350_000;
/// How long before a tick the last byte of a message must have crossed its line if the message is to be in that tick's
/// objects for certain. HORUS checks how full a line's receive ring is on three occasions: when the line falls idle (22
/// µs), at every half of the ring (5.5 ms) and, if both are missed, once a tick after the objects of that tick are made
/// (10 ms). HORUS parses in pieces of 64 bytes, at a priority below all other tasks, which takes less than 2 ms.
pub const MESSAGE_TAKEN: u64 = CYCLE + 2_000_000;
/// A solution is valid until its age exceeds its receiver's period by this time: docs/design.md#validity.
pub const VALID_BEYOND_PERIOD: u64 = 150_000_000;
/// A solution is stale once its age exceeds its receiver's period by this time: docs/design.md#validity.
pub const STALE_BEYOND_PERIOD: u64 = 50_000_000;
/// How long after a receiver's last message HORUS's status calls that receiver heard: docs/design.md#status-words.
pub const HEARD: u64 = 250_000_000;
/// The longest period that HORUS accepts from a receiver, ms: docs/design.md#validity.
pub const LONGEST_PERIOD_MS: u32 = 1_000;
/// The shortest period that HORUS accepts from a receiver, ms: 50 Hz, twice the rate of the fastest receivers.
pub const SHORTEST_PERIOD_MS: u32 = 20;

/// The longest time in which HORUS must have read some of the bytes that a receiver on a bus offers. It counts from the
/// offer or from the instant at which the bus works again. HORUS reads such a receiver in every cycle and tries again
/// at once if a read fails. The value is a receiver's longest period, because after that time a position from this
/// receiver is no longer valid (docs/design.md#validity).
pub const READ_WITHIN: u64 = 1_000_000_000;
/// Bytes that have waited in a receiver on a bus for longer than this are old when HORUS reads them. HORUS may drop old
/// bytes, and may drop what it reads within [`READ_SETTLED`] after old bytes. HORUS reads in every cycle but may leave
/// one cycle out.
pub const NEWS: u64 = 25_000_000;
/// How long HORUS may drop what it reads from a receiver on a bus after it has read bytes that may be old ([`NEWS`]),
/// or after a failure of the bus. HORUS needs this time to determine which bytes are new.
pub const READ_SETTLED: u64 = 100_000_000;
/// HORUS must not use bytes that have waited in a receiver on a bus for longer than this. Such bytes are not a current
/// solution, and the receiver does not count as heard because of them.
pub const TOO_OLD: u64 = 50_000_000;
/// If more bytes than this wait in a receiver, HORUS leaves some of them for its next cycle (decision 16) and may drop
/// them.
pub const READ_AT_ONCE: u64 = 256;
/// The dynamic model by which a receiver has to navigate: airborne with less than 2 g. This is its number in u-blox'
/// CFG-NAVSPG-DYNMODEL.
pub const DYNAMIC_MODEL: u8 = 7;
/// The longest time until a receiver is set as HORUS needs it. It counts from HORUS's start, from the loss of a
/// setting, or from the end of a fault of the receiver or its line. It covers 1.5 s until HORUS begins to set the
/// receiver anew, 0.7 s at each of two bit rates, and two messages without an answer, 1 s each.
pub const SETTINGS_TOLD: u64 = 5_000_000_000;
/// The longest time until HORUS must send a valid position. It counts from HORUS's start or from the instant at which
/// enough receivers work again. Within this time the receivers are set, the slowest one sends a solution (one a
/// second), and a voted position that jumps is held back.
pub const POSITION_WITHIN: u64 = SETTINGS_TOLD + READ_WITHIN + HELD_BACK;
/// How long after a fault of a receiver HORUS's objects may lack that receiver's position and may call the receiver
/// excluded.
pub const POSITION_SETTLED: u64 = SETTINGS_TOLD + RETURNED;
/// The greatest age of a position that is shown as valid: the aircraft must have been there at most this long ago.
/// docs/design.md#validity calls a solution valid for the longest period and [`VALID_BEYOND_PERIOD`], and a receiver
/// takes up to [`BEFORE_ARRIVAL`] and [`BEFORE_ARRIVAL_SPREAD`] to send the solution.
pub const POSITION_OLDEST: u64 =
    LONGEST_PERIOD_MS as u64 * 1_000_000 + VALID_BEYOND_PERIOD + BEFORE_ARRIVAL + BEFORE_ARRIVAL_SPREAD;
/// The largest error of a valid position, horizontal and vertical, m. Each value is five times the error that the worst
/// receiver exceeds in one of 68 cases.
pub const POSITION_OFF_M: [f64; 2] = [10.0, 20.0];

/// The step, ns, in which a GPS object's status states the age of its solution: docs/design.md#status-words.
pub const AGE_STEP: u64 = 25_000_000;
/// The code for the greatest age, in steps of [`AGE_STEP`], that a GPS object's status can state. A solution that is
/// older has this code too.
pub const AGE_OLDEST: u64 = 62;
/// The code that a GPS object's status states in place of the solution's age if there never was a solution.
pub const AGE_NEVER: u64 = 63;

// ---- The voted position: decision 15

/// Returns how many of the given number of receivers have to agree on a position: docs/design.md#voting.
#[must_use]
pub const fn quorum(receivers: usize) -> usize {
    match receivers {
        0..=2 => 1,
        3..=4 => 2,
        _ => 3,
    }
}
/// The worst accuracies, horizontal and vertical, with which a position is valid, mm.
pub const WORST_ACCURACY_MM: [u32; 2] = [30_000, 50_000];
/// The greatest speed with which a position is valid, mm/s.
pub const FASTEST_MM_S: u32 = 200_000;
/// The heights above the ellipsoid at which a valid position may lie, mm.
pub const ALTITUDE_MM: std::ops::RangeInclusive<i32> = -1_000_000..=20_000_000;
/// How much older, ns, a position is than its message, since a receiver takes time to compute and send the position.
/// Among the candidates, which are the receivers whose position may be voted on, this is assumed for the one whose
/// message took neither the longest nor the shortest time (decision 15, brought to the tick).
pub const BEFORE_ARRIVAL: u64 = 50_000_000;
/// The greatest difference, ns, between a candidate's latency and that of the candidate with the middle latency
/// ([`BEFORE_ARRIVAL`]). If a candidate's latency seems to differ by more, [`BEFORE_ARRIVAL`] is assumed for that
/// candidate too.
pub const BEFORE_ARRIVAL_SPREAD: u64 = 50_000_000;
/// The limits, m, of the distance up to which two receivers agree: one pair for the horizontal distance, and one for
/// the vertical. Up to the first limit of a pair two receivers agree whatever accuracies they state, and beyond the
/// second they disagree.
pub const AGREEMENT_M: [(f64, f64); 2] = [(5.0, 30.0), (8.0, 50.0)];
/// Between the limits of [`AGREEMENT_M`], two receivers agree if their distance is at most this many times the root of
/// the sum of the squares of their accuracies.
pub const AGREEMENT_SIGMAS: f64 = 3.0;
/// The differences of pitch, yaw and roll, in degrees, up to which two attitudes agree: docs/design.md#voting and
/// decision 15, attitude and acceleration.
pub const ATTITUDE_DEGREES: [f64; 3] = [5.0, 10.0, 5.0];
/// The difference along each axis, m/s², up to which two accelerations agree.
pub const ACCELERATION_M_S2: f64 = 2.0;
/// How long a voted position that jumps must have lasted for HORUS to have to show it. HORUS holds such a position back
/// until it has lasted for one second (docs/design.md#voting). The value has the tolerances of [`RETURNED`].
pub const HELD_BACK: u64 = RETURNED;
/// How long a voted position that jumps must at least have lasted before HORUS may show it: see [`HELD_BACK`].
pub const NOT_HELD_BACK: u64 = NOT_RETURNED;
/// The time, s, by which a receiver's speed is multiplied to give what is added to the receiver's accuracy when HORUS
/// brings its position to the tick. The position's age adds half of [`UNCERTAIN_ACCELERATION`] times the square of that
/// age.
pub const UNCERTAIN_SPEED_S: f64 = 0.05;
/// The acceleration, m/s², that is assumed for the change of an aircraft's velocity since a receiver's message: see
/// [`UNCERTAIN_SPEED_S`].
pub const UNCERTAIN_ACCELERATION: f64 = 4.0;
/// How long an excluded receiver must have agreed for HORUS to have to readmit it to the vote. HORUS readmits a
/// receiver that has been a candidate and has agreed with the voted position for one second. The judge counts from the
/// last instant at which the receiver may not have agreed. HORUS's clock may be off by 2 %, and it may be uncertain
/// which messages HORUS had taken at a tick.
pub const RETURNED: u64 = 1_100_000_000;
/// How long an excluded receiver must at least have agreed before HORUS may readmit it to the vote. The value has the
/// tolerances of [`RETURNED`].
pub const NOT_RETURNED: u64 = 950_000_000;
/// The share of a distance by which two methods of converting degrees into metres may differ. Decision 15 prescribes no
/// method, and a sphere in place of the ellipsoid is off by up to 1 %.
pub const GEODESY_SHARE: f64 = 0.01;
/// The largest error of HORUS's arithmetic in a position, m.
pub const ARITHMETIC_M: f64 = 0.05;
/// The largest error of HORUS's arithmetic in an angle (rad) or an acceleration (m/s²) that is the mean of two.
pub const ARITHMETIC_F32: f32 = 1e-5;

// ---- Flight controller and base station

/// The shortest time for which FRESH is high (docs/hardware.md), so that a pin interrupt of a flight controller behind
/// an isolator detects it.
pub const FRESH_WIDTH: u64 = 1_500;
/// The age, ns, beyond which a flight controller must not fly by a position (docs/flight-controller.md).
pub const CLIENT_AGE_LIMIT: u64 = 100_000_000;
/// How far, ns, the age that a client states may be below the true age. The value covers the scatter of both front
/// ends, and the error of the crystals of both boards and of the flight controller (100 ppm and 1000 ppm of
/// [`CLIENT_AGE_LIMIT`]).
pub const CLIENT_AGE_SHORT: u64 = 300_000;
/// How far, ns, the age that a client states may be above the true age. The client assumes that the image is as old as
/// an image can be, and Link-Status rounds to 0.1 ms.
pub const CLIENT_AGE_LONG: u64 = EXPIRY + 600_000;
/// The number of transactions in a row after which the client must have found the sequence, if each of them reads the
/// next cycle in sequence with a valid position.
pub const CLIENT_FINDS: u32 = SEARCH_CYCLES as u32 + 2;
/// How far, ns, the age that the base station states may be from the true age. The base station does not know the delay
/// of any transmission and takes the shortest one as zero. The value covers a delay of up to 45 ms on the air, an image
/// that is read just before it expires, and the crystals.
pub const STATION_AGE_OFF: u64 = 120_000_000;
/// How long profiles that do not continue the sequence shown before, as after a restart of HORUS, must have arrived in
/// sequence for the base station to have to show them. The base station accepts that a drone has restarted when
/// profiles from before the restart have been absent for 250 ms, and the alarms of a restart last for 1 s.
pub const STATION_SETTLES: u64 = 1_500_000_000;
/// The age, ns, beyond which the base station calls a position stale (documentation of the base station).
pub const STATION_STALE: u64 = 400_000_000;
/// How long, ns, no profile must have arrived for the base station to call the drone silent.
pub const STATION_SILENT: u64 = 1_000_000_000;

// ---- Receivers' lines

/// How long a line must have been silent for HORUS to be allowed to discard a message that had begun. HORUS discards it
/// after 50 ms.
pub const SILENCE_MAY_END: u64 = 45_000_000;
/// How long a line must have been silent for HORUS to have discarded a message that had begun. HORUS detects the 50 ms
/// at its next check of the line, one every 10 ms, and then gives the parser 64 zeros at each further check. The zeros
/// of four checks are more than the longest message that the parser accepts.
pub const SILENCE_ENDS: u64 = 110_000_000;
/// How long no transaction must have been made for the judge to report it. The flight controller reads in every one of
/// its control cycles, which are much shorter.
pub const NO_TRANSACTION: u64 = 100_000_000;
/// How long after a restart of HORUS a frame may still break off. HORUS loads a frame while its beginning is on the
/// air, so a frame under way at a restart runs out of bytes within the air time of the longest frame.
pub const CUT_SHORT: u64 = 6_000_000;
/// The number of transactions that the DPR must serve between two images. If a flight controller makes transactions
/// without a pause, the DPR serves no more than that (`dpr_fw::ssi`).
pub const SSI_BUDGET: u32 = 16;
/// How long the DPR need not notice the end of a further transaction, counted from the instant at which it became ready
/// again after a transaction (`dpr_fw::ssi`). The value covers 95 µs by a counter of µs, and the processor's work
/// before and after.
pub const SSI_PAUSE: u64 = 100_000;
/// The shortest time for which an image is readable after its publication. The DPR's clock counts [`EXPIRY`] and is off
/// by no more than 2 % (docs/design.md#sequence).
pub const EXPIRY_EARLIEST: u64 = EXPIRY - EXPIRY / 50;
/// The greatest difference between a frame's instant at the DPR's antenna and that of its transmission. A frame with a
/// greater difference was delayed or repeated on its way.
pub const AIR_DELAY: u64 = 1_000;
/// The longest time from the forwarding of a profile to its arrival at the base station.
pub const DOWNLINK: u64 = 100_000_000;
/// The longest time from a frame's end, or a deadline, until a transaction reads the image that follows from it, where
/// no narrower bound applies. The DPR may have to do three more transfers with its front end and one more commit
/// before.
pub const PUBLICATION: u64 = 400_000;
/// The longest time on the pessimistic clock from a frame's end, or a deadline, until a transaction reads the image
/// that follows from it, where no narrower bound applies: see [`PUBLICATION`].
pub const PUBLICATION_PESSIMISTIC: u64 = 1_000_000;
/// The longest time from the instant at which the DPR takes the values of Link-Status until FRESH rises. In this time
/// the DPR commits the image.
pub const SEALED_BEFORE_FRESH: u64 = 200_000;
/// The number of cycles that may be missing between two cycles that are in sequence: docs/design.md#sequence.
pub const MAX_MISSED: u32 = 25;
/// The greatest difference between the time that passed between two cycles and the step of their timestamps. One part
/// in [`STEP_TOLERANCE_SHARE`] of the step is added to it: docs/design.md#sequence.
pub const STEP_TOLERANCE: u64 = 2_500_000;
/// The divisor that gives the part of the step that is added to [`STEP_TOLERANCE`]: one part in 50 is 2 %.
pub const STEP_TOLERANCE_SHARE: u64 = 50;
/// The greatest difference between 10 ms and the time between two cycles while the DPR searches for the sequence:
/// docs/design.md#sequence.
pub const SEARCH_TOLERANCE: u64 = 500_000;
/// The number of consecutive cycles, each advancing by exactly one, after which the sequence is found:
/// docs/design.md#sequence.
pub const SEARCH_CYCLES: u8 = 3;
/// How close to a limit of the sequence's times an instant must be for the judge to require nothing. The value is many
/// times the scatter of the front ends, the resolution of the DPR's counter and the error of its crystal (100 ppm of
/// the longest step are 26 µs).
pub const SEQUENCE_BAND: u64 = 300_000;
/// How close to the narrower limit of the search, [`SEARCH_TOLERANCE`], an instant must be for the judge to require
/// nothing.
pub const SEARCH_BAND: u64 = 100_000;
/// The longest time from the carrier's return until the listener receives frames. The listener measures the field
/// first. A listener that was being configured, or that waits after a failed attempt, starts anew.
pub const ARMED: u64 = 50_000_000;
/// How long no frame must have arrived for the DPR to be allowed to bring its front end up anew. The DPR does that
/// after 0.5 s, and the time that it counts may be a little longer than the time that has passed.
pub const SILENCE: u64 = 450_000_000;
/// How long after the first frame that follows a silence of [`SILENCE`] the DPR may miss further frames, and
/// Link-Status may still report a fault. A bring-up takes 12 ms.
pub const SILENCE_OVER: u64 = 2 * CYCLE;
/// The shortest time between the end of one frame and the beginning of the next in which a listener can receive both:
/// docs/design.md#air-frame.
pub const FRAME_GAP: u64 = 300_000;
/// How long the DPR waits, after the end of the first of a cycle's two frames (with five receivers), for the second.
/// The second frame ends 3.935 ms after the first, and the image has to be published before the next cycle's first
/// frame.
pub const SECOND_FRAME: u64 = 7_000_000;
/// How long Link-Status shows a restart of HORUS (docs/design.md#link-status). The time is long, so that no control
/// cycle misses it.
pub const RESTART_SHOWN: u64 = 1_000_000_000;
/// The DPR calls HORUS's clock implausible if the time that it counts over a second differs by more than one part in
/// this number from the time of the DPR's clock: see docs/design.md#sequence.
pub const CLOCK_SHARE: u64 = 50;
/// The shortest time over which the DPR compares HORUS's clock with its own: docs/design.md#sequence.
pub const CLOCK_WINDOW: u64 = 1_000_000_000;
/// The most by which two crystals may differ, parts per million: twice 50, and as much again for the temperature.
pub const CRYSTALS_PPM: u64 = 200;
/// How long after a bit of one of the DPR's buffers was disturbed, or was last stuck, that buffer may be in use. Three
/// receive buffers and four images take turns, one in each cycle.
pub const BUFFER_REPLACED: u64 = 5 * CYCLE;
/// The number of cycles in which the link must recover from a disturbance if no front end has to be brought up again.
/// They count from the end of the disturbance to the first valid object that HORUS sent after it, and cover a frame,
/// the three cycles that find the sequence (docs/design.md#sequence), and the flight controller's reading.
pub const RECOVERY_CYCLES: u64 = 5;
/// The number of cycles in which the link must recover from a disturbance, as in [`RECOVERY_CYCLES`], if a front end
/// has to be brought up: after a restart of either board, and after a fault of either front end. The firmware then
/// waits up to 64 ms between two attempts.
pub const BRING_UP_CYCLES: u64 = 15;
/// The longest time until the DPR's Link-Status must report that the front end has ceased to answer. The DPR checks a
/// front end that is silent every 20 ms, and publishes every 10 ms after a missed frame.
pub const FRONT_END_TOLD: u64 = 4 * CYCLE;
/// The longest time, 15 cycles, from the return of a front end that was out of order until its firmware has brought it
/// up again.
pub const FRONT_END_RECOVERY: u64 = 15 * CYCLE;
/// The longest time that a self-test of the DPR takes: one pass over its flash and one over its RAM. They take 3.5 s if
/// the program and the RAM in use have the largest size allowed, since a self-test proceeds three times as fast as the
/// checks that always run. A margin for missing idle time of the processor is added.
pub const SELF_TEST: u64 = 5_000_000_000;
/// The longest time that a pass over the DPR's flash takes: 7.7 s for a program of 96 KiB, and a margin for missing
/// idle time of the processor.
pub const FLASH_PASS_LONGEST: u64 = 9_000_000_000;
/// The shortest time that a pass over the DPR's flash takes, which is that in a self-test with a program of 16 KiB.
pub const FLASH_PASS_SHORTEST: u64 = 400_000_000;
/// The greatest time, ms, by which Port-Status may be older than Link-Status of the same image: one cycle, and the time
/// for which the task that makes Port-Status waits.
pub const PORT_BEFORE_LINK_MS: u32 = 25;
/// The causes of a safe state, as the DPR's firmware codes them (`firmware_common::last_stop`).
pub const STOP_CAUSES: std::ops::RangeInclusive<u32> = 1..=14;
/// The longest time from a bit flip in HORUS's flash until its field is off: two passes over its flash, 9.1 s for a
/// program of the largest size allowed, and a margin for missing idle time.
pub const HORUS_FLASH_FOUND: u64 = 10_000_000_000;
/// The longest time from a bit flip in the DPR's flash until Link-Status reports a flash fault: two passes over its
/// flash, 15.4 s, and a margin for missing idle time.
pub const DPR_FLASH_FOUND: u64 = 17_000_000_000;
/// The longest time, ns, from the warning of a falling supply until the board is in its safe state: an interrupt, and
/// the writes to the front end or the SPI peripheral.
pub const SAFE_STATE: u64 = 1_000_000;
/// The number of new cycles that may be read while a bit of a DPR buffer is stuck before Link-Status must report a RAM
/// fault. Three receive buffers and four images take turns, one in each cycle, and a buffer is scrubbed before it is
/// used again. After this number of cycles each buffer has therefore been scrubbed.
pub const SCRUBBED_CYCLES: u32 = 8;
/// How long after the end of a flight controller's misuse of the SSI the judge requires nothing of the DPR. In this
/// time the transaction under way ends, and the DPR puts the next image in.
pub const MISUSE_OVER: u64 = 2 * CYCLE;
/// The longest time from a frame's last bit until its image is readable, if the DPR reads the FIFO only at the frame's
/// end: docs/design.md#timing. This bound also applies to a frame whose LEN was damaged, since the DPR cannot tell then
/// when the frame's objects are complete.
pub const STORE_AND_FORWARD: u64 = 360_000;
