//! Recordings of silicon (an ST25R3916 at 5.2 V reading an NFC-A tag), replayed: the same MOSI bytes at the same instants must get the same
//! MISO bytes, and the IRQ pin must move as it did.
//!
//! The recordings are not part of this repository; without them these tests say so and pass.
//!
//! What the recordings do not show is set up before they begin, over SPI, as the recorded firmware had done (registers it had written,
//! a general purpose timer that had run out while masked). The tag is a stand-in that answers with the recorded bytes when the recorded tag
//! did: its answers' instants are derived from the recorded I_rxs edges, which are therefore checked for order and level only; that they
//! fit ISO 14443-3's frame delay time is a check of its own.

use std::path::PathBuf;

use st25r3916_model::{AirEvent, BrokenFrame, Chip, Chunk, Config, FrameStart, Space, Technology, Variant};

/// Where in virtual time a recording begins: after the set-up.
const BEGIN_NS: u64 = 60_000_000;
/// From a transfer's recorded instant to its first clock, and a byte's duration; both as the IRQ edges after interrupt reads show them.
const LEAD_NS: u64 = 1_000;
const BYTE_NS: u64 = 1_900;
/// How far a modelled edge may lie from the recorded one. The transmitter's start varies by 2.3 µs in the recording (one bit of 424 kbit/s).
const EDGE_TOLERANCE_NS: u64 = 2_500;
/// One bit at 106 kbit/s.
const BIT_AS: u64 = 9_439_528_023_598;

#[derive(Clone, Debug)]
enum Line {
    Transfer { at: u64, mosi: Vec<u8>, miso: Vec<u8> },
    Irq { at: u64, level: bool },
}

impl Line {
    fn at(&self) -> u64 {
        match self {
            Self::Transfer { at, .. } | Self::Irq { at, .. } => *at,
        }
    }
}

fn capture(name: &str) -> Option<Vec<Line>> {
    let path: PathBuf = [env!("CARGO_MANIFEST_DIR"), "../../../shared/data/st25r3916-silicon", name].iter().collect();
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: no recording {name}");
        return None;
    };
    let hex = |s: &str| -> Vec<u8> { s.split_whitespace().map(|b| u8::from_str_radix(b, 16).expect("hex")).collect() };
    let mut lines = Vec::new();
    // Two lines name the channels.
    for line in text.lines().skip(2).filter(|l| !l.trim().is_empty()) {
        let (time, rest) = line.trim().split_once(' ').expect("an instant and what happened");
        let (us, tenths) = time.split_once('.').expect("microseconds with a tenth");
        let at = BEGIN_NS + us.parse::<u64>().expect("us") * 1_000 + tenths.parse::<u64>().expect("tenths") * 100;
        lines.push(match rest.trim().split_once("IRQ ") {
            Some((_, level)) => Line::Irq { at, level: level == "1" },
            None => {
                let (mosi, miso) = rest.split_once('|').expect("MOSI | MISO");
                Line::Transfer { at, mosi: hex(mosi), miso: hex(miso) }
            }
        });
    }
    // An edge inside a transfer may be listed before it.
    lines.sort_by_key(Line::at);
    Some(lines)
}

/// The recorded board.
fn board() -> Chip {
    Chip::new(Config {
        variant: Variant::St25r3916,
        vdd_mv: 5_220,
        regulator_display: 0xE0,
        driver_timing_display: 0x04,
        broken_frame: BrokenFrame::EndsWithError,
        ..Config::default()
    })
}

fn exchange(chip: &mut Chip, at: u64, mosi: &[u8]) -> Vec<u8> {
    chip.select(at);
    let mut now = at + LEAD_NS;
    let miso = mosi
        .iter()
        .map(|&b| {
            now += BYTE_NS;
            chip.transfer(now, b)
        })
        .collect();
    chip.deselect(now + 100);
    miso
}

/// What the recorded firmware does before its first scan.
fn bring_up(chip: &mut Chip, writes: &[&[u8]]) {
    let mut now = 1_000_000;
    let mut run = |bytes: &[u8], then: u64| {
        exchange(chip, now, bytes);
        now += 20_000 + then;
    };
    run(&[0xC1], 0);
    run(&[0x00, 0x07, 0x3C], 0);
    run(&[0xFC, 0x04, 0x10], 0);
    run(&[0x16, 0xFF, 0xFF, 0xFF, 0xFF], 0);
    run(&[0x02, 0x80], 1_000_000);
    run(&[0x03, 0x08], 0);
    run(&[0x5A, 0, 0, 0, 0], 0);
    // Supply measurement and regulators.
    run(&[0xDF], 100_000);
    run(&[0xD6], 4_000_000);
    run(&[0x5A, 0, 0, 0, 0], 0);
    // 20 ms of the general purpose timer, masked: its bit stays.
    run(&[0x13, 0x84, 0x6C], 0);
    run(&[0xE0], 21_000_000);
    run(&[0x02, 0x83], 0);
    for w in writes {
        run(w, 0);
    }
    assert!(now < BEGIN_NS);
}

