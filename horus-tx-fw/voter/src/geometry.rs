//! Places on the ellipsoid, and metres between them
//!
//! # Design
//!
//! Whatever two places have to do with each other is small beside the earth, and a float32 has 24 bits: so no position
//! is ever a float32, only differences of two are, which integers give exactly. That leaves the processor's own
//! arithmetic for everything but the last step of the result.
//!
//! The vector from one place to another is the difference of their positions in space, seen along north, east and up
//! of the first. Its terms are arranged so that none is the small difference of two large ones: the latitudes only
//! enter as their difference, the longitudes by sine and by 1 - cosine = 2 sine² of half of theirs, and the cosine of a
//! latitude is the sine of what is missing to 90°, taken in integers. So it holds across ±180° and around the poles,
//! and for places that are far apart it is long, whatever its direction: its part along up is never forgotten.
//!
//! Left out: the change of the radii of curvature between the two, 2e-6 of the distance at 1 km, and the square of the
//! difference of the latitudes, 3e-9. With the rounding of float32 the error is below 5 mm at 1 km, and below 0.1 mm
//! over the 30 m within which two receivers can agree.

/// Semi-major axis of the WGS-84 ellipsoid, m (NIMA TR8350.2, table 3.1).
const SEMI_MAJOR_AXIS: f64 = 6_378_137.0;
/// Flattening of the WGS-84 ellipsoid (NIMA TR8350.2, table 3.1).
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// First eccentricity squared, f (2 - f).
const E2: f64 = FLATTENING * (2.0 - FLATTENING);

/// Half a turn, 1e-7 degrees.
const HALF_TURN_E7: i32 = 1_800_000_000;
/// A quarter of a turn, 1e-7 degrees.
const QUARTER_TURN_E7: i32 = 900_000_000;
/// 1e-7 degrees in rad.
const RAD_PER_E7: f32 = (core::f64::consts::PI / 1.8e9) as f32;
/// The result is counted in so many parts of 1e-7 degrees, each 0.04 mm, before it becomes degrees.
const PARTS: i64 = 256;
/// rad in those parts.
const PARTS_PER_RAD: f32 = (1.8e9 * 256.0 / core::f64::consts::PI) as f32;

/// A place on the ellipsoid, and how to measure around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    latitude_e7: i32,
    longitude_e7: i32,
    sine: f32,
    cosine: f32,
    /// Radius of curvature along the meridian, and across it, at the place's own height, m.
    along: f32,
    across: f32,
}

impl Place {
    /// At a latitude of at most ±90° and a longitude of at most ±180°, `height` m above the ellipsoid.
    pub(crate) fn new(latitude_e7: i32, longitude_e7: i32, height: f32) -> Self {
        const A: f32 = SEMI_MAJOR_AXIS as f32;
        const A_ALONG: f32 = (SEMI_MAJOR_AXIS * (1.0 - E2)) as f32;
        const E2_: f32 = E2 as f32;
        let sine = sine(latitude_e7 as f32 * RAD_PER_E7);
        let cosine = self::sine((QUARTER_TURN_E7 - latitude_e7.abs()) as f32 * RAD_PER_E7);
        // a / √(1 - w) and a (1 - e²) / √(1 - w)³ as series; the next term of either is below 1e-8.
        let w = E2_ * sine * sine;
        Self {
            latitude_e7,
            longitude_e7,
            sine,
            cosine,
            along: A_ALONG * (1.0 + w * (3.0 / 2.0 + w * (15.0 / 8.0 + w * (35.0 / 16.0)))) + height,
            across: A * (1.0 + w * (1.0 / 2.0 + w * (3.0 / 8.0 + w * (5.0 / 16.0)))) + height,
        }
    }

