//! Delimited text: sniffed, decoded once into columns.

mod blanks;
mod cell;
mod comments;
mod convert;
mod decode;
mod dialect;
mod fractions;
mod head;
mod input;
mod sort;

use std::{path::Path, sync::Arc};

use fleetfoot_data::Column;

use crate::{
    Compression, Error, Selection, TimeSpec, TimeUnit,
    by_name::ByName,
    cycles::Cycle,
    dates::{DateOrder, Fit},
    opened::Opened,
    store::{Budget, StoredTable},
    time_column::{self, Agreed, Clock, ClockUnit},
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
    if let Some(Clock { name, column, beside: None, unit: ClockUnit::Given(_) | ClockUnit::Guessed(_), .. }) = &clock
        && let Some(zeros) = head.lost_zeros(*column, TimeUnit::Seconds)
    {
        head.notes.push(zeros.note(name));
    }
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
    let read = |way| open_in_way(path, compression, selection, agreed, budget, way);
    match read(Way::AsFirst) {
        // The rows behind the first ones decide which of two numbers is the day, and whether zeros are missing.
        Err(problem @ Error::BadCell { .. }) => {
            read(Way::OtherOrder).or_else(|_| read(Way::NoZeros)).map_err(|_| problem)
        }
        opened => opened,
    }
}

/// The way in which stamps are read that the first rows leave open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    /// As the first rows suggest.
    AsFirst,
    /// With day and month in the other order.
    OtherOrder,
    /// With fractions as they stand.
    NoZeros,
}

/// Decodes a file, with its stamps read in one way. Fails where that way is no other than the first one.
fn open_in_way(
    path: &Path,
    compression: Compression,
    selection: &Selection,
    agreed: &Agreed,
    budget: &Arc<Budget>,
    way: Way,
) -> Result<Opened, Error> {
    let (mut head, stream) = head::open(path, compression)?;
    head.follow(&agreed.orders);
    if way == Way::OtherOrder && !head.turn_dates() {
        return Err(Error::NoRows { path: path.into() });
    }
    let names = ByName::new(head.columns.iter().map(|column| column.name.as_str()));
    let fields = selection.columns.iter().map(|name| names.find(path, name)).collect::<Result<Vec<_>, _>>()?;
    let clock = find_clock(path, &head, &names, &selection.time)?;
    let clock = clock.map(|clock| clock.settle(path, agreed, selection)).transpose()?;
    let time = clock.iter().flat_map(|clock| clock.parts());
    let time: Vec<_> = time.map(|(field, unit)| TimeField { field, unit, sort: head.sorts[field] }).collect();
    // Beside a date, a time of the day passes no midnight.
    let cycle = match time[..] {
        [TimeField { sort: Sort::Date(_), .. }] => Cycle::Day,
        [TimeField { sort: Sort::Number, unit, .. }] => Cycle::Counter(unit),
        _ => Cycle::Never,
    };
    let zeros = clock.as_ref().and_then(|clock| head.lost_zeros(clock.column, clock.unit)).filter(|_| time.len() == 1);
    if way == Way::NoZeros && zeros.is_none() {
        return Err(Error::NoRows { path: path.into() });
    }
    let zeros = zeros.filter(|_| way != Way::NoZeros);
    let mut notes = head.notes.clone();
    notes.extend(clock.iter().filter_map(|clock| clock.assumed.clone()));
    notes.extend(zeros.iter().zip(&clock).map(|(zeros, clock)| zeros.note(&clock.name)));
    let gps_weeks = clock.as_ref().is_some_and(|clock| clock.gps_weeks);
    let plan = Plan { path, compression, head, fields, time, gps_weeks, zeros };
    let decoded = decode::decode(plan, stream, budget)?;
    notes.extend(decoded.notes);
    let table = StoredTable { store: decoded.store, columns: decoded.columns, has_time: clock.is_some() };
    let opened = Opened::of_table(Box::new(table), clock, notes);
    Ok(Opened { sessions: decoded.sessions, cycle, ..opened })
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
        None => Err(time_column::no_clock(path, &head.candidates(), &|column| head.values(column))),
    }
}
