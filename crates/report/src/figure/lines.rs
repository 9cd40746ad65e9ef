//! Values over values: lines with bands, steps, and lines of reference.

use super::{
    canvas::{Canvas, Frame, LINE, Sample, colour, path_of, width_of},
    scale::{Axis, Ruler},
};
use crate::{
    markup::Element,
    words::{number, typeset},
};

/// A chart of lines.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Lines {
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The lines.
    pub series: Vec<Series>,
    /// Heights of lines of reference, with their words.
    pub levels: Vec<(f64, String)>,
}

/// A line.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Series {
    /// Its name.
    pub name: String,
    /// Places along the horizontal axis, rising.
    pub x: Vec<f64>,
    /// Values there; NaN breaks the line.
    pub y: Vec<f64>,
    /// Lower and upper ends of a band around it.
    pub band: Option<[Vec<f64>; 2]>,
    /// How it looks.
    pub stroke: Stroke,
}

/// How a line looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// In a colour of its own.
    Own,
    /// Grey and dashed: something to compare with.
    Reference,
    /// Dark: what was measured.
    Measured,
    /// Steps of equal width about the places.
    Steps,
}

impl Series {
    /// A line through places and values.
    pub fn line(name: impl Into<String>, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { name: name.into(), x, y, band: None, stroke: Stroke::Own }
    }

    /// With a band around it.
    pub fn banded(mut self, low: Vec<f64>, high: Vec<f64>) -> Self {
        self.band = Some([low, high]);
        self
    }

    /// That looks so.
    pub fn looks(mut self, stroke: Stroke) -> Self {
        self.stroke = stroke;
        self
    }
}

impl Lines {
    /// A chart of lines.
    pub fn new(x: Axis, y: Axis, series: Vec<Series>) -> Self {
        Self { x, y, series, levels: Vec::new() }
    }

    /// With a line of reference.
    pub fn level(mut self, height: f64, words: impl Into<String>) -> Self {
        self.levels.push((height, words.into()));
        self
    }

    /// Where the lines begin and end.
    pub(super) fn in_words(&self) -> String {
        let ends = |series: &Series| {
            let mut known = series.x.iter().zip(&series.y).filter(|(_, y)| y.is_finite());
            let first = known.clone().next()?;
            let last = known.next_back()?;
            let at = |(x, y): (&f64, &f64)| format!("{} at {}", typeset(&number(*y)), typeset(&number(*x)));
            Some(format!("{}: {} to {}", series.name, at(first), at(last)))
        };
        let ends: Vec<String> = self.series.iter().filter_map(ends).collect();
        format!("{} over {}. {}.", self.y.title(), self.x.title(), ends.join("; "))
    }

    fn heights(&self) -> impl Iterator<Item = f64> {
        let bands = self.series.iter().filter_map(|series| series.band.as_ref()).flatten().flatten();
        let values = self.series.iter().flat_map(|series| &series.y);
        values.chain(bands).copied().chain(self.levels.iter().map(|(height, _)| *height))
    }

    pub(super) fn draw(&self, mut canvas: Canvas) -> Canvas {
        let height = if canvas.is_wide() { 260.0 } else { 200.0 };
        let top = self.legend(&mut canvas) + 2.0 * LINE;
        let vertical = self.y.ruler(self.heights(), top + height, top);
        let ticks = vertical.ticks(5);
        let left = ticks.iter().map(|(_, label)| width_of(label)).fold(16.0, f64::max) + 10.0;
        let frame = Frame { left, right: canvas.width - 12.0, top, bottom: top + height };
        canvas.height = frame.bottom + 2.0 * LINE + 8.0;
        let mut places = self.series.iter().flat_map(|series| &series.x).copied();
        let across = self.x.ruler(places.by_ref(), frame.left, frame.right);
        canvas.label("start", [0.0, top - 10.0], &self.y.title(), canvas.width);
        for (value, label) in ticks {
            let Some(y) = vertical.at(value) else { continue };
            canvas.line("grid", [frame.left, y], [frame.right, y]);
            canvas.text("tick", "end", [frame.left - 6.0, y + 4.0], &label);
        }
        canvas.across(&across, &frame, &self.x.title());
        let clip = canvas.id("clip");
        let edge = Element::new("rect").at("x", frame.left).at("y", frame.top);
        let edge = edge.at("width", frame.right - frame.left).at("height", frame.bottom - frame.top);
        canvas.add(Element::new("clipPath").with("id", &clip).child(edge));
        let mut group = Element::new("g").with("clip-path", format!("url(#{clip})"));
        for (index, series) in self.series.iter().enumerate() {
            group = group.children(series.elements(&self.class(index), &across, &vertical));
        }
        canvas.add(group);
        for (height, words) in &self.levels {
            let Some(y) = vertical.at(*height) else { continue };
            canvas.line("level", [frame.left, y], [frame.right, y]);
            canvas.text("note", "end", [frame.right - 4.0, y - 4.0], words);
        }
        canvas
    }

