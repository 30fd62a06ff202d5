//! CLOCK and POWER, which share a block and an interrupt (PS 5.3, 5.4).
//!
//! | covered | PS |
//! |---|---|
//! | HFCLKSTART, HFCLKSTOP, HFCLKSTARTED, HFCLKRUN, HFCLKSTAT | 5.4 |
//! | LFCLKSTART, LFCLKSTOP, LFCLKSTARTED, LFCLKSRC and its copy, LFCLKRUN, LFCLKSTAT | 5.4 |
//! | CAL with DONE, the calibration timer CTSTART, CTSTOP, CTIV with CTTO, CTSTARTED, CTSTOPPED | 5.4 |
//! | SYSTEMOFF: wake-up by DETECT is a reset; RAM that RAM\[n\].POWER does not retain is lost | 5.3 |
//! | SLEEPENTER, SLEEPEXIT | 5.3 |
//! | RESETREAS, GPREGRET, GPREGRET2, CONSTLAT, LOWPWR, DCDCEN, RAM\[n\].POWER as registers | 5.3, 5.3 |
//! | POFCON with POFWARN, of VDD | 5.3 |
//! | APPROTECT.FORCEPROTECT, which can only close, and APPROTECT.DISABLE, which share this address space | 4.8 |
//!
//! | left out | why |
//! |---|---|
//! | POFCON.THRESHOLDVDDH, and POFWARN keeping the NVMC from writing | VDDH is VDD; no firmware here writes flash |
//! | USB regulator events | USBD is not modelled |
//! | debounce of HFXO | it is part of the start-up time, a setting in which `None` means no start at all |
use crate::Settings;
use crate::clocks::{Clocks, cycles};
use crate::instance::{Act, Block, Cx, Instance, Source, index};

const HFCLKSTARTED: u32 = 0;
const LFCLKSTARTED: u32 = 1;
const POFWARN: u32 = 2;
const DONE: u32 = 3;
const CTTO: u32 = 4;
const CTSTARTED: u32 = 10;
const CTSTOPPED: u32 = 11;
const SLEEPENTER: u32 = 5;
const SLEEPEXIT: u32 = 6;

const POFCON: u32 = 0x510;
/// The offset of the register in which firmware closes the debug port by writing 0. A reset opens it again.
const APPROTECT_FORCEPROTECT: u32 = 0x550;
/// The offset of the register in which [`SW_DISABLE`] opens the software's half of the access port protection.
const APPROTECT_DISABLE: u32 = 0x558;
const SW_DISABLE: u32 = 0x5A;

/// The cycles from LFCLKSTART to LFCLKSTARTED with the RC oscillator (PS 5.4: 600 µs).
const LFRC_STARTUP: u64 = cycles(600_000);
/// The length of a calibration in cycles (PS 5.4: 16 ms typical).
const CALIBRATION: u64 = cycles(16_000_000);
/// The unit of the calibration timer, a quarter of a second, in LFCLK ticks.
const CTIV_TICKS: u64 = 8192;

/// The number of RAM blocks, 0 to 8. Each has the registers POWER, POWERSET and POWERCLR.
const RAM_BLOCKS: u32 = 9;
/// RAM\[n\].POWER after a reset: all sections are on in System ON, none is retained in System OFF.
const RAM_POWER_RESET: u32 = 0xFFFF;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Low {
    Rc = 0,
    Crystal = 1,
    Synthesised = 2,
}

#[derive(Clone, Debug)]
pub(crate) struct ClockPower {
    block: Block,
    /// The start-up time of HFXO, in core cycles; `None` if the crystal never starts.
    hfxo_startup: Option<u64>,
    lfxo_startup: u64,
    hf_run: bool,
    hf_stable: bool,
    hf_due: Option<u64>,
    source: u32,
    copy: u32,
    lf_run: bool,
    lf: Option<Low>,
    lf_due: Option<u64>,
    calibration_due: Option<u64>,
    ctiv: u32,
    ct_due: Option<u64>,
    pub(crate) reset_reason: u32,
    retained: [u32; 2],
    plain: [(u32, u32, u32); 8],
    ram: [u32; RAM_BLOCKS as usize],
    microvolts: u32,
    /// Whether the power-fail comparator finds the supply too low.
    low: bool,
    pub(crate) warned: bool,
}

