//! Tables in memory, opened as files are: the same clock, the same episodes, the same notes.

use std::{
    ops::Range,
    path::{Path, PathBuf},
    sync::Arc,
};

use fleetfoot_data::{Column, ColumnKind, ScalarBuffer};

use crate::{
    Error, RunFiles, Selection, TimeSpec, TimeUnit,
    by_name::ByName,
    cycles::Cycle,
    opened::Opened,
    stamp,
    store::SEGMENT,
    table::{MISSING, Table, TableColumn, TableRows},
    time_column::{self, Agreed, Candidate, CandidateKind, Clock, ClockUnit, Reading, SettledClock},
};

/// Rows that are looked at to find the clock.
const SAMPLE: usize = 1000;

/// A table in memory. Its columns may lie anywhere and in any type: they are asked for as numbers, some rows at a time.
pub trait MemoryTable: Send + Sync {
    /// Name in messages and for episodes. Tables that are opened together should have different names.
    fn name(&self) -> &str;

    /// Number of rows.
    fn rows(&self) -> usize;

    /// Its columns. Categories carry their names.
    fn columns(&self) -> &[Column];

    /// A column that is asked for, with the names of its categories, which [`MemoryTable::columns`] need not tell.
    ///
    /// # Errors
    /// A column that holds no numbers, truth values, times or texts, and a text with too many different values.
    fn selected(&self, column: usize) -> Result<Column, Error> {
        Ok(self.columns()[column].clone())
    }

    /// The unit in which [`MemoryTable::integers`] gives a column that is a date or a time by its type; `None` for other columns.
    fn time_unit(&self, column: usize) -> Option<TimeUnit>;

    /// Returns true if such a column holds times of the day, which pass midnight.
    fn is_time_of_day(&self, _column: usize) -> bool {
        false
    }

    /// Values of some columns, one buffer each: numbers as they are, codes for categories, NaN where one is missing. `rows` is within the table.
    fn values(&self, columns: &[usize], rows: Range<usize>) -> Vec<ScalarBuffer<f64>>;

    /// Whole numbers of a column that holds such, `i64::MIN` where one is missing; `None` for other columns.
    fn integers(&self, column: usize, rows: Range<usize>) -> Option<ScalarBuffer<i64>>;
}

/// Recording to open: a file, the files of a run, or a table in memory.
#[derive(Clone)]
pub enum Log {
    /// A file, or a rosbag2 folder.
    File(PathBuf),
    /// The files of one run.
    Run(RunFiles),
    /// A table.
    Table(Arc<dyn MemoryTable>),
}

impl Log {
    /// The file's path; of a run its folder, of a table its name.
    pub fn path(&self) -> &Path {
        match self {
            Self::Run(run) => &run.folder,
            Self::File(path) => path,
            Self::Table(table) => Path::new(table.name()),
        }
    }

    /// The file's path, of a run its folder; `None` for a table.
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::Run(run) => Some(&run.folder),
            Self::File(path) => Some(path),
            Self::Table(_) => None,
        }
    }
}

impl std::fmt::Debug for Log {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kind = match self {
            Self::File(_) => "File",
            Self::Run(_) => "Run",
            Self::Table(_) => "Table",
        };
        f.debug_tuple(kind).field(&self.path()).finish()
    }
}

/// A table with the selection that it is read by.
struct Selected {
    table: Arc<dyn MemoryTable>,
    /// Places of the selected columns.
    places: Vec<usize>,
    columns: Vec<TableColumn>,
    /// Columns of the stamps; several columns are added up.
    clock: Vec<(usize, TimeUnit)>,
    /// True if the first of them counts weeks of GPS.
    gps_weeks: bool,
}

/// Opens a table for reading the selected columns.
pub(crate) fn open(table: &Arc<dyn MemoryTable>, selection: &Selection, agreed: &Agreed) -> Result<Opened, Error> {
    let path = Path::new(table.name());
    let names = ByName::new(table.columns().iter().map(|column| column.name.as_str()));
    let places = selection.columns.iter().map(|name| names.find(path, name)).collect::<Result<Vec<_>, _>>()?;
    let clock = find_clock(path, table.as_ref(), &names, &selection.time)?;
    let clock = clock.map(|clock| clock.settle(path, agreed, selection)).transpose()?;
    let columns = places.iter().map(|&place| {
        let column = table.selected(place)?;
        let empty = matches!(&column.kind, ColumnKind::Category(names) if names.is_empty());
        Ok(TableColumn { column, empty })
    });
    let selected = Selected {
        columns: columns.collect::<Result<_, Error>>()?,
        places,
        clock: clock.iter().flat_map(SettledClock::parts).collect(),
        gps_weeks: clock.as_ref().is_some_and(|clock| clock.gps_weeks),
        table: table.clone(),
    };
    let notes = clock.iter().filter_map(|clock| clock.assumed.clone()).collect();
    let cycle = match &clock {
        Some(clock) if clock.beside.is_none() && table.is_time_of_day(clock.column) => Cycle::Day,
        Some(clock) if clock.beside.is_none() && table.time_unit(clock.column).is_none() => Cycle::Counter(clock.unit),
        _ => Cycle::Never,
    };
    Ok(Opened { cycle, ..Opened::of_table(Box::new(selected), clock, notes) })
}

