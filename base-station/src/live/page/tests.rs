use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use axum::body::{Body, to_bytes};
use axum::http::Method;
use futures_util::StreamExt;
use profile::criticality::{ActiveLoad, Writer};
use profile::hold::HoldCommand;
use profile::{GpsStatus, GpsValues, HoldStatus, HoldValues, HorusState, Profile, ReportedStatus, ReportedValues};
use serde_json::{Value, json};
use tokio::sync::watch;
use tower::ServiceExt;

use super::super::StationData;
use super::super::mouths::Mouths;
use super::super::playback::Contents;
use super::*;
use crate::carrier::mavlink::{Forwarder, Key, Rates, Signer};
use crate::intake::{Carried, Kind};
use crate::{Bundle, Place, Who};

const START: u64 = 1_790_000_000_000_000;

fn local() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 8480))
}

fn profile() -> Profile<3> {
    let status = ReportedStatus::new()
        .with_position_valid(true)
        .with_attitude_valid(true)
        .with_receivers_agreeing(2)
        .with_degraded(true)
        .with_state(HorusState::Monitoring);
    let (latitude, longitude, altitude) = (47.497_912_345_678_9, -8.728_9, 470.125);
    let reported =
        ReportedValues { status, latitude, longitude, altitude, pitch: 0.5, yaw: 1.0, roll: -0.25, ..absent() };
    let status = GpsStatus::new().with_position_valid(true).with_heard(true);
    let known = GpsValues { status, latitude, longitude, altitude, ..GpsValues::absent(70_000) };
    Profile::seal(
        &reported,
        &[known, GpsValues { status: status.with_excluded(true), ..known }, GpsValues::absent(70_000)],
    )
}

fn absent() -> ReportedValues {
    ReportedValues::absent(70_000)
}

fn station() -> (Station, watch::Sender<u64>) {
    let mut known = StationData::default();
    for system in [3, 9] {
        let mut forwarder = Forwarder::new(system, 1, Rates { bytes_per_s: 100_000, period_us: 0, standard_us: 0 });
        forwarder.offer(&Bundle::datagram(profile().as_bytes()).unwrap());
        while let Some(bytes) = forwarder.poll(1_000_000, 0) {
            let carried = Carried { at_us: START, kind: Kind::MavlinkDatagrams, line: 0, from: String::new(), bytes };
            known.intake.take(&carried);
        }
    }
    known.now_us = START;
    known.look();
    known.now_us = START + 120_000;
    known.lines.push(("/dev/ttyUSB0".into(), "unplugged".into()));
    let (changed, changes) = watch::channel(0);
    let dropped = Arc::new(AtomicU64::new(4));
    (Station { known: Arc::new(Mutex::new(known)), changes, dropped, mouths: Mouths::default() }, changed)
}

fn run<T>(test: impl Future<Output = T>) -> T {
    // Virtual time advances only while all tasks wait, so the tests do not depend on the machine's speed.
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build().unwrap();
    runtime.block_on(test)
}

async fn ask(router: &Router, method: Method, path: &str, host: &str) -> Response {
    let request = Request::builder().method(method).uri(path).header(header::HOST, host).body(Body::empty()).unwrap();
    router.clone().oneshot(request).await.unwrap()
}

async fn text(response: Response) -> String {
    String::from_utf8(to_bytes(response.into_body(), 1 << 20).await.unwrap().to_vec()).unwrap()
}

