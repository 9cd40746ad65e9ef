//! Every kind of bad input gets a message that names the file, the place and the mend; and nothing half-written stays.

use std::fs;

use crate::runner::*;

fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in files {
        fs::write(folder.path().join(name), text).expect("a file");
    }
    folder
}

/// The log with each line changed by `change(row, cells)`.
fn changed(rows: usize, change: impl Fn(usize, &mut Vec<String>)) -> String {
    let text = robot_csv(rows, 0.3);
    let mut lines = text.lines();
    let mut out = format!("{}\n", lines.next().unwrap());
    for (row, line) in lines.enumerate() {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        change(row, &mut cells);
        if !cells.is_empty() {
            out.push_str(&cells.join(","));
            out.push('\n');
        }
    }
    out
}

const FIT: [&str; 11] =
    ["fit", "pwa", "log.csv", "--alias", "v=`v [m/s]`", "--states", "v", "--inputs", "u", "-o", "model.json"];

/// A fit of one region, unless `more` names partitions: refined regions take seconds.
fn fit(folder: &Path, more: &[&str]) -> Run {
    let partition: &[&str] = if more.contains(&"--partition") { &[] } else { &["--partition", "average"] };
    fleetfoot(folder, &[&FIT[..], partition, more].concat())
}

#[test]
fn usage_errors_exit_with_two() {
    let folder = folder(&[]);
    for arguments in
        [&["fit"][..], &["nonsense"], &["score", "model.json"], &["fit", "pwa", "x.csv", "--folds", "many"]]
    {
        assert_eq!(fleetfoot(folder.path(), arguments).code, 2, "{arguments:?}");
    }
    assert_eq!(fleetfoot(folder.path(), &["--version"]).code, 0);
}

#[test]
fn missing_and_unknown_files() {
    let folder = folder(&[("log.csv", &robot_csv(100, 0.0)), ("notes.docx", "x"), ("model.txt", "x")]);
    fleetfoot(folder.path(), &["info", "lag.csv"]).fails(&["lag.csv", "log.csv"]);
    fleetfoot(folder.path(), &["info", "*.parquet"]).fails(&["*.parquet"]);
    fleetfoot(folder.path(), &["info", "notes.docx"]).fails(&["notes.docx", ".csv"]);
    fleetfoot(folder.path(), &["show", "gone.json"]).fails(&["gone.json"]);
    fleetfoot(folder.path(), &["show", "model.txt"]).fails(&["model.txt", "not a fleetfoot model"]);
}

#[test]
fn unknown_columns_name_the_nearest() {
    let folder = folder(&[("log.csv", &robot_csv(100, 0.0))]);
    fleetfoot(folder.path(), &["fit", "pwa", "log.csv", "--states", "mod", "--inputs", "u"])
        .fails(&["`mod`", "`mode`"]);
    fit(folder.path(), &["--partition-on", "vv"]).fails(&["vv", "v"]);
    fit(folder.path(), &["--alias", "w=sin(uu)", "--weight", "w"]).fails(&["uu"]);
    fit(folder.path(), &["--time", "stamp"]).fails(&["stamp"]);
    fit(folder.path(), &["--partition", "labels:node"]).fails(&["node", "mode"]);
    fleetfoot(folder.path(), &["fit", "pwa", "log.csv", "--inputs", "u", "--alias", "w=u +* 2"]).fails(&["w"]);
    assert!(!folder.path().join("model.json").exists());
}

#[test]
fn recipe_errors_name_their_line() {
    let folder = folder(&[("log.csv", &robot_csv(100, 0.0)), ("bad.toml", "[states]\nv = { derivativ = \"auto\" }\n")]);
    fit(folder.path(), &["-c", "bad.toml"]).fails(&["bad.toml", "line 2", "derivativ"]);
}

