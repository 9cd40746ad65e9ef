//! The statistic as a file: `scan` and `stats`, on files.

use std::fs;

use crate::runner::*;

const RECIPE: &str = "[latents]\nT = { of = [\"x\"], degree = 2 }\nD = { functions = [\"v\", \"v^2\"] }\n\
                      [tasks]\nalong = { target = \"a\", right = \"T - D\" }\nnormal = { target = \"b\", right = \"2*T\" }\n\
                      [inputs]\nx = \"x\"\nv = { column = \"v\", unit = \"m/s\" }\n[time]\ncolumn = \"t\"\n\
                      [[episodes]]\nmatch = \"flight_1*\"\nweather = \"wind\"\n";

/// Logs of `a = T - D`, `b = 2 T` with T = 3 + x - 0.5 x^2 and D = 0.7 v: `runs/AIRCRAFT/flight_N.csv`.
fn logs() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("plane.toml"), RECIPE).expect("a file");
    for aircraft in 1..=3 {
        for flight in 0..2 {
            write_log(folder.path(), aircraft, flight);
        }
    }
    folder
}

fn write_log(folder: &Path, aircraft: usize, flight: usize) {
    let folder = folder.join(format!("runs/{aircraft}"));
    fs::create_dir_all(&folder).expect("a folder");
    let mut text = String::from("t,x,v,a,b\n");
    for row in 0..400 + 10 * aircraft + flight {
        let t = row as f64 * 0.01;
        let (x, v) = ((3.0 * t + aircraft as f64).sin(), (1.7 * t + 2.0 * flight as f64).cos());
        let thrust = 3.0 + x - 0.5 * x * x;
        text.push_str(&format!("{t},{x},{v},{},{}\n", thrust - 0.7 * v, 2.0 * thrust));
    }
    fs::write(folder.join(format!("flight_{flight}.csv")), text).expect("a file");
}

const KEY: [&str; 2] = ["--key", "aircraft={dir1}"];

/// `scan -c plane.toml` with labels by folder and chunks of 100 rows.
fn scan(folder: &Path, arguments: &[&str]) -> Run {
    let all: Vec<&str> =
        ["scan", "-c", "plane.toml", "--json"].into_iter().chain(KEY).chain(arguments.iter().copied()).collect();
    fleetfoot(folder, &all)
}

#[test]
fn statistics_keep_the_sums_of_logs() {
    let folder = logs();
    let path = folder.path();
    let plan = scan(path, &["runs", "--chunk-rows", "100", "--dry-run"]).ok().json();
    assert_eq!(
        (plan["files"].as_u64(), plan["episodes"].as_u64(), plan["chunks"].as_u64()),
        (Some(6), Some(6), Some(30))
    );
    assert_eq!(plan["tasks"], serde_json::json!(["along", "normal"]));
    assert!(!path.join("run.stats").exists());

    let scanned = scan(path, &["runs", "--chunk-rows", "100"]).ok().json();
    assert_eq!(scanned["file"], "run.stats");
    assert_eq!(
        (scanned["chunks"].as_u64(), scanned["rows"]["complete"].as_u64()),
        (Some(30), Some(2 * (410 + 420 + 430) + 3))
    );
    let size = fs::metadata(path.join("run.stats")).expect("the statistic").len();
    assert_eq!(scanned["bytes"].as_u64(), Some(size));

    let info = fleetfoot(path, &["stats", "info", "run.stats", "--json"]).ok().json();
    assert_eq!(info["bytes"].as_u64(), Some(size));
    assert_eq!(info["labels"]["aircraft"]["2"], serde_json::json!({ "episodes": 2, "rows": 841 }));
    assert_eq!(info["labels"]["weather"]["wind"]["episodes"], 3);
    assert_eq!(info["latents"][0]["functions"], serde_json::json!(["1", "x", "x^2"]));
    assert_eq!(info["columns"].as_array().unwrap().iter().find(|column| column["name"] == "v").unwrap()["unit"], "m/s");
    for task in info["tasks"].as_array().expect("tasks") {
        assert!((task["r2"].as_f64().unwrap() - 1.0).abs() < 1e-12, "{task}");
        assert!(task["preconditioned_condition"].as_f64().unwrap() < 2.0, "{task}");
    }
    let text = fleetfoot(path, &["stats", "info", "run.stats", "--episodes", "--recipe"]).ok().out;
    for word in
        ["a = T - D", "T (3 functions)", "aircraft=3", "runs/2/flight_1.csv", "column v = v", "[latents.T]", "kB"]
    {
        assert!(text.contains(word), "`{word}` is missing from\n{text}");
    }
    // The same bits on any number of threads.
    scan(path, &["runs", "--chunk-rows", "100", "-o", "one.stats", "--threads", "1"]).ok();
    scan(path, &["runs", "--chunk-rows", "100", "-o", "seven.stats", "--threads", "7"]).ok();
    same(path, "run.stats", "one.stats");
    same(path, "run.stats", "seven.stats");
}

