//! Values by two names: cells that are the darker the larger their share is.

use super::canvas::{Canvas, INDENT, LINE, fitting, width_of};
use crate::{
    markup::Element,
    words::{number, typeset},
};

/// Shares by two names.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Matrix {
    /// Name of the values.
    pub what: String,
    /// Names of the row axis and the column axis.
    pub sides: [String; 2],
    /// Names of the rows, from the top.
    pub rows: Vec<String>,
    /// Names of the columns, from the left.
    pub columns: Vec<String>,
    /// Values between 0 and 1, rows of columns; NaN for none.
    pub values: Vec<Vec<f64>>,
}

/// Opacity of a cell whose value is 1: numbers are to be read on it.
const DARKEST: f64 = 0.5;
/// Height of a cell, and room for a name of a row.
const CELL: f64 = 22.0;
const NAME: f64 = 120.0;

impl Matrix {
    /// Shares, rows of columns. `sides`: names of the row axis and the column axis.
    pub fn new(
        what: impl Into<String>,
        sides: [&str; 2],
        [rows, columns]: [Vec<String>; 2],
        values: Vec<Vec<f64>>,
    ) -> Self {
        Self { what: what.into(), sides: sides.map(str::to_owned), rows, columns, values }
    }

    pub(super) fn corner(&self) -> String {
        self.sides.join(" / ")
    }

    /// The largest value of every row.
    pub(super) fn in_words(&self) -> String {
        let largest = |(name, values): (&String, &Vec<f64>)| {
            let known = values.iter().zip(&self.columns).filter(|(value, _)| value.is_finite());
            let (value, column) = known.max_by(|a, b| a.0.total_cmp(b.0))?;
            Some(format!("{name}: {column} {}", typeset(&number(*value))))
        };
        let texts: Vec<String> = self.rows.iter().zip(&self.values).take(12).filter_map(largest).collect();
        format!("{}, the largest of each row: {}.", self.what, texts.join(", "))
    }

    pub(super) fn draw(&self, mut canvas: Canvas) -> Canvas {
        let widest = self.rows.iter().map(|name| width_of(name)).fold(INDENT, f64::max).min(NAME);
        let left = widest + 10.0;
        let width = ((canvas.width - left) / self.columns.len().max(1) as f64).min(72.0);
        let top = 2.0 * LINE + 8.0;
        canvas.label(
            "start",
            [0.0, LINE - 2.0],
            &format!("{} \u{2193}  {} \u{2192}", self.sides[0], self.sides[1]),
            canvas.width,
        );
        for (column, name) in self.columns.iter().enumerate() {
            canvas.label("middle", [left + (column as f64 + 0.5) * width, top - 6.0], name, width);
        }
        for (row, (name, values)) in self.rows.iter().zip(&self.values).enumerate() {
            let y = top + CELL * row as f64;
            canvas.label("end", [left - 8.0, y + 0.5 * CELL + 4.0], name, NAME);
            for (column, &value) in values.iter().enumerate().filter(|(_, value)| **value > 0.0) {
                cell(&mut canvas, [left + column as f64 * width, y], width, value);
            }
        }
        canvas.height = top + CELL * self.rows.len() as f64 + 4.0;
        canvas
    }
}

fn cell(canvas: &mut Canvas, [x, y]: [f64; 2], width: f64, value: f64) {
    let opacity = format!("{:.3}", DARKEST * value.clamp(0.0, 1.0));
    let rect = Element::new("rect").class("cell").with("fill-opacity", opacity);
    canvas.add(rect.at("x", x + 0.5).at("y", y + 0.5).at("width", (width - 1.0).max(0.5)).at("height", CELL - 1.0));
    let text = if value < 5e-4 { "<.001".to_owned() } else { format!("{value:.3}") };
    let text = text.strip_prefix('0').filter(|rest| rest.starts_with('.')).unwrap_or(&text).to_owned();
    if fitting(&text, width) == text {
        canvas.text("cellnumber", "middle", [x + 0.5 * width, y + 0.5 * CELL + 4.0], &text);
    }
}
