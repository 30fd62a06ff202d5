//! Tests boards that hang: the core executes nothing until the board's own watchdog restarts it.

use crate::{boards, player, reader, thumb};

use bench::boards::Powered;
use bench::faults::plan::WATCHDOG_STARTS;
use bench::faults::{Board, Conduct, Fault, Faults, PowerFault, ReceiverFault, name_of, power, tasks_of};
use bench::sim::{Bench, Images, Outcome, Setup, run};
use bench_judge::{Verdict, What, bounds};
use boards::{counter, image};
use cortex_m4::{Cost, Fast, Optimistic, Pessimistic};
use emulator_node::{Bare, Clock, FromOutside, Node, ResetAt, Threads};
use emulator_part::Reset;
use horus_tx_fw::telemetry::Telemetry;
use nrf52840::{Nrf52840, Settings};
use player::Player;
use profile::{GpsObject, HorusState, Identifier, LinkStatus, Profile, ReportedPosition, ReportedStatus, ResetReason};
use stm32f429::Oscillators;
use thumb::{COUNTER, HANDLER, MAIN, RCC, TIM2, Thumb, firmware};

const MS: u64 = 1_000_000;
const US: u64 = 1_000;
/// The instant, ns, of a hang. Both boards have started by then, and the link has been up for 200 ms.
const BEGINS: u64 = 303 * MS;
/// The time from a hang to the end of the run, ns. It covers the watchdog's longest time and the longest recovery
/// allowed.
const AFTER: u64 = 700 * MS;

const BOARDS: [Board; 2] = [Board::Horus, Board::Dpr];
const CLOCKS: [Clock; 3] = [Clock::Fast, Clock::Optimistic, Clock::Pessimistic];

/// The STM32's watchdog and its register with the reset cause, RM0090 21.4 and 6.3.21.
const IWDG: u32 = 0x4000_3000;
const RCC_CSR: u32 = RCC + 0x74;
const IWDGRSTF: u32 = 1 << 29;
/// The nRF52840's watchdog, PS 6.36.
const WDT: u32 = 0x4001_0000;

/// Returns a board that counts the updates of TIM2 every 10 ms, and has a watchdog of 100 ms.
fn counting() -> Node<Player> {
    let mut main = Thumb::at(MAIN);
    // The watchdog counts 800 steps of four periods of 32 kHz.
    main.store(IWDG, 0xCCCC).store(IWDG, 0x5555).store(IWDG + 8, 800 - 1).store(IWDG + 4, 0);
    main.tim2_every(160_000).idle();
    let mut tick = Thumb::at(HANDLER);
    tick.store(TIM2 + 0x10, 0).count(COUNTER).store(IWDG, 0xAAAA).ret();
    Player::with(&firmware("counting", &main, &[(28, &tick)]))
}

fn run_to(node: &mut Node<Player>, to: u64) {
    while node.now() < to {
        node.advance(to);
        node.board_mut(|board| drop(board.take_edges()));
    }
}

#[test]
fn a_core_that_hangs_executes_nothing_until_the_watchdog_bites() {
    let mut node = counting();
    run_to(&mut node, 200 * MS);
    assert_eq!((node.word(u64::from(COUNTER)), node.resets()), (Some(19), &[][..]), "it feeds its watchdog");
    let (instructions, awake) = (node.instructions(), node.usage().awake);
    let fed = 190 * MS;
    node.hang();
    assert!(node.is_hung());
    run_to(&mut node, fed + 99 * MS);
    assert_eq!((node.instructions(), node.usage().awake, node.resets().len()), (instructions, awake, 0));
    assert!(node.doing().starts_with("it hangs"), "{}", node.doing());
    run_to(&mut node, fed + 102 * MS);
    let [ResetAt { at, cause: Reset::Watchdog("IWDG") }] = *node.resets() else { panic!("{:?}", node.resets()) };
    assert!((fed + 99 * MS..fed + 102 * MS).contains(&at), "{at}");
    let mut csr = [0; 4];
    assert_eq!(node.peek(RCC_CSR, &mut csr), 4);
    assert_ne!(u32::from_le_bytes(csr) & IWDGRSTF, 0);
    assert!(!node.is_hung());
    run_to(&mut node, at + 300 * MS);
    assert_eq!((node.word(u64::from(COUNTER)), node.resets().len()), (Some(19 + 29), 1));
    assert_eq!(node.take_findings(), []);
}

