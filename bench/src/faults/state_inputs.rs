//! What the inputs say that tell HORUS's state: relay, motor cut, emergency measure.

/// How many inputs there are, each a pair of pins.
pub const INPUTS: usize = 3;

/// Their names, the least severe first.
const NAMES: [&str; INPUTS] = ["relay", "motor cut", "emergency measure"];

/// What an input says while an episode lasts; else it is inactive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputFault {
    /// It is active, which is no fault of its own.
    Active,
    /// Both pins are high: a broken wire, which the pull-ups hold.
    BothHigh,
    /// Both pins are low: a short to ground.
    BothLow,
    /// The contact chatters: both pins change over after every such time, ns.
    Chatters(u64),
}

impl InputFault {
    /// Each once. One contact chatters by less than a cycle, one by more.
    pub const ALL: [Self; 5] =
        [Self::Active, Self::BothHigh, Self::BothLow, Self::Chatters(3_700_000), Self::Chatters(13_000_000)];

    /// What the event log calls it of this input, from 0.
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

    /// The levels of the two pins at its beginning: that which is high while the input is active, and the other one.
    #[must_use]
    pub const fn levels(self) -> (bool, bool) {
        match self {
            Self::Active | Self::Chatters(_) => (true, false),
            Self::BothHigh => (true, true),
            Self::BothLow => (false, false),
        }
    }
}
