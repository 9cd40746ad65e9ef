//! Output error: maximum likelihood of the parameters of given equations, where the measurements are noisy and the dynamics are not.
//!
//! The model is x' = f(x, u, theta) with outputs y_k = x_k + v_k. The noise v is independent from row to row and
//! normal, of variance sigma_j^2 in output j. With the state at the beginning of every segment c unknown too, the
//! negative logarithm of the likelihood is, up to a constant,
//!
//! ```text
//! sum_j n_j log sigma_j + 1/2 sum_j sum_c sum_k (y_jck - x_jk(theta, x_c0))^2 / sigma_j^2
//! ```
//!
//! (Maine and Iliff 1985; Klein and Morelli 2006, chapter 6). For given sigma that is least squares, and for given
//! errors sigma_j^2 is their mean square: the two alternate until both stay. The beginnings are eliminated (Golub and
//! Pereyra 1973). For every theta each segment has a best beginning, by the same Levenberg-Marquardt; the reduced
//! derivatives are the part that no beginning can take up. So the unknowns of the outer problem are the parameters,
//! however many segments there are, and memory is that of the segments in flight.
//!
//! [`filter_error`](crate::filter_error()) is the same with simulations that measurements correct on the way; the
//! common code is here.
//!
//! Errors of the model are errors in the residuals that last for many rows. The covariance is that of least squares under such residuals, with the autocorrelation that
//! they show (Morelli and Klein 1997): [`coloured`].

mod beginning;
mod coloured;
mod segments;

use faer::Mat;
use fleetfoot_data::{Progress, Source};
use fleetfoot_dynamics::{Coefficient, ShootingOptions, Stretch, Stretches};
use fleetfoot_model::{AffineMap, Latent, Model, Partition, RegionSummary};
use fleetfoot_stats::{kernel::norm, student_t_95};

use crate::{
    Bounded, EstimateError, Gains, Options, Parameter, Status,
    covariance::Inverse,
    descent::Descent,
    evaluate::{Objective, Pass},
    parameter::check_parameters,
};
use coloured::{Coloured, coloured};
use segments::{Segments, Standing};

/// Options of estimation by output error.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct OutputErrorOptions {
    /// Simulation of the segments; the steps do not count.
    pub shooting: ShootingOptions,
    /// Rows of a segment at most; `None`: whole episodes.
    pub rows: Option<usize>,
    /// The states that are compared with measurements; empty for all.
    pub outputs: Vec<String>,
    /// Further starting points beside the initial values; the search begins at the one of least cost.
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

/// Beginning of a segment under the model.
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
    /// Covariance for residuals that are independent from row to row: correct only if the model is.
    pub white: Mat<f64>,
    /// Rows over which residuals are correlated, as it was found; 0 where they look white.
    pub memory: usize,
    /// True if the memory reaches the longest lag that is tried, a fifth of the longest segment. The correlation may
    /// last longer, and standard errors are then too small.
    pub lasting: bool,
    /// The states that were compared.
    pub outputs: Vec<String>,
    /// Standard deviation of the noise of each output, in its own unit.
    pub deviations: Vec<f64>,
    /// All states, in the order of [`Begun::states`].
    pub states: Vec<String>,
    /// Beginnings of the segments.
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
/// Least deviation of noise, as a share of the deviation of the measurements: less is rounding.
const LEAST: f64 = 1e-9;

/// Estimates the parameters of a model whose equations read them by name, like columns; the rest of the model is left
/// unchanged. The columns of the source are the model's.
///
/// The same bits on any number of threads.
///
/// # Errors
/// Names that clash; a parameter that no equation uses; initial values beyond bounds or at which a simulation diverges.
/// An output that is not among the states; segments that all miss values; fewer residuals than unknowns; and those of
/// reading.
pub fn output_error<'a>(
    model: &Model,
    parameters: impl Into<Bounded<'a>>,
    source: &dyn Source,
    options: &OutputErrorOptions,
    progress: &dyn Progress,
) -> Result<OutputError, EstimateError> {
    progress.stage("output error");
    Ok(minimum(model, &parameters.into(), None, source, options, progress)?.parameters)
}

/// A minimum over the parameters and, behind them, the gains.
pub(crate) struct Minimum {
    pub(crate) parameters: OutputError,
    /// Values of the gains (m), empty by output error, as are the fields below.
    pub(crate) gains: Vec<f64>,
    /// Their variances for residuals as correlated as they are (m).
    pub(crate) variances: Vec<f64>,
    /// And for independent ones (m).
    pub(crate) white: Vec<f64>,
    /// Those at a bound that pushes back.
    pub(crate) gains_at_bounds: Vec<usize>,
    /// Those that the rows do not determine.
    pub(crate) gains_undetermined: Vec<usize>,
    /// Covariance of the residuals of a row, in the outputs' own units (m x m).
    pub(crate) residuals: Mat<f64>,
}

