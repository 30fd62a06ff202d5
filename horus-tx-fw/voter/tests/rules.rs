//! Tests each rule of decision 15 by itself, to the last unit of its limits.

use crate::support;

use core::f32::consts::{PI, TAU};

use horus_voter::{Fix, Input, Position, Stated, Verdict, Voter, WEEK_MS, quorum};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed};

use support::{Report, distance, listed};

fn seeded(cases: u32) -> Config {
    Config { cases, rng_seed: RngSeed::Fixed(15), failure_persistence: None, ..Config::default() }
}

fn once<const N: usize>(report: [Report; N]) -> Verdict {
    Voter::new().vote(&report.map(|report| report.input()), 0)
}

fn agree(one: Report, other: Report) -> bool {
    once([one, other]).members == 0b11
}

const GOOD: Report = Report::GOOD;
const SILENT: Report = Report { valid: false, ..Report::GOOD };

fn place(verdict: &Verdict) -> (f64, f64) {
    let position = verdict.position.expect("a result");
    (position.latitude, position.longitude)
}

fn degrees(report: &Report) -> (f64, f64) {
    (f64::from(report.stated.latitude_e7) / 1e7, f64::from(report.stated.longitude_e7) / 1e7)
}

// Shows VOTE-1.
#[test]
fn quorums_are_1oo1_1oo2_2oo3_3oo5() {
    assert_eq!([1, 2, 3, 5].map(quorum), [1, 1, 2, 3]);
    for count in 0..=5_usize {
        let of_three = once(std::array::from_fn::<_, 3, _>(|i| if i < count { GOOD } else { SILENT }));
        assert_eq!(of_three.position.is_some(), count >= 2, "{count} of three");
        let of_five = once(std::array::from_fn::<_, 5, _>(|i| if i < count { GOOD } else { SILENT }));
        assert_eq!(of_five.position.is_some(), count >= 3, "{count} of five");
        assert_eq!(usize::from(of_five.agreeing()), if count >= 3 { count } else { 0 });
    }
    assert!(once([GOOD]).position.is_some() && once([SILENT]).position.is_none());
    assert!(once([SILENT, GOOD]).position.is_some() && once([SILENT, SILENT]).position.is_none());
}

#[test]
fn a_candidate_keeps_every_range_to_its_last_unit() {
    let ok = |change: fn(&mut Stated)| {
        let mut report = GOOD;
        change(&mut report.stated);
        let is = Fix::new(&report.stated).is_plausible();
        assert_eq!(once([report]).members, u8::from(is), "{report:?}");
        is
    };
    assert!(ok(|s| s.latitude_e7 = 900_000_000) && !ok(|s| s.latitude_e7 = 900_000_001));
    assert!(ok(|s| s.latitude_e7 = -900_000_000) && !ok(|s| s.latitude_e7 = -900_000_001));
    assert!(ok(|s| s.longitude_e7 = 1_800_000_000) && !ok(|s| s.longitude_e7 = 1_800_000_001));
    assert!(ok(|s| s.longitude_e7 = -1_800_000_000) && !ok(|s| s.longitude_e7 = -1_800_000_001));
    assert!(!ok(|s| s.latitude_e7 = i32::MIN) && !ok(|s| s.longitude_e7 = i32::MIN));
    assert!(ok(|s| s.altitude_mm = Some(20_000_000)) && !ok(|s| s.altitude_mm = Some(20_000_001)));
    assert!(ok(|s| s.altitude_mm = Some(-1_000_000)) && !ok(|s| s.altitude_mm = Some(-1_000_001)));
    assert!(ok(|s| s.velocity_mm_s = [0, -200_000, 0]) && !ok(|s| s.velocity_mm_s = [0, 200_001, 0]));
    assert!(ok(|s| s.velocity_mm_s = [120_000, 0, -160_000]) && !ok(|s| s.velocity_mm_s = [120_000, 1_000, 160_000]));
    assert!(!ok(|s| s.velocity_mm_s = [i32::MIN; 3]));
    assert!(ok(|s| s.horizontal_accuracy_mm = 30_000) && !ok(|s| s.horizontal_accuracy_mm = 30_001));
    assert!(ok(|s| s.horizontal_accuracy_mm = 1) && !ok(|s| s.horizontal_accuracy_mm = 0));
    assert!(ok(|s| s.vertical_accuracy_mm = 50_000) && !ok(|s| s.vertical_accuracy_mm = 50_001));
    assert!(ok(|s| s.vertical_accuracy_mm = 1) && !ok(|s| s.vertical_accuracy_mm = 0));
    assert!(ok(|s| (s.altitude_mm, s.vertical_accuracy_mm) = (None, 0)), "a 2D fix has no altitude to be good");
    assert!(!Fix::default().is_plausible() && Voter::new().vote(&[Input::default()], 0).members == 0);
}

#[test]
fn one_member_at_rest_is_the_result_to_the_bit_however_old() {
    for (latitude_e7, longitude_e7, altitude_mm) in [
        (474_987_654, 87_291_234, 512_345),
        (-1, 1, -1),
        (900_000_000, 1_800_000_000, 20_000_000),
        (-900_000_000, -1_800_000_000, -1_000_000),
        (900_000_000, -456, 0),
        (123_456_789, -1_799_999_999, 7),
    ] {
        let mut report = Report { since_arrival_ms: 1_150, ..GOOD };
        report.stated = Stated { latitude_e7, longitude_e7, altitude_mm: Some(altitude_mm), ..report.stated };
        for report in [[report, SILENT], [SILENT, report]] {
            let position = once(report).position.expect("a result");
            assert_eq!(position.latitude.to_bits(), (f64::from(latitude_e7) / 1e7).to_bits());
            assert_eq!(position.longitude.to_bits(), (f64::from(longitude_e7) / 1e7).to_bits());
            assert_eq!(position.altitude.map(f64::to_bits), Some((f64::from(altitude_mm) / 1e3).to_bits()));
        }
    }
}

#[test]
fn a_position_moves_by_its_velocity_for_its_age_and_50_ms() {
    for (since_arrival_ms, age) in [(0, 0.05), (100, 0.15), (1_150, 1.2), (-5, 0.045), (-50, 0.0), (-60, 0.0)] {
        let report = Report { since_arrival_ms, ..GOOD }.flying([30_000, -40_000, 5_000]);
        let verdict = once([report]);
        let expected = degrees(&report.moved(30.0 * age, -40.0 * age));
        assert!(distance(place(&verdict), expected) < 0.015, "at {since_arrival_ms} ms");
        let altitude = verdict.position.and_then(|position| position.altitude).expect("3D");
        assert!((altitude - (512.345 - 5.0 * age)).abs() < 1e-4, "{altitude} at {since_arrival_ms} ms");
    }
}

