//! Slave modes, encoder and external clocks (RM0090 17.3.16, 17.3.20, `TIMx_SMCR` in 17.4.3); the trigger output.

use super::*;

/// Returns the numbers of the timers that are ITR0 to ITR3 of a timer (RM0090 tables 93, 97, 100 and 101). TIM10,
/// TIM11, TIM13 and TIM14 provide the level of their channel.
pub(super) const fn internal_triggers(number: u8) -> Option<[u8; 4]> {
    Some(match number {
        1 => [5, 2, 3, 4],
        8 => [1, 2, 4, 5],
        2 => [1, 8, 3, 4],
        3 => [1, 2, 5, 4],
        4 => [1, 2, 3, 8],
        5 => [2, 3, 4, 8],
        9 => [2, 3, 10, 11],
        12 => [4, 5, 13, 14],
        _ => return None,
    })
}

impl Tim {
    /// Handles a change on a line of an encoder (RM0090 table 98, "Counting direction versus encoder signals").
    pub(super) fn encoder(&mut self, line: usize) {
        if self.cr1 & CEN == 0 {
            return;
        }
        let counted = match self.slave_mode() {
            1 => line == 1,
            2 => line == 0,
            _ => true,
        };
        if !counted {
            return;
        }
        let inverted = |channel: usize| self.ccer >> (4 * channel) & 2 != 0;
        let level = self.line(line) != inverted(line);
        let other = self.line(line ^ 1) != inverted(line ^ 1);
        let up = if line == 0 { level != other } else { level == other };
        self.down = !up;
        self.cr1 = self.cr1 & !DIR | if up { 0 } else { DIR };
        self.pulse();
    }

    fn pulse(&mut self) {
        if self.cr1 & CEN == 0 {
            return;
        }
        self.prescale += 1;
        if self.prescale > self.psc_now {
            self.prescale = 0;
            self.count(1);
        }
    }

    /// Handles the external trigger pin: polarity, prescaler, external clock mode 2.
    pub(super) fn external(&mut self, level: bool, now: Cycle) {
        let level = level != (self.smcr & ETP != 0);
        if level {
            self.edges[4] += 1;
            if self.edges[4] < 1 << (self.smcr >> 12 & 3) {
                return;
            }
            self.edges[4] = 0;
        }
        if self.smcr & ECE != 0 && level {
            self.pulse();
        }
        if self.trigger_source() == 7 {
            self.trigger_edge(level, now);
        }
    }

    pub(super) fn trigger_edge(&mut self, level: bool, now: Cycle) {
        if !self.kind.slave {
            return;
        }
        self.sync(now);
        let rising = level && !self.gate;
        let changed = level != self.gate;
        self.gate = level;
        let mode = self.slave_mode();
        if mode != 0 && (rising || (mode == 5 && changed)) {
            self.sr |= TIF;
            if self.dier & TDE != 0 {
                self.request(DMA_TRIGGER);
            }
        }
        if rising {
            for channel in 0..self.channels() {
                if self.mode_byte(channel) & 3 == 3 && self.enabled(channel) {
                    self.prescaled_capture(channel);
                }
            }
            match mode {
                4 => self.restart(),
                6 => {
                    self.start(now);
                }
                7 => self.pulse(),
                _ => {}
            }
        }
        if mode == 5 {
            self.tick = self.ticks(now);
        }
    }

    pub(super) fn trigger_enable(&mut self) {
        if self.cr2 >> 4 & 7 == 1 {
            self.trigger_level = self.cr1 & CEN != 0;
        }
    }

    pub(super) fn start(&mut self, now: Cycle) {
        if self.cr1 & CEN == 0 {
            self.cr1 |= CEN;
            // The counter starts one timer clock after CEN is set (RM0090 17.3.4). The prescaler keeps its count.
            self.tick = self.ticks(now) + 1;
            self.trigger_enable();
        }
    }
}
