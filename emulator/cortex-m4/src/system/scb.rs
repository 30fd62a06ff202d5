//! The registers of the system control space, ARM ARM B3.2 to B3.4, and of the FP context, B3.2.21 to B3.2.24.
//!
//! Left out: ACTLR reads back without effect, and AFSR is zero, since there are no auxiliary faults. The core is
//! little-endian only.

use super::nvic::{self, Nvic};
use super::{Core, Cost};

pub(crate) const SCR_SLEEPONEXIT: u32 = 1 << 1;
pub(crate) const SCR_SLEEPDEEP: u32 = 1 << 2;
pub(crate) const SCR_SEVONPEND: u32 = 1 << 4;

pub(crate) const CCR_NONBASETHRDENA: u32 = 1;
pub(crate) const CCR_USERSETMPEND: u32 = 1 << 1;
pub(crate) const CCR_UNALIGN_TRP: u32 = 1 << 3;
pub(crate) const CCR_DIV_0_TRP: u32 = 1 << 4;
pub(crate) const CCR_BFHFNMIGN: u32 = 1 << 8;
pub(crate) const CCR_STKALIGN: u32 = 1 << 9;

pub(crate) const CFSR_IACCVIOL: u32 = 1;
pub(crate) const CFSR_DACCVIOL: u32 = 1 << 1;
pub(crate) const CFSR_MUNSTKERR: u32 = 1 << 3;
pub(crate) const CFSR_MSTKERR: u32 = 1 << 4;
pub(crate) const CFSR_MLSPERR: u32 = 1 << 5;
pub(crate) const CFSR_MMARVALID: u32 = 1 << 7;
pub(crate) const CFSR_IBUSERR: u32 = 1 << 8;
pub(crate) const CFSR_PRECISERR: u32 = 1 << 9;
pub(crate) const CFSR_UNSTKERR: u32 = 1 << 11;
pub(crate) const CFSR_STKERR: u32 = 1 << 12;
pub(crate) const CFSR_LSPERR: u32 = 1 << 13;
pub(crate) const CFSR_BFARVALID: u32 = 1 << 15;
pub(crate) const CFSR_UNDEFINSTR: u32 = 1 << 16;
pub(crate) const CFSR_INVSTATE: u32 = 1 << 17;
pub(crate) const CFSR_INVPC: u32 = 1 << 18;
pub(crate) const CFSR_NOCP: u32 = 1 << 19;
pub(crate) const CFSR_UNALIGNED: u32 = 1 << 24;
pub(crate) const CFSR_DIVBYZERO: u32 = 1 << 25;

pub(crate) const HFSR_VECTTBL: u32 = 1 << 1;
pub(crate) const HFSR_FORCED: u32 = 1 << 30;
pub(crate) const HFSR_DEBUGEVT: u32 = 1 << 31;

pub(crate) const DFSR_HALTED: u32 = 1;
pub(crate) const DFSR_BKPT: u32 = 1 << 1;
pub(crate) const DFSR_DWTTRAP: u32 = 1 << 2;
pub(crate) const DFSR_VCATCH: u32 = 1 << 3;

pub(crate) const FPCCR_LSPACT: u32 = 1;
pub(crate) const FPCCR_USER: u32 = 1 << 1;
pub(crate) const FPCCR_THREAD: u32 = 1 << 3;
pub(crate) const FPCCR_HFRDY: u32 = 1 << 4;
pub(crate) const FPCCR_MMRDY: u32 = 1 << 5;
pub(crate) const FPCCR_BFRDY: u32 = 1 << 6;
pub(crate) const FPCCR_MONRDY: u32 = 1 << 8;
pub(crate) const FPCCR_LSPEN: u32 = 1 << 30;
pub(crate) const FPCCR_ASPEN: u32 = 1 << 31;

/// The registers of the system control block that are plain storage or status.
#[derive(Clone, Debug)]
pub(crate) struct Scb {
    pub(crate) vtor: u32,
    pub(crate) scr: u32,
    pub(crate) ccr: u32,
    pub(crate) cfsr: u32,
    pub(crate) hfsr: u32,
    pub(crate) dfsr: u32,
    /// MMFAR and BFAR, which are one register in this core (TRM table 4-1).
    pub(crate) fault_address: u32,
    pub(crate) cpacr: u32,
    pub(crate) fpccr: u32,
    pub(crate) fpcar: u32,
    pub(crate) fpdscr: u32,
    pub(crate) actlr: u32,
    pub(crate) reset_request: bool,
}

impl Scb {
    pub(crate) fn new(vtor: u32) -> Self {
        Self {
            vtor: vtor & !0x7F,
            scr: 0,
            // The bit STKALIGN is set after a reset (TRM table 4-1).
            ccr: CCR_STKALIGN,
            cfsr: 0,
            hfsr: 0,
            dfsr: 0,
            fault_address: 0,
            cpacr: 0,
            fpccr: FPCCR_ASPEN | FPCCR_LSPEN,
            fpcar: 0,
            fpdscr: 0,
            actlr: 0,
            reset_request: false,
        }
    }
}

