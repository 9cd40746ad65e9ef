//! When something was: rows of spans along one axis.

use super::{
    canvas::{Canvas, Frame, INDENT, LINE, Sample, width_of},
    scale::Axis,
};
use crate::{
    markup::Element,
    words::{number, typeset},
};

/// Rows of spans.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Spans {
    /// The axis along which they lie.
    pub axis: Axis,
    /// Kinds of spans: their index is the colour.
    pub kinds: Vec<String>,
    /// Names of the rows, from the top, with their spans.
    pub rows: Vec<(String, Vec<Span>)>,
}

/// A span.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Beginning of the span.
    pub from: f64,
    /// End of the span.
    pub to: f64,
    /// Index of its kind.
    pub kind: usize,
}

/// Height of a row, and of the bar in it.
const ROW: f64 = 20.0;
const BAR: f64 = 10.0;
/// A row's name has at most this much room.
const NAME: f64 = 200.0;

impl Spans {
    /// Rows of spans.
    pub fn new(axis: Axis, kinds: Vec<String>, rows: Vec<(String, Vec<Span>)>) -> Self {
        Self { axis, kinds, rows }
    }

    pub(super) fn in_words(&self) -> String {
        let of = |(name, spans): &(String, Vec<Span>)| {
            let total = |kind: usize| spans.iter().filter(|s| s.kind == kind).map(|s| s.to - s.from).sum::<f64>();
            let kinds = self.kinds.iter().enumerate().filter(|(kind, _)| spans.iter().any(|span| span.kind == *kind));
            let lengths = kinds.map(|(kind, what)| format!("{what} {}", typeset(&number(total(kind)))));
            format!("{name}: {}", lengths.collect::<Vec<_>>().join(", "))
        };
        let texts: Vec<String> = self.rows.iter().take(12).map(of).collect();
        format!("{} rows along {}, their lengths: {}.", self.rows.len(), self.axis.title(), texts.join("; "))
    }

    pub(super) fn draw(&self, mut canvas: Canvas) -> Canvas {
        let is_there = |kind: usize| self.rows.iter().flat_map(|(_, spans)| spans).any(|span| span.kind == kind);
        let kinds = self.kinds.iter().enumerate().filter(|(kind, _)| is_there(*kind));
        let entries: Vec<_> = kinds.map(|(kind, name)| (Sample::Box, format!("k{kind}"), name.clone())).collect();
        let top = if entries.len() < 2 { 0.0 } else { canvas.legend(&entries, 0.0) } + 6.0;
        let beside = canvas.is_wide();
        let widest = self.rows.iter().map(|(name, _)| width_of(name)).fold(0.0, f64::max).min(NAME);
        let left = if beside { widest + 12.0 } else { INDENT };
        let one = if beside { ROW } else { ROW + LINE };
        let frame = Frame { left, right: canvas.width - 12.0, top, bottom: top + one * self.rows.len() as f64 + 4.0 };
        canvas.height = frame.bottom + 2.0 * LINE + 8.0;
        let ends = self.rows.iter().flat_map(|(_, spans)| spans).flat_map(|span| [span.from, span.to]);
        let ruler = self.axis.ruler(ends, frame.left, frame.right);
        canvas.across(&ruler, &frame, &self.axis.title());
        for (row, (name, spans)) in self.rows.iter().enumerate() {
            let y = frame.top + one * row as f64;
            let middle = y + one - 0.5 * ROW;
            if beside {
                canvas.label("end", [left - 10.0, middle + 4.0], name, NAME);
            } else {
                canvas.label("start", [0.0, y + LINE - 2.0], name, canvas.width);
            }
            for span in spans {
                let (Some(from), Some(to)) = (ruler.at(span.from), ruler.at(span.to)) else { continue };
                canvas.add(
                    Element::new("rect")
                        .class(format!("bar k{}", span.kind))
                        .at("x", from)
                        .at("y", middle - 0.5 * BAR)
                        .at("width", (to - from).max(1.0))
                        .at("height", BAR),
                );
            }
        }
        canvas
    }
}