/// Returns how far the voter moves each of three receivers' positions to the tick, m. Each receiver in turn flies east
/// at 40 m/s, and the other two stand at its place and 4.9 m east of it, so that the median is the flying receiver.
fn brought(lags: [u32; 3]) -> [f64; 3] {
    [0, 1, 2].map(|of: usize| {
        let mut report = [0, 1, 2].map(|i: usize| Report { lag_ms: lags[i], ..GOOD });
        report[of] = report[of].flying([0, 40_000, 0]);
        let others: Vec<usize> = (0..3).filter(|i| *i != of).collect();
        report[others[1]] = report[others[1]].moved(0.0, 4.9);
        let verdict = once(report);
        assert_eq!(verdict.members, 0b111, "{lags:?}");
        let east = distance(place(&verdict), degrees(&GOOD));
        assert!((0.0..4.8).contains(&east), "{lags:?}: the median is the one that flies");
        east
    })
}

#[test]
fn the_age_of_a_message_follows_from_its_lag_behind_the_others() {
    const LAST: u32 = WEEK_MS - 1;
    for (lags, latencies) in [
        ([100, 100, 100], [50, 50, 50]),
        ([90, 100, 130], [40, 50, 80]),
        ([130, 90, 100], [80, 40, 50]),
        ([100, 150, 50], [50, 100, 0]),
        // Below, one receiver's time of week differs from the others' by more than the voter accepts.
        ([100, 151, 49], [50, 50, 50]),
        ([100, 400_000, 110], [40, 50, 50]),
        ([400_000, 100, 110], [50, 40, 50]),
        ([0, WEEK_MS / 2 - 9, WEEK_MS / 2], [50, 50, 59]),
        // Times of week that differ by half a week cannot be compared, so each position gets the assumed latency.
        ([0, WEEK_MS / 2, WEEK_MS / 2 + 9], [50, 50, 50]),
        // Below, the week ends between the receivers' times of week.
        ([5, LAST, LAST - 20], [56, 50, 30]),
        ([LAST, 5, 15], [44, 50, 60]),
        ([LAST, LAST - 30, 9], [50, 20, 60]),
    ] {
        for (east, latency) in brought(lags).into_iter().zip(latencies) {
            let expected = 0.040 * f64::from(latency);
            assert!((east - expected).abs() < 0.012, "{lags:?}: {east} m, not {expected} m");
        }
    }
}

#[test]
fn of_two_receivers_the_middle_lies_between_them() {
    let [one, other] = [100, 105].map(|lag_ms| Report { lag_ms, ..GOOD }.flying([0, 40_000, 0]));
    for (report, latency) in [([one, other], 50.0), ([one, Report { valid: false, ..other }], 50.0)] {
        let east = distance(place(&once(report)), degrees(&GOOD));
        assert!((east - 0.040 * latency).abs() < 0.012, "{east} m");
    }
    // The results differ by 2.5 ms of flight, which is 10 cm; the resolution of positions adds an error of 11 mm.
    let still = GOOD.moved(0.0, 2.0);
    let one = once([one, Report { lag_ms: 105, ..still }]);
    let other = once([Report { lag_ms: 100, ..still }, other]);
    let apart = distance(place(&one), place(&other));
    assert!((apart - 0.040 * 5.0 / 2.0).abs() < 0.02, "{apart} m");
}

/// Returns the greatest distance north at which two receivers agree, m. The search has a step of 1 mm, but positions
/// have one of 11 mm.
fn reach(one: Report, other: Report) -> f64 {
    let (mut near, mut far) = (0.0, 60.0);
    while far - near > 1e-3 {
        let middle = f64::midpoint(near, far);
        if agree(one, other.moved(middle, 0.0)) { near = middle } else { far = middle }
    }
    near
}

fn climb(one: Report, other: Report) -> f64 {
    let (mut near, mut far) = (0.0, 90.0);
    while far - near > 1e-4 {
        let middle = f64::midpoint(near, far);
        if agree(one, other.raised(middle)) { near = middle } else { far = middle }
    }
    near
}

#[test]
fn two_receivers_agree_within_three_standard_deviations_and_fixed_limits() {
    // At rest, the 50 ms of a position's age add 5 mm to its accuracy.
    for (one, other, expected) in [
        (1_000, 1_000, 5.0),
        (1_650, 100, 5.0),
        (1_995, 2_995, 10.816_6),
        (5_995, 7_995, 30.0),
        (6_995, 6_995, 29.698_5),
        (100, 9_995, 30.0),
        (30_000, 30_000, 30.0),
    ] {
        let reach = reach(GOOD.stating(one, 1), GOOD.stating(other, 1));
        assert!((reach - expected).abs() < 0.012, "{one} {other}: {reach}");
        let reach = self::reach(GOOD.stating(other, 1), GOOD.stating(one, 1));
        assert!((reach - expected).abs() < 0.012, "{other} {one}: {reach}");
    }
    for (one, other, expected) in
        [(1_000, 1_000, 8.0), (2_995, 3_995, 15.0), (11_995, 10_995, 48.836_5), (50_000, 1, 50.0)]
    {
        let climb = climb(GOOD.stating(1, one), GOOD.stating(1, other));
        assert!((climb - expected).abs() < 2e-3, "{one} {other}: {climb}");
    }
}

#[test]
fn accuracies_grow_with_speed_and_with_the_square_of_the_age() {
    // The moving receiver's accuracy is 7.105 m: 4 m, plus 0.05 s at 50 m/s, plus 2 m/s² over 0.55 s. That of the
    // receiver at rest is 1.005 m.
    let fast = |velocity| Report { since_arrival_ms: 500, ..GOOD }.stating(4_000, 4_000).flying(velocity);
    let still = GOOD.stating(1_000, 1_000);
    let horizontal = reach(still, fast([30_000, 40_000, 0]).moved(-0.55 * 30.0, -0.55 * 40.0));
    assert!((horizontal - 21.53).abs() < 0.03, "{horizontal}");
    // A receiver that descends at 50 m/s has a vertical accuracy of 7.105 m.
    let vertical = climb(still, fast([0, 0, 50_000]).raised(0.55 * 50.0));
    assert!((vertical - 21.527).abs() < 0.01, "{vertical}");
    let upwards = climb(still, fast([0, 0, -50_000]).raised(-0.55 * 50.0));
    assert!((upwards - 21.527).abs() < 0.01, "{upwards}");
}

