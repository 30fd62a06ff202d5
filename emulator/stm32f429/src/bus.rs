//! The bus finds the register or the memory at an address, for the core and for the DMA controllers.

use super::*;

impl Stm32f429 {
    /// Reads at `address` as any bus master can. Memory that only the core reaches is read elsewhere.
    pub(crate) fn bus_read(
        &mut self,
        address: u32,
        width: Width,
        now: Cycle,
        pc: Option<u32>,
        debug: bool,
    ) -> Result<u32, BusError> {
        let (number, offset) = id::at(address);
        if number == id::NOTHING {
            self.find(FindingKind::Unmapped, pc, "bus", "nothing is at", address);
            return Err(BusError);
        }
        if !self.is_open(number) {
            if !debug {
                self.find(
                    FindingKind::Refused,
                    pc,
                    name(number),
                    "read without its clock, or held in reset, at",
                    address,
                );
            }
            return Ok(0);
        }
        Ok(match number {
            0..id::INSTANCES if debug => {
                let register = with!(self, number, p => p.peek(offset & !3, cx!(self, number, now, None)));
                gpio::lane(register, offset, width)
            }
            0..id::INSTANCES => {
                self.dirty |= 1 << number;
                with!(self, number, p => p.read(offset, width, cx!(self, number, now, pc)))
            }
            id::GPIO..id::BKPSRAM => self.gpio.read(usize::from(number - id::GPIO), offset, width),
            id::DMA1 => self.dma[0].read(offset, width),
            id::DMA2 => self.dma[1].read(offset, width),
            id::EXTI => self.exti.read(offset, width),
            id::RCC => self.rcc.read(offset, width),
            id::FLASH => self.flash.read_register(offset, width),
            id::PWR => self.pwr.read(offset, width, self.supply.low),
            id::SYSCFG => self.syscfg.read(offset, width),
            id::DAC => self.dac.read(offset, width),
            id::IWDG => self.iwdg.read(offset, width),
            id::WWDG => self.wwdg.read(offset, width, now, &self.clocks),
            id::BKPSRAM => self.backup.read(offset, width).ok_or(BusError)?,
            _ => {
                if !debug {
                    self.find(FindingKind::Unmodelled, pc, name(number), "read, but not modelled: 0, at", address);
                }
                0
            }
        })
    }

    /// Whether the peripheral's clock is on and the peripheral is not held in reset.
    #[inline]
    pub(crate) fn is_open(&self, number: u8) -> bool {
        let gate = id::GATES[usize::from(number)];
        gate.bus == 255
            || self.rcc.is_on(gate)
            // The common registers are open if the clock of any ADC is on. The three ADCs share one reset bit.
            || number == id::ADC && [9, 10].iter().any(|&bit| self.rcc.is_on(rcc::Gate { bus: 4, bit }))
    }

