//! Several files of one run, a file a topic, joined by `[files]` of the recipe.

use std::fs;

use crate::runner::*;

const RECIPE: &str = r#"
[files]
imu = "imu*.csv"
odom = "odom.csv"
cmd = "cmd.csv"
[columns]
v = "odom.v"
a = "imu.ax"
[states]
v = { derivative = "a" }
[inputs]
u = "cmd.u"
"#;

/// The same with the columns of one file.
const BY_HAND: &str = r#"
[columns]
v = "odom_v"
a = "imu_ax"
[states]
v = { derivative = "a" }
[inputs]
u = "cmd_u"
"#;

/// Writes a run: `imu_0.csv` at 200 Hz, `odom.csv` at 50 Hz between its rows, `cmd.csv` at other times. Returns the
/// rows of joining them by hand.
fn write_run(folder: &Path, run: u32) -> String {
    let name = format!("run_{run}");
    fs::create_dir_all(folder.join("runs").join(&name)).unwrap();
    let (mut imu, mut odom, mut cmd) = (String::from("t,ax,gz\n"), String::from("stamp,x,v\n"), String::from("t,u\n"));
    let mut joined = String::from("t,odom_v,imu_ax,cmd_u\n");
    let speed = |t: f64| (0.9 * t + f64::from(run)).sin();
    let ax = |t: f64| (1.7 * t).cos() - 0.7 * speed(t);
    let commands: Vec<f64> = (0..70).map(|k| 0.13 * f64::from(k) + 0.01 * f64::from(k % 5)).collect();
    let u = |k: usize| f64::from((k * 7 % 11) as u32) - 5.0;
    for (k, t) in commands.iter().enumerate() {
        cmd += &format!("{t:.3},{}\n", u(k));
    }
    for k in 0..1600 {
        let t = 0.005 * f64::from(k);
        imu += &format!("{t:.3},{},{}\n", ax(t), t.sin());
        if k % 4 == 1 && k < 1597 {
            // Between two rows of the other file.
            let t = t + 0.0025;
            odom += &format!("{t:.4},{},{}\n", 2.0 * t, speed(t));
            let (low, high) = (0.005 * f64::from(k), 0.005 * f64::from(k + 1));
            let last = commands.iter().rposition(|&command| (1e3 * command).round() <= 1e3 * t).unwrap();
            joined += &format!("{t:.4},{},{},{}\n", speed(t), 0.5 * (ax(low) + ax(high)), u(last));
        }
    }
    for (file, text) in [("imu_0.csv", imu), ("odom.csv", odom), ("cmd.csv", cmd)] {
        fs::write(folder.join("runs").join(&name).join(file), text).unwrap();
    }
    fs::write(folder.join(format!("joined_{run}.csv")), &joined).unwrap();
    name
}

fn numbers(value: &serde_json::Value, into: &mut Vec<f64>) {
    match value {
        serde_json::Value::Number(number) => into.extend(number.as_f64()),
        serde_json::Value::Array(all) => all.iter().for_each(|value| numbers(value, into)),
        serde_json::Value::Object(all) => all.values().for_each(|value| numbers(value, into)),
        _ => {}
    }
}

#[test]
fn split_files_equal_one_joined_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    (0..2).for_each(|run| _ = write_run(folder, run));
    fs::write(folder.join("files.toml"), RECIPE).unwrap();
    fs::write(folder.join("one.toml"), BY_HAND).unwrap();
    let fit = |recipe: &str, data: &[&str], model: &str| {
        let words = ["fit", "pwa", "-c", recipe, "--partition", "average", "-o", model];
        fleetfoot(folder, &[&words[..], data].concat()).ok()
    };
    let output = fit("files.toml", &["runs"], "files.json");
    assert!(output.err.contains("one row per row of odom"), "{}", output.err);
    fit("one.toml", &["joined_0.csv", "joined_1.csv"], "one.json");
    let score = |model: &str, data: &[&str]| fleetfoot(folder, &[&["score", model, "--json"], data].concat()).ok();
    let files = score("files.json", &["runs"]).json();
    let joined = score("one.json", &["joined_0.csv", "joined_1.csv"]).json();
    assert!(files["rows"].as_u64().unwrap() > 700, "{files}");
    let (mut of_files, mut of_one) = (Vec::new(), Vec::new());
    numbers(&files, &mut of_files);
    numbers(&joined, &mut of_one);
    assert_eq!(of_files.len(), of_one.len());
    for (a, b) in of_files.iter().zip(&of_one) {
        assert!((a - b).abs() <= 1e-9 * b.abs().max(1.0), "{a} is not {b}: {files}\n{joined}");
    }
    // A model opens the files of a run by its own recipe; a run is one episode, called as its folder.
    fleetfoot(folder, &["predict", "files.json", "runs/run_1", "-o", "predicted.csv"]).ok();
    let predicted = fs::read_to_string(folder.join("predicted.csv")).unwrap();
    assert!(predicted.lines().nth(1).unwrap().starts_with("run_1,"), "{predicted:.200}");
    // Even rows, rows of another file, and a statistic whose logs are the runs.
    fleetfoot(folder, &["fit", "pwa", "-c", "files.toml", "runs/run_0", "--rate", "100", "-o", "even.json"]).ok();
    let by_imu = fleetfoot(folder, &["score", "files.json", "runs/run_0", "--base", "imu", "--json"]).ok().json();
    assert!(by_imu["rows"].as_u64().unwrap() > 1500, "{by_imu}");
    let scanned = fleetfoot(folder, &["scan", "-c", "files.toml", "runs", "-o", "runs.stats"]).ok();
    assert!(scanned.out.contains("2 files, 2 episodes"), "{}", scanned.out);
    // `prepare` writes one file a run.
    fleetfoot(folder, &["prepare", "-c", "files.toml", "runs", "-o", "clean"]).ok();
    assert!(folder.join("clean/run_1.clean.parquet").exists());
    let clean = ["fit", "pwa", "-c", "clean/robot.toml", "clean", "--partition", "average", "-o", "clean.json"];
    fleetfoot(folder, &clean).ok();
}

