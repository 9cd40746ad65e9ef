//! Offsets of the parts of a message.

use std::sync::Arc;

use fleetfoot_data::nearest_one;

use super::bytes::Number;
use crate::{FieldPath, SchemaError, Step};

/// A struct: its parts and its bytes. A last part as long as the rest of the message counts none.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Layout {
    pub(super) parts: Vec<Part>,
    pub(super) size: usize,
}

/// A field of a struct.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Part {
    pub(super) name: Arc<str>,
    /// Offset in the struct.
    pub(super) at: usize,
    pub(super) shape: Shape,
    /// The unit of its numbers, where the file tells.
    pub(super) unit: Option<String>,
}

/// Type of a part.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Shape {
    Number(Number),
    /// A text of so many bytes, up to its first NUL.
    Text(usize),
    Struct(Arc<Layout>),
    Array(Box<Shape>, usize),
    /// As many elements as fill the rest of the message.
    Rest(Box<Shape>),
    /// A text that is the rest of the message.
    RestText,
    /// Texts, with their count, that are the rest of the message.
    Texts,
}

impl Shape {
    /// Bytes that it has at least.
    pub(super) fn size(&self) -> usize {
        match self {
            Self::Number(number) => number.size(),
            Self::Text(size) => *size,
            Self::Struct(layout) => layout.size,
            Self::Array(element, count) => element.size().saturating_mul(*count),
            Self::Rest(_) | Self::RestText | Self::Texts => 0,
        }
    }

    /// Name of the type in messages.
    fn words(&self) -> &'static str {
        match self {
            Self::Struct(_) => "a struct",
            Self::Array(..) | Self::Rest(_) | Self::Texts => "an array",
            Self::Number(_) => "a number",
            Self::Text(_) | Self::RestText => "a text",
        }
    }
}

/// A wanted field.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Target {
    pub(super) at: usize,
    /// It may lie behind the end of a message, which then lacks it.
    pub(super) optional: bool,
    pub(super) leaf: Leaf,
}

/// Type of a wanted field.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Leaf {
    Number(Number),
    Text(usize),
    RestText,
    /// The text at this place of an array of texts.
    TextAt(usize),
}

impl Layout {
    /// Adds a part at the end.
    pub(super) fn push(&mut self, name: &str, shape: Shape, unit: Option<String>) {
        let at = self.size;
        self.size = at.saturating_add(shape.size());
        self.parts.push(Part { name: name.into(), at, shape, unit });
    }

    fn part(&self, name: &str) -> Option<&Part> {
        self.parts.iter().find(|part| *part.name == *name)
    }

    /// Offset and type of a wanted field.
    ///
    /// # Errors
    /// A field that there is not, and one that is no number or text.
    pub(super) fn resolve(&self, path: &FieldPath) -> Result<Target, SchemaError> {
        let missing = |nearest| SchemaError::NoField { path: path.to_string(), nearest };
        let until = |end: usize, step| {
            let steps = path.steps.iter().take(end).cloned().chain(step).collect();
            FieldPath { steps }.to_string()
        };
        let root;
        let (mut layout, mut at, mut optional) = (self, 0_usize, false);
        let mut shape: Option<&Shape> = None;
        for (place, step) in path.steps.iter().enumerate() {
            let next = match (step, shape) {
                (Step::Field(name), None) | (Step::Field(name), Some(Shape::Struct(_))) => {
                    if let Some(Shape::Struct(struct_there)) = shape {
                        layout = struct_there;
                    }
                    let part = layout.part(name).ok_or_else(|| {
                        let names = layout.parts.iter().map(|part| &*part.name);
                        missing(nearest_one(name, names).map(|name| until(place, Some(Step::Field(name.into())))))
                    })?;
                    at = at.saturating_add(part.at);
                    &part.shape
                }
                (Step::Index(index), Some(Shape::Array(element, count))) if index < count => {
                    at = at.saturating_add(element.size().saturating_mul(*index));
                    &**element
                }
                (Step::Index(index), Some(Shape::Rest(element))) => {
                    at = at.saturating_add(element.size().saturating_mul(*index));
                    optional = true;
                    &**element
                }
                (Step::Index(index), Some(Shape::Texts)) if place + 1 == path.steps.len() => {
                    return Ok(Target { at, optional: true, leaf: Leaf::TextAt(*index) });
                }
                _ => {
                    root = until(place, None);
                    return Err(missing(Some(root).filter(|root| !root.is_empty())));
                }
            };
            shape = Some(next);
        }
        let leaf = match shape {
            Some(Shape::Number(number)) => Leaf::Number(*number),
            Some(Shape::Text(size)) => Leaf::Text(*size),
            Some(Shape::RestText) => Leaf::RestText,
            other => {
                let kind = other.map_or("a struct", Shape::words).to_owned();
                return Err(SchemaError::NotAValue { path: path.to_string(), kind });
            }
        };
        Ok(Target { at, optional, leaf })
    }

    /// The unit of a field of the outermost struct, or of the elements of its array.
    pub(super) fn unit(&self, path: &FieldPath) -> Option<&str> {
        let Some(Step::Field(name)) = path.steps.first() else { return None };
        self.part(name)?.unit.as_deref()
    }
}
