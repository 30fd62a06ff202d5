//! What of an image was executed, and what was not.

use std::collections::BTreeMap;
use std::ops::AddAssign;

use anyhow::{Result, ensure};
use cortex_m4::coverage::{Flow, Record, Seen};

use super::callers::follow;
use super::image::{Image, Instruction};
use super::part::Part;
use super::paths::doomed;
use super::source::{Origin, Place, Source};
use super::twins;

/// The path prefixes of the sources that decide.
const DECIDING: [&str; 13] = [
    "profile/src/",
    "horus-tx-fw/voter/src/",
    "horus-tx-fw/src/receiver.rs",
    "horus-tx-fw/src/state_inputs.rs",
    "dpr-fw/src/accept.rs",
    "dpr-fw/src/intake.rs",
    "dpr-fw/src/link.rs",
    "dpr-fw/src/commit.rs",
    "dpr-fw/src/port/",
    "dpr-fw/src/integrity.rs",
    "firmware-common/src/check_in.rs",
    "firmware-common/src/safe_state.rs",
    "firmware-common/src/patrol/",
];

/// The path prefixes of the sources with deadlines.
const DEADLINE: [&str; 11] = [
    "dpr-fw/src/publish/",
    "dpr-fw/src/triple/",
    "dpr-fw/src/ssi.rs",
    "dpr-fw/src/rf.rs",
    "dpr-fw/src/hw/ssi.rs",
    "dpr-fw/src/hw/rf.rs",
    "horus-tx-fw/src/cycle.rs",
    "horus-tx-fw/src/transmitter.rs",
    "horus-tx-fw/src/hw/radio.rs",
    "horus-tx-fw/src/hw/cycle_timer.rs",
    "st25r3916/src/listener.rs",
];

/// Whether a function of this name is part of a panic.
pub(super) fn is_panic(name: &str) -> bool {
    ["core::panicking", "core::panic::", "rust_begin_unwind", "::hw::panic", "defmt_panic"]
        .iter()
        .any(|part| name.contains(part))
}

/// Whether a function of this name is part of the log.
fn is_log(name: &str) -> bool {
    ["defmt", "core::fmt", "::hw::log_stop"].iter().any(|part| name.contains(part))
}

/// A number of things, and how many of them were seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Count {
    pub(super) seen: u64,
    pub(super) all: u64,
}

impl Count {
    fn add(&mut self, seen: bool) {
        *self += Self { seen: seen.into(), all: 1 };
    }

    /// The seen share in percent; none of nothing is 0.
    pub(super) fn percent(self) -> f64 {
        if self.all == 0 { 0.0 } else { 100.0 * self.seen as f64 / self.all as f64 }
    }
}

impl AddAssign for Count {
    fn add_assign(&mut self, other: Self) {
        self.seen += other.seen;
        self.all += other.all;
    }
}

/// The counts of one part of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) instructions: Count,
    /// Both outcomes of each conditional branch, without those that lead only to a panic.
    pub(super) branches: Count,
    /// Both outcomes of each instruction in an IT block.
    pub(super) blocks: Count,
}

impl Counts {
    fn outcomes(&mut self, in_block: bool) -> &mut Count {
        if in_block { &mut self.blocks } else { &mut self.branches }
    }
}

impl AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.instructions += other.instructions;
        self.branches += other.branches;
        self.blocks += other.blocks;
    }
}

/// What is missing of one instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Missing {
    /// It was never executed.
    Execution,
    /// Its branch was never taken.
    Taken,
    /// Its branch was always taken.
    NotTaken,
    /// Its condition in an IT block was always true.
    Skipped,
}

impl Missing {
    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::Execution => "never executed",
            Self::Taken => "branch never taken",
            Self::NotTaken => "branch always taken",
            Self::Skipped => "condition always true",
        }
    }
}

/// An instruction with a gap.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Gap {
    pub(super) address: u32,
    pub(super) function: usize,
    pub(super) part: Part,
    pub(super) missing: Missing,
    /// The lines of this workspace, from the innermost to the outermost.
    pub(super) places: Vec<Place>,
    /// The names of the functions that are inlined here.
    pub(super) inlined: Vec<String>,
    /// The file of the innermost function if it is one of a library.
    pub(super) library: String,
    /// What would be seen in addition without this gap.
    pub(super) lost: Counts,
}

/// The coverage of one image.
#[derive(Debug, Default)]
pub(super) struct Coverage {
    pub(super) counts: BTreeMap<Part, Counts>,
    pub(super) gaps: Vec<Gap>,
}

impl Coverage {
    /// The counts of the parts for which `counted` is true.
    pub(super) fn sum(&self, counted: impl Fn(Part) -> bool) -> Counts {
        let mut sum = Counts::default();
        self.counts.iter().filter(|(part, _)| counted(**part)).for_each(|(_, counts)| sum += *counts);
        sum
    }
}

