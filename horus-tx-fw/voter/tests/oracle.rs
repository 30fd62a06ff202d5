//! Compares the voter with a second implementation of decision 15.

use crate::support;

use horus_voter::{Input, Stated, Verdict, Voter, WEEK_MS};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed};

use support::{Oracle, Place, Report, distance, geodetic, listed};

fn seeded(cases: u32) -> Config {
    Config { cases, rng_seed: RngSeed::Fixed(15), failure_persistence: None, ..Config::default() }
}

fn somewhere() -> impl Strategy<Value = (f64, f64)> {
    let latitude = prop_oneof![
        4 => -89.0..89.0,
        1 => (0.0..0.02).prop_map(|missing| 90.0 - missing),
        1 => (0.0..0.02).prop_map(|missing| missing - 90.0),
        1 => Just(0.0),
        1 => Just(90.0),
    ];
    let longitude = prop_oneof![
        4 => -180.0..180.0,
        1 => (-2e-4..2e-4).prop_map(|off: f64| if off < 0.0 { -180.0 - off } else { 180.0 - off }),
        1 => Just(0.0),
        1 => Just(180.0),
    ];
    (latitude, longitude)
}

/// A drawn receiver: whether it is valid; its offset, m; its speed, mm/s; its accuracies, mm; its age, ms; its delay by
/// its time of week, ms; whether its fix is 2D; its attitude and its acceleration.
type Drawn = (bool, [f64; 3], [i32; 3], [u32; 2], i32, u32, bool, Option<[f32; 3]>, Option<[f32; 3]>);

fn numbers(about: [f32; 3], within: f32) -> impl Strategy<Value = Option<[f32; 3]>> {
    let off = move || prop_oneof![6 => -within..within, 1 => Just(f32::NAN), 1 => -500.0_f32..500.0];
    let drawn = [off(), off(), off()].prop_map(move |off| [0, 1, 2].map(|axis| about[axis] + off[axis]));
    prop::option::weighted(0.8, drawn)
}

fn receiver() -> impl Strategy<Value = Drawn> {
    let metres = || prop_oneof![3 => -3.0..3.0, 2 => -40.0..40.0, 1 => -900.0..900.0];
    let speed = || prop_oneof![Just(0), -20_000..20_000, -150_000..150_000];
    let accuracy = || prop_oneof![4 => 1..4_000_u32, 2 => 1..16_000_u32, 1 => 25_000..55_000_u32];
    (
        prop::bool::weighted(0.93),
        [metres(), metres(), metres()],
        [speed(), speed(), speed()],
        [accuracy(), accuracy()],
        -20..1_200_i32,
        prop_oneof![6 => 300..360_u32, 2 => 200..500_u32, 1 => 0..WEEK_MS, 1 => WEEK_MS - 40..WEEK_MS, 1 => 0..40_u32],
        prop::bool::weighted(0.25),
        numbers([0.1, 0.0, -3.1], 0.08),
        numbers([3.0, -4.0, 0.5], 1.3),
    )
}

fn report_of(place: (f64, f64), jump: [f64; 2], drawn: Drawn) -> Report {
    let (valid, [north, east, up], velocity_mm_s, accuracies, since_arrival_ms, lag_ms, flat, attitude, acceleration) =
        drawn;
    let (north, up, [horizontal, vertical]) = (north + jump[0], up + jump[1], accuracies);
    let (latitude, longitude) = geodetic(Place::new(place.0, place.1, 400.0).at(north, east));
    Report {
        valid,
        stated: Stated {
            latitude_e7: (latitude * 1e7).round() as i32,
            longitude_e7: (longitude * 1e7).round() as i32,
            altitude_mm: (!flat).then_some(400_000 + (up * 1e3) as i32),
            velocity_mm_s,
            horizontal_accuracy_mm: horizontal,
            vertical_accuracy_mm: vertical,
        },
        since_arrival_ms,
        lag_ms,
        attitude,
        acceleration,
    }
}

/// Whether two groups of three numbers are equal except for rounding. If `circle` is true, they are compared as angles.
fn same(one: Option<[f32; 3]>, other: Option<[f64; 3]>, circle: bool) -> bool {
    let (Some(one), Some(other)) = (one, other) else { return one.is_none() && other.is_none() };
    one.into_iter().zip(other).all(|(one, other)| {
        let off = f64::from(one) - other;
        let off = if circle { off.sin().atan2(off.cos()) } else { off };
        off.abs() < 1e-4 * other.abs().max(1.0)
    })
}

