//! The statistic as an artefact: `.stats` files.
//!
//! A scan of logs is a plan (what is summed, in which coordinates) and sums by episode and chunk: those of the tasks of `fit sparse`
//! ([`fleetfoot_sparse::structured::Scanned`]) and those of the equations of `fit sindy` and `fit pwa` ([`EquationStatistic`]). Kept as a file, it is shipped instead of
//! the logs, appended to, merged, parted by episode and solved later. [`scan()`] makes one in memory, [`scan_to`] on disk.

mod compare;
mod container;
mod content;
mod describe;
mod equation_records;
mod equation_sections;
mod equations;
mod error;
mod file;
mod key;
mod operations;
mod plan;
mod records;
mod scan;
mod subset;
mod target;
#[cfg(test)]
mod tests;

pub use container::Sizes;
pub use content::ContentHash;
pub use describe::TaskSummary;
pub use equations::{EquationGroup, EquationStatistic};
pub(crate) use equations::{piecewise, placeholder};
pub use error::StatisticError;
pub use file::{ColumnRecord, EpisodeRecord, FileRecord, StatisticFile};
pub use key::LabelKey;
pub use operations::Unwanted;
pub use plan::{PlannedLatent, ScanPlan, plan_scan};
pub(crate) use scan::scan_tasks;
pub use scan::{ScanOptions, ScanReport, freeze, scan, scan_part};
pub(crate) use subset::Subset;
pub use target::{ScanOutcome, ScanTarget, scan_to};
