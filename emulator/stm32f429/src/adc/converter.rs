//! One converter: its sequence, the duration of a conversion, its flags and requests (RM0090 13.3, 13.5, 13.7, 13.8).

use super::*;

impl Converter {
    pub(super) fn new() -> Self {
        Self { high: 0xFFF, ..Self::default() }
    }

    fn length(&self) -> u8 {
        if self.cr1 & SCAN != 0 { (self.sqr[0] >> 20 & 0xF) as u8 + 1 } else { 1 }
    }

    fn channel(&self, place: u8) -> u8 {
        let (register, index) = match place {
            0..=5 => (self.sqr[2], place),
            6..=11 => (self.sqr[1], place - 6),
            _ => (self.sqr[0], place - 12),
        };
        (register >> (5 * index) & 0x1F) as u8
    }

    fn sampling_cycles(&self, channel: u8) -> u64 {
        // Channels past 18 do not exist.
        if channel > 18 {
            return 3;
        }
        let (register, index) = if channel < 10 { (self.smpr[1], channel) } else { (self.smpr[0], channel - 10) };
        [3, 15, 28, 56, 84, 112, 144, 480][(register >> (3 * index) & 7) as usize]
    }

    fn bits(&self) -> u32 {
        12 - 2 * (self.cr1 >> 24 & 3)
    }

    fn begin(&mut self, place: u8, at: Cycle, clock: u64) {
        let channel = self.channel(place);
        let sampled_at = at + self.sampling_cycles(channel) * clock;
        let ends = sampled_at + u64::from(self.bits()) * clock;
        self.running = Some(Conversion { place, channel, ends, sampled_at });
    }

    pub(super) fn start(&mut self, at: Cycle, clock: u64) {
        if self.cr2 & ADON == 0 || self.running.is_some() || self.sr & OVR != 0 {
            return;
        }
        self.sr |= STRT;
        let place = if self.cr1 & DISCEN != 0 { self.next_place } else { 0 };
        self.begin(place, at, clock);
    }

    pub(super) fn finish(&mut self, conversion: Conversion, code: u32, clock: u64) {
        let value = code >> (12 - self.bits());
        let watched = self.cr1 & AWDSGL == 0 || self.cr1 & 0x1F == u32::from(conversion.channel);
        if self.cr1 & AWDEN != 0 && watched {
            let full = value << (12 - self.bits());
            if full > self.high || full < self.low {
                self.sr |= AWD;
            }
        }
        let guarded = self.cr2 & (DMA | EOCS) != 0;
        let unread = if self.cr2 & DMA != 0 { self.request } else { self.sr & EOC != 0 };
        if guarded && unread {
            self.sr |= OVR;
            self.request = false;
            return;
        }
        self.data = if self.cr2 & ALIGN == 0 {
            value
        } else if self.bits() == 6 {
            value << 2
        } else {
            value << (16 - self.bits())
        };
        let last = conversion.place + 1 >= self.length();
        if last || self.cr2 & EOCS != 0 {
            self.sr |= EOC;
        }
        if self.cr2 & DMA != 0 && !self.dma_ended {
            self.request = true;
        }
        let next = if last { 0 } else { conversion.place + 1 };
        if self.cr1 & DISCEN != 0 {
            self.next_place = next;
            let group = (self.cr1 >> 13 & 7) as u8 + 1;
            if !last && !(conversion.place + 1).is_multiple_of(group) {
                self.begin(next, conversion.ends, clock);
            }
        } else if !last || self.cr2 & CONT != 0 {
            self.begin(next, conversion.ends, clock);
        }
    }
}
