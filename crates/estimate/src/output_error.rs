//! Output error: maximum likelihood of the parameters of given equations, where the measurements are noisy and the dynamics are not.
//!
//! The model is x' = f(x, u, theta) with outputs y_k = x_k + v_k, the noise v independent from row to row and normal, of variance sigma_j^2 in output j. With the
//! state at the beginning of every segment c unknown too, the negative logarithm of the likelihood is, up to a constant,
//!
//! ```text
//! sum_j n_j log sigma_j + 1/2 sum_j sum_c sum_k (y_jck - x_jk(theta, x_c0))^2 / sigma_j^2
//! ```
//!
//! (Maine and Iliff 1985; Klein and Morelli 2006, chapter 6). For given sigma that is least squares, and for given errors sigma_j^2 is their mean square: the two
//! are taken in turn until both stay. The beginnings are eliminated (Golub and Pereyra 1973): for every theta each segment finds its own best one, by the same
//! Levenberg-Marquardt, and what is left of the derivatives is their part that no beginning can take up. So the unknowns of the outer problem are the parameters, however many
//! segments there are, and memory is that of the segments in flight.
//!
//! Errors of the model are errors in the residuals that last for many rows. The covariance is that of least squares under such residuals, with the autocorrelation that
//! they show (Morelli and Klein 1997): [`coloured`].

mod beginning;
mod coloured;
mod segments;

use faer::Mat;
use fleetfoot_data::{Progress, Source};
use fleetfoot_dynamics::{Coefficient, ShootingOptions, Stretch, Stretches};
use fleetfoot_model::{Latent, Model, Partition, Region};
use fleetfoot_stats::{kernel::norm, student_t_95};

use crate::{
    EstimateError, Options, Parameter, Status,
    covariance::Inverse,
    descent::Descent,
    evaluate::{Objective, Pass},
    problem::check_parameters,
};
use segments::Segments;

/// How parameters are estimated by output error.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct OutputErrorOptions {
    /// How segments are simulated; the steps do not count.
    pub shooting: ShootingOptions,
    /// Rows of a segment at most; `None`: whole episodes.
    pub rows: Option<usize>,
    /// The states that are compared with what was measured; all where none is named.
    pub outputs: Vec<String>,
    /// Where else the search may begin, beside the initial values: it begins where the cost is least.
    pub starts: Vec<Vec<f64>>,
    /// When a minimisation for given noise ends.
    pub descent: Options,
}

impl Default for OutputErrorOptions {
    /// Whole episodes, all states, Runge-Kutta steps of the episode's median period; divergence at 1,000 standard deviations.
    fn default() -> Self {
        let mut shooting = ShootingOptions::new(1);
        shooting.divergence = 1e3;
        let descent = Options { gradient: 1e-12, step: 1e-13, cost: 1e-14, max_iterations: 100, ..Options::default() };
        Self { shooting, rows: None, outputs: Vec::new(), starts: Vec::new(), descent }
    }
}

/// Where a segment begins under the model.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Begun {
    /// The segment.
    pub stretch: Stretch,
    /// Its states at the first row.
    pub states: Vec<f64>,
}

/// Parameters by output error.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct OutputError {
    /// Names of the parameters (p).
    pub names: Vec<String>,
    /// Their values (p).
    pub values: Vec<f64>,
    /// Covariance of the parameters (p x p) for residuals as correlated as they are. Zero where a parameter is fixed or at a bound; without meaning for those that are
    /// undetermined.
    pub covariance: Mat<f64>,
    /// Covariance for residuals that are independent from row to row: what is right only where the model is.
    pub white: Mat<f64>,
    /// Rows over which residuals are correlated, as it was found; 0 where they look white.
    pub memory: usize,
    /// The states that were compared.
    pub outputs: Vec<String>,
    /// Standard deviation of the noise of each output, in its own unit.
    pub deviations: Vec<f64>,
    /// All states, in the order of [`Begun::states`].
    pub states: Vec<String>,
    /// Where the segments begin.
    pub beginnings: Vec<Begun>,
    /// Segments left out because a value that they need is missing.
    pub missing: usize,
    /// Numbers that were compared.
    pub residuals: u64,
    /// Condition of the Jacobian, its columns scaled to unit length.
    pub condition: f64,
    /// Parameters that the rows do not determine.
    pub undetermined: Vec<usize>,
    /// Parameters at a bound that pushes back.
    pub at_bounds: Vec<usize>,
    /// The certificate: the largest cosine of the angle between the residual and a column of the reduced Jacobian.
    pub gradient: f64,
    /// Why the last minimisation ended; [`Status::Iterations`] also where noise and parameters did not come to rest.
    pub status: Status,
    /// Minimisations, each for given noise.
    pub rounds: usize,
    /// Passes over the rows.
    pub passes: usize,
}

