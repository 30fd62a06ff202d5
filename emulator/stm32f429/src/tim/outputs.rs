//! Outputs of channels: enables, polarities, idle levels, break and dead time (RM0090 17.3.11, 17.3.12, table 95,
//! `TIMx_BDTR` in 17.4.18).

use super::*;

/// The signals of the outputs, in the order of the bits of [`Outputs`].
const OUTPUT_PINS: [TimPin; 7] =
    [TimPin::Ch1, TimPin::Ch2, TimPin::Ch3, TimPin::Ch4, TimPin::Ch1N, TimPin::Ch2N, TimPin::Ch3N];

/// A timer's outputs: bits 0 to 3 are channels 1 to 4, bits 4 to 6 the complementary outputs of channels 1 to 3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Outputs {
    driven: u8,
    levels: u8,
}

impl Tim {
    pub(super) fn broken(&self) -> bool {
        self.bdtr & BKE != 0 && self.inputs[INPUT_BREAK] == (self.bdtr & BKP != 0)
    }

    pub(super) fn check_break(&mut self) {
        if self.kind.advanced && self.broken() {
            self.bdtr &= !MOE;
            self.sr |= BIF;
        }
    }

    /// Returns the dead time in core cycles (RM0090 17.4.18). DTG counts steps of the clock that CKD divides.
    fn dead_time(&self) -> u64 {
        let dtg = u64::from(self.bdtr & 0xFF);
        let steps = match dtg >> 5 {
            0..=3 => dtg,
            4 | 5 => (64 + (dtg & 0x3F)) * 2,
            6 => (32 + (dtg & 0x1F)) * 8,
            _ => (32 + (dtg & 0x1F)) * 16,
        };
        (steps << (self.cr1 >> 8 & 3).min(2)) * self.div
    }

    /// Starts a dead time at each edge of a reference: one output goes off at once, and the other goes on when the dead
    /// time is over.
    fn follow_dead_time(&mut self, now: Cycle) {
        let time = self.dead_time();
        for channel in 0..3 {
            let end = &mut self.dead_until[channel];
            if *end <= now {
                *end = NEVER;
            }
            let (reference, bit) = (self.reference[channel], 1 << channel);
            let is_pair = self.ccer >> (4 * channel) & 5 == 5 && self.bdtr & MOE != 0;
            if reference != (self.dead_references & bit != 0) && is_pair && time > 0 {
                *end = now + time;
            } else if !is_pair {
                *end = NEVER;
            }
            self.dead_references = self.dead_references & !bit | u8::from(reference) << channel;
        }
    }

    fn outputs(&self) -> Outputs {
        let mut out = Outputs::default();
        if self.kind.channels == 0 || self.ccer & 0x5555 == 0 {
            return out;
        }
        let idle = self.kind.advanced && self.bdtr & MOE == 0;
        for channel in 0..self.channels() {
            if self.is_input(channel) {
                continue;
            }
            let bits = self.ccer >> (4 * channel);
            let reference = self.reference[channel];
            let dead = channel < 3 && self.dead_until[channel] != NEVER;
            if bits & 1 != 0 {
                let active = reference && !dead;
                let level = if idle { self.cr2 >> (8 + 2 * channel) & 1 != 0 } else { active != (bits & 2 != 0) };
                // Without MOE, OSSI decides whether the output is driven.
                if !idle || self.bdtr & 1 << 10 != 0 {
                    out.driven |= 1 << channel;
                    out.levels |= u8::from(level) << channel;
                }
            }
            if self.kind.advanced && channel < 3 && bits & 4 != 0 {
                // RM0090 table 95: the complementary output alone carries the reference. Together with its channel's
                // output it carries the complement.
                let source = if bits & 1 != 0 { !reference } else { reference };
                let active = source && !dead;
                let level = if idle { self.cr2 >> (9 + 2 * channel) & 1 != 0 } else { active != (bits & 8 != 0) };
                if !idle || self.bdtr & 1 << 10 != 0 {
                    out.driven |= 16 << channel;
                    out.levels |= u8::from(level) << (4 + channel);
                }
            }
        }
        out
    }

    pub(super) fn finish(&mut self, cx: &mut Cx) {
        if self.kind.advanced {
            self.follow_dead_time(cx.now);
        }
        let out = self.outputs();
        if out != self.told {
            let changed = (out.driven ^ self.told.driven) | (out.levels ^ self.told.levels);
            for (index, pin) in OUTPUT_PINS.into_iter().enumerate() {
                if changed >> index & 1 != 0 {
                    let level = (out.driven >> index & 1 != 0).then_some(out.levels >> index & 1 != 0);
                    cx.output(Signal::Tim(self.kind.number, pin), level);
                }
            }
            self.told = out;
        }
        if self.kind.channels != 0 {
            let mut references = 0;
            for channel in 0..self.channels() {
                references |= u8::from(self.reference[channel] && self.enabled(channel)) << channel;
            }
            let rising = references & !self.told_references;
            self.told_references = references;
            for channel in 0..4 {
                if rising >> channel & 1 != 0 {
                    cx.trigger(Trigger::Compare(self.kind.number, channel + 1));
                }
            }
        }
        if self.trigger_pulses != 0 || (self.trigger_level && !self.told_level) {
            cx.trigger(Trigger::Trgo(self.kind.number));
        }
        self.trigger_pulses = 0;
        self.told_level = self.trigger_level;
        self.plan();
    }
}
