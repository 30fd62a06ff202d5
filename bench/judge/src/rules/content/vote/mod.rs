//! Judges whether Reported-Position and the excluded receivers follow from the receivers' messages.
//!
//! This module is written from decision 15 alone and takes nothing from the voter that HORUS runs.
//!
//! # How it is judged
//!
//! HORUS votes for a tick in the cycle before it. A vote can use what each receiver's GPS object shows in this cycle,
//! or showed in the previous cycle. A receiver whose position may be in the vote is a candidate. A receiver that is
//! excluded in both cycles is not eligible for the result.
//!
//! Position, velocity and accuracy come from the messages, and their ages are known within the limits of `track::Age`.
//! For each two receivers the judge determines whether they agree, disagree, or may do either ([`places`]).
//!
//! HORUS votes a result from some of the eligible receivers, its members. HORUS states only how many members there are.
//! So the judge tries every set of that size, and reports a violation only if none fits.
//!
//! | violation | when |
//! |---|---|
//! | `VoteWrong` | a result has fewer than M members or no majority, its members disagree, or a larger set agrees |
//! | `VoteWrong` | a place or an altitude jumps, and is shown before it has lasted for a second ([`jumps`]) |
//! | `VoteMissing` | there is no result, though a majority of the eligible, at least M, agree, and it does not jump |
//! | `ExclusionWrong` | a receiver is excluded, or is not, against the rules below |
//! | `ReportedWrong` | the values are not the members' medians, or a status bit or an invalid value is wrong |
//!
//! A receiver must not become excluded in any of these cases:
//!
//! - It has no position.
//! - The vote has no result.
//! - The receiver agrees with a member of the result.
//!
//! An excluded receiver must stay excluded until it has agreed with all members of the result for a second. It must
//! return when it has agreed for more than 1.1 s. A receiver that agrees with no member must become excluded. If a
//! quorum of the members has an altitude, a receiver with an altitude must agree with one of these members.
//!
//! After a restart of HORUS that leaves RAM as it was, an excluded receiver must stay excluded, unless it could be
//! readmitted before the restart. A receiver that agreed with all others may be excluded only after a new message of
//! its own, or new messages of a quorum.
//!
//! Altitude, attitude and acceleration are each voted from the receivers that state one. At least M (the quorum)
//! receivers must state it, and all of them must agree.
//!
//! At most one violation is reported for a cycle. M, the quorum, is 1, 1, 2, 3 for 1, 2, 3, 5 receivers.
//!
//! # What is not judged
//!
//! - Exclusions are not judged in the cycle after a missing or wrong object, because the receivers excluded before are
//!   not known.
//! - Positions and agreement are not judged while it is not known which message HORUS uses. This is so while HORUS's
//!   ticks are irregular, or if an object fits no message that HORUS may have used.
//! - HORUS's choice between several sets of the same size is not judged.
//! - The status bit about HORUS's clock.
//!
//! Injected faults excuse nothing in this rule: HORUS applies decision 15 to whatever messages it has.

mod jumps;
mod places;

use std::f64::consts::PI;

use gnss_sim::Geodetic;
use profile::{ABSENT_F32, ABSENT_F64, GpsValues, HorusState, MAX_RECEIVERS, ReportedValues};

use super::track::Held;
use crate::{Violation, bounds};
use jumps::{Course, Found, Level, Mark, Spot};
use places::{Place, Range, Relation, median, median_of, spread};

/// A set of receivers as bits; bit 0 is GPS1.
type Set = u8;

#[derive(Clone, Debug)]
pub(super) struct Seen {
    pub(super) values: GpsValues,
    pub(super) held: Vec<Held>,
    /// Whether the position certainly stays valid until the next tick without a newer message.
    pub(super) lasts: bool,
    /// Whether the receiver sent messages so quickly that the vote may have used values that no object shows.
    pub(super) hurried: bool,
}

/// The last ticks at which an excluded receiver did not agree with the result of the vote.
#[derive(Clone, Copy, Debug, Default)]
struct Returning {
    /// The last tick, ns, at which the receiver may have disagreed, or may not have been a candidate.
    may_not: u64,
    /// The last tick, ns, at which the receiver certainly disagreed or was no candidate.
    did_not: Option<u64>,
}

