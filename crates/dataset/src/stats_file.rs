//! The `.stats` file: a plan and its sums, read and written.

mod compare;
mod container;
mod content_hash;
mod describe;
mod equation_records;
mod equation_sections;
mod equations;
mod file;
mod operations;
mod records;
mod task;

pub use container::{Sizes, of_sections};
pub use content_hash::ContentHash;
pub use describe::TaskSummary;
pub use equation_sections::refuse_unprintable;
pub use equations::{EquationGroup, EquationStatistic, covers, once};
pub use file::{ColumnRecord, EpisodeRecord, FileRecord, StatisticFile};
pub use operations::Unwanted;
