//! Places on the ellipsoid, and vectors in metres between them
//!
//! # Design
//!
//! Distances between places are small against the earth, and a float32 has only 24 bits. So a float32 never holds a
//! position, but only differences of two positions, which integers give exactly. That lets the processor's own
//! arithmetic, which has only float32, do all but the last step.
//!
//! The vector from one place to another is the difference of their positions in space, seen along north, east and up of
//! the first place. No term of it is the small difference of two large ones. Latitudes enter as their difference.
//! Longitudes enter by sine and by 1 - cosine = 2 sine² of half of their difference. The cosine of a latitude is the
//! sine of its complement to 90°, computed in integers. So the vector is right across ±180° and around the poles. For
//! places far apart the vector is long in any direction, since its part along up is never left out.
//!
//! The vector leaves out the change of the radii of curvature between the two places, 2e-6 of the distance at 1 km, and
//! the square of the difference of the latitudes, 3e-9. With the rounding of float32 the error is below 5 mm at 1 km,
//! and below 0.1 mm over the 30 m within which two receivers can agree.

/// The semi-major axis of the WGS-84 ellipsoid, m (NIMA TR8350.2, table 3.1).
const SEMI_MAJOR_AXIS: f64 = 6_378_137.0;
/// The flattening of the WGS-84 ellipsoid (NIMA TR8350.2, table 3.1).
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// The square of the ellipsoid's first eccentricity, f (2 - f).
const E2: f64 = FLATTENING * (2.0 - FLATTENING);

const HALF_TURN_E7: i32 = 1_800_000_000;
const QUARTER_TURN_E7: i32 = 900_000_000;
/// A ten-millionth of a degree, the unit of the integers, in rad.
const RAD_PER_E7: f32 = (core::f64::consts::PI / 1.8e9) as f32;
/// The result is counted in 256ths of 1e-7 degrees, 0.04 mm each, before it is converted to degrees.
const PARTS: i64 = 256;
const PARTS_PER_RAD: f32 = (1.8e9 * 256.0 / core::f64::consts::PI) as f32;

/// A place on the ellipsoid, and the values that measuring around it needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    latitude_e7: i32,
    longitude_e7: i32,
    sine: f32,
    cosine: f32,
    /// The radius of curvature along the meridian, m, at the place's own height.
    along: f32,
    across: f32,
}