#[test]
fn incomplete_runs_are_refused_with_the_mend() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_run(folder, 0);
    let run = folder.join("runs/run_0");
    let fit = |recipe: &str, more: &[&str]| {
        fs::write(folder.join("robot.toml"), recipe).unwrap();
        let words = ["fit", "pwa", "-c", "robot.toml", "runs", "-o", "model.json"];
        fleetfoot(folder, &[&words[..], more].concat())
    };
    let changed = |from: &str, to: &str| fit(&RECIPE.replace(from, to), &[]);
    changed("odom.csv", "odo.csv").fails(&["run_0", "odom = \"odo.csv\"", "[files]", "`odom.csv`"]);
    changed("cmd.csv", "[ic]m*.csv").fails(&["imu_0.csv", "`imu`", "`cmd`", "[files]", "narrow"]);
    fs::copy(run.join("imu_0.csv"), run.join("imu_1.csv")).unwrap();
    fit(RECIPE, &[]).fails(&["run_0", "imu_0.csv", "imu_1.csv", "imu = \"imu*.csv\"", "[files]", "narrow the pattern"]);
    fs::rename(run.join("imu_1.csv"), run.join("notes.csv")).unwrap();
    let notes = fit(RECIPE, &[]).ok().err;
    assert!(notes.contains("notes.csv") && notes.contains("no pattern of [files]"), "{notes}");
    changed("imu.ax", "imu.az").fails(&["run_0", "[columns] a", "imu.az", "imu.ax"]);
    fit(RECIPE, &["--base", "imuu"]).fails(&["run_0", "imuu", "[files]", "`imu`, `odom`, `cmd`"]);
    fit(RECIPE, &["--dt", "0.1"]).fails(&["run_0", "[files]", "--dt"]);
    fs::create_dir(folder.join("runs/other")).unwrap();
    fs::copy(run.join("odom.csv"), folder.join("runs/other/odometry.csv")).unwrap();
    fit(RECIPE, &[]).fails(&["odometry.csv belongs to no run", "[files]"]);
    fs::remove_dir_all(folder.join("runs/other")).unwrap();
    let shifted = fs::read_to_string(run.join("cmd.csv")).unwrap();
    let shifted: String =
        shifted.lines().map(|line| if line == "t,u" { "t,u\n".into() } else { format!("9{line}\n") }).collect();
    fs::write(run.join("cmd.csv"), shifted).unwrap();
    fit(RECIPE, &[]).fails(&["run_0", "odom", "cmd", "do not overlap", "[files]", "share one clock"]);
    // Unless that clock is known.
    fit(&format!("{RECIPE}[clocks.computer]\ntopics = [\"cmd\"]\noffset = 90.0\n"), &[]).ok();
    // Without [files] the message leads to it.
    fit("[states]\nv = {}\n", &[]).fails(&["cmd.csv", "[states] v", "odom.csv has it", "[files]", "odom.v"]);
    fit("[states]\nu = {}\n", &[]).fails(&["imu_0.csv has none of the columns", "[files]", "imu_0 = \"imu_0.csv\""]);
}

