//! Frames for the suite of the DPR: good ones, damaged ones, and ones that were made to look like good ones.

use dpr_fw::RECEIVERS;
use on_target_tests::profile_suite as suite;
use profile::{crc, Profile};

pub(crate) const SIZE: usize = Profile::<RECEIVERS>::SIZE;
pub(crate) const OBJECTS: usize = RECEIVERS + 1;
const CRC: usize = 4;
/// The offset of the first byte of the latitude in every object.
const LATITUDE: usize = 8;

#[derive(Clone, Copy, Debug, defmt::Format)]
pub(crate) enum Case {
    Good,
    /// A bit in the first byte of this object is wrong.
    FirstByte(usize),
    /// A bit in the last byte of this object is wrong.
    LastByte(usize),
    /// A bit in each object is wrong.
    EveryObject,
    /// GPS1 and GPS2 are exchanged, with valid CRCs.
    Swapped,
    /// This object is that of the previous cycle, with valid CRCs.
    OfTheCycleBefore(usize),
    /// The latitude of Reported-Position and its frame CRC were changed, so its position CRC is wrong.
    Position,
    Zeros,
    Ones,
    /// The frame is good, but it repeats the timestamp of the cycle before.
    Repeated,
    /// The frame is good, but its timestamp is 500 ms ahead.
    Ahead,
    /// The frame is good, but its timestamp is 0.
    Restarted,
}

pub(crate) const CASES: [Case; 20] = [
    Case::Good,
    Case::FirstByte(0),
    Case::FirstByte(1),
    Case::FirstByte(2),
    Case::FirstByte(3),
    Case::LastByte(0),
    Case::LastByte(1),
    Case::LastByte(2),
    Case::LastByte(3),
    Case::EveryObject,
    Case::Swapped,
    Case::OfTheCycleBefore(1),
    Case::OfTheCycleBefore(2),
    Case::OfTheCycleBefore(3),
    Case::Position,
    Case::Zeros,
    Case::Ones,
    Case::Repeated,
    Case::Ahead,
    Case::Restarted,
];

/// The classes of frames by the sequence's judgement.
pub(crate) const CLASSES: [&str; 3] = ["in sequence", "out of sequence", "no object intact"];

impl Case {
    /// Returns how many objects of the frame are accepted. The cycle before is assumed to be in sequence.
    pub(crate) const fn accepted(self) -> u32 {
        let all = OBJECTS as u32;
        match self {
            Self::Good => all,
            Self::FirstByte(_) | Self::LastByte(_) | Self::OfTheCycleBefore(_) | Self::Position => all - 1,
            Self::Swapped => all - 2,
            Self::EveryObject | Self::Zeros | Self::Ones | Self::Repeated | Self::Ahead | Self::Restarted => 0,
        }
    }

    /// Returns the index of the frame's class in [`CLASSES`]. The DPR's work depends on nothing else in the frame: only
    /// on whether it has a timestamp, and on what the sequence says of this timestamp.
    pub(crate) const fn class(self) -> usize {
        match self {
            Self::Repeated | Self::Ahead | Self::Restarted => 1,
            Self::EveryObject | Self::Zeros | Self::Ones => 2,
            _ => 0,
        }
    }

    pub(crate) fn payload(self, timestamp: u32) -> [u8; SIZE] {
        let good = |timestamp| {
            let (reported, gps) = suite::inputs(timestamp);
            let mut bytes = [0; SIZE];
            bytes.copy_from_slice(Profile::<RECEIVERS>::seal(&reported, &gps).as_bytes());
            bytes
        };
        let place = |index| defmt::unwrap!(Profile::<RECEIVERS>::place(index));
        let mut bytes = good(match self {
            Self::Repeated => timestamp - profile::CYCLE_MS,
            Self::Ahead => timestamp + 500,
            Self::Restarted => 0,
            _ => timestamp,
        });
        match self {
            Self::FirstByte(index) => bytes[place(index).start] ^= 0x80,
            Self::LastByte(index) => bytes[place(index).end - 1] ^= 1,
            Self::EveryObject => (0..OBJECTS).for_each(|index| bytes[place(index).start + LATITUDE] ^= 1),
            Self::Swapped => {
                let (one, other) = (place(1), place(2));
                let (front, back) = bytes.split_at_mut(other.start);
                front[one.clone()].swap_with_slice(&mut back[..one.len()]);
            }
            Self::OfTheCycleBefore(index) => {
                bytes[place(index)].copy_from_slice(&good(timestamp - profile::CYCLE_MS)[place(index)]);
            }
            Self::Position => {
                let object = &mut bytes[place(0)];
                object[LATITUDE] ^= 1;
                let (covered, crc) = object.split_at_mut(object.len() - CRC);
                crc.copy_from_slice(&crc::frame(covered).to_be_bytes());
            }
            Self::Zeros => bytes.fill(0x00),
            Self::Ones => bytes.fill(0xFF),
            Self::Good | Self::Repeated | Self::Ahead | Self::Restarted => {}
        }
        bytes
    }
}
