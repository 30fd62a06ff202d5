//! Tracks which messages of one kind HORUS may have received, and how old they are.

use std::collections::VecDeque;

use gnss_sim::ubx::WEEK_MS;

use super::ubx::{Kind, MessageContent, Motion, STALE};
use crate::bounds;

/// The number of steps of the time of week from which HORUS determines a receiver's period. A step that spans a lost
/// message counts until this many newer steps have come.
const STEPS: usize = 4;
/// How long after a message's arrival, ns, HORUS may still find it in the bytes that it received.
pub(super) const FOUND_LATE: u64 = 200_000_000;
/// The greatest number of messages that are kept because each may be the newest that HORUS has processed.
const MOST_CANDIDATES: usize = 64;

/// The period of a receiver as HORUS determines it (docs/design.md#validity).
#[derive(Clone, Debug)]
struct Pace {
    time_of_week: Option<u32>,
    /// The last steps of the messages' time of week, ms.
    steps: VecDeque<u32>,
}

impl Pace {
    /// Returns the period that HORUS assumes before a receiver's first two messages: the longest allowed.
    fn new() -> Self {
        Self { time_of_week: None, steps: VecDeque::from([bounds::LONGEST_PERIOD_MS]) }
    }

    fn taken(&mut self, time_of_week: u32) {
        let Some(before) = self.time_of_week.replace(time_of_week) else { return };
        let step = (time_of_week % WEEK_MS + WEEK_MS - before % WEEK_MS) % WEEK_MS;
        // A step of the time of week counts only if it is forwards and not too short.
        if (bounds::SHORTEST_PERIOD_MS..WEEK_MS / 2).contains(&step) {
            if self.steps.len() == STEPS {
                self.steps.pop_front();
            }
            self.steps.push_back(step.min(bounds::LONGEST_PERIOD_MS));
        }
    }

    /// Records a message that HORUS may have missed. The period stays uncertain until [`STEPS`] further steps are
    /// certain.
    fn doubted(&mut self) {
        let any = [bounds::SHORTEST_PERIOD_MS, bounds::LONGEST_PERIOD_MS].repeat(STEPS / 2);
        *self = Self { time_of_week: None, steps: any.into() };
    }

    /// Returns the shortest and the longest possible period, ns.
    fn range(&self) -> (u64, u64) {
        let ns = |ms: Option<&u32>| u64::from(ms.copied().unwrap_or_default()) * 1_000_000;
        (ns(self.steps.iter().min()), ns(self.steps.iter().max()))
    }
}

/// A message that may be the last one that HORUS has taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Candidate {
    said: MessageContent,
    time_of_week: u32,
    /// The earliest and the latest instant, ns, at which the content may have been new. A message that repeats a time
    /// of week is as old as the first message with that time of week.
    born: (u64, u64),
    /// The earliest and the latest instant, ns, at which HORUS may have received the message.
    arrived: (u64, u64),
}

/// The range of ages, ns, that a message or a position may have by HORUS's clock.
#[derive(Clone, Copy, Debug)]
pub(super) struct Age {
    pub(super) least: u64,
    pub(super) most: u64,
}

impl Age {
    /// Returns the age at `tick` of a message that arrived between the two instants `born`. HORUS counts whole
    /// milliseconds, and without its crystal its clock may be off by 2 %.
    pub(super) fn at(tick: u64, born: (u64, u64)) -> Self {
        let (least, most) = (tick.saturating_sub(born.1 + bounds::MESSAGE_TAKEN), tick.saturating_sub(born.0));
        let off = |age: u64| age / (bounds::CYCLE / bounds::TICK_TOLERANCE) + 1_000_000;
        Self { least: least.saturating_sub(off(least)), most: most + off(most) }
    }

    pub(super) fn later(self, by: u64) -> Self {
        Self { least: self.least + by, most: self.most + by }
    }

