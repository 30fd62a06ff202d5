//! Measures how long a flipped bit in memory stays undetected on both boards. The test waits until the board reports
//! the flip to the flight controller, at its antenna or in its log, and compares the time with the limits in the
//! firmwares' modules `integrity`.

use crate::{boards, reader};

use bench::boards::{Dpr, Horus};
use bench::faults::Upset;
use cortex_m4::{Cost, Pessimistic};
use dpr_fw::integrity as dpr;
use emulator_node::{Board, FromOutside, Node};
use emulator_part::{Part, StuckBit};
use firmware_common::{last_stop::Cause, start_test};
use horus_tx_fw::integrity as horus;
use nrf52840::Settings;
use profile::{LinkStatus, ReportedPosition, ReportedStatus, ResetReason};
use reader::{MS, US, field_on, frame_ns, payload, send, transact, view};
use st25r3916_model::AirEvent;
use stm32f429::Oscillators;

fn run<B: Board>(node: &mut Node<B>, ns: u64) {
    let end = node.now() + ns;
    while node.now() < end {
        node.advance(end);
    }
}

/// Runs in steps of `step` ns until `done` returns true, for at most `within` ns. Returns the time that has passed, ns.
fn until<B: Board>(node: &mut Node<B>, step: u64, within: u64, mut done: impl FnMut(&mut Node<B>) -> bool) -> u64 {
    let from = node.now();
    while node.now() < from + within {
        if done(node) {
            return node.now() - from;
        }
        run(node, step);
    }
    panic!("not noticed within {} ms", within / MS);
}

fn address<B: Board>(node: &Node<B>, symbol: &str) -> u32 {
    u32::try_from(node.address_of(symbol).unwrap()).unwrap()
}

fn dpr_counter(node: &Node<Dpr>, name: &str) -> u32 {
    let place = dpr_fw::telemetry::Telemetry::NAMES.iter().position(|it| *it == name).unwrap();
    boards::counter(node, "DPR_TELEMETRY", 4 * place)
}

/// Reads the status bits of Link-Status, with a second transaction if the DPR is busy in the first.
fn link(node: &mut Node<Dpr>) -> profile::LinkStatusBits {
    let read = (0..2).find_map(|_| {
        let read = transact(node, LinkStatus::SIZE, 0);
        LinkStatus::verify(&read).ok().map(LinkStatus::status)
    });
    read.expect("Link-Status is readable")
}

fn last_stop<B: Board>(node: &mut Node<B>) -> String {
    node.take_log().iter().map(ToString::to_string).find(|line| line.contains("the last stop: ")).unwrap_or_default()
}

/// Returns the address of the readable image, which its Link-Status identifies.
fn shown(node: &mut Node<Dpr>) -> u32 {
    let read = transact(node, LinkStatus::SIZE, 0);
    let start = address(node, "__sbss");
    let mut statics = vec![0; (address(node, "__ebss") - start) as usize];
    node.read(u64::from(start), &mut statics).unwrap();
    let found = statics.windows(read.len()).position(|window| window == read).expect("the image that was read");
    start + u32::try_from(found).unwrap()
}

/// Sends a frame of each of these cycles, one every 10 ms from now on.
fn cycles(node: &mut Node<Dpr>, from: u32, to: u32) {
    let begin = node.now();
    for cycle in from..to {
        let at = begin + u64::from(cycle - from) * 10 * MS;
        run(node, at - node.now());
        send(node, at, &payload(10 * cycle));
    }
    run(node, frame_ns() + 300 * US);
}

#[test]
fn a_bit_that_flips_in_the_shown_image_withdraws_it_in_time() {
    for (byte, bit) in [(3, 0), (40, 7), (100, 3), (170, 1), (275, 5)] {
        let Some(mut node) = boards::dpr() else { return };
        field_on(&mut node);
        run(&mut node, 40 * MS);
        cycles(&mut node, 1, 8);
        assert_eq!(view(&mut node).valid.len(), 4, "byte {byte}");
        let faults = dpr_counter(&node, "image_faults");
        assert_eq!(faults, 0);
        // The image stays readable until the next deadline, 12.5 ms after the last frame's end.
        let address = shown(&mut node) + byte;
        Upset::Ram { address, bit }.apply(&mut node).unwrap();
        let (mut silent, began) = (false, node.now());
        let within = u64::from(dpr::IMAGE_DETECT_US) * US;
        let took = until(&mut node, 500 * US, within, |node| {
            let read = view(node);
            silent |= read.valid.is_empty();
            read.link.is_some_and(|link| link.status.ram_fault())
        });
        assert!(silent || view(&mut node).valid.is_empty());
        eprintln!("byte {byte}: RAM fault shown after {took} ns from {began}");
        assert!(dpr_counter(&node, "image_faults") >= 1);
    }
}

#[test]
fn while_nothing_flips_nothing_is_found_and_the_passes_go_on() {
    let Some(mut node) = boards::dpr() else { return };
    run(&mut node, 9_000 * MS);
    let faults = ["flash_faults", "image_faults", "ram_errors", "last_stop"].map(|name| dpr_counter(&node, name));
    assert_eq!(faults, [0; 4]);
    assert!(dpr_counter(&node, "flash_passes") >= 1);
    let status = link(&mut node);
    assert!(!status.ram_fault() && !status.flash_fault());
}

