//! Preparation: raw recordings in, clean episodes and their recipe out.

use std::path::PathBuf;

use fleetfoot::prepare::{PrepareRequest, prepare as run_prepare};
use pyo3::prelude::*;

use crate::{data::Data, fit::recipe, run::run};

/// Writes clean episodes and their recipe into a folder; what was done, as JSON.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, folder, force=false, progress=None))]
pub(crate) fn prepare(
    py: Python<'_>,
    data: &Data,
    recipe_text: &str,
    folder: PathBuf,
    force: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let (recipe, request) = (recipe(recipe_text)?, PrepareRequest { folder, force });
    let prepared = run(py, progress, |progress| run_prepare(&recipe, &request, &data.logs, progress))?;
    Ok(prepared.to_json().to_string())
}
