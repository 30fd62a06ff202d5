//! One position, attitude and acceleration from the messages of several GNSS receivers
//!
//! # Design
//!
//! A majority decides (`docs/decisions/0015-one-voted-position.md`). At each tick of 10 ms the position of every
//! *candidate* (a receiver with a valid position) is extrapolated to the tick, and every pair is compared. Every set of
//! receivers in which each pair agrees is ranked, and the median of the set that wins is the result; its receivers are
//! the *members*. The constants below are the only parameters.
//!
//! - **Every number is finite.** Positions, velocities and accuracies are integers until they were found plausible
//!   ([`Stated`]); attitude and acceleration take part only if they are finite.
//! - **The work does not depend on the data.** The voter computes all pairs, all 2ᴺ - 1 sets, and all medians by a
//!   fixed sorting network; values that do not count are selected away, not skipped. A sixth of the time still varies,
//!   since float64 and square roots are done in software, and the compiler makes some selections conditional.
//! - **The work is small.** Values that only depend on a receiver's message are computed on its arrival ([`Fix::new`]),
//!   all metres are float32 (see `geometry`), no distance needs a root, and float64 appears only in the result.
//! - **Pure.** The voter has no clock, no input or output, and no allocation: [`Voter::vote`] is given the time.
//!
//! - **Each quantity by itself.** The result has an altitude, an attitude or an acceleration only if a quorum of the
//!   members has this quantity and agrees in it.
//! - **No jump at once.** A place or an altitude that cannot be reached at 200 m/s from the last one shown is held back
//!   until it has lasted for a second (see `hold`).
//! - **A majority of right receivers always has a result.** More than half of the receivers are members of a result, so
//!   any majority has one of them. No receiver of a majority that agrees is ever excluded, because it agrees with a
//!   member. The majority itself is a set that can win. Whatever other receivers send, a result is lost only while a
//!   jump is held back, for a second.
//!
//! # What it cannot do
//!
//! The voter accepts a wrong place on which a majority agrees. A receiver that drifts slowly shifts the result by less
//! than the agreement distance, until the receiver is excluded.
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

/// The largest number of receivers that a voter can have, as many as HORUS can carry.
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

/// The latency of the candidate in the middle, ms (decision 15, paragraph "Brought to the tick"; u-blox data sheets and
/// recordings: 40 to 80 ms). A latency is the time from a position's epoch to its arrival, in which the receiver
/// computes and sends the position.
pub const LATENCY_MS: i32 = 50;
/// How much the latency of a candidate may differ from that of the candidate in the middle, ms (decision 15, paragraph
/// "Brought to the tick").
pub const LATENCY_SPREAD_MS: i32 = 50;
/// The length of a week, ms, after which the time of week begins at 0 again.
pub const WEEK_MS: u32 = 7 * 24 * 3_600 * 1_000;
/// The greatest error of [`LATENCY_MS`], s. Multiplied by the speed, it is added to an accuracy (decision 15).
pub const LATENCY_UNCERTAINTY_S: f32 = 0.05;
/// Half of the greatest acceleration, 4 m/s². Multiplied by the square of the age, it is added to an accuracy (decision
/// 15).
pub const HALF_ACCELERATION_M_S2: f32 = 2.0;

/// Two receivers agree within this multiple of the standard deviation of their difference, the root of the sum of both
/// squared accuracies (decision 15, agreement).
pub const DEVIATIONS: f32 = 3.0;
/// The least and the greatest distance within which two receivers agree, horizontally, m (decision 15, agreement).
pub const HORIZONTAL_LIMITS_M: [f32; 2] = [5.0, 30.0];
/// The least and the greatest distance within which two receivers agree, vertically, m (decision 15, agreement).
pub const VERTICAL_LIMITS_M: [f32; 2] = [8.0, 50.0];

/// The greatest difference of two attitudes that agree, pitch, yaw and roll, rad: 5, 10 and 5 degrees (decision 15).
pub const ATTITUDE_LIMITS_RAD: [f32; 3] = [PI / 36.0, PI / 18.0, PI / 36.0];
/// The greatest difference of two accelerations that agree, along each axis, m/s² (decision 15).
pub const ACCELERATION_LIMIT_M_S2: f32 = 2.0;

/// How long a place or altitude out of reach of the last one shown must last before it is shown, ms (decision 15).
pub const HELD_BACK_MS: u32 = 1_000;

/// The largest angle that is used, rad in either direction. UBX NAV-ATT can hold 375 rad, which is less.
pub const ANGLE_MAX: f32 = 400.0;

/// How long an excluded receiver must agree without a break before it may take part again, ms (decision 15, exclusion).
pub const RETURNS_AFTER_MS: u32 = 1_000;

