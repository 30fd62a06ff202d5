//! Where the receivers are at a tick, how far apart, and whether they agree, each as far as the log tells.
//!
//! How much older a position is than its message follows from when the messages came after the times of week that they
//! are for: 50 ms at the candidate in the middle, and at another as much more or less as its message came later or
//! sooner, if that is at most 50 ms (decision 15, brought to the tick).
//!
//! When HORUS took a message is known to some milliseconds, and where two messages show the same position it is not
//! known which of them HORUS holds. So a place, an accuracy and a distance are spans here, and two receivers agree, do
//! not agree, or may do either.

use gnss_sim::{Geodetic, TangentPlane};

use super::super::track::{Held, WEEK};
use super::{Set, bit};
use crate::bounds;

/// Farther apart than this, two receivers are not compared in a plane, m.
const PLANE: f64 = 10_000.0;

/// From a least to a greatest value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    pub(super) least: f64,
    pub(super) most: f64,
}

impl Range {
    pub(super) fn of(one: f64, other: f64) -> Self {
        Self { least: one.min(other), most: one.max(other) }
    }

    pub(super) fn hull(self, other: Self) -> Self {
        Self { least: self.least.min(other.least), most: self.most.max(other.most) }
    }

    fn moved(self, by: f64) -> Self {
        Self { least: self.least + by, most: self.most + by }
    }

    pub(super) fn minus(self, other: Self) -> Self {
        Self { least: self.least - other.most, most: self.most - other.least }
    }

    /// Of its values without their signs.
    pub(super) fn magnitude(self) -> Self {
        let (least, most) = (self.least.abs(), self.most.abs());
        let inside = if self.least <= 0.0 && self.most >= 0.0 { 0.0 } else { least.min(most) };
        Self { least: inside, most: least.max(most) }
    }

    fn hypot(self, other: Self) -> Self {
        Self { least: libm::hypot(self.least, other.least), most: libm::hypot(self.most, other.most) }
    }

    pub(super) fn middle(self) -> f64 {
        f64::midpoint(self.least, self.most)
    }
}

/// What is known of how two receivers' positions compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Relation {
    /// They agree.
    Agree,
    /// They do not.
    Disagree,
    /// They may do either.
    Doubtful,
}

/// A receiver with a position at a tick: each that HORUS's voter may have of it.
#[derive(Clone, Debug, Default)]
pub(super) struct Place(Vec<Version>);

#[derive(Clone, Debug)]
struct Version {
    /// Below what an object shows, on the ellipsoid, and the plane there.
    ground: Geodetic,
    plane: TangentPlane,
    /// As the object shows it; a 2D fix has none.
    altitude: Option<f64>,
    /// The messages by which HORUS may have come to it; none while it is not certain what HORUS holds.
    messages: Vec<Held>,
    /// What is known of its movement and accuracy, once it is known how old it is.
    held: Option<Brought>,
}

#[derive(Clone, Copy, Debug)]
struct Brought {
    /// How far north, east and up it has moved since its epoch, m.
    moved: [Range; 3],
    /// Its inflated accuracies, horizontal and vertical, m.
    accuracy: [Range; 2],
}

impl Place {
    /// Adds a position that a GPS object shows, and the messages by which HORUS may have come to it.
    pub(super) fn add(
        &mut self,
        latitude: f64,
        longitude: f64,
        altitude: f64,
        messages: impl IntoIterator<Item = Held>,
    ) {
        let ground = Geodetic { latitude, longitude, height: 0.0 };
        let messages = messages.into_iter().collect();
        let altitude = (!altitude.is_nan()).then_some(altitude);
        self.0.push(Version { ground, plane: TangentPlane::new(ground), altitude, messages, held: None });
    }

    /// How long after the time of week its message arrived, as far from `reference` (ns) as half a week at most, s.
    fn lag(&self, reference: i64) -> Option<Range> {
        let lags =
            self.0.iter().map(|version| version.messages.iter().map(|held| lag(held, reference)).reduce(Range::hull));
        lags.collect::<Option<Vec<_>>>()?.into_iter().reduce(Range::hull)
    }

    /// Whether it is known how it moves.
    pub(super) fn is_known(&self) -> bool {
        !self.0.is_empty() && self.0.iter().all(|version| version.held.is_some())
    }

    /// Where it is at the tick, m north and east in the plane of `origin`.
    pub(super) fn north_east(&self, origin: &Self) -> Option<[Range; 2]> {
        let origin = origin.0.first()?;
        let all: Option<Vec<_>> = self.0.iter().map(|version| version.north_east(origin)).collect();
        all?.into_iter().reduce(|one, other| [one[0].hull(other[0]), one[1].hull(other[1])])
    }

