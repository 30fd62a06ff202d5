//! Generator polynomials in their two notations.
use std::fmt;

/// A CRC's generator polynomial over GF(2), of degree 1 to 32 and with constant term 1.
///
/// # Notation
///
/// A polynomial of degree r has r + 1 coefficients, of which the first and the last are always set. To fit r bits, the
/// usual notation ("normal", "implicit x^r", the `crc` crate's `poly`) omits the highest, and Koopman's notation
/// ("implicit +1") the lowest. The same digits mean two codes in the two notations, and either code passes every
/// round-trip test. Only distances and check values distinguish them.
///
/// ```
/// use residual::Polynomial;
///
/// let frame = Polynomial::from_koopman(32, 0xF8C9_140A).unwrap();
/// assert_eq!(frame, Polynomial::from_normal(32, 0xF192_2815).unwrap());
/// assert_eq!(frame.koopman(), 0xF8C9_140A);
/// assert_ne!(frame, Polynomial::from_normal(32, 0xF8C9_140A + 1).unwrap());
/// ```
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Polynomial {
    coefficients: u64,
}

impl Polynomial {
    /// Returns the polynomial whose coefficients x^degree to x^1 are `value`'s bits, the highest first.
    ///
    /// Returns `None` if the degree is not 1 to 32, or if `value` is not of that degree and so is in another notation.
    #[must_use]
    pub const fn from_koopman(degree: u32, value: u32) -> Option<Self> {
        if degree < 1 || degree > 32 || 32 - value.leading_zeros() != degree {
            return None;
        }
        Some(Self { coefficients: (value as u64) << 1 | 1 })
    }

    /// Returns the polynomial whose coefficients x^(degree - 1) to x^0 are `value`'s bits, the highest first.
    ///
    /// Returns `None` if the degree is not 1 to 32, if `value` has more bits than that, or if its constant term is 0:
    /// no CRC's polynomial is divisible by x.
    #[must_use]
    pub const fn from_normal(degree: u32, value: u32) -> Option<Self> {
        if degree < 1 || degree > 32 || 32 - value.leading_zeros() > degree || value & 1 == 0 {
            return None;
        }
        Some(Self { coefficients: 1 << degree | value as u64 })
    }

    /// The number of check bits.
    #[must_use]
    pub const fn degree(self) -> u32 {
        63 - self.coefficients.leading_zeros()
    }

    /// The polynomial in Koopman's notation, without the lowest coefficient.
    #[must_use]
    pub const fn koopman(self) -> u32 {
        (self.coefficients >> 1) as u32
    }

    /// The polynomial in the usual notation, without the highest coefficient.
    #[must_use]
    pub const fn normal(self) -> u32 {
        (self.coefficients ^ 1 << self.degree()) as u32
    }

    /// All coefficients of the polynomial; that of x^i is bit i.
    #[must_use]
    pub const fn coefficients(self) -> u64 {
        self.coefficients
    }

    /// Whether x + 1 divides the polynomial. If so, every codeword has an even number of ones, and every odd number of
    /// errors is detected.
    #[must_use]
    pub const fn is_even(self) -> bool {
        self.coefficients.count_ones().is_multiple_of(2)
    }

    /// The remainders of x^0, x^1, … x^(length - 1): the columns of the parity-check matrix.
    ///
    /// Column i is the syndrome of an error in the bit that is sent i bits before the last. Errors go undetected if and
    /// only if the columns of the wrong bits add up to 0.
    #[must_use]
    pub fn columns(self, length: usize) -> Vec<u32> {
        let mut power = 1_u64;
        (0..length)
            .map(|_| {
                let column = power as u32;
                power <<= 1;
                if power >> self.degree() & 1 == 1 {
                    power ^= self.coefficients;
                }
                column
            })
            .collect()
    }

    /// The degree of the greatest common divisor of this polynomial and `other`; 0 if they have no common factor.
    #[must_use]
    pub const fn common_degree(self, other: Self) -> u32 {
        let (mut a, mut b) = (self.coefficients, other.coefficients);
        while b != 0 {
            while a != 0 && a.leading_zeros() <= b.leading_zeros() {
                a ^= b << (b.leading_zeros() - a.leading_zeros());
            }
            (a, b) = (b, a);
        }
        63 - a.leading_zeros()
    }
}

/// Koopman's notation, as in the paper.
impl fmt::Display for Polynomial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:#0width$x}", self.koopman(), width = 2 + self.degree().div_ceil(4) as usize)
    }
}

impl fmt::Debug for Polynomial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Polynomial({self} Koopman, {:#x} normal)", self.normal())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the remainder of x^i divided by g, by long division. It checks the remainders that the shift register
    /// gives.
    fn remainder(g: u64, exponent: u32) -> u32 {
        let degree = 63 - g.leading_zeros();
        let mut dividend = 1_u128 << exponent;
        while dividend >> degree != 0 {
            let top = 127 - dividend.leading_zeros();
            dividend ^= u128::from(g) << (top - degree);
        }
        dividend as u32
    }

    #[test]
    fn columns_are_the_remainders_of_the_powers_of_x() {
        for polynomial in [
            Polynomial::from_normal(32, 0x04C1_1DB7).unwrap(),
            Polynomial::from_normal(8, 0x07).unwrap(),
            Polynomial::from_normal(1, 1).unwrap(),
        ] {
            for (i, column) in polynomial.columns(100).into_iter().enumerate() {
                assert_eq!(column, remainder(polynomial.coefficients(), i as u32), "{polynomial:?}, x^{i}");
            }
        }
    }

    #[test]
    fn digits_of_another_degree_or_notation_are_refused() {
        assert_eq!(Polynomial::from_koopman(32, 0x04C1_1DB7), None, "normal digits: no x^32");
        assert_eq!(Polynomial::from_normal(32, 0x8260_8EDA), None, "Koopman digits of an even value: no x^0");
        assert_eq!(Polynomial::from_normal(8, 0x1D5), None);
        assert_eq!(Polynomial::from_koopman(33, 1), None);
        assert_eq!(Polynomial::from_koopman(0, 0), None);
    }

    #[test]
    fn common_factors_are_found() {
        let of = |degree, normal| Polynomial::from_normal(degree, normal).unwrap();
        assert_eq!(of(3, 1).common_degree(of(2, 1)), 1);
        assert_eq!(of(3, 1).common_degree(of(2, 3)), 2);
        assert_eq!(of(2, 1).common_degree(of(2, 3)), 0);
        assert_eq!(of(3, 1).common_degree(of(3, 1)), 3);
    }

    #[test]
    fn evenness_is_divisibility_by_x_plus_1() {
        let x_plus_1 = Polynomial::from_normal(1, 1).unwrap();
        for normal in (1..=u32::from(u8::MAX)).step_by(2) {
            let polynomial = Polynomial::from_normal(8, normal).unwrap();
            assert_eq!(polynomial.is_even(), polynomial.common_degree(x_plus_1) == 1);
        }
    }
}