/// The minimum of output error, or with gains that of filter error.
pub(crate) fn minimum(
    model: &Model,
    bounded: &Bounded<'_>,
    gains: Option<&Gains>,
    source: &dyn Source,
    options: &OutputErrorOptions,
    progress: &dyn Progress,
) -> Result<Minimum, EstimateError> {
    options.descent.check()?;
    let parameters = bounded.parameters;
    check_parameters(parameters, source)?;
    check_use(model, parameters)?;
    let model = with_parameters(model, parameters);
    let mut segments = Segments::new(&model, bounded, gains, source, options, progress)?;
    let mut starts = vec![Vec::new()];
    if let Some(gains) = gains {
        starts = gains.starts(segments.outputs().len());
    }
    let (mut best, mut refusal): (Option<Rounds>, _) = (None, None);
    let (begun, mut rounds) = (segments.standing(), 0);
    for gains in &starts {
        segments.stand(begun.clone());
        match near(&mut segments, parameters, gains, options) {
            Ok(rounds_of_start) => {
                rounds += rounds_of_start.rounds;
                if best.as_ref().is_none_or(|best| rounds_of_start.misfit < best.misfit) {
                    best = Some(rounds_of_start);
                }
            }
            Err(error @ EstimateError::Diverges { .. }) => _ = refusal.get_or_insert(error),
            Err(error) => return Err(error),
        }
    }
    match (best, refusal) {
        (Some(best), _) => {
            segments.stand(best.standing);
            to_the_end(&mut segments, best.theta, rounds, options)
        }
        (None, Some(error)) => Err(error),
        (None, None) => unreachable!("at least one search begins"),
    }
}

/// State of minimisations that alternate with estimates of the noise.
struct Rounds {
    theta: Vec<f64>,
    standing: Standing,
    /// `sum_j n_j log sigma_j`, the negative logarithm of the likelihood.
    misfit: f64,
    rounds: usize,
}

/// Minimisations and noise in turn, until the noise hardly changes, from the best start of the parameters with these gains.
fn near(
    segments: &mut Segments<'_>,
    parameters: &[Parameter],
    gains: &[f64],
    options: &OutputErrorOptions,
) -> Result<Rounds, EstimateError> {
    let mut theta = best_start(segments, parameters, gains, &options.starts)?;
    let mut end = Options { gradient: 1e-4, step: 1e-6, cost: 1e-6, ..options.descent };
    let mut rounds = 0;
    loop {
        rounds += 1;
        segments.forget();
        let mut descent = Descent::new(&*segments, theta, &end)?;
        descent.run()?;
        let (deviations, change) = segments.deviations_of(&descent.at.shares);
        let misfit = segments.misfit(&descent.at.shares);
        theta = descent.theta;
        end.search = 0;
        segments.deviations = deviations;
        if change < ROUGH || rounds == ROUNDS {
            return Ok(Rounds { theta, standing: segments.standing(), misfit, rounds });
        }
    }
}

/// Minimisations and noise in turn, to the last digits, until both stay.
fn to_the_end(
    segments: &mut Segments<'_>,
    mut theta: Vec<f64>,
    mut rounds: usize,
    options: &OutputErrorOptions,
) -> Result<Minimum, EstimateError> {
    segments.exact = true;
    let descent_options = Options { search: 0, ..options.descent };
    let most = rounds + ROUNDS;
    loop {
        rounds += 1;
        segments.forget();
        let mut descent = Descent::new(&*segments, theta, &descent_options)?;
        let (status, _) = descent.run()?;
        let (deviations, change) = segments.deviations_of(&descent.at.shares);
        if change < SAME || rounds == most {
            let status = if change < SAME { status } else { Status::Iterations };
            return minimum_of(segments, &descent, status, rounds);
        }
        theta = descent.theta;
        segments.deviations = deviations;
    }
}

/// Of the initial values and the other starts, between the bounds, the one of least cost, with these gains behind it.
fn best_start(
    segments: &Segments<'_>,
    parameters: &[Parameter],
    gains: &[f64],
    starts: &[Vec<f64>],
) -> Result<Vec<f64>, EstimateError> {
    let with_gains = |mut start: Vec<f64>| {
        start.extend(gains);
        start.iter_mut().zip(segments.bounds()).for_each(|(value, [low, high])| *value = value.clamp(*low, *high));
        segments.limits().map_or(start.clone(), |limits| limits.pulled(&start))
    };
    let initial = with_gains(parameters.iter().map(|parameter| parameter.initial).collect());
    let mut best = (f64::INFINITY, initial.clone());
    for start in starts.iter().cloned().map(with_gains).chain(if starts.is_empty() { None } else { Some(initial) }) {
        match segments.evaluate(&start)? {
            Pass::Finite(at) if at.cost < best.0 => best = (at.cost, start),
            _ => {}
        }
    }
    Ok(best.1)
}

