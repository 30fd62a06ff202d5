mod hold;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::PathBuf;

use bench::faults::plan::{HANG_LENGTH, WATCHDOG_STARTS};
use bench::faults::{Episode, Fault, Rng};
use bench::sim::AHEAD_NS;
use gnss_sim::{Flight, Geodetic, TangentPlane};
use serde_json::Value;

use super::*;

/// The time from power-on until HORUS's clock starts, s. HORUS checks its flash and sets up in 8 to 9 ms.
const HORUS_STARTS: f64 = 0.008_5;

/// Returns both firmwares for three receivers; `None` and a message if they were not built. In CI the test fails then.
fn images() -> Option<Images> {
    let folder = std::env::var_os("LINK_IMAGES").map(|folder| PathBuf::from(folder).join("gps-3"));
    if let Some(folder) = folder.filter(|folder| folder.is_dir()) {
        return Some(Images { horus: folder.join("horus-tx-fw.elf"), dpr: folder.join("dpr-fw.elf") });
    }
    assert!(std::env::var_os("CI").is_none(), "LINK_IMAGES does not say where `cargo xtask test` built the images");
    eprintln!("not run: LINK_IMAGES does not say where `cargo xtask test` built the images");
    None
}

fn ask(address: SocketAddr, method: &str, path: &str, headers: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(address).unwrap();
    let length = "Connection: close\r\nContent-Length: 0";
    write!(stream, "{method} {path} HTTP/1.1\r\nHost: {address}\r\n{headers}{length}\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    (head.split(' ').nth(1).unwrap().parse().unwrap(), body.to_owned())
}

fn state(address: SocketAddr) -> Value {
    let (status, body) = ask(address, "GET", "/state", "");
    assert_eq!(status, 200, "{body}");
    serde_json::from_str(&body).unwrap()
}

fn command(panel: SocketAddr, path: &str) {
    let (status, body) = ask(panel, "POST", path, &format!("Origin: http://{panel}\r\n"));
    assert_eq!(status, 204, "{path}: {body}");
}

fn watched(setup: &Setup, pace: f64, watch: impl FnOnce(SocketAddr, SocketAddr)) -> Outcome {
    watched_by(Page::start(0, pace, None, |_, _| {}).unwrap(), setup, watch)
}

fn watched_by(mut page: Page, setup: &Setup, watch: impl FnOnce(SocketAddr, SocketAddr)) -> Outcome {
    let (panel, address) = (page.panel.clone(), page.server.address());
    panel.begin(setup.gps, setup.duration_ns);
    let server = panel.serve((LOCAL, 0).into(), address).unwrap();
    std::thread::scope(|threads| {
        let run = threads.spawn(|| page.run(setup));
        let seen = catch_unwind(AssertUnwindSafe(|| watch(address, server.address())));
        panel.end();
        let outcome = run.join().unwrap();
        if let Err(panic) = seen {
            resume_unwind(panic);
        }
        outcome.unwrap()
    })
}

#[test]
fn the_page_shows_the_aircrafts_true_position_and_link_status() {
    let Some(images) = images() else { return };
    let setup = Setup::new(images, 3, 2_000_000_000);
    let mut page = Page::start(0, 0.0, None, |_, _| {}).unwrap();
    let outcome = page.run(&setup).unwrap();
    assert_eq!(outcome.report.violations, [""; 0]);
    let shown = page.settle();
    // Three messages are sent every 100 ms, and about three more at the start.
    assert!(shown.is_whole() && (57..=63).contains(&shown.sent), "{shown:?}");

    let drone = &state(page.server.address())["drone"];
    assert_eq!(drone["id"], SYSTEM.to_string());
    assert_eq!((&drone["counts"]["bad_crc"], &drone["stale"]), (&0.into(), &false.into()), "{drone}");
    assert_eq!((&drone["link"]["up"], &drone["link"]["rejected"]), (&true.into(), &12.into()), "{drone}");
    let reported = &drone["reported"];
    assert_eq!((&reported["valid"], &reported["agree"]), (&true.into(), &3.into()), "{drone}");
    let time = drone["time_ms"].as_f64().unwrap() / 1e3;
    assert!((1.8..=2.0).contains(&time), "{drone}");
    let flight = Flight::new(setup.seed, setup.duration_ns as f64 / 1e9);
    let was = flight.state(time + HORUS_STARTS).position;
    let place = |index: usize| reported["position"][index].as_f64().unwrap();
    let shown = Geodetic { latitude: place(0), longitude: place(1), height: was.height };
    let [north, east, _] = TangentPlane::new(was).to_ned(shown);
    assert!(north.hypot(east) <= 1.0, "{north} m north, {east} m east of the truth at {time} s");
}

fn until(page: SocketAddr, what: &str, wanted: impl Fn(&Value) -> bool) {
    let began = Instant::now();
    loop {
        let told = state(page);
        if wanted(&told["drone"]) {
            return;
        }
        assert!(began.elapsed() < Duration::from_secs(120), "never {what}: {told}");
        sleep(Duration::from_millis(2));
    }
}

fn calm(page: SocketAddr, panel: SocketAddr) {
    let began = Instant::now();
    while state(panel)["broken"] != serde_json::json!([]) {
        assert!(began.elapsed() < Duration::from_secs(120), "{}", state(panel));
        sleep(Duration::from_millis(2));
    }
    until(page, "calm", |drone| {
        drone["link"]["up"] == true && drone["stale"] == false && drone["reported"]["agree"] == 3
    });
}

#[test]
fn each_fault_from_the_panel_shows_on_the_page_and_passes() {
    let Some(images) = images() else { return };
    let setup = Setup { writes: true, ..Setup::new(images, 3, 3_600_000_000_000) };
    let outcome = watched(&setup, 0.0, |page, panel| {
        until(page, "heard", |drone| drone["reported"]["agree"] == 3);
        let count = |drone: &Value, of: &str, name: &str| drone[of][name].as_u64().unwrap_or_default();
        let now = || state(page)["drone"].clone();
        calm(page, panel);

        command(panel, "/break?what=silent-1&seconds=2.5");
        until(page, "silent", |drone| drone["gps"][0]["heard"] == false && drone["reported"]["degraded"] == true);
        calm(page, panel);
        command(panel, "/break?what=jammed-2&seconds=2.5");
        until(page, "jammed", |drone| drone["gps"][1]["valid"] == false && drone["gps"][1]["heard"] == true);
        calm(page, panel);
        let before = count(&now(), "link", "missed");
        command(panel, "/break?what=frames&seconds=2");
        until(page, "frames lost", |drone| count(drone, "link", "missed") > before + 20);
        calm(page, panel);
        let before = count(&now(), "link", "rejected");
        command(panel, "/break?what=bits&seconds=2");
        until(page, "bits wrong", |drone| count(drone, "link", "rejected") > before + 20);
        calm(page, panel);

        command(panel, "/break?what=field");
        until(page, "without a field", |drone| drone["link"]["up"] == false && drone["stale"] == true);
        let broke = state(panel)["now_s"].as_f64().unwrap();
        while state(panel)["now_s"].as_f64().unwrap() < broke + 3.0 {
            sleep(Duration::from_millis(2));
        }
        assert_eq!(now()["link"]["up"], false);
        assert_eq!(state(panel)["broken"][0]["until_s"], Value::Null);
        command(panel, "/well");
        calm(page, panel);

        command(panel, "/break?what=off-horus&seconds=1");
        until(page, "without HORUS", |drone| drone["link"]["up"] == false);
        calm(page, panel);
        for what in ["reset-horus", "hang-horus"] {
            let before = count(&now(), "counts", "restarts");
            command(panel, &format!("/break?what={what}"));
            until(page, what, |drone| count(drone, "counts", "restarts") > before);
            calm(page, panel);
        }
        for (what, reset) in [("reset-dpr", "pin"), ("hang-dpr", "watchdog"), ("off-dpr&seconds=1", "power on")] {
            command(panel, &format!("/break?what={what}"));
            until(page, what, |drone| drone["link"]["reset"] == reset && drone["stale"] == false);
            calm(page, panel);
        }
        let lines = state(panel)["lines"].clone();
        for board in ["horus", "dpr"] {
            assert!(lines.as_array().unwrap().iter().any(|line| line[1] == board), "{board}: {lines}");
        }
    });
    assert_eq!(outcome.report.violations, [""; 0]);
    let injected = &outcome.report.faults.injected;
    let mut kinds = vec!["receiver 1 silent", "receiver 2 without a fix", "air", "power horus off"];
    kinds.extend(["power dpr reset pin", "hang horus", "hang dpr"]);
    for kind in kinds {
        assert!(injected.contains_key(kind), "{kind}: {injected:?}");
    }
    assert_eq!(injected["receiver 1 silent"], 3, "a chain of three episodes for 2.5 s: {injected:?}");
}

#[test]
fn an_uplink_from_the_page_is_written_and_confirmed_despite_loss() {
    let Some(images) = images() else { return };
    let setup = Setup { writes: true, relays: true, ..Setup::new(images, 3, 3_600_000_000_000) };
    let page = Page::start(0, 4.0, Some(Voice::with_uplinks), |_, _| {}).unwrap().with_loss(30, 3);
    let (mut count, mut shown) = (0, vec![]);
    let outcome = watched_by(page, &setup, |page, _| {
        until(page, "heard", |drone| drone["reported"]["agree"] == 3);
        for payload in 1..=5 {
            let own = format!("Origin: http://{page}\r\n");
            let (status, timestamp) =
                ask(page, "POST", &format!("/uplink?drone=1&payload={payload:02x}&status=9"), &own);
            assert_eq!(status, 202, "{timestamp}");
            until(page, "written", |drone| {
                let uplink = &drone["uplink"];
                assert!(uplink["state"] == "sent" || uplink["state"] == "written", "{uplink}");
                uplink["state"] == "written" && uplink["timestamp"].as_u64() == timestamp.parse().ok()
            });
            let drone = state(page)["drone"].clone();
            assert_eq!((&drone["uplink"]["status"], &drone["port"]["last_refused"]), (&9.into(), &false.into()));
            count += drone["uplink"]["times"].as_u64().unwrap();
            shown.push(drone["uplink"]["after_ms"].as_u64().unwrap());
        }
        assert_eq!(ask(page, "POST", "/uplink?drone=1&payload=01", "Origin: http://example.org\r\n").0, 403);
    });
    println!("five uplinks in {count} messages, shown as written after {shown:?} ms");
    assert!(count >= 5 && shown.iter().all(|ms| *ms < 5_000), "{count}, {shown:?}");
    assert_eq!(outcome.report.violations, [""; 0]);
}

#[test]
fn the_panel_accepts_commands_from_its_own_page_alone() {
    let page = Page::start(0, 0.0, None, |_, _| {}).unwrap();
    page.panel.begin(3, 60_000_000_000);
    let server = page.panel.serve((LOCAL, 0).into(), page.server.address()).unwrap();
    let (panel, station) = (server.address(), page.server.address());
    let post = |path: &str, headers: &str| ask(panel, "POST", path, headers).0;
    let own = format!("Origin: http://{panel}\r\n");
    let others = ["", "Origin: http://example.org\r\n", "Origin: null\r\n", "Sec-Fetch-Site: cross-site\r\n"];
    let neighbour = format!("Origin: http://{station}\r\n");
    for headers in others.into_iter().chain([neighbour.as_str()]) {
        assert_eq!(post("/break?what=field", headers), 403, "{headers}");
        assert_eq!(post("/well", headers), 403, "{headers}");
    }
    for path in ["", "?", "?what=", "?what=moon", "?what=silent-4", "?what=field&seconds=0", "?what=field&seconds=601"]
    {
        assert_eq!(post(&format!("/break{path}"), &own), 400, "{path}");
    }
    for path in ["?what=field&seconds=nan", "?what=off-dpr", "?what=off-dpr&seconds=-1", "?what=%00"] {
        assert_eq!(post(&format!("/break{path}"), &own), 400, "{path}");
    }
    assert_eq!(page.panel.faults(1_000_000_000), Faults::none());
    assert_eq!(post("/break?what=field", "Sec-Fetch-Site: same-origin\r\n"), 204);
    assert_ne!(page.panel.faults(1_100_000_000), Faults::none());
    assert_eq!(ask(panel, "GET", "/break?what=field", &own).0, 405);
    assert_eq!(ask(panel, "GET", "/", "").0, 200);
    for path in ["/break?what=field", "/well", "/state"] {
        assert!(matches!(ask(station, "POST", path, &format!("Origin: http://{station}\r\n")).0, 404 | 405), "{path}");
    }
}

#[test]
fn a_fault_from_the_panel_is_one_gapless_chain_of_episodes() {
    const PIECE: u64 = super::PIECE;
    let page = Page::start(0, 0.0, None, |_, _| {}).unwrap();
    page.panel.begin(3, 60_000_000_000);
    let server = page.panel.serve((LOCAL, 0).into(), page.server.address()).unwrap();
    let fly = |pieces: std::ops::Range<u64>| -> Vec<(u64, u64)> {
        let told = pieces.map(|piece| {
            page.panel.progress(piece * PIECE);
            page.panel.faults(piece * PIECE)
        });
        told.flat_map(|faults| faults.episodes().to_vec()).map(|episode| (episode.at, episode.until)).collect()
    };
    let joined = |episodes: &[(u64, u64)]| episodes.windows(2).all(|two| two[1].0 < two[0].1);
    command(server.address(), "/break?what=silent-2&seconds=3.5");
    let episodes = fly(10..60);
    assert!(joined(&episodes), "{episodes:?}");
    assert_eq!(episodes.last().unwrap().1 - episodes[0].0, 3_500_000_000, "{episodes:?}");
    assert!(episodes.iter().all(|(at, until)| until - at <= 1_000_000_000), "{episodes:?}");
    command(server.address(), "/break?what=silent-2");
    let episodes = fly(60..200);
    assert!(episodes.len() > 15 && joined(&episodes), "{episodes:?}");
    command(server.address(), "/well?what=silent-2");
    assert_eq!(fly(200..300), [], "the last one comes to its end");
    // A fault of the panel ends before the run does.
    command(server.address(), "/break?what=field");
    let episodes = fly(300..600);
    assert!(joined(&episodes) && episodes.last().unwrap().1 == 59_400_000_000, "{episodes:?}");
    let (status, _) =
        ask(server.address(), "POST", "/break?what=bits", &format!("Origin: http://{}\r\n", server.address()));
    assert_eq!(status, 409);
}

#[test]
fn a_board_hangs_once_its_watchdog_runs_and_not_without_a_supply() {
    const PIECE: u64 = super::PIECE;
    let page = Page::start(0, 0.0, None, |_, _| {}).unwrap();
    page.panel.begin(3, 60_000_000_000);
    let server = page.panel.serve((LOCAL, 0).into(), page.server.address()).unwrap();
    let hangs = |piece: u64, asked: &[&str]| -> Vec<u64> {
        page.panel.progress(piece * PIECE);
        asked.iter().for_each(|what| command(server.address(), &format!("/break?what={what}")));
        let faults = page.panel.faults(piece * PIECE);
        let of_hang = |episode: &&Episode| matches!(episode.fault, Fault::Hang(_));
        faults.episodes().iter().filter(of_hang).map(|episode| episode.at - piece * PIECE).collect()
    };
    assert_eq!(hangs(10, &["hang-dpr", "hang-horus"]), [AHEAD_NS; 2]);
    // The DPR hangs, so its next hang is delayed by the 190 ms in which the watchdog restarts it.
    assert_eq!(hangs(11, &["hang-dpr"]), [AHEAD_NS + HANG_LENGTH.0 - PIECE]);
    assert_eq!(hangs(20, &["hang-dpr", "reset-dpr"]), [AHEAD_NS + WATCHDOG_STARTS]);
    assert!(hangs(30, &["off-dpr&seconds=1"]).is_empty());
    assert_eq!(hangs(35, &["hang-dpr", "hang-horus"]), [AHEAD_NS], "HORUS alone has a supply");
    // The DPR's supply has just come back, so the hang is delayed until the watchdog runs.
    assert_eq!(hangs(40, &["hang-dpr"]), [AHEAD_NS + WATCHDOG_STARTS]);
    assert_eq!(hangs(50, &["hang-dpr"]), [AHEAD_NS]);
}

#[test]
fn the_track_in_the_browser_is_within_a_metre_of_the_truth() {
    let Some(images) = images() else { return };
    let Some(program) = browser::program() else { return };
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../target/tmp/browser/live");
    let mut tab = browser::Tab::start(&program, &folder);
    let setup = Setup::new(images, 3, 15_000_000_000);
    let mut page = Page::start(0, 5.0, None, |_, _| {}).unwrap();
    tab.open(&format!("http://{}/", page.server.address()));
    let outcome = page.run(&setup).unwrap();
    assert_eq!(outcome.report.violations, [""; 0]);
    assert!(page.settle().is_whole());
    let last = state(page.server.address())["drone"]["time_ms"].as_f64().unwrap() / 1e3;
    tab.until(&format!("document.getElementById('time').textContent === '{last:.1} s'"));

    let flight = Flight::new(setup.seed, setup.duration_ns as f64 / 1e9);
    let path: Vec<Geodetic> = (0..1_500).map(|tick| flight.state(f64::from(tick) * 0.01).position).collect();
    let apart = |shown: [f64; 2], was: Geodetic| {
        let shown = Geodetic { latitude: shown[0], longitude: shown[1], height: was.height };
        let [north, east, _] = TangentPlane::new(was).to_ned(shown);
        north.hypot(east)
    };
    // The displayed position may be older than the displayed time by up to a period of the forwarder.
    let degrees = |text: String| -> f64 {
        let (number, side) = text.split_once("° ").unwrap();
        number.parse::<f64>().unwrap() * if matches!(side, "S" | "W") { -1.0 } else { 1.0 }
    };
    let shown = [degrees(tab.text("#latitude")), degrees(tab.text("#longitude"))];
    let times = (-25..=6).map(|tick| last + HORUS_STARTS + f64::from(tick) * 0.01);
    let off = times.map(|time| apart(shown, flight.state(time).position)).fold(f64::INFINITY, f64::min);
    assert!(off <= 1.0, "{off} m");
    let drawn = tab.eval("history.filter((point) => point.voted).map((point) => point.voted.slice(0, 2))");
    let drawn: Vec<[f64; 2]> = serde_json::from_value(drawn).unwrap();
    assert!(drawn.len() >= 50, "{} points in 15 s", drawn.len());
    let mut worst = 0.0_f64;
    for point in drawn {
        let off = path.iter().map(|was| apart(point, *was)).fold(f64::INFINITY, f64::min);
        worst = worst.max(off);
    }
    println!("the track is within {worst:.2} m, the numbers within {off:.2} m");
    assert!(worst <= 1.0, "{worst} m");
    assert_eq!(tab.troubles(), Vec::<String>::new());
}

/// A user who presses buttons of the panel at random while the link flies.
struct Storm {
    panel: Panel,
    rng: Rng,
    next: u64,
}

impl Observer for Storm {
    fn progress(&mut self, virtual_ns: u64) {
        self.panel.progress(virtual_ns);
    }

    fn log(&mut self, _: &str, _: &str) {}

    fn piece_ns(&self) -> u64 {
        PIECE
    }

    fn faults(&mut self, virtual_ns: u64) -> Faults {
        if virtual_ns >= self.next {
            self.next = virtual_ns + self.rng.below(2_000_000_000);
            let button = usize::try_from(self.rng.below(100)).unwrap();
            self.panel.press(button, Some(200_000_000 + self.rng.below(4_000_000_000)));
        }
        self.panel.faults(virtual_ns)
    }
}

#[test]
fn many_things_broken_together_violate_nothing() {
    let Some(images) = images() else { return };
    for seed in 1..=3 {
        let setup = Setup { seed, writes: true, ..Setup::new(images.clone(), 3, 40_000_000_000) };
        let panel = Panel::default();
        panel.begin(setup.gps, setup.duration_ns);
        let mut storm = Storm { panel, rng: Rng::new(seed), next: 0 };
        let outcome = bench::sim::run(&setup, &mut storm).unwrap();
        assert_eq!(outcome.report.violations, [""; 0], "seed {seed}: {:?}", outcome.report.faults.injected);
        assert!(outcome.report.faults.injected.len() >= 6, "{:?}", outcome.report.faults.injected);
    }
}
