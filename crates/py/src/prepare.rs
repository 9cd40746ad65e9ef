//! Preparation: raw recordings in, clean episodes and their recipe out.

use std::path::PathBuf;

use fleetfoot::prepare::{PrepareRequest, prepare as run_prepare};
use pyo3::prelude::*;

use crate::{data::Data, object::object, recipe::of_json, run::run};

/// Writes clean episodes and their recipe into a folder; returns a report as a dict.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, folder, force=false, progress=None))]
pub(crate) fn prepare<'py>(
    py: Python<'py>,
    data: &Data,
    recipe_text: &str,
    folder: PathBuf,
    force: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let (recipe, request) = (of_json(recipe_text)?, PrepareRequest { folder, force });
    let prepared = run(py, progress, |progress| Ok(run_prepare(&recipe, &request, &data.logs, progress)?))?;
    object(py, &prepared.to_json())
}
