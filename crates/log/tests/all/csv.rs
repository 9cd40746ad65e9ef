//! Text files: accepted forms, and refusals with their places.

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use fleetfoot_data::{ColumnKind, Halo, Source};
use fleetfoot_log::{Base, Error, Recording, Selection, TimeSpec, TimeUnit, inspect, inspect_values, open};
use fleetfoot_output::{CsvWriter, Values, WriteColumn, WriteKind};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

fn read(recording: &Recording) -> (Vec<i64>, Vec<Vec<f64>>) {
    let block = recording.read(0, 0..recording.episodes()[0].rows, Halo::default()).unwrap();
    (block.time.to_vec(), block.columns.iter().map(|column| column.to_vec()).collect())
}

fn open_one(path: &Path, columns: &[&str]) -> Result<Recording, Error> {
    open(&[path], &Selection::new(columns.iter().copied()))
}

fn message(path: &Path, columns: &[&str]) -> String {
    open_one(path, columns).unwrap_err().to_string()
}

#[test]
fn delimiters_quotes_line_ends_marks_and_comments() {
    let folder = Folder::new();
    let expected = (vec![0, 10_000_000, 20_000_000], vec![vec![1.5, -2.0, 3e3], vec![0.0, 1.0, 2.0]]);
    let texts = [
        "t,x,n\n0,1.5,0\n0.01,-2,1\n0.02,3e3,2\n",
        "\u{feff}t;x;n\r\n0;1.5;0\r\n0.01;-2;1\r\n0.02;3e3;2",
        "t;x;n\n0;1,5;0\n0,01;-2;1\n0,02;3e3;2\n",
        "t\tx\tn\n0\t1.5\t0\n\n0.01\t-2\t1\n\n\n0.02\t3e3\t2\n\n",
        "# made by hand\n\nt , x , n\n0, 1.5 ,0\n# in between\n0.01,\"-2\",1\n0.02,3e3,\"2\"\n",
        "# t,x,n\n0,1.5,0\n0.01,-2,1\n0.02,3e3,2\n",
        "\"t\",\"x\",\"n\"\n0,1.5,0\n0.01,-2,1\n0.02,3e3,2\n",
    ];
    for (i, text) in texts.iter().enumerate() {
        let recording = open_one(&folder.file(&format!("{i}.csv"), text), &["x", "n"]).unwrap();
        assert_eq!(read(&recording), expected, "{text:?}");
        assert_eq!(recording.columns()[1].kind, ColumnKind::Integer, "{text:?}");
    }
}

#[test]
fn compressed_files_read_like_plain_ones() {
    let folder = Folder::new();
    let text: String = std::iter::once("t,x\n".to_owned())
        .chain((0..5_000).map(|i| format!("{},{}\n", f64::from(i) * 0.01, i * i)))
        .collect();
    let plain = open_one(&folder.file("a.csv", &text), &["x"]).unwrap();
    // Two members, as log rotation leaves them.
    let mut gz = Vec::new();
    for part in [&text[..1_000], &text[1_000..]] {
        let mut encoder = flate2::write::GzEncoder::new(&mut gz, flate2::Compression::fast());
        encoder.write_all(part.as_bytes()).unwrap();
        encoder.finish().unwrap();
    }
    let gz = open_one(&folder.file("b.csv.gz", gz), &["x"]).unwrap();
    let zst = open_one(&folder.file("c.csv.zst", zstd::encode_all(text.as_bytes(), 1).unwrap()), &["x"]).unwrap();
    for other in [gz, zst] {
        assert_eq!(read(&other), read(&plain));
        assert_eq!(other.episodes()[0].id, plain.episodes()[0].id);
    }
}

#[test]
fn epoch_seconds_keep_nine_decimals() {
    let folder = Folder::new();
    let path =
        folder.file("a.csv", "stamp,x\n1700000000.123456789,1\n1700000000.123456790,2\n1700000000.123456791,3\n");
    assert_eq!(
        read(&open_one(&path, &["x"]).unwrap()).0,
        [1_700_000_000_123_456_789, 1_700_000_000_123_456_790, 1_700_000_000_123_456_791]
    );
}