/// The judge's knowledge of HORUS's votes so far, with which it judges the next cycle.
#[derive(Clone, Debug)]
pub(super) struct Vote {
    receivers: usize,
    /// The last cycle that the judge has seen: its number, from HORUS's start, and the receivers excluded in it.
    last: (u64, Set),
    /// The GPS objects of the last cycle that the judge has seen.
    earlier: Vec<Seen>,
    returning: [Returning; MAX_RECEIVERS],
    /// The receivers that must be excluded in HORUS's first cycle, and those that may be; `None` after that cycle.
    restarted: Option<(Set, Set)>,
    /// The receivers that the vote after the last seen cycle may have excluded.
    doubtful: Set,
    /// The tick, ns, of the last cycle that the judge has seen.
    pub(super) last_tick: u64,
    /// Whether the vote has certainly had a result since HORUS's start.
    located: bool,
    /// Whether the vote may have had a result since HORUS's start.
    may_be_located: bool,
    places: Course<Spot>,
    altitudes: Course<Level>,
    /// Whether HORUS has certainly accepted a reading of each of its inputs.
    inputs_known: bool,
}

/// Whether a start of HORUS finds in RAM which receivers were excluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ram {
    /// RAM kept its content, because the supply stayed on.
    Kept,
    /// RAM may have kept its content: the supply was off, and the log does not say how low the voltage went.
    MayBeKept,
    /// RAM lost its content. A power-on counts as such a loss, because HORUS must not use the content after it.
    Lost,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Judged {
    pub(super) wrong: Option<(Violation, String)>,
    /// For each receiver, its horizontal and vertical distance, m, from the farthest receiver in the vote.
    pub(super) away: [Option<(f64, Option<f64>)>; MAX_RECEIVERS],
}

/// The GPS objects of a cycle, and what follows from them for the vote.
struct Cycle<'a> {
    seen: &'a [Seen],
    /// The GPS objects of the cycle before this one.
    earlier: &'a [Seen],
    places: Vec<Place>,
    relations: [[Relation; MAX_RECEIVERS]; MAX_RECEIVERS],
    sure: Set,
    may: Set,
    high: Set,
    may_be_high: Set,
    /// The receivers excluded in this cycle.
    now: Set,
    /// The receivers excluded in the cycle before.
    before: Set,
    /// The quorum: the number of receivers that have to agree for a result.
    least: usize,
}

impl Cycle<'_> {
    fn related(&self, receiver: usize, others: Set, relation: Relation) -> Set {
        each(others & !bit(receiver))
            .filter(|other| self.relations[receiver][*other] == relation)
            .fold(0, |set, other| set | bit(other))
    }

    fn agrees_with_all(&self, receiver: usize, others: Set) -> bool {
        let others = others & !bit(receiver);
        self.related(receiver, others, Relation::Agree) == others
    }

    /// Returns the largest subset of these receivers in which every two receivers certainly agree.
    fn largest(&self, of: Set) -> Set {
        let sets = (0..1 << self.seen.len()).filter(|set: &Set| set & !of == 0);
        let agree = |set: &Set| each(*set).all(|receiver| self.agrees_with_all(receiver, *set));
        sets.filter(agree).max_by_key(|set| set.count_ones()).unwrap_or(0)
    }

    /// Returns the receivers that are certainly eligible for the result, and those that may be.
    fn eligible(&self) -> (Set, Set) {
        (self.sure & !(self.now & self.before), self.may & !(self.now & self.before))
    }

    /// Returns the members of a result with which `receiver` has to agree, as two sets: the certain ones, and the
    /// possible ones. If the receiver and a quorum have an altitude, only members with an altitude count.
    fn peers(&self, receiver: usize, members: Set) -> (Set, Set) {
        let (own, quorum) = (bit(receiver), |set: Set| count(members & set) >= self.least);
        if self.may_be_high & own == 0 || !quorum(self.may_be_high) {
            (members, members)
        } else if self.high & own != 0 && quorum(self.high) {
            (members & self.high, members & self.may_be_high)
        } else {
            (members & self.high, members)
        }
    }

    /// Returns the voted place and altitude, even if HORUS holds them back.
    fn found(&self) -> (Found<Spot>, Found<Level>) {
        let (eligible, may_vote) = self.eligible();
        let largest = self.largest(eligible);
        let sure = count(largest) >= self.least && count(largest) > count(may_vote & !largest);
        let least = self.least.max(count(largest));
        let is_result = |set: &Set| {
            count(*set) >= least
                && count(*set) > count(eligible & !set)
                && each(*set).all(|one| self.related(one, *set, Relation::Disagree) == 0)
        };
        let sets: Vec<Set> =
            (0..1 << self.seen.len()).filter(|set: &Set| set & !may_vote == 0).filter(is_result).collect();
        let with = |of: Set| move |set: &&Set| count(**set & of) >= self.least;
        let place = Found { sure, may: !sets.is_empty(), mark: all(sets.iter().map(|set| self.spot(*set))) };
        let altitude = Found {
            sure: sure && sets.iter().all(|set| with(self.high)(&set)),
            may: sets.iter().any(|set| with(self.may_be_high)(&set)),
            mark: all(sets.iter().filter(with(self.may_be_high)).map(|set| self.level(*set))),
        };
        (place, altitude)
    }

    fn accuracy(&self, members: Set, axis: usize) -> Option<Range> {
        let of: Option<Vec<_>> = each(members).map(|member| Some(self.places[member].accuracy()?[axis])).collect();
        of?.into_iter().reduce(|one, its| Range { least: one.least.max(its.least), most: one.most.max(its.most) })
    }

    fn spot(&self, members: Set) -> Option<Spot> {
        let origin = &self.places[each(members).next()?];
        let there: Option<Vec<_>> = each(members).map(|member| self.places[member].north_east(origin)).collect();
        let there = there?;
        let axis = |axis: usize| median(&there.iter().map(|place| place[axis]).collect::<Vec<_>>());
        let (north, east) = (axis(0)?, axis(1)?);
        let within = libm::hypot(north.most - north.least, east.most - east.least) / 2.0;
        Some(Spot { at: origin.beside([north.middle(), east.middle()])?, within, accuracy: self.accuracy(members, 0)? })
    }

    /// Returns the altitude that these members vote for; `None` if it is not known which of them have an altitude.
    fn level(&self, members: Set) -> Option<Level> {
        let high = members & self.high;
        let of: Option<Vec<_>> = each(high).map(|member| self.places[member].altitude().0).collect();
        (high == members & self.may_be_high)
            .then_some(Level { height: median(&of?)?, accuracy: self.accuracy(high, 1)? })
    }
}

