//! Computes where the receivers are at a tick, how far apart they are, and whether they agree. The results are ranges,
//! because the log does not state exactly when HORUS took which message.
//!
//! A position is older than the message that brought it, because a receiver needs time to compute and send it. By
//! decision 15, HORUS assumes 50 ms for the receiver with the middle delay. For any other receiver in the vote it adds
//! the difference between the two delays, up to 50 ms.

use gnss_sim::{Geodetic, TangentPlane};

use super::super::track::{Held, WEEK};
use super::{Set, bit};
use crate::bounds;

/// The distance, m, beyond which two receivers are compared on the ellipsoid and not in a tangent plane.
const PLANE: f64 = 10_000.0;

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

/// Whether the positions of two receivers agree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Relation {
    Agree,
    Disagree,
    Doubtful,
}

/// A receiver's place at a tick, with every position that the voter may use.
#[derive(Clone, Debug, Default)]
pub(super) struct Place(Vec<Version>);

#[derive(Clone, Debug)]
struct Version {
    /// The point on the ellipsoid below the object's position, with its tangent plane.
    ground: Geodetic,
    plane: TangentPlane,
    /// The altitude in the object, m; `None` for a 2D fix.
    altitude: Option<f64>,
    /// The messages that may have brought the position; empty if not known.
    messages: Vec<Held>,
    /// The receiver's movement and accuracy; `None` while the age of its position is not known.
    held: Option<Brought>,
}

#[derive(Clone, Copy, Debug)]
struct Brought {
    /// The distance, m, that the receiver has moved north, east and up since its position was measured.
    moved: [Range; 3],
    /// The horizontal and vertical accuracy, m, with the addition for the position's age.
    accuracy: [Range; 2],
}

impl Place {
    /// Adds a possible position from a GPS object, and the messages that may have brought it.
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

    fn lag(&self, reference: i64) -> Option<Range> {
        let lags =
            self.0.iter().map(|version| version.messages.iter().map(|held| lag(held, reference)).reduce(Range::hull));
        lags.collect::<Option<Vec<_>>>()?.into_iter().reduce(Range::hull)
    }

    pub(super) fn is_known(&self) -> bool {
        !self.0.is_empty() && self.0.iter().all(|version| version.held.is_some())
    }

    /// Returns the receiver's place at the tick, m north and east, in the plane that touches the ellipsoid at `origin`.
    pub(super) fn north_east(&self, origin: &Self) -> Option<[Range; 2]> {
        let origin = origin.0.first()?;
        let all: Option<Vec<_>> = self.0.iter().map(|version| version.north_east(origin)).collect();
        all?.into_iter().reduce(|one, other| [one[0].hull(other[0]), one[1].hull(other[1])])
    }

    pub(super) fn plane_of(&self, latitude: f64, longitude: f64) -> Option<[f64; 2]> {
        let [north, east, _] = self.0.first()?.plane.to_ned(Geodetic { latitude, longitude, height: 0.0 });
        Some([north, east])
    }

    /// Returns the altitude at the tick, m, `None` for a 2D fix. Also returns whether it is uncertain that the fix is
    /// 2D.
    pub(super) fn altitude(&self) -> (Option<Range>, bool) {
        let all: Vec<_> = self.0.iter().map(Version::altitude).collect();
        let some = all.iter().filter(|altitude| altitude.is_some()).count();
        (all.iter().flatten().copied().reduce(Range::hull), some != 0 && some != all.len())
    }

    /// Returns whether the place certainly has an altitude, and whether it may have one.
    pub(super) fn has_altitude(&self) -> [bool; 2] {
        let mut has = self.0.iter().map(|version| version.altitude.is_some());
        let any = has.clone().any(|has| has);
        [any && has.all(|has| has), any]
    }

    /// Returns the accuracies at the tick, horizontal and vertical, m.
    pub(super) fn accuracy(&self) -> Option<[Range; 2]> {
        let all: Option<Vec<_>> = self.0.iter().map(|version| Some(version.held?.accuracy)).collect();
        all?.into_iter().reduce(|one, other| [one[0].hull(other[0]), one[1].hull(other[1])])
    }

