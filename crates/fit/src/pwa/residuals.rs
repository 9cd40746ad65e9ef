//! Residual covariance after a change of coefficients, computed from sums without a pass over the rows.

use std::collections::BTreeMap;

use faer::Mat;
use fleetfoot_data::packed;
use fleetfoot_model::Model;
use fleetfoot_stats::SquareRoot;

/// Moves the second moments of the residuals of a model's regions, after its coefficients moved from those of `before`.
/// `roots`: the sums of the regions' rows.
///
/// The moments of `before` are known from the rows. The variance that no regressor explains is the same in both, so
/// that the moments differ by the rest ([`SquareRoot::error_products`]). This holds whether `before` is the solution of
/// least squares, pulled towards one region, or bounded.
pub(super) fn move_residuals(before: &Model, model: &mut Model, roots: &BTreeMap<u32, SquareRoot>) {
    let q = model.latents.len();
    for (&at, root) in roots {
        let products = |model: &Model| {
            // A null model has constants alone.
            let coefficient = |j, t: usize| model.latents[t].map.coefficient(at as usize, j);
            let coefficients = Mat::from_fn(root.regressors(), q, coefficient);
            let constants: Vec<f64> = model.latents.iter().map(|latent| latent.map.constant(at as usize)).collect();
            root.error_products(coefficients.as_ref(), &constants)
        };
        let (old, new) = (products(before), products(model));
        let Some(region) = model.summaries.first_mut().and_then(|summary| summary.regions.get_mut(at as usize)) else {
            return;
        };
        for ((moment, old), new) in region.residual_covariance.iter_mut().zip(&old).zip(&new) {
            *moment += (new - old) / root.weight;
        }
        for square in (0..q).map(|t| packed(t, t)) {
            // No less than what is seen of it, whatever the difference rounds to.
            region.residual_covariance[square] = region.residual_covariance[square].max(new[square] / root.weight);
        }
    }
}
