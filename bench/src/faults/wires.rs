//! Faults of the wires between the boards and the world.
//!
//! [`Wires`] takes the signal at one end of a wire and returns that at the other end. For the listener's antenna it
//! only states whether the antenna answers.

use std::collections::VecDeque;
use std::ops::Range;

use bench_judge::disturbance::Wire;
use profile::ssi::client::Report;
use profile::{Layout, LinkStatus, ReportedValues, Uplink, crc};

use super::{ReceiverFault, Rng};

/// A fault of a wire between the boards and the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireFault {
    /// FRESH stays low, whatever the DPR drives.
    FreshStuck,
    /// FRESH has an additional pulse of [`GLITCH_NS`]. It comes [`GLITCH_AFTER_NS`] after each pulse that the DPR
    /// drives.
    FreshGlitch,
    /// Every edge of FRESH arrives late by this many ns.
    FreshLate(u64),
    /// TICK stays low, whatever HORUS drives.
    TickStuck,
    /// TICK has an additional tick, [`GLITCH_AFTER_NS`] after each tick that HORUS drives.
    TickGlitch,
    /// The log does not contain the changes of HORUS's state inputs.
    InputsUnseen,
    /// One bit of each transaction's MISO is inverted.
    MisoBit {
        /// The byte's index in the transaction, from 0. No bit is inverted in a shorter transaction.
        byte: usize,
        /// The bit's number, 0 (the least significant) to 7.
        bit: u8,
    },
    /// MISO repeats the bytes of an earlier transaction: the latest one that ended at least this long before. Bytes
    /// beyond the end of that transaction stay as they are.
    MisoReplay {
        /// The least age of the repeated transaction, ns; at most [`HISTORY_NS`].
        age_ns: u64,
    },
    /// From a certain byte on, MISO repeats the bytes of the preceding transaction. Bytes beyond the end of that
    /// transaction stay as they are.
    MisoSplice {
        /// The index of the first byte that is repeated, from 0.
        at_byte: usize,
    },
    /// GPS1 and GPS2 are exchanged in the bytes that the flight controller reads, if the transaction contains both.
    MisoSwap,
    /// All bytes of one object read 0x00, as if the object had not been received.
    MisoVacant {
        /// The object whose bytes read 0x00: 0 for Reported-Position, n for GPSn.
        object: usize,
    },
    /// A bridge in the SSI hangs: every transaction repeats the last one before the fault.
    MisoFrozen,
    /// Bits of an object or of Link-Status are inverted and its CRC is corrected, as a bridge in the line could do.
    MisoForged {
        /// The changed object: 0 for Reported-Position, n for GPSn, `None` for Link-Status.
        object: Option<usize>,
        /// The index of the changed byte in the object, from 0, before the CRC.
        byte: usize,
        /// The inverted bits.
        bits: u8,
    },
    /// Bits of an object behind the image in the map are inverted, and the object's CRC is corrected.
    MisoForgedPort {
        /// The changed object: 0 for Port-Status, 1 for the uplink of the base station, 2 for that of the flight
        /// controller, 3 for that of the hold.
        object: usize,
        /// The index of the changed byte in the object, from 0, before the CRC.
        byte: usize,
        /// The inverted bits.
        bits: u8,
    },
    /// Every byte reads 0xFF.
    MisoOnes,
    /// The listener's antenna answers each received frame, because its load modulator works without a command.
    AntennaAnswers,
    /// The radio to the base station transmits nothing.
    RadioDrop,
    /// One bit of each profile on the radio is inverted. It is another bit in each profile.
    RadioBit,
    /// The second half of each profile on the radio is the second half of the profile before.
    RadioMix,
    /// Every receiver has this fault, and the event log does not mention it.
    Sky(ReceiverFault),
    /// The flight controller keeps flying by the last position and ignores the client's report.
    ClientKeeps,
    /// The flight controller takes the age of every sample to be zero.
    ClientYoung,
    /// The flight controller ignores the position that the client reports.
    ClientBlind,
    /// The flight controller forwards nothing.
    ClientMute,
}

