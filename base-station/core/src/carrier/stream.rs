//! Frames a byte stream from a flight controller to a base station, for links without MAVLink.
//!
//! The link may lose and damage bytes. A profile, an image or a map travels unchanged, in consistent overhead byte
//! stuffing (COBS: Cheshire and Baker, *Consistent Overhead Byte Stuffing*, IEEE/ACM Transactions on Networking 7(2),
//! 1999), ended by a zero byte. The encoded bytes contain no zero, so a receiver resynchronises at the next zero. The
//! objects have their own CRCs, so a frame has none.
//!
//! The crate `cobs` is not used, because this deframer holds at most one frame and reports damaged frames.

/// The byte that ends each frame, and occurs nowhere else.
pub const DELIMITER: u8 = 0;

const RUN_MAX: usize = 254;

/// Appends `payload` as a frame to `line`.
pub fn encode(payload: &[u8], line: &mut Vec<u8>) {
    let mut code_at = line.len();
    line.push(1);
    for (index, byte) in payload.iter().enumerate() {
        if *byte == DELIMITER {
            code_at = line.len();
            line.push(1);
            continue;
        }
        line.push(*byte);
        line[code_at] += 1;
        // A full-length run of bytes must be followed by another code byte, unless it ends the frame.
        if usize::from(line[code_at]) == RUN_MAX + 1 && index + 1 < payload.len() {
            code_at = line.len();
            line.push(1);
        }
    }
    line.push(DELIMITER);
}

/// A frame that is cut off, or longer than a deframer accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Damaged;

/// Extracts the frames of a byte stream.
#[derive(Debug, Clone)]
pub struct Deframer {
    held: Vec<u8>,
    limit: usize,
    overrun: bool,
}

impl Deframer {
    /// Returns a deframer for payloads of at most `longest` bytes.
    #[must_use]
    pub fn new(longest: usize) -> Self {
        Self { held: Vec::new(), limit: longest + longest / RUN_MAX + 1, overrun: false }
    }

    /// Processes the next byte of the stream; returns the payload of the frame that it completes. A delimiter directly
    /// after another one completes no frame.
    pub fn push(&mut self, byte: u8) -> Option<Result<Vec<u8>, Damaged>> {
        if byte != DELIMITER {
            if self.held.len() < self.limit {
                self.held.push(byte);
            } else {
                self.overrun = true;
            }
            return None;
        }
        let overrun = core::mem::take(&mut self.overrun);
        if self.held.is_empty() {
            return None;
        }
        let frame = if overrun { Err(Damaged) } else { decode(&self.held).ok_or(Damaged) };
        self.held.clear();
        Some(frame)
    }
}

fn decode(mut encoded: &[u8]) -> Option<Vec<u8>> {
    let mut payload = Vec::with_capacity(encoded.len());
    while let Some((code, rest)) = encoded.split_first() {
        let run = usize::from(*code).checked_sub(1)?;
        let (bytes, after) = rest.split_at_checked(run)?;
        payload.extend(bytes);
        encoded = after;
        if run < RUN_MAX && !encoded.is_empty() {
            payload.push(DELIMITER);
        }
    }
    Some(payload)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(deframer: &mut Deframer, line: &[u8]) -> Vec<Result<Vec<u8>, Damaged>> {
        line.iter().filter_map(|byte| deframer.push(*byte)).collect()
    }

    #[test]
    fn encoding_matches_the_published_examples() {
        let run: Vec<u8> = (1..=255).collect();
        let full = &run[..254];
        let examples: [(&[u8], Vec<u8>); 7] = [
            (&[0], vec![1, 1, 0]),
            (&[0, 0], vec![1, 1, 1, 0]),
            (&[0x11, 0x22, 0, 0x33], vec![3, 0x11, 0x22, 2, 0x33, 0]),
            (&[0x11, 0, 0, 0], vec![2, 0x11, 1, 1, 1, 0]),
            (full, [&[255], full, &[0]].concat()),
            (&run, [&[255], full, &[2, 255, 0]].concat()),
            (&[], vec![1, 0]),
        ];
        for (payload, encoded) in examples {
            let mut line = Vec::new();
            encode(payload, &mut line);
            assert_eq!(line, encoded, "{payload:?}");
        }
    }

    #[test]
    fn every_length_and_pattern_of_zeros_comes_back() {
        for length in 1..=800_usize {
            for pattern in 0..4_usize {
                let payload: Vec<u8> = (0..length)
                    .map(|i| match pattern {
                        0 => 0,
                        1 => 0xff,
                        2 => (i % 256) as u8,
                        _ => u8::from((i * i + length) % 7 != 0),
                    })
                    .collect();
                let mut line = Vec::new();
                encode(&payload, &mut line);
                assert_eq!(line.iter().filter(|byte| **byte == DELIMITER).count(), 1);
                assert_eq!(frames(&mut Deframer::new(length), &line), [Ok(payload)], "{length} {pattern}");
            }
        }
    }

    #[test]
    fn a_receiver_is_in_step_again_after_the_next_delimiter() {
        let mut line = Vec::new();
        encode(&[1, 2, 0, 3, 4], &mut line);
        let whole = line.clone();
        let mut stream = whole[4..].to_vec();
        stream.extend(&whole[..3]);
        stream.extend(&whole[4..]);
        stream.extend([7; 100]);
        stream.push(DELIMITER);
        stream.extend([DELIMITER; 3]);
        stream.extend(&whole);
        let found = frames(&mut Deframer::new(5), &stream);
        assert_eq!(found.last(), Some(&Ok(vec![1, 2, 0, 3, 4])));
        assert_eq!(found.iter().filter(|frame| frame.is_ok()).count(), 1, "{found:?}");
        assert_eq!(found.len(), 4);
    }
}
