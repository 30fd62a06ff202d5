//! Compares the theory with the code that the drone carries: the crate `profile` judges sealed objects into which
//! errors are injected.
//!
//! Patterns that are detectable in theory must all be rejected; patterns that are codewords in theory must all pass
//! both CRCs. So the weights in this crate are those of `profile`'s polynomials, byte order and coverage. A codeword
//! that changes the object's identifier is rejected for that, and counted separately.
use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use profile::{
    FixType, GpsObject, GpsStatus, GpsValues, Identifier, Rejection, ReportedPosition, ReportedStatus, ReportedValues,
};

use crate::joint::Joint;
use crate::{Polynomial, Words, codes};

/// The greatest length of bursts, bits, of which every burst is injected.
pub const EXHAUSTIVE_BURST: usize = 16;
/// The greatest number of wrong bits of which every pattern is injected.
pub const EXHAUSTIVE_ERRORS: usize = 3;
/// The seed of all random samples.
const SEED: u64 = 0x4852_5553_2026_0001;

/// A kind of object on the air.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Object {
    /// Reported-Position: 64 bytes, both CRCs.
    ReportedPosition,
    /// GPS1: 60 bytes, the frame CRC.
    Gps,
}

impl Object {
    /// Both kinds of object.
    pub const ALL: [Self; 2] = [Self::ReportedPosition, Self::Gps];

    /// The object's name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ReportedPosition => "Reported-Position",
            Self::Gps => "GPS1",
        }
    }

    /// The length of the object on the air, bits.
    #[must_use]
    pub const fn bits(self) -> usize {
        match self {
            Self::ReportedPosition => codes::REPORTED_BITS,
            Self::Gps => codes::GPS_BITS,
        }
    }

    /// Returns a realistic object of this kind, sealed by `profile`.
    #[must_use]
    pub fn sealed(self) -> Vec<u8> {
        let (latitude, longitude, altitude) = (47.497_9, 8.729_6, 493.2);
        let (pitch, yaw, roll, acceleration) = (0.02, 1.57, -0.01, [0.3, -0.1, 0.05]);
        match self {
            Self::ReportedPosition => {
                let status = ReportedStatus::new().with_position_valid(true);
                let values = ReportedValues {
                    timestamp: 1230,
                    status,
                    latitude,
                    longitude,
                    altitude,
                    pitch,
                    yaw,
                    roll,
                    acceleration,
                };
                ReportedPosition::seal(&values).as_bytes().to_vec()
            }
            Self::Gps => {
                let status = GpsStatus::new().with_fix_type(FixType::Fix3D).with_position_valid(true).with_heard(true);
                let values = GpsValues {
                    timestamp: 1230,
                    status,
                    latitude,
                    longitude,
                    altitude,
                    pitch,
                    yaw,
                    roll,
                    acceleration,
                };
                GpsObject::seal(Identifier::gps(1), &values).as_bytes().to_vec()
            }
        }
    }

    /// Returns the reason why `profile` rejects `bytes` as an object of this kind; `None` if `profile` accepts them.
    #[must_use]
    pub fn rejection(self, bytes: &[u8]) -> Option<Rejection> {
        match self {
            Self::ReportedPosition => ReportedPosition::verify(bytes).err(),
            Self::Gps => GpsObject::verify(bytes, Identifier::gps(1)).err(),
        }
    }
}

/// The results of some injected patterns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Injected {
    /// The number of injected patterns.
    pub tried: u64,
    /// The number of patterns with which the object was accepted.
    pub accepted: u64,
    /// The number of patterns with which the object passed every CRC, but was rejected because they changed its
    /// identifier.
    pub identifier: u64,
}

impl Injected {
    fn count(&mut self, rejection: Option<Rejection>) {
        self.tried += 1;
        match rejection {
            None => self.accepted += 1,
            Some(Rejection::Identifier) => self.identifier += 1,
            Some(_) => {}
        }
    }

