//! Both boards with the release programs, which `cargo xtask test` builds before these tests.

use std::path::{Path, PathBuf};

use bench::boards::{Dpr, Hold, Horus, SSI};
use cortex_m4::Cost;
use emulator_node::{Board, Firmware, Node};
use firmware_common::start_test;
use nrf52840::{Nrf52840, Settings};
use st25r3916_model::{Chip, Config};
use stm32f429::{Oscillators, Stm32f429};

/// Returns words that tell the user what is missing and, by `how`, how to get it. In CI these words are an error,
/// because nobody reads messages there.
pub(crate) fn verdict(ci: bool, missing: &str, how: &str) -> Result<String, String> {
    let words = format!("not run: {missing} ({how})");
    if ci { Err(words) } else { Ok(words) }
}

/// Prints that a test is not run because a file or a tool is missing.
///
/// # Panics
///
/// Panics if `CI` is set in the environment.
pub(crate) fn not_run(missing: &str, how: &str) {
    match verdict(std::env::var_os("CI").is_some(), missing, how) {
        Ok(words) => eprintln!("{words}"),
        Err(words) => panic!("{words}"),
    }
}

/// The advice for a missing program file.
const HOW: &str = "`cargo xtask test` builds the images and says in LINK_IMAGES where they are";

/// The path of an ELF file that was built for `receivers` receivers; `None` and a message if it is missing.
pub(crate) fn image(receivers: usize, name: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("LINK_IMAGES").map(PathBuf::from) else {
        not_run("LINK_IMAGES is not set", HOW);
        return None;
    };
    image_at(&folder.join(format!("gps-{receivers}")).join(name))
}

pub(crate) fn hold_image() -> Option<PathBuf> {
    image_at(&PathBuf::from(std::env::var_os("LINK_IMAGES")?).join("hold-fw.elf"))
}

fn image_at(path: &Path) -> Option<PathBuf> {
    if !path.is_file() {
        not_run(&format!("there is no image {}", path.display()), HOW);
        return None;
    }
    Some(path.to_owned())
}

/// The longest test of a board's RAM at its start, ns: the DPR's of 96 KiB at 64 MHz (`firmware_common::start_test`).
pub(crate) const RAM_TEST: u64 = {
    let horus = start_test::longest_us(32 << 10, start_test::HORUS_CYCLES, 16);
    let dpr = start_test::longest_us(96 << 10, start_test::DPR_CYCLES, 64);
    1_000 * if horus > dpr { horus } else { dpr } as u64
};

fn chip() -> Chip {
    Chip::new(Config { vdd_mv: 5000, ..Config::default() })
}

pub(crate) fn horus() -> Option<Node<Horus>> {
    horus_on(Oscillators::default())
}

pub(crate) fn horus_on(oscillators: Oscillators) -> Option<Node<Horus>> {
    horus_with(oscillators)
}

pub(crate) fn horus_with<C: Cost>(oscillators: Oscillators) -> Option<Node<Horus, C>> {
    horus_part(Stm32f429::new(oscillators).with_brown_out_level_3())
}

pub(crate) fn horus_part<C: Cost>(part: Stm32f429) -> Option<Node<Horus, C>> {
    let image = Firmware::read(&image(3, "horus-tx-fw.elf")?).unwrap();
    Some(Node::new(part, Horus::new(chip(), 3, false), &image).unwrap())
}

/// The hold's board without a DPR, whose payload is drawn from `seed`; `None` if the firmware was not built.
pub(crate) fn hold(seed: u64) -> Option<Node<Hold>> {
    let image = Firmware::read(&hold_image()?).unwrap();
    Some(Node::new(Nrf52840::new(Settings::default()), Hold::new(chip(), seed), &image).unwrap())
}

pub(crate) fn dpr() -> Option<Node<Dpr>> {
    dpr_on(Settings::default())
}

pub(crate) fn dpr_on(settings: Settings) -> Option<Node<Dpr>> {
    dpr_with(settings)
}

pub(crate) fn dpr_with<C: Cost>(settings: Settings) -> Option<Node<Dpr, C>> {
    let image = Firmware::read(&image(3, "dpr-fw.elf")?).unwrap();
    let mut node = Node::new(Nrf52840::new(settings), Dpr::new(chip(), false), &image).unwrap();
    node.input(|part, _, _| part.wire_spis(SSI));
    Some(node)
}

pub(crate) fn counter<B: Board>(node: &Node<B>, symbol: &str, offset: usize) -> u32 {
    let mut word = [0; 4];
    node.read(node.address_of(symbol).unwrap() + offset as u64, &mut word).unwrap();
    u32::from_le_bytes(word)
}