#[test]
fn dates_and_whole_numbers_as_clocks() {
    let folder = Folder::new();
    let second = 1_000_000_000;
    let path =
        folder.file("a.csv", "timestamp,x\n2011-07-23 13:23:09,1\n2011-07-23 13:23:10,2\n2011-07-23T13:23:11.5Z,3\n");
    let start = 1_311_427_389 * second;
    assert_eq!(read(&open_one(&path, &["x"]).unwrap()).0, [start, start + second, start + 2_500_000_000]);
    let path = folder.file("b.csv", "time,x\n1700000000000,1\n1700000000010,2\n");
    let recording = open_one(&path, &["x"]).unwrap();
    assert_eq!(recording.episodes()[0].start, 1_700_000_000 * second);
    assert!(recording.notes()[0].contains("ms"), "{:?}", recording.notes());
    let path = folder.file("c.csv", "time_us,x\n0,1\n10,2\n");
    let recording = open_one(&path, &["x"]).unwrap();
    assert_eq!((recording.episodes()[0].end, recording.notes().len()), (10_000, 0));
    let given = TimeSpec::Column { name: "time_us".into(), unit: Some(TimeUnit::Seconds) };
    let recording = open(&[&path], &Selection { time: given, ..Selection::new(["x"]) }).unwrap();
    assert_eq!(recording.episodes()[0].end, 10 * second);
    // Two files whose guesses differ: one of them must be wrong.
    let (d, e) =
        (folder.file("d.csv", "time,x\n0,1\n10,2\n20,3\n"), folder.file("e.csv", "time,x\n0,1\n10000,2\n20000,3\n"));
    assert!(matches!(open(&[d, e], &Selection::new(["x"])), Err(Error::ColumnsDisagree { .. })));
}

#[test]
fn missing_values_categories_and_truth_values() {
    let folder = Folder::new();
    let a = folder
        .file("a.csv", "t_s,x,ground,on,sparse\n0,1,sand,true,\n1,NaN,grass,False,\n2,null,,yes,\n3,inf,sand,0,7\n");
    let b = folder.file("b.csv", "t_s,x,ground,on,sparse\n0,5,ice,no,\n1,6,grass,1,\n");
    let recording = open(&[&b, &a], &Selection::new(["x", "ground", "on", "sparse"])).unwrap();
    assert_eq!(recording.columns()[1].kind, ColumnKind::Category(["grass", "ice", "sand"].map(String::from).into()));
    assert_eq!(recording.columns()[2].kind, ColumnKind::Boolean);
    let (_, columns) = read(&recording);
    assert!(columns[0][0] == 1.0 && columns[0][1..].iter().all(|value| value.is_nan()));
    assert!(columns[1][2].is_nan());
    assert_eq!((columns[1][0], columns[1][1], columns[1][3]), (2.0, 0.0, 2.0));
    assert_eq!(columns[2], [1.0, 0.0, 1.0, 0.0]);
    assert_eq!(columns[3][3], 7.0);
    let block = recording.read(1, 0..2, Halo::default()).unwrap();
    assert_eq!(block.column(1), [1.0, 0.0]);
    // A category's codes depend on its company, the identity does not.
    let alone = open(&[&a], &Selection::new(["x", "ground", "on", "sparse"])).unwrap();
    assert_eq!(alone.episodes()[0].id, recording.episodes()[0].id);
}

#[test]
fn missing_repeated_and_backward_stamps() {
    let folder = Folder::new();
    let path = folder.file("a.csv", "t,x\n0,0\n0.1,1\n0.1,2\n,3\n0.2,4\n0.3,5\n0.1,6\n0.2,7\n9,8\n");
    let recording = open_one(&path, &["x"]).unwrap();
    let rows: Vec<_> = recording.episodes().iter().map(|episode| episode.rows).collect();
    assert_eq!(rows, [4, 2, 1]);
    let block = recording.read(0, 1..3, Halo { before: 9, after: 9 }).unwrap();
    assert_eq!(block.column(0), [0.0, 1.0, 4.0, 5.0]);
    assert_eq!(recording.notes().len(), 5, "{:?}", recording.notes());
    let message = message(&folder.file("b.csv", "t,x\n,0\nnan,1\n"), &["x"]);
    assert!(message.contains("`t`") || message.contains("time column"), "{message}");
}

#[test]
fn units_in_headers_and_files_without_one() {
    let folder = Folder::new();
    let path = folder.file("a.csv", "t [ms],v [m/s],w (rad/s)\n0,1,2\n10,2,3\n");
    let recording = open_one(&path, &["v [m/s]", "w (rad/s)"]).unwrap();
    assert_eq!(recording.columns()[0].unit.as_deref(), Some("m/s"));
    assert_eq!(recording.columns()[1].unit.as_deref(), Some("rad/s"));
    assert_eq!(recording.episodes()[0].end, 10_000_000);
    let path = folder.file("b.csv", "0,1.5\n0.5,3.5\n1.0,2.5\n");
    let recording = open_one(&path, &["c1"]).unwrap();
    assert_eq!(read(&recording).1, [[1.5, 3.5, 2.5]]);
    assert!(recording.notes().iter().any(|note| note.contains("no header")), "{:?}", recording.notes());
    assert!(recording.notes().iter().any(|note| note.contains("`c0` is taken as the time")), "{:?}", recording.notes());
}