    fn add(self, other: Self) -> Self {
        Self {
            tried: self.tried + other.tried,
            accepted: self.accepted + other.accepted,
            identifier: self.identifier + other.identifier,
        }
    }
}

fn invert(bytes: &mut [u8], bit: usize) {
    bytes[bit / 8] ^= 0x80 >> (bit % 8);
}

/// Runs `work` for each number below `items`, on all threads, and adds the results.
fn in_parallel(threads: NonZero<usize>, items: usize, work: &(dyn Fn(usize) -> Injected + Sync)) -> Injected {
    let next = AtomicUsize::new(0);
    let run = || {
        let mut sum = Injected::default();
        loop {
            let item = next.fetch_add(1, Ordering::Relaxed);
            if item >= items {
                return sum;
            }
            sum = sum.add(work(item));
        }
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..threads.get()).map(|_| scope.spawn(run)).collect();
        workers
            .into_iter()
            .map(|worker| worker.join().expect("a worker does not panic"))
            .fold(Injected::default(), Injected::add)
    })
}

/// Injects every pattern of exactly `errors` wrong bits.
///
/// # Panics
///
/// Panics if `errors` is neither 1, 2 nor 3.
#[must_use]
pub fn inject_errors(object: Object, errors: usize, threads: NonZero<usize>) -> Injected {
    assert!((1..=EXHAUSTIVE_ERRORS).contains(&errors), "{errors} errors");
    let sealed = object.sealed();
    in_parallel(threads, object.bits(), &|first| {
        let mut injected = Injected::default();
        let mut bytes = sealed.clone();
        invert(&mut bytes, first);
        if errors == 1 {
            injected.count(object.rejection(&bytes));
            return injected;
        }
        for second in first + 1..object.bits() {
            invert(&mut bytes, second);
            if errors == 2 {
                injected.count(object.rejection(&bytes));
            } else {
                for third in second + 1..object.bits() {
                    invert(&mut bytes, third);
                    injected.count(object.rejection(&bytes));
                    invert(&mut bytes, third);
                }
            }
            invert(&mut bytes, second);
        }
        injected
    })
}

/// Injects every burst of 1 to [`EXHAUSTIVE_BURST`] bits, at every position in the object.
#[must_use]
pub fn inject_bursts(object: Object, threads: NonZero<usize>) -> Injected {
    let sealed = object.sealed();
    in_parallel(threads, object.bits(), &|start| {
        let mut injected = Injected::default();
        let mut bytes = sealed.clone();
        // The patterns are all odd numbers of 16 bits, and the lowest bit is sent first. So each burst is injected once
        // at each position.
        for pattern in (1..1_u32 << EXHAUSTIVE_BURST).step_by(2) {
            let length = 32 - pattern.leading_zeros() as usize;
            if start + length <= object.bits() {
                apply(&mut bytes, start, u64::from(pattern));
                injected.count(object.rejection(&bytes));
                apply(&mut bytes, start, u64::from(pattern));
            }
        }
        injected
    })
}

/// Injects `samples` bursts of each length in `lengths` (2 to 64 bits), with random patterns at random positions.
#[must_use]
pub fn sample_bursts(
    object: Object,
    lengths: std::ops::RangeInclusive<usize>,
    samples: usize,
    threads: NonZero<usize>,
) -> Injected {
    let sealed = object.sealed();
    let lengths: Vec<usize> = lengths.collect();
    in_parallel(threads, lengths.len(), &|item| {
        let length = lengths[item];
        let mut random = Random::new(SEED ^ length as u64);
        let mut injected = Injected::default();
        let mut bytes = sealed.clone();
        for _ in 0..samples {
            let ends = 1 | 1 << (length - 1);
            let pattern = random.next() >> (64 - length) | ends;
            let start = random.below(object.bits() - length + 1);
            apply(&mut bytes, start, pattern);
            injected.count(object.rejection(&bytes));
            apply(&mut bytes, start, pattern);
        }
        injected
    })
}

