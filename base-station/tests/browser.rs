//! Tests that the page in a real browser shows the data that are sent over UDP.
//!
//! Objects travel as MAVLink over a real socket to the station and the server of `horus-base serve`. Screenshots go to
//! `target/screenshots`. Without a browser the tests are not run, and say so ([`browser::program`]).

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use base_station::carrier::mavlink::tunnel::Tunnel;
use base_station::carrier::mavlink::{Forwarder, Inbound, Key, Rates, Signer, Verifier, Voice, voice};
use base_station::intake::{Carried, Intake, Kind};
use base_station::live::playback::{Player, Recording};
use base_station::live::server::Server;
use base_station::live::{self, Clock, Station, Time, lines, page};
use base_station::recorder::{Files, Recorder};
use base_station::{Bundle, Place};
use browser::{DESK, PHONE, Tab};
use mavlink::{MAVLinkV2MessageRaw, MavHeader};
use profile::criticality::{Dpr, Writer};
use profile::{
    FixType, GpsStatus, GpsValues, HorusState, LinkStatus, LinkStatusBits, LinkValues, PortStatus, PortValues, Profile,
    ReportedStatus, ReportedValues, ResetReason,
};
use serde_json::{Value, json};

#[path = "browser/hold.rs"]
mod hold;

const PERIOD: Duration = Duration::from_millis(50);

const SAYS_OLD_WITHIN: f64 = 500.0;

/// The longest pause, ms, of a script that runs every 10 ms. A longer pause shows that the machine was busy.
const UNDISTURBED: f64 = 60.0;

#[derive(Clone, Copy, Debug)]
struct Sent {
    taken: f64,
    gone: f64,
}

fn now_ms() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs_f64() * 1e3
}

/// Records the time every 10 ms. A gap shows that this process did not run, which makes a measurement invalid.
struct Beats {
    instants: Arc<Mutex<Vec<f64>>>,
}

impl Beats {
    fn begin() -> Self {
        let instants = Arc::new(Mutex::new(vec![]));
        let kept = Arc::downgrade(&instants);
        std::thread::spawn(move || {
            while let Some(instants) = kept.upgrade() {
                instants.lock().unwrap().push(now_ms());
                drop(instants);
                sleep(Duration::from_millis(10));
            }
        });
        Self { instants }
    }

    fn take(&self) -> Vec<f64> {
        std::mem::take(&mut self.instants.lock().unwrap())
    }
}

/// The lock that lets only one browser run at a time, because two would disturb each other's measurements.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn tab(name: &str) -> Option<Tab> {
    let program = browser::program()?;
    Some(Tab::start(&program, &PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("browser").join(name)))
}

fn screenshot(tab: &mut Tab, name: &str) {
    let target = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("../screenshots");
    tab.picture(&target.join(name).with_extension("png"));
}

type Enable = fn(Voice) -> Voice;

struct Scene {
    server: Option<Server>,
    station: Station,
    page: SocketAddr,
    socket: UdpSocket,
    to: SocketAddr,
    forwarder: Forwarder,
    began: Instant,
    sent: u64,
    passed_us: Arc<AtomicU64>,
}

impl Scene {
    fn new(clock: impl FnOnce(Arc<AtomicU64>) -> Clock) -> Self {
        Self::with_key(clock, None)
    }

    /// Starts a station with this clock. With a key, the station accepts only messages that are signed with the key.
    /// The function beside the key enables what the station may send.
    fn with_key(clock: impl FnOnce(Arc<AtomicU64>) -> Clock, key: Option<(Key, Enable)>) -> Self {
        let passed_us = Arc::new(AtomicU64::new(0));
        let clock = clock(Arc::clone(&passed_us));
        let verifier = key.clone().map(|(key, _)| Verifier::new(key));
        let (inlet, station, _) = live::start(verifier, None, Time::Clock(clock.clone()), |_, _| {});
        if let Some((key, enable)) = &key {
            station.speak(enable(Voice::new(voice::SYSTEM, Some(Signer::new(key.clone(), 254)))));
        }
        let local = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let to = lines::udp(local, Kind::MavlinkDatagrams, 0, clock, inlet).unwrap();
        let server = Server::start(station.clone(), local).unwrap();
        let page = server.address();
        let forwarder = Forwarder::new(7, 1, Rates { bytes_per_s: 1_000_000, period_us: 0, standard_us: 0 });
        let forwarder = match key {
            Some((key, _)) => forwarder.signed(Signer::new(key, 1)),
            None => forwarder,
        };
        let socket = UdpSocket::bind(local).unwrap();
        socket.set_nonblocking(true).unwrap();
        let began = Instant::now();
        Self { server: Some(server), station, page, socket, to, forwarder, began, sent: 0, passed_us }
    }

    fn begin() -> Self {
        Self::new(|_| Clock::begin())
    }

    fn address(&self) -> String {
        format!("http://{}/", self.page)
    }

    fn send(&mut self, image: impl FnOnce(u32) -> Vec<u8>) -> Sent {
        let passed = self.began.elapsed();
        self.send_of(passed, image)
    }

    fn send_of(&mut self, passed: Duration, image: impl FnOnce(u32) -> Vec<u8>) -> Sent {
        let taken = now_ms();
        let image = image(70_000 + u32::try_from(passed.as_millis()).unwrap() / 10 * 10);
        self.forwarder.offer(&Bundle::datagram(&image).unwrap());
        let now_us = u64::try_from(passed.as_micros()).unwrap();
        while let Some(message) = self.forwarder.poll(now_us, (now_ms() * 1e3) as u64) {
            self.socket.send_to(&message, self.to).unwrap();
            self.sent += 1;
        }
        Sent { taken, gone: now_ms() }
    }

    fn another(&self, system: u8) -> (Forwarder, UdpSocket) {
        let rates = Rates { bytes_per_s: 1_000_000, period_us: 0, standard_us: 0 };
        (Forwarder::new(system, 1, rates), UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap())
    }

    fn send_by(&self, (forwarder, socket): &mut (Forwarder, UdpSocket), image: impl FnOnce(u32) -> Vec<u8>) {
        let passed = self.began.elapsed();
        let image = image(70_000 + u32::try_from(passed.as_millis()).unwrap() / 10 * 10);
        forwarder.offer(&Bundle::datagram(&image).unwrap());
        while let Some(message) = forwarder.poll(u64::try_from(passed.as_micros()).unwrap(), 0) {
            socket.send_to(&message, self.to).unwrap();
        }
    }

