//! Logs of simulated robots from the command line: the same bytes on any number of threads, readable by other programs,
//! fitted by the recipe that lies beside them. Also refusals.

use std::{collections::BTreeMap, fs};

use fleetfoot::{Source, log::Selection};

use crate::runner::*;

/// A hexapod's runs, short and without the seconds before the log begins.
const SHORT: [&str; 4] = ["generate", "hexapod", "--set", "settle=0.1"];

fn generate(folder: &Path, arguments: &[&str]) -> Run {
    let all: Vec<&str> = SHORT.iter().chain(arguments).copied().collect();
    fleetfoot(folder, &all)
}

/// The files of a folder, by name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths.map(|path| (name(&path), fs::read(&path).unwrap())).collect()
}

/// A usage error: exit code 2, with these words.
fn misused(output: &Run, words: &[&str]) {
    assert_eq!(output.code, 2, "{}{}", output.out, output.err);
    for word in words {
        assert!(output.err.contains(word), "`{word}` is missing from: {}", output.err);
    }
}

#[test]
fn from_nothing_to_a_model() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let dry = ["--seconds", "1.5", "--runs", "3", "--speed", "0.1:0.3", "-o", "runs", "--dry-run", "--json"];
    let plan = generate(folder.path(), &dry).ok().json();
    assert!(!folder.path().join("runs").exists());
    let made = generate(folder.path(), &[&dry[..8], &["--json"]].concat()).ok().json();
    assert_eq!(plan["rows"], 4500);
    let speeds: Vec<f64> = (0..3).map(|run| made["runs"][run]["speed"].as_f64().unwrap()).collect();
    assert_eq!(speeds, [0.1, 0.2, 0.3]);
    for run in made["runs"].as_array().unwrap() {
        assert_eq!(run["rows"], 1500);
        assert_eq!(run["end"], "complete");
        assert!(run["excitation"]["log_determinant"].is_number(), "{run}");
    }
    let bytes: u64 = made["runs"].as_array().unwrap().iter().map(|run| run["bytes"].as_u64().unwrap()).sum();
    let ratio = plan["bytes"].as_f64().unwrap() / bytes as f64;
    assert!((0.7..1.4).contains(&ratio), "{ratio}");
    let names: Vec<String> = files(&folder.path().join("runs")).into_keys().collect();
    assert_eq!(names, ["hexapod_00.mcap", "hexapod_01.mcap", "hexapod_02.mcap", "robot.toml"]);

    let info = run(&["info", "runs/hexapod_00.mcap"]).out;
    for topic in ["/imu/data", "/joint_states", "/cmd_vel", "/mocap/pose", "/truth/odometry"] {
        assert!(info.contains(topic), "{info}");
    }
    let fit = run(&["fit", "pwa", "-c", "runs/robot.toml", "runs/", "--no-cache", "--folds", "0", "--json"]).json();
    assert_eq!(fit["targets"].as_array().unwrap().len(), 8);
    let errors: Vec<f64> =
        (0..8).map(|target| fit["candidates"][1]["mae_over_null"][target].as_f64().unwrap()).collect();
    assert!(errors.iter().sum::<f64>() < 8.0 * 0.97, "{errors:?}");
}

#[test]
fn bytes_depend_on_the_seed_only() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, more: &[&str]| {
        generate(folder.path(), &[&["--seconds", "0.5", "-o", name], more].concat()).ok();
        files(&folder.path().join(name))
    };
    let single = write("a", &["--runs", "3", "--threads", "1"]);
    assert!(single == write("b", &["--runs", "3", "--threads", "2"]));
    assert!(single == write("c", &["--runs", "3", "--threads", "7"]));
    let late = write("d", &["--first-run", "2", "--runs", "1"]);
    assert!(late["hexapod_02.mcap"] == single["hexapod_02.mcap"]);
    // A log has its world, from which its bytes are made again.
    let set = write("f", &["--set", "belt.speed=0.17", "--first-run", "5"]);
    let again = fleetfoot(
        folder.path(),
        &["generate", "hexapod", "--world", "f/hexapod_05.mcap", "--first-run", "5", "--seconds", "0.5", "-o", "g"],
    );
    again.ok();
    assert!(files(&folder.path().join("g"))["hexapod_05.mcap"] == set["hexapod_05.mcap"]);
    let other = write("e", &["--seed", "4"]);
    assert!(single["hexapod_00.mcap"] != other["hexapod_00.mcap"]);
}