impl Place {
    /// Returns a place at a latitude of at most ±90° and a longitude of at most ±180°, `height` m above the ellipsoid.
    pub(crate) fn new(latitude_e7: i32, longitude_e7: i32, height: f32) -> Self {
        const A: f32 = SEMI_MAJOR_AXIS as f32;
        const A_ALONG: f32 = (SEMI_MAJOR_AXIS * (1.0 - E2)) as f32;
        const E2_: f32 = E2 as f32;
        let sine = sine(latitude_e7 as f32 * RAD_PER_E7);
        let cosine = self::sine((QUARTER_TURN_E7 - latitude_e7.abs()) as f32 * RAD_PER_E7);
        // The radii are a / √(1 - w) and a (1 - e²) / √(1 - w)³ as series; the next term of either is below 1e-8.
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

    /// Returns the metres north, east and up from this place to `other`, moved by `step` metres north and east.
    pub(crate) fn to(&self, other: &Self, step: [f32; 2]) -> [f32; 3] {
        // Both latitudes are at most ±90°, so the difference is at most 180°.
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

        // The directions of north and east at the other place differ from those at this place.
        let [step_north, step_east] = step;
        let straight = self.sine * other.sine * turn_cosine + self.cosine * other.cosine;
        [
            north + step_north * straight + step_east * self.sine * turn_sine,
            east - step_north * other.sine * turn_sine + step_east * turn_cosine,
            up,
        ]
    }

    /// Returns latitude and longitude, degrees, of the point `north` and `east` metres from this place, at most some
    /// hundred. Without a step the result is exactly the position that was stated.
    pub(crate) fn degrees(&self, [north, east]: [f32; 2]) -> [f64; 2] {
        // `away` is the point's distance from the earth's axis, and `outward` the part of that distance in the
        // direction of this place.
        let outward = self.across * self.cosine - north * self.sine;
        let away = libm::sqrtf(outward * outward + east * east);
        let ahead = outward >= 0.0;
        // `half_turn` is the tangent of half of the change in longitude. Beyond the pole it is the tangent of half of
        // the change's complement to 180°. At the pole the least positive number avoids a division by 0.
        let half_turn = east / at_least(away + if ahead { outward } else { -outward }, f32::MIN_POSITIVE);
        let turn = 2.0 * arc_tangent(half_turn);
        let (turn, bulge) =
            if ahead { (turn, east * half_turn) } else { (core::f32::consts::PI - turn, away - outward) };
        let rise = (north - self.sine * bulge) / self.along;

        let quarter = i64::from(QUARTER_TURN_E7) * PARTS;
        // Not covered: the saturation of the conversion, since the rise is a small part of a turn; and the clamp, since
        // a point beyond a pole is computed on the pole's other side, so that only a rounding error could exceed the
        // pole.
        let latitude = (i64::from(self.latitude_e7) * PARTS + parts(rise)).clamp(-quarter, quarter);
        // Not covered: the saturation of the conversion, since `turn` is at most half a turn.
        let longitude = i64::from(self.longitude_e7) * PARTS + parts(turn);
        let half = 2 * quarter;
        let over = if longitude > half { -2 * half } else { 0 };
        let under = if longitude < -half { 2 * half } else { 0 };
        [latitude, longitude + over + under].map(|parts| parts as f64 / (1e7 * PARTS as f64))
    }
}

fn parts(rad: f32) -> i64 {
    (rad * PARTS_PER_RAD) as i64
}

fn shorter_way(difference_e7: i64) -> i32 {
    let half = i64::from(HALF_TURN_E7);
    let over = if difference_e7 > half { -2 * half } else { 0 };
    let under = if difference_e7 < -half { 2 * half } else { 0 };
    (difference_e7 + over + under) as i32
}

/// Returns the sine of an angle of at most ±90° by Taylor's series to the eleventh power. The next term is 6e-8 of the
/// result at 90°.
fn sine(rad: f32) -> f32 {
    const TERMS: [f32; 6] = [1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5_040.0, 1.0 / 362_880.0, -1.0 / 39_916_800.0];
    rad * series(rad * rad, TERMS)
}

/// Returns the arc tangent of at most ±1: that of half the angle by the series to the thirteenth power, doubled. The
/// next term is 3e-7 of the result at 45°.
fn arc_tangent(tangent: f32) -> f32 {
    const TERMS: [f32; 7] = [1.0, -1.0 / 3.0, 1.0 / 5.0, -1.0 / 7.0, 1.0 / 9.0, -1.0 / 11.0, 1.0 / 13.0];
    let half = tangent / (1.0 + libm::sqrtf(1.0 + tangent * tangent));
    2.0 * half * series(half * half, TERMS)
}

fn series<const K: usize>(x: f32, terms: [f32; K]) -> f32 {
    terms.iter().rev().fold(0.0, |sum, term| sum * x + term)
}

fn at_least(value: f32, least: f32) -> f32 {
    if value > least { value } else { least }
}

#[cfg(test)]
mod tests {
    use super::*;

    use proptest::prelude::*;
    use proptest::test_runner::{Config, RngSeed};

    /// The semi-minor axis of the WGS-84 ellipsoid, m (NIMA TR8350.2, table 3.3). The tests compute positions in space
    /// with it, in float64 and independently of the code.
    const SEMI_MINOR_AXIS: f64 = 6_356_752.314_2;

    type Vector = [f64; 3];

    /// A place with the values that `Place::new` takes, by which the tests compute in space without approximations.
    #[derive(Clone, Copy, Debug)]
    struct Exact {
        latitude_e7: i32,
        longitude_e7: i32,
        height: f64,
    }

    impl Exact {
        fn place(&self) -> Place {
            Place::new(self.latitude_e7, self.longitude_e7, self.height as f32)
        }

        fn angles(&self) -> [f64; 2] {
            [self.latitude_e7, self.longitude_e7].map(|e7| (f64::from(e7) / 1e7).to_radians())
        }

        fn in_space(&self) -> Vector {
            let ([latitude, longitude], [a, b]) = (self.angles(), [SEMI_MAJOR_AXIS, SEMI_MINOR_AXIS]);
            let across = a * a / (a * a * latitude.cos().powi(2) + b * b * latitude.sin().powi(2)).sqrt();
            let out = (across + self.height) * latitude.cos();
            let along_axis = (across * (b / a).powi(2) + self.height) * latitude.sin();
            [out * longitude.cos(), out * longitude.sin(), along_axis]
        }

        fn axes(&self) -> [Vector; 3] {
            let [(north, along), (east, out)] = self.angles().map(f64::sin_cos);
            [[-north * out, -north * east, along], [-east, out, 0.0], [along * out, along * east, north]]
        }

        /// Returns the metres north, east and up from this place to `other`. `other` is taken at this place's height,
        /// and moved by `step` north and east.
        fn to(&self, other: &Self, step: [f32; 2]) -> Vector {
            let other = Self { height: self.height, ..*other };
            let [north, east, _] = other.axes();
            let step = sum(scaled(north, step[0].into()), scaled(east, step[1].into()));
            let way = sum(sum(other.in_space(), step), scaled(self.in_space(), -1.0));
            self.axes().map(|axis| (0..3).map(|at| axis[at] * way[at]).sum())
        }
    }