#[test]
fn every_register_of_both_spaces_reads_as_on_silicon() {
    let Some(lines) = capture("Read_All_Registers_SpaceA_B.txt") else { return };
    let mut chip = board();
    // What the bring-up of the recorded firmware writes besides.
    bring_up(
        &mut chip,
        &[&[0x08, 0x50], &[0x26, 0x49, 0x45], &[0x29, 0x5F, 0x11, 0x00], &[0xFB, 0x05, 0x40], &[0x5A, 0, 0, 0, 0]],
    );
    for line in lines {
        if let Line::Transfer { at, mosi, miso } = line {
            assert_eq!(exchange(&mut chip, at, &mosi), miso, "{mosi:02X?}");
        }
    }
    assert!(!chip.irq());
    // The list holds addresses that the part has, and no other.
    assert_eq!(
        chip.reports().iter().filter(|r| matches!(r.kind, st25r3916_model::Kind::NoSuchRegister(..))).count(),
        0
    );
}

/// An NFC-A tag that says what the recorded one said, when it said it.
struct Tag {
    /// Recorded I_rxs edges, and the bytes the firmware then read and must have heard.
    answers: Vec<(u64, Vec<u8>)>,
    /// From the start of the answer to I_rxs, ns.
    to_rxs: u64,
}

impl Tag {
    fn from(lines: &[Line], config: &Config) -> Self {
        let mut answers = Vec::new();
        let mut rose = 0;
        for line in lines {
            match line {
                Line::Irq { at, level: true } => rose = *at,
                // I_rxs alone
                Line::Transfer { mosi, miso, .. } if mosi[0] == 0x5A && miso[1] == 0x20 => {
                    answers.push((rose, Vec::new()));
                }
                Line::Transfer { mosi, miso, .. } if mosi[0] == 0x9F => {
                    let (_, data) = answers.last_mut().expect("data after a start");
                    data.extend_from_slice(&miso[1..]);
                    // Of the SAK the firmware reads one byte of the three in the FIFO: its CRC_A is the standard's.
                    if data.len() == 1 {
                        let crc = crc_a(data);
                        data.extend_from_slice(&crc);
                    }
                }
                _ => {}
            }
        }
        let bit = BIT_AS / 1_000_000_000;
        Self { answers, to_rxs: bit + config.nfc_a_start_latency_ns }
    }

    /// Tells the chip of every answer in good time.
    fn speak(&self, chip: &mut Chip) {
        for (rxs, data) in &self.answers {
            let start = rxs - self.to_rxs;
            let bits = 1 + 9 * data.len() as u64;
            chip.hear(
                start,
                &AirEvent::FrameStart(FrameStart {
                    technology: Technology::NfcA,
                    bits_per_second: 106_000,
                    bit_as: BIT_AS,
                    header_bits: 1,
                    byte_bits: 9,
                    load_modulation: true,
                    chunk: Chunk { data: data.clone(), parity_error: false },
                }),
            );
            chip.hear(start + bits * BIT_AS / 1_000_000_000, &AirEvent::FrameEnd { bits: 8 * data.len() as u32 });
        }
    }
}

fn crc_a(data: &[u8]) -> [u8; 2] {
    let mut crc = 0x6363u16;
    for &b in data {
        let x = (b ^ crc as u8) ^ ((b ^ crc as u8) << 4);
        crc = (crc >> 8) ^ (u16::from(x) << 8) ^ (u16::from(x) << 3) ^ (u16::from(x) >> 4);
    }
    crc.to_le_bytes()
}

