//! The limits that the judge holds every run against: the design's numbers, in ns unless stated otherwise.

/// The largest spread, peak to peak, of the time from a HORUS tick to its transmit command (docs/design.md#timing).
pub const TICK_TO_COMMAND_JITTER: u64 = 100;
/// The limit [`TICK_TO_COMMAND_JITTER`] for runs on the pessimistic clock, where an interrupt waits for the longest
/// instruction.
pub const TICK_TO_COMMAND_JITTER_PESSIMISTIC: u64 = 1_000;
/// The largest spread, peak to peak, of the time from a HORUS tick to the first bit on air (docs/design.md#timing).
pub const TICK_TO_AIR_JITTER: u64 = 3_000;
/// The longest time from a frame's last bit until its image is readable: docs/design.md#timing. This bound is for a DPR
/// that reads the frame from the front end while the frame arrives.
pub const LAST_BIT_TO_READABLE: u64 = 100_000;
/// The longest time from the end of an SSI transaction until the DPR is ready for the next one: docs/design.md#timing.
pub const SSI_READY: u64 = 10_000;
/// The longest time from the instant at which HORUS takes a sample until the flight controller can read that sample.
pub const SAMPLE_TO_READABLE: u64 = 10_000_000;
/// The length of a cycle: docs/design.md#timing.
pub const CYCLE: u64 = 10_000_000;
/// The processor load is judged only in runs longer than this. In a shorter run the start takes most of the load.
pub const LOAD_FROM: u64 = 300_000_000;
/// The longest processor time that a start of HORUS takes; 36 ms were measured on the pessimistic clock.
pub const HORUS_START_WORK: u64 = 40_000_000;
/// The longest processor time that a start of the DPR takes; 17 ms were measured on the pessimistic clock.
pub const DPR_START_WORK: u64 = 20_000_000;
/// The highest processor load allowed, in ten thousandths: docs/design.md#timing.
pub const LOAD_PER_10_000: u32 = 1_000;

/// The share of the DPR's processor time, in ten thousandths, that the second port may take on top of
/// [`LOAD_PER_10_000`].
pub const HOLD_LOAD_PER_10_000: u32 = 150;
/// The time from a frame's end to the deadline at which the DPR counts the next frame as missed:
/// docs/design.md#publication.
pub const FRAME_DEADLINE: u64 = 12_500_000;
/// How long an image that is not replaced stays readable after its publication: docs/design.md#publication.
pub const EXPIRY: u64 = 25_000_000;
/// The longest time from power-on or reset until a board works: HORUS until its first tick, the DPR until it is first
/// ready for a transaction. Either board's watchdog would bite after 100 ms.
pub const START: u64 = 100_000_000;

// ---- The sending side

