//! Tests which cycles are in sequence: each limit, and random histories against an oracle that is written from the
//! definition.
use profile::sequence::{HOLD_US, Judgement, MAX_MISSED, Sequence};
use proptest::prelude::*;

fn held(timestamp: u32, at_us: u64) -> Sequence {
    let mut sequence = Sequence::new();
    for back in (0..4_u32).rev() {
        let at_us = at_us.wrapping_sub(u64::from(back) * 10_000);
        let judgement = sequence.judge(timestamp.wrapping_sub(10 * back), at_us);
        assert_eq!(judgement.is_in_sequence(), back == 0);
    }
    sequence
}

/// The judgement of a cycle that follows a found sequence. The cycle's timestamp is `step_ms` later than the last one.
/// Its sample is `passed_us` later on the receiver's clock.
fn step(step_ms: u32, passed_us: i64) -> Judgement {
    let start_us = 1_000_000_u64;
    held(5_000, start_us).judge(5_000_u32.wrapping_add(step_ms), start_us.wrapping_add_signed(passed_us))
}

// Shows SEQ-3.
#[test]
fn the_fourth_cycle_is_the_first_in_sequence() {
    let mut sequence = Sequence::new();
    assert!(!sequence.is_held(0));
    assert_eq!(sequence.last(), None);
    let judgements = [0, 1, 2, 3, 4].map(|cycle: u32| {
        let judgement = sequence.judge(10 * cycle, 500 + 10_000 * u64::from(cycle));
        assert_eq!(sequence.is_held(500 + 10_000 * u64::from(cycle)), judgement.is_in_sequence());
        judgement
    });
    let searching = |found| Judgement::Searching { found };
    let in_sequence = Judgement::InSequence { missed: 0 };
    assert_eq!(judgements, [searching(0), searching(1), searching(2), in_sequence, in_sequence]);
    assert_eq!(sequence.last().map(|last| (last.timestamp, last.sampled_us)), Some((40, 40_500)));
}

// Shows SEQ-6.
#[test]
fn a_restart_of_horus_is_shown_again_from_its_fourth_cycle_on() {
    let mut sequence = held(90_000, 1_000_000);
    let shown = (0..6_u32).map(|cycle| sequence.judge(10 * cycle, 3_000_000 + 10_000 * u64::from(cycle)));
    let shown: Vec<_> = shown.collect();
    assert_eq!(shown[0], Judgement::Restarted);
    assert_eq!(shown.iter().position(|judgement| judgement.is_in_sequence()), Some(3));
}

// Shows SEQ-5.
#[test]
fn a_clock_off_by_exactly_2_percent_is_plausible() {
    for (cycles, window_us, implausible) in
        [(98_u32, 1_000_000, false), (98, 1_000_001, true), (102, 1_000_000, false), (103, 1_009_803, true)]
    {
        let mut sequence = held(5_000, 1_000_000);
        for cycle in 1..=cycles {
            let passed_us = window_us * u64::from(cycle) / u64::from(cycles);
            let judgement = sequence.judge(5_000 + 10 * cycle, 1_000_000 + passed_us);
            assert!(judgement.is_in_sequence() && (cycle == cycles || !sequence.is_clock_implausible()));
        }
        assert_eq!(sequence.is_clock_implausible(), implausible, "{cycles} cycles in {window_us} µs");
    }
}

// Shows SEQ-4.
#[test]
fn two_timestamps_in_turn_are_never_in_sequence() {
    for apart_us in [10_000, 5_000, 1_000, 9_600] {
        for mut sequence in [Sequence::new(), held(30, 0)] {
            for turn in 1..1_000_u64 {
                let judgement = sequence.judge(if turn % 2 == 1 { 20 } else { 10 }, apart_us * turn);
                assert!(!judgement.is_in_sequence(), "turn {turn}");
                assert!(!sequence.is_held(apart_us * turn));
            }
        }
    }
}

