//! The wanted fields of messages, decoded into rows.

use std::collections::HashMap;

use crate::{DecodeError, FieldPath, SchemaError, Value};

/// A stamp that is missing.
pub const MISSING: i64 = i64::MIN;

/// Decodes the messages of one channel.
pub trait Codec: Send + Sync {
    /// A whole message. Arrays of more than 64 numbers are only counted ([`Value::Long`]).
    ///
    /// # Errors
    /// Bytes that do not fit the schema.
    fn value(&self, message: &[u8]) -> Result<Value, DecodeError>;

    /// Compiles the decoding of some fields.
    ///
    /// # Errors
    /// Fields that the type does not have or that are no numbers, truth values or texts. Where the schema leaves fields open (JSON), any
    /// path is accepted.
    fn compile(&self, fields: &[FieldPath]) -> Result<Box<dyn Extract>, SchemaError>;

    /// The unit of a field, where the schema tells.
    fn unit(&self, _field: &FieldPath) -> Option<String> {
        None
    }
}

/// Decodes the wanted fields of one channel's messages.
pub trait Extract: Send + Sync {
    /// The groups that the wanted fields fall into. Every field is in exactly one.
    fn groups(&self) -> &[Group];

    /// Decodes a message into `row`, which was made by [`Row::new`] for this extractor.
    ///
    /// On success every slot, presence and stamp of the row is overwritten. On an error the row's contents mean nothing.
    ///
    /// # Errors
    /// Bytes that do not fit the schema, as far as the wanted fields need them: what follows the last wanted field is not looked at.
    fn extract(&self, message: &[u8], row: &mut Row) -> Result<(), DecodeError>;
}

/// Wanted fields that are present or absent together: all that have no name in brackets, or all with the same names.
///
/// A message about other joints or frames than the wanted ones has no sample of these: it does not say that their values are missing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Group {
    /// The path up to the last name in brackets; `None` for fields without one.
    pub key: Option<FieldPath>,
    /// The wanted fields of the group, by their place among all wanted.
    pub slots: Vec<usize>,
}

/// One extracted message: the output of [`Extract::extract`].
#[derive(Debug, Clone, Default)]
pub struct Row {
    /// One value a wanted field; NaN where the message has none. A text is its code in `texts`.
    pub values: Vec<f64>,
    /// For each group, whether the message has it.
    pub present: Vec<bool>,
    /// For each group, the stamp in nanoseconds of the innermost header around it (`header.stamp`, `stamp` or `timestamp`), else that of the
    /// message; [`MISSING`] without one. A zero stamp is 0, not missing.
    pub stamps: Vec<i64>,
    /// For each wanted field, whether its value is the code of a text.
    pub is_text: Vec<bool>,
    /// Texts seen so far; codes go on from message to message.
    pub texts: Texts,
}

impl Row {
    /// Room for an extractor's answers.
    pub fn new(extract: &dyn Extract) -> Self {
        let groups = extract.groups();
        let slots = groups.iter().map(|group| group.slots.len()).sum();
        Self {
            values: vec![f64::NAN; slots],
            present: vec![false; groups.len()],
            stamps: vec![MISSING; groups.len()],
            is_text: vec![false; slots],
            texts: Texts::default(),
        }
    }

    /// Writes a text into a slot, as its code.
    pub fn set_text(&mut self, slot: usize, text: &str) {
        self.values[slot] = self.texts.code(text);
        self.is_text[slot] = true;
    }
}

/// Different texts that are kept apart; beyond them a text is no category, and all further ones share one code.
const MAX_TEXTS: usize = 65_537;

/// Texts and their codes, in the order of their first appearance.
#[derive(Debug, Clone, Default)]
pub struct Texts {
    codes: HashMap<String, u32>,
    names: Vec<String>,
}

impl Texts {
    /// The code of a text.
    pub fn code(&mut self, text: &str) -> f64 {
        if let Some(&code) = self.codes.get(text) {
            return f64::from(code);
        }
        let code = self.names.len().min(MAX_TEXTS) as u32;
        if self.names.len() < MAX_TEXTS {
            self.codes.insert(text.to_owned(), code);
            self.names.push(text.to_owned());
        }
        f64::from(code)
    }

    /// The texts by their codes.
    pub fn names(&self) -> &[String] {
        &self.names
    }
}