/// Returns a range that covers all these places or altitudes; `None` if one of them is not known.
fn all<T: Mark>(marks: impl Iterator<Item = Option<T>>) -> Option<T> {
    marks.collect::<Option<Vec<_>>>()?.into_iter().reduce(Mark::or)
}

impl Vote {
    pub(super) fn new(receivers: usize) -> Self {
        Self {
            receivers,
            last: (0, 0),
            earlier: vec![],
            returning: Default::default(),
            restarted: None,
            doubtful: 0,
            last_tick: 0,
            located: false,
            may_be_located: false,
            places: Course::new(),
            altitudes: Course::new(),
            inputs_known: false,
        }
    }

    /// Resets the state at a start of HORUS after `ticks` ticks. `ram` says whether HORUS may still know which
    /// receivers were excluded.
    ///
    /// Before the restart HORUS may have voted up to three times without sending the result. A receiver that agreed
    /// with all others becomes excluded in these votes only if messages of that receiver, or of a quorum, are among
    /// those `heard`.
    pub(super) fn restart(&mut self, ram: Ram, ticks: u64, heard: Set) {
        let all = (0..self.receivers).fold(0, |set, receiver| set | bit(receiver));
        let restarted = match self.restarted {
            // There was no cycle to judge between HORUS's previous start and this one.
            Some((must, may)) => (must, if ticks == 0 { may } else { all }),
            None if ticks > self.last.0 + 1 => (0, all),
            None => {
                let votes = 3 * bounds::CYCLE;
                let stays = |receiver: &usize| {
                    let did_not = self.returning[*receiver].did_not;
                    did_not.is_some_and(|at| self.last_tick + votes - at < bounds::NOT_RETURNED)
                };
                let must = each(self.last.1).filter(stays).fold(0, |set, receiver| set | bit(receiver));
                let is_quorum = count(heard) >= bounds::quorum(self.receivers);
                (must, if is_quorum { all } else { self.last.1 | self.doubtful | heard })
            }
        };
        let restarted = match ram {
            Ram::Kept => Some(restarted),
            Ram::MayBeKept => Some((0, restarted.1)),
            Ram::Lost => None,
        };
        *self = Self { restarted, ..Self::new(self.receivers) };
    }

