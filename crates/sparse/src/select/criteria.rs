//! Information criteria along a path: AIC, BIC, EBIC.

use faer::Mat;
use fleetfoot_stats::SquareRoot;

use super::{HeldOut, SelectError, held_out::Coefficients};
use crate::{
    Path, Penalty, Quadratic,
    structured::{Assembled, Assembly},
};
use fleetfoot_sums::structured::Structure;

/// Estimate of the noise variance.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum NoiseVariance {
    /// The mean squared error of every model itself: `-2 log likelihood = N (ln(2 pi mse) + 1)`.
    #[default]
    Profiled,
    /// The variance of least squares on all columns, `N mse / (N - df)`, the same for all models:
    /// `N ln(2 pi v) + N mse / v` (Zou, Hastie, Tibshirani 2007; scikit-learn's `LassoLarsIC`). It needs a path down to
    /// lambda = 0.
    LeastSquares,
    /// Known.
    Known(f64),
}

/// Options for the comparison of models.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CriteriaOptions {
    /// Number of independent observations N; `None`: the sum of the row weights, times the number of measured tasks. Rows of a log are correlated: give
    /// [`effective_rows`](crate::select::effective_rows), times the tasks.
    pub observations: Option<f64>,
    /// Estimate of the noise variance.
    pub variance: NoiseVariance,
    /// EBIC's gamma, 0 (BIC) to 1: 0.5 is the usual choice, 1 is consistent for any number of columns that grows like a power of N.
    pub gamma: f64,
}

impl Default for CriteriaOptions {
    fn default() -> Self {
        Self { observations: None, variance: NoiseVariance::default(), gamma: 0.5 }
    }
}

/// Criteria at the knots of a path; the least value is the best. With L the Gaussian likelihood of N observations and df the degrees of freedom
/// ([`Estimator::degrees_of_freedom`](crate::estimator::Estimator::degrees_of_freedom), and 1 for an intercept):
///
/// - AIC `-2 log L + 2 df`, BIC `-2 log L + ln(N) df`,
/// - EBIC `BIC + 2 gamma ln C(p, k)`, k of p penalised columns in the model (Chen and Chen 2008).
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct InformationCriteria {
    /// lambda of every knot, descending.
    pub lambdas: Vec<f64>,
    /// Mean squared error on the training rows: `sum_t s_t mse_t` over the measured tasks, divided by their number.
    pub mse: Vec<f64>,
    /// Degrees of freedom, with that of an intercept.
    pub degrees_of_freedom: Vec<f64>,
    /// N.
    pub observations: f64,
    /// Akaike's criterion.
    pub aic: Vec<f64>,
    /// The Bayesian criterion.
    pub bic: Vec<f64>,
    /// The extended Bayesian criterion.
    pub ebic: Vec<f64>,
    /// Index of the least AIC, BIC and EBIC.
    pub best: [usize; 3],
}

/// Criteria of a path of one problem. Its path is taken for that of a single task.
///
/// # Errors
/// When path and problem do not belong together, an option is out of range, or the variance of least squares is asked for and not known.
pub fn information_criteria(
    problem: &Quadratic,
    penalty: &Penalty,
    path: &Path,
    options: &CriteriaOptions,
) -> Result<InformationCriteria, SelectError> {
    let mse = path.knots.iter().map(|knot| knot.mse).collect();
    criteria(problem, penalty, path, mse, options.observations.unwrap_or(problem.weight()), options)
}

/// Criteria of a path of an assembled problem: the errors are those of the measured tasks, without priors and the Tikhonov term. `roots` are the
/// statistics that it was assembled from.
///
/// Tasks are taken for independent, with noise variances in the ratio of 1 over their weights.
///
/// # Errors
/// As [`information_criteria`].
pub fn task_criteria(
    structure: &Structure,
    roots: &[SquareRoot],
    assembly: &Assembly,
    assembled: &Assembled,
    path: &Path,
    options: &CriteriaOptions,
) -> Result<InformationCriteria, SelectError> {
    let scored = HeldOut::tasks(structure, roots, assembly, assembled.scale.clone())?;
    let p = assembled.scale.len();
    let mut values = Mat::zeros(p, path.knots.len());
    for (k, knot) in path.knots.iter().enumerate() {
        values.col_as_slice_mut(k).copy_from_slice(&knot.dense(p));
    }
    let errors = scored.errors(&Coefficients { values, intercepts: vec![0.0; path.knots.len()] });
    let tasks = scored.len().max(1) as f64;
    let mse = (0..path.knots.len()).map(|k| scored.total(errors.as_ref(), k) / tasks).collect();
    let observations = options.observations.unwrap_or(tasks * scored.weight());
    criteria(&assembled.problem, &assembled.penalty, path, mse, observations, options)
}

