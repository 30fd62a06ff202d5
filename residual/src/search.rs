//! Finds codewords of low weight one by one, to check the numbers that follow from the dual code.
//!
//! # Meeting in the middle
//!
//! Errors in some bits go undetected if the [columns](Polynomial::columns) of these bits add up to 0. Each set of w
//! such bits is split into two halves, whose columns have equal sums. So it suffices to list the sums of all halves and
//! search for equal ones.
//!
//! **Only words that begin at bit 0 are searched.** A CRC's codeword that is shifted by a bit is again a codeword. So a
//! word that begins at bit 0 and spans m bits occurs n - m + 1 times in n. With bit 0 given, 2h bits remain; for an
//! even weight, each possible highest bit is given in turn as well. Each word is counted once, with the h lower bits as
//! its first half.
//!
//! **The data stay in the cache.** The halves are sorted into 2^16 buckets by the upper bits of their sums, so matching
//! halves lie in matching buckets. A bitmap of 8 KiB over the lower bits shows whether one bucket has a partner for an
//! entry of the other.
use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use crate::Polynomial;

/// The largest weight for which codewords can be searched.
pub const MAX_WEIGHT: usize = 10;
/// The greatest length at which codewords can be searched, bits.
pub const MAX_LENGTH: usize = 1 << PLACE_BITS;

/// The number of bits of an entry that state the position of one set bit.
const PLACE_BITS: usize = 12;
const BUCKETS: usize = 1 << 16;

/// All codewords of a code that have a given weight and begin at bit 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Words {
    length: usize,
    words: Vec<Vec<u16>>,
}

impl Words {
    /// Finds the codewords of `length` bits that have `weight` ones and begin at bit 0.
    ///
    /// The work grows with the number of ways to choose weight / 2 of the bits, the memory with its square root. For
    /// 512 bits the search takes seconds up to weight 8, for 160 bits up to weight 10.
    ///
    /// # Panics
    ///
    /// Panics if the weight is 0 or above [`MAX_WEIGHT`], or the length above [`MAX_LENGTH`].
    #[must_use]
    pub fn find(polynomial: Polynomial, length: usize, weight: usize, threads: NonZero<usize>) -> Self {
        assert!((1..=MAX_WEIGHT).contains(&weight) && length <= MAX_LENGTH, "{weight} of {length} bits");
        // The upper bits of a sum select its bucket, so the columns of a polynomial of lower degree are shifted up.
        let aligned = |column| column << (32 - polynomial.degree());
        let columns: Vec<u32> = polynomial.columns(length).into_iter().map(aligned).collect();
        let half = (weight - 1) / 2;
        let halves = Halves::new(&columns, half);
        let mut words = Vec::new();
        if weight % 2 == 1 {
            halves.join(columns[0], length, threads, &mut |places| words.push(place_all(&places, None)));
        } else {
            for highest in weight - 1..length {
                halves.join(columns[0] ^ columns[highest], highest, threads, &mut |places| {
                    words.push(place_all(&places, Some(highest)));
                });
            }
        }
        words.sort_unstable();
        Self { length, words }
    }

    /// The words of this weight that begin at bit 0, each as the positions of its set bits in rising order. Bit i is
    /// the coefficient of x^i, which is sent i bits before the last.
    #[must_use]
    pub fn starting_at_0(&self) -> &[Vec<u16>] {
        &self.words
    }

    /// The number of words of this weight, A_w, whichever bit they begin at.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.words.iter().map(|word| (self.length - span(word) + 1) as u64).sum()
    }

    /// All words of this weight, whichever bit they begin at.
    pub fn everywhere(&self) -> impl Iterator<Item = Vec<u16>> {
        self.words.iter().flat_map(move |word| {
            (0..=self.length - span(word)).map(move |shift| word.iter().map(|place| place + shift as u16).collect())
        })
    }
}

fn span(word: &[u16]) -> usize {
    usize::from(word.last().copied().unwrap_or(0)) + 1
}

fn place_all(middle: &[u16], highest: Option<usize>) -> Vec<u16> {
    let mut places = vec![0];
    places.extend_from_slice(middle);
    places.extend(highest.map(|place| place as u16));
    places
}

/// The sums of all sets of `half` columns, sorted into buckets. The first column is in none of the sets.
struct Halves {
    half: usize,
    /// The index of the first entry of each bucket, and finally the index behind the last entry.
    begins: Vec<u32>,
    occupied: Vec<usize>,
    /// An entry for each set of columns: the lower 16 bits of the sum, then the positions, 12 bits each, the lowest
    /// position in the highest bits. The entries of a bucket are in the order of their highest position.
    entries: Vec<u64>,
}

impl Halves {
    fn new(columns: &[u32], half: usize) -> Self {
        let mut sizes = vec![0_u32; BUCKETS + 1];
        subsets(columns, half, &mut |sum, _| sizes[(sum >> 16) as usize + 1] += 1);
        let mut begins = sizes;
        for bucket in 0..BUCKETS {
            begins[bucket + 1] += begins[bucket];
        }
        let mut entries = vec![0_u64; begins[BUCKETS] as usize];
        let mut ends = begins.clone();
        subsets(columns, half, &mut |sum, places| {
            let end = &mut ends[(sum >> 16) as usize];
            entries[*end as usize] = u64::from(sum & 0xFFFF) << 48 | places;
            *end += 1;
        });
        let occupied = (0..BUCKETS).filter(|bucket| begins[*bucket] < begins[bucket + 1]).collect();
        Self { half, begins, occupied, entries }
    }