    /// Returns, in words, which exclusion is wrong in cycle `number`, the first cycle that the judge has seen since a
    /// start.
    fn after_restart(&self, (must, may): (Set, Set), excluded: Set, number: u64) -> Option<String> {
        if must & !excluded != 0 && number * bounds::CYCLE < bounds::NOT_RETURNED {
            return Some(format!("{} not excluded after a restart, and was before it", names(must & !excluded)));
        }
        (number == 1 && excluded & !may != 0)
            .then(|| format!("{} excluded after a restart, and was not before it", names(excluded & !may)))
    }

    /// Returns whether the cycle before `number` (from 1) is the last one that the judge has seen.
    pub(super) fn follows(&self, number: u64) -> bool {
        self.last.0 + 1 == number
    }

    /// Judges Reported-Position in cycle `number`, counted from HORUS's start. The caller has found that the GPS
    /// objects of this cycle are right.
    pub(super) fn cycle(
        &mut self,
        tick: u64,
        number: u64,
        inputs_known: bool,
        reported: &ReportedValues,
        seen: &[Seen],
    ) -> Judged {
        self.inputs_known = inputs_known;
        let excluded = set(seen, |seen| seen.values.status.excluded());
        let restarted = self.restarted.take();
        let follows = self.follows(number);
        let before = if follows && restarted.is_none() { self.last.1 } else { excluded };
        let earlier = std::mem::replace(&mut self.earlier, seen.to_vec());
        let cycle = Cycle::new(seen, if follows { &earlier } else { &[] }, before);
        self.may_be_located |= !follows;
        let found = cycle.found();
        self.places.advance(tick, &found.0);
        self.altitudes.advance(tick, &found.1);
        let result = reported.status.position_valid();
        let mut judged = Judged { wrong: None, away: cycle.away() };
        let mut members = vec![];
        if follows {
            let vote = self.vote(tick, reported, &cycle, &found, &mut members);
            let exclusion = self.exclusion(tick, result, &cycle).map(|what| (Violation::ExclusionWrong, what));
            judged.wrong = exclusion.or(vote);
        }
        if let Some(what) = restarted.and_then(|restarted| self.after_restart(restarted, excluded, number)) {
            judged.wrong = Some((Violation::ExclusionWrong, what));
        }
        self.remember(tick, follows, result, &cycle, &members);
        if !follows || result && judged.wrong.is_some() {
            self.places.lose();
            self.altitudes.lose();
        } else if result {
            let (spot, level) = shown(reported, &members, &cycle);
            self.places.show(tick, spot);
            if let Some(level) = level {
                self.altitudes.show(tick, level);
            }
        }
        self.last = (number, excluded);
        let others = cycle.may & !excluded;
        self.doubtful =
            each(others).filter(|one| !cycle.agrees_with_all(*one, others)).fold(0, |set, one| set | bit(one));
        self.last_tick = tick;
        self.located |= result;
        judged
    }

    /// Records whether each receiver may return from exclusion. To return, it has to agree with all members of the
    /// result or, without a result, with one eligible receiver.
    fn remember(&mut self, tick: u64, follows: bool, result: bool, cycle: &Cycle, members: &[Set]) {
        let may_vote = cycle.may & !(cycle.now & cycle.before);
        let eligible = cycle.sure & !(cycle.now & cycle.before);
        for (receiver, returning) in self.returning.iter_mut().enumerate().take(self.receivers) {
            let (own, was) = (bit(receiver), cycle.before & bit(receiver) != 0);
            let disagrees = |set: &Set| cycle.related(receiver, *set, Relation::Disagree);
            let others = may_vote & !own;
            let (disagreed, agreed) = if result {
                let disagreed = !members.is_empty() && members.iter().all(|set| disagrees(set) != 0);
                (disagreed, cycle.agrees_with_all(receiver, others))
            } else {
                let agreed = others == 0 || cycle.related(receiver, eligible, Relation::Agree) != 0;
                (eligible & !own != 0 && disagrees(&others) == others, agreed)
            };
            let did_not = cycle.may & own == 0 || disagreed || follows && !was;
            if did_not {
                returning.did_not = Some(tick);
            }
            if did_not || !follows || cycle.sure & own == 0 || !agreed {
                returning.may_not = tick;
            }
        }
    }

