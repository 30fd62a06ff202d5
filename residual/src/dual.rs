//! Counts all words of the dual code by weight.
//!
//! A CRC of r check bits over n bits is a linear code of 2^(n - r) words, too many to count when n is in the hundreds.
//! Its dual, all sums of its r parity checks, has 2^r words for any n: 4.3 · 10^9 for r = 32. MacWilliams' identity
//! converts the weights of the dual into those of the code ([`crate::weights`]).
//!
//! **Gray code.** Each word differs from the one before by one parity check, an exclusive or of n bits. A table has all
//! 64 sums of the last six checks. So no word in the inner loop depends on the word before: load, exclusive or, count,
//! n / 64 times, then one histogram entry.
//!
//! **Even codes need half the work.** If x + 1 divides the polynomial, the all-ones word is in the dual, as the sum of
//! all checks. So each word of weight w has a partner of weight n - w: one check is left out and the histogram
//! mirrored.
//!
//! **All cores.** The sequence of words is divided into 2^10 pieces, each with its own start in the Gray code, which
//! threads process one by one. The sum of the histograms does not depend on the threads.
use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::{array, thread};

use crate::Polynomial;

/// The longest codeword whose dual can be counted, bits.
pub const MAX_LENGTH: usize = 512;

const WORD: usize = 64;
/// log2 of the number of tabulated sums, which stay in the first-level cache: at most 4 KiB.
const TABLE_LOG2: u32 = 6;
const PIECES_LOG2: u32 = 10;
/// The number of histograms in which words are counted in turn. Adjacent words often have equal weights; in one
/// histogram, each increment would wait for the last store.
const HISTOGRAMS: usize = 4;
/// For each histogram, the number of words of each weight in one piece of the sequence, at most 2^22.
type Histograms = [[u32; MAX_LENGTH + 1]; HISTOGRAMS];

/// The number of words of each weight in the dual code, from weight 0 to the length of the codeword.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DualWeights {
    counts: Vec<u64>,
}

impl DualWeights {
    /// Counts the words of the dual of the polynomial's code of `length` bits, check bits included. The counting
    /// threads call `progress` with the finished share, 0 to 1.
    ///
    /// # Panics
    ///
    /// Panics if `length` is more than [`MAX_LENGTH`], or not more than the number of check bits.
    #[must_use]
    pub fn count(
        polynomial: Polynomial,
        length: usize,
        threads: NonZero<usize>,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Self {
        assert!(length > polynomial.degree() as usize && length <= MAX_LENGTH, "a codeword of {length} bits");
        match length.div_ceil(WORD) {
            1 => Walk::<1>::new(polynomial, length).count(threads, progress),
            2 => Walk::<2>::new(polynomial, length).count(threads, progress),
            3 => Walk::<3>::new(polynomial, length).count(threads, progress),
            4 => Walk::<4>::new(polynomial, length).count(threads, progress),
            5 => Walk::<5>::new(polynomial, length).count(threads, progress),
            6 => Walk::<6>::new(polynomial, length).count(threads, progress),
            7 => Walk::<7>::new(polynomial, length).count(threads, progress),
            _ => Walk::<8>::new(polynomial, length).count(threads, progress),
        }
    }

    /// Returns the distribution with `counts[w]` words of weight w, for w from 0 to the length. The words were counted
    /// before.
    #[must_use]
    pub fn from_counts(counts: Vec<u64>) -> Self {
        Self { counts }
    }

    /// The number of words of each weight, from 0 to the codeword's length.
    #[must_use]
    pub fn counts(&self) -> &[u64] {
        &self.counts
    }

    /// The codeword's length, bits.
    #[must_use]
    pub fn length(&self) -> usize {
        self.counts.len() - 1
    }
}

struct Walk<const W: usize> {
    length: usize,
    /// Whether each counted word also stands for its complement, which is in the dual as well.
    mirrored: bool,
    /// The parity checks that the Gray code combines. The last of them select a piece of the sequence.
    checks: Vec<[u64; W]>,
    table: Vec<[u64; W]>,
    pieces_log2: u32,
}

impl<const W: usize> Walk<W> {
    fn new(polynomial: Polynomial, length: usize) -> Self {
        let columns = polynomial.columns(length);
        // Bit j of every column makes up the parity check j.
        let mut checks: Vec<[u64; W]> = (0..polynomial.degree())
            .map(|j| {
                let mut check = [0; W];
                for (i, column) in columns.iter().enumerate() {
                    check[i / WORD] |= u64::from(column >> j & 1) << (i % WORD);
                }
                check
            })
            .collect();
        let mirrored = polynomial.is_even();
        if mirrored {
            checks.pop();
        }
        let tabulated = checks.split_off(checks.len().saturating_sub(TABLE_LOG2 as usize));
        let mut table = vec![[0; W]];
        for check in tabulated {
            table.extend_from_within(..);
            let half = table.len() / 2;
            for sum in &mut table[half..] {
                *sum = add(sum, &check);
            }
        }
        let pieces_log2 = PIECES_LOG2.min(checks.len() as u32);
        Self { length, mirrored, checks, table, pieces_log2 }
    }

