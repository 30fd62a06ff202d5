//! Bursts: errors confined to some consecutive bits.
//!
//! A burst of b bits has its first and last bit wrong and any pattern between them: 2^(b - 2) patterns. A burst goes
//! undetected if and only if it is a multiple of the polynomial, apart from a factor x^i. A polynomial of degree r has
//! no multiple of at most r bits, one of r + 1 bits, and 2^(b - r - 2) of b > r + 1 bits. So for any CRC of r bits
//! whose codeword is sent in the polynomial's own order:
//!
//! | bits | undetected |
//! |---|---|
//! | up to r | none |
//! | r + 1 | 1 of 2^(r - 1) |
//! | more | 1 of 2^r |
/// log2 of the fraction of all bursts of `bits` bits that a CRC with `check_bits` check bits does not detect; `None` if
/// it detects all.
///
/// All patterns of a burst count as equally probable, and the codeword is longer than the burst.
#[must_use]
pub const fn undetected_log2(check_bits: u32, bits: u32) -> Option<i64> {
    if bits <= check_bits {
        None
    } else if bits == check_bits + 1 {
        Some(1 - check_bits as i64)
    } else {
        Some(-(check_bits as i64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polynomial;

    #[test]
    fn bursts_of_small_crcs_go_undetected_as_often_as_counted() {
        for (degree, normal) in [(3, 3), (8, 0x07), (8, 0x2F), (10, 0x233)] {
            let polynomial = Polynomial::from_normal(degree, normal).unwrap();
            for bits in 2..=18 {
                let columns = polynomial.columns(bits as usize);
                let patterns = 1_u64 << (bits - 2);
                let undetected = (0..patterns)
                    .map(|inner| inner << 1 | 1 | 1 << (bits - 1))
                    .filter(|pattern| {
                        (0..bits as usize).filter(|i| pattern >> i & 1 == 1).fold(0, |sum, i| sum ^ columns[i]) == 0
                    })
                    .count();
                let expected =
                    undetected_log2(degree, bits).map_or(0.0, |log2| patterns as f64 * 2_f64.powi(log2 as i32));
                assert_eq!(undetected as f64, expected, "{polynomial:?}, {bits} bits");
            }
        }
    }
}
