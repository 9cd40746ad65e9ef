//! Held-out errors: their mean, its standard error, and the choice.

use faer::Mat;

use super::SelectError;

/// Held-out errors of a path of models.
///
/// The error of a fold is the weighted mean squared error of its held-out rows, `sum_t s_t mse_t` over the measured tasks with their weights s_t (of a
/// single task, the mean squared error). Means over folds weigh each by its held-out rows, so that a short episode does not count like a long
/// one; with folds of equal rows this is the plain mean.
///
/// The standard error of that mean is `sqrt(V c)`, V the variance of the folds' errors (divisor: folds - 1, weighted by rows) and c = 1 / folds. Repeated
/// splits hold the same rows out again and again: there c = 1 / folds + held-out rows / training rows (Nadeau and Bengio 2003).
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct CrossValidation {
    /// The lambdas, descending.
    pub lambdas: Vec<f64>,
    /// Error of every fold (lambdas x folds).
    pub errors: Mat<f64>,
    /// Mean squared error of every measured task in the units of its target, a matrix (lambdas x folds) a task.
    pub tasks: Vec<Mat<f64>>,
    /// Held-out rows (their weights' sum) of every fold.
    pub rows: Vec<f64>,
    /// Mean over folds (lambdas).
    pub mean: Vec<f64>,
    /// Standard error of the mean (lambdas).
    pub standard_error: Vec<f64>,
    /// Mean over folds of the number of coefficients that are not zero (lambdas).
    pub features: Vec<f64>,
    /// Index of the lambda with the least mean error; of several, the largest.
    pub best: usize,
    /// Index of the largest lambda whose mean error is at most the least one plus the standard error there: the sparsest model that the folds cannot tell
    /// from the best (Breiman, Friedman, Olshen, Stone 1984, section 3.4.3).
    pub one_standard_error: usize,
    /// Indices of the lambdas where the solver of some fold missed its tolerance.
    pub inexact: Vec<usize>,
}

/// Scores of one fold.
pub(crate) struct Scored {
    /// Error of every lambda.
    pub(crate) errors: Vec<f64>,
    /// Errors of every task (tasks x lambdas).
    pub(crate) tasks: Mat<f64>,
    /// Coefficients that are not zero.
    pub(crate) features: Vec<usize>,
    /// True if the solver met its tolerance, for each lambda.
    pub(crate) exact: Vec<bool>,
    /// Held-out and training rows.
    pub(crate) rows: [f64; 2],
}

impl CrossValidation {
    pub(crate) fn new(lambdas: Vec<f64>, folds: &[Scored], overlap: bool) -> Result<Self, SelectError> {
        let (count, k) = (lambdas.len(), folds.len());
        let errors = Mat::from_fn(count, k, |l, fold| folds[fold].errors[l]);
        let measured = folds.first().map_or(0, |fold| fold.tasks.nrows());
        let tasks = (0..measured).map(|t| Mat::from_fn(count, k, |l, fold| folds[fold].tasks[(t, l)])).collect();
        let rows: Vec<f64> = folds.iter().map(|fold| fold.rows[0]).collect();
        let share: Vec<f64> = rows.iter().map(|n| n / rows.iter().sum::<f64>()).collect();
        let average = |value: &dyn Fn(usize) -> f64| (0..k).map(|fold| share[fold] * value(fold)).sum::<f64>();
        let mean: Vec<f64> = (0..count).map(|l| average(&|fold| errors[(l, fold)])).collect();
        let again = average(&|fold| folds[fold].rows[0] / folds[fold].rows[1]);
        let factor = 1.0 / k as f64 + if overlap { again } else { 0.0 };
        let variance = |l: usize| {
            let square = average(&|fold| (errors[(l, fold)] - mean[l]).powi(2));
            if k > 1 { square * k as f64 / (k - 1) as f64 } else { 0.0 }
        };
        let standard_error: Vec<f64> = (0..count).map(|l| (variance(l) * factor).sqrt()).collect();
        let features =
            (0..count).map(|l| folds.iter().map(|fold| fold.features[l] as f64).sum::<f64>() / k as f64).collect();
        let Some(best) = (0..count).min_by(|&a, &b| mean[a].total_cmp(&mean[b])) else {
            return Err(SelectError::NoLambdas);
        };
        let limit = mean[best] + standard_error[best];
        let one_standard_error = (0..best).find(|&l| mean[l] <= limit).unwrap_or(best);
        let inexact = (0..count).filter(|&l| folds.iter().any(|fold| !fold.exact[l])).collect();
        Ok(Self { lambdas, errors, tasks, rows, mean, standard_error, features, best, one_standard_error, inexact })
    }

    /// The lambda with the least mean error.
    pub fn best_lambda(&self) -> f64 {
        self.lambdas[self.best]
    }

    /// The lambda of the one-standard-error rule.
    pub fn one_standard_error_lambda(&self) -> f64 {
        self.lambdas[self.one_standard_error]
    }
}
