//! Layout of a message's bytes: the encapsulation header, alignment, and the headers of XCDR2.
//!
//! Sources: DDS-XTypes 1.3, 7.4.3 (extended CDR, versions 1 and 2) and 7.6.3.1.2 (encapsulation identifiers).

use crate::{DecodeError, Extensibility, Length, Scalar, Schema, Type};

/// The layouts of bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wire {
    /// ROS 1: little-endian, packed, texts without a NUL.
    Ros1,
    /// CDR as of version 1: alignment up to 8.
    Xcdr1,
    /// Version 2, root type final: alignment up to 4, lengths before arrays and sequences of anything but numbers.
    Plain2,
    /// Version 2, root type appendable: as [`Wire::Plain2`], and a length before each struct that is not final.
    Delimited2,
}

impl Wire {
    /// All of them; a wire's place is `wire as usize`.
    pub(super) const ALL: [Self; 4] = [Self::Ros1, Self::Xcdr1, Self::Plain2, Self::Delimited2];

    /// Alignment of a value of `size` bytes.
    pub(super) fn alignment(self, size: usize) -> usize {
        match self {
            Self::Ros1 => 1,
            Self::Xcdr1 => size.min(8),
            Self::Plain2 | Self::Delimited2 => size.min(4),
        }
    }

    fn version2(self) -> bool {
        matches!(self, Self::Plain2 | Self::Delimited2)
    }

    /// Bytes of the units that the length of a text counts.
    ///
    /// In version 1 the middlewares of ROS 2 agree on a count of UTF-16 units, each in four bytes; in version 2 the standard's bytes count.
    pub(super) fn text_unit(self, is_wide: bool) -> usize {
        if is_wide && self == Self::Xcdr1 { 4 } else { 1 }
    }

    /// Returns true if a length in bytes stands before an array of these elements.
    ///
    /// Numbers need none. Arrays of arrays of fixed length are one array with several dimensions, with one length in all.
    pub(super) fn array_header(self, element: &Type) -> bool {
        self.version2() && !is_numbers(element)
    }

    /// Returns true if a length in bytes stands before a struct.
    ///
    /// A type without stated extensibility follows the message's header. A writer that marks a message plain though its
    /// type is appendable does not support extensibility, and writes no lengths anywhere.
    pub(super) fn struct_header(self, schema: &Schema, index: usize) -> bool {
        let extensibility = |index: usize| schema.structs.get(index).and_then(|struct_type| struct_type.extensibility);
        match self {
            Self::Ros1 | Self::Xcdr1 => false,
            Self::Plain2 => {
                extensibility(index) == Some(Extensibility::Appendable)
                    && extensibility(schema.root) != Some(Extensibility::Appendable)
            }
            Self::Delimited2 => extensibility(index) != Some(Extensibility::Final),
        }
    }
}

/// Numbers, or arrays of fixed length of them.
fn is_numbers(kind: &Type) -> bool {
    match kind {
        Type::Scalar(_) => true,
        Type::Array { element, length: Length::Fixed(_) } => is_numbers(element),
        _ => false,
    }
}

/// Bytes of the encapsulation header; alignment counts from behind it.
pub(super) const ENCAPSULATION: usize = 4;

/// The layout, and whether numbers are big-endian, by the encapsulation header of a CDR message.
///
/// # Errors
/// Messages without a header, and parameter lists, whose members carry numbers that no ROS schema knows.
pub(super) fn encapsulation(message: &[u8]) -> Result<(Wire, bool), DecodeError> {
    let Some(&[high, low, _, _]) = message.first_chunk::<ENCAPSULATION>() else {
        let problem =
            format!("it has {} bytes, too few for the 4 bytes of header that a CDR message starts with", message.len());
        return Err(DecodeError::new(0, problem));
    };
    let wire = match (high, low & !1) {
        (0, 0x00) => Wire::Xcdr1,
        (0, 0x06) => Wire::Plain2,
        (0, 0x08) => Wire::Delimited2,
        (0, 0x02 | 0x0a) => {
            let problem = "the message is a parameter list (PL_CDR), as @mutable types have; write it as plain CDR";
            return Err(DecodeError::new(0, problem));
        }
        _ => {
            let problem = format!("the header 0x{high:02x}{low:02x} is no known CDR encapsulation");
            return Err(DecodeError::new(0, problem));
        }
    };
    Ok((wire, low & 1 == 0))
}

