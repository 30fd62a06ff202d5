//! The active hold, live: commands from the page in a real browser to the outputs of the hold's firmware, and back.

use std::fs::File;
use std::io::BufReader;

use bench_judge::{HoldEvent, Log, What};

use super::*;

/// The longest time from a command on the page to the display of its outcome, virtual ms.
const ANSWERS_WITHIN_MS: u64 = 1_000;

/// Returns the setup of a run with a hold and with an event log of this name; `None` and a message if the images were
/// not built. In CI the test fails then.
fn setup(name: &str) -> Option<Setup> {
    let Images { horus, dpr } = images()?;
    let dpr = dpr.with_file_name("dpr-fw-hold.elf");
    let hold = dpr.with_file_name("../hold-fw.elf");
    if !(dpr.is_file() && hold.is_file()) {
        assert!(std::env::var_os("CI").is_none(), "`cargo xtask build --hold` builds {}", dpr.display());
        eprintln!("not run: `cargo xtask build --hold` builds {}", dpr.display());
        return None;
    }
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../target/tmp/hold");
    std::fs::create_dir_all(&folder).unwrap();
    let log = Some(folder.join(name).with_extension("log"));
    let setup = Setup::new(Images { horus, dpr }, 3, 3_600_000_000_000);
    Some(Setup { writes: true, relays: true, hold: Some(hold), log, ..setup })
}

/// Returns the successive levels of the hold's lock output in the log.
fn locks(setup: &Setup) -> Vec<bool> {
    let log = Log::read(BufReader::new(File::open(setup.log.as_ref().unwrap()).unwrap())).unwrap();
    let locks = log.events.iter().filter_map(|event| match &event.what {
        What::Hold(HoldEvent::Lock { locked }) => Some(*locked),
        _ => None,
    });
    locks.collect()
}

/// Returns the greatest shares of a second in which heater and cooler were on, in ten thousandths.
fn outputs(setup: &Setup) -> (u16, u16) {
    let log = Log::read(BufReader::new(File::open(setup.log.as_ref().unwrap()).unwrap())).unwrap();
    let on = log.events.iter().filter_map(|event| match &event.what {
        What::Hold(HoldEvent::Payload { heater, cooler, .. }) => Some((*heater, *cooler)),
        _ => None,
    });
    on.fold((0, 0), |most, on| (most.0.max(on.0), most.1.max(on.1)))
}

fn speaks() -> Option<Speaks> {
    Some(Voice::with_commands)
}

/// Waits until the station has received Hold-Status for long enough to command the hold.
fn ready(page: SocketAddr) {
    until(page, "a hold", |drone| drone["hold"]["values"]["seconds"].as_u64() >= Some(3));
}

#[test]
fn a_command_from_the_page_reaches_the_holds_output_within_a_second() {
    let Some(setup) = setup("page") else { return };
    let Some(program) = browser::program() else { return };
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../target/tmp/browser/live-hold");
    let mut tab = browser::Tab::start(&program, &folder);
    let mut took = vec![];
    // At a pace other than 1 the station's clock is the virtual time.
    let outcome = watched_by(Page::start(0, 0.9, speaks(), |_, _| {}).unwrap(), &setup, |page, _| {
        tab.open(&format!("http://{page}/"));
        ready(page);
        let hold = || state(page)["drone"]["hold"].clone();
        let mut command = |click: &str, outcome: &str| {
            tab.until("!document.querySelector('[data-command=lock]').disabled");
            let before = hold()["commands"][0]["number"].as_u64();
            // A script notes the station's time at the click, and when the page displays the outcome.
            tab.eval(&format!(
                "window.clicked = state.now_us; window.shown = null; window.watch = setInterval(() => {{
                   const last = state.drone.hold.commands[0];
                   const words = document.getElementById('hold-command').textContent;
                   if (!last || last.number === {} || last.state === 'pending') return;
                   if (!words.startsWith('Command ' + last.number) || words.includes('PENDING')) return;
                   window.shown = state.now_us; clearInterval(window.watch);
                 }}, 1); {click}",
                before.map_or_else(|| "null".to_owned(), |number| number.to_string())
            ));
            tab.until("window.shown !== null");
            let words = tab.text("#hold-command");
            assert!(words.contains(outcome), "{words}");
            took.push((tab.eval("window.shown - window.clicked").as_f64().unwrap() / 1e3) as u64);
        };
        let button = |name: &str| format!("document.querySelector('[data-command={name}]').click()");
        let set = |celsius: f64| {
            let field = format!("document.getElementById('hold-set-point').value = '{celsius}'");
            format!("{field}; document.querySelector('#hold-form button').click()")
        };
        command(&button("unlock"), "DONE");
        assert_eq!(hold()["values"]["locked"], false);
        command(&button("lock"), "DONE");
        assert_eq!(hold()["values"]["locked"], true);
        command(&button("clear-shock"), "DONE");
        command(&set(90.0), "REFUSED");
        command(&set(39.5), "DONE");
        assert_eq!(hold()["values"]["set_point"], 39.5);
        until(page, "heating", |drone| drone["hold"]["values"]["output"].as_f64() > Some(0.2));
        command(&set(2.0), "DONE");
        until(page, "cooling", |drone| drone["hold"]["values"]["output"].as_f64() < Some(-0.2));
        let own = &hold()["values"]["acknowledged"];
        assert_eq!((&own[0]["number"], &own[1]["outcome"]), (&6.into(), &"none yet".into()), "{own}");
    });
    println!("from the click to the outcome on the page: {took:?} ms of virtual time");
    assert!(took.iter().all(|ms| *ms <= ANSWERS_WITHIN_MS), "{took:?}");
    assert_eq!(outcome.report.violations, [""; 0]);
    let mut levels = locks(&setup);
    levels.dedup();
    assert_eq!(levels[levels.len() - 2..], [false, true], "{levels:?}");
    let (heater, cooler) = outputs(&setup);
    assert!(heater > 1_000 && cooler > 1_000, "{heater}, {cooler}");
    assert_eq!(tab.troubles(), Vec::<String>::new());
}

