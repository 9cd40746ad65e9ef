//! Stamps in every unit, at every rate, from every start, under every name and in every type: read correctly, or
//! refused.

use std::{collections::BTreeSet, sync::Arc};

use fleetfoot_data::{Column, ColumnKind, ScalarBuffer, Silent, Source};
use fleetfoot_log::{Error, Log, MemoryTable, Recording, Selection, TimeUnit, inspect_together, open, open_logs};
use fleetfoot_output::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions};

const UNITS: [TimeUnit; 4] = [TimeUnit::Seconds, TimeUnit::Milliseconds, TimeUnit::Microseconds, TimeUnit::Nanoseconds];
const RATES: [f64; 16] =
    [0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 50.0, 60.0, 100.0, 200.0, 250.0, 1000.0, 4000.0, 8000.0];
/// From a start, an hour after it, a day after it (simulated), and dates.
const STARTS: [f64; 6] = [0.0, 20.3, 3600.0, 94_000.0, 1.71e9, 0.98e9];
const ROWS: usize = 40;

/// A clock of 40 rows, with some jitter where the unit is fine enough.
struct Clock {
    unit: TimeUnit,
    counts: Vec<i64>,
}

impl Clock {
    /// `None` where the unit is too coarse for the rate.
    fn new(unit: TimeUnit, rate: f64, start: f64, jitter: bool) -> Option<Self> {
        let per_second = 1_000_000_000 / unit.nanoseconds();
        let step = per_second as f64 / rate;
        if step < 1.0 {
            return None;
        }
        let noise = |row: usize| if jitter { ((row * 7919) % 11) as f64 / 11.0 * 0.02 * step } else { 0.0 };
        let first = (start * per_second as f64).round();
        let counts = (0..ROWS).map(|row| (first + row as f64 * step + noise(row)).round() as i64).collect();
        Some(Self { unit, counts })
    }

    fn nanoseconds(&self) -> Vec<i64> {
        self.counts.iter().map(|count| count * self.unit.nanoseconds()).collect()
    }
}

/// A table in memory with the stamps as whole numbers or as doubles.
struct InMemory {
    columns: Vec<Column>,
    counts: Vec<i64>,
}

impl MemoryTable for InMemory {
    fn name(&self) -> &str {
        "run"
    }
    fn rows(&self) -> usize {
        self.counts.len()
    }
    fn columns(&self) -> &[Column] {
        &self.columns
    }
    fn time_unit(&self, _column: usize) -> Option<TimeUnit> {
        None
    }
    fn values(&self, columns: &[usize], rows: std::ops::Range<usize>) -> Vec<ScalarBuffer<f64>> {
        columns.iter().map(|_| self.counts[rows.clone()].iter().map(|&count| count as f64).collect()).collect()
    }
    fn integers(&self, column: usize, rows: std::ops::Range<usize>) -> Option<ScalarBuffer<i64>> {
        (self.columns[column].kind == ColumnKind::Integer).then(|| self.counts[rows].to_vec().into())
    }
}

/// Type in which the stamps are passed.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Type {
    Text,
    TextWithPoint,
    ParquetInteger,
    ParquetDouble,
    MemoryInteger,
    MemoryDouble,
}

const TYPES: [Type; 6] = [
    Type::Text,
    Type::TextWithPoint,
    Type::ParquetInteger,
    Type::ParquetDouble,
    Type::MemoryInteger,
    Type::MemoryDouble,
];