    fn fly_until(&mut self, tab: &mut Tab, wanted: &str) -> Sent {
        let began = Instant::now();
        loop {
            let last = self.send(image);
            sleep(PERIOD);
            if tab.eval(wanted) == Value::Bool(true) {
                return last;
            }
            assert!(began.elapsed() < Duration::from_secs(60), "never: {wanted}\n{}", tab.text("body"));
        }
    }

    fn is_clean(&self, tab: &mut Tab) {
        assert_eq!(tab.troubles(), Vec::<String>::new());
        let requests = tab.requests();
        assert!(requests.iter().any(|request| request.contains("/page.js")), "{requests:?}");
        let here = self.address();
        assert!(requests.iter().all(|request| request.starts_with(&here)), "{requests:?}");
    }
}

const PLACE: (f64, f64, f64) = (-33.456_789_12, -70.648_271_83, 1_234.56);

/// Returns the DPR's image `ms` after HORUS's start. Of three receivers, the second is excluded and the third is
/// silent.
fn image(ms: u32) -> Vec<u8> {
    image_at(ms, PLACE)
}

fn image_at(ms: u32, (latitude, longitude, altitude): (f64, f64, f64)) -> Vec<u8> {
    let status = ReportedStatus::new()
        .with_position_valid(true)
        .with_attitude_valid(true)
        .with_receivers_agreeing(2)
        .with_degraded(true)
        .with_state(HorusState::SwitchedToRedundant)
        .with_memory_fault(true)
        .with_reset_reason(ResetReason::Lockup);
    let (pitch, yaw, roll) = (0.1, 5.9, -0.3);
    let reported =
        ReportedValues { status, latitude, longitude, altitude, pitch, yaw, roll, ..ReportedValues::absent(ms) };
    let status = GpsStatus::new().with_fix_type(FixType::Fix3D).with_position_valid(true).with_heard(true);
    let gps = |north: f64, up: f64, status| {
        let latitude = latitude + north / 110_920.0;
        GpsValues { status, latitude, longitude, altitude: altitude + up, ..GpsValues::absent(ms) }
    };
    let excluded =
        status.with_fix_type(FixType::Fix2D).with_stale(true).with_excluded(true).with_solution_age_ms(Some(2_000));
    let gps =
        [gps(1.5, 0.25, status.with_solution_age_ms(Some(149))), gps(80.0, -3.0, excluded), GpsValues::absent(ms)];
    let link = LinkValues {
        timestamp: ms + 4_321,
        status: LinkStatusBits::new().with_link_up(true).with_reset_reason(ResetReason::Watchdog),
        objects_accepted: 1_234,
        objects_rejected: 56,
        frames_received: 7_890,
        frames_missed: 12,
        access_violations: 3,
        age_100us: 51,
    };
    [LinkStatus::seal(&link).as_bytes(), Profile::<3>::seal(&reported, &gps).as_bytes()].concat()
}

fn table(tab: &mut Tab, id: &str) -> Vec<Vec<String>> {
    let rows = format!(
        "[...document.getElementById('{id}').rows].map((row) => [...row.cells].map((cell) => cell.textContent))"
    );
    serde_json::from_value(tab.eval(&rows)).unwrap()
}

const FRESH: &str = "document.body.className === 'fresh'";
const OLD: &str = "document.body.className === 'old'";

#[test]
fn every_value_shown_is_the_one_that_was_sent() {
    let _alone = alone();
    let Some(mut tab) = tab("values") else { return };
    let mut scene = Scene::begin();
    tab.open(&scene.address());
    scene.fly_until(&mut tab, FRESH);
    let last = scene.fly_until(&mut tab, "document.querySelectorAll('#receivers tr').length === 3");
    let (receivers, accuracy) = (table(&mut tab, "receivers"), tab.text("#accuracy"));
    assert_eq!(tab.text("#verdict"), "HORUS has switched to the redundant flight controller");
    tab.until("document.getElementById('alarms').textContent.includes('the position shown is old')");
    tab.until("document.getElementById('verdict').textContent.endsWith(' · OLD DATA')");

    tab.until("document.getElementById('drone').value === '7'");
    assert!(tab.text("#signed").starts_with("not signed, from 127.0.0.1:"));
    assert_eq!(tab.text("#latitude"), "33.4567891° S");
    assert_eq!(tab.text("#longitude"), "70.6482718° W");
    assert_eq!(tab.text("#height"), "1234.6 m");
    let shown = [0.1_f32, -0.3, 5.9].map(|angle| format!("{:.1}°", angle.to_degrees()));
    assert_eq!(tab.text("#attitude"), shown.join(", "));
    assert_eq!(tab.text("#agree"), "2 of 3, degraded");
    assert_eq!(accuracy, "1 within 1.5 m of it, GPS2 excluded");
    assert!(tab.text("#doing").starts_with("SWITCHED TO REDUNDANT FLIGHT CONTROLLER, "));

    let expected = [
        ["GPS1", "3D", "1.5 m", "1234.8 m"],
        ["GPS2", "2D, stale, EXCLUDED", "80.0 m", "1231.6 m"],
        ["GPS3", "no fix, no position, silent", "–", "–"],
    ];
    for (shown, expected) in receivers.iter().zip(expected) {
        assert_eq!(shown[..4], expected, "{receivers:?}");
    }
    let solutions: Vec<&str> = receivers.iter().map(|row| row[5].as_str()).collect();
    assert_eq!(solutions, ["125 ms", "1550 ms or more", "none yet"]);
    let itself = [["HORUS's last reset", "lockup"], ["HORUS's memory", "FAULT FOUND"]];
    assert_eq!(table(&mut tab, "itself"), itself);
    let link: Vec<(String, String)> =
        table(&mut tab, "link").into_iter().map(|row| (row[0].clone(), row[1].clone())).collect();
    let expected = [
        ("State", "up"),
        ("Age of the sample at the DPR", "5.1 ms"),
        ("Frames received, missed", "7890, 12"),
        ("Objects accepted, rejected", "1234, 56"),
        ("Access violations", "3"),
        ("DPR's last reset", "watchdog"),
    ];
    for (shown, expected) in link.iter().zip(expected) {
        assert_eq!((shown.0.as_str(), shown.1.as_str()), expected, "{link:?}");
    }
    let counts = table(&mut tab, "counts");
    assert_eq!(counts[0], ["Messages".to_owned(), scene.sent.to_string()]);
    assert_eq!(counts[2], ["Bad CRC", "0"]);
    let alarms = tab.text("#alarms");
    for words in [
        "HORUS has switched to the redundant flight controller",
        "HORUS has found a fault of its memory",
        "HORUS was reset by a fault",
        "fewer receivers agree",
    ] {
        assert!(alarms.contains(words), "{words}: {alarms}");
    }

    let before = now_ms() - last.gone;
    let read = "[document.getElementById('age-value').textContent, \
                ...[...document.getElementById('receivers').rows].map((row) => row.cells[4].textContent), \
                document.getElementById('link').rows[6].cells[1].textContent.split(',')[0]]";
    let ages: Vec<String> = serde_json::from_value(tab.eval(read)).unwrap();
    let after = now_ms() - last.taken;
    for age in &ages {
        let ms = age.strip_suffix(" s").and_then(|age| age.parse::<f64>().ok()).unwrap() * 1e3;
        // On a busy machine the displayed age may lag by two states and one frame of the screen.
        assert!((before - 250.0..=after + 50.0).contains(&ms), "{ages:?}, {before} to {after} ms");
    }
    scene.is_clean(&mut tab);
}

