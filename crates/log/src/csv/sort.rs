//! The kind of the cells in a column of a text file: numbers, truth values, dates or texts.

use super::cell::{Cell, boolean, is_missing, number};
use crate::dates::{self, DateOrder};

/// The kind of a column's cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sort {
    /// Numbers.
    Number,
    /// Truth values.
    Boolean,
    /// Dates, or times of the day.
    Date(DateOrder),
    /// Texts.
    Text,
    /// Nothing was there yet: the first cell that says something decides.
    Unknown,
}

/// The kind of a column's cells, by the majority of them.
pub(super) fn sort<'a>(cells: impl Iterator<Item = &'a [u8]> + Clone, decimal_comma: bool) -> Sort {
    let (mut numbers, mut truths, mut dates, mut all) = (0, 0, 0, 0);
    let present = || cells.clone().filter(|cell| !is_missing(cell));
    for cell in present() {
        // Infinities are missing values, but they are numbers.
        all += 1;
        match sort_of(cell, decimal_comma) {
            Sort::Number => numbers += 1,
            Sort::Boolean => truths += 1,
            Sort::Date(_) => dates += 1,
            _ => {}
        }
    }
    if all == 0 {
        Sort::Unknown
    } else if truths > 0 && truths + numbers == all {
        Sort::Boolean
    } else if 2 * numbers >= all {
        Sort::Number
    } else if 2 * dates >= all {
        Sort::Date(DateOrder::of(present().filter(|cell| dates::parse_any(cell).is_some())).0)
    } else {
        Sort::Text
    }
}

/// The kind of a single cell that is not missing.
pub(super) fn sort_of(cell: &[u8], decimal_comma: bool) -> Sort {
    if number(cell, decimal_comma) != Cell::Other {
        Sort::Number
    } else if boolean(cell).is_some() {
        Sort::Boolean
    } else if dates::parse(cell, DateOrder::MonthFirst).is_some() {
        Sort::Date(DateOrder::MonthFirst)
    } else if dates::parse(cell, DateOrder::DayFirst).is_some() {
        Sort::Date(DateOrder::DayFirst)
    } else {
        Sort::Text
    }
}
