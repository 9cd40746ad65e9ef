//! Models on recordings: scores, predictions row by row, rollouts.

use std::path::PathBuf;

use fleetfoot::{
    FigureFormat, FilteredRows, Followed,
    data::{OutOfMemory, ensure_memory, reserve},
    dynamics::{
        Domain, End, Outside, PathOptions, Predicted, RolloutOptions, RowStatus, Start, Starts, Step, Trajectory,
    },
};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    data::Data,
    error::Kind,
    fit::with_cache,
    model::{Model, method, region},
    object::object,
    points::array,
    recipe::of_json,
    run::run,
};

/// One-step scores as a dict.
#[pyfunction]
#[pyo3(signature = (model, data, recipe_text, cache=None, progress=None))]
pub(crate) fn score<'py>(
    py: Python<'py>,
    model: &Model,
    data: &Data,
    recipe_text: &str,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let changes = with_cache(of_json(recipe_text)?, cache);
    let scored = run(py, progress, |progress| fleetfoot::score(&model.model, &changes, &data.logs, progress))?;
    object(py, &scored.to_json())
}

/// Content of a page, and its path.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct ReportRequest {
    path: PathBuf,
    svg: Option<PathBuf>,
    csv: Option<PathBuf>,
    /// Two columns or expressions.
    plane: Option<[String; 2]>,
    /// States of a path, and their references.
    position: Vec<String>,
    reference: Vec<String>,
    interval: usize,
    band: Option<usize>,
    /// Reports of fits (JSON).
    fits: Vec<String>,
    title: Option<String>,
    horizon: Option<usize>,
    starts: usize,
    controller: Option<String>,
    settings: Vec<String>,
}

/// Writes the page of models by name, and returns its first findings.
#[pyfunction]
#[pyo3(signature = (models, data, recipe_text, request, cache=None, progress=None))]
pub(crate) fn report<'py>(
    py: Python<'py>,
    models: Vec<(String, Py<Model>)>,
    data: Option<&Data>,
    recipe_text: &str,
    request: ReportRequest,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let changes = with_cache(of_json(recipe_text)?, cache);
    let models: Vec<_> = models.into_iter().map(|(name, model)| (name, model.get().model.clone())).collect();
    let logs = data.map(|data| data.logs.clone()).unwrap_or_default();
    let scored = run(py, progress, |progress| {
        let mut options = fleetfoot::ReportOptions::default();
        (options.title, options.horizon, options.starts) = (request.title, request.horizon, request.starts);
        options.plane = request.plane;
        options.paths = PathOptions {
            position: request.position,
            references: request.reference,
            interval: Some(request.interval),
            band: request.band,
        };
        let read =
            |text: &String| serde_json::from_str(text).map_err(|error| fleetfoot::Error::value(error.to_string()));
        options.fits = request.fits.iter().map(read).collect::<Result<_, _>>()?;
        let controller = request.controller.as_ref().map(|what| fleetfoot::controller(what, &request.settings));
        options.controller = controller.transpose()?;
        let made = fleetfoot::report(&models, &changes, &logs, &options, progress)?;
        made.write(&request.path, &logs.files())?;
        for (folder, format) in [(&request.svg, FigureFormat::Svg), (&request.csv, FigureFormat::Csv)] {
            if let Some(folder) = folder {
                made.write_figures(folder, format, &logs.files())?;
            }
        }
        Ok(made.to_json())
    })?;
    object(py, &scored)
}

/// Advice for an answer that does not fit into memory.
const PARTS: &str = "give the recordings in parts";

/// Rows with their predictions, while they are collected.
#[derive(Default)]
struct Collected {
    episodes: Vec<String>,
    episode: Vec<i64>,
    stamps: Vec<i64>,
    /// Rows x equations.
    measured: Vec<f64>,
    predicted: Vec<f64>,
    residual: Vec<f64>,
    region: Vec<i64>,
    distance: Vec<f64>,
    /// True for a row with target and prediction; then the position of the row relative to the training range.
    complete: Vec<bool>,
    domain: Vec<u8>,
}

