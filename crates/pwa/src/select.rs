//! Model order: cross-validated error with the one-standard-error rule, or BIC with the effective sample size. No pass over rows.

use std::collections::BTreeMap;

use fleetfoot_data::parallel_all;
use fleetfoot_stats::{BatchMeans, Gram, Preconditioner, SquareRoot, Stats, bic};

use crate::{
    Continuity, Error, Selection, Shrinkage, Specification, Stability,
    continuous::Fitted,
    fit::{Roots, held_out_error, region_models},
    region_model::{Base, RegionModel},
    segmentation::Candidate,
    stable::Loop,
};

/// Shrinkage in rows that [`Shrinkage::Auto`] tries.
const SHRINKAGE_GRID: [f64; 7] = [0.0, 1.0, 10.0, 100.0, 1e3, 1e4, 1e5];
/// Pulls whose held-out losses differ by a smaller share count as equal: the smaller one is taken.
const SAME: f64 = 1e-3;

/// Relative difference of losses up to which they count as equal: rounding of sums of squares.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Errors of a candidate, from the statistic.
#[derive(Debug, Clone)]
pub(crate) struct Order {
    /// Shrinkage used.
    pub(crate) shrinkage: f64,
    /// Held-out error per fold, in units of the variance of the targets (mean over targets).
    pub(crate) losses: Vec<f64>,
    /// Mean of the losses.
    pub(crate) loss: f64,
    /// Standard error of that mean across folds.
    pub(crate) standard_error: f64,
    /// Sum of squared errors of each target, held out; in-sample without folds.
    pub(crate) squared: Vec<f64>,
    /// Weight of the rows behind them.
    pub(crate) weight: f64,
    /// Bayesian information criterion on all rows.
    pub(crate) bic: f64,
    /// Models of every fold.
    pub(crate) by_fold: Vec<Vec<RegionModel>>,
    /// Models from all rows.
    pub(crate) full: Vec<RegionModel>,
    /// Numbers that are free in these, of each target.
    pub(crate) numbers: usize,
    /// Cost of continuity; `None` unless maps meet at their borders.
    pub(crate) continuity: Option<Continuity>,
    /// Contraction of the models from all rows, if requested, and the loss of the free ones.
    pub(crate) stability: Option<(Stability, f64)>,
    /// Sums from which the models of all rows were solved, if this is the only candidate.
    pub(crate) training: Option<BTreeMap<u32, SquareRoot>>,
}

/// The maps of all `count` regions of a candidate, from the training statistics of its regions for `held`: tied where they meet at borders.
pub(crate) fn fitted(
    candidate: &Candidate,
    held: Option<u16>,
    count: usize,
    base: &Base,
    training: &BTreeMap<u32, SquareRoot>,
    shrinkage: f64,
) -> Fitted {
    match candidate.ties(held) {
        Some(ties) => ties.fit(base, training, shrinkage),
        None => apart(region_models(candidate, count, base, training, shrinkage)),
    }
}

/// Maps that need not meet.
fn apart(models: Vec<RegionModel>) -> Fitted {
    Fitted { numbers: models.iter().map(|model| model.rank + 1).sum(), models }
}

impl Order {
    /// Of held-out errors: fold by fold the sum of the squares of every target, and the weight of the rows.
    fn of_folds(shrinkage: f64, errors: &[(Vec<f64>, f64)], variance: &[f64], by_fold: Vec<Vec<RegionModel>>) -> Self {
        let losses: Vec<f64> = errors.iter().map(|(error, rows)| scaled(error, variance, *rows)).collect();
        let (loss, standard_error) = mean_and_error(&losses);
        let mut squared = vec![0.0; variance.len()];
        for (error, _) in errors {
            squared.iter_mut().zip(error).for_each(|(sum, error)| *sum += error);
        }
        let weight = errors.iter().map(|(_, rows)| rows).sum();
        Self {
            shrinkage,
            losses,
            loss,
            standard_error,
            squared,
            weight,
            bic: f64::NAN,
            by_fold,
            full: Vec::new(),
            numbers: 0,
            continuity: None,
            stability: None,
            training: None,
        }
    }
}