/// The greatest difference between 10 ms and the time between two ticks. HORUS's oscillator without the crystal may be
/// off by 2 % over temperature (docs/design.md#status-words, bit 7). Another 0.1 % is for the measuring clock.
pub const TICK_TOLERANCE: u64 = 210_000;
/// The largest spread, peak to peak, of the time between two ticks while HORUS runs without a restart.
pub const TICK_WIDTH: u64 = 1_000;
/// The longest time from one tick of HORUS to the next. The judge reports a later tick as missing.
pub const TICK_MISSING: u64 = CYCLE + CYCLE / 2;
/// The longest time from a transmit command to the first preamble bit. In recordings the front end takes 3 to 5 µs; its
/// data sheet states no bound.
pub const COMMAND_TO_AIR: u64 = 100_000;
/// The longest air time of a frame: 5.003 ms at 424 kbit/s (254 bytes, `profile::air`), and 2 % for the clock.
pub const FRAME_LONGEST: u64 = 5_100_000;
/// The longest time from a transmit command to the end of its frame. At the front end's lowest rate, 106 kbit/s, the
/// longest frame takes 20 ms.
pub const COMMAND_TO_END: u64 = 20_500_000;
/// How long after a lost frame HORUS may still switch the field off, to bring its front end up again.
pub const FIELD_RECOVERY: u64 = 2 * CYCLE + CYCLE / 2;
/// How long after the return of the field no frame is required, because HORUS checks its front end first.
pub const FIELD_READY: u64 = CYCLE;
/// The longest time from a change of the field at the DPR's antenna until Link-Status must state the change. Two
/// publications without a frame, 12.5 ms each, and the front end's detection fit into this time.
pub const FIELD_TOLD: u64 = 30_000_000;
/// The longest time that HORUS's watchdog takes to bite: 100 ms at 32 kHz, but its oscillator may run at 17 kHz
/// (DS9405).
pub const WATCHDOG_LONGEST: u64 = 190_000_000;
/// The longest time that HORUS's watchdog takes to bite before its first feed. The watchdog begins with 4096 periods of
/// 4 cycles of its oscillator (RM0090 21.3), which are 512 ms at 32 kHz and 964 ms at 17 kHz.
pub const FIRST_WATCHDOG_LONGEST: u64 = 970_000_000;
/// The longest time after a start of HORUS until HORUS first feeds its watchdog.
pub const WATCHDOG_FED: u64 = 40_000_000;
/// The longest time that the DPR's watchdog takes to bite: 100 ms of an RC oscillator of 32.768 kHz that may be off by
/// 2 % (nRF52840 PS 5.4). Another 2 % is allowed, because chips were seen that barely keep the specified 2 %.
pub const DPR_WATCHDOG_LONGEST: u64 = 104_000_000;
/// The longest time for which HORUS's and the DPR's watchdog may still be fed after a task has died, ns. The task may
/// have checked in just before its death.
///
/// Every task of HORUS checks in once a cycle. The DPR's SSI task may check in only at the end of a transaction
/// (`dpr_fw::ssi`), which a flight controller may delay until the watchdog bites.
pub const CHECKED_IN: [u64; 2] = [FRAME_DEADLINE + CYCLE, DPR_WATCHDOG_LONGEST];
/// How long after a tick an arriving message may still be in that tick's objects. HORUS takes the values at most 0.12
/// ms after the tick (docs/design.md#timing); the rest is a margin.
pub const SAMPLED_AFTER_TICK: u64 = 350_000;
/// How long before a tick the last byte of a message must have arrived to be in that tick's objects for certain. HORUS
/// reads a receive ring once a cycle at least, and parses the bytes in less than 2 ms.
pub const MESSAGE_TAKEN: u64 = CYCLE + 2_000_000;
/// How much longer than its receiver's period a solution stays valid: docs/design.md#validity.
pub const VALID_BEYOND_PERIOD: u64 = 150_000_000;
/// How much older than its receiver's period a solution is when it becomes stale: docs/design.md#validity.
pub const STALE_BEYOND_PERIOD: u64 = 50_000_000;
/// How long HORUS's status must go on stating that messages arrive from a receiver, counted from that receiver's last
/// message: docs/design.md#status-words.
pub const HEARD: u64 = 250_000_000;
/// The longest period that HORUS accepts from a receiver, ms: docs/design.md#validity.
pub const LONGEST_PERIOD_MS: u32 = 1_000;
/// The shortest period that HORUS accepts from a receiver, ms: 50 Hz, twice the rate of the fastest receivers.
pub const SHORTEST_PERIOD_MS: u32 = 20;

