//! Tables and numbers for people.

use comfy_table::{CellAlignment, Table, presets};

/// A table without lines: the first column to the left, the others to the right.
pub(crate) fn table(header: &[&str], rows: Vec<Vec<String>>) -> String {
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    table.set_header(header.iter().copied());
    for row in rows {
        table.add_row(row);
    }
    for (index, column) in table.column_iter_mut().enumerate() {
        column.set_padding((if index == 0 { 2 } else { 1 }, 1));
        if index > 0 {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table.trim_fmt()
}

/// `1 episode`, `2 episodes`.
pub(crate) fn count(number: usize, thing: &str) -> String {
    format!("{number} {thing}{}", if number == 1 { "" } else { "s" })
}

/// Four significant digits.
pub(crate) fn number(value: f64) -> String {
    if value.is_nan() {
        return "-".into();
    }
    if value == 0.0 || value.is_infinite() {
        return format!("{value}");
    }
    let magnitude = value.abs().log10().floor() as i32;
    if (-4..6).contains(&magnitude) {
        format!("{value:.*}", (3 - magnitude).max(0) as usize)
    } else {
        format!("{value:.3e}")
    }
}

/// Three decimals, for ratios around one; smaller ones in scientific form.
pub(crate) fn ratio(value: f64) -> String {
    match value {
        v if v.is_nan() => "-".into(),
        v if v != 0.0 && !(5e-4..1e6).contains(&v.abs()) => format!("{v:.1e}"),
        v => format!("{v:.3}"),
    }
}

/// Seconds, in a unit that suits.
pub(crate) fn seconds(value: f64) -> String {
    match value {
        v if v.is_nan() => "-".into(),
        v if v < 1.0 => format!("{} ms", number(v * 1e3)),
        v if v < 600.0 => format!("{} s", number(v)),
        v => format!("{} min", number(v / 60.0)),
    }
}

/// Bytes, in a unit that suits.
pub(crate) fn bytes(value: u64) -> String {
    let value = value as f64;
    match value {
        v if v < 1e3 => format!("{v} B"),
        v if v < 1e6 => format!("{} kB", number(v / 1e3)),
        v if v < 1e9 => format!("{} MB", number(v / 1e6)),
        v => format!("{} GB", number(v / 1e9)),
    }
}
