//! Values over values: lines with bands, steps, and lines of reference.

use super::{
    canvas::{Canvas, Frame, LINE, Sample, colour, diamond, width_of},
    scale::{Axis, Ruler, Scale, extent},
};
use crate::{
    markup::{Element, trace},
    words::{number, typeset},
};

/// Of a band on a logarithmic axis that much below the least value of a line is shown, as a factor.
const FAR: f64 = 3.0;

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
    /// A place along the horizontal axis that is marked by an upright line, with its words.
    pub upright: Option<(f64, String)>,
    /// A range along the horizontal axis that is shaded, with its words.
    pub range: Option<([f64; 2], String)>,
}

/// Extent of a drawn chart of lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// All of it.
    Whole,
    /// One of several that share a legend and, by the caption, a vertical axis: its horizontal axis is its title.
    Panel,
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
    /// Stroke of the line.
    pub stroke: Stroke,
}

/// Stroke of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// In a separate colour.
    Coloured,
    /// Grey and dashed: something to compare with.
    Reference,
    /// Dark: measurements.
    Measured,
    /// Steps of equal width about the places.
    Steps,
    /// Such steps, and the area between them and zero.
    Area,
    /// Marks at the places, in the colour of the line before it.
    Marks,
    /// The same, hollow.
    HollowMarks,
}

impl Series {
    /// A line through places and values.
    pub fn line(name: impl Into<String>, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { name: name.into(), x, y, band: None, stroke: Stroke::Coloured }
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
        Self { x, y, series, levels: Vec::new(), upright: None, range: None }
    }

    /// With a line of reference.
    pub fn level(mut self, height: f64, words: impl Into<String>) -> Self {
        self.levels.push((height, words.into()));
        self
    }

    /// With an upright line at a place along the horizontal axis.
    pub fn marked(mut self, place: f64, words: impl Into<String>) -> Self {
        self.upright = Some((place, words.into()));
        self
    }

    /// With a shaded range along the horizontal axis.
    pub fn shaded(mut self, range: [f64; 2], words: impl Into<String>) -> Self {
        self.range = Some((range, words.into()));
        self
    }

    /// Beginnings and ends of the lines, in words.
    pub(super) fn in_words(&self) -> String {
        let ends = |series: &Series| {
            if series.is_marks() {
                let places = series.x.iter().zip(&series.y).filter(|(_, y)| y.is_finite());
                let places: Vec<String> = places.map(|(x, _)| typeset(&number(*x))).collect();
                return Some(format!("{}: at {}", series.name, places.join(", ")));
            }
            let mut known = series.x.iter().zip(&series.y).filter(|(_, y)| y.is_finite());
            let first = known.clone().next()?;
            let last = known.next_back()?;
            let at = |(x, y): (&f64, &f64)| format!("{} at {}", typeset(&number(*y)), typeset(&number(*x)));
            Some(format!("{}: {} to {}", series.name, at(first), at(last)))
        };
        let ends: Vec<String> = self.series.iter().filter_map(ends).collect();
        let at = |value: &f64| typeset(&number(*value));
        let range = self.range.iter().map(|([from, to], words)| format!(" {words}: {} to {}.", at(from), at(to)));
        let range: String = range.collect();
        let mark = self.upright.iter().map(|(place, words)| format!(" {words}: {}.", at(place)));
        let range = range + &mark.collect::<String>();
        format!("{} over {}. {}.{range}", self.y.title(), self.x.title(), ends.join("; "))
    }

    pub(super) fn heights(&self) -> impl Iterator<Item = f64> {
        let bands = self.series.iter().filter_map(|series| series.band.as_ref()).flatten().flatten();
        let values = self.series.iter().flat_map(|series| &series.y);
        // Of bands that reach to zero a logarithmic axis shows what is near the lines.
        let [least, _] = extent(self.series.iter().flat_map(|series| &series.y).copied().filter(|value| *value > 0.0));
        let far = if self.y.scale == Scale::Logarithmic { least / FAR } else { f64::NEG_INFINITY };
        let bands = bands.filter(move |value| **value >= far);
        values.chain(bands).copied().chain(self.levels.iter().map(|(height, _)| *height))
    }

