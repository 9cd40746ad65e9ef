//! Faults of logs, as a dict.

use pyo3::prelude::*;

use crate::{data::Data, object::object, recipe::of_json, run::run};

/// Correlations of the columns of logs.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, columns=None, progress=None))]
pub(crate) fn correlations<'py>(
    py: Python<'py>,
    data: &Data,
    recipe_text: &str,
    columns: Option<Vec<String>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let recipe = of_json(recipe_text)?;
    let correlations =
        run(py, progress, |progress| Ok(fleetfoot::correlations(&recipe, columns.as_deref(), &data.logs, progress)?))?;
    object(py, &correlations)
}

/// Difference of a response from its reference, by their shift.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, reference, response, reach, progress=None))]
pub(crate) fn lag_curve<'py>(
    py: Python<'py>,
    data: &Data,
    recipe_text: &str,
    reference: &str,
    response: &str,
    reach: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let recipe = of_json(recipe_text)?;
    let curve = run(py, progress, |progress| {
        Ok(fleetfoot::lag_curve(&recipe, [reference, response], reach, &data.logs, progress)?)
    })?;
    object(py, &curve)
}

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
