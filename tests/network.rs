//! `fit network`: a network where it predicts held-out rows better, the linear model where it does not, from the log to the code.

use std::fs;

use crate::runner::*;

/// Uniform in [-1, 1).
fn draw(key: u64) -> f64 {
    2.0 * (fleetfoot::data::mix(key) >> 11) as f64 / 9_007_199_254_740_992.0 - 1.0
}

/// A cart on a spring that hardens, pushed at random; `cubic` is how much it hardens. Measured with a little noise.
pub(crate) fn spring(rows: usize, seed: u64, cubic: f64) -> String {
    let (mut text, mut x, mut v, mut u) = (String::from("t,x,v,u\n"), 0.3, 0.0, 0.0);
    for k in 0..rows {
        if k % 25 == 0 {
            u = 6.0 * draw(seed + k as u64);
        }
        let noise = |key: u64| 1e-4 * draw(key + seed + 10 * k as u64);
        text.push_str(&format!("{:.2},{:?},{:?},{u:?}\n", 0.02 * k as f64, x + noise(7), v + noise(8)));
        for _ in 0..20 {
            (x, v) = (x + 1e-3 * v, v + 1e-3 * (u - 4.0 * x - cubic * x * x * x - 0.5 * v));
        }
    }
    text
}

fn folder(files: &[(&str, String)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    files.iter().for_each(|(name, text)| fs::write(folder.path().join(name), text).expect("a log"));
    folder
}

const FIT: [&str; 7] = ["fit", "network", "run.csv", "--states", "x,v", "--inputs", "u"];

fn model(folder: &Path, file: &str) -> serde_json::Value {
    let text = fs::read_to_string(folder.join(file)).expect("a model");
    serde_json::from_str::<serde_json::Value>(&text).expect("JSON")["model"].clone()
}

#[test]
fn networks_simulate_nonlinear_logs_better() {
    let folder = folder(&[("run.csv", spring(2500, 1, 12.0)), ("other.csv", spring(800, 900_000, 12.0))]);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let low = ["--predict", "next", "--effort", "low"];
    let report = run(&[&FIT[..], &low, &["--json", "-o", "net.json"]].concat()).json();
    let candidates = report["candidates"].as_array().expect("candidates");
    let chosen = &candidates[report["chosen"].as_u64().expect("an index") as usize];
    assert!(chosen["name"].as_str().is_some_and(|name| name.starts_with("network")), "{report}");
    assert!(chosen["loss"].as_f64() < candidates[0]["loss"].as_f64().map(|loss| 0.3 * loss), "{report}");
    // An unseen log has no larger errors than those that are printed as held out.
    let held_out: Vec<f64> =
        report["held_out"].as_array().expect("errors").iter().map(|error| error["rmse"].as_f64().unwrap()).collect();
    let scored = run(&["score", "net.json", "other.csv", "--json"]).json();
    for (target, held_out) in scored["targets"].as_array().expect("targets").iter().zip(&held_out) {
        let rmse = target["rmse"].as_f64().unwrap_or_else(|| panic!("{scored}"));
        assert!(rmse < 1.5 * held_out, "held-out errors flatter: {rmse} {held_out}");
    }
    run(&[
        "fit",
        "pwa",
        "run.csv",
        "--states",
        "x,v",
        "--inputs",
        "u",
        "--predict",
        "next",
        "-p",
        "average",
        "-o",
        "line.json",
    ]);
    let simulated = |model: &str| {
        let report = run(&["rollout", model, "other.csv", "--horizon", "100", "--json"]).json();
        report["model"]["summary"]["average"]["value"].as_f64().expect("an error")
    };
    let (line, network) = (simulated("line.json"), simulated("net.json"));
    assert!(network < 0.3 * line, "{network} {line}");
    let shown = run(&["show", "net.json"]).out;
    assert!(shown.contains("1*network_f_x") && shown.contains("the last of the hidden layers"), "{shown}");
    for to in ["c", "rust", "python", "latex", "npz"] {
        run(&["export", "net.json", "--to", to, "--prefix", "robot", "-o", "code"]);
    }
    run(&["report", "net.json", "run.csv", "-o", "page.html"]);
    let page = fs::read_to_string(folder.path().join("page.html")).expect("a page");
    assert!(page.contains("stand beside a network"), "intervals of linear terms are told");
    let code = folder.path().join("code");
    let source = fs::read_to_string(code.join("robot.c")).expect("C");
    assert!(source.contains("Weights of a hidden layer") && source.matches("tanh(").count() <= 4, "{source}");
    if Command::new("cc").arg("--version").output().is_err() {
        eprintln!("no `cc` on this machine: exported code is not compiled");
        return;
    }
    let cc = Command::new("cc")
        .current_dir(&code)
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "robot.c", "robot_test.c", "-o", "robot", "-lm"])
        .output()
        .expect("cc");
    assert!(cc.status.success(), "{}", String::from_utf8_lossy(&cc.stderr));
    assert!(Command::new(code.join("robot")).output().expect("the test").status.success());
}

