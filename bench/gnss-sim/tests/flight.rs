//! Tests that a flight moves as an aircraft can move.

use gnss_sim::flight::{ACCELERATION_MAX, CLIMB_MAX, HEIGHT_MAX, LONGEST, Phase, SHORTEST, SPEED_MAX, START};
use gnss_sim::{Flight, State};

const DURATIONS: [f64; 5] = [0.5, 10.0, 37.0, 240.0, 1_500.0];

/// Instants spread over a flight, none of which is the start or the end of a phase.
fn instants(flight: &Flight) -> impl Iterator<Item = f64> {
    let step = flight.planned_seconds() / 2_003.0;
    (0..2_003).map(move |i| f64::from(i) * step + 0.000_37)
}

fn length(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn difference(a: [f64; 3], b: [f64; 3]) -> f64 {
    length(&[a[0] - b[0], a[1] - b[1], a[2] - b[2]])
}

/// Converts a vector of the body frame to north, east, down by yaw, pitch and roll in the aerospace sequence.
fn to_ned(state: &State, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let (sr, cr) = state.roll.sin_cos();
    let (sp, cp) = state.pitch.sin_cos();
    let (sy, cy) = state.yaw.sin_cos();
    let (y, z) = (cr * y - sr * z, sr * y + cr * z);
    let (x, z) = (cp * x + sp * z, cp * z - sp * x);
    [cy * x - sy * y, sy * x + cy * y, z]
}

#[test]
fn speed_climb_and_acceleration_stay_within_their_limits() {
    for (seed, seconds) in (0..).zip(DURATIONS) {
        let flight = Flight::new(seed, seconds);
        for t in instants(&flight) {
            let state = flight.state(t);
            let [north, east, down] = state.velocity;
            assert!(north.hypot(east) <= SPEED_MAX * 1.000_001, "{t} {state:?}");
            assert!(down.abs() <= CLIMB_MAX * 1.000_001, "{t} {state:?}");
            assert!(length(&state.acceleration) <= ACCELERATION_MAX * 1.8, "{t} {state:?}");
            assert!(-state.ned[2] <= HEIGHT_MAX * 1.000_001 && -state.ned[2] >= -HEIGHT_MAX * 0.1, "{t} {state:?}");
            assert!(state.pitch.abs() < 0.6 && state.roll.abs() < 0.6, "{t} {state:?}");
        }
    }
}

#[test]
fn velocity_is_the_derivative_of_position_and_acceleration_that_of_velocity() {
    const H: f64 = 1e-3;
    for (seed, seconds) in (10..).zip(DURATIONS) {
        let flight = Flight::new(seed, seconds);
        for t in instants(&flight) {
            let (before, state, after) = (flight.state(t - H), flight.state(t), flight.state(t + H));
            let slope = |f: fn(&State) -> [f64; 3]| {
                let (a, b) = (f(&before), f(&after));
                [0, 1, 2].map(|i| (b[i] - a[i]) / (2.0 * H))
            };
            assert!(difference(slope(|s| s.ned), state.velocity) < 1e-4, "{t} {state:?}");
            let acceleration = to_ned(&state, state.acceleration);
            assert!(difference(slope(|s| s.velocity), acceleration) < 5e-3, "{t} {state:?}");
        }
    }
}

#[test]
fn nothing_jumps() {
    const H: f64 = 1e-3;
    let flight = Flight::new(3, 10.0);
    let mut last = flight.state(-1.0);
    for i in -1_000..=11_000 {
        let state = flight.state(f64::from(i) * H);
        assert!(difference(last.ned, state.ned) < 0.01);
        assert!(difference(last.velocity, state.velocity) < 0.01);
        assert!(difference(last.acceleration, state.acceleration) < 0.05);
        assert!((state.roll - last.roll).abs() < 0.01 && (state.pitch - last.pitch).abs() < 0.01);
        let turned = (state.yaw - last.yaw).abs();
        assert!(turned.min(core::f64::consts::TAU - turned) < 0.01);
        last = state;
    }
}

#[test]
fn the_rotors_push_along_the_body_axis() {
    // An accelerometer measures acceleration minus gravity. For a rotorcraft that difference points along its vertical
    // axis, apart from drag against the direction of flight.
    let flight = Flight::new(5, 240.0);
    let mut tilted = 0;
    for t in instants(&flight) {
        let state = flight.state(t);
        let [x, y, z] = to_ned(&state, state.acceleration);
        let push =
            [x + 0.16 * state.velocity[0], y + 0.16 * state.velocity[1], z + 0.16 * state.velocity[2] - 9.806_65];
        let up = to_ned(&state, [0.0, 0.0, -length(&push)]);
        assert!(difference(push, up) < 1e-9, "{t} {state:?}");
        tilted += usize::from(state.roll.abs() > 0.1);
    }
    assert!(tilted > 100, "it banks in its turns");
}

#[test]
fn turn_rates_turn_the_attitude() {
    // The attitude after a small step of time must be the attitude before, turned by the stated turn rates.
    const H: f64 = 1e-3;
    let flight = Flight::new(6, 60.0);
    for t in instants(&flight) {
        let (state, after) = (flight.state(t), flight.state(t + H));
        let [p, q, r] = state.rates;
        for (axis, moved) in
            [([1.0, 0.0, 0.0], [0.0, r, -q]), ([0.0, 1.0, 0.0], [-r, 0.0, p]), ([0.0, 0.0, 1.0], [q, -p, 0.0])]
        {
            let then = [0, 1, 2].map(|i| axis[i] + H * moved[i]);
            assert!(difference(to_ned(&after, axis), to_ned(&state, then)) < 5e-6, "{t} {state:?}");
        }
    }
}

#[test]
fn every_flight_has_all_its_phases_and_ends_on_the_ground() {
    for seconds in [10.0, 45.0, 600.0] {
        let flight = Flight::new(8, seconds);
        assert_eq!(flight.planned_seconds(), seconds);
        let mut phases: Vec<_> = instants(&flight).map(|t| flight.phase(t)).collect();
        assert!(phases.is_sorted());
        phases.dedup();
        assert_eq!(phases.len(), 8, "{phases:?}");

        let fastest = instants(&flight).map(|t| length(&flight.state(t).velocity[..2])).fold(0.0, f64::max);
        let highest = instants(&flight).map(|t| -flight.state(t).ned[2]).fold(0.0, f64::max);
        assert!(fastest > 2.0 && highest > 2.0, "{seconds}: {fastest} m/s, {highest} m");
        let courses: Vec<_> =
            instants(&flight).filter(|t| flight.phase(*t) == Phase::Cruise).map(|t| flight.state(t).rates[2]).collect();
        assert!(courses.iter().any(|r| *r > 0.03) && courses.iter().any(|r| *r < -0.03), "it turns both ways");

        let hover = instants(&flight).find(|t| flight.phase(*t) == Phase::Hover).map(|t| flight.state(t));
        assert!(hover.is_some_and(|s| length(&s.velocity) < 1e-9 && length(&s.acceleration) < 1e-9));
        let (start, end) = (flight.state(0.0), flight.state(seconds));
        assert_eq!(start.velocity.map(f64::abs), [0.0; 3]);
        assert!(length(&end.velocity) == 0.0 && end.pitch == 0.0 && end.roll == 0.0);
        assert_eq!(flight.state(seconds * 2.0), end, "it stays where it landed");
    }
}

#[test]
fn it_starts_where_it_should_and_stays_within_reach() {
    let flight = Flight::new(1, 3_600.0);
    let start = flight.state(0.0).position;
    assert!((start.latitude - START.latitude).abs() < 1e-12 && (start.longitude - START.longitude).abs() < 1e-12);
    assert!((start.height - START.height).abs() < 1e-8);
    for t in instants(&flight) {
        let state = flight.state(t);
        assert!(length(&state.ned[..2]) < 3_000.0, "{t} {state:?}");
        let back = flight.plane().to_ned(state.position);
        assert!(difference(back, state.ned) < 1e-7);
    }
}

#[test]
fn a_flight_is_a_function_of_seed_and_time() {
    let (a, again, other) = (Flight::new(7, 30.0), Flight::new(7, 30.0), Flight::new(8, 30.0));
    // The state at an instant must not depend on the order in which instants are queried.
    let forth: Vec<_> = instants(&a).map(|t| a.state(t)).collect();
    let mut back: Vec<_> = instants(&a).collect::<Vec<_>>().into_iter().rev().map(|t| again.state(t)).collect();
    back.reverse();
    assert_eq!(forth, back);
    assert_ne!(a.state(15.0).position, other.state(15.0).position);
}

#[test]
fn durations_out_of_range_are_clamped() {
    for (asked, planned) in [(0.0, SHORTEST), (-3.0, SHORTEST), (f64::NAN, SHORTEST), (f64::INFINITY, LONGEST)] {
        assert_eq!(Flight::new(0, asked).planned_seconds(), planned);
    }
}