#[test]
fn a_hang_gives_the_same_state_however_the_time_is_cut() {
    let hung = |step: u64| {
        let mut node = counting();
        let mut reached = 0;
        for to in [133 * MS, 400 * MS] {
            while reached < to {
                reached = (reached + step).min(to);
                run_to(&mut node, reached);
            }
            node.hang();
        }
        run_to(&mut node, 450 * MS);
        node.digest()
    };
    assert_eq!(hung(1_000 * MS), hung(MS / 3));
}

#[test]
fn a_hang_ends_with_any_reset_or_loss_of_supply() {
    for why in [FromOutside::Pin, FromOutside::BrownOut, FromOutside::SoftReset, FromOutside::PowerOn(1)] {
        let mut node = counting();
        run_to(&mut node, 50 * MS);
        node.hang();
        run_to(&mut node, 55 * MS);
        let instructions = node.instructions();
        node.restart(why);
        run_to(&mut node, 60 * MS);
        assert!(!node.is_hung() && node.instructions() > instructions, "{why:?}");
    }
    let mut node = counting();
    run_to(&mut node, 50 * MS);
    node.hang();
    node.power_off();
    assert!(!node.is_hung());
    node.hang();
    node.power_on(1);
    assert!(!node.is_hung(), "nothing hangs without a supply");
}

#[test]
fn an_nrf52840_reports_the_watchdog_as_its_reset_reason_after_a_hang() {
    let mut main = Thumb::at(0x400);
    main.store(WDT + 0x504, 3_276).store(WDT, 1);
    let again = main.here();
    main.store(WDT + 0x600, 0x6E52_4635).branch(again);
    let image = thumb::firmware_at(0, "fed", &main, &[]);
    let mut node: Node<Bare<Nrf52840>> = Node::new(Nrf52840::new(Settings::default()), Bare::new(), &image).unwrap();
    node.advance(250 * MS);
    node.hang();
    node.advance(349 * MS);
    assert_eq!(node.resets(), []);
    node.advance(351 * MS);
    assert_eq!(node.resets().iter().map(|reset| reset.cause).collect::<Vec<_>>(), [Reset::Watchdog("WDT")]);
    assert_eq!(node.part().reset_reason(), 1 << 1);
    node.advance(800 * MS);
    assert_eq!(node.resets().len(), 1, "it is fed again");
}

fn pass<B: Powered, C: Cost>(node: &mut Node<B, C>, to: u64) {
    while node.now() < to {
        node.advance(to);
        drop(node.board_mut(|board| board.front_end().take_air()));
    }
}

/// Makes a copy of `node` hang `after` ns from now. Returns the copy after the watchdog's reset; `None` if none comes
/// within 0.6 s.
fn hung_after<B: Powered, C: Cost>(node: &Node<B, C>, after: u64) -> Option<Node<B, C>>
where
    Node<B, C>: Clone,
{
    let mut node = node.clone();
    let (at, end) = (node.now() + after, node.now() + 600 * MS);
    pass(&mut node, at);
    node.hang();
    while node.now() < end {
        if node.advance_to_restart(end) {
            return Some(node);
        }
        drop(node.board_mut(|board| board.front_end().take_air()));
    }
    None
}

/// Before a certain time after a reset, the watchdog does not end a hang. Returns this time, ns, exact to 100 ns.
fn watched_from<B: Powered, C: Cost>(mut node: Node<B, C>) -> u64
where
    Node<B, C>: Clone,
{
    pass(&mut node, 20 * MS);
    node.restart(FromOutside::Pin);
    let (mut before, mut from) = (0, WATCHDOG_STARTS);
    assert!(hung_after(&node, from).is_some(), "a hang stays");
    while from - before > 100 {
        let middle = (before + from) / 2;
        if hung_after(&node, middle).is_some() {
            from = middle;
        } else {
            before = middle;
        }
    }
    from
}

fn watched_from_on<C: Cost + Clone>() -> Option<[u64; 2]> {
    let horus = boards::horus_with::<C>(Oscillators::default())?;
    Some([watched_from(horus), watched_from(boards::dpr_with::<C>(Settings::default())?)])
}

#[test]
fn both_watchdogs_run_two_microseconds_after_a_reset_on_every_clock() {
    let Some(fast) = watched_from_on::<Fast>() else { return };
    let clocks = [fast, watched_from_on::<Optimistic>().unwrap(), watched_from_on::<Pessimistic>().unwrap()];
    println!("HORUS and DPR, ns, fast, optimistic, pessimistic: {clocks:?}");
    assert!(clocks.into_iter().flatten().all(|from| from <= 1_500), "{clocks:?}");
}

