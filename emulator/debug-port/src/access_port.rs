//! The AHB-AP of a Cortex-M4: a MEM-AP (ADI C2) that accesses the bus of the microcontroller (TRM 8).
//!
//! | register | here |
//! |---|---|
//! | CSW | Size 8, 16, 32; AddrInc off, single, packed; HPROT1 and MasterType read back; DbgStatus is 1 |
//! | TAR, DRW, BD0 to BD3 | data travel in the byte lanes of their address (ADI C2.2.6) |
//! | CFG, BASE, IDR | little-endian; ROM table at 0xE00F_F000; 0x2477_0011 |

use cortex_m4::Width;

pub(super) trait Target {
    /// Reads at `address`; `None` where the bus answers with an error.
    fn read(&mut self, address: u32, width: Width) -> Option<u32>;

    /// Writes at `address`; `false` where the bus answers with an error.
    fn write(&mut self, address: u32, width: Width, value: u32) -> bool;
}

const CSW: u8 = 0x00;
const TAR: u8 = 0x04;
const DRW: u8 = 0x0C;
const BD0: u8 = 0x10;
const BD3: u8 = 0x1C;
const BASE: u8 = 0xF8;
const IDR: u8 = 0xFC;

/// The value of CSW after a reset (TRM). It permits accesses, of a word each.
const CSW_RESET: u32 = 0x4380_0042;
const CSW_WRITABLE: u32 = 1 << 29 | 1 << 25 | 3 << 4 | 7;
/// The bits of TAR that its automatic increment changes (ADI C2.2.2).
const INCREMENT: u32 = 0x3FF;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    Off,
    Single,
    Packed,
}

#[derive(Clone, Debug)]
pub(super) struct MemoryAp {
    csw: u32,
    tar: u32,
}

impl Default for MemoryAp {
    fn default() -> Self {
        Self { csw: CSW_RESET, tar: 0 }
    }
}

impl MemoryAp {
    const fn width(&self) -> Width {
        match self.csw & 7 {
            0 => Width::Byte,
            1 => Width::Half,
            _ => Width::Word,
        }
    }

    const fn step(&self) -> Step {
        match self.csw >> 4 & 3 {
            1 => Step::Single,
            2 => Step::Packed,
            _ => Step::Off,
        }
    }

    /// The number of bus accesses that one access to DRW makes. There are several for a packed transfer (ADI C2.2.7).
    const fn accesses(&self) -> u32 {
        match self.step() {
            Step::Packed => 4 / self.width().bytes(),
            Step::Off | Step::Single => 1,
        }
    }

    fn advance(&mut self) {
        if self.step() != Step::Off {
            let next = self.tar.wrapping_add(self.width().bytes());
            self.tar = self.tar & !INCREMENT | next & INCREMENT;
        }
    }

    pub(super) fn read(&mut self, register: u8, target: &mut impl Target) -> Option<u32> {
        Some(match register {
            CSW => self.csw,
            TAR => self.tar,
            DRW => {
                let width = self.width();
                let mut word = 0;
                for _ in 0..self.accesses() {
                    word |= target.read(self.tar & !(width.bytes() - 1), width)? << shift(self.tar, width);
                    self.advance();
                }
                word
            }
            BD0..=BD3 => target.read(self.tar & !0xF | u32::from(register & 0xC), Width::Word)?,
            BASE => 0xE00F_F003,
            IDR => 0x2477_0011,
            _ => 0,
        })
    }

    pub(super) fn write(&mut self, register: u8, value: u32, target: &mut impl Target) -> bool {
        match register {
            // If a write of CSW has an unsupported size, the size stays as it was (ADI C2.6.4).
            CSW => {
                let kept = if value & 7 > 2 { CSW_WRITABLE & !7 } else { CSW_WRITABLE };
                self.csw = self.csw & !kept | value & kept;
            }
            TAR => self.tar = value,
            DRW => {
                let width = self.width();
                for _ in 0..self.accesses() {
                    let part = value >> shift(self.tar, width);
                    if !target.write(self.tar & !(width.bytes() - 1), width, part) {
                        return false;
                    }
                    self.advance();
                }
            }
            BD0..=BD3 => return target.write(self.tar & !0xF | u32::from(register & 0xC), Width::Word, value),
            _ => {}
        }
        true
    }
}

