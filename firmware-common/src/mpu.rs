//! The memory protection unit: which memory the firmware may read, write and execute. It may access no other memory.
//!
//! # Design
//!
//! Each board has two [`Table`]s of [`Region`]s: one for the start, one for the tasks. The compiler checks both.
//!
//! - *An address that no region opens is shut* (MPU_CTRL.PRIVDEFENA = 0, ARMv7-M ARM B3.5.5), also to privileged code,
//!   as all of the firmware is. The bus at 0xE000_0000 is exempt (B3.5.1).
//! - *Where two regions overlap, the one of the higher number decides* (ARMv7-M ARM B3.5.3). If a subregion, an eighth
//!   of a region, is shut, the regions of lower numbers decide about its addresses.
//! - *The unit does not apply* at the priority of HardFault, of NMI and under FAULTMASK (MPU_CTRL.HFNMIENA = 0), so
//!   that the handler can run even if the table itself is wrong.
//! - *The processor fetches exception vectors without the unit* (ARMv7-M ARM B3.5.1), so the vector table may be shut.
//! - *The unit does not check DMA*, since it lies between the core and the bus.
//!
//! An access that the tables forbid raises MemManage, which leads to the safe state
//! ([`safe_state`](crate::safe_state)).

/// The accesses that a region allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Allowed {
    /// No access is allowed.
    Nothing,
    /// Data may be read.
    Read,
    /// Data may be read, and code may be executed.
    ReadExecute,
    /// Data may be read and written.
    ReadWrite,
}

/// The kind of an access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// The access reads data.
    Read,
    /// The access writes data.
    Write,
    /// The access executes an instruction.
    Execute,
}

/// The kind of memory in a region, which gives its attributes (ARMv7-M ARM, table B3-14; PM0214, section 4.2.5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// Flash is normal memory, write-through.
    Flash,
    /// RAM is normal memory, write-back, shared with DMA.
    Ram,
    /// A peripheral is shared device memory: accesses stay in order and are neither merged nor repeated.
    Peripheral,
}

/// A range of addresses with the accesses that it allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    name: &'static str,
    base: u32,
    size: u32,
    shut: u8,
    memory: Memory,
    allowed: Allowed,
}

impl Region {
    /// The size of the smallest region, bytes (ARMv7-M ARM B3.5.8).
    const SMALLEST: u32 = 32;
    /// The size of the smallest region that has subregions, bytes (ARMv7-M ARM B3.5.3).
    const SMALLEST_OF_EIGHTHS: u32 = 256;

    /// Returns a region of `size` bytes from `base` on, with all its bytes open. `name` describes the region in
    /// messages.
    ///
    /// # Panics
    ///
    /// Panics at compile time if `size` is not a power of two of at least 32, or if `base` is not a multiple of `size`.
    #[must_use]
    pub const fn new(name: &'static str, base: u32, size: u32, memory: Memory, allowed: Allowed) -> Self {
        assert!(size.is_power_of_two() && size >= Self::SMALLEST, "a region's size is a power of two, at least 32");
        assert!(base.is_multiple_of(size), "a region begins at a multiple of its size");
        Self { name, base, size, shut: 0, memory, allowed }
    }

    /// Returns the region with only some of its eighths open: `open[n]` is for the eighth from `base + n * size / 8`
    /// on.
    ///
    /// # Panics
    ///
    /// Panics at compile time if the region is too small to have eighths, or none is open.
    #[must_use]
    pub const fn only(mut self, open: [bool; 8]) -> Self {
        assert!(self.size >= Self::SMALLEST_OF_EIGHTHS, "a region of less than 256 bytes has no subregions");
        self.shut = 0;
        let mut eighth = 0;
        while eighth < 8 {
            if !open[eighth] {
                self.shut |= 1 << eighth;
            }
            eighth += 1;
        }
        assert!(self.shut != u8::MAX, "a region of which nothing is open");
        self
    }

