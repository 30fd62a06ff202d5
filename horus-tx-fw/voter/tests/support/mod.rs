//! Implements decision 15 a second time, to be easy to read instead of fast: float64, positions in space, lists of
//! receivers, and the numbers as the decision has them.
#![allow(dead_code, reason = "each test file uses its part of this")]

use std::cmp::Ordering;

use horus_voter::{Fix, Input, Stated};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Report {
    pub(crate) valid: bool,
    pub(crate) stated: Stated,
    pub(crate) since_arrival_ms: i32,
    pub(crate) lag_ms: u32,
    pub(crate) attitude: Option<[f32; 3]>,
    pub(crate) acceleration: Option<[f32; 3]>,
}

impl Report {
    /// A report at rest over Winterthur, with accuracies of 1.5 m and 2.5 m, that arrived at the tick.
    pub(crate) const GOOD: Self = Self {
        valid: true,
        stated: Stated {
            latitude_e7: 474_987_654,
            longitude_e7: 87_291_234,
            altitude_mm: Some(512_345),
            velocity_mm_s: [0; 3],
            horizontal_accuracy_mm: 1_500,
            vertical_accuracy_mm: 2_500,
        },
        since_arrival_ms: 0,
        lag_ms: 0,
        attitude: None,
        acceleration: None,
    };

    pub(crate) fn input(&self) -> Input {
        Input {
            valid: self.valid,
            fix: Fix::new(&self.stated),
            since_arrival_ms: self.since_arrival_ms,
            lag_ms: self.lag_ms,
            attitude: self.attitude,
            acceleration: self.acceleration,
        }
    }

    pub(crate) fn moved(self, north: f64, east: f64) -> Self {
        let here = Place::of(&self.stated, self.stated.altitude_mm.map_or(0.0, |mm| f64::from(mm) / 1e3));
        let (latitude, longitude) = geodetic(here.at(north, east));
        let stated = Stated {
            latitude_e7: (latitude * 1e7).round() as i32,
            longitude_e7: (longitude * 1e7).round() as i32,
            ..self.stated
        };
        Self { stated, ..self }
    }

    pub(crate) fn raised(mut self, metres: f64) -> Self {
        self.stated.altitude_mm = self.stated.altitude_mm.map(|mm| mm + (metres * 1e3) as i32);
        self
    }

    pub(crate) fn stating(mut self, horizontal_mm: u32, vertical_mm: u32) -> Self {
        self.stated.horizontal_accuracy_mm = horizontal_mm;
        self.stated.vertical_accuracy_mm = vertical_mm;
        self
    }

    pub(crate) fn flying(mut self, velocity_mm_s: [i32; 3]) -> Self {
        self.stated.velocity_mm_s = velocity_mm_s;
        self
    }

    fn is_candidate(&self) -> bool {
        let s = &self.stated;
        let speed = s.velocity_mm_s.iter().map(|axis| (f64::from(*axis) / 1e3).powi(2)).sum::<f64>().sqrt();
        let mut good = self.valid;
        good &= f64::from(s.latitude_e7).abs() / 1e7 <= 90.0 && f64::from(s.longitude_e7).abs() / 1e7 <= 180.0;
        good &= speed <= 200.0;
        good &= s.horizontal_accuracy_mm > 0 && s.horizontal_accuracy_mm <= 30_000;
        if let Some(mm) = s.altitude_mm {
            good &= (-1_000.0..=20_000.0).contains(&(f64::from(mm) / 1e3));
            good &= s.vertical_accuracy_mm > 0 && s.vertical_accuracy_mm <= 50_000;
        }
        good
    }

    fn velocity(&self) -> [f64; 3] {
        self.stated.velocity_mm_s.map(|axis| f64::from(axis) / 1e3)
    }

    fn horizontal(&self, age: f64) -> f64 {
        let [north, east, _] = self.velocity();
        f64::from(self.stated.horizontal_accuracy_mm) / 1e3 + 0.05 * north.hypot(east) + 2.0 * age.powi(2)
    }

