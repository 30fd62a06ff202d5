//! Debug control, ARM ARM C1.6: DHCSR, DCRSR, DCRDR and DEMCR; and debug events, C1.5.
//!
//! Left out: C_SNAPSTALL has no effect, and MON_STEP steps only after the monitor's own exception return.

use super::{Core, Cost, DFSR_HALTED, nvic};

const C_DEBUGEN: u32 = 1;
const C_HALT: u32 = 1 << 1;
const C_STEP: u32 = 1 << 2;
const C_MASKINTS: u32 = 1 << 3;

/// The value of the program counter in a lockup (ARM ARM B1.5.15).
const LOCKUP_ADDRESS: u32 = 0xFFFF_FFFE;

const MON_EN: u32 = 1 << 16;
const MON_PEND: u32 = 1 << 17;
const MON_STEP: u32 = 1 << 18;
const TRCENA: u32 = 1 << 24;
/// The bits that DEMCR stores: VC_*, MON_EN, MON_STEP, MON_REQ, TRCENA. MON_PEND is the pending state of DebugMonitor.
const DEMCR_KEPT: u32 = 0x010D_07F1;

/// The vector catch bits of DEMCR.
pub(crate) const VC_CORERESET: u32 = 1;
pub(crate) const VC_MMERR: u32 = 1 << 4;
pub(crate) const VC_NOCPERR: u32 = 1 << 5;
pub(crate) const VC_CHKERR: u32 = 1 << 6;
pub(crate) const VC_STATERR: u32 = 1 << 7;
pub(crate) const VC_BUSERR: u32 = 1 << 8;
pub(crate) const VC_INTERR: u32 = 1 << 9;
pub(crate) const VC_HARDERR: u32 = 1 << 10;

#[derive(Clone, Debug, Default)]
pub(crate) struct Debug {
    /// Bits 5:0 of DHCSR.
    control: u32,
    demcr: u32,
    dcrdr: u32,
    /// The bit DHCSR.S_RESET_ST.
    was_reset: bool,
    /// The value of `retired` when DHCSR was last read, for S_RETIRE_ST.
    retired_seen: u64,
    /// The DFSR bits for the reason why the core must halt before the next instruction, 0 if it need not halt.
    pub(crate) halt_wanted: u32,
    /// The value of `retired` before the present step. A halting debugger or the monitor has begun this step.
    pub(crate) stepping: Option<u64>,
}

impl Debug {
    pub(super) fn reset(&mut self) {
        self.was_reset = true;
        self.halt_wanted = 0;
        self.stepping = None;
        self.control &= !(C_HALT | C_STEP);
        // A reset of the core resets the monitor's bits of DEMCR, and only a power-on resets its other bits (ARM ARM
        // C1.6.5).
        self.demcr &= !(MON_EN | MON_STEP | 1 << 19);
    }

    pub(crate) fn halting(&self) -> bool {
        self.control & C_DEBUGEN != 0
    }

    pub(crate) fn monitoring(&self) -> bool {
        self.demcr & MON_EN != 0
    }

    pub(crate) fn catches(&self, kinds: u32) -> bool {
        self.halting() && self.demcr & kinds != 0
    }
}

impl<C: Cost> Core<C> {
    pub(super) fn debug_registers_read(&mut self, offset: u32, debugger: bool) -> Option<u32> {
        let debug = &mut self.system.debug;
        Some(match offset {
            0xDF0 => {
                let retired = self.retired != debug.retired_seen;
                let value = debug.control
                    | 1 << 16
                    | u32::from(self.halted) << 17
                    | u32::from(self.waiting.is_some()) << 18
                    | u32::from(self.locked_up) << 19
                    | u32::from(retired) << 24
                    | u32::from(debug.was_reset) << 25;
                // Only a debugger's read clears the sticky bits of DHCSR.
                if debugger {
                    debug.retired_seen = self.retired;
                    debug.was_reset = false;
                }
                value
            }
            0xDF4 => 0,
            0xDF8 => debug.dcrdr,
            _ => {
                let pending = nvic::contains(&self.system.nvic.pending, nvic::DEBUG_MONITOR);
                debug.demcr | if pending { MON_PEND } else { 0 }
            }
        })
    }

    pub(super) fn debug_registers_write(&mut self, offset: u32, value: u32, debugger: bool) -> bool {
        match offset {
            0xDF0 => self.write_dhcsr(value, debugger),
            0xDF4 if self.halted => self.transfer(value),
            0xDF4 => {}
            0xDF8 => self.system.debug.dcrdr = value,
            _ => {
                self.system.debug.demcr = value & DEMCR_KEPT;
                if value & MON_PEND != 0 {
                    self.system.nvic.pend(nvic::DEBUG_MONITOR);
                } else {
                    self.system.nvic.unpend(nvic::DEBUG_MONITOR);
                }
                self.system.dwt.set_on(value & TRCENA != 0, self.cycle);
                self.system.breakpoints_changed = true;
                self.system.settle();
            }
        }
        true
    }