/// The columns `t,x,u` of a spring: the velocity is not measured.
fn without_velocity(text: &str) -> String {
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        format!("{},{},{}\n", cells[0], cells[1], cells[3])
    };
    text.lines().map(row).collect()
}

#[test]
fn simulations_may_need_past_rows() {
    let folder = folder(&[
        ("run.csv", spring(2500, 1, 12.0)),
        ("x.csv", without_velocity(&spring(2500, 1, 12.0))),
        ("other.csv", without_velocity(&spring(800, 900_000, 12.0))),
    ]);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    // The velocity follows from rows before only.
    let hidden = ["fit", "network", "x.csv", "--states", "x", "--inputs", "u", "--effort", "low", "--json", "-o"];
    let report = run(&[&hidden[..], &["x.json"]].concat()).json();
    assert!(report["lags"]["chosen"] == true && report["lags"]["states"].as_u64() > Some(1), "{report}");
    assert!(model(folder.path(), "x.json")["libraries"][0].as_array().is_some_and(|functions| functions.len() > 3));
    run(&[&hidden[..], &["none.json", "--lags", "0"]].concat());
    let error = |file: &str| {
        let report = run(&["rollout", file, "other.csv", "--horizon", "50", "--json"]).json();
        report["model"]["summary"]["average"]["value"].as_f64().expect("an error")
    };
    assert!(error("x.json") < 0.2 * error("none.json"), "{} {}", error("x.json"), error("none.json"));
    // Both states are measured: one-step errors like past rows. What is written simulates an unseen log as well as the folds' networks did theirs.
    fs::write(folder.path().join("fresh.csv"), spring(800, 900_000, 12.0)).expect("a log");
    let report = run(&[&FIT[..], &["--effort", "low", "--json", "-o", "full.json"]].concat()).json();
    let lags = &report["lags"];
    if let (Some(written), Some(held)) = (lags["written"].as_f64(), lags["with"].as_array()) {
        let worst = held.iter().filter_map(serde_json::Value::as_f64).fold(0.0, f64::max);
        assert!(written < 2.0 * worst, "{lags}");
    }
    let report = run(&["rollout", "full.json", "fresh.csv", "--horizon", "50", "--json"]).json();
    let average = report["model"]["summary"]["average"]["value"].as_f64();
    assert!(average < Some(0.05), "{average:?}");
}

#[test]
fn known_kinematics_stand_beside_a_network() {
    let recipe = "[states]\nx = { known = \"v\" }\nv = {}\n[inputs]\nu = {}\n[network]\neffort = \"low\"\n";
    let folder = folder(&[
        ("run.csv", spring(2500, 1, 12.0)),
        ("other.csv", spring(800, 900_000, 12.0)),
        ("r.toml", recipe.to_owned()),
    ]);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let report = run(&["fit", "network", "-c", "r.toml", "run.csv", "--json", "-o", "net.json"]).json();
    assert_eq!(report["targets"].as_array().map(Vec::len), Some(1), "{report}");
    let network = model(folder.path(), "net.json");
    assert!(network["method"].as_str().is_some_and(|method| method.starts_with("network ")), "{}", network["method"]);
    let report = run(&["rollout", "net.json", "other.csv", "--horizon", "50", "--json"]).json();
    let errors = &report["model"]["summary"];
    assert!(errors["average"]["value"].as_f64() < Some(0.15), "{errors}");
    run(&["export", "net.json", "--to", "c", "-o", "code"]);
    // A step of both: the kinematics are integrated, the network gives the next row.
    run(&["fit", "network", "-c", "r.toml", "run.csv", "--predict", "delta", "-o", "delta.json"]);
    let report = run(&["rollout", "delta.json", "other.csv", "--horizon", "50", "--json"]).json();
    let errors = &report["model"]["summary"];
    assert!(errors["average"]["value"].as_f64() < Some(0.15), "{errors}");
}

