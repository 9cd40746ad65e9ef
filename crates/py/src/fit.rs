//! Fits: data and a recipe in, a model and its report out.

use std::path::PathBuf;

use fleetfoot::{
    AutoSection, ControlSection, EstimateSection, FilterSection, FitReport, FitRequest, Fitted, Method, Narx,
    NarxSection, Network, NetworkSection, Parameters, PrepareSection, Pwa, PwaSection, Recipe, ResimulateSection,
    Settings, Sindy, SindySection, Sparse, SparseSection, log::Cache,
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

/// Merges the methods' sections of `said` over those of `recipe`, both JSON, by the rule that flags go above a recipe.
#[pyfunction]
pub(crate) fn override_settings(settings_text: &str, recipe_text: &str) -> PyResult<String> {
    guard(|| {
        let mut recipe = of_json(recipe_text)?;
        recipe.override_all(&of_json(settings_text)?);
        serde_json::to_string(&recipe).map_err(|error| Kind::Internal.error(error))
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
        of::<NetworkSection>(),
        of::<EstimateSection>(),
        of::<ControlSection>(),
        of::<FilterSection>(),
        of::<PrepareSection>(),
        of::<ResimulateSection>(),
        of::<AutoSection>(),
    ]
}

/// Report of a fit, as a dict.
type Report<'py> = Bound<'py, PyAny>;

/// The value of a label, the model, its report, and the models of other candidates by name.
type Fits<'py> = Vec<(Option<String>, Model, Report<'py>, Vec<(String, Model)>)>;

/// Fits by the method of this name: one model, or one for every value of the label `by`. `rivals`: the models of other candidates too; `other`: recordings to run an
/// autoregression on that do not train.
#[pyfunction]
#[pyo3(signature = (method, data, recipe_text, rivals=false, other=None, by=None, influence=false, cache=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "the arguments of Python's function")]
pub(crate) fn fit<'py>(
    py: Python<'py>,
    method: &str,
    data: &Data,
    recipe_text: &str,
    rivals: bool,
    other: Option<&Data>,
    by: Option<String>,
    influence: bool,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Fits<'py>> {
    let recipe = with_cache(of_json(recipe_text)?, cache);
    let free_run = other.map(|other| other.logs.clone()).unwrap_or_default();
    let request = FitRequest { rivals, free_run, by, influence, ..FitRequest::default() };
    match method {
        Pwa::NAME => of::<Pwa>(py, data, &recipe, &request, progress),
        Sindy::NAME => of::<Sindy>(py, data, &recipe, &request, progress),
        Sparse::NAME => of::<Sparse>(py, data, &recipe, &request, progress),
        Network::NAME => of::<Network>(py, data, &recipe, &request, progress),
        Narx::NAME => of::<Narx>(py, data, &recipe, &request, progress),
        Parameters::NAME => of::<Parameters>(py, data, &recipe, &request, progress),
        _ => Err(Kind::Internal.error(format!("no method `{method}`"))),
    }
}

fn of<'py, M: Method>(
    py: Python<'py>,
    data: &Data,
    recipe: &Recipe,
    request: &FitRequest,
    progress: Option<Py<PyAny>>,
) -> PyResult<Fits<'py>> {
    let fitted = run(py, progress, |progress| fleetfoot::fit_all::<M>(recipe, request, &data.logs, progress))?;
    let of = |fit: Fitted<M::Report>| {
        let report = object(py, &fit.report.to_json())?;
        let rivals = fit.rivals.into_iter().map(|rival| Ok((rival.name, Model::new(rival.model)?)));
        Ok((fit.value, Model::new(fit.model)?, report, rivals.collect::<PyResult<_>>()?))
    };
    fitted.into_iter().map(of).collect()
}
