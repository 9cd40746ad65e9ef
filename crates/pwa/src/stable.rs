//! Stability as a constraint: the affine maps of all regions contract in one metric.
//!
//! Over one sampling period a model with fitted derivatives advances its states, by Euler's step, to
//! `x + h (A_i x + ...)`. One with next values or changes advances them to `A_i x + ...` or `x + A_i x + ...`. Lags
//! make the earlier rows part of the state. So a region has a matrix M_i that is affine in its coefficients, and the
//! condition is
//!
//! ```text
//! |T M_i T^-1|_2 <= rho    for all regions i, with one T
//! ```
//!
//! the common quadratic bound `M_i' P M_i <= rho^2 P`, `P = T'T`. It holds for every sequence of regions: with rho at
//! most 1 no sequence grows, and for rho below 1 the effect of constants and inputs stays bounded. For derivatives the
//! circle condition `|I + h A| <= 1` also bounds the exact flow: the logarithmic norm of A is at most
//! `(|I + h A| - 1) / h`. It bounds the steps of the classical method of Runge and Kutta too, whose radius of
//! contractivity for linear equations is 1 (Spijker 1983; Kraaijevanger 1991).
//!
//! For given T the regions are independent. The coefficients of each are the nearest to the free ones in the metric of
//! its Gram matrix, so that the price in squared error is least ([`fleetfoot_stats::Contraction`]). T itself is
//! searched for: from the Lyapunov equation of the one-region model and from the states' units, by descent along the
//! derivative of the price, which the dual points give. Every T of the search is sound; a better one is cheaper.

// Matrices are capitals.
#![allow(non_snake_case)]

mod held;
mod looped;
mod metric;
mod region;
mod search;

use faer::{Mat, linalg::solvers::Solve};
use fleetfoot_stats::{SquareRoot, spectral_radius, svd};
use std::collections::BTreeMap;

use crate::{
    Error,
    region_model::{Base, RegionModel},
};
pub use held::Contracting;
pub(crate) use looped::Loop;
pub use looped::{PassiveRegion, Passivity};
use metric::Metric;
use region::Region;
pub use region::RegionWeight;

/// That the maps of a model contract, with the metric in which they do.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Stability {
    /// rho: the bound of all regions' norms over one sampling period.
    pub bound: f64,
    /// Variables that the maps advance: states, and earlier rows of them, `lag(y, 1)`.
    pub variables: Vec<String>,
    /// States that the regions read and that act as inputs here: their equations are given and not linear, or read through bounded functions alone.
    pub inputs: Vec<String>,
    /// P (n x n, by rows), in the units of the variables: `|x|^2 = x' P x` shrinks at least by the square of the bound.
    pub metric: Vec<f64>,
    /// One a region.
    pub regions: Vec<StableRegion>,
    /// Passivity at ports; `None` unless the maps are passive. The metric is then twice the energy.
    pub passivity: Option<Passivity>,
}

/// The map of one region, free and bound.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct StableRegion {
    /// Spectral radius of the free map.
    pub free_radius: f64,
    /// Its norm in the metric.
    pub free_norm: f64,
    /// Spectral radius of the map that is written.
    pub radius: f64,
    /// Its norm in the metric: at most the bound.
    pub norm: f64,
    /// Relative duality gap: how much nearer to the free map one within the bound could be; 0 where the free one is. Of the map of one step, whatever it is fitted to after.
    pub gap: f64,
}

impl Stability {
    /// Regions whose maps had to move.
    pub fn moved(&self) -> usize {
        match &self.passivity {
            None => self.regions.iter().filter(|region| region.free_norm > self.bound).count(),
            Some(passivity) => passivity.regions.iter().filter(|region| region.free > 1.0).count(),
        }
    }
}

/// Relative duality gap of the maps that are written.
const GAP: f64 = 1e-8;

impl Loop {
    /// The models of all regions, moved as little as their rows allow to where they contract in one metric; `shrinkage` is that of [`crate::fit::region_models`].
    pub(crate) fn bound(
        &self,
        models: &mut [RegionModel],
        base: &Base,
        training: &BTreeMap<u32, SquareRoot>,
        shrinkage: f64,
    ) -> Result<Stability, Error> {
        match self.bound_all(models, base, training, shrinkage)? {
            Some(value) => Ok(value),
            // Given equations that nothing can hold: then the states that they advance are inputs.
            None => match self.without_given() {
                Some(open) => open.bound_all(models, base, training, shrinkage)?,
                None => None,
            }
            .ok_or_else(|| self.none()),
        }
    }

