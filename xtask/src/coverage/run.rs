//! What one run of the coverage needs.

use bench::faults::Faults;

/// A run of the link.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Run {
    pub(super) name: String,
    pub(super) faults: Faults,
    pub(super) duration_ns: u64,
    pub(super) factory_settings: bool,
    /// What receiver 1, receiver 2 and so on play instead of their own messages.
    pub(super) recordings: Vec<Vec<u8>>,
    /// Whether a violation makes the run worthless.
    pub(super) judged: bool,
}

/// Addresses in the programs, each HORUS's and the DPR's.
#[derive(Clone, Debug)]
pub(super) struct Addresses {
    /// The programs' CRCs.
    pub(super) crcs: [u32; 2],
    /// The beginnings of RAM.
    pub(super) ram: [u32; 2],
    /// A guard word.
    pub(super) guards: [u32; 2],
    /// The ends of the code that runs from RAM; 0 for none.
    pub(super) hot: [u32; 2],
    /// The handler of the most urgent task of the cycle.
    pub(super) handlers: [u32; 2],
    /// State that HORUS keeps from one task to the next.
    pub(super) kept: Vec<u32>,
    /// The beginning and the end of the variable of the DPR's task that receives frames.
    pub(super) receiver: [u32; 2],
}

#[cfg(test)]
impl Addresses {
    pub(super) const EXAMPLE: Self = Self {
        kept: vec![],
        crcs: [0x100, 0x200],
        ram: [0x2000_0000, 0x2001_0000],
        guards: [0x2000_0100, 0x2001_0100],
        hot: [0, 0x80_C000],
        handlers: [0x300, 0x400],
        receiver: [0x2001_1000, 0x2001_1080],
    };
}
