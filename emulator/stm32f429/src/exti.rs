//! External interrupts and events, RM0090 chapter 12.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `IMR` | Gates a line's pending bit to the core, 12.3.1 |
//! | `EMR` | An edge (or `SWIER`) of a line is an event for WFE, 12.3.2 |
//! | `RTSR`, `FTSR` | Edges of a line that count, either or both, 12.3.3 |
//! | `SWIER` | A one written sets the pending bit; cleared by `PR`, 12.3.5 |
//! | `PR` | Cleared by writing one, 12.3.6 |
//! | Lines 0 to 15 | The pins that SYSCFG selects, 12.2.5 |
//! | Line 16 | The voltage detector's output, 12.2.5 |
//! | Lines 17, 21, 22 | The RTC's alarm, tamper and time stamp, wake-up |
//!
//! **Left out.** Lines 18, 19 and 20 (USB, Ethernet) have no source: only `SWIER` raises them.

use cortex_m4::Width;

use crate::gpio::{lane, merge};

const LINES: u32 = 0x007F_FFFF;

/// The controller.
#[derive(Clone, Debug, Default)]
pub(crate) struct Exti {
    imr: u32,
    emr: u32,
    rtsr: u32,
    ftsr: u32,
    swier: u32,
    pr: u32,
    /// The levels of the lines as they were last.
    levels: u32,
    /// Lines that had an event for WFE; the part takes them.
    pub(crate) events: u32,
    /// Lines that had a selected edge; the part takes them, for the ADC's triggers.
    pub(crate) edges: u32,
}

impl Exti {
    /// A system reset; the lines keep their levels.
    pub(crate) fn reset(&mut self) {
        *self = Self { levels: self.levels, ..Self::default() };
    }

    /// The levels of the lines in `mask` are those of `levels`.
    pub(crate) fn sample(&mut self, mask: u32, levels: u32) {
        let changed = (self.levels ^ levels) & mask;
        self.levels ^= changed;
        let hits = changed & levels & self.rtsr | changed & !levels & self.ftsr;
        self.hit(hits);
    }

    /// The lines had an event. The pending register is before the mask in figure 41: it shows masked lines, too.
    fn hit(&mut self, lines: u32) {
        self.pr |= lines;
        self.events |= lines & self.emr;
        self.edges |= lines;
    }

    /// The pending lines that reach the core.
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
