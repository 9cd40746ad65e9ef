//! Free runs of a saved autoregression through whole files, each with a separate score.

use std::{collections::BTreeMap, path::PathBuf};

use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::Dataset;
use fleetfoot_model::{Model, Prediction};
use serde::Serialize;

use super::{NarxScores, scores::scores};
use crate::{error::Error, spans::Spans};

/// Free runs of files.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct FileRuns {
    /// Those that a run could begin in, in the order in which they were given.
    #[serde(rename = "by_file")]
    pub files: Vec<FileRun>,
    /// The mean over these files, output by output: every file counts as much, whatever its length.
    pub mean: Vec<MeanRun>,
    /// Files whose episodes are all shorter than the lags, or that miss something everywhere.
    pub skipped: Vec<String>,
}

/// The free run of a file.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct FileRun {
    /// Its path; the name of a table in memory.
    pub file: String,
    /// Its scores.
    #[serde(flatten)]
    pub scores: NarxScores,
}

/// The mean error of an output over files.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct MeanRun {
    /// The output.
    pub name: String,
    /// Mean of the root relative squared errors; infinite when the run of one file is lost.
    pub rrse: f64,
    /// `100 (1 - rrse)`, percent.
    pub fit: f64,
}

impl FileRuns {
    /// Returns true if no file was run, because the model is no autoregression.
    pub fn is_empty(&self) -> bool {
        self.files.is_empty() && self.skipped.is_empty()
    }
}

/// Returns true if a model gives the next value of its outputs from outputs and inputs alone. It can then run through a
/// whole file.
fn is_autoregression(model: &Model) -> bool {
    model.method.starts_with("narx") && model.equations.iter().all(|equation| equation.prediction == Prediction::Next)
}

/// Runs an autoregression through every `every`th row of every file; without files for any other model.
pub fn free_runs_by_file(
    model: &Model,
    dataset: &Dataset,
    every: usize,
    progress: &dyn Progress,
) -> Result<FileRuns, Error> {
    let mut file_runs = FileRuns { files: Vec::new(), mean: Vec::new(), skipped: Vec::new() };
    if !is_autoregression(model) {
        return Ok(file_runs);
    }
    let view = dataset.view()?;
    let mut episodes: BTreeMap<usize, (PathBuf, Vec<usize>)> = BTreeMap::new();
    let mut places: Vec<PathBuf> = Vec::new();
    for episode in 0..view.episodes().len() {
        let path = dataset.origin(episode).to_path_buf();
        let place = places.iter().position(|known| *known == path).unwrap_or_else(|| {
            places.push(path.clone());
            places.len() - 1
        });
        episodes.entry(place).or_insert_with(|| (path, Vec::new())).1.push(episode);
    }
    for (path, episodes) in episodes.into_values() {
        let spans = episodes.into_iter().map(|episode| (episode, 0..view.episodes()[episode].rows)).collect();
        let file = path.display().to_string();
        match scores(model, &Spans::new(&view, spans, every)?, progress)? {
            Some(scores) => file_runs.files.push(FileRun { file, scores }),
            None => file_runs.skipped.push(file),
        }
    }
    file_runs.mean = mean(&file_runs.files);
    Ok(file_runs)
}

/// The mean of relative errors, of those outputs that move: where one rests, its error is relative to nothing (NaN). NaN where none moves.
pub(super) fn mean_of_moving(errors: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) =
        errors.filter(|error| !error.is_nan()).fold((0.0, 0.0), |(sum, count), error| (sum + error, count + 1.0));
    sum / count
}

fn mean(files: &[FileRun]) -> Vec<MeanRun> {
    let Some(first) = files.first() else { return Vec::new() };
    let output = |(index, output): (usize, &fleetfoot_dynamics::FreeRunScore)| {
        let errors = files.iter().map(|file| file.scores.free_run.outputs[index].errors.rrse);
        let rrse = mean_of_moving(errors);
        MeanRun { name: output.name.clone(), rrse, fit: 100.0 * (1.0 - rrse) }
    };
    first.scores.free_run.outputs.iter().enumerate().map(output).collect()
}
