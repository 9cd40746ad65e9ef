//! Content of a page.

use crate::{Figure, Light, Math, Table};

/// A page: its head, and its sections.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Page {
    /// The title.
    pub title: String,
    /// A sentence under it.
    pub lead: String,
    /// Program and models that made it, at its end.
    pub source: Vec<String>,
    /// The sections.
    pub sections: Vec<Section>,
}

/// A section with a heading.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Section {
    /// Its address on the page: letters, digits, hyphens.
    pub id: String,
    /// Its heading.
    pub title: String,
    /// Parts of the section.
    pub parts: Vec<Part>,
}

/// A part of a section.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[expect(clippy::large_enum_variant, reason = "a page has some dozens of them")]
pub enum Part {
    /// Sentences.
    Paragraph(String),
    /// Findings, each with a light.
    Findings(Vec<Sentence>),
    /// A heading within the section.
    Heading(String),
    /// A table.
    Table(Table),
    /// A figure.
    Figure(Figure),
    /// Equations, one below the other.
    Equations(Vec<Equation>),
    /// Parts that are folded away until one asks for them.
    Fold(String, Vec<Part>),
}

/// A finding.
#[derive(Debug, Clone, PartialEq)]
pub struct Sentence {
    /// Quality mark of the finding.
    pub light: Light,
    /// The finding, short.
    pub head: String,
    /// Explanation of the finding.
    pub text: String,
}

/// An equation as pieces between which a line may break: the left side, then a term each.
#[derive(Debug, Clone, PartialEq)]
pub struct Equation {
    /// The pieces.
    pub pieces: Vec<Math>,
    /// Note about the equation; empty without one.
    pub note: String,
}

impl Page {
    /// A page.
    pub fn new(title: impl Into<String>, lead: impl Into<String>, sections: Vec<Section>) -> Self {
        Self { title: title.into(), lead: lead.into(), source: Vec::new(), sections }
    }

    /// All its figures, in order.
    pub fn figures(&self) -> impl Iterator<Item = &Figure> {
        let mut figures = Vec::new();
        self.sections.iter().for_each(|section| collect(&section.parts, &mut figures));
        figures.into_iter()
    }
}

fn collect<'a>(parts: &'a [Part], figures: &mut Vec<&'a Figure>) {
    for part in parts {
        match part {
            Part::Figure(figure) => figures.push(figure),
            Part::Fold(_, parts) => collect(parts, figures),
            _ => {}
        }
    }
}

impl Section {
    /// A section.
    pub fn new(id: impl Into<String>, title: impl Into<String>, parts: Vec<Part>) -> Self {
        Self { id: id.into(), title: title.into(), parts }
    }
}
