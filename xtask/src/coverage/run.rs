//! What one run of the coverage needs.

use bench::faults::Faults;

/// A run of the link.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Run {
    pub(super) name: String,
    pub(super) faults: Faults,
    pub(super) duration_ns: u64,
    pub(super) factory_settings: bool,
    /// Whether receiver 1 sends every message that the parser knows ([`super::messages`]).
    pub(super) every_message: bool,
    /// Whether a violation makes the run worthless.
    pub(super) judged: bool,
}

/// Addresses in the programs, each HORUS's and the DPR's.
#[derive(Clone, Copy, Debug)]
pub(super) struct Addresses {
    /// The programs' CRCs.
    pub(super) crcs: [u32; 2],
    /// The beginnings of RAM.
    pub(super) ram: [u32; 2],
    /// A guard word.
    pub(super) guards: [u32; 2],
    /// The ends of the code that runs from RAM; 0 for none.
    pub(super) hot: [u32; 2],
    /// The beginning and the end of the variable of the DPR's task that receives frames.
    pub(super) receiver: [u32; 2],
}

#[cfg(test)]
impl Addresses {
    pub(super) const EXAMPLE: Self = Self {
        crcs: [0x100, 0x200],
        ram: [0x2000_0000, 0x2001_0000],
        guards: [0x2000_0100, 0x2001_0100],
        hot: [0, 0x80_C000],
        receiver: [0x2001_1000, 0x2001_1080],
    };
}
