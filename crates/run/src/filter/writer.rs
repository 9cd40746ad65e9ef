//! Filtered states, row by row.

use std::path::{Path, PathBuf};

use fleetfoot_control::filter::SwitchedFilter;
use fleetfoot_dataset::Logs;
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_output::{Overlay, SeriesId, TableWriter, Values, WriteColumn, WriteKind};

use super::FilteredRows;
use crate::output::{Kind, Line, Plot, finish_with_layouts, mcap_options, table_options};

/// Topics of messages: measurements, mean and deviation of every state, innovation and its deviation of every sensor,
/// and the values that a row has once.
const TOPICS: [&str; 6] = [
    "/fleetfoot/measured",
    "/fleetfoot/estimate",
    "/fleetfoot/deviation",
    "/fleetfoot/innovation",
    "/fleetfoot/innovation_deviation",
    "/fleetfoot/region",
];

/// Writes a table, or messages on [`TOPICS`] with the stamps of their rows. Each row has episode, time, mean and
/// deviation of every state, the most probable region, the probability of every region, innovation and its deviation of
/// every sensor, and its log-likelihood.
pub(crate) struct FilteredWriter {
    sink: Sink,
    states: usize,
    regions: usize,
    sensors: usize,
}

enum Sink {
    Table(TableWriter),
    Mcap { overlay: Box<Overlay>, topics: [SeriesId; 6], path: PathBuf, plots: Vec<Plot> },
}

impl FilteredWriter {
    pub(crate) fn create(
        kind: Kind,
        path: &Path,
        model: &Model,
        filter: &SwitchedFilter,
        logs: &Logs,
    ) -> Result<Self, Error> {
        let sink = match kind {
            Kind::Table => Sink::Table(TableWriter::create(path, columns(model, filter), &table_options(model, logs))?),
            Kind::Mcap => {
                let mut overlay = Overlay::create(path, &mcap_options(model, logs))?;
                let sensors: Vec<String> = filter.measured().map(|state| filter.states()[state].clone()).collect();
                let mut about = vec!["region".to_owned(), "log_likelihood".to_owned()];
                about.extend(filter.region_names().map(|region| format!("probability_{region}")));
                let names = [&sensors, filter.states(), filter.states(), &sensors, &sensors, &about];
                let mut topic = |at: usize| overlay.joint_state(TOPICS[at], names[at], "");
                let topics = [topic(0)?, topic(1)?, topic(2)?, topic(3)?, topic(4)?, topic(5)?];
                Sink::Mcap { overlay: Box::new(overlay), topics, path: path.to_owned(), plots: plots(filter) }
            }
        };
        let (states, regions, sensors) = (filter.states().len(), filter.regions(), filter.measured().len());
        Ok(Self { sink, states, regions, sensors })
    }

    pub(crate) fn write(&mut self, filtered_rows: &FilteredRows) -> Result<(), Error> {
        let (states, regions, sensors) = (self.states, self.regions, self.sensors);
        match &mut self.sink {
            Sink::Table(writer) => write_table(writer, filtered_rows, states, regions, sensors),
            Sink::Mcap { overlay, topics, .. } => {
                write_messages(overlay, topics, filtered_rows, states, regions, sensors)
            }
        }
    }

    pub(crate) fn finish(self) -> Result<(), Error> {
        match self.sink {
            Sink::Table(writer) => writer.finish()?,
            Sink::Mcap { overlay, path, plots, .. } => finish_with_layouts(*overlay, &path, &plots)?,
        }
        Ok(())
    }
}

fn columns(model: &Model, filter: &SwitchedFilter) -> Vec<WriteColumn> {
    let mut columns = vec![WriteColumn::new("episode", WriteKind::Text), WriteColumn::new("time", WriteKind::Stamp)];
    let mut push = |name: String, state: Option<&String>| {
        let unit = state.and_then(|state| model.column(state)).and_then(|at| model.columns[at].unit.as_ref());
        let column = WriteColumn::new(name, WriteKind::Float);
        columns.push(unit.into_iter().fold(column, |column, unit| column.with_unit(unit)));
    };
    for state in filter.states() {
        push(state.clone(), Some(state));
        push(format!("{state} deviation"), Some(state));
    }
    for state in filter.measured().map(|state| &filter.states()[state]) {
        push(format!("{state} innovation"), Some(state));
        push(format!("{state} innovation deviation"), Some(state));
    }
    filter.region_names().for_each(|region| push(format!("probability {region}"), None));
    push("log likelihood".into(), None);
    columns.push(WriteColumn::new("region", WriteKind::Integer));
    columns
}

