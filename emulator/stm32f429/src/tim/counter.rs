//! The counter: value, direction, ends of its range, and updates (RM0090 17.3.1 to 17.3.4).
//!
//! [`Tim::sync`] advances the counter to the present, from one count with an effect to the next. [`Tim::plan`] finds
//! the next effect that others can observe, at which the timer needs an event.

use super::*;

impl Tim {
    /// Returns the number of counts to the next effect, a compare match or an end of the range; `None` if the counter
    /// stands still.
    fn to_next(&self) -> Option<u64> {
        let mut least = self.to_end()?;
        for channel in 0..self.channels() {
            if !self.is_input(channel)
                && let Some(counts) = self.to_match(channel)
            {
                least = least.min(counts);
            }
        }
        Some(least)
    }

    /// Returns the number of counts to the end of the range, at which the counter wraps or turns.
    #[inline]
    fn to_end(&self) -> Option<u64> {
        let (cnt, arr) = (u64::from(self.cnt), u64::from(self.arr_now));
        if arr == 0 {
            return None;
        }
        Some(if self.down {
            if self.centre() { cnt.max(1) } else { cnt + 1 }
        } else if cnt > arr || (self.centre() && cnt == arr) {
            u64::from(self.kind.largest) - cnt + 1
        } else if self.centre() {
            arr - cnt
        } else {
            arr - cnt + 1
        })
    }

    /// Returns the number of counts to a channel's match, if it comes before the end of the range.
    #[inline]
    fn to_match(&self, channel: usize) -> Option<u64> {
        let (cnt, at) = (self.cnt, self.ccr_now[channel]);
        if self.down { cnt.checked_sub(at) } else { at.checked_sub(cnt) }.filter(|&d| d != 0).map(u64::from)
    }

    /// Advances the counter by at most [`Tim::to_next`] counts, and handles the effect there.
    pub(super) fn count(&mut self, counts: u64) {
        let Some(end) = self.to_end() else { return };
        if counts < end {
            self.cnt = if self.down { self.cnt - counts as u32 } else { self.cnt + counts as u32 };
            self.arrive();
            return;
        }
        let beyond = !self.down && self.cnt > self.arr_now;
        if self.centre() {
            if self.down {
                self.cnt = 0;
                self.down = false;
            } else if beyond || self.cnt == self.arr_now {
                self.cnt = 0;
                self.arrive();
                return;
            } else {
                self.cnt = self.arr_now;
                self.down = true;
            }
            self.arrive();
            self.overflow();
        } else if self.down {
            self.overflow();
            self.cnt = self.arr_now;
            self.arrive();
        } else {
            self.cnt = 0;
            if beyond {
                // A counter beyond ARR has wrapped at its largest value, without a match of ARR.
                self.arrive();
                return;
            }
            self.overflow();
            self.arrive();
        }
    }

    fn overflow(&mut self) {
        for channel in 0..self.channels() {
            // If the counter never reaches the compare value, the flag is set here (TIMx_SR, CC1IF).
            if !self.is_input(channel) && self.ccr_now[channel] > self.arr_now {
                self.compare_event(channel);
            }
        }
        if self.kind.advanced {
            if self.repeat != 0 {
                self.repeat -= 1;
                return;
            }
            self.repeat = self.rcr;
        }
        if self.cr1 & UDIS != 0 {
            return;
        }
        self.update(true);
        if self.cr1 & OPM != 0 {
            self.cr1 &= !CEN;
            self.trigger_enable();
        }
    }

    fn update(&mut self, flagged: bool) {
        self.psc_now = self.psc;
        self.arr_now = self.arr;
        self.ccr_now = self.ccr_kept();
        if flagged {
            self.sr |= UIF;
            if self.dier & UDE != 0 {
                self.request(DMA_UPDATE);
            }
        }
        if self.cr2 & CCDS != 0 {
            for channel in 0..self.channels() {
                if self.dier >> (9 + channel) & 1 != 0 {
                    self.request(2 << channel);
                }
            }
        }
        if self.cr2 >> 4 & 7 == 2 {
            self.trigger_pulses = 1;
        }
        if self.kind.advanced && self.bdtr & AOE != 0 && !self.broken() {
            self.bdtr |= MOE;
        }
    }

