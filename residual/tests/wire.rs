//! Tests the theory on objects that `profile` seals and judges: detectable errors are detected, and undetectable ones
//! are not. `report.rs` injects all patterns of a kind.
use std::num::NonZero;

use profile::{GpsObject, GpsValues, Identifier, LinkStatus, Rejection, ReportedPosition, ReportedValues};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed};
use residual::codes::{FRAME, GPS_BITS, POSITION};
use residual::joint::Nesting;
use residual::wire::{self, Injected, Object};

const TWO: NonZero<usize> = NonZero::new(2).unwrap();

fn none_pass(injected: Injected, tried: u64) {
    assert_eq!(injected, Injected { tried, accepted: 0, identifier: 0 });
}

#[test]
fn sealed_objects_are_accepted_as_they_are() {
    for object in Object::ALL {
        assert_eq!(object.rejection(&object.sealed()), None, "{}", object.name());
    }
}

#[test]
fn all_bursts_of_up_to_32_bits_are_rejected() {
    for object in Object::ALL {
        none_pass(wire::sample_bursts(object, 17..=32, 20_000, TWO), 16 * 20_000);
        let polynomial = wire::polynomial_word(FRAME.polynomial);
        assert_eq!(polynomial.last(), Some(&32), "33 bits");
        assert_eq!(
            wire::inject_words(object, [polynomial.as_slice()]),
            Injected { tried: 1, accepted: 1, identifier: 0 }
        );
    }
}

#[test]
fn in_a_gps_object_a_codeword_passes_unless_it_touches_the_identifier() {
    let words = wire::random_codewords(FRAME.polynomial, GPS_BITS, 8, 500);
    let changed = words.iter().filter(|word| wire::touches(word, GPS_BITS, 4..6)).count() as u64;
    let injected = wire::inject_words(Object::Gps, words.iter().map(Vec::as_slice));
    assert_eq!(injected, Injected { tried: 500, accepted: 500 - changed, identifier: changed });
    assert!((1..250).contains(&changed));
}

#[test]
fn in_reported_position_a_codeword_passes_only_if_it_spares_the_position() {
    let object = Object::ReportedPosition;
    let words = wire::random_codewords(FRAME.polynomial, object.bits(), 8, 500);
    let sealed = object.sealed();
    for word in &words {
        let mut bytes = sealed.clone();
        for place in word {
            let bit = object.bits() - 1 - usize::from(*place);
            bytes[bit / 8] ^= 0x80 >> (bit % 8);
        }
        let expected = if wire::touches(word, object.bits(), 8..28) {
            Some(Rejection::PositionCrc)
        } else {
            wire::touches(word, object.bits(), 4..6).then_some(Rejection::Identifier)
        };
        assert_eq!(object.rejection(&bytes), expected, "{word:?}");
    }
}

#[test]
fn position_codewords_are_caught_by_the_frame_crc() {
    let words: Vec<Vec<u16>> = wire::position_words(TWO)
        .everywhere()
        .map(|word| word.iter().map(|place| place + Nesting::REPORTED_POSITION.bits_after as u16).collect())
        .collect();
    none_pass(wire::inject_words(Object::ReportedPosition, words.iter().map(Vec::as_slice)), words.len() as u64);
    // The injected words are codewords of the position code, so the position CRC alone does not detect them.
    let sealed = Object::ReportedPosition.sealed();
    assert!(profile::crc::position_intact(&sealed[8..28]));
    for word in &words {
        let mut bytes = sealed.clone();
        for place in word {
            let bit = 511 - usize::from(*place);
            bytes[bit / 8] ^= 0x80 >> (bit % 8);
        }
        assert_ne!(bytes[8..24], sealed[8..24]);
        assert!(profile::crc::position_intact(&bytes[8..28]));
    }
    assert_eq!(POSITION.polynomial.common_degree(FRAME.polynomial), 0, "a burst both miss has 65 bits at least");
}

#[test]
fn scrubbed_and_inverted_objects_never_verify() {
    for byte in [0x00, 0xFF] {
        assert_eq!(ReportedPosition::verify(&[byte; ReportedPosition::SIZE]), Err(Rejection::Crc));
        assert_eq!(LinkStatus::verify(&[byte; LinkStatus::SIZE]), Err(Rejection::Crc));
        for receiver in 1..=profile::MAX_RECEIVERS {
            assert_eq!(GpsObject::verify(&[byte; GpsObject::SIZE], Identifier::gps(receiver)), Err(Rejection::Crc));
        }
        for object in Object::ALL {
            // At least one byte is scrubbed, from the front or from the end on. The object must not verify then, unless
            // the scrub left it unchanged.
            let sealed = object.sealed();
            for cut in 1..sealed.len() {
                let (mut front, mut back) = (sealed.clone(), sealed.clone());
                front[..cut].fill(byte);
                back[cut..].fill(byte);
                assert!(
                    front == sealed || object.rejection(&front).is_some(),
                    "{}, {cut} bytes of {byte:#04X}",
                    object.name()
                );
                assert!(
                    back == sealed || object.rejection(&back).is_some(),
                    "{}, {byte:#04X} from {cut}",
                    object.name()
                );
            }
        }
    }
    for object in Object::ALL {
        let inverted: Vec<u8> = object.sealed().iter().map(|byte| !byte).collect();
        assert_eq!(object.rejection(&inverted), Some(Rejection::Crc), "{}", object.name());
    }
}

proptest! {
    #![proptest_config(Config {
        cases: 2_000,
        rng_seed: RngSeed::Fixed(3),
        failure_persistence: None,
        ..Config::default()
    })]

    #[test]
    fn an_object_in_anothers_place_never_verifies_as_that_one(
        timestamp: u32, latitude: f64, longitude: f64, bytes in prop::collection::vec(any::<u8>(), 64),
    ) {
        let reported = ReportedValues { latitude, longitude, ..ReportedValues::absent(timestamp) };
        let reported = ReportedPosition::seal(&reported);
        let values = GpsValues { latitude, longitude, ..GpsValues::absent(timestamp) };
        let gps: Vec<GpsObject> = (1..=profile::MAX_RECEIVERS)
            .map(|receiver| GpsObject::seal(Identifier::gps(receiver), &values))
            .collect();
        for (i, sealed) in gps.iter().enumerate() {
            for place in 1..=profile::MAX_RECEIVERS {
                let verified = GpsObject::verify(sealed.as_bytes(), Identifier::gps(place));
                prop_assert_eq!(verified, if place == i + 1 { Ok(sealed) } else { Err(Rejection::Identifier) });
            }
            // A GPS object with four more bytes is taken for Reported-Position, and Reported-Position with four bytes
            // fewer for a GPS object.
            let mut longer = bytes.clone();
            longer[..GpsObject::SIZE].copy_from_slice(sealed.as_bytes());
            prop_assert!(ReportedPosition::verify(&longer).is_err());
            for cut in 0..=4 {
                let part = &reported.as_bytes()[cut..cut + GpsObject::SIZE];
                prop_assert!(GpsObject::verify(part, Identifier::gps(i + 1)).is_err());
            }
        }
        prop_assert!(LinkStatus::verify(&reported.as_bytes()[..LinkStatus::SIZE]).is_err());
        prop_assert!(LinkStatus::verify(&gps[0].as_bytes()[GpsObject::SIZE - LinkStatus::SIZE..]).is_err());
    }
}
