use gnss_sim::ubx::WEEK_MS;
use profile::{ReportedStatus, ResetReason};

use super::*;
use crate::testing::injected;
use crate::{Board, Cause, Disturbance, Figures};

const VOTE: [(Violation, u64); 1] = [(Violation::VoteWrong, 1)];
const MISSING: [(Violation, u64); 1] = [(Violation::VoteMissing, 1)];
const EXCLUSION: [(Violation, u64); 1] = [(Violation::ExclusionWrong, 1)];

/// The number of 10⁻⁷ degrees of latitude in a metre, at 47.5 degrees.
const PER_METRE: f64 = 89.94;

/// Returns a scene of receivers that stand still, each at its distance, m, north of a common point and above it.
fn standing(places: &[(f64, f64)]) -> Scene {
    let mut scene = Scene::of_cycles(places.len(), 100, 120);
    for (receiver, (north, up)) in places.iter().enumerate() {
        for pvt in scene.receivers[receiver].iter_mut().filter_map(|burst| burst.pvt.as_mut()) {
            pvt.latitude_1e7 = 474_979_123 + (north * PER_METRE) as i32;
            pvt.longitude_1e7 = 87_296_456;
            pvt.height_mm = 493_217 + (up * 1e3) as i32;
        }
    }
    scene
}

/// Returns a scene of receivers that stand close together, except that GPS2 is 100 m away in these bursts.
fn strayed(gps: usize, bursts: std::ops::Range<usize>) -> Scene {
    let mut scene = Scene::of_cycles(gps, 100, 260);
    for burst in &mut scene.receivers[1][bursts] {
        burst.pvt.as_mut().unwrap().latitude_1e7 += (100.0 * PER_METRE) as i32;
    }
    scene
}

fn shows(scene: &Scene, number: usize) -> u64 {
    let burst = &scene.receivers[1][number];
    cycle_after(&Burst { att: None, ins: None, ..burst.clone() }, 0).max(cycle_after(burst, MS))
}

fn excluded(scene: &Scene, cycles: std::ops::Range<u64>) -> Vec<(Violation, u64)> {
    scene.said(|cycle, _, gps| gps[1].status = gps[1].status.with_excluded(cycles.contains(&cycle)))
}

fn without(scene: &Scene, receivers: &[usize]) -> Vec<Violation> {
    let mut before = false;
    let said = scene.said(|_, reported, gps| {
        let valid = gps.iter().all(|gps| gps.status.position_valid());
        if !before {
            *reported = ReportedValues::absent(reported.timestamp);
            reported.status = reported.status.with_degraded(true);
        }
        for receiver in receivers {
            gps[*receiver].status = gps[*receiver].status.with_excluded(before);
        }
        before = valid;
    });
    said.into_iter().map(|(violation, _)| violation).collect()
}

fn of_members(scene: &Scene, members: &[usize]) -> Vec<Violation> {
    let mut before = false;
    let said = scene.said(|_, reported, gps| {
        let state = reported.status.state();
        let voters: Vec<_> = members.iter().map(|member| gps[*member]).collect();
        *reported = if before { voted(&voters) } else { ReportedValues::absent(reported.timestamp) };
        reported.status =
            reported.status.with_degraded(!before || members.len() < gps.len()).with_state(state.unwrap());
        before = gps.iter().all(|gps| gps.status.position_valid());
    });
    said.into_iter().map(|(violation, _)| violation).collect()
}

fn none(scene: &Scene) -> Vec<Violation> {
    let said = scene.said(|_, reported, gps| {
        *reported = ReportedValues { status: reported.status, ..ReportedValues::absent(gps[0].timestamp) };
        reported.status = ReportedValues::absent(0).status.with_degraded(true);
    });
    said.into_iter().map(|(violation, _)| violation).collect()
}

fn changed(gps: usize, change: impl Fn(&mut ReportedValues)) -> Vec<(Violation, u64)> {
    Scene::new(gps).said(|cycle, reported, _| {
        if cycle == STEADY {
            change(reported);
        }
    })
}

#[test]
fn an_excluded_receiver_returns_after_a_second_of_agreement() {
    for gps in [3, 5] {
        let scene = strayed(gps, 5..9);
        let (from, agrees) = (shows(&scene, 5), shows(&scene, 9));
        let ends = |after: u64| excluded(&scene, from..agrees + after);
        assert_eq!(ends(100), []);
        assert_eq!(ends(95), [], "its clock may be fast");
        assert_eq!(ends(93), EXCLUSION);
        assert_eq!(ends(110), [], "or slow");
        assert_eq!(ends(111), []);
        assert_eq!(ends(112), EXCLUSION);
        assert_eq!(ends(115)[0], (Violation::ExclusionWrong, 4));
    }
}

#[test]
fn who_was_excluded_is_in_the_figures() {
    let scene = strayed(3, 5..9);
    let (from, until) = (shows(&scene, 5), shows(&scene, 9) + 100);
    let events =
        scene.events(|cycle, _, gps| gps[1].status = gps[1].status.with_excluded((from..until).contains(&cycle)));
    let figures: Figures = found(Content::new(&header(3)), &events.log()).1;
    let [exclusion] = figures.voter.exclusions[..] else { panic!("{:?}", figures.voter) };
    assert_eq!((exclusion.receiver, exclusion.from_ns, exclusion.until_ns), (2, tick(from), Some(tick(until))));
    assert!((exclusion.away_m.unwrap() - 102.2).abs() < 0.2, "{exclusion:?}");
    assert!((exclusion.height_m.unwrap() - 0.2).abs() < 0.01, "{exclusion:?}");
    let before = figures.voter.none;
    let agree: Vec<u64> = figures.voter.agree.into_values().collect();
    assert_eq!(agree, [before, 0, until - from, 260 - before - (until - from)]);
    assert_eq!(figures.voter.degraded, before + until - from);
}

