//! The main job on recordings of real machines (and one simulated hybrid), fitted on one part and scored on rows held out.
//!
//! The data are not part of the project: `outside.rs` has their place.

use std::fs;

use crate::{outside::data, runner::*};

/// Splits a CSV at a share of its rows into `train.csv` and `test.csv`.
fn split(path: &Path, share: f64) -> tempfile::TempDir {
    let text = fs::read_to_string(path).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let at = 1 + ((lines.len() - 1) as f64 * share) as usize;
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("train.csv"), lines[..at].join("\n") + "\n").unwrap();
    fs::write(folder.path().join("test.csv"), format!("{}\n{}\n", lines[0], lines[at..].join("\n"))).unwrap();
    folder
}

fn value(json: &serde_json::Value, path: &str) -> f64 {
    json.pointer(path).and_then(serde_json::Value::as_f64).unwrap_or_else(|| panic!("{path} is missing from {json:#}"))
}

/// The model's Mahalanobis score at the last step of a rollout, over the best baseline's.
fn last_over_best_baseline(rollout: &serde_json::Value) -> f64 {
    let last =
        |scores: &serde_json::Value| scores["mahalanobis"].as_array().unwrap().last().unwrap()[0].as_f64().unwrap();
    let baselines = rollout["baselines"].as_object().unwrap();
    last(&rollout["model"]) / baselines.values().map(last).fold(f64::INFINITY, f64::min)
}

#[test]
fn hybrid_robots_are_recovered_exactly() {
    let Some(file) = data("hybrid-diff-drive.csv") else { return };
    let folder = tempfile::tempdir().unwrap();
    let recipe = "[states]\nx = { derivative = \"dx\", regressor = false }\nphi = { derivative = \"dphi\", regressor = false }\n\
                  xd = { derivative = \"ddx\" }\nphid = { derivative = \"ddphi\" }\n[inputs]\nu1 = \"u1\"\nu2 = \"u2\"\n[time]\ncolumn = \"t\"\n";
    fs::write(folder.path().join("recipe.toml"), recipe).unwrap();
    let file = file.to_str().unwrap();
    fleetfoot(
        folder.path(),
        &["fit", "pwa", "-c", "recipe.toml", file, "--partition", "labels:region", "--folds", "0"],
    )
    .ok();
    let model = fleetfoot(folder.path(), &["show", "model.json", "--json"]).ok().json();
    let model = &model["model"];
    // Regions in the order of the labels: 0 is xd <= 0 and its offsets (-1, 1) or (0, 0) as in the data's description.
    for (region, info) in model["partitions"][0]["regions"].as_array().unwrap().iter().enumerate() {
        let (f1, f2) = if info["name"] == "1" { (-1.0, 1.0) } else { (0.0, 0.0) };
        // xd, phid, u1, u2 -> dx, dphi, ddx, ddphi
        let expected = [
            (f1, [1.0, 0.0, 0.0, 0.0]),
            (f2, [0.0, 1.0, 0.0, 0.0]),
            (0.0, [-0.175, 0.0, 0.5, 0.0]),
            (0.0, [0.0, -0.266_666_666_666_666_7, 0.0, 0.6]),
        ];
        for (latent, (constant, coefficients)) in expected.iter().enumerate() {
            let latent = &model["latents"][latent];
            assert!((value(latent, &format!("/constants/{region}")) - constant).abs() < 1e-9);
            for (j, coefficient) in coefficients.iter().enumerate() {
                let estimate = value(latent, &format!("/coefficients/{region}/{j}"));
                assert!((estimate - coefficient).abs() < 1e-9, "{estimate} {coefficient}");
            }
        }
    }
}

#[test]
fn quadrotor_in_wind() {
    let Some(file) = data("neural-fly/35wind.csv") else { return };
    let wind = file.parent().unwrap().to_str().unwrap().to_owned();
    let folder = split(&file, 0.5);
    let recipe = "[columns]\nTx = \"R_13*T_sp\"\nTy = \"R_23*T_sp\"\nTz = \"R_33*T_sp\"\n\
                  [states]\nv_x = { derivative = \"forward\" }\nv_y = { derivative = \"forward\" }\nv_z = { derivative = \"forward\" }\n\
                  [inputs]\nTx = \"Tx\"\nTy = \"Ty\"\nTz = \"Tz\"\n";
    fs::write(folder.path().join("quad.toml"), recipe).unwrap();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok().json();
    let others: Vec<String> = ["nowind", "70wind", "100wind"].iter().map(|name| format!("{wind}/{name}.csv")).collect();
    let mut fit =
        vec!["fit", "pwa", "-c", "quad.toml", "train.csv", "--partition", "null,average,kmeans:2,5,10", "--json"];
    fit.extend(others.iter().map(String::as_str));
    let fit = run(&fit);
    let loss = |candidate: usize| value(&fit, &format!("/candidates/{candidate}/loss"));
    assert!(loss(4) < loss(1) && loss(1) < 0.7 * loss(0), "{fit:#}");
    let score = run(&["score", "model.json", "test.csv", "--json"]);
    assert!(value(&score, "/targets/2/mae_over_null/value") < 0.6, "{score:#}");
    let rollout = run(&["rollout", "model.json", "test.csv", "--horizon", "50", "--starts", "500", "--json"]);
    assert_eq!(rollout["diverged"], 0);
    assert!(last_over_best_baseline(&rollout) < 0.8);
}

