//! Parquet: written values come back, for all types, row groups and ranges.

use std::{collections::BTreeMap, path::Path};

use fleetfoot_data::{ColumnKind, Halo, Source, parallel_map, with_threads};
use fleetfoot_log::{Error, MaxGap, Recording, Selection, TimeSpec, TimeUnit, inspect, inspect_values, open};
use fleetfoot_output::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions};

/// Columns t (stamp), x, y and a label, in row groups of `group` rows.
fn write(path: &Path, stamps: &[i64], group: usize) {
    let columns = vec![
        WriteColumn::new("t", WriteKind::Stamp),
        WriteColumn::new("x", WriteKind::Float).with_unit("m"),
        WriteColumn::new("n", WriteKind::Integer),
        WriteColumn::new("on", WriteKind::Boolean),
        WriteColumn::new("ground", WriteKind::Text),
    ];
    let options = WriteOptions {
        row_group_rows: group,
        metadata: BTreeMap::from([("robot".into(), "hexapod".into())]),
        ..WriteOptions::default()
    };
    let mut writer = ParquetWriter::create(path, columns, &options).unwrap();
    let rows: Vec<usize> = (0..stamps.len()).collect();
    for part in rows.chunks(700) {
        let x: Vec<f64> = part.iter().map(|&row| value(row)).collect();
        let n: Vec<i64> = part.iter().map(|&row| row as i64 - 5).collect();
        let on: Vec<bool> = part.iter().map(|&row| row.is_multiple_of(3)).collect();
        let ground: Vec<&str> = part.iter().map(|&row| ["sand", "grass", "ice"][row / 100 % 3]).collect();
        let time = &stamps[part[0]..part[0] + part.len()];
        let values = [
            Values::Integer(time),
            Values::Float(&x),
            Values::Integer(&n),
            Values::Boolean(&on),
            Values::Text(&ground),
        ];
        writer.write(&values).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn text_dates_are_read_by_form() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dates.parquet");
    let open_dates = |date: &dyn Fn(usize) -> String| {
        let columns = vec![WriteColumn::new("time", WriteKind::Text), WriteColumn::new("x", WriteKind::Float)];
        let mut writer = ParquetWriter::create(&path, columns, &WriteOptions::default()).unwrap();
        let texts: Vec<String> = (0..60).map(date).collect();
        let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
        let x: Vec<f64> = (0..60).map(|row| f64::from(row * 37 % 17)).collect();
        writer.write(&[Values::Text(&texts), Values::Float(&x)]).unwrap();
        writer.finish().unwrap();
        open(&[&path], &Selection::new(["x"]))
    };
    // Twenty rows of the fourth of April and forty of the fifth: only the form of the first ones says the same in both orders.
    let slashes = open_dates(&|row| format!("{:02}/04/2021 09:00:{:02}", if row < 20 { 4 } else { 5 }, row));
    assert!(matches!(slashes, Err(Error::NoTimeColumn { .. })));
    let dashes = open_dates(&|row| format!("2021-04-{:02} 09:00:{:02}", if row < 20 { 4 } else { 5 }, row)).unwrap();
    assert_eq!(dashes.episodes().iter().map(|episode| episode.rows).sum::<usize>(), 60);
}

#[test]
fn times_of_the_day_pass_midnight() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.parquet");
    let columns = vec![WriteColumn::new("time", WriteKind::Text), WriteColumn::new("x", WriteKind::Float)];
    let mut writer = ParquetWriter::create(&path, columns, &WriteOptions::default()).unwrap();
    let text = |second: usize| format!("{:02}:{:02}:{:02}", second / 3600, second / 60 % 60, second % 60);
    let texts: Vec<String> = (0..60).map(|row| text((86_370 + row) % 86_400)).collect();
    let x: Vec<f64> = (0..60).map(|row| f64::from(row * 37 % 17)).collect();
    let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
    writer.write(&[Values::Text(&texts), Values::Float(&x)]).unwrap();
    writer.finish().unwrap();
    let recording = open(&[&path], &Selection::new(["x"])).unwrap();
    let episode = &recording.episodes()[0];
    assert_eq!((recording.episodes().len(), episode.end - episode.start), (1, 59_000_000_000));
    let stamps = recording.read(0, 28..33, Halo::default()).unwrap().stamps().to_vec();
    assert!(stamps.windows(2).all(|pair| pair[1] - pair[0] == 1_000_000_000), "{stamps:?}");
}

