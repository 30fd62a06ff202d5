//! Faults of the active hold and of the air between it and the DPR's second front end.

use bench_judge::Disturbance;
use bench_judge::disturbance::{HoldPart, Wire};
use st25r3916_model::{AirEvent, AirFaults, Chunk, ForeignCard, FrameStart, Technology, nfc_f};

pub use super::hold_board::Sensor;
use super::hold_board::{HoldBoardFault, SensorFault};
use super::{ChipFault, PowerFault, Rng};

/// One millisecond, ns.
const MS: u64 = 1_000_000;

/// Transmissions of a hostile sender in place of the hold's own frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hostile {
    /// Frames of random bytes with right CRC-16, one after the other.
    Random,
    /// Frames that HORUS has sent, one after the other.
    Horus,
    /// Frames with a wrong LEN or a wrong end, about as long as Hold-Status.
    Lengths,
    /// A carrier without frames.
    Carrier,
    /// A carrier that goes on and off.
    Blinks,
}

/// A fault that is not in the event log, so that the judge has to report its effects. `--faults` draws no such fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Break {
    /// The hold's antenna sends no frames.
    Mute,
    /// The DPR's second front end receives none of the frames at its antenna.
    PortDeaf,
    /// The antenna of the DPR's second front end sends no answers.
    PortMute,
    /// The hold's front end receives none of the answers at its antenna.
    Deaf,
    /// The DPR's answers have other uplinks than those that were written.
    Uplinks,
    /// The hold's objects have another set-point than the one that was commanded.
    SetPoint,
    /// The lock's pin has the opposite level.
    Lock,
    /// The firmware of the hold uses one of the board's chips against its data sheet.
    Misuse,
}

/// A fault of the hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HoldFault {
    /// A fault of the air from the hold to the DPR.
    Frames(AirFaults),
    /// A fault of the air from the DPR to the hold.
    Answers(AirFaults),
    /// A fault of the chip of the DPR's second front end, or of a line to it. `--faults` does not draw this fault.
    Port(ChipFault),
    /// A card in the hold's field answers in addition to the DPR.
    Foreign(ForeignCard),
    /// A fault of the hold's supply or reset pin.
    Power(PowerFault),
    /// The hold's core executes nothing until its watchdog resets it.
    Hang,
    /// A hostile sender transmits in place of the hold; the seed determines its bytes.
    Hostile(Hostile, u64),
    /// A sensor does not answer.
    Silent(Sensor),
    /// A sensor sends random bytes; the seed determines them.
    Lies(Sensor, u64),
    /// SDA of the sensors' bus stays low.
    BusStuck,
    /// A fault of the board, which is not drawn.
    Board(HoldBoardFault),
    /// A fault of the sensors or of what they measure, which is not drawn.
    Sensors(SensorFault),
    /// Each pair of antennas at the DPR also receives what is meant for the other pair.
    Crosstalk,
    /// The run deviates from its log.
    Broken(Break),
    /// A constant in the hold's program has another value to the end of the run ([`super::ImageFault::Constant`]).
    /// `--faults` does not draw this fault.
    Constant {
        /// The original constant.
        of: u32,
        /// The new constant.
        value: u32,
    },
}

impl HoldFault {
    /// Returns every kind of transmission by a hostile sender in place of the hold.
    pub(super) fn hostile(rng: &mut Rng) -> impl Iterator<Item = Self> {
        let all = [Hostile::Random, Hostile::Horus, Hostile::Lengths, Hostile::Carrier, Hostile::Blinks];
        all.map(|hostile| Self::Hostile(hostile, rng.word())).into_iter()
    }

    /// Every fault, so strong that an episode of average length has visible effects.
    pub(super) fn all(rng: &mut Rng) -> Vec<Self> {
        let none = AirFaults::default();
        let ways = [
            AirFaults { bit_error: 1e-3, ..none },
            AirFaults { lost: 0.5, ..none },
            AirFaults { lost: 1.0, ..none },
            AirFaults { truncated: 0.5, ..none },
            AirFaults { repeated: 0.5, repeat_after_ns: (100_000, 50 * MS), ..none },
            AirFaults { delayed: 0.5, delay_ns: (100_000, 120 * MS), ..none },
            AirFaults { frozen: true, ..none },
        ];
        let mut faults: Vec<Self> = ways.into_iter().flat_map(|way| [Self::Frames(way), Self::Answers(way)]).collect();
        for (after, payload) in [((250_000, 2_500_000), 128), ((100_000, 900_000), 20)] {
            faults.push(Self::Foreign(ForeignCard { answers: 0.7, after_ns: after, payload }));
        }
        faults.extend([Self::Power(PowerFault::Off(rng.word())), Self::Power(PowerFault::Pin), Self::Hang]);
        faults.extend(Self::hostile(rng));
        for sensor in [Sensor::Climate, Sensor::Vibration] {
            faults.extend([Self::Silent(sensor), Self::Lies(sensor, rng.word())]);
        }
        faults.extend([Self::BusStuck, Self::Crosstalk]);
        faults
    }