#[test]
fn a_receiver_that_strays_has_no_vote() {
    let scene = strayed(3, 5..9);
    let (from, until) = (shows(&scene, 5), shows(&scene, 9));
    // The voter may exclude the receiver as late as one cycle after its object shows the stray position.
    assert_eq!(excluded(&scene, 0..0), [(Violation::VoteWrong, until - from - 1)]);
    assert_eq!(excluded(&scene, from + 1..until + 100), []);
    assert_eq!(excluded(&scene, from + 2..until + 100), VOTE);
}

#[test]
fn a_receiver_is_not_excluded_without_a_cause() {
    let scene = Scene::new(3);
    assert_eq!(excluded(&scene, 0..0), []);
    // In this run HORUS excludes a receiver without a cause, and readmits it before a second has passed.
    assert_eq!(excluded(&scene, STEADY..STEADY + 10), [(Violation::ExclusionWrong, 2)]);
    assert_eq!(excluded(&scene, STEADY..121), EXCLUSION);
    let mut scene = Scene::new(3);
    scene.receivers[1].clear();
    assert_eq!(excluded(&scene, STEADY..121), EXCLUSION, "one that says nothing is no candidate");
}

#[test]
fn an_excluded_receiver_that_falls_silent_stays_excluded() {
    let mut scene = strayed(3, 5..9);
    scene.receivers[1].truncate(9);
    let from = shows(&scene, 5);
    assert_eq!(excluded(&scene, from..261), []);
    assert_eq!(excluded(&scene, from..230), EXCLUSION);
}

#[test]
fn two_receivers_that_disagree_give_no_result_and_no_new_exclusion() {
    let scene = standing(&[(0.0, 0.0), (100.0, 0.0)]);
    assert_eq!(none(&scene), []);
    assert_eq!(without(&scene, &[1]), [Violation::VoteWrong], "it is one against one");
    assert_eq!(without(&scene, &[]), [Violation::VoteWrong], "they do not agree");
    let said = scene.said(|cycle, reported, gps| {
        *reported = ReportedValues::absent(gps[0].timestamp);
        reported.status = reported.status.with_degraded(true);
        gps[1].status = gps[1].status.with_excluded(cycle >= STEADY);
    });
    assert!(said.contains(&(Violation::ExclusionWrong, 1)), "{said:?}");
}

#[test]
fn a_result_needs_a_quorum_and_more_receivers_than_oppose_it() {
    let far = |count: usize| (0..count).map(|number| (100.0 * number as f64, 0.0)).collect::<Vec<_>>();
    let with_far = |agree: usize, gps: usize| {
        let mut places = vec![(0.0, 0.0); agree];
        places.extend(&far(gps - agree + 1)[1..]);
        standing(&places)
    };
    for (gps, least) in [(1, 1), (2, 2), (3, 2), (5, 3)] {
        for agree in 1..=gps {
            let scene = with_far(agree, gps);
            let others: Vec<usize> = (agree..gps).collect();
            let (result, nothing) = (without(&scene, &others), none(&scene));
            if agree >= least {
                assert_eq!((result, nothing), (vec![], vec![Violation::VoteMissing]), "{agree} of {gps}");
            } else {
                assert_eq!((result, nothing), (vec![Violation::VoteWrong], vec![]), "{agree} of {gps}");
            }
        }
    }
    // Two of five receivers are no quorum, even if the other three are silent. One of two receivers is.
    for (speak, gps, least) in [(1, 2, 1), (1, 3, 2), (2, 3, 2), (2, 5, 3), (3, 5, 3)] {
        let mut scene = standing(&vec![(0.0, 0.0); gps]);
        scene.receivers[speak..].iter_mut().for_each(Vec::clear);
        let (result, nothing) = (kinds(&scene.events(unchanged)), none(&scene));
        if speak >= least {
            assert_eq!((result, nothing), (vec![], vec![Violation::VoteMissing]), "{speak} of {gps}");
        } else {
            assert_eq!((result[0].0, nothing), (Violation::VoteWrong, vec![]), "{speak} of {gps}");
        }
    }
}

#[test]
fn the_result_must_come_from_a_largest_set_of_agreeing_receivers() {
    // With accuracies of 4 m each, two receivers agree up to a distance of 17 m.
    let scene = standing(&[(0.0, 0.0), (9.0, 0.0), (9.0, 0.0), (22.0, 0.0), (22.0, 0.0)]);
    assert_eq!(of_members(&scene, &[1, 2, 3, 4]), []);
    assert_eq!(of_members(&scene, &[0, 1, 2]), [Violation::VoteWrong]);
    assert_eq!(without(&scene, &[0]), [Violation::ExclusionWrong]);
    // HORUS may vote from either of two sets of receivers that agree, because both have the same size.
    let scene = standing(&[(0.0, 0.0), (9.0, 0.0), (22.0, 0.0)]);
    assert_eq!(of_members(&scene, &[1, 2]), []);
    assert_eq!(of_members(&scene, &[0, 1]), []);
    assert_eq!(
        of_members(&scene, &[0, 2]),
        [Violation::ReportedWrong],
        "they do not agree, and the others are elsewhere"
    );
    assert_eq!(of_members(&scene, &[0, 1, 2]), [Violation::VoteWrong]);
    let scene = standing(&[(0.0, 0.0), (0.0, 0.0), (100.0, 0.0)]);
    assert_eq!(of_members(&scene, &[0, 1]), [Violation::ExclusionWrong]);
}

fn together(accuracy: [u32; 2], north: f64, up: f64) -> (Vec<Violation>, Vec<Violation>) {
    let mut scene = standing(&[(0.0, 0.0), (0.0, 0.0), (north, up)]);
    for pvt in scene.receivers.iter_mut().flatten().filter_map(|burst| burst.pvt.as_mut()) {
        [pvt.horizontal_accuracy_mm, pvt.vertical_accuracy_mm] = accuracy;
    }
    (without(&scene, &[]), without(&scene, &[2]))
}