#[test]
fn every_answer_has_the_policy_and_nothing_is_fetched_from_elsewhere() {
    run(async {
        let router = router(station().0, None, local());
        let served = ["/", "/page.css", "/page.js", "/stream.js", "/hold.js", "/state", "/events"];
        for path in served.into_iter().chain(["/nowhere", "/playback", "/hold"]) {
            let answer = ask(&router, Method::GET, path, "127.0.0.1:8480").await;
            assert_eq!(answer.headers()[header::CONTENT_SECURITY_POLICY], POLICY, "{path}");
            assert_eq!(answer.headers()[header::X_CONTENT_TYPE_OPTIONS], "nosniff", "{path}");
            let expected = if served.contains(&path) { StatusCode::OK } else { StatusCode::NOT_FOUND };
            assert_eq!(answer.status(), expected, "{path}");
        }
        for path in &served[..5] {
            let text = text(ask(&router, Method::GET, path, "localhost").await).await;
            assert!(text.len() > 500 && !text.contains("http://") && !text.contains("https://"), "{path}");
            // The page's content security policy would refuse inline styles and handlers.
            assert!(!text.contains("style=") && !text.contains("onclick=") && !text.contains("innerHTML"), "{path}");
        }
    });
}

#[test]
fn a_page_for_this_machine_answers_to_no_other_name() {
    run(async {
        let page = router(station().0, None, local());
        for host in ["127.0.0.1:8480", "localhost:8480", "localhost", "[::1]:8480", "[::1]"] {
            assert_eq!(ask(&page, Method::GET, "/state", host).await.status(), StatusCode::OK, "{host}");
        }
        for host in ["example.org", "127.0.0.1.example.org:8480", "", "localhost:8480:80", "[::1"] {
            let refused = ask(&page, Method::GET, "/state", host).await;
            assert_eq!(refused.status(), StatusCode::FORBIDDEN, "{host}");
        }
        let open = router(station().0, None, SocketAddr::from(([0, 0, 0, 0], 8480)));
        for (host, expected) in [
            ("192.168.1.5:8480", StatusCode::OK),
            ("[fe80::1]:8480", StatusCode::OK),
            ("base.example.org", StatusCode::FORBIDDEN),
            ("1.2.3.4.example.org:80", StatusCode::FORBIDDEN),
        ] {
            assert_eq!(ask(&open, Method::GET, "/state", host).await.status(), expected, "{host}");
        }
    });
}

#[test]
fn a_page_with_a_login_is_shown_to_nobody_else() {
    run(async {
        let access = Access::from(SocketAddr::from(([0, 0, 0, 0], 8480))).with_login("pilot:wing");
        let page = router(station().0, None, access);
        for (said, expected) in [
            (Some("Basic cGlsb3Q6d2luZw=="), StatusCode::OK),
            (Some("Basic cGlsb3Q6d2lu"), StatusCode::UNAUTHORIZED),
            (Some("Basic cGlsb3Q6d2luZzE="), StatusCode::UNAUTHORIZED),
            (Some("Basic cGlsb3Q6eGluZw=="), StatusCode::UNAUTHORIZED),
            (Some(""), StatusCode::UNAUTHORIZED),
            (None, StatusCode::UNAUTHORIZED),
        ] {
            for path in ["/", "/state", "/events", "/page.js"] {
                let mut request = Request::builder().uri(path).header(header::HOST, "10.0.0.1:8480");
                if let Some(said) = said {
                    request = request.header(header::AUTHORIZATION, said);
                }
                let answer = page.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
                assert_eq!(answer.status(), expected, "{path}: {said:?}");
            }
        }
    });
}

#[test]
fn what_changes_something_is_taken_of_this_page_alone() {
    run(async {
        let contents = Contents { records: 1, first_us: START, last_us: START + 60_000_000, torn: vec![] };
        let player = Arc::new(Player::new(&contents, START, 1.0));
        let page = router(station().0, Some(Arc::clone(&player)), local());
        for (name, value, expected) in [
            ("origin", "http://localhost:8480", StatusCode::OK),
            ("sec-fetch-site", "same-origin", StatusCode::OK),
            ("sec-fetch-site", "none", StatusCode::OK),
            ("origin", "https://evil.example", StatusCode::FORBIDDEN),
            ("origin", "http://localhost:8480.evil.example", StatusCode::FORBIDDEN),
            ("origin", "null", StatusCode::FORBIDDEN),
            ("sec-fetch-site", "cross-site", StatusCode::FORBIDDEN),
            ("sec-fetch-site", "same-site", StatusCode::FORBIDDEN),
        ] {
            let before = player.changes();
            let request = Request::post("/playback?speed=2").header(header::HOST, "localhost:8480");
            let request = request.header(name, value).body(Body::empty()).unwrap();
            assert_eq!(page.clone().oneshot(request).await.unwrap().status(), expected, "{name}: {value}");
            assert_eq!(player.changes() > before, expected == StatusCode::OK, "{name}: {value}");
        }
    });
}

