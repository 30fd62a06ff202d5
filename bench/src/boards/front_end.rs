//! The ST25R3916 on a board: the chip's model, wired to the SPI of a microcontroller.
//!
//! The levels of the microcontroller's pins determine what the chip receives. Without a clock on the wired pin it
//! receives nothing, and a wrong clock polarity or phase shifts the bits.

use emulator_part::{Pad, Pin, SpiFrame, SpiMode};
use st25r3916_model::{AirEvent, Chip};

use crate::faults::chip::{ChipFault, ChipFaults};
use crate::faults::{Emission, FrontEndFault, RegisterBit};
use emulator_node::Input;

/// One byte or edge on the wires between the microcontroller and the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Crossing {
    /// Chip select fell (`true`) or rose.
    Select(bool),
    /// A byte to the chip and the byte from the chip, recorded at the end of their eighth clock.
    Byte(u8, u8),
    /// The chip's interrupt output rose (`true`) or fell. A fall is recorded at the end of the byte in which it occurs.
    Irq(bool),
}

/// The microcontroller's pins that are wired to the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wires {
    /// SCK, the clock.
    pub sck: Pin,
    /// MOSI, the controller's output.
    pub mosi: Pin,
    /// MISO, the controller's input.
    pub miso: Pin,
    /// Chip select, active low. A pull-up on the board keeps the chip deselected while the pin is not driven.
    pub cs: Pin,
    /// The chip's interrupt output.
    pub irq: Pin,
}

/// The front end of a board: the chip, its wires, and the recorded traffic on them.
#[derive(Clone, Debug)]
pub struct FrontEnd {
    chip: Chip,
    wires: Wires,
    emission: Emission,
    faults: ChipFaults,
    irq: (bool, Option<bool>),
    /// The recorded bytes and edges on the bus, each with its instant, ns; `None` if the traffic is not recorded.
    crossings: Option<Vec<(u64, Crossing)>>,
}

impl FrontEnd {
    /// Returns a powered front end. If `watched`, the traffic on its bus is recorded for [`FrontEnd::take_crossings`].
    #[must_use]
    pub fn new(chip: Chip, wires: Wires, watched: bool) -> Self {
        let emission = Emission::new(chip.config().seed);
        let faults = ChipFaults::default();
        Self { chip, wires, emission, faults, irq: (false, None), crossings: watched.then(Vec::new) }
    }

    fn call<T>(&mut self, at: u64, act: impl FnOnce(&mut Chip, u64) -> T) -> T {
        self.chip.advance(at);
        let now = self.chip.now();
        let answer = act(&mut self.chip, now);
        note_irq(&mut self.chip, &mut self.crossings);
        answer
    }

    /// Calls `act` on the chip at the chip's present instant.
    pub fn with<T>(&mut self, act: impl FnOnce(&mut Chip) -> T) -> T {
        self.call(self.chip.now(), |chip, _| act(chip))
    }

    /// Returns the chip for reading.
    #[must_use]
    pub fn chip(&self) -> &Chip {
        &self.chip
    }

    /// Switches the chip's supply on or off at `at` (ns).
    pub fn supply(&mut self, at: u64, on: bool) {
        self.with(|chip| if on { chip.power_on(at) } else { chip.power_off(at) });
    }

    /// Begins `fault` at `now` (ns).
    pub fn begin_fault(&mut self, now: u64, fault: FrontEndFault) {
        let carrier = self.chip.field_on();
        self.emission.begin(now, fault, carrier);
    }

    /// Ends `fault` of the front end at `now` (ns).
    pub fn end_fault(&mut self, now: u64, fault: FrontEndFault) {
        let carrier = self.chip.field_on();
        self.emission.end(now, fault, carrier);
    }

    /// Begins a fault of the chip or of a line to it.
    pub fn begin_chip_fault(&mut self, fault: ChipFault) {
        self.faults.begin(fault);
        self.chip.withhold(self.faults.withheld());
    }

    /// Ends a fault of the chip or of a line to it.
    pub fn end_chip_fault(&mut self, fault: ChipFault) {
        self.faults.end(fault);
        self.chip.withhold(self.faults.withheld());
    }

    /// Flips the bit at index `place`, modulo the number of bits, of the chip's registers at `now` (ns).
    pub fn flip(&mut self, now: u64, place: u64) {
        let bits = RegisterBit::all_of(&self.chip);
        let place = usize::try_from(place % bits.len() as u64).unwrap_or(0);
        if let Some(bit) = bits.get(place) {
            self.call(now, |chip, _| bit.flip(chip));
        }
    }

    /// Whether [`FrontEnd::take_air`] would return an event.
    #[must_use]
    pub fn has_air(&self) -> bool {
        self.chip.has_air() || self.emission.next_at() <= self.chip.now()
    }

    /// Takes the events that the antenna has emitted since the last call, each with its instant (ns).
    pub fn take_air(&mut self) -> Vec<(u64, AirEvent)> {
        let emitted: Vec<_> = self.with(|chip| chip.take_air().collect());
        let Self { chip, emission, .. } = self;
        emitted.into_iter().for_each(|(at, event)| emission.emitted(at, event));
        std::iter::from_fn(|| emission.take(chip.now())).collect()
    }