    pub(crate) fn bus_write<O: Outside>(
        &mut self,
        address: u32,
        width: Width,
        value: u32,
        now: Cycle,
        pc: Option<u32>,
        outside: Option<&mut O>,
    ) -> Result<(), BusError> {
        let (number, offset) = id::at(address);
        if number == id::NOTHING {
            self.find(FindingKind::Unmapped, pc, "bus", "nothing is at", address);
            return Err(BusError);
        }
        if !self.is_open(number) {
            let text = "written without its clock, or held in reset, at";
            self.find(FindingKind::Refused, pc, name(number), text, address);
            return Ok(());
        }
        match number {
            id::RTC if !self.pwr.supply().backup_writable => {
                self.find(FindingKind::Refused, pc, "RTC", "written while PWR_CR.DBP protects it, at", address);
            }
            0..id::INSTANCES => {
                self.dirty |= 1 << number;
                with!(self, number, p => p.write(offset, width, value, cx!(self, number, now, pc)));
            }
            id::GPIO..id::BKPSRAM => {
                let port = usize::from(number - id::GPIO);
                self.gpio.write(port, offset, width, value, now, pc, &mut self.out);
            }
            id::DMA1 | id::DMA2 => self.write_dma(usize::from(number - id::DMA1), offset, width, value, now, pc),
            id::EXTI => {
                self.exti.write(offset, width, value);
                self.after_exti();
            }
            id::RCC => {
                self.rcc.write(offset, width, value, now, pc, self.pwr.supply(), &mut self.out);
                if offset & !3 == rcc::CFGR_OFFSET {
                    for number in [1, 2] {
                        if self.gpio.pads.input(Signal::Mco(number)).is_some() {
                            let text = "the pin of this clock output does not toggle: MCO";
                            self.find(FindingKind::Unmodelled, pc, "RCC", text, u32::from(number));
                        }
                    }
                }
                match outside {
                    Some(outside) => self.after_rcc(now, pc, outside),
                    None => self.after_rcc(now, pc, &mut emulator_part::Open),
                }
            }
            id::FLASH => {
                let hz = self.clocks.hclk_hz;
                let outcome = self.flash.write_register(offset, width, value, now, pc, hz, &mut self.out);
                self.check_flash(now, pc);
                if let Some(options) = self.flash.take_options() {
                    let at = (OPTION_BYTES - FACTORY_BASE) as usize;
                    let bytes = self.factory.bytes_mut();
                    bytes[at..at + 2].copy_from_slice(&(options as u16 & 0xFFEC).to_le_bytes());
                    bytes[at + 8..at + 10].copy_from_slice(&((options >> 16) as u16 & 0x0FFF).to_le_bytes());
                }
                return self.after_flash(outcome, now, pc);
            }
            id::PWR => {
                let pll = self.rcc.read(0, Width::Word) & 1 << 24 != 0;
                self.pwr.write(offset, width, value, pll);
                self.rcc.check_limits(now, pc, self.pwr.supply(), &mut self.out);
                self.watch_supply();
            }
            id::SYSCFG => {
                let mode = self.syscfg.memory_mode();
                if let Some(text) = self.syscfg.write(offset, width, value) {
                    self.note(Note { kind: FindingKind::Unmodelled, at: now, pc, place: "SYSCFG", text, value: None });
                }
                if self.syscfg.memory_mode() != mode {
                    self.signals.forget_code();
                }
                for port in 0..gpio::PORTS {
                    self.sample_port(port, 0xFFFF);
                }
            }
            id::DAC => {
                let out = &mut self.out;
                self.dac.write(offset, width, value, &mut |kind, text| {
                    out.notes.push(Note { kind, at: now, pc, place: "DAC", text, value: None });
                });
                self.gpio.pads.dac = self.dac.microvolts();
            }
            id::IWDG => self.write_iwdg(offset, value, now, pc),
            id::WWDG => {
                self.wwdg.write(offset, width, value, now, &self.clocks);
                self.after_watchdogs();
            }
            id::BKPSRAM => {
                if !self.pwr.supply().backup_writable {
                    self.find(FindingKind::Refused, pc, "BKPSRAM", "written while PWR_CR.DBP protects it, at", address);
                } else if !self.backup.write(offset, width, value) {
                    return Err(BusError);
                }
            }
            _ => self.find(FindingKind::Unmodelled, pc, name(number), "written, but not modelled, at", address),
        }
        Ok(())
    }

    pub(crate) fn write_iwdg(&mut self, offset: u32, value: u32, now: Cycle, pc: Option<u32>) {
        let lsi_runs = self.rcc.read(0x74, Width::Word) & 2 != 0;
        if let Some(text) = self.iwdg.write(offset, value, now, self.clocks.lsi, lsi_runs) {
            self.note(Note { kind: FindingKind::Misuse, at: now, pc, place: "IWDG", text, value: None });
        }
        if std::mem::take(&mut self.iwdg.started) {
            self.rcc.force_lsi(now);
            self.set_due(id::RCC, self.rcc.due());
        }
        self.after_watchdogs();
    }

    pub(crate) fn after_watchdogs(&mut self) {
        if std::mem::take(&mut self.iwdg.expired) {
            self.want_reset(Reset::Watchdog("IWDG"));
        }
        if std::mem::take(&mut self.wwdg.expired) {
            self.want_reset(Reset::Watchdog("WWDG"));
        }
        self.set_line(0, self.wwdg.irq());
        self.set_due(id::IWDG, self.iwdg.due());
        self.set_due(id::WWDG, self.wwdg.due());
    }

    pub(crate) fn want_reset(&mut self, cause: Reset) {
        if self.reset_wanted.is_none() {
            self.reset_wanted = Some(cause);
            self.signals.stop();
        }
    }

    pub(crate) fn after_flash(&mut self, outcome: Outcome, now: Cycle, pc: Option<u32>) -> Result<(), BusError> {
        self.set_due(id::FLASH, self.flash.due());
        self.set_line(4, self.flash.irq());
        match outcome {
            Outcome::Done => Ok(()),
            Outcome::BusError => Err(BusError),
            Outcome::Changed => {
                self.signals.forget_code();
                // A core that executes from the same bank of flash waits until the bank has finished.
                if let Some(pc) = pc
                    && let Some(offset) = self.flash_offset(pc)
                {
                    self.stall(self.flash.busy(offset, now));
                }
                Ok(())
            }
        }
    }

    pub(crate) fn stall(&mut self, until: Cycle) {
        self.signals.stall_until(self.signals.stalled_until().max(until));
    }