#[test]
fn the_page_marks_data_as_old_within_half_a_second() {
    let _alone = alone();
    let Some(mut tab) = tab("stale") else { return };
    let mut scene = Scene::begin();
    tab.open(&scene.address());
    // A script records the time every 10 ms, and each instant at which the verdict changes.
    tab.eval(
        "window.turns = []; window.beats = [];
        new MutationObserver(() => turns.push([Date.now(), document.body.className]))
            .observe(document.body, { attributes: true, attributeFilter: ['class'] });
        setInterval(() => beats.push(Date.now()), 10); true",
    );
    let own = Beats::begin();
    let (mut took, mut disturbed) = (vec![], vec![]);
    while took.len() < 3 {
        let last = scene.fly_until(&mut tab, FRESH);
        tab.until(OLD);
        let verdict = tab.text("#verdict");
        let at = tab.eval("turns.findLast((change) => change[1] === 'old')[0]").as_f64().unwrap();
        let beats: Vec<f64> = serde_json::from_value(tab.eval("beats.splice(0)")).unwrap();
        let longest = |beats: Vec<f64>| {
            let beats = beats.into_iter().filter(|beat| (last.taken - 50.0..=at).contains(beat)).chain([at]);
            let beats: Vec<f64> = beats.collect();
            beats.windows(2).map(|beats| beats[1] - beats[0]).fold(0.0, f64::max)
        };
        // The measurement is not valid if other work kept the browser or the base station from running.
        if longest(beats) <= UNDISTURBED && longest(own.take()) <= UNDISTURBED {
            let turns = tab.eval("turns");
            assert!(verdict.ends_with("OLD DATA"), "{verdict}, sent {last:?}, old at {at}; {turns}");
            took.push((at - last.taken, at - last.gone));
        } else {
            disturbed.push(at - last.gone);
        }
        assert!(disturbed.len() < 60, "this machine lets the browser run too seldom: {disturbed:?}");
    }
    println!("old after {took:?} ms; where the machine did not let the browser or the station run, {disturbed:?}");
    assert!(took.iter().all(|(_, since_gone)| *since_gone <= SAYS_OLD_WITHIN), "{took:?}");
    // Timestamps are those of cycles, so the last sample may be 10 ms older. `Date.now()` returns whole milliseconds.
    assert!(took.iter().all(|(since_taken, _)| *since_taken >= 400.0 - 10.0 - 1.0), "{took:?}");
    screenshot(&mut tab, "stale");
    // A state that arrives 200 ms late must not make its data look younger.
    let held_up = "(() => {
            const drone = { ...state.drone, reported: { ...state.drone.reported } };
            drone.reported.age_ms -= 200;
            const late = { ...state, drone, now_us: state.now_us - 200000 };
            const [changed, age] = [turns.length, drone.reported.age_ms];
            source.onmessage({ data: JSON.stringify(late) });
            drawAge();
            return [age, turns.length - changed, document.body.className];
        })()";
    scene.fly_until(&mut tab, FRESH);
    tab.until(OLD);
    let (age, changed, class): (f64, u32, String) = serde_json::from_value(tab.eval(held_up)).unwrap();
    assert!((100.0..400.0).contains(&age), "{age} ms");
    assert_eq!((changed, class.as_str()), (0, "old"));
    scene.is_clean(&mut tab);
}

#[test]
fn a_page_that_lost_its_station_reconnects_by_itself() {
    let _alone = alone();
    let Some(mut tab) = tab("reconnect") else { return };
    let mut scene = Scene::begin();
    tab.open(&scene.address());
    scene.fly_until(&mut tab, FRESH);
    scene.is_clean(&mut tab);
    let loaded = tab.eval("performance.timeOrigin");
    drop(scene.server.take());
    tab.until("document.body.className === 'lost'");
    assert_eq!(tab.text("#verdict"), "NO CONNECTION TO THE BASE STATION");
    sleep(Duration::from_millis(1_500));
    scene.server = Some(Server::start(scene.station.clone(), scene.page).unwrap());
    scene.fly_until(&mut tab, FRESH);
    assert_eq!(tab.eval("performance.timeOrigin"), loaded, "it was not loaded anew");
    let troubles = tab.troubles();
    let network = |trouble: &String| trouble.starts_with("network: ") && trouble.contains("/events");
    assert!(troubles.iter().all(network), "{troubles:?}");
}

#[test]
fn a_page_that_is_opened_late_shows_the_last_minutes() {
    let _alone = alone();
    let Some(mut tab) = tab("late") else { return };
    let mut scene = Scene::new(Clock::told);
    for cycle in 0..=1_800_u32 {
        let passed = Duration::from_millis(u64::from(cycle) * 100);
        scene.passed_us.store(u64::try_from(passed.as_micros()).unwrap(), Ordering::Relaxed);
        let flown = f64::from(cycle) / 1_800.0;
        let place = (47.0 + 900.0 * flown / 111_180.0, 8.5, 400.0 + 45.0 * flown);
        scene.send_of(passed, |ms| image_at(ms, place));
        let arrived = || scene.station.known().intake.fleet().iter().map(|(_, drone)| drone.counts().messages).sum();
        let began = Instant::now();
        while scene.sent > arrived() {
            assert!(began.elapsed() < Duration::from_secs(10), "{} sent, {} arrived", scene.sent, arrived());
            std::thread::yield_now();
        }
    }
    tab.open(&scene.address());
    tab.until("document.getElementById('plot-height').getAttribute('aria-label').includes('last 180 s')");
    let label = |tab: &mut Tab, id: &str| {
        tab.eval(&format!("document.getElementById('{id}').getAttribute('aria-label')")).as_str().unwrap().to_owned()
    };
    assert_eq!(label(&mut tab, "plot-height"), "Height: 400.0 to 445.0 m, last 180 s");
    let map = label(&mut tab, "map");
    let north = map.split(' ').zip(map.split(' ').skip(3)).find(|(_, to)| *to == "south").map(|(metres, _)| metres);
    assert!(north.is_some_and(|metres| (899..=901).contains(&metres.parse().unwrap())), "{map}");
    assert!((181..=183).contains(&tab.eval("history.length").as_u64().unwrap()));
    scene.is_clean(&mut tab);
}

