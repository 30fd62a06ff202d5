//! Tests what the rule demands of an undisturbed hold: its frames, the effects of commands, its outputs.

use super::*;

const BASE: WriterOf<BaseStation> = WriterOf::claim();
const FLIGHT: WriterOf<FlightController> = WriterOf::claim();

fn sends(events: &mut Events, at: u64, values: &HoldValues) {
    let object = HoldStatus::seal(WriterOf::<ActiveLoad>::claim(), values);
    events.add(at, What::Hold(HoldEvent::Sent(frame(at - MS, object.as_bytes()))));
}

/// Returns a locked hold's values with this timestamp (ms) and these acknowledgements of both writers' last commands.
fn says(timestamp: u32, acknowledged: [Acknowledged; 2]) -> HoldValues {
    let values = HoldValues { acknowledged, set_point: 20.0, ..HoldValues::absent(timestamp) };
    HoldValues { status: values.status.with_locked(true), ..values }
}

const NO_COMMAND: fn() -> [Acknowledged; 2] = || [Acknowledged::default(); 2];

#[test]
fn frames_may_take_300_ms_at_first_and_then_150_ms() {
    let frames = |at: &[u64], end: u64| {
        let mut events = run();
        for (number, at) in (1..).zip(at) {
            sends(&mut events, *at, &says(100 * number, NO_COMMAND()));
        }
        violations(events.end(end))
    };
    let silent = [Violation::HoldSilent];
    assert_eq!((frames(&[], 300 * MS), frames(&[], 300 * MS + 1)), (vec![], silent.to_vec()));
    assert_eq!(frames(&[200 * MS, 350 * MS], 500 * MS), []);
    assert_eq!(frames(&[200 * MS, 350 * MS], 500 * MS + 1), silent);
    assert_eq!(frames(&[200 * MS, 350 * MS + 1], 400 * MS), silent);
}

/// A command: writer, number, word, value.
type Command = (usize, u16, u16, f32);

fn commands(events: &mut Events, at: u64, timestamp: u32, command: Command) {
    let answer = answer_with(timestamp, command);
    events.add(at, What::Hold(HoldEvent::AnswerHeard(frame(at - 3 * MS, answer.as_bytes()))));
}

fn answer_with(timestamp: u32, (writer, number, word, value): Command) -> Answer {
    let mut values = UplinkValues { timestamp, ..UplinkValues::default() };
    for (to, from) in
        values.payload.iter_mut().zip([&number.to_le_bytes()[..], &word.to_le_bytes(), &value.to_le_bytes()].concat())
    {
        *to = from;
    }
    let mut answer = Answer::EMPTY;
    match writer {
        0 => answer.set_uplink(BASE, Uplink::seal(BASE, &values)),
        _ => answer.set_uplink(FLIGHT, Uplink::seal(FLIGHT, &values)),
    }
    answer
}

fn executes(command: Option<Command>, after: impl FnOnce(&mut HoldValues)) -> Vec<Violation> {
    let mut events = run();
    sends(&mut events, 100 * MS, &says(100, NO_COMMAND()));
    if let Some(command) = command {
        commands(&mut events, 150 * MS, 7, command);
    }
    let mut values = says(200, NO_COMMAND());
    after(&mut values);
    sends(&mut events, 200 * MS, &values);
    violations(&events)
}

