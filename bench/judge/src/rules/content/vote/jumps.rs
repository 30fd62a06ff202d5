//! Judges whether a voted place or altitude jumps, and for how long HORUS has to hold it back (decision 15, jumps). The
//! judge determines both only as far as the log shows them.
//!
//! A voted place or altitude jumps if its distance from the one that HORUS showed last is greater than the sum of two
//! distances: what the aircraft flies at 200 m/s in the time between the two, and the distance within which two
//! receivers of these accuracies agree. HORUS must not show a place or altitude that jumps until, for one second, the
//! vote had a result at every tick and no result jumped from the one before. HORUS must show a place or altitude that
//! does not jump, or that has lasted for that second. Close to these limits, and where it is not known what HORUS had
//! to show, HORUS may show the place or altitude or not.

use gnss_sim::{Geodetic, TangentPlane};

use super::places::{Range, Relation};
use crate::bounds;

/// The voted place, or the voted altitude, at a tick.
pub(super) trait Mark: Clone {
    /// The least and the greatest value, m, of the distance within which the places or the altitudes of two receivers
    /// agree.
    const LIMITS_M: (f64, f64);

    /// Returns the distance, m, from this place or altitude to the place or altitude `next`.
    fn way(&self, next: &Self) -> Range;

    /// Returns the greatest inflated accuracy, m, among the receivers from which this place or altitude was voted.
    fn accuracy(&self) -> Range;

    /// Returns a place or altitude whose ranges cover both this one and `other`.
    fn or(self, other: Self) -> Self;

    /// Returns whether a place or altitude that is voted `ns` later is near enough to this one not to be a jump.
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

    /// Returns whether the place or altitude that is voted two ticks later can be reached without a jump, whatever was
    /// voted at the tick between.
    fn may_lead_by_two(&self, next: &Self) -> bool {
        let way = self.way(next).least * (1.0 - bounds::GEODESY_SHARE) - bounds::ARITHMETIC_M;
        way <= 2.0 * (Self::LIMITS_M.1 + flown(bounds::CYCLE + bounds::TICK_TOLERANCE))
    }
}

/// Returns the distance that is flown in `ns` at the greatest speed, m.
fn flown(ns: u64) -> f64 {
    f64::from(bounds::FASTEST_MM_S) / 1e3 * ns as f64 / 1e9
}

/// A voted place on the ellipsoid, which is known to within `within` metres.
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
    /// Whether the vote certainly has a result.
    pub(super) sure: bool,
    /// Whether the vote may have a result.
    pub(super) may: bool,
    /// The voted place or altitude if the vote has a result; `None` if the place or altitude is not known.
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

/// The place or altitude that HORUS showed last, and what is known of the voted places or altitudes since then.
#[derive(Clone, Debug)]
pub(super) struct Course<T> {
    last: Last<T>,
    /// The voted place or altitude at the last tick, and that at the tick before; `None` if it is not known. If it is
    /// not known at which of two ticks HORUS took a message, the value covers both possibilities.
    before: [Option<T>; 2],
    /// The instant, ns, of the last tick at which the vote certainly had no result or jumped, or at which HORUS showed
    /// a place or altitude.
    broke: u64,
    /// The instant, ns, of the last tick at which the vote may have had no result or may have jumped.
    may_have_broken: u64,
}

impl<T: Mark> Course<T> {
    pub(super) const fn new() -> Self {
        Self { last: Last::Nothing, before: [None, None], broke: 0, may_have_broken: 0 }
    }

    /// Records that it is not known which place or altitude HORUS showed last, nor what was voted since.
    pub(super) fn lose(&mut self) {
        self.last = Last::Unknown;
        self.before = [None, None];
    }

    /// Advances to the next tick, at which the vote has the result `found`.
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

    /// Returns whether HORUS certainly has to show the voted place or altitude `found`.
    pub(super) fn must_be_shown(&self, tick: u64, found: &Found<T>) -> bool {
        let is_near = match (&self.last, &found.mark) {
            (Last::Nothing, _) => true,
            (Last::At(at, last), Some(mark)) => last.leads_to(mark, tick - at) == Relation::Agree,
            _ => false,
        };
        found.sure && (is_near || tick - self.may_have_broken > bounds::HELD_BACK)
    }

    /// Returns, in words, why HORUS must not show this place or altitude yet: it jumps, and has not lasted for a
    /// second. Returns `None` if HORUS may show it.
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