impl Collected {
    fn take(&mut self, rows: &fleetfoot::PredictedRows<'_>, equations: usize) -> Result<(), OutOfMemory> {
        let count = rows.predicted.rows;
        for values in [&mut self.measured, &mut self.predicted, &mut self.residual] {
            reserve(values, count * equations, "predictions of all rows", PARTS)?;
        }
        reserve(&mut self.stamps, count, "predictions of all rows", PARTS)?;
        if self.episodes.last() != Some(&rows.episode.name) {
            self.episodes.push(rows.episode.name.clone());
        }
        let (predicted, count) = (rows.predicted, rows.predicted.rows);
        self.episode.resize(self.episode.len() + count, self.episodes.len() as i64 - 1);
        self.stamps.extend(rows.stamps.iter().map(|stamp| stamp + rows.log_offset));
        for (values, to) in [
            (&predicted.measured, &mut self.measured),
            (&predicted.predicted, &mut self.predicted),
            (&predicted.residual, &mut self.residual),
        ] {
            for row in 0..count {
                to.extend((0..equations).map(|equation| Predicted::equation(values, count, equation)[row]));
            }
        }
        self.region.extend(predicted.region.iter().map(|&index| region(index)));
        self.distance.extend_from_slice(&predicted.distance);
        self.complete.extend(predicted.status.iter().map(|&status| status == RowStatus::Complete));
        self.domain.extend(predicted.domain.iter().map(|domain| match domain {
            Domain::Inside => 0,
            Domain::OutsideRegion => 1,
            Domain::OutsideTraining => 2,
        }));
        Ok(())
    }
}

/// Predictions row by row, as arrays by name.
#[pyfunction]
#[pyo3(signature = (model, data, recipe_text, cache=None, progress=None))]
pub(crate) fn predict_rows<'py>(
    py: Python<'py>,
    model: &Model,
    data: &Data,
    recipe_text: &str,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let changes = with_cache(of_json(recipe_text)?, cache);
    let equations = model.model.outputs();
    let predicted = run(py, progress, |progress| {
        let mut predicted = Collected::default();
        fleetfoot::predict_rows(&model.model, &changes, &data.logs, progress, |_, rows| {
            Ok(predicted.take(rows, equations.len())?)
        })?;
        Ok(predicted)
    })?;
    let rows = predicted.stamps.len();
    let shape = [rows, equations.len()];
    let dict = PyDict::new(py);
    dict.set_item("targets", equations)?;
    dict.set_item("episodes", predicted.episodes)?;
    dict.set_item("episode", PyArray1::from_vec(py, predicted.episode))?;
    dict.set_item("stamp", PyArray1::from_vec(py, predicted.stamps))?;
    dict.set_item("measured", array(py, predicted.measured, &shape)?)?;
    dict.set_item("predicted", array(py, predicted.predicted, &shape)?)?;
    dict.set_item("residual", array(py, predicted.residual, &shape)?)?;
    dict.set_item("region", PyArray1::from_vec(py, predicted.region))?;
    dict.set_item("distance", PyArray1::from_vec(py, predicted.distance))?;
    dict.set_item("complete", PyArray1::from_vec(py, predicted.complete))?;
    dict.set_item("domain", PyArray1::from_vec(py, predicted.domain))?;
    Ok(dict)
}

/// Request of rollouts: their starts and options.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct RolloutRequest {
    horizon: usize,
    /// Number of starts, when `at` is empty.
    count: usize,
    seed: Option<u64>,
    /// Episode and row.
    at: Vec<(usize, usize)>,
    method: String,
    dt: Option<f64>,
    keep: bool,
    /// "tell", "end", "hold".
    outside: String,
    /// States whose distance is reported.
    position: Vec<String>,
    /// States that follow an expression, `STATE=EXPRESSION`.
    reference: Vec<String>,
    interval: usize,
    band: Option<usize>,
    controller: Option<String>,
    settings: Vec<String>,
}

