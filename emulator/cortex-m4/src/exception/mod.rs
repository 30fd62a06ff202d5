//! Exceptions: entry, return, faults and sleep. ARM ARM B1.5.
//!
//! | Module | What it covers | ARM ARM |
//! |---|---|---|
//! | this one | execution priority, preemption; `WFI` and `WFE` | B1.5.4, B1.5.17 to B1.5.19 |
//! | `entry` | entry, basic and extended frames, late arrival | B1.5.6, B1.5.7, B1.5.11 |
//! | `exit` | return and its integrity checks, tail-chaining, sleep-on-exit | B1.5.8, B1.5.12, B1.5.17 |
//! | `faults` | faults, derived exceptions, escalation, lockup | B1.5.11, B1.5.14, B1.5.15 |
//! | `lazy` | lazy preservation of the floating-point state | B1.5.7, A2.5.3 |
//! | `reset` | reset, power-on | B1.5.5 |
//!
//! An entry or a return is one step, and no event interrupts its middle. An exception that arrives while an entry
//! stacks is taken by late arrival. An exception that arrives while a return unstacks preempts after the return or, on
//! the optimistic clock, replaces it. Every bus fault is precise.

mod entry;
mod exit;
mod faults;
mod lazy;
mod reset;

use crate::special::{CONTROL_FPCA, CONTROL_NPRIV, CONTROL_SPSEL};
use crate::system::nvic::{
    self, BUS_FAULT, DEBUG_MONITOR, HARD_FAULT, IDLE_PRIORITY, MEM_MANAGE, NMI, SV_CALL, USAGE_FAULT,
};
use crate::system::*;
use crate::{Access, Bound, Bus, Core, Cost, Fault, Purpose, Scheduled, Width};

/// The number of words in a basic frame (ARM ARM B1.5.7).
const BASIC: u32 = 8;
const EXTENDED: u32 = 26;

/// Bit 9 of a stacked xPSR: entry moved the stack pointer by four bytes to align it.
const REALIGNED: u32 = 1 << 9;

impl<C: Cost> Core<C> {
    /// Returns the priority to which BASEPRI, FAULTMASK and, if `primask` is true, PRIMASK raise the execution (ARM ARM
    /// B1.5.4).
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

    /// The execution priority (ARM ARM B1.5.4). An exception preempts if the number of its group priority is lower.
    #[inline]
    pub(crate) fn execution_priority(&self) -> i32 {
        self.mask_priority(true).min(self.system.nvic.active_priority).into()
    }

    #[inline]
    fn preempts(&self) -> bool {
        i32::from(self.system.nvic.best_priority) < self.execution_priority()
    }

    #[inline]
    pub(crate) fn take_signals<B: Bus>(&mut self, bus: &mut B) {
        let signals = bus.signals();
        self.system.nvic.set_levels(signals.lines(), signals.nmi());
        if signals.take_event() {
            self.event = true;
            self.attention = true;
        }
        if std::mem::take(&mut self.system.nvic.newly_pending) {
            self.attention = true;
            if self.system.scb.scr & SCR_SEVONPEND != 0 {
                self.event = true;
            }
        }
        self.note_pending();
    }

    /// Takes in the part's signals, which may wake the core. Takes the pending exception of highest priority if it
    /// preempts. The run loop calls this between instructions while `attention` is set. Returns whether an exception
    /// was entered.
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
            // A debugger's step ends after one instruction. If the core hangs, the step ends without an instruction.
            if self.retired != before || self.hung {
                self.system.debug.stepping = None;
                if self.system.debug.halting() {
                    self.halt(DFSR_HALTED);
                    return false;
                }
                self.debug_event(DFSR_HALTED);
            } else {
                // The flag `attention` stays set, because the debugger's step ends after the next instruction even if
                // nothing else happens.
                self.attention = self.waiting.is_none();
            }
        }
        if self.hung {
            return false;
        }
        if self.locked_up {
            // NMI ends a lockup at HardFault's priority. Nothing else ends a lockup (ARM ARM B1.5.15).
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

    /// Ends `WFI` or `WFE` if something wakes the core, ARM ARM B1.5.18, B1.5.19.
    fn wake(&mut self) {
        if self.waiting == Some(true) && self.event {
            self.event = false;
            self.waiting = None;
            return;
        }
        // PRIMASK keeps an interrupt from waking WFE, but not from waking WFI (ARM ARM B1.5.18, B1.5.19).
        let priority = self.mask_priority(self.waiting == Some(true)).min(self.system.nvic.active_priority);
        if self.system.nvic.best_priority < priority {
            self.waiting = None;
        }
    }
}