    fn count(&self, threads: NonZero<usize>, progress: &(dyn Fn(f64) + Sync)) -> DualWeights {
        let pieces = 1_usize << self.pieces_log2;
        let next = AtomicUsize::new(0);
        let done = AtomicUsize::new(0);
        let counted = thread::scope(|scope| {
            let workers: Vec<_> = (0..threads.get())
                .map(|_| {
                    scope.spawn(|| {
                        let mut counts = vec![0_u64; W * WORD + 1];
                        loop {
                            let piece = next.fetch_add(1, Ordering::Relaxed);
                            if piece >= pieces {
                                return counts;
                            }
                            for histogram in self.piece(piece) {
                                counts.iter_mut().zip(histogram).for_each(|(sum, count)| *sum += u64::from(count));
                            }
                            progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / pieces as f64);
                        }
                    })
                })
                .collect();
            workers.into_iter().map(|worker| worker.join().expect("a worker does not panic")).fold(
                vec![0_u64; W * WORD + 1],
                |mut sums, counts| {
                    sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
                    sums
                },
            )
        });
        let mut counts = counted[..=self.length].to_vec();
        if self.mirrored {
            let mirror: Vec<u64> = counts.iter().rev().copied().collect();
            counts.iter_mut().zip(mirror).for_each(|(count, mirrored)| *count += mirrored);
        }
        DualWeights { counts }
    }

    fn piece(&self, piece: usize) -> Histograms {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("popcnt") {
            // SAFETY: the function needs the POPCNT instruction and nothing else, and the check above has found it on
            // this processor.
            return unsafe { self.piece_with_popcnt(piece) };
        }
        self.walk(piece)
    }

    /// Counts the words of one piece of the sequence, on a processor with an instruction that counts the bits of a
    /// word. That is three times as fast.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "popcnt")]
    fn piece_with_popcnt(&self, piece: usize) -> Histograms {
        self.walk(piece)
    }

    #[inline(always)]
    fn walk(&self, piece: usize) -> Histograms {
        let mut histograms = [[0; MAX_LENGTH + 1]; HISTOGRAMS];
        let (walked, fixed) = self.checks.split_at(self.checks.len() - self.pieces_log2 as usize);
        let mut word = [0; W];
        for (j, check) in fixed.iter().enumerate() {
            if piece >> j & 1 == 1 {
                word = add(&word, check);
            }
        }
        let mut step = 0_u64;
        loop {
            let (groups, rest) = self.table.as_chunks::<HISTOGRAMS>();
            for sums in groups {
                for (histogram, sum) in histograms.iter_mut().zip(sums) {
                    count_word(histogram, &add(&word, sum));
                }
            }
            for (histogram, sum) in histograms.iter_mut().zip(rest) {
                count_word(histogram, &add(&word, sum));
            }
            step += 1;
            match walked.get(step.trailing_zeros() as usize) {
                Some(check) => word = add(&word, check),
                None => return histograms,
            }
        }
    }
}

/// Counts a word in the histogram entry for its number of ones. No entry can overflow: a word has at most 512 ones, and
/// a piece of the sequence has at most 2^22 words.
#[inline(always)]
fn count_word<const W: usize>(histogram: &mut [u32; MAX_LENGTH + 1], word: &[u64; W]) {
    let weight = word.iter().fold(0_u32, |ones, part| ones.wrapping_add(part.count_ones()));
    let count = &mut histogram[weight as usize];
    *count = count.wrapping_add(1);
}

#[inline(always)]
fn add<const W: usize>(a: &[u64; W], b: &[u64; W]) -> [u64; W] {
    array::from_fn(|i| a[i] ^ b[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: NonZero<usize> = NonZero::new(2).unwrap();

    fn by_brute_force(polynomial: Polynomial, length: usize) -> Vec<u64> {
        let columns = polynomial.columns(length);
        let mut counts = vec![0; length + 1];
        for sum in 0..1_u64 << polynomial.degree() {
            counts[columns.iter().filter(|column| (sum as u32 & **column).count_ones() % 2 == 1).count()] += 1;
        }
        counts
    }

    #[test]
    fn the_walk_gives_the_counts_of_brute_force_at_every_width() {
        for (degree, normal) in [(1, 1), (3, 3), (7, 0x09), (8, 0x07), (8, 0x2F), (10, 0x233), (11, 0x385)] {
            let polynomial = Polynomial::from_normal(degree, normal).unwrap();
            for length in [degree as usize + 1, 63, 64, 65, 128, 160, 256, 300, 384, 448, 480, 511, 512] {
                let counted = DualWeights::count(polynomial, length, TWO, &|_| ());
                assert_eq!(counted.counts(), by_brute_force(polynomial, length), "{polynomial:?}, {length} bits");
            }
        }
        for normal in [0x1021, 0x8005, 0x3D65, 0x755B] {
            let polynomial = Polynomial::from_normal(16, normal).unwrap();
            let counted = DualWeights::count(polynomial, 151, TWO, &|_| ());
            assert_eq!(counted.counts(), by_brute_force(polynomial, 151), "{polynomial:?}");
        }
    }

    #[test]
    fn code_with_and_without_the_instruction_count_alike() {
        let walk = Walk::<8>::new(Polynomial::from_koopman(32, 0x9D7F_97D6).unwrap(), 512);
        assert_eq!(walk.piece(77), walk.walk(77));
    }

    #[test]
    fn the_number_of_threads_changes_nothing_and_progress_ends_at_one() {
        let polynomial = Polynomial::from_normal(20, 0x80_005).unwrap();
        let last = std::sync::Mutex::new(0.0_f64);
        let one = DualWeights::count(polynomial, 200, NonZero::<usize>::MIN, &|part| {
            let mut last = last.lock().unwrap();
            assert!(part > *last);
            *last = part;
        });
        assert_eq!(*last.lock().unwrap(), 1.0);
        assert_eq!(one, DualWeights::count(polynomial, 200, NonZero::new(5).unwrap(), &|_| ()));
    }
}
