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
//! | `VoteMissing` | no result, though a majority of the eligible, at least M, agree |
//! | `ExclusionWrong` | a receiver is excluded, or is not, against the rules below |
//! | `ReportedWrong` | what is shown is not the members' medians; or a status bit, or what is not valid, is wrong |
//!
//! Excluded against the rules: without a position, without a result, though it agrees with a member, or still 1.1 s
//! after it began to agree with all. Not excluded against them: it agrees with no member, or it cannot have agreed for
//! a second since it was.
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

mod places;

use std::f64::consts::PI;

use profile::{ABSENT_F32, ABSENT_F64, GpsValues, HorusState, MAX_RECEIVERS, ReportedStatus, ReportedValues};

use super::track::Held;
use crate::{Violation, bounds};
use places::{Place, Relation, median, median_of, spread};

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
    /// There was a result since HORUS's start; there may have been one.
    located: bool,
    may_be_located: bool,
    /// Whether it is known what the inputs of HORUS's state say.
    inputs_known: bool,
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
        Self {
            receivers,
            last: (0, 0),
            earlier: vec![],
            returning: Default::default(),
            located: false,
            may_be_located: false,
            inputs_known: false,
        }
    }

    /// HORUS forgets everything.
    pub(super) fn forget(&mut self) {
        *self = Self::new(self.receivers);
    }

    /// Whether the cycle before the one of `number` (from 1) was seen.
    pub(super) fn follows(&self, number: u64) -> bool {
        self.last.0 + 1 == number
    }

    /// Judges a cycle, the one of `number` since HORUS's start, whose GPS objects are sound, from Reported-Position's
    /// status bits and its values. Whether HORUS is starting or monitoring is asked where the inputs of its state are
    /// known.
    pub(super) fn cycle(
        &mut self,
        tick: u64,
        number: u64,
        inputs_known: bool,
        (bits, reported): (u16, &ReportedValues),
        seen: &[Seen],
    ) -> Judged {
        self.inputs_known = inputs_known;
        let excluded = set(seen, |seen| seen.values.status.excluded());
        let follows = self.follows(number);
        let before = if follows { self.last.1 } else { excluded };
        let earlier = std::mem::replace(&mut self.earlier, seen.to_vec());
        let cycle = Cycle::new(seen, if follows { &earlier } else { &[] }, before);
        self.may_be_located |= !follows;
        let result = reported.status.position_valid();
        let mut judged = Judged { wrong: None, away: cycle.away() };
        let mut members = vec![];
        if follows {
            let vote = self.vote(bits, reported, &cycle, &mut members);
            let exclusion = self.exclusion(tick, result, &cycle).map(|what| (Violation::ExclusionWrong, what));
            judged.wrong = exclusion.or(vote);
        }
        self.remember(tick, follows, result, &cycle, &members);
        self.last = (number, excluded);
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
        bits: u16,
        reported: &ReportedValues,
        cycle: &Cycle,
        members: &mut Vec<Set>,
    ) -> Option<(Violation, String)> {
        let Cycle { sure, may, now, before, .. } = *cycle;
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
        // Who is eligible for sure, and who may be.
        let eligible = sure & !(now & before);
        let may_vote = may & !(now & before);
        // Any other state is the inputs' matter.
        let is_located = reported.status.position_valid() || self.located;
        let wrong_state = match reported.status.state() {
            Some(HorusState::Starting) => is_located && self.inputs_known,
            Some(HorusState::Monitoring) => !is_located && !self.may_be_located,
            _ => false,
        };
        let largest = cycle.largest(eligible);
        if !reported.status.position_valid() {
            if count(largest) >= least && count(largest) > count(may_vote & !largest) {
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
        members.retain(|set| each(anew).all(|one| cycle.related(one, *set, Relation::Agree) == 0));
        if members.is_empty() {
            return excluded(format!("{} are excluded, and agree with some that are not", names(anew)));
        }
        if count(largest) > agreeing {
            return bad(format!("a result of {agreeing}, while {} agree", names(largest)));
        }
        let spared = eligible & !now;
        members.retain(|set| each(spared & !set).all(|one| cycle.related(one, *set, Relation::Disagree) != *set));
        if members.is_empty() {
            return excluded(format!("of {} not all are excluded that agree with no member", names(spared)));
        }
        if wrong_state {
            return wrong(format!("HORUS's state is {:?}", reported.status.state()));
        }
        if reported.status.degraded() != (agreeing < self.receivers) {
            return wrong(format!("degraded is {}, with {agreeing} receivers that agree", reported.status.degraded()));
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
        None
    }
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
        Self { seen, earlier, places, relations, sure, may, now, before }
    }

    /// How far each excluded receiver is from those that have a vote: the farthest.
    fn away(&self) -> [Option<(f64, Option<f64>)>; MAX_RECEIVERS] {
        let mut away = [None; MAX_RECEIVERS];
        for receiver in each(self.now & self.may) {
            let others = each(self.may & !self.now).filter_map(|other| {
                let (along, height) = self.places[receiver].apart(&self.places[other])?;
                Some((along.middle(), height.map(places::Range::middle)))
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
    let outside = |name: &str, value: f64, of: &[places::Range]| {
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
    if places.iter().any(|place| place.altitude().1) {
        return None;
    }
    let high: Vec<_> = places.iter().filter_map(|place| place.altitude().0).collect();
    if high.is_empty() {
        return (altitude.to_bits() != ABSENT_F64.to_bits())
            .then(|| format!("its altitude is {altitude}, and no member has one"));
    }
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
    let shown = [
        ("attitude", attitude, status.attitude_valid(), [reported.pitch, reported.yaw, reported.roll], true),
        ("acceleration", acceleration, status.acceleration_valid(), reported.acceleration, false),
    ];
    shown.into_iter().find_map(|(name, part, valid, shown, circle)| {
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
            valid != of.is_empty() && (0..3).all(|number| is_median(shown[number], &axis(number), circle))
        });
        (!right).then(|| format!("its {name} is {shown:?} (valid: {valid}), the members' {:?}", of(0)))
    })
}

/// What of an object a median is made of, and whether it is valid.
type Part = fn(&GpsValues) -> (bool, [f32; 3]);

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