#[test]
fn the_page_is_readable_on_each_screen_in_light_and_dark() {
    let _alone = alone();
    let Some(mut tab) = tab("looks") else { return };
    let mut scene = Scene::begin();
    tab.open(&scene.address());
    // The test computes luminance and contrast by WCAG 2.2. The background is the nearest one that is not transparent.
    let contrast = "window.contrast = (selector) => {
        const parts = (colour) => colour.match(/[\\d.]+/g).map(Number);
        const luminance = (colour) => {
            const [r, g, b] = parts(colour).slice(0, 3).map((value) => value / 255)
                .map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4));
            return 0.2126 * r + 0.7152 * g + 0.0722 * b;
        };
        const element = document.querySelector(selector);
        let behind = element;
        while (parts(getComputedStyle(behind).backgroundColor)[3] === 0) behind = behind.parentElement;
        const one = luminance(getComputedStyle(element).color);
        const other = luminance(getComputedStyle(behind).backgroundColor);
        return (Math.max(one, other) + 0.05) / (Math.min(one, other) + 0.05);
    }; true";
    tab.eval(contrast);
    let mut grounds = vec![];
    for (screen, name) in [(DESK, "desk"), (PHONE, "phone")] {
        tab.screen(screen);
        for scheme in ["light", "dark"] {
            tab.scheme(scheme);
            let seen = format!("matchMedia('(prefers-color-scheme: {scheme})').matches");
            scene.fly_until(
                &mut tab,
                &format!(
                    "{FRESH} && {seen} && !!document.querySelector('.legend span') && contrast('.legend span') >= 4.5"
                ),
            );
            grounds.push(tab.eval("getComputedStyle(document.body).backgroundColor"));
            for selector in
                ["h1", "h2", "#verdict", "#age-value", "#latitude", "th", "td.bad", "#alarms li", ".legend span"]
            {
                let found = tab.eval(&format!("contrast({})", json!(selector))).as_f64().unwrap();
                assert!(found >= 4.5, "{selector}, {scheme}: {found}");
            }
            let wide =
                tab.eval("[document.documentElement.scrollWidth, document.documentElement.clientWidth, innerWidth]");
            assert_eq!(wide[0], wide[1], "{name}, {scheme}");
            assert_eq!(wide[2], screen.width);
            scene.send(image);
            screenshot(&mut tab, &format!("{name}-{scheme}"));
            tab.until(OLD);
            let found = tab.eval("contrast('#verdict')").as_f64().unwrap();
            assert!(found >= 4.5, "old, {scheme}: {found}");
        }
    }
    assert_eq!((&grounds[0], &grounds[1]), (&grounds[2], &grounds[3]));
    assert_ne!(grounds[0], grounds[1]);
    scene.is_clean(&mut tab);
}

#[test]
fn the_page_can_be_used_by_keyboard_and_says_what_it_shows() {
    let _alone = alone();
    let Some(mut tab) = tab("keyboard") else { return };
    let mut scene = Scene::begin();
    let mut other = Forwarder::new(9, 1, Rates { bytes_per_s: 1_000_000, period_us: 0, standard_us: 0 });
    other.offer(&Bundle::datagram(&image_at(50_000, (10.0, 20.0, 30.0))).unwrap());
    while let Some(message) = other.poll(1_000_000, 0) {
        scene.socket.send_to(&message, scene.to).unwrap();
    }
    tab.open(&scene.address());
    scene.fly_until(&mut tab, "document.getElementById('drone').options.length === 2");
    let focused = "document.activeElement.id || document.activeElement.className";
    let mut order = vec![];
    while order.len() < 8 {
        tab.press("Tab");
        order.push(tab.eval(focused).as_str().unwrap_or_default().to_owned());
        // The second drone is silent by now, so the page may have a button to acknowledge the alarm about it.
        order.retain(|id| id != "acknowledge");
    }
    // The three empty names are elements without an id: the list of changes, and two drones in the list of all drones.
    assert_eq!(order, ["drone", "sound", "notify", "live-keys", "", "", "", "scroll"]);
    assert_eq!(tab.eval("getComputedStyle(document.activeElement).outlineStyle"), "solid", "the focus is seen");
    tab.eval("document.getElementById('drone').focus()");
    tab.press("ArrowDown");
    tab.until("document.getElementById('drone').value === '9'");
    tab.until("document.getElementById('latitude').textContent === '10.0000000° N'");
    tab.eval("document.activeElement.blur()");
    tab.press("n");
    tab.until("document.getElementById('drone').value === '7'");
    tab.press("b");
    tab.until("document.getElementById('drone').value === '9'");
    tab.press("w");
    tab.until("document.getElementById('drone').value === '7'");
    tab.eval("document.getElementById('live-keys').click()");
    tab.press("n");
    scene.fly_until(&mut tab, FRESH);
    assert_eq!(tab.eval("document.getElementById('drone').value"), "7");

    let spoken = tab.spoken();
    let says = |role: &str, name: &str| spoken.iter().any(|(is, called)| is == role && called == name);
    for (role, name) in [
        ("heading", "HORUS"),
        ("combobox", "Drone"),
        ("region", "What is worst"),
        ("region", "All drones"),
        ("button", "9"),
        ("region", "Alarms"),
        ("table", "Reported-Position"),
        ("region", "Receivers"),
        ("table", "Link-Status"),
        ("table", "Counters"),
        ("rowheader", "Latitude"),
        ("columnheader", "Off by"),
    ] {
        assert!(says(role, name), "no {role} \"{name}\" in {spoken:?}");
    }
    for role in ["status", "main"] {
        assert!(spoken.iter().any(|(is, _)| is == role), "no {role} in {spoken:?}");
    }
    let pictures = spoken.iter().filter(|(role, _)| role == "image" || role == "img");
    assert!(pictures.clone().count() == 4 && pictures.clone().all(|(_, name)| !name.is_empty()), "{spoken:?}");
    scene.is_clean(&mut tab);
}

