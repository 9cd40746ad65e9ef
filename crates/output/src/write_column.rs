//! Columns to be written.

/// A column to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct WriteColumn {
    /// Its name.
    pub name: String,
    /// Its unit; stored in the field's metadata, where `open` of `log` finds it again.
    pub unit: Option<String>,
    /// Kind of its values.
    pub kind: WriteKind,
}

impl WriteColumn {
    /// A column without a unit.
    pub fn new(name: impl Into<String>, kind: WriteKind) -> Self {
        Self { name: name.into(), unit: None, kind }
    }

    /// The same column with a unit.
    pub fn with_unit(self, unit: impl Into<String>) -> Self {
        Self { unit: Some(unit.into()), ..self }
    }
}

/// Kind of a written column's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum WriteKind {
    /// 64-bit floats; NaN stays NaN.
    Float,
    /// 64-bit whole numbers.
    Integer,
    /// Nanoseconds as a timestamp.
    Stamp,
    /// Truth values.
    Boolean,
    /// UTF-8.
    Text,
}
