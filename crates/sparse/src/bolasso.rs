//! Bolasso and stability selection: selections on which many resamples of the data agree (block-sparse bolasso paper,
//! section 7.1).
//!
//! The lasso keeps the columns that made the data. With a probability that does not fall to zero, it also keeps others
//! that are correlated with them. These change from resample to resample; the intersection of the supports is
//! consistent (Bach 2008; Theorem 7.1 of the paper) at lambda = lambda_0 / sqrt(n) ([`bach_lambda`]). There are three
//! resamplings: rows as in the paper ([`row_bootstrap`], one pass), chunks or episodes ([`block_bootstrap`], no pass),
//! and complementary halves ([`stability_selection`], no pass). Thousands of columns are resampled as rows in memory
//! ([`dense_bootstrap`]).

mod blocks;
mod counts;
mod dense;
mod error;
mod joint;
mod pairs;
mod resample;
mod rows;
mod selection;
mod stability;
mod tile;
mod unit;

pub use blocks::block_bootstrap;
pub use counts::{multinomial_counts, poisson_counts};
pub use dense::{DenseBootstrap, dense_bootstrap};
pub use error::BolassoError;
pub use rows::row_bootstrap;
pub use selection::{BootstrapOptions, Selection, bach_lambda};
pub use stability::{Stability, StabilityOptions, stability_selection};
pub use unit::BootstrapUnit;

pub use crate::structured::refit;
