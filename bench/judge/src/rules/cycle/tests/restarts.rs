use super::*;

fn restarted(gps: usize, at: u64, restart: impl Fn(&mut Events)) -> Vec<(Violation, u64, u64)> {
    let mut events = Events::flawless(gps, CYCLES);
    events.without(|event| event.at > at && !is_sent(event));
    // The front end finishes a frame that is on the air although HORUS restarts.
    events.without(|event| matches!(event.what, What::Sent { started, .. } if started > at));
    restart(&mut events);
    events.field(at + 4 * MS + 7, false).field(at + 6 * MS, true).cycles(at + 20 * MS, 9);
    broken(events.end(at + 105 * MS))
}

#[test]
fn a_restart_starts_everything_anew_without_blame() {
    for gps in [3, 5] {
        for after in
            [1, 50_000, COMMAND[0] + 1_000, COMMAND[0] + LATENCY - 1, 2 * MS, COMMAND[1] + 1_000, 6 * MS, 9 * MS]
        {
            for asked in [true, false] {
                let reset = |events: &mut Events| _ = events.reset(tick(5) + after, Board::Horus, asked);
                assert_eq!(restarted(gps, tick(5) + after, reset), [], "{gps} {after}");
            }
        }
    }
}

#[test]
fn a_frame_commanded_just_before_a_restart_is_not_judged() {
    let at = tick(5) + COMMAND[0] + 1_000;
    let mut frame = Events::flawless(3, 5);
    frame.without(|event| !(of(5)(event) && is_sent(event)));
    let started = |events: &mut Events| {
        events.reset(at, Board::Horus, true).events.extend(frame.events.iter().cloned());
    };
    assert_eq!(restarted(3, at, started), []);
}

#[test]
fn a_command_that_a_reset_gives_does_not_count() {
    let at = tick(5) + 1_000;
    for (after, expected) in [(0, vec![]), (99, vec![]), (100, vec![(Violation::CommandWithoutFrame, 1, at + 100)])] {
        let let_go = |events: &mut Events| {
            events.reset(at, Board::Horus, false).add(at + after, What::Command);
        };
        assert_eq!(restarted(3, at, let_go), expected, "{after} ns after it");
    }
}

#[test]
fn without_a_supply_nothing_is_asked_of_horus() {
    let at = tick(5) + 2 * MS;
    let off = |events: &mut Events| {
        events.add(at, What::Power { board: Board::Horus, on: false }).field(at, false);
        for event in events.events.iter_mut().filter(|event| event.at > at) {
            if let What::Sent { whole, .. } = &mut event.what {
                (event.at, *whole) = (at, false);
            }
        }
    };
    let mut events = Events::flawless(3, CYCLES);
    events.without(|event| event.at > at && !(of(5)(event) && is_sent(event)));
    off(&mut events);
    assert_eq!(broken(events.clone().end(at + 10 * bounds::START)), []);
    let on = at + 10 * bounds::START;
    events.add(on, What::Power { board: Board::Horus, on: true }).field(on + 8 * MS, true).cycles(on + 20 * MS, 9);
    assert_eq!(broken(events.clone().end(on + 105 * MS)), []);
    events.reset(at + MS, Board::Horus, false);
    assert_eq!(broken(events.end(on + 105 * MS)), [], "a reset without a supply starts nothing");
}

#[test]
fn the_dprs_restart_is_none_of_horus() {
    let reset = changed(3, |events| {
        let at = tick(5) + MS;
        events.reset(at, Board::Dpr, true).add(at, What::Power { board: Board::Dpr, on: false });
        events.without(|event| of(7)(event) && !is_tick(event));
    });
    assert_eq!(reset, [(Violation::NoFrame, 1, tick(8))]);
}

#[test]
fn a_watchdog_reset_covers_the_ticks_and_frames_missing_before_it() {
    let hung = |ticks: bool, after: u64, asked: bool| {
        let mut events = Events::flawless(3, 40);
        events.without(|event| event.at > tick(5) && !(ticks && is_tick(event)));
        events.without(|event| event.at >= tick(5) + after);
        events.reset(tick(5) + after, Board::Horus, asked);
        events.field(tick(5) + after + MS, false).cycles(tick(5) + after + 20 * MS, 3);
        broken(events.end(tick(5) + after + 45 * MS))
    };
    for after in [3 * MS, 60 * MS, 180 * MS] {
        assert_eq!(hung(false, after, false), []);
        assert_eq!(hung(true, after, false), []);
    }
    assert_eq!(hung(false, 60 * MS, true), [(Violation::NoTick, 1, tick(5) + bounds::TICK_MISSING)]);
    assert_eq!(hung(true, 65 * MS, true), [(Violation::NoFrame, 6, tick(6))]);
    let longest = bounds::TICK_MISSING + bounds::WATCHDOG_LONGEST;
    assert_eq!(hung(false, longest, false), []);
    assert_eq!(hung(false, longest + 1, false), [(Violation::NoTick, 1, tick(5) + bounds::TICK_MISSING)]);
}

#[test]
fn a_frame_that_is_missing_long_before_a_restart_is_told() {
    let at = tick(8) + MS;
    let before = restarted(3, at, |events| {
        events.reset(at, Board::Horus, false).without(|event| of(6)(event) && !is_tick(event));
    });
    assert_eq!(before, [(Violation::NoFrame, 1, tick(7))], "HORUS went on sending");
}
