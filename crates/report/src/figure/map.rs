//! Values over a plane: cells whose colour is the stronger the larger their value is.

use super::{
    canvas::{Canvas, Frame, LINE, Sample, width_of},
    scale::{Axis, extent},
};
use crate::{
    Cell, Table,
    markup::{Element, trace},
    words::{number, typeset},
};

/// Values over a plane.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Map {
    /// Name of the values.
    pub what: String,
    /// The axes, across and up, each with its range.
    pub axes: [Axis; 2],
    /// Values: the cells of the first column from the bottom, then those of the second; NaN for none.
    pub columns: Vec<Vec<f64>>,
}

/// Number of distinct shades; the style sheet has their opacities.
const SHADES: usize = 6;
/// Side of the plane at most, pixels.
const WIDEST: f64 = 420.0;

impl Map {
    /// Values over a plane, column by column from the left, each from the bottom.
    pub fn new(what: impl Into<String>, axes: [Axis; 2], columns: Vec<Vec<f64>>) -> Self {
        Self { what: what.into(), axes, columns }
    }

    /// The range of an axis, in equal parts.
    fn places(&self, axis: usize) -> Vec<f64> {
        let count = if axis == 0 { self.columns.len() } else { self.columns.first().map_or(0, Vec::len) };
        let [low, high] = self.axes[axis].range.unwrap_or([0.0, count as f64]);
        (0..=count).map(|at| low + (high - low) * at as f64 / count.max(1) as f64).collect()
    }

    fn known(&self) -> impl Iterator<Item = f64> {
        self.columns.iter().flatten().copied().filter(|value| value.is_finite())
    }

    /// The shade of a value; all of one value are of the middle one.
    fn shade(&self, value: f64, [low, high]: [f64; 2]) -> usize {
        if high > low { ((SHADES as f64 * (value - low) / (high - low)) as usize).min(SHADES - 1) } else { SHADES / 2 }
    }

    /// Range of the values, and the place of the largest, in words.
    pub(super) fn in_words(&self) -> String {
        let [low, high] = extent(self.known());
        let middle = |axis: usize, at: usize| {
            self.places(axis).windows(2).nth(at).map_or(f64::NAN, |ends| 0.5 * (ends[0] + ends[1]))
        };
        let cells = self
            .columns
            .iter()
            .enumerate()
            .flat_map(|(i, column)| column.iter().enumerate().map(move |(j, value)| (i, j, *value)));
        let largest = cells.filter(|cell| cell.2.is_finite()).max_by(|a, b| a.2.total_cmp(&b.2));
        let Some((i, j, _)) = largest else { return format!("{}: no cell has a value.", self.what) };
        let text = |value: f64| typeset(&number(value));
        format!(
            "{} over {} and {}: from {} to {}, the largest at {} and {}.",
            self.what,
            self.axes[0].title(),
            self.axes[1].title(),
            text(low),
            text(high),
            text(middle(0, i)),
            text(middle(1, j))
        )
    }

    /// A row of cells from the top, as they are drawn.
    pub(super) fn table(&self) -> Table {
        let middles =
            |axis: usize| self.places(axis).windows(2).map(|ends| 0.5 * (ends[0] + ends[1])).collect::<Vec<_>>();
        let corner = format!("{} (down) / {} (across)", self.axes[1].title(), self.axes[0].title());
        let head = std::iter::once(corner).chain(middles(0).into_iter().map(|middle| typeset(&number(middle))));
        let mut table = Table::new(self.what.clone(), head);
        for (up, middle) in middles(1).into_iter().enumerate().rev() {
            let cells = self.columns.iter().map(|column| Cell::of(column.get(up).copied().unwrap_or(f64::NAN)));
            table = table.row(std::iter::once(Cell::of(middle)).chain(cells));
        }
        table
    }

    pub(super) fn draw(&self, mut canvas: Canvas) -> Canvas {
        let reach = extent(self.known());
        let top = canvas.legend(&self.entries(reach), 0.0) + 2.0 * LINE;
        let rulers = |axis: usize, from: f64, to: f64| self.axes[axis].ruler(self.places(axis).into_iter(), from, to);
        let ticks = rulers(1, 0.0, 1.0).ticks(5);
        let left = ticks.iter().map(|(_, label)| width_of(label)).fold(16.0, f64::max) + 10.0;
        let side = (canvas.width - left - 12.0).min(WIDEST);
        let frame = Frame { left, right: left + side, top, bottom: top + side };
        let (across, up) = (rulers(0, frame.left, frame.right), rulers(1, frame.bottom, frame.top));
        canvas.height = frame.bottom + 2.0 * LINE + 8.0;
        canvas.label("start", [0.0, top - 10.0], &self.axes[1].title(), canvas.width);
        for (shade, cells) in self.by_shade(reach).into_iter().enumerate().filter(|(_, cells)| !cells.is_empty()) {
            let [x, y] = [self.places(0), self.places(1)];
            let cell = |&(i, from, to): &(usize, usize, usize)| {
                let [left, right, low, high] = [across.at(x[i])?, across.at(x[i + 1])?, up.at(y[from])?, up.at(y[to])?];
                Some(trace(&[[left, low], [left, high], [right, high], [right, low]], true))
            };
            let path: String = cells.iter().filter_map(cell).collect();
            canvas.add(Element::new("path").class(format!("cell h{shade}")).with("d", path));
        }
        canvas.up(&up, &frame, 5, [frame.left - 4.0, frame.left]);
        // The grid stands below the plane only: on it there are the cells.
        let below = Frame { top: frame.bottom, bottom: frame.bottom + 2.0, ..frame };
        canvas.across(&across, &below, &self.axes[0].title());
        canvas
    }

    /// Cells by their shade: column, and from where to where it has that shade.
    fn by_shade(&self, reach: [f64; 2]) -> Vec<Vec<(usize, usize, usize)>> {
        let mut shades: Vec<Vec<(usize, usize, usize)>> = vec![Vec::new(); SHADES];
        for (i, column) in self.columns.iter().enumerate() {
            for (j, &value) in column.iter().enumerate().filter(|(_, value)| value.is_finite()) {
                let runs = &mut shades[self.shade(value, reach)];
                match runs.last_mut() {
                    Some((last, _, to)) if *last == i && *to == j => *to = j + 1,
                    _ => runs.push((i, j, j + 1)),
                }
            }
        }
        shades
    }

    /// Entries of the legend of shades.
    fn entries(&self, reach: [f64; 2]) -> Vec<(Sample, String, String)> {
        let [low, high] = reach;
        if low >= high {
            return Vec::new();
        }
        let end = |shade: usize| typeset(&number(low + (high - low) * shade as f64 / SHADES as f64));
        let entry = |shade: usize| (Sample::Box, format!("cell h{shade}"), format!("from {}", end(shade)));
        (0..SHADES).map(entry).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::SHADES;

    /// Opacity of the darkest.
    const DARKEST: f64 = 0.9;

    #[test]
    fn the_style_sheet_has_all_shades() {
        for shade in 0..SHADES {
            let opacity = DARKEST * (shade as f64 + 1.0) / SHADES as f64;
            let rule = format!("svg.figure .h{shade}{{fill-opacity:{opacity:.2}}}");
            assert!(crate::figure::STYLE.contains(&rule), "{rule}");
        }
    }
}
