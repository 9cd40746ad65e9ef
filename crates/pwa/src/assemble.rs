//! From solutions to a model: one affine map a region and target, and the training statistics of each region.

use std::collections::BTreeMap;

use fleetfoot_data::{Episode, Source, packed_row};
use fleetfoot_library::Expr;
use fleetfoot_model::{AffineMap, Latent, Model, Partition, RegionSummary, TrainedEpisode, Training};
use fleetfoot_stats::SquareRoot;

use crate::{
    Options, Outside, Problem, Specification, complete::Fit, errors::Errors, region_model::RegionModel,
    residual::Scatter, select::Order,
};

impl Fit<'_> {
    /// Assembles the model of a candidate.
    ///
    /// `scatter` is that of its residuals by region, where no statistic tells it, `roots` the square-root form of each region's rows, `average` the one-region model.
    pub(crate) fn model(
        &self,
        order: &Order,
        candidate: usize,
        errors: &Errors,
        scatter: Option<&Scatter>,
        source: &dyn Source,
        (roots, average): (&BTreeMap<u32, SquareRoot>, &RegionModel),
    ) -> Model {
        let statistic = self.statistic(candidate);
        let candidate = &self.segmentation.candidates[candidate];
        let null = candidate.specification == Specification::Null;
        let library = if null { Vec::new() } else { self.problem.library.clone() };
        let mut partition = self.segmentation.partitions[candidate.full].clone();
        partition.specification = candidate.specification.to_string();
        let regions = order
            .full
            .iter()
            .enumerate()
            .map(|(region, fitted)| {
                let ranges = &self.scan.ranges[candidate.full].0[region];
                let unknown = || vec![f64::NAN; packed_row(self.rows.targets)];
                let residuals = match (statistic, scatter) {
                    // As of a statistic, which has no rows.
                    (Some(sums), _) => {
                        sums.residual_covariance(region, fitted.coefficients.as_ref(), &fitted.intercept)
                    }
                    (None, scatter) => scatter.map_or_else(unknown, |scatter| scatter.covariance(region)),
                };
                described(
                    partition.region_name(region),
                    fitted,
                    roots.get(&(region as u32)),
                    ranges,
                    residuals,
                    library.len(),
                )
            })
            .collect();
        let (q, s) = (self.rows.targets, self.rows.states);
        let scales = self.scan.whole[0].as_ref().map_or(&self.survey.scales, |sums| sums.also());
        // In the order of the sums, whatever the order of the files.
        let mut episodes: Vec<&Episode> = source.episodes().iter().collect();
        episodes.sort_by_key(|episode| episode.id);
        let training = Training {
            version: env!("CARGO_PKG_VERSION").into(),
            recipe: String::new(),
            seed: self.options.seed,
            rows: self.survey.counts.complete,
            episodes: episodes.into_iter().map(TrainedEpisode::from).collect(),
            target_mean: scales.mean[..q].to_vec(),
            target_covariance: scales.covariance(0..q),
            target_deviation: errors.deviation.iter().map(|sum| sum / errors.weight).collect(),
            state_covariance: scales.covariance(q..q + s),
            state_mean: scales.mean[q..q + s].to_vec(),
            ..Training::default()
        };
        let mut model = assembled(self.problem, (partition, regions), library, &order.full, training);
        go_on_outside(&mut model, average, self.options);
        if order.continuity.is_some() {
            model.method.push_str(", continuous");
        }
        model
    }
}

/// The model of a partition whose regions are described: one affine map a region and target.
pub(crate) fn assembled(
    problem: &Problem,
    (partition, regions): (Partition, Vec<RegionSummary>),
    library: Vec<Expr>,
    full: &[RegionModel],
    training: Training,
) -> Model {
    let method = format!("pwa {}", partition.specification);
    let mut model = Model::new(method, problem.columns.clone(), problem.step, training);
    model.latents = problem
        .equations
        .iter()
        .filter(|equation| equation.target.is_some())
        .enumerate()
        .map(|(t, equation)| Latent {
            beyond: Vec::new(),
            // Its plain name, without the backticks that an odd one has within expressions.
            name: equation.right.as_column().map_or_else(|| equation.right.to_string(), str::to_owned),
            library: 0,
            partition: 0,
            map: AffineMap {
                constants: full.iter().map(|region| region.intercept[t]).collect(),
                coefficients: full
                    .iter()
                    .map(|region| (0..library.len()).map(|j| region.coefficients[(j, t)]).collect())
                    .collect(),
            }
            .into(),
        })
        .collect();
    model.libraries = vec![library];
    model.add_partition(partition, regions);
    model.equations = problem.equations.clone();
    model
}

/// Gives a model of several regions what holds outside of their training ranges.
pub(crate) fn go_on_outside(model: &mut Model, average: &RegionModel, options: &Options) {
    let bounded = options.continuous || options.stability.is_some() || !options.ports.is_empty();
    let several = model.partitions.first().is_some_and(|partition| partition.rule.count() > 1);
    if bounded || !several || options.outside == Outside::Extrapolate {
        return;
    }
    let slopes = |t: usize| average.coefficients.col(t).iter().copied();
    for (t, latent) in model.latents.iter_mut().enumerate() {
        latent.beyond = match options.outside {
            Outside::Average => slopes(t).collect(),
            _ => vec![0.0; average.coefficients.nrows()],
        };
    }
}

/// A region as its rows were; `regressors` is 0 for a null model, which has none.
pub(crate) fn described(
    name: String,
    fitted: &RegionModel,
    root: Option<&SquareRoot>,
    ranges: &[[f64; 2]],
    residual_covariance: Vec<f64>,
    regressors: usize,
) -> RegionSummary {
    let p = regressors;
    let mut covariance = vec![f64::NAN; packed_row(p)];
    if let Some(root) = root {
        covariance.iter_mut().zip(root.scatter(0..p)).for_each(|(entry, product)| *entry = product / root.weight);
    }
    RegionSummary {
        name,
        rows: root.map_or(0, |root| root.rows),
        mean: root.map_or_else(|| vec![f64::NAN; p], |root| root.mean_x[..p].to_vec()),
        covariance,
        range: ranges[..p].to_vec(),
        residual_covariance,
        rank: fitted.rank,
        condition: fitted.condition,
        confounded: if p == 0 { Vec::new() } else { fitted.confounded.clone() },
    }
}