    /// Where another position is in this one's plane, m north and east.
    pub(super) fn plane_of(&self, latitude: f64, longitude: f64) -> Option<[f64; 2]> {
        let [north, east, _] = self.0.first()?.plane.to_ned(Geodetic { latitude, longitude, height: 0.0 });
        Some([north, east])
    }

    /// How high it is at the tick, m; nothing for a 2D fix. And whether it may be such a fix or not.
    pub(super) fn altitude(&self) -> (Option<Range>, bool) {
        let all: Vec<_> = self.0.iter().map(Version::altitude).collect();
        let some = all.iter().filter(|altitude| altitude.is_some()).count();
        (all.iter().flatten().copied().reduce(Range::hull), some != 0 && some != all.len())
    }

    /// Whether it has an altitude for sure, and whether it may have one.
    pub(super) fn has_altitude(&self) -> [bool; 2] {
        let mut has = self.0.iter().map(|version| version.altitude.is_some());
        let any = has.clone().any(|has| has);
        [any && has.all(|has| has), any]
    }

    /// Its inflated accuracies at the tick, horizontal and vertical, m.
    pub(super) fn accuracy(&self) -> Option<[Range; 2]> {
        let all: Option<Vec<_>> = self.0.iter().map(|version| Some(version.held?.accuracy)).collect();
        all?.into_iter().reduce(|one, other| [one[0].hull(other[0]), one[1].hull(other[1])])
    }

    /// What lies so many metres north and east in this one's plane, on the ellipsoid.
    pub(super) fn beside(&self, [north, east]: [f64; 2]) -> Option<Geodetic> {
        let there = self.0.first()?.plane.to_geodetic([north, east, 0.0]);
        Some(Geodetic { height: 0.0, ..there })
    }

    /// How far it is from `other` at the tick, m: along the ground, and in height where both have one.
    pub(super) fn apart(&self, other: &Self) -> Option<(Range, Option<Range>)> {
        self.0.last()?.apart(other.0.last()?)
    }

    /// Whether they agree.
    pub(super) fn relation(&self, other: &Self) -> Relation {
        let relations = self.0.iter().flat_map(|one| other.0.iter().map(|its| one.relation(its)));
        relations.reduce(|one, other| if one == other { one } else { Relation::Doubtful }).unwrap_or(Relation::Doubtful)
    }
}

impl Version {
    fn north_east(&self, origin: &Self) -> Option<[Range; 2]> {
        let [north, east, _] = origin.plane.to_ned(self.ground);
        let [by_north, by_east, _] = self.held?.moved;
        Some([by_north.moved(north), by_east.moved(east)])
    }

    fn altitude(&self) -> Option<Range> {
        Some(self.held?.moved[2].moved(self.altitude?))
    }

    fn apart(&self, other: &Self) -> Option<(Range, Option<Range>)> {
        let height = || Some(self.altitude()?.minus(other.altitude()?).magnitude());
        let (one, its) = (self.ground.to_ecef(), other.ground.to_ecef());
        let chord = one.iter().zip(its).map(|(one, its)| (one - its).powi(2)).sum::<f64>().sqrt();
        if chord > PLANE {
            // An arc is longer than its chord, by half of pi at most.
            return Some((Range::of(chord, 1.6 * chord), height()));
        }
        let [north, east] = other.north_east(self)?;
        let [by_north, by_east, _] = self.held?.moved;
        let along = north.minus(by_north).magnitude().hypot(east.minus(by_east).magnitude());
        Some((along, height()))
    }

    fn relation(&self, other: &Self) -> Relation {
        let (Some((along, height)), Some(one), Some(its)) = (self.apart(other), self.held, other.held) else {
            return Relation::Doubtful;
        };
        let mut relation = Relation::Agree;
        for (axis, Range { least, most }) in [along].into_iter().chain(height).enumerate() {
            let (floor, ceiling) = bounds::AGREEMENT_M[axis];
            let sigma = one.accuracy[axis].hypot(its.accuracy[axis]);
            let limit = |sigma: f64| (bounds::AGREEMENT_SIGMAS * sigma).clamp(floor, ceiling);
            let off = |distance: f64| distance * bounds::GEODESY_SHARE + bounds::ARITHMETIC_M;
            if least - off(least) > limit(sigma.most) {
                return Relation::Disagree;
            }
            if most + off(most) > limit(sigma.least) {
                relation = Relation::Doubtful;
            }
        }
        relation
    }
}

