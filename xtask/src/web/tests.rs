use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;

use bench::sim::{Images, Setup};
use browser::Tab;
use clap::Parser;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::*;
use crate::{Cli, Command};

/// Returns the page's folder; `None` and a message if it was not built. In CI the test fails then.
fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("LINK_WEB").map(PathBuf::from).filter(|folder| folder.join("bench.wasm").is_file());
    if folder.is_none() {
        let text = "LINK_WEB does not say where `cargo xtask test` built the page";
        assert!(std::env::var_os("CI").is_none(), "{text}");
        eprintln!("not run: {text}");
    }
    folder
}

fn serve(folder: PathBuf) -> SocketAddr {
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            let folder = folder.clone();
            std::thread::spawn(move || answer(stream, &folder));
        }
    });
    address
}

fn answer(mut stream: std::net::TcpStream, folder: &Path) {
    let mut lines = BufReader::new(&stream).lines().map_while(Result::ok);
    let Some(path) = lines.next().and_then(|line| Some(line.split(' ').nth(1)?.to_owned())) else { return };
    let _ = lines.find(String::is_empty);
    let name = match path.split('?').next().unwrap_or_default().trim_start_matches('/') {
        "" => "index.html",
        name => name,
    };
    let kind = match name.rsplit('.').next() {
        Some("html") => "text/html",
        Some("css") => "text/css",
        Some("js") => "text/javascript",
        Some("svg") => "image/svg+xml",
        Some("wasm") => "application/wasm",
        _ => "application/octet-stream",
    };
    let (status, bytes) = match std::fs::read(folder.join(name)) {
        Ok(bytes) => ("200 OK", bytes),
        Err(_) => ("404 Not Found", vec![]),
    };
    let length = bytes.len();
    let head =
        format!("HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n");
    let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(&bytes));
}

/// A browser with the page.
struct Page {
    tab: Tab,
    origin: String,
}

impl Page {
    fn open(name: &str, query: &str) -> Option<Self> {
        let folder = folder()?;
        let tab = Tab::start(&browser::program()?, &target_dir().join("browser").join(format!("web-{name}")));
        let origin = format!("http://{}/", serve(folder));
        let mut page = Self { tab, origin };
        page.tab.open(&format!("{}{query}", page.origin));
        Some(page)
    }

    fn step(&mut self) -> Value {
        self.tab.eval("window.flightStep ?? null")
    }

    /// Ends the test, and asserts that the page loaded nothing from elsewhere and had no error.
    fn close(mut self) {
        assert_eq!(self.tab.text("#failure"), "");
        assert_eq!(self.tab.troubles(), [""; 0]);
        let requests = self.tab.requests();
        assert!(requests.len() > 10, "{requests:?}");
        for request in requests {
            assert!(request.starts_with(&self.origin), "{request}");
        }
    }
}

#[test]
fn a_flight_with_faults_is_the_command_lines_byte_for_byte() {
    flies_as_the_command_line("flight", "--seed 7 --faults air,gnss,fc,power,hang --seconds 20");
}

#[test]
fn a_flight_with_a_hold_is_the_command_lines_byte_for_byte() {
    flies_as_the_command_line("hold", "--seed 3 --faults hold,chips --seconds 5 --hold");
}

/// Asserts that the page called `name` has the outcome of `xtask sim` with these options.
fn flies_as_the_command_line(name: &str, options: &str) {
    let address = options.replace(" --", "&").replace(' ', "=").replace("--", "?");
    let Some(mut page) = Page::open(name, &format!("{address}&pace=0")) else { return };
    page.tab.until("window.flightStep?.outcome != null");
    let outcome = page.step()["outcome"].clone();

    let Command::Sim(args) = Cli::parse_from(format!("xtask sim {options}").split(' ')).command else {
        panic!("{options}")
    };
    let images = PathBuf::from(std::env::var_os("LINK_IMAGES").expect("with the page come the images"));
    let hold = options.contains("--hold").then(|| images.join("hold-fw.elf"));
    let dpr = images.join("gps-3").join(if hold.is_some() { "dpr-fw-hold.elf" } else { "dpr-fw.elf" });
    let images = Images { horus: images.join("gps-3/horus-tx-fw.elf"), dpr };
    let log = tempfile::NamedTempFile::new().unwrap();
    let setup = Setup { log: Some(log.path().to_owned()), hold, ..crate::sim::setup(&args, vec![], images) };
    let violations = bench::sim::run(&setup, &mut ()).unwrap().report.violations;
    let digest = Sha256::digest(std::fs::read(log.path()).unwrap());
    let digest: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(outcome, serde_json::json!({ "digest": digest, "violations": violations }));
    println!("{}", page.tab.text("#pace"));
    page.close();
}

/// The number of times that the page is opened for its speed. The fastest counts, because other work delayed it least.
const OPENED: usize = 3;