#[test]
fn with_loss_each_command_is_done_once_or_shown_as_lost() {
    let Some(setup) = setup("loss") else { return };
    let page = Page::start(0, 0.0, speaks(), |_, _| {}).unwrap().with_loss(30, 3);
    let (mut states, mut took) = (vec![], vec![]);
    let outcome = watched_by(page, &setup, |page, _| {
        ready(page);
        let own = format!("Origin: http://{page}\r\n");
        for command in ["unlock", "lock"].repeat(8) {
            let mut answer = (0, String::new());
            let began = Instant::now();
            // The station refuses commands while it has received no Hold-Status, because messages were lost.
            while answer.0 != 202 {
                answer = ask(page, "POST", &format!("/hold?drone=1&command={command}"), &own);
                assert!(matches!(answer.0, 202 | 409) && began.elapsed() < Duration::from_secs(120), "{answer:?}");
            }
            let number: u64 = answer.1.parse().unwrap();
            until(page, "known", |drone| {
                let last = &drone["hold"]["commands"][0];
                last["number"] == number && last["state"] != "pending"
            });
            let last = state(page)["drone"]["hold"]["commands"][0].clone();
            states.push((command, last["state"].as_str().unwrap().to_owned()));
            took.push(last["after_ms"].as_u64().unwrap());
        }
        // The station refuses a request from another site's page.
        let (status, _) = ask(page, "POST", "/hold?drone=1&command=lock", "Origin: http://example.org\r\n");
        assert_eq!(status, 403);
    });
    println!("known after {took:?} ms");
    assert_eq!(outcome.report.violations, [""; 0]);
    assert!(states.iter().all(|(_, state)| state == "done" || state == "lost"), "{states:?}");
    let lost = states.iter().filter(|(_, state)| state == "lost").count();
    let levels = locks(&setup);
    // A command that the hold carries out twice, or after a later one, would change the lock once more.
    let mut expected: Vec<bool> = levels[..1].to_vec();
    expected.extend(states.iter().map(|(command, _)| *command == "lock"));
    expected.dedup();
    assert!(levels.len() <= expected.len() && levels.len() + 2 * lost >= expected.len(), "{levels:?}, {states:?}");
    assert!(lost > 0 || levels == expected, "{levels:?}");
}

#[test]
fn a_page_without_commands_has_no_buttons_and_its_server_refuses_them() {
    let page = Page::start(0, 0.0, None, |_, _| {}).unwrap();
    let address = page.server.address();
    let own = format!("Origin: http://{address}\r\n");
    assert_eq!(ask(address, "POST", "/hold?drone=1&command=lock", &own).0, 404);
    assert_eq!(state(address)["station"]["commands"], false);
}
