//! The spelling of names: identifiers, topic fields, reserved words.

use crate::Filter;

/// Returns true if a name can be written without backticks: an identifier, a topic's field, or a filter's definition.
pub(crate) fn is_bare_name(name: &str) -> bool {
    let length = if name.starts_with('/') { topic_length(name) } else { identifier_length(name) };
    (length > 0 && length == name.len() && constant(name).is_none()) || Filter::of(name).is_some()
}

/// The value of a reserved word.
pub(super) fn constant(name: &str) -> Option<f64> {
    match name {
        "pi" => Some(std::f64::consts::PI),
        "inf" => Some(f64::INFINITY),
        "nan" => Some(f64::NAN),
        _ => None,
    }
}

/// Bytes of the identifier at the start: letters, digits and `_`, with inner dots and `[...]` parts.
pub(crate) fn identifier_length(text: &str) -> usize {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    if !text.starts_with(|c: char| c.is_alphabetic() || c == '_') {
        return 0;
    }
    let word = |from: usize| text[from..].find(|c| !is_word(c)).map_or(text.len(), |length| from + length);
    let mut at = word(0);
    loop {
        // Only behind an ASCII character is the next byte the beginning of one.
        let Some(open @ (b'.' | b'[')) = text.as_bytes().get(at) else {
            return at;
        };
        let part = word(at + 1);
        let end = match (part > at + 1, open) {
            (true, b'.') => part,
            (true, _) if text.as_bytes().get(part) == Some(&b']') => part + 1,
            _ => return at,
        };
        at = word(end);
    }
}

/// Bytes of the topic field at the start (which is a slash); 0 for a slash alone.
pub(super) fn topic_length(text: &str) -> usize {
    let is_part = |c: char| c.is_ascii_alphanumeric() || "_./[]:-".contains(c);
    let run = text.find(|c| !is_part(c)).unwrap_or(text.len());
    text[..run].trim_end_matches(['-', '/']).len()
}
