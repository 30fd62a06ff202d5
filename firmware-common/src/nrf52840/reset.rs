//! Finds the reason of the last reset.
//!
//! RESETREAS (PS v1.7, 5.3.7.8) collects the reasons since it was last cleared. It is zero after power-on and after a
//! brown-out. To tell these two apart, a word of RAM that no start initialises is used: a brown-out may preserve it.

use profile::ResetReason;

const RESETPIN: u32 = 1;
const DOG: u32 = 1 << 1;
/// The bit of a reset by software or by a debugger (AIRCR.SYSRESETREQ).
const SREQ: u32 = 1 << 2;
const LOCKUP: u32 = 1 << 3;

/// Returns the reason for the RESETREAS value `bits`. `ram_kept` says whether the uninitialised word of RAM has kept
/// its value.
///
/// If the bit of the reset pin is set, all other bits are ignored (anomaly 136). System OFF, which the firmwares never
/// use, counts as "other".
#[must_use]
pub const fn reason(bits: u32, ram_kept: bool) -> ResetReason {
    if bits & RESETPIN != 0 {
        ResetReason::Pin
    } else if bits & DOG != 0 {
        ResetReason::Watchdog
    // Not covered: only this line, a lockup of the DPR: its handlers of faults cause none. The hold's runs have one.
    } else if bits & LOCKUP != 0 {
        ResetReason::Lockup
    // Not covered: only this line, a reset of the DPR by software, which it never requests. The hold's runs have one.
    } else if bits & SREQ != 0 {
        ResetReason::Software
    // Not covered: only this line, another cause, such as System OFF, which no firmware enters.
    } else if bits != 0 || ram_kept {
        ResetReason::BrownOutOrOther
    } else {
        ResetReason::PowerOn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bit_of_resetreas_tells_its_reason() {
        for ram_kept in [false, true] {
            assert_eq!(reason(0b0001, ram_kept), ResetReason::Pin);
            assert_eq!(reason(0b0010, ram_kept), ResetReason::Watchdog);
            assert_eq!(reason(0b0100, ram_kept), ResetReason::Software);
            assert_eq!(reason(0b1000, ram_kept), ResetReason::Lockup);
            assert_eq!(reason(1 << 16, ram_kept), ResetReason::BrownOutOrOther, "a wake-up from System OFF");
        }
    }

    #[test]
    fn with_the_pins_bit_set_the_others_are_not_believed() {
        assert_eq!(reason(0b1111, true), ResetReason::Pin);
        assert_eq!(reason(0b1110, false), ResetReason::Watchdog);
        assert_eq!(reason(0b1100, false), ResetReason::Lockup);
    }

    #[test]
    fn without_any_bit_kept_ram_tells_a_brown_out_from_power_on() {
        assert_eq!(reason(0, false), ResetReason::PowerOn);
        assert_eq!(reason(0, true), ResetReason::BrownOutOrOther);
    }
}
