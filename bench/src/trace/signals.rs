//! The signals of a trace, each with its group, its name and its width.

use emulator_trace::{Id, Signal, Task, TaskSignal, task_signals};

/// A board of the trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    /// HORUS.
    Horus,
    /// The DPR.
    Dpr,
}

/// A wire of the trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// The SPI clock of HORUS's front end.
    HorusSck,
    /// The SPI line from HORUS's microcontroller to its front end (MOSI).
    HorusMosi,
    /// The SPI line from HORUS's front end to its microcontroller (MISO).
    HorusMiso,
    /// The chip select of HORUS's front end, active low.
    HorusCs,
    /// The interrupt output of HORUS's front end.
    HorusIrq,
    /// HORUS's pin TICK, which falls at each tick of the 10 ms timer.
    HorusTick,
    /// The carrier of HORUS's front end, high while it is on.
    Field,
    /// High while a frame of HORUS is on the air.
    Frame,
    /// The SPI clock of the DPR's front end.
    DprSck,
    /// The SPI line from the DPR's microcontroller to its front end (MOSI).
    DprMosi,
    /// The SPI line from the DPR's front end to its microcontroller (MISO).
    DprMiso,
    /// The chip select of the DPR's front end, active low.
    DprCs,
    /// The interrupt output of the DPR's front end.
    DprIrq,
    /// The clock of the SSI.
    SsiSck,
    /// The SSI's line from the flight controller to the DPR (MOSI).
    SsiMosi,
    /// The SSI's line from the DPR to the flight controller (MISO).
    SsiMiso,
    /// The chip select of the SSI, active low.
    SsiCsn,
    /// The DPR's pin FRESH, which rises when a new image is readable.
    Fresh,
}

/// A signal of the trace that is a number of several bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Word {
    /// The byte to HORUS's front end.
    HorusMosiByte,
    /// The byte from HORUS's front end.
    HorusMisoByte,
    /// The timestamp of the first object in the frame on the air.
    FrameTimestamp,
    /// The byte to the DPR's front end.
    DprMosiByte,
    /// The byte from the DPR's front end.
    DprMisoByte,
    /// The byte that the SSI carries from the flight controller to the DPR.
    SsiMosiByte,
    /// The byte that the SSI carries from the DPR to the flight controller.
    SsiMisoByte,
    /// The age of Reported-Position, in units of 100 µs, as stated by Link-Status in the image that was read last.
    LinkStatusAge,
}

/// The one-bit signals: group, name and level at the start. The names are unique, because sigrok ignores the groups.
const WIRES: [(Wire, &str, &str, bool); 18] = [
    (Wire::HorusSck, "horus", "horus_sck", false),
    (Wire::HorusMosi, "horus", "horus_mosi", false),
    (Wire::HorusMiso, "horus", "horus_miso", false),
    (Wire::HorusCs, "horus", "horus_cs_n", true),
    (Wire::HorusIrq, "horus", "horus_irq", false),
    (Wire::HorusTick, "horus", "horus_tick", false),
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

/// The signals that are numbers, each with group, name and width in bits.
const WORDS: [(Word, &str, &str, u32); 8] = [
    (Word::HorusMosiByte, "horus", "horus_mosi_byte", 8),
    (Word::HorusMisoByte, "horus", "horus_miso_byte", 8),
    (Word::FrameTimestamp, "air", "frame_timestamp", 32),
    (Word::DprMosiByte, "dpr", "dpr_mosi_byte", 8),
    (Word::DprMisoByte, "dpr", "dpr_miso_byte", 8),
    (Word::SsiMosiByte, "ssi", "ssi_mosi_byte", 8),
    (Word::SsiMisoByte, "ssi", "ssi_miso_byte", 8),
    (Word::LinkStatusAge, "ssi", "link_status_age", 16),
];

/// An SPI bus of the trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bus {
    pub(super) sck: Wire,
    pub(super) mosi: Wire,
    pub(super) miso: Wire,
    pub(super) cs: Wire,
    pub(super) mosi_byte: Word,
    pub(super) miso_byte: Word,
    /// Whether data change on the rising edge of the clock, as in SPI mode 1. In mode 0 data change before that edge.
    pub(super) changes_on_rise: bool,
}

/// The bus of HORUS's front end, SPI mode 1.
pub const HORUS: Bus = Bus {
    sck: Wire::HorusSck,
    mosi: Wire::HorusMosi,
    miso: Wire::HorusMiso,
    cs: Wire::HorusCs,
    mosi_byte: Word::HorusMosiByte,
    miso_byte: Word::HorusMisoByte,
    changes_on_rise: true,
};
/// The bus of the DPR's front end, SPI mode 1.
pub const DPR: Bus = Bus {
    sck: Wire::DprSck,
    mosi: Wire::DprMosi,
    miso: Wire::DprMiso,
    cs: Wire::DprCs,
    mosi_byte: Word::DprMosiByte,
    miso_byte: Word::DprMisoByte,
    changes_on_rise: true,
};
/// The SSI, SPI mode 0.
pub const SSI: Bus = Bus {
    sck: Wire::SsiSck,
    mosi: Wire::SsiMosi,
    miso: Wire::SsiMiso,
    cs: Wire::SsiCsn,
    mosi_byte: Word::SsiMosiByte,
    miso_byte: Word::SsiMisoByte,
    changes_on_rise: false,
};

pub(super) const BUSES: [Bus; 3] = [HORUS, DPR, SSI];

#[derive(Clone, Debug)]
pub(super) struct Signals {
    all: Vec<Signal>,
    /// For each board, the index of its first task's signal, and the number of its tasks.
    boards: [(usize, usize); 2],
}

impl Signals {
    pub(super) fn new(horus: &[Task], dpr: &[Task]) -> Self {
        let bit = |level: bool| Some(u64::from(level));
        let wires = WIRES.iter().map(|&(_, group, name, level)| Signal {
            group: vec![group],
            name: name.to_owned(),
            bits: 1,
            start: bit(level),
        });
        let words = WORDS.iter().map(|&(_, group, name, bits)| Signal {
            group: vec![group],
            name: name.to_owned(),
            bits,
            start: None,
        });
        let mut all: Vec<Signal> = wires.chain(words).collect();
        let boards = [("horus", horus), ("dpr", dpr)].map(|(board, tasks)| {
            let first = all.len();
            all.extend(task_signals(board, tasks));
            (first, tasks.len())
        });
        Self { all, boards }
    }

    /// All signals; a signal's [`Id`] is its index.
    pub(super) fn all(&self) -> &[Signal] {
        &self.all
    }

    pub(super) fn wire(wire: Wire) -> Id {
        Id(wire as usize)
    }

    pub(super) fn word(word: Word) -> Id {
        Id(WIRES.len() + word as usize)
    }

    pub(super) fn task(&self, board: Board, which: TaskSignal) -> Id {
        let (first, tasks) = self.boards[board as usize];
        Id(first + which.place(tasks))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_wire_and_word_is_listed_at_the_place_of_its_number() {
        for (place, (wire, ..)) in WIRES.iter().enumerate() {
            assert_eq!(*wire as usize, place, "{wire:?}");
        }
        for (place, (word, ..)) in WORDS.iter().enumerate() {
            assert_eq!(*word as usize, place, "{word:?}");
        }
    }
}
