//! World files for people: every parameter with its description and its unit.

use std::{collections::BTreeSet, fmt::Write};

use fleetfoot_sim::parameter_docs::{FieldDoc, TypeDoc};
use toml::{Table, Value};

/// Lines are not longer than this when they can be broken.
const WIDTH: usize = 110;

/// A table of parameters of a type as TOML, with the doc comments of the type's fields.
pub(super) fn commented(table: &Table, type_name: &str) -> String {
    let mut out = String::new();
    // `a::b::Name` is what the compiler calls it.
    let name = type_name.rsplit("::").next().unwrap_or(type_name);
    Printer { out: &mut out, listed: BTreeSet::new() }.table(table, TypeDoc::named(name), "");
    out
}

struct Printer<'a> {
    out: &'a mut String,
    /// Enums whose kinds have been listed.
    listed: BTreeSet<&'static str>,
}

impl Printer<'_> {
    /// The values of a table, then the tables in it.
    fn table(&mut self, table: &Table, kind: Option<&'static TypeDoc>, path: &str) {
        let variant = table.get("kind").and_then(Value::as_str);
        let (fields, file) = kind.map_or((&[][..], ""), |kind| kind.fields(variant));
        let field = |key: &str| fields.iter().find(|field| field.name == key);
        for (key, value) in table.iter().filter(|(_, value)| !is_table(value)) {
            match (kind, key.as_str()) {
                (Some(kind), "kind") if !kind.variants.is_empty() => self.kind(kind, value),
                _ => write_value(self.out, key, value, field(key), file),
            }
        }
        for (key, value) in table.iter().filter(|(_, value)| is_table(value)) {
            let path = if path.is_empty() { toml_key(key) } else { format!("{path}.{}", toml_key(key)) };
            let known = field(key).and_then(|field| TypeDoc::find(field.kind, file));
            self.out.push('\n');
            if let Some(field) = field(key) {
                comment(self.out, field.doc);
            }
            match value {
                Value::Table(inner) => {
                    // A table of tables need not be named.
                    if inner.is_empty() || inner.values().any(|value| !is_table(value)) {
                        let _ = writeln!(self.out, "[{path}]");
                    }
                    self.table(inner, known, &path);
                }
                other => {
                    for inner in other.as_array().into_iter().flatten().filter_map(Value::as_table) {
                        let _ = writeln!(self.out, "[[{path}]]");
                        self.table(inner, known, &path);
                    }
                }
            }
        }
    }

    /// `kind = ...`, and, once, the other kinds.
    fn kind(&mut self, kind: &'static TypeDoc, value: &Value) {
        if self.listed.insert(kind.name) {
            for variant in kind.variants {
                comment(self.out, &format!("{:?}: {}", variant.name, variant.doc));
            }
        }
        let _ = writeln!(self.out, "kind = {value}");
    }
}

/// A table, or a list of tables.
fn is_table(value: &Value) -> bool {
    match value {
        Value::Table(_) => true,
        Value::Array(items) => !items.is_empty() && items.iter().all(Value::is_table),
        _ => false,
    }
}

fn write_value(out: &mut String, key: &str, value: &Value, field: Option<&FieldDoc>, file: &str) {
    let line = format!("{} = {}", toml_key(key), number(value));
    let mut doc = field.map_or(String::new(), |field| field.doc.to_owned());
    // A word out of several: which ones.
    if let Some(words) = field.and_then(|field| TypeDoc::find(field.kind, file)).map(|kind| kind.variants)
        && !words.is_empty()
    {
        let words: Vec<String> = words.iter().map(|word| format!("{:?}", word.name)).collect();
        let _ = write!(doc, "{}One of {}.", if doc.is_empty() { "" } else { " " }, words.join(", "));
    }
    if doc.is_empty() {
        let _ = writeln!(out, "{line}");
    } else if line.len().max(24) + 4 + doc.len() <= WIDTH {
        let _ = writeln!(out, "{line:<24}  # {doc}");
    } else {
        comment(out, &doc);
        let _ = writeln!(out, "{line}");
    }
}

/// Lines that begin with `#`, broken between words.
pub(super) fn comment(out: &mut String, text: &str) {
    let mut line = String::from("#");
    for word in text.split_whitespace() {
        if line.len() + 1 + word.len() > WIDTH && line.len() > 1 {
            let _ = writeln!(out, "{line}");
            "#".clone_into(&mut line);
        }
        line.push(' ');
        line.push_str(word);
    }
    if line.len() > 1 {
        let _ = writeln!(out, "{line}");
    }
}

/// A value, small and large numbers by their exponent.
fn number(value: &Value) -> String {
    match value {
        Value::Float(number) if *number != 0.0 && !(1e-3..1e7).contains(&number.abs()) && number.is_finite() => {
            format!("{number:e}")
        }
        other => other.to_string(),
    }
}

fn toml_key(name: &str) -> String {
    let bare = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if bare { name.to_owned() } else { Value::from(name).to_string() }
}
