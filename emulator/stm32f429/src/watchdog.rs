//! The independent watchdog, RM0090 chapter 21, and the window watchdog, chapter 22.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `IWDG_KR` | 0xCCCC starts watchdog and LSI, 0xAAAA reloads, 0x5555 opens `PR`, `RLR`; any other key closes them |
//! | `IWDG_PR`, `RLR`, `SR` | Take effect 5 ticks of LSI after the write; `PVU`, `RVU` are set until then, 21.4.4 |
//! | `IWDG` count | Counts prescaled LSI exactly; the part restarts when it passes 0, 21.3 |
//! | `WWDG_CR`, `CFR` | Counts PCLK1 over 4096 over `WDGTB`; too early or too late a write restarts the part, 22.3 |
//! | `WWDG_SR` | Early wake-up interrupt at 0x40, 22.3 |
//!
//! **Left out.** On silicon the window watchdog's prescaler runs freely. Here it starts with each write of `T`, so that
//! a time-out comes as late as silicon's uncertainty of one tick allows. A change of `PR` while the watchdog counts
//! applies when the 5 ticks of the update end, and the count is kept. DBGMCU does not freeze the watchdogs.

use cortex_m4::Width;
use emulator_part::{Cycle, NEVER};

use crate::cx::{Clocks, Ratio};
use crate::gpio::{lane, merge};

#[derive(Clone, Debug)]
pub(crate) struct Iwdg {
    open: bool,
    running: bool,
    pr: u32,
    rlr: u32,
    /// The value written to PR, and the cycle from which it is in force.
    pr_next: Option<(u32, Cycle)>,
    rlr_next: Option<(u32, Cycle)>,
    count: u32,
    since: Cycle,
    end: Cycle,
    /// Whether the watchdog has run out and the part has yet to take this.
    pub(crate) expired: bool,
    /// Whether the watchdog was started and the part has yet to start LSI.
    pub(crate) started: bool,
}

impl Iwdg {
    pub(crate) fn new() -> Self {
        Self {
            open: false,
            running: false,
            pr: 0,
            rlr: 0xFFF,
            pr_next: None,
            rlr_next: None,
            count: 0xFFF,
            since: 0,
            end: NEVER,
            expired: false,
            started: false,
        }
    }

    fn prescaler(&self) -> u64 {
        4 << self.pr.min(6)
    }

    /// Counts down from `count`. The watchdog runs out one tick after the count is 0.
    fn schedule(&mut self, now: Cycle, count: u32, lsi: Ratio) {
        self.count = count;
        self.since = now;
        self.end = if self.running {
            now.saturating_add(lsi.cycles((u64::from(count) + 1) * self.prescaler()))
        } else {
            NEVER
        };
    }

    fn left(&self, now: Cycle, lsi: Ratio) -> u32 {
        if !self.running {
            return self.count;
        }
        let ticks = lsi.ticks(now.saturating_sub(self.since)) / self.prescaler();
        self.count.saturating_sub(u32::try_from(ticks).unwrap_or(u32::MAX))
    }

    pub(crate) fn due(&self) -> Cycle {
        let next = |next: Option<(u32, Cycle)>| next.map_or(NEVER, |(_, at)| at);
        self.end.min(next(self.pr_next)).min(next(self.rlr_next))
    }

    pub(crate) fn advance(&mut self, now: Cycle, lsi: Ratio) {
        while self.due() <= now {
            if let Some((pr, at)) = self.pr_next
                && at <= now
                && at <= self.end
            {
                let left = self.left(at, lsi);
                self.pr = pr;
                self.pr_next = None;
                self.schedule(at, left, lsi);
            } else if let Some((rlr, at)) = self.rlr_next
                && at <= now
                && at <= self.end
            {
                self.rlr = rlr;
                self.rlr_next = None;
            } else {
                self.expired = true;
                self.end = NEVER;
            }
        }
    }

    pub(crate) fn clocks_changed(&mut self, now: Cycle, old: &Clocks, new: &Clocks) {
        if old.lsi == new.lsi {
            return;
        }
        let moved = |at: Cycle| {
            if at == NEVER {
                return NEVER;
            }
            let ps = u128::from(at.saturating_sub(now)) * u128::from(new.hclk_hz) / u128::from(old.hclk_hz.max(1));
            now + ps as u64 + 1
        };
        if self.running {
            // The start of the count moves with the clock, so that the fraction of a tick is kept.
            let gone = u128::from(now.saturating_sub(self.since)) * u128::from(new.hclk_hz);
            let gone = (gone / u128::from(old.hclk_hz.max(1))) as u64;
            // The count cannot begin before cycle 0. If it would, it begins at cycle 0 and is reduced by the ticks
            // before that cycle.
            if gone <= now {
                self.since = now - gone;
            } else {
                let before = gone - now;
                let ticks = new.lsi.ticks(before) / self.prescaler();
                self.count = self.count.saturating_sub(u32::try_from(ticks).unwrap_or(u32::MAX));
                self.since = 0;
            }
            let whole = new.lsi.cycles((u64::from(self.count) + 1) * self.prescaler());
            self.end = self.since.saturating_add(whole).max(now + 1);
        }
        if let Some((_, at)) = &mut self.pr_next {
            *at = moved(*at);
        }
        if let Some((_, at)) = &mut self.rlr_next {
            *at = moved(*at);
        }
    }

    pub(crate) fn start(&mut self, now: Cycle, lsi: Ratio) {
        if !self.running {
            self.running = true;
            self.started = true;
            self.schedule(now, self.rlr, lsi);
        }
    }

