//! Explains why a debug probe has no access to a board, and what must be written to keep a board accessible.
//!
//! These functions do no I/O. [`crate::probe`] reads the values that they need from the board.

use crate::Board;

/// FICR.INFO.VARIANT of the nRF52840: two letters of the package variant and two of the build code, in ASCII.
#[cfg(feature = "probe")]
pub(crate) const VARIANT: u64 = 0x1000_0104;

#[cfg(feature = "probe")]
pub(crate) const UICR_APPROTECT: u64 = 0x1000_1208;

/// The value of UICR.APPROTECT with which the debug port is open (HwDisabled, NordicSemiconductor/nrfx,
/// `nrf52840_bitfields.h`).
pub(crate) const HW_DISABLED: u32 = 0x5A;

/// The first letter of the build codes of parts that start with a locked debug port: see
/// `firmware-common/src/nrf52840/debug_port.rs`.
const FIRST_LOCKED: u8 = b'F';

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// The probe library was not permitted to unlock the debug port by erasing everything.
    Locked,
    StaysLocked,
    NoAnswer,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Seen {
    /// A Nordic part, identified by its CTRL-AP, with FICR.INFO.PART if it is not locked.
    Nordic(Option<u32>),
    /// A part with ST's DBGMCU, with the device number in its IDCODE (RM0090 38.6.1).
    St(u32),
    Other,
}

const NRF52840: u32 = 0x52840;
/// The device number of STM32F42x and STM32F43x in DBGMCU's IDCODE.
const STM32F42X: u32 = 0x419;

pub(crate) fn wrong_chip(board: Board, seen: Seen, probe: &str) -> Option<String> {
    let what = match (board, seen) {
        (Board::Dpr, Seen::Nordic(None | Some(NRF52840))) | (Board::Horus, Seen::St(STM32F42X)) => return None,
        (_, Seen::Nordic(Some(part))) => format!("an nRF{part:x}"),
        (_, Seen::Nordic(None)) => "a Nordic part whose debug port is locked".to_owned(),
        (_, Seen::St(STM32F42X)) => "an STM32F42x or F43x".to_owned(),
        (_, Seen::St(device)) => format!("an STM32 of device number {device:#x}"),
        (_, Seen::Other) => "another part".to_owned(),
    };
    let name = board.name();
    Some(format!(
        "{probe} is connected to {what}, and the {name} board has an {}: nothing was written\n\
         If it is the other board's probe, name this board's with --probe; {}.",
        chip(board),
        connection(board)
    ))
}

pub(crate) fn explain(refusal: Refusal, board: Board, probe: &str) -> String {
    let (chip, connection) = (chip(board), connection(board));
    match refusal {
        Refusal::Locked => format!(
            "the debug port of the {chip} is locked: nothing on it can be read or written\n\
             Parts of build code Fxx and later are locked when they are new, and whenever the firmware on them does \
             not open the port.\n\
             The same command with --erase-all unlocks it by erasing everything on the part: all of flash, and UICR \
             with its settings and customer data. Then it goes on as usual. Do so only if nothing on the part is to \
             be kept."
        ),
        Refusal::StaysLocked => format!(
            "everything on the {chip} was to be erased, but its debug port is locked still\n\
             If firmware with a watchdog runs on it, the watchdog may have ended the erasing (nRF52840 anomaly 176): \
             switch the board off and on, and repeat the command with --erase-all."
        ),
        Refusal::NoAnswer => format!("{probe} sees no {chip}: {connection}"),
    }
}

pub(crate) const fn chip(board: Board) -> &'static str {
    match board {
        Board::Dpr => "nRF52840_xxAA",
        Board::Horus => "STM32F429ZITx",
    }
}

pub(crate) const fn connection(board: Board) -> &'static str {
    match board {
        Board::Dpr => "connect the nRF52840-DK by its J-Link's USB (connector J2) and switch it on",
        Board::Horus => "connect the NUCLEO-F429ZI by its ST-LINK's USB (connector CN1)",
    }
}

