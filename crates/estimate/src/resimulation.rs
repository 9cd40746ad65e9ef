//! Resimulation: states and inputs that obey a model and stay nearest to the recording (equation (43) of the
//! block-sparse bolasso paper).
//!
//! With y and v the recorded states and inputs at the rows t_k of a grid, and deviations sigma of each column, it is
//!
//! ```text
//! minimise    1/2 sum_k w_k ( sum_j (x_jk - y_jk)^2 / sigma_j^2 + sum_i (u_ik - v_ik)^2 / sigma_i^2 )
//! such that   zeta_k(x_k, u_k, x_k+1, u_k+1) = 0,    low <= (x_k, u_k) <= high
//! ```
//!
//! with w_k the weights of the trapezoid rule over the mean step, 0 without a recorded value. For equations of
//! derivatives the constraints zeta are those of Hermite and Simpson (Hargraves and Paris 1987; order 4 in the step,
//! inputs linear in between). For equations that give the next row, zeta is that row itself: `transcription.rs`. The
//! problem is solved by sequential convex programs within a region of trust ([`descent`]), from the recording itself,
//! with exact derivatives of the compiled model.
//!
//! The default deviations are the noise of the recording beside the model: [`noise`].

mod descent;
mod noise;
mod program;

use fleetfoot_data::setting::EVERY;
use fleetfoot_data::{Progress, Source, ensure_memory, parallel_map};
use fleetfoot_model::{Model, Prediction, Role};

use crate::{
    EstimateError,
    reader::Reader,
    recorded::{Recorded, Survey},
    transcription::Transcription,
};
use descent::{Followed, follow};

/// Options of recordings that a model follows.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ResimulationOptions {
    /// Every so many rows of the log are rows of the grid.
    pub every: usize,
    /// Inputs that may move; empty for all of the model's inputs. Other columns that the model reads are replayed from
    /// the recording.
    pub free: Vec<String>,
    /// Deviations by column, where they are not to be those that the recording shows.
    pub deviations: Vec<(String, f64)>,
    /// Bounds by column, where they are not to be the recorded range, widened.
    pub bounds: Vec<(String, [f64; 2])>,
    /// The share of the recorded range by which it is widened on both sides.
    pub widen: f64,
    /// Convex programs that an episode may take.
    pub iterations: usize,
    /// Bytes that an episode's programs may take.
    pub memory: f64,
}

impl Default for ResimulationOptions {
    /// Every row, all inputs, deviations and bounds from the recording (its range widened by a quarter), 50 programs, 1 GiB an episode.
    fn default() -> Self {
        let (free, deviations, bounds) = (Vec::new(), Vec::new(), Vec::new());
        Self { every: 1, free, deviations, bounds, widen: 0.25, iterations: 50, memory: f64::from(1 << 30) }
    }
}

/// End of the programs of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Ending {
    /// The conditions of a minimum hold: defects to 1e-10 of a spread, stationarity to 1e-8.
    Minimum,
    /// No step was better: the certificate gives the distance from a minimum.
    Stalled,
    /// As many programs as are allowed.
    Iterations,
}

/// Distance of a solution from a minimum: each number is 0 at one.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Certificate {
    /// The largest defect zeta of the dynamics, in units of its state's spread in the recordings.
    pub dynamics: f64,
    /// The largest distance outside of the bounds, in the same units of its column.
    pub bounds: f64,
    /// Stationarity. It is the largest component of the Lagrangian's gradient over the largest of the parts that its
    /// column has in it (the objective's, and the constraints'). If less, it is the way to the bound that the column
    /// pushes against, in spreads. The columns are counted in their deviations; parts below 1e-4 count as that.
    pub stationarity: f64,
}

