//! Rule of held-out rows and of the printed held-out error: the same for every method, from the command line.

use std::{fmt::Write, fs};

use crate::runner::*;

/// Standard normal numbers of a seed.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// The Brusselator, `x' = 1 + x^2 y - 4 x`, `y' = 3 x - x^2 y`, every 0.05 s: `t, x, y`, with noise of a share of each state's deviation.
fn brusselator(start: [f64; 2], noise: f64, seed: u64) -> String {
    let f = |[x, y]: [f64; 2]| [1.0 + x * x * y - 4.0 * x, 3.0 * x - x * x * y];
    let mut noises = Noise(seed);
    let [mut x, mut y] = start;
    let mut text = String::from("t,x,y\n");
    for row in 0..512 {
        let t = f64::from(row) * 0.05;
        // About what x and y deviate from their means by.
        let (a, b) = (noise * 0.9 * noises.normal(), noise * 1.2 * noises.normal());
        let _ = writeln!(text, "{t},{},{}", x + a, y + b);
        for _ in 0..20 {
            let (h, s) = (0.0025, [x, y]);
            let moved = |k: [f64; 2], h: f64| [s[0] + h * k[0], s[1] + h * k[1]];
            let a = f(s);
            let b = f(moved(a, h / 2.0));
            let c = f(moved(b, h / 2.0));
            let d = f(moved(c, h));
            x += h / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0]);
            y += h / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1]);
        }
    }
    text
}

fn recordings(noise: f64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("a.csv"), brusselator([1.0, 1.0], noise, 1)).expect("a file");
    fs::write(folder.path().join("b.csv"), brusselator([2.0, 4.0], noise, 2)).expect("a file");
    folder
}

const STATES: [&str; 4] = ["--states", "x,y", "--library", "poly(3)"];

fn fit(folder: &Path, method: &str, arguments: &[&str]) -> Run {
    let all: Vec<&str> = ["fit", method, "--json"].into_iter().chain(arguments.iter().copied()).collect();
    fleetfoot(folder, &all)
}

fn sindy(folder: &Path, files: &[&str], more: &[&str]) -> serde_json::Value {
    let all: Vec<&str> = files.iter().chain(&STATES).chain(more).copied().collect();
    fit(folder, "sindy", &all).ok().json()
}

/// The sorted terms of the equations.
fn terms(report: &serde_json::Value) -> Vec<Vec<String>> {
    let equations = report["regions"][0]["equations"].as_array().unwrap_or_else(|| panic!("{report}"));
    let of = |equation: &serde_json::Value| {
        let terms = equation["terms"].as_array().into_iter().flatten();
        let mut names: Vec<String> = terms.filter_map(|term| term["function"].as_str().map(str::to_owned)).collect();
        names.sort();
        names
    };
    equations.iter().map(of).collect()
}

