//! Which of the cycles that reach the DPR's antenna it shows: the sequence (docs/design.md#sequence), seen from
//! outside.
//!
//! The judge cannot know everything that decides: whether a frame was received that came while the listener was being
//! armed, or on which side of a limit a step falls that is nearly at it. So it keeps *every*
//! state that a DPR which does right can be in (`State`), and lets each frame lead each state to all its successors.
//! What they all agree on [must](Certainty::Must) be, what none allows must [never](Certainty::Never) be, and nothing
//! is asked of the rest. While all is clear there is one state; after something unclear the states become one again
//! when the sequence has been found from all of them, which takes four cycles.
//!
//! This is written from the design and shares no code with `profile::sequence`, which the firmware runs.

use std::ops::Range;

use profile::air::CRC_BYTES;
use profile::{CYCLE_MS, Layout, air};

use crate::disturbance::Excuse;
use crate::{Board, Context, Event, What, bounds};

/// What can be said of something that the DPR decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Certainty {
    /// A DPR that does right does not.
    Never,
    /// It may or may not.
    May,
    /// A DPR that does right does.
    Must,
}

impl Certainty {
    /// What is said by all of `answers`, of which there is at least one.
    fn of(answers: impl IntoIterator<Item = bool>) -> Self {
        let (mut any, mut all) = (false, true);
        for answer in answers {
            any |= answer;
            all &= answer;
        }
        match (any, all) {
            (true, true) => Self::Must,
            (true, false) => Self::May,
            (false, _) => Self::Never,
        }
    }
}

/// A frame with a length of the profile that reached the antenna of a running DPR.
#[derive(Clone, Debug, PartialEq)]
pub struct Delivery {
    /// Its first preamble bit, ns.
    pub started: u64,
    /// The end of its last bit, ns.
    pub ended: u64,
    /// Its number in its cycle.
    pub number: usize,
    /// When the sample was taken that it carries, by the constants of the profile, ns.
    pub sampled: u64,
    /// The timestamp of its first valid object, ms.
    pub timestamp: Option<u32>,
    /// Whether the DPR received it: must or may.
    pub received: Certainty,
    /// Whether its cycle is in sequence, and it was received.
    pub shown: Certainty,
    /// Whether the DPR took it for a restart of HORUS: a step back.
    pub restarted: Certainty,
    /// Number, bytes and fate of its valid objects.
    pub objects: Vec<(usize, Vec<u8>, Certainty)>,
    /// How many places it has.
    pub places: u32,
}

impl Delivery {
    /// Whether it is the second frame of the cycle whose first is `first`, as far as its end and what is intact tell.
    #[must_use]
    pub fn completes(&self, first: &Self) -> bool {
        let same_cycle = self.timestamp.is_none_or(|timestamp| first.timestamp.is_none_or(|first| first == timestamp));
        let apart = self.sampled.abs_diff(first.sampled);
        (first.number, self.number) == (0, 1) && same_cycle && apart <= bounds::STEP_TOLERANCE
    }
}

/// What a cycle is to the cycles before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    First,
    Frozen,
    Back,
    Irregular,
    TooEarlyOrLate,
    Regular {
        /// By exactly one cycle, and as punctual as the search demands.
        exact: bool,
    },
}

/// A state that a DPR which does right can be in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct State {
    /// The last cycle: its timestamp, ms, and the instant of its sample, ns.
    last: Option<(u32, u64)>,
    /// How many cycles in a row have advanced as the search demands; with [`bounds::SEARCH_CYCLES`] it is found.
    found: u8,
    /// Which of the last cycle's frames have come: bit 0 the first.
    frames: u8,
    /// Whether the last cycle is shown.
    shown: bool,
    /// Whether the last cycle had the timestamp of the one before.
    frozen: bool,
}

impl State {
    const fn is_found(&self) -> bool {
        self.found >= bounds::SEARCH_CYCLES
    }

    /// The states that a cycle's frame may lead to, and whether it is a step back there.
    fn successors(self, timestamp: u32, sampled: u64, number: usize, mut to: impl FnMut(Self, bool)) {
        let frame = 1 << number;
        let (mut same, mut other) = (false, true);
        if let Some((last, at)) = self.last
            && last == timestamp
            && self.frames & frame == 0
        {
            let apart = sampled.abs_diff(at);
            same = apart <= bounds::STEP_TOLERANCE + bounds::SEQUENCE_BAND;
            other = apart >= bounds::STEP_TOLERANCE - bounds::SEQUENCE_BAND;
        }
        if same {
            to(Self { frames: self.frames | frame, ..self }, false);
        }
        if other {
            self.steps(timestamp, sampled, |step| {
                let found = match step {
                    Step::Regular { .. } if self.is_found() => self.found,
                    Step::Regular { exact: true } => self.found + 1,
                    _ => 0,
                };
                let next = Self { last: Some((timestamp, sampled)), found, frames: frame, ..Self::default() };
                to(Self { shown: next.is_found(), frozen: step == Step::Frozen, ..next }, step == Step::Back);
            });
        }
    }

