//! Faults of logs, as a dict.

use pyo3::prelude::*;

use crate::{data::Data, object::object, recipe::of_json, run::run};

/// Faults of logs, to be seen before anything is fitted.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, progress=None))]
pub(crate) fn check<'py>(
    py: Python<'py>,
    data: &Data,
    recipe_text: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let recipe = of_json(recipe_text)?;
    let checked = run(py, progress, |progress| Ok(fleetfoot::check(&recipe, &data.logs, progress)?))?;
    object(py, &checked)
}
