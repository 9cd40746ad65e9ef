//! Robots' logs (MCAP) from the command line: from a log with several channels to a model, and its predictions drawn
//! over the log. Also messages for channels that do not fit together.

use std::fs;

use fleetfoot::{
    message::write::{Float64MultiArray, Header, JointState, Odometry, Time, Twist},
    output::{McapOptions, McapWriter},
};

use crate::runner::*;

/// Nanoseconds of the first message's log time, and the lag of the headers' simulated clock.
const LOG_START: i64 = 1_790_000_000_000_000_000;
const OFFSET: i64 = LOG_START - 5_000_000_000;
/// Rate of change of the speeds towards the commanded ones, 1/s.
const GAINS: [f64; 2] = [2.0, 5.0];

/// Options of a written log.
#[derive(Clone, Copy)]
struct Robot {
    prefix: &'static str,
    seconds: usize,
    seed: u64,
    zero_headers: bool,
}

const ROBOT: Robot = Robot { prefix: "", seconds: 60, seed: 1, zero_headers: false };

/// A robot whose speeds follow commands, as `/odom` at 50 Hz with headers in simulated seconds, `/cmd_vel` at 10 Hz without headers, and
/// `/joint_states` with wheels whose order changes.
fn write_log(path: &Path, robot: Robot) {
    let mut writer = McapWriter::create(path, &McapOptions::default()).unwrap();
    let odom = writer.channel::<Odometry<'_>>(&format!("{}/odom", robot.prefix)).unwrap();
    let command = writer.channel::<Twist>(&format!("{}/cmd_vel", robot.prefix)).unwrap();
    let joints = writer.channel::<JointState<'_>>(&format!("{}/joint_states", robot.prefix)).unwrap();
    let (mut x, mut y, mut yaw, mut speeds) = (0.0, 0.0, 0.0_f64, [0.0, 0.0]);
    let (mut goal, mut random) = ([0.0, 0.0], robot.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15));
    let mut uniform = move || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    for step in 0..robot.seconds * 50 {
        let log = LOG_START + step as i64 * 20_000_000;
        if step % 5 == 0 {
            goal = [uniform(), 2.0 * uniform()];
            writer
                .write(command, log, log, &Twist { linear: [goal[0], 0.0, 0.0], angular: [0.0, 0.0, goal[1]] })
                .unwrap();
        }
        let stamp = if robot.zero_headers { 0 } else { log - OFFSET };
        let header = Header { stamp: Time::from_nanoseconds(stamp).unwrap(), frame_id: "odom" };
        let mut message = Odometry { header, child_frame_id: "base_link", ..Odometry::default() };
        message.pose.position = [x, y, 0.0];
        message.pose.orientation = [0.0, 0.0, (yaw / 2.0).sin(), (yaw / 2.0).cos()];
        message.twist = Twist { linear: [speeds[0], 0.0, 0.0], angular: [0.0, 0.0, speeds[1]] };
        writer.write(odom, log, log, &message).unwrap();
        let (left, right) = (speeds[0] - 0.1 * speeds[1], speeds[0] + 0.1 * speeds[1]);
        let (name, velocity) =
            if step % 2 == 0 { (["left", "right"], [left, right]) } else { (["right", "left"], [right, left]) };
        writer
            .write(joints, log, log, &JointState { header, name: &name, velocity: &velocity, ..JointState::default() })
            .unwrap();
        // Forward differences of these are exactly the law.
        (x, y, yaw) = (x + 0.02 * speeds[0] * yaw.cos(), y + 0.02 * speeds[0] * yaw.sin(), yaw + 0.02 * speeds[1]);
        for (speed, (goal, gain)) in speeds.iter_mut().zip(goal.iter().zip(GAINS)) {
            *speed += 0.02 * gain * (goal - *speed);
        }
    }
    writer.finish().unwrap();
}