#[test]
fn a_bit_that_flips_in_the_dprs_flash_withholds_all_objects() {
    let Some(mut node) = boards::dpr() else { return };
    field_on(&mut node);
    run(&mut node, 40 * MS);
    // The first address is in an unused vector, which the memory protection does not let the processor read.
    let table = Upset::Flash { address: 0xFC, bit: 2 };
    let last = Upset::Flash { address: address(&node, "__program_crc") - 4, bit: 30 };
    let within = u64::from(dpr::FLASH_DETECT_US) * US;
    let mut cycle = 1;
    for upset in [table, last] {
        upset.apply(&mut node).unwrap();
        let took = until(&mut node, 50 * MS, within, |node| link(node).flash_fault());
        eprintln!("{upset}: flash fault shown after {} ms", took / MS);
        cycles(&mut node, cycle, cycle + 8);
        let read = view(&mut node);
        assert!(read.valid.is_empty() && read.link.unwrap().status.flash_fault(), "{upset}");
        upset.apply(&mut node).unwrap();
        until(&mut node, 50 * MS, within, |node| !link(node).flash_fault());
        cycles(&mut node, cycle + 1_000, cycle + 1_008);
        assert_eq!(view(&mut node).valid.len(), 4, "{upset}");
        cycle += 2_000;
    }
}

// Shows SAFE-9.
#[test]
fn a_flipped_bit_of_code_or_a_guard_word_stops_the_dpr() {
    let guards = ["_stack_end", "__guard_data", "__guard_bss", "__guard_uninit", "__guard_end"];
    for symbol in ["__ehot"].into_iter().chain(guards) {
        let Some(mut node) = boards::dpr() else { return };
        run(&mut node, 40 * MS);
        let (cause, within, at) = match symbol {
            // The last word of the code in RAM is part of a CRC table, so the firmware still runs with the flipped bit.
            "__ehot" => (Cause::CodeInRam, dpr::CODE_DETECT_US, address(&node, symbol) - 4),
            _ => (Cause::GuardWord, 2 * firmware_common::patrol::SLICE_US + 12_500, address(&node, symbol)),
        };
        Upset::Ram { address: at, bit: 4 }.apply(&mut node).unwrap();
        let silent = |node: &mut Node<Dpr>| transact(node, 8, 0).iter().all(|byte| *byte == 0xFF);
        // A busy DPR may answer one transaction with 0xFF, but not two.
        let took = until(&mut node, MS, u64::from(within) * US, |node| silent(node) && silent(node));
        eprintln!("{symbol}: silent after {} us", took / US);
        let restarts = node.now() + 200 * MS;
        assert!(node.advance_to_restart(restarts), "{symbol}");
        node.take_log();
        run(&mut node, 60 * MS);
        let line = last_stop(&mut node);
        assert!(line.contains(cause.name()), "{symbol}: {line:?}");
        assert_eq!(dpr_counter(&node, "last_stop") >> 24, cause as u32, "{symbol}");
    }
}

fn stick<B: Board>(node: &mut Node<B>) {
    let address = address(node, "_stack_end") + 0x101;
    let mut byte = [0];
    node.read(u64::from(address), &mut byte).unwrap();
    let stuck = StuckBit { address, bit: 4, value: byte[0] >> 4 & 1 == 0 };
    assert!(node.input(|part, _, _| part.stick(Some(stuck))));
}

#[test]
fn a_stuck_bit_of_the_dprs_ram_is_shown_in_time() {
    let Some(mut node) = boards::dpr() else { return };
    run(&mut node, 3_000 * MS);
    assert_eq!((dpr_counter(&node, "ram_errors"), link(&mut node).ram_fault()), (0, false));
    stick(&mut node);
    let within = u64::from(dpr::RAM_DETECT_US) * US;
    let took = until(&mut node, 50 * MS, within, |node| link(node).ram_fault());
    eprintln!("the DPR's RAM: shown after {} ms", took / MS);
    assert!(dpr_counter(&node, "ram_errors") >= 1);
    for sticks in [true, false] {
        if !sticks {
            node.input(|part, _, _| part.stick(None));
        }
        node.restart(FromOutside::Pin);
        run(&mut node, 60 * MS);
        assert_eq!(link(&mut node).ram_fault(), sticks);
        assert_eq!(dpr_counter(&node, "ram_errors"), u32::from(sticks));
    }
}

/// Runs the board to the end of its memory test. Returns the time since power-on, µs.
fn tested_us<B: Board, C: Cost>(node: &mut Node<B, C>) -> u64 {
    let result = node.address_of("MEMORY_TEST").unwrap();
    while node.word(result) != Some(start_test::TESTED) {
        let to = node.now() + 50 * US;
        assert!(to < 100 * MS, "no result");
        node.advance(to);
    }
    node.now() / US
}