/// Evaluates all candidates on the statistic. `regions` gives the number of regions of a partition; `folds` is 0
/// without cross-validation.
///
/// # Errors
/// When a fold holds out rows and leaves none to train, or no bounded maps are found.
pub(crate) fn evaluate(
    solver: &dyn Roots,
    (candidates, regions): (&[Candidate], &dyn Fn(usize) -> usize),
    (folds, shrinkage): (u16, Shrinkage),
    bound: Option<&Loop>,
    all: &Base,
    effective_rows: f64,
) -> Result<Vec<Order>, Error> {
    let bases: Vec<Option<Base>> = (0..folds).map(|fold| solver.base(Some(fold))).collect();
    let variance: Vec<f64> = all.root.total.iter().map(|total| total / all.root.weight).collect();
    let of_candidate = |candidate: &Candidate| {
        let of = |fold: u16| {
            let (partition, base) = (candidate.by_fold[usize::from(fold)], bases[usize::from(fold)].as_ref());
            let testing = solver.testing(partition, fold);
            if base.is_none_or(|base| base.root.weight <= 0.0) && testing.values().any(|root| root.weight > 0.0) {
                return Err(Error::NothingToTrain { fold: fold + 1, folds });
            }
            let set = |base| {
                let training = solver.training(partition, Some(fold));
                Set { fold, count: regions(partition), base, training, testing }
            };
            Ok(base.map(set))
        };
        let sets: Vec<Set<'_>> = (0..folds).filter_map(|fold| of(fold).transpose()).collect::<Result<_, Error>>()?;
        let one_map = matches!(candidate.specification, Specification::Null | Specification::Average);
        let grid: &[f64] = match &shrinkage {
            Shrinkage::Rows(rows) => std::slice::from_ref(rows),
            Shrinkage::Auto if folds == 0 || one_map => &[0.0],
            Shrinkage::Auto => &SHRINKAGE_GRID,
        };
        let maps = |shrinkage: f64| {
            move |set: &Set<'_>| fitted(candidate, Some(set.fold), set.count, set.base, &set.training, shrinkage).models
        };
        let costs = parallel_all(grid.len(), |at| match grid {
            [_] => 0.0,
            _ => log_loss(&held_out(&sets, folds, &variance, grid[at], maps(grid[at])).losses),
        });
        let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
        let chosen = costs.iter().position(|cost| *cost <= least + SAME).unwrap_or(0);
        let mut order = held_out(&sets, folds, &variance, grid[chosen], maps(grid[chosen]));
        let training = solver.training(candidate.full, None);
        let model = fitted(candidate, None, regions(candidate.full), all, &training, order.shrinkage);
        (order.full, order.numbers) = (model.models, model.numbers);
        if let Some(bound) = bound.filter(|_| candidate.specification != Specification::Null) {
            hold(bound, &mut order, (all, &training), &sets, &variance)?;
        }
        let error = held_out_error(&order.full, &training, variance.len());
        order.bic = bic(&error, all.root.weight, order.numbers * error.len(), effective_rows);
        if order.losses.is_empty() {
            (order.squared, order.weight) = (error, all.root.weight);
        }
        order.continuity = candidate.ties(None).map(|ties| {
            let maps = |set: &Set<'_>| region_models(candidate, set.count, set.base, &set.training, order.shrinkage);
            let apart = held_out(&sets, folds, &variance, order.shrinkage, maps).loss;
            Continuity { borders: ties.borders(), numbers: order.numbers, apart, jump: ties.jump(&order.full, all) }
        });
        order.training = (candidates.len() == 1).then_some(training);
        Ok(order)
    };
    candidates.iter().map(of_candidate).collect()
}

/// Mean logarithm of the losses of folds: the likelihood of Gaussian errors whose size differs from fold to fold. A fold with few rows of a wrong region, or one in which
/// a map runs away, counts no more than another.
fn log_loss(losses: &[f64]) -> f64 {
    losses.iter().map(|loss| loss.max(ROUNDING).ln()).sum::<f64>() / losses.len().max(1) as f64
}

/// The regions of a candidate when a fold is held out.
struct Set<'a> {
    fold: u16,
    count: usize,
    base: &'a Base,
    training: BTreeMap<u32, SquareRoot>,
    testing: BTreeMap<u32, SquareRoot>,
}

