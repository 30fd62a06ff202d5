//! Comparisons of the bench's Cortex-M4 with independent implementations.
//!
//! | what | compared with | where |
//! |---|---|---|
//! | the effect of instructions | QEMU's `mps2-an386`, on random cases by [`Class`] | [`run`], [`recording`] |
//! | the meaning of encodings | LLVM's disassembler | [`decode`] |
//!
//! Time, sleep, debug and UNPREDICTABLE behaviour are not compared. Cases in which QEMU differs from the manual are not
//! made; a comment in their generator names them.
#![forbid(unsafe_code)]

mod class;
pub mod compare;
pub mod decode;
mod flow;
pub mod image;
mod integer;
mod memory;
pub mod ours;
mod qemu;
mod random;
pub mod recording;
mod template;
mod thumb;

use std::{
    fmt,
    path::{Path, PathBuf},
};

use anyhow::{Context, ensure};
pub use class::Class;
use image::{Case, MOST_CASES, RESULT_WORDS};
use recording::{Recorded, Recording};

/// The name of the file with QEMU's results.
pub const EXECUTION: &str = "execution.txt";
/// The name of the file with LLVM's verdicts.
pub const DECODE: &str = "decode.bin";
/// The number of recorded cases of each class. The tests repeat them in about a second.
pub const RECORDED_CASES: usize = 4096;

/// The settings of a comparison.
#[derive(Clone, Debug)]
pub struct Options {
    /// The classes to compare; an empty list means all.
    pub classes: Vec<Class>,
    /// The number of cases of each class.
    pub cases: usize,
    /// The seed of the cases.
    pub seed: u64,
    /// Whether the decoder is also compared with LLVM's disassembler.
    pub decode: bool,
    /// A directory for recordings: [`EXECUTION`] gets QEMU's results and, with `decode`, [`DECODE`] LLVM's verdicts.
    /// Recordings have [`RECORDED_CASES`] of each class, since the tests of `cortex-m4` repeat all of them.
    pub record: Option<PathBuf>,
    /// A directory in which the image and QEMU's results are stored.
    pub scratch: PathBuf,
}

impl Default for Options {
    fn default() -> Self {
        let scratch = std::env::temp_dir().join("core-oracle");
        Self { classes: Vec::new(), cases: MOST_CASES, seed: 1, decode: true, record: None, scratch }
    }
}

/// The result of the comparison for one class.
#[derive(Clone, Debug)]
pub struct Row {
    /// The class.
    pub class: Class,
    /// The number of compared cases.
    pub cases: usize,
    /// The number of cases that took a fault on QEMU.
    pub faults: usize,
    /// The number of cases whose results differ.
    pub differing: usize,
    /// The first few differing cases, in words.
    pub examples: Vec<String>,
}

/// The result of a comparison.
#[derive(Clone, Debug)]
pub struct Report {
    /// QEMU's version line.
    pub source: String,
    /// One row for each class.
    pub rows: Vec<Row>,
    /// The result for the decoder, if it was compared.
    pub decode: Option<decode::Report>,
}

impl Report {
    /// The number of differing cases of all classes, plus the number of encodings whose registers differ.
    #[must_use]
    pub fn differing(&self) -> usize {
        let registers = self.decode.as_ref().map_or(0, |decode| decode.registers_differ.len());
        registers + self.rows.iter().map(|row| row.differing).sum::<usize>()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "{}", self.source)?;
        writeln!(f, "{:14} {:>9} {:>9} {:>9}", "class", "cases", "faults", "differing")?;
        for row in &self.rows {
            writeln!(f, "{:14} {:>9} {:>9} {:>9}", row.class.name(), row.cases, row.faults, row.differing)?;
            for example in &row.examples {
                writeln!(f, "    {example}")?;
            }
        }
        if let Some(decode) = &self.decode {
            let [neither, both, undefined, executes] = decode.counts;
            writeln!(f, "encodings: {both} instructions for both, {neither} for neither")?;
            writeln!(f, "    {undefined} for LLVM only (UNPREDICTABLE), {executes} for ours only (hints, MSR)")?;
            writeln!(f, "    {} with other registers", decode.registers_differ.len())?;
            for example in decode.registers_differ.iter().take(5) {
                writeln!(f, "    {example}")?;
            }
        }
        Ok(())
    }
}

/// Makes `count` cases of `class`, from number `first` on. A case also depends on its position in the image.
#[must_use]
pub fn cases(class: Class, seed: u64, first: u64, count: usize) -> Vec<Case> {
    (0..count).map(|i| class.case(seed, first + i as u64, image::code_address(i))).collect()
}

/// Returns QEMU's results of these cases, [`RESULT_WORDS`] words each.
///
/// # Errors
///
/// Returns an error if QEMU failed, or if its file has an unexpected length.
pub fn reference(cases: &[Case], directory: &Path) -> anyhow::Result<Vec<u32>> {
    let bytes = qemu::run(&image::build(cases), image::FILE, directory)?;
    ensure!(bytes.len() == cases.len() * RESULT_WORDS * 4, "{} bytes of results", bytes.len());
    bytes.chunks(4).map(|word| Ok(u32::from_le_bytes(word.try_into().context("a word")?))).collect()
}

/// Runs random cases on QEMU and on the bench's core, and compares registers, flags, memory and faults.
///
/// # Errors
///
/// Returns an error if QEMU is missing or failed, if an image did not end on the bench's core, or if the recording was
/// not written.
pub fn run(options: &Options) -> anyhow::Result<Report> {
    let complete = options.classes.is_empty() && options.decode && options.cases == RECORDED_CASES;
    ensure!(options.record.is_none() || complete, "a recording has {RECORDED_CASES} cases of all classes, and LLVM's");
    std::fs::create_dir_all(&options.scratch)?;
    let classes = if options.classes.is_empty() { &Class::ALL[..] } else { &options.classes };
    let mut report = Report { source: qemu::version()?, rows: Vec::new(), decode: None };
    let mut recording = Recording { source: report.source.clone(), seed: options.seed, classes: Vec::new() };
    for &class in classes {
        let mut row = Row { class, cases: options.cases, faults: 0, differing: 0, examples: Vec::new() };
        let mut digests = Vec::new();
        for first in (0..options.cases).step_by(MOST_CASES) {
            let cases = cases(class, options.seed, first as u64, MOST_CASES.min(options.cases - first));
            let theirs = reference(&cases, &options.scratch).with_context(|| class.name())?;
            let ours = ours::results(&cases).with_context(|| class.name())?;
            digests.extend(recording::digests(&theirs));
            for (i, (theirs, ours)) in theirs.chunks(RESULT_WORDS).zip(ours.chunks(RESULT_WORDS)).enumerate() {
                row.faults += usize::from(theirs[54] != 0);
                if let Some(text) = compare::difference(i, &cases[i], theirs, ours) {
                    row.differing += 1;
                    if row.examples.len() < 5 {
                        row.examples.push(format!("case {} {text}", first + i));
                    }
                }
            }
        }
        recording.classes.push(Recorded { class, cases: options.cases, digests });
        report.rows.push(row);
    }
    if options.decode {
        report.decode = Some(decode::compare(&options.scratch)?);
    }
    if let Some(directory) = &options.record {
        let path = directory.join(EXECUTION);
        std::fs::write(&path, recording.to_text()).with_context(|| path.display().to_string())?;
        if let Some(decode) = &report.decode {
            std::fs::write(directory.join(DECODE), &decode.verdicts)?;
        }
    }
    Ok(report)
}
