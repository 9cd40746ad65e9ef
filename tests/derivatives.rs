//! Measured derivatives: orders of central differences, and mean slopes over spans.

use std::{fmt::Write, fs};

use crate::runner::*;

/// A damped oscillation, `x' = y`, `y' = -4 x - 0.2 y`, exactly, at stamps 0.05 s apart but for `jitter`, with noise of a given size.
pub(crate) fn oscillation(rows: usize, jitter: f64, noise: f64) -> String {
    let (damping, frequency) = (0.1_f64, (4.0_f64 - 0.01).sqrt());
    let mut text = String::from("t,x,y\n");
    let mut draw = 1_u64;
    let mut uniform = || {
        draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (draw >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    for row in 0..rows {
        // Stamps of whole microseconds: a file and a log have the same ones.
        let t = ((0.05 * row as f64 + jitter * uniform()) * 1e6).round() / 1e6;
        let (sine, cosine) = (frequency * t).sin_cos();
        let x = (-damping * t).exp() * cosine;
        let y = -(-damping * t).exp() * (damping * cosine + frequency * sine);
        let _ = writeln!(text, "{t},{},{}", x + noise * uniform(), y + noise * uniform());
    }
    text
}

fn folder(text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("log.csv"), text).expect("a file");
    folder
}

fn sindy(text: &str, more: &[&str]) -> serde_json::Value {
    let folder = folder(text);
    let fixed = ["fit", "sindy", "log.csv", "--states", "x,y", "--degree", "1", "--json"];
    let all: Vec<&str> = fixed.into_iter().chain(more.iter().copied()).collect();
    fleetfoot(folder.path(), &all).ok().json()["regions"][0]["equations"].clone()
}

fn number(value: &serde_json::Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// The coefficient of a function in an equation; 0 unless it is a term.
pub(crate) fn coefficient(equation: &serde_json::Value, function: &str) -> f64 {
    let terms = equation["terms"].as_array().expect("terms");
    terms.iter().find(|term| term["function"] == function).map_or(0.0, |term| number(&term["coefficient"]))
}

#[test]
fn data_choose_the_order_of_differences() {
    let clean = sindy(&oscillation(400, 0.0, 0.0), &[]);
    for equation in [&clean[0], &clean[1]] {
        let difference = &equation["difference"];
        assert_eq!(difference["order"], 6, "{difference}");
        // Each order is better than the one before by h^2, up to a factor.
        let by_order: Vec<f64> = (0..3).map(|at| number(&difference["rms_by_order"][at])).collect();
        assert!(by_order[0] > 100.0 * by_order[1] && by_order[1] > 100.0 * by_order[2], "{by_order:?}");
    }
    // Of order 2 it is h^2/6 of the third derivative, which is -4 of the first up to the damping; y^2 is 2 e^(-t/5) on average.
    let slope = (2.0 * 5.0 * (1.0 - (-4.0_f64).exp()) / 20.0).sqrt();
    let second = number(&clean[0]["difference"]["rms_by_order"][0]);
    assert!((second / (0.05_f64.powi(2) / 6.0 * 4.0 * slope) - 1.0).abs() < 0.05, "{second} {slope}");
    assert!((coefficient(&clean[1], "x") + 4.0).abs() < 1e-5 && (coefficient(&clean[1], "y") + 0.2).abs() < 1e-5);
    let second = sindy(&oscillation(400, 0.0, 0.0), &["--derivative", "x=central", "--derivative", "y=central4"]);
    assert_eq!((&second[0]["difference"]["order"], &second[1]["difference"]["order"]), (&2.into(), &4.into()));
    assert!((coefficient(&second[0], "y") - 1.0).abs() > 1e-4, "of order 2 it is off by h^2/6 of 4");
    assert!((coefficient(&second[1], "x") + 4.0).abs() < 1e-3);
    let noisy = sindy(&oscillation(400, 0.0, 0.02), &[]);
    let difference = &noisy[0]["difference"];
    assert_eq!(difference["order"], 2, "{difference}");
    // Uniform noise of a width of 0.02 makes an error of 0.02/sqrt(12)/sqrt(2)/0.05.
    let noise = 0.02 / 12.0_f64.sqrt() / 2.0_f64.sqrt() / 0.05;
    assert!((number(&difference["noise_rms"]) / noise - 1.0).abs() < 0.15, "{difference} {noise}");
}

#[test]
fn uneven_stamps_get_exact_weights() {
    for (more, order) in [(&[][..], 6), (&["--derivative", "x=central6", "--derivative", "y=central6(y)"][..], 6)] {
        let equations = sindy(&oscillation(400, 0.02, 0.0), more);
        for equation in [&equations[0], &equations[1]] {
            assert_eq!(equation["difference"]["order"], order, "{equation}");
            assert!(number(&equation["difference"]["rms_by_order"][2]) < 1e-4, "{equation}");
        }
        assert!((coefficient(&equations[0], "y") - 1.0).abs() < 1e-4, "{equations}");
        assert!((coefficient(&equations[1], "x") + 4.0).abs() < 1e-3, "{equations}");
    }
}

#[test]
fn explicit_differences_have_an_error_estimate() {
    let written = "(lead(x, 1) - lag(x, 1))/(lead(time(), 1) - lag(time(), 1))";
    let equations =
        sindy(&oscillation(400, 0.0, 0.0), &["--derivative", &format!("x={written}"), "--derivative", "y=central4(y)"]);
    assert_eq!((&equations[0]["difference"]["order"], &equations[1]["difference"]["order"]), (&2.into(), &4.into()));
}

#[test]
fn derivatives_may_be_slopes_over_spans() {
    let folder = folder(&oscillation(600, 0.0, 0.01));
    for command in ["sindy", "pwa"] {
        let fit = ["fit", command, "log.csv", "--states", "x,y", "--degree", "1", "--derivative", "x=over:5"];
        let output = fleetfoot(folder.path(), &fit).ok();
        assert!(output.out.contains("d(x)/dt over 5 rows") && output.out.contains("d(y)/dt"), "{}", output.out);
        // The score of such an equation is one of mean slopes, by its label; persistence does not know the span that is not over.
        let output = fleetfoot(folder.path(), &["score", "model.json", "log.csv"]).ok();
        assert!(output.out.contains("d(x)/dt over 5 rows"), "{}", output.out);
    }
    let recipe = "[states]\nx = { derivative = { over = 5 } }\ny = {}\n[model]\ndegree = 1\n";
    fs::write(folder.path().join("robot.toml"), recipe).expect("a file");
    let output = fleetfoot(folder.path(), &["fit", "sindy", "-c", "robot.toml", "log.csv"]).ok();
    assert!(output.out.contains("d(x)/dt over 5 rows"), "{}", output.out);
    let refused = ["fit", "sindy", "log.csv", "--states", "x,y", "--derivative", "x=over:0"];
    fleetfoot(folder.path(), &refused).fails(&["over = 0", "1 to 1000 rows"]);
}

#[test]
fn spans_of_angles_wrap_steps() {
    // A turn of 2.5 rad/s passes pi every 2.5 s.
    let mut text = String::from("t,phi,w\n");
    for row in 0..400 {
        let t = 0.02 * f64::from(row);
        let phi = (2.5 * t + std::f64::consts::PI).rem_euclid(2.0 * std::f64::consts::PI) - std::f64::consts::PI;
        let _ = writeln!(text, "{t},{phi},2.5");
    }
    let folder = folder(&text);
    let fit = [
        "fit",
        "sindy",
        "log.csv",
        "--states",
        "phi",
        "--angles",
        "phi",
        "--library",
        "1",
        "--derivative",
        "phi=over:20",
        "--json",
    ];
    let report = fleetfoot(folder.path(), &fit).ok().json();
    let equation = &report["regions"][0]["equations"][0];
    assert!((coefficient(equation, "1") - 2.5).abs() < 1e-6, "{equation}");
}

/// `fit METHOD` of the robot's log in `log.csv`, with more options, which contain no blanks.
fn of_robot<'a>(method: &'a str, more: &'a str) -> Vec<&'a str> {
    let fixed = ["fit", method, "log.csv", "--alias", "v=`v [m/s]`", "--states", "v", "--inputs", "u"];
    fixed.into_iter().chain(more.split_whitespace()).collect()
}

#[test]
fn rollouts_choose_regions_and_spans() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("log.csv"), robot_csv(3000, 0.3)).expect("a file");
    let all = of_robot("pwa", "--select rollout --horizon 20 --partition average,kmeans:2,6 --json");
    let report = fleetfoot(folder.path(), &all).ok().json();
    let choice = &report["rollouts"];
    let candidates = choice["candidates"].as_array().expect("candidates");
    assert_eq!((candidates.len(), &choice["horizon"], &choice["folds"]), (3, &20.into(), &5.into()), "{choice}");
    assert_eq!(choice["chosen"], report["chosen"], "what is written is what was chosen");
    let error = |at: usize| candidates[at]["error_over_persistence"].as_f64().expect("a number");
    // The robot has two regimes: one region simulates worse than several.
    let chosen = choice["chosen"].as_u64().expect("an index") as usize;
    assert!(chosen > 0 && error(chosen) < 0.8 * error(0), "{choice}");
    for candidate in candidates {
        let folds: Vec<f64> =
            candidate["folds"].as_array().unwrap().iter().filter_map(serde_json::Value::as_f64).collect();
        let mean = folds.iter().sum::<f64>() / 5.0;
        assert!(folds.len() == 5 && (mean / candidate["error_over_persistence"].as_f64().unwrap() - 1.0).abs() < 1e-12);
    }
    // An open span is compared with central differences, and the model has the chosen one.
    let open = of_robot("pwa", "--derivative v=over:auto --horizon 20");
    let output = fleetfoot(folder.path(), &open).ok();
    assert!(
        output.out.contains("central") && output.out.contains("over 20 rows") && output.out.contains("<- chosen"),
        "{}",
        output.out
    );
    let open = of_robot("sindy", "--degree 1 --derivative v=over:auto --horizon 20 --json");
    let report = fleetfoot(folder.path(), &open).ok().json();
    let candidates = report["rollouts"]["candidates"].as_array().expect("candidates");
    assert_eq!(candidates.len(), 6, "{report}");
    let chosen = &candidates[report["rollouts"]["chosen"].as_u64().expect("an index") as usize];
    let label = report["regions"][0]["equations"][0]["label"].as_str().expect("a label");
    match chosen["over"].as_u64() {
        Some(rows) => assert!(label.ends_with(&format!("over {rows} rows")), "{label}"),
        None => assert!(label.ends_with("/dt"), "{label}"),
    }
    let dry = of_robot("pwa", "--select rollout --horizon 20 --partition average,kmeans:2 --dry-run");
    let planned = fleetfoot(folder.path(), &dry).ok();
    assert!(
        planned.out.contains("18 passes") && planned.out.contains("2 x 5 x 50 rollouts of 20 steps"),
        "{}",
        planned.out
    );
    let alone = of_robot("pwa", "--horizon 20");
    fleetfoot(folder.path(), &alone).fails(&["--horizon 20", "--select rollout"]);
    let long = of_robot("pwa", "--select rollout --horizon 900");
    fleetfoot(folder.path(), &long).fails(&["900 steps", "shorter --horizon"]);
}
