//! Tests what the CRCs detect: every kind of damage by the air, the memory and the buses.
use profile::{GpsObject, Identifier, LinkStatus, Profile, Rejection, ReportedPosition, crc, image::Image, ssi};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed};

use crate::support;

use support::{
    reference::{self, flipped},
    seeds,
};

fn seeded(cases: u32) -> Config {
    Config { cases, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..Config::default() }
}

fn objects() -> [(&'static str, Vec<u8>); 3] {
    [
        ("Reported-Position", ReportedPosition::seal(&seeds::reported_values(1_230)).as_bytes().to_vec()),
        ("GPS1", GpsObject::seal(Identifier::gps(1), &seeds::gps_values(1_230)).as_bytes().to_vec()),
        ("Link-Status", LinkStatus::seal(&seeds::link_values()).as_bytes().to_vec()),
    ]
}

fn rejection(name: &str, bytes: &[u8]) -> Option<Rejection> {
    match name {
        "Reported-Position" => ReportedPosition::verify(bytes).err(),
        "GPS1" => GpsObject::verify(bytes, Identifier::gps(1)).err(),
        _ => LinkStatus::verify(bytes).err(),
    }
}

#[test]
fn every_single_bit_error_is_rejected() {
    for (name, valid) in objects() {
        assert_eq!(rejection(name, &valid), None);
        for bit in 0..8 * valid.len() {
            let damaged = flipped(&valid, [bit]);
            assert_eq!(rejection(name, &damaged), Some(Rejection::Crc), "{name}, bit {bit}");
        }
    }
}

#[test]
fn every_double_bit_error_is_rejected() {
    for (name, valid) in objects() {
        for first in 0..8 * valid.len() {
            for second in 0..first {
                let damaged = flipped(&valid, [first, second]);
                assert_eq!(rejection(name, &damaged), Some(Rejection::Crc), "{name}, {first}, {second}");
            }
        }
    }
}

/// A burst of errors on the air, `length` bits long. Its first and its last bit are wrong, and `pattern` says which of
/// the bits between them are.
fn burst(start: usize, length: usize, pattern: u32) -> impl Iterator<Item = usize> {
    (0..length).filter(move |at| *at == 0 || *at == length - 1 || pattern >> at & 1 == 1).map(move |at| start + at)
}

// Shows OBJ-4.
#[test]
fn a_burst_of_up_to_32_bits_is_rejected_wherever_it_starts() {
    let mut pattern = 0x9E37_79B9_u32;
    for (name, valid) in objects() {
        for length in 1..=32 {
            for start in 0..=8 * valid.len() - length {
                pattern ^= pattern << 13;
                pattern ^= pattern >> 17;
                pattern ^= pattern << 5;
                for pattern in [pattern, 0, u32::MAX] {
                    let damaged = flipped(&valid, burst(start, length, pattern));
                    assert_eq!(
                        rejection(name, &damaged),
                        Some(Rejection::Crc),
                        "{name}: {length} bits from bit {start}, pattern {pattern:#X}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_little_endian_frame_crc_would_miss_a_burst_of_28_bits() {
    let valid = &objects()[1].1;
    let mut little_endian = valid.clone();
    little_endian[56..].reverse();
    let intact = |bytes: &[u8]| bytes[56..] == crc::frame(&bytes[..56]).to_le_bytes();
    assert!(intact(&little_endian));

    let error = [0x03, 0x50, 0x89, 0xEF, 0xC0, 0x00];
    let damage = |bytes: &[u8]| {
        let mut damaged = bytes.to_vec();
        for (byte, error) in damaged[54..].iter_mut().zip(error) {
            *byte ^= error;
        }
        damaged
    };
    assert!(intact(&damage(&little_endian)), "unseen, were the field little-endian");
    assert_eq!(rejection("GPS1", &damage(valid)), Some(Rejection::Crc));
}

proptest! {
    #![proptest_config(seeded(4096))]

    #[test]
    fn a_burst_across_objects_is_rejected_in_each_object_it_touches(
        start in 0_usize..8 * 244 - 31,
        length in 1_usize..=32,
        pattern: u32,
    ) {
        let valid = seeds::profile::<3>(70);
        let damaged = flipped(valid.as_bytes(), burst(start, length, pattern));
        let reading = Profile::<3>::read(&damaged).expect("same length");
        for (index, place) in reference::places(3).into_iter().enumerate() {
            let touched = damaged[place.clone()] != valid.as_bytes()[place];
            let accepted = match index {
                0 => reading.reported.is_ok(),
                _ => reading.gps[index - 1].is_ok(),
            };
            prop_assert_eq!(accepted, !touched, "object {}", index);
        }
    }

    #[test]
    fn up_to_seven_bit_errors_anywhere_are_rejected(
        bits in prop::collection::btree_set(0_usize..8 * 64, 1..=7),
    ) {
        let (name, valid) = &objects()[0];
        prop_assert_eq!(rejection(name, &flipped(valid, bits)), Some(Rejection::Crc));
    }
}

/// The effect of each single wrong bit of a frame on the CRC register, the last bit first. The CRC does not detect a
/// set of wrong bits whose effects cancel each other.
fn syndromes(polynomial: u32, bits: usize) -> Vec<u32> {
    let mut syndrome = 1_u32;
    (0..bits)
        .map(|_| {
            let this = syndrome;
            syndrome = (syndrome << 1) ^ ((syndrome >> 31) * polynomial);
            this
        })
        .collect()
}

fn any_equal(mut sums: Vec<u32>) -> bool {
    sums.sort_unstable();
    sums.windows(2).any(|pair| pair[0] == pair[1])
}

// Shows OBJ-2.
#[test]
fn the_frame_crc_has_hamming_distance_8_over_the_longest_object() {
    // The generator polynomial has an even number of terms, its leading x³² included. So x + 1 divides it, and every
    // odd number of wrong bits is detected.
    assert_eq!((1 + crc::FRAME.poly.count_ones()) % 2, 0);
    // If no two different sets of three bits have the same sum, every error of 2, 4 or 6 bits is detected. The paper
    // states this distance for 56 bytes and their CRC; this test covers the 60 bytes of Reported-Position and their
    // CRC.
    let s = syndromes(crc::FRAME.poly, 8 * ReportedPosition::SIZE);
    let mut sums = Vec::new();
    for a in 0..s.len() {
        for b in 0..a {
            for c in 0..b {
                sums.push(s[a] ^ s[b] ^ s[c]);
            }
        }
    }
    assert!(!any_equal(sums));
}

// Shows OBJ-3.
#[test]
fn the_position_crc_has_hamming_distance_9_over_latitude_and_longitude() {
    // If no two different sets of up to four bits have the same sum, every error of up to 8 bits is detected.
    let s = syndromes(crc::POSITION.poly, 8 * 20);
    let mut sums = vec![0];
    for a in 0..s.len() {
        sums.push(s[a]);
        for b in 0..a {
            sums.push(s[a] ^ s[b]);
            for c in 0..b {
                sums.push(s[a] ^ s[b] ^ s[c]);
                for d in 0..c {
                    sums.push(s[a] ^ s[b] ^ s[c] ^ s[d]);
                }
            }
        }
    }
    assert!(!any_equal(sums));
}

#[test]
fn the_position_crc_rejects_a_position_changed_before_the_frame_crc() {
    let (name, valid) = &objects()[0];
    for bit in 8 * 8..8 * 28 {
        let mut changed = flipped(valid, [bit]);
        reference::repair_frame_crc(&mut changed);
        assert_eq!(rejection(name, &changed), Some(Rejection::PositionCrc), "bit {bit}");
    }
}

#[test]
fn one_pass_over_any_whole_object_ends_in_the_fixed_residue() {
    for timestamp in (0..1_000).step_by(10) {
        let profile = seeds::profile::<5>(timestamp);
        for place in reference::places(5) {
            let object = &profile.as_bytes()[place];
            assert_eq!(reference::register(reference::FRAME, object), 0x9D18_E2E0);
            assert_eq!(!crc::frame(object), crc::FRAME_RESIDUE);
        }
        let position = &profile.as_bytes()[8..28];
        assert_eq!(reference::register(reference::POSITION, position), 0x3C13_9B22);
        assert_eq!(!crc::position(position), crc::POSITION_RESIDUE);
    }
}

// Shows OBJ-6.
#[test]
fn a_valid_object_in_anothers_place_is_rejected() {
    let profile = seeds::profile::<5>(70);
    for (is, object) in profile.gps().iter().enumerate() {
        for (asked, expected) in Identifier::GPS.into_iter().enumerate() {
            let judged = GpsObject::verify(object.as_bytes(), expected);
            assert_eq!(judged.err(), (is != asked).then_some(Rejection::Identifier));
        }
    }
    let mut reported = profile.reported().as_bytes().to_vec();
    for other in [0x0000, 0x4400, 0x4801, 0x0048, 0xFFFF] {
        reported[4..6].copy_from_slice(&u16::to_le_bytes(other));
        reference::repair_frame_crc(&mut reported);
        assert_eq!(ReportedPosition::verify(&reported), Err(Rejection::Identifier));
    }
    let mut link = LinkStatus::seal(&seeds::link_values()).as_bytes().to_vec();
    link[4..6].copy_from_slice(&Identifier::REPORTED_POSITION.0.to_le_bytes());
    reference::repair_frame_crc(&mut link);
    assert_eq!(LinkStatus::verify(&link), Err(Rejection::Identifier));
}

// Shows OBJ-5.
#[test]
fn a_buffer_of_one_byte_repeated_never_verifies() {
    for byte in 0..=u8::MAX {
        let scrubbed = [byte; Image::<5>::LEN];
        let reading = Image::<5>::read(&scrubbed).expect("the right length");
        assert_eq!(reading.link, Err(Rejection::Crc));
        assert_eq!(reading.profile.reported, Err(Rejection::Crc));
        assert_eq!(reading.profile.gps, [Err(Rejection::Crc); 5]);
    }
}

#[test]
fn an_object_that_a_scrub_has_half_erased_never_verifies() {
    for (name, valid) in objects() {
        for scrub in [0x00, 0xFF] {
            for erased in 1..=valid.len() {
                let mut from_the_front = valid.clone();
                from_the_front[..erased].fill(scrub);
                assert_eq!(rejection(name, &from_the_front), Some(Rejection::Crc), "{name}, {erased}");
            }
        }
    }
}

#[test]
fn a_wrong_length_is_rejected_as_that() {
    for (name, valid) in objects() {
        for length in (0..2 * valid.len()).filter(|length| *length != valid.len()) {
            let mut bytes = valid.clone();
            bytes.resize(length, 0);
            assert_eq!(rejection(name, &bytes), Some(Rejection::Length), "{name}, {length}");
        }
    }
}

#[test]
fn a_line_of_ones_looks_intact_only_as_a_request_for_nothing() {
    // After the start value 0xFFFFFFFF, four bytes 0xFF make the register 0, and the final XOR makes the CRC
    // 0xFFFFFFFF.
    let intact: Vec<_> = (0..=512).filter(|length| crc::frame_intact(&vec![0xFF; *length])).collect();
    assert_eq!(intact, [8]);
    let zero: Vec<_> = (0..=512).filter(|length| crc::frame_intact(&vec![0; *length])).collect();
    assert_eq!(zero, [4], "the CRC of nothing is 0");
    for image_len in [156, 216, 276, 396, 65_535, 131_069] {
        assert_eq!(ssi::parse(&[0xFF; 8], image_len), Ok(ssi::Parsed::Nothing));
    }
}
