//! External interrupts and events, RM0090 chapter 12.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `IMR` | Passes a line's pending bit to the core, 12.3.1 |
//! | `EMR` | Makes an edge (or `SWIER`) of a line an event for WFE, 12.3.2 |
//! | `RTSR`, `FTSR` | Select the edges of a line that count, rising, falling or both, 12.3.3 |
//! | `SWIER` | A written one sets the pending bit; `PR` clears it, 12.3.5 |
//! | `PR` | A written one clears the bit, 12.3.6 |
//! | Lines 0 to 15 | The pins that SYSCFG selects, 12.2.5 |
//! | Line 16 | The voltage detector's output, 12.2.5 |
//! | Lines 17, 21, 22 | The RTC's alarm, tamper and time stamp, wake-up |
//!
//! **Left out.** Lines 18, 19 and 20 (USB, Ethernet) are raised by `SWIER` only.

use cortex_m4::Width;

use crate::gpio::{lane, merge};

const LINES: u32 = 0x007F_FFFF;

#[derive(Clone, Debug, Default)]
pub(crate) struct Exti {
    imr: u32,
    emr: u32,
    rtsr: u32,
    ftsr: u32,
    swier: u32,
    pr: u32,
    levels: u32,
    /// The lines that have had an event for WFE. The part has yet to take these events.
    pub(crate) events: u32,
    /// The lines that have had a selected edge, for the ADC's triggers. The part has yet to take these edges.
    pub(crate) edges: u32,
}

impl Exti {
    pub(crate) fn reset(&mut self) {
        *self = Self { levels: self.levels, ..Self::default() };
    }

    /// Samples the lines of `mask`, whose levels are in `levels`.
    pub(crate) fn sample(&mut self, mask: u32, levels: u32) {
        let changed = (self.levels ^ levels) & mask;
        self.levels ^= changed;
        let hits = changed & levels & self.rtsr | changed & !levels & self.ftsr;
        self.hit(hits);
    }

    /// Handles an event on `lines`. The pending register shows masked lines too (RM0090 figure 41).
    fn hit(&mut self, lines: u32) {
        self.pr |= lines;
        self.events |= lines & self.emr;
        self.edges |= lines;
    }

    /// The pending lines that IMR passes to the core.
    pub(crate) fn live(&self) -> u32 {
        self.pr & self.imr
    }

    pub(crate) fn read(&self, offset: u32, width: Width) -> u32 {
        let register = match offset >> 2 {
            0 => self.imr,
            1 => self.emr,
            2 => self.rtsr,
            3 => self.ftsr,
            4 => self.swier,
            5 => self.pr,
            _ => 0,
        };
        lane(register, offset, width)
    }

    pub(crate) fn write(&mut self, offset: u32, width: Width, value: u32) {
        let merged = |old: u32| merge(old, offset, width, value) & LINES;
        match offset >> 2 {
            0 => self.imr = merged(self.imr),
            1 => self.emr = merged(self.emr),
            2 => self.rtsr = merged(self.rtsr),
            3 => self.ftsr = merged(self.ftsr),
            4 => {
                let new = merged(self.swier) | self.swier;
                let hits = new & !self.swier & (self.imr | self.emr);
                self.swier = new;
                self.hit(hits);
            }
            5 => {
                let clear = merge(0, offset, width, value);
                self.pr &= !clear;
                self.swier &= !clear;
            }
            _ => {}
        }
    }
}
