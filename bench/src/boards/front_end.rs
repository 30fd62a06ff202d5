//! The ST25R3916 on a board: the chip's model on the SPI bus of a part.
//!
//! What the part does to the pins decides what the chip sees: a clock that no pin carries clocks nothing, and a clock
//! of another polarity or phase shifts bits. What the chip is and has done it knows itself; here are the wires, and a
//! watch on them for a trace.

use emulator_part::{Pad, Pin, SpiFrame, SpiMode};
use st25r3916_model::{AirEvent, Chip};

use crate::faults::chip::{ChipFault, ChipFaults};
use crate::faults::{Emission, FrontEndFault, RegisterBit};
use emulator_node::Input;

/// A byte that crossed between the part and the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Crossing {
    /// Chip select fell (`true`) or rose.
    Select(bool),
    /// Controller to chip, chip to controller; the eighth clock ended at the crossing's instant.
    Byte(u8, u8),
    /// The interrupt output rose (`true`) or fell. It falls inside the byte that clears it, which is noted at its end.
    Irq(bool),
}

/// The part's pins that the chip is wired to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wires {
    /// Clock.
    pub sck: Pin,
    /// Controller out.
    pub mosi: Pin,
    /// Controller in.
    pub miso: Pin,
    /// Chip select, active low, with a pull-up on the board: a pin that nobody drives selects nothing.
    pub cs: Pin,
    /// The chip's interrupt output.
    pub irq: Pin,
}

/// The chip, the wires to it, and what somebody wants to know of them.
#[derive(Clone, Debug)]
pub struct FrontEnd {
    chip: Chip,
    wires: Wires,
    /// What leaves the antenna.
    emission: Emission,
    /// What is wrong with the chip and with the lines to it.
    faults: ChipFaults,
    /// The level that the chip drives on its interrupt output, and the one that the board was told last.
    irq: (bool, Option<bool>),
    /// What crossed, while somebody wants to know.
    crossings: Option<Vec<(u64, Crossing)>>,
}

impl FrontEnd {
    /// A chip, powered from the start of the run. `watched` keeps what crosses the bus for
    /// [`FrontEnd::take_crossings`].
    #[must_use]
    pub fn new(chip: Chip, wires: Wires, watched: bool) -> Self {
        let emission = Emission::new(chip.config().seed);
        let faults = ChipFaults::default();
        Self { chip, wires, emission, faults, irq: (false, None), crossings: watched.then(Vec::new) }
    }

    /// The chip has come to `at`, and `act` looks at it or acts on it there.
    fn call<T>(&mut self, at: u64, act: impl FnOnce(&mut Chip, u64) -> T) -> T {
        self.chip.advance(at);
        let now = self.chip.now();
        let answer = act(&mut self.chip, now);
        note_irq(&mut self.chip, &mut self.crossings);
        answer
    }

    /// Looks at or acts on the chip, where it stands.
    pub fn with<T>(&mut self, act: impl FnOnce(&mut Chip) -> T) -> T {
        self.call(self.chip.now(), |chip, _| act(chip))
    }

    /// The chip, to read.
    #[must_use]
    pub fn chip(&self) -> &Chip {
        &self.chip
    }

    /// This is wrong with it from `now` (ns) on.
    pub fn begin_fault(&mut self, now: u64, fault: FrontEndFault) {
        let carrier = self.chip.field_on();
        self.emission.begin(now, fault, carrier);
    }

    /// This is wrong with it no longer from `now` (ns) on.
    pub fn end_fault(&mut self, now: u64, fault: FrontEndFault) {
        let carrier = self.chip.field_on();
        self.emission.end(now, fault, carrier);
    }

    /// This is wrong with the chip, or a line to it, from now on.
    pub fn begin_chip_fault(&mut self, fault: ChipFault) {
        self.faults.begin(fault);
        self.chip.withhold(self.faults.withheld());
    }

    /// This is wrong no longer.
    pub fn end_chip_fault(&mut self, fault: ChipFault) {
        self.faults.end(fault);
        self.chip.withhold(self.faults.withheld());
    }

    /// A bit of the chip's registers flips: the one at `place` of all that it has, counted round.
    pub fn flip(&mut self, place: u64) {
        let bits = RegisterBit::all_of(&self.chip);
        let place = usize::try_from(place % bits.len() as u64).unwrap_or(0);
        if let Some(bit) = bits.get(place) {
            self.with(|chip| bit.flip(chip));
        }
    }

    /// Whether the antenna has emitted something that was not taken.
    #[must_use]
    pub fn has_air(&self) -> bool {
        self.chip.has_air() || self.emission.next_at() <= self.chip.now()
    }

