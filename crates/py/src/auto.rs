//! From a log to a model.

use std::path::PathBuf;

use fleetfoot::AutoOutput;
use pyo3::prelude::*;

use crate::{data::Data, model::Model, object::object, recipe::of_json, run::run};

/// The model, the linear model if it is another one, the report, and the recipe as TOML.
type AutoResult<'py> = (Model, Option<Model>, Bound<'py, PyAny>, String);

/// Finds a model of recordings; writes the folder of the result where one is given.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, folder=None, force=false, c=false, progress=None))]
pub(crate) fn auto<'py>(
    py: Python<'py>,
    data: &Data,
    recipe_text: &str,
    folder: Option<PathBuf>,
    force: bool,
    c: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<AutoResult<'py>> {
    let recipe = of_json(recipe_text)?;
    let output = folder.map(|folder| AutoOutput { folder, force, c });
    let outcome = run(py, progress, |progress| {
        if let Some(output) = &output {
            output.check(&data.logs.files())?;
        }
        let outcome = fleetfoot::auto(&recipe, &data.logs, progress)?;
        if let Some(output) = &output {
            outcome.write(output, &data.logs, progress)?;
        }
        Ok(outcome)
    })?;
    let report = object(py, &outcome.to_json())?;
    let linear = outcome.linear.map(Model::new).transpose()?;
    Ok((Model::new(outcome.model)?, linear, report, outcome.recipe.to_toml()))
}
