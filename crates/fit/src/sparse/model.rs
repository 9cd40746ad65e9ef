//! From coefficients to a model: one latent a candidate list, each with a separate library and one region.

use std::collections::BTreeSet;

use fleetfoot_data::{packed, packed_row};
use fleetfoot_dataset::{EpisodeRecord, StatisticFile};
use fleetfoot_library::Expr;
use fleetfoot_model::{
    AffineMap, Column, Equation, Latent, Model, Partition, Prediction, RegionSummary, Role, Training,
};
use fleetfoot_stats::{Gram, Key};
use fleetfoot_sums::structured::{Spread, Structure};
use fleetfoot_task::{Moments, StructuredTask};

use super::problem::Problem;

/// The model with the coefficients `theta` (p).
pub(super) fn model(
    problem: &Problem<'_>,
    file: &StatisticFile,
    theta: &[f64],
    method: &str,
    recipe: &str,
    seed: u64,
    wanted: impl Fn(&Key) -> bool,
) -> Model {
    let task = problem.task;
    let also = file.scanned.also.total(&wanted).unwrap_or_else(|| Gram::new(task.also.len()));
    let episodes: BTreeSet<_> = problem.banks.keys().iter().map(|key| key.episode).collect();
    let (targets, states) = (task.targets(), task.states());
    let training = Training {
        version: env!("CARGO_PKG_VERSION").into(),
        recipe: recipe.to_owned(),
        seed,
        rows: problem.roots.first().map_or(0, |root| root.rows),
        episodes: episodes.iter().filter_map(|id| file.episode(*id).map(EpisodeRecord::trained)).collect(),
        target_mean: also.mean[..targets].to_vec(),
        target_covariance: also.covariance(0..targets),
        // An absolute error is no quadratic question: a statistic does not know it.
        target_deviation: vec![f64::NAN; targets],
        state_covariance: also.covariance(targets..targets + states),
        state_mean: also.mean[targets..targets + states].to_vec(),
        ..Training::default()
    };
    let mut model = Model::new(method, columns(task), file.step(), training);
    let ranges = ranges(file, &episodes, theta.len());
    let residuals = residual_covariance(problem, theta);
    for (index, candidates) in task.regression.latents.iter().enumerate() {
        let range = problem.structure.range(index);
        // The function 1 is the latent's constant term.
        let kept: Vec<usize> = range.clone().filter(|&j| !is_one(&candidates.functions[j - range.start])).collect();
        let spread = spread(problem, &also, index);
        let within: Vec<usize> = kept.iter().map(|j| j - range.start).collect();
        model.libraries.push(within.iter().map(|&function| candidates.functions[function].clone()).collect());
        let range_of_kept = kept.iter().map(|&j| ranges[j]).collect();
        let region = region(&spread, &within, range_of_kept, &residuals, &model.training);
        model.add_partition(Partition::whole(), vec![region]);
        model.latents.push(Latent {
            beyond: Vec::new(),
            name: candidates.name.clone(),
            library: index,
            partition: index,
            map: AffineMap {
                constants: vec![
                    range.clone().filter(|&j| is_one(&candidates.functions[j - range.start])).map(|j| theta[j]).sum(),
                ],
                coefficients: vec![kept.iter().map(|&j| theta[j]).collect()],
            }
            .into(),
        });
    }
    model.equations.clone_from(&task.equations);
    model
}

fn is_one(function: &Expr) -> bool {
    function.as_number() == Some(1.0)
}

/// The columns of the model's expressions, without those that only a task or a prior needed.
fn columns(task: &StructuredTask) -> Vec<Column> {
    let functions = task.regression.latents.iter().flat_map(|latent| &latent.functions);
    let sides = task.equations.iter().flat_map(|equation| std::iter::once(&equation.right).chain(&equation.target));
    let mut used: BTreeSet<String> =
        functions.chain(sides).flat_map(Expr::columns).map(|name| name.to_string()).collect();
    used.extend(task.equations.iter().map(|equation: &Equation| equation.subject.clone()));
    task.columns.iter().filter(|column| column.role == Role::State || used.contains(&column.name)).cloned().collect()
}

/// Least and greatest value of every function over some episodes.
fn ranges(file: &StatisticFile, episodes: &BTreeSet<fleetfoot_data::EpisodeId>, p: usize) -> Vec<[f64; 2]> {
    let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; p];
    for (_, ranges_of) in file.scanned.ranges.iter().filter(|(id, _)| episodes.contains(id)) {
        for (all, some) in ranges.iter_mut().zip(ranges_of) {
            *all = [all[0].min(some[0]), all[1].max(some[1])];
        }
    }
    ranges
}

/// Spread of a latent's functions over the training rows.
fn spread(problem: &Problem<'_>, also: &Gram, latent: usize) -> Spread {
    let count = problem.structure.functions[latent];
    match problem.task.moments[latent] {
        Moments::Task { task, first, factor } => Spread::of(&problem.roots[task], first..first + count, factor),
        Moments::Also(first) => Spread::of_gram(also, first..first + count),
    }
}

fn region(
    spread: &Spread,
    kept: &[usize],
    range: Vec<[f64; 2]>,
    residuals: &[f64],
    training: &Training,
) -> RegionSummary {
    let place = |function: &usize| kept.iter().position(|known| known == function);
    let covariance =
        kept.iter().enumerate().flat_map(|(at, &i)| kept[..=at].iter().map(move |&j| spread.covariance[packed(i, j)]));
    let confounded = spread.confounded.iter().map(|group| group.iter().filter_map(place).collect::<Vec<_>>());
    RegionSummary {
        name: "all".into(),
        rows: training.rows,
        mean: kept.iter().map(|&j| spread.mean[j]).collect(),
        covariance: covariance.collect(),
        range,
        residual_covariance: residuals.to_vec(),
        rank: spread.rank,
        condition: spread.condition,
        confounded: confounded.filter(|group| group.len() > 1).collect(),
    }
}

/// Variance of the residuals of the equations that are tasks themselves. NaN for values that the tasks' statistics do
/// not have: other equations, products of two equations' residuals.
fn residual_covariance(problem: &Problem<'_>, theta: &[f64]) -> Vec<f64> {
    let fitted: Vec<&Equation> = problem.task.equations.iter().filter(|equation| equation.target.is_some()).collect();
    let mut covariance = vec![f64::NAN; packed_row(fitted.len())];
    let errors = problem.structure.errors(&problem.roots, theta);
    for (index, equation) in fitted.iter().enumerate() {
        if let Some(task) = task_of(problem.task, &problem.structure, equation) {
            covariance[packed(index, index)] = errors[task].mse;
        }
    }
    covariance
}

/// The task that an equation is.
fn task_of(task: &StructuredTask, structure: &Structure, equation: &Equation) -> Option<usize> {
    let named = |name: &str| {
        task.regression.tasks.iter().zip(&structure.tasks).position(|(task, shape)| task.name == name && !shape.prior)
    };
    match equation.prediction {
        Prediction::Value => named(&equation.subject),
        // A latent of its own is the whole right side.
        _ if task.regression.latents.iter().any(|latent| equation.right.as_column() == Some(latent.name.as_str())) => {
            named(&equation.label())
        }
        _ => None,
    }
}
