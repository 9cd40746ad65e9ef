//! Report of estimated parameters.

use faer::Mat;
use fleetfoot_estimate::{EquationError, FilterError, Gain, MatrixLimit, OutputError, Status};
use fleetfoot_model::Model;
use fleetfoot_recipe::EstimateMethod;
use fleetfoot_stats::student_t_95;
use fleetfoot_task::ParametersTask;
use serde::Serialize;

use crate::{limit_report::LimitReport, summary::FitSummary};

/// Correlation beyond which two parameters are confounded (Klein and Morelli 2006, section 5.4).
const CONFOUNDED: f64 = 0.9;

/// Ratio of standard errors from which a note says that correlated residuals widen the intervals.
const WIDER: f64 = 1.1;

/// The report of `fit parameters`.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ParametersReport {
    /// Method of estimation.
    pub method: EstimateMethod,
    /// Rows of the logs.
    pub rows: u64,
    /// The parameters.
    pub parameters: Vec<ParameterInterval>,
    /// Pairs whose correlation exceeds 0.9.
    pub confounded: Vec<ConfoundedPair>,
    /// Standard deviation of the noise: of the measured states; by filter error of their innovations; by equation error
    /// of the derivatives.
    pub noise: Vec<(String, f64)>,
    /// The same without `[constraints]`, where there are any and something is estimate: their price.
    pub free_noise: Vec<f64>,
    /// Bounds of matrices of parameters.
    pub limits: Vec<LimitReport>,
    /// By filter error, by how much the measurements of every compared state correct the simulation; else none.
    pub gains: Vec<GainInterval>,
    /// Covariance of the innovations of the compared states, by rows, by filter error; else empty.
    pub innovations: Vec<Vec<f64>>,
    /// Segments that were simulated, and those left out for missing values; none by equation error.
    pub segments: Option<[usize; 2]>,
    /// Rows over which residuals are correlated; `None` by equation error.
    pub memory: Option<usize>,
    /// True if the memory reaches the longest lag that is tried, so that the intervals may be too narrow.
    pub lasting: bool,
    /// Condition of the Jacobian, its columns scaled to unit length.
    pub condition: f64,
    /// The certificate: the largest cosine of the angle between the residual and a column of the Jacobian.
    pub gradient: f64,
    /// True if the minimum was reached.
    pub converged: bool,
    /// Rollouts of rows that did not train.
    pub held_out: Option<ParametersHeldOut>,
    /// The equations with their values.
    pub equations: Vec<String>,
    /// The part of the report that all methods share.
    pub summary: FitSummary,
}

/// A parameter and its interval.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ParameterInterval {
    /// Its name.
    pub name: String,
    /// Its estimate, or where it was kept.
    pub value: f64,
    /// Standard error with the correlation of the residuals; infinite where the rows do not determine it, 0 where it is fixed or at a bound.
    pub standard_error: f64,
    /// Standard error for residuals that are independent from row to row.
    pub white_error: f64,
    /// The 95 % interval.
    pub interval: [f64; 2],
    /// Unit, when known.
    pub unit: Option<String>,
    /// True if the value was kept fixed.
    pub fixed: bool,
    /// True if the estimate is at an active bound.
    pub at_bound: bool,
    /// True if the rows determine the value.
    pub determined: bool,
}

/// By how much the measurements of a state correct the simulation of filter error.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct GainInterval {
    /// The state.
    pub name: String,
    /// From 0, which is output error, to 1, which is equation error over a step.
    pub value: f64,
    /// Standard error with the correlation of the residuals; infinite where the rows do not determine it, 0 at a bound.
    pub standard_error: f64,
    /// The 95 % interval.
    pub interval: [f64; 2],
    /// True if the gain is 0 or 1 as the rows would have it beyond these bounds.
    pub at_bound: bool,
}

impl From<&Gain> for GainInterval {
    fn from(gain: &Gain) -> Self {
        let (name, value, standard_error) = (gain.state.clone(), gain.value, gain.error);
        Self { name, value, standard_error, interval: gain.interval(), at_bound: gain.at_bound }
    }
}

/// Two parameters that the rows hardly distinguish.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ConfoundedPair {
    /// Their names.
    pub names: [String; 2],
    /// Their correlation.
    pub correlation: f64,
}

/// Rollouts of rows that did not train the models that are rolled out.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ParametersHeldOut {
    /// Steps of a rollout.
    pub horizon: usize,
    /// Error over that of persistence, of every fold.
    pub folds: Vec<f64>,
    /// Rollouts that ended early.
    pub ended: usize,
    /// Rollouts.
    pub starts: usize,
}

impl ParametersHeldOut {
    /// Mean over the folds.
    pub fn share(&self) -> f64 {
        self.folds.iter().sum::<f64>() / self.folds.len() as f64
    }
}

