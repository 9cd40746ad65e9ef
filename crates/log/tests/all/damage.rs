//! Damaged, truncated and lying files: always an error that names the file, or the right rows; never a panic, a hang or all the memory.

use std::{io::Write, path::Path};

use fleetfoot_data::{Halo, Source};
use fleetfoot_log::{Error, MaxGap, Selection, TimeSpec, inspect, open};
use fleetfoot_output::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions};

const ROWS: usize = 400;

fn parquet(compress: bool) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    let columns = vec![
        WriteColumn::new("t", WriteKind::Stamp),
        WriteColumn::new("x", WriteKind::Float),
        WriteColumn::new("c", WriteKind::Text),
    ];
    let options = WriteOptions { compress, row_group_rows: 150, ..WriteOptions::default() };
    let mut writer = ParquetWriter::create(&path, columns, &options).unwrap();
    let stamps: Vec<i64> = (0..ROWS as i64).map(|row| row * 1_000_000).collect();
    let x: Vec<f64> = (0..ROWS).map(|row| row as f64).collect();
    let c: Vec<&str> = (0..ROWS).map(|row| ["a", "b"][row % 2]).collect();
    writer.write(&[Values::Integer(&stamps), Values::Float(&x), Values::Text(&c)]).unwrap();
    writer.finish().unwrap();
    std::fs::read(path).unwrap()
}

/// Opens, inspects and reads everything that can be read. What fails must name the file.
fn exercise(path: &Path, time: TimeSpec) -> Result<Vec<f64>, String> {
    let named = |message: String| {
        assert!(message.contains("hostile"), "{message}");
        message
    };
    let _ = inspect(path).map_err(|error| named(error.to_string()));
    let selection =
        Selection { time, max_gap: MaxGap::Unlimited, allow_duplicates: true, ..Selection::new(["x", "c"]) };
    let recording = open(&[path], &selection).map_err(|error| named(error.to_string()))?;
    let mut all = Vec::new();
    for (episode, info) in recording.episodes().iter().enumerate() {
        // A count of rows that lies must be found before anybody believes it.
        assert!(info.rows <= ROWS, "{} rows", info.rows);
        for from in (0..info.rows).step_by(64) {
            let rows = from..(from + 64).min(info.rows);
            let block = recording
                .read(episode, rows, Halo { before: 2, after: 2 })
                .map_err(|error| named(error.to_string()))?;
            all.extend_from_slice(block.core(0));
        }
    }
    Ok(all)
}

fn clocks() -> [TimeSpec; 2] {
    [TimeSpec::Auto, TimeSpec::Uniform { dt_seconds: 0.001 }]
}

#[test]
fn a_parquet_file_cut_anywhere_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hostile.parquet");
    let bytes = parquet(true);
    for end in (0..bytes.len()).step_by(13).chain(bytes.len() - 20..bytes.len()) {
        std::fs::write(&path, &bytes[..end]).unwrap();
        assert!(exercise(&path, TimeSpec::Auto).is_err(), "cut at {end}");
    }
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(exercise(&path, TimeSpec::Auto).unwrap(), (0..ROWS).map(|row| row as f64).collect::<Vec<_>>());
}

/// Returns true if the sweeps have their full size (`make test-all`).
fn full() -> bool {
    std::env::var_os("FLEETFOOT_SWEEPS").is_some_and(|size| size == "full")
}

#[test]
fn flipped_bytes_of_a_parquet_file_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hostile.parquet");
    let (mut refused, mut read) = (0, 0);
    let rounds = if full() { 1_500 } else { 250 };
    for compress in [true, false] {
        let bytes = parquet(compress);
        // A fixed linear congruential sequence: the same damage every time.
        let mut state = 0x2545_f491_4f6c_dd1du64;
        let mut next = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize
        };
        for round in 0..rounds {
            let mut damaged = bytes.clone();
            // Half of the damage falls on the footer, where lengths and counts are.
            let from = if round % 2 == 0 { bytes.len().saturating_sub(1_200) } else { 0 };
            for _ in 0..1 + round % 3 {
                let at = from + next() % (bytes.len() - from);
                damaged[at] = match next() % 3 {
                    0 => next() as u8,
                    1 => damaged[at] ^ (1 << (next() % 8)),
                    _ => 0xff,
                };
            }
            std::fs::write(&path, &damaged).unwrap();
            for time in clocks() {
                match exercise(&path, time) {
                    Ok(_) => read += 1,
                    Err(_) => refused += 1,
                }
            }
        }
    }
    // Flips in values and statistics go unnoticed, those in structure do not.
    assert!(refused > rounds / 3 && read > rounds / 3, "{refused} refused, {read} read");
}

