//! Writes what changes over a run's time (wires, numbers, tasks) to a file for the viewers GTKWave, Surfer and sigrok.
//!
//! # Formats
//!
//! The ending of the file's name selects the format: `.vcd` is Value Change Dump, text; `.fst` is Fast Signal Trace,
//! compressed. sigrok imports only VCD, and only its one-bit wires; GTKWave and Surfer read both formats.
//!
//! # Tasks
//!
//! [`TaskWatch`] derives from a node's record of exceptions when each task of its firmware runs. A task's signal is 1
//! from the entry of its handler to its end, even while a more urgent task preempts it. `..._running` has the number of
//! the exception that runs. `..._idle` is 1 in thread mode with the core awake, `..._asleep` while the core sleeps, and
//! `..._other` in exceptions outside the table of tasks.
//!
//! ```
//! use emulator_trace::{Id, Signal, Trace};
//!
//! let path = std::env::temp_dir().join(format!("led-{}.vcd", std::process::id()));
//! let led = Signal { group: vec!["board"], name: "led".to_owned(), bits: 1, start: Some(0) };
//! let mut trace = Trace::create(&path, vec![led])?;
//! trace.set(1_000_000, Id(0), Some(1));
//! trace.finish()?;
//! assert!(std::fs::read_to_string(&path).unwrap().ends_with("#1000000\n1!\n"));
//! # std::fs::remove_file(path).unwrap();
//! # Ok::<(), emulator_trace::Error>(())
//! ```
#![forbid(unsafe_code)]

mod file;
mod fst;
mod signals;
mod tasks;
mod vcd;

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use file::TraceFile;
pub use signals::{Id, Signal, Value};
pub use tasks::{Task, TaskChange, TaskSignal, TaskWatch, task_signals};

/// The greatest time, ns, by which a change may come late: the longest byte on a bus, plus the time by which one board
/// may run ahead of another.
const WINDOW_NS: u64 = 200_000;

/// The reason why a trace cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file's name does not end in a known format.
    #[error("a trace's name ends in .vcd or in .fst, and {} does not", path.display())]
    Ending {
        /// The path of the file.
        path: PathBuf,
    },
    /// The file cannot be created or written.
    #[error("the trace cannot be written to {}", path.display())]
    Io {
        /// The path of the file.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// An event came that is earlier than an instant up to which the trace is already written.
    #[error("the trace is written up to {written} ns, and {signal} changed at {at} ns")]
    Late {
        /// The name of the late event's signal.
        signal: String,
        /// The instant of the late event, ns.
        at: u64,
        /// The instant up to which the trace was already written, ns.
        written: u64,
    },
}

/// A trace whose file is being written.
pub struct Trace {
    path: PathBuf,
    file: TraceFile,
    signals: Vec<Signal>,
    values: Vec<Value>,
    /// The events that have not been written yet, by instant and signal. If a signal has several at one instant, the
    /// latest counts.
    waiting: BTreeMap<(u64, Id), Value>,
    /// The instant, ns, before which all events are written.
    written: u64,
    begun: bool,
}

impl Trace {
    /// Creates the file `path` with these signals.
    ///
    /// # Errors
    ///
    /// The name ends neither in `.vcd` nor in `.fst`, the directory does not exist, or the file system reports an
    /// error.
    pub fn create(path: &Path, signals: Vec<Signal>) -> Result<Self, Error> {
        let file = TraceFile::create(path, &signals)?;
        let values = signals.iter().map(|signal| signal.start).collect();
        Ok(Self { path: path.to_owned(), file, signals, values, waiting: BTreeMap::new(), written: 0, begun: false })
    }

    /// Sets the value of a signal from the instant `at` (ns) on. Changes may be slightly out of order. If there are
    /// several at one instant, the last counts.
    pub fn set(&mut self, at: u64, id: Id, value: Value) {
        self.waiting.insert((at, id), value);
    }

    /// Writes the events before `now` (ns), an instant that all boards have passed.
    ///
    /// # Errors
    ///
    /// The file system reports an error, or an event came too late ([`Error::Late`]).
    pub fn flush_before(&mut self, now: u64) -> Result<(), Error> {
        let before = now.saturating_sub(WINDOW_NS);
        if before == 0 {
            return Ok(());
        }
        let later = self.waiting.split_off(&(before, Id(0)));
        let due = std::mem::replace(&mut self.waiting, later);
        self.write(due)?;
        self.written = before;
        Ok(())
    }

    /// Writes the remaining events.
    ///
    /// # Errors
    ///
    /// The errors are those of [`Trace::flush_before`].
    pub fn finish(mut self) -> Result<(), Error> {
        let due = std::mem::take(&mut self.waiting);
        self.write(due)?;
        let Self { file, path, .. } = self;
        file.finish().map_err(|source| Error::Io { path, source })
    }

    fn write(&mut self, mut due: BTreeMap<(u64, Id), Value>) -> Result<(), Error> {
        let Self { path, file, signals, values, written, begun, .. } = self;
        let failed = |source| Error::Io { path: path.clone(), source };
        if !std::mem::replace(begun, true) {
            while let Some(first) = due.first_entry().filter(|first| first.key().0 == 0) {
                let Id(place) = first.key().1;
                values[place] = first.remove();
            }
            file.start(signals, values).map_err(failed)?;
        }
        let mut stamped = None;
        for ((at, id), value) in due {
            let Id(place) = id;
            let signal = &signals[place];
            if at < *written {
                return Err(Error::Late { signal: signal.name.clone(), at, written: *written });
            }
            if std::mem::replace(&mut values[place], value) == value {
                continue;
            }
            if stamped != Some(at) {
                file.time(at).map_err(failed)?;
                stamped = Some(at);
            }
            file.change(id, signal.bits, value).map_err(failed)?;
        }
        Ok(())
    }
}