#[test]
fn linear_logs_get_the_linear_model() {
    let folder = folder(&[("run.csv", spring(1500, 3, 0.0))]);
    let options = ["--predict", "next", "--lags", "0", "--effort", "low", "-o", "net.json"];
    let output = fleetfoot(folder.path(), &[&FIT[..], &options].concat()).ok();
    assert!(output.err.contains("no network predicts held-out rows better than the linear model"), "{}", output.err);
    assert!(
        output.out.contains("linear") && output.out.contains("<- chosen") && output.out.contains("persistence"),
        "{}",
        output.out
    );
    let fitted = model(folder.path(), "net.json");
    assert!(fitted["method"] == "network linear" && fitted["latents"][0].get("network").is_none());
    let pwa = [
        "fit",
        "pwa",
        "run.csv",
        "--states",
        "x,v",
        "--inputs",
        "u",
        "--predict",
        "next",
        "-p",
        "average",
        "-o",
        "line.json",
    ];
    fleetfoot(folder.path(), &pwa).ok();
    assert_eq!(fitted["latents"], model(folder.path(), "line.json")["latents"]);
}

#[test]
fn threads_change_no_byte_of_networks() {
    let folder = folder(&[("run.csv", spring(1200, 5, 12.0))]);
    let mut files = Vec::new();
    for threads in ["1", "2"] {
        let file = format!("net{threads}.json");
        let options = ["--hidden", "6,4", "--activation", "softplus", "--lags", "1", "--effort", "low", "--seed", "3"];
        let rest = ["--predict", "derivative", "--threads", threads, "-o", &file];
        let output = fleetfoot(folder.path(), &[&FIT[..], &options, &rest].concat()).ok();
        assert!(output.out.contains("network 6-4"), "{}", output.out);
        files.push(fs::read(folder.path().join(&file)).expect("a model"));
    }
    assert!(files[0] == files[1], "the bytes of a model depend on threads");
    let saved = model(folder.path(), "net1.json");
    assert_eq!(saved["method"], "network 6-4 softplus");
    // Hidden layers stand once.
    let networks: Vec<_> =
        saved["latents"].as_array().expect("latents").iter().map(|latent| latent["network"].clone()).collect();
    assert!(networks[0]["hidden"]["layers"].as_array().is_some_and(|layers| layers.len() == 2), "{networks:?}");
    assert!(networks[1].get("hidden").is_none() && networks[1]["of"] == 0, "{networks:?}");
    fleetfoot(folder.path(), &["rollout", "net1.json", "run.csv", "--horizon", "20"]).ok();
}

#[test]
fn impossible_networks_are_refused() {
    let folder = folder(&[("run.csv", spring(40, 1, 12.0)), ("one.csv", "t,x,v,u\n0,1,2,3\n".into())]);
    let fails = |options: &[&str], words: &[&str]| {
        fleetfoot(folder.path(), &[&FIT[..], options].concat()).fails(words);
        assert!(!folder.path().join("model.json").exists());
    };
    for (hidden, words) in [("0", "1 to 1024 units"), ("8,x", "write the units of every hidden layer with commas")] {
        let output = fleetfoot(folder.path(), &[&FIT[..], &["--hidden", hidden]].concat());
        assert!(output.code == 2 && output.err.contains(words), "{}", output.err);
        fs::write(folder.path().join("r.toml"), format!("[network]\nhidden = \"{hidden}\"\n")).expect("a recipe");
        fails(&["-c", "r.toml"], &[words]);
    }
    fails(&["--hidden", "64"], &["network 64", "too few", "three rows a weight"]);
    fails(&["--radial", "5"], &["`fit network` has no radial functions"]);
    let single_row = ["fit", "network", "one.csv", "--states", "x,v", "--inputs", "u", "--predict", "next"];
    fleetfoot(folder.path(), &single_row).fails(&["row"]);
    fleetfoot(folder.path(), &["scan", "run.csv", "--states", "x,v", "-o", "run.stats"]).ok();
    fleetfoot(folder.path(), &["fit", "network", "run.stats"]).fails(&["trains on rows, and a statistic has none"]);
    // Sizes that rows do not suffice for are not compared.
    let output = fleetfoot(folder.path(), &[&FIT[..], &["-o", "few.json"]].concat()).ok();
    assert!(output.err.contains("no network was compared: the linear model is written"), "{}", output.err);
    // A constant column and rows with a missing value are no obstacle.
    let text: String = (spring(600, 2, 12.0).lines().enumerate())
        .map(|(at, line)| match at {
            0 => format!("{line},c\n"),
            50 => format!("{},,0.1,0.2,1\n", line.split(',').next().unwrap()),
            _ => format!("{line},1\n"),
        })
        .collect();
    fs::write(folder.path().join("gap.csv"), text).expect("a log");
    let gap =
        ["fit", "network", "gap.csv", "--states", "x,v", "--inputs", "u,c", "--predict", "next", "--effort", "low"];
    let output = fleetfoot(folder.path(), &[&gap[..], &["-o", "gap.json"]].concat()).ok();
    assert!(output.out.contains("incomplete"), "{}", output.out);
}

