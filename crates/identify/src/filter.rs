//! Recordings filtered by a model: `filter`.

mod asked;
mod row;

use std::path::Path;

use fleetfoot_data::{Halo, Progress, Source, parallel_fold};
use fleetfoot_dynamics::filter::{Consistency, SwitchedFilter};
use fleetfoot_model::Model;
use serde::Serialize;

use crate::{Error, FilterSwitching, Logs, Recipe, output};

pub use asked::filter_of;
use asked::{Asked, Reading};
pub use row::FilteredRows;

/// What filtering logs gave.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Filtered {
    /// Rows of all episodes.
    pub rows: u64,
    /// Episodes.
    pub episodes: usize,
    /// The states.
    pub states: Vec<String>,
    /// The regions.
    pub regions: usize,
    /// How they follow one another.
    pub switching: FilterSwitching,
    /// Factor on the process noise; of one that was found the mean of the episodes' last ones.
    pub process: f64,
    /// Whether every step is the exact one of an affine region; else regions are made linear about the present mean.
    pub exact: bool,
    /// The sensors.
    pub sensors: Vec<SensorReport>,
    /// The logarithm of the probability density of all measurements.
    pub log_likelihood: f64,
    /// Normalised innovations squared of the rows that all sensors measured, by their number.
    pub nis: Option<SquareReport>,
    /// Normalised estimation errors squared, by the number of states whose truth is known.
    pub nees: Option<SquareReport>,
    /// Errors of the states whose truth is known.
    pub truth: Vec<TruthReport>,
    /// Steps whose inputs were missing, and held.
    pub held_inputs: u64,
    /// Names of the episodes that the model was trained on.
    pub in_sample_episodes: Vec<String>,
    /// What was assumed or left out.
    pub notes: Vec<String>,
}

/// A sensor and its innovations.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct SensorReport {
    /// The state that it measures.
    pub state: String,
    /// Its standard deviation; of one that was found or told row by row the mean of the episodes' last ones.
    pub deviation: f64,
    /// Where that is from.
    pub deviation_from: DeviationFrom,
    /// Innovations.
    pub rows: u64,
    /// The share of squared innovations that are in the 95 % band of a normal distribution of their variance.
    pub share: f64,
    /// The correlation of normalised innovations with those of the row before: none, where they are white.
    pub correlation: f64,
    /// How large that is, with 95 % probability, where they are.
    pub white: f64,
}

/// Where a sensor's deviation is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DeviationFrom {
    /// It was given.
    Given,
    /// A column of the log.
    Column,
    /// The innovations so far.
    Innovations,
}

/// Normalised squares: 1 on the mean where a filter is consistent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct SquareReport {
    /// Rows.
    pub rows: u64,
    /// Degrees of freedom of a row.
    pub freedom: usize,
    /// The mean, by them.
    pub mean: f64,
    /// Where 95 % of the means of consistent filters lie.
    pub low: f64,
    /// See `low`.
    pub high: f64,
    /// The share of rows in the 95 % band of a single row.
    pub share: f64,
}

/// Errors of a state.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct TruthReport {
    /// The state.
    pub state: String,
    /// Root mean square of estimate less truth.
    pub rmse: f64,
    /// The same of measurements; none where nothing measures it.
    pub measured_rmse: Option<f64>,
}

impl SquareReport {
    fn of(found: &Consistency) -> Option<Self> {
        let mean = found.mean()?;
        let [low, high] = mean.band;
        Some(Self { rows: found.rows(), freedom: found.freedom(), mean: mean.mean, low, high, share: found.share() })
    }

    /// Whether the mean lies in its band.
    pub fn holds(&self) -> bool {
        (self.low..=self.high).contains(&self.mean)
    }
}

/// Sums over episodes.
struct Sums {
    sensors: Vec<Consistency>,
    /// Of normalised innovations: products of neighbours, squares, pairs.
    neighbours: Vec<[f64; 3]>,
    deviations: Vec<Vec<f64>>,
    nis: Consistency,
    nees: Consistency,
    /// Of every truth: squared errors and how many, of estimates and of measurements.
    errors: Vec<[f64; 4]>,
    log_likelihood: f64,
    process: Vec<f64>,
    held: u64,
    /// Of every sensor: rows that say what the row before said, and rows that follow one.
    repeated: Vec<[u64; 2]>,
}

/// Measurements that repeat the one before in more than this share of rows are those of a slower sensor, held.
const HELD: f64 = 0.5;

/// Bytes that the rows of one episode may take.
const MEMORY: usize = 1 << 32;

