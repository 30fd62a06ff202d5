//! UBX messages with other contents.

use gnss_sim::ubx::{self, EsfIns, Frame, NavPvt};

/// A degree of latitude is about 111.2 km: so many 10⁻⁷ degrees are a hundred metres.
const LATITUDE_1E7_PER_100_M: i64 = 8_993;

/// The time of week of the last message that has one, ms.
pub(super) fn last_itow(bytes: &[u8]) -> Option<u32> {
    let mut last = None;
    each_message(bytes, |class, id, payload| last = Frame { class, id, payload }.itow_ms().or(last));
    last
}

/// `bytes` with `change` made to the payload of every whole UBX message (class, identifier, payload).
pub(super) fn each_message(bytes: &[u8], mut change: impl FnMut(u8, u8, &mut [u8])) -> Vec<u8> {
    let mut changed = Vec::with_capacity(bytes.len());
    let mut rest = bytes;
    while let Some((&first, after)) = rest.split_first() {
        let Some(frame) = Frame::at_start_of(rest) else {
            changed.push(first);
            rest = after;
            continue;
        };
        let mut payload = frame.payload.to_vec();
        change(frame.class, frame.id, &mut payload);
        changed.extend(ubx::frame(frame.class, frame.id, &payload));
        rest = &rest[frame.wire_len()..];
    }
    changed
}

/// `bytes` with the second checksum byte of every whole UBX message inverted.
pub(super) fn with_bad_checksums(bytes: &[u8]) -> Vec<u8> {
    let mut changed = bytes.to_vec();
    let mut at = 0;
    while at < bytes.len() {
        at += match Frame::at_start_of(&bytes[at..]) {
            Some(frame) => {
                let length = frame.wire_len();
                changed[at + length - 1] ^= 0xFF;
                length
            }
            None => 1,
        };
    }
    changed
}

/// Where a message has its time of week.
fn itow_at(class: u8, id: u8, payload: &[u8]) -> Option<usize> {
    if (class, id) == (ubx::CLASS_ESF, EsfIns::ID) {
        return Some(8);
    }
    let itow = Frame { class, id, payload }.itow_ms()?.to_le_bytes();
    // First of all, or after a version.
    [0, 4].into_iter().find(|&at| payload.get(at..at + 4) == Some(&itow))
}

pub(super) fn set_itow(class: u8, id: u8, payload: &mut [u8], itow_ms: u32) {
    if let Some(field) = itow_at(class, id, payload).and_then(|at| payload.get_mut(at..at + 4)) {
        field.copy_from_slice(&itow_ms.to_le_bytes());
    }
}

/// A NAV-PVT message says that there is no fix, and, where the receiver has just started, no time. Offsets: UBX-NAV-PVT
/// in the receiver description (UBX-13003221).
pub(super) fn without_fix(class: u8, id: u8, payload: &mut [u8], started: bool) {
    if (class, id) != (ubx::CLASS_NAV, NavPvt::ID) || payload.len() < NavPvt::PAYLOAD {
        return;
    }
    if started {
        payload[11] = 0;
    }
    // fixType, flags, numSV, flags3.
    payload[20] = 0;
    payload[21] &= !NavPvt::FLAG_FIX_OK;
    payload[23] = 0;
    payload[78] |= NavPvt::FLAG3_INVALID_LLH;
}

/// A NAV-PVT message has its latitude so far too far north.
pub(super) fn move_north(class: u8, id: u8, payload: &mut [u8], metres: u32) {
    const LATITUDE: std::ops::Range<usize> = 28..32;
    const POLE_1E7: i64 = 900_000_000;
    if (class, id) != (ubx::CLASS_NAV, NavPvt::ID) {
        return;
    }
    let Some(field) = payload.get_mut(LATITUDE) else { return };
    let latitude = i64::from(i32::from_le_bytes([field[0], field[1], field[2], field[3]]));
    let moved = (latitude + i64::from(metres) * LATITUDE_1E7_PER_100_M / 100).clamp(-POLE_1E7, POLE_1E7);
    field.copy_from_slice(&i32::try_from(moved).unwrap_or(i32::MAX).to_le_bytes());
}
