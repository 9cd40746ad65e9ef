//! A whole message, decoded for people.

use std::sync::Arc;

/// Elements of a numeric array that are decoded one by one; longer ones (images, point clouds) are only counted.
pub(crate) const LONG_ARRAY: usize = 64;

/// A decoded value.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Value {
    /// Absent.
    Null,
    /// A truth value.
    Bool(bool),
    /// A whole number.
    Int(i64),
    /// A whole number without a sign.
    Uint(u64),
    /// A real number.
    Float(f64),
    /// A text.
    Text(String),
    /// An array.
    Array(Vec<Value>),
    /// An array of numbers, truth values or bytes with more than 64 elements; only their number.
    Long(usize),
    /// Fields in order.
    Struct(Vec<(Arc<str>, Value)>),
}

impl Value {
    /// The field of a struct.
    pub fn field(&self, name: &str) -> Option<&Value> {
        match self {
            Self::Struct(fields) => fields.iter().find(|(field_name, _)| &**field_name == name).map(|(_, value)| value),
            _ => None,
        }
    }

    /// The number that a column of this field holds: truth values are 0 and 1; texts, arrays and structs are none.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Bool(value) => Some(f64::from(u8::from(*value))),
            Self::Int(value) => Some(*value as f64),
            Self::Uint(value) => Some(*value as f64),
            Self::Float(value) => Some(*value),
            _ => None,
        }
    }
}
