//! Metadata of a file: information, parameters, and changes of parameters.

use std::{collections::BTreeMap, fmt::Write};

use super::message::{Entry, Message};

/// Numbers of an array that are written out; of more only how many.
const WRITTEN: usize = 64;

/// Places of the metadata in a file, and their times, nanoseconds; `None` before its data begin.
#[derive(Debug, Default)]
pub(super) struct About {
    places: Vec<(usize, Option<i64>)>,
}

impl About {
    /// Notes a message of the kinds `I`, `M`, `P` or `Q`.
    pub(super) fn add(&mut self, message: &Message<'_>, when: Option<i64>) {
        self.places.push((message.start, when));
    }

    /// All that the file says, as texts: information by its name (of several parts one text, of several values a line each), parameters as
    /// `parameter.NAME` with the value at the beginning, `changed.NAME` with the later ones and when they came, defaults as
    /// `default.system.NAME` and `default.setup.NAME`.
    pub(super) fn pairs(&self, bytes: &[u8]) -> BTreeMap<String, String> {
        let mut pairs = BTreeMap::new();
        for &(at, when) in &self.places {
            if let Ok(message) = Message::at(bytes, at) {
                add(&mut pairs, &message, when);
            }
        }
        pairs
    }
}

fn add(pairs: &mut BTreeMap<String, String>, message: &Message<'_>, when: Option<i64>) -> Option<()> {
    let flagged = || Entry::parse_flagged(message.payload);
    match message.kind {
        b'I' => {
            let entry = Entry::parse(message.payload)?;
            pairs.insert(entry.name.to_owned(), text(&entry));
        }
        b'M' => {
            let (continued, entry) = flagged()?;
            append(pairs, entry.name.to_owned(), &text(&entry), if continued == 0 { "\n" } else { "" });
        }
        b'P' => {
            let entry = Entry::parse(message.payload)?;
            match when {
                None => drop(pairs.insert(format!("parameter.{}", entry.name), text(&entry))),
                Some(when) => {
                    let change = format!("{} from {} s", text(&entry), when as f64 / 1e9);
                    append(pairs, format!("changed.{}", entry.name), &change, "; ");
                }
            }
        }
        b'Q' => {
            let (of, entry) = flagged()?;
            for (bit, whose) in [(1, "system"), (2, "setup")] {
                if of & bit != 0 {
                    pairs.insert(format!("default.{whose}.{}", entry.name), text(&entry));
                }
            }
        }
        _ => {}
    }
    Some(())
}

fn append(pairs: &mut BTreeMap<String, String>, key: String, text: &str, between: &str) {
    match pairs.get_mut(&key) {
        Some(value_list) => value_list.extend([between, text]),
        None => drop(pairs.insert(key, text.to_owned())),
    }
}

/// A value for people. Numbers have as many digits as tell them from their neighbours.
fn text(entry: &Entry<'_>) -> String {
    let element = entry.kind.split('[').next().unwrap_or_default();
    macro_rules! numbers {
        ($number:ty) => {{
            let (numbers, _) = entry.value.as_chunks::<{ size_of::<$number>() }>();
            joined(numbers.iter().map(|bytes| <$number>::from_le_bytes(*bytes).to_string()), numbers.len())
        }};
    }
    match element {
        "char" => String::from_utf8_lossy(entry.value).trim_end_matches('\0').to_owned(),
        "bool" => joined(entry.value.iter().map(|&byte| (byte != 0).to_string()), entry.value.len()),
        "int8_t" => numbers!(i8),
        "uint8_t" => numbers!(u8),
        "int16_t" => numbers!(i16),
        "uint16_t" => numbers!(u16),
        "int32_t" => numbers!(i32),
        "uint32_t" => numbers!(u32),
        "int64_t" => numbers!(i64),
        "uint64_t" => numbers!(u64),
        "float" => numbers!(f32),
        "double" => numbers!(f64),
        _ => format!("{} bytes", entry.value.len()),
    }
}

fn joined(numbers: impl Iterator<Item = String>, count: usize) -> String {
    if count > WRITTEN {
        return format!("{count} numbers");
    }
    let mut text = String::new();
    for number in numbers {
        let between = if text.is_empty() { "" } else { " " };
        let _ = write!(text, "{between}{number}");
    }
    text
}
