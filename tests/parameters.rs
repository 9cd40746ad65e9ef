//! `fit parameters`: numbers inside given equations, with intervals; the model that is written runs like any other.

use std::fs;

use crate::runner::*;

/// x' = v, v' = -k x - c v + g u with k = 4, c = 0.6, g = 2, by Runge-Kutta steps with held inputs, measured with noise of deviation 0.01 and pushed by one of so much a row.
fn spring(rows: u32, seed: u32, pushed: f64) -> String {
    let (mut z, mut state, mut text) = ([1.0, 0.0], 12_345 + 977 * seed, String::from("t,x,v,u\n"));
    let mut noise = || {
        let mut uniform = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(u32::MAX)
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    };
    for k in 0..rows {
        let u = (0.9 * f64::from(k) * 0.05 + f64::from(seed)).sin().signum();
        text.push_str(&format!("{:.2},{},{},{u}\n", f64::from(k) * 0.05, z[0] + 0.01 * noise(), z[1] + 0.01 * noise()));
        let slope = |z: [f64; 2]| [z[1], -4.0 * z[0] - 0.6 * z[1] + 2.0 * u];
        let moved = |f: [f64; 2], h: f64| [z[0] + h * f[0], z[1] + h * f[1]];
        let one = slope(z);
        let two = slope(moved(one, 0.025));
        let three = slope(moved(two, 0.025));
        let four = slope(moved(three, 0.05));
        (0..2).for_each(|i| z[i] += 0.05 / 6.0 * (one[i] + 2.0 * two[i] + 2.0 * three[i] + four[i]));
        if pushed > 0.0 {
            z[1] += pushed * noise();
        }
    }
    text
}

const RECIPE: &str = r#"
[states]
x = { known = "v" }
v = { known = "-k*x - c*v + g*u" }
[inputs]
u = "u"
[time]
column = "t"
[parameters]
k = { initial = 3.0, unit = "1/s^2" }
c = { initial = 0.3, bounds = [0, 5] }
g = { initial = 1.0 }
"#;

fn folder(recipe: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for seed in 0..5 {
        fs::write(folder.path().join(format!("run{seed}.csv")), spring(300, seed, 0.0)).expect("a log");
    }
    fs::write(folder.path().join("robot.toml"), recipe).expect("a recipe");
    folder
}

const LOGS: [&str; 5] = ["run0.csv", "run1.csv", "run2.csv", "run3.csv", "run4.csv"];

fn fit(folder: &Path, options: &[&str]) -> Said {
    fleetfoot(folder, &[&["fit", "parameters", "-c", "robot.toml"], options, &LOGS[..]].concat())
}

#[test]
fn the_truth_lies_in_the_intervals_and_the_model_runs_like_any_other() {
    let folder = folder(RECIPE);
    let said = fit(folder.path(), &["--json", "-o", "spring.json"]).ok();
    let report = said.json();
    for (own, truth) in report["parameters"].as_array().unwrap().iter().zip([4.0, 0.6, 2.0]) {
        let [low, high] = [0, 1].map(|end| own["interval"][end].as_f64().unwrap());
        assert!(low < truth && truth < high && high - low < 0.1, "{own}");
        assert!(own["standard_error"].as_f64().unwrap() > 0.0 && own["determined"] == true, "{own}");
    }
    assert!(report["held_out"]["over_persistence"].as_f64().unwrap() < 0.1 && report["converged"] == true, "{report}");
    assert_eq!((report["segments"].as_u64(), report["confounded"].as_array().unwrap().len()), (Some(5), 0));
    let noise = report["noise"][0]["deviation"].as_f64().unwrap();
    assert!((noise - 0.01).abs() < 1e-3, "{noise}");
    // The model keeps what is known of its parameters, and its recipe makes it again.
    let text = fs::read_to_string(folder.path().join("spring.json")).unwrap();
    let model: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert!(text.contains("parameter_covariance") && text.contains("\"k\""), "{model}");
    let shown = fleetfoot(folder.path(), &["show", "spring.json"]).ok().out;
    assert!(!shown.contains("k*x"), "{shown}");
    fleetfoot(folder.path(), &["score", "spring.json", "run0.csv"]).ok();
    let rolled =
        fleetfoot(folder.path(), &["rollout", "spring.json", "run0.csv", "--horizon", "50", "--method", "rk4"]).ok();
    assert!(rolled.out.contains("better than every baseline"), "{}", rolled.out);
    fleetfoot(folder.path(), &["export", "spring.json", "--to", "python", "-o", "code"]).ok();
    // A flag says what the recipe says; segments, fixed and compared states are told.
    let text = fit(folder.path(), &["--segment", "100", "--compare", "x", "--folds", "0", "--parameter", "g=2"]).ok();
    assert!(
        text.out.contains("15 segments") && text.err.contains("in-sample") && !text.out.contains("Held out"),
        "{}",
        text.out
    );
}

