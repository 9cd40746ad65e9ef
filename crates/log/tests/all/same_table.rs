//! A table is the same numbers as Parquet and as CSV: for all types, encodings, pages, row groups, columns read beside
//! it, and steps.

use std::{fs::File, ops::Range, path::Path, sync::Arc};

use fleetfoot_data::{ColumnKind, Halo, Source};
use fleetfoot_log::{MaxGap, Recording, Selection, open};
use parquet::{
    basic::{Compression, Encoding, LogicalType, Repetition, TimeUnit, Type as Physical, ZstdLevel},
    data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, FloatType, Int32Type, Int64Type},
    errors::ParquetError,
    file::{
        properties::{WriterProperties, WriterVersion},
        writer::{SerializedColumnWriter, SerializedFileWriter},
    },
    schema::types::{ColumnPath, Type},
};
use proptest::{collection::vec, prelude::*, sample::select};

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Double,
    Single,
    Small,
    Unsigned,
    Whole,
    Truth,
    Text,
    Stamp,
}

/// Format of the clock.
#[derive(Debug, Clone, Copy)]
enum ClockKind {
    Seconds,
    Nanoseconds,
    Stamp,
    Text,
}

#[derive(Debug, Clone)]
struct OneColumn {
    kind: Kind,
    /// One value in so many is missing; none with 0.
    missing: usize,
    encoding: Option<Encoding>,
    codec: Compression,
}

#[derive(Debug, Clone)]
struct OneTable {
    rows: usize,
    group: usize,
    page: usize,
    version: WriterVersion,
    clock: ClockKind,
    columns: Vec<OneColumn>,
    /// Columns to read, by their places; the clock comes first and may be one of them.
    read: Vec<usize>,
    step: usize,
    halo: usize,
}

const NAMES: [&str; 3] = ["sand", "grass", "deep water"];

fn is_missing(column: &OneColumn, row: usize) -> bool {
    column.missing > 0 && row % column.missing == column.missing - 1
}

/// The value of a column in a row: the number that every reader must give, and its text; of texts the code among the sorted names.
fn value(column: &OneColumn, place: usize, row: usize) -> (f64, String) {
    let wave = ((row * (place + 3)) as f64 * 0.013).sin();
    let number = |value: f64| (value, value.to_string());
    match column.kind {
        Kind::Double => number(wave * 1e3),
        Kind::Single => number(f64::from(wave as f32)),
        Kind::Small => number(((wave * 1e9) as i32).into()),
        Kind::Unsigned => number(f64::from((row as u32).wrapping_mul(2_654_435_761))),
        Kind::Whole => number((wave * 9e15) as i64 as f64),
        Kind::Truth => (f64::from(u8::from(row.is_multiple_of(3))), row.is_multiple_of(3).to_string()),
        Kind::Text => {
            let name = NAMES[row / 5 % 3];
            (NAMES.iter().filter(|other| **other < name).count() as f64, name.to_owned())
        }
        Kind::Stamp => (row as f64 * 0.25, (row as f64 * 0.25).to_string()),
    }
}

/// The stamp of a row, nanoseconds: 50 ms a row, since the log's begin or since 1970.
fn stamp(clock: ClockKind, row: usize) -> i64 {
    let since = row as i64 * 50_000_000;
    match clock {
        ClockKind::Seconds | ClockKind::Nanoseconds => since,
        ClockKind::Stamp | ClockKind::Text => 1_700_000_000_000_000_000 + since,
    }
}

fn clock_text(clock: ClockKind, row: usize) -> String {
    match clock {
        ClockKind::Seconds => (row as f64 * 0.05).to_string(),
        ClockKind::Nanoseconds => stamp(clock, row).to_string(),
        ClockKind::Stamp | ClockKind::Text => {
            let (second, part) = (row / 20, row % 20 * 50);
            let (hour, minute, second) = (22 + second / 3600, 13 + second / 60 % 60, 20 + second % 60);
            let (minute, second) = (minute + second / 60, second % 60);
            let (hour, minute) = (hour + minute / 60, minute % 60);
            format!("2023-11-{:02}T{:02}:{minute:02}:{second:02}.{part:03}Z", 14 + hour / 24, hour % 24)
        }
    }
}

/// The clock's values as a column.
fn clock_value(clock: ClockKind, row: usize) -> f64 {
    match clock {
        ClockKind::Seconds => row as f64 * 0.05,
        ClockKind::Nanoseconds => stamp(clock, row) as f64,
        ClockKind::Stamp | ClockKind::Text => {
            let stamp = stamp(clock, row);
            format!("{}.{:09}", stamp / 1_000_000_000, stamp % 1_000_000_000).parse().unwrap()
        }
    }
}

