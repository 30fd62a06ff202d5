//! Defines the alarms that a base station shows to its user.

use core::fmt;

/// The severity of an alarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// Something is wrong, but the displayed data are valid.
    Warning,
    /// Critical: the displayed data are not valid, or HORUS has acted.
    Critical,
}

macro_rules! alarms {
    ($($(#[$doc:meta])* $name:ident, $code:literal, $severity:ident, $words:literal;)*) => {
        /// A reason for an alarm to the user.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Alarm {
            $($(#[$doc])* $name,)*
        }

        impl Alarm {
            /// All alarms, the gravest first.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// Returns the alarm's name for programs. The name does not change in later versions.
            #[must_use]
            pub const fn code(self) -> &'static str {
                match self { $(Self::$name => $code,)* }
            }

            /// Returns the alarm's severity.
            #[must_use]
            pub const fn severity(self) -> Severity {
                match self { $(Self::$name => Severity::$severity,)* }
            }

            /// Returns the alarm's text for the user.
            #[must_use]
            pub const fn words(self) -> &'static str {
                match self { $(Self::$name => $words,)* }
            }
        }
    };
}

alarms! {
    /// HORUS reports that it fired the emergency measure.
    EmergencyFired, "emergency-fired", Critical, "HORUS has fired the emergency measure";
    /// HORUS reports that it cut the motors.
    MotorsCut, "motors-cut", Critical, "HORUS has cut the motors";
    /// HORUS reports that it switched to the redundant flight controller.
    SwitchedToRedundant, "switched-to-redundant", Critical, "HORUS has switched to the redundant flight controller";
    /// HORUS reports that the position is outside of the flight range.
    OutsideRange, "outside-range", Critical, "the drone is outside of its flight range";
    /// HORUS's state inputs contradict each other, and no more severe state is known.
    InputsContradict, "inputs-contradict", Critical, "HORUS cannot tell its state: its inputs contradict";
    /// HORUS reports a state of a later version, which has no name here.
    UnknownState, "unknown-state", Critical, "HORUS is in a state that this station does not know";
    /// Within the last [`RECENT_US`](crate::drone::RECENT_US), another sender used this drone's id, or two different
    /// contents came for one sample.
    TwoSenders, "two-senders", Critical, "two senders speak as this drone: one of them may be false";
    /// HORUS reports that it has lost its position.
    PositionLost, "position-lost", Critical, "HORUS has lost its position and does not monitor";
    /// HORUS reports a fault of its memory.
    HorusMemoryFault, "horus-memory-fault", Critical, "HORUS has found a fault of its memory";
    /// No intact data of this drone have arrived for [`SILENT_US`](crate::drone::SILENT_US).
    Silent, "silent", Critical, "nothing arrives from this drone";
    /// Reported-Position is older than [`STALE_US`](crate::drone::STALE_US), or was never received.
    Stale, "stale", Critical, "the position shown is old";
    /// The DPR reports that frames of HORUS miss their deadline.
    LinkDown, "link-down", Critical, "the radio link from HORUS to the DPR is down";
    /// The DPR's front end works but detects no field of HORUS.
    NoField, "no-field", Critical, "the DPR senses no field of HORUS's transmitter";
    /// HORUS repeats its timestamp: the DPR reports this, or the same sample keeps arriving.
    Frozen, "frozen", Critical, "HORUS repeats the same sample";
    /// The DPR does not find HORUS's sequence, or the data that arrive do not continue the displayed ones.
    OutOfSequence, "out-of-sequence", Critical, "what arrives does not continue what was shown";
    /// HORUS marks an impossible position as valid ([`profile::range`]).
    Implausible, "implausible", Critical, "no position: what HORUS calls valid cannot be one";
    /// HORUS marks Reported-Position as not valid.
    NoAgreement, "no-agreement", Critical, "no position: too few receivers agree";
    /// The DPR or this station finds an error of more than 2 % in HORUS's clock.
    ClockImplausible, "clock-implausible", Critical, "HORUS's clock is wrong by more than 2 %";
    /// The DPR found a fault of its RAM.
    RamFault, "ram-fault", Critical, "the DPR has found a fault of its RAM";
    /// The DPR's program memory differs from the programmed contents.
    FlashFault, "flash-fault", Critical, "the DPR's program memory is damaged";
    /// The DPR's RFID front end has a fault.
    FrontEndFault, "front-end-fault", Critical, "the DPR's RFID front end has a fault";
    /// The displayed data of a receiver are older than [`OLD_US`](crate::drone::OLD_US).
    ReceiversOld, "receivers-old", Warning, "what is shown of the receivers is old";
    /// The displayed Link-Status is older than [`OLD_US`](crate::drone::OLD_US).
    LinkStatusOld, "link-status-old", Warning, "what is shown of the link from HORUS to the DPR is old";
    /// A receiver marks an impossible position as valid.
    ReceiverImplausible, "receiver-implausible", Warning, "a receiver calls a position valid that cannot be one";
    /// HORUS started again within the last [`RECENT_US`](crate::drone::RECENT_US).
    Restarted, "restarted", Warning, "HORUS has started again";
    /// HORUS's last reset was caused by a fault.
    HorusUnaskedReset, "horus-unasked-reset", Warning, "HORUS was reset by a fault";
    /// The DPR's last reset was caused by a fault.
    UnaskedReset, "unasked-reset", Warning, "the DPR was reset by a fault";
    /// Fewer receivers agree than are fitted, or they agree on no altitude.
    Degraded, "degraded", Warning, "fewer receivers agree than the drone has, or on no altitude";
    /// HORUS runs on its internal oscillator, without its crystal.
    NoCrystal, "no-crystal", Warning, "HORUS runs without its crystal";
    /// An object that is damaged or of another kind than expected arrived within the last
    /// [`RECENT_US`](crate::drone::RECENT_US).
    Damaged, "damaged", Warning, "damaged data arrived and were rejected";
}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.words())
    }
}

