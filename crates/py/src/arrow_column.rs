//! One column of an Arrow table as numbers.

use std::{collections::HashMap, ops::Range, path::Path, sync::OnceLock};

use arrow_array::{
    Array, ArrayRef, ArrowPrimitiveType, BooleanArray, PrimitiveArray, StructArray,
    cast::AsArray,
    make_array,
    types::{
        Date32Type, Date64Type, Decimal32Type, Decimal64Type, Decimal128Type, Decimal256Type, DurationMicrosecondType,
        DurationMillisecondType, DurationNanosecondType, DurationSecondType, Float16Type, Float32Type, Float64Type,
        Int8Type, Int16Type, Int32Type, Int64Type, Time32MillisecondType, Time32SecondType, Time64MicrosecondType,
        Time64NanosecondType, TimestampMicrosecondType, TimestampMillisecondType, TimestampNanosecondType,
        TimestampSecondType, UInt8Type, UInt16Type, UInt32Type, UInt64Type,
    },
};
use arrow_buffer::NullBuffer;
use arrow_schema::{ArrowError, DataType, Field, TimeUnit as ArrowUnit};
use fleetfoot::{
    data::{Column, ColumnKind, ScalarBuffer},
    log::{Error, TimeUnit},
};

/// Different texts that a category may have.
const MAX_CATEGORIES: usize = 65_536;
/// No text.
const NONE: u32 = u32::MAX;
/// No whole number.
const MISSING: i64 = i64::MIN;
const DAY_SECONDS: i64 = 86_400;

/// Content of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Meaning {
    Boolean,
    Integer,
    Float,
    /// Counts of a unit; dates are counts of days.
    Time {
        unit: TimeUnit,
        days: bool,
    },
    Text,
    Unsupported,
}

/// A column in chunks of rows.
pub(crate) struct ArrowColumn {
    chunks: Vec<ArrayRef>,
    /// The first row of each chunk.
    starts: Vec<usize>,
    meaning: Meaning,
    kind: DataType,
    /// The names of a category and each chunk's codes; made when they are first needed.
    categories: OnceLock<Categories>,
}

struct Categories {
    /// Sorted.
    names: Vec<String>,
    /// For each chunk the code of each row, or [`NONE`].
    codes: Vec<Vec<u32>>,
    too_many: bool,
}

/// The numbers and texts that a field holds: itself, or the fields of a struct by their paths.
///
/// # Errors
/// Missing values that cannot be put together.
pub(crate) fn leaves(
    field: &Field,
    name: String,
    chunks: Vec<ArrayRef>,
) -> Result<Vec<(Column, ArrowColumn)>, ArrowError> {
    let DataType::Struct(children) = field.data_type() else {
        let column = ArrowColumn::new(field.data_type().clone(), chunks);
        let unit = field.metadata().get("unit").or_else(|| field.metadata().get("units")).cloned();
        return Ok(vec![(Column { name, unit, kind: column.bare_kind() }, column)]);
    };
    let mut leaf_list = Vec::new();
    for (place, child) in children.iter().enumerate() {
        let inner = chunks.iter().map(|chunk| part(chunk.as_struct(), place)).collect::<Result<Vec<_>, _>>()?;
        leaf_list.extend(leaves(child, format!("{name}.{}", child.name()), inner)?);
    }
    Ok(leaf_list)
}

/// A field of a struct, missing where the struct is.
fn part(parent: &StructArray, place: usize) -> Result<ArrayRef, ArrowError> {
    let child = parent.column(place);
    if parent.null_count() == 0 {
        return Ok(child.clone());
    }
    let nulls = NullBuffer::union(parent.nulls(), child.nulls());
    Ok(make_array(child.to_data().into_builder().nulls(nulls).build()?))
}

fn meaning(kind: &DataType) -> Meaning {
    let time = |unit| Meaning::Time { unit, days: false };
    let of = |unit: &ArrowUnit| match unit {
        ArrowUnit::Second => TimeUnit::Seconds,
        ArrowUnit::Millisecond => TimeUnit::Milliseconds,
        ArrowUnit::Microsecond => TimeUnit::Microseconds,
        ArrowUnit::Nanosecond => TimeUnit::Nanoseconds,
    };
    let is_text = |kind: &DataType| matches!(kind, DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View);
    match kind {
        DataType::Boolean => Meaning::Boolean,
        DataType::Null => Meaning::Integer,
        kind if kind.is_integer() => Meaning::Integer,
        kind if kind.is_floating() || kind.is_decimal() => Meaning::Float,
        DataType::Date32 => Meaning::Time { unit: TimeUnit::Seconds, days: true },
        DataType::Date64 => time(TimeUnit::Milliseconds),
        DataType::Time32(unit) | DataType::Time64(unit) | DataType::Timestamp(unit, _) | DataType::Duration(unit) => {
            time(of(unit))
        }
        kind if is_text(kind) => Meaning::Text,
        DataType::Dictionary(_, values) if is_text(values) => Meaning::Text,
        _ => Meaning::Unsupported,
    }
}

