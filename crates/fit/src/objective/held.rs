//! Maps that stay bounded when they are fitted to simulations.

use faer::Mat;
use fleetfoot_dynamics::{Coefficient, NormalBlocks};
use fleetfoot_estimate::Hold;
use fleetfoot_model::Model;
use fleetfoot_pwa::{Contracting, Problem, RegionWeight, Stability};

use super::Bounded;
use crate::error::Error;

/// Piecewise-affine models whose regions contract in one metric.
pub(crate) struct Bound(Contracting);

/// Weight of a function that no region uses, as no row determines it: its coefficients stay zero.
const UNUSED: f64 = 1e12;

impl Bound {
    /// In the metric that a fit of one step found.
    ///
    /// # Errors
    /// Those of [`Contracting::new`].
    pub(crate) fn new(problem: &Problem, stability: &Stability) -> Result<Self, Error> {
        Ok(Self(Contracting::new(problem, stability)?))
    }

    /// Contraction of a model of the set.
    pub(crate) fn stability_of(&self, before: &Stability, model: &Model) -> Bounded {
        let stability = self.0.stability_of(before, model);
        let greatest =
            |of: fn(&fleetfoot_pwa::StableRegion) -> f64| stability.regions.iter().map(of).fold(0.0, f64::max);
        Bounded {
            bound: stability.bound,
            radius: greatest(|one| one.radius),
            norm: greatest(|one| one.norm),
            passive_norm: stability
                .passivity
                .map(|passivity| passivity.regions.iter().map(|one| one.norm).fold(0.0, f64::max)),
        }
    }
}

impl Hold for Bound {
    fn nearest(&self, model: &Model, normal: &NormalBlocks) -> Option<Model> {
        self.0.nearest(model, &weights(model, normal)?)
    }
}

/// The blocks of a region's latents are the products of one library, times the weight of each target.
fn weights(model: &Model, normal: &NormalBlocks) -> Option<Vec<RegionWeight>> {
    let (latents, summary) = (model.latents.len(), model.summaries.first()?);
    let p = model.libraries.first()?.len();
    let blocks: Vec<_> = normal.blocks().collect();
    let place = |coefficient: &Coefficient| coefficient.function.map_or(0, |j| j + 1);
    let of_region = |(at, region): (usize, &fleetfoot_model::RegionSummary)| {
        let block = blocks.get(at * latents..(at + 1) * latents)?;
        let (range, values) = block.first()?;
        let scale = region.rows.max(1) as f64 / values[0];
        let mut products =
            Mat::from_fn(p + 1, p + 1, |i, j| if i == j { UNUSED * region.rows.max(1) as f64 } else { 0.0 });
        for (i, left) in normal.coefficients()[range.clone()].iter().enumerate() {
            for (j, right) in normal.coefficients()[range.clone()].iter().enumerate() {
                products[(place(left), place(right))] = scale * values[i * range.len() + j];
            }
        }
        Some(RegionWeight::new(products, block.iter().map(|(_, block)| block[0] / values[0]).collect()))
    };
    summary.regions.iter().enumerate().map(of_region).collect()
}