fn find_clock(
    path: &Path,
    table: &dyn MemoryTable,
    names: &ByName<'_>,
    spec: &TimeSpec,
) -> Result<Option<Clock>, Error> {
    match spec {
        TimeSpec::Uniform { .. } => return Ok(None),
        TimeSpec::Column { name, .. } => {
            let column = names.find(path, name)?;
            let is_number = matches!(table.selected(column)?.kind, ColumnKind::Float | ColumnKind::Integer);
            if !is_number && table.time_unit(column).is_none() {
                return Err(Error::NoClock { path: path.into(), column: name.clone() });
            }
        }
        TimeSpec::Auto | TimeSpec::Dispensable { .. } => {}
    }
    match clock(table, spec) {
        Some(clock) => Ok(Some(clock)),
        None if matches!(spec, TimeSpec::Dispensable { .. }) => Ok(None),
        None => Err(time_column::no_clock(path, &candidates(table), &|column| sample(table, column))),
    }
}

/// The clock of a table, as far as its first rows tell; `None` where it has none.
pub(crate) fn clock(table: &dyn MemoryTable, spec: &TimeSpec) -> Option<Clock> {
    let clock = time_column::choose(&candidates(table), &|column| sample(table, column), spec)?;
    let unit = match (table.time_unit(clock.column), clock.unit) {
        (Some(unit), _) => ClockUnit::Given(unit),
        (None, ClockUnit::Guessed(readings)) if clock.kind == CandidateKind::Float && may_be_seconds(&readings) => {
            ClockUnit::Seconds(readings)
        }
        (None, unit) => unit,
    };
    let beside = clock.beside.map(|(column, unit)| (column, table.time_unit(column).unwrap_or(unit)));
    Some(Clock { unit, beside, ..clock })
}

/// Returns true if stamps may be seconds: floating-point ones in memory are then taken as such, as numerical libraries
/// count time.
fn may_be_seconds(readings: &[Reading]) -> bool {
    readings.iter().any(|reading| reading.unit == TimeUnit::Seconds)
}

fn of_column(table: &dyn MemoryTable, column: usize, rows: Range<usize>) -> ScalarBuffer<f64> {
    table.values(&[column], rows).pop().unwrap_or_else(|| Vec::new().into())
}

fn candidates(table: &dyn MemoryTable) -> Vec<Candidate> {
    (0..table.columns().len()).map(|column| candidate(table, column)).collect()
}

fn candidate(table: &dyn MemoryTable, column: usize) -> Candidate {
    let Column { name, unit, kind } = &table.columns()[column];
    let kind = match (table.time_unit(column), kind) {
        (Some(_), _) => CandidateKind::Time,
        (None, ColumnKind::Float) => CandidateKind::Float,
        (None, ColumnKind::Integer) => CandidateKind::Integer,
        (None, _) => CandidateKind::Other,
    };
    Candidate { name: name.clone(), unit: unit.clone(), kind }
}

/// The first values of a column: numbers as they are, times in seconds.
fn sample(table: &dyn MemoryTable, column: usize) -> Vec<f64> {
    let rows = 0..table.rows().min(SAMPLE);
    match table.time_unit(column) {
        None => of_column(table, column, rows).to_vec(),
        Some(unit) => {
            let seconds = |&value: &i64| if value == MISSING { f64::NAN } else { value as f64 * unit.seconds() };
            table.integers(column, rows).map_or_else(Vec::new, |all| all.iter().map(seconds).collect())
        }
    }
}

impl Selected {
    /// The stamps that one column tells.
    fn part_of_stamps(&self, (column, unit): (usize, TimeUnit), rows: Range<usize>) -> ScalarBuffer<i64> {
        match self.table.integers(column, rows.clone()) {
            Some(whole) if unit == TimeUnit::Nanoseconds => whole,
            Some(whole) => whole.iter().map(|&value| stamp::from_i64(value, unit)).collect::<Vec<_>>().into(),
            None => {
                let values = of_column(self.table.as_ref(), column, rows);
                values.iter().map(|&value| stamp::from_f64(value, unit)).collect::<Vec<_>>().into()
            }
        }
    }
}

impl Table for Selected {
    fn rows(&self) -> usize {
        self.table.rows()
    }

    fn columns(&self) -> &[TableColumn] {
        &self.columns
    }

    fn pieces(&self) -> Vec<Range<usize>> {
        let rows = self.table.rows();
        (0..rows).step_by(SEGMENT).map(|from| from..(from + SEGMENT).min(rows)).collect()
    }

