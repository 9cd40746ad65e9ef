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

/// A metric with its price.
struct Tried {
    metric: Metric,
    /// Half the growth of the squared errors over their variances, all regions.
    price: f64,
    /// Its derivative by `dT T^-1`, symmetric.
    slope: Mat<f64>,
}

impl Metric {
    /// Searches from the Lyapunov equation of the one-region model, and from the states' units; `None` where neither has room for all regions.
    pub(crate) fn search(state_loop: &Loop, regions: &[Region], base: &Base) -> Result<Option<Self>, Error> {
        let units = units(state_loop, base);
        if state_loop.ports.is_some() {
            return Self::search_passive(state_loop, regions, base, &units);
        }
        let Some((start, M)) = contracting(state_loop, base, &units) else { return Ok(None) };
        let mut roots = vec![Mat::from_fn(units.len(), units.len(), |i, j| if i == j { 1.0 / units[i] } else { 0.0 })];
        // A little under the bound, so that the map itself is strictly within.
        let within = 0.5 * (spectral_radius(M.as_ref()) + state_loop.bound);
        let scaled = Mat::from_fn(M.nrows(), M.ncols(), |i, j| M[(i, j)] / within);
        let weight = Mat::from_fn(units.len(), units.len(), |i, j| if i == j { units[i].powi(-2) } else { 0.0 });
        if let Some(P) = lyapunov(scaled.as_ref(), weight.as_ref())
            && let Ok(factor) = P.llt(Side::Lower)
        {
            roots.push(factor.L().transpose().to_owned());
        }
        Self::cheapest(state_loop, regions, roots.into_iter().map(|root| (root, &start)))
    }

    /// From storages of the one-region model, or of one that is damped until it has any.
    fn search_passive(
        state_loop: &Loop,
        regions: &[Region],
        base: &Base,
        units: &[f64],
    ) -> Result<Option<Self>, Error> {
        let dissipating = dissipating(state_loop, base, units);
        Self::cheapest(state_loop, regions, dissipating.iter().map(|(root, start)| (root.clone(), start)))
    }

    /// The cheapest of some roots with their starts, and the descent from it.
    fn cheapest<'a>(
        state_loop: &Loop,
        regions: &[Region],
        roots: impl Iterator<Item = (Mat<f64>, &'a Mat<f64>)>,
    ) -> Result<Option<Self>, Error> {
        let mut best: Option<Tried> = None;
        for (root, start) in roots {
            let Some(metric) = Self::new(state_loop, root, start) else { continue };
            if let Some(tried) = metric.tried(state_loop, regions)?
                && best.as_ref().is_none_or(|best| tried.price < best.price)
            {
                best = Some(tried);
            }
        }
        match best {
            Some(best) => Ok(Some(best.descend(state_loop, regions)?)),
            None => Ok(None),
        }
    }

    fn tried(self, state_loop: &Loop, regions: &[Region]) -> Result<Option<Tried>, Error> {
        let Some(nearest) = self.nearest(state_loop, regions, ROUGH)? else { return Ok(None) };
        let n = self.root.nrows();
        let (mut price, mut slope) = (0.0, Mat::<f64>::zeros(n, n));
        for one in &nearest {
            price += one.distance;
            let G = self.turned(state_loop, one);
            slope += Mat::from_fn(n, n, |i, j| -(G[(i, j)] + G[(j, i)]));
        }
        Ok(price.is_finite().then_some(Tried { metric: self, price, slope }))
    }