impl OneTable {
    fn clock_type(&self) -> Type {
        let (physical, logical) = match self.clock {
            ClockKind::Seconds => (Physical::DOUBLE, None),
            ClockKind::Nanoseconds => (Physical::INT64, None),
            ClockKind::Stamp | ClockKind::Text => {
                (Physical::INT64, Some(LogicalType::timestamp(true, TimeUnit::MICROS)))
            }
        };
        let builder = Type::primitive_type_builder(self.clock_name(), physical).with_repetition(Repetition::REQUIRED);
        builder.with_logical_type(logical).build().unwrap()
    }

    fn clock_name(&self) -> &'static str {
        if matches!(self.clock, ClockKind::Nanoseconds) { "t_ns" } else { "t" }
    }

    fn schema(&self) -> Type {
        let field = |(place, column): (usize, &OneColumn)| {
            let (physical, logical) = match column.kind {
                Kind::Double => (Physical::DOUBLE, None),
                Kind::Single => (Physical::FLOAT, None),
                Kind::Small => (Physical::INT32, None),
                Kind::Unsigned => (Physical::INT32, Some(LogicalType::integer(32, false))),
                Kind::Whole => (Physical::INT64, None),
                Kind::Truth => (Physical::BOOLEAN, None),
                Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
                Kind::Stamp => (Physical::INT64, Some(LogicalType::timestamp(false, TimeUnit::MILLIS))),
            };
            let name = format!("c{place}");
            let builder = Type::primitive_type_builder(&name, physical);
            Arc::new(builder.with_repetition(Repetition::OPTIONAL).with_logical_type(logical).build().unwrap())
        };
        let fields = [Arc::new(self.clock_type())].into_iter().chain(self.columns.iter().enumerate().map(field));
        Type::group_type_builder("schema").with_fields(fields.collect()).build().unwrap()
    }

    fn properties(&self) -> WriterProperties {
        let mut builder = WriterProperties::builder()
            .set_writer_version(self.version)
            .set_data_page_size_limit(self.page)
            .set_data_page_row_count_limit(self.page)
            .set_write_batch_size(self.page.min(1024));
        for (place, column) in self.columns.iter().enumerate() {
            let path = ColumnPath::from(format!("c{place}"));
            builder = builder.set_column_compression(path.clone(), column.codec);
            builder = builder.set_column_dictionary_enabled(path.clone(), column.encoding.is_none());
            if let Some(encoding) = column.encoding {
                builder = builder.set_column_encoding(path, encoding);
            }
        }
        builder.build()
    }

    fn write_parquet(&self, path: &Path) -> Result<(), ParquetError> {
        let file = File::create(path).unwrap();
        let mut writer = SerializedFileWriter::new(file, Arc::new(self.schema()), Arc::new(self.properties()))?;
        for from in (0..self.rows).step_by(self.group) {
            let rows = from..(from + self.group).min(self.rows);
            let mut group = writer.next_row_group()?;
            let mut clock = group.next_column()?.unwrap();
            match self.clock {
                ClockKind::Seconds => {
                    let values: Vec<f64> = rows.clone().map(|row| clock_value(self.clock, row)).collect();
                    clock.typed::<DoubleType>().write_batch(&values, None, None)?;
                }
                kind => {
                    let count = if matches!(kind, ClockKind::Nanoseconds) { 1 } else { 1000 };
                    let values: Vec<i64> = rows.clone().map(|row| stamp(kind, row) / count).collect();
                    clock.typed::<Int64Type>().write_batch(&values, None, None)?;
                }
            }
            clock.close()?;
            for (place, column) in self.columns.iter().enumerate() {
                let mut written = group.next_column()?.unwrap();
                write_column(&mut written, column, place, rows.clone())?;
                written.close()?;
            }
            group.close()?;
        }
        writer.close().map(|_| ())
    }

    fn write_csv(&self, path: &Path) {
        let mut text = self.clock_name().to_owned();
        (0..self.columns.len()).for_each(|place| text += &format!(",c{place}"));
        for row in 0..self.rows {
            text += "\n";
            text += &clock_text(self.clock, row);
            for (place, column) in self.columns.iter().enumerate() {
                text += ",";
                if !is_missing(column, row) {
                    text += &value(column, place, row).1;
                }
            }
        }
        std::fs::write(path, text + "\n").unwrap();
    }

    /// The numbers that every reader must give, one list a column that is read.
    fn expected(&self) -> Vec<Vec<f64>> {
        let one = |column: usize, row: usize| match column.checked_sub(1) {
            None => clock_value(self.clock, row),
            Some(place) if is_missing(&self.columns[place], row) => f64::NAN,
            Some(place) => value(&self.columns[place], place, row).0,
        };
        self.read.iter().map(|&column| (0..self.rows).map(|row| one(column, row)).collect()).collect()
    }

    fn selection(&self) -> Selection {
        let name = |&column: &usize| match column.checked_sub(1) {
            None => self.clock_name().to_owned(),
            Some(place) => format!("c{place}"),
        };
        Selection { max_gap: MaxGap::Unlimited, ..Selection::new(self.read.iter().map(name)) }
    }
}

