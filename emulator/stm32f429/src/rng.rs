//! The random number generator (RM0090 chapter 24): `CR`, `SR`, `DR`.
//!
//! | Covered | Manual |
//! |---|---|
//! | A word every 40 cycles of the 48 MHz clock, `DRDY`, the interrupt | 24.3 |
//! | A clock below HCLK / 16, or none: `CECS`, `CEIS`, no more words | 24.3.2 |
//!
//! **Left out:** seed errors. The words are a pseudo-random sequence, the same in every run.

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, NEVER};

use crate::cx::{Clocks, Cx, Peripheral, Wires};

const RNGEN: u32 = 1 << 2;
const IE: u32 = 1 << 3;
const DRDY: u32 = 1 << 0;
const CECS: u32 = 1 << 1;
const CEIS: u32 = 1 << 5;
const SEIS: u32 = 1 << 6;

/// The number of cycles of the 48 MHz clock for one random word.
const WORD: u64 = 40;

#[derive(Clone, Debug)]
pub(crate) struct Rng {
    cr: u32,
    sr: u32,
    data: u32,
    state: u64,
    due: Cycle,
}

impl Rng {
    pub(crate) fn new() -> Self {
        Self { cr: 0, sr: 0, data: 0, state: 0x5EED_0F42_9000_0001, due: NEVER }
    }

    #[allow(dead_code, reason = "for a bench that wants another sequence")]
    pub(crate) fn seed(&mut self, seed: u64) {
        self.state = seed;
    }

    /// The upper half of the next number of SplitMix64 (Steele, Lea and Flood 2014).
    fn next(&mut self) -> u32 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.state;
        mixed = (mixed ^ mixed >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ mixed >> 31) >> 32) as u32
    }

    fn plan(&mut self, cx: &Cx) {
        self.sr &= !CECS;
        self.due = NEVER;
        if self.cr & RNGEN == 0 {
            return;
        }
        if cx.clocks.pll48_hz * 16 < cx.clocks.hclk_hz {
            self.sr |= CECS | CEIS;
        } else if self.sr & DRDY == 0 {
            self.due = cx.now.saturating_add(cx.clocks.pll48.cycles(WORD).max(1));
        }
    }
}

impl Peripheral for Rng {
    fn read(&mut self, offset: u32, _: Width, cx: &mut Cx) -> u32 {
        let value = match offset & !3 {
            0x00 => self.cr,
            0x04 => self.sr,
            0x08 => {
                let data = std::mem::take(&mut self.data);
                if self.sr & DRDY != 0 {
                    self.sr &= !DRDY;
                    self.plan(cx);
                }
                data
            }
            _ => {
                cx.find_value(FindingKind::Undefined, "no register at offset", offset);
                0
            }
        };
        value >> (8 * (offset & 3))
    }

    fn write(&mut self, offset: u32, _: Width, value: u32, cx: &mut Cx) {
        match offset & !3 {
            0x00 => {
                let before = self.cr;
                self.cr = value & (RNGEN | IE);
                if (before ^ self.cr) & RNGEN != 0 {
                    if self.cr & RNGEN != 0 && cx.clocks.pll48_hz > 48_120_000 {
                        cx.find(FindingKind::Misuse, "the 48 MHz clock is faster than that");
                    }
                    if self.cr & RNGEN != 0 && cx.clocks.pll48_undefined && cx.clocks.pll48_hz > 0 {
                        cx.find(FindingKind::Misuse, "PLLQ is 0 or 1: what clocks the RNG is not defined");
                    }
                    self.plan(cx);
                }
            }
            0x04 => self.sr &= value | !(CEIS | SEIS),
            0x08 => {}
            _ => cx.find_value(FindingKind::Undefined, "no register at offset", offset),
        }
    }

    fn peek(&self, offset: u32, _: &mut Cx) -> u32 {
        [self.cr, self.sr, self.data].get((offset / 4) as usize).copied().unwrap_or(0)
    }

    fn due(&self) -> Cycle {
        self.due
    }

    fn advance<W: Wires>(&mut self, cx: &mut Cx, _: &mut W) {
        if self.due <= cx.now {
            self.due = NEVER;
            self.data = self.next();
            self.sr |= DRDY;
        }
    }

    fn irq(&self) -> u32 {
        u32::from(self.cr & IE != 0 && self.sr & (DRDY | CEIS | SEIS) != 0)
    }

    fn clocks_changed(&mut self, _: &Clocks, cx: &mut Cx) {
        self.plan(cx);
    }

    fn reset(&mut self) {
        *self = Self { state: self.state, ..Self::new() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{cx::Ratio, rig::Rig};

    #[test]
    fn a_random_word_takes_forty_cycles_and_is_read_once() {
        let mut rig = Rig::new(Rng::new());
        rig.change_clocks(|clocks| {
            (clocks.hclk_hz, clocks.pll48_hz, clocks.pll48) = (144_000_000, 48_000_000, Ratio::new(3, 1));
        });
        rig.write(0, RNGEN);
        rig.run(119);
        assert_eq!((rig.read(4), rig.read(8)), (0, 0));
        rig.run(120);
        assert_eq!(rig.read(4), DRDY);
        let word = rig.read(8);
        assert_ne!(word, 0);
        assert_eq!((rig.read(4), rig.read(8)), (0, 0));
        rig.run(240);
        assert_ne!(rig.read(8), word);
    }

    #[test]
    fn without_its_clock_it_gives_an_error_and_no_word() {
        let mut rig = Rig::new(Rng::new());
        rig.write(0, RNGEN | IE);
        rig.run(100_000);
        assert_eq!(rig.read(4), CECS | CEIS);
        assert_eq!(rig.instance.irq(), 1);
    }

    #[test]
    fn a_forbidden_pllq_divider_is_reported_and_words_still_come() {
        let mut rig = Rig::new(Rng::new());
        rig.change_clocks(|clocks| {
            (clocks.hclk_hz, clocks.pll48_hz, clocks.pll48) = (180_000_000, 22_500_000, Ratio::new(8, 1));
            clocks.pll48_undefined = true;
        });
        rig.write(0, RNGEN);
        rig.run(320);
        assert_eq!(rig.read(4), DRDY);
        assert!(rig.found("PLLQ"));
    }
}