/// A recording followed by the model.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Resimulated {
    /// Index of the episode.
    pub episode: usize,
    /// The rows of the episode that are those of the grid (r).
    pub rows: Vec<usize>,
    /// Their stamps, nanoseconds (r).
    pub stamps: Vec<i64>,
    /// Recorded values (r x columns); NaN without a value.
    pub recorded: Vec<f64>,
    /// Values that follow them under the model (r x columns).
    pub followed: Vec<f64>,
    /// The states of a simulation from the recorded beginning with the recorded inputs (r x states); NaN behind where it diverged.
    pub open_loop: Vec<f64>,
    /// Distance of the solution from a minimum.
    pub certificate: Certificate,
    /// End of the programs.
    pub ending: Ending,
    /// Convex programs.
    pub programs: usize,
}

/// Recordings followed by a model.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Resimulation {
    /// The columns that are followed: states in the model's order, then the inputs that may move.
    pub columns: Vec<String>,
    /// Number of states among them.
    pub states: usize,
    /// Columns replayed from the recording.
    pub replayed: Vec<String>,
    /// Deviation of each column.
    pub deviations: Vec<f64>,
    /// Bounds of each column.
    pub bounds: Vec<[f64; 2]>,
    /// Spread of each column in the recordings: the unit of the certificate.
    pub spreads: Vec<f64>,
    /// True if derivatives are integrated, by Hermite and Simpson's rule of order 4; else equations give the next row.
    pub continuous: bool,
    /// The episodes.
    pub episodes: Vec<Resimulated>,
    /// Episodes left out: a column that is needed has no value, or there are fewer than two rows of the grid.
    pub missing: Vec<usize>,
    /// Episodes left out: the model has no finite value along them.
    pub undefined: Vec<usize>,
}

impl Resimulation {
    /// Root mean square of followed less recorded of an episode, by column; NaN for a column without values.
    pub fn deviations_of(&self, episode: &Resimulated) -> Vec<f64> {
        let width = self.columns.len();
        (0..width)
            .map(|j| {
                rms((0..episode.rows.len()).map(|k| episode.followed[k * width + j] - episode.recorded[k * width + j]))
            })
            .collect()
    }

    /// The same of the open loop, by state; infinite where it diverged.
    pub fn open_loop_deviations(&self, episode: &Resimulated) -> Vec<f64> {
        let (width, rows) = (self.columns.len(), episode.rows.len());
        let of = |j: usize| {
            let ended = episode.open_loop[(rows - 1) * self.states + j].is_nan();
            let errors = (0..rows).map(|k| episode.open_loop[k * self.states + j] - episode.recorded[k * width + j]);
            if ended { f64::INFINITY } else { rms(errors) }
        };
        (0..self.states).map(of).collect()
    }
}

/// Root mean square of the finite errors.
fn rms(errors: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = errors.filter(|e| e.is_finite()).fold((0.0, 0.0), |(sum, count), e| (sum + e * e, count + 1.0));
    (sum / count).sqrt()
}

