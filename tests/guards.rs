//! Refusals and warnings in place of a wrong answer: outputs that would destroy a file, models for other rows, values
//! that are none.

use std::{fmt::Write, fs};

use crate::runner::*;

fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

const RECIPE: &str = "[columns]\nv = \"v [m/s]\"\n[states]\nv = {}\n[inputs]\nu = \"u\"\n";

const FIT: [&str; 5] = ["fit", "pwa", "-c", "r.toml", "log.csv"];

/// A fit of one region, unless `more` names partitions: the guards are the same for all, and refined regions take
/// seconds.
fn fit(folder: &Path, more: &[&str]) -> Run {
    let partition: &[&str] = if more.contains(&"-p") { &[] } else { &["-p", "average"] };
    fleetfoot(folder, &[&FIT[..], partition, more].concat())
}

/// `t [s], y, u` with `y[k+1] = 0.9 y[k] + u[k]`, rows of `dt`.
fn first_order(rows: usize, dt: f64, phase: f64) -> String {
    let (mut text, mut y) = (String::from("t [s],y,u\n"), 0.0);
    for row in 0..rows {
        let u = (0.37 * row as f64 + phase).sin() + 0.5 * (0.11 * row as f64).cos();
        writeln!(text, "{},{y},{u}", row as f64 * dt).unwrap();
        y = 0.9 * y + u;
    }
    text
}

/// Changes a row of a CSV, counted from 1, in the column of this place.
fn with_cell(text: &str, row: usize, column: usize, cell: &str) -> String {
    let change = |(at, line): (usize, &str)| {
        let mut cells: Vec<&str> = line.split(',').collect();
        if at == row {
            cells[column] = cell;
        }
        cells.join(",") + "\n"
    };
    text.lines().enumerate().map(change).collect()
}

#[test]
fn inputs_are_never_outputs() {
    let folder = folder(&[("log.csv", &robot_csv(400, 0.0)), ("r.toml", RECIPE)]);
    let path = folder.path();
    fit(path, &["-o", "r.toml"]).fails(&["r.toml", "input"]);
    fit(path, &["-o", "sub/../r.toml"]).fails(&["sub"]);
    fit(path, &[]).ok();
    fleetfoot(path, &["predict", "model.json", "log.csv", "-o", "model.json"]).fails(&["model.json"]);
    fleetfoot(path, &["init", "log.csv", "-o", "log.csv", "--force"]).fails(&["log.csv", "input"]);
    fleetfoot(path, &["fit", "sindy", "-c", "r.toml", "log.csv", "-o", "r.toml"]).fails(&["r.toml", "input"]);
    fleetfoot(path, &["fit", "narx", "-c", "r.toml", "log.csv", "-o", "r.toml"]).fails(&["r.toml", "input"]);
    fit(path, &["-p", "average,kmeans:2", "--keep-all", "-o", "m_.json"]).ok();
    fs::copy(path.join("r.toml"), path.join("m_kmeans2.json")).unwrap();
    fleetfoot(
        path,
        &["fit", "pwa", "-c", "m_kmeans2.json", "log.csv", "-p", "average,kmeans:2", "--keep-all", "-o", "m.json"],
    )
    .fails(&["m_kmeans2.json", "input"]);
    // The default partitions, too.
    let output = fleetfoot(path, &[&FIT[..], &["--keep-all", "-o", "n.json"]].concat()).ok();
    assert!(
        !output.err.contains("--partition refined:2,5,10"),
        "of few rows refined regions are tried: {}",
        output.err
    );
    for rival in ["n_average.json", "n_kmeans2.json", "n_kmeans5.json", "n_kmeans10.json", "n_refined2.json"] {
        assert!(path.join(rival).exists(), "{rival}");
    }
    fs::copy(path.join("r.toml"), path.join("n_kmeans5.json")).unwrap();
    fleetfoot(path, &["fit", "pwa", "-c", "n_kmeans5.json", "log.csv", "--keep-all", "-o", "n.json"])
        .fails(&["n_kmeans5.json", "input"]);
    #[cfg(unix)]
    {
        fs::hard_link(path.join("log.csv"), path.join("hard.json")).unwrap();
        std::os::unix::fs::symlink("log.csv", path.join("symbolic.json")).unwrap();
        fit(path, &["-o", "hard.json"]).fails(&["hard.json", "input"]);
        fit(path, &["-o", "symbolic.json"]).fails(&["symbolic.json", "input"]);
    }
    assert_eq!(fs::read_to_string(path.join("r.toml")).unwrap(), RECIPE);
    assert_eq!(fs::read_to_string(path.join("log.csv")).unwrap(), robot_csv(400, 0.0));
}

