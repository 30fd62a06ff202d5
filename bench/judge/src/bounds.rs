//! What is allowed: the design's numbers, ns unless said otherwise.

/// HORUS tick to transmit command (chip select rising after it), peak to peak: docs/design.md#timing.
pub const TICK_TO_COMMAND_JITTER: u64 = 100;
/// The same on the pessimistic clock, where an interrupt may meet the longest instruction: docs/design.md#timing.
pub const TICK_TO_COMMAND_JITTER_PESSIMISTIC: u64 = 1_000;
/// HORUS tick to first bit on air, peak to peak; the front end itself scatters by up to 2.3 µs: see
/// docs/design.md#timing.
pub const TICK_TO_AIR_JITTER: u64 = 3_000;
/// Last bit to image readable, with a listener that reads its FIFO while it fills, whatever the flight controller does:
/// docs/design.md#timing.
pub const LAST_BIT_TO_READABLE: u64 = 100_000;
/// End of an SSI transaction to ready for the next: docs/design.md#timing. The DPR may put a new image in for no longer
/// either.
pub const SSI_READY: u64 = 10_000;
/// A sample is readable before its successor is taken.
pub const SAMPLE_TO_READABLE: u64 = 10_000_000;
/// The cycle: docs/design.md#timing.
pub const CYCLE: u64 = 10_000_000;
/// In a run shorter than this, what a start takes of a processor is most of what it does: its load is not judged.
pub const LOAD_FROM: u64 = 300_000_000;
/// What a start takes of HORUS's processor at most, ns: the test of its memory, the comparison of its image and all
/// that it sets up are 36 ms on the pessimistic clock. The bound of the load is of what a board does then.
pub const HORUS_START_WORK: u64 = 40_000_000;
/// The same of the DPR's: 17 ms.
pub const DPR_START_WORK: u64 = 20_000_000;
/// Processor load, ten thousandths: docs/design.md#timing.
pub const LOAD_PER_10_000: u32 = 1_000;
/// Missed-frame deadline after a frame's end: docs/design.md#publication.
pub const FRAME_DEADLINE: u64 = 12_500_000;
/// An image that is not replaced stops being readable so long after its publication: docs/design.md#publication.
pub const EXPIRY: u64 = 25_000_000;
/// From power-on or reset to a board doing its work: first tick, first readiness. HORUS compares its flash with its CRC
/// (4 to 6 ms), starts its oscillators and waits one cycle; either board's watchdog would bite after 100 ms.
pub const START: u64 = 100_000_000;

// ---- What the rules of the sending side add

