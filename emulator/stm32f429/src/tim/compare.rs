//! Output channels: compare flags and the references OCxREF (RM0090 17.3.8 to 17.3.10, output modes in `TIMx_CCMR1`,
//! 17.4.7).

use super::*;

impl Tim {
    /// Handles a new value of the counter.
    pub(super) fn arrive(&mut self) {
        let centre = self.cr1 >> 5 & 3;
        for channel in 0..self.channels() {
            if self.is_input(channel) {
                continue;
            }
            if self.cnt == self.ccr_now[channel] {
                let flagged = match centre {
                    1 if self.kind.downward => self.down,
                    2 if self.kind.downward => !self.down,
                    _ => true,
                };
                if flagged {
                    self.compare_event(channel);
                }
                match self.mode_byte(channel) >> 4 & 7 {
                    1 => self.reference[channel] = true,
                    2 => self.reference[channel] = false,
                    3 => self.reference[channel] = !self.reference[channel],
                    _ => {}
                }
            }
        }
        self.follow();
    }

    pub(super) fn follow(&mut self) {
        for channel in 0..self.channels() {
            if self.is_input(channel) {
                continue;
            }
            let at = self.ccr_now[channel];
            let active = if self.down { self.cnt <= at } else { self.cnt < at };
            let old = self.reference[channel];
            let new = match self.mode_byte(channel) >> 4 & 7 {
                4 => false,
                5 => true,
                6 => active,
                7 => !active,
                _ => old,
            };
            self.reference[channel] = new;
        }
        let mms = self.cr2 >> 4 & 7;
        if mms >= 4 {
            self.trigger_level = self.reference[(mms - 4) as usize];
        }
    }

    pub(super) fn compare_event(&mut self, channel: usize) {
        self.sr |= 2 << channel;
        if self.dier >> (9 + channel) & 1 != 0 && self.cr2 & CCDS == 0 {
            self.request(2 << channel);
        }
        if channel == 0 && self.cr2 >> 4 & 7 == 3 {
            self.trigger_pulses = 1;
        }
    }

    /// Returns the compare values after an update. A channel that captures keeps its value.
    pub(super) fn ccr_kept(&self) -> [u32; 4] {
        std::array::from_fn(|channel| if self.is_input(channel) { self.ccr_now[channel] } else { self.ccr[channel] })
    }
}
