//! Rows of text into columns.

use std::{
    collections::HashMap,
    io::{Cursor, Read},
    path::Path,
    sync::Arc,
};

use fleetfoot_data::{Column, ColumnKind};

use super::{
    cell::{Cell, boolean, is_missing, is_whole, number},
    comments::LeftOut,
    convert::Converted,
    dialect::begins_comment,
    fractions::Fractions,
    head::{Head, is_header_again},
    input::{Watched, line_of, read_error, reader},
    sort::{Sort, sort_of},
};
use crate::{
    Compression, Error, TimeUnit, dates,
    error::shorten,
    stamp,
    store::{Budget, ColumnStore, StoreBuilder},
    table::{MAX_CATEGORIES, MISSING, TableColumn},
};

/// Plan for decoding a file.
pub(super) struct Plan<'a> {
    pub path: &'a Path,
    pub compression: Compression,
    pub head: Head,
    /// The fields of the selected columns.
    pub fields: Vec<usize>,
    /// Fields of the stamps; several fields are added up.
    pub time: Vec<TimeField>,
    /// True if the first of these counts weeks of GPS.
    pub gps_weeks: bool,
    /// The zeros that the stamps' fractions lost.
    pub zeros: Option<Fractions>,
}

/// A field of the stamps.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimeField {
    pub field: usize,
    pub unit: TimeUnit,
    /// Its cells are dates, numbers, or not known yet.
    pub sort: Sort,
}

/// A decoded file.
pub(super) struct Decoded {
    pub store: ColumnStore,
    pub columns: Vec<TableColumn>,
    /// First rows of the sessions behind the first one: the header stands before each.
    pub sessions: Vec<usize>,
    pub notes: Vec<String>,
}

/// A cell that does not fit: its field and what was expected.
struct Misfit {
    field: usize,
    expected: &'static str,
}

/// Expected form of a date.
const A_DATE: &str = "a date or a time of the day such as 2011-07-23 13:23:09, 23.07.2011 13:23 or 13:23:09.5";

/// Expected form of a stamp whose zeros are put back.
const A_FRACTION: &str = "a time whose fraction lacks its leading zeros, as in the rows before";

/// Note on a last row that cannot be whole.
const CUT: &str = "the last line was cut off and is left out";

