//! Tests generated receivers, each with its own rate, noise, delay and clock.

use std::sync::Arc;

use gnss_sim::receiver::BIT_RATE;
use gnss_sim::ubx;
use gnss_sim::{Burst, Flight, Model, Receiver};
use ublox::{
    ParserBuilder, UbxPacket,
    proto27::{PacketRef, Proto27},
};

const SECONDS: f64 = 60.0;

fn flight() -> Arc<Flight> {
    Arc::new(Flight::new(1, SECONDS))
}

fn bursts(index: usize, seed: u64, flight: &Arc<Flight>) -> Vec<Burst> {
    Receiver::generated(index, seed, Arc::clone(flight))
        .take_while(|burst| burst.at_ns < (SECONDS * 1e9) as u64)
        .collect()
}

/// A receiver's solutions as the crate `ublox` reads them.
#[derive(Debug, Default)]
struct Seen {
    /// The positions, each with time of week (ms), latitude, longitude, height, and the burst's instant, ns after
    /// reset.
    positions: Vec<(u32, f64, f64, f64, u64)>,
    /// The attitudes: (roll, pitch, heading), degrees.
    attitudes: Vec<[f64; 3]>,
    accelerations: Vec<[f64; 3]>,
    seconds_of_day: Vec<f64>,
}

fn read(bursts: &[Burst]) -> Seen {
    let mut seen = Seen::default();
    let mut parser = ParserBuilder::new().with_protocol::<Proto27>().with_vec_buffer();
    for burst in bursts {
        let mut found = parser.consume_ubx(&burst.bytes);
        while let Some(message) = found.next() {
            match message {
                Ok(UbxPacket::Proto27(PacketRef::NavPvt(m))) => {
                    let height = m.height_above_ellipsoid();
                    seen.positions.push((m.itow(), m.latitude(), m.longitude(), height, burst.at_ns));
                    let second = f64::from(m.sec()) + f64::from(m.nanosec()) / 1e9;
                    seen.seconds_of_day.push(f64::from(m.hour()) * 3_600.0 + f64::from(m.min()) * 60.0 + second);
                    assert_eq!((m.year(), m.month(), m.day()), (2025, 6, 25), "a Wednesday");
                }
                Ok(UbxPacket::Proto27(PacketRef::NavAtt(m))) => {
                    seen.attitudes.push([m.vehicle_roll(), m.vehicle_pitch(), m.vehicle_heading()]);
                }
                Ok(UbxPacket::Proto27(PacketRef::EsfIns(m))) => {
                    seen.accelerations.push([m.x_acceleration(), m.y_acceleration(), m.z_acceleration()]);
                }
                other => panic!("{other:?}"),
            }
        }
    }
    seen
}

#[test]
fn each_receiver_has_its_own_rate_and_messages() {
    let flight = flight();
    for index in 1..=5 {
        let model = Model::fitted(index);
        let seen = read(&bursts(index, 1, &flight));
        let expected = (SECONDS * 1e3) as usize / model.period_ms as usize;
        assert!(seen.positions.len().abs_diff(expected) <= 2, "{index}: {}", seen.positions.len());
        assert_eq!(seen.attitudes.len(), if model.attitude { seen.positions.len() } else { 0 });
        assert_eq!(seen.accelerations.len(), if model.inertial { seen.positions.len() } else { 0 });
        for pair in seen.positions.windows(2) {
            assert_eq!(pair[1].0 - pair[0].0, model.period_ms, "no epoch is missing");
            assert_eq!(pair[0].0 % model.period_ms, 0, "epochs are multiples of the period");
        }
    }
    let rates: Vec<_> = (1..=4).map(|index| 1_000 / Model::fitted(index).period_ms).collect();
    assert_eq!(rates, [10, 8, 5, 25]);
}

#[test]
fn positions_are_the_flights_within_what_the_receiver_promises() {
    let flight = flight();
    for index in 1..=5 {
        let model = Model::fitted(index);
        let bursts = bursts(index, 2, &flight);
        let seen = read(&bursts);
        let mut errors = Vec::new();
        for (_, latitude, longitude, height, at_ns) in &seen.positions {
            let told = gnss_sim::Geodetic { latitude: *latitude, longitude: *longitude, height: *height };
            // The jitter of the delay and the clock's error move a solution by at most 10 ms. This is 0.16 m at 16 m/s.
            let then = *at_ns as f64 / 1e9 - model.delay_ms / 1e3;
            let truth = flight.state(then).ned;
            let ned = flight.plane().to_ned(told);
            errors.push([0, 1, 2].map(|i| ned[i] - truth[i]));
        }
        for (axis, (bias, white)) in [model.horizontal_m, model.horizontal_m, model.vertical_m].into_iter().enumerate()
        {
            let worst = errors.iter().map(|e| e[axis].abs()).fold(0.0, f64::max);
            assert!(worst < 4.0 * bias + 5.0 * white + 0.2, "{index} {axis}: {worst}");
            // The difference of two successive errors shows the white noise, because the bias hardly changes between
            // them.
            let steps: Vec<_> = errors.windows(2).map(|e| e[1][axis] - e[0][axis]).collect();
            let deviation = (steps.iter().map(|s| s * s).sum::<f64>() / steps.len() as f64 / 2.0).sqrt();
            assert!((white * 0.8..white * 1.6 + 0.05).contains(&deviation), "{index} {axis}: {deviation}");
        }
        assert!(errors.iter().any(|e| e[0] > errors[0][0]), "not a constant");
    }
}

