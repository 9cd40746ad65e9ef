//! What a fit would read, keep and compute: told before it begins.

use fleetfoot_data::Work;
use fleetfoot_dataset::{ReadPlan, StatisticFile};
use serde::Serialize;

use crate::serialize;

/// What a fit would read, keep and compute.
#[derive(Debug, Clone, Default, Serialize)]
#[non_exhaustive]
pub struct FitPlan {
    /// What its passes would read.
    #[serde(flatten)]
    pub reading: ReadPlan,
    /// Left sides of what is fitted: equations, outputs, tasks.
    pub equations: Vec<String>,
    /// Candidate functions of any equation, at most.
    pub candidates: usize,
    /// Regions, at most.
    pub regions: usize,
    /// Passes over the rows, at most; simulations take more.
    pub passes: usize,
    /// What a fit to simulations takes beside them, where that is the objective; in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulations: Option<String>,
    /// Bytes that rows in memory may take beside, where states may be smoothed, at most.
    #[serde(rename = "smoothing_bytes", skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<usize>,
    /// Bytes that statistics and rows in memory take, about.
    #[serde(rename = "memory_bytes")]
    pub memory: usize,
    /// What the models of all regions and folds take, passes over the rows left out.
    #[serde(rename = "operations", serialize_with = "serialize::operations")]
    pub work: Work,
    /// What the method has to say beside, in sentences.
    pub details: Vec<String>,
    /// What was assumed or left out.
    #[serde(skip)]
    pub notes: Vec<String>,
}

impl FitPlan {
    /// Of a statistic, which no pass over rows is needed for.
    pub(crate) fn of_statistic(file: &StatisticFile) -> Self {
        let mut reading = ReadPlan::default();
        (reading.files, reading.episodes) = (1, Some(file.episodes.len()));
        reading.rows = file.scanned.counts().complete as usize;
        Self { reading, details: vec![format!("{} chunks of rows were summed", file.chunks())], ..Self::default() }
    }
}