const RECIPE: &str = r#"
[columns]
x = "/odom.pose.pose.position.x"
y = "/odom.pose.pose.position.y"
yaw = "yaw(/odom.pose.pose.orientation)"
v = "/odom.twist.twist.linear.x"
w = "/odom.twist.twist.angular.z"
[states]
x = { known = "v*cos(yaw)", regressor = false }
y = { known = "v*sin(yaw)", regressor = false }
yaw = { known = "w", kind = "angle", regressor = false }
v = { derivative = "forward" }
w = { derivative = "forward" }
[inputs]
uv = "/cmd_vel.linear.x"
uw = "/cmd_vel.angular.z"
"#;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_log(&folder.path().join("run.mcap"), ROBOT);
    write_log(&folder.path().join("test.mcap"), Robot { seed: 2, seconds: 30, ..ROBOT });
    fs::write(folder.path().join("robot.toml"), RECIPE).unwrap();
    folder
}

#[test]
fn robot_logs_become_models_and_messages() {
    let folder = folder();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();

    let info = run(&["info", "run.mcap", "--json"]).json();
    let topics = info[0]["topics"].as_array().unwrap();
    let odom = topics.iter().find(|topic| topic["name"] == "/odom").unwrap();
    assert_eq!((odom["messages"].as_u64(), odom["type"].as_str()), (Some(3000), Some("nav_msgs/msg/Odometry")));
    assert!((odom["rate"].as_f64().unwrap() - 50.0).abs() < 1e-6);
    assert!((odom["header_offset"]["first"].as_f64().unwrap() - OFFSET as f64 * 1e-9).abs() < 1e-3);
    let values = run(&["info", "run.mcap", "--values"]).out;
    assert!(values.contains("/joint_states.velocity[left]") && values.contains("/cmd_vel.linear.x"), "{values}");

    let starter = run(&["init", "run.mcap"]).out;
    assert!(
        starter.contains("# v = \"/odom.twist.twist.linear.x\"") && starter.contains("/cmd_vel.angular.z"),
        "{starter}"
    );

    let plan = run(&["fit", "pwa", "-c", "robot.toml", "run.mcap", "-p", "average", "--dry-run", "--json"]).json();
    assert_eq!((plan["rows"].as_u64(), plan["cached"].as_bool()), (Some(3000), Some(false)));
    // One description of what is read stands in all of them, what must be decoded included.
    for method in ["sparse", "sindy"] {
        let other = run(&["fit", method, "-c", "robot.toml", "run.mcap", "--dry-run", "--json"]).json();
        for key in ["files", "episodes", "rows", "decoded_bytes", "cached"] {
            assert_eq!(other[key], plan[key], "{method} {key}");
        }
        let text = run(&["fit", method, "-c", "robot.toml", "run.mcap", "--dry-run"]).out;
        assert!(text.contains("at most 3000 rows") && text.contains("one pass to decode them"), "{text}");
    }

    // The commands have no header: the log's clock is taken, with a note.
    let fit = run(&["fit", "pwa", "-c", "robot.toml", "run.mcap", "-p", "average", "-o", "model.json"]);
    assert!(fit.err.contains("/cmd_vel has no header"), "{}", fit.err);
    let model = run(&["show", "model.json", "--json"]).json();
    let text = model.to_string();
    let score = run(&["score", "model.json", "test.mcap", "--json"]).json();
    for target in 0..2 {
        let r2 = score["targets"][target]["r2"].as_f64().or(score["targets"][target]["r2"][0].as_f64()).unwrap();
        assert!(r2 > 1.0 - 1e-9, "{r2} {text}");
    }

    let rollout = run(&[
        "rollout",
        "model.json",
        "test.mcap",
        "--horizon",
        "40",
        "--starts",
        "20",
        // As the recording was made.
        "--method",
        "euler",
        "-o",
        "rollout.mcap",
        "--json",
    ]);
    assert!(rollout.json()["model"]["mahalanobis"].as_array().unwrap().last().unwrap()[0].as_f64().unwrap() < 1e-9);
    run(&["predict", "model.json", "test.mcap", "-o", "predicted.mcap"]);
    // The written file is a log itself, in the time of the recording.
    let info = run(&["info", "predicted.mcap", "--json"]).json();
    let predicted = info[0]["topics"].as_array().unwrap().iter().find(|t| t["name"] == "/fleetfoot/predicted").unwrap();
    // The last command came at 29.9 s: what is held ends there.
    assert_eq!(predicted["messages"], 1496);
    assert_eq!(predicted["start"].as_i64(), Some(LOG_START));
    let values = run(&["info", "rollout.mcap", "--values"]).out;
    assert!(values.contains("/fleetfoot/rollout/0.position[yaw]"), "{values}");
}

