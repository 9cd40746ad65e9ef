//! A plane's cells as a table.

use std::path::Path;

use fleetfoot_dataset::Logs;
use fleetfoot_dynamics::Plane;
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_output::{TableWriter, Values, WriteColumn, WriteKind};

use super::table_options;

/// Writes a row a cell: the centres of its two bins under the axes' names, counts, transition ratio, mean score.
pub(crate) fn write_plane(path: &Path, model: &Model, plane: &Plane, logs: &Logs) -> Result<(), Error> {
    let [a, b] = &plane.axes;
    let names = [a, b].map(|axis| axis.expression.to_string());
    let unit = |name: &String| model.column(name).and_then(|column| model.columns[column].unit.clone());
    let mut columns: Vec<WriteColumn> = names
        .iter()
        .map(|name| {
            let column = WriteColumn::new(name, WriteKind::Float);
            unit(name).into_iter().fold(column, |column, unit| column.with_unit(unit))
        })
        .collect();
    columns.extend(["rows", "passages", "transitions"].map(|name| WriteColumn::new(name, WriteKind::Integer)));
    columns.push(WriteColumn::new("transition_ratio", WriteKind::Float));
    columns.push(WriteColumn::new("scored", WriteKind::Integer));
    columns.push(WriteColumn::new("score", WriteKind::Float));
    let bins = plane.bins;
    let centres = |axis: &fleetfoot_dynamics::Axis, bin: &dyn Fn(usize) -> usize| -> Vec<f64> {
        (0..bins * bins).map(|cell| axis.centre(bin(cell), bins)).collect()
    };
    let (across, up) = (centres(a, &|cell| cell / bins), centres(b, &|cell| cell % bins));
    let count = |of: fn(&fleetfoot_dynamics::PlaneCell) -> u64| -> Vec<i64> {
        plane.cells.iter().map(|cell| of(cell) as i64).collect()
    };
    let (rows, passages) = (count(|cell| cell.rows), count(|cell| cell.passages));
    let (transitions, scored) = (count(|cell| cell.transitions), count(|cell| cell.scored));
    let ratio: Vec<f64> = plane.cells.iter().map(|cell| cell.transition_ratio()).collect();
    let score: Vec<f64> = plane.cells.iter().map(|cell| cell.mean_score()).collect();
    let mut writer = TableWriter::create(path, columns, &table_options(model, logs))?;
    writer.write(&[
        Values::Float(&across),
        Values::Float(&up),
        Values::Integer(&rows),
        Values::Integer(&passages),
        Values::Integer(&transitions),
        Values::Float(&ratio),
        Values::Integer(&scored),
        Values::Float(&score),
    ])?;
    writer.finish()?;
    Ok(())
}
