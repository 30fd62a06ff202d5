use super::reported as reported_as;
use super::*;

#[test]
fn every_bit_of_the_status_is_judged() {
    // Bit 10 of the status may have either value: it is the lowest bit of the solution's age.
    for bit in [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 12, 13, 14, 15] {
        let said = Scene::new(3).said(|cycle, _, gps| {
            if cycle == STEADY {
                gps[1].status = GpsStatus::from_bits(gps[1].status.bits() ^ 1 << bit);
            }
        });
        assert_eq!(said, STATUS, "bit {bit}");
    }
    let said = Scene::new(1).gps1(STEADY, |gps| gps.status = gps.status.with_excluded(true));
    assert_eq!(said, [(Violation::ExclusionWrong, 2)], "it begins, and ends");
}

#[test]
fn a_solutions_age_is_that_of_the_newest_message_taken() {
    let mut scene = Scene::new(1);
    scene.cycles = 400;
    scene.receivers[0].truncate(6);
    let last = scene.receivers[0][5].clone();
    let told = |age: u64, told: Option<u32>| {
        let said = scene.gps1(cycle_after(&last, age * MS), |gps| gps.status = gps.status.with_solution_age_ms(told));
        assert!(said.is_empty() || said == STATUS, "{said:?}");
        said.is_empty()
    };
    let right: Vec<u32> = (0..62).map(|step| 25 * step).filter(|age| told(400, Some(*age))).collect();
    assert_eq!(right, [375, 400]);
    let right: Vec<u32> = (0..=62).map(|step| 25 * step).filter(|age| told(2_000, Some(*age))).collect();
    assert_eq!(right, [1_550], "the oldest that there is");
    assert!(!told(400, None) && !told(2_000, None), "there was one");
    scene.receivers[0].clear();
    let never = |told| scene.gps1(STEADY, |gps| gps.status = gps.status.with_solution_age_ms(told));
    assert_eq!((never(None), never(Some(0))), (vec![], STATUS.into()), "there was none");
    assert_eq!(never(Some(2_000)), STATUS);
}

#[test]
fn a_receiver_that_was_never_heard_is_stale_and_nothing_else() {
    let mut scene = Scene::new(1);
    scene.receivers[0].clear();
    assert_eq!(scene.said(unchanged), []);
    assert_eq!(scene.gps1(STEADY, |gps| gps.status = gps.status.with_stale(false)), STATUS);
    assert_eq!(scene.gps1(STEADY, |gps| gps.status = gps.status.with_heard(true)), STATUS);
    assert_eq!(scene.gps1(STEADY, |gps| gps.status = gps.status.with_fix_type(FixType::TimeOnly)), STATUS);
    assert_eq!(scene.gps1(STEADY, |gps| gps.latitude = 47.0), CONTENT);
    assert_eq!(scene.gps1(STEADY, |gps| gps.latitude = -f64::NAN), CONTENT, "another NaN than the design's");
}

fn silent_after(last: usize, period_ms: u32) -> Scene {
    let mut scene = Scene::with_period(1, period_ms);
    scene.receivers[0].truncate(last + 1);
    scene
}

#[test]
fn a_receiver_that_falls_silent_takes_its_validity_along() {
    for (last, period) in [(5, 100), (0, 100), (20, 40), (2, 200)] {
        assert_eq!(silent_after(last, period).said(unchanged), [], "{period} ms");
    }
}

fn at_age(age: u64, change: impl Fn(&mut GpsValues, &Burst)) -> Vec<(Violation, u64)> {
    let scene = silent_after(5, 100);
    let last = &scene.receivers[0][5];
    scene.gps1(cycle_after(last, age * MS), |gps| change(gps, last))
}

#[test]
fn validity_ends_one_period_and_150_ms_after_the_last_message() {
    let still = |gps: &mut GpsValues, last: &Burst| {
        let GpsStatus { .. } = gps.status;
        let (stale, heard) = (gps.status.stale(), gps.status.heard());
        let values = last.values(gps.timestamp);
        *gps = GpsValues { status: values.status.with_stale(stale).with_heard(heard), ..values };
    };
    let gone = |gps: &mut GpsValues, _: &Burst| {
        let (stale, heard) = (gps.status.stale(), gps.status.heard());
        let values = GpsValues::absent(gps.timestamp);
        *gps = GpsValues { status: aged(values.status.with_stale(stale).with_heard(heard), gps), ..values };
    };
    assert_eq!(at_age(230, still), []);
    assert_eq!(at_age(250, still), [], "a clock may be slow, and a message be taken late");
    assert_eq!(at_age(271, still), STATUS);
    assert_eq!(at_age(252, gone), []);
    assert_eq!(at_age(230, gone), STATUS);
    assert_eq!(at_age(150, gone), STATUS);
}

#[test]
fn a_solution_is_stale_50_ms_after_the_next_was_due() {
    let stale = |gps: &mut GpsValues, _: &Burst| gps.status = gps.status.with_stale(true);
    let fresh = |gps: &mut GpsValues, _: &Burst| gps.status = gps.status.with_stale(false);
    assert_eq!(at_age(120, stale), STATUS);
    assert_eq!(at_age(150, stale), []);
    assert_eq!(at_age(150, fresh), []);
    assert_eq!(at_age(171, fresh), STATUS);
}

#[test]
fn a_receiver_is_heard_for_250_ms() {
    let heard = |gps: &mut GpsValues, _: &Burst| gps.status = gps.status.with_heard(true);
    let silent = |gps: &mut GpsValues, _: &Burst| gps.status = gps.status.with_heard(false);
    assert_eq!(at_age(230, silent), STATUS);
    assert_eq!(at_age(245, silent), []);
    assert_eq!(at_age(260, heard), []);
    assert_eq!(at_age(275, heard), STATUS);
}

