//! A raw log opened by the recipe that it was prepared by.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use fleetfoot_data::{Block, Halo, Progress, Source};
use fleetfoot_recipe::{Kind, Recipe};
use fleetfoot_signal::dejitter;

use super::{PREPARED_BY, RAW, RawLog, path::beside, series::Series};
use crate::{content::hash_path, dataset::Dataset, error::Error, logs::Logs};

/// A prepared file's raw log, where it is at hand.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RawSource {
    pub(super) raw: RawLog,
    pub(super) recipe: Recipe,
    pub(super) files: Vec<PathBuf>,
}

impl RawSource {
    /// The raw log of a prepared file; why there is none, in words.
    pub(super) fn of(prepared: &Path, progress: &dyn Progress) -> Result<Result<Self, String>, Error> {
        let again = "prepare the raw log again";
        let mut metadata = fleetfoot_log::metadata(prepared)?;
        let (Some(raw), Some(recipe)) = (metadata.remove(RAW), metadata.remove(PREPARED_BY)) else {
            return Ok(Err(format!("{}: it does not name its raw log; {again}", prepared.display())));
        };
        let (Ok(raw), Ok(recipe)) =
            (serde_json::from_str::<RawLog>(&raw), Recipe::parse(&recipe, "the recipe of a prepared log"))
        else {
            return Ok(Err(format!("{}: another fleetfoot wrote it; {again}", prepared.display())));
        };
        let mut files = Vec::new();
        for file in &raw.files {
            let path = beside(prepared, &file.path);
            let place = path.canonicalize().unwrap_or_else(|_| path.clone());
            if !path.exists() {
                return Ok(Err(format!(
                    "{}: its raw log was looked for at {} and is not there; put it back, or {again}",
                    prepared.display(),
                    path.display()
                )));
            }
            if hash_path(&path, progress)?.0.to_string() != file.hash {
                return Ok(Err(format!(
                    "{}: its raw log {} has changed since; {again}",
                    prepared.display(),
                    place.display()
                )));
            }
            files.push(place);
        }
        Ok(Ok(Self { raw, recipe, files }))
    }

    /// Those of these columns that were measured, and not computed.
    pub(super) fn measured(&self, fields: &BTreeSet<String>) -> BTreeSet<String> {
        let Recipe { states, inputs, columns, .. } = &self.recipe;
        let is_read =
            |name: &&String| states.contains_key(*name) || inputs.contains_key(*name) || columns.contains_key(*name);
        fields.iter().filter(is_read).cloned().collect()
    }
}

/// Raw logs, opened: the rows, and the samples of topics that are not those of the rows.
pub(super) struct OpenedRaw {
    files: Vec<PathBuf>,
    recipe: Recipe,
    /// The columns that are read of each data set.
    sets: Vec<(BTreeSet<String>, Dataset)>,
}

impl OpenedRaw {
    /// Opens the raw log for columns, by the same rows as the preparation.
    pub(super) fn new(raw: &RawSource, columns: &BTreeSet<String>, progress: &dyn Progress) -> Result<Self, Error> {
        let (recipe, logs) = (&raw.recipe, Logs::from(&raw.files));
        let mut by_topic: BTreeMap<Option<&String>, BTreeSet<String>> = BTreeMap::new();
        for column in columns {
            by_topic.entry(raw.raw.topics.get(column)).or_default().insert(column.clone());
        }
        let of_rows = by_topic.remove(&None).unwrap_or_default();
        let is_fused = recipe.body.is_some() || !recipe.joint.is_empty() || !recipe.sensor.is_empty();
        let rows = if is_fused {
            let names: Vec<String> = of_rows.iter().cloned().collect();
            Dataset::for_columns(recipe, Some(&names), &logs, progress)?
        } else {
            Dataset::for_preparation(recipe, &logs, progress)?.0
        };
        let known = rows.topic_clocks().to_vec();
        let mut sets = vec![(of_rows, rows)];
        for columns in by_topic.into_values() {
            let names: Vec<String> = columns.iter().cloned().collect();
            sets.push((columns, Dataset::for_channels(recipe, &names, &known, &logs, progress)?));
        }
        Ok(Self { files: raw.files.clone(), recipe: recipe.clone(), sets })
    }

    /// Returns true if this raw log is also that of another episode, with these columns.
    pub(super) fn serves(&self, raw: &RawSource, columns: &BTreeSet<String>) -> bool {
        let kept: BTreeSet<&String> = self.sets.iter().flat_map(|(kept, _)| kept).collect();
        self.files == raw.files && self.recipe == raw.recipe && kept == columns.iter().collect()
    }

    /// The measurements of every column of an episode, pause by pause, in seconds from the episode's start.
    pub(super) fn series(&self, raw: &RawLog) -> Result<BTreeMap<&str, Vec<Series>>, Error> {
        let mut all: BTreeMap<&str, Vec<Series>> = BTreeMap::new();
        for (number, (columns, dataset)) in self.sets.iter().enumerate() {
            let view = dataset.view()?;
            // A topic's own samples have other episodes than the rows.
            let chosen = raw.episode.filter(|_| number == 0);
            for (at, episode) in view.episodes().iter().enumerate() {
                if columns.is_empty() || chosen.is_some_and(|chosen| chosen != at) {
                    continue;
                }
                let mut block = view.read(at, 0..episode.rows, Halo::default())?;
                view.turn_on(&mut block);
                let offset = block.start - raw.start + dataset.log_offset(at) - raw.clock_offset;
                let times = self.times(&block, &episode.name)?;
                for column in columns {
                    let Some(place) = view.column_index(column) else { continue };
                    let late = raw.late.get(column).copied().unwrap_or(0.0);
                    let times = times.iter().map(|time| time + offset as f64 * 1e-9 - late).collect();
                    let state = self.recipe.states.get(column);
                    let angle = state.is_some_and(|state| state.kind == Some(Kind::Angle));
                    let mut series = Series::new(times, block.column(place).to_vec(), angle);
                    series.leave_out(raw.left_out.get(column).map_or(&[], Vec::as_slice));
                    all.entry(column).or_default().push(series);
                }
            }
        }
        Ok(all)
    }

    /// Seconds of an episode as the preparation saw them.
    fn times(&self, block: &Block, episode: &str) -> Result<Vec<f64>, Error> {
        let times = block.seconds();
        if self.recipe.prepare.dejitter != Some(true) || times.len() < 3 {
            return Ok(times);
        }
        let error = |source| Error::Signal { episode: episode.to_owned(), channel: "the stamps".into(), source };
        Ok(dejitter(&times).map_err(error)?.times)
    }
}
