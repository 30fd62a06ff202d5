//! The ST25R3916 on a board: the chip's model on the SPI bus of a part.
//!
//! What the part does to the pins decides what the chip sees: a clock that no pin carries clocks nothing, and a clock
//! of another polarity or phase shifts bits. The chip's own mode is 1 (DS13541, SPI interface: idle low, both sides
//! sample on the falling edge).

use bench_seam::{Pad, Pin, SpiFrame, SpiMode};
use st25r3916_model::{AirEvent, Chip};

use crate::engine::Input;

/// Transmit with CRC, the command that sends a frame (DS13541, Direct commands).
const TRANSMIT: u8 = 0xC4;

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

/// The chip and what passes between it and its part.
#[derive(Clone, Debug)]
pub struct FrontEnd {
    chip: Chip,
    wires: Wires,
    /// The chip was last called at this instant.
    now: u64,
    selected: bool,
    /// What the interrupt output was last driven to.
    irq: Option<bool>,
    /// What crossed, while somebody wants to know.
    crossings: Option<Vec<(u64, Crossing)>>,
    /// The first byte since chip select fell.
    first_byte: Option<u8>,
    /// When chip select rose after a transmit command.
    transmits: Vec<u64>,
    /// The clock of the last frame, Hz.
    clock_hz: u32,
    /// Bits and length (ns) of the last frame: another of the same is clocked at the same rate.
    last_span: (u8, u64),
    /// The last bit on each data line before this frame: what a clock of another phase finds there.
    last_bits: (bool, bool),
}

impl FrontEnd {
    /// A chip, powered from the start of the run. `watched` keeps what crosses the bus for
    /// [`FrontEnd::take_crossings`].
    #[must_use]
    pub fn new(chip: Chip, wires: Wires, watched: bool) -> Self {
        Self {
            chip,
            wires,
            now: 0,
            selected: false,
            irq: None,
            crossings: watched.then(Vec::new),
            first_byte: None,
            transmits: vec![],
            clock_hz: 0,
            last_span: (0, 0),
            last_bits: (false, false),
        }
    }

    /// The chip has come to `at` and `act` looks at it or acts on it there.
    fn call<T>(&mut self, at: u64, act: impl FnOnce(&mut Chip, u64) -> T) -> T {
        self.now = self.now.max(at);
        self.chip.advance(self.now);
        let answer = act(&mut self.chip, self.now);
        if self.chip.has_irq_edges() {
            // The pin falls inside the byte that clears it, so an edge may lie before this call's instant.
            let edges: Vec<_> = self.chip.take_irq_edges().collect();
            for edge in edges {
                self.note(edge.at_ns, Crossing::Irq(edge.level));
            }
        }
        answer
    }

    /// Looks at or acts on the chip, where it stands.
    pub fn with<T>(&mut self, act: impl FnOnce(&mut Chip) -> T) -> T {
        self.call(self.now, |chip, _| act(chip))
    }

    /// The chip, to read.
    #[must_use]
    pub fn chip(&self) -> &Chip {
        &self.chip
    }

    /// Whether the chip has emitted something that was not taken.
    #[must_use]
    pub fn has_air(&self) -> bool {
        self.chip.has_air()
    }

    /// What the chip emitted, each with its instant (ns).
    pub fn take_air(&mut self) -> Vec<(u64, AirEvent)> {
        self.with(|chip| chip.take_air().collect())
    }

    /// `event` reaches the antenna at `at` (ns), which the chip may not have reached yet.
    pub fn hear(&mut self, at: u64, event: &AirEvent) {
        self.with(|chip| chip.hear(at, event));
    }

    /// When the chip next acts by itself, ns.
    #[must_use]
    pub fn next_event(&self) -> u64 {
        self.chip.next_event().unwrap_or(u64::MAX)
    }