#[track_caller]
fn number(value: &serde_json::Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn short_recordings_give_the_true_terms() {
    let folder = recordings(0.0);
    let truth = [vec!["1", "x", "x^2*y"], vec!["x", "x^2*y"]];
    for files in [&["a.csv"][..], &["b.csv"], &["a.csv", "b.csv"]] {
        let report = sindy(folder.path(), files, &[]);
        assert_eq!(terms(&report), truth, "{files:?}");
        for equation in report["regions"][0]["equations"].as_array().unwrap() {
            assert!(number(&equation["held_out_r2"]) > 0.99, "{files:?}: {equation}");
        }
    }
}

#[test]
fn each_folds_option_has_its_rule() {
    let folder = recordings(0.0);
    let path = folder.path();
    let mut rules = Vec::new();
    for (folds, count) in [("2", 2), ("4", 4), ("10", 10), ("episodes", 2), ("splits:7", 7)] {
        let report = sindy(path, &["a.csv", "b.csv"], &["--folds", folds]);
        assert_eq!(report["folds"], count, "{folds}");
        let rule = report["fold_rule"].as_str().unwrap_or_default().to_owned();
        assert!(!rule.is_empty() && report["choice"].as_str().unwrap().contains(&rule), "{report}");
        rules.push(rule);
    }
    assert!(rules[0].contains("2 folds of spans, 6 an episode of up to 84 rows"), "{rules:?}");
    assert!(rules[1].contains("4 folds of spans, 8 an episode"), "{rules:?}");
    assert!(rules[2].contains("10 folds of spans, 10 an episode"), "{rules:?}");
    assert_eq!(rules[3], "every one of 2 episodes left out once");
    let all: Vec<&str> = ["fit", "sindy", "a.csv", "b.csv"].into_iter().chain(STATES).collect();
    let text = fleetfoot(path, &all).ok().out;
    assert!(text.contains("10 folds of spans, 10 an episode of up to 50 rows"), "{text}");
    // Impossible folds are refused, with an option that works.
    let refused = |files: &[&str], folds: &str, words: &[&str]| {
        let all: Vec<&str> = files.iter().chain(&STATES).copied().chain(["--folds", folds]).collect();
        fit(path, "sindy", &all).fails(words);
    };
    refused(&["a.csv"], "episodes", &["2 episodes or more", "there is 1", "--folds 10"]);
    refused(&["a.csv", "b.csv"], "600", &["600 folds", "fewer folds", "--folds"]);
    refused(&["a.csv"], "1", &["folds = 1"]);
}

#[test]
fn the_rule_is_that_of_every_method() {
    let folder = recordings(0.0);
    let path = folder.path();
    let rule = "4 folds of spans, 8 an episode of up to 64 rows";
    let pwa = fit(path, "pwa", &["a.csv", "b.csv", "--states", "x,y", "--folds", "4"]).ok().json();
    assert!(pwa["fold_rule"].as_str().unwrap().starts_with(rule), "{}", pwa["fold_rule"]);
    let sparse = ["a.csv", "b.csv", "--predict", "y", "--inputs", "x", "--degree", "2", "--folds", "4"];
    let report = fit(path, "sparse", &sparse).ok().json();
    let fold_rule =
        report["lambda"]["validation"]["fold_rule"].as_str().unwrap_or_else(|| panic!("{report}")).to_owned();
    assert!(fold_rule.starts_with("4 folds of spans, 8 an episode"), "{fold_rule}");
}

/// At this threshold the folds keep the term about as often as not, and all rows just drop it.
#[test]
fn held_out_errors_belong_to_written_models() {
    let mut text = String::from("t,x,y\n");
    let mut noises = Noise(5);
    let (mut square, mut rows) = (0.0, 0.0);
    for row in 0..2000 {
        let x = (0.07 * f64::from(row)).sin() + 0.3 * noises.normal();
        let y = 0.1 * x + 0.01 * noises.normal();
        square += y * y;
        rows += 1.0;
        let _ = writeln!(text, "{},{x},{y}", f64::from(row) * 0.01);
    }
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("log.csv"), text).expect("a file");
    let fit = |threshold: &str| {
        let arguments =
            ["log.csv", "--predict", "y", "--inputs", "x", "--library", "x", "--ridge", "0", "--threshold", threshold];
        fit(folder.path(), "sindy", &arguments).ok().json()["regions"][0]["equations"][0].clone()
    };
    let kept = fit("0");
    assert!(number(&kept["held_out_r2"]) > 0.9, "{kept}");
    let coefficient = number(&kept["terms"][0]["coefficient"]);
    let dropped = fit(&format!("{}", coefficient * (1.0 + 1e-9)));
    assert_eq!(dropped["terms"].as_array().map(Vec::len), Some(0), "{dropped}");
    let rms: f64 = (square / rows).sqrt();
    assert!((number(&dropped["held_out_rms"]) / rms - 1.0).abs() < 1e-9, "{dropped}");
    assert!(number(&dropped["held_out_r2"]) < 0.01, "{dropped}");
}

#[test]
fn exact_models_have_honest_held_out_errors() {
    let folder = recordings(0.01);
    let report = sindy(folder.path(), &["a.csv", "b.csv"], &[]);
    for equation in report["regions"][0]["equations"].as_array().unwrap() {
        let (all, held_out) = (number(&equation["r2"]), number(&equation["held_out_r2"]));
        assert!(held_out <= all + 0.02 && held_out > all - 0.1, "{equation}");
    }
}

