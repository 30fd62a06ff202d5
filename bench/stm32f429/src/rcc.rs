//! Reset and clock control, RM0090 chapter 7.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `CR` | HSI, HSE, PLL, PLLI2S, PLLSAI with their start-up times; what clocks the system cannot be switched off |
//! | `PLLCFGR`, `PLLI2SCFGR`, `PLLSAICFGR` | Kept while the PLL is on. Outside its limits a PLL never gets ready |
//! | `CFGR` `SW`, `SWS` | The switch waits until the source is ready, 7.2.6 |
//! | `CFGR`, `DCKCFGR` prescalers | HCLK, PCLK1, PCLK2 and the timers' clocks with `TIMPRE`, 7.2 |
//! | `CIR` | Ready flags with their enables; `CSSF`, which is the NMI, 7.2.7 |
//! | Enables, resets, low-power enables | As 7.3.5 to 7.3.19 |
//! | `BDCR` | Behind `PWR_CR.DBP`; `RTCSEL` once until `BDRST`, 7.3.20 |
//! | `CSR` | LSI and the reset flags, 7.3.21 |
//!
//! Limits of the data sheet that are exceeded without the part noticing make findings: HCLK over what the voltage
//! scale and over-drive allow, PCLK1 and PCLK2 over theirs (DS9405, general operating conditions).
//!
//! **Left out.** Spread spectrum (`SSCGR`) and low-power enables keep what is written. The MCO pins do not toggle,
//! which is a finding when `CFGR` is written while one is connected. Accesses within the two clocks after a
//! peripheral's clock was enabled (ES0206 2.2.7) work. How long the clock security system takes to detect a failure: no
//! time.

use bench_seam::{Cycle, FindingKind, NEVER, Reset};
use cortex_m4::Width;

use crate::Oscillators;
use crate::cx::{Clocks, Effects, Note, Ratio};
use crate::gpio::{lane, merge};

const HSION: u32 = 1 << 0;
const HSIRDY: u32 = 1 << 1;
const HSEON: u32 = 1 << 16;
const HSERDY: u32 = 1 << 17;
const HSEBYP: u32 = 1 << 18;
const CSSON: u32 = 1 << 19;
const PLLON: u32 = 1 << 24;
const PLLRDY: u32 = 1 << 25;
const PLLI2SON: u32 = 1 << 26;
const PLLI2SRDY: u32 = 1 << 27;
const PLLSAION: u32 = 1 << 28;
const PLLSAIRDY: u32 = 1 << 29;
const READY: u32 = HSIRDY | HSERDY | PLLRDY | PLLI2SRDY | PLLSAIRDY;
const WRITABLE: u32 = HSION | 0xF8 | HSEON | HSEBYP | CSSON | PLLON | PLLI2SON | PLLSAION;
const PLLSRC: u32 = 1 << 22;

const CSSF: u32 = 1 << 7;

/// `CSR`: LSI and the reset flags.
const LSION: u32 = 1 << 0;
const LSIRDY: u32 = 1 << 1;
const RMVF: u32 = 1 << 24;
const BORRSTF: u32 = 1 << 25;
const PINRSTF: u32 = 1 << 26;
const PORRSTF: u32 = 1 << 27;
const SFTRSTF: u32 = 1 << 28;
const IWDGRSTF: u32 = 1 << 29;
const WWDGRSTF: u32 = 1 << 30;
const LPWRRSTF: u32 = 1 << 31;

/// `BDCR`.
const LSEON: u32 = 1 << 0;
const LSERDY: u32 = 1 << 1;
const BDRST: u32 = 1 << 16;
const RTCSEL: u32 = 3 << 8;
const RTCEN: u32 = 1 << 15;

/// What starts, in the order of the flags in `CIR`.
const LSI: usize = 0;
const LSE: usize = 1;
const HSI: usize = 2;
const HSE: usize = 3;
const PLL: usize = 4;
const PLLI2S: usize = 5;
const PLLSAI: usize = 6;

/// Start-up times in nanoseconds, DS9405: LSI at most 40 µs; LSE 2 s typical; HSI at most 4 µs; HSE with a crystal 2 ms
/// typical; the PLLs 75 µs to 300 µs, of which 200 µs are taken.
const START_NS: [u64; 7] = [40_000, 2_000_000_000, 4_000, 2_000_000, 200_000, 200_000, 200_000];
/// HSE in bypass: RM0090 says only that HSERDY falls after six cycles; so many are taken for its rise too.
const BYPASS_TICKS: u64 = 6;

/// LSE on the NUCLEO: a 32.768 kHz crystal.
const LSE_HZ: u64 = 32_768;

const GIGA: i64 = 1_000_000_000;