impl ArrowColumn {
    fn new(kind: DataType, chunks: Vec<ArrayRef>) -> Self {
        let mut starts = Vec::with_capacity(chunks.len());
        let mut rows = 0;
        for chunk in &chunks {
            starts.push(rows);
            rows += chunk.len();
        }
        Self { chunks, starts, meaning: meaning(&kind), kind, categories: OnceLock::new() }
    }

    /// Its kind, categories without their names.
    fn bare_kind(&self) -> ColumnKind {
        match self.meaning {
            Meaning::Boolean => ColumnKind::Boolean,
            Meaning::Integer => ColumnKind::Integer,
            Meaning::Text => ColumnKind::Category(Vec::new()),
            Meaning::Float | Meaning::Time { .. } | Meaning::Unsupported => ColumnKind::Float,
        }
    }

    /// Its kind, categories with their names; errors name `table` and `name`.
    ///
    /// # Errors
    /// A type that cannot become numbers, and a text with too many values.
    pub(crate) fn kind(&self, table: &Path, name: &str) -> Result<ColumnKind, Error> {
        match self.meaning {
            Meaning::Unsupported => Err(Error::UnsupportedColumn {
                path: table.into(),
                column: name.to_owned(),
                kind: self.kind.to_string(),
            }),
            Meaning::Text if self.categories().too_many => {
                Err(Error::TooManyCategories { path: table.into(), column: name.to_owned(), limit: MAX_CATEGORIES })
            }
            Meaning::Text => Ok(ColumnKind::Category(self.categories().names.clone())),
            _ => Ok(self.bare_kind()),
        }
    }

    pub(crate) fn time_unit(&self) -> Option<TimeUnit> {
        match self.meaning {
            Meaning::Time { unit, .. } => Some(unit),
            _ => None,
        }
    }

    pub(crate) fn is_time_of_day(&self) -> bool {
        matches!(self.kind, DataType::Time32(_) | DataType::Time64(_))
    }

    /// Values of some rows.
    pub(crate) fn values(&self, rows: Range<usize>) -> ScalarBuffer<f64> {
        let parts = self.parts(rows.clone());
        if let &[(chunk, ref part)] = parts.as_slice()
            && self.kind == DataType::Float64
            && self.chunks[chunk].null_count() == 0
        {
            return self.chunks[chunk].as_primitive::<Float64Type>().values().slice(part.start, part.len());
        }
        let mut out = Vec::with_capacity(rows.len());
        for (chunk, part) in parts {
            self.read(chunk, part, &mut out);
        }
        out.into()
    }

    /// The chunks that hold some rows, and the rows in each.
    fn parts(&self, rows: Range<usize>) -> Vec<(usize, Range<usize>)> {
        let first = self.starts.partition_point(|&start| start <= rows.start).saturating_sub(1);
        (first..self.chunks.len())
            .take_while(|&chunk| self.starts[chunk] < rows.end)
            .map(|chunk| {
                let (start, length) = (self.starts[chunk], self.chunks[chunk].len());
                (chunk, rows.start.saturating_sub(start)..(rows.end - start).min(length))
            })
            .filter(|(_, part)| !part.is_empty())
            .collect()
    }

    fn read(&self, chunk: usize, rows: Range<usize>, out: &mut Vec<f64>) {
        let array = &self.chunks[chunk];
        macro_rules! read {
            ($kind:ty, $convert:expr) => {
                numbers::<$kind>(array, rows, out, $convert)
            };
        }
        match &self.kind {
            DataType::Int8 => read!(Int8Type, f64::from),
            DataType::Int16 => read!(Int16Type, f64::from),
            DataType::Int32 => read!(Int32Type, f64::from),
            DataType::Int64 => read!(Int64Type, |value| value as f64),
            DataType::UInt8 => read!(UInt8Type, f64::from),
            DataType::UInt16 => read!(UInt16Type, f64::from),
            DataType::UInt32 => read!(UInt32Type, f64::from),
            DataType::UInt64 => read!(UInt64Type, |value| value as f64),
            DataType::Float16 => read!(Float16Type, f64::from),
            DataType::Float32 => read!(Float32Type, f64::from),
            DataType::Float64 => read!(Float64Type, |value| value),
            DataType::Decimal32(_, scale) => read!(Decimal32Type, |value| f64::from(value) / tens(*scale)),
            DataType::Decimal64(_, scale) => read!(Decimal64Type, |value| value as f64 / tens(*scale)),
            DataType::Decimal128(_, scale) => read!(Decimal128Type, |value| value as f64 / tens(*scale)),
            DataType::Decimal256(_, scale) => {
                read!(Decimal256Type, |value| value.to_string().parse().unwrap_or(f64::NAN) / tens(*scale))
            }
            DataType::Boolean => booleans(array.as_boolean(), rows, out),
            _ => self.read_others(chunk, rows, out),
        }
    }