/// Result of a method.
pub(super) enum Estimate {
    Equation(EquationError),
    Simulated { estimate: OutputError, filter: Option<Filter> },
}

/// Results of a filter beside the parameters.
pub(super) struct Filter {
    pub(super) gains: Vec<Gain>,
    pub(super) innovations: Mat<f64>,
}

impl From<OutputError> for Estimate {
    fn from(output_error: OutputError) -> Self {
        Self::Simulated { estimate: output_error, filter: None }
    }
}

impl From<FilterError> for Estimate {
    fn from(FilterError { parameters: estimate, gains, innovations, .. }: FilterError) -> Self {
        Self::Simulated { estimate, filter: Some(Filter { gains, innovations }) }
    }
}

impl Estimate {
    fn method(&self) -> EstimateMethod {
        match self {
            Self::Equation(_) => EstimateMethod::EquationError,
            Self::Simulated { filter: None, .. } => EstimateMethod::OutputError,
            Self::Simulated { filter: Some(_), .. } => EstimateMethod::FilterError,
        }
    }

    pub(super) fn values(&self) -> &[f64] {
        match self {
            Self::Equation(equation) => &equation.estimate.values,
            Self::Simulated { estimate, .. } => &estimate.values,
        }
    }

    /// As [`ParametersReport::noise`].
    fn deviations(&self) -> &[f64] {
        match self {
            Self::Equation(equation) => &equation.deviations,
            Self::Simulated { estimate, .. } => &estimate.deviations,
        }
    }

    fn undetermined(&self) -> &[usize] {
        match self {
            Self::Equation(equation) => &equation.estimate.undetermined,
            Self::Simulated { estimate, .. } => &estimate.undetermined,
        }
    }

    fn at_bounds(&self) -> &[usize] {
        match self {
            Self::Equation(equation) => &equation.estimate.at_bounds,
            Self::Simulated { estimate, .. } => &estimate.at_bounds,
        }
    }

    /// With the correlation of the residuals, for which equation error takes that within chunks of rows.
    pub(super) fn covariance(&self) -> Mat<f64> {
        match self {
            Self::Equation(equation) => {
                equation.estimate.clustered.clone().unwrap_or(equation.estimate.covariance.clone())
            }
            Self::Simulated { estimate, .. } => estimate.covariance.clone(),
        }
    }

    fn standard_errors(&self) -> Vec<f64> {
        match self {
            Self::Equation(equation) => {
                equation.estimate.clustered_errors().unwrap_or_else(|| equation.estimate.standard_errors())
            }
            Self::Simulated { estimate, .. } => estimate.standard_errors(),
        }
    }

    fn white_errors(&self) -> Vec<f64> {
        match self {
            Self::Equation(equation) => equation.estimate.standard_errors(),
            Self::Simulated { estimate, .. } => {
                (0..estimate.values.len()).map(|j| estimate.white[(j, j)].sqrt()).collect()
            }
        }
    }

    pub(super) fn half_widths(&self) -> Vec<f64> {
        match self {
            Self::Equation(equation) => {
                let factor =
                    student_t_95((equation.estimate.rows as usize).saturating_sub(equation.estimate.values.len()));
                self.standard_errors().iter().map(|error| factor * error).collect()
            }
            Self::Simulated { estimate, .. } => estimate.half_widths(),
        }
    }
}

/// The word of a method.
pub(super) fn word(method: EstimateMethod) -> &'static str {
    match method {
        EstimateMethod::EquationError => "equation-error",
        EstimateMethod::OutputError => "output-error",
        EstimateMethod::FilterError => "filter-error",
    }
}