    /// What the antenna emitted, each with its instant (ns).
    pub fn take_air(&mut self) -> Vec<(u64, AirEvent)> {
        let emitted: Vec<_> = self.with(|chip| chip.take_air().collect());
        let Self { chip, emission, .. } = self;
        emitted.into_iter().for_each(|(at, event)| emission.emitted(at, event));
        std::iter::from_fn(|| emission.take(chip.now())).collect()
    }

    /// `event` reaches the antenna at `at` (ns), which the chip may not have reached yet.
    pub fn hear(&mut self, at: u64, event: &AirEvent) {
        self.with(|chip| chip.hear(at, event));
    }

    /// When the chip next acts by itself, or its antenna emits what was held back, ns.
    #[must_use]
    pub fn next_event(&self) -> u64 {
        // What has left is taken before time goes on.
        let held_back = Some(self.emission.next_at()).filter(|at| *at > self.chip.now());
        self.chip.next_event().unwrap_or(u64::MAX).min(held_back.unwrap_or(u64::MAX))
    }

    /// The chip acts up to `at`, and its interrupt output is driven.
    pub fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        if let Some(driven) = self.call(at, |chip, _| chip.take_irq_change()) {
            self.irq.0 = driven;
        }
        let level = self.faults.irq(self.irq.0);
        if self.irq.1.replace(level) != Some(level) {
            inputs.push(Input::Level(self.wires.irq, Some(level)));
        }
    }

    /// The part does something to `pin` at `at` (ns).
    pub fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        let selected = pad == Pad::Driven(false);
        if pin != self.wires.cs || selected == self.chip.is_selected() {
            return;
        }
        let at = if selected { at } else { at + self.emission.select_late() };
        self.call(at, if selected { Chip::select } else { Chip::deselect });
        note(&mut self.crossings, at, Crossing::Select(selected));
    }

    /// The part clocks a frame from `begins` to `ends` (ns). Answers what MISO carried; `None` where the chip does not
    /// drive it, or not to where the part reads.
    pub fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        let Wires { sck, mosi, miso, .. } = self.wires;
        if !self.chip.is_selected() || !frame.sck.contains(&Some(sck)) {
            return self.faults.miso(None);
        }
        let mode = match frame.mode {
            SpiMode::Mode0 => st25r3916_model::SpiMode::Mode0,
            SpiMode::Mode1 => st25r3916_model::SpiMode::Mode1,
            SpiMode::Mode2 => st25r3916_model::SpiMode::Mode2,
            SpiMode::Mode3 => st25r3916_model::SpiMode::Mode3,
        };
        // A line that the part does not drive rests low, by the chip's own pull-down.
        let mosi = if frame.mosi.contains(&Some(mosi)) { frame.data } else { 0 };
        let clocked = st25r3916_model::SpiFrame { begins_ns: begins, ends_ns: ends, mode, bits: frame.bits, mosi };
        let Self { chip, crossings, .. } = self;
        let answer = chip.clock_frame(&clocked, |chip, at, taken, given| {
            note_irq(chip, crossings);
            note(crossings, at, Crossing::Byte(taken, given));
        });
        note_irq(&mut self.chip, &mut self.crossings);
        let answer = (frame.miso == Some(miso)).then_some(answer);
        self.faults.miso(answer)
    }

    /// The transfers since the last call that held a command to transmit: each the instant chip select rose, ns. The
    /// chip acts on a command from there on, so this is the last instant that the firmware answers for.
    pub fn take_transmits(&mut self) -> Vec<u64> {
        let mut transmits = self.chip.take_transmits();
        transmits.extend(self.emission.take_commands());
        transmits
    }

    /// What crossed the bus since the last call; nothing unless watched.
    pub fn take_crossings(&mut self) -> Vec<(u64, Crossing)> {
        self.crossings.as_mut().map(std::mem::take).unwrap_or_default()
    }
}

/// Something crosses at `at`.
fn note(crossings: &mut Option<Vec<(u64, Crossing)>>, at: u64, crossing: Crossing) {
    if let Some(crossings) = crossings {
        crossings.push((at, crossing));
    }
}

/// What the interrupt output did. It falls inside the byte that clears it, so an edge may lie before the chip's
/// present.
fn note_irq(chip: &mut Chip, crossings: &mut Option<Vec<(u64, Crossing)>>) {
    if chip.has_irq_edges() {
        for edge in chip.take_irq_edges() {
            note(crossings, edge.at_ns, Crossing::Irq(edge.level));
        }
    }
}
