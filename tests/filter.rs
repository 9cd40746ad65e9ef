//! `filter`, and the filter as code.

use std::fs;

use fleetfoot::{Recipe, Silent, read_rows};

use crate::{closed_loop::fitted, runner::*};

/// A measurement of a column with normal noise, as an expression: Box and Muller's transform of two numbers that depend
/// on the stamp only.
fn noisy(column: &str, deviation: f64, key: u32) -> String {
    let uniform = |key: u32| format!("wrap(1e7*sin({key}*t))");
    format!(
        "{column}={column} + {deviation}*sqrt(-2*log(0.5 + {}/6.283185307179586))*cos({})",
        uniform(100_003 + 40 * key),
        uniform(100_019 + 40 * key)
    )
}

/// The cells of a column of a table.
fn cells(text: &str, column: &str) -> Vec<String> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let at = header.iter().position(|field| *field == column).unwrap_or_else(|| panic!("{column}: {header:?}"));
    lines.map(|line| line.split(',').nth(at).expect("a cell").to_owned()).collect()
}

#[test]
fn estimates_are_causal_and_thread_independent() {
    let folder = fitted();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let sensors = [noisy("x", 0.01, 1), noisy("y", 0.01, 2), noisy("yaw", 0.02, 3)].join(",");
    let filter = |log: &str, output: &str, threads: &str| {
        let arguments = ["filter", "model.json", log, "--measured", "x=0.01,y=0.01,yaw=0.02", "--sensors", &sensors];
        let more = ["--truth", "x=x,y=y,yaw=yaw,vx=vx", "-o", output, "--threads", threads, "--json"];
        let report = run(&[&arguments[..], &more].concat()).ok().json();
        (report, fs::read_to_string(folder.path().join(output)).expect("estimates"))
    };
    let (report, text) = filter("run_2.csv", "1.csv", "1");
    for threads in ["2", "7"] {
        let (other, same) = filter("run_2.csv", "other.csv", threads);
        assert!(other == report && same == text, "{threads} threads");
    }
    let states: Vec<&str> =
        report["states"].as_array().expect("states").iter().filter_map(|state| state.as_str()).collect();
    assert!(states.contains(&"vx") && report["nis"]["freedom"] == 3 && report["nees"]["freedom"] == 4, "{report}");
    for truth in report["truth"].as_array().expect("errors") {
        if let Some(measured) = truth["measured_rmse"].as_f64() {
            assert!(truth["rmse"].as_f64().expect("a number") < measured, "{truth}");
        }
    }
    // Half of the log gives the first half of the estimates, to the bit.
    let log = fs::read_to_string(folder.path().join("run_2.csv")).expect("a log");
    let half: Vec<&str> = log.lines().take(log.lines().count() / 2).collect();
    fs::write(folder.path().join("half.csv"), half.join("\n") + "\n").expect("written");
    let (_, first) = filter("half.csv", "half_estimates.csv", "1");
    for column in ["vx", "vx deviation", "x innovation", "log likelihood"] {
        let (whole, part) = (cells(&text, column), cells(&first, column));
        assert!(part.len() == half.len() - 1 && whole[..part.len()] == part, "{column}");
    }
}

#[test]
fn messages_equal_the_table() {
    let folder = fitted();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let sensors = [noisy("x", 0.01, 1), noisy("y", 0.01, 2)].join(",");
    let asked = ["filter", "model.json", "run_2.csv", "--measured", "x=0.01,y=0.01", "--sensors", &sensors, "-o"];
    run(&[&asked[..], &["estimates.csv"]].concat()).ok();
    let output = run(&[&asked[..], &["estimates.mcap"]].concat()).ok();
    assert!(output.err.contains("estimates.foxglove.json"), "{}", output.err);
    let plots = fs::read_to_string(folder.path().join("estimates.plotjuggler.xml")).expect("a layout");
    assert!(plots.contains("/fleetfoot/measured/x/position") && plots.contains("/fleetfoot/estimate/vx/position"));
    let text = fs::read_to_string(folder.path().join("estimates.csv")).expect("estimates");
    let same = [
        ("vx", "/fleetfoot/estimate.position[vx]"),
        ("vx deviation", "/fleetfoot/deviation.position[vx]"),
        ("y innovation", "/fleetfoot/innovation.position[y]"),
        ("x innovation deviation", "/fleetfoot/innovation_deviation.position[x]"),
        ("log likelihood", "/fleetfoot/region.position[log_likelihood]"),
        ("region", "/fleetfoot/region.position[region]"),
    ];
    let names: Vec<String> = same.iter().map(|(_, field)| (*field).to_owned()).collect();
    let recipe = Recipe::parse("[time]\nbase = \"/fleetfoot/estimate\"\n", "test").expect("a recipe");
    let read = read_rows(&recipe, Some(&names), &[folder.path().join("estimates.mcap")], &Silent).expect("messages");
    for ((column, _), (_, values)) in same.iter().zip(&read.columns) {
        // The first row has no innovation, and no message of one.
        let expected: Vec<f64> = cells(&text, column)[1..].iter().map(|cell| cell.parse().expect("a number")).collect();
        assert!(expected.len() > 100 && values[values.len() - expected.len()..] == expected, "{column}");
    }
}

