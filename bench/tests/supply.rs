//! Tests sagging supplies: the boards react correctly, and no object that HORUS never sent is shown as valid.
//!
//! `SUPPLY_SHAPES=1000 cargo test -p bench --test all -- --nocapture shapes` tries 1000 drawn courses of voltage.

use crate::{boards, reader};

use bench::faults::{Board, Fault, Faults, PowerFault, Rng, power};
use bench::sim::{Images, Setup, run};
use boards::image;
use emulator_node::Node;
use emulator_part::Reset;
use firmware_common::last_stop::Cause;
use reader::{MS, US, field_on, transact};
use st25r3916_model::AirEvent;
use stm32f429::{Oscillators, Stm32f429};

fn run_horus(node: &mut Node<bench::boards::Horus>, to: u64) -> Vec<(u64, AirEvent)> {
    let mut air = vec![];
    while node.now() < to {
        node.advance(to);
        air.extend(node.board_mut(|board| board.front_end.take_air()));
    }
    air
}

fn run_dpr(node: &mut Node<bench::boards::Dpr>, to: u64) {
    while node.now() < to {
        node.advance(to);
        node.board_mut(|board| board.front_end.take_air());
    }
}

fn log<B: emulator_node::Board>(node: &mut Node<B>) -> Vec<String> {
    node.take_log().iter().map(ToString::to_string).collect()
}

fn names(lines: &[String], cause: Cause) -> bool {
    lines.iter().any(|line| line.contains(cause.name()))
}

// Shows SAFE-11.
#[test]
fn horus_with_the_option_bytes_as_delivered_stops_and_says_why() {
    let Some(mut node) = boards::horus_part(Stm32f429::new(Oscillators::default())) else { return };
    let air = run_horus(&mut node, 1_000 * MS);
    assert!(!air.iter().any(|(_, event)| matches!(event, AirEvent::FieldOn)), "{air:?}");
    let lines = log(&mut node);
    assert!(names(&lines, Cause::BrownOutLevel), "{lines:?}");
    assert!(lines.iter().any(|line| line.contains("cargo xtask flash horus")), "{lines:?}");
    let resets = node.resets();
    assert!(resets.len() >= 4 && resets.iter().all(|reset| reset.cause == Reset::Watchdog("IWDG")), "{resets:?}");
}

#[test]
fn a_falling_supply_switches_horuss_field_off_before_it_resets_the_part() {
    let Some(mut node) = boards::horus() else { return };
    run_horus(&mut node, 100 * MS);
    node.supply(2_950_000, 0);
    let air = run_horus(&mut node, 125 * MS);
    assert!(!air.iter().any(|(_, event)| matches!(event, AirEvent::FieldOff)), "not yet: {air:?}");
    node.supply(2_949_999, 0);
    let air = run_horus(&mut node, 126 * MS);
    let off = air.iter().find(|(_, event)| matches!(event, AirEvent::FieldOff)).expect("field off").0;
    assert!(off <= 125 * MS + 20 * US, "after {} ns", off - 125 * MS);
    node.supply(2_749_999, 0);
    assert!(!node.is_powered());
    run_horus(&mut node, 140 * MS);
    // HORUS's microcontroller starts at 2.85 V, but the firmware stops until the supply is higher.
    node.supply(2_850_000, 0);
    assert!(node.is_powered());
    assert_eq!(node.resets().last().map(|reset| reset.cause), Some(Reset::BrownOut));
    let air = run_horus(&mut node, 400 * MS);
    assert!(!air.iter().any(|(_, event)| matches!(event, AirEvent::FieldOn)), "{air:?}");
    node.supply(3_300_000, 0);
    let air = run_horus(&mut node, 700 * MS);
    assert!(air.iter().any(|(_, event)| matches!(event, AirEvent::FieldOn)), "{air:?}");
    let lines = log(&mut node);
    assert!(lines.iter().any(|line| line.contains("the last stop: supply too low")), "{lines:?}");
}

#[test]
fn a_falling_supply_takes_the_dprs_image_away_and_is_named() {
    let Some(mut node) = boards::dpr() else { return };
    field_on(&mut node);
    run_dpr(&mut node, 60 * MS);
    let silent = |node: &mut Node<bench::boards::Dpr>| transact(node, 32, 0).iter().all(|byte| *byte == 0xFF);
    node.supply(2_565_000, 0);
    assert!(!silent(&mut node) || !silent(&mut node), "not yet");
    node.supply(2_564_999, 0);
    let now = node.now();
    run_dpr(&mut node, now + 50 * US);
    assert!(silent(&mut node) && silent(&mut node));
    // The low voltage stops the DPR once more when it starts after the watchdog's reset.
    let now = node.now();
    run_dpr(&mut node, now + 300 * MS);
    assert!(silent(&mut node) && silent(&mut node));
    node.supply(1_569_999, 0);
    assert!(!node.is_powered());
    node.supply(3_000_000, 0);
    assert_eq!(node.resets().last().map(|reset| reset.cause), Some(Reset::BrownOut));
    let now = node.now();
    run_dpr(&mut node, now + 60 * MS);
    assert!(!silent(&mut node) || !silent(&mut node));
    let lines = log(&mut node);
    assert!(lines.iter().any(|line| line.contains("the last stop: supply too low")), "{lines:?}");
}

