//! Pseudo-random numbers. Their sequence must never change, since a recording's cases are made again from its seed.

/// The generator SplitMix64.
#[derive(Clone, Debug)]
pub(crate) struct Random(u64);

impl Random {
    /// Begins a sequence that differs for each pair of seed and stream.
    #[must_use]
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        let mut random = Self(seed ^ stream.wrapping_mul(0xD6E8_FEB8_6659_FD93));
        random.next();
        random
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub(crate) fn bits(&mut self) -> u32 {
        (self.next() >> 32) as u32
    }

    pub(crate) fn below(&mut self, limit: u32) -> u32 {
        ((u64::from(self.bits()) * u64::from(limit)) >> 32) as u32
    }

    pub(crate) fn once_in(&mut self, of: u32) -> bool {
        self.below(of) == 0
    }

    pub(crate) fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len() as u32) as usize]
    }

    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.below(i as u32 + 1) as usize);
        }
    }

    /// Draws a word that is likely to reveal errors of arithmetic: boundaries, small numbers, extreme halves and bytes,
    /// or any bits.
    pub(crate) fn word(&mut self) -> u32 {
        const EDGES: [u32; 16] = [
            0,
            1,
            2,
            0x7F,
            0x80,
            0xFF,
            0x7FFF,
            0x8000,
            0xFFFF,
            0x7FFF_FFFF,
            0x8000_0000,
            0x8000_0001,
            0xFFFF_FFFF,
            0x8000_8000,
            0x7FFF_7FFF,
            0x7F80_7F80,
        ];
        match self.below(8) {
            0 | 1 => self.pick(&EDGES),
            2 => self.below(40),
            3 => self.below(40).wrapping_neg(),
            4 => 1 << self.below(32),
            _ => self.bits(),
        }
    }

    /// Draws a single-precision number: any kind of zero, denormal, infinity and NaN, numbers near powers of two and
    /// near limits of conversions, or any bits.
    pub(crate) fn float(&mut self) -> u32 {
        let sign = self.bits() & 0x8000_0000;
        let near = |random: &mut Self, value: u32| value.wrapping_add(random.below(5)).wrapping_sub(2);
        sign | match self.below(16) {
            0 => 0,
            1 => 0x7F80_0000,
            2 => 0x7FC0_0000 | (self.bits() & 0x003F_FFFF),
            3 => 0x7F80_0001 | (self.bits() & 0x003F_FFFF),
            4 => self.bits() & 0x007F_FFFF,
            5 => near(self, 0x0080_0000),
            6 => near(self, 0x7F7F_FFFE),
            7 => near(self, 0x3F80_0000),
            8 => {
                let exponent = 1 + self.below(253);
                near(self, exponent << 23)
            }
            9 => {
                let limit = self.pick(&[0x4F00_0000, 0x4F80_0000, 0x4700_0000, 0x4780_0000, 0x477F_E000]);
                near(self, limit)
            }
            10 => (self.below(40) as f32 * 0.25).to_bits(),
            11 => ((127 + 12 - self.below(26)) << 23) | (self.bits() & 0x007F_E000),
            12 => ((127 - 8 + self.below(40)) << 23) | (self.bits() & 0x007F_FFFF),
            13 => ((127 - 8 + self.below(16)) << 23) | (self.bits() & 0x007F_FFFF),
            _ => self.bits() & 0x7FFF_FFFF,
        }
    }
}
