//! Tests the record of when each task runs. A node records exceptions and sleep, and a trace derives its signals from
//! that.

use crate::{boards, elf, player, thumb};

use std::collections::BTreeMap;

use bench::trace::{TaskChange, TaskWatch};
use elf::{EM_ARM, ET_EXEC, elf};
use emulator_node::{Firmware, Node};
use player::{IN, Player};
use stm32f429::{EXTI3_INTERRUPT, TIM2_INTERRUPT};
use thumb::{COUNTER, EXTI, HANDLER, MAIN, TIM2, Thumb, firmware};

const MS: u64 = 1_000_000;

/// The period of the 16 MHz oscillator, rounded up, ns.
const CYCLE: u64 = 63;

const TICK: u16 = 16 + TIM2_INTERRUPT;
const HIT: u16 = 16 + EXTI3_INTERRUPT;

/// Returns a firmware with the task `tick`, which runs for about 1 ms every 10 ms, and the more urgent task `hit`,
/// which runs at each rising edge of PA3.
fn two_tasks() -> Node<Player> {
    two_tasks_with(0)
}

fn two_tasks_with(hit: u32) -> Node<Player> {
    let mut main = Thumb::at(MAIN);
    // NVIC_IPR7 gives TIM2 (interrupt 28) the priority 0x80, and NVIC_IPR2 gives EXTI3 (interrupt 9) its priority.
    main.exti3_on_pa3().store(0xE000_E41C, 0x80).store(0xE000_E408, hit << 8).tim2_every(160_000).idle();
    let mut tick = Thumb::at(HANDLER);
    tick.store(TIM2 + 0x10, 0).mov(0, 8_000);
    let again = tick.here();
    tick.raw(&[0x3801]).branch_if(thumb::If::NotEqual, again).count(COUNTER).ret();
    let mut hits = Thumb::at(HANDLER + 0x100);
    hits.store(EXTI + 0x14, 1 << 3).count(COUNTER + 4).ret();
    let image = firmware("two tasks", &main, &[(28, &tick), (9, &hits)]);
    let symbols =
        [("TIM2", HANDLER | 1), ("EXTI3", HANDLER + 0x101), ("DefaultHandler_", MAIN + 0x300), ("main", MAIN)];
    Player::with(&Firmware::parse("two tasks", elf(ET_EXEC, EM_ARM, image.segments(), &symbols)).unwrap())
}

const TABLE: [(&str, &str); 3] = [("tick", "TIM2"), ("hit", "EXTI3"), ("absent", "TIM7")];

#[test]
fn task_changes_have_the_instants_of_exception_entry_and_return() {
    let mut node = two_tasks();
    node.watch_line(TIM2_INTERRUPT);
    node.watch_tasks(true);
    node.advance(35 * MS);
    let tasks = node.take_tasks();
    let active: Vec<u16> = tasks.iter().map(|(_, active)| *active).collect();
    assert_eq!(active, [0, TICK, 0, TICK, 0, TICK, 0]);
    let rises: Vec<u64> = node.take_edges().iter().filter(|edge| edge.high).map(|edge| edge.at).collect();
    for (rise, ran) in rises.iter().zip(tasks[1..].chunks(2)) {
        let (entered, left) = (ran[0].0, ran[1].0);
        assert!(entered - rise <= 20 * CYCLE, "entered {} ns after its line", entered - rise);
        assert!((MS..MS + 100 * CYCLE).contains(&(left - entered)), "{} ns", left - entered);
    }
    let sleeps = node.take_sleeps();
    let asleep: Vec<bool> = sleeps.iter().map(|(_, asleep)| *asleep).collect();
    assert_eq!(asleep, [false, true, false, true, false, true, false, true]);
    for (woke, entered) in sleeps[2..].iter().step_by(2).zip(tasks[1..].iter().step_by(2)) {
        assert!(woke.0 <= entered.0 && entered.0 - woke.0 <= 20 * CYCLE, "{woke:?} {entered:?}");
    }
    assert_eq!((node.take_tasks(), node.take_sleeps()), (vec![], vec![]), "what was taken is gone");
    node.watch_tasks(false);
    node.advance(55 * MS);
    assert_eq!((node.take_tasks(), node.take_sleeps()), (vec![], vec![]));
}

