//! Common parts of all charts: the drawing, its frame, its axes and its legend.

use super::scale::Ruler;
use crate::markup::{Element, trace};

/// Width of a drawing for pages and paper, pixels.
pub(crate) const WIDE: f64 = 720.0;
/// Width of a drawing for telephones, pixels.
pub(crate) const NARROW: f64 = 340.0;
/// Height of a line of text, pixels.
pub(crate) const LINE: f64 = 16.0;
/// Room for the first number of an axis where no names stand before it.
pub(crate) const INDENT: f64 = 14.0;
/// Width of a character, pixels; names are measured by it, as a drawing does not know its reader's fonts.
const CHARACTER: f64 = 7.2;
/// Length of a sample of a line in the legend.
const SAMPLE: f64 = 22.0;

/// A drawing under construction.
pub(crate) struct Canvas {
    pub(crate) width: f64,
    pub(crate) height: f64,
    /// Its name among the drawings of a page.
    name: String,
    parts: Vec<Element>,
}

/// The edges of a plot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    pub(crate) left: f64,
    pub(crate) right: f64,
    pub(crate) top: f64,
    pub(crate) bottom: f64,
}

/// Sample of a series in the legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sample {
    Line,
    Box,
    Mark,
}

/// The width of a text, pixels, about.
pub(crate) fn width_of(text: &str) -> f64 {
    text.chars().count() as f64 * CHARACTER
}

/// A text that fits into a width; a cut text ends in dots.
pub(crate) fn fitting(text: &str, width: f64) -> String {
    let most = (width / CHARACTER).max(3.0) as usize;
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most - 1).chain(['…']).collect()
}

/// A text of a class; where it stands is one too, but for its start, which is where texts stand.
fn anchored(class: &str, anchor: &str) -> Element {
    Element::new("text").class(if anchor == "start" { class.to_owned() } else { format!("{class} {anchor}") })
}

fn polygon(class: &str, points: &[[f64; 2]]) -> Element {
    Element::new("path").class(class).with("d", trace(points, true))
}

/// A mark at a place.
pub(crate) fn diamond(class: &str, [x, y]: [f64; 2]) -> Element {
    polygon(&format!("mark {class}"), &[[x, y - 4.5], [x + 4.5, y], [x, y + 4.5], [x - 4.5, y]])
}

/// The class of the colour of a series.
pub(crate) fn colour(index: usize) -> String {
    format!("s{}", index % 6)
}

impl Canvas {
    pub(crate) fn new(width: f64, name: String) -> Self {
        Self { width, height: 0.0, name, parts: Vec::new() }
    }

    pub(crate) fn is_wide(&self) -> bool {
        self.width >= WIDE
    }

    /// An identifier on the page.
    pub(crate) fn id(&self, what: &str) -> String {
        format!("{}-{what}", self.name)
    }

    pub(crate) fn add(&mut self, part: Element) {
        self.parts.push(part);
    }

