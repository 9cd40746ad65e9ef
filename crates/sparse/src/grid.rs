//! Grids of lambda: values in equal factors from the largest down.

use crate::SparseError;

pub(crate) fn check_grid(count: usize, ratio: f64) -> Result<(), SparseError> {
    if count == 0 || !(ratio > 0.0 && ratio <= 1.0) {
        return Err(SparseError::Grid { count, ratio });
    }
    Ok(())
}

/// `count` values from `largest` down to `ratio` of it.
pub(crate) fn equal_factors(largest: f64, count: usize, ratio: f64) -> Vec<f64> {
    let step = if count > 1 { ratio.ln() / (count - 1) as f64 } else { 0.0 };
    (0..count).map(|k| largest * (step * k as f64).exp()).collect()
}
