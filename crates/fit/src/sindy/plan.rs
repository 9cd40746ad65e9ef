//! What a fit of equations would read and keep.

use fleetfoot_data::{Progress, Work};
use fleetfoot_dataset::{Dataset, Logs, ReadPlan, open::estimate_equations};
use fleetfoot_estimate::SmoothingOptions;
use fleetfoot_model::Gaussian;
use fleetfoot_recipe::{Objective, Recipe};
use fleetfoot_task::{EquationTask, specification};
use serde::Serialize;

use super::{SindyOptions, smoothed::may_apply, work::work};
use crate::{error::Error, radial, serialize};

/// What a fit of equations would read and keep.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct SindyPlan {
    /// What its passes would read.
    #[serde(flatten)]
    pub reading: ReadPlan,
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
    /// Bytes that rows in memory may take beside, where states may be smoothed, at most.
    #[serde(rename = "smoothing_bytes", skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<usize>,
    /// Bytes of statistics, about.
    #[serde(rename = "memory_bytes")]
    pub memory: usize,
    /// What finding the terms takes, rows and simulations left out.
    #[serde(rename = "operations", serialize_with = "serialize::operations")]
    pub work: Work,
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
    let options = SindyOptions::new(&recipe.sindy)?.within(recipe)?;
    let (objective, centres) = (options.objective, radial::count(recipe)?.unwrap_or(0));
    if logs.is_statistic() {
        return Err(Error::needs_rows(
            "--dry-run tells what a pass over logs would cost, and a statistic needs none; leave it away".into(),
        ));
    }
    let regions = specification(recipe)?.and_then(|partition| partition.clusters()).unwrap_or(1);
    let plan = |task: &EquationTask, reading: ReadPlan, notes| SindyPlan {
        equations: task.fitted.iter().map(|equation| equation.label.clone()).collect(),
        candidates: (0..task.candidates()).map(|j| task.candidate(j)).chain((0..centres).map(Gaussian::name)).collect(),
        parameters: task.parameters.iter().map(|parameter| parameter.name.clone()).collect(),
        regions,
        objective,
        smoothing: (may_apply(options.smooth_states, task, recipe, regions > 1, reading.rows))
            .then(|| SmoothingOptions::default().memory as usize),
        memory: fleetfoot_sums::system::SystemPlan::memory(&task.system(), regions, reading.rows),
        work: work(
            &options,
            task.candidates() + centres,
            task.fitted.len(),
            regions,
            options.folds.expected(reading.episodes),
        ),
        reading,
        notes,
    };
    if let Some((task, columns, cost)) = estimate_equations(recipe, logs, progress)? {
        return Ok(plan(&task, ReadPlan::of_messages(logs, columns, &cost), Vec::new()));
    }
    let (dataset, task) = Dataset::for_equations(recipe, logs, progress)?;
    Ok(plan(&task, ReadPlan::of_tables(logs, &dataset), dataset.notes().to_vec()))
}
