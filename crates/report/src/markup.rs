//! Elements of HTML and SVG, which are always well formed and escaped.
//!
//! The output is HTML and XML at once (empty elements are closed in their tag or by an end tag). A test can therefore
//! read it with a strict parser, and a figure is the same text in a page and in a separate file.

use std::fmt::Write;

/// Elements of HTML that have no end.
const VOID: [&str; 4] = ["br", "col", "hr", "meta"];
/// Elements of SVG that end where they begin when nothing is in them.
const SHAPES: [&str; 4] = ["line", "rect", "path", "circle"];

/// An element with its attributes and its content.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Element {
    name: &'static str,
    attributes: Vec<(&'static str, String)>,
    children: Vec<Node>,
}

#[derive(Debug, Clone, PartialEq)]
enum Node {
    Element(Element),
    Text(String),
    /// Written as it stands: style sheets, and mathematics of [`Math`].
    Raw(String),
}

/// Presentation MathML, made by a printer that escapes: it is put into the page as it stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Math(String);

impl Math {
    /// The content of a `<math>` element. It must be well formed; `fleetfoot_library::Expr::to_mathml` is.
    pub fn new(content: impl Into<String>) -> Self {
        Self(content.into())
    }
}

impl Element {
    /// An empty element.
    pub(crate) fn new(name: &'static str) -> Self {
        Self { name, attributes: Vec::new(), children: Vec::new() }
    }

    /// With an attribute.
    pub(crate) fn with(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.attributes.push((name, value.into()));
        self
    }

    /// With an attribute that is a length or a place, in tenths of a pixel: more digits would only make the page longer.
    pub(crate) fn at(self, name: &'static str, value: f64) -> Self {
        self.with(name, place(value))
    }

    /// With a class.
    pub(crate) fn class(self, class: impl Into<String>) -> Self {
        self.with("class", class)
    }

    /// Appends a text.
    pub(crate) fn text(mut self, text: impl Into<String>) -> Self {
        self.children.push(Node::Text(text.into()));
        self
    }

    /// Appends an element.
    pub(crate) fn child(mut self, child: Element) -> Self {
        self.children.push(Node::Element(child));
        self
    }

    /// Appends elements.
    pub(crate) fn children(mut self, children: impl IntoIterator<Item = Element>) -> Self {
        self.children.extend(children.into_iter().map(Node::Element));
        self
    }

    /// Appends a formula.
    pub(crate) fn math(mut self, math: &Math) -> Self {
        self.children.push(Node::Raw(format!("<math>{}</math>", math.0)));
        self
    }

    /// With a style sheet, which has neither `<` nor `&`.
    pub(crate) fn style(mut self, sheet: &str) -> Self {
        self.children.push(Node::Raw(sheet.to_owned()));
        self
    }

    /// The text of the element.
    pub(crate) fn to_text(&self) -> String {
        let mut out = String::new();
        self.write(&mut out);
        out
    }

    fn write(&self, out: &mut String) {
        let _ = write!(out, "<{}", self.name);
        for (name, value) in &self.attributes {
            let _ = write!(out, " {name}=\"");
            escape(value, out);
            out.push('"');
        }
        if VOID.contains(&self.name) || (SHAPES.contains(&self.name) && self.children.is_empty()) {
            out.push_str("/>");
            return;
        }
        out.push('>');
        for child in &self.children {
            match child {
                Node::Element(element) => element.write(out),
                Node::Text(text) => escape(text, out),
                Node::Raw(raw) => out.push_str(raw),
            }
        }
        let _ = write!(out, "</{}>", self.name);
        if BLOCKS.contains(&self.name) {
            out.push('\n');
        }
    }
}

/// Elements that end a line, for those who read the source.
const BLOCKS: [&str; 16] = [
    "h1", "h2", "h3", "p", "tr", "table", "figure", "section", "details", "header", "footer", "nav", "li", "svg",
    "style", "div",
];

/// Writes text in which nothing is markup. Characters that XML forbids become the replacement character.
fn escape(text: &str, out: &mut String) {
    for c in text.chars() {
        match c {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            '"' => out.push_str("&quot;"),
            '\t' | '\n' => out.push(c),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
}

/// The data of a path through places: each place is relative to the one before, which is half as long as absolute
/// places.
pub(crate) fn trace(points: &[[f64; 2]], closed: bool) -> String {
    // From rounded place to rounded place, so that rounding does not add up.
    let tenths = |value: f64| (10.0 * value).round() as i64;
    let mut out = String::new();
    let mut before = None;
    for &[x, y] in points {
        let [x, y] = [tenths(x), tenths(y)];
        match before.replace([x, y]) {
            None => coordinates(&mut out, "M", &[x, y]),
            Some([from_x, from_y]) => match [x - from_x, y - from_y] {
                [0, 0] => {}
                [0, up] => coordinates(&mut out, "v", &[up]),
                [across, 0] => coordinates(&mut out, "h", &[across]),
                step => coordinates(&mut out, "l", &step),
            },
        }
    }
    if closed {
        out.push('z');
    }
    out
}

/// A command with its numbers, tenths of a pixel; a sign or a letter parts as well as a space.
fn coordinates(out: &mut String, command: &str, numbers: &[i64]) {
    out.push_str(command);
    for (place, &number) in numbers.iter().enumerate() {
        let sign = if number < 0 { "-" } else { "" };
        let (whole, tenth) = (number.abs() / 10, number.abs() % 10);
        let whole = if whole == 0 && tenth != 0 { String::new() } else { whole.to_string() };
        let tenth = if tenth == 0 { String::new() } else { format!(".{tenth}") };
        let space = if place > 0 && number >= 0 { " " } else { "" };
        let _ = write!(out, "{space}{sign}{whole}{tenth}");
    }
}

/// Tenths of a pixel, without a tail of zeros and without a negative zero.
pub(crate) fn place(value: f64) -> String {
    let text = format!("{value:.1}");
    let text = text.strip_suffix(".0").unwrap_or(&text);
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::{Element, place, trace};

    #[test]
    fn text_and_attributes_are_escaped() {
        let element = Element::new("p").with("title", "\"a\" & <b>").text("<script>\u{0}alert(1)</script>");
        assert_eq!(
            element.to_text(),
            "<p title=\"&quot;a&quot; &amp; &lt;b&gt;\">&lt;script&gt;\u{fffd}alert(1)&lt;/script&gt;</p>\n"
        );
        assert_eq!(Element::new("br").to_text(), "<br/>");
    }

    #[test]
    fn traces_are_short_and_do_not_drift() {
        assert_eq!(trace(&[[1.0, 2.0], [3.55, 1.5], [3.55, 4.0], [3.0, 4.0]], true), "M1 2l2.6-.5v2.5h-.6z");
        assert_eq!(trace(&[[0.0, -0.01], [0.0, 0.0]], false), "M0 0");
        // A hundred steps of a third of a tenth end where their sum is.
        let steps: Vec<[f64; 2]> = (0..=100).map(|k| [f64::from(k) / 30.0, 0.0]).collect();
        let across: f64 =
            trace(&steps, false).split('h').skip(1).map(|step| step.parse::<f64>().expect("a number")).sum();
        assert!((across - 3.3).abs() < 1e-9, "{across}");
    }

    #[test]
    fn places_are_short() {
        for (value, text) in [(0.0, "0"), (-0.01, "0"), (12.0, "12"), (1.26, "1.3"), (-3.5, "-3.5")] {
            assert_eq!(place(value), text);
        }
    }
}
