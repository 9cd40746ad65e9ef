//! Process noise: what the residuals of a region say.

use faer::Mat;
use fleetfoot_data::packed;
use fleetfoot_model::{Equation, Model, Prediction};

use super::FilterError;
use crate::pieces::Pieces;

/// The share of a state's size that a step of a given equation may be off: what keeps covariances definite.
const GIVEN: f64 = 1e-6;

/// The noise of a region: the covariance of a step's of a discrete model, the spectral density of a continuous one.
///
/// Residuals of derivatives that were measured over k rows are means over k steps of noise that is white, so that their variance is that of a step's by `k h^2`; a step's
/// noise divided by h is the density. Few rows fit their own noise: a covariance over all rows is made one over the degrees of freedom.
pub(super) fn region_noise(model: &Model, pieces: &Pieces, region: usize) -> Result<Mat<f64>, FilterError> {
    let n = pieces.states.len();
    let described = pieces.partition.or((model.partitions.len() == 1).then_some(0));
    let own = described.and_then(|index| model.partitions[index].regions.get(region));
    let scale = own.map_or(1.0, |own| {
        let (rows, spent) = (own.rows as f64, own.rank as f64 + 1.0);
        if rows > spent { rows / (rows - spent) } else { 1.0 }
    });
    let mut place = vec![None; n];
    for (target, equation) in model.fitted().enumerate() {
        let state = pieces.states.iter().position(|state| *state == equation.subject);
        if let Some(state) = state.filter(|_| equation.prediction != Prediction::Value) {
            let by_rows = if pieces.continuous { model.step * span(equation) } else { 1.0 };
            place[state] = Some((target, by_rows));
        }
    }
    let entry = |i: usize, j: usize| -> f64 {
        match (place[i], place[j], own) {
            (Some((s, k)), Some((t, l)), Some(own)) => {
                let value = own.residual_covariance.get(packed(s, t)).copied().unwrap_or(f64::NAN);
                let known = if i == j || value.is_finite() { value } else { 0.0 };
                known * scale * (k * l).sqrt()
            }
            _ if i == j => (GIVEN * pieces.size(i)).powi(2),
            _ => 0.0,
        }
    };
    let noise = Mat::from_fn(n, n, entry);
    match (0..n).find(|&i| !noise[(i, i)].is_finite()) {
        Some(state) => Err(FilterError::NoResiduals { state: pieces.states[state].clone() }),
        None => Ok(noise),
    }
}

/// Over how many rows a derivative was measured: k of `over = k`, 2 of central differences, 1 of a column.
fn span(equation: &Equation) -> f64 {
    let (before, after) = equation.target.as_ref().map_or((0, 0), |target| target.reach());
    let reach = if before + after >= 2 { 2 } else { 1 };
    f64::from(equation.span().unwrap_or(reach))
}
