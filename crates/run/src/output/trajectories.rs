//! Trajectories of rollouts.

use std::path::Path;

use fleetfoot_data::{Halo, Source};
use fleetfoot_dataset::Logs;
use fleetfoot_dynamics::{Rollouts, Trajectory};
use fleetfoot_fit::Error;
use fleetfoot_model::{Model, RotationKind};
use fleetfoot_output::{Overlay, SeriesId, TableWriter, Values, WriteColumn, WriteKind};

use super::{
    Kind,
    layout::{Line, Plot, finish_with_layouts},
    mcap_options, table_options,
};

/// Writes trajectories. `log_offset`: offset from the stamps of an episode to the times of its recording, nanoseconds.
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
        Kind::Table => write_table(path, model, view, rollouts, logs),
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
    let number = |name: &str, of: &str| {
        let unit = model.column(of).and_then(|column| model.columns[column].unit.as_ref());
        let column = WriteColumn::new(name, WriteKind::Float);
        unit.iter().fold(column, |column, unit| column.with_unit(unit.as_str()))
    };
    for state in &rollouts.states {
        columns.push(number(state, state));
        columns.push(number(&format!("{state} measured"), state));
    }
    columns.extend(rollouts.driven_inputs.iter().map(|input| number(input, input)));
    columns.push(WriteColumn::new("region", WriteKind::Integer));
    let mut writer = TableWriter::create(path, columns, &table_options(model, logs))?;
    let measured = Measured::new(view, rollouts, model);
    for (index, trajectory) in rollouts.trajectories.iter().enumerate() {
        let rows = trajectory.steps() + 1;
        let numbers = vec![index as i64; rows];
        let names = vec![view.episodes()[trajectory.start.episode].name.as_str(); rows];
        let at: Vec<i64> = (0..rows).map(|step| (trajectory.start.row + step) as i64).collect();
        let steps: Vec<i64> = (0..rows as i64).collect();
        let (_, recorded) = measured.read(trajectory)?;
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
        for (simulated, recorded) in states.iter().zip(&recorded) {
            values.extend([Values::Float(simulated), Values::Float(recorded)]);
        }
        values.extend(inputs.iter().map(|column| Values::Float(column)));
        values.push(Values::Integer(&regions));
        writer.write(&values)?;
    }
    writer.finish()?;
    Ok(())
}

/// Recorded values of the simulated states.
struct Measured<'a> {
    view: &'a dyn Source,
    /// Column of the view of each state.
    columns: Vec<Option<usize>>,
    /// The rotations among the states, and the place of every part.
    rotations: Vec<(RotationKind, Vec<usize>)>,
}

impl<'a> Measured<'a> {
    fn new(view: &'a dyn Source, rollouts: &Rollouts, model: &Model) -> Self {
        let columns = rollouts.states.iter().map(|state| view.column_index(state)).collect();
        Self { view, columns, rotations: model.rotations_among(&rollouts.states) }
    }

    /// The stamps of a trajectory's rows within the episode, and the measured states at each of its steps. Rotations
    /// are written as near to the simulated ones as they can be; unknown states are NaN.
    fn read(&self, trajectory: &Trajectory) -> Result<(Vec<i64>, Vec<Vec<f64>>), Error> {
        let (start, rows) = (trajectory.start, trajectory.steps() + 1);
        let end = (start.row + rows).min(self.view.episodes()[start.episode].rows);
        let block = self.view.read(start.episode, start.row..end, Halo::default())?;
        let series = |column: &Option<usize>| {
            let mut values = column.map_or_else(Vec::new, |column| block.column(column).to_vec());
            values.resize(rows, f64::NAN);
            values
        };
        let mut recorded: Vec<Vec<f64>> = self.columns.iter().map(series).collect();
        for (kind, places) in &self.rotations {
            for step in 0..rows {
                let mut parts: Vec<f64> = places.iter().map(|&place| recorded[place][step]).collect();
                let simulated: Vec<f64> = places.iter().map(|&place| trajectory.state(step)[place]).collect();
                kind.nearest(&mut parts, &simulated);
                places.iter().zip(parts).for_each(|(&place, part)| recorded[place][step] = part);
            }
        }
        Ok((block.stamps().to_vec(), recorded))
    }
}

/// Messages on `/fleetfoot/rollout/N` with the stamps of the rows that the states are compared with, and the
/// measurements there on `/fleetfoot/rollout/N/measured`. Trajectories that overlap in time are on different topics, so
/// that a viewer draws each as a separate line.
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
    let measured = Measured::new(view, rollouts, model);
    let mut order: Vec<&Trajectory> = rollouts.trajectories.iter().collect();
    order.sort_by_key(|trajectory| (trajectory.start.episode, trajectory.start.row));
    for trajectory in order {
        let start = trajectory.start;
        let (stamps, recorded) = measured.read(trajectory)?;
        let end = start.row + stamps.len();
        let free = lanes.iter().position(|lane| lane.episode != start.episode || lane.end <= start.row);
        let lane = match free {
            Some(lane) => lane,
            None => {
                let topic = format!("/fleetfoot/rollout/{}", lanes.len());
                let series = overlay.joint_state(&topic, &names, "")?;
                let measured = overlay.joint_state(&format!("{topic}/measured"), &rollouts.states, "")?;
                lanes.push(Lane { series, measured, episode: 0, end: 0 });
                lanes.len() - 1
            }
        };
        lanes[lane] = Lane { episode: start.episode, end, ..lanes[lane] };
        for (step, &stamp) in stamps.iter().enumerate() {
            let log_time = stamp.saturating_add(log_offset(start.episode));
            let inputs = trajectory.inputs.chunks_exact(width.max(1)).nth(step);
            let mut values = trajectory.state(step).to_vec();
            values.extend_from_slice(inputs.unwrap_or(&nothing));
            overlay.row(lanes[lane].series, stamp, log_time, &values)?;
            let values: Vec<f64> = recorded.iter().map(|series| series[step]).collect();
            if values.iter().any(|value| value.is_finite()) {
                overlay.row(lanes[lane].measured, stamp, log_time, &values)?;
            }
        }
    }
    finish_with_layouts(overlay, path, &plots(&rollouts.states, lanes.len()))
}

/// Lanes that a layout shows.
const SHOWN: usize = 2;

/// Simulated over measured, a plot a state.
fn plots(states: &[String], lanes: usize) -> Vec<Plot> {
    let line = |topic: String, place: usize, name: &String, what: &str| Line {
        topic,
        name: name.clone(),
        place,
        label: format!("{name} {what}"),
    };
    let lane = |lane: usize, place: usize, name: &String| {
        let topic = format!("/fleetfoot/rollout/{lane}");
        [line(format!("{topic}/measured"), place, name, "measured"), line(topic, place, name, "simulated")]
    };
    let plot = |(place, name): (usize, &String)| Plot {
        title: name.clone(),
        lines: (0..lanes.min(SHOWN)).flat_map(|at| lane(at, place, name)).collect(),
    };
    states.iter().enumerate().map(plot).collect()
}

/// A topic, and up to where it is taken.
#[derive(Clone, Copy)]
struct Lane {
    series: SeriesId,
    measured: SeriesId,
    episode: usize,
    end: usize,
}