    /// Restarts the counter, for EGR.UG or a trigger in reset mode.
    pub(super) fn restart(&mut self) {
        self.down = self.cr1 & DIR != 0 && !self.centre() && self.kind.downward;
        self.prescale = 0;
        self.repeat = self.rcr;
        if self.cr1 & UDIS == 0 {
            self.update(self.cr1 & URS == 0);
        }
        if self.cr2 >> 4 & 7 == 0 {
            self.trigger_pulses = 1;
        }
        self.cnt = if self.down { self.arr_now } else { 0 };
        self.follow();
    }

    pub(super) fn sync(&mut self, now: Cycle) {
        let tick = self.ticks(now);
        if tick <= self.tick {
            return;
        }
        if !self.counting() {
            self.tick = tick;
            return;
        }
        let mut clocks = tick - self.tick + u64::from(self.prescale);
        self.tick = tick;
        // `ends` is the number of ends of the range that the counter has reached in this call. Once all effects repeat,
        // whole periods are skipped.
        let mut ends = 0;
        loop {
            let step = u64::from(self.psc_now) + 1;
            let counts = if step == 1 { clocks } else { clocks / step };
            let Some(next) = self.to_next() else {
                self.prescale = if step == 1 { 0 } else { (clocks % step) as u32 };
                return;
            };
            if counts < next {
                if counts != 0 {
                    self.count(counts);
                }
                self.prescale = (clocks - counts * step) as u32;
                return;
            }
            clocks -= next * step;
            let at_end = self.to_end() == Some(next);
            self.count(next);
            if self.cr1 & CEN == 0 {
                self.prescale = 0;
                return;
            }
            if at_end {
                ends += 1;
                // A channel may toggle, so the effects repeat only after two rounds of the repetition counter.
                let rounds = 2 * (u64::from(self.rcr) + 1);
                if ends > 2 * rounds {
                    let arr = u64::from(self.arr_now);
                    let whole = rounds * if self.centre() { 2 * arr } else { arr + 1 };
                    clocks %= whole * (u64::from(self.psc_now) + 1);
                    ends = 0;
                }
            }
        }
    }

    #[inline]
    pub(super) fn ticks(&self, now: Cycle) -> u64 {
        if self.div == 1 { now } else { now / self.div }
    }

    /// Computes the instant at which others can observe the next effect.
    pub(super) fn plan(&mut self) {
        self.plan_counter();
        for end in self.dead_until {
            self.due = self.due.min(end);
        }
    }

    fn plan_counter(&mut self) {
        self.due = NEVER;
        if !self.counting() {
            return;
        }
        let Some(end) = self.to_end() else { return };
        let mut counts = u64::MAX;
        let mms = self.cr2 >> 4 & 7;
        if (self.dier & 1 != 0 && self.sr & UIF == 0)
            || self.dier & UDE != 0
            || mms == 2
            || self.cr2 & CCDS != 0 && self.dier & 0x1E00 != 0
        {
            counts = end;
        }
        for channel in 0..self.channels() {
            if self.is_input(channel) {
                continue;
            }
            let seen = (self.dier >> (1 + channel) & 1 != 0 && self.sr >> (1 + channel) & 1 == 0)
                || self.dier >> (9 + channel) & 1 != 0
                || self.any_output(channel)
                || mms >= 3;
            if seen {
                counts = counts.min(self.to_match(channel).filter(|&to| to < end).unwrap_or(end));
            }
        }
        if counts == u64::MAX {
            return;
        }
        let step = u64::from(self.psc_now) + 1;
        let clocks = (counts * step).saturating_sub(u64::from(self.prescale)).max(1);
        self.due = (self.tick + clocks).saturating_mul(self.div);
    }
}
