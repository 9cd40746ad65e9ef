//! Properties of a column that need no reading, and the range of its values once it was read.

use fleetfoot_data::ColumnKind;
use serde::{Serialize, Serializer};

/// A column of a file.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ColumnInfo {
    /// Its name.
    pub name: String,
    /// Unit in the file, if there is one.
    pub unit: Option<String>,
    /// Type of its values. Categories have names only when the values were scanned; text files are judged by their
    /// first rows otherwise.
    #[serde(flatten, serialize_with = "kind")]
    pub kind: ColumnKind,
    /// The type of a column that cannot be read as numbers.
    #[serde(rename = "unreadable")]
    pub unsupported: Option<String>,
    /// Range of the values; only when they were scanned.
    pub statistics: Option<ColumnStatistics>,
}

/// An array that is too long for its elements to be listed among the columns: they are columns all the same, `NAME[0]` and on.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct ArrayInfo {
    /// Its name.
    pub name: String,
    /// Elements of the longest one that was seen.
    pub longest: usize,
}

impl std::fmt::Display for ArrayInfo {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { name, longest } = self;
        write!(f, "{name}: up to {longest} elements, not listed; name the wanted ones, e.g. {name}[0]")
    }
}

/// The range of a column's values, in the column's unit (codes for categories).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ColumnStatistics {
    /// Values that are there.
    pub count: usize,
    /// Values that are missing (NaN).
    pub missing: usize,
    /// The smallest; NaN without values.
    pub min: f64,
    /// The mean; NaN without values.
    pub mean: f64,
    /// The largest; NaN without values.
    pub max: f64,
}

/// `kind`, and of text the `names` of its values where they are known.
fn kind<S: Serializer>(kind: &ColumnKind, to: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Named<'a> {
        kind: &'a str,
        names: Option<&'a [String]>,
    }
    let (kind, names) = match kind {
        ColumnKind::Float => ("float", None),
        ColumnKind::Integer => ("integer", None),
        ColumnKind::Boolean => ("boolean", None),
        ColumnKind::Category(names) => ("text", Some(names.as_slice()).filter(|names| !names.is_empty())),
    };
    Named { kind, names }.serialize(to)
}
