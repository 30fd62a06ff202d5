//! Plays random transactions, drawn from a seed, to both clients. The C client runs under the sanitizers and must write
//! what the Rust client writes.
use std::collections::BTreeMap;

use profile::criticality::{ActiveLoad, BaseStation, Dpr, Writer};
use profile::hold::{Acknowledged, Outcome};
use profile::map::PortArea;
use profile::ssi::client::{Config, Verdict};
use profile::{
    GpsValues, HoldStatus, HoldStatusBits, HoldValues, Layout, LinkStatus, LinkStatusBits, LinkValues, PortStatus,
    PortStatusBits, PortValues, Profile, ReportedStatus, ReportedValues, Uplink, UplinkValues,
};

use super::c::Build;
use super::support::tape::{NO_FRESH, Tape, play};
use super::support::{invariants, reference, seeds};
use super::{assert_same, recordings};

/// The random generator xorshift64*. It gives the same numbers on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn below(&mut self, bound: usize) -> usize {
        usize::try_from(self.next() >> 33).expect("31 bits") % bound
    }
}

struct Drawn {
    random: Random,
    tape: Tape,
    layout: Layout,
    now_us: u64,
    timestamp: u32,
    image: u32,
    hold_timestamp: u32,
    acknowledged: u16,
    asked: Option<(usize, usize)>,
}

