//! Numbers and texts in the bytes of a message.

use crate::{DecodeError, Value};

/// Binary format of a number, little-endian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    /// IEEE 754 half precision.
    F16,
    F32,
    F64,
    /// Some bits of a whole number of so many bytes.
    Bits {
        bytes: usize,
        shift: u32,
        width: u32,
        of: BitKind,
    },
}

/// Type of a bit field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BitKind {
    Bool,
    Signed,
    Unsigned,
}

/// A number: its bytes, and the factor between them and the value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Number {
    pub(super) kind: Kind,
    /// `None`: the value as it is written.
    pub(super) scale: Option<f64>,
}

impl Number {
    /// A number as it is written.
    pub(super) fn plain(kind: Kind) -> Self {
        Self { kind, scale: None }
    }

    /// Its bytes.
    pub(super) fn size(&self) -> usize {
        match self.kind {
            Kind::Bool | Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 | Kind::F16 => 2,
            Kind::I32 | Kind::U32 | Kind::F32 => 4,
            Kind::I64 | Kind::U64 | Kind::F64 => 8,
            Kind::Bits { bytes, .. } => bytes,
        }
    }

    /// The number at the beginning of `bytes`, of which there are enough; [`Value::Null`] where there are not.
    pub(super) fn read(&self, bytes: &[u8]) -> Value {
        macro_rules! read {
            ($number:ty) => {
                bytes.first_chunk().map(|bytes| <$number>::from_le_bytes(*bytes))
            };
        }
        let value = match self.kind {
            Kind::Bool => bytes.first().map(|&byte| Value::Bool(byte != 0)),
            Kind::I8 => read!(i8).map(|value| Value::Int(value.into())),
            Kind::U8 => read!(u8).map(|value| Value::Int(value.into())),
            Kind::I16 => read!(i16).map(|value| Value::Int(value.into())),
            Kind::U16 => read!(u16).map(|value| Value::Int(value.into())),
            Kind::I32 => read!(i32).map(|value| Value::Int(value.into())),
            Kind::U32 => read!(u32).map(|value| Value::Int(value.into())),
            Kind::I64 => read!(i64).map(Value::Int),
            Kind::U64 => read!(u64).map(Value::Uint),
            Kind::F16 => read!(u16).map(|bits| Value::Float(half(bits))),
            Kind::F32 => read!(f32).map(|value| Value::Float(value.into())),
            Kind::F64 => read!(f64).map(Value::Float),
            Kind::Bits { bytes: size, shift, width, of } => {
                bytes.get(..size).map(|bytes| bits(bytes, shift, width, of))
            }
        };
        match (value, self.scale) {
            (None, _) => Value::Null,
            (Some(value), None) => value,
            (Some(value), Some(scale)) => {
                value.number().map_or(Value::Null, |number| Value::Float(scaled(number, scale)))
            }
        }
    }
}

/// A number by a factor; by a tenth or a hundredth by division, which rounds once.
pub(super) fn scaled(number: f64, scale: f64) -> f64 {
    let divisor = (1.0 / scale).round();
    if scale > 0.0 && scale < 1.0 && ((1.0 / scale) / divisor - 1.0).abs() < 1e-9 {
        number / divisor
    } else {
        number * scale
    }
}

fn bits(bytes: &[u8], shift: u32, width: u32, of: BitKind) -> Value {
    let all = bytes.iter().rev().fold(0_u64, |all, &byte| all << 8 | u64::from(byte));
    let unused = 64 - width.clamp(1, 64);
    let moved = all.checked_shr(shift).unwrap_or(0) << unused;
    match of {
        BitKind::Bool => Value::Bool(moved != 0),
        BitKind::Signed => Value::Int(moved as i64 >> unused),
        BitKind::Unsigned => Value::Uint(moved >> unused),
    }
}

/// A number of half precision.
fn half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff));
    let size = match exponent {
        0 => fraction * 2_f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2_f64.powi(exponent - 15),
    };
    if bits >> 15 == 1 { -size } else { size }
}

/// A text up to its first NUL. Bytes that are no UTF-8 are Western European, as older writers have them.
pub(super) fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    rest_text(bytes.get(..end).unwrap_or_default())
}

/// A text of all the bytes.
pub(super) fn rest_text(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&byte| char::from(byte)).collect(),
    }
}

/// Texts with their count first and the length of each before it, each four bytes.
pub(super) fn texts(bytes: &[u8], at: usize) -> Result<Vec<String>, DecodeError> {
    let cut = || DecodeError::new(at + bytes.len(), "it ends inside an array of texts");
    let length = |rest: &mut &[u8]| {
        let (length, after) = rest.split_first_chunk::<4>()?;
        *rest = after;
        usize::try_from(u32::from_le_bytes(*length)).ok()
    };
    let mut rest = bytes;
    let count = length(&mut rest).ok_or_else(cut)?;
    // Each has four bytes at least, so that a count that lies takes no memory.
    let mut all = Vec::with_capacity(count.min(rest.len() / 4));
    for _ in 0..count {
        let text_bytes = length(&mut rest).and_then(|length| rest.split_at_checked(length));
        let (text_bytes, after) = text_bytes.ok_or_else(cut)?;
        all.push(rest_text(text_bytes));
        rest = after;
    }
    Ok(all)
}
