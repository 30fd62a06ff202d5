//! Tests the whole chain without boards. Simulated receivers measure one flight while one or two of them fail; their
//! bytes go through parser and voter at every tick, and Reported-Position is compared with the true position.
//!
//! # Bounds
//!
//! A right receiver of these models is off by up to [`RIGHT_M`] over ground. That is the sum of three errors: a bias
//! that wanders with 0.8 to 1.1 m in each axis (five deviations in two axes are 7.8 m), white noise, and a latency that
//! varies by 30 ms at 16 m/s. If one of three receivers is wrong, every result still has a right receiver among its
//! members, and each other member agrees with that receiver. So the result is at most [`AGREE_M`] away from that right
//! receiver, and at most the sum of both bounds away from the truth. If all three receivers are members, the median
//! lies between the two right ones or on one of them.
//!
//! While the two right receivers agree with each other, there is a result at every tick. They rarely disagree. If they
//! do, nobody can tell which of them is right, and only the bound of the result's error is checked.

use std::sync::Arc;

use gnss_sim::{ubx, Flight, Geodetic, TangentPlane};
use horus_tx_fw::{cycle::Cycle, receiver::Receiver, timing::timestamp};
use profile::{GpsObject, ReportedPosition};

/// The greatest error over ground of a receiver that has not failed, m.
const RIGHT_M: f64 = 9.0;
/// The greatest distance of two receivers that agree, m: the ceiling of decision 15.
const AGREE_M: f64 = 30.0;
/// The greatest error in height of a receiver that has not failed, m: five deviations of 1.4 to 1.9 m in one axis.
const RIGHT_HEIGHT_M: f64 = 10.0;
/// The greatest difference in height of two receivers that agree, m: the ceiling of decision 15.
const AGREE_HEIGHT_M: f64 = 50.0;

/// The failure of a receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Silence,
    /// The receiver repeats its last solution, time of week included.
    Frozen,
    /// The receiver repeats its last position, but at new times of week.
    Stuck,
    /// The receiver's position is suddenly 20 m to 5 km off.
    Jump,
    /// The receiver's position moves away with 0.2 to 2 m/s.
    Drift,
    /// The receiver is 1 to 30 m off.
    Offset,
    /// The receiver sends fields of any value, or fields that are all out of range.
    Garbage,
    /// The receiver states an accuracy a hundred times too small, and drifts.
    Understated,
    /// The receiver states an accuracy a hundred times too large, and drifts.
    Overstated,
    /// Every checksum of the receiver is wrong.
    Checksum,
    Time,
    /// The receiver's velocity is wrong by up to 50 m/s.
    Velocity,
    Flat,
    /// The receiver's altitude is 60 m to 5 km too high.
    Height,
    /// The receiver's heading is 15 degrees off or more.
    Heading,
}

const KINDS: [Kind; 15] = [
    Kind::Silence,
    Kind::Frozen,
    Kind::Stuck,
    Kind::Jump,
    Kind::Drift,
    Kind::Offset,
    Kind::Garbage,
    Kind::Understated,
    Kind::Overstated,
    Kind::Checksum,
    Kind::Time,
    Kind::Velocity,
    Kind::Flat,
    Kind::Height,
    Kind::Heading,
];

struct Draw(u64);

impl Draw {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// The failure of one receiver, with all values that were drawn for it.
struct Failure {
    kind: Kind,
    from_ns: u64,
    /// The direction of the error as parts north and east, each up to 1.
    direction: [f64; 2],
    metres: f64,
    metres_per_s: f64,
    velocity_mm_s: [i32; 2],
    draw: Draw,
    last: Option<Vec<u8>>,
}

impl Failure {
    fn new(kind: Kind, from_ns: u64, mut draw: Draw) -> Self {
        let angle = draw.between(0.0, std::f64::consts::TAU);
        let metres = match kind {
            Kind::Jump => 20.0 * 250_f64.powf(draw.between(0.0, 1.0)),
            Kind::Height => 60.0 * 80_f64.powf(draw.between(0.0, 1.0)),
            _ => draw.between(1.0, 30.0),
        };
        let metres_per_s = draw.between(0.2, 2.0);
        let velocity_mm_s = [0; 2].map(|_| draw.between(-50_000.0, 50_000.0) as i32);
        let direction = [angle.cos(), angle.sin()];
        Self { kind, from_ns, direction, metres, metres_per_s, velocity_mm_s, draw, last: None }
    }

