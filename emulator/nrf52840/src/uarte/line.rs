//! The frames on the wire to a receiver, as a course of levels.

use super::*;

/// Returns the level of bit `k` of a frame: start bit, data, parity, stop bit and what follows.
fn level_of(frame: &UartFrame, k: u64) -> bool {
    let bits = u64::from(frame.bits);
    let ones = (u32::from(frame.data) & ((1 << frame.bits) - 1)).count_ones();
    match (k, frame.parity) {
        (0, _) => false,
        (k, _) if k <= bits => frame.data >> (k - 1) & 1 != 0,
        (k, UartParity::Even) if k == bits + 1 => ones % 2 == 1,
        (k, UartParity::Odd) if k == bits + 1 => ones.is_multiple_of(2),
        _ => true,
    }
}

impl Line {
    pub(super) fn level(&self, at: Cycle, period: u64) -> bool {
        self.frames.iter().rev().find(|(begins, _)| *begins <= at).is_none_or(|(begins, frame)| {
            let ps = (at - begins).saturating_mul(period) >> 16;
            level_of(frame, ps / frame.bit_ps.max(1))
        })
    }

    pub(super) fn falling_edge(&self, from: Cycle, period: u64) -> Option<Cycle> {
        for (begins, frame) in &self.frames {
            let mut high = true;
            for k in 0..=u64::from(frame.bits) + 1 {
                let level = level_of(frame, k);
                let at = begins + ((k * frame.bit_ps) << 16).div_ceil(period);
                if high && !level && at >= from {
                    return Some(at);
                }
                high = level;
            }
        }
        None
    }

    pub(super) fn forget(&mut self, now: Cycle) {
        while self.frames.front().is_some_and(|(begins, frame)| begins + frame.ns() * 64 / 1000 + 64 < now) {
            self.frames.pop_front();
        }
    }
}
