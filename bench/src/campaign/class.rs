//! What became of a fault.

use bench_judge::{Event, Violation, What};
use emulator_node::Digest;
use serde::{Deserialize, Serialize};

use crate::danger::is_dangerous;

/// The result of a transaction of the flight controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// The instant at which the transaction ended, virtual ns.
    pub at: u64,
    /// The instant at which it began, virtual ns. The client's verdict, also on the age, is of this instant.
    pub began: u64,
    /// A digest of the bytes that were read and of the instant at which the transaction began.
    pub bytes: u64,
    /// The timestamp, ms, of the position by which the flight controller flies; `None` without a position.
    pub position: Option<u32>,
}

impl Reading {
    /// The readings in a part of an event log.
    pub fn of(events: &[Event]) -> impl Iterator<Item = Self> + '_ {
        let (mut bytes, mut began) = (0, 0);
        events.iter().filter_map(move |event| match &event.what {
            What::Transaction { selected, miso, .. } => {
                let mut digest = Digest::new();
                digest.word(*selected);
                digest.bytes(miso);
                (bytes, began) = (digest.finish(), *selected);
                None
            }
            What::Decided { position, .. } => Some(Self { at: event.at, began, bytes, position: *position }),
            _ => None,
        })
    }
}

/// The longest time, ns, for which a flight controller may fly by one position: the client's age limit of 100 ms
/// ([`profile::ssi::client::Config`]) and two control cycles.
pub(super) const LONGEST_POSITION: u64 = 100_000_000 + 2 * 4_100_000;

/// The length, ns, of the last part of a run. A link that has recovered brings a new position in this time.
pub(super) const LATELY: u64 = 50_000_000;

/// The class of a fault's effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// The fault had no effect: the flight controller read the same bytes at the same instants as without the fault.
    Masked,
    /// The flight controller read other bytes than without the fault, but no invalid data as valid. At the end it
    /// receives new positions.
    Recovered,
    /// The flight controller read no invalid data as valid, but has no position at the end, and its client reports
    /// that.
    Stopped,
    /// The flight controller read invalid data as valid, or kept flying by one position for longer than allowed.
    Dangerous,
}

impl Class {
    /// All classes, from harmless to dangerous.
    pub const ALL: [Self; 4] = [Self::Masked, Self::Recovered, Self::Stopped, Self::Dangerous];

    /// The class's name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Masked => "masked",
            Self::Recovered => "recovered",
            Self::Stopped => "stopped",
            Self::Dangerous => "dangerous",
        }
    }

    /// Returns the class of a fault, from the readings and violations with the fault and the readings without it
    /// (`reference`).
    #[must_use]
    pub fn of(reference: &[Reading], readings: &[Reading], violations: &[Violation]) -> Self {
        if violations.iter().any(|violation| is_dangerous(*violation)) || stands_still(readings) {
            Self::Dangerous
        } else if readings == reference {
            Self::Masked
        } else if flies(readings) {
            Self::Recovered
        } else {
            Self::Stopped
        }
    }

    /// Returns the class of a flipped bit, as [`Class::of`] does, with one exception. A flipped bit changes nothing
    /// outside the boards, so the bytes that were right without it are right with it, if the flight controller reads
    /// them at the same instants. The judge may think otherwise: it measures ages from the pin on which HORUS shows its
    /// ticks, and nothing but a logic analyser is connected to that pin.
    #[must_use]
    pub fn of_upset(reference: &[Reading], readings: &[Reading], violations: &[Violation]) -> Self {
        if !readings.is_empty() && readings == reference {
            Self::Masked
        } else {
            Self::of(reference, readings, violations)
        }
    }
}

fn stands_still(readings: &[Reading]) -> bool {
    readings.chunk_by(|one, other| one.position == other.position).any(|same| {
        let (Some(first), Some(last)) = (same.first(), same.last()) else { return false };
        first.position.is_some() && last.began - first.began > LONGEST_POSITION
    })
}

