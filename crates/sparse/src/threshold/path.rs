//! The path of a penalty on compressed rows, its supports refitted.

use fleetfoot_stats::Compressed;

use super::{
    Scaling, Status, Step, Terms, ThresholdError, Trail,
    criteria::{Criterion, CriterionOptions, scores},
    prepared::{Prepared, Solved},
    refits::Refits,
};
use crate::{
    Penalty, Quadratic, Solution,
    estimator::{Estimator, Stop},
};

/// The path of the lasso or of another penalty over decreasing lambda ([`Estimator::path`]), with a model for every support on it.
#[derive(Debug, Clone, PartialEq)]
pub struct PenalisedPath {
    /// The penalty.
    pub estimator: Estimator,
    /// True if coefficients are penalised in units of their column's root mean square. Fixed terms are not penalised:
    /// fix the constant for a free intercept.
    pub standardise: bool,
    /// End of the path: the smallest lambda, in the units of the target.
    pub lambda_min: f64,
    /// The most terms; `None`: all.
    pub max_terms: Option<usize>,
    /// True if each support is refitted by least squares; knots with the support of the knot before then make no model.
    pub refit: bool,
    /// Criterion by which a model is chosen.
    pub criterion: Criterion,
    /// Options of the criterion.
    pub options: CriterionOptions,
}

impl Default for PenalisedPath {
    fn default() -> Self {
        Self {
            estimator: Estimator::default(),
            standardise: true,
            lambda_min: 0.0,
            max_terms: None,
            refit: true,
            criterion: Criterion::default(),
            options: CriterionOptions::default(),
        }
    }
}

impl PenalisedPath {
    pub(super) fn trail(&self, problem: &Compressed, target: usize, terms: &Terms) -> Result<Trail, ThresholdError> {
        terms.refuse_bounds("a path of penalties")?;
        let prepared = Prepared::new(problem, terms, Scaling::Physical, 0.0)?;
        prepared.check_target(target)?;
        let quadratic = Quadratic::from_compressed(problem, target)?;
        let mut factors = vec![f64::INFINITY; problem.columns()];
        prepared.open.iter().for_each(|&j| factors[j] = if prepared.fixed[j] { 0.0 } else { 1.0 });
        let penalty = Penalty { standardise: self.standardise, factors, signs: Vec::new() };
        let fixed = prepared.open.iter().filter(|&&j| prepared.fixed[j]).count();
        let max_features = self.max_terms.map(|most| most.saturating_add(fixed));
        let path = self.estimator.path(&quadratic, &penalty, &Stop { lambda: self.lambda_min, max_features })?;
        let mut knots = path.knots;
        let models = match self.refit {
            true => {
                knots.dedup_by(|next, knot| next.support == knot.support);
                let supports: Vec<Vec<usize>> = knots.iter().map(|knot| knot.support.clone()).collect();
                Refits::new(&prepared, &quadratic, target)?.steps(&supports)
            }
            false => knots.iter().map(|knot| shrunk(&prepared, target, knot)).collect(),
        };
        let step = |(at, (step, knot)): (usize, (Step, &Solution))| {
            let empty = knot.support.iter().all(|&j| prepared.fixed[j]);
            let status = if empty { Status::Empty } else { Status::Converged };
            Step { parameter: knot.l1, status, iterations: at + 1, ..step }
        };
        let steps: Vec<Step> = models.into_iter().zip(&knots).enumerate().map(step).collect();
        let chosen = scores(&steps, problem, target, prepared.open.len(), &self.options)?.best(self.criterion);
        Ok(Trail { steps, chosen, order: Vec::new(), rounding: 0.0 })
    }
}

/// A knot's own coefficients as a model.
fn shrunk(prepared: &Prepared<'_>, target: usize, knot: &Solution) -> Step {
    let solved = Solved { values: knot.coefficients.clone(), confounded: Vec::new() };
    let mut step = prepared.step(target, knot.support.clone(), solved, false);
    step.certificate.correlation = knot.certificate.kkt;
    step
}
