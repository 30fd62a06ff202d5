//! Exceptions: entry, return, faults, sleep. ARM ARM B1.5.
//!
//! | Covered | ARM ARM |
//! |---|---|
//! | execution priority, preemption, tail-chaining, late arrival | B1.5.4, B1.5.11, B1.5.12 |
//! | entry, basic and extended frames | B1.5.6, B1.5.7 |
//! | return and its integrity checks | B1.5.8 |
//! | faults, derived exceptions, escalation, lockup | B1.5.11, B1.5.14, B1.5.15 |
//! | lazy preservation of the floating-point state | B1.5.7, A2.5.3 |
//! | `WFI`, `WFE`, sleep-on-exit | B1.5.17 to B1.5.19 |
//!
//! Entry and return are each one step: nothing interrupts them in their middle. What arrives while an entry stacks is
//! served by late arrival; what arrives while a return unstacks preempts right after it. Imprecise bus faults do not
//! exist in this model: every bus fault is precise.

use crate::special::{CONTROL_FPCA, CONTROL_NPRIV, CONTROL_SPSEL};
use crate::system::nvic::{
    self, BUS_FAULT, DEBUG_MONITOR, HARD_FAULT, IDLE_PRIORITY, MEM_MANAGE, NMI, SV_CALL, USAGE_FAULT,
};
use crate::system::*;
use crate::{Access, Bus, Core, Cost, Fault, Purpose, Width};

/// Words of a basic frame and of one with the floating-point state, ARM ARM B1.5.7.
const BASIC: u32 = 8;
const EXTENDED: u32 = 26;

/// Bit 9 of a stacked xPSR: the stack pointer was moved by four to align it.
const REALIGNED: u32 = 1 << 9;

/// CPACR: access to the FPU for all, or for privileged code.
const CP10_PRIVILEGED: u32 = 1;
const CP10_FULL: u32 = 3;

impl<C: Cost> Core<C> {
    /// The priority that PRIMASK (if `primask`), BASEPRI and FAULTMASK give, ARM ARM B1.5.4.
    #[inline]
    pub(crate) fn mask_priority(&self, primask: bool) -> i16 {
        if self.faultmask {
            -1
        } else if self.primask && primask {
            0
        } else if self.basepri != 0 {
            self.system.nvic.group_of(self.basepri.into())
        } else {
            IDLE_PRIORITY
        }
    }

    /// The execution priority, ARM ARM B1.5.4: an exception is taken if its group priority is lower.
    #[inline]
    pub(crate) fn execution_priority(&self) -> i32 {
        self.mask_priority(true).min(self.system.nvic.active_priority).into()
    }

    /// Whether the best pending exception preempts.
    #[inline]
    fn preempts(&self) -> bool {
        i32::from(self.system.nvic.best_priority) < self.execution_priority()
    }

    /// Takes in the interrupt lines and outside events. Leaves `Signals::changed` to the run loop.
    #[inline]
    pub(crate) fn take_signals<B: Bus>(&mut self, bus: &mut B) {
        let signals = bus.signals();
        self.system.nvic.set_levels(&signals.lines, signals.nmi);
        if std::mem::take(&mut signals.event) {
            self.event = true;
            self.attention = true;
        }
        if std::mem::take(&mut self.system.nvic.newly_pending) {
            self.attention = true;
            if self.system.scb.scr & SCR_SEVONPEND != 0 {
                self.event = true;
            }
        }
    }

    /// Takes in what the part drives, then takes the highest pending exception if it preempts; wakes the core. To be
    /// called between instructions whenever `attention` is set. Answers whether an exception was entered.
    pub(crate) fn look_at_exceptions<B: Bus>(&mut self, bus: &mut B) -> bool {
        self.system_advance();
        self.take_signals(bus);
        self.attention = false;
        if self.halted {
            return false;
        }
        if self.system.debug.halt_wanted != 0 {
            let reason = self.system.debug.halt_wanted;
            self.halt(reason);
            return false;
        }
        if let Some(before) = self.system.debug.stepping {
            // else the step is still to come, see `debug_stepping`
            if self.retired != before {
                self.system.debug.stepping = None;
                if self.system.debug.halting() {
                    self.halt(DFSR_HALTED);
                    return false;
                }
                self.debug_event(DFSR_HALTED);
            }
        }
        if self.locked_up {
            // only NMI leaves a lockup, and only one at HardFault's priority (ARM ARM B1.5.15)
            if self.system.nvic.best != NMI || !self.preempts() {
                return false;
            }
            self.locked_up = false;
            self.r[15] = 0xFFFF_FFFE;
        }
        if self.waiting.is_some() {
            self.wake();
        }
        if self.preempts() {
            let to = self.r[15];
            self.enter(bus, to);
            return true;
        }
        false
    }

