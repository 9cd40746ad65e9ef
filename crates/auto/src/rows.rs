//! The rows that train and those of the test: how many, from when to when, and over which range of every column.

use fleetfoot_data::{Halo, Progress, Source};
use fleetfoot_dataset::{Dataset, Logs, Part};
use fleetfoot_fit::Error;
use fleetfoot_recipe::Recipe;
use serde::Serialize;

/// Rows read at once.
const ROWS: usize = 65_536;

/// One part of the logs.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Span {
    /// Rows.
    pub rows: usize,
    /// Episodes.
    pub episodes: usize,
    /// Seconds from the first stamp of all logs to the first and the last row of this part.
    pub seconds: [f64; 2],
}

/// The rows that train and those that are kept back.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Split {
    /// Rows for fits and for the choice.
    pub training: Span,
    /// Rows of the test.
    pub test: Span,
}

/// A column and how it moves in both parts.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Movement {
    pub(crate) name: String,
    pub(crate) unit: Option<String>,
    pub(crate) training: [f64; 2],
    pub(crate) test: [f64; 2],
    /// Share of the training rows in which it is another value than in the row above.
    pub(crate) moves: f64,
}

impl Movement {
    /// Excess of the test over the training range, in widths of that range.
    pub(crate) fn beyond(&self) -> f64 {
        let [least, most] = self.training;
        (least - self.test[0]).max(self.test[1] - most) / (most - least)
    }
}

/// Spans of training and test, and the movement of every column in both.
///
/// # Errors
/// Those of opening and reading; nothing is left for a test.
pub(crate) fn look(recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<(Split, Vec<Movement>), Error> {
    let open = |part| Dataset::for_columns(recipe, None, logs.only(part), progress);
    let (training, test) = (open(Part::Training)?, open(Part::Test)?);
    let (training_view, test_view) = (training.view()?, test.view()?);
    let stamps = |view: &dyn Source| {
        let first = view.episodes().iter().map(|episode| episode.start).min().unwrap_or(0);
        let last = view.episodes().iter().map(|episode| episode.end).max().unwrap_or(0);
        [first, last]
    };
    let [a, b] = [stamps(&training_view), stamps(&test_view)];
    let first = a[0].min(b[0]);
    let span = |view: &dyn Source, stamps: [i64; 2]| Span {
        rows: view.rows(),
        episodes: view.episodes().len(),
        seconds: stamps.map(|stamp| (stamp - first) as f64 * 1e-9),
    };
    let mut split = Split { training: span(&training_view, a), test: span(&test_view, b) };
    // Rows that are counted begin at zero in every part.
    if let Some(dt) = recipe.time.dt {
        let before = if split.training.episodes == 1 { dt * split.training.rows as f64 } else { 0.0 };
        split.test.seconds = split.test.seconds.map(|seconds| seconds + before);
    }
    let (training, test) = (ranges(&training_view)?, ranges(&test_view)?);
    let movements =
        training_view.columns().iter().zip(training.iter().zip(&test)).map(|(column, (training, test))| Movement {
            name: column.name.clone(),
            unit: column.unit.clone(),
            training: training.0,
            test: test.0,
            moves: training.1,
        });
    Ok((split, movements.collect()))
}

/// Range, and share of rows that move, of every column.
fn ranges(view: &dyn Source) -> Result<Vec<([f64; 2], f64)>, Error> {
    let mut extent = vec![([f64::INFINITY, f64::NEG_INFINITY], 0.0, f64::NAN); view.columns().len()];
    for (at, episode) in view.episodes().iter().enumerate() {
        for from in (0..episode.rows).step_by(ROWS) {
            let block = view.read(at, from..(from + ROWS).min(episode.rows), Halo::default())?;
            for (place, (range, moved, last)) in extent.iter_mut().enumerate() {
                for &value in block.core(place).iter().filter(|value| value.is_finite()) {
                    *range = [range[0].min(value), range[1].max(value)];
                    *moved += f64::from(u8::from(value != *last));
                    *last = value;
                }
            }
        }
    }
    let rows = view.rows().max(1) as f64;
    Ok(extent.into_iter().map(|(range, moved, _)| (range, moved / rows)).collect())
}