    /// What the step to a cycle may be taken for.
    fn steps(&self, timestamp: u32, sampled: u64, mut to: impl FnMut(Step)) {
        let Some((last, at)) = self.last else { return to(Step::First) };
        let advance = timestamp.wrapping_sub(last);
        match advance {
            0 => return to(Step::Frozen),
            _ if advance > u32::MAX / 2 => return to(Step::Back),
            _ if !advance.is_multiple_of(CYCLE_MS) || advance / CYCLE_MS > bounds::MAX_MISSED + 1 => {
                return to(Step::Irregular);
            }
            _ => {}
        }
        let step = u64::from(advance) * 1_000_000;
        let late = i128::from(sampled) - i128::from(at) - i128::from(step);
        let deviation = u64::try_from(late.unsigned_abs()).unwrap_or(u64::MAX);
        let tolerance = bounds::STEP_TOLERANCE + step / bounds::STEP_TOLERANCE_SHARE;
        let band = bounds::SEQUENCE_BAND;
        if deviation >= tolerance - band {
            to(Step::TooEarlyOrLate);
        }
        if deviation > tolerance + band {
            return;
        }
        let next = advance == CYCLE_MS;
        let band = bounds::SEARCH_BAND;
        if next && deviation <= bounds::SEARCH_TOLERANCE + band {
            to(Step::Regular { exact: true });
        }
        if !next || deviation >= bounds::SEARCH_TOLERANCE - band {
            to(Step::Regular { exact: false });
        }
    }

    /// Until when a cycle can still continue the last one, `band` (ns) later than the design says; 0 if none can.
    fn held_until(&self, band: i64) -> u64 {
        let longest = u64::from(bounds::MAX_MISSED + 1) * bounds::CYCLE;
        let hold = longest + bounds::STEP_TOLERANCE + longest / bounds::STEP_TOLERANCE_SHARE;
        match self.last {
            Some((_, sampled)) if self.is_found() => (sampled + hold).saturating_add_signed(band),
            _ => 0,
        }
    }
}

/// A state in which nothing has come for so long, ns, is as good as one in which nothing ever came: what comes next
/// is not in sequence.
const FORGOTTEN: u64 = 300_000_000;

/// Everything that a DPR which does right can have made of what reached its antenna.
#[derive(Clone, Debug)]
pub struct Expectation {
    layout: Layout,
    /// Never empty.
    states: Vec<State>,
    /// Until when frames may escape the listener, since the carrier came, ns.
    armed: u64,
    /// The end of the last frame of whatever length, ns.
    last_end: Option<u64>,
    /// The end of the last whole frame that nothing kept the listener from hearing, ns.
    last_whole: u64,
    /// Between two whole frames so far apart that the DPR may have taken its front end for deaf, ns.
    silence: Range<u64>,
}

impl Expectation {
    /// At power-on.
    #[must_use]
    pub fn new(layout: Layout) -> Self {
        Self { layout, states: vec![State::default()], armed: 0, last_end: None, last_whole: 0, silence: 0..0 }
    }

    /// Takes the next event, and answers the frame if it is one that the DPR may have received.
    pub fn take(&mut self, event: &Event, context: &Context) -> Option<Delivery> {
        match &event.what {
            What::Power { board: Board::Dpr, .. } | What::Reset { board: Board::Dpr, .. } => {
                self.states = vec![State::default()];
            }
            What::FieldHeard { on } => {
                self.armed = if *on { event.at + bounds::ARMED } else { u64::MAX };
            }
            What::Heard { started, whole, bytes } => {
                // A listener may believe LEN rather than what arrives.
                let len = bytes.first().map(|len| usize::from(*len) + CRC_BYTES);
                let whole = *whole && len == Some(bytes.len());
                let gap = self.last_end.replace(event.at).is_none_or(|end| *started >= end + bounds::FRAME_GAP);
                // What a listener may not have heard ends no silence.
                if whole && !context.disturbances().excuse(Excuse::Hearing, *started) {
                    let silent_from = std::mem::replace(&mut self.last_whole, event.at) + bounds::SILENCE;
                    if event.at > silent_from {
                        self.silence = silent_from..event.at + bounds::SILENCE_OVER;
                        self.armed = self.armed.max(started + bounds::SILENCE_OVER);
                    }
                }
                return self.heard(event.at, *started, whole && gap, context);
            }
            _ => {}
        }
        None
    }

