//! Tests the active hold on the page. `cargo xtask live` (xtask/src/live/tests/hold.rs) tests a command's whole way,
//! with both firmwares and the hold's.

use profile::criticality::ActiveLoad;
use profile::hold::{Acknowledged, Outcome};
use profile::{HoldStatus, HoldStatusBits, HoldValues};

use super::*;

fn values() -> HoldValues {
    HoldValues {
        status: HoldStatusBits::new().with_values_valid(true).with_within_limits(true).with_locked(true),
        temperature: 21.25,
        humidity: 45.5,
        set_point: 22.0,
        vibration: [0.125, 0.25, 9.5],
        greatest_shock: 31.5,
        supply: 3.0,
        output: 0.4,
        acknowledged: [Acknowledged::new(3, Outcome::Done), Acknowledged::new(9, Outcome::Refused)],
        ..HoldValues::absent(0)
    }
}

/// Sends HORUS's image, and the hold's object while there are values, until the page fulfils `wanted`.
fn fly(scene: &mut Scene, tab: &mut Tab, values: Option<HoldValues>, wanted: &str) {
    let began = Instant::now();
    while tab.eval(wanted) != Value::Bool(true) {
        if let Some(values) = values {
            let ms = u32::try_from(scene.began.elapsed().as_millis()).unwrap();
            let values = HoldValues { timestamp: ms / 100 * 100, seconds: ms / 1_000, ..values };
            let hold = HoldStatus::seal(Writer::<ActiveLoad>::claim(), &values);
            scene.forwarder.offer(&Bundle::new(Place::Hold, 1, hold.as_bytes()).unwrap());
        }
        scene.send(|ms| well(ms, |_, _| {}));
        sleep(PERIOD);
        assert!(began.elapsed() < Duration::from_secs(60), "never: {wanted}\n{}", tab.text("body"));
    }
}

/// Returns a JavaScript expression for a page that shows HORUS's data as live and without an alarm, and the hold's
/// state beginning with `hold`.
fn well_and(hold: &str) -> String {
    let state = format!("document.getElementById('hold-state').textContent.startsWith('{hold}')");
    format!("document.body.dataset.level === 'well' && {state}")
}

#[test]
fn the_hold_is_shown_as_never_received_present_and_expired() {
    let _alone = alone();
    let Some(mut tab) = tab("hold") else { return };
    let mut scene = Scene::begin();
    tab.open(&scene.address());
    fly(&mut scene, &mut tab, None, &well_and("NEVER RECEIVED"));
    assert_eq!(tab.eval("document.getElementById('hold-known').hidden"), Value::Bool(true));
    fly(&mut scene, &mut tab, Some(values()), &well_and("present"));
    let shown = table(&mut tab, "hold");
    let of =
        |name: &str| shown.iter().find(|row| row[0] == name).unwrap_or_else(|| panic!("{name}: {shown:?}"))[1].as_str();
    assert_eq!((of("Temperature"), of("Set-point"), of("Output")), ("21.3 °C", "22.0 °C", "heating, 40 %"));
    assert_eq!((of("Relative humidity"), of("Supply"), of("Lock")), ("45.5 %", "3.00 V", "locked"));
    assert_eq!((of("Vibration x, y, z"), of("Greatest shock")), ("0.13, 0.25, 9.50 m/s² RMS", "31.5 m/s²"));
    let acknowledged = [of("Acknowledged to the base station"), of("Acknowledged to the flight controller")];
    assert_eq!(acknowledged, ["number 3: done", "number 9: refused"]);

    let faulty = HoldValues { status: values().status.with_sensor_fault(true), output: f32::NAN, ..values() };
    let notice = "document.getElementById('hold-notices').textContent === 'Notice: a sensor of the hold has a fault'";
    fly(&mut scene, &mut tab, Some(faulty), &format!("{} && {notice}", well_and("present")));
    assert_eq!(tab.text("#alarms"), "none");
    let label = "document.getElementById('plot-hold-temperature').getAttribute('aria-label')";
    let drawn = format!("holdHistory.length > 30 && {label}.startsWith('Temperature: 21.3 to 22.0')");
    fly(&mut scene, &mut tab, Some(values()), &drawn);
    screenshot(&mut tab, "hold");

    fly(&mut scene, &mut tab, None, &well_and("EXPIRED"));
    assert_eq!(tab.eval("document.querySelectorAll('#hold-form, [data-command]').length"), json!(0));
    screenshot(&mut tab, "hold-expired");
    let known = tab.eval("holdHistory.length").as_u64().unwrap();
    assert!(known > 3, "{known}");
    tab.open(&scene.address());
    fly(&mut scene, &mut tab, None, "holdHistory.some((point) => point.temperature === 21.25)");
    scene.is_clean(&mut tab);
}

#[test]
fn a_command_without_an_answer_is_pending_and_then_lost() {
    let _alone = alone();
    let Some(mut tab) = tab("hold-commands") else { return };
    let key = Key::new([3; 32]);
    let mut scene = Scene::with_key(|_| Clock::begin(), Some((key, Voice::with_commands)));
    tab.open(&scene.address());
    fly(&mut scene, &mut tab, Some(values()), &well_and("present"));
    let says = |words: &str| format!("document.getElementById('hold-command').textContent.includes('{words}')");
    // The station commands the hold only after Hold-Status has come for two seconds.
    fly(&mut scene, &mut tab, Some(values()), "holdHistory.length > 30");
    fly(&mut scene, &mut tab, Some(values()), "!document.querySelector('[data-command=lock]').disabled");
    tab.eval("document.querySelector('[data-command=lock]').click()");
    fly(&mut scene, &mut tab, Some(values()), &says("PENDING"));
    assert!(tab.text("#hold-command").starts_with("Command 4, lock: PENDING"), "{}", tab.text("#hold-command"));
    fly(&mut scene, &mut tab, Some(values()), &says("LOST"));
    let done = HoldValues { acknowledged: [Acknowledged::new(4, Outcome::Done), Acknowledged::default()], ..values() };
    fly(&mut scene, &mut tab, Some(done), &says("Command 4, lock: DONE"));
    screenshot(&mut tab, "hold-command");
    scene.is_clean(&mut tab);
    tab.eval("commandHold('open')");
    fly(&mut scene, &mut tab, Some(done), &says("NOT SENT: wanted: "));
}
