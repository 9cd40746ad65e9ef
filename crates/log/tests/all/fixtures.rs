//! Files that pyarrow wrote (`tests/data/make_fixtures.py`): types, encodings, codecs and clocks.

use std::path::PathBuf;

use fleetfoot_data::{ColumnKind, Halo, Source};
use fleetfoot_log::{Error, Recording, Selection, TimeSpec, inspect, open};

const ROWS: usize = 300;

fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(format!("{name}.parquet"))
}

fn columns(recording: &Recording) -> Vec<Vec<f64>> {
    let rows = recording.episodes()[0].rows;
    recording.read(0, 0..rows, Halo::default()).unwrap().columns.iter().map(|column| column.to_vec()).collect()
}

#[test]
fn every_numeric_type_with_nulls() {
    let code = |i: usize| [2.0, 0.0, 1.0][i % 3];
    type Formula<'a> = &'a dyn Fn(usize) -> f64;
    let expected: [(&str, Formula<'_>); 20] = [
        ("i8", &|i| (i % 100) as f64 - 50.0),
        ("u8", &|i| (i % 256) as f64),
        ("i16", &|i| i as f64 - 150.0),
        ("u16", &|i| i as f64 + 65_000.0),
        ("i32", &|i| i as f64 - 150.0),
        ("u32", &|i| i as f64 + 4_294_966_000.0),
        ("i64", &|i| i as f64 - 150.0),
        ("u64", &|i| i as f64 + 2f64.powi(63)),
        ("f32", &|i| i as f64 / 4.0),
        ("f64", &|i| i as f64 / 3.0),
        ("bool", &|i| f64::from(u8::from(i % 2 == 0))),
        ("dec9", &|i| (i as f64 - 150.0) / 100.0),
        ("dec38", &|i| (i as f64 - 150.0) / 100.0),
        ("dict", &code),
        ("text", &code),
        ("dict_int", &|i| (i % 5 * 10) as f64),
        ("date", &|i| i as f64 * 86_400.0),
        ("ms", &|i| i as f64 * 1.5),
        ("pose.x", &|i| i as f64 / 2.0),
        ("pose.deep.y", &|i| i as f64),
    ];
    for file in ["types", "types_v2"] {
        let recording = open(&[fixture(file)], &Selection::new(expected.iter().map(|(name, _)| *name))).unwrap();
        assert_eq!(recording.episodes()[0].start, 1_700_000_000_000_000_000);
        assert!((recording.episodes()[0].period - 0.01).abs() < 1e-15);
        let category = ColumnKind::Category(["dry", "ice", "wet"].map(String::from).into());
        assert_eq!((&recording.columns()[13].kind, &recording.columns()[14].kind), (&category, &category));
        for ((name, formula), values) in expected.iter().zip(columns(&recording)) {
            for (i, &value) in values.iter().enumerate() {
                let null = i % 7 == 3 && !name.starts_with("pose");
                assert!(if null { value.is_nan() } else { value == formula(i) }, "{file} {name} row {i}: {value}");
            }
        }
        // The same rows in small steps, with the page index and without.
        let whole = columns(&recording);
        for from in (0..ROWS).step_by(17) {
            let rows = from..(from + 17).min(ROWS);
            let block = recording.read(0, rows.clone(), Halo::default()).unwrap();
            for (c, column) in whole.iter().enumerate() {
                let bits = |values: &[f64]| {
                    values.iter().map(|value| if value.is_nan() { 0 } else { value.to_bits() }).collect::<Vec<_>>()
                };
                assert_eq!(bits(block.core(c)), bits(&column[rows.clone()]));
            }
        }
    }
    let recording = open(&[fixture("types")], &Selection::new(["f16"])).unwrap();
    assert_eq!(columns(&recording)[0], (0..ROWS).map(|i| i as f64 / 8.0).collect::<Vec<_>>());
}

#[test]
fn equal_length_lists_are_columns() {
    let recording = open(&[fixture("types")], &Selection::new(["list[0]", "list[1]"])).unwrap();
    assert_eq!(columns(&recording), [vec![1.0; ROWS], vec![2.0; ROWS]]);
    let uneven = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/data/lerobot/meta/episodes/chunk-000/file-000.parquet");
    for (path, name, word) in [(fixture("types"), "binary", "binary"), (uneven, "tasks.list.element", "list")] {
        let listed = inspect(&path).unwrap();
        let column = listed.columns.iter().find(|column| column.name == name).unwrap();
        assert_eq!(column.unsupported.as_deref(), Some(word));
        let message = open(&[&path], &Selection::new([name])).unwrap_err().to_string();
        assert!(message.contains(".parquet") && message.contains(word), "{message}");
    }
}

#[test]
fn clocks_of_all_units() {
    for (name, step) in [
        ("clock_s", 1.0),
        ("clock_ms", 0.01),
        ("clock_us", 0.01),
        ("clock_ns", 0.01),
        ("clock_int96", 0.01),
        ("clock_text", 0.01),
    ] {
        let recording = open(&[fixture(name)], &Selection::new(["x"])).unwrap();
        let episode = &recording.episodes()[0];
        assert_eq!((episode.rows, episode.start), (ROWS, 1_700_000_000_000_000_000), "{name}");
        assert_eq!(episode.period, step, "{name}");
        assert_eq!(recording.notes(), [""; 0], "{name}");
    }
    // The same data under four clocks is the same episode wherever the stamps agree.
    let id = |name| open(&[fixture(name)], &Selection::new(["x"])).unwrap().episodes()[0].id;
    for name in ["clock_us", "clock_ns", "clock_int96", "clock_text"] {
        assert_eq!(id(name), id("clock_ms"), "{name}");
    }
}

#[test]
fn durations_are_seconds_and_may_be_the_clock() {
    let names = ["s", "ms", "us", "ns", "a.us", "__index_level_0__"];
    let index = TimeSpec::Column { name: "__index_level_0__".into(), unit: None };
    // The index is the first that rises, and found by itself too.
    for time in [index, TimeSpec::Auto] {
        let selection = Selection { time, ..Selection::new(names) };
        let recording = open(&[fixture("durations")], &selection).unwrap();
        let episode = &recording.episodes()[0];
        assert_eq!((episode.rows, episode.start, episode.end), (ROWS, 0, 299 * 50_000_000));
        assert_eq!(episode.period, 0.05);
        let columns_read = columns(&recording);
        for row in 0..episode.rows {
            let count = row as f64 * 1_500.0;
            let null = row % 7 == 3;
            for (c, per_second) in [(0, 1.0), (1, 1e3), (2, 1e6), (3, 1e9)] {
                let value = columns_read[c][row];
                assert!(if null { value.is_nan() } else { value == count / per_second }, "{} {row}: {value}", names[c]);
            }
            assert_eq!((columns_read[4][row], columns_read[5][row]), (row as f64 / 1e6, row as f64 * 5e7 / 1e9));
        }
    }
}

#[test]
fn codecs_encodings_and_units() {
    let recording = open(&[fixture("codecs")], &Selection::new(["v"])).unwrap();
    assert_eq!(recording.columns()[0].unit.as_deref(), Some("m/s"));
    assert_eq!(columns(&recording)[0][4..6], [1.0, 1.25]);
    assert_eq!(recording.episodes()[0].end, 2_990_000_000);
    let recording = open(&[fixture("lz4_delta")], &Selection::new(["n"])).unwrap();
    assert_eq!((recording.episodes()[0].end, columns(&recording)[0][299]), (299 * 20_000_000, 299.0));
}

#[test]
fn file_without_rows_is_refused() {
    for time in [TimeSpec::Auto, TimeSpec::Uniform { dt_seconds: 0.1 }] {
        let selection = Selection { time, ..Selection::new(["x"]) };
        assert!(matches!(open(&[fixture("empty")], &selection), Err(Error::NoRows { .. })));
    }
    assert_eq!(inspect(fixture("empty")).unwrap().rows, Some(0));
}
