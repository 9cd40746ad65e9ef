//! Radial functions as candidates of a fit, and the latents that they become.

use std::sync::Arc;

use fleetfoot_data::packed;
use fleetfoot_library::Expr;

use crate::{Basis, BasisMap, Gaussian, Map, Model, Partition, RegionSummary, Rule};

/// Radial functions of some columns, around given centres: candidates of a regression, which is linear in their weights.
///
/// A regression has them written out, one expression each ([`RadialFunctions::expressions`]). In a model they stand as one table of centres
/// ([`RadialFunctions::gather`]).
#[derive(Debug, Clone, PartialEq)]
pub struct RadialFunctions {
    /// Columns, or expressions, of which they are functions.
    pub inputs: Vec<Expr>,
    /// Centres in the units of the inputs, one row a radial function.
    pub centres: Vec<Vec<f64>>,
    /// Standard deviation of each input.
    pub scale: Vec<f64>,
    /// Width of all, in standard deviations.
    pub width: f64,
}

impl RadialFunctions {
    /// Around the centroids of a partition by nearest centroid; `None` for another partition.
    ///
    /// The width is the mean distance of a centre from the nearest other one, in standard deviations. (Moody and
    /// Darken, "Fast learning in networks of locally-tuned processing units", Neural Computation 1989: the global
    /// first-nearest-neighbour heuristic.) It is 1 for a single centre.
    pub fn around(partition: &Partition) -> Option<Self> {
        let Rule::Linear { weights: centroids, .. } = &partition.rule else { return None };
        let square = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        let nearest = |at: usize| {
            let others = centroids.iter().enumerate().filter(|(other, _)| *other != at);
            others.map(|(_, other)| square(&centroids[at], other)).fold(f64::INFINITY, f64::min).sqrt()
        };
        let mean = (0..centroids.len()).map(nearest).sum::<f64>() / centroids.len() as f64;
        let units = || partition.centre.iter().zip(&partition.scale);
        let raw = |standardised: &Vec<f64>| {
            standardised.iter().zip(units()).map(|(z, (centre, scale))| centre + scale * z).collect()
        };
        Some(Self {
            inputs: partition.columns.clone(),
            centres: centroids.iter().map(raw).collect(),
            scale: partition.scale.clone(),
            width: if mean.is_finite() && mean > 0.0 { mean } else { 1.0 },
        })
    }

    /// Every radial function, written out.
    pub fn expressions(&self) -> Vec<Expr> {
        let all = Gaussian {
            inputs: (0..self.inputs.len()).collect(),
            centres: self.centres.clone(),
            scale: self.scale.clone(),
            width: self.width,
        };
        (0..self.centres.len()).map(|k| all.expression(k, &self.inputs)).collect()
    }

    /// Makes latents with a basis of the affine latents over libraries that have these functions written out.
    /// Statistics of the removed functions are left out.
    pub fn gather(&self, model: &mut Model) {
        let expressions = self.expressions();
        for index in 0..model.libraries.len() {
            let library = &model.libraries[index];
            let place = |function: &Expr| expressions.iter().position(|expression| expression == function);
            let (mut kept, mut radial) = (Vec::new(), Vec::new());
            for (at, function) in library.iter().enumerate() {
                match place(function) {
                    Some(k) => radial.push((at, k)),
                    None => kept.push(at),
                }
            }
            if radial.is_empty() {
                continue;
            }
            let mut functions: Vec<Expr> = kept.iter().map(|&at| library[at].clone()).collect();
            let mut input = |input: &Expr| {
                functions.iter().position(|function| function == input).unwrap_or_else(|| {
                    functions.push(input.clone());
                    functions.len() - 1
                })
            };
            let gaussian = Arc::new(Gaussian {
                inputs: self.inputs.iter().map(&mut input).collect(),
                centres: self.centres.clone(),
                scale: self.scale.clone(),
                width: self.width,
            });
            for latent in model.latents.iter_mut().filter(|latent| latent.library == index) {
                let Map::Affine(whole) = &latent.map else { continue };
                let (mut affine, mut weights) = (whole.clone(), Vec::new());
                for row in &mut affine.coefficients {
                    let mut values = vec![0.0; self.centres.len()];
                    radial.iter().for_each(|&(at, k)| values[k] = row[at]);
                    weights.push(values);
                    *row = kept.iter().map(|&at| row[at]).collect();
                    row.resize(functions.len(), 0.0);
                }
                latent.map = BasisMap { affine, basis: Basis::Gaussian(gaussian.clone()), weights }.into();
                // Functions that decay hold themselves, and their slopes have no place among those of the library.
                latent.beyond.clear();
            }
            for (at, summary) in model.summaries.iter_mut().enumerate() {
                let first = model.latents.iter().find(|latent| latent.partition == at);
                if first.is_some_and(|first| first.library == index) {
                    summary.regions.iter_mut().for_each(|region| restrict(region, &kept, functions.len()));
                }
            }
            model.libraries[index] = functions;
        }
    }
}

/// Restricts a region's statistics to some functions; behind them are functions without statistics, `count` in all.
fn restrict(region: &mut RegionSummary, kept: &[usize], count: usize) {
    let known = |values: &[f64], at: usize| values.get(at).copied().unwrap_or(f64::NAN);
    let mut covariance = vec![f64::NAN; count * (count + 1) / 2];
    for (i, &a) in kept.iter().enumerate() {
        for (j, &b) in kept[..=i].iter().enumerate() {
            covariance[packed(i, j)] = known(&region.covariance, packed(a, b));
        }
    }
    let place = |function: &usize| kept.iter().position(|index| index == function);
    let groups = region.confounded.iter().map(|group| group.iter().filter_map(place).collect::<Vec<_>>());
    region.confounded = groups.filter(|group| group.len() > 1).collect();
    region.mean = kept.iter().map(|&at| known(&region.mean, at)).collect();
    region.mean.resize(count, f64::NAN);
    let everywhere = [f64::NEG_INFINITY, f64::INFINITY];
    region.range = kept.iter().map(|&at| region.range.get(at).copied().unwrap_or(everywhere)).collect();
    region.range.resize(count, everywhere);
    region.covariance = covariance;
}
