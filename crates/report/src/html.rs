//! The page as HTML.

use crate::{Equation, Page, Part, Section, Sentence, figure, markup::Element};

const STYLE: &str = include_str!("page.css");

impl Page {
    /// The page as HTML.
    pub fn to_html(&self) -> String {
        document(self)
    }
}

/// The whole document.
fn document(page: &Page) -> String {
    let meta = |name, content| Element::new("meta").with("name", name).with("content", content);
    let head = Element::new("head")
        .child(Element::new("meta").with("charset", "utf-8"))
        .child(meta("viewport", "width=device-width, initial-scale=1"))
        .child(meta("color-scheme", "light dark"))
        .child(Element::new("title").text(&page.title))
        .child(Element::new("style").style(STYLE).style(figure::STYLE));
    let header = Element::new("header")
        .child(Element::new("h1").text(&page.title))
        .child(Element::new("p").class("lead").text(&page.lead))
        .child(contents(page));
    let source = page.source.iter().map(|line| Element::new("p").text(line));
    let body = Element::new("body")
        .child(header)
        .child(Element::new("main").children(page.sections.iter().map(section)))
        .child(Element::new("footer").children(source));
    let html = Element::new("html").with("lang", "en").child(head).child(body);
    format!("<!DOCTYPE html>\n{}\n", html.to_text())
}

fn contents(page: &Page) -> Element {
    let link = |section: &Section| {
        let link = Element::new("a").with("href", format!("#{}", section.id)).text(&section.title);
        Element::new("li").child(link)
    };
    let list = Element::new("ul").children(page.sections.iter().map(link));
    Element::new("nav").with("aria-label", "Sections").child(list)
}

fn section(section: &Section) -> Element {
    let heading = Element::new("h2").with("id", &section.id).text(&section.title);
    Element::new("section").with("aria-labelledby", &section.id).child(heading).children(section.parts.iter().map(part))
}

fn part(part: &Part) -> Element {
    match part {
        Part::Paragraph(text) => Element::new("p").text(text),
        Part::Heading(text) => Element::new("h3").text(text),
        Part::Findings(list) => Element::new("ul").class("findings").children(list.iter().map(finding)),
        Part::Table(table) => table.to_element(),
        Part::Figure(figure) => figure.to_element(),
        // A term may be wider than a telephone.
        Part::Equations(list) => Element::new("div")
            .class("scroll")
            .with("tabindex", "0")
            .with("role", "group")
            .with("aria-label", "Equations")
            .children(list.iter().map(equation)),
        Part::Fold(summary, parts) => {
            Element::new("details").child(Element::new("summary").text(summary)).children(parts.iter().map(self::part))
        }
    }
}

fn finding(sentence: &Sentence) -> Element {
    let light = sentence.light;
    let sign = Element::new("span").class("sign").with("aria-hidden", "true").text(light.sign());
    let word = Element::new("span").class("hidden").text(format!("{}: ", light.word()));
    let text = Element::new("div")
        .child(word)
        .child(Element::new("b").text(&sentence.head))
        .text(format!(" {}", sentence.text));
    Element::new("li").class(light.word()).child(sign).child(text)
}

fn equation(equation: &Equation) -> Element {
    let mut line = Element::new("div").class("equation");
    for piece in &equation.pieces {
        // A space of no width: the operators have spaces of their own, and a line may break there.
        line = line.math(piece).text("\u{200b}");
    }
    if equation.note.is_empty() { line } else { line.child(Element::new("small").text(&equation.note)) }
}