impl Drawn {
    fn new(seed: u64) -> Self {
        Self {
            random: Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1),
            tape: Tape::default(),
            layout: Layout::ALL[2],
            now_us: 1_000_000,
            timestamp: 0,
            image: 0,
            hold_timestamp: 0,
            acknowledged: 0,
            asked: None,
        }
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.random.below(from.len())]
    }

    fn once_in(&mut self, times: usize) -> bool {
        self.random.below(times) == 0
    }

    fn f64(&mut self, plausible: f64) -> f64 {
        let any = f64::from_bits(self.random.next());
        match self.random.below(24) {
            0 => self.pick(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0, f64::MIN_POSITIVE, f64::MAX]),
            1 => {
                let limit = self.pick(&[90.0_f64, -90.0, 180.0, -180.0, -1_000.0, 1_000.0, 20_000.0, -20_000.0]);
                self.pick(&[limit, limit.next_up(), limit.next_down()])
            }
            2 => any,
            _ => plausible,
        }
    }

    fn f32(&mut self, plausible: f32) -> f32 {
        let bits = u32::try_from(self.random.next() >> 32).expect("32 bits");
        match self.random.below(24) {
            0 => self.pick(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.0, f32::MAX]),
            1 => f32::from_bits(bits),
            _ => plausible,
        }
    }

    fn bits(&mut self) -> u16 {
        u16::try_from(self.random.next() >> 48).expect("16 bits")
    }

    fn number(&mut self) -> u32 {
        u32::try_from(self.random.next() >> 32).expect("32 bits")
    }

    fn step(&mut self) {
        match self.random.below(40) {
            0 => self.config(),
            1..=4 => self.ask(),
            5 => self.write(),
            6..=8 => self.tape.view(),
            9 => {
                let (timestamp, which) = (self.number(), self.pick(&[0, 1]));
                self.tape.command(timestamp, which);
            }
            10 => {
                let (timestamp, status) = (self.number(), self.bits());
                self.tape.uplink(timestamp, status, &[0x3C; 52]);
            }
            11..=12 => {
                let (which, set_point) = (self.pick(&[0, 1, 2, 3]), self.f32(4.5));
                self.tape.send(which, set_point);
            }
            13..=14 => {
                let (timestamp, status) = (self.number(), self.bits());
                self.tape.commanding(timestamp, status, &[0x3C; 52]);
            }
            15 => self.tape.give_up(),
            _ => {}
        }
        self.transaction();
    }

    fn config(&mut self) {
        let layout = self.pick(&Layout::ALL);
        let layout = if self.once_in(2) { layout.with_hold() } else { layout };
        self.layout = layout;
        let map = u16::try_from(layout.map_len()).expect("short");
        let config = Config {
            layout,
            read_bytes: self.pick(&[96, 96, 96, 100, map, map, map - 1, map + 1, 95]),
            age_limit_us: self.pick(&[100_000, 100_000, 20_000, 0, 5_400, u32::MAX]),
            silence_us: self.pick(&[30_000, 30_000, 0, u32::MAX]),
        };
        let receivers = if self.once_in(16) { self.pick(&[0, 4, 6, 127]) } else { layout.receivers().to_le_bytes()[0] };
        self.tape.config(receivers, &config);
        self.asked = None;
    }

    fn ask(&mut self) {
        let map = self.layout.map_len();
        let start = if self.once_in(3) { self.pick(&[0, 32, 96, 156, 276]) } else { self.random.below(map + 8) };
        let length = if self.once_in(3) { self.pick(&[60, 64, 96, 192]) } else { self.random.below(map + 8) };
        self.tape.ask(u16::try_from(start).expect("short"), u16::try_from(length).expect("short"));
        self.asked = (length > 0 && start + length <= map).then_some((start, length));
    }

    fn write(&mut self) {
        let mut object = [0; 64];
        let identifier = self.pick(&[0x4200_u16, 0x4300, 0x4301, 0x4800, 0x0000]);
        object[4..6].copy_from_slice(&identifier.to_le_bytes());
        let word = self.pick(&[0x4352_4C43_u32, 0x5453_4554, 0, 0x4352_4C42]);
        object[8..12].copy_from_slice(&word.to_le_bytes());
        if self.once_in(4) {
            object[12 + self.random.below(48)] = 1;
        }
        if !self.once_in(4) {
            reference::repair_frame_crc(&mut object);
        }
        self.tape.write(&object);
    }

    fn transaction(&mut self) {
        let step_us = self.pick(&[1_000, 4_000, 4_000, 10_000, 10_000, 10_000, 24_999, 25_001, 30_001, 100_000]);
        self.now_us = match self.random.below(200) {
            0 => self.now_us.wrapping_sub(400_000),
            1 => self.random.next(),
            2 => 1_000_000,
            3 => self.now_us + 260_000,
            _ => self.now_us.wrapping_add(step_us),
        };
        let step_ms = u32::try_from(step_us / 10_000 * 10).expect("short");
        self.timestamp = match self.random.below(60) {
            0 => self.pick(&[0, u32::MAX - 4, 1_000]),
            1 => self.timestamp.wrapping_sub(10),
            2 => self.timestamp.wrapping_add(7),
            3 => self.timestamp.wrapping_add(self.pick(&[250, 260, 270, 20, 30])),
            4..=12 => self.timestamp,
            _ => self.timestamp.wrapping_add(step_ms),
        };
        if !self.once_in(8) {
            self.image = self.image.wrapping_add(10);
        }
        let map = match self.layout.receivers() {
            1 => self.map::<1>(),
            2 => self.map::<2>(),
            3 => self.map::<3>(),
            _ => self.map::<5>(),
        };
        let default = (0, self.pick(&[96, 96, 96, map.len()]));
        let (start, length) = if self.once_in(2) { self.asked.unwrap_or(default) } else { default };
        let mut miso = map[start..start + length].to_vec();
        self.damage(&mut miso);
        let fresh_us = match self.random.below(4) {
            0 => self.now_us.wrapping_sub(self.random.below(30_000) as u64),
            1 => self.now_us.wrapping_add(self.random.below(3) as u64),
            _ => NO_FRESH,
        };
        self.tape.transaction(self.now_us, fresh_us, &miso);
    }

    fn map<const N: usize>(&mut self) -> Vec<u8> {
        let plausible = seeds::reported_values(self.timestamp);
        let status = ReportedStatus::from_bits(if self.once_in(8) { self.bits() } else { plausible.status.bits() });
        let reported = ReportedValues {
            timestamp: self.timestamp,
            status,
            latitude: self.f64(plausible.latitude),
            longitude: self.f64(plausible.longitude),
            altitude: self.f64(plausible.altitude),
            pitch: self.f32(plausible.pitch),
            yaw: self.f32(plausible.yaw),
            roll: self.f32(plausible.roll),
            acceleration: plausible.acceleration.map(|axis| self.f32(axis)),
        };
        let gps = GpsValues { pitch: self.f32(0.5), ..seeds::gps_values(self.timestamp) };
        let link = LinkStatus::seal(&LinkValues {
            timestamp: self.image,
            status: LinkStatusBits::from_bits(self.bits()),
            age_100us: self.pick(&[53, 53, 53, 53, 0, 949, 950, 999, 1_000, u16::MAX - 1, u16::MAX]),
            ..seeds::link_values()
        });
        let port = PortStatus::seal(
            Writer::<Dpr>::claim(),
            &PortValues { status: PortStatusBits::from_bits(self.bits()), ..PortValues::default() },
        );
        let mut area = PortArea::EMPTY;
        area.set_status(Writer::<Dpr>::claim(), port);
        if self.once_in(2) {
            let values = UplinkValues { timestamp: self.image, payload: [0x77; 52], ..UplinkValues::default() };
            area.set_uplink(Writer::<BaseStation>::claim(), Uplink::seal(Writer::<BaseStation>::claim(), &values));
        }
        let profile = Profile::<N>::seal(&reported, &[gps; N]);
        let hold = if self.layout.hold().is_some() { self.hold() } else { vec![] };
        [link.as_bytes().as_slice(), profile.as_bytes(), area.as_bytes(), &hold].concat()
    }

    /// Returns random bytes of the hold's object in the map, mostly those of a plausible next object.
    fn hold(&mut self) -> Vec<u8> {
        self.hold_timestamp = match self.random.below(40) {
            0 => self.number(),
            1 => 0,
            2..=20 => self.hold_timestamp,
            _ => self.hold_timestamp.wrapping_add(100),
        };
        self.acknowledged = match self.random.below(40) {
            0 => self.bits(),
            1..=12 => self.acknowledged.wrapping_add(1),
            13 => self.acknowledged.wrapping_sub(1),
            _ => self.acknowledged,
        };
        let outcome = self.pick(&[
            Outcome::Done,
            Outcome::Done,
            Outcome::Refused,
            Outcome::Unknown,
            Outcome::TooOld,
            Outcome::Nothing,
        ]);
        let plausible = seeds::hold_values(self.hold_timestamp);
        let values = HoldValues {
            status: HoldStatusBits::from_bits(self.bits()),
            temperature: self.f32(plausible.temperature),
            acknowledged: [plausible.acknowledged[0], Acknowledged::new(self.acknowledged, outcome)],
            ..plausible
        };
        let mut bytes = HoldStatus::seal(Writer::<ActiveLoad>::claim(), &values).as_bytes().to_vec();
        match self.random.below(24) {
            0 => bytes.fill(0x00),
            1 => bytes.fill(0xFF),
            2 => bytes[46..].fill(5),
            3 => {
                let at = self.pick(&[4, 5, 7, 50]);
                bytes[at] ^= 1 << self.random.below(8);
                reference::repair_frame_crc(&mut bytes);
            }
            _ => {}
        }
        bytes
    }

    fn damage(&mut self, miso: &mut Vec<u8>) {
        let bits = miso.len() * 8;
        match self.random.below(20) {
            0 => {
                let bit = self.random.below(bits);
                miso[bit / 8] ^= 1 << (bit % 8);
            }
            1 => miso.fill(self.pick(&[0xFF, 0xFF, 0xFF, 0x00])),
            2 => {
                let from = self.random.below(miso.len());
                let level = self.pick(&[0x00, 0xFF, 0x55]);
                miso[from..].fill(level);
            }
            3 if miso.len() >= 96 => miso[32..96].fill(self.pick(&[0x00, 0x00, 0xFF])),
            4 => {
                let length = self.random.below(miso.len() + 1);
                miso.truncate(length);
            }
            5 => miso.resize(miso.len() + self.random.below(40), 0xFF),
            6 if miso.len() >= 96 => {
                let at = self.pick(&[36, 40, 50, 57, 4, 5]);
                miso[at] ^= 1 << self.random.below(8);
                let object = if at < 32 { 0..32 } else { 32..96 };
                reference::repair_frame_crc(&mut miso[object]);
            }
            _ => {}
        }
    }
}

