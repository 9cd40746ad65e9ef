//! Statistics of the training rows: in each region, and over all.

use crate::TrainedEpisode;

/// Statistics of the training rows in a partition's regions. A partition has the places of the regions; this has the
/// values that occurred there.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Summary {
    /// One entry per region.
    pub regions: Vec<RegionSummary>,
}

impl Summary {
    /// Training rows of all regions.
    pub fn rows(&self) -> u64 {
        self.regions.iter().map(|region| region.rows).sum()
    }

    /// Regions, the largest first.
    pub fn by_size(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.regions.len()).collect();
        order.sort_by_key(|&region| (std::cmp::Reverse(self.regions[region].rows), region));
        order
    }
}

impl From<Vec<RegionSummary>> for Summary {
    fn from(regions: Vec<RegionSummary>) -> Self {
        Self { regions }
    }
}

/// Statistics of a region's training rows, for filters and for the detection of extrapolation.
///
/// The vectors are over the functions of the library of the partition's first latent (regressors x) and over the fitted
/// equations (targets y). NaN stands for an unknown value: a fit from statistics of several tasks has neither the
/// covariance of two equations' residuals nor absolute errors.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionSummary {
    /// For people: `3`, `grass`, `inner`.
    pub name: String,
    /// Training rows that fell in it.
    pub rows: u64,
    /// Mean of the regressors.
    pub mean: Vec<f64>,
    /// Covariance of the regressors (divisor: rows), packed lower triangle by rows.
    pub covariance: Vec<f64>,
    /// Smallest and largest value of each regressor.
    pub range: Vec<[f64; 2]>,
    /// Covariance of the residuals of the fitted equations (divisor: rows), packed lower triangle by rows.
    pub residual_covariance: Vec<f64>,
    /// Numerical rank of the regression, constant not counted.
    pub rank: usize,
    /// Condition number of the standardised regressors.
    pub condition: f64,
    /// Groups of functions (indices) that the region's rows cannot separate.
    pub confounded: Vec<Vec<usize>>,
}

/// Training data of a model, and the scale of their values.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Training {
    /// Version of fleetfoot.
    pub version: String,
    /// The recipe with all flags applied, TOML.
    pub recipe: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Rows used.
    pub rows: u64,
    /// The episodes used.
    pub episodes: Vec<TrainedEpisode>,
    /// Mean of each fitted target.
    pub target_mean: Vec<f64>,
    /// Covariance of the fitted targets (divisor: rows), packed lower triangle.
    pub target_covariance: Vec<f64>,
    /// Mean absolute deviation of each target from its mean: the error of the null model.
    pub target_deviation: Vec<f64>,
    /// Covariance of the states (divisor: rows), packed lower triangle, in the order of the columns with role State.
    pub state_covariance: Vec<f64>,
    /// Means of the states, in the same order; of models with rotations, empty for others.
    pub state_mean: Vec<f64>,
    /// Numbers inside the equations that were estimated, with their errors; empty for most methods.
    pub parameters: Vec<Estimated>,
    /// Covariance of these numbers, packed lower triangle; NaN where the data do not determine one.
    pub parameter_covariance: Vec<f64>,
}

/// A number inside the equations that was estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimated {
    /// Its name in the recipe.
    pub name: String,
    /// Its value, which stands in the equations.
    pub value: f64,
    /// Half the width of its 95 % interval; infinite where the data do not determine it, 0 where it was given.
    pub half_width: f64,
}
