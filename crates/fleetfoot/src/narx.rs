//! From files and a recipe to an autoregression with inputs, piecewise where asked for, and what its free runs are worth.

mod fit;
mod options;
mod report;
mod select;
mod spans;
mod task;
mod terms;

pub use fit::{NarxFitted, NarxRequest, fit_narx};
pub use options::{NarxOptions, NarxSelection, TermRule};
pub use report::{NarxEquation, NarxRegion, NarxReport, NarxScores, NarxTerm};
pub use select::NarxCandidate;
pub(crate) use spans::Spans;
