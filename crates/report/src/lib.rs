//! One page that shows a result: sentences, tables, typeset equations and figures, as self-contained HTML and SVG.
//!
//! This crate knows nothing of logs and models: it takes a [`Page`] of plain data and gives its text. The page needs no
//! network and no script. It is light or dark by its reader's system, fits a telephone and a sheet of paper, and every
//! figure has a caption, a text alternative and the table of its data. A page is as long as its data, so its maker bins
//! data that grow with the rows.
//!
//! ```
//! use fleetfoot_report::{Axis, Chart, Figure, Lines, Page, Part, Section, Series};
//!
//! let time: Vec<f64> = (0..50).map(|k| 0.1 * f64::from(k)).collect();
//! let decay = Series::line("measured", time.clone(), time.iter().map(|t| (-t).exp()).collect());
//! let chart = Chart::Lines(Lines::new(Axis::of("time", "s"), Axis::of("speed", "m/s"), vec![decay]));
//! let figure = Figure::new("decay", "A body slows down", "Speed over time.", chart);
//! let section = Section::new("how-good", "How good it is", vec![Part::Figure(figure)]);
//! let page = Page::new("A result", "What was measured.", vec![section]);
//! assert!(page.to_html().starts_with("<!DOCTYPE html>"));
//! assert!(page.figures().next().unwrap().to_svg().starts_with("<svg"));
//! ```

mod bins;
mod figure;
mod html;
mod light;
mod markup;
mod page;
mod table;
pub mod words;

pub use bins::Bins;
pub use figure::{
    Axis, Bars, Chart, Figure, Interval, Lines, Map, Mark, Matrix, Panels, Scale, Series, Span, Spans, Stroke,
};
pub use light::Light;
pub use markup::Math;
pub use page::{Equation, Page, Part, Section, Sentence};
pub use table::{Cell, Table};