#[test]
fn without_an_altitude_a_receiver_agrees_horizontally() {
    let mut flat = GOOD;
    (flat.stated.altitude_mm, flat.stated.vertical_accuracy_mm) = (None, u32::MAX);
    assert!(agree(flat, GOOD.raised(5_000.0)) && agree(GOOD, flat) && agree(flat, flat));
    assert!(!agree(flat, GOOD.moved(7.0, 0.0)));
    assert_eq!(once([flat, GOOD]).position.and_then(|position| position.altitude), Some(512.345));
    assert_eq!(once([flat, flat]).position.expect("a result").altitude, None);
    let mixed = once([flat, GOOD.raised(1.0), GOOD.raised(4.0)]);
    assert!((mixed.position.and_then(|position| position.altitude).expect("two have one") - 514.845).abs() < 1e-4);
}

#[test]
fn without_a_majority_there_is_no_position_and_no_exclusion() {
    let far = GOOD.moved(500.0, 0.0);
    let verdict = once([GOOD, far]);
    assert_eq!((verdict.members, verdict.excluded, verdict.position), (0, 0, None));
    let verdict = once([GOOD, far, GOOD, far, SILENT]);
    assert_eq!((verdict.members, verdict.excluded, verdict.position), (0, 0, None));
    let verdict = once([GOOD, far, GOOD, far, GOOD]);
    assert_eq!((verdict.members, verdict.excluded), (0b10101, 0b01010));
    let all_apart = [0.0, 100.0, 200.0].map(|north| GOOD.moved(north, 0.0));
    assert_eq!(once(all_apart).position, None);
}

/// A receiver that drifts away first disagrees with the right receiver that states the smaller accuracy, and only then
/// with the other one. In between it must not form a majority that excludes the first.
#[test]
fn a_receiver_that_drifts_away_never_takes_a_right_one_along() {
    let mut voter = Voter::new();
    let (one, two) = (GOOD, GOOD.moved(-3.0, 0.0).stating(1_500, 2_500));
    for tick in 0..1_000 {
        let north = f64::from(tick) * 0.02;
        let three = GOOD.stating(500, 500).moved(north, 0.0);
        let verdict = voter.vote(&[one, two, three].map(|report| report.input()), tick * 10);
        assert!(distance(place(&verdict), degrees(&one)) < 5.0);
        assert_eq!(verdict.excluded & 0b011, 0, "at {north} m");
        assert_eq!(verdict.members == 0b011, verdict.is_excluded(2), "at {north} m");
    }
    assert_eq!(voter.vote(&[one, two, two].map(|report| report.input()), 10_000).excluded, 0b100);
}

/// A majority vote cannot detect a majority that agrees on a wrong place (decision 15).
#[test]
fn two_that_agree_on_a_wrong_place_are_believed() {
    let wrong = GOOD.moved(10_000.0, 0.0);
    let verdict = once([wrong, GOOD, wrong]);
    assert_eq!((verdict.members, verdict.excluded), (0b101, 0b010));
    assert!(distance(place(&verdict), degrees(&wrong)) < 0.001);
}

#[test]
fn ties_go_to_the_last_pair_then_accuracy_then_lower_numbers() {
    // Receivers 1 and 3 are too far apart to agree, but receiver 2 agrees with both.
    let row = |accuracies: [u32; 3]| {
        let mut north = -4.0;
        accuracies.map(|mm| {
            north += 4.0;
            GOOD.stating(mm, 1_000).moved(north, 0.0).input()
        })
    };
    assert_eq!(Voter::new().vote(&row([900, 1_000, 900]), 0).members, 0b011, "the lower numbers");
    assert_eq!(Voter::new().vote(&row([901, 1_000, 900]), 0).members, 0b110, "the more accurate");
    let mut voter = Voter::new();
    assert_eq!(voter.vote(&row([900, 1_000, 901]), 0).members, 0b011);
    // Two sets have the same size, so the one with the members of the last result wins. Receiver 3 agrees with one of
    // these members, so it is not excluded.
    let verdict = voter.vote(&row([901, 1_000, 900]), 10);
    assert_eq!((verdict.members, verdict.excluded), (0b011, 0));

    // The first vote has the members 2 and 3, because receiver 1 was silent in it.
    let mut voter = Voter::new();
    let mut silent = row([900, 1_000, 901]);
    silent[0].valid = false;
    assert_eq!(voter.vote(&silent, 0).members, 0b110);
    let verdict = voter.vote(&row([900, 1_000, 901]), 10);
    assert_eq!((verdict.members, verdict.excluded), (0b110, 0), "the set that won last");
}

#[test]
fn of_equal_triples_of_five_the_lowest_numbers_win() {
    // The receivers stand in a row in the order 1 4 2 5 3. Any three neighbours in this row agree.
    let at = |norths: [f64; 5]| norths.map(|north| GOOD.stating(1_000, 1_000).moved(north, 0.0));
    assert_eq!(once(at([0.0, 4.8, 9.6, 2.4, 7.2])).members, 0b01011, "1, 2 and 4, not 2, 4 and 5 or 2, 3 and 5");
    assert_eq!(once(at([9.6, 4.8, 0.0, 7.2, 2.4])).members, 0b01011, "1, 2 and 4 again");
    assert_eq!(once(at([4.8, 0.0, 9.6, 2.4, 7.2])).members, 0b01011, "1, 2 and 4 before 1, 3 and 5");
}

/// Votes with three receivers, of which the third is wrong until `wrong_until`. Returns the tick from which on the
/// third is not excluded.
fn returns(step: u32, wrong_until: u32, third: impl Fn(u32) -> Report, start: u32) -> Option<u32> {
    let mut voter = Voter::new();
    for at in (0..5_000).step_by(step as usize) {
        let third = if at < wrong_until { GOOD.moved(200.0, 0.0) } else { third(at) };
        let verdict = voter.vote(&[GOOD, GOOD, third].map(|report| report.input()), start.wrapping_add(at));
        assert!(verdict.position.is_some() && verdict.members & 0b011 == 0b011);
        assert_ne!(verdict.is_excluded(2), verdict.members & 0b100 != 0, "excluded, or a member");
        if !verdict.is_excluded(2) {
            return Some(at);
        }
    }
    None
}

#[test]
fn an_excluded_receiver_returns_after_agreeing_for_1000_ms() {
    assert_eq!(returns(10, 10, |_| GOOD, 0), Some(1_020));
    assert_eq!(returns(10, 10, |_| GOOD, u32::MAX - 700), Some(1_020), "over the clock's wrap");
    assert_eq!(returns(1, 1, |_| GOOD, 0), Some(1_002), "not at 1000 ms, when it has agreed for 999");
    assert_eq!(returns(999, 1, |_| GOOD, 0), Some(4 * 999), "999 ms are not enough, 1998 are");
    assert_eq!(returns(1_000, 1, |_| GOOD, 0), Some(3_000), "1000 ms are");
    let breaks = |at: u32| if at == 600 { GOOD.moved(200.0, 0.0) } else { GOOD };
    assert_eq!(returns(10, 10, breaks, 0), Some(1_620), "from the start, once it has disagreed");
    let silent_once = |at: u32| if at == 600 { SILENT } else { GOOD };
    assert_eq!(returns(10, 10, silent_once, 0), Some(1_620), "or was no candidate");
    assert_eq!(returns(10, 10, |_| SILENT, 0), None, "silent it stays excluded");
    assert_eq!(returns(10, 10, |at| if at % 500 == 0 { SILENT } else { GOOD }, 0), None);
}