    fn bucket(&self, bucket: usize, limit: usize) -> &[u64] {
        let entries = &self.entries[self.begins[bucket] as usize..self.begins[bucket + 1] as usize];
        let highest = |entry: &u64| (*entry & ((1 << PLACE_BITS) - 1)) as usize;
        if self.half == 0 { entries } else { &entries[..entries.partition_point(|entry| highest(entry) < limit)] }
    }

    /// Finds all pairs of halves whose sums add up to `target`. All positions of one half lie below those of the other
    /// and below `limit`.
    fn join(&self, target: u32, limit: usize, threads: NonZero<usize>, found: &mut dyn FnMut(Vec<u16>)) {
        // A further thread is started only if there is enough work to be worth its start.
        let threads = if self.entries.len() < 1 << 20 { 1 } else { threads.get() };
        let next = AtomicUsize::new(0);
        let work = || {
            let mut words = Vec::new();
            let mut present = vec![0_u64; BUCKETS / 64];
            loop {
                let first = next.fetch_add(256, Ordering::Relaxed);
                if first >= self.occupied.len() {
                    return words;
                }
                for one in self.occupied[first..].iter().copied().take(256) {
                    let other = one ^ (target >> 16) as usize;
                    // Two buckets are joined once, whichever of them has the lower half of a word.
                    if one <= other {
                        let buckets = [one, other].map(|bucket| self.bucket(bucket, limit));
                        self.join_buckets(target as u16, buckets, one != other, &mut present, &mut words);
                    }
                }
            }
        };
        if threads == 1 {
            work().into_iter().for_each(found);
        } else {
            thread::scope(|scope| {
                let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
                workers.into_iter().flat_map(|worker| worker.join().expect("a worker does not panic")).for_each(found);
            });
        }
    }

    /// Finds the pairs of one half of each bucket. The lower half is in the first bucket or, if `both_ways`, in either.
    fn join_buckets(
        &self,
        target: u16,
        [one, other]: [&[u64]; 2],
        both_ways: bool,
        present: &mut [u64],
        words: &mut Vec<Vec<u16>>,
    ) {
        if one.is_empty() || other.is_empty() {
            return;
        }
        let low = |entry: u64| (entry >> 48) as u16;
        for entry in other {
            present[usize::from(low(*entry) >> 6)] |= 1 << (low(*entry) & 63);
        }
        for entry in one {
            let wanted = low(*entry) ^ target;
            if present[usize::from(wanted >> 6)] >> (wanted & 63) & 1 == 0 {
                continue;
            }
            for partner in other.iter().filter(|partner| low(**partner) == wanted) {
                if self.lies_below(*entry, *partner) {
                    words.push(self.places(*entry).chain(self.places(*partner)).collect());
                } else if both_ways && self.lies_below(*partner, *entry) {
                    words.push(self.places(*partner).chain(self.places(*entry)).collect());
                }
            }
        }
        for entry in other {
            present[usize::from(low(*entry) >> 6)] = 0;
        }
    }

    /// Says whether all positions of one half are below those of the other.
    fn lies_below(&self, lower: u64, upper: u64) -> bool {
        self.places(lower).last() < self.places(upper).next() || self.half == 0
    }

    fn places(&self, entry: u64) -> impl Iterator<Item = u16> {
        (0..self.half).rev().map(move |i| (entry >> (i * PLACE_BITS)) as u16 & ((1 << PLACE_BITS) - 1))
    }
}

/// Calls `visit` with the sum and the positions of every set of `size` columns, in the order of their highest position.
/// The first column is left out.
fn subsets(columns: &[u32], size: usize, visit: &mut dyn FnMut(u32, u64)) {
    fn below(
        columns: &[u32],
        limit: usize,
        size: usize,
        sum: u32,
        places: u64,
        shift: usize,
        visit: &mut dyn FnMut(u32, u64),
    ) {
        if size == 0 {
            visit(sum, places);
            return;
        }
        for place in size..limit {
            below(
                columns,
                place,
                size - 1,
                sum ^ columns[place],
                places | (place as u64) << shift,
                shift + PLACE_BITS,
                visit,
            );
        }
    }
    below(columns, columns.len(), size, 0, 0, 0, visit);
}

#[cfg(test)]
mod tests {
    use num_bigint::BigUint;

    use super::*;
    use crate::{DualWeights, Weights};

    const TWO: NonZero<usize> = NonZero::new(2).unwrap();

    #[test]
    fn words_are_codewords_and_as_many_as_the_dual_says() {
        for (degree, normal, length) in [
            (8, 0x07, 20),
            (10, 0x233, 20),
            (16, 0x1021, 30),
            (16, 0x3D65, 40),
            (20, 0x8_0005, 60),
            (24, 0x86_4CFB, 70),
        ] {
            let polynomial = Polynomial::from_normal(degree, normal).unwrap();
            let columns = polynomial.columns(length);
            let weights = Weights::from_dual(&DualWeights::count(polynomial, length, TWO, &|_| ()), degree).unwrap();
            for weight in 1..=MAX_WEIGHT {
                let words = Words::find(polynomial, length, weight, TWO);
                assert_eq!(
                    BigUint::from(words.count()),
                    weights.counts()[weight],
                    "{polynomial:?}, {weight} of {length} bits"
                );
                assert_eq!(words.everywhere().count() as u64, words.count());
                for word in words.everywhere().take(10_000) {
                    assert_eq!(word.len(), weight);
                    assert_eq!(word.iter().fold(0, |sum, place| sum ^ columns[usize::from(*place)]), 0);
                }
                assert!(words.starting_at_0().is_sorted_by(|a, b| a < b), "each once");
            }
        }
    }
}