    /// `<Lambda, dK>` as the product of a matrix with `dT T^-1`, of a region's dual point Lambda.
    ///
    /// `K = T M T^-1` turns by `Z K - K Z`. Of a passive loop `K = J L^-T`, J being the map [M N] in the coordinates T
    /// x. Besides J the supply S turns, by `-h C T^-1 Z` and its transpose.
    fn turned(&self, state_loop: &Loop, one: &Contracted) -> Mat<f64> {
        let (Some(supply), Some(ports)) = (&self.supply, &state_loop.ports) else {
            return &one.multiplier * one.matrix.transpose() - one.matrix.transpose() * &one.multiplier;
        };
        let n = self.root.nrows();
        let (dual, K) = (one.multiplier.subrows(0, n), one.matrix.subrows(0, n));
        let J = K * supply.lower.transpose();
        let behind = dual * supply.weight.transpose();
        let back = J.transpose() * &behind;
        let Q = &supply.weight * K.transpose() * &behind;
        let m = supply.gamma.nrows();
        let across = Mat::from_fn(m, n, |i, k| Q[(n + i, k)] + Q[(k, n + i)]);
        let turned = supply.gamma.transpose() * &across;
        let direct = &behind * J.transpose();
        Mat::from_fn(n, n, |i, j| direct[(i, j)] - back[(i, j)] + 0.5 * ports.step * turned[(i, j)])
    }

    /// All regions' coefficients nearest to their free ones; `None` where a region has no room.
    pub(crate) fn nearest(
        &self,
        state_loop: &Loop,
        regions: &[Region],
        tolerance: f64,
    ) -> Result<Option<Vec<Contracted>>, Error> {
        let contracted = parallel_map(regions.len(), &Silent, |at| -> Result<_, Error> {
            let region = &regions[at];
            let problem = region.contraction(state_loop, self);
            let room = |values: &Mat<f64>| largest(&problem.matrix(values.as_ref()));
            let known = region.inner(self.start.as_ref());
            let start = match problem.least() {
                Some(least) if room(&least) < room(&known) => least,
                _ => known,
            };
            Ok(problem.nearest(region.free.as_ref(), start.as_ref(), tolerance))
        })?;
        Ok(contracted.into_iter().collect())
    }
}

