//! Penalties as estimators, for selection, refits and reports.
//!
//! Selection, criteria, sweeps of supports, and the recipes of `fit sparse` and `fit sindy` use an [`Estimator`]
//! without its penalty; the solvers are in `path_solver.rs`. A new penalty is a module with its shape for the
//! certificate (`shape`) and its solutions, a variant here, and a `PathSolver` there.

use crate::{coordinate::CoordinateOptions, group::GroupLasso};

/// A penalty, and how its solutions are found.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Estimator {
    /// The lasso and the elastic net.
    ElasticNet(ElasticNet),
    /// The group lasso and the sparse-group lasso.
    GroupLasso(GroupLasso),
}

impl Default for Estimator {
    /// The lasso.
    fn default() -> Self {
        Self::ElasticNet(ElasticNet::default())
    }
}

impl From<ElasticNet> for Estimator {
    fn from(net: ElasticNet) -> Self {
        Self::ElasticNet(net)
    }
}

impl From<GroupLasso> for Estimator {
    fn from(lasso: GroupLasso) -> Self {
        Self::GroupLasso(lasso)
    }
}

/// End of a path.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Stop {
    /// The smallest lambda, in the units of the target; 0: where the estimator ends its paths.
    pub lambda: f64,
    /// The most columns with coefficients that are not zero; `None`: all.
    pub max_features: Option<usize>,
}

/// The lasso and the elastic net: by LARS where its knots are wanted or few columns make it the cheaper way, else by coordinate descent.
#[derive(Debug, Clone, PartialEq)]
pub struct ElasticNet {
    /// Share of the l1 penalty: 1 is the lasso; below it, coordinate descent solves the elastic net.
    pub l1_ratio: f64,
    /// The most columns for which whole LARS paths are followed to compare lambdas; beyond, coordinate descent goes from lambda to lambda.
    pub most_for_lars: usize,
    /// Options of coordinate descent; its `l1_ratio` is the one above.
    pub descent: CoordinateOptions,
}

impl Default for ElasticNet {
    /// The lasso.
    fn default() -> Self {
        Self { l1_ratio: 1.0, most_for_lars: 400, descent: CoordinateOptions::default() }
    }
}

impl ElasticNet {
    /// With this share of the l1 penalty.
    pub fn new(l1_ratio: f64) -> Self {
        Self { l1_ratio, ..Self::default() }
    }
}
