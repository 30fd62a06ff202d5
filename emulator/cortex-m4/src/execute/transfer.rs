//! Loads and stores of more than one access or register: ARM ARM A7.7, LDM, STM, LDRD, STRD, LDREX, STREX.
//!
//! On the optimistic and the pessimistic clock, an event interrupts a load/store multiple in its middle. EPSR.ICI then
//! holds the register with which it continues (ARM ARM B1.5.10). PUSH, a transfer in an IT block and one whose base is
//! in the list complete first, which delays an interrupt by up to 16 cycles on the pessimistic clock. On the optimistic
//! clock nothing is delayed (`Core::cut_short`).
//!
//! The local exclusive monitor covers the whole address space (TRM 3.6.2). A STREX succeeds at any address unless an
//! exception, a CLREX or a STREX came after the LDREX.

use super::Flow;
use crate::op::{Format, Index};
use crate::{Bus, Core, Cost, Fault, Purpose, Width};

impl<C: Cost> Core<C> {
    /// Loads and extends a value. `privilege`, if not `None`, replaces the core's privilege.
    pub(super) fn load_format<B: Bus>(
        &mut self,
        bus: &mut B,
        format: Format,
        address: u32,
        purpose: Purpose,
        privilege: Option<bool>,
    ) -> Result<u32, Fault> {
        let width = Self::width(format);
        let value = match privilege {
            None => self.load(bus, address, width, purpose)?,
            Some(privileged) => {
                self.catch_up();
                self.load_as(bus, address, width, purpose, privileged)?
            }
        };
        Ok(match format {
            Format::SignedByte => value as i8 as u32,
            Format::SignedHalf => value as i16 as u32,
            _ => value,
        })
    }

    pub(super) fn store_format<B: Bus>(
        &mut self,
        bus: &mut B,
        format: Format,
        address: u32,
        value: u32,
        privilege: Option<bool>,
    ) -> Result<(), Fault> {
        let value = match Self::width(format) {
            Width::Byte => value & 0xFF,
            Width::Half => value & 0xFFFF,
            Width::Word => value,
        };
        match privilege {
            None => self.store(bus, address, Self::width(format), value, Purpose::Data),
            Some(privileged) => {
                self.catch_up();
                self.store_as(bus, address, Self::width(format), value, Purpose::Data, privileged)
            }
        }
    }

    /// Puts a loaded value into register `t`, which may be the program counter.
    #[inline(always)]
    pub(super) fn loaded<B: Bus>(&mut self, bus: &mut B, t: u8, value: u32) -> Flow {
        if t == 15 {
            return Flow::To(self.branch_exchange(bus, value));
        }
        self.set(t, value);
        Flow::On
    }

    /// The address of a two-word access, and the value to write back to the base.
    fn dual_address(&self, index: Index, n: u8, imm: u32) -> Result<(u32, u32), Fault> {
        let base = if n == 15 { self.r[15].wrapping_add(4) & !3 } else { self.get(n) };
        let offset = base.wrapping_add(imm);
        let address = if index == Index::Post { base } else { offset };
        if address & 3 == 0 { Ok((address, offset)) } else { Err(Fault::Unaligned) }
    }

    pub(super) fn load_dual<B: Bus>(
        &mut self,
        bus: &mut B,
        index: Index,
        t: u8,
        t2: u8,
        n: u8,
        imm: u32,
    ) -> Result<(), Fault> {
        let (address, offset) = self.dual_address(index, n, imm)?;
        let purpose = if n == 15 { Purpose::Literal } else { Purpose::Data };
        let privileged = self.is_privileged();
        let reached = self.reaches(address, 8, false, privileged);
        let first = self.load_next(bus, address, purpose, reached)?;
        let second = self.load_next(bus, address.wrapping_add(4), purpose, reached)?;
        if index != Index::Offset {
            self.set(n, offset);
        }
        self.put(t, first);
        self.put(t2, second);
        Ok(())
    }

    pub(super) fn store_dual<B: Bus>(
        &mut self,
        bus: &mut B,
        index: Index,
        t: u8,
        t2: u8,
        n: u8,
        imm: u32,
    ) -> Result<(), Fault> {
        let (address, offset) = self.dual_address(index, n, imm)?;
        let privileged = self.is_privileged();
        let reached = self.reaches(address, 8, true, privileged);
        self.store_next(bus, address, self.get(t), reached)?;
        self.store_next(bus, address.wrapping_add(4), self.get(t2), reached)?;
        if index != Index::Offset {
            self.set(n, offset);
        }
        Ok(())
    }

    pub(super) fn load_exclusive<B: Bus>(
        &mut self,
        bus: &mut B,
        format: Format,
        t: u8,
        n: u8,
        imm: u16,
    ) -> Result<(), Fault> {
        let address = self.get(n).wrapping_add(u32::from(imm));
        if address & (Self::width(format).bytes() - 1) != 0 {
            return Err(Fault::Unaligned);
        }
        let value = self.load(bus, address, Self::width(format), Purpose::Data)?;
        self.exclusive = Some(address);
        self.put(t, value);
        Ok(())
    }

