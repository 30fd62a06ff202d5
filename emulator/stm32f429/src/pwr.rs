//! Power control, RM0090 chapter 5.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `CR` `VOS` | Can be written only while the PLL is off; takes effect while it is on, 5.4.1 |
//! | `CR` `ODEN`, `ODSWEN`; `CSR` `ODRDY`, `ODSWRDY` | Ready at once, since the data sheet has no figure |
//! | `CR` `DBP` | Opens the backup domain |
//! | `CR` `PVDE`, `PLS`; `CSR` `PVDO` | The voltage detector, whose comparator is [`crate::supply`], 5.2.3 |
//! | `CSR` `VOSRDY`, `BRE`, `BRR` | Ready at once |
//!
//! **Left out.** Stop and standby: a deep sleep makes a finding and is an ordinary sleep. The flags of standby and
//! wake-up stay 0.

use cortex_m4::Width;

use crate::gpio::{lane, merge};
use crate::rcc::Supply;

const DBP: u32 = 1 << 8;
const ODEN: u32 = 1 << 16;
const ODSWEN: u32 = 1 << 17;
const VOS: u32 = 3 << 14;

#[derive(Clone, Debug)]
pub(crate) struct Pwr {
    cr: u32,
    csr: u32,
}

impl Pwr {
    pub(crate) fn new() -> Self {
        Self { cr: 0xC000, csr: 0 }
    }

    pub(crate) fn supply(&self) -> Supply {
        let scale = match (self.cr & VOS) >> 14 {
            3 => 1,
            2 => 2,
            _ => 3,
        };
        let over_drive = self.cr & ODEN != 0 && self.cr & ODSWEN != 0;
        Supply { scale, over_drive, backup_writable: self.cr & DBP != 0 }
    }

    pub(crate) fn cr(&self) -> u32 {
        self.cr
    }

    /// Returns the value of a register. `low` is the flag PVDO.
    pub(crate) fn read(&self, offset: u32, width: Width, low: bool) -> u32 {
        let register = match offset >> 2 {
            0 => self.cr,
            1 => {
                let over_drive = self.cr & (ODEN | ODSWEN);
                self.csr | 1 << 14 | u32::from(low) << 2 | over_drive | (self.csr & 1 << 9) >> 6
            }
            _ => 0,
        };
        lane(register, offset, width)
    }

    pub(crate) fn write(&mut self, offset: u32, width: Width, value: u32, pll: bool) {
        match offset >> 2 {
            0 => {
                let mut new = merge(self.cr, offset, width, value) & 0x000F_EFF3;
                if pll || new & VOS == 0 {
                    new = new & !VOS | self.cr & VOS;
                }
                if new & ODEN == 0 {
                    new &= !ODSWEN;
                }
                self.cr = new;
            }
            1 => self.csr = merge(self.csr, offset, width, value) & (1 << 8 | 1 << 9),
            _ => {}
        }
    }
}