#[test]
fn a_supply_that_fails_while_the_dpr_logs_causes_no_panic() {
    let Some(mut warm) = boards::dpr() else { return };
    field_on(&mut warm);
    run_dpr(&mut warm, 1_000 * MS);
    let mut interrupted = 0;
    // The DPR writes a line to its log once a second. The supply falls around the end of that line.
    let has_line = |after: &u64| {
        let mut node = warm.clone();
        log(&mut node);
        run_dpr(&mut node, after * US);
        !log(&mut node).is_empty()
    };
    let line = (1_000_000..2_000_000).step_by(500).find(has_line).expect("a line each second");
    let line = (line - 500..=line).find(has_line).unwrap_or(line);
    for after in (line - 50..line + 50).step_by(2) {
        let mut node = warm.clone();
        run_dpr(&mut node, after * US);
        node.supply(2_564_999, 0);
        run_dpr(&mut node, after * US + 10 * MS);
        assert_eq!(node.take_findings(), [], "{after} µs after the start");
        node.supply(3_000_000, 0);
        run_dpr(&mut node, 1_300 * MS);
        let lines = log(&mut node);
        assert!(lines.iter().any(|line| line.contains("the last stop: supply too low")), "{after} µs: {lines:?}");
        interrupted += u32::from(!lines.iter().any(|line| line.contains("supply: supply too low")));
    }
    assert!((1..50).contains(&interrupted), "of 50 falls, {interrupted} interrupted a line");
}

#[test]
fn ram_is_kept_above_1_4_v_and_lost_without_a_supply() {
    let Some(mut node) = boards::horus() else { return };
    run_horus(&mut node, 100 * MS);
    // The bench clears the control block of the log at each start, as a debug probe does.
    let block = usize::try_from(node.address_of("_SEGGER_RTT").unwrap() - 0x2000_0000).unwrap();
    let ram = |node: &Node<bench::boards::Horus>| {
        let mut bytes = vec![0; 192 << 10];
        node.read(0x2000_0000, &mut bytes).unwrap();
        bytes[block..block + 48].fill(0);
        bytes
    };
    let mut lost = |lowest| {
        let before = ram(&node);
        node.supply(lowest, 7);
        node.supply(3_300_000, 7);
        ram(&node).iter().zip(before).filter(|(now, before)| *now != before).count()
    };
    assert_eq!(lost(1_400_000), 0);
    let half = lost(1_399_999);
    assert!((80 << 10..112 << 10).contains(&half), "{half}");
    assert!(lost(0) > 80 << 10);
}

/// Runs the link with `count` sags of HORUS's supply, the DPR's, or both. Returns the number of sags.
fn sagging(seed: u64, count: u64) -> Option<u64> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    let mut rng = Rng::stream(seed, 0x5A6);
    let (mut at, mut faults) = (303 * MS, Faults::none());
    for _ in 0..count {
        let hit: &[Board] = match rng.below(3) {
            0 => &[Board::Horus],
            1 => &[Board::Dpr],
            _ => &[Board::Horus, Board::Dpr],
        };
        let (mut end, shape) = (at, rng.word());
        for board in hit {
            let shape = if rng.one_in(2) { shape } else { rng.word() };
            let from = at + rng.between(0, 10 * MS);
            let until = from + power::sag_length(shape);
            faults = faults.with(from, until, Fault::Power(*board, PowerFault::Sag(shape)));
            end = end.max(until);
        }
        at = end + rng.between(500 * MS, 520 * MS);
    }
    let setup = Setup { seed, faults, ..Setup::new(images, 3, at) };
    let report = run(&setup, &mut ()).unwrap_or_else(|error| panic!("{error}")).report;
    assert_eq!(report.violations, [""; 0], "seed {seed}");
    assert_eq!(report.faults.invalid_shown_valid, 0, "seed {seed}");
    Some(report.faults.injected.iter().filter(|(name, _)| name.ends_with("sag")).map(|(_, count)| *count).sum())
}

#[test]
fn no_drawn_shape_shows_an_object_that_horus_never_computed() {
    let wanted = std::env::var("SUPPLY_SHAPES").map_or(16, |count| count.parse().expect("a number of shapes"));
    let (mut sags, mut seed) = (0, 1);
    while sags < wanted {
        let Some(more) = sagging(seed, 10) else { return };
        assert!(more >= 10, "seed {seed}: {more}");
        (sags, seed) = (sags + more, seed + 1);
        eprintln!("{sags} shapes: no violation, nothing invalid shown as valid");
    }
}
