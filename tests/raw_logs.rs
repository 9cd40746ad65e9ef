//! Scores and rollouts on prepared logs, beside the measurements of the raw logs.

use std::{collections::BTreeMap, fs, path::Path};

use serde_json::Value;

use crate::{
    prepare::{TWO_RATES, two_rates},
    runner::*,
};

const ROWS: usize = 2000;
const DT: f64 = 0.01;
/// Deviations of the noise of position and rate.
const NOISE: [f64; 2] = [0.02, 0.05];

/// A nearly normal number of deviation 1: the sum of twelve uniform ones.
fn normal(seed: u64, row: usize) -> f64 {
    let uniform = |at: u64| {
        let mixed = fleetfoot::data::mix(fleetfoot::data::mix(seed ^ (at << 32)).wrapping_add(row as u64));
        (mixed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    (0..12).map(uniform).sum()
}

/// Seconds, position, rate and force of x'' = -k x - 0.3 x' + 2 u, with noise of known deviation.
fn swing(seed: u64, stiffness: f64) -> Vec<[f64; 4]> {
    let force = |t: f64| (1.1 * t + seed as f64).sin() + 0.8 * (2.9 * t).cos();
    let (mut x, mut v) = (0.4, 0.0);
    let row = |row: usize| {
        let t = DT * row as f64;
        let seen = [t, x + NOISE[0] * normal(seed, row), v + NOISE[1] * normal(seed + 100, row), force(t)];
        for step in 0..50 {
            let (h, at) = (DT / 50.0, t + DT / 50.0 * (f64::from(step) + 0.5));
            let a = |x: f64, v: f64| -stiffness * x - 0.3 * v + 2.0 * force(at);
            let (half_x, half_v) = (x + 0.5 * h * v, v + 0.5 * h * a(x, v));
            (x, v) = (x + h * half_v, v + h * a(half_x, half_v));
        }
        seen
    };
    (0..ROWS).map(row).collect()
}

fn csv(rows: &[[f64; 4]], names: &str, pick: &dyn Fn(&[f64; 4]) -> String) -> String {
    let lines: String = rows.iter().map(|row| format!("{:.2},{}\n", row[0], pick(row))).collect();
    format!("t,{names}\n{lines}")
}

const RECIPE: &str =
    "states = { x = {}, v = {} }\ninputs = { u = \"u\" }\n[model]\npredict = \"next\"\n[prepare]\nclip = 0.2\n";

/// Logs `raw/run_0.csv` and `raw/run_1.csv` of one spring, `raw/other.csv` of a softer one, prepared in `clean` and `other`; a model of the first.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    fs::create_dir(path.join("raw")).expect("a folder");
    for (name, seed, stiffness) in [("run_0", 1, 4.0), ("run_1", 2, 4.0), ("other", 3, 2.5)] {
        let text = csv(&swing(seed, stiffness), "x,v,u", &|row| format!("{},{},{}", row[1], row[2], row[3]));
        fs::write(path.join(format!("raw/{name}.csv")), text).expect("a file");
    }
    fs::write(path.join("robot.toml"), RECIPE).expect("a file");
    fleetfoot(path, &["prepare", "-c", "robot.toml", "raw/run_0.csv", "raw/run_1.csv", "-o", "clean"]).ok();
    fleetfoot(path, &["prepare", "-c", "robot.toml", "raw/other.csv", "-o", "other"]).ok();
    fleetfoot(path, &["fit", "pwa", "-c", "clean/robot.toml", "clean", "--partition", "kmeans:1", "-o", "model.json"])
        .ok();
    folder
}

fn score(path: &Path, data: &str) -> Value {
    fleetfoot(path, &["score", "model.json", data, "--json"]).ok().json()
}

/// Errors of the targets: on smoothed values, and against measurements.
fn errors(score: &Value) -> Vec<[f64; 2]> {
    let number = |value: &Value| value.as_f64().expect("a number");
    let targets = score["targets"].as_array().expect("targets");
    targets.iter().map(|target| [number(&target["rmse"]), number(&target["raw"]["rmse"])]).collect()
}

fn notes(report: &Value) -> String {
    report["notes"].to_string()
}

/// Smoothed measurements scatter by their noise, whatever the error of the model is.
#[test]
fn raw_errors_include_measurement_noise() {
    let folder = folder();
    let path = folder.path();
    for data in ["clean", "other"] {
        let scores = score(path, data);
        assert!(notes(&scores).contains("errors called raw are against the measurements"), "{}", notes(&scores));
        assert!(!notes(&scores).contains("scatter about them"), "{}", notes(&scores));
        for ([smooth, raw], noise) in errors(&scores).into_iter().zip(NOISE) {
            let expected = smooth.hypot(noise);
            // The curve follows some hundredths of the noise; its deviation is known from 2,000 rows and more to 1/sqrt(4000).
            assert!((raw / expected - 1.0).abs() < 0.04, "{data}: {smooth} {raw} {noise}");
        }
        let flags = ["--horizon", "60", "--starts", "300", "--json"];
        let report = fleetfoot(path, &[&["rollout", "model.json", data][..], &flags].concat()).ok().json();
        let mean = |curve: &Value, state: usize| {
            let steps = curve["rmse"].as_array().expect("steps");
            let squares: f64 = steps.iter().filter_map(|step| step[state].as_f64()).map(|rmse| rmse * rmse).sum();
            squares / steps.len() as f64
        };
        for (state, noise) in NOISE.into_iter().enumerate() {
            let (smooth, raw) = (mean(&report["model"], state), mean(&report["raw"], state));
            assert!((raw / (smooth + noise * noise) - 1.0).abs() < 0.08, "{data} {state}: {smooth} {raw}");
            // The model of another spring errs by more than the noise.
            assert_eq!(smooth > noise * noise, data == "other", "{data} {state}: {smooth}");
        }
    }
    let text = fleetfoot(path, &["rollout", "model.json", "clean", "--horizon", "5"]).ok().out;
    assert!(text.contains("raw RMSE x") && text.contains("raw RMSE v"), "{text}");
    assert!(fleetfoot(path, &["score", "model.json", "clean"]).ok().out.contains("raw RMSE"));
    // Raw rows have no others behind them.
    let scores = score(path, "raw/run_0.csv");
    assert!(scores["targets"][0].get("raw").is_none() && !notes(&scores).contains("raw"), "{scores}");
}

#[test]
fn missing_and_changed_raw_logs_are_named() {
    let folder = folder();
    let path = folder.path();
    let all = errors(&score(path, "clean"));
    // Both folders move together: the way from one to the other is the same.
    fs::create_dir(path.join("away")).expect("a folder");
    fs::rename(path.join("raw"), path.join("away/raw")).expect("a move");
    let scores = score(path, "clean");
    assert!(scores["targets"][0].get("raw").is_none());
    assert!(
        notes(&scores).contains("errors are against smoothed values only")
            && notes(&scores).contains("raw/run_0.csv and is not there")
            && notes(&scores).contains("(and 1 more)")
            && notes(&scores).contains("scatter about them"),
        "{}",
        notes(&scores)
    );
    fs::rename(path.join("clean"), path.join("away/clean")).expect("a move");
    assert_eq!(errors(&score(path, "away/clean")), all);
    // One of two logs has changed: the other one is compared.
    let log = path.join("away/raw/run_1.csv");
    fs::write(&log, fs::read_to_string(&log).expect("a file") + "20.00,0,0,0\n").expect("a file");
    let scores = score(path, "away/clean");
    assert!(errors(&scores)[0][1] > 0.9 * NOISE[0]);
    assert!(
        notes(&scores).contains("of some logs errors are against smoothed values only")
            && notes(&scores).contains("run_1.csv has changed since; prepare the raw log again"),
        "{}",
        notes(&scores)
    );
    assert!(scores["targets"][0]["raw"]["rows"].as_u64() < scores["rows"].as_u64());
}

/// A value that `prepare` rejected is no measurement, and a pause has none.
#[test]
fn gross_errors_and_gaps_are_no_measurements() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let mut rows = swing(5, 4.0);
    let wrong: Vec<usize> = (57..ROWS).step_by(101).collect();
    wrong.iter().for_each(|&row| rows[row][1] += 3.0);
    let text = csv(&rows, "x,v,u", &|row| format!("{},{},{}", row[1], row[2], row[3]));
    fs::write(path.join("log.csv"), text).expect("a file");
    fs::write(path.join("robot.toml"), RECIPE).expect("a file");
    fleetfoot(path, &["prepare", "-c", "robot.toml", "log.csv", "-o", "clean"]).ok();
    fleetfoot(path, &["fit", "pwa", "-c", "clean/robot.toml", "clean", "--partition", "kmeans:1", "-o", "model.json"])
        .ok();
    let scores = score(path, "clean");
    let [[_, raw], _] = errors(&scores)[..] else { panic!("two targets") };
    assert!((raw / NOISE[0] - 1.0).abs() < 0.05, "{raw}");
    let (raw, all) = (scores["targets"][0]["raw"]["rows"].as_u64(), scores["rows"].as_u64());
    let left_out = all.zip(raw).map_or(0, |(all, raw)| all - raw) as usize;
    assert!((wrong.len() - 1..wrong.len() + 4).contains(&left_out), "{left_out} of {}", wrong.len());
}