fn well(ms: u32, change: impl FnOnce(&mut ReportedValues, &mut [GpsValues; 3])) -> Vec<u8> {
    let (latitude, longitude, altitude) = PLACE;
    let latitude = latitude + f64::from(ms) * 1e-2 / 110_920.0;
    let status = ReportedStatus::new()
        .with_position_valid(true)
        .with_attitude_valid(true)
        .with_receivers_agreeing(3)
        .with_state(HorusState::Monitoring);
    let (pitch, yaw, roll) = (0.1, 5.9, -0.3);
    let absent = ReportedValues::absent(ms);
    let mut reported = ReportedValues { status, latitude, longitude, altitude, pitch, yaw, roll, ..absent };
    let status = GpsStatus::new().with_fix_type(FixType::Fix3D).with_position_valid(true).with_heard(true);
    let mut gps = [0.0, 1.0, 2.0].map(|north| {
        let latitude = latitude + north / 110_920.0;
        GpsValues { status, latitude, longitude, altitude, ..GpsValues::absent(ms) }
    });
    change(&mut reported, &mut gps);
    let status = LinkStatusBits::new().with_link_up(true).with_all_accepted(true);
    let link = LinkValues { timestamp: ms + 4_321, status, age_100us: 51, ..LinkValues::default() };
    [LinkStatus::seal(&link).as_bytes(), Profile::<3>::seal(&reported, &gps).as_bytes()].concat()
}

type Change = fn(&mut ReportedValues, &mut [GpsValues; 3]);

/// The longest time from the first message of a fault until the page reports the fault.
const SAYS_WITHIN: Duration = Duration::from_secs(2);

/// Calls `send` until the verdict on the page begins with `said` and the page has the class `level`, within
/// [`SAYS_WITHIN`]. Then takes screenshots on a desk and on a phone, in light and in dark.
fn shows(tab: &mut Tab, name: &str, said: &str, level: &str, mut send: impl FnMut()) {
    let wanted = format!(
        "document.getElementById('verdict').textContent.startsWith({}) && document.body.dataset.level === '{level}'",
        json!(said)
    );
    let (mut began, mut retried) = (Instant::now(), 0);
    let mut before = Instant::now();
    loop {
        send();
        if before.elapsed() > Duration::from_millis(500) && retried < 20 {
            (began, retried) = (Instant::now(), retried + 1);
        }
        before = Instant::now();
        if tab.eval(&wanted) == Value::Bool(true) {
            break;
        }
        let verdict = tab.text("body");
        assert!(began.elapsed() < SAYS_WITHIN, "{name}: {}", verdict.chars().take(500).collect::<String>());
        sleep(PERIOD);
    }
    let wide = browser::Screen { width: 1_200, ..DESK };
    for (screen, place) in [(wide, "1200"), (PHONE, "390")] {
        tab.screen(screen);
        for scheme in ["light", "dark"] {
            tab.scheme(scheme);
            for _ in 0..8 {
                send();
                sleep(PERIOD);
            }
            assert_eq!(tab.eval(&wanted), true, "{name}, {place}, {scheme}: {}", tab.text("#verdict"));
            let over = tab.eval("document.documentElement.scrollWidth - document.documentElement.clientWidth");
            assert_eq!(over, 0, "{name}, {place}");
            screenshot(tab, &format!("{name}-{place}-{scheme}"));
        }
    }
}

#[test]
fn what_is_wrong_is_said_first_and_nothing_of_it_is_green() {
    let _alone = alone();
    let Some(mut tab) = tab("wrong") else { return };
    let scenes: [(&str, &str, Change); 5] = [
        ("emergency", "HORUS has fired the emergency measure", |reported, _| {
            reported.status = reported.status.with_state(HorusState::EmergencyFired);
        }),
        ("invalid", "no position: too few receivers agree", |reported, _| {
            // The image has numbers for an invalid position. The page must not show these numbers.
            reported.status = reported.status.with_position_valid(false).with_receivers_agreeing(1);
        }),
        ("position-lost", "HORUS has lost its position and does not monitor", |reported, _| {
            let status = reported.status.with_state(HorusState::PositionLost).with_receivers_agreeing(0);
            reported.status = status.with_position_valid(false);
        }),
        ("impossible", "no position: what HORUS calls valid cannot be one", |reported, _| {
            reported.latitude = 91.0;
        }),
        ("unknown-state", "HORUS is in a state that this station does not know", |reported, _| {
            reported.status = ReportedStatus::from_bits(reported.status.bits() | 0x0F00);
        }),
    ];
    let mut scene = Scene::begin();
    tab.open(&scene.address());
    for (name, said, change) in scenes {
        shows(&mut tab, &format!("{name}-before"), "live", "well", || _ = scene.send(|ms| well(ms, |_, _| {})));
        shows(&mut tab, name, said, "critical", || _ = scene.send(|ms| well(ms, change)));
        // A screenshot takes so long that the drone seems silent afterwards, so messages are sent until the title shows
        // the fault again.
        let told = format!("document.title.startsWith('!! 7: ' + {})", json!(said));
        let mut sent = 0;
        while tab.eval(&told) != Value::Bool(true) {
            scene.send(|ms| well(ms, change));
            sleep(PERIOD);
            sent += 1;
            assert!(sent < 100, "{}", tab.eval("document.title"));
        }
        let doing = tab.text("#doing");
        let has_none = said.starts_with("no position") || said.contains("lost its position");
        assert_eq!(doing.contains("from the start"), !has_none, "{doing}");
        if has_none {
            assert_eq!((tab.text("#latitude"), tab.text("#height")), ("–".into(), "–".into()));
        }
    }
    scene.is_clean(&mut tab);
}