    /// Times, texts, and columns without values.
    fn read_others(&self, chunk: usize, rows: Range<usize>, out: &mut Vec<f64>) {
        match self.meaning {
            Meaning::Time { unit, days } => {
                let mut counts = Vec::with_capacity(rows.len());
                self.counts(chunk, rows, &mut counts);
                let per_second = 1_000_000_000 / unit.nanoseconds();
                let each = if days { DAY_SECONDS as f64 } else { 1.0 };
                // Split so that the fraction keeps its digits as far as f64 goes.
                out.extend(counts.into_iter().map(|count| match count {
                    MISSING => f64::NAN,
                    _ => (count / per_second) as f64 * each + (count % per_second) as f64 / per_second as f64,
                }));
            }
            Meaning::Text => {
                let codes = self.categories().codes.get(chunk).and_then(|codes| codes.get(rows)).unwrap_or_default();
                out.extend(codes.iter().map(|&code| if code == NONE { f64::NAN } else { f64::from(code) }));
            }
            _ => out.resize(out.len() + rows.len(), f64::NAN),
        }
    }

    /// Whole numbers of some rows.
    pub(crate) fn integers(&self, rows: Range<usize>) -> Option<ScalarBuffer<i64>> {
        if !matches!(self.meaning, Meaning::Integer | Meaning::Time { .. }) {
            return None;
        }
        let days = matches!(self.meaning, Meaning::Time { days: true, .. });
        let parts = self.parts(rows.clone());
        if let &[(chunk, ref part)] = parts.as_slice()
            && self.kind == DataType::Int64
            && self.chunks[chunk].null_count() == 0
        {
            return Some(self.chunks[chunk].as_primitive::<Int64Type>().values().slice(part.start, part.len()));
        }
        let mut out = Vec::with_capacity(rows.len());
        for (chunk, part) in parts {
            self.counts(chunk, part, &mut out);
        }
        if days {
            for value in out.iter_mut().filter(|value| **value != MISSING) {
                *value *= DAY_SECONDS;
            }
        }
        Some(out.into())
    }

    /// Whole numbers as they are stored.
    fn counts(&self, chunk: usize, rows: Range<usize>, out: &mut Vec<i64>) {
        let array = &self.chunks[chunk];
        macro_rules! read {
            ($kind:ty) => {
                whole::<$kind>(array, rows, out, |value| i64::try_from(value).unwrap_or(MISSING))
            };
        }
        use ArrowUnit::{Microsecond, Millisecond, Nanosecond, Second};
        match &self.kind {
            DataType::Int8 => read!(Int8Type),
            DataType::Int16 => read!(Int16Type),
            DataType::Int32 => read!(Int32Type),
            DataType::Int64 => read!(Int64Type),
            DataType::UInt8 => read!(UInt8Type),
            DataType::UInt16 => read!(UInt16Type),
            DataType::UInt32 => read!(UInt32Type),
            DataType::UInt64 => read!(UInt64Type),
            DataType::Date32 => read!(Date32Type),
            DataType::Date64 => read!(Date64Type),
            DataType::Time32(Second) => read!(Time32SecondType),
            DataType::Time32(_) => read!(Time32MillisecondType),
            DataType::Time64(Microsecond) => read!(Time64MicrosecondType),
            DataType::Time64(_) => read!(Time64NanosecondType),
            DataType::Timestamp(Second, _) => read!(TimestampSecondType),
            DataType::Timestamp(Millisecond, _) => read!(TimestampMillisecondType),
            DataType::Timestamp(Microsecond, _) => read!(TimestampMicrosecondType),
            DataType::Timestamp(Nanosecond, _) => read!(TimestampNanosecondType),
            DataType::Duration(Second) => read!(DurationSecondType),
            DataType::Duration(Millisecond) => read!(DurationMillisecondType),
            DataType::Duration(Microsecond) => read!(DurationMicrosecondType),
            DataType::Duration(Nanosecond) => read!(DurationNanosecondType),
            _ => out.resize(out.len() + rows.len(), MISSING),
        }
    }