/// The time from a pulse of FRESH or a tick to an additional one, ns, so that it falls between two publications.
pub const GLITCH_AFTER_NS: u64 = 3_000_000;

/// The length of an additional pulse of FRESH, ns.
pub const GLITCH_NS: u64 = 2_000;

/// The greatest age of a transaction that MISO can repeat, ns.
pub const HISTORY_NS: u64 = 1_000_000_000;

/// The greatest number of transactions that are kept for repetition. A misused SSI has up to 200 000 transactions a
/// second.
const REMEMBERED: usize = 4_096;

impl WireFault {
    /// Returns the fault's name in the event log.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::FreshStuck => "FRESH stuck",
            Self::FreshGlitch => "FRESH glitch",
            Self::FreshLate(_) => "FRESH late",
            Self::TickStuck => "TICK stuck",
            Self::TickGlitch => "TICK glitch",
            Self::InputsUnseen => "inputs unseen",
            Self::MisoBit { .. } => "MISO bit",
            Self::MisoReplay { .. } => "MISO replay",
            Self::MisoSplice { .. } => "MISO splice",
            Self::MisoSwap => "MISO swap",
            Self::MisoVacant { .. } => "MISO vacant",
            Self::MisoFrozen => "MISO frozen",
            Self::MisoForged { .. } => "MISO forged",
            Self::MisoForgedPort { .. } => "MISO forged port",
            Self::MisoOnes => "MISO ones",
            Self::AntennaAnswers => "antenna answers",
            Self::RadioDrop => "radio drop",
            Self::RadioBit => "radio bit",
            Self::RadioMix => "radio mix",
            Self::Sky(_) => "sky",
            Self::ClientKeeps => "client keeps",
            Self::ClientYoung => "client young",
            Self::ClientBlind => "client blind",
            Self::ClientMute => "client mute",
        }
    }

    /// The wire that has the fault.
    #[must_use]
    pub const fn wire(self) -> Wire {
        match self {
            Self::FreshStuck | Self::FreshGlitch | Self::FreshLate(_) => Wire::Fresh,
            Self::TickStuck | Self::TickGlitch => Wire::Tick,
            Self::InputsUnseen => Wire::Inputs,
            Self::MisoBit { .. }
            | Self::MisoReplay { .. }
            | Self::MisoSplice { .. }
            | Self::MisoSwap
            | Self::MisoVacant { .. }
            | Self::MisoFrozen
            | Self::MisoForged { .. }
            | Self::MisoForgedPort { .. }
            | Self::MisoOnes => Wire::Miso,
            Self::AntennaAnswers => Wire::Antenna,
            Self::RadioDrop | Self::RadioBit | Self::RadioMix => Wire::Radio,
            Self::Sky(_) => Wire::Sky,
            Self::ClientKeeps | Self::ClientYoung | Self::ClientBlind | Self::ClientMute => Wire::Client,
        }
    }

    /// Whether the wire is on HORUS's side of the link.
    #[must_use]
    pub const fn is_upstream(self) -> bool {
        matches!(self, Self::TickStuck | Self::TickGlitch | Self::InputsUnseen | Self::Sky(_))
    }
}

#[derive(Clone, Debug)]
struct Sent {
    ended: u64,
    miso: Vec<u8>,
}

/// The wires between the boards and the world with their present faults. The [module](self) describes them.
#[derive(Clone, Debug)]
pub struct Wires {
    layout: Layout,
    noise: Rng,
    faults: Vec<WireFault>,
    flown: Option<ReportedValues>,
    fresh: bool,
    sent: VecDeque<Sent>,
    frozen: Option<Sent>,
    radio: Vec<u8>,
}

