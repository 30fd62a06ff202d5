use super::*;

#[test]
fn a_field_that_drops_is_told_alone_whatever_it_cuts_off() {
    let dropped = |at: u64, back: Option<u64>| {
        changed(3, |events| {
            events.without(|event| {
                let ready = back.map_or(u64::MAX, |back| (back + bounds::FIELD_READY).next_multiple_of(CYCLE));
                let is_frame = is_command(event) || is_sent(event);
                is_frame && event.at > at && event.at < ready
            });
            events.field(at, false);
            if let Some(back) = back {
                events.field(back, true);
            }
        })
    };
    let alone = |at| [(Violation::FieldDropped, 1, at)];
    for at in
        [tick(5) - MS, tick(5), tick(5) + 100_000, tick(5) + COMMAND[0] + 1_000, tick(5) + 2 * MS, tick(5) + 8 * MS]
    {
        assert_eq!(dropped(at, Some(tick(7) + 3 * MS)), alone(at));
        assert_eq!(dropped(at, Some(tick(9) + 9 * MS)), alone(at));
        assert_eq!(dropped(at, None), alone(at));
    }
}

#[test]
fn a_dropped_field_excuses_missing_frames_until_shortly_after_its_return() {
    let at = tick(5) + 2 * MS;
    let cut = |without: u64| {
        changed(3, |events| {
            for event in events.events.iter_mut().filter(|event| of(5)(event)) {
                if let What::Sent { whole, .. } = &mut event.what {
                    (event.at, *whole) = (at, false);
                }
            }
            events.without(|event| (of(6)(event) || of(without)(event)) && !is_tick(event));
            events.field(at, false).field(tick(6) + MS, true);
        })
    };
    assert_eq!(cut(6), [(Violation::FieldDropped, 1, at)]);
    assert_eq!(cut(7), [(Violation::FieldDropped, 1, at)], "its tick came within a cycle of the field's return");
    assert_eq!(cut(8), [(Violation::NoFrame, 1, tick(9)), (Violation::FieldDropped, 1, at)]);
}

#[test]
fn a_command_while_the_field_is_off_has_no_frame_to_miss() {
    let at = tick(5) + 8 * MS;
    let deaf = changed(3, |events| {
        events.without(|event| of(6)(event) && is_sent(event)).field(at, false).field(tick(6) + 5 * MS, true);
    });
    assert_eq!(deaf, [(Violation::FieldDropped, 1, at)]);
}

#[test]
fn horus_may_drop_the_field_to_recover_from_lost_frames() {
    let lost = |after: u64, which: fn(&Event) -> bool| {
        changed(3, |events| {
            let at = tick(6) + after;
            events.without(|event| (of(5)(event) || of(6)(event)) && which(event));
            events.without(|event| event.at > at && event.at < tick(9) && !is_tick(event));
            events.field(at, false).field(tick(8), true);
        })
    };
    let command = (Violation::CommandWithoutFrame, 2, tick(5) + COMMAND[0]);
    assert_eq!(lost(5_700_000, is_sent), [command]);
    assert_eq!(lost(200_000, |event| !is_tick(event)), [(Violation::NoFrame, 1, tick(6))]);
    let late = changed(3, |events| {
        events.without(|event| of(5)(event) && !is_tick(event)).field(tick(9), false);
        events.without(|event| event.at > tick(9) && (is_sent(event) || is_command(event)));
    });
    assert_eq!(late, [(Violation::NoFrame, 1, tick(6)), (Violation::FieldDropped, 1, tick(9))]);
}

#[test]
fn the_field_may_be_off_until_it_first_comes_on() {
    assert_eq!(
        changed(3, |events| _ = events.field(MS, false).field(2 * MS, true).without(|event| event.at == 8 * MS)),
        []
    );
    let never = changed(3, |events| _ = events.without(|event| matches!(event.what, What::Field { .. })));
    assert_eq!(never, [], "a frame shows that the carrier is on");
    let dropped = changed(3, |events| {
        events.without(|event| matches!(event.what, What::Field { .. })).field(tick(CYCLES) + 8 * MS, false);
    });
    assert_eq!(dropped, [(Violation::FieldDropped, 1, tick(CYCLES) + 8 * MS)]);
}

#[test]
fn the_bounds_around_a_drop_are_as_stated() {
    // A frame is required after tick 6 if the field is back by tick 5, but not if the field comes back later.
    let ready = |early: u64| {
        changed(3, |events| {
            events.without(|event| (of(5)(event) || of(6)(event)) && !is_tick(event));
            events.field(tick(5), false).field(tick(5) + early, true);
        })
    };
    let dropped = (Violation::FieldDropped, 1, tick(5));
    assert_eq!(ready(1), [dropped]);
    assert_eq!(ready(0), [(Violation::NoFrame, 1, tick(7)), dropped]);
    // HORUS's frame must have ended by a certain instant after its command. The field goes off at that instant, or 1 ns
    // later.
    let command = tick(5) + COMMAND[0];
    let after = |passed: u64| {
        changed(3, |events| {
            events.without(|event| of(5)(event) && is_sent(event) || event.at > tick(6) && !is_tick(event));
            events.field(command + bounds::COMMAND_TO_AIR + bounds::FRAME_LONGEST + passed, false);
            events.end(tick(CYCLES));
        })
    };
    let off = command + bounds::COMMAND_TO_AIR + bounds::FRAME_LONGEST;
    assert_eq!(after(0), [(Violation::FieldDropped, 1, off)]);
    assert_eq!(after(1), [(Violation::CommandWithoutFrame, 1, command)]);
    // A frame was lost so long ago that HORUS may no longer switch the field off because of it.
    let recovered = |passed: u64| {
        changed(3, |events| {
            let off = tick(5) + bounds::FIELD_RECOVERY + passed;
            events.without(|event| of(5)(event) && !is_tick(event));
            events.without(|event| event.at > off && !is_tick(event)).field(off, false).end(tick(CYCLES));
        })
    };
    let lost = (Violation::NoFrame, 1, tick(6));
    assert_eq!(recovered(0), [lost]);
    assert_eq!(recovered(1), [lost, (Violation::FieldDropped, 1, tick(5) + bounds::FIELD_RECOVERY + 1)]);
}
