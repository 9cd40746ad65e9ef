//! Robots' logs: channels of messages become one table of rows on one clock.
//!
//! A log is opened in four steps: some messages tell which fields there are ([`sample`]), the selected columns become fields of topics
//! ([`plan`]), all messages are decoded in parallel into series ([`decode`]), and the series are joined on the stamps of the base
//! ([`crate::join`]) into rows, which are kept like those of a text file, or as Parquet in a cache.

mod cache;
mod clock;
mod decode;
mod describe;
mod message_columns;
mod messages;
mod names;
mod plan;
mod sample;

pub(crate) use describe::{Description, describe, statistics};
pub use message_columns::{MessageColumns, MessageField};
pub use messages::{MessageRow, Messages};
pub(crate) use names::Names;

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::Arc,
};

use fleetfoot_data::setting::{CACHE, INFO_VALUES, NO_CACHE};
use fleetfoot_data::{Column, ColumnKind, Progress, nearest_one};

use crate::{
    Error, Estimate, Format, Selection, Stamp, TimeSpec,
    breaks::Breaks,
    container::{Container, summary},
    containers,
    cycles::Cycle,
    join::{Base, JoinKind, check_rate, join},
    opened::Opened,
    parquet,
    store::{Budget, StoreBuilder, StoredTable},
    table::{MAX_CATEGORIES, Table, TableColumn},
    time_column::Chosen,
};
use cache::{Meta, SlotWriter};
use decode::{Decoded, decode};
pub(crate) use plan::corrections;
use plan::{Plan, plan};

/// Opens a log, with the files that go on with it: decodes the selected columns, or finds them in the cache.
pub(crate) fn open(
    path: &Path,
    format: Format,
    further: &[PathBuf],
    selection: &Selection,
    budget: &Arc<Budget>,
    cursors: &Arc<parquet::Cursors>,
    progress: &dyn Progress,
) -> Result<Opened, Error> {
    refuse_other_clocks(path, selection)?;
    let container = containers::open(path, format, further, progress)?;
    let files = container.files();
    let slot = cache::slot(&files, selection)?;
    if let Some((table, meta)) = slot.as_ref().and_then(|slot| slot.load(cursors)) {
        return Ok(opened(table, meta));
    }
    let (plan, decoded, codes, meta) = decode_all(path, container.as_ref(), selection, budget, progress)?;
    let table: Box<dyn Table> = match slot {
        None if nothing_to_join(&plan, &codes) => {
            let columns: Vec<usize> = plan.columns.iter().map(|column| column.join.column).collect();
            let base_series = plan.columns.first().map_or(0, |column| column.join.series);
            let mut series = decoded.series;
            let store = series.swap_remove(base_series).store.select(&columns);
            Box::new(StoredTable { store, columns: meta.columns.clone(), has_time: true })
        }
        None => {
            let mut rows = StoreBuilder::new(path, meta.columns.len(), budget.clone());
            join_into(&mut rows, &plan, &decoded, &codes, progress)?;
            drop(decoded);
            Box::new(StoredTable { store: rows.finish()?, columns: meta.columns.clone(), has_time: true })
        }
        Some(slot) => {
            let columns: Vec<Column> = meta.columns.iter().map(|column| column.column.clone()).collect();
            let mut rows = slot.create(&columns, &files, &meta)?;
            join_into(&mut rows, &plan, &decoded, &codes, progress)?;
            rows.finish()?;
            slot.load(cursors).map(|(table, _)| table).ok_or_else(|| Error::Damaged {
                path: path.into(),
                place: "its decoded columns in the cache".into(),
                problem: format!("they cannot be read back ({CACHE} names another folder, {NO_CACHE} uses none)"),
                mend: "free some space",
            })?
        }
    };
    Ok(opened(table, meta))
}

/// Decodes the selected columns into series, and describes them.
fn decode_all(
    path: &Path,
    container: &dyn Container,
    selection: &Selection,
    budget: &Arc<Budget>,
    progress: &dyn Progress,
) -> Result<(Plan, Decoded, Codes, Meta), Error> {
    let plan = plan(path, container, selection, progress)?;
    let window = (selection.join.reorder_seconds * 1e9).round() as i64;
    let decoded = decode(path, container, &plan, window, budget, progress)?;
    check(path, &plan, &decoded)?;
    if let Base::Rate(hz) = plan.base {
        check_rate(path, hz, decoded.series.iter().map(|series| (&*series.name, series.rate())))?;
    }
    let mut notes = plan.notes.clone();
    notes.extend(container.notes());
    notes.extend(tell(&plan, &decoded));
    let (columns, codes) = categories(path, &plan, &decoded)?;
    let (log_offset, breaks) = match plan.base {
        Base::Series(series) => (decoded.series[series].offset, decoded.series[series].breaks.clone()),
        Base::Rate(_) => (decoded.series.iter().find_map(|series| series.offset), Breaks::default()),
    };
    let meta = Meta { columns, notes, stamp: Some(plan.stamp), log_offset: log_offset.unwrap_or(0), breaks };
    Ok((plan, decoded, codes, meta))
}

