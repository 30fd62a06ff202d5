//! Tests flashing through the library with boards of the bench, and each way in which flashing can fail.
//!
//! The boards run the release programs, which `cargo xtask test` builds into the folder LINK_IMAGES.

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

use probe_rs::probe::list::{ProbeListItem, ProbeLister};
use probe_rs::probe::{DebugProbe, DebugProbeError, ProbeCreationError, ProbeFactory};

use super::*;
use crate::Receivers;

/// Returns a new board of the bench and its ELF file; `None` and a message if the firmwares were not built.
fn board(board: Board) -> Option<(BenchBoard, PathBuf)> {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let Some(folder) = std::env::var_os("LINK_IMAGES").map(PathBuf::from) else {
        assert!(std::env::var_os("CI").is_none(), "LINK_IMAGES is not set");
        eprintln!("not run: LINK_IMAGES is not set");
        return None;
    };
    let elf = folder.join("gps-3").join(board.package()).with_extension("elf");
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let name = format!("bench-probe-{}-{number}.flash", std::process::id());
    Some((BenchBoard::switch_on(board, std::env::temp_dir().join(name)).unwrap(), elf))
}

fn args(board: Board, erase_all: bool) -> FlashArgs {
    let probe = ProbeArgs { probe: None, speed: None, erase_all };
    let image = if board == Board::Dpr { Image::Dpr } else { Image::Horus };
    FlashArgs { image, hold: false, gps: Receivers::DEFAULT, seconds: Some(0.02), probe }
}

fn flash(on: &BenchBoard, board: Board, elf: &Path, erase_all: bool) -> Result<(), String> {
    let outcome = flash_elf(&args(board, erase_all), &Found::Bench(on.clone()), elf);
    match outcome {
        Ok(code) if code == ExitCode::SUCCESS => Ok(()),
        Ok(_) => Err("findings".to_owned()),
        Err(error) => Err(format!("{error:#}")),
    }
}

fn holds(on: &BenchBoard, elf: &Path, flash: u64) -> bool {
    let kept = on.kept();
    emulator_node::Firmware::read(elf).unwrap().segments().iter().all(|(address, bytes)| {
        let at = usize::try_from(address - flash).unwrap();
        kept[at..at + bytes.len()] == bytes[..]
    })
}

#[test]
fn a_new_dpr_board_needs_a_full_erase_before_writing() {
    let Some((on, elf)) = board(Board::Dpr) else { return };
    let words = flash(&on, Board::Dpr, &elf, false).unwrap_err();
    assert!(
        words.contains("the debug port of the nRF52840_xxAA is locked") && words.contains("--erase-all"),
        "{words}"
    );
    assert!(on.kept().iter().all(|&byte| byte == 0xFF), "nothing was written");
    assert_eq!(flash(&on, Board::Dpr, &elf, true), Ok(()));
    assert!(holds(&on, &elf, 0));
    // UICR follows the flash in the kept memory. This word of it is UICR.APPROTECT.
    assert_eq!(on.kept()[(1 << 20) + 0x208..][..4], [0x5A, 0, 0, 0]);
}

#[test]
fn a_running_dpr_board_is_written_again_without_a_full_erase() {
    let Some((on, elf)) = board(Board::Dpr) else { return };
    assert_eq!(flash(&on, Board::Dpr, &elf, true), Ok(()));
    on.switch_off_and_on();
    on.run(500_000_000);
    assert_eq!(flash(&on, Board::Dpr, &elf, false), Ok(()));
    // The watchdog, which a soft reset does not stop, was fed while the flash algorithm ran.
    let restarts = on.restarts();
    assert!(restarts.len() >= 2 && restarts.iter().all(|why| why.ends_with("by software")), "{restarts:?}");
    assert!(holds(&on, &elf, 0));
}

const OPTIONS: usize = 2 << 20;
/// The option bytes of a new board (RM0090, "Option bytes").
const AS_DELIVERED: [u8; 16] = *b"\xEC\xAA\xFF\xFF\xFF\xFF\xFF\xFF\xFF\x0F\xFF\xFF\xFF\xFF\xFF\xFF";

#[test]
fn flashing_horus_sets_brown_out_level_3_and_leaves_the_other_options() {
    let Some((on, elf)) = board(Board::Horus) else { return };
    assert_eq!(on.kept()[OPTIONS..], AS_DELIVERED);
    for _ in 0..2 {
        assert_eq!(flash(&on, Board::Horus, &elf, false), Ok(()));
        let mut level_3 = AS_DELIVERED;
        level_3[0] &= !0x0C;
        assert_eq!(on.kept()[OPTIONS..], level_3);
        on.switch_off_and_on();
        on.run(500_000_000);
        assert_eq!(on.restarts(), [""; 0]);
    }
}

#[test]
fn a_horus_board_is_written_new_and_again_while_its_firmware_runs() {
    let Some((on, elf)) = board(Board::Horus) else { return };
    assert_eq!(flash(&on, Board::Horus, &elf, false), Ok(()));
    assert!(holds(&on, &elf, 0x0800_0000));
    on.switch_off_and_on();
    on.run(500_000_000);
    assert_eq!(flash(&on, Board::Horus, &elf, false), Ok(()));
    assert!(holds(&on, &elf, 0x0800_0000));
}

