//! Faults of HORUS's front end, the poller, or of the wires to it.
//!
//! [`Emission`] takes the events that the chip emits and returns those that leave the antenna. Neither chip nor
//! firmware can observe the difference. [`FrontEndFault::SelectLate`] delays chip select instead.

use std::collections::VecDeque;

use st25r3916_model::{AirEvent, FrameStart, nfc_f};

use super::Rng;

/// A fault of HORUS's front end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrontEndFault {
    /// The antenna is disconnected: neither carrier nor frame leaves it.
    NoCarrier,
    /// The chip's modulator is dead: the antenna emits a carrier, but no frame.
    Mute,
    /// The second half of each frame is missing.
    BreaksOff,
    /// The last byte of each payload is missing, but the frame's length and CRC fit the shorter payload.
    Shortened,
    /// Each frame is sent a second time without a command, this many ns after its end.
    FrameAgain(u64),
    /// The chip receives each transmit command again, this many ns after the frame's end.
    CommandAgain(u64),
    /// Each frame begins late, by a uniformly drawn delay of at most this many ns.
    Scatters(u64),
    /// Each rise of chip select reaches the chip late, by a uniformly drawn delay of at most this many ns.
    SelectLate(u64),
}

/// The time from a repeated transmit command to its frame, ns: the mean of recordings of the chip.
pub const COMMAND_TO_FRAME_NS: u64 = 4_000;

impl FrontEndFault {
    /// Returns the fault's name in the event log.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoCarrier => "without a carrier",
            Self::Mute => "mute",
            Self::BreaksOff => "breaks off",
            Self::Shortened => "sends a byte too few",
            Self::FrameAgain(_) => "sends frames again",
            Self::CommandAgain(_) => "is commanded again",
            Self::Scatters(_) => "scatters",
            Self::SelectLate(_) => "is deselected late",
        }
    }
}

/// Removes the last byte of the payload of a frame of `whole` bytes, and corrects the frame's CRC. LEN was already
/// reduced.
fn shorten(data: &mut Vec<u8>, whole: usize) {
    data.truncate(whole - 3);
    let crc = nfc_f(data);
    data.extend(crc);
}

#[derive(Clone, Debug)]
struct Sending {
    start: FrameStart,
    late: u64,
    /// Whether the frame's end has left the antenna while the chip was still sending the frame.
    ended: bool,
    lost: bool,
    /// The original length, bytes, of a frame whose last byte of payload is to be removed.
    shortened: Option<usize>,
}

/// Turns the events of a chip into those that leave the antenna. The [module](self) describes it.
#[derive(Clone, Debug)]
pub struct Emission {
    noise: Rng,
    faults: Vec<FrontEndFault>,
    sending: Option<Sending>,
    leaving: VecDeque<(u64, AirEvent)>,
    /// The instants, ns, at which the chip received transmit commands that the firmware did not give.
    commands: Vec<u64>,
}