#[test]
fn electro_mechanical_positioning_system() {
    let Some(file) = data("emps.csv") else { return };
    let folder = split(&file, 0.8);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok().json();
    let recipe = "[columns]\nqd = \"central(qm)\"\n[states]\nqm = { known = \"qd\", regressor = false }\nqd = {}\n[inputs]\nvir = \"vir\"\n";
    fs::write(folder.path().join("emps.toml"), recipe).unwrap();
    run(&["fit", "pwa", "-c", "emps.toml", "train.csv", "--partition", "average,kmeans:2", "--purge", "0.1", "--json"]);
    let score = run(&["score", "model.json", "test.csv", "--json"]);
    // Dry friction changes its sign with the speed: two regions explain what one cannot.
    assert!(value(&score, "/targets/0/r2") > 0.98, "{score:#}");
    let rollout = run(&["rollout", "model.json", "test.csv", "--horizon", "500", "--starts", "100", "--json"]);
    assert!(last_over_best_baseline(&rollout) < 0.2);
}

/// The four published parameters of the positioning system, from two recipes: low-pass filter and derivatives first,
/// then every tenth row of the regressors, the direction among them. The publication has mass 95.1089, viscous friction
/// 203.5034, Coulomb friction 20.3935 and offset -3.1648. The difference is in the ends of the filters and of the
/// record, which move the offset by a hundredth. All lie within a fifth of their standard errors.
#[test]
fn published_parameters_of_the_positioning_system() {
    let Some(file) = data("emps.csv") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::copy(&file, path.join("emps.csv")).unwrap();
    let filter = "columns = { force = \"35.15065188*vir\" }\nstates = { qm = { unit = \"m\" } }\ninputs = { force = {} }\n\
                  [prepare]\nmethod = \"butterworth\"\ncutoff = 100.0\nclip = 0.049\n";
    fs::write(path.join("filter.toml"), filter).unwrap();
    fleetfoot(path, &["prepare", "-c", "filter.toml", "emps.csv", "-o", "filtered"]).ok();
    // A parabola through three rows is their middle one: nothing but the filter against aliases is left.
    let channels: String = ["qm_ddot", "direction", "force"]
        .map(|name| format!("[channels.{name}]\nmethod = \"savitzky-golay\"\n"))
        .concat();
    let decimate = format!(
        "columns = {{ direction = \"sign(qm_dot)\" }}\nstates = {{ qm_dot = {{}} }}\ninputs = {{ qm_ddot = {{}}, direction = {{}}, force = {{}} }}\n\
         [time]\ncolumn = \"t\"\nmax_gap = \"none\"\n[prepare]\ndecimate = 10\nmethod = \"savitzky-golay\"\nwindow = 3\ndegree = 2\n{channels}"
    );
    fs::write(path.join("decimate.toml"), decimate).unwrap();
    fleetfoot(path, &["prepare", "-c", "decimate.toml", "filtered/emps.clean.parquet", "-o", "slow"]).ok();
    let terms = "qm_ddot,qm_dot,direction,1";
    let data = "slow/emps_clean.clean.parquet";
    let fit = ["fit", "sindy", data, "--predict", "force", "--library", terms, "--threshold", "0", "--json"];
    let fitted = fleetfoot(path, &[&fit[..], &["--time", "t", "--max-gap", "none"]].concat()).ok().json();
    let terms = fitted["regions"][0]["equations"][0]["terms"].as_array().unwrap();
    let published =
        [("qm_ddot", 95.1089, 1e-4), ("qm_dot", 203.5034, 3e-3), ("direction", 20.3935, 4e-3), ("1", -3.1648, 0.01)];
    for (name, published, tolerance) in published {
        let term = terms.iter().find(|term| term["function"] == name).unwrap_or_else(|| panic!("{fitted:#}"));
        let (estimate, error) = (value(term, "/coefficient"), value(term, "/standard_error"));
        assert!((estimate / published - 1.0).abs() < tolerance, "{name}: {estimate} {published}");
        assert!((estimate - published).abs() < 0.2 * error, "{name}: {estimate} +- {error} {published}");
    }
}

