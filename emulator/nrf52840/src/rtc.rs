//! RTC: the 24-bit counter on LFCLK (PS 6.22).
//!
//! | covered | PS |
//! |---|---|
//! | START, STOP, CLEAR, TRIGOVRFLW; PRESCALER; COUNTER | 6.22 |
//! | TICK, OVRFLW, COMPARE\[n\], each only while EVTEN or INTEN enables it | 6.22 |
//! | a compare register written with the present count or the next one matches only after a wrap | 6.22 |
//!
//! A task takes effect at the present LFCLK tick. The part takes one to two ticks more, so that CC = COUNTER + 1
//! sometimes matches there. Here CC = COUNTER + 1 never matches and is a finding, since firmware must not rely on it.
//!
//! Left out: the jitter of the CPU's tasks against LFCLK (PS 6.22).
use crate::clocks::Clocks;
use crate::instance::{Block, Cx, Instance, index};

const TICK: u32 = 0;
const OVRFLW: u32 = 1;
const COMPARE: u32 = 16;
const MASK: u32 = 0x00FF_FFFF;
const NEAR_OVERFLOW: u32 = 0x00FF_FFF0;

#[derive(Clone, Debug)]
pub(crate) struct Rtc {
    block: Block,
    evten: u32,
    running: bool,
    prescaler: u32,
    cc: [u32; 4],
    compares: usize,
    /// The compare registers, as bits, that were written too late for their next match.
    late: u32,
    /// The counter's value at `base`, a tick of LFCLK.
    held: u32,
    base: u64,
    clocked: bool,
    next: Option<u64>,
}

impl Rtc {
    pub(crate) fn new(compares: usize) -> Self {
        Self {
            block: Block::default(),
            evten: 0,
            running: false,
            prescaler: 0,
            cc: [0; 4],
            compares,
            late: 0,
            held: 0,
            base: 0,
            clocked: false,
            next: None,
        }
    }

    fn step(&self) -> u64 {
        u64::from(self.prescaler) + 1
    }

    fn elapsed(&self, now: u64, clocks: &Clocks) -> u64 {
        match clocks.lf {
            Some(lf) if self.running && self.clocked => lf.ticks(now).saturating_sub(self.base) / self.step(),
            _ => 0,
        }
    }

    fn count(&self, now: u64, clocks: &Clocks) -> u32 {
        self.held.wrapping_add(self.elapsed(now, clocks) as u32) & MASK
    }

    fn enabled(&self, event: u32) -> bool {
        (self.evten | self.block.inten) >> event & 1 != 0
    }

    fn arm(&mut self, cx: &Cx<'_>) {
        self.next = None;
        let Some(lf) = cx.clocks.lf.filter(|_| self.running) else {
            return;
        };
        let count = self.count(cx.now, cx.clocks);
        let ahead = |target: u32| match target.wrapping_sub(count) & MASK {
            0 => u64::from(MASK) + 1,
            ticks => u64::from(ticks),
        };
        let tick = self.enabled(TICK).then_some(1);
        let overflow = self.enabled(OVRFLW).then(|| ahead(0));
        let enabled = (0..self.compares).filter(|&n| self.enabled(COMPARE + n as u32));
        let compares = enabled.map(|n| ahead(self.cc[n]));
        self.next = compares.chain(tick).chain(overflow).min().map(|ahead| {
            let counts = self.elapsed(cx.now, cx.clocks) + ahead;
            lf.instant(self.base + counts * self.step())
        });
    }

    /// Carries out the events that are due now. A task or a write at the same instant comes later, because it would
    /// skip these events.
    fn catch_up(&mut self, cx: &mut Cx<'_>) {
        if self.next.is_some_and(|at| at <= cx.now) {
            self.due(cx);
        }
    }

    fn load(&mut self, count: u32, cx: &Cx<'_>) {
        self.held = count & MASK;
        self.late = 0;
        self.base = cx.clocks.lf.map_or(0, |lf| lf.ticks(cx.now));
        self.clocked = cx.clocks.lf.is_some();
    }
}

impl Instance for Rtc {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        self.catch_up(cx);
        let count = self.count(cx.now, cx.clocks);
        match offset {
            0x000 if self.running => {}
            0x000 => {
                if cx.clocks.lf.is_none() {
                    cx.misuse("START while LFCLK does not run: it counts from when it does", 0);
                }
                self.load(count, cx);
                self.running = true;
            }
            0x004 => {
                self.load(count, cx);
                self.running = false;
            }
            0x008 => self.load(0, cx),
            0x00C => self.load(NEAR_OVERFLOW, cx),
            _ => return false,
        }
        self.arm(cx);
        true
    }

    fn read(&self, offset: u32, now: u64, clocks: &Clocks) -> Option<u32> {
        Some(match offset {
            0x340 | 0x344 | 0x348 => self.evten,
            0x504 => self.count(now, clocks),
            0x508 => self.prescaler,
            _ => self.cc[index(offset, 0x540, 4, self.compares as u32)?],
        })
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        self.catch_up(cx);
        match offset {
            0x340 => self.evten = value,
            0x344 => self.evten |= value,
            0x348 => self.evten &= !value,
            0x504 => {}
            0x508 if self.running => cx.misuse("PRESCALER written while it runs, which is ignored", value),
            0x508 => self.prescaler = value & 0xFFF,
            _ => {
                let Some(n) = index(offset, 0x540, 4, self.compares as u32) else {
                    return false;
                };
                self.cc[n] = value & MASK;
                self.late &= !(1 << n);
                let ahead = value.wrapping_sub(self.count(cx.now, cx.clocks)) & MASK;
                if self.running && ahead == 1 {
                    self.late |= 1 << n;
                    cx.misuse("CC = COUNTER + 1 may or may not match; here it does not", value);
                }
            }
        }
        self.arm(cx);
        true
    }

    fn configured(&mut self, cx: &mut Cx<'_>) {
        if cx.clocks.lf.is_some() != self.clocked {
            // LFCLK has stopped, or has started and counts its ticks from zero again. The counter goes on from its held
            // value.
            self.load(self.held, cx);
        }
        self.arm(cx);
    }

    fn next(&self) -> Option<u64> {
        self.next
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        let count = self.count(cx.now, cx.clocks);
        if self.enabled(TICK) {
            self.block.raise(TICK, cx);
        }
        if count == 0 && self.enabled(OVRFLW) {
            self.block.raise(OVRFLW, cx);
        }
        for n in 0..self.compares {
            if self.cc[n] != count || !self.enabled(COMPARE + n as u32) {
                continue;
            }
            if self.late >> n & 1 != 0 {
                self.late &= !(1 << n);
            } else {
                self.block.raise(COMPARE + n as u32, cx);
            }
        }
        self.arm(cx);
    }
}
