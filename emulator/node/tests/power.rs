//! Tests of board, clock and firmware while a part has no supply.

use crate::{player, thumb};

use emulator_node::{Bare, Board, FromOutside, Node, ResetAt};
use emulator_part::{Pad, Reset};
use nrf52840::{Nrf52840, Settings};
use player::{IN, OUT, Player};
use stm32f429::{Oscillators, Stm32f429};
use thumb::{COUNTER, EXTI, GPIOD, HANDLER, MAIN, RCC, TIM2, Thumb, firmware};

const MS: u64 = 1_000_000;

/// A firmware that drives PD14 high, counts TIM2 updates (every 10 ms) and rising edges of PA3, and sleeps.
fn counting() -> Node<Player> {
    let mut main = Thumb::at(MAIN);
    main.exti3_on_pa3().store(GPIOD, 1 << 28).store(GPIOD + 0x18, 1 << 14).tim2_every(160_000).idle();
    let mut tick = Thumb::at(HANDLER);
    tick.store(TIM2 + 0x10, 0).count(COUNTER).ret();
    let mut hit = Thumb::at(HANDLER + 0x100);
    hit.store(EXTI + 0x14, 1 << 3).count(COUNTER + 4).ret();
    Player::with(&firmware("counting", &main, &[(28, &tick), (9, &hit)]))
}

fn word<B: Board>(node: &mut Node<B>, address: u32) -> u32 {
    node.word(u64::from(address)).unwrap()
}

fn run(node: &mut Node<Player>, to: u64) -> Vec<(u64, bool)> {
    let mut edges = node.board_mut(Player::take_edges);
    while node.now() < to {
        node.advance(to);
        edges.extend(node.board_mut(Player::take_edges));
    }
    edges
}

#[test]
fn a_part_without_supply_runs_nothing_and_releases_its_pins() {
    let mut node = counting();
    let edges = run(&mut node, 25 * MS);
    assert_eq!((word(&mut node, COUNTER), edges.len(), edges[0].1), (2, 1, true));
    assert_eq!(node.part().pad(OUT), Pad::Driven(true));
    let (instructions, awake) = (node.instructions(), node.usage().awake);

    node.power_off();
    assert!(!node.is_powered() && node.is_asleep());
    assert_eq!(node.part().pad(OUT), Pad::Floating);
    assert_eq!(run(&mut node, 25 * MS), [(25 * MS, false)], "the board hears of it at once");
    assert_eq!(node.earliest(), u64::MAX, "nothing is due");
    node.drive(IN, Some(true));
    assert_eq!(run(&mut node, 75 * MS), []);
    assert_eq!(node.now(), 75 * MS);
    assert_eq!((node.instructions(), node.usage().awake), (instructions, awake));
    assert_eq!((node.resets().len(), node.doing()), (0, "its supply is off".to_owned()));
    assert_eq!(node.take_findings(), []);
}

#[test]
fn a_part_starts_as_at_power_on_when_its_supply_returns() {
    let mut node = counting();
    run(&mut node, 25 * MS);
    node.power_off();
    run(&mut node, 75 * MS);
    node.power_on(7);
    assert_eq!(node.resets(), [ResetAt { at: 75 * MS, cause: Reset::PowerOn }]);
    assert!(node.is_powered() && !node.is_asleep());
    let (noise, hits) = (word(&mut node, COUNTER), word(&mut node, COUNTER + 4));
    let mut other = counting();
    other.restart(FromOutside::PowerOn(7));
    assert_eq!((word(&mut other, COUNTER), word(&mut other, COUNTER + 4)), (noise, hits), "noise is the seed's");
    assert!(noise != 2 && noise != 0);

    // The firmware begins anew: it raises its pin, its updates come every 10 ms, and it reacts to PA3.
    let edges = run(&mut node, 100 * MS);
    assert!(edges.len() == 1 && edges[0].1 && edges[0].0 > 75 * MS, "{edges:?}");
    assert_eq!(word(&mut node, COUNTER), noise.wrapping_add(2));
    node.drive(IN, Some(true));
    run(&mut node, 101 * MS);
    assert_eq!(word(&mut node, COUNTER + 4), hits.wrapping_add(1));
    assert_eq!(node.take_findings(), []);
}

