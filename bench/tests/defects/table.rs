//! Defects that a hurried change could leave in the sources. Each has a change of one file, the run of `cargo xtask
//! sim` that shows the defect, and the resulting violation.
//!
//! `cargo xtask defects` builds a copy of the workspace with all defects, and a run chooses one of them
//! (`xtask/src/defects.rs`). The word `DEFECT` in a new text stands for the choice. Without that word the program
//! contains both texts, and executes the new one if the defect is chosen.
//!
//! The old text of a row must occur exactly once in its file, and not in a `const fn`.

use bench_judge::Violation;

pub(crate) struct Edit {
    /// The file's path from the workspace's root.
    pub(crate) file: &'static str,
    pub(crate) old: &'static str,
    pub(crate) new: &'static str,
}

pub(crate) enum Shows {
    /// The run of a defect shows this violation, perhaps among others.
    By(Violation),
    /// The run of a defect shows no violation: a rule is missing, or only the named test finds the defect.
    Not(&'static str),
}

pub(crate) struct Defect {
    pub(crate) name: &'static str,
    pub(crate) does: &'static str,
    pub(crate) edit: Edit,
    /// The arguments of `cargo xtask sim` for the run that shows the defect.
    pub(crate) run: &'static str,
    pub(crate) shows: Shows,
}

const HORUS: &str = "horus-tx-fw/src/main.rs";
const CYCLE: &str = "horus-tx-fw/src/cycle.rs";
const RECEIVER: &str = "horus-tx-fw/src/receiver.rs";
const CONFIGURATION: &str = "horus-tx-fw/src/configuration.rs";
const INPUTS: &str = "horus-tx-fw/src/state_inputs.rs";
const VOTER: &str = "horus-tx-fw/voter/src/lib.rs";
const DPR: &str = "dpr-fw/src/main.rs";
const COMMIT: &str = "dpr-fw/src/commit.rs";
const ACCEPT: &str = "dpr-fw/src/accept.rs";
const LINK: &str = "dpr-fw/src/link.rs";
const PORT: &str = "dpr-fw/src/port/mod.rs";
const SERVER: &str = "dpr-fw/src/publish/server.rs";
const SSI: &str = "dpr-fw/src/hw/ssi.rs";
const INTEGRITY: &str = "dpr-fw/src/integrity.rs";
const SEQUENCE: &str = "profile/src/sequence.rs";
const TRACK: &str = "profile/src/ssi/client/track.rs";
const CLIENT: &str = "profile/src/ssi/client/mod.rs";
const DRONE: &str = "base-station/core/src/drone/mod.rs";
const ORDER: &str = "base-station/core/src/drone/order.rs";

const PLAIN: &str = "--seconds 6";
/// A run in which the receivers start with their factory settings.
const FACTORY: &str = "--seconds 8 --factory-settings";
const GNSS: &str = "--seconds 20 --seed 3 --faults gnss";
/// A run with faults of receivers and their lines, in which all receivers jump at once.
const JUMPS: &str = "--seconds 20 --seed 6 --faults gnss";
const AIR: &str = "--seconds 20 --seed 4 --faults air";
const FC: &str = "--seconds 20 --seed 5 --faults fc";
const POWER: &str = "--seconds 20 --seed 6 --faults power";
const BUFFERS: &str = "--seconds 20 --seed 12 --faults buffers";
const STATES: &str = "--seconds 20 --seed 8 --faults inputs";
/// A run in which boards hang, and tasks are dead.
const HANG: &str = "--seconds 20 --seed 9 --faults hang";
const CHIPS: &str = "--seconds 20 --seed 10 --faults chips";
/// The longest run, with all kinds of faults except those of the chips.
const LONG: &str = "--seconds 60 --seed 31 --faults air,gnss,fc,power,buffers,inputs,hang";
/// A run with all kinds of faults except those of the chips.
const ALL: &str = "--seconds 20 --seed 11 --faults air,gnss,fc,power,buffers,inputs,hang";

const fn edit(file: &'static str, old: &'static str, new: &'static str) -> Edit {
    Edit { file, old, new }
}

const fn row(name: &'static str, does: &'static str, edit: Edit, run: &'static str, shows: Shows) -> Defect {
    Defect { name, does, edit, run, shows }
}

use Shows::{By, Not};
use Violation as V;

#[rustfmt::skip]
pub(crate) const DEFECTS: &[Defect] = &[
    // ---- HORUS: receivers

    row("buses-not-polled", "the tick serves the first receiver alone",
        edit(HORUS,
          "for line in cx.shared.lines {\n            change(line, GnssLine::poll);",
          "for (nth, line) in cx.shared.lines.iter_mut().enumerate() {\n            if DEFECT && nth > 0 \
          {\n                continue;\n            }\n            change(line, GnssLine::poll);"),
        PLAIN, By(V::NotRead)),
    row("receivers-not-configured", "no settings are sent to any receiver",
        edit(HORUS, "buffers::outbox(index).put(&message);", "let _ = &message;"),
        FACTORY, By(V::NotConfigured)),
    // Breaks REC-5.
    row("only-first-solution", "the solution of the first receiver stands for all",
        edit(HORUS,
          "if let Some(solution) = solutions.get_mut(index) {",
          "if let Some(solution) = solutions.get_mut(if DEFECT { 0 } else { index }) {"),
        PLAIN, By(V::ContentWrong)),
    row("configured-once", "a receiver that has lost its settings is not configured again",
        edit(CONFIGURATION, "if self.silent_for(now) > limit {", "if !DEFECT && self.silent_for(now) > limit {"),
        "--seconds 40 --seed 5 --faults gnss", By(V::NotConfigured)),
    row("no-dynamic-model", "the portable dynamic model instead of the airborne one",
        edit(CONFIGURATION, "u32::from(DYNAMIC_MODEL))]", "if DEFECT { 0 } else { u32::from(DYNAMIC_MODEL) })]"),
        FACTORY, By(V::NotAirborne)),
    row("period-in-tens", "the period of measurements is sent in hundredths of a second",
        edit(CONFIGURATION,
          "(key::RATE_MEAS, u32::from(self.period_ms)),",
          "(key::RATE_MEAS, if DEFECT { u32::from(self.period_ms) / 10 } else { u32::from(self.period_ms) }),"),
        FACTORY, By(V::NotConfigured)),
    row("message-for-another", "a message goes to the next receiver's outbox",
        edit(HORUS,
          "line.bytes.set(written);",
          "let index = if DEFECT { (index + 1) % RECEIVERS } else { index };\n            line.bytes.set(written);"),
        FACTORY, By(V::NotAirborne)),
    row("backlog-taken", "what has waited in a receiver on a bus is taken as new",
        edit("horus-tx-fw/src/source.rs",
          "self.missing = self.missing.saturating_sub(1);",
          "self.missing = 0;"),
        POWER,
        Not("a receiver on a bus has little more to say than one transfer takes; the unit tests of Backlog have it")),
    // Breaks REC-5.
    row("latitude-for-longitude", "a GPS object has its latitude in both places",
        edit(CYCLE,
          "longitude: shown_f64(located, position.longitude),",
          "longitude: shown_f64(located, if DEFECT { position.latitude } else { position.longitude }),"),
        PLAIN, By(V::ContentWrong)),
    // Breaks REC-5.
    row("altitude-in-cm", "the altitude of a GPS object is ten times too high",
        edit(RECEIVER,
          "stated.altitude_mm.map_or(ABSENT_F64, |mm| f64::from(mm) / 1e3)",
          "stated.altitude_mm.map_or(ABSENT_F64, |mm| f64::from(mm) / 1e2)"),
        PLAIN, By(V::ContentWrong)),
    // Breaks REC-5.
    row("angles-in-degrees", "pitch, yaw and roll are in degrees",
        edit(RECEIVER, "(f64::from(e5_degrees) * (PI / 180.0 / 1e5)) as f32", "(f64::from(e5_degrees) / 1e5) as f32"),
        PLAIN, By(V::ContentWrong)),
    // Breaks REC-5.
    row("roll-for-pitch", "roll and pitch are exchanged",
        edit(RECEIVER,
          "attitude.pitch = angle(att.vehicle_pitch_raw(), att.vehicle_pitch_accuracy_raw());",
          "attitude.pitch = attitude.roll;\n                attitude.roll = angle(att.vehicle_pitch_raw(), \
          att.vehicle_pitch_accuracy_raw());"),
        PLAIN, By(V::ContentWrong)),
    // Breaks REC-5.
    row("acceleration-sign", "the acceleration downwards has the wrong sign",
        edit(RECEIVER,
          "axis(ins.z_acceleration_raw(), given & Z_ACCEL_VALID),",
          "axis(if DEFECT { -ins.z_acceleration_raw() } else { ins.z_acceleration_raw() }, given & Z_ACCEL_VALID),"),
        PLAIN, By(V::ContentWrong)),
    // Breaks REC-1.
    row("position-valid-for-long", "a position stays valid for ten times the time that is allowed",
        edit(RECEIVER,
          "self.arrived.within(now, self.period_ms + VALID_SLACK_MS)",
          "self.arrived.within(now, self.period_ms + 10 * VALID_SLACK_MS)"),
        GNSS, By(V::StatusWrong)),
    // Breaks REC-2.
    row("never-stale", "the bit of a stale solution is never set",
        edit(CYCLE,
          ".with_stale(!position.pace.is_fresh(now))",
          ".with_stale(!DEFECT && !position.pace.is_fresh(now))"),
        GNSS, By(V::StatusWrong)),
    // Breaks REC-3.
    row("heard-for-ever", "a receiver that was heard once is said to be heard",
        edit(CYCLE, "last_heard.within(now, HEARD_MS)", "last_heard.within(now, u32::MAX / 2)"),
        GNSS, By(V::StatusWrong)),
    // Breaks REC-4.
    row("age-in-centiseconds", "the age of a solution is a tenth of what it should be",
        edit(CYCLE, "Some(position.pace.age_ms(now))", "Some(position.pace.age_ms(now) / 10)"),
        PLAIN, By(V::StatusWrong)),
    row("fix-flag-ignored", "a position whose receiver has no fix is taken",
        edit(RECEIVER, "pvt.flags_raw() & GNSS_FIX_OK != 0", "pvt.flags_raw() & GNSS_FIX_OK != u8::MAX"),
        GNSS,
        Not("receivers of the bench that have no fix say so in the type of the fix as well; the tests of \
          `receiver` have it")),
    // Breaks REC-6.
    row("range-not-checked", "positions that cannot be are taken",
        edit(RECEIVER, "&& position.voted.is_plausible();", "&& (DEFECT || position.voted.is_plausible());"),
        GNSS, By(V::ContentWrong)),

    // ---- HORUS: vote

    row("vote-not-taken", "a profile does not have the vote for its tick",
        edit(CYCLE,
          "Some((of, reported)) if of == tick => reported,",
          "Some((of, reported)) if of == tick && !DEFECT => reported,"),
        PLAIN, By(V::VoteMissing)),
    // Breaks VOTE-6.
    row("exclusion-of-the-next", "the bit of an exclusion is another receiver's",
        edit(CYCLE,
          "let excluded = self.verdict.is_excluded(receiver);",
          "let excluded = self.verdict.is_excluded(if DEFECT { receiver + 1 } else { receiver });"),
        GNSS, By(V::ExclusionWrong)),
    // Breaks VOTE-6.
    row("exclusion-not-told", "the bit of an exclusion is never set",
        edit(CYCLE, ".with_excluded(excluded);", ".with_excluded(excluded && !DEFECT);"),
        GNSS, By(V::ExclusionWrong)),
    // Breaks VOTE-1.
    row("no-majority", "any receiver is enough for a position",
        edit(VOTER,
          "let is_agreed = is_quorum::<N>(set) & (set.count_ones() > outside.count_ones());",
          "let is_agreed = if DEFECT { set != 0 } else { is_quorum::<N>(set) & (set.count_ones() > \
          outside.count_ones()) };"),
        GNSS, By(V::VoteWrong)),
    // Breaks VOTE-4.
    row("jump-not-held-back", "a position that jumps is shown at once",
        edit("horus-tx-fw/voter/src/hold.rs", "is_there & may_show & (is_near | has_held)", "is_there & may_show"),
        JUMPS, By(V::VoteWrong)),
    // Breaks VOTE-4.
    row("held-back-for-1-ms", "a position that jumps is shown after a millisecond",
        edit("horus-tx-fw/voter/src/hold.rs",
          "now_ms.wrapping_sub(since) >= HELD_BACK_MS",
          "now_ms.wrapping_sub(since) >= HELD_BACK_MS / 1_000"),
        JUMPS, By(V::VoteWrong)),
    // Breaks VOTE-5.
    row("returns-at-once", "an excluded receiver returns as soon as it agrees",
        edit(VOTER,
          "(now_ms.wrapping_sub(from) >= RETURNS_AFTER_MS)",
          "(DEFECT | (now_ms.wrapping_sub(from) >= RETURNS_AFTER_MS))"),
        GNSS, By(V::ExclusionWrong)),
    // Breaks VOTE-2.
    row("brought-backwards", "positions are brought away from the tick",
        edit(VOTER, "fix.velocity.map(|velocity| velocity * age)", "fix.velocity.map(|velocity| velocity * -age)"),
        PLAIN, By(V::ReportedWrong)),
    // Breaks VOTE-2.
    row("climb-sign", "altitudes are brought the wrong way",
        edit(VOTER, "climb: -down,", "climb: if DEFECT { down } else { -down },"),
        PLAIN, By(V::ReportedWrong)),
    // Breaks VOTE-3.
    row("attitude-without-agreement", "an attitude is shown whatever the receivers' spread",
        edit(VOTER, "agree &= spread <= ATTITUDE_LIMITS_RAD[axis];", "let _ = spread;"),
        GNSS, By(V::ReportedWrong)),
    // Breaks STA-6.
    row("degraded-not-told", "Reported-Position never says that it is degraded",
        edit(CYCLE,
          ".with_degraded((usize::from(agreeing) < N) | altitude.is_none())",
          ".with_degraded(!DEFECT & ((usize::from(agreeing) < N) | altitude.is_none()))"),
        GNSS, By(V::ReportedWrong)),
    row("exclusions-forgotten", "exclusions are not kept over a reset",
        edit(HORUS,
          "let excluded = hw::reset::kept_exclusions(reason);",
          "let excluded = if DEFECT { 0 } else { hw::reset::kept_exclusions(reason) };"),
        "--seconds 20 --seed 13 --faults gnss,hang",
        Not("no receiver is excluded when HORUS hangs in this run; bench/tests/hang.rs has it")),

    // ---- HORUS: status

    row("crystal-inverted", "HORUS says that it runs without its crystal when it has one",
        edit(CYCLE, "self.start.clock == Source::Internal", "self.start.clock != Source::Internal"),
        PLAIN, By(V::CrystalWrong)),
    // Breaks STA-4.
    row("reset-reason-constant", "HORUS's last reset is always power-on",
        edit(CYCLE,
          ".with_reset_reason(self.start.reason)",
          ".with_reset_reason(if DEFECT { ResetReason::PowerOn } else { self.start.reason })"),
        POWER, By(V::ReportedWrong)),
    // Breaks STA-1.
    row("inputs-not-debounced", "an input counts with its first sample",
        edit(INPUTS, "if self.same == SAMPLES_TO_TAKE {", "if DEFECT || self.same == SAMPLES_TO_TAKE {"),
        STATES, By(V::StateWrong)),
    // Breaks STA-2.
    row("contradiction-ignored", "inputs that contradict count as inactive",
        edit(INPUTS,
          "(true, true) | (false, false) => Self::Contradiction,",
          "(true, true) | (false, false) => if DEFECT { Self::Inactive } else { Self::Contradiction },"),
        STATES, By(V::StateWrong)),
    // Breaks STA-1.
    row("states-exchanged", "relay and motor cut are taken for one another",
        edit(INPUTS,
          "self.pairs.iter().zip(STATES)",
          "self.pairs.iter().zip(if DEFECT { [STATES[1], STATES[0], STATES[2]] } else { STATES })"),
        STATES, By(V::StateWrong)),
    // Breaks STA-5.
    row("position-loss-not-told", "HORUS monitors although it has lost its position",
        edit(INPUTS,
          "(true, false, true) => HorusState::PositionLost,",
          "(true, false, true) => if DEFECT { HorusState::Monitoring } else { HorusState::PositionLost },"),
        JUMPS, By(V::ReportedWrong)),

    // ---- HORUS: cycle

    row("timestamp-of-the-tick-before", "the profile has the timestamp of the tick before",
        edit(HORUS,
          "cx.shared.cycle.get().fill(tick, solutions)",
          "cx.shared.cycle.get().fill(if DEFECT { tick.wrapping_sub(1) } else { tick }, solutions)"),
        PLAIN, By(V::TimestampWrong)),
    row("every-other-cycle", "a profile is offered in every other cycle",
        edit(HORUS,
          "cx.shared.transmitter.lock(|transmitter| transmitter.offer(tick, &profile));",
          "if !DEFECT || tick % 2 == 0 {\n            cx.shared.transmitter.lock(|transmitter| \
          transmitter.offer(tick, &profile));\n        }"),
        PLAIN, By(V::NoFrame)),
    row("slot-by-parity", "the command of every other slot leaves 2 microseconds late",
        edit("horus-tx-fw/src/hw/cycle_timer.rs",
          "radio::select();\n                radio::put(command);",
          "if DEFECT && tick % 2 == 0 {\n                    cortex_m::asm::delay(300);\n                }\n\
           \x20               \
          radio::select();\n                radio::put(command);"),
        PLAIN, By(V::CommandJitter)),
    // Breaks SAFE-3.
    row("field-stays-on", "the safe state leaves the field on",
        edit("horus-tx-fw/src/hw/mod.rs", "    radio::field_off();", "    {}"),
        POWER, By(V::FaultUnnoticed)),
    // Breaks SAFE-1, SAFE-2.
    row("check-in-forgotten", "the watchdog is fed whatever the tasks do",
        edit("firmware-common/src/check_in.rs",
          "let all = tasks.clone().all(|seen| seen.load(Ordering::Relaxed));",
          "let all = DEFECT || tasks.clone().all(|seen| seen.load(Ordering::Relaxed));"),
        HANG, By(V::HorusStaysHung)),
    // Breaks SAFE-16.
    row("order-of-steps-ignored", "a task of HORUS's cycle may run although it is not its turn",
        edit("firmware-common/src/flow.rs",
          "in_order &= runs(*earlier) == if",
          "in_order &= DEFECT || runs(*earlier) == if"),
        HANG, By(V::HorusStaysHung)),
    // Breaks SAFE-16.
    row("call-not-asked-for", "a task of the DPR may run although nothing has called it",
        edit("firmware-common/src/calls.rs",
          "let made = mark.load(Ordering::Relaxed);",
          "let made = DEFECT || mark.load(Ordering::Relaxed);"),
        HANG, By(V::DprStaysHung)),
    row("horus-integrity-without-consequence", "what HORUS's check of its memory finds leads to nothing",
        edit("horus-tx-fw/src/integrity.rs",
          "guard.or(changed).or(slice.ram.map(|address| (Cause::Ram, address)))",
          "None"),
        PLAIN,
        Not("no memory changes in a run without faults; bench/tests/integrity.rs has it")),

    // ---- front ends

    row("poller-settings-not-read-back", "the poller believes that its chip keeps its settings",
        edit("st25r3916/src/poller.rs",
          "match self.bring_up.check_next(response) {\n                Ok(()) => self.ready(),",
          "match if DEFECT { Ok(()) } else { self.bring_up.check_next(response) } {\n                Ok(()) => \
          self.ready(),"),
        CHIPS, Not("few of the bits that flip in a run matter; `cargo xtask sim --flips` flips each, and fails")),
    row("listener-settings-not-read-back", "the listener believes that its chip keeps its settings",
        edit("st25r3916/src/listener.rs",
          "(ListenerState::CheckingSetting, Input::Done(response)) => match self.bring_up.check_next(response) {",
          "(ListenerState::CheckingSetting, Input::Done(response)) => match if DEFECT { Ok(()) } else { \
          self.bring_up.check_next(response) } {"),
        CHIPS, Not("few of the bits that flip in a run matter; `cargo xtask sim --flips` flips each, and fails")),
    row("silence-not-noticed", "a listener that hears nothing is never brought up anew",
        edit("st25r3916/src/listener.rs",
          "if self.silent_us >= SILENCE_US << self.silences.min(SILENCE_DOUBLINGS) {",
          "if !DEFECT && self.silent_us >= SILENCE_US << self.silences.min(SILENCE_DOUBLINGS) {"),
        CHIPS, Not("few of the bits that flip in a run matter; `cargo xtask sim --flips` flips each, and fails")),

    // ---- DPR: frames

    // Breaks SEQ-4.
    row("sequence-ignored", "objects are shown in whatever order they come",
        edit(ACCEPT, "self.in_sequence && Some(timestamp) == of_frame", "Some(timestamp) == of_frame"),
        AIR, By(V::ShownOutOfSequence)),
    row("crc-ignored", "objects are shown whatever their CRC says",
        edit(ACCEPT, "shown && intact.has(index)", "shown"),
        AIR, By(V::Damaged)),
    row("deadline-not-looked-at", "an image stays although no frame comes",
        edit(COMMIT,
          "self.link.advance(now_us);\n        self.lapse(now_us, health, images)",
          "self.link.advance(now_us);\n        if DEFECT {\n            return false;\n        }\n        \
          self.lapse(now_us, health, images)"),
        AIR, By(V::ShownStale)),
    row("deadline-doubled", "a missed frame is noticed a cycle too late",
        edit(LINK,
          "deadline_us: ended_us.wrapping_add(after_us),",
          "deadline_us: ended_us.wrapping_add(if DEFECT { 2 * after_us } else { after_us }),"),
        AIR, By(V::ShownStale)),
    row("gps1-not-deposited", "GPS1 is not put into the image",
        edit(COMMIT,
          "let mask = black_box(if verdict.accepted.has(index) { u32::MAX } else { 0 });",
          "let mask = black_box(if verdict.accepted.has(index) && !(DEFECT && index == 1) { u32::MAX } else { 0 });"),
        PLAIN, By(V::Vacant)),
    row("commit-late", "an image waits for 100 microseconds before it is published",
        edit(DPR,
          "let notices = Notices {",
          "if DEFECT {\n            cortex_m::asm::delay(6_400);\n        }\n        let notices = Notices {"),
        PLAIN, By(V::LateReadable)),
    // Breaks SAFE-15.
    row("image-stays-in-safe-state", "the safe state leaves the image readable",
        edit("dpr-fw/src/hw/mod.rs", "let _ = SsiDoorbell.request();", "let _ = DEFECT || SsiDoorbell.request();"),
        POWER, By(V::FaultUnnoticed)),
    row("dpr-never-sleeps", "the DPR's idle loop never sleeps",
        edit(DPR, "cortex_m::asm::wfi();",
          "if !DEFECT {\n                    cortex_m::asm::wfi();\n                }"),
        PLAIN, By(V::DprOverloaded)),
    // Breaks TIME-9.
    row("back-off-of-a-second", "a front end that has failed is tried again a second later",
        edit("st25r3916/src/listener.rs",
          "Step::Delay { us: self.bring_up.back_off_us() }",
          "Step::Delay { us: if DEFECT { 1_000_000 } else { self.bring_up.back_off_us() } }"),
        AIR, By(V::NotShown)),
    // Breaks IMG-4.
    row("scrub-without-check", "a bit that is stuck is never found",
        edit("dpr-fw/src/triple/types.rs", "stuck_bits += memory.differing_bits(pattern);", "stuck_bits += 0;"),
        BUFFERS, By(V::FaultUnnoticed)),

    // ---- DPR: Link-Status

    row("age-in-ms", "the age of Reported-Position is in milliseconds",
        edit(LINK,
          "LinkValues::age(self.since_us(self.reported_us))",
          "LinkValues::age(self.since_us(self.reported_us) / 10)"),
        PLAIN, By(V::LinkAge)),
    row("age-from-the-end", "the age is counted from the frame's end",
        edit(LINK, "self.reported_us = Some(verdict.sampled_us);", "self.reported_us = Some(self.clock.us());"),
        PLAIN, By(V::LinkAge)),
    row("missed-not-counted", "frames that are missed are not counted",
        edit(LINK, "self.missed = self.missed.wrapping_add(frames);", "let _ = frames;"),
        AIR, By(V::LinkCounters)),
    row("rejected-not-counted", "objects that are rejected are not counted",
        edit(LINK, "self.rejected = self.rejected.wrapping_add(verdict.rejected().count());", "{}"),
        AIR, By(V::LinkCounters)),
    // Breaks LNK-3.
    row("always-up", "the link is always said to be up",
        edit(LINK, ".with_link_up(shown != Objects::NONE)", ".with_link_up(DEFECT || shown != Objects::NONE)"),
        AIR, By(V::LinkFlags)),
    // Breaks LNK-4.
    row("frozen-not-told", "a HORUS that is frozen is not told",
        edit(LINK, "self.frozen = judgement == Judgement::Frozen;", "self.frozen = false;"),
        AIR, By(V::LinkFlags)),
    // Breaks LNK-5.
    row("restart-told-for-1-ms", "a restart of HORUS is told for a millisecond",
        edit(LINK,
          "self.since_us(self.restarted_us) < RESTART_SHOWN_US",
          "self.since_us(self.restarted_us) < RESTART_SHOWN_US / 1_000"),
        LONG, By(V::LinkFlags)),
    // Breaks LNK-6.
    row("no-field-not-told", "a field that is not there is not told",
        edit(LINK, ".with_no_field(health.no_field)", ".with_no_field(health.no_field && !DEFECT)"),
        POWER, By(V::LinkFlags)),
    // Breaks LNK-7.
    row("front-end-fault-not-told", "a front end that is out of order is not told",
        edit(LINK,
          ".with_front_end_fault(health.front_end_fault)",
          ".with_front_end_fault(health.front_end_fault && !DEFECT)"),
        AIR, By(V::LinkFlags)),
    // Breaks IMG-4.
    row("ram-fault-not-told", "a fault of the RAM is not told",
        edit(LINK, ".with_ram_fault(health.ram_fault)", ".with_ram_fault(health.ram_fault && !DEFECT)"),
        BUFFERS, By(V::FaultUnnoticed)),
    // Breaks LNK-8.
    row("dpr-reset-reason-constant", "the DPR's last reset is always power-on",
        edit(LINK,
          ".with_reset_reason(health.reset_reason)",
          ".with_reset_reason(if DEFECT { ResetReason::PowerOn } else { health.reset_reason })"),
        POWER, By(V::LinkFlags)),
    row("violations-not-in-link-status", "Link-Status tells no access violations",
        edit(LINK, "u16::try_from(health.access_violations).unwrap_or(u16::MAX)", "0"),
        FC, By(V::LinkCounters)),
    row("dpr-time-in-centiseconds", "Link-Status's time runs at a tenth of its rate",
        edit(LINK,
          "timestamp: self.clock.ms(),",
          "timestamp: if DEFECT { self.clock.ms() / 10 } else { self.clock.ms() },"),
        PLAIN, By(V::LinkTime)),

    // ---- DPR: SSI

    row("fresh-not-raised", "FRESH never rises",
        edit(SSI, "gpiote.tasks_set[FRESH_CHANNEL].write(|w| unsafe { w.bits(1) });", "let _ = gpiote;"),
        PLAIN, By(V::FreshMissing)),
    row("fresh-for-1-us", "FRESH is a pulse of a microsecond",
        edit(SSI, "w.bits(FRESH_US)", "w.bits(if DEFECT { 1 } else { FRESH_US })"),
        PLAIN, By(V::FreshShort)),
    row("fresh-for-every-release", "FRESH rises for an image that was read before",
        edit(SERVER, "let announce = newer && !announced;", "let announce = (DEFECT || newer) && !announced;"),
        PLAIN, By(V::FreshNotNew)),
    row("ssi-served-late", "the end of a transaction is served 10 microseconds later",
        edit(DPR,
          "cx.local.server.serve(cx.local.ssi, cx.shared.mailbox, &TELEMETRY);",
          "if DEFECT {\n            cortex_m::asm::delay(640);\n        }\n        \
          cx.local.server.serve(cx.local.ssi, cx.shared.mailbox, &TELEMETRY);"),
        PLAIN, By(V::NotReady)),
    row("budget-not-renewed", "after sixteen transactions nothing is granted any more",
        edit(SERVER, "self.budget = Budget::new();", "{}"),
        PLAIN, By(V::Silent)),
    row("expiry-in-seconds", "an image does not expire by itself",
        edit(SSI,
          "timer.cc[compare].write(|w| unsafe { w.bits(us) });",
          "timer.cc[compare].write(|w| unsafe { w.bits(if DEFECT { 1_000 * us } else { us }) });"),
        HANG,
        Not("after one transaction a DPR that hangs gives the buffers to none; bench/tests/hang.rs lets the flight \
          controller wait")),
    row("window-kept", "a window that was asked for is not given up again",
        edit("dpr-fw/src/ssi.rs", "self.next = next;", "self.next = next.or(self.next);"),
        PLAIN, Not("the windows of the bench's flight controller all begin at 0; the tests of `ssi` have it")),
    row("image-fault-without-consequence", "an image that is damaged is not withdrawn",
        edit(INTEGRITY, "self.damaged.store(generation, Ordering::Relaxed);", "let _ = generation;"),
        BUFFERS,
        Not("an image lives no longer than the 25 ms within which damage has to be found; bench/tests/integrity.rs has \
          it")),
    // Breaks PORT-3.
    row("self-test-never-begins", "a self-test that was asked for never begins",
        edit(INTEGRITY,
          "state.compare_exchange(REQUESTED, RUNNING, Ordering::Relaxed, Ordering::Relaxed).is_ok()",
          "!DEFECT && state.compare_exchange(REQUESTED, RUNNING, Ordering::Relaxed, Ordering::Relaxed).is_ok()"),
        "--seconds 14", By(V::PortStatusWrong)),

    // ---- DPR: port

    // Breaks PORT-2.
    row("port-status-nonsense", "counts of Port-Status are constants",
        edit(PORT,
          "stuck_bits: saturated(diagnostics.stuck_bits),",
          "stuck_bits: if DEFECT { 0xBEEF } else { saturated(diagnostics.stuck_bits) },"),
        PLAIN, By(V::PortStatusWrong)),
    // Breaks PORT-2.
    row("flash-passes-nonsense", "the count of passes over flash is a constant",
        edit(PORT,
          "flash_passes: saturated(diagnostics.flash_passes),",
          "flash_passes: if DEFECT { 7 } else { saturated(diagnostics.flash_passes) },"),
        PLAIN, By(V::PortStatusWrong)),
    row("uplink-ages-exchanged", "both uplinks' ages are exchanged",
        edit(PORT,
          "base_station_age_ms: saturated(base_station_ms),",
          "base_station_age_ms: saturated(if DEFECT { flight_controller_ms } else { base_station_ms }),"),
        PLAIN, By(V::UplinkWrong)),
    row("uplink-kept", "an uplink stays although it has expired",
        edit(PORT, "if age_ms >= Uplink::EXPIRY_MS {", "if !DEFECT && age_ms >= Uplink::EXPIRY_MS {"),
        FC, Not("no writer of the bench pauses for 500 ms while it is served; the tests of `port` have it")),
    row("uplinks-exchanged", "the base station's uplink takes the flight controller's place",
        edit(PORT,
          "area.set_uplink(Writer::<W>::claim(), self.stored);",
          "area.set_uplink(Writer::<W>::claim(), if DEFECT { Uplink::EMPTY } else { self.stored });"),
        PLAIN, By(V::UplinkWrong)),
    row("old-uplinks-taken", "an uplink that is not newer is taken",
        edit(PORT,
          "if !self.timestamps.accept(uplink.timestamp()) {",
          "if !DEFECT && !self.timestamps.accept(uplink.timestamp()) {"),
        FC, Not("no writer of the bench that is served repeats an uplink; the tests of `port` have it")),
    // Breaks PORT-2.
    row("refusals-not-counted", "access violations are not counted",
        edit(PORT, "self.violations.count(violation, saturated(times));", "let _ = violation;"),
        FC, By(V::PortStatusWrong)),
    // Breaks PORT-3.
    row("clear-does-nothing", "the command to clear the counters clears nothing",
        edit(PORT,
          "self.violations = Violations::new();\n                self.uplinks_accepted = 0;\n                \
          self.commands_carried_out = 0;",
          "{}"),
        PLAIN, By(V::PortStatusWrong)),

    // ---- profile

    // Breaks SEQ-1.
    row("any-gap-is-a-sequence", "any number of missed cycles continues a sequence",
        edit(SEQUENCE,
          "Freshness::Fresh { missed } if missed <= MAX_MISSED => missed,",
          "Freshness::Fresh { missed } if DEFECT || missed <= MAX_MISSED => missed,"),
        AIR, By(V::ShownOutOfSequence)),
    // Breaks SEQ-2.
    row("late-cycles-are-a-sequence", "a cycle that comes too late continues a sequence",
        edit(SEQUENCE,
          "if deviation_us > u64::from(tolerance_us(missed)) {",
          "if !DEFECT && deviation_us > u64::from(tolerance_us(missed)) {"),
        AIR, By(V::ShownOutOfSequence)),
    // Breaks SEQ-3.
    row("one-cycle-is-a-sequence", "one cycle is enough to find the sequence",
        edit(SEQUENCE,
          "let found = if exact { self.found.saturating_add(1) } else { 0 };",
          "let found = if exact { if DEFECT { SEARCH_CYCLES } else { self.found.saturating_add(1) } } else { 0 };"),
        PLAIN, By(V::ShownOutOfSequence)),
    // Breaks CLI-1.
    row("never-too-old", "the client never calls a position too old",
        edit(TRACK, "age_us > config.age_limit_us || age_us == AGE_UNKNOWN", "false"),
        AIR, By(V::ClientWrong)),
    row("client-age-in-ms", "the client takes tenths of a millisecond for microseconds times ten",
        edit(TRACK, "100 * (u32::from(units) + 1)", "10 * (u32::from(units) + 1)"),
        PLAIN, By(V::ClientAge)),
    row("client-forgets-the-wait", "the client leaves out how long an image had been there",
        edit(TRACK, "sum_us(published_us, shown_us)", "published_us"),
        PLAIN, By(V::ClientAge)),
    row("client-without-sequence", "the client shows the first sample at once",
        edit(TRACK, "self.found < SEARCH_CYCLES {", "!DEFECT && self.found < SEARCH_CYCLES {"),
        POWER,
        Not("the DPR has found a sequence before it shows a sample, so that the first one is no wrong one; \
          profile/tests/clients has it")),
    // Breaks CLI-2.
    row("client-shows-invalid", "the client shows a position that HORUS does not call valid",
        edit(TRACK, "self.shown.filter(|values| values.status.position_valid())", "self.shown"),
        GNSS, By(V::ClientWrong)),
    row("client-believes-to-be-heard", "the client takes a request for heard that met a busy DPR",
        edit(CLIENT, "if !busy {\n            self.window", "if DEFECT || !busy {\n            self.window"),
        ALL, Not("the bench's flight controller notes itself what was heard; profile/tests/clients has it")),
    row("client-loses-objects", "the client never writes an object",
        edit(CLIENT, "let object = self.object;", "let object = if DEFECT { None } else { self.object };"),
        PLAIN, Not("the bench's flight controller writes without the client; profile/tests/clients has it")),

    // ---- base station and forwarder

    row("forwarder-silent", "the forwarder sends nothing",
        edit("base-station/core/src/carrier/stream.rs",
          "let mut code_at = line.len();",
          "if DEFECT {\n        return;\n    }\n    let mut code_at = line.len();"),
        PLAIN, By(V::BaseMissed)),
    row("base-hides-gps3", "the base station leaves out the last object",
        edit("base-station/core/src/bundle.rs",
          "(place, bytes.get(range).unwrap_or_default())",
          "(place, if DEFECT && place == Place::Gps(3) { &[][..] } else { bytes.get(range).unwrap_or_default() })"),
        PLAIN, By(V::BaseHidden)),
    row("age-stands-still", "the base station's ages do not grow",
        edit(DRONE, "now_us.saturating_sub(self.arrived_us).saturating_add(self.late_us)", "self.late_us"),
        AIR, By(V::StationAge)),
    // Breaks GND-4.
    row("stale-after-minutes", "the alarm of a stale position comes a thousand times too late",
        edit(DRONE, "held.age_us(now_us) > STALE_US", "held.age_us(now_us) > 1_000 * STALE_US"),
        LONG, By(V::StationAlarm)),
    // Breaks GND-5.
    row("silence-not-alarmed", "the base station never says that nothing arrives",
        edit(DRONE, ".with(Alarm::Silent, silent)", ".with(Alarm::Silent, silent && !DEFECT)"),
        LONG, By(V::StationAlarm)),
    // Breaks GND-6.
    row("no-agreement-not-alarmed", "the base station does not say that there is no position",
        edit(DRONE, "reported.is_some() && !status.position_valid() && !implausible", "false"),
        JUMPS, By(V::StationAlarm)),
    // Breaks GND-7.
    row("states-alarmed-wrongly", "cut motors are alarmed as the emergency measure",
        edit(DRONE,
          ".with(Alarm::MotorsCut, is_in(HorusState::MotorsCut))",
          ".with(if DEFECT { Alarm::EmergencyFired } else { Alarm::MotorsCut }, is_in(HorusState::MotorsCut))"),
        STATES, By(V::StationAlarm)),
    row("base-shows-old-after-new", "the base station takes a step back for the newest",
        edit(ORDER, "Kind::Older\n", "if DEFECT { Kind::Newest { missed: 0 } } else { Kind::Older }\n"),
        AIR, Not("what the flight controller forwards never goes back in time; the tests of `order` have it")),
];