#[test]
fn merged_parts_equal_the_whole() {
    let folder = logs();
    let path = folder.path();
    let stats = |arguments: &[&str]| fleetfoot(path, &[&["stats"], arguments].concat());
    scan(path, &["runs", "--chunk-rows", "100", "-o", "all.stats"]).ok();
    for aircraft in ["1", "2", "3"] {
        let (data, output) = (format!("runs/{aircraft}"), format!("{aircraft}.stats"));
        scan(path, &[&data, "--plan", "all.stats", "-o", &output]).ok();
    }
    let merged = stats(&["merge", "3.stats", "1.stats", "2.stats", "-o", "merged.stats", "--json"]).ok().json();
    assert_eq!((merged["merged"].as_u64(), merged["episodes"].as_u64()), (Some(3), Some(6)));
    assert!(merged["bytes_before"].as_u64() > merged["bytes"].as_u64());
    same(path, "merged.stats", "all.stats");
    stats(&["merge", "all.stats", "2.stats", "-o", "twice.stats"]).fails(&[
        "the same log",
        "all.stats",
        "2.stats",
        "flight_0.csv",
    ]);
    stats(&["merge", "1.stats", "2.stats", "-o", "all.stats"]).fails(&["exists already", "--force"]);

    scan(path, &["runs/2", "runs/3", "--plan", "all.stats", "-o", "others.stats"]).ok();
    let dropped = stats(&["drop", "all.stats", "--where", "aircraft=1", "-o", "left.stats", "--json"]).ok().json();
    assert_eq!(dropped["dropped"].as_array().map(Vec::len), Some(2));
    same(path, "left.stats", "others.stats");
    stats(&["drop", "all.stats", "--where", "aircraft=9", "-o", "none.stats"])
        .fails(&["aircraft=9", "aircraft=1, aircraft=2"]);
    stats(&[
        "drop",
        "all.stats",
        "--episode",
        "runs/1/flight_0.csv",
        "--file",
        "runs/1/flight_1.csv",
        "-o",
        "also.stats",
    ])
    .ok();
    same(path, "also.stats", "others.stats");
    assert_eq!(stats(&["drop", "all.stats", "-o", "none.stats"]).code, 2, "what to drop must be said");
    assert!(!path.join("none.stats").exists());

    let compact = stats(&["compact", "all.stats", "-o", "compact.stats"]).ok();
    for word in ["30 chunks became 6, one for each episode", "bootstrap of blocks", "before", "now"] {
        assert!(compact.out.contains(word), "`{word}` is missing from {}", compact.out);
    }
    stats(&["info", "compact.stats"]).ok();
    stats(&["merge", "compact.stats", "1.stats", "-o", "x.stats"]).fails(&["the same log"]);
}

#[test]
fn a_statistic_grows_by_new_logs_only() {
    let folder = logs();
    let path = folder.path();
    scan(path, &["runs", "--append", "--chunk-rows", "100"]).ok();
    write_log(path, 4, 0);
    fs::copy(path.join("runs/4/flight_0.csv"), path.join("runs/4/copy.csv")).expect("a copy");
    let plan = scan(path, &["runs", "--append", "--dry-run"]).ok().json();
    assert_eq!(
        (plan["files"].as_u64(), plan["skipped"].as_u64(), plan["chunk_rows"].as_u64()),
        (Some(1), Some(7), Some(100))
    );
    let grown = scan(path, &["runs", "--append"]).ok().json();
    assert_eq!((grown["scanned"]["files"].as_u64(), grown["episodes"].as_u64()), (Some(1), Some(7)));
    assert_eq!(grown["skipped"].as_array().map(Vec::len), Some(7));
    assert!(grown["bytes"].as_u64() > grown["bytes_before"].as_u64());
    let before = fs::read(path.join("run.stats")).expect("a file");
    let again = scan(path, &["runs", "--append"]).ok();
    assert_eq!(again.json()["scanned"]["files"], 0);
    assert!(fs::read(path.join("run.stats")).expect("a file") == before);

    scan(path, &["runs"]).fails(&["run.stats exists already", "--append", "--force"]);
    fs::write(path.join("plane.toml"), RECIPE.replace("degree = 2", "degree = 3")).expect("a file");
    write_log(path, 5, 0);
    scan(path, &["runs", "--append"]).fails(&["run.stats", "different plans", "+ T : x^3"]);
    assert!(fs::read(path.join("run.stats")).expect("a file") == before);
    scan(path, &["runs", "--force"]).ok();
}

