//! The floating-point state in exceptions: access, stacking, lazy preservation (ARM ARM B1.5.7, A2.5.3).

use super::*;

/// The values of a coprocessor's field in CPACR that give access to privileged code, and to all code.
const CP10_PRIVILEGED: u32 = 1;
const CP10_FULL: u32 = 3;

impl<C: Cost> Core<C> {
    pub(super) fn push_fp<B: Bus>(&mut self, bus: &mut B, at: u32, privileged: bool) -> Result<(), Fault> {
        for index in 0..16 {
            self.push_word(bus, at.wrapping_add(4 * index), self.s[index as usize], privileged)?;
        }
        self.push_word(bus, at.wrapping_add(64), self.fpscr, privileged)
    }

    /// Prepares lazy preservation (UpdateFPCCR, ARM ARM B1.5.7). Records where the FP state is to be saved, and which
    /// faults could be taken at present.
    pub(super) fn prepare_lazy_preservation(&mut self, frame: u32, privileged: bool) {
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

    #[inline]
    pub(super) fn fpu_allowed(&self, privileged: bool) -> bool {
        match self.system.scb.cpacr >> 20 & 3 {
            CP10_FULL => true,
            CP10_PRIVILEGED => privileged,
            _ => false,
        }
    }

    /// Prepares for an FP instruction (ExecuteFPCheck, ARM ARM A2.5.3): checks that the FPU is allowed, saves the state
    /// that lazy preservation left in the registers, and begins a floating-point context.
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

    /// Saves the FP state (PreserveFPState, ARM ARM B1.5.7). The exception of a fault depends on what could be taken
    /// when the frame was made. If the exception cannot be taken now, it stays pending and the instruction goes on.
    #[cold]
    fn preserve_fp<B: Bus>(&mut self, bus: &mut B) -> Result<(), Fault> {
        let fpccr = self.system.scb.fpccr;
        let privileged = fpccr & FPCCR_USER == 0;
        self.catch_up();
        self.preserved_fp = self.cycle;
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
}
