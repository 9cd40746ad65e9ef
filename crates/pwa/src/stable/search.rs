//! The metric that costs least, searched for.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, Side};
use fleetfoot_data::{Silent, parallel_map};
use fleetfoot_stats::{Contracted, lyapunov, spectral_radius};

use super::{Loop, Metric, Region, largest};
use crate::{Error, region_model::Base};

/// Relative duality gap while the metric is searched for.
const ROUGH: f64 = 1e-3;
/// Trials of the search.
const TRIALS: usize = 40;
/// Relative reduction of the price below which the search ends.
const BETTER: f64 = 1e-3;

/// A metric with what it costs.
struct Tried {
    metric: Metric,
    /// Half the growth of the squared errors over their variances, all regions.
    price: f64,
    /// Its derivative by `dT T^-1`, symmetric.
    slope: Mat<f64>,
}

impl Metric {
    /// Searches from the Lyapunov equation of the one-region model, and from the states' units; `None` where neither has room for all regions.
    pub(crate) fn search(own: &Loop, regions: &[Region], base: &Base) -> Result<Option<Self>, Error> {
        let units = units(own, base);
        let Some((start, M)) = contracting(own, base, &units) else { return Ok(None) };
        let mut roots = vec![Mat::from_fn(units.len(), units.len(), |i, j| if i == j { 1.0 / units[i] } else { 0.0 })];
        // A little under the bound, so that the map itself is strictly within.
        let within = 0.5 * (spectral_radius(M.as_ref()) + own.bound);
        let scaled = Mat::from_fn(M.nrows(), M.ncols(), |i, j| M[(i, j)] / within);
        let weight = Mat::from_fn(units.len(), units.len(), |i, j| if i == j { units[i].powi(-2) } else { 0.0 });
        if let Some(P) = lyapunov(scaled.as_ref(), weight.as_ref())
            && let Ok(factor) = P.llt(Side::Lower)
        {
            roots.push(factor.L().transpose().to_owned());
        }
        let mut best: Option<Tried> = None;
        for root in roots {
            if let Some(tried) = Self::new(root, &start).tried(own, regions)?
                && best.as_ref().is_none_or(|best| tried.price < best.price)
            {
                best = Some(tried);
            }
        }
        match best {
            Some(best) => Ok(Some(best.descend(own, regions)?)),
            None => Ok(None),
        }
    }

    fn tried(self, own: &Loop, regions: &[Region]) -> Result<Option<Tried>, Error> {
        let Some(found) = self.nearest(own, regions, ROUGH)? else { return Ok(None) };
        let n = self.root.nrows();
        let (mut price, mut slope) = (0.0, Mat::<f64>::zeros(n, n));
        for one in &found {
            price += one.distance;
            let G = &one.multiplier * one.matrix.transpose() - one.matrix.transpose() * &one.multiplier;
            slope += Mat::from_fn(n, n, |i, j| -(G[(i, j)] + G[(j, i)]));
        }
        Ok(price.is_finite().then_some(Tried { metric: self, price, slope }))
    }

    /// All regions' coefficients nearest to their free ones; `None` where a region has no room.
    pub(crate) fn nearest(
        &self,
        own: &Loop,
        regions: &[Region],
        tolerance: f64,
    ) -> Result<Option<Vec<Contracted>>, Error> {
        let found = parallel_map(regions.len(), &Silent, |at| -> Result<_, Error> {
            let region = &regions[at];
            let problem = region.contraction(own, self);
            let room = |values: &Mat<f64>| largest(&problem.matrix(values.as_ref()));
            let known = region.inner(self.start.as_ref());
            let start = match problem.least() {
                Some(least) if room(&least) < room(&known) => least,
                _ => known,
            };
            Ok(problem.nearest(region.free.as_ref(), start.as_ref(), tolerance))
        })?;
        Ok(found.into_iter().collect())
    }
}

impl Tried {
    /// Steps of T along the falling price, `T <- (I - eta G / |G|) T`, longer after one that helped and shorter after one that did not.
    fn descend(self, own: &Loop, regions: &[Region]) -> Result<Metric, Error> {
        let (mut at, mut length) = (self, 0.3);
        for _ in 0..TRIALS {
            let size = at.slope.norm_l2();
            if at.price == 0.0 || size == 0.0 || size.is_nan() || length < 1e-3 {
                break;
            }
            let n = at.slope.nrows();
            let one = |i: usize, j: usize| f64::from(u8::from(i == j)) - length * at.slope[(i, j)] / size;
            let root = Mat::from_fn(n, n, one) * &at.metric.root;
            match Metric::new(root, &at.metric.start).tried(own, regions)? {
                Some(next) if next.price < at.price => {
                    let settled = next.price > at.price * (1.0 - BETTER);
                    at = next;
                    if settled {
                        break;
                    }
                    length = (1.6 * length).min(0.5);
                }
                _ => length *= 0.4,
            }
        }
        Ok(at.metric)
    }
}

/// Deviations of the variables, by the functions that read them.
fn units(own: &Loop, base: &Base) -> Vec<f64> {
    let of = |k: usize| {
        let name = &own.variables[k].name;
        let readers = own.regressors.iter().flat_map(|&j| {
            let same = (0..own.variables.len()).filter(|&v| own.variables[v].name == *name);
            same.map(move |v| (j, own.reads[(j, v)].abs())).filter(|(_, slope)| *slope > 0.0)
        });
        readers.map(|(j, slope)| base.scale[j] / slope).fold(0.0, f64::max)
    };
    (0..own.variables.len()).map(of).map(|unit| if unit > 0.0 { unit } else { 1.0 }).collect()
}

/// Coefficients (s x q) between those that move the variables least and those of the one-region model, as near to these as a spectral radius below the bound allows; with their map.
fn contracting(own: &Loop, base: &Base, units: &[f64]) -> Option<(Mat<f64>, Mat<f64>)> {
    let (s, q) = (own.regressors.len(), own.targets.len());
    let average = Mat::from_fn(s, q, |k, t| base.average.coefficients[(own.regressors[k], t)]);
    let scale: Vec<f64> = units.iter().map(|unit| 1.0 / unit).collect();
    let n = units.len();
    let root = Mat::from_fn(n, n, |i, j| if i == j { scale[i] } else { 0.0 });
    let back = Mat::from_fn(n, n, |i, j| if i == j { units[i] } else { 0.0 });
    let reads = Mat::from_fn(s, n, |k, v| own.reads[(own.regressors[k], v)]);
    let left = |i: usize, t: usize| own.targets[t].map_or(0.0, |(row, gain)| root[(i, row)] * gain);
    let problem = fleetfoot_stats::Contraction {
        offset: &root * &own.offset * &back,
        left: Mat::from_fn(n, q, left),
        right: &reads * &back,
        bound: own.bound,
    };
    let least = problem.least()?;
    let map = |share: f64| {
        let A = Mat::from_fn(s, q, |k, t| least[(k, t)] + share * (average[(k, t)] - least[(k, t)]));
        let M = &back * problem.matrix(A.as_ref()) * &root;
        (A, M)
    };
    let fits = |share: f64| spectral_radius(map(share).1.as_ref()) < own.bound * (1.0 - 1e-6);
    if fits(1.0) {
        return Some(map(1.0));
    }
    if !fits(0.0) {
        return None;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if fits(middle) { low = middle } else { high = middle }
    }
    Some(map(low))
}
