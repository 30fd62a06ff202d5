//! Checks whether a listener's settings can answer in NFC-F.
//!
//! The modelled air has no signal strength. An unsuitable setting is a finding ([`crate::Kind::Modulation`]). If
//! [`crate::Config::unsuited_modulation_reaches`] is false, the answer also does not leave the antenna. Without any
//! modulator (B28 bits 5 and 4 clear) an answer never leaves the antenna.
//!
//! | covered | source |
//! |---|---|
//! | the driver modulates the field (B28 bit 4, `lm_dri`); no external one (`lm_ext`) | \[1\], \[2\] |
//! | the driver's resistance, lower when modulated (29 bits 7:4) than otherwise (29 bits 3:0) | \[2\] to \[4\] |
//! | B: rgs_am (B28 bit 2) clear in card mode | \[1\] and \[2\] |
//! | B: dis_reg_am (B28 bit 7) and act_amsink (01 bit 0) as for a poller; vddrf_cont (B2E bit 3) set | \[1\] |
//!
//! | left out | why |
//! |---|---|
//! | the strength of the modulation, by the two resistances and the antenna | no source says what still works |
//! | a pin that carries the modulation to an external circuit (`lm_ext`) | the boards have none |
//!
//! Public repositories: \[1\] techmccat/st25r39 `src/registers.rs`, which paraphrases DS13541; \[2\]
//! stm32duino/ST25R3916 `src/rfal_rfst25r3916_analogConfigTbl.h` (29 = 5F, on the B 2E); \[3\]
//! flipperdevices/flipperzero-firmware `targets/f7/furi_hal/furi_hal_nfc.c` (0F); \[4\] BdF-LabSec/kst25r3916
//! `Core/program/st25r/st25r3916b/14a/14a3_target.c` (2F).

use crate::config::Variant;
use crate::core::Core;
use crate::modulation;
use crate::registers::reg;
use crate::report::Space;

const LM_DRI: u8 = 0x10;
const RGS_AM: u8 = 0x04;

/// Whether a listener's settings can answer in NFC-F. Each unsuitable setting is a finding.
pub(crate) fn suits(core: &mut Core) -> bool {
    let is_b = core.config().variant == Variant::St25r3916b;
    let (resistances, auxiliary) = (core.a(reg::PT_MOD), core.registers().b(reg::B_AUX_MOD));
    let by_driver = auxiliary & LM_DRI != 0 && !(is_b && auxiliary & RGS_AM != 0);
    let looks = [
        (resistances >> 4 < resistances & 0x0F, Space::A, reg::PT_MOD, resistances),
        (by_driver, Space::B, reg::B_AUX_MOD, auxiliary),
    ];
    // `&` is used and not `&&`, so that both checks report their findings.
    modulation::all(core, looks) & modulation::supply_suits(core)
}
