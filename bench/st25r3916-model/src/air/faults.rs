//! The faults between the poller and the listener, and the functions that draw them at random.

use crate::event::{Chunk, FrameStart, Technology};
use crate::rng::SplitMix;

/// The number of sync bits in NFC-F. The receiver does not detect a frame if one of them is inverted.
const SYNC_BITS: u32 = 16;
const SHORTEST_BURST: u32 = 2;

/// The faults of the air on the poller's frames. The default has none.
///
/// A probability outside 0 to 1 is clamped. A range of times is (shortest, longest) in ns with both ends included, and
/// all times in it are equally likely. A longest time below the shortest counts as the shortest.
///
/// The fate of a frame is determined when its first bit leaves the poller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AirFaults {
    /// Probability that a bit is inverted. A frame with a wrong bit in its sync is not received.
    pub bit_error: f64,
    /// Probability that a frame is not received at all.
    pub lost: f64,
    /// Probability that a frame breaks off after a random number of its bytes, at least one byte early.
    pub truncated: f64,
    /// Probability that a burst of errors hits a frame, anywhere from LEN to the end of the CRC-16.
    pub burst: f64,
    /// The length of the longest burst of errors, bits, at least 2. The length of a burst is random, from 2 to this
    /// value. The first and the last bit of the burst are inverted, and each bit between them with probability one
    /// half.
    pub burst_bits: u32,
    /// Probability that a frame that was received whole is received again.
    pub repeated: f64,
    /// The shortest and longest time from the end of a frame to the first bit of its repetition, ns.
    pub repeat_after_ns: (u64, u64),
    /// Probability that a frame is received late, as through a store-and-forward repeater between the antennas.
    pub delayed: f64,
    /// The shortest and longest delay of a delayed frame, ns.
    pub delay_ns: (u64, u64),
    /// Whether a fault freezes the data: each frame is received with the bytes of the last whole frame of its length
    /// before the fault.
    pub frozen: bool,
    /// Whether the field is off at the listener, which then receives neither frame nor carrier.
    pub field_off: bool,
    /// The longest random delay of a frame's start, ns, without the delay of [`AirFaults::delayed`]. It can make frames
    /// collide.
    pub scatter_ns: u64,
}

pub(super) fn within(rng: &mut SplitMix, (shortest, longest): (u64, u64)) -> u64 {
    shortest.saturating_add(rng.up_to(longest.saturating_sub(shortest)))
}

/// Returns the number of inverted bits in a frame's sync. It is 0 for NFC-A, which has no sync.
pub(super) fn sync_errors(rng: &mut SplitMix, faults: &AirFaults, frame: &FrameStart) -> u64 {
    if faults.bit_error <= 0.0 || frame.technology != Technology::NfcF {
        return 0;
    }
    (0..SYNC_BITS).map(|_| u64::from(rng.hit(faults.bit_error))).sum()
}

/// Returns the positions, in the order of the air, of the data bits that a burst inverts in a frame of `bits` data
/// bits.
pub(super) fn burst(rng: &mut SplitMix, faults: &AirFaults, bits: u64) -> Vec<u64> {
    if bits < u64::from(SHORTEST_BURST) || !rng.hit(faults.burst) {
        return vec![];
    }
    let longest = u64::from(faults.burst_bits.max(SHORTEST_BURST)).min(bits);
    let shortest = u64::from(SHORTEST_BURST);
    let length = shortest + rng.up_to(longest - shortest);
    let first = rng.up_to(bits - length);
    let last = first + length - 1;
    (first..=last).filter(|&bit| bit == first || bit == last || rng.hit(0.5)).collect()
}

/// Returns the mask of data bit `bit` in its byte. NFC-F sends the most significant bit first, NFC-A the least.
fn mask(technology: Technology, bit: u64) -> u8 {
    match technology {
        Technology::NfcF => 0x80 >> (bit % 8),
        Technology::NfcA => 1 << (bit % 8),
    }
}

/// Inverts bits of `chunk`, which begins with the frame's byte `first`. Returns the positions of the bit errors.
pub(super) fn invert(
    rng: &mut SplitMix,
    faults: &AirFaults,
    technology: Technology,
    burst: &[u64],
    first: usize,
    chunk: &mut Chunk,
) -> Vec<u64> {
    let mut errors = vec![];
    if faults.bit_error <= 0.0 && burst.is_empty() {
        return errors;
    }
    let mut wrong = vec![0_u8; chunk.data.len()];
    let from = 8 * first as u64;
    if faults.bit_error > 0.0 {
        for (bit, byte) in (from..from + 8 * wrong.len() as u64).map(|bit| (bit, ((bit - from) / 8) as usize)) {
            if rng.hit(faults.bit_error) {
                wrong[byte] ^= mask(technology, bit);
                errors.push(bit);
            }
        }
    }
    for &bit in burst {
        if let Some(byte) = bit.checked_sub(from).and_then(|bit| wrong.get_mut((bit / 8) as usize)) {
            *byte ^= mask(technology, bit);
        }
    }
    for (byte, wrong) in chunk.data.iter_mut().zip(wrong) {
        *byte ^= wrong;
        chunk.parity_error |= technology == Technology::NfcA && wrong.count_ones() % 2 == 1;
    }
    errors
}