#[test]
fn missing_values_are_left_out_and_counted() {
    let text = changed(1000, |row, cells| {
        if row % 100 == 50 {
            cells[3] = "nan".into();
        }
    });
    let folder = folder(&[("log.csv", &text)]);
    let report = fit(folder.path(), &["--json"]).ok().json();
    assert_eq!(report["rows_incomplete"], 10);
    assert!(report["notes"].to_string().contains("missing value"));
}

#[test]
fn gaps_begin_episodes_and_repeats_are_dropped() {
    let gap = changed(1000, |row, cells| {
        if (400..450).contains(&row) {
            cells.clear();
        }
    });
    let backward = changed(1000, |row, cells| {
        if row >= 600 {
            cells[0] = format!("{}", (row - 600) as f64 * 0.01);
        }
    });
    let repeated = changed(1000, |row, cells| {
        if row == 300 {
            cells[0] = "2.99".into();
        }
    });
    for (text, episodes, rows) in [(gap, 2, 950), (backward, 2, 1000), (repeated, 1, 999)] {
        let folder = folder(&[("log.csv", &text)]);
        let plan = fit(folder.path(), &["--dry-run", "--json"]).ok().json();
        assert_eq!((plan["episodes"].as_u64(), plan["rows"].as_u64()), (Some(episodes), Some(rows)));
        // A central difference needs a neighbour on both sides: two rows are lost to every episode.
        let report = fit(folder.path(), &["--json"]).ok().json();
        assert_eq!(report["rows_at_border"].as_u64(), Some(2 * episodes));
    }
}

#[test]
fn constant_columns_and_too_few_rows() {
    let constant = changed(300, |_, cells| cells[2] = "1.5".into());
    let folder_a = folder(&[("log.csv", &constant)]);
    fit(folder_a.path(), &[]).fails(&["d(v)/dt", "same value"]);
    let input = changed(300, |_, cells| cells[3] = "1.5".into());
    let folder_b = folder(&[("log.csv", &input)]);
    let output = fit(folder_b.path(), &[]).ok();
    assert!(output.err.contains("u does not change"), "{}", output.err);
    let folder_c = folder(&[("log.csv", &robot_csv(5, 0.0))]);
    fit(folder_c.path(), &[]).fails(&["too few"]);
    fleetfoot(folder_b.path(), &["rollout", "model.json", "log.csv", "--horizon", "5000"]).fails(&["5000", "horizon"]);
}

#[test]
fn broken_cells_and_rows_are_located() {
    let word = changed(200, |row, cells| {
        if row == 120 {
            cells[3] = "fast".into();
        }
    });
    let short = changed(200, |row, cells| {
        if row == 120 {
            cells.truncate(3);
        }
    });
    let folder_a = folder(&[("log.csv", &word)]);
    fit(folder_a.path(), &[]).fails(&["log.csv", "122", "fast"]);
    let folder_b = folder(&[("log.csv", &short)]);
    fit(folder_b.path(), &[]).fails(&["log.csv", "122"]);
}

#[test]
fn damaged_files_are_refused() {
    let folder = folder(&[("log.csv", &robot_csv(400, 0.0)), ("fake.parquet", &robot_csv(50, 0.0))]);
    fleetfoot(folder.path(), &["info", "fake.parquet"]).fails(&["fake.parquet"]);
    fit(folder.path(), &[]).ok();
    fleetfoot(folder.path(), &["predict", "model.json", "log.csv", "-o", "pred.parquet"]).ok();
    let whole = fs::read(folder.path().join("pred.parquet")).unwrap();
    for length in [0, 3, 100, whole.len() / 2, whole.len() - 1] {
        fs::write(folder.path().join("cut.parquet"), &whole[..length]).unwrap();
        fleetfoot(folder.path(), &["info", "cut.parquet"]).fails(&["cut.parquet"]);
    }
    let model = fs::read_to_string(folder.path().join("model.json")).unwrap();
    let edited = model.replacen("\"rows\": ", "\"rows\": 1", 1);
    for (text, words) in [
        (&model[..model.len() / 2], &["cut.json", "not a fleetfoot model"][..]),
        (&edited, &["cut.json", "checksum"]),
        (&model.replace("\"fleetfoot_model\": 1", "\"fleetfoot_model\": 99"), &["cut.json", "format 99"]),
    ] {
        fs::write(folder.path().join("cut.json"), text).unwrap();
        fleetfoot(folder.path(), &["score", "cut.json", "log.csv"]).fails(words);
    }
}

