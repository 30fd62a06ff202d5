//! Converts carrier cycles of the chip's crystal to virtual nanoseconds and to bit rates.

pub(crate) const CARRIER_HZ: u64 = 13_560_000;
pub(crate) const AS_PER_NS: u64 = 1_000_000_000;

pub(crate) const CYCLES_106: u64 = 128;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    millicycle_as: u64,
}

impl Clock {
    pub(crate) fn new(ppb: i64) -> Self {
        let scale = 1_000_000_000i128 + i128::from(ppb.clamp(-1_000_000, 1_000_000));
        // The result is 1000 · 10¹⁸ · 10⁹ / (13.56 · 10⁶ · (10⁹ + ppb)) as.
        let numerator = 1_000i128 * 1_000_000_000_000_000_000 * 1_000_000_000;
        let denominator = i128::from(CARRIER_HZ) * scale;
        let rounded = (numerator + denominator / 2) / denominator;
        Self { millicycle_as: u64::try_from(rounded).unwrap_or(u64::MAX) }
    }

    pub(crate) fn cycles(self, n: u64) -> u64 {
        let a = u128::from(n) * u128::from(self.millicycle_as);
        let ns = (a + 500 * u128::from(AS_PER_NS)) / (1_000 * u128::from(AS_PER_NS));
        u64::try_from(ns).unwrap_or(u64::MAX)
    }

    pub(crate) fn cycles_as(self, n: u64) -> u64 {
        let a = u128::from(n) * u128::from(self.millicycle_as) / 1_000;
        u64::try_from(a).unwrap_or(u64::MAX)
    }
}

/// Returns the number of carrier cycles in a bit, for the code `rate` of registers 04 and 24.
pub(crate) fn bit_cycles(rate: u8) -> u64 {
    CYCLES_106 >> rate
}

pub(crate) fn rate_of(cycles: u64) -> u32 {
    match cycles {
        64 => 212_000,
        32 => 424_000,
        16 => 848_000,
        _ => 106_000,
    }
}

pub(crate) fn bits_ns(bits: u64, bit_as: u64) -> u64 {
    let a = u128::from(bits) * u128::from(bit_as);
    let ns = (a + u128::from(AS_PER_NS / 2)) / u128::from(AS_PER_NS);
    u64::try_from(ns).unwrap_or(u64::MAX)
}

pub(crate) fn bits_in(ns: u64, bit_as: u64) -> u64 {
    // Half a nanosecond is added, because `bits_ns` rounds instants to ns.
    let a = u128::from(ns) * u128::from(AS_PER_NS) + u128::from(AS_PER_NS / 2);
    u64::try_from(a / u128::from(bit_as.max(1))).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn air_times_of_the_data_sheet() {
        // The frame has n bytes of payload, and so (64 + 8 (n + 3)) bits of 32 carrier cycles.
        let bit = Clock::new(0).cycles_as(32);
        assert_eq!(bits_ns(64 + 8 * (244 + 3), bit), 4_814_159);
        assert_eq!(bits_ns(64 + 8 * (254 + 3), bit), 5_002_950);
    }

    #[test]
    fn a_fast_crystal_shortens_time() {
        assert_eq!(Clock::new(0).cycles(13_560_000), 1_000_000_000);
        assert_eq!(Clock::new(1_000).cycles(13_560_000), 999_999_000);
        assert_eq!(Clock::new(-1_000).cycles(13_560_000), 1_000_001_000);
    }

    #[test]
    fn bits_and_time_are_inverse() {
        for ppb in [-50_000, 0, 37_123] {
            let bit = Clock::new(ppb).cycles_as(32);
            for n in 0..3_000 {
                assert_eq!(bits_in(bits_ns(n, bit), bit), n);
            }
        }
    }
}
