//! Held-out errors of supports: each is refitted on every fold's training rows.

use faer::Mat;
use fleetfoot_data::{Progress, parallel_map};
use fleetfoot_stats::Compressed;

use super::{
    Optimizer, Step, Terms, ThresholdError,
    criteria::rounding,
    prepared::{Prepared, Solved},
    refit_supports,
};
use crate::select::{CrossValidation, Scored, SelectError};

/// One fold: the rows that models are fitted on, and those kept from them.
#[derive(Debug, Clone, PartialEq)]
pub struct FoldProblem {
    /// The training rows.
    pub train: Compressed,
    /// The held-out rows. Errors below what their targets are known to ([`Compressed::resolution`]) count as equal.
    pub test: Compressed,
}

/// Held-out errors of models, each refitted on its own support. Means and standard errors are those of [`CrossValidation`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FoldScores {
    /// Mean squared error of every model on every fold's held-out rows (steps x folds), squared units of the target.
    pub errors: Mat<f64>,
    /// Mean over folds, weighted by held-out rows (steps).
    pub mean: Vec<f64>,
    /// Standard error of the mean (steps).
    pub standard_error: Vec<f64>,
    /// Index of the step with the least mean error; of several, up to a hundred-thousandth of it, the one with the fewest terms.
    pub best: usize,
    /// Index of the step with the fewest terms (of several, with the least error) whose mean error is at most the least one plus the standard error there
    /// (Breiman, Friedman, Olshen, Stone 1984, section 3.4.3).
    pub one_standard_error: usize,
}

/// The held-out errors of models of one target, made on all rows: the support of each is refitted on every fold's training rows, as the optimiser writes
/// its models. `overlap`: held-out rows repeat between folds.
///
/// In the choice an error below what the held-out rows are known to, or below rounding, counts as that.
///
/// # Errors
/// When there are no folds or models, a fold holds out nothing, has another shape, or the user stops it.
pub fn score_supports(
    steps: &[Step],
    folds: &[FoldProblem],
    (target, terms): (usize, &Terms),
    optimizer: &Optimizer,
    overlap: bool,
    progress: &dyn Progress,
) -> Result<FoldScores, ThresholdError> {
    if folds.is_empty() || steps.is_empty() {
        let (what, mend) = ("there are no folds to cross-validate with", "give two or more, or choose by a criterion");
        return Err(ThresholdError::Nothing { what, mend });
    }
    // By size: neighbours share most of their columns, and one factor follows them.
    let mut order: Vec<usize> = (0..steps.len()).collect();
    order.sort_by_key(|&k| std::cmp::Reverse(steps[k].terms()));
    let scored = parallel_map(folds.len(), progress, |fold| {
        let mut errors = refitted_errors(&folds[fold], fold, steps, &order, (target, terms), optimizer)?;
        let scored_fold = scored_as(steps, &folds[fold], errors.clone());
        let test = &folds[fold].test;
        let least = test.resolution[target].max(rounding(test, target) / test.weight);
        errors.iter_mut().for_each(|error| *error = error.max(least));
        Ok::<_, ThresholdError>((scored_fold, scored_as(steps, &folds[fold], errors)))
    })?;
    let (scores, compared): (Vec<Scored>, Vec<Scored>) = scored.into_iter().unzip();
    let parameters: Vec<f64> = steps.iter().map(|step| step.parameter).collect();
    let cross_validation = CrossValidation::new(parameters.clone(), &scores, overlap)?;
    let compared = CrossValidation::new(parameters, &compared, overlap)?;
    let (best, one_standard_error) = choose(steps, &compared);
    Ok(FoldScores {
        errors: cross_validation.errors,
        mean: cross_validation.mean,
        standard_error: cross_validation.standard_error,
        best,
        one_standard_error,
    })
}

/// Relative difference of held-out errors that counts as none.
const SAME: f64 = 1e-5;