#[test]
fn inputs_are_never_overwritten() {
    let folder = folder(&[("log.csv", &robot_csv(400, 0.0))]);
    fit(folder.path(), &[]).ok();
    let before = fs::read(folder.path().join("log.csv")).unwrap();
    fleetfoot(folder.path(), &["fit", "pwa", "log.csv", "--states", "x", "-o", "log.csv"]).fails(&["log.csv", "input"]);
    fleetfoot(folder.path(), &["predict", "model.json", "log.csv", "-o", "log.csv"]).fails(&["log.csv"]);
    assert_eq!(fs::read(folder.path().join("log.csv")).unwrap(), before);
    fleetfoot(folder.path(), &["predict", "model.json", "log.csv", "-o", "nowhere/pred.parquet"]).fails(&["nowhere"]);
    let names: Vec<String> =
        fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    assert_eq!(names.len(), 2, "{names:?}");
}

#[test]
fn labels_unseen_in_training() {
    let train = changed(1500, |row, cells| cells[4] = if row % 2 == 0 { "grass".into() } else { "sand".into() });
    let other = changed(300, |row, cells| cells[4] = if row % 2 == 0 { "ice".into() } else { "sand".into() });
    let folder = folder(&[("log.csv", &train), ("ice.csv", &other)]);
    fit(folder.path(), &["--partition", "labels:mode"]).ok();
    fleetfoot(folder.path(), &["score", "model.json", "ice.csv"]).fails(&["mode", "sand", "--unseen-labels pool"]);
    fit(folder.path(), &["--partition", "labels:mode", "--unseen-labels", "pool"]).ok();
    let score = fleetfoot(folder.path(), &["score", "model.json", "ice.csv", "--json"]).ok().json();
    assert_eq!(score["rows"], 298);
    // `sand` has code 0 here and 1 in training: it must still be sand.
    fleetfoot(folder.path(), &["predict", "model.json", "ice.csv", "-o", "p.parquet"]).ok();
    let info = fleetfoot(folder.path(), &["info", "p.parquet", "--values", "--json"]).ok().json();
    let region = info[0]["columns"].as_array().unwrap().iter().find(|c| c["name"] == "region").unwrap();
    assert_eq!((region["statistics"]["min"].as_f64(), region["statistics"]["max"].as_f64()), (Some(1.0), Some(2.0)));
}

/// Rows without a label are in no region: every method has a note, with the place.
#[test]
fn missing_and_rare_labels_are_named() {
    let gaps =
        changed(600, |row, cells| cells[4] = if row % 10 == 3 { String::new() } else { (row / 300).to_string() });
    let rare = changed(600, |row, cells| cells[4] = if row == 200 { "7" } else { "0" }.into());
    let folder = folder(&[("log.csv", &gaps), ("rare.csv", &rare)]);
    let run = |arguments: &str| fleetfoot(folder.path(), &arguments.split_whitespace().collect::<Vec<_>>()).ok().err;
    let notes = fit(folder.path(), &["--partition", "average,labels:mode"]).ok().err;
    assert!(notes.contains("60 rows with a missing value") && notes.contains("`mode` in row 4 of log.csv"), "{notes}");
    let notes = run("fit sindy log.csv --states x --inputs u --degree 1 --partition labels:mode -o s.json");
    assert!(notes.contains("`mode` in row 4 of log.csv"), "{notes}");
    let notes = run(
        "fit narx log.csv --outputs x --inputs u --lags-out 1 --lags-in 1 --degree 1 --partition labels:mode -o n.json",
    );
    assert!(notes.contains("labels:mode: 60 of 599 rows have no label"), "{notes}");
    run("scan log.csv --states x --inputs u --predict next --partition labels:mode -o log.stats");
    let notes = run("fit pwa log.stats --partition average,labels:mode -o p.json");
    assert!(notes.contains("labels:mode: 60 of 599 rows have no label"), "{notes}");
    let notes = run("fit pwa rare.csv --states x --inputs u --predict next --partition labels:mode -o r.json");
    assert!(
        notes.contains("labels:mode: 1 of 2 regions (the first: 7) have fewer rows than the 3 coefficients"),
        "{notes}"
    );
    let pulled =
        run("fit pwa rare.csv --states x --inputs u --predict next --partition labels:mode --shrinkage 5 -o r.json");
    assert!(!pulled.contains("fewer rows"), "{pulled}");
    let notes = run("fit pwa rare.csv --states x --inputs u --predict next --partition labels:mode+kmeans:3 -o r.json");
    assert!(notes.contains("mode 7: kmeans:3: only 1 different position to cluster"), "{notes}");
}

