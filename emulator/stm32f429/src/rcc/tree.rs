//! The clock tree: the rates of each oscillator, PLL and bus, and the limits of the data sheet (RM0090 7.2, DS9405
//! general operating conditions).

use super::*;

impl Rate {
    fn of(hz: u64, ppb: i64) -> Self {
        let scale = GIGA.saturating_add(ppb).max(1).unsigned_abs();
        Self { num: u128::from(hz) * u128::from(scale), den: u128::from(GIGA.unsigned_abs()), hz, ppb }
    }

    fn scaled(self, times: u64, over: u64) -> Self {
        let over = over.max(1);
        Self {
            num: self.num * u128::from(times),
            den: self.den * u128::from(over),
            hz: self.hz * times / over,
            ppb: self.ppb,
        }
    }

    /// Returns the number of cycles of `hclk` in one tick of this clock.
    fn period_in(self, hclk: Self) -> Ratio {
        // The products fit, because all factors are small: at most 2^28 Hz, 2^31 parts per billion, a multiplier of 2^9
        // and dividers of 2^16.
        let reduce = |rate: Self| {
            let common = gcd(rate.num, rate.den);
            (rate.num / common, rate.den / common)
        };
        let ((own_num, own_den), (num, den)) = (reduce(self), reduce(hclk));
        Ratio::new(num * own_den, den * own_num)
    }
}

fn gcd(mut a: u128, mut b: u128) -> u128 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a.max(1)
}

impl Rcc {
    /// The rate of HSE (`hse`) or HSI; `None` if HSE does not run.
    fn source(&self, hse: bool) -> Option<Rate> {
        if hse {
            let hz = self.oscillators.hse_hz?;
            (self.hse_there && self.cr & HSEON != 0).then(|| Rate::of(hz, self.oscillators.hse_ppb))
        } else {
            Some(Rate::of(16_000_000, self.oscillators.hsi_ppb))
        }
    }

    fn pll_input(&self) -> Option<Rate> {
        Some(self.source(self.pllcfgr & PLLSRC != 0)?.scaled(1, u64::from(self.pllcfgr & 0x3F)))
    }

    /// Returns the rate of a PLL's VCO in this configuration; `None` if the PLL does not lock.
    pub(super) fn vco(&self, config: u32) -> Option<Rate> {
        let input = self.pll_input()?;
        let times = config >> 6 & 0x1FF;
        let vco = input.scaled(u64::from(times), 1);
        let divides = self.pllcfgr & 0x3F >= 2 && (50..=432).contains(&times);
        // DS9405 (characteristics of the main PLL): the input needs 0.95 MHz to 2.1 MHz, the VCO 100 MHz to 432 MHz.
        let runs = (950_000..=2_100_000).contains(&input.hz) && (100_000_000..=432_000_000).contains(&vco.hz);
        (divides && runs).then_some(vco)
    }

    fn system_rate(&self, system: u32) -> Option<Rate> {
        match system {
            0 => self.source(false),
            1 => self.source(true),
            _ => Some(self.vco(self.pllcfgr)?.scaled(1, 2 * u64::from((self.pllcfgr >> 16 & 3) + 1))),
        }
    }

    pub(super) fn tree(&self) -> Option<Clocks> {
        let ahb = match self.cfgr >> 4 & 0xF {
            small @ 8..=11 => 2_u64 << (small - 8),
            large @ 12.. => 64_u64 << (large - 12),
            _ => 1,
        };
        let apb = |code: u32| if code & 4 != 0 { 2_u32 << (code & 3) } else { 1 };
        let (pclk1, pclk2) = (apb(self.cfgr >> 10 & 7), apb(self.cfgr >> 13 & 7));
        // RM0090 7.2: with TIMPRE the timers run at HCLK up to an APB divider of 4, else at 4 times PCLK. Without
        // TIMPRE they run at HCLK for divider 1, else at 2 times PCLK.
        let timer = |apb: u32| if self.dckcfgr >> 24 & 1 != 0 { apb.div_ceil(4) } else { apb.div_ceil(2) };
        let hclk = self.system_rate(self.system)?.scaled(1, ahb);
        if hclk.num == 0 {
            return None;
        }
        let of = |rate: Option<Rate>| rate.filter(|rate| rate.num > 0).map_or(Ratio::STOPPED, |r| r.period_in(hclk));
        let lsi = Rate::of(self.oscillators.lsi_hz, 0);
        let lse = (self.bdcr & LSERDY != 0).then(|| Rate::of(LSE_HZ, 0));
        let hse = if self.cr & HSERDY != 0 { self.source(true) } else { None };
        let rtcpre = u64::from(self.cfgr >> 16 & 0x1F);
        let rtc = match (self.bdcr & RTCSEL) >> 8 {
            1 => lse,
            2 => (self.csr & LSIRDY != 0).then_some(lsi),
            3 if rtcpre >= 2 => hse.map(|hse| hse.scaled(1, rtcpre)),
            _ => None,
        };
        let rtc = rtc.filter(|_| self.bdcr & RTCEN != 0);
        let q = u64::from(self.pllcfgr >> 24 & 0xF);
        // RM0090 7.3.2 calls 0 and 1 wrong and does not state the output, but the RNG runs with 0. The model takes the
        // slowest rate.
        let pll48_undefined = q < 2;
        let q = if pll48_undefined { 16 } else { q };
        let pll48 = self.vco(self.pllcfgr).filter(|_| self.cr & PLLRDY != 0).map(|vco| vco.scaled(1, q));
        let r = u64::from(self.plli2scfgr >> 28 & 7);
        let i2s = self.vco(self.plli2scfgr).filter(|_| self.cr & PLLI2SRDY != 0 && r >= 2 && self.cfgr >> 23 & 1 == 0);
        Some(Clocks {
            hclk_hz: hclk.hz.max(1),
            ppb: hclk.ppb,
            pclk1,
            pclk2,
            tim1: timer(pclk1),
            tim2: timer(pclk2),
            lsi: of(Some(lsi)),
            lse: of(lse),
            hse: of(hse),
            rtc: of(rtc),
            pll48: of(pll48),
            pll48_hz: pll48.map_or(0, |rate| rate.hz),
            pll48_undefined,
            i2s: of(i2s.map(|vco| vco.scaled(1, r))),
        })
    }

    /// Reports clocks beyond DS9405's limits (general operating conditions) for 2.7 V to 3.6 V.
    pub(crate) fn check_limits(&self, now: Cycle, pc: Option<u32>, supply: Supply, out: &mut Effects) {
        let most = match (supply.scale, supply.over_drive) {
            (1, false) => 168_000_000,
            (1, true) => 180_000_000,
            (2, false) => 144_000_000,
            (2, true) => 168_000_000,
            _ => 120_000_000,
        };
        let mut find = |text, hz: u64| {
            out.notes.push(Note { kind: FindingKind::Misuse, at: now, pc, place: "RCC", text, value: Some(hz as u32) });
        };
        let (apb1, apb2) = if supply.over_drive { (45_000_000, 90_000_000) } else { (42_000_000, 84_000_000) };
        if self.clocks.hclk_hz > most {
            find("HCLK is faster than the voltage scale and over-drive allow, Hz", self.clocks.hclk_hz);
        }
        if self.clocks.pclk1_hz() > apb1 {
            find("PCLK1 is faster than the part allows, Hz", self.clocks.pclk1_hz());
        }
        if self.clocks.pclk2_hz() > apb2 {
            find("PCLK2 is faster than the part allows, Hz", self.clocks.pclk2_hz());
        }
    }
}
