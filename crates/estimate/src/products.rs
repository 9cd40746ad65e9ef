//! Least squares from the products J'J and J'r of many rows.

use faer::Mat;
use fleetfoot_stats::svd;

use crate::step::rank_level;

/// Rows with the products J'J and J'r: `diag(s)^(1/2) V' D` and `diag(s)^(-1/2) V' D^-1 J'r`. The scaled products are
/// `D^-1 J'J D^-1 = V diag(s) V'` with a diagonal of ones. Directions that are rounding are left out. `None` if the
/// decomposition fails.
pub(crate) fn compressed(products: &Mat<f64>, slope: &[f64]) -> Option<(Mat<f64>, Vec<f64>)> {
    let p = slope.len();
    let length = |j: usize| if products[(j, j)] > 0.0 { products[(j, j)].sqrt() } else { 1.0 };
    let lengths: Vec<f64> = (0..p).map(length).collect();
    let scaled = Mat::from_fn(p, p, |i, j| products[(i.max(j), i.min(j))] / (lengths[i] * lengths[j]));
    let factors = svd(scaled.as_ref())?;
    let least = factors.s.first().map_or(0.0, |largest| largest * rank_level(p));
    let rank = factors.s.iter().filter(|&&s| s > least).count();
    let rows = Mat::from_fn(rank, p, |i, j| factors.s[i].sqrt() * factors.v[(j, i)] * lengths[j]);
    let along = |i: usize| (0..p).map(|j| factors.v[(j, i)] * slope[j] / lengths[j]).sum::<f64>();
    let rhs = (0..rank).map(|i| along(i) / factors.s[i].sqrt()).collect();
    Some((rows, rhs))
}