/// The estimate over the measurements, a plot a state.
fn plots(filter: &SwitchedFilter) -> Vec<Plot> {
    let plot = |(place, name): (usize, &String)| {
        let line = |topic: &str, place: usize, what: &str| Line {
            topic: topic.to_owned(),
            name: name.clone(),
            place,
            label: format!("{name} {what}"),
        };
        let sensor = filter.measured().position(|state| state == place);
        let measured = sensor.map(|sensor| line(TOPICS[0], sensor, "measured"));
        let lines = measured.into_iter().chain([line(TOPICS[1], place, "estimate")]).collect();
        Plot { title: name.clone(), lines }
    };
    filter.states().iter().enumerate().map(plot).collect()
}

/// -1 for a row that the filter was lost before.
fn region(filtered_rows: &FilteredRows, row: usize) -> i64 {
    filtered_rows.region(row).map_or(-1, |region| region as i64)
}

fn write_table(
    writer: &mut TableWriter,
    filtered_rows: &FilteredRows,
    states: usize,
    regions: usize,
    sensors: usize,
) -> Result<(), Error> {
    let rows = filtered_rows.rows();
    let column =
        |of: &[f64], width: usize, at: usize| -> Vec<f64> { (0..rows).map(|row| of[row * width + at]).collect() };
    let mut numbers = Vec::new();
    for state in 0..states {
        numbers.push(column(filtered_rows.means(), states, state));
        numbers.push(column(filtered_rows.deviations(), states, state));
    }
    for sensor in 0..sensors {
        numbers.push(column(filtered_rows.innovations(), sensors, sensor));
        numbers.push(column(filtered_rows.innovation_deviations(), sensors, sensor));
    }
    numbers.extend((0..regions).map(|region| column(filtered_rows.probabilities(), regions, region)));
    numbers.push(filtered_rows.log_likelihood().to_vec());
    let regions: Vec<i64> = (0..rows).map(|row| region(filtered_rows, row)).collect();
    let names = vec![filtered_rows.episode(); rows];
    let mut values = vec![Values::Text(&names), Values::Integer(filtered_rows.stamps())];
    values.extend(numbers.iter().map(|column| Values::Float(column)));
    values.push(Values::Integer(&regions));
    writer.write(&values)?;
    Ok(())
}

/// Writes the messages. A missing measurement leaves a gap in the lines that a viewer draws.
fn write_messages(
    overlay: &mut Overlay,
    topics: &[SeriesId; 6],
    filtered_rows: &FilteredRows,
    states: usize,
    regions: usize,
    sensors: usize,
) -> Result<(), Error> {
    for (row, &stamp) in filtered_rows.stamps().iter().enumerate() {
        let log_time = stamp.saturating_add(filtered_rows.log_offset());
        let of = |values: &[f64], width: usize| values[row * width..][..width].to_vec();
        let mut about = vec![region(filtered_rows, row) as f64, filtered_rows.log_likelihood()[row]];
        about.extend(of(filtered_rows.probabilities(), regions));
        let values = [
            (0..sensors).map(|sensor| filtered_rows.measured(row, sensor)).collect(),
            of(filtered_rows.means(), states),
            of(filtered_rows.deviations(), states),
            of(filtered_rows.innovations(), sensors),
            of(filtered_rows.innovation_deviations(), sensors),
            about,
        ];
        for (&topic, values) in topics.iter().zip(&values) {
            if row < filtered_rows.known && values.iter().any(|value| value.is_finite()) {
                overlay.row(topic, stamp, log_time, values)?;
            }
        }
    }
    Ok(())
}
