use super::reported as reported_as;
use super::*;

#[test]
fn a_flawless_run_has_its_figures_and_no_violation() {
    for gps in [1, 2, 3, 5] {
        let scene = Scene::new(gps);
        let (broken, figures) = found(Content::new(&header(gps)), &scene.events(unchanged).log());
        assert_eq!(broken, []);
        // The position has arrived before the burst ends, because NAV-PVT is the first message in it.
        let last = scene.receivers[0].iter().rfind(|burst| burst.arrived() <= tick(120) + 9 * MS).unwrap();
        let arrived = last.at + NavPvt::WIRE as u64 * BYTE_NS;
        assert_eq!(figures.last_solution_ns, vec![Some(arrived); gps]);
    }
}

#[test]
fn every_value_is_judged_to_its_last_bit() {
    let scene = Scene::new(5);
    let next64 = |value: &mut f64| *value = value.next_up();
    let next32 = |value: &mut f32| *value = value.next_up();
    let changes: [&dyn Fn(&mut GpsValues); 9] = [
        &|gps| next64(&mut gps.latitude),
        &|gps| next64(&mut gps.longitude),
        &|gps| next64(&mut gps.altitude),
        &|gps| next32(&mut gps.pitch),
        &|gps| next32(&mut gps.yaw),
        &|gps| next32(&mut gps.roll),
        &|gps| next32(&mut gps.acceleration[0]),
        &|gps| next32(&mut gps.acceleration[1]),
        &|gps| next32(&mut gps.acceleration[2]),
    ];
    for change in changes {
        for receiver in 0..5 {
            let said = scene.said(|cycle, _, gps| {
                if cycle == STEADY {
                    change(&mut gps[receiver]);
                }
            });
            assert_eq!(said, CONTENT);
        }
    }
}

#[test]
fn the_receivers_are_not_mixed() {
    let said = Scene::new(3).said(|cycle, _, gps| {
        if cycle == STEADY {
            gps.swap(1, 2);
        }
    });
    assert_eq!(said, [(Violation::ContentWrong, 2)]);
}

#[test]
fn an_object_that_is_wrong_in_several_values_is_told_once() {
    let said = Scene::new(1).gps1(STEADY, |gps| {
        gps.latitude = 1.0;
        gps.pitch = 1.0;
    });
    assert_eq!(said, CONTENT);
}

#[test]
fn values_without_their_valid_bit_are_content_where_no_message_says_so() {
    let wrong = |gps: &mut GpsValues| {
        gps.latitude = 1.0;
        gps.status = gps.status.with_position_valid(false);
    };
    assert_eq!(Scene::new(1).gps1(STEADY, wrong), CONTENT);
    let wrong = |gps: &mut GpsValues| {
        gps.latitude = 1.0;
        gps.status = gps.status.with_fix_type(FixType::Fix2D);
    };
    assert_eq!(Scene::new(1).gps1(STEADY, wrong), CONTENT);
}

#[test]
fn a_message_may_be_shown_until_its_successor_must_be_taken() {
    let scene = Scene::new(1);
    let newest = &scene.receivers[0][6];
    let old = &scene.receivers[0][5];
    let first = cycle_after(newest, 0);
    let still_old =
        |cycle: u64| scene.gps1(cycle, |gps| *gps = GpsValues { status: gps.status, ..old.values(gps.timestamp) });
    assert_eq!(still_old(first), []);
    assert_eq!(still_old(cycle_after(newest, bounds::MESSAGE_TAKEN)), CONTENT);
    let already =
        |cycle: u64| scene.gps1(cycle, |gps| *gps = GpsValues { status: gps.status, ..newest.values(gps.timestamp) });
    assert_eq!(already(first), []);
    assert_eq!(already(first - 1), CONTENT);
}

#[test]
fn the_bands_of_taking_a_message_are_as_stated() {
    let shows = |arrives_after_tick: i64, new: bool| {
        let mut scene = Scene::new(1);
        for burst in &mut scene.receivers[0] {
            (burst.att, burst.ins) = (None, None);
        }
        let at = tick(60).checked_add_signed(arrives_after_tick).unwrap() - NavPvt::WIRE as u64 * BYTE_NS;
        let moved = scene.receivers[0].iter_mut().rfind(|burst| burst.at <= tick(60)).unwrap();
        moved.at = at;
        let (new_one, index) = (moved.clone(), scene.receivers[0].iter().position(|burst| burst.at == at).unwrap());
        let old = scene.receivers[0][index - 1].clone();
        scene.said(|cycle, reported, gps| {
            let burst = if new { &new_one } else { &old };
            if cycle == 60 {
                let values = burst.values(gps[0].timestamp);
                gps[0] = GpsValues { status: aged(values.status.with_heard(true), &gps[0]), ..values };
                *reported = reported_as(&gps[0]);
            }
        })
    };
    assert_eq!(shows(bounds::SAMPLED_AFTER_TICK as i64, true), []);
    assert_eq!(shows(bounds::SAMPLED_AFTER_TICK as i64 + 1, true), CONTENT);
    assert_eq!(shows(-(bounds::MESSAGE_TAKEN as i64) + 1, false), []);
    assert_eq!(shows(-(bounds::MESSAGE_TAKEN as i64), false), CONTENT);
}

