//! What of one kind of message HORUS may have taken, and how old it is.

use std::collections::VecDeque;

use gnss_sim::ubx::WEEK_MS;

use super::ubx::{Kind, Motion, STALE, Said};
use crate::bounds;

/// A receiver's period is between the shortest and the longest of so many steps of its time of week: one message that
/// is lost, and one that comes too soon, change no period for good.
const STEPS: usize = 4;
/// Of a message that HORUS may have found late: by how much at most, ns.
pub(super) const FOUND_LATE: u64 = 200_000_000;
/// More messages that may have been taken are not told apart.
const MOST_CANDIDATES: usize = 64;

/// The period of a receiver's messages, as it keeps it (docs/design.md#validity).
#[derive(Clone, Debug)]
struct Pace {
    time_of_week: Option<u32>,
    /// The last steps from a message to the next, ms.
    steps: VecDeque<u32>,
}

impl Pace {
    /// Before its first two messages a receiver counts as one with the longest period.
    fn new() -> Self {
        Self { time_of_week: None, steps: VecDeque::from([bounds::LONGEST_PERIOD_MS]) }
    }

    /// A message that HORUS has taken.
    fn taken(&mut self, time_of_week: u32) {
        let Some(before) = self.time_of_week.replace(time_of_week) else { return };
        let step = (time_of_week % WEEK_MS + WEEK_MS - before % WEEK_MS) % WEEK_MS;
        // A repeated time of week, one that comes too soon, and a step back tell nothing of the period.
        if (bounds::SHORTEST_PERIOD_MS..WEEK_MS / 2).contains(&step) {
            if self.steps.len() == STEPS {
                self.steps.pop_front();
            }
            self.steps.push_back(step.min(bounds::LONGEST_PERIOD_MS));
        }
    }

    /// A message that HORUS may have taken: until as many steps are certain as count, the period may be any.
    fn doubted(&mut self) {
        let any = [bounds::SHORTEST_PERIOD_MS, bounds::LONGEST_PERIOD_MS].repeat(STEPS / 2);
        *self = Self { time_of_week: None, steps: any.into() };
    }

    /// The least and the greatest that the period can be, ns.
    fn range(&self) -> (u64, u64) {
        let ns = |ms: Option<&u32>| u64::from(ms.copied().unwrap_or_default()) * 1_000_000;
        (ns(self.steps.iter().min()), ns(self.steps.iter().max()))
    }
}

/// A message that may be the last that HORUS has taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Candidate {
    said: Said,
    time_of_week: u32,
    /// Between these instants it began to be new, ns: what repeats a time of week is as old as the first with that.
    born: (u64, u64),
    /// Between these instants it had arrived itself, ns.
    arrived: (u64, u64),
}

/// How old something can be by HORUS's clock, ns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Age {
    pub(super) least: u64,
    pub(super) most: u64,
}

impl Age {
    /// The age at `tick` of what arrived between the two instants of `born`. HORUS's clock may be off by 2 % without
    /// its crystal, counts whole milliseconds, and begins when HORUS takes the message.
    pub(super) fn at(tick: u64, born: (u64, u64)) -> Self {
        let (least, most) = (tick.saturating_sub(born.1 + bounds::MESSAGE_TAKEN), tick.saturating_sub(born.0));
        let off = |age: u64| age / (bounds::CYCLE / bounds::TICK_TOLERANCE) + 1_000_000;
        Self { least: least.saturating_sub(off(least)), most: most + off(most) }
    }

    /// The age so much later, ns.
    pub(super) fn later(self, by: u64) -> Self {
        Self { least: self.least + by, most: self.most + by }
    }

    /// Whether it may be within a limit that is itself from `least` to `most`, and whether it may be beyond it.
    pub(super) fn within(self, least: u64, most: u64) -> [bool; 2] {
        [self.least <= most, self.most > least]
    }
}

/// A message whose position a GPS object shows, at a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    pub(super) motion: Motion,
    /// From its arrival to the tick.
    pub(super) age: Age,
    /// From its time of week to the tick, modulo a week, ns: the judge's clock began anywhere, so only differences
    /// between receivers count.
    pub(super) since_epoch: i64,
}

/// A week, ns.
pub(super) const WEEK: i64 = WEEK_MS as i64 * 1_000_000;

impl Held {
    /// The same at a tick so much later, ns.
    pub(super) fn later(self, by: u64) -> Self {
        Self { age: self.age.later(by), since_epoch: (self.since_epoch + by as i64) % WEEK, ..self }
    }
}

