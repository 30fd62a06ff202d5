//! The execution of decoded instructions, ARM ARM A7.7.
//!
//! | module | what it has |
//! |---|---|
//! | this file | the dispatch, registers and flags, control |
//! | `data` | data processing and multiplication with their flags |
//! | `branch` | conditions and branches |
//! | `arithmetic` | arithmetic without state |
//! | `transfer` | loads and stores |
//! | [`crate::fp`] | floating point |
//!
//! An instruction that faults leaves the registers as they were, so that it can be executed again.

pub(crate) mod arithmetic;
mod branch;
mod data;
mod transfer;

use crate::op::{Carry, Do, Format, Index, Op, Shift};
use crate::{Bus, Core, Cost, Exit, Fault, Purpose, Width};
use arithmetic::{dual, extend, half, parallel, shift, signed_saturate, unary, unsigned_saturate};

/// Tells which instruction follows the one that was executed.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Flow {
    /// The instruction at the next address follows.
    On,
    /// The instruction at the next address follows, and an IT block begins with it.
    Block,
    /// The instruction at this address follows.
    To(u32),
}

impl<C: Cost> Core<C> {
    #[inline(always)]
    pub(crate) fn get(&self, n: u8) -> u32 {
        self.r[usize::from(n & 15)]
    }

    /// Writes a register that is neither the stack pointer nor the program counter.
    #[inline(always)]
    fn put(&mut self, d: u8, value: u32) {
        self.r[usize::from(d & 15)] = value;
    }

    /// Writes a register that may be the stack pointer, whose bits 1 and 0 are always clear (ARM ARM B1.4.1).
    #[inline(always)]
    fn set(&mut self, d: u8, value: u32) {
        self.put(d, if d == 13 { value & !3 } else { value });
    }

    #[inline(always)]
    fn put_nz(&mut self, d: u8, value: u32) {
        self.put(d, value);
        self.flags.set_nz(value);
    }

    #[inline(always)]
    fn branch_if(&mut self, taken: bool, target: u32) -> Flow {
        if taken { self.branch(target) } else { Flow::On }
    }