#[test]
fn of_a_kind_two_messages_that_arrive_together_either_may_be_shown() {
    let mut scene = Scene::new(1);
    scene.receivers[0].iter_mut().for_each(|burst| (burst.att, burst.ins) = (None, None));
    let number = scene.receivers[0].iter().rposition(|burst| burst.at <= tick(60)).unwrap();
    let at = tick(60) - 2 * MS;
    for (burst, after) in scene.receivers[0][number..].iter_mut().zip([0, 1_000]).take(2) {
        burst.at = at - (1 - after / 1_000) * NavPvt::WIRE as u64 * BYTE_NS;
    }
    for index in 0..2 {
        let burst = scene.receivers[0][number + index].clone();
        let said = scene.gps1(60, |gps| {
            let values = burst.values(gps.timestamp);
            (gps.latitude, gps.longitude, gps.altitude) = (values.latitude, values.longitude, values.altitude);
        });
        assert_eq!(said, []);
    }
}

fn position(change: impl Fn(&mut NavPvt), shown: Option<bool>, fix: u16) -> Vec<(Violation, u64)> {
    let mut scene = Scene::new(1);
    for burst in &mut scene.receivers[0] {
        burst.pvt.iter_mut().for_each(&change);
    }
    let bursts = scene.receivers[0].clone();
    let said = scene.said(|_, reported, gps| {
        let gps = &mut gps[0];
        if gps.status.position_valid() {
            let valid = shown.is_some();
            gps.status = GpsStatus::from_bits(gps.status.bits() & !0x1F | fix | u16::from(valid) << 4);
            if !valid {
                (gps.latitude, gps.longitude) = (ABSENT_F64, ABSENT_F64);
            }
            if shown != Some(true) {
                gps.altitude = ABSENT_F64;
            }
        }
        *reported = reported_as(gps);
    });
    let (_, figures) = found(Content::new(&header(1)), &scene.events(unchanged).log());
    let any = bursts.iter().any(|burst| burst.pvt.is_some());
    assert_eq!(figures.last_solution_ns[0].is_some(), shown.is_some() && any);
    said
}

#[test]
fn a_position_is_shown_only_with_a_valid_fix() {
    let fix = |code: u8| move |pvt: &mut NavPvt| pvt.fix_type = code;
    assert_eq!(position(fix(2), Some(false), 2), []);
    assert_eq!(position(fix(3), Some(true), 3), []);
    assert_eq!(position(fix(4), Some(true), 4), []);
    for code in [0, 1, 5] {
        assert_eq!(position(fix(code), None, u16::from(code)), []);
    }
    assert_eq!(position(fix(6), None, 0), [], "a code that is reserved is no fix");
    assert_eq!(position(fix(255), None, 0), []);
    assert_eq!(position(|pvt| pvt.flags = !NavPvt::FLAG_FIX_OK, None, 3), []);
    assert_eq!(position(|pvt| pvt.flags3 = NavPvt::FLAG3_INVALID_LLH, None, 3), []);
    assert_eq!(position(|pvt| pvt.flags3 = !NavPvt::FLAG3_INVALID_LLH, Some(true), 3), []);
    assert_eq!(position(|pvt| pvt.flags = !0, Some(true), 3), []);
}

#[test]
fn a_position_that_is_not_on_earth_is_not_valid() {
    let latitude = |value: i32| move |pvt: &mut NavPvt| pvt.latitude_1e7 = value;
    let longitude = |value: i32| move |pvt: &mut NavPvt| pvt.longitude_1e7 = value;
    for sign in [1, -1] {
        assert_eq!(position(latitude(sign * 900_000_001), None, 3), []);
        assert_eq!(position(longitude(sign * 1_800_000_001), None, 3), []);
        let valid = |change: &dyn Fn(&mut NavPvt)| {
            let mut scene = Scene::new(1);
            scene.receivers[0].iter_mut().for_each(|burst| burst.pvt.iter_mut().for_each(change));
            scene.said(unchanged)
        };
        assert_eq!(valid(&latitude(sign * 900_000_000)), []);
        assert_eq!(valid(&longitude(sign * 1_800_000_000)), []);
    }
}

