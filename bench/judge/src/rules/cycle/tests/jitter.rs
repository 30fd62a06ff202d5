use super::*;

#[test]
fn a_command_that_scatters_is_told_alone() {
    for number in [5, 12] {
        let late = |gps: usize, by: i64| {
            changed(gps, |events| shift(events, by, |event| of(number)(event) && !is_tick(event)))
        };
        let bound = bounds::TICK_TO_COMMAND_JITTER as i64;
        assert_eq!(late(3, bound), []);
        for (gps, by) in [(3, bound + 1), (3, -bound - 1), (3, 100_000), (5, bound + 1)] {
            let at = (tick(number) + COMMAND[0]).checked_add_signed(by).unwrap();
            assert_eq!(late(gps, by), [(Violation::CommandJitter, 1, at)]);
        }
    }
}

#[test]
fn the_second_frame_of_a_cycle_scatters_by_itself() {
    let late = |by: i64, which: fn(&Event) -> bool| {
        changed(5, |events| {
            shift(events, by, |event| of(5)(event) && event.at > tick(5) + 4_100_000 && which(event));
        })
    };
    let command = tick(5) + COMMAND[1] + 101;
    assert_eq!(late(101, |_| true), [(Violation::CommandJitter, 1, command)]);
    let air = tick(5) + COMMAND[1] + LATENCY + 3_001;
    assert_eq!(late(3_001, is_sent), [(Violation::AirJitter, 1, air)]);
}

#[test]
fn on_the_pessimistic_clock_a_command_may_scatter_by_more() {
    let late = |by: i64| {
        let mut events = Events::flawless(3, CYCLES);
        shift(&mut events, by, |event| of(5)(event) && is_command(event));
        let mut log = events.log();
        log.header.clock = "pessimistic".to_owned();
        found(Cycle::new(&log.header), &log).0
    };
    let bound = bounds::TICK_TO_COMMAND_JITTER_PESSIMISTIC;
    assert_eq!(late(bound as i64), []);
    let at = tick(5) + COMMAND[0] + bound + 1;
    assert_eq!(late(bound as i64 + 1), [(Violation::CommandJitter, 1, at)]);
}

#[test]
fn a_frame_that_scatters_after_its_command_is_told_alone() {
    let late = |by: i64| changed(3, |events| shift(events, by, |event| of(5)(event) && is_sent(event)));
    let bound = bounds::TICK_TO_AIR_JITTER as i64;
    assert_eq!(late(bound), []);
    for by in [bound + 1, -bound - 1] {
        let at = (tick(5) + COMMAND[0] + LATENCY).checked_add_signed(by).unwrap();
        assert_eq!(late(by), [(Violation::AirJitter, 1, at)]);
    }
}

#[test]
fn the_greatest_jitter_within_any_one_start_is_reported() {
    let run = |first: i64, second: i64, apart: u64| {
        let mut events = Events::flawless(3, CYCLES);
        let start = tick(CYCLES) + 8 * MS;
        events.without(|event| event.what == What::End).reset(start, Board::Horus, true);
        let mut again = Events::new(3);
        again.field(start + MS, false).field(start + 2 * MS, true).cycles(start + 15 * MS, 9);
        shift(&mut again, apart as i64, |event| is_command(event) || is_sent(event));
        shift(&mut again, second, |event| event.at > start + 35 * MS && event.at < start + 45 * MS && !is_tick(event));
        shift(&mut events, first, |event| of(5)(event) && !is_tick(event));
        events.events.extend(again.events);
        (broken(events.end(start + 100 * MS)), tick(5) + COMMAND[0], start + 35 * MS + COMMAND[0])
    };
    assert_eq!(run(0, 0, 0).0, []);
    assert_eq!(run(0, 0, 50_000).0, [], "another start may have another offset");
    let (broken, at, _) = run(300, 200, 0);
    assert_eq!(broken, [(Violation::CommandJitter, 1, at + 300)]);
    let (broken, _, at) = run(200, 300, 0);
    assert_eq!(broken, [(Violation::CommandJitter, 1, at + 300)]);
}