/// A set of alarms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Alarms(u64);

const _: () = assert!(Alarm::ALL.len() <= 64, "a bit for each alarm");

impl Alarms {
    /// Returns the empty set of alarms.
    #[must_use]
    pub const fn none() -> Self {
        Self(0)
    }

    /// Returns the set with `alarm` added if `holds` is true.
    #[must_use]
    pub const fn with(self, alarm: Alarm, holds: bool) -> Self {
        if holds { Self(self.0 | 1 << alarm as u64) } else { self }
    }

    /// Returns whether `alarm` is in the set.
    #[must_use]
    pub const fn has(self, alarm: Alarm) -> bool {
        self.0 & 1 << alarm as u64 != 0
    }

    /// Returns each alarm in the set, the gravest first.
    pub fn iter(self) -> impl Iterator<Item = Alarm> {
        Alarm::ALL.iter().copied().filter(move |alarm| self.has(*alarm))
    }
}

/// An alarm that holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Raised {
    /// The alarm that holds.
    pub alarm: Alarm,
    /// The instant since which the alarm holds, µs.
    pub since_us: u64,
}

/// Tells that an alarm has begun or ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// The alarm that began or ended.
    pub alarm: Alarm,
    /// Whether the alarm began.
    pub raised: bool,
    /// The instant at which the alarm began or ended, µs.
    pub at_us: u64,
}

/// The alarms that hold at present, each with the instant at which it began.
#[derive(Clone, Debug, Default)]
pub struct Board {
    held: Alarms,
    since_us: [u64; Alarm::ALL.len()],
}

impl Board {
    /// Makes `now` the set of alarms that hold at `at_us`. Returns the alarms that began or ended.
    pub fn set(&mut self, at_us: u64, now: Alarms) -> Vec<Change> {
        let before = core::mem::replace(&mut self.held, now);
        let changed = Alarm::ALL.iter().copied().filter(|alarm| before.has(*alarm) != now.has(*alarm));
        let changes: Vec<_> = changed.map(|alarm| Change { alarm, raised: now.has(alarm), at_us }).collect();
        for change in changes.iter().filter(|change| change.raised) {
            self.since_us[change.alarm as usize] = at_us;
        }
        changes
    }

    /// Returns the set of alarms that hold at present.
    #[must_use]
    pub const fn held(&self) -> Alarms {
        self.held
    }

    /// Returns each alarm that holds at present, with the instant at which it began, the gravest first.
    pub fn raised(&self) -> impl Iterator<Item = Raised> {
        self.held.iter().map(|alarm| Raised { alarm, since_us: self.since_us[alarm as usize] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_tells_what_came_what_went_and_since_when() {
        let mut board = Board::default();
        let two = Alarms::none().with(Alarm::Stale, true).with(Alarm::Degraded, true).with(Alarm::Silent, false);
        let came = board.set(5, two);
        assert_eq!(
            came.iter().map(|change| (change.alarm, change.raised)).collect::<Vec<_>>(),
            [(Alarm::Stale, true), (Alarm::Degraded, true)]
        );
        assert_eq!(board.set(7, two.with(Alarm::Stale, true)), [], "once is enough");
        let one = Alarms::none().with(Alarm::Degraded, true);
        assert_eq!(board.set(9, one), [Change { alarm: Alarm::Stale, raised: false, at_us: 9 }]);
        assert_eq!(board.raised().collect::<Vec<_>>(), [Raised { alarm: Alarm::Degraded, since_us: 5 }]);
        board.set(11, two);
        assert_eq!(board.raised().map(|raised| raised.since_us).collect::<Vec<_>>(), [11, 5]);
    }

    #[test]
    fn each_alarm_has_its_own_code_and_its_own_words() {
        let codes: std::collections::BTreeSet<_> = Alarm::ALL.iter().map(|alarm| alarm.code()).collect();
        let words: std::collections::BTreeSet<_> = Alarm::ALL.iter().map(|alarm| alarm.words()).collect();
        assert_eq!((codes.len(), words.len()), (Alarm::ALL.len(), Alarm::ALL.len()));
        assert!(Alarm::ALL.is_sorted_by_key(|alarm| std::cmp::Reverse(alarm.severity())));
        assert!(codes.iter().all(|code| code.bytes().all(|byte| byte.is_ascii_lowercase() || byte == b'-')));
    }
}
