//! Commands that go to their end: without the target's column, without a clock, with several outputs, with no free
//! parameter, with inputs that act at once.

use std::fs;

use crate::runner::*;

fn folder(files: &[(&str, String)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    files.iter().for_each(|(name, text)| fs::write(folder.path().join(name), text).expect("a file"));
    folder
}

/// A table's text without one of its columns.
fn without(text: &str, column: &str) -> String {
    let place = text.lines().next().and_then(|head| head.split(',').position(|name| name == column)).expect("a column");
    let line = |line: &str| {
        let cells: Vec<&str> = line.split(',').enumerate().filter(|(i, _)| *i != place).map(|(_, cell)| cell).collect();
        cells.join(",") + "\n"
    };
    text.lines().map(line).collect()
}

/// A column of a CSV file, empty cells as `None`.
fn column(text: &str, name: &str) -> Vec<Option<f64>> {
    let mut lines = text.lines();
    let place = lines.next().and_then(|head| head.split(',').position(|field| field == name));
    let place = place.unwrap_or_else(|| panic!("no column `{name}` in {text:.200}"));
    lines
        .map(|line| line.split(',').nth(place).filter(|cell| !cell.is_empty()).map(|cell| cell.parse().unwrap()))
        .collect()
}

/// Rows of `a, b, x, y, z` in an arbitrary order: x = 1 + 2 a - b, y = 3 b, z = a b; no column is a clock.
fn unordered(rows: usize) -> String {
    let mut text = String::from("a,b,x,y,z\n");
    for row in 0..rows {
        let draw = |key: u64| {
            fleetfoot::data::mix(fleetfoot::data::mix(key).wrapping_add(row as u64)) as f64 / u64::MAX as f64
        };
        let (a, b) = (2.0 * draw(1) - 1.0, 4.0 * draw(2));
        text.push_str(&format!("{a},{b},{},{},{}\n", 1.0 + 2.0 * a - b, 3.0 * b, a * b));
    }
    text
}

#[test]
fn logs_without_the_target_are_simulated() {
    let log = robot_csv(1000, 3.0);
    let folder =
        folder(&[("train.csv", robot_csv(3000, 1.0)), ("all.csv", log.clone()), ("new.csv", without(&log, "dv"))]);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let columns = ["--time", "t", "--alias", "v=`v [m/s]`", "--states", "v", "--inputs", "u", "--derivative", "v=dv"];
    run(&[&["fit", "pwa", "train.csv", "--partition", "kmeans:4"][..], &columns].concat()).ok();
    let with = run(&["predict", "model.json", "all.csv", "-o", "all-predicted.csv", "--json"]).ok().json();
    let output = run(&["predict", "model.json", "new.csv", "-o", "new-predicted.csv", "--json"]).ok();
    assert!(output.err.contains("no dv"), "{}", output.err);
    let without = output.json();
    assert_eq!(
        (with["rows"].as_u64(), with["predicted"].as_u64(), with["compared"].as_u64()),
        (Some(1000), Some(1000), Some(1000))
    );
    assert_eq!((without["predicted"].as_u64(), without["compared"].as_u64()), (Some(1000), Some(0)));
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    let (with, without) = (read("all-predicted.csv"), read("new-predicted.csv"));
    // The same predictions, and nothing where nothing was measured.
    assert_eq!(column(&with, "d(v)/dt predicted"), column(&without, "d(v)/dt predicted"));
    assert!(column(&with, "d(v)/dt measured").iter().all(Option::is_some));
    for name in ["d(v)/dt measured", "d(v)/dt residual"] {
        assert!(column(&without, name).iter().all(Option::is_none), "{name}");
    }
    assert_eq!(column(&with, "time_ns")[3], Some(3e7));
    // Rollouts start from the states: the measured derivative is not needed.
    let roll = |log: &str| {
        let arguments = ["rollout", "model.json", log, "--horizon", "40", "--starts", "20", "--json"];
        let json = run(&arguments).ok().json();
        json["model"].clone()
    };
    assert_eq!(roll("all.csv"), roll("new.csv"));
    // A score needs something to score.
    run(&["score", "model.json", "new.csv"]).fails(&["dv"]);
}

#[test]
fn rollouts_continue_beyond_measured_states() {
    // The inputs go on for the whole log; the speed is known for the first 100 rows.
    let log = robot_csv(600, 2.0);
    let cut: String = log
        .lines()
        .enumerate()
        .map(|(row, line)| {
            let mut cells: Vec<&str> = line.split(',').collect();
            if row > 100 {
                (cells[1], cells[2], cells[5]) = ("", "", "");
            }
            cells.join(",") + "\n"
        })
        .collect();
    let folder = folder(&[("train.csv", robot_csv(3000, 1.0)), ("cut.csv", cut)]);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let columns = ["--time", "t", "--alias", "v=`v [m/s]`", "--states", "v", "--inputs", "u", "--derivative", "v=dv"];
    run(&[&["fit", "pwa", "train.csv", "--partition", "kmeans:4"][..], &columns].concat());
    let arguments = ["rollout", "model.json", "cut.csv", "--horizon", "500", "--starts", "1", "-o", "run.csv"];
    let text = run(&arguments).out;
    // The measurements end somewhere: no claim goes beyond it.
    assert!(!text.contains("to the end (5.000 s)") && !text.contains("to 5.000 s"), "{text}");
    let rows = fs::read_to_string(folder.path().join("run.csv")).unwrap();
    assert_eq!(column(&rows, "v").iter().filter(|value| value.is_some()).count(), 501);
    let measured = column(&rows, "v measured");
    let there = measured.iter().filter(|value| value.is_some()).count();
    assert!((40..=100).contains(&there), "{there}");
    assert_eq!(column(&rows, "v")[0], measured[0], "it starts from what was measured");
    let far = run(&["rollout", "model.json", "cut.csv", "--horizon", "30", "--starts", "5", "--json"]).json();
    assert!(far["useful_horizon"]["better_than"]["persistence"].is_array(), "{far:#}");
}

#[test]
fn plain_regressions_need_no_clock() {
    let folder = folder(&[("rows.csv", unordered(400)), ("new.csv", without(&unordered(50), "y"))]);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let fit = run(&["fit", "pwa", "rows.csv", "--inputs", "a,b", "--predict", "x,y", "--json"]).ok();
    assert!(fit.err.contains("no time stamps"), "{}", fit.err);
    assert_eq!(fit.json()["targets"], serde_json::json!(["x", "y"]));
    let show = run(&["show", "model.json"]).ok().out;
    assert!(show.contains("f_x = 1 + 2*a - b") || show.contains("f_x = 1 + 2*a - 1*b"), "{show}");
    assert!(show.contains("3*b"), "{show}");
    let score = run(&["score", "model.json", "rows.csv", "--json"]).ok().json();
    assert!(score["targets"][1]["rmse"].as_f64().unwrap() < 1e-9, "{score:#}");
    let predicted = run(&["predict", "model.json", "new.csv", "-o", "new.tsv", "--json"]).ok().json();
    assert_eq!((predicted["predicted"].as_u64(), predicted["compared"].as_u64()), (Some(50), Some(0)));
    // SINDy: the product is found, and the other two beside it.
    let report =
        run(&["fit", "sindy", "rows.csv", "--inputs", "a,b", "--predict", "x,y,z", "--library", "poly(2)", "--json"]);
    let report = report.ok().json();
    let terms: Vec<Vec<&str>> = report["regions"][0]["equations"]
        .as_array()
        .unwrap()
        .iter()
        .map(|equation| {
            equation["terms"].as_array().unwrap().iter().map(|term| term["function"].as_str().unwrap()).collect()
        })
        .collect();
    assert_eq!(terms, [vec!["1", "a", "b"], vec!["b"], vec!["a*b"]]);
    // The structured lasso, of the logs and of their statistic.
    let options = ["--inputs", "a,b", "--predict", "x,y,z", "--degree", "2"];
    let sparse = run(&[&["fit", "sparse", "rows.csv", "-o", "logs.json"], &options[..]].concat()).ok();
    assert!(sparse.err.contains("no time stamps"), "{}", sparse.err);
    assert!(run(&["show", "logs.json"]).ok().out.contains("a*b"));
    run(&[&["scan", "rows.csv", "-o", "rows.stats"], &options[..]].concat()).ok();
    run(&["fit", "sparse", "rows.stats", "-o", "statistic.json"]).ok();
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("logs.json") == bytes("statistic.json"), "the statistic gives another model");
    // Lags are of the order of the rows; rates need seconds.
    run(&["fit", "pwa", "rows.csv", "--inputs", "a,b", "--predict", "x", "--lags", "1"]).ok();
    run(&["fit", "pwa", "rows.csv", "--states", "a", "--inputs", "b"]).fails(&["no time column", "--dt"]);
    run(&["fit", "pwa", "rows.csv", "--inputs", "a,b", "--predict", "x,x"]).fails(&["`x` is named twice"]);
    run(&["fit", "pwa", "rows.csv", "--inputs", "a,b", "--predict", "x,q"]).fails(&["`q`"]);
}

