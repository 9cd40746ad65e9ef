//! Decoded columns kept as Parquet, so that the next command on the same files need not decode again.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

use fleetfoot_data::{Column, ColumnKind, ScalarBuffer};
use fleetfoot_output::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions};
use serde::{Deserialize, Serialize};

use crate::{
    Cache, Error, Selection, Stamp, TimeSpec, TimeUnit,
    breaks::Breaks,
    parquet,
    table::{Table, TableColumn, TableRows},
    time_column::Agreed,
};

/// Changes with what is stored and with how it is computed from the same file: an older cache is not read.
const VERSION: &str = "fleetfoot decoded columns 2";
/// The column of the stamps; no field of a message has a name with a space.
const STAMP: &str = "stamp of the row";
/// The metadata's key.
const META: &str = "fleetfoot.decoded";

/// Metadata stored beside the columns.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Meta {
    pub columns: Vec<TableColumn>,
    pub notes: Vec<String>,
    /// The clock.
    pub stamp: Option<Stamp>,
    /// Offset to add to the stamps for the log's times, nanoseconds.
    pub log_offset: i64,
    /// Breaks at which samples of the base are known to be lost.
    pub breaks: Breaks,
}

/// A place in the cache for the columns of one recording.
pub(super) struct Slot {
    path: PathBuf,
}