/// What agrees of an object's values and status bits with what they may be.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Agreement {
    /// Values and status bits.
    pub(super) both: bool,
    /// The values, perhaps with other status bits.
    pub(super) values: bool,
    /// The status bits, perhaps with other values.
    pub(super) status: bool,
    /// The values are those of a message, valid or not.
    pub(super) raw: bool,
}

/// What of one kind of message HORUS may have taken.
#[derive(Clone, Debug)]
pub(super) struct Track {
    kind: Kind,
    candidates: Vec<Candidate>,
    /// It may have taken none, or none for so long that it makes no difference.
    none: bool,
    pace: Pace,
}

impl Track {
    pub(super) fn new(kind: Kind) -> Self {
        Self { kind, candidates: vec![], none: true, pace: Pace::new() }
    }

    /// HORUS has forgotten everything.
    pub(super) fn clear(&mut self) {
        self.candidates.clear();
        self.none = true;
        self.pace = Pace::new();
    }

    /// A message that HORUS has taken, since it arrived long enough ago.
    pub(super) fn taken(&mut self, time_of_week: u32, said: Said, arrived: u64) {
        let born = self.born(time_of_week, (arrived, arrived));
        self.candidates.clear();
        self.candidates.push(Candidate { said, time_of_week, born, arrived: (arrived, arrived) });
        self.none = false;
        self.pace.taken(time_of_week);
    }

    /// A message that HORUS may have taken, and will not take any more.
    pub(super) fn doubted(&mut self, time_of_week: u32, said: Said, arrived: u64) {
        self.possible(time_of_week, said, (arrived, arrived + FOUND_LATE));
        self.pace.doubted();
    }

    /// A message that HORUS may have taken by now; it teaches no period until it is certain what became of it.
    pub(super) fn arriving(&mut self, time_of_week: u32, said: Said, arrived: u64) {
        self.possible(time_of_week, said, (arrived, arrived));
    }

    fn possible(&mut self, time_of_week: u32, said: Said, arrived: (u64, u64)) {
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

    /// Since when a message is new that arrived between the two instants of `arrived`.
    fn born(&self, time_of_week: u32, arrived: (u64, u64)) -> (u64, u64) {
        let others = self.none || self.candidates.iter().any(|candidate| candidate.time_of_week != time_of_week);
        let same = self.candidates.iter().filter(|candidate| candidate.time_of_week == time_of_week);
        same.map(|candidate| candidate.born)
            .chain(others.then_some(arrived))
            .reduce(|one, other| (one.0.min(other.0), one.1.max(other.1)))
            .unwrap_or(arrived)
    }

    /// When the newest message may have arrived that HORUS may have taken, ns; 0 for none.
    pub(super) fn newest(&self) -> u64 {
        self.candidates.iter().map(|candidate| candidate.arrived.1).max().unwrap_or(0)
    }

    /// How the position that a GPS object of `tick` shows may move, and how old it may be: of each message that shows
    /// these values. HORUS may count the age of a message that repeats a time of week from either.
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

    /// Whether the position that a GPS object of `tick` shows is still valid at the next tick for sure, if nothing
    /// newer comes.
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

    /// Whether a GPS object of `tick` may tell the age of its solution by `code`. Unless HORUS's ticks were regular
    /// (`timed`), nothing is known but whether there was a solution.
    pub(super) fn may_tell_age(&self, tick: u64, timed: bool, code: u64) -> bool {
        let is_of = |candidate: &Candidate| {
            let age = Age::at(tick, candidate.born);
            let told = |age: u64| (age / bounds::AGE_STEP).min(bounds::AGE_OLDEST);
            code < bounds::AGE_NEVER && (!timed || (told(age.least)..=told(age.most)).contains(&code))
        };
        (self.none && code == bounds::AGE_NEVER) || self.candidates.iter().any(is_of)
    }

    /// Holds the values and the status of a GPS object of `tick` against what they may be. Unless HORUS's ticks were
    /// regular (`timed`), nothing is known of ages.
    pub(super) fn agreement(&self, tick: u64, timed: bool, status: u16, values: [u64; 3]) -> Agreement {
        let status = status & self.kind.mask();
        let mut agreement = Agreement::default();
        let mut allow = |said: &Said, current: bool, stale: bool| {
            let nothing = Said::nothing(self.kind);
            let shown = if current { said } else { &nothing };
            let stale = if stale && self.kind == Kind::Position { STALE } else { 0 };
            let bits = stale | shown.status;
            agreement.values |= shown.values == values;
            agreement.status |= bits == status;
            agreement.both |= shown.values == values && bits == status;
            agreement.raw |= said.raw == values;
        };
        if self.none {
            allow(&Said::nothing(self.kind), false, true);
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