#[test]
fn folds_without_training_rows_are_refused() {
    let folder = folder(&[("log.csv", &robot_csv(500, 0.0))]);
    fit(folder.path(), &["--folds", "10", "--purge", "1.0"]).fails(&["purge", "100 rows", "50 rows"]);
    fit(folder.path(), &["--folds", "2", "--purge", "3.0"]).fails(&["purge"]);
    // Two folds are six spans.
    fit(folder.path(), &["--folds", "2", "--purge", "0.83"]).fails(&["no complete row", "--folds 0"]);
    assert_eq!(fit(folder.path(), &["--folds", "60000"]).code, 2);
}

#[test]
fn misleading_file_names_are_refused() {
    let folder = folder(&[("log.csv", &robot_csv(500, 0.0))]);
    fit(folder.path(), &[]).ok();
    fleetfoot(folder.path(), &["predict", "model.json", "log.csv", "-o", "pred.xlsx"]).fails(&[
        "pred.xlsx",
        "*.parquet",
        "*.csv",
    ]);
    fleetfoot(folder.path(), &["rollout", "model.json", "log.csv", "--horizon", "5", "-o", "r.db3"])
        .fails(&["r.db3", "*.parquet"]);
    assert!(!folder.path().join("pred.xlsx").exists());
}

#[test]
fn the_same_log_twice_is_refused() {
    let text = robot_csv(400, 0.0);
    let folder = folder(&[("log.csv", &text), ("copy.csv", &text)]);
    fit(folder.path(), &["copy.csv"]).fails(&["log.csv", "copy.csv"]);
}

/// A log without a column of the recipe, or of the model.
#[test]
fn missing_columns_suggest_where_to_look() {
    let log = robot_csv(300, 0.3);
    let without = log.replacen(",u,", ",push,", 1);
    let folder = folder(&[("log.csv", &log), ("other.csv", &without)]);
    let path = folder.path();
    fit(path, &["--time", "t"]).ok();
    for command in ["score", "rollout", "resimulate"] {
        let words = ["other.csv: column u of the model", "(pwa ", "there is no column `u`", "`fleetfoot info` lists"];
        fleetfoot(path, &[command, "model.json", "other.csv"]).fails(&words);
    }
    let arguments = ["fit", "pwa", "other.csv", "--states", "v [m/s]", "--inputs", "u", "-o", "none.json"];
    fleetfoot(path, &arguments).fails(&["other.csv: [inputs] u: there is no column `u`", "`fleetfoot info` lists"]);
    assert!(!path.join("none.json").exists());
}