    fn vertical(&self, age: f64) -> f64 {
        f64::from(self.stated.vertical_accuracy_mm) / 1e3 + 0.05 * self.velocity()[2].abs() + 2.0 * age.powi(2)
    }

    fn height(&self, age: f64) -> Option<f64> {
        self.stated.altitude_mm.map(|mm| f64::from(mm) / 1e3 - self.velocity()[2] * age)
    }
}

type Vector = [f64; 3];

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) at: Vector,
    north: Vector,
    east: Vector,
}

const A: f64 = 6_378_137.0;
const B: f64 = 6_356_752.314_245_179;

impl Place {
    pub(crate) fn new(latitude: f64, longitude: f64, height: f64) -> Self {
        let ((sp, cp), (sl, cl)) = (latitude.to_radians().sin_cos(), longitude.to_radians().sin_cos());
        // This model computes the radii from both axes of the ellipsoid, while the voter uses the eccentricity.
        let root = (A * A * cp * cp + B * B * sp * sp).sqrt();
        let (equator, axis) = (A * A / root + height, B * B / root + height);
        Self {
            at: [equator * cp * cl, equator * cp * sl, axis * sp],
            north: [-sp * cl, -sp * sl, cp],
            east: [-sl, cl, 0.0],
        }
    }

    pub(crate) fn of(stated: &Stated, height: f64) -> Self {
        Self::new(f64::from(stated.latitude_e7) / 1e7, f64::from(stated.longitude_e7) / 1e7, height)
    }

    pub(crate) fn at(&self, north: f64, east: f64) -> Vector {
        [0, 1, 2].map(|i| self.at[i] + north * self.north[i] + east * self.east[i])
    }

    pub(crate) fn to(&self, point: Vector) -> (f64, f64, f64) {
        let d = minus(point, self.at);
        (dot(d, self.north), dot(d, self.east), dot(d, d).sqrt())
    }
}