#[test]
fn wrong_cells_and_ragged_rows_name_the_line() {
    let folder = Folder::new();
    for end in ["\n", "\r\n"] {
        let body = ["t_s,x,y", "", "0,1,1", "# note", "1,2,2", "", "2,oops,3", "3,4,4", ""].join(end);
        let text = message(&folder.file("a.csv", &body), &["x"]);
        assert!(
            text.contains("a.csv:7:") && text.contains("`x`") && text.contains("`oops`") && text.contains("number"),
            "{text}"
        );
        assert!(open_one(&folder.file("a.csv", &body), &["y"]).is_ok(), "an unselected column is not read");
        let body = ["t_s,x,y", "0,1,1", "1,2", "2,3,3", ""].join(end);
        let text = message(&folder.file("b.csv", &body), &["x"]);
        assert!(text.contains("b.csv:3:") && text.contains("2 fields") && text.contains("has 3"), "{text}");
    }
    let text =
        message(&folder.file("c.csv", "timestamp,x\n2011-07-23 13:23:09,1\nnever,2\n2011-07-23 13:23:10,2\n"), &["x"]);
    assert!(text.contains("c.csv:3:") && text.contains("`never`") && text.contains("date"), "{text}");
    // Too many fields are never a cut line.
    assert!(matches!(
        open_one(&folder.file("e.csv", "t_s,x\n0,1\n1,2,3"), &["x"]),
        Err(Error::RaggedRow { line: 3, fields: 3, .. })
    ));
}

#[test]
fn a_cut_last_line_is_dropped_with_a_note() {
    let folder = Folder::new();
    let recording = open_one(&folder.file("a.csv", "t_s,x\n0,1\n1,2\n2"), &["x"]).unwrap();
    assert_eq!(recording.episodes()[0].rows, 2);
    assert!(recording.notes()[0].contains("cut off"), "{:?}", recording.notes());
    assert_eq!(open_one(&folder.file("b.csv", "t_s,x\n0,1\n1,2"), &["x"]).unwrap().episodes()[0].rows, 2);
}

#[test]
fn names_that_are_wrong_or_shared() {
    let folder = Folder::new();
    let path = folder.file("a.csv", "t,velocity,x,x\n0,1,2,3\n1,1,2,3\n");
    let text = message(&path, &["velocty"]);
    assert!(text.contains("a.csv") && text.contains("`velocity`"), "{text}");
    assert!(matches!(open_one(&path, &["x"]), Err(Error::AmbiguousColumn { count: 2, .. })));
    let text = message(&folder.file("b.csv", "a,b\n2,1\n1,2\n0,3\n"), &["a"]);
    assert!(text.contains("time column") && text.contains("--dt"), "{text}");
}

#[test]
fn non_text_is_refused_by_name() {
    let folder = Folder::new();
    for (name, bytes, word) in [
        ("a.csv", &b"PAR1\x15\x04rest"[..], "Parquet"),
        ("b.csv", &[0x1f, 0x8b, 8, 0, 0][..], ".gz"),
        ("c.csv", &[0x28, 0xb5, 0x2f, 0xfd, 0][..], ".zst"),
        ("d.csv", &[0xff, 0xfe, b't', 0][..], "UTF-16"),
        ("e.csv", &b"t,x\n0,\x00\n"[..], "zero bytes"),
        ("f.csv", &b""[..], "empty"),
        ("g.csv.gz", &b"t,x\n0,1\n"[..], "g.csv.gz"),
        ("h.csv.zst", &b"t,x\n0,1\n"[..], "h.csv.zst"),
    ] {
        let text = message(&folder.file(name, bytes), &["x"]);
        assert!(text.contains(word) && text.contains(name), "{text}");
        assert!(inspect(folder.0.path().join(name)).is_err());
    }
    for text in ["t,x\n", "\n\n", "# only\n"] {
        assert!(matches!(open_one(&folder.file("n.csv", text), &["x"]), Err(Error::NoRows { .. })), "{text:?}");
    }
}

#[test]
fn a_long_file_spills_and_reads_the_same() {
    let folder = Folder::new();
    let rows = 70_000;
    let text: String = std::iter::once("t,x\n".to_owned())
        .chain((0..rows).map(|i| format!("{}.{:03},{}\n", i / 1000, i % 1000, i * 3)))
        .collect();
    let path = folder.file("a.csv", text);
    let kept = open_one(&path, &["x"]).unwrap();
    let spilled = open(&[&path], &Selection { memory_budget: 0, ..Selection::new(["x"]) }).unwrap();
    assert_eq!(kept.episodes(), spilled.episodes());
    let halo = Halo { before: 7, after: 7 };
    for rows in [0..10, 65_500..65_600, 65_536..70_000, 0..70_000] {
        let (a, b) = (kept.read(0, rows.clone(), halo).unwrap(), spilled.read(0, rows, halo).unwrap());
        assert_eq!((a.time, a.columns), (b.time, b.columns));
    }
}

