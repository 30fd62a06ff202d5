//! Writes the wires and the tasks of a run to a file for the viewers GTKWave, Surfer and sigrok.
//!
//! # Formats
//!
//! The ending of the file's name selects the format. sigrok imports only VCD, and only its one-bit wires; GTKWave and
//! Surfer read both formats. The sizes are those of 10 s of the link with three receivers, `cargo xtask sim --seconds
//! 10 --trace run.fst`:
//!
//! | ending | format | size |
//! |---|---|---|
//! | `.vcd` | Value Change Dump, text | 327 MB |
//! | `.fst` | Fast Signal Trace, compressed | 1.8 MB |
//!
//! # The signals
//!
//! | group | signals |
//! |---|---|
//! | `horus` | the front end's SPI, bit by bit and as bytes (`horus_mosi_byte`), its interrupt output, TICK |
//! | `horus.tasks` | one signal for each task, named by task and vector (`rf_irq_EXTI3`), and those below |
//! | `air` | the carrier, frames, the timestamp that a frame carries |
//! | `dpr` | the front end's SPI, its interrupt output |
//! | `dpr.tasks` | as `horus.tasks` |
//! | `ssi` | the flight controller's SPI, FRESH, the age that the image's Link-Status carries |
//!
//! A task's signal is 1 from the entry of its handler to its end, even while a more urgent task preempts it.
//! `..._running` has the number of the present exception. Outside exceptions `..._idle` is 1 while the core is awake,
//! and `..._asleep` while it sleeps. `..._other` is 1 in exceptions that belong to no task.
//!
//! The models exchange whole bytes, each at the end of its eighth clock. The trace calculates clock edges and data bits
//! from that instant and the clock rate. The signal of a byte has its value from its first clock until the next byte or
//! the end of chip select, and is undriven (`z`) otherwise.

mod signals;

use std::path::Path;

pub use emulator_trace::{Error, Task, TaskChange, TaskSignal, TaskWatch};
use emulator_trace::{Id, Value};
use signals::{BUSES, Signals};
pub use signals::{Board, Bus, DPR, HORUS, SSI, Wire, Word};

/// A change of a signal of the trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A wire took a level: the instant (ns), the wire, the level.
    Level(u64, Wire, bool),
    /// A signal of several bits took a value: the instant (ns), the signal, the value (`None` for no value).
    Word(u64, Word, Option<u64>),
    /// A byte was transferred on a bus: the end of its eighth clock (ns), the bus, the byte to the chip, the byte from
    /// the chip, the clock rate (Hz).
    Byte(u64, Bus, u8, u8, u32),
    /// A signal of a board's tasks took a value ([`TaskWatch`]): the instant (ns), the board, the signal, the value.
    Task(u64, Board, TaskSignal, u64),
}

/// A trace of the link whose file is being written.
pub struct Trace {
    file: emulator_trace::Trace,
    signals: Signals,
}

impl Trace {
    /// Creates the file `path`, with a signal for each of the boards' tasks.
    ///
    /// # Errors
    ///
    /// The name ends neither in `.vcd` nor in `.fst`, the directory does not exist, or the file system reports an
    /// error.
    pub fn create(path: &Path, horus: &[Task], dpr: &[Task]) -> Result<Self, Error> {
        let signals = Signals::new(horus, dpr);
        let file = emulator_trace::Trace::create(path, signals.all().to_vec())?;
        Ok(Self { file, signals })
    }

    /// Takes changes for the trace. They may be slightly out of order.
    pub fn take(&mut self, marks: impl IntoIterator<Item = Mark>) {
        for mark in marks {
            match mark {
                Mark::Level(at, wire, level) => self.level(at, wire, level),
                Mark::Word(at, word, value) => self.set(at, Signals::word(word), value),
                Mark::Byte(at, bus, mosi, miso, hz) => self.byte(at, bus, mosi, miso, hz),
                Mark::Task(at, board, signal, value) => self.set(at, self.signals.task(board, signal), Some(value)),
            }
        }
    }

    fn set(&mut self, at: u64, id: Id, value: Value) {
        self.file.set(at, id, value);
    }

    fn level(&mut self, at: u64, wire: Wire, level: bool) {
        self.set(at, Signals::wire(wire), Some(u64::from(level)));
        if level && let Some(bus) = BUSES.iter().find(|bus| bus.cs == wire) {
            self.set(at, Signals::word(bus.mosi_byte), None);
            self.set(at, Signals::word(bus.miso_byte), None);
        }
    }

    /// Adds the edges of a byte whose eighth clock ended at `at` (ns) on a bus with the clock rate `hz` (Hz).
    fn byte(&mut self, at: u64, bus: Bus, mosi: u8, miso: u8, hz: u32) {
        let half = |halves: u64| at.saturating_sub(halves * 500_000_000 / u64::from(hz));
        let bit = |byte: u8, bit: u64| Some(u64::from(byte >> (7 - bit) & 1));
        for nth in 0..8 {
            let left = 2 * (8 - nth);
            let (low, high, fall) = (half(left), half(left - 1), half(left - 2));
            // In SPI mode 0 each clock is first low, then high; in mode 1 it is first high.
            let (rise, fall) = if bus.changes_on_rise { (low, high) } else { (high, fall) };
            self.set(low, Signals::wire(bus.mosi), bit(mosi, nth));
            self.set(low, Signals::wire(bus.miso), bit(miso, nth));
            self.set(rise, Signals::wire(bus.sck), Some(1));
            self.set(fall, Signals::wire(bus.sck), Some(0));
        }
        self.set(half(16), Signals::word(bus.mosi_byte), Some(u64::from(mosi)));
        self.set(half(16), Signals::word(bus.miso_byte), Some(u64::from(miso)));
    }

    /// Writes the events before `now` (ns), which both boards must have reached.
    ///
    /// # Errors
    ///
    /// [`Error`] if the file system reports an error, or if an event came too late ([`Error::Late`]).
    pub fn flush_before(&mut self, now: u64) -> Result<(), Error> {
        self.file.flush_before(now)
    }

    /// Writes the remaining events.
    ///
    /// # Errors
    ///
    /// The errors are those of [`Trace::flush_before`].
    pub fn finish(self) -> Result<(), Error> {
        self.file.finish()
    }
}