    pub(super) fn store_exclusive<B: Bus>(
        &mut self,
        bus: &mut B,
        format: Format,
        d: u8,
        t: u8,
        n: u8,
        imm: u16,
    ) -> Result<(), Fault> {
        let address = self.get(n).wrapping_add(u32::from(imm));
        if address & (Self::width(format).bytes() - 1) != 0 {
            return Err(Fault::Unaligned);
        }
        let held = self.exclusive.is_some();
        if held {
            self.store_format(bus, format, address, self.get(t), None)?;
        }
        self.exclusive = None;
        self.put(d, u32::from(!held));
        Ok(())
    }

    /// The first address of a load/store multiple, and the value to write back to the base.
    fn multiple_address(&self, n: u8, list: u16, down: bool) -> Result<(u32, u32), Fault> {
        let base = self.get(n);
        let size = 4 * list.count_ones();
        let (start, end) =
            if down { (base.wrapping_sub(size), base.wrapping_sub(size)) } else { (base, base.wrapping_add(size)) };
        if start & 3 == 0 { Ok((start, end)) } else { Err(Fault::Unaligned) }
    }

    /// Returns whether a load/store multiple is interrupted before its register number `done` (from 0). It is if an
    /// event is due at that register and the instruction can be continued later.
    fn is_interrupted<B: Bus>(&self, bus: &mut B, list: u16, n: u8, down: bool, done: u32) -> bool {
        let continuable = self.it == 0 && list & (1 << n) == 0 && !(down && n == 13);
        C::BOUND.is_some()
            && done > 0
            && continuable
            && self.retired > 0
            && self.cycle > 16
            && self.cycle + u64::from(1 + done) >= self.limit_of_multiple(bus)
    }

    /// Interrupts a load/store multiple before `register`. `left` registers remain, which the run loop moves after the
    /// event.
    fn interrupt_multiple(&mut self, register: usize, left: u32) -> u32 {
        self.ici = register as u8;
        self.attention = true;
        self.end_burst();
        // An interrupted instruction is counted at full cost now, and again when it is completed. So one full cost, and
        // that of the remaining registers, are taken back here.
        self.cycle -= u64::from(left);
        self.retired -= 1;
        self.r[15]
    }

    /// Returns the registers that a continued load/store multiple still has to move, and the number that it has already
    /// moved.
    fn continued(&mut self, list: u16) -> (u16, u32) {
        let from = std::mem::take(&mut self.ici);
        let rest = list & (u16::MAX << (from & 15));
        let before = list.count_ones() - rest.count_ones();
        // The cycles of the registers that were moved before the interrupt must not count twice. The cycle for the
        // start of the instruction counts again.
        self.catch_up();
        let again = u64::from(before).min(self.cycle);
        self.cycle -= again;
        self.origin = self.origin.wrapping_sub(2 * again);
        (rest, before)
    }

    pub(super) fn load_multiple<B: Bus>(
        &mut self,
        bus: &mut B,
        n: u8,
        list: u16,
        write_back: bool,
        down: bool,
        next: u32,
    ) -> Result<u32, Fault> {
        let (start, end) = self.multiple_address(n, list, down)?;
        let (mut rest, before) = if self.ici == 0 { (list, 0) } else { self.continued(list) };
        let mut address = start.wrapping_add(4 * before);
        let mut values = [0; 16];
        let mut done = 0;
        let privileged = self.is_privileged();
        let reached = rest != 0 && self.reaches(address, 4 * rest.count_ones(), false, privileged);
        let moved = rest;
        while rest != 0 {
            let register = rest.trailing_zeros() as usize & 15;
            if self.is_interrupted(bus, list, n, down, done) {
                self.put_list(&values, moved & !rest);
                return Ok(self.interrupt_multiple(register, rest.count_ones()));
            }
            values[register] = self.load_next(bus, address, Purpose::Data, reached)?;
            address = address.wrapping_add(4);
            rest &= rest - 1;
            done += 1;
        }
        if write_back {
            self.put(n, end);
        }
        self.put_list(&values, moved & 0x7FFF);
        if list & 0x8000 != 0 { Ok(self.branch_exchange(bus, values[15])) } else { Ok(next) }
    }

    fn put_list(&mut self, values: &[u32; 16], list: u16) {
        let mut rest = list;
        while rest != 0 {
            let register = rest.trailing_zeros() as usize & 15;
            self.r[register] = values[register];
            rest &= rest - 1;
        }
    }

    pub(super) fn store_multiple<B: Bus>(
        &mut self,
        bus: &mut B,
        n: u8,
        list: u16,
        write_back: bool,
        down: bool,
        next: u32,
    ) -> Result<u32, Fault> {
        let (start, end) = self.multiple_address(n, list, down)?;
        let (mut rest, before) = if self.ici == 0 { (list, 0) } else { self.continued(list) };
        let mut address = start.wrapping_add(4 * before);
        let mut done = 0;
        let privileged = self.is_privileged();
        let reached = rest != 0 && self.reaches(address, 4 * rest.count_ones(), true, privileged);
        while rest != 0 {
            let register = rest.trailing_zeros() as u8;
            if self.is_interrupted(bus, list, n, down, done) {
                return Ok(self.interrupt_multiple(usize::from(register), rest.count_ones()));
            }
            self.store_next(bus, address, self.get(register), reached)?;
            address = address.wrapping_add(4);
            rest &= rest - 1;
            done += 1;
        }
        if write_back {
            self.put(n, end);
        }
        Ok(next)
    }
}