/// Returns the least number of members in a result of `receivers` receivers: more than half of them, and one of two
/// (decision 15, the set: 1oo1, 1oo2, 2oo3, 3oo5). As many members must have an altitude, an attitude or an
/// acceleration for the result to have it.
#[must_use]
pub const fn quorum(receivers: usize) -> u32 {
    receivers.div_ceil(2) as u32
}

/// What one receiver contributes to the vote at a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Whether the receiver's position is valid by its kind of fix and by its age.
    pub valid: bool,
    /// The receiver's position.
    pub fix: Fix,
    /// The time from the arrival of the position to the tick, ms; below 0 if the position arrived after the tick.
    pub since_arrival_ms: i32,
    /// The position's arrival minus its time of week, ms, modulo [`WEEK_MS`]. The arrival may be on any clock, since
    /// only differences between receivers count.
    pub lag_ms: u32,
    /// The angles pitch, yaw and roll, rad, if they are valid.
    pub attitude: Option<[f32; 3]>,
    /// Acceleration front, right and down, m/s², if it is valid.
    pub acceleration: Option<[f32; 3]>,
}

/// The position of a result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// The latitude, degrees north, WGS-84.
    pub latitude: f64,
    /// The longitude, degrees east, WGS-84.
    pub longitude: f64,
    /// The altitude, m above the ellipsoid; `None` if no quorum of members has an altitude, or while a jump of the
    /// altitude is held back.
    pub altitude: Option<f64>,
}

/// The result of a vote. In its masks, bit 0 stands for the first receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Verdict {
    /// The receivers that agree on the result; none if there is no result, or while a jump is held back.
    pub members: u8,
    /// The receivers that were excluded from this vote or are excluded from the next vote on.
    pub excluded: u8,
    /// The position of the result; `None` if there is no result.
    pub position: Option<Position>,
    /// Pitch and roll within ±π and yaw from 0 to 2π, rad, if a quorum of the members has an attitude and these agree.
    pub attitude: Option<[f32; 3]>,
    /// Acceleration front, right and down, m/s², if a quorum of the members has an acceleration and these agree.
    pub acceleration: Option<[f32; 3]>,
}

impl Verdict {
    /// The verdict before the first vote.
    pub const NONE: Self = Self { members: 0, excluded: 0, position: None, attitude: None, acceleration: None };

    /// Returns the number of members of the result.
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

/// The state that a voter over `N` receivers keeps from tick to tick. `N` is 1 to [`MOST_RECEIVERS`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voter<const N: usize> {
    last: u8,
    excluded: u8,
    /// For each excluded receiver, the time from which on it has agreed at every tick, ms; `None` if it does not agree
    /// now.
    agreeing_since: [Option<u32>; N],
    places: Hold<Spot>,
    altitudes: Hold<Height>,
}

impl<const N: usize> Default for Voter<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// A candidate's position, extrapolated to the tick.
#[derive(Clone, Copy, Default)]
struct Brought {
    /// How far the candidate has moved from its position's epoch to the tick, m north and east.
    step: [f32; 2],
    /// How far the candidate has moved upwards from its position's epoch to the tick, m.
    climb: f32,
    /// The horizontal accuracy, m, which includes the error of the extrapolation.
    horizontal: f32,
    vertical: f32,
}

impl<const N: usize> Voter<N> {
    /// Returns a voter that has not voted: no receiver is excluded.
    #[must_use]
    pub const fn new() -> Self {
        Self::excluding(0)
    }

    /// Returns a voter that has not voted since a restart. The receivers of the mask `excluded` were excluded before
    /// the restart: they have to agree for [`RETURNS_AFTER_MS`] from now on. A mask with a receiver that does not
    /// exist, or with half of the receivers or more, counts as empty, because no vote leads to it.
    #[must_use]
    pub const fn excluding(excluded: u8) -> Self {
        const { assert!(N >= 1 && N <= MOST_RECEIVERS, "HORUS carries one to five receivers") }
        // Not covered: a mask that no vote leads to: HORUS keeps the mask over a reset with check words, and takes an
        // empty one if they do not fit, so only a second flip that they miss could bring it here.
        let plausible = excluded >> N == 0 && 2 * excluded.count_ones() < N as u32;
        let excluded = if plausible { excluded } else { 0 };
        Self { last: 0, excluded, agreeing_since: [None; N], places: Hold::NEW, altitudes: Hold::NEW }
    }

    /// Returns the receivers that are excluded from the next vote on.
    #[must_use]
    pub const fn excluded(&self) -> u8 {
        self.excluded
    }

