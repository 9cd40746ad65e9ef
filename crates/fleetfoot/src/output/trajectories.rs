//! Trajectories of rollouts.

use std::path::Path;

use fleetfoot_data::{Halo, Source};
use fleetfoot_dynamics::{Rollouts, Trajectory};
use fleetfoot_log::{Overlay, ParquetWriter, SeriesId, Values, WriteColumn, WriteKind};
use fleetfoot_model::Model;

use super::{Kind, mcap_options, parquet_options};
use crate::{Error, Logs};

/// Writes trajectories. `log_offset` tells what must be added to the stamps of an episode to get the times of its recording, nanoseconds.
pub(crate) fn write_trajectories(
    kind: Kind,
    path: &Path,
    model: &Model,
    view: &dyn Source,
    log_offset: &dyn Fn(usize) -> i64,
    rollouts: &Rollouts,
    logs: &Logs,
) -> Result<(), Error> {
    match kind {
        Kind::Parquet => write_table(path, model, view, rollouts, logs),
        Kind::Mcap => write_messages(path, model, view, log_offset, rollouts, logs),
    }
}

fn write_table(path: &Path, model: &Model, view: &dyn Source, rollouts: &Rollouts, logs: &Logs) -> Result<(), Error> {
    let mut columns = vec![
        WriteColumn::new("trajectory", WriteKind::Integer),
        WriteColumn::new("episode", WriteKind::Text),
        WriteColumn::new("row", WriteKind::Integer),
        WriteColumn::new("step", WriteKind::Integer),
        WriteColumn::new("seconds", WriteKind::Float).with_unit("s"),
    ];
    for state in rollouts.states.iter().chain(&rollouts.driven_inputs) {
        let unit = model.column(state).and_then(|column| model.columns[column].unit.as_ref());
        let column = WriteColumn::new(state, WriteKind::Float);
        columns.push(unit.iter().fold(column, |column, unit| column.with_unit(unit.as_str())));
    }
    columns.push(WriteColumn::new("region", WriteKind::Integer));
    let mut writer = ParquetWriter::create(path, columns, &parquet_options(model, logs))?;
    for (index, trajectory) in rollouts.trajectories.iter().enumerate() {
        let rows = trajectory.steps() + 1;
        let numbers = vec![index as i64; rows];
        let names = vec![view.episodes()[trajectory.start.episode].name.as_str(); rows];
        let at: Vec<i64> = (0..rows).map(|step| (trajectory.start.row + step) as i64).collect();
        let steps: Vec<i64> = (0..rows as i64).collect();
        let states: Vec<Vec<f64>> = (0..rollouts.states.len())
            .map(|state| (0..rows).map(|step| trajectory.state(step)[state]).collect())
            .collect();
        // No input was given in the last state.
        let width = rollouts.driven_inputs.len();
        let inputs: Vec<Vec<f64>> = (0..width)
            .map(|input| trajectory.inputs.iter().skip(input).step_by(width).copied().chain([f64::NAN]).collect())
            .collect();
        // The last state was reached; no step was made from it.
        let regions: Vec<i64> = trajectory.regions.iter().map(|&region| i64::from(region)).chain([-1]).collect();
        let mut values = vec![
            Values::Integer(&numbers),
            Values::Text(&names),
            Values::Integer(&at),
            Values::Integer(&steps),
            Values::Float(&trajectory.time),
        ];
        values.extend(states.iter().chain(&inputs).map(|column| Values::Float(column)));
        values.push(Values::Integer(&regions));
        writer.write(&values)?;
    }
    writer.finish()?;
    Ok(())
}

/// Messages on `/fleetfoot/rollout/N` with the stamps of the rows that the states are compared with. Trajectories that overlap in time are
/// on different topics, so that a viewer draws each as a line of its own.
fn write_messages(
    path: &Path,
    model: &Model,
    view: &dyn Source,
    log_offset: &dyn Fn(usize) -> i64,
    rollouts: &Rollouts,
    logs: &Logs,
) -> Result<(), Error> {
    let mut overlay = Overlay::create(path, &mcap_options(model, logs))?;
    let mut lanes: Vec<Lane> = Vec::new();
    let names: Vec<String> = rollouts.states.iter().chain(&rollouts.driven_inputs).cloned().collect();
    let width = rollouts.driven_inputs.len();
    let nothing = vec![f64::NAN; width];
    let mut order: Vec<&Trajectory> = rollouts.trajectories.iter().collect();
    order.sort_by_key(|trajectory| (trajectory.start.episode, trajectory.start.row));
    for trajectory in order {
        let (start, rows) = (trajectory.start, trajectory.steps() + 1);
        let end = (start.row + rows).min(view.episodes()[start.episode].rows);
        let block = view.read(start.episode, start.row..end, Halo::default())?;
        let free = lanes.iter().position(|lane| lane.episode != start.episode || lane.end <= start.row);
        let lane = match free {
            Some(lane) => lane,
            None => {
                let topic = format!("/fleetfoot/rollout/{}", lanes.len());
                lanes.push(Lane { series: overlay.joint_state(&topic, &names, "")?, episode: 0, end: 0 });
                lanes.len() - 1
            }
        };
        lanes[lane] = Lane { episode: start.episode, end, ..lanes[lane] };
        for (step, &stamp) in block.stamps().iter().enumerate() {
            let log_time = stamp.saturating_add(log_offset(start.episode));
            let inputs = trajectory.inputs.chunks_exact(width.max(1)).nth(step);
            let mut values = trajectory.state(step).to_vec();
            values.extend_from_slice(inputs.unwrap_or(&nothing));
            overlay.row(lanes[lane].series, stamp, log_time, &values)?;
        }
    }
    overlay.finish()?;
    Ok(())
}

/// A topic, and up to where it is taken.
#[derive(Clone, Copy)]
struct Lane {
    series: SeriesId,
    episode: usize,
    end: usize,
}
