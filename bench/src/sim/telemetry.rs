//! Reads the firmwares' own counters from RAM, as a debug probe could.

use std::mem::offset_of;

use bench_judge::{Board as Side, What};
use cortex_m4::Cost;
use dpr_fw::telemetry::Telemetry as DprTelemetry;
use horus_tx_fw::telemetry::{Line, Telemetry as HorusTelemetry};

use crate::boards::{Dpr, Horus};
use emulator_node::{Board, Node};

/// HORUS's counters of faults, with their names and offsets.
const HORUS: [(&str, usize); 3] = [
    ("cycle_overruns", offset_of!(HorusTelemetry, cycle_overruns)),
    ("frames_skipped", offset_of!(HorusTelemetry, frames_skipped)),
    ("rf_faults", offset_of!(HorusTelemetry, rf_faults)),
];

/// Returns the counter at `offset` bytes in the telemetry `symbol`; `None` if the program has no such telemetry.
#[must_use]
pub fn counter<B: Board, C: Cost>(node: &Node<B, C>, symbol: &str, offset: usize) -> Option<u32> {
    let mut word = [0; 4];
    let address = node.address_of(symbol).ok()?;
    node.read(address + offset as u64, &mut word).ok()?;
    Some(u32::from_le_bytes(word))
}

/// Returns the DPR's counter `name`; `None` if the program has no telemetry.
///
/// # Panics
///
/// Panics if the firmware has no counter of that name.
#[must_use]
pub fn of_dpr<C: Cost>(node: &Node<Dpr, C>, name: &str) -> Option<u32> {
    let index = DprTelemetry::NAMES.iter().position(|other| *other == name).expect("a counter of the DPR's firmware");
    counter(node, "DPR_TELEMETRY", 4 * index)
}

/// Returns every counter of the firmwares that the judge uses.
pub(super) fn counters<C: Cost>(horus: &Node<Horus, C>, dpr: &Node<Dpr, C>, receivers: usize) -> Vec<What> {
    let of_horus = |name: String, offset| {
        let value = counter(horus, "HORUS_TELEMETRY", offset);
        What::Counter { board: Side::Horus, name, value }
    };
    let lines = (0..receivers).map(|line| {
        let offset = offset_of!(HorusTelemetry, lines) + line * size_of::<Line>() + offset_of!(Line, overruns);
        (format!("lines[{line}].overruns"), offset)
    });
    let mut counters: Vec<What> = HORUS
        .iter()
        .map(|(name, offset)| ((*name).to_owned(), *offset))
        .chain(lines)
        .map(|(name, offset)| of_horus(name, offset))
        .collect();
    counters.extend(DprTelemetry::NAMES.iter().map(|name| What::Counter {
        board: Side::Dpr,
        name: (*name).to_owned(),
        value: of_dpr(dpr, name),
    }));
    counters
}