/// Compares an image with the record of what was executed of it.
///
/// # Errors
///
/// No instruction was executed. A run that does not run is no evidence.
pub(super) fn coverage(
    image: &Image,
    record: &Record,
    origins: &BTreeMap<u32, Origin>,
    sources: &BTreeMap<String, Source>,
) -> Result<Coverage> {
    let doomed = doomed(image, is_panic);
    let part_of = |(&address, instruction): (&u32, &Instruction)| {
        let name = &image.functions[instruction.function].name;
        (address, part(name, doomed.contains(&address), &origins[&address], sources))
    };
    let mut parts: BTreeMap<u32, Part> = image.code.iter().map(part_of).collect();
    follow(image, &mut parts);
    let others = twins::others(image, origins, |address| record.seen(address).executed);
    let mut coverage = Coverage::default();
    for (&address, instruction) in &image.code {
        let (origin, part) = (&origins[&address], parts[&address]);
        let seen = record.seen(address);
        let counts = coverage.counts.entry(part).or_default();
        counts.instructions.add(seen.executed);
        let mut missing: BTreeMap<Missing, Counts> = BTreeMap::new();
        if !seen.executed {
            missing.entry(Missing::Execution).or_default().instructions.seen += 1;
        }
        if let Some((outcomes, kinds)) = outcomes(instruction.flow, instruction.in_block, seen) {
            let next = address + instruction.size;
            let leads_to = [if let Flow::Either(target) = instruction.flow { target } else { next }, next];
            for ((outcome, kind), to) in outcomes.into_iter().zip(kinds).zip(leads_to) {
                let is_counted = instruction.in_block || part == Part::Panic || !doomed.contains(&to);
                if !is_counted {
                    continue;
                }
                counts.outcomes(instruction.in_block).add(outcome);
                if !outcome {
                    let kind = if seen.executed { kind } else { Missing::Execution };
                    missing.entry(kind).or_default().outcomes(instruction.in_block).seen += 1;
                }
            }
        }
        let gap = |(missing, lost)| {
            let Origin { places, mut inlined, library, .. } = origin.clone();
            inlined.extend(others.contains(&address).then(|| twins::NAME.to_owned()));
            Gap { address, function: instruction.function, part, missing, places, inlined, library, lost }
        };
        coverage.gaps.extend(missing.into_iter().map(gap));
    }
    let Count { seen, all } = coverage.sum(|_| true).instructions;
    ensure!(seen > 0, "{seen} of {all} instructions were executed");
    Ok(coverage)
}

/// The outcomes of an instruction's condition and what is missing without them; `None` if it has no condition.
fn outcomes(flow: Flow, in_block: bool, seen: Seen) -> Option<([bool; 2], [Missing; 2])> {
    let outcomes = [seen.passed, seen.failed];
    if in_block {
        return Some((outcomes, [Missing::Execution, Missing::Skipped]));
    }
    matches!(flow, Flow::Either(_)).then_some((outcomes, [Missing::Taken, Missing::NotTaken]))
}

fn part(function: &str, doomed: bool, origin: &Origin, sources: &BTreeMap<String, Source>) -> Part {
    let logs = |place: &Place| sources.get(&place.file).is_some_and(|source| source.logs.contains(&place.line));
    if doomed {
        Part::Panic
    } else if is_log(function) || origin.logs || origin.places.iter().any(logs) {
        Part::Log
    } else if let Some(place) = origin.places.first() {
        let is_in = |files: &[&str]| files.iter().any(|file| place.file.starts_with(file));
        if is_in(&DECIDING) {
            Part::Deciding
        } else if is_in(&DEADLINE) {
            Part::Deadline
        } else {
            Part::Other
        }
    } else {
        Part::Library
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: u32 = 0x100;

    /// `cmp r0, #0; beq` over the next; `nop; bx lr`, with each instruction on a line of its own.
    fn image() -> (Image, BTreeMap<u32, Origin>) {
        let image = Image::of(START, &[0x2800, 0xD000, 0xBF00, 0x4770], &[]);
        let place = |address: u32| Place { file: "dpr-fw/src/link.rs".into(), line: (address - START) / 2 + 1 };
        let origin = |address: u32| Origin { places: vec![place(address)], ..Origin::default() };
        let origins = image.code.keys().map(|address| (*address, origin(*address))).collect();
        (image, origins)
    }

    #[test]
    fn an_image_that_executes_nothing_fails() {
        let (image, origins) = image();
        let record = Record::new(image.areas.clone());
        let error = coverage(&image, &record, &origins, &BTreeMap::new()).unwrap_err();
        assert_eq!(error.to_string(), "0 of 4 instructions were executed");
    }

    #[test]
    fn a_part_without_instructions_has_no_share() {
        assert_eq!(Count::default().percent(), 0.0);
        assert_eq!(Count { seen: 1, all: 4 }.percent(), 25.0);
    }

    #[test]
    fn instructions_of_the_log_and_of_panics_are_parts_of_their_own() {
        let (_, origins) = image();
        let origin = &origins[&START];
        let logs = Source { logs: [1].into(), ..Source::default() };
        let sources = [("dpr-fw/src/link.rs".to_owned(), logs)].into();
        assert_eq!(part("judge", false, origin, &BTreeMap::new()), Part::Deciding);
        assert_eq!(part("judge", false, origin, &sources), Part::Log);
        assert_eq!(part("judge", true, origin, &sources), Part::Panic);
        assert_eq!(part("core::fmt::write", false, &Origin::default(), &sources), Part::Log);
        assert_eq!(part("__aeabi_memcpy", false, &Origin::default(), &sources), Part::Library);
    }

    #[test]
    fn both_outcomes_of_a_branch_and_of_a_block_are_asked_for() {
        let seen = Seen { executed: true, passed: true, failed: false };
        assert_eq!(outcomes(Flow::On, false, seen), None);
        let branch = outcomes(Flow::Either(0), false, seen).unwrap();
        assert_eq!(branch, ([true, false], [Missing::Taken, Missing::NotTaken]));
        assert_eq!(outcomes(Flow::On, true, seen).unwrap().1[1], Missing::Skipped);
    }
}
