//! Information criteria of models with their rows known by a statistic.

use fleetfoot_stats::Compressed;

use super::{
    Step, ThresholdError,
    error::{positive, share},
};
use crate::{kernel::norm, select::log_binomial};

/// An information criterion; the least value is the best.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Criterion {
    /// Akaike's.
    Aic,
    /// The Bayesian one.
    #[default]
    Bic,
    /// The extended Bayesian one: it counts how many models of a size there are.
    Ebic,
}

/// Options for the comparison of models.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CriterionOptions {
    /// Number of independent observations N; `None`: the rows of positive weight. Rows of a log are correlated: give the effective number
    /// ([`BatchMeans`](fleetfoot_stats::BatchMeans) of the residuals).
    pub observations: Option<f64>,
    /// EBIC's gamma, 0 (BIC) to 1.
    pub gamma: f64,
}

impl Default for CriterionOptions {
    fn default() -> Self {
        Self { observations: None, gamma: 0.5 }
    }
}

/// Criteria of the steps of a trail, k terms each, the noise variance profiled out:
///
/// - AIC `N (ln(2 pi rss/n) + 1) + 2 k`, BIC with `ln(N) k` in place of `2 k`,
/// - EBIC `BIC + 2 gamma ln C(candidates, k)` (Chen and Chen 2008).
///
/// An error below what the target is known to (its rounding, or [`Compressed::resolution`]) counts as that, so that of models without error the smallest is the best.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Criteria {
    /// N.
    pub observations: f64,
    /// Akaike's criterion of every step.
    pub aic: Vec<f64>,
    /// The Bayesian criterion.
    pub bic: Vec<f64>,
    /// The extended Bayesian criterion.
    pub ebic: Vec<f64>,
}

impl Criteria {
    /// Values of one criterion.
    pub fn values(&self, criterion: Criterion) -> &[f64] {
        match criterion {
            Criterion::Aic => &self.aic,
            Criterion::Bic => &self.bic,
            Criterion::Ebic => &self.ebic,
        }
    }

    /// Index of the step with the least value; of several, the first.
    pub fn best(&self, criterion: Criterion) -> usize {
        let values = self.values(criterion);
        (0..values.len()).min_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0)
    }
}

/// Sum of squared errors below which no model is better than another: the rounding of the target, or what it is known to.
pub(super) fn rounding(problem: &Compressed, target: usize) -> f64 {
    let z = problem.z.col_as_slice(target).iter().copied();
    let size = norm(z.chain([problem.residual[target].max(0.0).sqrt()]));
    let level = 16.0 * f64::EPSILON * ((problem.columns() + 1) as f64).sqrt();
    (level * size).powi(2).max(problem.resolution[target] * problem.weight)
}

/// Criteria of steps of one target; `candidates` terms were to choose from.
pub(crate) fn scores(
    steps: &[Step],
    problem: &Compressed,
    target: usize,
    candidates: usize,
    options: &CriterionOptions,
) -> Result<Criteria, ThresholdError> {
    share("gamma of EBIC", options.gamma)?;
    let observations = positive("the number of observations", options.observations.unwrap_or(problem.rows as f64))?;
    let least = rounding(problem, target).max(f64::MIN_POSITIVE);
    let deviance = |step: &Step| {
        let mse = step.rss.max(least) / problem.weight;
        observations * ((2.0 * std::f64::consts::PI * mse).ln() + 1.0)
    };
    let with = |price: &dyn Fn(usize) -> f64| steps.iter().map(|step| deviance(step) + price(step.terms())).collect();
    let bic = |k: usize| observations.ln() * k as f64;
    Ok(Criteria {
        observations,
        aic: with(&|k| 2.0 * k as f64),
        bic: with(&bic),
        ebic: with(&|k| bic(k) + 2.0 * options.gamma * log_binomial(candidates, k.min(candidates))),
    })
}
