//! Recordings, and the trajectories that follow them.

use std::path::Path;

use fleetfoot_dataset::Logs;
use fleetfoot_estimate::Resimulated;
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_output::{Overlay, TableWriter, Values, WriteColumn, WriteKind};

use super::Followed;
use crate::output::{Kind, Line, Plot, finish_with_layouts, mcap_options, table_options};

/// The topics of messages.
const TOPICS: [&str; 3] = ["/fleetfoot/measured", "/fleetfoot/followed", "/fleetfoot/open_loop"];

/// Writes, for every row of the grid, each column as measured and as followed, and the states of the open loop.
/// `log_offset`: offset from the stamps of an episode to the times of its recording, nanoseconds.
pub(crate) fn write_followed(
    kind: Kind,
    path: &Path,
    model: &Model,
    log_offset: &dyn Fn(usize) -> i64,
    followed: &Followed,
    logs: &Logs,
) -> Result<(), Error> {
    match kind {
        Kind::Table => write_table(path, model, followed, logs),
        Kind::Mcap => write_messages(path, model, log_offset, followed, logs),
    }
}

/// A column of values by rows.
fn column(values: &[f64], width: usize, at: usize) -> Vec<f64> {
    values.iter().skip(at).step_by(width).copied().collect()
}

fn write_table(path: &Path, model: &Model, followed: &Followed, logs: &Logs) -> Result<(), Error> {
    let resimulation = &followed.resimulation;
    let mut columns = vec![
        WriteColumn::new("episode", WriteKind::Text),
        WriteColumn::new("time", WriteKind::Stamp),
        WriteColumn::new("row", WriteKind::Integer),
    ];
    for (at, (name, unit)) in resimulation.columns.iter().zip(&followed.units).enumerate() {
        let mut names = vec![name.clone(), format!("{name} measured")];
        names.extend((at < resimulation.states).then(|| format!("{name} open loop")));
        for name in names {
            let column = WriteColumn::new(name, WriteKind::Float);
            columns.push(unit.iter().fold(column, |column, unit| column.with_unit(unit)));
        }
    }
    let mut writer = TableWriter::create(path, columns, &table_options(model, logs))?;
    for (episode, name) in resimulation.episodes.iter().zip(&followed.names) {
        let names = vec![name.as_str(); episode.rows.len()];
        let rows: Vec<i64> = episode.rows.iter().map(|&row| row as i64).collect();
        let width = resimulation.columns.len();
        let mut numbers = Vec::new();
        for at in 0..width {
            numbers.extend([column(&episode.followed, width, at), column(&episode.recorded, width, at)]);
            numbers.extend((at < resimulation.states).then(|| column(&episode.open_loop, resimulation.states, at)));
        }
        let mut values = vec![Values::Text(&names), Values::Integer(&episode.stamps), Values::Integer(&rows)];
        values.extend(numbers.iter().map(|column| Values::Float(column)));
        writer.write(&values)?;
    }
    writer.finish()?;
    Ok(())
}

/// Messages on [`TOPICS`] with the stamps of the rows.
fn write_messages(
    path: &Path,
    model: &Model,
    log_offset: &dyn Fn(usize) -> i64,
    followed: &Followed,
    logs: &Logs,
) -> Result<(), Error> {
    let resimulation = &followed.resimulation;
    let mut overlay = Overlay::create(path, &mcap_options(model, logs))?;
    let states = &resimulation.columns[..resimulation.states];
    let measured = overlay.joint_state(TOPICS[0], &resimulation.columns, "")?;
    let followed = overlay.joint_state(TOPICS[1], &resimulation.columns, "")?;
    let open_loop = overlay.joint_state(TOPICS[2], states, "")?;
    let mut order: Vec<&Resimulated> = resimulation.episodes.iter().collect();
    order.sort_by_key(|order| order.episode);
    for order in order {
        for (k, &stamp) in order.stamps.iter().enumerate() {
            let log_time = stamp.saturating_add(log_offset(order.episode));
            let series = [
                (measured, &order.recorded, resimulation.columns.len()),
                (followed, &order.followed, resimulation.columns.len()),
            ];
            for (series, values, width) in
                series.into_iter().chain([(open_loop, &order.open_loop, resimulation.states)])
            {
                let values = &values[k * width..(k + 1) * width];
                if values.iter().any(|value| value.is_finite()) {
                    overlay.row(series, stamp, log_time, values)?;
                }
            }
        }
    }
    let line = |topic: &str, place: usize, name: &String, what: &str| Line {
        topic: topic.to_owned(),
        name: name.clone(),
        place,
        label: format!("{name} {what}"),
    };
    let plot = |(place, name): (usize, &String)| {
        let mut lines = vec![line(TOPICS[0], place, name, "measured"), line(TOPICS[1], place, name, "followed")];
        lines.extend((place < resimulation.states).then(|| line(TOPICS[2], place, name, "open loop")));
        Plot { title: name.clone(), lines }
    };
    let plots: Vec<Plot> = resimulation.columns.iter().enumerate().map(plot).collect();
    finish_with_layouts(overlay, path, &plots)
}