    fn write_dhcsr(&mut self, value: u32, debugger: bool) {
        if value >> 16 != 0xA05F {
            return;
        }
        let debug = &mut self.system.debug;
        // The core itself cannot write C_DEBUGEN (ARM ARM C1.6.2).
        let enable = if debugger { value & C_DEBUGEN } else { debug.control & C_DEBUGEN };
        debug.control = if enable != 0 { value & 0x2E | enable } else { 0 };
        let control = debug.control;
        let masked = control & C_MASKINTS != 0;
        self.system.nvic.set_masked(masked);
        if control & C_HALT != 0 {
            if debugger {
                self.halt(DFSR_HALTED);
            } else {
                self.system.debug.halt_wanted |= DFSR_HALTED;
                self.attention = true;
            }
        } else if self.halted {
            self.resume();
            self.system.debug.stepping = (control & C_STEP != 0).then_some(self.retired);
        }
    }

    pub(crate) fn halt(&mut self, reason: u32) {
        self.system.scb.dfsr |= reason;
        self.system.debug.halt_wanted = 0;
        self.system.debug.stepping = None;
        self.system.debug.control |= C_HALT;
        // Entering Debug state ends WFI and WFE, and leaves a lockup (ARM ARM B1.5.18, B1.5.19, B1.5.15).
        self.waiting = None;
        if std::mem::take(&mut self.locked_up) {
            self.r[15] = LOCKUP_ADDRESS;
        }
        if !self.halted {
            self.advance_timers();
            self.halted = true;
            self.pause_timers();
        }
    }

    pub(crate) fn resume(&mut self) {
        self.halted = false;
        self.attention = true;
        self.pause_timers();
    }

    pub(crate) fn pause_timers(&mut self) {
        self.system.systick.pause(self.cycle, self.halted);
        self.system.dwt.pause(self.cycle, self.halted);
        self.system.settle();
    }

    /// Halts the core, or makes DebugMonitor pending, before the next instruction. If neither is enabled, the event is
    /// lost (ARM ARM C1.5.1).
    pub(crate) fn debug_event(&mut self, reason: u32) {
        if self.system.debug.halting() {
            self.system.debug.halt_wanted |= reason;
            self.attention = true;
        } else if self.monitor_can_be_taken() {
            self.system.scb.dfsr |= reason;
            self.system.nvic.pend(nvic::DEBUG_MONITOR);
            self.attention = true;
        }
    }

    pub(crate) fn monitor_can_be_taken(&self) -> bool {
        self.system.debug.monitoring()
            && i32::from(self.system.nvic.group_priority(nvic::DEBUG_MONITOR)) < self.execution_priority()
    }

    /// Begins a step of the monitor: after the exception return, the code that the monitor interrupted executes one
    /// instruction (ARM ARM C1.5.2).
    pub(crate) fn begin_monitor_step(&mut self) {
        let debug = &self.system.debug;
        if debug.demcr & MON_STEP != 0 && !debug.halting() && self.monitor_can_be_taken() {
            self.system.debug.stepping = Some(self.retired);
            self.attention = true;
        }
    }

    /// Executes a write of DCRSR: moves a value between DCRDR and a register of the halted core (ARM ARM C1.6.3).
    fn transfer(&mut self, selector: u32) {
        let write = selector & 1 << 16 != 0;
        let value = self.system.debug.dcrdr;
        let process = self.control & 2 != 0;
        let index = (selector & 0x7F) as usize;
        let register = match index {
            0..=15 => &mut self.r[index],
            17 if process => &mut self.other_sp,
            18 if !process => &mut self.other_sp,
            17 | 18 => &mut self.r[13],
            33 => &mut self.fpscr,
            64..=95 => &mut self.s[index - 64],
            16 | 20 => return self.transfer_special(index, write, value),
            _ => return,
        };
        if write {
            *register = match index {
                13 | 17 | 18 => value & !3,
                15 => value & !1,
                _ => value,
            };
        } else {
            self.system.debug.dcrdr = *register;
        }
    }

    fn transfer_special(&mut self, index: usize, write: bool, value: u32) {
        match (index, write) {
            (16, true) => {
                let before = self.ipsr;
                self.set_xpsr(value);
                self.exception_changed_from(before);
            }
            (16, false) => self.system.debug.dcrdr = self.xpsr(),
            (_, true) => {
                let [primask, basepri, faultmask, control] = value.to_le_bytes();
                self.primask = primask & 1 != 0;
                self.basepri = basepri & self.system.nvic.priority_mask;
                self.faultmask = faultmask & 1 != 0;
                self.set_stack((control & 2 != 0) && self.ipsr == 0);
                self.control = self.control & 2 | control & 5;
            }
            (_, false) => {
                self.system.debug.dcrdr =
                    u32::from_le_bytes([self.primask.into(), self.basepri, self.faultmask.into(), self.control]);
            }
        }
    }
}