/// Rows of `p' = 0.9 p + 20 u`, with `p` as `write` writes it, the mode of a controller and a payload.
fn plant_with_text(header: &str, delimiter: char, write: impl Fn(f64) -> String) -> String {
    let mut text = format!("{}\n", header.replace(',', &delimiter.to_string()));
    let mut p = 1000.0;
    for row in 0..200 {
        let (time, u) = (f64::from(row) * 0.05, (0.1 * f64::from(row)).sin());
        let mode = if row / 20 % 2 == 0 { "auto" } else { "manual" };
        let cells = [format!("{time:.2}"), write(p), format!("{u:.4}"), mode.to_owned(), format!("{} kg", 2 + row % 3)];
        text.push_str(&format!("{}\n", cells.join(&delimiter.to_string())));
        p = 0.9 * p + 100.0 + 20.0 * u;
    }
    text
}

/// Codes of words serve labels and conditions alone. Everywhere else they are no measurements.
#[test]
fn text_is_no_number() {
    let grouped = |p: f64| {
        let cents = format!("{:03}", (p * 100.0).round() as i64);
        let (whole, decimals) = cents.split_at(cents.len() - 2);
        let (thousands, rest) = whole.split_at(whole.len().saturating_sub(3));
        if thousands.is_empty() { format!("{rest},{decimals}") } else { format!("{thousands}.{rest},{decimals}") }
    };
    let header = "t,p,u,mode,payload";
    let folder = folder(&[
        ("grouped.csv", &plant_with_text(header, ';', grouped).replace("0.", "0,")),
        ("log.csv", &plant_with_text(header, ',', |p| p.to_string())),
        ("sum.toml", "[columns]\ntwice = \"2*mode\"\n[states]\np = {}\n[inputs]\ntwice = {}\n"),
        (
            "known.toml",
            "[states]\np = { known = \"u - k*payload\" }\n[inputs]\nu = {}\n[parameters]\nk = { initial = 1.0 }\n",
        ),
        ("rate.toml", "[states]\np = {}\nmode = {}\n[inputs]\nu = {}\n"),
        (
            "label.toml",
            "[states]\np = {}\n[inputs]\nu = {}\npayload = {}\n[[episodes]]\nmatch = \"*\"\nload = \"2.5\"\n",
        ),
        ("load.toml", "[states]\np = {}\n[inputs]\nu = {}\nload = {}\n[[episodes]]\nmatch = \"*\"\nload = \"2.5\"\n"),
    ]);
    let average = ["--partition", "average", "-o", "model.json"];
    let run = |arguments: &[&str], more: &[&str]| fleetfoot(folder.path(), &[arguments, more].concat());
    let next = ["--states", "p", "--inputs", "u", "--predict", "next"];
    run(&[&["fit", "pwa", "grouped.csv"][..], &next].concat(), &average).fails(&[
        "grouped.csv",
        "the state `p`",
        "\"1.000,00\" in row 1",
        "as in 1000.00",
    ]);
    let word = ["log.csv", "`mode`", "\"auto\" in row 1", "--partition labels:mode", "--where \"mode == 'auto'\""];
    for (arguments, message) in [
        (&["fit", "pwa", "log.csv", "--states", "p", "--inputs", "mode", "--predict", "next"][..], "the input"),
        (&["fit", "pwa", "log.csv", "--predict", "mode", "--inputs", "u"], "the column"),
        (&["fit", "pwa", "log.csv", "--recipe", "sum.toml"], "the input `twice` reads"),
        (&["fit", "sindy", "log.csv", "--recipe", "rate.toml"], "the state"),
        (&["fit", "sparse", "log.csv", "--states", "p", "--inputs", "mode"], "the input"),
        (&["fit", "narx", "log.csv", "--states", "p", "--inputs", "mode"], "the input"),
        (&["scan", "log.csv", "--recipe", "rate.toml"], "the state"),
    ] {
        let output: &[&str] = if arguments[0] == "scan" { &["-o", "log.stats"] } else { &["-o", "model.json"] };
        run(arguments, output).fails(&[&word[..], &[message]].concat());
    }
    run(
        &["fit", "pwa", "log.csv", "--partition-on", "mode", "--partition", "kmeans:2"],
        &[&next[..], &["-o", "model.json"]].concat(),
    )
    .fails(&word);
    run(&["fit", "parameters", "log.csv", "--recipe", "known.toml"], &["-o", "model.json"]).fails(&[
        "`payload`",
        "\"2 kg\" in row 1",
        "`payload [kg]`",
    ]);
    run(&["prepare", "log.csv", "--recipe", "rate.toml"], &["-o", "prepared"]).fails(&word);
    run(&["fit", "pwa", "log.csv", "--recipe", "load.toml"], &average).fails(&[
        "`load`",
        "label of [[episodes]]",
        "labels are text",
    ]);
    // Columns that a model read in training are read as numbers in other logs too.
    run(&[&["fit", "pwa", "log.csv"][..], &next].concat(), &average).ok();
    run(&["score", "model.json", "grouped.csv"], &[]).fails(&["the state `p`", "\"1.000,00\""]);
    // Labels, phases and conditions are what words are for.
    let labels =
        ["--partition", "labels:mode", "--phase", "labels:mode", "--where", "mode == 'auto'", "-o", "labels.json"];
    run(&[&["fit", "pwa", "log.csv"][..], &next].concat(), &labels).ok();
    assert!(!folder.path().join("log.stats").exists() && !folder.path().join("prepared").exists());
}

