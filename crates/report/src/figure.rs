//! Figures: chart, caption and text alternative.
//!
//! A figure is drawn as SVG in two widths, one for pages and paper and one for telephones, as text that shrinks with
//! its figure cannot be read. Colours are classes: the style sheet defines them for light and dark.

mod bars;
mod canvas;
mod data;
mod lines;
mod map;
mod matrix;
mod panels;
mod plain;
mod scale;
mod spans;

pub use bars::{Bars, Interval, Mark};
pub use lines::{Lines, Series, Stroke};
pub use map::Map;
pub use matrix::Matrix;
pub use panels::Panels;
pub use scale::{Axis, Scale};
pub use spans::{Span, Spans};

use crate::{Table, markup::Element};
use canvas::{Canvas, NARROW, WIDE};
use lines::Form;

/// Colours and strokes of figures, for the page and for figures in separate files.
pub(crate) const STYLE: &str = include_str!("figure.css");

/// A figure.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Figure {
    /// Its address on the page and the name of its file: letters, digits, hyphens.
    pub name: String,
    /// Its title.
    pub title: String,
    /// Caption: the content of the figure, in a sentence or two.
    pub caption: String,
    /// Chart of the figure.
    pub chart: Chart,
}

/// Chart of a figure.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Chart {
    /// Values over values.
    Lines(Lines),
    /// Values by name.
    Bars(Bars),
    /// When something was.
    Spans(Spans),
    /// Small charts of lines side by side.
    Panels(Panels),
    /// Values by two names.
    Matrix(Matrix),
    /// Values over a plane.
    Map(Map),
}

impl Figure {
    /// A figure.
    pub fn new(name: impl Into<String>, title: impl Into<String>, caption: impl Into<String>, chart: Chart) -> Self {
        Self { name: name.into(), title: title.into(), caption: caption.into(), chart }
    }

    /// The figure as a separate file, on light paper, in colours for programs without style variables.
    pub fn to_svg(&self) -> String {
        let style = Element::new("style").style(&plain::resolved(STYLE));
        self.drawn(WIDE, Some(style)).with("xmlns", "http://www.w3.org/2000/svg").to_text()
    }

    /// The numbers that are drawn, with all their digits, for other programs.
    pub fn to_csv(&self) -> String {
        self.table().to_csv()
    }

    /// The numbers that are drawn.
    pub fn table(&self) -> Table {
        match &self.chart {
            Chart::Lines(lines) => data::of_lines(lines),
            Chart::Bars(bars) => data::of_bars(bars),
            Chart::Spans(spans) => data::of_spans(spans),
            Chart::Panels(panels) => data::of_panels(panels),
            Chart::Matrix(matrix) => data::of_matrix(matrix),
            Chart::Map(map) => map.table(),
        }
    }

    fn drawn(&self, width: f64, style: Option<Element>) -> Element {
        // Identifiers are those of the page: both drawings of a figure stand in it.
        let canvas = Canvas::new(width, format!("{}-{}", self.name, if width == WIDE { "wide" } else { "narrow" }));
        let canvas = match &self.chart {
            Chart::Lines(lines) => lines.draw(canvas, Form::Whole),
            Chart::Bars(bars) => bars.draw(canvas),
            Chart::Spans(spans) => spans.draw(canvas),
            Chart::Panels(panels) => panels.draw(canvas),
            Chart::Matrix(matrix) => matrix.draw(canvas),
            Chart::Map(map) => map.draw(canvas),
        };
        canvas.finish(&self.title, &self.alternative(), style)
    }

    /// Text in place of the figure, for readers who cannot see it.
    pub fn alternative(&self) -> String {
        let what = match &self.chart {
            Chart::Lines(lines) => lines.in_words(),
            Chart::Bars(bars) => bars.in_words(),
            Chart::Spans(spans) => spans.in_words(),
            Chart::Panels(panels) => panels.in_words(),
            Chart::Matrix(matrix) => matrix.in_words(),
            Chart::Map(map) => map.in_words(),
        };
        format!("{} {what}", self.caption)
    }

    /// The figure on a page.
    pub(crate) fn to_element(&self) -> Element {
        let drawing = |width, class| Element::new("div").class(class).child(self.drawn(width, None));
        let caption =
            Element::new("figcaption").child(Element::new("b").text(format!("{}. ", self.title))).text(&self.caption);
        let table = Element::new("details")
            .class("data")
            .child(Element::new("summary").text("Table of the figure\u{2019}s data"))
            .child(self.table().to_element());
        Element::new("figure").with("id", &self.name).children([
            drawing(WIDE, "wide"),
            drawing(NARROW, "narrow"),
            caption,
            table,
        ])
    }
}
