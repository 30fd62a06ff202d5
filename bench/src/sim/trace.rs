//! The wires as a VCD file, for GTKWave and sigrok.
//!
//! Every wire is one bit, since that is what sigrok's importer and its SPI decoder read. The models exchange whole
//! bytes, each at the end of its eighth clock; the clock edges and data bits of a byte are drawn back from there at the
//! bus's clock rate. Events arrive a little out of order, because the boards run up to the scheduler's lookahead apart,
//! so they wait in a window before they are written.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use vcd::{IdCode, TimescaleUnit, Value, Writer};

/// How far back an event may still be placed: more than the longest byte and the greatest lookahead together.
const WINDOW_NS: u64 = 200_000;

/// A wire of the trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Wire {
    /// HORUS side: SPI clock.
    HorusSck,
    /// HORUS side: controller to chip.
    HorusMosi,
    /// HORUS side: chip to controller.
    HorusMiso,
    /// HORUS side: chip select, active low.
    HorusCs,
    /// HORUS side: the chip's interrupt output.
    HorusIrq,
    /// The poller's carrier.
    Field,
    /// A frame is on the air.
    Frame,
    /// DPR side: SPI clock.
    DprSck,
    /// DPR side: controller to chip.
    DprMosi,
    /// DPR side: chip to controller.
    DprMiso,
    /// DPR side: chip select, active low.
    DprCs,
    /// DPR side: the chip's interrupt output.
    DprIrq,
    /// SSI clock.
    SsiSck,
    /// SSI: flight controller to DPR.
    SsiMosi,
    /// SSI: DPR to flight controller.
    SsiMiso,
    /// SSI chip select, active low.
    SsiCsn,
    /// A new image is readable.
    Fresh,
}

/// Every wire with its scope, its name and its level at the start. sigrok drops the scopes, so the names alone tell
/// them apart.
const WIRES: [(Wire, &str, &str, bool); 17] = [
    (Wire::HorusSck, "horus", "horus_sck", false),
    (Wire::HorusMosi, "horus", "horus_mosi", false),
    (Wire::HorusMiso, "horus", "horus_miso", false),
    (Wire::HorusCs, "horus", "horus_cs_n", true),
    (Wire::HorusIrq, "horus", "horus_irq", false),
    (Wire::Field, "air", "field", false),
    (Wire::Frame, "air", "frame", false),
    (Wire::DprSck, "dpr", "dpr_sck", false),
    (Wire::DprMosi, "dpr", "dpr_mosi", false),
    (Wire::DprMiso, "dpr", "dpr_miso", false),
    (Wire::DprCs, "dpr", "dpr_cs_n", true),
    (Wire::DprIrq, "dpr", "dpr_irq", false),
    (Wire::SsiSck, "ssi", "ssi_sck", false),
    (Wire::SsiMosi, "ssi", "ssi_mosi", false),
    (Wire::SsiMiso, "ssi", "ssi_miso", false),
    (Wire::SsiCsn, "ssi", "ssi_csn", true),
    (Wire::Fresh, "ssi", "ssi_fresh", false),
];

/// An SPI bus of the trace.
#[derive(Clone, Copy, Debug)]
pub struct Bus {
    sck: Wire,
    mosi: Wire,
    miso: Wire,
    /// Data changes on the clock's rising edge (mode 1) rather than before it (mode 0).
    changes_on_rise: bool,
}

/// The HORUS side's front end: SPI mode 1.
pub const HORUS: Bus = Bus { sck: Wire::HorusSck, mosi: Wire::HorusMosi, miso: Wire::HorusMiso, changes_on_rise: true };
/// The DPR side's front end: SPI mode 1.
pub const DPR: Bus = Bus { sck: Wire::DprSck, mosi: Wire::DprMosi, miso: Wire::DprMiso, changes_on_rise: true };
/// The flight controller's port: SPI mode 0.
pub const SSI: Bus = Bus { sck: Wire::SsiSck, mosi: Wire::SsiMosi, miso: Wire::SsiMiso, changes_on_rise: false };

/// Something that happened on a wire.
#[derive(Clone, Copy, Debug)]
pub enum Mark {
    /// The wire took a level at the instant (ns).
    Level(u64, Wire, bool),
    /// A byte crossed the bus, controller to chip and back, its eighth clock ending at the instant (ns), at so many Hz.
    Byte(u64, Bus, u8, u8, u32),
}

/// A VCD file being written.
pub struct Trace<W: io::Write = BufWriter<File>> {
    writer: Writer<W>,
    codes: BTreeMap<Wire, IdCode>,
    levels: BTreeMap<Wire, bool>,
    /// Events not yet written, by time; of several on one wire at one instant the last counts.
    waiting: BTreeMap<(u64, Wire), bool>,
}

impl Trace {
    /// Creates the file.
    ///
    /// # Errors
    ///
    /// What the file system says.
    pub fn create(path: &Path) -> io::Result<Self> {
        Self::new(BufWriter::new(File::create(path)?))
    }
}

