//! Loads and stores of the core.
//!
//! | ARM ARM, TRM | what is covered |
//! |---|---|
//! | A3.2.1 | alignment: CCR.UNALIGN_TRP; callers check instructions that always need alignment |
//! | B3.1 | accesses to the core's own space, 0xE000_0000 to 0xE00F_FFFF, go to the system registers |
//! | B3.5 | the MPU is checked before the bus |
//! | TRM 3.7 | bit-banding, where the part has it |
//! | B3.2.8 | CCR.BFHFNMIGN: a load that nothing answers reads 0, and CFSR and BFAR report the fault |
//! | C1.8 | the comparators of the DWT check data accesses while they watch |
//!
//! An unaligned access becomes several aligned ones at rising addresses (TRM 3.7.2). A half at an odd address becomes
//! two bytes, a word at 2 mod 4 two halves, and a word at an odd address byte, half, byte. Unaligned accesses to the
//! core's own space take UFSR.UNALIGNED. There is no write buffer, so each bus fault is precise.

use crate::system::mpu::data_right;
use crate::{Access, Bound, Bus, Core, Cost, Fault, Purpose, Width};

const PRIVATE: u32 = 0xE000_0000;
const PRIVATE_END: u32 = 0xE010_0000;

const BYTE: u8 = Width::Byte as u8;
const HALF: u8 = Width::Half as u8;
const WORD: u8 = Width::Word as u8;

const fn sized(bytes: u8) -> Width {
    match bytes {
        BYTE => Width::Byte,
        HALF => Width::Half,
        _ => Width::Word,
    }
}

/// Whether `address` may be a bit-band alias or in the core's own space. The result is true for some other addresses as
/// well.
#[inline(always)]
const fn is_special(address: u32) -> bool {
    address >= PRIVATE || address & 0x9E00_0000 == 0x0200_0000
}

/// The byte and the bit in it that a bit-band alias stands for (TRM 3.7.1).
const fn bit_band(address: u32) -> Option<(u32, u32)> {
    let region = address & 0xFE00_0000;
    if region != 0x2200_0000 && region != 0x4200_0000 {
        return None;
    }
    let byte = (region - 0x0200_0000) + ((address & 0x01FF_FFFF) >> 5);
    Some((byte, (address >> 2) & 7))
}

impl<C: Cost> Core<C> {
    /// Computes `short_read` and `short_write`. Neither privilege nor watching changes while instructions execute
    /// without a break, so the two values hold that long.
    #[inline(always)]
    pub(crate) fn note_short_way(&mut self) {
        let short = !self.watching();
        let privileged = self.is_privileged();
        self.short_read = if short { data_right(false, privileged) } else { 0 };
        self.short_write = if short { data_right(true, privileged) } else { 0 };
    }