#[test]
fn inspection_of_text() {
    let folder = Folder::new();
    let path = folder.file("a.csv", "t,v [m/s],mode,weird,weird\n0,1,a,1,1\n0.1,3,b,1,1\n0.2,,a,1,1\n");
    let info = inspect(&path).unwrap();
    assert_eq!((info.rows, info.clock.unwrap().column.as_str()), (None, "t"));
    assert_eq!(info.columns[1].unit.as_deref(), Some("m/s"));
    let info = inspect_values(&path, &fleetfoot_data::Silent).unwrap();
    let v = info.columns[1].statistics.unwrap();
    assert_eq!((v.count, v.missing, v.min, v.mean, v.max), (2, 1, 1.0, 2.0, 3.0));
    assert_eq!(info.columns[2].kind, ColumnKind::Category(vec!["a".into(), "b".into()]));
    assert_eq!(info.rows, Some(3));
    assert_eq!(info.columns[3].statistics, None);
}

#[test]
fn dialects_of_loggers_and_spreadsheets() {
    let folder = Folder::new();
    let expected = (vec![0, 10_000_000, 20_000_000], vec![vec![1.5, -2.0, 3e3], vec![0.0, 1.0, 2.0]]);
    let texts = [
        // Delimiters at the ends of rows, in the header or not.
        "t,x,n\n0,1.5,0,\n0.01,-2,1,\n0.02,3e3,2,\n",
        "t,x,n,\n0,1.5,0,\n0.01,-2,1,\n0.02,3e3,2,\n",
        "t,x,n,\n0,1.5,0\n0.01,-2,1\n0.02,3e3,2\n",
        "t, x, n\n0, 1.5, 0,\n0.01, -2, 1,\n0.02, 3e3, 2,\n",
        "t;x;n;;\n0;1,5;0;;\n0,01;-2;1;;\n0,02;3e3;2;;\n",
        // A row of units.
        "t,x,n\ns,m/s,-\n0,1.5,0\n0.01,-2,1\n0.02,3e3,2\n",
        "t,x,n\n[ms],(m/s),\n0,1.5,0\n10,-2,1\n20,3e3,2\n",
        // Excel's first line.
        "sep=;\r\nt;x;n\r\n0;1.5;0\r\n0.01;-2;1\r\n0.02;3e3;2\r\n",
        "\u{feff}SEP=\t\nt\tx\tn\n0\t1.5\t0\n0.01\t-2\t1\n0.02\t3e3\t2\n",
        // Comments.
        "% run 3\n%\n; by hand\n// of today\nt,x,n\n0,1.5,0\n% in between\n0.01,-2,1\n// and\n; here, too\n0.02,3e3,2\n",
        "% t, x, n\n0,1.5,0\n0.01,-2,1\n0.02,3e3,2\n",
        "%t x n\n0 1.5 0\n0.01 -2 1\n% so far\n0.02 3e3 2\n",
        // A logger that lost its power.
        "t,x,n\n0,1.5,0\n0.01,-2,1\n0.02,3e3,2\n\0\0\0\0\0\0",
    ];
    for (i, text) in texts.iter().enumerate() {
        let recording = open_one(&folder.file(&format!("{i}.csv"), text), &["x", "n"]).unwrap();
        assert_eq!(read(&recording), expected, "{text:?}");
    }
    let path = folder.file("units.csv", texts[5]);
    let columns = inspect(&path).unwrap().columns;
    let units: Vec<_> = columns.iter().map(|column| column.unit.as_deref()).collect();
    assert_eq!(units, [Some("s"), Some("m/s"), None]);
    // Delimiters at the ends of rows are no columns, and a cell beyond the last column is an error.
    for text in &texts[..5] {
        assert_eq!(inspect(folder.file("ends.csv", text)).unwrap().columns.len(), 3, "{text:?}");
    }
    let message = message(&folder.file("beyond.csv", "t,x\n0.5,1,\n1.5,2,3\n"), &["x"]);
    assert!(message.contains(".csv:3:") && message.contains("3 fields"), "{message}");
    // A first semicolon may be an empty cell, and a first row of words a row of values.
    let recording = open_one(&folder.file("first.csv", "x;t\n;0.0\n;0.5\n2;1.0\n"), &["x"]).unwrap();
    assert!(read(&recording).1[0][0].is_nan() && read(&recording).1[0][2] == 2.0);
    let recording = open_one(&folder.file("words.csv", "ground,x\nsand,\ngrass,1\nsand,2\n"), &["ground"]);
    assert!(matches!(recording, Err(Error::NoTimeColumn { .. })));
    let uniform = Selection { time: TimeSpec::Uniform { dt_seconds: 1.0 }, ..Selection::new(["ground"]) };
    assert_eq!(open(&[folder.0.path().join("words.csv")], &uniform).unwrap().episodes()[0].rows, 3);
}

