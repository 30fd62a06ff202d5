//! Whether Reported-Position, and who is excluded from it, is what the receivers say.
//!
//! Written from decision 15 alone: nothing here is taken from the voter that HORUS runs.
//!
//! # How it is judged
//!
//! A GPS object with a valid position is a candidate's; the receiver is eligible if it was not excluded in the cycle
//! before. Position, velocity and accuracy of each candidate are those of the messages that show what its object shows;
//! its age is known to what [`Age`](super::track::Age) says. From that follows for each two of them that they agree,
//! that they do not, or that they may do either ([`places`]).
//!
//! | violation | when |
//! |---|---|
//! | `ExclusionWrong` | excluded without a position, without a result, or though it agrees with every member; no longer excluded before it can have agreed for a second; still excluded 1.1 s after it began to agree with all |
//! | `VoteWrong` | a result of fewer than M, of no majority of the eligible, of receivers that do not agree, or of fewer than another set of eligible receivers that agree |
//! | `VoteMissing` | no result, though a majority of the eligible, at least M, agree |
//! | `ReportedWrong` | position, attitude or acceleration are not the members' medians; or a bit of the status, or what is not valid, is not as it has to be |
//!
//! A cycle has one of them at most, the first of this table. M is 1, 1, 2, 3 for 1, 2, 3, 5 receivers.
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

mod places;

use std::f64::consts::PI;

use profile::{ABSENT_F32, ABSENT_F64, GpsValues, HorusState, MAX_RECEIVERS, ReportedStatus, ReportedValues};

use super::track::Age;
use super::ubx::Motion;
use crate::{Violation, bounds};
use places::{Place, Relation, median, median_of, spread};

/// Bits of receivers, bit 0 GPS1.
type Set = u8;

/// A GPS object of a cycle, and the messages by which HORUS may have come to its position.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    pub(super) values: GpsValues,
    pub(super) held: Vec<(Motion, Age)>,
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
    returning: [Returning; MAX_RECEIVERS],
    /// There was a result since HORUS's start; there may have been one.
    located: bool,
    may_be_located: bool,
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
    seen: &'a [Seen],
    places: Vec<Option<Place>>,
    relations: [[Relation; MAX_RECEIVERS]; MAX_RECEIVERS],
    /// Who has a valid position.
    valid: Set,
    /// Who is excluded, and who was in the cycle before.
    now: Set,
    before: Set,
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
}

impl Vote {
    pub(super) fn new(receivers: usize) -> Self {
        Self { receivers, last: (0, 0), returning: Default::default(), located: false, may_be_located: false }
    }

    /// HORUS forgets everything.
    pub(super) fn forget(&mut self) {
        *self = Self::new(self.receivers);
    }

    /// Whether the cycle before the one of `number` (from 1) was seen.
    pub(super) fn follows(&self, number: u64) -> bool {
        self.last.0 + 1 == number
    }

    /// Judges a cycle, the one of `number` since HORUS's start, whose GPS objects are sound. `bits` are those of
    /// Reported-Position's status.
    pub(super) fn cycle(
        &mut self,
        tick: u64,
        number: u64,
        bits: u16,
        reported: &ReportedValues,
        seen: &[Seen],
    ) -> Judged {
        let excluded = set(seen, |seen| seen.values.status.excluded());
        let follows = self.follows(number);
        let before = if follows { self.last.1 } else { excluded };
        let cycle = Cycle::new(seen, before);
        self.may_be_located |= !follows;
        let result = reported.status.position_valid();
        let mut judged = Judged { wrong: None, away: cycle.away() };
        if follows {
            judged.wrong = self
                .exclusion(tick, result, &cycle)
                .map(|what| (Violation::ExclusionWrong, what))
                .or_else(|| self.vote(bits, reported, &cycle));
        }
        self.remember(tick, follows, &cycle);
        self.last = (number, excluded);
        self.located |= result;
        judged
    }

    /// What each excluded receiver's return hangs on.
    fn remember(&mut self, tick: u64, follows: bool, cycle: &Cycle) {
        // One that has just returned may have a vote or not.
        let may_vote = cycle.valid & !cycle.now;
        let votes = may_vote & !cycle.before;
        for (receiver, returning) in self.returning.iter_mut().enumerate().take(self.receivers) {
            let (own, was) = (bit(receiver), cycle.before & bit(receiver) != 0);
            let did_not =
                cycle.valid & own == 0 || cycle.related(receiver, votes, Relation::Disagree) != 0 || follows && !was;
            if did_not {
                returning.did_not = Some(tick);
            }
            if did_not || !follows || !cycle.agrees_with_all(receiver, may_vote) {
                returning.may_not = tick;
            }
        }
    }

