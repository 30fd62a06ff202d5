//! The timers TIM1 to TIM14 (RM0090 chapters 17 to 20).
//!
//! | Module | Covers | Manual |
//! |---|---|---|
//! | `counter` | up, down, centre-aligned, 16 and 32 bits; `PSC`, `ARR`, `RCR` with preload | 17.3.1 to 17.3.3 |
//! | `counter` | `UG`, `UDIS`, `URS`, `OPM`; the count begins one timer clock after `CEN` | 17.3.2, 17.3.4 |
//! | `compare` | flags, output modes 0 to 7 | 17.3.8 to 17.3.10 |
//! | `capture` | source, edge, prescaler, over-capture | 17.3.5, 17.3.6 |
//! | `triggers` | encoder, reset, gated, trigger, external clocks 1 and 2 | 17.3.16, 17.3.20 |
//! | `triggers` | triggers between timers | 17.3.20 |
//! | `outputs` | `CCxE`, `CCxP`, `CCxNE`, `CCxNP`, `MOE` | 17.3.11 |
//! | `outputs` | break input: flag, `MOE` cleared, `AOE` | 17.3.12 |
//! | `outputs` | dead time (`DTG`, `CKD`) after each edge of a reference with both outputs enabled | 17.3.11 |
//! | `registers` | what each register stores and does; DMA bursts through `DCR` and `DMAR` | 17.4, 18.4, 19.4, 20.4 |
//!
//! **Left out, each a finding when it is set up:** the commutation event (`CCPC`, `COMG`), the external clear of a
//! reference (`OCxCE`), the option registers, the gated mode on another timer's trigger, `LOCK`. The outputs take their
//! idle levels without a dead time. The input filters count as off.
//!
//! # Time
//!
//! The counter's value is computed from the timer clock cycles since the last access. Only effects that others can
//! observe (an interrupt, a DMA request, a pin, another timer) are events. Flags are brought up to date when they are
//! read. A compare flag rises in the timer clock cycle in which the counter takes the compare value. A compare value
//! that is written while the counter equals it matches when the counter next takes it.

mod capture;
mod compare;
mod counter;
mod outputs;
mod registers;
#[cfg(test)]
mod tests;
mod triggers;

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, NEVER};

use crate::cx::{Clocks, Cx, Peripheral, Signal, TimPin, Trigger, Wires};
use outputs::Outputs;
use triggers::internal_triggers;

const CEN: u32 = 1 << 0;
const UDIS: u32 = 1 << 1;
const URS: u32 = 1 << 2;
const OPM: u32 = 1 << 3;
const DIR: u32 = 1 << 4;
const ARPE: u32 = 1 << 7;
/// CR2.CCDS: channels make their DMA requests at the update.
const CCDS: u32 = 1 << 3;
/// CR2.TI1S: the first input is the exclusive or of three pins.
const TI1S: u32 = 1 << 7;
const UIF: u32 = 1 << 0;
const TIF: u32 = 1 << 6;
const BIF: u32 = 1 << 7;
const UDE: u32 = 1 << 8;
const TDE: u32 = 1 << 14;
const MOE: u32 = 1 << 15;
const AOE: u32 = 1 << 14;
const BKP: u32 = 1 << 13;
const BKE: u32 = 1 << 12;
/// SMCR.ECE: the external trigger input clocks the counter.
const ECE: u32 = 1 << 14;
/// SMCR.ETP: the external trigger is inverted.
const ETP: u32 = 1 << 15;

/// The interrupt outputs of TIM1 and TIM8, see [`Peripheral::irq`].
const IRQ_BREAK: u32 = 1 << 0;
const IRQ_UPDATE: u32 = 1 << 1;
const IRQ_TRIGGER: u32 = 1 << 2;
const IRQ_CHANNELS: u32 = 1 << 3;

/// The DMA requests, see [`Peripheral::dma`]. Channel n has bit n.
const DMA_UPDATE: u32 = 1 << 0;
const DMA_TRIGGER: u32 = 1 << 5;

/// The index of the external trigger among the inputs. Channels 1 to 4 are inputs 0 to 3.
const INPUT_ETR: usize = 4;
const INPUT_BREAK: usize = 5;

/// The features of a timer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Kind {
    number: u8,
    channels: u8,
    largest: u32,
    /// Whether the timer has repetition, break and complementary outputs (TIM1 and TIM8).
    advanced: bool,
    downward: bool,
    slave: bool,
}

