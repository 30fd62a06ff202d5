//! The core's own address space, 0xE000_0000 to 0xE00F_FFFF (the private peripheral bus).
//!
//! | Covered | ARM ARM | Module |
//! |---|---|---|
//! | interrupts, priorities | B1.5, B3.4 | `nvic` |
//! | system control block, FP context registers | B3.2 | `scb` |
//! | SysTick | B3.3 | `systick` |
//! | MPU, default memory map | B3.5, B3.1 | `mpu` |
//! | watchpoints, cycle counter | C1.8 | `dwt` |
//! | breakpoints | C1.11 | `fpb` |
//! | debug control | C1.6 | `debug` |
//! | ITM, TPIU, ETM, ROM table: identification only | C1.7, C1.10, D2 | `coresight` |
//!
//! An access to an address without a register, or narrower than its register allows, reads zero or writes nothing.
//! [`Core::take_unmodelled`] lists such accesses.

mod coresight;
mod debug;
mod dwt;
mod fpb;
pub(crate) mod mpu;
pub(crate) mod nvic;
mod scb;
mod systick;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;

use crate::{Access, Bus, BusError, Config, Core, Cost, Fault, Purpose, Width};

pub(crate) use scb::*;

/// The vector catch bits of DEMCR.
pub(crate) mod debug_catch {
    pub(crate) use super::debug::{
        VC_BUSERR as BUSERR, VC_CHKERR as CHKERR, VC_CORERESET as CORERESET, VC_HARDERR as HARDERR,
        VC_INTERR as INTERR, VC_MMERR as MMERR, VC_NOCPERR as NOCPERR, VC_STATERR as STATERR,
    };
}

#[derive(Clone, Debug)]
pub(crate) struct System {
    pub(crate) nvic: nvic::Nvic,
    pub(crate) scb: Scb,
    pub(crate) debug: debug::Debug,
    pub(crate) systick: systick::SysTick,
    pub(crate) dwt: dwt::Dwt,
    pub(crate) mpu: mpu::Mpu,
    fpb: fpb::Fpb,
    coresight: coresight::CoreSight,
    due: u64,
    pub(crate) breakpoints_changed: bool,
    unmodelled: Vec<(u32, u32, u64)>,
    known: BTreeSet<u32>,
    config: Config,
}

/// The addresses of the external private peripheral bus that the part may use (ARM ARM B3.1), between the ETM and the
/// ROM table.
const EXTERNAL: std::ops::Range<u32> = 0xE004_2000..0xE00F_F000;

impl System {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            nvic: nvic::Nvic::new(config.lines, config.priority_bits),
            scb: Scb::new(config.vector_table),
            debug: debug::Debug::default(),
            systick: systick::SysTick::new(config.systick_calibration, config.systick_reference),
            dwt: dwt::Dwt::new(),
            mpu: mpu::Mpu::new(config.mpu_regions),
            fpb: fpb::Fpb::default(),
            coresight: coresight::CoreSight::new(),
            due: u64::MAX,
            breakpoints_changed: false,
            unmodelled: Vec::new(),
            known: BTreeSet::new(),
            config: *config,
        }
    }

    /// Carries out a system reset of everything but the debug components (ARM ARM C1.6.5, C1.8, C1.11).
    pub(crate) fn reset(&mut self) {
        let config = self.config;
        self.nvic = nvic::Nvic::new(config.lines, config.priority_bits);
        self.scb = Scb { dfsr: self.scb.dfsr, ..Scb::new(config.vector_table) };
        self.systick = systick::SysTick::new(config.systick_calibration, config.systick_reference);
        self.mpu = mpu::Mpu::new(config.mpu_regions);
        self.debug.reset();
        self.settle();
    }

    pub(crate) fn power_on(&mut self) {
        let unmodelled = std::mem::take(&mut self.unmodelled);
        let known = std::mem::take(&mut self.known);
        let watched = self.dwt.caller_watches();
        *self = Self { unmodelled, known, breakpoints_changed: true, ..Self::new(&self.config) };
        self.set_watching(watched);
    }

    pub(crate) fn set_watching(&mut self, on: bool) {
        self.dwt.set_caller_watches(on);
    }

    fn settle(&mut self) {
        self.due = self.systick.due().min(self.dwt.due());
    }

    fn note(&mut self, access: &Access) {
        let address = access.address & !3;
        if access.purpose != Purpose::Debugger && self.known.insert(address) {
            self.unmodelled.push((address, access.pc, access.cycle));
        }
    }
}

