//! TIMER: a 16 MHz timer and counter (PS 6.30).
//!
//! | covered | PS |
//! |---|---|
//! | START, STOP, COUNT, CLEAR, SHUTDOWN, CAPTURE | 6.30 |
//! | COMPARE at the exact tick, with CLEAR and STOP shortcuts | 6.30 |
//! | Timer, Counter and LowPowerCounter mode, all bit modes, PRESCALER 0 to 9 | 6.30 |
//!
//! A compare register matches when the counter *becomes* equal to it. If the present count is written to it, it matches
//! only after a wrap. With the CLEAR shortcut the period is CC ticks. A match that is due at the instant of a task or a
//! write comes first.
//!
//! Left out: the power saving of PCLK1M with PRESCALER above 4, and the one cycle by which START is resynchronised.
//! START takes effect at the present PCLK16M tick.
use crate::clocks::Clocks;
use crate::instance::{Block, Cx, Instance, index};

const COMPARE: u32 = 16;

#[derive(Clone, Debug)]
pub(crate) struct Timer {
    block: Block,
    running: bool,
    mode: u32,
    bitmode: u32,
    prescaler: u32,
    cc: [u32; 6],
    compares: usize,
    /// The counter's value at `base`, a tick of PCLK16M.
    held: u32,
    base: u64,
    /// The cycle and the PCLK16M tick of the next match.
    next: Option<(u64, u64)>,
}

impl Timer {
    pub(crate) fn new(compares: usize) -> Self {
        Self {
            block: Block::default(),
            running: false,
            mode: 0,
            bitmode: 0,
            prescaler: 4,
            cc: [0; 6],
            compares,
            held: 0,
            base: 0,
            next: None,
        }
    }

    fn mask(&self) -> u32 {
        match self.bitmode & 3 {
            1 => 0xFF,
            2 => 0x00FF_FFFF,
            3 => u32::MAX,
            _ => 0xFFFF,
        }
    }

    fn counts_ticks(&self) -> bool {
        self.running && self.mode & 3 == 0
    }

    fn elapsed(&self, tick: u64) -> u64 {
        if self.counts_ticks() { tick.saturating_sub(self.base) >> self.prescaler.min(9) } else { 0 }
    }

    fn count(&self, tick: u64) -> u32 {
        self.held.wrapping_add(self.elapsed(tick) as u32) & self.mask()
    }

    /// Moves `base` to the present tick, because the counting is about to change.
    fn rebase(&mut self, cx: &Cx<'_>) {
        let tick = cx.hf();
        self.held = self.count(tick);
        self.base = if self.counts_ticks() { self.base + (self.elapsed(tick) << self.prescaler.min(9)) } else { tick };
    }

    fn arm_after(&mut self, tick: u64, cx: &Cx<'_>) {
        self.next = self.counts_ticks().then(|| {
            let (mask, count) = (self.mask(), self.count(tick));
            let ahead = |cc: &u32| match cc.wrapping_sub(count) & mask {
                0 => u64::from(mask) + 1,
                ticks => u64::from(ticks),
            };
            let ahead = self.cc[..self.compares].iter().map(ahead).min().expect("a timer has compare registers");
            let tick = self.base + ((self.elapsed(tick) + ahead) << self.prescaler.min(9));
            (cx.clocks.hf.instant(tick), tick)
        });
    }

    fn arm(&mut self, cx: &Cx<'_>) {
        self.arm_after(cx.hf(), cx);
    }

    /// Raises the events of the compare registers that equal `count`, which the counter reached at `tick`.
    fn matched(&mut self, count: u32, tick: u64, cx: &mut Cx<'_>) {
        let mask = self.mask();
        let (mut clear, mut stop) = (false, false);
        for n in 0..self.compares {
            if self.cc[n] & mask == count {
                self.block.raise(COMPARE + n as u32, cx);
                clear |= self.block.short(n as u32);
                stop |= self.block.short(8 + n as u32);
            }
        }
        if stop {
            self.held = count;
            self.base = tick;
            self.running = false;
        }
        if clear {
            self.held = 0;
            self.base = tick;
        }
    }

    /// Carries out the matches that are due now. A task or a write at the same instant comes later, because it would
    /// skip these matches.
    fn catch_up(&mut self, cx: &mut Cx<'_>) {
        while let Some((_, tick)) = self.next.filter(|(at, _)| *at <= cx.now) {
            let count = self.count(tick);
            self.matched(count, tick, cx);
            self.arm_after(tick, cx);
        }
    }
}

impl Instance for Timer {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        self.catch_up(cx);
        match offset {
            0x000 => {
                if !self.running {
                    self.rebase(cx);
                    self.running = true;
                }
            }
            0x004 => {
                self.rebase(cx);
                self.running = false;
            }
            0x008 => {
                if self.running && self.mode & 3 != 0 {
                    self.held = self.held.wrapping_add(1) & self.mask();
                    self.matched(self.held, cx.hf(), cx);
                }
            }
            0x00C => {
                self.held = 0;
                self.base = cx.hf();
            }
            0x010 => {
                self.running = false;
                self.held = 0;
            }
            _ => {
                let Some(n) = index(offset, 0x040, 4, self.compares as u32) else {
                    return false;
                };
                self.cc[n] = self.count(cx.hf());
            }
        }
        self.arm(cx);
        true
    }

    fn read(&self, offset: u32, _: u64, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x504 => self.mode,
            0x508 => self.bitmode,
            0x510 => self.prescaler,
            _ => self.cc[index(offset, 0x540, 4, self.compares as u32)?],
        })
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        self.catch_up(cx);
        if matches!(offset, 0x504 | 0x508 | 0x510) && self.running {
            cx.misuse("configured while it runs; offset", offset);
        }
        self.rebase(cx);
        match offset {
            0x504 => self.mode = value & 3,
            0x508 => self.bitmode = value & 3,
            0x510 => {
                if value & 0xF > 9 {
                    cx.misuse("a prescaler above 9", value);
                }
                self.prescaler = value & 0xF;
            }
            _ => {
                let Some(n) = index(offset, 0x540, 4, self.compares as u32) else {
                    return false;
                };
                self.cc[n] = value;
            }
        }
        self.held &= self.mask();
        self.arm(cx);
        true
    }

    fn configured(&mut self, cx: &mut Cx<'_>) {
        self.catch_up(cx);
        self.arm(cx);
    }

    fn next(&self) -> Option<u64> {
        self.next.map(|(at, _)| at)
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        self.catch_up(cx);
    }
}
