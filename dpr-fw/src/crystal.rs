//! The wait for the 32 MHz crystal (HFXO), without the registers.
//!
//! The DPR starts on the part's internal oscillator (HFINT), which is off by up to 8 % (PS v1.7, 5.4.4, tolerance of
//! HFINT). It never runs tasks on HFINT; docs/decisions/0023-start-and-clocks.md says why. The crystal takes 0.36 ms
//! typically (PS v1.7, 5.4.4, start-up time).

/// The number of times that [`starts`] asks whether the crystal runs before it reports a failure.
const POLLS: u32 = 1_000;

/// The least pause between two polls of the crystal, µs.
const PAUSE_US: u32 = 10;

/// The least pause between two polls of the crystal, in cycles of the internal oscillator's 64 MHz.
pub const PAUSE_CYCLES: u32 = 64 * PAUSE_US;

/// The shortest time that is granted to the crystal for its start, ms: 27 times the typical start-up time.
pub const START_MS: u32 = POLLS * PAUSE_US / 1_000;

/// The longest duration of [`starts`], ms. A delay loop of the processor takes up to twice the cycles asked for, the
/// internal oscillator may be 8 % slow, and the polls take some cycles too. The watchdog bites after 100 ms.
pub const START_MAX_MS: u32 = START_MS * 5 / 2;

/// Waits until the crystal, which was told to start, runs, and returns whether it does in time. `is_started` tells
/// whether it runs; `pause` waits [`PAUSE_CYCLES`] or a little longer. The wait ends after [`START_MAX_MS`].
pub fn starts(mut is_started: impl FnMut() -> bool, mut pause: impl FnMut()) -> bool {
    for _ in 0..POLLS {
        if is_started() {
            return true;
        }
        pause();
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::cell::Cell;

    fn started(after_pauses: u32) -> (bool, u32) {
        let pauses = Cell::new(0);
        let starts = starts(|| pauses.get() >= after_pauses, || pauses.set(pauses.get() + 1));
        (starts, pauses.get())
    }

    #[test]
    fn a_crystal_that_starts_in_time_is_waited_for_and_no_longer() {
        assert_eq!(started(0), (true, 0));
        assert_eq!(started(36), (true, 36), "0.36 ms, as it takes typically");
        assert_eq!(started(POLLS - 1), (true, POLLS - 1));
    }

    // Shows SAFE-12.
    #[test]
    fn an_oscillator_is_given_up_after_ten_milliseconds_of_pauses() {
        assert_eq!(started(u32::MAX), (false, POLLS));
        assert_eq!(u64::from(POLLS) * u64::from(PAUSE_CYCLES), u64::from(START_MS) * 64_000);
    }
}