#[test]
fn two_receivers_agree_within_three_times_their_combined_accuracy() {
    let agree = (vec![], vec![Violation::ExclusionWrong]);
    let disagree = (vec![Violation::VoteWrong], vec![]);
    for (accuracy, along, high) in [
        ([100, 100], 5.0, 8.0),
        ([3_000, 3_000], 12.73, 12.73),
        ([6_000, 10_000], 25.46, 42.43),
        ([30_000, 50_000], 30.0, 50.0),
    ] {
        assert_eq!(together(accuracy, along * 0.98 - 0.06, 0.0), agree, "{accuracy:?}");
        assert_eq!(together(accuracy, along * 1.02 + 0.25, 0.0), disagree, "{accuracy:?}");
        assert_eq!(together(accuracy, 0.0, high * 0.98 - 0.06), agree, "{accuracy:?}");
        assert_eq!(together(accuracy, 0.0, -high * 1.02 - 0.25), disagree, "{accuracy:?}");
    }
    // Exactly at the limit two receivers may agree or disagree.
    assert_eq!(together([3_000, 3_000], 12.75, 0.0), (vec![], vec![]));
}

#[test]
fn a_2d_fix_has_a_vote_whatever_its_height() {
    let mut scene = standing(&[(0.0, 0.0), (0.0, 4_000.0), (1.0, 0.0)]);
    scene.receivers[1].iter_mut().for_each(|burst| burst.pvt.as_mut().unwrap().fix_type = 2);
    let said = scene.said(|_, _, gps| {
        if gps[1].status.position_valid() {
            gps[1].status = gps[1].status.with_fix_type(FixType::Fix2D);
            gps[1].altitude = ABSENT_F64;
        }
    });
    assert_eq!(said, []);
}

#[test]
fn receivers_that_are_half_the_earth_apart_do_not_agree() {
    let mut scene = standing(&[(0.0, 0.0), (0.0, 0.0), (0.0, 0.0)]);
    for pvt in scene.receivers[2].iter_mut().filter_map(|burst| burst.pvt.as_mut()) {
        (pvt.latitude_1e7, pvt.longitude_1e7) = (-pvt.latitude_1e7, pvt.longitude_1e7 - 1_800_000_000);
    }
    assert_eq!(without(&scene, &[2]), []);
    assert_eq!(without(&scene, &[]), [Violation::VoteWrong]);
}

#[test]
fn the_date_line_and_the_pole_do_not_part_receivers() {
    for (latitude, longitudes, middle) in
        [(0, [1_799_999_900, -1_799_999_900], 180.0), (899_999_900, [0, -1_800_000_000], f64::NAN)]
    {
        let mut scene = standing(&[(0.0, 0.0), (0.0, 0.0)]);
        for (bursts, longitude) in scene.receivers.iter_mut().zip(longitudes) {
            for pvt in bursts.iter_mut().filter_map(|burst| burst.pvt.as_mut()) {
                (pvt.latitude_1e7, pvt.longitude_1e7) = (latitude, longitude);
            }
        }
        let said = |middle: f64| {
            scene.said(|_, reported, gps| {
                if gps.iter().all(|gps| gps.status.position_valid()) {
                    (reported.latitude, reported.longitude) = if middle.is_nan() { (90.0, 7.0) } else { (0.0, middle) };
                }
            })
        };
        assert_eq!(said(middle), []);
        if !middle.is_nan() {
            assert_eq!(said(-middle), []);
            assert_eq!(said(0.0)[0].0, Violation::ReportedWrong);
        }
    }
}

#[test]
fn every_coordinate_is_the_median_to_some_centimetres() {
    for gps in [1, 2, 3, 5] {
        let moved = |north: f64, east: f64, up: f64| {
            changed(gps, |reported| {
                reported.latitude += north / 111_200.0;
                reported.longitude += east / 75_200.0;
                reported.altitude += up;
            })
        };
        assert_eq!(moved(0.02, -0.02, 0.04), []);
        for off in [0.2, -0.2] {
            assert_eq!(moved(off, 0.0, 0.0), REPORTED, "{gps}");
            assert_eq!(moved(0.0, off, 0.0), REPORTED);
            assert_eq!(moved(0.0, 0.0, off), REPORTED);
        }
        assert_eq!(changed(gps, |reported| reported.latitude = ABSENT_F64), REPORTED);
        assert_eq!(changed(gps, |reported| reported.longitude = ABSENT_F64), REPORTED);
        assert_eq!(changed(gps, |reported| reported.altitude = ABSENT_F64), REPORTED);
    }
}

#[test]
fn a_position_is_brought_to_the_tick() {
    let mut scene = Scene::of_cycles(3, 100, 120);
    for pvt in scene.receivers.iter_mut().flatten().filter_map(|burst| burst.pvt.as_mut()) {
        pvt.velocity_mm_s = [16_000, -12_000, 4_000];
    }
    let arrived: Vec<u64> = scene.receivers[0].iter().map(Burst::arrived).collect();
    let said = |off: f64| {
        scene.said(|cycle, reported, gps| {
            let Some(arrived) = arrived.iter().rfind(|arrived| **arrived + MS <= tick(cycle)) else { return };
            if gps.iter().all(|gps| gps.status.position_valid()) {
                let age = ((tick(cycle) - arrived) as f64 / 1e9 + off).max(0.0) + 0.05;
                reported.latitude += 16.0 * age / 111_185.0;
                reported.longitude -= 12.0 * age / 75_350.0;
                reported.altitude -= 4.0 * age;
            }
        })
    };
    assert_eq!(said(0.0), []);
    assert_eq!(said(-0.01), [], "HORUS may have taken it up to 12 ms after its arrival");
    assert_eq!(said(0.02)[0].0, Violation::ReportedWrong);
    assert_eq!(said(-0.05)[0].0, Violation::ReportedWrong);
}