#[test]
fn a_header_in_a_comment_above_rows_with_words() {
    let folder = Folder::new();
    // `rostopic echo -p` writes its header like this.
    let text = "%time,field.header.frame_id,field.x\n1700000000000000000,odom,1.5\n1700000000050000000,odom,2.5\n";
    let recording = open_one(&folder.file("a.csv", text), &["field.x"]).unwrap();
    assert_eq!(read(&recording), (vec![1_700_000_000_000_000_000, 1_700_000_000_050_000_000], vec![vec![1.5, 2.5]]));
    // A remark with as many commas is no header where one follows.
    let text = "# made by hand, version 2\nt,x\n0.0,1\n0.5,2\n";
    assert_eq!(read(&open_one(&folder.file("b.csv", text), &["x"]).unwrap()).1[0], [1.0, 2.0]);
}

#[test]
fn file_without_stamps_keeps_its_row_notes() {
    let folder = Folder::new();
    // Its name is no word about episodes.
    let path = folder.file("episode_3.csv", "lap,x\n1,4\n#lap,9\n2,3\n1,7\n");
    let info = inspect_values(&path, &fleetfoot_data::Silent).unwrap();
    assert!(info.notes.iter().any(|note| note.contains("line 3")), "{:?}", info.notes);
    assert!(!info.notes.iter().any(|note| note.contains("new episode")), "{:?}", info.notes);
}

#[test]
fn comment_like_lines_are_counted() {
    let folder = Folder::new();
    let opened = |text: &str| {
        let recording = open_one(&folder.file("a.csv", text), &["x"]).unwrap();
        (read(&recording).1.remove(0), recording.notes().join("\n"))
    };
    // Errors of spreadsheets are values.
    let (x, notes) = opened("x,t\n1,0.0\n#N/A,0.01\n#DIV/0!,0.02\n2,0.03\n");
    assert!(x.len() == 4 && x[0] == 1.0 && x[1].is_nan() && x[2].is_nan() && x[3] == 2.0, "{x:?}");
    assert_eq!(notes, "");
    // Labels that look like comments are not lost without a word; in quotes they are values.
    let (x, notes) = opened("lap,t,x\n1,0.0,1\n#lap,0.01,2\n%5,0.02,3\n//x,0.03,4\n\"#lap\",0.04,5\n");
    assert_eq!(x, [1.0, 5.0]);
    assert!(notes.contains("3 lines that begin like comments are left out, the first in line 3"), "{notes}");
    // Remarks above the header are not counted, and quotes in remarks are only letters.
    let (x, notes) = opened("# a \"b\nt,x\n0,1\n // he said \"x\n0.01,2\n0.02,3\n");
    assert_eq!(x, [1.0, 2.0, 3.0]);
    assert!(notes.contains("one line that begins like a comment is left out: line 4"), "{notes}");
    let (x, _) = opened("t x\n0 1\n# \"don\"t\n0.01 2\n0.02 3\n# \"a\n");
    assert_eq!(x, [1.0, 2.0, 3.0]);
    // A line of text within quotes is none.
    let (x, notes) = opened("t,x,text\n0,1,\"a\n# b\"\n0.01,2,c\n");
    assert_eq!((x, notes.contains("comment")), (vec![1.0, 2.0], false));
    // A comment without its line end does not make the row above it a cut one.
    let (x, notes) = opened("t,x\n0,1\n0.01,2\n# end");
    assert_eq!((x, notes.contains("line end"), notes.contains("line 4")), (vec![1.0, 2.0], false, true), "{notes}");
    // The line of an error behind comments of every kind.
    let text = message(&folder.file("b.csv", "t_s,x\n0,1\n% a\n// b\n; c\n\n1,oops\n2,3\n"), &["x"]);
    assert!(text.contains("b.csv:7:"), "{text}");
}

#[test]
fn rows_with_leading_semicolon_are_rows() {
    let folder = Folder::new();
    let recording = open_one(&folder.file("a.csv", ";t;x\n;0.0;1\n;0.01;2\n;0.02;3\n"), &["x"]).unwrap();
    assert_eq!(read(&recording).1[0], [1.0, 2.0, 3.0]);
    assert!(matches!(open_one(&folder.file("b.csv", "; nothing\n; here\n"), &["x"]), Err(Error::NoRows { .. })));
}