    /// Returns, in words, an exclusion that is wrong for every possible set of members.
    fn exclusion(&self, tick: u64, result: bool, cycle: &Cycle) -> Option<String> {
        let Cycle { sure, may, now, before, .. } = *cycle;
        let others = may & !(now & before);
        (0..self.receivers).find_map(|receiver| {
            let own = bit(receiver);
            let name = format!("GPS{}", receiver + 1);
            let ms = |ns: u64| format!("{:.0} ms", ns as f64 / 1e6);
            let Returning { may_not, did_not } = self.returning[receiver];
            match (before & own != 0, now & own != 0) {
                (false, true) if may & own == 0 => Some(format!("{name} is excluded, and has no valid position")),
                (false, true) if !result => Some(format!("{name} is excluded, and there is no result")),
                (true, false) if did_not.is_some_and(|at| tick - at < bounds::NOT_RETURNED) => {
                    let since = tick - did_not.unwrap_or(tick);
                    Some(format!("{name} is no longer excluded, {} after it was no candidate or disagreed", ms(since)))
                }
                (true, true)
                    if sure & own != 0
                        && tick - may_not > bounds::RETURNED
                        && cycle.agrees_with_all(receiver, others) =>
                {
                    Some(format!("{name} is still excluded, and has agreed with all others for {}", ms(tick - may_not)))
                }
                _ => None,
            }
        })
    }

    /// Returns, in words, why the stated result is wrong, or why HORUS should have stated a result. Adds to `members`
    /// every set of receivers from which HORUS may have voted the result.
    fn vote(
        &self,
        tick: u64,
        reported: &ReportedValues,
        cycle: &Cycle,
        found: &(Found<Spot>, Found<Level>),
        members: &mut Vec<Set>,
    ) -> Option<(Violation, String)> {
        let Cycle { may, now, before, least, .. } = *cycle;
        let agreeing = usize::from(reported.status.receivers_agreeing());
        let wrong = |what: String| Some((Violation::ReportedWrong, what));
        let (eligible, _) = cycle.eligible();
        // Only `Starting`, `Monitoring` and `PositionLost` follow from the vote. Rule `inputs` judges every other
        // state.
        let is_located = reported.status.position_valid();
        let was_located = self.located || self.may_be_located;
        let wrong_state = match reported.status.state() {
            Some(HorusState::Starting) => (is_located || self.located) && self.inputs_known,
            Some(HorusState::Monitoring) => !is_located,
            Some(HorusState::PositionLost) => is_located || !was_located,
            _ => false,
        };
        let largest = cycle.largest(eligible);
        if !reported.status.position_valid() {
            if self.places.must_be_shown(tick, &found.0) {
                return Some((Violation::VoteMissing, format!("there is no result, and {} agree", names(largest))));
            }
            return absent(reported, wrong_state).and_then(wrong);
        }
        let bad = |what: String| Some((Violation::VoteWrong, what));
        let excluded = |what: String| Some((Violation::ExclusionWrong, what));
        let can = may & !now;
        members.extend((0..1 << self.receivers).filter(|set: &Set| set & !can == 0 && count(*set) == agreeing));
        if members.is_empty() {
            return wrong(format!("it claims {agreeing} receivers that agree, and {} may have a vote", count(can)));
        }
        members.retain(|set| count(*set) >= least && count(*set) > count(eligible & !set));
        if members.is_empty() {
            return bad(format!(
                "a result of {agreeing}, where {least} have to agree and {} are eligible",
                names(eligible)
            ));
        }
        members.retain(|set| each(*set).all(|one| cycle.related(one, *set, Relation::Disagree) == 0));
        if members.is_empty() {
            return bad(format!("a result of {agreeing}, and so many of {} do not agree", names(can)));
        }
        let anew = now & !before;
        members.retain(|set| each(anew).all(|one| cycle.related(one, cycle.peers(one, *set).0, Relation::Agree) == 0));
        if members.is_empty() {
            return excluded(format!("{} are excluded, and agree with some that are not", names(anew)));
        }
        if count(largest) > agreeing {
            return bad(format!("a result of {agreeing}, while {} agree", names(largest)));
        }
        let spared = eligible & !now;
        let is_alone = |one: usize, of: Set| cycle.related(one, of, Relation::Disagree) == of;
        members.retain(|set| each(spared & !set).all(|one| !is_alone(one, cycle.peers(one, *set).1)));
        if members.is_empty() {
            return excluded(format!("of {} not all are excluded that agree with no member", names(spared)));
        }
        if wrong_state {
            return wrong(format!("HORUS's state is {:?}", reported.status.state()));
        }
        let altitude = reported.altitude;
        if reported.status.degraded() != (agreeing < self.receivers || altitude.is_nan()) {
            let degraded = reported.status.degraded();
            return wrong(format!("degraded is {degraded}, with {agreeing} receivers that agree on {altitude} m"));
        }
        if altitude.is_nan() && self.altitudes.must_be_shown(tick, &found.1) {
            return wrong("it has no altitude, and a quorum agrees on one".to_owned());
        }
        for judge in [position, motion] {
            let mut what = None;
            members.retain(|set| {
                let found = judge(reported, *set, cycle);
                let right = found.is_none();
                what = found.or(what.take());
                right
            });
            if members.is_empty() {
                return what.and_then(wrong);
            }
        }
        let (spot, level) = shown(reported, members, cycle);
        let place = self.places.shown_too_soon(tick, &spot).map(|what| format!("the place {what}"));
        let height = || self.altitudes.shown_too_soon(tick, &level?).map(|what| format!("the altitude {what}"));
        place.or_else(height).and_then(bad)
    }
}

