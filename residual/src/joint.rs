//! The two CRCs, one inside the other, that protect latitude and longitude in Reported-Position.
//!
//! # The code
//!
//! Bytes 8 to 27 of Reported-Position are a codeword of the position CRC, and all 64 bytes are one of the frame CRC: 64
//! check bits, 448 data bits. Errors go undetected if and only if their pattern is a codeword of the outer code *and*
//! its part in bytes 8 to 27 is one of the inner code. Two distances are of interest:
//!
//! - The distance of patterns that damage latitude or longitude, *and possibly other bits*: [`Joint::distance`]. Their
//!   part in bytes 8 to 27 is a codeword other than 0.
//! - The distance of all patterns is that of the outer code.
//!
//! # The method
//!
//! The dual of the joint code has 2^64 words, too many to count. But a word of low weight consists of an inner codeword
//! of low weight and of a few bits elsewhere, and both parts have the same syndrome in the outer code. The inner code
//! has no words below its distance and few just above it. So the search finds all inner words of weight up to
//! [`MAX_WEIGHT`] ([`Words`]). It looks up the outer syndrome of each among the sums of 0, 1, 2, 3 columns of the 352
//! bits elsewhere. From the smallest total weight on, each combination of a weight inside and one outside either has a
//! word or is excluded. An odd total weight needs no search if x + 1 divides the outer polynomial.
use std::collections::HashMap;
use std::num::NonZero;

use crate::{MAX_WEIGHT, Polynomial, Words};

/// The greatest number of wrong bits outside the inner codeword that the search considers.
const MAX_OUTSIDE: usize = 3;

/// An inner codeword inside an outer one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Nesting {
    /// The outer polynomial.
    pub outer: Polynomial,
    /// The length of the outer codeword, bits.
    pub outer_bits: usize,
    /// The inner polynomial.
    pub inner: Polynomial,
    /// The length of the inner codeword, bits.
    pub inner_bits: usize,
    /// The number of bits that are sent between the ends of the inner and of the outer codeword.
    pub bits_after: usize,
}

impl Nesting {
    /// Latitude, longitude and the position CRC in Reported-Position.
    pub const REPORTED_POSITION: Self = Self {
        outer: crate::codes::FRAME.polynomial,
        outer_bits: crate::codes::REPORTED_BITS,
        inner: crate::codes::POSITION.polynomial,
        inner_bits: crate::codes::POSITION_BITS,
        bits_after: 8 * 36,
    };
}

/// One number of wrong bits inside and one outside the inner codeword, with the result of the search for such errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Examined {
    /// The number of wrong bits in the inner codeword.
    pub inside: usize,
    /// The number of wrong bits elsewhere in the outer codeword.
    pub outside: usize,
    /// The number of inner codewords with `inside` ones, each of which was tested.
    pub candidates: u64,
    /// The number of words of the joint code that were found with these two weights.
    pub words: u64,
}

/// The least number of errors that both CRCs fail to detect and that damage the inner codeword.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Joint {
    /// The least weight of a joint codeword with an inner part other than 0; `None` if the search ended before.
    pub distance: Option<usize>,
    /// The weight below which all weights are proved to have no words: the distance, if it is known.
    pub at_least: usize,
    /// The combinations of weights that were searched, by total weight.
    pub examined: Vec<Examined>,
    /// The words of the least weight that were found in the combinations in `examined`. Each word is given by the set
    /// bits of the outer codeword, counted from the last bit sent. Words with more errors inside may exist besides
    /// these.
    pub words: Vec<Vec<u16>>,
}

impl Joint {
    /// Searches by total weight until a weight has words, or a combination of weights cannot be searched.
    #[must_use]
    pub fn search(nesting: &Nesting, threads: NonZero<usize>) -> Self {
        let columns = nesting.outer.columns(nesting.outer_bits);
        let inside = nesting.bits_after..nesting.bits_after + nesting.inner_bits;
        let outside: Vec<u16> =
            (0..nesting.outer_bits).filter(|place| !inside.contains(place)).map(|place| place as u16).collect();
        let outside = Outside::new(&columns, outside);
        let mut examined = Vec::new();
        let mut inner_words: Vec<Words> = Vec::new();
        for total in 1.. {
            if nesting.outer.is_even() && total % 2 == 1 {
                continue;
            }
            let mut words = Vec::new();
            let mut complete = true;
            for weight in 1..=total {
                if weight > MAX_WEIGHT || total - weight > MAX_OUTSIDE {
                    // The search cannot reach this many errors inside or outside. They are excluded only if no inner
                    // codeword has this weight.
                    complete &= weight <= MAX_WEIGHT
                        && words_of(&mut inner_words, nesting, weight, threads).starting_at_0().is_empty();
                    continue;
                }
                let inner = words_of(&mut inner_words, nesting, weight, threads);
                let before = words.len();
                for word in inner.everywhere() {
                    let shifted: Vec<u16> = word.iter().map(|place| place + nesting.bits_after as u16).collect();
                    let syndrome = shifted.iter().fold(0, |sum, place| sum ^ columns[usize::from(*place)]);
                    outside.sums_to(syndrome, total - weight, &mut |places| {
                        let mut joint = shifted.clone();
                        joint.extend_from_slice(places);
                        joint.sort_unstable();
                        words.push(joint);
                    });
                }
                let candidates = inner.count();
                if candidates > 0 {
                    examined.push(Examined {
                        inside: weight,
                        outside: total - weight,
                        candidates,
                        words: (words.len() - before) as u64,
                    });
                }
            }
            if !words.is_empty() {
                words.sort_unstable();
                // This is the smallest total weight, because the search goes from small to large.
                return Self { distance: Some(total), at_least: total, examined, words };
            }
            if !complete {
                return Self { distance: None, at_least: total, examined, words };
            }
        }
        unreachable!("the loop ends at the latest when a weight is out of reach")
    }
}

