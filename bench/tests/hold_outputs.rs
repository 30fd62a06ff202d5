//! Tests the outputs of the hold's board alone, without a DPR: what becomes of heater and lock in its safe state.

use crate::boards;

use bench::boards::Hold;
use bench::faults::Upset;
use emulator_node::Node;
use firmware_common::last_stop::Cause;
use firmware_common::patrol::SLICE_US;

const US: u64 = 1_000;
const MS: u64 = 1_000_000;
/// The step in which the pins are looked at, ns: a PWM period is 1 ms.
const STEP: u64 = 20 * US;
/// The seed of a box that is cold, so that it is heated.
const COLD: u64 = 2;
/// The longest time until the idle loop finds a changed guard word, ns: two slices, and 12 ms in which the task of the
/// sensors waits for their bus.
const FOUND: u64 = 2 * SLICE_US as u64 * US + 12 * MS;

fn run(node: &mut Node<Hold>, to: u64) {
    while node.now() < to {
        node.advance(to);
        node.board_mut(|board| board.front_end.take_air());
    }
}

/// Runs to `to` (ns) and returns how often the heater was found on.
fn heats(node: &mut Node<Hold>, to: u64) -> u32 {
    let mut found = 0;
    while node.now() < to {
        let next = (node.now() + STEP).min(to);
        run(node, next);
        found += u32::from(node.board().outputs().heater);
    }
    found
}

/// The hold while it heats with its whole power; `None` if the firmware was not built.
fn heating() -> Option<Node<Hold>> {
    let mut node = boards::hold(COLD)?;
    run(&mut node, 3_000 * MS);
    let now = node.now();
    assert!(heats(&mut node, now + 10 * MS) > 350, "it heats for 0.8 of 500 steps");
    assert_eq!(node.board().outputs().locked, Some(true));
    node.take_log();
    Some(node)
}

/// Demands that nothing is heated from `from` (ns) until the watchdog has restarted the hold and it has started again,
/// that the lock stays locked all the time, and that the next start names `cause`.
fn is_safe(node: &mut Node<Hold>, from: u64, cause: Cause) {
    let starts = node.resets().len();
    run(node, from);
    assert_eq!(heats(node, from + 150 * MS), 0, "{cause:?}");
    assert_eq!(node.resets().len(), starts + 1, "{cause:?}: the watchdog bites");
    let lines: Vec<String> = node.take_log().iter().map(ToString::to_string).collect();
    assert!(lines.iter().any(|line| line.contains("the last stop: ") && line.contains(cause.name())), "{lines:?}");
    assert_eq!(node.board_mut(Hold::take_locked), [], "{cause:?}: the lock moves");
    assert_eq!(node.board().outputs().locked, Some(true));
}

#[test]
fn a_falling_supply_switches_the_heater_off_within_a_millisecond() {
    let Some(mut warm) = heating() else { return };
    warm.board_mut(Hold::take_locked);
    let mut was_on = 0;
    for phase in 0..8 {
        let mut node = warm.clone();
        let now = node.now() + phase * 125 * US;
        run(&mut node, now);
        was_on += u32::from(node.board().outputs().heater);
        let falls = node.now();
        node.supply(2_564_999, 0);
        run(&mut node, falls + MS);
        assert_eq!(heats(&mut node, falls + 10 * MS), 0, "phase {phase}");
        // The supply must be back, because a hold does not start below 2.7 V.
        node.supply(3_000_000, 0);
        is_safe(&mut node, falls + 10 * MS, Cause::Supply);
    }
    assert!(was_on >= 4, "the heater was on in {was_on} of 8 phases");
}

#[test]
fn a_flipped_guard_word_switches_the_heater_off() {
    let Some(mut warm) = heating() else { return };
    warm.board_mut(Hold::take_locked);
    for symbol in ["_stack_end", "__guard_data", "__guard_bss", "__guard_uninit", "__guard_end"] {
        let mut node = warm.clone();
        let flipped = node.now();
        let address = u32::try_from(node.address_of(symbol).unwrap()).unwrap();
        Upset::Ram { address, bit: 4 }.apply(&mut node).unwrap();
        is_safe(&mut node, flipped + FOUND + MS, Cause::GuardWord);
    }
}