    fn heard(&mut self, ended: u64, started: u64, clear: bool, context: &Context) -> Option<Delivery> {
        let frame = context.frame()?;
        let number = frame.number?;
        let dpr = context.running(Board::Dpr);
        // While it hangs it hands nothing on: what has not reached an image by then reaches none.
        if !dpr.powered || dpr.hung.is_some() {
            return None;
        }
        let listening = started >= dpr.since + bounds::START && started >= self.armed;
        let hears = !context.disturbances().excuse(Excuse::Hearing, started);
        let received = if clear && listening && hears { Certainty::Must } else { Certainty::May };
        let sampled = ended.saturating_sub(age_at_end(self.layout, number));
        let timestamp = frame.timestamp();
        let (mut shown, mut restarted) = (Certainty::Never, Certainty::Never);
        if let Some(timestamp) = timestamp {
            (shown, restarted) = self.enter(timestamp, sampled, number, received, hears);
            shown = shown.min(received);
            restarted = restarted.min(received);
        }
        let objects = frame.objects.iter().filter_map(|placed| {
            let own = placed.timestamp()?;
            let fate = if Some(own) == timestamp { shown } else { Certainty::Never };
            Some((placed.index, placed.bytes.clone(), fate))
        });
        Some(Delivery {
            started,
            ended,
            number,
            sampled,
            timestamp,
            received,
            shown,
            restarted,
            objects: objects.collect(),
            places: u32::try_from(frame.objects.len()).unwrap_or(u32::MAX),
        })
    }

    /// A frame with a timestamp has come: whether its cycle is shown if it was received, and taken for a step back.
    fn enter(
        &mut self,
        timestamp: u32,
        sampled: u64,
        number: usize,
        received: Certainty,
        hears: bool,
    ) -> (Certainty, Certainty) {
        let before = std::mem::take(&mut self.states);
        let verdict = if hears {
            let mut back = vec![];
            for state in &before {
                state.successors(timestamp, sampled, number, |next, is_back| {
                    back.push(is_back);
                    if !self.states.contains(&next) {
                        self.states.push(next);
                    }
                });
            }
            (Certainty::of(self.states.iter().map(|state| state.shown)), Certainty::of(back))
        } else {
            let of = |found: u8| State {
                last: Some((timestamp, sampled)),
                found,
                frames: 1 << number,
                shown: found >= bounds::SEARCH_CYCLES,
                frozen: false,
            };
            self.states.extend((0..=bounds::SEARCH_CYCLES).map(of));
            // What it was held to be the same as may be what the DPR has not heard.
            self.states.push(State { frozen: true, ..of(0) });
            self.states.push(State::default());
            (Certainty::May, Certainty::May)
        };
        // It may have been missed.
        if received < Certainty::Must {
            for mut state in before {
                if state.last.is_some_and(|(_, at)| sampled.saturating_sub(at) > FORGOTTEN) {
                    state = State::default();
                }
                if !self.states.contains(&state) {
                    self.states.push(state);
                }
            }
        }
        verdict
    }

    /// Until when the sequence must be held and until when it may be, ns; 0 if it is not.
    #[must_use]
    pub fn held_until(&self) -> (u64, u64) {
        let band = i64::try_from(bounds::SEQUENCE_BAND).unwrap_or(i64::MAX);
        let must = self.states.iter().map(|state| state.held_until(-band)).min();
        let may = self.states.iter().map(|state| state.held_until(band)).max();
        (must.unwrap_or(0), may.unwrap_or(0))
    }

    /// Whether the last cycle had the timestamp of the one before it.
    #[must_use]
    pub fn frozen(&self) -> Certainty {
        Certainty::of(self.states.iter().map(|state| state.frozen))
    }

    /// Whether nothing had been heard for so long at `at` (ns) that the DPR may have taken its front end for deaf.
    #[must_use]
    pub fn is_silent(&self, at: u64) -> bool {
        at > self.last_whole + bounds::SILENCE || self.silence.contains(&at)
    }
}