/// Returns latitude and longitude, degrees: the latitude by bisection on the direction of the ellipsoid's normal.
pub(crate) fn geodetic([x, y, z]: Vector) -> (f64, f64) {
    let p = x.hypot(y);
    let (mut low, mut high) = (-90.0_f64, 90.0_f64);
    for _ in 0..70 {
        let middle = (low + high) / 2.0;
        let (s, c) = middle.to_radians().sin_cos();
        let root = (A * A * c * c + B * B * s * s).sqrt();
        let (foot_p, foot_z) = (A * A / root * c, B * B / root * s);
        if (z - foot_z) * c - (p - foot_p) * s > 0.0 { low = middle } else { high = middle }
    }
    ((low + high) / 2.0, y.atan2(x).to_degrees())
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Opinion {
    pub(crate) members: Vec<usize>,
    pub(crate) excluded: Vec<usize>,
    /// The place of the result in space at height 0, and the altitude, if there is one.
    pub(crate) position: Option<(Vector, Option<f64>)>,
    pub(crate) attitude: Option<[f64; 3]>,
    pub(crate) acceleration: Option<[f64; 3]>,
    /// Whether the vote was so close that rounding may change its outcome.
    pub(crate) narrow: bool,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Oracle {
    last: Vec<usize>,
    excluded: Vec<(usize, Option<u32>)>,
    places: Jumps<Spot>,
    heights: Jumps<Level>,
}

/// The place of a result, degrees, at the height of its first member; and the accuracy of its worst member, m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Spot {
    degrees: (f64, f64),
    height: f64,
    accuracy: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Level {
    height: f64,
    accuracy: f64,
}

trait Moves: Copy {
    /// Returns the distance from this value to `next`, m, and the largest distance at which the two receivers still
    /// agree, m.
    fn way(&self, next: &Self) -> (f64, f64);
}

impl Moves for Spot {
    fn way(&self, next: &Self) -> (f64, f64) {
        let [here, there] = [self, next].map(|spot| Place::new(spot.degrees.0, spot.degrees.1, self.height).at);
        let way = minus(here, there);
        (dot(way, way).sqrt(), (3.0 * self.accuracy.hypot(next.accuracy)).clamp(5.0, 30.0))
    }
}

impl Moves for Level {
    fn way(&self, next: &Self) -> (f64, f64) {
        ((self.height - next.height).abs(), (3.0 * self.accuracy.hypot(next.accuracy)).clamp(8.0, 50.0))
    }
}

/// The result that was shown last, and the series of later results that are held back, each with its tick.
#[derive(Clone, Debug)]
struct Jumps<T> {
    shown: Option<(u32, T)>,
    held: Vec<(u32, T)>,
}

impl<T> Default for Jumps<T> {
    fn default() -> Self {
        Self { shown: None, held: Vec::new() }
    }
}

impl<T: Moves> Jumps<T> {
    /// Returns `found` if it may be shown at `now`: its jump is small enough or old enough, and `may_show` is true.
    fn judge(&mut self, now: u32, found: Option<T>, may_show: bool, narrow: &mut bool) -> Option<T> {
        let Some(found) = found else {
            self.held.clear();
            return None;
        };
        let mut leads = |(at, from): (u32, T)| {
            let (way, slack) = from.way(&found);
            let limit = 200.0 * f64::from(now.wrapping_sub(at)) / 1e3 + slack;
            *narrow |= (way - limit).abs() < 0.02;
            way <= limit
        };
        let near = self.shown.is_none_or(&mut leads);
        if !self.held.last().copied().is_none_or(leads) {
            self.held.clear();
        }
        self.held.push((now, found));
        let for_a_second = now.wrapping_sub(self.held[0].0) >= 1_000;
        if may_show && (near || for_a_second) {
            self.held.clear();
            self.shown = Some((now, found));
            return Some(found);
        }
        None
    }
}

fn turn(from: f64, to: f64) -> f64 {
    let (sine, cosine) = (to - from).sin_cos();
    sine.atan2(cosine)
}

/// Returns the median of each of three numbers, if at least `least` receivers have them and no two receivers differ by
/// more than `limits`; `difference` gives the difference from one number to another.
fn agreed(
    of: &[[f32; 3]],
    least: usize,
    limits: [f64; 3],
    difference: fn(f64, f64) -> f64,
    narrow: &mut bool,
) -> Option<[f64; 3]> {
    let mut agree = of.len() >= least;
    let axes = [0, 1, 2].map(|axis| of.iter().map(|values| f64::from(values[axis])).collect::<Vec<_>>());
    for (values, limit) in axes.iter().zip(limits) {
        for one in values {
            for other in values {
                let off = difference(*one, *other).abs();
                *narrow |= (off - limit).abs() < 1e-4;
                agree &= off <= limit;
            }
        }
    }
    agree.then(|| {
        axes.map(|values| {
            values[0] + middle(&mut values.iter().map(|value| difference(values[0], *value)).collect::<Vec<_>>())
        })
    })
}

impl Oracle {
    pub(crate) fn vote(&mut self, report: &[Report], now: u32) -> Opinion {
        let n = report.len();
        let candidates: Vec<usize> = (0..n).filter(|i| report[*i].is_candidate()).collect();
        let was_excluded = |i: &usize| self.excluded.iter().any(|(who, _)| who == i);
        let eligible: Vec<usize> = candidates.iter().copied().filter(|i| !was_excluded(i)).collect();
        let ages = ages(report, &candidates);
        let mut narrow = false;
        let mut agree = vec![vec![false; n]; n];
        for &i in &candidates {
            for &j in &candidates {
                let (a, b) = (&report[i], &report[j]);
                let height = a.stated.altitude_mm.map_or(0.0, |mm| f64::from(mm) / 1e3);
                let point = |s: &Report, age: f64| {
                    let [north, east, _] = s.velocity();
                    Place::of(&s.stated, height).at(north * age, east * age)
                };
                let distance = {
                    let d = minus(point(a, ages[i]), point(b, ages[j]));
                    dot(d, d).sqrt()
                };
                let limit = (3.0 * a.horizontal(ages[i]).hypot(b.horizontal(ages[j]))).clamp(5.0, 30.0);
                narrow |= i != j && (distance - limit).abs() < 0.002;
                agree[i][j] = distance <= limit;
                if let (Some(x), Some(y)) = (a.height(ages[i]), b.height(ages[j])) {
                    let limit = (3.0 * a.vertical(ages[i]).hypot(b.vertical(ages[j]))).clamp(8.0, 50.0);
                    narrow |= i != j && ((x - y).abs() - limit).abs() < 0.002;
                    agree[i][j] &= (x - y).abs() <= limit;
                }
            }
        }
        let mut sets = vec![Vec::new()];
        for &i in &eligible {
            let larger: Vec<Vec<usize>> = sets.iter().map(|set| [set.as_slice(), &[i]].concat()).collect();
            sets.extend(larger);
        }
        sets.retain(|set| set.iter().all(|i| set.iter().all(|j| agree[*i][*j])));
        let sum = |set: &[usize]| set.iter().map(|i| report[*i].horizontal(ages[*i])).sum::<f64>();
        let kept = |set: &[usize]| set.iter().filter(|i| self.last.contains(i)).count();
        let order = |a: &Vec<usize>, b: &Vec<usize>| {
            (b.len().cmp(&a.len()))
                .then(kept(b).cmp(&kept(a)))
                .then(sum(a).partial_cmp(&sum(b)).expect("numbers"))
                .then(a.cmp(b))
        };
        sets.sort_by(order);
        if let [first, second, ..] = sets.as_slice() {
            let close = (sum(first) - sum(second)).abs();
            narrow |= first.len() == second.len() && kept(first) == kept(second) && close > 0.0 && close < 1e-4;
        }
        let best = sets[0].clone();
        let outside: Vec<usize> = eligible.iter().copied().filter(|i| !best.contains(i)).collect();
        let least = match n {
            1 | 2 => 1,
            3 => 2,
            5 => 3,
            _ => unreachable!("{n} receivers"),
        };
        let mut members = if best.len() >= least && best.len() > outside.len() { best } else { Vec::new() };

        let height = |i: usize| report[i].stated.altitude_mm.map_or(0.0, |mm| f64::from(mm) / 1e3);
        let found = members.first().map(|first| {
            let origin = Place::of(&report[*first].stated, height(*first));
            let (mut north, mut east) = (Vec::new(), Vec::new());
            for &i in &members {
                let [vn, ve, _] = report[i].velocity();
                let point = Place::of(&report[i].stated, height(*first)).at(vn * ages[i], ve * ages[i]);
                let (n, e, _) = origin.to(point);
                north.push(n);
                east.push(e);
            }
            let degrees = geodetic(origin.at(middle(&mut north), middle(&mut east)));
            let accuracy = members.iter().map(|i| report[*i].horizontal(ages[*i])).fold(0.0, f64::max);
            Spot { degrees, height: height(*first), accuracy }
        });
        let high: Vec<usize> = members.iter().copied().filter(|i| report[*i].stated.altitude_mm.is_some()).collect();
        let level = (!high.is_empty() && high.len() >= least).then(|| {
            let accuracy = high.iter().map(|i| report[*i].vertical(ages[*i])).fold(0.0, f64::max);
            let mut heights: Vec<f64> = high.iter().filter_map(|i| report[*i].height(ages[*i])).collect();
            Level { height: middle(&mut heights), accuracy }
        });
        let shown_place = self.places.judge(now, found, true, &mut narrow);
        let shown_height = self.heights.judge(now, level, shown_place.is_some(), &mut narrow);
        if shown_place.is_none() {
            members.clear();
        }

        // The list of excluded receivers also names those that were excluded before this tick.
        let mut shown: Vec<usize> = self.excluded.iter().map(|(who, _)| *who).collect();
        let mut next = Vec::new();
        for (who, since) in &self.excluded {
            let fits = if !members.is_empty() {
                members.iter().all(|other| agree[*who][*other])
            } else {
                eligible.is_empty() || eligible.iter().any(|other| agree[*who][*other])
            };
            let agrees = candidates.contains(who) && fits;
            let since = agrees.then(|| since.unwrap_or(now));
            if since.is_none_or(|since| now.wrapping_sub(since) < 1_000) {
                next.push((*who, since));
            }
        }
        if !members.is_empty() {
            let peers = |who: usize| {
                let by_height = level.is_some() && report[who].stated.altitude_mm.is_some();
                if by_height { high.clone() } else { members.clone() }
            };
            let strangers = outside.iter().filter(|who| peers(**who).iter().all(|peer| !agree[**who][*peer]));
            for who in strangers {
                shown.push(*who);
                next.push((*who, None));
            }
            self.last = members.clone();
        }
        shown.sort_unstable();
        self.excluded = next;

        let position = shown_place.map(|Spot { degrees: (latitude, longitude), .. }| {
            (Place::new(latitude, longitude, 0.0).at, shown_height.map(|level| level.height))
        });
        let usable = |values: Option<[f32; 3]>, most: f32| values.filter(|it| it.iter().all(|v| v.abs() <= most));
        let attitudes: Vec<_> = members.iter().filter_map(|i| usable(report[*i].attitude, 400.0)).collect();
        let accelerations: Vec<_> = members.iter().filter_map(|i| usable(report[*i].acceleration, f32::MAX)).collect();
        let limits = [5.0_f64, 10.0, 5.0].map(f64::to_radians);
        let attitude = agreed(&attitudes, least, limits, turn, &mut narrow);
        let acceleration = agreed(&accelerations, least, [2.0; 3], |from, to| to - from, &mut narrow);
        Opinion { members, excluded: shown, position, attitude, acceleration, narrow }
    }
}

/// Returns the age of each position at the tick, s: the time since its arrival, and its latency by decision 15
/// (paragraph "Brought to the tick").
fn ages(report: &[Report], candidates: &[usize]) -> Vec<f64> {
    const WEEK: f64 = 604_800.0;
    let lag = |i: usize| {
        let off = f64::from(report[i].lag_ms) / 1e3 - f64::from(report[candidates[0]].lag_ms) / 1e3;
        if off.abs() > WEEK / 2.0 { off - WEEK.copysign(off) } else { off }
    };
    let middle = (!candidates.is_empty()).then(|| middle(&mut candidates.iter().map(|i| lag(*i)).collect::<Vec<_>>()));
    let latency = |i: usize| {
        let off = middle.map_or(0.0, |middle| lag(i) - middle);
        0.050 + if off.abs() < 0.0502 { off } else { 0.0 }
    };
    report
        .iter()
        .enumerate()
        .map(|(i, report)| (f64::from(report.since_arrival_ms) / 1e3 + latency(i)).max(0.0))
        .collect()
}

fn middle(values: &mut [f64]) -> f64 {
    values.sort_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal));
    let half = values.len() / 2;
    if values.len() % 2 == 1 { values[half] } else { f64::midpoint(values[half - 1], values[half]) }
}

pub(crate) fn listed(mask: u8) -> Vec<usize> {
    (0..8).filter(|i| mask >> i & 1 == 1).collect()
}

pub(crate) fn distance(a: (f64, f64), b: (f64, f64)) -> f64 {
    Place::new(a.0, a.1, 0.0).to(Place::new(b.0, b.1, 0.0).at).2
}
