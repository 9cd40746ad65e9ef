//! Sparse models by thresholding and by greedy selection, on the statistic: STLSQ, SR3, stepwise and forward regression, the
//! paths of penalties.
//!
//! The problem is a [`Compressed`](fleetfoot_stats::Compressed): least squares of targets on p candidate columns without an intercept of its own, so that
//! the constant is a candidate like the others. Sums of squares are over weighted rows, not means: ridges and penalties have the units they have in pysindy.

mod criteria;
mod cross_validation;
mod ensemble;
mod error;
mod frols;
mod joint;
mod optimizer;
mod path;
mod prepared;
mod refits;
mod run;
mod scaling;
mod select;
mod sr3;
mod ssr;
mod stlsq;
mod supports;
mod sweep;
mod terms;
mod trail;
mod triangle;

pub(crate) use criteria::scores as criteria_of_steps;
pub use criteria::{Criteria, Criterion, CriterionOptions};
pub use cross_validation::{FoldProblem, FoldScores, score_supports};
pub use ensemble::{Ensemble, EnsembleOptions, ensemble};
pub use error::ThresholdError;
pub use frols::{Frols, FrolsChoice};
pub use joint::Joint;
pub use optimizer::{Optimizer, optimize};
pub use path::PenalisedPath;
pub use refits::refit_supports;
pub use scaling::Scaling;
pub use select::{Choice, Sweep, SweepOptions, sweep};
pub use sr3::{Regularizer, Sr3};
pub use ssr::{Removal, Ssr};
pub use stlsq::Stlsq;
pub use supports::Rivals;
pub use sweep::{Thresholds, sweep_thresholds};
pub use terms::Terms;
pub use trail::{Status, Step, StepCertificate, Trail};