    /// Returns the region's name.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        self.name
    }

    const fn spans(&self, address: u32) -> bool {
        address.wrapping_sub(self.base) < self.size
    }

    /// Whether `address` is in an open eighth of the region, so that this region decides about the address.
    const fn has(&self, address: u32) -> bool {
        // A region below 256 bytes has no eighths, so its `shut` is zero.
        self.spans(address) && (self.size < 8 || self.shut >> ((address - self.base) / (self.size / 8)) & 1 == 0)
    }

    /// Returns the value of MPU_RBAR for region `number`. Its bit VALID is set, so that it selects the region (ARMv7-M
    /// ARM B3.5.8).
    #[cfg(any(test, target_os = "none"))]
    const fn rbar(&self, number: u32) -> u32 {
        self.base | 1 << 4 | number
    }

    /// Returns the value of MPU_RASR (ARMv7-M ARM B3.5.9), with the region enabled.
    #[cfg(any(test, target_os = "none"))]
    const fn rasr(&self) -> u32 {
        // AP gives privileged and unprivileged code the same permission (ARMv7-M ARM, table B3-15).
        let permission = match self.allowed {
            Allowed::Nothing => 0b000,
            Allowed::ReadWrite => 0b001,
            Allowed::Read | Allowed::ReadExecute => 0b101,
        };
        let execute_never = !matches!(self.allowed, Allowed::ReadExecute);
        // The bits of the attributes are TEX (three bits), S, C and B.
        let attributes = match self.memory {
            Memory::Flash => 0b00_0010,
            Memory::Ram => 0b00_0111,
            Memory::Peripheral => 0b00_0101,
        };
        (execute_never as u32) << 28
            | permission << 24
            | attributes << 16
            | (self.shut as u32) << 8
            | (self.size.trailing_zeros() - 1) << 1
            | 1
    }
}

/// The regions that are in force at the same time, at most eight.
#[derive(Clone, Copy, Debug)]
pub struct Table<const N: usize>([Region; N]);

impl<const N: usize> Table<N> {
    /// The number of regions of the Cortex-M4's memory protection unit (TRM, chapter 5).
    const MOST: usize = 8;

    /// Returns a table of regions. Where regions overlap, the later one decides.
    ///
    /// # Panics
    ///
    /// Panics at compile time if there are more than eight regions.
    #[must_use]
    pub const fn new(regions: [Region; N]) -> Self {
        assert!(N <= Self::MOST, "the unit has eight regions");
        Self(regions)
    }

    /// Returns the regions of the table.
    #[must_use]
    pub const fn regions(&self) -> &[Region] {
        &self.0
    }

    /// Whether the firmware's code may make this access to `address`.
    #[must_use]
    pub fn allows(&self, address: u32, access: Access) -> bool {
        let decides = self.0.iter().rev().find(|region| region.has(address));
        decides.is_some_and(|region| match access {
            Access::Read => region.allowed != Allowed::Nothing,
            Access::Write => region.allowed == Allowed::ReadWrite,
            Access::Execute => region.allowed == Allowed::ReadExecute,
        })
    }

    /// Returns the name of the region that decides about `address`. If no region does, returns the name of a region in
    /// whose shut eighth the address lies, or else "an address where nothing is".
    #[must_use]
    pub fn name_of(&self, address: u32) -> &'static str {
        let mut regions = self.0.iter().rev();
        let found = regions.find(|region| region.has(address));
        let found = found.or_else(|| self.0.iter().rev().find(|region| region.spans(address)));
        found.map_or("an address where nothing is", Region::name)
    }
}

