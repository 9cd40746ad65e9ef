//! Opening Parquet files: metadata, wanted columns, the clock, and the names of categories.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::File,
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    sync::Arc,
};

use fleetfoot_data::{Column, ColumnKind, Silent, parallel_map};
use fleetfoot_output::arrow_schema;
use parquet::{
    errors::ParquetError,
    file::metadata::{PageIndexPolicy, ParquetMetaData, ParquetMetaDataReader},
};

use super::{
    buffers::Buffers,
    chunk::FileBytes,
    clock::{find_clock, no_clock},
    cursors::Cursors,
    file::{ParquetFile, check_chunks, damaged},
    footer,
    leaf::{Leaf, Meaning, Rule, elements, leaves},
    rows::ParquetTable,
};
use crate::{
    Error, Selection, TimeSpec, TimeUnit,
    by_name::ByName,
    cycles::Cycle,
    opened::Opened,
    table::{MAX_CATEGORIES, TableColumn},
    time_column::{Agreed, Clock},
};

/// Rows decoded at a time when texts are collected.
const BATCH: usize = 8192;
/// More rows than any log has; a count beyond it is a lie.
const MAX_ROWS: usize = 1 << 40;

/// Description of a file, without reading its rows.
pub(crate) struct Description {
    pub rows: usize,
    /// All leaves: the column, and `Err` with the type of an unsupported one.
    pub columns: Vec<(Column, Result<(), String>)>,
    pub clock: Option<Clock>,
}

/// Describes a file: columns, rows, clock.
pub(crate) fn describe(path: &Path) -> Result<Description, Error> {
    let (file, leaves) = load(path, &Arc::default())?;
    let rows = check_rows(&file)?.0;
    let clock = find_clock(&file, &leaves, &TimeSpec::Auto);
    let columns = leaves
        .iter()
        .map(|leaf| {
            let support = match &leaf.meaning {
                Meaning::Unsupported(kind) => Err(kind.clone()),
                _ => Ok(()),
            };
            (Column { name: leaf.name.clone(), unit: leaf.unit.clone(), kind: leaf.kind() }, support)
        })
        .collect();
    Ok(Description { rows, columns, clock })
}

/// A text stored in a file's metadata.
pub(crate) fn key_value(path: &Path, key: &str) -> Result<Option<String>, Error> {
    let (file, _) = load(path, &Arc::default())?;
    let pairs = file.metadata.file_metadata().key_value_metadata();
    Ok(pairs.and_then(|pairs| pairs.iter().find(|pair| pair.key == key)).and_then(|pair| pair.value.clone()))
}

/// All texts stored in a file's metadata, by their keys.
pub(crate) fn metadata(path: &Path) -> Result<BTreeMap<String, String>, Error> {
    let (file, _) = load(path, &Arc::default())?;
    let pairs = file.metadata.file_metadata().key_value_metadata().into_iter().flatten();
    Ok(pairs.filter_map(|pair| Some((pair.key.clone(), pair.value.clone()?))).collect())
}

/// Opens a file for reading the selected columns.
pub(crate) fn open(
    path: &Path,
    selection: &Selection,
    agreed: &Agreed,
    cursors: &Arc<Cursors>,
) -> Result<Opened, Error> {
    let (file, all) = load(path, &cursors.buffers)?;
    let (rows, starts) = check_rows(&file)?;
    let mut columns = Vec::with_capacity(selection.columns.len());
    let mut wanted = Vec::with_capacity(selection.columns.len());
    let names = ByName::new(all.iter().map(|leaf| leaf.name.as_str()));
    for name in &selection.columns {
        let leaf = find(path, &all, &names, name)?;
        check_chunks(&file, leaf)?;
        let mut rule = Rule::new(leaf, TimeUnit::Seconds);
        let mut kind = leaf.kind();
        let mut empty = false;
        if leaf.meaning == Meaning::Text {
            rule.names = collect_texts(&file, leaf)?;
            empty = rule.names.is_empty();
            kind = ColumnKind::Category(rule.names.clone());
        }
        columns.push(TableColumn { column: Column { name: name.clone(), unit: leaf.unit.clone(), kind }, empty });
        wanted.push((leaf.index, rule));
    }
    let clock = open_clock(&file, &all, &names, &selection.time)?;
    let clock = clock.map(|clock| clock.settle(path, agreed, selection)).transpose()?;
    let notes = clock.iter().filter_map(|clock| clock.assumed.clone()).collect();
    let mut time: Vec<(usize, Rule)> = Vec::new();
    for (column, unit) in clock.iter().flat_map(|clock| clock.parts()) {
        let leaf = &all[column];
        check_chunks(&file, leaf)?;
        time.push((leaf.index, Rule::new(leaf, unit)));
    }
    // Beside a date, a time of the day passes no midnight.
    let cycle = match &time[..] {
        [(_, Rule { meaning: Meaning::Text | Meaning::Time { of_day: true, .. }, .. })] => Cycle::Day,
        [(_, Rule { meaning: Meaning::Integer { .. } | Meaning::Float, unit, .. })] => Cycle::Counter(*unit),
        _ => Cycle::Never,
    };
    let gps_weeks = clock.as_ref().is_some_and(|clock| clock.gps_weeks);
    let table = ParquetTable {
        file,
        cursors: cursors.clone(),
        number: cursors.new_file(),
        rows,
        starts,
        columns,
        time,
        gps_weeks,
        leaves: wanted,
    };
    Ok(Opened { cycle, ..Opened::of_table(Box::new(table), clock, notes) })
}