fn read(clock: &Clock, name: &str, kind: Type, folder: &std::path::Path) -> Result<Recording, Error> {
    let selection = Selection::new(["x"]);
    let x = |row: usize| ((row * 37) % 17) as f64;
    match kind {
        Type::Text | Type::TextWithPoint => {
            let point = if kind == Type::Text { "" } else { ".0" };
            let row = |(row, count): (usize, &i64)| format!("{count}{point},{}\n", x(row));
            let text: String =
                std::iter::once(format!("{name},x\n")).chain(clock.counts.iter().enumerate().map(row)).collect();
            let path = folder.join("run.csv");
            std::fs::write(&path, text).unwrap();
            open(&[path], &selection)
        }
        Type::ParquetInteger | Type::ParquetDouble => {
            let path = folder.join("run.parquet");
            let whole = kind == Type::ParquetInteger;
            let kind = if whole { WriteKind::Integer } else { WriteKind::Float };
            let columns = vec![WriteColumn::new(name, kind), WriteColumn::new("x", WriteKind::Float)];
            let mut writer = ParquetWriter::create(&path, columns, &WriteOptions::default()).unwrap();
            let doubles: Vec<f64> = clock.counts.iter().map(|&count| count as f64).collect();
            let stamps = if whole { Values::Integer(&clock.counts) } else { Values::Float(&doubles) };
            let other: Vec<f64> = (0..clock.counts.len()).map(x).collect();
            writer.write(&[stamps, Values::Float(&other)]).unwrap();
            writer.finish().unwrap();
            open(&[path], &selection)
        }
        Type::MemoryInteger | Type::MemoryDouble => {
            let of = if kind == Type::MemoryInteger { ColumnKind::Integer } else { ColumnKind::Float };
            let columns = vec![
                Column { name: name.into(), unit: None, kind: of },
                Column { name: "x".into(), unit: None, kind: ColumnKind::Boolean },
            ];
            let table = InMemory { columns, counts: clock.counts.clone() };
            open_logs(&[Log::Table(Arc::new(table))], &selection, &Silent)
        }
    }
}

fn stamps(recording: &Recording) -> Vec<i64> {
    let read = |e: usize| recording.read(e, 0..recording.episodes()[e].rows, Default::default()).unwrap();
    (0..recording.episodes().len()).flat_map(|e| read(e).stamps().to_vec()).collect()
}

/// Outcome of reading a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Right,
    Refused,
    /// Read as seconds, with a note that names the unit as possible: doubles in memory alone.
    Noted,
    Wrong,
}

fn outcome(clock: &Clock, name: &str, kind: Type, folder: &std::path::Path) -> Outcome {
    match read(clock, name, kind, folder) {
        Err(Error::UnknownTimeUnit { .. }) => Outcome::Refused,
        Err(error) => panic!("{name}, {kind:?}: {error}"),
        Ok(recording) => {
            // Doubles hold the nanoseconds of a date to 256 ns.
            let is_near = |(a, b): (&i64, &i64)| (a - b).abs() <= if (*a).abs() > 1 << 53 { 256 } else { 0 };
            let (stamps_read, truth) = (stamps(&recording), clock.nanoseconds());
            let right = stamps_read.len() == truth.len() && stamps_read.iter().zip(&truth).all(is_near);
            let note_text = format!("the numbers of `{name}` are taken as s; they could be ");
            let names_unit = |note: &String| {
                note.split_once(&note_text).is_some_and(|(_, rest)| {
                    rest.split_once(": name the unit").unwrap().0.split(" or ").any(|unit| unit == clock.unit.symbol())
                })
            };
            match right {
                true => Outcome::Right,
                false if kind == Type::MemoryDouble && recording.notes().iter().any(names_unit) => Outcome::Noted,
                false => Outcome::Wrong,
            }
        }
    }
}

/// Every combination of unit, rate, start and jitter, each under one of the names and in one of the types, all of which come with all units.
fn combinations() -> Vec<(Clock, f64, f64, bool)> {
    let mut all = Vec::new();
    for unit in UNITS {
        for rate in RATES {
            for start in STARTS {
                for jitter in [false, true] {
                    all.extend(Clock::new(unit, rate, start, jitter).map(|clock| (clock, rate, start, jitter)));
                }
            }
        }
    }
    all
}