#[test]
fn garbage_and_wrong_extensions_have_different_errors() {
    let folder = tempfile::tempdir().unwrap();
    let garbage: Vec<u8> = (0..5_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let text = b"t_s,x,c\n0,1,a\n1,2,b\n".to_vec();
    let framed = [&b"PAR1"[..], &garbage, &[0x10, 0x10, 0, 0], b"PAR1"].concat();
    let huge = [&b"PAR1"[..], &garbage, &[0xff, 0xff, 0xff, 0x7f], b"PAR1"].concat();
    let zeros = vec![0u8; 1000];
    for (name, bytes) in [
        ("hostile.parquet", &garbage),
        ("hostile.parquet", &text),
        ("hostile.parquet", &framed),
        ("hostile.parquet", &huge),
        ("hostile.parquet", &zeros),
        ("hostile.parquet", &Vec::new()),
        ("hostile.csv", &garbage),
        ("hostile.csv", &parquet(true)),
        ("hostile.csv", &Vec::new()),
        ("hostile.csv.gz", &garbage),
        ("hostile.csv.zst", &garbage),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        assert!(exercise(&path, TimeSpec::Auto).is_err());
    }
}

#[test]
fn a_compressed_text_cut_anywhere_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let text: String = std::iter::once("t_s,x,c\n".to_owned())
        .chain((0..ROWS).map(|i| format!("{i},{},a\n", i * 7919 % 1000)))
        .collect();
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(text.as_bytes()).unwrap();
    let gz = encoder.finish().unwrap();
    let zst = zstd::encode_all(text.as_bytes(), 3).unwrap();
    for (name, bytes) in [("hostile.csv.gz", gz), ("hostile.csv.zst", zst)] {
        let path = folder.path().join(name);
        let near = |end: &usize| *end < 64 || end + 64 > bytes.len();
        for end in (0..bytes.len()).filter(|end| full() || near(end) || end % 7 == 0) {
            std::fs::write(&path, &bytes[..end]).unwrap();
            assert!(exercise(&path, TimeSpec::Auto).is_err(), "{name} cut at {end}");
        }
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(exercise(&path, TimeSpec::Auto).unwrap().len(), ROWS);
    }
}

#[test]
fn truncated_text_gives_whole_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hostile.csv");
    let text: String =
        std::iter::once("t_s,x,c\n".to_owned()).chain((0..40).map(|i| format!("{i},{},a\n", i + 100))).collect();
    for end in 0..text.len() {
        std::fs::write(&path, &text[..end]).unwrap();
        if let Ok(values) = exercise(&path, TimeSpec::Auto) {
            let whole = text[..end].matches('\n').count() - 1;
            assert!(
                values.len() == whole || values.len() == whole + 1,
                "cut at {end}: {} rows of {whole}",
                values.len()
            );
            assert!(values.iter().take(whole).enumerate().all(|(i, &value)| value == i as f64 + 100.0));
        }
    }
}

#[test]
fn endless_rows_are_stopped() {
    let folder = tempfile::tempdir().unwrap();
    // 200 MB of one row in a file of 200 kB; and a quote that never closes.
    for filler in [&b"1"[..], b"\"1,2,3\n"] {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(b"t_s,x,c\n0,1,a\n1,2,b\n2,").unwrap();
        encoder.write_all(&filler[..1]).unwrap();
        let block = filler[filler.len().min(1)..].repeat(200_000);
        let block = if block.is_empty() { vec![b'1'; 1_000_000] } else { block };
        for _ in 0..200_000_000 / block.len() {
            encoder.write_all(&block).unwrap();
        }
        let path = folder.path().join("hostile.csv.gz");
        std::fs::write(&path, encoder.finish().unwrap()).unwrap();
        let message = open(&[&path], &Selection::new(["x"])).unwrap_err().to_string();
        assert!(message.contains("64 MiB") && message.contains("hostile"), "{message}");
    }
}

#[test]
fn changed_file_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hostile.parquet");
    let bytes = parquet(true);
    std::fs::write(&path, &bytes).unwrap();
    let recording = open(&[&path], &Selection::new(["x"])).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 9]).unwrap();
    let mut failed = false;
    for from in (0..ROWS).step_by(50) {
        match recording.read(0, from..from + 50, Halo::default()) {
            Ok(block) => assert_eq!(block.core(0)[0], from as f64),
            Err(error) => {
                assert!(error.to_string().contains("changed"), "{error}");
                failed = true;
            }
        }
    }
    assert!(failed);
    assert!(matches!(open(&[&path], &Selection::new(["x"])), Err(Error::WrongFormat { .. })));
}
