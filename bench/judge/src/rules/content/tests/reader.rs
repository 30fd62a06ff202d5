use gnss_sim::ubx::{CLASS_NAV, SYNC, frame};

use super::super::ubx::Message;
use super::*;

fn read(pieces: &[(u64, &[u8], bool)]) -> Vec<(u64, u64, bool)> {
    let mut reader = Reader::default();
    let mut found = vec![];
    for (at, bytes, clean) in pieces {
        reader.feed(*at, 10, bytes, *clean, |message| found.push(message));
    }
    found.into_iter().map(|Message { begun, arrived, sure, .. }| (begun, arrived, sure)).collect()
}

fn message(bytes: usize) -> Vec<u8> {
    frame(CLASS_NAV, 0x35, &vec![7; bytes - 8])
}

#[test]
fn messages_are_found_with_their_instants() {
    let two = [message(20), message(30)].concat();
    assert_eq!(read(&[(1_000, &two, true)]), [(1_000, 1_200, true), (1_200, 1_500, true)]);
}

#[test]
fn a_message_in_pieces_is_found_when_it_is_whole() {
    let whole = message(20);
    for cut in 1..20 {
        let (head, tail) = whole.split_at(cut);
        let arrived = 5_000 + 10 * tail.len() as u64;
        assert_eq!(read(&[(1_000, head, true), (5_000, tail, true)]), [(1_000, arrived, true)], "{cut}");
    }
    let pieces: Vec<(u64, &[u8], bool)> = (0..).zip(whole.chunks(1)).map(|(n, byte)| (n * 1_000, byte, true)).collect();
    assert_eq!(read(&pieces), [(0, 19_010, true)]);
}

#[test]
fn what_is_no_message_is_passed_over() {
    let around = [b"$GNGGA,1*00\r\n".as_slice(), &message(20), &SYNC[..1], b"x", &message(20)].concat();
    assert_eq!(read(&[(0, &around, true)]), [(130, 330, true), (350, 550, true)]);
}

#[test]
fn zeros_behind_a_sync_are_no_message() {
    let zeros = [&SYNC[..], &[0; 8]].concat();
    assert_eq!(read(&[(0, &zeros, true), (1_000, &message(20), true)]), [(1_000, 1_200, true)]);
}

#[test]
fn a_wrong_checksum_makes_the_messages_claimed_length_doubtful() {
    let mut wrong = message(20);
    wrong[19] ^= 1;
    let bytes = [wrong.clone(), message(20)].concat();
    assert_eq!(read(&[(0, &bytes, true)]), [(200, 400, true)], "its own");
    // The length field of this message is damaged: it says 60 bytes in place of 20.
    wrong[4] += 40;
    let bytes = [wrong, message(20), message(20), message(20)].concat();
    assert_eq!(read(&[(0, &bytes, true)]), [(200, 400, false), (400, 600, false), (600, 800, true)]);
}

#[test]
fn a_false_start_longer_than_any_message_makes_a_buffer_doubtful() {
    let mut bytes = [SYNC[0], SYNC[1], 1, 7, 0xFF, 0xFF].to_vec();
    bytes.extend(message(20));
    bytes.resize(236, 0);
    bytes.extend(message(20));
    bytes.extend(message(20));
    assert_eq!(read(&[(0, &bytes, true)]), [(60, 260, false), (2_360, 2_560, false), (2_560, 2_760, true)]);
    assert_eq!(read(&[(0, &message(256), true)]), [(0, 2_560, true)], "the longest that is taken");
    assert_eq!(read(&[(0, &message(257), true)]), []);
}

#[test]
fn a_doubt_lasts_over_pieces() {
    let mut wrong = message(20);
    wrong[4] += 40;
    let pieces: [(u64, &[u8], bool); 4] =
        [(0, &wrong, true), (1_000, &message(20), true), (2_000, &message(20), true), (3_000, &message(20), true)];
    assert_eq!(read(&pieces), [(1_000, 1_200, false), (2_000, 2_200, false), (3_000, 3_200, true)]);
}

#[test]
fn messages_inside_an_unfinished_one_are_found_immediately_and_once() {
    let mut open = message(20);
    open[4] += 200;
    let bytes = [open, message(20)].concat();
    assert_eq!(read(&[(0, &bytes, true), (1_000, b"x", true), (2_000, b"x", true)]), [(200, 400, false)]);
}

#[test]
fn a_disturbed_line_makes_its_messages_and_the_next_buffer_doubtful() {
    let whole = message(20);
    let (head, tail) = whole.split_at(10);
    assert_eq!(read(&[(0, &whole, false)]), [(0, 200, false)]);
    assert_eq!(read(&[(0, head, false), (100, tail, true)]), [(0, 200, false)]);
    assert_eq!(read(&[(0, head, true), (100, tail, false)]), [(0, 200, false)]);
    let long = [vec![0; 255], message(20), message(20)].concat();
    assert_eq!(read(&[(0, b"x", false), (10, &long, true)]), [(2_560, 2_760, false), (2_760, 2_960, true)]);
    let long = [vec![0; 256], message(20)].concat();
    assert_eq!(read(&[(0, b"x", false), (10, &long, true)]), [(2_570, 2_770, true)]);
}

#[test]
fn silence_may_end_and_then_ends_what_was_begun() {
    let whole = message(20);
    let (head, tail) = whole.split_at(10);
    let split = |silence: u64| read(&[(0, head, true), (100 + silence, tail, true)]);
    let arrived = |silence: u64| 200 + silence;
    assert_eq!(split(bounds::SILENCE_MAY_END), [(0, arrived(bounds::SILENCE_MAY_END), true)]);
    assert_eq!(split(bounds::SILENCE_MAY_END + 1), [(0, arrived(bounds::SILENCE_MAY_END + 1), false)]);
    assert_eq!(split(bounds::SILENCE_ENDS), [(0, arrived(bounds::SILENCE_ENDS), false)]);
    assert_eq!(split(bounds::SILENCE_ENDS + 1), []);
    let after = |silence: u64| read(&[(0, b"x", false), (10 + silence, &whole, true)])[0].2;
    assert!(!after(bounds::SILENCE_ENDS));
    assert!(after(bounds::SILENCE_ENDS + 1));
}