/// Instants of a hang after a reset, ns. Both watchdogs run by then, and at the later instants the boards still start.
const IN_START: [u64; 3] = [WATCHDOG_STARTS, 300 * US, 2_900 * US];

#[test]
fn a_hang_soon_after_any_reset_is_told_as_the_watchdogs_restart() {
    for why in [FromOutside::Pin, FromOutside::PowerOn(5)] {
        let Some(mut horus) = boards::horus() else { return };
        let mut dpr = boards::dpr().unwrap();
        pass(&mut horus, 20 * MS);
        pass(&mut dpr, 20 * MS);
        horus.restart(why);
        dpr.restart(why);
        for after in IN_START {
            let mut horus = hung_after(&horus, after).unwrap_or_else(|| panic!("{why:?}: HORUS hung {after} stays so"));
            let started = horus.now();
            pass(&mut horus, started + 20 * MS);
            let reason = counter(&horus, "HORUS_TELEMETRY", std::mem::offset_of!(Telemetry, reset_reason));
            assert_eq!(reason, ResetReason::Watchdog as u32, "{why:?}: HORUS hung {after}");
            let mut dpr = hung_after(&dpr, after).unwrap_or_else(|| panic!("{why:?}: the DPR hung {after} stays so"));
            let started = dpr.now();
            pass(&mut dpr, started + 20 * MS);
            let told = reader::view(&mut dpr).link.expect("Link-Status").status.reset_reason();
            assert_eq!(told, Some(ResetReason::Watchdog), "{why:?}: the DPR hung {after}");
        }
    }
}

fn setup(faults: Faults, duration: u64) -> Option<Setup> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    Some(Setup { faults, writes: true, ..Setup::new(images, 3, duration) })
}

fn outcome(setup: &Setup) -> Outcome {
    run(setup, &mut ()).unwrap_or_else(|error| panic!("{error}"))
}

fn hang(faults: Faults, at: u64, board: Board) -> Faults {
    faults.with(at, at, Fault::Hang(board))
}

#[test]
fn the_link_recovers_from_any_hang_within_15_cycles() {
    for clock in CLOCKS {
        for (nth, boards) in [&BOARDS[..1], &BOARDS[1..], &BOARDS].into_iter().enumerate() {
            let at = BEGINS + 1_300 * US * nth as u64;
            let faults = boards.iter().fold(Faults::none(), |faults, board| hang(faults, at, *board));
            let Some(setup) = setup(faults, at + AFTER) else { return };
            let Outcome { report, verdict, .. } = outcome(&Setup { clock, ..setup });
            assert_eq!(report.violations, [""; 0], "{boards:?} on the {clock} clock");
            let faults = verdict.figures.faults;
            assert_eq!(faults.invalid_shown_valid, 0);
            let hangs = |board| (format!("hang {}", name_of(board)), 1);
            assert_eq!(faults.injected, boards.iter().copied().map(hangs).collect());
            let cycles = faults.max_recovery_cycles.unwrap_or_else(|| panic!("{boards:?}: no recovery was measured"));
            assert!((1..=15).contains(&cycles), "{boards:?} on the {clock} clock: {cycles} cycles");
        }
    }
}

/// Returns the longest time, ns, from the death of a task to the restart of its board.
const fn bitten_within(board: Board) -> u64 {
    bounds::CHECKED_IN[Board::Horus as usize]
        + match board {
            Board::Horus => bounds::WATCHDOG_LONGEST,
            Board::Dpr => bounds::DPR_WATCHDOG_LONGEST,
        }
}

#[test]
fn no_task_of_a_board_that_does_not_run_is_dead() {
    for board in BOARDS {
        for after in [0, 500 * US, 2 * MS, 8 * MS, 60 * MS] {
            for power in [PowerFault::Watchdog, PowerFault::Off(1)] {
                let until = if power == PowerFault::Watchdog { BEGINS } else { BEGINS + 10 * MS };
                let at = BEGINS + after;
                let faults = Faults::none().with(BEGINS, until, Fault::Power(board, power));
                let Some(setup) = setup(faults.with(at, at, Fault::DeadTask(board, 0)), at + AFTER) else { return };
                let Outcome { report, verdict, .. } = outcome(&setup);
                assert_eq!(report.violations, [""; 0], "{board:?}, {after} ns after {power:?}");
                let dead = verdict.figures.faults.injected.keys().any(|name| name.starts_with("dead task"));
                assert_eq!(dead, after == 60 * MS, "{board:?}, {after} ns after {power:?}");
            }
        }
    }
}

