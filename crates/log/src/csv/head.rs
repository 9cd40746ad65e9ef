//! Beginning of a text file: delimiter, header, and the types of the columns.

use std::{collections::BTreeMap, io::Read, path::Path};

use fleetfoot_data::{Column, ColumnKind};

use super::{
    blanks::Delimiter,
    cell::{Cell, is_missing, is_whole, number},
    comments::Comments,
    dialect::{self, Preamble, first_line, text_of},
    fractions::Fractions,
    input::{self, read_error, reader},
    sort::{Sort, sort},
};
use crate::{
    Compression, Error, TimeUnit,
    dates::{self, DateOrder, Fit},
    stamp,
    time_column::{Candidate, CandidateKind, split_unit},
};

/// Bytes looked at.
const HEAD: usize = 256 << 10;
/// Rows looked at.
const SAMPLE: usize = 1000;

/// End of the note on dates that can be read in two orders.
const EITHER_ORDER: &str = "the other order of day and month fits its first rows as well";

/// Its end if other files determine that order.
const AS_OTHERS: &str = "in other files of this call that order alone fits";

fn dates_note(column: &str, order: DateOrder, why: &str) -> String {
    format!("the dates of `{column}` are read {}: {why}", order.words())
}

/// The beginning of a file.
pub(super) struct Head {
    /// The first bytes, decompressed, from the first row (the header, if there is one) on.
    pub bytes: Vec<u8>,
    /// Bytes of the file, decompressed, in front of these.
    pub skipped: u64,
    pub delimiter: Delimiter,
    pub has_header: bool,
    /// The row of units under the header.
    pub units: Option<csv::ByteRecord>,
    /// Columns of dates, with the orders of day and month in which they can be read.
    pub dates: Vec<(usize, Fit)>,
    pub columns: Vec<Column>,
    pub sorts: Vec<Sort>,
    pub decimal_comma: bool,
    pub sample: Vec<csv::ByteRecord>,
    pub notes: Vec<String>,
}

/// Reads the beginning of a file; the stream stands behind [`Head::bytes`] afterwards.
pub(super) fn read(path: &Path, compression: Compression, stream: &mut dyn Read) -> Result<Head, Error> {
    let mut bytes = Vec::with_capacity(HEAD);
    let failed = stream.take(HEAD as u64).read_to_end(&mut bytes).err();
    if let Some(source) = failed {
        return Err(read_error(path, compression, "its beginning".into(), source));
    }
    let complete = bytes.len() < HEAD;
    check_text(path, &bytes)?;
    let Preamble { begin, delimiter: named, semicolons } = dialect::preamble(&bytes);
    bytes.drain(..begin);
    if bytes.is_empty() {
        return Err(Error::NoRows { path: path.into() });
    }
    let delimiter = named.map_or_else(|| sniff_delimiter(&bytes, semicolons, complete), Delimiter::Byte);
    let semicolons = delimiter.byte() != b';';
    let mut records = parse(&bytes, delimiter, semicolons, SAMPLE + 1, complete);
    if records.is_empty() {
        let problem = "its first line is longer than 256 KiB".into();
        return Err(Error::WrongFormat { path: path.into(), problem, mend: "check that it is delimited text" });
    }
    let first = records.remove(0);
    let decimal_comma = delimiter != Delimiter::Byte(b',') && writes_comma(&records);
    let has_header = first.iter().any(|cell| {
        !is_missing(cell) && number(cell, decimal_comma) == Cell::Other && dates::parse_any(cell).is_none()
    });
    let mut notes = Vec::new();
    records.retain(|record| !has_header || !is_header_again(record, &first));
    let second = if has_header { records.first().cloned() } else { None };
    let below: Vec<_> = records.iter().filter(|record| second.as_ref() != Some(record)).cloned().collect();
    let units = second.as_ref().and_then(|row| dialect::units(row, &below, decimal_comma));
    if units.is_some() {
        records = below;
        notes.push("the row under its header is read as the units of its columns".into());
    }
    if delimiter == Delimiter::Blanks {
        notes.push("its columns are separated by blanks".into());
    }
    let columns = if has_header {
        let named = dialect::named_columns(&first, &records);
        let unit = |i: usize| units.as_ref().and_then(|units| units.get(i)?.clone());
        let names = first.iter().enumerate().take(named);
        names.map(|(i, cell)| header_column(i, cell, unit(i))).collect()
    } else {
        notes.push(format!("no header: the columns are called c0 to c{}", first.len().saturating_sub(1)));
        (0..first.len()).map(|i| Column::float(format!("c{i}"))).collect::<Vec<_>>()
    };
    if decimal_comma {
        notes.push("numbers are written with a decimal comma".into());
    }
    if !has_header {
        records.insert(0, first);
    }
    records.truncate(SAMPLE);
    let cells = |c: usize| records.iter().filter_map(move |record| record.get(c));
    let sorts: Vec<Sort> = (0..columns.len()).map(|c| sort(cells(c), decimal_comma)).collect();
    let mut dates = Vec::new();
    for (c, sort) in sorts.iter().enumerate() {
        if let Sort::Date(order) = sort {
            let fit = DateOrder::of(cells(c).filter(|cell| !is_missing(cell))).1;
            dates.push((c, fit));
            if matches!(fit, Fit::Either(..)) {
                notes.push(dates_note(&columns[c].name, *order, EITHER_ORDER));
            }
        }
    }
    Ok(Head {
        bytes,
        skipped: begin as u64,
        delimiter,
        has_header,
        units: second.filter(|_| units.is_some()),
        dates,
        columns,
        sorts,
        decimal_comma,
        sample: records,
        notes,
    })
}