/// A tick comes 10 ms after the one before, give or take this: HORUS without its crystal runs on an oscillator that is
/// trimmed to 1 % and may be off by 2 % over temperature (docs/design.md#status-words, bit 7), and 0.1 % for the clock
/// that it is measured by.
pub const TICK_TOLERANCE: u64 = 210_000;
/// Between two ticks, peak to peak from one start of HORUS to the next: its timer counts one oscillator.
pub const TICK_WIDTH: u64 = 1_000;
/// So long after a tick its successor is missing: one and a half cycles.
pub const TICK_MISSING: u64 = CYCLE + CYCLE / 2;
/// From a transmit command to the first preamble bit: the front end takes 3 to 5 µs in recordings and its data sheet
/// names no bound. A command that no frame follows within this has none.
pub const COMMAND_TO_AIR: u64 = 100_000;
/// The longest frame at 424 kbit/s is 5.003 ms (254 bytes, `profile::air`), and 2 % for the clock.
pub const FRAME_LONGEST: u64 = 5_100_000;
/// A frame is logged when it has ended. At the slowest rate that the front end has, 106 kbit/s, the longest takes 20
/// ms: after this a command had no frame.
pub const COMMAND_TO_END: u64 = 20_500_000;
/// So long after a lost frame HORUS may take the field down to bring its front end up again: it does that after the
/// second in a row.
pub const FIELD_RECOVERY: u64 = 2 * CYCLE + CYCLE / 2;
/// After the field has come back HORUS checks its front end before the next tick's frame: the cycle in which it came
/// back has none.
pub const FIELD_READY: u64 = CYCLE;
/// Link-Status says so long after the field at the antenna has gone or come that it has: two publications without a
/// frame, 12.5 ms each, and what the front end takes to notice.
pub const FIELD_TOLD: u64 = 30_000_000;
/// The longest that HORUS's watchdog takes to bite: 100 ms by an oscillator of 32 kHz that may run at 17 kHz (DS9405).
pub const WATCHDOG_LONGEST: u64 = 190_000_000;
/// The same from a start until HORUS feeds it first, which it has done after [`WATCHDOG_FED`]: the watchdog starts with
/// 4096 periods of 4 of that oscillator (RM0090 21.3), 512 ms at 32 kHz.
pub const FIRST_WATCHDOG_LONGEST: u64 = 970_000_000;
/// See [`FIRST_WATCHDOG_LONGEST`].
pub const WATCHDOG_FED: u64 = 40_000_000;
/// The same of the DPR's: 100 ms by an RC oscillator of 32.768 kHz that may be off by 2 % (nRF52840 PS 5.4), and as
/// much again, since parts were seen that keep that narrowly.
pub const DPR_WATCHDOG_LONGEST: u64 = 104_000_000;
/// A task that died had checked in before, and the watchdog is fed once more for that, within this: every task of HORUS
/// checks in once a cycle. The DPR's SSI task may do so only with the end of a transaction (`dpr_fw::ssi`), which a
/// flight controller that misbehaves puts off, for good if the scrub task is dead, which asks for signs of life. Then
/// the watchdog bites before, unless it is fed just in time.
pub const CHECKED_IN: [u64; 2] = [FRAME_DEADLINE + CYCLE, DPR_WATCHDOG_LONGEST];
/// HORUS takes what its objects say after the tick and before the first slot, 0.12 ms after it at the latest
/// (docs/design.md#timing and `profile::air::send_slot_us`): a message that arrived later is not in them. With a
/// margin, since what arrives in between may be in them or not.
pub const SAMPLED_AFTER_TICK: u64 = 350_000;
/// A message whose last byte crossed its line so long before a tick is in that tick's objects. HORUS looks how far a
/// line's ring has come when the line falls idle (22 µs), at every half of the ring (5.5 ms) and, if it overlooks both,
/// once a tick, after the objects of that tick are made: 10 ms. Parsing in pieces of 64 bytes, below all other tasks,
/// takes less than 2 ms.
pub const MESSAGE_TAKEN: u64 = CYCLE + 2_000_000;
/// A solution is valid until it is older than its receiver's period and this: docs/design.md#validity.
pub const VALID_BEYOND_PERIOD: u64 = 150_000_000;
/// A solution is stale from its receiver's period and this on: docs/design.md#validity.
pub const STALE_BEYOND_PERIOD: u64 = 50_000_000;
/// A receiver counts as heard so long after a message: docs/design.md#status-words.
pub const HEARD: u64 = 250_000_000;
/// The longest period that is believed of a receiver, ms: docs/design.md#validity.
pub const LONGEST_PERIOD_MS: u32 = 1_000;
/// The shortest, ms: 50 Hz, twice what the fastest receivers do.
pub const SHORTEST_PERIOD_MS: u32 = 20;

