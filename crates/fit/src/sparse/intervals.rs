//! Percentile intervals of coefficients over the replicates of a bolasso.

use faer::MatRef;
use fleetfoot_sparse::{bolasso::Selection, inference::bootstrap_intervals};

use crate::error::Error;

/// Share of the replicates between the ends.
const LEVEL: f64 = 0.95;

/// Percentile 95 % interval of every column of a support, ascending, over the replicates that selected it; `None` where fewer than two did.
///
/// Replicates are lassos: the intervals are of `lasso` (p), the coefficients shrunk by lambda, not of the least squares that follows the selection.
pub(super) fn percentile_intervals(
    replicates: &Selection,
    support: &[usize],
    lasso: &[f64],
) -> Result<Vec<Option<[f64; 2]>>, Error> {
    let of = |&j: &usize| {
        let column = replicates.coefficients.as_ref().col(j);
        // Zeros would speak of the selection, which the frequency does already.
        let values: Vec<f64> = column.iter().copied().filter(|value| *value != 0.0).collect();
        if values.len() < 2 {
            return Ok(None);
        }
        let values = MatRef::from_column_major_slice(&values, values.len(), 1);
        Ok(bootstrap_intervals(values, &[lasso[j]], LEVEL)?
            .first()
            .map(|bootstrap_interval| bootstrap_interval.percentile))
    };
    support.iter().map(of).collect()
}