#[test]
fn filter_options_are_checked() {
    let folder = fitted();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let filter = |more: &[&str]| run(&[&["filter", "model.json", "run_2.csv"], more].concat());
    filter(&["--measured", "xx"]).fails(&["no state `xx`", "there is"]);
    filter(&["--measured", "x=0"]).fails(&["positive number"]);
    filter(&["--truth", "xx=x"]).fails(&["no state `xx`"]);
    filter(&["--sensors", "x"]).fails(&["STATE=FIELD"]);
    filter(&["--initial", "x=1"]).fails(&["STATE=MEAN:DEVIATION"]);
    filter(&["--process", "much"]).fails(&["a number, or \"auto\""]);
    // Its residuals are rounding.
    filter(&["--measured", "x=0.01", "--noise", "coloured"]).fails(&["no autoregression of its residuals", "white"]);
    filter(&["-o", "estimates.bag"]).fails(&["*.parquet", "*.mcap"]);
    // By default the log's columns are measured, and the filter estimates their noise.
    let output = filter(&[]).ok();
    assert!(output.err.contains("estimated from the innovations so far"), "{}", output.err);
    assert!(output.out.contains("NIS") && output.out.contains("innovations"), "{}", output.out);
    let json = filter(&["--measured", "x=0.01", "--process", "auto", "--json"]).ok().json();
    assert!(
        json["process"].as_f64().expect("a factor") != 1.0 && json["sensors"][0]["deviation_from"] == "given",
        "{json}"
    );
    run(&["export", "model.json", "--to", "c", "--filter"]).fails(&["no state is measured"]);
}

/// The hexapod over a stride: its place, from a camera's noise, by a model of other runs. Its residuals over a stride
/// are the noise of its strides.
#[test]
fn hexapod_errors_match_the_filter() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let generate = ["generate", "hexapod", "--runs", "3", "--seconds", "30", "--speed", "0.25:0.35"];
    run(&[&generate[..], &["--excitation", "ornstein-uhlenbeck", "--format", "parquet", "-o", "belt"]].concat()).ok();
    let recipe = "[states]\nx = { derivative = { over = 200 }, regressor = false }\ny = { derivative = { over = 200 }, regressor = false }\n\
         yaw = { derivative = { over = 200 } }\n[inputs]\nu_v = \"u_v\"\nu_w = \"u_w\"\nbelt_speed = \"belt_speed\"\n[time]\ncolumn = \"t\"\n\
         [filter]\nmeasured = \"x=0.005,y=0.005,yaw=0.02\"\ntruth = \"x=x,y=y,yaw=yaw\"\n";
    fs::write(folder.path().join("place.toml"), recipe).expect("written");
    let logs = ["belt/hexapod_00.parquet", "belt/hexapod_01.parquet"];
    let fit = [&["fit", "pwa", "-c", "place.toml"], &logs[..], &["--partition", "tree:2", "-o", "place.json"]].concat();
    run(&fit).ok();
    let sensors = [noisy("x", 0.005, 1), noisy("y", 0.005, 2), noisy("yaw", 0.02, 3)].join(",");
    let report = run(&["filter", "place.json", "belt/hexapod_02.parquet", "--sensors", &sensors, "--json"]).ok().json();
    println!("{report}");
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let nees = &report["nees"];
    assert!(report["regions"].as_u64().expect("regions") > 1 && report["exact"] == true);
    // Errors that neighbouring rows share within a stride are not coloured noise.
    assert_eq!(report["noise_rows"], 0);
    assert!((number(&nees["low"])..=number(&nees["high"])).contains(&number(&nees["mean"])), "{nees}");
    assert!((number(&nees["share"]) - 0.95).abs() < 0.03, "{nees}");
    for truth in report["truth"].as_array().expect("errors") {
        assert!(number(&truth["rmse"]) < 0.6 * number(&truth["measured_rmse"]), "{truth}");
    }
    // Affine regions become code.
    run(&["export", "place.json", "--to", "c", "--filter", "--prefix", "place", "-o", "src"]).ok();
    assert!(folder.path().join("src/place_filter.c").is_file());
}