#[test]
fn set_point_and_lock_change_only_by_commands_that_came() {
    let wrong = [Violation::HoldCommand];
    let done = |writer: usize, number| {
        move |now: &mut HoldValues| now.acknowledged[writer] = Acknowledged::new(number, Outcome::Done)
    };
    assert_eq!(executes(None, |_| {}), []);
    assert_eq!(executes(None, |now| now.set_point = 21.0), wrong);
    assert_eq!(executes(None, |now| now.status = now.status.with_locked(false)), wrong);
    assert_eq!(executes(None, done(0, 1)), wrong, "no command came");
    for writer in [0, 1] {
        let set = Some((writer, 1, 1, 30.0));
        let done = done(writer, 1);
        assert_eq!(executes(set, |now| (now.set_point, _) = (30.0, done(now))), []);
        assert_eq!(executes(set, |now| (now.set_point, _) = (30.5, done(now))), wrong);
        assert_eq!(executes(set, done), wrong, "it did nothing");
        assert_eq!(executes(set, |now| now.set_point = 30.0), wrong, "without an acknowledgement");
        let unlock = Some((writer, 1, 3, 0.0));
        let unlocked = |now: &mut HoldValues| now.status = now.status.with_locked(false);
        assert_eq!(executes(unlock, |now| (unlocked(now), done(now)).0), []);
        assert_eq!(executes(unlock, done), wrong, "it is still locked");
        assert_eq!(executes(Some((writer, 1, 2, 0.0)), done), []);
        assert_eq!(executes(Some((writer, 1, 2, 0.0)), |now| (unlocked(now), done(now)).0), wrong);
    }
    assert_eq!(executes(Some((0, 1, 2, 0.0)), done(1, 1)), wrong, "the other writer's");
    assert_eq!(executes(Some((0, 2, 2, 0.0)), done(0, 1)), wrong, "another number");
    assert_eq!(executes(Some((0, 0x8000, 2, 0.0)), done(0, 0x8000)), wrong, "an old number");
    assert_eq!(executes(Some((0, 0x7FFF, 2, 0.0)), done(0, 0x7FFF)), []);
}

#[test]
fn a_command_that_came_three_times_each_later_is_acknowledged() {
    let came = |timestamps: &[u32], acknowledged: Acknowledged| {
        let mut events = run();
        sends(&mut events, 100 * MS, &says(100, NO_COMMAND()));
        for (number, timestamp) in (1..).zip(timestamps) {
            commands(&mut events, (100 + number) * MS, *timestamp, (0, 1, 2, 0.0));
        }
        sends(&mut events, 200 * MS, &says(200, [acknowledged, Acknowledged::default()]));
        violations(&events)
    };
    let none = Acknowledged::default();
    assert_eq!(came(&[7, 8, 9], none), [Violation::HoldIgnores]);
    assert_eq!(came(&[7, 8], none), []);
    assert_eq!(came(&[7, 8, 8], none), [], "the same one twice");
    assert_eq!(came(&[7, 8, 9], Acknowledged::new(1, Outcome::Done)), []);
}

#[test]
fn after_power_on_no_earlier_command_is_acknowledged() {
    let acknowledges = |restart: HoldEvent| {
        let mut events = run();
        commands(&mut events, 90 * MS, 7, (0, 1, 2, 0.0));
        events.add(100 * MS, What::Hold(restart));
        sends(&mut events, 200 * MS, &says(0, NO_COMMAND()));
        let done = Acknowledged::new(1, Outcome::Done);
        sends(&mut events, 300 * MS, &says(100, [done, Acknowledged::default()]));
        violations(&events)
    };
    assert_eq!(acknowledges(HoldEvent::Power { on: true }), [Violation::HoldCommand]);
    assert_eq!(acknowledges(HoldEvent::Reset { cause: Cause::Pin, asked: true }), []);
}

fn does(outputs: &[f32], payload: (u16, u16, i32, u32)) -> Vec<Violation> {
    does_after(run(), 1, 50 * MS, outputs, payload)
}

/// Returns the violations if the hold sends statuses from its period `first` on, and the box is measured `after` ns
/// after the last of them.
fn does_after(
    mut events: Events,
    first: u32,
    after: u64,
    outputs: &[f32],
    payload: (u16, u16, i32, u32),
) -> Vec<Violation> {
    let mut at = 0;
    for (number, output) in (first..).zip(outputs) {
        let values =
            HoldValues { temperature: 20.0, humidity: 40.0, supply: 3.0, output: *output, ..says(0, NO_COMMAND()) };
        at = u64::from(number) * 100 * MS;
        sends(
            &mut events,
            at,
            &HoldValues { timestamp: 100 * number, status: values.status.with_values_valid(true), ..values },
        );
    }
    let (heater, cooler, temperature, humidity) = payload;
    let payload = HoldEvent::Payload { heater, cooler, temperature, humidity, heated: None, measured: None };
    events.add(at + after, What::Hold(payload));
    violations(&events)
}