/// A log in which nothing moves is no success: any model is perfect on it.
#[test]
fn constant_targets_are_refused() {
    let rows = |row: &dyn Fn(usize) -> String| {
        format!("t,x,v,u\n{}", (0..400).map(|k| format!("{:.2},{}\n", 0.01 * k as f64, row(k))).collect::<String>())
    };
    // One span of five moves: the velocity follows the force, and before it everything rests.
    let mut v = 0.0;
    let late: String = rows(&|_| String::new()).lines().take(1).map(str::to_owned).collect::<String>()
        + &(0..400)
            .map(|k| {
                let u = if k < 330 { 0.0 } else { (0.4 * k as f64).sin() };
                let line = format!("\n{:.2},0,{v},{u}", 0.01 * k as f64);
                v = 0.95 * v + 0.1 * u;
                line
            })
            .collect::<String>();
    let folder = folder(&[
        ("zero.csv", &rows(&|_| "0,0,0".into())),
        ("constant.csv", &rows(&|k| format!("0.1,{},{}", (0.1 * k as f64).sin(), (0.03 * k as f64).cos()))),
        ("late.csv", &late),
        ("fall.csv", &rows(&|k| format!("{},{},0", 100.0 - 4.905e-4 * (k * k) as f64, -0.0981 * k as f64))),
        (
            "drag.toml",
            "[states]\nx = { known = \"v\" }\nv = { known = \"u - k*v\" }\n[inputs]\nu = {}\n[parameters]\nk = { initial = 1.0 }\n",
        ),
        (
            "task.toml",
            "[inputs]\nu = {}\nv = {}\n[latents]\nf = { of = [\"u\", \"v\"], degree = 2 }\n[tasks]\na = { target = \"x\", right = \"f\" }\n",
        ),
    ]);
    let fit = |method: &str, more: &[&str]| {
        fleetfoot(folder.path(), &[&["fit", method][..], more, &["-o", "model.json"]].concat())
    };
    for (log, value) in [("zero.csv", "0"), ("constant.csv", "0.1")] {
        let same = format!("has the same value {value} in all rows");
        for (method, more) in [
            ("narx", &["--states", "x"][..]),
            ("narx", &["--states", "x,v", "--inputs", "u"]),
            ("narx", &["--states", "x", "--lags-out", "2", "--degree", "1", "--terms", "1"]),
            ("sindy", &["--predict", "x", "--inputs", "u"]),
            ("sindy", &["--predict", "next", "--states", "x", "--inputs", "u"]),
            ("pwa", &["--predict", "next", "--states", "x", "--inputs", "u"]),
        ] {
            fit(method, &[&[log][..], more].concat()).fails(&["x", &same]);
        }
        fit("sindy", &[log, "--states", "x,v", "--inputs", "u"]).fails(&["d(x)/dt has the same value 0"]);
    }
    fit("sparse", &["zero.csv", "-c", "task.toml"]).fails(&["[tasks] a", "is zero"]);
    fit("sparse", &["constant.csv", "-c", "task.toml"]).fails(&["[tasks] a", "has the same value 0.1"]);
    fit("parameters", &["zero.csv", "-c", "drag.toml"]).fails(&["target v has the same value 0"]);
    fit("narx", &["late.csv", "--states", "v", "--inputs", "u"]).fails(&[
        "4 of 5 held-out spans",
        "constant outputs",
        "--where",
    ]);
    assert!(!folder.path().join("model.json").exists());
    // A rate may be constant: what falls is accelerated.
    let fall = fit("sindy", &["fall.csv", "--states", "x,v"]).ok().out;
    assert!(fall.contains("d(v)/dt = -9.81"), "{fall}");
    // A model of the log that moves, on the one that rests.
    let moving = robot_csv(400, 0.3).replace("v [m/s]", "v");
    std::fs::write(folder.path().join("moving.csv"), moving).expect("a file");
    fit("sindy", &["moving.csv", "--states", "v", "--inputs", "u"]).ok();
    let output = fleetfoot(folder.path(), &["score", "model.json", "zero.csv"]).ok();
    assert!(output.err.contains("d(v)/dt has the same value in all rows that were scored"), "{}", output.err);
}