#[test]
fn stamps_are_read_right_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["t", "time", "timestamp", "header.stamp", "Elapsed"];
    let (mut counts, mut unread, mut met) = ([0usize; 3], Vec::new(), BTreeSet::new());
    for (at, (clock, rate, start, jitter)) in combinations().iter().enumerate() {
        let (name, kind) = (names[at % names.len()], TYPES[(at / 2 + at / 12) % TYPES.len()]);
        met.insert((clock.unit.symbol(), start.to_string(), format!("{kind:?}")));
        let what =
            format!("{} at {rate} Hz from {start} s as `{name}`, {kind:?}, jitter {jitter}", clock.unit.symbol());
        match outcome(clock, name, kind, folder.path()) {
            Outcome::Right => counts[0] += 1,
            Outcome::Refused => {
                counts[1] += 1;
                // Dates, and the usual rates of robots, are told apart.
                if *start > 1e9 || (9.5..=100.0).contains(rate) {
                    unread.push(what);
                }
            }
            Outcome::Noted => counts[2] += 1,
            Outcome::Wrong => panic!("read wrongly: {what}"),
        }
    }
    // Whole seconds have too few rates for that.
    met.retain(|(symbol, ..)| *symbol != "s");
    assert_eq!(met.len(), (UNITS.len() - 1) * STARTS.len() * TYPES.len(), "every type from every start in every unit");
    assert!(counts[2] > 0, "{counts:?}");
    assert!(counts[0] + counts[1] >= 500 && counts[0] >= 400, "{counts:?}");
    assert!(
        unread.is_empty(),
        "{} refused without need, among them {:?}",
        unread.len(),
        &unread[..unread.len().min(5)]
    );
}

#[test]
fn stamps_with_named_unit_are_read_right() {
    let folder = tempfile::tempdir().unwrap();
    for (at, (clock, rate, start, _)) in combinations().iter().enumerate() {
        let symbol = clock.unit.symbol();
        let names = [format!("time_{symbol}"), format!("t [{symbol}]"), format!("Time ({symbol})")];
        let (name, kind) = (&names[at % names.len()], TYPES[(at / 2 + at / 12) % TYPES.len()]);
        assert_eq!(outcome(clock, name, kind, folder.path()), Outcome::Right, "{name}, {rate} Hz, {start} s, {kind:?}");
    }
}

#[test]
fn files_of_a_call_agree_on_the_unit() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, unit: TimeUnit, rate: f64| {
        let clock = Clock::new(unit, rate, 20.3, false).unwrap();
        let row = |(row, count): (usize, &i64)| format!("{count},{}\n", (row * 37) % 17 + rate as usize);
        let text: String =
            std::iter::once("timestamp,x\n".into()).chain(clock.counts.iter().enumerate().map(row)).collect();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        (path, clock)
    };
    // As PX4's converter writes them: microseconds since boot, topics at 1 Hz and at 250 Hz.
    let (slow, clock) = write("slow.csv", TimeUnit::Microseconds, 1.0);
    let (fast, _) = write("fast.csv", TimeUnit::Microseconds, 250.0);
    for alone in [&slow, &fast] {
        let error = open(&[alone], &Selection::new(["x"])).unwrap_err();
        assert!(matches!(error, Error::UnknownTimeUnit { .. }), "{error}");
    }
    let recording = open(&[&slow, &fast], &Selection::new(["x"])).unwrap();
    assert_eq!(stamps(&recording)[ROWS..], clock.nanoseconds());
    assert!(
        recording.notes().iter().any(|note| note.contains("only unit that fits all files")),
        "{:?}",
        recording.notes()
    );
    // Separately opened files have the same notes.
    for values in [false, true] {
        let infos = inspect_together(&[&slow, &fast], values, &Silent).unwrap();
        for info in &infos {
            let clock = info.clock.as_ref().unwrap();
            assert_eq!((clock.unit, clock.is_open()), (Some(TimeUnit::Microseconds), false), "{clock:?}");
            assert_eq!(clock.summary.is_some(), values);
        }
        assert!(inspect_together(&[&slow], values, &Silent).unwrap()[0].clock.as_ref().unwrap().is_open());
    }
    // Files that can be of no common unit.
    let (other, _) = write("other.csv", TimeUnit::Nanoseconds, 30.0);
    let error = open(&[&slow, &fast, &other], &Selection::new(["x"])).unwrap_err();
    assert!(matches!(error, Error::ColumnsDisagree { .. }), "{error}");
    let infos = inspect_together(&[&slow, &fast, &other], false, &Silent).unwrap();
    assert!(infos.iter().all(|info| info.notes[0].contains("cannot be opened together: column `timestamp`")));
}