#[test]
fn heater_and_cooler_are_on_for_what_the_last_three_statuses_state() {
    let on = |outputs: &[f32], heater, cooler| does(outputs, (heater, cooler, 20_000, 40_000)).is_empty();
    let heats = [0.9, 0.2, 0.3, 0.4];
    assert!(on(&heats, 1_710, 0) && on(&heats, 4_290, 0) && on(&heats, 3_000, 290));
    assert!(!on(&heats, 1_690, 0) && !on(&heats, 4_310, 0) && !on(&heats, 3_000, 310));
    let cools = [-0.4, -0.4, -0.5];
    assert!(on(&cools, 0, 3_710) && on(&cools, 290, 5_290));
    assert!(!on(&cools, 0, 3_690) && !on(&cools, 310, 4_500) && !on(&cools, 0, 5_310));
    assert!(on(&[0.0; 3], 300, 300) && on(&[0.03; 3], 0, 0), "an error of 0.03");
    assert!(on(&[0.5, 0.5], 0, 0), "two statuses do not tell enough");
}

#[test]
fn what_a_status_states_is_the_truth_within_the_sensors_error() {
    let measures = |temperature, humidity| does(&[0.0; 3], (0, 0, temperature, humidity)).is_empty();
    for truth in [(20_790, 40_000), (19_210, 40_000), (20_000, 45_000), (20_000, 35_100)] {
        assert!(measures(truth.0, truth.1), "{truth:?}");
    }
    for wrong in [(20_810, 40_000), (19_190, 40_000), (20_000, 45_100), (20_000, 34_900)] {
        assert!(!measures(wrong.0, wrong.1), "{wrong:?}");
    }
}

#[test]
fn the_pin_of_the_lock_follows_the_status_within_150_ms() {
    let pin = |turned: u64, locked| {
        let mut events = run();
        events.add(turned, What::Hold(HoldEvent::Lock { locked }));
        for number in 1..=2 {
            sends(&mut events, u64::from(number) * 100 * MS, &says(100 * number, NO_COMMAND()));
        }
        violations(&events)
    };
    assert_eq!(pin(50 * MS - 1, false), [Violation::HoldOutput]);
    assert_eq!(pin(50 * MS, false), []);
    assert_eq!(pin(50 * MS - 1, true), []);
}

#[test]
fn a_frame_is_shown_from_26_to_280_ms_after_its_end() {
    let hidden = |after: u64| {
        let mut events = run();
        events.add(200 * MS, What::Hold(HoldEvent::Heard(frame(199 * MS, &status(200)))));
        read(&mut events, 200 * MS + after, &[0; 64]);
        violations(&events)
    };
    assert_eq!((hidden(26 * MS - 1), hidden(280 * MS)), (vec![], vec![]));
    let wrong = [Violation::HoldHidden];
    assert_eq!((hidden(26 * MS), hidden(280 * MS - 1)), (wrong.to_vec(), wrong.to_vec()));
}

#[test]
fn a_frame_that_is_shown_is_answered() {
    let shown = |answered: bool, after: u64| {
        let mut events = run();
        match answered {
            true => exchange(&mut events, 200 * MS, 200),
            false => drop(events.add(200 * MS, What::Hold(HoldEvent::Heard(frame(199 * MS, &status(200)))))),
        }
        read(&mut events, 200 * MS + after, &status(200));
        violations(&events)
    };
    assert_eq!(shown(false, bounds::CYCLE + 1), [Violation::HoldUnanswered]);
    assert_eq!((shown(false, bounds::CYCLE), shown(true, bounds::CYCLE + 1)), (vec![], vec![]));
    let disturbed = |at: u64| {
        let mut events = disturbed(HoldPart::Air, 400 * MS);
        events.add(at, What::Hold(HoldEvent::Heard(frame(at - MS, &status(200)))));
        read(&mut events, at + 20 * MS, &status(200));
        violations(&events)
    };
    assert_eq!((disturbed(400 * MS - 1), disturbed(400 * MS)), (vec![], vec![Violation::HoldUnanswered]));
}

#[test]
fn an_object_is_shown_for_338_500_us_at_most() {
    let shown = |after: u64| {
        let mut events = run();
        exchange(&mut events, 200 * MS, 200);
        read(&mut events, 200 * MS + after, &status(200));
        violations(&events)
    };
    assert_eq!((shown(338_500_000), shown(338_500_001)), (vec![], vec![Violation::HoldShown]));
}

