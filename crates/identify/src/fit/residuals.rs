//! What coefficients leave that were moved away from least squares, without a pass over the rows.

use fleetfoot_data::packed;
use fleetfoot_model::Model;

/// The residual covariances of a model's regions after its coefficients moved from `before`, the least-squares solution of every region, to those of `model`.
///
/// The residuals r of least squares have mean zero and are orthogonal to the regressors x, so that those of the moved coefficients, `r - x'd - e` with d and e the changes of coefficients and
/// constant, have the second moments
///
/// ```text
/// cov(r) + d' cov(x) d + m m',    m = mean(x)'d + e
/// ```
pub(super) fn move_residuals(before: &Model, model: &mut Model) {
    let q = model.latents.len();
    let Some(partition) = model.partitions.first_mut() else { return };
    for (at, region) in partition.regions.iter_mut().enumerate() {
        let changes: Vec<(Vec<f64>, f64)> = before
            .latents
            .iter()
            .zip(&model.latents)
            .map(|(old, new)| {
                let pairs = old.coefficients[at].iter().zip(&new.coefficients[at]);
                (pairs.map(|(old, new)| new - old).collect(), new.constants[at] - old.constants[at])
            })
            .collect();
        let means = changes.iter().map(|(d, e)| e + d.iter().zip(&region.mean).map(|(d, mean)| d * mean).sum::<f64>());
        let means: Vec<f64> = means.collect();
        let covariance = |i: usize, j: usize| region.covariance[packed(i.max(j), i.min(j))];
        for t in 0..q {
            for o in 0..=t {
                let (a, b) = (&changes[t].0, &changes[o].0);
                let spread: f64 =
                    (0..a.len()).map(|i| a[i] * (0..b.len()).map(|j| covariance(i, j) * b[j]).sum::<f64>()).sum();
                region.residual_covariance[packed(t, o)] += spread + means[t] * means[o];
            }
        }
    }
}