#[test]
fn old_receivers_and_link_are_marked_beside_a_new_position() {
    let _alone = alone();
    let Some(mut tab) = tab("old-receivers") else { return };
    let mut scene = Scene::begin();
    tab.open(&scene.address());
    shows(&mut tab, "old-before", "live", "well", || _ = scene.send(|ms| well(ms, |_, _| {})));
    let reported = |ms| well(ms, |_, _| {})[32..96].to_vec();
    let alone = Tunnel::of(&Bundle::new(Place::Reported, 1, &reported(0)).unwrap()).unwrap().payload_type;
    assert_eq!(alone, 0xC800);
    shows(&mut tab, "receivers-old", "what is shown of the receivers is old", "warning", || {
        let ms = 70_000 + u32::try_from(scene.began.elapsed().as_millis()).unwrap() / 10 * 10;
        let tunnel = Tunnel::of(&Bundle::new(Place::Reported, 1, &reported(ms)).unwrap()).unwrap();
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message_data(MavHeader { system_id: 7, component_id: 1, sequence: 0 }, &tunnel);
        scene.socket.send_to(raw.raw_bytes(), scene.to).unwrap();
    });
    let receivers = table(&mut tab, "receivers");
    assert!(receivers.iter().all(|row| row[1].starts_with("OLD DATA") && row[2] == "–"), "{receivers:?}");
    assert!(table(&mut tab, "link")[6][1].ends_with(", OLD DATA"));
    assert_eq!(tab.text("#accuracy"), "none counts");
    scene.is_clean(&mut tab);
}

#[test]
fn two_senders_are_two_drones_and_each_says_that_there_is_another() {
    let _alone = alone();
    let Some(mut tab) = tab("two-senders") else { return };
    let mut scene = Scene::begin();
    let mut other = scene.another(7);
    tab.open(&scene.address());
    shows(&mut tab, "two-before", "live", "well", || _ = scene.send(|ms| well(ms, |_, _| {})));
    let words = "two senders speak as this drone";
    shows(&mut tab, "two-senders", words, "critical", || {
        scene.send(|ms| well(ms, |_, _| {}));
        scene.send_by(&mut other, |ms| {
            well(ms + 600_000, |reported, _| {
                reported.status = reported.status.with_state(HorusState::EmergencyFired);
            })
        });
    });
    let fleet = table(&mut tab, "fleet");
    assert_eq!(fleet.iter().map(|row| row[0].as_str()).collect::<Vec<_>>(), ["7", "7-2"]);
    assert!(fleet[1][1].starts_with("HORUS has fired the emergency measure, and"), "{fleet:?}");
    tab.until("document.title.startsWith('!! 7-2: HORUS has fired the emergency measure')");
    assert_eq!(tab.text("#other"), "7-2: HORUS has fired the emergency measure");
    scene.is_clean(&mut tab);
}

#[test]
fn eight_drones_are_seen_with_the_worst_in_the_title() {
    let _alone = alone();
    let Some(mut tab) = tab("fleet") else { return };
    let mut scene = Scene::begin();
    let mut others: Vec<_> = (8..15).map(|system| scene.another(system)).collect();
    tab.open(&scene.address());
    let mut said = |scene: &mut Scene| {
        scene.send(|ms| well(ms, |_, _| {}));
        for (index, other) in others.iter_mut().enumerate() {
            scene.send_by(other, |ms| {
                well(ms, |reported, gps| {
                    let away = 0.000_3 * (index as f64 + 1.0);
                    reported.longitude += away;
                    gps.iter_mut().for_each(|gps| gps.longitude += away);
                    if index == 3 {
                        reported.status = reported.status.with_state(HorusState::EmergencyFired);
                    }
                    if index == 5 {
                        reported.status = reported.status.with_degraded(true);
                    }
                })
            });
        }
    };
    said(&mut scene);
    shows(&mut tab, "eight-drones", "live", "well", || said(&mut scene));
    let title = "document.title === '!! 11: HORUS has fired the emergency measure – HORUS'";
    tab.until(title);
    assert_eq!(
        tab.text("#other"),
        "11: HORUS has fired the emergency measure",
        "the box names the drone that is worse"
    );
    said(&mut scene);
    sleep(page::LIST);
    said(&mut scene);
    sleep(PERIOD);
    let fleet = table(&mut tab, "fleet");
    assert_eq!(
        fleet.iter().map(|row| row[0].as_str()).collect::<Vec<_>>(),
        ["7", "8", "9", "10", "11", "12", "13", "14"]
    );
    let of = |id: &str| fleet.iter().find(|row| row[0] == id).unwrap()[1].clone();
    assert!(of("11").starts_with("HORUS has fired the emergency measure"), "{fleet:?}");
    assert!(of("13").contains("fewer receivers agree") || of("13").contains("old"), "{fleet:?}");
    assert_eq!(tab.eval("new URLSearchParams(location.search).get('drone')"), "7");
    let mut early = scene.another(1);
    scene.send_by(&mut early, |ms| well(ms, |_, _| {}));
    tab.until("document.getElementById('fleet').rows.length === 9");
    assert_eq!(tab.eval("document.getElementById('drone').value"), "7");
    scene.is_clean(&mut tab);
}

#[test]
fn more_tabs_than_a_browser_has_connections_show_the_drone() {
    let _alone = alone();
    let Some(mut tab) = tab("tabs") else { return };
    let mut scene = Scene::begin();
    tab.open(&scene.address());
    scene.fly_until(&mut tab, FRESH);
    tab.eval("window.tabs = []; true");
    // Nine tabs are opened, more than the six connections that browsers allow to one host.
    for count in 1..=9 {
        let expression = "tabs.push(window.open(location.href, '_blank'))";
        let opened = json!({ "expression": expression, "userGesture": true, "returnByValue": true });
        assert_eq!(tab.command("Runtime.evaluate", opened)["result"]["value"], count);
    }
    // A tab in the background draws nothing, but still reports the age of its data.
    let fresh = "tabs.every((tab) => tab && tab.document.body && tab.document.body.className === 'fresh')";
    scene.fly_until(&mut tab, fresh);
    scene.fly_until(&mut tab, FRESH);
    scene.is_clean(&mut tab);
}