    /// Passes `event` of the air to the antenna at `at` (ns), which must not be before the instant that the chip has
    /// reached.
    pub fn hear(&mut self, at: u64, event: &AirEvent) {
        self.with(|chip| chip.hear(at, event));
    }

    /// The next instant, ns, at which the chip acts by itself or its antenna emits a delayed event.
    #[must_use]
    pub fn next_event(&self) -> u64 {
        // The bench takes all earlier events of the antenna before it advances time, so they need no wake-up.
        let held_back = Some(self.emission.next_at()).filter(|at| *at > self.chip.now());
        self.chip.next_event().unwrap_or(u64::MAX).min(held_back.unwrap_or(u64::MAX))
    }

    /// Runs the chip up to `at` (ns) and drives its interrupt output.
    pub fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        if let Some(driven) = self.call(at, |chip, _| chip.take_irq_change()) {
            self.irq.0 = driven;
        }
        let level = self.faults.irq(self.irq.0);
        if self.irq.1.replace(level) != Some(level) {
            inputs.push(Input::Level(self.wires.irq, Some(level)));
        }
    }

    /// Applies the level that the microcontroller drives on `pin` at `at` (ns).
    pub fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        let selected = pad == Pad::Driven(false);
        if pin != self.wires.cs || selected == self.chip.is_selected() {
            return;
        }
        let at = if selected { at } else { at + self.emission.select_late() };
        self.faults.select();
        self.call(at, if selected { Chip::select } else { Chip::deselect });
        note(&mut self.crossings, at, Crossing::Select(selected));
    }

    /// Whether the microcontroller clocks this SPI frame on the SCK wire of the front end.
    #[must_use]
    pub fn is_clocked_by(&self, frame: &SpiFrame) -> bool {
        frame.sck.contains(&Some(self.wires.sck))
    }

    /// Clocks an SPI frame of the part from `begins` to `ends` (ns). Returns the bits on MISO. Returns `None` if the
    /// chip does not drive MISO, or drives another pin than the part reads.
    pub fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        let Wires { mosi, miso, .. } = self.wires;
        if !self.chip.is_selected() || !self.is_clocked_by(frame) {
            return self.faults.miso(None);
        }
        let mode = match frame.mode {
            SpiMode::Mode0 => st25r3916_model::SpiMode::Mode0,
            SpiMode::Mode1 => st25r3916_model::SpiMode::Mode1,
            SpiMode::Mode2 => st25r3916_model::SpiMode::Mode2,
            SpiMode::Mode3 => st25r3916_model::SpiMode::Mode3,
        };
        // The chip's pull-down holds an undriven MOSI low.
        let [to_chip, from_chip] = self.faults.glitch();
        let mosi = if frame.mosi.contains(&Some(mosi)) { frame.data } else { 0 } ^ to_chip;
        let from_chip = from_chip ^ self.faults.misread(mosi as u8);
        let clocked = st25r3916_model::SpiFrame { begins_ns: begins, ends_ns: ends, mode, bits: frame.bits, mosi };
        let Self { chip, crossings, .. } = self;
        let answer = chip.clock_frame(&clocked, |chip, at, taken, given| {
            note_irq(chip, crossings);
            note(crossings, at, Crossing::Byte(taken, given));
        });
        note_irq(&mut self.chip, &mut self.crossings);
        let answer = (frame.miso == Some(miso)).then_some(answer).map(|answer| answer ^ from_chip);
        self.faults.miso(answer)
    }

    /// Takes the instants, ns, at which chip select rose after a transmit command. The firmware controls this edge, at
    /// which the chip carries out the command.
    pub fn take_transmits(&mut self) -> Vec<u64> {
        let mut transmits = self.chip.take_transmits();
        transmits.extend(self.emission.take_commands());
        transmits
    }

    /// Takes the bytes and edges on the bus that were recorded since the last call, each with its instant, ns.
    pub fn take_crossings(&mut self) -> Vec<(u64, Crossing)> {
        self.crossings.as_mut().map(std::mem::take).unwrap_or_default()
    }
}

fn note(crossings: &mut Option<Vec<(u64, Crossing)>>, at: u64, crossing: Crossing) {
    if let Some(crossings) = crossings {
        crossings.push((at, crossing));
    }
}

/// Records the edges of the chip's interrupt output. An edge may lie slightly in the past.
fn note_irq(chip: &mut Chip, crossings: &mut Option<Vec<(u64, Crossing)>>) {
    if chip.has_irq_edges() {
        for edge in chip.take_irq_edges() {
            note(crossings, edge.at_ns, Crossing::Irq(edge.level));
        }
    }
}

#[cfg(test)]
mod tests {
    use st25r3916_model::Config;

    use super::*;

    #[test]
    fn a_flip_acts_at_its_own_instant() {
        let pin = |bit| Pin::new(0, bit);
        let wires = Wires { sck: pin(0), mosi: pin(1), miso: pin(2), cs: pin(3), irq: pin(4) };
        let mut front_end = FrontEnd::new(Chip::new(Config::default()), wires, false);
        front_end.flip(1_000_000, 0);
        assert_eq!(front_end.chip().now(), 1_000_000);
    }
}