    /// Returns what the failed receiver sends at `at_ns` in place of `bytes`.
    fn spoil(&mut self, bytes: Vec<u8>, at_ns: u64, plane: &TangentPlane) -> Vec<u8> {
        if at_ns < self.from_ns {
            self.last = Some(bytes.clone());
            return bytes;
        }
        let last = self.last.clone().unwrap_or_else(|| bytes.clone());
        let drifted = self.metres_per_s * (at_ns - self.from_ns) as f64 / 1e9;
        match self.kind {
            Kind::Silence => Vec::new(),
            Kind::Frozen => last,
            Kind::Stuck => {
                let now = itow(&bytes);
                each(last, |payload, at| payload[at..at + 4].copy_from_slice(&now), |_| ())
            }
            Kind::Jump | Kind::Offset => self.shifted(bytes, self.metres, plane),
            Kind::Drift => self.shifted(bytes, drifted, plane),
            Kind::Garbage => {
                let draw = &mut self.draw;
                each(
                    bytes,
                    |_, _| (),
                    |pvt| {
                        for at in [24, 28, 32, 40, 44, 48, 52, 56] {
                            let word = [[0xFF; 4], [0, 0, 0, 0x80], [0; 4], (draw.bits() as u32).to_le_bytes()];
                            let word = word[(draw.bits() % 4) as usize];
                            pvt[at..at + 4].copy_from_slice(&word);
                        }
                    },
                )
            }
            Kind::Understated | Kind::Overstated => {
                let overstated = self.kind == Kind::Overstated;
                each(
                    self.shifted(bytes, drifted, plane),
                    |_, _| (),
                    |pvt| {
                        for at in [40, 44] {
                            let accuracy = u32::from_le_bytes(pvt[at..at + 4].try_into().expect("four bytes"));
                            let told = if overstated { accuracy * 100 } else { accuracy / 100 };
                            pvt[at..at + 4].copy_from_slice(&told.to_le_bytes());
                        }
                    },
                )
            }
            Kind::Checksum => {
                let mut bytes = bytes;
                // Damages the payload of every message in the burst.
                let mut start = 0;
                while start < bytes.len() {
                    let length = usize::from(u16::from_le_bytes([bytes[start + 4], bytes[start + 5]]));
                    bytes[start + 10] ^= 0x10;
                    start += length + 8;
                }
                bytes
            }
            Kind::Time => {
                let jump = (self.draw.bits() % 604_800_000) as u32;
                each(bytes, |payload, at| payload[at..at + 4].copy_from_slice(&jump.to_le_bytes()), |_| ())
            }
            Kind::Flat => each(bytes, |_, _| (), |pvt| pvt[20] = 2),
            Kind::Height => {
                let up = (self.metres * 1e3) as i32;
                each(
                    bytes,
                    |_, _| (),
                    |pvt| {
                        let height = i32::from_le_bytes(pvt[32..36].try_into().expect("four bytes"));
                        pvt[32..36].copy_from_slice(&(height + up).to_le_bytes());
                    },
                )
            }
            Kind::Heading => {
                let off = (15e5 + self.metres * 10e5) as i32;
                let turn = |payload: &mut [u8], itow: usize| {
                    if itow == 0 && payload.len() == ubx::NavAtt::PAYLOAD {
                        let heading = i32::from_le_bytes(payload[16..20].try_into().expect("four bytes"));
                        payload[16..20].copy_from_slice(&((heading + off) % 36_000_000).to_le_bytes());
                    }
                };
                each(bytes, turn, |_| ())
            }
            Kind::Velocity => {
                let velocity = self.velocity_mm_s;
                each(
                    bytes,
                    |_, _| (),
                    |pvt| {
                        for (at, velocity) in [48, 52].into_iter().zip(velocity) {
                            pvt[at..at + 4].copy_from_slice(&velocity.to_le_bytes());
                        }
                    },
                )
            }
        }
    }

