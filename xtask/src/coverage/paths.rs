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
            let traps = image.code.get(&next).is_some_and(|next| next.flow == Flow::Stop);
            if panics[instruction.function] || is_doomed(instruction, next, traps, &doomed) {
                doomed.insert(address);
            }
        }
        if doomed.len() == before {
            return doomed;
        }
    }
}

/// Whether `instruction` is doomed if the instructions in `doomed` are. `traps` tells that the one at `next` faults:
/// the compiler puts that behind a call of a function that never returns, such as the one of the safe state.
fn is_doomed(instruction: &Instruction, next: u32, traps: bool, doomed: &BTreeSet<u32>) -> bool {
    let is = |address: u32| doomed.contains(&(address & !1));
    // What an IT block skips is followed by the next instruction.
    let skipped = !instruction.in_block || is(next);
    skipped
        && match instruction.flow {
            Flow::On | Flow::Block(_) => is(next),
            Flow::CallRegister => !traps && is(next),
            Flow::Either(target) => is(target) && is(next),
            Flow::To(target) => is(target),
            Flow::Call(target) => is(target) || !traps && is(next),
            Flow::Table(_) => !instruction.table.is_empty() && instruction.table.iter().all(|target| is(*target)),
            Flow::Elsewhere => false,
            Flow::Stop => true,
        }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: u32 = 0x100;

    fn doomed_of(code: &[u16]) -> Vec<u32> {
        doomed(&Image::of(START, code, &[]), |_| false).into_iter().map(|address| (address - START) / 2).collect()
    }

    #[test]
    fn the_check_of_an_index_is_not_doomed_but_its_panic_is() {
        // cmp r0, #4; bhs to the fifth; ldrb r0, [r1, r0]; bx lr; movs r0, #4; udf.
        assert_eq!(doomed_of(&[0x2804, 0xD201, 0x5C08, 0x4770, 0x2004, 0xDE00]), [4, 5]);
    }

    #[test]
    fn a_call_dooms_if_its_function_or_what_follows_does() {
        // bl to the last; bx lr; nop; the last: udf.
        assert_eq!(doomed_of(&[0xF000, 0xF802, 0x4770, 0xBF00, 0xDE00]), [0, 4]);
        // bl to the last; nop; udf; the last: bx lr.
        assert_eq!(doomed_of(&[0xF000, 0xF802, 0xBF00, 0xDE00, 0x4770]), [0, 2, 3]);
    }

    #[test]
    fn a_call_of_what_never_returns_is_no_panic_by_itself() {
        // bl to the last; udf, which the compiler adds; the last: b to itself.
        assert_eq!(doomed_of(&[0xF000, 0xF801, 0xDE00, 0xE7FE]), [2]);
    }

    #[test]
    fn a_loop_and_a_return_are_not_doomed() {
        assert!(doomed_of(&[0xE7FE]).is_empty());
        assert!(doomed_of(&[0xB100, 0x4770, 0x4770]).is_empty());
        // A branch of which only one way panics: cbz r0 to the udf; bx lr; udf.
        assert_eq!(doomed_of(&[0xB100, 0x4770, 0xDE00]), [2]);
    }

    #[test]
    fn what_a_block_may_skip_is_not_doomed_by_itself() {
        // it eq; udfeq; bx lr.
        assert!(doomed_of(&[0xBF08, 0xDE00, 0x4770]).is_empty());
    }

    #[test]
    fn a_jump_by_a_table_is_doomed_if_each_target_is() {
        // tbb [pc, r0]; the table 1, 2; bx lr or udf; udf.
        let table = |first: u16| {
            let image = Image::of(START, &[0xE8DF, 0xF000, 0x0201, first, 0xDE00], &[START + 4, START + 6]);
            doomed(&image, |_| false).contains(&START)
        };
        assert!(table(0xDE00));
        assert!(!table(0x4770));
    }

    #[test]
    fn a_function_that_panics_by_name_is_doomed_as_a_whole() {
        let image = Image::of(START, &[0x2000, 0x4770], &[]);
        assert_eq!(doomed(&image, |name| name == "all").len(), 2);
    }
}