    /// Returns whether the age may be within a limit, and whether it may exceed the limit. The limit lies between
    /// `least` and `most`, ns.
    pub(super) fn within(self, least: u64, most: u64) -> [bool; 2] {
        [self.least <= most, self.most > least]
    }
}

/// A message whose position a GPS object shows at a certain tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    pub(super) motion: Motion,
    pub(super) age: Age,
    /// The time, ns, from the message's time of week to the tick, modulo a week. The judge's clock has an arbitrary
    /// zero, so only differences between receivers count.
    pub(super) since_epoch: i64,
}

pub(super) const WEEK: i64 = WEEK_MS as i64 * 1_000_000;

impl Held {
    pub(super) fn later(self, by: u64) -> Self {
        Self { age: self.age.later(by), since_epoch: (self.since_epoch + by as i64) % WEEK, ..self }
    }
}

/// Whether a GPS object agrees with the messages that it may show.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Agreement {
    pub(super) both: bool,
    pub(super) values: bool,
    pub(super) status: bool,
    /// Whether the values are those in a message, even if the message marks them as invalid.
    pub(super) raw: bool,
}

#[derive(Clone, Debug)]
pub(super) struct Track {
    kind: Kind,
    candidates: Vec<Candidate>,
    /// Whether HORUS may hold no message of the receiver that is young enough to count.
    none: bool,
    pace: Pace,
}

impl Track {
    pub(super) fn new(kind: Kind) -> Self {
        Self { kind, candidates: vec![], none: true, pace: Pace::new() }
    }

    pub(super) fn clear(&mut self) {
        self.candidates.clear();
        self.none = true;
        self.pace = Pace::new();
    }

    pub(super) fn taken(&mut self, time_of_week: u32, said: MessageContent, arrived: u64) {
        let born = self.born(time_of_week, (arrived, arrived));
        self.candidates.clear();
        self.candidates.push(Candidate { said, time_of_week, born, arrived: (arrived, arrived) });
        self.none = false;
        self.pace.taken(time_of_week);
    }

    /// Records a message that HORUS may have missed, or may find later than usual.
    pub(super) fn doubted(&mut self, time_of_week: u32, said: MessageContent, arrived: u64) {
        self.possible(time_of_week, said, (arrived, arrived + FOUND_LATE));
        self.pace.doubted();
    }

    /// Records a message that HORUS may have found by now. The message does not yet count for the period.
    pub(super) fn arriving(&mut self, time_of_week: u32, said: MessageContent, arrived: u64) {
        self.possible(time_of_week, said, (arrived, arrived));
    }

    fn possible(&mut self, time_of_week: u32, said: MessageContent, arrived: (u64, u64)) {
        let born = self.born(time_of_week, arrived);
        let same = |candidate: &&mut Candidate| candidate.said == said && candidate.time_of_week == time_of_week;
        if let Some(same) = self.candidates.iter_mut().find(same) {
            same.born = (same.born.0.min(born.0), same.born.1.max(born.1));
            same.arrived = (same.arrived.0.min(arrived.0), same.arrived.1.max(arrived.1));
            return;
        }
        if self.candidates.len() == MOST_CANDIDATES {
            self.candidates.remove(0);
            self.none = true;
        }
        self.candidates.push(Candidate { said, time_of_week, born, arrived });
    }

    /// Returns the earliest and the latest instant, ns, at which the content of a message was new.
    fn born(&self, time_of_week: u32, arrived: (u64, u64)) -> (u64, u64) {
        let others = self.none || self.candidates.iter().any(|candidate| candidate.time_of_week != time_of_week);
        let same = self.candidates.iter().filter(|candidate| candidate.time_of_week == time_of_week);
        same.map(|candidate| candidate.born)
            .chain(others.then_some(arrived))
            .reduce(|one, other| (one.0.min(other.0), one.1.max(other.1)))
            .unwrap_or(arrived)
    }

