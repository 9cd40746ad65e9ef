//! One-step predictions, row by row.

use std::path::{Path, PathBuf};

use fleetfoot_dataset::Logs;
use fleetfoot_dynamics::{Domain, Predicted, Predictor};
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_output::{Overlay, SeriesId, TableWriter, Values, WriteColumn, WriteKind};

use super::{
    Kind,
    layout::{Line, Plot, finish_with_layouts},
    mcap_options, table_options,
};

/// Values that are written of every fitted equation.
const KINDS: [&str; 3] = ["measured", "predicted", "residual"];

/// Origin of a block's rows.
pub(crate) struct Place<'a> {
    /// The episode's name.
    pub episode: &'a str,
    /// Offset from its stamps to the times of the recording, nanoseconds.
    pub log_offset: i64,
}

/// Writes predictions: as a table, or as messages on `/fleetfoot/measured`, `/fleetfoot/predicted`, `/fleetfoot/residual` and
/// `/fleetfoot/region`, which have the stamps of the rows that they belong to.
pub(crate) struct PredictionsWriter {
    sink: Sink,
    equations: usize,
}

enum Sink {
    Table(TableWriter),
    Mcap { overlay: Box<Overlay>, kinds: [SeriesId; 3], region: SeriesId, path: PathBuf, plots: Vec<Plot> },
}

impl PredictionsWriter {
    pub(crate) fn create(
        kind: Kind,
        path: &Path,
        model: &Model,
        predictor: &Predictor,
        logs: &Logs,
    ) -> Result<Self, Error> {
        let sink = match kind {
            Kind::Table => {
                Sink::Table(TableWriter::create(path, columns(model, predictor), &table_options(model, logs))?)
            }
            Kind::Mcap => {
                let mut overlay = Overlay::create(path, &mcap_options(model, logs))?;
                let names: Vec<String> = predictor.names().iter().map(ToString::to_string).collect();
                let mut topic = |kind: &str| overlay.joint_state(&format!("/fleetfoot/{kind}"), &names, "");
                let kinds = [topic(KINDS[0])?, topic(KINDS[1])?, topic(KINDS[2])?];
                let about = ["region", "distance", "in_domain"].map(str::to_owned);
                let region = overlay.joint_state("/fleetfoot/region", &about, "")?;
                Sink::Mcap { overlay: Box::new(overlay), kinds, region, path: path.to_owned(), plots: plots(&names) }
            }
        };
        Ok(Self { sink, equations: predictor.names().len() })
    }

    pub(crate) fn write(&mut self, place: &Place<'_>, stamps: &[i64], predicted: &Predicted) -> Result<(), Error> {
        match &mut self.sink {
            Sink::Table(writer) => write_table(writer, place.episode, stamps, predicted, self.equations),
            Sink::Mcap { overlay, kinds, region, .. } => {
                write_messages(overlay, *kinds, *region, place.log_offset, stamps, predicted, self.equations)
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

/// Predicted over measured, a plot a target.
fn plots(names: &[String]) -> Vec<Plot> {
    let line = |place: usize, name: &String, kind: &str| Line {
        topic: format!("/fleetfoot/{kind}"),
        name: name.clone(),
        place,
        label: format!("{name} {kind}"),
    };
    let plot = |(place, name): (usize, &String)| Plot {
        title: name.clone(),
        lines: KINDS[..2].iter().map(|kind| line(place, name, kind)).collect(),
    };
    names.iter().enumerate().map(plot).collect()
}

fn columns(model: &Model, predictor: &Predictor) -> Vec<WriteColumn> {
    let mut columns = vec![WriteColumn::new("episode", WriteKind::Text), WriteColumn::new("time", WriteKind::Stamp)];
    for (name, equation) in predictor.names().iter().zip(model.fitted()) {
        for kind in KINDS {
            let column = WriteColumn::new(format!("{name} {kind}"), WriteKind::Float);
            columns.push(equation.unit.iter().fold(column, |column, unit| column.with_unit(unit)));
        }
    }
    columns.push(WriteColumn::new("region", WriteKind::Integer));
    columns.push(WriteColumn::new("distance", WriteKind::Float));
    columns.push(WriteColumn::new("in_domain", WriteKind::Boolean));
    columns
}

/// -1 for a row without a region.
fn region(region: u32) -> i64 {
    if region == u32::MAX { -1 } else { i64::from(region) }
}

fn write_table(
    writer: &mut TableWriter,
    episode: &str,
    stamps: &[i64],
    predicted: &Predicted,
    equations: usize,
) -> Result<(), Error> {
    let rows = predicted.rows;
    let names = vec![episode; rows];
    let regions: Vec<i64> = predicted.region.iter().map(|&r| region(r)).collect();
    let inside: Vec<bool> = predicted.domain.iter().map(|&domain| domain == Domain::Inside).collect();
    let mut values = vec![Values::Text(&names), Values::Integer(stamps)];
    for equation in 0..equations {
        for column in [&predicted.measured, &predicted.predicted, &predicted.residual] {
            values.push(Values::Float(Predicted::equation(column, rows, equation)));
        }
    }
    values.extend([Values::Integer(&regions), Values::Float(&predicted.distance), Values::Boolean(&inside)]);
    writer.write(&values)?;
    Ok(())
}

/// Rows without a prediction leave a gap in the lines that a viewer draws; so do rows that were not measured, in theirs.
fn write_messages(
    overlay: &mut Overlay,
    kinds: [SeriesId; 3],
    about: SeriesId,
    log_offset: i64,
    stamps: &[i64],
    predicted: &Predicted,
    equations: usize,
) -> Result<(), Error> {
    let rows = predicted.rows;
    let mut values = vec![0.0; equations];
    for (row, &stamp) in stamps.iter().enumerate() {
        let log_time = stamp.saturating_add(log_offset);
        let there = |values: &[f64]| values.iter().any(|value| value.is_finite());
        for (series, column) in kinds.into_iter().zip([&predicted.measured, &predicted.predicted, &predicted.residual])
        {
            for (equation, value) in values.iter_mut().enumerate() {
                *value = Predicted::equation(column, rows, equation)[row];
            }
            if there(&values) {
                overlay.row(series, stamp, log_time, &values)?;
            }
        }
        if !predicted.is_predicted(row) {
            continue;
        }
        let inside = f64::from(u8::from(predicted.domain[row] == Domain::Inside));
        overlay.row(
            about,
            stamp,
            log_time,
            &[region(predicted.region[row]) as f64, predicted.distance[row], inside],
        )?;
    }
    Ok(())
}
