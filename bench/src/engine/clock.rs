//! The fast clock: instructions counted, converted to time once.
//!
//! An instruction takes a fixed number of core cycles, so the instant of an instruction is its count times an exact
//! rational number of nanoseconds, rounded down once. Nothing accumulates: a crystal that is 1 ppm off is 10 µs off
//! after ten seconds, neither more nor less.
//!
//! A fixed cost is a deliberate simplification. A Cortex-M4 runs most instructions in one cycle and loads, stores and
//! taken branches in two to four; flash wait states add to that. Compiled firmware of this kind averages about 1.5
//! cycles, which is the constant both boards use ([`FAST_CYCLES_PER_INSTRUCTION`]). Exception entry (12 cycles) and
//! exit (10) are not charged: interrupt latency on this clock is the model's and must not be quoted as the silicon's.

use rigless::time::NANOS_PER_SECOND;

/// Cycles per instruction on the fast clock, as a fraction: 3/2. See the module's introduction for where it comes from.
pub const FAST_CYCLES_PER_INSTRUCTION: (u32, u32) = (3, 2);

/// Parts per billion in one.
const BILLION: u128 = 1_000_000_000;

/// What a core's clock runs at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rate {
    /// In hertz, if its source were exact; zero for a core without a clock.
    pub hz: u64,
    /// How much faster the source is, in parts per billion (negative: slower).
    pub ppb: i64,
}

/// How long an instruction takes, as an exact fraction of nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    numerator: u128,
    denominator: u128,
}

impl Clock {
    /// A core at `hz` whose crystal is `ppb` parts per billion fast (negative: slow), taking
    /// `cycles.0 / cycles.1` cycles for each instruction.
    ///
    /// # Panics
    ///
    /// If the rate comes to zero or below.
    #[must_use]
    pub fn new(hz: u64, ppb: i64, cycles: (u32, u32)) -> Self {
        let scale = u128::try_from(1_000_000_000_i64.saturating_add(ppb)).expect("a crystal that oscillates");
        let numerator = u128::from(NANOS_PER_SECOND) * BILLION * u128::from(cycles.0);
        let denominator = u128::from(hz) * scale * u128::from(cycles.1);
        assert!(numerator > 0 && denominator > 0, "a core that runs");
        let divisor = greatest_common_divisor(numerator, denominator);
        Self { numerator: numerator / divisor, denominator: denominator / divisor }
    }

    /// A core at `rate` with [`FAST_CYCLES_PER_INSTRUCTION`].
    #[must_use]
    pub fn fast(rate: Rate) -> Self {
        Self::new(rate.hz, rate.ppb, FAST_CYCLES_PER_INSTRUCTION)
    }

    /// When `instructions` have retired, in whole nanoseconds from the start, rounded down.
    #[must_use]
    pub fn nanos(&self, instructions: u64) -> u64 {
        // Both fit 64 bits on a nominal clock, where one hardware division does.
        if let (Ok(numerator), Ok(denominator)) = (u64::try_from(self.numerator), u64::try_from(self.denominator))
            && let Some(product) = instructions.checked_mul(numerator)
        {
            return product / denominator;
        }
        saturate(u128::from(instructions) * self.numerator / self.denominator)
    }

    /// The least number of instructions that takes `nanos` or longer.
    #[must_use]
    pub fn instructions(&self, nanos: u64) -> u64 {
        if let (Ok(numerator), Ok(denominator)) = (u64::try_from(self.numerator), u64::try_from(self.denominator))
            && let Some(product) = nanos.checked_mul(denominator)
        {
            return product.div_ceil(numerator);
        }
        saturate((u128::from(nanos) * self.denominator).div_ceil(self.numerator))
    }
}

fn saturate(value: u128) -> u64 {
    u64::try_from(value).unwrap_or(u64::MAX)
}

fn greatest_common_divisor(mut a: u128, mut b: u128) -> u128 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fast(hz: u64, ppb: i64) -> Clock {
        Clock::fast(Rate { hz, ppb })
    }

    #[test]
    fn a_second_of_instructions_is_a_second() {
        let clock = fast(144_000_000, 0);
        assert_eq!(clock.nanos(96_000_000), 1_000_000_000);
        assert_eq!(clock.instructions(1_000_000_000), 96_000_000);
    }

    #[test]
    fn one_part_per_million_is_ten_microseconds_after_ten_seconds() {
        let nominal = fast(64_000_000, 0);
        let gaining = fast(64_000_000, 1_000);
        let instructions = nominal.instructions(10_000_000_000);
        let gained = nominal.nanos(instructions) - gaining.nanos(instructions);
        assert!((9_999..=10_000).contains(&gained), "{gained} ns");
    }

    #[test]
    fn the_count_for_an_instant_is_the_first_that_reaches_it() {
        for clock in [fast(144_000_000, 0), fast(64_000_000, -20_000), fast(168_000_000, 7)] {
            for nanos in [0, 1, 10, 11, 999, 1_000_003, 10_000_000_001] {
                let count = clock.instructions(nanos);
                assert!(clock.nanos(count) >= nanos);
                assert!(count == 0 || clock.nanos(count - 1) < nanos);
            }
        }
    }
}