/// Spans at rest count for nothing: this model is unstable, and looked good on the spans in which nothing moves.
#[test]
fn resting_spans_are_no_success() {
    let mut v = 0.0;
    let rows: String = (0..400)
        .map(|k| {
            let u: f64 = if k < 160 { 0.0 } else { (0.4 * k as f64).sin() };
            let line = format!("{:.2},{v},{u}\n", 0.01 * k as f64);
            v = 0.95 * v + 0.1 * u;
            line
        })
        .collect();
    let folder = folder(&[("log.csv", &format!("t,v,u\n{rows}"))]);
    let orders = ["--lags-out", "1", "--lags-in", "1", "--degree", "1"];
    let arguments =
        [&["fit", "narx", "log.csv", "--states", "v", "--inputs", "u", "-o", "m.json"][..], &orders].concat();
    let text = fleetfoot(folder.path(), &arguments).ok().out;
    assert!(text.contains("2 of them are ignored") && text.contains("spans -, -, "), "{text}");
    let json = fleetfoot(folder.path(), &[&arguments[..], &["--json"]].concat()).ok().json();
    let folds = json["held_out"]["folds"].as_array().unwrap();
    assert!(folds[0].is_null() && folds[1].is_null() && folds[2].is_number(), "{folds:?}");
}

