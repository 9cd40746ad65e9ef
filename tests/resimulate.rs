//! `resimulate`: followed recordings obey the model's equations and its bounds, in the file as in the report. Also
//! refusals.

use std::fs;

use crate::runner::*;

/// Recipe of columns and equations: the truth of [`robot_csv`] below v = 0.5, so that the model is wrong above it.
const RECIPE: &str = r#"
[columns]
v = "`v [m/s]`"
[states]
x = { known = "v" }
v = { known = "b*u - a*v" }
[inputs]
u = "u"
[time]
column = "t"
[parameters]
a = { initial = 2.0, fixed = true }
b = { initial = 2.5 }
"#;

/// Two logs and a model of the first.
fn folder(recipe: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for run in 0..2 {
        fs::write(folder.path().join(format!("run_{run}.csv")), robot_csv(400, f64::from(run))).expect("a log");
    }
    fit(folder.path(), recipe, "model.json");
    folder
}

fn fit(folder: &Path, recipe: &str, output: &str) {
    fs::write(folder.join("robot.toml"), format!("{RECIPE}{recipe}")).expect("a recipe");
    let words = ["fit", "parameters", "-c", "robot.toml", "run_0.csv", "--folds", "0", "-o", output];
    fleetfoot(folder, &words).ok();
}

fn followed(folder: &Path, options: &[&str]) -> Run {
    fleetfoot(folder, &[&["resimulate", "model.json", "run_1.csv"], options].concat())
}

/// The columns of a CSV, by their names.
fn columns(text: &str) -> impl Fn(&str) -> Vec<f64> {
    let rows: Vec<Vec<String>> = text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect();
    move |name| {
        let at = rows[0].iter().position(|field| field.trim_matches('"') == name);
        let at = at.unwrap_or_else(|| panic!("{name}: {:?}", rows[0]));
        rows[1..].iter().map(|row| row[at].parse().unwrap_or(f64::NAN)).collect()
    }
}