impl<W: io::Write> Trace<W> {
    /// Writes the header.
    ///
    /// # Errors
    ///
    /// What the writer says.
    pub fn new(to: W) -> io::Result<Self> {
        let mut writer = Writer::new(to);
        writer.timescale(1, TimescaleUnit::NS)?;
        let mut codes = BTreeMap::new();
        for scope in ["horus", "air", "dpr", "ssi"] {
            writer.add_module(scope)?;
            for (wire, _, name, _) in WIRES.iter().filter(|(_, of, ..)| *of == scope) {
                codes.insert(*wire, writer.add_wire(1, name)?);
            }
            writer.upscope()?;
        }
        writer.enddefinitions()?;
        writer.timestamp(0)?;
        writer.begin(vcd::SimulationCommand::Dumpvars)?;
        let mut levels = BTreeMap::new();
        for (wire, _, _, level) in WIRES {
            writer.change_scalar(codes[&wire], Value::from(level))?;
            levels.insert(wire, level);
        }
        writer.end()?;
        Ok(Self { writer, codes, levels, waiting: BTreeMap::new() })
    }

    /// Takes what happened.
    pub fn take(&mut self, marks: Vec<Mark>) {
        for mark in marks {
            match mark {
                Mark::Level(at, wire, level) => self.set(at, wire, level),
                Mark::Byte(at, bus, mosi, miso, hz) => self.byte(at, bus, mosi, miso, hz),
            }
        }
    }

    /// A wire takes a level at `at` (ns).
    pub fn set(&mut self, at: u64, wire: Wire, level: bool) {
        self.waiting.insert((at, wire), level);
    }

    /// A byte has crossed a bus: its eighth clock ended at `at` (ns), at `hz`.
    pub fn byte(&mut self, at: u64, bus: Bus, mosi: u8, miso: u8, hz: u32) {
        let half = |halves: u64| at.saturating_sub(halves * 500_000_000 / u64::from(hz));
        for bit in 0..8 {
            let left = 2 * (8 - bit);
            let (low, high, fall) = (half(left), half(left - 1), half(left - 2));
            // Mode 0: low half, then high half. Mode 1: high half, then low half.
            let (rise, fall) = if bus.changes_on_rise { (low, high) } else { (high, fall) };
            self.set(low, bus.mosi, mosi >> (7 - bit) & 1 != 0);
            self.set(low, bus.miso, miso >> (7 - bit) & 1 != 0);
            self.set(rise, bus.sck, true);
            self.set(fall, bus.sck, false);
        }
    }

    /// Writes what can no longer change: both boards have passed `now` (ns).
    ///
    /// # Errors
    ///
    /// What the writer says.
    pub fn flush_before(&mut self, now: u64) -> io::Result<()> {
        let later = self.waiting.split_off(&(now.saturating_sub(WINDOW_NS), Wire::HorusSck));
        let due = std::mem::replace(&mut self.waiting, later);
        self.write(due)
    }

    /// Writes the rest.
    ///
    /// # Errors
    ///
    /// What the writer says.
    pub fn finish(mut self) -> io::Result<()> {
        let due = std::mem::take(&mut self.waiting);
        self.write(due)?;
        self.writer.flush()
    }

    fn write(&mut self, due: BTreeMap<(u64, Wire), bool>) -> io::Result<()> {
        let mut stamped = None;
        for ((at, wire), level) in due {
            if self.levels.insert(wire, level) == Some(level) {
                continue;
            }
            if stamped != Some(at) {
                self.writer.timestamp(at)?;
                stamped = Some(at);
            }
            self.writer.change_scalar(self.codes[&wire], Value::from(level))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vcd::Command;

    /// The level of each wire over time, read back by the parser.
    fn changes(bytes: &[u8], name: &str) -> Vec<(u64, bool)> {
        let mut parser = vcd::Parser::new(bytes);
        let header = parser.parse_header().unwrap();
        let code = header.find_var(&name.split('.').collect::<Vec<_>>()).unwrap().code;
        let mut now = 0;
        let mut found = vec![];
        for command in parser {
            match command.unwrap() {
                Command::Timestamp(at) => now = at,
                Command::ChangeScalar(id, value) if id == code => found.push((now, value == Value::V1)),
                _ => {}
            }
        }
        found
    }

    /// What a decoder that samples MOSI on the given edge of the clock reads.
    fn sampled(bytes: &[u8], scope: &str, rising: bool) -> u8 {
        let data = changes(bytes, &format!("{scope}.{scope}_mosi"));
        let level = |at: u64| data.iter().take_while(|(when, _)| *when <= at).last().unwrap().1;
        changes(bytes, &format!("{scope}.{scope}_sck"))
            .into_iter()
            .filter(|&(at, up)| at > 0 && up == rising)
            .fold(0, |byte, (at, _)| byte << 1 | u8::from(level(at)))
    }

    #[test]
    fn a_decoder_reads_the_byte_back_in_either_mode() {
        for byte in [0x00, 0xFF, 0xA5, 0x01, 0x80, 0xC4] {
            let mut written = vec![];
            let mut trace = Trace::new(&mut written).unwrap();
            trace.byte(10_000, HORUS, byte, 0, 9_000_000);
            trace.byte(10_000, SSI, byte, 0, 8_000_000);
            trace.finish().unwrap();
            assert_eq!(sampled(&written, "horus", false), byte);
            assert_eq!(sampled(&written, "ssi", true), byte);
        }
    }

    #[test]
    fn events_out_of_order_within_the_window_are_written_in_order() {
        let mut written = vec![];
        let mut trace = Trace::new(&mut written).unwrap();
        trace.set(500_000, Wire::Fresh, true);
        trace.set(400_000, Wire::Field, true);
        trace.flush_before(550_000).unwrap();
        trace.set(501_000, Wire::Fresh, false);
        trace.finish().unwrap();
        assert_eq!(changes(&written, "ssi.ssi_fresh"), [(0, false), (500_000, true), (501_000, false)]);
        assert_eq!(changes(&written, "air.field"), [(0, false), (400_000, true)]);
    }
}