#[test]
fn clock_with_empty_first_rows_needs_unit() {
    let folder = Folder::new();
    let rows = |name: &str, last: [&str; 3]| {
        let empty: String = (0..1100).map(|row| format!(",{row}\n")).collect();
        format!("{name},x\n{empty}{},1\n{},2\n{},3\n", last[0], last[1], last[2])
    };
    let text = message(&folder.file("a.csv", rows("time", ["0", "10", "20"])), &["x"]);
    assert!(text.contains("`time` has no values in the first rows") && text.contains("--time-unit"), "{text}");
    let named = Selection { time: TimeSpec::Column { name: "my clock".into(), unit: None }, ..Selection::new(["x"]) };
    let text = open(&[folder.file("n.csv", rows("my clock", ["0", "10", "20"]))], &named).unwrap_err().to_string();
    assert!(text.contains("--time \"my clock\" --time-unit ns") && text.contains("column = \"my clock\""), "{text}");
    let recording = open_one(&folder.file("b.csv", rows("time_ms", ["0", "10", "20"])), &["x"]).unwrap();
    assert_eq!(recording.episodes()[0].end, 20_000_000);
    // Dates whose order of day and month only a guess would tell.
    let named = Selection {
        time: TimeSpec::Column { name: "time".into(), unit: Some(TimeUnit::Seconds) },
        ..Selection::new(["x"])
    };
    let c = folder.file("c.csv", rows("time", ["04/05/2021 09:00", "04/05/2021 09:01", "04/05/2021 09:02"]));
    assert!(matches!(open(&[c], &named), Err(Error::BadCell { .. })));
    let d = folder.file("d.csv", rows("time", ["2021-05-04 09:00", "2021-05-04 09:01", "2021-05-04 09:02"]));
    assert_eq!(open(&[d], &named).unwrap().episodes()[0].start, 1_620_118_800_000_000_000);
}

#[test]
fn dates_with_zoned_header_are_the_clock() {
    let folder = Folder::new();
    let rows: String = (0..41)
        .map(|row| format!("2021-05-04 09:00:{:02},{},{}\n", (row + 1) / 2, f64::from(row) * 0.5, row * 7 % 5))
        .collect();
    let path = folder.file("a.csv", format!("Time (UTC),dist,x\n{rows}"));
    let recording = open_one(&path, &["x"]).unwrap();
    assert_eq!(recording.episodes()[0].start, 1_620_118_800_000_000_000);
    assert_eq!(inspect(&path).unwrap().clock.unwrap().column, "Time (UTC)");
    // A clock of dates that its values chose has no unit, and none is open.
    let path = folder.file("b.csv", "when,x\n2021-05-04 09:00:00,1\n2021-05-04 09:00:01,1\n2021-05-04 09:00:02,0\n");
    let clock = inspect(&path).unwrap().clock.unwrap();
    assert_eq!((clock.column.as_str(), clock.guess, clock.unit, clock.is_open()), ("when", true, None, false));
    assert_eq!(inspect_values(&path, &fleetfoot_data::Silent).unwrap().clock.unwrap().summary.unwrap().period, 1.0);
}

#[test]
fn files_share_one_date_order() {
    let folder = Folder::new();
    let file = |name: &str, dates: [&str; 3]| {
        let rows: String = dates.iter().enumerate().map(|(row, date)| format!("{date},{row}\n")).collect();
        folder.file(name, format!("time,x\n{rows}"))
    };
    let starts = |files: &[PathBuf]| {
        let recording = open(files, &Selection::new(["x"])).unwrap();
        (
            recording.episodes().iter().map(|episode| episode.start / 1_000_000_000).collect::<Vec<_>>(),
            recording.notes().join("\n"),
        )
    };
    let (april, may) = (1_617_613_200, 1_620_118_800);
    let open_order = file("a.csv", ["04/05/2021 09:00", "04/05/2021 09:01", "04/05/2021 09:02"]);
    assert_eq!(starts(std::slice::from_ref(&open_order)).0, [april]);
    // A file whose dates have one order only.
    let day = file("b.csv", ["25/05/2021 09:00", "25/05/2021 09:01", "25/05/2021 09:02"]);
    let (starts_read, notes) = starts(&[open_order.clone(), day.clone()]);
    assert_eq!(starts_read, [may, may + 21 * 86_400]);
    assert!(notes.contains("`time` are read day first: in other files of this call that order alone fits"), "{notes}");
    // A file whose dates go on better in one order.
    let night = file("c.csv", ["04/05/2021 23:59", "05/05/2021 00:00", "05/05/2021 00:01"]);
    let (starts_read, notes) = starts(&[open_order.clone(), night]);
    assert_eq!(starts_read, [may, may + 15 * 3600 - 60]);
    assert!(notes.contains("2 files") && notes.contains("day first: the other order"), "{notes}");
    // Files that are certain keep their orders, and the open one says that it is.
    let month = file("d.csv", ["05/26/2021 09:00", "05/26/2021 09:01", "05/26/2021 09:02"]);
    let (starts_read, notes) = starts(&[open_order, day, month]);
    assert_eq!(starts_read, [april, may + 21 * 86_400, may + 22 * 86_400]);
    assert!(notes.contains("month first: the other order"), "{notes}");
}