#[test]
fn files_of_px4_are_read_in_microseconds_or_refused() {
    // Rates of topics of a flight (Hz), a row every second among them, and bursts.
    let folder = tempfile::tempdir().unwrap();
    let burst = Clock {
        unit: TimeUnit::Microseconds,
        counts: (0..20).map(|row| 11_919_825 + 90 * row + 1_000_000 * (row / 10)).collect(),
    };
    assert_eq!(outcome(&burst, "timestamp", Type::Text, folder.path()), Outcome::Refused);
    for rate in
        [0.16, 0.56, 0.8, 1.0, 2.0, 3.33, 5.0, 9.43, 10.4, 19.2, 31.3, 50.0, 93.6, 102.3, 125.0, 204.6, 250.0, 404.0]
    {
        let clock = Clock::new(TimeUnit::Microseconds, rate, 20.32, true).unwrap();
        assert_ne!(outcome(&clock, "timestamp", Type::Text, folder.path()), Outcome::Wrong, "{rate} Hz");
        let simulated = Clock::new(TimeUnit::Microseconds, rate, 1.710_773_35e9, true).unwrap();
        assert_eq!(outcome(&simulated, "timestamp", Type::Text, folder.path()), Outcome::Right, "{rate} Hz, a date");
    }
}

#[test]
fn a_date_and_a_time_are_one_clock() {
    let folder = tempfile::tempdir().unwrap();
    // Thirty rows over midnight.
    let row = |row: usize| {
        let second = 86_390 + row;
        let (day, of_day) = (19 + second / 86_400, second % 86_400);
        format!(
            "2020-09-{day},{:02}:{:02}:{:02}.250,{}\n",
            of_day / 3600,
            of_day / 60 % 60,
            of_day % 60,
            (row * 37) % 17
        )
    };
    let path = folder.path().join("run.csv");
    std::fs::write(&path, format!("Date,Time,x\n{}", (0..30).map(row).collect::<String>())).unwrap();
    let recording = open(&[&path], &Selection::new(["x"])).unwrap();
    let start = 1_600_473_600 + 86_390;
    let truth: Vec<i64> = (0..30).map(|row| (start + row) * 1_000_000_000 + 250_000_000).collect();
    assert_eq!(stamps(&recording), truth);
    assert!(recording.notes().is_empty(), "{:?}", recording.notes());
    let info = fleetfoot_log::inspect_values(&path, &Silent).unwrap();
    let clock = info.clock.unwrap();
    assert_eq!((clock.column.as_str(), clock.beside.as_deref(), clock.unit), ("Date", Some("Time"), None));
    assert_eq!((clock.guess, clock.summary.unwrap().repeated, info.rows), (false, 0, Some(30)));
    // Whole seconds and the nanoseconds beyond.
    let row = |row: i64| format!("{},{},{}\n", 1_700_000_000 + row / 10, row % 10 * 100_000_000, (row * 37) % 17);
    std::fs::write(&path, format!("stamp.sec,stamp.nanosec,x\n{}", (0..30).map(row).collect::<String>())).unwrap();
    let recording = open(&[&path], &Selection::new(["x"])).unwrap();
    let truth: Vec<i64> = (0..30).map(|row| 1_700_000_000_000_000_000 + row * 100_000_000).collect();
    assert_eq!(stamps(&recording), truth);
}