#[test]
fn a_position_is_older_if_its_message_comes_late() {
    // GPS2 flies north between two receivers that stand still. A row has the delay (ms) of each receiver's messages,
    // and the age (s) of GPS2's position when its message arrives.
    for (late, before_arrival) in [
        ([0, 0, 0], 0.050),
        ([0, 40, 20], 0.070),
        ([20, 0, 40], 0.030),
        ([0, 40, 0], 0.090),
        ([0, 70, 0], 0.050),
        ([70, 0, 65], 0.050),
        ([0, 50, 0], 0.050),
        ([0, 50, 0], 0.100),
    ] {
        let mut scene = Scene::of_cycles(3, 100, 120);
        for (bursts, late) in scene.receivers.iter_mut().zip(late) {
            for (number, burst) in (0..).zip(bursts) {
                burst.at += late * MS;
                let pvt = burst.pvt.as_mut().unwrap();
                // The times of week pass from one GPS week to the next during the run.
                pvt.itow_ms = (WEEK_MS - 500 + 100 * number) % WEEK_MS;
            }
        }
        // GPS2 begins to fly when every receiver has sent messages.
        scene.receivers[1][3..].iter_mut().for_each(|burst| burst.pvt.as_mut().unwrap().velocity_mm_s = [6_000, 0, 0]);
        let arrived: Vec<u64> = scene.receivers[1].iter().map(Burst::arrived).collect();
        let said = |off: f64| {
            let mut before = [false; 3];
            scene.said(|cycle, reported, gps| {
                let voters: Vec<_> = gps.iter().zip(before).filter(|(_, voted)| *voted).map(|(gps, _)| *gps).collect();
                *reported = match voters.len() {
                    0 | 1 => ReportedValues::absent(reported.timestamp),
                    _ => voted(&voters),
                };
                reported.status = reported.status.with_degraded(voters.len() < 3);
                let last = arrived.iter().rposition(|arrived| arrived + MS <= tick(cycle));
                if let Some(last) = last.filter(|last| *last >= 3) {
                    let since_arrival = (tick(cycle) - arrived[last]) as f64 / 1e9;
                    reported.latitude += 6.0 * (since_arrival + before_arrival + off) / 111_185.0;
                }
                before = [0, 1, 2].map(|receiver| gps[receiver].status.position_valid());
            })
        };
        assert_eq!(said(0.0), [], "{late:?}");
        let in_doubt = late == [0, 50, 0];
        for off in [-0.04, 0.03].into_iter().filter(|_| !in_doubt) {
            assert_eq!(said(off)[0].0, Violation::ReportedWrong, "{late:?}: {off} s");
        }
    }
}

#[test]
fn an_altitude_that_no_receiver_gives_is_none() {
    let mut scene = Scene::new(1);
    scene.receivers[0].iter_mut().for_each(|burst| burst.pvt.as_mut().unwrap().fix_type = 2);
    let said = |altitude: f64| {
        scene.said(|cycle, reported, gps| {
            if gps[0].status.position_valid() {
                gps[0].status = gps[0].status.with_fix_type(FixType::Fix2D);
                gps[0].altitude = ABSENT_F64;
            }
            reported.altitude = if cycle == STEADY { altitude } else { ABSENT_F64 };
            reported.status = reported.status.with_degraded(true);
        })
    };
    assert_eq!(said(ABSENT_F64), []);
    assert_eq!(said(493.0), REPORTED);
}

#[test]
fn attitude_and_acceleration_are_medians_bit_by_bit_of_one_member() {
    let changes: [fn(&mut ReportedValues, f32); 6] = [
        |reported, by| reported.pitch += by,
        |reported, by| reported.yaw += by,
        |reported, by| reported.roll += by,
        |reported, by| reported.acceleration[0] += by,
        |reported, by| reported.acceleration[1] += by,
        |reported, by| reported.acceleration[2] += by,
    ];
    for change in changes {
        assert_eq!(changed(1, |reported| change(reported, 2e-6)), REPORTED);
        for gps in [2, 3, 5] {
            assert_eq!(changed(gps, |reported| change(reported, 2e-6)), []);
            assert_eq!(changed(gps, |reported| change(reported, 2e-4)), REPORTED);
        }
    }
    for gps in [1, 3] {
        let unsaid = |reported: &mut ReportedValues| reported.status = reported.status.with_attitude_valid(false);
        assert_eq!(changed(gps, unsaid), REPORTED);
        let unsaid = |reported: &mut ReportedValues| reported.status = reported.status.with_acceleration_valid(false);
        assert_eq!(changed(gps, unsaid), REPORTED);
        assert_eq!(changed(gps, |reported| reported.yaw = ABSENT_F32), REPORTED);
    }
}

#[test]
fn a_yaw_is_a_median_on_the_circle() {
    let mut scene = Scene::new(3);
    for (bursts, heading) in scene.receivers.iter_mut().zip([35_900_000, 100_000, 300_000]) {
        bursts.iter_mut().for_each(|burst| burst.att.as_mut().unwrap().heading_1e5 = heading);
    }
    let said = |degrees: f32| {
        scene.said(|_, reported, _| {
            if reported.status.attitude_valid() {
                reported.yaw = degrees.to_radians();
            }
        })
    };
    assert_eq!(said(1.0), []);
    assert_eq!(said(361.0), []);
    assert_eq!(said(3.0)[0].0, Violation::ReportedWrong);
}

#[test]
fn attitude_and_acceleration_are_those_of_the_members_that_have_one() {
    let mut scene = Scene::new(3);
    for receiver in [0, 2] {
        scene.receivers[receiver].iter_mut().for_each(|burst| (burst.att, burst.ins) = (None, None));
    }
    assert_eq!(scene.said(unchanged), []);
    scene.receivers[1].iter_mut().for_each(|burst| (burst.att, burst.ins) = (None, None));
    assert_eq!(scene.said(unchanged), []);
    let said = scene.said(|cycle, reported, _| {
        if cycle == STEADY {
            reported.roll = 0.0;
        }
    });
    assert_eq!(said, REPORTED);
}

fn of_three(
    gps: usize,
    bursts: impl Fn(usize, &mut Burst),
    changed: impl Fn(&mut ReportedValues, &[GpsValues]),
) -> [Vec<Violation>; 2] {
    let mut scene = Scene::new(gps);
    for (receiver, all) in scene.receivers.iter_mut().enumerate() {
        all.iter_mut().for_each(|burst| bursts(receiver, burst));
    }
    let flat = |gps: &mut [GpsValues], scene: &Scene| {
        for (values, bursts) in gps.iter_mut().zip(&scene.receivers) {
            if bursts[0].pvt.as_ref().is_some_and(|pvt| pvt.fix_type == 2) && values.status.position_valid() {
                values.status = values.status.with_fix_type(FixType::Fix2D);
                values.altitude = ABSENT_F64;
            }
        }
    };
    let kinds = |said: Vec<(Violation, u64)>| said.into_iter().map(|(violation, _)| violation).collect();
    let right = scene.said(|_, _, gps| flat(gps, &scene));
    let wrong = scene.said(|cycle, reported, gps| {
        flat(gps, &scene);
        if cycle > STEADY {
            *reported = voted(gps);
            changed(reported, gps);
        }
    });
    [kinds(right), kinds(wrong)]
}

