//! Input channels: source, edges, prescaler and capture (RM0090 17.3.5, 17.3.6).

use super::*;

impl Tim {
    pub(super) fn line(&self, channel: usize) -> bool {
        if channel == 0 && self.cr2 & TI1S != 0 {
            self.inputs[0] ^ self.inputs[1] ^ self.inputs[2]
        } else {
            self.inputs[channel]
        }
    }

    /// Whether a change to `level` counts as an edge with this channel's polarity.
    fn is_edge(&self, channel: usize, level: bool) -> bool {
        match self.ccer >> (4 * channel) & 0xA {
            0 => level,
            2 => !level,
            0xA => true,
            _ => false,
        }
    }

    pub(super) fn input_changed(&mut self, input: usize, level: bool, cx: &mut Cx) {
        if self.inputs[input] == level {
            return;
        }
        self.sync(cx.now);
        let before = self.line(0);
        self.inputs[input] = level;
        match input {
            INPUT_ETR => self.external(level, cx.now),
            INPUT_BREAK => self.check_break(),
            _ => {
                for line in 0..self.channels() {
                    if (line == 0 && self.line(0) != before) || (line != 0 && line == input) {
                        self.line_changed(line, cx.now);
                    }
                }
            }
        }
        self.follow();
        self.finish(cx);
    }

    fn line_changed(&mut self, line: usize, now: Cycle) {
        let level = self.line(line);
        for channel in [line, line ^ 1] {
            if channel >= self.channels() {
                continue;
            }
            let selected = match self.mode_byte(channel) & 3 {
                1 => channel == line,
                2 => channel != line,
                _ => false,
            };
            if selected && self.enabled(channel) && self.is_edge(channel, level) {
                self.prescaled_capture(channel);
            }
        }
        match self.slave_mode() {
            1..=3 if line < 2 => self.encoder(line),
            _ => {}
        }
        match (self.trigger_source(), line) {
            (4, 0) => {
                self.trigger_edge(true, now);
                self.trigger_edge(false, now);
            }
            (5, 0) | (6, 1) => {
                let inverted = self.ccer >> (4 * line) & 2 != 0;
                self.trigger_edge(level != inverted, now);
            }
            _ => {}
        }
    }

    pub(super) fn prescaled_capture(&mut self, channel: usize) {
        self.edges[channel] += 1;
        if self.edges[channel] >= 1 << (self.mode_byte(channel) >> 2 & 3) {
            self.edges[channel] = 0;
            self.capture(channel);
        }
    }

    pub(super) fn capture(&mut self, channel: usize) {
        if self.sr >> (1 + channel) & 1 != 0 {
            self.sr |= 1 << (9 + channel);
        }
        self.ccr_now[channel] = self.cnt;
        self.sr |= 2 << channel;
        if self.dier >> (9 + channel) & 1 != 0 && self.cr2 & CCDS == 0 {
            self.request(2 << channel);
        }
        if channel == 0 && self.cr2 >> 4 & 7 == 3 {
            self.trigger_pulses = 1;
        }
    }
}