/// The hexapod from row to row: errors of steps are correlated, and the filter that models this has errors as large as
/// it predicts.
#[test]
fn coloured_noise_widens_hexapod_errors() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let generate = ["generate", "hexapod", "--runs", "2", "--seconds", "10", "--speed", "0.3"];
    run(&[&generate[..], &["--excitation", "ornstein-uhlenbeck", "--format", "parquet", "-o", "belt"]].concat()).ok();
    let recipe = "[states]\nvx = {}\nvy = {}\nwz = {}\nyaw = { kind = \"angle\", regressor = false }\n[inputs]\nu_v = \"u_v\"\nu_w = \"u_w\"\n\
         [time]\ncolumn = \"t\"\n[model]\npredict = \"delta\"\n[filter]\nmeasured = \"vx=0.02,yaw=0.02\"\ntruth = \"vx=vx,vy=vy,wz=wz\"\n";
    fs::write(folder.path().join("rows.toml"), recipe).expect("written");
    run(&["fit", "pwa", "-c", "rows.toml", "belt/hexapod_00.parquet", "--partition", "average", "-o", "rows.json"])
        .ok();
    let sensors = [noisy("vx", 0.02, 1), noisy("yaw", 0.02, 2)].join(",");
    let filtered = |model: &str, noise: &str| {
        let asked = ["filter", model, "belt/hexapod_01.parquet", "--sensors", &sensors, "--noise", noise, "--json"];
        run(&asked).ok().json()
    };
    let (white, coloured) = (filtered("rows.json", "white"), filtered("rows.json", "auto"));
    println!("{white}\n{coloured}");
    let mean = |report: &serde_json::Value, of: &str| report[of]["mean"].as_f64().expect("a number");
    assert!(white["noise_rows"] == 0 && coloured["noise_rows"].as_u64().expect("rows") > 1);
    assert!(mean(&white, "nees") > 3.0 && mean(&white, "nis") > 1.3, "{white}");
    assert!((mean(&coloured, "nees") - 1.0).abs() < 0.25 && (mean(&coloured, "nis") - 1.0).abs() < 0.1, "{coloured}");
    assert!(coloured["log_likelihood"].as_f64() > white["log_likelihood"].as_f64());
    // The rows of a statistic have no order.
    run(&["scan", "-c", "rows.toml", "belt/hexapod_00.parquet", "--partition", "average", "-o", "rows.stats"]).ok();
    run(&["fit", "pwa", "rows.stats", "-o", "summed.json"]).ok();
    assert_eq!(filtered("summed.json", "auto")["noise_rows"], 0);
    let asked = ["filter", "summed.json", "belt/hexapod_01.parquet", "--noise", "coloured"];
    run(&asked).fails(&["did not fit the model to logs", "choose white noise"]);
}

