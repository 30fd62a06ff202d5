//! Decides which oscillator the board runs on.
//!
//! # Design
//!
//! HORUS is meant to run on the external clock (HSE). Without HSE it runs on the internal RC oscillator (HSI), through
//! the same PLL to the same 144 MHz. So every divider, slot and baud rate register stays the same. Reported-Position's
//! status states that HORUS runs on HSI. Bounds in processor cycles still hold, but a cycle of 10 ms lasts as long as
//! HSI makes it.
//!
//! | | frequency | error |
//! |---|---|---|
//! | HSE | 8 MHz | that of the crystal behind it (on the NUCLEO the ST-LINK's, which feeds its MCO into OSC_IN) |
//! | HSI | 16 MHz | ±1 % at 25 °C, −8 to +4.5 % from −40 to 105 °C (DS9405, internal clock source characteristics) |
//!
//! The receivers' UARTs tolerate a clock error of about 3 % (RM0090 "USART", tolerance of the receiver to clock
//! deviation), so at room temperature HORUS still receives from them on HSI.
//!
//! HORUS chooses the oscillator once per start. If HSE fails later, the clock security system (`hw/clock.rs`) leads to
//! the safe state and a reset, and the next start chooses HSI.

/// The frequency of the external clock (HSE), Hz.
pub const EXTERNAL_HZ: u32 = 8_000_000;

/// The frequency of the internal oscillator (HSI), Hz. Every start begins on it (RM0090 "Reset and clock control").
pub const INTERNAL_HZ: u32 = 16_000_000;

/// How often [`choose`] polls HSE before it chooses HSI.
const POLLS: u32 = 1_000;

const PAUSE_US: u32 = 10;

/// The least pause between two polls of HSE, in cycles of the internal oscillator.
pub const PAUSE_CYCLES: u32 = PAUSE_US * (INTERNAL_HZ / 1_000_000);

/// The least time that HSE has to become ready, ms: five times the 2 ms that a crystal takes typically (DS9405, HSE
/// oscillator characteristics, start-up time). A clock that is fed in from outside takes less.
pub const START_MS: u32 = POLLS * PAUSE_US / 1_000;

/// The longest duration of [`choose`], ms. A delay loop of the processor takes up to twice the cycles asked for, the
/// internal oscillator may be 8 % slow, and the polls take some cycles too.
pub const START_MAX_MS: u32 = START_MS * 5 / 2;

// Shows SAFE-12.
const _: () = assert!(START_MS == 10);

/// The oscillator that feeds the PLL.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Source {
    /// HSE feeds the PLL, with the accuracy of a crystal.
    #[default]
    External,
    /// HSI feeds the PLL, because HSE is missing.
    Internal,
}

/// Waits until HSE, which was switched on, is ready, for [`START_MAX_MS`] at most, and returns the oscillator to run
/// on. `is_ready` polls HSE (RCC_CR.HSERDY), and `pause` waits for [`PAUSE_CYCLES`] or a little longer.
pub fn choose(mut is_ready: impl FnMut() -> bool, mut pause: impl FnMut()) -> Source {
    for _ in 0..POLLS {
        if is_ready() {
            return Source::External;
        }
        pause();
    }
    Source::Internal
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::cell::Cell;

    fn chosen(ready_after_pauses: u32) -> (Source, u32) {
        let pauses = Cell::new(0);
        let source = choose(|| pauses.get() >= ready_after_pauses, || pauses.set(pauses.get() + 1));
        (source, pauses.get())
    }

    #[test]
    fn an_external_clock_that_becomes_ready_in_time_is_used_at_once() {
        assert_eq!(chosen(0), (Source::External, 0));
        assert_eq!(chosen(200), (Source::External, 200), "2 ms, as a crystal takes typically");
        assert_eq!(chosen(POLLS - 1), (Source::External, POLLS - 1));
    }

    // Shows SAFE-12.
    #[test]
    fn the_start_goes_on_after_10_ms_without_an_external_clock() {
        assert_eq!(chosen(u32::MAX), (Source::Internal, POLLS));
        let cycles = u64::from(POLLS) * u64::from(PAUSE_CYCLES);
        assert_eq!(cycles * 1_000 / u64::from(INTERNAL_HZ), u64::from(START_MS));
    }

    #[test]
    fn the_bound_of_the_start_allows_a_slow_oscillator_and_delay_loop() {
        let cycles = 2 * u64::from(POLLS) * u64::from(PAUSE_CYCLES);
        let slow_hz = u64::from(INTERNAL_HZ) * 92 / 100;
        let longest_ms = (cycles * 1_000).div_ceil(slow_hz);
        assert!((longest_ms..2 * longest_ms).contains(&u64::from(START_MAX_MS)), "{longest_ms} ms");
    }
}
