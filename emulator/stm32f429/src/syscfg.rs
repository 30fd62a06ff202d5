//! The system configuration controller, RM0090 chapter 9.
//!
//! | Register | Behaviour |
//! |---|---|
//! | `MEMRMP` | `MEM_MODE` maps flash, system memory or SRAM1 to address 0; that of the FMC makes a finding |
//! | `PMC` | Keeps the written value; `MII_RMII_SEL` makes a finding |
//! | `EXTICR1` to `4` | The port whose pin each EXTI line listens to |
//! | `CMPCR` | The compensation cell is ready at once |

use cortex_m4::Width;

use crate::gpio::{lane, merge};

#[derive(Clone, Debug, Default)]
pub(crate) struct Syscfg {
    memrmp: u32,
    pmc: u32,
    exticr: [u32; 4],
    cmpcr: u32,
}

impl Syscfg {
    /// The port (0 is A) of `line`. Codes past port K select no pin.
    pub(crate) fn port_of(&self, line: usize) -> usize {
        (self.exticr[line / 4] >> (4 * (line % 4)) & 0xF) as usize
    }

    /// The memory at address 0: 0 is flash, 1 system memory, 2 FMC bank 1, 3 SRAM1, 4 FMC SDRAM bank 1.
    pub(crate) fn memory_mode(&self) -> u32 {
        self.memrmp & 7
    }

    pub(crate) fn read(&self, offset: u32, width: Width) -> u32 {
        let register = match offset >> 2 {
            0 => self.memrmp,
            1 => self.pmc,
            nth @ 2..=5 => self.exticr[nth as usize - 2],
            8 => self.cmpcr | (self.cmpcr & 1) << 8,
            _ => 0,
        };
        lane(register, offset, width)
    }

    /// Writes a register. If the setting is not modelled, returns what is missing.
    pub(crate) fn write(&mut self, offset: u32, width: Width, value: u32) -> Option<&'static str> {
        let merged = |old: u32| merge(old, offset, width, value);
        match offset >> 2 {
            0 => {
                self.memrmp = merged(self.memrmp) & 0xF07;
                if self.memrmp & 0xF00 != 0 || !matches!(self.memrmp & 7, 0 | 1 | 3) {
                    return Some("MEMRMP: FB_MODE, SWP_FMC and the FMC at address 0 are not modelled");
                }
            }
            1 => {
                self.pmc = merged(self.pmc) & 0x0087_0000;
                if self.pmc & 1 << 23 != 0 {
                    return Some("PMC: the Ethernet interface is not modelled");
                }
            }
            nth @ 2..=5 => {
                let register = &mut self.exticr[nth as usize - 2];
                *register = merged(*register) & 0xFFFF;
            }
            8 => self.cmpcr = merged(self.cmpcr) & 1,
            _ => {}
        }
        None
    }
}