/// Register numbers by offset / 4.
const CR: u32 = 0;
const PLLCFGR: u32 = 1;
const CFGR: u32 = 2;
const CIR: u32 = 3;
/// Where CFGR is, which selects what the MCO pins carry.
pub(crate) const CFGR_OFFSET: u32 = 4 * CFGR;
const BDCR: u32 = 0x70 / 4;
const CSR: u32 = 0x74 / 4;
const DCKCFGR: u32 = 0x8C / 4;

/// Reset registers, enable registers and low-power enable registers of AHB1, AHB2, AHB3, APB1, APB2: offset / 4.
const RESETS: [u32; 5] = [0x10 / 4, 0x14 / 4, 0x18 / 4, 0x20 / 4, 0x24 / 4];
const ENABLES: [u32; 5] = [0x30 / 4, 0x34 / 4, 0x38 / 4, 0x40 / 4, 0x44 / 4];
const LOW_POWER: [u32; 5] = [0x50 / 4, 0x54 / 4, 0x58 / 4, 0x60 / 4, 0x64 / 4];
/// The bits that there are, 7.3.5 to 7.3.14.
const RESET_BITS: [u32; 5] = [0x22E0_17FF, 0x0000_00F1, 1, 0xF6FE_C9FF, 0x0477_7933];
const ENABLE_BITS: [u32; 5] = [0x7EF4_17FF, 0x0000_00F1, 1, 0xF6FE_C9FF, 0x0477_7F33];
const LOW_POWER_BITS: [u32; 5] = [0x7EF7_97FF, 0x0000_00F1, 1, 0xF6FE_C9FF, 0x0477_7F33];
const ENABLES_AFTER_RESET: [u32; 5] = [0x0010_0000, 0, 0, 0, 0];
const LOW_POWER_AFTER_RESET: [u32; 5] = [0x7E67_97FF, 0x0000_00F1, 1, 0xF6FE_C9FF, 0x0477_7F33];

/// Which bus register and bit gates a peripheral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Gate {
    /// 0 AHB1, 1 AHB2, 2 AHB3, 3 APB1, 4 APB2.
    pub(crate) bus: u8,
    pub(crate) bit: u8,
}

/// A rate in hertz, as an exact fraction.
#[derive(Clone, Copy, Debug)]
struct Rate {
    num: u128,
    den: u128,
    /// Nominal, rounded down, and the error of its source.
    hz: u64,
    ppb: i64,
}

impl Rate {
    fn of(hz: u64, ppb: i64) -> Self {
        let scale = GIGA.saturating_add(ppb).max(1).unsigned_abs();
        Self { num: u128::from(hz) * u128::from(scale), den: u128::from(GIGA.unsigned_abs()), hz, ppb }
    }

    /// Times `times`, over `over`.
    fn scaled(self, times: u64, over: u64) -> Self {
        let over = over.max(1);
        Self {
            num: self.num * u128::from(times),
            den: self.den * u128::from(over),
            hz: self.hz * times / over,
            ppb: self.ppb,
        }
    }

    /// How many cycles of `hclk` one tick of this takes.
    fn period_in(self, hclk: Self) -> Ratio {
        // Every factor is small: at most 2^28 Hz, 2^31 parts per billion, a 2^9 multiplier and 2^16 of dividers each.
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

/// What else the clocks depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Supply {
    /// `PWR_CR.VOS`: 1 to 3.
    pub(crate) scale: u8,
    /// Over-drive is on and switched to.
    pub(crate) over_drive: bool,
    /// `PWR_CR.DBP`.
    pub(crate) backup_writable: bool,
}

/// Reset and clock control.
#[derive(Clone, Debug)]
pub(crate) struct Rcc {
    oscillators: Oscillators,
    /// OSC_IN carries a clock.
    hse_there: bool,
    cr: u32,
    pllcfgr: u32,
    cfgr: u32,
    cir: u32,
    resets: [u32; 5],
    enables: [u32; 5],
    low_power: [u32; 5],
    bdcr: u32,
    csr: u32,
    sscgr: u32,
    plli2scfgr: u32,
    pllsaicfgr: u32,
    dckcfgr: u32,
    /// SWS: what clocks the system.
    system: u32,
    /// When each of what starts will be ready.
    ready_at: [Cycle; 7],
    /// The independent watchdog keeps LSI on.
    lsi_forced: bool,
    /// The system's clock source has failed without the security system: nothing moves.
    pub(crate) stopped: bool,
    pub(crate) clocks: Clocks,
    /// The clocks changed since the part looked.
    pub(crate) clocks_changed: bool,
    /// Reset bits that rose since the part looked.
    pub(crate) reset_bits: [u32; 5],
    /// The backup domain was reset since the part looked.
    pub(crate) backup_reset: bool,
    /// HSE failed under the security system since the part looked.
    pub(crate) failure: bool,
}

impl Rcc {
    pub(crate) fn new(oscillators: Oscillators) -> Self {
        let mut rcc = Self {
            oscillators,
            hse_there: oscillators.hse_hz.is_some(),
            cr: 0x83,
            pllcfgr: 0x2400_3010,
            cfgr: 0,
            cir: 0,
            resets: [0; 5],
            enables: ENABLES_AFTER_RESET,
            low_power: LOW_POWER_AFTER_RESET,
            bdcr: 0,
            csr: PORRSTF | BORRSTF | PINRSTF,
            sscgr: 0,
            plli2scfgr: 0x2400_3000,
            pllsaicfgr: 0x2400_3000,
            dckcfgr: 0,
            system: 0,
            ready_at: [NEVER; 7],
            lsi_forced: false,
            stopped: false,
            clocks: Clocks::AFTER_RESET,
            clocks_changed: true,
            reset_bits: [0; 5],
            backup_reset: false,
            failure: false,
        };
        rcc.clocks = rcc.tree().unwrap_or(Clocks::AFTER_RESET);
        rcc
    }

