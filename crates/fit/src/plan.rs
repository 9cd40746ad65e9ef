//! Plan of a fit, made before it begins: data to read, statistics to keep, and work.

use fleetfoot_data::Work;
use fleetfoot_dataset::{ReadPlan, StatisticFile};
use serde::Serialize;

use crate::serialize;

/// Plan of a fit: data to read, statistics to keep, and work.
#[derive(Debug, Clone, Default, Serialize)]
#[non_exhaustive]
pub struct FitPlan {
    /// Data that its passes would read.
    #[serde(flatten)]
    pub reading: ReadPlan,
    /// Left sides of the fit: equations, outputs, tasks.
    pub equations: Vec<String>,
    /// Candidate functions of any equation, at most.
    pub candidates: usize,
    /// Regions, at most.
    pub regions: usize,
    /// Passes over the rows, at most; simulations take more.
    pub passes: usize,
    /// Extra work of a fit to simulations, in words; `None` for the objective of one step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulations: Option<String>,
    /// Bytes that rows in memory may take beside, where states may be smoothed, at most.
    #[serde(rename = "smoothing_bytes", skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<usize>,
    /// Bytes that statistics and rows in memory take, about.
    #[serde(rename = "memory_bytes")]
    pub memory: usize,
    /// Work of the models of all regions and folds, without the passes over the rows.
    #[serde(rename = "operations", serialize_with = "serialize::operations")]
    pub work: Work,
    /// Details of the method, in sentences.
    pub details: Vec<String>,
    /// Assumptions and omissions.
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
