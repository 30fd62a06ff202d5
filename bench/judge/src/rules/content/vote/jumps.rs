//! Judges whether a voted place or altitude jumps, and how long it has lasted, each as far as the log shows it
//! (decision 15, jumps).
//!
//! A voted place or altitude jumps if it lies farther from the one that HORUS showed last than 200 m/s and both
//! accuracies allow. HORUS must not show one that jumps before the vote has had a result at every tick of a second,
//! each within that distance of the result before it. HORUS must show a place or altitude if it does not jump, or if it
//! has lasted for that second. In between, and where it is not known what HORUS had to show, HORUS may show it or not.

use gnss_sim::{Geodetic, TangentPlane};

use super::places::{Range, Relation};
use crate::bounds;

/// The voted place, or the voted altitude, at a tick.
pub(super) trait Mark: Clone {
    /// The least and the greatest distance, m, within which two receivers agree: two places, or two altitudes.
    const LIMITS_M: (f64, f64);

    /// Returns the distance from this place or altitude to the next one, m.
    fn way(&self, next: &Self) -> Range;

    /// Returns the greatest inflated accuracy, m, among the receivers from which this place or altitude was voted.
    fn accuracy(&self) -> Range;

    /// Returns a place or altitude that covers both this one and `other`.
    fn or(self, other: Self) -> Self;

    /// Returns whether the next place or altitude, `ns` later, is near enough to this one not to be a jump.
    fn leads_to(&self, next: &Self, ns: u64) -> Relation {
        let Range { least, most } = self.way(next);
        let off = |distance: f64| distance * bounds::GEODESY_SHARE + bounds::ARITHMETIC_M;
        let (one, its) = (self.accuracy(), next.accuracy());
        let limit = |one: f64, its: f64, ns: u64| {
            let (floor, ceiling) = Self::LIMITS_M;
            (bounds::AGREEMENT_SIGMAS * one.hypot(its)).clamp(floor, ceiling) + flown(ns)
        };
        // HORUS counts its own ticks, so its clock's error widens the limits.
        let slack = ns / (bounds::CYCLE / bounds::TICK_TOLERANCE);
        if least - off(least) > limit(one.most, its.most, ns + slack) {
            Relation::Disagree
        } else if most + off(most) > limit(one.least, its.least, ns - slack) {
            Relation::Doubtful
        } else {
            Relation::Agree
        }
    }

    /// Returns whether the next place or altitude, two ticks later, can be reached without a jump, whatever lies
    /// between.
    fn may_lead_by_two(&self, next: &Self) -> bool {
        let way = self.way(next).least * (1.0 - bounds::GEODESY_SHARE) - bounds::ARITHMETIC_M;
        way <= 2.0 * (Self::LIMITS_M.1 + flown(bounds::CYCLE + bounds::TICK_TOLERANCE))
    }
}

/// Returns the distance that is flown in `ns` at the greatest speed, m.
fn flown(ns: u64) -> f64 {
    f64::from(bounds::FASTEST_MM_S) / 1e3 * ns as f64 / 1e9
}

/// A voted place on the ellipsoid, known to within `within` metres.
#[derive(Clone, Debug)]
pub(super) struct Spot {
    pub(super) at: Geodetic,
    pub(super) within: f64,
    pub(super) accuracy: Range,
}

impl Spot {
    fn distance(&self, other: &Self) -> f64 {
        let [north, east, down] = TangentPlane::new(self.at).to_ned(other.at);
        libm::hypot(libm::hypot(north, east), down)
    }
}

impl Mark for Spot {
    const LIMITS_M: (f64, f64) = bounds::AGREEMENT_M[0];

    fn way(&self, next: &Self) -> Range {
        let (distance, within) = (self.distance(next), self.within + next.within);
        Range { least: (distance - within).max(0.0), most: distance + within }
    }

    fn accuracy(&self) -> Range {
        self.accuracy
    }

    fn or(self, other: Self) -> Self {
        let within = self.within.max(self.distance(&other) + other.within);
        Self { at: self.at, within, accuracy: self.accuracy.hull(other.accuracy) }
    }
}

/// A voted height, m above the ellipsoid.
#[derive(Clone, Debug)]
pub(super) struct Level {
    pub(super) height: Range,
    pub(super) accuracy: Range,
}

impl Mark for Level {
    const LIMITS_M: (f64, f64) = bounds::AGREEMENT_M[1];

