//! The training range: distance of a row from the training rows of its region.

use fleetfoot_data::{packed, packed_row};
use fleetfoot_model::{Model, RegionSummary};

use crate::{
    Mahalanobis,
    kernel::{padded, within},
};

/// Position of a row relative to the training range of the regressors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Domain {
    /// Every regressor is within the range that its region saw.
    #[default]
    Inside,
    /// Some regressor is outside the range of its region, but within that of all regions together.
    OutsideRegion,
    /// Some regressor is outside the range of all training rows.
    OutsideTraining,
}

/// The regions' statistics of a latent's regressors, ready to measure rows.
pub(crate) struct TrainingDomain {
    functions: usize,
    width: usize,
    regions: Vec<RegionDomain>,
    low: Vec<f64>,
    high: Vec<f64>,
    /// Metric of all training rows together.
    overall: Mahalanobis,
}

struct RegionDomain {
    mean: Vec<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
    metric: Mahalanobis,
}

/// Position of a row relative to the training rows.
pub(crate) struct Place {
    /// Distance from the region's mean under the region's covariance.
    pub(crate) distance: f64,
    /// The same under the covariance of all training rows.
    pub(crate) centre_distance: f64,
    pub(crate) domain: Domain,
}

impl TrainingDomain {
    /// The domain of the functions `kept` of a library over a partition; `None` where the partition has no statistics of them.
    pub(crate) fn new(model: &Model, library: usize, partition: usize, kept: &[usize]) -> Option<Self> {
        let regions = &model.summaries[partition].regions;
        let all = model.libraries[library].len();
        if regions.is_empty() || regions.iter().any(|region| region.mean.len() != all) {
            return None;
        }
        let regions: Vec<RegionSummary> = regions.iter().map(|region| restricted(region, kept)).collect();
        let functions = kept.len();
        let covariance = overall_covariance(&regions, functions);
        let scale: Vec<f64> = (0..functions)
            .map(|j| {
                let deviation = covariance[packed(j, j)].sqrt();
                // Columns that never varied are measured in units of their size.
                let size = regions.iter().map(|region| region.mean[j].abs()).fold(0.0, f64::max);
                if deviation > 0.0 { deviation } else { size }
            })
            .collect();
        let width = padded(functions);
        let bounds = |region: &RegionSummary, end: usize| -> Vec<f64> {
            let pad = if end == 0 { f64::NEG_INFINITY } else { f64::INFINITY };
            region.range.iter().map(|range| range[end]).chain(std::iter::repeat(pad)).take(width).collect()
        };
        let mut low = vec![f64::INFINITY; width];
        let mut high = vec![f64::NEG_INFINITY; width];
        let regions: Vec<RegionDomain> = regions
            .iter()
            .map(|region| {
                let domain = RegionDomain {
                    mean: region.mean.clone(),
                    low: bounds(region, 0),
                    high: bounds(region, 1),
                    metric: Mahalanobis::new(&region.covariance, &scale),
                };
                for j in 0..width {
                    low[j] = low[j].min(domain.low[j]);
                    high[j] = high[j].max(domain.high[j]);
                }
                domain
            })
            .collect();
        Some(Self { functions, width, regions, low, high, overall: Mahalanobis::new(&covariance, &scale) })
    }

    /// Length of the scratch memory of [`Self::place`].
    pub(crate) fn scratch(&self) -> usize {
        2 * self.width
    }

    /// Measures one row; `features` are padded with zeros. The scratch has [`Self::scratch`] values.
    #[inline(always)]
    pub(crate) fn place<S: pulp::Simd>(&self, simd: S, region: usize, features: &[f64], scratch: &mut [f64]) -> Place {
        let info = &self.regions[region];
        let (error, scratch) = scratch.split_at_mut(self.width);
        for j in 0..self.functions {
            error[j] = features[j] - info.mean[j];
        }
        let distance = info.metric.score_with(error, scratch);
        let centre_distance = self.overall.score_with(error, scratch);
        let domain = if within(simd, features, &info.low, &info.high) {
            Domain::Inside
        } else if within(simd, features, &self.low, &self.high) {
            Domain::OutsideRegion
        } else {
            Domain::OutsideTraining
        };
        Place { distance, centre_distance, domain }
    }

    /// Padded number of functions.
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Number of regions.
    pub(crate) fn regions(&self) -> usize {
        self.regions.len()
    }
}

/// Summary of a region for some of its functions.
fn restricted(region: &RegionSummary, kept: &[usize]) -> RegionSummary {
    let pairs = kept.iter().enumerate().flat_map(|(a, &i)| kept[..=a].iter().map(move |&j| packed(i, j)));
    RegionSummary {
        mean: kept.iter().map(|&j| region.mean[j]).collect(),
        range: kept.iter().map(|&j| region.range[j]).collect(),
        covariance: pairs.map(|at| region.covariance[at]).collect(),
        ..region.clone()
    }
}

/// Covariance of the regressors over all training rows: within the regions and between their means.
fn overall_covariance(regions: &[RegionSummary], functions: usize) -> Vec<f64> {
    let total: f64 = regions.iter().map(|region| region.rows as f64).sum();
    let mut mean = vec![0.0; functions];
    let mut covariance = vec![0.0; packed_row(functions)];
    if total == 0.0 {
        return covariance;
    }
    for region in regions.iter().filter(|region| region.rows > 0) {
        for j in 0..functions {
            mean[j] += region.mean[j] * (region.rows as f64 / total);
        }
    }
    for region in regions.iter().filter(|region| region.rows > 0) {
        let share = region.rows as f64 / total;
        for i in 0..functions {
            for j in 0..=i {
                let between = (region.mean[i] - mean[i]) * (region.mean[j] - mean[j]);
                covariance[packed(i, j)] += share * (region.covariance[packed(i, j)] + between);
            }
        }
    }
    covariance
}
