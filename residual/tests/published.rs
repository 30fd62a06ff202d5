//! Compares results with what others have published about these polynomials.
use std::num::NonZero;

use residual::codes::{CRC_32C, FRAME, IEEE_802_3, Named, OPC_UA_SAFETY, POLYNOMIALS, POSITION};
use residual::{Code, Polynomial, Words};

const TWO: NonZero<usize> = NonZero::new(2).unwrap();

fn least_weight(polynomial: Polynomial, codeword: usize, up_to: usize) -> Option<usize> {
    (1..=up_to).find(|weight| !Words::find(polynomial, codeword, *weight, TWO).starting_at_0().is_empty())
}

/// Checks that the Hamming distance is `distance` at `data` bits of data, and less with one bit more.
fn distance_ends_at(named: Named, distance: usize, data: usize) {
    assert_eq!(least_weight(named.polynomial, data + 32, distance - 1), None, "{} at {data} bits", named.name);
    let beyond = least_weight(named.polynomial, data + 33, distance - 1);
    assert!(beyond.is_some(), "{} at {} bits", named.name, data + 1);
}

#[test]
fn the_polynomials_keep_their_distance_up_to_koopmans_lengths() {
    // The source of both lengths is the list of the best 32-bit polynomials in users.ece.cmu.edu/~koopman/crc/: HD = 8
    // up to 992 bits, and HD = 9 up to 223.
    distance_ends_at(FRAME, 8, 992);
    distance_ends_at(POSITION, 9, 223);
}

#[test]
fn ieee_802_3_has_the_distances_koopman_lists() {
    // The source of the lengths is users.ece.cmu.edu/~koopman/crc/hdlen.html: {4294967263, 91607, 2974, 268, 171, 91,
    // 57, 34, 21, …} from HD = 3 on.
    for (distance, data) in [(5, 2974), (6, 268), (7, 171), (8, 91), (9, 57), (10, 34)] {
        distance_ends_at(IEEE_802_3, distance, data);
    }
}

#[test]
fn castagnolis_polynomials_have_the_distances_published() {
    // The sources are Castagnoli et al. 1993 and Koopman 2002: HD = 8 of CRC-32C up to 177 bits, of 0xFA567D89 up to
    // 274 bits.
    distance_ends_at(CRC_32C, 8, 177);
    distance_ends_at(OPC_UA_SAFETY, 8, 274);
}

#[test]
fn opc_ua_safetys_digits_are_normal_notation() {
    // Read in Koopman's notation, 0xF4ACFB13 is another polynomial, which does not have the published distance.
    let misread = Polynomial::from_koopman(32, 0xF4AC_FB13).unwrap();
    assert_eq!(OPC_UA_SAFETY.polynomial, Polynomial::from_normal(32, 0xF4AC_FB13).unwrap());
    assert_ne!(misread, OPC_UA_SAFETY.polynomial);
    assert!(least_weight(misread, 274 + 32, 7).is_some());
}

#[test]
fn each_polynomial_is_the_same_in_both_notations() {
    let normal = [0xF192_2815, 0x3AFF_2FAD, 0x04C1_1DB7, 0x1EDC_6F41, 0x8141_41AB, 0xF4AC_FB13];
    for (named, normal) in POLYNOMIALS.into_iter().zip(normal) {
        assert_eq!(Some(named.polynomial), Polynomial::from_normal(32, normal), "{}", named.name);
    }
}

#[test]
fn profile_computes_with_these_polynomials_and_not_with_their_koopman_digits() {
    for (named, algorithm, value) in
        [(FRAME, profile::crc::FRAME, 0x12D3_A0B1), (POSITION, profile::crc::POSITION, 0xEA87_07AB)]
    {
        assert_eq!(named.polynomial.normal(), algorithm.poly);
        let digits = Box::leak(Box::new(crc::Algorithm { poly: named.polynomial.koopman(), ..algorithm }));
        assert_ne!(crc::Crc::<u32>::new(digits).checksum(b"123456789"), value, "{}", named.name);
        assert_eq!(crc::Crc::<u32>::new(Box::leak(Box::new(algorithm))).checksum(b"123456789"), value);
    }
}

#[test]
fn koopman_digits_taken_for_normal_ones_lose_the_distance() {
    // In Koopman's notation both polynomials end in an even digit. Read in the usual notation, they are divisible by x
    // and leave the last bit of an object unprotected.
    for named in [FRAME, POSITION] {
        assert_eq!(Polynomial::from_normal(32, named.polynomial.koopman()), None, "{}", named.name);
        let algorithm = Box::leak(Box::new(crc::Algorithm {
            width: 32,
            poly: named.polynomial.koopman(),
            init: 0xFFFF_FFFF,
            refin: false,
            refout: false,
            xorout: 0xFFFF_FFFF,
            check: 0,
            residue: 0,
        }));
        let misused = crc::Crc::<u32>::new(algorithm);
        // The lowest check bit depends only on the last data bits, so only 31 check bits protect the rest.
        let lowest: Vec<u32> = (0..=255_u8).map(|byte| misused.checksum(&[0x48, byte, 0x17, 0x99, 0x03]) & 1).collect();
        assert!(lowest.iter().all(|bit| *bit == lowest[0]), "{}: the lowest check bit checks nothing", named.name);
    }
}

#[test]
fn words_found_one_by_one_are_as_many_as_the_dual_says() {
    for code in Code::all() {
        let weights = code.weights().unwrap();
        let up_to = if code.bits <= 160 { 8 } else { 6 };
        for weight in 1..=up_to {
            let found = Words::find(code.named.polynomial, code.bits, weight, TWO).count();
            assert_eq!(
                weights.counts()[weight],
                found.into(),
                "{} at {} bits, weight {weight}",
                code.named.name,
                code.bits
            );
        }
    }
}

#[test]
fn position_codewords_of_weight_nine_are_as_many_as_the_dual_says() {
    let weights = Code { named: POSITION, bits: 160 }.weights().unwrap();
    assert_eq!(weights.hamming_distance(), 9);
    assert_eq!(weights.counts()[9], residual::wire::position_words(TWO).count().into());
}
