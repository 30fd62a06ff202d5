//! Signs and verifies MAVLink 2 messages; the time is an argument.
//!
//! A signature is the first 48 bits of SHA-256 over a secret key, the message, a link's number and a timestamp in units
//! of 10 µs since 2015-01-01 (mavlink.io, *Message Signing*). A valid signature proves that the sender has the key and
//! did not replay the message. It does not replace the objects' own checks.

use core::fmt;
use std::collections::BTreeMap;

use mavlink::MAVLinkV2MessageRaw;
use mavlink::consts::v2::{IFLAG_SIGNED, SIGNATURE_VALUE_SIZE};

/// The instant 2015-01-01T00:00:00Z, from which signatures count time, s since 1970.
const EPOCH_S: u64 = 1_420_070_400;

/// How far the first timestamp of an unknown stream may be behind this station's clock, in units of 10 µs: one minute.
const NEW_STREAM: u64 = 6_000_000;

const MAX_STREAMS: usize = 4_096;

/// Returns the time of a signature, in units of 10 µs since 2015, for an instant in µs since 1970.
#[must_use]
pub const fn timestamp(unix_us: u64) -> u64 {
    unix_us.saturating_sub(EPOCH_S * 1_000_000) / 10
}

/// A secret key for signatures.
#[derive(Clone)]
pub struct Key([u8; 32]);

impl Key {
    /// Returns a key of these 32 bytes.
    #[must_use]
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// Returns a key from 64 hexadecimal digits; `None` if the text is anything else.
    #[must_use]
    pub fn from_hex(digits: &str) -> Option<Self> {
        let digit = |digit: char| digit.to_digit(16).and_then(|digit| u8::try_from(digit).ok());
        let digits: Vec<u8> = digits.trim().chars().map(digit).collect::<Option<_>>()?;
        let bytes = digits.chunks(2).map(|pair| pair.iter().fold(0, |byte, digit| byte << 4 | digit));
        let bytes: Vec<u8> = bytes.collect();
        Some(Self(bytes.try_into().ok().filter(|_| digits.len() == 64)?))
    }
}

/// The output hides the key, which must not get into logs.
impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(..)")
    }
}

/// Signs the messages of one link.
#[derive(Clone, Debug)]
pub struct Signer {
    key: Key,
    link: u8,
    last: u64,
}

impl Signer {
    /// Returns a signer for the link of this number.
    #[must_use]
    pub const fn new(key: Key, link: u8) -> Self {
        Self { key, link, last: 0 }
    }

    /// Signs a message at `now` ([`timestamp`]). The message must have been serialised with the flag for signed
    /// messages. The timestamp of each message is later than that of the message before.
    pub fn sign(&mut self, now: u64, message: &mut MAVLinkV2MessageRaw) {
        self.last = now.max(self.last + 1);
        *message.signature_link_id_mut() = self.link;
        let bytes = self.last.to_le_bytes();
        message.signature_timestamp_bytes_mut().copy_from_slice(&bytes[..6]);
        let mut value = [0; SIGNATURE_VALUE_SIZE];
        message.calculate_signature(&self.key.0, &mut value);
        message.signature_value_mut().copy_from_slice(&value);
    }
}

/// Accepts messages that are signed with the key, each of them once.
#[derive(Clone, Debug)]
pub struct Verifier {
    key: Key,
    streams: BTreeMap<(u8, u32, u8), u64>,
}

impl Verifier {
    /// Returns a verifier for this key.
    #[must_use]
    pub const fn new(key: Key) -> Self {
        Self { key, streams: BTreeMap::new() }
    }

    /// Returns whether the message is signed with the key and newer than all earlier ones of its stream. The first
    /// message of a stream is only compared with this station's clock: a sender whose clock is ahead must not shut out
    /// the others.
    pub fn verify(&mut self, now: u64, message: &MAVLinkV2MessageRaw) -> bool {
        if message.incompatibility_flags() & IFLAG_SIGNED == 0 {
            return false;
        }
        let stream = (message.signature_link_id(), message.system_id(), message.component_id());
        let timestamp = message.signature_timestamp();
        let is_new = match self.streams.get(&stream) {
            Some(last) => timestamp > *last,
            None => timestamp.saturating_add(NEW_STREAM) >= now && self.streams.len() < MAX_STREAMS,
        };
        let mut value = [0; SIGNATURE_VALUE_SIZE];
        message.calculate_signature(&self.key.0, &mut value);
        let difference = value.iter().zip(message.signature_value()).fold(0, |all, (a, b)| all | (a ^ b));
        let good = is_new && difference == 0;
        if good {
            self.streams.insert(stream, timestamp);
        }
        good
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_64_hexadecimal_digits() {
        let digits = "00ff102030405060708090a0b0c0d0e0f0112233445566778899aabbccddeeff";
        let key = Key::from_hex(&format!("{digits}\n")).unwrap();
        assert_eq!((key.0[0], key.0[1], key.0[31]), (0x00, 0xFF, 0xFF));
        assert_eq!(format!("{key:?}"), "Key(..)");
        let (long, odd, foreign) = (format!("{digits}0"), digits.replace('f', "g"), digits.replace('f', "é"));
        for bad in ["", "0", &digits[1..], &long, &odd, &foreign] {
            assert!(Key::from_hex(bad).is_none(), "{bad}");
        }
    }

    #[test]
    fn time_begins_in_2015() {
        assert_eq!(timestamp(1_420_070_400_000_000), 0);
        assert_eq!(timestamp(1_420_070_401_000_000), 100_000);
        assert_eq!(timestamp(0), 0);
    }
}