/// Refuses an episode of which not all rows fit into memory, before one is read.
fn check_memory<'a>(mut episodes: impl Iterator<Item = (&'a str, usize)>, bytes_of_row: usize) -> Result<(), Error> {
    let most = MEMORY / bytes_of_row;
    let Some((name, rows)) = episodes.find(|(_, rows)| *rows > most) else { return Ok(()) };
    Err(Error::value(format!(
        "episode {name} has {rows} rows, and {most} fit into memory: filter a part of it (--where 'time() < SECONDS', or where of [time]), or split the log"
    )))
}

/// Filters the episodes of logs by a model; writes what it finds where `output` is given. How is said by `[filter]` of `changes`, above the model's own recipe. Nothing that is
/// told of a row depends on later ones.
///
/// # Errors
/// Those of [`filter_rows`] and of writing.
pub fn filter(
    model: &Model,
    changes: &Recipe,
    logs: impl Into<Logs>,
    output: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Filtered, Error> {
    let logs = logs.into();
    if let Some(path) = output {
        output::table_only(path)?;
    }
    let mut writer = None;
    let filtered = filter_rows(model, changes, &logs, progress, |filter, rows| {
        let Some(path) = output else { return Ok(()) };
        let writer = match &mut writer {
            Some(writer) => writer,
            None => writer.insert(output::FilteredWriter::create(path, model, filter, &logs)?),
        };
        writer.write(rows)
    })?;
    if let Some(writer) = writer {
        writer.finish()?;
    }
    Ok(filtered)
}

/// Filters the episodes of logs by a model; `take` gets them in their order, and the filter.
///
/// # Errors
/// Those of the settings, of opening and reading, of [`SwitchedFilter::new`], and of `take`; an episode that does not fit into memory.
pub fn filter_rows(
    model: &Model,
    changes: &Recipe,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
    mut take: impl FnMut(&SwitchedFilter, &FilteredRows) -> Result<(), Error> + Send,
) -> Result<Filtered, Error> {
    let logs = logs.into();
    let mut recipe = Recipe::parse(&model.training.recipe, "the model's recipe")?;
    recipe.say(changes.filter.clone());
    let Asked { filter, readings, dataset, mut notes } = Asked::new(model, changes, &recipe.filter, &logs, progress)?;
    notes.splice(0..0, dataset.notes().iter().cloned());
    let view = dataset.view()?;
    let rows = view.episodes().iter().map(|episode| (episode.name.as_str(), episode.rows));
    check_memory(rows, FilteredRows::bytes_of_row(&filter, &readings, view.columns().len()))?;
    progress.stage("filter");
    let sensors = filter.measured().len();
    let mut sums = Sums {
        sensors: vec![Consistency::new(1); sensors],
        neighbours: vec![[0.0; 3]; sensors],
        deviations: vec![Vec::new(); sensors],
        nis: Consistency::new(sensors),
        nees: Consistency::new(readings.truth.len()),
        errors: vec![[0.0; 4]; readings.truth.len()],
        log_likelihood: 0.0,
        process: Vec::new(),
        held: 0,
        repeated: vec![[0; 2]; sensors],
    };
    parallel_fold(
        view.episodes().len(),
        progress,
        |episode| {
            let block = view.read(episode, 0..view.episodes()[episode].rows, Halo::default())?;
            let name = view.episodes()[episode].name.clone();
            Ok::<_, Error>((episode, FilteredRows::new(&filter, &readings, name, &block)))
        },
        |(episode, rows)| {
            sums.add(view.episodes()[episode].id, &filter, &readings, &rows);
            take(&filter, &rows)
        },
    )?;
    dataset.all_were_read();
    notes.extend(sums.held_sensors(&filter));
    Ok(Filtered {
        rows: view.rows() as u64,
        episodes: view.episodes().len(),
        states: filter.states().to_vec(),
        regions: filter.regions(),
        switching: recipe.filter.switching.unwrap_or_default(),
        process: sums.process.iter().sum::<f64>() / sums.process.len() as f64,
        exact: filter.steps().is_some(),
        sensors: sums.sensors(&filter, &readings),
        log_likelihood: sums.log_likelihood,
        nis: SquareReport::of(&sums.nis),
        nees: SquareReport::of(&sums.nees).filter(|_| !readings.truth.is_empty()),
        truth: sums.truth(&filter, &readings),
        held_inputs: sums.held,
        in_sample_episodes: dataset.in_sample(model),
        notes,
    })
}

impl Sums {
    fn add(
        &mut self,
        episode: fleetfoot_data::EpisodeId,
        filter: &SwitchedFilter,
        readings: &Reading,
        rows: &FilteredRows,
    ) {
        for k in 0..self.sensors.len() {
            let width = self.sensors.len();
            let of = |row: usize| rows.innovations()[row * width + k] / rows.innovation_deviations()[row * width + k];
            let normalised: Vec<f64> = (0..rows.rows()).map(of).collect();
            self.sensors[k].add(episode, normalised.iter().map(|value| value * value));
            for pair in normalised.windows(2).filter(|pair| pair.iter().all(|value| value.is_finite())) {
                let sums = &mut self.neighbours[k];
                *sums = [
                    sums[0] + pair[0] * pair[1],
                    sums[1] + 0.5 * (pair[0] * pair[0] + pair[1] * pair[1]),
                    sums[2] + 1.0,
                ];
            }
            self.deviations[k].push(rows.last_deviations[k]);
            let [repeated, pairs] = rows.repeated(k);
            self.repeated[k] = [self.repeated[k][0] + repeated, self.repeated[k][1] + pairs];
        }
        self.nis.add(episode, rows.nis.iter().copied());
        self.nees.add(episode, rows.nees.iter().copied());
        for (t, truth) in readings.truth.iter().enumerate() {
            let measured = filter.measured().position(|state| state == truth.state);
            for row in 0..rows.rows() {
                let error = rows.error(row, t, filter.is_angle(truth.state));
                if error.is_finite() {
                    self.errors[t][0] += error * error;
                    self.errors[t][1] += 1.0;
                }
                let off = measured.map_or(f64::NAN, |k| rows.measured_error(row, t, k, filter.is_angle(truth.state)));
                if off.is_finite() {
                    self.errors[t][2] += off * off;
                    self.errors[t][3] += 1.0;
                }
            }
        }
        self.log_likelihood += rows.log_likelihood.iter().sum::<f64>();
        self.process.push(rows.process);
        self.held += rows.held_inputs as u64;
    }

    /// A note of the sensors that are slower than the rows.
    fn held_sensors(&self, filter: &SwitchedFilter) -> Option<String> {
        let slow = |(state, [repeated, pairs]): (usize, &[u64; 2])| {
            (*repeated as f64 > HELD * *pairs as f64).then(|| filter.states()[state].clone())
        };
        let slow: Vec<String> = filter.measured().zip(&self.repeated).filter_map(slow).collect();
        (!slow.is_empty()).then(|| {
            format!(
                "{}: most measurements repeat the one before, as those of a slow sensor do that is held between its samples; each counts as a new one: make its topic the base of the rows ([time] base)",
                slow.join(", ")
            )
        })
    }

    fn sensors(&self, filter: &SwitchedFilter, readings: &Reading) -> Vec<SensorReport> {
        let given: Vec<Option<f64>> = filter.deviations().collect();
        let sensor = |(k, state): (usize, usize)| {
            let [products, squares, pairs] = self.neighbours[k];
            let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
            let column = readings.deviations[k].is_some();
            SensorReport {
                state: filter.states()[state].clone(),
                deviation: given[k].unwrap_or_else(|| mean(&self.deviations[k])),
                deviation_from: match given[k] {
                    Some(_) => DeviationFrom::Given,
                    None if column => DeviationFrom::Column,
                    None => DeviationFrom::Innovations,
                },
                rows: self.sensors[k].rows(),
                share: self.sensors[k].share(),
                correlation: products / squares,
                white: 1.96 / pairs.sqrt(),
            }
        };
        filter.measured().enumerate().map(sensor).collect()
    }

    fn truth(&self, filter: &SwitchedFilter, readings: &Reading) -> Vec<TruthReport> {
        let told = |(truth, &[squares, rows, off, readings]): (&asked::Truth, &[f64; 4])| TruthReport {
            state: filter.states()[truth.state].clone(),
            rmse: (squares / rows).sqrt(),
            measured_rmse: (readings > 0.0).then(|| (off / readings).sqrt()),
        };
        readings.truth.iter().zip(&self.errors).map(told).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_episode_that_does_not_fit_is_refused_with_what_fits() {
        let most = MEMORY / 800;
        assert!(check_memory([("short", 10), ("long", most)].into_iter(), 800).is_ok());
        let refused = check_memory([("short", 10), ("long", most + 1)].into_iter(), 800);
        let said = refused.expect_err("too long").to_string();
        assert!(
            said.contains("episode long") && said.contains(&format!("{most} fit")) && said.contains("--where"),
            "{said}"
        );
    }
}
