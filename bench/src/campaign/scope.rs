//! The settings that determine the trials of a campaign.

use std::fmt;

use emulator_node::Clock;

use crate::faults::Kind;

/// The settings that determine the trials of a campaign, for given firmwares.
#[derive(Clone, Debug, PartialEq)]
pub struct Scope {
    /// The kinds of fault, which the trials use in turn.
    pub kinds: Vec<Kind>,
    /// The seed of the flight and of all faults.
    pub seed: u64,
    /// The number of receivers.
    pub gps: usize,
    /// The clock that determines how long instructions take.
    pub clock: Clock,
    /// The bit error rate of the faults of [`Kind::Bits`].
    pub bit_error: f64,
    /// The length, s, of the interval from which the faults' instants are drawn. It begins when both boards have
    /// started.
    pub seconds: u64,
}

impl fmt::Display for Scope {
    /// Writes these settings as options of the command line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { seed, gps, clock, bit_error, seconds, .. } = self;
        let kinds: Vec<&str> = self.kinds.iter().map(|kind| kind.word()).collect();
        let kinds = kinds.join(",");
        write!(f, "--seed {seed} --gps {gps} --clock {clock} --seconds {seconds} --kinds {kinds}")?;
        write!(f, " --bit-error-rate {bit_error}")
    }
}