    /// A system reset by `cause`.
    pub(crate) fn reset(&mut self, cause: Reset) {
        let mut fresh = Self::new(self.oscillators);
        fresh.hse_there = self.hse_there;
        let (flags, keep) = match cause {
            Reset::PowerOn => (PORRSTF | BORRSTF | PINRSTF, false),
            Reset::BrownOut => (BORRSTF | PINRSTF, true),
            Reset::Pin | Reset::Lockup => (PINRSTF, true),
            Reset::Watchdog("WWDG") => (WWDGRSTF | PINRSTF, true),
            Reset::Watchdog(_) => (IWDGRSTF | PINRSTF, true),
            Reset::Software => (SFTRSTF | PINRSTF, true),
            Reset::Wakeup(_) => (LPWRRSTF | PINRSTF, true),
        };
        fresh.csr = flags;
        if keep {
            // The flags are reset by power alone, 7.3.21; the backup domain is another domain, 7.1.3.
            fresh.csr |= self.csr & 0xFE00_0000;
            fresh.bdcr = self.bdcr;
            fresh.ready_at[LSE] = self.ready_at[LSE];
        }
        if cause == Reset::BrownOut {
            fresh.csr = flags;
        }
        fresh.clocks = fresh.tree().unwrap_or(Clocks::AFTER_RESET);
        *self = fresh;
    }

    pub(crate) fn due(&self) -> Cycle {
        self.ready_at.iter().copied().min().unwrap_or(NEVER)
    }

    /// RCC's interrupt.
    pub(crate) fn irq(&self) -> bool {
        self.cir & self.cir >> 8 & 0x7F != 0
    }

    /// The clock security system's, 7.2.7.
    pub(crate) fn nmi(&self) -> bool {
        self.cir & CSSF != 0
    }

    pub(crate) fn has_hse(&self) -> bool {
        self.hse_there
    }

    /// The independent watchdog was started: it keeps LSI on, 21.3.
    pub(crate) fn force_lsi(&mut self, now: Cycle) {
        self.lsi_forced = true;
        if self.csr & LSIRDY == 0 && self.ready_at[LSI] == NEVER {
            self.ready_at[LSI] = now + self.after(START_NS[LSI]);
        }
    }

    /// Whether the clock of what `gate` gates is on and its reset is not held.
    #[inline]
    pub(crate) fn is_on(&self, gate: Gate) -> bool {
        let bus = usize::from(gate.bus);
        (self.enables[bus] & !self.resets[bus]) >> gate.bit & 1 != 0
    }

    /// Core cycles of `ns`.
    fn after(&self, ns: u64) -> Cycle {
        (ns.saturating_mul(self.clocks.hclk_hz / 1000) / 1_000_000).max(1)
    }

    /// The rate of HSI, HSE, of the main PLL's VCO input.
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

    /// The VCO of the PLL with this `N` and this lower limit of N, if it locks.
    fn vco(&self, config: u32) -> Option<Rate> {
        let input = self.pll_input()?;
        let times = config >> 6 & 0x1FF;
        let vco = input.scaled(u64::from(times), 1);
        let divides = self.pllcfgr & 0x3F >= 2 && (50..=432).contains(&times);
        // DS9405, characteristics of the main PLL: input 0.95 MHz to 2.1 MHz, VCO 100 MHz to 432 MHz.
        let runs = (950_000..=2_100_000).contains(&input.hz) && (100_000_000..=432_000_000).contains(&vco.hz);
        (divides && runs).then_some(vco)
    }

