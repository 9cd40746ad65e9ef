//! Process noise, from the residuals of a region.

use faer::Mat;
use fleetfoot_data::packed;
use fleetfoot_model::{Equation, Model, Partition, Prediction, RegionSummary, Summary};

use super::{FilterError, Gaussian, step_noise::StepNoise};
use crate::pieces::Pieces;

/// Error of a step of a given equation, as a share of a state's size: it keeps covariances definite.
const GIVEN: f64 = 1e-6;

/// The white noise of a region: the covariance of a step of a discrete model, the spectral density of a continuous one.
///
/// Residuals of derivatives that were measured over k rows are means over k steps of white noise. Their variance times
/// `k h^2` is therefore that of a step; a step's noise divided by h is the density. Few rows fit their own noise: a
/// covariance over all rows is corrected to one over the degrees of freedom.
pub(super) fn white_noise(model: &Model, pieces: &Pieces, region: usize) -> Result<StepNoise, FilterError> {
    let n = pieces.states.len();
    let summary = described(model, pieces).and_then(|(_, summary)| summary.regions.get(region));
    let scale = summary.map_or(1.0, over_freedom);
    let mut place = vec![None; n];
    for (target, equation) in model.fitted().enumerate() {
        let state = pieces.states.iter().position(|state| *state == equation.subject);
        if let Some(state) = state.filter(|_| equation.prediction != Prediction::Value) {
            let by_rows = if pieces.continuous { model.step * span(equation) } else { 1.0 };
            place[state] = Some((target, by_rows));
        }
    }
    let entry = |i: usize, j: usize| -> f64 {
        match (place[i], place[j], summary) {
            (Some((s, k)), Some((t, l)), Some(summary)) => {
                let value = summary.residual_covariance.get(packed(s, t)).copied().unwrap_or(f64::NAN);
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
        None => Ok(StepNoise { white: noise, shape: Mat::zeros(n, 0) }),
    }
}

/// The noise of a region whose residuals are correlated from row to row: the effect of a row's whitened residuals on
/// the states, and a small error of given equations.
///
/// A residual of a row lasts over the whole step, as inputs do. Residuals of central differences are means over two
/// rows: over many rows they act like those of one row, over one row they are somewhat smaller. `time`: rows that count
/// as an independent one. Few rows fit their own noise, and the errors of the coefficients add to the noise of other
/// rows. The covariance is therefore that of held-out rows: `(n + p) / (n - p)` times that of the training rows, n of
/// them independent (Akaike, "Fitting autoregressive models for prediction", Ann. Inst. Statist. Math. 21, 1969).
pub(super) fn coloured_noise(
    model: &Model,
    pieces: &Pieces,
    region: usize,
    time: f64,
) -> Result<StepNoise, FilterError> {
    let mut noise = white_noise(model, pieces, region)?.white;
    let (n, q) = (pieces.states.len(), model.fitted().count());
    let mut shape = Mat::zeros(n, q);
    let Some(summary) = described(model, pieces).and_then(|(_, summary)| summary.regions.get(region)) else {
        return Ok(StepNoise { white: noise, shape });
    };
    let (rows, spent) = (summary.rows as f64 / time, summary.rank as f64 + 1.0);
    let scale = if rows > 2.0 * spent { (rows + spent) / (rows - spent) } else { 3.0 };
    let entry = |s: usize, t: usize| {
        let value = summary.residual_covariance[packed(s.max(t), s.min(t))];
        scale * if value.is_finite() { value } else { 0.0 }
    };
    let lower = Gaussian { mean: vec![0.0; q], covariance: (0..q * q).map(|at| entry(at / q, at % q)).collect() };
    let lower = lower.factor(q);
    for (target, equation) in model.fitted().enumerate() {
        let Some(state) = pieces.states.iter().position(|state| *state == equation.subject) else { continue };
        (0..q).for_each(|t| shape[(state, t)] = lower[target * q + t]);
        (0..n).for_each(|other| (noise[(state, other)], noise[(other, state)]) = (0.0, 0.0));
    }
    Ok(StepNoise { white: noise, shape })
}

/// The partition whose regions the pieces are.
pub(super) fn described<'m>(model: &'m Model, pieces: &Pieces) -> Option<(&'m Partition, &'m Summary)> {
    let index = pieces.partition.or((model.partitions.len() == 1).then_some(0))?;
    model.partitions.get(index).zip(model.summaries.get(index))
}

/// Factor from a covariance over all rows to one over the degrees of freedom.
fn over_freedom(summary: &RegionSummary) -> f64 {
    let (rows, spent) = (summary.rows as f64, summary.rank as f64 + 1.0);
    if rows > spent { rows / (rows - spent) } else { 1.0 }
}

/// Over how many rows a derivative was measured: k of `over = k`, 2 of central differences, 1 of a column.
fn span(equation: &Equation) -> f64 {
    let (before, after) = equation.target.as_ref().map_or((0, 0), |target| target.reach());
    let reach = if before + after >= 2 { 2 } else { 1 };
    f64::from(equation.span().unwrap_or(reach))
}
