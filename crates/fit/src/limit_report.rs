//! Bounds that a fit keeps, and their cost in error.

use std::fmt;

use fleetfoot_report::words::number;
use fleetfoot_sparse::constrained::Limit;
use fleetfoot_task::CoefficientLimit;
use serde::{Deserialize, Serialize};

use crate::text_table::TextTable;

/// The side of a bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum LimitSide {
    /// From the bound up.
    #[serde(rename = "at least")]
    AtLeast,
    /// Up to the bound.
    #[serde(rename = "at most")]
    AtMost,
}

impl From<Limit> for LimitSide {
    fn from(side: Limit) -> Self {
        match side {
            Limit::AtLeast => Self::AtLeast,
            Limit::AtMost => Self::AtMost,
        }
    }
}

impl fmt::Display for LimitSide {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::AtLeast => "at least",
            Self::AtMost => "at most",
        })
    }
}

/// A bound that a fit keeps, and the distance to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct LimitReport {
    /// The latent, or the constraint.
    pub name: String,
    /// `at least` or `at most`.
    pub side: LimitSide,
    /// The bound; of a matrix, of its eigenvalues.
    #[serde(deserialize_with = "fleetfoot_dataset::json::number")]
    pub bound: f64,
    /// The least distance from the bound at any row, or in any region; negative where it is broken.
    #[serde(deserialize_with = "fleetfoot_dataset::json::number")]
    pub nearest: f64,
    /// Episode of the nearest row; `None` if all rows are alike.
    pub episode: Option<String>,
    /// The row of the episode.
    pub row: Option<usize>,
    /// The same of the fit without the limits, where that is known: negative where it breaks this one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free_nearest: Option<f64>,
    /// Count of active constraints; with none the bound costs nothing. Of a row limit: rows that became constraints. Of
    /// a matrix: directions. Of a coefficient: regions in which it holds a term. Of parameters: 1 if the fit without
    /// the bound breaks it.
    pub cuts: usize,
}

impl LimitReport {
    /// Of a coefficient; `values` are those of the regions, `held` in how many of them the bound holds it.
    pub(crate) fn of_coefficient(limit: &CoefficientLimit, values: &[f64], free: Option<&[f64]>, cuts: usize) -> Self {
        let nearest = |values: &[f64]| values.iter().map(|value| limit.clearance(*value)).fold(f64::INFINITY, f64::min);
        Self {
            name: format!("{}, {}", limit.name, limit.of),
            side: limit.side.into(),
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
        Self {
            name: limit.name.clone(),
            side: if limit.at_least { LimitSide::AtLeast } else { LimitSide::AtMost },
            bound: limit.bound,
            nearest,
            episode: None,
            row: None,
            free_nearest: free,
            cuts: usize::from(free.is_some_and(|free| free < 0.0)),
        }
    }

    /// Table of the limits that hold at every row, with the row nearest to each bound.
    pub fn table(limits: &[Self]) -> TextTable {
        let with_free = limits.iter().any(|limit| limit.free_nearest.is_some());
        let row = |limit: &Self| {
            let place = match (&limit.episode, limit.row) {
                (Some(episode), Some(row)) => format!("{episode}, row {}", row + 1),
                _ => "everywhere".to_owned(),
            };
            let free = limit.free_nearest.map_or_else(|| "-".into(), |free| format!("{free:.3e}"));
            let cells = [
                limit.name.clone(),
                format!("{} {}", limit.side, number(limit.bound)),
                format!("{:.3e}", limit.nearest),
                place,
                limit.cuts.to_string(),
            ];
            cells.into_iter().chain(with_free.then_some(free)).collect()
        };
        let header = ["kept", "bound", "nearest by", "at", "cuts"].into_iter();
        TextTable {
            caption: String::new(),
            header: header.chain(with_free.then_some("without bounds")).collect(),
            rows: limits.iter().map(row).collect(),
        }
    }
}

/// Errors of a fit without limits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FreeErrors {
    /// Root mean squared error on the rows of the fit.
    #[serde(rename = "free_rms", deserialize_with = "fleetfoot_dataset::json::number")]
    pub rms: f64,
    /// Root mean squared error on held-out rows; NaN where none are held out.
    #[serde(rename = "free_held_out_rms", deserialize_with = "fleetfoot_dataset::json::number")]
    pub held_out: f64,
}