/// Rollouts: scores by horizon (JSON), and the trajectories where they were kept.
#[pyfunction]
#[pyo3(signature = (model, data, recipe_text, request, cache=None, progress=None))]
pub(crate) fn rollout<'py>(
    py: Python<'py>,
    model: &Model,
    data: &Data,
    recipe_text: &str,
    request: RolloutRequest,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyAny>, Vec<Bound<'py, PyDict>>)> {
    let changes = with_cache(of_json(recipe_text)?, cache);
    let mut options = RolloutOptions::new(request.horizon);
    options.method = method(&request.method)?;
    options.keep = request.keep;
    let paths = PathOptions {
        position: request.position.clone(),
        references: request.reference.clone(),
        interval: Some(request.interval),
        band: request.band,
    };
    options.outside = outside(&request.outside)?;
    options.step = request.dt.map_or(Step::Median, Step::Seconds);
    let starts = match (request.at.is_empty(), request.seed) {
        (false, _) => Starts::At(request.at.iter().map(|&(episode, row)| Start { episode, row }).collect()),
        (true, None) => Starts::Even(request.count),
        (true, Some(seed)) => Starts::Random { count: request.count, seed },
    };
    let states = model.stepper().states().len();
    let rolled = run(py, progress, |progress| {
        let count = request.count.max(request.at.len());
        if request.keep {
            ensure_memory(
                count.saturating_mul(request.horizon.saturating_add(1)).saturating_mul(8 * (2 * states + 4)),
                &format!("{count} trajectories of {} steps", request.horizon),
                "give fewer starts, a shorter horizon, or keep=False",
            )?;
        }
        let controller = request.controller.as_ref().map(|what| fleetfoot::controller(what, &request.settings));
        let controller = controller.transpose()?;
        paths.apply(&model.model, &mut options)?;
        fleetfoot::rollout(&model.model, &changes, &data.logs, &starts, &options, controller.as_ref(), None, progress)
    })?;
    let report = object(py, &rolled.to_json())?;
    let trajectories = rolled.rollouts.trajectories.iter().map(|trajectory| to_dict(py, trajectory));
    Ok((report, trajectories.collect::<PyResult<_>>()?))
}

/// Recordings filtered by a model, by the recipe's `[filter]`: the report (JSON), and with `keep` the estimates of each
/// episode.
#[pyfunction]
#[pyo3(signature = (model, data, recipe_text, keep=false, output=None, cache=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "those of the Python method")]
pub(crate) fn filter<'py>(
    py: Python<'py>,
    model: &Model,
    data: &Data,
    recipe_text: &str,
    keep: bool,
    output: Option<PathBuf>,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyAny>, Vec<Bound<'py, PyDict>>)> {
    let changes = with_cache(of_json(recipe_text)?, cache);
    let (filtered, kept) = run(py, progress, |progress| {
        let mut kept = Vec::new();
        let mut bytes = 0;
        let filtered = match (&output, keep) {
            (None, true) => fleetfoot::filter_rows(&model.model, &changes, &data.logs, progress, |_, rows| {
                // An episode that grows is moved, and what is kept is copied for Python in the end.
                bytes += rows.bytes();
                ensure_memory(
                    2 * bytes,
                    "the estimates of all rows (keep=True)",
                    "leave keep out, write them to a file (output=), or filter in parts",
                )?;
                match kept.last_mut().filter(|_| rows.first() > 0) {
                    Some(before) => FilteredRows::extend(before, rows),
                    None => kept.push(rows.clone()),
                }
                Ok(())
            }),
            _ => fleetfoot::filter(&model.model, &changes, &data.logs, output.as_deref(), progress),
        }?;
        Ok::<_, fleetfoot::Error>((filtered, kept))
    })?;
    let report = object(py, &filtered.to_json())?;
    Ok((report, kept.iter().map(|rows| filtered_to_dict(py, rows)).collect::<PyResult<_>>()?))
}

fn filtered_to_dict<'py>(py: Python<'py>, filtered: &FilteredRows) -> PyResult<Bound<'py, PyDict>> {
    let rows = filtered.rows();
    let matrix = |values: &[f64]| array(py, values.to_vec(), &[rows, values.len().checked_div(rows).unwrap_or(0)]);
    let dict = PyDict::new(py);
    dict.set_item("episode", filtered.episode())?;
    let stamps = filtered.stamps();
    dict.set_item("t", PyArray1::from_iter(py, stamps.iter().map(|stamp| (stamp - stamps[0]) as f64 * 1e-9)))?;
    dict.set_item("x", matrix(filtered.means())?)?;
    dict.set_item("deviation", matrix(filtered.deviations())?)?;
    dict.set_item("probability", matrix(filtered.probabilities())?)?;
    dict.set_item(
        "region",
        PyArray1::from_iter(py, (0..rows).map(|row| filtered.region(row).map_or(-1, |region| region as i64))),
    )?;
    dict.set_item("innovation", matrix(filtered.innovations())?)?;
    dict.set_item("innovation_deviation", matrix(filtered.innovation_deviations())?)?;
    dict.set_item("log_likelihood", PyArray1::from_slice(py, filtered.log_likelihood()))?;
    Ok(dict)
}