/// HORUS reads a receiver on a bus in every cycle, and tries anew at once where that fails: so long after it has
/// offered something, or after its bus has come back, some of that has been read. It is a receiver's longest period,
/// after which a position that it rests on is not valid any more (docs/design.md#validity).
pub const READ_WITHIN: u64 = 1_000_000_000;
/// What has waited in a receiver on a bus for longer is no news when HORUS reads it: it may drop that, and what it
/// reads within [`READ_SETTLED`] of it, since it reads in every cycle and may leave one out.
pub const NEWS: u64 = 25_000_000;
/// See [`NEWS`]: after what may be old, or a bus that failed, HORUS may take some reads to be sure of what is new.
pub const READ_SETTLED: u64 = 100_000_000;
/// What has waited for longer than this must not be taken: it is no solution of now, and counts nothing as heard.
pub const TOO_OLD: u64 = 50_000_000;
/// If more bytes than this wait in a receiver, HORUS leaves some of them for its next cycle (decision 16), and may drop
/// them.
pub const READ_AT_ONCE: u64 = 256;
/// The dynamic model by which a receiver has to navigate: airborne with less than 2 g, of u-blox' CFG-NAVSPG-DYNMODEL.
pub const DYNAMIC_MODEL: u8 = 7;
/// A receiver has to be set as HORUS needs it within this after HORUS's start, the loss of a setting, or the end of a
/// fault of the receiver or its line: 1.5 s until HORUS begins anew, 0.7 s at two bit rates, and two messages without
/// an answer, 1 s each.
pub const SETTINGS_TOLD: u64 = 5_000_000_000;
/// So long after HORUS's start, or after enough receivers are well again, there is a position at the latest: the
/// receivers have to be set, one of them has a solution once a second, and a result that jumps is held back.
pub const POSITION_WITHIN: u64 = SETTINGS_TOLD + READ_WITHIN + HELD_BACK;
/// After a fault of a receiver its position may be missing for so long, and it may be excluded.
pub const POSITION_SETTLED: u64 = SETTINGS_TOLD + RETURNED;
/// A position is one at which the aircraft was at most so long ago: docs/design.md#validity calls a solution valid for
/// the longest period and [`VALID_BEYOND_PERIOD`], and a receiver takes up to [`BEFORE_ARRIVAL_SPREAD`] more than
/// [`BEFORE_ARRIVAL`] to tell it.
pub const POSITION_OLDEST: u64 =
    LONGEST_PERIOD_MS as u64 * 1_000_000 + VALID_BEYOND_PERIOD + BEFORE_ARRIVAL + BEFORE_ARRIVAL_SPREAD;
/// And it is off by so much at most, horizontal and vertical, m: five times what the worst of the receivers is off in
/// one of 68 cases.
pub const POSITION_OFF_M: [f64; 2] = [10.0, 20.0];

/// The step in which a GPS object's status tells the age of its solution, the code of the oldest, and that of none:
/// docs/design.md#status-words.
pub const AGE_STEP: u64 = 25_000_000;
/// See [`AGE_STEP`].
pub const AGE_OLDEST: u64 = 62;
/// See [`AGE_STEP`].
pub const AGE_NEVER: u64 = 63;

// ---- The voted position: decision 15

