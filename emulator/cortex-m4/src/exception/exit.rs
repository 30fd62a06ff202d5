//! Exception return: its checks, tail-chaining and unstacking (ARM ARM B1.5.8, B1.5.12).

use super::*;

impl<C: Cost> Core<C> {
    fn pop_word<B: Bus>(&mut self, bus: &mut B, address: u32, privileged: bool) -> Result<u32, Fault> {
        if !self.mpu_data(address, false, privileged) {
            return Err(Fault::MemData(address));
        }
        let access = self.stack_access(address, Purpose::Stack, privileged);
        if address >> 20 == 0xE00 {
            return Err(Fault::BusData(address));
        }
        let value = bus.read(&access).map_err(|_| Fault::BusData(address))?;
        self.stack_wait(bus, &access);
        Ok(value)
    }

    /// Returns from a handler (ARM ARM B1.5.8): unstacks the frame, or takes a pending exception without unstacking.
    /// `value` is the EXC_RETURN.
    pub(crate) fn exception_return<B: Bus>(&mut self, bus: &mut B, value: u32) {
        // The handler may have lowered its interrupt line. The core must see the low line before it deactivates the
        // exception.
        self.system_advance();
        self.take_signals(bus);
        self.note_scheduled(Scheduled::Exit);
        let number = self.ipsr;
        let nested = self.system.nvic.active_count();
        let base_allowed = nested == 1 || self.system.scb.ccr & CCR_NONBASETHRDENA != 0;
        let (to_thread, process, legal) = match value & 0xF {
            0x1 => (false, false, true),
            0x9 => (true, false, base_allowed),
            0xD => (true, true, base_allowed),
            _ => (true, false, false),
        };
        // Bits 27:5 are ones in every EXC_RETURN. Other values are UNPREDICTABLE, and here they fault.
        let legal = legal && value & 0x0FFF_FFE0 == 0x0FFF_FFE0 && nvic::contains(&self.system.nvic.active, number);
        let value = 0xF000_0000 | value;
        self.system.nvic.deactivate(number);
        // A return from any exception but NMI clears FAULTMASK.
        if number != NMI {
            self.faultmask = false;
            self.note_mask();
        }
        if !legal {
            self.refuse_return(bus, value);
            return;
        }
        // While lazy preservation is active, the registers still hold the FP state, and memory has no copy.
        let fp_in_memory = value & 0x10 == 0 && self.system.scb.fpccr & FPCCR_LSPACT == 0;
        let unstacked = self.cycle + C::EXCEPTION_RETURN + if fp_in_memory { C::FP_UNSTACKING } else { 0 };
        if self.preempts() || self.is_abandoned(bus, unstacked) {
            self.cycle += C::TAIL_CHAIN;
            self.take_best(bus, value);
            return;
        }
        self.cycle = unstacked + std::mem::take(&mut self.owed);
        // The core switches to the stack pointer of the interrupted code only after it has checked the frame. Until
        // then that pointer may be `other_sp`.
        let frame = if process && self.control & CONTROL_SPSEL == 0 { self.other_sp } else { self.r[13] };
        let privileged = !to_thread || self.control & CONTROL_NPRIV == 0;
        let words = match self.pop_frame(bus, frame, fp_in_memory, privileged) {
            Ok(words) => words,
            Err(fault) => {
                self.derived_fault(fault, false);
                if !self.locked_up {
                    self.cycle += C::TAIL_CHAIN;
                    self.take_best(bus, value);
                }
                return;
            }
        };
        let xpsr = words[7];
        if (xpsr & 0x1FF == 0) != to_thread {
            // The ARM ARM pops the frame and pushes it again. Leaving it in place has the same result.
            self.refuse_return(bus, value);
            return;
        }
        let extended = value & 0x10 == 0;
        self.set_stack(process);
        let align = extended || self.system.scb.ccr & CCR_STKALIGN != 0;
        let size = 4 * if extended { EXTENDED } else { BASIC };
        self.r[13] = frame.wrapping_add(size) | if align && xpsr & REALIGNED != 0 { 4 } else { 0 };
        self.r[..4].copy_from_slice(&words[..4]);
        self.r[12] = words[4];
        self.r[14] = words[5];
        self.r[15] = words[6] & !1;
        self.set_xpsr(xpsr);
        self.exception_changed();
        self.control = self.control & !CONTROL_FPCA | if extended { CONTROL_FPCA } else { 0 };
        if extended {
            self.restore_fp(&words);
        }
        self.exclusive = None;
        self.event = true;
        self.attention = true;
        self.begin_monitor_step();
        if to_thread && nested == 1 && self.system.scb.scr & SCR_SLEEPONEXIT != 0 {
            self.waiting = Some(false);
        }
    }

    /// Whether, on the optimistic clock, a preempting exception arrives before the cycle `unstacked`, at which
    /// unstacking ends. The core then abandons the return and tail-chains the exception (Yiu, "The Definitive Guide to
    /// ARM Cortex-M3 and Cortex-M4 Processors", chapter 8, "pop preemption").
    fn is_abandoned<B: Bus>(&mut self, bus: &mut B, unstacked: u64) -> bool {
        if C::BOUND != Some(Bound::Best) {
            return false;
        }
        let mut last = None;
        loop {
            let due = bus.due().min(self.system_due());
            if due >= unstacked || last == Some(due) {
                return false;
            }
            last = Some(due);
            self.cycle = self.cycle.max(due);
            bus.advance(self.cycle);
            self.system_advance();
            self.take_signals(bus);
            if self.preempts() {
                return true;
            }
        }
    }

    /// Refuses a return that fails a check: enters UsageFault without unstacking. ARM ARM B1.5.8.
    fn refuse_return<B: Bus>(&mut self, bus: &mut B, value: u32) {
        self.system.scb.cfsr |= CFSR_INVPC;
        if self.pend_fault(USAGE_FAULT) {
            self.catch(debug_catch::STATERR);
            self.cycle += C::TAIL_CHAIN;
            self.take_best(bus, value);
        }
    }

    /// Reads the frame that a return unstacks: eight words, and seventeen more if the FP state is in memory.
    fn pop_frame<B: Bus>(&mut self, bus: &mut B, frame: u32, fp: bool, privileged: bool) -> Result<[u32; 25], Fault> {
        let mut words = [0; 25];
        let mut count = BASIC;
        if fp {
            if !self.fpu_allowed(privileged) {
                return Err(Fault::NoCoprocessor);
            }
            count = EXTENDED - 1;
        }
        for (index, word) in words.iter_mut().enumerate().take(count as usize) {
            *word = self.pop_word(bus, frame.wrapping_add(4 * index as u32), privileged)?;
        }
        Ok(words)
    }

    fn restore_fp(&mut self, words: &[u32; 25]) {
        if self.system.scb.fpccr & FPCCR_LSPACT != 0 {
            self.system.scb.fpccr &= !FPCCR_LSPACT;
        } else {
            self.s[..16].copy_from_slice(&words[8..24]);
            self.fpscr = words[24] & crate::fp::FPSCR_BITS;
        }
    }
}