fn criteria(
    problem: &Quadratic,
    penalty: &Penalty,
    path: &Path,
    mse: Vec<f64>,
    observations: f64,
    options: &CriteriaOptions,
) -> Result<InformationCriteria, SelectError> {
    if !(observations > 0.0 && observations.is_finite()) {
        return Err(SelectError::NotPositive { name: "the number of observations", value: observations });
    }
    if !(0.0..=1.0).contains(&options.gamma) {
        return Err(SelectError::Gamma { value: options.gamma });
    }
    let intercept = f64::from(u8::from(problem.has_intercept()));
    let df = path.knots.iter().map(|knot| Ok(path.estimator.degrees_of_freedom(problem, penalty, knot)? + intercept));
    let df = df.collect::<Result<Vec<f64>, SelectError>>()?;
    let deviance = deviances(path, &mse, &df, observations, options.variance)?;

    let factor = |j: usize| penalty.factors.get(j).copied().unwrap_or(1.0);
    let constant = problem.constant();
    let candidate = |j: &usize| factor(*j) > 0.0 && factor(*j).is_finite() && !constant.contains(j);
    let candidates = (0..problem.columns()).filter(candidate).count();
    let chosen = |k: usize| path.knots[k].support.iter().filter(|j| candidate(j)).count();

    let bic: Vec<f64> = deviance.iter().zip(&df).map(|(deviance, df)| deviance + observations.ln() * df).collect();
    let aic: Vec<f64> = deviance.iter().zip(&df).map(|(deviance, df)| deviance + 2.0 * df).collect();
    let models = |k: usize| 2.0 * options.gamma * log_binomial(candidates, chosen(k));
    let ebic: Vec<f64> = bic.iter().enumerate().map(|(k, bic)| bic + models(k)).collect();
    let least = |values: &[f64]| (0..values.len()).min_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
    let best = [least(&aic), least(&bic), least(&ebic)];
    let lambdas = path.knots.iter().map(|knot| knot.l1).collect();
    Ok(InformationCriteria { lambdas, mse, degrees_of_freedom: df, observations, aic, bic, ebic, best })
}

/// -2 log L of every knot.
fn deviances(
    path: &Path,
    mse: &[f64],
    df: &[f64],
    observations: f64,
    variance: NoiseVariance,
) -> Result<Vec<f64>, SelectError> {
    // A model without error has no likelihood: it is given the largest that there is.
    let level = |value: f64| (2.0 * std::f64::consts::PI * value.max(f64::MIN_POSITIVE)).ln();
    let known = match variance {
        NoiseVariance::Profiled => return Ok(mse.iter().map(|mse| observations * (level(*mse) + 1.0)).collect()),
        NoiseVariance::Known(value) if value > 0.0 && value.is_finite() => value,
        NoiseVariance::Known(value) => return Err(SelectError::NotPositive { name: "the noise variance", value }),
        NoiseVariance::LeastSquares => {
            let end = path.knots.last().map_or(f64::INFINITY, |knot| knot.l1);
            let features = df.last().copied().unwrap_or(0.0);
            let left = mse.last().copied().unwrap_or(0.0) * observations / (observations - features);
            if end > 0.0 || !(left > 0.0 && left.is_finite()) {
                return Err(SelectError::NoVariance { observations, features, end });
            }
            left
        }
    };
    Ok(mse.iter().map(|mse| observations * (level(known) + mse / known)).collect())
}

/// `ln C(n, k)`.
pub(crate) fn log_binomial(n: usize, k: usize) -> f64 {
    let k = k.min(n - k.min(n));
    (1..=k).map(|i| ((n - k + i) as f64 / i as f64).ln()).sum()
}

#[cfg(test)]
mod tests {
    use super::log_binomial;

    #[test]
    fn binomials() {
        assert_eq!(log_binomial(5, 0), 0.0);
        assert_eq!(log_binomial(5, 5), 0.0);
        assert!((log_binomial(10, 3) - 120.0_f64.ln()).abs() < 1e-14);
        assert!((log_binomial(10, 7) - 120.0_f64.ln()).abs() < 1e-14);
    }
}
