//! Supply and antenna tuning: measurements, and settings that do not suit the board.
//!
//! | covered | source |
//! |---|---|
//! | Measure power supply (DF): 23.4 mV a step into the | DS13541, 4.4 Direct commands; stm32duino/ST25R3916 |
//! | A/D output (25), source by mpsv (2C bits 2:0), 25 µs, | `src/st25r3916.cpp` (step, source, register), |
//! | then I_dct | `src/st25r3916_com.h` |
//! | sup3V (01 bit 7) against the supply: set below 3.6 V, clear above | the same file, threshold 3600 mV |
//! | a supply outside 2.4 to 5.5 V | ST25R3911B data sheet, features; taken for this part as well |
//! | antenna tuning DACs (26, 27) without | stm32duino/ST25R3916 `src/rfal_rfst25r3916_analogConfigTbl.h`, chip |
//! | aat_en (01 bit 5) drive nothing | initialisation: set before 26 and 27 are |
//!
//! | left out | why |
//! |---|---|
//! | effects of a wrong supply range on the regulators, and of tuning on the | the air is digital; a finding reports |
//! | field | it |

use crate::core::Core;
use crate::field::Field;
use crate::registers::{self, RX_EN, reg};
use crate::report::{Kind, Space};

const RANGE_MV: core::ops::RangeInclusive<u16> = 2_400..=5_500;
/// The supply voltage, mV, below which the bit sup3V must be set and above which it must be clear.
const SUP3V_MV: u16 = 3_600;
/// The tolerance of [`SUP3V_MV`], mV: a step of the A/D converter in a supply measurement, rounded up.
const STEP_MV: u16 = 24;
const SUP3V: u8 = 0x80;
const AAT_EN: u8 = 0x20;

/// Reports a supply voltage outside the chip's range and an unsuitable sup3V, when receiver or field is switched on.
pub(crate) fn suits(core: &mut Core) {
    let mv = core.config().vdd_mv;
    if !RANGE_MV.contains(&mv) {
        core.note(Kind::SupplyOutOfRange(mv));
    }
    let sup3v = core.a(reg::IO2) & SUP3V != 0;
    if mv.abs_diff(SUP3V_MV) >= STEP_MV && sup3v != (mv < SUP3V_MV) {
        core.note(Kind::SupplyMismatch);
    }
}

/// Reports antenna tuning values that have no effect, because the antenna is used while aat_en is clear.
pub(crate) fn tuning_suits(core: &mut Core, field: &Field) {
    // A chip uses its antenna while its carrier is on, and while it listens for another chip's carrier.
    let listens = core.oscillator() && core.target() && core.operates(RX_EN);
    if !field.own() && !listens {
        return;
    }
    let written = (reg::TUNE_A..=reg::TUNE_B).any(|i| core.a(i) != registers::reset(Space::A, i as u8));
    if written && core.a(reg::IO2) & AAT_EN == 0 {
        core.note(Kind::AntennaTuningOff);
    }
}

/// Returns the result of Measure power supply (DF), steps of 23.4 mV, for the supply that mpsv (register 2C, bits 2:0)
/// selects.
pub(crate) fn measured(core: &Core) -> u8 {
    let mv = match core.a(reg::REGULATOR) & 0x07 {
        0 => core.config().vdd_mv,
        n @ 1..=4 => core.config().regulated_mv[usize::from(n) - 1],
        _ => 0,
    };
    (u32::from(mv) * 10 / 234).min(255) as u8
}
