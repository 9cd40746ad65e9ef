//! `fit narx` without an order: searches, additive libraries, and files that are run one by one.

use std::{fmt::Write, fs};

use crate::{
    narx::{COLUMNS, fit, folder, noise, number, rows_of},
    outside::data,
    runner::*,
};

/// `y(k) = 0.5 y(k-1) - 0.4 y(k-3) + 0.6 u(k) - 0.3 u(k) y(k-1)`: three lags, the input at once, a product.
fn hidden(rows: usize, seed: u64) -> String {
    let mut text = String::from("t,y,u\n");
    let mut past = [0.1, 0.0, -0.1];
    for row in 0..rows {
        let u = noise(seed, row as u64);
        let y = 0.5 * past[0] - 0.4 * past[2] + 0.6 * u - 0.3 * u * past[0];
        past = [y, past[0], past[1]];
        writeln!(text, "{},{y},{u}", row as f64 * 0.1).unwrap();
    }
    text
}

/// A tank: `y(k) = 0.9 y(k-1) - 0.2 sqrt(max(y(k-2), 0)) + 0.3 u(k-1)`.
fn tank(rows: usize, seed: u64) -> String {
    let mut text = String::from("t,y,u\n");
    let (mut before, mut y) = (0.4, 0.5);
    for row in 0..rows {
        let u = 0.5 + 0.5 * noise(seed, row as u64);
        writeln!(text, "{},{y},{u}", row as f64 * 0.1).unwrap();
        (before, y) = (y, 0.9 * y - 0.2 * f64::max(before, 0.0).sqrt() + 0.3 * u);
    }
    text
}

/// A heater at the end of a pipe: `y(k) = 0.9 y(k-1) + 0.1 u(k-17)`, the input held for seven rows at a time, and noise
/// of the measurements.
fn pipe(rows: usize, seed: u64) -> String {
    let mut text = String::from("t,y,u\n");
    let (input, mut y) = (|row: u64| noise(seed, row / 7), 0.0);
    for row in 0..rows as u64 {
        writeln!(text, "{},{},{}", row as f64 * 0.1, y + 0.001 * noise(seed + 1_000, row), input(row)).unwrap();
        y = 0.9 * y + 0.1 * row.checked_sub(16).map_or(0.0, input);
    }
    text
}

#[test]
fn late_inputs_get_lags_of_their_delay() {
    let folder = folder(&[("a.csv", pipe(1_500, 1)), ("b.csv", pipe(600, 2))]);
    let options = ["a.csv", "--effort", "low", "--free-run", "b.csv", "--output", "late.json"];
    let output = fit(folder.path(), &[&options[..], &COLUMNS].concat()).ok();
    assert!(
        output.err.contains("u acts with a delay of at least 1") && output.err.contains("s): its lags begin there"),
        "{}",
        output.err
    );
    let report = output.json();
    assert_eq!(functions(&report), ["lag(u, 16)", "y"]);
    // Without it 88 % of the output's variation is left.
    assert!(number(&report, "/files/by_file/0/free_run/0/rrse") < 0.01);
}

#[test]
fn worthless_models_get_a_note() {
    let mut text = String::from("t,y,u\n");
    for row in 0..400 {
        writeln!(text, "{},{},{}", row as f64 * 0.1, noise(1, row), noise(2, row / 9)).unwrap();
    }
    let folder = folder(&[("noise.csv", text)]);
    let words = "held-out rows are";
    let output = fit(folder.path(), &[&["noise.csv", "--effort", "low", "-o", "n.json"][..], &COLUMNS].concat()).ok();
    assert!(output.err.contains(&format!("{words} simulated no better than by their mean: next(y)")), "{}", output.err);
    let arguments =
        ["fit", "sindy", "--states", "y", "--inputs", "u", "--time", "t", "--degree", "1", "--predict", "next"];
    let output = fleetfoot(folder.path(), &[&arguments[..], &["-o", "s.json", "noise.csv"]].concat()).ok();
    assert!(output.err.contains(&format!("{words} predicted no better than by their mean: next(y)")), "{}", output.err);
}

/// Functions with a coefficient above rounding errors, sorted by name.
fn functions(report: &serde_json::Value) -> Vec<String> {
    let terms = report["regions"][0]["equations"][0]["terms"].as_array().unwrap();
    let large = terms.iter().filter(|term| number(term, "/coefficient").abs() > 1e-6);
    let mut names: Vec<String> = large.map(|term| term["function"].as_str().unwrap().to_owned()).collect();
    names.sort();
    names
}

