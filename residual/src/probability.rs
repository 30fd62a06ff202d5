//! The probability of an undetected error as a function of the bit error rate.
//!
//! # Model
//!
//! Each bit of a codeword of n bits is wrong with probability p, independently of all others: the binary symmetric
//! channel of IEC 61784-3. Then
//!
//! > P_ud(p) = Σ A_w p^w (1 - p)^(n - w), w from the Hamming distance to n
//!
//! A_w is the number of codewords of weight w. All A_w are known exactly.
//!
//! **Conditional probability.** P_re,cond(p) = P_ud(p) / (1 - (1 - p)^n) is the fraction of damaged codewords that goes
//! undetected. The rate of residual errors is P_re,cond times the rate of damaged messages, from any cause. OPC UA
//! Safety (OPC 10000-15, 9.3) bounds P_re,cond by 4.0e-10 for its own CRC.
//!
//! **Precision.** [`undetected_exactly`] adds fractions of integers; tables have its results, rounded once.
//! [`ErrorCurve`] gives curves, maxima and crossings. It adds the terms in binary64 from their logarithms, with a
//! relative error below 1e-11, which a test checks.
use std::f64::consts::LN_2;
use std::fmt;

use num_bigint::BigUint;

use crate::Weights;

/// A bit error rate as a decimal: `digit` · 10^-`decade`, so that 1e-3 is exactly 1/1000.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitErrorRate {
    /// The digit of the bit error rate, 1 to 9.
    pub digit: u32,
    /// The negative exponent of ten of the bit error rate, 1 to 9.
    pub decade: u32,
}

impl BitErrorRate {
    /// The bit error rate that IEC 61784-3 assumes if no lower one is proved: 1e-2.
    pub const CONVENTIONAL: Self = Self { digit: 1, decade: 2 };

    /// The bit error rates in the tables: 1e-6 to 5e-1 in steps of 1, 2, 5.
    pub fn tabulated() -> impl Iterator<Item = Self> {
        (1..=6).rev().flat_map(|decade| [1, 2, 5].map(|digit| Self { digit, decade }))
    }

    /// The bit error rate as a binary64.
    #[must_use]
    pub fn value(self) -> f64 {
        f64::from(self.digit) / 10_f64.powi(self.decade as i32)
    }
}

impl fmt::Display for BitErrorRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}e-{}", self.digit, self.decade)
    }
}

/// P_ud at a bit error rate, calculated exactly and then rounded to binary64 (toward zero, by less than one part in
/// 2^52).
#[must_use]
pub fn undetected_exactly(weights: &Weights, rate: BitErrorRate) -> f64 {
    let denominator = 10_u32.pow(rate.decade);
    let (wrong, right) = (BigUint::from(rate.digit), BigUint::from(denominator - rate.digit));
    // Horner's rule, from w = n on, gives Σ A_w a^w b^(n - w), where a / b = p / (1 - p).
    let mut sum = BigUint::ZERO;
    let mut power = BigUint::from(1_u32);
    let undetected = weights.counts().iter().skip(1);
    for count in undetected.rev() {
        sum = sum * &wrong + count * &power;
        power *= &right;
    }
    quotient(sum * wrong, &BigUint::from(denominator).pow(weights.length() as u32))
}

/// Returns `numerator / denominator`, calculated to 64 bits before it is converted to a binary64.
fn quotient(numerator: BigUint, denominator: &BigUint) -> f64 {
    if numerator == BigUint::ZERO {
        return 0.0;
    }
    let shift = (64 + denominator.bits()).saturating_sub(numerator.bits());
    let digits = (numerator << shift) / denominator;
    // The result is scaled by mantissa and exponent, because 2^-shift alone may be below the smallest binary64.
    let (mantissa, exponent) = scientific(&digits);
    mantissa * 2_f64.powi((exponent as i64 - shift as i64) as i32)
}

/// Splits `value` into a mantissa from 1 to 2 and the exponent of a power of 2.
fn scientific(value: &BigUint) -> (f64, u64) {
    let exponent = value.bits() - 1;
    let top = if exponent > 63 { value >> (exponent - 63) } else { value << (63 - exponent) };
    let top = top.iter_u64_digits().next().unwrap_or(0);
    ((top >> 11) as f64 / 2_f64.powi(52), exponent)
}