    /// Ends `WFI` or `WFE` if there is a reason to, ARM ARM B1.5.18, B1.5.19.
    fn wake(&mut self) {
        if self.waiting == Some(true) && self.event {
            self.event = false;
            self.waiting = None;
            return;
        }
        // WFI wakes for what would preempt if PRIMASK were clear; WFE only for what is taken
        let priority = self.mask_priority(self.waiting == Some(true)).min(self.system.nvic.active_priority);
        if self.system.nvic.best_priority < priority {
            self.waiting = None;
        }
    }

    fn stack_access(&self, address: u32, purpose: Purpose, privileged: bool) -> Access {
        Access { address, width: Width::Word, purpose, privileged, cycle: self.cycle, pc: self.r[15] }
    }

    fn stack_wait<B: Bus>(&mut self, bus: &mut B, access: &Access) {
        if let Some(bound) = C::BOUND {
            self.cycle += u64::from(bus.wait_states(access, bound));
        }
    }

    /// One word of exception entry. The fault is of data; what it means is the caller's.
    fn push_word<B: Bus>(&mut self, bus: &mut B, address: u32, value: u32, privileged: bool) -> Result<(), Fault> {
        if !self.mpu_data(address, true, privileged) {
            return Err(Fault::MemData(address));
        }
        let access = self.stack_access(address, Purpose::Stack, privileged);
        // no stack is in the private peripheral bus
        if address >> 20 == 0xE00 || bus.write(&access, value).is_err() {
            return Err(Fault::BusData(address));
        }
        self.stack_wait(bus, &access);
        Ok(())
    }

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

    /// Reads a word of the vector table; the MPU does not apply (ARM ARM B3.5.1).
    fn vector<B: Bus>(&mut self, bus: &mut B, number: u16) -> Option<u32> {
        let address = self.system.scb.vtor.wrapping_add(4 * u32::from(number));
        let access = self.stack_access(address, Purpose::Vector, true);
        if address >> 20 == 0xE00 {
            return None;
        }
        let value = bus.read(&access).ok()?;
        self.stack_wait(bus, &access);
        Some(value)
    }

    /// Exception entry: stacks, then takes the best pending exception. One that preempts is pending.
    fn enter<B: Bus>(&mut self, bus: &mut B, return_address: u32) {
        self.waiting = None;
        self.cycle += C::EXCEPTION_ENTRY;
        let exc_return = 0xFFFF_FFE1
            | u32::from(self.control & CONTROL_FPCA == 0) << 4
            | u32::from(self.ipsr == 0) << 3
            | u32::from(self.control & CONTROL_SPSEL) << 1;
        if let Err(fault) = self.push_frame(bus, return_address) {
            self.derived_fault(fault, true);
            if self.locked_up {
                // from HardFault to NMI: "lockup at NMI priority" (TRM 3.9.1)
                self.lock_up_at(NMI);
                return;
            }
        }
        self.take_late_arrivals(bus);
        self.take_best(bus, exc_return);
    }

    /// What came while an entry or a return was under way takes part in the choice of what is served next.
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

    /// PushStack, ARM ARM B1.5.6. The stack pointer is moved even if a word cannot be written.
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

    fn push_fp<B: Bus>(&mut self, bus: &mut B, at: u32, privileged: bool) -> Result<(), Fault> {
        for index in 0..16 {
            self.push_word(bus, at.wrapping_add(4 * index), self.s[index as usize], privileged)?;
        }
        self.push_word(bus, at.wrapping_add(64), self.fpscr, privileged)
    }