#[test]
fn lags_degree_and_direct_inputs_are_searched() {
    let folder = folder(&[("a.csv", hidden(600, 1)), ("b.csv", hidden(300, 2))]);
    let run = |threads: &str, output: &str| {
        let options = ["a.csv", "--free-run", "b.csv", "--threads", threads, "--output", output];
        fit(folder.path(), &[&options[..], &COLUMNS].concat()).ok().json()
    };
    let (report, again) = (run("1", "one.json"), run("2", "two.json"));
    assert_eq!(functions(&report), ["lag(y, 2)", "lead(u, 1)", "y", "y*lead(u, 1)"]);
    assert_eq!((report["direct"].as_bool(), report["order"]["degree"].as_u64()), (Some(true), Some(2)));
    assert!(number(&report, "/files/by_file/0/free_run/0/rrse") < 1e-8);
    assert!(number(&report, "/held_out/rrse") < 1e-8);
    // The linear model of the same lags was tried, and is worse.
    assert!(number(&report, "/linear_of_the_same_lags/rrse") > 0.05);
    // The report has the stages of the search, and its effort stays within the limit.
    assert!(report["search"]["stages"].as_array().unwrap().len() >= 2);
    assert!(number(&report, "/search/spent") <= number(&report, "/search/limit"));
    let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert_eq!((report["tried"].clone(), read("one.json")), (again["tried"].clone(), read("two.json")));
}

#[test]
fn options_limit_the_search() {
    let folder = folder(&[("a.csv", hidden(600, 1))]);
    let run = |options: &[&str]| fit(folder.path(), &[&["a.csv"], options, &COLUMNS].concat()).ok().json();
    let report = run(&["--lags-out", "2", "--degree", "2"]);
    assert_eq!(number(&report, "/order/lags_out"), 2.0);
    let degrees = |report: &serde_json::Value| -> std::collections::BTreeSet<u64> {
        let tried = report["tried"].as_array().unwrap();
        tried.iter().map(|candidate| candidate["order"]["degree"].as_u64().unwrap()).collect()
    };
    assert_eq!(degrees(&report).into_iter().collect::<Vec<_>>(), [1, 2], "the linear model competes in any case");
    // Products of forty lags are thousands of terms, and took minutes.
    let report = run(&["--lags-out", "40", "--lags-in", "40", "--effort", "low"]);
    assert_eq!(degrees(&report).into_iter().collect::<Vec<_>>(), [1], "products of more lags than rows bear");
    // With the lags of the input given, it does not act at once.
    let report = run(&["--lags-in", "2"]);
    assert!(report["tried"].as_array().unwrap().iter().all(|candidate| candidate["direct"] == false));
    let (low, normal) = (run(&["--effort", "low"]), run(&["--effort", "normal"]));
    assert!(number(&low, "/search/limit") < number(&normal, "/search/limit"));
    assert!(low["tried"].as_array().unwrap().len() < normal["tried"].as_array().unwrap().len());
    let fails = |options: &[&str], words: &[&str]| {
        fit(folder.path(), &[&["a.csv"], options, &COLUMNS].concat()).fails(words);
    };
    let output = fit(folder.path(), &[&["a.csv", "--effort", "most"][..], &COLUMNS].concat());
    assert!(output.code == 2 && output.err.contains("most") && output.err.contains("normal"), "{}", output.err);
    fails(&["--library", "y, u", "--degree", "2"], &["degree = 2", "added up"]);
    fails(&["--library", "lag(y, 1), u"], &["lag(y, 1)", "--lags-out"]);
}

#[test]
fn library_functions_are_lagged_and_simulated() {
    let folder = folder(&[("a.csv", tank(600, 1)), ("b.csv", tank(300, 2))]);
    let options = ["a.csv", "--library", "y, u, y^2, sqrt(max(y, 0))", "--free-run", "b.csv"];
    let report = fit(folder.path(), &[&options[..], &COLUMNS].concat()).ok().json();
    assert_eq!(functions(&report), ["sqrt(max(lag(y, 1), 0))", "u", "y"]);
    assert!(number(&report, "/files/by_file/0/free_run/0/rrse") < 1e-8, "{:#}", report["files"]);
    // A model whose root is of another size leaves the recording: nothing of the run is read from it but the start.
    let model = fs::read_to_string(folder.path().join("model.json")).unwrap();
    assert!(!model.contains("\"auxiliary\""), "the outputs and inputs are all that the model needs: {model}");
}