    /// Returns the fault's name in the event log.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Frames(_) => "frames".into(),
            Self::Answers(_) => "answers".into(),
            Self::Port(fault) => format!("second port {}", fault.name()),
            Self::Foreign(_) => "foreign card".into(),
            Self::Power(fault) => format!("power {}", fault.name()),
            Self::Hang => "hangs".into(),
            Self::Hostile(hostile, _) => format!("hostile {}", format!("{hostile:?}").to_lowercase()),
            Self::Silent(sensor) => format!("{} sensor silent", format!("{sensor:?}").to_lowercase()),
            Self::Lies(sensor, _) => format!("{} sensor lies", format!("{sensor:?}").to_lowercase()),
            Self::BusStuck => "bus stuck".into(),
            Self::Board(fault) => fault.name(),
            Self::Sensors(fault) => fault.name(),
            Self::Crosstalk => "crosstalk".into(),
            Self::Broken(what) => format!("{what:?}").to_lowercase(),
            Self::Constant { of, value } => format!("{value:#x} for {of:#x}"),
        }
    }

    /// Returns the disturbance by which the judge determines what to excuse.
    #[must_use]
    pub const fn disturbs(&self) -> Disturbance {
        match self {
            Self::Crosstalk => Disturbance::Crosstalk,
            Self::Broken(_) | Self::Constant { .. } => Disturbance::Wire { wire: Wire::Hold },
            Self::Power(_) | Self::Hang | Self::Board(_) => Disturbance::Hold { part: HoldPart::Board },
            Self::Silent(_) | Self::Lies(..) | Self::BusStuck | Self::Sensors(_) => {
                Disturbance::Hold { part: HoldPart::Sensors }
            }
            Self::Frames(_) | Self::Answers(_) | Self::Foreign(_) | Self::Hostile(..) | Self::Port(_) => {
                Disturbance::Hold { part: HoldPart::Air }
            }
        }
    }
}

/// A hostile sender on the air in place of the hold.
#[derive(Clone, Debug)]
pub struct Impostor {
    hostile: Hostile,
    rng: Rng,
    /// The sender's next events, each with its instant, ns.
    planned: std::collections::VecDeque<(u64, AirEvent)>,
    carrier: bool,
}

impl Impostor {
    /// Returns a hostile sender that begins at `at` (ns). `carrier` is true if the hold's carrier is on then.
    #[must_use]
    pub fn new(hostile: Hostile, seed: u64, at: u64, carrier: bool) -> Self {
        let mut impostor = Self { hostile, rng: Rng::new(seed), planned: [].into(), carrier: true };
        if !carrier {
            impostor.planned.push_back((at, AirEvent::FieldOn));
        }
        impostor.plan(at, &[]);
        impostor
    }

    /// Whether the hostile sender's carrier is on at present.
    #[must_use]
    pub fn carrier(&self) -> bool {
        self.carrier
    }

    /// The instant of the next event, ns.
    #[must_use]
    pub fn next_at(&self) -> u64 {
        self.planned.front().map_or(u64::MAX, |(at, _)| *at)
    }

    /// Takes the sender's next event. `horus` has frames of HORUS, which the sender may repeat. If `goes_on`, the
    /// sender continues after its planned events.
    pub fn take(&mut self, horus: &[Vec<u8>], goes_on: bool) -> Option<(u64, AirEvent)> {
        let (at, event) = self.planned.pop_front()?;
        match event {
            AirEvent::FieldOn => self.carrier = true,
            AirEvent::FieldOff => self.carrier = false,
            _ => {}
        }
        if self.planned.is_empty() && goes_on {
            self.plan(at, horus);
        }
        Some((at, event))
    }

    fn plan(&mut self, at: u64, horus: &[Vec<u8>]) {
        let rng = &mut self.rng;
        let begins = at + if rng.one_in(2) { rng.between(20_000, 400_000) } else { rng.between(20_000, 20 * MS) };
        let mut cut = false;
        let mut payload: Vec<u8> = match self.hostile {
            Hostile::Carrier => return,
            Hostile::Blinks => {
                let event = if self.carrier { AirEvent::FieldOff } else { AirEvent::FieldOn };
                return self.planned.push_back((begins, event));
            }
            Hostile::Horus => match horus.get(rng.below(horus.len() as u64) as usize) {
                // A frame of HORUS already has LEN and CRC-16.
                Some(frame) => return self.send(begins, frame.clone(), false),
                None => vec![0; 64],
            },
            Hostile::Random => (0..rng.below(255)).map(|_| rng.byte()).collect(),
            Hostile::Lengths => {
                cut = rng.one_in(2);
                (0..60 + rng.below(9)).map(|_| rng.byte()).collect()
            }
        };
        if self.hostile == Hostile::Random && rng.one_in(3) {
            payload.resize(64, 0);
        }
        let mut frame = vec![payload.len() as u8 + 1];
        if self.hostile == Hostile::Lengths && !cut {
            frame[0] = rng.byte();
        }
        frame.extend(payload);
        frame.extend(nfc_f(&frame));
        self.send(begins, frame, cut);
    }

    fn send(&mut self, at: u64, data: Vec<u8>, cut: bool) {
        let all = 8 * data.len() as u32;
        let bits = if cut { self.rng.below(u64::from(all)) as u32 } else { all };
        // The duration in attoseconds of 32 cycles of 13.56 MHz.
        let bit_as = 2_359_882_005_900;
        let start = FrameStart {
            technology: Technology::NfcF,
            bits_per_second: 424_000,
            bit_as,
            header_bits: 64,
            byte_bits: 8,
            load_modulation: false,
            chunk: Chunk { data, parity_error: false },
        };
        let ends = at + (u128::from(64 + bits) * u128::from(bit_as) / 1_000_000_000) as u64;
        self.planned.extend([(at, AirEvent::FrameStart(start)), (ends, AirEvent::FrameEnd { bits })]);
    }
}
