//! The record of executed instructions, for the object-code coverage of a firmware.
//!
//! A [`Record`] holds a copy of the code whose execution is of interest. A core with a record ([`Core::set_record`])
//! notes each instruction that it completed, with the outcome of its condition if it has one. On the fast clock it
//! notes all instructions up to a taken branch at once; those of IT blocks, and all on the other clocks, one by one. A
//! core without a record is as fast as if there were none. The run is the same either way.
//!
//! An instruction counts only if memory holds what the record's copy holds when it is noted. Code that an upset or a
//! defect changed is therefore not taken for the firmware's own.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use crate::code::Page;
use crate::decode;
use crate::op::{Do, Op};
use crate::{Bus, Core, Cost};

const EXECUTED: u8 = 1;
const PASSED: u8 = 2;
const FAILED: u8 = 4;
/// The instruction has no condition and was completed, so nothing more can be learned of it.
const COMPLETE: u8 = 8;

/// What is known of one instruction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// The instruction was completed at least once. An instruction of an IT block that was only skipped was not.
    pub executed: bool,
    /// The instruction's condition was true at least once: the branch was taken, or the instruction of an IT block was
    /// executed.
    pub passed: bool,
    /// Its condition was false at least once.
    pub failed: bool,
}

/// The executed instructions of one firmware, over all cores that share the record, on any threads.
#[derive(Debug, Default)]
pub struct Record(Vec<Area>);

#[derive(Debug)]
struct Area {
    start: u32,
    code: Vec<u16>,
    seen: Vec<AtomicU8>,
}

impl Area {
    fn place(&self, address: u32) -> Option<usize> {
        let place = (address.wrapping_sub(self.start) >> 1) as usize;
        (place < self.code.len()).then_some(place)
    }
}

impl Record {
    /// Makes an empty record of areas of code, each with its even address at run time and its bytes. An odd last byte
    /// is left out.
    pub fn new(areas: impl IntoIterator<Item = (u32, Vec<u8>)>) -> Self {
        let area = |(start, bytes): (u32, Vec<u8>)| {
            let code: Vec<u16> = bytes.as_chunks().0.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect();
            let seen = code.iter().map(|_| AtomicU8::new(0)).collect();
            Area { start, code, seen }
        };
        Self(areas.into_iter().map(area).collect())
    }

    /// What is known of the instruction that begins at `address`. Nothing is known of one outside the areas.
    #[must_use]
    pub fn seen(&self, address: u32) -> Seen {
        let bits = self.0.iter().find_map(|area| Some(area.seen[area.place(address)?].load(Relaxed))).unwrap_or(0);
        Seen { executed: bits & EXECUTED != 0, passed: bits & PASSED != 0, failed: bits & FAILED != 0 }
    }

    #[cold]
    #[inline(never)]
    fn note_run<B: Bus>(&self, bus: &mut B, page: &Page, run: Range<u32>, taken: bool) {
        let Some((area, first)) = self.0.iter().find_map(|area| Some((area, area.place(run.start)?))) else { return };
        let mut pc = run.start;
        while pc < run.end {
            let op = page.op(pc);
            let seen = area.seen.get(first + (pc - run.start) as usize / 2);
            // A breakpoint is no instruction.
            let Some(seen) = seen.filter(|_| op.size != 0) else { return };
            let next = pc + u32::from(op.size);
            if seen.load(Relaxed) & COMPLETE == 0 {
                let bits = match flow_of(op) {
                    Flow::Either(_) if taken && next == run.end => EXECUTED | PASSED,
                    Flow::Either(_) => EXECUTED | FAILED,
                    _ => EXECUTED | COMPLETE,
                };
                self.note(bus, pc, op.size, bits);
            }
            pc = next;
        }
    }

    fn note<B: Bus>(&self, bus: &mut B, pc: u32, size: u8, bits: u8) {
        let Some((area, place)) = self.0.iter().find_map(|area| Some((area, area.place(pc)?))) else { return };
        if area.seen[place].load(Relaxed) & bits == bits {
            return;
        }
        let mut halfwords = (pc..pc + u32::from(size)).step_by(2).zip(area.code.iter().skip(place));
        if halfwords.all(|(address, code)| bus.fetch(address) == Ok(*code)) {
            area.seen[place].fetch_or(bits, Relaxed);
        }
    }
}

/// Where execution can go on after an instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    /// At the next instruction.
    On,
    /// Execution goes on at this address or at the next instruction: a conditional branch.
    Either(u32),
    /// At the address.
    To(u32),
    /// Execution goes on at the function at this address, and at the next instruction when the function returns.
    Call(u32),
    /// Execution goes on at the next instruction, after a function whose address is in a register.
    CallRegister,
    /// Execution goes on at an entry of the table behind the instruction. The table has halfwords if the value is true,
    /// else bytes.
    Table(bool),
    /// Execution goes on at an address that the instruction alone does not tell: a return, or a jump to a register's
    /// value.
    Elsewhere,
    /// Execution goes on at the next instruction, which begins an IT block of one to four instructions. The value is
    /// the state for [`conditional`].
    Block(u8),
    /// Execution goes nowhere: the encoding is undefined or is `BKPT`, so the instruction faults.
    Stop,
}