#[test]
fn the_other_boards_part_is_refused_and_left_unchanged() {
    let (Some((dpr, dpr_elf)), Some((horus, horus_elf))) = (board(Board::Dpr), board(Board::Horus)) else { return };
    for erase_all in [false, true] {
        let words = flash(&horus, Board::Dpr, &dpr_elf, erase_all).unwrap_err();
        assert!(words.contains("an STM32F42x or F43x, and the dpr board has an nRF52840_xxAA"), "{words}");
        let words = flash(&dpr, Board::Horus, &horus_elf, erase_all).unwrap_err();
        assert!(words.contains("a Nordic part whose debug port is locked, and the horus board"), "{words}");
    }
    assert!(dpr.kept().iter().chain(&horus.kept()[..OPTIONS]).all(|&byte| byte == 0xFF));
    assert_eq!(horus.kept()[OPTIONS..], AS_DELIVERED, "nor were the option bytes");
}

#[test]
fn a_bit_of_flash_that_sticks_is_found_by_verifying() {
    for (name, at) in [(Board::Dpr, 0x4000), (Board::Horus, 0x0800_4000)] {
        let Some((on, elf)) = board(name) else { return };
        let image = emulator_node::Firmware::read(&elf).unwrap();
        let (start, bytes) = image
            .segments()
            .iter()
            .find(|(from, bytes)| (*from..from + bytes.len() as u64).contains(&u64::from(at)))
            .unwrap();
        let byte = bytes[usize::try_from(u64::from(at) - start).unwrap()];
        on.stick_flash(at, 5, byte >> 5 & 1 == 0);
        let words = flash(&on, name, &elf, true).unwrap_err();
        assert!(words.contains("but flash does not hold it"), "{name:?}: {words}");
    }
}

#[test]
fn a_board_can_be_written_again_after_its_probe_was_unplugged() {
    let Some((on, elf)) = board(Board::Horus) else { return };
    let Some((other, _)) = board(Board::Horus) else { return };
    assert_eq!(flash(&other, Board::Horus, &elf, false), Ok(()));
    let whole = other.commands();
    let mut said = 0;
    for commands in [1, 20, whole / 4, whole / 2, whole * 3 / 4] {
        on.unplug_after(commands);
        let words = flash(&on, Board::Horus, &elf, false).unwrap_err();
        assert!(
            words.contains("the probe was unplugged") || words.contains("connect the NUCLEO"),
            "{commands}: {words}"
        );
        said += usize::from(words.contains("was not written to its end") && words.contains("repeat it"));
        on.plug_in();
        on.switch_off_and_on();
    }
    assert!(said > 1, "some were in the middle of writing");
    assert!(!holds(&on, &elf, 0x0800_0000));
    assert_eq!(flash(&on, Board::Horus, &elf, false), Ok(()));
    assert!(holds(&on, &elf, 0x0800_0000));
}

#[derive(Debug)]
struct Plugged;

impl std::fmt::Display for Plugged {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("J-Link")
    }
}

impl ProbeFactory for Plugged {
    fn open(&self, _: &DebugProbeSelector) -> Result<Box<dyn DebugProbe>, DebugProbeError> {
        Err(ProbeCreationError::CouldNotOpen.into())
    }

    fn list_probes(&self) -> Vec<ProbeListItem> {
        vec![]
    }
}

#[derive(Debug)]
struct Several(usize);

impl ProbeLister for Several {
    fn open(&self, _: &DebugProbeSelector) -> Result<Probe, DebugProbeError> {
        Err(ProbeCreationError::NotFound.into())
    }

    fn list_with_access(&self, selector: Option<&DebugProbeSelector>) -> Vec<ProbeListItem> {
        static PLUGGED: Plugged = Plugged;
        let info =
            |number| DebugProbeInfo::new("J-Link", 0x1366, 0x1051, Some(format!("00{number}")), &PLUGGED, None, false);
        let all = (0..self.0).map(info).filter(|info| selector.is_none_or(|selector| selector.matches_probe(info)));
        all.map(ProbeListItem::accessible).collect()
    }
}

#[test]
fn two_probes_are_never_chosen_between_and_each_is_listed() {
    let choose = |count, probe: Option<&str>| {
        let args = ProbeArgs { probe: probe.map(str::to_owned), speed: None, erase_all: false };
        choose_usb(Board::Dpr, &args, &Lister::with_lister(Box::new(Several(count))))
            .map(|info| info.serial_number.unwrap())
            .map_err(|error| format!("{error:#}"))
    };
    let words = choose(2, None).unwrap_err();
    assert!(words.contains("more than one debug probe matches: name one with --probe VID:PID:SERIAL"), "{words}");
    assert!(words.contains("1366:1051:000") && words.contains("1366:1051:001"), "{words}");
    assert_eq!(choose(2, Some("1366:1051:001")), Ok("001".to_owned()));
    assert_eq!(choose(1, None), Ok("000".to_owned()));
    assert!(choose(0, None).unwrap_err().contains("no debug probe found: connect the nRF52840-DK"));
    assert!(choose(2, Some("1366:1051:7")).unwrap_err().contains("no debug probe matches 1366:1051:7"));
}
