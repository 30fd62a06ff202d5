//! Tests that heater and lock of a hold go to their safe levels when the hold stops.

use crate::boards;

use bench::boards::Hold;
use bench::faults::Upset;
use bench::payload::Payload;
use emulator_node::Node;
use firmware_common::last_stop::Cause;
use firmware_common::patrol::SLICE_US;

const US: u64 = 1_000;
const MS: u64 = 1_000_000;
/// The interval at which the pins are read, ns; a PWM period is 1 ms.
const STEP: u64 = 20 * US;
/// The longest time until the idle loop finds a changed guard word, ns: two slices, and 12 ms for a task that waits for
/// the sensors.
const FOUND: u64 = 2 * SLICE_US as u64 * US + 12 * MS;

fn run(node: &mut Node<Hold>, to: u64) {
    while node.now() < to {
        node.advance(to);
        node.board_mut(|board| board.front_end.take_air());
    }
}

/// Runs to `to` (ns) and returns at how many instants the heater was on.
fn heats(node: &mut Node<Hold>, to: u64) -> u32 {
    let mut found = 0;
    while node.now() < to {
        let next = (node.now() + STEP).min(to);
        run(node, next);
        found += u32::from(node.board().outputs().heater);
    }
    found
}

fn heating() -> Option<Node<Hold>> {
    let is_cold = |seed: &u64| Payload::new(*seed).climate.air(0).temperature < 5.0;
    let mut node = boards::hold((0..).find(is_cold).expect("boxes begin at -7 to 41 °C"))?;
    run(&mut node, 3_000 * MS);
    let now = node.now();
    assert!(heats(&mut node, now + 10 * MS) > 350, "it heats for 0.8 of 500 steps");
    assert_eq!(node.board().outputs().locked, Some(true));
    node.take_log();
    Some(node)
}

/// Asserts that the heater is off from `from` (ns) until the hold has restarted, that the lock stays locked, and that
/// the next start reports `cause`.
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
        // A hold does not start below 2.7 V.
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
