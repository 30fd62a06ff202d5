//! Whether Reported-Position, and who is excluded from it, is what the receivers say.
//!
//! Written from decision 15 alone: nothing here is taken from the voter that HORUS runs.
//!
//! # How it is judged
//!
//! HORUS votes for a tick in the cycle before it, so of each receiver it has what the object of this cycle shows, or
//! that of the cycle before. Who has a valid position in both is a candidate, unless the one of the cycle before may
//! have grown too old for this tick and the newer came after the vote; who has one in either may be one. Who is
//! excluded in this cycle and was in the one before is not eligible. Position, velocity and accuracy are those of the
//! messages that show what an object shows; their age is known to what [`Age`] says. From that follows for each two of
//! them that they agree, that they do not, or that they may do either ([`places`]).
//!
//! Who of the eligible are the members of a result is not told, only how many they are. So every set of so many of them
//! is tried: a violation is what no set is without.
//!
//! | violation | when |
//! |---|---|
//! | `VoteWrong` | a result of fewer than M, of no majority, of receivers that do not agree, or not the largest set |
//! | `VoteWrong` | a place or an altitude jumps, and is shown before it has held for a second ([`jumps`]) |
//! | `VoteMissing` | no result, though a majority of the eligible, at least M, agree, and it does not jump |
//! | `ExclusionWrong` | a receiver is excluded, or is not, against the rules below |
//! | `ReportedWrong` | what is shown is not the members' medians; or a status bit, or what is not valid, is wrong |
//!
//! Excluded against the rules: without a position, without a result, though it agrees with a member, or still 1.1 s
//! after it began to agree with all. Not excluded against them: it agrees with no member, or it cannot have agreed for
//! a second since it was. Where M members have an altitude, those are the members that one with an altitude has to
//! agree with. After a restart that leaves RAM as it was: one that was excluded in the last cycle before it and cannot
//! have returned since is not; or one is that was not, agreed with all others then, and has said nothing new since, nor
//! have M of the others.
//!
//! An altitude, an attitude and an acceleration take M members that have one, and all of those have to agree.
//!
//! A cycle has one of them at most. M is 1, 1, 2, 3 for 1, 2, 3, 5 receivers.
//!
//! # What is not judged
//!
//! - The cycle after one of which the judge has not seen every object, or has blamed one: who was excluded before is
//!   not known.
//! - A position, and an agreement, while it is not known what HORUS holds: HORUS's ticks are not regular, or a message
//!   may have been taken or not and the object shows neither.
//! - Which of several sets of the same size wins.
//! - The bit that tells the clock.
//!
//! Injected faults excuse nothing here: whatever is on a receiver's line, HORUS has to vote as decided over what it
//! takes from it. What it takes is judged as for every GPS object.

mod jumps;
mod places;

use std::f64::consts::PI;

use gnss_sim::Geodetic;
use profile::{ABSENT_F32, ABSENT_F64, GpsValues, HorusState, MAX_RECEIVERS, ReportedValues};

use super::track::Held;
use crate::{Violation, bounds};
use jumps::{Course, Found, Level, Mark, Spot};
use places::{Place, Range, Relation, median, median_of, spread};

/// Bits of receivers, bit 0 GPS1.
type Set = u8;

/// A GPS object of a cycle, and the messages by which HORUS may have come to its position.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    pub(super) values: GpsValues,
    pub(super) held: Vec<Held>,
    /// Its position is still valid at the next tick for sure, if nothing newer comes.
    pub(super) lasts: bool,
    /// The receiver said so much within a cycle that the voter may have something of it that no object shows.
    pub(super) hurried: bool,
}

/// What is remembered of a receiver that is excluded, ns.
#[derive(Clone, Copy, Debug, Default)]
struct Returning {
    /// The last tick at which it may have been no candidate, or disagreed.
    may_not: u64,
    /// The last tick at which it certainly was or did; nothing if there is none.
    did_not: Option<u64>,
}