#[test]
fn who_was_excluded_before_a_restart_returns_after_agreeing_for_1000_ms() {
    let mut voter = Voter::excluding(0b100);
    assert_eq!(voter.excluded(), 0b100);
    let excluded = (0..2_000).step_by(10).map(|at| voter.vote(&[GOOD; 3].map(|report| report.input()), at).excluded);
    assert_eq!(excluded.take_while(|excluded| *excluded == 0b100).count(), 101);
    assert_eq!(voter.excluded(), 0);
    // A receiver that was excluded before the restart stays excluded while another receiver is missing.
    let mut voter = Voter::excluding(0b100);
    let verdict = voter.vote(&[GOOD, SILENT, GOOD.moved(200.0, 0.0)].map(|report| report.input()), 0);
    assert_eq!((verdict.members, verdict.excluded, voter.excluded()), (0, 0b100, 0b100));
}

// Shows VOTE-10.
#[test]
fn a_mask_of_exclusions_that_no_voter_comes_to_counts_as_none() {
    fn kept<const N: usize>() -> Vec<u8> {
        (1..=u8::MAX).filter(|mask| Voter::<N>::excluding(*mask).excluded() == *mask).collect()
    }
    assert_eq!((kept::<1>(), kept::<2>()), (vec![], vec![]));
    assert_eq!(kept::<3>(), [0b001, 0b010, 0b100]);
    assert_eq!(kept::<5>().len(), 5 + 10, "one or two of five");
    assert_eq!(Voter::<3>::excluding(0b110), Voter::new());
}

#[test]
fn without_a_result_an_excluded_receiver_must_agree_with_an_eligible_candidate() {
    let mut voter = Voter::new();
    let far = GOOD.moved(200.0, 0.0);
    let mut vote = |report: [Report; 3], now| voter.vote(&report.map(|report| report.input()), now);
    assert_eq!(vote([GOOD, GOOD, far], 0).excluded, 0b100);
    // Receivers 1 and 3 agree again while receiver 2 is silent. After a second receiver 3 may vote again, and both give
    // a result.
    for now in (10..=1_010).step_by(10) {
        assert_eq!(vote([GOOD, SILENT, GOOD], now).position, None);
    }
    let verdict = vote([GOOD, SILENT, GOOD], 1_020);
    assert_eq!((verdict.members, verdict.excluded), (0b101, 0));

    // If the two receivers that may vote disagree, the excluded one only has to agree with one of them to return.
    for (third, returns) in [(GOOD, true), (far, true), (GOOD.moved(0.0, 900.0), false)] {
        let mut voter = Voter::new();
        let mut vote = |report: [Report; 3], now| voter.vote(&report.map(|report| report.input()), now);
        assert_eq!(vote([GOOD, GOOD, GOOD.moved(0.0, 900.0)], 0).excluded, 0b100);
        for now in (10..=1_010).step_by(10) {
            let verdict = vote([GOOD, far, third], now);
            assert_eq!((verdict.position, verdict.excluded), (None, 0b100));
        }
        assert_eq!(vote([GOOD, far, third], 1_020).position.is_some(), returns);
    }
    // If no receiver may vote, an excluded receiver with a valid position returns without agreeing with any other.
    let mut voter = Voter::new();
    let mut vote = |report: [Report; 3], now| voter.vote(&report.map(|report| report.input()), now);
    assert_eq!(vote([GOOD, GOOD, far], 0).excluded, 0b100);
    assert_eq!(vote([SILENT, SILENT, far], 10).excluded, 0b100);
    assert_eq!(vote([SILENT, SILENT, far], 1_010).excluded, 0b100);
    assert_eq!(vote([SILENT, SILENT, far], 1_020).excluded, 0);
}

#[test]
fn who_is_no_candidate_is_neither_excluded_nor_forgiven() {
    let mut voter = Voter::new();
    let mut vote = |report: [Report; 3], now| voter.vote(&report.map(|report| report.input()), now).excluded;
    assert_eq!(vote([GOOD, GOOD, SILENT], 0), 0);
    assert_eq!(vote([GOOD, GOOD, GOOD.moved(200.0, 0.0)], 10), 0b100);
    assert_eq!(vote([GOOD, GOOD, SILENT], 20), 0b100);
    for now in (100_000..103_000).step_by(500) {
        assert_eq!(vote([SILENT, SILENT, SILENT], now), 0b100, "silence is no agreement, at {now} ms");
    }
    assert_eq!(vote([GOOD, GOOD, GOOD], 103_000), 0b100);
}

#[test]
fn the_median_follows_no_single_outlier() {
    let at = |north: f64, east: f64, up: f64| GOOD.stating(4_000, 4_000).moved(north, east).raised(up);
    let check = |verdict: Verdict, north, east, up: f64| {
        assert!(distance(place(&verdict), degrees(&GOOD.moved(north, east))) < 0.02);
        let altitude = verdict.position.and_then(|position| position.altitude).expect("3D");
        assert!((altitude - 512.345 - up).abs() < 2e-3, "{altitude}");
    };
    check(once([at(0.0, 5.0, 9.0), at(1.0, 0.0, 0.0), at(9.0, 1.0, 1.0)]), 1.0, 1.0, 1.0);
    check(once([at(0.0, 5.0, 9.0), at(1.0, 0.0, 0.0)]), 0.5, 2.5, 4.5);
    check(once([at(0.0, 0.0, 0.0), at(1.0, 1.0, 1.0), at(3.0, 3.0, 3.0), at(9.0, 9.0, 9.0), SILENT]), 2.0, 2.0, 2.0);
    let five = [at(9.0, 0.0, 5.0), at(0.0, 9.0, 4.0), at(1.0, 1.0, 3.0), at(3.0, 2.0, 2.0), at(2.0, 3.0, 1.0)];
    check(once(five), 2.0, 2.0, 3.0);
}

fn with_attitude(angles: [f32; 3]) -> Report {
    Report { attitude: Some(angles), ..GOOD }
}