#[test]
fn an_altitude_takes_a_quorum_of_members_that_have_one() {
    let flat = |count: usize| {
        move |receiver: usize, burst: &mut Burst| {
            let pvt = burst.pvt.as_mut().unwrap();
            pvt.fix_type = if receiver < count { 2 } else { 3 };
        }
    };
    let shown = |reported: &mut ReportedValues, gps: &[GpsValues]| {
        reported.altitude = gps.last().unwrap().altitude;
        reported.status = reported.status.with_degraded(false);
    };
    let none = |reported: &mut ReportedValues, _: &[GpsValues]| {
        reported.altitude = ABSENT_F64;
        reported.status = reported.status.with_degraded(true);
    };
    for (gps, least) in [(1, 1), (2, 1), (3, 2), (5, 3)] {
        for have in 0..=gps {
            if have < least {
                let [right, wrong] = of_three(gps, flat(gps - have), shown);
                assert_eq!([right, wrong], [vec![], vec![Violation::ReportedWrong]], "{have} of {gps}");
            } else {
                let found = of_three(gps, flat(gps - have), none);
                assert_eq!(found, [vec![], vec![Violation::ReportedWrong]], "{have} of {gps}");
            }
        }
    }
    let degraded = |reported: &mut ReportedValues, _: &[GpsValues]| {
        reported.status = reported.status.with_degraded(false);
    };
    assert_eq!(of_three(3, flat(2), degraded), [vec![], vec![Violation::ReportedWrong]]);
}

#[test]
fn who_contradicts_a_quorum_of_altitudes_has_to_be_excluded() {
    let mut scene = standing(&[(0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 500.0)]);
    scene.receivers[0].iter_mut().for_each(|burst| burst.pvt.as_mut().unwrap().fix_type = 2);
    let found = |from: u64, beside: f64| {
        scene.said(|cycle, reported, gps| {
            if gps[0].status.position_valid() {
                gps[0].status = gps[0].status.with_fix_type(FixType::Fix2D);
                gps[0].altitude = ABSENT_F64;
            }
            gps[4].status = gps[4].status.with_excluded(cycle >= from);
            if gps[4].status.position_valid() {
                *reported = voted(&gps[..4]);
                reported.altitude += beside;
                reported.status = reported.status.with_degraded(true);
            }
        })
    };
    let shown = |cycle: u64| scene.shown(4, tick(cycle), cycle as u32 * CYCLE_MS);
    let first = (1..).find(|cycle| shown(*cycle).status.position_valid()).unwrap();
    assert_eq!(found(first + 1, 0.0), []);
    assert_eq!(found(first + 40, 0.0)[0].0, Violation::ExclusionWrong);
}

#[test]
fn attitude_and_acceleration_take_a_quorum_that_agrees() {
    for (gps, off, is_stated) in [
        (2, [0, 0, 0, 0], true),
        (2, [499_000, 0, 0, 0], true),
        (2, [501_000, 0, 0, 0], false),
        (2, [0, -999_000, 0, 0], true),
        (2, [0, -1_001_000, 0, 0], false),
        (2, [0, 18_000_000, 0, 0], false),
        (3, [0, 0, 499_000, 0], true),
        (3, [0, 0, -501_000, 0], false),
        (3, [0, 0, 0, 179], true),
        (3, [0, 0, 0, 201], false),
        (5, [0, 1_001_000, 0, 0], false),
    ] {
        let bursts = |receiver: usize, burst: &mut Burst| {
            let [pitch, yaw, roll, front] = if receiver == 1 { off } else { [0; 4] };
            let att = burst.att.as_mut().unwrap();
            (att.pitch_1e5, att.heading_1e5, att.roll_1e5) = (1_000 + pitch, 20_000_000 + yaw, roll - 17_900_000);
            att.heading_1e5 %= 36_000_000;
            burst.ins.as_mut().unwrap().accelerations_1e2 = [front, 0, 0];
        };
        let changed = |reported: &mut ReportedValues, gps: &[GpsValues]| {
            let of_front = off[3] != 0;
            if of_front {
                let valid = reported.status.acceleration_valid();
                assert_eq!(valid, is_stated, "{off:?}");
                reported.status = reported.status.with_acceleration_valid(!valid);
                reported.acceleration = if valid { [ABSENT_F32; 3] } else { gps[0].acceleration };
            } else {
                let valid = reported.status.attitude_valid();
                assert_eq!(valid, is_stated, "{off:?}");
                reported.status = reported.status.with_attitude_valid(!valid);
                [reported.pitch, reported.yaw, reported.roll] =
                    if valid { [ABSENT_F32; 3] } else { [gps[0].pitch, gps[0].yaw, gps[0].roll] };
            }
        };
        let found = of_three(gps, bursts, changed);
        assert_eq!(found, [vec![], vec![Violation::ReportedWrong]], "{gps} {off:?}");
    }
}

/// Returns a scene in which all receivers jump by this distance (m) north and up during these bursts.
fn jumping(gps: usize, bursts: std::ops::Range<usize>, north: f64, up: f64) -> Scene {
    let mut scene = Scene::of_cycles(gps, 100, 300);
    for receiver in &mut scene.receivers {
        let until = bursts.end.min(receiver.len());
        for pvt in receiver[bursts.start..until].iter_mut().filter_map(|burst| burst.pvt.as_mut()) {
            pvt.latitude_1e7 += (north * PER_METRE) as i32;
            pvt.height_mm += (up * 1e3) as i32;
        }
    }
    scene
}

