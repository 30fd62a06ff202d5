//! Value Change Dump (IEEE 1364-2005, section 18), a text format that every viewer and sigrok read.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use vcd::{IdCode, SimulationCommand, TimescaleUnit, Writer};

use super::signals::{Id, Signal, Value, by_group, digits, regroup};

pub(super) struct VcdFile {
    writer: Writer<BufWriter<File>>,
    codes: Vec<IdCode>,
}

impl VcdFile {
    pub(super) fn create(path: &Path, signals: &[Signal]) -> io::Result<Self> {
        let mut writer = Writer::new(BufWriter::new(File::create(path)?));
        writer.timescale(1, TimescaleUnit::NS)?;
        let mut codes = Vec::with_capacity(signals.len());
        let open = |writer: &mut Writer<_>, group: &str| writer.add_module(group);
        let close = |writer: &mut Writer<_>| writer.upscope();
        let mut group: &[&'static str] = &[];
        for (id, signal) in by_group(signals) {
            regroup(&mut writer, group, &signal.group, open, close)?;
            group = &signal.group;
            codes.push((id, writer.add_wire(signal.bits, &signal.name)?));
        }
        regroup(&mut writer, group, &[], open, close)?;
        writer.enddefinitions()?;
        codes.sort_by_key(|(id, _)| *id);
        let codes = codes.into_iter().map(|(_, code)| code).collect();
        Ok(Self { writer, codes })
    }

    pub(super) fn start(&mut self) -> io::Result<()> {
        self.time(0)?;
        self.writer.begin(SimulationCommand::Dumpvars)
    }

    pub(super) fn started(&mut self) -> io::Result<()> {
        self.writer.end()
    }

    pub(super) fn time(&mut self, at: u64) -> io::Result<()> {
        self.writer.timestamp(at)
    }

    pub(super) fn change(&mut self, id: Id, bits: u32, value: Value) -> io::Result<()> {
        let Id(place) = id;
        let digit = |digit| match digit {
            b'0' => vcd::Value::V0,
            b'1' => vcd::Value::V1,
            _ => vcd::Value::Z,
        };
        if bits == 1 {
            let value = digits(1, value).map(digit).next().unwrap_or(vcd::Value::X);
            return self.writer.change_scalar(self.codes[place], value);
        }
        // The format allows equal leading digits to be left out (18.2.1).
        let needed = value.map_or(1, |value| (u64::BITS - value.leading_zeros()).clamp(1, bits));
        self.writer.change_vector(self.codes[place], digits(needed, value).map(digit))
    }

    pub(super) fn finish(mut self) -> io::Result<()> {
        self.writer.flush()
    }
}