#[test]
fn a_rate_makes_the_rows_of_a_table_anew() {
    let folder = Folder::new();
    let at_rate = |text: &str, hz: f64| {
        let mut selection = Selection::new(["x", "n", "word"]);
        selection.join.base = Some(Base::Rate(hz));
        open(&[folder.file("a.csv", text)], &selection)
    };
    // Uneven rows from zero, a gap of two seconds, and a second episode.
    let text = "t_s,x,n,word\n0,0.0,1,a\n0.1,1,2,b\n0.3,3,3,b\n0.4,4,4,c\n2.4,24,5,c\n2.5,25,6,c\n0.05,7,7,a\n0.15,8,8,a\n0.25,9,9,a\n";
    let recording = at_rate(text, 20.0).unwrap();
    assert_eq!(recording.episodes().iter().map(|episode| episode.rows).collect::<Vec<_>>(), [51, 5]);
    let block = recording.read(0, 0..51, Halo::default()).unwrap();
    assert!(block.stamps().iter().zip(0..).all(|(&stamp, row)| stamp == row * 50_000_000));
    let near = |row: usize, x: f64| (block.column(0)[row] - x).abs() < 1e-12;
    assert!(near(0, 0.0) && near(1, 0.5) && near(4, 2.0) && near(8, 4.0) && near(50, 25.0), "{:?}", block.column(0));
    assert_eq!((block.column(1)[1], block.column(1)[5], block.column(2)[3]), (1.0, 2.0, 1.0));
    assert!(block.column(0)[20].is_nan() && block.column(1)[20].is_nan(), "nothing across a gap");
    assert!(recording.notes().iter().any(|note| note.contains("resampled to 20 a second")), "{:?}", recording.notes());
    let second = recording.read(1, 0..5, Halo::default()).unwrap();
    assert_eq!((second.stamps()[0], second.column(0)[1]), (50_000_000, 7.5));
    // Far more rows than there are samples; a fixed period has no clock.
    let refused = at_rate(text, 1e6).unwrap_err().to_string();
    assert!(refused.contains("1000000 rows a second") && refused.contains("--rate"), "{refused}");
    let mut uniform = Selection { time: TimeSpec::Uniform { dt_seconds: 0.1 }, ..Selection::new(["x"]) };
    uniform.join.base = Some(Base::Rate(20.0));
    let refused = open(&[folder.0.path().join("a.csv")], &uniform).unwrap_err();
    assert!(matches!(refused, Error::RateWithoutClock { .. }), "{refused}");
}

#[test]
fn words_for_missing_values() {
    let folder = Folder::new();
    let text = "t,x\n0.0,1\n0.1,<NA>\n0.2,-1.#IND\n0.3,--.--\n0.4,#DIV/0!\n0.5,1.#QNAN\n0.6,-\n0.7,2\n";
    let recording = open_one(&folder.file("a.csv", text), &["x"]).unwrap();
    let (_, columns) = read(&recording);
    assert_eq!((columns[0][0], columns[0][7]), (1.0, 2.0));
    assert!(columns[0][1..7].iter().all(|value| value.is_nan()));
}

#[test]
fn sessions_one_after_another() {
    let folder = Folder::new();
    let text = "t,x\ns,m\n0,1\n0.1,2\n0.2,3\n0.3,4\n0.4,4\n\n# second\nt,x\ns,m\n0,5\n0.1,6\n";
    let path = folder.file("a.csv", text);
    let rows = |recording: &Recording| recording.episodes().iter().map(|episode| episode.rows).collect::<Vec<_>>();
    let recording = open_one(&path, &["x"]).unwrap();
    assert_eq!(rows(&recording), [5, 2]);
    assert_eq!(recording.read(1, 0..2, Halo::default()).unwrap().column(0), [5.0, 6.0]);
    assert!(recording.notes().iter().any(|note| note.contains("again once: sessions")), "{:?}", recording.notes());
    // The header of each is a comment.
    let commented = text.replace("t,x\n", "%t,x\n").replace("s,m\n", "");
    let recording = open_one(&folder.file("b.csv", commented), &["x"]).unwrap();
    assert_eq!(rows(&recording), [5, 2]);
    assert!(recording.notes().iter().any(|note| note.contains("one line that begins")), "{:?}", recording.notes());
    // Without a clock no derivative goes from one to the next either.
    let uniform = Selection { time: TimeSpec::Uniform { dt_seconds: 0.5 }, ..Selection::new(["x"]) };
    let recording = open(&[&path], &uniform).unwrap();
    assert_eq!(rows(&recording), [5, 2]);
    assert_eq!((recording.episodes()[1].start, recording.episodes()[1].end), (0, 500_000_000));
    assert_eq!(recording.read(1, 0..2, Halo::default()).unwrap().column(0), [5.0, 6.0]);
}