    /// Votes for the tick at `now_ms`, on a clock of ms that wraps, and returns the result.
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

        // A receiver that agrees with no other is outvoted. If a quorum has altitudes, a receiver with an altitude must
        // agree with another that has one.
        let peers =
            inputs.each_ref().map(|input| if has_quorum & input.fix.has_altitude { with_altitude } else { set });
        let mut with_peer = 0;
        for (index, (friends, peers)) in friends.iter().zip(peers).enumerate() {
            with_peer |= u8::from(friends & peers != 0) << index;
        }
        let outvoted = if is_result { outside & !with_peer } else { 0 };

        // An outvoted receiver took part in the vote, so it was not excluded before.
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

    /// Updates the excluded receivers. Adds the `outvoted`. Removes those that have agreed for long enough with all
    /// `members` or, if there is no result, with one of the `eligible`. If none is eligible, they need not agree.
    fn remember(&mut self, members: u8, outvoted: u8, eligible: u8, friends: &[u8; N], now_ms: u32) {
        let mut returned = 0;
        for (index, (since, friends)) in self.agreeing_since.iter_mut().zip(friends).enumerate() {
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

const fn has(mask: u8, index: usize) -> bool {
    mask >> index & 1 == 1
}

const fn is_quorum<const N: usize>(mask: u8) -> bool {
    mask.count_ones() >= quorum(N)
}

fn mask_of<T, const N: usize>(items: &[T; N], is: impl Fn(&T) -> bool) -> u8 {
    items.iter().enumerate().fold(0, |mask, (index, item)| mask | u8::from(is(item)) << index)
}

/// Returns the item of the first receiver in `mask`. If `mask` is empty, returns the first item of all.
fn first<T: Copy, const N: usize>(mask: u8, items: &[T; N]) -> T {
    (0..N).rev().fold(items[0], |found, index| if has(mask, index) { items[index] } else { found })
}

/// Whether there are three numbers, each between -`most` and `most`. A value that is not a number fails.
fn are_within(values: Option<[f32; 3]>, most: f32) -> bool {
    values.is_some_and(|values| values.iter().fold(true, |all, value| all & (value.abs() <= most)))
}

/// Returns the coordinate `axis` of each input; 0 for an input without coordinates or with one beyond `most`.
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

/// Returns the time from the epoch of each position to its arrival, in units of half a millisecond.
///
/// A receiver's lag is the time from its message's time of week to the message's arrival. All receivers tell the time
/// of week of one system, so two latencies differ by as much as the two lags. The candidate with the median lag gets
/// [`LATENCY_MS`], and the others get more or less by their lag's difference from it. If this difference is above
/// [`LATENCY_SPREAD_MS`], the receiver's time of week is wrong, and its position gets [`LATENCY_MS`], too.
fn latencies<const N: usize>(inputs: &[Input; N], candidates: u8) -> [i32; N] {
    const HALF_A_WEEK_MS: i32 = WEEK_MS as i32 / 2;
    let lags = inputs.each_ref().map(|input| input.lag_ms as i32);
    let reference = first(candidates, &lags);
    let lags = lags.map(|lag| {
        let off = lag.wrapping_sub(reference);
        let off = if off > HALF_A_WEEK_MS { off - WEEK_MS as i32 } else { off };
        let off = if off < -HALF_A_WEEK_MS { off + WEEK_MS as i32 } else { off };
        // Not covered: the clamp, a defence against a lag of a week or more: `Pace` states each lag modulo a week, so
        // the corrections above leave half a week at most.
        off.clamp(-HALF_A_WEEK_MS, HALF_A_WEEK_MS)
    });
    let [low, high] = middle_two(lags, candidates, HALF_A_WEEK_MS);
    lags.map(|lag| {
        let off = (lag - low) + (lag - high);
        let believed = (-2 * LATENCY_SPREAD_MS..=2 * LATENCY_SPREAD_MS).contains(&off);
        2 * LATENCY_MS + if believed { off } else { 0 }
    })
}

/// Returns a position moved by its velocity from its epoch to the tick, with accuracies that allow for the error.
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

/// Returns, for each candidate, a mask of the candidates that agree with it, including itself. Also returns distances.
/// Row `i` is for candidate `i`: it has the place of this candidate and of each after it, m north and east of the place
/// that candidate `i` stated.
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

/// Returns the square of the distance within which two receivers agree, from their accuracies.
fn limit_squared(one: f32, other: f32, [least, most]: [f32; 2]) -> f32 {
    let limit = DEVIATIONS * DEVIATIONS * (one * one + other * other);
    let limit = if limit < least * least { least * least } else { limit };
    if limit > most * most { most * most } else { limit }
}

/// Returns the place `other` moved by its step, m north and east of `place`; and the square of its distance from
/// `place` moved by its own step, m².
fn apart((place, step): (&Place, [f32; 2]), (other, other_step): (&Place, [f32; 2])) -> ([f32; 2], f32) {
    let [north, east, up] = place.to(other, other_step);
    let (off_north, off_east) = (north - step[0], east - step[1]);
    ([north, east], off_north * off_north + off_east * off_east + up * up)
}

/// The place of a result, given as a member's place and a step from it, m north and east, with the accuracy of the
/// least accurate member, m.
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

fn spot<const N: usize>(inputs: &[Input; N], brought: &[Brought; N], places: &[[[f32; 2]; N]; N], members: u8) -> Spot {
    // The metres count from the first member's place, since that member's row has the places of all members.
    let place: Place = first(members, &inputs.each_ref().map(|input| input.fix.place));
    let row = first(members, places);
    let step = [0, 1].map(|axis| median(row.map(|place| place[axis]), members));
    Spot { place, step, accuracy: greatest(brought, |brought| brought.horizontal, members) }
}

/// The altitude of a result, `above` m above `ground_mm`, with the accuracy of the least accurate member, m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Height {
    ground_mm: i32,
    above: f32,
    accuracy: f32,
}

impl Height {
    /// Returns the altitude, m above the ellipsoid. If `above` is 0 it is exactly the altitude that was stated.
    fn altitude(&self) -> f64 {
        /// The sum of both heights is counted in 256ths of a mm, which integers hold exactly.
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

fn height<const N: usize>(inputs: &[Input; N], brought: &[Brought; N], with_altitude: u8) -> Height {
    let ground_mm = first(with_altitude, &inputs.each_ref().map(|input| input.fix.altitude_mm));
    let mut heights = [0.0; N];
    for (height, (input, brought)) in heights.iter_mut().zip(inputs.iter().zip(brought)) {
        *height = metres(input.fix.altitude_mm - ground_mm) + brought.climb;
    }
    let accuracy = greatest(brought, |brought| brought.vertical, with_altitude);
    Height { ground_mm, above: median(heights, with_altitude), accuracy }
}

fn greatest<const N: usize>(brought: &[Brought; N], of: impl Fn(&Brought) -> f32, among: u8) -> f32 {
    brought.iter().enumerate().fold(0.0, |greatest, (index, brought)| {
        let accuracy = if has(among, index) { of(brought) } else { 0.0 };
        if accuracy > greatest { accuracy } else { greatest }
    })
}

/// Returns the median of the members' attitudes, angles on the circle, if a quorum has one and each pair agrees.
fn attitude<const N: usize>(inputs: &[Input; N], members: u8) -> Option<[f32; 3]> {
    // Not covered: an angle beyond `ANGLE_MAX`, which no message can state: the 32 bits of NAV-ATT reach 375 rad.
    let oriented = members & mask_of(inputs, |input| are_within(input.attitude, ANGLE_MAX));
    let mut agree = is_quorum::<N>(oriented);
    let mut attitude = [0.0; 3];
    for (axis, from) in [-PI, 0.0, -PI].into_iter().enumerate() {
        let angles = axis_of(inputs, |input| input.attitude, axis, ANGLE_MAX);
        // The limits are far below half a turn. So two angles agree if their differences from the first angle agree.
        let (reference, differences) = about_first(angles, oriented);
        let (middle, spread) = median_and_spread(differences, oriented);
        agree &= spread <= ATTITUDE_LIMITS_RAD[axis];
        attitude[axis] = turned(reference + middle, from);
    }
    agree.then_some(attitude)
}

/// Returns the median of the members' accelerations by axis, if a quorum has one and each pair of them agrees.
fn acceleration<const N: usize>(inputs: &[Input; N], members: u8) -> Option<[f32; 3]> {
    // Not covered: an acceleration beyond the greatest `f32`, which no message can state: ESF-INS has 32 bits of 0.01
    // m/s².
    let moved = members & mask_of(inputs, |input| are_within(input.acceleration, f32::MAX));
    let mut agree = is_quorum::<N>(moved);
    let mut acceleration = [0.0; 3];
    for (axis, middle) in acceleration.iter_mut().enumerate() {
        // Not covered: an acceleration beyond the greatest `f32`, as above, for which `axis_of` returns 0.
        let values = axis_of(inputs, |input| input.acceleration, axis, f32::MAX);
        let spread;
        (*middle, spread) = median_and_spread(values, moved);
        agree &= spread <= ACCELERATION_LIMIT_M_S2;
    }
    agree.then_some(acceleration)
}
