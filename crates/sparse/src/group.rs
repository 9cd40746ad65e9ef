//! Group and sparse-group lasso: columns that enter together, and columns that may still leave alone.
//!
//! # The objective
//!
//! ```text
//! 1/(2n) rss + lambda ((1 - l1_ratio) sum_g w_g |v_g| + l1_ratio sum_j |v_j|),   v_j = f_j u_j b_j
//! ```
//!
//! with `|v_g|` the Euclidean norm of the coefficients of group g, group weights w_g (by default the root of the number of penalised columns of the group),
//! penalty factors f_j and units u_j as in the lasso's objective. `l1_ratio` 0 is the group lasso (Yuan and Lin 2006), 1 is the lasso, between is the
//! sparse-group lasso (Simon, Friedman, Hastie, Tibshirani 2013); skglm's and adelie's objectives are this one (adelie's `alpha` is 1 for the elastic
//! net's share, which is not offered here). Columns of factor 0 are not penalised, and belong to no group's norm. With the columns of several targets
//! stacked ([`Quadratic::stacked`](crate::Quadratic::stacked)) and a group of a column's coefficients across all targets, it is scikit-learn's
//! `MultiTaskLasso`.

mod block;
mod degrees;
mod descent;
mod groups;
mod lasso;
mod norm;
mod shape;
mod small;
mod solutions;
mod spectrum;

pub(crate) use degrees::degrees_of_freedom;
pub use groups::Groups;
pub use lasso::GroupLasso;
pub(crate) use solutions::{descend, lambda_max};
