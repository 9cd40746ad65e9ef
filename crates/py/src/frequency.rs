//! Frequency responses of logs and models.

use std::path::PathBuf;

use fleetfoot::{FigureFormat, FrequencyOptions};
use pyo3::prelude::*;

use crate::{data::Data, model::Model, object::object, recipe::of_json, run::run};

/// Input, output and method of a frequency response, and its files.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct FrequencyRequest {
    input: String,
    output: String,
    segment: Option<f64>,
    period: Option<f64>,
    skip: usize,
    page: Option<PathBuf>,
    svg: Option<PathBuf>,
}

/// The response of an output to an input, of recordings and with a model of its simulations: the report (JSON).
#[pyfunction]
#[pyo3(signature = (model, data, recipe_text, request, progress=None))]
pub(crate) fn frequency<'py>(
    py: Python<'py>,
    model: Option<Py<Model>>,
    data: &Data,
    recipe_text: &str,
    request: FrequencyRequest,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let recipe = of_json(recipe_text)?;
    let mut options = FrequencyOptions::new(request.input, request.output);
    (options.segment, options.period, options.skip) = (request.segment, request.period, request.skip);
    let report = run(py, progress, |progress| {
        let model = model.as_ref().map(|model| &model.get().model);
        let frequencies = fleetfoot::frequency(model, &recipe, &data.logs, &options, progress)?;
        let drawn = fleetfoot::bode(&frequencies);
        if let Some(path) = &request.page {
            drawn.write(path, &data.logs.files())?;
        }
        if let Some(folder) = &request.svg {
            drawn.write_figures(folder, FigureFormat::Svg, &data.logs.files())?;
        }
        Ok(frequencies.to_json())
    })?;
    object(py, &report)
}
