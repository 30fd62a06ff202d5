//! The reason why the processor started, from its reset flags.

use profile::ResetReason;

/// The flags of RCC_CSR (RM0090 "RCC clock control and status register").
mod flag {
    pub(super) const BROWN_OUT: u32 = 1 << 25;
    pub(super) const PIN: u32 = 1 << 26;
    pub(super) const POWER_ON: u32 = 1 << 27;
    pub(super) const SOFTWARE: u32 = 1 << 28;
    pub(super) const INDEPENDENT_WATCHDOG: u32 = 1 << 29;
    pub(super) const WINDOW_WATCHDOG: u32 = 1 << 30;
    pub(super) const LOW_POWER: u32 = 1 << 31;
}

/// Returns the reason of the reset for `csr`, the value of RCC_CSR at the start.
///
/// Several flags are set at once: every internal reset also sets the pin's flag, and power-on also sets the flag of the
/// brown-out. So the first set flag in this order gives the reason: power-on, brown-out, watchdog, software, low-power
/// management (not used here), pin. The STM32F429 has no reset by lockup; there the watchdog resets.
#[must_use]
pub const fn reason(csr: u32) -> ResetReason {
    if csr & flag::POWER_ON != 0 {
        ResetReason::PowerOn
    } else if csr & flag::BROWN_OUT != 0 {
        ResetReason::BrownOutOrOther
    } else if csr & flag::INDEPENDENT_WATCHDOG != 0 || csr & flag::WINDOW_WATCHDOG != 0 {
        ResetReason::Watchdog
    // Not covered: only this line, a reset by software, which HORUS never requests.
    } else if csr & flag::SOFTWARE != 0 {
        ResetReason::Software
    // Not covered: only this line, a reset by low-power management, which HORUS does not use.
    } else if csr & flag::LOW_POWER != 0 {
        ResetReason::BrownOutOrOther
    // Not covered: only this line, a reset without a flag of its cause: the pin's flag is set at each.
    } else if csr & flag::PIN != 0 {
        ResetReason::Pin
    } else {
        ResetReason::BrownOutOrOther
    }
}

/// Returns the reason of a reset in words, for the log.
#[must_use]
pub const fn name(reason: ResetReason) -> &'static str {
    match reason {
        ResetReason::PowerOn => "power-on",
        ResetReason::Pin => "reset pin",
        ResetReason::Watchdog => "watchdog",
        ResetReason::Lockup => "lockup",
        ResetReason::Software => "software",
        ResetReason::BrownOutOrOther => "brown-out or other",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Shows STA-4.
    #[test]
    fn each_reset_reason_follows_from_its_combination_of_flags() {
        assert_eq!(reason(0x0E00_0000), ResetReason::PowerOn, "supply on: POR, pin, BOR");
        assert_eq!(reason(0x0600_0000), ResetReason::BrownOutOrOther, "supply dipped: pin, BOR");
        assert_eq!(reason(0x2400_0000), ResetReason::Watchdog, "independent watchdog");
        assert_eq!(reason(0x4400_0000), ResetReason::Watchdog, "window watchdog");
        assert_eq!(reason(0x1400_0000), ResetReason::Software);
        assert_eq!(reason(0x0400_0000), ResetReason::Pin);
        assert_eq!(reason(0x8400_0000), ResetReason::BrownOutOrOther, "low-power management");
        assert_eq!(reason(0), ResetReason::BrownOutOrOther, "no flag");
    }

    #[test]
    fn the_oscillator_bits_of_the_register_and_the_clear_bit_tell_nothing() {
        assert_eq!(reason(0x2400_0000 | 0x0100_0003), ResetReason::Watchdog);
    }

    #[test]
    fn no_two_reasons_have_the_same_name() {
        let all = [
            ResetReason::PowerOn,
            ResetReason::Pin,
            ResetReason::Watchdog,
            ResetReason::Lockup,
            ResetReason::Software,
            ResetReason::BrownOutOrOther,
        ];
        for (index, one) in all.iter().enumerate() {
            assert!(all.iter().skip(index + 1).all(|other| name(*one) != name(*other)), "{one:?}");
        }
    }
}