/// How many of so many receivers have to agree: docs/design.md#voting.
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
/// Where a valid position may lie above the ellipsoid, mm.
pub const ALTITUDE_MM: std::ops::RangeInclusive<i32> = -1_000_000..=20_000_000;
/// A position is older than its message by what a receiver needs to compute and send: by this, ns, at the candidate
/// whose message took neither the longest nor the shortest (decision 15, brought to the tick).
pub const BEFORE_ARRIVAL: u64 = 50_000_000;
/// Another candidate's latency may differ from that by this at most, ns. If it seems to differ by more, it counts as
/// [`BEFORE_ARRIVAL`].
pub const BEFORE_ARRIVAL_SPREAD: u64 = 50_000_000;
/// The least and the greatest distance, horizontal and vertical, within which two receivers agree whatever accuracies
/// they state, m.
pub const AGREEMENT_M: [(f64, f64); 2] = [(5.0, 30.0), (8.0, 50.0)];
/// Between these limits two receivers agree within so many times the root of the sum of the squares of their
/// accuracies.
pub const AGREEMENT_SIGMAS: f64 = 3.0;
/// Two attitudes agree within so many degrees of pitch, yaw and roll: docs/design.md#voting and decision 15, attitude
/// and acceleration.
pub const ATTITUDE_DEGREES: [f64; 3] = [5.0, 10.0, 5.0];
/// Two accelerations agree within so many m/s² along each axis.
pub const ACCELERATION_M_S2: f64 = 2.0;
/// A result that jumps is shown when it has held for one second: docs/design.md#voting. After so long it has, by the
/// same tolerances as for [`RETURNED`].
pub const HELD_BACK: u64 = RETURNED;
/// And before that it has not.
pub const NOT_HELD_BACK: u64 = NOT_RETURNED;
/// What a position's age adds to its accuracy: so many seconds of its speed, and half of so many m/s².
pub const UNCERTAIN_SPEED_S: f64 = 0.05;
/// See [`UNCERTAIN_SPEED_S`].
pub const UNCERTAIN_ACCELERATION: f64 = 4.0;
/// An excluded receiver that was a candidate and agreed for one second returns; so long after it last may not have, it
/// has returned. HORUS's clock may be off by 2 %, and what it had taken at a tick may be in doubt.
pub const RETURNED: u64 = 1_100_000_000;
/// And before that, by the same tolerances, it has not.
pub const NOT_RETURNED: u64 = 950_000_000;
/// How far apart two ways to turn degrees into metres may be, as a share of the distance: decision 15 names none, and a
/// sphere in place of the ellipsoid is off by up to 1 %.
pub const GEODESY_SHARE: f64 = 0.01;
/// What HORUS's arithmetic may be off, m.
pub const ARITHMETIC_M: f64 = 0.05;
/// The same of an angle (rad) or an acceleration (m/s²) that is the mean of two.
pub const ARITHMETIC_F32: f32 = 1e-5;

// ---- Flight controller and base station

/// FRESH is high for this at least (docs/hardware.md): a pin interrupt of the flight controller behind an isolator sees
/// it.
pub const FRESH_WIDTH: u64 = 1_500;
/// A position that is older than this must not be flown by (docs/flight-controller.md), ns.
pub const CLIENT_AGE_LIMIT: u64 = 100_000_000;
/// What a client's age may be below the true one, ns: what both front ends scatter and the crystals of both boards and
/// the flight controller are off (100 ppm and 1000 ppm of [`CLIENT_AGE_LIMIT`]).
pub const CLIENT_AGE_SHORT: u64 = 300_000;
/// And above it: it takes the image to be as old as one can be, and Link-Status rounds to 0.1 ms.
pub const CLIENT_AGE_LONG: u64 = EXPIRY + 600_000;
/// So many transactions in a row that bring cycles in sequence with a valid position find the client's sequence.
pub const CLIENT_FINDS: u32 = SEARCH_CYCLES as u32 + 2;
/// The base station's age may differ so much from the true one, ns: it knows the delay of no way, and takes the fastest
/// for none. An air that holds frames back by up to 45 ms, an image that is read when it expires, and the crystals.
pub const STATION_AGE_OFF: u64 = 120_000_000;
/// What continues nothing that the base station has shown is shown for certain once it has come in sequence for this:
/// one that has restarted is believed when what was before has been quiet for 250 ms, and the alarms of that last for
/// 1 s.
pub const STATION_SETTLES: u64 = 1_500_000_000;
/// A position that is older than this is stale for the base station (docs of the base station), ns.
pub const STATION_STALE: u64 = 400_000_000;
/// And if nothing arrives for this, the drone is silent, ns.
pub const STATION_SILENT: u64 = 1_000_000_000;

// ---- Receivers' lines