    /// Returns the latest instant, ns, at which HORUS's newest message can have arrived; 0 without a message.
    pub(super) fn newest(&self) -> u64 {
        self.candidates.iter().map(|candidate| candidate.arrived.1).max().unwrap_or(0)
    }

    /// Returns, for each message with these values, the motion and the age of the position at `tick`.
    pub(super) fn held(&self, tick: u64, values: [u64; 3]) -> impl Iterator<Item = Held> {
        let shows = move |candidate: &&Candidate| candidate.said.motion.is_some() && candidate.said.values == values;
        self.candidates.iter().filter(shows).filter_map(move |Candidate { said, time_of_week, born, arrived }| {
            Some(Held {
                motion: said.motion?,
                age: Age::at(tick, (born.0.min(arrived.0), born.1.max(arrived.1))),
                since_epoch: (tick as i64 % WEEK - i64::from(time_of_week % WEEK_MS) * 1_000_000).rem_euclid(WEEK),
            })
        })
    }

    /// Returns whether the position in a GPS object of `tick` certainly stays valid until the next tick.
    pub(super) fn lasts(&self, tick: u64, values: [u64; 3]) -> bool {
        let (least, most) = self.pace.range();
        let slack = bounds::VALID_BEYOND_PERIOD;
        let shows = |candidate: &&Candidate| candidate.said.values == values;
        self.candidates.iter().filter(shows).all(|candidate| {
            let [_, may_be_outdated] =
                Age::at(tick + bounds::CYCLE, candidate.born).within(least + slack, most + slack);
            !may_be_outdated
        })
    }

    /// Returns whether a GPS object of `tick` may state `code` as the age of its solution. If HORUS's ticks are
    /// irregular (`timed` is false), any age is right.
    pub(super) fn may_tell_age(&self, tick: u64, timed: bool, code: u64) -> bool {
        let is_of = |candidate: &Candidate| {
            let age = Age::at(tick, candidate.born);
            let told = |age: u64| (age / bounds::AGE_STEP).min(bounds::AGE_OLDEST);
            code < bounds::AGE_NEVER && (!timed || (told(age.least)..=told(age.most)).contains(&code))
        };
        (self.none && code == bounds::AGE_NEVER) || self.candidates.iter().any(is_of)
    }

    /// Compares a GPS object of `tick` with the messages that it may show. If HORUS's ticks are irregular (`timed` is
    /// false), the messages may have any age.
    pub(super) fn agreement(&self, tick: u64, timed: bool, status: u16, values: [u64; 3]) -> Agreement {
        let status = status & self.kind.mask();
        let mut agreement = Agreement::default();
        let mut allow = |said: &MessageContent, current: bool, stale: bool| {
            let nothing = MessageContent::nothing(self.kind);
            let shown = if current { said } else { &nothing };
            let stale = if stale && self.kind == Kind::Position { STALE } else { 0 };
            let bits = stale | shown.status;
            agreement.values |= shown.values == values;
            agreement.status |= bits == status;
            agreement.both |= shown.values == values && bits == status;
            agreement.raw |= said.raw == values;
        };
        if self.none {
            allow(&MessageContent::nothing(self.kind), false, true);
        }
        let (least, most) = self.pace.range();
        for candidate in &self.candidates {
            let age = Age::at(tick, candidate.born);
            let within = |slack: u64| if timed { age.within(least + slack, most + slack) } else { [true; 2] };
            let [current, outdated] = within(bounds::VALID_BEYOND_PERIOD);
            let [fresh, stale] = within(bounds::STALE_BEYOND_PERIOD);
            for (is_current, _) in [(true, current), (false, outdated)].into_iter().filter(|(_, may)| *may) {
                for (is_stale, _) in [(false, fresh), (true, stale)].into_iter().filter(|(_, may)| *may) {
                    allow(&candidate.said, is_current, is_stale);
                }
            }
        }
        agreement
    }
}