impl ClockPower {
    pub(crate) fn new(settings: &Settings) -> Self {
        Self {
            block: Block::default(),
            hfxo_startup: settings.hfxo_startup_ns.map(cycles),
            lfxo_startup: cycles(settings.lfxo_startup_ns),
            hf_run: false,
            hf_stable: false,
            hf_due: None,
            source: 0,
            copy: 0,
            lf_run: false,
            lf: None,
            lf_due: None,
            calibration_due: None,
            ctiv: 0,
            ct_due: None,
            reset_reason: 0,
            retained: [0; 2],
            plain: [
                (POFCON, 0, 0xF1F),
                (0x528, 0x10, 0xFF), // HFXODEBOUNCE
                (APPROTECT_FORCEPROTECT, u32::MAX, 0xFF),
                (APPROTECT_DISABLE, 0, 0xFF),
                (0x55C, 0, 0x3_0003), // TRACECONFIG
                (0x578, 0, 1),        // DCDCEN
                (0x580, 0, 1),        // DCDCEN0
                (0x5B4, 0, 1),        // LFRCMODE
            ],
            ram: [RAM_POWER_RESET; RAM_BLOCKS as usize],
            microvolts: settings.supply_microvolts.unsigned_abs(),
            low: false,
            warned: false,
        }
    }

    /// Sets the registers after a restart for `reason`. If the restart is `gentle`, the retained registers keep their
    /// values.
    pub(crate) fn restarted(&mut self, before: &Self, reason: u32, gentle: bool) {
        self.reset_reason = before.reset_reason | reason;
        if gentle {
            self.retained = before.retained;
        }
    }

    pub(crate) fn keep_supply(&mut self, before: &Self) {
        self.microvolts = before.microvolts;
    }

    pub(crate) fn supply(&mut self, microvolts: u32, cx: &mut Cx<'_>) {
        self.microvolts = microvolts;
        self.watch_supply(cx);
    }

    /// Updates the power-fail comparator. POFWARN comes when the supply falls below the threshold. It also comes if the
    /// supply is already below the threshold when the comparator is switched on or its threshold is raised (PS 5.3.3).
    /// The part is accurate to 5 %, with a hysteresis of 50 mV (PS 5.3.8); the model reacts as late as that allows.
    fn watch_supply(&mut self, cx: &mut Cx<'_>) {
        const LOWEST: u32 = 4;
        let pofcon = self.plain(POFCON);
        let nominal = 1_700_000 + 100_000 * (pofcon >> 1 & 0xF).saturating_sub(LOWEST);
        let falls = nominal / 100 * 95;
        let low = pofcon & 1 != 0 && self.microvolts < if self.low { falls + 50_000 } else { falls };
        if low && !self.low {
            self.warned = true;
            self.block.raise(POFWARN, cx);
        }
        self.low = low;
    }

    fn plain(&self, offset: u32) -> u32 {
        self.plain.iter().find(|(at, ..)| *at == offset).map_or(0, |(_, value, _)| *value)
    }

    pub(crate) fn set_hfxo_startup(&mut self, startup_ns: Option<u64>) {
        self.hfxo_startup = startup_ns.map(cycles);
    }

    pub(crate) fn is_hfxo_stable(&self) -> bool {
        self.hf_stable
    }

    pub(crate) fn debug_port_enabled(&self) -> bool {
        self.plain(APPROTECT_DISABLE) == SW_DISABLE && self.plain(APPROTECT_FORCEPROTECT) != 0
    }

    pub(crate) fn retains(&self, block: usize, section: usize) -> bool {
        self.ram[block] >> (16 + section) & 1 != 0
    }

    /// Raises SLEEPENTER or SLEEPEXIT.
    pub(crate) fn sleeps(&mut self, asleep: bool, cx: &mut Cx<'_>) {
        self.block.raise(if asleep { SLEEPENTER } else { SLEEPEXIT }, cx);
    }

    pub(crate) fn is_on_lfxo(&self) -> bool {
        self.lf == Some(Low::Crystal)
    }

    /// Keeps LFCLK running through a reset, for a watchdog that runs on.
    pub(crate) fn keep_lfclk(&mut self) {
        self.lf = Some(Low::Rc);
    }

    fn wanted(&self) -> Low {
        match self.source & 3 {
            1 => Low::Crystal,
            2 => Low::Synthesised,
            _ => Low::Rc,
        }
    }

    fn feed(&mut self, source: Option<Low>, cx: &mut Cx<'_>) {
        self.lf = source;
        cx.act(Act::Clock(match source {
            Some(Low::Rc) => Source::LowRc,
            Some(Low::Crystal) => Source::LowCrystal,
            Some(Low::Synthesised) => Source::LowSynthesised,
            None => Source::LowStopped,
        }));
    }
}

