//! Oscillators and PLLs: how they start, become ready, fail and return; the clock security system (RM0090 7.2.1 to
//! 7.2.7).

use super::*;

impl Rcc {
    /// Starts LSI for the independent watchdog, which keeps it on (RM0090 21.3).
    pub(crate) fn force_lsi(&mut self, now: Cycle) {
        self.lsi_forced = true;
        if self.csr & LSIRDY == 0 && self.ready_at[LSI] == NEVER {
            self.ready_at[LSI] = now + self.after(START_NS[LSI]);
        }
    }

    fn after(&self, ns: u64) -> Cycle {
        (ns.saturating_mul(self.clocks.hclk_hz / 1000) / 1_000_000).max(1)
    }

    pub(super) fn start(&mut self, now: Cycle) {
        let hse_source = self.hse_there && self.cr & HSEON != 0;
        let pll_source = if self.pllcfgr & PLLSRC != 0 { self.cr & HSERDY != 0 } else { self.cr & HSIRDY != 0 };
        let bypass = self.cr & HSEBYP != 0;
        let locks = |rcc: &Self, config| pll_source && rcc.vco(config).is_some();
        let main = locks(self, self.pllcfgr);
        let (i2s, sai) = (locks(self, self.plli2scfgr), locks(self, self.pllsaicfgr));
        let hse_time = if bypass {
            let hz = self.oscillators.hse_hz.unwrap_or(1).max(1);
            (BYPASS_TICKS * self.clocks.hclk_hz).div_ceil(hz)
        } else {
            self.after(START_NS[HSE])
        };
        let list = [
            (HSI, HSION, HSIRDY, true, self.after(START_NS[HSI])),
            (HSE, HSEON, HSERDY, hse_source, hse_time),
            (PLL, PLLON, PLLRDY, main, self.after(START_NS[PLL])),
            (PLLI2S, PLLI2SON, PLLI2SRDY, i2s, self.after(START_NS[PLLI2S])),
            (PLLSAI, PLLSAION, PLLSAIRDY, sai, self.after(START_NS[PLLSAI])),
        ];
        for (which, on, ready, source, time) in list {
            if self.cr & on == 0 || !source {
                self.cr &= !ready;
                self.ready_at[which] = NEVER;
            } else if self.cr & ready == 0 && self.ready_at[which] == NEVER {
                self.ready_at[which] = now + time;
            }
        }
        if self.csr & LSION == 0 && !self.lsi_forced {
            self.csr &= !LSIRDY;
            self.ready_at[LSI] = NEVER;
        } else if self.csr & LSIRDY == 0 && self.ready_at[LSI] == NEVER {
            self.ready_at[LSI] = now + self.after(START_NS[LSI]);
        }
        if self.bdcr & LSEON == 0 {
            self.bdcr &= !LSERDY;
            self.ready_at[LSE] = NEVER;
        } else if self.bdcr & LSERDY == 0 && self.ready_at[LSE] == NEVER {
            self.ready_at[LSE] = now + self.after(START_NS[LSE]);
        }
    }

    /// Makes every clock source ready whose start-up time is over.
    pub(crate) fn advance(&mut self, now: Cycle, supply: Supply, out: &mut Effects) {
        let mut any = false;
        for which in 0..self.ready_at.len() {
            if self.ready_at[which] > now {
                continue;
            }
            any = true;
            self.ready_at[which] = NEVER;
            match which {
                LSI => self.csr |= LSIRDY,
                LSE => self.bdcr |= LSERDY,
                HSI => self.cr |= HSIRDY,
                HSE => self.cr |= HSERDY,
                PLL => self.cr |= PLLRDY,
                PLLI2S => self.cr |= PLLI2SRDY,
                _ => self.cr |= PLLSAIRDY,
            }
            // The flag in CIR follows 7.3.4: "set by hardware when ... becomes stable and the enable is set".
            self.cir |= (self.cir >> 8 & 1 << which) & 0x7F;
        }
        if any {
            self.start(now);
            self.settle(now, None, supply, out);
        }
    }

    pub(crate) fn fail_hse(&mut self, now: Cycle, supply: Supply, out: &mut Effects) {
        if !std::mem::replace(&mut self.hse_there, false) {
            return;
        }
        let was_ready = self.cr & HSERDY != 0;
        if was_ready && self.cr & CSSON != 0 {
            let by_hse = self.system == 1 || self.system == 2 && self.pllcfgr & PLLSRC != 0;
            self.cr &= !(HSEON | HSERDY);
            if by_hse {
                // The system switches to HSI (RM0090 7.2.7). The PLL is switched off if HSE drives it and the system
                // uses it.
                self.cr |= HSION | HSIRDY;
                if self.system == 2 {
                    self.cr &= !(PLLON | PLLRDY);
                }
                self.cfgr &= !3;
                self.system = 0;
            }
            self.cir |= CSSF;
            self.failure = true;
        }
        self.start(now);
        self.settle(now, None, supply, out);
    }

    pub(crate) fn drift_hse(&mut self, now: Cycle, ppb: i64, supply: Supply, out: &mut Effects) {
        self.oscillators.hse_ppb += ppb;
        self.settle(now, None, supply, out);
    }

    pub(crate) fn restore_hse(&mut self, now: Cycle, supply: Supply, out: &mut Effects) {
        if self.oscillators.hse_hz.is_none() {
            self.oscillators.hse_hz = Some(8_000_000);
        }
        self.hse_there = true;
        if self.stopped && self.system != 0 {
            // The system stood still because HSE had failed, and runs again.
            self.cr |= HSERDY;
            if self.system == 2 {
                self.cr |= PLLRDY;
            }
        }
        self.start(now);
        self.settle(now, None, supply, out);
    }
}
