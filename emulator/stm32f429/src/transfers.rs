//! DMA transfers: the choice of the stream, and the movement of data.

use super::*;

impl Stm32f429 {
    pub(crate) fn write_dma(&mut self, nth: usize, offset: u32, width: Width, value: u32, now: Cycle, pc: Option<u32>) {
        let out = &mut self.out;
        let place = id::NAMES[usize::from(id::DMA1) + nth];
        let turn = self.dma[nth].write(offset, width, value, &mut |kind, text| {
            out.notes.push(Note { kind, at: now, pc, place, text, value: None });
        });
        match turn {
            Turn::Nothing => {}
            Turn::On(stream) => {
                match self.dma[nth].streams[stream].direction() {
                    Direction::FromPeripheral => {}
                    Direction::ToPeripheral => self.fill(nth, stream, now),
                    Direction::MemoryToMemory => self.move_memory(nth, stream, now),
                }
                self.listen();
            }
            Turn::Off(stream) => {
                if self.dma[nth].streams[stream].direction() == Direction::FromPeripheral {
                    self.flush(nth, stream, now);
                }
                self.dma[nth].switched_off(stream);
                self.listen();
            }
        }
        self.after_dma(nth);
    }

    /// Serves the next DMA request: by software priority, then by stream number, and DMA1 before DMA2. Returns the
    /// controller whose request was served.
    pub(crate) fn transfer(&mut self, now: Cycle) -> Option<usize> {
        let mut pauses = false;
        for nth in 0..2 {
            if now < self.dma_pauses_until[nth] {
                pauses = true;
                continue;
            }
            let mut best: Option<(u32, usize)> = None;
            let mut listening = self.listening[nth];
            while listening != 0 {
                let number = listening.trailing_zeros() as usize;
                listening &= listening - 1;
                let stream = &self.dma[nth].streams[number];
                let (instance, mask) = stream.source;
                if self.requests[usize::from(instance)] & mask != 0
                    && best.is_none_or(|(priority, _)| stream.priority() > priority)
                {
                    best = Some((stream.priority(), number));
                }
            }
            if let Some((_, number)) = best {
                self.serve(nth, number, now);
                return Some(nth);
            }
        }
        if !pauses {
            // No stream serves a request that is still active.
            self.hungry = 0;
        }
        None
    }

    pub(crate) fn serve(&mut self, nth: usize, number: usize, now: Cycle) {
        let stream = &self.dma[nth].streams[number];
        let (instance, mask) = stream.source;
        let request = (self.requests[usize::from(instance)] & mask).trailing_zeros() as u8;
        let (address, width, direction) = (stream.peripheral, stream.peripheral_width(), stream.direction());
        let master = Master::DmaPeripheral(nth as u8);
        let flags = stream.flags;
        let done = if direction == Direction::FromPeripheral {
            self.dma_read(master, address, width, now).map(|value| self.dma[nth].streams[number].push(value, width))
        } else {
            let value = self.dma[nth].streams[number].pop(width);
            self.dma_write(master, address, width, value, now)
        };
        if done.is_err() {
            self.dma[nth].streams[number].fail();
            self.after_dma(nth);
            self.listen();
            return;
        }
        let stream = &mut self.dma[nth].streams[number];
        stream.step_peripheral();
        let last = stream.count();
        let left = stream.left();
        with!(self, instance, p => p.dma_served(request, left, cx!(self, instance, now, None)));
        self.dirty |= 1 << instance;
        if direction == Direction::FromPeripheral {
            while self.dma[nth].streams[number].drains() {
                if !self.drain_one(nth, number, now) {
                    return;
                }
            }
            if last {
                self.flush(nth, number, now);
            }
        } else if !last {
            self.fill(nth, number, now);
        }
        let stream = &mut self.dma[nth].streams[number];
        if last && stream.is_on() {
            stream.end_of_lap();
            if stream.is_on() {
                if direction == Direction::ToPeripheral {
                    self.fill(nth, number, now);
                }
            } else {
                self.listen();
            }
        }
        if self.dma[nth].streams[number].flags != flags {
            self.after_dma(nth);
        }
    }

    /// Moves one item from the FIFO to memory. Returns whether the stream is still on.
    pub(crate) fn drain_one(&mut self, nth: usize, number: usize, now: Cycle) -> bool {
        let stream = &mut self.dma[nth].streams[number];
        let (address, width) = (stream.memory, stream.memory_width());
        let value = stream.pop(width);
        if self.dma_write(Master::DmaMemory(nth as u8), address, width, value, now).is_err() {
            self.dma[nth].streams[number].fail();
            self.after_dma(nth);
            self.listen();
            return false;
        }
        self.dma[nth].streams[number].step_memory();
        true
    }

    /// Moves the rest of the FIFO to memory, by bytes if necessary (RM0090 10.3.13).
    pub(crate) fn flush(&mut self, nth: usize, number: usize, now: Cycle) {
        while u32::from(self.dma[nth].streams[number].filled) >= self.dma[nth].streams[number].memory_width().bytes() {
            if !self.drain_one(nth, number, now) {
                return;
            }
        }
        while self.dma[nth].streams[number].filled > 0 {
            let stream = &mut self.dma[nth].streams[number];
            let (address, value) = (stream.memory, stream.pop(Width::Byte));
            stream.memory = stream.memory.wrapping_add(1);
            if self.dma_write(Master::DmaMemory(nth as u8), address, Width::Byte, value, now).is_err() {
                self.dma[nth].streams[number].fail();
                self.after_dma(nth);
                self.listen();
                return;
            }
        }
    }

