//! The execution of floating-point instructions: what each does to registers and memory.
//!
//! | What | ARM ARM |
//! |---|---|
//! | Arithmetic on s0 to s31 | A7.7, the V* entries |
//! | VLDR, VSTR, VLDM, VSTM, VPUSH, VPOP: words in ascending order, alignment checked (MemA) | A7.7, A3.2.1 |
//! | VMOV between register files, VMRS, VMSR | A7.7 |
//! | FPSCR: which bits exist, comparison flags to the APSR | A2.5.3 |

use super::{FPSCR_BITS, FpOp, arith};
use crate::flags::Flags;
use crate::{Bus, Core, Cost, Fault, Purpose, Width};

const SIGN: u32 = arith::SIGN;

/// Expands an immediate to 32 bits (`VFPExpandImm`, ARM ARM A6.4.1).
fn expand_immediate(imm8: u8) -> u32 {
    let imm8 = u32::from(imm8);
    let exponent = if imm8 & 0x40 == 0 { 0x80 } else { 0x7C } | imm8 >> 4 & 3;
    (imm8 & 0x80) << 24 | exponent << 23 | (imm8 & 15) << 19
}

impl<C: Cost> Core<C> {
    /// Executes one floating-point instruction. `fp_ready` must have been called before. A load or store multiple that
    /// faults leaves its base register unchanged; registers that it has already loaded keep the new values, as the
    /// manual allows.
    #[inline]
    pub(crate) fn execute_fp<B: Bus>(&mut self, bus: &mut B, op: FpOp) -> Result<(), Fault> {
        self.fp_ready(bus)?;
        match op {
            FpOp::Vadd { d, n, m } => self.binary(d, n, m, arith::add),
            FpOp::Vsub { d, n, m } => self.binary(d, n, m, arith::subtract),
            FpOp::Vmul { d, n, m } => self.binary(d, n, m, arith::multiply),
            FpOp::Vdiv { d, n, m } => self.binary(d, n, m, arith::divide),
            FpOp::Vnmul { d, n, m } => self.binary(d, n, m, |n, m, fpscr| arith::multiply(n, m, fpscr) ^ SIGN),
            FpOp::Vmla { d, n, m } => self.chained(d, n, m, 0, 0),
            FpOp::Vmls { d, n, m } => self.chained(d, n, m, 0, SIGN),
            FpOp::Vnmla { d, n, m } => self.chained(d, n, m, SIGN, SIGN),
            FpOp::Vnmls { d, n, m } => self.chained(d, n, m, SIGN, 0),
            FpOp::Vfma { d, n, m } => self.fused(d, n, m, 0, 0),
            FpOp::Vfms { d, n, m } => self.fused(d, n, m, 0, SIGN),
            FpOp::Vfnma { d, n, m } => self.fused(d, n, m, SIGN, SIGN),
            FpOp::Vfnms { d, n, m } => self.fused(d, n, m, SIGN, 0),
            FpOp::Vsqrt { d, m } => self.unary(d, m, arith::square_root),
            FpOp::Vabs { d, m } => self.set_s(d, self.s(m) & !SIGN),
            FpOp::Vneg { d, m } => self.set_s(d, self.s(m) ^ SIGN),
            FpOp::Vmov { d, m } => self.set_s(d, self.s(m)),
            FpOp::VmovImmediate { d, imm8 } => self.set_s(d, expand_immediate(imm8)),
            FpOp::Vcmp { d, m, signals } => arith::compare(self.s(d), self.s(m), signals, &mut self.fpscr),
            FpOp::VcmpZero { d, signals } => arith::compare(self.s(d), 0, signals, &mut self.fpscr),
            FpOp::VcvtToInteger { d, m, unsigned, toward_zero } => {
                let target = arith::Integer { size: 32, unsigned, fraction_bits: 0 };
                self.unary(d, m, |a, fpscr| arith::to_integer(a, target, toward_zero, fpscr));
            }
            FpOp::VcvtFromInteger { d, m, unsigned } => {
                let source = arith::Integer { size: 32, unsigned, fraction_bits: 0 };
                self.unary(d, m, |a, fpscr| arith::from_integer(a, source, false, fpscr));
            }
            FpOp::VcvtToFixed { d, unsigned, size, fraction_bits } => {
                let target = arith::Integer { size, unsigned, fraction_bits };
                self.unary(d, d, |a, fpscr| arith::to_integer(a, target, true, fpscr));
            }
            FpOp::VcvtFromFixed { d, unsigned, size, fraction_bits } => {
                let source = arith::Integer { size, unsigned, fraction_bits };
                self.unary(d, d, |a, fpscr| arith::from_integer(a, source, true, fpscr));
            }
            FpOp::VcvtFromHalf { d, m, top } => {
                self.unary(d, m, |a, fpscr| arith::from_half((a >> if top { 16 } else { 0 }) as u16, fpscr));
            }
            FpOp::VcvtToHalf { d, m, top } => {
                let half = u32::from(arith::to_half(self.s(m), &mut self.fpscr));
                let old = self.s(d);
                self.set_s(d, if top { old & 0xFFFF | half << 16 } else { old & 0xFFFF_0000 | half });
            }
            FpOp::Vldr { d, words, base, add, imm8 } => {
                let (address, purpose) = self.address(base, add, imm8)?;
                let low = self.load(bus, address, Width::Word, purpose)?;
                if words == 2 {
                    let high = self.load(bus, address.wrapping_add(4), Width::Word, purpose)?;
                    self.set_s(d + 1, high);
                }
                self.set_s(d, low);
            }
            FpOp::Vstr { d, words, base, add, imm8 } => {
                let (mut address, purpose) = self.address(base, add, imm8)?;
                for register in d..d + words {
                    self.store(bus, address, Width::Word, self.s(register), purpose)?;
                    address = address.wrapping_add(4);
                }
            }
            FpOp::Vldm { d, words, base, add, write_back, imm8 } => {
                let (mut address, end) = self.block(base, add, imm8)?;
                for register in d..d + words {
                    let value = self.load(bus, address, Width::Word, Purpose::Data)?;
                    self.set_s(register, value);
                    address = address.wrapping_add(4);
                }
                if write_back {
                    self.r[usize::from(base & 15)] = end;
                }
            }
            FpOp::Vstm { d, words, base, add, write_back, imm8 } => {
                let (mut address, end) = self.block(base, add, imm8)?;
                for register in d..d + words {
                    self.store(bus, address, Width::Word, self.s(register), Purpose::Data)?;
                    address = address.wrapping_add(4);
                }
                if write_back {
                    self.r[usize::from(base & 15)] = end;
                }
            }
            FpOp::VmovFromCore { n, t } => self.set_s(n, self.r[usize::from(t & 15)]),
            FpOp::VmovToCore { n, t } => self.r[usize::from(t & 15)] = self.s(n),
            FpOp::VmovFromCorePair { m, t, t2 } => {
                self.set_s(m, self.r[usize::from(t & 15)]);
                self.set_s(m + 1, self.r[usize::from(t2 & 15)]);
            }
            FpOp::VmovToCorePair { m, t, t2 } => {
                self.r[usize::from(t & 15)] = self.s(m);
                self.r[usize::from(t2 & 15)] = self.s(m + 1);
            }
            FpOp::Vmrs { t: 15 } => {
                self.flags = Flags::new(self.fpscr >> 28);
            }
            FpOp::Vmrs { t } => self.r[usize::from(t & 15)] = self.fpscr,
            FpOp::Vmsr { t } => self.fpscr = self.r[usize::from(t & 15)] & FPSCR_BITS,
        }
        Ok(())
    }

