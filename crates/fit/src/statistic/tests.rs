//! Statistics as files, on small logs of a plant that is known exactly.

mod autoregression;
mod corpus;
mod damage;
mod equations;
mod joined;
mod resumed;

use std::{
    fs,
    num::NonZeroUsize,
    path::{Path, PathBuf},
};

use fleetfoot_data::Silent;
use fleetfoot_recipe::Recipe;

use super::*;
use crate::error::Error;

/// Two equations that share the latent T: `a = T - D`, `b = 2 T`, with T = 3 + x - 0.5 x^2 and D = 0.7 v.
const RECIPE: &str = r#"
[latents]
T = { of = ["x"], degree = 2 }
D = { functions = ["v", "v^2"] }
[tasks]
along = { target = "a", right = "T - D" }
normal = { target = "b", right = "2*T" }
[inputs]
x = "x"
v = "v"
[time]
column = "t"
"#;

fn recipe() -> Recipe {
    Recipe::parse(RECIPE, "test").unwrap()
}

/// A log of the plant.
fn log(rows: usize, phase: f64) -> String {
    let mut text = String::from("t,x,v,a,b\n");
    for row in 0..rows {
        let t = row as f64 * 0.01;
        let (x, v) = ((3.0 * t + phase).sin(), (1.7 * t + 2.0 * phase).cos());
        let thrust = 3.0 + x - 0.5 * x * x;
        text.push_str(&format!("{t},{x},{v},{},{}\n", thrust - 0.7 * v, 2.0 * thrust));
    }
    text
}

/// Logs in a folder for each of `aircraft`; rows differ from log to log.
fn fleet(folder: &Path, aircraft: &[usize], flights: usize) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for &number in aircraft {
        let folder = folder.join(format!("{number}"));
        fs::create_dir_all(&folder).unwrap();
        for flight in 0..flights {
            let path = folder.join(format!("flight_{flight}.csv"));
            fs::write(&path, log(90 + 17 * flight + 5 * number, (10 * number + flight) as f64)).unwrap();
            files.push(path);
        }
    }
    files
}

fn options() -> ScanOptions {
    ScanOptions { keys: vec!["aircraft={dir1}".parse().unwrap()], chunk_rows: NonZeroUsize::new(40) }
}

fn scanned(files: &[PathBuf], base: Option<StatisticFile>) -> StatisticFile {
    scan(&recipe(), &options(), base, files, &Silent).unwrap().0
}

fn bytes(file: &StatisticFile) -> Vec<u8> {
    file.to_bytes().unwrap()
}

#[test]
fn a_statistic_reads_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let file = scanned(&fleet(folder.path(), &[1, 2], 2), None);
    let path = folder.path().join("run.stats");
    let sizes = file.write(&path).unwrap();
    let written = fs::read(&path).unwrap();
    assert_eq!(sizes.total, written.len() as u64);
    assert_eq!(written, bytes(&file));
    let (again, sizes_read) = StatisticFile::read_with_sizes(&path).unwrap();
    assert_eq!(again, file);
    assert_eq!(sizes_read, sizes);
    // Beside the sections there are the head (16 bytes) and the hash (32).
    assert_eq!(sizes.sections.iter().map(|(_, size)| size).sum::<u64>() + 48, sizes.total);
    assert_eq!(bytes(&again), written);
}

#[test]
fn a_statistic_solves_to_the_plant() {
    let folder = tempfile::tempdir().unwrap();
    let file = scanned(&fleet(folder.path(), &[1, 2], 2), None);
    let (_, task) = file.task().unwrap();
    assert_eq!(task.regression, file.plan.regression);
    let normal = &file.scanned.tasks[1];
    let root = normal.preconditioner.square_root(&normal.stats.total(|_| true).unwrap());
    let solution = fleetfoot_stats::least_squares(&root, &[1.0; 3]);
    // The constant is the intercept; x and x^2 are multiplied with 2.
    let terms: Vec<String> = file.plan.regression.columns(1).iter().map(ToString::to_string).collect();
    for (term, j) in terms.iter().zip(0..3) {
        let expected = match term.as_str() {
            "2*x" | "x*2" => 1.0,
            "2*x^2" | "x^2*2" => -0.5,
            _ => continue,
        };
        assert!((solution.coefficients[(j, 0)] - expected).abs() < 1e-10, "{terms:?} {:?}", solution.coefficients);
    }
    assert!((solution.intercept[0] - 6.0).abs() < 1e-10);
    let summaries = file.task_summaries();
    assert!(summaries.iter().all(|task| (task.r2 - 1.0).abs() < 1e-12), "{summaries:?}");
    assert_eq!(file.scanned.counts().complete, file.episodes.iter().map(|episode| episode.rows).sum::<u64>());
}

#[test]
fn labels_files_and_names_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2], 2);
    let file = scanned(&files, None);
    assert_eq!(file.files.len(), 4);
    for (record, path) in file.files.iter().zip(&files) {
        assert_eq!(record.name, path.to_string_lossy());
        assert_eq!(record.bytes, fs::metadata(path).unwrap().len());
        assert_eq!(record.hash.0, *blake3::hash(&fs::read(path).unwrap()).as_bytes());
    }
    for episode in &file.episodes {
        // Two files share each name, so that the path tells them apart.
        assert_eq!(episode.name, file.file_of(episode).unwrap().name);
        assert!(episode.name.contains(&format!("/{}/", episode.labels["aircraft"])), "{episode:?}");
    }
    assert_eq!(file.by_label()["aircraft"]["2"], (2, 100 + 117));
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2, 3], 2);
    let one = fleetfoot_data::with_threads(1, || bytes(&scanned(&files, None)));
    for threads in [2, 7] {
        assert_eq!(fleetfoot_data::with_threads(threads, || bytes(&scanned(&files, None))), one);
    }
}

#[test]
fn text_in_the_regression_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let rows: String = (0..50)
        .map(|row| format!("{},1,{},1,1\n", 0.01 * f64::from(row), ["slow", "fast"][row as usize % 2]))
        .collect();
    fs::write(&path, format!("t,x,v,a,b\n{rows}")).unwrap();
    let error = scan(&recipe(), &options(), None, &[path], &Silent).unwrap_err();
    assert!(matches!(error, Error::Dataset(fleetfoot_dataset::Error::TextAsNumber { .. })), "{error}");
}

#[test]
fn logs_without_a_complete_row_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let rows: String = (0..50).map(|row| format!("{},{},nan,1,1\n", 0.01 * f64::from(row), row)).collect();
    fs::write(&path, format!("t,x,v,a,b\n{rows}")).unwrap();
    let message = scan(&recipe(), &options(), None, &[path], &Silent).unwrap_err().to_string();
    assert!(message.contains("no row can be used") && message.contains("50 have a missing value"), "{message}");
}