#[test]
fn non_increasing_columns_are_no_clock() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, header: &str, row: &dyn Fn(f64) -> String| {
        let path = folder.path().join(name);
        let rows: String = (0..3000).map(|k| row(f64::from(k))).collect();
        std::fs::write(&path, format!("{header}\n{rows}")).unwrap();
        path
    };
    let refusal = |path: &std::path::PathBuf| open(&[path], &Selection::new(["u"])).unwrap_err();
    // A temperature; a car's position; a column that rises in its first thousand rows only.
    let warm = write("warm.csv", "T,u", &|k| format!("{},{}\n", 20.0 + (0.01 * k).sin(), k % 7.0));
    assert!(matches!(refusal(&warm), Error::NoTimeColumn { .. }));
    let heated = write("heated.csv", "T,u", &|k| format!("{},{}\n", 80.0 - 60.0 * (-0.002 * k).exp(), k % 7.0));
    assert!(matches!(refusal(&heated), Error::NoTimeColumn { .. }));
    let car =
        write("car.csv", "x,y,u", &|k| format!("{},{},{}\n", k - 0.9 * (0.5 * k).sin(), (0.1 * k).cos(), k % 7.0));
    assert!(matches!(refusal(&car), Error::NoTimeColumn { .. }));
    let turned = write("turned.csv", "x,u", &|k| {
        format!("{},{}\n", if k < 2000.0 { 0.5 * k } else { 2000.0 - 0.5 * k }, k % 7.0)
    });
    let message = refusal(&turned).to_string();
    assert!(message.contains("`x` rises in only 2") && message.contains("--time"), "{message}");
    // `info` says so, and reads the values all the same.
    let info = fleetfoot_log::inspect_values(&turned, &Silent).unwrap();
    assert!(
        info.clock.is_none() && info.rows == Some(3000) && info.notes.iter().any(|note| note.contains("rises in only"))
    );
    // Named, it is the clock.
    let named = fleetfoot_log::TimeSpec::Column { name: "x".into(), unit: Some(TimeUnit::Seconds) };
    assert!(open(&[&turned], &Selection { time: named, ..Selection::new(["u"]) }).is_ok());
}

/// A file with a column `x` that counts the rows from 0, and one that breaks no tie.
fn written(folder: &std::path::Path, header: &str, stamps: &[String]) -> std::path::PathBuf {
    let path = folder.join("run.csv");
    let delimiter = if header.contains(';') { ';' } else { ',' };
    let row = |(row, stamp): (usize, &String)| format!("{stamp}{delimiter}{row}{delimiter}{}\n", (row * 37) % 17);
    let rows: String = stamps.iter().enumerate().map(row).collect();
    std::fs::write(&path, format!("{header}{delimiter}x{delimiter}y\n{rows}")).unwrap();
    path
}

/// Stamps, values of `x` and notes.
fn read_x(path: &std::path::Path) -> (Vec<i64>, Vec<f64>, Vec<String>) {
    let recording = open(&[path], &Selection::new(["x"])).unwrap();
    let read = |e: usize| recording.read(e, 0..recording.episodes()[e].rows, Default::default()).unwrap();
    let x = (0..recording.episodes().len()).flat_map(|e| read(e).columns[0].to_vec()).collect();
    (stamps(&recording), x, recording.notes().to_vec())
}

#[test]
fn fractions_without_their_leading_zeros_are_mended() {
    let folder = tempfile::tempdir().unwrap();
    // 100 Hz for 30 s, in the order of time and sorted as texts.
    let truth: Vec<i64> = (0..3000).map(|row| 48_008_519_246 + row * 10_000_000 + (row * 7919) % 11 * 1001).collect();
    let lost = |ns: &i64| format!("{}.{}", ns / 1_000_000_000, ns % 1_000_000_000);
    let texts: Vec<String> = truth.iter().map(lost).collect();
    assert_eq!(texts[0], "48.8519246");
    let mut sorted: Vec<(String, usize)> = texts.iter().cloned().zip(0..).collect();
    sorted.sort_by(|a, b| a.0.parse::<f64>().unwrap().total_cmp(&b.0.parse().unwrap()));
    let (stamps_read, x, notes) = read_x(&written(folder.path(), "time", &texts));
    assert_eq!(stamps_read, truth);
    assert_eq!(x, (0..3000).map(f64::from).collect::<Vec<_>>());
    let is_note = |note: &String| note.contains("lost their leading zeros") && note.contains("is read as 48.008519246");
    assert!(notes.iter().any(is_note), "{notes:?}");
    let path = written(folder.path(), "time", &sorted.iter().map(|(text, _)| text.clone()).collect::<Vec<_>>());
    let rows: Vec<usize> = read_x(&path).1.iter().map(|&x| sorted[x as usize].1).collect();
    assert_eq!(read_x(&path).0, truth);
    assert_eq!(rows, (0..3000).collect::<Vec<_>>());
    assert!(
        inspect_together(&[&path], false, &Silent).unwrap()[0]
            .notes
            .iter()
            .any(|note| note.contains("lost their leading zeros"))
    );
    // Times of the day.
    let clock = |ns: &i64| format!("2024-03-03 09:00:{}", lost(ns));
    let dates: Vec<String> = truth[..900].iter().map(clock).collect();
    let start = 1_709_456_400_000_000_000;
    let (stamps_read, _, _) = read_x(&written(folder.path(), "time", &dates));
    assert_eq!(stamps_read, truth[..900].iter().map(|ns| start + ns).collect::<Vec<_>>());
    // A later fraction begins with a zero: none was lost, and the stamps stand as they are.
    let mut unsure = texts.clone();
    unsure.push("79.01".into());
    let (stamps_read, _, notes) = read_x(&written(folder.path(), "time", &unsure));
    assert_eq!((stamps_read[0], stamps_read.last()), (48_851_924_600, Some(&79_010_000_000)));
    assert!(!notes.iter().any(is_note), "{notes:?}");
}

