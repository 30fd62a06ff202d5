use super::*;

/// The time, ns, from the beginning of a hang until the watchdog bites.
const BITES: u64 = 83 * MS;

/// Returns a run in which HORUS's core stops at `at` and its watchdog restarts HORUS later. TICK continues, because a
/// timer drives it. `told` adds an event that states the hang.
fn hung(gps: usize, at: u64, told: Option<u64>) -> Events {
    let mut events = Events::flawless(gps, CYCLES);
    for event in &mut events.events {
        let ended = event.at;
        if let What::Sent { started, whole, .. } = &mut event.what
            && *started <= at
            && ended > at
        {
            *whole = false;
        }
    }
    events.without(|event| {
        let begun = matches!(event.what, What::Sent { started, .. } if started <= at);
        event.at > at && !begun && !is_tick(event)
    });
    events.without(|event| event.at >= at + BITES);
    if let Some(told) = told {
        events.add(told, What::Hung { board: Board::Horus });
    }
    let what = What::Reset { board: Board::Horus, cause: crate::Cause::Watchdog, asked: false };
    events.add(at + BITES, what).field(at + BITES + 4 * MS, false).field(at + BITES + 6 * MS, true);
    events.cycles(at + BITES + 20 * MS, 9);
    events.end(at + BITES + 105 * MS);
    events
}

#[test]
fn a_hang_of_horus_excuses_its_unfinished_cycle() {
    for gps in [3, 5] {
        for after in
            [1, 50_000, COMMAND[0], COMMAND[0] + 1_000, COMMAND[0] + LATENCY, 2 * MS, COMMAND[1], 6 * MS, 9 * MS]
        {
            let at = tick(5) + after;
            assert_eq!(broken(&hung(gps, at, Some(at))), [], "{gps} {after}");
            let mut asked = hung(gps, at, None);
            for event in &mut asked.events {
                if let What::Reset { asked, .. } = &mut event.what {
                    *asked = true;
                }
            }
            assert_ne!(broken(&asked), [], "{gps} {after}");
        }
    }
}

#[test]
fn a_hang_of_horus_excuses_missing_ticks_but_no_irregular_ones() {
    let at = tick(5) + 2 * MS;
    let mut stopped = hung(3, at, Some(at));
    stopped.without(|event| is_tick(event) && event.at > at && event.at < at + BITES);
    assert_eq!(broken(&stopped), []);
    // A hang of HORUS may also end by the reset pin, or by the end of the run.
    let mut by_pin = stopped.clone();
    by_pin.without(|event| matches!(event.what, What::Reset { .. })).reset(at + BITES, Board::Horus, true);
    assert_eq!(broken(&by_pin), []);
    assert_eq!(broken(stopped.clone().end(at + BITES - MS)), []);
    stopped.without(|event| matches!(event.what, What::Hung { .. } | What::Reset { .. }));
    assert_eq!(broken(&stopped).first().map(|(violation, ..)| *violation), Some(Violation::NoTick));
    let mut wrongly = hung(3, at, Some(at));
    shift(&mut wrongly, 300_000, |event| is_tick(event) && event.at == tick(7));
    assert_eq!(broken(&wrongly), [(Violation::TickIrregular, 2, tick(7) + 300_000)]);
}

#[test]
fn frames_missing_before_a_hang_are_reported_despite_the_watchdogs_reset() {
    let at = tick(7) + MS;
    let mut events = hung(3, at, Some(at));
    events.without(|event| of(5)(event) && !is_tick(event));
    assert_eq!(broken(&events), [(Violation::NoFrame, 1, tick(6))]);
    let at = tick(7) + 50_000;
    let mut events = hung(3, at, Some(at));
    events.without(|event| of(6)(event) && !is_tick(event));
    assert_eq!(broken(&events), [(Violation::NoFrame, 1, tick(7))]);
    // The watchdog's reset, which was not asked for, explains the missing frames and is reported alone.
    let mut events = hung(3, at, None);
    events.without(|event| (of(5)(event) || of(6)(event)) && !is_tick(event));
    events.without(|event| of(7)(event) && !is_tick(event));
    assert_eq!(broken(&events), []);
}

#[test]
fn a_command_whose_frame_must_have_ended_when_horus_hangs_is_told() {
    let command = tick(5) + COMMAND[0];
    let ended = command + bounds::COMMAND_TO_AIR + bounds::FRAME_LONGEST;
    for (at, told) in [(ended, vec![]), (ended + 1, vec![(Violation::CommandWithoutFrame, 1, command)])] {
        let mut events = hung(3, at, Some(at));
        events.without(|event| of(5)(event) && is_sent(event));
        assert_eq!(broken(&events), told, "{at}");
    }
}

#[test]
fn what_a_horus_that_hangs_sends_is_judged() {
    let at = tick(5) + COMMAND[0] + LATENCY + 200_000;
    let sent = |change: fn(&mut Vec<u8>)| {
        let mut events = hung(3, at, Some(at));
        for event in &mut events.events {
            if let What::Sent { started, whole, .. } = &mut event.what
                && *started == tick(5) + COMMAND[0] + LATENCY
            {
                *whole = true;
            }
        }
        payload(&mut events, 5, change);
        broken(&events).into_iter().map(|(violation, ..)| violation).collect::<Vec<_>>()
    };
    assert_eq!(sent(|_| {}), []);
    assert_eq!(sent(|payload| payload[70] ^= 1), [Violation::SentInvalid]);
    assert_eq!(sent(|payload| *payload = stamped([60; 4])), [Violation::TimestampWrong]);
    let mut events = hung(3, at, Some(at));
    events.frame(tick(7), &stamped([70; 4]));
    assert_eq!(broken(&events), [(Violation::FrameWithoutCommand, 1, end(3, 7) - COMMAND[0] - LATENCY)]);
    let mut events = hung(3, at, Some(at));
    events.add(tick(7), What::Command);
    assert_eq!(broken(&events), []);
}

#[test]
fn a_horus_that_has_restarted_after_a_hang_is_blamed_again() {
    let at = tick(5) + 2 * MS;
    let mut events = hung(3, at, Some(at));
    let first = at + BITES + 20 * MS;
    events.without(|event| (first + CYCLE..first + 2 * CYCLE).contains(&event.at) && !is_tick(event));
    assert_eq!(broken(&events), [(Violation::NoFrame, 1, first + 2 * CYCLE)]);
    // A hang of the DPR excuses nothing of HORUS.
    let mut events = Events::flawless(3, CYCLES);
    events.add(at, What::Hung { board: Board::Dpr }).without(|event| of(7)(event) && !is_tick(event));
    assert_eq!(broken(&events), [(Violation::NoFrame, 1, tick(8))]);
}

#[test]
fn without_a_supply_nothing_hangs() {
    let (off, on) = (tick(5) - MS, tick(6));
    let mut events = Events::flawless(3, 4);
    events.add(off, What::Power { board: Board::Horus, on: false }).field(off, false);
    events.add(off + MS, What::Hung { board: Board::Horus });
    events.add(on, What::Power { board: Board::Horus, on: true }).field(on + 8 * MS, true).cycles(on + 20 * MS, 9);
    events.without(|event| (on + 30 * MS..on + 40 * MS).contains(&event.at) && !is_tick(event));
    assert_eq!(broken(events.end(on + 105 * MS)), [(Violation::NoFrame, 1, on + 40 * MS)]);
}