impl Head {
    /// The comments of the file, with the first bytes in front of what follows.
    pub(super) fn comments(&self) -> Comments {
        let comments = Comments::new(self.delimiter, self.semicolons());
        if self.has_header { comments.below(first_line(&self.bytes)) } else { comments }
    }

    /// Returns true if `;` begins a comment.
    pub(super) fn semicolons(&self) -> bool {
        self.delimiter.byte() != b';'
    }

    /// The columns as possible clocks.
    pub(super) fn candidates(&self) -> Vec<Candidate> {
        let kind = |c: usize| match self.sorts[c] {
            Sort::Number if self.cells(c).all(is_whole) => CandidateKind::Integer,
            Sort::Number => CandidateKind::Float,
            Sort::Date(_) => CandidateKind::Time,
            // Its name may still say that it is the clock.
            Sort::Unknown => CandidateKind::Float,
            _ => CandidateKind::Other,
        };
        let candidate = |(c, column): (usize, &Column)| Candidate {
            name: column.name.clone(),
            unit: column.unit.clone(),
            kind: kind(c),
        };
        self.columns.iter().enumerate().map(candidate).collect()
    }

    /// The first values of a column: numbers as they are, dates in seconds; NaN of rows that all miss it.
    pub(super) fn values(&self, c: usize) -> Vec<f64> {
        let value = |cell: &[u8]| match (self.sorts[c], number(cell, self.decimal_comma)) {
            (Sort::Date(order), _) => dates::parse(cell, order).map_or(f64::NAN, stamp::seconds),
            (_, Cell::Number(value)) => value,
            _ => f64::NAN,
        };
        let values: Vec<f64> = self.cells(c).map(value).collect();
        if values.is_empty() { vec![f64::NAN; self.sample.len()] } else { values }
    }

    /// The lost zeros of the stamps in a column.
    pub(super) fn lost_zeros(&self, c: usize, unit: TimeUnit) -> Option<Fractions> {
        let parse = |cell: &[u8]| match self.sorts[c] {
            Sort::Number if unit == TimeUnit::Seconds => stamp::parse_decimal(cell, unit),
            Sort::Date(order) => dates::parse(cell, order),
            _ => None,
        };
        Fractions::of(self.cells(c), parse)
    }

