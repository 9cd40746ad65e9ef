//! Report of an autoregression, for people and for programs.

use fleetfoot_sparse::narx::{NarxOrder, OrderSearch};
use serde::Serialize;

use super::{FileRuns, NarxCandidate, NarxScores, NarxSearch};
use crate::summary::FitSummary;

/// Report of an autoregression.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct NarxReport {
    /// Rows that trained.
    pub rows: u64,
    /// Lags and degree of the model.
    #[serde(serialize_with = "crate::json::narx::order")]
    pub order: NarxOrder,
    /// True if inputs act at once (lag 0).
    pub direct: bool,
    /// Candidate functions of this order, the constant among them.
    pub candidates: usize,
    /// The partition, as users write it.
    pub partition: String,
    /// Criterion of order, terms and partition, for people; `None` if all were given.
    pub choice: Option<String>,
    /// The model that is written, among those that were simulated: its terms, refitted on the other spans of every fold.
    pub held_out: Option<NarxCandidate>,
    /// The best linear model with all terms of the same lags, among those that were tried.
    #[serde(rename = "linear_of_the_same_lags")]
    pub linear: Option<NarxCandidate>,
    /// Search for the order, with the orders that the effort cut; `None` without a search.
    pub search: Option<NarxSearch>,
    /// Models that were simulated to choose one, in the order in which they were tried.
    pub tried: Vec<NarxCandidate>,
    /// Orders that were compared by one-step errors, where they were.
    #[serde(serialize_with = "crate::json::narx::orders")]
    pub orders: Option<OrderSearch>,
    /// The regions.
    pub regions: Vec<NarxRegion>,
    /// On the rows that trained; `None` where a statistic stood for them.
    pub train: Option<NarxScores>,
    /// On the rows kept back.
    pub test: Option<NarxScores>,
    /// On other files, one by one.
    pub files: Option<FileRuns>,
    /// The part of the report that all methods share.
    #[serde(flatten)]
    pub summary: FitSummary,
}

/// The best linear model with all terms of the lags of a candidate, among those that were tried; `None` where none was.
pub(super) fn linear(narx_candidate: Option<&NarxCandidate>, tried: &[NarxCandidate]) -> Option<NarxCandidate> {
    let linear = narx_candidate?;
    let order = NarxOrder { degree: 1, ..linear.order };
    let same = |other: &&NarxCandidate| other.order == order && other.partition == linear.partition;
    tried.iter().filter(same).max_by_key(|candidate| candidate.terms).cloned()
}

/// The equations of a region.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct NarxRegion {
    /// Its name.
    pub name: String,
    /// Its rows.
    pub rows: u64,
    /// True if the region has too few rows and takes the terms of all rows.
    pub shared: bool,
    /// The equations.
    pub equations: Vec<NarxEquation>,
}

/// An equation.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct NarxEquation {
    /// Its left side: `next(y)`.
    pub label: String,
    /// Its terms, in the order in which forward regression took them.
    pub terms: Vec<NarxTerm>,
}

/// A term.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct NarxTerm {
    /// The function; `1` for the constant.
    pub function: String,
    /// Its coefficient.
    pub coefficient: f64,
    /// Share of the target's square sum that it took away when it entered; NaN without forward regression.
    pub err: f64,
}