// Shows SEQ-1.
#[test]
fn twenty_five_missed_cycles_are_in_sequence_and_twenty_six_are_not() {
    for missed in 0..=30 {
        let expected = if missed <= 25 { Judgement::InSequence { missed } } else { Judgement::Irregular };
        assert_eq!(step(10 * (missed + 1), 10_000 * (i64::from(missed) + 1)), expected);
    }
    assert_eq!(MAX_MISSED, 25);
}

// Shows SEQ-2.
#[test]
fn two_cycles_may_be_off_by_2_5_ms_and_2_percent() {
    // Each row has the step of the timestamps, ms, and the least and the greatest time, µs, that may pass in it.
    for (ms, least, most) in
        [(10, 7_300, 12_700), (20, 17_100, 22_900), (130, 124_900, 135_100), (260, 252_300, 267_700)]
    {
        let in_sequence = Judgement::InSequence { missed: ms / 10 - 1 };
        assert_eq!(step(ms, least - 1), Judgement::Early, "{ms} ms");
        assert_eq!(step(ms, least), in_sequence, "{ms} ms");
        assert_eq!(step(ms, most), in_sequence, "{ms} ms");
        assert_eq!(step(ms, most + 1), Judgement::Late, "{ms} ms");
    }
    assert_eq!(step(10, 0), Judgement::Early);
    assert_eq!(step(10, -10_000), Judgement::Early);
    assert_eq!(step(10, i64::MIN), Judgement::Early);
    assert_eq!(step(10, i64::MAX), Judgement::Late);
}

// Shows SEQ-3.
#[test]
fn the_search_accepts_only_steps_of_one_cycle_within_half_a_millisecond() {
    let third = |step_ms: u32, passed_us: u64| {
        let mut sequence = Sequence::new();
        for cycle in 0..3_u32 {
            sequence.judge(10 * cycle, 10_000 * u64::from(cycle));
        }
        sequence.judge(20 + step_ms, 20_000 + passed_us)
    };
    let again = Judgement::Searching { found: 0 };
    let found = Judgement::InSequence { missed: 0 };
    assert_eq!(third(10, 9_499), again);
    assert_eq!(third(10, 9_500), found);
    assert_eq!(third(10, 10_500), found);
    assert_eq!(third(10, 10_501), again);
    assert_eq!(third(20, 20_000), again);
    assert_eq!(third(20, 10_000), Judgement::Early);
    assert_eq!(third(10, 7_299), Judgement::Early);
    assert_eq!(third(10, 12_701), Judgement::Late);
    assert_eq!(third(0, 10_000), Judgement::Frozen);
    assert_eq!(third(15, 15_000), Judgement::Irregular);
}

// Shows SEQ-3.
#[test]
fn any_other_step_requires_three_exact_steps_anew() {
    for (step_ms, passed_us) in [(0, 10_000), (10, 5_000), (10, 15_000), (13, 13_000), (-10, 10_000), (270, 270_000)] {
        let mut sequence = held(5_000, 0);
        let (mut timestamp, mut now) = (5_000_u32.wrapping_add_signed(step_ms), passed_us);
        assert!(!sequence.judge(timestamp, now).is_in_sequence());
        for in_sequence in [false, false, true, true] {
            (timestamp, now) = (timestamp + 10, now + 10_000);
            assert_eq!(sequence.judge(timestamp, now).is_in_sequence(), in_sequence, "{step_ms} ms, {passed_us} µs");
        }
    }
}

