//! Equations on windows in the place of rows.

use std::{fs, path::Path};

use crate::{
    derivatives::{coefficient, oscillation},
    runner::*,
};

/// Logs in a folder, one a file.
fn folder(logs: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in logs {
        fs::write(folder.path().join(name), text).expect("a file");
    }
    folder
}

const FIT: [&str; 8] = ["fit", "sindy", "--states", "x,y", "--library", "poly(2)", "--time", "t"];

fn fit(path: &Path, more: &[&str]) -> Run {
    fleetfoot(path, &[&FIT, more].concat())
}

fn equations(path: &Path, more: &[&str]) -> (serde_json::Value, Option<String>) {
    let report = fit(path, &[more, &["--json"]].concat()).ok().json();
    (report["regions"][0]["equations"].clone(), report["weak"].as_str().map(str::to_owned))
}

fn terms(equations: &serde_json::Value) -> Vec<Vec<String>> {
    let functions = |equation: &serde_json::Value| {
        let terms = equation["terms"].as_array().expect("terms").iter();
        terms.map(|term| term["function"].as_str().unwrap_or_default().to_owned()).collect()
    };
    equations.as_array().expect("equations").iter().map(functions).collect()
}

#[test]
fn clean_rows_are_fitted_without_windows() {
    let folder = folder(&[("log.csv", &oscillation(600, 0.01, 0.0))]);
    let (rows, note) = equations(folder.path(), &["log.csv"]);
    assert_eq!(note, None);
    let (windows, note) = equations(folder.path(), &["log.csv", "--weak", "25"]);
    assert!(note.is_some_and(|note| note.contains("windows of 25 rows, one every 3 rows")));
    assert_eq!(terms(&rows), terms(&windows));
    assert_eq!(terms(&windows), [vec!["y"], vec!["x", "y"]]);
    for (equation, function, truth) in [(0, "y", 1.0), (1, "x", -4.0), (1, "y", -0.2)] {
        let error = coefficient(&windows[equation], function) - truth;
        // Stamps are a fifth of a period off, and a file's micros are what is left.
        assert!(error.abs() < 2e-3, "{function}: {error:e}");
    }
}

#[test]
fn noisy_rows_are_fitted_on_windows() {
    let folder = folder(&[("log.csv", &oscillation(1500, 0.01, 0.3))]);
    let path = folder.path();
    let (fitted, note) = equations(path, &["log.csv"]);
    let note = note.expect("windows");
    assert!(note.contains("% of the variance of the differences"), "{note}");
    let (off, none) = equations(path, &["log.csv", "--weak", "off"]);
    assert_eq!(none, None);
    let error = |equations: &serde_json::Value| {
        let truth = [(0, "y", 1.0), (1, "x", -4.0), (1, "y", -0.2)];
        truth.map(|(at, function, truth)| (coefficient(&equations[at], function) - truth).powi(2)).iter().sum::<f64>()
    };
    assert!(error(&fitted) < 0.5 * error(&off), "{} {}", error(&fitted), error(&off));
    let text = fit(path, &["log.csv"]).ok().out;
    assert!(text.contains(&note), "{text}");
    // A recipe has the same effect as the flag, and the recipe that a model keeps fits the same bytes.
    let recipe = "[states]\nx = {}\ny = {}\n[library]\nfunctions = [\"poly(2)\"]\n[time]\ncolumn = \"t\"\n[sindy]\nweak = \"off\"\n";
    fs::write(path.join("off.toml"), recipe).expect("a file");
    let by_recipe = fleetfoot(path, &["fit", "sindy", "log.csv", "-c", "off.toml", "--json"]).ok().json();
    assert_eq!(by_recipe["regions"][0]["equations"], off);
}

#[test]
fn impossible_windows_are_refused() {
    let logs = [("long.csv", oscillation(400, 0.0, 0.1)), ("short.csv", oscillation(30, 0.0, 0.1))];
    let folder = folder(&[(logs[0].0, &logs[0].1), (logs[1].0, &logs[1].1)]);
    let path = folder.path();
    let output = fit(path, &["long.csv", "short.csv", "--weak", "41"]).ok();
    assert!(output.err.contains("1 of 2 episodes (the first is short"), "{}", output.err);
    fit(path, &["long.csv", "--weak", "501"]).fails(&["windows of 501 rows", "long", "400", "smaller number"]);
    fit(path, &["short.csv", "--weak", "auto"]).fails(&["short", "30", "remove --weak"]);
    fit(path, &["long.csv", "--weak", "7"]).fails(&["weak = 7", "from 9 on"]);
    fit(path, &["long.csv", "--weak", "41", "--predict", "next"]).fails(&["derivative", "remove it"]);
}

