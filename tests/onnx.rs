//! `import` and `export --to onnx`: networks of other programs as models, and models as networks of other runtimes.

use std::{fs, io::Write, process::Stdio};

use crate::{network::spring, outside, runner::*};

/// States, an input and one past row of each: the regressors of the networks below.
const RECIPE: &str = "[states]\nx = {}\nv = {}\n[inputs]\nu = {}\n[model]\npredict = \"next\"\nlags = 1\n";

/// A folder with two logs of a spring and the recipe.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in
        [("run.csv", spring(2500, 1, 12.0)), ("other.csv", spring(800, 900_000, 12.0)), ("r.toml", RECIPE.into())]
    {
        fs::write(folder.path().join(name), text).expect("a file");
    }
    folder
}

/// The values of a model's latents at rows of its functions.
fn values(model: &fleetfoot::Model, rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    rows.iter().map(|row| model.latents.iter().map(|latent| latent.map.value(0, row)).collect()).collect()
}

/// Outputs agree to 32-bit rounding of sums of ten terms, or for 64 bits to a thousand roundings.
#[track_caller]
fn agree(name: &str, actual: &[Vec<f64>], expected: &[Vec<f64>], double: bool) {
    assert!(actual.len() == expected.len() && !actual.is_empty(), "{name}");
    let room = if double { 1e-12 } else { 1e-6 };
    for (actual, expected) in actual.iter().flatten().zip(expected.iter().flatten()) {
        let error = (actual - expected).abs() / expected.abs().max(1.0);
        assert!(error < room, "{name}: {actual} {expected}");
    }
}

#[test]
fn models_survive_export_and_import() {
    let folder = folder();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let fit = ["fit", "network", "-c", "r.toml", "run.csv", "--effort", "low", "--hidden", "6,4", "-o", "net.json"];
    let fitted = run(&fit);
    assert!(fitted.out.contains("network 6-4"), "{}", fitted.out);
    run(&["export", "net.json", "--to", "onnx", "--prefix", "net", "-o", "."]);
    let import = ["import", "net.onnx", "-c", "r.toml", "--dt", "0.02", "-o", "again.json"];
    let report = run(&[&import[..], &["--json"]].concat()).json();
    assert_eq!(report["inputs"].as_array().map(Vec::len), Some(6), "{report}");
    assert!(report["hidden"] == "6-4 tanh" && report["outputs"][1] == "next(v)", "{report}");
    // The same errors, up to rounding of sums in another order; 50 steps multiply it.
    let score = |report: &serde_json::Value| report["targets"][1]["rmse"].as_f64();
    let simulated = |report: &serde_json::Value| report["model"]["summary"]["average"]["value"].as_f64();
    let close = |of: fn(&serde_json::Value) -> Option<f64>, command: &[&str], models: [&str; 2]| {
        let errors = models.map(|model| {
            let report = run(&[&command[..1], &[model, "other.csv", "--json"], &command[1..]].concat()).json();
            of(&report).unwrap_or_else(|| panic!("{report}"))
        });
        assert!((errors[0] - errors[1]).abs() < 1e-9 * errors[0], "{command:?} {models:?}: {errors:?}");
    };
    close(score, &["score"], ["net.json", "again.json"]);
    // With the logs that trained it, the import knows what the fit knew.
    run(&["import", "net.onnx", "run.csv", "-c", "r.toml", "-o", "known.json"]);
    close(score, &["score"], ["net.json", "known.json"]);
    close(simulated, &["rollout", "--horizon", "50"], ["net.json", "known.json"]);
    let region = |file: &str| {
        let model = fleetfoot::Model::read(&folder.path().join(file)).expect("a model");
        model.summaries[0].regions[0].clone()
    };
    let (fitted, known) = (region("net.json"), region("known.json"));
    assert_eq!((&fitted.range, fitted.rows), (&known.range, known.rows));
    let variance = |region: &fleetfoot::model::RegionSummary| region.residual_covariance[2];
    // The ridge of the fit leaves residuals a mean, whose square the second moment has.
    assert!((variance(&fitted) - variance(&known)).abs() < 1e-3 * variance(&fitted), "{fitted:?} {known:?}");
    let scored = run(&["score", "known.json", "run.csv"]);
    assert!(scored.err.contains("in-sample"), "{}", scored.err);
    let shown = run(&["show", "again.json"]).out;
    assert!(shown.contains("6-4 (tanh)"), "{shown}");
    run(&["report", "again.json", "other.csv", "-o", "page.html"]);
    run(&["export", "again.json", "--to", "c", "--prefix", "robot", "-o", "code"]);
    if Command::new("cc").arg("--version").output().is_err() {
        eprintln!("no `cc` on this machine: exported code is not compiled");
        return;
    }
    let cc = Command::new("cc")
        .current_dir(folder.path().join("code"))
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "robot.c", "robot_test.c", "-o", "robot", "-lm"])
        .output()
        .expect("cc");
    assert!(cc.status.success(), "{}", String::from_utf8_lossy(&cc.stderr));
    assert!(Command::new(folder.path().join("code/robot")).output().expect("the test").status.success());
}