    /// What is wrong with who is excluded.
    fn exclusion(&self, tick: u64, result: bool, cycle: &Cycle) -> Option<String> {
        let Cycle { valid, now, before, .. } = *cycle;
        let members = valid & !now;
        (0..self.receivers).find_map(|receiver| {
            let own = bit(receiver);
            let name = format!("GPS{}", receiver + 1);
            let ms = |ns: u64| format!("{:.0} ms", ns as f64 / 1e6);
            let Returning { may_not, did_not } = self.returning[receiver];
            match (before & own != 0, now & own != 0) {
                (false, true) if valid & own == 0 => Some(format!("{name} is excluded, and has no valid position")),
                (false, true) if !result => Some(format!("{name} is excluded, and there is no result")),
                (false, true) if cycle.agrees_with_all(receiver, members) => {
                    Some(format!("{name} is excluded, and agrees with every receiver that is not"))
                }
                (true, false) if did_not.is_some_and(|at| tick - at < bounds::NOT_RETURNED) => {
                    let since = tick - did_not.unwrap_or(tick);
                    Some(format!("{name} is no longer excluded, {} after it was no candidate or disagreed", ms(since)))
                }
                (true, true)
                    if valid & own != 0
                        && tick - may_not > bounds::RETURNED
                        && cycle.agrees_with_all(receiver, members) =>
                {
                    Some(format!("{name} is still excluded, and has agreed with all others for {}", ms(tick - may_not)))
                }
                _ => None,
            }
        })
    }

    /// What is wrong with the result, or its absence.
    fn vote(&self, bits: u16, reported: &ReportedValues, cycle: &Cycle) -> Option<(Violation, String)> {
        let Cycle { valid, now, before, .. } = *cycle;
        let least = match self.receivers {
            0..=2 => 1,
            3 => 2,
            _ => 3,
        };
        let agreeing = usize::from(reported.status.receivers_agreeing());
        let wrong = |what: String| Some((Violation::ReportedWrong, what));
        if bits & !ReportedStatus::USED != 0 {
            return wrong(format!("its status is {bits:#06x}, which has bits without a meaning"));
        }
        // Who is eligible for sure; one that has just returned may be.
        let eligible = valid & !before;
        let returned = valid & before & !now;
        let states: &[HorusState] = if reported.status.position_valid() || self.located {
            &[HorusState::Monitoring]
        } else if self.may_be_located {
            &[HorusState::Monitoring, HorusState::Starting]
        } else {
            &[HorusState::Starting]
        };
        if !reported.status.position_valid() {
            let agree = cycle.largest(eligible);
            let outside = (eligible | returned) & !agree;
            if count(agree) >= least && count(agree) > count(outside) {
                return Some((Violation::VoteMissing, format!("there is no result, and {} agree", names(agree))));
            }
            return absent(reported, states).and_then(wrong);
        }
        let all = valid & !now;
        let members = [all, all & !returned].into_iter().find(|members| count(*members) == agreeing);
        let Some(members) = members else {
            return wrong(format!("it claims {agreeing} receivers that agree, and {} have a vote", count(all)));
        };
        let bad = |what: String| Some((Violation::VoteWrong, what));
        let outside = eligible & !members;
        if count(members) < least {
            return bad(format!("a result of {} receiver(s), where {least} have to agree", count(members)));
        }
        if count(members) <= count(outside) {
            return bad(format!("a result of {} against {}", names(members), names(outside)));
        }
        for one in each(members) {
            let apart = cycle.related(one, members, Relation::Disagree);
            if apart != 0 {
                return bad(format!(
                    "a result of {}, of whom {} and GPS{} do not agree",
                    names(members),
                    names(apart),
                    one + 1
                ));
            }
        }
        let larger = cycle.largest(eligible);
        if count(larger) > count(members) {
            return bad(format!("a result of {}, while {} agree", names(members), names(larger)));
        }
        if !reported.status.state().is_some_and(|state| states.contains(&state)) {
            return wrong(format!("HORUS's state is {:?}", reported.status.state()));
        }
        if reported.status.degraded() != (count(members) < self.receivers) {
            return wrong(format!("degraded is {}, with {agreeing} receivers that agree", reported.status.degraded()));
        }
        position(reported, members, cycle).or_else(|| motion(reported, members, cycle)).and_then(wrong)
    }
}