fn withhold(reported: &mut ReportedValues) {
    let state = reported.status.state().unwrap();
    *reported = ReportedValues::absent(reported.timestamp);
    reported.status = reported.status.with_degraded(true).with_state(state);
}

fn withheld(scene: &Scene, cycles: std::ops::Range<u64>) -> Vec<(Violation, u64)> {
    scene.said(|cycle, reported, _| {
        if cycles.contains(&cycle) {
            withhold(reported);
        }
    })
}

fn voted_from(scene: &Scene, number: usize) -> u64 {
    cycle_after(&scene.receivers[0][number], MS)
}

#[test]
fn a_jump_of_all_receivers_is_shown_after_exactly_a_second() {
    for gps in [1, 2, 3, 5] {
        let scene = jumping(gps, 8..99, 1_000.0, 0.0);
        let from = voted_from(&scene, 8);
        assert_eq!(scene.said(unchanged), VOTE, "{gps} receivers");
        for (cycles, found) in [(1, &VOTE[..]), (60, &VOTE), (92, &VOTE), (97, &[]), (100, &[]), (106, &[])] {
            assert_eq!(withheld(&scene, from..from + cycles), found, "{gps} receivers, {cycles} cycles");
        }
        assert_eq!(withheld(&scene, from..from + 115)[0].0, Violation::VoteMissing);
        assert_eq!(withheld(&scene, from..999)[0].0, Violation::VoteMissing);
    }
}

#[test]
fn who_comes_back_from_a_jump_has_to_be_shown_at_once() {
    let scene = jumping(3, 8..12, 1_000.0, 0.0);
    let (from, until) = (voted_from(&scene, 8), voted_from(&scene, 12));
    assert_eq!(withheld(&scene, from..until), []);
    // In the first cycle after the jump, the vote may still have used the burst before the jump.
    assert_eq!(withheld(&scene, from..until + 4), [(Violation::VoteMissing, 3)]);
    // HORUS holds the new position back for 400 ms. Then the old position returns for one burst, which restarts the
    // second for which HORUS holds a jump back.
    let mut scene = jumping(3, 8..99, 1_000.0, 0.0);
    for receiver in &mut scene.receivers {
        receiver[12].pvt.as_mut().unwrap().latitude_1e7 -= (1_000.0 * PER_METRE) as i32;
    }
    let (back, again) = (voted_from(&scene, 12), voted_from(&scene, 13));
    let found = |last: u64| {
        scene.said(|cycle, reported, _| {
            if (from..back).contains(&cycle) || (again..again + last).contains(&cycle) {
                withhold(reported);
            }
        })
    };
    assert_eq!(found(100), []);
    assert_eq!(found(60), VOTE);
}

#[test]
fn a_step_within_200_m_s_and_the_accuracies_is_no_jump() {
    // Accuracies of 4 m each allow a step of 17 m, and a speed of 200 m/s allows 2 m more in each cycle.
    let missing = |north: f64, cycles: u64| {
        let scene = jumping(3, 8..99, north, 0.0);
        let from = voted_from(&scene, 8);
        withheld(&scene, from..from + cycles)
    };
    assert_eq!(missing(17.0, 0), []);
    assert_eq!(missing(17.0, 2)[0].0, Violation::VoteMissing);
    assert_eq!(missing(25.0, 0), VOTE);
    assert_eq!(missing(100.0, 42), []);
    assert_eq!(missing(100.0, 30), VOTE);
    assert_eq!(missing(100.0, 60)[0].0, Violation::VoteMissing);
}

#[test]
fn what_is_held_back_moves_within_the_same_reach_or_begins_anew() {
    let mut scene = jumping(3, 8..99, 1_000.0, 0.0);
    for receiver in &mut scene.receivers {
        for pvt in receiver[13..].iter_mut().filter_map(|burst| burst.pvt.as_mut()) {
            pvt.latitude_1e7 += (300.0 * PER_METRE) as i32;
        }
    }
    let (from, anew) = (voted_from(&scene, 8), voted_from(&scene, 13));
    assert_eq!(withheld(&scene, from..anew + 100), []);
    assert_eq!(withheld(&scene, from..from + 105), VOTE);
    let mut scene = jumping(1, 8..99, 1_000.0, 0.0);
    scene.receivers[0].drain(10..13);
    let again = voted_from(&scene, 10);
    assert_eq!(withheld(&scene, from..again + 100), []);
    assert_eq!(withheld(&scene, from..again + 60), VOTE);
}

#[test]
fn an_altitude_that_jumps_is_held_back_by_itself() {
    let scene = jumping(3, 8..99, 0.0, 400.0);
    let from = voted_from(&scene, 8);
    let held = |cycles: u64| {
        scene.said(|cycle, reported, _| {
            if (from..from + cycles).contains(&cycle) {
                reported.altitude = ABSENT_F64;
                reported.status = reported.status.with_degraded(true);
            }
        })
    };
    assert_eq!(held(0), VOTE);
    assert_eq!(held(60), VOTE);
    assert_eq!(held(100), []);
    assert_eq!(held(115)[0].0, Violation::ReportedWrong);
    assert_eq!(withheld(&scene, from..from + 100)[0].0, Violation::VoteMissing, "the place does not jump");
}

#[test]
fn the_first_result_is_shown_wherever_it_is() {
    let scene = jumping(3, 0..99, 1_000.0, 0.0);
    assert_eq!(scene.said(unchanged), []);
    assert_eq!(withheld(&scene, 0..voted_from(&scene, 3))[0].0, Violation::VoteMissing);
}

#[test]
fn the_status_follows_from_the_vote() {
    let status =
        |of: fn(ReportedStatus) -> ReportedStatus| changed(3, move |reported| reported.status = of(reported.status));
    assert_eq!(status(|status| status), []);
    assert_eq!(status(|status| status.with_without_crystal(true)), [(Violation::CrystalWrong, 1)]);
    assert_eq!(status(|status| status.with_receivers_agreeing(2)), VOTE, "all three agree");
    assert_eq!(status(|status| status.with_receivers_agreeing(4)), REPORTED);
    assert_eq!(status(|status| status.with_degraded(true)), REPORTED);
    assert_eq!(status(|status| status.with_state(HorusState::OutsideRange)), STATE, "no input says that");
    let mut scene = Scene::new(3);
    scene.receivers[2].clear();
    assert_eq!(scene.said(unchanged), []);
    let said = scene.said(|cycle, reported, _| {
        if cycle == STEADY {
            reported.status = reported.status.with_degraded(false);
        }
    });
    assert_eq!(said, REPORTED);
}

