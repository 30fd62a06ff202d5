//! Determines which cycles the DPR shows by the rules of the sequence (docs/design.md#sequence), as seen from outside.
//!
//! The judge cannot observe everything on which the outcome depends, such as whether the listener received a frame
//! while it was being armed. It therefore keeps every state that a correct DPR can be in (`State`), and determines for
//! each frame which states may follow. The uncertainty ends after four cycles, when the sequence has been found in
//! every state.
//!
//! What a DPR does in every possible state, it [must](Certainty::Must) do. What it does in none of them, it must
//! [never](Certainty::Never) do.
//!
//! This module is written from the design and shares no code with `profile::sequence`, which the firmware runs.

use std::ops::Range;

use profile::air::CRC_BYTES;
use profile::{CYCLE_MS, Layout, air};

use crate::disturbance::Excuse;
use crate::{Board, Context, Event, What, bounds};

/// Whether a correct DPR takes a certain action.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Certainty {
    /// A correct DPR never takes the action.
    Never,
    /// A correct DPR may take the action or not.
    May,
    /// A correct DPR always takes the action.
    Must,
}

impl Certainty {
    /// Combines one answer per possible state: `Must` if all are yes, `Never` if all are no, else `May`.
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

/// A frame of one of the profile's lengths that reached the antenna of a running DPR.
#[derive(Clone, Debug, PartialEq)]
pub struct Delivery {
    /// The instant, ns, at which the frame's first preamble bit began.
    pub started: u64,
    /// The instant, ns, at which the frame's last bit ended.
    pub ended: u64,
    /// The frame's number in its cycle, from 0.
    pub number: usize,
    /// The instant, ns, at which the frame's sample was taken. It follows from the frame's end and the slots of the
    /// profile.
    pub sampled: u64,
    /// The timestamp of the frame's first valid object, ms.
    pub timestamp: Option<u32>,
    /// Whether the DPR received the frame.
    pub received: Certainty,
    /// Whether the DPR received the frame and its cycle is in sequence.
    pub shown: Certainty,
    /// Whether the DPR received the frame and detects a step back of its timestamp, by which it knows that HORUS has
    /// restarted.
    pub restarted: Certainty,
    /// The number of each valid object in the frame, its bytes, and whether the DPR shows it.
    pub objects: Vec<(usize, Vec<u8>, Certainty)>,
    /// The number of objects that a frame of this length holds.
    pub places: u32,
}

impl Delivery {
    /// Returns whether this frame is the second frame of the cycle that the frame `first` began.
    #[must_use]
    pub fn completes(&self, first: &Self) -> bool {
        let same_cycle = self.timestamp.is_none_or(|timestamp| first.timestamp.is_none_or(|first| first == timestamp));
        let apart = self.sampled.abs_diff(first.sampled);
        (first.number, self.number) == (0, 1) && same_cycle && apart <= bounds::STEP_TOLERANCE
    }
}

/// The relation of a cycle to the cycles before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    First,
    Frozen,
    Back,
    Irregular,
    TooEarlyOrLate,
    Regular {
        /// Whether the cycle comes one cycle after the last one, within the tolerance that the search for the sequence
        /// allows.
        exact: bool,
    },
}

/// A state that a correct DPR can be in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct State {
    /// The timestamp of the last cycle, ms, and the instant of its sample, ns.
    last: Option<(u32, u64)>,
    /// The number of consecutive cycles that fit the search. At [`bounds::SEARCH_CYCLES`] the sequence is found.
    found: u8,
    /// The frames of the last cycle that have arrived; bit 0 is the first frame.
    frames: u8,
    /// Whether the last cycle is shown.
    shown: bool,
    /// Whether the last cycle had the same timestamp as the cycle before it.
    frozen: bool,
}

impl State {
    const fn is_found(&self) -> bool {
        self.found >= bounds::SEARCH_CYCLES
    }

    /// Calls `to` with each state that may follow this one when a frame arrives. The second argument of `to` is whether
    /// the timestamp stepped back.
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

    /// Calls `to` with each judgement that a correct DPR may make of the step from its last cycle to this one.
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

    /// Returns the instant, ns, until which the next cycle can continue the sequence; 0 if no sequence is found.
    /// `band`, ns, is added to the design's limit.
    fn held_until(&self, band: i64) -> u64 {
        let longest = u64::from(bounds::MAX_MISSED + 1) * bounds::CYCLE;
        let hold = longest + bounds::STEP_TOLERANCE + longest / bounds::STEP_TOLERANCE_SHARE;
        match self.last {
            Some((_, sampled)) if self.is_found() => (sampled + hold).saturating_add_signed(band),
            _ => 0,
        }
    }
}

/// A cycle that is older than this, ns, no longer matters, because no later cycle can continue its sequence.
const FORGOTTEN: u64 = 300_000_000;

/// All states that a correct DPR can be in after the frames that have reached its antenna.
#[derive(Clone, Debug)]
pub struct Expectation {
    layout: Layout,
    /// The possible states of the DPR; there is always at least one.
    states: Vec<State>,
    /// The instant, ns, until which the listener may miss frames because its carrier has just returned.
    armed: u64,
    last_end: Option<u64>,
    /// The end, ns, of the last whole frame that the listener certainly could receive.
    last_whole: u64,
    /// The last period, ns, in which the DPR may have concluded from silence that its front end does not receive.
    silence: Range<u64>,
}