    /// That nothing is found.
    fn none(&self) -> Error {
        match &self.ports {
            None => Error::NoMetric { bound: self.bound },
            Some(ports) => {
                let ports: Vec<String> =
                    ports.ports.iter().map(|port| format!("{}:{}", port.input, port.output)).collect();
                Error::NoStorage { ports: ports.join(", ") }
            }
        }
    }

    fn bound_all(
        &self,
        models: &mut [RegionModel],
        base: &Base,
        training: &BTreeMap<u32, SquareRoot>,
        shrinkage: f64,
    ) -> Result<Option<Stability>, Error> {
        let settled = self.settled(base);
        let settled = &settled;
        let noise = noise(base);
        let regions: Vec<Region> = models
            .iter()
            .enumerate()
            .map(|(at, model)| {
                let root = training.get(&(at as u32)).unwrap_or(&base.root);
                Region::new(settled, model, root, (&base.scale, shrinkage), &noise)
            })
            .collect::<Option<_>>()
            .ok_or_else(|| self.none())?;
        let Some(metric) = Metric::search(settled, &regions, base)? else { return Ok(None) };
        let nearest = metric.nearest(settled, &regions, GAP)?;
        let Some(contracted_regions) = nearest else { return Ok(None) };
        let (mut stable_regions, mut passive) = (Vec::with_capacity(models.len()), Vec::new());
        for ((model, region), contracted) in models.iter_mut().zip(&regions).zip(&contracted_regions) {
            let free = settled.map(&model.coefficients);
            if contracted.distance > 0.0 {
                let root = training.get(&(stable_regions.len() as u32)).unwrap_or(&base.root);
                region.write(settled, &contracted.values, model, root);
            }
            let written = settled.map(&model.coefficients);
            let gap = if contracted.distance > 0.0 { contracted.gap / contracted.distance } else { 0.0 };
            if settled.ports.is_some() {
                let [free, norm] = [&free, &written].map(|map| metric.measure(settled, map).0);
                passive.push(PassiveRegion { free, norm });
            }
            stable_regions.push(StableRegion {
                free_radius: settled.radius(&free),
                free_norm: metric.norm(&free),
                radius: settled.radius(&written),
                norm: metric.norm(&written),
                gap,
            });
        }
        let P = metric.matrix();
        Ok(Some(Stability {
            bound: self.bound,
            variables: self.variables.iter().map(ToString::to_string).collect(),
            inputs: self.inputs.clone(),
            metric: (0..P.nrows()).flat_map(|i| (0..P.ncols()).map(move |j| (i, j))).map(|(i, j)| P[(i, j)]).collect(),
            regions: stable_regions,
            passivity: settled.ports.as_ref().map(|port| Passivity { ports: port.ports.clone(), regions: passive }),
        }))
    }

    /// Spectral radius of a map's square part.
    pub(crate) fn radius(&self, map: &Mat<f64>) -> f64 {
        spectral_radius(map.subcols(0, self.variables.len()))
    }

    /// The map of coefficients (s x q) of the functions that read variables and ports.
    pub(crate) fn of_read(&self, read: &Mat<f64>) -> Mat<f64> {
        let mut all = Mat::zeros(self.reads.nrows(), read.ncols());
        for (k, &j) in self.regressors.iter().enumerate() {
            (0..read.ncols()).for_each(|t| all[(j, t)] = read[(k, t)]);
        }
        self.map(&all)
    }

    /// M of a region of these coefficients (p x q): how its variables move over one sampling period; with ports [M N].
    pub(crate) fn map(&self, coefficients: &Mat<f64>) -> Mat<f64> {
        let mut M = self.offset.clone();
        for (t, advanced) in self.targets.iter().enumerate() {
            let Some((row, gain)) = *advanced else { continue };
            for &j in &self.regressors {
                for k in 0..M.ncols() {
                    M[(row, k)] += gain * coefficients[(j, t)] * self.reads[(j, k)];
                }
            }
        }
        M
    }
}

/// Variances of the errors that targets are weighed by: those of the one-region model, and where it is exact a share of the targets' own.
fn noise(base: &Base) -> Vec<f64> {
    let errors = base.root.error(base.average.coefficients.as_ref(), &base.average.intercept);
    let of = |(error, total): (&f64, &f64)| (error.max(1e-9 * total) / base.root.weight).max(f64::MIN_POSITIVE);
    errors.iter().zip(&base.root.total).map(of).collect()
}

/// The largest singular value; infinite where a number is not finite.
fn largest(M: &Mat<f64>) -> f64 {
    svd(M.as_ref()).map_or(f64::INFINITY, |svd| svd.s.first().copied().unwrap_or(0.0))
}

/// The inverse of T.
fn inverse(T: &Mat<f64>) -> Mat<f64> {
    T.partial_piv_lu().solve(Mat::<f64>::identity(T.nrows(), T.ncols()))
}
