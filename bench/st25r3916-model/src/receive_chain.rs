//! Checks whether the settings of the receive chain can pass the received technology.
//!
//! After reset the receive chain suits NFC-A's 848 kHz subcarrier: 0B = 08 puts the first zero of the high-pass at 600
//! kHz. NFC-F has no subcarrier, and its spectrum at 424 kbit/s lies below that zero. The modelled air has no signal
//! strength, so an unsuitable setting is a finding ([`crate::Kind::ReceiveChain`]). The frame is received all the same,
//! unless [`crate::Config::unsuited_chain_receives`] is false.
//!
//! For NFC-F these register values are accepted:
//! - Register 0B may have high-pass zeros at 12 and 200 kHz (hz 1, 5) or 12 and 80 kHz (3), and a low-pass at 1200 kHz
//!   (lp 0) or 600 kHz (1). 13 is the value of \[1\] (poller, both parts) and of \[2\] (poller and listener); 01 that
//!   of \[1\] for a listener in active communication and of \[3\] for every listener.
//! - Register 0C may have any value. It holds AGC, squelch and choice of demodulator. \[1\] to \[3\] use different
//!   values (2D, 3D, FD, 6D), and none of them blocks the signal.
//! - Registers 0D and 0E must be 00, which is the HF input without gain reduction: \[1\] and \[2\]. Reset leaves 0D =
//!   D8.
//! - Register B0C must be 54 (\[1\], \[2\]) or 58 (poller of \[2\]). B0D must be 00 (\[1\], \[2\]), because its bit 0
//!   is for a 424 kHz subcarrier. Neither register is checked with the correlator off (dis_corr, 0A bit 2).
//!
//! For NFC-A at 106 kbit/s these values are accepted, each by \[1\], \[4\] and the recording that this crate's tests
//! replay:
//! - Register 0B must be 08, and 0D and 0E 00. 0C may have any value.
//! - Register B0C must be 51, or 11 during anticollision, and B0D 00. Neither register is checked with the correlator
//!   off.
//!
//! Public repositories:
//! - \[1\] stm32duino/ST25R3916 `src/rfal_rfst25r3916_analogConfigTbl.h` (ST's own table)
//! - \[2\] flipperdevices/flipperzero-firmware `targets/f7/furi_hal/furi_hal_nfc_felica.c`
//! - \[3\] Bwooce/zephyr-st25r3916 `third_party/elechouse/rfal_analogConfigTbl.h`, from wilson-elechouse/ST25R3916 (a
//!   board with the B)
//! - \[4\] flipperdevices/flipperzero-firmware `targets/f7/furi_hal/furi_hal_nfc_iso14443a.c` (poller and listener)
//!
//! The channel (0B bit 7, AM or PM) is not checked. Where sources disagree about a listener, every setting that one of
//! them uses is accepted, but not the reset values. \[1\] sets nothing for a passive listener, and keeps the settings
//! of an earlier poller. Further values that work on silicon can be added with their measurement.

use crate::core::Core;
use crate::event::Technology;
use crate::registers::reg;
use crate::report::{Kind, Space};

/// The bit dis_corr of register 0A, which switches the correlator off.
const DIS_CORR: u8 = 0x04;

/// Whether every register of the receive chain suits `technology`. Each unsuitable one is a finding.
pub(crate) fn suits(core: &mut Core, technology: Technology) -> bool {
    let filter = core.a(reg::RX_CONF1);
    let (lp, hz) = ((filter >> 4) & 0x07, filter & 0x0F);
    let (filter_suits, correlators): (bool, &[u8]) = match technology {
        Technology::NfcF => (matches!(lp, 0 | 1) && matches!(hz, 1 | 3 | 5), &[0x54, 0x58]),
        Technology::NfcA => (lp == 0 && hz == 8, &[0x51, 0x11]),
    };
    let (gain1, gain2) = (core.a(reg::RX_CONF3), core.a(reg::RX_CONF4));
    let (correlator1, correlator2) = (core.registers().b(reg::B_CORR1), core.registers().b(reg::B_CORR2));
    let unused = core.a(reg::AUX) & DIS_CORR != 0;
    let looks = [
        (filter_suits, Space::A, reg::RX_CONF1, filter),
        (gain1 == 0, Space::A, reg::RX_CONF3, gain1),
        (gain2 == 0, Space::A, reg::RX_CONF4, gain2),
        (unused || correlators.contains(&correlator1), Space::B, reg::B_CORR1, correlator1),
        (unused || correlator2 == 0, Space::B, reg::B_CORR2, correlator2),
    ];
    let mut suits = true;
    for (right, space, address, value) in looks {
        if !right {
            suits = false;
            core.note(Kind::ReceiveChain { technology, space, address: address as u8, value });
        }
    }
    suits
}