/// The longest time that HORUS may leave the bytes of a receiver on a bus unread. It counts from when the receiver
/// offers the bytes, or from the end of a fault of the bus. It is the longest period of a receiver, because a position
/// is not valid for much longer (docs/design.md#validity).
pub const READ_WITHIN: u64 = 1_000_000_000;
/// HORUS must use bytes that have waited in a receiver on a bus for at most this time. HORUS may drop bytes that have
/// waited longer, and all bytes that it reads within [`READ_SETTLED`] after them.
pub const NEWS: u64 = 25_000_000;
/// How long HORUS may drop all bytes from a receiver on a bus, counted from a failure of the bus or from bytes that
/// waited too long ([`NEWS`]).
pub const READ_SETTLED: u64 = 100_000_000;
/// HORUS must drop bytes that have waited in a receiver on a bus for longer than this.
pub const TOO_OLD: u64 = 50_000_000;
/// The number of bytes that HORUS reads from a receiver in one cycle (decision 16). HORUS leaves further bytes for its
/// next cycle and may drop them.
pub const READ_AT_ONCE: u64 = 256;
/// The dynamic model that every receiver must use: airborne below 2 g, as u-blox' CFG-NAVSPG-DYNMODEL numbers it.
pub const DYNAMIC_MODEL: u8 = 7;
/// The longest time until HORUS has sent a receiver its settings. It counts from HORUS's start, from the loss of a
/// setting, or from the end of a fault.
///
/// To set a receiver, HORUS waits for 1.5 s, tries two bit rates for 0.7 s each, and waits 1 s for the answer to each
/// of two messages.
pub const SETTINGS_TOLD: u64 = 5_000_000_000;
/// The longest time until HORUS must send a valid position. It counts from HORUS's start, or from when enough receivers
/// work again.
///
/// To have a valid position, HORUS sends the receivers their settings, waits for the slowest receiver's solution, and
/// holds a jump of the position back.
pub const POSITION_WITHIN: u64 = SETTINGS_TOLD + READ_WITHIN + HELD_BACK;
/// The time after a receiver's fault in which HORUS may leave out the receiver's position or exclude the receiver from
/// the vote.
pub const POSITION_SETTLED: u64 = SETTINGS_TOLD + RETURNED;
/// The greatest age of a position that is shown as valid. A solution arrives up to [`BEFORE_ARRIVAL`] and
/// [`BEFORE_ARRIVAL_SPREAD`] after its epoch, and is then valid for its period and [`VALID_BEYOND_PERIOD`]
/// (docs/design.md#validity).
pub const POSITION_OLDEST: u64 =
    LONGEST_PERIOD_MS as u64 * 1_000_000 + VALID_BEYOND_PERIOD + BEFORE_ARRIVAL + BEFORE_ARRIVAL_SPREAD;
/// The largest error of a valid position, horizontal and vertical, m. One in 68 solutions of the worst receiver has an
/// error above a fifth of this limit.
pub const POSITION_OFF_M: [f64; 2] = [10.0, 20.0];

/// The step, ns, in which a GPS object's status states the age of its solution: docs/design.md#status-words.
pub const AGE_STEP: u64 = 25_000_000;
/// The code, in steps of [`AGE_STEP`], that a GPS object's status states for a solution of this age or older.
pub const AGE_OLDEST: u64 = 62;
/// The code that a GPS object's status states if there never was a solution.
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
/// The largest accuracies that a receiver may state for a valid position, horizontal and vertical, mm.
pub const WORST_ACCURACY_MM: [u32; 2] = [30_000, 50_000];
/// A position is valid only up to this speed, mm/s.
pub const FASTEST_MM_S: u32 = 200_000;
/// The heights above the ellipsoid at which a valid position may lie, mm.
pub const ALTITUDE_MM: std::ops::RangeInclusive<i32> = -1_000_000..=20_000_000;
/// The latency that HORUS assumes for a receiver: the time, ns, from the measurement of a position to the arrival of
/// its message (decision 15).
pub const BEFORE_ARRIVAL: u64 = 50_000_000;
/// The greatest difference, ns, of a receiver's latency from [`BEFORE_ARRIVAL`] that HORUS takes into account.
pub const BEFORE_ARRIVAL_SPREAD: u64 = 50_000_000;
/// Two limits, m, on the distance between two receivers, each horizontal and vertical. Nearer than the first limit, two
/// receivers agree whatever accuracies they state. Farther apart than the second, they disagree.
pub const AGREEMENT_M: [(f64, f64); 2] = [(5.0, 30.0), (8.0, 50.0)];
/// Between the limits of [`AGREEMENT_M`], two receivers agree if their distance is at most this many times the root of
/// the sum of the squares of their accuracies.
pub const AGREEMENT_SIGMAS: f64 = 3.0;
/// The differences of pitch, yaw and roll, degrees, up to which two attitudes agree (docs/design.md#voting).
pub const ATTITUDE_DEGREES: [f64; 3] = [5.0, 10.0, 5.0];
/// The difference along each axis, m/s², up to which two accelerations agree.
pub const ACCELERATION_M_S2: f64 = 2.0;
/// The time after which HORUS must show a voted position that has jumped and then stays there (docs/design.md#voting).
pub const HELD_BACK: u64 = RETURNED;
/// The time for which HORUS must hold back a voted position that has jumped: one second less tolerances.
pub const NOT_HELD_BACK: u64 = NOT_RETURNED;
/// The voter multiplies this time, s, by the speed and adds the product to a receiver's accuracy. It also adds half of
/// [`UNCERTAIN_ACCELERATION`], multiplied by the square of the position's age.
pub const UNCERTAIN_SPEED_S: f64 = 0.05;
/// The greatest acceleration, m/s², that HORUS assumes for the aircraft since a receiver's message.
pub const UNCERTAIN_ACCELERATION: f64 = 4.0;
/// How long an excluded receiver must agree with the voted position until HORUS must readmit it to the vote. The design
/// says one second. This limit is longer, because HORUS's clock may be off by 2 % and the judge may not know which
/// messages HORUS had at a tick.
pub const RETURNED: u64 = 1_100_000_000;
/// How long an excluded receiver must agree with the voted position before HORUS may readmit it to the vote.
pub const NOT_RETURNED: u64 = 950_000_000;
/// The greatest difference between two ways to convert degrees into metres, as a share of the distance. A sphere in
/// place of the ellipsoid is off by up to 1 %, and decision 15 prescribes no way.
pub const GEODESY_SHARE: f64 = 0.01;
/// The largest error of HORUS's arithmetic in a position, m.
pub const ARITHMETIC_M: f64 = 0.05;
/// The largest error of HORUS's arithmetic in an angle (rad) or an acceleration (m/s²) that is the mean of two.
pub const ARITHMETIC_F32: f32 = 1e-5;