/// Returns the voted place and altitude that Reported-Position shows, if one of these sets of receivers may have voted
/// for them.
fn shown(reported: &ReportedValues, members: &[Set], cycle: &Cycle) -> (Spot, Option<Level>) {
    let ReportedValues { latitude, longitude, altitude, .. } = *reported;
    let accuracy = |axis: usize, of: Set| {
        let any = Range::of(0.0, f64::INFINITY);
        let known: Option<Vec<_>> = members.iter().map(|set| cycle.accuracy(set & of, axis)).collect();
        known.and_then(|known| known.into_iter().reduce(Range::hull)).unwrap_or(any)
    };
    let spot = Spot { at: Geodetic { latitude, longitude, height: 0.0 }, within: 0.0, accuracy: accuracy(0, Set::MAX) };
    let is_known = cycle.high == cycle.may_be_high;
    let high = if is_known { cycle.high } else { 0 };
    let level = Level { height: Range::of(altitude, altitude), accuracy: accuracy(1, high) };
    (spot, (!altitude.is_nan()).then_some(level))
}

impl<'a> Cycle<'a> {
    fn new(seen: &'a [Seen], earlier: &'a [Seen], before: Set) -> Self {
        let mut places = vec![Place::default(); seen.len()];
        for (receiver, place) in places.iter_mut().enumerate() {
            let own = |seen: &'a [Seen]| seen.get(receiver).filter(|seen| seen.values.status.position_valid());
            let (was, is) = (own(earlier), own(seen));
            let shown =
                |seen: &Seen| [seen.values.latitude, seen.values.longitude, seen.values.altitude].map(f64::to_bits);
            let known = |seen: &Seen| !seen.hurried;
            if let Some(was) = was.filter(|was| is.is_none_or(|is| shown(is) != shown(was))) {
                let held = was.held.iter().map(|held| held.later(bounds::CYCLE)).filter(|_| known(was));
                place.add(was.values.latitude, was.values.longitude, was.values.altitude, held);
            }
            if let Some(is) = is {
                let older = was.into_iter().filter(|was| shown(was) == shown(is)).flat_map(|was| &was.held);
                let held = is.held.iter().copied().chain(older.map(|held| held.later(bounds::CYCLE)));
                place.add(is.values.latitude, is.values.longitude, is.values.altitude, held.filter(|_| known(is)));
            }
        }
        let valid = |seen: &[Seen]| set(seen, |seen| seen.values.status.position_valid());
        let now = set(seen, |seen| seen.values.status.excluded());
        let (was, is) = (valid(earlier), valid(seen));
        // The vote used a position of this cycle or of the cycle before, each brought forward to the tick.
        let position = |seen: &Seen| [seen.values.latitude, seen.values.longitude, seen.values.altitude];
        let same = |(was, is): (&Seen, &Seen)| position(was).map(f64::to_bits) == position(is).map(f64::to_bits);
        let had = |pair: (&Seen, &Seen)| pair.0.lasts || same(pair);
        let lasting = earlier.iter().zip(seen).enumerate().filter(|(_, pair)| had(*pair));
        let lasting = lasting.fold(0, |set, (receiver, _)| set | bit(receiver));
        let (sure, may) = (was & is & lasting, was | is);
        places::bring(&mut places, sure, may);
        let mut relations = [[Relation::Doubtful; MAX_RECEIVERS]; MAX_RECEIVERS];
        for (one, place) in places.iter().enumerate() {
            for (other, its) in places.iter().enumerate().skip(one + 1) {
                let relation = place.relation(its);
                (relations[one][other], relations[other][one]) = (relation, relation);
            }
        }
        let with = |which: usize| {
            places.iter().enumerate().fold(
                0,
                |set, (receiver, place)| {
                    if place.has_altitude()[which] { set | bit(receiver) } else { set }
                },
            )
        };
        let (high, may_be_high) = (with(0), with(1));
        let least = bounds::quorum(seen.len());
        Self { seen, earlier, places, relations, sure, may, high, may_be_high, now, before, least }
    }

