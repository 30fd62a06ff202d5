//! Checks whether a poller's settings and its antenna's tuning can send NFC-F.
//!
//! The modelled air has no signal strength. An unsuitable setting is a finding ([`crate::Kind::Modulation`],
//! [`crate::Kind::FieldWithoutHysteresis`]). If [`crate::Config::unsuited_modulation_reaches`] is false, the frame also
//! does not leave the antenna, but the carrier does.
//!
//! | covered | source |
//! |---|---|
//! | NFC-F is sent by amplitude modulation (03 tr_am), 8 to 30 % deep | ISO/IEC 18092, 212 and 424 kbit/s |
//! | the depth of the modulation, 28 bits 7:4, coded by the variant | \[1\] for the B, \[2\] for the other |
//! | the driver's resistance, 28 bits 3:0: 15 is high impedance | \[1\] |
//! | B: dis_reg_am (B28 bit 7) set goes with act_amsink (01 bit 0) clear and the other way round | \[1\] |
//! | B: vddrf_cont (B2E bit 3) must be set | \[1\] |
//! | antenna tuning within a tolerance of the board's own, and aat_en | `crate::Config::tuning` |
//!
//! | left out | why |
//! |---|---|
//! | the shape of the modulation (B2A, B2F, B34 to B38, B30 to B33), resistive AM | no source says what still works |
//! | single-ended driving (00 bits 7, 6), the driver's other resistances | they are weaker, depending on the antenna |
//!
//! Public repositories: \[1\] techmccat/st25r39 `src/registers.rs`, which paraphrases DS13541; \[2\]
//! stm32duino/ST25R3916 `src/st25r3916_com.h`.

use crate::config::Variant;
use crate::core::Core;
use crate::registers::reg;
use crate::report::{Kind, Space};

const TR_AM: u8 = 0x04;
const ACT_AMSINK: u8 = 0x01;
const DIS_REG_AM: u8 = 0x80;
const VDDRF_CONT: u8 = 0x08;
const AAT_EN: u8 = 0x20;
const DEPTHS: core::ops::RangeInclusive<u8> = 8..=30;
/// The modulation depth, percent, for each value of am_mod (register 28, bits 7:4) on the ST25R3916.
const DEPTH_A: [u8; 16] = [5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 17, 19, 22, 26, 40];
const DEPTH_B: [u8; 16] = [0, 8, 10, 11, 12, 13, 14, 15, 20, 25, 30, 40, 50, 60, 70, 82];

/// Whether a poller's settings can send NFC-F. Each unsuitable setting is a finding.
pub(crate) fn suits(core: &mut Core) -> bool {
    let is_b = core.config().variant == Variant::St25r3916b;
    let driver = core.a(reg::TX_DRIVER);
    let depths = if is_b { DEPTH_B } else { DEPTH_A };
    let deep_enough = DEPTHS.contains(&depths[usize::from(driver >> 4)]) && driver & 0x0F != 0x0F;
    let mode = core.a(reg::MODE);
    let looks = [(mode & TR_AM != 0, Space::A, reg::MODE, mode), (deep_enough, Space::A, reg::TX_DRIVER, driver)];
    // `&` is used and not `&&`, so that both checks report their findings.
    all(core, looks) & supply_suits(core)
}

/// Whether an ST25R3916B's driver supply has consistent settings. The ST25R3916 has no such settings.
pub(crate) fn supply_suits(core: &mut Core) -> bool {
    let is_a = core.config().variant == Variant::St25r3916;
    let (auxiliary, shaping) = (core.registers().b(reg::B_AUX_MOD), core.registers().b(reg::B_AWS1));
    // The bits dis_reg_am and act_amsink must both fit the capacitor at VDD_AM, which is either small or large.
    let pair = (auxiliary & DIS_REG_AM != 0) != (core.a(reg::IO2) & ACT_AMSINK != 0);
    let looks = [
        (is_a || pair, Space::B, reg::B_AUX_MOD, auxiliary),
        (is_a || shaping & VDDRF_CONT != 0, Space::B, reg::B_AWS1, shaping),
    ];
    all(core, looks)
}

/// Whether all registers in `looks` (suitability, space, address, value) are suitable. Each other one is a finding.
pub(crate) fn all<const N: usize>(core: &mut Core, looks: [(bool, Space, usize, u8); N]) -> bool {
    for (_, space, address, value) in looks.iter().filter(|(right, ..)| !right) {
        core.note(Kind::Modulation { space: *space, address: *address as u8, value: *value });
    }
    looks.iter().all(|(right, ..)| *right)
}

/// Whether the antenna's tuning suits the chip's role, poller or listener.
pub(crate) fn in_tune(core: &Core) -> bool {
    let config = core.config();
    let wanted = config.tuning[usize::from(core.target())];
    let near = |i: usize, wanted: u8| core.a(i).abs_diff(wanted) <= config.tuning_tolerance;
    core.a(reg::IO2) & AAT_EN != 0 && near(reg::TUNE_A, wanted[0]) && near(reg::TUNE_B, wanted[1])
}