#[test]
fn one_receivers_attitude_is_the_result_where_one_is_a_quorum() {
    let attitude = |report: [Report; 2]| once(report).attitude.expect("an attitude");
    for angles in [[0.1, 6.2, 3.0], [-PI, 0.0, PI], [PI, TAU, -PI]] {
        assert_eq!(once([with_attitude(angles)]).attitude, Some(angles));
        assert_eq!(attitude([with_attitude(angles), SILENT]), angles);
        assert_eq!(attitude([GOOD, with_attitude(angles)]), angles);
    }
    // The voter moves angles outside of a result's range into it by whole turns.
    let [pitch, yaw, roll] = attitude([with_attitude([7.0, -0.5, 300.0]), GOOD]);
    assert!((pitch - (7.0 - TAU)).abs() < 1e-5 && (yaw - (TAU - 0.5)).abs() < 1e-5);
    assert!((roll - (300.0 - 48.0 * TAU)).abs() < 1e-3);
}

#[test]
fn attitude_is_the_median_on_the_circle() {
    let with = with_attitude;
    let attitude = |report: [Report; 3]| once(report).attitude.expect("an attitude");
    // The compared angles lie on both sides of ±π, and on both sides of north.
    let [pitch, yaw, roll] = attitude([with([0.2, 6.2, 3.12]), with([0.17, 0.08, -3.13]), with([0.24, 6.25, -3.1])]);
    assert!((pitch - 0.2).abs() < 1e-6 && (yaw - 6.25).abs() < 1e-6 && (roll + 3.13).abs() < 1e-6);
    let [_, yaw, roll] = attitude([GOOD, with([0.0, 6.22, 3.11]), with([0.0, 0.08, -3.11])]);
    assert!((yaw - (6.22 + 0.08 + TAU) / 2.0).abs() < 1e-5 || (yaw - (6.22 + 0.08 - TAU) / 2.0).abs() < 1e-5);
    assert!((0.0..=TAU).contains(&yaw) && (roll.abs() - PI).abs() < 1e-5 && roll.abs() <= PI + 1e-6);
}

#[test]
fn attitude_needs_a_quorum_of_members_that_have_one() {
    let with = with_attitude;
    let has = |report: &[Report]| match *report {
        [a] => once([a]).attitude.is_some(),
        [a, b] => once([a, b]).attitude.is_some(),
        [a, b, c] => once([a, b, c]).attitude.is_some(),
        [a, b, c, d, e] => once([a, b, c, d, e]).attitude.is_some(),
        _ => unreachable!(),
    };
    for (receivers, least) in [(1, 1), (2, 1), (3, 2), (5, 3)] {
        for count in 0..=receivers {
            let report: Vec<_> = (0..receivers).map(|i| if i < count { with([1.0; 3]) } else { GOOD }).collect();
            assert_eq!(has(&report), count >= least, "{count} of {receivers}");
        }
    }
    // An attitude does not count if its receiver is no member, or if a value is beyond 400 rad or not finite.
    assert!(!has(&[GOOD, with([1.0; 3]), with([1.0; 3]).moved(200.0, 0.0)]));
    assert!(!has(&[with([f32::NAN, 0.0, 0.0]), with([0.0; 3]), GOOD]));
    assert!(!has(&[with([0.0, f32::INFINITY, 0.0]), with([0.0; 3]), GOOD]));
    assert!(has(&[with([0.0, 0.0, f32::NAN]), with([0.0; 3]), with([0.0; 3])]));
    assert!(has(&[with([400.0; 3])]) && !has(&[with([400.1, 0.0, 0.0])]));
    assert!(!has(&[SILENT, SILENT]) && !has(&[with([1.0; 3]), with([1.0; 3]).moved(200.0, 0.0)]));
}

#[test]
fn attitudes_agree_within_5_10_and_5_degrees_on_the_circle() {
    let degrees = |angles: [f64; 3]| with_attitude(angles.map(|angle| angle.to_radians() as f32));
    let agree = |angles: [f64; 3]| {
        [[1.0, 2.0, 3.0], [-180.0, 0.0, 180.0], [179.0, 355.0, -178.0]].map(|from| {
            let to = [0, 1, 2].map(|axis| from[axis] + angles[axis]);
            let two = once([degrees(from), degrees(to)]).attitude.is_some();
            let three = once([degrees(from), degrees(from), degrees(to)]).attitude.is_some();
            assert_eq!(two, three, "each two of all that have one");
            two
        })
    };
    for (axis, limit) in [5.0, 10.0, 5.0].into_iter().enumerate() {
        for sign in [1.0, -1.0] {
            let off = |by: f64| std::array::from_fn(|i| if i == axis { sign * by } else { 0.0 });
            assert_eq!(agree(off(limit - 1e-3)), [true; 3], "axis {axis}");
            assert_eq!(agree(off(limit + 1e-3)), [false; 3], "axis {axis}");
            assert_eq!(agree(off(180.0)), [false; 3], "axis {axis}");
        }
    }
    assert!(once([degrees([0.0; 3]), degrees([0.0, 4.0, 0.0]), degrees([0.0, -4.0, 0.0])]).attitude.is_some());
    assert!(once([degrees([0.0; 3]), degrees([0.0, 6.0, 0.0]), degrees([0.0, -6.0, 0.0])]).attitude.is_none());
}

/// Two yaws that are half a turn apart have no median: their mean would be 100°.
#[test]
fn yaw_10_and_190_degrees_of_two_receivers_is_none() {
    let yaw = |degrees: f32| with_attitude([0.0, degrees.to_radians(), 0.0]);
    let verdict = once([yaw(10.0), yaw(190.0)]);
    assert_eq!((verdict.members, verdict.attitude), (0b11, None));
}

#[test]
fn acceleration_is_the_median_of_a_quorum_that_agrees() {
    let with = |axes: [f32; 3]| Report { acceleration: Some(axes), ..GOOD };
    let acceleration = |report: [Report; 3]| once(report).acceleration;
    assert_eq!(once([with([1.0, -2.0, 3.0])]).acceleration, Some([1.0, -2.0, 3.0]));
    assert_eq!(once([GOOD, with([1.0, -2.0, 3.0])]).acceleration, Some([1.0, -2.0, 3.0]));
    assert_eq!(acceleration([with([1.0, -2.0, 3.0]), GOOD, GOOD]), None, "one of three");
    assert_eq!(
        acceleration([with([1.0, 5.0, 9.0]), with([2.0, 4.0, 7.0]), with([2.5, 3.0, 8.0])]),
        Some([2.0, 4.0, 8.0])
    );
    assert_eq!(
        acceleration([GOOD, with([1.0, 5.0, f32::MAX]), with([2.0, 4.0, f32::MAX])]),
        Some([1.5, 4.5, f32::MAX])
    );
    assert_eq!(acceleration([GOOD, with([0.0, 0.0, f32::MIN]), with([0.0, 0.0, f32::MAX])]), None);
    for axis in 0..3 {
        let off = |by: f32| with(std::array::from_fn(|i| if i == axis { by } else { 0.0 }));
        assert!(acceleration([with([0.0; 3]), off(2.0), GOOD]).is_some());
        assert!(acceleration([with([0.0; 3]), off(-2.01), GOOD]).is_none());
        assert!(acceleration([off(0.0), off(1.1), off(-1.1)]).is_none(), "each two");
        assert!(once([off(1.1), off(-1.1)]).acceleration.is_none(), "of two as well");
    }
    assert_eq!(acceleration([GOOD, with([f32::NAN, 0.0, 0.0]), with([0.0; 3])]), None);
    assert_eq!(acceleration([GOOD, with([1.0; 3]), with([1.0; 3]).moved(200.0, 0.0)]), None);
    assert_eq!(acceleration([GOOD, GOOD, GOOD]), None);
}

