//! Files into tables: messages of a topic, joined rows, and the content of a file.

use std::path::PathBuf;

use fleetfoot::{
    Recipe,
    log::{MessageColumns, Messages, TopicInfo, inspect, inspect_values},
    model_rows, read_rows,
};
use numpy::{PyArray1, PyArray2};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    data::Data,
    error::{Kind, OrRaise, of_engine},
    object::object,
    run::run,
    table::{Table, TableBuilder},
};

/// The messages of a topic as a table, one row each: `log_time`, `publish_time`, `header_stamp` where there are headers, and the fields.
#[pyfunction]
#[pyo3(signature = (path, topic, fields = None, progress = None))]
pub(crate) fn read_messages(
    py: Python<'_>,
    path: PathBuf,
    topic: String,
    fields: Option<Vec<String>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Table> {
    let read =
        run(py, progress, |progress| Ok(Messages::open(&path)?.columns(&topic, fields.as_deref(), progress)?))?;
    let MessageColumns { log_time, publish_time, header_stamp, fields, notes, .. } = read;
    let mut table = TableBuilder::default();
    table.stamps("log_time", log_time);
    table.stamps("publish_time", publish_time);
    if header_stamp.iter().any(|&stamp| stamp != i64::MIN) {
        table.stamps("header_stamp", header_stamp);
    }
    for field in fields {
        table.values(&field.name, None, &field.kind, field.values);
    }
    table.finish(notes).or_raise(Kind::Data)
}

/// Topics of a robot's log with their numbers of messages.
#[pyfunction]
pub(crate) fn topics(py: Python<'_>, path: PathBuf) -> PyResult<Vec<(String, Option<u64>)>> {
    let topics_read = run(py, None, |_| Ok(Messages::open(&path)?.topics()?))?;
    Ok(topics_read.into_iter().map(|topic: TopicInfo| (topic.name, topic.messages)).collect())
}

/// Rows as a table: the episode, the stamp, seconds since the episode's begin, and columns of the recipe, fields, or expressions over both.
#[pyfunction]
#[pyo3(signature = (data, recipe, columns = None, base = None, rate = None, stamp = None, progress = None))]
#[expect(clippy::too_many_arguments, reason = "all but the data and the recipe may be left out")]
pub(crate) fn read_table(
    py: Python<'_>,
    data: &Data,
    recipe: &str,
    columns: Option<Vec<String>>,
    base: Option<String>,
    rate: Option<f64>,
    stamp: Option<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Table> {
    let mut recipe = Recipe::parse(recipe, "the recipe").map_err(of_engine)?;
    if base.is_some() || rate.is_some() {
        (recipe.time.base, recipe.time.rate) = (base, rate);
    }
    recipe.time.stamp = stamp.or(recipe.time.stamp);
    let rows = run(py, progress, |progress| read_rows(&recipe, columns.as_deref(), &data.logs, progress))?;
    let mut table = TableBuilder::default();
    table.texts("episode", &rows.episodes, rows.episode.iter().map(|&episode| Some(episode as i32)).collect());
    table.stamps("stamp", rows.stamps);
    let unused = |name: &str| rows.columns.iter().all(|(column, _)| column.name != name);
    let seconds = if unused("t") { "t" } else { "seconds" };
    if unused(seconds) {
        table.values(seconds, Some("s"), &fleetfoot::ColumnKind::Float, rows.seconds);
    }
    for (column, values) in rows.columns {
        table.values(&column.name, column.unit.as_deref(), &column.kind, values);
    }
    table.finish(rows.notes).or_raise(Kind::Data)
}

/// Columns and values of a model (as JSON) at rows, as a dict of arrays.
#[pyfunction]
#[pyo3(signature = (model, data, recipe = "", progress = None))]
pub(crate) fn read_model_rows<'py>(
    py: Python<'py>,
    model: &str,
    data: &Data,
    recipe: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let model = fleetfoot::Model::from_json(model, "the model").or_raise(Kind::Model)?;
    let changes = Recipe::parse(recipe, "the recipe").map_err(of_engine)?;
    let rows = run(py, progress, |progress| model_rows(&model, &changes, &data.logs, progress))?;
    let matrix = |columns: &[Vec<f64>]| {
        // Targets x rows; its transpose has a column for each target.
        PyArray2::from_vec2(py, columns).or_raise(Kind::Internal).and_then(|array| array.call_method0("transpose"))
    };
    let out = PyDict::new(py);
    out.set_item("episodes", &rows.rows.episodes)?;
    out.set_item("episode", PyArray1::from_slice(py, &rows.rows.episode))?;
    out.set_item("seconds", PyArray1::from_slice(py, &rows.rows.seconds))?;
    out.set_item("targets", &rows.targets)?;
    out.set_item("wrapped", &rows.wrapped)?;
    out.set_item("measured", matrix(&rows.measured)?)?;
    out.set_item("predicted", matrix(&rows.predicted)?)?;
    let region = rows.region.iter().map(|&region| if region == u32::MAX { -1 } else { i64::from(region) });
    out.set_item("region", PyArray1::from_iter(py, region))?;
    out.set_item("in_sample", &rows.in_sample)?;
    out.set_item("notes", &rows.rows.notes)?;
    let units = PyDict::new(py);
    let columns = PyDict::new(py);
    for ((column, values), model_column) in rows.rows.columns.iter().zip(&model.columns) {
        let role = match model_column.role {
            fleetfoot::model::Role::State => "state",
            fleetfoot::model::Role::Input => "input",
            _ => "auxiliary",
        };
        columns.set_item(&column.name, (role, PyArray1::from_slice(py, values)))?;
        units.set_item(&column.name, column.unit.as_deref().or(model_column.unit.as_deref()))?;
    }
    out.set_item("columns", columns)?;
    out.set_item("units", units)?;
    Ok(out)
}

/// The factor of a 95 % interval of Student's t distribution.
#[pyfunction]
pub(crate) fn student_t_95(freedom: usize) -> f64 {
    fleetfoot::stats::student_t_95(freedom)
}

/// Content of a file, as a dict.
#[pyfunction]
#[pyo3(signature = (path, values = false, progress = None))]
pub(crate) fn info(
    py: Python<'_>,
    path: PathBuf,
    values: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'_, PyAny>> {
    let infos =
        run(py, progress, |progress| Ok(if values { inspect_values(&path, progress)? } else { inspect(&path)? }))?;
    object(py, &infos)
}
