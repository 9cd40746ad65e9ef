//! A strict reader of markup. Every element has an end tag, every attribute is quoted and stands once, every identifier
//! is there once, and nothing but known entities is escaped.

use std::collections::BTreeSet;

/// Parts of a page.
#[derive(Debug, Default)]
pub(crate) struct PageContent {
    /// Names of the elements, in order.
    pub(crate) elements: Vec<String>,
    /// Text outside of tags, entities resolved.
    pub(crate) text: String,
    /// Identifiers.
    pub(crate) ids: BTreeSet<String>,
    /// References to identifiers.
    pub(crate) references: Vec<String>,
    /// Values of attributes.
    pub(crate) values: Vec<(String, String)>,
}

/// Elements that may end where they begin: in HTML those without an end, and those of SVG and MathML.
const CLOSED: [&str; 7] = ["meta", "line", "rect", "path", "circle", "mspace", "br"];

/// Reads a page; panics with the place of an error.
pub(crate) fn read(page: &str) -> PageContent {
    let mut document = PageContent::default();
    let mut open: Vec<String> = Vec::new();
    let mut rest = page.strip_prefix("<!DOCTYPE html>").unwrap_or(page);
    while let Some(at) = rest.find('<') {
        document.text.push_str(&resolved(&rest[..at]));
        rest = &rest[at + 1..];
        let end = end_of_tag(rest);
        let tag = &rest[..end];
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop().as_deref(), Some(name), "</{name}> closes something else");
            continue;
        }
        let (tag, closed) = tag.strip_suffix('/').map_or((tag, false), |tag| (tag, true));
        let (name, attributes) = tag.split_once(' ').unwrap_or((tag, ""));
        assert!(name.bytes().all(|c| c.is_ascii_alphanumeric()) && !name.is_empty(), "<{tag}>");
        self::attributes(attributes, tag, &mut document);
        document.elements.push(name.to_owned());
        assert!(!closed || CLOSED.contains(&name), "<{tag}/> is no end in HTML");
        if !closed {
            open.push(name.to_owned());
        }
        if name == "style" {
            let end = rest.find("</style>").expect("a style sheet ends");
            assert!(!rest[..end].contains(['<', '&']), "a style sheet with markup");
            rest = &rest[end..];
        }
    }
    document.text.push_str(&resolved(rest));
    assert!(open.is_empty(), "not closed: {open:?}");
    for reference in &document.references {
        assert!(document.ids.contains(reference), "nothing is called {reference}");
    }
    document
}

/// The end of a tag: a `>` that no quotes hold.
fn end_of_tag(rest: &str) -> usize {
    let mut quoted = false;
    let end = rest.char_indices().find(|(_, c)| {
        quoted ^= *c == '"';
        *c == '>' && !quoted
    });
    end.expect("a tag ends").0
}

fn attributes(text: &str, tag: &str, document: &mut PageContent) {
    let (mut rest, mut seen) = (text.trim(), BTreeSet::new());
    while !rest.is_empty() {
        let (name, behind) = rest.split_once("=\"").unwrap_or_else(|| panic!("<{tag}>: not quoted"));
        let (value, behind) = behind.split_once('"').unwrap_or_else(|| panic!("<{tag}>: not closed"));
        assert!(name.bytes().all(|c| c.is_ascii_alphanumeric() || c == b'-' || c == b':'), "<{tag}>: {name}");
        assert!(seen.insert(name) && !value.contains('<'), "<{tag}>: {name}");
        let value = resolved(value);
        match name {
            "id" => assert!(document.ids.insert(value.clone()), "{value} is there twice"),
            "aria-labelledby" => document.references.extend(value.split(' ').map(str::to_owned)),
            "href" => document.references.push(value.strip_prefix('#').expect("a link within the page").to_owned()),
            "clip-path" => {
                let target = value.strip_prefix("url(#").and_then(|value| value.strip_suffix(')'));
                document.references.push(target.expect("a clip within the page").to_owned());
            }
            _ => {}
        }
        document.values.push((name.to_owned(), value));
        rest = behind.trim_start();
    }
}

fn resolved(text: &str) -> String {
    let mut out = String::new();
    let mut parts = text.split('&');
    out.push_str(parts.next().unwrap_or_default());
    for part in parts {
        let (entity, behind) = part.split_once(';').expect("an entity ends");
        out.push(match entity {
            "lt" => '<',
            "gt" => '>',
            "amp" => '&',
            "quot" => '"',
            other => panic!("&{other};"),
        });
        out.push_str(behind);
    }
    assert!(!out.chars().any(|c| c.is_control() && c != '\n' && c != '\t'), "a control character");
    out
}
