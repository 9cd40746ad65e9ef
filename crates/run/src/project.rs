//! A model projected onto a plane of two of its columns.

use std::path::Path;

use fleetfoot_data::Progress;
use fleetfoot_data::setting::PLANE;
use fleetfoot_dataset::{Dataset, Logs};
use fleetfoot_dynamics::{Axis, Plane};
use fleetfoot_fit::Error;
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::Model;
use fleetfoot_recipe::Recipe;

use crate::output;

/// A plane, and notes about the data.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Projected {
    /// The plane.
    pub plane: Plane,
    /// Episodes projected.
    pub episodes: usize,
    /// Names of those that the model was trained on.
    pub in_sample: Vec<String>,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

/// Projects a model's regions and one-step scores on files onto the plane of two expressions over its columns, `bins` cells each way. Angles take one
/// turn, other expressions the range of their values. Writes the cells as Parquet when `output` is given.
///
/// # Errors
/// An axis that is no expression over the model's columns, or a number of axes other than two. Those of
/// [`fleetfoot_dynamics::plane`], of reading and of writing.
pub fn project(
    model: &Model,
    changes: &Recipe,
    logs: impl Into<Logs>,
    axes: &[String],
    bins: usize,
    output: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Projected, Error> {
    let [across, up] = axes else {
        return Err(Error::value(format!("{}: a plane has two columns", PLANE.to(axes.join(",")))));
    };
    if let Some(path) = output
        && output::kind(path)? != output::Kind::Table
    {
        return Err(Error::output(format!("{}: a plane is written as Parquet or CSV", path.display())));
    }
    let axes = [axis(model, across)?, axis(model, up)?];
    let logs = logs.into();
    let dataset = Dataset::for_model(model, changes, &logs, progress)?;
    let plane = plane_of_rows(model, &dataset, axes, bins, progress)?;
    if let Some(path) = output {
        output::write_plane(path, model, &plane, &logs)?;
    }
    Ok(Projected {
        plane,
        episodes: dataset.episodes().len(),
        in_sample: dataset.in_sample(model),
        notes: dataset.notes().to_vec(),
    })
}

/// Projects a model on rows that are opened.
pub fn plane_of_rows(
    model: &Model,
    dataset: &Dataset,
    [across, up]: [Expr; 2],
    bins: usize,
    progress: &dyn Progress,
) -> Result<Plane, Error> {
    let view = dataset.view()?;
    progress.stage("plane");
    let axes = [Axis::of_model(model, across, &view, progress)?, Axis::of_model(model, up, &view, progress)?];
    Ok(fleetfoot_dynamics::plane(model, &view, &axes, bins, progress)?)
}

/// An axis of a plane: a column of a model, or an expression over its columns.
pub fn axis(model: &Model, text: &str) -> Result<Expr, Error> {
    if model.column(text.trim()).is_some() {
        return Ok(Expr::column(text.trim()));
    }
    let scope = Scope::new(model.columns.iter().map(|column| column.name.as_str()));
    Expr::parse(text, &scope).map_err(|source| {
        fleetfoot_recipe::Error::Expression { place: PLANE.to_string(), text: text.to_owned(), source }.into()
    })
}
