//! The numbers behind the drawings, as tables.

use super::{Axis, Bars, Interval, Lines, Matrix, Panels, Series, Spans};
use crate::{Cell, Table};

/// A row a place: lines that share their places share the rows.
pub(super) fn of_lines(lines: &Lines) -> Table {
    let shared = lines.series.windows(2).all(|pair| same(&pair[0].x, &pair[1].x));
    if shared { side_by_side(lines) } else { one_below_the_other(lines) }
}

fn same(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

fn side_by_side(lines: &Lines) -> Table {
    let mut head = vec![lines.x.title()];
    for series in &lines.series {
        head.push(series.name.clone());
        if series.band.is_some() {
            head.extend([format!("{} low", series.name), format!("{} high", series.name)]);
        }
    }
    let mut table = Table::new(lines.y.title(), head);
    let places = lines.series.first().map_or(&[][..], |series| &series.x);
    for (at, &x) in places.iter().enumerate() {
        let cells = lines.series.iter().flat_map(|series| values(series, at));
        table = table.row(std::iter::once(Cell::of(x)).chain(cells));
    }
    table
}

fn one_below_the_other(lines: &Lines) -> Table {
    let mut table = Table::new("", ["line".to_owned(), lines.x.title(), lines.y.title()]);
    for series in &lines.series {
        for (&x, &y) in series.x.iter().zip(&series.y) {
            table = table.row([Cell::Text(series.name.clone()), Cell::of(x), Cell::of(y)]);
        }
    }
    table
}

fn values(series: &Series, at: usize) -> Vec<Cell> {
    let value = |list: &[f64]| Cell::of(list.get(at).copied().unwrap_or(f64::NAN));
    let band = series.band.iter().flatten().map(|list| value(list));
    std::iter::once(value(&series.y)).chain(band).collect()
}

pub(super) fn of_bars(bars: &Bars) -> Table {
    let mut head = vec!["name".to_owned()];
    for (name, _) in &bars.bars {
        head.extend([name.clone(), format!("{name} low"), format!("{name} high")]);
    }
    head.extend(bars.marks.iter().map(|mark| mark.name.clone()));
    let mut table = Table::new(bars.axis.title(), head);
    for (group, name) in bars.groups.iter().enumerate() {
        let none = Interval { value: f64::NAN, low: f64::NAN, high: f64::NAN };
        let of = |values: &Vec<Interval>| values.get(group).copied().unwrap_or(none);
        let bounds = bars.bars.iter().map(|(_, values)| of(values)).flat_map(|v| [v.value, v.low, v.high]);
        let marks = bars.marks.iter().map(|mark| mark.values.get(group).copied().unwrap_or(f64::NAN));
        table = table.row(std::iter::once(Cell::Text(name.clone())).chain(bounds.chain(marks).map(Cell::of)));
    }
    table
}

pub(super) fn of_spans(spans: &Spans) -> Table {
    let end =
        |which: &str, axis: &Axis| axis.unit.as_ref().map_or(which.to_owned(), |unit| format!("{which} [{unit}]"));
    let head = ["row".to_owned(), "what".to_owned(), end("from", &spans.axis), end("to", &spans.axis)];
    let mut table = Table::new(spans.axis.label.clone(), head);
    for (name, row) in &spans.rows {
        for span in row {
            let kind = spans.kinds.get(span.kind).cloned().unwrap_or_default();
            table = table.row([Cell::Text(name.clone()), Cell::Text(kind), Cell::of(span.from), Cell::of(span.to)]);
        }
    }
    table
}

/// A row a place of a panel's lines; lines of a panel share their places.
pub(super) fn of_panels(panels: &Panels) -> Table {
    let Some(first) = panels.panels.first() else { return Table::default() };
    let mut head = side_by_side(first).head;
    head[0] = "at".to_owned();
    let mut table = Table::new(first.y.title(), std::iter::once("panel".to_owned()).chain(head));
    for panel in &panels.panels {
        for row in side_by_side(panel).rows {
            table = table.row(std::iter::once(Cell::Text(panel.x.title())).chain(row));
        }
    }
    table
}

pub(super) fn of_matrix(matrix: &Matrix) -> Table {
    let head = std::iter::once(matrix.corner()).chain(matrix.columns.iter().cloned());
    let mut table = Table::new(matrix.what.clone(), head);
    for (name, values) in matrix.rows.iter().zip(&matrix.values) {
        table = table.row(std::iter::once(Cell::Text(name.clone())).chain(values.iter().copied().map(Cell::of)));
    }
    table
}