impl Kind {
    const fn of(number: u8) -> Self {
        let (channels, largest) = match number {
            2 | 5 => (4, u32::MAX),
            1 | 3 | 4 | 8 => (4, 0xFFFF),
            9 | 12 => (2, 0xFFFF),
            6 | 7 => (0, 0xFFFF),
            _ => (1, 0xFFFF),
        };
        Self {
            number,
            channels,
            largest,
            advanced: matches!(number, 1 | 8),
            downward: matches!(number, 1..=5 | 8),
            slave: matches!(number, 1..=5 | 8 | 9 | 12),
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Tim {
    kind: Kind,
    cr1: u32,
    cr2: u32,
    smcr: u32,
    dier: u32,
    sr: u32,
    ccmr: [u32; 2],
    ccer: u32,
    bdtr: u32,
    dcr: u32,
    or: u32,
    /// The registers as software wrote them. The values in force are in the fields named `_now`.
    psc: u32,
    arr: u32,
    rcr: u32,
    ccr: [u32; 4],
    psc_now: u32,
    arr_now: u32,
    ccr_now: [u32; 4],
    repeat: u32,

    div: u64,
    /// The timer clock cycle up to which the counter and the other fields have been calculated.
    tick: u64,
    prescale: u32,
    cnt: u32,
    down: bool,
    reference: [bool; 4],
    /// The levels of the inputs: channels 1 to 4, ETR and break.
    inputs: [bool; 6],
    gate: bool,
    /// The number of edges that each input prescaler has counted: channels 1 to 4 and ETR.
    edges: [u8; 5],
    requests: u32,
    burst_left: u32,
    burst_next: u32,
    /// The number of rising edges of the trigger output that have not been reported yet.
    trigger_pulses: u8,
    trigger_level: bool,
    told: Outputs,
    told_references: u8,
    told_level: bool,
    /// The cycle at which each complementary pair's dead time ends; `NEVER` if no dead time runs.
    dead_until: [Cycle; 3],
    dead_references: u8,
    due: Cycle,
}

impl Tim {
    pub(crate) fn new(number: u8) -> Self {
        let kind = Kind::of(number);
        Self {
            kind,
            cr1: 0,
            cr2: 0,
            smcr: 0,
            dier: 0,
            sr: 0,
            ccmr: [0; 2],
            ccer: 0,
            bdtr: 0,
            dcr: 0,
            or: 0,
            psc: 0,
            arr: kind.largest,
            rcr: 0,
            ccr: [0; 4],
            psc_now: 0,
            arr_now: kind.largest,
            ccr_now: [0; 4],
            repeat: 0,
            div: 1,
            tick: 0,
            prescale: 0,
            cnt: 0,
            down: false,
            reference: [false; 4],
            inputs: [false; 6],
            gate: false,
            edges: [0; 5],
            requests: 0,
            burst_left: 0,
            burst_next: 0,
            trigger_pulses: 0,
            trigger_level: false,
            told: Outputs::default(),
            told_references: 0,
            told_level: false,
            dead_until: [NEVER; 3],
            dead_references: 0,
            due: NEVER,
        }
    }

    #[inline]
    fn centre(&self) -> bool {
        self.kind.downward && self.cr1 & 0x60 != 0
    }

    #[inline]
    fn slave_mode(&self) -> u32 {
        if self.kind.slave { self.smcr & 7 } else { 0 }
    }

    #[inline]
    fn trigger_source(&self) -> u32 {
        self.smcr >> 4 & 7
    }

    #[inline]
    fn counting(&self) -> bool {
        self.cr1 & CEN != 0
            && self.smcr & ECE == 0
            && match self.slave_mode() {
                0 | 4 | 6 => true,
                5 => self.gate,
                _ => false,
            }
    }

    #[inline]
    fn channels(&self) -> usize {
        usize::from(self.kind.channels)
    }

    /// The channel's eight bits of CCMRx.
    #[inline]
    fn mode_byte(&self, channel: usize) -> u32 {
        self.ccmr[channel / 2] >> (8 * (channel % 2)) & 0xFF
    }

    #[inline]
    fn is_input(&self, channel: usize) -> bool {
        self.mode_byte(channel) & 3 != 0
    }

    #[inline]
    fn enabled(&self, channel: usize) -> bool {
        self.ccer >> (4 * channel) & 1 != 0
    }

    #[inline]
    fn any_output(&self, channel: usize) -> bool {
        !self.is_input(channel) && self.ccer >> (4 * channel) & 5 != 0
    }

    /// Raises a DMA request. If a burst belongs to the request, the burst begins.
    #[inline]
    fn request(&mut self, line: u32) {
        self.requests |= line;
        self.burst_left = self.dcr >> 8 & 0x1F;
        self.burst_next = 0;
    }
}

impl Peripheral for Tim {
    fn read(&mut self, offset: u32, _: Width, cx: &mut Cx) -> u32 {
        self.sync(cx.now);
        self.read_register(offset & !3, cx) >> (8 * (offset & 3))
    }

    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx) {
        self.sync(cx.now);
        self.write_register(offset & !3, crate::lanes(width, value), cx);
        self.finish(cx);
    }

    fn peek(&self, offset: u32, cx: &mut Cx) -> u32 {
        let mut copy = self.clone();
        copy.sync(cx.now);
        match offset & !3 {
            0x4C => 0,
            offset => copy.read_register(offset, cx),
        }
    }

    fn due(&self) -> Cycle {
        self.due
    }

    fn advance<W: Wires>(&mut self, cx: &mut Cx, _: &mut W) {
        self.sync(cx.now);
        self.finish(cx);
    }

    fn irq(&self) -> u32 {
        let on = self.sr & self.dier & 0xFF;
        if on == 0 || !self.kind.advanced {
            return u32::from(on != 0);
        }
        let mut lines = 0;
        for (flags, line) in [(UIF, IRQ_UPDATE), (0x1E, IRQ_CHANNELS), (0x60, IRQ_TRIGGER), (BIF, IRQ_BREAK)] {
            if on & flags != 0 {
                lines |= line;
            }
        }
        lines
    }

    fn dma(&self) -> u32 {
        self.requests
    }

    fn dma_served(&mut self, bit: u8, _: u32, _: &mut Cx) {
        if self.burst_left == 0 {
            self.requests &= !(1 << bit);
        } else {
            self.burst_left -= 1;
        }
    }

    fn clocks_changed(&mut self, _: &Clocks, cx: &mut Cx) {
        self.sync(cx.now);
        // A counter that was just enabled starts one clock later, and this delay is kept.
        let ahead = self.tick - self.ticks(cx.now);
        self.div = u64::from(if matches!(self.kind.number, 1 | 8..=11) { cx.clocks.tim2 } else { cx.clocks.tim1 });
        self.tick = self.ticks(cx.now) + ahead;
        self.plan();
    }

    fn reset(&mut self) {
        let (inputs, div) = (self.inputs, self.div);
        *self = Self { inputs, div, ..Self::new(self.kind.number) };
    }

    fn input(&mut self, signal: Signal, level: bool, cx: &mut Cx) {
        let Signal::Tim(_, pin) = signal else { return };
        let input = match pin {
            TimPin::Ch1 => 0,
            TimPin::Ch2 => 1,
            TimPin::Ch3 => 2,
            TimPin::Ch4 => 3,
            TimPin::Etr => INPUT_ETR,
            TimPin::Bkin => INPUT_BREAK,
            TimPin::Ch1N | TimPin::Ch2N | TimPin::Ch3N => return,
        };
        self.input_changed(input, level, cx);
    }

    fn trigger(&mut self, trigger: Trigger, cx: &mut Cx) {
        if trigger == Trigger::ClockFailure {
            // BKE enables the break pin and the clock security system (RM0090 17.4.18).
            if self.kind.advanced && self.bdtr & BKE != 0 {
                self.sync(cx.now);
                self.bdtr &= !MOE;
                self.sr |= BIF;
                self.finish(cx);
            }
            return;
        }
        let source = self.trigger_source() as usize;
        let Some(masters) = internal_triggers(self.kind.number).filter(|_| source < 4) else { return };
        let used = match trigger {
            Trigger::Trgo(number) => number == masters[source] && number < 10,
            Trigger::Compare(number, 1) => number == masters[source] && number >= 10,
            _ => false,
        };
        if used && self.slave_mode() != 5 {
            self.sync(cx.now);
            self.trigger_edge(true, cx.now);
            self.trigger_edge(false, cx.now);
            self.finish(cx);
        }
    }
}
