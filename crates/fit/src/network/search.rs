//! Sizes of networks compared with the linear map on rows that did not train.

use fleetfoot_data::{Cancelled, Progress, Silent, Stages, parallel_map, unstoppable};
use fleetfoot_learn::{Shape, Units};

use super::{
    options::NetworkOptions,
    pace::Pace,
    report::{NetworkCandidate, NetworkErrors, mean_and_error},
    rows::Rows,
    train::{Fitted, linear, network, solved, units},
};
use crate::error::Error;

/// Result of the comparison.
pub(super) struct Selection {
    pub(super) candidates: Vec<NetworkCandidate>,
    pub(super) chosen: usize,
    /// The chosen one on all rows.
    pub(super) fitted: Fitted,
    pub(super) held_out: Vec<NetworkErrors>,
    pub(super) notes: Vec<String>,
}

/// Squared errors of one candidate on the rows that a fold holds out, by target, and the candidate itself.
type Fold = (Vec<f64>, Option<Fitted>);

/// Compares sizes, the linear map first, and fits the chosen one to all rows.
pub(super) fn search(rows: &Rows, options: &NetworkOptions, progress: &dyn Progress) -> Result<Selection, Error> {
    let table = &rows.table;
    let (p, q) = (table.inputs(), table.targets());
    let [all, _] = rows.split(None);
    let sigma = Units::measured(table, &all)?.scale[p..].to_vec();
    let splits: Vec<[Vec<usize>; 2]> = (0..rows.count).map(|fold| rows.split(Some(fold))).collect();
    let splits: Vec<[Vec<usize>; 2]> = splits.into_iter().filter(|[_, held]| !held.is_empty()).collect();
    let loss = |errors: &[f64]| errors.iter().zip(&sigma).map(|(e, s)| e / (s * s)).sum::<f64>() / q as f64;
    let candidate = |hidden: &[usize], errors: &[Vec<f64>]| {
        let shape = rows.shape(hidden, options);
        let numbers = shape.parameters() + (1 + p + shape.features()) * q;
        let weights: Vec<f64> = splits.iter().map(|[_, held]| held.len() as f64).collect();
        NetworkCandidate::new(
            (options.cell, hidden),
            numbers,
            errors.iter().map(|fold_errors| loss(fold_errors)).collect(),
            pooled(errors, &weights),
        )
    };
    progress.stage("linear model");
    let errors = parallel_map(splits.len(), progress, |at| {
        let [train, held] = &splits[at];
        Ok::<_, Error>(linear(table, train)?.errors(table, held)?)
    })?;
    let mut candidates = vec![candidate(&[], &errors)];
    let least = splits.iter().map(|[train, _]| train.len()).min().unwrap_or(all.len());
    let mut notes = Vec::new();
    // The networks of the first fold, which are there when the user stops.
    let mut first: Vec<Option<Fitted>> = vec![None];
    let mut stopped = false;
    let sizes = options.sizes();
    let of_folds: Vec<usize> = splits.iter().map(|[train, _]| train.len()).collect();
    let pace = Pace::measured(&sizes, options, (rows, &all), &of_folds)?;
    progress.expect(pace.work());
    for (at, hidden) in sizes.into_iter().enumerate() {
        let name = NetworkCandidate::name_of(options.cell, &hidden);
        let numbers = 1 + p + hidden.last().copied().unwrap_or(0);
        if least < 3 * numbers {
            let few = format!(
                "{name}: {least} rows that train are too few for {numbers} weights of each output (three rows a weight)"
            );
            if options.is_given() {
                return Err(Error::too_few_rows(least as u64, 3 * numbers as u64, few));
            }
            notes.push(few);
            break;
        }
        let shape = rows.shape(&hidden, options);
        let so_far = candidates.iter().map(|candidate| candidate.loss).fold(f64::INFINITY, f64::min);
        let stages =
            Stages::new(progress, format!("held-out loss so far {so_far:.2e}, at most {} left", pace.left(at)));
        stages.stage(&name);
        let fold = |at: usize| {
            let [train, held] = &splits[at];
            let training = options.training(&shape, train.len(), q);
            match network(&shape, table, train, &training, &Quiet(progress)) {
                Ok(fitted) => Ok((fitted.errors(table, held)?, (at == 0).then_some(fitted))),
                Err(fleetfoot_learn::Error::Diverged) => Ok((vec![f64::INFINITY; q], None)),
                Err(error) => Err(error.into()),
            }
        };
        let folds: Result<Vec<Fold>, Error> = parallel_map(splits.len(), progress, fold);
        let folds = match folds {
            Err(Error::Cancelled(_)) if candidates.len() > 1 => {
                notes.push(format!("stopped before {name} was compared: the sizes before it are what was tried"));
                stopped = true;
                break;
            }
            other => other?,
        };
        let (errors, mut fitted): (Vec<Vec<f64>>, Vec<Option<Fitted>>) = folds.into_iter().unzip();
        first.push(fitted.swap_remove(0));
        candidates.push(candidate(&hidden, &errors));
        // Larger ones are tried while they pay.
        let [.., before, last] = candidates.as_slice() else { break };
        if candidates.len() > 2 && last.loss > before.loss {
            break;
        }
    }
    let chosen = choose(&candidates);
    candidates[chosen].chosen = true;
    let held_out = held_out(rows, &splits, &candidates[chosen]);
    let hidden = candidates[chosen].hidden.clone();
    let fitted = if chosen == 0 {
        unstoppable(|| linear(table, &all))?
    } else {
        let shape = rows.shape(&hidden, options);
        let training = options.training(&shape, all.len(), q);
        progress.stage(&format!("{} on all rows", candidates[chosen].name));
        let whole =
            if stopped { Err(Error::Cancelled(Cancelled)) } else { again(&shape, rows, &all, &training, progress) };
        match (whole, first.swap_remove(chosen)) {
            (Err(Error::Cancelled(_)), Some(Fitted { hidden: Some((_, parameters)), ridge, .. })) => {
                notes.push(
                    "stopped: the hidden layers are those of the first fold, which a part of the rows trained".into(),
                );
                unstoppable(|| {
                    let units = units(table, &all, shape.window.as_ref())?;
                    solved(&shape, parameters, ridge, (table, &all, units), &Silent)
                })?
            }
            (whole, _) => whole?,
        }
    };
    Ok(Selection { candidates, chosen, fitted, held_out, notes })
}

