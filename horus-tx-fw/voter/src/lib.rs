//! One position, attitude and acceleration from what several GNSS receivers say
//!
//! # Design
//!
//! A majority decides (`docs/decisions/0015-one-voted-position.md`). At each tick of 10 ms every candidate is brought
//! to the tick, every pair is compared, every set of receivers in which each pair agrees is ranked, and the median of
//! the set that wins is the result. What a receiver must say to be a candidate, when two agree, and when one that was
//! outvoted returns are the constants below; nothing else is a number to choose.
//!
//! - **Nothing is infinite or not a number.** Positions, velocities and accuracies are integers until they were found
//!   plausible ([`Stated`]); attitude and acceleration take part only if they are finite.
//! - **The work does not depend on the data.** All pairs, all 2ᴺ - 1 sets, all medians by a fixed sorting network, and
//!   what does not count is selected away, not skipped. What remains is float64 and square roots by software, and moves
//!   that a compiler makes of a choice: a sixth of the time.
//! - **The work is small.** What only depends on a receiver's message is worked out when it arrives ([`Fix::new`]), all
//!   metres are float32 (see `geometry`), no distance needs a root, and float64 appears in the result alone.
//! - **Pure.** No clock, no input or output, no allocation: [`Voter::vote`] is told the time, and a voter that is a
//!   copy of another says the same.
//!
//! - **Each quantity by itself.** Altitude, attitude and acceleration are each stated only if a quorum of the members
//!   has one and all of those agree in it. No single receiver's word is shown as that of several.
//! - **No jump at once.** A place or an altitude that the last one shown does not lead to at 200 m/s is held back
//!   until it has held for a second (see `hold`).
//! - **A majority of right receivers always has a result.** A result of more than half of them has one of every
//!   majority among its members. So none of a majority that agrees is ever excluded, since it agrees with a member, and
//!   the majority itself is a set that can win. Whatever the others say, also after each other, costs no result but
//!   the second for which a jump is held back.
//!
//! # What it cannot do
//!
//! A majority that agrees on a wrong place is believed. A receiver that moves away slowly takes the result along by
//! less than the agreement distance, until it is excluded.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod fix;
mod geometry;
mod hold;
mod median;
mod set;

pub use fix::{Fix, Stated};

use fix::metres;
use geometry::Place;
use hold::Hold;
use median::{about_first, median, median_and_spread, middle_two, turned};

/// The most receivers that a voter can have: what HORUS carries.
pub const MOST_RECEIVERS: usize = 5;

/// The largest latitude, north or south, 1e-7 degrees (decision 15, candidates).
pub const LATITUDE_MAX_E7: u32 = 900_000_000;
/// The largest longitude, east or west, 1e-7 degrees (decision 15, candidates).
pub const LONGITUDE_MAX_E7: u32 = 1_800_000_000;
/// The lowest altitude, mm above the ellipsoid: -1000 m (decision 15, candidates).
pub const LOWEST_MM: i32 = -1_000_000;
/// The highest altitude, mm above the ellipsoid: 20 000 m (decision 15, candidates).
pub const HIGHEST_MM: i32 = 20_000_000;
/// The highest speed over all three axes, mm/s: 200 m/s (decision 15, candidates).
pub const SPEED_MAX_MM_S: u64 = 200_000;
/// The largest horizontal accuracy, mm: 30 m (decision 15, candidates).
pub const MOST_HORIZONTAL_ACCURACY_MM: u32 = 30_000;
/// The largest vertical accuracy, mm: 50 m (decision 15, candidates).
pub const MOST_VERTICAL_ACCURACY_MM: u32 = 50_000;

/// From the epoch of a position to its arrival, ms, at the candidate in the middle: what a receiver computes and sends
/// (decision 15, brought to the tick; u-blox data sheets and recordings: 40 to 80 ms).
pub const LATENCY_MS: i32 = 50;
/// How much another candidate's latency may differ from that, ms, to be believed (decision 15, brought to the tick).
pub const LATENCY_SPREAD_MS: i32 = 50;
/// The time of week begins anew after so many ms.
pub const WEEK_MS: u32 = 7 * 24 * 3_600 * 1_000;
/// How much the latency may differ from [`LATENCY_MS`], s: an accuracy grows by this times the speed (decision 15).
pub const LATENCY_UNCERTAINTY_S: f32 = 0.05;
/// Half of the greatest acceleration, m/s²: an accuracy grows by this times the square of the age (decision 15: half of
/// 4 m/s²).
pub const HALF_ACCELERATION_M_S2: f32 = 2.0;