/// Returns the position, in bits, of the byte lane that carries an access of this address and width.
const fn shift(address: u32, width: Width) -> u32 {
    8 * (address & 3 & !(width.bytes() - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A memory of 4 kB at address 0. Every other address answers with an error.
    struct Memory(Vec<u8>);

    impl Target for Memory {
        fn read(&mut self, address: u32, width: Width) -> Option<u32> {
            let bytes = self.0.get(address as usize..(address + width.bytes()) as usize)?;
            Some(bytes.iter().rev().fold(0, |word, &byte| word << 8 | u32::from(byte)))
        }

        fn write(&mut self, address: u32, width: Width, value: u32) -> bool {
            let bytes = self.0.get_mut(address as usize..(address + width.bytes()) as usize);
            bytes.map(|bytes| bytes.copy_from_slice(&value.to_le_bytes()[..bytes.len()])).is_some()
        }
    }

    fn ap(csw: u32, tar: u32) -> (MemoryAp, Memory) {
        let mut memory = Memory((0..4096).map(|n: u32| n as u8).collect());
        let mut ap = MemoryAp::default();
        assert!(ap.write(CSW, csw, &mut memory) && ap.write(TAR, tar, &mut memory));
        (ap, memory)
    }

    #[test]
    fn a_byte_travels_in_the_lane_of_its_address() {
        let (mut ap, mut memory) = ap(0, 0x102);
        assert_eq!(ap.read(DRW, &mut memory), Some(0x0002_0000));
        assert!(ap.write(DRW, 0xAABB_CCDD, &mut memory));
        assert_eq!(memory.0[0x100..0x104], [0, 1, 0xBB, 3]);
        assert_eq!(ap.tar, 0x102, "no increment was asked for");
    }

    #[test]
    fn packed_halfwords_fill_a_word() {
        let (mut ap, mut memory) = ap(1 | 2 << 4, 0x200);
        assert_eq!(ap.read(DRW, &mut memory), Some(0x0302_0100));
        assert_eq!(ap.tar, 0x204);
    }

    #[test]
    fn the_increment_wraps_at_a_kilobyte_as_the_architecture_allows() {
        let (mut ap, mut memory) = ap(2 | 1 << 4, 0x7FC);
        assert_eq!(ap.read(DRW, &mut memory), Some(0xFFFE_FDFC));
        assert_eq!(ap.tar, 0x400);
    }

    #[test]
    fn an_access_that_fails_leaves_the_address_where_it_was() {
        let (mut ap, mut memory) = ap(2 | 1 << 4, 0x1000);
        assert_eq!(ap.read(DRW, &mut memory), None);
        assert!(!ap.write(DRW, 0, &mut memory));
        assert_eq!(ap.tar, 0x1000);
    }

    #[test]
    fn a_size_that_the_port_does_not_have_is_not_taken() {
        let (mut ap, mut memory) = ap(1, 0);
        assert!(ap.write(CSW, 3, &mut memory));
        assert_eq!(ap.csw & 7, 1);
    }

    #[test]
    fn the_banked_registers_are_words_beside_the_address() {
        let (mut ap, mut memory) = ap(0, 0x10B);
        assert_eq!(ap.read(BD3, &mut memory), Some(0x0F0E_0D0C));
        assert!(ap.write(BD0, 0x1234_5678, &mut memory));
        assert_eq!((ap.tar, &memory.0[0x100..0x104]), (0x10B, &[0x78, 0x56, 0x34, 0x12][..]));
    }
}
