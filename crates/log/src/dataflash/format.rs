//! Types of messages: which fields they have, and where these lie.

use std::collections::BTreeMap;

use fleetfoot_message::dataflash_letter;

/// The form of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    Binary,
    Text,
}

/// Bytes before a binary message's fields.
pub(super) const HEAD: usize = 3;

/// The type that defines the others.
pub(super) const FMT: u8 = 0x80;

/// The clock of a message, microseconds, and that of older logs, milliseconds.
pub(super) const TIME: [(&str, i64); 2] = [("TimeUS", 1_000), ("TimeMS", 1_000_000)];

/// Names of types that define something, or are metadata: they are no topics.
const DEFINING: [&str; 5] = ["FMT", "FMTU", "UNIT", "MULT", "PARM"];

/// The letter among a type's units that marks the field of its instances.
pub(super) const INSTANCE: u8 = b'#';

/// A field of a message's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Field {
    pub(super) at: usize,
    pub(super) letter: u8,
    pub(super) size: usize,
}

/// A type of messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Format {
    pub(super) name: String,
    /// Types of the fields as they lie in a message's packed bytes.
    pub(super) letters: Vec<u8>,
    /// Types of the fields as the log has them.
    pub(super) original: Vec<u8>,
    pub(super) columns: Vec<String>,
    /// Bytes of its fields, without the head of a message.
    pub(super) length: usize,
    /// For each field, the letters of its unit and factor.
    pub(super) units: Vec<u8>,
    pub(super) factors: Vec<u8>,
    /// The clock, and nanoseconds of its unit.
    pub(super) clock: Option<(Field, i64)>,
    /// The field that tells instances apart.
    pub(super) instance: Option<Field>,
    pub(super) problem: Option<String>,
}

impl Format {
    pub(super) fn new(form: Form, name: &str, letters: &str, columns: &str, length: usize) -> Self {
        let original = letters.as_bytes().to_vec();
        let letters: Vec<u8> = match form {
            Form::Binary => original.clone(),
            Form::Text => original.iter().map(|&letter| text_letter(letter)).collect(),
        };
        let columns: Vec<String> =
            columns.split(',').map(str::trim).filter(|name| !name.is_empty()).map(str::to_owned).collect();
        let sizes: Option<usize> = letters.iter().map(|&letter| Some(dataflash_letter(letter)?.0)).sum();
        let unknown = original.iter().find(|&&letter| dataflash_letter(letter).is_none());
        let problem = match (unknown, sizes) {
            (Some(letter), _) => Some(format!("the type `{}` among its fields is unknown", char::from(*letter))),
            (None, Some(size)) if form == Form::Binary && size != length => {
                Some(format!("its format says {length} bytes, and its fields have {size}"))
            }
            _ if columns.len() != original.len() => {
                Some(format!("its format names {} fields and gives {} types", columns.len(), original.len()))
            }
            _ => None,
        };
        let length = if form == Form::Text { sizes.unwrap_or(0) } else { length };
        let mut new_format = Self {
            name: name.to_owned(),
            letters,
            original,
            columns,
            length,
            units: Vec::new(),
            factors: Vec::new(),
            clock: None,
            instance: None,
            problem,
        };
        new_format.clock = TIME.iter().find_map(|(name, unit)| Some((new_format.field(name)?, *unit)));
        new_format
    }

    /// A field by its name.
    pub(super) fn field(&self, name: &str) -> Option<Field> {
        self.at(self.columns.iter().position(|column| column == name)?)
    }

    pub(super) fn at(&self, place: usize) -> Option<Field> {
        let at =
            self.letters.get(..place)?.iter().map(|&letter| Some(dataflash_letter(letter)?.0)).sum::<Option<_>>()?;
        let letter = *self.letters.get(place)?;
        Some(Field { at, letter, size: dataflash_letter(letter)?.0 })
    }

    /// Bytes of its fields up to its time and its instance.
    pub(super) fn head(&self) -> usize {
        let fields = self.clock.map(|(field, _)| field).into_iter().chain(self.instance);
        fields.map(|field| field.at.saturating_add(field.size)).max().unwrap_or(0)
    }