#[test]
fn filters_use_residuals_of_the_logs() {
    let folder = folder();
    fs::write(folder.path().join("r.toml"), RECIPE.replace("lags = 1", "lags = 0")).expect("a recipe");
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    run(&["fit", "network", "-c", "r.toml", "run.csv", "--effort", "low", "--hidden", "8", "-o", "net.json"]);
    run(&["export", "net.json", "--to", "onnx", "--prefix", "net", "-o", "."]);
    run(&["import", "net.onnx", "run.csv", "-c", "r.toml", "-o", "known.json"]);
    let filtered = |model: &str| run(&["filter", model, "other.csv", "--measured", "x=0.001", "--json"]).json();
    let [fitted, known] =
        ["net.json", "known.json"].map(|model| filtered(model)["log_likelihood"].as_f64().expect("a number"));
    // The second moment of residuals has the square of their mean, too.
    assert!((fitted - known).abs() < 0.1 * fitted.abs(), "{fitted} {known}");
    run(&["import", "net.onnx", "-c", "r.toml", "--dt", "0.02", "-o", "unseen.json"]);
    let filter = ["filter", "unseen.json", "other.csv", "--measured", "x=0.001"];
    fleetfoot(folder.path(), &filter).fails(&["no residuals"]);
}

#[test]
fn unsuitable_networks_are_refused() {
    let folder = folder();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    run(&["fit", "pwa", "-c", "r.toml", "run.csv", "-p", "average", "-o", "line.json"]);
    run(&["export", "line.json", "--to", "onnx", "--precision", "float", "--prefix", "line", "-o", "."]);
    let refused = |network: &str, recipe: &str, flags: &[&str], words: &[&str]| {
        fs::write(folder.path().join("other.toml"), recipe).expect("a recipe");
        let import = ["import", network, "-c", "other.toml", "-o", "new.json"];
        fleetfoot(folder.path(), &[&import[..], flags].concat()).fails(words);
        assert!(!folder.path().join("new.json").exists());
    };
    let step = ["--dt", "0.02"];
    refused("line.onnx", RECIPE, &[], &["the time between rows is unknown", "--dt"]);
    refused("line.onnx", RECIPE, &["run.csv", "--dt", "0.02"], &["--dt 0.02", "the logs give the time"]);
    refused("line.onnx", RECIPE, &["--dt=-1"], &["--dt -1", "positive"]);
    refused("line.onnx", &RECIPE.replace("lags = 1", ""), &step, &["line.onnx", "6 inputs", "recipe has 3: x, v, u"]);
    refused("line.onnx", &RECIPE.replace("v = {}", "v = { known = \"u\" }"), &step, &["2 outputs", "recipe has 1"]);
    refused("line.onnx", &format!("[columns]\nw = \"/joints[*]\"\n{RECIPE}"), &step, &["[columns] w", "without logs"]);
    refused("line.onnx", &format!("[library]\nradial = 3\n{RECIPE}"), &step, &["radial"]);
    refused("run.csv", RECIPE, &step, &["run.csv", "no ONNX file"]);
    refused("none.onnx", RECIPE, &step, &["none.onnx", "cannot be read"]);
    let bytes = fs::read(folder.path().join("line.onnx")).expect("a network");
    fs::write(folder.path().join("half.onnx"), &bytes[..bytes.len() / 2]).expect("a file");
    refused("half.onnx", RECIPE, &step, &["half.onnx"]);
    // What is no network is not written as one.
    run(&["fit", "pwa", "-c", "r.toml", "run.csv", "-p", "kmeans:2", "-o", "two.json"]);
    fleetfoot(folder.path(), &["export", "two.json", "--to", "onnx", "-o", "none"]).fails(&["kmeans:2", "as C"]);
    assert!(!folder.path().join("none/model.onnx").exists());
    // The affine model is the same; its errors on a log, too.
    run(&[&["import", "line.onnx", "-c", "r.toml", "-o", "again.json"][..], &step].concat());
    let error = |model: &str| run(&["score", model, "other.csv", "--json"]).json()["targets"][0]["rmse"].as_f64();
    let (line, again) = (error("line.json").expect("an error"), error("again.json").expect("an error"));
    // 32-bit coefficients change errors of 1e-4 by less than the values' rounding, 1e-7.
    assert!((line - again).abs() < 1e-3 * line, "{line} {again}");
}