fn write_column(
    written: &mut SerializedColumnWriter<'_>,
    column: &OneColumn,
    place: usize,
    rows: Range<usize>,
) -> Result<(), ParquetError> {
    let levels: Vec<i16> = rows.clone().map(|row| i16::from(!is_missing(column, row))).collect();
    let there = || rows.clone().filter(|&row| !is_missing(column, row)).map(|row| (row, value(column, place, row)));
    let levels = Some(levels.as_slice());
    match column.kind {
        Kind::Double => {
            let values: Vec<f64> = there().map(|(_, (number, _))| number).collect();
            written.typed::<DoubleType>().write_batch(&values, levels, None)
        }
        Kind::Single => {
            let values: Vec<f32> = there().map(|(_, (number, _))| number as f32).collect();
            written.typed::<FloatType>().write_batch(&values, levels, None)
        }
        Kind::Small | Kind::Unsigned => {
            let values: Vec<i32> = there().map(|(_, (number, _))| number as i64 as u32 as i32).collect();
            written.typed::<Int32Type>().write_batch(&values, levels, None)
        }
        Kind::Whole => {
            let values: Vec<i64> = there().map(|(_, (number, _))| number as i64).collect();
            written.typed::<Int64Type>().write_batch(&values, levels, None)
        }
        Kind::Stamp => {
            let values: Vec<i64> = there().map(|(row, _)| row as i64 * 250).collect();
            written.typed::<Int64Type>().write_batch(&values, levels, None)
        }
        Kind::Truth => {
            let values: Vec<bool> = there().map(|(_, (number, _))| number == 1.0).collect();
            written.typed::<BoolType>().write_batch(&values, levels, None)
        }
        Kind::Text => {
            let values: Vec<ByteArray> = there().map(|(_, (_, text))| text.as_str().into()).collect();
            written.typed::<ByteArrayType>().write_batch(&values, levels, None)
        }
    }
    .map(|_| ())
}

/// The encodings that a kind may have beside a dictionary.
fn encodings(kind: Kind) -> &'static [Encoding] {
    match kind {
        Kind::Double | Kind::Single => &[Encoding::PLAIN, Encoding::BYTE_STREAM_SPLIT],
        Kind::Small | Kind::Unsigned | Kind::Whole | Kind::Stamp => {
            &[Encoding::PLAIN, Encoding::DELTA_BINARY_PACKED, Encoding::BYTE_STREAM_SPLIT]
        }
        Kind::Truth => &[Encoding::PLAIN, Encoding::RLE],
        Kind::Text => &[Encoding::PLAIN, Encoding::DELTA_LENGTH_BYTE_ARRAY, Encoding::DELTA_BYTE_ARRAY],
    }
}

fn one_column() -> impl Strategy<Value = OneColumn> {
    use Kind::{Double, Single, Small, Stamp, Text, Truth, Unsigned, Whole};
    let codecs = vec![Compression::UNCOMPRESSED, Compression::SNAPPY, Compression::ZSTD(ZstdLevel::default())];
    select(vec![Double, Single, Small, Unsigned, Whole, Truth, Text, Stamp]).prop_flat_map(move |kind| {
        let with_dictionary = encodings(kind).iter().copied().map(Some).chain([None]).collect::<Vec<_>>();
        (select(vec![0, 0, 2, 7, 100]), select(with_dictionary), select(codecs.clone()))
            .prop_map(move |(missing, encoding, codec)| OneColumn { kind, missing, encoding, codec })
    })
}

