//! Nonlinear least squares, and its estimates.

use faer::Mat;
use fleetfoot_data::{Progress, Source};
use fleetfoot_library::Expr;
use fleetfoot_stats::kernel::norm;

use crate::{
    Bounded, EstimateError, Options, Residual, Status, Uncertain,
    covariance::Inverse,
    descent::Descent,
    evaluate::{Nonlinear, Objective},
    parameter::substitute,
    problem::Problem,
};

/// Parameters of least squares.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Estimate {
    /// Names of the parameters (p).
    pub names: Vec<String>,
    /// Their values (p).
    pub values: Vec<f64>,
    /// The weighted sum of squared residuals.
    pub cost: f64,
    /// Share of the cost of each residual of positive weight.
    pub shares: Vec<f64>,
    /// Rows with all values.
    pub rows: u64,
    /// Cost over degrees of freedom (residuals of all rows less the free parameters); NaN without any.
    pub variance: f64,
    /// Covariance of the parameters (p x p) for independent errors of equal variance (after weights): `variance (J'J)^-1`. Zero where a parameter
    /// is fixed or at a bound; without meaning for those that are undetermined.
    pub covariance: Mat<f64>,
    /// Covariance for errors that are correlated within chunks: the sandwich over chunks; `None` for a single chunk.
    pub clustered: Option<Mat<f64>>,
    /// Condition of the Jacobian, its columns scaled to unit length.
    pub condition: f64,
    /// Parameters that the rows do not determine at the end.
    pub undetermined: Vec<usize>,
    /// Parameters at a bound that pushes back.
    pub at_bounds: Vec<usize>,
    /// The certificate: the largest cosine of the angle between the residual and a column of the Jacobian, those of parameters at bounds left out.
    pub gradient: f64,
    /// Why the iteration ended.
    pub status: Status,
    /// Trial steps.
    pub iterations: usize,
}

impl Estimate {
    /// The value of a parameter.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.names.iter().position(|known| known == name).map(|j| self.values[j])
    }

    /// Standard errors of the parameters (p), for independent errors; infinite where undetermined.
    pub fn standard_errors(&self) -> Vec<f64> {
        let of = |j: usize| if self.undetermined.contains(&j) { f64::INFINITY } else { self.covariance[(j, j)].sqrt() };
        (0..self.values.len()).map(of).collect()
    }

    /// Standard errors for errors that are correlated within chunks; `None` for a single chunk.
    pub fn clustered_errors(&self) -> Option<Vec<f64>> {
        let clustered = self.clustered.as_ref()?;
        let of =
            |j: usize| if self.undetermined.contains(&j) { f64::INFINITY } else { clustered[(j, j)].max(0.0).sqrt() };
        Some((0..self.values.len()).map(of).collect())
    }

    /// A parameter with its standard error, to be printed: `0.0716 +- 0.0009`.
    pub fn uncertain(&self, name: &str) -> Option<Uncertain> {
        let j = self.names.iter().position(|known| known == name)?;
        Some(Uncertain { value: self.values[j], error: self.standard_errors()[j] })
    }

    /// An expression with the estimates in place of the parameters.
    pub fn insert(&self, expr: &Expr) -> Expr {
        substitute(&self.names, expr, &self.values)
    }
}

/// Minimises the weighted sum of squared residuals over all rows of the source at which targets and columns are finite.
///
/// Models may use filters, `lag1(u, tau)` and `delay(u, d)` (see [`fleetfoot_library::FilterKind`]), with parameters in
/// their constants and inputs. A row counts if the values that lags read are there, and those of delays for as long as
/// the delay's bounds allow. The rows then do not depend on the parameters.
///
/// Symmetric matrices of parameters may have a bound ([`Bounded`]); every step is then the best that keeps it.
/// Covariances are those of the parameters that can still move: along an active bound, not across it.
///
/// # Errors
/// When names clash, a parameter is unused or starts outside its bounds, a matrix is none or starts beyond its bound,
/// or a weight or an option is out of range. When a column does not exist, a delay has no upper bound, a model is not
/// finite at the initial values, or there are fewer residuals than parameters. When the source cannot be read, or the
/// user stops it.
pub fn nonlinear_least_squares<'a>(
    residuals: &[Residual],
    parameters: impl Into<Bounded<'a>>,
    source: &dyn Source,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Estimate, EstimateError> {
    options.check()?;
    let bounded = parameters.into();
    let problem = Problem::new(residuals, &bounded, source)?;
    let objective = Nonlinear::new(&problem, source, options.chunk_rows, progress);
    progress.stage("nonlinear least squares");
    let initial: Vec<f64> = bounded.parameters.iter().map(|parameter| parameter.initial).collect();
    let initial = problem.limits.as_ref().map_or(initial.clone(), |limits| limits.pulled(&initial));
    let mut descent = Descent::new(&objective, initial, options)?;
    let (status, iterations) = descent.run()?;
    Estimate::at(&objective, descent, status, iterations)
}

impl Estimate {
    /// Estimate at the end of a descent.
    pub(crate) fn at(
        objective: &Nonlinear<'_>,
        descent: Descent<'_>,
        status: Status,
        iterations: usize,
    ) -> Result<Self, EstimateError> {
        let room = descent.room();
        let bounds = objective.bounds();
        let free: Vec<usize> = (0..room.len()).filter(|&j| room[j][0] < room[j][1]).collect();
        let fixed = |j: &usize| !free.contains(j) && bounds[*j][0] < bounds[*j][1];
        let lengths = (0..room.len()).map(|j| norm(descent.at.jacobian.col_as_slice(j).iter().copied()));
        let lengths: Vec<f64> = lengths.map(|length| if length > 0.0 { length } else { 1.0 }).collect();
        let inverse = Inverse::new(&descent.at, &lengths, &free, &descent.held(&lengths, &free))?;
        let freedom = (descent.at.rows * objective.residuals() as u64) as f64 - free.len() as f64;
        let variance = if freedom > 0.0 { descent.at.cost / freedom } else { f64::NAN };
        Ok(Estimate {
            names: objective.problem.layout.names.clone(),
            cost: descent.at.cost,
            shares: descent.at.shares.clone(),
            rows: descent.at.rows,
            variance,
            covariance: inverse.covariance(variance),
            clustered: inverse.clustered(&descent.at.scores),
            condition: inverse.condition,
            at_bounds: (0..room.len()).filter(fixed).collect(),
            gradient: descent.gradient(&descent.at, &room),
            undetermined: inverse.undetermined,
            status,
            iterations,
            values: descent.theta,
        })
    }
}
