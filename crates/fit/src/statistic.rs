//! The statistic as an artefact: `.stats` files.
//!
//! A scan of logs is a plan (expressions to sum, and their coordinates) and sums by episode and chunk. There are sums
//! for the tasks of `fit sparse` ([`fleetfoot_sums::structured::Scanned`]), and for the equations of `fit sindy` and
//! `fit pwa` ([`EquationStatistic`]). Kept as a file, it is shipped instead of the logs, appended to, merged, parted by
//! episode and solved later. [`scan()`] makes one in memory, [`scan_to`] on disk.

mod equations;
mod json;
mod plan;
mod scan;
mod serves;
mod target;
#[cfg(test)]
mod tests;

pub use crate::label_key::LabelKey;
pub use fleetfoot_dataset::{
    ColumnRecord, ContentHash, EpisodeRecord, EquationGroup, EquationStatistic, FileRecord, Sizes, StatisticError,
    StatisticFile, TaskSummary, Unwanted,
};
pub use json::description;
pub use plan::{PlannedLatent, ScanPlan, plan_append, plan_scan};
pub use scan::{ScanOptions, ScanReport, freeze, scan, scan_part};
pub(crate) use scan::{default_chunk, row_expressions, scan_tasks};
pub use serves::serves;
pub use target::{ScanOutcome, ScanTarget, scan_to};
