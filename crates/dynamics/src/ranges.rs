//! Ranges of regressors in training.

use fleetfoot_model::{LatentGroup, Model};

use crate::kernel::padded;

/// Ranges of the regressors in use, per region.
pub(crate) struct Ranges {
    pub(crate) width: usize,
    pub(crate) low: Vec<f64>,
    pub(crate) high: Vec<f64>,
}

impl Ranges {
    /// Puts values outside of a region's range on its border; NaN stays.
    #[inline(always)]
    pub(crate) fn hold(&self, region: usize, functions: &mut [f64]) {
        let indices = region * self.width..(region + 1) * self.width;
        for ((value, &low), &high) in functions.iter_mut().zip(&self.low[indices.clone()]).zip(&self.high[indices]) {
            *value = held(*value, low, high);
        }
    }

    /// As [`Self::hold`], and what is left of every function beside the held value; whether any was outside.
    #[inline(always)]
    pub(crate) fn split(&self, region: usize, functions: &mut [f64], excess: &mut [f64]) -> bool {
        let indices = region * self.width..(region + 1) * self.width;
        let mut outside = false;
        let bounds = self.low[indices.clone()].iter().zip(&self.high[indices]);
        for ((value, excess), (&low, &high)) in functions.iter_mut().zip(excess).zip(bounds) {
            let within = held(*value, low, high);
            *excess = if within == *value { 0.0 } else { *value - within };
            outside |= *excess != 0.0;
            *value = within;
        }
        outside
    }

    /// The value of a function as the map of a region takes it.
    pub(crate) fn held(&self, region: usize, function: usize, value: f64) -> f64 {
        let at = region * self.width + function;
        held(value, self.low[at], self.high[at])
    }

    /// True if a function is outside of its range in a region.
    pub(crate) fn is_outside(&self, region: usize, function: usize, value: f64) -> bool {
        self.held(region, function, value) != value && !value.is_nan()
    }

    /// The ranges of the functions in use of a group of latents; `None` where its partition has no statistics of them.
    pub(crate) fn new(model: &Model, group: &LatentGroup) -> Option<Self> {
        let regions = &model.summaries[group.partition].regions;
        let functions = model.libraries[group.library].len();
        if regions.iter().any(|region| region.range.len() != functions) {
            return None;
        }
        let width = padded(group.functions.len());
        let bounds = |end: usize, pad: f64| -> Vec<f64> {
            let of_region = |region: &fleetfoot_model::RegionSummary| {
                let ends = group.functions.iter().map(|&j| region.range[j][end]);
                ends.chain(std::iter::repeat(pad)).take(width).collect::<Vec<_>>()
            };
            regions.iter().flat_map(of_region).collect()
        };
        Some(Self { width, low: bounds(0, f64::NEG_INFINITY), high: bounds(1, f64::INFINITY) })
    }
}

/// A value on the border of a range that it is outside of; of a region without rows, whose range is empty, and of what is not a number the value itself.
#[inline(always)]
fn held(value: f64, low: f64, high: f64) -> f64 {
    if value < low && low <= high {
        low
    } else if value > high && low <= high {
        high
    } else {
        value
    }
}