    pub(crate) fn fill(&mut self, nth: usize, number: usize, now: Cycle) {
        while self.dma[nth].streams[number].is_on() && self.dma[nth].streams[number].fills() {
            let stream = &self.dma[nth].streams[number];
            let (address, width) = (stream.memory, stream.memory_width());
            match self.dma_read(Master::DmaMemory(nth as u8), address, width, now) {
                Ok(value) => {
                    let stream = &mut self.dma[nth].streams[number];
                    stream.push(value, width);
                    stream.filled_from_memory();
                    stream.step_memory();
                }
                Err(BusError) => {
                    self.dma[nth].streams[number].fail();
                    self.after_dma(nth);
                    self.listen();
                }
            }
        }
    }

    pub(crate) fn move_memory(&mut self, nth: usize, number: usize, now: Cycle) {
        while self.dma[nth].streams[number].is_on() {
            let stream = &self.dma[nth].streams[number];
            let (address, width) = (stream.peripheral, stream.peripheral_width());
            match self.dma_read(Master::DmaPeripheral(nth as u8), address, width, now) {
                Ok(value) => {
                    let stream = &mut self.dma[nth].streams[number];
                    stream.push(value, width);
                    stream.step_peripheral();
                    let last = stream.count();
                    while self.dma[nth].streams[number].drains() {
                        if !self.drain_one(nth, number, now) {
                            return;
                        }
                    }
                    if last {
                        self.flush(nth, number, now);
                        self.dma[nth].streams[number].end_of_lap();
                    }
                }
                Err(BusError) => self.dma[nth].streams[number].fail(),
            }
        }
    }

    /// Whether a DMA controller's port reaches `address` (RM0090 figure 2 and 2.1). DMA1's peripheral port reaches APB1
    /// only, and its memory port flash and SRAM. DMA2's ports reach these and all peripherals. No port reaches the CCM.
    pub(crate) fn reaches(master: Master, address: u32) -> bool {
        let memory = matches!(address, 0..0x0820_0000 | SRAM_BASE..0x2003_0000);
        let peripheral = matches!(address, 0x4000_0000..0x6000_0000);
        match master {
            Master::DmaPeripheral(0) => matches!(address, 0x4000_0000..0x4001_0000),
            Master::DmaMemory(0) => memory,
            Master::DmaPeripheral(_) | Master::DmaMemory(_) => memory || peripheral,
        }
    }

    pub(crate) fn refuse_dma(&mut self, master: Master, address: u32) -> BusError {
        let (Master::DmaPeripheral(nth) | Master::DmaMemory(nth)) = master;
        let text = match master {
            Master::DmaMemory(_) => "its memory port does not reach",
            _ => "its peripheral port does not reach",
        };
        self.find(FindingKind::Unreachable, None, id::NAMES[usize::from(id::DMA1 + nth)], text, address);
        BusError
    }

    pub(crate) fn dma_read(&mut self, master: Master, address: u32, width: Width, now: Cycle) -> Result<u32, BusError> {
        let address = address & !(width.bytes() - 1);
        if !Self::reaches(master, address) {
            return Err(self.refuse_dma(master, address));
        }
        if let Some(value) = self.sram.read(address.wrapping_sub(SRAM_BASE), width) {
            return Ok(value);
        }
        if let Some(offset) = self.flash_offset(address) {
            return self.flash.memory.read(offset, width).ok_or(BusError);
        }
        self.bus_read(address, width, now, None, false)
    }

    pub(crate) fn dma_write(
        &mut self,
        master: Master,
        address: u32,
        width: Width,
        value: u32,
        now: Cycle,
    ) -> Result<(), BusError> {
        let address = address & !(width.bytes() - 1);
        if !Self::reaches(master, address) || address < SRAM_BASE {
            return Err(self.refuse_dma(master, address));
        }
        if self.sram.write(address.wrapping_sub(SRAM_BASE), width, value) {
            return Ok(());
        }
        self.bus_write(address, width, value, now, None, None::<&mut emulator_part::Open>)
    }

    pub(crate) fn locate(&self, address: u32) -> Option<(Memory, usize)> {
        if let Some(offset) = self.flash_offset(address) {
            return Some((Memory::Flash, offset as usize));
        }
        let (memory, offset) = match address {
            SRAM_BASE..0x2003_0000 => (Memory::Sram, address - SRAM_BASE),
            CCM_BASE..0x1001_0000 => (Memory::Ccm, address - CCM_BASE),
            FACTORY_BASE..0x2000_0000 => (Memory::Factory, address - FACTORY_BASE),
            BACKUP_BASE..0x4002_5000 => (Memory::Backup, address - BACKUP_BASE),
            ..SRAM1_SIZE if self.syscfg.memory_mode() == 3 => (Memory::Sram, address),
            ..0x7800 if self.syscfg.memory_mode() == 1 => (Memory::Factory, address),
            _ => return None,
        };
        Some((memory, offset as usize))
    }
}
