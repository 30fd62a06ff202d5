//! A recording in which a receiver answers its configuration, and then sends each UBX message that HORUS's parser, the
//! crate `ublox`, knows.
//!
//! The parser checks messages that HORUS never asks for, before HORUS drops them. A receiver that is misconfigured or
//! broken can send any of them.

use gnss_sim::ubx::{NavPvt, frame};

/// Classes and identifiers of the messages.
const MESSAGES: [(u8, &[u8]); 15] = [
    (
        0x01,
        &[
            0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07, 0x09, 0x10, 0x11, 0x12, 0x13, 0x14, 0x20, 0x21, 0x22, 0x26, 0x30,
            0x35, 0x36, 0x3B, 0x3C, 0x43, 0x61, 0x62,
        ],
    ),
    (0x02, &[0x13, 0x14, 0x15, 0x32, 0x34, 0x41]),
    (0x04, &[0, 1, 2, 3, 4]),
    (0x05, &[0, 1]),
    (0x06, &[0x00, 0x01, 0x08, 0x13, 0x1E, 0x23, 0x24, 0x31, 0x39, 0x3D, 0x3E, 0x56, 0x62, 0x71, 0x82, 0x8A, 0x8B]),
    (0x0A, &[0x02, 0x04, 0x06, 0x07, 0x08, 0x09, 0x0B, 0x21, 0x27, 0x28, 0x31, 0x36, 0x37, 0x38]),
    (0x0B, &[0x01, 0x02, 0x32]),
    (0x0D, &[0x01, 0x03, 0x04, 0x12]),
    (0x10, &[0x02, 0x03, 0x10, 0x14, 0x15]),
    (0x13, &[0x00, 0x02, 0x03, 0x06, 0x60]),
    (0x21, &[0x04, 0x0D]),
    (0x27, &[0x03, 0x09, 0x10]),
    (0x28, &[0x00, 0x01, 0x02]),
    (0x09, &[0x14]),
    // No receiver has this class.
    (0x77, &[0x00]),
];

/// The lengths in which each message comes, bytes: those that the messages have, and one byte less or more of some.
const LENGTHS: [usize; 36] = [
    0, 1, 2, 4, 8, 9, 10, 12, 16, 17, 18, 20, 24, 28, 32, 36, 40, 44, 48, 52, 56, 60, 64, 68, 70, 72, 76, 80, 84, 88,
    92, 100, 120, 130, 160, 220,
];

/// The payload: words that end with a zero, as a receiver's version has. A time of week that begins with it never
/// changes, so all messages belong to one epoch.
const PAYLOAD: [u8; 4] = *b"a b\0";

/// Returns the recording.
pub(super) fn recording() -> Vec<u8> {
    // Without a valid position nothing counts as a recording.
    let itow_ms = u32::from_le_bytes(PAYLOAD);
    let mut bytes = answers(itow_ms - 1_000);
    bytes.extend(NavPvt { itow_ms, fix_type: 3, flags: NavPvt::FLAG_FIX_OK, ..NavPvt::default() }.encode());
    for (class, ids) in MESSAGES {
        for id in ids {
            for len in LENGTHS {
                let payload: Vec<u8> = PAYLOAD.into_iter().cycle().take(len).collect();
                bytes.extend(frame(class, *id, &payload));
            }
        }
    }
    bytes
}

/// Epochs with answers to HORUS's four configuration messages, each as its time after the epoch before, ms, and the
/// identifier of its message of class ACK: first the model is refused, then everything; then the second and the third
/// message get no answer. In between the receiver is silent until HORUS configures it again.
const ANSWERS: [(u32, Option<u8>); 11] = {
    const ACK: Option<u8> = Some(1);
    const NAK: Option<u8> = Some(0);
    [
        (0, ACK),
        (100, NAK),
        (100, ACK),
        (100, ACK),
        (700, NAK),
        (100, NAK),
        (100, NAK),
        (100, NAK),
        (1_700, ACK),
        (4_000, None),
        (2_500, ACK),
    ]
};

/// The epochs of [`ANSWERS`], the last of which is at the time of week `last_ms`.
fn answers(last_ms: u32) -> Vec<u8> {
    let mut bytes = vec![];
    let mut itow_ms = last_ms - ANSWERS.iter().map(|(after, _)| after).sum::<u32>();
    for (after, answer) in ANSWERS {
        itow_ms += after;
        bytes.extend(NavPvt { itow_ms, ..NavPvt::default() }.encode());
        // The answer names UBX-CFG-VALSET.
        bytes.extend(answer.map(|id| frame(0x05, id, &[0x06, 0x8A])).unwrap_or_default());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use gnss_sim::log::Log;

    use super::*;

    #[test]
    fn the_recording_is_played_and_has_every_message() {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(&recording()).unwrap();
        let counts = Log::open(file.path()).unwrap().counts();
        let messages: usize = MESSAGES.iter().map(|(_, ids)| ids.len() * LENGTHS.len()).sum();
        let answers = ANSWERS.iter().map(|(_, answer)| 1 + usize::from(answer.is_some())).sum::<usize>();
        assert_eq!((counts.ubx, counts.unknown_bytes), (messages + answers + 1, 0));
    }
}
