//! Settings on which all files of a call agree: the unit of a clock's numbers, and the order of day and month in dates.

use std::{collections::BTreeMap, path::PathBuf};

use fleetfoot_data::setting::TIME_UNIT;
use fleetfoot_data::{Progress, parallel_map};

use crate::{
    Error, Format, Log, Selection, TimeSpec, TimeUnit, arrays, csv,
    dates::{DateOrder, Fit},
    memory, parquet, run,
    time_column::{Agreed, Clock, ClockUnit},
};

/// For each time column without a told unit: the one unit that fits the numbers of all files. For each column of dates: one order of day and month.
///
/// # Errors
/// Two files of which no unit fits both.
pub(crate) fn agreed(logs: &[Log], selection: &Selection, progress: &dyn Progress) -> Result<Agreed, Error> {
    let has_unit = matches!(selection.time, TimeSpec::Uniform { .. } | TimeSpec::Column { unit: Some(_), .. });
    // The files of a run are on one clock.
    let each = logs.iter().flat_map(|log| match log {
        Log::Run(run) => {
            run.files.iter().map(|(_, path)| (Log::File(path.clone()), run::clock_of(&selection.time))).collect()
        }
        other => vec![(other.clone(), &selection.time)],
    });
    let logs: Vec<(Log, &TimeSpec)> = each.collect();
    if logs.len() < 2 {
        return Ok(Agreed::default());
    }
    // Unreadable files are reported when they are opened.
    let clocks = parallel_map(logs.len(), progress, |at| Ok::<_, Error>(clock(&logs[at].0, logs[at].1)))?;
    let mut columns: BTreeMap<String, Vec<(PathBuf, Clock)>> = BTreeMap::new();
    let mut dates: BTreeMap<String, Vec<(DateOrder, Fit)>> = BTreeMap::new();
    for ((log, _), (clock, candidate)) in logs.iter().zip(clocks) {
        candidate.into_iter().for_each(|(name, order)| dates.entry(name).or_default().push(order));
        if let Some(clock) = clock.filter(|_| !has_unit) {
            columns.entry(clock.name.clone()).or_default().push((log.path().to_path_buf(), clock));
        }
    }
    let mut agreed = Agreed::default();
    for (name, files) in dates {
        let is_certain = files.iter().any(|(_, fit)| *fit == Fit::Only);
        agreed.orders.extend(DateOrder::common(&files).map(|order| (name, (order, is_certain))));
    }
    for (column, files) in columns.iter().filter(|(_, files)| files.len() > 1) {
        if let Some(unit) = common_unit(column, files)? {
            agreed.units.insert(column.clone(), unit);
        }
    }
    Ok(agreed)
}

/// The clock of a log, and its columns of dates in text.
fn clock(log: &Log, spec: &TimeSpec) -> (Option<Clock>, csv::Dates) {
    let clock = match log {
        Log::Table(table) => memory::clock(table.as_ref(), spec),
        Log::File(path) => match Format::of(path) {
            Some(Format::Parquet) => parquet::clock(path, spec).ok().flatten(),
            Some(format @ (Format::Npy | Format::Npz | Format::Mat)) => {
                arrays::clock(path, format, spec).ok().flatten()
            }
            Some(Format::Csv(compression)) => return csv::clock(path, compression, spec).unwrap_or_default(),
            _ => None,
        },
        Log::Run(_) => None,
    };
    (clock, Vec::new())
}

/// The one unit that fits all files; `None` where several do. Files that tell their unit decide among those that fit the numbers of the others.
fn common_unit(column: &str, files: &[(PathBuf, Clock)]) -> Result<Option<TimeUnit>, Error> {
    let mut common: Option<(&PathBuf, Vec<TimeUnit>)> = None;
    for (path, clock) in files {
        if matches!(clock.unit, ClockUnit::Given(_)) {
            continue;
        }
        let readings: Vec<TimeUnit> = clock.readings().iter().map(|reading| reading.unit).collect();
        let Some((first, units)) = &mut common else {
            common = Some((path, readings));
            continue;
        };
        let before = units.clone();
        units.retain(|unit| readings.contains(unit));
        if units.is_empty() {
            return Err(Error::ColumnsDisagree {
                column: column.into(),
                first: first.clone(),
                first_is: format!("a clock in {}", symbols(&before)),
                second: path.clone(),
                second_is: format!(
                    "one in {} (judged by the numbers; {TIME_UNIT} names one unit for all files; if they differ, open them apart)",
                    symbols(&readings)
                ),
            });
        }
        if units.len() < before.len() {
            *first = path;
        }
    }
    let hint = || {
        let mut units = files.iter().filter_map(|(_, clock)| clock.given_unit());
        units.next().filter(|unit| units.all(|other| other == *unit))
    };
    Ok(common.and_then(|(_, units)| match units[..] {
        // A unit that every file leaves in doubt stays a note of each file.
        [unit] => Some(unit).filter(|_| !files.iter().all(|(_, clock)| clock.doubt().is_some())),
        _ => hint().filter(|unit| units.contains(unit)),
    }))
}

fn symbols(units: &[TimeUnit]) -> String {
    let symbols: Vec<&str> = units.iter().map(|unit| unit.symbol()).collect();
    if symbols.is_empty() { "no unit".into() } else { symbols.join(" or ") }
}
