//! Tests that a board stops if its tasks run out of their order: the watchdog resets it, and the next start reports the
//! cause.

use crate::{boards, thumb};

use bench::boards::Powered;
use bench::faults::{Board, Fault, Faults, is_step, tasks_of};
use bench::sim::{Bench, Images, Setup};
use bench_judge::bounds;
use boards::{counter, image};
use emulator_node::{Clock, Node, ResetAt};
use emulator_part::{Part, Reset};
use firmware_common::last_stop::Cause;
use horus_tx_fw::telemetry::Telemetry;
use nrf52840::Nrf52840;
use thumb::TIM2;

const MS: u64 = 1_000_000;
const US: u64 = 1_000;
/// The instant, ns, at which the link has been up for 200 ms.
const BEGINS: u64 = 303 * MS;
const AFTER: u64 = 700 * MS;

fn setup(gps: usize, clock: Clock, faults: Faults, duration: u64) -> Option<Setup> {
    let images = Images { horus: image(gps, "horus-tx-fw.elf")?, dpr: image(gps, "dpr-fw.elf")? };
    Some(Setup { clock, faults, ..Setup::new(images, gps, duration) })
}

/// Raises a spurious interrupt of a task at `at`, ns. Returns whether the interrupt could be raised. Returns an error
/// if the task is a step of a cycle and its watchdog did not reset the board, or if any other task had an effect.
fn spurious(gps: usize, clock: Clock, board: Board, task: u8, at: u64) -> Option<Result<bool, String>> {
    // A busy board accepts no spurious interrupt, so it is tried again.
    let mut tries = (0..10).map(|nth| spurious_at(gps, clock, board, task, at + 100 * US * nth));
    tries.find(|outcome| *outcome != Some(Ok(false)))?
}

fn spurious_at(gps: usize, clock: Clock, board: Board, task: u8, at: u64) -> Option<Result<bool, String>> {
    let faults = Faults::none().with(at, at, Fault::Spurious(board, task));
    let setup = setup(gps, clock, faults, at + AFTER)?;
    let mut bench: Bench = Bench::new(&setup).unwrap();
    bench.run_to(setup.duration_ns, setup.threads);
    let (resets, others, longest) = match board {
        Board::Horus => (bench.horus().resets().to_vec(), bench.dpr().resets().len(), bounds::WATCHDOG_LONGEST),
        Board::Dpr => (bench.dpr().resets().to_vec(), bench.horus().resets().len(), bounds::DPR_WATCHDOG_LONGEST),
    };
    let as_required = match resets[..] {
        [] => !is_step(board, task),
        [ResetAt { at: bitten, cause: Reset::Watchdog(_) }] => {
            is_step(board, task) && (at..=at + longest).contains(&bitten)
        }
        _ => false,
    };
    let verdict = bench.finish(setup.duration_ns).verdict;
    let injected = verdict.figures.faults.injected.len();
    let raised = injected == 1;
    let as_required = if raised { as_required } else { resets.is_empty() };
    if as_required && others == 0 && injected <= 1 && verdict.violations.is_empty() {
        return Some(Ok(raised));
    }
    let words: Vec<String> = verdict.violations.iter().map(ToString::to_string).collect();
    let (name, _) = tasks_of(board)[usize::from(task)];
    Some(Err(format!("{board:?} {name} at {at}, {gps} receivers: {injected} injected, {resets:?}, {words:?}")))
}