impl Emission {
    /// Returns the emission of a front end without faults. `seed` determines all random values.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self { noise: Rng::new(seed), faults: vec![], sending: None, leaving: VecDeque::new(), commands: vec![] }
    }

    /// Begins `fault` at `now` (ns), beside any present faults. `carrier` is true if the chip's carrier is on.
    pub fn begin(&mut self, now: u64, fault: FrontEndFault, carrier: bool) {
        if fault == FrontEndFault::NoCarrier {
            if carrier && !self.has(fault) {
                self.leaving.clear();
                self.leave(now, AirEvent::FieldOff);
            }
            if let Some(sending) = &mut self.sending {
                sending.lost = true;
            }
        }
        self.faults.push(fault);
    }

    /// Ends `fault` at `now` (ns), if it is present. `carrier` is true if the chip's carrier is on.
    pub fn end(&mut self, now: u64, fault: FrontEndFault, carrier: bool) {
        let Some(place) = self.faults.iter().position(|other| *other == fault) else { return };
        self.faults.remove(place);
        if fault == FrontEndFault::NoCarrier && carrier && !self.has(fault) {
            self.leave(now, AirEvent::FieldOn);
        }
    }

    fn has(&self, fault: FrontEndFault) -> bool {
        self.faults.contains(&fault)
    }

    fn leave(&mut self, at: u64, event: AirEvent) {
        let place = self.leaving.partition_point(|(before, _)| *before <= at);
        self.leaving.insert(place, (at, event));
    }

    /// Draws the delay of a rise of chip select, ns.
    pub fn select_late(&mut self) -> u64 {
        let Self { faults, noise, .. } = self;
        let late = |fault: &FrontEndFault| if let FrontEndFault::SelectLate(ns) = fault { noise.below(*ns) } else { 0 };
        faults.iter().map(late).sum()
    }

    /// Takes an event that the chip emitted at `at` (ns).
    pub fn emitted(&mut self, at: u64, event: AirEvent) {
        match event {
            AirEvent::FieldOn | AirEvent::FieldOff => {
                if !self.has(FrontEndFault::NoCarrier) {
                    self.leave(at, event);
                }
            }
            AirEvent::FrameStart(start) => self.frame_started(at, start),
            AirEvent::Bytes(chunk) => {
                let Some(sending) = &mut self.sending else { return };
                let mut chunk = chunk;
                let data = &mut sending.start.chunk.data;
                let before = data.len();
                data.extend_from_slice(&chunk.data);
                if let Some(whole) = sending.shortened.filter(|whole| data.len() >= *whole) {
                    shorten(data, whole);
                    chunk.data = data.get(before..).unwrap_or(&[]).to_vec();
                }
                let Sending { late, ended, lost, shortened, .. } = *sending;
                if !lost && (!ended || shortened.is_some()) {
                    self.leave(at + late, AirEvent::Bytes(chunk));
                }
            }
            AirEvent::FrameEnd { bits } => {
                let Some(Sending { start, late, ended, lost, .. }) = self.sending.take() else { return };
                if lost {
                    return;
                }
                if !ended {
                    self.leave(at + late, AirEvent::FrameEnd { bits });
                }
                self.send_again(at + late, &start, bits);
            }
        }
    }

    fn frame_started(&mut self, at: u64, mut start: FrameStart) {
        let lost = self.has(FrontEndFault::NoCarrier) || self.has(FrontEndFault::Mute);
        let late = self
            .faults
            .iter()
            .map(|fault| if let FrontEndFault::Scatters(ns) = fault { self.noise.below(*ns) } else { 0 })
            .sum();
        let data = &mut start.chunk.data;
        let mut bits = None;
        let whole = data.first().map_or(0, |len| usize::from(*len) + 2);
        let mut shortened = None;
        if self.faults.contains(&FrontEndFault::Shortened) && whole > 4 {
            data[0] -= 1;
            bits = Some(8 * (whole as u64 - 1));
            // The chip may load the frame's last bytes while it already sends, so these bytes may be missing now.
            if data.len() >= whole {
                shorten(data, whole);
            } else {
                shortened = Some(whole);
            }
        }
        if self.faults.contains(&FrontEndFault::BreaksOff) {
            bits = Some(4 * data.len() as u64);
        }
        if let (Some(bits), false) = (bits, lost) {
            let air = u64::from(start.header_bits) + bits / 8 * u64::from(start.byte_bits) + bits % 8;
            // The first division prevents an overflow; a bit takes about 2.4 µs.
            let ends = at + late + air * (start.bit_as / 1_000_000) / 1_000;
            self.leave(ends, AirEvent::FrameEnd { bits: u32::try_from(bits).unwrap_or(u32::MAX) });
        }
        if !lost {
            self.leave(at + late, AirEvent::FrameStart(start.clone()));
        }
        self.sending = Some(Sending { start, late, ended: bits.is_some(), lost, shortened });
    }

    fn send_again(&mut self, at: u64, start: &FrameStart, bits: u32) {
        for fault in self.faults.clone() {
            let begins = match fault {
                FrontEndFault::FrameAgain(after) => at + after,
                FrontEndFault::CommandAgain(after) => {
                    self.commands.push(at + after);
                    at + after + COMMAND_TO_FRAME_NS
                }
                _ => continue,
            };
            let air = u64::from(start.header_bits) + start.chunk.data.len() as u64 * u64::from(start.byte_bits);
            self.leave(begins, AirEvent::FrameStart(start.clone()));
            self.leave(begins + air * (start.bit_as / 1_000_000) / 1_000, AirEvent::FrameEnd { bits });
        }
    }

    /// The instant at which the next event leaves the antenna, ns; `u64::MAX` if there is none.
    #[must_use]
    pub fn next_at(&self) -> u64 {
        self.leaving.front().map_or(u64::MAX, |(at, _)| *at)
    }

    /// Takes an event that leaves the antenna at `now` (ns) or earlier.
    pub fn take(&mut self, now: u64) -> Option<(u64, AirEvent)> {
        self.leaving.pop_front_if(|(at, _)| *at <= now)
    }

    /// Takes the instants (ns) of transmit commands that the firmware did not give. An instant may be in the future.
    pub fn take_commands(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.commands)
    }
}

#[cfg(test)]
mod tests {
    use st25r3916_model::{Chunk, Technology};

    use super::*;

    const MS: u64 = 1_000_000;
    /// The duration of a bit, ns, rounded from the 2.36 µs of 424 kbit/s.
    const BIT_NS: u64 = 2_000;

    fn frame() -> FrameStart {
        let mut data = vec![11];
        data.extend(1..=10);
        data.extend(nfc_f(&data));
        FrameStart {
            technology: Technology::NfcF,
            bits_per_second: 424_000,
            bit_as: BIT_NS * 1_000_000_000,
            header_bits: 64,
            byte_bits: 8,
            load_modulation: false,
            chunk: Chunk { data, parity_error: false },
        }
    }

    const BITS: u32 = 8 * 13;
    const AIR_NS: u64 = (64 + BITS as u64) * BIT_NS;