#[test]
fn saved_models_keep_scores_by_file() {
    let other = hidden(300, 9);
    let lost = other.lines().enumerate().map(|(row, line)| {
        // Another machine: its output is ten times as large from row 150 on.
        let fields: Vec<&str> = line.split(',').collect();
        if row > 150 {
            format!("{},{},{}\n", fields[0], 10.0 * fields[1].parse::<f64>().unwrap(), fields[2])
        } else {
            format!("{line}\n")
        }
    });
    let folder = folder(&[("a.csv", hidden(600, 1)), ("b.csv", hidden(300, 2)), ("c.csv", lost.collect())]);
    let options = ["a.csv", "--free-run", "b.csv", "--free-run", "c.csv", "--effort", "low"];
    let report = fit(folder.path(), &[&options[..], &COLUMNS].concat()).ok().json();
    let rrse = |json: &serde_json::Value, file: usize| number(json, &format!("/by_file/{file}/free_run/0/rrse"));
    let files = &report["files"];
    assert!(files["by_file"][1]["file"].as_str().unwrap().ends_with("c.csv"));
    assert!(rrse(files, 0) < 0.2 && rrse(files, 1) > 0.5, "{files:#}");
    assert!((number(files, "/mean/0/rrse") - 0.5 * (rrse(files, 0) + rrse(files, 1))).abs() < 1e-12);
    // `score` reports the whole runs of the saved model.
    let scored = fleetfoot(folder.path(), &["score", "model.json", "b.csv", "c.csv", "--json"]).ok().json();
    assert_eq!(scored["free_runs"]["mean"], files["mean"]);
    assert_eq!(rrse(&scored["free_runs"], 1), rrse(files, 1));
    let text = fleetfoot(folder.path(), &["score", "model.json", "b.csv", "c.csv"]).ok().out;
    assert!(text.contains("y, free run") && text.contains("mean of 2 files"), "{text}");
    // An autoregression needs outputs and inputs, and no other column.
    let rows =
        hidden(300, 2).replace("t,y,u", "t,y,u,other").lines().map(|line| format!("{line},1\n")).collect::<String>();
    fs::write(folder.path().join("d.csv"), rows.replace("other,1", "other")).unwrap();
    let scored = fleetfoot(folder.path(), &["score", "model.json", "d.csv", "--json"]).ok().json();
    assert_eq!(rrse(&scored["free_runs"], 0), rrse(files, 0));
}

/// The damper of `narx.rs` with its inputs named and no other option. It is not worse than order 2, 2 and degree 2, the
/// former default, nor than the linear model of the chosen lags.
#[test]
fn searched_orders_beat_the_usual_order() {
    let Some(file) = data("bouc-wen.csv") else { return };
    let text = fs::read_to_string(file).unwrap();
    let folder = folder(&[("train.csv", rows_of(&text, 400..2000)), ("test.csv", rows_of(&text, 2001..3600))]);
    let options = ["train.csv", "--dt", "0.002", "--outputs", "f", "--alias", "s=sign(v)", "--inputs", "E,v,s"];
    let run = |more: &[&str]| {
        let report = fit(folder.path(), &[&options[..], &["--free-run", "test.csv"], more].concat()).ok().json();
        (number(&report, "/files/by_file/0/free_run/0/rrse"), report)
    };
    let (searched, report) = run(&[]);
    let (usual, _) = run(&["--order", "fixed"]);
    let order = &report["order"];
    let lags = ["lags_out", "lags_in"].map(|name| order[name].to_string());
    let mut linear = vec!["--lags-out", &lags[0], "--lags-in", &lags[1], "--degree", "1", "--terms", "all"];
    linear.extend(report["direct"].as_bool().unwrap().then_some("--direct"));
    let (linear, _) = run(&linear);
    eprintln!("damper: free-run RRSE {searched:.6} looked for ({order}), {usual:.6} at 2, 2, 2, {linear:.6} linear");
    assert!(searched <= usual && searched <= linear, "{searched} {usual} {linear}");
}

/// A switched system of two affine modes with noise: `y(k+1) = 0.8 y + 0.5 u` where u > 0.2, `-0.5 y + u` elsewhere.
fn switched(rows: usize, seed: u64) -> String {
    let mut text = String::from("t,y,u\n");
    let mut y = 0.1;
    for row in 0..rows {
        let u = noise(seed, row as u64);
        writeln!(text, "{},{y},{u}", row as f64 * 0.1).unwrap();
        y = if u > 0.2 { 0.8 * y + 0.5 * u } else { u - 0.5 * y } + 0.02 * noise(seed + 500, row as u64);
    }
    text
}

