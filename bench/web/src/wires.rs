//! The wires of the last 100 ms.
//!
//! `wires.js` gets bytes, all little-endian. First comes a head of 24 bytes: the instant, ns (f64); the clock rate of
//! the SSI, Hz (f64); the levels of the wires 100 ms earlier, bit 0 for the wire 0 (u32); the number of changes (u32).
//! Each change has 8 bytes: how long before that instant it was, ns (u32); its wire, or 255 for a byte of the SSI; the
//! level, or the byte to the DPR; the byte from the DPR; 0. A byte's instant is the end of its eighth clock.

use std::collections::VecDeque;

use bench::trace::{Mark, SSI, Wire};

const KEPT_NS: u64 = 100_000_000;

/// The wires by their numbers.
const WIRES: [Wire; 6] = [Wire::HorusTick, Wire::Frame, Wire::HorusIrq, Wire::DprIrq, Wire::Fresh, Wire::SsiCsn];

const BYTE: u8 = 255;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Change {
    at: u64,
    what: [u8; 3],
}

/// The changes of the wires. A change of HORUS's wires may come after the instant that the flight has reached.
#[derive(Debug)]
pub(crate) struct Wires {
    now: u64,
    clock_hz: u32,
    changes: VecDeque<Change>,
    levels: u32,
}

impl Default for Wires {
    fn default() -> Self {
        // Chip select is high at the beginning.
        Self { now: 0, clock_hz: 1, changes: VecDeque::new(), levels: 1 << (WIRES.len() - 1) }
    }
}

impl Wires {
    pub(crate) fn take(&mut self, marks: &[Mark]) {
        for mark in marks {
            match *mark {
                Mark::Level(at, wire, level) => {
                    if let Some(number) = (0..).zip(WIRES).find_map(|(number, of)| (of == wire).then_some(number)) {
                        self.changes.push_back(Change { at, what: [number, u8::from(level), 0] });
                    }
                }
                Mark::Byte(at, bus, mosi, miso, hz) if bus == SSI => {
                    self.clock_hz = hz;
                    self.changes.push_back(Change { at, what: [BYTE, mosi, miso] });
                }
                Mark::Byte(..) | Mark::Word(..) | Mark::Task(..) => {}
            }
        }
    }

    /// The run has reached `now` (virtual ns).
    pub(crate) fn progress(&mut self, now: u64) {
        self.now = now;
        self.changes.make_contiguous().sort_by_key(|change| change.at);
        while let Some(change) = self.changes.front().copied().filter(|change| change.at + KEPT_NS < now) {
            self.changes.pop_front();
            let [wire, level, _] = change.what;
            if wire != BYTE {
                self.levels = self.levels & !(1 << wire) | u32::from(level) << wire;
            }
        }
    }

    /// Returns the wires in the format of `wires.js`.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let past = self.changes.iter().filter(|change| change.at <= self.now);
        let count = u32::try_from(past.clone().count()).unwrap_or(u32::MAX);
        let mut bytes = vec![];
        bytes.extend((self.now as f64).to_le_bytes());
        bytes.extend(f64::from(self.clock_hz).to_le_bytes());
        bytes.extend(self.levels.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        for Change { at, what } in past {
            bytes.extend(u32::try_from(self.now - at).unwrap_or(u32::MAX).to_le_bytes());
            bytes.extend(what);
            bytes.push(0);
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wires_keep_100_ms_and_the_levels_before_them() {
        let mut wires = Wires::default();
        wires.take(&[
            Mark::Level(5_000_000, Wire::Fresh, true),
            Mark::Level(120_000_000, Wire::HorusTick, true),
            Mark::Byte(60_000_000, SSI, 0xA5, 0x5A, 8_000_000),
            Mark::Byte(60_000_000, bench::trace::DPR, 1, 2, 8_000_000),
        ]);
        wires.progress(110_000_000);
        let mut told = 110e6_f64.to_le_bytes().to_vec();
        told.extend(8e6_f64.to_le_bytes());
        // FRESH and chip select are high at the beginning, and no tick has come.
        told.extend([0b11_0000, 0, 0, 0, 1, 0, 0, 0]);
        told.extend(50_000_000_u32.to_le_bytes());
        told.extend([BYTE, 0xA5, 0x5A, 0]);
        assert_eq!(wires.bytes(), told);
    }
}
