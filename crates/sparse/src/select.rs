//! Choosing lambda: cross-validation by reweighting, and information criteria. No pass over rows.

mod criteria;
mod cross_validation;
mod effective;
mod error;
mod folds;
mod held_out;
mod refitted;
mod score;

pub(crate) use criteria::log_binomial;
pub use criteria::{CriteriaOptions, InformationCriteria, NoiseVariance, information_criteria, task_criteria};
pub use cross_validation::{
    GridSolutions, Lambdas, SelectOptions, Split, cross_validate, cross_validate_problems, cross_validate_task,
    solve_grid,
};
pub use effective::effective_rows;
pub use error::SelectError;
pub use folds::{Folds, RandomSplits};
pub use held_out::HeldOut;
pub(crate) use held_out::mean_squares;
pub use refitted::held_out_refit;
pub use score::CrossValidation;
pub(crate) use score::Scored;