    fn stamps(&self, rows: Range<usize>) -> Result<ScalarBuffer<i64>, Error> {
        Ok(stamp::sum(self.clock.iter().map(|&part| self.part_of_stamps(part, rows.clone())), self.gps_weeks))
    }

    fn values(&self, rows: Range<usize>, _keep: usize) -> Result<TableRows, Error> {
        let columns = self.table.values(&self.places, rows.clone());
        Ok(TableRows { time: self.stamps(rows)?, columns })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MaxGap, open_logs};
    use fleetfoot_data::{Halo, Silent, Source};

    struct Two {
        name: String,
        columns: Vec<Column>,
        stamps: Vec<i64>,
        values: Vec<f64>,
    }

    impl MemoryTable for Two {
        fn name(&self) -> &str {
            &self.name
        }
        fn rows(&self) -> usize {
            self.values.len()
        }
        fn columns(&self) -> &[Column] {
            &self.columns
        }
        fn time_unit(&self, column: usize) -> Option<TimeUnit> {
            (column == 0).then_some(TimeUnit::Microseconds)
        }
        fn is_time_of_day(&self, column: usize) -> bool {
            column == 0
        }
        fn values(&self, columns: &[usize], rows: Range<usize>) -> Vec<ScalarBuffer<f64>> {
            let of = |&column: &usize| match column {
                0 => self.stamps[rows.clone()].iter().map(|&stamp| stamp as f64).collect::<Vec<_>>().into(),
                _ => self.values[rows.clone()].to_vec().into(),
            };
            columns.iter().map(of).collect()
        }
        fn integers(&self, column: usize, rows: Range<usize>) -> Option<ScalarBuffer<i64>> {
            (column == 0).then(|| self.stamps[rows].to_vec().into())
        }
    }

    fn two(name: &str, stamps: Vec<i64>) -> Log {
        let columns = vec![
            Column { name: "stamp".into(), unit: None, kind: ColumnKind::Integer },
            Column { name: "x".into(), unit: Some("m".into()), kind: ColumnKind::Float },
        ];
        let values = (0..stamps.len()).map(|row| row as f64 + name.len() as f64).collect();
        Log::Table(Arc::new(Two { name: name.into(), columns, stamps, values }))
    }

    #[test]
    fn tables_are_cut_like_files() {
        let stamps = vec![1_000, 2_000, 3_000, 9_000_000, 9_001_000, 9_001_000, 9_002_000, 500, 1_500, i64::MIN, 2_500];
        let selection = Selection { max_gap: MaxGap::Seconds(1.0), ..Selection::new(["x"]) };
        let recording = open_logs(&[two("first", stamps), two("other", vec![0, 1, 2])], &selection, &Silent).unwrap();
        let rows: Vec<(&str, usize)> = recording.episodes().iter().map(|e| (e.name.as_str(), e.rows)).collect();
        assert_eq!(rows, [("first#1", 3), ("first#2", 3), ("first#3", 3), ("other", 3)]);
        assert_eq!(recording.columns()[0].unit.as_deref(), Some("m"));
        let block = recording.read(2, 1..3, Halo { before: 5, after: 5 }).unwrap();
        assert_eq!((block.column(0), block.stamps()), (&[12.0, 13.0, 15.0][..], &[1_500_000, 2_500_000][..]));
        assert!(recording.notes().iter().any(|note| note.contains("stamp")), "{:?}", recording.notes());
    }

    #[test]
    fn times_of_the_day_pass_midnight() {
        let stamps = (0..6).map(|row| (86_397 + row) % 86_400 * 1_000_000).collect();
        let recording = open_logs(&[two("run", stamps)], &Selection::new(["x"]), &Silent).unwrap();
        let block = recording.read(0, 2..5, Halo::default()).unwrap();
        assert_eq!(block.stamps(), [86_399, 86_400, 86_401].map(|second| second * 1_000_000_000));
    }

    #[test]
    fn mistakes_name_the_table() {
        let wrong = |selection: &Selection| {
            open_logs(&[two("run 7", vec![1, 2])], selection, &Silent).err().map(|error| error.to_string())
        };
        let message = wrong(&Selection::new(["y"])).unwrap();
        assert!(message.contains("run 7") && message.contains('y'), "{message}");
        let spec = TimeSpec::Column { name: "clock".into(), unit: None };
        let message = wrong(&Selection { time: spec, ..Selection::new(["x"]) }).unwrap();
        assert!(message.contains("run 7") && message.contains("clock"), "{message}");
        let twice = [two("a", vec![1, 2, 3]), two("b", vec![1, 2, 3])];
        let message = open_logs(&twice, &Selection::new(["x"]), &Silent).err().unwrap().to_string();
        assert!(message.contains('a') && message.contains('b'), "{message}");
    }
}
