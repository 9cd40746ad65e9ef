//! Distance of a distribution over bins from the uniform one.

/// Non-uniformity of a distribution, given by weights of any sum: `(norm sqrt(d) - 1) / (sqrt(d) - 1)` with the Euclidean norm
/// of the normalised weights and their number d. 0 is uniform, 1 is all in one bin; NaN with fewer than 2 bins or without
/// weight. Towards Sim-to-Real via Real-to-Sim, section 6.4.
///
/// A finite number n of independent samples of the uniform distribution has `sqrt(1 + (d - 1) / n)` in place of
/// `norm sqrt(d)`, in the mean of its square: only values above what that makes tell anything.
pub fn nonuniformity(weights: impl IntoIterator<Item = f64>) -> f64 {
    let (mut count, mut sum, mut squares) = (0.0f64, 0.0, 0.0f64);
    for weight in weights {
        count += 1.0;
        sum += weight;
        squares += weight * weight;
    }
    if count < 2.0 || sum == 0.0 {
        return f64::NAN;
    }
    let norm = squares.sqrt() / sum;
    (norm * count.sqrt() - 1.0) / (count.sqrt() - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nonuniformity_ranges_from_zero_to_one() {
        assert!(nonuniformity([3.0; 7]).abs() < 1e-15);
        assert!((nonuniformity([0.0, 0.0, 5.0, 0.0]) - 1.0).abs() < 1e-15);
        // Half of the bins: norm = 1 / sqrt(2), d = 4: (sqrt 2 - 1) / (2 - 1).
        assert!((nonuniformity([1.0, 0.0, 1.0, 0.0]) - (2f64.sqrt() - 1.0)).abs() < 1e-15);
        assert!(nonuniformity([0.0; 4]).is_nan() && nonuniformity([1.0]).is_nan());
    }
}
