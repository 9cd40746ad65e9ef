//! Errors of schemas and messages.

/// A message's bytes do not fit its schema.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("at byte {offset} of the message: {problem}")]
pub struct DecodeError {
    /// Byte of the problem, counted from the message's first byte.
    pub offset: usize,
    /// Description of the problem.
    pub problem: String,
}

impl DecodeError {
    /// A problem at a place.
    pub fn new(offset: usize, problem: impl Into<String>) -> Self {
        Self { offset, problem: problem.into() }
    }
}

/// A schema that cannot be understood, or that lacks a requested field.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SchemaError {
    /// A text or descriptor that does not match its encoding.
    #[error("the {encoding} schema `{name}` cannot be understood: {problem}")]
    Malformed {
        /// The schema's encoding, e.g. `ros2msg`.
        encoding: String,
        /// The message type.
        name: String,
        /// Description of the problem.
        problem: String,
    },
    /// An encoding of messages or schemas that is not known.
    #[error(
        "messages encoded as `{message}` with a schema encoded as `{schema}` cannot be read; readable are cdr with ros2msg or ros2idl, ros1 with ros1msg, \
         ulog with ulog, dataflash, wpilog, protobuf with protobuf, json"
    )]
    UnknownEncoding {
        /// The message encoding of the channel.
        message: String,
        /// The encoding of its schema.
        schema: String,
    },
    /// The message encoding needs a schema and the channel has none.
    #[error("messages encoded as `{message}` need a schema, and this channel has none")]
    NoSchema {
        /// The message encoding of the channel.
        message: String,
    },
    /// A wanted field that the type does not have.
    #[error("there is no field `{path}`{}", nearest.as_ref().map(|name| format!("; the nearest is `{name}`")).unwrap_or_default())]
    NoField {
        /// The wanted field.
        path: String,
        /// A field of the type that is spelled similarly.
        nearest: Option<String>,
    },
    /// A wanted field that is not a number, a truth value or a text.
    #[error("`{path}` is {kind}: name one of its parts")]
    NotAValue {
        /// The wanted field.
        path: String,
        /// Kind of the field that the path leads to, with an article.
        kind: String,
    },
}
