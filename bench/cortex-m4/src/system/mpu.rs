//! The memory protection unit, ARM ARM B3.5, and the default memory map's execute-never regions, B3.1.
//!
//! | Covered | ARM ARM |
//! |---|---|
//! | TYPE, CTRL, RNR, RBAR, RASR and their three aliases | B3.5.5 to B3.5.10 |
//! | sizes, subregions, overlap, AP, XN, the background map | B3.5.1 to B3.5.3 |
//!
//! Left out: memory attributes (TEX, S, C, B) are kept and read back, nothing depends on them.

const ENABLE: u32 = 1;
const HFNMIENA: u32 = 1 << 1;
const PRIVDEFENA: u32 = 1 << 2;

#[derive(Clone, Copy, Debug, Default)]
struct Region {
    /// RBAR bits 31:5.
    base: u32,
    /// RASR.
    attributes: u32,
}

impl Region {
    /// Whether the region is on and has `address`, ARM ARM B3.5.3.
    fn has(self, address: u32) -> bool {
        let size = self.attributes >> 1 & 0x1F;
        if self.attributes & 1 == 0 || size < 4 {
            return false;
        }
        // 2^(size + 1) bytes; the base's bits below that do not take part
        let inside = if size == 31 { u32::MAX } else { (2u32 << size) - 1 };
        if (address ^ self.base) & !inside != 0 {
            return false;
        }
        // eighths of a region of 256 bytes or more can be off
        size < 7 || self.attributes >> (8 + ((address >> (size - 2)) & 7)) & 1 == 0
    }

