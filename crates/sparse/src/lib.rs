//! Sparse regression on statistics: paths, bolasso, thresholding.
//!
//! # The objective
//!
//! All solvers here minimise, over the coefficients b of p regressors and a free intercept b0,
//!
//! ```text
//! 1/(2n) sum_i s_i (y_i - x_i'b - b0)^2 + lambda (l1_ratio sum_j w_j |u_j b_j| + (1 - l1_ratio)/2 sum_j w_j (u_j b_j)^2)
//! ```
//!
//! with row weights s and n their sum, penalty factors w_j >= 0 (0: not penalised, infinite: left out), units u_j (the column's deviation with
//! [`Penalty::standardise`], else 1), and signs constrained at will. [`Strength`] is the pair `l1 = lambda l1_ratio`, `l2 = lambda (1 - l1_ratio)`.
//! The rows are known by a statistic, [`Quadratic`]; no solver sees them.
//!
//! scikit-learn's `alpha` is this lambda, and its `Lasso`, `ElasticNet`, `LassoLars` and `lars_path_gram` have this objective with w = u = s = 1.
//! glmnet rescales penalty factors to the sum p; here they are taken as they are.

mod adaptive;
mod bolasso;
mod certificate;
mod cholesky;
mod constrained;
mod coordinate;
mod dense;
mod descent;
mod error;
mod factor;
mod homotopy;
mod inference;
mod lars;
mod moments;
mod narx;
mod path;
mod penalty;
mod quadratic;
mod rows;
mod select;
mod structured;
mod system;
mod threshold;
mod warm;

use fleetfoot_stats::kernel;

pub use adaptive::{Initial, adaptive, degrees_of_freedom};
pub use bolasso::{
    BolassoError, BootstrapOptions, BootstrapUnit, Selection, Stability, StabilityOptions, bach_lambda,
    block_bootstrap, multinomial_counts, poisson_counts, refit, row_bootstrap, stability_selection,
};
pub use certificate::{Certificate, certificate};
pub use constrained::{
    Active, Clearance, Constrained, ConstrainedCertificate, ConstrainedError, ConstrainedLatent, ConstrainedOptions,
    ConstrainedStatus, Constraints, LatentFit, LatentLimit, LatentOptions, Limit, LinearConstraint, constrain_latent,
    constrained,
};
pub use coordinate::{
    CoordinateOptions, Descended, coordinate_descent, coordinate_descent_from, lambda_grid, lambda_max,
};
pub use dense::{DenseDesign, DenseError, DenseRows};
pub use error::SparseError;
pub use inference::{
    BootstrapInterval, Clusters, Confounded, Confounding, Covariance, InferenceError, Influence, InfluenceReport,
    bootstrap_intervals, clustered_covariance, confounded, influence, least_squares_on, system_effective_rows,
    system_errors,
};
pub use lars::{LarsOptions, Method, lars};
pub use narx::{
    Addend, NarxFold, NarxLibrary, NarxOrder, OrderChoice, OrderOptions, OrderScore, OrderSearch, search_orders,
};
pub use path::{Path, PathStatus, Solution};
pub use penalty::{Penalty, Sign, Strength};
pub use quadratic::Quadratic;
pub use select::{
    CriteriaOptions, CrossValidation, Folds, GridSolutions, HeldOut, InformationCriteria, Lambdas, NoiseVariance,
    RandomSplits, SelectError, SelectOptions, Split, cross_validate, cross_validate_problems, cross_validate_task,
    effective_rows, held_out_refit, information_criteria, solve_grid, task_criteria,
};
pub use structured::{
    Assembled, Assembly, Banks, Candidates, Plan, Regression, RowCounts, ScanError, Scanned, Spread, Structure, Task,
    TaskError, TaskShape, TaskStats, Term, Tikhonov,
};
pub use system::{
    SampledChunks, System, SystemError, SystemPlan, SystemScan, Unit, sampled_by_chunk, sampled_mean_squares,
};
pub use threshold::{
    Choice, Criteria, Criterion, CriterionOptions, Ensemble, EnsembleOptions, FoldProblem, FoldScores, Frols,
    FrolsChoice, Joint, LassoPath, Optimizer, Regularizer, Removal, Rivals, Scaling, Sr3, Ssr, Status, Step,
    StepCertificate, Stlsq, Sweep, SweepOptions, Terms, ThresholdError, Thresholds, Trail, ensemble, optimize,
    refit_supports, score_supports, sweep, sweep_thresholds,
};
