//! DBGMCU: the part's identity, and settings for a debugger.
//!
//! | covered | RM0090 |
//! |---|---|
//! | IDCODE, CR, APB1_FZ, APB2_FZ as registers, at 0xE004_2000 on the core's private bus | 38.6.1, 38.16 |
//!
//! | left out | effect |
//! |---|---|
//! | stopping timers and watchdogs while the core is halted, keeping clocks in sleep modes | none |

/// The first address of DBGMCU, on the external private peripheral bus.
pub(crate) const BASE: u32 = 0xE004_2000;

/// The identity: device 0x419 (STM32F42x and F43x), revision 3 (RM0090 38.6.1).
const IDCODE: u32 = 0x2001_6419;

/// The writable registers. Only a power-on reset clears them (RM0090 38.16.3).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Dbgmcu {
    control: u32,
    apb1_freeze: u32,
    apb2_freeze: u32,
}

impl Dbgmcu {
    pub(crate) fn read(&self, address: u32) -> Option<u32> {
        Some(match address - BASE {
            0x0 => IDCODE,
            0x4 => self.control,
            0x8 => self.apb1_freeze,
            0xC => self.apb2_freeze,
            _ => return None,
        })
    }

    pub(crate) fn write(&mut self, address: u32, value: u32) -> bool {
        match address - BASE {
            0x4 => self.control = value & 0xE7,
            0x8 => self.apb1_freeze = value & 0x06E0_1DFF,
            0xC => self.apb2_freeze = value & 0x0007_0003,
            _ => return false,
        }
        true
    }
}