#[test]
fn dates_of_spreadsheets_and_times_of_the_day_are_clocks() {
    let folder = Folder::new();
    let clock = |cells: &[&str]| {
        let rows: String = cells.iter().enumerate().map(|(i, cell)| format!("\"{cell}\",{i}\n")).collect();
        let recording = open_one(&folder.file("a.csv", format!("time,x\n{rows}")), &["x"]).unwrap();
        let seconds = |stamp: i64| stamp as f64 / 1e9;
        let episodes =
            recording.episodes().iter().map(|one| (one.rows, seconds(one.end - one.start))).collect::<Vec<_>>();
        (seconds(recording.episodes()[0].start), episodes, recording.notes().join("\n"))
    };
    let hour = 3600.0;
    let new_year = 1_609_459_200.0;
    let (start, episodes, notes) = clock(&["1/1/2021 0:00", "1/1/2021 1:00", "1/1/2021 2:00"]);
    assert_eq!((start, episodes, notes.as_str()), (new_year, vec![(3, 2.0 * hour)], ""));
    let (start, episodes, _) = clock(&["29/09/2020 13:45", "29/09/2020 13:46", "29/09/2020 13:47"]);
    assert_eq!((start, episodes), (1_601_387_100.0, vec![(3, 120.0)]));
    let (start, episodes, _) = clock(&["04.05.2021 09:00", "04.05.2021 09:01", "04.05.2021 09:02"]);
    assert_eq!((start, episodes), (1_620_118_800.0, vec![(3, 120.0)]));
    // A time of the day passes midnight.
    let (start, episodes, _) =
        clock(&["23:59:57.5", "23:59:58", "23:59:58.5", "23:59:59", "23:59:59.5", "00:00:00", "0:00:00.5"]);
    assert_eq!((start, episodes), (86_397.5, vec![(7, 3.0)]));
    let (_, episodes, _) = clock(&["12:00:01.5", "12:00:02", "12:00:02.5"]);
    assert_eq!(episodes, [(3, 1.0)]);
    let (start, episodes, _) = clock(&["0 days 00:00:00", "0 days 00:00:00.050000", "0 days 00:00:00.100000"]);
    assert_eq!((start, episodes), (0.0, vec![(3, 0.1)]));
    // Day or month first is a guess here, and is told; a later row decides.
    let many = |last: &str| {
        let mut cells: Vec<String> = (0..1_200).map(|i| format!("04/05/2021 {:02}:{:02}:00", i / 60, i % 60)).collect();
        cells.push(last.to_owned());
        clock(&cells.iter().map(String::as_str).collect::<Vec<_>>())
    };
    let (april, may) = (1_617_580_800.0, 1_620_086_400.0);
    let (start, _, notes) = many("04/05/2021 20:00:00");
    assert!(start == april && notes.contains("month first"), "{start} {notes}");
    let (start, episodes, notes) = many("13/05/2021 20:00:00");
    assert_eq!((start, episodes[0], notes.contains("order of day")), (may, (1_200, 1_199.0 * 60.0), false));
}

#[test]
fn written_table_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["out.csv", "out.tsv"] {
        let path = folder.path().join(name);
        let columns = vec![
            WriteColumn::new("episode, name", WriteKind::Text),
            WriteColumn::new("time", WriteKind::Stamp),
            WriteColumn::new("x", WriteKind::Float).with_unit("m"),
            WriteColumn::new("inside", WriteKind::Boolean),
        ];
        let mut writer = CsvWriter::create(&path, columns, &[]).unwrap();
        let x = [0.1 + 0.2, f64::NAN, -1e-300];
        let stamps = [1_700_000_000_000_000_000, 1_700_000_000_010_000_001, 1_700_000_000_020_000_000];
        writer
            .write(&[
                Values::Text(&["a \"b\", c"; 3]),
                Values::Integer(&stamps),
                Values::Float(&x),
                Values::Boolean(&[true, false, true]),
            ])
            .unwrap();
        let short = writer.write(&[Values::Float(&x)]).unwrap_err().to_string();
        assert!(short.contains("1 columns of values for 4"), "{short}");
        assert!(!path.exists());
        writer.finish().unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.lines().nth(2).unwrap().contains("1700000000010000001"), "{text}");
        let read = open(&[&path], &Selection::new(["x"])).unwrap();
        let block = read.read(0, 0..3, Halo::default()).unwrap();
        assert_eq!(block.stamps(), stamps);
        let written = block.column(0);
        assert!(written[0] == x[0] && written[1].is_nan() && written[2] == x[2]);
    }
}
