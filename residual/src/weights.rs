//! Calculates the weight distribution of a code from that of its dual, in exact integers.
//!
//! # MacWilliams' identity
//!
//! A linear code of length n with A_w words of weight w, and its dual with 2^r words, B_j of weight j, satisfy
//!
//! > Σ A_w z^w = 2^-r Σ B_j (1 - z)^j (1 + z)^(n - j)
//!
//! This identity is in F. J. MacWilliams, N. J. A. Sloane, *The Theory of Error-Correcting Codes*, chapter 5. Its right
//! side is evaluated in integers of any size, by Horner's rule in 1 - z. Wrong counts of the dual would show: every
//! coefficient must be divisible by 2^r and not negative, A_0 must be 1, and all A_w must add up to 2^(n - r).
use num_bigint::{BigInt, BigUint, Sign};

use crate::DualWeights;

/// The reason why a weight distribution cannot be that of a code's dual.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotADual {
    /// The number of words that were counted is not 2^r.
    #[error("the dual has {counted} words instead of 2^{check_bits}")]
    Words {
        /// The number of counted words.
        counted: u128,
        /// The number r of check bits.
        check_bits: u32,
    },
    /// The MacWilliams identity gives a fraction or a negative number where a count of codewords should be.
    #[error("the number of codewords of weight {weight} is not a natural number")]
    Count {
        /// The weight for which the MacWilliams identity gives no natural number.
        weight: usize,
    },
    /// The MacWilliams identity does not give exactly one word of weight 0, or not 2^(n - r) words in all.
    #[error("the codewords are not one of weight 0 and 2^{data_bits} in all")]
    Codewords {
        /// The number n - r of data bits.
        data_bits: usize,
    },
}

/// The number of codewords of each weight: A_0 to A_n, exactly.
///
/// The code is linear, so this is also the number of undetected error patterns of each weight in any object. The CRC's
/// start value and final exclusive or change all codewords alike and none of their distances.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Weights {
    counts: Vec<BigUint>,
    check_bits: u32,
}

impl Weights {
    /// Returns the weights of the code whose dual has the weights `dual`.
    ///
    /// # Errors
    ///
    /// [`NotADual`] if no code of `check_bits` check bits has such a dual.
    pub fn from_dual(dual: &DualWeights, check_bits: u32) -> Result<Self, NotADual> {
        let counted = dual.counts().iter().map(|count| u128::from(*count)).sum();
        if counted != 1 << check_bits {
            return Err(NotADual::Words { counted, check_bits });
        }
        let length = dual.length();
        // Horner's rule: for each j from n down to 0, the sum R is replaced by R (1 - z) + B_j (1 + z)^(n - j).
        let mut sum = vec![BigInt::ZERO; length + 1];
        let mut binomials = vec![BigInt::ZERO; length + 1];
        binomials[0] = BigInt::from(1);
        for (step, count) in dual.counts().iter().rev().enumerate() {
            if step > 0 {
                for i in (1..=step).rev() {
                    let (lower, upper) = sum.split_at_mut(i);
                    upper[0] -= &lower[i - 1];
                    let (lower, upper) = binomials.split_at_mut(i);
                    upper[0] += &lower[i - 1];
                }
            }
            if *count > 0 {
                for (term, binomial) in sum.iter_mut().zip(&binomials[..=step]) {
                    *term += binomial * *count;
                }
            }
        }
        let counts = sum
            .into_iter()
            .enumerate()
            .map(|(weight, total)| match total.into_parts() {
                (Sign::NoSign, _) => Ok(BigUint::ZERO),
                (Sign::Plus, total) if total.trailing_zeros() >= Some(u64::from(check_bits)) => Ok(total >> check_bits),
                _ => Err(NotADual::Count { weight }),
            })
            .collect::<Result<Vec<BigUint>, NotADual>>()?;
        let data_bits = length - check_bits as usize;
        if counts[0] != BigUint::from(1_u32) || counts.iter().sum::<BigUint>() != BigUint::from(1_u32) << data_bits {
            return Err(NotADual::Codewords { data_bits });
        }
        Ok(Self { counts, check_bits })
    }