#[test]
fn a_sparse_model_is_held_out_refitted() {
    let mut noises = Noise(9);
    let mut files: Vec<Vec<[f64; 2]>> = Vec::new();
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["a.csv", "b.csv"] {
        let mut text = String::from("t,x,y\n");
        let mut rows = Vec::new();
        for row in 0..400 {
            let x = noises.normal();
            let y = 1.0 + 2.0 * x + 0.1 * noises.normal();
            let _ = writeln!(text, "{},{x},{y}", f64::from(row) * 0.01);
            rows.push([x, y]);
        }
        fs::write(folder.path().join(name), text).expect("a file");
        files.push(rows);
    }
    // Least squares of one file on the other.
    let mut squares = 0.0;
    for (train, test) in [(&files[0], &files[1]), (&files[1], &files[0])] {
        let mean = |column: usize| train.iter().map(|row| row[column]).sum::<f64>() / train.len() as f64;
        let (mx, my) = (mean(0), mean(1));
        let sxy: f64 = train.iter().map(|row| (row[0] - mx) * (row[1] - my)).sum();
        let sxx: f64 = train.iter().map(|row| (row[0] - mx).powi(2)).sum();
        let slope = sxy / sxx;
        squares += test.iter().map(|row| (row[1] - my - slope * (row[0] - mx)).powi(2)).sum::<f64>();
    }
    let expected = (squares / 800.0).sqrt();
    // The lasso at this lambda shrinks the slope by a third, and would err by seven times as much.
    let arguments = ["a.csv", "b.csv", "--predict", "y", "--inputs", "x", "--lambda", "0.3", "--folds", "episodes"];
    let report = fit(folder.path(), "sparse", &arguments).ok().json();
    let held_out = number(&report["tasks"][0]["held_out_rms"]);
    assert!((held_out / expected - 1.0).abs() < 1e-9, "{held_out}, not {expected}: {report}");
}

#[test]
fn bounded_models_have_bounded_held_out_fits() {
    let mut noises = Noise(5);
    let folder = tempfile::tempdir().expect("a folder");
    let mut files: Vec<Vec<[f64; 2]>> = Vec::new();
    // Slopes of 1.7 and 2.4: the bound of 2 moves the one and not the other.
    for (name, slope) in [("a.csv", 1.7), ("b.csv", 2.4)] {
        let rows: Vec<[f64; 2]> = (0..300)
            .map(|_| {
                let x = noises.normal();
                [x, slope * x + 0.1 * noises.normal()]
            })
            .collect();
        let mut text = String::from("t,x,y\n");
        for (row, [x, y]) in rows.iter().enumerate() {
            let _ = writeln!(text, "{},{x},{y}", row as f64 * 0.01);
        }
        fs::write(folder.path().join(name), text).expect("a file");
        files.push(rows);
    }
    let slope = |rows: &[[f64; 2]]| {
        let sum = |of: &dyn Fn(&[f64; 2]) -> f64| rows.iter().map(of).sum::<f64>();
        sum(&|[x, y]| x * y) / sum(&|[x, _]| x * x)
    };
    let error = |slope: f64, rows: &[[f64; 2]]| rows.iter().map(|[x, y]| (y - slope * x).powi(2)).sum::<f64>();
    let held_out = |of: &dyn Fn(f64) -> f64| {
        let squares = error(of(slope(&files[0])), &files[1]) + error(of(slope(&files[1])), &files[0]);
        (squares / 600.0).sqrt()
    };
    let recipe = "[time]\ncolumn = \"t\"\n[latents]\nk = { functions = [\"1\"], at_least = 2.0 }\n[tasks]\nspring = { target = \"y\", right = \"k*x\" }\n";
    fs::write(folder.path().join("spring.toml"), recipe).expect("a file");
    let arguments =
        ["-c", "spring.toml", "a.csv", "b.csv", "--lambda", "0", "--folds", "episodes", "--keep", "s.stats"];
    let report = fit(folder.path(), "sparse", &arguments).ok().json();
    let task = &report["tasks"][0];
    // A bound is kept beyond itself by a millionth of what is bounded.
    for (key, expected) in [("held_out_rms", held_out(&|k| k.max(2.0))), ("free_held_out_rms", held_out(&|k| k))] {
        let reported = number(&task[key]);
        assert!((reported / expected - 1.0).abs() < 1e-5, "{key} {reported}, not {expected}: {report}");
    }
    // A bound that is the same at every row needs no rows.
    let again = fit(folder.path(), "sparse", &["-c", "spring.toml", "s.stats", "--lambda", "0", "--folds", "episodes"]);
    assert_eq!(again.ok().json()["tasks"], report["tasks"]);
}

#[test]
fn episodes_of_one_row_are_refused() {
    let mut text = String::from("t,x,y\n");
    for row in 0..3000 {
        let x = (0.1 * f64::from(row)).sin();
        let _ = writeln!(text, "{},{x},{}", -f64::from(row), 2.0 * x);
    }
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("log.csv"), text).expect("a file");
    for method in ["sindy", "sparse", "pwa"] {
        let arguments = ["log.csv", "--predict", "y", "--inputs", "x", "--time", "t", "--time-unit", "s"];
        fit(folder.path(), method, &arguments).fails(&["3000 episodes", "stamps do not rise"]);
    }
}
