//! WDT: the watchdog (PS 6.36).
//!
//! | covered | PS |
//! |---|---|
//! | START, which cannot be undone; CRV, RREN and CONFIG, which START locks | 6.36 |
//! | RR[0..8] with 0x6E524635, REQSTATUS; a reload when all enabled requests have been written | 6.36 |
//! | the time-out after (CRV + 1) LFCLK ticks; TIMEOUT; the reset, two ticks later if its interrupt is enabled | 6.36 |
//! | CONFIG.SLEEP, CONFIG.HALT: counting or pausing while the core sleeps or a debugger halts it | 6.36 |
//! | counting on through a soft reset and a lockup | 5.3 |
use crate::clocks::Clocks;
use crate::instance::{Act, Block, Cx, Instance, index};

const RELOAD: u32 = 0x6E52_4635;
/// The LFCLK ticks from TIMEOUT to the reset.
const GRACE: u64 = 2;
/// Bits of CONFIG: the counter runs while the core sleeps, and while a debugger halts it.
const SLEEP_RUN: u32 = 1;
const HALT_RUN: u32 = 1 << 3;

#[derive(Clone, Debug)]
pub(crate) struct Wdt {
    block: Block,
    loaded: Option<u64>,
    crv: u32,
    rren: u32,
    config: u32,
    requests: u32,
    timed_out: bool,
    paused: Option<u64>,
    asleep: bool,
    halted: bool,
    next: Option<u64>,
}

impl Default for Wdt {
    fn default() -> Self {
        Self {
            block: Block::default(),
            loaded: None,
            crv: u32::MAX,
            rren: 1,
            config: 1,
            requests: 1,
            timed_out: false,
            paused: None,
            asleep: false,
            halted: false,
            next: None,
        }
    }
}

impl Wdt {
    pub(crate) fn running(&self) -> bool {
        self.loaded.is_some()
    }

    fn arm(&mut self, cx: &Cx<'_>) {
        self.next = match (self.loaded, cx.clocks.lf) {
            (Some(loaded), Some(lf)) if self.paused.is_none() => {
                let grace = if self.timed_out { GRACE } else { 0 };
                Some(lf.instant(loaded + u64::from(self.crv) + 1 + grace))
            }
            _ => None,
        };
    }

    pub(crate) fn sleeps(&mut self, asleep: bool, cx: &mut Cx<'_>) {
        self.asleep = asleep;
        self.pause(cx);
    }

    pub(crate) fn halts(&mut self, halted: bool, cx: &mut Cx<'_>) {
        self.halted = halted;
        self.pause(cx);
    }

    const fn pauses(&self) -> bool {
        self.asleep && self.config & SLEEP_RUN == 0 || self.halted && self.config & HALT_RUN == 0
    }

    /// Pauses or resumes the watchdog's counter, as CONFIG demands for the state of the core.
    fn pause(&mut self, cx: &mut Cx<'_>) {
        let tick = cx.clocks.lf.map_or(0, |lf| lf.ticks(cx.now));
        if self.pauses() && self.running() {
            self.paused.get_or_insert(tick);
        } else if let Some(since) = self.paused.take() {
            self.loaded = self.loaded.map(|loaded| loaded + tick.saturating_sub(since));
        }
        self.arm(cx);
    }

    fn load(&mut self, cx: &Cx<'_>) {
        self.loaded = Some(cx.clocks.lf.map_or(0, |lf| lf.ticks(cx.now)));
        self.requests = self.rren;
        self.paused = self.loaded.filter(|_| self.pauses());
        self.arm(cx);
    }
}

impl Instance for Wdt {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        if offset != 0 {
            return false;
        }
        if !self.running() {
            cx.act(Act::DemandLfclk);
            self.load(cx);
        }
        true
    }

    fn read(&self, offset: u32, _: u64, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x400 => u32::from(self.running()),
            0x404 => self.requests,
            0x504 => self.crv,
            0x508 => self.rren,
            0x50C => self.config,
            0x600..0x620 => 0,
            _ => return None,
        })
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x400 | 0x404 => {}
            0x504 | 0x508 | 0x50C if self.running() => {
                cx.misuse("configured while it runs, which is ignored; offset", offset);
            }
            0x504 => self.crv = value.max(0xF),
            0x508 => {
                self.rren = value & 0xFF;
                self.requests = self.rren;
            }
            0x50C => self.config = value & 0b1001,
            _ => {
                let Some(n) = index(offset, 0x600, 4, 8) else {
                    return false;
                };
                if value != RELOAD {
                    cx.misuse("a reload request with another value than 0x6E524635", value);
                } else if self.running() && !self.timed_out {
                    self.requests &= !(1 << n);
                    if self.requests == 0 {
                        self.load(cx);
                    }
                }
            }
        }
        true
    }

    fn configured(&mut self, cx: &mut Cx<'_>) {
        self.arm(cx);
    }

    fn next(&self) -> Option<u64> {
        self.next
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        if !self.timed_out {
            self.timed_out = true;
            self.block.raise(0, cx);
            if self.block.inten & 1 != 0 {
                self.arm(cx);
                return;
            }
        }
        self.next = None;
        cx.act(Act::Restart);
    }
}