    fn way(&self, next: &Self) -> Range {
        next.height.minus(self.height).magnitude()
    }

    fn accuracy(&self) -> Range {
        self.accuracy
    }

    fn or(self, other: Self) -> Self {
        Self { height: self.height.hull(other.height), accuracy: self.accuracy.hull(other.accuracy) }
    }
}

/// The place or altitude that HORUS has to show at a tick.
#[derive(Clone, Debug)]
pub(super) struct Found<T> {
    /// Whether the vote certainly has a result, and whether it may have one.
    pub(super) sure: bool,
    pub(super) may: bool,
    /// The place or altitude if the vote has a result; `None` if it is not known.
    pub(super) mark: Option<T>,
}

/// The place or altitude that HORUS showed last.
#[derive(Clone, Debug)]
enum Last<T> {
    /// HORUS has shown no place or altitude since its start.
    Nothing,
    /// It is not known which place or altitude HORUS showed.
    Unknown,
    /// HORUS showed this place or altitude at this tick.
    At(u64, T),
}

/// The voted places or altitudes: the one that HORUS showed last, and what is known of those since then.
#[derive(Clone, Debug)]
pub(super) struct Course<T> {
    last: Last<T>,
    /// The voted place or altitude at the last tick, and the one at the tick before that, if they are known. Where it
    /// is not known at which of two ticks HORUS took a message, the value between them covers both possibilities.
    before: [Option<T>; 2],
    /// The last tick at which the vote certainly had no result or a jump, or at which HORUS showed a place or altitude.
    broke: u64,
    /// The last tick at which the vote may have had no result or a jump.
    may_have_broken: u64,
}

impl<T: Mark> Course<T> {
    pub(super) const fn new() -> Self {
        Self { last: Last::Nothing, before: [None, None], broke: 0, may_have_broken: 0 }
    }

    /// Records that it is not known which places or altitudes HORUS showed last and voted since.
    pub(super) fn lose(&mut self) {
        self.last = Last::Unknown;
        self.before = [None, None];
    }

    /// Advances to the next tick, with the place or altitude that HORUS has to show at it.
    pub(super) fn advance(&mut self, tick: u64, found: &Found<T>) {
        let [before, earlier] = std::mem::take(&mut self.before);
        let follows = match (&before, &earlier, &found.mark) {
            _ if !found.may => Relation::Disagree,
            (_, Some(earlier), Some(mark)) if !earlier.may_lead_by_two(mark) => Relation::Disagree,
            (Some(before), _, Some(mark)) => before.leads_to(mark, bounds::CYCLE),
            _ => Relation::Doubtful,
        };
        if follows == Relation::Disagree {
            self.broke = tick;
        }
        if follows != Relation::Agree || !found.sure {
            self.may_have_broken = tick;
        }
        self.before = [found.mark.clone(), before.filter(|_| found.may)];
    }

    /// Returns whether HORUS certainly has to show this place or altitude.
    pub(super) fn must_be_shown(&self, tick: u64, found: &Found<T>) -> bool {
        let is_near = match (&self.last, &found.mark) {
            (Last::Nothing, _) => true,
            (Last::At(at, last), Some(mark)) => last.leads_to(mark, tick - at) == Relation::Agree,
            _ => false,
        };
        found.sure && (is_near || tick - self.may_have_broken > bounds::HELD_BACK)
    }

    /// Returns, in words, why HORUS must not show this place or altitude yet, if it jumps and has not lasted for a
    /// second.
    pub(super) fn shown_too_soon(&self, tick: u64, mark: &T) -> Option<String> {
        let Last::At(at, last) = &self.last else { return None };
        let jumps = last.leads_to(mark, tick - at) == Relation::Disagree;
        let held = tick - self.broke;
        (jumps && held < bounds::NOT_HELD_BACK).then(|| {
            let (way, ms) = (last.way(mark).middle(), |ns: u64| ns as f64 / 1e6);
            format!("is {way:.1} m from where it was {:.0} ms ago, and has held for {:.0} ms", ms(tick - at), ms(held))
        })
    }

    /// Records that HORUS shows this place or altitude.
    pub(super) fn show(&mut self, tick: u64, mark: T) {
        *self = Self { last: Last::At(tick, mark), before: [None, None], broke: tick, may_have_broken: tick };
    }
}