    pub(super) fn draw(&self, mut canvas: Canvas, form: Form) -> Canvas {
        let panel = form == Form::Panel;
        let height = if panel {
            110.0
        } else if canvas.is_wide() {
            260.0
        } else {
            200.0
        };
        let legend = if panel { 0.0 } else { canvas.legend(&self.entries(), 0.0) };
        let top = legend + if panel { LINE + 8.0 } else { 2.0 * LINE };
        let vertical = self.y.ruler(self.heights(), top + height, top);
        let ticks = vertical.ticks(if panel { 4 } else { 5 });
        let left = ticks.iter().map(|(_, label)| width_of(label)).fold(16.0, f64::max) + 10.0;
        let frame = Frame { left, right: canvas.width - 12.0, top, bottom: top + height };
        let places = self.series.iter().flat_map(|series| series.stepped(series.y.iter()).map(|(x, _)| x));
        let across = self.x.ruler(places, frame.left, frame.right);
        canvas.height = frame.bottom + if panel { LINE + 6.0 } else { 2.0 * LINE + 8.0 };
        if panel {
            canvas.label("start", [0.0, LINE - 2.0], &self.x.title(), canvas.width - 8.0);
        } else {
            canvas.label("start", [0.0, top - 10.0], &self.y.title(), canvas.width);
        }
        canvas.up(&vertical, &frame, if panel { 4 } else { 5 }, [frame.left, frame.right]);
        canvas.across(&across, &frame, &if panel { String::new() } else { self.x.title() });
        self.curves(&mut canvas, &frame, &across, &vertical);
        for (height, words) in &self.levels {
            let Some(y) = vertical.at(*height) else { continue };
            canvas.line("level", [frame.left, y], [frame.right, y]);
            canvas.text("note", "end", [frame.right - 4.0, y - 4.0], words);
        }
        if let Some((place, words)) = &self.upright
            && let Some(x) = across.at(*place).filter(|x| (frame.left..=frame.right).contains(x))
        {
            let beside = if x < 0.6 * frame.right { ("start", x + 5.0) } else { ("end", x - 5.0) };
            canvas.line("level", [x, frame.top], [x, frame.bottom]);
            canvas.text("note", beside.0, [beside.1, frame.top + 11.0], words);
        }
        canvas
    }

    /// Draws the curves within the frame, and cuts them at its edges.
    fn curves(&self, canvas: &mut Canvas, frame: &Frame, across: &Ruler, vertical: &Ruler) {
        let clip = canvas.id("clip");
        let edge = Element::new("rect").at("x", frame.left).at("y", frame.top);
        let edge = edge.at("width", frame.right - frame.left).at("height", frame.bottom - frame.top);
        canvas.add(Element::new("clipPath").with("id", &clip).child(edge));
        let mut group = Element::new("g").with("clip-path", format!("url(#{clip})"));
        if let Some(([from, to], _)) = &self.range
            && let (Some(from), Some(to)) = (across.at(*from), across.at(*to))
        {
            let shade = Element::new("rect").class("range").at("x", from).at("y", frame.top);
            group = group.child(shade.at("width", (to - from).max(1.0)).at("height", frame.bottom - frame.top));
        }
        // Marks lie over all lines.
        let (marks, lines): (Vec<usize>, Vec<usize>) =
            (0..self.series.len()).partition(|&index| self.series[index].is_marks());
        for index in lines.into_iter().chain(marks) {
            group = group.children(self.series[index].elements(&self.class(index), across, vertical));
        }
        canvas.add(group);
    }

    /// The class of a line; lines in separate colours are counted apart from the others.
    fn class(&self, index: usize) -> String {
        let before = |stroke: &[Stroke]| self.series[..index].iter().filter(|s| stroke.contains(&s.stroke)).count();
        match self.series[index].stroke {
            Stroke::Coloured | Stroke::Steps | Stroke::Area => {
                let hue = before(&[Stroke::Coloured, Stroke::Steps, Stroke::Area]);
                format!("{} d{}", colour(hue), hue / 6 % 3)
            }
            Stroke::Reference => format!("reference r{}", before(&[Stroke::Reference]) % 3),
            Stroke::Measured => "measured".to_owned(),
            Stroke::Marks | Stroke::HollowMarks => {
                let hue = before(&[Stroke::Coloured, Stroke::Steps, Stroke::Area]).max(1) - 1;
                format!("{} r{}", colour(hue), u8::from(self.series[index].stroke == Stroke::HollowMarks))
            }
        }
    }

