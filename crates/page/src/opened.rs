//! Logs with a model's columns, opened once for all parts of a page: decoding them is most of the work.

use fleetfoot_data::Progress;
use fleetfoot_dataset::{Dataset, Logs, reads_of_model};
use fleetfoot_fit::Error;
use fleetfoot_model::{Model, Rule};
use fleetfoot_recipe::Recipe;
use fleetfoot_run::is_needed;

/// The rows of logs, and the model that they were opened for.
pub(crate) struct Opened<'a> {
    model: &'a Model,
    pub(crate) dataset: Dataset,
}

impl<'a> Opened<'a> {
    pub(crate) fn new(model: &'a Model, changes: &Recipe, logs: &Logs, progress: &dyn Progress) -> Result<Self, Error> {
        let needed = |name: &str| is_needed(model, name, false);
        Ok(Self { model, dataset: Dataset::for_run(model, changes, logs, &needed, progress)? })
    }

    /// The rows for another model: these, where it would see the same.
    pub(crate) fn or_for(
        self,
        model: &'a Model,
        changes: &Recipe,
        logs: &Logs,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        if see_alike(self.model, model) { Ok(self) } else { Self::new(model, changes, logs, progress) }
    }
}

/// Returns true if two models open any logs alike: same columns, clock and recipe.
fn see_alike(a: &Model, b: &Model) -> bool {
    let labels = |model: &Model| model.partitions.iter().any(|partition| matches!(partition.rule, Rule::Labels { .. }));
    a.columns == b.columns
        && a.auxiliary_columns() == b.auxiliary_columns()
        && a.step == b.step
        && a.training.recipe == b.training.recipe
        && a.training.episodes == b.training.episodes
        && reads_of_model(a) == reads_of_model(b)
        && !labels(a)
        && !labels(b)
}