#[test]
fn what_the_hold_complains_of_is_a_violation() {
    let says = |event: HoldEvent| violations(run().add(100 * MS, What::Hold(event)));
    let wrong = [Violation::HoldComplains];
    assert_eq!(says(HoldEvent::Finding { text: "guard".into() }), wrong);
    assert_eq!(says(HoldEvent::Reset { cause: Cause::Watchdog, asked: false }), wrong);
    assert_eq!(says(HoldEvent::Reset { cause: Cause::Watchdog, asked: true }), []);
}

#[test]
fn a_frame_that_breaks_off_is_no_status_and_no_wrong_answer() {
    let mut events = run();
    let broken = |started, payload: &[u8]| HoldFrame { whole: false, ..frame(started, payload) };
    events.add(200 * MS, What::Hold(HoldEvent::Sent(broken(199 * MS, &status(100)))));
    assert_eq!(violations(events.end(301 * MS)), [Violation::HoldSilent]);
    let answered = |answer: HoldFrame| {
        let mut events = run();
        events.add(200 * MS, What::Hold(HoldEvent::Heard(frame(199 * MS, &status(200)))));
        events.add(204 * MS, What::Hold(HoldEvent::Answered(answer)));
        violations(&events)
    };
    assert_eq!(answered(broken(202 * MS, &[7; 50])), []);
    assert_eq!(answered(frame(202 * MS, &[7; 50])), [Violation::HoldAnswer]);
}

#[test]
fn a_dpr_with_a_disturbed_supply_may_misuse_its_second_front_end() {
    let mut events = run();
    let disturbs = Disturbance::Supply { board: Board::Dpr };
    events.add(50 * MS, testing::injected(disturbs, 150 * MS));
    events.add(100 * MS, What::Hold(HoldEvent::PortMisuse { text: "SPI access without supply".into() }));
    assert_eq!(violations(&events), []);
}

/// Returns a run in which a disturbance ends so that a requirement holds again from `calm` (ns) on.
fn disturbed(part: HoldPart, calm: u64) -> Events {
    let mut events = run();
    let disturbs = Disturbance::Hold { part };
    let settled = if part == HoldPart::Air { 300 * MS } else { 2_500 * MS };
    events.add(1, testing::injected(disturbs, calm - settled));
    events
}

#[test]
fn a_box_is_judged_by_new_statuses_of_undisturbed_sensors() {
    let wrong = [Violation::HoldOutput];
    let after = |events, after| does_after(events, 1, after, &[0.0; 3], (5_000, 0, 20_000, 40_000));
    assert_eq!((after(run(), 150 * MS), after(run(), 150 * MS + 1)), (wrong.to_vec(), vec![]));
    let disturbed = |after| {
        let mut events = disturbed(HoldPart::Sensors, 2_710 * MS);
        for number in 1..25 {
            sends(&mut events, number * 100 * MS, &says(100 * number as u32, NO_COMMAND()));
        }
        does_after(events, 25, after, &[0.0; 3], (5_000, 0, 20_000, 40_000))
    };
    assert_eq!((disturbed(10 * MS - 1), disturbed(10 * MS)), (vec![], wrong.to_vec()));
}

#[test]
fn a_disturbed_hold_may_restart_unasked() {
    let restarts = |at: u64| {
        let mut events = disturbed(HoldPart::Board, 2_600 * MS);
        events.add(at, What::Hold(HoldEvent::Reset { cause: Cause::Watchdog, asked: false }));
        violations(&events)
    };
    assert_eq!((restarts(2_600 * MS - 1), restarts(2_600 * MS)), (vec![], vec![Violation::HoldComplains]));
}

#[test]
fn a_disturbance_excuses_an_answer_without_a_carrier_for_300_ms() {
    let misuse = |at: u64| {
        let mut events = disturbed(HoldPart::Air, 400 * MS);
        events.add(at, What::Hold(HoldEvent::PortMisuse { text: OVERTAKEN.into() }));
        violations(&events)
    };
    assert_eq!((misuse(400 * MS - 1), misuse(400 * MS)), (vec![], vec![Violation::FrontEndMisuse]));
}