impl Tried {
    /// Steps of T along the falling price, `T <- (I - eta G / |G|) T`: longer after a step that helped, and shorter
    /// after one that did not.
    fn descend(self, state_loop: &Loop, regions: &[Region]) -> Result<Metric, Error> {
        let (mut at, mut length) = (self, 0.3);
        for _ in 0..TRIALS {
            let size = at.slope.norm_l2();
            if at.price == 0.0 || size == 0.0 || size.is_nan() || length < 1e-3 {
                break;
            }
            let n = at.slope.nrows();
            let one = |i: usize, j: usize| f64::from(u8::from(i == j)) - length * at.slope[(i, j)] / size;
            let root = Mat::from_fn(n, n, one) * &at.metric.root;
            let next = match Metric::new(state_loop, root, &at.metric.start) {
                Some(metric) => metric.tried(state_loop, regions)?,
                None => None,
            };
            match next {
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
fn units(state_loop: &Loop, base: &Base) -> Vec<f64> {
    let of = |k: usize| {
        let name = &state_loop.variables[k].name;
        let readers = state_loop.regressors.iter().flat_map(|&j| {
            let same = (0..state_loop.variables.len()).filter(|&v| state_loop.variables[v].name == *name);
            same.map(move |v| (j, state_loop.reads[(j, v)].abs())).filter(|(_, slope)| *slope > 0.0)
        });
        readers.map(|(j, slope)| base.scale[j] / slope).fold(0.0, f64::max)
    };
    (0..state_loop.variables.len()).map(of).map(|unit| if unit > 0.0 { unit } else { 1.0 }).collect()
}

/// A metric's root, and coefficients (s x q) whose map is within it.
type Begun = (Mat<f64>, Mat<f64>);

/// Margins of the storages that are tried, in squares of the inputs' power at one deviation over a step.
const MARGINS: [f64; 4] = [1e-1, 1e-2, 1e-3, 1e-4];

/// Roots of storages with which the one-region model dissipates, and its coefficients (s x q). They are unchanged if a
/// storage exists, else as near as one exists for: those of the states first, then those of the ports too.
fn dissipating(state_loop: &Loop, base: &Base, units: &[f64]) -> Vec<Begun> {
    let Some(ports) = &state_loop.ports else { return Vec::new() };
    let n = units.len();
    let states = Loop {
        offset: state_loop.offset.subcols(0, n).to_owned(),
        reads: state_loop.reads.subcols(0, n).to_owned(),
        ports: None,
        ..state_loop.clone()
    };
    let average = Mat::from_fn(state_loop.regressors.len(), state_loop.targets.len(), |k, t| {
        base.average.coefficients[(state_loop.regressors[k], t)]
    });
    let Some(least) = least(&states, units) else { return Vec::new() };
    let is_port = |k: usize| {
        (n..state_loop.reads.ncols()).any(|column| state_loop.reads[(state_loop.regressors[k], column)] != 0.0)
    };
    let at = |share: f64, of_ports: f64| {
        Mat::from_fn(average.nrows(), average.ncols(), |k, t| {
            let (least, average) = (least[(k, t)], average[(k, t)]);
            if is_port(k) { of_ports * average } else { least + share * (average - least) }
        })
    };
    let power = (0..ports.outputs.len()).map(|port| units[ports.outputs[port]] * state_loop.input_unit(port, base));
    let power = ports.step * power.fold(0.0, f64::max);
    let storages = |share: f64, of_ports: f64| -> Vec<Begun> {
        let start = at(share, of_ports);
        let map = state_loop.of_read(&start);
        let root = |margin: &f64| {
            let P = state_loop.storage(&map, units, margin * power)?;
            Some((P.llt(Side::Lower).ok()?.L().transpose().to_owned(), start.clone()))
        };
        MARGINS.iter().filter_map(root).collect()
    };
    let nearest = |of: &dyn Fn(f64) -> Vec<Begun>| {
        let (mut low, mut high, mut best) = (0.0, 1.0, of(0.0));
        for _ in 0..12 {
            let middle = 0.5 * (low + high);
            let tried = of(middle);
            if tried.is_empty() {
                high = middle;
            } else {
                (low, best) = (middle, tried);
            }
        }
        best
    };
    let tries: [&dyn Fn() -> Vec<Begun>; 3] =
        [&|| storages(1.0, 1.0), &|| nearest(&|share| storages(share, 1.0)), &|| {
            nearest(&|share| storages(share, share))
        }];
    tries.iter().map(|attempt| attempt()).find(|attempt| !attempt.is_empty()).unwrap_or_default()
}

/// Coefficients (s x q) that move the variables least, in their units.
fn least(state_loop: &Loop, units: &[f64]) -> Option<Mat<f64>> {
    in_units(state_loop, units).least()
}

/// The maps of the loop in units of the variables.
fn in_units(state_loop: &Loop, units: &[f64]) -> fleetfoot_stats::Contraction {
    let (s, n, q) = (state_loop.regressors.len(), units.len(), state_loop.targets.len());
    let root = Mat::from_fn(n, n, |i, j| if i == j { 1.0 / units[i] } else { 0.0 });
    let back = Mat::from_fn(n, n, |i, j| if i == j { units[i] } else { 0.0 });
    let reads = Mat::from_fn(s, n, |k, v| state_loop.reads[(state_loop.regressors[k], v)]);
    let left = |i: usize, t: usize| state_loop.targets[t].map_or(0.0, |(row, gain)| root[(i, row)] * gain);
    fleetfoot_stats::Contraction {
        offset: &root * &state_loop.offset * &back,
        left: Mat::from_fn(n, q, left),
        right: &reads * &back,
        bound: state_loop.bound,
    }
}

/// Coefficients (s x q) between those that move the variables least and those of the one-region model. They are as near
/// to these as a spectral radius below the bound allows; with their map.
fn contracting(state_loop: &Loop, base: &Base, units: &[f64]) -> Option<(Mat<f64>, Mat<f64>)> {
    let (s, q) = (state_loop.regressors.len(), state_loop.targets.len());
    let average = Mat::from_fn(s, q, |k, t| base.average.coefficients[(state_loop.regressors[k], t)]);
    let scale: Vec<f64> = units.iter().map(|unit| 1.0 / unit).collect();
    let n = units.len();
    let root = Mat::from_fn(n, n, |i, j| if i == j { scale[i] } else { 0.0 });
    let back = Mat::from_fn(n, n, |i, j| if i == j { units[i] } else { 0.0 });
    let problem = in_units(state_loop, units);
    let least = problem.least()?;
    let map = |share: f64| {
        let A = Mat::from_fn(s, q, |k, t| least[(k, t)] + share * (average[(k, t)] - least[(k, t)]));
        let M = &back * problem.matrix(A.as_ref()) * &root;
        (A, M)
    };
    let fits = |share: f64| spectral_radius(map(share).1.as_ref()) < state_loop.bound * (1.0 - 1e-6);
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

#[cfg(test)]
mod tests {
    use fleetfoot_library::Expr;
    use fleetfoot_model::{Column, Equation, Prediction, Role};

    use super::*;
    use crate::{Port, Problem, RegionWeight};

    fn problem() -> Problem {
        let columns = [("x", Role::State), ("v", Role::State), ("f", Role::Input), ("g", Role::Input)];
        let next = |name: &str| Equation {
            subject: name.into(),
            prediction: Prediction::Next,
            right: Expr::column(format!("f_{name}")),
            target: Some(Expr::lagged(name, -1)),
            unit: None,
        };
        Problem {
            columns: columns.map(|(name, role)| Column::new(name, role)).to_vec(),
            library: ["x", "v", "f", "g"].map(Expr::column).to_vec(),
            equations: vec![next("x"), next("v")],
            partition_columns: Vec::new(),
            weight: None,
            step: 0.1,
        }
    }

    /// The derivative of the price by the metric is that of finite differences, with ports and without.
    #[test]
    fn dual_points_give_the_gradient_of_the_price() {
        let port = |input: &str, output: &str, shortage| Port { shortage: Some(shortage), ..Port::new(input, output) };
        for ports in [Vec::new(), vec![port("f", "v", 0.3)], vec![port("f", "v", 0.3), port("g", "x", 0.5)]] {
            let state_loop = Loop::new(&problem(), 0.97, &ports).unwrap();
            // A free map that is not within, of a region whose rows weigh unevenly.
            let free = Mat::from_fn(4, 2, |j, t| [[1.05, -0.2], [0.12, 0.9], [0.05, 0.25], [0.2, -0.1]][j][t]);
            let weigh =
                |i: usize, j: usize| if i == j { 2.0 + i as f64 } else { 0.3 * (i + 2 * j + j * i) as f64 / 5.0 };
            let half = Mat::from_fn(5, 5, weigh);
            let weight = RegionWeight::new(half.transpose() * &half, vec![1.0, 2.5]);
            let (region, _) = Region::weighted(&state_loop, &free, &weight).unwrap();
            let start = Mat::from_fn(state_loop.regressors.len(), 2, |k, t| {
                let j = state_loop.regressors[k];
                0.6 * f64::from(u8::from(j == t)) + if j > 1 { 0.02 } else { 0.0 }
            });
            let root = Mat::from_fn(2, 2, |i, j| [[1.1, 0.2], [0.0, 1.3]][i][j]);
            let solved = |root: Mat<f64>| {
                let metric = Metric::new(&state_loop, root, &start).unwrap();
                let nearest =
                    metric.nearest(&state_loop, std::slice::from_ref(&region), 1e-8).unwrap().unwrap().remove(0);
                (nearest.distance, metric.turned(&state_loop, &nearest))
            };
            let (price, turned) = solved(root.clone());
            assert!(price > 0.05, "{price}");
            for Z in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.4, -0.7, 0.2]] {
                let Z = Mat::from_fn(2, 2, |i, j| Z[i + j]);
                let at = |length: f64| {
                    let one = Mat::from_fn(2, 2, |i, j| f64::from(u8::from(i == j)) + length * Z[(i, j)]);
                    solved(&one * &root).0
                };
                let slope = (at(1e-3) - at(-1e-3)) / 2e-3;
                let expected =
                    -2.0 * (0..2).flat_map(|i| (0..2).map(move |j| (i, j))).map(|at| turned[at] * Z[at]).sum::<f64>();
                // The price is known to 1e-8 of itself, which differences make 1e-5; they err by a millionth of its third derivative.
                assert!(
                    (slope - expected).abs() <= 1e-3 * price.max(expected.abs()),
                    "{ports:?} {Z:?}: {slope} {expected}"
                );
            }
        }
    }
}
