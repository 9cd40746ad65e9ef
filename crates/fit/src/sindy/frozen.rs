//! Choices before the pass that sums equations: from a sample of the rows, or from separate passes.

use std::collections::BTreeMap;

use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::Dataset;
use fleetfoot_model::Partition;
use fleetfoot_recipe::Recipe;
use fleetfoot_task::{EquationTask, WeakForm, specification};

use super::estimation;
use crate::{
    error::Error,
    radial,
    regions::{clustering, regions},
    sindy::ParameterReport,
};

/// Equations that are ready to be summed.
#[derive(Debug, Clone)]
pub(crate) struct Frozen {
    /// The task, its derivatives settled; once they are estimated, numbers in place of its parameters.
    pub(crate) task: EquationTask,
    /// The parameters' estimates.
    pub(crate) parameters: Vec<ParameterReport>,
}

impl Frozen {
    /// Settles how derivatives are measured.
    ///
    /// # Errors
    /// Those of reading.
    pub(crate) fn differentiated(
        task: EquationTask,
        source: &dyn Source,
        notes: &mut Vec<String>,
    ) -> Result<Self, Error> {
        Ok(Self { task: task.differentiated(source, notes)?, parameters: Vec::new() })
    }

    /// Settles whether equations are fitted on windows in the place of rows.
    ///
    /// # Errors
    /// Those of reading; windows that the logs have no room for.
    pub(crate) fn windowed(
        mut self,
        form: WeakForm,
        source: &dyn Source,
        notes: &mut Vec<String>,
    ) -> Result<Self, Error> {
        self.task.windows = self.task.windows_for(form, source, notes)?;
        Ok(self)
    }

    /// Estimates the parameters where there are any; the dataset is then seen with their values.
    ///
    /// # Errors
    /// Those of reading and of the estimate.
    pub(super) fn estimate(
        &mut self,
        dataset: &mut Dataset,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<(), Error> {
        if self.task.parameters.is_empty() {
            return Ok(());
        }
        progress.stage("parameters");
        self.parameters = estimation::estimate(&self.task, &dataset.view()?, notes, progress)?;
        let values: BTreeMap<String, f64> =
            self.parameters.iter().map(|parameter| (parameter.name.clone(), parameter.value)).collect();
        self.task = self.task.settled(&values);
        dataset.see(&self.task.aliases);
        Ok(())
    }

    /// Adds the radial functions that the recipe asks for to the candidates: one pass for their centres.
    ///
    /// # Errors
    /// Those of reading; more centres than rows.
    pub(crate) fn add_radial(
        &mut self,
        recipe: &Recipe,
        (seed, step, source): (u64, f64, &dyn Source),
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<(), Error> {
        let problem = self.task.problem(step);
        let functions = radial::functions(recipe, &self.task.variables, &problem, (seed, source), notes, progress)?;
        if let Some(functions) = functions {
            self.task = self.task.clone().with_radial(functions, recipe);
        }
        Ok(())
    }

    /// The regions that the recipe asks for, clustered where they must be; `None` for one.
    ///
    /// # Errors
    /// Those of reading; more regions than rows.
    pub(crate) fn partition(
        &self,
        recipe: &Recipe,
        seed: u64,
        step: f64,
        source: &dyn Source,
        notes: &mut Vec<String>,
        progress: &dyn Progress,
    ) -> Result<Option<Partition>, Error> {
        let Some(specification) = specification(recipe)? else { return Ok(None) };
        let problem = self.task.problem(step);
        Ok(Some(regions(&problem, specification, clustering(seed), source, notes, progress)?))
    }
}