#[test]
fn known_equations_are_rolled_out_and_exported() {
    let recipe = "[columns]\nv = \"`v [m/s]`\"\n[states]\nx = { known = \"v\" }\nv = { known = \"-2*v + 3*u - step(v - 0.5)*(3*v + u - 1)\" }\n[inputs]\nu = \"u\"\n[time]\n\
                  column = \"t\"\n";
    let folder = folder(&[("log.csv", robot_csv(2000, 1.0)), ("physics.toml", recipe.to_owned())]);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    for method in ["pwa", "sindy"] {
        let output = run(&["fit", method, "-c", "physics.toml", "log.csv", "-o", "physics.json"]).ok();
        assert!(output.out.contains("d(v)/dt = -2*v + 3*u - step(v - 0.5)*"), "{}", output.out);
        assert!(output.err.contains("nothing is fitted"), "{}", output.err);
        // The recording was made by Euler's steps.
        let options = ["rollout", "physics.json", "log.csv", "--horizon", "20", "--starts", "50", "--method", "euler"];
        let rolled = run(&[&options[..], &["--json"]].concat()).ok().json();
        let error = |score: &serde_json::Value| score["mahalanobis"].as_array().unwrap()[19][0].as_f64().unwrap();
        assert!(error(&rolled["model"]) < 1e-6 * error(&rolled["baselines"]["persistence"]), "{rolled:#}");
        // Its own equations with nothing learnt would be the model itself.
        assert!(rolled["baselines"]["null"].is_null(), "{rolled:#}");
        assert_eq!(rolled["useful_horizon"]["better_than_all"][0]["last_step"], 20);
        run(&["export", "physics.json", "--to", "c", "--prefix", "physics", "-o", "code"]).ok();
        assert!(folder.path().join("code/physics.c").exists());
        run(&["score", "physics.json", "log.csv"]).fails(&["rollouts"]);
    }
}

