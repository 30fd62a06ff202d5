//! The core's reads and writes of memory, registers, tasks and events (PS 4.2, 6.1), and their cost.

use super::*;

const SPIM3: u32 = 0x2F;

const NOT_MODELLED: &str = "is not modelled, first used at offset";

impl Soc {
    #[inline(never)]
    pub(crate) fn read<O: Outside>(&mut self, access: &Access, outside: &mut O) -> Result<u32, BusError> {
        if let Some(place) = place(access.address) {
            let read = match place {
                Place::Flash(offset) => self.memory.flash.read(offset, access.width),
                Place::Ram(offset) => self.memory.ram.read(offset, access.width),
                Place::Ficr(offset) => self.memory.ficr.read(offset, access.width),
                Place::Uicr(offset) => self.memory.uicr.read(offset, access.width),
            };
            return read.ok_or(BusError);
        }
        self.take_up(access, outside);
        let word = access.address & !3;
        let value = self.read_word(word, access, outside).ok_or(BusError)?;
        Ok(match access.width {
            Width::Word => value,
            Width::Half => value >> (8 * (access.address & 2)) & 0xFFFF,
            Width::Byte => value >> (8 * (access.address & 3)) & 0xFF,
        })
    }

    #[inline(never)]
    pub(crate) fn write<O: Outside>(&mut self, access: &Access, value: u32, outside: &mut O) -> Result<(), BusError> {
        let address = access.address;
        if let Some(place) = place(address) {
            return match place {
                Place::Ram(offset) => self.memory.ram.write(offset, access.width, value).then_some(()).ok_or(BusError),
                Place::Ficr(offset) => {
                    self.take_up(access, outside);
                    self.find(FindingKind::Misuse, "FICR", "a write to read-only memory, at offset", offset);
                    Ok(())
                }
                Place::Flash(_) | Place::Uicr(_) => {
                    self.take_up(access, outside);
                    let word = access.width == Width::Word;
                    let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                    *touched |= 1 << NVMC;
                    let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id: NVMC, name: "NVMC" };
                    let stored = parts.nvmc.store(address, word, value, &mut cx);
                    self.carry(outside);
                    stored.then_some(()).ok_or(BusError)
                }
            };
        }
        self.take_up(access, outside);
        let Some((id, n, block)) = block_at(address) else {
            if let Some((name, offset)) = unmodelled_at(address) {
                self.find(FindingKind::Unmodelled, name, NOT_MODELLED, offset);
                return Ok(());
            }
            self.find(FindingKind::Unmapped, "bus", "a write where the part has nothing, at", address);
            return Err(BusError);
        };
        let offset = address & 0xFFC;
        let (word, bit) = (offset as usize / 256, 1 << (offset / 4 % 64));
        let [present, writable] = &REGISTERS[n];
        if present[word] & bit == 0 {
            self.find(FindingKind::Undefined, block.name, "a write where no register is, at offset", offset);
        } else if !block.modelled {
            self.find(FindingKind::Unmodelled, block.name, NOT_MODELLED, offset);
        } else {
            if access.width != Width::Word {
                self.find(FindingKind::Misuse, block.name, "a write narrower than a word, at offset", offset);
            }
            if writable[word] & bit == 0 {
                self.find(FindingKind::Misuse, block.name, "a write to a read-only register, at offset", offset);
            } else {
                self.write_register(id, offset, value);
            }
        }
        self.carry(outside);
        Ok(())
    }

    #[inline]
    fn take_up<O: Outside>(&mut self, access: &Access, outside: &mut O) {
        if access.purpose == Purpose::Debugger {
            return;
        }
        if access.cycle >= self.next {
            self.advance(access.cycle, outside);
        }
        self.now = self.now.max(access.cycle);
        self.out.pc = (access.purpose != Purpose::AccessPort).then_some(access.pc);
    }

    fn read_word<O: Outside>(&mut self, address: u32, access: &Access, outside: &mut O) -> Option<u32> {
        let real = access.purpose != Purpose::Debugger;
        let Some((id, n, block)) = block_at(address) else {
            if let Some((name, offset)) = unmodelled_at(address) {
                if real {
                    self.find(FindingKind::Unmodelled, name, NOT_MODELLED, offset);
                }
                return Some(0);
            }
            let identification = identification(address, &self.settings);
            if identification.is_none() && real {
                self.find(FindingKind::Unmapped, "bus", "a read where the part has nothing, at", address);
            }
            return identification;
        };
        let offset = address & 0xFFC;
        if REGISTERS[n][0][offset as usize / 256] >> (offset / 4 % 64) & 1 == 0 {
            if real {
                self.find(FindingKind::Undefined, block.name, "a read where no register is, at offset", offset);
            }
            return Some(0);
        }
        if !block.modelled {
            if real {
                self.find(FindingKind::Unmodelled, block.name, NOT_MODELLED, offset);
            }
            return Some(block.registers.iter().find(|register| register.offset == offset).map_or(0, |r| r.reset));
        }
        if id == GPIO {
            return Some(self.gpio.read(offset).unwrap_or(0));
        }
        let Self { parts, clocks, now, .. } = self;
        let read = instance!(parts, id, instance => {
            let block = instance.block_ref();
            match offset {
                0x000..0x100 => Some(0),
                0x100..0x180 => Some(block.events >> ((offset - 0x100) / 4) & 1),
                0x200 => Some(block.shorts),
                0x300 | 0x304 | 0x308 => Some(block.inten),
                _ => instance.read(offset, *now, clocks),
            }
        });
        // Among the registers that are left, only the legacy UART's RXD changes when it is read.
        if real && matches!((id, offset), (0x02 | 0x28, 0x518)) {
            call!(self, id, instance, cx => instance.was_read(offset, cx));
            self.carry(outside);
        }
        let Some(value) = read.flatten() else {
            if real {
                let name = register_name(block, offset);
                self.find(FindingKind::Unmodelled, block.name, name, offset);
            }
            return Some(0);
        };
        Some(value)
    }

    fn write_register(&mut self, id: Id, offset: u32, value: u32) {
        if id == GPIO {
            let Self { gpio, out, now, .. } = self;
            gpio.write(offset, value, *now, out);
            return;
        }
        let known = call!(self, id, instance, cx => match offset {
            0x000..0x100 => value & 1 == 0 || instance.task(offset, cx),
            0x100..0x180 => {
                let bit = 1 << ((offset - 0x100) / 4);
                let block = instance.block();
                block.events = if value & 1 == 0 { block.events & !bit } else { block.events | bit };
                true
            }
            0x200 | 0x300 | 0x304 | 0x308 => {
                let block = instance.block();
                match offset {
                    0x200 => block.shorts = value,
                    0x300 => block.inten = value,
                    0x304 => block.inten |= value,
                    _ => block.inten &= !value,
                }
                instance.configured(cx);
                true
            }
            _ => instance.write(offset, value, cx),
        });
        if known != Some(true)
            && let Some((_, block)) = spec(id)
        {
            self.find(FindingKind::Unmodelled, block.name, register_name(block, offset), offset);
        }
    }

    /// The least cycles between two accesses of EasyDMA. Peripherals move at most 8 Mbit/s in each direction (PS 6.25,
    /// 6.26), which is a byte in each direction in 64 cycles. Only SPIM3 reaches 32 Mbit/s.
    fn dma_interval(&self) -> Cycle {
        if self.moving >> SPIM3 & 1 == 1 { 1 } else { 32 / Cycle::from(self.moving.count_ones().max(1)) }
    }

    /// The cycles for which an access to RAM at `cycle` waits for EasyDMA at worst. The processor has the highest
    /// priority on the AHB multilayer. It waits only if EasyDMA has already begun an access to the same slave (PS 4.7).
    #[inline(always)]
    pub(crate) fn contention(&mut self, address: u32, cycle: Cycle) -> u32 {
        let waits = self.moving != 0
            && self.memory.may_meet_dma(address)
            && cycle.wrapping_sub(self.met_dma) >= self.dma_interval();
        if waits {
            self.met_dma = cycle;
        }
        u32::from(waits)
    }

    #[inline(always)]
    pub(crate) fn flash_waits(&self) -> u32 {
        if self.parts.nvmc.is_cached() { 3 } else { 2 }
    }

    pub(crate) fn worst_wait_states(&mut self, access: &Access) -> u32 {
        match access.address {
            0..FLASH_BYTES => self.flash_waits(),
            0x0080_0000..0x0084_0000 | 0x2000_0000..0x2004_0000 => self.contention(access.address, access.cycle),
            0x4000_0000..0x5000_0000 => 6,
            _ => 1,
        }
    }
}