    fn sum(one: Vector, other: Vector) -> Vector {
        [one[0] + other[0], one[1] + other[1], one[2] + other[2]]
    }

    fn scaled(vector: Vector, by: f64) -> Vector {
        vector.map(|axis| axis * by)
    }

    fn length(vector: Vector) -> f64 {
        vector.iter().map(|axis| axis * axis).sum::<f64>().sqrt()
    }

    /// Draws any place that a receiver can state. One in four is within some km of a pole, one in four near ±180°.
    fn anywhere() -> impl Strategy<Value = Exact> {
        let latitude = prop_oneof![
            3 => -QUARTER_TURN_E7..=QUARTER_TURN_E7,
            1 => (0..=1_000_000, any::<bool>())
                .prop_map(|(off, south)| if south { off - QUARTER_TURN_E7 } else { QUARTER_TURN_E7 - off }),
        ];
        let longitude = prop_oneof![
            3 => -HALF_TURN_E7..=HALF_TURN_E7,
            1 => (0..=1_000_000, any::<bool>())
                .prop_map(|(off, west)| if west { off - HALF_TURN_E7 } else { HALF_TURN_E7 - off }),
        ];
        (latitude, longitude, -1_000_000..=20_000_000_i32).prop_map(|(latitude_e7, longitude_e7, height_mm)| Exact {
            latitude_e7,
            longitude_e7,
            height: f64::from(height_mm) / 1e3,
        })
    }

    /// Returns the place about `north` and `east` metres from `here`, as a receiver would state it.
    fn beside(here: &Exact, north: f64, east: f64) -> Exact {
        let [axis_north, axis_east, _] = here.axes();
        let there = sum(here.in_space(), sum(scaled(axis_north, north), scaled(axis_east, east)));
        let out = there[0].hypot(there[1]);
        let mut latitude = there[2].atan2(out);
        let e2 = 1.0 - (SEMI_MINOR_AXIS / SEMI_MAJOR_AXIS).powi(2);
        for _ in 0..20 {
            let across = SEMI_MAJOR_AXIS / (1.0 - e2 * latitude.sin().powi(2)).sqrt();
            latitude = (there[2] + e2 * across * latitude.sin()).atan2(out);
        }
        let e7 = |angle: f64| (angle.to_degrees() * 1e7).round() as i32;
        Exact { latitude_e7: e7(latitude), longitude_e7: e7(there[1].atan2(there[0])), height: here.height }
    }

    fn seeded(cases: u32) -> Config {
        Config { cases, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..Config::default() }
    }

    proptest! {
        #![proptest_config(seeded(20_000))]

        #[test]
        fn the_way_to_a_place_has_the_accuracy_that_is_stated(
            here in anywhere(),
            way in (-700.0..=700.0_f64, -700.0..=700.0_f64),
            step in prop_oneof![Just([0.0, 0.0]), [-10.0..=10.0_f32, -10.0..=10.0_f32]],
        ) {
            for (share, error) in [(1.0, 5e-3), (0.025, 1e-4)] {
                let there = beside(&here, share * way.0, share * way.1);
                let step = step.map(|axis| axis * share as f32);
                let (found, exact) = (here.place().to(&there.place(), step), here.to(&there, step));
                let off = length(sum(found.map(f64::from), scaled(exact, -1.0)));
                prop_assert!(off < error, "{found:?} for {exact:?} of {there:?}: {off} m");
            }
        }

        #[test]
        fn places_that_are_far_apart_are_far_apart(here in anywhere(), there in anywhere()) {
            let found = length(here.place().to(&there.place(), [0.0; 2]).map(f64::from));
            let exact = length(here.to(&there, [0.0; 2]));
            prop_assert!(found >= 0.5 * exact, "{found} m for {exact} m");
        }

        /// The step moves `other` and may lead over a pole or over ±180°. The places are rounded to 1e-7 degrees, which
        /// is 11 mm.
        #[test]
        fn what_lies_a_step_away_is_where_the_step_leads(
            here in anywhere(),
            step in [-300.0..=300.0_f32, -300.0..=300.0_f32],
        ) {
            let [latitude, longitude] = here.place().degrees(step);
            prop_assert!(latitude.abs() <= 90.0 && longitude.abs() <= 180.0, "{latitude} {longitude}");
            let e7 = |degrees: f64| (degrees * 1e7).round() as i32;
            let there = Exact { latitude_e7: e7(latitude), longitude_e7: e7(longitude), ..here };
            let exact = beside(&here, step[0].into(), step[1].into());
            let between = length(there.to(&exact, [0.0; 2]));
            prop_assert!(between < 0.03, "{there:?} for {exact:?}: {between} m");
        }
    }
}