/// Two agree within so many times the root of the sum of the squares of their accuracies (decision 15, agreement).
pub const DEVIATIONS: f32 = 3.0;
/// The least and the greatest distance within which two agree, horizontally, m (decision 15, agreement).
pub const HORIZONTAL_LIMITS_M: [f32; 2] = [5.0, 30.0];
/// The same, vertically, m (decision 15, agreement).
pub const VERTICAL_LIMITS_M: [f32; 2] = [8.0, 50.0];

/// The greatest difference of two attitudes that agree, pitch, yaw and roll, rad: 5, 10 and 5 degrees (decision 15,
/// attitude and acceleration).
pub const ATTITUDE_LIMITS_RAD: [f32; 3] = [PI / 36.0, PI / 18.0, PI / 36.0];
/// The greatest difference of two accelerations that agree, along each axis, m/s² (decision 15, attitude and
/// acceleration).
pub const ACCELERATION_LIMIT_M_S2: f32 = 2.0;

/// How long a place or an altitude that the last one does not lead to must hold before it is shown, ms (decision 15,
/// jumps).
pub const HELD_BACK_MS: u32 = 1_000;

/// The largest angle, rad either way, that takes part: beyond what the fields of UBX NAV-ATT can hold, 375 rad.
pub const ANGLE_MAX: f32 = 400.0;

/// How long a receiver that was excluded must agree without a break before it is eligible again, ms (decision 15,
/// exclusion).
pub const RETURNS_AFTER_MS: u32 = 1_000;

/// How many members a result of `receivers` has at least, and how many of them have at least the altitude, the attitude
/// or the acceleration that is stated: more than half of the receivers, of two one (decision 15, the set: 1oo1, 1oo2,
/// 2oo3, 3oo5).
#[must_use]
pub const fn quorum(receivers: usize) -> u32 {
    receivers.div_ceil(2) as u32
}

/// What one receiver has said by the tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Whether its position is valid by its kind of fix and by its age.
    pub valid: bool,
    /// Its position.
    pub fix: Fix,
    /// From the arrival of its position to the tick, ms; below 0 if it arrived since the tick.
    pub since_arrival_ms: i32,
    /// From the time of week that its position is for to the arrival, by a clock of ours that began anywhere, ms,
    /// modulo [`WEEK_MS`] and below it: only differences between receivers count.
    pub lag_ms: u32,
    /// Pitch, yaw and roll, rad, where they are valid.
    pub attitude: Option<[f32; 3]>,
    /// Acceleration front, right and down, m/s², where it is valid.
    pub acceleration: Option<[f32; 3]>,
}

/// The position of a result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// Degrees north, WGS-84.
    pub latitude: f64,
    /// Degrees east, WGS-84.
    pub longitude: f64,
    /// m above the ellipsoid; `None` if fewer than a quorum of the members have one, or while a jump is held back.
    pub altitude: Option<f64>,
}

/// What a vote came to. A mask has bit 0 for the first receiver. The default is that of no vote.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Verdict {
    /// The members of the result; none without one, or while a jump is held back.
    pub members: u8,
    /// The receivers that were not eligible, or are not from now on.
    pub excluded: u8,
    /// Where the result is; `None` without one.
    pub position: Option<Position>,
    /// Pitch and roll within ±π and yaw from 0 to 2π, rad, if a quorum of the members has an attitude and all of those
    /// agree.
    pub attitude: Option<[f32; 3]>,
    /// Acceleration front, right and down, m/s², under the same condition.
    pub acceleration: Option<[f32; 3]>,
}

impl Verdict {
    /// That of no vote.
    pub const NONE: Self = Self { members: 0, excluded: 0, position: None, attitude: None, acceleration: None };

    /// How many receivers agree: the members.
    #[must_use]
    pub const fn agreeing(&self) -> u8 {
        self.members.count_ones() as u8
    }

