use super::*;

/// What is found if Reported-Position is changed in one cycle of a run whose receivers are some metres apart.
fn changed(gps: usize, change: impl Fn(&mut ReportedValues)) -> Vec<(Violation, u64)> {
    Scene::new(gps).said(|cycle, reported, _| {
        if cycle == STEADY {
            change(reported);
        }
    })
}

#[test]
fn reported_position_lies_within_the_box_of_the_valid_positions() {
    for gps in [2, 5] {
        let scene = Scene::new(gps);
        let all: Vec<_> = (0..gps).map(|receiver| scene.shown(receiver, tick(STEADY), 510)).collect();
        let (low, high) = (all[0], all[gps - 1]);
        assert!(low.latitude < high.latitude && low.longitude > high.longitude && low.altitude < high.altitude);
        let at = |latitude, longitude, altitude| {
            changed(gps, |reported| {
                (reported.latitude, reported.longitude, reported.altitude) = (latitude, longitude, altitude);
            })
        };
        assert_eq!(at(high.latitude, low.longitude, high.altitude), [], "a corner");
        assert_eq!(at(low.latitude, high.longitude, ABSENT_F64), [], "without an altitude");
        assert_eq!(at(high.latitude.next_up(), low.longitude, low.altitude), REPORTED);
        assert_eq!(at(low.latitude.next_down(), low.longitude, low.altitude), REPORTED);
        assert_eq!(at(low.latitude, low.longitude.next_up(), low.altitude), REPORTED);
        assert_eq!(at(low.latitude, high.longitude.next_down(), low.altitude), REPORTED);
        assert_eq!(at(low.latitude, low.longitude, high.altitude.next_up()), REPORTED);
        assert_eq!(at(low.latitude, low.longitude, low.altitude.next_down()), REPORTED);
        assert_eq!(at(ABSENT_F64, low.longitude, low.altitude), REPORTED);
        assert_eq!(at(low.latitude, ABSENT_F64, low.altitude), REPORTED);
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
        })
    };
    assert_eq!(said(ABSENT_F64), []);
    assert_eq!(said(493.0), REPORTED);
}

#[test]
fn longitudes_on_both_sides_of_the_date_line_span_no_box() {
    let gps = |longitude: f64| GpsValues {
        status: GpsStatus::new().with_position_valid(true),
        latitude: 1.0,
        longitude,
        ..GpsValues::absent(10)
    };
    let fault = |longitudes: [f64; 2], longitude: f64| {
        let status = ReportedStatus::new().with_position_valid(true);
        let reported = ReportedValues { status, latitude: 1.0, longitude, ..ReportedValues::absent(10) };
        super::super::reported::fault(&reported, longitudes.map(gps).iter()).is_some()
    };
    assert!(!fault([179.0, -179.0], 180.0));
    assert!(!fault([179.0, -179.0], -179.5));
    assert!(fault([89.0, -90.0], 90.0));
    assert!(fault([90.0, -90.0], 90.5), "half of the earth is a box");
}

#[test]
fn reported_position_is_valid_only_beside_a_valid_position() {
    let scene = {
        let mut scene = Scene::new(2);
        scene.receivers.iter_mut().for_each(Vec::clear);
        scene
    };
    let said = |change: &dyn Fn(&mut ReportedValues)| {
        scene.said(|cycle, reported, _| {
            if cycle == STEADY {
                change(reported);
            }
        })
    };
    assert_eq!(said(&|_| {}), []);
    assert_eq!(said(&|reported| reported.status = reported.status.with_position_valid(true)), REPORTED);
    assert_eq!(said(&|reported| reported.status = reported.status.with_receivers_agreeing(1)), REPORTED);
    for change in [
        (|reported: &mut ReportedValues| reported.latitude = 1.0) as fn(&mut ReportedValues),
        |reported| reported.longitude = 1.0,
        |reported| reported.altitude = 1.0,
    ] {
        assert_eq!(said(&change), REPORTED, "a position that is not valid is not there");
    }
}

#[test]
fn no_more_receivers_agree_than_have_a_valid_position() {
    let agree =
        |count| move |reported: &mut ReportedValues| reported.status = reported.status.with_receivers_agreeing(count);
    assert_eq!(changed(3, agree(3)), []);
    assert_eq!(changed(3, agree(4)), REPORTED);
    assert_eq!(changed(5, agree(5)), []);
    assert_eq!(changed(5, agree(6)), REPORTED);
}

#[test]
fn reported_position_has_the_timestamp_of_the_gps_objects() {
    for gps in [3, 5] {
        assert_eq!(changed(gps, |reported| reported.timestamp += 10), REPORTED);
        assert_eq!(changed(gps, |reported| reported.timestamp -= 1), REPORTED);
    }
}

#[test]
fn reported_position_may_be_absent_although_positions_are_valid() {
    assert_eq!(changed(3, |reported| *reported = ReportedValues::absent(reported.timestamp)), []);
}

#[test]
fn beside_a_gps_object_that_is_wrong_or_missing_reported_position_is_not_judged() {
    let said = Scene::new(3).said(|cycle, reported, gps| {
        if cycle == STEADY {
            (reported.latitude, gps[2].latitude) = (0.0, 0.0);
        }
    });
    assert_eq!(said, CONTENT);
    let said = Scene::new(3).said(|cycle, reported, gps| {
        if cycle == STEADY {
            gps[2].status = gps[2].status.with_heard(false);
            reported.latitude = 0.0;
        }
    });
    assert_eq!(said, STATUS);
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
