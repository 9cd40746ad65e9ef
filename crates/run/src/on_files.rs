//! A model run on files: scores, predictions row by row, rollouts.

use std::{collections::BTreeSet, path::Path, sync::Arc};

use fleetfoot_data::{Progress, Source, parallel_fold};
use fleetfoot_dataset::{Dataset, Logs, blocks::blocks, raw::Measured};
use fleetfoot_dynamics::{
    Domain, Predicted, Predictor, PredictorWorkspace, Recorded, RolloutOptions, Rollouts, RowStatus, ScoreOptions,
    Scores, Starts, controller::Controller,
};
use fleetfoot_fit::{Error, FileRuns, free_runs_by_file};
use fleetfoot_library::Expr;
use fleetfoot_model::{Equation, Model, Prediction, Rule};
use fleetfoot_recipe::Recipe;
use serde::Serialize;

use crate::{
    controller, output,
    output::{Place, PredictionsWriter},
};

/// Scores, and notes about the data.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Scored {
    /// The scores.
    pub scores: Scores,
    /// Of an autoregression: whole files simulated from their first rows, one by one.
    pub free_runs: FileRuns,
    /// Episodes scored.
    pub episodes: usize,
    /// Names of those that the model was trained on: their scores are in-sample.
    pub in_sample: Vec<String>,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

/// Scores one-step predictions on files.
pub fn score(model: &Model, changes: &Recipe, logs: impl Into<Logs>, progress: &dyn Progress) -> Result<Scored, Error> {
    score_rows(model, &Dataset::for_model(model, changes, logs, progress)?, progress)
}

/// Scores one-step predictions on rows that are opened.
pub fn score_rows(model: &Model, dataset: &Dataset, progress: &dyn Progress) -> Result<Scored, Error> {
    let view = dataset.view()?;
    let measured = dataset.measured(&compared(model), progress)?;
    let raw = measured.as_ref().map(Measured::view).transpose()?;
    let raw = raw.as_ref().map(|raw| raw as &dyn Source);
    progress.stage("score");
    let mut scores = fleetfoot_dynamics::score_beside_raw(model, &view, raw, &ScoreOptions::default(), progress)?;
    dataset.all_were_read();
    let trained = dataset.trained(model);
    scores.episodes.iter_mut().for_each(|score| score.in_training |= trained.contains(&score.episode));
    refuse_unseen_labels(model, scores.skipped.no_region, scores.rows)?;
    if scores.rows == 0 {
        return Err(nothing_to_score(&scores));
    }
    let mut notes = notes(dataset, measured.as_ref());
    notes.extend(targets_at_rest(&scores));
    Ok(Scored {
        scores,
        free_runs: free_runs_by_file(model, dataset, 1, progress)?,
        episodes: dataset.episodes().len(),
        in_sample: dataset.in_sample(model),
        notes,
    })
}

/// The columns that errors of one step are against: those of targets, none of which is a derivative.
fn compared(model: &Model) -> BTreeSet<String> {
    let levels = model.fitted().filter(|equation| equation.prediction != Prediction::Derivative);
    let targets = levels.filter_map(|equation| equation.target.as_ref());
    targets.flat_map(Expr::columns).map(|name| name.to_string()).collect()
}

/// The notes of opened rows, with the measured columns in the raw logs of prepared ones.
fn notes(dataset: &Dataset, measured: Option<&Measured>) -> Vec<String> {
    measured.map_or_else(|| dataset.notes().to_vec(), |measured| measured.notes(dataset.notes()))
}

/// Targets that did not vary are predicted by any constant: their ratios praise no model.
fn targets_at_rest(scores: &Scores) -> Option<String> {
    let at_rest = scores.targets.iter().filter(|target| target.deviation == 0.0).map(|target| target.name.as_str());
    let names: Vec<&str> = at_rest.collect();
    let (have, them) =
        if names.len() == 1 { ("has", "its R2 and ratio say") } else { ("have each", "their R2 and ratios say") };
    (!names.is_empty()).then(|| {
        format!(
            "{} {have} the same value in all rows that were scored: {them} nothing about the model; score rows in which the robot moves",
            names.join(", ")
        )
    })
}

fn nothing_to_score(scores: &Scores) -> Error {
    let skipped = &scores.skipped;
    Error::too_few_rows(
        0,
        1,
        format!(
            "no row can be scored: {} rows lack neighbours at the border of their episode, {} have a missing value, for {} the model gives no finite \
         number; give longer episodes or other files",
            skipped.border, skipped.missing, skipped.non_finite
        ),
    )
}