    /// UpdateFPCCR, ARM ARM B1.5.7: where the state goes if a handler uses the FPU, and which faults could be taken
    /// now.
    fn prepare_lazy_preservation(&mut self, frame: u32, privileged: bool) {
        let priority = self.execution_priority();
        let nvic = &self.system.nvic;
        let ready = |number: u16, enabled: bool| enabled && i32::from(nvic.group_priority(number)) < priority;
        let mut fpccr = self.system.scb.fpccr & (FPCCR_ASPEN | FPCCR_LSPEN) | FPCCR_LSPACT;
        for (flag, set) in [
            (FPCCR_USER, !privileged),
            (FPCCR_THREAD, self.ipsr == 0),
            (FPCCR_HFRDY, priority > -1),
            (FPCCR_BFRDY, ready(BUS_FAULT, nvic::contains(&nvic.enabled, BUS_FAULT))),
            (FPCCR_MMRDY, ready(MEM_MANAGE, nvic::contains(&nvic.enabled, MEM_MANAGE))),
            (FPCCR_MONRDY, ready(DEBUG_MONITOR, self.system.debug.monitoring())),
        ] {
            if set {
                fpccr |= flag;
            }
        }
        self.system.scb.fpccr = fpccr;
        self.system.scb.fpcar = frame.wrapping_add(4 * BASIC) & !7;
    }

