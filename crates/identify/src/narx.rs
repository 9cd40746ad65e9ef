//! From files and a recipe to an autoregression with inputs, piecewise where asked for, and what its free runs are worth.

mod choose;
mod effort;
mod fit;
mod look;
mod options;
mod partitions;
mod report;
mod runs;
mod select;
mod spans;
mod summed;
mod task;
mod terms;

pub use effort::Effort;
pub use fit::{NarxFitted, NarxRequest, fit_narx};
pub use look::{NarxSearch, NarxStage};
pub use options::{GivenAs, GivenOrder, NarxOptions, NarxSelection, OrderRule, TermRule};
pub use report::{NarxEquation, NarxRegion, NarxReport, NarxScores, NarxTerm};
pub(crate) use runs::free_runs_by_file;
pub use runs::{FileRun, FileRuns, MeanRun};
pub use select::NarxCandidate;
pub(crate) use spans::Spans;
pub(crate) use summed::{Summed, served};