#[test]
fn a_position_shows_within_three_seconds_and_keeps_real_time() {
    let (mut first, mut speed) = (f64::INFINITY, 0.0_f64);
    for _ in 0..OPENED {
        let Some(mut page) = Page::open("first", "") else { return };
        page.tab.until("window.flightStep?.first_ms != null && window.flightStep.now_ms > 4000");
        let step = page.step();
        println!("first position after {} ms; {}", step["first_ms"], page.tab.text("#pace"));
        first = first.min(step["first_ms"].as_f64().unwrap());
        speed = speed.max(step["speed"].as_f64().unwrap());
        page.close();
        if first < 3_000.0 && speed > 1.0 {
            return;
        }
    }
    panic!("at best {first} ms, {speed} x real time");
}

#[test]
fn all_files_together_have_at_most_3_mb() {
    let Some(folder) = folder() else { return };
    let size = compressed(&folder).unwrap();
    assert!((100_000..=MOST).contains(&size), "{size} bytes");
}

#[test]
fn each_button_of_the_panel_has_its_effect_and_passes() {
    let Some(mut page) = Page::open("panel", "?seconds=3600&pace=0") else { return };
    let buttons = "[...document.getElementById('panel').contentDocument.querySelectorAll('#things button')]";
    page.tab.until(&format!("{buttons}.length === 15"));
    let calm = "document.getElementById('panel').contentDocument.querySelector('#broken .none') != null && \
                state.drone.link.up && !state.drone.stale && state.drone.reported.agree === 3";
    let effects = [
        ("GPS1 says nothing", "!state.drone.gps[0].heard && state.drone.reported.degraded"),
        ("GPS2 is jammed", "!state.drone.gps[1].valid && state.drone.gps[1].heard"),
        ("of the frames on the air are lost", "state.drone.link.missed > before.link.missed + 20"),
        ("on the air is wrong", "state.drone.link.rejected > before.link.rejected + 20"),
        ("the field between the boards is cut", "!state.drone.link.up && state.drone.stale"),
        ("HORUS has no supply", "!state.drone.link.up"),
        ("HORUS is restarted by its reset pin", "state.drone.counts.restarts > before.counts.restarts"),
        ("HORUS hangs", "state.drone.counts.restarts > before.counts.restarts"),
        ("the DPR is restarted", "state.drone.link.reset === 'pin' && !state.drone.stale"),
        ("the DPR hangs", "state.drone.link.reset === 'watchdog' && !state.drone.stale"),
        ("the DPR has no supply", "state.drone.link.reset === 'power on' && !state.drone.stale"),
    ];
    page.tab.eval("document.getElementById('panel').contentDocument.getElementById('seconds').value = 2");
    page.tab.until(&format!("window.flightStep != null && state?.drone?.link != null && {calm}"));
    for (words, effect) in effects {
        page.tab.eval("window.before = state.drone; null");
        page.tab.eval(&format!("{buttons}.find((one) => one.textContent.includes({})).click()", Value::from(words)));
        page.tab.until(effect);
        page.tab.until(calm);
    }
    let step = page.step();
    assert_eq!((&step["changed"], &step["outcome"]), (&Value::Bool(true), &Value::Null));
    let log = page.tab.eval("document.getElementById('panel').contentDocument.getElementById('log').textContent");
    for board in ["  horus  ", "  dpr    "] {
        assert!(log.as_str().unwrap().contains(board), "{log}");
    }
    page.close();
}

#[test]
fn the_wires_show_the_transactions_of_100_ms() {
    let Some(mut page) = Page::open("wires", "?pace=0&seconds=2") else { return };
    page.tab.until("window.flightStep?.outcome != null && window.wiresSeen?.bytes.length > 0");
    let seen = page.tab.eval(
        "({ falls: wiresSeen.changes[5].filter(([, level]) => !level).length, bytes: wiresSeen.bytes.length, \
           ticks: wiresSeen.changes[0].filter(([, level]) => level).length, \
           frames: wiresSeen.changes[1].filter(([, level]) => level).length })",
    );
    // Each 10 ms have one tick and one frame, and the flight controller reads every 4 ms.
    assert_eq!((&seen["ticks"], &seen["frames"], &seen["falls"]), (&10.into(), &10.into(), &25.into()), "{seen}");
    assert!(seen["bytes"].as_u64().unwrap() > 25 * 200, "{seen}");
    page.close();
}

#[test]
fn a_wrong_address_is_told_in_words() {
    for (query, words) in [
        ("?seed=seven", "seed=seven"),
        ("?faults=rain", "rain"),
        ("?faults=ram", "upsets"),
        ("?faults=hold", "hold"),
        ("?seconds=0", "1 to 86400"),
        ("?pace=-1", "0.01 to 100"),
    ] {
        let Some(mut page) = Page::open("wrong", query) else { return };
        page.tab.until("document.getElementById('failure').textContent !== ''");
        let told = page.tab.text("#failure");
        assert!(told.contains(words), "{query}: {told}");
    }
}
