//! Separable least squares: nonlinear parameters outside, linear coefficients inside.

mod objective;
mod starts;

use fleetfoot_data::{Progress, Source};
use fleetfoot_library::Expr;

use crate::{
    Estimate, EstimateError, Options, Parameter, Residual, Status, Uncertain,
    descent::Descent,
    evaluate::{Evaluation, LinearPart, Nonlinear, Objective, Pass},
    parameter::check_parameters,
    problem::{Problem, check_weight},
};
use objective::{Layer, Projected};

/// One equation: `target = sum_j c_j function_j`, the coefficients c free.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearTarget {
    /// Its name in messages; unique among the targets of a problem.
    pub name: String,
    /// Measured expression, over columns.
    pub target: Expr,
    /// Candidate functions: expressions over columns, filters and parameters; `1` for a constant.
    pub functions: Vec<Expr>,
    /// Weight of its squares, usually 1 over the variance of its error.
    pub weight: f64,
}

impl LinearTarget {
    /// Of weight 1, named after its target.
    pub fn new(target: Expr, functions: Vec<Expr>) -> Self {
        Self { name: target.to_string(), target, functions, weight: 1.0 }
    }

    /// The same with another weight.
    pub fn weighted(self, weight: f64) -> Self {
        Self { weight, ..self }
    }
}

/// Start and end of the search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeparableOptions {
    /// The iteration over the nonlinear parameters.
    pub iteration: Options,
    /// Points between the bounds that are tried beside the initial values, one pass over the rows each. They are evenly
    /// spread, in the logarithm if bounds are positive and ten times apart. Parameters without finite bounds stay at
    /// their initial values. For delays, whose sum of squares has many minima.
    pub starts: usize,
    /// From how many of the best points the iteration descends, at least 1; the lowest end counts.
    pub descents: usize,
}

impl Default for SeparableOptions {
    fn default() -> Self {
        Self { iteration: Options::default(), starts: 0, descents: 1 }
    }
}

/// A point that was tried before the iteration.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// The nonlinear parameters (q).
    pub parameters: Vec<f64>,
    /// The weighted sum of squares there, with the best coefficients; `None` where a function is not finite.
    pub cost: Option<f64>,
}

/// The coefficients of one target.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LinearFit {
    /// The target's name.
    pub name: String,
    /// Coefficients of its functions (p); where the rows leave a choice, those of least norm in units of the functions' lengths.
    pub coefficients: Vec<f64>,
    /// Their standard errors (p), the parameters' uncertainty included.
    pub errors: Vec<f64>,
    /// Standard errors for errors that are correlated within chunks (p); `None` for a single chunk.
    pub clustered_errors: Option<Vec<f64>>,
    /// Root of the mean squared residual, in the target's unit, without weight.
    pub rms: f64,
}

/// The answer to a separable problem.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Separable {
    /// Everything as one estimate: first the nonlinear parameters (q), then the coefficients, target by target. Covariances are joint; the
    /// certificate is the largest cosine between the residual and a column of the joint Jacobian.
    pub estimate: Estimate,
    /// Number of nonlinear parameters, q.
    pub parameters: usize,
    /// One a target.
    pub targets: Vec<LinearFit>,
    /// Points that were tried before the iteration, the initial values first.
    pub starts: Vec<Start>,
}

impl Separable {
    /// A nonlinear parameter with its standard error; prints as `0.07160 +- 0.00091`.
    pub fn parameter(&self, name: &str) -> Option<Uncertain> {
        self.estimate.names[..self.parameters]
            .iter()
            .any(|known| known == name)
            .then(|| self.estimate.uncertain(name))?
    }

    /// The fit of a target.
    pub fn target(&self, name: &str) -> Option<&LinearFit> {
        self.targets.iter().find(|target| target.name == name)
    }

    /// An expression with the estimates in place of the parameters: `lag1(m1, tau)` becomes the filter at the estimated constant.
    pub fn insert(&self, expr: &Expr) -> Expr {
        self.estimate.insert(expr)
    }
}