/// Brings the receivers to the tick, of whom those in `sure` are candidates and those in `may` may be.
pub(super) fn bring(places: &mut [Place], sure: Set, may: Set) {
    let some = places.iter().flat_map(|place| &place.0).flat_map(|version| &version.messages).next();
    let Some(reference) = some.map(|held| held.since_epoch) else { return };
    let lags: Vec<_> = places.iter().map(|place| place.lag(reference)).collect();
    let of = |set: Set| {
        let lags = lags.iter().enumerate().filter(|(receiver, _)| set & bit(*receiver) != 0).map(|(_, lag)| *lag);
        median(&lags.collect::<Option<Vec<_>>>()?)
    };
    // Of each set of candidates that there may be.
    let sets = (0..1 << places.len()).filter(|set: &Set| set & !may == 0 && set & sure == sure && *set != 0);
    let middle = sets.map(of).collect::<Option<Vec<_>>>();
    let middle = middle.and_then(|middle| middle.into_iter().reduce(Range::hull));
    for version in places.iter_mut().flat_map(|place| &mut place.0) {
        let brought = version.messages.iter().map(|held| Brought::new(held, age(held, reference, middle)));
        version.held = brought.reduce(Brought::or);
    }
}

/// s, of ns.
fn seconds(ns: i64) -> f64 {
    ns as f64 / 1e9
}

/// From the time of week to the tick, as far from `reference` as half a week at most, s.
fn since_epoch(held: &Held, reference: i64) -> f64 {
    seconds((held.since_epoch - reference + WEEK / 2).rem_euclid(WEEK) - WEEK / 2)
}

/// From the time of week to the arrival, by the same reference, s.
fn lag(held: &Held, reference: i64) -> Range {
    let ages = Range::of(seconds(held.age.least as i64), seconds(held.age.most as i64));
    Range { least: since_epoch(held, reference) - ages.most, most: since_epoch(held, reference) - ages.least }
}

/// How old the position of a message is at the tick, s, if the middle of the candidates' lags is known to be in
/// `middle`.
fn age(held: &Held, reference: i64, middle: Option<Range>) -> Range {
    let (usual, spread) = (seconds(bounds::BEFORE_ARRIVAL as i64), seconds(bounds::BEFORE_ARRIVAL_SPREAD as i64));
    let since_arrival = Range::of(seconds(held.age.least as i64), seconds(held.age.most as i64));
    let as_usual = since_arrival.moved(usual);
    let widest = Range { least: as_usual.least - spread, most: as_usual.most + spread };
    let Some(middle) = middle else { return widest };
    let off = lag(held, reference).minus(middle);
    if off.least > spread || off.most < -spread {
        return as_usual;
    }
    // When the message arrived cancels out: one that arrived later has waited less and took longer by the same time.
    let epoch = since_epoch(held, reference);
    let by_epoch = Range { least: epoch - middle.most, most: epoch - middle.least }.moved(usual);
    let by_epoch = Range { least: by_epoch.least.max(widest.least), most: by_epoch.most.min(widest.most) };
    if off.least >= -spread && off.most <= spread { by_epoch } else { by_epoch.hull(as_usual) }
}

impl Brought {
    fn new(held: &Held, ages: Range) -> Self {
        let ages = Range { least: ages.least.max(0.0), most: ages.most.max(0.0) };
        let [north, east, down] = held.motion.velocity.map(|axis| f64::from(axis) / 1e3);
        let moved = [north, east, -down].map(|speed| Range::of(speed * ages.least, speed * ages.most));
        let inflated = |stated: u32, speed: f64| {
            let at = |age: f64| {
                let drift = bounds::UNCERTAIN_ACCELERATION / 2.0 * age * age;
                f64::from(stated) / 1e3 + bounds::UNCERTAIN_SPEED_S * speed.abs() + drift
            };
            Range::of(at(ages.least), at(ages.most))
        };
        let accuracy = held.motion.accuracy;
        let accuracy = [inflated(accuracy[0], libm::hypot(north, east)), inflated(accuracy[1], down)];
        Self { moved, accuracy }
    }

    /// What holds whichever of the two it is.
    fn or(self, other: Self) -> Self {
        let hull = |one: Range, other: Range| one.hull(other);
        Self {
            moved: [0, 1, 2].map(|axis| hull(self.moved[axis], other.moved[axis])),
            accuracy: [0, 1].map(|axis| hull(self.accuracy[axis], other.accuracy[axis])),
        }
    }
}

/// The median of what lies in these ranges: from the median of the least to that of the greatest values.
pub(super) fn median(ranges: &[Range]) -> Option<Range> {
    let of = |value: fn(&Range) -> f64| median_of(ranges.iter().map(value).collect());
    Some(Range { least: of(|range| range.least)?, most: of(|range| range.most)? })
}

/// The median; of an even number the mean of the middle two. Nothing of nothing.
pub(super) fn median_of(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        odd if odd % 2 == 1 => Some(values[middle]),
        _ => Some(f64::midpoint(values[middle - 1], values[middle])),
    }
}

/// How far the values of these ranges spread.
pub(super) fn spread(ranges: &[Range]) -> f64 {
    let hull = ranges.iter().copied().reduce(Range::hull);
    hull.map_or(0.0, |hull| hull.most - hull.least)
}