#[test]
fn horus_is_starting_until_its_first_result() {
    let mut scene = Scene::new(1);
    scene.receivers[0].clear();
    let monitoring = |cycle: u64, reported: &mut ReportedValues, _: &mut [GpsValues]| {
        if cycle == STEADY {
            reported.status = reported.status.with_state(HorusState::Monitoring);
        }
    };
    let lost = |cycle: u64, reported: &mut ReportedValues, _: &mut [GpsValues]| {
        if cycle == STEADY {
            reported.status = reported.status.with_state(HorusState::PositionLost);
        }
    };
    assert_eq!(scene.said(unchanged), []);
    assert_eq!(scene.said(monitoring), REPORTED);
    assert_eq!(scene.said(lost), REPORTED, "there was none");
    // If a cycle has no frame, the judge does not learn whether the vote of that cycle had a result.
    let mut events = scene.events(lost);
    let unseen = tick(STEADY - 5);
    events.without(
        |event| matches!(event.what, What::Sent { started, .. } if (unseen..unseen + 9 * MS).contains(&started)),
    );
    assert_eq!(kinds(&events), []);
}

#[test]
fn horus_monitors_only_while_there_is_a_result() {
    let mut scene = Scene::new(1);
    scene.receivers[0].truncate(4);
    let state = |cycle: u64, state: HorusState| {
        scene.said(|at, reported, _| {
            if at == cycle {
                reported.status = reported.status.with_state(state);
            }
        })
    };
    let (there, gone) = (20, cycle_after(&scene.receivers[0][3], 400 * MS));
    assert_eq!(state(there, HorusState::Monitoring), []);
    assert_eq!(state(there, HorusState::PositionLost), REPORTED);
    assert_eq!(state(gone, HorusState::PositionLost), []);
    assert_eq!(state(gone, HorusState::Monitoring), REPORTED);
}

/// Returns the violations if HORUS restarts for `cause` while GPS2 is excluded. `excluded` states whether GPS2 and GPS3
/// are excluded after the restart.
fn after_restart(cause: Cause, reason: ResetReason, excluded: [bool; 2]) -> Vec<(Violation, u64)> {
    after_off(false, cause, reason, excluded)
}

fn after_off(off: bool, cause: Cause, reason: ResetReason, excluded: [bool; 2]) -> Vec<(Violation, u64)> {
    kinds(&after_cycles(&strayed(3, 5..26), 25, off, cause, reason, excluded))
}

fn after_cycles(
    scene: &Scene,
    cycles: u64,
    off: bool,
    cause: Cause,
    reason: ResetReason,
    excluded: [bool; 2],
) -> Events {
    let from = shows(scene, 5);
    let mut events = scene.events(|cycle, _, gps| gps[1].status = gps[1].status.with_excluded(cycle >= from));
    let at = tick(from + cycles) + 9 * MS;
    let ends = if off { at - 10 * MS } else { at };
    events.without(|event| event.at > ends);
    if off {
        events.add(ends, What::Power { board: Board::Horus, on: false });
        events.add(at, What::Power { board: Board::Horus, on: true });
    }
    events.add(at, What::Reset { board: Board::Horus, cause, asked: false });
    for number in 1..=20 {
        let mut gps = [silent_gps(number * CYCLE_MS); 3];
        for (gps, excluded) in gps[1..].iter_mut().zip(excluded) {
            gps.status = gps.status.with_excluded(excluded);
        }
        let mut reported = voted(&gps);
        reported.status = reported.status.with_reset_reason(reason);
        events.cycle_of(at + 41 * MS + u64::from(number) * bounds::CYCLE, &reported, &gps);
    }
    events.end(at + 300 * MS);
    events
}

#[test]
fn who_is_excluded_stays_so_over_a_restart_that_keeps_ram() {
    for (cause, reason) in [
        (Cause::Watchdog, ResetReason::Watchdog),
        (Cause::BrownOut, ResetReason::BrownOutOrOther),
        (Cause::Pin, ResetReason::Pin),
    ] {
        assert_eq!(after_restart(cause, reason, [true, false]), [], "{cause:?}");
        assert_eq!(after_restart(cause, reason, [false, false]), EXCLUSION, "{cause:?}");
        assert_eq!(after_restart(cause, reason, [true, true]), EXCLUSION, "{cause:?}: GPS3 agreed with GPS1");
    }
    assert_eq!(after_restart(Cause::PowerOn, ResetReason::PowerOn, [false, false]), []);
    assert_eq!(after_restart(Cause::PowerOn, ResetReason::PowerOn, [true, false]), EXCLUSION);
}

#[test]
fn just_before_a_restart_an_unseen_vote_may_exclude_a_receiver() {
    let found = |cycles: u64, speak: &[usize], excluded: [bool; 2]| {
        let mut scene = strayed(3, 5..26);
        for (receiver, bursts) in scene.receivers.iter_mut().enumerate() {
            bursts.retain(|burst| burst.at != FIRST_BURST + 700 * MS || speak.contains(&receiver));
        }
        kinds(&after_cycles(&scene, cycles, false, Cause::Pin, ResetReason::Pin, excluded))
    };
    for (cycles, speak, expected) in [
        (20, &[2][..], vec![]),
        (20, &[0], EXCLUSION.into()),
        (20, &[0, 1], vec![]),
        (20, &[], EXCLUSION.into()),
        (18, &[0, 1, 2], EXCLUSION.into()),
        (21, &[0, 1, 2], EXCLUSION.into()),
    ] {
        assert_eq!(found(cycles, speak, [true, true]), expected, "after {cycles} cycles, of {speak:?}");
        assert_eq!(found(cycles, speak, [true, false]), []);
    }
}

