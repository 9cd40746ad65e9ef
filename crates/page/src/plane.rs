//! Errors of a model over the plane of two columns, and changes of region there (Fig. 9 of Buchan, Haldane, Fearing:
//! the plane of the cranks, leg phases).

use fleetfoot_data::Progress;
use fleetfoot_dataset::Dataset;
use fleetfoot_dynamics::{Axis, Plane, PlaneCell};
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_report::{Axis as Drawn, Chart, Figure, Map, Part};
use fleetfoot_run::{axis, plane_of_rows};

/// Cells along each axis.
const BINS: usize = 24;

/// The axes of a plane: those that are named, else the two angles of a model that has no others.
pub(crate) fn axes(model: &Model, named: Option<&[String; 2]>) -> Option<[String; 2]> {
    let angles: Vec<&str> =
        model.columns.iter().filter(|column| column.angle).map(|column| column.name.as_str()).collect();
    match (named, angles.as_slice()) {
        (Some(named), _) => Some(named.clone()),
        (None, [across, up]) => Some([(*across).to_owned(), (*up).to_owned()]),
        _ => None,
    }
}

/// The maps of a model on its plane.
pub(crate) fn parts(
    model: &Model,
    dataset: &Dataset,
    named: &[String; 2],
    progress: &dyn Progress,
) -> Result<Vec<Part>, Error> {
    let axes = [axis(model, &named[0])?, axis(model, &named[1])?];
    let plane = plane_of_rows(model, dataset, axes, BINS, progress)?;
    let (total, at) = (plane.total(), format!("{} and {}", named[0], named[1]));
    let mut figures = Vec::new();
    if total.transitions > 0 {
        let caption = format!(
            "Of the passages of a trajectory through each cell of {at}, the share in which the region changes. The stronger the colour, the larger the share: there the dynamics switch."
        );
        let chart = map(model, &plane, "share of passages", PlaneCell::transition_ratio);
        figures.push(Figure::new("plane-transitions", "Changes of region", caption, chart));
    }
    if total.scored > 0 {
        let caption = format!(
            "Mean Mahalanobis score of the one-step errors of the rows in each cell of {at}. The stronger the colour, the larger the errors; cells without rows are empty."
        );
        let chart = map(model, &plane, "mean Mahalanobis score", PlaneCell::mean_score);
        figures.push(Figure::new("plane-errors", "Errors in the plane", caption, chart));
    }
    Ok(figures.into_iter().map(Part::Figure).collect())
}

fn map(model: &Model, plane: &Plane, what: &str, value: fn(&PlaneCell) -> f64) -> Chart {
    let drawn = |axis: &Axis| {
        let unit = axis.expression.as_column().and_then(|name| model.columns[model.column(name)?].unit.clone());
        Drawn::of(
            axis.expression.to_string(),
            unit.unwrap_or_else(|| if axis.periodic { "rad" } else { "" }.to_owned()),
        )
        .between(axis.low, axis.high)
    };
    let column = |across: usize| (0..plane.bins).map(|up| value(plane.cell(across, up))).collect();
    Chart::Map(Map::new(what, plane.axes.each_ref().map(drawn), (0..plane.bins).map(column).collect()))
}