const FLAT: Report = Report { stated: Stated { altitude_mm: None, ..Report::GOOD.stated }, ..Report::GOOD };

fn altitude(verdict: &Verdict) -> Option<f64> {
    verdict.position.expect("a result").altitude
}

#[test]
fn an_altitude_needs_a_quorum_of_members_that_have_one() {
    let high = GOOD.raised(500.0);
    assert_eq!(altitude(&once([FLAT])), None);
    assert_eq!(altitude(&once([FLAT, high])), Some(1_012.345));
    let verdict = once([FLAT, FLAT, high]);
    assert_eq!((verdict.members, altitude(&verdict), verdict.excluded), (0b111, None, 0));
    let verdict = once([GOOD, FLAT, high]);
    assert_eq!((verdict.agreeing(), altitude(&verdict), verdict.excluded), (2, None, 0));
    let verdict = once([GOOD.stating(1_400, 2_500), FLAT, high]);
    assert_eq!((verdict.members, altitude(&verdict)), (0b011, None), "whatever accuracies say");
    let verdict = once([GOOD, GOOD, high]);
    assert_eq!((verdict.members, altitude(&verdict), verdict.excluded), (0b011, Some(512.345), 0b100));
    assert_eq!(altitude(&once([GOOD, FLAT, GOOD])), Some(512.345));
    assert_eq!(once([GOOD, SILENT, high]).position, None);
    for count in 0..=5 {
        let report = std::array::from_fn::<_, 5, _>(|i| if i < count { GOOD } else { FLAT });
        assert_eq!(altitude(&once(report)).is_some(), count >= 3, "{count} of five");
    }
}

#[test]
fn who_contradicts_a_quorum_of_altitudes_is_excluded_beside_members_without_one() {
    let high = GOOD.raised(500.0);
    let verdict = once([FLAT, GOOD, GOOD, GOOD, high]);
    assert_eq!((verdict.members, altitude(&verdict), verdict.excluded), (0b01111, Some(512.345), 0b10000));
    // Only two of five altitudes agree, so nobody can tell which altitude is right.
    let verdict = once([FLAT, FLAT, GOOD, GOOD, high]);
    assert_eq!((verdict.members, altitude(&verdict), verdict.excluded), (0b01111, None, 0));
    // A receiver without an altitude contradicts no other, and may vote if it agrees in position with a receiver that
    // has one.
    let verdict = once([FLAT.moved(7.0, 0.0), FLAT.moved(4.0, 0.0), GOOD, GOOD, GOOD]);
    assert_eq!((verdict.members, verdict.excluded), (0b11110, 0));
    let verdict = once([FLAT, GOOD, GOOD, GOOD.raised(-7.0), GOOD.raised(9.0).stating(1_500, 100)]);
    assert_eq!((verdict.members, verdict.excluded), (0b01111, 0b10000));
    let verdict = once([FLAT, GOOD, GOOD.raised(1.5), GOOD.raised(-7.0), GOOD.raised(9.0).stating(1_500, 100)]);
    assert_eq!((verdict.members, verdict.excluded), (0b01111, 0));
}

/// A voter over three receivers that send the same values at every tick.
struct Flight {
    voter: Voter<3>,
    now: u32,
}

impl Flight {
    fn begun(now: u32) -> Self {
        let mut flight = Self { voter: Voter::new(), now };
        assert!(flight.is_shown(GOOD), "the first is shown");
        flight
    }

    fn tick(&mut self, report: Report) -> Verdict {
        let verdict = self.voter.vote(&[report; 3].map(|report| report.input()), self.now);
        self.now = self.now.wrapping_add(10);
        verdict
    }

    fn is_shown(&mut self, report: Report) -> bool {
        self.tick(report).position.is_some()
    }

    /// Makes all receivers jump to this report. Returns for how many ms no position is shown after that.
    fn withheld(&mut self, report: Report) -> u32 {
        (0..).find(|_| self.is_shown(report)).expect("some time it is") * 10
    }
}

#[test]
fn a_jump_of_all_receivers_is_shown_after_1000_ms() {
    for start in [0, u32::MAX - 500] {
        let mut flight = Flight::begun(start);
        let far = GOOD.moved(1_000.0, 0.0);
        let verdict = flight.tick(far);
        assert_eq!(verdict, Verdict::NONE, "nothing is shown, and nobody is excluded");
        assert_eq!(flight.withheld(far), 990, "with the tick before: 1000 ms");
        let verdict = flight.tick(far);
        assert!(distance(place(&verdict), degrees(&far)) < 0.001);
        assert_eq!(verdict.members, 0b111);
    }
}

/// Within 10 ms the place may change by what the accuracies allow, plus 2 m at 200 m/s. A receiver at rest has
/// accuracies of 1.505 and 2.505 m.
#[test]
fn a_step_beyond_speed_and_accuracies_is_a_jump() {
    let shown = |by: Report| Flight::begun(0).is_shown(by);
    let reach = 3.0 * 2.0_f64.sqrt() * 1.505 + 2.0;
    assert!(shown(GOOD.moved(reach - 0.02, 0.0)) && !shown(GOOD.moved(reach + 0.02, 0.0)));
    assert!(shown(GOOD.moved(0.0, 0.02 - reach)) && !shown(GOOD.moved(0.0, -0.02 - reach)));
    let (a, b) = (reach * 0.6, reach * 0.8);
    assert!(shown(GOOD.moved(a - 0.02, b - 0.02)) && !shown(GOOD.moved(a + 0.02, b + 0.02)));
    // Two results may have different accuracies. Some of the pairs reach the least and the greatest step that can count
    // as no jump.
    let between = |one: u32, other: u32, by: f64| {
        let mut flight = Flight { voter: Voter::new(), now: 0 };
        assert!(flight.is_shown(GOOD.stating(one, 2_500)));
        flight.is_shown(GOOD.stating(other, 2_500).moved(by, 0.0))
    };
    for (one, other, allowed) in
        [(1, 1, 5.0), (30_000, 30_000, 30.0), (1, 4_995, 15.0), (4_995, 1, 15.0), (2_995, 3_995, 15.0)]
    {
        assert!(between(one, other, allowed + 1.98), "{one} {other}");
        assert!(!between(one, other, allowed + 2.03), "{one} {other}");
    }
    // The greatest step that counts as no jump grows with the time: after 1000 ms without a position it is 200 m plus
    // 6.4 m.
    for (by, expected) in [(206.3, true), (206.5, false)] {
        let mut flight = Flight::begun(0);
        flight.now = 1_000;
        assert_eq!(flight.is_shown(GOOD.moved(by, 0.0)), expected, "{by} m");
    }
}