/// Decodes all rows.
pub(super) fn decode(mut plan: Plan<'_>, stream: Box<dyn Read>, budget: &Arc<Budget>) -> Result<Decoded, Error> {
    let comments = plan.head.comments();
    let bytes = std::mem::take(&mut plan.head.bytes);
    let (input, watch) = Watched::new(Cursor::new(bytes).chain(stream));
    let left_out = comments.left_out();
    let input = plan.head.delimiter.separated(Converted::new(input, comments));
    let mut rows = reader(input, plan.head.delimiter.byte());
    let is_cut = || !watch.ends_with_line() && !left_out.ends();
    let mut columns: Vec<Decoder> =
        plan.fields.iter().map(|&field| Decoder::new(field, plan.head.sorts[field])).collect();
    let mut store = StoreBuilder::new(plan.path, columns.len(), budget.clone());
    let mut values = vec![f64::NAN; columns.len()];
    let (mut record, mut number, mut notes) = (csv::ByteRecord::new(), 0u64, Vec::new());
    // The row before, and whether its values are kept.
    let (mut previous, mut kept) = (csv::ByteRecord::new(), false);
    let expected = plan.head.columns.len();
    let mut header = None;
    let units = plan.head.units.clone();
    let (mut sessions, mut used) = (Vec::new(), 0);
    let mut sorted = Second::default();
    loop {
        watch.row();
        let more = rows.read_byte_record(&mut record).map_err(|problem| plan.csv_error(problem, number))?;
        if !more {
            notes.extend(plan.cut_value(&previous).filter(|_| kept && is_cut()));
            break;
        }
        kept = false;
        if plan.head.has_header {
            match &header {
                None => {
                    header = Some(record.clone());
                    continue;
                }
                Some(header) if is_header_again(&record, header) => {
                    sorted.flush(&mut store)?;
                    sessions.push(used);
                    continue;
                }
                Some(_) if units.as_ref().is_some_and(|units| is_header_again(&record, units)) => continue,
                Some(_) => {}
            }
        }
        number += 1;
        let at = record.position().map_or(0, csv::Position::byte);
        let ends_blank = || record.iter().skip(expected).all(|cell| cell.trim_ascii().is_empty());
        if record.len() < expected || !ends_blank() {
            if record.len() == 1 && record[0].trim_ascii().is_empty() {
                continue;
            }
            let fields_here = record.len();
            let last = !rows.read_byte_record(&mut record).map_err(|problem| plan.csv_error(problem, number))?;
            if last && fields_here < expected && is_cut() {
                notes.push(CUT.into());
                break;
            }
            return Err(plan.ragged(at, fields_here));
        }
        let stamp = plan.stamp(&record).and_then(|stamp| {
            for (decoder, value) in columns.iter_mut().zip(&mut values) {
                *value = decoder.cell(&record[decoder.field], plan.head.decimal_comma)?;
            }
            Ok(stamp)
        });
        let stamp = match stamp {
            Ok(stamp) => stamp,
            Err(misfit) => {
                let last = !rows.read_byte_record(&mut previous).map_err(|problem| plan.csv_error(problem, number))?;
                if last && misfit.field + 1 == expected && is_cut() {
                    notes.push(CUT.into());
                    break;
                }
                return Err(plan.bad_cell(at, &record, &misfit));
            }
        };
        columns.iter_mut().for_each(|decoder| decoder.place(at, &record));
        if plan.zeros.is_some() {
            sorted.push(stamp, &values, &mut store)?;
        } else {
            store.push(stamp, &values)?;
        }
        used += 1;
        std::mem::swap(&mut record, &mut previous);
        kept = true;
        if number % 1024 == 0 {
            check_categories(&plan, &columns)?;
        }
    }
    sorted.flush(&mut store)?;
    sessions.retain(|&first| 0 < first && first < used);
    sessions.dedup();
    if !sessions.is_empty() {
        let times = if sessions.len() == 1 { "once".to_owned() } else { format!("{} times", sessions.len()) };
        notes.push(format!("its header comes again {times}: sessions one after another"));
    }
    notes.extend(plan.comments(&left_out));
    let decoded = finish(&plan, columns, store, notes)?;
    Ok(Decoded { sessions, ..decoded })
}

/// Rows of one second, to be sorted: stamps without their zeros were sorted as texts.
#[derive(Default)]
struct Second {
    rows: Vec<(i64, Vec<f64>)>,
}

impl Second {
    /// Adds a row, after the rows of the second before have gone into the store.
    fn push(&mut self, stamp: i64, values: &[f64], store: &mut StoreBuilder) -> Result<(), Error> {
        let second = |stamp: i64| stamp.div_euclid(1_000_000_000);
        if self.rows.first().is_some_and(|(first, _)| second(*first) != second(stamp)) {
            self.flush(store)?;
        }
        self.rows.push((stamp, values.to_vec()));
        Ok(())
    }

    fn flush(&mut self, store: &mut StoreBuilder) -> Result<(), Error> {
        self.rows.sort_by_key(|(stamp, _)| *stamp);
        self.rows.drain(..).try_for_each(|(stamp, values)| store.push(stamp, &values))
    }
}

fn finish(
    plan: &Plan<'_>,
    columns: Vec<Decoder>,
    store: StoreBuilder,
    mut notes: Vec<String>,
) -> Result<Decoded, Error> {
    check_categories(plan, &columns)?;
    notes.extend(columns.iter().filter_map(|decoder| plan.infinite(decoder)));
    let columns = columns.into_iter().map(|decoder| decoder.finish(&plan.head)).collect();
    Ok(Decoded { store: store.finish()?, columns, sessions: Vec::new(), notes })
}

fn check_categories(plan: &Plan<'_>, columns: &[Decoder]) -> Result<(), Error> {
    match columns.iter().find(|decoder| decoder.codes.len() > MAX_CATEGORIES) {
        None => Ok(()),
        Some(decoder) => {
            let column = plan.head.columns[decoder.field].name.clone();
            Err(Error::TooManyCategories { path: plan.path.into(), column, limit: MAX_CATEGORIES })
        }
    }
}