/// Returns the size, in bytes, and the [`Flow`] of the instruction at `address`. `second` counts only if `first` begins
/// a 32-bit instruction.
#[must_use]
pub fn flow(address: u32, first: u16, second: u16) -> (u32, Flow) {
    let op = if decode::is_wide(first) { decode::wide(address, first, second) } else { decode::narrow(address, first) };
    (if decode::is_wide(first) { 4 } else { 2 }, flow_of(&op))
}

fn flow_of(op: &Op) -> Flow {
    match op.what {
        Do::B { target } => Flow::To(target),
        Do::BEq { target }
        | Do::BNe { target }
        | Do::BCs { target }
        | Do::BCc { target }
        | Do::BHi { target }
        | Do::BLs { target }
        | Do::BGe { target }
        | Do::BLt { target }
        | Do::BGt { target }
        | Do::BLe { target }
        | Do::BCond { target, .. }
        | Do::Cbz { target, .. }
        | Do::Cbnz { target, .. } => Flow::Either(target),
        Do::Bl { target } => Flow::Call(target),
        Do::Blx { .. } => Flow::CallRegister,
        Do::TableBranch { half, .. } => Flow::Table(half),
        Do::Bx { .. } | Do::MovToPc { .. } | Do::AddToPc { .. } => Flow::Elsewhere,
        Do::LdrLiteral { t: 15, .. }
        | Do::LoadLiteral { t: 15, .. }
        | Do::Load { t: 15, .. }
        | Do::LoadReg { t: 15, .. } => Flow::Elsewhere,
        Do::Ldm { list, .. } if list >> 15 == 1 => Flow::Elsewhere,
        Do::It { state } => Flow::Block(state),
        Do::Fault(_) | Do::Bkpt | Do::HostCall => Flow::Stop,
        _ => Flow::On,
    }
}

/// Returns whether the next instruction of an IT block has a condition that can fail. Also returns the state after that
/// instruction, which is 0 at the block's end.
#[must_use]
pub const fn conditional(state: u8) -> (bool, u8) {
    (state != 0 && state >> 4 < 14, crate::run::after(state))
}

impl<C: Cost> Core<C> {
    /// Notes each completed instruction in `record` from now on; with `None` nothing is noted. A clone of the core
    /// shares the record.
    pub fn set_record(&mut self, record: Option<Arc<Record>>) {
        self.record = record;
    }

    /// The outcome of the condition of the next instruction, `op`; `None` if `op` has no condition.
    fn outcome(&self, op: &Op) -> Option<bool> {
        if self.it != 0 {
            return conditional(self.it).0.then(|| self.passes(self.it >> 4));
        }
        let (z, c, less) = (self.flags.z(), self.flags.c, self.flags.less());
        Some(match op.what {
            Do::BEq { .. } => z,
            Do::BNe { .. } => !z,
            Do::BCs { .. } => c,
            Do::BCc { .. } => !c,
            Do::BHi { .. } => c && !z,
            Do::BLs { .. } => !c || z,
            Do::BGe { .. } => !less,
            Do::BLt { .. } => less,
            Do::BGt { .. } => !less && !z,
            Do::BLe { .. } => less || z,
            Do::BCond { condition, .. } => self.passes(condition),
            Do::Cbz { n, .. } => self.get(n) == 0,
            Do::Cbnz { n, .. } => self.get(n) != 0,
            _ => return None,
        })
    }

    /// Whether the next instruction must be noted by itself.
    #[inline(always)]
    pub(crate) fn notes_one_by_one(&self) -> bool {
        self.record.is_some() && (C::BOUND.is_some() || self.it != 0)
    }

    /// Notes the instructions of `page` from [`Core::unnoted`] to `end` if there is a record. They were executed one
    /// after the other outside IT blocks. `taken` says that the last one is a branch that was taken.
    #[inline(always)]
    pub(crate) fn note_run<B: Bus>(&self, bus: &mut B, page: &Page, end: u32, taken: bool) {
        if let Some(record) = &self.record {
            record.note_run(bus, page, self.unnoted..end, taken);
        }
    }

    /// Executes `op` at r15 as [`Core::single`] does, and notes it if there is a record.
    #[inline(never)]
    pub(crate) fn single_noted<B: Bus>(&mut self, bus: &mut B, op: &Op) {
        // The record is moved, not cloned: boards on several threads that share a record would contend for its
        // reference count.
        let Some(record) = self.record.take_if(|_| op.size != 0) else { return self.single(bus, op) };
        let (pc, retired, outcome) = (self.r[15], self.retired, self.outcome(op));
        self.single(bus, op);
        if self.retired != retired {
            let bits = match outcome {
                None => EXECUTED,
                Some(true) => EXECUTED | PASSED,
                Some(false) if matches!(flow_of(op), Flow::Either(_)) => EXECUTED | FAILED,
                Some(false) => FAILED,
            };
            record.note(bus, pc, op.size, bits);
        }
        self.record = Some(record);
    }
}