/// Estimates the cost of [`open`] from the indexes and a few messages.
pub(crate) fn estimate(
    path: &Path,
    format: Format,
    further: &[PathBuf],
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Estimate, Error> {
    refuse_other_clocks(path, selection)?;
    let container = containers::open(path, format, further, progress)?;
    let plan = plan(path, container.as_ref(), selection, progress)?;
    let info = summary(container.as_ref(), progress)?;
    let rows = match plan.base {
        Base::Series(series) => {
            let base = plan.topics.iter().rev().find(|topic| topic.first_series <= series);
            base.map_or(0, |base| info.topics[base.topic].count)
        }
        Base::Rate(hz) => {
            let rate = |topic: &'_ plan::TopicPlan| info.topics[topic.topic].fastest();
            check_rate(path, hz, plan.topics.iter().map(|topic| (&*topic.name, rate(topic))))?;
            let span = |topic: &plan::TopicPlan| {
                let times = &info.topics[topic.topic];
                times.last.zip(times.first).map_or(0.0, |(last, first)| (last - first) as f64 * 1e-9)
            };
            (plan.topics.iter().map(span).fold(f64::INFINITY, f64::min) * hz) as u64 + 1
        }
    };
    let files = container.files();
    let mut bytes = 0;
    for file in &files {
        let io = |source| Error::Io { path: file.clone(), action: "read", source };
        bytes += std::fs::metadata(file).map_err(io)?.len();
    }
    let cached = cache::slot(&files, selection)?.is_some_and(|slot| slot.exists());
    Ok(Estimate { bytes, rows, decoded_bytes: rows.saturating_mul(8 * (1 + plan.columns.len() as u64)), cached })
}

fn opened(table: Box<dyn Table>, meta: Meta) -> Opened {
    let Meta { notes, stamp, log_offset, breaks, .. } = meta;
    let (time_column, chosen) = (Some("its clock".into()), Chosen::Caller);
    Opened { table, time_column, cycle: Cycle::Never, chosen, notes, stamp, log_offset, breaks, sessions: Vec::new() }
}

/// Stamps are the messages': a column or a fixed step would join what does not belong together.
fn refuse_other_clocks(path: &Path, selection: &Selection) -> Result<(), Error> {
    let window = selection.join.reorder_seconds;
    if !(0.0..=3600.0).contains(&window) {
        return Err(Error::BadSeconds { what: "reordering window", seconds: window });
    }
    match &selection.time {
        TimeSpec::Auto | TimeSpec::Dispensable { .. } => Ok(()),
        TimeSpec::Column { name, .. } if clock::is_clock(name) && selection.join.stamp.is_none() => Ok(()),
        TimeSpec::Column { name, .. } => {
            Err(Error::NoSuchClock { path: path.into(), asked: format!("the column `{name}`") })
        }
        TimeSpec::Uniform { .. } => Err(Error::NoSuchClock { path: path.into(), asked: "a fixed period".into() }),
    }
}

/// Every series must have samples on the chosen clock.
fn check(path: &Path, plan: &Plan, decoded: &Decoded) -> Result<(), Error> {
    for (topic, (failed, why)) in plan.topics.iter().zip(&decoded.failed) {
        let count = topic.extract.groups().len();
        for series in &decoded.series[topic.first_series..topic.first_series + count] {
            if !series.runs.is_empty() {
                continue;
            }
            let counts = &series.counts;
            let problem = if counts.samples == 0 && *failed > 0 {
                format!("none of its {failed} messages can be decoded: {why}")
            } else if counts.samples == 0 && series.name != topic.name {
                let keys: BTreeSet<&str> =
                    topic.seen.iter().filter_map(|info| info.path.rfind(']').map(|end| &info.path[..=end])).collect();
                let inside = names::inside(series.name.strip_prefix(&topic.name).unwrap_or_default());
                match nearest_one(inside, keys.iter().copied()) {
                    Some(key) => format!("no message has {inside}; the nearest is {key}"),
                    None => format!("no message has {inside}; look at its keys with {INFO_VALUES}"),
                }
            } else if counts.samples == 0 {
                "it has no messages: choose another topic".to_owned()
            } else if plan.stamp == Stamp::Header {
                "its header stamps are not filled in: take the log's clock for all channels (stamp = \"log\")"
                    .to_owned()
            } else {
                format!(
                    "its {} stamps are all zero: take another clock (stamp = \"log\" or \"header\")",
                    plan.stamp.name()
                )
            };
            return Err(Error::Topic {
                path: path.into(),
                topic: topic.name.clone(),
                type_name: String::new(),
                problem,
            });
        }
    }
    Ok(())
}

/// Notes on skipped data, in sentences.
fn tell(plan: &Plan, decoded: &Decoded) -> Vec<String> {
    let mut notes = Vec::new();
    if !decoded.damage.is_empty() {
        notes.push(decoded.damage.to_string());
    }
    for (topic, (failed, why)) in plan.topics.iter().zip(&decoded.failed).filter(|(_, (failed, _))| *failed > 0) {
        notes.push(format!("{}: {failed} messages cannot be decoded and are left out ({why})", topic.name));
    }
    for series in &decoded.series {
        notes.extend(series.counts.left_out("messages").map(|left_out| format!("{}: {left_out}", series.name)));
    }
    notes
}

/// For each column, the codes of its sorted texts by those of their first appearance.
type Codes = Vec<Option<Vec<f64>>>;

/// The columns with the names of their categories.
fn categories(path: &Path, plan: &Plan, decoded: &Decoded) -> Result<(Vec<TableColumn>, Codes), Error> {
    let (mut columns, mut codes) = (Vec::new(), Vec::new());
    for planned in &plan.columns {
        let fields = &decoded.fields[planned.topic];
        let met = fields.met[planned.slot];
        if met.text && met.number {
            return Err(Error::BadField {
                path: path.into(),
                column: planned.column.name.clone(),
                problem: "it is a text in some messages and a number in others".into(),
            });
        }
        let mut column = planned.column.clone();
        let mut file_names = None;
        if met.text {
            let names = fields.texts.names();
            if names.len() > MAX_CATEGORIES {
                return Err(Error::TooManyCategories { path: path.into(), column: column.name, limit: MAX_CATEGORIES });
            }
            let mut order: Vec<usize> = (0..names.len()).collect();
            order.sort_by(|&a, &b| names[a].cmp(&names[b]));
            let mut places = vec![f64::NAN; names.len()];
            order.iter().enumerate().for_each(|(place, &code)| places[code] = place as f64);
            column.kind = ColumnKind::Category(order.iter().map(|&code| names[code].clone()).collect());
            file_names = Some(places);
        } else if matches!(column.kind, ColumnKind::Category(_)) && met.number {
            column.kind = ColumnKind::Float;
        }
        columns.push(TableColumn { column, empty: !met.text && !met.number });
        codes.push(file_names);
    }
    Ok((columns, codes))
}

/// Returns true if the rows are the samples of one channel as they are. Each row then stands at its own stamp, where a
/// linear or held column has the value of its sample. Angles may change by whole turns and quaternions by their sign,
/// so that they are joined; texts get other codes.
fn nothing_to_join(plan: &Plan, codes: &Codes) -> bool {
    let as_it_is = |column: &plan::PlannedColumn| {
        let join = &column.join;
        plan.base == Base::Series(join.series) && join.kind != JoinKind::Angle && join.quaternion.is_none()
    };
    !plan.columns.is_empty() && plan.columns.iter().all(as_it_is) && codes.iter().all(Option::is_none)
}

/// Joins the series and hands the rows on.
fn join_into(
    rows: &mut (dyn RowSink + Send),
    plan: &Plan,
    decoded: &Decoded,
    codes: &Codes,
    progress: &dyn Progress,
) -> Result<(), Error> {
    let joins: Vec<_> = plan.columns.iter().map(|column| column.join.clone()).collect();
    progress.stage("joining channels");
    join(&decoded.series, &joins, plan.base, progress, |stamps, values| {
        if codes.iter().all(Option::is_none) {
            return rows.push_rows(stamps, values);
        }
        let recoded: Vec<Vec<f64>> =
            values.iter().zip(codes).map(|(values, codes)| recode(values, codes.as_deref())).collect();
        rows.push_rows(stamps, &recoded)
    })?;
    Ok(())
}

fn recode(values: &[f64], codes: Option<&[f64]>) -> Vec<f64> {
    let Some(codes) = codes else { return values.to_vec() };
    let place =
        |&code: &f64| if code >= 0.0 { codes.get(code as usize).copied().unwrap_or(f64::NAN) } else { f64::NAN };
    values.iter().map(place).collect()
}

/// Takes joined rows, block by block.
trait RowSink {
    /// Stamps, and one column of values after the other, all of one length.
    fn push_rows(&mut self, stamps: &[i64], columns: &[Vec<f64>]) -> Result<(), Error>;
}

impl RowSink for SlotWriter {
    fn push_rows(&mut self, stamps: &[i64], columns: &[Vec<f64>]) -> Result<(), Error> {
        self.push(stamps, columns)
    }
}

impl RowSink for StoreBuilder {
    fn push_rows(&mut self, stamps: &[i64], columns: &[Vec<f64>]) -> Result<(), Error> {
        self.push_columns(stamps, columns)
    }
}
