//! GPIOTE: pins as tasks and events (PS 6.10).
//!
//! | covered | PS |
//! |---|---|
//! | 8 channels, event mode with each polarity, task mode with OUT, SET, CLR and OUTINIT | 6.10 |
//! | PORT from the DETECT signal | 6.10 |
//!
//! | left out | why |
//! |---|---|
//! | the difference between the accurate and the low-power source of IN | both detect an edge at its own instant |
//! | two channels in task mode on one pin | undefined in PS 6.10; a finding |
use crate::instance::{Act, Block, Cx, Instance, index};
use crate::pin::Pin;

const CHANNELS: u32 = 8;
const CONFIG_MASK: u32 = 0x0013_3F03;

#[derive(Clone, Debug, Default)]
pub(crate) struct Gpiote {
    block: Block,
    config: [u32; CHANNELS as usize],
    level: [bool; CHANNELS as usize],
}

fn pin_of(config: u32) -> Option<Pin> {
    Pin::selected(config >> 8 & 0x3F)
}

impl Gpiote {
    fn is_task(&self, channel: usize) -> bool {
        self.config[channel] & 3 == 3
    }

    fn drive(&mut self, channel: usize, level: bool, cx: &mut Cx<'_>) {
        self.level[channel] = level;
        if let Some(pin) = pin_of(self.config[channel]) {
            cx.act(Act::Hold { pin, level: Some(level) });
        }
    }

    #[inline]
    pub(crate) fn watches(&self, pin: Pin) -> bool {
        self.config.iter().any(|&config| config & 3 == 1 && pin_of(config) == Some(pin))
    }

    pub(crate) fn pad(&mut self, pin: Pin, level: bool, cx: &mut Cx<'_>) {
        for channel in 0..CHANNELS as usize {
            let config = self.config[channel];
            if config & 3 != 1 || pin_of(config) != Some(pin) || self.level[channel] == level {
                continue;
            }
            self.level[channel] = level;
            let wanted = if level { 1 } else { 2 };
            if config >> 16 & wanted != 0 {
                self.block.raise(channel as u32, cx);
            }
        }
    }

    pub(crate) fn port(&mut self, cx: &mut Cx<'_>) {
        self.block.raise(31, cx);
    }
}

impl Instance for Gpiote {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        let (channel, level) = if let Some(n) = index(offset, 0x000, 4, CHANNELS) {
            let toggled = match self.config[n] >> 16 & 3 {
                1 => true,
                2 => false,
                3 => !self.level[n],
                _ => self.level[n],
            };
            (n, toggled)
        } else if let Some(n) = index(offset, 0x030, 4, CHANNELS) {
            (n, true)
        } else if let Some(n) = index(offset, 0x060, 4, CHANNELS) {
            (n, false)
        } else {
            return false;
        };
        if self.is_task(channel) {
            self.drive(channel, level, cx);
        }
        true
    }

    fn read(&self, offset: u32, _: u64, _: &crate::clocks::Clocks) -> Option<u32> {
        index(offset, 0x510, 4, CHANNELS).map(|n| self.config[n])
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        let Some(channel) = index(offset, 0x510, 4, CHANNELS) else {
            return false;
        };
        let (was, next) = (self.config[channel], value & CONFIG_MASK);
        self.config[channel] = next;
        let stays = was & 3 == 3 && next & 3 == 3 && pin_of(was) == pin_of(next);
        if was & 3 == 3
            && !stays
            && let Some(pin) = pin_of(was)
        {
            cx.act(Act::Hold { pin, level: None });
        }
        match next & 3 {
            3 if !stays => {
                let shared = (0..CHANNELS as usize)
                    .any(|n| n != channel && self.is_task(n) && pin_of(self.config[n]) == pin_of(next));
                if shared {
                    cx.misuse("two channels drive one pin, which is undefined; CONFIG", next);
                }
                self.drive(channel, next >> 20 & 1 != 0, cx);
            }
            // The channel takes the pad's present level, so the first edge is a change from this level.
            1 => cx.act(Act::Sample { channel }),
            _ => {}
        }
        true
    }
}

impl Gpiote {
    pub(crate) fn sample(&mut self, channel: usize, level: impl Fn(Pin) -> bool) {
        if let Some(pin) = pin_of(self.config[channel]) {
            self.level[channel] = level(pin);
        }
    }
}