/// The samples of a topic that is slower than the rows are compared where they stand; no row lies beyond a pause.
#[test]
fn slow_topics_are_compared_at_their_samples() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    two_rates(&path.join("run.mcap"), 4.0);
    let recipe = TWO_RATES.replace("[time]", "[model]\npredict = \"next\"\n[time]");
    let recipe = recipe.replace("clip = 0.2", "clip = 0.2\n[channels.w]\ndelay = 0.01");
    fs::write(path.join("robot.toml"), recipe).expect("a file");
    fleetfoot(path, &["prepare", "-c", "robot.toml", "run.mcap", "-o", "clean"]).ok();
    fleetfoot(path, &["fit", "pwa", "-c", "clean/robot.toml", "clean", "--partition", "kmeans:1", "-o", "model.json"])
        .ok();
    let scores = score(path, "clean");
    let [[x, raw_x], [w, raw_w]] = errors(&scores)[..] else { panic!("two targets") };
    // Rows lie at 0.13, 0.33, ... of the way between two samples, whose line has 0.66 of the variance of their noise: uniform, of 1.7 mm, which a cubic spline follows by a tenth.
    let line = 1.7e-3 / 3f64.sqrt() * 0.66f64.sqrt();
    assert!((0.8..1.1).contains(&(raw_x / x.hypot(line))), "{x} {raw_x} {line}");
    // The rate is late by half of its window; without that it would be off by 0.01 s of 16 rad/s^2.
    assert!((0.9..1.1).contains(&(raw_w / w.hypot(0.003 / 3f64.sqrt()))), "{w} {raw_w}");
    for target in scores["targets"].as_array().expect("targets") {
        assert!(target["raw"]["rows"].as_u64().unwrap_or(0) + 20 > scores["rows"].as_u64().unwrap_or(0), "{target}");
    }
}