/// Follows every episode of a source whose columns are the model's.
///
/// The same bits on any number of threads.
///
/// # Errors
/// A model with lags, or of derivatives and next values together; a column that is neither a state nor an input; an
/// option out of range. An episode that does not fit into memory; no episode that can be followed; those of reading.
pub fn resimulate(
    model: &Model,
    source: &dyn Source,
    options: &ResimulationOptions,
    progress: &dyn Progress,
) -> Result<Resimulation, EstimateError> {
    check(options)?;
    let continuous = kind(model)?;
    if !continuous && options.every > 1 {
        let allowed = "it must be 1, as the equations of the model give the next row";
        return Err(EstimateError::Option { option: "every", value: options.every as f64, allowed });
    }
    let transcription = Transcription::new(model, continuous, &free(model, &options.free)?)?;
    let reader = Reader::new(model, &transcription, source, options.every)?;
    check_memory(&reader, source, options)?;
    progress.stage("survey");
    let episodes = source.episodes().len();
    let surveys = parallel_map(episodes, progress, |at| {
        Ok::<_, EstimateError>(reader.read(at)?.map(|recorded| recorded.survey()))
    })?;
    let missing: Vec<usize> = (0..episodes).filter(|&at| surveys[at].is_none()).collect();
    let usable: Vec<usize> = (0..episodes).filter(|&at| surveys[at].is_some()).collect();
    if usable.is_empty() {
        return Err(EstimateError::NothingToFollow { episodes, columns: transcription.names().join(", ") });
    }
    let survey = Survey::pooled(surveys.into_iter().flatten());
    let bounds = bounds(&transcription, &survey, options)?;
    progress.stage("noise");
    let deviations = deviations(&transcription, &reader, &usable, &survey, options, progress)?;
    let scale = Scale { spreads: survey.spreads(), deviations, bounds };
    progress.stage("resimulate");
    let results = parallel_map(usable.len(), progress, |at| -> Result<Option<Resimulated>, EstimateError> {
        let Some(recorded) = reader.read(usable[at])? else { return Ok(None) };
        let Some(followed) = follow(&transcription, &recorded, &scale, options.iterations)? else { return Ok(None) };
        Ok(Some(resimulated(&transcription, recorded, followed)?))
    })?;
    let undefined: Vec<usize> =
        usable.iter().zip(&results).filter(|(_, result)| result.is_none()).map(|(&at, _)| at).collect();
    if undefined.len() == results.len() {
        return Err(EstimateError::NotFollowable { episode: source.episodes()[undefined[0]].name.clone() });
    }
    Ok(Resimulation {
        columns: transcription.names().to_vec(),
        states: transcription.states(),
        replayed: transcription.replayed().to_vec(),
        deviations: scale.deviations,
        bounds: scale.bounds,
        spreads: scale.spreads,
        continuous,
        episodes: results.into_iter().flatten().collect(),
        missing,
        undefined,
    })
}

/// Units of the columns.
pub(crate) struct Scale {
    /// Spread in the recordings.
    pub(crate) spreads: Vec<f64>,
    /// Deviation of each column.
    pub(crate) deviations: Vec<f64>,
    pub(crate) bounds: Vec<[f64; 2]>,
}

fn check(options: &ResimulationOptions) -> Result<(), EstimateError> {
    let refuse = |option, value, allowed| Err(EstimateError::Option { option, value, allowed });
    match options {
        _ if options.every == 0 => refuse("every", 0.0, "it must be 1 or more (1: every row)"),
        _ if options.iterations == 0 => refuse("iterations", 0.0, "it must be 1 or more"),
        _ if !(options.widen >= 0.0 && options.widen.is_finite()) => {
            refuse("widen", options.widen, "it must be a finite share of the recorded range, 0 or more")
        }
        _ => Ok(()),
    }
}

/// Returns true if the equations are derivatives.
fn kind(model: &Model) -> Result<bool, EstimateError> {
    let advances = |of: fn(Prediction) -> bool| {
        model.equations.iter().find(|equation| of(equation.prediction)).map(|equation| equation.subject.clone())
    };
    let derivative = advances(|prediction| prediction == Prediction::Derivative);
    let next = advances(|prediction| !matches!(prediction, Prediction::Derivative | Prediction::Value));
    match (derivative, next) {
        (Some(derivative), Some(next)) => Err(EstimateError::MixedSteps { derivative, next }),
        (derivative, _) => Ok(derivative.is_some()),
    }
}

/// The inputs that may move.
fn free(model: &Model, named: &[String]) -> Result<Vec<String>, EstimateError> {
    let inputs: Vec<String> = model.columns.iter().filter(|c| c.role == Role::Input).map(|c| c.name.clone()).collect();
    if named.is_empty() { Ok(inputs) } else { Ok(named.to_vec()) }
}

/// Bytes of a row of the grid in a convex program, by its columns. They are those of the matrices, their factor and its
/// permutation, of which the blocks of neighbouring rows fill theirs.
fn bytes_of_row(states: usize, columns: usize) -> f64 {
    let block = (states + columns) as f64;
    120.0 * block * block + 1_500.0 * columns as f64
}

