//! `fleetfoot auto`: from a log to a model, its recipe and its page.

use std::{fmt::Write as _, fs, path::Path};

use crate::runner::*;

/// A cart on a spring that hardens, pushed by a held force: t, x, v, u; rows of 20 ms.
fn cart(rows: usize, jitter: f64) -> String {
    let (mut x, mut v, mut u, mut seed) = (0.3f64, 0.0f64, 0.0f64, 7u64);
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let mut text = String::from("t,x,v,u\n");
    for row in 0..rows {
        if row % 15 == 0 {
            u = 4.0 * random();
        }
        let t = 0.02 * row as f64 + jitter * random();
        let _ = writeln!(text, "{t:.6},{:.6},{:.6},{u:.6}", x + 0.002 * random(), v + 0.002 * random());
        for _ in 0..4 {
            let pull = 2.0 * u - 1.5 * v - 3.0 * x.sin();
            x += 0.005 * v;
            v += 0.005 * pull;
        }
    }
    text
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn logs_give_models_pages_and_recipes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("cart.csv"), cart(1200, 0.0)).unwrap();
    let shown = fleetfoot(path, &["auto", "cart.csv", "--effort", "low", "-o", "model", "--export", "c"]).ok();
    assert!(shown.out.contains("<- chosen") && shown.out.contains("Record next"), "{}", shown.out);
    assert!(shown.err.contains("inputs: `u`"), "{}", shown.err);
    for file in ["model.json", "recipe.toml", "report.html", "auto.json", "c/model.c"] {
        assert!(path.join("model").join(file).is_file(), "{file}");
    }
    let report = json(&path.join("model/auto.json"));
    assert_eq!(report["sentences"].as_array().unwrap().len(), 5);
    assert!(report["warning"].is_null(), "{report}");
    for state in report["tested"].as_array().unwrap() {
        let number = |key: &str| state[key].as_f64().unwrap();
        let [rmse, low, high] = [0, 1, 2].map(|at| state["rmse"][at].as_f64().unwrap());
        assert!(rmse < 0.2 * number("persistence") && rmse < 0.2 * number("mean"), "{state}");
        assert!(0.0 < low && low < rmse && rmse < high, "{state}");
    }
    // A folder that is there is refused, and the recipe gives the same bytes on one thread.
    fleetfoot(path, &["auto", "cart.csv", "-o", "model"]).fails(&["--force"]);
    fleetfoot(path, &["auto", "-c", "model/recipe.toml", "cart.csv", "-o", "again", "--threads", "1", "--export", "c"])
        .ok();
    for file in ["model.json", "recipe.toml", "report.html", "auto.json", "c/model.c"] {
        let [first, second] = ["model", "again"].map(|folder| fs::read(path.join(folder).join(file)).unwrap());
        assert!(first == second, "{file}");
    }
    // The printed error of the test is that of the model that is written.
    let steps = report["horizon"]["steps"].as_u64().unwrap().to_string();
    let rolled = fleetfoot(
        path,
        &[
            "rollout",
            "model/model.json",
            "cart.csv",
            "--where",
            "time() > 19.2",
            "--horizon",
            &steps,
            "--starts",
            "200",
            "--method",
            "rk4",
            "--json",
        ],
    )
    .ok()
    .json();
    let rmse = rolled["model"]["rmse"].as_array().expect("errors by step");
    let last = |state: usize| {
        rmse.iter().filter_map(|step| step[state].as_f64()).fold((0.0, 0.0), |(s, n), e| (s + e * e, n + 1.0))
    };
    let (sum, count) = last(0);
    let printed = report["tested"][0]["rmse"][0].as_f64().unwrap();
    assert!(((sum / count).sqrt() / printed - 1.0f64).abs() < 0.3, "{} {printed}", (sum / count).sqrt());
}

#[test]
fn jittering_stamps_are_resampled_and_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("cart.csv"), cart(1000, 0.015)).unwrap();
    let shown = fleetfoot(path, &["auto", "cart.csv", "--effort", "low", "--json"]).ok();
    let report = shown.json();
    assert!(report["findings"].as_array().unwrap().iter().any(|finding| finding["fault"] == "jitter"), "{report}");
    let recipe = fs::read_to_string(path.join("model/recipe.toml")).unwrap();
    assert!(recipe.contains("rate = 50"), "{recipe}");
    assert!(report["tested"][0]["rmse"][0].as_f64() < report["tested"][0]["persistence"].as_f64());
    // These rows are even, and their stamps are not.
    assert!(report["chosen"].as_str().unwrap().starts_with("rows as they come"), "{}", report["chosen"]);
}