#[test]
fn component_placement_head() {
    let Some(file) = data("pick-and-place.csv") else { return };
    let folder = split(&file, 50_000.0 / 60_001.0);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok().json();
    run(&[
        "fit",
        "pwa",
        "train.csv",
        "--states",
        "y",
        "--inputs",
        "u",
        "--predict",
        "next",
        "--lags",
        "3",
        "--partition",
        "average,kmeans:2,5,10",
        "--partition-on",
        "y,lag(y,1),u",
        "--purge",
        "0.05",
        "--json",
    ]);
    let score = run(&["score", "model.json", "test.csv", "--json"]);
    let persistence =
        score["targets"][0]["baselines"].as_array().unwrap().iter().find(|b| b["name"] == "persistence").unwrap();
    assert!(value(persistence, "/model_mae") < 0.2 * value(persistence, "/mae"), "{score:#}");
    let rollout = run(&["rollout", "model.json", "test.csv", "--horizon", "200", "--starts", "100", "--json"]);
    assert!(last_over_best_baseline(&rollout) < 1.0);
}

#[test]
fn airliner_with_date_stamps() {
    let Some(file) = data("a320-flight.csv") else { return };
    let folder = tempfile::tempdir().unwrap();
    let info = fleetfoot(folder.path(), &["info", file.to_str().unwrap(), "--values", "--json"]).ok().json();
    assert_eq!(info[0]["clock"]["column"], "timestamp");
    assert!((value(&info, "/0/clock/period") - 1.0).abs() < 1e-9);
    assert_eq!(value(&info, "/0/clock/start"), 1_311_427_389e9, "2011-07-23 13:23:09");
    let fit = fleetfoot(
        folder.path(),
        &[
            "fit",
            "pwa",
            file.to_str().unwrap(),
            "--states",
            "altitude,CAS,weight",
            "--inputs",
            "pitch,fuelflow",
            "--partition",
            "average,kmeans:3",
            "--partition-on",
            "altitude,CAS",
            "--purge",
            "60",
            "--json",
        ],
    )
    .ok()
    .json();
    // Weight falls as fuel flows, kg/h in the file.
    let weight = fleetfoot(folder.path(), &["show", "model.json", "--json"]).ok().json();
    assert_eq!(fit["targets"][2], "d(weight)/dt");
    assert!(weight["model"]["latents"].as_array().unwrap().len() == 3);
    let rollout =
        fleetfoot(folder.path(), &["rollout", "model.json", file.to_str().unwrap(), "--horizon", "60", "--json"]).ok();
    assert!(rollout.err.contains("in-sample"), "{}", rollout.err);
}

#[test]
fn quadrotor_on_the_bench() {
    let Some(file) = data("crazyflie-thrust.csv") else { return };
    let folder = split(&file, 0.7);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok().json();
    run(&[
        "fit",
        "pwa",
        "train.csv",
        "--inputs",
        "m1,m2,m3,m4",
        "--predict",
        "acc_z_mps2",
        "--lags",
        "20",
        "--partition",
        "average,kmeans:3",
        "--purge",
        "0.5",
        "--json",
    ]);
    let score = run(&["score", "model.json", "test.csv", "--json"]);
    assert!(value(&score, "/targets/0/mae_over_null/value") < 0.6, "{score:#}");
    let Some(file) = data("crazyflie-roll-pitch.csv") else { return };
    let folder = split(&file, 0.7);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok().json();
    run(&[
        "fit",
        "pwa",
        "train.csv",
        "--states",
        "gyro_x_rads,gyro_y_rads",
        "--inputs",
        "m1,m2,m3,m4",
        "--predict",
        "next",
        "--lags",
        "5",
        "--partition",
        "average,kmeans:4",
        "--purge",
        "0.5",
        "--json",
    ]);
    let rollout = run(&["rollout", "model.json", "test.csv", "--horizon", "20", "--starts", "300", "--json"]);
    assert!(last_over_best_baseline(&rollout) < 1.0);
}