    /// The first cells of a column that are not missing.
    fn cells(&self, c: usize) -> impl Iterator<Item = &[u8]> + Clone {
        self.sample.iter().filter_map(move |record| record.get(c)).filter(|cell| !is_missing(cell))
    }

    /// Reads the dates that fit both orders of day and month in the other one; `false` where there are none.
    pub(super) fn turn_dates(&mut self) -> bool {
        let open = self.open_dates();
        for &c in &open {
            if let Sort::Date(order) = &mut self.sorts[c] {
                *order = order.other();
            }
        }
        self.notes.retain(|note| !note.ends_with(EITHER_ORDER) && !note.ends_with(AS_OTHERS));
        !open.is_empty()
    }

    /// Columns whose dates may be read in the other order of day and month as well.
    fn open_dates(&self) -> Vec<usize> {
        self.dates.iter().filter(|(_, fit)| matches!(fit, Fit::Either(..))).map(|&(c, _)| c).collect()
    }

    /// Reads dates that leave the order of day and month open in that of all files.
    pub(super) fn follow(&mut self, orders: &BTreeMap<String, (DateOrder, bool)>) {
        for c in self.open_dates() {
            let name = &self.columns[c].name;
            if let (Sort::Date(order), Some(&(common, certain))) = (&mut self.sorts[c], orders.get(name)) {
                let before = dates_note(name, *order, EITHER_ORDER);
                *order = common;
                let note = dates_note(name, common, if certain { AS_OTHERS } else { EITHER_ORDER });
                self.notes
                    .iter_mut()
                    .filter(|note_line| **note_line == before)
                    .for_each(|note_line| note_line.clone_from(&note));
            }
        }
    }

    /// The names of columns of dates, with the orders of day and month in which they can be read.
    pub(super) fn date_orders(&self) -> Vec<(String, (DateOrder, Fit))> {
        let of = |&(c, fit): &(usize, Fit)| match self.sorts[c] {
            Sort::Date(order) => Some((self.columns[c].name.clone(), (order, fit))),
            _ => None,
        };
        self.dates.iter().filter_map(of).collect()
    }

    /// Type of a column from the first rows.
    pub(super) fn kind(&self, c: usize) -> ColumnKind {
        let mut cells = self.sample.iter().filter_map(|record| record.get(c)).filter(|cell| !is_missing(cell));
        match self.sorts[c] {
            Sort::Number if cells.all(is_whole) => ColumnKind::Integer,
            Sort::Number | Sort::Date(_) | Sort::Unknown => ColumnKind::Float,
            Sort::Boolean => ColumnKind::Boolean,
            Sort::Text => ColumnKind::Category(Vec::new()),
        }
    }
}

/// Refuses what is no text, and says what it seems to be.
fn check_text(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let wrong = |problem: &str, mend| Err(Error::WrongFormat { path: path.into(), problem: problem.into(), mend });
    match bytes {
        [] => wrong("the file is empty, or holds zero bytes alone", "record or copy it again"),
        [b'P', b'A', b'R', b'1', ..] => wrong("this is a Parquet file, not text", "rename it to end in .parquet"),
        [0x1f, 0x8b, ..] => wrong("this is gzip inside", "rename it to end in .gz, or decompress it"),
        [0x28, 0xb5, 0x2f, 0xfd, ..] => wrong("this is Zstandard inside", "rename it to end in .zst, or decompress it"),
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => wrong("the text is UTF-16", "save it as UTF-8"),
        _ if bytes.contains(&0) => {
            wrong("it holds zero bytes, so it is no text", "give it the extension of its format")
        }
        _ => Ok(()),
    }
}

fn header_column(index: usize, cell: &[u8], unit: Option<String>) -> Column {
    let text = text_of(cell);
    let text = text.trim().to_owned();
    let unit = unit.or_else(|| split_unit(&text).1.map(str::to_owned));
    Column { unit, ..Column::float(if text.is_empty() { format!("c{index}") } else { text }) }
}

/// Returns true if a row repeats the header: another session of the same logger follows.
pub(super) fn is_header_again(record: &csv::ByteRecord, header: &csv::ByteRecord) -> bool {
    record.len() == header.len() && record.iter().zip(header).all(|(a, b)| a.trim_ascii() == b.trim_ascii())
}