impl Expectation {
    /// Returns the states at power-on.
    #[must_use]
    pub fn new(layout: Layout) -> Self {
        Self { layout, states: vec![State::default()], armed: 0, last_end: None, last_whole: 0, silence: 0..0 }
    }

    /// Updates the states with the next event of the log. Returns the event's frame if the DPR may have received it.
    pub fn take(&mut self, event: &Event, context: &Context) -> Option<Delivery> {
        match &event.what {
            What::Power { board: Board::Dpr, .. } | What::Reset { board: Board::Dpr, .. } => {
                self.states = vec![State::default()];
            }
            What::FieldHeard { on } => {
                self.armed = if *on { event.at + bounds::ARMED } else { u64::MAX };
            }
            What::Heard { started, whole, bytes } => {
                // A listener may take a frame's length from LEN or from the bytes that arrive.
                let len = bytes.first().map(|len| usize::from(*len) + CRC_BYTES);
                let whole = *whole && len == Some(bytes.len());
                let gap = self.last_end.replace(event.at).is_none_or(|end| *started >= end + bounds::FRAME_GAP);
                // A frame that the listener may have missed does not prove that the silence is over.
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
        // A DPR that hangs or has no supply publishes nothing.
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

    /// Updates the states with a frame that has a timestamp. Returns whether the DPR shows the frame's cycle, and
    /// whether it detects a step back of the timestamp, if it received the frame.
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
            // The DPR may have received an earlier cycle with the same timestamp, so this cycle may count as frozen.
            self.states.push(State { frozen: true, ..of(0) });
            self.states.push(State::default());
            (Certainty::May, Certainty::May)
        };
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

    /// Returns two instants, ns. The DPR must hold the sequence until the first, and may hold it until the second. Both
    /// are 0 without a sequence.
    #[must_use]
    pub fn held_until(&self) -> (u64, u64) {
        let band = i64::try_from(bounds::SEQUENCE_BAND).unwrap_or(i64::MAX);
        let must = self.states.iter().map(|state| state.held_until(-band)).min();
        let may = self.states.iter().map(|state| state.held_until(band)).max();
        (must.unwrap_or(0), may.unwrap_or(0))
    }

    /// Returns whether the last cycle had the same timestamp as the cycle before it.
    #[must_use]
    pub fn frozen(&self) -> Certainty {
        Certainty::of(self.states.iter().map(|state| state.frozen))
    }

    /// Returns whether the DPR may have concluded by the instant `at`, ns, that its front end does not receive.
    #[must_use]
    pub fn is_silent(&self, at: u64) -> bool {
        at > self.last_whole + bounds::SILENCE || self.silence.contains(&at)
    }
}

/// Returns the age, ns, that a cycle's sample has when the cycle's frame `number` (from 0) ends.
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
        // The number of possible states stays small, because only the cycles of the last 300 ms count.
        assert!((100..150).contains(&most), "{most}");
    }

    #[test]
    fn a_samples_age_at_its_last_bit_is_slot_plus_air_time() {
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

    /// Returns the judgements that a correct DPR may make of the step from timestamp 1000 ms, sampled at [`AT`], to
    /// `timestamp`.
    fn steps(timestamp: u32, sampled: u64) -> Vec<Step> {
        let state = State { last: Some((1_000, AT)), ..State::default() };
        let mut steps = vec![];
        state.steps(timestamp, sampled, |step| steps.push(step));
        steps
    }

    const EXACT: Step = Step::Regular { exact: true };
    const INEXACT: Step = Step::Regular { exact: false };

    #[test]
    fn a_timestamp_step_of_1_to_26_cycles_is_regular() {
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
            // Timestamps wrap around, so half of all timestamps count as ahead of a given one, and the other half as
            // behind it.
            (1_000 + u32::MAX / 2, ms(10), Step::Irregular),
            (1_000 + u32::MAX / 2 + 1, ms(10), Step::Back),
        ] {
            assert_eq!(steps(timestamp, sampled), [expected], "{timestamp}");
        }
        // The timestamp wraps from its largest value to zero.
        let state = State { last: Some((u32::MAX - 5, AT)), ..State::default() };
        state.steps(4, ms(10), |step| assert_eq!(step, EXACT));
    }

    /// The limits are those of docs/design.md#sequence. Close to a limit the judge accepts either judgement.
    #[test]
    fn how_punctual_a_step_is_decides_what_it_may_be_taken_for() {
        let late = Step::TooEarlyOrLate;
        for (timestamp, off, expected) in [
            (1_010, 399_999, vec![EXACT]),
            (1_010, 400_000, vec![EXACT, INEXACT]),
            (1_010, 600_000, vec![EXACT, INEXACT]),
            (1_010, 600_001, vec![INEXACT]),
            // A step of 10 ms has a tolerance of 2.5 ms and 2 % of 10 ms.
            (1_010, 2_399_999, vec![INEXACT]),
            (1_010, 2_400_000, vec![late, INEXACT]),
            (1_010, 3_000_000, vec![late, INEXACT]),
            (1_010, 3_000_001, vec![late]),
            // A step of 260 ms has a tolerance of 2.5 ms and 2 % of 260 ms.
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
