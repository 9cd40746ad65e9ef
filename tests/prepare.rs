//! Clean episodes from raw logs, and the fits that take them as they are.

use std::{collections::BTreeSet, fs};

use crate::runner::*;

const ROWS: usize = 3000;
const DT: f64 = 0.01;

/// A number from -1 to 1 that looks random.
fn noise(seed: u64, row: usize) -> f64 {
    let mixed = fleetfoot::data::mix(fleetfoot::data::mix(seed).wrapping_add(row as u64));
    (mixed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// The rows whose position is wrong by more than 0.5.
fn wrong() -> BTreeSet<usize> {
    (37..ROWS).step_by(113).collect()
}

/// A mass on a spring, x'' = -4 x - 0.6 x' + 2 u: a log of stamps, positions with noise of 2 mm and gross errors, and the force.
fn spring(seed: u64) -> String {
    let (mut x, mut v) = (0.0_f64, 0.0_f64);
    let wrong = wrong();
    let mut text = String::from("t,x [m],u\n");
    let force = |t: f64| (1.1 * t).sin() + 0.8 * (2.9 * t + seed as f64).cos() + 0.5 * (5.3 * t).sin();
    for row in 0..ROWS {
        let t = DT * row as f64;
        let error =
            if wrong.contains(&row) { 0.6 * (1.0 + noise(seed + 7, row).abs()) } else { 0.0035 * noise(seed, row) };
        text.push_str(&format!("{t:.6},{},{}\n", x + error, force(t)));
        // Steps of a hundredth of a row: the midpoint rule errs by 1e-10.
        for step in 0..100 {
            let (h, at) = (DT / 100.0, t + DT / 100.0 * (f64::from(step) + 0.5));
            let a = |x: f64, v: f64| -4.0 * x - 0.6 * v + 2.0 * force(at);
            let (half_x, half_v) = (x + 0.5 * h * v, v + 0.5 * h * a(x, v));
            (x, v) = (x + h * half_v, v + h * a(half_x, half_v));
        }
    }
    text
}

const RECIPE: &str = "columns = { x = \"`x [m]`\" }\nstates = { x = { unit = \"m\" } }\ninputs = { u = \"u\" }\n[library]\nfunctions = [\"1\", \"identity\"]\n\
                      [prepare]\nsecond_order = true\nclip = 0.2\n[[episodes]]\nmatch = \"run_1*\"\nfloor = \"wet\"\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for run in 0..2 {
        fs::write(folder.path().join(format!("run_{run}.csv")), spring(run)).expect("a file");
    }
    fs::write(folder.path().join("robot.toml"), RECIPE).expect("a file");
    folder
}

const PREPARE: [&str; 7] = ["prepare", "-c", "robot.toml", "run_0.csv", "run_1.csv", "-o", "clean"];

fn coefficient(model: &serde_json::Value, term: &str) -> f64 {
    let equations = model["regions"][0]["equations"].as_array().expect("equations");
    let terms = equations.iter().flat_map(|equation| equation["terms"].as_array().expect("terms"));
    let found = terms.filter(|own| own["function"] == term).find_map(|own| own["coefficient"].as_f64());
    found.unwrap_or_else(|| panic!("no term {term} in {model:#}"))
}

/// From positions alone, with gross errors in them, to the equation of the motion: `fit` takes the written recipe unchanged.
#[test]
fn the_written_recipe_fits_unchanged() {
    let folder = folder();
    let path = folder.path();
    let said = fleetfoot(path, &[&PREPARE[..], &["--json"]].concat()).ok().json();
    let clipped = 2 * (0.2 / DT) as usize;
    for episode in said["episodes"].as_array().expect("episodes") {
        assert_eq!(episode["clipped"], clipped);
        let channel = &episode["pieces"][0]["channels"][0];
        let rejected = &channel["rejected"];
        let kept = |row: &usize| (clipped / 2..ROWS - clipped / 2).contains(row);
        let inside: Vec<usize> = wrong().into_iter().filter(kept).collect();
        let spans = rejected["spans"].as_array().expect("places");
        let is_placed = |row: usize| {
            let t = DT * row as f64;
            spans.iter().any(|span| span[0].as_f64() <= Some(t + 1e-6) && span[1].as_f64() >= Some(t - 1e-6))
        };
        let count = inside.len() as u64;
        assert!(inside.into_iter().all(is_placed), "{rejected}");
        assert!(rejected["rows"].as_u64() <= Some(count + 3), "{rejected}");
        let noise = channel["noise"].as_f64().expect("a noise");
        // Uniform noise of 3.5 mm has a deviation of 3.5 / sqrt(3) mm.
        assert!((noise / 0.00202 - 1.0).abs() < 0.05, "{noise}");
    }
    let recipe = fs::read_to_string(path.join("clean/robot.toml")).expect("a recipe");
    assert!(recipe.contains("smoothed = ") && recipe.contains("floor = \"wet\""), "{recipe}");
    let fit = ["fit", "sindy", "-c", "clean/robot.toml", "clean", "-o", "model.json", "--json"];
    let fitted = fleetfoot(path, &fit).ok().json();
    for (term, truth) in [("x", -4.0), ("x_dot", -0.6), ("u", 2.0)] {
        let found = coefficient(&fitted, term);
        // Smoothing takes a little of the fastest motion away.
        assert!((found - truth).abs() < 0.03 * truth.abs(), "{term}: {found}");
    }
    // A position's rate is known; the model simulates both.
    fleetfoot(path, &["rollout", "model.json", "clean", "--horizon", "100", "--starts", "20"]).ok();
    // Of a raw log the model knows no column: it must be prepared first.
    fleetfoot(path, &["score", "model.json", "run_0.csv"]).fails(&["unknown column", "fleetfoot prepare"]);
}

