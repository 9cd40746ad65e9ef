//! A model's plane as heat maps: the second half of `fleetfoot score --plane`.

use fleetfoot::{
    Projected,
    dynamics::{Axis, Plane, PlaneCell},
};
use serde::Serialize;

use crate::{heatmap::HeatMap, table::number};

/// Cells of a heat map along each axis, at most: it shall fit a terminal.
const SHOWN: usize = 40;

/// Neighbouring cells as one, so that the map fits.
fn shown(plane: &Plane, across: usize, up: usize, step: usize) -> PlaneCell {
    let mut sum = PlaneCell::default();
    for i in across * step..((across + 1) * step).min(plane.bins) {
        for j in up * step..((up + 1) * step).min(plane.bins) {
            let cell = plane.cell(i, j);
            sum.rows += cell.rows;
            sum.passages += cell.passages;
            sum.transitions += cell.transitions;
            sum.scored += cell.scored;
            sum.score += cell.score;
        }
    }
    sum
}

/// One heat map of a plane.
pub(crate) fn map(plane: &Plane, title: &str, value: &dyn Fn(&PlaneCell) -> f64) -> String {
    let step = plane.bins.div_ceil(SHOWN);
    let cells = plane.bins.div_ceil(step);
    let [across, up] = &plane.axes;
    let label = |axis: &Axis, value: f64| if value == 0.0 { "0".to_owned() } else { number(value.min(axis.high)) };
    let ends = (label(across, across.low), label(across, across.high));
    let name = across.expression.to_string();
    let gap = (2 * cells).saturating_sub(ends.0.len() + name.len() + ends.1.len());
    let below = format!("{}{}{name}{}{}", ends.0, " ".repeat(gap / 2), " ".repeat(gap - gap / 2), ends.1);
    HeatMap {
        title,
        value: &|i, j| value(&shown(plane, i, j, step)),
        columns: cells,
        rows: cells,
        row_label: &|row| match row {
            0 => label(up, up.low),
            row if row + 1 == cells => label(up, up.high),
            row if row == cells / 2 => up.expression.to_string(),
            _ => String::new(),
        },
        below: &below,
    }
    .text()
}

pub(crate) fn to_text(projected: &Projected) -> String {
    let plane = &projected.plane;
    let total = plane.total();
    let mut text = format!(
        "{} rows on the plane, {} outside; {} passages through its cells, {} with a change of region ({:.1} %)",
        total.rows,
        plane.outside,
        total.passages,
        total.transitions,
        100.0 * total.transition_ratio()
    );
    if total.transitions > 0 {
        let title = "transition ratio: share of a cell's passages in which the region changes";
        text.push_str(&format!("\n\n{}", map(plane, title, &PlaneCell::transition_ratio)));
    }
    let title = "mean Mahalanobis score of the one-step errors";
    text.push_str(&format!("\n\n{}", map(plane, title, &PlaneCell::mean_score)));
    text
}

/// A plane for programs: its axes, and of every cell the rows, passages, transitions, scored rows and mean score.
#[derive(Serialize)]
pub(crate) struct PlaneReport {
    bins: usize,
    outside: u64,
    rows: u64,
    passages: u64,
    transitions: u64,
    transition_ratio: f64,
    score: f64,
    axes: [AxisReport; 2],
    cells: Vec<(u64, u64, u64, u64, f64)>,
}

#[derive(Serialize)]
struct AxisReport {
    expression: String,
    low: f64,
    high: f64,
    angle: bool,
}

impl From<&Axis> for AxisReport {
    fn from(axis: &Axis) -> Self {
        Self { expression: axis.expression.to_string(), low: axis.low, high: axis.high, angle: axis.periodic }
    }
}

impl From<&Projected> for PlaneReport {
    fn from(projected: &Projected) -> Self {
        let plane = &projected.plane;
        let total = plane.total();
        let cell = |cell: &PlaneCell| (cell.rows, cell.passages, cell.transitions, cell.scored, cell.mean_score());
        Self {
            bins: plane.bins,
            outside: plane.outside,
            rows: total.rows,
            passages: total.passages,
            transitions: total.transitions,
            transition_ratio: total.transition_ratio(),
            score: total.mean_score(),
            axes: plane.axes.each_ref().map(AxisReport::from),
            cells: plane.cells.iter().map(cell).collect(),
        }
    }
}
