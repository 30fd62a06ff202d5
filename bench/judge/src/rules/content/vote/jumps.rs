//! Judges whether a voted place or altitude jumps, and for how long HORUS has to hold it back (decision 15, jumps).
//!
//! A voted place or altitude jumps if it is too far from the one that HORUS showed last. The limit is the distance that
//! the aircraft flies in the meantime at 200 m/s, plus the distance within which two receivers of these accuracies
//! agree.
//!
//! HORUS must hold a jump back until the vote has had a result for one second without a further jump, and must show it
//! after that. Close to these limits the judge accepts both. It also accepts both where the log does not determine the
//! limits.

use gnss_sim::{Geodetic, TangentPlane};

use super::places::{Range, Relation};
use crate::bounds;

/// The voted place, or the voted altitude, at a tick.
pub(super) trait Mark: Clone {
    /// The distance, m, within which two receivers agree: the least and the greatest limit of decision 15.
    const LIMITS_M: (f64, f64);

    /// Returns the distance, m, from this place or altitude to the later `next`.
    fn way(&self, next: &Self) -> Range;

    /// Returns the greatest accuracy, m, of a receiver in this vote, with the addition for the age of its position.
    fn accuracy(&self) -> Range;

    /// Returns a place or altitude whose range covers this one and `other`.
    fn or(self, other: Self) -> Self;

    /// Returns whether `next`, voted `ns` later, is so near that it is no jump.
    fn leads_to(&self, next: &Self, ns: u64) -> Relation {
        let Range { least, most } = self.way(next);
        let off = |distance: f64| distance * bounds::GEODESY_SHARE + bounds::ARITHMETIC_M;
        let (one, its) = (self.accuracy(), next.accuracy());
        let limit = |one: f64, its: f64, ns: u64| {
            let (floor, ceiling) = Self::LIMITS_M;
            (bounds::AGREEMENT_SIGMAS * one.hypot(its)).clamp(floor, ceiling) + flown(ns)
        };
        // HORUS counts time in its own ticks, whose clock may be wrong, so each limit of the distance becomes wider.
        let slack = ns / (bounds::CYCLE / bounds::TICK_TOLERANCE);
        if least - off(least) > limit(one.most, its.most, ns + slack) {
            Relation::Disagree
        } else if most + off(most) > limit(one.least, its.least, ns - slack) {
            Relation::Doubtful
        } else {
            Relation::Agree
        }
    }

    /// Returns whether the vote's result can move from this one to `next` in two ticks without a jump.
    fn may_lead_by_two(&self, next: &Self) -> bool {
        let way = self.way(next).least * (1.0 - bounds::GEODESY_SHARE) - bounds::ARITHMETIC_M;
        way <= 2.0 * (Self::LIMITS_M.1 + flown(bounds::CYCLE + bounds::TICK_TOLERANCE))
    }
}

/// Returns the distance, m, that is flown in `ns` at the greatest speed.
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

/// The result of a vote at a tick, for the place or for the altitude.
#[derive(Clone, Debug)]
pub(super) struct Found<T> {
    pub(super) sure: bool,
    pub(super) may: bool,
    /// The voted place or altitude; `None` if it is not known.
    pub(super) mark: Option<T>,
}

#[derive(Clone, Debug)]
enum Last<T> {
    /// HORUS has shown no place or altitude since its start.
    Nothing,
    Unknown,
    /// HORUS last showed this place or altitude, at the tick at this instant.
    At(u64, T),
}

/// The place or altitude that HORUS showed last, and the results of the votes since then.
#[derive(Clone, Debug)]
pub(super) struct Course<T> {
    last: Last<T>,
    /// The results of the vote at the last two ticks; `None` if not known.
    before: [Option<T>; 2],
    /// HORUS holds a jump back for a certain time. The last tick, ns, at which this time certainly began anew.
    broke: u64,
    /// The last tick, ns, at which the time of holding a jump back may have begun anew.
    may_have_broken: u64,
}

impl<T: Mark> Course<T> {
    pub(super) const fn new() -> Self {
        Self { last: Last::Nothing, before: [None, None], broke: 0, may_have_broken: 0 }
    }

    /// Records that the place or altitude shown last is not known, and that the results since then are not known
    /// either.
    pub(super) fn lose(&mut self) {
        self.last = Last::Unknown;
        self.before = [None, None];
    }

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

    /// Returns whether HORUS must show the result `found`.
    pub(super) fn must_be_shown(&self, tick: u64, found: &Found<T>) -> bool {
        let is_near = match (&self.last, &found.mark) {
            (Last::Nothing, _) => true,
            (Last::At(at, last), Some(mark)) => last.leads_to(mark, tick - at) == Relation::Agree,
            _ => false,
        };
        found.sure && (is_near || tick - self.may_have_broken > bounds::HELD_BACK)
    }

    /// Returns, in words, why HORUS must still hold this place or altitude back; `None` if HORUS may show it.
    pub(super) fn shown_too_soon(&self, tick: u64, mark: &T) -> Option<String> {
        let Last::At(at, last) = &self.last else { return None };
        let jumps = last.leads_to(mark, tick - at) == Relation::Disagree;
        let held = tick - self.broke;
        (jumps && held < bounds::NOT_HELD_BACK).then(|| {
            let (way, ms) = (last.way(mark).middle(), |ns: u64| ns as f64 / 1e6);
            format!("is {way:.1} m from where it was {:.0} ms ago, and has held for {:.0} ms", ms(tick - at), ms(held))
        })
    }

    pub(super) fn show(&mut self, tick: u64, mark: T) {
        *self = Self { last: Last::At(tick, mark), before: [None, None], broke: tick, may_have_broken: tick };
    }
}
