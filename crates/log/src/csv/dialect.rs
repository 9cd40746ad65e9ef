//! Lines of a text file that are no rows: `sep=;`, comments, a commented header, units; and delimiters at row ends.

use super::{
    blanks::with_tabs,
    cell::{Cell, boolean, is_missing, number},
    sort::{Sort, sort},
};
use crate::dates;

/// Start of the header or the first row, and the delimiter that a line `sep=;` in front names.
pub(super) struct Preamble {
    pub begin: usize,
    pub delimiter: Option<u8>,
    /// True if `;` begins a comment.
    pub semicolons: bool,
}

/// Skips a byte order mark, a line `sep=;`, blank lines and comment lines. A comment directly above the rows is the header if it has as many fields as the
/// first row.
pub(super) fn preamble(bytes: &[u8]) -> Preamble {
    let mut at = if bytes.starts_with(&[0xef, 0xbb, 0xbf]) { 3 } else { 0 };
    let delimiter = separator_line(line_at(bytes, at));
    if delimiter.is_some() {
        at += line_at(bytes, at).len();
    }
    let semicolons = has_semicolon_comments(bytes, at);
    let mut comment = None;
    while at < bytes.len() {
        let line = line_at(bytes, at);
        let text = line.trim_ascii();
        if begins_comment(text, semicolons) {
            comment = Some((at, text));
        } else if !text.is_empty() {
            if let Some((start, header)) = comment
                && is_header_of(header, text)
            {
                let begin = start + bytes[start..].iter().take_while(|&&byte| is_mark(byte)).count();
                return Preamble { begin, delimiter, semicolons };
            }
            break;
        }
        at += line.len();
    }
    Preamble { begin: at, delimiter, semicolons }
}

fn line_at(bytes: &[u8], at: usize) -> &[u8] {
    bytes[at..].split_inclusive(|&byte| byte == b'\n').next().unwrap_or_default()
}

/// Returns true if `;` begins comments. It does not if it delimits the first line without a mark, or, if all lines have
/// one, the first that begins with it.
fn has_semicolon_comments(bytes: &[u8], at: usize) -> bool {
    let lines = || bytes[at..].split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii).filter(|line| !line.is_empty());
    match lines().find(|line| !begins_comment(line, true)) {
        Some(row) => !row.contains(&b';'),
        None => lines().find(|line| !begins_comment(line, false)).is_none_or(|row| !row[1..].contains(&b';')),
    }
}

/// The first line.
pub(super) fn first_line(bytes: &[u8]) -> &[u8] {
    bytes.split(|&byte| matches!(byte, b'\n' | b'\r')).next().unwrap_or_default()
}

/// The delimiter that Excel's line `sep=;` names.
fn separator_line(line: &[u8]) -> Option<u8> {
    let text: Vec<u8> = line.iter().copied().filter(|byte| !matches!(byte, b'\r' | b'\n' | b'"')).collect();
    match text.split_at_checked(4) {
        Some((word, &[delimiter])) if word.eq_ignore_ascii_case(b"sep=") => Some(delimiter),
        _ => None,
    }
}

/// Returns true if a byte is one of those in front of a comment.
pub(super) fn is_mark(byte: u8) -> bool {
    matches!(byte, b'#' | b'%' | b';' | b'/' | b' ' | b'\t')
}

/// Returns true if a line is a comment: it begins with `#`, `%` or `//`, or with `;` if that is not the delimiter.
/// `#N/A` and the like are missing values.
pub(super) fn begins_comment(line: &[u8], semicolons: bool) -> bool {
    let line = line.trim_ascii_start();
    let is_end = |&byte: &u8| matches!(byte, b',' | b';' | b'|' | b' ' | b'\t' | b'\r' | b'\n');
    match line {
        [b'#', ..] => !is_missing(line.split(is_end).next().unwrap_or_default()),
        [b'%', ..] | [b'/', b'/', ..] => true,
        [b';', ..] => semicolons,
        _ => false,
    }
}

/// Returns true if a comment is the header of the row below it. It then has as many fields, none of them is a number,
/// and at least half of the row's cells are.
fn is_header_of(comment: &[u8], row: &[u8]) -> bool {
    let agree = |names: &[u8], row: &[u8], delimiter: u8| {
        let cells = || row.split(|&byte| byte == delimiter);
        let kind = |cell: &[u8]| number(cell, delimiter != b',');
        let names = || names.split(|&byte| byte == delimiter);
        let numbers = cells().filter(|cell| kind(cell) != Cell::Other).count();
        let count = cells().count();
        count > 1 && names().count() == count && 2 * numbers >= count && names().all(|name| kind(name) == Cell::Other)
    };
    let marks = comment.iter().take_while(|&&byte| is_mark(byte)).count();
    let names = &comment[marks..];
    [b',', b';', b'\t'].into_iter().any(|delimiter| agree(names, row, delimiter))
        || agree(&with_tabs(names), &with_tabs(row), b'\t')
}

/// The units of a row of units between the header and the rows below it: no cell of it is a number or a date, while columns of numbers or dates follow.
pub(super) fn units(
    row: &csv::ByteRecord,
    below: &[csv::ByteRecord],
    decimal_comma: bool,
) -> Option<Vec<Option<String>>> {
    let says_unit = |cell: &[u8]| {
        number(cell, decimal_comma) == Cell::Other && boolean(cell).is_none() && dates::parse_any(cell).is_none()
    };
    let cells = || row.iter().enumerate().filter(|(_, cell)| !is_missing(cell));
    let column = |c: usize| below.iter().filter_map(move |record| record.get(c));
    let is_number = |c: usize| matches!(sort(column(c), decimal_comma), Sort::Number | Sort::Boolean | Sort::Date(_));
    // A text that comes again below is a value.
    let is_value = |c: usize, cell: &[u8]| column(c).any(|other| other == cell);
    let sound = cells().all(|(c, cell)| says_unit(cell) && !is_value(c, cell)) && cells().any(|(c, _)| is_number(c));
    sound.then(|| row.iter().map(|cell| if is_missing(cell) { None } else { unit_of(cell) }).collect())
}

/// `m/s` of `m/s`, `[m/s]` or `(m/s)`.
fn unit_of(cell: &[u8]) -> Option<String> {
    let text = text_of(cell);
    let text = text.trim();
    let bare =
        [('[', ']'), ('(', ')')].into_iter().find_map(|(open, close)| text.strip_prefix(open)?.strip_suffix(close));
    let unit = bare.unwrap_or(text).trim();
    (!unit.is_empty() && unit != "-").then(|| unit.to_owned())
}

/// Text that is not UTF-8 is Latin-1: its degree signs and micros are then right.
pub(super) fn text_of(cell: &[u8]) -> String {
    match std::str::from_utf8(cell) {
        Ok(text) => text.to_owned(),
        Err(_) => cell.iter().map(|&byte| char::from(byte)).collect(),
    }
}

/// Number of the header's cells that are columns: delimiters at its end, without a name and without a value below, are
/// none.
pub(super) fn named_columns(header: &csv::ByteRecord, below: &[csv::ByteRecord]) -> usize {
    let is_nothing = |c: usize| {
        let cells = below.iter().filter_map(|record| record.get(c));
        header[c].trim_ascii().is_empty() && cells.into_iter().all(|cell| cell.trim_ascii().is_empty())
    };
    let kept = (0..header.len()).rev().find(|&c| !is_nothing(c)).map_or(0, |last| last + 1);
    if kept == 0 { header.len() } else { kept }
}