/// See the [module](self).
#[derive(Clone, Debug)]
pub(super) struct Vote {
    receivers: usize,
    /// The cycle that was seen last, counted from HORUS's start, and who was excluded in it.
    last: (u64, Set),
    /// What was seen in it.
    earlier: Vec<Seen>,
    returning: [Returning; MAX_RECEIVERS],
    /// Who must be excluded in the first cycle of this start, and who may be, until that was seen.
    restarted: Option<(Set, Set)>,
    /// Who may have been outvoted after the cycle that was seen last.
    doubtful: Set,
    /// The tick of that cycle, ns.
    pub(super) last_tick: u64,
    /// There was a result since HORUS's start; there may have been one.
    located: bool,
    may_be_located: bool,
    places: Course<Spot>,
    altitudes: Course<Level>,
    /// Whether it is known what the inputs of HORUS's state say.
    inputs_known: bool,
}

/// Whether HORUS finds in its RAM who was excluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ram {
    /// It does: its supply stayed.
    Kept,
    /// Its supply was away, and the log does not say how low it went.
    MayBeKept,
    /// It does not, or it must not believe it: this was power-on.
    Lost,
}

/// What a cycle has come to.
#[derive(Clone, Debug, Default)]
pub(super) struct Judged {
    /// What is wrong.
    pub(super) wrong: Option<(Violation, String)>,
    /// How far each receiver is from those that have a vote, m: the farthest, along the ground and in height.
    pub(super) away: [Option<(f64, Option<f64>)>; MAX_RECEIVERS],
}

/// A cycle as the voter has to see it.
struct Cycle<'a> {
    /// What each receiver's object says, and what it said in the cycle before.
    seen: &'a [Seen],
    earlier: &'a [Seen],
    places: Vec<Place>,
    relations: [[Relation; MAX_RECEIVERS]; MAX_RECEIVERS],
    /// Who is a candidate for sure, and who may be.
    sure: Set,
    may: Set,
    /// Who has an altitude for sure, and who may have one.
    high: Set,
    may_be_high: Set,
    /// Who is excluded, and who was in the cycle before.
    now: Set,
    before: Set,
    /// How many are a quorum.
    least: usize,
}

impl Cycle<'_> {
    /// Those whose relation to `receiver` is this, among `others`.
    fn related(&self, receiver: usize, others: Set, relation: Relation) -> Set {
        each(others & !bit(receiver))
            .filter(|other| self.relations[receiver][*other] == relation)
            .fold(0, |set, other| set | bit(other))
    }

    /// Who agrees with everybody of `others` for sure.
    fn agrees_with_all(&self, receiver: usize, others: Set) -> bool {
        let others = others & !bit(receiver);
        self.related(receiver, others, Relation::Agree) == others
    }

    /// The largest set in `of` in which each two agree for sure.
    fn largest(&self, of: Set) -> Set {
        let sets = (0..1 << self.seen.len()).filter(|set: &Set| set & !of == 0);
        let agree = |set: &Set| each(*set).all(|receiver| self.agrees_with_all(receiver, *set));
        sets.filter(agree).max_by_key(|set| set.count_ones()).unwrap_or(0)
    }

    /// Who is eligible for sure, and who may be.
    fn eligible(&self) -> (Set, Set) {
        (self.sure & !(self.now & self.before), self.may & !(self.now & self.before))
    }

    /// Whom of a result's members `receiver` has to agree with, for sure and at most: where a quorum has an altitude,
    /// and it too, those that have one.
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

    /// Where there is a result and how high, shown or held back.
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

    /// The greatest accuracy of these.
    fn accuracy(&self, members: Set, axis: usize) -> Option<Range> {
        let of: Option<Vec<_>> = each(members).map(|member| Some(self.places[member].accuracy()?[axis])).collect();
        of?.into_iter().reduce(|one, its| Range { least: one.least.max(its.least), most: one.most.max(its.most) })
    }

    /// Where these are as a result.
    fn spot(&self, members: Set) -> Option<Spot> {
        let origin = &self.places[each(members).next()?];
        let there: Option<Vec<_>> = each(members).map(|member| self.places[member].north_east(origin)).collect();
        let there = there?;
        let axis = |axis: usize| median(&there.iter().map(|place| place[axis]).collect::<Vec<_>>());
        let (north, east) = (axis(0)?, axis(1)?);
        let within = libm::hypot(north.most - north.least, east.most - east.least) / 2.0;
        Some(Spot { at: origin.beside([north.middle(), east.middle()])?, within, accuracy: self.accuracy(members, 0)? })
    }

    /// How high these are as a result, where it is known who has an altitude.
    fn level(&self, members: Set) -> Option<Level> {
        let high = members & self.high;
        let of: Option<Vec<_>> = each(high).map(|member| self.places[member].altitude().0).collect();
        (high == members & self.may_be_high)
            .then_some(Level { height: median(&of?)?, accuracy: self.accuracy(high, 1)? })
    }
}

