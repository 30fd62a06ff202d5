//! The two boards: what is wired to each part.
//!
//! | | HORUS: NUCLEO-F429ZI | DPR: nRF52840-DK |
//! |---|---|---|
//! | front end: SCK, MISO, MOSI | PA5, PA6, PA7 (SPI1) | P1.15, P1.14, P1.13 |
//! | front end: chip select, IRQ | PD14, PA3 | P1.12, P0.03 |
//! | receivers 1 to 5 | PD6, PC7, PC11, PD2, PE7 | – |
//! | SSI: SCK, MOSI, MISO, CSN, FRESH | – | P1.01, P1.02, P1.03, P1.04, P1.05 |

use std::collections::VecDeque;

use bench_seam::{Pad, Pin, SpiFrame, SpiMode, UartFrame};
use cortex_m4::Cost;
use horus_tx_fw::timing::GNSS_BAUD;
use nrf52840::{Nrf52840, SsiWires};
use st25r3916_model::Chip;
use stm32f429::{Stm32f429, pin};

use super::front_end::{FrontEnd, Wires};
use crate::engine::{Board, Input, Node};

/// The SSI's wires at the DPR.
pub const SSI: SsiWires =
    SsiWires { sck: Pin::new(1, 1), mosi: Pin::new(1, 2), miso: Pin::new(1, 3), csn: Pin::new(1, 4) };
/// Where the DPR announces a new image.
pub const FRESH: Pin = Pin::new(1, 5);
/// The front end's wires at the DPR.
const DPR_FRONT_END: Wires = Wires {
    sck: Pin::new(1, 15),
    mosi: Pin::new(1, 13),
    miso: Pin::new(1, 14),
    cs: Pin::new(1, 12),
    irq: Pin::new(0, 3),
};
/// The front end's wires on the HORUS side.
const HORUS_FRONT_END: Wires =
    Wires { sck: pin('A', 5), mosi: pin('A', 7), miso: pin('A', 6), cs: pin('D', 14), irq: pin('A', 3) };
/// Where the lines of receivers 1 to 5 arrive.
const RECEIVER_PINS: [Pin; 5] = [pin('D', 6), pin('C', 7), pin('C', 11), pin('D', 2), pin('E', 7)];
/// The 10 ms timer: TIM2.
const CYCLE_TIMER: usize = 2;

/// The wire from a receiver: bytes wait here until the line takes them, back to back.
#[derive(Clone, Debug)]
struct Line {
    pin: Pin,
    waiting: VecDeque<u8>,
    /// When the line is free again, ns.
    free_at: u64,
    frame_ns: u64,
}

/// The HORUS side.
#[derive(Clone, Debug)]
pub struct Horus {
    /// The front end.
    pub front_end: FrontEnd,
    lines: Vec<Line>,
    /// The least of the lines' next instants.
    next_byte: u64,
    /// The lines rest high, which the part was told.
    powered: bool,
    /// How many updates of the cycle timer were seen.
    updates: u64,
    ticks: Vec<u64>,
}

impl Horus {
    /// The board with so many receivers, of which none sends yet.
    #[must_use]
    pub fn new(chip: Chip, receivers: usize, watched: bool) -> Self {
        let frame_ns = UartFrame::eight_n_one(0, GNSS_BAUD).ns();
        let line = |&pin| Line { pin, waiting: VecDeque::new(), free_at: 0, frame_ns };
        Self {
            front_end: FrontEnd::new(chip, HORUS_FRONT_END, watched),
            lines: RECEIVER_PINS.iter().take(receivers).map(line).collect(),
            next_byte: u64::MAX,
            powered: false,
            updates: 0,
            ticks: vec![],
        }
    }

    /// Receiver `index` (from 0) begins to send these bytes at `at` (ns), or when it has sent what it sends then.
    pub fn send(&mut self, at: u64, index: usize, bytes: &[u8]) {
        let Some(line) = self.lines.get_mut(index) else { return };
        if line.waiting.is_empty() {
            line.free_at = line.free_at.max(at);
        }
        line.waiting.extend(bytes);
        self.plan();
    }

    fn plan(&mut self) {
        let sending = self.lines.iter().filter(|line| !line.waiting.is_empty());
        self.next_byte = sending.map(|line| line.free_at).min().unwrap_or(u64::MAX);
    }

