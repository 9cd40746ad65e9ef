//! Logs as columns: opening them, and viewing them through a recipe.

mod beside;
mod clock;
mod fields;
mod period;
mod selection;
mod smoothed;
mod topics;
mod trained;

use std::{
    path::{Path, PathBuf},
    sync::atomic::AtomicBool,
};

use clock::Clock;
pub use clock::reads_of_model;
pub(crate) use clock::{Reads, reads};
pub(crate) use fields::{described, explained, fields, idle_joins, unprepared};
use fleetfoot_data::setting::FILES;
use fleetfoot_data::{Column, Episode, Progress, Source, Watch, Watched};
use fleetfoot_library::Expr;
use fleetfoot_log::{ClockSummary, Recording, Stamp, TimeSpec, TopicClock, TopicInfo};
use fleetfoot_model::{Column as ModelColumn, Role};
use fleetfoot_recipe::{Aliases, Recipe};
pub(crate) use period::of_most;
pub(crate) use selection::full_selection;
use selection::label_names;

use crate::{
    condition::Condition,
    error::Error,
    estimated_clocks::{AlignedClock, Clocks},
    hold_out::Part,
    labels::Labelled,
    logs::Logs,
    rotations::{Recorded, UnitRotations},
    text::refuse_text,
    view::seen_through,
};

/// Logs as the columns of a recipe or a model.
pub struct Dataset {
    pub(crate) source: Labelled<Recording>,
    pub(crate) aliases: Vec<(Column, Expr)>,
    pub(crate) recodings: Vec<(String, Vec<f64>)>,
    /// The rotations among the columns that are read for a model or a recipe.
    pub(crate) rotations: Vec<Recorded>,
    pub(crate) clocks: Vec<AlignedClock>,
    /// The same as the join knows them.
    pub(crate) topic_clocks: Vec<TopicClock>,
    /// Of the first log, where a model or a preparation opened it.
    pub(crate) topics: Vec<TopicInfo>,
    pub(crate) notes: Vec<String>,
    /// The note on prepared logs, which is one of the notes.
    pub(crate) smoothed: Option<String>,
    /// Looks for rows that trained the model which the logs were opened for.
    pub(crate) watch: Option<Watch>,
    /// True if all rows were searched.
    pub(crate) searched: AtomicBool,
}

/// Columns by name, and what they are made of.
pub(crate) struct Named {
    /// The recipe with its wildcards written out.
    pub(crate) recipe: Recipe,
    pub(crate) columns: Vec<ModelColumn>,
    pub(crate) expressions: Vec<(Column, Expr)>,
}

impl Dataset {
    /// [`Dataset::for_columns`] of logs whose clocks are known.
    pub fn for_columns_by(
        recipe: &Recipe,
        names: &[String],
        clocks: Clocks,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let Named { recipe, columns, expressions } = Self::named(recipe, Some(names), logs)?;
        Self::open_by(&recipe, &columns, &expressions, Reads::numbers(names), clocks, logs, progress)
    }

    /// Opens logs for columns of one topic alone, aliases or expressions: the rows are the topic's own samples, at stamps that are corrected by the clocks which are known already.
    pub fn for_channels(
        recipe: &Recipe,
        channels: &[String],
        known: &[TopicClock],
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let mut recipe = recipe.clone();
        recipe.clocks.clear();
        (recipe.time.base, recipe.time.rate, recipe.time.only) = (None, None, None);
        let Named { recipe, columns, expressions } = Self::named(&recipe, Some(channels), logs)?;
        let clocks = Clocks { topics: known.to_vec(), ..Clocks::default() };
        Self::open_by(&recipe, &columns, &expressions, Reads::numbers(channels), clocks, logs, progress)
    }