#[test]
fn a_search_that_is_interrupted_starts_again_from_nothing() {
    for (step_ms, passed_us) in [(0, 10_000), (20, 20_000), (10, 11_000), (10, 9_000), (10, 2_000), (-10, 10_000)] {
        let mut sequence = Sequence::new();
        sequence.judge(1_000, 0);
        sequence.judge(1_010, 10_000);
        sequence.judge(1_020, 20_000);
        let (mut timestamp, mut now) = (1_020_u32.wrapping_add_signed(step_ms), 20_000 + passed_us);
        assert!(!sequence.judge(timestamp, now).is_in_sequence());
        for in_sequence in [false, false, true] {
            (timestamp, now) = (timestamp + 10, now + 10_000);
            assert_eq!(sequence.judge(timestamp, now).is_in_sequence(), in_sequence, "{step_ms} ms, {passed_us} µs");
        }
    }
}

#[test]
fn cycles_one_millisecond_apart_are_never_in_sequence() {
    let mut sequence = held(5_000, 0);
    for cycle in 1..500_u32 {
        let judgement = sequence.judge(5_000 + 10 * cycle, 1_000 * u64::from(cycle));
        assert_eq!(judgement, Judgement::Early);
    }
}

#[test]
fn a_wrap_of_the_timestamp_is_no_break() {
    let mut sequence = held(u32::MAX - 95, 0);
    for cycle in 1..=20_u32 {
        let judgement = sequence.judge((u32::MAX - 95).wrapping_add(10 * cycle), 10_000 * u64::from(cycle));
        assert_eq!(judgement, Judgement::InSequence { missed: 0 });
    }
}

#[test]
fn no_silence_is_long_enough_to_look_like_one_cycle() {
    // A silence of 2³² µs or 2³² ms must not look like a single cycle because a 32-bit counter or a timestamp wraps.
    for silence_us in [1_u64 << 32, 1 << 33, 1_000 << 32, 1 << 62] {
        let mut sequence = held(5_000, 70_000);
        assert_eq!(sequence.judge(5_010, 80_000 + silence_us), Judgement::Late);
        assert_eq!(sequence.judge(5_020, 90_000 + silence_us), Judgement::Searching { found: 1 });
    }
}

#[test]
fn the_sequence_is_held_until_no_cycle_could_continue_it() {
    assert_eq!(HOLD_US, 267_700);
    let sequence = held(5_000, 1_000_000);
    assert!(sequence.is_held(1_000_000));
    assert!(sequence.is_held(1_000_000 + 267_700));
    assert!(!sequence.is_held(1_000_000 + 267_701));
    assert!(!sequence.is_held(1_000_000 + (1 << 32)));
}

/// Judges `cycles` cycles of a HORUS whose 10 ms last `rate` µs on the receiver's clock. Returns the number of the
/// first cycle after which HORUS's clock is implausible.
fn run(sequence: &mut Sequence, rate: u64, cycles: u32) -> Option<u32> {
    let mut noticed = None;
    for cycle in 1..=cycles {
        let last = sequence.last().expect("held");
        let judgement = sequence.judge(last.timestamp + 10, last.sampled_us + rate);
        assert_eq!(judgement, Judgement::InSequence { missed: 0 });
        if sequence.is_clock_implausible() {
            noticed.get_or_insert(cycle);
        }
    }
    noticed
}

#[test]
fn a_clock_off_by_over_2_percent_is_reported_within_two_windows() {
    // HORUS's clock is wrong by 2 % of the receiver's time if its 10 ms last 9 803.9 or 10 204.1 µs.
    for (rate, wrong) in [(9_803, true), (9_804, false), (10_204, false), (10_205, true), (7_300, true), (12_700, true)]
    {
        for right_for in [0, 1, 37, 99, 100, 101] {
            let mut sequence = held(5_000, 40_000);
            assert_eq!(run(&mut sequence, 10_000, right_for), None);
            let noticed = run(&mut sequence, rate, 300);
            assert_eq!(noticed.is_some(), wrong, "{rate} µs");
            if let Some(cycles) = noticed {
                assert!(u64::from(cycles) * rate <= 2_100_000, "{rate} µs: noticed after {cycles} cycles");
                let mut right = 0;
                while sequence.is_clock_implausible() {
                    run(&mut sequence, 10_000, 1);
                    right += 1;
                }
                assert!(right <= 210, "{rate} µs: believed again after {right} cycles");
            }
        }
    }
}

