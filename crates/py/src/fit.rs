//! Fits: data and a recipe in, a model and its report out.

use std::path::PathBuf;

use fleetfoot::{
    ControlSection, EstimateSection, FilterSection, NarxRequest, NarxSection, PrepareSection, PwaRequest, PwaSection,
    Recipe, ResimulateSection, Settings, SindyRequest, SindySection, SparseRequest, SparseSection, log::Cache,
};
use pyo3::prelude::*;

use crate::{
    data::Data,
    error::{Kind, of_engine},
    model::Model,
    object::object,
    recipe::of_json,
    run::{guard, run},
};

/// With a folder for the decoded columns of robots' logs.
pub(crate) fn with_cache(mut recipe: Recipe, cache: Option<PathBuf>) -> Recipe {
    recipe.cache = cache.map(|folder| Cache { folder, least_bytes: 0 });
    recipe
}

/// A recipe in TOML as JSON, its tables in order.
#[pyfunction]
pub(crate) fn recipe_json(text: &str, name: &str) -> PyResult<String> {
    guard(|| {
        let recipe = Recipe::parse(text, name).map_err(of_engine)?;
        serde_json::to_string(&recipe).map_err(|error| Kind::Internal.error(error))
    })
}

/// What the methods' sections of `said` say above those of `recipe`, both JSON: the rule by which flags stand above a recipe.
#[pyfunction]
pub(crate) fn say(said: &str, recipe_text: &str) -> PyResult<String> {
    guard(|| {
        let mut found = of_json(recipe_text)?;
        found.say_all(&of_json(said)?);
        serde_json::to_string(&found).map_err(|error| Kind::Internal.error(error))
    })
}

/// The sections of a recipe that say how methods go, and the names of their entries.
#[pyfunction]
pub(crate) fn settings() -> Vec<(&'static str, Vec<&'static str>)> {
    fn of<S: Settings>() -> (&'static str, Vec<&'static str>) {
        (S::SECTION, S::ENTRIES.to_vec())
    }
    vec![
        of::<PwaSection>(),
        of::<SparseSection>(),
        of::<SindySection>(),
        of::<NarxSection>(),
        of::<EstimateSection>(),
        of::<ControlSection>(),
        of::<FilterSection>(),
        of::<PrepareSection>(),
        of::<ResimulateSection>(),
    ]
}

/// A piecewise-affine model: the chosen one, its report, and with `keep_all` the models of all candidates.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, keep_all=false, cache=None, progress=None))]
pub(crate) fn fit_pwa<'py>(
    py: Python<'py>,
    data: &Data,
    recipe_text: &str,
    keep_all: bool,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Model, Report<'py>, Vec<Model>)> {
    let recipe = with_cache(of_json(recipe_text)?, cache);
    let request = PwaRequest { keep_all };
    let fitted = run(py, progress, |progress| fleetfoot::fit_pwa(&recipe, request, &data.logs, progress))?;
    let report = object(py, &fitted.to_json())?;
    let found = fitted.identification;
    Ok((Model::new(found.model)?, report, found.models.into_iter().map(Model::new).collect::<PyResult<_>>()?))
}

/// What a fit says of itself, as a dict.
type Report<'py> = Bound<'py, PyAny>;

/// The models of other numbers of terms.
type Front = Vec<(usize, Model)>;

/// Equations: the model, its report, and with `front` the models of other numbers of terms.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, front=false, cache=None, progress=None))]
pub(crate) fn fit_sindy<'py>(
    py: Python<'py>,
    data: &Data,
    recipe_text: &str,
    front: bool,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Model, Report<'py>, Front)> {
    let recipe = with_cache(of_json(recipe_text)?, cache);
    let request = SindyRequest { front, horizon: None };
    let fitted = run(py, progress, |progress| fleetfoot::fit_sindy(&recipe, request, &data.logs, progress))?;
    let front = fitted.front.into_iter().map(|(terms, model)| Ok((terms, Model::new(model)?)));
    Ok((Model::new(fitted.model)?, object(py, &fitted.report.to_json())?, front.collect::<PyResult<_>>()?))
}

/// An autoregression; `other`: recordings to run it on that do not train.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, other=None, cache=None, progress=None))]
pub(crate) fn fit_narx<'py>(
    py: Python<'py>,
    data: &Data,
    recipe_text: &str,
    other: Option<&Data>,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Model, Report<'py>)> {
    let recipe = with_cache(of_json(recipe_text)?, cache);
    let request = NarxRequest { free_run: other.map(|other| other.logs.clone()).unwrap_or_default() };
    let fitted = run(py, progress, |progress| fleetfoot::fit_narx(&recipe, &request, &data.logs, progress))?;
    Ok((Model::new(fitted.model)?, object(py, &fitted.report.to_json())?))
}

/// Given equations with estimated parameters.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, cache=None, progress=None))]
pub(crate) fn fit_parameters<'py>(
    py: Python<'py>,
    data: &Data,
    recipe_text: &str,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Model, Report<'py>)> {
    let recipe = with_cache(of_json(recipe_text)?, cache);
    let fitted = run(py, progress, |progress| fleetfoot::fit_parameters(&recipe, &data.logs, progress))?;
    Ok((Model::new(fitted.model)?, object(py, &fitted.report.to_json())?))
}

/// Sparse models of shared latents: one, or one for every value of the label `by`.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, by=None, influence=false, cache=None, progress=None))]
pub(crate) fn fit_sparse<'py>(
    py: Python<'py>,
    data: &Data,
    recipe_text: &str,
    by: Option<String>,
    influence: bool,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<(Option<String>, Model, Report<'py>)>> {
    let recipe = with_cache(of_json(recipe_text)?, cache);
    let request = SparseRequest { by, influence, ..SparseRequest::default() };
    let fitted = run(py, progress, |progress| fleetfoot::fit_sparse(&recipe, &request, &data.logs, progress))?;
    let found = fitted.into_iter().map(|found| {
        let report = object(py, &found.report.to_json())?;
        Ok((found.value, Model::new(found.model)?, report))
    });
    found.collect()
}
