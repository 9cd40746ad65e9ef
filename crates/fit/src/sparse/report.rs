//! Report of a sparse fit, for people and for programs.

use fleetfoot_sparse::{Certificate, inference::confounded};
use serde::Serialize;

use super::{
    LambdaChoice, LeaveOneOutReport, PathReport, intervals::percentile_intervals, problem::Problem, support::Support,
};
use crate::{
    error::Error,
    limit_report::{FreeErrors, LimitReport},
    serialize,
    summary::FitSummary,
};

/// Largest part of a column beyond others, relative to its length, at which the columns still count as confounded.
const CONFOUNDED: f64 = 1e-6;

/// Report of a sparse fit.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct SparseReport {
    /// Rows, weights included.
    pub rows: f64,
    /// Lambda, and how it was chosen.
    pub lambda: LambdaChoice,
    /// The path of the penalised fit, from the largest lambda to beyond the chosen one; where there is a penalty.
    pub path: Option<PathReport>,
    /// Method of the selection.
    pub selection: String,
    /// The regression's tasks.
    pub tasks: Vec<TaskReport>,
    /// Bounds that hold at every row.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub limits: Vec<LimitReport>,
    /// The latents.
    pub latents: Vec<LatentReport>,
    /// Penalised fit at lambda, for people: `lasso`, `group lasso`.
    #[serde(skip)]
    pub penalty: &'static str,
    /// Certificate of the penalised fit of all rows at lambda.
    #[serde(serialize_with = "serialize::certificate")]
    pub certificate: Certificate,
    /// The largest violation of the optimality conditions of any replicate, where there are any.
    #[serde(rename = "worst_replicate_kkt")]
    pub worst_replicate: Option<f64>,
    /// Selected coefficients that the rows and priors hardly distinguish.
    pub confounded: Vec<Vec<String>>,
    /// Condition number of the selected columns.
    pub condition: f64,
    /// The fits without each episode, on request.
    pub influence: Option<LeaveOneOutReport>,
    /// The part of the report that all methods share.
    #[serde(flatten)]
    pub summary: FitSummary,
}

/// A task and its errors.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct TaskReport {
    /// Its name.
    pub name: String,
    /// True for a prior.
    pub prior: bool,
    /// The error that counts as one, in the target's units.
    pub scale: f64,
    /// Weight of its squared errors.
    pub weight: f64,
    /// Root mean squared error on the rows of the fit.
    pub rms: f64,
    /// Share of the target's variance that is explained on these rows; NaN for a target that does not vary.
    pub r2: f64,
    /// Root mean squared error on held-out rows of the selected columns, refitted on every fold's training rows; NaN without folds, and for priors.
    #[serde(rename = "held_out_rms")]
    pub held_out: f64,
    /// `rms` and `held_out` of least squares on the same columns without the limits, where there are any: their price.
    #[serde(flatten)]
    pub free: Option<FreeErrors>,
}

/// Fit without limits: coefficients, and mean squared held-out errors of the measured tasks.
pub(super) struct Price {
    pub(super) free: Vec<f64>,
    pub(super) held_out: Option<Vec<f64>>,
}

/// A latent and its candidates.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct LatentReport {
    /// Its name.
    pub name: String,
    /// Its candidates, in order.
    #[serde(rename = "functions")]
    pub candidates: Vec<CandidateReport>,
}

/// A candidate function.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct CandidateReport {
    /// The function.
    pub function: String,
    /// Its coefficient; 0 when it was not selected.
    pub coefficient: f64,
    /// True if it was selected.
    pub selected: bool,
    /// The coefficient of the lasso at lambda.
    pub lasso: f64,
    /// Standard error of the coefficient, given the selection; NaN if it was not selected or the error is not known.
    pub standard_error: f64,
    /// Share of the replicates that select it, where there are replicates.
    pub frequency: Option<f64>,
    /// Percentile 95 % interval of the lasso's coefficient over the replicates that select it, when it was selected and at least two do.
    #[serde(rename = "lasso_interval")]
    pub interval: Option<[f64; 2]>,
}