    /// The columns of [`Dataset::for_columns`].
    pub(crate) fn named(recipe: &Recipe, names: Option<&[String]>, logs: &Logs) -> Result<Named, Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = recipe.expand(&fields)?;
        let mut aliases = Aliases::of_recipe(&recipe, &fields)?;
        let readable = |field: &&Column| {
            let of_file = info.iter().flat_map(|info| &info.columns).find(|column| column.name == field.name);
            of_file.is_none_or(|column| column.unsupported.is_none())
        };
        let named: Vec<String> = match names {
            Some(names) => names.to_vec(),
            // Fields that a fit reads; a recipe may name more.
            None if !aliases.columns.is_empty() => Vec::new(),
            None if !recipe.columns.is_empty() => recipe.columns.keys().cloned().collect(),
            None => fields.iter().filter(readable).map(|field| field.name.clone()).collect(),
        };
        for name in &named {
            let text = (!aliases.has(name)).then_some(name.as_str());
            aliases
                .add(name, text, None, Role::Auxiliary, false, "the columns")
                .map_err(|error| explained(error, info.as_ref(), logs))?;
        }
        let (mut columns, mut expressions) = (aliases.columns, aliases.expressions);
        if names.is_some() {
            let place = |name: &String| columns.iter().position(|column| column.name == *name);
            let places: Vec<usize> = named.iter().filter_map(place).collect();
            columns = places.iter().map(|&at| columns[at].clone()).collect();
            expressions = places.iter().map(|&at| expressions[at].clone()).collect();
        }
        if columns.is_empty() {
            return Err(Error::missing("no column is named: name the columns to read".into()));
        }
        Ok(Named { recipe, columns, expressions })
    }

    /// Sees the same fields through other aliases from now on.
    pub fn see(&mut self, aliases: &[(Column, Expr)]) {
        self.aliases = described(&self.source, aliases);
    }

    /// Opens logs whose clocks are known.
    pub(crate) fn open_by(
        recipe: &Recipe,
        model: &[ModelColumn],
        aliases: &[(Column, Expr)],
        reads: Reads,
        clocks: Clocks,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let labels = label_names(recipe);
        progress.stage("open");
        let mut selection = full_selection(recipe, model, aliases)?;
        let condition = match recipe.time.only {
            Some(_) => Condition::of(recipe, &fields(recipe, logs)?.0)?,
            None => None,
        };
        let labelled = |field: &String| labels.contains(field);
        selection.columns.extend(condition.iter().flat_map(Condition::sources).filter(|field| !labelled(field)));
        selection.columns.sort();
        selection.columns.dedup();
        let timed = aliases.iter().any(|(_, expression)| expression.reads_clock());
        if let Clock::Dispensable { ordered } = reads.clock
            && !timed
            && selection.time == TimeSpec::Auto
        {
            let ordered = ordered || aliases.iter().any(|(_, expression)| expression.reads_other_rows());
            selection.time = TimeSpec::Dispensable { ordered };
        }
        // Log times are of one clock; what is corrected are the stamps of those who measured.
        if !clocks.topics.is_empty() && selection.time == TimeSpec::Auto {
            selection.join.stamp.get_or_insert(Stamp::Header);
        }
        let topic_clocks = clocks.topics.clone();
        selection.join.clocks = clocks.topics;
        let (grouped, others) = logs.by(recipe)?;
        let recording = grouped
            .recording(&selection, progress)
            .map_err(|error| beside::of_no_column(error, recipe, &selection.columns, logs.len()))?;
        let mut notes = recording.notes().to_vec();
        if let Some((first, more)) = others.split_first() {
            let more = if more.is_empty() { String::new() } else { format!(", nor {} further files", more.len()) };
            notes.push(format!("{}: no pattern of {FILES} matches it{more}: not read", first.display()));
        }
        notes.extend(clocks.notes);
        let smoothed = smoothed::truth(logs);
        notes.extend(smoothed.clone());
        let recording = match condition {
            Some(condition) => {
                let (runs, condition_notes) =
                    condition.runs(&Labelled::new(Watched::new(&recording, None), &labels), progress)?;
                notes.push(condition_notes);
                recording.parts(&runs, &selection, progress)?
            }
            None => recording,
        };
        let recording = match logs.part() {
            Part::All => recording,
            part => {
                let step = if recording.without_clock() { 0.0 } else { of_most(recording.episodes()) };
                let apart = recipe.time.smoothed.filter(|_| step > 0.0).map_or(0.0, |seconds| (seconds / step).ceil());
                let rows: Vec<usize> = recording.episodes().iter().map(|episode| episode.rows).collect();
                recording.parts(&part.of(&rows, apart as usize)?, &selection, progress)?
            }
        };
        if recording.without_clock() {
            notes.push("the rows have no time stamps and are used in their order, which matters for lags only".into());
        }
        let source = Labelled::new(recording, &labels);
        refuse_text(&source, (model, aliases), &reads.numbers)?;
        let aliases = described(&source, aliases);
        Ok(Self {
            source,
            aliases,
            recodings: Vec::new(),
            rotations: Recorded::among(model),
            clocks: clocks.reports,
            topic_clocks,
            topics: Vec::new(),
            notes,
            smoothed,
            watch: None,
            searched: AtomicBool::new(false),
        })
    }

    /// The source that fits, scores and rollouts read: the aliases as columns, rotations settled. Filters in them are computed from the fields.
    ///
    /// # Errors
    /// An alias reads what is not there, or a filter's constant is out of its range.
    pub fn view(&self) -> Result<UnitRotations<'_>, Error> {
        let mut view = seen_through(Box::new(Watched::new(&self.source, self.watch.as_ref())), &self.aliases)?;
        for (column, values) in &self.recodings {
            view.recode(column, values.clone());
        }
        Ok(UnitRotations::new(view, &self.rotations, &self.source, &self.aliases))
    }

    /// The episodes.
    pub fn episodes(&self) -> &[Episode] {
        self.source.episodes()
    }

    /// Offset to add to an episode's stamps for the times of its recording, nanoseconds.
    pub fn log_offset(&self, episode: usize) -> i64 {
        self.source.inner().log_offset(episode)
    }

    /// The path of the file that an episode comes from; of a table its name.
    pub fn origin(&self, episode: usize) -> &Path {
        self.source.inner().origin(episode)
    }

    /// The files that an episode's log is read from: one, or those of a run or of a recording that was split; none of a table in memory.
    pub fn files_of(&self, episode: usize) -> &[PathBuf] {
        self.source.inner().files_of(episode)
    }

    /// The files, in the order of their episodes, with counts of their stamps.
    pub fn files(&self) -> impl Iterator<Item = (&Path, &ClockSummary)> {
        self.source.inner().files()
    }

    /// Notes on assumptions and omissions made while opening.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The clocks of other computers that were found, log by log.
    pub fn clocks(&self) -> &[AlignedClock] {
        &self.clocks
    }

    /// Clocks of the topics, for a second join of the same logs.
    pub fn topic_clocks(&self) -> &[TopicClock] {
        &self.topic_clocks
    }

    /// The aliases, and the expressions over fields that give them.
    pub fn aliases(&self) -> &[(Column, Expr)] {
        &self.aliases
    }

    /// The fields as a source.
    pub fn source(&self) -> &dyn Source {
        &self.source
    }

    /// The fields that are read, and the labels.
    pub fn fields(&self) -> &[Column] {
        self.source.columns()
    }

    /// The fields that are read.
    pub fn columns(&self) -> Vec<String> {
        self.source.columns().iter().map(|column| column.name.clone()).collect()
    }

    /// Rows of all episodes.
    pub fn rows(&self) -> usize {
        self.source.rows()
    }

    /// The sampling period of most rows, seconds; 0 where no stamps are known.
    pub fn step(&self) -> f64 {
        if self.source.inner().without_clock() {
            return 0.0;
        }
        of_most(self.episodes())
    }
}
