//! What a fit kept within bounds tells of them, and what they cost.

use fleetfoot_sparse::constrained::Limit;
use serde::Serialize;

use crate::CoefficientLimit;

/// What a fit keeps, and how near it is to the bound.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct LimitReport {
    /// The latent, or the constraint.
    pub name: String,
    /// `at least` or `at most`.
    pub side: &'static str,
    /// The bound; of a matrix, of its eigenvalues.
    pub bound: f64,
    /// The least distance from the bound at any row, or in any region; negative where it is broken.
    pub nearest: f64,
    /// Where that is; `None` where it is the same at every row.
    pub episode: Option<String>,
    /// The row of the episode.
    pub row: Option<usize>,
    /// The same of the fit without the limits, where that is known: negative where it breaks this one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free_nearest: Option<f64>,
    /// How many rows became constraints of the fit, of a matrix how many directions, of a coefficient in how many regions it holds a term, of parameters whether the fit without it breaks it: with none the bound costs nothing.
    pub cuts: usize,
}

impl LimitReport {
    /// Of a coefficient; `values` are those of the regions, `held` in how many of them the bound holds it.
    pub(crate) fn of_coefficient(limit: &CoefficientLimit, values: &[f64], free: Option<&[f64]>, cuts: usize) -> Self {
        let nearest = |values: &[f64]| values.iter().map(|value| limit.clearance(*value)).fold(f64::INFINITY, f64::min);
        Self {
            name: format!("{}, {}", limit.name, limit.of),
            side: words(limit.side),
            bound: limit.bound,
            nearest: nearest(values),
            episode: None,
            row: None,
            free_nearest: free.map(nearest),
            cuts,
        }
    }

    /// Of a matrix of parameters; `nearest` and `free` are distances from the bound with the limits and without.
    pub(crate) fn of_matrix(limit: &fleetfoot_estimate::MatrixLimit, nearest: f64, free: Option<f64>) -> Self {
        let side = if limit.at_least { Limit::AtLeast } else { Limit::AtMost };
        Self {
            name: limit.name.clone(),
            side: words(side),
            bound: limit.bound,
            nearest,
            episode: None,
            row: None,
            free_nearest: free,
            cuts: usize::from(free.is_some_and(|free| free < 0.0)),
        }
    }
}

/// Errors of a fit without limits.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct FreeErrors {
    /// Root mean squared error on the rows of the fit.
    #[serde(rename = "free_rms")]
    pub rms: f64,
    /// Root mean squared error on held-out rows; NaN where none are held out.
    #[serde(rename = "free_held_out_rms")]
    pub held_out: f64,
}

pub(crate) fn words(side: Limit) -> &'static str {
    match side {
        Limit::AtLeast => "at least",
        Limit::AtMost => "at most",
    }
}
