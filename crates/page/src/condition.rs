//! Condition of the functions that a region's coefficients use: their correlation in the training rows.

use fleetfoot_model::{Model, RegionSummary};
use fleetfoot_stats::Gram;

/// From this condition number of the standardised regressors on, collinearity affects coefficients seriously (Belsley,
/// Kuh, Welsch, Regression Diagnostics, 1980, section 3.2: 30 and more).
pub(crate) const CONDITION: f64 = 30.0;

/// The functions of a partition's first latent that some latent of it uses.
pub(crate) fn used(model: &Model, partition: usize, region: usize) -> Vec<usize> {
    let Some(first) = model.latents.iter().find(|latent| latent.partition == partition) else { return Vec::new() };
    let same = || model.latents.iter().filter(|other| other.partition == partition && other.library == first.library);
    let is_used = |function: &usize| same().any(|latent| latent.map.coefficient(region, *function) != 0.0);
    (0..model.libraries[first.library].len()).filter(is_used).collect()
}

/// The condition number of the standardised functions that a region's coefficients use; NaN where it is not known.
pub(crate) fn condition(model: &Model, partition: usize, region: usize) -> f64 {
    let used = used(model, partition, region);
    let latent = model.latents.iter().find(|latent| latent.partition == partition);
    let info = &model.summaries[partition].regions[region];
    // Of all functions the fit knows it to more digits than their covariance does.
    if latent.is_some_and(|latent| used.len() == model.libraries[latent.library].len()) {
        return info.condition;
    }
    let collinearity = gram(info, &used).and_then(|gram| gram.collinearity());
    collinearity.map_or(f64::NAN, |collinearity| collinearity.index(collinearity.columns.len() - 1))
}

/// The moments of some functions over a region's rows.
pub(crate) fn gram(region: &RegionSummary, used: &[usize]) -> Option<Gram> {
    let mut gram = Gram::new(used.len());
    (gram.rows, gram.weight) = (region.rows, region.rows as f64);
    gram.mean = used.iter().map(|&function| region.mean.get(function).copied()).collect::<Option<_>>()?;
    for i in 0..used.len() {
        for j in 0..=i {
            let covariance = region.covariance.get(fleetfoot_data::packed(used[i], used[j]))?;
            gram.scatter[fleetfoot_data::packed(i, j)] = covariance * gram.weight;
        }
    }
    (region.rows > 0).then_some(gram)
}