    /// Reads for the core from any address outside the RAM on the system bus.
    #[inline(never)]
    pub(crate) fn read_other<O: Outside>(&mut self, access: &Access, outside: &mut O) -> Result<u32, BusError> {
        let Access { address, width, purpose, .. } = *access;
        let debug = purpose == Purpose::Debugger;
        let by_port = purpose == Purpose::AccessPort;
        if let Some(offset) = self.flash_offset(address) {
            if debug {
                return self.flash.memory.read(offset, width).ok_or(BusError);
            }
            let busy = self.flash.busy(offset, access.cycle);
            if busy != 0 && !by_port {
                self.stall(busy);
            }
            if !self.flash.is_readable() {
                return Ok(FlashControl::GARBAGE);
            }
            return self.flash.read(offset, width).ok_or(BusError);
        }
        if let Some(value) = self.ccm.read(address.wrapping_sub(CCM_BASE), width) {
            if !self.rcc.is_on(CCM_GATE) && !debug {
                let pc = (!by_port).then_some(access.pc);
                self.find(FindingKind::Refused, pc, "CCM", "read without its clock at", address);
                return Ok(0);
            }
            return Ok(value);
        }
        if address < SRAM_BASE {
            return match self.locate(address) {
                Some((Memory::Sram, offset)) => self.sram.read(offset as u32, width).ok_or(BusError),
                Some((Memory::Factory, offset)) => self.factory.read(offset as u32, width).ok_or(BusError),
                // The option bytes of bank 2 (0x1FFE_C000) read as unprotected.
                _ if matches!(address, 0x1FFE_C000..0x1FFE_C010) => Ok(u32::MAX),
                _ => {
                    let pc = (!by_port).then_some(access.pc);
                    self.find(FindingKind::Unmapped, pc, "bus", "nothing is at", address);
                    Err(BusError)
                }
            };
        }
        let pc = (!by_port).then_some(access.pc);
        self.now = self.now.max(access.cycle);
        if address >= dbgmcu::BASE {
            return self.dbgmcu.read(address).ok_or(BusError);
        }
        let value = self.bus_read(address, width, self.now, pc, debug);
        if !debug {
            self.settle(self.now, outside);
        }
        value
    }

    /// Writes for the core to any address outside the RAM on the system bus.
    #[inline(never)]
    pub(crate) fn write_other<O: Outside>(
        &mut self,
        access: &Access,
        value: u32,
        outside: &mut O,
    ) -> Result<(), BusError> {
        let Access { address, width, purpose, .. } = *access;
        let pc = (purpose != Purpose::AccessPort).then_some(access.pc);
        self.now = self.now.max(access.cycle);
        if address.wrapping_sub(CCM_BASE) < CCM_SIZE {
            if !self.rcc.is_on(CCM_GATE) && purpose != Purpose::Debugger {
                self.find(FindingKind::Refused, pc, "CCM", "written without its clock at", address);
            } else {
                let _ = self.ccm.write(address - CCM_BASE, width, value);
            }
            return Ok(());
        }
        if let Some(offset) = self.flash_offset(address) {
            let busy = self.flash.busy(offset, access.cycle);
            if busy != 0 && purpose != Purpose::AccessPort {
                self.stall(busy);
            }
            let outcome = match self.flash.store(offset, width, value, self.now.max(busy), self.clocks.hclk_hz) {
                Ok(()) => Outcome::Changed,
                Err(text) => {
                    self.find(FindingKind::Misuse, pc, "FLASH", text, address);
                    Outcome::Done
                }
            };
            return self.after_flash(outcome, self.now.max(busy), pc);
        }
        if address < SRAM_BASE {
            return match self.locate(address) {
                Some((Memory::Sram, offset)) if self.sram.write(offset as u32, width, value) => Ok(()),
                Some((Memory::Factory, _)) => {
                    self.find(
                        FindingKind::Unmodelled,
                        pc,
                        "FLASH",
                        "a store to OTP or system memory does nothing",
                        address,
                    );
                    Ok(())
                }
                _ => {
                    self.find(FindingKind::Unmapped, pc, "bus", "nothing is at", address);
                    Err(BusError)
                }
            };
        }
        if address >= dbgmcu::BASE {
            return if self.dbgmcu.write(address, value) { Ok(()) } else { Err(BusError) };
        }
        let result = self.bus_write(address, width, value, self.now, pc, Some(outside));
        self.settle(self.now, outside);
        result
    }

    /// The cycles for which DMA delays an access to RAM or to a bridge. Assumed, since no manual has figures: at worst
    /// one cycle while a DMA controller is active.
    #[inline(always)]
    pub(crate) fn contention(&self, bound: Bound) -> u32 {
        u32::from(bound == Bound::Worst && self.dma.iter().any(Dma::is_active))
    }

    /// The offset in flash of an address in flash or in the alias of flash at 0.
    #[inline]
    pub(crate) fn flash_offset(&self, address: u32) -> Option<u32> {
        let offset = address.wrapping_sub(flash::BASE);
        if offset < flash::SIZE {
            Some(offset)
        } else if address < flash::SIZE && self.syscfg.memory_mode() == 0 {
            Some(address)
        } else {
            None
        }
    }
}
