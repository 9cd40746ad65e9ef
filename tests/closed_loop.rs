//! `rollout --controller`: the loop closed around a fitted model.

use std::fs;

use crate::runner::*;

/// A robot on a belt: vx' = 6 (u_v - vx), w' = 9 (u_w - w), x' = vx cos(yaw) - belt; commanded open loop. `speed`: the
/// log's name of the belt's speed.
fn treadmill_csv(rows: usize, phase: f64) -> String {
    let (dt, belt) = (0.002, 0.25);
    let (mut x, mut y, mut yaw, mut vx, mut w) = (0.02f64, 0.0f64, 0.1f64, 0.25f64, 0.0f64);
    let mut text = String::from("t,x,y,yaw,vx,w,u_v,u_w,speed\n");
    for row in 0..rows {
        let t = row as f64 * dt;
        let held = (t * 25.0).floor() / 25.0;
        let (u_v, u_w) = (0.25 + 0.1 * (5.0 * held + phase).sin(), 0.8 * (3.1 * held + 2.0 * phase).cos());
        text.push_str(&format!("{t},{x},{y},{yaw},{vx},{w},{u_v},{u_w},{belt}\n"));
        x += dt * (vx * yaw.cos() - belt);
        y += dt * vx * yaw.sin();
        yaw += dt * w;
        vx += dt * 6.0 * (u_v - vx);
        w += dt * 9.0 * (u_w - w);
    }
    text
}

pub(crate) fn fitted() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for run in 0..3 {
        fs::write(folder.path().join(format!("run_{run}.csv")), treadmill_csv(3000, f64::from(run))).expect("a file");
    }
    let recipe = "[columns]\nbelt_speed = \"speed\"\n[states]\nx = { known = \"vx*cos(yaw) - 0.25\", regressor = false }\n\
                  y = { known = \"vx*sin(yaw)\", regressor = false }\n\
                  yaw = { known = \"w\", regressor = false, kind = \"angle\" }\nvx = { derivative = \"forward\" }\n\
                  w = { derivative = \"forward\" }\n[inputs]\nu_v = \"u_v\"\nu_w = \"u_w\"\n[time]\ncolumn = \"t\"\n";
    fs::write(folder.path().join("robot.toml"), recipe).expect("a file");
    fleetfoot(folder.path(), &["fit", "pwa", "-c", "robot.toml", "run_0.csv", "run_1.csv", "--partition", "average"])
        .ok();
    folder
}

#[test]
fn fitted_models_run_in_the_treadmill_loop() {
    let folder = fitted();
    let run = |more: &[&str]| {
        // The recording was made by Euler's steps.
        let arguments = ["rollout", "model.json", "run_2.csv", "--starts", "40", "--horizon", "1000", "--json"];
        fleetfoot(folder.path(), &[&arguments[..], &["--method", "euler"], more].concat())
    };
    let open = run(&[]).ok().json();
    assert_eq!(open["driven_inputs"], serde_json::json!([]));
    let closed = run(&["--controller", "treadmill", "-o", "closed.parquet"]).ok();
    assert!(closed.err.contains("u_v, u_w come from the controller"), "{}", closed.err);
    let closed = closed.json();
    assert_eq!(closed["driven_inputs"], serde_json::json!(["u_v", "u_w"]));
    let rmse = |scores: &serde_json::Value, state: usize| scores["model"]["rmse"][999][state].as_f64().unwrap();
    // The model is exact: with the recorded inputs it follows the recording; under another law it goes elsewhere.
    assert!(rmse(&open, 2) < 1e-6 && rmse(&closed, 2) > 1e-2, "{} {}", rmse(&open, 2), rmse(&closed, 2));

    let info = fleetfoot(folder.path(), &["info", "closed.parquet", "--values", "--json"]).ok().json();
    let column = |name: &str| {
        let columns = info[0]["columns"].as_array().expect("columns");
        columns.iter().find(|column| column["name"] == name).unwrap_or_else(|| panic!("{name} in {info:#}")).clone()
    };
    // One row a trajectory has no input: the last.
    assert_eq!(column("u_w")["statistics"]["missing"], 40);
    let highest = column("u_w")["statistics"]["max"].as_f64().unwrap();
    assert!(highest > 0.0 && highest <= 6.0);

    // The loop is one of the recipe's alias, a number, or a field of the log: the same bits, and a note names the source.
    let same = |arguments: &[&str], replayed: &[&str]| {
        let mut other = run(arguments).ok().json();
        assert_eq!(other["replayed"], serde_json::json!(replayed), "{arguments:?}");
        other["replayed"] = closed["replayed"].clone();
        // Whole reports are too long to be printed.
        assert!(other == closed, "{arguments:?}");
    };
    assert_eq!(closed["replayed"], serde_json::json!(["belt_speed"]));
    same(&["--controller", "treadmill", "--controller-set", "speed=speed"], &["speed"]);
    same(&["--controller", "treadmill", "--controller-set", "speed=0.25"], &[]);
    let quick =
        run(&["--controller", "treadmill", "--controller-set", "k_yaw=8,latency=0", "--controller-set", "k_x=3"]);
    assert_ne!(quick.ok().json()["model"], closed["model"]);
    fs::write(folder.path().join("loop.toml"), "kind = \"treadmill\"\nk_yaw = 10\nspeed = 0.25\n").unwrap();
    same(&["--controller", "loop.toml"], &[]);
    same(&["--controller", "treadmill", "--threads", "7"], &["belt_speed"]);
}

#[test]
fn names_and_settings_that_do_not_exist() {
    let folder = fitted();
    let run = |more: &[&str]| {
        let arguments = ["rollout", "model.json", "run_2.csv", "--starts", "5", "--horizon", "10"];
        fleetfoot(folder.path(), &[&arguments[..], more].concat())
    };
    let set = |setting: &str| run(&["--controller", "treadmill", "--controller-set", setting]);
    set("yaw=yow").fails(&["yow", "did you mean", "yaw"]);
    set("u_v=u_vv").fails(&["u_vv", "did you mean", "u_v"]);
    set("kx=2").fails(&["no setting `kx`", "did you mean k_x"]);
    set("k_x=fast").fails(&["k_x"]);
    set("period=0").fails(&["period = 0", "positive"]);
    set("latency").fails(&["KEY=VALUE"]);
    run(&["--controller", "tredmill"]).fails(&["tredmill", "treadmill"]);
    fs::write(folder.path().join("other.toml"), "kind = \"lqr\"\n").unwrap();
    run(&["--controller", "other.toml"]).fails(&["lqr", "treadmill"]);
    assert_eq!(run(&["--controller-set", "k_x=2"]).code, 2);
}
