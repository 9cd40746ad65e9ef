//! Intervals from the replicates of a bootstrap.

use faer::MatRef;

use super::InferenceError;
use crate::SparseError;

/// Interval of one coefficient from replicates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BootstrapInterval {
    /// Quantiles `(1 - level)/2` and `(1 + level)/2` of the replicates (Efron).
    pub percentile: [f64; 2],
    /// `2 estimate - quantile`, the upper quantile for the lower end (Davison and Hinkley 1997, equation (5.6)).
    pub basic: [f64; 2],
    /// Mean of the replicates less the estimate.
    pub bias: f64,
    /// Standard deviation of the replicates (divisor b - 1).
    pub deviation: f64,
    /// Share of the replicates that are not zero: the selection frequency, where replicates are sparse.
    pub frequency: f64,
}

/// Intervals at `level` (0.95) for every coefficient from the replicates' coefficients (b x p) and the estimate (p).
///
/// Quantiles interpolate between order statistics (type 7 of Hyndman and Fan 1996, the default of numpy). Replicates that selected a coefficient not at all hold
/// zeros, which count: the intervals then speak of selection and size together.
///
/// # Errors
/// When the estimate has not one entry a column, a value is not finite, there are fewer than two replicates, or the level lies outside (0, 1).
pub fn bootstrap_intervals(
    replicates: MatRef<'_, f64>,
    estimate: &[f64],
    level: f64,
) -> Result<Vec<BootstrapInterval>, InferenceError> {
    let (b, p) = replicates.shape();
    if estimate.len() != p {
        return Err(SparseError::Length { what: "the estimate", actual: estimate.len(), expected: p }.into());
    }
    if b < 2 {
        return Err(InferenceError::TooFewReplicates { replicates: b });
    }
    if !(level > 0.0 && level < 1.0) {
        return Err(InferenceError::Share { name: "the level", value: level });
    }
    let interval = |j: usize| {
        let mut values: Vec<f64> = (0..b).map(|i| replicates[(i, j)]).collect();
        if !(estimate[j].is_finite() && values.iter().all(|value| value.is_finite())) {
            return Err(InferenceError::NotFinite { column: j });
        }
        let mean = values.iter().sum::<f64>() / b as f64;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let frequency = values.iter().filter(|value| **value != 0.0).count() as f64 / b as f64;
        values.sort_by(f64::total_cmp);
        let (low, high) = (quantile(&values, 0.5 * (1.0 - level)), quantile(&values, 0.5 * (1.0 + level)));
        Ok(BootstrapInterval {
            percentile: [low, high],
            basic: [2.0 * estimate[j] - high, 2.0 * estimate[j] - low],
            bias: mean - estimate[j],
            deviation: (squares / (b - 1) as f64).sqrt(),
            frequency,
        })
    };
    (0..p).map(interval).collect()
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = share * (sorted.len() - 1) as f64;
    let below = (at.floor() as usize).min(sorted.len() - 1);
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (at - below as f64) * (sorted[above] - sorted[below])
}
