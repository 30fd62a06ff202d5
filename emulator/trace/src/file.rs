//! The file of a trace, in either format.

use std::ffi::OsStr;
use std::io;
use std::path::Path;

use super::Error;
use super::fst::FstFile;
use super::signals::{Id, Signal, Value};
use super::vcd::VcdFile;

pub(super) enum TraceFile {
    Vcd(VcdFile),
    Fst(Box<FstFile>),
}

impl TraceFile {
    pub(super) fn create(path: &Path, signals: &[Signal]) -> Result<Self, Error> {
        let failed = |source| Error::Io { path: path.to_owned(), source };
        match path.extension().and_then(OsStr::to_str) {
            Some("vcd") => VcdFile::create(path, signals).map(Self::Vcd).map_err(failed),
            Some("fst") => FstFile::create(path, signals).map(|file| Self::Fst(Box::new(file))).map_err(failed),
            _ => Err(Error::Ending { path: path.to_owned() }),
        }
    }

    pub(super) fn start(&mut self, signals: &[Signal], values: &[Value]) -> io::Result<()> {
        if let Self::Vcd(file) = self {
            file.start()?;
        }
        for (place, (signal, value)) in signals.iter().zip(values).enumerate() {
            self.change(Id(place), signal.bits, *value)?;
        }
        if let Self::Vcd(file) = self {
            file.started()?;
        }
        Ok(())
    }

    /// Begins the changes at the instant `at` (ns). This instant must be later than those of all earlier changes.
    pub(super) fn time(&mut self, at: u64) -> io::Result<()> {
        match self {
            Self::Vcd(file) => file.time(at),
            Self::Fst(file) => file.time(at),
        }
    }

    pub(super) fn change(&mut self, id: Id, bits: u32, value: Value) -> io::Result<()> {
        match self {
            Self::Vcd(file) => file.change(id, bits, value),
            Self::Fst(file) => file.change(id, bits, value),
        }
    }

    pub(super) fn finish(self) -> io::Result<()> {
        match self {
            Self::Vcd(file) => file.finish(),
            Self::Fst(file) => file.finish(),
        }
    }
}
