//! A receiver on SPI.
//!
//! | rule | source |
//! |---|---|
//! | Mode 0, most significant bit first, at most 5.5 MHz | ZED-F9R data sheet 5.2, NEO-D9S data sheet 5.2 |
//! | At most 125 kB/s: a byte every 8 µs | the same; NEO-M8P data sheet 4.4.1, "minimum byte period" |
//! | There are no registers: the receiver takes what is clocked in and sends its stream, 0xFF when empty | below |
//! | After 50 bytes of 0xFF in a row the receiver reads no input until a byte that is not 0xFF | below |
//!
//! The streams and the filler are those of the u-blox integration manuals, "SPI interface", "Read access" and
//! "Back-to-back read and write access" (ZED-F9K UBX-20046189, ZED-F9T UBX-18053713 and NEO-D9S UBX-19026111 agree).
//!
//! The data sheets do not say what a receiver does when the controller clocks bytes faster than the receiver can load
//! them. The model then loads no byte: MISO repeats the previous byte, the stream does not advance, and bytes that the
//! controller sends are lost. Above 5.5 MHz the receiver's output is late by one bit: in place of each bit the
//! controller reads the bit before it.

use emulator_part::{Pin, SpiFrame, SpiMode};

use super::{Crossings, Outbox};
use crate::faults::{BusFault, Rng};

const SHORTEST_BIT_PS: u64 = 181_818;
/// The duration of a byte at 125 kB/s, ns.
pub const SHORTEST_BYTE: u64 = 8_000;
/// The factory default of CFG-SPI-MAXFF: the number of successive 0xFF bytes after which the receiver ignores its
/// input.
const MOST_FILLER: u32 = 50;

const WRONG_MODE: &str = "SPI: not mode 0, or not whole bytes (ZED-F9R data sheet 5.2)";
const FAST_CLOCK: &str = "SPI: more than 5.5 MHz (ZED-F9R data sheet 5.2)";
const FAST_BYTES: &str = "SPI: more than 125 kB/s, a byte every 8 µs (ZED-F9R data sheet 5.2, NEO-M8P 4.4.1)";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Wires {
    pub(super) sck: Pin,
    pub(super) miso: Pin,
    pub(super) mosi: Pin,
    pub(super) cs: Pin,
}

#[derive(Clone, Debug)]
pub(super) struct Spi {
    pub(super) wires: Wires,
    pub(super) outbox: Outbox,
    pub(super) crossings: Crossings,
    selected: bool,
    /// The beginning of the last byte that the receiver loaded in time, ns; `None` if the receiver has loaded no byte
    /// since it was selected.
    last: Option<u64>,
    filler: u32,
    last_bit: bool,
    last_byte: u8,
    failing: Option<(BusFault, Rng)>,
}

impl Spi {
    pub(super) fn new(wires: Wires) -> Self {
        Self {
            wires,
            outbox: Outbox::default(),
            crossings: Crossings::default(),
            selected: false,
            last: None,
            filler: MOST_FILLER,
            last_bit: true,
            last_byte: 0xFF,
            failing: None,
        }
    }

    pub(super) fn begin_fault(&mut self, fault: BusFault, rng: Rng) {
        self.crossings.spoil_open();
        self.failing = Some((fault, rng));
    }

    pub(super) fn end_fault(&mut self, fault: BusFault) {
        if self.failing.as_ref().is_some_and(|(of, _)| *of == fault) {
            self.failing = None;
            self.crossings.spoil_open();
        }
    }

    pub(super) fn select(&mut self, at: u64, selected: bool) {
        if std::mem::replace(&mut self.selected, selected) == selected {
            return;
        }
        if selected {
            self.outbox.read_at = at;
        } else {
            self.crossings.end();
        }
    }

    pub(super) fn is_clocked_by(&self, frame: &SpiFrame) -> bool {
        frame.sck.contains(&Some(self.wires.sck))
    }

    /// Transfers a frame from `begins` to `ends` (ns). Calls `heard` with each byte that the receiver accepts and its
    /// instant.
    pub(super) fn clock(
        &mut self,
        begins: u64,
        ends: u64,
        frame: &SpiFrame,
        mut heard: impl FnMut(u64, Option<u8>),
    ) -> (Option<u32>, Option<&'static str>) {
        if !self.selected {
            return (None, None);
        }
        let bits = u64::from(frame.bits);
        let bytes = bits / 8;
        let mut misuse = None;
        if frame.mode != SpiMode::Mode0 || bits % 8 != 0 {
            misuse = Some(WRONG_MODE);
        } else if (ends - begins) * 1_000 < bits * SHORTEST_BIT_PS - 1_000 {
            misuse = Some(FAST_CLOCK);
        }
        // The receiver's pull-up holds MOSI high while the part does not drive it.
        let mosi = if frame.mosi.contains(&Some(self.wires.mosi)) { frame.data } else { u32::MAX };
        let mut answer = 0_u32;
        for number in 0..bytes.max(1) {
            let from = begins + (ends - begins) * number / bytes.max(1);
            let to = begins + (ends - begins) * (number + 1) / bytes.max(1);
            let loaded = self.last.is_none_or(|last| from >= last + SHORTEST_BYTE);
            if !loaded {
                misuse = misuse.or(Some(FAST_BYTES));
                answer = answer << 8 | u32::from(self.last_byte);
                if self.last_byte != 0xFF {
                    self.crossings.byte(from, to, self.last_byte, from);
                }
                self.crossings.spoil();
                continue;
            }
            self.last = Some(from);
            let said = self.outbox.take();
            let byte = said.map_or(0xFF, |(byte, _)| byte);
            let given = match &mut self.failing {
                _ if misuse.is_some() => self.late(byte),
                None => byte,
                Some((BusFault::Ones, _)) => 0xFF,
                Some((BusFault::Zeros, _)) => 0,
                Some((BusFault::Random, rng)) => rng.byte(),
                Some(_) => self.late(byte),
            };
            answer = answer << 8 | u32::from(given);
            self.last_byte = given;
            if misuse.is_some() || self.failing.is_some() || frame.miso != Some(self.wires.miso) {
                self.crossings.spoil();
            }
            if said.is_some() || given != 0xFF {
                self.crossings.byte(from, to, given, said.map_or(from, |(_, since)| since));
            }
            if misuse.is_none() {
                let shift = 8 * (bytes - 1 - number);
                self.hear(to, (mosi >> shift) as u8, &mut heard);
            }
        }
        ((frame.miso == Some(self.wires.miso)).then_some(answer), misuse)
    }

    /// Returns what the controller reads in place of `byte` while the receiver's output is one bit late.
    fn late(&mut self, byte: u8) -> u8 {
        let shifted = byte >> 1 | u8::from(self.last_bit) << 7;
        self.last_bit = byte & 1 != 0;
        shifted
    }

    fn hear(&mut self, at: u64, byte: u8, heard: &mut impl FnMut(u64, Option<u8>)) {
        if byte != 0xFF {
            self.filler = 0;
        } else if self.filler >= MOST_FILLER {
            return;
        } else {
            self.filler += 1;
        }
        heard(at, Some(byte));
    }
}