// Shows SEQ-5.
#[test]
fn the_clocks_are_compared_over_one_second_and_not_less() {
    let mut sequence = held(5_000, 40_000);
    assert_eq!(run(&mut sequence, 10_000, 1), None);
    let mut sequence = held(5_000, 40_000);
    assert_eq!(run(&mut sequence, 12_500, 300), Some(80));
    let mut sequence = held(5_000, 40_000);
    assert_eq!(run(&mut sequence, 8_000, 300), Some(125));
    // A clock that is right again becomes plausible when the first window without a difference ends, after 1 s.
    let mut sequence = held(5_000, 40_000);
    assert_eq!(run(&mut sequence, 12_500, 80), Some(80));
    assert_eq!(run(&mut sequence, 10_000, 99), Some(1));
    assert!(sequence.is_clock_implausible());
    assert_eq!(run(&mut sequence, 10_000, 1), None);
}

#[test]
fn with_the_sequence_what_was_found_of_the_clock_is_lost() {
    let mut sequence = held(5_000, 40_000);
    run(&mut sequence, 10_500, 300);
    assert!(sequence.is_clock_implausible());
    let last = sequence.last().expect("held");
    assert_eq!(sequence.judge(last.timestamp, last.sampled_us + 10_000), Judgement::Frozen);
    assert!(!sequence.is_clock_implausible());
    for cycle in 1..=3 {
        sequence.judge(last.timestamp + 10 * cycle, last.sampled_us + 10_000 + 10_000 * u64::from(cycle));
    }
    assert!(!sequence.is_clock_implausible());
    assert_eq!(run(&mut sequence, 12_500, 100), Some(80));
}

/// The definition of a sequence as a test oracle, which judges the whole history of cycles anew each time.
mod oracle {
    pub(crate) type Arrival = (u32, i128);

    fn advance(before: Arrival, now: Arrival) -> Option<i128> {
        let ms = (i128::from(now.0) - i128::from(before.0)).rem_euclid(1 << 32);
        (1..=26).map(|cycles| cycles * 10).find(|&possible| possible == ms)
    }

    fn continues(before: Arrival, now: Arrival) -> bool {
        advance(before, now).is_some_and(|ms| {
            let off = 50 * (now.1 - before.1 - 1_000 * ms);
            let allowed = 50 * 2_500 + 1_000 * ms;
            -allowed <= off && off <= allowed
        })
    }

    fn exact(before: Arrival, now: Arrival) -> bool {
        advance(before, now) == Some(10) && (9_500..=10_500).contains(&(now.1 - before.1))
    }

    /// Whether the last cycle of `history` is in sequence: three exact steps in a row find the sequence, and each later
    /// step continues it.
    pub(crate) fn in_sequence(history: &[Arrival]) -> bool {
        let steps: Vec<_> = history.windows(2).map(|pair| (pair[0], pair[1])).collect();
        (3..=steps.len()).any(|end| {
            steps[end - 3..end].iter().all(|&(before, now)| exact(before, now))
                && steps[end..].iter().all(|&(before, now)| continues(before, now))
        })
    }

    /// Returns the index of the cycle that found the sequence to which the last cycle of `history` belongs.
    fn found(history: &[Arrival]) -> Option<usize> {
        (0..history.len()).find(|&cycle| (cycle..history.len()).all(|end| in_sequence(&history[..=end])))
    }

    pub(crate) fn clock_implausible(history: &[Arrival]) -> bool {
        let Some(start) = found(history) else { return false };
        let mut edges = vec![history[start]];
        for &(timestamp, at) in &history[start..] {
            if at - edges[edges.len() - 1].1 >= 1_000_000 {
                edges.push((timestamp, at));
            }
        }
        edges.windows(2).last().is_some_and(|edge| {
            let horus = 1_000 * (i128::from(edge[1].0) - i128::from(edge[0].0)).rem_euclid(1 << 32);
            let receiver = edge[1].1 - edge[0].1;
            (horus - receiver).abs() * 100 > receiver * 2
        })
    }
}