#[test]
fn a_new_critical_alarm_sounds_until_it_is_acknowledged() {
    let _alone = alone();
    let Some(mut tab) = tab("acknowledge") else { return };
    let mut scene = Scene::begin();
    let emergency: Change = |reported, _| reported.status = reported.status.with_state(HorusState::EmergencyFired);
    let fly = |scene: &mut Scene, tab: &mut Tab, change: Change, wanted: &str| {
        let began = Instant::now();
        while tab.eval(wanted) != Value::Bool(true) {
            scene.send(|ms| well(ms, change));
            sleep(PERIOD);
            assert!(began.elapsed() < Duration::from_secs(30), "never: {wanted}\n{}", tab.text("body"));
        }
    };
    tab.open(&scene.address());
    fly(&mut scene, &mut tab, |_, _| {}, "document.body.dataset.level === 'well' && acknowledged !== null");
    let button = "document.getElementById('acknowledge')";
    // A browser plays sound only after an action of the user.
    tab.eval("document.getElementById('sound').focus()");
    tab.press("Space");
    assert_eq!(tab.eval("document.getElementById('sound').checked"), true);
    fly(&mut scene, &mut tab, emergency, &format!("sounds > 1 && {button}.textContent === 'Acknowledge 1'"));
    tab.press("a");
    tab.until(&format!("{button}.disabled && {button}.textContent === 'Acknowledge'"));
    let sounds = tab.eval("sounds");
    let later = "performance.now() - sounded > 2 * SOUND_MS";
    fly(&mut scene, &mut tab, emergency, later);
    assert_eq!(tab.eval("sounds"), sounds, "it is acknowledged");
    let first = "document.getElementById('log').firstChild.textContent";
    let words = tab.eval(first);
    assert!(words.as_str().unwrap().ends_with("7: HORUS has fired the emergency measure"), "{words}");
    assert!(tab.text("#verdict").starts_with("HORUS has fired"), "it is still the worst");
    fly(&mut scene, &mut tab, |_, _| {}, &format!("{first}.endsWith('measure – over')"));
    fly(&mut scene, &mut tab, emergency, &format!("{button}.textContent === 'Acknowledge 1'"));
    scene.is_clean(&mut tab);
}

#[test]
fn the_page_shows_an_uplink_as_sent_and_then_as_written() {
    let _alone = alone();
    let Some(mut tab) = tab("uplink") else { return };
    let key = Key::new([3; 32]);
    let mut scene = Scene::with_key(|_| Clock::begin(), Some((key.clone(), Voice::with_uplinks)));
    let mut inbound = Inbound::new(7, Verifier::new(key));
    let mut stored = [0; 64];
    tab.open(&scene.address());
    scene.fly_until(&mut tab, FRESH);
    assert_eq!(tab.text("#signed").split(',').next(), Some("signed"));
    assert_eq!(
        (tab.eval("document.getElementById('uplink-section').hidden"), tab.text("#uplink-state")),
        (false.into(), "none sent".into())
    );
    tab.eval(
        "document.getElementById('uplink-payload').value = '0102fF'; document.getElementById('uplink-send').click()",
    );
    scene.fly_until(&mut tab, "document.getElementById('uplink-state').textContent.startsWith('SENT')");
    let began = Instant::now();
    while !tab.text("#uplink-state").starts_with("WRITTEN") {
        let mut bytes = [0; 512];
        let now_us = scene.began.elapsed().as_micros() as u64;
        while let Ok(length) = scene.socket.recv(&mut bytes) {
            if let Some(uplink) = inbound.datagram(now_us, (now_ms() * 1e3) as u64, &bytes[..length]) {
                stored = *uplink.as_bytes();
            }
        }
        let timestamp = 70_000 + scene.began.elapsed().as_millis() as u32;
        let values = PortValues { timestamp, uplinks_accepted: 1, ..PortValues::default() };
        let port = [PortStatus::seal(Writer::<Dpr>::claim(), &values).as_bytes().as_slice(), &stored].concat();
        if inbound.read(now_us, &port) {
            scene.forwarder.offer(&Bundle::new(Place::PortStatus, 2, &port).unwrap());
        }
        scene.send(image);
        sleep(PERIOD);
        assert!(began.elapsed() < Duration::from_secs(20), "{}", tab.text("#uplink-section"));
    }
    assert_eq!(stored[8..12], [1, 2, 255, 0]);
    let rows = table(&mut tab, "uplink");
    assert_eq!((rows[3][1].as_str(), rows[4][1].as_str()), ("0102ff", "1"), "{rows:?}");
    screenshot(&mut tab, "uplink-written");
    scene.is_clean(&mut tab);
}

#[test]
fn refused_messages_are_said_where_nothing_is_shown() {
    let _alone = alone();
    let Some(mut tab) = tab("refused") else { return };
    let scene = Scene::begin();
    tab.open(&scene.address());
    tab.until("document.getElementById('verdict').textContent === 'no drone heard yet'");
    let mut forwarder = scene.another(7);
    forwarder.0.offer(&Bundle::datagram(&image(70_000)).unwrap());
    let mut damaged = forwarder.0.poll(1_000_000, 0).unwrap();
    damaged[20] ^= 1;
    scene.socket.send_to(&damaged, scene.to).unwrap();
    scene.socket.send_to(&[0xFE; 40], scene.to).unwrap();
    scene.socket.send_to(&[0; 9_000], scene.to).unwrap();
    tab.until(
        "document.getElementById('doing').textContent.startsWith('refused: 1 TUNNEL damaged on the way; 1 MAVLink 1')",
    );
    assert!(tab.text("#doing").contains("1 longer than any datagram"), "{}", tab.text("#doing"));
}

#[test]
fn one_place_far_off_does_not_set_the_scale_of_the_map() {
    let _alone = alone();
    let Some(mut tab) = tab("outlier") else { return };
    let mut scene = Scene::begin();
    tab.open(&scene.address());
    let mut count = 0;
    let far = |reported: &mut ReportedValues, _: &mut [GpsValues; 3]| reported.latitude = 45.0;
    scene.fly_until(&mut tab, FRESH);
    while tab.eval("history.filter((point) => point.voted && point.voted[0] > 0).length > 0") != Value::Bool(true) {
        scene.send(|ms| well(ms, far));
        sleep(PERIOD);
        count += 1;
        assert!(count < 200);
    }
    let near = "(() => { const label = document.getElementById('map').getAttribute('aria-label'); \
                return Number(label.match(/(\\d+) m from south/)[1]) < 10000; })()";
    let mut sent = 0;
    while tab.eval(near) != Value::Bool(true) {
        scene.send(|ms| well(ms, |_, _| {}));
        sleep(PERIOD);
        sent += 1;
        assert!(sent < 200, "{}", tab.eval("document.getElementById('map').getAttribute('aria-label')"));
    }
}

const RECORDED: u64 = 1_790_000_000_000_000;

fn record(path: PathBuf, seconds: u32) -> Recording {
    let mut recorder = Recorder::new(Files::new(path.clone()));
    let mut intake = Intake::default();
    for cycle in 0..=seconds * 10 {
        let at_us = RECORDED + u64::from(cycle) * 100_000;
        let bytes = image(70_000 + cycle * 100);
        let carried = Carried { at_us, kind: Kind::Datagrams, line: 0, from: "127.0.0.1:4000".into(), bytes };
        let judged = intake.take(&carried);
        recorder.carried(&carried, &judged, &[]);
    }
    recorder.finish().unwrap();
    Recording::new(vec![path])
}