#[test]
fn fields_can_be_states_by_name() {
    let folder = folder();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let states = "/odom.twist.twist.linear.x,/joint_states.velocity[left]";
    run(&["fit", "pwa", "run.mcap", "--states", states, "-p", "kmeans:2", "-o", "model.json"]);
    let score = run(&["score", "model.json", "test.mcap", "--json"]).json();
    assert_eq!(score["rows"], 1498);
    assert!(run(&["show", "model.json"]).out.contains("/joint_states.velocity[left]"));
    let text = ["--states", "/odom.twist.twist.linear.x", "--inputs", "/odom.header.frame_id", "-o", "text.json"];
    fleetfoot(folder.path(), &[&["fit", "pwa", "run.mcap"][..], &text].concat()).fails(&[
        "run.mcap",
        "the input `/odom.header.frame_id`",
        "\"odom\" in row 1",
    ]);
    run(&["rollout", "model.json", "test.mcap", "--horizon", "5", "--starts", "9", "-o", "r.parquet"]);
}

#[test]
fn mixed_clocks_are_refused_with_the_mend() {
    let folder = folder();
    let fit = |arguments: &[&str]| {
        let mut all = vec!["fit", "pwa", "run.mcap", "-p", "average"];
        all.extend(arguments);
        fleetfoot(folder.path(), &all)
    };
    fit(&["-c", "robot.toml", "--stamp", "header"]).fails(&["/cmd_vel", "no header stamp", "log"]);
    fit(&["-c", "robot.toml", "--time", "t"]).fails(&["its own clock", "header"]);
    fit(&["-c", "robot.toml", "--dt", "0.1"]).fails(&["its own clock", "rate"]);
    fit(&["--states", "/odom.twist.twist.linear.x,/odom.twist.twist.linaer.y"]).fails(&["linear.y"]);
    fit(&["--states", "/odomm.twist.twist.linear.x"]).fails(&["/odom"]);
    fit(&["--states", "/joint_states.velocity[lefft]"]).fails(&["left"]);

    write_log(&folder.path().join("zero.mcap"), Robot { zero_headers: true, seconds: 5, ..ROBOT });
    let states = ["--states", "/odom.twist.twist.linear.x"];
    let mut zero = vec!["fit", "pwa", "zero.mcap", "-p", "average", "--stamp", "header"];
    zero.extend(states);
    fleetfoot(folder.path(), &zero).fails(&["/odom", "not filled in", "log"]);
    zero.truncate(5);
    zero.extend(states);
    let output = fleetfoot(folder.path(), &zero).ok();
    // One file would go by its headers, the other by the log's clock.
    zero.insert(3, "run.mcap");
    fleetfoot(folder.path(), &zero).fails(&["run.mcap", "zero.mcap", "header", "stamp = \"log\""]);
    assert!(output.err.contains("headers of /odom are not filled in"), "{}", output.err);
}