/// The identification registers from 0xE000_ED40 on (TRM table 4-1) and MVFR0, MVFR1 (TRM 7.3).
fn identification(offset: u32) -> Option<u32> {
    Some(match offset {
        0xD00 => 0x410F_C241,
        0xD40 => 0x0000_0030,
        0xD44 => 0x0000_0200,
        0xD48 => 0x0010_0000,
        0xD50 => 0x0010_0030,
        0xD58 => 0x0100_0000,
        0xD60 => 0x0114_1110,
        0xD64 => 0x0211_2000,
        0xD68 => 0x2123_2231,
        0xD6C => 0x0111_1131,
        0xD70 => 0x0131_0132,
        // The registers at these addresses are AFR0, MMFR1, MMFR3, and the cache registers of other cores.
        0xD4C | 0xD54 | 0xD5C | 0xD74..=0xD84 => 0,
        0xF40 => 0x1011_0021,
        0xF44 => 0x1100_0011,
        0xF48 => 0,
        _ => return None,
    })
}

/// The active and pending bits of SHCSR. Each row has the exception, its active bit and its pending bit (ARM ARM
/// B3.2.13).
const HANDLERS: [(u16, Option<u32>, Option<u32>); 7] = [
    (nvic::MEM_MANAGE, Some(0), Some(13)),
    (nvic::BUS_FAULT, Some(1), Some(14)),
    (nvic::USAGE_FAULT, Some(3), Some(12)),
    (nvic::SV_CALL, Some(7), Some(15)),
    (nvic::DEBUG_MONITOR, Some(8), None),
    (nvic::PEND_SV, Some(10), None),
    (nvic::SYS_TICK, Some(11), None),
];

impl<C: Cost> Core<C> {
    pub(super) fn scs_read(&mut self, offset: u32, debugger: bool) -> Option<u32> {
        let system = &mut self.system;
        let index = (offset & 0x7F) / 4;
        let scb = &system.scb;
        Some(match offset {
            0x004 => u32::from(system.config.lines.max(1) - 1) / 32,
            0x008 => scb.actlr,
            0x010..=0x01C => {
                self.advance_timers();
                return Some(self.system.systick.read(offset - 0x010, debugger));
            }
            0x100..=0x11C | 0x180..=0x19C => Nvic::register(&system.nvic.enabled, index),
            0x200..=0x21C | 0x280..=0x29C => Nvic::register(&system.nvic.pending, index),
            0x300..=0x31C => Nvic::register(&system.nvic.active, index),
            0x400..=0x4EC => {
                let first = (offset - 0x400) as u16 + 16;
                u32::from_le_bytes([0, 1, 2, 3].map(|byte| system.nvic.priority_byte(first + byte)))
            }
            0xD04 => self.icsr(),
            0xD08 => scb.vtor,
            0xD0C => 0xFA05_0000 | u32::from(system.nvic.prigroup()) << 8,
            0xD10 => scb.scr,
            0xD14 => scb.ccr,
            0xD18..=0xD20 => {
                let first = (offset - 0xD18) as u16 + 4;
                u32::from_le_bytes([0, 1, 2, 3].map(|byte| system.nvic.priority_byte(first + byte)))
            }
            0xD24 => self.shcsr(),
            0xD28 => scb.cfsr,
            0xD2C => scb.hfsr,
            0xD30 => scb.dfsr,
            0xD34 | 0xD38 => scb.fault_address,
            0xD3C => 0,
            0xD88 => scb.cpacr,
            0xD90..=0xDB8 => system.mpu.read(offset - 0xD90),
            0xDF0..=0xDFC => return self.debug_registers_read(offset, debugger),
            0xF00 => 0,
            0xF34 => scb.fpccr,
            0xF38 => scb.fpcar,
            0xF3C => scb.fpdscr,
            _ => return identification(offset),
        })
    }