    fn shifted(&self, bytes: Vec<u8>, metres: f64, plane: &TangentPlane) -> Vec<u8> {
        let [north, east] = self.direction.map(|part| part * metres);
        each(
            bytes,
            |_, _| (),
            |pvt| {
                let field = |at: usize| f64::from(i32::from_le_bytes(pvt[at..at + 4].try_into().expect("four bytes")));
                let place = Geodetic { latitude: field(28) / 1e7, longitude: field(24) / 1e7, height: field(32) / 1e3 };
                let [n, e, d] = plane.to_ned(place);
                let place = plane.to_geodetic([n + north, e + east, d]);
                pvt[24..28].copy_from_slice(&((place.longitude * 1e7).round() as i32).to_le_bytes());
                pvt[28..32].copy_from_slice(&((place.latitude * 1e7).round() as i32).to_le_bytes());
            },
        )
    }
}

/// Returns a burst with changed payloads and right checksums. `all` changes the payload of every message; its second
/// argument is the offset of the time of week. `pvt` changes the payload of NAV-PVT.
fn each(bytes: Vec<u8>, all: impl Fn(&mut [u8], usize), mut pvt: impl FnMut(&mut [u8])) -> Vec<u8> {
    let mut changed = Vec::new();
    let mut rest = bytes.as_slice();
    while let Some(frame) = ubx::Frame::at_start_of(rest) {
        let mut payload = frame.payload.to_vec();
        all(&mut payload, if frame.class == ubx::CLASS_ESF { 8 } else { 0 });
        if (frame.class, frame.id) == (ubx::CLASS_NAV, ubx::NavPvt::ID) {
            pvt(&mut payload);
        }
        changed.extend(ubx::frame(frame.class, frame.id, &payload));
        rest = &rest[frame.wire_len()..];
    }
    changed
}

fn itow(burst: &[u8]) -> [u8; 4] {
    burst[6..10].try_into().expect("four bytes")
}

#[derive(Clone, Copy, Debug, Default)]
struct Outcome {
    /// The greatest error over ground of all ticks with a result, m.
    worst_m: f64,
    /// The time from the failure to the first tick at which the failed receiver is excluded, ms.
    excluded_after_ms: Option<u32>,
    /// The time from the failure to the first tick after which the failed receiver is never a member again, ms.
    left_after_ms: Option<u32>,
    /// The number of ticks without a result after [`SETTLED_MS`].
    without: u32,
    /// The number of ticks after [`SETTLED_MS`] at which the two right receivers would not agree if they voted alone.
    apart: u32,
    wronged: u32,
    /// The number of ticks at which fewer receivers agreed than are fitted although the status did not say *degraded*.
    undegraded: u32,
    /// The number of ticks whose result is farther from the truth than allowed, although no two failed receivers agree.
    unexplained: u32,
    /// The greatest error in height of all ticks with an altitude, m.
    worst_height_m: f64,
    /// The number of ticks later than [`SETTLED_MS`] whose result has an attitude.
    oriented: u32,
    worst_heading: f64,
    /// The time from the failure to the first tick whose result is farther from the truth than allowed, ms.
    far_after_ms: Option<u32>,
}

const SECONDS: f64 = 20.0;
const RECEIVERS: usize = 3;

/// The time by which there must be a result, ms: every receiver has sent its first solution after 300 ms.
const SETTLED_MS: u32 = 500;

fn run(seed: u64, failures: &mut [(usize, Failure)]) -> Outcome {
    let flight = Arc::new(Flight::new(seed, SECONDS));
    let mut sources: Vec<_> = (1..=RECEIVERS)
        .map(|index| gnss_sim::Receiver::generated(index, seed, Arc::clone(&flight)).peekable())
        .collect();
    let mut receivers: [Receiver; RECEIVERS] = std::array::from_fn(|_| Receiver::new());
    let mut cycle = Cycle::<RECEIVERS>::new();
    let right: Vec<usize> = (0..RECEIVERS).filter(|index| failures.iter().all(|(who, _)| who != index)).collect();
    let mut outcome = Outcome::default();
    let failed_from = failures.iter().map(|(_, failure)| failure.from_ns).min().unwrap_or(u64::MAX);
    let failed_ms = (failed_from / 1_000_000) as u32;
    for tick in 0..(SECONDS * 100.0) as u32 {
        let now = timestamp(tick);
        for (index, (source, receiver)) in sources.iter_mut().zip(&mut receivers).enumerate() {
            // A receiver's burst takes at most 4 ms on the line, so it counts as arrived after that time.
            while let Some(burst) = source.next_if(|burst| burst.at_ns + 4_000_000 <= u64::from(now) * 1_000_000) {
                let arrived = ((burst.at_ns + 4_000_000) / 1_000_000) as u32;
                let mut bytes = burst.bytes;
                for (_, failure) in failures.iter_mut().filter(|(who, _)| *who == index) {
                    bytes = failure.spoil(bytes, burst.at_ns, flight.plane());
                }
                for bytes in bytes.chunks(64) {
                    receiver.receive(bytes, arrived);
                }
            }
            receiver.receive(&[], now);
        }
        let solutions = receivers.each_ref().map(|receiver| *receiver.solution());
        if let ([one, .., other], true) = (right.as_slice(), now >= SETTLED_MS) {
            let mut alone = Cycle::new();
            alone.vote(tick + 1, &[solutions[*one], solutions[*other]]);
            outcome.apart += u32::from(alone.verdict().agreeing() != 2);
        }
        let profile = cycle.fill(tick, &solutions);
        cycle.vote(tick + 1, &solutions);
        let reading = profile.verify();
        let reported = reading.reported.map(ReportedPosition::values).expect("sealed");
        let gps = reading.gps.map(|object| object.map(GpsObject::values).expect("sealed"));

        let is_wrong = |index: usize| failures.iter().any(|(who, _)| *who == index);
        let excluded = |index: usize| gps[index].status.excluded();
        outcome.wronged += u32::from((0..RECEIVERS).any(|index| !is_wrong(index) && excluded(index)));
        let agreeing = reported.status.receivers_agreeing();
        let degraded = usize::from(agreeing) < RECEIVERS || reported.altitude.is_nan();
        outcome.undegraded += u32::from(degraded != reported.status.degraded());
        if let ([(who, _)], true) = (&*failures, now >= failed_ms) {
            if excluded(*who) && outcome.excluded_after_ms.is_none() {
                outcome.excluded_after_ms = Some(now - failed_ms);
            }
            outcome.left_after_ms = match agreeing {
                3 => None,
                _ => outcome.left_after_ms.or(Some(now - failed_ms)),
            };
        }
        if reported.status.position_valid() {
            let state = flight.state(f64::from(now) / 1e3);
            let truth = state.position;
            let plane = TangentPlane::new(truth);
            let off = |latitude, longitude| {
                let [north, east, _] = plane.to_ned(Geodetic { latitude, longitude, height: truth.height });
                north.hypot(east)
            };
            let error = off(reported.latitude, reported.longitude);
            outcome.worst_m = outcome.worst_m.max(error);
            // A result farther from the truth than allowed is explained only by two wrong receivers that agree with
            // each other and with no other receiver.
            let of_two_wrong = failures.len() == 2 && agreeing == 2 && {
                let wrong: Vec<_> = failures.iter().map(|(who, _)| &gps[*who]).collect();
                wrong.iter().all(|gps| gps.status.position_valid() && !gps.status.excluded())
            };
            outcome.unexplained += u32::from(error > RIGHT_M + AGREE_M && !of_two_wrong);
            if error > RIGHT_M + AGREE_M && outcome.far_after_ms.is_none() {
                outcome.far_after_ms = Some(now.saturating_sub(failed_ms));
            }
            if !reported.altitude.is_nan() {
                let error = (reported.altitude - truth.height).abs();
                outcome.worst_height_m = outcome.worst_height_m.max(error);
                outcome.unexplained += u32::from(error > RIGHT_HEIGHT_M + AGREE_HEIGHT_M && !of_two_wrong);
            }
            if reported.status.attitude_valid() && now >= SETTLED_MS {
                outcome.oriented += 1;
                let off = (f64::from(reported.yaw) - state.yaw).rem_euclid(std::f64::consts::TAU);
                let off = off.min(std::f64::consts::TAU - off).to_degrees();
                outcome.worst_heading = outcome.worst_heading.max(off);
            }
        } else if now >= SETTLED_MS {
            outcome.without += 1;
        }
    }
    outcome
}

fn failure(kind: Kind, seed: u64, number: u64) -> Failure {
    let mut draw = Draw(seed.wrapping_mul(1_000_003).wrapping_add(number));
    draw.bits();
    let from_ns = (draw.between(1.0, 8.0) * 1e9) as u64;
    Failure::new(kind, from_ns, draw)
}

fn one_of_three(runs: u64) {
    println!("kind          runs  excluded  left   worst m  excluded s  left s  not excluded  right ones apart");
    let (mut worst_height, mut worst_heading) = (0.0_f64, 0.0_f64);
    for (place, kind) in (0..).zip(KINDS) {
        let (mut count, mut excluded, mut left, mut apart) = (0, 0, 0, 0);
        let (mut worst, mut latest, mut latest_left) = (0.0_f64, 0, 0);
        for seed in (place..runs).step_by(KINDS.len()) {
            let who = Draw(seed).bits() as usize % RECEIVERS;
            let outcome = run(seed, &mut [(who, failure(kind, seed, 0))]);
            worst_height = worst_height.max(outcome.worst_height_m);
            worst_heading = worst_heading.max(outcome.worst_heading);
            let said = format!("{kind:?} of GPS{}, seed {seed}: {outcome:?}", who + 1);
            assert_eq!(outcome.undegraded, 0, "{said}");
            assert!(outcome.worst_m <= RIGHT_M + AGREE_M, "{said}");
            assert!(outcome.worst_height_m <= RIGHT_HEIGHT_M + AGREE_HEIGHT_M, "{said}");
            // If the two receivers that have not failed disagree, nobody can tell which of them is right. A tick may
            // then have no result, or one of the two may be excluded.
            if outcome.apart == 0 {
                assert_eq!((outcome.without, outcome.wronged), (0, 0), "{said}");
            }
            apart += u32::from(outcome.apart > 0);
            match kind {
                Kind::Silence | Kind::Frozen | Kind::Checksum => {
                    // A silent receiver leaves the vote one period and 150 ms after its last message, which may be a
                    // period old by then.
                    assert!(outcome.left_after_ms.is_some_and(|ms| ms <= 650), "{said}");
                    assert!(outcome.worst_m <= RIGHT_M, "right ones are left: {said}");
                }
                Kind::Time => assert!(outcome.worst_m <= RIGHT_M, "{said}"),
                Kind::Jump | Kind::Height if outcome.apart == 0 => {
                    assert!(outcome.excluded_after_ms.is_some_and(|ms| ms <= 300), "{said}");
                }
                _ => {}
            }
            count += 1;
            excluded += u32::from(outcome.excluded_after_ms.is_some());
            left += u32::from(outcome.left_after_ms.is_some());
            worst = worst.max(outcome.worst_m);
            latest = latest.max(outcome.excluded_after_ms.unwrap_or(0));
            latest_left = latest_left.max(outcome.left_after_ms.unwrap_or(0));
        }
        let name = format!("{kind:?}");
        let (latest, left_s) = (f64::from(latest) / 1e3, f64::from(latest_left) / 1e3);
        let not = count - excluded;
        println!(
            "{name:12} {count:5} {excluded:9} {left:5} {worst:9.2} {latest:11.2} {left_s:7.2} {not:13} {apart:17}"
        );
    }
    println!("altitude off by {worst_height:.2} m, heading by {worst_heading:.1} degrees at worst");
}

fn two_of_three(runs: u64) {
    let (mut valid_far, mut worst, mut without) = (0, 0.0_f64, 0_u64);
    for seed in 0..runs {
        let mut draw = Draw(seed ^ 0x5EED);
        let right = draw.bits() as usize % RECEIVERS;
        let mut failures: Vec<_> = (0..RECEIVERS)
            .filter(|who| *who != right)
            .map(|who| (who, failure(KINDS[draw.bits() as usize % KINDS.len()], seed, who as u64 + 1)))
            .collect();
        let kinds: Vec<_> = failures.iter().map(|(_, failure)| failure.kind).collect();
        let outcome = run(seed, &mut failures);
        assert_eq!((outcome.unexplained, outcome.undegraded), (0, 0), "{kinds:?}, seed {seed}: {outcome:?}");
        valid_far += u32::from(outcome.worst_m > RIGHT_M + AGREE_M);
        worst = worst.max(outcome.worst_m);
        without += u64::from(outcome.without);
    }
    println!("two of three: {runs} runs, {without} ticks without a result, worst {worst:.2} m, {valid_far} beyond");
}

#[test]
fn whatever_one_of_three_receivers_does_reported_position_stays_valid_and_right() {
    one_of_three(360);
}

#[test]
fn two_of_three_failing_show_no_wrong_position_unless_they_agree() {
    two_of_three(120);
}

#[test]
fn without_a_failure_the_voted_position_is_as_accurate_as_its_receivers() {
    let (mut oriented, mut worst_heading) = (0, 0.0_f64);
    for seed in 0..40 {
        let outcome = run(seed, &mut []);
        assert_eq!(outcome.undegraded, 0, "{outcome:?}");
        assert!(outcome.apart > 0 || (outcome.without, outcome.wronged) == (0, 0), "{outcome:?}");
        assert!(outcome.worst_m <= RIGHT_M && outcome.worst_height_m <= RIGHT_HEIGHT_M, "{outcome:?}");
        oriented += outcome.oriented;
        worst_heading = worst_heading.max(outcome.worst_heading);
    }
    let share = f64::from(oriented) / 40.0 / (SECONDS * 100.0 - f64::from(SETTLED_MS) / 10.0);
    println!(
        "an attitude in {:.2} % of the ticks, its heading off by {worst_heading:.1} degrees at worst",
        share * 1e2
    );
    assert!(share > 0.97, "{share}");
}

/// All receivers jump by the same distance, each with its next solution, and stay at the new place.
#[test]
fn a_jump_of_all_receivers_is_held_back_for_a_second() {
    for seed in 0..12 {
        let jump = |_| Failure { metres: 1_000.0, ..failure(Kind::Jump, seed, 0) };
        let mut failures: Vec<_> = (0..RECEIVERS).map(|who| (who, jump(who))).collect();
        let outcome = run(seed, &mut failures);
        assert_eq!(outcome.undegraded, 0, "{outcome:?}");
        // The second receiver jumps at its next solution, after at most its period (125 or 200 ms) and its latency.
        assert!(outcome.far_after_ms.is_some_and(|ms| (1_000..1_400).contains(&ms)), "seed {seed}: {outcome:?}");
    }
}

/// Runs the failures ten thousand times and prints the table:
/// `cargo test -p horus-tx-fw --test all voted:: -- --ignored --nocapture`.
#[test]
#[ignore = "takes four minutes: cargo test -p horus-tx-fw --test all voted:: -- --ignored --nocapture"]
fn ten_thousand_failures() {
    one_of_three(10_000);
    two_of_three(3_000);
}
