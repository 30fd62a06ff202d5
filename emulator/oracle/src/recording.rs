//! A recording of QEMU's results, for comparisons without QEMU.
//!
//! A recording is a text: a line with the version of QEMU, a line `seed N`, then for each class a line `class NAME
//! CASES` and one 64-bit digest for each [`BATCH`] cases, in hexadecimal, eight to a line.

use anyhow::Context;

use crate::{
    Class,
    image::{MOST_CASES, RESULT_WORDS},
};

/// The number of cases that one digest covers.
pub const BATCH: usize = 64;

/// The recording of one class.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// The class.
    pub class: Class,
    /// The number of cases, from case 0 on.
    pub cases: usize,
    /// One digest for each [`BATCH`] cases.
    pub digests: Vec<u64>,
}

/// The contents of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recording {
    /// QEMU's version line.
    pub source: String,
    /// The seed of the cases.
    pub seed: u64,
    /// The recordings of all classes.
    pub classes: Vec<Recorded>,
}

/// Returns the digests of these results: FNV-1a over words, with a final mixing.
#[must_use]
pub fn digests(results: &[u32]) -> Vec<u64> {
    let digest = |words: &[u32]| {
        let hash = words
            .iter()
            .fold(0xCBF2_9CE4_8422_2325_u64, |hash, &word| (hash ^ u64::from(word)).wrapping_mul(0x0100_0000_01B3));
        hash ^ hash >> 29
    };
    results.chunks(BATCH * RESULT_WORDS).map(digest).collect()
}

impl Recording {
    /// Converts the recording to text.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = format!("{}\nseed {}\n", self.source, self.seed);
        for recorded in &self.classes {
            text += &format!("class {} {}\n", recorded.class.name(), recorded.cases);
            for line in recorded.digests.chunks(8) {
                let line: Vec<String> = line.iter().map(|digest| format!("{digest:016x}")).collect();
                text += &(line.join(" ") + "\n");
            }
        }
        text
    }

    /// Reads a recording from text.
    ///
    /// # Errors
    ///
    /// Returns an error if the text is no recording.
    pub fn from_text(text: &str) -> anyhow::Result<Self> {
        let mut lines = text.lines();
        let source = lines.next().context("a first line")?.to_owned();
        let seed = lines.next().and_then(|line| line.strip_prefix("seed ")).context("a seed")?.parse()?;
        let mut classes: Vec<Recorded> = Vec::new();
        for line in lines {
            if let Some(rest) = line.strip_prefix("class ") {
                let (name, cases) = rest.split_once(' ').context("a class and its number of cases")?;
                let class = Class::from_name(name).with_context(|| format!("no class {name}"))?;
                classes.push(Recorded { class, cases: cases.parse()?, digests: Vec::new() });
            } else {
                let recorded = classes.last_mut().context("digests before a class")?;
                for digest in line.split_whitespace() {
                    recorded.digests.push(u64::from_str_radix(digest, 16)?);
                }
            }
        }
        Ok(Self { source, seed, classes })
    }

    /// Runs the cases on the bench's core, and names each batch whose digest differs.
    ///
    /// # Errors
    ///
    /// Returns an error if an image did not run to its end on the bench's core.
    pub fn check(&self) -> anyhow::Result<Vec<String>> {
        let mut differing = Vec::new();
        for recorded in &self.classes {
            let mut ours = Vec::new();
            for first in (0..recorded.cases).step_by(MOST_CASES) {
                let count = MOST_CASES.min(recorded.cases - first);
                let cases = crate::cases(recorded.class, self.seed, first as u64, count);
                let results = crate::ours::results(&cases).with_context(|| recorded.class.name())?;
                ours.extend(digests(&results));
            }
            for batch in 0..ours.len().max(recorded.digests.len()) {
                if ours.get(batch) != recorded.digests.get(batch) {
                    let (name, first) = (recorded.class.name(), batch * BATCH);
                    differing.push(format!("{name}: among the cases {first} to {}", first + BATCH - 1));
                }
            }
        }
        Ok(differing)
    }
}
