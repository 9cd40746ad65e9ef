//! Information criteria of least squares.

/// The Bayesian information criterion of a fit: `n_eff sum_t ln(rss_t / n) + k ln n_eff`, with `error` the sum of squares of every target on `rows` rows (or their weight), of which `independent`
/// count, and k the coefficients of all targets together ([Schwarz 1978]; the effective number of rows keeps what is correlated from counting twice).
///
/// [Schwarz 1978]: https://doi.org/10.1214/aos/1176344136
pub fn bic(error: &[f64], rows: f64, coefficients: usize, independent: f64) -> f64 {
    fitted(error, rows, independent) + coefficients as f64 * independent.ln()
}

/// Akaike's: `n_eff sum_t ln(rss_t / n) + 2 k`; see [`bic`].
pub fn aic(error: &[f64], rows: f64, coefficients: usize, independent: f64) -> f64 {
    fitted(error, rows, independent) + 2.0 * coefficients as f64
}

fn fitted(error: &[f64], rows: f64, independent: f64) -> f64 {
    let fit: f64 = error.iter().map(|error| (error / rows).max(f64::MIN_POSITIVE).ln()).sum();
    independent * fit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let (error, rows, independent) = ([2.0, 8.0], 4.0, 3.0);
        // 3 (ln 0.5 + ln 2) is nothing.
        assert!((bic(&error, rows, 5, independent) - 5.0 * 3f64.ln()).abs() < 1e-14);
        assert!((aic(&error, rows, 5, independent) - 10.0).abs() < 1e-14);
        assert!(bic(&[0.0], rows, 5, independent).is_finite());
    }
}