#[test]
fn until_its_second_message_a_receiver_counts_as_one_of_a_second() {
    let scene = silent_after(0, 100);
    let last = &scene.receivers[0][0];
    let gone = |gps: &mut GpsValues| {
        *gps = GpsValues { status: gps.status.with_position_valid(false), ..*gps };
        (gps.latitude, gps.longitude, gps.altitude) = (ABSENT_F64, ABSENT_F64, ABSENT_F64);
        gps.status = GpsStatus::from_bits(gps.status.bits() & !0xF);
    };
    assert_eq!(scene.gps1(cycle_after(last, 500 * MS), gone), STATUS);
    assert_eq!(scene.gps1(cycle_after(last, 1_100 * MS), gone), STATUS);
    assert_eq!(scene.gps1(cycle_after(last, 1_140 * MS), gone), []);
}

#[test]
fn a_receiver_that_repeats_its_time_of_week_renews_nothing() {
    let mut scene = Scene::new(1);
    let frozen = scene.receivers[0][5].clone();
    let at = frozen.pvt.unwrap().itow_ms;
    for burst in &mut scene.receivers[0][6..] {
        burst.pvt.as_mut().unwrap().itow_ms = at;
        burst.att.as_mut().unwrap().itow_ms = at;
        burst.ins.as_mut().unwrap().itow_ms = at;
    }
    let bursts = scene.receivers[0].clone();
    let run = |valid_for: u64| {
        scene.said(|cycle, reported, gps| {
            let Some(age) = tick(cycle).checked_sub(frozen.arrived() + MS) else { return };
            let gps = &mut gps[0];
            let last = bursts.iter().rfind(|burst| burst.arrived() + MS <= tick(cycle)).unwrap();
            let values = if age <= valid_for { last.values(gps.timestamp) } else { GpsValues::absent(gps.timestamp) };
            let status = values.status.with_heard(true).with_stale(age >= 150 * MS);
            *gps = GpsValues { status: status.with_solution_age_ms(Some((age / MS) as u32)), ..values };
            *reported = reported_as(gps);
        })
    };
    assert_eq!(run(250 * MS), []);
    assert_eq!(run(350 * MS)[0].0, Violation::StatusWrong);
}

fn after_steps(first: u32, steps: &[u32], age: u64) -> [bool; 2] {
    let steps: Vec<u32> = std::iter::repeat_n(first, 12).chain(steps.iter().copied()).collect();
    let (mut scene, mut at, mut itow) = (Scene::new(1), FIRST_BURST, 400_000_000);
    scene.receivers[0] = (0..)
        .zip(std::iter::once(&0).chain(&steps))
        .map(|(number, step)| {
            at += u64::from(*step) * MS;
            itow += step;
            let mut burst = Burst::new(at, number, 0);
            (burst.att, burst.ins) = (None, None);
            burst.pvt.as_mut().unwrap().itow_ms = itow;
            burst
        })
        .collect();
    let last = scene.receivers[0].last().unwrap().clone();
    let number = cycle_after(&last, age * MS);
    scene.cycles = number;
    [true, false].map(|valid| {
        let mut events = scene.events(|_, reported, gps| {
            let values = if valid { last.values(gps[0].timestamp) } else { GpsValues::absent(gps[0].timestamp) };
            let status = values.status.with_heard(age <= 250).with_stale(age > 100);
            gps[0] = GpsValues { status: aged(status, &gps[0]), ..values };
            *reported = reported_as(&gps[0]);
        });
        events.without(|event| event.at < tick(number) && matches!(event.what, What::Sent { .. }));
        kinds(&events).is_empty()
    })
}

#[test]
fn a_period_is_between_the_shortest_and_the_longest_of_four_steps() {
    const YES: [bool; 2] = [true, false];
    const NO: [bool; 2] = [false, true];
    const EITHER: [bool; 2] = [true, true];
    assert_eq!(after_steps(100, &[], 230), YES);
    assert_eq!(after_steps(100, &[], 280), NO);
    assert_eq!(after_steps(200, &[100; 3], 280), EITHER);
    assert_eq!(after_steps(200, &[100; 4], 280), NO);
    assert_eq!(after_steps(100, &[200; 3], 280), EITHER, "a new period, or three messages that are lost");
    assert_eq!(after_steps(100, &[200; 4], 320), YES);
    for (age, valid) in [(320, YES), (380, EITHER), (480, NO)] {
        assert_eq!(after_steps(100, &[300, 200, 300, 250], age), valid, "{age} ms");
    }
    assert_eq!(after_steps(100, &[1_500; 4], 1_100), YES, "a second at most");
    assert_eq!(after_steps(100, &[1_500; 4], 1_200), NO);
    assert_eq!(after_steps(100, &[10], 230), YES, "too short to be believed");
    assert_eq!(after_steps(100, &[20; 4], 200), NO);
    assert_eq!(after_steps(100, &[0], 160), YES);
}

#[test]
fn the_time_of_week_may_roll_over_or_step_back() {
    let silent = |shift: u32, back: bool| {
        let mut scene = silent_after(9, 100);
        for (number, burst) in scene.receivers[0].iter_mut().enumerate() {
            let restarted = if back && number > 5 { 300_000 } else { 0 };
            for itow in [
                &mut burst.pvt.as_mut().unwrap().itow_ms,
                &mut burst.att.as_mut().unwrap().itow_ms,
                &mut burst.ins.as_mut().unwrap().itow_ms,
            ] {
                *itow = (*itow + shift - restarted) % gnss_sim::ubx::WEEK_MS;
            }
        }
        scene.said(unchanged)
    };
    assert_eq!(silent(gnss_sim::ubx::WEEK_MS - 400_000_500, false), []);
    assert_eq!(silent(0, true), []);
}