fn compare<const N: usize>(ticks: &[(Vec<Report>, u32)]) -> Result<(), TestCaseError> {
    let (mut voter, mut oracle) = (Voter::<N>::new(), Oracle::default());
    let mut now = u32::MAX - 2_000;
    for (report, later) in ticks {
        let inputs: [Input; N] = std::array::from_fn(|i| report[i].input());
        let (verdict, opinion) = (voter.vote(&inputs, now), oracle.vote(&report[..N], now));
        // If rounding decides a vote, this vote and the votes after it cannot be compared.
        if opinion.narrow {
            return Ok(());
        }
        prop_assert_eq!(listed(verdict.members), opinion.members);
        prop_assert_eq!(listed(verdict.excluded), opinion.excluded);
        prop_assert_eq!(verdict.position.is_some(), opinion.position.is_some());
        prop_assert!(same(verdict.attitude, opinion.attitude, true), "{:?} {:?}", verdict.attitude, opinion.attitude);
        let (one, other) = (verdict.acceleration, opinion.acceleration);
        prop_assert!(same(one, other, false), "{:?} {:?}", one, other);
        if let (Some(position), Some((at, altitude))) = (verdict.position, opinion.position) {
            let (latitude, longitude) = geodetic(at);
            let off = distance((position.latitude, position.longitude), (latitude, longitude));
            prop_assert!(off < 0.01, "{} m off: {:?}", off, position);
            prop_assert_eq!(position.altitude.is_some(), altitude.is_some());
            let off = position.altitude.unwrap_or(0.0) - altitude.unwrap_or(0.0);
            prop_assert!(off.abs() < 0.002, "{} m too high", off);
            prop_assert!(position.latitude.abs() <= 90.0 && position.longitude.abs() <= 180.0);
        }
        now = now.wrapping_add(*later);
    }
    Ok(())
}

/// Draws ticks in which each receiver keeps its place and only sometimes changes it; in some ticks all receivers jump.
fn ticks() -> impl Strategy<Value = Vec<(Vec<Report>, u32)>> {
    let change = prop::collection::vec((prop::bool::weighted(0.2), receiver()), 5);
    let later = prop_oneof![3 => Just(10_u32), 2 => Just(500), 1 => Just(999), 1 => Just(1_000)];
    let far = || prop_oneof![Just(0.0), -20.0..20.0, -300.0..300.0, -3_000.0..3_000.0];
    let jump = prop_oneof![4 => Just([0.0; 2]), 1 => [far(), far()]];
    let changes = prop::collection::vec((change, jump, later), 1..12);
    (somewhere(), prop::collection::vec(receiver(), 5), changes).prop_map(|(place, mut current, changes)| {
        let mut moved = [0.0; 2];
        changes
            .into_iter()
            .map(|(change, jump, later)| {
                for (current, (changes, to)) in current.iter_mut().zip(change) {
                    *current = if changes { to } else { *current };
                }
                moved = [0, 1].map(|axis| moved[axis] + jump[axis]);
                (current.iter().map(|drawn| report_of(place, moved, *drawn)).collect(), later)
            })
            .collect()
    })
}

proptest! {
    #![proptest_config(seeded(1_000))]

    #[test]
    fn one_receiver(ticks in ticks()) { compare::<1>(&ticks)?; }

    #[test]
    fn two_receivers(ticks in ticks()) { compare::<2>(&ticks)?; }

    #[test]
    fn three_receivers(ticks in ticks()) { compare::<3>(&ticks)?; }

    #[test]
    fn five_receivers(ticks in ticks()) { compare::<5>(&ticks)?; }

    /// The result does not depend on the order of the receivers, except for ties, which the lower numbers win. The
    /// accuracies drawn here have no equal sums, so there are no ties.
    #[test]
    fn the_verdict_does_not_depend_on_the_order_of_the_receivers(
        ticks in ticks(),
        order in Just([0_usize, 1, 2, 3, 4]).prop_shuffle(),
    ) {
        let (mut one, mut other) = (Voter::<5>::new(), Voter::<5>::new());
        let mut oracle = Oracle::default();
        for (now, (report, _)) in (0..).step_by(300).zip(&ticks) {
            if oracle.vote(report, now).narrow {
                break;
            }
            let inputs: [Input; 5] = std::array::from_fn(|i| report[i].input());
            let shuffled = order.map(|i| inputs[i]);
            let (a, b): (Verdict, Verdict) = (one.vote(&inputs, now), other.vote(&shuffled, now));
            let back = |mask: u8| (0..5).fold(0, |m, i| m | (mask >> i & 1) << order[i]);
            prop_assert_eq!((a.members, a.excluded), (back(b.members), back(b.excluded)));
            prop_assert_eq!(a.position.is_some(), b.position.is_some());
            if let (Some(a), Some(b)) = (a.position, b.position) {
                // This comparison is left out close to a pole, where the axes north and east differ from member to
                // member.
                if a.latitude.abs() < 89.0 {
                    let off = distance((a.latitude, a.longitude), (b.latitude, b.longitude));
                    prop_assert!(off < 0.01, "{} m", off);
                }
                prop_assert!((a.altitude.unwrap_or(0.0) - b.altitude.unwrap_or(0.0)).abs() < 0.002);
            }
        }
    }
}
