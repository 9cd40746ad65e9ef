//! The statistics of structured regressions: equations that share latent functions, one Gram matrix a task (block-sparse bolasso paper, section 4).

mod banks;
mod regression;
mod scan;
mod score;
mod spread;
mod structure;

pub use banks::Banks;
pub use regression::{Candidates, Regression, Task, Term};
pub use scan::{Plan, ScanError, Scanned, TaskStats};
pub use score::TaskError;
pub use spread::Spread;
pub use structure::{Structure, TaskShape};