    /// The 10 ms timer's ticks since the last call: each the instant TIM2's update flag rose, in ns.
    pub fn take_ticks(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.ticks)
    }
}

impl Board for Horus {
    type Part = Stm32f429;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        self.front_end.pin(at, pin, pad);
    }

    fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        self.front_end.spi(begins, ends, frame)
    }

    fn next_event(&self) -> u64 {
        self.front_end.next_event().min(self.next_byte)
    }

    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        if !self.powered {
            self.powered = true;
            inputs.extend(self.lines.iter().map(|line| Input::Level(line.pin, Some(true))));
        }
        self.front_end.settle(at, inputs);
        if at >= self.next_byte {
            for line in &mut self.lines {
                while line.free_at <= at
                    && let Some(byte) = line.waiting.pop_front()
                {
                    let frame = UartFrame::eight_n_one(byte, GNSS_BAUD);
                    inputs.push(Input::Frame(line.pin, line.free_at, frame));
                    line.free_at += line.frame_ns;
                }
            }
            self.plan();
        }
    }

    fn outgoing(&self) -> bool {
        self.front_end.has_air()
    }

    fn watch(&mut self, at: impl FnOnce() -> u64, part: &Stm32f429) {
        let updates = part.timer_updates(CYCLE_TIMER);
        if updates != self.updates {
            self.updates = updates;
            self.ticks.push(at());
        }
    }
}

/// The DPR.
#[derive(Clone, Debug)]
pub struct Dpr {
    /// The front end.
    pub front_end: FrontEnd,
    powered: bool,
    fresh: bool,
    fresh_changes: Vec<(u64, bool)>,
}

impl Dpr {
    /// The board, with nobody selected on its SSI.
    #[must_use]
    pub fn new(chip: Chip, watched: bool) -> Self {
        Self {
            front_end: FrontEnd::new(chip, DPR_FRONT_END, watched),
            powered: false,
            fresh: false,
            fresh_changes: vec![],
        }
    }

    /// The levels that FRESH took since the last call, each with its instant, ns.
    pub fn take_fresh(&mut self) -> Vec<(u64, bool)> {
        std::mem::take(&mut self.fresh_changes)
    }
}

impl Board for Dpr {
    type Part = Nrf52840;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        if pin == FRESH && pad.level() != self.fresh {
            self.fresh = pad.level();
            self.fresh_changes.push((at, self.fresh));
        }
        self.front_end.pin(at, pin, pad);
    }

    fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        self.front_end.spi(begins, ends, frame)
    }

    fn next_event(&self) -> u64 {
        self.front_end.next_event()
    }

    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        if !self.powered {
            self.powered = true;
            inputs.push(Input::Level(SSI.csn, Some(true)));
        }
        self.front_end.settle(at, inputs);
    }

    fn outgoing(&self) -> bool {
        self.front_end.has_air()
    }
}

/// The flight controller's end of the SSI.
impl<C: Cost> Node<Dpr, C> {
    /// Chip select falls now.
    pub fn ssi_select(&mut self) {
        self.input(|part, view, at| part.ssi_select(at, SSI.csn, view));
    }

    /// Eight clocks in mode 0 have brought `mosi`; the last ends at `ends` (ns), which the board may have passed by a
    /// few bytes. Answers what MISO carried: its pull-up's ones where nobody drives it.
    pub fn ssi_clock(&mut self, ends: u64, mosi: u8) -> u8 {
        let at = self.cycle_at(ends);
        self.input(|part, view, _| part.ssi_clock(at, mosi, SpiMode::Mode0, view)).unwrap_or(0xFF)
    }

    /// The bytes of `mosi` have been clocked in mode 0, one after the other: the first ended at `first`, the last at
    /// `last` (ns). Answers what MISO carried.
    pub fn ssi_exchange(&mut self, first: u64, last: u64, mosi: &[u8]) -> Vec<u8> {
        let (first, last) = (self.cycle_at(first), self.cycle_at(last));
        let gaps = mosi.len().saturating_sub(1).max(1) as u64;
        let mut miso = vec![0xFF; mosi.len()];
        self.input(|part, view, _| {
            part.ssi_exchange(first, ((last - first) << 16) / gaps, SpiMode::Mode0, mosi, &mut miso, view);
        });
        miso
    }

    /// Chip select rises now.
    pub fn ssi_deselect(&mut self) {
        self.input(|part, view, at| part.ssi_deselect(at, SSI.csn, view));
    }
}
