//! The condition flags N, Z, C and V.

/// N, Z, C and V, in a form that costs little to set. Most instructions only store their result, and whoever reads the
/// flags computes them from that result.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flags {
    /// N is bit 31 of this word.
    negative: u32,
    /// Z is set if this word is 0.
    nonzero: u32,
    pub(crate) c: bool,
    /// V is bit 31 of this word.
    overflow: u32,
}

impl Flags {
    /// The flags whose value is `nzcv`, with N in bit 3, Z in bit 2, C in bit 1 and V in bit 0.
    pub(crate) const fn new(nzcv: u32) -> Self {
        Self { negative: nzcv << 28, nonzero: !nzcv & 4, c: nzcv & 2 != 0, overflow: nzcv << 31 }
    }

    /// The flags as a number, the reverse of [`Flags::new`].
    pub(crate) const fn nzcv(self) -> u32 {
        (self.n() as u32) << 3 | (self.z() as u32) << 2 | (self.c as u32) << 1 | self.v() as u32
    }

    #[inline(always)]
    pub(crate) const fn n(self) -> bool {
        self.negative >> 31 != 0
    }

    #[inline(always)]
    pub(crate) const fn z(self) -> bool {
        self.nonzero == 0
    }

    #[inline(always)]
    pub(crate) const fn v(self) -> bool {
        self.overflow >> 31 != 0
    }

    /// Whether the last comparison found the first operand less than the second, as signed numbers.
    #[inline(always)]
    pub(crate) const fn less(self) -> bool {
        (self.negative ^ self.overflow) >> 31 != 0
    }

    /// Sets N and Z as `value` has them.
    #[inline(always)]
    pub(crate) const fn set_nz(&mut self, value: u32) {
        self.negative = value;
        self.nonzero = value;
    }

    #[inline(always)]
    pub(crate) const fn set_v(&mut self, v: bool) {
        self.overflow = (v as u32) << 31;
    }

    /// Adds and sets all flags.
    #[inline(always)]
    pub(crate) const fn add(&mut self, a: u32, b: u32) -> u32 {
        let sum = a.wrapping_add(b);
        self.set_nz(sum);
        self.c = sum < a;
        self.overflow = (a ^ sum) & (b ^ sum);
        sum
    }

    /// Subtracts and sets all flags. C is set if there is no borrow.
    #[inline(always)]
    pub(crate) const fn subtract(&mut self, a: u32, b: u32) -> u32 {
        let difference = a.wrapping_sub(b);
        self.set_nz(difference);
        self.c = a >= b;
        self.overflow = (a ^ b) & (a ^ difference);
        difference
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::execute::arithmetic::add_with_carry;

    #[test]
    fn sums_and_differences_have_the_flags_of_an_addition_with_carry() {
        let words = [0, 1, 2, 0x7FFF_FFFE, 0x7FFF_FFFF, 0x8000_0000, 0x8000_0001, 0xFFFF_FFFE, u32::MAX];
        for (a, b) in words.into_iter().flat_map(|a| words.map(|b| (a, b))) {
            let mut flags = Flags::new(0);
            for subtract in [false, true] {
                let (sum, c, v) = add_with_carry(a, if subtract { !b } else { b }, subtract);
                let value = if subtract { flags.subtract(a, b) } else { flags.add(a, b) };
                assert_eq!((value, flags.n(), flags.z()), (sum, sum >> 31 != 0, sum == 0), "{a:#x} {b:#x}");
                assert_eq!((flags.c, flags.v()), (c, v), "{a:#x} {b:#x}");
            }
            assert_eq!(flags.less(), (a as i32) < b as i32);
        }
        assert!((0..16).all(|nzcv| Flags::new(nzcv).nzcv() == nzcv));
    }
}
