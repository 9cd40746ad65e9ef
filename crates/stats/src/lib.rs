//! Mergeable statistics, the one reduction over rows, the one scan of columns, and the small solves.
//!
//! A statistic of rows is the same whether it was summed at once or in parts; a fit needs the statistic and no rows.
//!
//! ```
//! use fleetfoot_stats::Gram;
//!
//! let (x, y) = ([0.0, 1.0, 2.0, 3.0], [1.0, 3.0, 5.0, 7.0]);
//! let whole = Gram::of_columns(&[&x, &y], None);
//! let mut merged = Gram::of_columns(&[&x[..1], &y[..1]], None);
//! merged.merge(&Gram::of_columns(&[&x[1..], &y[1..]], None));
//! assert_eq!(merged.rows, 4);
//! assert!((merged.get(0, 1) - whole.get(0, 1)).abs() < 1e-14);
//! // The slope of y over x: their centred product over the centred square of x.
//! assert!((whole.get(0, 1) / whole.get(0, 0) - 2.0).abs() < 1e-14);
//! ```

// plan, keys, reduction
mod bank;
mod blocks;
mod bytes;
mod folds;
mod keys;
mod moments;
mod plan;
mod reduce;
pub mod scan;
pub use bank::Bank;
pub use blocks::blocks;
pub use bytes::StatsBytesError;
pub use folds::{FoldError, FoldLayout, FoldRule, Purge, SPANS};
pub use keys::{Fold, Key, Keyed, MergeError, Stats, Sum};
pub use moments::Moments;
pub use plan::{COARSE, Chunk, FINE, Grid, PlanError, plan_hash};
pub use reduce::{TILE_ROWS, reduce};

// numerics
mod autocorrelation;
mod autoregression;
mod batch_means;
mod cholesky;
mod collinearity;
mod compressed;
mod concentration;
mod contraction;
mod duration;
mod errors;
mod factor;
mod fisher;
mod front;
mod gram;
pub mod householder;
mod information;
mod interval;
pub mod kernel;
mod log_determinant;
mod mahalanobis;
mod nonuniformity;
mod polynomial;
mod pooled;
mod precondition;
mod preconditioned;
mod row_gram;
mod same_coefficients;
mod score;
mod separation;
mod solve;
mod square_root;
mod svd;
mod tile;
mod triangle;
pub use autocorrelation::Autocorrelation;
pub use autoregression::Autoregression;
pub use batch_means::BatchMeans;
pub use cholesky::PivotedCholesky;
pub use collinearity::Collinearity;
pub use compressed::Compressed;
pub use concentration::Concentration;
pub use contraction::{Contracted, Contraction, lyapunov, spectral_radius};
pub use duration::{duration_in_words, expected_seconds, long_work};
pub use errors::{ErrorSum, ErrorSums, explained_share};
pub use factor::Factor;
pub use fisher::f_tail;
pub use front::front;
pub use gram::Gram;
pub use information::{aic, bic};
pub use interval::{Basis, Estimate, student_t_95};
pub use log_determinant::LogDeterminant;
pub use mahalanobis::Mahalanobis;
pub use nonuniformity::nonuniformity;
pub use polynomial::{PolynomialBank, PolynomialError, PolynomialMoments, PolynomialPlan, PolynomialScratch};
pub use pooled::Features;
pub use precondition::{Preconditioner, PreconditionerError};
pub use row_gram::RowGram;
pub use same_coefficients::{Leftover, LikelihoodRatio, same_coefficients};
pub use score::Score;
pub use solve::{Solution, least_squares, ridge};
pub use square_root::SquareRoot;
pub use svd::{Svd, svd};