    /// The chip acts up to `at`, and its interrupt output is driven.
    pub fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        if at >= self.next_event() {
            self.call(at, |_, _| {});
        }
        self.now = self.now.max(at);
        let irq = self.chip.irq();
        if self.irq.replace(irq) != Some(irq) {
            inputs.push(Input::Level(self.wires.irq, Some(irq)));
        }
    }

    /// The part does something to `pin` at `at` (ns).
    pub fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        let selected = pad == Pad::Driven(false);
        if pin != self.wires.cs || selected == self.selected {
            return;
        }
        self.selected = selected;
        if selected {
            self.call(at, Chip::select);
            self.first_byte = None;
        } else {
            self.call(at, Chip::deselect);
            if self.first_byte == Some(TRANSMIT) {
                self.transmits.push(at);
            }
        }
        self.note(at, Crossing::Select(selected));
    }

    /// The part clocks a frame from `begins` to `ends` (ns). Answers what MISO carried; `None` where the chip does not
    /// drive it, or not to where the part reads.
    pub fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        let Wires { sck, mosi, miso, .. } = self.wires;
        if !self.selected || !frame.sck.contains(&Some(sck)) {
            return None;
        }
        let bits = u64::from(frame.bits.max(1));
        if self.last_span != (frame.bits, ends - begins) {
            self.last_span = (frame.bits, ends - begins);
            let hz = u32::try_from(bits * 1_000_000_000 / (ends - begins).max(1)).unwrap_or(u32::MAX);
            if hz.abs_diff(self.clock_hz) > self.clock_hz / 100 {
                self.clock_hz = hz;
                self.call(begins, |chip, _| chip.spi_clock_hz(hz));
            }
        }
        if frame.mode != SpiMode::Mode1 {
            self.call(begins, |chip, now| chip.clocked_in_mode(now, frame.mode as u8));
        }
        // A line that the part does not drive rests low, by the chip's own pull-down.
        let sent = if frame.mosi.contains(&Some(mosi)) { frame.data } else { 0 };
        if bits == 8 && frame.mode == SpiMode::Mode1 {
            // What follows, for the frames that firmwares send: a byte in the chip's own mode.
            let back = self.exchange(ends, sent as u8);
            return (frame.miso == Some(miso)).then_some(u32::from(back));
        }
        let out = |bit: u64| sent >> (bits - 1 - bit) & 1 != 0;
        let (mut answer, mut last) = (0_u32, self.last_bits);
        let mut bit = 0;
        while bit < bits {
            let many = (bits - bit).min(8);
            let mut byte = 0_u8;
            for nth in bit..bit + many {
                // Clocked in mode 3, data changes on the edge that the chip samples on: it takes the bit before.
                let seen =
                    if frame.mode == SpiMode::Mode3 { std::mem::replace(&mut last.0, out(nth)) } else { out(nth) };
                byte = byte << 1 | u8::from(seen);
            }
            bit += many;
            let at = begins + (ends - begins) * bit / bits;
            if many < 8 {
                // The chip takes whole bytes: what is left over is lost at the end of chip select.
                self.call(at, |chip, now| chip.lose_bits(now, u8::try_from(many).unwrap_or(0)));
                answer <<= many;
                break;
            }
            let back = self.exchange(at, byte);
            for nth in (0..8).rev() {
                let driven = back >> nth & 1 != 0;
                // The chip changes MISO on the rising edge. A controller that samples there (modes 0 and 3) takes the
                // bit before, and so does one that samples the falling edge before it (mode 2).
                let read = if frame.mode == SpiMode::Mode1 { driven } else { std::mem::replace(&mut last.1, driven) };
                answer = answer << 1 | u32::from(read);
            }
        }
        self.last_bits = last;
        (frame.miso == Some(miso)).then_some(answer)
    }

    /// A byte was clocked by `at` (ns).
    fn exchange(&mut self, at: u64, byte: u8) -> u8 {
        let back = self.call(at, |chip, now| chip.transfer(now, byte));
        self.first_byte.get_or_insert(byte);
        self.note(at, Crossing::Byte(byte, back));
        back
    }

    /// The transmit commands since the last call: each the instant chip select rose after its byte, ns. The chip acts
    /// on a command from there on, so this is the last instant that the firmware answers for.
    pub fn take_transmits(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.transmits)
    }

    /// What crossed the bus since the last call; nothing unless watched.
    pub fn take_crossings(&mut self) -> Vec<(u64, Crossing)> {
        self.crossings.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Something crosses at `at`.
    fn note(&mut self, at: u64, crossing: Crossing) {
        if let Some(crossings) = &mut self.crossings {
            crossings.push((at, crossing));
        }
    }
}