/// A network on all rows.
fn again(
    shape: &Shape,
    rows: &Rows,
    all: &[usize],
    training: &fleetfoot_learn::Training,
    progress: &dyn Progress,
) -> Result<Fitted, Error> {
    Ok(network(shape, &rows.table, all, training, &Quiet(progress))?)
}

/// Only whether to stop.
struct Quiet<'a>(&'a dyn Progress);

impl Progress for Quiet<'_> {
    fn advance(&self, _: usize, _: usize) {}

    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

/// Root mean squared errors over all held-out rows.
fn pooled(errors: &[Vec<f64>], weights: &[f64]) -> Vec<f64> {
    let total: f64 = weights.iter().sum();
    let targets = errors.first().map_or(0, Vec::len);
    let of =
        |t: usize| errors.iter().zip(weights).map(|(fold_errors, weight)| fold_errors[t] * weight).sum::<f64>() / total;
    (0..targets).map(|t| of(t).sqrt()).collect()
}

/// The first, so the smallest, whose loss is above the least one by no more than one standard error over the folds, both of the logarithm of their ratio: folds differ in
/// their losses by orders of magnitude, and the ratio of two models on the same rows does not.
pub(super) fn choose(candidates: &[NetworkCandidate]) -> usize {
    let of = |at: &usize| candidates[*at].loss;
    let best = (0..candidates.len()).min_by(|a, b| of(a).total_cmp(&of(b))).unwrap_or(0);
    let is_as_good = |candidate: &NetworkCandidate| {
        let logarithm = |loss: &f64| loss.max(f64::MIN_POSITIVE).ln();
        let pairs = candidate.losses.iter().zip(&candidates[best].losses);
        let ratios: Vec<f64> = pairs.map(|(loss, best)| logarithm(loss) - logarithm(best)).collect();
        let (mean, error) = mean_and_error(&ratios);
        mean <= error
    };
    candidates.iter().position(is_as_good).unwrap_or(best)
}

/// Errors of the chosen candidate, of the mean of the training rows and of persistence, on all rows that were held out.
fn held_out(rows: &Rows, splits: &[[Vec<usize>; 2]], chosen: &NetworkCandidate) -> Vec<NetworkErrors> {
    let (p, q) = (rows.table.inputs(), rows.table.targets());
    let of = |t: usize| {
        let (mut count, mut by_mean, mut by_persistence) = (0.0, 0.0, 0.0);
        for [train, held] in splits {
            let target = |row: usize| rows.table.row(row)[p + t];
            let mean = train.iter().map(|&row| target(row)).sum::<f64>() / train.len().max(1) as f64;
            for &row in held {
                count += 1.0;
                by_mean += (target(row) - mean).powi(2);
                by_persistence += (target(row) - rows.persistence[row * q + t]).powi(2);
            }
        }
        NetworkErrors {
            rmse: chosen.rmse.get(t).copied().unwrap_or(f64::NAN),
            mean: (by_mean / count).sqrt(),
            persistence: (by_persistence / count).sqrt(),
        }
    };
    (0..q).map(of).collect()
}
