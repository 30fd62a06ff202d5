//! Faults on the way from the poller to the listener, and the generator that decides when they occur.

use crate::event::{Chunk, FrameStart, Technology};
use crate::rng::SplitMix;

/// Bits of an NFC-F sync: the receiver detects no frame if any of them is inverted.
const SYNC_BITS: u32 = 16;
/// The shortest burst, bits: it consists of its first and its last bit.
const SHORTEST_BURST: u32 = 2;

/// The air's effect on the poller's frames. The default has no faults.
///
/// Every probability lies between 0 (never) and 1 (always); a value outside is clamped. A range of times is (shortest,
/// longest) in ns, both ends included and every instant equally likely; a longest below the shortest counts as the
/// shortest.
///
/// The fate of a frame is decided when its first bit leaves the poller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AirFaults {
    /// Probability that a bit, of the sync or of the data, is inverted, independently of the others. A frame with a
    /// wrong bit in its sync is not received.
    pub bit_error: f64,
    /// Probability that a frame is not received at all.
    pub lost: f64,
    /// Probability that a frame breaks off after a random number of its bytes, at least one byte early.
    pub truncated: f64,
    /// Probability that a frame is hit by one burst of errors, anywhere from LEN to the end of the CRC-16.
    pub burst: f64,
    /// The longest burst, bits. A burst is 2 to this many bits long, each length equally likely: its first and last bit
    /// are inverted, those between them each with probability one half. A value below 2 counts as 2; a burst longer
    /// than the frame is as long as the frame.
    pub burst_bits: u32,
    /// Probability that a frame that was received whole is received once more.
    pub repeated: f64,
    /// The time from the end of a frame to the first bit of its repetition, ns.
    pub repeat_after_ns: (u64, u64),
    /// Probability that a frame is received late, as through a store-and-forward repeater between the antennas.
    pub delayed: f64,
    /// The delay of a delayed frame, first bit to first bit, ns.
    pub delay_ns: (u64, u64),
    /// Each frame is received with the bytes of the last whole one of its length from before this fault, as through a
    /// hung repeater between the antennas.
    pub frozen: bool,
    /// No frame reaches the listener, and it detects no carrier.
    pub field_off: bool,
    /// The largest delay of the start of a frame that is not delayed otherwise, ns, each instant equally likely; its
    /// bits keep their length. Beyond the gap between two frames it makes them collide.
    pub scatter_ns: u64,
}

/// Draws an instant in a range of times.
pub(super) fn within(rng: &mut SplitMix, (shortest, longest): (u64, u64)) -> u64 {
    shortest.saturating_add(rng.up_to(longest.saturating_sub(shortest)))
}

/// The inverted bits of a sync. There are none outside NFC-F, whose start of communication is a single symbol.
pub(super) fn sync_errors(rng: &mut SplitMix, faults: &AirFaults, frame: &FrameStart) -> u64 {
    if faults.bit_error <= 0.0 || frame.technology != Technology::NfcF {
        return 0;
    }
    (0..SYNC_BITS).map(|_| u64::from(rng.hit(faults.bit_error))).sum()
}

/// The data bits that a burst inverts, counted in the order of the air; empty when there is none. `bits` is the frame's
/// length.
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

/// The mask of data bit `bit` of the air in its byte: NFC-F sends the most significant bit first, NFC-A the least.
fn mask(technology: Technology, bit: u64) -> u8 {
    match technology {
        Technology::NfcF => 0x80 >> (bit % 8),
        Technology::NfcA => 1 << (bit % 8),
    }
}

/// Inverts bits of `chunk`, whose first byte is the frame's byte `first`: those of `burst`, and each with the
/// probability of a bit error. Returns the bits of the latter kind, in the order of the air.
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
