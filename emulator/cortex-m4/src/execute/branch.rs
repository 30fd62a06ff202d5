//! Conditions and branches (ARM ARM A7.3).

use super::*;
use crate::Bound;

/// For each condition, the set of flags that pass it. Bit n of an entry is for the flags whose value is n, with N in
/// bit 3, Z in bit 2, C in bit 1 and V in bit 0 (ARM ARM A7.3).
const PASSES: [u16; 16] = passes();

pub(super) const fn passes() -> [u16; 16] {
    let mut table = [0; 16];
    let mut condition = 0;
    while condition < 16 {
        let mut flags = 0;
        while flags < 16 {
            let (n, z, c, v) = (flags & 8 != 0, flags & 4 != 0, flags & 2 != 0, flags & 1 != 0);
            let base = match condition >> 1 {
                0 => z,
                1 => c,
                2 => n,
                3 => v,
                4 => c && !z,
                5 => n == v,
                6 => n == v && !z,
                _ => true,
            };
            if base != (condition & 1 != 0 && condition != 15) {
                table[condition] |= 1 << flags;
            }
            flags += 1;
        }
        condition += 1;
    }
    table
}

impl<C: Cost> Core<C> {
    #[inline(always)]
    pub(crate) fn passes(&self, condition: u8) -> bool {
        PASSES[usize::from(condition & 15)] >> self.flags.nzcv() & 1 != 0
    }

    /// Branches as BXWritePC and LoadWritePC do: bit 0 of the target becomes EPSR.T. In handler mode the target may be
    /// an EXC_RETURN.
    pub(crate) fn branch_exchange<B: Bus>(&mut self, bus: &mut B, target: u32) -> u32 {
        self.refill();
        if target >= 0xF000_0000 && self.ipsr != 0 {
            let pc = self.r[15];
            self.end_burst();
            self.catch_up();
            self.exception_return(bus, target);
            // The next instruction's cycles count from the end of the exception return, which may have taken cycles
            // itself.
            self.count_from(pc, self.cycle);
            return self.r[15];
        }
        if target & 1 == 0 {
            self.thumb = false;
            self.end_burst();
        }
        target & !1
    }

    /// Refills the pipeline after a taken branch. On the pessimistic clock the next fetch counts wait states again.
    #[inline(always)]
    pub(super) fn refill(&mut self) {
        self.cycle += C::REFILL;
        if matches!(C::BOUND, Some(Bound::Worst)) {
            self.fetched = 1;
        }
    }

    #[inline(always)]
    pub(super) fn branch(&mut self, target: u32) -> Flow {
        self.refill();
        Flow::To(target)
    }
}