#[test]
fn a_playback_can_be_controlled_by_keyboard_alone() {
    let _alone = alone();
    let Some(mut tab) = tab("playback") else { return };
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("playback");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let recording = record(folder.join("flight.mcap"), 600);
    let contents = recording.contents(|_| {}).unwrap();
    assert_eq!(contents.last_us, RECORDED + 600_000_000);
    let player = Arc::new(Player::new(&contents, RECORDED + 100_000_000, 3.0));
    let (inlet, station, _) = live::start(None, None, Time::Playback(Arc::clone(&player)), |_, _| {});
    let fed = Arc::clone(&player);
    std::thread::spawn(move || fed.play(&recording, &inlet).unwrap());
    let shown = Arc::clone(&player);
    let local = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let server = Server::of(local, |address| page::router(station, Some(shown), address)).unwrap();
    let at_s = || (player.now_us() - RECORDED) as f64 / 1e6;
    let until = |tab: &mut Tab, id: &str, words: &str| {
        tab.until(&format!("document.getElementById('{id}').textContent === '{words}'"));
    };

    tab.open(&format!("http://{}/", server.address()));
    until(&mut tab, "pause", "Pause");
    tab.until("document.getElementById('speed').value === '3'");

    // The page never displays played-back data in green, and never announces them as present.
    tab.until("document.getElementById('verdict').textContent.startsWith('PLAYBACK · ')");
    for (screen, place) in [(browser::Screen { width: 1_200, ..DESK }, "1200"), (PHONE, "390")] {
        tab.screen(screen);
        for scheme in ["light", "dark"] {
            tab.scheme(scheme);
            tab.until("document.getElementById('verdict').textContent.startsWith('PLAYBACK · ')");
            screenshot(&mut tab, &format!("replay-{place}-{scheme}"));
        }
    }
    tab.screen(DESK);
    assert_ne!(tab.eval("document.body.dataset.level"), "well");

    tab.eval("document.querySelector('summary').focus()");
    for id in ["back", "pause", "forward", "speed", "at", "keys"] {
        tab.press("Tab");
        assert_eq!(tab.eval("document.activeElement.id"), id);
        assert_eq!(tab.eval("getComputedStyle(document.activeElement).outlineStyle"), "solid", "{id}");
    }
    let spoken = tab.spoken();
    for (role, name) in [
        ("form", "Playback"),
        ("button", "Back 10 s"),
        ("button", "Pause"),
        ("button", "Forward 10 s"),
        ("combobox", "Speed"),
        ("slider", "Place"),
        ("checkbox", "Keys"),
    ] {
        assert!(spoken.iter().any(|(is, called)| is == role && called == name), "no {role} \"{name}\" in {spoken:?}");
    }
    for words in ["P pauses and plays", "J and L go 10 s back and forward", "S and F make it slower and faster"] {
        assert!(tab.text("#keys-words").contains(words), "{words}");
    }

    tab.press("p");
    until(&mut tab, "pause", "Play");
    assert!(player.speed().abs() < f64::EPSILON);
    tab.until("document.getElementById('did').textContent.startsWith('paused at ')");
    let stood = at_s();
    assert!(stood >= 100.0, "{stood}");
    for key in ["j", "j", "l", "j"] {
        tab.press(key);
    }
    let wanted = stood - 20.0;
    tab.until(&format!("Math.abs(state.playback.at_s - {wanted}) < 0.001 && settled()"));
    let whole = wanted as u32;
    until(&mut tab, "did", &format!("at {}:{:02}", whole / 60, whole % 60));
    // A playback that stands still must not start when a pace is selected.
    tab.press("f");
    until(&mut tab, "did", "5 times, when it plays");
    tab.press("s");
    tab.press("s");
    until(&mut tab, "did", "2 times, when it plays");
    assert!(player.speed().abs() < f64::EPSILON);
    tab.press("p");
    until(&mut tab, "did", "playing, 2 times");
    assert!((player.speed() - 2.0).abs() < f64::EPSILON);
    tab.press("s");
    until(&mut tab, "did", "1 times");
    assert!((player.speed() - 1.0).abs() < f64::EPSILON);

    tab.eval("document.getElementById('pause').focus()");
    tab.press("Space");
    until(&mut tab, "pause", "Play");
    tab.eval("document.getElementById('at').focus()");
    tab.press("Home");
    tab.until("state.playback.at_s === 0");
    tab.until("document.getElementById('at').getAttribute('aria-valuetext') === '0:00 of 10:00'");
    for _ in 0..3 {
        tab.press("ArrowRight");
    }
    tab.press("ArrowLeft");
    tab.until("state.playback.at_s === 2");
    until(&mut tab, "did", "at 0:02");
    tab.eval("document.getElementById('forward').focus()");
    tab.press("Enter");
    tab.until("state.playback.at_s === 12");
    tab.eval("document.getElementById('at').focus()");
    tab.press("End");
    tab.until("state.playback.at_s === 600");
    assert_eq!(player.now_us(), contents.last_us);
    tab.until("document.getElementById('at').getAttribute('aria-valuetext') === '10:00 of 10:00'");
    // The page must display the state that belongs to the displayed instant. The recording says which one that is.
    until(&mut tab, "time", "670.0 s");
    screenshot(&mut tab, "playback");

    // Keys with a modifier are left to the browser. Where single keys are switched off, they have no effect.
    let alone = "dispatchEvent(new KeyboardEvent('keydown', { key: 'p', ctrlKey: true, cancelable: true }))";
    assert_eq!(tab.eval(alone), true, "it was not taken");
    tab.eval("document.getElementById('keys').focus()");
    tab.press("Space");
    assert_eq!(tab.eval("document.getElementById('keys').checked"), false);
    assert_eq!(tab.eval(&alone.replace("ctrlKey: true, ", "")), true, "it was not taken");
    tab.press("Space");
    assert_eq!(tab.eval(&alone.replace("ctrlKey: true, ", "")), false, "it was taken");
    until(&mut tab, "pause", "Pause");
    assert_eq!(tab.troubles(), Vec::<String>::new());

    drop(server);
    tab.press("p");
    until(&mut tab, "did", "the base station is not reached");
    let troubles = tab.troubles();
    assert!(troubles.iter().all(|trouble| trouble.starts_with("network: ")), "{troubles:?}");
    std::fs::remove_dir_all(&folder).unwrap();
}