fn check_memory(reader: &Reader<'_>, source: &dyn Source, options: &ResimulationOptions) -> Result<(), EstimateError> {
    let [states, columns] = reader.shape();
    let most = (options.memory / bytes_of_row(states, columns)) as usize;
    match source.episodes().iter().find(|episode| episode.rows / options.every > most) {
        Some(episode) => {
            let every = episode.rows.div_ceil(most.max(1));
            Err(EstimateError::TooLong {
                episode: episode.name.clone(),
                rows: episode.rows / options.every,
                most,
                every,
            })
        }
        None => {
            let rows = source.episodes().iter().map(|episode| episode.rows / options.every).max().unwrap_or(0);
            ensure_memory(
                (rows as f64 * bytes_of_row(states, columns)) as usize,
                &format!("an episode of {rows} rows on the grid"),
                &format!("follow fewer rows ({EVERY}), or split the log"),
            )?;
            Ok(())
        }
    }
}

/// The bounds of every column.
fn bounds(
    transcription: &Transcription,
    survey: &Survey,
    options: &ResimulationOptions,
) -> Result<Vec<[f64; 2]>, EstimateError> {
    let mut bounds = survey.ranges(options.widen);
    // A turn is no border.
    (0..bounds.len())
        .filter(|&j| transcription.goes_round(j))
        .for_each(|j| bounds[j] = [f64::NEG_INFINITY, f64::INFINITY]);
    for (name, interval) in &options.bounds {
        let [low, high] = *interval;
        if low >= high || low.is_nan() || high.is_nan() {
            return Err(EstimateError::Bounds { name: name.clone(), low, high });
        }
        bounds[transcription.place(name)?] = *interval;
    }
    Ok(bounds)
}

/// Episodes from which the noise is estimated, at most.
const NOISE_EPISODES: usize = 8;

/// The deviation of every column.
fn deviations(
    transcription: &Transcription,
    reader: &Reader<'_>,
    usable: &[usize],
    survey: &Survey,
    options: &ResimulationOptions,
    progress: &dyn Progress,
) -> Result<Vec<f64>, EstimateError> {
    let spreads = survey.spreads();
    let mut deviations = vec![f64::NAN; spreads.len()];
    for (name, value) in &options.deviations {
        if !(*value > 0.0 && value.is_finite()) {
            let allowed = "a deviation is positive and finite";
            return Err(EstimateError::Option { option: "a deviation", value: *value, allowed });
        }
        deviations[transcription.place(name)?] = *value;
    }
    if deviations.iter().all(|value| value.is_finite()) {
        return Ok(deviations);
    }
    let count = usable.len().min(NOISE_EPISODES);
    let chosen = |at: usize| usable[(2 * at + 1) * usable.len() / (2 * count)];
    let variances = parallel_map(count, progress, |at| -> Result<Option<Vec<f64>>, EstimateError> {
        Ok(reader.read(chosen(at))?.and_then(|recorded| noise::variances(transcription, &recorded, &spreads)))
    })?;
    let variances: Vec<Vec<f64>> = variances.into_iter().flatten().collect();
    for (j, deviation) in deviations.iter_mut().enumerate().filter(|(_, deviation)| deviation.is_nan()) {
        let variance = variances.iter().map(|row| row[j]).sum::<f64>() / variances.len() as f64;
        // If the model has no value along the recordings, the noise is unknown.
        *deviation = spreads[j] * if variances.is_empty() { 1.0 } else { variance.sqrt() };
    }
    Ok(deviations)
}

fn resimulated(
    transcription: &Transcription,
    record: Recorded,
    followed: Followed,
) -> Result<Resimulated, EstimateError> {
    let open_loop = transcription.open_loop(&record)?;
    let mut values = followed.values;
    transcription.normalise(&mut values);
    let recorded = record.values.iter().zip(&record.there).map(|(&value, &there)| if there { value } else { f64::NAN });
    Ok(Resimulated {
        episode: record.episode,
        recorded: recorded.collect(),
        rows: record.rows,
        stamps: record.stamps,
        followed: values,
        open_loop,
        certificate: followed.certificate,
        ending: followed.ending,
        programs: followed.programs,
    })
}