/// Recordings that a model follows within bounds, by the recipe's `[resimulate]`: the report (JSON), and the trajectory
/// of each episode.
#[pyfunction]
#[pyo3(signature = (model, data, recipe_text, cache=None, progress=None))]
pub(crate) fn resimulate<'py>(
    py: Python<'py>,
    model: &Model,
    data: &Data,
    recipe_text: &str,
    cache: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyAny>, Vec<Bound<'py, PyDict>>)> {
    let changes = with_cache(of_json(recipe_text)?, cache);
    let followed =
        run(py, progress, |progress| fleetfoot::resimulate(&model.model, &changes, &data.logs, None, progress))?;
    let report = object(py, &followed.to_json())?;
    let count = followed.resimulation.episodes.len();
    Ok((report, (0..count).map(|at| followed_to_dict(py, &followed, at)).collect::<PyResult<_>>()?))
}

fn followed_to_dict<'py>(py: Python<'py>, followed: &Followed, at: usize) -> PyResult<Bound<'py, PyDict>> {
    let (episode, resimulation) = (&followed.resimulation.episodes[at], &followed.resimulation);
    let (rows, width, states) = (episode.rows.len(), resimulation.columns.len(), resimulation.states);
    let part = |values: &[f64], from: usize, to: usize| {
        array(py, values.chunks_exact(width).flat_map(|row| row[from..to].to_vec()).collect(), &[rows, to - from])
    };
    let dict = PyDict::new(py);
    dict.set_item("episode", episode.episode)?;
    dict.set_item("row", PyArray1::from_iter(py, episode.rows.iter().map(|&row| row as i64)))?;
    let since = episode.stamps.iter().map(|stamp| (stamp - episode.stamps[0]) as f64 * 1e-9);
    dict.set_item("t", PyArray1::from_iter(py, since))?;
    dict.set_item("x", part(&episode.followed, 0, states)?)?;
    dict.set_item("u", part(&episode.followed, states, width)?)?;
    dict.set_item("x_measured", part(&episode.recorded, 0, states)?)?;
    dict.set_item("u_measured", part(&episode.recorded, states, width)?)?;
    dict.set_item("x_open_loop", array(py, episode.open_loop.clone(), &[rows, states])?)?;
    Ok(dict)
}

fn outside(word: &str) -> PyResult<Outside> {
    match word {
        "tell" => Ok(Outside::Tell),
        "end" => Ok(Outside::End),
        "hold" => Ok(Outside::Hold),
        other => Err(Kind::Option.error(format!("outside={other:?}: give 'tell', 'end' or 'hold'"))),
    }
}

fn to_dict<'py>(py: Python<'py>, trajectory: &Trajectory) -> PyResult<Bound<'py, PyDict>> {
    let rows = trajectory.time.len();
    let width = trajectory.states.len() / rows.max(1);
    let dict = PyDict::new(py);
    dict.set_item("episode", trajectory.start.episode)?;
    dict.set_item("row", trajectory.start.row)?;
    dict.set_item("t", PyArray1::from_slice(py, &trajectory.time))?;
    dict.set_item("x", array(py, trajectory.states.clone(), &[rows, width])?)?;
    let inputs = PyArray1::from_slice(py, &trajectory.inputs);
    let steps = trajectory.steps();
    let driven = trajectory.inputs.len().checked_div(steps).unwrap_or(0);
    dict.set_item("u", inputs.reshape([if driven == 0 { 0 } else { steps }, driven])?)?;
    dict.set_item("region", PyArray1::from_iter(py, trajectory.regions.iter().map(|&index| region(index))))?;
    let end = match trajectory.end {
        End::Horizon => "horizon",
        End::Diverged => "diverged",
        End::NoRegion => "no region",
        End::LeftDomain => "left domain",
    };
    dict.set_item("end", end)?;
    dict.set_item("left_domain", trajectory.left_domain)?;
    Ok(dict)
}