    pub(crate) fn read(&self, offset: u32, width: Width) -> u32 {
        let register = match offset >> 2 {
            // During an update, PR and RLR read as last written. RM0090 21.4.2 leaves the value undefined.
            1 => self.pr_next.map_or(self.pr, |(pr, _)| pr),
            2 => self.rlr_next.map_or(self.rlr, |(rlr, _)| rlr),
            3 => u32::from(self.pr_next.is_some()) | u32::from(self.rlr_next.is_some()) << 1,
            _ => 0,
        };
        lane(register, offset, width)
    }

    pub(crate) fn write(
        &mut self,
        offset: u32,
        value: u32,
        now: Cycle,
        lsi: Ratio,
        lsi_runs: bool,
    ) -> Option<&'static str> {
        // An update takes five ticks of LSI. If LSI does not run yet, its start-up time of 40 µs is added: at most 2
        // ticks at 47 kHz.
        let delay = lsi.cycles(if lsi_runs { 5 } else { 7 });
        match offset >> 2 {
            0 => {
                self.open = value & 0xFFFF == 0x5555;
                match value & 0xFFFF {
                    0xCCCC => self.start(now, lsi),
                    0xAAAA => {
                        let reload = self.rlr;
                        self.schedule(now, reload, lsi);
                    }
                    _ => {}
                }
                None
            }
            nth @ (1 | 2) => {
                let (pending, mask) = if nth == 1 { (&mut self.pr_next, 7) } else { (&mut self.rlr_next, 0xFFF) };
                if !self.open {
                    return Some("PR or RLR is written without the key 0x5555: it stays");
                }
                if pending.is_some() {
                    return Some("PR or RLR is written during its update: it stays");
                }
                *pending = Some((value & mask, now.saturating_add(delay)));
                None
            }
            _ => None,
        }
    }
}

const WDGA: u32 = 1 << 7;
const COUNT: u32 = 0x7F;
/// Bit 6 of `T`. The part restarts when it is clear.
const ALIVE: u32 = 0x40;
const EWI: u32 = 1 << 9;

#[derive(Clone, Debug)]
pub(crate) struct Wwdg {
    active: bool,
    written: u32,
    written_at: Cycle,
    cfr: u32,
    early: bool,
    early_at: Cycle,
    end_at: Cycle,
    pub(crate) expired: bool,
}

impl Wwdg {
    pub(crate) fn new() -> Self {
        Self {
            active: false,
            written: COUNT,
            written_at: 0,
            cfr: COUNT,
            early: false,
            early_at: NEVER,
            end_at: NEVER,
            expired: false,
        }
    }

    fn tick(&self, clocks: &Clocks) -> u64 {
        (4096 * u64::from(clocks.pclk1)) << (self.cfr >> 7 & 3)
    }

    fn count(&self, now: Cycle, clocks: &Clocks) -> u32 {
        if !self.active {
            return self.written;
        }
        let ticks = now.saturating_sub(self.written_at) / self.tick(clocks);
        self.written.saturating_sub(u32::try_from(ticks).unwrap_or(u32::MAX))
    }

    fn schedule(&mut self, clocks: &Clocks, now: Cycle) {
        (self.early_at, self.end_at) = (NEVER, NEVER);
        if self.active && self.written & ALIVE != 0 {
            let (tick, ticks) = (self.tick(clocks), u64::from(self.written - ALIVE));
            let early = self.written_at + ticks * tick;
            self.early_at = if early > now || early == self.written_at { early.max(now) } else { NEVER };
            self.end_at = (self.written_at + (ticks + 1) * tick).max(now + 1);
        }
    }

    pub(crate) fn due(&self) -> Cycle {
        self.early_at.min(self.end_at)
    }

    pub(crate) fn advance(&mut self, now: Cycle) {
        if self.early_at <= now {
            self.early = true;
            self.early_at = NEVER;
        }
        if self.end_at <= now {
            self.expired = true;
            self.end_at = NEVER;
        }
    }

    pub(crate) fn irq(&self) -> bool {
        self.early && self.cfr & EWI != 0
    }

    pub(crate) fn clocks_changed(&mut self, now: Cycle, old: &Clocks, new: &Clocks) {
        if self.active && old.pclk1 != new.pclk1 {
            self.written = self.count(now, old);
            self.written_at = now;
            self.schedule(new, now);
        }
    }

    pub(crate) fn read(&self, offset: u32, width: Width, now: Cycle, clocks: &Clocks) -> u32 {
        let register = match offset >> 2 {
            0 => self.count(now, clocks) | if self.active { WDGA } else { 0 },
            1 => self.cfr,
            2 => u32::from(self.early),
            _ => 0,
        };
        lane(register, offset, width)
    }

    pub(crate) fn write(&mut self, offset: u32, width: Width, value: u32, now: Cycle, clocks: &Clocks) {
        match offset >> 2 {
            0 => {
                let new = merge(self.count(now, clocks), offset, width, value);
                let outside = self.active && self.count(now, clocks) > self.cfr & COUNT;
                self.active |= new & WDGA != 0;
                self.written = new & COUNT;
                self.written_at = now;
                if self.active && (outside || self.written & ALIVE == 0) {
                    self.expired = true;
                }
                self.schedule(clocks, now);
            }
            1 => {
                let count = self.count(now, clocks);
                // EWI is cleared by a reset only (RM0090 22.6.2).
                self.cfr = merge(self.cfr, offset, width, value) & 0x3FF | self.cfr & EWI;
                self.written = count;
                self.written_at = now;
                self.schedule(clocks, now);
            }
            // Software can clear EWIF but not set it.
            2 if merge(1, offset, width, value) & 1 == 0 => self.early = false,
            _ => {}
        }
    }
}
