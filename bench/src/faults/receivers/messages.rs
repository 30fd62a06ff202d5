//! Changes to the contents of UBX messages.

use gnss_sim::ubx::{self, EsfIns, Frame, NavAtt, NavPvt};

/// A hundred metres in latitude, in 10⁻⁷ degrees: a degree is about 111.2 km.
const LATITUDE_1E7_PER_100_M: i64 = 8_993;
/// A hundred metres in longitude at 47.5 degrees of latitude, where the simulated flights are, in 10⁻⁷ degrees.
const LONGITUDE_1E7_PER_100_M: i64 = 13_310;

/// The offset of the longitude in a NAV-PVT message (receiver description, UBX-13003221).
pub(super) const LONGITUDE: usize = 24;
pub(super) const LATITUDE: usize = 28;
pub(super) const HEIGHT: usize = 32;
pub(super) const ACCURACIES: [usize; 2] = [40, 44];
pub(super) const VELOCITY_NORTH: usize = 48;

pub(super) fn last_itow(bytes: &[u8]) -> Option<u32> {
    let mut last = None;
    each_message(bytes, |class, id, payload| last = Frame { class, id, payload }.itow_ms().or(last));
    last
}

/// Returns `bytes` with the changes of `change`, which is called for each whole UBX message in them.
pub(super) fn each_message(bytes: &[u8], mut change: impl FnMut(u8, u8, &mut Vec<u8>)) -> Vec<u8> {
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

fn itow_at(class: u8, id: u8, payload: &[u8]) -> Option<usize> {
    if (class, id) == (ubx::CLASS_ESF, EsfIns::ID) {
        return Some(8);
    }
    let itow = Frame { class, id, payload }.itow_ms()?.to_le_bytes();
    // The time of week is the first field of a message, or the second after a four-byte version.
    [0, 4].into_iter().find(|&at| payload.get(at..at + 4) == Some(&itow))
}

pub(super) fn set_itow(class: u8, id: u8, payload: &mut [u8], itow_ms: u32) {
    if let Some(field) = itow_at(class, id, payload).and_then(|at| payload.get_mut(at..at + 4)) {
        field.copy_from_slice(&itow_ms.to_le_bytes());
    }
}

/// Removes the fix from a NAV-PVT message. If the receiver has just `started`, the time is removed too (UBX-13003221).
pub(super) fn without_fix(class: u8, id: u8, payload: &mut [u8], started: bool) {
    if (class, id) != (ubx::CLASS_NAV, NavPvt::ID) || payload.len() < NavPvt::PAYLOAD {
        return;
    }
    if started {
        payload[11] = 0;
    }
    // The fields to clear are fixType, flags, numSV and flags3.
    payload[20] = 0;
    payload[21] &= !NavPvt::FLAG_FIX_OK;
    payload[23] = 0;
    payload[78] |= NavPvt::FLAG3_INVALID_LLH;
}

/// Changes the 3D fix of a NAV-PVT message to a 2D fix. The height stays in the message, and HORUS must ignore it.
pub(super) fn flattened(class: u8, id: u8, payload: &mut [u8]) {
    const FIX_TYPE: usize = 20;
    if is_position(class, id, payload) && payload[FIX_TYPE] >= 3 {
        payload[FIX_TYPE] = 2;
    }
}

pub(super) fn turned(class: u8, id: u8, payload: &mut [u8], degrees: u16) {
    const HEADING: usize = 16;
    const TURN_1E5: i32 = 36_000_000;
    if (class, id) == (ubx::CLASS_NAV, NavAtt::ID) && payload.len() >= NavAtt::PAYLOAD {
        let heading = signed(payload, HEADING).rem_euclid(TURN_1E5) + i32::from(degrees) * 100_000;
        set(payload, HEADING, (heading % TURN_1E5).cast_unsigned());
    }
}

pub(super) fn pushed(class: u8, id: u8, payload: &mut [u8], by: i32) {
    const FRONT: usize = 24;
    if (class, id) == (ubx::CLASS_ESF, EsfIns::ID) && payload.len() >= EsfIns::PAYLOAD {
        let front = signed(payload, FRONT).saturating_add(by);
        set(payload, FRONT, front.cast_unsigned());
    }
}

fn is_position(class: u8, id: u8, payload: &[u8]) -> bool {
    (class, id) == (ubx::CLASS_NAV, NavPvt::ID) && payload.len() >= NavPvt::PAYLOAD
}

pub(super) fn move_by(class: u8, id: u8, payload: &mut [u8], [north, east, up]: [i64; 3]) {
    const POLE_1E7: i64 = 900_000_000;
    if !is_position(class, id, payload) {
        return;
    }
    let mut add = |at: usize, by: i64, limit: i64| {
        let moved = (i64::from(signed(payload, at)) + by).clamp(-limit, limit);
        set(payload, at, i32::try_from(moved).unwrap_or(i32::MAX).cast_unsigned());
    };
    add(LATITUDE, north * LATITUDE_1E7_PER_100_M / 100_000, POLE_1E7);
    add(LONGITUDE, east * LONGITUDE_1E7_PER_100_M / 100_000, 2 * POLE_1E7);
    add(HEIGHT, up, i32::MAX.into());
}

/// Returns longitude and latitude (10⁻⁷ degrees) and height (mm) of the last NAV-PVT message in `bytes`.
pub(super) fn last_position(bytes: &[u8]) -> Option<[i32; 3]> {
    let mut last = None;
    each_message(bytes, |class, id, payload| {
        if is_position(class, id, payload) {
            last = Some([LONGITUDE, LATITUDE, HEIGHT].map(|at| signed(payload, at)));
        }
    });
    last
}

pub(super) fn set_fields(class: u8, id: u8, payload: &mut [u8], fields: &[(usize, u32)]) {
    if is_position(class, id, payload) {
        fields.iter().for_each(|(at, value)| set(payload, *at, *value));
    }
}

fn signed(payload: &[u8], at: usize) -> i32 {
    i32::from_le_bytes([payload[at], payload[at + 1], payload[at + 2], payload[at + 3]])
}

fn set(payload: &mut [u8], at: usize, value: u32) {
    payload[at..at + 4].copy_from_slice(&value.to_le_bytes());
}
