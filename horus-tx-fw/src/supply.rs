//! What HORUS requires of the supervisors of its supply (RM0090, "Power supply supervisor" and "Option bytes")

/// The value that `BOR_LEV` of the option bytes must have: 0 is brown-out level 3, the highest, which resets the part
/// below 2.75 to 2.88 V. The values 1 and 2 are levels 2 and 1; 3 means no brown-out reset.
pub const BROWN_OUT_LEVEL: u32 = 0;

/// The value of `PWR_CR` that switches the voltage detector on (`PVDE`) at its highest level (`PLS`).
pub const DETECTOR: u32 = 1 << 4 | 7 << 5;

/// The voltage of the detector's highest level, mV: the typical value for a supply that falls (DS9405).
pub const DETECTOR_MV: u32 = 3_030;

/// Returns the field `BOR_LEV` of `optcr`, a value of FLASH_OPTCR.
#[must_use]
pub const fn brown_out_level(optcr: u32) -> u32 {
    optcr >> 2 & 3
}

#[cfg(test)]
mod tests {
    use super::*;

    // Shows SAFE-11.
    #[test]
    fn a_part_as_delivered_has_no_brown_out_level() {
        assert_eq!(brown_out_level(0x0FFF_AAED), 3, "RM0090: the reset value of FLASH_OPTCR");
        assert_eq!(brown_out_level(0x0FFF_AAED & !0xC), BROWN_OUT_LEVEL);
    }
}