#[test]
fn direct_inputs_are_arguments_of_exported_steps() {
    // y(k+1) = 0.5 y(k) + 2 u(k+1) - 0.3 u(k)
    let mut text = String::from("y,u\n");
    let (mut y, mut before) = (0.0, 0.0);
    for row in 0..400_u64 {
        let u = fleetfoot::data::mix(row) as f64 / u64::MAX as f64 - 0.5;
        y = 0.5 * y + 2.0 * u - 0.3 * before;
        before = u;
        text.push_str(&format!("{y},{u}\n"));
    }
    let folder = folder(&[("log.csv", text)]);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let fit = ["fit", "narx", "log.csv", "--outputs", "y", "--inputs", "u", "--dt", "0.1", "--direct", "--degree", "1"];
    run(&[&fit[..], &["--lags-out", "1", "--lags-in", "1", "--terms", "3"]].concat());
    run(&["export", "model.json", "--to", "c", "--prefix", "robot", "-o", "code"]);
    let header = fs::read_to_string(folder.path().join("code/robot.h")).unwrap();
    assert!(header.contains("int robot_step(robot_model *m, const double u[1], const double u_next[1]);"), "{header}");
    for to in ["rust", "python"] {
        run(&["export", "model.json", "--to", to, "--prefix", "robot", "-o", "code"]);
    }
    assert!(fs::read_to_string(folder.path().join("code/robot.rs")).unwrap().contains("u_next: &[f64; 1]"));
    assert!(fs::read_to_string(folder.path().join("code/robot.py")).unwrap().contains("def step(self, u, u_next)"));
    if Command::new("cc").arg("--version").output().is_err() {
        eprintln!("no `cc` on this machine: exported code is not compiled");
        return;
    }
    let code = folder.path().join("code");
    let cc = Command::new("cc")
        .current_dir(&code)
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "robot.c", "robot_test.c", "-o", "robot", "-lm"])
        .output()
        .expect("cc");
    assert!(cc.status.success(), "{}", String::from_utf8_lossy(&cc.stderr));
    assert!(Command::new(code.join("robot")).output().expect("the test").status.success());
}

#[test]
fn lassos_of_hundreds_find_the_terms() {
    let mut text = String::from("t");
    (0..10).for_each(|j| text.push_str(&format!(",x{j}")));
    text.push_str(",y\n");
    for row in 0..2_500_u64 {
        let draw =
            |key: u64| fleetfoot::data::mix(fleetfoot::data::mix(key).wrapping_add(row)) as f64 / u64::MAX as f64 - 0.5;
        let x: Vec<f64> = (0..10).map(draw).collect();
        text.push_str(&row.to_string());
        x.iter().for_each(|x| text.push_str(&format!(",{x}")));
        text.push_str(&format!(",{}\n", 2.0 * x[0] - x[1] * x[2] + 3.0 * x[3] * x[4] * x[5] + 0.01 * draw(99)));
    }
    let folder = folder(&[("log.csv", text)]);
    let inputs: Vec<String> = (0..10).map(|j| format!("x{j}")).collect();
    let report = fleetfoot(
        folder.path(),
        &[
            "fit",
            "sindy",
            "log.csv",
            "--inputs",
            &inputs.join(","),
            "--predict",
            "y",
            "--library",
            "poly(3)",
            "--optimizer",
            "lasso",
            "--json",
        ],
    )
    .ok()
    .json();
    let equation = &report["regions"][0]["equations"][0];
    assert_eq!(equation["candidates"], 286);
    let held = equation["held_out_rms"].as_f64().unwrap();
    assert!(held < 0.0035, "{held}");
    let terms: Vec<&str> =
        equation["terms"].as_array().unwrap().iter().map(|term| term["function"].as_str().unwrap()).collect();
    for expected in ["x0", "x1*x2", "x3*x4*x5"] {
        assert!(terms.contains(&expected), "{expected}: {terms:?}");
    }
}