fn words_of<'a>(found: &'a mut Vec<Words>, nesting: &Nesting, weight: usize, threads: NonZero<usize>) -> &'a Words {
    while found.len() < weight {
        found.push(Words::find(nesting.inner, nesting.inner_bits, found.len() + 1, threads));
    }
    &found[weight - 1]
}

/// The sums of up to three columns of bits outside the inner codeword.
struct Outside {
    places: Vec<u16>,
    columns: Vec<u32>,
    singles: HashMap<u32, u16>,
    pairs: HashMap<u32, Vec<[u16; 2]>>,
}

impl Outside {
    fn new(columns: &[u32], places: Vec<u16>) -> Self {
        let columns: Vec<u32> = places.iter().map(|place| columns[usize::from(*place)]).collect();
        let mut pairs: HashMap<u32, Vec<[u16; 2]>> = HashMap::new();
        for b in 0..places.len() {
            for a in 0..b {
                pairs.entry(columns[a] ^ columns[b]).or_default().push([places[a], places[b]]);
            }
        }
        let singles = columns.iter().copied().zip(places.iter().copied()).collect();
        Self { places, columns, singles, pairs }
    }

    /// Finds every set of `count` positions, in rising order, whose columns add up to `sum`.
    fn sums_to(&self, sum: u32, count: usize, found: &mut dyn FnMut(&[u16])) {
        match count {
            0 => {
                if sum == 0 {
                    found(&[]);
                }
            }
            1 => {
                if let Some(place) = self.singles.get(&sum) {
                    found(&[*place]);
                }
            }
            2 => self.pairs.get(&sum).into_iter().flatten().for_each(|pair| found(pair)),
            _ => {
                for (column, first) in self.columns.iter().zip(&self.places) {
                    for pair in self.pairs.get(&(sum ^ column)).into_iter().flatten().filter(|pair| pair[0] > *first) {
                        found(&[*first, pair[0], pair[1]]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: NonZero<usize> = NonZero::new(2).unwrap();

    fn by_brute_force(nesting: &Nesting) -> (usize, usize) {
        let outer = nesting.outer.columns(nesting.outer_bits);
        let inner = nesting.inner.columns(nesting.inner_bits);
        let sum = |columns: &[u32], word: u64| {
            columns.iter().enumerate().filter(|(i, _)| word >> i & 1 == 1).fold(0, |sum, (_, column)| sum ^ column)
        };
        let mut weights = vec![0; nesting.outer_bits + 1];
        for word in 0..1_u64 << nesting.outer_bits {
            let inside = word >> nesting.bits_after & ((1 << nesting.inner_bits) - 1);
            if inside != 0 && sum(&inner, inside) == 0 && sum(&outer, word) == 0 {
                weights[word.count_ones() as usize] += 1;
            }
        }
        weights.into_iter().enumerate().find(|(_, count)| *count > 0).unwrap()
    }

    #[test]
    fn the_distance_of_small_nestings_is_that_of_all_their_words() {
        for (outer, inner) in [((4, 3), (3, 3)), ((5, 0x0B), (4, 3)), ((6, 0x03), (4, 0x0F)), ((5, 0x15), (5, 0x05))] {
            let nesting = Nesting {
                outer: Polynomial::from_normal(outer.0, outer.1).unwrap(),
                outer_bits: 20,
                inner: Polynomial::from_normal(inner.0, inner.1).unwrap(),
                inner_bits: 10,
                bits_after: 7,
            };
            let joint = Joint::search(&nesting, TWO);
            let (distance, count) = by_brute_force(&nesting);
            assert!(joint.at_least <= distance);
            if let Some(found) = joint.distance {
                assert_eq!(found, distance, "{nesting:?}");
                assert!(joint.words.len() <= count);
                let reach = joint
                    .examined
                    .iter()
                    .filter(|examined| examined.inside + examined.outside == found)
                    .map(|examined| examined.words)
                    .sum::<u64>();
                assert_eq!(joint.words.len() as u64, reach);
            }
        }
    }
}
