//! From files and a recipe to an autoregression with inputs, piecewise on request, and the errors of its free runs.

mod candidate;
mod choice;
mod choose;
mod delays;
mod effort;
mod fit;
mod look;
mod options;
mod partitions;
mod past;
mod report;
mod runs;
mod scores;
mod select;
mod summed;
mod task;
mod terms;
mod training;

pub use candidate::NarxCandidate;
pub use delays::late_inputs;
pub use fit::Narx;
pub use look::{NarxSearch, NarxStage};
pub use options::{GivenOrder, NarxOptions, OrderRule, TermRule};
pub use past::PastRows;
pub use report::{NarxEquation, NarxRegion, NarxReport, NarxTerm};
pub use runs::{FileRun, FileRuns, MeanRun, free_runs_by_file};
pub use scores::NarxScores;
pub(crate) use summed::{Summed, served};
