//! The fields of ArduPilot's DataFlash messages.
//!
//! Format: <https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html>. A schema is a text with a line a field: name, letter of
//! its type, factor and unit, with tabs between. Factor and unit may be empty.

use super::{
    bytes::{Kind, Number},
    layout::{Layout, Shape},
};
use crate::{Codec, SchemaError};

/// Numbers of an array (letter `a`).
const ARRAY: usize = 32;

/// Type behind a letter of a format, with the factor that the letter implies.
fn shape(letter: u8) -> Option<(Shape, Option<f64>)> {
    let number = |kind, scale| Some((Shape::Number(Number { kind, scale }), scale));
    match letter {
        b'b' => number(Kind::I8, None),
        b'B' | b'M' => number(Kind::U8, None),
        b'h' => number(Kind::I16, None),
        b'H' => number(Kind::U16, None),
        b'i' => number(Kind::I32, None),
        b'I' => number(Kind::U32, None),
        b'q' => number(Kind::I64, None),
        b'Q' => number(Kind::U64, None),
        b'g' => number(Kind::F16, None),
        b'f' => number(Kind::F32, None),
        b'd' => number(Kind::F64, None),
        b'c' => number(Kind::I16, Some(1e-2)),
        b'C' => number(Kind::U16, Some(1e-2)),
        b'e' => number(Kind::I32, Some(1e-2)),
        b'E' => number(Kind::U32, Some(1e-2)),
        b'L' => number(Kind::I32, Some(1e-7)),
        b'n' => Some((Shape::Text(4), None)),
        b'N' => Some((Shape::Text(16), None)),
        b'Z' => Some((Shape::Text(64), None)),
        b'a' => Some((Shape::Array(Box::new(Shape::Number(Number::plain(Kind::I16))), ARRAY), None)),
        _ => None,
    }
}

/// Bytes of a field, and the factor that its letter has by itself; `None` for a letter that is not known.
pub fn dataflash_letter(letter: u8) -> Option<(usize, Option<f64>)> {
    shape(letter).map(|(shape, scale)| (shape.size(), scale))
}

/// Makes the decoder of messages whose fields `text` lists.
pub(crate) fn codec(name: &str, text: &[u8]) -> Result<Box<dyn Codec>, SchemaError> {
    let malformed =
        |problem: String| SchemaError::Malformed { encoding: "dataflash".to_owned(), name: name.to_owned(), problem };
    let text = std::str::from_utf8(text).map_err(|_| malformed("it is not text".to_owned()))?;
    let mut layout = Layout::default();
    for line in text.lines() {
        let mut words = line.split('\t');
        let field = words.next().unwrap_or_default();
        let letter = words.next().unwrap_or_default().as_bytes().first().copied().unwrap_or_default();
        let (mut shape, _) = shape(letter)
            .ok_or_else(|| malformed(format!("the type `{}` of `{field}` is unknown", char::from(letter))))?;
        let factor = words.next().filter(|factor| !factor.is_empty());
        let factor =
            factor.map(|factor| factor.parse::<f64>().map_err(|_| malformed(format!("`{line}` is not a field"))));
        if let (Shape::Number(number), Some(factor)) = (&mut shape, factor.transpose()?) {
            number.scale = Some(factor);
        }
        let unit = words.next().filter(|unit| !unit.is_empty()).map(str::to_owned);
        layout.push(field, shape, unit);
    }
    Ok(super::codec(layout))
}