fn steps() -> impl Strategy<Value = (u32, i64)> {
    prop_oneof![
        12 => Just((10, 10_000)),
        4 => (9_400_i64..10_600).prop_map(|us| (10, us)),
        2 => (7_200_i64..12_800).prop_map(|us| (10, us)),
        2 => (1_u32..28, -8_000_i64..8_000).prop_map(|(cycles, off)| (10 * cycles, 10_000 * i64::from(cycles) + off)),
        1 => (0_u32..300, 0_i64..300_000),
        1 => (any::<u32>(), any::<u32>().prop_map(i64::from)),
        1 => Just((0, 10_000)),
        1 => Just((10_u32.wrapping_neg(), 10_000)),
        1 => (-20_000_i64..20_000).prop_map(|us| (10, us)),
        1 => (1_u32..5).prop_map(|turns| (10, 10_000 + (i64::from(turns) << 32))),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn any_history_is_judged_as_the_definition_says(
        timestamp: u32, at_us in 0_u64..1 << 40, steps in prop::collection::vec(steps(), 1..80),
    ) {
        let mut sequence = Sequence::new();
        let mut history: Vec<oracle::Arrival> = Vec::new();
        let (mut timestamp, mut at_us) = (timestamp, at_us);
        for (ms, us) in steps {
            (timestamp, at_us) = (timestamp.wrapping_add(ms), at_us.saturating_add_signed(us));
            let judgement = sequence.judge(timestamp, at_us);
            history.push((timestamp, i128::from(at_us)));
            let expected = oracle::in_sequence(&history);
            prop_assert_eq!(judgement.is_in_sequence(), expected);
            prop_assert_eq!(sequence.is_held(at_us), expected);
            prop_assert_eq!(sequence.is_clock_implausible(), oracle::clock_implausible(&history));
        }
    }

    #[test]
    fn a_clock_at_any_rate_is_judged_as_the_definition_requires(
        rate in 9_600_i64..10_400, later in 7_400_i64..12_600, missed in prop::collection::vec(0_u32..4, 200..300),
    ) {
        let mut sequence = Sequence::new();
        let mut history: Vec<oracle::Arrival> = Vec::new();
        let (mut timestamp, mut at_us) = (0_u32, 0_u64);
        for (cycle, missed) in missed.into_iter().enumerate() {
            let (missed, rate) = if cycle < 4 { (0, rate) } else if cycle < 120 { (missed, rate) } else { (0, later) };
            (timestamp, at_us) = (timestamp + 10 * (missed + 1), at_us + (rate * i64::from(missed + 1)).unsigned_abs());
            sequence.judge(timestamp, at_us);
            history.push((timestamp, i128::from(at_us)));
        }
        prop_assert_eq!(sequence.is_held(at_us), oracle::in_sequence(&history));
        prop_assert_eq!(sequence.is_clock_implausible(), oracle::clock_implausible(&history));
    }

    // Shows SEQ-4.
    #[test]
    fn no_misplaced_frame_is_judged_in_sequence(
        error in 0_u8..4, after_us in 100_u64..7_000, back in 1_u32..40,
    ) {
        let mut sequence = held(5_000, 0);
        let shown = match error {
            0 => sequence.judge(5_000 - 10 * back, after_us),
            1 => sequence.judge(5_000, after_us),
            2 => sequence.judge(5_010, 12_700 + after_us),
            _ => {
                sequence.judge(5_020, 20_000);
                sequence.judge(5_010, 20_000 + after_us)
            }
        };
        prop_assert!(!shown.is_in_sequence());
    }
}