impl<C: Cost> Core<C> {
    /// Takes the list of accesses in the core's own address space that are not modelled: address, instruction, cycle.
    /// Each address is reported once.
    pub fn take_unmodelled(&mut self) -> Vec<(u32, u32, u64)> {
        std::mem::take(&mut self.system.unmodelled)
    }

    /// SCR.SLEEPDEEP: whether `WFI` and `WFE` ask the part for deep sleep.
    #[must_use]
    pub fn sleep_deep(&self) -> bool {
        self.system.scb.scr & SCR_SLEEPDEEP != 0
    }

    pub(crate) fn take_reset_request(&mut self) -> bool {
        std::mem::take(&mut self.system.scb.reset_request)
    }

    /// Reads a word as a debugger does, without the side effects of a real access.
    ///
    /// # Errors
    ///
    /// Returns [`Fault::BusData`] where nothing answers.
    pub fn debug_read<B: Bus>(&mut self, bus: &mut B, address: u32) -> Result<u32, Fault> {
        let access = self.debugger_access(address);
        if address >> 20 == 0xE00 {
            self.system_read(bus, &access)
        } else {
            bus.read(&access).map_err(|_| Fault::BusData(address))
        }
    }

    /// Writes a word as a debugger does. Only such a write can change DHCSR.C_DEBUGEN (ARM ARM C1.6.2).
    ///
    /// # Errors
    ///
    /// Returns [`Fault::BusData`] where nothing answers.
    pub fn debug_write<B: Bus>(&mut self, bus: &mut B, address: u32, value: u32) -> Result<(), Fault> {
        let access = self.debugger_access(address);
        if address >> 20 == 0xE00 {
            self.system_write(bus, &access, value)
        } else {
            bus.write(&access, value).map_err(|_| Fault::BusData(address))
        }
    }