#[test]
fn a_dead_task_may_have_lost_who_is_excluded() {
    let scene = strayed(3, 5..26);
    let restarted = |dead: Option<Board>| {
        let (cause, reason) = (Cause::Watchdog, ResetReason::Watchdog);
        let mut events = after_cycles(&scene, 25, false, cause, reason, [false, false]);
        if let Some(board) = dead {
            let at = tick(shows(&scene, 5) + 25) + 8 * MS;
            events.add(at, injected(Disturbance::DeadTask { board, task: 0 }, at));
        }
        kinds(&events)
    };
    assert_eq!(restarted(None), EXCLUSION);
    assert_eq!(restarted(Some(Board::Dpr)), EXCLUSION);
    assert_eq!(restarted(Some(Board::Horus)), []);
}

#[test]
fn a_supply_that_was_away_may_have_lost_who_is_excluded() {
    let after = |excluded| after_off(true, Cause::BrownOut, ResetReason::BrownOutOrOther, excluded);
    assert_eq!(after([true, false]), []);
    assert_eq!(after([false, false]), []);
    assert_eq!(after([true, true]), EXCLUSION, "GPS3 agreed with GPS1");
    assert_eq!(after_off(true, Cause::PowerOn, ResetReason::PowerOn, [true, false]), EXCLUSION);
}

#[test]
fn a_wrong_reason_of_the_last_reset_is_told_in_each_cycle() {
    assert_eq!(after_restart(Cause::Pin, ResetReason::Watchdog, [true, false]), [(Violation::ReportedWrong, 20)]);
}

#[test]
fn a_reported_position_without_a_result_says_nothing() {
    let mut scene = Scene::new(2);
    scene.receivers.iter_mut().for_each(Vec::clear);
    let said = |change: fn(&mut ReportedValues)| {
        scene.said(|cycle, reported, _| {
            if cycle == STEADY {
                change(reported);
            }
        })
    };
    assert_eq!(said(|_| {}), []);
    assert_eq!(said(|reported| reported.status = reported.status.with_state(HorusState::MotorsCut)), STATE);
    for change in [
        (|reported| reported.status = reported.status.with_receivers_agreeing(1)) as fn(&mut ReportedValues),
        |reported| reported.status = reported.status.with_attitude_valid(true),
        |reported| reported.status = reported.status.with_acceleration_valid(true),
        |reported| reported.status = reported.status.with_degraded(false),
        |reported| reported.latitude = 1.0,
        |reported| reported.longitude = 1.0,
        |reported| reported.altitude = 1.0,
        |reported| reported.pitch = 1.0,
        |reported| reported.yaw = 1.0,
        |reported| reported.roll = 1.0,
        |reported| reported.acceleration[2] = 1.0,
    ] {
        assert_eq!(said(change), REPORTED);
    }
    assert_eq!(said(|reported| reported.status = reported.status.with_position_valid(true)), VOTE);
    let mut scene = Scene::new(2);
    scene.receivers[1].clear();
    assert_eq!(scene.said(unchanged), []);
    let said = scene.said(|cycle, reported, gps| {
        if cycle == STEADY {
            *reported = ReportedValues::absent(gps[0].timestamp);
            reported.status = reported.status.with_degraded(true);
        }
    });
    assert_eq!(said, MISSING);
}

#[test]
fn reported_position_has_the_timestamp_of_the_gps_objects() {
    for gps in [3, 5] {
        assert_eq!(changed(gps, |reported| reported.timestamp += 10), REPORTED);
        assert_eq!(changed(gps, |reported| reported.timestamp -= 1), REPORTED);
    }
}

#[test]
fn a_vote_beside_or_after_a_wrong_gps_object_is_not_judged() {
    let said = |wrong: u64| {
        Scene::new(3).said(|cycle, reported, gps| {
            if cycle == STEADY {
                gps[2].latitude = 0.0;
            }
            if cycle == wrong {
                reported.latitude = 0.0;
            }
        })
    };
    assert_eq!(said(STEADY), CONTENT);
    assert_eq!(said(STEADY + 1), CONTENT);
    assert_eq!(said(STEADY + 2), [CONTENT, REPORTED].concat());
    let mut events = Scene::new(5).events(|cycle, reported, _| {
        if cycle == STEADY {
            reported.latitude = 0.0;
        }
    });
    assert_eq!(kinds(&events), REPORTED);
    let second = tick(STEADY) + 4 * MS;
    events
        .without(|event| matches!(event.what, What::Sent { started, .. } if started > second && started < second + MS));
    assert_eq!(kinds(&events), []);
}

#[test]
fn while_ticks_are_not_regular_no_place_is_judged() {
    let scene = strayed(3, 5..9);
    let mut events = scene.events(unchanged);
    let last = tick(shows(&scene, 9));
    for event in events.events.iter_mut().filter(|event| event.at == tick(20) && event.what == What::Tick) {
        event.at += bounds::TICK_TOLERANCE + 1;
    }
    events.without(|event| event.at > last && !matches!(event.what, What::Fed { .. }));
    assert_eq!(kinds(&events), []);
}

/// HORUS votes one cycle before the tick and leaves out a position that will be too old at the tick. The GPS object of
/// that tick may already show the receiver's next position.
#[test]
fn a_position_that_expires_before_its_successor_comes_may_miss_one_vote() {
    let without_gps2 = |scene: &Scene, missed: u64| {
        scene.said(|cycle, reported, gps| {
            if cycle == missed {
                let state = reported.status.state().unwrap();
                *reported = voted(&[gps[0], gps[2]]);
                reported.status = reported.status.with_degraded(true).with_state(state);
            }
        })
    };
    for (silence, found) in [(246, &[][..]), (226, &VOTE)] {
        let mut scene = Scene::new(3);
        let bursts = &mut scene.receivers[1];
        bursts.drain(6..8);
        bursts[6].at = bursts[5].at + silence * MS;
        let missed = shows(&scene, 6);
        assert_eq!(without_gps2(&scene, missed), found, "{silence} ms");
        assert_eq!(without_gps2(&scene, missed + 1), VOTE);
        assert_eq!(scene.said(|_, _, _| {}), []);
    }
}