#[test]
fn reading_a_tag_answers_byte_for_byte_and_moves_the_irq_pin_in_order_and_in_time() {
    let Some(lines) = capture("Read_UID_ISO14443A_NFC-A.txt") else { return };
    let mut chip = board();
    bring_up(
        &mut chip,
        &[
            &[0x0A, 0x01],
            &[0x0D, 0x00],
            &[0x12, 0x20],
            &[0x17, 0xBF],
            &[0x26, 0x49, 0x45],
            &[0xFB, 0x05, 0x40],
            &[0xFB, 0x0C, 0x51],
            &[0xFB, 0x30, 0x40, 0x03, 0x40, 0x03],
        ],
    );
    let tag = Tag::from(&lines, chip.config());
    assert_eq!(tag.answers.len(), 6);
    tag.speak(&mut chip);

    let mut level = chip.irq();
    let mut edges: Vec<(u64, bool)> = Vec::new();
    let mut sent: Vec<(u64, AirEvent)> = Vec::new();
    let mut look = |chip: &mut Chip, edges: &mut Vec<(u64, bool)>, now: u64| {
        if chip.irq() != level {
            level = chip.irq();
            edges.push((now, level));
        }
        sent.extend(chip.take_air());
    };
    let recorded: Vec<(u64, bool)> =
        lines.iter().filter_map(|l| if let Line::Irq { at, level } = l { Some((*at, *level)) } else { None }).collect();

    for line in &lines {
        let Line::Transfer { at, mosi, miso } = line else { continue };
        while let Some(t) = chip.next_event().filter(|t| t < at) {
            chip.advance(t);
            look(&mut chip, &mut edges, t);
        }
        chip.select(*at);
        let mut now = *at + LEAD_NS;
        for (i, (&out, &expected)) in mosi.iter().zip(miso).enumerate() {
            now += BYTE_NS;
            let got = chip.transfer(now, out);
            assert_eq!(got, expected, "{:.1} us: byte {i} of {mosi:02X?}", (*at - BEGIN_NS) as f64 / 1e3);
            look(&mut chip, &mut edges, now);
        }
        chip.deselect(now + 100);
    }

    assert_eq!(edges.len(), recorded.len(), "edges {edges:?}");
    for ((at, level), (was, recorded_level)) in edges.iter().zip(&recorded) {
        assert_eq!(level, recorded_level, "at {at}");
        assert!(at.abs_diff(*was) <= EDGE_TOLERANCE_NS, "edge at {at}, recorded at {was}");
    }

    // What the tag heard: the frames of ISO 14443-3, with the CRC the chip adds.
    let frames: Vec<&Vec<u8>> = sent
        .iter()
        .filter_map(|(_, e)| if let AirEvent::FrameStart(f) = e { Some(&f.chunk.data) } else { None })
        .collect();
    let expected: [(&[u8], bool); 7] = [
        (&[0x26], false),
        (&[0x50, 0x00], true),
        (&[0x52], false),
        (&[0x93, 0x20], false),
        (&[0x93, 0x70, 0x88, 0x02, 0xA2, 0x00, 0x28], true),
        (&[0x95, 0x20], false),
        (&[0x95, 0x70, 0x71, 0xC8, 0x4F, 0x90, 0x66], true),
    ];
    assert_eq!(frames.len(), expected.len());
    for (got, (body, with_crc)) in frames.iter().zip(expected) {
        let mut whole = body.to_vec();
        if with_crc {
            whole.extend_from_slice(&crc_a(body));
        }
        assert_eq!(**got, whole);
    }
    assert_eq!(sent.first().map(|(_, e)| e), Some(&AirEvent::FieldOn));
    assert_eq!(sent.last().map(|(_, e)| e), Some(&AirEvent::FieldOff));
    assert_eq!(chip.peek(Space::A, 0x02), 0x83);
    assert_eq!(chip.statistics().received, 6);
    assert_eq!(chip.statistics().crc_errors, 0);

    // ISO 14443-3: an answer starts 1172 cycles (86.4 us) after the end of the last bit, plus the pause; I_txe comes two bits after that bit.
    let delays: Vec<u64> = sent
        .iter()
        .zip(sent.iter().skip(1))
        .filter_map(|((_, a), (end, b))| {
            matches!((a, b), (AirEvent::FrameStart(_), AirEvent::FrameEnd { .. })).then_some(*end)
        })
        .filter_map(|end| {
            tag.answers
                .iter()
                .map(|(rxs, _)| rxs - tag.to_rxs)
                .find(|start| *start > end && start - end < 1_000_000)
                .map(|s| s - end)
        })
        .collect();
    assert_eq!(delays.len(), 6);
    for d in delays {
        assert!((67_500..=73_000).contains(&d), "frame delay {d} ns after the end of transmission");
    }
}
