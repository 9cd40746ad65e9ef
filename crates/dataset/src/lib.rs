//! Logs opened through a recipe: their clocks, joins, conditions and columns; or the `.stats` file that holds their
//! sums.
//!
//! [`Logs`] are the recordings to read; a [`Dataset`] is their view through a recipe or a model. [`StatisticFile`]
//! stands in place of logs for the fits that need no rows.

pub mod blocks;
pub mod clocks;
pub mod condition;
pub mod content;
mod dataset;
mod error;
pub mod estimated_clocks;
pub mod folder;
mod hold_out;
pub mod json;
mod kept;
pub mod labels;
mod logs;
pub mod open;
pub mod period;
pub mod raw;
mod read_plan;
mod rotations;
mod statistic_error;
pub mod stats_file;
pub mod text;
pub mod view;

pub use dataset::{Dataset, reads_of_model};
pub use error::{Error, short};
pub use hold_out::Part;
pub use logs::{Logs, NOISE, PREPARED, is_prepared, is_statistic};
pub use read_plan::ReadPlan;
pub use rotations::{NoRotation, UnitRotations};
pub use statistic_error::StatisticError;
pub use stats_file::{
    ColumnRecord, ContentHash, EpisodeRecord, EquationGroup, EquationStatistic, FileRecord, Sizes, StatisticFile,
    TaskSummary, Unwanted, covers, once, refuse_unprintable,
};