/// Refuses a model whose labels do not cover the data, unless it was fitted to pool them.
fn refuse_unseen_labels(model: &Model, without_region: u64, scored: u64) -> Result<(), Error> {
    let label = model.partitions.iter().find_map(|partition| match &partition.rule {
        Rule::Labels { names, .. } => {
            Some((partition.columns.last().map(ToString::to_string).unwrap_or_default(), names))
        }
        _ => None,
    });
    match label {
        Some((column, names)) if without_region > 0 => Err(fleetfoot_dataset::Error::UnseenLabel {
            column,
            labels: format!("the model was trained on {}; {scored} rows have one of these", names.join(", ")),
            rows: without_region,
        }
        .into()),
        _ => Ok(()),
    }
}

/// Counts of the written rows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Written {
    /// Rows in the file.
    pub rows: u64,
    /// Rows with a prediction.
    pub predicted: u64,
    /// Of these, rows with a target to compare it with.
    pub compared: u64,
    /// Of the predicted rows, those outside the training range of their region.
    pub outside_domain: u64,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

/// Consecutive rows with their predictions.
#[derive(Debug)]
#[non_exhaustive]
pub struct PredictedRows<'a> {
    /// The episode that they are of.
    pub episode: &'a fleetfoot_data::Episode,
    /// Offset from the stamps to the times of the recording, nanoseconds.
    pub log_offset: i64,
    /// Their stamps, nanoseconds.
    pub stamps: &'a [i64],
    /// The columns that were read.
    pub columns: &'a [fleetfoot_data::Column],
    /// Their values, in the same order, and those of the rows beside them.
    pub block: &'a fleetfoot_data::Block,
    /// Predictions, targets, regions, distances.
    pub predicted: &'a Predicted,
}

/// Returns true if a run of a model needs a column. Columns that only the targets read are not needed: a prediction is
/// merely compared with them. A rollout starts from the states that it advances, so it needs these too.
pub fn is_needed(model: &Model, name: &str, rollout: bool) -> bool {
    let speaks =
        |expression: &Expr| expression.columns().iter().chain(&expression.sources()).any(|column| **column == *name);
    let targets = model.equations.iter().filter_map(|equation| equation.target.as_ref());
    let partitions = model.partitions.iter().flat_map(|partition| &partition.columns);
    let rights = model.equations.iter().map(|equation| &equation.right);
    let advanced = |equation: &Equation| equation.prediction != Prediction::Value && equation.subject == *name;
    !targets.into_iter().any(speaks)
        || model.libraries.iter().flatten().chain(partitions).chain(rights).any(speaks)
        || (rollout && model.equations.iter().any(advanced))
}