// Shows SAFE-16.
#[test]
fn an_uncalled_task_stops_its_board_or_finds_no_work() {
    let mut wrong = vec![];
    for board in [Board::Horus, Board::Dpr] {
        for task in 0..tasks_of(board).len() as u8 {
            let Some(outcome) = spurious(3, Clock::Fast, board, task, BEGINS + 690 * US * u64::from(task)) else {
                return;
            };
            if outcome != Ok(true) {
                wrong.push((board, task, outcome));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_step_out_of_its_turn_is_found_anywhere_in_the_cycle() {
    let mut wrong = vec![];
    for (nth, clock) in (0..).zip([Clock::Fast, Clock::Optimistic, Clock::Pessimistic]) {
        for board in [Board::Horus, Board::Dpr] {
            let steps = (0..tasks_of(board).len() as u8).filter(|task| is_step(board, *task));
            for (turn, task) in (0..).zip(steps) {
                let at = BEGINS + 3_300 * US * nth + 1_910 * US * turn;
                let Some(outcome) = spurious(5, clock, board, task, at) else { return };
                if outcome != Ok(true) {
                    wrong.push((board, task, outcome));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Runs a board for `time`, ns, or to its restart and for 30 ms more. Returns whether it restarts exactly once.
fn restarts_within<B: Powered>(node: &mut Node<B>, time: u64) -> bool {
    let run = |node: &mut Node<B>, to| {
        while node.now() < to {
            if node.advance_to_restart(to) {
                return true;
            }
            drop(node.board_mut(|board| board.front_end().take_air()));
        }
        false
    };
    let (end, after) = (node.now() + time, 30 * MS);
    let restarted = run(node, end);
    let started = node.now();
    restarted && !run(node, started + after)
}

/// Changes of TIM2's registers (RM0090 18.4.21) that move slots or ticks: name, offset, inverted bit.
const TIMER_CHANGES: [(&str, u32, u32); 6] = [
    ("counter", 0x24, 1 << 18),
    ("prescaler", 0x28, 1),
    ("reload, tick earlier", 0x2C, 1 << 13),
    ("reload, tick later", 0x2C, 1 << 18),
    ("first slot earlier", 0x34, 1 << 10),
    ("first slot later", 0x34, 1 << 11),
];

// Shows SAFE-16.
#[test]
fn a_cycle_timer_with_a_changed_register_stops_horus_within_a_cycle() {
    let Some(mut horus) = boards::horus() else { return };
    assert!(!restarts_within(&mut horus, 203 * MS));
    for (what, register, bit) in TIMER_CHANGES {
        let mut horus = horus.clone();
        let mut word = [0; 4];
        assert_eq!(horus.peek(TIM2 + register, &mut word), 4);
        horus.poke(TIM2 + register, &(u32::from_le_bytes(word) ^ bit).to_le_bytes()).unwrap();
        assert!(restarts_within(&mut horus, 30 * MS + bounds::WATCHDOG_LONGEST), "{what}: no reset");
        let told = counter(&horus, "HORUS_TELEMETRY", std::mem::offset_of!(Telemetry, last_stop));
        assert_eq!(told >> 24, Cause::Flow as u32, "{what}: {told:#x}");
    }
}

/// The registers of the hold's TIMER1, which calls the tasks of its cycle: PRESCALER and CC\[0\] (PS 6.30).
const BEAT_TIMER: u32 = 0x4000_9000;
const HOLD_TIMER_CHANGES: [(&str, u32, u32); 3] =
    [("prescaler", 0x510, 1), ("beat earlier", 0x540, 1 << 13), ("beat later", 0x540, 1 << 11)];

// Shows SAFE-16.
#[test]
fn the_hold_stops_when_its_cycle_runs_out_of_order_or_time() {
    let Some(mut hold) = boards::hold(1) else { return };
    // The timer has counted less than the changed compare value, so it still reaches that value.
    assert!(!restarts_within(&mut hold, 225 * MS));
    let line = |vector| Nrf52840::exception(vector).unwrap() - 16;
    let mut stops = vec![];
    for vector in ["TIMER1", "SWI0_EGU0"] {
        let mut hold = hold.clone();
        assert!(hold.raise_interrupt(line(vector)));
        stops.push((vector, hold));
    }
    for (what, register, bit) in HOLD_TIMER_CHANGES {
        let mut hold = hold.clone();
        let mut word = [0; 4];
        assert_eq!(hold.peek(BEAT_TIMER + register, &mut word), 4);
        hold.poke(BEAT_TIMER + register, &(u32::from_le_bytes(word) ^ bit).to_le_bytes()).unwrap();
        stops.push((what, hold));
    }
    for (what, mut hold) in stops {
        assert!(restarts_within(&mut hold, 60 * MS + bounds::DPR_WATCHDOG_LONGEST), "{what}: no reset");
        let told = counter(&hold, "HOLD_TELEMETRY", std::mem::offset_of!(hold_fw::telemetry::Telemetry, last_stop));
        assert_eq!(told >> 24, Cause::Flow as u32, "{what}: {told:#x}");
    }
    assert!(hold.raise_interrupt(line("SWI2_EGU2")));
    assert!(!restarts_within(&mut hold, 200 * MS), "the sensors' task finds no work");
}

/// A board is ready for a spurious interrupt only if no call of the task can come first, because the call would hide
/// the interrupt.
#[test]
fn a_starting_or_busy_board_is_not_ready_for_interrupts() {
    let Some(mut horus) = boards::horus() else { return };
    let mut ready_after = |time| {
        assert!(!restarts_within(&mut horus, time));
        usize::from(horus.is_ready_for_interrupts())
    };
    // The start masks interrupts for longer than any task runs. So the board cannot take an interrupt at several of
    // these milliseconds in a row.
    let started: Vec<usize> = (0..300).map(|_| ready_after(MS)).collect();
    assert!(started.windows(3).any(|of| of == [0, 0, 0]), "{started:?}");
    let mut seen = [0; 2];
    (0..2_000).for_each(|_| seen[ready_after(5 * US)] += 1);
    assert!(seen[0] > 0 && seen[1] > seen[0], "busy and ready: {seen:?}");
}
