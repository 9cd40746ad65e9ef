//! File formats, by name and by content.

use std::path::Path;

/// What is readable, for messages.
pub(crate) const KNOWN: &str = ".parquet, .csv, .tsv, .txt, and the text ones with .gz or .zst";

/// A readable file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Apache Parquet.
    Parquet,
    /// Delimited text.
    Csv(Compression),
}

/// How a text file is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Compression {
    /// Not at all.
    None,
    /// gzip, one or several members.
    Gzip,
    /// Zstandard, one or several frames.
    Zstd,
}

impl Format {
    /// The format that a file's name tells.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let (stem, compression) = match name.rsplit_once('.') {
            Some((stem, "gz")) => (stem, Compression::Gzip),
            Some((stem, "zst" | "zstd")) => (stem, Compression::Zstd),
            _ => (name.as_str(), Compression::None),
        };
        match (stem.rsplit_once('.')?.1, compression) {
            ("parquet" | "pq", Compression::None) => Some(Self::Parquet),
            ("csv" | "tsv" | "txt", compression) => Some(Self::Csv(compression)),
            _ => None,
        }
    }

    /// A word for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parquet => "Parquet",
            Self::Csv(Compression::None) => "CSV",
            Self::Csv(Compression::Gzip) => "CSV (gzip)",
            Self::Csv(Compression::Zstd) => "CSV (zstd)",
        }
    }
}