impl OutputError {
    /// Standard errors of the parameters (p): the larger of the two covariances', infinite where undetermined.
    pub fn standard_errors(&self) -> Vec<f64> {
        let of = |j: usize| match self.undetermined.contains(&j) {
            true => f64::INFINITY,
            false => self.covariance[(j, j)].max(self.white[(j, j)]).sqrt(),
        };
        (0..self.values.len()).map(of).collect()
    }

    /// Half the width of the 95 % interval of every parameter (p).
    pub fn half_widths(&self) -> Vec<f64> {
        let unknowns = self.values.len() + self.beginnings.len() * self.states.len();
        let factor = student_t_95((self.residuals as usize).saturating_sub(unknowns));
        self.standard_errors().iter().map(|error| factor * error).collect()
    }

    /// Pairs of parameters whose correlation exceeds `level` in absolute value, with it.
    pub fn confounded(&self, level: f64) -> Vec<(usize, usize, f64)> {
        let p = self.values.len();
        let of =
            |a: usize, b: usize| self.covariance[(a, b)] / (self.covariance[(a, a)] * self.covariance[(b, b)]).sqrt();
        let pairs = (0..p).flat_map(|a| (a + 1..p).map(move |b| (a, b, of(a, b))));
        pairs.filter(|pair| pair.2.abs() > level).collect()
    }
}

/// Rounds of the alternation, at most.
const ROUNDS: usize = 50;
/// Relative change of the deviations at which it ends.
const SAME: f64 = 1e-10;
/// Relative change of the deviations above which minima are not looked for to the last digits.
const ROUGH: f64 = 1e-3;
/// Least deviation of noise, as a share of the deviation of what is measured: less is rounding.
const LEAST: f64 = 1e-9;

/// Estimates the parameters of a model whose equations speak of them by name, as of columns; what it has beside equations is left as it is. The columns of the source are
/// the model's.
///
/// The same bits on any number of threads.
///
/// # Errors
/// Names that clash, a parameter that no equation uses, initial values beyond bounds or at which a simulation diverges, an output that is no state, segments that all
/// miss values, fewer residuals than unknowns, and those of reading.
pub fn output_error(
    model: &Model,
    parameters: &[Parameter],
    source: &dyn Source,
    options: &OutputErrorOptions,
    progress: &dyn Progress,
) -> Result<OutputError, EstimateError> {
    options.descent.check()?;
    check_parameters(parameters, source)?;
    check_use(model, parameters)?;
    let model = with_parameters(model, parameters);
    let mut segments = Segments::new(&model, parameters, source, options, progress)?;
    progress.stage("output error");
    let mut theta = best_start(&segments, parameters, &options.starts)?;
    let mut rounds = 0;
    loop {
        rounds += 1;
        segments.forget();
        let end = if segments.exact {
            options.descent
        } else {
            Options { gradient: 1e-4, step: 1e-6, cost: 1e-6, ..options.descent }
        };
        let mut descent = Descent::new(&segments, theta, &end)?;
        let (status, _) = descent.run()?;
        let deviations = segments.deviations_of(&descent.at.shares);
        let change = |(old, new): (&f64, &f64)| (new / old - 1.0).abs();
        let change = segments.deviations.iter().zip(&deviations).map(change).fold(0.0, f64::max);
        let settled = segments.exact && change < SAME;
        if settled || rounds == ROUNDS {
            let status = if settled { status } else { Status::Iterations };
            return found(&segments, &descent, status, rounds);
        }
        theta = descent.theta;
        segments.deviations = deviations;
        segments.exact |= change < ROUGH;
    }
}

/// Of the initial values and the other starts, between the bounds, the one of least cost.
fn best_start(
    segments: &Segments<'_>,
    parameters: &[Parameter],
    starts: &[Vec<f64>],
) -> Result<Vec<f64>, EstimateError> {
    let mut best: (f64, Vec<f64>) = (f64::INFINITY, parameters.iter().map(|parameter| parameter.initial).collect());
    for start in starts.iter().cloned().chain(if starts.is_empty() { None } else { Some(best.1.clone()) }) {
        let within = |(value, own): (&f64, &Parameter)| value.clamp(own.bounds[0], own.bounds[1]);
        let start: Vec<f64> = start.iter().zip(parameters).map(within).collect();
        match segments.evaluate(&start)? {
            Pass::Finite(at) if at.cost < best.0 => best = (at.cost, start),
            _ => {}
        }
    }
    Ok(best.1)
}

