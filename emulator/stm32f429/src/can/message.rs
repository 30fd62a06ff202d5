//! CAN messages: stuff bits, and the receive FIFOs (RM0090 32.7.3).

use super::*;

impl Mailbox {
    /// The number of bits of a frame up to the end of the CRC, including stuff bits.
    pub(super) fn stuffed_bits(&self) -> u64 {
        let mut frame = (0_u128, 0_u32);
        let mut push = |value: u32, width: u32| {
            frame.0 = frame.0 << width | u128::from(value) & ((1 << width) - 1);
            frame.1 += width;
            frame
        };
        let remote = self.identifier >> 1 & 1;
        push(0, 1);
        push(self.identifier >> 21, 11);
        if self.identifier & IDE != 0 {
            push(3, 2);
            push(self.identifier >> 3, 18);
            push(remote, 1);
            push(0, 2);
        } else {
            push(remote, 1);
            push(0, 2);
        }
        let (mut bits, mut count) = push(self.length, 4);
        if remote == 0 {
            for nth in 0..(self.length & 0xF).min(8) {
                (bits, count) = push(self.data[nth as usize / 4] >> (8 * (nth % 4)), 8);
            }
        }
        // The polynomial is x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1 (Bosch, CAN specification 2.0).
        let crc = (0..count).rev().fold(0_u32, |crc, nth| {
            let next = (bits >> nth & 1) as u32 ^ crc >> 14 & 1;
            crc << 1 & 0x7FFF ^ if next != 0 { 0x4599 } else { 0 }
        });
        (bits, count) = push(crc, 15);
        let (mut run, mut last, mut stuffed) = (0, 2, 0);
        for nth in (0..count).rev() {
            let bit = (bits >> nth & 1) as u32;
            run = if bit == last { run + 1 } else { 1 };
            last = bit;
            if run == 5 {
                // A stuff bit is the complement of the bits before it. It counts as the first bit of the next run.
                (run, last, stuffed) = (1, 1 - bit, stuffed + 1);
            }
        }
        u64::from(count) + stuffed
    }

    /// Returns the values that the filters compare with: that of a 32-bit filter, and that of a 16-bit filter.
    pub(super) fn compared(&self) -> (u32, u32) {
        let wide = self.identifier & !TXRQ;
        let narrow = wide >> 21 << 5 | (wide & RTR) << 3 | (wide & IDE) << 1 | (wide >> 18 & 7);
        (wide, narrow)
    }
}

impl Fifo {
    pub(super) fn push(&mut self, message: Mailbox, locked: bool) {
        if self.pending == 3 {
            self.flags |= FOVR;
            if !locked {
                self.messages[2] = message;
            }
            return;
        }
        self.messages[usize::from(self.pending)] = message;
        self.pending += 1;
        if self.pending == 3 {
            self.flags |= FULL;
        }
    }

    pub(super) fn write(&mut self, value: u32) {
        self.flags &= !(value & (FULL | FOVR));
        if value & RFOM != 0 && self.pending > 0 {
            self.messages.rotate_left(1);
            self.pending -= 1;
        }
    }

    pub(super) fn wants(&self, enables: u32) -> bool {
        let flags = u32::from(self.pending > 0) | (self.flags & FULL) >> 2 | (self.flags & FOVR) >> 2;
        flags & enables & 7 != 0
    }
}