#[test]
fn a_dead_task_makes_the_watchdog_bite_and_the_link_recovers() {
    let mut wrong = vec![];
    for board in BOARDS {
        for (task, (name, _)) in (0_u8..).zip(tasks_of(board)) {
            let at = BEGINS + 430 * US * u64::from(task);
            let faults = Faults::none().with(at, at, Fault::DeadTask(board, task));
            let Some(setup) = setup(faults, at + AFTER) else { return };
            let mut bench: Bench = Bench::new(&setup).unwrap();
            bench.run_to(setup.duration_ns, setup.threads);
            let (resets, others) = match board {
                Board::Horus => (bench.horus().resets().to_vec(), bench.dpr().resets().len()),
                Board::Dpr => (bench.dpr().resets().to_vec(), bench.horus().resets().len()),
            };
            let latest = at + bitten_within(board);
            let in_time = matches!(resets[..], [ResetAt { at: bitten, cause: Reset::Watchdog(_) }]
                if (at..=latest).contains(&bitten));
            let Verdict { violations, figures, .. } = bench.finish(setup.duration_ns).verdict;
            let cycles = figures.faults.max_recovery_cycles.unwrap_or(0);
            if !in_time || others > 0 || !violations.is_empty() || !(1..=15).contains(&cycles) {
                let words: Vec<String> = violations.iter().map(ToString::to_string).collect();
                wrong.push(format!("{board:?} {name} at {at}: {resets:?}, {cycles} cycles, {words:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_dead_task_ends_in_a_restart_beside_any_flight_controller() {
    for (nth, conduct) in (0..).zip(Conduct::ALL) {
        let at = BEGINS + 370 * US * nth;
        let dead = Fault::DeadTask(Board::Dpr, 2 + (nth % 3) as u8);
        let faults = Faults::none().with(at, at, dead.clone());
        let faults = faults.with(at - 20 * MS, at + 200 * MS, Fault::FlightController(conduct));
        let Some(setup) = setup(faults, at + AFTER) else { return };
        assert_eq!(outcome(&setup).report.violations, [""; 0], "{dead:?} beside {conduct:?}");
    }
}

#[test]
fn link_status_says_that_the_watchdog_has_restarted_a_dpr_that_hung() {
    let Some(setup) = setup(hang(Faults::none(), BEGINS, Board::Dpr), BEGINS + AFTER) else { return };
    let mut bench: Bench = Bench::new(&setup).unwrap();
    bench.keep_log();
    bench.run_to(setup.duration_ns, Threads::Two);
    let [ResetAt { at, cause: Reset::Watchdog("WDT") }] = *bench.dpr().resets() else {
        panic!("{:?}", bench.dpr().resets())
    };
    assert!((BEGINS + 50 * MS..=BEGINS + bounds::DPR_WATCHDOG_LONGEST).contains(&at), "{at}");
    let log = bench.finish(setup.duration_ns).log;
    let said = log.events.iter().rev().find_map(|event| match &event.what {
        What::Transaction { miso, .. } => {
            LinkStatus::verify(miso.get(..LinkStatus::SIZE)?).ok().map(LinkStatus::values)
        }
        _ => None,
    });
    assert_eq!(said.and_then(|link| link.status.reset_reason()), Some(ResetReason::Watchdog));
}

/// Returns for each profile of HORUS its instant (ns), whether GPS3 is excluded, and the status of Reported-Position.
fn sent(log: &bench_judge::Log) -> Vec<(u64, bool, ReportedStatus)> {
    let of = |payload: &[u8]| {
        let [reported, gps3] = [0, 3].map(|object| Profile::<3>::place(object).and_then(|place| payload.get(place)));
        let gps3 = GpsObject::verify(gps3?, Identifier::gps(3)).ok()?;
        Some((gps3.status().excluded(), ReportedPosition::verify(reported?).ok()?.status()))
    };
    let frames = log.events.iter().filter_map(|event| match &event.what {
        What::Sent { bytes, whole: true, .. } => of(&bytes[1..]).map(|(excluded, status)| (event.at, excluded, status)),
        _ => None,
    });
    frames.collect()
}

// Shows VOTE-9.
#[test]
fn a_receiver_excluded_before_the_watchdog_bites_is_still_excluded_after_it() {
    let off = Fault::Receiver(2, ReceiverFault::Offset { north: 200, east: 0, up: 0 });
    let faults = hang(Faults::none().with(0, u64::MAX, off), BEGINS + 300 * MS, Board::Horus);
    let Some(setup) = setup(faults, BEGINS + 300 * MS + AFTER) else { return };
    let mut bench: Bench = Bench::new(&setup).unwrap();
    bench.keep_log();
    bench.run_to(setup.duration_ns, Threads::Two);
    let [ResetAt { at, cause: Reset::Watchdog("IWDG") }] = *bench.horus().resets() else {
        panic!("{:?}", bench.horus().resets())
    };
    let finished = bench.finish(setup.duration_ns);
    assert_eq!(finished.verdict.violations, []);
    let sent = sent(&finished.log);
    let restarted = sent.partition_point(|(sent, ..)| *sent < at);
    let (_, excluded, before) = sent[restarted - 1];
    assert!(excluded && before.state() == Some(HorusState::Monitoring), "{before:?}");
    assert_eq!(before.reset_reason(), Some(ResetReason::PowerOn));
    // No receiver has sent a message since the restart. So the exclusion is from before the restart, and HORUS has kept
    // it.
    let (_, excluded, after) = sent[restarted];
    assert!(excluded && !after.position_valid(), "{after:?}");
    assert_eq!((after.state(), after.reset_reason()), (Some(HorusState::Starting), Some(ResetReason::Watchdog)));
    assert!(sent[restarted..].iter().all(|(_, excluded, _)| *excluded), "it never agrees");
}

#[test]
fn after_its_supply_was_off_horus_excludes_nobody_until_it_votes() {
    let off = Fault::Receiver(2, ReceiverFault::Offset { north: 200, east: 0, up: 0 });
    let (from, to) = (BEGINS + 300 * MS, BEGINS + 340 * MS);
    let faults = Faults::none().with(0, u64::MAX, off);
    let faults = faults.with(from, to, Fault::Power(Board::Horus, PowerFault::Off(3)));
    let Some(setup) = setup(faults, to + AFTER) else { return };
    let mut bench: Bench = Bench::new(&setup).unwrap();
    bench.keep_log();
    bench.run_to(setup.duration_ns, Threads::Two);
    let finished = bench.finish(setup.duration_ns);
    assert_eq!(finished.verdict.violations, []);
    let sent = sent(&finished.log);
    let (_, excluded, status) = sent[sent.partition_point(|(sent, ..)| *sent < to)];
    assert_eq!((excluded, status.reset_reason()), (false, Some(ResetReason::PowerOn)));
    assert!(sent.last().is_some_and(|(_, excluded, _)| *excluded), "it is outvoted again");
}

/// Returns the seed of a sag to a voltage at which RAM keeps its contents (1.4 V), but the board reports a power-on
/// (below 1.6 V).
fn forgetful_sag() -> u64 {
    let forgets = |shape: &u64| {
        let volts: Vec<u32> = power::shape(*shape).into_iter().map(|(_, volts)| volts).collect();
        let lowest = *volts.iter().min().unwrap();
        let falls = volts.iter().position(|volts| *volts == lowest).unwrap();
        (1_400_000..1_600_000).contains(&lowest)
            && volts[..falls].is_sorted_by(|one, next| one >= next)
            && volts[falls..].is_sorted()
    };
    (0..).find(forgets).unwrap()
}

#[test]
fn power_on_clears_the_exclusions_even_if_its_start_is_cut_off() {
    let off = Fault::Receiver(2, ReceiverFault::Offset { north: 200, east: 0, up: 0 });
    let (shape, from) = (forgetful_sag(), BEGINS + 300 * MS);
    let to = from + power::sag_length(shape);
    let sag = Fault::Power(Board::Horus, PowerFault::Sag(shape));
    let faults = Faults::none().with(0, u64::MAX, off).with(from, to, sag);
    let Some(setup) = setup(faults, to + 1_000 * MS + AFTER) else { return };
    let run = |hangs: Option<u64>| {
        let mut bench: Bench = Bench::new(&setup).unwrap();
        bench.keep_log();
        hangs.iter().for_each(|at| bench.add_faults(&hang(Faults::none(), *at, Board::Horus)));
        bench.run_to(setup.duration_ns, Threads::Two);
        let resets = bench.horus().resets().to_vec();
        (resets, bench.finish(setup.duration_ns))
    };
    let (resets, _) = run(None);
    let [ResetAt { at, cause: Reset::PowerOn }] = *resets else { panic!("{resets:?}") };
    for after in [WATCHDOG_STARTS, MS, 5 * MS, 10 * MS, 15 * MS] {
        let (resets, finished) = run(Some(at + after));
        let [_, ResetAt { at: bitten, cause: Reset::Watchdog("IWDG") }] = *resets else { panic!("{resets:?}") };
        assert_eq!(finished.verdict.violations, [], "{after}");
        let sent = sent(&finished.log);
        let (before, then) = (sent.partition_point(|(sent, ..)| *sent < at), &sent[..]);
        assert!(then[before - 1].1, "it was excluded");
        let (first, excluded, status) = then[before];
        assert_eq!((excluded, status.reset_reason()), (false, Some(ResetReason::Watchdog)), "{after}");
        assert!(first > bitten && then.last().is_some_and(|(_, excluded, _)| *excluded), "it is outvoted again");
    }
}

#[test]
fn a_run_with_hangs_does_not_depend_on_the_number_of_threads() {
    let faults = hang(hang(Faults::none(), BEGINS, Board::Horus), BEGINS + 7 * MS, Board::Dpr);
    let Some(setup) = setup(faults, BEGINS + AFTER) else { return };
    let on = |threads| {
        let mut bench: Bench = Bench::new(&setup).unwrap();
        bench.keep_log();
        bench.run_to(setup.duration_ns, threads);
        bench.finish(setup.duration_ns).log
    };
    assert!(on(Threads::One) == on(Threads::Two));
}

#[test]
fn a_board_that_hangs_is_also_restarted_by_its_pin_or_supply() {
    for board in BOARDS {
        for power in [PowerFault::Pin, PowerFault::BrownOut, PowerFault::Off(3)] {
            let at = BEGINS + 20 * MS;
            let until = if power.lasts() { at + 40 * MS } else { at };
            let faults = hang(Faults::none(), BEGINS, board).with(at, until, Fault::Power(board, power));
            let Some(setup) = setup(faults, until + AFTER) else { return };
            let report = outcome(&setup).report;
            assert_eq!(report.violations, [""; 0], "{board:?} {power:?}");
        }
    }
}

#[test]
fn so_long_after_its_start_each_boards_watchdog_runs() {
    for clock in CLOCKS {
        for board in BOARDS {
            let at = BEGINS + WATCHDOG_STARTS;
            let faults = hang(Faults::none().with(BEGINS, BEGINS, Fault::Power(board, PowerFault::Pin)), at, board);
            // HORUS's watchdog takes about 0.5 s if HORUS hangs before the first feed.
            let Some(setup) = setup(faults, at + 500 * MS + AFTER) else { return };
            let report = outcome(&Setup { clock, ..setup }).report;
            assert_eq!(report.violations, [""; 0], "{board:?} on the {clock} clock");
        }
    }
}

/// The DPR hangs at every instant of a publication, and the flight controller reads just after the image has expired.
// Shows IMG-5.
#[test]
fn nothing_expired_is_read_if_the_dpr_hangs_during_a_publication() {
    let Some(setup) = setup(Faults::none(), BEGINS + 45 * MS) else { return };
    let mut bench: Bench = Bench::new(&setup).unwrap();
    bench.keep_log();
    bench.run_to(BEGINS - 5 * MS, Threads::Two);
    let log = |bench: Bench| bench.finish(BEGINS + 45 * MS).log;
    let mut healthy = bench.clone();
    healthy.run_to(BEGINS + 20 * MS, Threads::Two);
    let rose = |event: &bench_judge::Event| matches!(event.what, What::Fresh { high: true, .. });
    let rise = log(healthy).events.iter().find(|event| rose(event) && event.at > BEGINS).unwrap().at;
    let mut read = 0;
    for step in 0..240 {
        let at = rise - 30 * US + step * 200;
        let mut bench = bench.clone();
        let silent = Fault::FlightController(Conduct::Silent);
        let wait = if step % 2 == 0 { 10 * MS } else { 27 * MS };
        bench.add_faults(&hang(Faults::none().with(BEGINS - 4 * MS, at + wait, silent), at, Board::Dpr));
        bench.run_to(BEGINS + 45 * MS, Threads::Two);
        let finished = bench.finish(BEGINS + 45 * MS);
        assert_eq!(finished.verdict.violations, [], "{step}");
        let after = |event: &&bench_judge::Event| event.at > at;
        read += usize::from(finished.log.events.iter().filter(after).any(|event| match &event.what {
            What::Transaction { miso, .. } => miso.iter().any(|byte| *byte != 0xFF),
            _ => false,
        }));
    }
    assert!((20..=120).contains(&read), "{read} were readable in time");
}