impl Wires {
    /// Returns wires without faults for a DPR whose image has this layout. `seed` determines all random values.
    #[must_use]
    pub const fn new(layout: Layout, seed: u64) -> Self {
        Self {
            layout,
            noise: Rng::new(seed),
            faults: vec![],
            fresh: false,
            sent: VecDeque::new(),
            frozen: None,
            radio: vec![],
            flown: None,
        }
    }

    /// Begins `fault`.
    ///
    /// # Panics
    ///
    /// Panics if a fault repeats a transaction older than [`HISTORY_NS`], or if the number of a bit exceeds 7.
    pub fn begin(&mut self, fault: WireFault) {
        match fault {
            WireFault::MisoReplay { age_ns } => assert!(age_ns <= HISTORY_NS, "a replay of {age_ns} ns ago"),
            WireFault::MisoBit { bit, .. } => assert!(bit < 8, "bit {bit} of a byte"),
            WireFault::MisoFrozen => self.frozen = self.sent.back().cloned(),
            _ => {}
        }
        self.faults.push(fault);
    }

    /// Ends `fault`, if it is present.
    pub fn end(&mut self, fault: WireFault) {
        if let Some(place) = self.faults.iter().position(|other| *other == fault) {
            self.faults.remove(place);
        }
    }

    /// Changes the bytes of a transaction that ended at `at` (ns) to those that the flight controller receives. `miso`
    /// has the bytes that the DPR sent. The first of them is the image's byte at `offset`.
    pub fn miso(&mut self, at: u64, offset: usize, miso: &mut [u8]) {
        let sent = miso.to_vec();
        for fault in &self.faults {
            match *fault {
                WireFault::MisoBit { byte, bit } => {
                    if let Some(byte) = miso.get_mut(byte) {
                        *byte ^= 1 << bit;
                    }
                }
                WireFault::MisoReplay { age_ns } => {
                    let old = self.sent.iter().rev().find(|old| old.ended + age_ns <= at);
                    overwrite(miso, 0, old);
                }
                WireFault::MisoSplice { at_byte } => overwrite(miso, at_byte, self.sent.back()),
                WireFault::MisoSwap => self.swap(offset, miso),
                WireFault::MisoVacant { object } => {
                    if let Some(place) = self.layout.in_image(object) {
                        let from = place.start.saturating_sub(offset).min(miso.len());
                        let to = place.end.saturating_sub(offset).min(miso.len());
                        miso[from..to].fill(0);
                    }
                }
                WireFault::MisoFrozen => overwrite(miso, 0, self.frozen.as_ref()),
                WireFault::MisoForged { object, byte, bits } => {
                    let place = object.map_or(Some(0..LinkStatus::SIZE), |object| self.layout.in_image(object));
                    forge(offset, miso, place, (byte, bits));
                }
                WireFault::MisoForgedPort { object, byte, bits } => {
                    let start = self.layout.port_status().start + object * Uplink::SIZE;
                    forge(offset, miso, Some(start..start + Uplink::SIZE), (byte, bits));
                }
                WireFault::MisoOnes => miso.fill(0xFF),
                _ => {}
            }
        }
        self.sent.push_back(Sent { ended: at, miso: sent });
        while self.sent.len() > REMEMBERED || self.sent.front().is_some_and(|old| old.ended + 2 * HISTORY_NS < at) {
            self.sent.pop_front();
        }
    }

    fn swap(&self, offset: usize, miso: &mut [u8]) {
        let (Some(one), Some(two)) = (self.layout.in_image(1), self.layout.in_image(2)) else { return };
        let Some(start) = one.start.checked_sub(offset) else { return };
        if let Some(both) = miso.get_mut(start..start + one.len() + two.len()) {
            both.rotate_left(one.len());
        }
    }

