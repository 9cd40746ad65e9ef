//! Fits: data and a recipe in, a model and its report out.

use std::path::PathBuf;

use fleetfoot::{
    NarxRequest, Recipe, SindyRequest, SparseRequest,
    log::Cache,
    model::UnseenLabel,
    pwa::{Options, Selection, Shrinkage},
};
use pyo3::prelude::*;

use crate::{
    data::Data,
    error::Kind,
    model::Model,
    run::{guard, run},
};

/// A recipe from JSON.
pub(crate) fn recipe(text: &str) -> PyResult<Recipe> {
    serde_json::from_str(text).map_err(|error| Kind::Request.error(format!("the recipe: {error}")))
}

/// With a folder for the decoded columns of robots' logs.
pub(crate) fn with_cache(mut recipe: Recipe, cache: Option<PathBuf>) -> Recipe {
    recipe.cache = cache.map(|folder| Cache { folder, least_bytes: 0 });
    recipe
}

/// A recipe in TOML as JSON, its tables in order.
#[pyfunction]
pub(crate) fn recipe_json(text: &str, name: &str) -> PyResult<String> {
    guard(|| {
        let recipe = Recipe::parse(text, name).map_err(crate::error::of_engine)?;
        serde_json::to_string(&recipe).map_err(|error| Kind::Internal.error(error))
    })
}

/// How a piecewise-affine fit goes, beside the recipe.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct PwaOptions {
    folds: u16,
    purge: f64,
    select: String,
    /// Rows; `None`: chosen.
    shrinkage: Option<f64>,
    unseen_labels: String,
    seed: u64,
    restarts: usize,
    iterations: usize,
    tsqr: bool,
    keep_all: bool,
    memory: usize,
}

impl PwaOptions {
    fn options(&self) -> PyResult<Options> {
        let refused = |what: &str, allowed: &str| Kind::Request.error(format!("{what}: give {allowed}"));
        let mut options = Options::default();
        options.folds = self.folds;
        options.selection = match self.select.as_str() {
            "cv" => Selection::CrossValidation,
            "bic" => Selection::Bic,
            other => return Err(refused(&format!("select={other:?}"), "'cv' or 'bic'")),
        };
        options.shrinkage = match self.shrinkage {
            None => Shrinkage::Auto,
            Some(rows) if rows >= 0.0 && rows.is_finite() => Shrinkage::Rows(rows),
            Some(other) => return Err(refused(&format!("shrinkage={other}"), "a number of rows, or 'auto'")),
        };
        options.unseen = match self.unseen_labels.as_str() {
            "refuse" => UnseenLabel::Refuse,
            "pool" => UnseenLabel::Pool,
            other => return Err(refused(&format!("unseen_labels={other:?}"), "'refuse' or 'pool'")),
        };
        if !(self.purge >= 0.0 && self.purge.is_finite()) {
            return Err(refused(&format!("purge={}", self.purge), "seconds, zero or more"));
        }
        options.seed = self.seed;
        options.restarts = self.restarts;
        options.iterations = self.iterations;
        options.tsqr = self.tsqr;
        options.keep_all = self.keep_all;
        options.memory = self.memory;
        Ok(options)
    }
}

/// A piecewise-affine model: the chosen one, its report, and with `keep_all` the models of all candidates.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, options, cache=None, progress=None))]
pub(crate) fn fit_pwa(
    py: Python<'_>,
    data: &Data,
    recipe_text: &str,
    options: PwaOptions,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Model, String, Vec<Model>)> {
    let recipe = with_cache(recipe(recipe_text)?, cache);
    // 0 is Python's word for the default.
    let purge = Some(options.purge).filter(|purge| *purge > 0.0);
    let options = options.options()?;
    let fitted = run(py, progress, |progress| fleetfoot::fit_pwa(&recipe, &options, purge, &data.logs, progress))?;
    let report = fitted.to_json().to_string();
    let found = fitted.identification;
    Ok((Model::new(found.model)?, report, found.models.into_iter().map(Model::new).collect::<PyResult<_>>()?))
}

/// The models of other numbers of terms.
type Front = Vec<(usize, Model)>;

/// Equations: the model, its report, and with `front` the models of other numbers of terms.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, front=false, cache=None, progress=None))]
pub(crate) fn fit_sindy(
    py: Python<'_>,
    data: &Data,
    recipe_text: &str,
    front: bool,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Model, String, Front)> {
    let recipe = with_cache(recipe(recipe_text)?, cache);
    let request = SindyRequest { front, horizon: None };
    let fitted = run(py, progress, |progress| fleetfoot::fit_sindy(&recipe, request, &data.logs, progress))?;
    let front = fitted.front.into_iter().map(|(terms, model)| Ok((terms, Model::new(model)?)));
    Ok((Model::new(fitted.model)?, fitted.report.to_json().to_string(), front.collect::<PyResult<_>>()?))
}

/// An autoregression; `other`: recordings to run it on that do not train.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, other=None, cache=None, progress=None))]
pub(crate) fn fit_narx(
    py: Python<'_>,
    data: &Data,
    recipe_text: &str,
    other: Option<&Data>,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Model, String)> {
    let recipe = with_cache(recipe(recipe_text)?, cache);
    let request = NarxRequest { free_run: other.map(|other| other.logs.clone()).unwrap_or_default() };
    let fitted = run(py, progress, |progress| fleetfoot::fit_narx(&recipe, &request, &data.logs, progress))?;
    Ok((Model::new(fitted.model)?, fitted.report.to_json().to_string()))
}

/// Sparse models of shared latents: one, or one for every value of the label `by`.
#[pyfunction]
#[pyo3(signature = (data, recipe_text, by=None, influence=false, cache=None, progress=None))]
pub(crate) fn fit_sparse(
    py: Python<'_>,
    data: &Data,
    recipe_text: &str,
    by: Option<String>,
    influence: bool,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<(Option<String>, Model, String)>> {
    let recipe = with_cache(recipe(recipe_text)?, cache);
    let request = SparseRequest { by, influence, ..SparseRequest::default() };
    let fitted = run(py, progress, |progress| fleetfoot::fit_sparse(&recipe, &request, &data.logs, progress))?;
    let found = fitted.into_iter().map(|found| {
        let report = found.report.to_json().to_string();
        Ok((found.value, Model::new(found.model)?, report))
    });
    found.collect()
}