#[test]
fn wildcards_renames_rates_and_the_cache() {
    let folder = folder();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let recipe = "[columns]\nwheel = \"/joint_states.velocity[*]\"\n[states]\nwheel = {}\n";
    fs::write(folder.path().join("wheels.toml"), recipe).unwrap();
    let fit = run(&[
        "fit",
        "pwa",
        "-c",
        "wheels.toml",
        "run.mcap",
        "-p",
        "average",
        "--stamp",
        "header",
        "--cache",
        "kept",
        "--json",
        "-o",
        "wheels.json",
    ]);
    let targets = fit.json()["targets"].to_string();
    assert!(targets.contains("wheel[left]") && targets.contains("wheel[right]"), "{targets}");
    let kept = || fs::read_dir(folder.path().join("kept")).unwrap().count();
    assert_eq!(kept(), 1);
    let again = run(&["score", "wheels.json", "run.mcap", "--cache", "kept", "--json"]).json();
    assert_eq!(kept(), 1);
    assert_eq!(again, run(&["score", "wheels.json", "run.mcap", "--no-cache", "--json"]).json());

    // The same robot under another name.
    write_log(&folder.path().join("second.mcap"), Robot { prefix: "/robot2", seed: 3, seconds: 20, ..ROBOT });
    fleetfoot(folder.path(), &["score", "wheels.json", "second.mcap"]).fails(&["/joint_states"]);
    let renamed =
        run(&["score", "wheels.json", "second.mcap", "--rename", "/joint_states=/robot2/joint_states", "--json"])
            .json();
    assert_eq!(renamed["rows"], 998);

    let even = run(&[
        "fit",
        "pwa",
        "-c",
        "robot.toml",
        "run.mcap",
        "-p",
        "average",
        "--rate",
        "25",
        "-o",
        "even.json",
        "--json",
    ]);
    let rows = even.json()["rows"].as_u64().unwrap();
    assert!((1490..=1500).contains(&rows), "{rows}");
    for more in [&["--dry-run"][..], &[]] {
        let arguments = ["fit", "pwa", "-c", "robot.toml", "run.mcap", "-p", "average", "--rate", "1000000"];
        fleetfoot(folder.path(), &[&arguments, more].concat()).fails(&[
            "1000000 rows a second",
            "50 samples a second",
            "up to 5000",
        ]);
    }
}

/// Messages without a header that say in a field of theirs, in microseconds, when they were measured: up to 40 ms before they were recorded.
#[test]
fn message_fields_can_be_clocks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut writer = McapWriter::create(path.join("px.mcap"), &McapOptions::default()).unwrap();
    let state = writer.channel::<Twist>("/fmu/out/state").unwrap();
    let command = writer.channel::<Twist>("/fmu/in/command").unwrap();
    let other = writer.channel::<Odometry<'_>>("/odom").unwrap();
    let (mut v, mut late) = (0.0_f64, 0);
    for step in 0..2000_i64 {
        let measured = 7_000_000 + step * 10_000;
        let u = (0.05 * step as f64).sin() + 0.3 * (0.011 * step as f64).cos();
        // The log's clock jitters, the measurement's does not; never out of order.
        late = (late + 7_919 * (step % 13)) % 9_000;
        let log = LOG_START + (measured + late) * 1000;
        let message = |x: f64| Twist { linear: [x, 0.0, measured as f64], angular: [0.0; 3] };
        writer.write(command, log, log, &message(u)).unwrap();
        writer.write(state, log, log, &message(v)).unwrap();
        writer.write(other, log, log, &Odometry::default()).unwrap();
        v += 0.01 * (3.0 * u - 2.0 * v);
    }
    writer.finish().unwrap();
    let recipe = "[columns]\nv = \"/fmu/out/state.linear.x\"\n[states]\nv = { derivative = \"forward\" }\n[inputs]\nu = \"/fmu/in/command.linear.x\"\n";
    fs::write(path.join("r.toml"), recipe).unwrap();
    let fit = ["fit", "pwa", "-c", "r.toml", "px.mcap", "-p", "average"];
    let run = |more: &[&str]| fleetfoot(path, &[&fit[..], more].concat());
    let output = run(&["--time", "/fmu/out/state.linear.z"]).ok();
    assert!(output.err.contains("`linear.z` of every channel, in us"), "{}", output.err);
    let of_model = || fleetfoot(path, &["show", "model.json", "--json"]).ok().json();
    let model = of_model();
    let number = |model: &serde_json::Value, at: &str| model.pointer(at).unwrap().as_f64().unwrap();
    assert!((number(&model, "/model/step") - 0.01).abs() < 1e-12);
    for (place, expected) in [(0, -2.0), (1, 3.0)] {
        let coefficient = number(&model, &format!("/model/latents/0/coefficients/0/{place}"));
        assert!((coefficient - expected).abs() < 1e-6, "{coefficient} for {expected}");
    }
    // The model knows its clock; the log's own would have jittered.
    fleetfoot(path, &["score", "model.json", "px.mcap"]).ok();
    run(&[]).ok();
    assert!((number(&of_model(), "/model/latents/0/coefficients/0/1") - 3.0).abs() > 1e-3);
    run(&["--time", "/fmu/out/state.linear.z", "--time-unit", "us"]).ok();
    run(&["--time", "/fmu/out/state.nothing"]).fails(&["/fmu/", "nothing", "clock"]);
    run(&["--time", "linear.z"]).fails(&["its own clock"]);
    run(&["--time", "/fmu/out/state.linear.z", "--inputs", "/odom.twist.twist.linear.x"]).fails(&["/odom", "linear.z"]);
}

