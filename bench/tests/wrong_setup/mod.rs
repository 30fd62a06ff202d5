//! Tests wrong setups. Both release programs are patched so that they set a register up wrongly, and they must fail as
//! on silicon.
//!
//! Each row changes the value that the firmware writes to one register (see [`rewrite`]). It states the symptom, which
//! the original program must not show: on the air, on the SSI, in the log, in the telemetry, or a restart. It also
//! states which finding the models must report; there is none where silicon would not detect the fault.

use crate::boards;
mod dpr;
mod horus;
use crate::reader;

use std::fmt::Debug;
use std::sync::OnceLock;

use bench::boards::{Dpr, Horus};
use bench::faults::image::{Change, ImageFault, Recording, To, rewrite};
use boards::{RAM_TEST, counter};
use dpr_fw::telemetry::Telemetry as DprTelemetry;
use emulator_node::{Finding, Node};
use emulator_part::Reset;
use gnss_sim::ubx::NavPvt;
use horus_tx_fw::telemetry::{Line, Telemetry as HorusTelemetry};
use profile::{GpsObject, Identifier, ReportedPosition};
use reader::{MS, View, field_on, payload, send, view};
use st25r3916_model::AirEvent;

const fn bits(address: u32, mask: u32, value: u32) -> Change {
    Change { address, to: To::Bits { mask, value } }
}

const fn instead(address: u32, of: u32, value: u32) -> Change {
    Change { address, to: To::Instead { of, value } }
}

const fn never(address: u32) -> Change {
    Change { address, to: To::Nothing }
}

/// Returns a change that omits the store that sets bit `bit` of the RCC register at `offset` by its bit-band alias
/// (ARMv7-M ARM B3.1.1).
const fn gate(offset: u32, bit: u32) -> Change {
    never(0x4247_0000 + 32 * offset + 4 * bit)
}

#[derive(Clone, Copy, Debug)]
enum Expected {
    /// The models report no finding, because silicon cannot detect the wrong setup either.
    Nothing,
    /// The models report a finding whose text contains this one.
    Finding(&'static str),
}

struct Row<S> {
    what: &'static str,
    changes: &'static [Change],
    seen: fn(&S) -> bool,
    told: Expected,
}

const fn row<S>(what: &'static str, changes: &'static [Change], told: Expected, seen: fn(&S) -> bool) -> Row<S> {
    Row { what, changes, seen, told }
}

fn check<S: Debug>(rows: &[Row<S>], healthy: &S, run: impl Fn(&[Change]) -> (S, Vec<String>)) {
    let mut wrong = vec![];
    for row in rows {
        let (seen, told) = run(row.changes);
        let mut say = |why: &str| wrong.push(format!("{}: {why}\n  {seen:?}\n  {told:#?}", row.what));
        if (row.seen)(healthy) {
            say("the image as it was built shows the same");
        }
        if !(row.seen)(&seen) {
            say("not seen");
        }
        match row.told {
            Expected::Nothing if !told.is_empty() => say("silicon would not tell"),
            Expected::Finding(words) if !told.iter().any(|text| text.contains(words)) => say("no such finding"),
            _ => {}
        }
    }
    assert!(wrong.is_empty(), "{} of {} rows:\n{}", wrong.len(), rows.len(), wrong.join("\n"));
}

/// Runs, for every row, a patch that changes no value, because the stubs themselves must have no effect.
fn control<S: Debug>(rows: &[Row<S>], recording: &Recording, run: impl Fn(&[Change]) -> (S, Vec<String>)) -> Vec<S> {
    let mut all = vec![];
    for row in rows {
        let same = |change: &Change| {
            let values = recording.to(change.address).map(|stored| stored.value);
            values.map(|value| instead(change.address, value, value)).collect::<Vec<_>>()
        };
        let changes: Vec<Change> = row.changes.iter().flat_map(same).collect();
        let (seen, told) = run(&changes);
        assert!(told.is_empty(), "{}: {told:?}", row.what);
        all.push(seen);
    }
    all
}

fn words(findings: Vec<Finding>) -> Vec<String> {
    findings.iter().map(|finding| format!("{:?}: {}", finding.kind, finding.text)).collect()
}

/// The interrupts' enable registers, ARMv7-M ARM B3.4.4.
const ISER: u32 = 0xE000_E100;

/// Returns a change of the store to ISER register `word` that enables the interrupts `of`. The changed store enables
/// none of them.
const fn never_iser(word: u32, of: u32) -> Change {
    instead(ISER + 4 * word, of, 0)
}
