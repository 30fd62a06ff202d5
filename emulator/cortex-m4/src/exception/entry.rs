//! Exception entry: stacking, late arrival and the vector fetch (ARM ARM B1.5.6, B1.5.7, B1.5.11).

use super::*;

impl<C: Cost> Core<C> {
    pub(super) fn stack_access(&self, address: u32, purpose: Purpose, privileged: bool) -> Access {
        Access { address, width: Width::Word, purpose, privileged, cycle: self.cycle, pc: self.r[15] }
    }

    pub(super) fn stack_wait<B: Bus>(&mut self, bus: &mut B, access: &Access) {
        if let Some(bound) = C::BOUND {
            self.cycle += u64::from(bus.wait_states(access, bound));
        }
    }

    /// Writes one word of an exception frame. Returns a failure as a data fault, which the caller turns into a stacking
    /// fault.
    pub(super) fn push_word<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        value: u32,
        privileged: bool,
    ) -> Result<(), Fault> {
        if !self.mpu_data(address, true, privileged) {
            return Err(Fault::MemData(address));
        }
        let access = self.stack_access(address, Purpose::Stack, privileged);
        // Stacking into the private peripheral bus takes a fault.
        if address >> 20 == 0xE00 || bus.write(&access, value).is_err() {
            return Err(Fault::BusData(address));
        }
        self.stack_wait(bus, &access);
        Ok(())
    }

    /// Reads a word of the vector table, to which the MPU does not apply (ARM ARM B3.5.1).
    pub(super) fn vector<B: Bus>(&mut self, bus: &mut B, number: u16) -> Option<u32> {
        let address = self.system.scb.vtor.wrapping_add(4 * u32::from(number));
        let access = self.stack_access(address, Purpose::Vector, true);
        if address >> 20 == 0xE00 {
            return None;
        }
        let value = bus.read(&access).ok()?;
        self.stack_wait(bus, &access);
        Some(value)
    }

    /// Stacks the registers and takes the pending exception of highest priority. The caller has checked that there is
    /// one and that it preempts.
    pub(super) fn enter<B: Bus>(&mut self, bus: &mut B, return_address: u32) {
        self.waiting = None;
        self.owed += std::mem::take(&mut self.cut);
        self.note_scheduled(Scheduled::Entry);
        self.cycle += C::EXCEPTION_ENTRY;
        let exc_return = 0xFFFF_FFE1
            | u32::from(self.control & CONTROL_FPCA == 0) << 4
            | u32::from(self.ipsr == 0) << 3
            | u32::from(self.control & CONTROL_SPSEL) << 1;
        if let Err(fault) = self.push_frame(bus, return_address) {
            self.derived_fault(fault, true);
            if self.locked_up {
                // A failed entry from HardFault to NMI is a "lockup at NMI priority" (TRM 3.9.1).
                self.lock_up_at(NMI);
                return;
            }
        }
        self.take_late_arrivals(bus);
        self.take_best(bus, exc_return);
    }

    /// Takes in the signals that changed during an entry or a return, because they may make another exception the next
    /// one.
    fn take_late_arrivals<B: Bus>(&mut self, bus: &mut B) {
        let before = self.system.nvic.best;
        if bus.due() <= self.cycle {
            bus.advance(self.cycle);
        }
        self.system_advance();
        self.take_signals(bus);
        if self.system.nvic.best != before && before != 0 {
            self.cycle += C::LATE_ARRIVAL;
        }
    }

    /// Stacks a frame (PushStack, ARM ARM B1.5.6). The stack pointer moves even if a word cannot be written.
    fn push_frame<B: Bus>(&mut self, bus: &mut B, return_address: u32) -> Result<(), Fault> {
        let extended = self.control & CONTROL_FPCA != 0;
        let align = extended || self.system.scb.ccr & CCR_STKALIGN != 0;
        let words = if extended { EXTENDED } else { BASIC };
        let realigned = align && self.r[13] & 4 != 0;
        let mut frame = self.r[13].wrapping_sub(4 * words);
        if align {
            frame &= !4;
        }
        self.r[13] = frame;
        let privileged = self.is_privileged();
        let xpsr = self.xpsr() & !REALIGNED | if realigned { REALIGNED } else { 0 };
        let [r0, r1, r2, r3] = [self.r[0], self.r[1], self.r[2], self.r[3]];
        for (index, word) in [r0, r1, r2, r3, self.r[12], self.r[14], return_address, xpsr].into_iter().enumerate() {
            self.push_word(bus, frame.wrapping_add(4 * index as u32), word, privileged)?;
        }
        if extended {
            if self.system.scb.fpccr & FPCCR_LSPEN != 0 {
                self.prepare_lazy_preservation(frame, privileged);
            } else {
                if !self.fpu_allowed(privileged) {
                    return Err(Fault::NoCoprocessor);
                }
                self.cycle += C::FP_STACKING;
                self.push_fp(bus, frame.wrapping_add(4 * BASIC), privileged)?;
            }
        }
        Ok(())
    }

    /// Takes the pending exception of highest priority (ExceptionTaken, ARM ARM B1.5.6).
    pub(super) fn take_best<B: Bus>(&mut self, bus: &mut B, exc_return: u32) {
        let (number, vector) = loop {
            let number = self.system.nvic.best;
            if let Some(vector) = self.vector(bus, number) {
                break (number, vector);
            }
            self.system.scb.hfsr |= HFSR_VECTTBL;
            // An exception whose vector cannot be read stays pending, and the core takes HardFault instead.
            if number == HARD_FAULT || number == NMI {
                self.lock_up_at(number);
                return;
            }
            self.system.nvic.pend(HARD_FAULT);
            if self.system.debug.catches(debug_catch::INTERR) {
                self.system.debug.halt_wanted |= DFSR_VCATCH;
            }
        };
        self.set_stack(false);
        self.control &= !CONTROL_FPCA;
        self.r[14] = exc_return;
        self.r[15] = vector & !1;
        self.thumb = vector & 1 != 0;
        self.it = 0;
        self.ici = 0;
        self.ipsr = number;
        self.in_fault = (HARD_FAULT..=USAGE_FAULT).contains(&number) && self.tells_faults;
        self.exception_changed();
        self.system.nvic.activate(number);
        self.system.nvic.newly_pending = false;
        self.exclusive = None;
        self.event = true;
        self.waiting = None;
        // A debugger's step ends with the entry, before the handler's first instruction (ARM ARM C1.5.2).
        if self.system.debug.stepping.is_some() {
            self.system.debug.stepping = Some(u64::MAX);
            self.attention = true;
        }
        self.attention |= self.system.debug.halt_wanted != 0;
    }
}