/// What holds whichever of them it is; nothing if one is not known.
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

    /// HORUS starts anew after `ticks` ticks and forgets everything but, where its `ram` is kept, who is excluded: that
    /// was so in the cycle seen last, or is the outcome of one of at most three votes after it that no frame shows. In
    /// those the receivers `heard` may have had positions that the cycle does not show. One that agreed with all others
    /// in it is outvoted only by what is new: its own position, or those of a whole quorum.
    pub(super) fn restart(&mut self, ram: Ram, ticks: u64, heard: Set) {
        let all = (0..self.receivers).fold(0, |set, receiver| set | bit(receiver));
        let restarted = match self.restarted {
            // No cycle was seen since the start before.
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

    /// What is wrong with who is excluded in the first cycle that is seen of a start, its `number`.
    fn after_restart(&self, (must, may): (Set, Set), excluded: Set, number: u64) -> Option<String> {
        if must & !excluded != 0 && number * bounds::CYCLE < bounds::NOT_RETURNED {
            return Some(format!("{} not excluded after a restart, and was before it", names(must & !excluded)));
        }
        (number == 1 && excluded & !may != 0)
            .then(|| format!("{} excluded after a restart, and was not before it", names(excluded & !may)))
    }

    /// Whether the cycle before the one of `number` (from 1) was seen.
    pub(super) fn follows(&self, number: u64) -> bool {
        self.last.0 + 1 == number
    }

    /// Judges a cycle, the one of `number` since HORUS's start, whose GPS objects are sound, from Reported-Position's
    /// values. Whether HORUS is starting or monitoring is asked where the inputs of its state are
    /// known.
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
            // Whether HORUS takes this for the last one is not known.
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

    /// What each excluded receiver's return hangs on: on every member, and without a result on one of the eligible.
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

    /// What is wrong with who is excluded, whoever the members are.
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

    /// What is wrong with the result, or its absence. `members` gets every set that may be the result's.
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
        // Any other state is the inputs' matter.
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

/// Where Reported-Position is and how high, of one of these sets of members.
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
        // What the vote had: the position of the cycle before, at the age of this one, or this cycle's.
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

    /// How far each excluded receiver is from those that have a vote: the farthest.
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

/// What is wrong with a Reported-Position that is not valid.
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

/// What is wrong with the position.
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

/// What is wrong with attitude or acceleration: of each member the voter had those of this cycle's object, or those of
/// the one before.
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

/// What of an object a median is made of, and whether it is valid.
type Part = fn(&GpsValues) -> (bool, [f32; 3]);

/// How far apart two of these are at most, on a circle or not.
fn farthest(of: &[f32], circle: bool) -> f64 {
    let pairs = of.iter().flat_map(|one| of.iter().map(|other| f64::from(*one) - f64::from(*other)));
    pairs.map(|off| if circle { ((off + PI).rem_euclid(2.0 * PI) - PI).abs() } else { off }).fold(0.0, f64::max)
}

/// Whether `shown` is the median: bit by bit of one value; of several, on a circle, about the first.
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

/// Receivers in words.
fn names(set: Set) -> String {
    let names: Vec<String> = each(set).map(|receiver| format!("GPS{}", receiver + 1)).collect();
    if names.is_empty() { "nobody".to_owned() } else { names.join(", ") }
}
