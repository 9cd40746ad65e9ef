//! Task of a statistic under a recipe.

use fleetfoot_recipe::Recipe;
use fleetfoot_task::StructuredTask;

use super::StatisticFile;
use crate::error::Error;

impl StatisticFile {
    /// The recipe of the scan, and what it means for the logs.
    ///
    /// # Errors
    /// A recipe that this version reads otherwise.
    pub fn task(&self) -> Result<(Recipe, StructuredTask), Error> {
        let recipe = Recipe::parse(&self.recipe, "the recipe of the statistic")?;
        let task = StructuredTask::resolve(&recipe, &self.fields)?;
        self.accepts(&task, "the statistic", "its recipe")?;
        Ok((recipe, task))
    }

    /// Resolves a recipe for the logs behind this statistic. Penalties, signs, scales, strengths and bounds may differ
    /// from those of the scan; functions, tasks and columns may not.
    ///
    /// # Errors
    /// The errors of [`StructuredTask::resolve`]; another plan, with the lines that differ.
    pub fn resolve(&self, recipe: &Recipe) -> Result<StructuredTask, Error> {
        let recipe = recipe.expand(&self.fields)?;
        let task = StructuredTask::resolve(&recipe, &self.fields)?;
        self.accepts(&task, "the statistic", "the recipe")?;
        Ok(task)
    }
}
