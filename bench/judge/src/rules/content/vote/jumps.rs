//! Judges whether a voted result jumps, and how long it has held, each as far as the log shows it (decision 15, jumps).
//!
//! A place or an altitude jumps if it lies farther from the one that was last shown than 200 m/s and both accuracies
//! allow. It must not be shown before there was a result at every tick of a second, each within that reach of the one
//! before it. A result must be shown if the last shown one leads to it, or if it has held for that second. In between,
//! and where it is not known what HORUS had to show, either is right.

use gnss_sim::{Geodetic, TangentPlane};

use super::places::{Range, Relation};
use crate::bounds;

/// The voted place or altitude at a tick.
pub(super) trait Mark: Clone {
    /// The least and the greatest distance that two accuracies allow, m.
    const LIMITS_M: (f64, f64);

    /// Returns how far the next mark is from this one, m.
    fn way(&self, next: &Self) -> Range;

    /// Returns the greatest inflated accuracy of the mark's members, m.
    fn accuracy(&self) -> Range;

    /// Returns a mark that covers both.
    fn or(self, other: Self) -> Self;

    /// Returns whether this mark leads to the next one, which is `ns` later.
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

    /// Returns whether two steps may lead from this mark to the next, whatever lies between.
    fn may_lead_by_two(&self, next: &Self) -> bool {
        let way = self.way(next).least * (1.0 - bounds::GEODESY_SHARE) - bounds::ARITHMETIC_M;
        way <= 2.0 * (Self::LIMITS_M.1 + flown(bounds::CYCLE + bounds::TICK_TOLERANCE))
    }
}

/// Returns the distance that is flown in `ns` at the greatest speed, m.
fn flown(ns: u64) -> f64 {
    f64::from(bounds::FASTEST_MM_S) / 1e3 * ns as f64 / 1e9
}

/// A place on the ellipsoid, known within `within` metres.
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

/// A height, m above the ellipsoid.
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

/// What HORUS has to show at a tick.
#[derive(Clone, Debug)]
pub(super) struct Found<T> {
    /// Whether there certainly is a result, and whether there may be one.
    pub(super) sure: bool,
    pub(super) may: bool,
    /// Where the result is if there is one; `None` if that is not known.
    pub(super) mark: Option<T>,
}

/// The result that was last shown.
#[derive(Clone, Debug)]
enum Last<T> {
    /// No result was shown since HORUS's start.
    Nothing,
    /// It is not known what was shown.
    Unknown,
    /// This mark was shown at this tick.
    At(u64, T),
}

/// The course of the results: what was last shown, and what there was since.
#[derive(Clone, Debug)]
pub(super) struct Course<T> {
    last: Last<T>,
    /// The mark at the last tick, and the mark at the tick before that, if they are known. Where it is not known at
    /// which of two ticks a message was taken, the mark between covers both possibilities.
    before: [Option<T>; 2],
    /// The last tick at which certainly no result followed from the one of the tick before, or at which one was shown.
    broke: u64,
    /// The last tick at which the row of results may have broken.
    may_have_broken: u64,
}

impl<T: Mark> Course<T> {
    pub(super) const fn new() -> Self {
        Self { last: Last::Nothing, before: [None, None], broke: 0, may_have_broken: 0 }
    }

    /// Forgets which marks were shown and which there were since, because they are not known.
    pub(super) fn lose(&mut self) {
        self.last = Last::Unknown;
        self.before = [None, None];
    }

    /// Advances to the next tick, with what HORUS has to show at it.
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

    /// Returns whether the result certainly has to be shown.
    pub(super) fn must_be_shown(&self, tick: u64, found: &Found<T>) -> bool {
        let is_near = match (&self.last, &found.mark) {
            (Last::Nothing, _) => true,
            (Last::At(at, last), Some(mark)) => last.leads_to(mark, tick - at) == Relation::Agree,
            _ => false,
        };
        found.sure && (is_near || tick - self.may_have_broken > bounds::HELD_BACK)
    }

    /// Returns what is wrong with showing this mark, if it jumps and has not held.
    pub(super) fn shown_too_soon(&self, tick: u64, mark: &T) -> Option<String> {
        let Last::At(at, last) = &self.last else { return None };
        let jumps = last.leads_to(mark, tick - at) == Relation::Disagree;
        let held = tick - self.broke;
        (jumps && held < bounds::NOT_HELD_BACK).then(|| {
            let (way, ms) = (last.way(mark).middle(), |ns: u64| ns as f64 / 1e6);
            format!("is {way:.1} m from where it was {:.0} ms ago, and has held for {:.0} ms", ms(tick - at), ms(held))
        })
    }

    /// Records that this mark is shown.
    pub(super) fn show(&mut self, tick: u64, mark: T) {
        *self = Self { last: Last::At(tick, mark), before: [None, None], broke: tick, may_have_broken: tick };
    }
}