/// Inverts the bits of `bytes` that are set in `pattern`, whose lowest bit stands for the bit `start`.
fn apply(bytes: &mut [u8], start: usize, mut pattern: u64) {
    while pattern != 0 {
        invert(bytes, start + pattern.trailing_zeros() as usize);
        pattern &= pattern - 1;
    }
}

/// Injects error patterns. Each is a word given by the positions of its set bits, counted from the last bit that is
/// sent.
#[must_use]
pub fn inject_words<'a>(object: Object, words: impl IntoIterator<Item = &'a [u16]>) -> Injected {
    let sealed = object.sealed();
    let mut injected = Injected::default();
    for word in words {
        let mut bytes = sealed.clone();
        for place in word {
            invert(&mut bytes, object.bits() - 1 - usize::from(*place));
        }
        injected.count(object.rejection(&bytes));
    }
    injected
}

/// Returns random codewords of `weight` ones in the code of `polynomial` at `length` bits, as the positions of set
/// bits.
///
/// Each word is made of two random halves with equal sums, and there are enough of these halves. All codewords of that
/// weight are equally probable.
#[must_use]
pub fn random_codewords(polynomial: Polynomial, length: usize, weight: usize, count: usize) -> Vec<Vec<u16>> {
    const HALVES: usize = 1 << 19;
    let columns = polynomial.columns(length);
    let mut random = Random::new(SEED ^ (u64::from(polynomial.koopman()) << 16 | length as u64));
    let half = |random: &mut Random, size: usize| {
        let mut places: Vec<u16> = (0..size).map(|_| random.below(length) as u16).collect();
        places.sort_unstable();
        (places.iter().fold(0_u32, |sum, place| sum ^ columns[usize::from(*place)]), places)
    };
    let mut words = Vec::new();
    while words.len() < count {
        let mut halves: Vec<(u32, Vec<u16>)> =
            (0..HALVES).map(|i| half(&mut random, if i % 2 == 0 { weight / 2 } else { weight - weight / 2 })).collect();
        halves.sort_unstable();
        for pair in halves.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            let mut word = [pair[0].1.as_slice(), pair[1].1.as_slice()].concat();
            word.sort_unstable();
            if word.len() == weight && word.is_sorted_by(|a, b| a < b) {
                words.push(word);
            }
        }
    }
    words.truncate(count);
    words
}

/// Whether a word has a set bit within the range `bytes` of an object of `bits` bits.
#[must_use]
pub fn touches(word: &[u16], bits: usize, bytes: std::ops::Range<usize>) -> bool {
    word.iter().any(|place| bytes.contains(&((bits - 1 - usize::from(*place)) / 8)))
}

/// Returns the polynomial as a word whose last bit is the last one sent. This is the shortest burst that is not
/// detected, 33 bits long.
#[must_use]
pub fn polynomial_word(polynomial: Polynomial) -> Vec<u16> {
    (0..=polynomial.degree() as u16).filter(|i| polynomial.coefficients() >> i & 1 == 1).collect()
}

/// Returns the position code's codewords, in 160 bits, whose weight is the code's distance, 9.
#[must_use]
pub fn position_words(threads: NonZero<usize>) -> Words {
    Words::find(codes::POSITION.polynomial, codes::POSITION_BITS, 9, threads)
}

/// The injection of one kind of patterns into one object, with its outcome.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// The kind of object into which the patterns were injected.
    pub object: &'static str,
    /// A description of the injected patterns.
    pub patterns: String,
    /// The outcome that the algebra predicts.
    pub expected: Expected,
    /// The number of injected patterns, and how many of them `profile` accepted.
    pub injected: Injected,
}

/// The required outcome of injecting some patterns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expected {
    /// A CRC rejects every pattern.
    Rejected,
    /// Every pattern passes all CRCs.
    Accepted,
    /// At most one of the samples passes, because a pattern passes with a probability of 2^-31 or less.
    Improbable,
}

