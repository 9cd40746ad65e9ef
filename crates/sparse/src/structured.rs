//! Structured multi-task regression: equations that share latent functions (block-sparse bolasso paper, sections 4 to 7).

mod assemble;
mod banks;
mod refit;
mod regression;
mod scan;
mod score;
mod spread;
mod structure;

pub use assemble::{Assembled, Assembly, Tikhonov};
pub use banks::Banks;
pub use refit::refit;
pub use regression::{Candidates, Regression, Task, Term};
pub use scan::{Plan, ScanError, Scanned, TaskStats};
pub use score::TaskError;
pub use spread::Spread;
pub use structure::{Structure, TaskShape};
