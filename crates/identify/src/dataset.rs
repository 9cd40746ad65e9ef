//! Logs opened for a recipe or for a model.

mod clock;
mod cost;
mod fields;
mod measured;
mod selection;
mod topics;
mod trained;

use std::{path::Path, sync::atomic::AtomicBool};

use fleetfoot_data::{Column, Episode, Progress, Source, Watch, Watched};
use fleetfoot_library::{Expr, View};
use fleetfoot_log::{Recording, Stamp, TimeSpec, TopicClock, TopicInfo};
use fleetfoot_model::{Column as ModelColumn, Equation, Model, Role, Rule, auxiliary_columns};

use crate::{
    Error, Logs, Recipe,
    clocks::{self, AlignedClock, Clocks},
    condition::Condition,
    labels::Labelled,
    parameters::ParametersTask,
    period,
    sindy::EquationTask,
    statistic::EquationStatistic,
    structure::StructuredTask,
    task::{Aliases, KnownTask, Task, aliases_of_model},
};

pub(crate) use clock::clock_of_model;
use clock::{Clock, clock};
pub(crate) use cost::{estimate, estimate_equations, estimate_structure};
pub(crate) use fields::seen_through;
use fields::{described, explained, fields, unprepared};
use selection::{full_selection, label_names};

/// Logs as the columns of a recipe or a model.
pub struct Dataset {
    source: Labelled<Recording>,
    aliases: Vec<(Column, Expr)>,
    recodings: Vec<(String, Vec<f64>)>,
    clocks: Vec<AlignedClock>,
    /// The same as the join knows them.
    topic_clocks: Vec<TopicClock>,
    /// Of the first log, where a model or a preparation opened it.
    topics: Vec<TopicInfo>,
    notes: Vec<String>,
    /// Looks for rows that trained the model which the logs were opened for.
    watch: Option<Watch>,
    /// Whether all rows have been looked at.
    searched: AtomicBool,
}

/// Files opened for a structured regression.
pub(crate) struct OpenedStructure {
    /// The rows.
    pub(crate) dataset: Dataset,
    /// What the recipe means for them.
    pub(crate) task: StructuredTask,
    /// The recipe with its wildcards written out.
    pub(crate) recipe: Recipe,
    /// The fields of the first file, the labels of `[[episodes]]` among them.
    pub(crate) fields: Vec<Column>,
    /// The recipe's equations for a statistic ([`EquationStatistic::tasks`]), where they were asked for, or why there are none.
    pub(crate) equations: Option<Result<Vec<EquationTask>, Error>>,
}

/// Columns by name, and what they are made of.
struct Named {
    /// The recipe with its wildcards written out.
    recipe: Recipe,
    columns: Vec<ModelColumn>,
    expressions: Vec<(Column, Expr)>,
}

impl Dataset {
    /// Opens files for a recipe; `labels` are the columns that partitions need beside the recipe's.
    pub fn for_recipe(
        recipe: &Recipe,
        labels: &[String],
        logs: impl Into<Logs>,
        progress: &dyn Progress,
    ) -> Result<(Self, Task), Error> {
        let logs = &logs.into();
        let (fields, info) = fields(recipe, logs)?;
        let recipe = &recipe.expand(&fields)?;
        let task = Task::resolve(recipe, &fields, labels, 0.0).map_err(|error| explained(error, info.as_ref()))?;
        let problem = &task.problem;
        let weights = problem.weight.iter();
        let clock = clock(&problem.equations, problem.library.iter().chain(&problem.partition_columns).chain(weights));
        let mut dataset = Self::open(recipe, &problem.columns, &task.aliases, clock, logs, progress)?;
        dataset.see_auxiliary(&problem.columns, &problem.equations)?;
        let mut task = task;
        task.problem.step = dataset.step();
        Ok((dataset, task))
    }

    /// Opens files for a recipe in which every state is given.
    pub(crate) fn for_known(recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<(Self, KnownTask), Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = &recipe.expand(&fields)?;
        let task = KnownTask::resolve(recipe, &fields).map_err(|error| explained(error, info.as_ref()))?;
        let dataset = Self::open(recipe, &task.columns, &task.aliases, Clock::Needed, logs, progress)?;
        Ok((dataset, task))
    }