    /// A line from one place to another.
    pub(crate) fn line(&mut self, class: &str, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2]) {
        self.add(Element::new("line").class(class).at("x1", x1).at("y1", y1).at("x2", x2).at("y2", y2));
    }

    /// Text at a place; `anchor` is `start`, `middle` or `end`.
    pub(crate) fn text(&mut self, class: &str, anchor: &str, [x, y]: [f64; 2], text: &str) {
        self.add(anchored(class, anchor).at("x", x).at("y", y).text(text));
    }

    /// Text that is cut to a width; the whole of it is its title.
    pub(crate) fn label(&mut self, anchor: &str, place: [f64; 2], text: &str, width: f64) {
        let shown = fitting(text, width);
        let element = anchored("name", anchor).at("x", place[0]).at("y", place[1]).text(&shown);
        self.add(if shown == text { element } else { element.child(Element::new("title").text(text)) });
    }

    /// Names and samples in rows from the top; gives where they end.
    pub(crate) fn legend(&mut self, entries: &[(Sample, String, String)], left: f64) -> f64 {
        let (mut x, mut y) = (left, LINE);
        for (sample, class, name) in entries {
            let name = fitting(name, self.width - left - SAMPLE - 8.0);
            let needed = SAMPLE + 6.0 + width_of(&name) + 16.0;
            if x > left && x + needed - 16.0 > self.width {
                (x, y) = (left, y + LINE + 2.0);
            }
            self.sample(*sample, class, x, y);
            self.text("key", "start", [x + SAMPLE + 6.0, y], &name);
            x += needed;
        }
        if entries.is_empty() { 0.0 } else { y + 6.0 }
    }

    fn sample(&mut self, sample: Sample, class: &str, x: f64, y: f64) {
        let middle = y - 4.0;
        match sample {
            Sample::Line => self.line(&format!("line {class}"), [x, middle], [x + SAMPLE, middle]),
            Sample::Box => self.add(
                Element::new("rect")
                    .class(if class.starts_with("cell") { class.to_owned() } else { format!("bar {class}") })
                    .at("x", x + 4.0)
                    .at("y", middle - 5.0)
                    .at("width", SAMPLE - 8.0)
                    .at("height", 10.0),
            ),
            Sample::Mark => self.diamond(class, [x + SAMPLE / 2.0, middle]),
        }
    }

    /// A mark at a place.
    pub(crate) fn diamond(&mut self, class: &str, place: [f64; 2]) {
        self.add(diamond(class, place));
    }

    /// A mark at the end of an axis for values beyond it.
    pub(crate) fn beyond(&mut self, class: &str, [x, y]: [f64; 2]) {
        self.add(polygon(&format!("mark {class}"), &[[x - 3.0, y - 4.5], [x + 4.0, y], [x - 3.0, y + 4.5]]));
    }

    /// The horizontal axis under a frame: grid, numbers, title.
    pub(crate) fn across(&mut self, ruler: &Ruler, frame: &Frame, title: &str) {
        let most = if self.is_wide() {
            8
        } else if self.width >= NARROW {
            4
        } else {
            2
        };
        let mut grid = String::new();
        for (value, label) in ruler.ticks(most) {
            let Some(x) = ruler.at(value) else { continue };
            grid.push_str(&trace(&[[x, frame.top], [x, frame.bottom]], false));
            self.text("tick", "middle", [x, frame.bottom + LINE], &label);
        }
        self.add(Element::new("path").class("grid").with("d", grid));
        self.line("axis", [frame.left, frame.bottom], [frame.right, frame.bottom]);
        if !title.is_empty() {
            let title = fitting(title, frame.right);
            self.text("title", "end", [frame.right, frame.bottom + 2.0 * LINE + 2.0], &title);
        }
    }

    /// The vertical axis beside a frame: grid from one place across to another, numbers.
    pub(crate) fn up(&mut self, ruler: &Ruler, frame: &Frame, most: usize, [from, to]: [f64; 2]) {
        let mut grid = String::new();
        for (value, label) in ruler.ticks(most) {
            let Some(y) = ruler.at(value) else { continue };
            grid.push_str(&trace(&[[from, y], [to, y]], false));
            self.text("tick", "end", [frame.left - 6.0, y + 4.0], &label);
        }
        self.add(Element::new("path").class("grid").with("d", grid));
    }

    /// A separate drawing within this one.
    pub(crate) fn part(&self, index: usize, width: f64) -> Self {
        Self::new(width, self.id(&(index + 1).to_string()))
    }

    /// Puts a part at a place.
    pub(crate) fn place(&mut self, part: Self, [x, y]: [f64; 2]) {
        let (x, y) = (crate::markup::place(x), crate::markup::place(y));
        self.add(Element::new("g").with("transform", format!("translate({x} {y})")).children(part.parts));
    }

    /// The drawing as an element.
    pub(crate) fn finish(self, title: &str, alternative: &str, style: Option<Element>) -> Element {
        let (title_id, words_id) = (self.id("title"), self.id("words"));
        Element::new("svg")
            .class("figure")
            .with("viewBox", format!("0 0 {} {}", crate::markup::place(self.width), crate::markup::place(self.height)))
            .at("width", self.width)
            .at("height", self.height)
            .with("role", "img")
            .with("aria-labelledby", format!("{title_id} {words_id}"))
            .child(Element::new("title").with("id", title_id).text(title))
            .child(Element::new("desc").with("id", words_id).text(alternative))
            .children(style)
            .children(self.parts)
    }
}