#[test]
fn the_least_accurate_member_counts_for_a_jump() {
    for worst in 0..3 {
        let mut flight = Flight::begun(0);
        let moved = |by: f64| {
            [0, 1, 2].map(|i| if i == worst { GOOD.stating(4_995, 2_500) } else { GOOD }.moved(by, 0.0).input())
        };
        // The greatest step that counts as no jump is 3 √(1.505² + 5²) m plus 2 m.
        assert!(flight.voter.clone().vote(&moved(17.64), 10).position.is_some());
        assert!(flight.voter.vote(&moved(17.69), 10).position.is_none());
    }
}

#[test]
fn a_jump_is_shown_once_it_could_have_been_flown() {
    // A jump of 100 m is held back for 460 ms: 6.4 m are allowed at once, the rest takes 468 ms at 200 m/s, and the
    // first tick comes 10 ms after the last one.
    assert_eq!(Flight::begun(0).withheld(GOOD.moved(100.0, 0.0)), 460);
    // After hours without a position almost any step is possible, so it is no jump.
    let mut flight = Flight::begun(0);
    flight.now = 7_200_000;
    assert!(flight.is_shown(GOOD.moved(1_000_000.0, 0.0)));
}

#[test]
fn what_is_held_back_must_continue_at_every_tick() {
    let far = GOOD.moved(1_000.0, 0.0);
    let farther = GOOD.moved(1_020.0, 0.0);
    let mut flight = Flight::begun(0);
    (0..50).for_each(|_| assert!(!flight.is_shown(far)));
    assert!(!flight.is_shown(SILENT));
    assert_eq!(flight.withheld(far), 1_000, "anew after a tick without one");
    let mut flight = Flight::begun(0);
    (0..50).for_each(|_| assert!(!flight.is_shown(far)));
    assert_eq!(flight.withheld(farther), 1_000, "anew from a place that does not follow");
    let mut flight = Flight::begun(0);
    let moving = |tick: i32| GOOD.moved(2_000.0 + 1.5 * f64::from(tick), 0.0);
    assert_eq!((0..).position(|tick| flight.is_shown(moving(tick))), Some(100));
}

#[test]
fn who_comes_back_from_a_jump_is_shown_at_once() {
    let mut flight = Flight::begun(0);
    (0..99).for_each(|_| assert!(!flight.is_shown(GOOD.moved(1_000.0, 0.0))));
    assert!(flight.is_shown(GOOD));
    assert_eq!(flight.withheld(GOOD.moved(1_000.0, 0.0)), 1_000, "what was held back is forgotten");
    assert_eq!(flight.withheld(GOOD), 1_000, "what was shown last is the far place now");
}

#[test]
fn no_receiver_is_excluded_while_a_jump_is_held_back() {
    let mut voter = Voter::new();
    let far = GOOD.moved(1_000.0, 0.0);
    let mut vote = |report: [Report; 3], now| voter.vote(&report.map(|report| report.input()), now);
    assert_eq!(vote([GOOD, GOOD, GOOD], 0).members, 0b111);
    for now in (10..1_010).step_by(10) {
        assert_eq!(vote([GOOD, far, far], now), Verdict::NONE);
    }
    let verdict = vote([GOOD, far, far], 1_010);
    assert_eq!((verdict.members, verdict.excluded), (0b110, 0b001));
}

#[test]
fn an_altitude_that_jumps_is_held_back_by_itself() {
    let high = GOOD.raised(500.0);
    let mut flight = Flight::begun(0);
    for _ in 0..100 {
        let verdict = flight.tick(high);
        assert_eq!((verdict.members, altitude(&verdict)), (0b111, None));
    }
    assert_eq!(altitude(&flight.tick(high)), Some(1_012.345));
    // The greatest step in height that is no jump is three deviations of the height's difference, 3 √2 · 2.505 m, plus
    // 2 m of flight.
    let reach = 3.0 * 2.0_f64.sqrt() * 2.505 + 2.0;
    for sign in [1.0, -1.0] {
        for (by, shown) in [(reach - 0.01, true), (reach + 0.01, false)] {
            assert_eq!(altitude(&Flight::begun(0).tick(GOOD.raised(sign * by))).is_some(), shown, "{by}");
        }
    }
    // While the result has no altitude, the last altitude shown stays the reference for jumps, and the step allowed
    // from it grows with the time.
    let mut flight = Flight::begun(0);
    (0..10).for_each(|_| assert_eq!(altitude(&flight.tick(FLAT)), None));
    assert_eq!(altitude(&flight.tick(GOOD.raised(33.0))), None);
    assert_eq!(altitude(&flight.tick(FLAT)), None);
    assert_eq!(altitude(&flight.tick(GOOD.raised(33.0))), Some(545.345), "130 ms: 10.6 m and 26 m");
}

#[test]
fn a_place_and_an_altitude_that_jump_together_are_shown_together() {
    let far = GOOD.moved(1_000.0, 0.0).raised(400.0);
    let mut flight = Flight::begun(0);
    (0..100).for_each(|_| assert!(!flight.is_shown(far)));
    let position = flight.tick(far).position.expect("it has held");
    assert_eq!(position.altitude, Some(912.345));
    // An altitude first appears when the new place has lasted for a second. It must itself last for a second before it
    // is shown.
    let mut flight = Flight::begun(0);
    let (flat, high) = (FLAT.moved(3_000.0, 0.0), GOOD.moved(3_000.0, 0.0).raised(900.0));
    (0..100).for_each(|_| assert!(!flight.is_shown(flat)));
    for _ in 0..100 {
        let Position { altitude, .. } = flight.tick(high).position.expect("the place has held");
        assert_eq!(altitude, None);
    }
    assert!(altitude(&flight.tick(high)).is_some());
}