    /// Entries of the legend; empty for a single series.
    pub(super) fn entries(&self) -> Vec<(Sample, String, String)> {
        let sample = |series: &Series| if series.is_marks() { Sample::Mark } else { Sample::Line };
        let entry = |(index, series): (usize, &Series)| (sample(series), self.class(index), series.name.clone());
        let shade = self.range.iter().map(|(_, words)| (Sample::Box, "range".to_owned(), words.clone()));
        let entries: Vec<_> = self.series.iter().enumerate().map(entry).chain(shade).collect();
        if entries.len() < 2 { Vec::new() } else { entries }
    }
}

impl Series {
    fn is_marks(&self) -> bool {
        matches!(self.stroke, Stroke::Marks | Stroke::HollowMarks)
    }

    fn elements(&self, class: &str, across: &Ruler, vertical: &Ruler) -> Vec<Element> {
        let mut elements = Vec::new();
        if self.is_marks() {
            let places = self.x.iter().zip(&self.y).filter_map(|(&x, &y)| Some([across.at(x)?, vertical.at(y)?]));
            return places.map(|place| diamond(class, place)).collect();
        }
        if let Some([low, high]) = &self.band {
            let ends = self.stepped(low.iter().copied().zip(high.iter().copied()));
            // Values that are not above zero lie below all of a logarithmic axis.
            let low_end = |low: f64| vertical.at(low).or((low <= 0.0).then_some(vertical.from));
            for part in runs(ends.map(|(x, (low, high))| Some((across.at(x)?, low_end(low)?, vertical.at(high)?)))) {
                let there = part.iter().map(|&(x, low, _)| [x, low]);
                let back = part.iter().rev().map(|&(x, _, high)| [x, high]);
                let points: Vec<[f64; 2]> = there.chain(back).collect();
                elements.push(Element::new("path").class(format!("band {class}")).with("d", trace(&points, true)));
            }
        }
        let points = self.stepped(self.y.iter().copied());
        for part in runs(points.map(|(x, y)| Some([across.at(x)?, vertical.at(y)?]))) {
            // One point alone has no line: it is a dot.
            elements.push(match part.as_slice() {
                [first, .., last] if self.stroke == Stroke::Area => {
                    let zero = vertical.at(0.0).unwrap_or(vertical.from);
                    let points = [&[[first[0], zero]], part.as_slice(), &[[last[0], zero]]].concat();
                    Element::new("path").class(format!("area {class}")).with("d", trace(&points, true))
                }
                [[x, y]] => Element::new("circle").class(format!("dot {class}")).at("cx", *x).at("cy", *y).at("r", 2.5),
                points => Element::new("path").class(format!("line {class}")).with("d", trace(points, false)),
            });
        }
        elements
    }

    /// Values at the places where they are drawn: of steps at both ends of each.
    fn stepped<T: Copy>(&self, values: impl Iterator<Item = T>) -> impl Iterator<Item = (f64, T)> {
        let half = match (self.stroke, self.x.as_slice()) {
            (Stroke::Steps | Stroke::Area, [first, second, ..]) => 0.5 * (second - first),
            _ => 0.0,
        };
        let ends = if half > 0.0 { &[-1.0, 1.0][..] } else { &[0.0] };
        self.x.iter().zip(values).flat_map(move |(&x, value)| ends.iter().map(move |end| (x + end * half, value)))
    }
}

/// Runs of present values.
fn runs<T>(points: impl Iterator<Item = Option<T>>) -> Vec<Vec<T>> {
    let mut runs: Vec<Vec<T>> = vec![Vec::new()];
    for point in points {
        match (point, runs.last_mut()) {
            (Some(point), Some(last)) => last.push(point),
            (None, Some(last)) if !last.is_empty() => runs.push(Vec::new()),
            _ => {}
        }
    }
    runs.retain(|run| !run.is_empty());
    runs
}