fn value(row: usize) -> f64 {
    if row % 977 == 5 { f64::NAN } else { (row as f64 * 0.01).sin() }
}

fn same(a: f64, b: f64) -> bool {
    a == b || a.is_nan() && b.is_nan()
}

fn all() -> Selection {
    Selection::new(["x", "n", "on", "ground"])
}

fn check(
    recording: &Recording,
    episode: usize,
    first: usize,
    rows: std::ops::Range<usize>,
    halo: Halo,
    stamps: &[i64],
) {
    let block = recording.read(episode, rows.clone(), halo).unwrap();
    let length = recording.episodes()[episode].rows;
    assert_eq!((block.first, block.rows), (rows.start, rows.len()));
    assert_eq!((block.before, block.after), (halo.before.min(rows.start), halo.after.min(length - rows.end)));
    let from = first + rows.start - block.before;
    for i in 0..block.before + block.rows + block.after {
        let row = from + i;
        assert_eq!(block.time[i], stamps[row]);
        assert!(same(block.column(0)[i], value(row)), "row {row}");
        assert_eq!(block.column(1)[i], row as f64 - 5.0);
        assert_eq!(block.column(2)[i], f64::from(u8::from(row.is_multiple_of(3))));
        assert_eq!(block.column(3)[i], [2.0, 0.0, 1.0][row / 100 % 3]);
    }
}

#[test]
fn ranges_with_halo_equal_written_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    let stamps: Vec<i64> = (0..10_000).map(|row| 1_700_000_000_000_000_000 + row * 1_000_003).collect();
    write(&path, &stamps, 3_000);
    let recording = open(&[&path], &all()).unwrap();
    assert_eq!(recording.notes(), [""; 0]);
    let columns = recording.columns();
    assert_eq!(columns[0].unit.as_deref(), Some("m"));
    assert_eq!(columns[3].kind, ColumnKind::Category(vec!["grass".into(), "ice".into(), "sand".into()]));
    assert_eq!((&columns[1].kind, &columns[2].kind), (&ColumnKind::Integer, &ColumnKind::Boolean));
    let episode = &recording.episodes()[0];
    assert_eq!((episode.rows, episode.start, episode.end), (10_000, stamps[0], stamps[9_999]));
    assert!((episode.period - 1.000003e-3).abs() < 1e-15);
    assert_eq!(episode.name, "a.parquet");
    // Forward, backward, across row groups, empty, with halos: the cache of decoders must not show.
    let mut ranges = vec![
        (0..100, 0),
        (100..4_000, 7),
        (2_990..3_010, 3),
        (9_999..10_000, 50),
        (0..10_000, 0),
        (5..5, 2),
        (17..18, 100),
    ];
    ranges.extend((0..10_000).step_by(999).map(|from| (from..(from + 999).min(10_000), 11)));
    for (rows, halo) in ranges {
        check(&recording, 0, 0, rows, Halo { before: halo, after: halo / 2 }, &stamps);
    }
    assert!(recording.read(0, 9_000..10_001, Halo::default()).is_err());
}

#[test]
fn many_threads_read_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    let stamps: Vec<i64> = (0..40_000).map(|row| row * 1_000_000).collect();
    write(&path, &stamps, 15_000);
    let recording = open(&[&path], &all()).unwrap();
    for threads in [1, 2, 7] {
        for chunk in [512, 4_096] {
            let count = 40_000usize.div_ceil(chunk);
            with_threads(threads, || {
                parallel_map(count, &fleetfoot_data::Silent, |i| {
                    let rows = i * chunk..((i + 1) * chunk).min(40_000);
                    check(&recording, 0, 0, rows, Halo { before: 3, after: 5 }, &stamps);
                    Ok::<_, fleetfoot_data::Cancelled>(())
                })
            })
            .unwrap();
        }
    }
}