    /// True if its messages are a topic.
    pub(super) fn is_topic(&self) -> bool {
        !DEFINING.contains(&self.name.as_str())
    }
}

/// Numbers of a text have no size: they are whole or not. What has a factor by its letter is written with it.
fn text_letter(letter: u8) -> u8 {
    match letter {
        b'b' | b'B' | b'h' | b'H' | b'i' | b'I' | b'q' => b'q',
        b'f' | b'g' | b'd' | b'c' | b'C' | b'e' | b'E' | b'L' | b'M' => b'd',
        other => other,
    }
}

/// Types by their numbers and names.
#[derive(Debug)]
pub(super) struct Formats {
    pub(super) form: Form,
    pub(super) all: Vec<Option<Format>>,
    pub(super) names: BTreeMap<String, u8>,
}

impl Formats {
    pub(super) fn new(form: Form) -> Self {
        let fmt = Format::new(form, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 86);
        let mut formats = Self { form, all: vec![None; 256], names: BTreeMap::new() };
        formats.names.insert(fmt.name.clone(), FMT);
        if let Some(place) = formats.all.get_mut(usize::from(FMT)) {
            *place = Some(fmt);
        }
        formats
    }

    pub(super) fn get(&self, kind: u8) -> Option<&Format> {
        self.all.get(usize::from(kind))?.as_ref()
    }

    pub(super) fn by_name(&self, name: &str) -> Option<(u8, &Format)> {
        let kind = *self.names.get(name)?;
        Some((kind, self.get(kind)?))
    }
}

/// The time of a message, nanoseconds, if it is one.
pub(super) fn time(payload: &[u8], clock: Field, unit: i64) -> Option<i64> {
    let time = whole_in(bytes_of(payload, clock)?, clock.letter)?;
    time.checked_mul(unit).filter(|&time| time >= 0)
}

/// The time of a message, or that of the one before for a type without a clock; `None` for a time that cannot be.
pub(super) fn stamp(format: &Format, payload: &[u8], last: i64) -> Option<i64> {
    match format.clock {
        Some((clock, unit)) => time(payload, clock, unit),
        None => Some(last),
    }
}

/// The bytes of a field.
pub(super) fn bytes_of(payload: &[u8], field: Field) -> Option<&[u8]> {
    payload.get(field.at..field.at.checked_add(field.size)?)
}

/// A text up to its first NUL.
pub(super) fn text_in(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(bytes.get(..end).unwrap_or_default()).into_owned()
}

/// A whole number, as clocks are.
pub(super) fn whole_in(bytes: &[u8], letter: u8) -> Option<i64> {
    match letter {
        b'i' => bytes.first_chunk().map(|bytes| i32::from_le_bytes(*bytes).into()),
        b'I' => bytes.first_chunk().map(|bytes| u32::from_le_bytes(*bytes).into()),
        b'q' => bytes.first_chunk().map(|bytes| i64::from_le_bytes(*bytes)),
        b'Q' => bytes.first_chunk().and_then(|bytes| u64::from_le_bytes(*bytes).try_into().ok()),
        _ => None,
    }
}

/// A number for people, with as many digits as tell it from its neighbours.
pub(super) fn number_in(bytes: &[u8], letter: u8) -> Option<String> {
    macro_rules! read {
        ($number:ty) => {
            bytes.first_chunk().map(|bytes| <$number>::from_le_bytes(*bytes).to_string())
        };
    }
    match letter {
        b'b' => read!(i8),
        b'B' | b'M' => read!(u8),
        b'h' | b'c' => read!(i16),
        b'H' | b'C' => read!(u16),
        b'i' | b'e' | b'L' => read!(i32),
        b'I' | b'E' => read!(u32),
        b'q' => read!(i64),
        b'Q' => read!(u64),
        b'f' => read!(f32),
        b'd' => read!(f64),
        _ => None,
    }
}
