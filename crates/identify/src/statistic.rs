//! The statistic as an artefact: `.stats` files.
//!
//! A scan of logs is a plan (what is summed, in which coordinates) and sums by episode and chunk: those of the tasks of `fit sparse`
//! ([`fleetfoot_sparse::structured::Scanned`]) and those of the equations of `fit sindy` and `fit pwa` ([`EquationStatistic`]). Kept as a file, it is shipped instead of
//! the logs, appended to, merged, parted by episode and solved later. [`scan()`] makes one in memory, [`scan_to`] on disk.

mod compare;
mod content;
mod describe;
mod equations;
mod key;
mod operations;
mod plan;
mod scan;
mod target;
mod task;
#[cfg(test)]
mod tests;

pub use describe::TaskSummary;
pub use key::LabelKey;
pub use operations::Unwanted;
pub use plan::{PlannedLatent, ScanPlan, plan_scan};
pub(crate) use scan::scan_tasks;
pub use scan::{ScanOptions, ScanReport, freeze, scan, scan_part};
pub use target::{ScanOutcome, ScanTarget, scan_to};

pub use crate::{
    statistic_error::StatisticError,
    stats_file::{
        ColumnRecord, ContentHash, EpisodeRecord, EquationGroup, EquationStatistic, FileRecord, Sizes, StatisticFile,
    },
};