impl<'a> Cycle<'a> {
    fn new(seen: &'a [Seen], before: Set) -> Self {
        let place = |Seen { values, held }: &Seen| {
            let GpsValues { latitude, longitude, altitude, status, .. } = *values;
            status.position_valid().then(|| Place::new(latitude, longitude, altitude, held.iter().copied()))
        };
        let places: Vec<_> = seen.iter().map(place).collect();
        let mut relations = [[Relation::Doubtful; MAX_RECEIVERS]; MAX_RECEIVERS];
        for (one, place) in places.iter().enumerate() {
            for (other, its) in places.iter().enumerate().skip(one + 1) {
                if let (Some(place), Some(its)) = (place, its) {
                    let relation = place.relation(its);
                    (relations[one][other], relations[other][one]) = (relation, relation);
                }
            }
        }
        let valid = set(seen, |seen| seen.values.status.position_valid());
        let now = set(seen, |seen| seen.values.status.excluded());
        Self { seen, places, relations, valid, now, before }
    }

    /// How far each excluded receiver is from those that have a vote: the farthest.
    fn away(&self) -> [Option<(f64, Option<f64>)>; MAX_RECEIVERS] {
        let mut away = [None; MAX_RECEIVERS];
        for receiver in each(self.now & self.valid) {
            let others = each(self.valid & !self.now).filter_map(|other| {
                let (along, height) = self.places[receiver].as_ref()?.apart(self.places[other].as_ref()?)?;
                Some((along.middle(), height.map(places::Range::middle)))
            });
            away[receiver] = others.max_by(|(one, _), (other, _)| one.total_cmp(other));
        }
        away
    }
}

/// What is wrong with a Reported-Position that is not valid.
fn absent(reported: &ReportedValues, states: &[HorusState]) -> Option<String> {
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
    (!status.state().is_some_and(|state| states.contains(&state)))
        .then(|| format!("there is no result, and HORUS's state is {:?}", status.state()))
}

/// What is wrong with the position.
fn position(reported: &ReportedValues, members: Set, cycle: &Cycle) -> Option<String> {
    let ReportedValues { latitude, longitude, altitude, .. } = *reported;
    if !(-90.0..=90.0).contains(&latitude) || !(-180.0..=180.0).contains(&longitude) {
        return Some(format!("it is at {latitude}, {longitude}"));
    }
    let places: Vec<&Place> = each(members).filter_map(|member| cycle.places[member].as_ref()).collect();
    let origin = *places.first()?;
    if places.iter().any(|place| !place.is_known()) {
        return None;
    }
    let outside = |name: &str, value: f64, of: &[places::Range]| {
        let median = median(of)?;
        let off = bounds::ARITHMETIC_M + bounds::GEODESY_SHARE * spread(of);
        let inside = (median.least - off..=median.most + off).contains(&value);
        let by = if value < median.least { value - median.least } else { value - median.most };
        (!inside).then(|| format!("its {name} is {by:.3} m off the median of {}", names(members)))
    };
    let shown = origin.plane_of(latitude, longitude);
    let there: Vec<_> = places.iter().filter_map(|place| place.north_east(origin)).collect();
    for (axis, name) in ["latitude", "longitude"].into_iter().enumerate() {
        let along: Vec<_> = there.iter().map(|place| place[axis]).collect();
        if let Some(what) = outside(name, shown[axis], &along) {
            return Some(what);
        }
    }
    let high: Vec<_> = places.iter().filter_map(|place| place.altitude()).collect();
    if high.is_empty() {
        return (altitude.to_bits() != ABSENT_F64.to_bits())
            .then(|| format!("its altitude is {altitude}, and no member has one"));
    }
    outside("altitude", altitude, &high)
}

/// What is wrong with attitude or acceleration.
fn motion(reported: &ReportedValues, members: Set, cycle: &Cycle) -> Option<String> {
    let values = || each(members).map(|member| &cycle.seen[member].values);
    let attitudes: Vec<_> = values()
        .filter(|values| values.status.attitude_valid())
        .map(|values| [values.pitch, values.yaw, values.roll])
        .collect();
    let accelerations: Vec<_> =
        values().filter(|values| values.status.acceleration_valid()).map(|values| values.acceleration).collect();
    let angles = [reported.pitch, reported.yaw, reported.roll];
    let status = reported.status;
    let is = |name: &str, valid: bool, shown: [f32; 3], of: &[[f32; 3]], circle: bool| {
        if valid == of.is_empty() {
            return Some(format!("its {name} is valid: {valid}, and {} members have one", of.len()));
        }
        let right =
            (0..3).all(|axis| is_median(shown[axis], &of.iter().map(|of| of[axis]).collect::<Vec<_>>(), circle));
        (!right).then(|| format!("its {name} is {shown:?}, the members' {of:?}"))
    };
    is("attitude", status.attitude_valid(), angles, &attitudes, true)
        .or_else(|| is("acceleration", status.acceleration_valid(), reported.acceleration, &accelerations, false))
}

/// Whether `shown` is the median: bit by bit of one value and of none; of several, on a circle, about the first.
fn is_median(shown: f32, of: &[f32], circle: bool) -> bool {
    match *of {
        [] => shown.to_bits() == ABSENT_F32.to_bits(),
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
