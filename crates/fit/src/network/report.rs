//! Report of a fit of networks, for people and for programs.

use fleetfoot_learn::Cell;
use serde::Serialize;

use super::basis::cell;
use crate::{method::FitReport, narx::PastRows, summary::FitSummary};

/// A size that was compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct NetworkCandidate {
    /// `linear`, or the units of the hidden layers, `network 16-16`, or of the cell, `gru 16`.
    pub name: String,
    /// Units of the hidden layers or of the cell; none for the linear map.
    pub hidden: Vec<usize>,
    /// Numbers that were fitted, of all equations.
    pub numbers: usize,
    /// Squared error of held-out rows over the variance of the targets, mean over targets and folds.
    pub loss: f64,
    /// Its standard error across folds.
    pub standard_error: f64,
    /// The same loss, fold by fold.
    pub losses: Vec<f64>,
    /// Root mean squared error of each target on held-out rows.
    pub rmse: Vec<f64>,
    /// True for the model that is written.
    pub chosen: bool,
}

impl NetworkCandidate {
    pub(super) fn new(
        (cell, hidden): (Option<Cell>, &[usize]),
        numbers: usize,
        losses: Vec<f64>,
        rmse: Vec<f64>,
    ) -> Self {
        let (loss, standard_error) = mean_and_error(&losses);
        Self {
            name: Self::name_of(cell, hidden),
            hidden: hidden.to_vec(),
            numbers,
            loss,
            standard_error,
            losses,
            rmse,
            chosen: false,
        }
    }

    pub(super) fn name_of(of: Option<Cell>, hidden: &[usize]) -> String {
        let sizes: Vec<String> = hidden.iter().map(usize::to_string).collect();
        match of {
            _ if hidden.is_empty() => "linear".into(),
            None => format!("network {}", sizes.join("-")),
            Some(of) => format!("{} {}", cell(of).name(), sizes.join("-")),
        }
    }
}

/// Root mean squared errors of a target on held-out rows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct NetworkErrors {
    /// Of the model that is written: of its kind and size, fitted to the rows of the other folds.
    pub rmse: f64,
    /// Of the mean of the rows that train.
    pub mean: f64,
    /// Of persistence: the value stays, its derivative is zero. NaN where that says nothing.
    pub persistence: f64,
}

/// The model of present rows beside that of past rows.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct LagChoice {
    /// The past rows that linear models chose.
    #[serde(flatten)]
    pub past: PastRows,
    /// Steps of the simulations.
    pub horizon: usize,
    /// Error of simulations of held-out spans over that of persistence, of every fold, without past rows; infinite where one diverged.
    pub without: Vec<f64>,
    /// The same with them.
    pub with: Vec<f64>,
    /// True if the written model reads past rows.
    pub chosen: bool,
    /// Error of simulations of the training rows by the written model, in the same unit.
    pub written: f64,
    /// True if simulations of the training rows chose the hidden layers (of all rows, or of a fold) and the ridge.
    pub anew: bool,
}

/// Report of a fit of networks.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct NetworkReport {
    /// The hash of the model.
    pub hash: String,
    /// Complete rows.
    pub rows: u64,
    /// Rows that the networks saw.
    pub trained_rows: u64,
    /// Left sides of the fitted equations.
    pub targets: Vec<String>,
    /// Standard deviation of each target.
    pub sigma: Vec<f64>,
    /// Rule of the held-out rows.
    pub fold_rule: String,
    /// The compared candidates, the linear map first.
    pub candidates: Vec<NetworkCandidate>,
    /// Index of the candidate that is written.
    pub chosen: usize,
    /// Errors of each target on held-out rows.
    pub held_out: Vec<NetworkErrors>,
    /// Models of past rows beside those of the present row; `None` where lags are given, or not looked for.
    pub lags: Option<LagChoice>,
    /// Facts that the reports of all methods have.
    #[serde(flatten)]
    pub summary: FitSummary,
}

impl FitReport for NetworkReport {
    fn summary(&self) -> &FitSummary {
        &self.summary
    }
}

/// Mean and its standard error.
pub(super) fn mean_and_error(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    (mean, (square / (count - 1.0).max(1.0) / count).sqrt())
}