fn script() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/peers/onnx_networks.py")
}

/// Outputs of a network for rows, computed by the script's `command`.
fn outputs(python: &std::ffi::OsStr, command: &str, network: &Path, rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut child = Command::new(python)
        .arg(script())
        .arg(command)
        .arg(network)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("Python runs");
    let text = serde_json::to_string(rows).expect("JSON");
    child.stdin.take().expect("a pipe").write_all(text.as_bytes()).expect("rows");
    let output = child.wait_with_output().expect("outputs");
    assert!(output.status.success(), "{}", network.display());
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Rows of numbers in [-1, 1) that 32 bits hold.
fn uniform_rows(count: u64, width: u64) -> Vec<Vec<f64>> {
    let number = |key: u64| (fleetfoot::data::mix(key) >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
    (0..count).map(|row| (0..width).map(|at| f64::from(number(width * row + at) as f32)).collect()).collect()
}

#[test]
fn exported_networks_run_in_onnxruntime() {
    let Some(python) = outside::python("onnx, onnxruntime, numpy") else { return };
    let folder = folder();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let rows = uniform_rows(200, 6);
    for activation in ["tanh", "relu", "softplus"] {
        let model = format!("{activation}.json");
        let fit = ["fit", "network", "-c", "r.toml", "run.csv", "--effort", "low", "--hidden", "6", "--activation"];
        run(&[&fit[..], &[activation, "-o", &model]].concat());
        let read = fleetfoot::Model::read(&folder.path().join(&model)).expect("a model");
        assert!(read.latents[0].map.basis().is_some(), "{activation}: no network was written");
        for precision in ["float", "double"] {
            // This runtime has no Softplus of 64 bits.
            if (activation, precision) == ("softplus", "double") {
                continue;
            }
            run(&["export", &model, "--to", "onnx", "--precision", precision, "--prefix", activation, "-o", "."]);
            let actual = outputs(&python, "run", &folder.path().join(format!("{activation}.onnx")), &rows);
            agree(&format!("{activation} {precision}"), &actual, &values(&read, &rows), precision == "double");
        }
    }
}

#[test]
fn exported_cells_run_in_onnxruntime() {
    let Some(python) = outside::python("onnx, onnxruntime, numpy") else { return };
    let folder = folder();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let rows = uniform_rows(100, 9);
    for cell in ["rnn", "gru", "lstm"] {
        let model = format!("{cell}.json");
        let fit = ["fit", "network", "-c", "r.toml", "run.csv", "--lags", "2", "--effort", "low", "--hidden", "6"];
        run(&[&fit[..], &["--folds", "2", "--cell", cell, "-o", &model]].concat());
        let read = fleetfoot::Model::read(&folder.path().join(&model)).expect("a model");
        assert!(read.latents[0].map.basis().is_some(), "{cell}: no network was written");
        let expected = values(&read, &rows);
        let network = folder.path().join(format!("{cell}.onnx"));
        let written = |precision: &str| {
            run(&["export", &model, "--to", "onnx", "--precision", precision, "--prefix", cell, "-o", "."]);
        };
        written("float");
        agree(cell, &outputs(&python, "run", &network, &rows), &expected, false);
        // The runtime has no cells of 64 bits; the reference of the format computes them.
        written("double");
        agree(cell, &outputs(&python, "reference", &network, &rows), &expected, true);
    }
}

#[test]
fn networks_of_other_programs_are_models() {
    let Some(python) = outside::python("onnx, onnxruntime, numpy") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let status = Command::new(python).arg(script()).arg("write").arg(folder.path()).status().expect("Python runs");
    assert!(status.success(), "the networks are written");
    // A command and an expression beside states and an input.
    let recipe = "[columns]\npower = \"u*v\"\n[states]\nx = {}\nv = {}\n[inputs]\nu = {}\npower = {}\n";
    fs::write(folder.path().join("r.toml"), recipe).expect("a recipe");
    let mut count = 0;
    for entry in fs::read_dir(folder.path()).expect("files") {
        let path = entry.expect("a file").path();
        if path.extension().is_none_or(|ending| ending != "onnx") {
            continue;
        }
        let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
        let model = format!("{name}.model.json");
        let import = ["import", &format!("{name}.onnx"), "-c", "r.toml", "--dt", "0.01", "-o", &model];
        fleetfoot(folder.path(), &import).ok();
        let model = fleetfoot::Model::read(&folder.path().join(model)).expect("a model");
        let text = fs::read_to_string(path.with_extension("json")).expect("rows");
        let oracle: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let matrix = |what: &str| serde_json::from_value::<Vec<Vec<f64>>>(oracle[what].clone()).expect("numbers");
        agree(&name, &values(&model, &matrix("rows")), &matrix("outputs"), name.ends_with("float64"));
        count += 1;
    }
    assert_eq!(count, 21, "three styles, four activations, two precisions but for Softplus");
}

#[test]
fn cells_of_other_programs_are_models() {
    let Some(python) = outside::python("onnx, onnxruntime, numpy") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let status = Command::new(python).arg(script()).arg("cells").arg(folder.path()).status().expect("Python runs");
    assert!(status.success(), "the cells are written");
    let recipe = "[states]\nx = {}\nv = {}\n[model]\npredict = \"next\"\nlags = 2\n";
    fs::write(folder.path().join("r.toml"), recipe).expect("a recipe");
    for cell in ["rnn", "gru", "lstm"] {
        let (network, model) = (format!("{cell}.onnx"), format!("{cell}.model.json"));
        let import = ["import", &network, "-c", "r.toml", "--dt", "0.01", "-o", &model, "--json"];
        let report = fleetfoot(folder.path(), &import).ok().json();
        assert_eq!(report["hidden"], format!("{cell} 5"), "{report}");
        let model = fleetfoot::Model::read(&folder.path().join(model)).expect("a model");
        let text = fs::read_to_string(folder.path().join(format!("{cell}.json"))).expect("rows");
        let oracle: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let matrix = |what: &str| serde_json::from_value::<Vec<Vec<f64>>>(oracle[what].clone()).expect("numbers");
        agree(cell, &values(&model, &matrix("rows")), &matrix("outputs"), false);
    }
}