impl Instance for ClockPower {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            // HFCLKSTART raises its event even if HFXO already runs.
            0x000 => {
                self.hf_run = true;
                let startup = if self.hf_stable { Some(0) } else { self.hfxo_startup };
                self.hf_due = startup.map(|startup| cx.now + startup);
            }
            0x004 => {
                (self.hf_run, self.hf_stable, self.hf_due) = (false, false, None);
                cx.act(Act::Clock(Source::HighInternal));
            }
            // The RC oscillator is the source until the crystal has started (PS 5.4).
            0x008 => {
                self.copy = self.source;
                let startup = match self.wanted() {
                    _ if self.lf_run && self.lf == Some(self.wanted()) => 0,
                    Low::Crystal => self.lfxo_startup,
                    Low::Rc | Low::Synthesised => LFRC_STARTUP,
                };
                self.lf_run = true;
                if self.wanted() == Low::Crystal && self.lf.is_none() {
                    self.feed(Some(Low::Rc), cx);
                }
                self.lf_due = Some(cx.now + startup);
            }
            0x00C => {
                (self.lf_run, self.lf_due) = (false, None);
                self.feed(None, cx);
            }
            0x010 => {
                if !self.hf_stable {
                    cx.misuse("CAL without HFXO running", 0);
                }
                self.calibration_due = Some(cx.now + CALIBRATION);
            }
            0x014 => {
                self.block.raise(CTSTARTED, cx);
                let lf = cx.clocks.lf;
                self.ct_due = lf.map(|lf| lf.instant(lf.ticks(cx.now) + u64::from(self.ctiv) * CTIV_TICKS));
            }
            0x018 => {
                self.ct_due = None;
                self.block.raise(CTSTOPPED, cx);
            }
            // CONSTLAT and LOWPWR only change the latency of a wake-up. In this model the latency is zero.
            0x078 | 0x07C => {}
            _ => return false,
        }
        true
    }

    fn read(&self, offset: u32, _: u64, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x400 => self.reset_reason,
            0x408 => u32::from(self.hf_run),
            // HFCLK always runs; SRC states its source.
            0x40C => 1 << 16 | u32::from(self.hf_stable),
            0x414 => u32::from(self.lf_run),
            0x418 => self.lf.map_or(0, |source| 1 << 16 | source as u32),
            0x41C => self.copy,
            // RAMSTATUS is deprecated. USBREGSTATUS shows no VBUS, and MAINREGSTATUS shows normal voltage.
            0x428 | 0x438 | 0x640 => 0,
            0x500 => 0,
            0x518 => self.source,
            0x51C | 0x520 => self.retained[(offset as usize - 0x51C) / 4],
            0x538 => self.ctiv,
            _ => {
                if let Some(n) = index(offset, 0x900, 4, 4 * RAM_BLOCKS) {
                    return (n % 4 < 3).then(|| self.ram[n / 4]);
                }
                self.plain.iter().find(|(at, _, _)| *at == offset)?.1
            }
        })
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x400 => self.reset_reason &= !value,
            0x408 | 0x40C | 0x414 | 0x418 | 0x41C | 0x428 | 0x438 | 0x640 => {}
            // Once the debug port is closed, firmware cannot open it before the next reset.
            APPROTECT_FORCEPROTECT if self.plain(APPROTECT_FORCEPROTECT) == 0 => {}
            0x500 if value & 1 != 0 => cx.act(Act::Off),
            0x500 => {}
            0x518 => {
                if self.lf_run {
                    cx.misuse("LFCLKSRC written while LFCLK runs", value);
                }
                self.source = value & 0x0003_0003;
            }
            0x51C | 0x520 => self.retained[(offset as usize - 0x51C) / 4] = value & 0xFF,
            0x538 => self.ctiv = value & 0x7F,
            _ => {
                if let Some(n) = index(offset, 0x900, 4, 4 * RAM_BLOCKS) {
                    let ram = &mut self.ram[n / 4];
                    match n % 4 {
                        0 => *ram = value,
                        1 => *ram |= value,
                        2 => *ram &= !value,
                        _ => return false,
                    }
                    return true;
                }
                let Some(plain) = self.plain.iter_mut().find(|(at, _, _)| *at == offset) else {
                    return false;
                };
                plain.1 = value & plain.2;
                if offset == POFCON {
                    self.watch_supply(cx);
                }
            }
        }
        true
    }

    fn next(&self) -> Option<u64> {
        [self.hf_due, self.lf_due, self.calibration_due, self.ct_due].into_iter().flatten().min()
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        let now = cx.now;
        let come = |due: &mut Option<u64>| due.take_if(|at| *at <= now).is_some();
        let (hf, lf) = (come(&mut self.hf_due), come(&mut self.lf_due));
        let (calibrated, timed) = (come(&mut self.calibration_due), come(&mut self.ct_due));
        if hf {
            if !self.hf_stable {
                self.hf_stable = true;
                cx.act(Act::Clock(Source::HighCrystal));
            }
            self.block.raise(HFCLKSTARTED, cx);
        }
        if lf {
            if self.lf != Some(self.wanted()) {
                let source = self.wanted();
                self.feed(Some(source), cx);
            }
            self.block.raise(LFCLKSTARTED, cx);
        }
        if calibrated {
            self.block.raise(DONE, cx);
        }
        if timed {
            self.block.raise(CTTO, cx);
        }
    }
}

impl ClockPower {
    /// Starts the RC oscillator for the watchdog if LFCLK has no source (PS 6.36).
    pub(crate) fn demand_lfclk(&mut self, cx: &mut Cx<'_>) {
        if self.lf.is_none() {
            self.feed(Some(Low::Rc), cx);
        }
    }
}