#[test]
fn every_robot_goes_the_whole_way() {
    let folder = tempfile::tempdir().unwrap();
    for robot in fleetfoot::generate::robots() {
        for format in ["mcap", "parquet"] {
            let runs = format!("{robot}_{format}");
            let seconds = if robot == "aircraft" { "300" } else { "2" };
            let mut arguments = vec!["generate", robot, "-o", &runs, "--seconds", seconds, "--runs", "2"];
            arguments.extend(["--format", format, "--json"]);
            if robot == "hexapod" {
                arguments.extend(["--set", "settle=0.1"]);
            }
            let made = fleetfoot(folder.path(), &arguments).ok().json();
            assert!(made["runs"][1]["rows"].as_u64().unwrap() >= 150, "{made}");
            let recipe = format!("{runs}/robot.toml");
            let fit = ["fit", "pwa", "-c", &recipe, &runs, "--json", "--no-cache", "--folds", "0"];
            let fit = fleetfoot(folder.path(), &fit).ok().json();
            let errors = fit["candidates"][1]["mae_over_null"].as_array().unwrap();
            let mean = errors.iter().map(|error| error.as_f64().unwrap()).sum::<f64>() / errors.len() as f64;
            assert!(mean < 0.97, "{robot} {format}: {errors:?}");
        }
    }
}

#[test]
fn worlds_are_printed_read_and_refused() {
    let folder = tempfile::tempdir().unwrap();
    for robot in fleetfoot::generate::robots() {
        let printed = fleetfoot(folder.path(), &["generate", robot, "--print-world"]).ok().out;
        fs::write(folder.path().join("world.toml"), &printed).unwrap();
        let again = fleetfoot(folder.path(), &["generate", robot, "--print-world", "--world", "world.toml"]).ok().out;
        assert_eq!(printed, again);
        // Every parameter is explained, at its line or above it or above the table that it is in.
        for (number, line) in printed.lines().enumerate().filter(|(_, line)| line.contains(" = ")) {
            let above = printed.lines().nth(number.saturating_sub(1)).unwrap_or_default();
            let explained = line.contains("  # ") || above.starts_with('#') || line.starts_with("kind = ");
            assert!(explained || line.starts_with('#'), "{robot}: {line}");
        }
    }
    let refuse = |text: &str, words: &[&str]| {
        fs::write(folder.path().join("bad.toml"), text).unwrap();
        fleetfoot(folder.path(), &["generate", "hexapod", "--world", "bad.toml", "-o", "runs"]).fails(words);
    };
    refuse("[belt]\nsped = 0.3\n", &["bad.toml", "line 2", "sped", "did you mean `speed`?"]);
    refuse("[excitation.velocity]\nkind = \"sin\"\n", &["bad.toml", "`sine`"]);
    refuse("[excitation.velocity]\nkind = \"sine\"\namplitud = 1.0\n", &["amplitud", "`amplitude`"]);
    refuse("[belt]\nspeed = -1.0\n", &["belt.speed", "-1"]);
    refuse("[belt\n", &["line 1"]);
    fleetfoot(folder.path(), &["generate", "hexapod", "--world", "none.toml", "-o", "runs"]).fails(&["none.toml"]);
    fleetfoot(folder.path(), &["generate", "hexapod", "--set", "belt.sped=1", "-o", "runs"]).fails(&["`speed`"]);
    assert!(!folder.path().join("runs").exists());
}

