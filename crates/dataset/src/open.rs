//! Opening of logs with the columns of a recipe.

mod cost;
mod measured;
mod model;

pub use cost::{estimate, estimate_equations, estimate_structure};
use fleetfoot_data::setting::STATES_SECTION;
use fleetfoot_data::{Column, Progress, Source};
use fleetfoot_library::Expr;
use fleetfoot_log::TopicInfo;
use fleetfoot_model::{Column as ModelColumn, Equation, auxiliary_columns};
use fleetfoot_recipe::{Recipe, aliases_of_model};
use fleetfoot_task::{EquationTask, KnownTask, ParametersTask, StructuredTask, Task, prepared};

use crate::{
    clocks,
    dataset::{Dataset, Reads, described, explained, fields, idle_joins, reads},
    error::Error,
    estimated_clocks::Clocks,
    logs::Logs,
    stats_file::EquationStatistic,
};

/// Files opened for a structured regression.
pub struct OpenedStructure {
    /// The rows.
    pub dataset: Dataset,
    /// Task that the recipe defines for these logs.
    pub task: StructuredTask,
    /// The recipe with its wildcards written out.
    pub recipe: Recipe,
    /// The fields of the first file, the labels of `[[episodes]]` among them.
    pub fields: Vec<Column>,
    /// The recipe's equations for a statistic ([`EquationStatistic::tasks`]), if requested, or the reason why there are
    /// none.
    pub equations: Option<Result<Vec<EquationTask>, Error>>,
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
        let task =
            Task::resolve(recipe, &fields, labels, 0.0).map_err(|error| explained(error, info.as_ref(), logs))?;
        let problem = &task.problem;
        let weights = problem.weight.iter();
        // A phase that is text is one of labels.
        let phase = task.phase.iter().map(|phase| &phase.column).filter(|column| column.as_column().is_none());
        let reads = reads(
            &problem.equations,
            problem.library.iter().chain(&problem.partition_columns).chain(weights).chain(phase),
        );
        let mut dataset = Self::open(recipe, &problem.columns, &task.aliases, reads, logs, progress)?;
        dataset.see_auxiliary(&problem.columns, &problem.equations)?;
        let mut task = task;
        task.problem.step = dataset.step();
        Ok((dataset, task))
    }

    /// Opens files for a recipe in which every state is given.
    pub fn for_known(recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<(Self, KnownTask), Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = &recipe.expand(&fields)?;
        let task = KnownTask::resolve(recipe, &fields).map_err(|error| explained(error, info.as_ref(), logs))?;
        let reads = reads(&task.equations, std::iter::empty());
        let dataset = Self::open(recipe, &task.columns, &task.aliases, reads, logs, progress)?;
        Ok((dataset, task))
    }

    /// Opens files for a recipe whose given equations have parameters.
    pub fn for_parameters(
        recipe: &Recipe,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<(Self, ParametersTask), Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = &recipe.expand(&fields)?;
        let task = ParametersTask::resolve(recipe, &fields).map_err(|error| explained(error, info.as_ref(), logs))?;
        let reads = reads(&task.known.equations, std::iter::empty());
        let dataset = Self::open(recipe, &task.known.columns, &task.known.aliases, reads, logs, progress)?;
        Ok((dataset, task))
    }

    /// Resolves a recipe for a structured regression on files. Returns the recipe with its wildcards written out, the
    /// fields of the first file (the labels of `[[episodes]]` among them), and the task.
    pub fn structure(recipe: &Recipe, logs: &Logs) -> Result<(Recipe, Vec<Column>, StructuredTask), Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = recipe.expand(&fields)?;
        let task = StructuredTask::resolve(&recipe, &fields).map_err(|error| explained(error, info.as_ref(), logs))?;
        Ok((recipe, fields, task))
    }

    /// Opens files for a structured regression.
    pub fn for_structure(recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<OpenedStructure, Error> {
        let (recipe, fields, task) = Self::structure(recipe, logs)?;
        let reads = reads(&task.equations, task.expressions());
        let dataset = Self::open(&recipe, &task.columns, &task.aliases, reads, logs, progress)?;
        Ok(OpenedStructure { dataset, task, recipe, fields, equations: None })
    }

    /// [`Dataset::for_structure`] that reads also what the recipe's equations need, where they are asked for and a statistic can serve them. Then the files are
    /// opened as for a fit of the equations, so that the episodes have the same identities.
    pub fn for_scan(
        recipe: &Recipe,
        logs: &Logs,
        equations: bool,
        progress: &dyn Progress,
    ) -> Result<OpenedStructure, Error> {
        let (recipe, fields, task) = Self::structure(recipe, logs)?;
        let equations = equations.then(|| EquationStatistic::tasks(&recipe, &fields));
        let (columns, aliases, reads) = match &equations {
            Some(Ok(tasks)) => {
                let (mut columns, mut aliases) = (Vec::new(), Vec::new());
                for (column, alias) in tasks.iter().flat_map(|task| task.columns.iter().zip(&task.aliases)) {
                    if !columns.iter().any(|known: &ModelColumn| known.name == column.name) {
                        columns.push(column.clone());
                        aliases.push(alias.clone());
                    }
                }
                let expressions = tasks.iter().flat_map(EquationTask::expressions);
                (columns, aliases, reads(&tasks[0].equations, expressions))
            }
            _ => (task.columns.clone(), task.aliases.clone(), reads(&task.equations, task.expressions())),
        };
        let dataset = Self::open(&recipe, &columns, &aliases, reads, logs, progress)?;
        Ok(OpenedStructure { dataset, task, recipe, fields, equations })
    }

    /// Resolves a recipe for a fit of equations on files: the recipe with its wildcards written out, and the task.
    pub fn equations(recipe: &Recipe, logs: &Logs) -> Result<(Recipe, EquationTask), Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = recipe.expand(&fields)?;
        let task = EquationTask::resolve(&recipe, &fields).map_err(|error| explained(error, info.as_ref(), logs))?;
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
        let reads = reads(&task.equations, task.expressions());
        let mut dataset = Self::open(&recipe, &task.columns, &task.aliases, reads, logs, progress)?;
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
        Self::open(&named.recipe, &named.columns, &named.expressions, Reads::columns(), logs, progress)
    }

    /// Finds the offsets of a recipe's clocks in these logs.
    pub fn find_clocks(recipe: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<Clocks, Error> {
        if recipe.clocks.is_empty() {
            return Ok(Clocks::default());
        }
        let info = fields(recipe, logs)?.1;
        let topics: Vec<String> =
            info.into_iter().flat_map(|info| info.topics).map(|topic: TopicInfo| topic.name).collect();
        clocks::find(recipe, logs, &topics, progress)
    }

    /// Opens logs for preparation: what the fits of a recipe would read, without what they compute. The recipe's wildcards are written out.
    pub fn for_preparation(
        recipe: &Recipe,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<(Self, Recipe, Vec<ModelColumn>), Error> {
        let (fields, info) = fields(recipe, logs)?;
        let recipe = recipe.expand(&fields)?;
        let aliases = prepared(&recipe, &fields).map_err(|error| explained(error, info.as_ref(), logs))?;
        let (columns, expressions) = (aliases.columns, aliases.expressions);
        if columns.is_empty() {
            return Err(Error::missing(format!(
                "there is nothing to prepare: name states in the recipe ({STATES_SECTION})"
            )));
        }
        let mut dataset = Self::open(&recipe, &columns, &expressions, Reads::columns(), logs, progress)?;
        dataset.topics = info.map_or_else(Vec::new, |info| info.topics);
        Ok((dataset, recipe, columns))
    }

    /// Sees also the columns that a simulation of a model of these columns and equations may read beside them.
    fn see_auxiliary(&mut self, columns: &[ModelColumn], equations: &[Equation]) -> Result<(), Error> {
        let auxiliary = auxiliary_columns(columns, equations);
        let aliases = aliases_of_model(&auxiliary, self.source.columns())?;
        self.aliases.extend(described(&self.source, &aliases));
        Ok(())
    }

    fn open(
        recipe: &Recipe,
        model: &[ModelColumn],
        aliases: &[(Column, Expr)],
        reads: Reads,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let clocks = Self::find_clocks(recipe, logs, progress)?;
        let mut dataset = Self::open_by(recipe, model, aliases, reads, clocks, logs, progress)?;
        let idle = idle_joins(recipe, &dataset.columns(), logs)?;
        dataset.notes.extend(idle);
        Ok(dataset)
    }
}