    /// Returns the edges at the far end of FRESH, each with its instant (ns), in order. The DPR drives `level` at `at`
    /// (ns).
    pub fn fresh(&mut self, at: u64, level: bool) -> impl Iterator<Item = (u64, bool)> + use<> {
        let late: u64 =
            self.faults.iter().map(|fault| if let WireFault::FreshLate(ns) = fault { *ns } else { 0 }).sum();
        let mut seen = vec![];
        let stuck = self.faults.contains(&WireFault::FreshStuck);
        // A wire that breaks during a pulse completes the pulse. A wire that is mended during a pulse leaves the pulse
        // out.
        if level != self.fresh && !(level && stuck) {
            self.fresh = level;
            seen.push((at + late, level));
            if !level && self.faults.contains(&WireFault::FreshGlitch) {
                let again = at + late + GLITCH_AFTER_NS;
                seen.extend([(again, true), (again + GLITCH_NS, false)]);
            }
        }
        seen.into_iter()
    }

    /// Returns the instants, ns, in order, of the ticks at the far end of the wire, for a tick of HORUS at `at` (ns).
    pub fn tick(&self, at: u64) -> impl Iterator<Item = u64> + use<> {
        let seen = (!self.faults.contains(&WireFault::TickStuck)).then_some(at);
        let glitch = seen.filter(|_| self.faults.contains(&WireFault::TickGlitch)).map(|at| at + GLITCH_AFTER_NS);
        seen.into_iter().chain(glitch)
    }

    /// Returns the report that the flight controller acts on: `report` of the client, changed by the present faults.
    pub fn report(&mut self, report: Report) -> Report {
        let has = |fault| self.faults.contains(&fault);
        let age_us = if has(WireFault::ClientYoung) { 0 } else { report.age_us };
        let position = match report.position {
            _ if has(WireFault::ClientKeeps) => self.flown,
            _ if has(WireFault::ClientBlind) => None,
            position => position,
        };
        self.flown = position;
        Report { position, age_us, ..report }
    }

    /// Whether the flight controller forwards what it reads.
    #[must_use]
    pub fn forwards(&self) -> bool {
        !self.faults.contains(&WireFault::ClientMute)
    }

    /// Whether the log gets the changes of HORUS's state inputs.
    #[must_use]
    pub fn shows_inputs(&self) -> bool {
        !self.faults.contains(&WireFault::InputsUnseen)
    }

    /// Whether the listener's antenna answers received frames.
    #[must_use]
    pub fn answers(&self) -> bool {
        self.faults.contains(&WireFault::AntennaAnswers)
    }

    /// Changes the bytes that the flight controller sent to those that the base station receives. Returns `false` if
    /// nothing arrives.
    pub fn radio(&mut self, bytes: &mut Vec<u8>) -> bool {
        if bytes.is_empty() {
            return true;
        }
        let before = std::mem::replace(&mut self.radio, bytes.clone());
        for fault in &self.faults {
            match fault {
                WireFault::RadioDrop => return false,
                WireFault::RadioBit => {
                    let bit = usize::try_from(self.noise.below(bytes.len() as u64 * 8)).unwrap_or(0);
                    bytes[bit / 8] ^= 1 << (bit % 8);
                }
                WireFault::RadioMix => {
                    let half = bytes.len() / 2;
                    if let Some(rest) = before.get(half..) {
                        bytes.truncate(half);
                        bytes.extend(rest);
                    }
                }
                _ => {}
            }
        }
        true
    }
}

fn overwrite(miso: &mut [u8], from: usize, old: Option<&Sent>) {
    let old = old.map_or(&[][..], |old| &old.miso);
    miso.iter_mut().zip(old).skip(from).for_each(|(byte, old)| *byte = *old);
}

