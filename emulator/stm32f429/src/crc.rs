//! The CRC calculation unit (RM0090 chapter 4): `DR`, `IDR`, `CR`.
//!
//! Left out: a word stalls the bus for four cycles.

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, NEVER};

use crate::cx::{Clocks, Cx, Peripheral, Wires};

const POLYNOMIAL: u32 = 0x04C1_1DB7;

#[derive(Clone, Debug)]
pub(crate) struct Crc {
    data: u32,
    independent: u32,
}

impl Crc {
    pub(crate) fn new() -> Self {
        Self { data: u32::MAX, independent: 0 }
    }
}

impl Peripheral for Crc {
    fn read(&mut self, offset: u32, _: Width, cx: &mut Cx) -> u32 {
        self.peek(offset, cx) >> (8 * (offset & 3))
    }

    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx) {
        match offset & !3 {
            0x00 => {
                if width != Width::Word {
                    cx.find(FindingKind::Misuse, "DR written in less than a word");
                }
                self.data =
                    (0..32).fold(self.data ^ value, |crc, _| crc << 1 ^ if crc >> 31 != 0 { POLYNOMIAL } else { 0 });
            }
            0x04 => self.independent = value & 0xFF,
            // RESET does not change IDR.
            0x08 if value & 1 != 0 => self.data = u32::MAX,
            0x08 => {}
            _ => cx.find_value(FindingKind::Undefined, "no register at offset", offset),
        }
    }

    fn peek(&self, offset: u32, _: &mut Cx) -> u32 {
        match offset & !3 {
            0x00 => self.data,
            0x04 => self.independent,
            _ => 0,
        }
    }

    fn due(&self) -> Cycle {
        NEVER
    }

    fn advance<W: Wires>(&mut self, _: &mut Cx, _: &mut W) {}

    fn irq(&self) -> u32 {
        0
    }

    fn clocks_changed(&mut self, _: &Clocks, _: &mut Cx) {}

    fn reset(&mut self) {
        *self = Self::new();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    #[test]
    fn words_go_in_as_crc_32_mpeg_2_has_them() {
        let mut rig = Rig::new(Crc::new());
        // "12345678" as two big-endian words.
        rig.write(0, 0x3132_3334);
        rig.write(0, 0x3536_3738);
        assert_eq!(rig.read(0), 0x49E3_C2FB);
        rig.write(4, 0x1AB);
        rig.write(8, 1);
        assert_eq!((rig.read(0), rig.read(4)), (u32::MAX, 0xAB));
        rig.write(0, 0);
        assert_eq!(rig.read(0), 0xC704_DD7B);
    }
}
