//! Models that are kept within the bound when their coefficients are fitted to something else than one step.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, Side};
use fleetfoot_data::{Silent, parallel_map};
use fleetfoot_model::Model;

use super::{Loop, Metric, Region, RegionWeight, Stability, largest};
use crate::{Error, Problem};

/// Relative duality gap of the nearest maps, in squares of the distance: they are looked for at every direction of a search.
const GAP: f64 = 1e-6;

/// The models whose regions contract in one metric: a convex set.
pub struct Contracting {
    state_loop: Loop,
    metric: Metric,
}

impl Contracting {
    /// The set in whose metric a fit with [`Options::stability`](crate::Options::stability) left its model.
    ///
    /// # Errors
    /// Those of reading the states that a problem's regions advance.
    pub fn new(problem: &Problem, stability: &Stability) -> Result<Self, Error> {
        let ports = stability.passivity.as_ref().map_or(&[][..], |passivity| &passivity.ports);
        let whole = Loop::new(problem, stability.bound, ports)?;
        let n = stability.variables.len();
        let none = || Error::NoMetric { bound: stability.bound };
        // Given states that nothing could hold were left out.
        let state_loop = if whole.variables.len() == n { whole } else { whole.without_given().ok_or_else(none)? };
        let P = Mat::from_fn(n, n, |i, j| stability.metric[i * n + j]);
        let root = P.llt(Side::Lower).map_err(|_| none())?.L().transpose().to_owned();
        let start = Mat::zeros(state_loop.regressors.len(), state_loop.targets.len());
        Ok(Self { metric: Metric::new(&state_loop, root, &start).ok_or_else(none)?, state_loop })
    }

    /// The model of the set in which every region's coefficients are nearest to those of a model. `None` if a region
    /// has no room, a decomposition fails, or a latent is not affine. The first partition's regions have one weight
    /// each; maps that contract already stay to the bit.
    pub fn nearest(&self, model: &Model, weights: &[RegionWeight]) -> Option<Model> {
        let (state_loop, metric) = (&self.state_loop, &self.metric);
        let coefficients: Vec<Mat<f64>> = (0..weights.len()).map(|region| coefficients(model, region)).collect();
        let maps: Vec<Mat<f64>> = coefficients.iter().map(|of| state_loop.map(of)).collect();
        let measures: Vec<(f64, f64)> = maps.iter().map(|map| metric.measure(state_loop, map)).collect();
        let norms: Vec<f64> = measures.iter().map(|(norm, _)| *norm).collect();
        let tightest = (0..norms.len()).min_by(|&a, &b| norms[a].total_cmp(&norms[b]))?;
        let steps = parallel_map(weights.len(), &Silent, |at| -> Result<_, Error> {
            if norms[at] <= measures[at].1 {
                return Ok(Some(None));
            }
            let solve = || -> Option<Mat<f64>> {
                let (region, mean) = Region::weighted(state_loop, &coefficients[at], &weights[at])?;
                let problem = region.contraction(state_loop, metric);
                let room = |values: &Mat<f64>| largest(&problem.matrix(values.as_ref()));
                let read = |of: &Mat<f64>| {
                    Mat::from_fn(state_loop.regressors.len(), of.ncols(), |k, t| of[(state_loop.regressors[k], t)])
                };
                let known = region.inner(read(&coefficients[tightest]).as_ref());
                let start = match problem.least() {
                    Some(least) if room(&least) < room(&known) => least,
                    _ => known,
                };
                let nearest = problem.nearest_by_long_steps(region.free.as_ref(), start.as_ref(), GAP)?;
                let mut moved = coefficients[at].clone();
                let change = region.moved(state_loop, &nearest.values, &mut moved);
                // The constant follows the means.
                let p = moved.nrows();
                Some(Mat::from_fn(p + 1, moved.ncols(), |j, t| match j.checked_sub(1) {
                    None => -(0..p).map(|k| mean[k] * change[(k, t)]).sum::<f64>(),
                    Some(j) => moved[(j, t)],
                }))
            };
            Ok(solve().map(Some))
        });
        let mut out = model.clone();
        for (at, step) in steps.ok()?.into_iter().enumerate() {
            let Some(step) = step? else { continue };
            for (t, latent) in out.latents.iter_mut().enumerate() {
                let map = latent.affine_mut()?;
                map.constants[at] += step[(0, t)];
                map.coefficients[at].iter_mut().enumerate().for_each(|(j, value)| *value = step[(j + 1, t)]);
            }
        }
        Some(out)
    }

    /// Report of the bound for the regions of another model of the set.
    pub fn stability_of(&self, before: &Stability, model: &Model) -> Stability {
        let mut stability = before.clone();
        for (at, region) in stability.regions.iter_mut().enumerate() {
            let map = self.state_loop.map(&coefficients(model, at));
            (region.radius, region.norm) = (self.state_loop.radius(&map), self.metric.norm(&map));
            if let Some(passive) = &mut stability.passivity {
                passive.regions[at].norm = self.metric.measure(&self.state_loop, &map).0;
            }
        }
        stability
    }
}

/// The coefficients of a region (p x q).
fn coefficients(model: &Model, region: usize) -> Mat<f64> {
    let p = model.latents.first().map_or(0, |latent| latent.map.features());
    Mat::from_fn(p, model.latents.len(), |j, t| model.latents[t].map.coefficient(region, j))
}