    fn leaves(faults: &[FrontEndFault], until: u64) -> (Vec<(u64, AirEvent)>, Vec<u64>) {
        let mut emission = Emission::new(1);
        faults.iter().for_each(|fault| emission.begin(0, *fault, false));
        emission.emitted(0, AirEvent::FieldOn);
        emission.emitted(MS, AirEvent::FrameStart(frame()));
        emission.emitted(MS + AIR_NS, AirEvent::FrameEnd { bits: BITS });
        (std::iter::from_fn(|| emission.take(until)).collect(), emission.take_commands())
    }

    fn sound() -> Vec<(u64, AirEvent)> {
        let end = AirEvent::FrameEnd { bits: BITS };
        vec![(0, AirEvent::FieldOn), (MS, AirEvent::FrameStart(frame())), (MS + AIR_NS, end)]
    }

    #[test]
    fn a_sound_front_end_emits_what_its_chip_emits() {
        assert_eq!(leaves(&[], u64::MAX), (sound(), vec![]));
        assert_eq!(leaves(&[], MS).0, sound()[..2]);
    }

    #[test]
    fn a_mute_front_end_still_emits_its_carrier() {
        assert_eq!(leaves(&[FrontEndFault::Mute], u64::MAX).0, [(0, AirEvent::FieldOn)]);
        assert_eq!(leaves(&[FrontEndFault::NoCarrier], u64::MAX).0, []);
    }

    #[test]
    fn a_carrier_that_fails_within_a_frame_loses_that_frame() {
        let mut emission = Emission::new(1);
        emission.emitted(MS, AirEvent::FrameStart(frame()));
        assert_eq!(emission.take(MS).map(|(at, _)| at), Some(MS));
        emission.begin(MS + 100, FrontEndFault::NoCarrier, true);
        emission.end(MS + 200, FrontEndFault::NoCarrier, true);
        emission.emitted(MS + AIR_NS, AirEvent::FrameEnd { bits: BITS });
        let left: Vec<_> = std::iter::from_fn(|| emission.take(u64::MAX)).collect();
        assert_eq!(left, [(MS + 100, AirEvent::FieldOff), (MS + 200, AirEvent::FieldOn)]);
    }

    #[test]
    fn a_frame_that_breaks_off_ends_in_its_middle() {
        let half = (MS + (64 + u64::from(BITS) / 2) * BIT_NS, AirEvent::FrameEnd { bits: BITS / 2 });
        let expected = [&sound()[..2], &[half]].concat();
        assert_eq!(leaves(&[FrontEndFault::BreaksOff], u64::MAX).0, expected);
    }

    #[test]
    fn a_shortened_frame_has_a_length_and_a_crc_that_fit() {
        let (left, _) = leaves(&[FrontEndFault::Shortened], u64::MAX);
        let AirEvent::FrameStart(start) = &left[1].1 else { panic!("{left:?}") };
        let mut data = vec![10];
        data.extend(1..=9);
        data.extend(nfc_f(&data));
        assert_eq!(start.chunk.data, data);
        assert_eq!(left[2], (MS + AIR_NS - 8 * BIT_NS, AirEvent::FrameEnd { bits: BITS - 8 }));
        assert_eq!(left.len(), 3);
    }

    #[test]
    fn a_frame_comes_once_more_with_or_without_a_command() {
        let again = |begins| {
            let end = AirEvent::FrameEnd { bits: BITS };
            vec![(begins, AirEvent::FrameStart(frame())), (begins + AIR_NS, end)]
        };
        let ended = MS + AIR_NS;
        let expected = [sound(), again(ended + 500)].concat();
        assert_eq!(leaves(&[FrontEndFault::FrameAgain(500)], u64::MAX), (expected, vec![]));
        let expected = [sound(), again(ended + 500 + COMMAND_TO_FRAME_NS)].concat();
        assert_eq!(leaves(&[FrontEndFault::CommandAgain(500)], u64::MAX), (expected, vec![ended + 500]));
    }

    #[test]
    fn frames_and_chip_select_are_delayed_at_random_below_the_given_bound() {
        let mut emission = Emission::new(1);
        emission.begin(0, FrontEndFault::Scatters(1_000), true);
        let mut lates = std::collections::BTreeSet::new();
        for number in 1..50 {
            emission.emitted(number * MS, AirEvent::FrameStart(frame()));
            emission.emitted(number * MS + AIR_NS, AirEvent::FrameEnd { bits: BITS });
            let begins = emission.take(u64::MAX).unwrap().0;
            assert_eq!(emission.take(u64::MAX).unwrap().0, begins + AIR_NS);
            lates.insert(begins - number * MS);
        }
        assert!(lates.len() > 20 && *lates.last().unwrap() < 1_000, "{lates:?}");
        assert_eq!(emission.select_late(), 0);
        emission.begin(0, FrontEndFault::SelectLate(100), true);
        let lates: std::collections::BTreeSet<_> = (0..50).map(|_| emission.select_late()).collect();
        assert!(lates.len() > 20 && *lates.last().unwrap() < 100, "{lates:?}");
    }
}
