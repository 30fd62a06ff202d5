//! The implementation of [`Part`].

use super::*;

impl Part for Stm32f429 {
    const NAME: &'static str = "STM32F429ZI";
    // The package with 144 pins has PA0 to PH1 (DS9405 table 10).
    const PINS: Pins = Pins {
        ports: &[("PA", 16), ("PB", 16), ("PC", 16), ("PD", 16), ("PE", 16), ("PF", 16), ("PG", 16), ("PH", 2)],
        digits: 1,
    };
    const INTERRUPTS: &'static [&'static str] = &vectors::NAMES;
    const RAM: &'static [(u32, usize)] = &[(CCM_BASE, 64 << 10), (SRAM_BASE, 192 << 10)];
    const RESETS_ON_LOCKUP: bool = false;

    fn core(&self) -> Config {
        Config {
            lines: INTERRUPTS,
            // PM0214 4.3 states four priority bits.
            priority_bits: 4,
            vector_table: 0,
            // The calibration value 18750 is 1 ms at HCLK/8 of 150 MHz (RM0090 12.1.2). SKEW says that this value is
            // not exact.
            systick_calibration: 0x4000_0000 | 18_750,
            systick_reference: 8,
            mpu_regions: 8,
        }
    }

    #[inline(always)]
    fn read<O: Outside>(&mut self, access: &Access, outside: &mut O) -> Result<u32, BusError> {
        if let Some(value) = self.sram.read(access.address.wrapping_sub(SRAM_BASE), access.width) {
            return Ok(value);
        }
        // Passing a copy keeps the compiler from storing the access in memory each time RAM is accessed.
        self.read_other(&{ *access }, outside)
    }

    #[inline(always)]
    fn write<O: Outside>(&mut self, access: &Access, value: u32, outside: &mut O) -> Result<(), BusError> {
        if self.sram.write(access.address.wrapping_sub(SRAM_BASE), access.width, value) {
            return Ok(());
        }
        self.write_other(&{ *access }, value, outside)
    }

    #[inline(always)]
    fn read_memory(&self, address: u32, width: Width) -> Option<u32> {
        if let Some(value) = self.sram.read_aligned(address.wrapping_sub(SRAM_BASE), width) {
            return Some(value);
        }
        // Flash that is being programmed or erased stalls the bus, so it cannot be read directly.
        if self.flash.is_quiet() {
            return self.flash.memory.read_aligned(address.wrapping_sub(flash::BASE), width);
        }
        None
    }

    #[inline(always)]
    fn write_memory(&mut self, address: u32, width: Width, value: u32) -> bool {
        self.sram.write_aligned(address.wrapping_sub(SRAM_BASE), width, value)
    }

    #[inline]
    fn fetch(&mut self, address: u32) -> Result<u16, BusError> {
        if let Some(offset) = self.flash_offset(address) {
            if !self.flash.is_readable() {
                return Ok(FlashControl::GARBAGE as u16);
            }
            return self.flash.read(offset, Width::Half).map(|value| value as u16).ok_or(BusError);
        }
        // The CCM is on the data bus only, so nothing can be executed from it (RM0090 2.3.1).
        match self.locate(address) {
            Some((Memory::Sram, offset)) => self.sram.read(offset as u32, Width::Half),
            Some((Memory::Factory, offset)) => self.factory.read(offset as u32, Width::Half),
            _ => None,
        }
        .map(|value| value as u16)
        .ok_or(BusError)
    }

    #[inline]
    fn is_constant(&self, address: u32) -> bool {
        self.flash_offset(address).is_some() && self.flash.is_certain()
    }

    fn watch_code(&mut self, address: u32) -> bool {
        matches!(self.locate(address), Some((Memory::Sram, offset)) if self.sram.watch(offset as u32))
    }

    fn is_watched(&self, address: u32) -> bool {
        matches!(self.locate(address), Some((Memory::Sram, offset)) if self.sram.is_watched(offset as u32))
    }

    #[inline(always)]
    fn rewritten(&self) -> u64 {
        self.sram.rewritten()
    }

    #[inline]
    fn due(&self) -> Cycle {
        self.next
    }

    fn advance<O: Outside>(&mut self, to: Cycle, outside: &mut O) {
        while self.next <= to {
            let at = self.next;
            self.now = self.now.max(at);
            let number = self.first_due(at);
            match number {
                0..id::INSTANCES => {
                    with!(self, number, p => p.advance(cx!(self, number, at, None), &mut Outward(outside)));
                    if number < id::USART && self.exchange(number, at) {
                        continue;
                    }
                    self.dirty |= 1 << number;
                }
                id::IWDG => {
                    self.iwdg.advance(at, self.clocks.lsi);
                    self.after_watchdogs();
                }
                id::WWDG => {
                    self.wwdg.advance(at);
                    self.after_watchdogs();
                }
                id::RCC => {
                    self.rcc.advance(at, self.pwr.supply(), &mut self.out);
                    self.after_rcc(at, None, outside);
                }
                id::FLASH => {
                    self.flash.advance(at);
                    self.set_due(id::FLASH, self.flash.due());
                    self.set_line(4, self.flash.irq());
                }
                _ => self.set_due(number, NEVER),
            }
            self.settle(at, outside);
        }
        self.now = self.now.max(to);
    }

    #[inline]
    fn signals(&mut self) -> &mut Signals {
        &mut self.signals
    }

    #[inline(always)]
    fn memory_waits(&mut self, address: u32, fetch: bool, _cycle: Cycle, bound: Bound) -> Option<u32> {
        if address.wrapping_sub(flash::BASE) < flash::SIZE {
            Some(self.flash.wait_states(address, fetch, bound))
        } else if address.wrapping_sub(SRAM_BASE) < SRAM_SIZE {
            Some(self.contention(bound))
        } else {
            None
        }
    }

    fn wait_states(&mut self, access: &Access, bound: Bound) -> u32 {
        let address = access.address;
        if self.flash_offset(address).is_some() {
            return self.flash.wait_states(address, access.purpose == Purpose::Fetch, bound);
        }
        let contention = self.contention(bound);
        match address {
            0x4000_0000..0x4002_0000 => {
                // Assumed: an access has the setup and access phases of the APB, and at worst waits for the bridge's
                // clock edge.
                let divider = if address < 0x4001_0000 { self.clocks.pclk1 } else { self.clocks.pclk2 };
                let phases = 2 * divider;
                match bound {
                    Bound::Best => phases - 1,
                    Bound::Worst => phases + divider - 1 + contention,
                }
            }
            SRAM_BASE..0x2003_0000 | 0x4002_0000..0x6000_0000 => contention,
            _ => 0,
        }
    }

    fn bit_banding(&self) -> bool {
        true
    }

    /// The core's clock is HCLK. If HCLK's source has failed without the clock security system, the rate is 0 and the
    /// core stands still. Cycles then count on at the last rate, for the independent watchdog.
    fn clock(&self) -> Clock {
        Clock { hz: if self.rcc.stopped { 0 } else { self.clocks.hclk_hz }, ppb: self.clocks.ppb }
    }

    fn reset<O: Outside>(&mut self, at: Cycle, cause: Reset, outside: &mut O) {
        self.now = self.now.max(at);
        let at = self.now;
        self.rcc.reset(cause);
        self.clocks = self.rcc.clocks;
        self.rcc.clocks_changed = false;
        self.pwr = Pwr::new();
        self.syscfg = Syscfg::default();
        self.dac = Dac::default();
        let option = |at: usize| {
            let at = (OPTION_BYTES - FACTORY_BASE) as usize + at;
            u32::from(u16::from_le_bytes([self.factory.bytes()[at], self.factory.bytes()[at + 1]]))
        };
        let options = (option(8) & 0x0FFF) << 16 | option(0) & 0xFFEC;
        self.flash.reset(options);
        self.exti.reset();
        self.gpio.reset();
        self.gpio.pads.dac = [None; 2];
        self.dma = [Dma::new(0), Dma::new(1)];
        self.iwdg = Iwdg::new();
        self.wwdg = Wwdg::new();
        for number in 0..id::INSTANCES {
            if number == id::RTC && cause != Reset::PowerOn {
                self.rtc.system_reset();
            } else {
                with!(self, number, p => p.reset());
            }
        }
        self.out.notes.clear();
        self.out.outputs.clear();
        self.out.triggers.clear();
        self.reset_wanted = None;
        self.signals = Signals::default();
        self.signals.forget_code();
        (self.own, self.shared) = ([0; 4], [0; 4]);
        self.dirty = 0;
        self.due = [NEVER; GROUPS * 8];
        self.group_due = [NEVER; GROUPS];
        self.next = NEVER;
        if self.flash.starts_watchdog() {
            self.iwdg.start(at, self.clocks.lsi);
            self.iwdg.started = false;
            self.rcc.force_lsi(at);
        }
        self.gpio.settle_all(at, &mut self.out);
        self.refresh_all();
        self.watch_supply();
        self.check_flash(at, None);
        self.settle(at, outside);
    }

    fn supply<O: Outside>(&mut self, at: Cycle, microvolts: u32, seed: u64, outside: &mut O) -> Supplied {
        self.now = self.now.max(at);
        let supplied = self.supply.supply(microvolts, self.flash.brown_out_level());
        self.flash.set_noise(seed);
        self.check_flash(self.now, None);
        self.watch_supply();
        self.settle(self.now, outside);
        supplied
    }

    fn take_supply_warning(&mut self) -> bool {
        std::mem::take(&mut self.supply.warned)
    }

    fn take_reset(&mut self) -> Option<Reset> {
        self.reset_wanted.take()
    }

    fn sleeps<O: Outside>(&mut self, at: Cycle, asleep: bool, deep: bool, outside: &mut O) {
        if asleep && deep {
            let text = "stop and standby mode are not modelled: the part sleeps with its clocks on";
            self.note(Note { kind: FindingKind::Unmodelled, at, pc: None, place: "PWR", text, value: None });
        }
        let _ = outside;
    }

    fn drive<O: Outside>(&mut self, at: Cycle, pin: Pin, level: Option<bool>, outside: &mut O) {
        self.now = self.now.max(at);
        self.gpio.drive(pin, level, self.now, &mut self.out);
        self.settle(self.now, outside);
    }

    fn pin(&self, pin: Pin) -> bool {
        self.gpio.level(pin)
    }

    fn receive<O: Outside>(&mut self, begins: Cycle, pin: Pin, frame: UartFrame, outside: &mut O) {
        let Some(Signal::Uart(n, wire @ (UartPin::Rx | UartPin::Tx))) = self.gpio.signal_of(pin) else { return };
        let number = id::usart(n);
        if !self.is_open(number) {
            return;
        }
        let now = self.now;
        let usart = &mut self.usart[usize::from(n - 1)];
        let cx = cx!(self, number, now, None);
        // In half-duplex mode (CR3.HDSEL) the TX pin also receives, and the RX pin is not used (RM0090 30.3.10).
        let half_duplex = usart.peek(0x14, cx) & 1 << 3 != 0;
        if half_duplex == (wire == UartPin::Tx) {
            usart.receive(begins, &frame, cx);
            self.dirty |= 1 << number;
            self.settle(now, outside);
        }
    }

    fn memory(&self, address: u32, size: usize) -> Option<&[u8]> {
        let (memory, at) = self.locate(address)?;
        let bytes = match memory {
            Memory::Flash => self.flash.memory.bytes(),
            Memory::Sram => self.sram.bytes(),
            Memory::Ccm => self.ccm.bytes(),
            Memory::Factory => self.factory.bytes(),
            Memory::Backup => self.backup.bytes(),
        };
        bytes.get(at..at.checked_add(size)?)
    }

    fn stick(&mut self, stuck: Option<StuckBit>) -> bool {
        let stuck = stuck.map(|stuck| StuckBit { address: stuck.address.wrapping_sub(SRAM_BASE), ..stuck });
        let there = stuck.is_none_or(|stuck| stuck.address < SRAM_SIZE);
        self.sram.stick(stuck.filter(|_| there));
        there
    }

    fn memory_mut(&mut self, address: u32, size: usize) -> Option<&mut [u8]> {
        let (memory, at) = self.locate(address)?;
        let end = at.checked_add(size)?;
        let bytes = match memory {
            Memory::Flash => {
                self.signals.forget_code();
                self.flash.memory.bytes_mut()
            }
            Memory::Sram => return self.sram.slice_mut(at as u32, size),
            Memory::Ccm => self.ccm.bytes_mut(),
            Memory::Factory => self.factory.bytes_mut(),
            Memory::Backup => self.backup.bytes_mut(),
        };
        bytes.get_mut(at..end)
    }

    fn findings(&self) -> &[Finding] {
        &self.findings
    }
}