    fn categories(&self) -> &Categories {
        self.categories.get_or_init(|| categories(&self.chunks))
    }
}

fn tens(scale: i8) -> f64 {
    10f64.powi(i32::from(scale))
}

fn numbers<T: ArrowPrimitiveType>(
    array: &ArrayRef,
    rows: Range<usize>,
    out: &mut Vec<f64>,
    convert: impl Fn(T::Native) -> f64,
) {
    let array: &PrimitiveArray<T> = array.as_primitive();
    let values = &array.values()[rows.clone()];
    match array.nulls().filter(|nulls| nulls.null_count() > 0) {
        None => out.extend(values.iter().map(|&value| convert(value))),
        Some(nulls) => out.extend(values.iter().zip(rows).map(|(&value, row)| match nulls.is_valid(row) {
            true => convert(value),
            false => f64::NAN,
        })),
    }
}

fn whole<T: ArrowPrimitiveType>(
    array: &ArrayRef,
    rows: Range<usize>,
    out: &mut Vec<i64>,
    convert: impl Fn(T::Native) -> i64,
) {
    let array: &PrimitiveArray<T> = array.as_primitive();
    out.extend(rows.map(|row| if array.is_null(row) { MISSING } else { convert(array.value(row)) }));
}

fn booleans(array: &BooleanArray, rows: Range<usize>, out: &mut Vec<f64>) {
    out.extend(rows.map(|row| match (array.is_null(row), array.value(row)) {
        (true, _) => f64::NAN,
        (false, value) => f64::from(u8::from(value)),
    }));
}

/// The text of each row of an array of texts.
fn texts<'a>(array: &'a ArrayRef) -> Box<dyn Iterator<Item = Option<&'a str>> + 'a> {
    match array.data_type() {
        DataType::Utf8 => Box::new(array.as_string::<i32>().iter()),
        DataType::LargeUtf8 => Box::new(array.as_string::<i64>().iter()),
        DataType::Utf8View => Box::new(array.as_string_view().iter()),
        _ => Box::new(std::iter::repeat_n(None, array.len())),
    }
}

/// The text of each row, or that of its key in the dictionary.
fn coded<'a>(chunk: &'a ArrayRef, mut code: impl FnMut(&'a str) -> u32) -> Vec<u32> {
    if !matches!(chunk.data_type(), DataType::Dictionary(..)) {
        return texts(chunk).map(|text| text.map_or(NONE, &mut code)).collect();
    }
    let dictionary = chunk.as_any_dictionary();
    let values: Vec<Option<&str>> = texts(dictionary.values()).collect();
    if values.is_empty() {
        return vec![NONE; chunk.len()];
    }
    // A name that no row has is none, as in a file: names are looked up when a row has them.
    let mut known: Vec<Option<u32>> = vec![None; values.len()];
    let keys = dictionary.normalized_keys().into_iter().enumerate();
    keys.map(|(row, key)| match (chunk.is_null(row), values[key]) {
        (true, _) | (_, None) => NONE,
        (false, Some(text)) => *known[key].get_or_insert_with(|| code(text)),
    })
    .collect()
}

/// Names and codes of all chunks.
fn categories(chunks: &[ArrayRef]) -> Categories {
    let mut seen: HashMap<&str, u32> = HashMap::new();
    let mut names: Vec<&str> = Vec::new();
    let mut codes: Vec<Vec<u32>> = Vec::with_capacity(chunks.len());
    for chunk in chunks {
        codes.push(coded(chunk, |text| {
            *seen.entry(text).or_insert_with(|| {
                names.push(text);
                names.len() as u32 - 1
            })
        }));
        if names.len() > MAX_CATEGORIES {
            return Categories { names: Vec::new(), codes: Vec::new(), too_many: true };
        }
    }
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by_key(|&place| names[place]);
    let mut ranks = vec![0; names.len()];
    for (rank, &place) in order.iter().enumerate() {
        ranks[place] = rank as u32;
    }
    for code in codes.iter_mut().flatten().filter(|code| **code != NONE) {
        *code = ranks[*code as usize];
    }
    let names = order.into_iter().map(|place| names[place].to_owned()).collect();
    Categories { names, codes, too_many: false }
}