fn drawn(seed: u64, transactions: usize) -> Vec<u8> {
    let mut drawn = Drawn::new(seed);
    (0..transactions).for_each(|_| drawn.step());
    drawn.tape.0
}

const TAPES: u64 = 50;
const TRANSACTIONS: usize = 4_000;

// Shows CLI-5.
#[test]
fn two_hundred_thousand_random_transactions_are_the_same_to_both_clients() {
    let mut seen = [0_u32; Verdict::ALL.len() + 1];
    let mut holds = BTreeMap::<String, u32>::new();
    for seed in 0..TAPES {
        let tape = drawn(seed, TRANSACTIONS);
        let said = play(&tape, |told| {
            invariants::report(&told);
            seen[usize::from(told.report.verdict as u8)] += 1;
        });
        // The fuzz test counts the states of Hold-Status and of the last command, to show that it reaches all of them.
        for line in said.lines().filter(|line| line.starts_with("hold ") && line.contains(" age=")) {
            let (shown, sent) = (&line[..6], line.split_once(" sent ").expect("a report").1);
            *holds.entry(shown.to_owned()).or_default() += 1;
            *holds.entry(format!("sent {}", &sent[..1])).or_default() += 1;
        }
        let c = Build::Sanitised.play(&tape);
        assert_same(&format!("tape {seed}, in Rust and in C"), &said, &c);
    }
    println!("{seen:?}");
    assert_eq!(seen.iter().sum::<u32>(), 200_000);
    assert!(seen[1..].iter().all(|count| *count > 1_000), "each verdict is met often: {seen:?}");
    println!("{holds:?}");
    assert!(holds.len() == 7 && holds.values().all(|count| *count > 1_000), "so is each case of the hold: {holds:?}");
}

#[test]
fn recordings_with_any_byte_changed_are_the_same_to_both_clients() {
    let mut random = Random(2026);
    let mut tapes = vec![];
    for (name, tape) in recordings::all() {
        for _ in 0..8 {
            let mut tape = tape.0.clone();
            for _ in 0..1 + random.below(6) {
                let at = random.below(tape.len());
                tape[at] = random.next().to_le_bytes()[0];
            }
            tapes.push((name, tape));
        }
    }
    for (name, tape) in tapes {
        let said = play(&tape, |told| invariants::report(&told));
        assert_same(&format!("{name}, changed, in Rust and in C"), &said, &Build::Sanitised.play(&tape));
    }
}