    #[inline(always)]
    pub(crate) fn load<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        purpose: Purpose,
    ) -> Result<u32, Fault> {
        if self.system.mpu.gives(address, self.short_read)
            && let Some(value) = bus.read_memory(address, width)
        {
            self.count_memory(bus, address, width, purpose);
            return Ok(value);
        }
        self.catch_up();
        let privileged = self.is_privileged();
        self.load_as(bus, address, width, purpose, privileged)
    }

    #[inline(always)]
    pub(crate) fn store<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        value: u32,
        purpose: Purpose,
    ) -> Result<(), Fault> {
        if self.system.mpu.gives(address, self.short_write) && bus.write_memory(address, width, value) {
            self.count_memory(bus, address, width, purpose);
            return Ok(());
        }
        self.catch_up();
        let privileged = self.is_privileged();
        self.store_as(bus, address, width, value, purpose, privileged)
    }

    #[inline(always)]
    pub(crate) fn load_as<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        purpose: Purpose,
        privileged: bool,
    ) -> Result<u32, Fault> {
        if address & (width.bytes() - 1) != 0 || is_special(address) {
            return self.load_unusual(bus, address, width, purpose, privileged);
        }
        self.load_plain(bus, address, width, purpose, privileged)
    }

    #[inline(always)]
    pub(crate) fn store_as<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        value: u32,
        purpose: Purpose,
        privileged: bool,
    ) -> Result<(), Fault> {
        if address & (width.bytes() - 1) != 0 || is_special(address) {
            return self.store_unusual(bus, address, width, value, purpose, privileged);
        }
        self.store_plain(bus, address, width, value, purpose, privileged)
    }

    /// Reads the next word of a load multiple. `reached` says that [`Core::reaches`] holds for all words of the
    /// instruction.
    #[inline(always)]
    pub(crate) fn load_next<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        purpose: Purpose,
        reached: bool,
    ) -> Result<u32, Fault> {
        match reached.then(|| bus.read_memory(address, Width::Word)).flatten() {
            Some(value) => {
                self.count_memory(bus, address, Width::Word, purpose);
                Ok(value)
            }
            None => self.load(bus, address, Width::Word, purpose),
        }
    }

    /// Writes the next word of a store multiple. `reached` has the meaning that it has in [`Core::load_next`].
    #[inline(always)]
    pub(crate) fn store_next<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        value: u32,
        reached: bool,
    ) -> Result<(), Fault> {
        if reached && bus.write_memory(address, Width::Word, value) {
            self.count_memory(bus, address, Width::Word, Purpose::Data);
            return Ok(());
        }
        self.store(bus, address, Width::Word, value, Purpose::Data)
    }

    #[inline(always)]
    fn count_memory<B: Bus>(&mut self, bus: &mut B, address: u32, width: Width, purpose: Purpose) {
        if let Some(bound) = C::BOUND {
            let waits = match bus.memory_waits(address, false, self.cycle, bound) {
                Some(waits) => waits,
                None => self.asked_waits(bus, address, width, purpose, bound),
            };
            self.cycle = self.cycle.wrapping_add(u64::from(waits));
        }
    }

    #[inline(never)]
    pub(crate) fn asked_waits<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        purpose: Purpose,
        bound: Bound,
    ) -> u32 {
        let access = self.access(address, width, purpose, self.is_privileged());
        bus.wait_states(&access, bound)
    }

    /// Whether the core may access `bytes` bytes from `address` on without checks, if they are memory: the DWT does not
    /// watch, and the MPU opens these addresses.
    #[inline(always)]
    pub(crate) fn reaches(&mut self, address: u32, bytes: u32, write: bool, privileged: bool) -> bool {
        !self.watching() && self.mpu_opens(address, bytes, write, privileged)
    }

    #[inline(always)]
    fn access(&self, address: u32, width: Width, purpose: Purpose, privileged: bool) -> Access {
        Access { address, width, purpose, privileged, cycle: self.cycle, pc: self.r[15] }
    }

    #[inline(always)]
    fn load_plain<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        purpose: Purpose,
        privileged: bool,
    ) -> Result<u32, Fault> {
        match width {
            Width::Byte => self.load_sized::<B, BYTE>(bus, address, purpose, privileged),
            Width::Half => self.load_sized::<B, HALF>(bus, address, purpose, privileged),
            Width::Word => self.load_sized::<B, WORD>(bus, address, purpose, privileged),
        }
    }

    /// Makes an aligned load. A separate function for each width keeps the bus from being inlined into each load
    /// instruction.
    #[inline(never)]
    fn load_sized<B: Bus, const WIDTH: u8>(
        &mut self,
        bus: &mut B,
        address: u32,
        purpose: Purpose,
        privileged: bool,
    ) -> Result<u32, Fault> {
        let width = const { sized(WIDTH) };
        if purpose != Purpose::Vector && !self.mpu_data(address, false, privileged) {
            return Err(refused(address, purpose, false));
        }
        let access = self.access(address, width, purpose, privileged);
        if let Some(bound) = C::BOUND {
            self.cycle += u64::from(bus.wait_states(&access, bound));
        }
        let value = match bus.read(&access) {
            Ok(value) => value,
            Err(_) if self.ignores_bus_fault(address) => 0,
            Err(_) => return Err(unanswered(address, purpose, false)),
        };
        self.notice(bus);
        if self.watching() && matches!(purpose, Purpose::Data | Purpose::Literal) {
            self.watch(address, false, width, value);
        }
        Ok(value)
    }

    #[inline(always)]
    fn store_plain<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        value: u32,
        purpose: Purpose,
        privileged: bool,
    ) -> Result<(), Fault> {
        match width {
            Width::Byte => self.store_sized::<B, BYTE>(bus, address, value, purpose, privileged),
            Width::Half => self.store_sized::<B, HALF>(bus, address, value, purpose, privileged),
            Width::Word => self.store_sized::<B, WORD>(bus, address, value, purpose, privileged),
        }
    }

    /// Makes an aligned store. A separate function for each width keeps the bus from being inlined into each store
    /// instruction.
    #[inline(never)]
    fn store_sized<B: Bus, const WIDTH: u8>(
        &mut self,
        bus: &mut B,
        address: u32,
        value: u32,
        purpose: Purpose,
        privileged: bool,
    ) -> Result<(), Fault> {
        let width = const { sized(WIDTH) };
        if !self.mpu_data(address, true, privileged) {
            return Err(refused(address, purpose, true));
        }
        let access = self.access(address, width, purpose, privileged);
        if let Some(bound) = C::BOUND {
            self.cycle += u64::from(bus.wait_states(&access, bound));
        }
        if bus.write(&access, value).is_err() && !self.ignores_bus_fault(address) {
            return Err(unanswered(address, purpose, true));
        }
        self.notice(bus);
        if self.watching() && purpose == Purpose::Data {
            self.watch(address, true, width, value);
        }
        Ok(())
    }

    /// Ends a burst of the run loop if the last access changed a signal of the part, or wrote into a watched page of
    /// code.
    #[inline(always)]
    fn notice<B: Bus>(&mut self, bus: &mut B) {
        if bus.signals().is_announced() || bus.rewritten() != self.rewritten {
            self.end_burst();
        }
    }

    #[inline(never)]
    fn load_unusual<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        purpose: Purpose,
        privileged: bool,
    ) -> Result<u32, Fault> {
        let own = (PRIVATE..PRIVATE_END).contains(&address);
        if address & (width.bytes() - 1) != 0 {
            if own || self.traps_unaligned() {
                return Err(Fault::Unaligned);
            }
            let mut value = 0;
            for (part, width) in parts(address, width) {
                let shift = 8 * part;
                let at = address.wrapping_add(part);
                value |= self.load_as(bus, at, width, purpose, privileged)? << shift;
            }
            return Ok(value);
        }
        if own {
            let access = self.access(address, width, purpose, privileged);
            let value = self.system_read(bus, &access)?;
            self.end_burst();
            return Ok(value);
        }
        if let Some((byte, bit)) = bit_band(address)
            && bus.bit_banding()
        {
            if !self.mpu_data(address, false, privileged) {
                return Err(refused(address, purpose, false));
            }
            // The access to an alias becomes an access of the same width to the word that has the bit (TRM 3.7.1).
            let whole = byte & !(width.bytes() - 1);
            let value = self.load_plain(bus, whole, width, purpose, privileged)?;
            return Ok(value >> (8 * (byte - whole) + bit) & 1);
        }
        self.load_plain(bus, address, width, purpose, privileged)
    }

    #[inline(never)]
    fn store_unusual<B: Bus>(
        &mut self,
        bus: &mut B,
        address: u32,
        width: Width,
        value: u32,
        purpose: Purpose,
        privileged: bool,
    ) -> Result<(), Fault> {
        let own = (PRIVATE..PRIVATE_END).contains(&address);
        if address & (width.bytes() - 1) != 0 {
            if own || self.traps_unaligned() {
                return Err(Fault::Unaligned);
            }
            for (part, width) in parts(address, width) {
                let at = address.wrapping_add(part);
                self.store_as(bus, at, width, value >> (8 * part), purpose, privileged)?;
            }
            return Ok(());
        }
        if own {
            let access = self.access(address, width, purpose, privileged);
            self.system_write(bus, &access, value)?;
            self.end_burst();
            return Ok(());
        }
        if let Some((byte, bit)) = bit_band(address)
            && bus.bit_banding()
        {
            if !self.mpu_data(address, true, privileged) {
                return Err(refused(address, purpose, true));
            }
            let whole = byte & !(width.bytes() - 1);
            let old = self.load_plain(bus, whole, width, purpose, privileged)?;
            let mask = 1 << (8 * (byte - whole) + bit);
            let new = if value & 1 != 0 { old | mask } else { old & !mask };
            return self.store_plain(bus, whole, width, new, purpose, privileged);
        }
        self.store_plain(bus, address, width, value, purpose, privileged)
    }
}

