//! Measurements at the rows of prepared logs: values of the raw logs replace the smoothed ones.

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::Range,
    path::PathBuf,
};

use fleetfoot_data::{
    Block, Column, ColumnKind, Episode, Error as DataError, Halo, Progress, ScalarBuffer, Source, Watched,
    ensure_memory,
};
use fleetfoot_library::{Expr, View};

use super::opened::{OpenedRaw, RawSource};
use crate::{dataset::Dataset, error::Error, logs::is_prepared, view::seen_through};

/// The rows of prepared logs with raw measurements in the place of smoothed values; NaN where nothing was measured.
#[derive(Debug)]
pub struct Measured {
    rows: MeasuredRows,
    aliases: Vec<(Column, Expr)>,
    /// Raw logs, with the logs that were prepared from each.
    raw: BTreeMap<PathBuf, Vec<PathBuf>>,
    /// The prepared files without measurements, and why.
    missing: Vec<String>,
    /// Note for logs without a raw log.
    smoothed: Option<String>,
}

/// Raw measurements by field of the prepared logs.
#[derive(Debug)]
struct MeasuredRows {
    columns: Vec<Column>,
    episodes: Vec<Episode>,
    stamps: Vec<ScalarBuffer<i64>>,
    /// Of each episode the fields that were measured.
    values: Vec<Vec<Option<ScalarBuffer<f64>>>>,
}

impl Dataset {
    /// The raw measurements at the rows of prepared logs, of what columns are computed from; `None` where no log is a prepared one or none of the columns was measured.
    ///
    /// # Errors
    /// Those of reading the prepared logs. What is wrong with a raw log is a note ([`Measured::notes`]).
    pub fn measured(&self, columns: &BTreeSet<String>, progress: &dyn Progress) -> Result<Option<Measured>, Error> {
        let wanted = self.fields_of(columns);
        let prepared = |episode: &usize| {
            self.origin(*episode).file_name().is_some_and(|name| is_prepared(&name.to_string_lossy()))
        };
        let episodes: Vec<usize> = (0..self.episodes().len()).filter(prepared).collect();
        if wanted.is_empty() || episodes.is_empty() {
            return Ok(None);
        }
        progress.stage("raw logs");
        let mut all = Measured {
            rows: MeasuredRows {
                columns: self.source.columns().to_vec(),
                episodes: self.episodes().to_vec(),
                stamps: vec![ScalarBuffer::from(Vec::new()); self.episodes().len()],
                values: vec![vec![None; self.source.columns().len()]; self.episodes().len()],
            },
            aliases: self.aliases.clone(),
            raw: BTreeMap::new(),
            missing: Vec::new(),
            smoothed: self.smoothed.clone(),
        };
        let rows: usize = episodes.iter().map(|&episode| self.episodes()[episode].rows).sum();
        let needed = rows.saturating_mul(8 * (wanted.len() + 1));
        if let Err(problem) = ensure_memory(needed, "raw measurements", "score the logs in parts") {
            all.missing.push(problem.to_string());
            return Ok(Some(all));
        }
        let mut opened: Option<OpenedRaw> = None;
        let mut raw: Option<(PathBuf, Result<RawSource, String>)> = None;
        let mut was_measured = false;
        for episode in episodes {
            if progress.cancelled() {
                return Err(fleetfoot_data::Cancelled.into());
            }
            let path = self.origin(episode);
            if raw.as_ref().is_none_or(|(known, _)| known != path) {
                raw = Some((path.to_path_buf(), RawSource::of(path, progress)?));
            }
            let raw_log = match &raw {
                Some((_, Ok(raw_log))) => raw_log,
                Some((_, Err(why))) => {
                    was_measured = true;
                    all.miss(why.clone());
                    continue;
                }
                None => continue,
            };
            let names = raw_log.measured(&wanted);
            if names.is_empty() {
                continue;
            }
            was_measured = true;
            match self.read_raw(episode, raw_log, &names, &mut opened, &mut all.rows, progress) {
                Err(cancelled @ Error::Cancelled(_)) => return Err(cancelled),
                Err(problem) => all.miss(format!("{}: its raw log cannot be read: {problem}", path.display())),
                Ok(false) => all.miss(format!(
                    "{}: its raw log {} has no measurement at its rows",
                    path.display(),
                    raw_log.files[0].display()
                )),
                Ok(true) => _ = all.raw.insert(path.to_path_buf(), raw_log.files.clone()),
            }
        }
        Ok(was_measured.then_some(all))
    }