#[test]
fn labels_set_regions_and_columns_deviations() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let write = |name: &str, text: String| fs::write(folder.path().join(name), text).expect("written");
    let recipe = "[states]\nv = { derivative = \"dv\" }\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n";
    write("robot.toml", recipe.to_owned());
    let plain = |rows, phase| robot_csv(rows, phase).replace("v [m/s]", "v");
    write("train.csv", plain(3000, 0.0));
    // A column has the deviation of the noise, row by row.
    let log = plain(1000, 1.0);
    let with_deviation = |(i, line): (usize, &str)| {
        let deviation = if i % 2 == 0 { 0.02 } else { 0.05 };
        if i == 0 { format!("{line},v_deviation") } else { format!("{line},{deviation}") }
    };
    write("run.csv", log.lines().enumerate().map(with_deviation).collect::<Vec<_>>().join("\n") + "\n");
    run(&["fit", "pwa", "-c", "robot.toml", "train.csv", "--partition", "labels:mode", "-o", "model.json"]).ok();
    let arguments = ["filter", "model.json", "run.csv", "--truth", "v=v", "-o", "estimates.csv", "--json"];
    let output = run(&arguments).ok();
    let report = output.json();
    assert!(output.err.contains("the log's columns"), "{}", output.err);
    assert!(report["regions"] == 2 && report["sensors"][0]["deviation_from"] == "column", "{report}");
    let text = fs::read_to_string(folder.path().join("estimates.csv")).expect("estimates");
    let (slip, mode) = (cells(&text, "probability slip"), cells(&log, "mode"));
    // The region is that of the step which led to a row: the label of the row before.
    for row in 1..slip.len() {
        let expected = if mode[row - 1] == "slip" { 1.0 } else { 0.0 };
        assert_eq!(slip[row].parse::<f64>().expect("a number"), expected, "row {row}");
    }
    // The exact model follows the exact log; its steps are Euler's there and exact here.
    let error = report["truth"][0]["rmse"].as_f64().expect("a number");
    assert!(error < 0.01, "{error}");
    let spread = cells(&text, "v innovation deviation");
    let spread = |row: usize| spread[row].parse::<f64>().expect("a number");
    assert!(spread(500) < 0.03 || spread(501) < 0.03);
    assert!((spread(500) - spread(501)).abs() > 0.02, "{} {}", spread(500), spread(501));
    // A sensor that is slower than the rows is held between its samples, with a note.
    let slow = ["filter", "model.json", "run.csv", "--measured", "v=0.05", "--sensors", "v=0.1*sign(sin(7*t))"];
    let output = run(&slow).ok();
    assert!(output.err.contains("repeat the previous one") && output.err.contains("[time] base"), "{}", output.err);
}

/// `v' = 6 v + u` below 0 and `-2 v + u` above, measured in runs of five rows; and a log of it with a gap of 200 s.
fn unstable_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let noise = |key: u64| fleetfoot::data::mix(key) as f64 / u64::MAX as f64 - 0.5;
    let mut text = String::from("t,v,u,w\n");
    for run in 0..200 {
        let mut v = 6.0 * noise(run);
        for row in 0..5 {
            let u = 2.0 * noise(1000 * (run + 1) + row);
            let w = if v < 0.0 { 6.0 * v } else { -2.0 * v } + u;
            text.push_str(&format!("{},{v},{u},{w}\n", 100.0 * run as f64 + 0.05 * row as f64));
            v += 0.05 * w;
        }
    }
    fs::write(folder.path().join("runs.csv"), text).expect("a log");
    let mut text = String::from("t,v,u\n");
    for row in 0..100 {
        let gap = if row < 60 { 0.0 } else { 200.0 };
        text.push_str(&format!("{},{},{}\n", 5.5 * row as f64 + gap, 4.0 * noise(row + 7), 0.1 * noise(row + 5000)));
    }
    fs::write(folder.path().join("far.csv"), text).expect("a log");
    let fit = "fit pwa runs.csv --states v --inputs u --derivative v=w --time t --time-unit s --max-gap 1 -p kmeans:2 -o u.json";
    fleetfoot(folder.path(), &fit.split(' ').collect::<Vec<_>>()).ok();
    folder
}

#[test]
fn infinite_covariances_end_the_episode() {
    let folder = unstable_folder();
    let filter = "filter u.json far.csv --measured v=0.01 --max-gap none -o f.csv --json";
    let output = fleetfoot(folder.path(), &filter.split(' ').collect::<Vec<_>>()).ok();
    assert!(output.err.contains("the filter ends before row 61") && output.err.contains("--max-gap"), "{}", output.err);
    let report = output.json();
    assert_eq!((report["rows"].as_u64(), report["lost_rows"].as_u64()), (Some(100), Some(40)));
    assert!(report["log_likelihood"].as_f64().is_some_and(f64::is_finite), "{report}");
    let text = fs::read_to_string(folder.path().join("f.csv")).expect("estimates");
    let (means, regions) = (cells(&text, "v"), cells(&text, "region"));
    assert!(means[..60].iter().all(|cell| !cell.is_empty()) && means[60..].iter().all(String::is_empty), "{text}");
    assert!(regions[..60].iter().all(|cell| cell != "-1") && regions[60..].iter().all(|cell| cell == "-1"), "{text}");
    // The episodes between long gaps are filtered to their ends.
    let filter = "filter u.json far.csv --measured v=0.01 --json";
    let report = fleetfoot(folder.path(), &filter.split(' ').collect::<Vec<_>>()).ok().json();
    assert_eq!(report["lost_rows"].as_u64(), Some(0));
}