/// Rows that tell the delimiter.
const SNIFFED: usize = 20;

/// The delimiter with which the first rows have the same number of fields, and the most of them; blanks, where no other separates anything and they separate
/// as many cells in every row, most of them numbers.
fn sniff_delimiter(bytes: &[u8], semicolons: bool, complete: bool) -> Delimiter {
    let mut best = (0, b',');
    for delimiter in [b',', b';', b'\t', b'|'] {
        let records = parse(bytes, Delimiter::Byte(delimiter), semicolons, SNIFFED, complete);
        let Some(fields) = records.first().map(csv::ByteRecord::len).filter(|&fields| fields > 1) else {
            continue;
        };
        let agreeing = records.iter().filter(|record| as_long(record, &records[0])).count();
        let score = agreeing * 1000 / records.len() * 10_000 + fields.min(9999);
        if score > best.0 {
            best = (score, delimiter);
        }
    }
    let plain = parse(bytes, Delimiter::Byte(best.1), semicolons, SNIFFED, complete);
    // A comma in the decimals of numbers, a tab among blanks: rows that do not agree are separated by something else.
    let agree = |records: &[csv::ByteRecord]| records.iter().all(|record| as_long(record, &records[0]));
    if best.0 > 0 && agree(&plain) {
        return Delimiter::Byte(best.1);
    }
    let records = parse(bytes, Delimiter::Blanks, semicolons, SNIFFED, complete);
    let cells = || records.iter().flat_map(|record| record.iter());
    let numbers = cells().filter(|cell| number(cell, true) != Cell::Other).count();
    let separated = records.first().is_some_and(|record| record.len() > 1) && agree(&records);
    if separated && 2 * numbers > cells().count() { Delimiter::Blanks } else { Delimiter::Byte(best.1) }
}

/// Returns true if two rows have as many cells, but for a delimiter at the end of one of them.
fn as_long(record: &csv::ByteRecord, first: &csv::ByteRecord) -> bool {
    let (short, long) = if record.len() < first.len() { (record, first) } else { (first, record) };
    let is_end = || long.iter().next_back().is_some_and(|cell| cell.trim_ascii().is_empty());
    short.len() == long.len() || short.len() + 1 == long.len() && is_end()
}

/// Complete rows at the beginning of some bytes; `semicolons`: `;` begins a comment.
fn parse(bytes: &[u8], delimiter: Delimiter, semicolons: bool, limit: usize, complete: bool) -> Vec<csv::ByteRecord> {
    let bytes = Comments::new(delimiter, semicolons).without(bytes);
    let bytes = &*delimiter.separate(&bytes);
    let end = if complete { bytes.len() } else { bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |at| at + 1) };
    let mut records: Vec<_> =
        reader(&bytes[..end], delimiter.byte()).into_byte_records().map_while(Result::ok).take(limit).collect();
    // An unfinished last row of an unfinished file tells nothing.
    if complete && bytes.last() != Some(&b'\n') && records.len() > 2 && records.len() < limit {
        let last = records.len() - 1;
        if records[last].len() != records[0].len() {
            records.pop();
        }
    }
    records
}

fn writes_comma(records: &[csv::ByteRecord]) -> bool {
    let cells = || records.iter().flat_map(|record| record.iter()).filter(|cell| !is_missing(cell));
    let with = cells()
        .filter(|cell| number(cell, false) == Cell::Other && matches!(number(cell, true), Cell::Number(_)))
        .count();
    let point = cells().filter(|cell| cell.contains(&b'.') && matches!(number(cell, false), Cell::Number(_))).count();
    with > point
}

/// Opens a file and reads its beginning.
pub(super) fn open(path: &Path, compression: Compression) -> Result<(Head, Box<dyn Read>), Error> {
    let mut stream = input::open(path, compression)?;
    let head = read(path, compression, &mut stream)?;
    Ok((head, stream))
}
