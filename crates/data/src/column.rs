//! Columns: names, units and kinds.

/// One column of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// The name in the file, unique within a source.
    pub name: String,
    /// The unit, if the file has it.
    pub unit: Option<String>,
    /// Kind of the numbers.
    pub kind: ColumnKind,
}

/// Kind of a column's `f64` values.
#[derive(Debug, Clone, PartialEq)]
pub enum ColumnKind {
    /// A measured real number.
    Float,
    /// A whole number.
    Integer,
    /// 0 or 1.
    Boolean,
    /// An index into these names. The names are sorted, so the codes do not depend on the order of the rows.
    Category(Vec<String>),
}

impl Column {
    /// A column of real numbers without a unit.
    pub fn float(name: impl Into<String>) -> Self {
        Self { name: name.into(), unit: None, kind: ColumnKind::Float }
    }

    /// The name of the value `code` of a column used as a label: the category's name, else the number.
    pub fn label(&self, code: f64) -> String {
        match &self.kind {
            ColumnKind::Category(names) if code >= 0.0 && (code as usize) < names.len() => names[code as usize].clone(),
            _ => format!("{code}"),
        }
    }
}