impl SparseReport {
    pub(super) fn new(
        problem: &Problem<'_>,
        lambda: LambdaChoice,
        support: &Support,
        (theta, errors): (&[f64], Option<&[f64]>),
    ) -> Result<Self, Error> {
        let (confounded, condition) = named(problem, &support.columns)?;
        Ok(Self {
            rows: problem.rows(),
            path: PathReport::of(problem, lambda.value, support.columns.len())?,
            selection: support.how.clone(),
            tasks: Vec::new(),
            limits: Vec::new(),
            latents: latents(problem, support, theta, errors)?,
            lambda,
            penalty: problem.estimator.name(),
            certificate: support.lasso.certificate,
            worst_replicate: support.replicates.as_ref().map(|replicates| replicates.worst_kkt),
            confounded,
            condition,
            influence: None,
            summary: FitSummary::default(),
        })
    }
}

/// Confounded columns, by name; and the condition number of all.
pub(super) fn named(problem: &Problem<'_>, columns: &[usize]) -> Result<(Vec<Vec<String>>, f64), Error> {
    let pairs = confounded(&problem.assembled, columns, CONFOUNDED)?;
    let groups = pairs.groups.iter().map(|group| group.iter().map(|&j| problem.name(j)).collect());
    Ok((groups.collect(), pairs.condition))
}

/// Errors of coefficients by task; mean squared errors on held-out rows are those of the measured tasks.
pub(super) fn tasks(
    problem: &Problem<'_>,
    theta: &[f64],
    held_out: Option<&[f64]>,
    price: Option<&Price>,
) -> Vec<TaskReport> {
    let held_out = held_out_of(problem, held_out);
    let errors = problem.structure.errors(&problem.roots, theta);
    let free = price.map(|price| {
        let errors = problem.structure.errors(&problem.roots, &price.free);
        (errors, held_out_of(problem, price.held_out.as_deref()))
    });
    let free = |at: usize| {
        free.as_ref().map(|(errors, held_out)| FreeErrors { rms: errors[at].rms(), held_out: held_out[at] })
    };
    let tasks = problem.task.regression.tasks.iter().enumerate();
    tasks
        .map(|(index, task)| TaskReport {
            name: task.name.clone(),
            prior: task.prior,
            scale: problem.scales[index],
            weight: problem.assembly.weights[index],
            rms: errors[index].rms(),
            r2: errors[index].r2(),
            held_out: held_out[index],
            free: free(index),
        })
        .collect()
}

/// Root mean squared errors by task, NaN where there are none.
fn held_out_of(problem: &Problem<'_>, measured: Option<&[f64]>) -> Vec<f64> {
    let mut measured = measured.unwrap_or_default().iter();
    let tasks = problem.task.regression.tasks.iter();
    tasks.map(|task| if task.prior { None } else { measured.next() }.map_or(f64::NAN, |square| square.sqrt())).collect()
}

fn latents(
    problem: &Problem<'_>,
    support: &Support,
    theta: &[f64],
    errors: Option<&[f64]>,
) -> Result<Vec<LatentReport>, Error> {
    let lasso = problem.assembled.coefficients(&support.lasso);
    let intervals = match &support.replicates {
        Some(replicates) => percentile_intervals(replicates, &support.columns, &lasso)?,
        None => Vec::new(),
    };
    let place = |j: usize| support.columns.binary_search(&j).ok();
    let candidate = |j: usize, function: &fleetfoot_library::Expr| CandidateReport {
        function: function.to_string(),
        coefficient: theta[j],
        selected: place(j).is_some(),
        lasso: lasso[j],
        standard_error: errors.map_or(f64::NAN, |errors| errors[j]),
        frequency: support.frequency.as_ref().map(|frequency| frequency[j]),
        interval: place(j).and_then(|place| intervals.get(place).copied().flatten()),
    };
    let regression = &problem.task.regression;
    let latents = regression
        .latents
        .iter()
        .enumerate()
        .map(|(index, latent)| LatentReport {
            name: latent.name.clone(),
            candidates: latent
                .functions
                .iter()
                .enumerate()
                .map(|(at, function)| candidate(regression.first(index) + at, function))
                .collect(),
        })
        .collect();
    Ok(latents)
}
