//! Faults of HORUS's state inputs: relay, motor cut, emergency measure.

/// The number of HORUS's state inputs; each is a pair of pins.
pub const INPUTS: usize = 3;

/// The names of the state inputs, the input of the least severe state first.
const NAMES: [&str; INPUTS] = ["relay", "motor cut", "emergency measure"];

/// The state of a pair of pins during an episode. Without a fault the pins say that the input is inactive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputFault {
    /// The input is active, which is not a fault in itself.
    Active,
    /// Both pins of the input are high, held by the pull-ups, as with a broken wire.
    BothHigh,
    /// Both pins of the input are low, as after a short to ground.
    BothLow,
    /// The contact chatters: the levels of both pins are inverted at this interval, ns.
    Chatters(u64),
}

impl InputFault {
    /// All faults of a state input. The contact chatters once faster and once slower than HORUS's cycle.
    pub const ALL: [Self; 5] =
        [Self::Active, Self::BothHigh, Self::BothLow, Self::Chatters(3_700_000), Self::Chatters(13_000_000)];

    /// Returns the fault's name in the event log for input `input`, from 0.
    #[must_use]
    pub fn name(self, input: usize) -> String {
        let what = match self {
            Self::Active => "active",
            Self::BothHigh => "both pins high",
            Self::BothLow => "both pins low",
            Self::Chatters(_) => "chatters",
        };
        format!("{} {what}", NAMES.get(input).unwrap_or(&"no input"))
    }

    /// Returns the levels of both pins at the beginning of the fault. The first pin is high while the input is active.
    #[must_use]
    pub const fn levels(self) -> (bool, bool) {
        match self {
            Self::Active | Self::Chatters(_) => (true, false),
            Self::BothHigh => (true, true),
            Self::BothLow => (false, false),
        }
    }
}