#[test]
fn a_new_drone_does_not_take_the_place_of_the_shown_one() {
    run(async {
        let (station, changed) = station();
        let page = router(station.clone(), None, local());
        let mut events = ask(&page, Method::GET, "/events", "localhost").await.into_body().into_data_stream();
        let id = |bytes: &[u8]| -> Value {
            let text = std::str::from_utf8(bytes).unwrap();
            let data = text.lines().find_map(|line| line.strip_prefix("data: "));
            serde_json::from_str::<Value>(data.unwrap()).unwrap()["drone"]["id"].clone()
        };
        assert_eq!(id(&events.next().await.unwrap().unwrap()), "3");
        let mut forwarder = Forwarder::new(1, 1, Rates { bytes_per_s: 100_000, period_us: 0, standard_us: 0 });
        forwarder.offer(&Bundle::datagram(profile().as_bytes()).unwrap());
        while let Some(bytes) = forwarder.poll(1_000_000, 0) {
            let carried = Carried { at_us: START, kind: Kind::MavlinkDatagrams, line: 0, from: String::new(), bytes };
            station.known().intake.take(&carried);
        }
        changed.send_modify(|count| *count += 1);
        assert_eq!(id(&events.next().await.unwrap().unwrap()), "3");
        for (query, expected) in [("1-2", "1".into()), ("3-2", "3".into()), ("3-x", Value::Null), ("33", Value::Null)] {
            let state = text(ask(&page, Method::GET, &format!("/state?drone={query}"), "localhost").await).await;
            assert_eq!(serde_json::from_str::<Value>(&state).unwrap()["drone"]["id"], expected, "{query}");
        }
    });
}