/// The files of a run are one raw log, and every one of them is read.
#[test]
fn files_of_a_run_are_one_log() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let rows = swing(7, 4.0);
    for run in ["runs/a", "runs/b"] {
        fs::create_dir_all(path.join(run)).expect("a folder");
        let seeded = if run == "runs/a" { rows.clone() } else { swing(8, 4.0) };
        let write = |name: &str, text: String| fs::write(path.join(run).join(name), text).expect("a file");
        write("encoder.csv", csv(&seeded, "x,v", &|row| format!("{},{}", row[1], row[2])));
        write("drive.csv", csv(&seeded, "u", &|row| row[3].to_string()));
    }
    let recipe = "states = { x = { column = \"encoder.x\" }, v = { column = \"encoder.v\" } }\ninputs = { u = \"drive.u\" }\n\
                  [files]\nencoder = \"encoder.csv\"\ndrive = \"drive.csv\"\n[model]\npredict = \"next\"\n[time]\nbase = \"encoder\"\n[prepare]\nclip = 0.2\n";
    fs::write(path.join("robot.toml"), recipe).expect("a file");
    fleetfoot(path, &["prepare", "-c", "robot.toml", "runs", "-o", "clean"]).ok();
    let names: Vec<String> = fs::read_dir(path.join("clean"))
        .expect("a folder")
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".parquet"))
        .collect();
    assert_eq!(names.len(), 2, "{names:?}");
    let metadata: BTreeMap<String, String> =
        fleetfoot::log::metadata(path.join("clean").join(&names[0])).expect("metadata");
    let raw: Value = serde_json::from_str(&metadata["fleetfoot.raw"]).expect("JSON");
    let files: Vec<&str> =
        raw["files"].as_array().expect("files").iter().filter_map(|file| file["path"].as_str()).collect();
    assert!(files.len() == 2 && files[0].starts_with("../runs/") && files[0].ends_with("encoder.csv"), "{raw}");
    fleetfoot(path, &["fit", "pwa", "-c", "clean/robot.toml", "clean", "--partition", "kmeans:1", "-o", "model.json"])
        .ok();
    for ([smooth, raw], noise) in errors(&score(path, "clean")).into_iter().zip(NOISE) {
        assert!((raw / smooth.hypot(noise) - 1.0).abs() < 0.04, "{smooth} {raw} {noise}");
    }
    fs::remove_file(path.join("runs/b/drive.csv")).expect("a file");
    let scores = score(path, "clean");
    assert!(notes(&scores).contains("runs/b/drive.csv and is not there"), "{}", notes(&scores));
    assert!(errors(&scores)[0][1] > 0.9 * NOISE[0]);
}
