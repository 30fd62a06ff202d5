//! Data processing, multiplication and saturation with the flags that they set (ARM ARM A5.3.1, A7.7).

use super::arithmetic::add_with_carry;
use super::*;
use crate::op::{Alu, Long, Saturating};

impl<C: Cost> Core<C> {
    /// Executes one of the operations of ARM ARM A5.3.1. `carry` is the carry out of the operand's shift.
    pub(super) fn alu(&mut self, alu: Alu, s: bool, d: u8, a: u32, b: u32, carry: bool) {
        let logical = |value| (value, carry, self.flags.v());
        let (value, c, v) = match alu {
            Alu::And | Alu::Tst => logical(a & b),
            Alu::Bic => logical(a & !b),
            Alu::Orr => logical(a | b),
            Alu::Orn => logical(a | !b),
            Alu::Eor | Alu::Teq => logical(a ^ b),
            Alu::Mov => logical(b),
            Alu::Mvn => logical(!b),
            Alu::Add | Alu::Cmn => add_with_carry(a, b, false),
            Alu::Adc => add_with_carry(a, b, self.flags.c),
            Alu::Sbc => add_with_carry(a, !b, self.flags.c),
            Alu::Sub | Alu::Cmp => add_with_carry(a, !b, true),
            Alu::Rsb => add_with_carry(!a, b, true),
        };
        if s {
            self.flags.set_nz(value);
            self.flags.c = c;
            self.flags.set_v(v);
        }
        if !matches!(alu, Alu::Tst | Alu::Teq | Alu::Cmn | Alu::Cmp) {
            self.set(d, value);
        }
    }

    /// Adds `product` to register `a` for the SMLAxy family, and sets Q if the sum overflows. If `a` is 15, the addend
    /// is 0.
    pub(super) fn accumulate(&mut self, d: u8, a: u8, product: i64) {
        let sum = if a == 15 { product } else { product + i64::from(self.get(a) as i32) };
        self.put(d, sum as u32);
        self.flag_q |= sum != i64::from(sum as i32);
    }

    pub(super) fn accumulate_long(&mut self, low: u8, high: u8, product: i64) {
        let sum = self.pair(low, high).wrapping_add(product as u64);
        self.put_pair(low, high, sum);
    }

    fn pair(&self, low: u8, high: u8) -> u64 {
        u64::from(self.get(high)) << 32 | u64::from(self.get(low))
    }

    fn put_pair(&mut self, low: u8, high: u8, value: u64) {
        self.put(low, value as u32);
        self.put(high, (value >> 32) as u32);
    }

    pub(super) fn long_multiply(&mut self, kind: Long, low: u8, high: u8, n: u8, m: u8) {
        let unsigned = u64::from(self.get(n)) * u64::from(self.get(m));
        let signed = (i64::from(self.get(n) as i32) * i64::from(self.get(m) as i32)) as u64;
        let value = match kind {
            Long::Smull => signed,
            Long::Umull => unsigned,
            Long::Smlal => self.pair(low, high).wrapping_add(signed),
            Long::Umlal => self.pair(low, high).wrapping_add(unsigned),
            Long::Umaal => unsigned + u64::from(self.get(low)) + u64::from(self.get(high)),
        };
        self.put_pair(low, high, value);
    }

    pub(super) fn saturating(&mut self, kind: Saturating, d: u8, n: u8, m: u8) {
        let (a, b) = (i64::from(self.get(m) as i32), i64::from(self.get(n) as i32));
        let (doubled, q1) = match kind {
            Saturating::DoubleAdd | Saturating::DoubleSub => signed_saturate(2 * b, 32),
            Saturating::Add | Saturating::Sub => (b as i32, false),
        };
        let (value, q2) = match kind {
            Saturating::Add | Saturating::DoubleAdd => signed_saturate(a + i64::from(doubled), 32),
            Saturating::Sub | Saturating::DoubleSub => signed_saturate(a - i64::from(doubled), 32),
        };
        self.put(d, value as u32);
        self.flag_q |= q1 | q2;
    }
}
