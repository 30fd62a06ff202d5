//! Fast Signal Trace: the compressed format of GTKWave, which Surfer reads too.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use fst_writer::{
    FstBodyWriter, FstFileType, FstHeaderWriter, FstInfo, FstScopeType, FstSignalId, FstSignalType, FstVarDirection,
    FstVarType, FstWriteError, open_fst,
};

use super::signals::{Id, Signal, Value, by_group, digits, regroup};

/// The approximate size of a block of the file before its compression, bytes.
const BLOCK: usize = 16 << 20;

pub(super) struct FstFile {
    writer: FstBodyWriter<BufWriter<File>>,
    ids: Vec<FstSignalId>,
    /// The digits of the value that is being written. They are kept, so that no value needs an allocation.
    digits: Vec<u8>,
}

impl FstFile {
    pub(super) fn create(path: &Path, signals: &[Signal]) -> io::Result<Self> {
        let info = FstInfo {
            start_time: 0,
            timescale_exponent: -9,
            version: "emulator".to_owned(),
            // The file has no date, because the same run must always give the same file.
            date: String::new(),
            file_type: FstFileType::Verilog,
        };
        let mut header = open_fst(path, &info).map_err(failed)?;
        let open = |header: &mut FstHeaderWriter<_>, group: &str| {
            header.scope(group, "", FstScopeType::Module).map_err(failed)
        };
        let close = |header: &mut FstHeaderWriter<_>| header.up_scope().map_err(failed);
        let mut ids = Vec::with_capacity(signals.len());
        let mut group: &[&'static str] = &[];
        for (id, signal) in by_group(signals) {
            regroup(&mut header, group, &signal.group, open, close)?;
            group = &signal.group;
            let width = FstSignalType::bit_vec(signal.bits);
            let var = header.var(&signal.name, width, FstVarType::Wire, FstVarDirection::Implicit, None);
            ids.push((id, var.map_err(failed)?));
        }
        regroup(&mut header, group, &[], open, close)?;
        ids.sort_by_key(|(id, _)| *id);
        let ids = ids.into_iter().map(|(_, id)| id).collect();
        // Before the first instant, changes set the values of the signals at 0 ns.
        Ok(Self { writer: header.finish().map_err(failed)?, ids, digits: vec![] })
    }

    pub(super) fn time(&mut self, at: u64) -> io::Result<()> {
        // A block of the file may end only between two instants, as at this point.
        if self.writer.size() > BLOCK {
            self.writer.flush().map_err(failed)?;
        }
        self.writer.time_change(at).map_err(failed)
    }

    pub(super) fn change(&mut self, id: Id, bits: u32, value: Value) -> io::Result<()> {
        let Id(place) = id;
        self.digits.clear();
        self.digits.extend(digits(bits, value));
        self.writer.signal_change(self.ids[place], &self.digits).map_err(failed)
    }

    pub(super) fn finish(self) -> io::Result<()> {
        self.writer.finish().map_err(failed)?.flush()
    }
}

fn failed(error: FstWriteError) -> io::Error {
    match error {
        FstWriteError::Io(error) => error,
        other => io::Error::other(other),
    }
}
