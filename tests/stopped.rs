//! Signals: the end of a command, its delay, and its remains.
#![cfg(unix)]

use std::{
    fs,
    time::{Duration, Instant},
};

use crate::runner::*;

/// Names in a folder, hidden files too, in order.
fn names(folder: &Path) -> Vec<String> {
    let name =
        |entry: std::io::Result<fs::DirEntry>| entry.expect("an entry").file_name().to_string_lossy().into_owned();
    let mut names: Vec<String> = fs::read_dir(folder).expect("a folder").map(name).collect();
    names.sort();
    names
}

const RECIPE: &str = "[columns]\nv = \"v [m/s]\"\n[states]\nx = {}\nv = {}\n[inputs]\nu = \"u\"\n[latents]\nf = { of = [\"v\", \"u\"], degree = 2 }\n[tasks]\nd = { target = \"dv\", right = \"f\" }\n";

fn folder(rows: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("log.csv"), robot_csv(rows, 0.3)).expect("a log");
    let (plain, _) = RECIPE.split_once("[latents]").expect("latents");
    for (name, text) in [("r.toml", RECIPE), ("plain.toml", plain)] {
        fs::write(folder.path().join(name), text).expect("a recipe");
    }
    folder
}

/// Jobs that take a minute and more.
const JOBS: [&str; 6] = [
    "resimulate m.json log.csv --iterations 1000000",
    "fit narx log.csv --outputs x,dv --inputs u --lags-out 12 --lags-in 12 --degree 3 -o n.json",
    "fit pwa -c plain.toml log.csv --predict next -p kmeans:100 --stable -o s.json",
    "fit pwa -c plain.toml log.csv --lags 200 -p kmeans:5 -o s.json",
    "fit sindy -c plain.toml log.csv --library fourier(200) -o s.json",
    "fit sindy -c plain.toml log.csv --degree 9 --library poly(9),fourier(20),poly(3)*fourier(5) -o s.json",
];

/// When it is stopped.
const BEGUN: Duration = Duration::from_secs(2);

/// Half a second where the machine is its own; the tests' build is slower, and so is a machine that others share.
const SOON: Duration = Duration::from_secs(10);

#[test]
fn ctrl_c_ends_every_command_soon() {
    let folder = folder(3000);
    let path = folder.path();
    fleetfoot(path, &["fit", "pwa", "-c", "r.toml", "log.csv", "--predict", "next", "-p", "average", "-o", "m.json"])
        .ok();
    let before = names(path);
    let mut waited = Vec::new();
    for command in JOBS {
        let arguments: Vec<&str> = command.split(' ').collect();
        let mut running = Running::start(path, &arguments);
        std::thread::sleep(BEGUN);
        assert!(!running.has_ended(), "`{command}` is done before it is stopped: give it more to do");
        running.signal("INT");
        let begin = Instant::now();
        let output = running.end(Duration::from_secs(120));
        waited.push(format!("{:.2} s {command}", begin.elapsed().as_secs_f64()));
        assert!(begin.elapsed() < SOON, "{}", waited.join("\n"));
        assert_eq!(output.code, 130, "{command}: {}", output.err);
        assert!(output.err.contains("stopped"), "{}", output.err);
        assert_eq!(names(path), before, "{command}");
    }
    println!("{}", waited.join("\n"));
}

#[test]
fn every_signal_leaves_the_folder_unchanged() {
    for (signal, command) in [
        ("TERM", "generate diffdrive --seconds 600 --runs 8 -o runs"),
        ("HUP", "generate diffdrive --seconds 600 --runs 8 -o runs"),
        ("TERM", "scan -c r.toml log.csv --dt 0.01 -o log.stats"),
        ("TERM", "fit pwa -c r.toml log.csv -p kmeans:2..50 --keep-all -o m.json"),
        ("HUP", "prepare -c r.toml log.csv -o clean"),
        ("TERM", "fit sparse -c r.toml log.csv --bolasso chunks:5000 --keep k.stats --frequencies f.parquet -o s.json"),
    ] {
        let folder = folder(60_000);
        let before = names(folder.path());
        let mut stopped = 0;
        for milliseconds in [100, 300, 900] {
            let mut running = Running::start(folder.path(), &command.split(' ').collect::<Vec<_>>());
            std::thread::sleep(Duration::from_millis(milliseconds));
            if running.has_ended() {
                break;
            }
            running.signal(signal);
            let output = running.end(Duration::from_secs(60));
            if output.code == 0 {
                break;
            }
            stopped += 1;
            assert_eq!(output.code, 130, "{signal} {command}: {}", output.err);
            // A scan keeps its complete part, with a note.
            let mut after = names(folder.path());
            after.retain(|name| !(name == "log.stats.partial" && output.err.contains("log.stats.partial")));
            assert_eq!(after, before, "{signal} after {milliseconds} ms: {command}");
        }
        assert!(stopped > 0, "`{command}` is done before it is stopped: give it more to do");
    }
}

#[test]
fn leftovers_of_killed_commands_are_removed() {
    let folder = folder(3000);
    let path = folder.path();
    let generate = "generate diffdrive --seconds 600 --runs 4 -o runs";
    let mut running = Running::start(path, &generate.split(' ').collect::<Vec<_>>());
    let begin = Instant::now();
    let staged =
        || path.join("runs").exists() && names(&path.join("runs")).iter().any(|name| name.starts_with(".generating-"));
    while !staged() {
        assert!(!running.has_ended() && begin.elapsed() < Duration::from_secs(60), "it never began");
    }
    running.signal("KILL");
    running.end(Duration::from_secs(60));
    assert!(staged(), "a kill leaves them");
    let output = fleetfoot(path, &["generate", "diffdrive", "--seconds", "1", "-o", "runs"]).ok();
    assert!(output.err.contains("removed") && output.err.contains(".generating-"), "{}", output.err);
    assert_eq!(names(&path.join("runs")), ["diffdrive_00.mcap", "robot.toml"]);
}

#[test]
fn a_hangup_that_is_ignored_stops_nothing() {
    let folder = folder(20_000);
    let script = "trap '' HUP; exec \"$0\" fit pwa -c r.toml log.csv -p kmeans:2..12 -o m.json";
    let shell = ["-c", script, env!("CARGO_BIN_EXE_fleetfoot")];
    let mut child = Command::new("sh").current_dir(folder.path()).args(shell).spawn().expect("a shell");
    std::thread::sleep(Duration::from_millis(300));
    if child.try_wait().expect("a child").is_none() {
        assert!(Command::new("kill").args(["-HUP", &child.id().to_string()]).status().expect("kill").success());
    }
    assert!(child.wait().expect("a child").success());
    assert!(folder.path().join("m.json").exists());
}