/// The answer to a slip has the intended word.
#[test]
fn misused_commands_suggest_the_mend() {
    let log = robot_csv(300, 0.1);
    let known = |right: &str, more: &str| {
        format!(
            "[states]\nv = {{ column = \"`v [m/s]`\", known = \"{right}\" }}\n[inputs]\nu = {{}}\n[parameters]\nk = {{ initial = 1.0 }}\n{more}"
        )
    };
    let folder = folder(&[
        ("log.csv", &log),
        ("other.csv", "t,w\n0,1\n0.1,2\n0.2,3\n0.3,1\n"),
        ("late.toml", &known("k*delay(u, 0.65) - v", "")),
        ("free.toml", &known("k*delay(u, theta) - v", "theta = { initial = 0.5 }\n")),
        ("state.toml", "[state]\nv = {}\n"),
        ("unit.toml", "[states]\nv = { column = \"`v [m/s]`\", unit = \"furlong\" }\n"),
    ]);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let to = ["-o", "model.json"];
    run(&[&["fit", "parameters", "log.csv", "-c", "late.toml"][..], &to].concat()).fails(&[
        "[states] v known",
        "`delay(u, 0.65)`",
        "[columns]",
        "[inputs]",
    ]);
    run(&[&["fit", "parameters", "log.csv", "-c", "free.toml"][..], &to].concat()).fails(&[
        "[states] v known",
        "`theta` inside a filter",
        "fit sindy",
    ]);
    run(&[&["fit", "pwa", "log.csv", "-c", "state.toml"][..], &to].concat()).fails(&["did you mean `states`"]);
    run(&[&["fit", "pwa", "log.csv", "-c", "log.csv"][..], &to].concat()).fails(&[
        "log.csv",
        "this is a log",
        "-c robot.toml",
    ]);
    run(&[&["fit", "sindy", "log.csv", "-c", "unit.toml"][..], &to].concat()).fails(&[
        "[states] v unit = \"furlong\"",
        "unknown unit `furlong`",
        "leave the unit out",
    ]);
    run(&[&["fit", "pwa", "log.csv", "--states", "x", "--predict", "nxt"][..], &to].concat())
        .fails(&["did you mean `next`"]);
    let method = run(&["fit", "-c", "unit.toml", "log.csv"]);
    assert_eq!(method.code, 2);
    assert!(method.err.contains("fleetfoot fit pwa"), "{}", method.err);
    let fit = ["fit", "pwa", "log.csv", "--states", "x", "--inputs", "u", "-p", "average"];
    run(&[&fit[..], &["-o", "-"]].concat()).fails(&["-: cannot", "/dev/stdout"]);
    run(&[&fit[..], &["-o", "unit.toml"]].concat()).fails(&["unit.toml", "a recipe has this name"]);
    // A command that repeats its output replaces it, with a note.
    assert!(!run(&[&fit[..], &to].concat()).ok().err.contains("replaces"));
    assert!(run(&[&fit[..], &to].concat()).ok().err.contains("note: model.json exists; the result replaces it"));
    let export = ["export", "model.json", "--to", "c", "-o", "c"];
    assert!(!run(&export).ok().err.contains("replaced"));
    assert!(run(&export).ok().err.contains("was there and is replaced"));
    let message =
        run(&["score", "model.json", "other.csv"]).fails(&["other.csv: column", "of the model", "pwa average"]);
    let shown = run(&["show", "model.json"]).ok().out;
    let hash = shown.lines().next().unwrap().split_whitespace().find(|word| word.ends_with(':')).unwrap();
    assert!(message.contains(hash.trim_end_matches(':')), "{message}\n{shown}");
}

/// `info` on several files reports the unit that a fit of them takes: the one that fits all of them.
#[test]
fn info_and_fit_agree_on_files() {
    let text = |period: i64| {
        let rows = (0..120).map(|row| format!("{},{}\n", 20_300_000 + row * period, (row * 37) % 17));
        std::iter::once("timestamp,x\n".to_owned()).chain(rows).collect::<String>()
    };
    let (slow, fast) = (text(1_000_000), text(4_000));
    let folder = folder(&[("slow.csv", &slow), ("fast.csv", &fast)]);
    let info = |files: &[&str]| fleetfoot(folder.path(), &[&["info", "--json"][..], files].concat()).ok().json();
    assert_eq!(info(&["slow.csv"]).pointer("/0/clock/unit"), Some(&serde_json::Value::Null));
    let both = info(&["slow.csv", "fast.csv"]);
    for place in ["/0/clock", "/1/clock"] {
        let clock = both.pointer(place).unwrap();
        assert!(clock["unit"] == "us" && clock["assumed"].as_str().unwrap().contains("fits all files"), "{clock}");
    }
    let fit = ["fit", "pwa", "slow.csv", "fast.csv", "--states", "x", "-p", "average"];
    let output = fleetfoot(folder.path(), &fit).ok();
    assert!(output.err.contains("taken as us: the only unit that fits all files"), "{}", output.err);
}
