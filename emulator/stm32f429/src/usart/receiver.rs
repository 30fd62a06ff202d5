//! The receiver: waveforms, samples, frames and flags (RM0090 30.3.3).

use super::*;

impl Wave {
    fn level(&self, at: Cycle) -> bool {
        let index = ((at - self.begins) << FRACTION) / self.bit;
        index > 31 || self.levels >> index & 1 != 0
    }

    fn falling(&self, from: Cycle) -> Option<Cycle> {
        let mut edges = !self.levels & (self.levels << 1 | 1);
        // Most calls ask for the first edge, or for an edge after the frame's end. Both are answered here without the
        // loop.
        let at = |index: u32| self.begins + (u64::from(index) * self.bit).div_ceil(1 << FRACTION);
        if edges == 0 || at(31 - edges.leading_zeros()) < from {
            return None;
        }
        loop {
            let found = at(edges.trailing_zeros());
            if found >= from {
                return Some(found);
            }
            edges &= edges - 1;
        }
    }
}

impl Usart {
    /// Receives a frame on the RX pin, whose start bit falls at `begins`.
    pub(crate) fn receive(&mut self, begins: Cycle, frame: &UartFrame, cx: &mut Cx) {
        if !self.is_on(RE) {
            return;
        }
        if self.known_bit.0 != frame.bit_ps {
            let cycles = cx.clocks.cycles_of_ps(frame.bit_ps.saturating_mul(1 << FRACTION));
            self.known_bit = (frame.bit_ps, cycles.max(1));
        }
        let bit = self.known_bit.1;
        let mut data = u32::from(frame.data) & ((1 << frame.bits) - 1);
        let mut bits = u32::from(frame.bits);
        if frame.parity != UartParity::None {
            let odd = data.count_ones() & 1 != 0;
            data |= u32::from(odd != (frame.parity == UartParity::Odd)) << bits;
            bits += 1;
        }
        let halves = 2 * (1 + u64::from(bits)) + u64::from(frame.stop_halves);
        let ends = begins + ((halves * bit) >> (FRACTION + 1));
        self.waves.push_back(Wave { begins, ends, bit, levels: u32::MAX << (1 + bits) | data << 1 });
        self.find_start();
        // A frame is passed to the receiver only at its end, when its samples may already be due.
        while self.receiving.is_some_and(|edge| edge + self.sampled_after() <= cx.now) {
            self.finish_receiving();
        }
        self.plan();
    }

    /// The cycles from the start bit's edge to the stop bit's last sample.
    pub(super) fn sampled_after(&self) -> u64 {
        self.bit * u64::from(1 + self.data_bits()) + self.bit * 10 / 16
    }

    fn level(&self, at: Cycle) -> bool {
        // Frames on one line should not overlap. If two do, the low level wins.
        self.waves.iter().all(|wave| at < wave.begins || at >= wave.ends || wave.level(at))
    }

    pub(super) fn find_start(&mut self) {
        if self.receiving.is_some() {
            return;
        }
        let from = self.look_from;
        while self.waves.front().is_some_and(|wave| wave.ends <= from) {
            self.waves.pop_front();
        }
        self.receiving = self.waves.iter().find_map(|wave| wave.falling(from));
        if self.receiving.is_some_and(|edge| edge < self.idle_at) {
            self.idle_at = NEVER;
        }
    }

    /// Samples one bit three times. Returns the bit's level, and whether the samples differ.
    fn sample(&self, begins: Cycle) -> (bool, bool) {
        let eighths = |n: u64| begins + self.bit * n / 16;
        let (a, b, c) = if self.cr1 & OVER8 != 0 { (8, 10, 12) } else { (15, 17, 19) };
        // The samples are in the middle of the 8th to 10th sixteenth, or of the 4th to 6th eighth.
        let at = |n: u64| if self.cr1 & OVER8 != 0 { eighths(n - 1) } else { begins + self.bit * n / 32 };
        if self.cr3 & ONEBIT != 0 {
            return (self.level(at(b)), false);
        }
        let ones = u8::from(self.level(at(a))) + u8::from(self.level(at(b))) + u8::from(self.level(at(c)));
        (ones >= 2, ones == 1 || ones == 2)
    }

    /// Returns the bits of the frame that begins at `edge`: data with parity, the stop bit, and noise. `None` if no
    /// start bit began at the edge.
    pub(super) fn sampled(&self, edge: Cycle) -> Option<(u16, bool, bool)> {
        let bits = self.data_bits();
        if let Some(wave) = self.waves.front()
            && wave.begins == edge
            && self.waves.get(1).is_none_or(|next| next.begins >= edge + self.sampled_after())
        {
            // If the bits drift by less than 5/16 of a bit up to the stop bit, every sample lies in its own bit.
            let drift = wave.bit.abs_diff(self.bit << FRACTION) * u64::from(bits + 2);
            if drift * 16 < (self.bit * 5) << FRACTION {
                let word = wave.levels >> 1;
                return Some((word as u16 & ((1 << bits) - 1), word >> bits & 1 != 0, false));
            }
        }
        let (start, mut noise) = self.sample(edge);
        if start {
            return None;
        }
        let mut word = 0;
        for index in 0..bits {
            let (level, differ) = self.sample(edge + self.bit * u64::from(1 + index));
            word |= u16::from(level) << index;
            noise |= differ;
        }
        let (stop, differ) = self.sample(edge + self.bit * u64::from(1 + bits));
        Some((word, stop, noise | differ))
    }

    pub(super) fn finish_receiving(&mut self) {
        let Some(edge) = self.receiving.take() else { return };
        while self.waves.front().is_some_and(|wave| wave.ends <= edge) {
            self.waves.pop_front();
        }
        let Some((word, stop, noise)) = self.sampled(edge) else {
            self.look_from = edge + self.bit * 10 / 16;
            self.find_start();
            return;
        };
        self.look_from = edge + self.sampled_after();
        self.idle_at = edge + self.bit * u64::from(2 * (2 + self.data_bits()) + 1);
        if self.sr & RXNE != 0 {
            self.sr |= ORE;
        } else {
            self.rdr = word;
            self.sr |= RXNE;
            if noise {
                self.sr |= NF;
            }
            if !stop {
                self.sr |= FE;
            }
            if self.cr1 & PCE != 0 && (word.count_ones() & 1 != 0) != (self.cr1 & PS != 0) {
                self.sr |= PE;
            }
        }
        self.find_start();
    }
}
