//! Which instructions lead only to a panic, and which outcomes of a branch do.
//!
//! An instruction is doomed if each path from it ends in a panic or in an instruction that faults: the check of an
//! index calls a function of `core::panicking`, and what prepares its arguments is of no use for anything else. A loop
//! is not doomed, for instance the one in which the safe state waits for the watchdog.

use std::collections::BTreeSet;

use cortex_m4::coverage::Flow;

use super::image::{Image, Instruction};

/// Returns the addresses of the doomed instructions of `image`. Each function for whose name `panics` is true is doomed
/// as a whole.
pub(super) fn doomed(image: &Image, panics: impl Fn(&str) -> bool) -> BTreeSet<u32> {
    let panics: Vec<bool> = image.functions.iter().map(|function| panics(&function.name)).collect();
    let mut doomed: BTreeSet<u32> = BTreeSet::new();
    loop {
        let before = doomed.len();
        // Backwards, since most paths lead to higher addresses.
        for (&address, instruction) in image.code.iter().rev() {
            let next = address + instruction.size;
            if panics[instruction.function] || is_doomed(instruction, next, &doomed) {
                doomed.insert(address);
            }
        }
        if doomed.len() == before {
            return doomed;
        }
    }
}

fn is_doomed(instruction: &Instruction, next: u32, doomed: &BTreeSet<u32>) -> bool {
    let is = |address: u32| doomed.contains(&(address & !1));
    // What an IT block skips is followed by the next instruction.
    let skipped = !instruction.in_block || is(next);
    skipped
        && match instruction.flow {
            Flow::On | Flow::Block(_) | Flow::CallRegister => is(next),
            Flow::Either(target) => is(target) && is(next),
            Flow::To(target) => is(target),
            Flow::Call(target) => is(target) || is(next),
            Flow::Table(_) => !instruction.table.is_empty() && instruction.table.iter().all(|target| is(*target)),
            Flow::Elsewhere => false,
            Flow::Stop => true,
        }
}