    pub(super) fn beside(&self, [north, east]: [f64; 2]) -> Option<Geodetic> {
        let there = self.0.first()?.plane.to_geodetic([north, east, 0.0]);
        Some(Geodetic { height: 0.0, ..there })
    }

    /// Returns the horizontal distance from the receiver `other`, m, and the vertical one if both have an altitude.
    pub(super) fn apart(&self, other: &Self) -> Option<(Range, Option<Range>)> {
        self.0.last()?.apart(other.0.last()?)
    }

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
            // The distance along the ellipsoid is at most pi / 2 times the straight line.
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

/// Brings the positions of all receivers forward to the tick. The receivers in `sure` are in the vote, and those in
/// `may` can be.
pub(super) fn bring(places: &mut [Place], sure: Set, may: Set) {
    let some = places.iter().flat_map(|place| &place.0).flat_map(|version| &version.messages).next();
    let Some(reference) = some.map(|held| held.since_epoch) else { return };
    let lags: Vec<_> = places.iter().map(|place| place.lag(reference)).collect();
    let of = |set: Set| {
        let lags = lags.iter().enumerate().filter(|(receiver, _)| set & bit(*receiver) != 0).map(|(_, lag)| *lag);
        median(&lags.collect::<Option<Vec<_>>>()?)
    };
    // The middle delay depends on the set of receivers in the vote, so the judge tries every possible set.
    let sets = (0..1 << places.len()).filter(|set: &Set| set & !may == 0 && set & sure == sure && *set != 0);
    let middle = sets.map(of).collect::<Option<Vec<_>>>();
    let middle = middle.and_then(|middle| middle.into_iter().reduce(Range::hull));
    for version in places.iter_mut().flat_map(|place| &mut place.0) {
        let brought = version.messages.iter().map(|held| Brought::new(held, age(held, reference, middle)));
        version.held = brought.reduce(Brought::or);
    }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 / 1e9
}

/// Returns the time, s, from a message's time of week to the tick. The time is within half a week of `reference` (ns).
fn since_epoch(held: &Held, reference: i64) -> f64 {
    seconds((held.since_epoch - reference + WEEK / 2).rem_euclid(WEEK) - WEEK / 2)
}

fn lag(held: &Held, reference: i64) -> Range {
    let ages = Range::of(seconds(held.age.least as i64), seconds(held.age.most as i64));
    Range { least: since_epoch(held, reference) - ages.most, most: since_epoch(held, reference) - ages.least }
}

/// Returns the age, s, of a message's position at the tick; `middle` is the candidates' middle delay, if known.
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
    // An error in the instant of arrival has no effect: if the delay seems longer, the time from the arrival to the
    // tick seems shorter by as much.
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

    fn or(self, other: Self) -> Self {
        let hull = |one: Range, other: Range| one.hull(other);
        Self {
            moved: [0, 1, 2].map(|axis| hull(self.moved[axis], other.moved[axis])),
            accuracy: [0, 1].map(|axis| hull(self.accuracy[axis], other.accuracy[axis])),
        }
    }
}

/// Returns the range of the median of values that lie in these ranges.
pub(super) fn median(ranges: &[Range]) -> Option<Range> {
    let of = |value: fn(&Range) -> f64| median_of(ranges.iter().map(value).collect());
    Some(Range { least: of(|range| range.least)?, most: of(|range| range.most)? })
}

/// Returns the median of the values, or the mean of the middle two; `None` without values.
pub(super) fn median_of(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        odd if odd % 2 == 1 => Some(values[middle]),
        _ => Some(f64::midpoint(values[middle - 1], values[middle])),
    }
}

pub(super) fn spread(ranges: &[Range]) -> f64 {
    let hull = ranges.iter().copied().reduce(Range::hull);
    hull.map_or(0.0, |hull| hull.most - hull.least)
}
