//! Waits for the 32 MHz crystal (HFXO), without register accesses.
//!
//! The part starts on its internal oscillator (HFINT), which is off by up to 8 % (PS v1.7, 5.4.4). No task runs on
//! HFINT (docs/decisions/0023-start-and-clocks.md). The crystal typically starts within 0.36 ms (PS v1.7, 5.4.4,
//! start-up time).

/// How often [`starts`] polls the crystal before it reports a failure.
const POLLS: u32 = 1_000;

const PAUSE_US: u32 = 10;

/// The least pause between two polls of the crystal, in clock cycles of 64 MHz.
pub const PAUSE_CYCLES: u32 = 64 * PAUSE_US;

/// The least time that the crystal is given for its start, ms: 27 times the typical start-up time.
pub const START_MS: u32 = POLLS * PAUSE_US / 1_000;

/// The longest duration of [`starts`], ms; the watchdog resets the part after 100 ms. The factor 5/2 allows for three
/// causes: `pause` may take up to twice its cycles, the internal oscillator may be 8 % slow, and the polls take time.
pub const START_MAX_MS: u32 = START_MS * 5 / 2;

/// Waits until the crystal runs, [`START_MAX_MS`] at most, and returns whether it runs. `pause` must wait at least
/// [`PAUSE_CYCLES`].
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