#[test]
fn a_statistic_keeps_its_windows() {
    let logs: Vec<String> = [0.3, 0.31, 0.32].iter().map(|noise| oscillation(500, 0.01, *noise)).collect();
    let folder = folder(&[("a.csv", &logs[0]), ("b.csv", &logs[1]), ("c.csv", &logs[2])]);
    let path = folder.path();
    let recipe = |weak: &str| {
        format!(
            "[states]\nx = {{}}\ny = {{}}\n[library]\nfunctions = [\"poly(2)\"]\n[time]\ncolumn = \"t\"\n[sindy]\nweak = {weak}\n"
        )
    };
    for (name, weak) in [("windows.toml", "41"), ("others.toml", "61"), ("rows.toml", "\"off\"")] {
        fs::write(path.join(name), recipe(weak)).expect("a file");
    }
    let run = |words: &str| fleetfoot(path, &words.split(' ').collect::<Vec<_>>());
    run("scan -c windows.toml a.csv b.csv c.csv -o all.stats").ok();
    run("scan -c windows.toml --plan all.stats c.csv a.csv -o two.stats").ok();
    run("scan -c windows.toml --plan all.stats b.csv -o one.stats").ok();
    run("stats merge one.stats two.stats -o merged.stats").ok();
    // Rows alone can be smoothed: without, a statistic and its logs are one.
    run("fit sindy -c windows.toml a.csv b.csv c.csv --smooth-states off -o logs.json").ok();
    for statistic in ["all.stats", "merged.stats"] {
        run(&format!("fit sindy -c windows.toml {statistic} --smooth-states off -o {statistic}.json")).ok();
        let read = |name: &str| fs::read(path.join(name)).expect("a file");
        assert!(read("logs.json") == read(&format!("{statistic}.json")), "{statistic}");
    }
    let output = run("fit sindy all.stats -o without.json").ok();
    assert!(output.err.contains("a statistic has no rows whose states could be smoothed"), "{}", output.err);
    run("fit sindy all.stats --smooth-states on -o no.json").fails(&["smooth_states = on", "fit on the logs"]);
    run("fit sindy -c rows.toml all.stats -o no.json").fails(&["--weak asks for rows", "windows of 41 rows"]);
    run("fit sindy all.stats --weak 61 -o no.json").fails(&["windows of 61 rows", "windows of 41 rows"]);
    for other in ["rows.toml", "others.toml"] {
        run(&format!("scan -c {other} a.csv -o other-{other}.stats")).ok();
        run(&format!("stats merge other-{other}.stats one.stats -o no.stats")).fails(&["plan"]);
    }
    // The sums for `fit pwa` stand beside the windows.
    run("fit pwa -c windows.toml all.stats --partition average -o pwa.json").ok();
}

/// Default windows are left away if the regions of a partition have too few of them; a request for windows fails.
#[test]
fn regions_without_windows_are_fitted_on_rows() {
    let folder = folder(&[("log.csv", &oscillation(1500, 0.01, 0.3))]);
    let path = folder.path();
    let output = fit(path, &["log.csv", "--partition", "kmeans:6", "--json"]).ok();
    assert!(
        output.err.contains("noise calls for windows of") && output.err.contains("complete window"),
        "{}",
        output.err
    );
    let report = output.json();
    assert!(report["weak"].is_null() && report["rows"].as_u64() > Some(1480), "{report}");
    let asked = ["log.csv", "--partition", "kmeans:6", "--weak", "auto", "-o", "asked.json"];
    fit(path, &asked).fails(&["complete", "candidates", "--weak"]);
    assert!(!path.join("asked.json").exists());
}

/// A dry run announces that states may be smoothed, which takes memory that the sums do not. If they are not, it has no
/// such line.
#[test]
fn dry_runs_note_smoothed_states() {
    let folder = folder(&[("log.csv", &oscillation(600, 0.01, 0.3))]);
    let path = folder.path();
    let plan = |more: &[&str]| fit(path, &[&["log.csv", "--dry-run", "--json"], more].concat()).ok().json();
    assert_eq!(plan(&[])["smoothing_bytes"].as_u64(), Some(1 << 30));
    for more in [&["--weak", "off"][..], &["--smooth-states", "off"], &["--partition", "kmeans:2"], &["--terms", "2"]] {
        assert!(plan(more)["smoothing_bytes"].is_null(), "{more:?}");
    }
    let text = fit(path, &["log.csv", "--dry-run"]).ok().out;
    assert!(text.contains("1 file, 1 episode, 600 rows") && text.contains("states are smoothed if"), "{text}");
}
