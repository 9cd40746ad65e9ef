//! What a fit of equations would read and keep.

use fleetfoot_data::Progress;
use serde::Serialize;

use super::SindyOptions;
use crate::{
    Dataset, EquationTask, Error, Logs, Objective, Recipe, open::estimate_equations, problem::specification, told,
};

/// What a fit of equations would read and keep.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct SindyPlan {
    /// Files.
    pub files: usize,
    /// Episodes; robots' logs are not decoded to count them.
    pub episodes: Option<usize>,
    /// Rows; of robots' logs at most, from the counts in the files.
    pub rows: usize,
    /// Bytes of decoded columns, where logs must be decoded, and whether the cache has them already.
    #[serde(flatten, serialize_with = "told::decoded")]
    pub decoded: Option<(u64, bool)>,
    /// Columns that are read.
    pub columns: Vec<String>,
    /// Fitted equations.
    pub equations: Vec<String>,
    /// Candidates of any equation, the constant among them.
    pub candidates: Vec<String>,
    /// Parameters that are estimated first, a pass a step.
    pub parameters: Vec<String>,
    /// Regions, at most.
    pub regions: usize,
    /// What coefficients are fitted to.
    #[serde(skip)]
    pub objective: Objective,
    /// Bytes of statistics, about.
    #[serde(rename = "memory_bytes")]
    pub memory: usize,
    /// What was assumed or left out.
    #[serde(skip)]
    pub notes: Vec<String>,
}

/// Opens the files and tells what [`crate::fit_sindy`] would do. Robots' logs are not decoded for it; a `.stats` file needs no plan.
///
/// # Errors
/// Those of the recipe and of opening.
pub fn plan_sindy(recipe: &Recipe, logs: impl Into<Logs>, progress: &dyn Progress) -> Result<SindyPlan, Error> {
    let logs = &logs.into();
    let objective = SindyOptions::new(&recipe.sindy)?.within(recipe)?.objective;
    if logs.is_statistic() {
        return Err(Error::needs_rows(
            "--dry-run tells what a pass over logs would cost, and a statistic needs none; leave it away".into(),
        ));
    }
    let regions = specification(recipe)?.and_then(|partition| partition.clusters()).unwrap_or(1);
    let plan = |task: &EquationTask, columns, rows, episodes, decoded, notes| SindyPlan {
        files: logs.len(),
        episodes,
        rows,
        decoded,
        columns,
        equations: task.fitted.iter().map(|equation| equation.label.clone()).collect(),
        candidates: (0..task.candidates()).map(|j| task.candidate(j)).collect(),
        parameters: task.parameters.iter().map(|parameter| parameter.name.clone()).collect(),
        regions,
        objective,
        memory: fleetfoot_sparse::system::SystemPlan::memory(&task.system(), regions, rows),
        notes,
    };
    if let Some((task, columns, cost)) = estimate_equations(recipe, logs, progress)? {
        let decoded = Some((cost.decoded_bytes, cost.cached));
        return Ok(plan(&task, columns, cost.rows as usize, None, decoded, Vec::new()));
    }
    let (dataset, task) = Dataset::for_equations(recipe, logs, progress)?;
    let (episodes, notes) = (Some(dataset.episodes().len()), dataset.notes().to_vec());
    Ok(plan(&task, dataset.columns(), dataset.rows(), episodes, None, notes))
}
