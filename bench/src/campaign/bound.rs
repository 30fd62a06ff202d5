//! Confidence bounds of a rate.

use statrs::distribution::{Beta, ContinuousCDF};

/// Returns the exact (Clopper and Pearson 1934) two-sided confidence interval at 95 % of the rate of an event that
/// occurred in `seen` of `tried` independent trials. Without a trial the interval is 0 to 1.
///
/// # Panics
///
/// Panics if more events were seen than trials.
#[must_use]
pub fn clopper_pearson(seen: u64, tried: u64) -> (f64, f64) {
    const TAIL: f64 = 0.025;
    assert!(seen <= tried, "{seen} events in {tried} trials");
    let quantile = |a: u64, b: u64, at: f64| {
        let beta = Beta::new(a as f64, b as f64).expect("both shapes are above zero");
        beta.inverse_cdf(at)
    };
    let lower = if seen == 0 { 0.0 } else { quantile(seen, tried - seen + 1, TAIL) };
    let upper = if seen == tried { 1.0 } else { quantile(seen + 1, tried - seen, 1.0 - TAIL) };
    (lower, upper)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bound is where the tail of the binomial distribution, summed term by term, is 2.5 %.
    fn tail_below(seen: u64, tried: u64, rate: f64) -> f64 {
        let ln_choose = |k: u64| (1..=k).map(|i| (((tried - k + i) as f64) / i as f64).ln()).sum::<f64>();
        let term = |k: u64| (ln_choose(k) + k as f64 * rate.ln() + (tried - k) as f64 * (-rate).ln_1p()).exp();
        (0..=seen).map(term).sum()
    }

    #[test]
    fn the_interval_is_that_of_published_tables() {
        // Clopper and Pearson, Biometrika 26 (1934); 0 of 100: 1 - 0.025^(1/100). 10 of 20 and 1 of 10: Fleiss,
        // Statistical Methods for Rates and Proportions; R's binom.test gives the same digits.
        for (seen, tried, lower, upper) in [
            (0, 100, 0.0, 0.036_216_69),
            (0, 10, 0.0, 0.308_497_1),
            (1, 10, 0.002_528_579, 0.445_016_1),
            (10, 20, 0.271_957_8, 0.728_042_2),
            (10, 10, 0.691_502_9, 1.0),
            (0, 0, 0.0, 1.0),
        ] {
            let (low, high) = clopper_pearson(seen, tried);
            assert!((low - lower).abs() < 1e-6 && (high - upper).abs() < 1e-6, "{seen} of {tried}: {low} {high}");
        }
    }

    #[test]
    fn each_end_leaves_a_tail_of_one_fortieth() {
        for (seen, tried) in [(0, 3), (1, 50), (4, 100), (3, 20_000), (250, 1_000)] {
            let (low, high) = clopper_pearson(seen, tried);
            assert!((tail_below(seen, tried, high) - 0.025).abs() < 1e-6, "{seen} of {tried} above");
            if seen > 0 {
                assert!((1.0 - tail_below(seen - 1, tried, low) - 0.025).abs() < 1e-6, "{seen} of {tried} below");
            }
        }
    }
}
