//! Filtered states as a table.

use std::path::Path;

use fleetfoot_dynamics::filter::SwitchedFilter;
use fleetfoot_log::{TableWriter, Values, WriteColumn, WriteKind};
use fleetfoot_model::Model;

use super::{Kind, kind, table_options};
use crate::{Error, Logs, filter::FilteredRows};

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

    pub(crate) fn write(&mut self, episode: &str, found: &FilteredRows) -> Result<(), Error> {
        let rows = 0..found.rows();
        let column = |of: &dyn Fn(usize) -> f64| -> Vec<f64> { rows.clone().map(of).collect() };
        let mut numbers = Vec::new();
        for state in 0..self.states {
            numbers.push(column(&|row| found.mean(row, state)));
            numbers.push(column(&|row| found.deviation(row, state)));
        }
        for sensor in 0..self.sensors {
            numbers.push(column(&|row| found.innovation(row, sensor)));
            numbers.push(column(&|row| found.innovation_deviation(row, sensor)));
        }
        for region in 0..self.regions {
            numbers.push(column(&|row| found.probability(row, region)));
        }
        numbers.push(found.log_likelihood.clone());
        // The lowest of equally probable ones.
        let likely = |row: usize| {
            (1..self.regions).fold(0, |best, own| {
                if found.probability(row, own) > found.probability(row, best) { own } else { best }
            })
        };
        let regions: Vec<i64> = rows.clone().map(|row| likely(row) as i64).collect();
        let names = vec![episode; found.rows()];
        let mut values = vec![Values::Text(&names), Values::Integer(&found.stamps)];
        values.extend(numbers.iter().map(|column| Values::Float(column)));
        values.push(Values::Integer(&regions));
        self.writer.write(&values)?;
        Ok(())
    }

    pub(crate) fn finish(self) -> Result<(), Error> {
        Ok(self.writer.finish()?)
    }
}