impl Plan<'_> {
    fn stamp(&self, record: &csv::ByteRecord) -> Result<i64, Misfit> {
        let mut sum = 0i64;
        for (place, time) in self.time.iter().enumerate() {
            let part = self.part_of_stamp(record, *time)?;
            let part = if self.gps_weeks && place == 0 { stamp::gps_week(part) } else { part };
            let stamp = Some(part).filter(|&stamp| stamp != MISSING);
            match stamp.and_then(|stamp| sum.checked_add(stamp)) {
                Some(added) => sum = added,
                None => return Ok(MISSING),
            }
        }
        Ok(sum)
    }

    fn part_of_stamp(&self, record: &csv::ByteRecord, time: TimeField) -> Result<i64, Misfit> {
        let TimeField { field, unit, sort } = time;
        let cell = record[field].trim_ascii();
        let mended = match &self.zeros {
            Some(_) if is_missing(cell) => None,
            Some(zeros) => Some(zeros.mend(cell).ok_or(Misfit { field, expected: A_FRACTION })?),
            None => None,
        };
        let cell = mended.as_deref().unwrap_or(cell);
        let date = matches!(sort, Sort::Date(_));
        let parsed = match sort {
            Sort::Date(order) => dates::parse(cell, order),
            Sort::Unknown => stamp::parse_decimal(cell, unit).or_else(|| dates::parse_certain(cell)),
            _ => stamp::parse_decimal(cell, unit),
        };
        if let Some(stamp) = parsed {
            return Ok(stamp);
        }
        match number(cell, self.head.decimal_comma) {
            Cell::Missing | Cell::Infinite => Ok(MISSING),
            // Out of the range of nanoseconds, or with a decimal comma.
            Cell::Number(value) if !date => Ok(stamp::from_f64(value, unit)),
            _ => Err(Misfit { field, expected: if date { A_DATE } else { "a time in numbers" } }),
        }
    }

    /// Note on a last row without an end of its line. A copy that was cut ends like this, and its last number may have
    /// lost digits.
    fn cut_value(&self, last: &csv::ByteRecord) -> Option<String> {
        let field = last.len().checked_sub(1)?;
        let used = self.fields.contains(&field) || self.time.iter().any(|time| time.field == field);
        let name = &self.head.columns.get(field)?.name;
        used.then(|| {
            format!(
                "its last line has no line end and is used as it stands: if the file was cut, `{name}` = `{}` may lack digits; end the line, or remove it",
                shorten(&last[field])
            )
        })
    }

    /// Note on a column with infinite values.
    fn infinite(&self, decoder: &Decoder) -> Option<String> {
        let (count, offset, cell) = &decoder.infinite;
        let name = &self.head.columns[decoder.field].name;
        let values = if *count == 1 { "value" } else { "values" };
        (*count > 0).then(|| {
            format!(
                "column `{name}` has {count} infinite {values}, the first in line {} (`{cell}`): what is beyond 1.8e308 counts as missing",
                self.line(*offset)
            )
        })
    }

    /// Note on lines behind the header that are left out as comments.
    fn comments(&self, left_out: &LeftOut) -> Option<String> {
        let (count, first) = left_out.behind_header();
        let line = || line_of(self.path, self.compression, self.head.skipped + first, |_| false);
        match count {
            0 => None,
            1 => Some(format!("one line that begins like a comment is left out: line {}", line())),
            _ => Some(format!("{count} lines that begin like comments are left out, the first in line {}", line())),
        }
    }

    /// The line of the row that begins at `offset`, or after the blank and comment lines there.
    fn line(&self, offset: u64) -> u64 {
        let semicolons = self.head.semicolons();
        let is_skipped = |line: &[u8]| line.trim_ascii().is_empty() || begins_comment(line, semicolons);
        line_of(self.path, self.compression, self.head.skipped + offset, is_skipped)
    }

    fn ragged(&self, offset: u64, fields: usize) -> Error {
        Error::RaggedRow {
            path: self.path.into(),
            line: self.line(offset),
            fields,
            expected: self.head.columns.len(),
            delimiter: self.head.delimiter.shown(),
        }
    }

    fn bad_cell(&self, offset: u64, record: &csv::ByteRecord, misfit: &Misfit) -> Error {
        Error::BadCell {
            path: self.path.into(),
            line: self.line(offset),
            column: self.head.columns[misfit.field].name.clone(),
            expected: misfit.expected,
            text: shorten(&record[misfit.field]),
        }
    }

    fn csv_error(&self, problem: csv::Error, row: u64) -> Error {
        let text = problem.to_string();
        let source = match problem.into_kind() {
            csv::ErrorKind::Io(source) => source,
            _ => std::io::Error::other(text),
        };
        read_error(self.path, self.compression, format!("after row {row}"), source)
    }
}