/// Inverts `bits` of one byte of the object at `place` and corrects the object's CRC, if the object is whole.
fn forge(offset: usize, miso: &mut [u8], place: Option<Range<usize>>, (byte, bits): (usize, u8)) {
    let place = place.and_then(|place| Some(place.start.checked_sub(offset)?..place.end - offset));
    let Some((covered, seal)) = place.and_then(|place| miso.get_mut(place)?.split_last_chunk_mut()) else { return };
    if let Some(byte) = covered.get_mut(byte) {
        *byte ^= bits;
        *seal = crc::frame(covered).to_be_bytes();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn wires() -> Wires {
        Wires::new(Layout::for_receivers(3).unwrap(), 1)
    }

    fn broken(fault: WireFault) -> Wires {
        let mut wires = wires();
        wires.begin(fault);
        wires
    }

    fn image() -> Vec<u8> {
        let layout = Layout::for_receivers(3).unwrap();
        let mut image = vec![0; layout.image_len()];
        for object in 0..4_u8 {
            image[layout.in_image(object.into()).unwrap()].fill(object + 1);
        }
        image
    }

    fn seen(wires: &mut Wires, at: u64, offset: usize, sent: &[u8]) -> Vec<u8> {
        let mut miso = sent.to_vec();
        wires.miso(at, offset, &mut miso);
        miso
    }

    #[test]
    fn sound_wires_carry_everything_as_it_is() {
        let mut wires = wires();
        assert_eq!(seen(&mut wires, MS, 0, &image()), image());
        assert_eq!(wires.fresh(5, true).chain(wires.fresh(9, false)).collect::<Vec<_>>(), [(5, true), (9, false)]);
        assert_eq!(wires.tick(7).collect::<Vec<_>>(), [7]);
        let mut bytes = vec![1, 2, 3];
        assert!(wires.radio(&mut bytes));
        assert_eq!(bytes, [1, 2, 3]);
    }

    #[test]
    fn the_antenna_answers_while_its_load_modulator_works_by_itself() {
        let mut wires = broken(WireFault::AntennaAnswers);
        assert!(wires.answers());
        wires.end(WireFault::AntennaAnswers);
        assert!(!wires.answers());
    }

    #[test]
    fn a_fault_that_ended_does_nothing_any_more_and_others_go_on() {
        let mut wires = broken(WireFault::MisoOnes);
        wires.begin(WireFault::MisoBit { byte: 3, bit: 7 });
        assert_eq!(seen(&mut wires, 0, 0, &[0; 4]), [0xFF, 0xFF, 0xFF, 0x7F]);
        wires.end(WireFault::MisoOnes);
        wires.end(WireFault::MisoOnes);
        assert_eq!(seen(&mut wires, 0, 0, &[0; 4]), [0, 0, 0, 0x80]);
        assert_eq!(seen(&mut wires, 0, 0, &[0; 3]), [0, 0, 0], "a transaction that does not reach the byte");
    }

    #[test]
    fn a_replay_delivers_what_was_sent_the_given_time_ago() {
        let mut wires = wires();
        for read in 0..5_u8 {
            seen(&mut wires, u64::from(read) * 4 * MS, 0, &[read; 8]);
        }
        wires.begin(WireFault::MisoReplay { age_ns: 10 * MS });
        assert_eq!(seen(&mut wires, 20 * MS, 0, &[5; 8]), [2; 8]);
        assert_eq!(seen(&mut wires, 24 * MS, 0, &[6; 10]), [3, 3, 3, 3, 3, 3, 3, 3, 6, 6], "a longer one");
        assert_eq!(seen(&mut wires, 30 * MS, 0, &[7; 8]), [5; 8]);
        let mut young = broken(WireFault::MisoReplay { age_ns: HISTORY_NS });
        assert_eq!(seen(&mut young, MS, 0, &[9]), [9], "there is nothing that old");
    }

    #[test]
    fn a_splice_ends_with_the_transaction_before() {
        let mut wires = broken(WireFault::MisoSplice { at_byte: 2 });
        assert_eq!(seen(&mut wires, 0, 0, &[1; 5]), [1; 5], "there is none before");
        assert_eq!(seen(&mut wires, 1, 0, &[2; 5]), [2, 2, 1, 1, 1]);
        assert_eq!(seen(&mut wires, 2, 0, &[3; 6]), [3, 3, 2, 2, 2, 3], "as far as that reached");
    }

    #[test]
    fn gps1_and_gps2_swap_places_where_both_are_read() {
        let mut wires = broken(WireFault::MisoSwap);
        let swapped = seen(&mut wires, 0, 0, &image());
        assert_eq!(
            (swapped[95], swapped[96], swapped[155], swapped[156], swapped[215], swapped[216]),
            (1, 3, 3, 2, 2, 4)
        );
        assert_eq!(seen(&mut wires, 0, 32, &image()[32..]), swapped[32..], "in a window");
        assert_eq!(seen(&mut wires, 0, 0, &image()[..200]), image()[..200], "GPS2 in part");
        assert_eq!(seen(&mut wires, 0, 120, &image()[120..]), image()[120..], "GPS1 in part");
        let mut one = Wires::new(Layout::for_receivers(1).unwrap(), 1);
        one.begin(WireFault::MisoSwap);
        assert_eq!(seen(&mut one, 0, 0, &image()[..156]), image()[..156], "there is no GPS2");
    }

    #[test]
    fn the_place_of_one_object_reads_zero_wherever_the_window_lies() {
        for object in 0..4_u8 {
            let mut wires = broken(WireFault::MisoVacant { object: object.into() });
            let expected: Vec<u8> = image().iter().map(|byte| if *byte == object + 1 { 0 } else { *byte }).collect();
            for window in [0..276, 32..276, 100..200, 0..40, 216..276, 250..251] {
                let read = seen(&mut wires, 0, window.start, &image()[window.clone()]);
                assert_eq!(read, expected[window.clone()], "object {object} in {window:?}");
            }
        }
        let mut none = broken(WireFault::MisoVacant { object: 4 });
        assert_eq!(seen(&mut none, 0, 0, &image()), image());
    }

    #[test]
    fn a_frozen_line_repeats_the_last_transaction_until_it_thaws() {
        let mut wires = wires();
        wires.begin(WireFault::MisoFrozen);
        assert_eq!(seen(&mut wires, 0, 0, &[1; 4]), [1; 4], "there was none before");
        wires.end(WireFault::MisoFrozen);
        wires.begin(WireFault::MisoFrozen);
        assert_eq!(seen(&mut wires, 1, 0, &[2; 5]), [1, 1, 1, 1, 2]);
        assert_eq!(seen(&mut wires, 2, 0, &[3; 2]), [1; 2]);
        wires.end(WireFault::MisoFrozen);
        assert_eq!(seen(&mut wires, 3, 0, &[4; 4]), [4; 4]);
    }

    #[test]
    fn a_forged_object_has_the_wrong_bits_and_a_right_crc() {
        let layout = Layout::for_receivers(3).unwrap();
        for (object, place) in [(None, 0..32), (Some(0), layout.in_image(0).unwrap()), (Some(3), 216..276)] {
            let mut wires = broken(WireFault::MisoForged { object, byte: 9, bits: 0x81 });
            let read = seen(&mut wires, 0, 0, &image());
            let mut expected = image();
            expected[place.start + 9] ^= 0x81;
            let seal = place.end - 4..place.end;
            expected[seal.clone()].copy_from_slice(&read[seal]);
            assert_eq!(read, expected, "{object:?}");
            assert!(crc::frame_intact(&read[place.clone()]), "{object:?}");
            let from = place.start;
            assert_eq!(seen(&mut wires, 0, from, &image()[from..]), read[from..], "in a window");
            assert_eq!(seen(&mut wires, 0, from + 1, &image()[from + 1..]), image()[from + 1..], "without its start");
            let end = place.end - 1;
            assert_eq!(seen(&mut wires, 0, 0, &image()[..end]), image()[..end], "without its end");
        }
        let mut none = broken(WireFault::MisoForged { object: Some(4), byte: 9, bits: 1 });
        assert_eq!(seen(&mut none, 0, 0, &image()), image(), "there is no GPS4");
        let mut beyond = broken(WireFault::MisoForged { object: None, byte: 28, bits: 1 });
        assert_eq!(seen(&mut beyond, 0, 0, &image()), image(), "the CRC is not forged itself");
    }

    #[test]
    fn a_stuck_fresh_shows_no_pulse_and_cuts_none_in_two() {
        let edges = |wires: &mut Wires, at, level| wires.fresh(at, level).collect::<Vec<_>>();
        let mut wires = wires();
        assert_eq!(edges(&mut wires, 1, true), [(1, true)]);
        wires.begin(WireFault::FreshStuck);
        assert_eq!(edges(&mut wires, 2, false), [(2, false)]);
        assert_eq!(edges(&mut wires, 3, true), []);
        assert_eq!(edges(&mut wires, 4, false), []);
        assert_eq!(edges(&mut wires, 5, true), []);
        wires.end(WireFault::FreshStuck);
        assert_eq!(edges(&mut wires, 6, false), []);
        assert_eq!(edges(&mut wires, 7, true), [(7, true)]);
    }

    #[test]
    fn fresh_and_tick_show_a_pulse_more_or_come_late() {
        let mut wires = broken(WireFault::FreshGlitch);
        assert_eq!(wires.fresh(MS, true).collect::<Vec<_>>(), [(MS, true)]);
        let fall = MS + 500;
        let again = fall + GLITCH_AFTER_NS;
        let pulses = [(fall, false), (again, true), (again + GLITCH_NS, false)];
        assert_eq!(wires.fresh(fall, false).collect::<Vec<_>>(), pulses);
        let mut late = broken(WireFault::FreshLate(70));
        assert_eq!(late.fresh(MS, true).collect::<Vec<_>>(), [(MS + 70, true)]);
        assert_eq!(broken(WireFault::TickStuck).tick(MS).count(), 0);
        assert!(broken(WireFault::TickStuck).shows_inputs() && !broken(WireFault::InputsUnseen).shows_inputs());
        assert_eq!(broken(WireFault::TickGlitch).tick(MS).collect::<Vec<_>>(), [MS, MS + GLITCH_AFTER_NS]);
    }

    #[test]
    fn each_radio_fault_drops_damages_or_mixes_its_frame() {
        assert!(!broken(WireFault::RadioDrop).radio(&mut vec![1, 2]));
        assert!(broken(WireFault::RadioDrop).radio(&mut vec![]), "nothing was sent");
        let mut wires = broken(WireFault::RadioBit);
        let mut places = std::collections::BTreeSet::new();
        for _ in 0..50 {
            let mut bytes = vec![0; 20];
            assert!(wires.radio(&mut bytes));
            assert_eq!(bytes.iter().map(|byte| byte.count_ones()).sum::<u32>(), 1);
            places.insert(bytes);
        }
        assert!(places.len() > 20, "{}", places.len());
        let mut wires = broken(WireFault::RadioMix);
        let mut heard = |mut bytes: Vec<u8>| {
            assert!(wires.radio(&mut bytes));
            bytes
        };
        assert_eq!(heard(vec![1; 4]), [1; 4]);
        assert_eq!(heard(vec![2; 4]), [2, 2, 1, 1]);
        assert_eq!(heard(vec![]), [0; 0]);
        assert_eq!(heard(vec![3; 5]), [3, 3, 2, 2]);
    }

    #[test]
    #[should_panic(expected = "a replay of 1000000001 ns ago")]
    fn a_replay_that_reaches_back_too_far_panics() {
        wires().begin(WireFault::MisoReplay { age_ns: HISTORY_NS + 1 });
    }
}