    /// Executes the instruction `op` at r15. `next` is the address behind it.
    #[inline(always)]
    pub(crate) fn execute<B: Bus>(&mut self, bus: &mut B, op: &Op, next: u32) -> Result<Flow, Fault> {
        match op.what {
            Do::MovImm { d, imm } => self.put(d, imm),
            Do::MovsImm { d, imm } => self.put_nz(d, imm),
            Do::MovReg { d, m } => self.put(d, self.get(m)),
            Do::AddImm { d, n, imm } => self.put(d, self.get(n).wrapping_add(imm)),
            Do::AddsImm { d, n, imm } => {
                let value = self.flags.add(self.get(n), imm);
                self.put(d, value);
            }
            Do::SubImm { d, n, imm } => self.put(d, self.get(n).wrapping_sub(imm)),
            Do::SubsImm { d, n, imm } => {
                let value = self.flags.subtract(self.get(n), imm);
                self.put(d, value);
            }
            Do::CmpImm { n, imm } => {
                self.flags.subtract(self.get(n), imm);
            }
            Do::AddReg { d, n, m } => self.put(d, self.get(n).wrapping_add(self.get(m))),
            Do::AddsReg { d, n, m } => {
                let value = self.flags.add(self.get(n), self.get(m));
                self.put(d, value);
            }
            Do::SubReg { d, n, m } => self.put(d, self.get(n).wrapping_sub(self.get(m))),
            Do::SubsReg { d, n, m } => {
                let value = self.flags.subtract(self.get(n), self.get(m));
                self.put(d, value);
            }
            Do::CmpReg { n, m } => {
                self.flags.subtract(self.get(n), self.get(m));
            }
            Do::AndReg { d, n, m } => self.put(d, self.get(n) & self.get(m)),
            Do::AndsReg { d, n, m } => self.put_nz(d, self.get(n) & self.get(m)),
            Do::OrrReg { d, n, m } => self.put(d, self.get(n) | self.get(m)),
            Do::OrrsReg { d, n, m } => self.put_nz(d, self.get(n) | self.get(m)),
            Do::EorReg { d, n, m } => self.put(d, self.get(n) ^ self.get(m)),
            Do::EorsReg { d, n, m } => self.put_nz(d, self.get(n) ^ self.get(m)),
            Do::AndImm { d, n, imm } => self.put(d, self.get(n) & imm),
            Do::AddLsl { d, n, m, amount } => {
                self.put(d, self.get(n).wrapping_add(self.get(m) << (amount & 31)));
            }
            Do::LslImm { d, m, amount } => self.put(d, self.get(m) << (amount & 31)),
            Do::LslsImm { d, m, amount } => {
                let (value, carry) = shift(self.get(m), Shift::Lsl, u32::from(amount), self.flags.c);
                self.flags.c = carry;
                self.put_nz(d, value);
            }
            Do::LsrImm { d, m, amount } => self.put(d, self.get(m) >> (amount & 31)),
            Do::LsrsImm { d, m, amount } => {
                let (value, carry) = shift(self.get(m), Shift::Lsr, u32::from(amount), self.flags.c);
                self.flags.c = carry;
                self.put_nz(d, value);
            }
            Do::AluImm { alu, s, d, n, carry, imm } => {
                let carry = match carry {
                    Carry::Same => self.flags.c,
                    Carry::Clear => false,
                    Carry::Set => true,
                };
                self.alu(alu, s, d, self.get(n), imm, carry);
            }
            Do::AluShift { alu, s, d, n, m, shift: kind, amount } => {
                let (value, carry) = shift(self.get(m), kind, u32::from(amount), self.flags.c);
                self.alu(alu, s, d, self.get(n), value, carry);
            }
            Do::ShiftReg { shift: kind, s, d, n, m } => {
                let (value, carry) = shift(self.get(n), kind, self.get(m) & 0xFF, self.flags.c);
                self.put(d, value);
                if s {
                    self.flags.c = carry;
                    self.flags.set_nz(value);
                }
            }
            Do::MovToPc { m } => return Ok(self.branch(self.get(m) & !1)),
            Do::AddToPc { m } => {
                let target = self.r[15].wrapping_add(4).wrapping_add(self.get(m)) & !1;
                return Ok(self.branch(target));
            }
            Do::Movt { d, imm } => self.put(d, self.get(d) & 0xFFFF | u32::from(imm) << 16),
            Do::Bfi { d, n, lsb, mask } => {
                self.put(d, self.get(d) & !mask | self.get(n) << (lsb & 31) & mask);
            }
            Do::Bfc { d, mask } => self.put(d, self.get(d) & !mask),
            Do::Sbfx { d, n, left, right } => {
                self.put(d, ((self.get(n) << (left & 31)) as i32 >> (right & 31)) as u32);
            }
            Do::Ubfx { d, n, lsb, mask } => self.put(d, self.get(n) >> (lsb & 31) & mask),
            Do::Ssat { d, n, to, shift: kind, amount } => {
                let (value, _) = shift(self.get(n), kind, u32::from(amount), false);
                let (value, saturated) = signed_saturate(i64::from(value as i32), u32::from(to));
                self.put(d, value as u32);
                self.flag_q |= saturated;
            }
            Do::Usat { d, n, to, shift: kind, amount } => {
                let (value, _) = shift(self.get(n), kind, u32::from(amount), false);
                let (value, saturated) = unsigned_saturate(i64::from(value as i32), u32::from(to));
                self.put(d, value);
                self.flag_q |= saturated;
            }
            Do::Ssat16 { d, n, to } => {
                let (low, q1) = signed_saturate(half(self.get(n), false), u32::from(to));
                let (high, q2) = signed_saturate(half(self.get(n), true), u32::from(to));
                self.put(d, (high as u32) << 16 | low as u32 & 0xFFFF);
                self.flag_q |= q1 | q2;
            }
            Do::Usat16 { d, n, to } => {
                let (low, q1) = unsigned_saturate(half(self.get(n), false), u32::from(to));
                let (high, q2) = unsigned_saturate(half(self.get(n), true), u32::from(to));
                self.put(d, high << 16 | low);
                self.flag_q |= q1 | q2;
            }
            Do::Uxtb { d, m } => self.put(d, self.get(m) & 0xFF),
            Do::Uxth { d, m } => self.put(d, self.get(m) & 0xFFFF),
            Do::Extend { kind, d, n, m, rotation } => {
                let base = if n == 15 { 0 } else { self.get(n) };
                self.put(d, extend(kind, base, self.get(m).rotate_right(u32::from(rotation))));
            }
            Do::Pkhbt { d, n, m, amount } => {
                self.put(d, self.get(n) & 0xFFFF | self.get(m) << (amount & 31) & 0xFFFF_0000);
            }
            Do::Pkhtb { d, n, m, amount } => {
                let low = (self.get(m) as i32 >> amount.min(31)) as u32;
                self.put(d, self.get(n) & 0xFFFF_0000 | low & 0xFFFF);
            }
            Do::Unary { kind, d, m } => self.put(d, unary(kind, self.get(m))),
            Do::Sel { d, n, m } => {
                let mask = (0..4).filter(|bit| self.ge >> bit & 1 != 0).fold(0, |mask, bit| mask | 0xFF << (8 * bit));
                self.put(d, self.get(n) & mask | self.get(m) & !mask);
            }
            Do::Parallel { lanes, lane, d, n, m } => {
                let (value, ge) = parallel(lanes, lane, self.get(n), self.get(m));
                self.put(d, value);
                self.ge = ge.unwrap_or(self.ge);
            }
            Do::Saturating { kind, d, n, m } => self.saturating(kind, d, n, m),
            Do::Mul { d, n, m } => self.put(d, self.get(n).wrapping_mul(self.get(m))),
            Do::Muls { d, n, m } => self.put_nz(d, self.get(n).wrapping_mul(self.get(m))),
            Do::Mla { d, n, m, a } => {
                self.put(d, self.get(a).wrapping_add(self.get(n).wrapping_mul(self.get(m))));
            }
            Do::Mls { d, n, m, a } => {
                self.put(d, self.get(a).wrapping_sub(self.get(n).wrapping_mul(self.get(m))));
            }
            Do::SmlaHalf { d, n, m, a, n_top, m_top } => {
                let product = half(self.get(n), n_top) * half(self.get(m), m_top);
                self.accumulate(d, a, product);
            }
            Do::SmlaWide { d, n, m, a, m_top } => {
                let product = (i64::from(self.get(n) as i32) * half(self.get(m), m_top)) >> 16;
                self.accumulate(d, a, product);
            }
            Do::SmlaDual { d, n, m, a, subtract, exchange } => {
                let product = dual(self.get(n), self.get(m), subtract, exchange);
                self.accumulate(d, a, product);
            }
            Do::SmmlaTop { d, n, m, a, subtract, round } => {
                let product = i64::from(self.get(n) as i32) * i64::from(self.get(m) as i32);
                let addend = if a == 15 { 0 } else { i64::from(self.get(a)) << 32 };
                let sum = if subtract { addend.wrapping_sub(product) } else { addend.wrapping_add(product) };
                let rounding = if round { 0x8000_0000 } else { 0 };
                self.put(d, (sum.wrapping_add(rounding) >> 32) as u32);
            }
            Do::Usada8 { d, n, m, a } => {
                let (x, y) = (self.get(n).to_le_bytes(), self.get(m).to_le_bytes());
                let sum: u32 = x.iter().zip(&y).map(|(x, y)| u32::from(x.abs_diff(*y))).sum();
                let addend = if a == 15 { 0 } else { self.get(a) };
                self.put(d, addend.wrapping_add(sum));
            }
            Do::LongMultiply { kind, low, high, n, m } => self.long_multiply(kind, low, high, n, m),
            Do::SmlalHalf { low, high, n, m, n_top, m_top } => {
                let product = half(self.get(n), n_top) * half(self.get(m), m_top);
                self.accumulate_long(low, high, product);
            }
            Do::SmlalDual { low, high, n, m, subtract, exchange } => {
                let product = dual(self.get(n), self.get(m), subtract, exchange);
                self.accumulate_long(low, high, product);
            }
            Do::Sdiv { d, n, m } => {
                let (a, b) = (self.get(n) as i32, self.get(m) as i32);
                if b == 0 && self.traps_zero_division() {
                    return Err(Fault::DivideByZero);
                }
                self.put(d, if b == 0 { 0 } else { a.wrapping_div(b) as u32 });
            }
            Do::Udiv { d, n, m } => {
                let (a, b) = (self.get(n), self.get(m));
                if b == 0 && self.traps_zero_division() {
                    return Err(Fault::DivideByZero);
                }
                self.put(d, a.checked_div(b).unwrap_or(0));
            }
            Do::LdrImm { t, n, imm } => {
                let value = self.load(bus, self.get(n).wrapping_add(imm), Width::Word, Purpose::Data)?;
                self.put(t, value);
            }
            Do::LdrbImm { t, n, imm } => {
                let value = self.load(bus, self.get(n).wrapping_add(imm), Width::Byte, Purpose::Data)?;
                self.put(t, value);
            }
            Do::LdrhImm { t, n, imm } => {
                let value = self.load(bus, self.get(n).wrapping_add(imm), Width::Half, Purpose::Data)?;
                self.put(t, value);
            }
            Do::StrImm { t, n, imm } => {
                self.store(bus, self.get(n).wrapping_add(imm), Width::Word, self.get(t), Purpose::Data)?;
            }
            Do::StrbImm { t, n, imm } => {
                self.store(bus, self.get(n).wrapping_add(imm), Width::Byte, self.get(t) & 0xFF, Purpose::Data)?;
            }
            Do::StrhImm { t, n, imm } => {
                self.store(bus, self.get(n).wrapping_add(imm), Width::Half, self.get(t) & 0xFFFF, Purpose::Data)?;
            }
            Do::LdrReg { t, n, m, amount } => {
                let address = self.get(n).wrapping_add(self.get(m) << (amount & 31));
                let value = self.load(bus, address, Width::Word, Purpose::Data)?;
                self.put(t, value);
            }
            Do::LdrbReg { t, n, m, amount } => {
                let address = self.get(n).wrapping_add(self.get(m) << (amount & 31));
                let value = self.load(bus, address, Width::Byte, Purpose::Data)?;
                self.put(t, value);
            }
            Do::StrReg { t, n, m, amount } => {
                let address = self.get(n).wrapping_add(self.get(m) << (amount & 31));
                self.store(bus, address, Width::Word, self.get(t), Purpose::Data)?;
            }
            Do::StrbReg { t, n, m, amount } => {
                let address = self.get(n).wrapping_add(self.get(m) << (amount & 31));
                self.store(bus, address, Width::Byte, self.get(t) & 0xFF, Purpose::Data)?;
            }
            Do::LdrLiteral { t, address } => {
                let value = self.load(bus, address, Width::Word, Purpose::Literal)?;
                self.put(t, value);
            }
            Do::LoadLiteral { format, t, address } => {
                let value = self.load_format(bus, format, address, Purpose::Literal, None)?;
                return Ok(self.loaded(bus, t, value));
            }
            Do::Load { format, index, t, n, imm } => {
                let base = self.get(n);
                let offset = base.wrapping_add(imm);
                let address = if index == Index::Post { base } else { offset };
                let privilege = (index == Index::Unprivileged).then_some(false);
                let value = self.load_format(bus, format, address, Purpose::Data, privilege)?;
                if matches!(index, Index::Pre | Index::Post) {
                    self.set(n, offset);
                }
                return Ok(self.loaded(bus, t, value));
            }
            Do::LoadReg { format, t, n, m, amount } => {
                let address = self.get(n).wrapping_add(self.get(m) << (amount & 31));
                let value = self.load_format(bus, format, address, Purpose::Data, None)?;
                return Ok(self.loaded(bus, t, value));
            }
            Do::Store { format, index, t, n, imm } => {
                let base = self.get(n);
                let offset = base.wrapping_add(imm);
                let address = if index == Index::Post { base } else { offset };
                let privilege = (index == Index::Unprivileged).then_some(false);
                self.store_format(bus, format, address, self.get(t), privilege)?;
                if matches!(index, Index::Pre | Index::Post) {
                    self.set(n, offset);
                }
            }
            Do::StoreReg { format, t, n, m, amount } => {
                let address = self.get(n).wrapping_add(self.get(m) << (amount & 31));
                self.store_format(bus, format, address, self.get(t), None)?;
            }
            Do::Ldrd { index, t, t2, n, imm } => self.load_dual(bus, index, t, t2, n, imm)?,
            Do::Strd { index, t, t2, n, imm } => self.store_dual(bus, index, t, t2, n, imm)?,
            Do::Ldrex { format, t, n, imm } => self.load_exclusive(bus, format, t, n, imm)?,
            Do::Strex { format, d, t, n, imm } => self.store_exclusive(bus, format, d, t, n, imm)?,
            Do::Clrex => self.exclusive = None,
            Do::Ldm { n, list, write_back, down } => {
                let to = self.load_multiple(bus, n, list, write_back, down, next)?;
                return Ok(if to == next { Flow::On } else { Flow::To(to) });
            }
            Do::Stm { n, list, write_back, down } => {
                let to = self.store_multiple(bus, n, list, write_back, down, next)?;
                return Ok(if to == next { Flow::On } else { Flow::To(to) });
            }
            Do::B { target } => return Ok(self.branch(target)),
            Do::BEq { target } => return Ok(self.branch_if(self.flags.z(), target)),
            Do::BNe { target } => return Ok(self.branch_if(!self.flags.z(), target)),
            Do::BCs { target } => return Ok(self.branch_if(self.flags.c, target)),
            Do::BCc { target } => return Ok(self.branch_if(!self.flags.c, target)),
            Do::BHi { target } => return Ok(self.branch_if(self.flags.c && !self.flags.z(), target)),
            Do::BLs { target } => return Ok(self.branch_if(!self.flags.c || self.flags.z(), target)),
            Do::BGe { target } => return Ok(self.branch_if(!self.flags.less(), target)),
            Do::BLt { target } => return Ok(self.branch_if(self.flags.less(), target)),
            Do::BGt { target } => return Ok(self.branch_if(!self.flags.less() && !self.flags.z(), target)),
            Do::BLe { target } => return Ok(self.branch_if(self.flags.less() || self.flags.z(), target)),
            Do::BCond { condition, target } => return Ok(self.branch_if(self.passes(condition), target)),
            Do::Bl { target } => {
                self.r[14] = next | 1;
                return Ok(self.branch(target));
            }
            Do::Bx { m } => {
                // BX PC uses the address of the instruction plus 4.
                let target = if m == 15 { self.r[15].wrapping_add(4) & !1 } else { self.get(m) };
                return Ok(Flow::To(self.branch_exchange(bus, target)));
            }
            Do::Blx { m } => {
                let target = self.get(m);
                self.r[14] = next | 1;
                self.refill();
                if target & 1 == 0 {
                    self.thumb = false;
                    self.end_burst();
                }
                return Ok(Flow::To(target & !1));
            }
            Do::Cbz { n, target } => {
                if self.get(n) == 0 {
                    return Ok(self.branch(target));
                }
            }
            Do::Cbnz { n, target } => {
                if self.get(n) != 0 {
                    return Ok(self.branch(target));
                }
            }
            Do::TableBranch { n, m, half } => {
                let base = if n == 15 { self.r[15].wrapping_add(4) } else { self.get(n) };
                let index = self.get(m);
                let (address, width) = if half {
                    (base.wrapping_add(index << 1), Width::Half)
                } else {
                    (base.wrapping_add(index), Width::Byte)
                };
                let entry = self.load(bus, address, width, Purpose::Data)?;
                return Ok(self.branch(self.r[15].wrapping_add(4).wrapping_add(entry << 1)));
            }
            Do::It { state } => {
                self.it = state;
                return Ok(Flow::Block);
            }
            Do::Nop | Do::Barrier => {}
            Do::Wfe => {
                if self.event {
                    self.event = false;
                } else {
                    self.waiting = Some(true);
                }
                self.attention = true;
                self.end_burst();
            }
            Do::Wfi => {
                self.waiting = Some(false);
                self.attention = true;
                self.end_burst();
            }
            Do::Sev => {
                self.event = true;
                self.end_burst();
            }
            Do::Svc => {
                self.catch_up();
                self.r[15] = next;
                self.end_burst();
                self.supervisor_call(bus);
                return Ok(Flow::To(self.r[15]));
            }
            Do::Bkpt => {
                self.catch_up();
                self.end_burst();
                self.breakpoint(bus);
                return Ok(Flow::To(self.r[15]));
            }
            Do::Msr { n, mask, sysm } => {
                self.msr(sysm, mask, self.get(n));
                self.end_burst();
            }
            Do::Mrs { d, sysm } => {
                let value = self.mrs(sysm);
                self.put(d, value);
            }
            Do::Cps { disable, primask, faultmask } => {
                self.cps(disable, primask, faultmask);
                if self.attention {
                    self.end_burst();
                }
            }
            Do::Fp(op) => self.execute_fp(bus, op)?,
            Do::Fault(fault) => return Err(fault),
            Do::Breakpoint => self.pause(Exit::Breakpoint),
            Do::HostCall => {
                // A semihosting call has size 0, so the run loop has not counted its fetch.
                self.fetch_waits(bus, self.r[15], 2);
                self.pause(Exit::HostCall);
            }
            // The run loop decodes an instruction before it executes it.
            Do::Unknown => return Err(Fault::BusInstruction),
        }
        Ok(Flow::On)
    }

    pub(crate) const fn width(format: Format) -> Width {
        match format {
            Format::Byte | Format::SignedByte => Width::Byte,
            Format::Half | Format::SignedHalf => Width::Half,
            Format::Word => Width::Word,
        }
    }
}
