//! What HORUS asks of its supply's supervisors (RM0090, "Power supply supervisor" and "Option bytes")

/// The brown-out level that has to be in the option bytes, as `BOR_LEV` numbers them: level 3, the highest, which
/// resets the part below 2.75 to 2.88 V. 1 and 2 are levels 2 and 1, and 3 is none.
pub const BROWN_OUT_LEVEL: u32 = 0;

/// `PWR_CR`: the voltage detector on (`PVDE`), at its highest level (`PLS`).
pub const DETECTOR: u32 = 1 << 4 | 7 << 5;

/// That level, mV: the typical value for a supply that falls (DS9405).
pub const DETECTOR_MV: u32 = 3_030;

/// `BOR_LEV` in `optcr`, a value of FLASH_OPTCR.
#[must_use]
pub const fn brown_out_level(optcr: u32) -> u32 {
    optcr >> 2 & 3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_as_delivered_has_no_brown_out_level() {
        assert_eq!(brown_out_level(0x0FFF_AAED), 3, "RM0090: the reset value of FLASH_OPTCR");
        assert_eq!(brown_out_level(0x0FFF_AAED & !0xC), BROWN_OUT_LEVEL);
    }
}