#[test]
fn episodes_end_at_gaps_and_backward_stamps() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.parquet");
    let mut stamps: Vec<i64> = (0..3_000).map(|row| row * 1_000_000).collect();
    stamps[100] = stamps[99];
    stamps[1_500..].iter_mut().for_each(|stamp| *stamp += 6_000_000);
    stamps[2_000..].iter_mut().for_each(|stamp| *stamp -= 1_000_000_000);
    write(&path, &stamps, 1_024);
    let recording = open(&[&path], &all()).unwrap();
    let rows: Vec<_> = recording.episodes().iter().map(|episode| episode.rows).collect();
    assert_eq!(rows, [1_499, 500, 1_000]);
    let names: Vec<_> = recording.episodes().iter().map(|episode| episode.name.as_str()).collect();
    assert_eq!(names, ["cut.parquet#1", "cut.parquet#2", "cut.parquet#3"]);
    let block = recording.read(0, 95..105, Halo { before: 1, after: 1 }).unwrap();
    assert_eq!(block.column(1), [89.0, 90.0, 91.0, 92.0, 93.0, 94.0, 96.0, 97.0, 98.0, 99.0, 100.0, 101.0]);
    check(&recording, 1, 1_500, 0..500, Halo { before: 4, after: 4 }, &stamps);
    check(&recording, 2, 2_000, 0..10, Halo { before: 4, after: 4 }, &stamps);
    let notes = recording.notes().join("\n");
    for word in ["1 row with the stamp of the row before", "1 backward stamp where", "1 gap longer"] {
        assert!(notes.contains(word), "{notes}");
    }
    let whole = open(&[&path], &Selection { max_gap: MaxGap::Unlimited, ..all() }).unwrap();
    assert_eq!(whole.episodes().len(), 2);
    let fine = open(&[&path], &Selection { max_gap: MaxGap::Seconds(0.0015), ..all() }).unwrap();
    assert_eq!(fine.episodes().len(), 4);
}

#[test]
fn the_order_of_files_and_their_layout_do_not_matter() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b, c) = (folder.path().join("a.parquet"), folder.path().join("b.parquet"), folder.path().join("c.parquet"));
    let stamps: Vec<i64> = (0..2_000).map(|row| row * 1_000_000).collect();
    write(&a, &stamps, 500);
    write(&b, &stamps[..1_000], 10_000);
    write(&c, &stamps, 2_000);
    let forward = open(&[&a, &b], &all()).unwrap();
    let backward = open(&[&b, &a, &a], &Selection::new(["ground", "on", "n", "x", "x"])).unwrap();
    let ids = |recording: &Recording| recording.episodes().iter().map(|episode| episode.id).collect::<Vec<_>>();
    assert_eq!(ids(&forward), ids(&backward));
    match open(&[&a, &c], &all()) {
        Err(Error::Duplicate { first, second }) => {
            assert_eq!((first.as_str(), second.as_str()), ("a.parquet", "c.parquet"))
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(open(&[&a, &c], &Selection { allow_duplicates: true, ..all() }).unwrap().episodes().len(), 2);
}

#[test]
fn clocks_of_all_kinds() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    let stamps: Vec<i64> = (0..100).map(|row| row * 20_000_000).collect();
    write(&path, &stamps, 64);
    let selection = |time| Selection { time, ..Selection::new(["n"]) };
    let uniform = open(&[&path], &selection(TimeSpec::Uniform { dt_seconds: 0.01 })).unwrap();
    let block = uniform.read(0, 10..12, Halo::default()).unwrap();
    assert_eq!((uniform.episodes()[0].end, block.stamps()), (990_000_000, &[100_000_000, 110_000_000][..]));
    let ms = TimeSpec::Column { name: "n".into(), unit: Some(TimeUnit::Milliseconds) };
    let counted = open(&[&path], &selection(ms)).unwrap();
    assert_eq!((counted.episodes()[0].start, counted.episodes()[0].period), (-5_000_000, 1e-3));
    let message =
        open(&[&path], &selection(TimeSpec::Column { name: "tt".into(), unit: None })).unwrap_err().to_string();
    assert!(message.contains("a.parquet") && message.contains("`tt`") && message.contains("`t`"), "{message}");
    let message = open(&[&path], &Selection::new(["grond"])).unwrap_err().to_string();
    assert!(message.contains("`ground`"), "{message}");
    assert!(matches!(
        open(&[&path], &selection(TimeSpec::Uniform { dt_seconds: -1.0 })),
        Err(Error::BadSeconds { .. })
    ));
}