#[test]
fn two_outputs_are_two_files() {
    let folder = folder(&[("log.csv", &robot_csv(400, 0.0)), ("r.toml", RECIPE)]);
    let arguments = ["fit", "sparse", "-c", "r.toml", "log.csv", "-o", "a.stats", "--keep", "./a.stats"];
    fleetfoot(folder.path(), &arguments).fails(&["a.stats", "one file"]);
    let arguments = ["fit", "sparse", "-c", "r.toml", "log.csv", "--keep", "b.stats", "--frequencies", "b.stats"];
    fleetfoot(folder.path(), &arguments).fails(&["b.stats", "one file"]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

/// A null device of the test's own: a command that is wrong must not destroy the machine's. Only root can make one, and root alone could destroy that.
#[cfg(unix)]
fn null_device(folder: &Path) -> bool {
    let made = Command::new("mknod").current_dir(folder).args(["-m", "666", "null", "c", "1", "3"]).output();
    let works = made.is_ok_and(|output| output.status.success()) && fs::write(folder.join("null"), "x").is_ok();
    if !works {
        eprintln!("skipped: no device can be made in {}", folder.display());
    }
    works
}

#[cfg(unix)]
#[test]
fn devices_pipes_and_links_are_written_through() {
    use std::os::unix::fs::{FileTypeExt, symlink};
    let folder = folder(&[("log.csv", &robot_csv(400, 0.0)), ("r.toml", RECIPE)]);
    let path = folder.path();
    if null_device(path) {
        let before = fs::read_dir(path).unwrap().count();
        fit(path, &["-o", "null"]).ok();
        fleetfoot(path, &["scan", "-c", "r.toml", "log.csv", "-o", "null"]).ok();
        fleetfoot(path, &["init", "log.csv", "-o", "null"]).ok();
        assert!(fs::metadata(path.join("null")).unwrap().file_type().is_char_device());
        assert_eq!(fs::read_dir(path).unwrap().count(), before, "nothing is kept beside a device");
    }
    fs::create_dir(path.join("models")).unwrap();
    symlink("models/today.json", path.join("model.json")).unwrap();
    for _ in 0..2 {
        fit(path, &[]).ok();
        assert!(path.join("model.json").symlink_metadata().unwrap().is_symlink());
        assert!(path.join("models/today.json").is_file());
    }
    // A pipe: its reader gets the whole model.
    assert!(Command::new("mkfifo").arg(path.join("pipe")).status().unwrap().success());
    let pipe = path.join("pipe");
    let reader = std::thread::spawn(move || fs::read(pipe).unwrap());
    fit(path, &["-o", "pipe"]).ok();
    assert_eq!(reader.join().unwrap(), fs::read(path.join("model.json")).unwrap());
    assert!(path.join("pipe").symlink_metadata().unwrap().file_type().is_fifo());
    let predict = |output: &str| fleetfoot(path, &["predict", "model.json", "log.csv", "-q", "-o", output]).ok();
    #[cfg(target_os = "linux")]
    assert!(predict("/dev/stdout").out.starts_with("episode,time_ns,"));
    #[cfg(target_os = "linux")]
    assert!(fit(path, &["-q", "-o", "/dev/stdout"]).ok().out.contains("\"fleetfoot_model\""));
}

#[test]
fn leftovers_of_killed_commands_are_removed() {
    let folder = folder(&[("log.csv", &robot_csv(400, 0.0)), ("r.toml", RECIPE)]);
    let path = folder.path();
    fs::write(path.join(".model.json.a1B2c3.partial"), "half").unwrap();
    let output = fit(path, &[]).ok();
    assert!(
        output.err.contains("removed .model.json.a1B2c3.partial, which a killed command had left"),
        "{}",
        output.err
    );
    assert!(!path.join(".model.json.a1B2c3.partial").exists());
    fs::create_dir_all(path.join("runs/.generating-killed")).unwrap();
    let generate = |more: &[&str]| {
        let arguments = ["generate", "diffdrive", "--seconds", "1", "-o", "runs"];
        fleetfoot(path, &[&arguments[..], more].concat())
    };
    let output = generate(&[]).ok();
    assert!(output.err.contains("removed runs/.generating-killed, which a killed command had left"), "{}", output.err);
    generate(&["--force"]).ok();
    // A run that is read is not replaced.
    generate(&["--world", "runs/diffdrive_00.mcap", "--force"]).fails(&["diffdrive_00.mcap", "input"]);
    let left: Vec<_> = fs::read_dir(path.join("runs")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().starts_with('.')), "{left:?}");
    // Somebody works in the folder, or on the file.
    let held = fleetfoot::output::WriteLock::take(path.join("runs/.generating.lock"), path).unwrap();
    generate(&["--force"]).fails(&["runs", "another command"]);
    drop(held);
    let output = path.join("run.stats");
    let held = fleetfoot::output::WriteLock::take(fleetfoot::output::WriteLock::beside(&output), &output).unwrap();
    let scan = ["scan", "-c", "r.toml", "log.csv", "-o", "run.stats"];
    fleetfoot(path, &scan).fails(&["run.stats", "another command"]);
    drop(held);
    fleetfoot(path, &scan).ok();
}

#[test]
fn partitions_ignore_predicted_columns() {
    let mut text = String::from("t,y,u,w\n");
    for row in 0..600 {
        let (u, w) = ((0.3 * f64::from(row)).sin(), (0.17 * f64::from(row)).cos());
        writeln!(text, "{},{},{u},{w}", f64::from(row) * 0.1, u * if u + w > 0.0 { 2.0 } else { -1.0 }).unwrap();
    }
    let folder = folder(&[("log.csv", &text)]);
    let fit = |more: &[&str]| {
        let arguments = ["fit", "pwa", "log.csv", "--inputs", "u,w", "--predict", "y", "-p", "kmeans:3"];
        fleetfoot(folder.path(), &[&arguments[..], more].concat())
    };
    for more in [
        &["--partition-on", "y"][..],
        &["--partition-on", "u,abs(y)"],
        &["--partition-on", "lead(y,1)"],
        &["--alias", "twice=2*y", "--partition-on", "twice"],
        &["--alias", "other=y", "--partition-on", "u*other"],
    ] {
        fit(more).fails(&["the partition uses", "`y`", "--partition-on"]);
    }
    // The target an alias: the field that it is a function of.
    let arguments =
        ["fit", "pwa", "log.csv", "--inputs", "u,w", "--alias", "z=3*y", "--predict", "z", "-p", "kmeans:3"];
    fleetfoot(folder.path(), &[&arguments[..], &["--partition-on", "y"]].concat()).fails(&["`y`", "`z`"]);
    fit(&["--partition-on", "lag(y,1)"]).ok();
    fit(&["--partition-on", "u,w"]).ok();
    // Without a word it looks at the inputs, not at the state that is predicted.
    fit(&["--states", "y"]).ok();
    let model = fleetfoot(folder.path(), &["show", "model.json", "--json"]).ok().json();
    assert_eq!(model["model"]["partitions"][0]["columns"], serde_json::json!(["u", "w"]));
}

#[test]
fn models_of_steps_refuse_other_periods() {
    let slow = first_order(300, 4.0, 0.0);
    let (fast, near) = (first_order(300, 0.0016, 1.0), first_order(300, 4.1, 2.0));
    let folder = folder(&[("slow.csv", &slow), ("fast.csv", &fast), ("near.csv", &near)]);
    let path = folder.path();
    let of = ["--states", "y", "--inputs", "u", "-p", "average"];
    for predict in ["next", "delta"] {
        fleetfoot(path, &[&["fit", "pwa", "slow.csv", "--predict", predict][..], &of].concat()).ok();
        for command in ["score", "rollout"] {
            let mut arguments = vec![command, "model.json", "fast.csv"];
            arguments.extend((command == "rollout").then_some(["--horizon", "5"]).into_iter().flatten());
            fleetfoot(path, &arguments).fails(&["fast.csv", "0.0016 s", "4 s", "--rate 0.25", "keep every 2500th row"]);
        }
        fleetfoot(path, &["predict", "model.json", "fast.csv", "-o", "p.parquet"]).fails(&["0.0016"]);
        fleetfoot(path, &["score", "model.json", "near.csv"]).ok();
        fleetfoot(path, &["score", "model.json", "fast.csv", "--dt", "4"]).ok();
    }
    // Lags count rows too, whatever is predicted from them.
    let lagged = ["fit", "pwa", "slow.csv", "--predict", "y", "--inputs", "u", "--lags", "2", "-p", "average"];
    fleetfoot(path, &lagged).ok();
    fleetfoot(path, &["score", "model.json", "fast.csv"]).fails(&["0.0016", "4 s"]);
    // Derivatives hold for both.
    fleetfoot(path, &[&["fit", "pwa", "slow.csv"][..], &of].concat()).ok();
    let output = fleetfoot(path, &["score", "model.json", "fast.csv"]).ok();
    assert!(output.err.contains("0.0016 s") && output.err.contains("4 s"), "{}", output.err);
}

#[test]
fn huge_values_are_refused_by_name() {
    let text = first_order(300, 0.1, 0.0);
    let scaled = |factor: &str| -> String {
        let line = |(at, line): (usize, &str)| if at == 0 { format!("{line}\n") } else { format!("{line}{factor}\n") };
        text.lines().enumerate().map(line).collect()
    };
    let folder = folder(&[("big.csv", &scaled("e160")), ("fine.csv", &scaled("e120"))]);
    let path = folder.path();
    for method in ["pwa", "sindy"] {
        let arguments = |file| ["fit", method, file, "--states", "y", "--inputs", "u"];
        fleetfoot(path, &[&arguments("big.csv")[..], &["--degree", "1"]].concat()).fails(&["`u`", "1e150", "scale"]);
        assert!(!path.join("model.json").exists());
        fleetfoot(path, &[&arguments("fine.csv")[..], &["--degree", "1"]].concat()).ok();
        fs::remove_file(path.join("model.json")).unwrap();
    }
}

#[test]
fn unusable_rows_are_named_with_their_alias() {
    let text = first_order(300, 0.1, 0.0);
    let zero = with_cell(&text, 120, 2, "0");
    let huge = with_cell(&text, 77, 2, "1e308");
    let infinite = with_cell(&text, 60, 2, "inf");
    let folder = folder(&[("zero.csv", &zero), ("huge.csv", &huge), ("infinite.csv", &infinite)]);
    for method in ["pwa", "sindy"] {
        let run = |file: &str, more: &[&str]| {
            let arguments = ["fit", method, file, "--states", "y", "--degree", "1", "--partition", "average"];
            fleetfoot(folder.path(), &[&arguments[..], more].concat()).ok().err
        };
        let notes = run("zero.csv", &["--alias", "w=1/u", "--inputs", "w"]);
        assert!(notes.contains("`w` = `1/u` is infinite (`1/u` divides by zero) in row 120 of zero.csv"), "{notes}");
        let notes = run("huge.csv", &["--alias", "w=10*u", "--inputs", "w"]);
        assert!(
            notes.contains("`w`") && notes.contains("beyond 1.8e308") && notes.contains("row 77 of huge.csv"),
            "{notes}"
        );
        let notes = run("zero.csv", &["--alias", "w=sqrt(u+2)", "--alias", "v=sqrt(u-5)+w", "--inputs", "w"]);
        assert!(!notes.contains("no number"), "{notes}");
        let notes = run("infinite.csv", &["--inputs", "u"]);
        assert!(notes.contains("`u` has 1 infinite value") && notes.contains("line 61 (`inf`)"), "{notes}");
    }
    let all = fleetfoot(
        folder.path(),
        &["fit", "pwa", "zero.csv", "--states", "y", "--alias", "w=sqrt(u-5)", "--inputs", "w"],
    );
    all.fails(&["too few", "`w`", "no number", "row 1 of zero.csv"]);
}

#[test]
fn truncated_files_get_a_note() {
    let text = first_order(300, 0.1, 0.0);
    let whole = text.trim_end().to_owned();
    let within = &whole[..whole.len() - 5];
    let exponent = format!("{whole}e-");
    let folder = folder(&[("whole.csv", &text), ("within.csv", within), ("exponent.csv", &exponent)]);
    let fit = |file: &str| {
        fleetfoot(folder.path(), &["fit", "pwa", file, "--states", "y", "--inputs", "u", "-p", "average", "--json"])
            .ok()
    };
    let output = fit("whole.csv");
    assert!(!output.err.contains("line"), "{}", output.err);
    let rows = output.json()["rows"].as_u64().unwrap();
    let output = fit("within.csv");
    let last = within.rsplit(',').next().unwrap();
    assert!(output.err.contains("no line end") && output.err.contains(&format!("`u` = `{last}`")), "{}", output.err);
    assert_eq!(output.json()["rows"].as_u64(), Some(rows));
    let output = fit("exponent.csv");
    assert!(output.err.contains("cut off and is left out"), "{}", output.err);
    assert_eq!(output.json()["rows"].as_u64(), Some(rows - 1));
}

#[test]
fn blanks_separate_columns_too() {
    let text = first_order(300, 0.1, 0.0);
    let blanks: String = text.lines().map(|line| format!("  {}  \n", line.replace(',', "   "))).collect();
    let bare: String = blanks.lines().skip(1).map(|line| format!("{line}\n")).collect();
    let commented = format!("# t y u\n{bare}");
    let broken = with_cell(&text, 40, 2, "fast").replace(',', " \t ");
    let folder = folder(&[
        ("commas.csv", &text),
        ("blanks.txt", &blanks),
        ("commented.txt", &commented),
        ("broken.txt", &broken),
    ]);
    let fit = |file: &str| {
        fleetfoot(
            folder.path(),
            &["fit", "pwa", file, "--states", "y", "--inputs", "u", "-p", "average", "-o", &format!("{file}.json")],
        )
    };
    let expected = fit("commas.csv").ok().out;
    for file in ["blanks.txt", "commented.txt"] {
        let output = fit(file).ok();
        assert_eq!(output.out, expected, "{file}");
        assert!(output.err.contains("separated by blanks"), "{}", output.err);
    }
    fit("broken.txt").fails(&["broken.txt:41", "`u`", "fast"]);
}

/// A note on simulations that diverge names the option that bounds them; a bounded model's do not diverge, and get no
/// note.
#[test]
fn diverging_rollouts_suggest_bounds() {
    // Twelve runs that grow by a tenth a row, one after another with pauses; and a rest of which simulations begin.
    let mut grown = String::from("t,x\n");
    for run in 0..12 {
        let start = if run % 2 == 0 { 0.01 } else { -0.012 };
        for row in 0..30 {
            writeln!(grown, "{},{}", 100.0 * f64::from(run) + 0.1 * f64::from(row), start * 1.1_f64.powi(row)).unwrap();
        }
    }
    let rest: String =
        (0..9000).map(|row| format!("{},{}\n", 0.1 * f64::from(row), 0.01 + 1e-6 * f64::from(row))).collect();
    let folder = folder(&[("grown.csv", &grown), ("rest.csv", &format!("t,x\n{rest}"))]);
    let path = folder.path();
    let fit =
        ["fit", "pwa", "grown.csv", "--states", "x", "--predict", "next", "--partition", "kmeans:2", "--max-gap", "1"];
    for (more, bounded) in [(&[][..], false), (&["--stable"], true)] {
        fleetfoot(path, &[&fit[..], more].concat()).ok();
        let output =
            fleetfoot(path, &["rollout", "model.json", "rest.csv", "--horizon", "8500", "--starts", "20"]).ok();
        assert_eq!(output.out.contains("; 0 diverged"), bounded, "{}", output.out);
        assert_eq!(output.err.contains("`fit pwa --stable` bounds the maps"), !bounded, "{}", output.err);
    }
}

/// Predictions of a log without a value in one column.
#[test]
fn predictions_without_inputs_name_the_column() {
    let text = robot_csv(400, 0.0);
    let emptied: Vec<String> = text
        .lines()
        .enumerate()
        .map(|(row, line)| {
            let mut cells: Vec<&str> = line.split(',').collect();
            cells[3] = if row == 0 { cells[3] } else { "" };
            cells.join(",")
        })
        .collect();
    let folder = folder(&[("log.csv", &text), ("empty.csv", &emptied.join("\n")), ("r.toml", RECIPE)]);
    let path = folder.path();
    fit(path, &["-p", "average"]).ok();
    let note = "no row has a prediction: `u` has no value in any row";
    let output = fleetfoot(path, &["predict", "model.json", "empty.csv", "-o", "p.csv"]).ok();
    assert!(output.err.contains(note) && output.out.contains(" 0 with a prediction"), "{}{}", output.err, output.out);
    let output = fleetfoot(path, &["predict", "model.json", "log.csv", "-o", "q.csv"]).ok();
    assert!(!output.err.contains("no row has a prediction"), "{}", output.err);
}

/// Numbers for which a job would not end, or its sizes would not fit an address.
#[test]
fn numbers_of_options_have_bounds() {
    let folder = folder(&[("log.csv", &robot_csv(400, 0.0)), ("r.toml", RECIPE)]);
    let path = folder.path();
    fit(path, &["-p", "average"]).ok();
    let huge = "18446744073709551615";
    for (command, words) in [
        (format!("rollout model.json log.csv --horizon {huge}"), ["--horizon", "1..=10000000"]),
        ("rollout model.json log.csv --horizon 0".to_owned(), ["--horizon", "1..=10000000"]),
        ("rollout model.json log.csv --starts 0".to_owned(), ["--starts", "1..=1000000000"]),
        (format!("report model.json log.csv --horizon {huge}"), ["--horizon", "0..=10000000"]),
        ("score model.json log.csv --plane v,u --bins 4294967296".to_owned(), ["--bins", "0..=1000"]),
        ("prepare -c r.toml log.csv --hampel 4294967296".to_owned(), ["--hampel", "0..=10000"]),
        (format!("prepare -c r.toml log.csv --hampel {huge}"), ["--hampel", "0..=10000"]),
        ("fit pwa -c r.toml log.csv -p kmeans:3 --restarts 1000000000".to_owned(), ["--restarts", "0..=1000"]),
        (format!("fit narx log.csv --outputs x --inputs u --lags-out {huge}"), ["--lags-out", "0..=1000"]),
    ] {
        let output = fleetfoot(path, &command.split(' ').collect::<Vec<_>>());
        assert_eq!(output.code, 2, "{command}: {}", output.err);
        assert!(words.iter().all(|word| output.err.contains(word)), "{command}: {}", output.err);
    }
    // A recipe has the same ones.
    fs::write(path.join("h.toml"), format!("{RECIPE}[prepare]\nhampel = 4294967296\n")).unwrap();
    fleetfoot(path, &["prepare", "-c", "h.toml", "log.csv"]).fails(&["h.toml", "[prepare] hampel", "0..=10000"]);
    let gap = fleetfoot(path, &["check", "log.csv", "--max-gap", "0"]);
    gap.fails(&["max_gap = 0: write seconds above 0, \"auto\" or \"none\""]);
    // More threads than help are not started.
    let output = fleetfoot(path, &["score", "model.json", "log.csv", "--threads", "10000"]).ok();
    assert!(output.err.contains("--threads 10000") && output.err.contains("4 a core"), "{}", output.err);
}
