//! A delivery flight: take-off, climb, cruise with turns, braking, hover over the recipient, landing.
//!
//! # Design
//!
//! Three plans describe the flight over time: height above the start, ground speed, and course. Each is a chain of
//! quintic ramps (the minimum-jerk polynomial) with constant values in between, so each plan and its first two
//! derivatives are continuous. The aircraft flies the way it points (yaw = course). The plans give directly:
//!
//! - the velocity: speed along the course, and the height's first derivative;
//! - the acceleration: the speed's derivative along the course, speed × turn rate across it, and the height's second
//!   derivative;
//! - the attitude: a rotorcraft pushes along its own vertical axis only, so that axis points along the required force,
//!   mass × (acceleration − gravity) plus drag. Pitch is negative (nose down) while it speeds up or cruises against
//!   drag, roll is positive (right side down) in a right turn.
//!
//! The position is the integral of the velocity by five-point Gauss-Legendre quadrature over a table of sums on a fixed
//! grid. Everything is a pure function of time and seed.
//!
//! # The length of a flight
//!
//! A flight fills the given duration with all its phases, so a run of 10 s shows a take-off and a landing too. If the
//! duration is below [`SHORTEST`], the run shows the beginning of a flight of [`SHORTEST`]. Before and after the flight
//! the aircraft stands on the ground.
//!
//! A short flight is low and slow, within the acceleration limits. A long flight climbs to [`HEIGHT_MAX`], cruises at
//! [`SPEED_MAX`] and has more legs, which curve so that the aircraft stays within a few kilometres.

use core::f64::consts::{PI, TAU};

use libm::{asin, atan2, cos, sin, sqrt};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Uniform};

use crate::geodesy::{Geodetic, TangentPlane};

/// The start of all flights: a field near Winterthur, 470 m above the ellipsoid.
pub const START: Geodetic = Geodetic { latitude: 47.4979, longitude: 8.7289, height: 470.0 };

/// Highest ground speed, m/s.
pub const SPEED_MAX: f64 = 16.0;
/// Highest rate of climb or descent, m/s.
pub const CLIMB_MAX: f64 = 4.5;
/// Greatest height above the start, m.
pub const HEIGHT_MAX: f64 = 60.0;
/// Greatest acceleration along the course, across it, and vertically, m/s² each.
pub const ACCELERATION_MAX: f64 = 3.5;
/// Shortest flight that is planned, s.
pub const SHORTEST: f64 = 8.0;
/// Longest flight that is planned, s: a day.
pub const LONGEST: f64 = 86_400.0;

/// Standard gravity, m/s².
const GRAVITY: f64 = 9.806_65;
/// Deceleration by drag per unit of speed, 1/s: 15° nose down at 16 m/s, as in small multicopters.
const DRAG: f64 = 0.16;
/// Peak slope of a quintic ramp that rises from 0 to 1 in unit time: 15/8, in the middle of the ramp.
const RAMP_SLOPE: f64 = 1.875;
/// Peak second derivative of a quintic ramp that rises from 0 to 1 in unit time: 10/√3.
const RAMP_CURVE: f64 = 5.773_502_691_896_258;
/// The time between two entries of the table that holds the distance flown, s.
const GRID: f64 = 0.1;

/// Position, motion and attitude of the aircraft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Position in WGS-84 coordinates.
    pub position: Geodetic,
    /// Position in the start's tangent plane, metres north, east, down.
    pub ned: [f64; 3],
    /// Velocity to north, east and down, m/s, in the directions of the start (within 1 mrad of the local ones).
    pub velocity: [f64; 3],
    /// Pitch, the nose above the horizon, rad, −π/2 ..= π/2.
    pub pitch: f64,
    /// Roll, right side down, rad, −π ..= π.
    pub roll: f64,
    /// Heading of the nose from true north, clockwise, rad, −π ..= π.
    pub yaw: f64,
    /// Acceleration in the body frame (front, right, down) without gravity, m/s²: zero at rest.
    pub acceleration: [f64; 3],
    /// Turn rates about the body axes front, right, down, rad/s.
    pub rates: [f64; 3],
}

