//! Types of messages, whatever language describes them.

use std::sync::Arc;

/// A message type with all types that it uses.
///
/// Arrays of arrays do not occur in ROS; a parser for another language may nest [`Type::Array`] freely.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schema {
    /// All struct types; never recursive: a parser refuses types that contain themselves.
    pub structs: Vec<StructType>,
    /// Index of the message's own type.
    pub root: usize,
}

/// A struct: fields in the order of serialisation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StructType {
    /// Its full name, e.g. `geometry_msgs/msg/Vector3`.
    pub name: String,
    /// Its fields; at least one (an empty ROS message has a dummy octet).
    pub fields: Vec<Field>,
    /// Extensibility of the type, if the schema states it. It determines the headers in XCDR2.
    pub extensibility: Option<Extensibility>,
}

/// A field of a struct.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: Arc<str>,
    /// Its type.
    pub kind: Type,
    /// It may be absent (`@optional` in IDL).
    pub optional: bool,
}

/// Extensibility of a type (DDS-XTypes 1.3, 7.2.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extensibility {
    /// Not at all.
    Final,
    /// Fields may be added at the end.
    Appendable,
    /// Fields may come and go.
    Mutable,
}

/// The type of a field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Type {
    /// A number or truth value of fixed size.
    Scalar(Scalar),
    /// A text; wide ones have 16-bit units.
    Text {
        /// UTF-16 instead of UTF-8.
        wide: bool,
    },
    /// A text without a count before it, up to its first NUL.
    PlainText {
        /// The bytes that it always has; `None`: all that are left of the message.
        size: Option<usize>,
    },
    /// So many bytes that mean nothing.
    Padding(usize),
    /// A struct, by its index in [`Schema::structs`].
    Struct(usize),
    /// Many of one type.
    Array {
        /// The type of one element.
        element: Box<Type>,
        /// Number of elements.
        length: Length,
    },
}

/// Number of elements of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Length {
    /// Always this many, without a count in the message.
    Fixed(usize),
    /// As many as the message states, at most this many if the schema bounds it.
    Sequence(Option<usize>),
}

/// Numbers and truth values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs)]
pub enum Scalar {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
    /// 16 octets that nothing here reads.
    LongDouble,
}

impl Scalar {
    /// Bytes of one value.
    pub fn size(self) -> usize {
        match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
            Self::LongDouble => 16,
        }
    }
}