    /// What drives SYSCLK with SWS as `system`.
    fn system_rate(&self, system: u32) -> Option<Rate> {
        match system {
            0 => self.source(false),
            1 => self.source(true),
            _ => Some(self.vco(self.pllcfgr)?.scaled(1, 2 * u64::from((self.pllcfgr >> 16 & 3) + 1))),
        }
    }

    /// The clock tree as the registers have it; `None` where the core has no clock.
    fn tree(&self) -> Option<Clocks> {
        let ahb = match self.cfgr >> 4 & 0xF {
            small @ 8..=11 => 2_u64 << (small - 8),
            large @ 12.. => 64_u64 << (large - 12),
            _ => 1,
        };
        let apb = |code: u32| if code & 4 != 0 { 2_u32 << (code & 3) } else { 1 };
        let (pclk1, pclk2) = (apb(self.cfgr >> 10 & 7), apb(self.cfgr >> 13 & 7));
        // 7.2: with TIMPRE the timers run at HCLK up to a divider of 4 and at 4 times PCLK above, else at HCLK
        // undivided and at 2 times PCLK divided.
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
        // 7.3.2 calls 0 and 1 wrong and does not say what comes out; the RNG runs with 0. Assumed: the slowest.
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

    /// Switches the system over where it waits for it, and takes the tree anew.
    fn settle(&mut self, now: Cycle, pc: Option<u32>, supply: Supply, out: &mut Effects) {
        let wanted = self.cfgr & 3;
        let ready = match wanted {
            0 => self.cr & HSIRDY != 0,
            1 => self.cr & HSERDY != 0,
            2 => self.cr & PLLRDY != 0,
            // "Not allowed", 7.3.3: the switch does not take it.
            _ => false,
        };
        if ready {
            self.system = wanted;
        }
        let old = self.clocks;
        match self.tree() {
            Some(clocks) => {
                self.clocks_changed |= self.stopped;
                self.stopped = false;
                self.clocks = clocks;
            }
            None => {
                self.clocks_changed |= !self.stopped;
                self.stopped = true;
            }
        }
        if self.clocks != old {
            self.clocks_changed = true;
            if self.clocks.hclk_hz != old.hclk_hz {
                for at in &mut self.ready_at {
                    if *at != NEVER {
                        let left = u128::from(at.saturating_sub(now)) * u128::from(self.clocks.hclk_hz);
                        *at = now + (left / u128::from(old.hclk_hz)) as u64 + 1;
                    }
                }
            }
        }
        self.check_limits(now, pc, supply, out);
    }

    /// DS9405, general operating conditions, for 2.7 V to 3.6 V.
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

    /// What is switched on and not ready begins to start; what is off or has no source is not ready.
    fn start(&mut self, now: Cycle) {
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

    /// Everything that is ready by `now`.
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
            // "Set by hardware when ... becomes stable and the enable is set", 7.3.4.
            self.cir |= (self.cir >> 8 & 1 << which) & 0x7F;
        }
        if any {
            self.start(now);
            self.settle(now, None, supply, out);
        }
    }

    /// OSC_IN goes silent.
    pub(crate) fn fail_hse(&mut self, now: Cycle, supply: Supply, out: &mut Effects) {
        if !std::mem::replace(&mut self.hse_there, false) {
            return;
        }
        let was_ready = self.cr & HSERDY != 0;
        if was_ready && self.cr & CSSON != 0 {
            let by_hse = self.system == 1 || self.system == 2 && self.pllcfgr & PLLSRC != 0;
            self.cr &= !(HSEON | HSERDY);
            if by_hse {
                // 7.2.7: the system goes to HSI, and the PLL, if HSE drives it and it is used, is switched off.
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

    /// OSC_IN carries a clock (again).
    pub(crate) fn restore_hse(&mut self, now: Cycle, supply: Supply, out: &mut Effects) {
        if self.oscillators.hse_hz.is_none() {
            self.oscillators.hse_hz = Some(8_000_000);
        }
        self.hse_there = true;
        if self.stopped && self.system != 0 {
            // What stood still goes on.
            self.cr |= HSERDY;
            if self.system == 2 {
                self.cr |= PLLRDY;
            }
        }
        self.start(now);
        self.settle(now, None, supply, out);
    }

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
            // Gates change nothing else: no need to look at the tree.
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
                // What clocks the system cannot be switched off, 7.3.1.
                let held = match (by_pll, by_hse) {
                    (true, true) => PLLON | HSEON,
                    (true, false) => PLLON | HSION,
                    (false, true) => HSEON,
                    (false, false) => HSION,
                };
                new |= held;
                // HSEBYP can be written only while HSE is off; CSSON is cleared by a reset (or a failure) alone.
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
