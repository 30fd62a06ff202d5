use super::*;

#[test]
fn a_flawless_run_has_its_figures_and_no_violation() {
    for gps in [1, 2, 3, 5] {
        let (broken, figures) = found(Cycle::new(&header(gps)), &Events::flawless(gps, CYCLES).log());
        assert_eq!(broken, [], "{gps} receivers");
        let span = |value| Some(crate::Span { min: value, max: value });
        assert_eq!(figures.period_ns, span(CYCLE));
        assert_eq!(figures.tick_to_command_ns, span(COMMAND[0]));
        assert_eq!(figures.tick_to_air_ns, span(COMMAND[0] + LATENCY));
        assert_eq!(figures.frames_sent, CYCLES * if gps == 5 { 2 } else { 1 });
        assert_eq!(figures.bit_rate, 424_000);
        let longest = [124, 184, 244, 0, 184][gps - 1];
        assert_eq!(figures.air_time_ns, profile::air::air_time_ns(longest));
    }
}

#[test]
fn without_frames_there_are_no_figures() {
    let mut events = Events::new(3);
    let (broken, figures) = found(Cycle::new(&header(3)), &events.end(MS).log());
    assert_eq!(broken, []);
    assert_eq!((figures.frames_sent, figures.bit_rate, figures.air_time_ns), (0, 0, 0));
    assert_eq!((figures.period_ns, figures.tick_to_command_ns, figures.tick_to_air_ns), (None, None, None));
}

#[test]
fn a_horus_without_ticks_is_reported_once_after_its_start_time() {
    let mut events = Events::new(3);
    assert_eq!(broken(events.end(bounds::START)), []);
    assert_eq!(broken(events.end(bounds::START + 1)), [(Violation::NoTick, 1, bounds::START)]);
    assert_eq!(broken(events.end(10 * bounds::START)), [(Violation::NoTick, 1, bounds::START)]);
    let late = |by| {
        let mut events = Events::new(3);
        broken(events.cycles(bounds::START + by, 9).end(bounds::START + 80 * MS))
    };
    assert_eq!(late(0), []);
    assert_eq!(late(1), [(Violation::NoTick, 1, bounds::START)]);
}

#[test]
fn missing_ticks_are_reported_once_whether_or_not_timestamps_count_them() {
    let due = tick(9) + bounds::TICK_MISSING;
    let lost = |events: &mut Events| {
        events.without(|event| (10..13).any(|number| of(number)(event)));
    };
    assert_eq!(changed(3, lost), [(Violation::NoTick, 1, due)]);
    let stamped = |first: u32| {
        let mut events = Events::new(3);
        events.field(8 * MS, true).cycles(FIRST_TICK, 9);
        for cycle in 0..4 {
            events.cycle(tick(13 + u64::from(cycle)), first + 10 * cycle);
        }
        broken(events.end(tick(17) - MS))
    };
    assert_eq!(stamped(100), [(Violation::NoTick, 1, due)], "ticks that went unseen were not counted");
    assert_eq!(stamped(130), [(Violation::NoTick, 1, due)], "they were");
    let wrong = (Violation::TimestampWrong, 4, end(3, 13));
    assert_eq!(stamped(90), [(Violation::NoTick, 1, due), wrong]);
    assert_eq!(stamped(140), [(Violation::NoTick, 1, due), wrong]);
    assert_eq!(stamped(115), [(Violation::NoTick, 1, due), wrong]);
}

#[test]
fn a_timestamp_after_missing_ticks_binds_those_after_it() {
    let mut events = Events::new(3);
    events.field(8 * MS, true).cycles(FIRST_TICK, 9).cycle(tick(13), 100).cycle(tick(14), 120).cycle(tick(15), 120);
    let due = tick(9) + bounds::TICK_MISSING;
    let wrong = (Violation::TimestampWrong, 1, end(3, 14));
    assert_eq!(broken(events.end(tick(16) - MS)), [(Violation::NoTick, 1, due), wrong]);
}

#[test]
fn a_run_that_ends_without_the_tick_that_is_due_lacks_it() {
    let due = tick(CYCLES) + bounds::TICK_MISSING;
    assert_eq!(changed(3, |events| _ = events.end(due)), []);
    assert_eq!(changed(3, |events| _ = events.end(due + 1)), [(Violation::NoTick, 1, due)]);
}

#[test]
fn a_cycle_without_a_timely_successor_needs_no_frames() {
    let due = tick(9) + bounds::TICK_MISSING;
    let hung = |events: &mut Events| {
        events.without(|event| (10..13).any(|number| of(number)(event)) || of(9)(event) && !is_tick(event));
    };
    assert_eq!(changed(3, hung), [(Violation::NoTick, 1, due)]);
}

#[test]
fn ticks_that_are_not_ten_milliseconds_apart_are_told_each() {
    let early = |by: u64| {
        changed(3, |events| {
            for number in 10..=CYCLES {
                shift(events, -(by as i64), |event| event.at == tick(number) || of(number)(event));
            }
        })
    };
    assert_eq!(early(bounds::TICK_TOLERANCE + 1), [(Violation::TickIrregular, 1, tick(10) - 210_001)]);
    // Each tick is within the tolerance, but the times between ticks vary too much. The tick farthest from the mean is
    // reported.
    assert_eq!(early(bounds::TICK_TOLERANCE), [(Violation::TickIrregular, 1, tick(10) - 210_000)]);
    assert_eq!(early(bounds::TICK_WIDTH + 1), [(Violation::TickIrregular, 1, tick(10) - 1_001)]);
    assert_eq!(early(bounds::TICK_WIDTH), []);
}

#[test]
fn ticks_within_the_tolerance_of_a_crystalless_oscillator_are_regular() {
    let run = |cycle: u64| {
        let mut events = Events::new(3);
        events.field(8 * MS, true);
        for number in 0..CYCLES {
            events.cycle(FIRST_TICK + number * cycle, (number as u32 + 1) * 10);
        }
        broken(events.end(FIRST_TICK + CYCLES * cycle - MS))
    };
    assert_eq!(run(CYCLE + bounds::TICK_TOLERANCE), []);
    assert_eq!(run(CYCLE - bounds::TICK_TOLERANCE), []);
    let first = FIRST_TICK + CYCLE + bounds::TICK_TOLERANCE + 1;
    assert_eq!(run(CYCLE + bounds::TICK_TOLERANCE + 1), [(Violation::TickIrregular, CYCLES - 1, first)]);
}

#[test]
fn a_tick_too_many_is_irregular_and_costs_neither_frames_nor_timestamps() {
    let more = |after| changed(3, |events| _ = events.add(tick(10) + after, What::Tick));
    assert_eq!(more(6 * MS), [(Violation::TickIrregular, 2, tick(10) + 6 * MS)]);
    assert_eq!(more(100_000), [(Violation::TickIrregular, 2, tick(10) + 100_000)]);
}
