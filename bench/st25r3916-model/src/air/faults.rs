//! Faults on the way from the poller to the listener, and the functions that draw them at random.

use crate::event::{Chunk, FrameStart, Technology};
use crate::rng::SplitMix;

/// The number of bits in the sync of NFC-F. The receiver detects no frame if any of them is inverted.
const SYNC_BITS: u32 = 16;
/// The length of the shortest burst of errors, bits. It consists of a first and a last bit only.
const SHORTEST_BURST: u32 = 2;

/// The air's effect on the poller's frames. The default has no faults.
///
/// Every probability lies between 0 (never) and 1 (always); a value outside these limits is clamped. A range of times
/// is (shortest, longest) in ns, both ends included and every time equally likely; a longest time below the shortest
/// counts as the shortest.
///
/// What happens to a frame is determined when its first bit leaves the poller.
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
    /// The length of the longest burst of errors, bits. Each burst has a random length from 2 to this value, every
    /// length equally likely. Its first and last bits are inverted, and each bit between them is inverted with
    /// probability one half. A value below 2 counts as 2; a burst longer than the frame is as long as the frame.
    pub burst_bits: u32,
    /// Probability that a frame that was received whole is received once more.
    pub repeated: f64,
    /// The range of the time from the end of a frame to the first bit of its repetition, ns.
    pub repeat_after_ns: (u64, u64),
    /// Probability that a frame is received late, as through a store-and-forward repeater between the antennas.
    pub delayed: f64,
    /// The range of the time by which a delayed frame is late, ns, from the first bit that is sent to the first bit
    /// that is received.
    pub delay_ns: (u64, u64),
    /// Whether each frame is received with the bytes of an earlier frame, as through a hung repeater between the
    /// antennas. The earlier frame is the last whole one of the same length before this fault.
    pub frozen: bool,
    /// Whether the field is off at the listener: no frame reaches the listener, and the listener detects no carrier.
    pub field_off: bool,
    /// The longest random delay of the start of each frame that [`AirFaults::delayed`] does not delay, ns, every delay
    /// up to it equally likely. The frame's bits keep their length. A value longer than the gap between two frames can
    /// make them collide.
    pub scatter_ns: u64,
}

/// Returns a random time from a range of times, ns.
pub(super) fn within(rng: &mut SplitMix, (shortest, longest): (u64, u64)) -> u64 {
    shortest.saturating_add(rng.up_to(longest.saturating_sub(shortest)))
}

/// Returns the number of inverted bits in a frame's sync. It is 0 outside NFC-F: NFC-A begins with a single symbol, its
/// start of communication.
pub(super) fn sync_errors(rng: &mut SplitMix, faults: &AirFaults, frame: &FrameStart) -> u64 {
    if faults.bit_error <= 0.0 || frame.technology != Technology::NfcF {
        return 0;
    }
    (0..SYNC_BITS).map(|_| u64::from(rng.hit(faults.bit_error))).sum()
}

/// Returns the positions of the data bits that a burst inverts, counted in the order of the air, or an empty list when
/// there is no burst. `bits` is the number of data bits in the frame.
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

/// Returns the mask of data bit `bit`, counted in the order of the air, in its byte: NFC-F sends the most significant
/// bit of a byte first, NFC-A the least significant.
fn mask(technology: Technology, bit: u64) -> u8 {
    match technology {
        Technology::NfcF => 0x80 >> (bit % 8),
        Technology::NfcA => 1 << (bit % 8),
    }
}

/// Inverts bits of `chunk`, whose first byte is byte `first` of the frame: the bits listed in `burst`, and each bit
/// with the probability of a bit error. Returns the positions of the bit errors, in the order of the air.
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