    /// Returns for each excluded receiver its distance from the farthest receiver in the vote.
    fn away(&self) -> [Option<(f64, Option<f64>)>; MAX_RECEIVERS] {
        let mut away = [None; MAX_RECEIVERS];
        for receiver in each(self.now & self.may) {
            let others = each(self.may & !self.now).filter_map(|other| {
                let (along, height) = self.places[receiver].apart(&self.places[other])?;
                Some((along.middle(), height.map(Range::middle)))
            });
            away[receiver] = others.max_by(|(one, _), (other, _)| one.total_cmp(other));
        }
        away
    }
}

/// Returns, in words, the error in a Reported-Position that has no valid position.
fn absent(reported: &ReportedValues, wrong_state: bool) -> Option<String> {
    let ReportedValues { status, latitude, longitude, altitude, pitch, yaw, roll, acceleration: [x, y, z], .. } =
        *reported;
    let there = |valid: bool, what: &str| {
        Some(format!("there is no result, and it {}", if valid { what } else { "has values" }))
    };
    if status.receivers_agreeing() != 0 {
        return there(true, "claims receivers that agree");
    }
    if [latitude, longitude, altitude].iter().any(|value| value.to_bits() != ABSENT_F64.to_bits()) {
        return there(false, "");
    }
    if status.attitude_valid() || status.acceleration_valid() {
        return there(true, "has a valid attitude or acceleration");
    }
    if [pitch, yaw, roll, x, y, z].iter().any(|value| value.to_bits() != ABSENT_F32.to_bits()) {
        return there(false, "");
    }
    if !status.degraded() {
        return there(true, "is not degraded");
    }
    wrong_state.then(|| format!("there is no result, and HORUS's state is {:?}", status.state()))
}

/// Returns, in words, the error in latitude, longitude or altitude.
fn position(reported: &ReportedValues, members: Set, cycle: &Cycle) -> Option<String> {
    let ReportedValues { latitude, longitude, altitude, .. } = *reported;
    if !(-90.0..=90.0).contains(&latitude) || !(-180.0..=180.0).contains(&longitude) {
        return Some(format!("it is at {latitude}, {longitude}"));
    }
    let places: Vec<&Place> = each(members).map(|member| &cycle.places[member]).collect();
    let origin = *places.first()?;
    if places.iter().any(|place| !place.is_known()) {
        return None;
    }
    let outside = |name: &str, value: f64, of: &[Range]| {
        let median = median(of)?;
        let off = bounds::ARITHMETIC_M + bounds::GEODESY_SHARE * spread(of);
        let inside = (median.least - off..=median.most + off).contains(&value);
        let by = if value < median.least { value - median.least } else { value - median.most };
        (!inside).then(|| format!("its {name} is {by:.3} m off the median of {}", names(members)))
    };
    let shown = origin.plane_of(latitude, longitude)?;
    let there: Vec<_> = places.iter().filter_map(|place| place.north_east(origin)).collect();
    for (axis, name) in ["latitude", "longitude"].into_iter().enumerate() {
        let along: Vec<_> = there.iter().map(|place| place[axis]).collect();
        if let Some(what) = outside(name, shown[axis], &along) {
            return Some(what);
        }
    }
    if altitude.is_nan() {
        let is_absent = altitude.to_bits() == ABSENT_F64.to_bits();
        return (!is_absent).then(|| format!("its altitude is {:#x}", altitude.to_bits()));
    }
    let high = members & cycle.may_be_high;
    if count(high) < cycle.least {
        return Some(format!("its altitude is {altitude}, and of the members only {} have one", names(high)));
    }
    if places.iter().any(|place| place.altitude().1) {
        return None;
    }
    let high: Vec<_> = places.iter().filter_map(|place| place.altitude().0).collect();
    outside("altitude", altitude, &high)
}

