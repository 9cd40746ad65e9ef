//! `control lqr`, and the commands that take its files.

use std::fs;

use crate::{closed_loop::fitted, runner::*};

/// The last simulated values of a column of trajectories, one a trajectory.
fn last(text: &str, column: &str) -> Vec<f64> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let place =
        |name: &str| header.iter().position(|field| *field == name).unwrap_or_else(|| panic!("{name}: {header:?}"));
    let (trajectory, value) = (place("trajectory"), place(column));
    let mut values: Vec<f64> = Vec::new();
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        let (index, value) =
            (cells[trajectory].parse::<usize>().expect("an index"), cells[value].parse().expect("a number"));
        if index == values.len() { values.push(value) } else { values[index] = value }
    }
    values
}

#[test]
fn models_reach_their_set_point() {
    let folder = fitted();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let made = run(&["control", "lqr", "model.json", "--setpoint", "x=0,y=0", "-o", "stay.json", "--json"]).ok().json();
    // The belt moves at 0.25 m/s: so does the robot, straight ahead.
    for (name, value) in [("x", 0.0), ("y", 0.0), ("yaw", 0.0), ("vx", 0.25), ("w", 0.0)] {
        let setpoint = made["setpoint"]["states"][name].as_f64().expect("a number");
        assert!((setpoint - value).abs() < 1e-9, "{name} {setpoint}");
    }
    assert!(made["regions"][0]["radius"].as_f64().expect("a radius") < 1.0 && made["setpoint"]["at_rest"] == true);
    assert_eq!((&made["format"], &made["kind"]), (&serde_json::json!(2), &serde_json::json!("lqr")));
    let closed = |threads: &str, output: &str| {
        let arguments = ["rollout", "model.json", "run_2.csv", "--starts", "9", "--horizon", "2500", "--controller"];
        let more = ["stay.json", "--threads", threads, "--json", "-o", output];
        let report = run(&[&arguments[..], &more].concat()).ok().json();
        assert_eq!(report["driven_inputs"], serde_json::json!(["u_v", "u_w"]));
        (report, fs::read_to_string(folder.path().join(output)).expect("trajectories"))
    };
    let (report, text) = closed("1", "1.csv");
    for threads in ["2", "7"] {
        let (other, same) = closed(threads, &format!("{threads}.csv"));
        assert!(other == report && same == text, "{threads} threads");
    }
    // Five seconds from within some centimetres; errors decay within about one.
    for (column, room) in [("x", 0.01), ("y", 0.05), ("yaw", 0.1)] {
        let last = last(&text, column);
        assert!(last.len() == 9 && last.iter().all(|value| value.abs() < room), "{column}: {last:?}");
    }
    // The settings may stand in the model's recipe, or in another; a flag overrides both.
    let recipe = fs::read_to_string(folder.path().join("robot.toml")).expect("a recipe");
    fs::write(folder.path().join("place.toml"), recipe + "\n[control]\nsetpoint = \"x=0,y=0\"\nfree = \"y\"\n")
        .unwrap();
    let law = |more: &[&str]| {
        let arguments = ["control", "lqr", "model.json", "-c", "place.toml", "-o", "other.json", "--json"];
        run(&[&arguments[..], more].concat()).ok().json()["law"].clone()
    };
    let states = |law: serde_json::Value| -> Vec<String> {
        let states = law["states"].as_array().expect("states").clone();
        states.iter().map(|state| state["name"].as_str().expect("a name").to_owned()).collect()
    };
    assert_eq!(states(law(&[])), ["x", "yaw", "vx", "w"]);
    assert_eq!(states(law(&["--free", "x"])), ["y", "yaw", "vx", "w"]);
    // An empty flag stands above it too: none.
    assert_eq!(states(law(&["--free", ""])), ["x", "y", "yaw", "vx", "w"]);
}