#[test]
fn mistakes_are_refused() {
    let folder = logs();
    let path = folder.path();
    scan(path, &["runs", "--key", "site={folder}"]).fails(&["site={folder}", "{dir1}"]);
    scan(path, &["runs", "-o", "runs/1/flight_0.csv", "--force"]).fails(&["flight_0.csv"]);
    scan(path, &["runs", "--plan", "no.stats"]).fails(&["no.stats"]);
    fleetfoot(path, &["stats", "info", "plane.toml"]).fails(&["plane.toml", "fleetfoot scan"]);
    scan(path, &["runs"]).ok();
    let mut bytes = fs::read(path.join("run.stats")).expect("a file");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(path.join("bad.stats"), &bytes).expect("a file");
    fleetfoot(path, &["stats", "info", "bad.stats"]).fails(&["bad.stats", "damaged", "section `"]);
    fs::write(path.join("short.stats"), &bytes[..middle]).expect("a file");
    fleetfoot(path, &["stats", "merge", "run.stats", "short.stats", "-o", "x.stats"])
        .fails(&["short.stats", "ends there"]);
    assert!(!path.join("x.stats").exists());
}

#[test]
fn statistics_fit_equations_and_regions() {
    let folder = logs();
    let path = folder.path();
    let columns = ["--states", "x,v", "--time", "t", "--degree", "1"];
    let run = |arguments: &[&str]| fleetfoot(path, &[arguments, &columns].concat());
    let scanned = run(&["scan", "runs", "--partition", "average,kmeans:2,3", "--json"]).ok().json();
    let serves: Vec<&str> =
        scanned["serves"].as_array().expect("methods").iter().flat_map(|method| method.as_str()).collect();
    let regions = "(--partition average | kmeans:2 | kmeans:3)";
    assert_eq!(serves, ["fit sparse", &format!("fit sindy {regions}"), &format!("fit pwa {regions}")]);
    let text = fleetfoot(path, &["stats", "info", "run.stats"]).ok().out;
    assert!(text.contains(&format!("serves without the logs: {}", serves.join(", "))), "{text}");

    for partition in ["average", "kmeans:3"] {
        run(&["fit", "sindy", "runs", "--partition", partition, "-o", "logs.json"]).ok();
        run(&["fit", "sindy", "run.stats", "--partition", partition, "-o", "statistic.json"]).ok();
        same(path, "logs.json", "statistic.json");
    }
    let fitted = run(&["fit", "pwa", "run.stats", "--partition", "average,kmeans:2,3", "-o", "pwa.json"]).ok();
    assert!(fitted.out.contains("R2, cross-validated") && fitted.out.contains("<- chosen"), "{}", fitted.out);
    assert!(fitted.err.contains("absolute errors") && fitted.err.contains("clustered on all rows"), "{}", fitted.err);
    fleetfoot(path, &["score", "pwa.json", "runs"]).ok();
    run(&["fit", "pwa", "run.stats", "--partition", "kmeans:7", "-o", "no.json"]).fails(&["kmeans:7", "scan again"]);
    run(&["fit", "sindy", "run.stats", "--partition", "kmeans:7", "-o", "no.json"]).fails(&["kmeans:7", "scan again"]);
}