/// A line that was silent for this long may have ended the message that it had begun: HORUS does that after 50 ms.
pub const SILENCE_MAY_END: u64 = 45_000_000;
/// A line that was silent for this long has: after 50 ms HORUS notices at its next look (10 ms) and gives the parser 64
/// zeros at each of the following, of which four are more than the longest message that it takes.
pub const SILENCE_ENDS: u64 = 110_000_000;
/// The flight controller reads in every one of its control cycles, which are much shorter.
pub const NO_TRANSACTION: u64 = 100_000_000;
/// HORUS loads a frame while its beginning is on the air: one that restarts then leaves it to run out of bytes, within
/// the air time of the longest frame.
pub const CUT_SHORT: u64 = 6_000_000;
/// Transactions that the DPR serves between two images: a flight controller that runs away gets no more
/// (`dpr_fw::ssi`).
pub const SSI_BUDGET: u32 = 16;
/// From when the DPR is ready after a transaction, it need not see the next end for this time (`dpr_fw::ssi`): 95 µs
/// by a counter of µs, and what it does between the two.
pub const SSI_PAUSE: u64 = 100_000;
/// The DPR's clock counts [`EXPIRY`]; it is off by no more than 2 % (docs/design.md#sequence), so no image expires
/// earlier.
pub const EXPIRY_EARLIEST: u64 = EXPIRY - EXPIRY / 50;
/// A frame that is heard so much earlier or later than it was sent was delayed or repeated on its way.
pub const AIR_DELAY: u64 = 1_000;
/// From forwarding a profile to its arrival at the base station.
pub const DOWNLINK: u64 = 100_000_000;
/// From a frame's end, or a deadline, to the image that follows from it being what a transaction gets, where nothing
/// narrower is asked: three more transactions of the listener's front end and a commit may come between.
pub const PUBLICATION: u64 = 400_000;
/// The same on the pessimistic clock.
pub const PUBLICATION_PESSIMISTIC: u64 = 1_000_000;
/// The values of Link-Status are taken so long before FRESH rises at most: the rest of the commit.
pub const SEALED_BEFORE_FRESH: u64 = 200_000;
/// Cycles that may be missing between two that are in sequence: docs/design.md#sequence.
pub const MAX_MISSED: u32 = 25;
/// How much the time between two cycles may differ from their timestamps' step; to this comes one part in
/// [`STEP_TOLERANCE_SHARE`] of the step: docs/design.md#sequence.
pub const STEP_TOLERANCE: u64 = 2_500_000;
/// See [`STEP_TOLERANCE`]: 2 %.
pub const STEP_TOLERANCE_SHARE: u64 = 50;
/// While the sequence is searched for a cycle comes 10 ms after the one before it within this:
/// docs/design.md#sequence.
pub const SEARCH_TOLERANCE: u64 = 500_000;
/// So many cycles in a row that each advance by exactly one find the sequence: docs/design.md#sequence.
pub const SEARCH_CYCLES: u8 = 3;
/// Around every limit of the sequence's times nothing is asked: what the front ends scatter, the resolution of the
/// DPR's counter, and its crystal (100 ppm of the longest step are 26 µs), many times over.
pub const SEQUENCE_BAND: u64 = 300_000;
/// The same around the narrower limit of the search.
pub const SEARCH_BAND: u64 = 100_000;
/// From the carrier's return to a listener that hears: it measures the field, and one that was being configured or
/// backs off starts anew.
pub const ARMED: u64 = 50_000_000;
/// A listener that has heard no frame for so long may be bringing its front end up anew: it does that after 0.5 s, and
/// counts a little more than passes.
pub const SILENCE: u64 = 450_000_000;
/// After such a silence, frames that begin within this after the first may escape it, and Link-Status may still say so:
/// a bring-up takes 12 ms.
pub const SILENCE_OVER: u64 = 2 * CYCLE;
/// Between the end of one frame and the beginning of the next a listener needs this to hear both:
/// docs/design.md#air-frame.
pub const FRAME_GAP: u64 = 300_000;
/// Of five receivers' two frames the second is waited for so long after the end of the first: it ends 3.935 ms after
/// it, and the image has to be out before the next cycle's first.
pub const SECOND_FRAME: u64 = 7_000_000;
/// A restart of HORUS is shown in Link-Status for so long (docs/design.md#link-status), so that no control cycle
/// overlooks it.
pub const RESTART_SHOWN: u64 = 1_000_000_000;
/// HORUS's clock is implausible if it differs by more than one part in so many over a second: see
/// docs/design.md#sequence.
pub const CLOCK_SHARE: u64 = 50;
/// The shortest time over which the clocks are compared: docs/design.md#sequence.
pub const CLOCK_WINDOW: u64 = 1_000_000_000;
/// What two crystals may be apart, parts per million: twice 50, and as much again for the temperature.
pub const CRYSTALS_PPM: u64 = 200;
/// So long after a bit of a buffer of the DPR was hit, or was stuck last, that buffer may be in use: three receive
/// buffers and four images take turns, one in each cycle.
pub const BUFFER_REPLACED: u64 = 5 * CYCLE;
/// From the end of a cause to the first valid object of a cycle that HORUS sent after it, where no front end has to be
/// brought up again: a frame, the three that find the sequence (docs/design.md#sequence), and the flight controller's
/// reading.
pub const RECOVERY_CYCLES: u64 = 5;
/// The same where a front end has to be brought up: after a restart of either board, and after a fault of either front
/// end, whose firmware backs off up to 64 ms between two attempts.
pub const BRING_UP_CYCLES: u64 = 15;
/// So long after a front end has ceased to answer the DPR's Link-Status says so at the latest: it looks at a chip that
/// is silent every 20 ms, and publishes after a missed frame every 10 ms.
pub const FRONT_END_TOLD: u64 = 4 * CYCLE;
/// From the return of a front end that was out of order to its firmware having brought it up again: within 15
/// cycles.
pub const FRONT_END_RECOVERY: u64 = 15 * CYCLE;
/// A self-test of the DPR takes one pass over its flash and one over its RAM, in at most this: 3.5 s where the image
/// and the RAM in use take all that they may, three times as fast as round the clock, and the processor's idle time
/// allows.
pub const SELF_TEST: u64 = 5_000_000_000;
/// A pass over the DPR's flash takes at most this: 7.7 s for an image of 96 KiB, and what idle time may be missing.
pub const FLASH_PASS_LONGEST: u64 = 9_000_000_000;
/// And at least this: a self-test of an image of 16 KiB.
pub const FLASH_PASS_SHORTEST: u64 = 400_000_000;
/// Port-Status is made so long before Link-Status of the same image at most, ms: one cycle, and what its task waits
/// for.
pub const PORT_BEFORE_LINK_MS: u32 = 25;
/// The causes by which the DPR's firmware codes its safe state (`firmware_common::last_stop`).
pub const STOP_CAUSES: std::ops::RangeInclusive<u32> = 1..=14;
/// From a flip in HORUS's flash to its field being off: two passes over its flash, 9.1 s where the image takes all that
/// it may, and what idle time may be missing.
pub const HORUS_FLASH_FOUND: u64 = 10_000_000_000;
/// From a flip in the DPR's flash to Link-Status: the same, 15.4 s.
pub const DPR_FLASH_FOUND: u64 = 17_000_000_000;
/// The longest time from the warning of a falling supply until the board is in its safe state, ns: an interrupt, and
/// the writes to the front end or the SPI peripheral.
pub const SAFE_STATE: u64 = 1_000_000;
/// The number of cycles shown with a stuck bit after which each buffer of that kind has been scrubbed: three
/// receive buffers and four images take turns, one in each cycle, and a buffer is scrubbed before it is used again.
pub const SCRUBBED_CYCLES: u32 = 8;
/// After a flight controller has misused the SSI the DPR is asked for nothing for so long: what was under way ends, and
/// the next image is put in.
pub const MISUSE_OVER: u64 = 2 * CYCLE;
/// Last bit to image readable where the FIFO is read at the frame's end only: docs/design.md#timing. So it is for a
/// frame whose LEN was damaged, since nobody knows then when its objects are complete.
pub const STORE_AND_FORWARD: u64 = 360_000;