    /// The numbers of codewords A_0 to A_n, in the order of weight.
    #[must_use]
    pub fn counts(&self) -> &[BigUint] {
        &self.counts
    }

    /// The length n of the codeword, bits.
    #[must_use]
    pub fn length(&self) -> usize {
        self.counts.len() - 1
    }

    /// The number r of check bits among the codeword's bits.
    #[must_use]
    pub fn check_bits(&self) -> u32 {
        self.check_bits
    }

    /// The Hamming distance: the least number of bit errors that can go undetected.
    #[must_use]
    pub fn hamming_distance(&self) -> usize {
        self.nonzero().map(|(weight, _)| weight).next().unwrap_or(self.length() + 1)
    }

    /// The weights above 0 that occur, and the number of codewords of each.
    pub fn nonzero(&self) -> impl Iterator<Item = (usize, &BigUint)> {
        self.counts.iter().enumerate().skip(1).filter(|(_, count)| **count != BigUint::ZERO)
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZero;

    use super::*;
    use crate::Polynomial;

    fn by_brute_force(polynomial: Polynomial, length: usize) -> Vec<BigUint> {
        let mut counts = vec![0_u64; length + 1];
        let data = length - polynomial.degree() as usize;
        for data in 0..1_u64 << data {
            // All codewords are counted, as multiples of the polynomial. Their order does not matter.
            let codeword = (0..length)
                .filter(|bit| data >> bit & 1 == 1)
                .fold(0_u64, |word, bit| word ^ polynomial.coefficients() << bit);
            counts[codeword.count_ones() as usize] += 1;
        }
        counts.into_iter().map(BigUint::from).collect()
    }

    fn weights(polynomial: Polynomial, length: usize) -> Weights {
        let dual = DualWeights::count(polynomial, length, NonZero::<usize>::MIN, &|_| ());
        Weights::from_dual(&dual, polynomial.degree()).unwrap()
    }

    #[test]
    fn weights_of_small_codes_are_those_of_all_their_codewords() {
        for (degree, normal) in [(1, 1), (4, 3), (8, 0x07), (8, 0x2F), (16, 0x1021), (16, 0x3D65)] {
            let polynomial = Polynomial::from_normal(degree, normal).unwrap();
            for length in [degree as usize + 1, degree as usize + 7, degree as usize + 18] {
                assert_eq!(
                    weights(polynomial, length).counts(),
                    by_brute_force(polynomial, length),
                    "{polynomial:?}, {length} bits"
                );
            }
        }
    }

    #[test]
    fn hamming_codes_have_the_weights_in_the_books() {
        // These are the [15, 11] Hamming code and its extension by a parity bit (MacWilliams, Sloane, chapter 1).
        let hamming = weights(Polynomial::from_normal(4, 3).unwrap(), 15);
        let expected = [1_u32, 0, 0, 35, 105, 168, 280, 435, 435, 280, 168, 105, 35, 0, 0, 1].map(BigUint::from);
        assert_eq!(hamming.counts(), expected);
        assert_eq!(hamming.hamming_distance(), 3);
    }

    #[test]
    fn a_distribution_with_one_word_misplaced_is_no_duals() {
        let polynomial = Polynomial::from_normal(16, 0x3D65).unwrap();
        let dual = DualWeights::count(polynomial, 100, NonZero::<usize>::MIN, &|_| ());
        for weight in 0..dual.length() {
            let mut counts = dual.counts().to_vec();
            if counts[weight] > 0 {
                counts[weight] -= 1;
                assert!(matches!(
                    Weights::from_dual(&DualWeights::from_counts(counts.clone()), 16),
                    Err(NotADual::Words { .. })
                ));
                counts[weight + 1] += 1;
                assert!(
                    Weights::from_dual(&DualWeights::from_counts(counts), 16).is_err(),
                    "one word from weight {weight} to the next"
                );
            }
        }
    }
}