    /// Whether receiver `index`, from 0, is excluded.
    #[must_use]
    pub const fn is_excluded(&self, index: usize) -> bool {
        has(self.excluded, index)
    }
}

/// What a voter over `N` receivers remembers from tick to tick. `N` is 1 to [`MOST_RECEIVERS`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voter<const N: usize> {
    /// The members of the last result.
    last: u8,
    excluded: u8,
    /// Since when each excluded receiver has agreed at every tick, ms.
    agreeing_since: [Option<u32>; N],
    places: Hold<Spot>,
    altitudes: Hold<Height>,
}

impl<const N: usize> Default for Voter<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// A candidate brought to the tick.
#[derive(Clone, Copy, Default)]
struct Brought {
    /// How far it has moved since its epoch, m north and east.
    step: [f32; 2],
    /// The same, upwards.
    climb: f32,
    /// Accuracies that the error of that has entered, m.
    horizontal: f32,
    vertical: f32,
}

impl<const N: usize> Voter<N> {
    /// A voter that has not voted: nobody is excluded.
    #[must_use]
    pub const fn new() -> Self {
        Self::excluding(0)
    }

    /// A voter that has not voted since a restart, and before which those of the mask `excluded` were excluded: they
    /// have to agree for [`RETURNS_AFTER_MS`] from now on. A mask that no voter comes to counts as none: one with a
    /// receiver that there is not, or with half of the receivers or more, since a majority is never excluded.
    #[must_use]
    pub const fn excluding(excluded: u8) -> Self {
        const { assert!(N >= 1 && N <= MOST_RECEIVERS, "HORUS carries one to five receivers") }
        let plausible = excluded >> N == 0 && 2 * excluded.count_ones() < N as u32;
        let excluded = if plausible { excluded } else { 0 };
        Self { last: 0, excluded, agreeing_since: [None; N], places: Hold::NEW, altitudes: Hold::NEW }
    }

    /// Who is excluded from the next vote on.
    #[must_use]
    pub const fn excluded(&self) -> u8 {
        self.excluded
    }

    /// The vote of one tick at `now_ms`, a clock of milliseconds that wraps.
    pub fn vote(&mut self, inputs: &[Input; N], now_ms: u32) -> Verdict {
        let candidates = mask_of(inputs, |input| input.valid & input.fix.plausible);
        let latencies = latencies(inputs, candidates);
        let mut brought = [Brought::default(); N];
        for ((brought, input), latency) in brought.iter_mut().zip(inputs).zip(latencies) {
            *brought = bring(input, latency);
        }
        let (friends, places) = compare(inputs, &brought, candidates);

        let eligible = candidates & !self.excluded;
        let set = set::winner(&friends, eligible, self.last, &brought.each_ref().map(|brought| brought.horizontal));
        let outside = eligible & !set;
        let is_agreed = is_quorum::<N>(set) & (set.count_ones() > outside.count_ones());
        let agreed = if is_agreed { set } else { 0 };

        let spot = spot(inputs, &brought, &places, agreed);
        let is_result = self.places.take(now_ms, spot, is_agreed, true);
        let members = if is_result { agreed } else { 0 };
        let with_altitude = agreed & mask_of(inputs, |input| input.fix.has_altitude);
        let has_quorum = is_quorum::<N>(with_altitude);
        let height = height(inputs, &brought, with_altitude);
        let is_stated = self.altitudes.take(now_ms, height, has_quorum, is_result);

        // Of whom somebody must agree with a candidate: where a quorum has an altitude, those who can contradict it.
        let peers =
            inputs.each_ref().map(|input| if has_quorum & input.fix.has_altitude { with_altitude } else { set });
        let mut with_peer = 0;
        for (index, (friends, peers)) in friends.iter().zip(peers).enumerate() {
            with_peer |= u8::from(friends & peers != 0) << index;
        }
        let outvoted = if is_result { outside & !with_peer } else { 0 };

        // The two have nobody in common.
        let excluded = self.excluded | outvoted;
        self.remember(members, outvoted, eligible, &friends, now_ms);

        let [latitude, longitude] = spot.place.degrees(spot.step);
        let position = Position { latitude, longitude, altitude: is_stated.then_some(height.altitude()) };
        Verdict {
            members,
            excluded,
            position: is_result.then_some(position),
            attitude: attitude(inputs, members),
            acceleration: acceleration(inputs, members),
        }
    }