#[test]
fn senseless_flags_are_usage_errors() {
    let folder = tempfile::tempdir().unwrap();
    let say = |arguments: &[&str]| fleetfoot(folder.path(), &[&["generate"], arguments].concat());
    misused(&say(&["hexapd", "-o", "runs"]), &["hexapod"]);
    misused(&say(&["hexapod"]), &["--output"]);
    misused(&say(&["hexapod", "-o", "runs", "--minutes", "1", "--seconds", "5"]), &["--seconds"]);
    misused(&say(&["hexapod", "-o", "runs", "--seconds", "0"]), &["above 0"]);
    misused(&say(&["hexapod", "-o", "runs", "--minutes", "nan"]), &["above 0"]);
    misused(&say(&["hexapod", "-o", "runs", "--runs", "0"]), &["--runs"]);
    misused(&say(&["hexapod", "-o", "runs", "--speed", "fast"]), &["0.1:0.5"]);
    misused(&say(&["hexapod", "-o", "runs", "--set", "belt.speed"]), &["KEY=VALUE"]);
    misused(&say(&["hexapod", "-o", "runs", "--excitation", "sinne"]), &["sine"]);
    misused(&say(&["hexapod", "-o", "runs", "--format", "parquet", "--no-truth"]), &["--no-truth"]);
    misused(&say(&["aircraft", "-o", "runs", "--speed", "0.3"]), &["--speed"]);
    misused(&say(&["aircraft", "-o", "runs", "--excitation", "prbs"]), &["--excitation"]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn folders_are_not_mixed_or_half_written() {
    let folder = tempfile::tempdir().unwrap();
    let brief = ["--seconds", "0.2", "-o", "runs"];
    generate(folder.path(), &[&brief[..], &["--runs", "3"]].concat()).ok();
    let before = files(&folder.path().join("runs"));
    generate(folder.path(), &brief).fails(&["hexapod_00.mcap", "--force"]);
    assert!(files(&folder.path().join("runs")) == before);
    generate(folder.path(), &[&brief[..], &["--force", "--seed", "9"]].concat()).ok();
    let names: Vec<String> = files(&folder.path().join("runs")).into_keys().collect();
    assert_eq!(names, ["hexapod_00.mcap", "robot.toml"]);

    // A file where the folder should be.
    fs::write(folder.path().join("taken"), "").unwrap();
    generate(folder.path(), &["--seconds", "0.2", "-o", "taken/runs"]).fails(&["taken"]);
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    // No file may be longer than 32 kB: every write beyond fails as it does on a full disk.
    let command = env!("CARGO_BIN_EXE_fleetfoot");
    let arguments = SHORT.map(|word| format!("'{word}'")).join(" ");
    let script = format!("trap '' XFSZ; ulimit -f 64; exec '{command}' {arguments} --seconds 3 --runs 2 -o runs");
    let output = Command::new("sh").args(["-c", &script]).current_dir(folder.path()).output().unwrap();
    let err = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{err}");
    assert!(err.contains("hexapod_0") && err.contains("write"), "{err}");
    assert!(!folder.path().join("runs").exists());
}

/// JSON is text, and names of files need not be: a path appears as in messages.
#[cfg(unix)]
#[test]
fn non_text_folders_are_printed() {
    use std::{ffi::OsStr, os::unix::ffi::OsStrExt};
    let folder = tempfile::tempdir().unwrap();
    let name = OsStr::from_bytes(b"r\xffns");
    let run = |words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_fleetfoot"));
        let output = command.current_dir(folder.path()).args(words).arg(name).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let flags = ["generate", "diffdrive", "--seconds", "1", "--runs", "1", "--json", "-o"];
    if fs::create_dir(folder.path().join(name)).is_err() {
        eprintln!("skipped: this file system takes only text for names");
        return;
    }
    let made = run(&flags);
    let shown = |value: &serde_json::Value| value.as_str().is_some_and(|path| path.starts_with("r\u{fffd}ns/"));
    assert!(shown(&made["runs"][0]["file"]) && shown(&made["recipe"]), "{made}");
    let info = run(&["info", "--json"]);
    assert!(shown(&info[0]["file"]), "{info}");
}

/// Content of a log as `mcap-ros2-support` reads it.
#[derive(Default)]
struct Contents {
    /// Messages and undecoded ones of each topic.
    topics: BTreeMap<String, (u64, u64)>,
    /// Values of each field.
    columns: BTreeMap<String, Vec<f64>>,
}

fn read_by_peer(path: &Path) -> Option<Contents> {
    let Some(python) = std::env::var_os("FLEETFOOT_PYTHON") else {
        eprintln!("skipped: FLEETFOOT_PYTHON does not name a Python with the packages of tests/peers/README.md");
        return None;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/peers/read_logs.py");
    let output = Command::new(python).arg(script).arg(path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut contents = Contents::default();
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        let json: serde_json::Value = serde_json::from_str(line).unwrap();
        assert!(json["damage"].is_null(), "{line}");
        if let Some(messages) = json["messages"].as_u64() {
            let name = json["topic"].as_str().unwrap().to_owned();
            contents.topics.insert(name, (messages, json["undecoded"].as_u64().unwrap()));
        } else if let Some(values) = json["values"].as_array() {
            let number = |value: &serde_json::Value| value.as_f64().unwrap_or(f64::NAN);
            contents.columns.insert(json["name"].as_str().unwrap().to_owned(), values.iter().map(number).collect());
        }
    }
    Some(contents)
}

#[test]
fn peers_read_messages_and_truth() {
    let folder = tempfile::tempdir().unwrap();
    let made = generate(folder.path(), &["--seconds", "2", "-o", "messages", "--json"]).ok().json();
    generate(folder.path(), &["--seconds", "2", "-o", "rows", "--format", "parquet"]).ok();
    let Some(Contents { topics, columns }) = read_by_peer(&folder.path().join("messages/hexapod_00.mcap")) else {
        return;
    };
    assert!(topics.values().all(|&(messages, undecoded)| messages > 0 && undecoded == 0), "{topics:?}");
    assert_eq!(
        topics.values().map(|&(messages, _)| messages).sum::<u64>(),
        made["runs"][0]["messages"].as_u64().unwrap()
    );
    for (topic, least) in [("/imu/data", 1990), ("/joint_states", 1990), ("/mocap/pose", 150), ("/cmd_vel", 190)] {
        assert!(topics[topic].0 >= least, "{topic}: {:?}", topics[topic]);
    }
    let rows = fleetfoot::log::open(
        &[folder.path().join("rows/hexapod_00.parquet")],
        &Selection::new(["x", "vz", "alpha_r", "u_v"]),
    )
    .unwrap();
    let block = rows.read(0, 0..2000, fleetfoot::Halo::default()).unwrap();
    for (field, column) in [
        ("/truth/odometry.pose.pose.position.x", "x"),
        ("/truth/odometry.twist.twist.linear.z", "vz"),
        ("/truth/cranks.position[1]", "alpha_r"),
        ("/truth/cmd_vel.twist.linear.x", "u_v"),
    ] {
        let values = columns.get(field).unwrap_or_else(|| panic!("{field} of {:?}", columns.keys()));
        assert!(values.as_slice() == block.core(rows.column_index(column).unwrap()), "{field}");
    }
}