#[test]
fn a_cycle_that_was_blamed_is_in_no_series() {
    let (broken, figures) = {
        let mut events = Events::flawless(3, CYCLES);
        shift(&mut events, 50_000, |event| of(5)(event) && !is_tick(event));
        payload(&mut events, 5, |payload| payload[70] ^= 1);
        found(Cycle::new(&header(3)), &events.log())
    };
    assert_eq!(broken, [(Violation::SentInvalid, 1, end(3, 5) + 50_000)]);
    assert_eq!(figures.period_ns, Some(crate::Span { min: CYCLE, max: CYCLE }));
    assert_eq!(figures.tick_to_command_ns.map(crate::Span::width), Some(0));
}

#[test]
fn a_cycle_without_a_frame_makes_no_period_of_two_cycles() {
    let mut events = Events::flawless(3, CYCLES);
    events.without(|event| of(5)(event) && !is_tick(event));
    let figures = found(Cycle::new(&header(3)), &events.log()).1;
    assert_eq!(figures.period_ns, Some(crate::Span { min: CYCLE, max: CYCLE }));
}

#[test]
fn a_frame_that_outlasts_its_cycle_still_belongs_to_that_cycle() {
    let late = |events: &mut Events| {
        for number in 1..=CYCLES {
            shift(events, 6 * MS as i64, |event| of(number)(event) && is_command(event));
        }
        for event in &mut events.events {
            if let What::Sent { started, .. } = &mut event.what {
                event.at += 6 * MS;
                *started += 6 * MS;
            }
        }
        events.end(tick(CYCLES + 1) - MS);
    };
    assert_eq!(changed(3, late), []);
    let wrong = changed(3, |events| {
        payload(events, 5, |payload| *payload = stamped([60; 4]));
        late(events);
    });
    assert_eq!(wrong, [(Violation::TimestampWrong, 1, end(3, 5) + 6 * MS)]);
    let scatters = changed(3, |events| {
        shift(events, 5_000, |event| of(5)(event) && is_sent(event));
        late(events);
    });
    let started = tick(5) + COMMAND[0] + LATENCY + 5_000 + 6 * MS;
    assert_eq!(scatters, [(Violation::AirJitter, 1, started)]);
}

#[test]
fn the_last_cycle_of_a_run_is_measured_for_jitter() {
    let last =
        changed(3, |events| shift(events, 200, |event| of(CYCLES)(event) && (is_command(event) || is_sent(event))));
    assert_eq!(last, [(Violation::CommandJitter, 1, tick(CYCLES) + COMMAND[0] + 200)]);
}

#[test]
fn of_equal_outliers_the_first_is_told() {
    for by in [200, -200] {
        let twice = changed(3, |events| {
            shift(events, by, |event| (of(5)(event) || of(9)(event)) && !is_tick(event));
        });
        assert_eq!(twice, [(Violation::CommandJitter, 1, (tick(5) + COMMAND[0]).checked_add_signed(by).unwrap())]);
    }
    // The least and the greatest time are equally far from the mean, so the judge reports the greatest.
    let first = CYCLES / 2 + 1;
    let half = changed(3, |events| {
        (first..=CYCLES).for_each(|number| shift(events, 200, |event| of(number)(event) && !is_tick(event)));
    });
    assert_eq!(half, [(Violation::CommandJitter, 1, tick(first) + COMMAND[0] + 200)]);
}

#[test]
fn violations_are_told_with_their_figures() {
    let words = |events: &Events| {
        let broken = crate::testing::broken(Cycle::new(&header(3)), &events.log()).0;
        broken.into_iter().map(|broken| broken.words).collect::<Vec<_>>()
    };
    let mut events = Events::flawless(3, CYCLES);
    shift(&mut events, 200, |event| of(5)(event) && !is_tick(event));
    assert_eq!(words(&events), ["100000 to 100200 ns, 200 ns peak to peak, the bound is 100 ns"]);
    let mut events = Events::flawless(3, CYCLES);
    payload(&mut events, 5, |payload| *payload = stamped([60; 4]));
    assert_eq!(words(&events), ["object 3 is stamped 60 ms instead of 50 ms, at 64.917809 ms"]);
}