#[test]
fn a_position_is_valid_only_in_the_ranges_of_decision_15() {
    type Change = fn(&mut NavPvt, i32);
    let north: Change = |pvt, value| pvt.velocity_mm_s = [value, 0, 0];
    let diagonal: Change = |pvt, value| pvt.velocity_mm_s = [120_000, -value, 0];
    let height: Change = |pvt, value| pvt.height_mm = value;
    let horizontal: Change = |pvt, value| pvt.horizontal_accuracy_mm = value.cast_unsigned();
    let vertical: Change = |pvt, value| pvt.vertical_accuracy_mm = value.cast_unsigned();
    for (change, right, wrong) in [
        (height, -1_000_000, -1_000_001),
        (height, 20_000_000, 20_000_001),
        (north, -200_000, -200_001),
        (diagonal, 160_000, 160_001),
        (horizontal, 30_000, 30_001),
        (horizontal, 1, 0),
        (horizontal, 30_000, -1),
        (vertical, 50_000, 50_001),
        (vertical, 1, 0),
    ] {
        assert_eq!(position(|pvt| change(pvt, wrong), None, 3), [], "{wrong}");
        let mut scene = Scene::new(1);
        scene.receivers[0].iter_mut().for_each(|burst| burst.pvt.iter_mut().for_each(|pvt| change(pvt, wrong)));
        assert_eq!(scene.said(unchanged)[0].0, Violation::StatusWrong, "{wrong}");
        scene.receivers[0].iter_mut().for_each(|burst| burst.pvt.iter_mut().for_each(|pvt| change(pvt, right)));
        let kinds: Vec<_> = scene.said(unchanged).into_iter().map(|(violation, _)| violation).collect();
        assert!(!kinds.contains(&Violation::StatusWrong) && !kinds.contains(&Violation::ContentWrong), "{right}");
    }
}

#[test]
fn an_absent_angle_or_axis_leaves_the_others_shown() {
    for number in 0..3 {
        let mut scene = Scene::new(1);
        for burst in &mut scene.receivers[0] {
            burst.att.as_mut().unwrap().accuracy_1e5[number] = 0;
        }
        let said = |show: bool, valid: bool| {
            scene.said(|_, _, gps| {
                let gps = &mut gps[0];
                if gps.status.attitude_valid() {
                    gps.status = gps.status.with_attitude_valid(valid);
                    if !show {
                        *[&mut gps.roll, &mut gps.pitch, &mut gps.yaw][number] = ABSENT_F32;
                    }
                }
            })
        };
        assert_eq!(said(false, false), []);
        assert_eq!(said(true, false)[0].0, Violation::ContentWrong);
        assert_eq!(said(false, true)[0].0, Violation::StatusWrong);
    }
    for number in 0..3 {
        let scene = Scene::new(1);
        let mut events = scene.events(|_, _, gps| {
            if gps[0].status.acceleration_valid() {
                gps[0].status = gps[0].status.with_acceleration_valid(false);
                gps[0].acceleration[number] = ABSENT_F32;
            }
        });
        for event in &mut events.events {
            if let What::Fed { bytes, .. } = &mut event.what {
                let ins = bytes.0.len() - EsfIns::WIRE;
                let payload = &mut bytes.0[ins + 6..ins + 6 + EsfIns::PAYLOAD];
                payload[1] &= !(1 << (3 + number));
                let sealed = gnss_sim::ubx::frame(CLASS_ESF, EsfIns::ID, payload);
                bytes.0.splice(ins.., sealed);
            }
        }
        assert_eq!(kinds(&events), []);
    }
}

use gnss_sim::ubx::CLASS_ESF;

#[test]
fn attitude_and_acceleration_of_a_receiver_that_sends_neither_are_absent() {
    let mut scene = Scene::new(1);
    for burst in &mut scene.receivers[0] {
        (burst.att, burst.ins) = (None, None);
    }
    assert_eq!(scene.said(unchanged), []);
    assert_eq!(scene.gps1(STEADY, |gps| gps.pitch = 0.0), CONTENT);
    assert_eq!(scene.gps1(STEADY, |gps| gps.acceleration[2] = 0.0), CONTENT);
}

#[test]
fn the_last_valid_position_is_one_that_had_crossed_its_line_undisturbed() {
    let mut scene = Scene::new(1);
    let number = scene.receivers[0].len() - 1;
    let wire = NavPvt::WIRE as u64 * BYTE_NS;
    let solution = |scene: &Scene| found(Content::new(&header(1)), &scene.events(unchanged).log()).1.last_solution_ns;
    let end = tick(scene.cycles + 1) - MS;
    scene.receivers[0][number].at = end - wire;
    assert_eq!(solution(&scene), [Some(end)]);
    scene.receivers[0][number].at = end - wire + 1;
    let before = scene.receivers[0][number - 1].at + wire;
    assert_eq!(solution(&scene), [Some(before)]);
    scene.receivers[0][number].at = end - wire;
    scene.receivers[0][number].clean = false;
    assert_eq!(solution(&scene), [Some(before)]);
    scene.receivers[0].clear();
    assert_eq!(solution(&scene), [None]);
}
