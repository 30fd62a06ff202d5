//! The registers of RCC (RM0090 7.3): what each stores and what a write does.

use super::*;

impl Rcc {
    pub(crate) fn read(&self, offset: u32, width: Width) -> u32 {
        let number = offset >> 2;
        let find = |list: &[u32; 5]| list.iter().position(|&own| own == number);
        let register = match number {
            CR => self.cr,
            PLLCFGR => self.pllcfgr,
            CFGR => self.cfgr & !0xC | self.system << 2,
            CIR => self.cir,
            BDCR => self.bdcr,
            CSR => self.csr,
            0x20 => self.sscgr,
            0x21 => self.plli2scfgr,
            0x22 => self.pllsaicfgr,
            DCKCFGR => self.dckcfgr,
            _ => {
                if let Some(bus) = find(&ENABLES) {
                    self.enables[bus]
                } else if let Some(bus) = find(&RESETS) {
                    self.resets[bus]
                } else if let Some(bus) = find(&LOW_POWER) {
                    self.low_power[bus]
                } else {
                    0
                }
            }
        };
        lane(register, offset, width)
    }

    #[expect(clippy::too_many_arguments, reason = "one access with everything it depends on")]
    pub(crate) fn write(
        &mut self,
        offset: u32,
        width: Width,
        value: u32,
        now: Cycle,
        pc: Option<u32>,
        supply: Supply,
        out: &mut Effects,
    ) {
        let number = offset >> 2;
        let merged = |old: u32| merge(old, offset, width, value);
        let mut find = |kind, text| out.notes.push(Note { kind, at: now, pc, place: "RCC", text, value: None });
        let bus = |list: &[u32; 5]| list.iter().position(|&own| own == number);
        if let Some(bus) = bus(&ENABLES) {
            // A peripheral's clock enable does not change the clock tree.
            self.enables[bus] = merged(self.enables[bus]) & ENABLE_BITS[bus];
            return;
        }
        if let Some(bus) = bus(&RESETS) {
            let new = merged(self.resets[bus]) & RESET_BITS[bus];
            self.reset_bits[bus] |= new & !self.resets[bus];
            self.resets[bus] = new;
            return;
        }
        if let Some(bus) = bus(&LOW_POWER) {
            self.low_power[bus] = merged(self.low_power[bus]) & LOW_POWER_BITS[bus];
            return;
        }
        match number {
            CR => {
                let mut new = merged(self.cr) & WRITABLE | self.cr & READY;
                let by_pll = self.system == 2;
                let by_hse = self.system == 1 || by_pll && self.pllcfgr & PLLSRC != 0;
                // RM0090 7.3.1: the system's clock source cannot be switched off.
                let held = match (by_pll, by_hse) {
                    (true, true) => PLLON | HSEON,
                    (true, false) => PLLON | HSION,
                    (false, true) => HSEON,
                    (false, false) => HSION,
                };
                new |= held;
                // HSEBYP can be written only while HSE is off. Software cannot clear CSSON.
                if self.cr & HSEON != 0 {
                    if (new ^ self.cr) & HSEBYP != 0 {
                        find(FindingKind::Misuse, "HSEBYP is written while HSE is on: it stays");
                    }
                    new = new & !HSEBYP | self.cr & HSEBYP;
                }
                self.cr = new;
            }
            PLLCFGR => {
                let new = merged(self.pllcfgr) & 0x0F43_7FFF | 0x2000_0000;
                if self.cr & PLLON == 0 {
                    self.pllcfgr = new;
                    if self.cr & (PLLI2SON | PLLSAION) != 0 {
                        find(FindingKind::Misuse, "PLLM or PLLSRC is written while another PLL is on");
                    }
                } else if new != self.pllcfgr {
                    find(FindingKind::Misuse, "PLLCFGR is written while the PLL is on: it stays");
                }
            }
            CFGR => self.cfgr = merged(self.cfgr) & 0xFFFF_FCF3,
            CIR => {
                let new = merged(self.cir);
                self.cir = new & 0x7F00 | self.cir & 0xFF & !(new >> 16);
                return;
            }
            BDCR => {
                if !supply.backup_writable {
                    find(FindingKind::Refused, "BDCR is written while PWR_CR.DBP protects the backup domain");
                    return;
                }
                let new = merged(self.bdcr);
                if new & BDRST != 0 {
                    self.backup_reset |= self.bdcr & BDRST == 0;
                    self.bdcr = BDRST;
                } else {
                    let select = if self.bdcr & RTCSEL != 0 { self.bdcr & RTCSEL } else { new & RTCSEL };
                    self.bdcr = new & (LSEON | 4 | RTCEN) | select | self.bdcr & LSERDY;
                }
            }
            CSR => {
                let new = merged(self.csr);
                self.csr = self.csr & !LSION | new & LSION;
                if new & RMVF != 0 {
                    self.csr &= !0xFE00_0000;
                }
            }
            0x20 => {
                self.sscgr = merged(self.sscgr) & 0xCFFF_FFFF;
                if self.sscgr >> 31 != 0 {
                    find(FindingKind::Unmodelled, "spread spectrum has no effect here");
                }
            }
            0x21 if self.cr & PLLI2SON == 0 => self.plli2scfgr = merged(self.plli2scfgr) & 0x7F00_7FC0,
            0x22 if self.cr & PLLSAION == 0 => self.pllsaicfgr = merged(self.pllsaicfgr) & 0x7F03_7FC0,
            0x21 | 0x22 => find(FindingKind::Misuse, "a PLL's configuration is written while it is on: it stays"),
            DCKCFGR => self.dckcfgr = merged(self.dckcfgr) & 0x01F3_1F1F,
            _ => return,
        }
        self.start(now);
        if self.cr & PLLON != 0 && self.cr & PLLRDY == 0 && self.ready_at[PLL] == NEVER {
            out.notes.push(Note {
                kind: FindingKind::Misuse,
                at: now,
                pc,
                place: "RCC",
                text: "the PLL is on but has no source or is out of its limits, and never locks; PLLCFGR",
                value: Some(self.pllcfgr),
            });
        }
        self.settle(now, pc, supply, out);
    }
}