#[test]
fn the_memory_test_at_the_start_takes_at_most_its_stated_time() {
    const KIB: u32 = 1024;
    let Some(mut node) = boards::dpr_with::<Pessimistic>(Settings::default()) else { return };
    let took = tested_us(&mut node);
    eprintln!("the DPR's memory is tested {took} us after its start");
    assert!(took <= u64::from(start_test::longest_us(96 * KIB, start_test::DPR_CYCLES, 64)));
    let Some(mut node) = boards::horus_with::<Pessimistic>(Oscillators::default()) else { return };
    let took = tested_us(&mut node);
    eprintln!("HORUS's memory is tested {took} us after its start");
    assert!(took <= u64::from(start_test::longest_us(32 * KIB, start_test::HORUS_CYCLES, 16)));
}

fn run_horus(node: &mut Node<Horus>, ns: u64) -> Vec<(u64, AirEvent)> {
    let end = node.now() + ns;
    let mut air = vec![];
    while node.now() < end {
        node.advance(end);
        air.extend(node.board_mut(|board| board.front_end.take_air()));
    }
    air
}

fn said(air: &[(u64, AirEvent)]) -> ReportedStatus {
    let mut frames: Vec<Vec<u8>> = vec![];
    for (_, event) in air {
        match event {
            AirEvent::FrameStart(start) => frames.push(start.chunk.data.clone()),
            AirEvent::Bytes(chunk) => frames.last_mut().into_iter().for_each(|frame| frame.extend(&chunk.data)),
            _ => {}
        }
    }
    let status = |frame: &Vec<u8>| Some(ReportedPosition::verify(frame.get(1..65)?).ok()?.status());
    frames.iter().rev().find_map(status).expect("HORUS has sent a frame")
}

fn field_off(node: &mut Node<Horus>, within: u64) -> Option<u64> {
    let from = node.now();
    while node.now() < from + within {
        let air = run_horus(node, MS);
        if let Some((at, _)) = air.iter().find(|(_, event)| matches!(event, AirEvent::FieldOff)) {
            return Some(at - from);
        }
    }
    None
}

#[test]
fn a_stuck_bit_of_horuss_ram_switches_the_field_off_for_good() {
    let Some(mut node) = boards::horus() else { return };
    let air = run_horus(&mut node, 3_000 * MS);
    assert!(!air.iter().any(|(_, event)| matches!(event, AirEvent::FieldOff)));
    stick(&mut node);
    let took = field_off(&mut node, u64::from(horus::RAM_DETECT_US) * US).expect("the field goes off in time");
    eprintln!("HORUS's RAM: field off after {} ms", took / MS);
    node.take_log();
    let air = run_horus(&mut node, 1_000 * MS);
    assert!(!air.iter().any(|(_, event)| matches!(event, AirEvent::FieldOn)));
    let lines: Vec<String> = node.take_log().iter().map(ToString::to_string).collect();
    assert!(lines.iter().any(|line| line.contains("memory: RAM faulty")), "{lines:?}");
    node.input(|part, _, _| part.stick(None));
    let air = run_horus(&mut node, 500 * MS);
    assert!(air.iter().any(|(_, event)| matches!(event, AirEvent::FieldOn)));
    assert!(last_stop(&mut node).contains(Cause::Ram.name()));
}

// Shows SAFE-8.
#[test]
fn a_bit_that_flips_in_horus_memory_switches_the_field_off() {
    let guards = ["_stack_end", "__guard_data", "__guard_bss", "__guard_uninit", "__guard_end"];
    for symbol in ["__program_crc"].into_iter().chain(guards) {
        let Some(mut node) = boards::horus() else { return };
        let before = said(&run_horus(&mut node, 55 * MS));
        assert_eq!((before.memory_fault(), before.reset_reason()), (false, Some(ResetReason::PowerOn)), "{symbol}");
        let at = address(&node, symbol);
        let (upset, cause, within) = match symbol {
            "__program_crc" => {
                (Upset::Flash { address: at - 4, bit: 1 }, Cause::Flash, u64::from(horus::FLASH_DETECT_US) * US)
            }
            _ => (Upset::Ram { address: at + 4, bit: 31 }, Cause::GuardWord, u64::from(horus::GUARD_DETECT_US) * US),
        };
        upset.apply(&mut node).unwrap();
        let took = field_off(&mut node, within).unwrap_or_else(|| panic!("{symbol}: not noticed in time"));
        eprintln!("{symbol}: field off after {} us", took / US);
        upset.apply(&mut node).unwrap();
        let restarts = node.now() + 250 * MS;
        while !node.advance_to_restart(restarts) {
            assert!(node.now() < restarts, "{symbol}");
            node.board_mut(|board| board.front_end.take_air());
        }
        node.take_log();
        let after = said(&run_horus(&mut node, 60 * MS));
        assert_eq!((after.memory_fault(), after.reset_reason()), (true, Some(ResetReason::Watchdog)), "{symbol}");
        let line = last_stop(&mut node);
        assert!(line.contains(cause.name()), "{symbol}: {line:?}");
    }
}