/// The age of a cycle's sample at the last bit of its frame number `number`, ns.
#[must_use]
pub fn age_at_end(layout: Layout, number: usize) -> u64 {
    let us = match layout.receivers() {
        1 => air::age_at_end_us::<1>(number),
        2 => air::age_at_end_us::<2>(number),
        3 => air::age_at_end_us::<3>(number),
        _ => air::age_at_end_us::<5>(number),
    };
    1_000 * u64::from(us.unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::shown::synthetic::Run;

    #[test]
    fn however_many_frames_may_have_been_missed_the_states_stay_few() {
        let log = Run { cycles: 400, ..Run::new(3) }.log(|_| {});
        let (mut context, mut expectation) = (Context::new(&log.header), Expectation::new(Run::new(3).layout()));
        let mut most = 0;
        for mut event in log.events {
            if let What::Heard { whole, .. } = &mut event.what {
                *whole = false;
            }
            context.take(&event);
            expectation.take(&event, &context);
            most = most.max(expectation.states.len());
        }
        // A last cycle of each of the last 300 ms, with the sequence found or so far on the way to that.
        assert!((100..150).contains(&most), "{most}");
    }

    #[test]
    fn a_sample_is_as_old_at_the_last_bit_as_its_slot_and_its_frame_are_long() {
        // The slots of the table in `profile::air`, µs.
        for (receivers, slots) in [(1, vec![70]), (2, vec![80]), (3, vec![100]), (5, vec![120, 4_130])] {
            let layout = Layout::for_receivers(receivers).unwrap();
            for (number, slot) in slots.into_iter().enumerate() {
                let payload = u8::try_from(layout.frame(number).unwrap().length()).unwrap();
                let air = air::air_time_ns(payload).div_ceil(1_000);
                assert_eq!(age_at_end(layout, number), 1_000 * (slot + air), "{receivers} receivers, frame {number}");
            }
        }
    }

    const AT: u64 = 1_000_000_000;

    /// What the step from 1000 ms, sampled at [`AT`], may be taken for.
    fn steps(timestamp: u32, sampled: u64) -> Vec<Step> {
        let state = State { last: Some((1_000, AT)), ..State::default() };
        let mut steps = vec![];
        state.steps(timestamp, sampled, |step| steps.push(step));
        steps
    }

    const EXACT: Step = Step::Regular { exact: true };
    const INEXACT: Step = Step::Regular { exact: false };

    #[test]
    fn a_timestamp_advances_by_1_to_26_cycles_stands_still_or_goes_back() {
        let mut first = vec![];
        State::default().steps(1_000, AT, |step| first.push(step));
        assert_eq!(first, [Step::First]);
        let ms = |ms: u64| AT + ms * 1_000_000;
        for (timestamp, sampled, expected) in [
            (1_000, ms(10), Step::Frozen),
            (1_010, ms(10), EXACT),
            (1_020, ms(20), INEXACT),
            (1_260, ms(260), INEXACT),
            (1_270, ms(270), Step::Irregular),
            (1_005, ms(5), Step::Irregular),
            (990, ms(10), Step::Back),
            (999, ms(10), Step::Back),
            // Half of all timestamps are ahead.
            (1_000 + u32::MAX / 2, ms(10), Step::Irregular),
            (1_000 + u32::MAX / 2 + 1, ms(10), Step::Back),
        ] {
            assert_eq!(steps(timestamp, sampled), [expected], "{timestamp}");
        }
        // Across the end of all timestamps.
        let state = State { last: Some((u32::MAX - 5, AT)), ..State::default() };
        state.steps(4, ms(10), |step| assert_eq!(step, EXACT));
    }

    /// The limits are those of docs/design.md#sequence, and around each lies a band in which either is right.
    #[test]
    fn how_punctual_a_step_is_decides_what_it_may_be_taken_for() {
        let late = Step::TooEarlyOrLate;
        for (timestamp, off, expected) in [
            (1_010, 399_999, vec![EXACT]),
            (1_010, 400_000, vec![EXACT, INEXACT]),
            (1_010, 600_000, vec![EXACT, INEXACT]),
            (1_010, 600_001, vec![INEXACT]),
            // 2.5 ms and 2 % of 10 ms.
            (1_010, 2_399_999, vec![INEXACT]),
            (1_010, 2_400_000, vec![late, INEXACT]),
            (1_010, 3_000_000, vec![late, INEXACT]),
            (1_010, 3_000_001, vec![late]),
            // And of 260 ms.
            (1_260, 0, vec![INEXACT]),
            (1_260, 7_399_999, vec![INEXACT]),
            (1_260, 7_400_000, vec![late, INEXACT]),
            (1_260, 8_000_000, vec![late, INEXACT]),
            (1_260, 8_000_001, vec![late]),
        ] {
            let punctual = AT + u64::from(timestamp - 1_000) * 1_000_000;
            assert_eq!(steps(timestamp, punctual + off), expected, "{timestamp}, {off} ns late");
            assert_eq!(steps(timestamp, punctual - off), expected, "{timestamp}, {off} ns early");
        }
    }
}