/// Held-out loss of every fold, by maps of its training rows.
fn held_out(
    sets: &[Set<'_>],
    folds: u16,
    variance: &[f64],
    shrinkage: f64,
    mut maps: impl FnMut(&Set<'_>) -> Vec<RegionModel>,
) -> Order {
    let mut errors = Vec::new();
    let mut by_fold = vec![Vec::new(); usize::from(folds)];
    for set in sets {
        let models = maps(set);
        let rows: f64 = set.testing.values().map(|root| root.weight).sum();
        if rows > 0.0 {
            errors.push((held_out_error(&models, &set.testing, variance.len()), rows));
        }
        by_fold[usize::from(set.fold)] = models;
    }
    Order::of_folds(shrinkage, &errors, variance, by_fold)
}

/// Bounds the models of all rows and those of every fold, each with the metric of its training rows. The held-out error
/// is that of the bounded models.
fn hold(
    bound: &Loop,
    order: &mut Order,
    (all, training): (&Base, &BTreeMap<u32, SquareRoot>),
    sets: &[Set<'_>],
    variance: &[f64],
) -> Result<(), Error> {
    // Without held-out rows, the loss on all rows.
    let free = if order.loss.is_finite() {
        order.loss
    } else {
        scaled(&held_out_error(&order.full, training, variance.len()), variance, all.root.weight)
    };
    let mut by_fold = std::mem::take(&mut order.by_fold);
    let folds = by_fold.len() as u16;
    for set in sets {
        bound.bound(&mut by_fold[usize::from(set.fold)], set.base, &set.training, order.shrinkage)?;
    }
    let bound = bound.bound(&mut order.full, all, training, order.shrinkage)?;
    let (full, numbers) = (std::mem::take(&mut order.full), order.numbers);
    let maps = |set: &Set<'_>| std::mem::take(&mut by_fold[usize::from(set.fold)]);
    let held = held_out(sets, folds, variance, order.shrinkage, maps);
    *order = Order { full, numbers, stability: Some((bound, free)), ..held };
    Ok(())
}

/// The index of the chosen candidate, and the rule that chose it, for people. No rule if there is one candidate only,
/// or the caller chose.
pub(crate) fn choose(
    selection: Selection,
    specifications: &[&Specification],
    orders: &[Order],
) -> (usize, Option<&'static str>) {
    let size = |i: usize| orders[i].numbers;
    let by =
        |value: &dyn Fn(usize) -> f64| (0..orders.len()).min_by(|&a, &b| value(a).total_cmp(&value(b))).unwrap_or(0);
    if orders.len() == 1 || specifications.is_empty() {
        return (0, None);
    }
    match selection {
        Selection::Given(index) => (index.min(orders.len() - 1), None),
        Selection::CrossValidation if orders.iter().all(|order| order.loss.is_finite()) => {
            let best = by(&|i| orders[i].loss);
            let limit = (orders[best].loss + orders[best].standard_error).max(ROUNDING);
            let simplest = (0..orders.len())
                .filter(|&i| i == best || orders[i].loss <= limit)
                .min_by_key(|&i| (size(i), i))
                .unwrap_or(best);
            (simplest, Some("the fewest coefficients of those within one standard error of the least held-out loss"))
        }
        Selection::CrossValidation => {
            (by(&|i| orders[i].bic), Some("the least BIC, because the held-out loss of some partition is not known"))
        }
        Selection::Bic => (by(&|i| orders[i].bic), Some("the least BIC, with the effective number of rows")),
    }
}

/// Rows that count as independent: batch means ([`BatchMeans`]) of the residuals of the one-region model, the worst target's.
pub(crate) fn effective_rows(stats: &Stats, preconditioner: &Preconditioner, base: &Base) -> f64 {
    let average = &base.average;
    let mut means = BatchMeans::new(base.root.mean_y.len());
    for (key, gram) in stats.iter().filter(|(key, gram)| key.partition == 0 && gram.weight > 0.0) {
        means.add(key.episode, gram.weight, &mean_residuals(preconditioner, gram, average));
    }
    let error = base.root.error(average.coefficients.as_ref(), &average.intercept);
    means.effective_weight(base.root.weight, &error)
}

/// The same of the models of a partition's regions: variance that regions explain does not count as correlated. A
/// partition joined of cells is excluded, as its sums are in no chunk. `error`: the sum of their squares of every
/// target; `weight`: that of all rows.
pub(crate) fn effective_rows_in(
    (stats, preconditioner): (&Stats, &Preconditioner),
    partition: usize,
    models: &[RegionModel],
    (error, weight): (&[f64], f64),
) -> f64 {
    let mut means = BatchMeans::new(error.len());
    // Regions of a chunk follow each other.
    let stats: Vec<_> =
        stats.iter().filter(|(key, gram)| usize::from(key.partition) == partition && gram.weight > 0.0).collect();
    for chunk in stats.chunk_by(|(a, _), (b, _)| (a.episode, a.chunk, a.fold) == (b.episode, b.chunk, b.fold)) {
        let (mut sums, mut rows) = (vec![0.0; error.len()], 0.0);
        for (key, gram) in chunk {
            let mean = mean_residuals(preconditioner, gram, &models[key.region as usize]);
            sums.iter_mut().zip(mean).for_each(|(sum, mean)| *sum += gram.weight * mean);
            rows += gram.weight;
        }
        sums.iter_mut().for_each(|sum| *sum /= rows);
        means.add(chunk[0].0.episode, rows, &sums);
    }
    means.effective_weight(weight, error)
}

/// Means of the residuals of a model on the rows of a Gram matrix, of every target.
fn mean_residuals(preconditioner: &Preconditioner, gram: &Gram, model: &RegionModel) -> Vec<f64> {
    let (mean_x, mean_y) = preconditioner.means(gram);
    let mean = |target: usize| {
        let explained = |(j, x): (usize, &f64)| model.coefficients[(j, target)] * x;
        let start = mean_y[target] - model.intercept[target];
        mean_x.iter().enumerate().map(explained).fold(start, |left, explained| left - explained)
    };
    (0..mean_y.len()).map(mean).collect()
}

fn scaled(error: &[f64], variance: &[f64], rows: f64) -> f64 {
    let sum: f64 = error.iter().zip(variance).map(|(error, variance)| error / (rows * variance)).sum();
    sum / error.len() as f64
}

fn mean_and_error(losses: &[f64]) -> (f64, f64) {
    let n = losses.len() as f64;
    let mean = losses.iter().sum::<f64>() / n;
    let squares: f64 = losses.iter().map(|loss| (loss - mean) * (loss - mean)).sum();
    (mean, (squares / (n - 1.0).max(1.0) / n).sqrt())
}