#[test]
fn attitude_and_acceleration_are_the_flights() {
    let flight = flight();
    for index in [1, 3, 5] {
        let model = Model::fitted(index);
        let seen = read(&bursts(index, 3, &flight));
        for (position, attitude) in seen.positions.iter().zip(&seen.attitudes) {
            let truth = flight.state(position.4 as f64 / 1e9 - model.delay_ms / 1e3);
            let [roll, pitch, heading] = attitude;
            assert!((roll - truth.roll.to_degrees()).abs() < 3.0 && (pitch - truth.pitch.to_degrees()).abs() < 3.0);
            assert!((0.0..=360.0).contains(heading));
            let off = (heading - truth.yaw.to_degrees()).rem_euclid(360.0);
            assert!(off.min(360.0 - off) < 4.0, "{heading} {truth:?}");
        }
        for (position, acceleration) in seen.positions.iter().zip(&seen.accelerations) {
            let truth = flight.state(position.4 as f64 / 1e9 - model.delay_ms / 1e3);
            for (a, b) in acceleration.iter().zip(truth.acceleration) {
                assert!((a - b).abs() < 0.3, "{acceleration:?} {truth:?}");
            }
        }
    }
}

#[test]
fn delay_and_clock_phase_belong_to_the_receiver() {
    let flight = flight();
    let origin = |index: usize| -> Vec<f64> {
        let seen = read(&bursts(index, 4, &flight));
        seen.positions.iter().map(|p| p.4 as f64 / 1e6 - f64::from(p.0)).collect()
    };
    let means: Vec<f64> = (1..=5)
        .map(|index| {
            let origins = origin(index);
            let mean = origins.iter().sum::<f64>() / origins.len() as f64;
            let model = Model::fitted(index);
            let worst = origins.iter().map(|o| (o - mean).abs()).fold(0.0, f64::max);
            assert!(worst <= 3.0 * model.delay_jitter_ms + 1.1, "{index}: {worst}");
            assert!(worst > model.delay_jitter_ms, "{index} has no jitter");
            mean - model.delay_ms
        })
        .collect();
    for mean in &means {
        assert!((mean - means[0]).abs() < 1.5, "{means:?}");
    }
    assert!((1..=5).all(|i| (40.0..=80.0).contains(&Model::fitted(i).delay_ms)));
}

#[test]
fn the_clock_in_the_message_is_utc_at_the_time_of_week() {
    let seen = read(&bursts(1, 5, &flight()));
    for (position, second) in seen.positions.iter().zip(&seen.seconds_of_day) {
        let gps = f64::from(position.0) / 1e3 - 3.0 * 86_400.0;
        assert!((gps - 18.0 - second).abs() < 0.000_6, "{position:?} {second}");
    }
}

#[test]
fn bursts_follow_one_another_without_overlap() {
    let flight = flight();
    for index in 1..=5 {
        // A receiver of 25 Hz sends more than a line of 9600 bit/s can carry, so its bursts queue in order.
        for bit_rate in [BIT_RATE, 9_600] {
            let receiver = Receiver::generated(index, 6, Arc::clone(&flight)).at_bit_rate(bit_rate);
            let mut idle = 0;
            for burst in receiver.clone().take(200) {
                assert!(burst.at_ns >= idle && !burst.bytes.is_empty());
                idle = burst.at_ns + receiver.line_time_ns(burst.bytes.len());
            }
        }
    }
}

#[test]
fn the_noise_of_a_receiver_depends_on_its_seed_and_place_alone() {
    let flight = flight();
    assert_eq!(bursts(2, 7, &flight), bursts(2, 7, &flight));
    assert_ne!(bursts(2, 7, &flight), bursts(2, 8, &flight));
    let model = Model::fitted(1);
    let take = |index| Receiver::with_model(model, index, 7, Arc::clone(&flight)).take(20).collect::<Vec<_>>();
    assert_ne!(take(1), take(2));
}

#[test]
fn a_receiver_outlasts_the_flight() {
    let flight = Arc::new(Flight::new(1, 10.0));
    let late = Receiver::generated(1, 1, flight).find(|burst| burst.at_ns > 3_600_000_000_000);
    assert!(late.is_some());
}

#[test]
fn the_last_solution_of_a_burst_has_arrived_with_its_last_byte() {
    let receiver = Receiver::generated(1, 1, Arc::new(Flight::new(1, 10.0)));
    let fix = ubx::NavPvt { fix_type: 3, flags: ubx::NavPvt::FLAG_FIX_OK, ..ubx::NavPvt::default() }.encode();
    let none = ubx::NavPvt::default().encode();
    let mut bytes = b"$GNGLL,noise*00\r\n".to_vec();
    bytes.extend(&fix);
    let solved = bytes.len();
    bytes.extend(none.iter().chain(&fix[..fix.len() - 1]));
    let burst = Burst { at_ns: 7_000, bytes };
    assert_eq!(receiver.last_solution_ns(&burst), Some(7_000 + receiver.line_time_ns(solved)));
    assert_eq!(receiver.last_solution_ns(&Burst { at_ns: 7_000, bytes: none }), None);
}