/// P_ud and P_re,cond of a code as functions of the bit error rate.
#[derive(Clone, Debug)]
pub struct ErrorCurve {
    length: usize,
    /// The pairs (w, ln A_w) for every weight w of which there are codewords.
    terms: Vec<(f64, f64)>,
}

impl ErrorCurve {
    /// Returns the curve of the code with these weights.
    #[must_use]
    pub fn new(weights: &Weights) -> Self {
        let terms = weights
            .nonzero()
            .map(|(weight, count)| {
                let (mantissa, exponent) = scientific(count);
                (weight as f64, mantissa.ln() + exponent as f64 * LN_2)
            })
            .collect();
        Self { length: weights.length(), terms }
    }

    /// P_ud at a bit error rate of `p`, 0 < p < 1.
    #[must_use]
    pub fn undetected(&self, p: f64) -> f64 {
        let (wrong, right) = (p.ln(), (-p).ln_1p());
        let length = self.length as f64;
        self.terms.iter().map(|(weight, count)| (count + weight * wrong + (length - weight) * right).exp()).sum()
    }

    /// The probability that at least one bit of the codeword is wrong, at a bit error rate of `p`.
    #[must_use]
    pub fn damaged(&self, p: f64) -> f64 {
        -(self.length as f64 * (-p).ln_1p()).exp_m1()
    }

    /// P_re,cond, the probability that a damaged codeword goes undetected, at a bit error rate of `p`.
    #[must_use]
    pub fn conditional(&self, p: f64) -> f64 {
        self.undetected(p) / self.damaged(p)
    }

    /// The largest P_ud at rates p from 1e-6 to 0.5, and the rate at which P_ud has that value.
    #[must_use]
    pub fn maximum(&self) -> Maximum {
        maximum(|p| self.undetected(p))
    }

    /// The largest P_re,cond at rates p from 1e-6 to 0.5, and the rate at which P_re,cond has that value.
    #[must_use]
    pub fn conditional_maximum(&self) -> Maximum {
        maximum(|p| self.conditional(p))
    }
}

/// The largest value of a function of the bit error rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Maximum {
    /// The bit error rate of the maximum: the least of 200 rates per decade at which the function is within a millionth
    /// of its largest value. On a plateau, rounding errors alone would determine the rate of the largest value.
    pub bit_error_rate: f64,
    /// The largest value of the function.
    pub value: f64,
}

/// The number of search steps per decade of the bit error rate. The maxima of P_ud are as wide as the binomial
/// distribution's, a tenth of a decade or more at these lengths, so none lies between two steps.
const STEPS_PER_DECADE: u32 = 200;
const LOWEST: f64 = 1e-6;
const HIGHEST: f64 = 0.5;

/// The bit error rates from 1e-6 to 0.5, evenly on a logarithmic scale, both ends included.
pub fn logarithmic(steps_per_decade: u32) -> impl DoubleEndedIterator<Item = f64> {
    let decades = (HIGHEST / LOWEST).log10();
    let steps = (decades * f64::from(steps_per_decade)).ceil() as u32;
    (0..=steps).map(move |step| {
        if step == steps { HIGHEST } else { LOWEST * 10_f64.powf(f64::from(step) * decades / f64::from(steps)) }
    })
}

fn maximum(function: impl Fn(f64) -> f64) -> Maximum {
    let rates: Vec<f64> = logarithmic(STEPS_PER_DECADE).collect();
    let values: Vec<f64> = rates.iter().map(|p| function(*p)).collect();
    let best = (0..rates.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])).unwrap_or(0);
    // The golden-section search covers the interval between the neighbours of the best rate.
    let (mut low, mut high) = (rates[best.saturating_sub(1)], rates[(best + 1).min(rates.len() - 1)]);
    let golden = (5_f64.sqrt() - 1.0) / 2.0;
    let mut value = values[best];
    for _ in 0..60 {
        let (left, right) = (high - golden * (high - low), low + golden * (high - low));
        let (at_left, at_right) = (function(left), function(right));
        value = value.max(at_left).max(at_right);
        if at_left > at_right { high = right } else { low = left }
    }
    let near = values.iter().position(|at| *at >= value * (1.0 - 1e-6)).unwrap_or(best);
    Maximum { bit_error_rate: rates[near], value }
}