#[test]
fn watching_tasks_changes_nothing_that_the_firmware_could_see() {
    let run = |watched| {
        let mut node = two_tasks();
        node.watch_tasks(watched);
        node.advance(35 * MS);
        node.digest()
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn task_changes_before_a_change_of_clock_keep_the_earlier_clocks_time() {
    let mut main = Thumb::at(MAIN);
    main.store(thumb::RCC, 1 << 18 | 1 << 16 | 0x83).wait_for(thumb::RCC, 17);
    // The code executes SVC, changes the clock from 16 MHz to 8 MHz, and executes SVC again.
    main.raw(&[0xDF00]).store(thumb::RCC + 0x08, 1).raw(&[0xDF00]).idle();
    let mut call = Thumb::at(HANDLER);
    call.count(COUNTER).ret();
    let mut segments = firmware("calls", &main, &[(9, &call)]).segments().to_vec();
    let table = &mut segments[0].1;
    table[4 * 11..4 * 12].copy_from_slice(&(HANDLER | 1).to_le_bytes());
    let mut node = Player::with(&Firmware::raw("calls", segments));
    node.watch_tasks(true);
    node.advance(20 * MS);
    let tasks = node.take_tasks();
    let [_, first, back, second, again] = tasks[..] else { panic!("{tasks:?}") };
    assert_eq!([first.1, back.1, second.1, again.1], [11, 0, 11, 0]);
    let (before, after) = (back.0 - first.0, again.0 - second.0);
    assert!(before > 0 && after.abs_diff(2 * before) <= 1, "the same handler takes {before} ns, then {after} ns");
}

#[test]
fn an_image_says_by_its_handlers_names_which_exceptions_they_are() {
    let node = two_tasks();
    assert_eq!((node.exceptions_of("TIM2"), node.exceptions_of("EXTI3")), (vec![TICK], vec![HIT]));
    assert_eq!((node.exceptions_of("TIM7"), node.exceptions_of("DefaultHandler_")), (vec![], vec![]));
}

fn over_time(changes: Vec<TaskChange>) -> Vec<(u64, BTreeMap<String, u64>)> {
    let mut states: Vec<(u64, BTreeMap<String, u64>)> = vec![];
    let mut state = BTreeMap::new();
    for (at, signal, value) in changes {
        state.insert(format!("{signal:?}"), value);
        match states.last_mut().filter(|(last, _)| *last == at) {
            Some((_, last)) => last.clone_from(&state),
            None => states.push((at, state.clone())),
        }
    }
    states
}

#[test]
fn a_task_that_is_preempted_stays_entered_while_another_runs() {
    let mut node = two_tasks();
    let mut watch = TaskWatch::new(&mut node, &TABLE);
    let named: Vec<_> = watch.tasks().iter().map(|task| (task.to_string(), task.exception)).collect();
    assert_eq!(named, [("tick_TIM2".to_owned(), TICK), ("hit_EXTI3".to_owned(), HIT)], "the image has no third");
    // The first edge at PA3 comes during the second `tick`, and the second edge while the core sleeps.
    node.advance(20 * MS + MS / 2);
    assert_eq!([0, 3, HIT, TICK].map(|exception| node.exception_priority(exception)), [256, -1, 0, 0x80]);
    node.drive(IN, Some(true));
    node.advance(25 * MS);
    node.drive(IN, Some(false));
    node.advance(26 * MS);
    node.drive(IN, Some(true));
    node.advance(29 * MS);
    let states = over_time(watch.take(&mut node));
    let shown: Vec<(u64, u64, u64, u64, u64)> = states
        .iter()
        .map(|(_, state)| {
            let value = |name: &str| state.get(name).copied().unwrap_or(0);
            (value("Entered(0)"), value("Entered(1)"), value("Idle"), value("Asleep"), value("Running"))
        })
        .collect();
    let (tick, hit) = (u64::from(TICK), u64::from(HIT));
    let (idle, asleep) = ((0, 0, 1, 0, 0), (0, 0, 0, 1, 0));
    let tick_alone = (1, 0, 0, 0, tick);
    let expected = [
        vec![idle, asleep],
        vec![tick_alone, idle, asleep],
        vec![tick_alone, (1, 1, 0, 0, hit), tick_alone, idle, asleep],
        vec![(0, 1, 0, 0, hit), idle, asleep],
    ]
    .concat();
    assert_eq!(shown, expected, "{states:?}");
    let preempted = &states[6];
    assert!((20_500_000..20_500_000 + 20 * CYCLE).contains(&preempted.0), "{preempted:?}");
}

/// The second of two exceptions with one priority follows the first by tail-chaining.
#[test]
fn a_task_that_another_follows_by_tail_chaining_has_ended() {
    for table in [&TABLE[..], &TABLE[..1]] {
        let mut node = two_tasks_with(0x80);
        let mut watch = TaskWatch::new(&mut node, table);
        node.advance(10 * MS + MS / 2);
        node.drive(IN, Some(true));
        node.advance(19 * MS);
        let states = over_time(watch.take(&mut node));
        // An exception without a task in the table appears in the signal `..._other`.
        let hit = if table.len() == 1 { "Other" } else { "Entered(1)" };
        let entered: Vec<(u64, u64)> = states
            .iter()
            .map(|(_, state)| ["Entered(0)", hit].map(|name| state.get(name).copied().unwrap_or(0)).into())
            .collect();
        assert_eq!(entered[2..], [(1, 0), (0, 1), (0, 0), (0, 0)], "{states:?}");
        let chained = &states[3];
        assert!((11 * MS..11 * MS + 200 * CYCLE).contains(&chained.0), "{chained:?}");
    }
}

#[test]
fn every_task_of_the_release_images_is_found_under_its_vector() {
    let (Some(mut horus), Some(mut dpr)) = (boards::horus(), boards::dpr()) else { return };
    let names = |watch: &TaskWatch| watch.tasks().iter().map(|task| (task.name, task.vector)).collect::<Vec<_>>();
    let watch = TaskWatch::new(&mut horus, horus_tx_fw::task::TASKS);
    assert_eq!(names(&watch), horus_tx_fw::task::TASKS);
    let watch = TaskWatch::new(&mut dpr, dpr_fw::task::TASKS);
    assert_eq!(names(&watch), dpr_fw::task::TASKS);
}