#[test]
fn the_state_is_what_was_sent() {
    run(async {
        let page = router(station().0, None, local());
        let state: Value =
            serde_json::from_str(&text(ask(&page, Method::GET, "/state?drone=9", "localhost").await).await).unwrap();
        let drone = &state["drone"];
        assert_eq!(drone["id"], "9");
        let reported = &drone["reported"];
        let position: Vec<f64> = reported["position"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
        assert_eq!(position, [47.497_912_345_678_9, -8.728_9, 470.125]);
        assert_eq!((&reported["age_ms"], &reported["agree"]), (&Value::from(120), &Value::from(2)));
        assert_eq!(reported["state"], "monitoring");
        let pitch = reported["attitude"][0].as_f64().unwrap();
        assert!((pitch - 0.5_f64.to_degrees()).abs() < 1e-5, "{pitch}");
        assert_eq!(reported["acceleration"], Value::Null);
        assert_eq!((&drone["gps"][1]["excluded"], &drone["gps"][2]["valid"]), (&true.into(), &false.into()));
        assert_eq!(drone["gps"][2]["position"][0], Value::Null, "not a number");
        assert_eq!(drone["link"], Value::Null);
        assert_eq!(drone["alarms"][0]["words"], "fewer receivers agree than the drone has, or on no altitude");
        assert_eq!(drone["alarms"].as_array().unwrap().len(), 1);
        assert_eq!(state["drones"].as_array().unwrap().len(), 2);
        assert_eq!((&state["station"]["dropped"], &state["station"]["lines"][0][1]), (&4.into(), &"unplugged".into()));
        assert_eq!(state["playback"], Value::Null);
    });
}

#[test]
fn a_state_is_pushed_at_once_and_then_with_every_change() {
    run(async {
        let (station, changed) = station();
        let page = router(station.clone(), None, local());
        let mut events = ask(&page, Method::GET, "/events?drone=3", "localhost").await.into_body().into_data_stream();
        let state = |bytes: &[u8]| -> Value {
            let text = std::str::from_utf8(bytes).unwrap();
            let data = text.lines().find_map(|line| line.strip_prefix("data: "));
            serde_json::from_str(data.unwrap()).unwrap()
        };
        let first = state(&events.next().await.unwrap().unwrap());
        assert_eq!((&first["drone"]["id"], &first["drone"]["reported"]["age_ms"]), (&"3".into(), &120.into()));
        assert_eq!(first["drones"].as_array().map(Vec::len), Some(2));
        let sample = json!([
            START / 1_000,
            [47.497_912_3, -8.728_9],
            [[47.497_912_3, -8.728_9], [47.497_912_3, -8.728_9], null],
            470.125,
            0.0,
            2
        ]);
        assert_eq!(first["history"], json!([sample]));
        station.known().now_us += 1_000_000;
        changed.send_modify(|count| *count += 1);
        let second = state(&events.next().await.unwrap().unwrap());
        assert_eq!((&second["drone"]["reported"]["age_ms"], &second["drone"]["stale"]), (&1_120.into(), &true.into()));
        assert_eq!(second["drones"], Value::Null, "the list comes each half second");
        assert_eq!(second.get("history"), None, "the history comes once");
        sleep(LIST).await;
        changed.send_modify(|count| *count += 1);
        let third = state(&events.next().await.unwrap().unwrap());
        assert_eq!(third["drones"].as_array().map(Vec::len), Some(2));
        drop(changed);
        assert!(events.next().await.is_none());
    });
}

#[test]
fn one_connection_brings_a_state_for_each_drone_that_is_asked_for() {
    run(async {
        let (station, changed) = station();
        let change = crate::Change { alarm: crate::Alarm::EmergencyFired, raised: true, at_us: START };
        station.known().note(Who::System(9).first(), change);
        let page = router(station.clone(), None, local());
        let path = "/events?drone=9&drone=&drone=9&drone=77";
        let mut events = ask(&page, Method::GET, path, "localhost").await.into_body().into_data_stream();
        for round in 0..3 {
            for (asked, shown) in [("9", json!("9")), ("", json!("3")), ("77", Value::Null)] {
                let bytes = events.next().await.unwrap().unwrap();
                let text = std::str::from_utf8(&bytes).unwrap();
                let state: Value =
                    serde_json::from_str(text.lines().find_map(|line| line.strip_prefix("data: ")).unwrap()).unwrap();
                assert_eq!((&state["asked"], &state["drone"]["id"]), (&json!(asked), &shown), "{round}");
                let whole = round == 0;
                assert_eq!((state["drones"].is_array(), state["log"].is_array()), (whole, whole), "{round}");
                if whole {
                    let words = "HORUS has fired the emergency measure";
                    assert_eq!(state["log"], json!([[START / 1_000, "9", words, true, true]]));
                }
            }
            changed.send_modify(|count| *count += 1);
        }
        for _ in 0..2 * super::super::KEPT_CHANGES {
            station.known().note(Who::System(9).first(), change);
        }
        assert_eq!(station.known().alarms.len(), super::super::KEPT_CHANGES);
    });
}

#[test]
fn a_watcher_beyond_the_limit_is_refused_until_another_leaves() {
    run(async {
        let (station, _changed) = station();
        let page = router(station, None, local());
        let mut watching = vec![];
        for _ in 0..MAX_WATCHERS {
            watching.push(ask(&page, Method::GET, "/events", "localhost").await);
        }
        assert!(watching.iter().all(|answer| answer.status() == StatusCode::OK));
        let refused = ask(&page, Method::GET, "/events", "localhost").await;
        assert_eq!(
            (refused.status(), &refused.headers()[header::RETRY_AFTER]),
            (StatusCode::SERVICE_UNAVAILABLE, &HeaderValue::from_static("5"))
        );
        watching.pop();
        assert_eq!(ask(&page, Method::GET, "/events", "localhost").await.status(), StatusCode::OK);
    });
}

#[test]
fn nothing_can_be_written_but_the_pace_of_a_playback() {
    run(async {
        let live = router(station().0, None, local());
        for path in ["/", "/state", "/events", "/playback?speed=2"] {
            let answer = ask(&live, Method::POST, path, "localhost").await;
            assert!(matches!(answer.status(), StatusCode::METHOD_NOT_ALLOWED | StatusCode::NOT_FOUND), "{path}");
        }
        let contents = Contents { records: 1, first_us: START, last_us: START + 60_000_000, torn: vec![] };
        let player = Arc::new(Player::new(&contents, START, 0.0));
        let page = router(station().0, Some(Arc::clone(&player)), local());
        let set = async |query: &str| {
            let answer = ask(&page, Method::POST, &format!("/playback?{query}"), "localhost").await;
            assert_eq!(answer.status(), StatusCode::OK, "{query}");
            text(answer).await
        };
        assert_eq!(set("at=12.5").await, "1");
        assert_eq!(player.now_us(), START + 12_500_000, "it stands still");
        let state = text(ask(&page, Method::GET, "/state", "localhost").await).await;
        let state: Value = serde_json::from_str(&state).unwrap();
        assert_eq!(state["playback"]["changes"], 1);
        assert_eq!(state["playback"]["at_s"], 12.5);
        assert_eq!(set("at=1e9").await, "2");
        assert_eq!(player.now_us(), START + 60_000_000, "at most its end");
        for bad in ["", "?", "?speed", "?speed=NaN", "?at=inf", "?speed=x", "?volume=2", "?at=%00"] {
            let answer = ask(&page, Method::POST, &format!("/playback{bad}"), "localhost").await;
            assert_eq!(answer.status(), StatusCode::BAD_REQUEST, "{bad}");
        }
        assert_eq!(set("speed=5").await, "3", "what is refused changes nothing");
        assert!((player.speed() - 5.0).abs() < 1e-9);
        assert_eq!(ask(&page, Method::POST, "/playback?speed=2", "example.org").await.status(), StatusCode::FORBIDDEN);
    });
}

#[test]
fn a_command_is_accepted_only_where_commands_are_allowed() {
    run(async {
        let post = async |page: &Router, query: &str| {
            let answer = ask(page, Method::POST, &format!("/hold{query}"), "localhost").await;
            (answer.status(), text(answer).await)
        };
        let signer = || Signer::new(Key::new([1; 32]), 254);
        let (silent, uplinks, allowed) = (station().0, station().0, station().0);
        uplinks.speak(Voice::new(254, Some(signer())).with_uplinks());
        for without in [silent, uplinks] {
            let page = router(without, None, local());
            let (status, _) = post(&page, "?drone=3&command=lock").await;
            assert_eq!(status, StatusCode::NOT_FOUND);
            let state = text(ask(&page, Method::GET, "/state", "localhost").await).await;
            assert!(state.contains(r#""commands":false"#), "{state}");
        }
        allowed.speak(Voice::new(254, Some(signer())).with_commands());
        let page = router(allowed.clone(), None, local());
        let (status, _) = ask(&page, Method::POST, "/uplink?drone=3&payload=01", "localhost").await.into_parts();
        assert_eq!(status.status, StatusCode::NOT_FOUND, "no free payload beside commands");
        for bad in ["", "?drone=3", "?command=lock", "?drone=3&command=open", "?drone=3&command=set-point"] {
            assert_eq!(post(&page, bad).await.0, StatusCode::BAD_REQUEST, "{bad}");
        }
        for value in ["", "x", "NaN", "inf", "1e99"] {
            let query = format!("?drone=3&command=set-point&value={value}");
            assert_eq!(post(&page, &query).await.0, StatusCode::BAD_REQUEST, "{value}");
        }
        assert_eq!(post(&page, "?drone=3&command=lock&value=1").await.0, StatusCode::BAD_REQUEST);
        let none = (StatusCode::CONFLICT, "this drone is not known here".to_owned());
        assert_eq!(post(&page, "?drone=77&command=lock").await, none);
        let none = (StatusCode::CONFLICT, "there is no present Hold-Status of this drone".to_owned());
        assert_eq!(post(&page, "?drone=3&command=lock").await, none);

        {
            let mut known = allowed.known();
            for tenth in 0..=30_u32 {
                let values = HoldValues { temperature: 21.5, ..HoldValues::absent(100 * tenth) };
                let hold = HoldStatus::seal(Writer::<ActiveLoad>::claim(), &values);
                let at_us = START + 120_000 + 100_000 * u64::from(tenth);
                let bundle = Bundle::new(Place::Hold, 1, hold.as_bytes()).unwrap();
                let mut forwarder = Forwarder::new(3, 1, Rates { bytes_per_s: 100_000, period_us: 0, standard_us: 0 });
                forwarder.offer(&bundle);
                let bytes = forwarder.poll(1_000_000, 0).unwrap();
                known.intake.take(&Carried {
                    at_us,
                    kind: Kind::MavlinkDatagrams,
                    line: 0,
                    from: String::new(),
                    bytes,
                });
                known.now_us = at_us;
                let StationData { voice, intake, .. } = &mut *known;
                voice.as_mut().unwrap().tick(at_us, intake.fleet());
            }
        }
        let sent = (StatusCode::ACCEPTED, "1".to_owned());
        assert_eq!(post(&page, "?drone=3&command=set-point&value=-2.5").await, sent);
        let commands = allowed.known().voice.as_mut().unwrap().take_commands();
        assert_eq!(commands[0].command, HoldCommand::SetPoint(-2.5));
        commands.into_iter().for_each(|told| allowed.known().note_command(told));
        let waits = (StatusCode::CONFLICT, "the command before this one is pending".to_owned());
        assert_eq!(post(&page, "?drone=3&command=lock").await, waits);
        let state = text(ask(&page, Method::GET, "/state?drone=3", "localhost").await).await;
        let hold = serde_json::from_str::<Value>(&state).unwrap()["drone"]["hold"].take();
        assert_eq!((&hold["shown"], &hold["values"]["temperature"]), (&json!("valid"), &json!(21.5)));
        assert_eq!((&hold["values"]["humidity"], &hold["commands"][0]["value"]), (&Value::Null, &json!(-2.5)));
        assert_eq!(
            (&hold["commands"][0]["name"], &hold["commands"][0]["state"]),
            (&json!("set-point"), &json!("pending"))
        );
        let state = text(ask(&page, Method::GET, "/state?drone=9", "localhost").await).await;
        let hold = serde_json::from_str::<Value>(&state).unwrap()["drone"]["hold"].take();
        assert_eq!((&hold["shown"], &hold["values"], &hold["commands"]), (&json!("never"), &Value::Null, &json!([])));
    });
}

#[test]
fn a_drone_is_found_by_its_percent_encoded_name() {
    run(async {
        let (station, _changed) = station();
        for (kind, from) in [(Kind::Datagrams, "127.0.0.1:4000"), (Kind::Datagrams, "[::1]:5")] {
            let bytes = profile().as_bytes().to_vec();
            station.known().intake.take(&Carried { at_us: START, kind, line: 0, from: from.into(), bytes });
        }
        let page = router(station, None, local());
        for (query, id) in [("127.0.0.1%3A4000", "127.0.0.1:4000"), ("%5B%3A%3A1%5D%3A5", "[::1]:5"), ("%33", "3")] {
            let path = format!("/events?drone={query}");
            let bytes = ask(&page, Method::GET, &path, "localhost").await.into_body().into_data_stream().next().await;
            let bytes = bytes.unwrap().unwrap();
            let text = std::str::from_utf8(&bytes).unwrap();
            let state: Value =
                serde_json::from_str(text.lines().find_map(|line| line.strip_prefix("data: ")).unwrap()).unwrap();
            assert_eq!((&state["asked"], &state["drone"]["id"]), (&json!(id), &json!(id)));
        }
    });
}

#[test]
fn a_drone_that_is_not_known_is_none() {
    run(async {
        let page = router(station().0, None, local());
        for query in ["?drone=77", "?drone=", "?drone=%FF%00", "?drone=3&drone=9&x"] {
            let state = text(ask(&page, Method::GET, &format!("/state{query}"), "localhost").await).await;
            let state: Value = serde_json::from_str(&state).unwrap();
            let expected = if query.contains("3&") { Value::from("3") } else { Value::Null };
            assert_eq!(state["drone"]["id"], expected, "{query}");
        }
    });
}

#[test]
fn an_uplink_is_accepted_only_from_the_stations_own_page() {
    run(async {
        let post = async |page: &Router, query: &str| {
            let answer = ask(page, Method::POST, &format!("/uplink{query}"), "localhost").await;
            (answer.status(), text(answer).await)
        };
        let (silent, unsigned, allowed) = (station().0, station().0, station().0);
        unsigned.speak(Voice::new(254, None).with_uplinks());
        for without in [&silent, &unsigned] {
            let page = router(without.clone(), None, local());
            let (status, _) = post(&page, "?drone=3&payload=01").await;
            assert!(matches!(status, StatusCode::METHOD_NOT_ALLOWED | StatusCode::NOT_FOUND), "{status}");
            let state = text(ask(&page, Method::GET, "/state", "localhost").await).await;
            assert!(state.contains(r#""uplinks":false"#), "{state}");
        }
        allowed.speak(Voice::new(254, Some(Signer::new(Key::new([1; 32]), 254))).with_uplinks());
        let page = router(allowed.clone(), None, local());
        let whole = "0".repeat(103);
        let bad = ["", "?drone=3", "?payload=01", "?drone=3&payload=", "?drone=3&payload=0", "?drone=3&payload=%30"];
        let worse = ["?drone=3&payload=0g", "?drone=3&payload=01&status=65536", "?drone=3&payload=01&status=x"];
        for bad in bad.into_iter().chain(worse).map(str::to_owned).chain([format!("?drone=3&payload={whole}001")]) {
            assert_eq!(post(&page, &bad).await.0, StatusCode::BAD_REQUEST, "{bad}");
        }
        for none in ["77", "3-2", "%2F3"] {
            let (status, words) = post(&page, &format!("?drone={none}&payload=01")).await;
            assert_eq!((status, words.as_str()), (StatusCode::CONFLICT, "this drone is not known here"));
        }
        let foreign =
            [(header::ORIGIN, "http://example.org"), (HeaderName::from_static("sec-fetch-site"), "cross-site")];
        for (name, value) in foreign {
            let request = axum::http::Request::post("/uplink?drone=3&payload=01").header(header::HOST, "localhost");
            let request = request.header(name, value).body(Body::empty()).unwrap();
            assert_eq!(page.clone().oneshot(request).await.unwrap().status(), StatusCode::FORBIDDEN);
        }
        assert!(allowed.known().voice.as_ref().unwrap().sending(Who::System(3).first()).is_none(), "none was sent");
        let (status, timestamp) = post(&page, "?drone=3&payload=01fF&status=513").await;
        assert_eq!((status, timestamp), (StatusCode::ACCEPTED, ((START + 120_000) / 1_000 % (1 << 32)).to_string()));
        let state = text(ask(&page, Method::GET, "/state?drone=3", "localhost").await).await;
        let uplink = &serde_json::from_str::<Value>(&state).unwrap()["drone"]["uplink"];
        assert_eq!((&uplink["state"], &uplink["status"], &uplink["times"]), (&json!("sent"), &json!(513), &json!(0)));
        assert_eq!(uplink["payload"], format!("01ff{}", "0".repeat(100)));
        let state = text(ask(&page, Method::GET, "/state?drone=9", "localhost").await).await;
        assert_eq!(serde_json::from_str::<Value>(&state).unwrap()["drone"]["uplink"], Value::Null, "of drone 3 alone");
    });
}