/// The same bytes on any number of threads, and no folder is overwritten unasked.
#[test]
fn threads_do_not_matter_and_folders_are_not_overwritten() {
    let folder = folder();
    let path = folder.path();
    fleetfoot(path, &[&PREPARE[..], &["--threads", "1"]].concat()).ok();
    let read = |name: &str| fs::read(path.join("clean").join(name)).expect("a file");
    let names = ["run_0.clean.parquet", "run_1.clean.parquet", "robot.toml"];
    let before = names.map(read);
    fleetfoot(path, &PREPARE).fails(&["--force", "clean"]);
    fleetfoot(path, &[&PREPARE[..], &["--threads", "7", "--force"]].concat()).ok();
    assert!(before == names.map(read));
}

/// Bounds end an episode; what is left is written in pieces, and what is too short is told.
#[test]
fn bounds_end_episodes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let rows = (0..1000).map(|row| {
        let t = 0.01 * f64::from(row);
        let level = if (400..420).contains(&row) || row == 440 { 9.0 } else { (2.0 * t).sin() };
        format!("{t},{},{}\n", level + 0.001 * noise(3, row as usize), f64::from(row % 7))
    });
    fs::write(path.join("log.csv"), format!("t,x,u\n{}", rows.collect::<String>())).expect("a file");
    let recipe = "states = { x = {} }\ninputs = { u = \"u\" }\n[channels.x]\nbounds = [-2.0, 2.0]\nmethod = \"savitzky-golay\"\nwindow = 9\n";
    fs::write(path.join("robot.toml"), recipe).expect("a file");
    let said = fleetfoot(path, &["prepare", "-c", "robot.toml", "log.csv", "-o", "clean", "--json"]).ok().json();
    let episode = &said["episodes"][0];
    assert_eq!(episode["out_of_bounds"]["rows"], 21);
    assert_eq!(episode["too_short"]["rows"], 20);
    let rows: Vec<u64> =
        episode["pieces"].as_array().expect("pieces").iter().filter_map(|piece| piece["rows"].as_u64()).collect();
    assert_eq!(rows, [400, 559]);
    assert_eq!(said["files"], serde_json::json!(["clean/log.clean.parquet", "clean/log-2.clean.parquet"]));
    let info = fleetfoot(path, &["info", "clean/log-2.clean.parquet"]).ok().out;
    assert!(info.contains("x_dot") && info.contains("x_ddot") && !info.contains("deviation"), "{info}");
}

#[test]
fn what_cannot_be_prepared_is_told() {
    let folder = folder();
    let path = folder.path();
    let with = |more: &str, flags: &[&str]| {
        fs::write(path.join("robot.toml"), format!("{RECIPE}{more}")).expect("a file");
        fleetfoot(path, &[&PREPARE[..], flags].concat())
    };
    with("[channels.y]\nreject = 3.0\n", &[]).fails(&["[channels.y]", "neither a state nor an input"]);
    with("[channels.x]\nclip = 3.0\n", &[]).fails(&["clip", "[prepare]"]);
    with("", &["--method", "butterworth"]).fails(&["cutoff"]);
    with("", &["--method", "butterworth", "--cutoff", "80"]).fails(&["run_0.csv", "`x`", "half the rate"]);
    with("", &["--method", "cubic"]).fails(&["second_order", "quintic"]);
    with("", &["--lambda", "most"]).fails(&["lambda", "likelihood or gcv"]);
    with("", &["--clip", "20"]).fails(&["long enough"]);
    let rows = (0..200).map(|row| format!("{},,1\n", DT * f64::from(row)));
    fs::write(path.join("empty.csv"), format!("t,x [m],u\n{}", rows.collect::<String>())).expect("a file");
    let empty = fleetfoot(path, &["prepare", "-c", "robot.toml", "empty.csv", "-o", "clean"]);
    empty.fails(&["long enough", "empty.csv", "`x`"]);
    assert!(!path.join("clean/robot.toml").exists());
}
