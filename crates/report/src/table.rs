//! Tables.

use crate::{
    Light,
    markup::Element,
    words::{number, typeset},
};

/// A table: the head of every column, and rows of cells.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct Table {
    /// What it shows, in a sentence.
    pub caption: String,
    /// Heads of the columns.
    pub head: Vec<String>,
    /// Cells, as many a row as there are heads.
    pub rows: Vec<Vec<Cell>>,
}

/// A cell.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Words, to the left.
    Text(String),
    /// A number as it was written, to the right.
    Number(String),
    /// A word with a light.
    Light(Light, String),
}

impl Cell {
    /// A number with four significant digits.
    pub fn of(value: f64) -> Self {
        Self::Number(number(value))
    }

    /// The cell; in a table of numbers alone it needs no class of its own.
    fn to_element(&self, first: bool, numbers: bool) -> Element {
        // The first cell of a row says what the row is about.
        let cell = if first { Element::new("th").with("scope", "row") } else { Element::new("td") };
        match self {
            Self::Text(text) => cell.text(text),
            Self::Number(text) if numbers => Element::new("td").text(typeset(text)),
            Self::Number(text) => cell.class("n").text(typeset(text)),
            Self::Light(light, text) => {
                let sign = Element::new("span").class("sign").with("aria-hidden", "true").text(light.sign());
                cell.class(format!("light {}", light.word())).child(sign).text(format!(" {text}"))
            }
        }
    }
}

impl Table {
    /// An empty table.
    pub fn new<S: Into<String>>(caption: impl Into<String>, head: impl IntoIterator<Item = S>) -> Self {
        Self { caption: caption.into(), head: head.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// With a row at its end.
    pub fn row(mut self, cells: impl IntoIterator<Item = Cell>) -> Self {
        self.rows.push(cells.into_iter().collect());
        self
    }

    /// The table as an element that scrolls by itself where it is wider than the page.
    pub(crate) fn to_element(&self) -> Element {
        let numeric = |column: usize| {
            let mut cells = self.rows.iter().filter_map(|row| row.get(column));
            cells.clone().next().is_some() && cells.all(|cell| matches!(cell, Cell::Number(_)))
        };
        let numbers = self.rows.iter().flatten().all(|cell| matches!(cell, Cell::Number(_)));
        let head = self.head.iter().enumerate().map(|(column, name)| {
            let cell = Element::new("th").with("scope", "col");
            if numeric(column) && !numbers { cell.class("n").text(name) } else { cell.text(name) }
        });
        let rows = self.rows.iter().map(|row| {
            let cells = row.iter().enumerate().map(|(column, cell)| cell.to_element(column == 0, numbers));
            Element::new("tr").children(cells)
        });
        let table = Element::new("table")
            .class(if numbers { "numbers" } else { "mixed" })
            .child(Element::new("thead").child(Element::new("tr").children(head)))
            .child(Element::new("tbody").children(rows));
        let label = if self.caption.is_empty() { "table" } else { &self.caption };
        let region = Element::new("div").class("scroll").with("tabindex", "0").with("role", "region");
        let region = region.with("aria-label", label).child(table);
        let whole = Element::new("div").class("table");
        // Beside the table, as it would scroll away with it.
        let caption = (!self.caption.is_empty()).then(|| Element::new("p").class("caption").text(&self.caption));
        whole.children(caption).child(region)
    }
}