/// Messages in groups of four, 10 ms apart, with 80 ms between groups: rows and joins go on across them. Where a join bridges too little, the message names the
/// column and the key.
#[test]
fn messages_in_groups_keep_their_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut writer = McapWriter::create(path.join("run.mcap"), &McapOptions::default()).unwrap();
    let state = writer.channel::<Twist>("/state").unwrap();
    let command = writer.channel::<Twist>("/command").unwrap();
    let rare = writer.channel::<Twist>("/rare").unwrap();
    let (mut v, mut ms) = (0.0_f64, 0);
    for step in 0..1200_i64 {
        let u = (0.3 * step as f64).sin() + 0.3 * (0.11 * step as f64).cos();
        let (of_state, of_command) = (LOG_START + ms * 1_000_000, LOG_START + (ms - 3) * 1_000_000);
        writer.write(command, of_command, of_command, &Twist { linear: [u, 0.0, 0.0], angular: [0.0; 3] }).unwrap();
        if step < 6 {
            writer.write(rare, of_state, of_state, &Twist { linear: [u, 0.0, 0.0], angular: [0.0; 3] }).unwrap();
        }
        writer.write(state, of_state, of_state, &Twist { linear: [v, 0.0, 0.0], angular: [0.0; 3] }).unwrap();
        let wait = if step % 4 == 3 { 80 } else { 10 };
        v += 1e-3 * wait as f64 * (3.0 * u - 2.0 * v);
        ms += wait;
    }
    writer.finish().unwrap();
    let recipe = "[columns]\nv = \"/state.linear.x\"\n[states]\nv = { derivative = \"forward\" }\n[inputs]\nu = \"/command.linear.x\"\n";
    fs::write(path.join("r.toml"), recipe).unwrap();
    let fit = |recipe: &str, more: &[&str]| {
        fleetfoot(path, &[&["fit", "pwa", "-c", recipe, "run.mcap", "-p", "average", "--json"][..], more].concat())
    };
    let rows = fit("r.toml", &[]).ok().json()["rows"].as_u64().unwrap();
    assert!(rows >= 1190, "{rows}");
    fs::write(
        path.join("short.toml"),
        format!("{recipe}[join]\n\"/command.linear.x\" = {{ kind = \"linear\", max_gap = 0.001 }}\n"),
    )
    .unwrap();
    fit("short.toml", &[]).fails(&[
        "`/command.linear.x` is missing in 1200 of 1200 rows",
        "max_gap = SECONDS",
        "--base /command",
    ]);
    // `fit sparse` and `scan` say so as well; `fit sparse` also where a few rows are complete.
    let tasks = "[latents]\nf = { functions = [\"v\", \"u\"] }\n[tasks]\nfirst = { target = \"v\", right = \"f\" }\n";
    let sparse = |column: &str, more: &str| {
        let recipe = format!("[columns]\nv = \"/state.linear.x\"\nu = \"{column}\"\n{tasks}{more}");
        fs::write(path.join("sparse.toml"), recipe).unwrap();
        fleetfoot(path, &["fit", "sparse", "-c", "sparse.toml", "run.mcap", "--base", "/state", "-o", "s.json"])
    };
    let short = "[join]\n\"/command.linear.x\" = { kind = \"linear\", max_gap = 0.001 }\n";
    let words = ["`/command.linear.x` is missing in 1200 of 1200 rows", "max_gap = SECONDS", "--base /command"];
    sparse("/command.linear.x", short).fails(&words);
    fleetfoot(path, &["scan", "-c", "sparse.toml", "run.mcap", "--base", "/state", "-o", "s.stats"]).fails(&words);
    sparse("/rare.linear.x", "").fails(&[
        "fold",
        "`/rare.linear.x` is missing in 119",
        "max_gap = SECONDS",
        "--base /rare",
    ]);
    // A pattern of [join] that matches nothing gets a note, one of a field that is not read does not.
    for (pattern, words) in [
        ("/command.*", &["[join] \"/command.*\" matches no field", "one part between dots", "`/command.linear.x`"][..]),
        ("/comand.linear.x", &["[join] \"/comand.linear.x\" matches no field", "did you mean `/command.linear.x`"]),
        ("/command.angular.*", &[]),
    ] {
        fs::write(path.join("idle.toml"), format!("{recipe}[join]\n\"{pattern}\" = \"linear\"\n")).unwrap();
        let output =
            fleetfoot(path, &["fit", "pwa", "-c", "idle.toml", "run.mcap", "-p", "average", "-o", "m.json"]).ok();
        assert!(words.iter().all(|word| output.err.contains(word)), "{}", output.err);
        assert_eq!(output.err.matches("matches no field").count(), usize::from(!words.is_empty()), "{}", output.err);
    }
    let lags =
        ["fit", "pwa", "run.mcap", "--predict", "/state.linear.x", "--lags", "4", "-p", "average", "--max-gap", "0.05"];
    fleetfoot(path, &lags).fails(&["1200 rows into 300 episodes", "--max-gap SECONDS"]);
}