fn parts(address: u32, width: Width) -> impl Iterator<Item = (u32, Width)> {
    let list: [Option<(u32, Width)>; 3] = match (width, address & 1) {
        (Width::Word, 0) => [Some((0, Width::Half)), Some((2, Width::Half)), None],
        (Width::Word, _) => [Some((0, Width::Byte)), Some((1, Width::Half)), Some((3, Width::Byte))],
        _ => [Some((0, Width::Byte)), Some((1, Width::Byte)), None],
    };
    list.into_iter().flatten()
}

#[cold]
const fn unanswered(address: u32, purpose: Purpose, write: bool) -> Fault {
    match (purpose, write) {
        (Purpose::Stack, true) => Fault::BusStacking,
        (Purpose::Stack, false) => Fault::BusUnstacking,
        (Purpose::Vector, _) => Fault::VectorRead,
        (Purpose::Fetch, _) => Fault::BusInstruction,
        _ => Fault::BusData(address),
    }
}

#[cold]
const fn refused(address: u32, purpose: Purpose, write: bool) -> Fault {
    match (purpose, write) {
        (Purpose::Stack, true) => Fault::MemStacking,
        (Purpose::Stack, false) => Fault::MemUnstacking,
        (Purpose::Vector, _) => Fault::VectorRead,
        (Purpose::Fetch, _) => Fault::MemInstruction,
        _ => Fault::MemData(address),
    }
}