    /// Opens files for a recipe whose given equations have parameters.
    pub(crate) fn for_parameters(
        recipe: &Recipe,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<(Self, ParametersTask), Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = &recipe.expand(&fields)?;
        let task = ParametersTask::resolve(recipe, &fields).map_err(|error| explained(error, info.as_ref()))?;
        let dataset = Self::open(recipe, &task.known.columns, &task.known.aliases, Clock::Needed, logs, progress)?;
        Ok((dataset, task))
    }

    /// What a recipe means for a structured regression on files: the recipe with its wildcards written out, the fields of the first file (the labels
    /// of `[[episodes]]` among them), and the task.
    pub(crate) fn structure(recipe: &Recipe, logs: &Logs) -> Result<(Recipe, Vec<Column>, StructuredTask), Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = recipe.expand(&fields)?;
        let task = StructuredTask::resolve(&recipe, &fields).map_err(|error| explained(error, info.as_ref()))?;
        Ok((recipe, fields, task))
    }

    /// Opens files for a structured regression.
    pub(crate) fn for_structure(
        recipe: &Recipe,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<OpenedStructure, Error> {
        let (recipe, fields, task) = Self::structure(recipe, logs)?;
        let clock = clock(&task.equations, task.expressions());
        let dataset = Self::open(&recipe, &task.columns, &task.aliases, clock, logs, progress)?;
        Ok(OpenedStructure { dataset, task, recipe, fields, equations: None })
    }

    /// [`Dataset::for_structure`] that reads also what the recipe's equations need, where they are asked for and a statistic can serve them. Then the files are
    /// opened as for a fit of the equations, so that the episodes have the same identities.
    pub(crate) fn for_scan(
        recipe: &Recipe,
        logs: &Logs,
        equations: bool,
        progress: &dyn Progress,
    ) -> Result<OpenedStructure, Error> {
        let (recipe, fields, task) = Self::structure(recipe, logs)?;
        let equations = equations.then(|| EquationStatistic::tasks(&recipe, &fields));
        let (columns, aliases, clock) = match &equations {
            Some(Ok(tasks)) => {
                let (mut columns, mut aliases) = (Vec::new(), Vec::new());
                for (column, alias) in tasks.iter().flat_map(|task| task.columns.iter().zip(&task.aliases)) {
                    if !columns.iter().any(|known: &ModelColumn| known.name == column.name) {
                        columns.push(column.clone());
                        aliases.push(alias.clone());
                    }
                }
                let expressions = tasks.iter().flat_map(EquationTask::expressions);
                (columns, aliases, clock(&tasks[0].equations, expressions))
            }
            _ => (task.columns.clone(), task.aliases.clone(), clock(&task.equations, task.expressions())),
        };
        let dataset = Self::open(&recipe, &columns, &aliases, clock, logs, progress)?;
        Ok(OpenedStructure { dataset, task, recipe, fields, equations })
    }

    /// What a recipe means for a fit of equations on files, with its wildcards written out.
    fn equations(recipe: &Recipe, logs: &Logs) -> Result<(Recipe, EquationTask), Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = recipe.expand(&fields)?;
        let task = EquationTask::resolve(&recipe, &fields).map_err(|error| explained(error, info.as_ref()))?;
        Ok((recipe, task))
    }

    /// Opens files for a fit of equations.
    ///
    /// # Errors
    /// Those of the recipe and of opening.
    pub fn for_equations(
        recipe: &Recipe,
        logs: impl Into<Logs>,
        progress: &dyn Progress,
    ) -> Result<(Self, EquationTask), Error> {
        let logs = &logs.into();
        let (recipe, task) = Self::equations(recipe, logs)?;
        let clock = clock(&task.equations, task.expressions());
        let mut dataset = Self::open(&recipe, &task.columns, &task.aliases, clock, logs, progress)?;
        dataset.see_auxiliary(&task.columns, &task.equations)?;
        Ok((dataset, task))
    }

    /// Opens logs for columns: aliases of the recipe, fields, or expressions over both. Without names: the recipe's states and inputs, else its
    /// aliases, else all fields.
    ///
    /// # Errors
    /// A name that is none, no column at all; those of opening.
    pub fn for_columns(
        recipe: &Recipe,
        names: Option<&[String]>,
        logs: impl Into<Logs>,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let logs = &logs.into();
        let named = Self::named(recipe, names, logs)?;
        Self::open(&named.recipe, &named.columns, &named.expressions, Clock::Needed, logs, progress)
    }

    /// [`Dataset::for_columns`] of logs whose clocks are known.
    pub(crate) fn for_columns_by(
        recipe: &Recipe,
        names: &[String],
        clocks: Clocks,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let Named { recipe, columns, expressions } = Self::named(recipe, Some(names), logs)?;
        Self::open_by(&recipe, &columns, &expressions, Clock::Needed, clocks, logs, progress)
    }

    /// What the clocks of a recipe show in these logs.
    pub(crate) fn find_clocks(recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<Clocks, Error> {
        if recipe.clocks.is_empty() {
            return Ok(Clocks::default());
        }
        let info = fields(recipe, logs)?.1;
        let topics: Vec<String> =
            info.into_iter().flat_map(|info| info.topics).map(|topic: TopicInfo| topic.name).collect();
        clocks::find(recipe, logs, &topics, progress)
    }

    /// Opens logs for columns of one topic alone, aliases or expressions: the rows are the topic's own samples, at stamps that are corrected by the clocks which are known already.
    pub(crate) fn for_channels(
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
        Self::open_by(&recipe, &columns, &expressions, Clock::Needed, clocks, logs, progress)
    }

    /// The columns of [`Dataset::for_columns`].
    fn named(recipe: &Recipe, names: Option<&[String]>, logs: &Logs) -> Result<Named, Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = recipe.expand(&fields)?;
        let mut aliases = Aliases::of_recipe(&recipe, &fields)?;
        let readable = |field: &&Column| {
            let of_file = info.iter().flat_map(|info| &info.columns).find(|column| column.name == field.name);
            of_file.is_none_or(|column| column.unsupported.is_none())
        };
        let named: Vec<String> = match names {
            Some(names) => names.to_vec(),
            // What a fit sees; a recipe may name more.
            None if !aliases.columns.is_empty() => Vec::new(),
            None if !recipe.columns.is_empty() => recipe.columns.keys().cloned().collect(),
            None => fields.iter().filter(readable).map(|field| field.name.clone()).collect(),
        };
        for name in &named {
            let text = (!aliases.has(name)).then_some(name.as_str());
            aliases
                .add(name, text, None, Role::Auxiliary, false, "the columns")
                .map_err(|error| explained(error, info.as_ref()))?;
        }
        let (mut columns, mut expressions) = (aliases.columns, aliases.expressions);
        if names.is_some() {
            let place = |name: &String| columns.iter().position(|column| column.name == *name);
            let places: Vec<usize> = named.iter().filter_map(place).collect();
            columns = places.iter().map(|&at| columns[at].clone()).collect();
            expressions = places.iter().map(|&at| expressions[at].clone()).collect();
        }
        if columns.is_empty() {
            return Err(Error::missing("there is no column to read: name some".into()));
        }
        Ok(Named { recipe, columns, expressions })
    }

    /// Opens logs for preparation: what the fits of a recipe would read, without what they compute. The recipe's wildcards are written out.
    pub(crate) fn for_preparation(
        recipe: &Recipe,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<(Self, Recipe, Vec<ModelColumn>), Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = recipe.expand(&fields)?;
        let aliases = crate::prepare::aliases(&recipe, &fields).map_err(|error| explained(error, info.as_ref()))?;
        let (columns, expressions) = (aliases.columns, aliases.expressions);
        if columns.is_empty() {
            return Err(Error::missing("there is nothing to prepare: name states in the recipe ([states])".into()));
        }
        let mut dataset = Self::open(&recipe, &columns, &expressions, Clock::Needed, logs, progress)?;
        dataset.topics = info.map_or_else(Vec::new, |info| info.topics);
        Ok((dataset, recipe, columns))
    }

    /// Sees the same fields through other aliases from now on.
    pub(crate) fn see(&mut self, aliases: &[(Column, Expr)]) {
        self.aliases = described(&self.source, aliases);
    }

    /// Sees also the columns that a simulation of a model of these columns and equations may read beside them.
    fn see_auxiliary(&mut self, columns: &[ModelColumn], equations: &[Equation]) -> Result<(), Error> {
        let auxiliary = auxiliary_columns(columns, equations);
        let aliases = aliases_of_model(&auxiliary, self.source.columns())?;
        self.aliases.extend(described(&self.source, &aliases));
        Ok(())
    }

    /// Opens files for a model: its columns, clock and labels are those of its training.
    ///
    /// # Errors
    /// A column that the files do not have; those of opening; [`Error::OtherPeriod`].
    pub fn for_model(
        model: &Model,
        changes: &Recipe,
        logs: impl Into<Logs>,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        Self::for_every_row(model, changes, logs, 1, progress)
    }

    /// [`Dataset::for_model`] where every `every`-th row will be used.
    pub(crate) fn for_every_row(
        model: &Model,
        changes: &Recipe,
        logs: impl Into<Logs>,
        every: usize,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        Self::with_model(model, changes, &logs.into(), (&|_| true, every), progress)
    }

    /// [`Dataset::for_model`] on files that may lack columns which are not needed, as those that only say what there is to compare with.
    pub(crate) fn for_run(
        model: &Model,
        changes: &Recipe,
        logs: impl Into<Logs>,
        needed: &dyn Fn(&str) -> bool,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        Self::with_model(model, changes, &logs.into(), (needed, 1), progress)
    }

    /// The recipe by which a model reads logs: its own, with what is said of these logs.
    pub(crate) fn recipe_of_run(model: &Model, changes: &Recipe) -> Result<Recipe, Error> {
        let mut recipe = Recipe::parse(&model.training.recipe, "the model's recipe")?;
        // What the caller says about the clock of these files replaces what training said.
        if changes.time.column.is_some() || changes.time.dt.is_some() {
            recipe.time.column = changes.time.column.clone();
            recipe.time.unit = changes.time.unit.clone();
            recipe.time.dt = changes.time.dt;
        }
        recipe.time.max_gap = changes.time.max_gap.clone().or(recipe.time.max_gap);
        recipe.time.only = changes.time.only.clone().or(recipe.time.only);
        recipe.time.stamp = changes.time.stamp.clone().or(recipe.time.stamp);
        recipe.time.reorder = changes.time.reorder.or(recipe.time.reorder);
        if changes.time.base.is_some() || changes.time.rate.is_some() {
            recipe.time.base = changes.time.base.clone();
            recipe.time.rate = changes.time.rate;
        }
        // Names of files' topics belong to those files; a model knows its own.
        recipe.rename = changes.rename.clone();
        if !changes.clocks.is_empty() {
            recipe.clocks = changes.clocks.clone();
        }
        recipe.cache = changes.cache.clone();
        if !changes.episodes.is_empty() {
            recipe.episodes = changes.episodes.clone();
        }
        Ok(recipe)
    }

    /// Which columns must be there, and which row is used.
    fn with_model(
        model: &Model,
        changes: &Recipe,
        logs: &Logs,
        (needed, every): (&dyn Fn(&str) -> bool, usize),
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let recipe = Self::recipe_of_run(model, changes)?;
        let (fields, info) = fields(&recipe, logs)?;
        let (columns, absent): (Vec<ModelColumn>, Vec<ModelColumn>) =
            model.columns.iter().cloned().partition(|column| {
                needed(&column.name) || aliases_of_model(std::slice::from_ref(column), &fields).is_ok()
            });
        // What a simulation may read beside them; one that needs what is not there says so.
        let auxiliary = model.auxiliary_columns().into_iter();
        let there = |column: &ModelColumn| aliases_of_model(std::slice::from_ref(column), &fields).is_ok();
        let columns: Vec<ModelColumn> = columns.into_iter().chain(auxiliary.filter(there)).collect();
        let why = |error| unprepared(explained(error, info.as_ref()), &recipe);
        let aliases = aliases_of_model(&columns, &fields).map_err(why)?;
        let mut dataset = Self::open(&recipe, &columns, &aliases, clock_of_model(model), logs, progress)?;
        dataset.topics = info.map_or_else(Vec::new, |info| info.topics);
        if !absent.is_empty() {
            let names: Vec<&str> = absent.iter().map(|column| column.name.as_str()).collect();
            let note =
                format!("the recording has no {}: nothing is compared with what it would measure", names.join(", "));
            dataset.notes.push(note);
        }
        dataset.recode(model);
        dataset.watch = Watch::new(&fleetfoot_model::known(&model.training.episodes), dataset.source.columns());
        if !dataset.source.inner().without_clock() {
            let note = period::check(model, &dataset, every)?;
            dataset.notes.extend(note);
        }
        Ok(dataset)
    }

    fn open(
        recipe: &Recipe,
        model: &[ModelColumn],
        aliases: &[(Column, Expr)],
        clock: Clock,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let clocks = Self::find_clocks(recipe, logs, progress)?;
        Self::open_by(recipe, model, aliases, clock, clocks, logs, progress)
    }

    /// Opens logs whose clocks are known.
    fn open_by(
        recipe: &Recipe,
        model: &[ModelColumn],
        aliases: &[(Column, Expr)],
        clock: Clock,
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
        if let Clock::Dispensable { ordered } = clock
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
        let recording = fleetfoot_log::open_logs(logs.all(), &selection, progress)?;
        let mut notes = recording.notes().to_vec();
        notes.extend(clocks.notes);
        let recording = match condition {
            Some(condition) => {
                let (runs, told) = condition.runs(&Labelled::new(Watched::new(&recording, None), &labels), progress)?;
                notes.push(told);
                recording.parts(&runs, &selection, progress)?
            }
            None => recording,
        };
        if recording.without_clock() {
            notes
                .push("the rows have no time stamps: they are taken in their order, which only lags would need".into());
        }
        let source = Labelled::new(recording, &labels);
        let aliases = described(&source, aliases);
        Ok(Self {
            source,
            aliases,
            recodings: Vec::new(),
            clocks: clocks.reports,
            topic_clocks,
            topics: Vec::new(),
            notes,
            watch: None,
            searched: AtomicBool::new(false),
        })
    }

    /// Gives category columns the codes that the model's labels had in training.
    fn recode(&mut self, model: &Model) {
        for partition in &model.partitions {
            let Rule::Labels { values, names, .. } = &partition.rule else { continue };
            let Some(label) = partition.columns.last().and_then(Expr::as_column) else { continue };
            let Some((column, _)) = self.aliases.iter().find(|(column, _)| column.name == label) else { continue };
            if let fleetfoot_data::ColumnKind::Category(here) = &column.kind {
                let known = |name: &String| names.iter().position(|known| known == name).map(|at| values[at]);
                // Codes below zero are no label of the model.
                let table =
                    here.iter().enumerate().map(|(code, name)| known(name).unwrap_or(-1.0 - code as f64)).collect();
                self.recodings.push((label.to_owned(), table));
            }
        }
    }

    /// The source that fits, scores and rollouts read: the aliases as columns. Filters in them are computed from the fields.
    ///
    /// # Errors
    /// An alias reads what is not there, or a filter's constant is out of its range.
    pub fn view(&self) -> Result<View<'_>, Error> {
        let mut view = seen_through(Box::new(Watched::new(&self.source, self.watch.as_ref())), &self.aliases)?;
        for (column, values) in &self.recodings {
            view.recode(column, values.clone());
        }
        Ok(view)
    }

    /// The episodes.
    pub fn episodes(&self) -> &[Episode] {
        self.source.episodes()
    }

    /// What must be added to an episode's stamps to get the times of its recording, nanoseconds.
    pub fn log_offset(&self, episode: usize) -> i64 {
        self.source.inner().log_offset(episode)
    }

    /// The path of the file that an episode comes from; of a table its name.
    pub(crate) fn origin(&self, episode: usize) -> &Path {
        self.source.inner().origin(episode)
    }

    /// What had to be assumed or left out while opening.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The clocks of other computers that were found, log by log.
    pub fn clocks(&self) -> &[AlignedClock] {
        &self.clocks
    }

    /// What these clocks show, for the join of the same logs once more.
    pub(crate) fn topic_clocks(&self) -> &[TopicClock] {
        &self.topic_clocks
    }

    /// The aliases, and the expressions over fields that give them.
    pub(crate) fn aliases(&self) -> &[(Column, Expr)] {
        &self.aliases
    }

    /// The fields as a source.
    pub(crate) fn source(&self) -> &dyn Source {
        &self.source
    }

    /// The fields that are read, and the labels.
    pub(crate) fn fields(&self) -> &[Column] {
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
        period::of_most(self.episodes())
    }
}