fn rms(values: &[f64], other: &[f64]) -> f64 {
    (values.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn files_obey_equations_and_bounds() {
    let folder = folder("");
    let path = folder.path();
    let report = followed(path, &["--bounds", "u=-0.3..1.4", "--json", "-o", "followed.csv"]).ok().json();
    assert!(report["violation"]["dynamics"].as_f64().unwrap() < 1e-6, "{report}");
    assert_eq!((&report["minima"], &report["violation"]["bounds"]), (&1.into(), &0.0.into()), "{report}");
    assert_eq!((&report["rows"], &report["rule"]), (&400.into(), &"hermite-simpson".into()));
    let text = fs::read_to_string(path.join("followed.csv")).unwrap();
    let column = columns(&text);
    let (x, v, u) = (column("x"), column("v"), column("u"));
    assert!(u.iter().all(|u| (-0.3..=1.4).contains(u)) && u.iter().any(|&u| u > 1.4 - 1e-9), "{u:?}");
    // Hermite and Simpson's rule written out for v' = b u - a v, with the b that the model has.
    let model = fs::read_to_string(path.join("model.json")).unwrap();
    let parameters: serde_json::Value = serde_json::from_str(&model).unwrap();
    let shown = fleetfoot(path, &["show", "model.json"]).ok().out;
    let b: f64 = shown
        .lines()
        .find_map(|line| line.split_once("d(v)/dt = ")?.1.split_once("*u")?.0.rsplit(' ').next()?.parse().ok())
        .unwrap_or_else(|| panic!("{shown} {parameters}"));
    let (h, a) = (0.01, 2.0);
    for k in 0..x.len() - 1 {
        let f = |v: f64, u: f64| b * u - a * v;
        let (one, two) = (f(v[k], u[k]), f(v[k + 1], u[k + 1]));
        let middle = 0.5 * (v[k] + v[k + 1]) + h / 8.0 * (one - two);
        let mean = (one + 4.0 * f(middle, 0.5 * (u[k] + u[k + 1])) + two) / 6.0;
        // `show` has six digits of b.
        assert!((v[k + 1] - v[k] - h * mean).abs() < 1e-6, "row {k}");
        assert!((x[k + 1] - x[k] - h / 6.0 * (v[k] + 4.0 * middle + v[k + 1])).abs() < 1e-9, "row {k}");
    }
    // The report is of what the file has.
    for (at, name) in ["x", "v", "u"].iter().enumerate() {
        let entry = &report["columns"][at];
        assert_eq!(entry["name"], *name);
        let measured = column(&format!("{name} measured"));
        let median = entry["followed"]["median"].as_f64().unwrap();
        assert!((median / rms(&column(name), &measured) - 1.0).abs() < 1e-9, "{name}: {median}");
        if at < 2 {
            let median = entry["open_loop"]["median"].as_f64().unwrap();
            assert!(
                (median / rms(&column(&format!("{name} open loop")), &measured) - 1.0).abs() < 1e-9,
                "{name}: {median}"
            );
            assert!(median > entry["followed"]["median"].as_f64().unwrap(), "{entry}");
        }
    }
}

#[test]
fn results_are_printed_and_viewed() {
    let folder = folder("");
    let path = folder.path();
    let words = ["resimulate", "model.json", "run_0.csv", "run_1.csv", "--episodes", "-o", "followed.mcap"];
    let output = fleetfoot(path, &words).ok();
    for words in ["2 episodes followed, 800 rows", "moved: u", "at a minimum: 2 of 2", "open loop: median", "run_1"] {
        assert!(output.out.contains(words), "`{words}` is missing from {}", output.out);
    }
    assert!(output.err.contains("1 of 2 episodes were used in training"), "{}", output.err);
    let info = fleetfoot(path, &["info", "followed.mcap"]).ok().out;
    for topic in ["/fleetfoot/measured", "/fleetfoot/followed", "/fleetfoot/open_loop"] {
        assert!(info.contains(topic), "{topic}: {info}");
    }
    assert!(path.join("followed.foxglove.json").exists() && path.join("followed.plotjuggler.xml").exists());
}

#[test]
fn impossible_resimulations_are_refused() {
    let folder = folder("");
    let refused = |options: &[&str], words: &[&str]| {
        followed(folder.path(), options).fails(words);
    };
    refused(&["--free", "w"], &["`w`", "no input", "u"]);
    refused(&["--bounds", "u=2..1"], &["bounds", "`u`", "2..1"]);
    refused(&["--bounds", "w=1..2"], &["`w`", "x, v, u"]);
    refused(&["--deviations", "u=0"], &["deviations", "`u`", "positive"]);
    refused(&["--every", "0"], &["every", "0"]);
    refused(&["--iterations", "0"], &["iterations", "0"]);
    refused(&["--widen=-1"], &["widen", "-1"]);
    let single: String = robot_csv(400, 1.0).lines().take(2).map(|line| format!("{line}\n")).collect();
    fs::write(folder.path().join("run_1.csv"), single).unwrap();
    refused(&[], &["none of 1 episodes", "two rows"]);
    // A model without states has nothing to follow.
    let narx = ["fit", "narx", "run_0.csv", "--states", "x", "--inputs", "u", "--lags-out", "2", "--folds", "2"];
    fleetfoot(folder.path(), &[&narx[..], &["-o", "model.json"]].concat()).ok();
    refused(&[], &["earlier rows"]);
}

/// Every option, by flag and by `[resimulate]` of the recipe that the model was fitted with; flags stand above.
#[test]
fn options_are_flags_and_entries() {
    let folder = folder("");
    let path = folder.path();
    let plain = followed(path, &["--json"]).ok().json();
    let options = [
        ("--every=2", "every = 2"),
        ("--free=u", "free = \"u\""),
        ("--deviations=x=0.1,v=0.2", "deviations = \"x=0.1,v=0.2\""),
        ("--bounds=u=..1.2", "bounds = \"u=..1.2\""),
        ("--widen=0.5", "widen = 0.5"),
        ("--iterations=1", "iterations = 1"),
    ];
    for (flag, entry) in options {
        fit(path, "", "model.json");
        let flagged = followed(path, &[flag, "--json"]).ok().json();
        // All inputs may move already: there is one.
        assert!((flagged == plain) == flag.starts_with("--free"), "{flag}");
        fit(path, &format!("[resimulate]\n{entry}\n"), "model.json");
        assert_eq!(followed(path, &["--json"]).ok().json(), flagged, "{entry}");
    }
    let (flags, entries): (Vec<&str>, Vec<&str>) = options.into_iter().unzip();
    let above = [&flags[..], &["--json"]].concat();
    fit(path, "", "model.json");
    let flagged = followed(path, &above).ok().json();
    let otherwise = "every = 4\nfree = \"u\"\ndeviations = \"u=1\"\nbounds = \"v=-1..2\"\nwiden = 1\niterations = 9\n";
    fit(path, &format!("[resimulate]\n{otherwise}"), "model.json");
    assert_eq!(followed(path, &above).ok().json(), flagged, "{entries:?}");
    assert_ne!(followed(path, &["--json"]).ok().json(), flagged);
}
