//! Recordings in which receivers state all kinds of values, in many combinations: what is absent, what is implausible,
//! and positions at the poles, at 180 degrees and at the end of the week.
//!
//! A flight that the bench generates has none of these. The parser and the voter see them from real receivers.

use bench::faults::Rng;
use gnss_sim::ubx::{CLASS_ESF, EsfIns, NavAtt, NavPvt, WEEK_MS, frame};

/// Latitude and longitude of each part of a recording, 1e-7 degrees. A metre west of the last place is beyond 180
/// degrees.
const PLACES: [[i32; 2]; 7] = [
    [475_000_000, 85_000_000],
    [0, 1_799_999_900],
    [-300_000_000, -1_799_999_900],
    [899_999_900, 100_000_000],
    [-899_999_300, -1_000_000_000],
    [475_000_000, 85_000_000],
    [0, -1_799_999_970],
];

/// From this longitude on a receiver may state the other side of 180 degrees, 1e-7 degrees.
const DATE_LINE: i32 = 1_799_000_000;

/// The number of epochs at each place, half of them before the end of the week, and the time between two.
const EPOCHS: u32 = 24;
const EPOCH_MS: u32 = 50;

/// The length of an epoch, bytes, of which a read over I2C leaves one byte (`horus_tx_fw::ddc::MOST`).
const ONE_LEFT: usize = 257;

/// The time of week at the first place, and that at the second: when it is sent, HORUS's clock shows about as much, so
/// that a message can seem to have been sent after it has arrived. At the other places the week ends.
const MIDDLE_OF_WEEK_MS: u32 = 300_000_000;
const ON_HORUS_CLOCK_MS: u32 = 2_110;

/// The duration of the recordings, ns. A time of week that goes back begins an epoch after a pause of a second.
pub(super) const DURATION_NS: u64 = PLACES.len() as u64 * (EPOCHS as u64 * EPOCH_MS as u64 + 1_000) * 1_000_000;

/// Returns the recording of each of `receivers`.
pub(super) fn recordings(receivers: usize, seed: u64) -> Vec<Vec<u8>> {
    (0..receivers as u64).map(|receiver| recording(&mut Rng::stream(seed, receiver))).collect()
}

fn recording(rng: &mut Rng) -> Vec<u8> {
    let mut bytes = vec![];
    let starts = [MIDDLE_OF_WEEK_MS, ON_HORUS_CLOCK_MS + rng.below(120) as u32].into_iter();
    let starts = starts.chain(std::iter::repeat(WEEK_MS - EPOCHS / 2 * EPOCH_MS));
    for ([latitude, longitude], start) in PLACES.into_iter().zip(starts) {
        for nth in 0..EPOCHS {
            let itow_ms = (start + nth * EPOCH_MS) % WEEK_MS;
            let begins = bytes.len();
            if nth == 0 || !rng.one_in(6) {
                // All receivers move by as much as they can disagree, so that results are held back and are not.
                let moved = (nth / 2 * 97 % 7) as i32;
                bytes.extend(position(rng, itow_ms, [latitude - 150 * moved, longitude], 2_300 * moved));
            }
            // At the poles these come half as often, which HORUS learns.
            let comes = latitude.abs() < 800_000_000 || nth % 2 == 0;
            if comes && !rng.one_in(8) {
                bytes.extend(attitude(rng, itow_ms));
            }
            if comes && !rng.one_in(8) {
                bytes.extend(acceleration(rng, itow_ms));
            }
            if rng.one_in(8) {
                // Zeros after a sync, as from a line that falls low, and answers that HORUS has not asked for.
                bytes.extend(frame(0, 0, &[]));
                let of = [[0x06, 0x01], [0x01, 0x8A]][rng.below(2) as usize];
                bytes.extend(frame(0x05, rng.below(2) as u8, &of));
            }
            if rng.one_in(4) {
                // Beginnings of messages and the filler of SPI, in all combinations.
                let noise = [0xFF, 0xFF, 0xB5, 0x62, 0x00];
                let count = (begins + ONE_LEFT).saturating_sub(bytes.len());
                bytes.extend((0..count).map(|_| noise[rng.below(noise.len() as u64) as usize]));
            }
        }
    }
    bytes
}

/// One in eight values is the greatest or the least that the field can have, the others lie within `within` of 0.
fn value(rng: &mut Rng, within: u64) -> i32 {
    match rng.below(16) {
        0 => i32::MAX,
        1 => i32::MIN,
        _ => near(rng, within),
    }
}

/// A value within `within` of 0.
fn near(rng: &mut Rng, within: u64) -> i32 {
    rng.below(2 * within + 1) as i32 - within as i32
}

fn position(rng: &mut Rng, itow_ms: u32, [latitude, longitude]: [i32; 2], height: i32) -> Vec<u8> {
    let accuracy = |rng: &mut Rng| if rng.one_in(12) { 20_000 << rng.below(3) } else { 500 + rng.below(1_500) as u32 };
    NavPvt {
        itow_ms,
        fix_type: [3, 3, 3, 3, 3, 3, 3, 3, 2, 2, 4, 4, 0, 1, 5, 6][rng.below(16) as usize],
        flags: if rng.one_in(12) { 0 } else { NavPvt::FLAG_FIX_OK },
        latitude_1e7: latitude + near(rng, 20),
        longitude_1e7: if longitude.abs() > DATE_LINE && rng.one_in(2) { -longitude } else { longitude }
            + near(rng, 20),
        height_mm: 500_000 + height + near(rng, 1_000) + if rng.one_in(10) { 80_000 } else { 0 },
        flags3: if rng.one_in(12) { NavPvt::FLAG3_INVALID_LLH } else { 0 },
        horizontal_accuracy_mm: accuracy(rng),
        vertical_accuracy_mm: accuracy(rng),
        velocity_mm_s: [0; 3].map(|_: i32| if rng.one_in(40) { value(rng, 0) } else { near(rng, 60_000) }),
        ..NavPvt::default()
    }
    .encode()
}

fn attitude(rng: &mut Rng, itow_ms: u32) -> Vec<u8> {
    let [roll_1e5, pitch_1e5, heading_1e5] = [100_000; 3].map(|within| value(rng, within));
    let accuracy_1e5 = [0; 3].map(|_: u32| if rng.one_in(12) { 0 } else { 50_000 });
    NavAtt { itow_ms, roll_1e5, pitch_1e5, heading_1e5, accuracy_1e5 }.encode()
}

fn acceleration(rng: &mut Rng, itow_ms: u32) -> Vec<u8> {
    let accelerations_1e2 = [20; 3].map(|within| if rng.one_in(4) { value(rng, within) } else { near(rng, within) });
    let message = EsfIns { itow_ms, accelerations_1e2, ..EsfIns::default() }.encode();
    let mut payload = message[6..message.len() - 2].to_vec();
    // Bits 11 to 13 of the first field say which accelerations are valid.
    for bit in 3..6 {
        payload[1] &= if rng.one_in(12) { !(1 << bit) } else { 0xFF };
    }
    frame(CLASS_ESF, EsfIns::ID, &payload)
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use gnss_sim::log::Log;

    use super::*;

    #[test]
    fn each_recording_is_played_and_no_two_are_alike() {
        let all = recordings(3, 1);
        assert!(all[0] != all[1] && all[1] != all[2]);
        for bytes in all {
            let mut file = tempfile::NamedTempFile::new().unwrap();
            file.write_all(&bytes).unwrap();
            let counts = Log::open(file.path()).unwrap().counts();
            assert!(counts.nav_pvt > PLACES.len());
        }
    }
}