#[test]
fn inspection_reports_columns_clock_and_ranges() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    let mut stamps: Vec<i64> = (0..2_000).map(|row| row * 1_000_000).collect();
    stamps[1_000..].iter_mut().for_each(|stamp| *stamp += 1_000_000_000);
    write(&path, &stamps, 512);
    let info = inspect(&path).unwrap();
    assert_eq!((info.rows, info.columns.len(), info.clock.as_ref().unwrap().column.as_str()), (Some(2_000), 5, "t"));
    assert_eq!(info.columns[1].unit.as_deref(), Some("m"));
    assert_eq!(info.columns[1].statistics, None);
    let info = inspect_values(&path, &fleetfoot_data::Silent).unwrap();
    let clock = info.clock.unwrap().summary.unwrap();
    assert_eq!((clock.gaps, clock.backward, info.episodes), (1, 0, Some(2)));
    assert!((clock.period - 1e-3).abs() < 1e-12 && (clock.largest_step - 1.001).abs() < 1e-9);
    let x = info.columns[1].statistics.unwrap();
    let expected: Vec<f64> = (0..2_000).map(value).filter(|value| !value.is_nan()).collect();
    assert_eq!((x.count, x.missing), (expected.len(), 2_000 - expected.len()));
    assert!((x.mean - expected.iter().sum::<f64>() / expected.len() as f64).abs() < 1e-12);
    assert_eq!(x.max, expected.iter().copied().fold(f64::MIN, f64::max));
    let n = info.columns[2].statistics.unwrap();
    assert_eq!((n.min, n.max, n.mean), (-5.0, 1_994.0, 994.5));
}

#[test]
fn writing_is_atomic_and_spares_the_inputs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    write(&path, &[0, 1_000_000], 10);
    let before = std::fs::read(&path).unwrap();
    let columns = || vec![WriteColumn::new("x", WriteKind::Float)];
    let options = WriteOptions { inputs: vec![path.clone()], ..WriteOptions::default() };
    let alias = folder.path().join("../").join(folder.path().file_name().unwrap()).join("a.parquet");
    assert!(matches!(
        ParquetWriter::create(&alias, columns(), &options),
        Err(fleetfoot_output::Error::OverwritesInput { .. })
    ));
    let mut writer = ParquetWriter::create(&path, columns(), &WriteOptions::default()).unwrap();
    writer.write(&[Values::Float(&[1.0])]).unwrap();
    assert!(matches!(writer.write(&[Values::Integer(&[1])]), Err(fleetfoot_output::Error::BadBatch { .. })));
    assert!(matches!(writer.write(&[]), Err(fleetfoot_output::Error::BadBatch { .. })));
    drop(writer);
    assert_eq!(std::fs::read(&path).unwrap(), before);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let again = folder.path().join("b.parquet");
    write(&again, &[0, 1_000_000], 10);
    assert_eq!(std::fs::read(&again).unwrap(), before, "the same input gives the same bytes");
}

/// Three episodes of LeRobot in two files, of which the tables about episodes and tasks are no rows.
#[test]
fn lists_of_a_lerobot_data_set_are_columns() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/lerobot");
    let files = fleetfoot_log::paths([&folder]).unwrap();
    let names: Vec<_> = files.iter().map(|path| path.strip_prefix(&folder).unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["data/chunk-000/file-000.parquet", "data/chunk-000/file-001.parquet"]);
    let columns = ["observation.state[0]", "observation.state[1]", "observation.state[2]", "action[1]", "index"];
    let recording = fleetfoot_log::open(&files, &Selection::new(columns)).unwrap();
    let lengths: Vec<usize> = recording.episodes().iter().map(|episode| episode.rows).collect();
    assert_eq!(lengths, [150, 120, 90]);
    let (step, mut index) = (0.02, 0.0);
    for (number, rows) in lengths.into_iter().enumerate() {
        // With rows before and in the middle, as decoders skip.
        let block = recording.read(number, 0..rows, Halo::default()).unwrap();
        let late = recording.read(number, 77..80, Halo::default()).unwrap();
        let mut v = 1.0 - number as f64;
        for k in 0..rows {
            let (row, phase) = (k as f64, number as f64);
            let u = (0.05 * row + phase).sin() + 0.3 * (0.37 * row).cos();
            let truth = [v, -v, row % 3.0, 2.0 * u].map(|value| f64::from(value as f32));
            for (place, value) in truth.into_iter().chain([index]).enumerate() {
                assert!((block.column(place)[k] - value).abs() < 1e-6, "episode {number}, row {k}, {place}");
                if (77..80).contains(&k) {
                    assert_eq!(late.column(place)[k - 77], block.column(place)[k]);
                }
            }
            assert!((block.stamps()[k] - k as i64 * 20_000_000).abs() < 1000);
            (v, index) = (v + step * (3.0 * u - 2.0 * v), index + 1.0);
        }
    }
    // Lists of several lengths are no columns.
    let about = folder.join("meta/episodes/chunk-000/file-000.parquet");
    let info = fleetfoot_log::inspect(&about).unwrap();
    assert!(info.columns.iter().any(|column| column.unsupported.as_deref() == Some("list")));
}
