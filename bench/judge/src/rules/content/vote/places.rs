//! Where the receivers are at a tick, how far apart, and whether they agree, each as far as the log tells.
//!
//! When HORUS took a message is known to some milliseconds, and where two messages show the same position it is not
//! known which of them HORUS holds. So a place, an accuracy and a distance are spans here, and two receivers agree, do
//! not agree, or may do either.

use gnss_sim::{Geodetic, TangentPlane};

use super::super::track::Age;
use super::super::ubx::Motion;
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
    fn of(one: f64, other: f64) -> Self {
        Self { least: one.min(other), most: one.max(other) }
    }

    fn hull(self, other: Self) -> Self {
        Self { least: self.least.min(other.least), most: self.most.max(other.most) }
    }

    fn moved(self, by: f64) -> Self {
        Self { least: self.least + by, most: self.most + by }
    }

    fn minus(self, other: Self) -> Self {
        Self { least: self.least - other.most, most: self.most - other.least }
    }

    /// Of its values without their signs.
    fn magnitude(self) -> Self {
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
    /// What is known of its movement and accuracy; nothing while it is not certain what HORUS holds.
    held: Option<Held>,
}

#[derive(Clone, Copy, Debug)]
struct Held {
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
        held: impl IntoIterator<Item = (Motion, Age)>,
    ) {
        let ground = Geodetic { latitude, longitude, height: 0.0 };
        let held = held.into_iter().map(|(motion, age)| Held::new(motion, age)).reduce(Held::or);
        let altitude = (!altitude.is_nan()).then_some(altitude);
        self.0.push(Version { ground, plane: TangentPlane::new(ground), altitude, held });
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

impl Held {
    fn new(Motion { velocity, accuracy }: Motion, age: Age) -> Self {
        let seconds = |ns: u64| (ns + bounds::BEFORE_ARRIVAL) as f64 / 1e9;
        let ages = Range::of(seconds(age.least), seconds(age.most));
        let [north, east, down] = velocity.map(|axis| f64::from(axis) / 1e3);
        let moved = [north, east, -down].map(|speed| Range::of(speed * ages.least, speed * ages.most));
        let inflated = |stated: u32, speed: f64| {
            let at = |age: f64| {
                let drift = bounds::UNCERTAIN_ACCELERATION / 2.0 * age * age;
                f64::from(stated) / 1e3 + bounds::UNCERTAIN_SPEED_S * speed.abs() + drift
            };
            Range::of(at(ages.least), at(ages.most))
        };
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
