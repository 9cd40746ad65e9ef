//! The affine model of one region, and the one-region model that it is compared with.

use faer::Mat;
use fleetfoot_stats::{Solution, SquareRoot, least_squares};

/// The affine model of one region: `intercept + coefficients' x`.
#[derive(Debug, Clone)]
pub(crate) struct RegionModel {
    /// p x q.
    pub(crate) coefficients: Mat<f64>,
    pub(crate) intercept: Vec<f64>,
    pub(crate) rank: usize,
    pub(crate) condition: f64,
    pub(crate) confounded: Vec<Vec<usize>>,
}

impl RegionModel {
    pub(crate) fn new(solution: Solution) -> Self {
        let Solution { coefficients, intercept, rank, condition, confounded, .. } = solution;
        Self { coefficients, intercept, rank, condition, confounded }
    }

    /// The mean of the targets.
    fn null(root: &SquareRoot) -> Self {
        let (p, q) = (root.mean_x.len(), root.mean_y.len());
        Self {
            coefficients: Mat::zeros(p, q),
            intercept: root.mean_y.clone(),
            rank: 0,
            condition: 1.0,
            confounded: Vec::new(),
        }
    }
}

/// The one-region model with its prior, fallback, and the units of standardisation.
pub(crate) struct Base {
    pub(crate) root: SquareRoot,
    pub(crate) scale: Vec<f64>,
    pub(crate) average: RegionModel,
    pub(crate) null: RegionModel,
}

impl Base {
    pub(crate) fn new(root: SquareRoot) -> Self {
        let scale = column_scale(&root);
        let average = RegionModel::new(least_squares(&root, &scale));
        let null = RegionModel::null(&root);
        Self { root, scale, average, null }
    }
}

/// Standard deviations of the regressors: column norms of the centred R factor. A constant column gets 1.
pub(crate) fn column_scale(root: &SquareRoot) -> Vec<f64> {
    (0..root.r.ncols())
        .map(|column| match root.r.col(column).norm_l2() / root.weight.sqrt() {
            norm if norm.is_finite() && norm > 1e-12 * root.mean_x[column].abs() => norm,
            _ => 1.0,
        })
        .collect()
}
