//! Delimited text: sniffed, decoded once into columns.

mod blanks;
mod cell;
mod comments;
mod convert;
mod decode;
mod dialect;
mod head;
mod input;
mod sort;

use std::{path::Path, sync::Arc};

use fleetfoot_data::Column;

use crate::{
    Compression, Error, Selection, TimeSpec,
    by_name::ByName,
    dates::{DateOrder, Fit},
    opened::Opened,
    store::{Budget, StoredTable},
    time_column::{self, Agreed, Clock},
};
use decode::{Plan, TimeField};
use head::Head;
use sort::Sort;

/// Names of columns of dates, with the orders of day and month in which they can be read.
pub(crate) type Dates = Vec<(String, (DateOrder, Fit))>;

/// Description of a file from its first rows.
pub(crate) struct Description {
    pub columns: Vec<Column>,
    pub clock: Option<Clock>,
    pub notes: Vec<String>,
}

/// Describes a file by its first rows.
pub(crate) fn describe(path: &Path, compression: Compression, agreed: &Agreed) -> Result<Description, Error> {
    let (mut head, _) = head::open(path, compression)?;
    head.follow(&agreed.orders);
    let clock = choose(&head, &TimeSpec::Auto);
    let columns = (0..head.columns.len()).map(|c| Column { kind: head.kind(c), ..head.columns[c].clone() }).collect();
    Ok(Description { columns, clock, notes: head.notes })
}

/// Decodes the selected columns of a file.
pub(crate) fn open(
    path: &Path,
    compression: Compression,
    selection: &Selection,
    agreed: &Agreed,
    budget: &Arc<Budget>,
) -> Result<Opened, Error> {
    match open_in_order(path, compression, selection, agreed, budget, false) {
        // The rows behind the first ones decide which of two numbers is the day.
        Err(problem @ Error::BadCell { .. }) => {
            open_in_order(path, compression, selection, agreed, budget, true).map_err(|_| problem)
        }
        opened => opened,
    }
}

/// Decodes a file; `turned`: with day and month in the other order where the first rows are dates in both.
fn open_in_order(
    path: &Path,
    compression: Compression,
    selection: &Selection,
    agreed: &Agreed,
    budget: &Arc<Budget>,
    turned: bool,
) -> Result<Opened, Error> {
    let (mut head, stream) = head::open(path, compression)?;
    head.follow(&agreed.orders);
    if turned && !head.turn_dates() {
        return Err(Error::NoRows { path: path.into() });
    }
    let names = ByName::new(head.columns.iter().map(|column| column.name.as_str()));
    let fields = selection.columns.iter().map(|name| names.find(path, name)).collect::<Result<Vec<_>, _>>()?;
    let clock = find_clock(path, &head, &names, &selection.time)?;
    let clock = clock.map(|clock| clock.settle(path, agreed, selection)).transpose()?;
    let time = clock.iter().flat_map(|clock| clock.parts());
    let time: Vec<_> = time.map(|(field, unit)| TimeField { field, unit, sort: head.sorts[field] }).collect();
    // Beside a date, a time of the day passes no midnight.
    let of_day = matches!(time[..], [TimeField { sort: Sort::Date(_), .. }]);
    let mut notes = head.notes.clone();
    notes.extend(clock.iter().filter_map(|clock| clock.assumed.clone()));
    let plan = Plan { path, compression, head, fields, time };
    let decoded = decode::decode(plan, stream, budget)?;
    notes.extend(decoded.notes);
    let table = StoredTable { store: decoded.store, columns: decoded.columns, has_time: clock.is_some() };
    let opened = Opened::of_table(Box::new(table), clock, notes);
    Ok(Opened { sessions: decoded.sessions, of_day, ..opened })
}

/// The clock of a file, as far as its first rows tell, `None` where it has none; and its columns of dates.
pub(crate) fn clock(path: &Path, compression: Compression, spec: &TimeSpec) -> Result<(Option<Clock>, Dates), Error> {
    let (head, _) = head::open(path, compression)?;
    Ok((choose(&head, spec), head.date_orders()))
}

fn choose(head: &Head, spec: &TimeSpec) -> Option<Clock> {
    time_column::choose(&head.candidates(), &|column| head.values(column), spec)
}

fn find_clock(path: &Path, head: &Head, names: &ByName<'_>, spec: &TimeSpec) -> Result<Option<Clock>, Error> {
    match spec {
        TimeSpec::Uniform { .. } => return Ok(None),
        TimeSpec::Column { name, .. } => {
            names.find(path, name)?;
        }
        TimeSpec::Auto | TimeSpec::Dispensable { .. } => {}
    }
    match choose(head, spec) {
        Some(clock) => Ok(Some(clock)),
        None if matches!(spec, TimeSpec::Dispensable { .. }) => Ok(None),
        None => {
            let names: Vec<&str> = head.columns.iter().map(|column| column.name.as_str()).collect();
            Err(time_column::no_clock(path, &names))
        }
    }
}
