//! Penalties by the names that Python has for them: the one place where a new one is added here.

use fleetfoot::sparse::{
    coordinate::CoordinateOptions,
    estimator::{self, ElasticNet},
    group::{GroupLasso, Groups},
};
use pyo3::prelude::*;

use crate::error::Kind;

/// A penalty, and how its solutions are found.
#[pyclass(frozen, module = "fleetfoot._core")]
pub(crate) struct Estimator {
    pub(crate) of: estimator::Estimator,
}

#[pymethods]
impl Estimator {
    /// The lasso and the elastic net, with at most so many sweeps.
    #[staticmethod]
    fn elastic_net(l1_ratio: f64, max_epochs: usize) -> Self {
        let descent = CoordinateOptions { max_epochs, ..CoordinateOptions::default() };
        Self { of: ElasticNet { l1_ratio, descent, ..ElasticNet::default() }.into() }
    }

    /// The group lasso and the sparse-group lasso: the group of every feature, and the weights of the groups (`None`: the roots of their sizes).
    #[staticmethod]
    #[pyo3(signature = (groups, weights, l1_ratio, max_epochs))]
    fn group_lasso(groups: Vec<usize>, weights: Option<Vec<f64>>, l1_ratio: f64, max_epochs: usize) -> PyResult<Self> {
        let (features, weights) = (groups.len(), weights.unwrap_or_default());
        if let Some(feature) = groups.iter().position(|group| *group >= features) {
            let group = groups[feature];
            return Err(Kind::Option.error(format!("feature {feature} is in group {group}: number the groups from 0")));
        }
        let lasso = GroupLasso::new(Groups { of: groups, weights });
        Ok(Self { of: GroupLasso { l1_ratio, max_epochs, ..lasso }.into() })
    }
}