#[test]
fn counters_that_wrap_are_counted_on() {
    let folder = tempfile::tempdir().unwrap();
    for (name, unit, bits, step) in
        [("tick_ms", 1_000_000, 16, 10), ("time_us", 1_000, 32, 10_000), ("t_us", 1_000, 16, 4_000)]
    {
        let period = 1i64 << bits;
        let ticks: Vec<i64> = (0..400).map(|row| period - 12 * step - 3 + row * step).collect();
        let ns: Vec<i64> = ticks.iter().map(|tick| tick * unit).collect();
        let texts: Vec<String> = ticks.iter().map(|tick| (tick % period).to_string()).collect();
        let path = written(folder.path(), name, &texts);
        let first = ns[0] - ticks[0] % period * unit;
        let (stamps_read, x, notes) = read_x(&path);
        assert_eq!(stamps_read, ns.iter().map(|ns| ns - first).collect::<Vec<_>>(), "{name}");
        assert_eq!(x.len(), 400);
        assert!(notes.iter().any(|note| note.contains(&format!("of `{name}` wrap at 2^{bits}"))), "{notes:?}");
        // At a rate, and from Parquet.
        let mut rate = Selection::new(["x"]);
        rate.join.base = Some(fleetfoot_log::Base::Rate(20.0));
        let recording = open(&[&path], &rate).unwrap();
        assert_eq!(recording.episodes().len(), 1, "{name}");
        let path = folder.path().join("run.parquet");
        let columns = vec![WriteColumn::new(name, WriteKind::Integer), WriteColumn::new("x", WriteKind::Float)];
        let mut writer = ParquetWriter::create(&path, columns, &WriteOptions::default()).unwrap();
        let wrapped: Vec<i64> = ticks.iter().map(|tick| tick % period).collect();
        writer.write(&[Values::Integer(&wrapped), Values::Float(&x)]).unwrap();
        writer.finish().unwrap();
        assert_eq!(read_x(&path).0, stamps_read, "{name}");
    }
    // A logger that was started anew: two episodes.
    let texts: Vec<String> = (0..60).map(|row| (row % 30 * 10).to_string()).collect();
    let recording = open(&[written(folder.path(), "tick_ms", &texts)], &Selection::new(["x"])).unwrap();
    assert_eq!(recording.episodes().len(), 2);
}

#[test]
fn gps_weeks_and_seconds_are_one_clock() {
    let folder = tempfile::tempdir().unwrap();
    // Over the end of a week, 2024-03-02 to 03, at 20 Hz.
    let epoch = 315_964_800_000i64;
    let rows: Vec<(i64, i64)> =
        (0..100).map(|row| 604_800_000 - 2_000 + row * 50).map(|ms| (ms / 604_800_000, ms % 604_800_000)).collect();
    let truth: Vec<i64> =
        rows.iter().map(|(week, ms)| (epoch + (2303 + week) * 604_800_000 + ms) * 1_000_000).collect();
    assert_eq!(truth[0], (1_709_424_000 - 2) * 1_000_000_000);
    for (names, seconds) in [
        ("GWk,GMS", false),
        ("gps.week,gps.tow", false),
        ("week,iTOW [ms]", false),
        ("gps_week,gps_tow", true),
        ("WN,TOW (s)", true),
    ] {
        let time = |ms: i64| if seconds { format!("{}.{:03}", ms / 1000, ms % 1000) } else { ms.to_string() };
        let texts: Vec<String> = rows.iter().map(|(week, ms)| format!("{},{}", 2303 + week, time(*ms))).collect();
        let (stamps_read, x, notes) = read_x(&written(folder.path(), names, &texts));
        assert_eq!(stamps_read, truth, "{names}");
        assert_eq!(x.len(), 100);
        assert!(notes.iter().any(|note| note.contains("GPS time, which is 18 s ahead of UTC")), "{notes:?}");
    }
    // Whole seconds or milliseconds of the first minutes of a week: refused by name.
    let texts: Vec<String> = (0..60).map(|row| format!("2304,{}", row * 1000)).collect();
    let path = written(folder.path(), "week,tow", &texts);
    let error = open(&[&path], &Selection::new(["x"])).unwrap_err().to_string();
    assert!(error.contains("run.csv") && error.contains("--time"), "{error}");
}

