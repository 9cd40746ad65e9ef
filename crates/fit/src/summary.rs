//! The part of a report that all methods share.

use serde::Serialize;

use crate::{
    baselines::TargetBaselines, by_time::ByTime, objective::Refinement, rollout_choice::RolloutChoice, serialize,
};

/// The part of a report that all methods share.
#[derive(Debug, Clone, Default, Serialize)]
#[non_exhaustive]
pub struct FitSummary {
    /// Episodes, or parts of them, that trained.
    pub episodes: usize,
    /// Files.
    #[serde(skip)]
    pub files: usize,
    /// Rows left out: at the border of an episode, with a missing value and, where there are regions, in none of them.
    #[serde(flatten, serialize_with = "serialize::left_out")]
    pub left_out: Vec<u64>,
    /// Choice of open spans and candidates by rollouts; `None` without rollouts.
    pub rollouts: Option<RolloutChoice>,
    /// The fit to simulations, on request.
    #[serde(rename = "objective", skip_serializing_if = "Option::is_none")]
    pub refinement: Option<Refinement>,
    /// Errors of the baselines (mean and persistence) of every fitted equation; empty without rows.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub baselines: Vec<TargetBaselines>,
    /// Errors on the last rows, of the model of the rows before them, where that was tried.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_time: Option<ByTime>,
    /// Notes for the user.
    pub notes: Vec<String>,
    /// Held-out errors in one sentence; `None` without any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<String>,
}