#[test]
fn only_a_hold_heard_just_before_its_restart_keeps_its_state() {
    let restarted = |after: u64, timestamp: u32| {
        let mut events = run();
        sends(&mut events, 100 * MS, &says(100, NO_COMMAND()));
        events.add(100 * MS + after, What::Hold(HoldEvent::Reset { cause: Cause::Pin, asked: true }));
        sends(&mut events, 400 * MS, &HoldValues { set_point: 25.0, ..says(timestamp, NO_COMMAND()) });
        violations(&events)
    };
    assert_eq!(restarted(LONGEST_GAP, 0), [Violation::HoldCommand]);
    assert_eq!(restarted(LONGEST_GAP + 1, 0), [], "a silent hold may have executed commands");
    assert_eq!(restarted(LONGEST_GAP, 100), [], "the first status after the restart was not heard");
}

#[test]
fn a_command_to_lock_locks() {
    let mut events = run();
    let unlocked = |values: HoldValues| HoldValues { status: values.status.with_locked(false), ..values };
    sends(&mut events, 100 * MS, &unlocked(says(100, NO_COMMAND())));
    commands(&mut events, 150 * MS, 7, (0, 1, 2, 0.0));
    let now = says(200, [Acknowledged::new(1, Outcome::Done), Acknowledged::default()]);
    let mut wrong = events.clone();
    sends(&mut events, 200 * MS, &now);
    assert_eq!(violations(&events), []);
    sends(&mut wrong, 200 * MS, &unlocked(now));
    assert_eq!(violations(&wrong), [Violation::HoldCommand]);
}

#[test]
fn a_command_is_too_old_by_all_that_came() {
    let mut events = run();
    commands(&mut events, 50 * MS, 7, (0, 1, 2, 0.0));
    sends(&mut events, 900 * MS, &says(100, NO_COMMAND()));
    commands(&mut events, 950 * MS, 7, (0, 1, 2, 0.0));
    sends(&mut events, 1_000 * MS, &says(200, [Acknowledged::new(1, Outcome::TooOld), Acknowledged::default()]));
    // The first frame came late.
    assert_eq!(violations(&events), [Violation::HoldSilent]);
}

#[test]
fn only_intact_answers_in_calm_air_insist_on_a_command() {
    let came = |mut events: Events, first: u64, numbers: [u16; 3], changed: u8| {
        sends(&mut events, first - MS, &says(100, NO_COMMAND()));
        for (after, number) in (0..).zip(numbers) {
            let answer = answer_with(7 + after as u32, (0, number, 2, 0.0));
            let mut answer = frame(first + after * MS - 3 * MS, answer.as_bytes());
            answer.bytes.0[0] ^= changed;
            events.add(first + after * MS, What::Hold(HoldEvent::AnswerHeard(answer)));
        }
        sends(&mut events, first + 99 * MS, &says(200, NO_COMMAND()));
        violations(&events)
    };
    let ignored = [Violation::HoldIgnores];
    assert_eq!(came(run(), 200 * MS, [1; 3], 0), ignored);
    assert_eq!(came(run(), 200 * MS, [1; 3], 8), [], "with a damaged length byte");
    assert_eq!(came(run(), 200 * MS, [1, 2, 3], 0), [], "three commands, once each");
    let calm = |first| came(disturbed(HoldPart::Air, 400 * MS), first, [1; 3], 0);
    assert_eq!((calm(400 * MS - 1), calm(400 * MS)), (vec![], ignored.to_vec()));
}

#[test]
fn an_object_stays_shown_while_the_next_one_is_not_yet_due() {
    let shown = |after: u64, object: u32| {
        let mut events = run();
        exchange(&mut events, 200 * MS, 200);
        exchange(&mut events, 300 * MS, 300);
        read(&mut events, 300 * MS + after, &status(object));
        violations(&events)
    };
    assert_eq!((shown(26 * MS - 1, 200), shown(26 * MS, 200)), (vec![], vec![Violation::HoldHidden]));
    assert_eq!((shown(26 * MS, 300), shown(200 * MS, 300)), (vec![], vec![]));
}