/// Decodes the cells of one column.
struct Decoder {
    field: usize,
    sort: Sort,
    /// All numbers so far are written as whole ones.
    whole: bool,
    /// Some value was there.
    any: bool,
    /// Infinite values, which count as missing; where the row of the first begins, and its cell.
    infinite: (u64, u64, String),
    /// Texts in the order in which they came.
    codes: HashMap<Vec<u8>, usize>,
}

impl Decoder {
    fn new(field: usize, sort: Sort) -> Self {
        Self { field, sort, whole: true, any: false, infinite: (0, 0, String::new()), codes: HashMap::new() }
    }

    fn cell(&mut self, cell: &[u8], decimal_comma: bool) -> Result<f64, Misfit> {
        match self.sort {
            Sort::Number => match number(cell, decimal_comma) {
                Cell::Number(value) => {
                    self.any = true;
                    self.whole = self.whole && is_whole(cell);
                    Ok(value)
                }
                Cell::Missing => Ok(f64::NAN),
                Cell::Infinite => {
                    self.infinite.0 += 1;
                    Ok(f64::NAN)
                }
                Cell::Other => Err(self.misfit("a number")),
            },
            _ if is_missing(cell) => Ok(f64::NAN),
            Sort::Unknown => {
                self.sort = sort_of(cell, decimal_comma);
                self.cell(cell, decimal_comma)
            }
            Sort::Boolean => {
                self.any = true;
                match (boolean(cell), number(cell, false)) {
                    (Some(truth), _) => Ok(f64::from(u8::from(truth))),
                    (None, Cell::Number(value)) if value == 0.0 || value == 1.0 => Ok(value),
                    _ => Err(self.misfit("true or false")),
                }
            }
            Sort::Date(order) => {
                self.any = true;
                let stamp = dates::parse(cell, order).ok_or_else(|| self.misfit(A_DATE))?;
                Ok(stamp::seconds(stamp))
            }
            Sort::Text => {
                self.any = true;
                let text = cell.trim_ascii();
                if let Some(&code) = self.codes.get(text) {
                    return Ok(code as f64);
                }
                let code = self.codes.len();
                self.codes.insert(text.to_vec(), code);
                Ok(code as f64)
            }
        }
    }

    /// Remembers where the first infinite value is.
    fn place(&mut self, at: u64, record: &csv::ByteRecord) {
        if self.infinite.0 == 1 && self.infinite.2.is_empty() {
            self.infinite = (1, at, shorten(&record[self.field]));
        }
    }

    fn misfit(&self, expected: &'static str) -> Misfit {
        Misfit { field: self.field, expected }
    }

    fn finish(self, head: &Head) -> TableColumn {
        let kind = match self.sort {
            Sort::Number if self.whole && self.any => ColumnKind::Integer,
            Sort::Number | Sort::Date(_) | Sort::Unknown => ColumnKind::Float,
            Sort::Boolean => ColumnKind::Boolean,
            Sort::Text => {
                let mut names: Vec<(usize, Vec<u8>)> =
                    self.codes.into_iter().map(|(text, code)| (code, text)).collect();
                names.sort_unstable();
                ColumnKind::Category(
                    names.into_iter().map(|(_, text)| String::from_utf8_lossy(&text).into_owned()).collect(),
                )
            }
        };
        TableColumn { column: Column { kind, ..head.columns[self.field].clone() }, empty: !self.any }
    }
}