/// The clock of a file, as far as its first rows tell; `None` where it has none.
pub(crate) fn clock(path: &Path, spec: &TimeSpec) -> Result<Option<Clock>, Error> {
    let (file, leaves) = load(path, &Arc::default())?;
    Ok(find_clock(&file, &leaves, spec))
}

fn open_clock(file: &ParquetFile, all: &[Leaf], names: &ByName<'_>, spec: &TimeSpec) -> Result<Option<Clock>, Error> {
    if matches!(spec, TimeSpec::Uniform { .. }) {
        return Ok(None);
    }
    if let TimeSpec::Column { name, .. } = spec {
        let leaf = find(&file.path, all, names, name)?;
        check_chunks(file, leaf)?;
    }
    match find_clock(file, all, spec) {
        None if !matches!(spec, TimeSpec::Dispensable { .. }) => Err(no_clock(file, all)),
        clock => Ok(clock),
    }
}

fn find<'a>(path: &Path, all: &'a [Leaf], names: &ByName<'_>, name: &str) -> Result<&'a Leaf, Error> {
    let leaf = &all[names.find(path, name)?];
    match &leaf.meaning {
        Meaning::Unsupported(kind) => {
            Err(Error::UnsupportedColumn { path: path.into(), column: name.into(), kind: kind.clone() })
        }
        _ => Ok(leaf),
    }
}

fn load(path: &Path, buffers: &Arc<Buffers>) -> Result<(ParquetFile, Vec<Leaf>), Error> {
    let io = |source| Error::Io { path: path.into(), action: "read", source };
    let file = File::open(path).map_err(io)?;
    let info = file.metadata().map_err(io)?;
    let length = info.len();
    let bytes = footer::read(path, &file, length)?;
    let metadata = caught(|| ParquetMetaDataReader::decode_metadata(&bytes))
        .map_err(|problem| damaged(path, "its footer", problem))?;
    let metadata =
        Arc::new(with_pages(metadata, &FileBytes { file: Arc::new(file), length, buffers: buffers.clone() }));
    let schema = metadata.file_metadata();
    // The Arrow schema only adds units and durations; a file without a valid one is read without them.
    let pairs = schema.key_value_metadata().into_iter().flatten();
    let text = pairs.filter(|pair| pair.key == arrow_schema::KEY).find_map(|pair| pair.value.as_deref());
    let leaves = leaves(schema.schema_descr(), &text.map(arrow_schema::fields).unwrap_or_default());
    let leaves = leaves.into_iter().flat_map(|leaf| elements(leaf, &metadata)).collect();
    let file = ParquetFile {
        path: path.into(),
        metadata: metadata.clone(),
        length,
        modified: info.modified().ok(),
        buffers: buffers.clone(),
    };
    Ok((file, leaves))
}

/// The metadata with the offset index, which tells where pages are, when the file has a sound one.
fn with_pages(metadata: ParquetMetaData, file: &FileBytes) -> ParquetMetaData {
    // The index is an aid: without it, page headers are walked.
    let indexed = caught(|| {
        let mut reader = ParquetMetaDataReader::new_with_metadata(metadata.clone())
            .with_column_index_policy(PageIndexPolicy::Skip)
            .with_offset_index_policy(PageIndexPolicy::Optional);
        reader.read_page_indexes(file)?;
        reader.finish()
    });
    indexed.unwrap_or(metadata)
}

/// Runs a decoder of the `parquet` crate; errors and panics become a text.
fn caught<R>(work: impl FnOnce() -> Result<R, ParquetError>) -> Result<R, String> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(result) => result.map_err(|error| error.to_string()),
        Err(_) => Err("it cannot be decoded".into()),
    }
}

/// All rows, and the first row of each row group.
fn check_rows(file: &ParquetFile) -> Result<(usize, Vec<usize>), Error> {
    let mut starts = Vec::with_capacity(file.metadata.num_row_groups());
    let mut rows = 0usize;
    for (number, group) in file.metadata.row_groups().iter().enumerate() {
        starts.push(rows);
        let row_count = usize::try_from(group.num_rows()).ok().filter(|&row_count| row_count <= MAX_ROWS);
        rows =
            row_count.and_then(|row_count| rows.checked_add(row_count)).filter(|&rows| rows <= MAX_ROWS).ok_or_else(
                || damaged(&file.path, format!("row group {number}"), format!("it claims {} rows", group.num_rows())),
            )?;
    }
    Ok((rows, starts))
}

/// The sorted different texts of a column.
fn collect_texts(file: &ParquetFile, leaf: &Leaf) -> Result<Vec<String>, Error> {
    let bytes = file.reopen()?;
    let groups = parallel_map(file.metadata.num_row_groups(), &Silent, |group| {
        let mut decoder = file.decoder(&bytes, leaf.index, group)?;
        let mut texts: BTreeSet<Vec<u8>> = BTreeSet::new();
        let (mut row, rows) = (0, file.group_rows(group));
        while row < rows {
            let count = BATCH.min(rows - row);
            file.guarded(leaf.index, group, || {
                decoder.texts(count, |text| {
                    if texts.len() <= MAX_CATEGORIES && !texts.contains(text) {
                        texts.insert(text.to_vec());
                    }
                })
            })?;
            row += count;
        }
        Ok::<_, Error>(texts)
    })?;
    let all: BTreeSet<Vec<u8>> = groups.into_iter().flatten().collect();
    if all.len() > MAX_CATEGORIES {
        return Err(Error::TooManyCategories {
            path: file.path.clone(),
            column: leaf.name.clone(),
            limit: MAX_CATEGORIES,
        });
    }
    let texts: Result<Vec<String>, _> = all.into_iter().map(String::from_utf8).collect();
    texts.map_err(|_| damaged(&file.path, format!("column `{}`", leaf.name), "its texts are not UTF-8"))
}