/// The least mean error, and the fewest terms within a standard error of it.
fn choose(steps: &[Step], compared: &CrossValidation) -> (usize, usize) {
    let mean = &compared.mean;
    // Smaller differences are no evidence, in exact data rounding: the fewest terms then.
    let least = mean.iter().copied().fold(f64::INFINITY, f64::min);
    let equal = |k: &usize| mean[*k] <= least * (1.0 + SAME);
    let fewest = |k: &usize| (steps[*k].terms(), mean[*k]);
    let by = |a: &usize, b: &usize| {
        let ((terms, error), (others, other)) = (fewest(a), fewest(b));
        terms.cmp(&others).then(error.total_cmp(&other))
    };
    let best = (0..steps.len()).filter(equal).min_by(by).unwrap_or(0);
    let limit = mean[best] + compared.standard_error[best];
    let within = (0..steps.len()).filter(|&k| k == best || mean[k] <= limit);
    (best, within.min_by(by).unwrap_or(best))
}

fn scored_as(steps: &[Step], fold: &FoldProblem, errors: Vec<f64>) -> Scored {
    Scored {
        tasks: Mat::from_fn(1, errors.len(), |_, k| errors[k]),
        features: steps.iter().map(Step::terms).collect(),
        exact: vec![true; errors.len()],
        rows: [fold.test.weight, fold.train.weight],
        errors,
    }
}

/// Mean squared errors on a fold's held-out rows of all supports refitted on its training rows, in the order of the steps.
fn refitted_errors(
    fold: &FoldProblem,
    index: usize,
    steps: &[Step],
    order: &[usize],
    (target, terms): (usize, &Terms),
    optimizer: &Optimizer,
) -> Result<Vec<f64>, ThresholdError> {
    let FoldProblem { train, test } = fold;
    let columns = steps[0].coefficients.len();
    for (what, size) in [("the training problem of fold", train), ("the held-out problem of fold", test)] {
        if size.columns() != columns || size.targets() <= target {
            return Err(ThresholdError::OtherProblem {
                what,
                index,
                columns: size.columns(),
                targets: size.targets(),
                expected_columns: columns,
                expected_targets: target + 1,
            });
        }
    }
    if test.weight.is_nan() || test.weight <= 0.0 {
        return Err(SelectError::EmptyFold { fold: index, side: "test" }.into());
    }
    // A column that is zero on the training rows has no coefficient there.
    let (alpha, scaling) = optimizer.written_ridge();
    let prepared = Prepared::new(train, terms, scaling, alpha)?;
    prepared.check_target(target)?;
    let seen = |k: &usize| -> Vec<usize> {
        steps[*k].support.iter().copied().filter(|j| prepared.open.binary_search(j).is_ok()).collect()
    };
    let supports: Vec<Vec<usize>> = order.iter().map(seen).collect();
    let error =
        |support: &[usize], values: &dyn Fn(usize) -> f64| squared_error(test, target, support, values) / test.weight;
    let mut errors = vec![f64::NAN; steps.len()];
    if alpha == 0.0 {
        let refits = refit_supports(train, target, terms, &supports)?;
        for (&k, model) in order.iter().zip(&refits) {
            errors[k] = error(&model.support, &|place| model.coefficients[model.support[place]]);
        }
    } else {
        for (&k, support) in order.iter().zip(&supports) {
            let Solved { values, .. } = prepared.solve(&prepared.ridged(support, target), support);
            errors[k] = error(support, &|place| values[place]);
        }
    }
    Ok(errors)
}

/// Weighted sum of squared errors of the coefficients of a support, on any rows.
fn squared_error(problem: &Compressed, target: usize, support: &[usize], values: &dyn Fn(usize) -> f64) -> f64 {
    let mut left = problem.z.col_as_slice(target).to_vec();
    for (place, &j) in support.iter().enumerate() {
        let (column, value) = (&problem.r.col_as_slice(j)[..=j], values(place));
        left.iter_mut().zip(column).for_each(|(left, r)| *left -= r * value);
    }
    left.iter().map(|left| left * left).sum::<f64>() + problem.residual[target].max(0.0)
}
