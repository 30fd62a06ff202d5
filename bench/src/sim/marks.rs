//! The signal changes of a trace.

use crate::boards::front_end::Crossing;
use crate::trace::{Board, Bus, Mark, TaskChange, Wire};

/// The SPI clock rates of the front ends as the firmwares set them, Hz.
pub(super) const HORUS_SPI_HZ: u32 = horus_tx_fw::timing::SPI_HZ;
pub(super) const DPR_SPI_HZ: u32 = 8_000_000;

pub(super) const SSI_HZ: u32 = profile::ssi::timing::MAX_CLOCK_HZ;

pub(super) fn bus(trace: &mut Vec<Mark>, crossings: Vec<(u64, Crossing)>, bus: Bus, [cs, irq]: [Wire; 2], hz: u32) {
    for (at, crossing) in crossings {
        match crossing {
            Crossing::Select(selected) => trace.push(Mark::Level(at, cs, !selected)),
            Crossing::Byte(mosi, miso) => trace.push(Mark::Byte(at, bus, mosi, miso, hz)),
            Crossing::Irq(level) => trace.push(Mark::Level(at, irq, level)),
        }
    }
}

pub(super) fn of_tasks(board: Board, changes: Vec<TaskChange>) -> impl Iterator<Item = Mark> {
    changes.into_iter().map(move |(at, signal, value)| Mark::Task(at, board, signal, value))
}
