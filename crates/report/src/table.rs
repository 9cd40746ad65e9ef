//! Tables.

use std::borrow::Cow;

use crate::{
    Light,
    markup::Element,
    words::{number, typeset},
};

/// A table: the head of every column, and rows of cells.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct Table {
    /// Content of the table, in a sentence.
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
    /// A number, to the right: four significant digits of it on the page, all of them in a file.
    Value(f64),
    /// A word with a light.
    Light(Light, String),
}

impl Cell {
    /// A number.
    pub fn of(value: f64) -> Self {
        Self::Value(value)
    }

    fn to_csv(&self) -> String {
        match self {
            Self::Value(value) if value.is_nan() => String::new(),
            Self::Value(value) => value.to_string(),
            Self::Number(text) => quoted(text),
            Self::Text(text) | Self::Light(_, text) => quoted(&no_formula(text)),
        }
    }

    fn is_number(&self) -> bool {
        matches!(self, Self::Number(_) | Self::Value(_))
    }

    /// The cell; in a table of numbers alone it needs no class.
    fn to_element(&self, first: bool, numbers: bool) -> Element {
        // The first cell of a row says what the row is about.
        let cell = if first { Element::new("th").with("scope", "row") } else { Element::new("td") };
        match self {
            Self::Text(text) => cell.text(text),
            Self::Value(value) => Self::Number(number(*value)).to_element(first, numbers),
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

    /// The table as comma-separated values (RFC 4180); unknown values are empty.
    pub fn to_csv(&self) -> String {
        let line = |cells: &mut dyn Iterator<Item = String>| cells.collect::<Vec<_>>().join(",") + "\n";
        let head = line(&mut self.head.iter().map(|name| quoted(&no_formula(name))));
        let rows = self.rows.iter().map(|row| line(&mut row.iter().map(Cell::to_csv)));
        std::iter::once(head).chain(rows).collect()
    }

    /// The table as an element that scrolls if it is wider than the page.
    pub(crate) fn to_element(&self) -> Element {
        let numeric = |column: usize| {
            let mut cells = self.rows.iter().filter_map(|row| row.get(column));
            cells.clone().next().is_some() && cells.all(Cell::is_number)
        };
        let numbers = self.rows.iter().flatten().all(Cell::is_number);
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
        let region = Element::new("div").class("scroll").with("tabindex", "0").with("role", "group");
        let region = region.with("aria-label", label).child(table);
        let whole = Element::new("div").class("table");
        // Beside the table, as it would scroll away with it.
        let caption = (!self.caption.is_empty()).then(|| Element::new("p").class("caption").text(&self.caption));
        whole.children(caption).child(region)
    }
}

/// Words that no spreadsheet takes for a formula: an apostrophe stands before those that begin like one (OWASP, *CSV Injection*).
fn no_formula(text: &str) -> Cow<'_, str> {
    if text.starts_with(['=', '+', '@', '\t', '\r']) { format!("'{text}").into() } else { text.into() }
}

/// A field of a file of comma-separated values.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::{Cell, Table};

    #[test]
    fn text_cells_cannot_start_a_formula() {
        let table = Table::new("", ["=1+1", "@a", "x"]);
        let table = table.row([Cell::Text("\t=2".into()), Cell::Text("+3, 4".into()), Cell::Number("+1.5".into())]);
        let table = table.row([Cell::Text("a=b".into()), Cell::Text("-".into()), Cell::of(-1.0)]);
        assert_eq!(table.to_csv(), "'=1+1,'@a,x\n'\t=2,\"'+3, 4\",+1.5\na=b,-,-1\n");
    }

    #[test]
    fn files_have_all_digits() {
        let table = Table::new("", ["a, b", "\"c\""]).row([Cell::of(1.0 / 3.0), Cell::of(f64::NAN)]);
        let table = table.row([Cell::Text("x\ny".into()), Cell::Number("1.50".into())]);
        assert_eq!(table.to_csv(), "\"a, b\",\"\"\"c\"\"\"\n0.3333333333333333,\n\"x\ny\",1.50\n");
    }
}