/// Returns, in words, the error in attitude or acceleration, each voted from values of this cycle or of the cycle
/// before.
fn motion(reported: &ReportedValues, members: Set, cycle: &Cycle) -> Option<String> {
    if each(members).any(|member| cycle.seen[member].hurried || cycle.earlier[member].hurried) {
        return None;
    }
    let status = reported.status;
    let attitude: Part = |values| (values.status.attitude_valid(), [values.pitch, values.yaw, values.roll]);
    let acceleration: Part = |values| (values.status.acceleration_valid(), values.acceleration);
    let (angles, axes) = ([reported.pitch, reported.yaw, reported.roll], reported.acceleration);
    let degrees = bounds::ATTITUDE_DEGREES.map(f64::to_radians);
    let shown = [
        ("attitude", attitude, status.attitude_valid(), angles, true, degrees),
        ("acceleration", acceleration, status.acceleration_valid(), axes, false, [bounds::ACCELERATION_M_S2; 3]),
    ];
    shown.into_iter().find_map(|(name, part, valid, shown, circle, limits)| {
        let of = |earlier: Set| -> Vec<[f32; 3]> {
            let values = |member| if earlier & bit(member) == 0 { &cycle.seen[member] } else { &cycle.earlier[member] };
            each(members)
                .map(|member| part(&values(member).values))
                .filter(|(valid, _)| *valid)
                .map(|(_, it)| it)
                .collect()
        };
        let right = (0..1 << MAX_RECEIVERS).filter(|earlier: &Set| earlier & !members == 0).any(|earlier| {
            let of = of(earlier);
            let axis = |axis: usize| of.iter().map(|of| of[axis]).collect::<Vec<_>>();
            let beyond = (0..3).map(|number| farthest(&axis(number), circle) - limits[number]).fold(f64::MIN, f64::max);
            let enough = of.len() >= cycle.least;
            if valid {
                let medians = (0..3).all(|number| is_median(shown[number], &axis(number), circle));
                enough && beyond <= f64::from(bounds::ARITHMETIC_F32) && medians
            } else {
                let absent = shown.iter().all(|value| value.to_bits() == ABSENT_F32.to_bits());
                (!enough || beyond >= -f64::from(bounds::ARITHMETIC_F32)) && absent
            }
        });
        (!right).then(|| format!("its {name} is {shown:?} (valid: {valid}), the members' {:?}", of(0)))
    })
}

type Part = fn(&GpsValues) -> (bool, [f32; 3]);

/// Returns the largest difference between any two of these values, which are angles if `circle` is true.
fn farthest(of: &[f32], circle: bool) -> f64 {
    let pairs = of.iter().flat_map(|one| of.iter().map(|other| f64::from(*one) - f64::from(*other)));
    pairs.map(|off| if circle { ((off + PI).rem_euclid(2.0 * PI) - PI).abs() } else { off }).fold(0.0, f64::max)
}

/// Returns whether `shown` is the median of these values. A single value must match bit by bit. The median of angles
/// (`circle`) is taken relative to the first angle.
fn is_median(shown: f32, of: &[f32], circle: bool) -> bool {
    match *of {
        [] => false,
        [one] => shown.to_bits() == one.to_bits(),
        [first, ..] => {
            let about = |value: f32| {
                let off = f64::from(value) - f64::from(first);
                if circle { (off + PI).rem_euclid(2.0 * PI) - PI } else { off }
            };
            let median = median_of(of.iter().copied().map(about).collect()).unwrap_or(f64::NAN);
            let off = (about(shown) - median).abs();
            let off = if circle { off.min(2.0 * PI - off) } else { off };
            off <= f64::from(bounds::ARITHMETIC_F32 * first.abs().max(1.0))
        }
    }
}

fn bit(receiver: usize) -> Set {
    1 << receiver
}

fn each(set: Set) -> impl Iterator<Item = usize> + Clone {
    (0..MAX_RECEIVERS).filter(move |receiver| set & bit(*receiver) != 0)
}

fn count(set: Set) -> usize {
    set.count_ones() as usize
}

fn set(seen: &[Seen], which: impl Fn(&Seen) -> bool) -> Set {
    seen.iter().enumerate().filter(|(_, seen)| which(seen)).fold(0, |set, (receiver, _)| set | bit(receiver))
}

fn names(set: Set) -> String {
    let names: Vec<String> = each(set).map(|receiver| format!("GPS{}", receiver + 1)).collect();
    if names.is_empty() { "nobody".to_owned() } else { names.join(", ") }
}