/// Minimises `sum_k w_k sum_i (y_k(x_i) - sum_j c_kj phi_kj(x_i, theta))^2` over all coefficients c and over the
/// parameters theta between their bounds. Targets may share parameters.
///
/// Variable projection (Golub and Pereyra, The differentiation of pseudo-inverses and nonlinear least squares problems
/// whose variables separate, 1973). At every theta the coefficients are solved for. Theta moves by Levenberg-Marquardt
/// with Kaufman's Jacobian (A variable projection method for solving separable nonlinear least squares problems, 1975),
/// `-P d(phi)/d(theta) c`, P the projector off all phi. These are the steps of Gauss-Newton on (theta, c) jointly, from
/// the best c every time. A trial is one pass over the rows, which leaves a triangular factor of phi, d(phi)/d(theta)
/// and y for each target (p + at most p q + 1 columns). Memory does not grow with the rows, and nothing is squared.
/// Derivatives are exact, through filters too.
///
/// # Errors
/// As [`nonlinear_least_squares`](crate::nonlinear_least_squares); and when a target has no functions.
pub fn separable(
    targets: &[LinearTarget],
    parameters: &[Parameter],
    source: &dyn Source,
    options: &SeparableOptions,
    progress: &dyn Progress,
) -> Result<Separable, EstimateError> {
    options.iteration.check()?;
    check_targets(targets)?;
    check_parameters(parameters, source)?;
    let layer = Layer::new(targets, parameters, source)?;
    let objective = Projected::new(&layer, source, options.iteration.chunk_rows, progress);
    progress.stage("starting points");
    let (starts, best) = begin(&objective, parameters, options)?;
    progress.stage("separable least squares");
    let mut end: Option<(Descent<'_>, Status, usize)> = None;
    for (theta, at) in best {
        let mut descent = Descent::from(&objective, theta, at, &options.iteration)?;
        let (status, iterations) = descent.run()?;
        if end.as_ref().is_none_or(|(lowest, ..)| descent.at.cost < lowest.at.cost) {
            end = Some((descent, status, iterations));
        }
    }
    match end {
        Some((descent, status, iterations)) => {
            let joint = Joint { targets, parameters, source, options, progress };
            joint.finish(&descent.theta, &descent.at.linear, (status, iterations), starts)
        }
        None => unreachable!("at least one start is evaluated, or `begin` has failed"),
    }
}

fn check_targets(targets: &[LinearTarget]) -> Result<(), EstimateError> {
    let mut names = std::collections::HashSet::new();
    for target in targets {
        check_weight(&target.name, target.weight)?;
        if target.functions.is_empty() {
            return Err(EstimateError::NoFunctions { target: target.name.clone() });
        }
        if !names.insert(&target.name) {
            return Err(EstimateError::NameTaken { name: target.name.clone(), by: "another target" });
        }
    }
    Ok(())
}

/// Points with their evaluations.
type Evaluated = Vec<(Vec<f64>, Evaluation)>;

/// Evaluates the starting points; all of them, and the best in order of their cost.
fn begin(
    objective: &Projected<'_>,
    parameters: &[Parameter],
    options: &SeparableOptions,
) -> Result<(Vec<Start>, Evaluated), EstimateError> {
    let (mut starts, mut finite, mut refusal) = (Vec::new(), Evaluated::new(), None);
    let keep = options.descents.max(1);
    for theta in starts::points(parameters, options.starts) {
        let mut cost = None;
        match objective.evaluate(&theta)? {
            Pass::Finite(at) => {
                cost = Some(at.cost);
                let place = finite.partition_point(|(_, other)| other.cost <= at.cost);
                finite.insert(place, (theta.clone(), at));
                finite.truncate(keep);
            }
            Pass::Refused(error) => _ = refusal.get_or_insert(error),
        }
        starts.push(Start { parameters: theta, cost });
    }
    match refusal {
        Some(error) if finite.is_empty() => Err(error),
        _ => Ok((starts, finite)),
    }
}

/// The same problem with the coefficients as parameters.
struct Joint<'a> {
    targets: &'a [LinearTarget],
    parameters: &'a [Parameter],
    source: &'a dyn Source,
    options: &'a SeparableOptions,
    progress: &'a dyn Progress,
}

impl Joint<'_> {
    /// One pass at the end: covariances, certificate, and undetermined parameters.
    fn finish(
        &self,
        theta: &[f64],
        linear: &[LinearPart],
        (status, iterations): (Status, usize),
        starts: Vec<Start>,
    ) -> Result<Separable, EstimateError> {
        let q = self.parameters.len();
        let (residuals, parameters) = self.problem(theta, linear);
        let problem = Problem::new(&residuals, &(&parameters).into(), self.source)?;
        let iteration = &self.options.iteration;
        let objective = Nonlinear::new(&problem, self.source, iteration.chunk_rows, self.progress);
        let initial = parameters.iter().map(|parameter| parameter.initial).collect();
        let descent = Descent::new(&objective, initial, iteration)?;
        let estimate = Estimate::at(&objective, descent, status, iterations)?;
        let (errors, clustered) = (estimate.standard_errors(), estimate.clustered_errors());
        let (mut fits, mut next) = (Vec::with_capacity(self.targets.len()), q);
        for (target, part) in self.targets.iter().zip(linear) {
            // A target without weight has no coefficients in the estimate.
            let count = if target.weight > 0.0 { part.coefficients.len() } else { 0 };
            let of = next..next + count;
            next += count;
            let unknown = vec![f64::NAN; part.coefficients.len() - count];
            fits.push(LinearFit {
                name: target.name.clone(),
                coefficients: part.coefficients.clone(),
                errors: [&errors[of.clone()], &unknown].concat(),
                clustered_errors: clustered.as_ref().map(|errors| [&errors[of], &unknown].concat()),
                rms: (part.rss / estimate.rows as f64).sqrt(),
            });
        }
        Ok(Separable { estimate, parameters: q, targets: fits, starts })
    }

    fn problem(&self, theta: &[f64], linear: &[LinearPart]) -> (Vec<Residual>, Vec<Parameter>) {
        let with = |(parameter, &value): (&Parameter, &f64)| Parameter { initial: value, ..parameter.clone() };
        let mut parameters: Vec<Parameter> = self.parameters.iter().zip(theta).map(with).collect();
        let mut residuals = Vec::with_capacity(self.targets.len());
        for (target, part) in self.targets.iter().zip(linear).filter(|(target, _)| target.weight > 0.0) {
            let mut model = Expr::number(0.0);
            for (j, (function, &value)) in target.functions.iter().zip(&part.coefficients).enumerate() {
                let name = format!("coefficient {} of {}", j + 1, target.name);
                model = model + Expr::column(name.as_str()) * function;
                parameters.push(Parameter::new(name, value));
            }
            let (name, weight) = (target.name.clone(), target.weight);
            residuals.push(Residual { name, target: target.target.clone(), model: model.simplified(), weight });
        }
        (residuals, parameters)
    }
}

#[cfg(test)]
mod tests;