/// What is known where a descent ended.
fn found(
    segments: &Segments<'_>,
    descent: &Descent<'_>,
    status: Status,
    rounds: usize,
) -> Result<OutputError, EstimateError> {
    let room = descent.room();
    let bounds = segments.bounds();
    let free: Vec<usize> = (0..room.len()).filter(|&j| room[j][0] < room[j][1]).collect();
    let lengths = (0..room.len()).map(|j| norm(descent.at.jacobian.col_as_slice(j).iter().copied()));
    let lengths: Vec<f64> = lengths.map(|length| if length > 0.0 { length } else { 1.0 }).collect();
    let inverse = Inverse::new(&descent.at, &lengths, &free)?;
    let last = segments.last(&descent.theta)?;
    let (residuals, states) = (descent.at.rows, segments.states().len());
    let unknowns = (free.len() + last.beginnings.len() * states) as f64;
    // The deviations are of maximum likelihood: the residuals' mean square, not less what the unknowns took up.
    let variance = residuals as f64 / (residuals as f64 - unknowns).max(1.0);
    let (middle, memory) = coloured::middle(&last.series, free.len().max(1));
    Ok(OutputError {
        names: segments.names(),
        values: descent.theta.clone(),
        covariance: inverse.sandwich(&middle, variance),
        white: inverse.covariance(variance),
        memory,
        outputs: segments.outputs(),
        deviations: segments.deviations.clone(),
        states: segments.states().to_vec(),
        missing: segments.missing(),
        residuals,
        condition: inverse.condition,
        at_bounds: (0..room.len()).filter(|j| !free.contains(j) && bounds[*j][0] < bounds[*j][1]).collect(),
        gradient: descent.gradient(&descent.at, &room),
        undetermined: inverse.undetermined,
        status,
        rounds,
        passes: segments.passes(),
        beginnings: last.beginnings,
    })
}

/// The first parameter that no equation speaks of is refused.
fn check_use(model: &Model, parameters: &[Parameter]) -> Result<(), EstimateError> {
    let used = |name: &str| model.equations.iter().any(|e| e.right.columns().iter().any(|column| **column == *name));
    match parameters.iter().find(|parameter| !used(&parameter.name)) {
        Some(parameter) => Err(EstimateError::Unused { name: parameter.name.clone() }),
        None => Ok(()),
    }
}

/// The model with every parameter as a latent function that is a constant: what it is differentiated by are its coefficients.
fn with_parameters(model: &Model, parameters: &[Parameter]) -> Model {
    let mut model = model.clone();
    let fitted = model.fitted().count();
    model.libraries.push(Vec::new());
    let region = Region {
        name: "all".into(),
        rows: 0,
        mean: Vec::new(),
        covariance: Vec::new(),
        range: Vec::new(),
        residual_covariance: vec![f64::NAN; fitted * (fitted + 1) / 2],
        rank: 0,
        condition: 1.0,
        confounded: Vec::new(),
    };
    model.partitions.push(Partition { regions: vec![region], ..Partition::whole() });
    let (library, partition) = (model.libraries.len() - 1, model.partitions.len() - 1);
    model.latents.extend(parameters.iter().map(|parameter| Latent {
        name: parameter.name.clone(),
        library,
        partition,
        constants: vec![parameter.initial],
        coefficients: vec![Vec::new()],
    }));
    model
}

/// The parameters among the coefficients of a model from [`with_parameters`].
fn coefficients(model: &Model, count: usize) -> Vec<Coefficient> {
    let first = model.latents.len() - count;
    (first..model.latents.len()).map(|latent| Coefficient { region: 0, latent, function: None }).collect()
}

/// The model at these parameters, for simulation.
fn stretches<'a>(
    model: &Model,
    theta: &[f64],
    source: &'a dyn Source,
    shooting: &ShootingOptions,
) -> Result<Stretches<'a>, EstimateError> {
    let coefficients = coefficients(model, theta.len());
    let mut model = model.clone();
    coefficients.iter().zip(theta).for_each(|(coefficient, &value)| coefficient.set(&mut model, value));
    Ok(Stretches::new(&model, source, &coefficients, shooting)?)
}