/// Whether the flight controller had a new position shortly before the last reading.
pub(super) fn flies(readings: &[Reading]) -> bool {
    let Some(last) = readings.last() else { return false };
    let lately = readings.iter().rev().take_while(|reading| reading.at + LATELY > last.at);
    last.position.is_some() && lately.into_iter().any(|reading| reading.position != last.position)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    impl Reading {
        fn at(at: u64, bytes: u64, position: Option<u32>) -> Self {
            Self { at, began: at - MS / 10, bytes, position }
        }
    }

    fn readings(position: impl Fn(u64) -> Option<u32>) -> Vec<Reading> {
        (1..=100).map(|nth| Reading::at(nth * 4 * MS, nth, position(nth * 4))).collect()
    }

    fn sound() -> Vec<Reading> {
        readings(|ms| Some((ms / 10) as u32))
    }

    #[test]
    fn the_same_bytes_at_the_same_instants_are_masked() {
        assert_eq!(Class::of(&sound(), &sound(), &[]), Class::Masked);
        assert_eq!(Class::of(&sound(), &sound(), &[Violation::HorusComplains]), Class::Masked);
    }

    #[test]
    fn a_flipped_bit_that_changes_no_reading_is_masked() {
        let violations = [Violation::NoTick, Violation::StationAge];
        assert_eq!(Class::of_upset(&sound(), &sound(), &violations), Class::Masked);
        assert_eq!(Class::of(&sound(), &sound(), &violations), Class::Dangerous);
        let mut other = sound();
        other[40].bytes ^= 1;
        assert_eq!(Class::of_upset(&sound(), &other, &violations), Class::Dangerous);
        assert_eq!(Class::of_upset(&sound(), &other, &[]), Class::Recovered);
        assert_eq!(Class::of_upset(&[], &[], &violations), Class::Dangerous, "nothing was read");
    }

    #[test]
    fn one_other_byte_is_not_masked() {
        let mut other = sound();
        other[40].bytes ^= 1;
        assert_eq!(Class::of(&sound(), &other, &[]), Class::Recovered);
        let mut later = sound();
        later[40].at += 1;
        assert_eq!(Class::of(&sound(), &later, &[]), Class::Recovered);
        assert_eq!(Class::of(&sound(), &sound()[..99], &[]), Class::Recovered);
    }

    #[test]
    fn a_gap_with_new_positions_at_the_end_is_recovered() {
        let gap = readings(|ms| (!(100..300).contains(&ms)).then_some((ms / 10) as u32));
        assert_eq!(Class::of(&sound(), &gap, &[Violation::NoFrame]), Class::Recovered);
    }

    #[test]
    fn no_position_at_the_end_is_stopped() {
        let ends = readings(|ms| (ms < 100).then_some((ms / 10) as u32));
        assert_eq!(Class::of(&sound(), &ends, &[]), Class::Stopped);
        assert_eq!(Class::of(&sound(), &[], &[]), Class::Stopped);
    }

    #[test]
    fn an_old_position_at_the_end_is_stopped_while_it_may_last() {
        let stands = |from: u64| readings(move |ms| Some((ms.min(from) / 10) as u32));
        assert_eq!(Class::of(&sound(), &stands(360), &[]), Class::Recovered);
        assert_eq!(Class::of(&sound(), &stands(340), &[]), Class::Stopped);
        assert_eq!(Class::of(&sound(), &stands(300), &[]), Class::Stopped);
    }

    #[test]
    fn a_verdict_is_of_the_beginning_of_its_transaction() {
        // The flight controller pauses within the transaction that repeats a position, or before it.
        let pauses = |within: bool| {
            let mut readings = sound();
            readings.drain(31..61);
            readings[30] = Reading { at: readings[31].at - MS, ..readings[29] };
            readings[30].began = if within { readings[29].at + MS } else { readings[30].at - MS / 10 };
            Class::of(&sound(), &readings, &[])
        };
        assert_eq!((pauses(true), pauses(false)), (Class::Recovered, Class::Dangerous));
    }

    #[test]
    fn a_position_that_lasts_beyond_its_age_limit_is_dangerous() {
        let longest = LONGEST_POSITION / MS / 4 * 4;
        let stands =
            |ms: u64| readings(move |at| Some(if at < 40 { at as u32 } else { (at - 40).saturating_sub(ms) as u32 }));
        assert_eq!(Class::of(&sound(), &stands(longest + 4), &[]), Class::Dangerous);
        assert_eq!(Class::of(&sound(), &stands(longest), &[]), Class::Recovered);
        let none = readings(|ms| (ms < 40).then_some(ms as u32));
        assert_eq!(Class::of(&sound(), &none, &[]), Class::Stopped);
    }

    fn class(readings: &[(u64, u32)]) -> Class {
        let of = |&(us, position): &(u64, u32)| Reading::at(us * 1_000, 0, Some(position));
        Class::of(&sound(), &readings.iter().map(of).collect::<Vec<_>>(), &[])
    }

    #[test]
    fn a_position_may_last_108_200_us() {
        assert_eq!(class(&[(4_000, 1), (112_200, 1), (116_000, 2)]), Class::Recovered);
        assert_eq!(class(&[(4_000, 1), (112_201, 1), (116_000, 2)]), Class::Dangerous);
    }

    #[test]
    fn a_position_50_ms_old_at_the_end_is_not_new() {
        assert_eq!(class(&[(4_000, 1), (4_001, 2), (54_000, 2)]), Class::Stopped);
        assert_eq!(class(&[(4_001, 1), (4_002, 2), (54_000, 2)]), Class::Recovered);
    }

    #[test]
    fn exactly_the_violations_that_mislead_a_reader_are_dangerous() {
        use Violation::*;
        let mislead = [
            // What HORUS states of the position, of its receivers and of itself.
            [
                ContentWrong,
                StatusWrong,
                ReportedWrong,
                VoteWrong,
                ExclusionWrong,
                NotAirborne,
                StateWrong,
                CrystalWrong,
                TimestampWrong,
                PositionOff,
            ]
            .as_slice(),
            // What the DPR shows.
            &[ShownNeverSent, ShownOutOfSequence, ShownStale, ShownExpired, Regression, Torn],
            &[LinkAge, LinkFlags, UplinkWrong],
            // What the flight controller and the base station make of it.
            &[ClientWrong, ClientAge, StationAge, BaseInvalid, BaseMixed],
        ]
        .concat();
        for violation in Violation::ALL {
            let class = if mislead.contains(violation) { Class::Dangerous } else { Class::Masked };
            assert_eq!(Class::of(&sound(), &sound(), &[NoFrame, *violation]), class, "{violation}");
        }
    }

    #[test]
    fn a_reading_has_the_bytes_and_the_verdict_of_its_transaction() {
        let transaction = |at, selected, byte: u8| Event {
            at,
            what: What::Transaction { selected, mosi: vec![].into(), miso: vec![byte].into() },
        };
        let decided = |at, position| Event { at, what: What::Decided { position, age_us: None } };
        let events = [
            transaction(5, 3, 7),
            decided(5, Some(9)),
            transaction(9, 8, 7),
            decided(9, None),
            transaction(15, 3, 8),
            decided(15, Some(9)),
        ];
        let readings: Vec<Reading> = Reading::of(&events).collect();
        let seen: Vec<_> = readings.iter().map(|reading| (reading.at, reading.began, reading.position)).collect();
        assert_eq!(seen, [(5, 3, Some(9)), (9, 8, None), (15, 3, Some(9))]);
        assert!(readings[0].bytes != readings[1].bytes && readings[0].bytes != readings[2].bytes);
    }
}