// ---- Flight controller and base station

/// The shortest time for which FRESH is high. A pin interrupt behind an isolator can detect a pulse of this length
/// (docs/hardware.md).
pub const FRESH_WIDTH: u64 = 1_500;
/// The age, ns, beyond which a flight controller must not fly by a position (docs/flight-controller.md).
pub const CLIENT_AGE_LIMIT: u64 = 100_000_000;
/// How far, ns, the age that a client states may be below the true age. This covers the scatter of the front ends, and
/// the error of the crystals over [`CLIENT_AGE_LIMIT`]: 100 ppm on the boards and 1000 ppm in the flight controller.
pub const CLIENT_AGE_SHORT: u64 = 300_000;
/// How far, ns, the age that a client states may be above the true age. The client assumes the oldest image possible,
/// and Link-Status rounds to 0.1 ms.
pub const CLIENT_AGE_LONG: u64 = EXPIRY + 600_000;
/// The number of transactions within which the client must find the sequence, if each reads the next valid cycle.
pub const CLIENT_FINDS: u32 = SEARCH_CYCLES as u32 + 2;
/// How far, ns, the age that the base station states may be from the true age. The base station counts the shortest
/// transmission as zero, so the value covers 45 ms on the air, an image that is read just before it expires, and the
/// crystals.
pub const STATION_AGE_OFF: u64 = 120_000_000;
/// How long the profiles of a new sequence must arrive until the base station must show them. The base station waits
/// until the old sequence has been absent for 250 ms, and its alarms of a restart of HORUS last for 1 s.
pub const STATION_SETTLES: u64 = 1_500_000_000;
/// The age, ns, beyond which the base station calls a position stale (docs/base-station.md).
pub const STATION_STALE: u64 = 400_000_000;
/// The base station calls the drone silent when no profile has arrived for this time.
pub const STATION_SILENT: u64 = 1_000_000_000;

// ---- The lines of the receivers