    /// Who is excluded at the next tick: those who were and the `outvoted`, but for those who by now have agreed for
    /// long enough with all `members` or, without a result, with one of those who are `eligible`, if there are any.
    fn remember(&mut self, members: u8, outvoted: u8, eligible: u8, friends: &[u8; N], now_ms: u32) {
        let mut returned = 0;
        for (index, (since, friends)) in self.agreeing_since.iter_mut().zip(friends).enumerate() {
            // Its own friend is only who is a candidate.
            let with_members = friends & members == members;
            let with_one = (friends & eligible != 0) | (eligible == 0);
            let agrees = has(self.excluded & friends, index) & with_members & ((members != 0) | with_one);
            let from = since.unwrap_or(now_ms);
            let long_enough = agrees & (now_ms.wrapping_sub(from) >= RETURNS_AFTER_MS);
            *since = (agrees & !long_enough).then_some(from);
            returned |= u8::from(long_enough) << index;
        }
        self.excluded = (self.excluded | outvoted) & !returned;
        self.last = if members == 0 { self.last } else { members };
    }
}

const PI: f32 = core::f32::consts::PI;

/// Whether receiver `index`, from 0, is in `mask`.
const fn has(mask: u8, index: usize) -> bool {
    mask >> index & 1 == 1
}

/// Whether so many of `N` receivers are a quorum.
const fn is_quorum<const N: usize>(mask: u8) -> bool {
    mask.count_ones() >= quorum(N)
}

/// Those of whom `is` is true.
fn mask_of<T, const N: usize>(items: &[T; N], is: impl Fn(&T) -> bool) -> u8 {
    items.iter().enumerate().fold(0, |mask, (index, item)| mask | u8::from(is(item)) << index)
}

/// The first of `items` whose bit is set in `mask`; without one the first of all.
fn first<T: Copy, const N: usize>(mask: u8, items: &[T; N]) -> T {
    (0..N).rev().fold(items[0], |found, index| if has(mask, index) { items[index] } else { found })
}

/// Whether there are three numbers, each at most `most` either way. A value that is not a number is not.
fn are_within(values: Option<[f32; 3]>, most: f32) -> bool {
    values.is_some_and(|values| values.iter().fold(true, |all, value| all & (value.abs() <= most)))
}

/// One of three numbers of each input; 0 where they are not given or not within `most`.
fn axis_of<const N: usize>(
    inputs: &[Input; N],
    of: impl Fn(&Input) -> Option<[f32; 3]>,
    axis: usize,
    most: f32,
) -> [f32; N] {
    inputs.each_ref().map(|input| {
        let values = of(input);
        if are_within(values, most) { values.unwrap_or_default()[axis] } else { 0.0 }
    })
}

/// From the epoch of each position to its arrival, half ms.
///
/// All receivers tell the time of week of the same system. So if one receiver's message arrives later after its time of
/// week than another's, it took so much longer. The candidate in the middle gets [`LATENCY_MS`], the others as much
/// more or less as their messages took. Where that is more than [`LATENCY_SPREAD_MS`], the receiver's time of week is
/// wrong, and its position gets [`LATENCY_MS`], too.
fn latencies<const N: usize>(inputs: &[Input; N], candidates: u8) -> [i32; N] {
    const HALF_A_WEEK_MS: i32 = WEEK_MS as i32 / 2;
    let lags = inputs.each_ref().map(|input| input.lag_ms as i32);
    let reference = first(candidates, &lags);
    let lags = lags.map(|lag| {
        let off = lag.wrapping_sub(reference);
        let off = if off > HALF_A_WEEK_MS { off - WEEK_MS as i32 } else { off };
        let off = if off < -HALF_A_WEEK_MS { off + WEEK_MS as i32 } else { off };
        off.clamp(-HALF_A_WEEK_MS, HALF_A_WEEK_MS)
    });
    let [low, high] = middle_two(lags, candidates, HALF_A_WEEK_MS);
    lags.map(|lag| {
        let off = (lag - low) + (lag - high);
        let believed = (-2 * LATENCY_SPREAD_MS..=2 * LATENCY_SPREAD_MS).contains(&off);
        2 * LATENCY_MS + if believed { off } else { 0 }
    })
}