impl Check {
    /// Whether the injection had the required outcome.
    #[must_use]
    pub const fn holds(&self) -> bool {
        let passed = self.injected.accepted + self.injected.identifier;
        match self.expected {
            Expected::Rejected => passed == 0 && self.injected.tried > 0,
            Expected::Accepted => passed == self.injected.tried && self.injected.accepted > 0,
            Expected::Improbable => passed <= 1 && self.injected.tried > 0,
        }
    }
}

const BURST_SAMPLES: usize = 50_000;
const CODEWORDS: usize = 1_000;

/// Injects all kinds of patterns into both objects, which takes some seconds.
#[must_use]
pub fn check(joint: &Joint, threads: NonZero<usize>) -> Vec<Check> {
    let mut checks = Vec::new();
    for object in Object::ALL {
        let mut add = |patterns: &str, expected, injected| {
            checks.push(Check { object: object.name(), patterns: patterns.to_owned(), expected, injected });
        };
        for errors in 1..=EXHAUSTIVE_ERRORS {
            add(
                &format!("every pattern of {errors} wrong bits"),
                Expected::Rejected,
                inject_errors(object, errors, threads),
            );
        }
        add("every burst of 1 to 16 bits", Expected::Rejected, inject_bursts(object, threads));
        add(
            "bursts of 17 to 32 bits, sampled",
            Expected::Rejected,
            sample_bursts(object, 17..=32, BURST_SAMPLES, threads),
        );
        add(
            "bursts of 33 to 64 bits, sampled",
            Expected::Improbable,
            sample_bursts(object, 33..=64, BURST_SAMPLES, threads),
        );
        let frame = codes::FRAME.polynomial;
        let burst = polynomial_word(frame);
        add(
            "the frame polynomial itself, a burst of 33 bits",
            Expected::Accepted,
            inject_words(object, [burst.as_slice()]),
        );
        match object {
            Object::Gps => {
                let words = random_codewords(frame, object.bits(), 8, CODEWORDS);
                add(
                    "random frame codewords of weight 8",
                    Expected::Accepted,
                    inject_words(object, words.iter().map(Vec::as_slice)),
                );
            }
            Object::ReportedPosition => {
                // Frame codewords within the 288 bits after the position CRC pass both CRCs. Frame codewords that
                // change latitude, longitude or the position CRC are rejected.
                let behind = random_codewords(frame, 8 * 36, 8, CODEWORDS);
                add(
                    "random frame codewords of weight 8 behind the position CRC",
                    Expected::Accepted,
                    inject_words(object, behind.iter().map(Vec::as_slice)),
                );
                let anywhere = random_codewords(frame, object.bits(), 8, CODEWORDS);
                let inside = anywhere.iter().map(Vec::as_slice).filter(|word| touches(word, object.bits(), 8..28));
                add(
                    "random frame codewords of weight 8 that damage the position",
                    Expected::Rejected,
                    inject_words(object, inside),
                );
                let position: Vec<Vec<u16>> = position_words(threads)
                    .everywhere()
                    .map(|word| word.iter().map(|place| place + 8 * 36).collect())
                    .collect();
                add(
                    "every position codeword of weight 9",
                    Expected::Rejected,
                    inject_words(object, position.iter().map(Vec::as_slice)),
                );
                add(
                    &format!("every codeword of both of weight {} found", joint.at_least),
                    Expected::Accepted,
                    inject_words(object, joint.words.iter().map(Vec::as_slice)),
                );
            }
        }
    }
    checks
}

/// The generator xorshift64* (Vigna, 2014), which gives the same numbers on every machine.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        // The seed is mixed, so that two seeds that differ in a few bits give different first numbers.
        let mut random = Self(seed | 1);
        (0..16).for_each(|_| _ = random.next());
        random
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// A random number below `limit`. The probabilities of two numbers differ by a part in 2^50 at most.
    fn below(&mut self, limit: usize) -> usize {
        ((u128::from(self.next()) * limit as u128) >> 64) as usize
    }
}