#[test]
fn cells_simulate_hidden_states() {
    let folder = folder(&[
        ("x.csv", without_velocity(&spring(1600, 1, 12.0))),
        ("other.csv", without_velocity(&spring(600, 900_000, 12.0))),
    ]);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let fit = ["fit", "network", "x.csv", "--states", "x", "--inputs", "u", "--effort", "low", "--lags", "2"];
    let mut files = Vec::new();
    for threads in ["1", "2"] {
        let file = format!("gru{threads}.json");
        let cell = ["--cell", "gru", "--hidden", "8", "--threads", threads, "--json", "-o", &file];
        let report = run(&[&fit[..], &cell].concat()).json();
        assert_eq!(report["candidates"][1]["name"], "gru 8", "{report}");
        // Weights of a column and of eight units, for three gates, and their biases; the output layer.
        assert_eq!(report["candidates"][1]["numbers"], 3 * 8 * (2 + 8 + 1) + 8 + (1 + 6 + 8), "{report}");
        assert!(report["candidates"][1]["loss"].as_f64() < report["candidates"][0]["loss"].as_f64(), "{report}");
        files.push(fs::read(folder.path().join(&file)).expect("a model"));
    }
    assert!(files[0] == files[1], "the bytes of a cell depend on threads");
    let saved = model(folder.path(), "gru1.json");
    assert_eq!(saved["method"], "network gru 8");
    // States, then inputs, row by row: the cell reads the oldest first.
    assert_eq!(saved["latents"][0]["network"]["cell"]["steps"], serde_json::json!([[4, 5], [2, 3], [0, 1]]));
    run(&[
        "fit",
        "pwa",
        "x.csv",
        "--states",
        "x",
        "--inputs",
        "u",
        "--lags",
        "2",
        "--predict",
        "delta",
        "-p",
        "average",
        "-o",
        "line.json",
    ]);
    let error = |file: &str| {
        let report = run(&["rollout", file, "other.csv", "--horizon", "50", "--json"]).json();
        report["model"]["summary"]["average"]["value"].as_f64().expect("an error")
    };
    let (line, gru) = (error("line.json"), error("gru1.json"));
    assert!(gru < line, "{gru} {line}");
    let shown = run(&["show", "gru1.json"]).out;
    assert!(shown.contains("recurrent cell (gru) over 3 rows"), "{shown}");
    run(&["report", "gru1.json", "other.csv", "-o", "page.html"]);
    run(&["export", "gru1.json", "--to", "npz", "-o", "code"]);
    run(&["export", "gru1.json", "--to", "latex", "-o", "code"]);
}

#[test]
fn impossible_cells_are_refused() {
    let folder = folder(&[("run.csv", spring(300, 1, 12.0))]);
    let cell = |options: &[&str], words: &[&str]| {
        fleetfoot(folder.path(), &[&FIT[..], &["--cell", "gru"], options].concat()).fails(words);
        assert!(!folder.path().join("model.json").exists());
    };
    cell(&["--lags", "0"], &["--cell: a recurrent cell reads past rows", "give --lags 10"]);
    cell(&["--predict", "derivative"], &["--cell: a recurrent cell reads past rows", "give --lags 10"]);
    cell(&["--lags", "2", "--activation", "relu"], &["--cell gru", "remove --activation"]);
    cell(&["--lags", "2", "--hidden", "8,4"], &["--hidden 8,4: --cell gru is one layer", "--hidden 8"]);
    let unknown = fleetfoot(folder.path(), &[&FIT[..], &["--cell", "mgu"]].concat());
    assert!(unknown.code == 2 && unknown.err.contains("none, rnn, gru, lstm"), "{}", unknown.err);
    fs::write(folder.path().join("r.toml"), "[network]\ncell = \"mgu\"\n").expect("a recipe");
    fleetfoot(folder.path(), &[&FIT[..], &["-c", "r.toml"]].concat()).fails(&["r.toml", "mgu", "lstm"]);
    fleetfoot(folder.path(), &["scan", "run.csv", "--states", "x,v", "--lags", "2", "-o", "run.stats"]).ok();
    let statistic = ["fit", "network", "run.stats", "--cell", "gru", "--lags", "2"];
    fleetfoot(folder.path(), &statistic).fails(&["trains on rows, and a statistic has none"]);
}
