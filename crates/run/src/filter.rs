//! Recordings filtered by a model: `filter`.

mod resolved;
mod row;
mod sums;
#[cfg(test)]
mod tests;
mod writer;

use std::path::Path;

use fleetfoot_control::filter::{Consistency, SwitchedFilter};
use fleetfoot_data::{Block, Halo, Progress, Source, parallel_fold};
use fleetfoot_dataset::{
    Logs,
    blocks::{ROWS, blocks_of},
};
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_recipe::{FilterSwitching, Recipe};
use resolved::ResolvedFilter;
pub use resolved::filter_of;
pub use row::FilteredRows;
use row::Follower;
use serde::Serialize;
use sums::Sums;
use writer::FilteredWriter;

use crate::output;

/// Result of filtering logs.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Filtered {
    /// Rows of all episodes.
    pub rows: u64,
    /// Of these, the rows without an estimate: the covariance of the filter was no finite number any more.
    pub lost_rows: u64,
    /// Episodes.
    pub episodes: usize,
    /// The states.
    pub states: Vec<String>,
    /// The regions.
    pub regions: usize,
    /// Rule by which they follow one another.
    pub switching: FilterSwitching,
    /// Factor on the process noise; of one that was found the mean of the episodes' last ones.
    pub process: f64,
    /// Rows over which the process noise is correlated; 0 if it is white.
    pub noise_rows: usize,
    /// True if every step is the exact one of an affine region; else regions are linearised about the present mean.
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
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

/// A sensor and its innovations.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct SensorReport {
    /// The state that it measures.
    pub state: String,
    /// Its standard deviation. Of one that was estimated, or given row by row, the mean of the episodes' last ones.
    pub deviation: f64,
    /// Source of the deviation.
    pub deviation_from: DeviationFrom,
    /// Innovations.
    pub rows: u64,
    /// The share of squared innovations that are in the 95 % band of a normal distribution of their variance.
    pub share: f64,
    /// The correlation of normalised innovations with those of the row before: none, where they are white.
    pub correlation: f64,
    /// Bound of the correlation of white innovations, with 95 % probability.
    pub white: f64,
}

/// Source of a sensor's deviation.
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
    /// Lower end of the 95 % band of the means of consistent filters.
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
    fn of(consistency: &Consistency) -> Option<Self> {
        let mean = consistency.mean()?;
        let [low, high] = mean.band;
        Some(Self {
            rows: consistency.rows(),
            freedom: consistency.freedom(),
            mean: mean.mean,
            low,
            high,
            share: consistency.share(),
        })
    }

    /// Returns true if the mean lies in its band.
    pub fn holds(&self) -> bool {
        (self.low..=self.high).contains(&self.mean)
    }
}

/// Rows of an episode: filtered, if they are all of it, which does not wait for others. Else read only, for the filter
/// that goes on along the episode.
enum Piece {
    Filtered(Box<FilteredRows>),
    Read(Block),
}

/// Filters the episodes of logs by a model; writes the posterior if `output` is given. Settings are those of `[filter]`
/// in `changes`, above those of the model's recipe. No value of a row depends on later ones.
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
    let output = output.map(|path| Ok::<_, Error>((output::kind(path)?, path))).transpose()?;
    let mut writer = None;
    let filtered = filter_rows(model, changes, &logs, progress, |filter, rows| {
        let Some((kind, path)) = output else { return Ok(()) };
        let writer = match &mut writer {
            Some(writer) => writer,
            None => writer.insert(FilteredWriter::create(kind, path, model, filter, &logs)?),
        };
        writer.write(rows)
    })?;
    if let Some(writer) = writer {
        writer.finish()?;
    }
    Ok(filtered)
}

/// Filters the episodes of logs by a model; `take` gets their rows in order, some at a time, and the filter. Memory is
/// that of some pieces of 65,536 rows a thread, however long an episode is. Episodes of one piece are filtered side by
/// side, a longer one from piece to piece, while the next ones are read.
///
/// # Errors
/// Those of the settings, of opening and reading, of [`SwitchedFilter::new`], and of `take`.
pub fn filter_rows(
    model: &Model,
    changes: &Recipe,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
    take: impl FnMut(&SwitchedFilter, &FilteredRows) -> Result<(), Error> + Send,
) -> Result<Filtered, Error> {
    filter_pieces(model, changes, &logs.into(), ROWS, progress, take)
}

/// [`filter_rows`] by so many rows at a time.
fn filter_pieces(
    model: &Model,
    changes: &Recipe,
    logs: &Logs,
    at_a_time: usize,
    progress: &dyn Progress,
    mut take: impl FnMut(&SwitchedFilter, &FilteredRows) -> Result<(), Error> + Send,
) -> Result<Filtered, Error> {
    let mut recipe = Recipe::parse(&model.training.recipe, "the model's recipe")?;
    recipe.override_with(changes.filter.clone());
    let ResolvedFilter { filter, readings, dataset, mut notes } =
        ResolvedFilter::new(model, changes, &recipe.filter, logs, progress)?;
    notes.splice(0..0, dataset.notes().iter().cloned());
    let view = dataset.view()?;
    let pieces = blocks_of(&view, at_a_time);
    progress.stage("filter");
    let mut sums = Sums::new(&filter, &readings);
    let begun = |episode: usize| {
        let name = view.episodes()[episode].name.clone();
        Follower::new(&filter, &readings, name, dataset.log_offset(episode))
    };
    let mut along: Option<Follower<'_>> = None;
    parallel_fold(
        pieces.len(),
        progress,
        |piece| {
            let (episode, rows) = pieces[piece].clone();
            let whole = rows == (0..view.episodes()[episode].rows);
            // The inputs of the row before lead to the first one.
            let block = view.read(episode, rows, Halo { before: 1, after: 0 })?;
            let piece = match whole {
                true => Piece::Filtered(Box::new(begun(episode).follow(&block))),
                false => Piece::Read(block),
            };
            Ok::<_, Error>((episode, piece))
        },
        |(episode, piece)| {
            let rows = match piece {
                Piece::Filtered(rows) => *rows,
                Piece::Read(block) => {
                    if block.first == 0 {
                        along = Some(begun(episode));
                    }
                    along.get_or_insert_with(|| begun(episode)).follow(&block)
                }
            };
            let episode = &view.episodes()[episode];
            sums.add(episode.id, &filter, &readings, &rows);
            if rows.first() + rows.rows() == episode.rows {
                sums.close();
            }
            take(&filter, &rows)
        },
    )?;
    dataset.all_were_read();
    notes.extend(sums.lost_filters());
    notes.extend(sums.held_sensors(&filter));
    Ok(Filtered {
        rows: view.rows() as u64,
        lost_rows: sums.lost(),
        episodes: view.episodes().len(),
        states: filter.states().to_vec(),
        regions: filter.regions(),
        switching: recipe.filter.switching.unwrap_or_default(),
        process: sums.process(),
        noise_rows: filter.colour().map_or(0, |colour| colour.order()),
        exact: filter.steps().is_some(),
        sensors: sums.sensors(&filter, &readings),
        log_likelihood: sums.log_likelihood(),
        nis: SquareReport::of(sums.nis()),
        nees: SquareReport::of(sums.nees()).filter(|_| !readings.truth.is_empty()),
        truth: sums.truth(&filter, &readings),
        held_inputs: sums.held(),
        in_sample_episodes: dataset.in_sample(model),
        notes,
    })
}