/// Puts `table` into force in the memory protection unit.
#[cfg(target_os = "none")]
#[allow(unsafe_code)]
pub fn apply<const N: usize>(unit: &mut cortex_m::peripheral::MPU, table: &Table<N>) {
    /// The value of MPU_CTRL: the unit is on, except in HardFault and NMI, and an address that no region opens is shut
    /// (ARMv7-M ARM B3.5.5).
    const ENABLE: u32 = 1;
    off();
    for number in 0..Table::<N>::MOST as u32 {
        let region = table.0.get(number as usize);
        // For a region that is off, RBAR has no base. Its bit VALID selects the region.
        let (base, attributes) = region.map_or((1 << 4 | number, 0), |region| (region.rbar(number), region.rasr()));
        // SAFETY: the unit is off meanwhile. With the unit on, an access to what the table shuts faults, which is the
        // purpose. The tables are constants whose regions were checked when they were compiled.
        unsafe { unit.rbar.write(base) };
        // SAFETY: the unit is off meanwhile, and the table's regions were checked when they were compiled.
        unsafe { unit.rasr.write(attributes) };
    }
    // SAFETY: the table's regions were checked when they were compiled; an access that they shut faults.
    unsafe { unit.ctrl.write(ENABLE) };
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Switches the memory protection unit off for the safe state, which needs peripherals that tasks must not use.
#[cfg(target_os = "none")]
#[allow(unsafe_code)]
pub fn off() {
    cortex_m::asm::dmb();
    // SAFETY: the register block is always there; while the unit is off every access is allowed.
    unsafe { (*cortex_m::peripheral::MPU::PTR).ctrl.write(0) };
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLASH: Region = Region::new("flash", 0x0800_0000, 0x2_0000, Memory::Flash, Allowed::ReadExecute);
    const RAM: Region = Region::new("RAM", 0x2000_0000, 0x4_0000, Memory::Ram, Allowed::ReadWrite);
    const UARTS: Region = Region::new("UARTs", 0x4000_4000, 0x4000, Memory::Peripheral, Allowed::ReadWrite)
        .only([true, true, false, false, false, false, false, true]);

    #[test]
    fn a_region_is_written_as_the_architecture_lays_its_registers_out() {
        // In RASR the field SIZE is the exponent less one, AP 0b101 means read-only for privileged code, and bit 28 is
        // XN.
        assert_eq!(FLASH.rbar(0), 0x0800_0010);
        assert_eq!(FLASH.rasr(), 0x0502_0021);
        assert_eq!(RAM.rbar(2), 0x2000_0012);
        assert_eq!(RAM.rasr(), 0x1107_0023);
        assert_eq!(UARTS.rbar(7), 0x4000_4017);
        assert_eq!(UARTS.rasr(), 0x1105_7C1B);
        let null = Region::new("null", 0, 32, Memory::Flash, Allowed::Nothing);
        assert_eq!(null.rasr(), 0x1002_0009);
        assert_eq!(Region::new("data", 0, 64, Memory::Flash, Allowed::Read).rasr(), 0x1502_000B);
    }

    #[test]
    fn what_no_region_opens_is_shut() {
        let table = Table::new([FLASH, RAM]);
        for access in [Access::Read, Access::Write, Access::Execute] {
            for address in [0, 0x07FF_FFFF, 0x0802_0000, 0x1FFF_FFFF, 0x2004_0000, 0x4000_0000, u32::MAX] {
                assert!(!table.allows(address, access), "{access:?} {address:#x}");
            }
        }
        assert_eq!(table.name_of(0x1FFF_FFFF), "an address where nothing is");
    }

    #[test]
    fn each_kind_of_region_allows_what_it_says_and_nothing_else() {
        let kinds = [
            (Allowed::Nothing, [false, false, false]),
            (Allowed::Read, [true, false, false]),
            (Allowed::ReadExecute, [true, false, true]),
            (Allowed::ReadWrite, [true, true, false]),
        ];
        for (allowed, expected) in kinds {
            let table = Table::new([Region::new("any", 0x100, 0x100, Memory::Ram, allowed)]);
            for address in [0x100, 0x17F, 0x1FF] {
                let found = [Access::Read, Access::Write, Access::Execute].map(|access| table.allows(address, access));
                assert_eq!(found, expected, "{allowed:?}");
            }
        }
    }

    #[test]
    fn a_subregion_that_is_shut_is_left_to_regions_of_lower_numbers() {
        let alone = Table::new([UARTS]);
        let open: Vec<bool> = (0..8).map(|eighth| alone.allows(0x4000_4000 + 0x800 * eighth, Access::Write)).collect();
        assert_eq!(open, [true, true, false, false, false, false, false, true]);
        assert!(alone.allows(0x4000_4FFF, Access::Read) && !alone.allows(0x4000_5000, Access::Read));
        assert_eq!(alone.name_of(0x4000_5000), "UARTs");
        let below = Region::new("all", 0x4000_0000, 0x1_0000, Memory::Peripheral, Allowed::Read);
        let both = Table::new([below, UARTS]);
        assert!(both.allows(0x4000_5000, Access::Read) && !both.allows(0x4000_5000, Access::Write));
        assert_eq!((both.name_of(0x4000_5000), both.name_of(0x4000_4800)), ("all", "UARTs"));
    }

    #[test]
    fn of_two_regions_at_one_address_the_later_decides() {
        let null = Region::new("null page", 0x0800_0000, 0x100, Memory::Flash, Allowed::Nothing);
        let table = Table::new([FLASH, null]);
        assert!(!table.allows(0x0800_00FF, Access::Read) && table.allows(0x0800_0100, Access::Execute));
        assert!(Table::new([null, FLASH]).allows(0x0800_0000, Access::Read));
        assert_eq!(table.name_of(0x0800_0000), "null page");
    }

    #[test]
    fn a_region_of_half_the_address_space_ends_with_it() {
        let half = Region::new("half", 0x8000_0000, 0x8000_0000, Memory::Ram, Allowed::ReadWrite);
        let table = Table::new([half]);
        assert!(table.allows(u32::MAX, Access::Write) && !table.allows(0x7FFF_FFFF, Access::Write));
        assert_eq!(half.rasr() >> 1 & 0x1F, 30);
    }
}