/// Predicts the rows of logs, in order; `take` gets them some at a time, and the predictor that made them. Returns
/// their number.
///
/// # Errors
/// Those of opening and reading, and of `take`.
pub fn predict_rows(
    model: &Model,
    changes: &Recipe,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
    mut take: impl FnMut(&Predictor, &PredictedRows<'_>) -> Result<(), Error> + Send,
) -> Result<Written, Error> {
    let dataset = Dataset::for_run(model, changes, logs, &|name| is_needed(model, name, false), progress)?;
    let view = dataset.view()?;
    let names: Vec<&str> = view.columns().iter().map(|column| column.name.as_str()).collect();
    let predictor = Predictor::new(model, &names)?;
    let pieces = blocks(&view);
    progress.stage("predict");
    let mut without_values = vec![true; names.len()];
    let mut written =
        Written { rows: 0, predicted: 0, compared: 0, outside_domain: 0, notes: dataset.notes().to_vec() };
    parallel_fold(
        pieces.len(),
        progress,
        |piece| {
            let (episode, rows) = pieces[piece].clone();
            let block = view.read(episode, rows, predictor.halo())?;
            let mut predicted = Predicted::default();
            predictor.predict(&block, 0..block.rows, &mut PredictorWorkspace::default(), &mut predicted);
            Ok::<_, Error>((episode, block, predicted))
        },
        |(episode, block, predicted)| {
            let rows = PredictedRows {
                episode: &view.episodes()[episode],
                log_offset: dataset.log_offset(episode),
                stamps: block.stamps(),
                columns: view.columns(),
                block: &block,
                predicted: &predicted,
            };
            take(&predictor, &rows)?;
            for (column, is_empty) in without_values.iter_mut().enumerate() {
                *is_empty &= block.column(column).iter().all(|value| !value.is_finite());
            }
            written.rows += predicted.rows as u64;
            written.predicted += (0..predicted.rows).filter(|&row| predicted.is_predicted(row)).count() as u64;
            written.compared += predicted.status.iter().filter(|&&status| status == RowStatus::Complete).count() as u64;
            written.outside_domain +=
                predicted.domain.iter().filter(|&&domain| domain != Domain::Inside).count() as u64;
            Ok(())
        },
    )?;
    if written.predicted == 0 {
        written.notes.extend(nothing_predicted(&names, &without_values));
    }
    Ok(written)
}

/// Note on columns that have no value in any row; `None` if all have some.
fn nothing_predicted(names: &[&str], without_values: &[bool]) -> Option<String> {
    let empty = names.iter().zip(without_values).filter(|(_, is_empty)| **is_empty);
    let empty: Vec<String> = empty.map(|(name, _)| format!("`{name}`")).collect();
    let have = if empty.len() == 1 { "has" } else { "have" };
    (!empty.is_empty()).then(|| {
        format!(
            "no row has a prediction: {} {have} no value in any row; check these columns of the logs",
            empty.join(", ")
        )
    })
}

/// Writes per row: episode and stamp; measured target, prediction and residual of every fitted equation; region;
/// distance from the training rows; and true if the row is inside the training range.
pub fn predict(
    model: &Model,
    changes: &Recipe,
    logs: impl Into<Logs>,
    output: &Path,
    progress: &dyn Progress,
) -> Result<Written, Error> {
    let kind = output::kind(output)?;
    let logs = logs.into();
    let mut writer = None;
    let written = predict_rows(model, changes, &logs, progress, |predictor, rows| {
        let place = Place { episode: &rows.episode.name, log_offset: rows.log_offset };
        let writer = match &mut writer {
            Some(writer) => writer,
            None => writer.insert(PredictionsWriter::create(kind, output, model, predictor, &logs)?),
        };
        writer.write(&place, rows.stamps, rows.predicted)
    })?;
    if let Some(writer) = writer {
        writer.finish()?;
    }
    Ok(written)
}

/// Rollouts, and notes about the data.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct RolledOut {
    /// Scores against the horizon, and the trajectories where they were kept.
    pub rollouts: Rollouts,
    /// Episodes there are.
    pub episodes: usize,
    /// Names of those that the model was trained on.
    pub in_sample: Vec<String>,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

/// Simulates a model from measured states, with a controller around it where one is given; writes the trajectories when `output` is given.
#[expect(
    clippy::too_many_arguments,
    reason = "all of them are the caller's choice; a controller and a file may be left out"
)]
pub fn rollout(
    model: &Model,
    changes: &Recipe,
    logs: impl Into<Logs>,
    starts: &Starts,
    options: &RolloutOptions,
    closed_by: Option<&Arc<dyn Controller>>,
    output: Option<&Path>,
    progress: &dyn Progress,
) -> Result<RolledOut, Error> {
    let kind = output.map(output::kind).transpose()?;
    let logs = logs.into();
    let (model, dataset) = &opened_to_roll(model, changes, &logs, closed_by, progress)?;
    let mut options = options.clone();
    options.keep |= output.is_some();
    let rolled = roll_rows(model, dataset, starts, &options, closed_by, progress)?;
    if let (Some(path), Some(kind)) = (output, kind) {
        let offset = |episode| dataset.log_offset(episode);
        output::write_trajectories(kind, path, model, &dataset.view()?, &offset, &rolled.rollouts, &logs)?;
    }
    Ok(rolled)
}

/// A model with the columns that a controller reads, and the rows that it is simulated on.
pub fn opened_to_roll(
    candidate: &Model,
    changes: &Recipe,
    logs: &Logs,
    closed_by: Option<&Arc<dyn Controller>>,
    progress: &dyn Progress,
) -> Result<(Model, Dataset), Error> {
    let model = match closed_by {
        Some(closed_by) => controller::with_columns(candidate, closed_by.as_ref())?,
        None => candidate.clone(),
    };
    let needed = |name: &str| is_needed(&model, name, true);
    let dataset = Dataset::for_run(&model, changes, logs, &needed, progress)
        .map_err(|error| controller::explained(error, candidate))?;
    Ok((model, dataset))
}

/// Simulates a model, which has the columns that a controller reads, on rows that are opened.
pub fn roll_rows(
    model: &Model,
    dataset: &Dataset,
    starts: &Starts,
    options: &RolloutOptions,
    closed_by: Option<&Arc<dyn Controller>>,
    progress: &dyn Progress,
) -> Result<RolledOut, Error> {
    dataset.search(progress)?;
    let view = dataset.view()?;
    let advanced = model.equations.iter().filter(|equation| equation.prediction != Prediction::Value);
    let measured = dataset.measured(&advanced.map(|equation| equation.subject.clone()).collect(), progress)?;
    let raw = measured.as_ref().map(Measured::view).transpose()?;
    let recorded = Recorded { source: &view, raw: raw.as_ref().map(|raw| raw as &dyn Source) };
    progress.stage("rollout");
    let rollouts = fleetfoot_dynamics::rollout_beside_raw(model, closed_by, recorded, starts, options, progress)?;
    Ok(RolledOut {
        rollouts,
        episodes: dataset.episodes().len(),
        in_sample: dataset.in_sample(model),
        notes: notes(dataset, measured.as_ref()),
    })
}