/// A phase of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Phase {
    /// The aircraft stands on the ground before take-off.
    Standing,
    /// The aircraft takes off and climbs.
    Climb,
    /// The aircraft speeds up to cruise.
    Acceleration,
    /// The aircraft cruises, straight and in turns.
    Cruise,
    /// The aircraft slows down to a hover.
    Braking,
    /// The aircraft hovers over the recipient.
    Hover,
    /// The aircraft descends and touches down.
    Landing,
    /// The aircraft stands on the ground at the end.
    Landed,
}

/// A planned flight, whose state can be calculated at any instant.
#[derive(Debug, Clone)]
pub struct Flight {
    plane: TangentPlane,
    planned: f64,
    phase_ends: [f64; 7],
    height: Plan,
    speed: Plan,
    course: Plan,
    /// The distance flown north and east at each multiple of [`GRID`], m.
    sums: Vec<[f64; 2]>,
}

impl Flight {
    /// Returns the flight of `seed` that begins at [`START`] and fills `seconds`, between [`SHORTEST`] and [`LONGEST`].
    #[must_use]
    pub fn new(seed: u64, seconds: f64) -> Self {
        Self::from_start(seed, seconds, START)
    }

    /// Returns the flight of `seed` that begins at `start` and fills `seconds`.
    #[must_use]
    pub fn from_start(seed: u64, seconds: f64, start: Geodetic) -> Self {
        let planned = if seconds.is_nan() { SHORTEST } else { seconds.clamp(SHORTEST, LONGEST) };
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = move |low: f64, high: f64| {
            Uniform::new_inclusive(low, high).expect("the bounds of every draw are finite and ordered").sample(&mut rng)
        };

        // In a short flight each phase takes a fixed share of the time, in a long flight a fixed number of seconds. The
        // cruise fills the rest of a long flight.
        let standing = (0.03 * planned).min(2.0);
        let climb = (0.22 * planned).min(28.0);
        let acceleration = (0.15 * planned).min(11.0);
        let braking = (0.13 * planned).min(10.0);
        let hover = (0.08 * planned).min(12.0);
        let landing = (0.20 * planned).min(34.0);
        let landed = (0.02 * planned).min(2.0);
        let cruise = planned - standing - climb - acceleration - braking - hover - landing - landed;
        let mut end = 0.0;
        let phase_ends = [standing, climb, acceleration, cruise, braking, hover, landing].map(|share| {
            end += share;
            end
        });
        let [take_off, climbed, cruising, brake, hovering, descend, _] = phase_ends;

        // The recipient is slightly higher or lower than the start.
        let ground = draw(-0.1, 0.1);
        let height_gained = HEIGHT_MAX
            .min(ramp_limit(climb, CLIMB_MAX, ACCELERATION_MAX))
            .min(ramp_limit(landing, CLIMB_MAX, ACCELERATION_MAX) / 1.1);
        let mut height = Plan::starting_at(0.0);
        height.ramp(take_off, climb, height_gained);
        height.ramp(descend, landing, height_gained * (ground - 1.0));

        // The plan of the ground speed is limited only in its slope, which is the acceleration.
        let speed_reached = SPEED_MAX.min(ACCELERATION_MAX * acceleration.min(braking) / RAMP_SLOPE);
        let mut speed = Plan::starting_at(0.0);
        speed.ramp(climbed, acceleration, speed_reached);
        speed.ramp(brake, braking, -speed_reached);

        // A leg takes about 15 s and ends in a turn. Wide and narrow turns alternate, in opposite directions. Two legs
        // turn the aircraft by 45° on average, so the path of a long flight closes after sixteen legs.
        let mut course = Plan::starting_at(draw(-PI, PI));
        let side = if draw(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        let legs = (cruise / 15.0).ceil().max(2.0);
        let leg = cruise / legs;
        let mut at = cruising;
        // The number of legs is at most LONGEST / 15, so its conversion to u32 is exact.
        for number in 0..legs as u32 {
            let straight = leg * draw(0.25, 0.4);
            let turn = leg - straight;
            let wanted = if number % 2 == 0 { draw(54.0, 72.0) } else { -draw(12.0, 24.0) };
            let possible = ACCELERATION_MAX * turn / (RAMP_SLOPE * speed_reached);
            let angle = wanted.to_radians().clamp(-possible, possible);
            course.ramp(at + straight, turn, side * angle);
            at += leg;
        }

        let mut flight =
            Self { plane: TangentPlane::new(start), planned, phase_ends, height, speed, course, sums: vec![[0.0; 2]] };
        let mut sum = [0.0; 2];
        // The aircraft hovers from the instant `hovering` on, so the distance flown grows no further.
        for cell in 0..(hovering / GRID).ceil() as usize {
            let from = cell as f64 * GRID;
            let [north, east] = flight.distance(from, from + GRID);
            sum = [sum[0] + north, sum[1] + east];
            flight.sums.push(sum);
        }
        flight
    }

    /// The tangent plane at the start of the flight.
    #[must_use]
    pub fn plane(&self) -> &TangentPlane {
        &self.plane
    }

    /// The length of the flight, s. It includes the time on the ground before take-off and after landing.
    #[must_use]
    pub fn planned_seconds(&self) -> f64 {
        self.planned
    }

    /// The phase of the flight at instant `t` (s).
    #[must_use]
    pub fn phase(&self, t: f64) -> Phase {
        const PHASES: [Phase; 7] = [
            Phase::Standing,
            Phase::Climb,
            Phase::Acceleration,
            Phase::Cruise,
            Phase::Braking,
            Phase::Hover,
            Phase::Landing,
        ];
        PHASES.into_iter().zip(self.phase_ends).find(|(_, end)| t < *end).map_or(Phase::Landed, |(phase, _)| phase)
    }

    /// The state of the aircraft at `t` seconds.
    #[must_use]
    pub fn state(&self, t: f64) -> State {
        let pose = self.pose(t);
        let ned = self.ned(t);
        State {
            position: self.plane.to_geodetic(ned),
            ned,
            velocity: pose.velocity,
            pitch: pose.pitch,
            roll: pose.roll,
            yaw: wrap(pose.course),
            acceleration: pose.body_acceleration(),
            rates: self.rates(t),
        }
    }

    fn ned(&self, t: f64) -> [f64; 3] {
        let t = t.clamp(0.0, self.planned);
        let cell = ((t / GRID) as usize).min(self.sums.len() - 1);
        let [north, east] = self.sums[cell];
        let [more_north, more_east] = self.distance(cell as f64 * GRID, t);
        [north + more_north, east + more_east, -self.height.at(t)[0]]
    }

    /// The distance flown north and east between two instants, m, by five-point Gauss-Legendre quadrature.
    fn distance(&self, from: f64, to: f64) -> [f64; 2] {
        /// Abscissae and weights on −1 ..= 1 (Abramowitz and Stegun, table 25.4).
        const RULE: [(f64, f64); 5] = [
            (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
            (-0.538_469_310_105_683, 0.478_628_670_499_366_5),
            (0.0, 0.568_888_888_888_888_9),
            (0.538_469_310_105_683, 0.478_628_670_499_366_5),
            (0.906_179_845_938_664, 0.236_926_885_056_189_1),
        ];
        let (middle, half) = ((from + to) / 2.0, (to - from) / 2.0);
        let mut sum = [0.0; 2];
        for (abscissa, weight) in RULE {
            let t = middle + half * abscissa;
            let (speed, course) = (self.speed.at(t)[0], self.course.at(t)[0]);
            sum[0] += weight * half * speed * cos(course);
            sum[1] += weight * half * speed * sin(course);
        }
        sum
    }

    fn pose(&self, t: f64) -> Pose {
        let [_, climb, climb_rate] = self.height.at(t);
        let [speed, speed_rate, _] = self.speed.at(t);
        let [course, turn_rate, _] = self.course.at(t);
        // The components point front, right and down in the level frame along the course.
        let acceleration = [speed_rate, speed * turn_rate, -climb_rate];
        let force = [acceleration[0] + DRAG * speed, acceleration[1], acceleration[2] - DRAG * climb - GRAVITY];
        let total = sqrt(force.iter().map(|f| f * f).sum());
        Pose {
            course,
            velocity: [speed * cos(course), speed * sin(course), -climb],
            acceleration,
            // The rotors push upwards along the body's vertical axis: force = −total × the body's down axis.
            pitch: atan2(-force[0], -force[2]),
            roll: asin((force[1] / total).clamp(-1.0, 1.0)),
        }
    }

    /// Turn rates about the body axes, rad/s, as central differences of the attitude.
    fn rates(&self, t: f64) -> [f64; 3] {
        const STEP: f64 = 0.5e-3;
        let (before, now, after) = (self.pose(t - STEP), self.pose(t), self.pose(t + STEP));
        let rate = |angle: fn(&Pose) -> f64| (angle(&after) - angle(&before)) / (2.0 * STEP);
        let (roll, pitch, yaw) = (rate(|p| p.roll), rate(|p| p.pitch), rate(|p| p.course));
        let (sr, cr) = (sin(now.roll), cos(now.roll));
        let (sp, cp) = (sin(now.pitch), cos(now.pitch));
        [roll - yaw * sp, pitch * cr + yaw * sr * cp, yaw * cr * cp - pitch * sr]
    }
}

/// The parts of a flight's state at one instant that follow from the plans directly, without an integral over time.
struct Pose {
    /// The course as a continuous angle, which may exceed ±π.
    course: f64,
    velocity: [f64; 3],
    /// The acceleration front, right and down in the level frame along the course.
    acceleration: [f64; 3],
    pitch: f64,
    roll: f64,
}

impl Pose {
    /// Returns the acceleration in the body frame, for an aircraft that is turned by its pitch and then by its roll.
    fn body_acceleration(&self) -> [f64; 3] {
        let [x, y, z] = self.acceleration;
        let (sr, cr) = (sin(self.roll), cos(self.roll));
        let (sp, cp) = (sin(self.pitch), cos(self.pitch));
        let pitched = sp * x + cp * z;
        [cp * x - sp * z, cr * y + sr * pitched, cr * pitched - sr * y]
    }
}

/// The largest change that a quintic ramp of `duration` can make while its first derivative stays within `slope` and
/// its second within `curve`.
fn ramp_limit(duration: f64, slope: f64, curve: f64) -> f64 {
    (slope * duration / RAMP_SLOPE).min(curve * duration * duration / RAMP_CURVE)
}

fn wrap(angle: f64) -> f64 {
    angle - TAU * libm::round(angle / TAU)
}

/// A quantity of the flight over time: it changes by quintic ramps, and is constant between them.
#[derive(Debug, Clone)]
struct Plan {
    initial: f64,
    ramps: Vec<Ramp>,
}

#[derive(Debug, Clone, Copy)]
struct Ramp {
    start: f64,
    duration: f64,
    from: f64,
    change: f64,
}

impl Plan {
    fn starting_at(initial: f64) -> Self {
        Self { initial, ramps: Vec::new() }
    }

    fn ramp(&mut self, start: f64, duration: f64, change: f64) {
        let (from, free) = self
            .ramps
            .last()
            .map_or((self.initial, f64::NEG_INFINITY), |last| (last.from + last.change, last.start + last.duration));
        // A rounding error may put the planned start slightly before the end of the previous ramp.
        assert!(duration > 0.0 && start >= free - 1e-6, "ramps follow one another");
        self.ramps.push(Ramp { start: start.max(free), duration, from, change });
    }

    fn at(&self, t: f64) -> [f64; 3] {
        let Some(ramp) = self.ramps[..self.ramps.partition_point(|ramp| ramp.start <= t)].last() else {
            return [self.initial, 0.0, 0.0];
        };
        let u = (t - ramp.start) / ramp.duration;
        if u >= 1.0 {
            return [ramp.from + ramp.change, 0.0, 0.0];
        }
        [
            ramp.from + ramp.change * u * u * u * (10.0 + u * (6.0 * u - 15.0)),
            ramp.change / ramp.duration * 30.0 * u * u * (1.0 - u) * (1.0 - u),
            ramp.change / (ramp.duration * ramp.duration) * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u),
        ]
    }
}
