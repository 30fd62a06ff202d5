//! Reset and power-on (ARM ARM B1.5.5).

use super::*;
use crate::flags::Flags;

impl<C: Cost> Core<C> {
    /// Carries out a system reset (ARM ARM B1.5.5): registers, stack pointer and program counter get their reset
    /// values. The cycle count goes on, and the debug components keep their state.
    pub fn reset<B: Bus>(&mut self, bus: &mut B) {
        self.system_advance();
        self.system.reset();
        self.halted = false;
        self.hung = false;
        self.pause_timers();
        let active = std::mem::take(&mut self.ipsr);
        self.exception_changed_from(active);
        self.note_scheduled(Scheduled::Reset);
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
        self.in_fault = false;
        (self.cut, self.owed) = (0, 0);
        self.code.forget_rewrites();
        self.r[14] = 0xFFFF_FFFF;
        self.attention = true;
        let (Some(stack), Some(start)) = (self.vector(bus, 0), self.vector(bus, 1)) else {
            // A core that cannot read its stack pointer and reset vector locks up at once (ARM ARM B1.5.15).
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

    /// Carries out a power-on: a [`Core::reset`] that also resets the debug components.
    pub fn power_on<B: Bus>(&mut self, bus: &mut B) {
        self.halted = false;
        self.system.power_on();
        self.r[..13].fill(0);
        self.other_sp = 0;
        self.s = [0; 32];
        (self.flags, self.flag_q) = (Flags::new(0), false);
        self.ge = 0;
        self.reset(bus);
    }
}
