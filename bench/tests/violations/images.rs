//! Changes release programs at addresses that depend on the build.

use std::path::PathBuf;

use bench::boards::Powered;
use bench::boards::{Dpr, Horus};
use bench::faults::image::{Change, Recording, To, rewrite};
use bench::faults::{Board, Episode, Fault, ImageFault};
use bench::sim::Setup;
use emulator_node::{Firmware, Node};
use nrf52840::{Nrf52840, Settings};
use st25r3916_model::{Chip, Config};
use stm32f429::{Oscillators, Stm32f429};

use super::MS;
use super::boards::RAM_TEST;

/// The time from the start, ns, in which the stores of a board are recorded.
const RECORDED: u64 = RAM_TEST + 30 * MS;
/// The number of bytes of flash in which a patch's changes are searched for: more than a program and its stubs have.
const FLASH: usize = 0x4_4000;
pub(super) const ALWAYS: (u64, u64) = (0, u64::MAX);
const WAIT: [u8; 2] = 0xBF30_u16.to_le_bytes();
const NOTHING: [u8; 2] = 0xBF00_u16.to_le_bytes();

fn image(setup: &Setup, board: Board) -> Firmware {
    let path = match board {
        Board::Horus => &setup.images.horus,
        Board::Dpr => &setup.images.dpr,
    };
    Firmware::read(path).unwrap()
}

fn chip() -> Chip {
    Chip::new(Config { vdd_mv: 5000, ..Config::default() })
}

fn horus(setup: &Setup) -> Node<Horus> {
    let board = Horus::new(chip(), setup.gps, false);
    let part = Stm32f429::new(Oscillators::default()).with_brown_out_level_3();
    Node::new(part, board, &image(setup, Board::Horus)).unwrap()
}

fn dpr(setup: &Setup) -> Node<Dpr> {
    Node::new(Nrf52840::new(Settings::default()), Dpr::new(chip(), false), &image(setup, Board::Dpr)).unwrap()
}

/// Patches the program of `board` between `at` and `until` (ns) so that it stores other values to registers.
pub(super) fn stores(setup: &mut Setup, board: Board, (at, until): (u64, u64), changes: &[Change]) {
    let patches = match board {
        Board::Horus => patches(horus(setup), changes),
        Board::Dpr => patches(dpr(setup), changes),
    };
    for (address, bytes) in patches {
        let fault = Fault::Image(board, ImageFault::Patch { address, bytes, sealed: false });
        setup.faults.add(Episode { at, until, fault });
    }
}

/// Returns the address and the new bytes of each place in flash that [`rewrite`] has changed.
fn patches<B: Powered>(mut node: Node<B>, changes: &[Change]) -> Vec<(u32, Vec<u8>)> {
    let recording = Recording::of(&mut node.clone(), RECORDED, |node| {
        node.board_mut(|board| board.front_end().take_air());
    });
    let first = node.address_of("__vector_table").unwrap();
    let read = |node: &Node<B>| {
        let mut flash = vec![0; FLASH];
        node.read(first, &mut flash).unwrap();
        flash
    };
    let before = read(&node);
    rewrite(&mut node, &recording, changes).unwrap();
    let after = read(&node);
    let mut patches: Vec<(u32, Vec<u8>)> = vec![];
    for (offset, (before, after)) in before.iter().zip(after).enumerate() {
        if *before == after {
            continue;
        }
        let address = u32::try_from(first).unwrap() + u32::try_from(offset).unwrap();
        match patches.last_mut() {
            Some((start, bytes)) if *start + bytes.len() as u32 == address => bytes.push(after),
            _ => patches.push((address, vec![after])),
        }
    }
    // In this order the stubs are written before the branches that lead to them.
    patches.reverse();
    patches
}

pub(super) fn awake(setup: &mut Setup, board: Board, at: u64) {
    let firmware = image(setup, board);
    let idle = firmware.functions_called("idle").next().expect("the task idle");
    let read = |node: &dyn Fn(u64, &mut [u8])| {
        let mut code = vec![0; 0x800];
        node(idle & !1, &mut code);
        let place = code.as_chunks::<2>().0.iter().position(|half| *half == WAIT).expect("idle waits for an interrupt");
        (idle & !1) + 2 * place as u64
    };
    let address = match board {
        Board::Horus => {
            let node = horus(setup);
            read(&|address, bytes| node.read(address, bytes).unwrap())
        }
        Board::Dpr => {
            let mut node = dpr(setup);
            // The code of the task is in RAM only after the start.
            while node.now() < RECORDED {
                node.advance(RECORDED);
            }
            read(&|address, bytes| node.read(address, bytes).unwrap())
        }
    };
    let address = u32::try_from(address).unwrap();
    let fault = Fault::Image(board, ImageFault::Patch { address, bytes: NOTHING.to_vec(), sealed: false });
    setup.faults.add(Episode { at, until: u64::MAX, fault });
}

pub(super) fn without_telemetry(setup: &mut Setup, board: Board) {
    let (path, symbol) = match board {
        Board::Horus => (&mut setup.images.horus, "HORUS_TELEMETRY"),
        Board::Dpr => (&mut setup.images.dpr, "DPR_TELEMETRY"),
    };
    let mut elf = std::fs::read(&*path).unwrap();
    let name = format!("\0{symbol}\0");
    let places: Vec<usize> =
        (0..elf.len() - name.len()).filter(|&place| elf[place..].starts_with(name.as_bytes())).collect();
    assert!(!places.is_empty(), "no symbol {symbol}");
    for place in places {
        elf[place + 1] = b'X';
    }
    *path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("without-{symbol}.elf"));
    std::fs::write(&*path, elf).unwrap();
}

pub(super) const fn bits(address: u32, mask: u32, value: u32) -> Change {
    Change { address, to: To::Bits { mask, value } }
}

pub(super) const fn instead(address: u32, of: u32, value: u32) -> Change {
    Change { address, to: To::Instead { of, value } }
}

pub(super) const fn never(address: u32) -> Change {
    Change { address, to: To::Nothing }
}