/// A position moved by its velocity from its epoch to the tick, and accuracies that allow for what that leaves.
fn bring(input: &Input, half_ms_before_arrival: i32) -> Brought {
    let Input { fix, since_arrival_ms, .. } = input;
    let age = since_arrival_ms.saturating_mul(2).saturating_add(half_ms_before_arrival).max(0) as f32 / 2e3;
    let [north, east, down] = fix.velocity.map(|velocity| velocity * age);
    let inflated =
        |accuracy: f32, speed: f32| accuracy + LATENCY_UNCERTAINTY_S * speed + HALF_ACCELERATION_M_S2 * age * age;
    Brought {
        step: [north, east],
        climb: -down,
        horizontal: inflated(fix.accuracy[0], fix.speed[0]),
        vertical: inflated(fix.accuracy[1], fix.speed[1]),
    }
}

/// Who agrees with whom, each candidate with itself; and in row `i` where those after `i` are, and `i` itself, m north
/// and east of where `i` was at its epoch.
fn compare<const N: usize>(
    inputs: &[Input; N],
    brought: &[Brought; N],
    candidates: u8,
) -> ([u8; N], [[[f32; 2]; N]; N]) {
    let mut friends = [0; N];
    let mut places = [[[0.0; 2]; N]; N];
    for one in 0..N {
        let (fix, moved) = (&inputs[one].fix, &brought[one]);
        friends[one] |= candidates & 1 << one;
        places[one][one] = moved.step;
        for other in one + 1..N {
            let (other_fix, other_moved) = (&inputs[other].fix, &brought[other]);
            let (place, distance_squared) = apart((&fix.place, moved.step), (&other_fix.place, other_moved.step));
            places[one][other] = place;
            let level =
                distance_squared <= limit_squared(moved.horizontal, other_moved.horizontal, HORIZONTAL_LIMITS_M);

            let height = metres(other_fix.altitude_mm - fix.altitude_mm) + (other_moved.climb - moved.climb);
            let high = height * height <= limit_squared(moved.vertical, other_moved.vertical, VERTICAL_LIMITS_M);

            let both = has(candidates, one) & has(candidates, other);
            let agree = both & level & (high | !(fix.has_altitude & other_fix.has_altitude));
            friends[one] |= u8::from(agree) << other;
            friends[other] |= u8::from(agree) << one;
        }
    }
    (friends, places)
}

/// The square of the distance within which two agree, from their accuracies.
fn limit_squared(one: f32, other: f32, [least, most]: [f32; 2]) -> f32 {
    let limit = DEVIATIONS * DEVIATIONS * (one * one + other * other);
    let limit = if limit < least * least { least * least } else { limit };
    if limit > most * most { most * most } else { limit }
}

/// Where another place is, a step from it included, m north and east of this one; and the square of its distance from
/// this one's step, m².
fn apart((place, step): (&Place, [f32; 2]), (other, other_step): (&Place, [f32; 2])) -> ([f32; 2], f32) {
    let [north, east, up] = place.to(other, other_step);
    let (off_north, off_east) = (north - step[0], east - step[1]);
    ([north, east], off_north * off_north + off_east * off_east + up * up)
}

/// Where a result is: a step, m north and east, from a member's place; and the accuracy of its least accurate member,
/// m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Spot {
    place: Place,
    step: [f32; 2],
    accuracy: f32,
}

impl hold::Mark for Spot {
    fn leads_to(&self, next: &Self, seconds: f32) -> bool {
        let (_, distance_squared) = apart((&self.place, self.step), (&next.place, next.step));
        let limit_squared = limit_squared(self.accuracy, next.accuracy, HORIZONTAL_LIMITS_M);
        hold::is_within_reach(distance_squared, limit_squared, seconds)
    }
}