    /// Reads as the AHB-AP of the debug port does, at the cycle `cycle`. `address` must be aligned to `width`. The
    /// access has the side effects of a load, but bypasses the MPU. In the core's own space it has a debugger's rights.
    ///
    /// # Errors
    ///
    /// Returns [`Fault::BusData`] where nothing answers.
    pub fn access_port_read<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        cycle: u64,
    ) -> Result<u32, Fault> {
        if address >> 20 == 0xE00 {
            let access = Access { address, width, ..self.debugger_access(address) };
            return self.system_read(bus, &access);
        }
        let access = self.port_access(address, width, cycle);
        bus.read(&access).map_err(|BusError| Fault::BusData(address))
    }

    /// Writes as the AHB-AP of the debug port does, see [`Core::access_port_read`].
    ///
    /// # Errors
    ///
    /// Returns [`Fault::BusData`] where nothing answers, or where the address refuses the write.
    pub fn access_port_write<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        value: u32,
        cycle: u64,
    ) -> Result<(), Fault> {
        if address >> 20 == 0xE00 {
            let access = Access { address, width, ..self.debugger_access(address) };
            return self.system_write(bus, &access, value);
        }
        let access = self.port_access(address, width, cycle);
        bus.write(&access, value).map_err(|BusError| Fault::BusData(address))
    }

    fn port_access(&self, address: u32, width: Width, cycle: u64) -> Access {
        Access { address, width, purpose: Purpose::AccessPort, privileged: true, cycle, pc: self.r[15] }
    }

    fn debugger_access(&self, address: u32) -> Access {
        Access {
            address: address & !3,
            width: Width::Word,
            purpose: Purpose::Debugger,
            privileged: true,
            cycle: self.cycle,
            pc: self.r[15],
        }
    }

    pub(crate) fn system_read<B: Bus>(&mut self, bus: &mut B, access: &Access) -> Result<u32, Fault> {
        let address = access.address & !3;
        let debugger = access.purpose == Purpose::Debugger;
        // Unprivileged code can read only the ITM in this space (ARM ARM B3.1.1, C1.7.1).
        if !access.privileged && !debugger && address >> 12 != 0xE_0000 {
            return Err(Fault::BusData(access.address));
        }
        if EXTERNAL.contains(&address) {
            return bus.read(access).map_err(|BusError| Fault::BusData(access.address));
        }
        if address >> 12 == 0xE_000E {
            self.take_signals(bus);
        }
        let word = match address >> 12 {
            0xE_0001 => {
                self.system_advance();
                let pc = if self.halted { self.r[15] } else { access.pc };
                self.system.dwt.read(address & 0xFFF, access.cycle, pc, debugger)
            }
            0xE_0002 => self.system.fpb.read(address & 0xFFF),
            0xE_000E => self.scs_read(address & 0xFFF, debugger),
            _ => None,
        };
        let Some(word) = word.or_else(|| self.system.coresight.read(address)) else {
            self.system.note(access);
            return Ok(0);
        };
        if access.width != Width::Word && !narrow_allowed(address) {
            self.system.note(access);
        }
        let word = word >> (8 * (access.address & 3));
        Ok(match access.width {
            Width::Byte => word & 0xFF,
            Width::Half => word & 0xFFFF,
            Width::Word => word,
        })
    }

    pub(crate) fn system_write<B: Bus>(&mut self, bus: &mut B, access: &Access, value: u32) -> Result<(), Fault> {
        let address = access.address & !3;
        let debugger = access.purpose == Purpose::Debugger;
        if !access.privileged && !debugger {
            let stimulus = address >> 12 == 0xE_0000
                && address & 0xFFF < 0x80
                && self.system.coresight.itm_privilege >> (address >> 5 & 3) & 1 == 0;
            let trigger = address == 0xE000_EF00 && self.system.scb.ccr & CCR_USERSETMPEND != 0;
            // Unprivileged code can write only the ITM's stimulus ports, and only those that are open to it (ARM ARM
            // C1.7.1).
            if address >> 12 == 0xE_0000 && !stimulus {
                return Ok(());
            }
            if !stimulus && !trigger {
                return Err(Fault::BusData(access.address));
            }
        }
        if EXTERNAL.contains(&address) {
            return bus.write(access, value).map_err(|BusError| Fault::BusData(access.address));
        }
        let mut value = value;
        if access.width != Width::Word {
            if !narrow_allowed(address) {
                self.system.note(access);
                return Ok(());
            }
            let shift = 8 * (access.address & 3);
            let mask = if access.width == Width::Byte { 0xFF } else { 0xFFFF };
            value = (value & mask) << shift;
            // A narrow write of a priority must keep the bytes beside it. In CFSR ones clear bits, so a narrow write
            // must not copy the other bits.
            if address != 0xE000_ED28 && address >> 12 == 0xE_000E {
                value |= self.scs_read(address & 0xFFF, true).unwrap_or(0) & !(mask << shift);
            }
        }
        if address >> 12 == 0xE_000E {
            self.take_signals(bus);
        }
        self.system_advance();
        let known = match address >> 12 {
            0xE_0001 => {
                let known = self.system.dwt.write(address & 0xFFF, value, access.cycle);
                self.system.settle();
                self.system.breakpoints_changed |= (0x20..0x60).contains(&(address & 0xFFF));
                known
            }
            0xE_0002 => {
                let known = self.system.fpb.write(address & 0xFFF, value);
                self.system.breakpoints_changed = true;
                known && !self.system.fpb.remaps()
            }
            0xE_000E => self.scs_write(address & 0xFFF, value, debugger),
            _ => false,
        };
        if !known && !self.system.coresight.write(address, value) {
            self.system.note(access);
        }
        let nvic = &self.system.nvic;
        self.attention |= nvic.best != 0 || nvic.newly_pending;
        Ok(())
    }

    #[inline]
    pub(crate) fn traps_unaligned(&self) -> bool {
        self.system.scb.ccr & CCR_UNALIGN_TRP != 0
    }

    #[inline]
    pub(crate) fn traps_zero_division(&self) -> bool {
        self.system.scb.ccr & CCR_DIV_0_TRP != 0
    }

    #[cfg(test)]
    pub(crate) fn debug_stepping(&self) -> bool {
        self.system.debug.stepping.is_some()
    }

    #[inline]
    pub(crate) fn mpu_data(&mut self, address: u32, write: bool, privileged: bool) -> bool {
        if self.mpu_opens(address, 1, write, privileged) {
            return true;
        }
        let priority = self.execution_priority();
        self.system.mpu.data(address, write, privileged, priority)
    }

    /// Returns whether accesses to these bytes need no check, because the MPU is off or opens all of them.
    #[inline(always)]
    pub(crate) fn mpu_opens(&mut self, address: u32, bytes: u32, write: bool, privileged: bool) -> bool {
        self.system.mpu.opens(address, bytes, write, privileged)
    }

    /// Whether code may execute the whole page of `1 << bits` bytes that has `address`, by the MPU and the default
    /// memory map.
    #[inline(always)]
    pub(crate) fn mpu_opens_page(&mut self, address: u32, bits: u32) -> bool {
        let privileged = self.is_privileged();
        self.system.mpu.opens_page(address, bits, privileged)
    }

    #[inline]
    pub(crate) fn mpu_fetch(&mut self, address: u32) -> bool {
        let (privileged, priority) = (self.is_privileged(), self.execution_priority());
        self.system.mpu.fetch(address, privileged, priority)
    }

    /// The next cycle at which SysTick reaches zero or the DWT matches, `u64::MAX` for never.
    #[inline]
    pub(crate) fn system_due(&self) -> u64 {
        self.system.due
    }

    #[inline]
    pub(crate) fn system_advance(&mut self) {
        if self.system.due <= self.cycle {
            self.advance_timers();
        }
    }

    fn advance_timers(&mut self) {
        if self.system.systick.advance(self.cycle) {
            self.system.nvic.pend(nvic::SYS_TICK);
            self.attention = true;
        }
        if self.system.dwt.advance(self.cycle) {
            self.debug_event(DFSR_DWTTRAP);
        }
        self.system.settle();
    }

    /// Compares a data access with the DWT's comparators and the caller's watchpoints.
    pub(crate) fn watch(&mut self, address: u32, write: bool, width: Width, value: u32) {
        if self.system.dwt.watches() {
            if self.system.dwt.watch(address, write, width.bytes(), value) {
                self.debug_event(DFSR_DWTTRAP);
            }
            self.end_burst();
        }
        self.watch_for_caller(address, write, width);
    }

    #[inline]
    pub(crate) fn watching(&self) -> bool {
        self.system.dwt.watching
    }

    /// Returns the addresses at which the FPB or the DWT has a breakpoint. The run loop must call
    /// [`Self::hardware_breakpoint`] before it executes the instruction there.
    pub(crate) fn fpb_breakpoints(&self) -> impl Iterator<Item = u32> {
        let matches = self.system.dwt.pc_matches();
        self.system
            .fpb
            .breakpoints()
            .chain(matches.flat_map(|(first, mask)| (first..=first + ((1 << mask) - 1)).step_by(2)))
    }

    #[inline]
    pub(crate) fn take_breakpoints_changed(&mut self) -> bool {
        std::mem::take(&mut self.system.breakpoints_changed)
    }

    /// Handles a breakpoint of the FPB or the DWT at the next instruction. Returns whether the instruction must not be
    /// executed now.
    pub(crate) fn hardware_breakpoint<B: Bus>(&mut self, bus: &mut B) -> bool {
        let pc = self.r[15];
        if self.system.fpb.breakpoints().any(|address| address == pc) {
            self.breakpoint(bus);
            return true;
        }
        if self.system.dwt.pc_matched(pc) {
            self.debug_event(DFSR_DWTTRAP);
            return self.look_at_exceptions(bus) || self.halted;
        }
        false
    }
}

/// Whether the register at `address` allows accesses by bytes and halfwords. The ITM stimulus ports, IPR, SHPR and CFSR
/// do (ARM ARM B3.2.1, B3.4.2); STIR does not.
fn narrow_allowed(address: u32) -> bool {
    matches!(address, 0xE000_0000..=0xE000_007F | 0xE000_E400..=0xE000_E4EF | 0xE000_ED18..=0xE000_ED2B)
        && address != 0xE000_ED24
}