#[test]
fn orders_and_partitions_share_one_front() {
    let folder = folder(&[("log.csv", switched(1_500, 7)), ("other.csv", switched(400, 8))]);
    let options =
        ["log.csv", "--partition", "average,refined:2,3", "--partition-on", "u", "--lags-out", "2", "--lags-in", "2"];
    let orders = ["--degree", "2", "--order", "auto", "--terms", "all"];
    for select in ["bic", "aic", "one-se", "cv"] {
        let run = |threads: &str| {
            let selection = ["--select", select, "--threads", threads, "-o", "model.json"];
            let output = fit(folder.path(), &[&options[..], &orders, &selection, &COLUMNS].concat()).ok();
            fs::write(folder.path().join("fit.json"), &output.out).unwrap();
            output.json()
        };
        let report = run("1");
        assert_eq!(run("3"), report, "{select}: the same on any number of threads");
        let tried = report["tried"].as_array().unwrap();
        // Two lags of either, two degrees, three partitions.
        assert_eq!(tried.len(), 4 * 2 * 3);
        let chosen: Vec<&serde_json::Value> = tried.iter().filter(|candidate| candidate["chosen"] == true).collect();
        assert_eq!(chosen.len(), 1);
        assert_eq!(chosen[0], &report["held_out"]);
        assert_eq!(chosen[0]["partition"].as_str().map(|text| &text[..8]), Some("refined:"), "{select}");
        if matches!(select, "bic" | "one-se") {
            assert_eq!(chosen[0]["partition"], "refined:2");
            assert_eq!(chosen[0]["order"], serde_json::json!({ "lags_out": 1, "lags_in": 1, "degree": 1 }), "{select}");
            assert_eq!(chosen[0]["coefficients"], 6);
        }
        if select == "bic" {
            let bic = |candidate: &serde_json::Value| number(candidate, "/bic");
            assert!(tried.iter().all(|candidate| bic(candidate) >= bic(chosen[0])));
        }
        // No model of as few coefficients has a lower loss than one on the front.
        let (size, loss) = (
            |candidate: &serde_json::Value| candidate["coefficients"].as_u64(),
            |candidate: &serde_json::Value| number(candidate, "/loss"),
        );
        for candidate in tried.iter().filter(|candidate| candidate["front"] == true) {
            assert!(
                !tried.iter().any(|other| size(other) <= size(candidate) && loss(other) < loss(candidate)),
                "{select}"
            );
        }
    }
    // People and the page see the same.
    let arguments =
        [&["fit", "narx"][..], &options, &orders, &["--select", "bic", "-o", "model.json"], &COLUMNS].concat();
    let text = fleetfoot(folder.path(), &arguments).ok().out;
    assert!(text.contains("chosen by the least BIC of one-step errors, of 24 models"), "{text}");
    assert!(text.lines().any(|line| line.contains("refined:2") && line.contains("<- chosen, least BIC")), "{text}");
    let report = fit(folder.path(), &arguments[2..]).ok().out;
    fs::write(folder.path().join("fit.json"), report).unwrap();
    fleetfoot(folder.path(), &["report", "model.json", "other.csv", "--fit", "fit.json", "-o", "page.html"]).ok();
    let page = fs::read_to_string(folder.path().join("page.html")).unwrap();
    assert_eq!(page.matches("id=\"orders-1\"").count(), 1);
    assert!(page.contains("one of 24 models with its regions"), "the front is drawn");
    // Free runs decide where no criterion is chosen; the report has their front.
    let free = [&options[..], &orders, &["-o", "free.json"], &COLUMNS].concat();
    let report = fit(folder.path(), &free).ok().json();
    let held_out = &report["held_out"];
    assert!(held_out["loss"].is_null() && held_out["rrse"].is_number() && held_out["bic"].is_number(), "{held_out}");
    let message = fit(folder.path(), &[&options[..], &["--select", "ebic"], &COLUMNS].concat()).fails(&["EBIC"]);
    assert!(message.contains("--select bic"), "{message}");
    // The other models of the front stand beside the chosen one, each by its number of coefficients.
    let more = ["--select", "cv", "--keep-all", "-o", "kept.json"];
    let report = fit(folder.path(), &[&options[..], &orders, &more, &COLUMNS].concat()).ok().json();
    let front = report["tried"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|candidate| candidate["front"] == true && candidate["chosen"] == false);
    let rivals: Vec<String> =
        front.map(|candidate| format!("kept_coefficients{}.json", candidate["coefficients"])).collect();
    assert!(rivals.len() > 1, "{rivals:?}");
    for rival in &rivals {
        let scores = fleetfoot(folder.path(), &["score", rival, "other.csv", "--json"]).ok().json();
        assert!(number(&scores, "/targets/0/r2") > -1.0, "{rival}: {scores}");
    }
}
