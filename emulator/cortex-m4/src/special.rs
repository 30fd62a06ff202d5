//! Special registers: MRS, MSR and CPS (ARM ARM B5.2), the program status register, and the selection of the stack.
//!
//! An access that is not allowed at this privilege reads zero or writes nothing (B5.2.2, B5.2.3).

use crate::flags::Flags;
use crate::{Core, Cost};

/// CONTROL.nPRIV: thread mode is unprivileged.
pub(crate) const CONTROL_NPRIV: u8 = 1;
/// CONTROL.SPSEL: the process stack is in use.
pub(crate) const CONTROL_SPSEL: u8 = 2;
/// CONTROL.FPCA: a floating-point context is active.
pub(crate) const CONTROL_FPCA: u8 = 4;

impl<C: Cost> Core<C> {
    #[inline]
    pub(crate) fn is_privileged(&self) -> bool {
        self.ipsr != 0 || self.control & CONTROL_NPRIV == 0
    }

    pub(crate) fn set_stack(&mut self, process: bool) {
        if process != (self.control & CONTROL_SPSEL != 0) {
            std::mem::swap(&mut self.r[13], &mut self.other_sp);
            self.control ^= CONTROL_SPSEL;
        }
    }

    fn apsr(&self) -> u32 {
        self.flags.nzcv() << 28 | u32::from(self.flag_q) << 27 | u32::from(self.ge) << 16
    }

    fn set_flags(&mut self, value: u32) {
        self.flags = Flags::new(value >> 28);
        self.flag_q = value >> 27 & 1 != 0;
    }

    fn set_ge(&mut self, value: u32) {
        self.ge = (value >> 16 & 0xF) as u8;
    }

    /// APSR, EPSR and IPSR as one word (ARM ARM B1.4.2).
    pub(crate) fn xpsr(&self) -> u32 {
        let it = u32::from(self.it);
        let progress = if self.it == 0 { u32::from(self.ici) << 12 } else { (it & 3) << 25 | (it >> 2) << 10 };
        self.apsr() | u32::from(self.thumb) << 24 | progress | u32::from(self.ipsr)
    }

    pub(crate) fn set_xpsr(&mut self, value: u32) {
        self.set_flags(value);
        self.set_ge(value);
        self.thumb = value >> 24 & 1 != 0;
        self.ipsr = (value & 0x1FF) as u16;
        let progress = (value >> 25 & 3 | (value >> 10 & 0x3F) << 2) as u8;
        // EPSR shares a field between ICI and the IT state. The field holds ICI if its bits 3:0 are zero, which the IT
        // state of a block never has (ARM ARM B1.4.2).
        (self.it, self.ici) = if progress & 0xF == 0 { (0, progress >> 4) } else { (progress, 0) };
    }

    /// Executes MRS, ARM ARM B5.2.2. `sysm` is the instruction's SYSm field.
    pub(crate) fn mrs(&self, sysm: u8) -> u32 {
        let process = self.control & CONTROL_SPSEL != 0;
        match sysm {
            0..=7 => {
                // EPSR reads as zero.
                let apsr = if sysm & 4 == 0 { self.apsr() } else { 0 };
                let ipsr = if sysm & 1 != 0 { u32::from(self.ipsr) } else { 0 };
                apsr | ipsr
            }
            20 => u32::from(self.control),
            _ if !self.is_privileged() => 0,
            8 => {
                if process {
                    self.other_sp
                } else {
                    self.r[13]
                }
            }
            9 => {
                if process {
                    self.r[13]
                } else {
                    self.other_sp
                }
            }
            16 => self.primask.into(),
            17 | 18 => self.basepri.into(),
            19 => self.faultmask.into(),
            _ => 0,
        }
    }

    /// Executes MSR, ARM ARM B5.2.3. `mask` is the instruction's two-bit field: bit 1 writes NZCVQ, bit 0 writes GE.
    pub(crate) fn msr(&mut self, sysm: u8, mask: u8, value: u32) {
        if sysm < 8 {
            if sysm & 4 == 0 {
                if mask & 2 != 0 {
                    self.set_flags(value);
                }
                if mask & 1 != 0 {
                    self.set_ge(value);
                }
            }
            return;
        }
        if !self.is_privileged() {
            return;
        }
        let process = self.control & CONTROL_SPSEL != 0;
        let priority = value as u8 & self.system.nvic.priority_mask;
        match sysm {
            8 if process => self.other_sp = value & !3,
            9 if !process => self.other_sp = value & !3,
            8 | 9 => self.r[13] = value & !3,
            16 => self.primask = value & 1 != 0,
            17 => self.basepri = priority,
            // A write of BASEPRI_MAX can only raise the priority.
            18 if priority != 0 && (self.basepri == 0 || priority < self.basepri) => self.basepri = priority,
            19 => self.set_faultmask(value & 1 != 0),
            20 => {
                self.control =
                    self.control & !(CONTROL_NPRIV | CONTROL_FPCA) | value as u8 & (CONTROL_NPRIV | CONTROL_FPCA);
                // A write of SPSEL is ignored in handler mode.
                if self.ipsr == 0 {
                    self.set_stack(value as u8 & CONTROL_SPSEL != 0);
                }
            }
            _ => {}
        }
        self.priority_changed();
    }

    /// Sets or clears FAULTMASK. It can be set only at a priority below HardFault's (ARM ARM B5.2.1, B5.2.3).
    fn set_faultmask(&mut self, set: bool) {
        if !set || self.execution_priority() > -1 {
            self.faultmask = set;
        }
    }

    /// Executes CPSID (`disable`) or CPSIE, ARM ARM B5.2.1.
    pub(crate) fn cps(&mut self, disable: bool, primask: bool, faultmask: bool) {
        if !self.is_privileged() {
            return;
        }
        if primask {
            self.primask = disable;
        }
        if faultmask {
            self.set_faultmask(disable);
        }
        self.priority_changed();
    }

    fn priority_changed(&mut self) {
        self.attention |= self.system.nvic.best != 0;
        self.note_mask();
    }
}
