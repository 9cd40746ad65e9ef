//! Logs opened for a model.

use fleetfoot_data::{ColumnKind, Progress, Source, Watch};
use fleetfoot_library::Expr;
use fleetfoot_model::{Column as ModelColumn, Model, Rule};
use fleetfoot_recipe::{Error as RecipeError, Recipe, aliases_of_model};

use crate::{
    dataset::{Dataset, explained, fields, reads_of_model, unprepared},
    error::Error,
    logs::Logs,
    period,
};

/// The error of a column that logs lack, with the model.
fn of_model(error: Error, model: &Model) -> Error {
    match error {
        Error::Recipe(RecipeError::UnknownColumn { place, name, candidates }) => {
            let place = format!("{place} {} ({})", model.hash(), model.method);
            RecipeError::UnknownColumn { place, name, candidates }.into()
        }
        other => other,
    }
}

impl Dataset {
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
    pub fn for_every_row(
        model: &Model,
        changes: &Recipe,
        logs: impl Into<Logs>,
        every: usize,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        Self::with_model(model, changes, &logs.into(), (&|_| true, every), progress)
    }

    /// [`Dataset::for_model`] on files that may lack columns which are not needed, as those that only say what there is to compare with.
    pub fn for_run(
        model: &Model,
        changes: &Recipe,
        logs: impl Into<Logs>,
        needed: &dyn Fn(&str) -> bool,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        Self::with_model(model, changes, &logs.into(), (needed, 1), progress)
    }

    /// The recipe by which a model reads logs: its own, with what is said of these logs.
    pub fn recipe_of_run(model: &Model, changes: &Recipe) -> Result<Recipe, Error> {
        let mut recipe = Recipe::parse(&model.training.recipe, "the model's recipe")?;
        // The caller's clock of these files replaces that of the training.
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
        if !changes.files.is_empty() {
            recipe.files = changes.files.clone();
        }
        if !changes.clocks.is_empty() {
            recipe.clocks = changes.clocks.clone();
        }
        recipe.cache = changes.cache.clone();
        if !changes.episodes.is_empty() {
            recipe.episodes = changes.episodes.clone();
        }
        Ok(recipe)
    }

    /// Opens logs for a model. `needed` selects the columns that must exist, and one row of `every` is used.
    pub(crate) fn with_model(
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
        // Auxiliary columns that a simulation may read; a simulation that needs a missing column reports it.
        let auxiliary = model.auxiliary_columns().into_iter();
        let there = |column: &ModelColumn| aliases_of_model(std::slice::from_ref(column), &fields).is_ok();
        let columns: Vec<ModelColumn> = columns.into_iter().chain(auxiliary.filter(there)).collect();
        let why = |error| unprepared(of_model(explained(error, info.as_ref(), logs), model), &recipe);
        let aliases = aliases_of_model(&columns, &fields).map_err(why)?;
        let mut dataset = Self::open(&recipe, &columns, &aliases, reads_of_model(model), logs, progress)?;
        dataset.topics = info.map_or_else(Vec::new, |info| info.topics);
        if !absent.is_empty() {
            let names: Vec<&str> = absent.iter().map(|column| column.name.as_str()).collect();
            let note = format!(
                "the recording has no {}, so the predictions are not compared with measurements",
                names.join(", ")
            );
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

    /// Gives category columns the codes that the model's labels had in training.
    fn recode(&mut self, model: &Model) {
        for partition in &model.partitions {
            let Rule::Labels { values, names, .. } = &partition.rule else { continue };
            let Some(label) = partition.columns.last().and_then(Expr::as_column) else { continue };
            let Some((column, _)) = self.aliases.iter().find(|(column, _)| column.name == label) else { continue };
            if let ColumnKind::Category(here) = &column.kind {
                let known = |name: &String| names.iter().position(|known| known == name).map(|at| values[at]);
                // Codes below zero are no label of the model.
                let table =
                    here.iter().enumerate().map(|(code, name)| known(name).unwrap_or(-1.0 - code as f64)).collect();
                self.recodings.push((label.to_owned(), table));
            }
        }
    }
}