#[test]
fn noise_logs_claim_no_model() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut text = String::from("t,a,b\n");
    let mut seed = 3u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    for row in 0..600 {
        let _ = writeln!(text, "{:.2},{:.6},{:.6}", 0.01 * f64::from(row), random(), random());
    }
    fs::write(path.join("noise.csv"), text).unwrap();
    let shown = fleetfoot(path, &["auto", "noise.csv", "--effort", "low"]).ok();
    assert!(shown.out.starts_with("WARNING: no model has a held-out error below that of the mean"), "{}", shown.out);
    assert!(shown.err.contains("no column looks like an input"), "{}", shown.err);
    // A log of one column of text has no state.
    fs::write(path.join("text.csv"), "t,a\n0.0,x\n0.1,y\n0.2,x\n").unwrap();
    fleetfoot(path, &["auto", "text.csv", "--dt", "0.1", "-o", "other"]).fails(&["--states"]);
    assert!(!path.join("other").exists());
}

#[cfg(unix)]
#[test]
fn a_stop_writes_the_best_so_far() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("cart.csv"), cart(3000, 0.0)).unwrap();
    let mut running = Running::start(path, &["auto", "cart.csv", "--effort", "high", "-o", "model"]);
    std::thread::sleep(std::time::Duration::from_secs(3));
    assert!(!running.has_ended());
    running.signal("INT");
    let output = running.end(std::time::Duration::from_secs(60));
    assert_eq!(output.code, 130, "{}{}", output.out, output.err);
    // On a machine that is busy no candidate may be done yet, and nothing is written then.
    if !path.join("model").exists() {
        assert!(output.err.contains("nothing was written"), "{}", output.err);
        return;
    }
    assert!(output.err.contains("stopped after"), "{}{}", output.out, output.err);
    assert_eq!(json(&path.join("model/auto.json"))["stopped"], true);
}

/// Stamps of whole numbers, ten apart: their size alone says that they are milliseconds.
#[test]
fn inferred_units_are_printed_and_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let (mut x, mut u, mut text) = (20.0f64, 0.0f64, String::from("t,temp,heater\n"));
    for row in 0..600 {
        if row % 25 == 0 {
            u = 1.0 + (1.7 * f64::from(row)).sin();
        }
        let _ = writeln!(text, "{},{x:.9},{u:.6}", 10 * row);
        x += 0.02 * (20.0 + 25.0 * u - x);
    }
    fs::write(path.join("log.csv"), text).unwrap();
    let shown = fleetfoot(path, &["auto", "log.csv", "--effort", "low"]).ok();
    assert_eq!(shown.err.matches("note: the numbers of `t` are taken as ms").count(), 1, "{}", shown.err);
    let recipe = fs::read_to_string(path.join("model/recipe.toml")).unwrap();
    assert!(recipe.contains("column = \"t\"") && recipe.contains("unit = \"ms\""), "{recipe}");
    let shown = fleetfoot(path, &["auto", "-c", "model/recipe.toml", "log.csv", "-o", "again"]).ok();
    assert!(!shown.err.contains("are taken as"), "{}", shown.err);
    for file in ["model.json", "recipe.toml", "report.html", "auto.json"] {
        let [first, second] = ["model", "again"].map(|folder| fs::read(path.join(folder).join(file)).unwrap());
        assert!(first == second, "{file}");
    }
}

#[test]
fn short_logs_are_told_their_horizon() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("few.csv"), cart(40, 0.0)).unwrap();
    let failed = fleetfoot(path, &["auto", "few.csv", "--effort", "low"]).fails(&["too few", "--horizon "]);
    let steps: String = failed.split("--horizon ").nth(1).unwrap().chars().take_while(char::is_ascii_digit).collect();
    fleetfoot(path, &["auto", "few.csv", "--effort", "low", "--horizon", &steps]).ok();
}