    /// Metres north, east and up of this place, to `other` and `step` metres north and east of that.
    pub(crate) fn to(&self, other: &Self, step: [f32; 2]) -> [f32; 3] {
        // Both are at most ±90°, so the difference is at most 180°.
        let northward = (other.latitude_e7 - self.latitude_e7) as f32 * RAD_PER_E7;
        let eastward = shorter_way(i64::from(other.longitude_e7) - i64::from(self.longitude_e7));
        let half = sine(eastward as f32 * (RAD_PER_E7 / 2.0));
        let other_half = sine((HALF_TURN_E7 - eastward.abs()) as f32 * (RAD_PER_E7 / 2.0));
        let (turn_sine, turn_versine) = (2.0 * half * other_half, 2.0 * half * half);
        let turn_cosine = 1.0 - turn_versine;

        let round = other.cosine * turn_versine;
        let north = self.along * northward + self.across * self.sine * round;
        let east = self.across * other.cosine * turn_sine;
        let up = -self.across * (0.5 * northward * northward + self.cosine * round);

        // North and east of the other place point elsewhere than here.
        let [step_north, step_east] = step;
        let straight = self.sine * other.sine * turn_cosine + self.cosine * other.cosine;
        [
            north + step_north * straight + step_east * self.sine * turn_sine,
            east - step_north * other.sine * turn_sine + step_east * turn_cosine,
            up,
        ]
    }

    /// Latitude and longitude, degrees, of what lies `north` and `east` metres of here, at most some hundred. Without
    /// a step exactly what was stated.
    pub(crate) fn degrees(&self, [north, east]: [f32; 2]) -> [f64; 2] {
        // Away from the earth's axis, here and there.
        let outward = self.across * self.cosine - north * self.sine;
        let away = libm::sqrtf(outward * outward + east * east);
        let ahead = outward >= 0.0;
        // Tangent of half the turn, or beyond the pole of what is missing to half a turn; at the pole itself 0 / tiny.
        let half_turn = east / at_least(away + if ahead { outward } else { -outward }, f32::MIN_POSITIVE);
        let turn = 2.0 * arc_tangent(half_turn);
        let round = if east < 0.0 { -core::f32::consts::PI } else { core::f32::consts::PI };
        let (turn, bulge) = if ahead { (turn, east * half_turn) } else { (round - turn, away - outward) };
        let rise = (north - self.sine * bulge) / self.along;

        let quarter = i64::from(QUARTER_TURN_E7) * PARTS;
        let latitude = (i64::from(self.latitude_e7) * PARTS + parts(rise)).clamp(-quarter, quarter);
        let longitude = i64::from(self.longitude_e7) * PARTS + parts(turn);
        let half = 2 * quarter;
        let over = if longitude > half { -2 * half } else { 0 };
        let under = if longitude < -half { 2 * half } else { 0 };
        [latitude, longitude + over + under].map(|parts| parts as f64 / (1e7 * PARTS as f64))
    }
}

/// An angle in parts of 1e-7 degrees.
fn parts(rad: f32) -> i64 {
    (rad * PARTS_PER_RAD) as i64
}

/// The difference of two longitudes, 1e-7 degrees, brought into ±180°.
fn shorter_way(difference_e7: i64) -> i32 {
    let half = i64::from(HALF_TURN_E7);
    let over = if difference_e7 > half { -2 * half } else { 0 };
    let under = if difference_e7 < -half { 2 * half } else { 0 };
    (difference_e7 + over + under) as i32
}

/// Sine of at most ±90°: Taylor's series to the eleventh power. The next term is 6e-8 of the result at 90°.
fn sine(rad: f32) -> f32 {
    const TERMS: [f32; 6] = [1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5_040.0, 1.0 / 362_880.0, -1.0 / 39_916_800.0];
    rad * series(rad * rad, TERMS)
}

/// Arc tangent of at most ±1: of half the angle, then the series to the thirteenth power. The next term is 3e-7 of the
/// result at 45°.
fn arc_tangent(tangent: f32) -> f32 {
    const TERMS: [f32; 7] = [1.0, -1.0 / 3.0, 1.0 / 5.0, -1.0 / 7.0, 1.0 / 9.0, -1.0 / 11.0, 1.0 / 13.0];
    let half = tangent / (1.0 + libm::sqrtf(1.0 + tangent * tangent));
    2.0 * half * series(half * half, TERMS)
}

/// Σ terms\[k\] xᵏ.
fn series<const K: usize>(x: f32, terms: [f32; K]) -> f32 {
    terms.iter().rev().fold(0.0, |sum, term| sum * x + term)
}

fn at_least(value: f32, least: f32) -> f32 {
    if value > least { value } else { least }
}