/// `info` names files of one run, and `init` writes the recipe that joins them, which is ready for a fit.
#[test]
fn init_drafts_recipes_for_files() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    (0..2).for_each(|run| drop(write_run(folder, run)));
    fs::rename(folder.join("runs/run_1/imu_0.csv"), folder.join("runs/run_1/imu_1.csv")).unwrap();
    let info = fleetfoot(folder, &["info", "runs"]).ok().out;
    let words = ["files of 2 runs", "[files]", "imu = \"imu*.csv\"", "odom = \"odom.csv\"", "fleetfoot init runs -o"];
    assert!(words.iter().all(|word| info.contains(word)), "{info}");
    let info = fleetfoot(folder, &["info", "runs/run_0", "--values", "--json"]).ok().json();
    let note = info[0]["notes"].as_array().unwrap().last().unwrap().as_str().unwrap();
    assert!(note.contains("files of one run") && note.contains("imu = \"imu_0.csv\""), "{note}");
    let output = fleetfoot(folder, &["init", "runs", "-o", "draft.toml"]).ok();
    let draft = fs::read_to_string(folder.join("draft.toml")).unwrap();
    let section = "[files]\ncmd = \"cmd.csv\"\nimu = \"imu*.csv\"\nodom = \"odom.csv\"\n";
    assert!(draft.contains(section) && !output.err.contains("note:"), "{draft}{}", output.err);
    assert!(output.err.contains("read the draft of states and inputs, then run fleetfoot fit"), "{}", output.err);
    // States are where the robot is, inputs what it was told; the rows are those of the states.
    for line in
        ["odom_v = \"odom.v\"", "odom_v = {}", "odom_x = {}", "cmd_u = {}", "base = \"odom\"", "# ax = \"imu.ax\""]
    {
        assert!(
            draft.lines().any(|drafted| drafted == line || drafted.starts_with(&format!("{line} "))),
            "{line}: {draft}"
        );
    }
    assert!(!draft.contains("imu.t\"") && !draft.contains("odom.stamp"), "clocks are no columns: {draft}");
    let fit = ["fit", "pwa", "-c", "draft.toml", "-p", "average", "-o", "model.json"];
    let fitted = fleetfoot(folder, &[&fit[..], &["runs"]].concat()).ok();
    assert!(fitted.err.contains("wrote model.json"), "{}", fitted.err);
    let score = fleetfoot(folder, &["score", "model.json", "runs", "--json"]).ok().json();
    assert!(score["rows"].as_u64().unwrap() > 700, "{score}");
    // Files in subfolders of a run, and a file whose columns another one has too, are topics as any others.
    for run in ["run_0", "run_1"] {
        let at = |name: &str| folder.join("nested").join(run).join(name);
        ["imu", "drive"].iter().for_each(|name| fs::create_dir_all(at(name)).unwrap());
        let copy = |from: &str, to: &str| _ = fs::copy(folder.join("runs").join(run).join(from), at(to)).unwrap();
        copy(if run == "run_0" { "imu_0.csv" } else { "imu_1.csv" }, "imu/data.csv");
        copy("odom.csv", "odom.csv");
        copy("cmd.csv", "drive/data.csv");
        let echo = fs::read_to_string(at("odom.csv")).unwrap();
        let echo: String =
            echo.lines().map(|line| line.split(',').take(2).collect::<Vec<_>>().join(",") + "\n").collect();
        fs::write(at("echo.csv"), echo).unwrap();
    }
    let output = fleetfoot(folder, &["init", "nested", "-o", "nested.toml"]).ok();
    let draft = fs::read_to_string(folder.join("nested.toml")).unwrap();
    let lines = ["drive = \"drive/data.csv\"", "imu = \"imu/data.csv\"", "odom = \"odom.csv\"", "echo = \"echo.csv\""];
    assert!(lines.iter().all(|line| draft.lines().any(|drafted| drafted == *line)), "{draft}{}", output.err);
    fleetfoot(folder, &["fit", "pwa", "-c", "nested.toml", "-p", "average", "-o", "nested.json", "nested"]).ok();
    // Recordings of one kind in folders of their own, one of which has a column more, are no run.
    for (name, columns) in [("a", "t,x"), ("b", "t,x,y")] {
        fs::create_dir_all(folder.join("days").join(name)).unwrap();
        let row =
            |k: u32| (0..=columns.matches(',').count()).map(move |c| format!("{}", f64::from(k) * 0.1 + c as f64));
        let rows: String = (0..50).map(|k| row(k).collect::<Vec<_>>().join(",") + "\n").collect();
        fs::write(folder.join("days").join(name).join("log.csv"), format!("{columns}\n{rows}")).unwrap();
    }
    assert!(!fleetfoot(folder, &["init", "days"]).ok().out.contains("[files]"));
    // Files of the same columns are runs of one file; those whose clocks do not meet are no run.
    let output = fleetfoot(folder, &["init", "joined_0.csv", "joined_1.csv"]).ok();
    assert!(!output.out.contains("[files]") && output.err.contains("joined_0.csv and files like it"), "{}", output.err);
    assert!(!fleetfoot(folder, &["info", "joined_0.csv", "joined_1.csv"]).ok().out.contains("[files]"));
    let late = fs::read_to_string(folder.join("runs/run_0/cmd.csv")).unwrap();
    let late: Vec<String> =
        late.lines().map(|line| if line == "t,u" { line.into() } else { format!("9{line}") }).collect();
    fs::write(folder.join("runs/run_0/cmd.csv"), late.join("\n")).unwrap();
    let output = fleetfoot(folder, &["init", "runs/run_0"]).ok();
    assert!(!output.out.contains("[files]") && output.err.contains("overlapping clocks"), "{}", output.err);
}
