//! Filtered states as a table.

use std::path::Path;

use fleetfoot_dynamics::filter::SwitchedFilter;
use fleetfoot_log::{TableWriter, Values, WriteColumn, WriteKind};
use fleetfoot_model::Model;

use super::{Kind, kind, table_options};
use crate::{Error, FilteredRows, Logs};

/// Refuses what is no table.
pub(crate) fn table_only(path: &Path) -> Result<(), Error> {
    match kind(path)? {
        Kind::Table => Ok(()),
        Kind::Mcap => Err(Error::output(format!(
            "{}: filtered states are written as tables; name the file *.parquet, *.csv or *.tsv",
            path.display()
        ))),
    }
}

/// Writes, row by row: episode, time, mean and deviation of every state, the region that is most probable, the probability of every region, innovation and its deviation of
/// every sensor, and the log-likelihood of the row.
pub(crate) struct FilteredWriter {
    writer: TableWriter,
    states: usize,
    regions: usize,
    sensors: usize,
}

impl FilteredWriter {
    pub(crate) fn create(path: &Path, model: &Model, filter: &SwitchedFilter, logs: &Logs) -> Result<Self, Error> {
        let mut columns =
            vec![WriteColumn::new("episode", WriteKind::Text), WriteColumn::new("time", WriteKind::Stamp)];
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
        Ok(Self {
            writer: TableWriter::create(path, columns, &table_options(model, logs))?,
            states: filter.states().len(),
            regions: filter.regions(),
            sensors: filter.measured().len(),
        })
    }

    pub(crate) fn write(&mut self, found: &FilteredRows) -> Result<(), Error> {
        let rows = found.rows();
        let column =
            |of: &[f64], width: usize, at: usize| -> Vec<f64> { (0..rows).map(|row| of[row * width + at]).collect() };
        let mut numbers = Vec::new();
        for state in 0..self.states {
            numbers.push(column(found.means(), self.states, state));
            numbers.push(column(found.deviations(), self.states, state));
        }
        for sensor in 0..self.sensors {
            numbers.push(column(found.innovations(), self.sensors, sensor));
            numbers.push(column(found.innovation_deviations(), self.sensors, sensor));
        }
        numbers.extend((0..self.regions).map(|region| column(found.probabilities(), self.regions, region)));
        numbers.push(found.log_likelihood().to_vec());
        let regions: Vec<i64> = (0..rows).map(|row| found.region(row) as i64).collect();
        let names = vec![found.episode(); rows];
        let mut values = vec![Values::Text(&names), Values::Integer(found.stamps())];
        values.extend(numbers.iter().map(|column| Values::Float(column)));
        values.push(Values::Integer(&regions));
        self.writer.write(&values)?;
        Ok(())
    }

    pub(crate) fn finish(self) -> Result<(), Error> {
        Ok(self.writer.finish()?)
    }
}
