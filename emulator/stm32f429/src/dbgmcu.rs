//! DBGMCU: the part's identity, and what goes on while a debugger holds the core.
//!
//! | covered | RM0090 |
//! |---|---|
//! | IDCODE, CR, APB1_FZ, APB2_FZ as registers, at 0xE004_2000 on the core's private bus | 38.6.1, 38.16 |
//!
//! | left out | how that shows |
//! |---|---|
//! | timers and watchdogs that stop while the core is halted, sleep modes that keep their clocks | no effect |

/// The first address, on the external private peripheral bus.
pub(crate) const BASE: u32 = 0xE004_2000;

/// Device 0x419 (STM32F42x and F43x), revision 3 (38.6.1).
const IDCODE: u32 = 0x2001_6419;

/// The writable registers. A power-on reset clears them, a system reset does not (38.16.3).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Dbgmcu {
    control: u32,
    apb1_freeze: u32,
    apb2_freeze: u32,
}

impl Dbgmcu {
    /// What a word reads; `None` where there is no register.
    pub(crate) fn read(&self, address: u32) -> Option<u32> {
        Some(match address - BASE {
            0x0 => IDCODE,
            0x4 => self.control,
            0x8 => self.apb1_freeze,
            0xC => self.apb2_freeze,
            _ => return None,
        })
    }

    /// Writes a word; `false` where there is no register that takes it.
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
