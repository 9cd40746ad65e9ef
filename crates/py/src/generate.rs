//! Logs of simulated robots, and a model's plane.

use std::path::PathBuf;

use fleetfoot::{
    Error, Recipe,
    generate::{Format, Job, World, generate as run_job, robots as all_robots},
};
use numpy::PyArray1;
use pyo3::{prelude::*, types::PyDict};

use crate::{
    data::Data,
    error::{Kind, OrRaise, of_engine},
    object::object,
    run::run,
};

/// Names of the robots that can be simulated.
#[pyfunction]
pub(crate) fn robots() -> Vec<&'static str> {
    all_robots()
}

/// Options of a job beside its robot and folder.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Wanted {
    runs: u64,
    first_run: u64,
    seconds: Option<f64>,
    seed: u64,
    speed: Option<(f64, f64)>,
    format: Option<String>,
    truth: bool,
    force: bool,
    excitation: Option<String>,
    controller: Option<String>,
}

/// The parameters of a robot as TOML with comments: its own, changed by TOML text and by single settings.
#[pyfunction]
#[pyo3(signature = (robot, text = None, settings = Vec::new()))]
pub(crate) fn world(robot: &str, text: Option<&str>, settings: Vec<(String, String)>) -> PyResult<String> {
    Ok(world_of(robot, text, &settings, None).map_err(of_engine)?.to_commented_toml())
}

fn world_of(
    robot: &str,
    text: Option<&str>,
    settings: &[(String, String)],
    excitation: Option<&str>,
) -> Result<World, Error> {
    let mut world = World::of(robot)?;
    if let Some(text) = text {
        world = world.parse(text, "the world")?;
    }
    if let Some(kind) = excitation {
        if !world.excitable() {
            return Err(Error::conflict(format!(
                "excitation: only the controller drives `{}`, so it has no excitation; leave it out",
                world.robot()
            )));
        }
        world.excite(kind)?;
    }
    for (path, value) in settings {
        world.set(path, value)?;
    }
    Ok(world)
}

/// Runs a robot and writes its logs and a recipe; returns a report as a dict.
#[pyfunction]
#[pyo3(signature = (robot, folder, text, settings, wanted, progress = None))]
pub(crate) fn generate<'py>(
    py: Python<'py>,
    robot: &str,
    folder: PathBuf,
    text: Option<&str>,
    settings: Vec<(String, String)>,
    wanted: &Bound<'py, PyDict>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let wanted: Wanted = wanted.extract()?;
    let mut world = world_of(robot, text, &settings, wanted.excitation.as_deref()).map_err(of_engine)?;
    if let Some(what) = &wanted.controller {
        let law = fleetfoot::controller_file(what).map_err(of_engine)?.law;
        world.regulate(&law).map_err(of_engine)?;
    }
    let mut job = Job::new(world, folder);
    match wanted.format.as_deref() {
        None => {}
        Some("mcap") => job.format = Format::Mcap,
        Some("parquet") => job.format = Format::Parquet,
        Some(other) => return Err(Kind::Request.error(format!("format=\"{other}\": write \"mcap\" or \"parquet\""))),
    }
    (job.runs, job.first_run, job.seed) = (wanted.runs, wanted.first_run, wanted.seed);
    (job.truth, job.force, job.speed) = (wanted.truth, wanted.force, wanted.speed);
    job.seconds = wanted.seconds.unwrap_or(job.seconds);
    let made = run(py, progress, |progress| run_job(&job, progress))?;
    object(py, &made)
}

/// A model's regions and one-step scores on the plane of two expressions over its columns, as a dict of arrays of
/// `bins * bins` cells. The second axis' cells of the first axis' first bin come first.
#[pyfunction]
#[pyo3(signature = (model, data, recipe, x, y, bins, progress = None))]
#[expect(clippy::too_many_arguments, reason = "a plane has a model, data, two axes and a number of bins")]
pub(crate) fn project<'py>(
    py: Python<'py>,
    model: &str,
    data: &Data,
    recipe: &str,
    x: String,
    y: String,
    bins: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let model = fleetfoot::Model::from_json(model, "the model").or_raise(Kind::Model)?;
    let changes = Recipe::parse(recipe, "the recipe").map_err(of_engine)?;
    let axes = [x, y];
    let plane =
        run(py, progress, |progress| fleetfoot::project(&model, &changes, &data.logs, &axes, bins, None, progress))?
            .plane;
    let out = PyDict::new(py);
    for (name, axis) in ["x", "y"].into_iter().zip(&plane.axes) {
        out.set_item(name, (axis.low, axis.high, axis.periodic))?;
    }
    let cells =
        |value: fn(&fleetfoot::dynamics::PlaneCell) -> f64| PyArray1::from_iter(py, plane.cells.iter().map(value));
    out.set_item("rows", cells(|cell| cell.rows as f64))?;
    out.set_item("transitions", cells(fleetfoot::dynamics::PlaneCell::transition_ratio))?;
    out.set_item("score", cells(fleetfoot::dynamics::PlaneCell::mean_score))?;
    out.set_item("outside", plane.outside)?;
    Ok(out)
}
