//! What a statistic means, and what it can be asked for.

use crate::{Error, Recipe, StructuredTask, fit, narx, stats_file::StatisticFile};

impl StatisticFile {
    /// What can be fitted without the logs, for people: the methods, each with its regions.
    pub fn serves(&self) -> Vec<String> {
        let mut methods = vec!["fit sparse".to_owned()];
        let mut add = |method: &str, regions: Vec<String>| {
            if !regions.is_empty() {
                methods.push(format!("fit {method} (--partition {})", regions.join(" | ")));
            }
        };
        let groups = self.equations.iter().flat_map(|equations| &equations.groups);
        let mut regions: Vec<String> = Vec::new();
        for group in groups {
            if !regions.iter().any(|known| known == group.name()) {
                regions.push(group.name().to_owned());
            }
        }
        add("sindy", regions);
        add("pwa", fit::served(self));
        add("narx", narx::served(self));
        methods
    }

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

    /// What a recipe means for the logs behind this statistic: penalties, signs, scales, strengths and bounds may be others than at the scan,
    /// functions, tasks and columns may not.
    ///
    /// # Errors
    /// Those of [`StructuredTask::resolve`]; another plan, with the lines that differ.
    pub fn resolve(&self, recipe: &Recipe) -> Result<StructuredTask, Error> {
        let recipe = recipe.expand(&self.fields)?;
        let task = StructuredTask::resolve(&recipe, &self.fields)?;
        self.accepts(&task, "the statistic", "the recipe")?;
        Ok(task)
    }
}