    /// The fields of numbers that these columns are computed from.
    fn fields_of(&self, columns: &BTreeSet<String>) -> BTreeSet<String> {
        let aliases = self.aliases.iter().filter(|(column, _)| columns.contains(&column.name));
        let is_number = |name: &String| {
            let field = self.source.columns().iter().find(|field| field.name == *name);
            field.is_some_and(|field| !matches!(field.kind, ColumnKind::Category(_)))
        };
        let sources = aliases.flat_map(|(_, expression)| expression.sources());
        sources.map(|name| name.to_string()).filter(is_number).collect()
    }

    /// Reads the measurements of an episode; whether there are any.
    fn read_raw(
        &self,
        episode: usize,
        raw_log: &RawSource,
        names: &BTreeSet<String>,
        opened: &mut Option<OpenedRaw>,
        rows: &mut MeasuredRows,
        progress: &dyn Progress,
    ) -> Result<bool, Error> {
        let raw = match opened.take().filter(|raw| raw.serves(raw_log, names)) {
            Some(raw) => raw,
            None => OpenedRaw::new(raw_log, names, progress)?,
        };
        let raw = opened.insert(raw);
        let info = &self.episodes()[episode];
        let block = self.source.read(episode, 0..info.rows, Halo::default())?;
        let seconds: Vec<f64> = block.time.iter().map(|stamp| (stamp - raw_log.raw.start) as f64 * 1e-9).collect();
        let mut any = false;
        for (name, series) in raw.series(&raw_log.raw)? {
            let Some(place) = self.source.column_index(name) else { continue };
            let value = |second: &f64| {
                let sample = series.iter().map(|sample_series| sample_series.at(*second)).find(|value| !value.is_nan());
                sample.unwrap_or(f64::NAN)
            };
            let values: Vec<f64> = seconds.iter().map(value).collect();
            any |= values.iter().any(|value| value.is_finite());
            rows.values[episode][place] = Some(values.into());
        }
        rows.stamps[episode] = block.time;
        Ok(any)
    }
}

impl Measured {
    /// The columns of the data set, of measurements.
    ///
    /// # Errors
    /// Those of [`Dataset::view`].
    pub fn view(&self) -> Result<View<'_>, Error> {
        seen_through(Box::new(Watched::new(&self.rows, None)), &self.aliases)
    }

    /// Returns true if there is no measurement.
    pub fn is_empty(&self) -> bool {
        self.raw.is_empty()
    }

    /// The notes of the data set, with what the raw logs tell in the place of what is said without them.
    pub fn notes(&self, of_dataset: &[String]) -> Vec<String> {
        let mut notes = of_dataset.to_vec();
        if !self.is_empty() && self.missing.is_empty() {
            notes.retain(|note| Some(note) != self.smoothed.as_ref());
        }
        if !self.is_empty() {
            let files: BTreeSet<&PathBuf> = self.raw.values().flatten().collect();
            let logs = if files.len() == 1 { "1 raw log".to_owned() } else { format!("{} raw logs", files.len()) };
            notes.push(format!(
                "`prepare` wrote these logs: errors are against smoothed values; errors called raw are against the measurements of {logs}"
            ));
        }
        if let Some((first, more)) = self.missing.split_first() {
            let more = if more.is_empty() { String::new() } else { format!(" (and {} more)", more.len()) };
            let all = if self.is_empty() {
                "errors are against smoothed values only"
            } else {
                "of some logs errors are against smoothed values only"
            };
            notes.push(format!("{all}: {first}{more}"));
        }
        notes
    }

    fn miss(&mut self, why: String) {
        if !self.missing.contains(&why) {
            self.missing.push(why);
        }
    }
}

impl Source for MeasuredRows {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, DataError> {
        let info = &self.episodes[episode];
        info.check(&rows)?;
        let before = halo.before.min(rows.start);
        let after = halo.after.min(info.rows - rows.end);
        let (first, length) = (rows.start - before, before + rows.len() + after);
        let stamps = &self.stamps[episode];
        let column = |values: &Option<ScalarBuffer<f64>>| match values {
            Some(values) => values.slice(first, length),
            None => vec![f64::NAN; length].into(),
        };
        Ok(Block {
            first: rows.start,
            before,
            rows: rows.len(),
            after,
            start: info.start,
            time: if stamps.is_empty() { vec![info.start; length].into() } else { stamps.slice(first, length) },
            columns: self.values[episode].iter().map(column).collect(),
        })
    }
}
