//! Tables for people.

use comfy_table::{CellAlignment, Table, presets};
pub(crate) use fleetfoot::report::words::{bytes, count, number, ratio, seconds};

/// A table that pages have too, below its sentence.
pub(crate) fn text_table(content: &fleetfoot::TextTable) -> String {
    let caption = if content.caption.is_empty() { String::new() } else { format!("{}\n", content.caption) };
    caption + &table(&content.header, content.rows.clone())
}

/// A table without lines: the first column to the left, the others to the right.
pub(crate) fn table(header: &[&str], rows: Vec<Vec<String>>) -> String {
    crate::legend::headings(header);
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