/// Result at the end of a descent.
fn minimum_of(
    segments: &Segments<'_>,
    descent: &Descent<'_>,
    status: Status,
    rounds: usize,
) -> Result<Minimum, EstimateError> {
    let room = descent.room();
    let bounds = segments.bounds();
    let free: Vec<usize> = (0..room.len()).filter(|&j| room[j][0] < room[j][1]).collect();
    let lengths = (0..room.len()).map(|j| norm(descent.at.jacobian.col_as_slice(j).iter().copied()));
    let lengths: Vec<f64> = lengths.map(|length| if length > 0.0 { length } else { 1.0 }).collect();
    let inverse = Inverse::new(&descent.at, &lengths, &free, &descent.held(&lengths, &free))?;
    let last = segments.last(&descent.theta)?;
    let (residuals, states) = (descent.at.rows, segments.states().len());
    let unknowns = (free.len() + last.beginnings.len() * states) as f64;
    // The deviations are of maximum likelihood: the residuals' mean square, not less what the unknowns took up.
    let variance = residuals as f64 / (residuals as f64 - unknowns).max(1.0);
    let Coloured { middle, memory, lasting, of_a_row } = coloured(&last.series, free.len().max(1));
    let (covariance, white) = (inverse.sandwich(&middle, variance), inverse.covariance(variance));
    let p = segments.names().len();
    let gains: Vec<usize> = (p..room.len()).collect();
    let block = |whole: &Mat<f64>| Mat::from_fn(p, p, |a, b| whole[(a, b)]);
    let split = |all: Vec<usize>| -> (Vec<usize>, Vec<usize>) {
        let (parameters, gains): (Vec<usize>, Vec<usize>) = all.into_iter().partition(|&j| j < p);
        (parameters, gains.iter().map(|j| j - p).collect())
    };
    let pushed = (0..room.len()).filter(|j| !free.contains(j) && bounds[*j][0] < bounds[*j][1]).collect();
    let ((at_bounds, gains_at_bounds), (undetermined, gains_undetermined)) =
        (split(pushed), split(inverse.undetermined));
    let deviations = &segments.deviations;
    let parameters = OutputError {
        names: segments.names(),
        values: descent.theta[..p].to_vec(),
        covariance: block(&covariance),
        white: block(&white),
        memory,
        lasting,
        outputs: segments.outputs(),
        deviations: segments.deviations.clone(),
        states: segments.states().to_vec(),
        missing: segments.missing(),
        residuals,
        condition: inverse.condition,
        at_bounds,
        gradient: descent.gradient(&descent.at, &room),
        undetermined,
        status,
        rounds,
        passes: segments.passes(),
        beginnings: last.beginnings,
    };
    Ok(Minimum {
        parameters,
        gains: gains.iter().map(|&j| descent.theta[j]).collect(),
        variances: gains.iter().map(|&j| covariance[(j, j)]).collect(),
        white: gains.iter().map(|&j| white[(j, j)]).collect(),
        gains_at_bounds,
        gains_undetermined,
        residuals: Mat::from_fn(deviations.len(), deviations.len(), |a, b| {
            deviations[a] * deviations[b] * of_a_row[(a, b)]
        }),
    })
}

/// Refuses parameters that no equation reads.
fn check_use(model: &Model, parameters: &[Parameter]) -> Result<(), EstimateError> {
    let used = |name: &str| model.equations.iter().any(|e| e.right.columns().iter().any(|column| **column == *name));
    match parameters.iter().find(|parameter| !used(&parameter.name)) {
        Some(parameter) => Err(EstimateError::Unused { name: parameter.name.clone() }),
        None => Ok(()),
    }
}

/// The model with every parameter as a constant latent function, whose coefficient is differentiated by.
fn with_parameters(model: &Model, parameters: &[Parameter]) -> Model {
    let mut model = model.clone();
    let fitted = model.fitted().count();
    model.libraries.push(Vec::new());
    let region = RegionSummary {
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
    let partition = model.add_partition(Partition::whole(), vec![region]);
    let library = model.libraries.len() - 1;
    model.latents.extend(parameters.iter().map(|parameter| Latent {
        beyond: Vec::new(),
        name: parameter.name.clone(),
        library,
        partition,
        map: AffineMap { constants: vec![parameter.initial], coefficients: vec![Vec::new()] }.into(),
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