/// Median of the members, north and east by itself.
fn spot<const N: usize>(inputs: &[Input; N], brought: &[Brought; N], places: &[[[f32; 2]; N]; N], members: u8) -> Spot {
    // Metres of the first member's place; its row knows all members, since none is before it.
    let place: Place = first(members, &inputs.each_ref().map(|input| input.fix.place));
    let row = first(members, places);
    let step = [0, 1].map(|axis| median(row.map(|place| place[axis]), members));
    Spot { place, step, accuracy: greatest(brought, |brought| brought.horizontal, members) }
}

/// How high a result is: `above` m above `ground_mm`; and the accuracy of its least accurate member, m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Height {
    ground_mm: i32,
    above: f32,
    accuracy: f32,
}

impl Height {
    /// m above the ellipsoid; where nothing is above the ground exactly what was stated.
    fn altitude(&self) -> f64 {
        /// Parts of a mm in which the sum is counted.
        const PARTS: i32 = 256;
        let above = (self.above * (1e3 * PARTS as f32)) as i32;
        (i64::from(self.ground_mm) * i64::from(PARTS) + i64::from(above)) as f64 / (1e3 * f64::from(PARTS))
    }
}

impl hold::Mark for Height {
    fn leads_to(&self, next: &Self, seconds: f32) -> bool {
        let climb = metres(next.ground_mm - self.ground_mm) + (next.above - self.above);
        let limit_squared = limit_squared(self.accuracy, next.accuracy, VERTICAL_LIMITS_M);
        hold::is_within_reach(climb * climb, limit_squared, seconds)
    }
}

/// Median of the altitudes of those in the mask.
fn height<const N: usize>(inputs: &[Input; N], brought: &[Brought; N], with_altitude: u8) -> Height {
    let ground_mm = first(with_altitude, &inputs.each_ref().map(|input| input.fix.altitude_mm));
    let mut heights = [0.0; N];
    for (height, (input, brought)) in heights.iter_mut().zip(inputs.iter().zip(brought)) {
        *height = metres(input.fix.altitude_mm - ground_mm) + brought.climb;
    }
    let accuracy = greatest(brought, |brought| brought.vertical, with_altitude);
    Height { ground_mm, above: median(heights, with_altitude), accuracy }
}

/// The greatest accuracy of those in the mask, m; of none 0.
fn greatest<const N: usize>(brought: &[Brought; N], of: impl Fn(&Brought) -> f32, among: u8) -> f32 {
    brought.iter().enumerate().fold(0.0, |greatest, (index, brought)| {
        let accuracy = if has(among, index) { of(brought) } else { 0.0 };
        if accuracy > greatest { accuracy } else { greatest }
    })
}

/// Median of the members' attitudes, each angle on the circle, if a quorum has one and each two of those agree.
fn attitude<const N: usize>(inputs: &[Input; N], members: u8) -> Option<[f32; 3]> {
    let oriented = members & mask_of(inputs, |input| are_within(input.attitude, ANGLE_MAX));
    let mut agree = is_quorum::<N>(oriented);
    let mut attitude = [0.0; 3];
    for (axis, from) in [-PI, 0.0, -PI].into_iter().enumerate() {
        let angles = axis_of(inputs, |input| input.attitude, axis, ANGLE_MAX);
        // No limit comes near half a turn: what agrees with the first agrees with another if it does about the first.
        let (reference, differences) = about_first(angles, oriented);
        let (middle, spread) = median_and_spread(differences, oriented);
        agree &= spread <= ATTITUDE_LIMITS_RAD[axis];
        attitude[axis] = turned(reference + middle, from);
    }
    agree.then_some(attitude)
}

/// Median of the members' accelerations, each axis by itself, if a quorum has one and each two of those agree.
fn acceleration<const N: usize>(inputs: &[Input; N], members: u8) -> Option<[f32; 3]> {
    let moved = members & mask_of(inputs, |input| are_within(input.acceleration, f32::MAX));
    let mut agree = is_quorum::<N>(moved);
    let mut acceleration = [0.0; 3];
    for (axis, middle) in acceleration.iter_mut().enumerate() {
        let values = axis_of(inputs, |input| input.acceleration, axis, f32::MAX);
        let spread;
        (*middle, spread) = median_and_spread(values, moved);
        agree &= spread <= ACCELERATION_LIMIT_M_S2;
    }
    agree.then_some(acceleration)
}
