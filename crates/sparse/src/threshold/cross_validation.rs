//! What held-out rows say about the models of a trail.

use faer::Mat;
use fleetfoot_stats::Compressed;

use super::{ThresholdError, Trail};
use crate::{CrossValidation, SelectError, select::Scored};

/// One fold: the rows that models are fitted on, and those kept from them.
#[derive(Debug, Clone, PartialEq)]
pub struct FoldProblem {
    /// The training rows.
    pub train: Compressed,
    /// The held-out rows.
    pub test: Compressed,
}

/// Held-out errors of the models of a trail. Means and standard errors are those of [`CrossValidation`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FoldScores {
    /// Mean squared error of every model on every fold's held-out rows (steps x folds), squared units of the target.
    pub errors: Mat<f64>,
    /// Mean over folds, weighted by held-out rows (steps).
    pub mean: Vec<f64>,
    /// Standard error of the mean (steps).
    pub standard_error: Vec<f64>,
    /// Mean over folds of the number of terms (steps).
    pub terms: Vec<f64>,
    /// Index of the step with the least mean error; of several, the one with the fewest terms.
    pub best: usize,
    /// Index of the step with the fewest terms whose mean error is at most the least one plus the standard error there (Breiman, Friedman, Olshen, Stone 1984,
    /// section 3.4.3).
    pub one_standard_error: usize,
}

/// How the models of two trails belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Matching {
    /// By threshold or lambda: the model in force there, the last with a parameter as large or larger.
    Threshold,
    /// By number of terms: the largest model with as many or fewer.
    Terms,
}

/// Compares the models of `trail`, made on all rows, on rows held out: `folds` holds the trail that the same optimiser made of each fold's training rows, and the
/// fold itself. `overlap`: held-out rows repeat between folds.
///
/// An error below what the target is known to ([`Trail::rounding`]) counts as that in the choice.
///
/// # Errors
/// When there are no folds, a fold holds out nothing, or has another shape.
pub fn choose_by_cross_validation(
    trail: &Trail,
    folds: &[(&Trail, &FoldProblem)],
    target: usize,
    matching: Matching,
    overlap: bool,
) -> Result<FoldScores, ThresholdError> {
    if folds.is_empty() {
        let (what, mend) = ("there are no folds to cross-validate with", "give two or more, or choose by a criterion");
        return Err(ThresholdError::Nothing { what, mend });
    }
    // Sparsest first: then the first of equals is the one to take.
    let mut order: Vec<usize> = (0..trail.steps.len()).collect();
    order.sort_by_key(|&k| trail.steps[k].terms());
    let parameters: Vec<f64> = order.iter().map(|&k| trail.steps[k].parameter).collect();
    let mut scored = Vec::with_capacity(folds.len());
    for (fold, &(own, problem)) in folds.iter().enumerate() {
        let models: Vec<usize> = order.iter().map(|&k| matching.find(own, trail.steps[k].parameter)).collect();
        scored.push(score(own, problem, &models, target, fold)?);
    }
    let found = CrossValidation::new(parameters.clone(), &scored, overlap)?;
    for (scored, (own, problem)) in scored.iter_mut().zip(folds) {
        let least = own.rounding / problem.train.weight;
        scored.errors.iter_mut().for_each(|error| *error = error.max(least));
    }
    let compared = CrossValidation::new(parameters, &scored, overlap)?;
    let mut place = vec![0; order.len()];
    order.iter().enumerate().for_each(|(at, &k)| place[k] = at);
    let back = |values: &[f64]| place.iter().map(|&at| values[at]).collect();
    Ok(FoldScores {
        errors: Mat::from_fn(order.len(), folds.len(), |k, fold| found.errors[(place[k], fold)]),
        mean: back(&found.mean),
        standard_error: back(&found.standard_error),
        terms: back(&found.features),
        best: order[compared.best],
        one_standard_error: order[compared.one_standard_error],
    })
}

impl Matching {
    fn find(self, trail: &Trail, parameter: f64) -> usize {
        let fits = |k: &usize| match self {
            Self::Threshold => trail.steps[*k].parameter >= parameter,
            Self::Terms => trail.steps[*k].parameter <= parameter,
        };
        // The nearest of those; where there is none, the nearest of all.
        let distance = |k: &usize| (trail.steps[*k].parameter - parameter).abs();
        let nearest = |a: &usize, b: &usize| distance(a).total_cmp(&distance(b));
        let all = 0..trail.steps.len();
        all.clone().filter(fits).min_by(nearest).or_else(|| all.min_by(nearest)).unwrap_or(0)
    }
}

fn score(
    trail: &Trail,
    problem: &FoldProblem,
    models: &[usize],
    target: usize,
    fold: usize,
) -> Result<Scored, ThresholdError> {
    let FoldProblem { train, test } = problem;
    let columns = trail.steps[0].coefficients.len();
    for (what, found) in [("the training problem of fold", train), ("the held-out problem of fold", test)] {
        if found.columns() != columns || found.targets() <= target {
            return Err(ThresholdError::OtherProblem {
                what,
                index: fold,
                columns: found.columns(),
                targets: found.targets(),
                expected_columns: columns,
                expected_targets: target + 1,
            });
        }
    }
    if test.weight.is_nan() || test.weight <= 0.0 {
        return Err(SelectError::EmptyFold { fold, side: "test" }.into());
    }
    let error = |k: &usize| {
        let step = &trail.steps[*k];
        squared_error(test, target, &step.coefficients, &step.support) / test.weight
    };
    let errors: Vec<f64> = models.iter().map(error).collect();
    Ok(Scored {
        tasks: Mat::from_fn(1, errors.len(), |_, k| errors[k]),
        errors,
        features: models.iter().map(|&k| trail.steps[k].terms()).collect(),
        exact: vec![true; models.len()],
        rows: [test.weight, train.weight],
    })
}

/// Weighted sum of squared errors of the coefficients of one target, on any rows.
fn squared_error(problem: &Compressed, target: usize, coefficients: &[f64], support: &[usize]) -> f64 {
    let mut left = problem.z.col_as_slice(target).to_vec();
    for &j in support {
        let column = &problem.r.col_as_slice(j)[..=j];
        left.iter_mut().zip(column).for_each(|(left, r)| *left -= r * coefficients[j]);
    }
    left.iter().map(|left| left * left).sum::<f64>() + problem.residual[target].max(0.0)
}