#[test]
fn a_reset_from_outside_does_nothing_without_the_supply() {
    let mut node = counting();
    run(&mut node, 5 * MS);
    node.power_off();
    let instructions = node.instructions();
    node.restart(FromOutside::Pin);
    node.restart(FromOutside::BrownOut);
    node.lock_up();
    node.power_off();
    run(&mut node, 50 * MS);
    assert_eq!((node.resets().len(), node.instructions()), (0, instructions));
    assert_eq!(node.take_findings(), []);
    node.restart(FromOutside::PowerOn(1));
    run(&mut node, 60 * MS);
    assert!(node.instructions() > instructions);
    assert_eq!(node.resets().len(), 1);
}

#[test]
fn power_cycles_give_the_same_state_however_the_time_is_cut() {
    let cycled = |step: u64| {
        let mut node = counting();
        let mut reached = 0;
        for (to, on) in [(13 * MS, false), (31 * MS, true), (55 * MS, false), (58 * MS, true), (90 * MS, false)] {
            while reached < to {
                reached = (reached + step).min(to);
                run(&mut node, reached);
            }
            if on {
                node.power_on(to);
            } else {
                node.power_off();
            }
        }
        node.digest()
    };
    assert_eq!(cycled(100 * MS), cycled(MS / 3));
}

/// At 8 MHz from the crystal a cycle takes 125 ns. Without a supply the part returns to its 16 MHz oscillator.
#[test]
fn the_supply_changes_at_the_given_instants_whatever_the_parts_clock() {
    let mut main = Thumb::at(MAIN);
    main.store(RCC, 1 << 18 | 1 << 16 | 0x83).wait_for(RCC, 17).store(RCC + 0x08, 1).tim2_every(80_000).idle();
    let mut tick = Thumb::at(HANDLER);
    tick.store(TIM2 + 0x10, 0).count(COUNTER).ret();
    let firmware = firmware("on its crystal", &main, &[(28, &tick)]);
    let mut node: Node<Bare<Stm32f429>> =
        Node::new(Stm32f429::new(Oscillators::default()), Bare::new(), &firmware).unwrap();
    node.advance(35 * MS);
    assert_eq!(word(&mut node, COUNTER), 3);
    node.power_off();
    node.advance(1_000 * MS);
    assert_eq!(node.now(), 1_000 * MS);
    node.power_on(1);
    let noise = word(&mut node, COUNTER);
    node.advance(1_035 * MS);
    assert_eq!(word(&mut node, COUNTER), noise.wrapping_add(3));
    assert_eq!(node.resets(), [ResetAt { at: 1_000 * MS, cause: Reset::PowerOn }]);
}

#[test]
fn a_watchdog_stops_without_the_supply_and_leaves_no_reset_reason() {
    const WDT: u32 = 0x4001_0000;
    let mut main = Thumb::at(0x400);
    // The watchdog takes 100 ms of 32768 Hz.
    main.store(WDT + 0x504, 3_276).store(WDT, 1).idle();
    let image = thumb::firmware_at(0, "watched", &main, &[]);
    let mut node: Node<Bare<Nrf52840>> = Node::new(Nrf52840::new(Settings::default()), Bare::new(), &image).unwrap();
    node.advance(250 * MS);
    assert_eq!(node.resets().len(), 2, "it bites: {:?}", node.resets());
    node.power_off();
    node.advance(1_000 * MS);
    assert_eq!(node.resets().len(), 2);
    node.power_on(2);
    assert_eq!(node.part().reset_reason(), 0);
    node.advance(1_050 * MS);
    assert_eq!(node.resets().len(), 3);
}