    /// RASR.AP, ARM ARM table B3-15.
    fn allows(self, write: bool, privileged: bool) -> bool {
        match self.attributes >> 24 & 7 {
            1 => privileged,
            2 => privileged || !write,
            3 => true,
            5 => privileged && !write,
            6 | 7 => !write,
            _ => false,
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Mpu {
    control: u32,
    number: u32,
    count: u32,
    regions: [Region; 8],
    /// What the regions say of privileged accesses to lines of [`LINE`] bytes, the least that a region or an eighth of
    /// one has: a line's number and the bits below, in a place that follows from the number. A place that knows nothing
    /// is 0.
    lines: Box<[u32]>,
    /// Whether all of a page of code may be executed by privileged code, and the line behind it: likewise.
    pages: [u32; PAGES],
}

const LINE: u32 = 32;
const LINES: usize = 1024;
const PAGES: usize = 64;
const READ: u32 = 1;
const WRITE: u32 = 2;
const EXECUTE: u32 = 4;
const KNOWN: u32 = 8;

/// Whether code may run there without a region that says so, ARM ARM table B3-1: code, SRAM and external RAM.
fn default_executable(address: u32) -> bool {
    matches!(address >> 29, 0 | 1 | 3 | 4)
}

impl Mpu {
    pub(crate) fn new(regions: u8) -> Self {
        Self {
            control: 0,
            number: 0,
            count: u32::from(regions.min(8)),
            regions: [Region::default(); 8],
            lines: vec![0; LINES].into_boxed_slice(),
            pages: [0; PAGES],
        }
    }

    /// Forgets what was decided by registers that are now others.
    fn forget(&mut self) {
        self.lines.iter_mut().chain(&mut self.pages).for_each(|known| *known = 0);
    }

    /// What privileged code may do at `address` while the MPU applies.
    #[inline]
    fn decided(&mut self, address: u32) -> u32 {
        let number = address / LINE;
        let known = self.lines[number as usize % LINES];
        if known & KNOWN != 0 && known / LINE == number {
            return known;
        }
        let mut decided = (number * LINE) | KNOWN;
        for (bit, allowed) in [
            (READ, self.decide_data(address, false, true)),
            (WRITE, self.decide_data(address, true, true)),
            (EXECUTE, self.decide_fetch(address, true)),
        ] {
            decided |= if allowed { bit } else { 0 };
        }
        self.lines[number as usize % LINES] = decided;
        decided
    }

    /// Whether privileged code may read, or write, all bytes from `address` on that are in one line, whatever the
    /// priority.
    #[inline]
    pub(crate) fn opens(&mut self, address: u32, bytes: u32, write: bool) -> bool {
        address % LINE + bytes <= LINE && self.decided(address) & if write { WRITE } else { READ } != 0
    }

    /// Whether privileged code may execute all of the page of `1 << bits` bytes that has `address`, and an instruction
    /// that begins at its end, whatever the priority.
    #[inline]
    pub(crate) fn opens_page(&mut self, address: u32, bits: u32) -> bool {
        let number = address >> bits;
        let known = self.pages[number as usize % PAGES];
        if known & KNOWN != 0 && known >> bits == number {
            return known & EXECUTE != 0;
        }
        let first = number << bits;
        let opens = default_executable(first)
            && (0..=1 << bits).step_by(LINE as usize).all(|at| self.decided(first.wrapping_add(at)) & EXECUTE != 0);
        self.pages[number as usize % PAGES] = first | KNOWN | if opens { EXECUTE } else { 0 };
        opens
    }

    pub(crate) fn enabled(&self) -> bool {
        self.control & ENABLE != 0
    }

    /// Whether the MPU is on for code of this priority: not in NMI and HardFault unless HFNMIENA.
    fn applies(&self, priority: i32) -> bool {
        self.enabled() && (priority >= 0 || self.control & HFNMIENA != 0)
    }

    fn region(&self, address: u32) -> Option<Region> {
        self.regions.iter().rev().copied().find(|region| region.has(address))
    }

    /// Whether data at `address` may be accessed. `priority` is the execution priority.
    pub(crate) fn data(&mut self, address: u32, write: bool, privileged: bool, priority: i32) -> bool {
        // the private peripheral bus is always of the default map (B3.5.1)
        if !self.applies(priority) || address >> 20 == 0xE00 {
            return true;
        }
        if privileged {
            return self.decided(address) & if write { WRITE } else { READ } != 0;
        }
        self.decide_data(address, write, privileged)
    }

    fn decide_data(&self, address: u32, write: bool, privileged: bool) -> bool {
        match self.region(address) {
            Some(region) => region.allows(write, privileged),
            None => privileged && self.control & PRIVDEFENA != 0,
        }
    }

    pub(crate) fn fetch(&mut self, address: u32, privileged: bool, priority: i32) -> bool {
        if !self.applies(priority) {
            return default_executable(address);
        }
        if privileged {
            return self.decided(address) & EXECUTE != 0;
        }
        self.decide_fetch(address, privileged)
    }

    fn decide_fetch(&self, address: u32, privileged: bool) -> bool {
        match self.region(address) {
            // system space is execute-never whatever a region says (B3.1)
            Some(region) => {
                region.allows(false, privileged) && region.attributes >> 28 & 1 == 0 && address < 0xE000_0000
            }
            None => privileged && self.control & PRIVDEFENA != 0 && default_executable(address),
        }
    }

    /// Reads at an offset from 0xE000_ED90.
    pub(crate) fn read(&self, offset: u32) -> u32 {
        let region = self.regions[(self.number & 7) as usize];
        match offset {
            _ if self.count == 0 => 0,
            0x00 => self.count << 8,
            0x04 => self.control,
            0x08 => self.number,
            0x0C | 0x14 | 0x1C | 0x24 => region.base | self.number,
            _ => region.attributes,
        }
    }

    /// Writes at an offset from 0xE000_ED90.
    pub(crate) fn write(&mut self, offset: u32, value: u32) {
        if self.count == 0 {
            return;
        }
        self.forget();
        match offset {
            0x00 => {}
            0x04 => self.control = value & (ENABLE | HFNMIENA | PRIVDEFENA),
            0x08 => self.number = (value & 0xFF) % self.count,
            0x0C | 0x14 | 0x1C | 0x24 => {
                // VALID: the region is the one named here, and RNR becomes that
                if value & 1 << 4 != 0 {
                    self.number = (value & 0xF) % self.count;
                }
                self.regions[(self.number & 7) as usize].base = value & !0x1F;
            }
            _ => self.regions[(self.number & 7) as usize].attributes = value & 0x173F_FF3F,
        }
    }
}