#[cfg(test)]
mod tests {
    use std::num::NonZero;

    use super::*;
    use crate::{DualWeights, Polynomial};

    fn weights(degree: u32, normal: u32, length: usize) -> Weights {
        let dual = DualWeights::count(
            Polynomial::from_normal(degree, normal).unwrap(),
            length,
            NonZero::<usize>::MIN,
            &|_| (),
        );
        Weights::from_dual(&dual, degree).unwrap()
    }

    #[test]
    fn fractions_and_logarithms_agree() {
        for weights in [weights(8, 0x07, 40), weights(16, 0x1021, 200), weights(16, 0x3D65, 512)] {
            let curve = ErrorCurve::new(&weights);
            for rate in BitErrorRate::tabulated() {
                let (exact, fast) = (undetected_exactly(&weights, rate), curve.undetected(rate.value()));
                assert!((fast / exact - 1.0).abs() < 1e-11, "{rate}: {exact:e}, {fast:e}");
            }
        }
    }

    #[test]
    fn at_one_half_every_word_is_as_probable_as_any() {
        // In a code of n bits with k data bits, 2^k - 1 of the 2^n error patterns change a codeword into another one.
        let exact = undetected_exactly(&weights(8, 0x07, 24), BitErrorRate { digit: 5, decade: 1 });
        assert_eq!(exact, 65_535.0 / 16_777_216.0);
    }

    #[test]
    fn a_parity_bit_misses_every_even_number_of_errors() {
        // The code of one parity bit has P_ud = (1 + (1 - 2p)^n) / 2 - (1 - p)^n.
        let curve = ErrorCurve::new(&weights(1, 1, 9));
        for p in [1e-6, 1e-3, 0.1, 0.4] {
            let (q, n) = (1.0 - p, 9);
            let expected: f64 = (1..=4)
                .map(|i| [36.0, 126.0, 84.0, 9.0][i - 1] * f64::powi(p, 2 * i as i32) * f64::powi(q, n - 2 * i as i32))
                .sum();
            assert!((curve.undetected(p) / expected - 1.0).abs() < 1e-12);
            assert!((curve.damaged(p) / (1.0 - q.powi(n)) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn the_maximum_is_found_inside_the_range_and_at_its_end() {
        let inside = maximum(|p| 1.0 - (p.ln() - 0.0123_f64.ln()).powi(2));
        assert!((inside.bit_error_rate / 0.0123 - 1.0).abs() < 0.02, "{inside:?}");
        assert!((inside.value - 1.0).abs() < 1e-12);
        let rising = maximum(|p| p);
        assert_eq!((rising.bit_error_rate, rising.value), (0.5, 0.5));
        let plateau = maximum(|p| p.min(1e-3));
        assert!((plateau.bit_error_rate / 1e-3 - 1.0).abs() < 0.02 && plateau.value == 1e-3);
        // The code of x^8 + 1 does not detect two errors that are eight bits apart. So it is worse with a few errors
        // than with many.
        let curve = ErrorCurve::new(&weights(8, 0x01, 40));
        let worst = logarithmic(1000).map(|p| curve.undetected(p)).fold(0.0, f64::max);
        assert!((1.0 - 1e-12..1.0 + 1e-4).contains(&(curve.maximum().value / worst)));
        assert!(curve.maximum().bit_error_rate < 0.4 && worst > 1.001 * curve.undetected(0.5));
    }

    #[test]
    fn decimals_are_written_as_they_are_read() {
        let all: Vec<String> = BitErrorRate::tabulated().map(|rate| rate.to_string()).collect();
        assert_eq!((all.first().unwrap().as_str(), all.last().unwrap().as_str(), all.len()), ("1e-6", "5e-1", 18));
        assert!(BitErrorRate::tabulated().all(|rate| rate.to_string().parse::<f64>() == Ok(rate.value())));
    }
}