/// A line must have been silent for this time before HORUS may discard an incomplete message; HORUS waits for 50 ms.
pub const SILENCE_MAY_END: u64 = 45_000_000;
/// The silence of a receiver's line after which HORUS must have discarded an incomplete message. HORUS checks every 10
/// ms whether the line has been silent for 50 ms. If so, it ends the incomplete message with zeros, for which it needs
/// up to four checks.
pub const SILENCE_ENDS: u64 = 110_000_000;
/// The longest pause between two transactions that the judge accepts: far longer than a control cycle.
pub const NO_TRANSACTION: u64 = 100_000_000;
/// How long after a restart of HORUS a frame may still break off: the length of the longest frame.
pub const CUT_SHORT: u64 = 6_000_000;
/// The number of transactions that the DPR serves at most between two images (`dpr_fw::ssi`).
pub const SSI_BUDGET: u32 = 16;
/// The pause of the DPR after a transaction, in which it may miss the end of another transaction (`dpr_fw::ssi`): 95 µs
/// by its counter, and processor time before and after.
pub const SSI_PAUSE: u64 = 100_000;
/// The shortest time for which an image is readable: the DPR's clock is off by 2 % at most (docs/design.md#sequence).
pub const EXPIRY_EARLIEST: u64 = EXPIRY - EXPIRY / 50;
/// The greatest difference between the instants at which a frame leaves HORUS's antenna and reaches the DPR's. A frame
/// with a greater difference was delayed or repeated.
pub const AIR_DELAY: u64 = 1_000;
/// The longest time from the forwarding of a profile to its arrival at the base station.
pub const DOWNLINK: u64 = 100_000_000;
/// The longest time from a frame's end, or from a deadline, until a transaction can read the resulting image, if no
/// narrower limit applies. It covers up to three more transfers with the DPR's front end and one more commit.
pub const PUBLICATION: u64 = 400_000;
/// The limit [`PUBLICATION`] for runs on the pessimistic clock.
pub const PUBLICATION_PESSIMISTIC: u64 = 1_000_000;
/// The longest time from the instant at which the DPR takes the values of Link-Status until FRESH rises.
pub const SEALED_BEFORE_FRESH: u64 = 200_000;
/// The number of cycles that may be missing between two cycles that are in sequence: docs/design.md#sequence.
pub const MAX_MISSED: u32 = 25;
/// The greatest difference between the time from one cycle to the next and the step of their timestamps. One part in
/// [`STEP_TOLERANCE_SHARE`] of that step is added: docs/design.md#sequence.
pub const STEP_TOLERANCE: u64 = 2_500_000;
/// One part in this number (2 %) of the step between two cycles' timestamps is added to [`STEP_TOLERANCE`].
pub const STEP_TOLERANCE_SHARE: u64 = 50;
/// In the search for the sequence, the greatest difference between 10 ms and the time between two cycles
/// (docs/design.md#sequence).
pub const SEARCH_TOLERANCE: u64 = 500_000;
/// The sequence is found after this number of consecutive cycles (docs/design.md#sequence).
pub const SEARCH_CYCLES: u8 = 3;
/// How close an instant must be to a limit of the sequence's times for the judge to accept either outcome. The value is
/// many times the scatter of the front ends and the error of the DPR's clock (100 ppm of the longest step are 26 µs).
pub const SEQUENCE_BAND: u64 = 300_000;
/// How close an instant must be to [`SEARCH_TOLERANCE`] for the judge to accept either outcome.
pub const SEARCH_BAND: u64 = 100_000;
/// The longest time from the carrier's return until the listener receives frames. A listener whose bring-up was
/// interrupted or has failed is brought up anew.
pub const ARMED: u64 = 50_000_000;
/// No frame must have come for this time before the DPR may bring its front end up anew; the DPR waits for 0.5 s.
pub const SILENCE: u64 = 450_000_000;
/// How long after the frame that ends a [`SILENCE`] the DPR may miss frames and Link-Status may still report a fault. A
/// bring-up of the front end takes 12 ms.
pub const SILENCE_OVER: u64 = 2 * CYCLE;
/// The shortest time from the end of one frame to the next frame if a listener is to receive both
/// (docs/design.md#air-frame).
pub const FRAME_GAP: u64 = 300_000;
/// With five receivers, how long after a cycle's first frame the DPR waits for the second frame. The second frame ends
/// 3.935 ms after the first.
pub const SECOND_FRAME: u64 = 7_000_000;
/// How long Link-Status shows a restart of HORUS (docs/design.md#link-status).
pub const RESTART_SHOWN: u64 = 1_000_000_000;
/// HORUS's clock is implausible if it is off by one part in this number over a second (docs/design.md#sequence).
pub const CLOCK_SHARE: u64 = 50;
/// The shortest time over which the DPR compares HORUS's clock with its own: docs/design.md#sequence.
pub const CLOCK_WINDOW: u64 = 1_000_000_000;
/// The greatest difference between two crystals, parts per million. Each crystal may be off by 50, and by 50 more
/// because of the temperature.
pub const CRYSTALS_PPM: u64 = 200;
/// The longest time for which one of the DPR's buffers may stay in use after a fault of a bit in it. Three receive
/// buffers and four images take turns, one in each cycle.
pub const BUFFER_REPLACED: u64 = 5 * CYCLE;
/// The number of cycles in which the link must recover from a disturbance if no front end has to be brought up again.
/// It covers a frame, the three cycles that find the sequence (docs/design.md#sequence), and the flight controller's
/// reading.
pub const RECOVERY_CYCLES: u64 = 5;
/// The number of cycles in which the link must recover from a disturbance if a front end has to be brought up: after a
/// restart of a board or a fault of a front end. The firmware waits up to 64 ms between two attempts.
pub const BRING_UP_CYCLES: u64 = 15;
/// The longest time until Link-Status must report that the front end has ceased to answer. The DPR checks a silent
/// front end every 20 ms, and publishes every 10 ms after a missed frame.
pub const FRONT_END_TOLD: u64 = 4 * CYCLE;
/// The longest time from the end of a front end's fault until its firmware has brought the front end up again.
pub const FRONT_END_RECOVERY: u64 = 15 * CYCLE;
/// The longest time that a self-test of the DPR takes. One pass over flash and RAM takes 3.5 s for the largest program
/// and RAM allowed; a margin is added for missing idle time of the processor.
pub const SELF_TEST: u64 = 5_000_000_000;
/// The longest time that a pass over the DPR's flash takes: 7.7 s for a program of 96 KiB, and a margin.
pub const FLASH_PASS_LONGEST: u64 = 9_000_000_000;
/// The shortest time that a pass over the DPR's flash takes: the pass of a self-test with a program of 16 KiB.
pub const FLASH_PASS_SHORTEST: u64 = 400_000_000;
/// The greatest difference in age, ms, between Link-Status and an older Port-Status of the same image.
pub const PORT_BEFORE_LINK_MS: u32 = 25;
/// The causes of a safe state, as the DPR's firmware codes them (`firmware_common::last_stop`).
pub const STOP_CAUSES: std::ops::RangeInclusive<u32> = 1..=15;
/// The longest time from a bit flip in HORUS's flash until its field is off: two passes over the flash, 9.1 s for the
/// largest program allowed, and a margin for missing idle time.
pub const HORUS_FLASH_FOUND: u64 = 10_000_000_000;
/// The longest time from a bit flip in the DPR's flash until Link-Status reports a flash fault: two passes over the
/// flash, 15.4 s, and a margin for missing idle time.
pub const DPR_FLASH_FOUND: u64 = 17_000_000_000;
/// The longest time from the warning of a falling supply until the board is in its safe state.
pub const SAFE_STATE: u64 = 1_000_000;
/// The number of new cycles that may be read while a bit of a DPR buffer is stuck before Link-Status must report a RAM
/// fault. By then each of the three receive buffers and four images has been used and scrubbed.
pub const SCRUBBED_CYCLES: u32 = 8;
/// The time after a flight controller's misuse of the SSI in which the judge requires nothing of the DPR.
pub const MISUSE_OVER: u64 = 2 * CYCLE;
/// The longest time from a frame's last bit until its image is readable: docs/design.md#timing. This bound is for a DPR
/// that reads the FIFO only at the frame's end. The DPR also does so if the frame's LEN was damaged.
pub const STORE_AND_FORWARD: u64 = 360_000;