#[test]
fn civil_times_are_read_as_written() {
    let folder = tempfile::tempdir().unwrap();
    // From 11:59:30 at night (or noon), a row every two seconds.
    let seconds = |start: i64| (0..30).map(|row| (start + 2 * row) * 1_000_000_000).collect::<Vec<_>>();
    let of_day = |row: i64| 86_370 + 2 * row;
    let half = |second: i64| {
        let hours = second / 3600 % 24;
        let half = if hours < 12 { "AM" } else { "PM" };
        format!("{}:{:02}:{:02} {half}", (hours + 11) % 12 + 1, second / 60 % 60, second % 60)
    };
    // 12-hour clocks over midnight and over noon, alone and behind a date.
    for shift in [0, 43_200] {
        let texts: Vec<String> = (0..30).map(|row| half(of_day(row) + shift)).collect();
        assert_eq!(read_x(&written(folder.path(), "Time", &texts)).0, seconds((86_370 + shift) % 86_400), "{shift}");
    }
    let day = |second: i64| 24 + second / 86_400;
    let texts: Vec<String> = (0..30).map(|row| format!("{}/04/2021 {}", day(of_day(row)), half(of_day(row)))).collect();
    let april_24 = 1_619_222_400;
    assert_eq!(read_x(&written(folder.path(), "Time", &texts)).0, seconds(april_24 + 86_370), "day first");
    let texts: Vec<String> = (0..30).map(|row| format!("04/{}/2021 {}", day(of_day(row)), half(of_day(row)))).collect();
    assert_eq!(read_x(&written(folder.path(), "Time", &texts)).0, seconds(april_24 + 86_370), "month first");
    // Times of the day over midnight, with 24 hours and decimals.
    let texts: Vec<String> =
        (0..30).map(of_day).map(|s| format!("{:02}:{:02}:{:02}.250", s / 3600 % 24, s / 60 % 60, s % 60)).collect();
    let expected: Vec<i64> = seconds(86_370).iter().map(|ns| ns + 250_000_000).collect();
    assert_eq!(read_x(&written(folder.path(), "Time", &texts)).0, expected);
    // Decimal commas.
    let texts: Vec<String> = (0..30).map(|row| format!("{},{:02}", 12 + row / 4, row % 4 * 25)).collect();
    let expected: Vec<i64> = (0..30).map(|row| 12_000_000_000 + row * 250_000_000).collect();
    let commas: Vec<String> = texts.iter().map(|text| format!("{text};0,5")).collect();
    assert_eq!(read_x(&written(folder.path(), "time;u", &commas)).0, expected);
    // Several clocks in one file: the better name counts, and the other one is a column.
    let texts: Vec<String> =
        (0..30).map(|row| format!("{},{}", 1_700_000_000_000i64 + row * 20, row * 20_000)).collect();
    let path = written(folder.path(), "stamp_ms,time_us", &texts);
    assert_eq!(read_x(&path).0, (0..30).map(|row| row * 20_000_000).collect::<Vec<_>>());
    let named = fleetfoot_log::TimeSpec::Column { name: "stamp_ms".into(), unit: None };
    let recording = open(&[&path], &Selection { time: named, ..Selection::new(["x"]) }).unwrap();
    assert_eq!(stamps(&recording)[0], 1_700_000_000_000_000_000);
}