    /// ExceptionTaken, ARM ARM B1.5.6, of the best pending exception.
    fn take_best<B: Bus>(&mut self, bus: &mut B, exc_return: u32) {
        let (number, vector) = loop {
            let number = self.system.nvic.best;
            if let Some(vector) = self.vector(bus, number) {
                break (number, vector);
            }
            self.system.scb.hfsr |= HFSR_VECTTBL;
            // without its vector the exception cannot be served; HardFault is taken in its place, and it stays pending
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
        self.system.nvic.activate(number);
        self.system.nvic.newly_pending = false;
        self.exclusive = None;
        self.event = true;
        self.waiting = None;
        // a step ends with the entry, before the handler's first instruction (ARM ARM C1.5.2)
        if self.system.debug.stepping.is_some() {
            self.system.debug.stepping = Some(u64::MAX);
            self.attention = true;
        }
        self.attention |= self.system.debug.halt_wanted != 0;
    }

    /// Leaves the handler: unstacks, or serves what is pending without unstacking. `value` is what was branched to, an
    /// EXC_RETURN. ARM ARM B1.5.8.
    pub(crate) fn exception_return<B: Bus>(&mut self, bus: &mut B, value: u32) {
        // A line that the handler made fall must be seen to be low before the exception is no longer active. What is
        // pending by now is served by tail-chaining.
        self.system_advance();
        self.take_signals(bus);
        let number = self.ipsr;
        let nested = self.system.nvic.active_count();
        let base_allowed = nested == 1 || self.system.scb.ccr & CCR_NONBASETHRDENA != 0;
        let (to_thread, process, legal) = match value & 0xF {
            0x1 => (false, false, true),
            0x9 => (true, false, base_allowed),
            0xD => (true, true, base_allowed),
            _ => (true, false, false),
        };
        // bits 27:5 are ones in every EXC_RETURN; what others do is UNPREDICTABLE, a fault is the strictest of it
        let legal = legal && value & 0x0FFF_FFE0 == 0x0FFF_FFE0 && nvic::contains(&self.system.nvic.active, number);
        let value = 0xF000_0000 | value;
        self.system.nvic.deactivate(number);
        // all but NMI clear FAULTMASK on their return
        if number != NMI {
            self.faultmask = false;
        }
        if !legal {
            self.refuse_return(bus, value);
            return;
        }
        if self.preempts() {
            self.cycle += C::TAIL_CHAIN;
            self.take_best(bus, value);
            return;
        }
        self.cycle += C::EXCEPTION_RETURN;
        // the stack to return to is in use once the frame has been found good
        let frame = if process && self.control & CONTROL_SPSEL == 0 { self.other_sp } else { self.r[13] };
        let privileged = !to_thread || self.control & CONTROL_NPRIV == 0;
        let words = match self.pop_frame(bus, frame, value, privileged) {
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
            // The ARM ARM pops the frame and pushes it again; the same words then are at the same place.
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

    /// A return that fails a check: UsageFault, entered without unstacking. ARM ARM B1.5.8.
    fn refuse_return<B: Bus>(&mut self, bus: &mut B, value: u32) {
        self.system.scb.cfsr |= CFSR_INVPC;
        if self.pend_fault(USAGE_FAULT) {
            self.catch(debug_catch::STATERR);
            self.cycle += C::TAIL_CHAIN;
            self.take_best(bus, value);
        }
    }

    /// Reads the frame that a return unstacks: eight words, and with the FP state, if it is there, seventeen more.
    fn pop_frame<B: Bus>(&mut self, bus: &mut B, frame: u32, value: u32, privileged: bool) -> Result<[u32; 25], Fault> {
        let mut words = [0; 25];
        let mut count = BASIC;
        // while the state is still in the registers, memory has no copy of it
        if value & 0x10 == 0 && self.system.scb.fpccr & FPCCR_LSPACT == 0 {
            if !self.fpu_allowed(privileged) {
                return Err(Fault::NoCoprocessor);
            }
            self.cycle += C::FP_UNSTACKING;
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

    /// A stacking (`entry`) or unstacking fault: its exception becomes pending beside the one being entered, and the
    /// higher of the two is taken first. ARM ARM B1.5.11.
    fn derived_fault(&mut self, fault: Fault, entry: bool) {
        let (number, flag, kind) = match (fault, entry) {
            (Fault::MemData(_), true) => (MEM_MANAGE, CFSR_MSTKERR, debug_catch::INTERR),
            (Fault::MemData(_), false) => (MEM_MANAGE, CFSR_MUNSTKERR, debug_catch::INTERR),
            (Fault::NoCoprocessor, _) => (USAGE_FAULT, CFSR_NOCP, debug_catch::NOCPERR),
            (_, true) => (BUS_FAULT, CFSR_STKERR, debug_catch::INTERR),
            (_, false) => (BUS_FAULT, CFSR_UNSTKERR, debug_catch::INTERR),
        };
        self.system.scb.cfsr |= flag;
        self.pend_fault(number);
        self.catch(kind);
    }

    fn pend_escalated(&mut self, number: u16) {
        let nvic = &self.system.nvic;
        let taken =
            nvic::contains(&nvic.enabled, number) && i32::from(nvic.group_priority(number)) < self.execution_priority();
        if taken {
            self.system.nvic.pend(number);
        } else {
            self.system.scb.hfsr |= HFSR_FORCED;
            self.system.nvic.pend(HARD_FAULT);
        }
    }

    /// Makes the exception of a synchronous fault pending, as HardFault where it is off or does not preempt; locks up
    /// where HardFault does not either. Answers whether an exception is to be taken. ARM ARM B1.5.11, B1.5.15.
    fn pend_fault(&mut self, number: u16) -> bool {
        if self.execution_priority() <= -1 {
            if number != HARD_FAULT {
                self.system.scb.hfsr |= HFSR_FORCED;
            }
            self.lock_up();
            return false;
        }
        self.pend_escalated(number);
        true
    }

    /// Locks up as if in the handler of HardFault or NMI, which could not be entered.
    fn lock_up_at(&mut self, number: u16) {
        self.set_stack(false);
        self.ipsr = number;
        self.system.nvic.activate(number);
        self.lock_up();
    }

    /// The core locks up now, as a fault inside a fault handler makes it (ARM ARM B1.5.15).
    pub fn lock_up(&mut self) {
        self.locked_up = true;
        self.attention = true;
    }

    /// Vector catch: the core halts at the first instruction of the handler.
    fn catch(&mut self, kinds: u32) {
        let forced = self.system.nvic.best == HARD_FAULT;
        if self.system.debug.catches(kinds | if forced { debug_catch::HARDERR } else { 0 }) {
            self.system.debug.halt_wanted |= DFSR_VCATCH;
            self.attention = true;
        }
    }

    /// Whether data bus faults are ignored now: CCR.BFHFNMIGN in HardFault, NMI or with FAULTMASK (ARM ARM B3.2.8).
    #[inline]
    pub(crate) fn ignores_bus_faults(&self) -> bool {
        self.system.scb.ccr & CCR_BFHFNMIGN != 0 && self.execution_priority() < 0
    }

    /// The instruction at r15 faulted: sets the status and enters the handler, or locks up. The IT state is still that
    /// of the instruction.
    pub(crate) fn take_fault<B: Bus>(&mut self, bus: &mut B, fault: Fault) {
        if matches!(fault, Fault::BusData(_)) && self.ignores_bus_faults() {
            self.skip_instruction(bus);
            return;
        }
        let (number, flag, kind) = match fault {
            Fault::Undefined => (USAGE_FAULT, CFSR_UNDEFINSTR, debug_catch::STATERR),
            Fault::InvalidState => (USAGE_FAULT, CFSR_INVSTATE, debug_catch::STATERR),
            Fault::InvalidPc => (USAGE_FAULT, CFSR_INVPC, debug_catch::STATERR),
            Fault::NoCoprocessor => (USAGE_FAULT, CFSR_NOCP, debug_catch::NOCPERR),
            Fault::Unaligned => (USAGE_FAULT, CFSR_UNALIGNED, debug_catch::CHKERR),
            Fault::DivideByZero => (USAGE_FAULT, CFSR_DIVBYZERO, debug_catch::CHKERR),
            Fault::BusData(address) => {
                self.note_fault_address(address, CFSR_MMARVALID);
                (BUS_FAULT, CFSR_PRECISERR | CFSR_BFARVALID, debug_catch::BUSERR)
            }
            Fault::BusInstruction => (BUS_FAULT, CFSR_IBUSERR, debug_catch::BUSERR),
            Fault::BusStacking => (BUS_FAULT, CFSR_STKERR, debug_catch::INTERR),
            Fault::BusUnstacking => (BUS_FAULT, CFSR_UNSTKERR, debug_catch::INTERR),
            Fault::MemData(address) => {
                self.note_fault_address(address, CFSR_BFARVALID);
                (MEM_MANAGE, CFSR_DACCVIOL | CFSR_MMARVALID, debug_catch::MMERR)
            }
            Fault::MemInstruction => (MEM_MANAGE, CFSR_IACCVIOL, debug_catch::MMERR),
            Fault::MemStacking => (MEM_MANAGE, CFSR_MSTKERR, debug_catch::INTERR),
            Fault::MemUnstacking => (MEM_MANAGE, CFSR_MUNSTKERR, debug_catch::INTERR),
            Fault::VectorRead => {
                self.system.scb.hfsr |= HFSR_VECTTBL;
                (HARD_FAULT, 0, debug_catch::INTERR)
            }
            Fault::BusLazy | Fault::MemLazy => {
                // `fp_ready` has made the exception pending and found that it preempts, or locked up
                if !self.locked_up && self.preempts() {
                    let to = self.r[15];
                    self.enter(bus, to);
                }
                return;
            }
            Fault::Breakpoint => {
                self.breakpoint(bus);
                return;
            }
        };
        self.system.scb.cfsr |= flag;
        if self.pend_fault(number) {
            self.catch(kind);
            let to = self.r[15];
            self.enter(bus, to);
        }
    }

    /// MMFAR and BFAR are one register in this core: an address of the one makes the other's invalid (TRM table 4-1).
    fn note_fault_address(&mut self, address: u32, other: u32) {
        self.system.scb.fault_address = address;
        self.system.scb.cfsr &= !other;
    }

    /// Goes on behind a load or store whose bus fault is ignored. What the load reads is UNKNOWN: registers stay.
    #[cold]
    fn skip_instruction<B: Bus>(&mut self, bus: &mut B) {
        let wide = bus.fetch(self.r[15]).is_ok_and(|first| first >> 11 >= 0x1D);
        self.r[15] = self.r[15].wrapping_add(if wide { 4 } else { 2 });
        // ITAdvance, ARM ARM A7.3.2
        self.it = if self.it & 7 == 0 { 0 } else { self.it & 0xE0 | self.it << 1 & 0x1F };
    }

    /// SVC: r15 is the next instruction. Where SVCall does not preempt, it is a HardFault, whose return address is the
    /// next instruction too: Zephyr's fault handler relies on it on silicon, and QEMU does it. A core that locks up
    /// stays at the SVC.
    pub(crate) fn supervisor_call<B: Bus>(&mut self, bus: &mut B) {
        let next = self.r[15];
        if self.pend_fault(SV_CALL) {
            self.enter(bus, next);
        } else {
            self.r[15] = next.wrapping_sub(2);
        }
    }

    /// BKPT, or an instruction at a breakpoint of the FPB: halts, or DebugMonitor, or HardFault. r15 is its address.
    /// ARM ARM C1.5.1.
    pub(crate) fn breakpoint<B: Bus>(&mut self, bus: &mut B) {
        if self.system.debug.halting() {
            self.halt(DFSR_BKPT);
            return;
        }
        let number = if self.monitor_can_be_taken() {
            self.system.scb.dfsr |= DFSR_BKPT;
            DEBUG_MONITOR
        } else {
            self.system.scb.hfsr |= HFSR_DEBUGEVT;
            self.system.scb.dfsr |= DFSR_BKPT;
            HARD_FAULT
        };
        if self.pend_fault(number) {
            let to = self.r[15];
            self.enter(bus, to);
        }
    }

    /// CPACR: whether the FPU may be used.
    #[inline]
    fn fpu_allowed(&self, privileged: bool) -> bool {
        match self.system.scb.cpacr >> 20 & 3 {
            CP10_FULL => true,
            CP10_PRIVILEGED => privileged,
            _ => false,
        }
    }

    /// An FP instruction is about to execute, ARM ARM A2.5.3 (ExecuteFPCheck): is the FPU allowed; saves the state that
    /// lazy preservation left in the registers; begins a floating-point context.
    #[inline]
    pub(crate) fn fp_ready<B: Bus>(&mut self, bus: &mut B) -> Result<(), Fault> {
        if !self.fpu_allowed(self.is_privileged()) {
            return Err(Fault::NoCoprocessor);
        }
        if self.system.scb.fpccr & FPCCR_LSPACT != 0 {
            self.preserve_fp(bus)?;
        }
        if self.control & CONTROL_FPCA == 0 && self.system.scb.fpccr & FPCCR_ASPEN != 0 {
            const DEFAULTS: u32 = 0x07C0_0000;
            self.fpscr = self.fpscr & !DEFAULTS | self.system.scb.fpdscr & DEFAULTS;
            self.control |= CONTROL_FPCA;
        }
        Ok(())
    }

    /// PreserveFPState, ARM ARM B1.5.7. A fault is judged by what could be taken when the frame was made; if it cannot
    /// be taken now it stays pending, and the instruction goes on.
    #[cold]
    fn preserve_fp<B: Bus>(&mut self, bus: &mut B) -> Result<(), Fault> {
        let fpccr = self.system.scb.fpccr;
        let privileged = fpccr & FPCCR_USER == 0;
        self.cycle += C::LAZY_STACKING;
        if let Err(fault) = self.push_fp(bus, self.system.scb.fpcar, privileged) {
            let (number, flag, ready, fault) = match fault {
                Fault::MemData(_) => (MEM_MANAGE, CFSR_MLSPERR, FPCCR_MMRDY, Fault::MemLazy),
                _ => (BUS_FAULT, CFSR_LSPERR, FPCCR_BFRDY, Fault::BusLazy),
            };
            self.system.scb.cfsr |= flag;
            if fpccr & ready != 0 {
                self.system.nvic.pend(number);
            } else {
                self.system.scb.hfsr |= HFSR_FORCED;
                if fpccr & FPCCR_HFRDY == 0 {
                    self.lock_up();
                    return Err(fault);
                }
                self.system.nvic.pend(HARD_FAULT);
            }
            self.attention = true;
            if self.preempts() {
                return Err(fault);
            }
        }
        self.system.scb.fpccr &= !FPCCR_LSPACT;
        Ok(())
    }

    /// A system reset: registers, stack pointer and program counter as after reset (ARM ARM B1.5.5). Time and the
    /// counts of it go on; the debug components keep their state, as only a power-on resets them.
    pub fn reset<B: Bus>(&mut self, bus: &mut B) {
        self.system_advance();
        self.system.reset();
        self.halted = false;
        self.pause_timers();
        self.ipsr = 0;
        self.it = 0;
        self.ici = 0;
        self.primask = false;
        self.faultmask = false;
        self.basepri = 0;
        self.control = 0;
        self.fpscr = 0;
        self.exclusive = None;
        self.event = false;
        self.waiting = None;
        self.locked_up = false;
        self.r[14] = 0xFFFF_FFFF;
        self.attention = true;
        let (Some(stack), Some(start)) = (self.vector(bus, 0), self.vector(bus, 1)) else {
            // without them the core locks up at once (ARM ARM B1.5.15)
            self.system.scb.hfsr |= HFSR_VECTTBL;
            self.lock_up_at(HARD_FAULT);
            return;
        };
        self.r[13] = stack & !3;
        self.r[15] = start & !1;
        self.thumb = start & 1 != 0;
        if self.system.debug.catches(debug_catch::CORERESET) {
            self.halt(DFSR_VCATCH);
        }
    }

    /// The supply came on: as [`Core::reset`], and the debug components are new too.
    pub fn power_on<B: Bus>(&mut self, bus: &mut B) {
        self.halted = false;
        self.system.power_on();
        self.r[..13].fill(0);
        self.other_sp = 0;
        self.s = [0; 32];
        (self.flag_n, self.flag_z, self.flag_c, self.flag_v, self.flag_q) = (false, false, false, false, false);
        self.ge = 0;
        self.reset(bus);
    }
}