fn one_table() -> impl Strategy<Value = OneTable> {
    // Most tables are small; some are longer than the readers' blocks, a few than those of a scan.
    let rows = prop_oneof![200 => 6..120usize, 12 => 120..2_000usize, 1 => 4_000..20_000usize];
    let clocks = vec![ClockKind::Seconds, ClockKind::Nanoseconds, ClockKind::Stamp, ClockKind::Text];
    (rows, vec(one_column(), 1..5)).prop_flat_map(move |(rows, columns)| {
        let places = columns.len();
        (
            (Just(rows), 1..=rows, select(vec![16usize, 50, 300, 1 << 20])),
            select(vec![WriterVersion::PARQUET_1_0, WriterVersion::PARQUET_2_0]),
            select(clocks.clone()),
            Just(columns),
            vec(0..=places, 1..=places + 1),
            (1..=rows, 0..40usize),
        )
            .prop_map(|((rows, group, page), version, clock, columns, read, (step, halo))| {
                // Few groups a table: each costs more than its rows.
                let group = group.max(rows / 8).max(1);
                let step = step.max(rows / 20);
                OneTable { rows, group, page, version, clock, columns, read, step, halo }
            })
    })
}

/// The same bits, whatever the sign and payload of what is missing.
fn bits(value: f64) -> u64 {
    if value.is_nan() { f64::NAN.to_bits() } else { (value + 0.0).to_bits() }
}

/// All values of a recording's only episode, in steps of so many rows with a halo; codes of texts by their sorted names.
fn values(recording: &Recording, step: usize, halo: usize) -> Vec<Vec<u64>> {
    let rows = recording.episodes()[0].rows;
    let mut all = vec![Vec::with_capacity(rows); recording.columns().len()];
    for from in (0..rows).step_by(step) {
        let block = recording.read(0, from..(from + step).min(rows), Halo { before: halo, after: halo / 2 }).unwrap();
        for (c, all) in all.iter_mut().enumerate() {
            all.extend(block.core(c).iter().map(|&value| bits(value)));
        }
    }
    for (column, all) in recording.columns().iter().zip(&mut all) {
        if let ColumnKind::Category(names) = &column.kind {
            let sorted = |code: f64| NAMES.iter().filter(|name| **name < names[code as usize].as_str()).count() as f64;
            all.iter_mut().for_each(|bits| {
                let code = f64::from_bits(*bits);
                if !code.is_nan() {
                    *bits = sorted(code).to_bits();
                }
            });
        }
    }
    all
}

fn check(table: &OneTable, path: &Path) -> Result<(), TestCaseError> {
    let distinct: Vec<usize> =
        (table.read.iter().enumerate()).filter(|(i, c)| !table.read[..*i].contains(c)).map(|(_, &c)| c).collect();
    let expected = OneTable { read: distinct, ..table.clone() }.expected();
    let recording = open(&[path], &table.selection()).unwrap();
    prop_assert_eq!(recording.episodes().len(), 1);
    let episode = &recording.episodes()[0];
    let last = stamp(table.clock, table.rows - 1);
    prop_assert_eq!((episode.rows, episode.start, episode.end), (table.rows, stamp(table.clock, 0), last));
    for (step, halo) in [(table.step, table.halo), (table.rows, 0), (table.step, 0)] {
        for (c, (value_read, expected)) in values(&recording, step, halo).iter().zip(&expected).enumerate() {
            let name = &recording.columns()[c].name;
            for (row, (&value_read, &expected)) in value_read.iter().zip(expected).enumerate() {
                let decoded = f64::from_bits(value_read);
                prop_assert!(
                    value_read == bits(expected),
                    "{}, column {name}, row {row} in steps of {step}: {decoded} for {expected}",
                    path.display()
                );
            }
        }
    }
    Ok(())
}

/// One pass of blocks over the clock as a column beside another: at 400 rows the clock's own decoder once answered for both.
#[test]
fn the_clock_as_a_column_is_read_as_a_column() {
    let column = OneColumn { kind: Kind::Double, missing: 0, encoding: None, codec: Compression::SNAPPY };
    for rows in [60, 400, 3_000, 4_096, 8_192, 16_384, 30_000] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.parquet");
        let table = OneTable {
            rows,
            group: rows,
            page: 1 << 20,
            version: WriterVersion::PARQUET_1_0,
            clock: ClockKind::Seconds,
            columns: vec![column.clone()],
            read: vec![1, 0],
            step: rows,
            halo: 0,
        };
        table.write_parquet(&path).unwrap();
        check(&table, &path).unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2048, max_shrink_iters: 200, ..ProptestConfig::default() })]

    #[test]
    fn a_table_is_the_same_as_parquet_and_as_csv(table in one_table()) {
        let folder = tempfile::tempdir().unwrap();
        let (parquet, csv) = (folder.path().join("a.parquet"), folder.path().join("a.csv"));
        table.write_parquet(&parquet).unwrap();
        table.write_csv(&csv);
        check(&table, &parquet)?;
        check(&table, &csv)?;
    }
}