#[test]
fn places_far_apart_never_agree_not_even_opposite_ones() {
    let at = |latitude: i32, longitude: i32| {
        let mut report = GOOD;
        (report.stated.latitude_e7, report.stated.longitude_e7) = (latitude * 10_000_000, longitude * 10_000_000);
        report.stating(30_000, 50_000)
    };
    for (one, other) in [
        (at(0, 0), at(0, 180)),
        (at(0, 90), at(0, -90)),
        (at(90, 0), at(-90, 0)),
        (at(90, 0), at(-90, 180)),
        (at(45, 10), at(-45, -170)),
        (at(0, 0), at(0, 90)),
        (at(0, 0), at(90, 0)),
        (at(47, 8), at(47, 9)),
        (at(47, 8), at(48, 8)),
    ] {
        assert!(!agree(one, other), "{:?} {:?}", one.stated, other.stated);
    }
    assert!(agree(at(0, 180), at(0, -180)) && agree(at(90, 17), at(90, -120)) && agree(at(-90, 0), at(-90, 180)));
}

#[test]
fn a_flight_across_the_pole_or_180_degrees_is_extrapolated_correctly() {
    let mut report = GOOD;
    // The position is 11.2 m before the pole at 8.7°, flying north at 100 m/s, and 0.55 s old. At the tick the receiver
    // is 43.8 m beyond the pole, at -171.3°.
    (report.stated.latitude_e7, report.stated.altitude_mm) = (899_999_000, None);
    let report = Report { since_arrival_ms: 500, ..report }.flying([100_000, 0, 0]);
    let (latitude, longitude) = place(&once([report]));
    assert!((latitude - (90.0 - (55.0 - 11.17) / 111_694.0)).abs() < 2e-7, "{latitude}");
    assert!((longitude - (8.729_123_4 - 180.0)).abs() < 1e-4, "{longitude}");
    let mut report = GOOD;
    (report.stated.latitude_e7, report.stated.longitude_e7) = (0, -1_800_000_000);
    let west = Report { since_arrival_ms: 500, ..report }.flying([0, -100_000, 0]);
    let (_, longitude) = place(&once([west]));
    assert!((longitude - (180.0 - 55.0 / 111_328.0)).abs() < 1e-6, "{longitude}");
    report.stated.longitude_e7 = 1_800_000_000;
    let east = Report { since_arrival_ms: 500, ..report }.flying([0, 100_000, 0]);
    let (_, longitude) = place(&once([east]));
    assert!((longitude + 180.0 - 55.0 / 111_328.0).abs() < 1e-6, "{longitude}");
}

fn anything() -> impl Strategy<Value = Report> {
    let floats = || prop::option::of(any::<[u32; 3]>().prop_map(|bits| bits.map(f32::from_bits)));
    (any::<bool>(), any::<[i32; 6]>(), any::<[u32; 3]>(), any::<i32>(), floats(), floats(), any::<bool>()).prop_map(
        |(valid, ints, [horizontal, vertical, lag_ms], since_arrival_ms, attitude, acceleration, flat)| Report {
            valid,
            stated: Stated {
                latitude_e7: ints[0],
                longitude_e7: ints[1],
                altitude_mm: (!flat).then_some(ints[2]),
                velocity_mm_s: [ints[3], ints[4], ints[5]],
                horizontal_accuracy_mm: horizontal,
                vertical_accuracy_mm: vertical,
            },
            since_arrival_ms,
            lag_ms,
            attitude,
            acceleration,
        },
    )
}

fn wrong() -> impl Strategy<Value = Report> {
    prop_oneof![
        anything(),
        (anything(), -60.0..60.0, -60.0..60.0, -90.0..90.0, 0_u8..8).prop_map(|(any, north, east, up, keep)| {
            let mut report = GOOD.moved(north, east).raised(up);
            if keep & 1 == 0 {
                report.stated.horizontal_accuracy_mm = any.stated.horizontal_accuracy_mm % 32_000;
            }
            if keep & 2 == 0 {
                report.stated.velocity_mm_s = any.stated.velocity_mm_s.map(|v| v % 150_000);
            }
            if keep & 4 == 0 {
                report.since_arrival_ms = any.since_arrival_ms;
                report.lag_ms = any.lag_ms % WEEK_MS;
            }
            Report { attitude: any.attitude, acceleration: any.acceleration, ..report }
        }),
    ]
}

proptest! {
    #![proptest_config(seeded(4_000))]

    /// The result lies between the right receivers, or at most as far from one of them as two receivers that agree can
    /// be apart.
    // Shows VOTE-8.
    #[test]
    fn one_wrong_receiver_of_three_moves_the_position_within_bounds(
        wrongs in prop::collection::vec(wrong(), 1..6),
        north in 0.0..4.0,
        which in 0_usize..3,
    ) {
        let mut voter = Voter::<3>::new();
        let right = [GOOD, GOOD.moved(north, 0.0)];
        for (now, wrong) in (0..).step_by(10).zip(wrongs) {
            let mut report = vec![right[0], right[1]];
            report.insert(which, wrong);
            let verdict = voter.vote(&[0, 1, 2].map(|i: usize| report[i].input()), now);
            let position = verdict.position.expect("two agree");
            let off = right.map(|right| distance((position.latitude, position.longitude), degrees(&right)));
            prop_assert!(off[0].min(off[1]) <= 30.01, "{:?} m off", off);
            let altitude = position.altitude.expect("two have one");
            prop_assert!((altitude - 512.345).abs() <= 50.01);
            // If both right receivers are members, the result lies between them.
            let others = 0b111 & !(1 << which);
            if verdict.members & others == others {
                prop_assert!(off[0].max(off[1]) <= north + 0.02, "{:?} m off", off);
                prop_assert!((altitude - 512.345).abs() < 1e-3);
            }
            for value in verdict.attitude.into_iter().chain(verdict.acceleration).flatten() {
                prop_assert!(value.is_finite());
            }
        }
    }

    #[test]
    fn whatever_is_said_the_verdict_is_sound(
        ticks in prop::collection::vec([wrong(), wrong(), wrong(), wrong(), wrong()], 1..8),
    ) {
        let mut voter = Voter::<5>::new();
        for (now, report) in (0..).step_by(10).zip(ticks) {
            let verdict = voter.vote(&report.map(|report| report.input()), now);
            prop_assert_eq!(verdict.members & verdict.excluded, 0);
            prop_assert_eq!(verdict.position.is_some(), verdict.members != 0);
            prop_assert!(verdict.members == 0 || verdict.agreeing() >= 3);
            prop_assert!(listed(verdict.members).iter().all(|i| report[*i].valid));
            if let Some(position) = verdict.position {
                prop_assert!(position.latitude.abs() <= 90.0 && position.longitude.abs() <= 180.0);
                prop_assert!(position.altitude.is_none_or(f64::is_finite));
            }
            for value in verdict.attitude.into_iter().chain(verdict.acceleration).flatten() {
                prop_assert!(value.is_finite());
            }
        }
    }
}
