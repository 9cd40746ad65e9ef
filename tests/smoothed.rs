//! Equations found in turn with smoothed states.

use std::{fmt::Write as _, fs, path::Path};

use crate::{derivatives::oscillation, runner::*};

/// Recordings of Lorenz's system from several starts, with noise of a deviation: `run0.csv`, `run1.csv`, ...
fn lorenz(folder: &Path, runs: usize, rows: usize, deviation: f64, seed: u64) {
    let mut draw = seed;
    let mut uniform = || {
        draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (draw >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let rate = |[x, y, z]: [f64; 3]| [10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z];
    let along = |s: [f64; 3], by: f64, d: [f64; 3]| [0, 1, 2].map(|i| s[i] + by * d[i]);
    for run in 0..runs {
        let mut s = [20.0 * uniform(), 20.0 * uniform(), 25.0 + 20.0 * uniform()];
        let mut text = String::from("t,x,y,z\n");
        for row in 0..rows {
            // The sum of twelve uniform numbers is nearly Gaussian, of deviation 1.
            let noisy = s.map(|value| value + deviation * (0..12).map(|_| uniform()).sum::<f64>());
            let _ = writeln!(text, "{:.3},{},{},{}", 0.005 * row as f64, noisy[0], noisy[1], noisy[2]);
            for _ in 0..5 {
                let h = 0.001;
                let a = rate(s);
                let b = rate(along(s, h / 2.0, a));
                let c = rate(along(s, h / 2.0, b));
                let d = rate(along(s, h, c));
                s = along(s, h / 6.0, [0, 1, 2].map(|i| a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
            }
        }
        fs::write(folder.join(format!("run{run}.csv")), text).expect("a file");
    }
}

const FIT: [&str; 10] =
    ["fit", "sindy", "run0.csv", "run1.csv", "run2.csv", "--states", "x,y,z", "--library", "poly(3)", "--json"];

fn fit(path: &Path, more: &[&str]) -> serde_json::Value {
    fleetfoot(path, &[&FIT, more].concat()).ok().json()
}

/// The functions of every equation.
fn terms(report: &serde_json::Value) -> Vec<Vec<&str>> {
    let equations = report["regions"][0]["equations"].as_array().expect("equations");
    let of = |equation: &serde_json::Value| equation["terms"].as_array().expect("terms").len();
    let name = |at: usize, k: usize| report["regions"][0]["equations"][at]["terms"][k]["function"].as_str();
    (0..equations.len()).map(|at| (0..of(&equations[at])).filter_map(|k| name(at, k)).collect()).collect()
}

#[test]
fn smoothed_states_give_missed_terms() {
    let folder = tempfile::tempdir().expect("a folder");
    lorenz(folder.path(), 3, 500, 0.9, 1);
    let truth = [vec!["x", "y"], vec!["x", "y", "x*z"], vec!["z", "x*y"]];
    let windows = fit(folder.path(), &["--smooth-states", "off", "-o", "windows.json"]);
    assert_ne!(terms(&windows), truth, "windows have them all");
    assert!(windows.get("smooth_states").is_none());
    let report = fit(folder.path(), &["-o", "smoothed.json"]);
    assert_eq!(terms(&report), truth);
    let smoothing = &report["smooth_states"];
    assert_eq!(smoothing["written"], true);
    // The objective and the price of the terms fall, and what is left of the measurements is noise, held out too.
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    assert!(number(&smoothing["value"][1]) < number(&smoothing["value"][0]), "{smoothing}");
    assert!(
        (number(&smoothing["held_out"][1]) - 1.0).abs() < 0.1 && number(&smoothing["held_out"][0]) > 1.1,
        "{smoothing}"
    );
    for noise in smoothing["noise"].as_array().expect("states") {
        // Of 1,500 measurements, within a few times 1/sqrt(3000) of it.
        assert!((number(&noise["measurement"]) / 0.9 - 1.0).abs() < 0.08, "{noise}");
    }
    for (equation, truth) in [[-10.0, 10.0].as_slice(), &[28.0, -1.0, -1.0], &[-8.0 / 3.0, 1.0]].iter().enumerate() {
        for (k, truth) in truth.iter().enumerate() {
            let term = &report["regions"][0]["equations"][equation]["terms"][k];
            let (value, error) = (number(&term["coefficient"]), number(&term["standard_error"]));
            // Seven coefficients of one seed: beyond four standard errors once in two thousand.
            assert!((value - truth).abs() < 4.0 * error && error < 0.1 * truth.abs(), "{term}");
        }
    }
    // Errors of the table are those on windows of what was recorded: they keep the noise.
    assert!(number(&report["regions"][0]["equations"][0]["rms"]) > 1.0);
    let words = fleetfoot(folder.path(), &[&FIT[..9], &["-o", "words.json"]].concat()).ok().out;
    assert!(words.contains("states smoothed under the equations: 1500 rows in 3 segments"), "{words}");
    // The same bytes on other numbers of threads, and from the recipe that the model keeps.
    let bytes = |name: &str| fs::read(folder.path().join(name)).expect("a model");
    for threads in ["1", "7"] {
        let name = format!("on{threads}.json");
        fleetfoot(folder.path(), &[&FIT[..9], &["--threads", threads, "-o", &name]].concat()).ok();
        assert!(bytes(&name) == bytes("words.json"), "{threads} threads");
    }
}

#[test]
fn clean_rows_are_not_smoothed() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("log.csv"), oscillation(400, 0.0, 0.0)).expect("a file");
    fs::write(folder.path().join("noisy.csv"), oscillation(400, 0.0, 0.3)).expect("a file");
    let fit = |log: &str, more: &[&str]| {
        let base =
            ["fit", "sindy", log, "--states", "x,y", "--library", "poly(2)", "--time", "t", "--json", "-o", "m.json"];
        fleetfoot(folder.path(), &[&base, more].concat())
    };
    assert!(fit("log.csv", &[]).ok().json().get("smooth_states").is_none());
    assert!(fit("noisy.csv", &[]).ok().json().get("smooth_states").is_some());
    // Options that set the number of terms are not overruled unasked.
    for more in [["--terms", "2"], ["--threshold", "0.1"], ["--select", "bic"], ["--optimizer", "ssr"]] {
        assert!(fit("noisy.csv", &more).ok().json().get("smooth_states").is_none(), "{more:?}");
        let refused = fit("noisy.csv", &[&more[..], &["--smooth-states", "on"]].concat()).err;
        assert!(refused.contains("smooth_states = on, and") && refused.contains("remove one of them"), "{refused}");
    }
    // More rows than are smoothed by themselves are left to the windows, with a word.
    fs::write(folder.path().join("long.csv"), oscillation(20_100, 0.0, 0.3)).expect("a file");
    let long = fit("long.csv", &[]).ok();
    assert!(long.json().get("smooth_states").is_none() && long.json().get("weak").is_some());
    assert!(long.err.contains("states of 20100 rows are not smoothed"), "{}", long.err);
    let regions = fit("noisy.csv", &["--smooth-states", "on", "--partition", "kmeans:2"]).err;
    assert!(regions.contains("there are regions (--partition)"), "{regions}");
}
