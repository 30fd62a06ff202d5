//! The two boards with the release images, which `cargo xtask test` builds before it runs these tests.
#![allow(dead_code, reason = "each test file uses what it needs")]

use std::path::PathBuf;

use bench::engine::{Firmware, Node, Wiring};
use bench::sim::boards::{Dpr, Horus, Line};
use bench::sim::front_end::FrontEnd;
use bench::stm32f427::{Oscillators, Stm32f427Part};
use nrf52840_model::{Nrf52840, Settings};
use st25r3916_model::{Chip, Config};

/// What a test answers that lacks something it needs: a test that ran on nothing must not look as if it had passed
/// where nobody reads its output, so with `ci` it fails. `how` says how to get what is missing.
pub(crate) fn verdict(ci: bool, missing: &str, how: &str) -> Result<String, String> {
    let words = format!("not run: {missing} ({how})");
    if ci { Err(words) } else { Ok(words) }
}

/// Says that this test is not run because `missing`, and fails it where the environment has `CI`.
///
/// # Panics
///
/// Where `CI` is set.
pub(crate) fn not_run(missing: &str, how: &str) {
    match verdict(std::env::var_os("CI").is_some(), missing, how) {
        Ok(words) => eprintln!("{words}"),
        Err(words) => panic!("{words}"),
    }
}

/// The image called `name` for so many receivers, or `None` (said, see [`not_run`]) where it was not built.
pub(crate) fn image(receivers: usize, name: &str) -> Option<PathBuf> {
    let how = "`cargo xtask test` builds the images and says in LINK_IMAGES where they are";
    let Some(folder) = std::env::var_os("LINK_IMAGES").map(PathBuf::from) else {
        not_run("LINK_IMAGES is not set", how);
        return None;
    };
    let path = folder.join(format!("gps-{receivers}")).join(name);
    if !path.is_file() {
        not_run(&format!("there is no image {}", path.display()), how);
        return None;
    }
    Some(path)
}

fn chip() -> FrontEnd {
    FrontEnd::new(Chip::new(Config { vdd_mv: 5000, ..Config::default() }), false)
}

/// The HORUS board with its front end and the lines of its three receivers.
pub(crate) fn horus() -> Option<(Node<Horus>, FrontEnd, Vec<Line>)> {
    horus_on(Oscillators::default())
}

/// As [`horus`], with these oscillators.
pub(crate) fn horus_on(oscillators: Oscillators) -> Option<(Node<Horus>, FrontEnd, Vec<Line>)> {
    let chip = chip();
    let (board, lines) = Horus::new(Stm32f427Part::new(oscillators), chip.clone(), 3);
    let node = Node::new(board, &Firmware::read(&image(3, "horus-tx-fw.elf")?).unwrap()).unwrap();
    Some((node, chip, lines))
}

/// The DPR board with its front end, out of any field.
pub(crate) fn dpr() -> Option<(Node<Dpr>, FrontEnd)> {
    dpr_on(Settings::default())
}

/// As [`dpr`], with a part like this.
pub(crate) fn dpr_on(settings: Settings) -> Option<(Node<Dpr>, FrontEnd)> {
    let chip = chip();
    let board = Dpr::new(Nrf52840::new(settings), chip.clone());
    let node = Node::new(board, &Firmware::read(&image(3, "dpr-fw.elf")?).unwrap()).unwrap();
    Some((node, chip))
}

/// The counter at byte `offset` of the telemetry called `symbol`.
pub(crate) fn counter<B: Wiring>(node: &Node<B>, symbol: &str, offset: usize) -> u32 {
    let mut word = [0; 4];
    node.read(node.address_of(symbol).unwrap() + offset as u64, &mut word).unwrap();
    u32::from_le_bytes(word)
}