/// The place for these files read this way; `None` when they are not to be kept. Reads the files once, for their hash.
pub(super) fn slot(files: &[PathBuf], selection: &Selection) -> Result<Option<Slot>, Error> {
    let Some(Cache { folder, least_bytes }) = &selection.join.cache else { return Ok(None) };
    let mut bytes = 0;
    for file in files {
        let io = |source| Error::Io { path: file.clone(), action: "read", source };
        bytes += fs::metadata(file).map_err(io)?.len();
    }
    if bytes < *least_bytes {
        return Ok(None);
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update(VERSION.as_bytes()).update(env!("CARGO_PKG_VERSION").as_bytes());
    for file in files {
        let mut hash = blake3::Hasher::new();
        fs::File::open(file)
            .and_then(|mut opened| std::io::copy(&mut opened, &mut hash))
            .map_err(|source| Error::Io { path: file.clone(), action: "read", source })?;
        hasher.update(hash.finalize().as_bytes());
    }
    let join = &selection.join;
    let key = (
        &selection.time,
        &selection.columns,
        &join.stamp,
        &join.base,
        &join.columns,
        join.reorder_seconds.to_bits(),
        &join.renames,
        &join.clocks,
    );
    hasher.update(format!("{key:?}").as_bytes());
    let name = format!("{}.parquet", &hasher.finalize().to_hex()[..32]);
    Ok(Some(Slot { path: folder.join(name) }))
}

impl Slot {
    /// Returns true if the cache file exists.
    pub(super) fn exists(&self) -> bool {
        self.path.exists()
    }

    /// Stored table and metadata, if the file is there and whole.
    pub(super) fn load(&self, cursors: &Arc<parquet::Cursors>) -> Option<(Box<dyn Table>, Meta)> {
        let meta = parquet::key_value(&self.path, META).ok()??;
        let meta = Meta::parse(&meta)?;
        let names = meta.columns.iter().map(|column| column.column.name.clone());
        let selection = Selection {
            time: TimeSpec::Column { name: STAMP.into(), unit: Some(TimeUnit::Nanoseconds) },
            ..Selection::new(names)
        };
        let opened = parquet::open(&self.path, &selection, &Agreed::default(), cursors).ok()?;
        let table = CachedTable { inner: opened.table, columns: meta.columns.clone() };
        Some((Box::new(table), meta))
    }

    /// Begins to store columns of these names.
    pub(super) fn create(&self, columns: &[Column], inputs: &[PathBuf], meta: &Meta) -> Result<SlotWriter, Error> {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(folder).map_err(|source| Error::Io {
            path: folder.into(),
            action: "keep decoded columns in",
            source,
        })?;
        let mut written = vec![WriteColumn::new(STAMP, WriteKind::Stamp)];
        written.extend(columns.iter().map(|column| WriteColumn::new(&column.name, WriteKind::Float)));
        let options = WriteOptions {
            metadata: BTreeMap::from([(META.to_owned(), meta.to_text())]),
            inputs: inputs.to_vec(),
            ..WriteOptions::default()
        };
        Ok(SlotWriter { writer: ParquetWriter::create(&self.path, written, &options)? })
    }
}

/// Stores rows.
pub(super) struct SlotWriter {
    writer: ParquetWriter,
}

impl SlotWriter {
    pub(super) fn push(&mut self, stamps: &[i64], columns: &[Vec<f64>]) -> Result<(), Error> {
        let mut values = vec![Values::Integer(stamps)];
        values.extend(columns.iter().map(|column| Values::Float(column)));
        Ok(self.writer.write(&values)?)
    }

    pub(super) fn finish(self) -> Result<(), Error> {
        Ok(self.writer.finish()?)
    }
}

/// Stored columns, with their kinds.
struct CachedTable {
    inner: Box<dyn Table>,
    columns: Vec<TableColumn>,
}

impl Table for CachedTable {
    fn rows(&self) -> usize {
        self.inner.rows()
    }

    fn columns(&self) -> &[TableColumn] {
        &self.columns
    }

    fn pieces(&self) -> Vec<std::ops::Range<usize>> {
        self.inner.pieces()
    }

    fn stamps(&self, rows: std::ops::Range<usize>) -> Result<ScalarBuffer<i64>, Error> {
        self.inner.stamps(rows)
    }

    fn values(&self, rows: std::ops::Range<usize>, keep: usize) -> Result<TableRows, Error> {
        self.inner.values(rows, keep)
    }
}

/// [`Meta`] as it is stored.
#[derive(Serialize, Deserialize)]
struct Stored {
    columns: Vec<StoredColumn>,
    notes: Vec<String>,
    stamp: Option<String>,
    log_offset: i64,
    #[serde(default)]
    breaks: Vec<i64>,
}

#[derive(Serialize, Deserialize)]
struct StoredColumn {
    name: String,
    kind: StoredKind,
    /// Of a category.
    names: Option<Vec<String>>,
    empty: bool,
    unit: Option<String>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum StoredKind {
    Float,
    Integer,
    Boolean,
    Category,
}

impl From<&TableColumn> for StoredColumn {
    fn from(TableColumn { column, empty }: &TableColumn) -> Self {
        let (kind, names) = match &column.kind {
            ColumnKind::Float => (StoredKind::Float, None),
            ColumnKind::Integer => (StoredKind::Integer, None),
            ColumnKind::Boolean => (StoredKind::Boolean, None),
            ColumnKind::Category(names) => (StoredKind::Category, Some(names.clone())),
        };
        Self { name: column.name.clone(), kind, names, empty: *empty, unit: column.unit.clone() }
    }
}

impl StoredColumn {
    fn column(self) -> Option<TableColumn> {
        let kind = match self.kind {
            StoredKind::Float => ColumnKind::Float,
            StoredKind::Integer => ColumnKind::Integer,
            StoredKind::Boolean => ColumnKind::Boolean,
            StoredKind::Category => ColumnKind::Category(self.names?),
        };
        Some(TableColumn { column: Column { name: self.name, unit: self.unit, kind }, empty: self.empty })
    }
}

impl Meta {
    fn to_text(&self) -> String {
        let stored = Stored {
            columns: self.columns.iter().map(StoredColumn::from).collect(),
            notes: self.notes.clone(),
            stamp: self.stamp.map(|stamp| stamp.name().to_owned()),
            log_offset: self.log_offset,
            breaks: self.breaks.moments().to_vec(),
        };
        serde_json::to_string(&stored).unwrap_or_default()
    }

    fn parse(text: &str) -> Option<Self> {
        let stored: Stored = serde_json::from_str(text).ok()?;
        Some(Self {
            columns: stored.columns.into_iter().map(StoredColumn::column).collect::<Option<_>>()?,
            notes: stored.notes,
            stamp: Stamp::parse(&stored.stamp?),
            log_offset: stored.log_offset,
            breaks: Breaks::new(&stored.breaks, 0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_beside_the_columns_reads_back() {
        let column =
            |name: &str, kind| TableColumn { column: Column { name: name.into(), unit: None, kind }, empty: false };
        let with_unit = Column { name: "/a.v".into(), unit: Some("m/s".into()), kind: ColumnKind::Float };
        let meta = Meta {
            columns: vec![
                column("/a.x", ColumnKind::Float),
                column("/a.s", ColumnKind::Category(vec!["up".into(), "\"odd\"".into()])),
                column("/a.n", ColumnKind::Integer),
                column("/a.b", ColumnKind::Boolean),
                TableColumn { column: with_unit, empty: false },
            ],
            notes: vec!["one".into()],
            stamp: Some(Stamp::Header),
            log_offset: -1_700_000_000_123_456_789,
            breaks: Breaks::new(&[-5, 1_700_000_000_123_456_789], 0),
        };
        assert_eq!(Meta::parse(&meta.to_text()), Some(meta));
        assert_eq!(Meta::parse("{}"), None);
    }
}