    pub(super) fn scs_write(&mut self, offset: u32, value: u32, debugger: bool) -> bool {
        let index = (offset & 0x7F) / 4;
        match offset {
            0x010..=0x01C => {
                self.advance_timers();
                self.system.systick.write(offset - 0x010, value, self.cycle);
                self.system.settle();
                return true;
            }
            0xD04 => self.write_icsr(value),
            0xD0C => self.write_aircr(value, debugger),
            0xD24 => self.write_shcsr(value),
            0xDF0..=0xDFC => return self.debug_registers_write(offset, value, debugger),
            _ => {}
        }
        let system = &mut self.system;
        let scb = &mut system.scb;
        match offset {
            0x008 => scb.actlr = value & 0x307,
            0x100..=0x11C => system.nvic.write_enable(index, value, true),
            0x180..=0x19C => system.nvic.write_enable(index, value, false),
            0x200..=0x21C => system.nvic.write_pending(index, value, true),
            0x280..=0x29C => system.nvic.write_pending(index, value, false),
            0x400..=0x4EC => {
                for (number, byte) in ((offset - 0x400) as u16 + 16..).zip(value.to_le_bytes()) {
                    system.nvic.set_priority_byte(number, byte);
                }
                system.nvic.refresh();
            }
            0xD08 => scb.vtor = value & !0x7F,
            0xD10 => scb.scr = value & (SCR_SLEEPONEXIT | SCR_SLEEPDEEP | SCR_SEVONPEND),
            0xD14 => scb.ccr = value & 0x31B,
            0xD18..=0xD20 => {
                for (number, byte) in ((offset - 0xD18) as u16 + 4..).zip(value.to_le_bytes()) {
                    // The exceptions 7 to 10 and 13 do not exist.
                    if matches!(number, 4..=6 | 11 | 12 | 14 | 15) {
                        system.nvic.set_priority_byte(number, byte);
                    }
                }
                system.nvic.refresh();
            }
            0xD28 => scb.cfsr &= !value,
            0xD2C => scb.hfsr &= !value,
            0xD30 => scb.dfsr &= !value,
            0xD34 | 0xD38 => scb.fault_address = value,
            // CPACR holds the access to coprocessors 10 and 11, which are the FPU. The value 0b10 is reserved and
            // treated as no access.
            0xD88 => scb.cpacr = value & 0x00F0_0000,
            0xD90..=0xDB8 => system.mpu.write(offset - 0xD90, value),
            0xF00 => system.nvic.trigger(value & 0x1FF),
            0xF34 => scb.fpccr = value & 0xC000_017B,
            0xF38 => scb.fpcar = value & !7,
            0xF3C => scb.fpdscr = value & 0x07C0_0000,
            0x004 | 0x300..=0x31C | 0xD3C | 0xD04 | 0xD0C | 0xD24 => {}
            _ => return identification(offset).is_some(),
        }
        true
    }

    /// The value of ICSR, ARM ARM B3.2.4.
    fn icsr(&self) -> u32 {
        let nvic = &self.system.nvic;
        let pending = |number| u32::from(nvic::contains(&nvic.pending, number));
        // ICSR shows an exception that PRIMASK holds back, but not one that BASEPRI or FAULTMASK holds back.
        let vector = if nvic.best_priority < self.mask_priority(false) { u32::from(nvic.best) } else { 0 };
        pending(nvic::NMI) << 31
            | pending(nvic::PEND_SV) << 28
            | pending(nvic::SYS_TICK) << 26
            | u32::from(nvic.interrupt_pending()) << 22
            | vector << 12
            | u32::from(nvic.active_count() <= 1) << 11
            | u32::from(self.ipsr)
    }

    fn write_icsr(&mut self, value: u32) {
        let nvic = &mut self.system.nvic;
        if value & 1 << 31 != 0 {
            nvic.pend(nvic::NMI);
        }
        for (number, set) in [(nvic::PEND_SV, 28), (nvic::SYS_TICK, 26)] {
            match value >> (set - 1) & 3 {
                2 => nvic.pend(number),
                1 => nvic.unpend(number),
                _ => {}
            }
        }
    }

    /// Writes AIRCR, ARM ARM B3.2.6.
    fn write_aircr(&mut self, value: u32, debugger: bool) {
        if value >> 16 != 0x05FA {
            return;
        }
        self.system.nvic.set_prigroup((value >> 8 & 7) as u8);
        self.system.scb.reset_request |= value & 4 != 0;
        // VECTRESET and VECTCLRACTIVE work only while the core is halted for debug.
        if debugger && self.halted {
            self.system.scb.reset_request |= value & 1 != 0;
            if value & 2 != 0 {
                self.system.nvic.active = [0; 4];
                let active = std::mem::take(&mut self.ipsr);
                self.exception_changed_from(active);
                self.system.nvic.refresh();
            }
        }
        self.attention = true;
    }

    fn shcsr(&self) -> u32 {
        let nvic = &self.system.nvic;
        let mut value = 0;
        for (number, active, pending) in HANDLERS {
            value |= active.map_or(0, |bit| u32::from(nvic::contains(&nvic.active, number)) << bit);
            value |= pending.map_or(0, |bit| u32::from(nvic::contains(&nvic.pending, number)) << bit);
        }
        for (number, bit) in [(nvic::MEM_MANAGE, 16), (nvic::BUS_FAULT, 17), (nvic::USAGE_FAULT, 18)] {
            value |= u32::from(nvic::contains(&nvic.enabled, number)) << bit;
        }
        value
    }

    fn write_shcsr(&mut self, value: u32) {
        let nvic = &mut self.system.nvic;
        for (number, active, pending) in HANDLERS {
            if let Some(bit) = active {
                nvic.set_active(number, value >> bit & 1 != 0);
            }
            match pending.map(|bit| value >> bit & 1 != 0) {
                Some(true) => nvic.pend(number),
                Some(false) => nvic.unpend(number),
                None => {}
            }
        }
        for (number, bit) in [(nvic::MEM_MANAGE, 16), (nvic::BUS_FAULT, 17), (nvic::USAGE_FAULT, 18)] {
            nvic.set_enabled(number, value >> bit & 1 != 0);
        }
    }
}
