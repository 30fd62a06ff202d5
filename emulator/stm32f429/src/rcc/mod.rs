//! Reset and clock control, RM0090 chapter 7.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `CR` | HSI, HSE, PLL, PLLI2S, PLLSAI with start-up times; the system's clock source cannot be switched off |
//! | `PLLCFGR`, `PLLI2SCFGR`, `PLLSAICFGR` | Fixed while the PLL is on; outside its limits a PLL never becomes ready |
//! | `CFGR` `SW`, `SWS` | The switch waits until the source is ready, 7.2.6 |
//! | `CFGR`, `DCKCFGR` prescalers | HCLK, PCLK1, PCLK2 and the timers' clocks with `TIMPRE`, 7.2 |
//! | `CIR` | The ready flags with their enable bits; `CSSF`, which is the NMI, 7.2.7 |
//! | Enables, resets, low-power enables | As in 7.3.5 to 7.3.19 |
//! | `BDCR` | Writable with `PWR_CR.DBP` only; `RTCSEL` can be set once until `BDRST`, 7.3.20 |
//! | `CSR` | LSI and the reset flags, 7.3.21 |
//!
//! `registers` handles accesses, `oscillators` the start and failure of clock sources, and `tree` the frequencies.
//!
//! A rate beyond a limit of DS9405 (general operating conditions) works and makes a finding: HCLK over the limit of
//! voltage scale and over-drive, PCLK1 or PCLK2 over its limit.
//!
//! **Left out.** Spread spectrum (`SSCGR`) and low-power enables have no effect. The MCO pins do not toggle; a write of
//! `CFGR` while one is connected makes a finding. Accesses within two clocks after a peripheral's clock was enabled
//! (ES0206 2.2.7) work. The clock security system detects a failure at once.

mod oscillators;
mod registers;
mod tree;

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, NEVER, Reset};

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

/// Bits of `CSR` for LSI, and the reset flags.
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

/// Bits of `BDCR`.
const LSEON: u32 = 1 << 0;
const LSERDY: u32 = 1 << 1;
const BDRST: u32 = 1 << 16;
const RTCSEL: u32 = 3 << 8;
const RTCEN: u32 = 1 << 15;

/// The numbers of the oscillators and PLLs, in the order of their flags in `CIR`.
const LSI: usize = 0;
const LSE: usize = 1;
const HSI: usize = 2;
const HSE: usize = 3;
const PLL: usize = 4;
const PLLI2S: usize = 5;
const PLLSAI: usize = 6;

/// The start-up times in nanoseconds (DS9405): LSI at most 40 µs, LSE 2 s typical, HSI at most 4 µs, HSE with a crystal
/// 2 ms typical, PLLs 75 µs to 300 µs (taken as 200 µs).
const START_NS: [u64; 7] = [40_000, 2_000_000_000, 4_000, 2_000_000, 200_000, 200_000, 200_000];
/// The number of cycles until HSE is ready in bypass. RM0090 has six cycles for the fall of HSERDY; the rise is taken
/// to be the same.
const BYPASS_TICKS: u64 = 6;

/// The rate of LSE on the NUCLEO, in hertz: a 32.768 kHz crystal.
const LSE_HZ: u64 = 32_768;

const GIGA: i64 = 1_000_000_000;

/// The numbers of the registers, which are their offsets divided by 4.
const CR: u32 = 0;
const PLLCFGR: u32 = 1;
const CFGR: u32 = 2;
const CIR: u32 = 3;
pub(crate) const CFGR_OFFSET: u32 = 4 * CFGR;
const BDCR: u32 = 0x70 / 4;
const CSR: u32 = 0x74 / 4;
const DCKCFGR: u32 = 0x8C / 4;

/// The numbers (offset / 4) of the reset, enable and low-power enable registers of AHB1, AHB2, AHB3, APB1, APB2.
const RESETS: [u32; 5] = [0x10 / 4, 0x14 / 4, 0x18 / 4, 0x20 / 4, 0x24 / 4];
const ENABLES: [u32; 5] = [0x30 / 4, 0x34 / 4, 0x38 / 4, 0x40 / 4, 0x44 / 4];
const LOW_POWER: [u32; 5] = [0x50 / 4, 0x54 / 4, 0x58 / 4, 0x60 / 4, 0x64 / 4];
/// The bits that exist in the reset, enable and low-power enable registers (RM0090 7.3.5 to 7.3.14).
const RESET_BITS: [u32; 5] = [0x22E0_17FF, 0x0000_00F1, 1, 0xF6FE_C9FF, 0x0477_7933];
const ENABLE_BITS: [u32; 5] = [0x7EF4_17FF, 0x0000_00F1, 1, 0xF6FE_C9FF, 0x0477_7F33];
const LOW_POWER_BITS: [u32; 5] = [0x7EF7_97FF, 0x0000_00F1, 1, 0xF6FE_C9FF, 0x0477_7F33];
const ENABLES_AFTER_RESET: [u32; 5] = [0x0010_0000, 0, 0, 0, 0];
const LOW_POWER_AFTER_RESET: [u32; 5] = [0x7E67_97FF, 0x0000_00F1, 1, 0xF6FE_C9FF, 0x0477_7F33];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Gate {
    /// The number of the bus: 0 is AHB1, 1 AHB2, 2 AHB3, 3 APB1, 4 APB2.
    pub(crate) bus: u8,
    pub(crate) bit: u8,
}

#[derive(Clone, Copy, Debug)]
struct Rate {
    num: u128,
    den: u128,
    /// The nominal rate, rounded down.
    hz: u64,
    ppb: i64,
}

/// The power controller's settings for the clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Supply {
    pub(crate) scale: u8,
    pub(crate) over_drive: bool,
    pub(crate) backup_writable: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct Rcc {
    oscillators: Oscillators,
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
    system: u32,
    ready_at: [Cycle; 7],
    /// Whether the independent watchdog keeps LSI switched on.
    lsi_forced: bool,
    /// Whether all clocks stand still, since HSE failed without the clock security system.
    pub(crate) stopped: bool,
    pub(crate) clocks: Clocks,
    pub(crate) clocks_changed: bool,
    /// The reset bits that have risen since the part last took them.
    pub(crate) reset_bits: [u32; 5],
    pub(crate) backup_reset: bool,
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
            // A system reset keeps the reset flags (RM0090 7.3.21) and the backup domain (7.1.3).
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

    pub(crate) fn irq(&self) -> bool {
        self.cir & self.cir >> 8 & 0x7F != 0
    }

    /// The NMI of the clock security system (RM0090 7.2.7).
    pub(crate) fn nmi(&self) -> bool {
        self.cir & CSSF != 0
    }

    pub(crate) fn has_hse(&self) -> bool {
        self.hse_there
    }

    #[inline]
    pub(crate) fn is_on(&self, gate: Gate) -> bool {
        let bus = usize::from(gate.bus);
        (self.enables[bus] & !self.resets[bus]) >> gate.bit & 1 != 0
    }

    /// Switches the system's clock source if the requested one is ready, and computes the clock tree again.
    fn settle(&mut self, now: Cycle, pc: Option<u32>, supply: Supply, out: &mut Effects) {
        let wanted = self.cfgr & 3;
        let ready = match wanted {
            0 => self.cr & HSIRDY != 0,
            1 => self.cr & HSERDY != 0,
            2 => self.cr & PLLRDY != 0,
            // The value SW = 3 is "not allowed" (RM0090 7.3.3) and is ignored.
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
}