/// A push that no column knows, on the speed alone: its gain is found, that of the position is small, the report tells both, and the truth is where it says.
#[test]
fn what_pushes_the_dynamics_is_filtered() {
    let folder = folder(&format!("{RECIPE}[estimate]\nmethod = \"filter-error\"\n"));
    for seed in 0..5 {
        fs::write(folder.path().join(format!("run{seed}.csv")), spring(300, seed, 0.02)).expect("a log");
    }
    let report = fit(folder.path(), &["--json"]).ok().json();
    for (own, truth) in report["parameters"].as_array().unwrap().iter().zip([4.0, 0.6, 2.0]) {
        let [value, error] = ["value", "standard_error"].map(|key| own[key].as_f64().unwrap());
        // Three parameters are beyond three deviations once in a hundred and twenty logs.
        assert!((value - truth).abs() < 3.0 * error && error < 0.05, "{own}");
    }
    assert_eq!((report["method"].as_str(), report["converged"].as_bool()), (Some("filter-error"), Some(true)));
    let gains = report["gains"].as_array().unwrap();
    let [x, v] = [0, 1].map(|at| gains[at]["value"].as_f64().unwrap());
    // Of the speed by itself the steady variance of a prediction is p = p r/(p + r) + q: its gain is 0.83 with r = 0.01^2 and q = 0.02^2.
    assert!(
        x < 0.3 && (0.7..0.95).contains(&v) && gains[1]["name"] == "v" && gains[1]["at_bound"] == false,
        "{gains:?}"
    );
    let innovations = |i: usize, j: usize| report["innovations"][i][j].as_f64().unwrap();
    let deviation = report["noise"][1]["deviation"].as_f64().unwrap();
    assert!((innovations(1, 1).sqrt() / deviation - 1.0).abs() < 1e-6 && innovations(0, 1) == innovations(1, 0));
    assert!(report["held_out"]["over_persistence"].as_f64().unwrap() < 1.0, "{report}");
    let text = fit(folder.path(), &["--folds", "0"]).ok().out;
    for words in [
        "filter error: 5 segments",
        "of the innovations: x 0.0",
        "correlation of x and v",
        "Gains, from 0 (output error)",
        "v 0.8",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    // Without what pushes a gain ends at 0 and the report says what that means; the flag goes before the recipe.
    fs::write(folder.path().join("run0.csv"), spring(300, 0, 0.0)).expect("a log");
    let calm =
        fleetfoot(folder.path(), &["fit", "parameters", "-c", "robot.toml", "run0.csv", "--folds", "0", "--json"]);
    let calm = calm.ok().json();
    let bound = calm["gains"].as_array().unwrap().iter().filter(|gain| gain["at_bound"] == true).count();
    let told =
        calm["warnings"].as_array().unwrap().iter().filter(|text| text.as_str().unwrap().contains("at its bound 0"));
    assert!(bound > 0 && told.count() == bound, "{calm}");
    let output = fit(folder.path(), &["--folds", "0", "--method", "output-error", "--json"]).ok().json();
    assert!(output["gains"].is_null() && output["method"] == "output-error", "{output}");
}

#[test]
fn what_the_rows_do_not_tell_is_said() {
    let twice = RECIPE.replace("-k*x", "-k*b*x").replace("[parameters]", "[parameters]\nb = { initial = 1.0 }");
    let folder = folder(&twice);
    let said = fit(folder.path(), &["--folds", "0"]).ok().out;
    assert!(said.contains("do not determine `b`") && said.contains("do not determine `k`"), "{said}");
    let fixed = twice.replace("b = { initial = 1.0 }", "b = { initial = 1.0, fixed = true }");
    fs::write(folder.path().join("robot.toml"), fixed).unwrap();
    let said = fit(folder.path(), &["--folds", "0", "--method", "equation-error"]).ok().out;
    assert!(said.contains("fixed") && !said.contains("do not determine"), "{said}");
}

#[test]
fn what_cannot_be_asked_is_refused_with_the_mend() {
    let folder = folder(RECIPE);
    let with = |from: &str, to: &str, options: &[&str], words: &[&str]| {
        fs::write(folder.path().join("robot.toml"), RECIPE.replace(from, to)).unwrap();
        fit(folder.path(), options).fails(words);
    };
    with("v = { known = \"-k*x - c*v + g*u\" }", "v = {}", &[], &["[states] v", "known"]);
    with("+ g*u", "", &[], &["[parameters] g", "no equation"]);
    with("[time]", "[model]\nweight = \"u\"\n[time]", &[], &["weight"]);
    with("k = {", "x = {", &[], &["[parameters] x", "column"]);
    with("", "", &["--compare", "w"], &["compare", "`w`", "state"]);
    with("", "", &["--segment", "1"], &["segment = 1", "two rows"]);
    with("", "", &["--method", "equation-error", "--segment", "50"], &["segment"]);
}
