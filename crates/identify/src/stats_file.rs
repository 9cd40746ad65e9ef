//! The `.stats` file: a plan and its sums, read and written.

mod container;
mod content_hash;
mod equation_records;
mod equation_sections;
mod equations;
mod file;
mod records;

pub use container::Sizes;
pub use content_hash::ContentHash;
pub(crate) use equation_sections::refuse_unprintable;
pub use equations::{EquationGroup, EquationStatistic};
pub(crate) use equations::{covers, once};
pub use file::{ColumnRecord, EpisodeRecord, FileRecord, StatisticFile};

#[cfg(test)]
pub(crate) use container::Writer;
#[cfg(test)]
pub(crate) use records::to_bytes;