/// Every method, from the logs, their statistic, that of two halves joined, and that of two machines which have a part
/// of the logs each. One model, to the byte. `fit pwa` adds to a model of logs the values that need rows.
#[test]
fn statistics_and_logs_give_one_model() {
    let folder = logs();
    let path = folder.path();
    fs::write(path.join("lags.toml"), "[model]\ndegree = 1\n[narx]\nlags_out = 2\nlags_in = 1\n").expect("a file");
    // A machine has its own logs, where the first has all, and the plan.
    let machine = |aircraft: &[usize]| {
        let other = tempfile::tempdir().expect("a folder");
        for recipe in ["plane.toml", "lags.toml"] {
            fs::copy(path.join(recipe), other.path().join(recipe)).expect("a recipe");
        }
        for &aircraft in aircraft {
            (0..2).for_each(|flight| write_log(other.path(), aircraft, flight));
        }
        other
    };
    let (first, second) = (machine(&[1, 2]), machine(&[3]));
    let states = "--states x,v --time t --degree 1 --partition average,kmeans:3";
    for (method, of_scan, of_fit) in [
        ("sparse", "-c plane.toml", "-c plane.toml"),
        ("sindy", states, "--states x,v --time t --degree 1 --partition kmeans:3"),
        ("pwa", states, "--states x,v --time t --degree 1 --partition kmeans:3"),
        (
            "narx",
            "-c lags.toml --states x --inputs v --time t",
            "-c lags.toml --outputs x --inputs v --time t --select bic",
        ),
    ] {
        let scan = |folder: &Path, data: &[&str], more: &[&str], output: &str| {
            let arguments: Vec<&str> =
                ["scan"].into_iter().chain(data.iter().copied()).chain(of_scan.split(' ')).collect();
            fleetfoot(folder, &[&arguments, more, &["-o", output, "--force"]].concat()).ok()
        };
        let fit = |data: &str, model: &str| {
            let arguments: Vec<&str> = ["fit", method, data].into_iter().chain(of_fit.split(' ')).collect();
            fleetfoot(path, &[&arguments, &["-o", model][..]].concat()).ok()
        };
        scan(path, &["runs"], &[], "whole.stats");
        for (data, output) in [(["runs/2", "runs/3"], "half.stats"), (["runs/1", "runs/1"], "other.stats")] {
            let data = if data[0] == data[1] { &data[..1] } else { &data[..] };
            scan(path, data, &["--plan", "whole.stats"], output);
        }
        for (machine, name) in [(&first, "here.stats"), (&second, "there.stats")] {
            fs::copy(path.join("whole.stats"), machine.path().join("plan.stats")).expect("the plan");
            scan(machine.path(), &["runs"], &["--plan", "plan.stats"], name);
            fs::copy(machine.path().join(name), path.join(name)).expect("the statistic");
        }
        for (parts, output) in
            [(["half.stats", "other.stats"], "halves.stats"), (["there.stats", "here.stats"], "machines.stats")]
        {
            fleetfoot(path, &["stats", "merge", parts[0], parts[1], "-o", output, "--force"]).ok();
        }
        for statistic in ["whole", "halves", "machines"] {
            fit(&format!("{statistic}.stats"), &format!("{statistic}.json"));
        }
        same(path, "whole.json", "halves.json");
        same(path, "whole.json", "machines.json");
        fit("runs", "logs.json");
        if method == "pwa" {
            assert_eq!(of_sums(path, "logs.json"), of_sums(path, "whole.json"));
        } else {
            same(path, "logs.json", "whole.json");
        }
    }
}

/// `fit pwa` from logs, from their statistic and from that of two halves joined: one model, to the byte. Folds cut
/// these logs into spans. Only a fit of logs has the values that need rows: mean absolute deviations and the
/// correlation of residuals.
#[test]
fn piecewise_models_agree_with_statistics() {
    let folder = logs();
    let path = folder.path();
    // A label beside the rest, which changes along a log.
    for aircraft in 1..=3 {
        for flight in 0..2 {
            let log = path.join(format!("runs/{aircraft}/flight_{flight}.csv"));
            let text = fs::read_to_string(&log).expect("a log");
            let label = |(row, line): (usize, &str)| match row {
                0 => format!("{line},load\n"),
                _ => format!("{line},{}\n", 1 + (row / 70 + flight) % 2),
            };
            fs::write(&log, text.lines().enumerate().map(label).collect::<String>()).expect("a log");
        }
    }
    let run = |arguments: &str, more: &str| {
        let words: Vec<&str> = arguments.split(' ').chain(more.split(' ')).filter(|word| !word.is_empty()).collect();
        fleetfoot(path, &words).ok()
    };
    for (columns, partitions) in [
        ("--states x,v --time t --degree 1", ["average", "labels:load", "kmeans:3"]),
        ("--states x,v --time t --degree 2", ["average", "labels:load", "null,average,kmeans:2"]),
    ] {
        for partition in partitions {
            let asked = format!("{columns} --partition {partition}");
            run("scan runs -o whole.stats --force", &asked);
            run("scan runs/2 runs/3 --plan whole.stats -o half.stats --force", &asked);
            run("scan runs/1 --plan whole.stats -o other.stats --force", &asked);
            run("stats merge half.stats other.stats -o halves.stats --force", "");
            for (data, output) in [("runs", "logs"), ("whole.stats", "whole"), ("halves.stats", "halves")] {
                run(&format!("fit pwa {data} -o {output}.json"), &asked);
            }
            same(path, "whole.json", "halves.json");
            let (logs, statistic) = (of_sums(path, "logs.json"), of_sums(path, "whole.json"));
            for part in ["latents", "partitions", "training"] {
                assert_eq!(logs[part], statistic[part], "{asked}: {part}");
            }
            assert_eq!(logs, statistic, "{asked}");
        }
    }
}

/// A model of `fit pwa` without the values that need rows, which a fit of logs adds.
fn of_sums(folder: &Path, file: &str) -> serde_json::Value {
    let text = fs::read_to_string(folder.join(file)).expect("a model");
    let mut model = serde_json::from_str::<serde_json::Value>(&text).expect("JSON")["model"].take();
    model["training"].as_object_mut().expect("training").remove("target_deviation").expect("a deviation");
    for partition in model["partitions"].as_array_mut().expect("partitions") {
        partition.as_object_mut().expect("a partition").remove("correlation");
    }
    model
}