/// The change of UICR.APPROTECT with which an nRF52840's debug port is open after the next power-on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Approtect {
    /// No change is needed: the debug port is open with this value, or the part is of the older kind, whose port is
    /// open while UICR is erased.
    Leave,
    /// The word of UICR is erased, so [`HW_DISABLED`] must be programmed into it.
    Program,
    /// The word of UICR has another value that only an erase can change, so the debug port will be locked.
    WillLock,
}

impl Approtect {
    pub(crate) const fn of(variant: u32, uicr_approtect: u32) -> Self {
        let [_, build_code, ..] = variant.to_le_bytes();
        if build_code < FIRST_LOCKED || uicr_approtect & 0xFF == HW_DISABLED {
            Self::Leave
        } else if uicr_approtect == u32::MAX {
            Self::Program
        } else {
            Self::WillLock
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROBE: &str = "J-Link";

    #[test]
    fn a_locked_part_is_reported_with_the_cost_of_unlocking() {
        let text = explain(Refusal::Locked, Board::Dpr, PROBE);
        for part in ["nRF52840", "locked", "--erase-all", "all of flash", "UICR"] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("connect"), "the board is connected: {text}");
    }

    #[test]
    fn another_boards_part_is_refused_by_name() {
        for (board, right) in [
            (Board::Dpr, Seen::Nordic(None)),
            (Board::Dpr, Seen::Nordic(Some(0x52840))),
            (Board::Horus, Seen::St(0x419)),
        ] {
            assert_eq!(wrong_chip(board, right, PROBE), None, "{right:?}");
        }
        for (board, wrong, words) in [
            (Board::Dpr, Seen::St(0x419), "an STM32F42x or F43x"),
            (Board::Dpr, Seen::Nordic(Some(0x52832)), "an nRF52832"),
            (Board::Dpr, Seen::Other, "another part"),
            (Board::Horus, Seen::Nordic(None), "a Nordic part whose debug port is locked"),
            (Board::Horus, Seen::St(0x413), "an STM32 of device number 0x413"),
        ] {
            let text = wrong_chip(board, wrong, PROBE).unwrap();
            assert!(
                text.contains(words) && text.contains("nothing was written") && text.contains(chip(board)),
                "{text}"
            );
        }
    }

    #[test]
    fn a_part_that_stays_locked_is_reported_as_still_locked() {
        let text = explain(Refusal::StaysLocked, Board::Dpr, PROBE);
        assert!(text.contains("locked still") && text.contains("off and on"), "{text}");
    }

    #[test]
    fn an_unanswering_board_should_be_connected_and_not_erased() {
        for (board, plug) in [(Board::Dpr, "J2"), (Board::Horus, "CN1")] {
            let text = explain(Refusal::NoAnswer, board, PROBE);
            assert!(text.contains(PROBE) && text.contains(plug) && !text.contains("erase"), "{text}");
        }
    }

    #[test]
    fn uicr_is_programmed_only_on_new_parts_with_erased_uicr() {
        let of = |variant: &[u8; 4], uicr| Approtect::of(u32::from_be_bytes(*variant), uicr);
        assert_eq!(of(b"AAF0", u32::MAX), Approtect::Program);
        assert_eq!(of(b"AAFA", 0x5A), Approtect::Leave);
        assert_eq!(of(b"AAF0", 0xFFFF_FF5A), Approtect::Leave);
        for uicr in [0, 0xFFFF_FF00, 0xFFFF_FF5B] {
            assert_eq!(of(b"AAF0", uicr), Approtect::WillLock, "{uicr:#x}");
        }
        for old in [b"AAC0", b"AAD0", b"AAD1", b"AAE0"] {
            for uicr in [u32::MAX, 0] {
                assert_eq!(of(old, uicr), Approtect::Leave, "{old:?}");
            }
        }
    }
}
