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
//!
//! [`GroupLasso`](group::GroupLasso) has norms of groups of columns in place of the squares. What chooses among solutions knows an
//! [`Estimator`](estimator::Estimator) and not its penalty.
//!
//! ```
//! use fleetfoot_sparse::{
//!     Penalty, Quadratic,
//!     lars::{LarsOptions, lars},
//! };
//! use fleetfoot_stats::Gram;
//!
//! // y = 2 a, beside a column b that says nothing: the whole path of the lasso from one statistic.
//! let (a, b, y) = ([1.0, -1.0, 2.0, -2.0], [1.0, 1.0, -1.0, -1.0], [2.0, -2.0, 4.0, -4.0]);
//! let gram = Gram::of_columns(&[&a, &b, &y], None);
//! let problem = Quadratic::from_gram(&gram, &[0, 1], 2)?;
//! let path = lars(&problem, &Penalty::default(), &LarsOptions::default())?;
//! let least = path.knots.last().expect("a path has its beginning").dense(2);
//! assert!((least[0] - 2.0).abs() < 1e-12 && least[1].abs() < 1e-12);
//! assert!(path.knots.iter().all(|knot| knot.certificate.kkt < 1e-8));
//! # Ok::<(), fleetfoot_sparse::SparseError>(())
//! ```

// methods
pub mod adaptive;
pub mod bolasso;
pub mod constrained;
pub mod coordinate;
pub mod dense;
pub mod estimator;
pub mod group;
pub mod inference;
pub mod lars;
pub mod narx;
pub mod select;
pub mod structured;
pub mod threshold;

// what they share
mod ahead;
mod certificate;
mod cholesky;
mod descent;
mod error;
mod factor;
mod grid;
mod homotopy;
mod moments;
mod path;
mod path_solver;
mod penalty;
mod pivoting;
mod products;
mod quadratic;
mod residual;
mod rows;
mod shape;
mod solution;
mod stacked;
mod warm;

pub use certificate::{Certificate, certificate};
pub use error::SparseError;
use fleetfoot_stats::kernel;
pub use path::{Path, PathStatus};
pub use penalty::{Penalty, Sign, Strength};
pub use quadratic::Quadratic;
pub use solution::Solution;