/// Least size of each struct of a schema on a wire.
#[derive(Debug)]
pub(super) struct Sizes {
    /// Bytes that a struct has at the least, padding not counted, by its index.
    least: Vec<usize>,
}

impl Sizes {
    pub(super) fn new(schema: &Schema, wire: Wire) -> Self {
        let mut sizes = Self { least: Vec::with_capacity(schema.structs.len()) };
        // A struct stands behind those that it uses, so that their sizes are known.
        for (index, struct_type) in schema.structs.iter().enumerate() {
            let fields =
                struct_type.fields.iter().map(|field| if field.optional { 1 } else { sizes.least(&field.kind) });
            let sum = fields.fold(0, usize::saturating_add);
            sizes.least.push(if wire.struct_header(schema, index) { 4 } else { sum });
        }
        sizes
    }

    /// The fewest bytes that a value of this type has.
    pub(super) fn least(&self, kind: &Type) -> usize {
        match kind {
            Type::Scalar(scalar) => scalar.size(),
            Type::Text { .. } => 4,
            Type::PlainText { size } => size.unwrap_or(0),
            Type::Padding(size) => *size,
            Type::Struct(index) => self.least.get(*index).copied().unwrap_or(0),
            Type::Array { length: Length::Sequence(_), .. } => 4,
            Type::Array { element, length: Length::Fixed(count) } => self.least(element).saturating_mul(*count),
        }
    }
}

/// A number from its bytes, as a column holds it. The bytes are as many as its size.
#[inline(always)]
pub(super) fn number<const BIG: bool>(scalar: Scalar, bytes: &[u8]) -> Option<f64> {
    macro_rules! read {
        ($number:ty, $size:literal) => {{
            let bytes = *bytes.first_chunk::<$size>()?;
            if BIG { <$number>::from_be_bytes(bytes) } else { <$number>::from_le_bytes(bytes) }
        }};
    }
    Some(match scalar {
        Scalar::Bool => f64::from(u8::from(read!(u8, 1) != 0)),
        Scalar::I8 => f64::from(read!(i8, 1)),
        Scalar::U8 => f64::from(read!(u8, 1)),
        Scalar::I16 => f64::from(read!(i16, 2)),
        Scalar::U16 => f64::from(read!(u16, 2)),
        Scalar::I32 => f64::from(read!(i32, 4)),
        Scalar::U32 => f64::from(read!(u32, 4)),
        Scalar::I64 => read!(i64, 8) as f64,
        Scalar::U64 => read!(u64, 8) as f64,
        Scalar::F32 => f64::from(read!(f32, 4)),
        Scalar::F64 => read!(f64, 8),
        Scalar::LongDouble => f64::NAN,
    })
}

/// A text from its bytes, without the NUL at its end.
pub(super) fn narrow(bytes: &[u8]) -> &[u8] {
    bytes.strip_suffix(b"\0").unwrap_or(bytes)
}

/// A text without a count: up to the first NUL.
pub(super) fn plain(bytes: &[u8]) -> &[u8] {
    bytes.split(|&byte| byte == 0).next().unwrap_or_default()
}

/// A text in UTF-16, each unit in 4 bytes or (whatever else `unit` says) in 2.
pub(super) fn wide<const BIG: bool>(bytes: &[u8], unit: usize) -> String {
    let units = bytes.chunks_exact(if unit == 4 { 4 } else { 2 }).map(|unit| {
        let digits = unit.iter().map(|&byte| u32::from(byte));
        if BIG {
            digits.fold(0, |value, byte| value << 8 | byte)
        } else {
            digits.rev().fold(0, |value, byte| value << 8 | byte)
        }
    });
    // Characters that need no pair of units may stand as they are in four bytes.
    let units = units.flat_map(|value| {
        let mut pair = [0; 2];
        let whole = char::from_u32(value).filter(|_| value > 0xffff).map(|c| c.encode_utf16(&mut pair).len());
        if whole.is_none() {
            pair[0] = u16::try_from(value).unwrap_or(0xfffd);
        }
        pair.into_iter().take(whole.unwrap_or(1))
    });
    char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}