    // The mask shows the compiler that the index is in range.
    #[inline]
    fn s(&self, register: u8) -> u32 {
        self.s[usize::from(register & 31)]
    }

    #[inline]
    fn set_s(&mut self, register: u8, value: u32) {
        self.s[usize::from(register & 31)] = value;
    }

    #[inline]
    fn unary(&mut self, d: u8, m: u8, operation: impl FnOnce(u32, &mut u32) -> u32) {
        let result = operation(self.s(m), &mut self.fpscr);
        self.set_s(d, result);
    }

    #[inline]
    fn binary(&mut self, d: u8, n: u8, m: u8, operation: impl FnOnce(u32, u32, &mut u32) -> u32) {
        let result = operation(self.s(n), self.s(m), &mut self.fpscr);
        self.set_s(d, result);
    }

    /// Executes VMLA and its relatives, which round the product and then the sum. Each sign is combined with its
    /// operand by exclusive or, as FPNeg does, NaNs included.
    #[inline]
    fn chained(&mut self, d: u8, n: u8, m: u8, addend_sign: u32, product_sign: u32) {
        let product = arith::multiply(self.s(n), self.s(m), &mut self.fpscr) ^ product_sign;
        let result = arith::add(self.s(d) ^ addend_sign, product, &mut self.fpscr);
        self.set_s(d, result);
    }

    /// Executes VFMA and its relatives, which round only the final result.
    #[inline]
    fn fused(&mut self, d: u8, n: u8, m: u8, addend_sign: u32, factor_sign: u32) {
        let (addend, factor) = (self.s(d) ^ addend_sign, self.s(n) ^ factor_sign);
        let result = arith::multiply_add(addend, factor, self.s(m), &mut self.fpscr);
        self.set_s(d, result);
    }

    /// The address and the access purpose of VLDR and VSTR.
    #[inline]
    fn address(&self, base: u8, add: bool, imm8: u8) -> Result<(u32, Purpose), Fault> {
        let (base, purpose) = if base == 15 {
            (self.r[15].wrapping_add(4) & !3, Purpose::Literal)
        } else {
            (self.r[usize::from(base & 15)], Purpose::Data)
        };
        let offset = u32::from(imm8) << 2;
        let address = if add { base.wrapping_add(offset) } else { base.wrapping_sub(offset) };
        if address & 3 == 0 { Ok((address, purpose)) } else { Err(Fault::Unaligned) }
    }

    /// The lowest address of a load or store multiple, and the new value of its base register.
    #[inline]
    fn block(&self, base: u8, add: bool, imm8: u8) -> Result<(u32, u32), Fault> {
        let base = self.r[usize::from(base & 15)];
        let length = u32::from(imm8) << 2;
        if base & 3 != 0 {
            return Err(Fault::Unaligned);
        }
        if add {
            Ok((base, base.wrapping_add(length)))
        } else {
            let start = base.wrapping_sub(length);
            Ok((start, start))
        }
    }
}