/// A wheeled robot's ROS 2 log: odometry, with headers in simulated seconds and log times of 2026.
#[test]
fn turtlebot_logs_are_identified() {
    let Some(file) = data("mcap/nav2_turtlebot.mcap") else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = file.to_str().unwrap();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let info = run(&["info", file, "--json"]).json();
    let counts: Vec<_> = info[0]["topics"].as_array().unwrap().iter().map(|topic| topic["messages"].as_u64()).collect();
    assert_eq!(counts, [Some(135), Some(2639), Some(5422), Some(1)]);

    // The starter's recipe for an odometry is complete once it is uncommented.
    let starter = run(&["init", file]).out;
    let states = ["x =", "y =", "yaw =", "v =", "w ="];
    let mut section = String::new();
    let recipe: String = starter
        .lines()
        .map(|line| {
            if line.starts_with("# /") {
                section = line.to_owned();
            }
            let rest = line.strip_prefix("# ").unwrap_or(line);
            let taken = states.iter().any(|name| rest.starts_with(name))
                && (section.starts_with("# /odom ") || !rest.contains("\"/") && !rest.contains("(/"));
            format!("{}\n", if taken { rest } else { line })
        })
        .collect();
    fs::write(folder.path().join("robot.toml"), &recipe).unwrap();
    let fit = run(&[
        "fit",
        "pwa",
        "-c",
        "robot.toml",
        file,
        "-p",
        "null,average,kmeans:2",
        "--predict",
        "next",
        "--lags",
        "5",
        "--json",
    ])
    .json();
    assert_eq!((fit["rows"].as_u64(), fit["episodes"].as_u64()), (Some(2627), Some(2)), "{recipe}");
    let chosen = fit["chosen"].as_u64().unwrap();
    for speed in 0..2 {
        let error = value(&fit, &format!("/candidates/{chosen}/mae_over_null/{speed}"));
        assert!(error < 0.05, "held-out error of speed {speed}: {error} of the null model's");
    }
    let score = run(&["score", "model.json", file, "--json"]);
    assert!(score.err.contains("in-sample"), "{}", score.err);
    let rollout =
        run(&["rollout", "model.json", file, "--horizon", "30", "--starts", "200", "-o", "r.mcap", "--json"]).json();
    assert!(last_over_best_baseline(&rollout) < 0.9, "{rollout:#}");
    // Drawn over the recording: its time, not the simulation's.
    let written = run(&["info", "r.mcap", "--json"]).json();
    let start = |info: &serde_json::Value, topic: &str| {
        let topics = info[0]["topics"].as_array().unwrap();
        topics.iter().find(|entry| entry["name"] == topic).unwrap()["start"].as_i64().unwrap()
    };
    let apart = start(&written, "/fleetfoot/rollout/0") - start(&info, "/odom");
    assert!((0..2_000_000_000).contains(&apart), "{apart} ns");
}

/// Logs with texts, services, one-shot messages and an unknown encoding: read, or refused with a reason.
#[test]
fn odd_logs_are_read_or_refused() {
    let Some(file) = data("mcap/wrong_rmw_test_0.mcap") else { return };
    let folder = tempfile::tempdir().unwrap();
    let mcap = file.parent().unwrap();
    for entry in fs::read_dir(mcap).unwrap() {
        let path = entry.unwrap().path();
        let info = fleetfoot(folder.path(), &["info", "--values", path.to_str().unwrap()]).ok();
        assert!(!info.err.contains("panicked"), "{}", info.err);
    }
    let fit = |file: &str, state: &str, more: &[&str]| {
        let path = mcap.join(file);
        let mut arguments = vec!["fit", "pwa", path.to_str().unwrap(), "-p", "average", "--states", state];
        arguments.extend(more);
        fleetfoot(folder.path(), &arguments)
    };
    fit("wrong_rmw_test_0.mcap", "/test_topic.float64_value", &[]).fails(&["wrong_format"]);
    fit("only_services.mcap", "/add_two_ints/_service_event.info.stamp.sec", &[])
        .fails(&["AddTwoInts_Event", "missing"]);
    fit("nav2_turtlebot.mcap", "/odom.twist.twist.linear.x", &["--time", "t"]).fails(&["its own clock"]);
    fit("array_msgs_0.mcap", "/one_shot/imu.linear_acceleration.x", &["--stamp", "header"]).fails(&["not filled in"]);
}

/// The draft for a flight of PX4: the attitude as angles, the rates of turn, and the controls; it fits as it is.
#[test]
fn drafts_of_flights_have_an_attitude() {
    let Some(file) = data("ulog/sample_log_small.ulg") else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = file.to_str().unwrap();
    fleetfoot(folder.path(), &["init", file, "-o", "robot.toml"]).ok();
    let recipe = fs::read_to_string(folder.path().join("robot.toml")).unwrap();
    let states = recipe.split("[states]").nth(1).unwrap();
    for name in ["roll = {", "pitch = {", "yaw = {", "p = {", "q = {", "r = {", "u0 = {"] {
        assert!(states.lines().any(|line| line.starts_with(name)), "{name}: {recipe}");
    }
    let fit = ["fit", "pwa", "-c", "robot.toml", file, "-p", "average", "-o", "m.json", "--json"];
    let fitted = fleetfoot(folder.path(), &fit).ok().json();
    assert!(fitted["rows"].as_u64().unwrap() > 300, "{fitted}");
}