    /// The class of a line: those in colours of their own are counted apart from the others.
    fn class(&self, index: usize) -> String {
        let before = |stroke: &[Stroke]| self.series[..index].iter().filter(|s| stroke.contains(&s.stroke)).count();
        match self.series[index].stroke {
            Stroke::Own | Stroke::Steps => {
                let own = before(&[Stroke::Own, Stroke::Steps]);
                format!("{} d{}", colour(own), own / 6 % 3)
            }
            Stroke::Reference => format!("reference r{}", before(&[Stroke::Reference]) % 3),
            Stroke::Measured => "measured".to_owned(),
        }
    }

    fn legend(&self, canvas: &mut Canvas) -> f64 {
        if self.series.len() < 2 {
            return 0.0;
        }
        let entry = |(index, series): (usize, &Series)| (Sample::Line, self.class(index), series.name.clone());
        let entries: Vec<_> = self.series.iter().enumerate().map(entry).collect();
        canvas.legend(&entries, 0.0)
    }
}

impl Series {
    fn elements(&self, class: &str, across: &Ruler, vertical: &Ruler) -> Vec<Element> {
        let mut elements = Vec::new();
        if let Some([low, high]) = &self.band {
            for part in runs(
                self.x
                    .iter()
                    .zip(low.iter().zip(high))
                    .map(|(&x, (&low, &high))| Some((across.at(x)?, vertical.at(low)?, vertical.at(high)?))),
            ) {
                let there = part.iter().map(|&(x, low, _)| [x, low]);
                let back = part.iter().rev().map(|&(x, _, high)| [x, high]);
                let points: Vec<[f64; 2]> = there.chain(back).collect();
                elements.push(Element::new("polygon").class(format!("band {class}")).with("points", path_of(&points)));
            }
        }
        for part in runs(self.points().map(|(x, y)| Some([across.at(x)?, vertical.at(y)?]))) {
            // One point alone has no line: it is a dot.
            elements.push(match part.as_slice() {
                [[x, y]] => Element::new("circle").class(format!("dot {class}")).at("cx", *x).at("cy", *y).at("r", 2.5),
                points => Element::new("polyline").class(format!("line {class}")).with("points", path_of(points)),
            });
        }
        elements
    }

    /// The points that are joined.
    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        let pairs = self.x.iter().copied().zip(self.y.iter().copied());
        let half = match (self.stroke, self.x.as_slice()) {
            (Stroke::Steps, [first, second, ..]) => 0.5 * (second - first),
            _ => 0.0,
        };
        let ends = if half > 0.0 { &[-1.0, 1.0][..] } else { &[0.0] };
        pairs.flat_map(move |(x, y)| ends.iter().map(move |end| (x + end * half, y)))
    }
}

/// Runs of what is there.
fn runs<T>(things: impl Iterator<Item = Option<T>>) -> Vec<Vec<T>> {
    let mut runs: Vec<Vec<T>> = vec![Vec::new()];
    for thing in things {
        match (thing, runs.last_mut()) {
            (Some(thing), Some(last)) => last.push(thing),
            (None, Some(last)) if !last.is_empty() => runs.push(Vec::new()),
            _ => {}
        }
    }
    runs.retain(|run| !run.is_empty());
    runs
}
