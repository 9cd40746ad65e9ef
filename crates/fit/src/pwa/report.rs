//! Report of a piecewise-affine fit, for people and for programs.

use fleetfoot_pwa::{Continuity, Identification, Score};
use serde::{Serialize, Serializer};

use crate::{
    bounded_maps::BoundedMaps, interval::Interval, method::FitReport, summary::FitSummary, words::interval_in_words,
};

/// Report of a piecewise-affine fit.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct PwaReport {
    /// The model, its rivals, and their scores.
    pub identification: Identification,
    /// The part of the report that all methods share.
    pub summary: FitSummary,
}

impl FitReport for PwaReport {
    fn summary(&self) -> &FitSummary {
        &self.summary
    }
}

impl Serialize for PwaReport {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let identification = &self.identification;
        PwaFields {
            hash: identification.model.hash(),
            rows: identification.rows,
            files: self.summary.files,
            effective_rows: identification.effective_rows,
            targets: &identification.targets,
            sigma: &identification.sigma,
            held_out: identification.held_out,
            fold_rule: identification.fold_rule.as_deref(),
            condition: identification.condition,
            preconditioned_condition: identification.preconditioned,
            chosen: identification.chosen,
            chosen_by: identification.rule,
            intervals: interval_in_words(&identification.basis),
            candidates: (identification.candidates.iter().enumerate())
                .map(|(at, score)| Candidate { chosen: at == identification.chosen, ..Candidate::from(score) })
                .collect(),
            summary: &self.summary,
        }
        .serialize(serializer)
    }
}

#[derive(Serialize)]
struct PwaFields<'a> {
    hash: String,
    rows: u64,
    files: usize,
    effective_rows: f64,
    targets: &'a [String],
    sigma: &'a [f64],
    held_out: bool,
    fold_rule: Option<&'a str>,
    condition: f64,
    preconditioned_condition: f64,
    chosen: usize,
    chosen_by: Option<&'static str>,
    intervals: String,
    candidates: Vec<Candidate<'a>>,
    #[serde(flatten)]
    summary: &'a FitSummary,
}

/// A partition that was compared.
#[derive(Serialize)]
struct Candidate<'a> {
    partition: String,
    regions: usize,
    coefficients: usize,
    front: bool,
    chosen: bool,
    shrinkage: f64,
    mae_over_null: &'a [f64],
    mae_over_null_intervals: Vec<Interval>,
    mae_over_sigma: &'a [f64],
    r2: &'a [f64],
    mahalanobis: f64,
    loss: f64,
    standard_error: f64,
    fold_losses: &'a [f64],
    bic: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    continuity: Option<Meeting>,
    #[serde(skip_serializing_if = "Option::is_none")]
    free_loss: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stability: Option<BoundedMaps>,
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    objective_by_pass: &'a [f64],
}

impl<'a> From<&'a Score> for Candidate<'a> {
    fn from(score: &'a Score) -> Self {
        Self {
            partition: score.specification.to_string(),
            regions: score.regions,
            coefficients: score.coefficients,
            front: score.front,
            chosen: false,
            shrinkage: score.shrinkage,
            mae_over_null: &score.over_null,
            mae_over_null_intervals: score.over_null_interval.iter().map(Interval::from).collect(),
            mae_over_sigma: &score.over_sigma,
            r2: &score.r2,
            mahalanobis: score.mahalanobis,
            loss: score.loss,
            standard_error: score.standard_error,
            fold_losses: &score.losses,
            bic: score.bic,
            continuity: score.continuity.map(Meeting::from),
            free_loss: score.stability.as_ref().map(|_| score.free_loss),
            stability: score.stability.as_ref().map(BoundedMaps::from),
            objective_by_pass: &score.objective,
        }
    }
}

/// Cost of continuity: the loss of maps that meet at their borders beside that of maps that do not.
#[derive(Serialize)]
struct Meeting {
    borders: usize,
    numbers: usize,
    loss_apart: f64,
    jump: f64,
}

impl From<Continuity> for Meeting {
    fn from(Continuity { borders, numbers, apart, jump, .. }: Continuity) -> Self {
        Self { borders, numbers, loss_apart: apart, jump }
    }
}