pub(super) fn report(
    task: &ParametersTask,
    open: &Model,
    (estimate, free): (&Estimate, Option<&Estimate>),
    held_out: Option<ParametersHeldOut>,
    mut summary: FitSummary,
) -> ParametersReport {
    let (errors, white, half_widths) = (estimate.standard_errors(), estimate.white_errors(), estimate.half_widths());
    let interval = |j: usize| {
        let (parameter, value) = (&task.parameters[j], estimate.values()[j]);
        ParameterInterval {
            name: parameter.name.clone(),
            value,
            standard_error: errors[j],
            white_error: white[j],
            interval: [value - half_widths[j], value + half_widths[j]],
            unit: parameter.unit.clone(),
            fixed: parameter.fixed,
            at_bound: estimate.at_bounds().contains(&j),
            determined: !estimate.undetermined().contains(&j),
        }
    };
    let parameters: Vec<ParameterInterval> = (0..task.parameters.len()).map(interval).collect();
    let moves = |j: usize| !parameters[j].fixed && !parameters[j].at_bound && parameters[j].determined;
    let confounded = confounded(&estimate.covariance(), &parameters, moves);
    // Six digits are what a person reads; the model has all.
    let rounded: Vec<f64> =
        estimate.values().iter().map(|value| format!("{value:.5e}").parse().unwrap_or(*value)).collect();
    let equation = |equation: &fleetfoot_model::Equation| {
        format!("{} = {}", equation.label(), task.insert(&equation.right, &rounded))
    };
    let equations = open.equations.iter().map(equation);
    let limit = |limit: &MatrixLimit| {
        let clearance = |estimate: &Estimate| limit.clearance(estimate.values());
        LimitReport::of_matrix(limit, clearance(estimate), free.map(clearance))
    };
    let limits = task.limits.iter().map(limit).collect();
    let (noise, segments, memory, condition, gradient, converged) = match estimate {
        Estimate::Equation(estimation) => {
            let labels = task.residuals.iter().map(|residual| residual.name.clone());
            let converged = estimation.settled && estimation.estimate.status.converged();
            let noise = labels.zip(estimation.deviations.iter().copied()).collect();
            (noise, None, None, estimation.estimate.condition, estimation.estimate.gradient, converged)
        }
        Estimate::Simulated { estimate, .. } => {
            let noise = estimate.outputs.iter().cloned().zip(estimate.deviations.iter().copied()).collect();
            let segments = Some([estimate.beginnings.len(), estimate.missing]);
            let converged = estimate.status != Status::Iterations;
            (noise, segments, Some(estimate.memory), estimate.condition, estimate.gradient, converged)
        }
    };
    let (gains, innovations) = match estimate {
        Estimate::Simulated { filter: Some(Filter { gains, innovations }), .. } => {
            let row = |i: usize| (0..innovations.ncols()).map(|j| innovations[(i, j)]).collect();
            (gains.iter().map(GainInterval::from).collect(), (0..innovations.nrows()).map(row).collect())
        }
        _ => (Vec::new(), Vec::new()),
    };
    if !converged {
        summary.notes.push(
            "the minimum was not reached, so the intervals are not valid; start nearer to it, or use shorter segments"
                .into(),
        );
    }
    ParametersReport {
        method: estimate.method(),
        rows: open.training.rows,
        parameters,
        confounded,
        noise,
        free_noise: free.map_or_else(Vec::new, |free| free.deviations().to_vec()),
        limits,
        gains,
        innovations,
        segments,
        memory,
        condition,
        gradient,
        lasting: matches!(estimate, Estimate::Simulated { estimate, .. } if estimate.lasting),
        converged,
        held_out,
        equations: equations.collect(),
        summary,
    }
}

fn confounded(
    covariance: &Mat<f64>,
    parameters: &[ParameterInterval],
    free: impl Fn(usize) -> bool,
) -> Vec<ConfoundedPair> {
    let mut pairs = Vec::new();
    for a in (0..parameters.len()).filter(|&a| free(a)) {
        for b in (a + 1..parameters.len()).filter(|&b| free(b)) {
            let correlation = covariance[(a, b)] / (covariance[(a, a)] * covariance[(b, b)]).sqrt();
            if correlation.abs() > CONFOUNDED {
                let names = [parameters[a].name.clone(), parameters[b].name.clone()];
                pairs.push(ConfoundedPair { names, correlation });
            }
        }
    }
    pairs
}

impl ParametersReport {
    /// Warnings, in sentences: parameters that the rows do not determine or hardly distinguish; residuals that are
    /// correlated.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for parameter in self.parameters.iter().filter(|parameter| !parameter.determined) {
            warnings.push(format!(
                "The rows do not determine `{}`: fix it, or give logs in which its factor varies independently.",
                parameter.name
            ));
        }
        for ConfoundedPair { names: [a, b], correlation } in &self.confounded {
            warnings.push(format!(
                "`{a}` and `{b}` are confounded (correlation {correlation:.3}): the rows determine a combination of them better than either one."
            ));
        }
        for gain in self.gains.iter().filter(|gain| gain.at_bound) {
            warnings.push(match gain.value > 0.5 {
                false => format!(
                    "The gain of `{}` is at its bound 0: its measurements correct nothing, as by output error.",
                    gain.name
                ),
                true => format!(
                    "The gain of `{}` is at its bound 1: every step begins at its measurement, as by equation error.",
                    gain.name
                ),
            });
        }
        let ratio =
            |parameter_interval: &ParameterInterval| parameter_interval.standard_error / parameter_interval.white_error;
        let widest = self.parameters.iter().map(ratio).filter(|ratio| ratio.is_finite()).fold(1.0, f64::max);
        if let Some(rows) = self.memory.filter(|_| widest >= WIDER) {
            warnings.push(format!(
                "Residuals are correlated over {rows} rows, which the model does not explain: the intervals are up to {widest:.1} times as wide as those of white noise{}.",
                if self.lasting { ", and may be too narrow: correlation over more rows was not examined" } else { "" }
            ));
        }
        warnings
    }
}
