//! Numbers in the bytes of an array.

/// Binary format of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
    F16,
    F32,
    F64,
}

/// A number: its kind and the order of its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Number {
    pub(super) kind: Kind,
    /// The first byte is the highest.
    pub(super) big: bool,
    /// It stands for a real number although it is whole.
    pub(super) real: bool,
}

impl Number {
    pub(super) fn size(self) -> usize {
        match self.kind {
            Kind::Bool | Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 | Kind::F16 => 2,
            Kind::I32 | Kind::U32 | Kind::F32 => 4,
            Kind::I64 | Kind::U64 | Kind::F64 => 8,
        }
    }

    pub(super) fn is_whole(self) -> bool {
        !self.real && !matches!(self.kind, Kind::Bool | Kind::F16 | Kind::F32 | Kind::F64)
    }

    /// `count` numbers, each `stride` bytes behind the one before; NaN where the bytes end.
    pub(super) fn values(self, bytes: &[u8], at: usize, stride: usize, count: usize) -> Vec<f64> {
        macro_rules! read {
            ($number:ty, $convert:expr) => {
                (0..count)
                    .map(|row| match chunk(bytes, at, stride, row) {
                        None => f64::NAN,
                        Some(chunk) if self.big => $convert(<$number>::from_be_bytes(chunk)),
                        Some(chunk) => $convert(<$number>::from_le_bytes(chunk)),
                    })
                    .collect()
            };
        }
        match self.kind {
            Kind::Bool => read!(u8, |byte: u8| f64::from(u8::from(byte != 0))),
            Kind::I8 => read!(i8, f64::from),
            Kind::U8 => read!(u8, f64::from),
            Kind::I16 => read!(i16, f64::from),
            Kind::U16 => read!(u16, f64::from),
            Kind::I32 => read!(i32, f64::from),
            Kind::U32 => read!(u32, f64::from),
            Kind::I64 => read!(i64, |value: i64| value as f64),
            Kind::U64 => read!(u64, |value: u64| value as f64),
            Kind::F16 => read!(u16, half),
            Kind::F32 => read!(f32, f64::from),
            Kind::F64 => read!(f64, f64::from),
        }
    }

    /// As [`Self::values`], of whole numbers; `i64::MIN` where there is none.
    pub(super) fn integers(self, bytes: &[u8], at: usize, stride: usize, count: usize) -> Vec<i64> {
        macro_rules! read {
            ($number:ty) => {
                (0..count)
                    .map(|row| match chunk(bytes, at, stride, row) {
                        None => i64::MIN,
                        Some(chunk) if self.big => i64::try_from(<$number>::from_be_bytes(chunk)).unwrap_or(i64::MIN),
                        Some(chunk) => i64::try_from(<$number>::from_le_bytes(chunk)).unwrap_or(i64::MIN),
                    })
                    .collect()
            };
        }
        match self.kind {
            Kind::I8 => read!(i8),
            Kind::I16 => read!(i16),
            Kind::U16 => read!(u16),
            Kind::I32 => read!(i32),
            Kind::U32 => read!(u32),
            Kind::I64 => read!(i64),
            Kind::U64 => read!(u64),
            _ => read!(u8),
        }
    }
}

fn chunk<const N: usize>(bytes: &[u8], at: usize, stride: usize, row: usize) -> Option<[u8; N]> {
    bytes.get(at.checked_add(stride.checked_mul(row)?)?..)?.first_chunk().copied()
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