#[test]
fn controllers_become_code_and_detect_damage() {
    let folder = fitted();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    run(&["control", "lqr", "model.json", "--setpoint", "x=0,y=0", "--integral", "x=1", "-o", "stay.json"]).ok();
    let report = run(&["export", "stay.json", "--to", "c", "--prefix", "stay", "-o", "src", "--json"]).ok().json();
    assert!(report["compared"].as_u64().expect("points") >= 24, "{report}");
    let header = fs::read_to_string(folder.path().join("src/stay.h")).expect("a header");
    assert!(header.contains("STAY_STATE_INTEGRAL_X") && header.contains("regulator of"), "{header}");

    // Shown, it has all gains of the file, and what it commands.
    let shown = run(&["show", "stay.json"]).ok().out;
    for expected in ["linear-quadratic regulator", "commands every 2.000 ms: u_v, u_w", "set point: x = 0", "u_v/yaw"] {
        assert!(shown.contains(expected), "{expected}: {shown}");
    }
    assert!(shown.contains("u_v/integral of x") && shown.contains("radius: factor"), "{shown}");
    let report = run(&["show", "stay.json", "--json"]).ok().json();
    let file: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("stay.json")).expect("a controller")).unwrap();
    assert!(
        report["law"] == file["controller"]["law"] && report["regions"] == file["controller"]["regions"],
        "{report}"
    );
    run(&["show", "stay.json", "--transitions"]).fails(&["stay.json", "no transitions"]);

    let text = fs::read_to_string(folder.path().join("stay.json")).expect("a controller");
    let roll = |file: &str| {
        run(&["rollout", "model.json", "run_2.csv", "--starts", "2", "--horizon", "5", "--controller", file])
    };
    fs::write(folder.path().join("edited.json"), text.replacen("\"period\": 0.002", "\"period\": 0.004", 1)).unwrap();
    roll("edited.json").fails(&["edited.json", "checksum", "make it again"]);
    fs::write(folder.path().join("cut.json"), &text[..text.len() / 2]).unwrap();
    roll("cut.json").fails(&["cut.json", "not a fleetfoot controller"]);
    let newer = text.replacen("\"fleetfoot_controller\": 1", "\"fleetfoot_controller\": 9", 1);
    fs::write(folder.path().join("newer.json"), newer).unwrap();
    roll("newer.json").fails(&["format 9", "format 1"]);
    let arguments = ["rollout", "model.json", "run_2.csv", "--controller", "stay.json", "--controller-set", "k_x=2"];
    run(&arguments).fails(&["k_x=2", "no settings"]);
}

#[test]
fn impossible_regulators_are_refused() {
    let folder = fitted();
    let lqr = |more: &[&str]| fleetfoot(folder.path(), &[&["control", "lqr", "model.json"], more].concat());
    // At a standstill nothing moves it sideways.
    lqr(&["--setpoint", "x=0,y=0,vx=0"]).fails(&["no input reaches a mode in y", "free"]);
    lqr(&["--setpoint", "xx=0"]).fails(&["no state or input `xx`", "did you mean"]);
    lqr(&["--q", "u_v=1"]).fails(&["no kept state `u_v`"]);
    lqr(&["--drive", "x"]).fails(&["no input `x`", "u_v"]);
    lqr(&["--limits", "u_v=1"]).fails(&["INPUT=LOW:HIGH"]);
    lqr(&["--limits", "u_v=1:0"]).fails(&["above the lowest"]);
    lqr(&["-o", "model.json"]).fails(&["model.json"]);
    let moving = lqr(&["--setpoint", "x=0,y=0,vx=0.4", "-o", "away.json"]).ok();
    assert!(
        moving.err.contains("d(x)/dt = 1.500e-1") && moving.out.contains("no equilibrium of the model"),
        "{}",
        moving.err
    );
}

#[test]
fn predictive_controllers_run_and_become_code() {
    let folder = fitted();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let mpc = |more: &[&str]| run(&[&["control", "mpc", "model.json", "--setpoint", "x=0,y=0"], more].concat());
    let settings = ["--limits", "u_v=-0.5:0.5,u_w=-1:1", "--bounds", "w=-0.3:0.3", "--horizon", "25", "--json"];
    let made = mpc(&[&settings[..], &["-o", "plan.json"]].concat()).ok().json();
    assert_eq!((&made["kind"], &made["settings"]["horizon"]), (&serde_json::json!("mpc"), &serde_json::json!(25)));
    let shown = run(&["show", "plan.json"]).ok().out;
    for expected in ["predictive controller of the model", "plan: 25 samples (50.00 ms)", "w from -0.3000 to 0.3000"] {
        assert!(shown.contains(expected), "{expected}: {shown}");
    }
    let closed = |threads: &str, output: &str| {
        let arguments = ["rollout", "model.json", "run_2.csv", "--starts", "9", "--horizon", "1000", "--controller"];
        let more = ["plan.json", "--threads", threads, "--json", "-o", output];
        let report = run(&[&arguments[..], &more].concat()).ok().json();
        (report, fs::read_to_string(folder.path().join(output)).expect("trajectories"))
    };
    let one = closed("1", "one.csv");
    assert_eq!(one.0["driven_inputs"], serde_json::json!(["u_v", "u_w"]));
    assert!(closed("7", "seven.csv") == one, "7 threads");

    let report = run(&["export", "plan.json", "--to", "c", "--prefix", "plan", "-o", "src", "--json"]).ok().json();
    assert_eq!(report["files"].as_array().expect("files").len(), 3, "{report}");
    run(&["export", "plan.json", "--to", "python", "-o", "src"]).fails(&["predictive controllers are written as C"]);

    mpc(&["--horizon", "0"]).fails(&["horizon", "1 to 200"]);
    mpc(&["--bounds", "x=0.5:1"]).fails(&["set point x = 0", "widen the bounds"]);
    mpc(&["--bounds", "z=0:1"]).fails(&["no kept state `z`"]);
    mpc(&["--bounds", "x=1"]).fails(&["STATE=LOW:HIGH"]);
    run(&["control", "lqr", "model.json", "--setpoint", "x=0,y=0", "--horizon", "20"]).fails(&["control mpc"]);
}
