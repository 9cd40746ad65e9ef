//! The columns of a model.

use crate::RotationPart;

/// A column of the model: an alias for an expression over the fields of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// The alias.
    pub name: String,
    /// The expression over the log's fields that gives it, as text.
    pub source: String,
    /// The unit, when known.
    pub unit: Option<String>,
    /// Its part in the model.
    pub role: Role,
    /// True for an angle: wrapped to (-pi, pi], replaced in libraries and partitions by its cosine and sine.
    pub angle: bool,
    /// Its part in a rotation of several columns; `None` for a single column.
    pub rotation: Option<RotationPart>,
}

impl Column {
    /// A number of a log under its own name, of no known unit.
    pub fn new(name: impl Into<String>, role: Role) -> Self {
        let name = name.into();
        Self { source: name.clone(), name, unit: None, role, angle: false, rotation: None }
    }
}

/// The part of a column in a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Advanced by the model's equations in a rollout.
    State,
    /// Given from outside at every time.
    Input,
    /// Read from the recording only to measure a target or to choose a region.
    Auxiliary,
}