/// A load cell whose array has 120 elements: `info` lists its name, and its elements can be named alone, in aliases and
/// by `[*]`.
#[test]
fn elements_of_long_arrays_can_be_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut writer = McapWriter::create(path.join("run.mcap"), &McapOptions::default()).unwrap();
    let load = writer.channel::<Float64MultiArray<'_>>("/load_cell_data").unwrap();
    for row in 0..200 {
        let (log, t) = (LOG_START + row * 10_000_000, 0.01 * row as f64);
        let mut data = vec![t; 120];
        (data[0], data[119]) = ((-t).exp(), 1.0);
        writer.write(load, log, log, &Float64MultiArray { data: &data, ..Float64MultiArray::default() }).unwrap();
    }
    writer.finish().unwrap();
    let text = fleetfoot(path, &["info", "run.mcap"]).ok().out;
    assert!(text.contains("e.g. /load_cell_data.data[0]"), "{text}");
    // x' = -x, by the field and by an alias.
    let field =
        fleetfoot(path, &["fit", "pwa", "run.mcap", "--states", "/load_cell_data.data[0]", "--partition", "average"]);
    field.ok();
    let recipe = "[columns]\nf = \"2 * /load_cell_data.data[0]\"\nq = \"/load_cell_data.data[*]\"\n[states]\nf = {}\n";
    fs::write(path.join("r.toml"), recipe).unwrap();
    fleetfoot(path, &["fit", "pwa", "-c", "r.toml", "run.mcap", "--partition", "average"]).ok();
    let none =
        fleetfoot(path, &["fit", "pwa", "run.mcap", "--states", "/load_cell_data.data[120]", "--partition", "average"]);
    none.fails(&["data[120]"]);
}
