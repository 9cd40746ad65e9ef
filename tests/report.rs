//! The page that shows the result, as its readers open it.

use std::fs;

use fleetfoot::report::words::within;

use crate::runner::*;

/// A folder with logs, models of two partitions, and a held-out log of so many rows.
pub(crate) fn models(rows: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, rows, phase) in [("one.csv", 1500, 0.0), ("two.csv", 1500, 1.0), ("held-out.csv", rows, 9.0)] {
        fs::write(folder.path().join(name), robot_csv(rows, phase)).expect("a file");
    }
    let recipe = "[columns]\nv = \"`v [m/s]`\"\n[states]\nx = { known = \"v\", regressor = false }\nv = { derivative = \"forward\" }\n\
                  [inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n";
    fs::write(folder.path().join("robot.toml"), recipe).expect("a file");
    let partitions = ["fit", "pwa", "-c", "robot.toml", "one.csv", "two.csv", "--partition", "average,kmeans:4"];
    let flags = ["--partition-on", "v", "--keep-all", "-o", "model.json"];
    fleetfoot(folder.path(), &[&partitions[..], &flags].concat()).ok();
    folder
}

fn page(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).expect("a page")
}

#[test]
fn pages_have_findings_and_figures() {
    let folder = models(1200);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let report = run(&[
        "report",
        "model.json",
        "held-out.csv",
        "--horizon",
        "40",
        "--svg",
        "figures",
        "--csv",
        "numbers",
        "--json",
    ])
    .json();
    let findings = report["findings"].as_array().expect("findings");
    let heads: Vec<&str> = findings.iter().filter_map(|finding| finding["head"].as_str()).collect();
    assert_eq!(heads[0], "What was fitted.", "{heads:?}");
    // The row before predicts an acceleration better than any model does.
    assert!(heads.contains(&"One step ahead, a baseline has a lower error than this model."), "{heads:?}");
    assert!(heads.iter().any(|head| head.starts_with("Simulated, it is better than every baseline")), "{heads:?}");
    assert!(report["in_sample_episodes"].as_array().expect("a list").is_empty());
    let html = page(folder.path(), "report.html");
    assert!(html.starts_with("<!DOCTYPE html>") && !html.contains("<script"));
    let sections = ["verdict", "one-step", "simulation", "rows", "model", "data"];
    let figures = [
        "errors-by-target",
        "score-by-horizon",
        "simulated-in-time-1",
        "simulated-in-time-2",
        "simulated-regions",
        "error-autocorrelation",
        "error-over-columns-1",
        "transitions-logs",
        "coverage",
    ];
    for id in sections.into_iter().chain(figures) {
        assert_eq!(html.matches(&format!("id=\"{id}\"")).count(), 1, "{id}");
    }
    // The scores are those of `score`.
    let scored = run(&["score", "model.json", "held-out.csv", "--json"]).json();
    let error = scored["targets"][0]["mae_over_null"]["value"].as_f64().expect("a number");
    assert!(html.contains(&format!(">{error:.3}<")), "{error}");
    let figures = report["figures"].as_array().expect("figures");
    let (drawn, tables): (Vec<&str>, Vec<&str>) =
        figures.iter().filter_map(|figure| figure.as_str()).partition(|figure| figure.ends_with(".svg"));
    assert!(drawn.len() >= 10 && tables.len() == drawn.len(), "{figures:?}");
    for figure in drawn {
        let svg = page(folder.path(), figure);
        assert!(svg.starts_with("<svg") && svg.contains("xmlns=\"http://www.w3.org/2000/svg\""));
    }
    // The numbers of the figures have all digits: those of the histogram are whole rows.
    let coverage = page(folder.path(), "numbers/coverage.csv");
    let rows = coverage.lines().filter(|line| line.starts_with("v [m/s],"));
    let shares: f64 =
        rows.map(|line| line.split(',').nth(2).and_then(|share| share.parse::<f64>().ok()).expect("a share")).sum();
    assert!((shares - 100.0).abs() < 1e-9, "{shares}");

    simulations_are_drawn_over_recordings(folder.path());
    assert!(html.contains("95 % intervals of least squares") && html.contains("differs from zero"), "intervals");

    let output =
        run(&["report", "model_average.json", "model_kmeans4.json", "one.csv", "held-out.csv", "-o", "both.html"]);
    assert!(output.out.contains("One step ahead pwa kmeans:4 is best."), "{}", output.out);
    assert!(output.err.contains("1 of 2 episodes were used in training"), "{}", output.err);
    assert!(page(folder.path(), "both.html").contains("some of these rows trained the model"));

    let alone = run(&["report", "model.json", "-o", "alone.html"]).out;
    assert!(alone.contains("fact: What was fitted."), "{alone}");
    assert!(page(folder.path(), "alone.html").contains("No log was given"));
}

/// Fig. 7 of the paper on piecewise-affine models of a running robot. The recording is that of the log, and every
/// simulation begins on it and continues as in `rollout`.
fn simulations_are_drawn_over_recordings(folder: &Path) {
    let drawn = page(folder, "numbers/simulated-in-time-1.csv");
    assert!(drawn.starts_with("time since the start of the log [s],recorded,simulated"), "{drawn}");
    let log = page(folder, "held-out.csv");
    let head: Vec<&str> = log.lines().next().expect("a head").split(',').collect();
    let column = |name: &str| head.iter().position(|field| *field == name).expect("a column");
    let (time, speed) = (column("t"), column("v [m/s]"));
    let number = |text: &str| text.parse::<f64>().expect("a number");
    let recorded: Vec<[f64; 2]> = log
        .lines()
        .skip(1)
        .map(|row| row.split(',').collect::<Vec<_>>())
        .map(|cells| [number(cells[time]), number(cells[speed])])
        .collect();
    let mut begun = Vec::new();
    let mut before = "";
    for cells in drawn.lines().skip(1).map(|row| row.split(',').collect::<Vec<_>>()) {
        let since = number(cells[0]);
        let row = recorded.iter().position(|row| (row[0] - recorded[0][0] - since).abs() < 1e-6).expect("a row");
        assert_eq!(number(cells[1]), recorded[row][1], "row {row}");
        if before.is_empty() && !cells[2].is_empty() {
            assert_eq!(cells[1], cells[2], "a simulation begins at what was recorded");
            begun.push(row);
        }
        before = cells[2];
    }
    // Between one simulation and the next there is a row that only was recorded.
    assert!(begun.len() == 4 && begun.windows(2).all(|pair| pair[1] - pair[0] == 42), "{begun:?}");
}

/// Three hundred logs of twelve rows each.
#[test]
fn many_logs_have_room() {
    let folder = tempfile::tempdir().expect("a folder");
    for log in 0..300 {
        let row = |row: i32| {
            let t = 0.01 * f64::from(row);
            let angle = t + f64::from(log);
            format!("{t},{},{}\n", angle.sin(), angle.cos())
        };
        let text = format!("t,x,v\n{}", (0..12).map(row).collect::<String>());
        fs::write(folder.path().join(format!("log_{log:03}.csv")), text).expect("a file");
    }
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    run(&["fit", "pwa", "log_*.csv", "--states", "x,v", "--time", "t", "-o", "model.json"]);
    run(&["report", "model.json", "log_*.csv", "--horizon", "4", "--starts", "50"]);
    let html = page(folder.path(), "report.html");
    assert!(html.contains("Shown are 24 of 300 logs.") && html.contains("288 better logs"));
    assert!(html.contains("all of these rows trained the model") && html.len() < 1_000_000, "{} bytes", html.len());
}

#[test]
fn pages_have_the_same_bytes_and_size() {
    let folder = models(20_000);
    let write = |threads: &str| {
        let flags = ["--horizon", "40", "--threads", threads, "-o", "report.html"];
        fleetfoot(folder.path(), &[&["report", "model.json", "held-out.csv"], &flags[..]].concat()).ok();
        page(folder.path(), "report.html")
    };
    let single = write("1");
    for threads in ["2", "7"] {
        assert!(write(threads) == single, "{threads} threads");
    }
    fs::write(folder.path().join("held-out.csv"), robot_csv(200_000, 9.0)).expect("a file");
    let more = write("0");
    let growth = more.len() as f64 / single.len() as f64;
    assert!((0.9..1.1).contains(&growth), "{} bytes, then {}", single.len(), more.len());
}

#[test]
fn pages_show_selection_from_fit_reports() {
    let folder = models(600);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let keep = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("a file");
    let sindy =
        run(&["fit", "sindy", "-c", "robot.toml", "one.csv", "two.csv", "--degree", "2", "-o", "sindy.json", "--json"]);
    keep("sindy-fit.json", &sindy.out);
    let recipe = "[model]\npredict = \"dv\"\n[inputs]\nv = \"`v [m/s]`\"\nu = \"u\"\n[library]\nfunctions = [\"poly(2)\"]\n[time]\ncolumn = \"t\"\n";
    keep("sparse.toml", recipe);
    let flags = ["--bolasso", "chunks:16", "-o", "sparse.json", "--json"];
    let sparse = run(&[&["fit", "sparse", "-c", "sparse.toml", "one.csv", "two.csv"], &flags[..]].concat());
    keep("sparse-fit.json", &sparse.out);

    run(&[
        "report",
        "sindy.json",
        "held-out.csv",
        "--fit",
        "sindy-fit.json",
        "--fit",
        "sparse-fit.json",
        "--csv",
        "sindy",
        "-o",
        "sindy.html",
    ]);
    let html = page(folder.path(), "sindy.html");
    assert!(html.contains("id=\"front-1\"") && !html.contains("id=\"validation-1\""));
    check_term_contributions(&sindy.json(), &html, &page(folder.path(), "sindy/terms-1-1.csv"));
    let output = run(&["report", "sparse.json", "held-out.csv", "--fit", "sparse-fit.json", "--csv", "numbers"]);
    let html = page(folder.path(), "report.html");
    for id in ["validation-1", "path-1", "selection-frequency", "excitation-1"] {
        assert_eq!(html.matches(&format!("id=\"{id}\"")).count(), 1, "{id}");
    }
    assert!(!output.err.contains("whose model is not"), "{}", output.err);
    // The frequencies are those of the report, and so is the path, which is zero at its first lambda and the penalised fit at the chosen one.
    let report = sparse.json();
    let path = &report["path"];
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let lambdas: Vec<f64> = path["lambdas"].as_array().expect("lambdas").iter().map(number).collect();
    let chosen = number(&report["lambda"]["value"]);
    assert!(lambdas.is_sorted_by(|a, b| a > b) && lambdas[0] > chosen && lambdas[lambdas.len() - 1] < chosen);
    let drawn = page(folder.path(), "numbers/path-1.csv");
    assert_eq!(drawn.lines().count(), lambdas.len() + 1, "{drawn}");
    for along in path["functions"].as_array().expect("functions") {
        assert_eq!(along["coefficients"].as_array().map(Vec::len), Some(lambdas.len()));
        // The constant is not penalised.
        let name = along["function"].as_str().expect("a name");
        let first = number(&along["coefficients"][0]);
        assert!(name.ends_with(": 1") || first == 0.0, "nothing is in at the largest lambda: {name} {first}");
    }
    let functions = report["latents"][0]["functions"].as_array().expect("functions");
    let frequencies = page(folder.path(), "numbers/selection-frequency.csv");
    for function in functions {
        let name = function["function"].as_str().expect("a name");
        let share = function["frequency"].as_f64().expect("a share");
        assert!(frequencies.contains(&format!("\n{name},{share},,\n")), "{name} {share}: {frequencies}");
    }

    // The report of a piecewise fit has the number of rows that count as independent.
    let fit = ["fit", "pwa", "-c", "robot.toml", "one.csv", "two.csv", "--partition", "average", "-o", "average.json"];
    let fit = run(&[&fit[..], &["--json"]].concat());
    keep("pwa-fit.json", &fit.out);
    run(&["report", "average.json", "--fit", "pwa-fit.json", "-o", "average.html"]);
    let independent = fit.json()["effective_rows"].as_f64().expect("a number").round();
    let html = page(folder.path(), "average.html");
    assert!(html.contains(&format!("{independent} of 2998 rows count as independent")), "{independent}");

    let output = run(&["report", "sindy.json", "--fit", "sparse-fit.json"]);
    assert!(output.err.contains("whose model is not on this page, by hash: 1"), "{}", output.err);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    run(&["report", "sindy.json", "--fit", "one.csv"])
        .fails(&["one.csv is not JSON", "the output of a fit with --json"]);
    run(&["report", "sindy.json", "--fit", "sindy.json"]).fails(&["not a report of a fit", "--json"]);
}

/// A function contributes its coefficient times its root mean square to the models that have it, and nothing to the
/// others. Intervals are those of the report.
fn check_term_contributions(report: &serde_json::Value, html: &str, drawn: &str) {
    let equation = &report["regions"][0]["equations"][0];
    let front = equation["front"].as_array().expect("a front");
    let mut lines = drawn.lines();
    let names: Vec<&str> = lines.next().expect("a head").split(',').skip(1).collect();
    assert_eq!(drawn.lines().count(), front.len() + 1, "{drawn}");
    for (line, point) in lines.zip(front) {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().expect("a number")).collect();
        assert_eq!(point["terms"].as_f64(), Some(cells[0]));
        let functions: Vec<&str> =
            point["functions"].as_array().expect("names").iter().filter_map(|name| name.as_str()).collect();
        for (name, &value) in names.iter().zip(&cells[1..]) {
            assert_eq!(functions.contains(name), value != 0.0, "{name}: {line}");
            // The root mean square of the constant is 1.
            let constant = equation["terms"].as_array().expect("terms").iter().find(|term| term["function"] == "1");
            if let (true, "1", Some(term)) = (point["chosen"] == true, *name, constant) {
                assert!((value - term["coefficient"].as_f64().expect("a number")).abs() < 1e-12, "{line}");
            }
        }
    }
    assert!(html.contains("by the spread between parts of the logs, as the report of the fit has them"));
    for term in equation["terms"].as_array().expect("terms") {
        let half = 1.959_963_984_540_054 * term["standard_error"].as_f64().expect("a number");
        let value = term["coefficient"].as_f64().expect("a number");
        let shown = within(value, half);
        assert!(html.contains(&format!(">{shown}<")), "{shown}");
    }
}

/// Fig. 9 of the paper on piecewise-affine models of a running robot.
#[test]
fn errors_and_transitions_are_drawn_on_planes() {
    let folder = models(1200);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    let flags = ["--plane", "v,u", "--csv", "numbers"];
    run(&[&["report", "model_kmeans4.json", "held-out.csv"], &flags[..]].concat()).ok();
    let html = page(folder.path(), "report.html");
    assert!(html.contains("id=\"plane-transitions\"") && html.contains("id=\"plane-errors\""));
    // The cells are those of `score --plane`.
    let flags = ["--plane", "v,u", "--bins", "24", "--json"];
    let scored = run(&[&["score", "model_kmeans4.json", "held-out.csv"], &flags[..]].concat()).ok().json();
    let cells = scored["plane"]["cells"].as_array().expect("cells");
    let drawn = page(folder.path(), "numbers/plane-errors.csv");
    let rows: Vec<Vec<&str>> = drawn.lines().skip(1).map(|line| line.split(',').skip(1).collect()).collect();
    let mut compared = 0;
    for (place, cell) in cells.iter().enumerate() {
        let text = rows[23 - place % 24][place / 24];
        match cell[4].as_f64() {
            Some(score) => assert!((text.parse::<f64>().expect("a score") - score).abs() < 1e-12 * score.max(1.0)),
            None => assert_eq!(text, ""),
        }
        compared += usize::from(!text.is_empty());
    }
    assert!(compared > 50, "{compared}");
    run(&["report", "model.json", "held-out.csv", "--plane", "v"]).fails(&["--plane v", "two columns"]);
    run(&["report", "model.json", "held-out.csv", "--plane", "v,nothing"]).fails(&["nothing", "--plane"]);
}

/// Beside messages stand layouts, so that viewers show them over the recording at once.
#[test]
fn layouts_stand_beside_messages() {
    let folder = models(600);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let output = run(&["rollout", "model.json", "held-out.csv", "--horizon", "20", "-o", "rolled.mcap"]);
    assert!(output.err.contains("rolled.foxglove.json, rolled.plotjuggler.xml"), "{}", output.err);
    let layout: serde_json::Value = serde_json::from_str(&page(folder.path(), "rolled.foxglove.json")).expect("JSON");
    let paths = layout["configById"]["Plot!fleetfoot0"]["paths"].as_array().expect("paths");
    let topics: Vec<&str> = paths.iter().filter_map(|path| path["value"].as_str()).collect();
    assert_eq!(topics[..2], ["/fleetfoot/rollout/0/measured.position[0]", "/fleetfoot/rollout/0.position[0]"]);
    run(&["predict", "model.json", "held-out.csv", "-o", "said.mcap"]);
    let xml = page(folder.path(), "said.plotjuggler.xml");
    assert!(xml.contains("<curve name=\"/fleetfoot/predicted/d(v)/dt/position\""), "{xml}");
    // The file has every field that the layouts name.
    let topics = run(&["info", "said.mcap", "--json"]).out;
    assert!(topics.contains("/fleetfoot/measured") && topics.contains("/fleetfoot/predicted"), "{topics}");
    run(&["predict", "model.json", "held-out.csv", "-o", "table.parquet"]);
    assert!(!folder.path().join("table.foxglove.json").exists(), "beside tables there are none");
}

/// For messages the page shows the clock, and the rates of each channel that the model reads.
#[test]
fn channels_and_clocks_are_listed() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    run(&["generate", "diffdrive", "--seconds", "2", "--runs", "2", "-o", "runs"]);
    let logs = ["runs/diffdrive_00.mcap", "runs/diffdrive_01.mcap"];
    run(&["fit", "pwa", "-c", "runs/robot.toml", logs[0], "--partition", "average", "-o", "model.json"]);
    run(&["report", "model.json", logs[1], "--horizon", "20"]);
    let html = page(folder.path(), "report.html");
    assert!(html.contains("Stamps are those of the messages\u{2019} headers."), "the clock");
    let info = run(&["info", logs[1], "--json"]).json();
    let topics = info[0]["topics"].as_array().expect("topics");
    let is_listed = |topic: &&serde_json::Value| {
        let name = topic["name"].as_str().expect("a name");
        let messages = topic["messages"].as_u64().expect("a number");
        html.contains(&format!("<th scope=\"row\">{name}</th><td class=\"n\">{messages}</td>"))
    };
    let shown: Vec<&str> = topics.iter().filter(is_listed).filter_map(|topic| topic["name"].as_str()).collect();
    // The recipe names the voltages too, and the model has no use for them.
    assert_eq!(shown, ["/truth/cmd_vel", "/truth/odometry", "/truth/wheels"]);
}

/// A value that `prepare` rejects, or that a channel lacks, stands in a log as an empty value.
#[test]
fn missing_values_are_shown_where_they_are() {
    let folder = models(600);
    let text = robot_csv(1200, 9.0);
    let without = |(row, line): (usize, &str)| {
        let mut cells: Vec<&str> = line.split(',').collect();
        if (301..421).contains(&row) {
            cells[2] = "";
        }
        format!("{}\n", cells.join(","))
    };
    let gaps: String = text.lines().enumerate().map(without).collect();
    fs::write(folder.path().join("gaps.csv"), gaps).expect("a file");
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    run(&["report", "model.json", "gaps.csv", "held-out.csv", "--horizon", "20", "--csv", "numbers"]);
    let html = page(folder.path(), "report.html");
    assert!(html.contains("Stamps are those of t."), "the clock is told");
    // The row before the first missing value lacks a neighbour for its derivative.
    let table = html.split("<p class=\"caption\">Episodes.</p>").nth(1).expect("the table of episodes");
    let row = table.split("gaps.csv</th>").nth(1).and_then(|rest| rest.split("</tr>").next()).expect("its row");
    assert!(row.ends_with("<td class=\"n\">121</td>"), "{row}");
    let drawn = page(folder.path(), "numbers/missing-in-time.csv");
    let gaps: Vec<Vec<&str>> = drawn.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(gaps[0], ["row", "what", "from [s]", "to [s]"]);
    let number = |text: &str| text.parse::<f64>().expect("a number");
    let gaps: Vec<&Vec<&str>> = gaps.iter().filter(|row| row[1] == "values are missing" && row[0] == "v").collect();
    // Episodes stand in the order of their identities.
    let before = if number(gaps[0][2]) > 5.0 { 5.99 } else { 0.0 };
    let (from, to) = (number(gaps[0][2]) - before, number(gaps[gaps.len() - 1][3]) - before);
    assert!((from - 3.0).abs() < 0.02 && (to - 4.2).abs() < 0.02 && gaps.len() == 1, "{gaps:?}");
    let lost = page(folder.path(), "numbers/logs-in-time.csv");
    assert_eq!(lost.matches("gaps.csv,rows are lost to missing values,").count(), 1, "{lost}");
    let whole = run(&["report", "model.json", "held-out.csv", "-o", "whole.html"]);
    assert!(!page(folder.path(), "whole.html").contains("rows lost"), "{}", whole.out);
}

/// A log in which nothing moves: the null model has no error there, so that ratios to it are none.
#[test]
fn missing_scores_are_marked() {
    let folder = models(600);
    let text = robot_csv(400, 9.0);
    let (head, rows) = text.split_once('\n').expect("a head");
    let zeros = ",0".repeat(head.split(',').count() - 1);
    let still = |row: &str| format!("{}{zeros}\n", row.split(',').next().expect("a time"));
    let still = format!("{head}\n{}", rows.lines().map(still).collect::<String>());
    fs::write(folder.path().join("still.csv"), still).expect("a file");
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    run(&["report", "model.json", "still.csv", "held-out.csv"]);
    let html = page(folder.path(), "report.html");
    assert!(html.contains("id=\"errors-by-target\"") && !html.contains("NaN") && !html.contains("inf<"));
}

#[test]
fn impossible_pages_are_refused() {
    let folder = models(1200);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments);
    run(&["report", "held-out.csv"]).fails(&["no file is a model", "*.json"]);
    run(&["report", "missing.json"]).fails(&["missing.json"]);
    run(&["report", "model.json", "nothing.csv"]).fails(&["nothing.csv"]);
    run(&["report", "model.json", "held-out.csv", "-o", "held-out.csv"]).fails(&["held-out.csv"]);
    run(&["report", "model.json", "held-out.csv", "--horizon", "0"]).fails(&["the horizon is 0 steps"]);
    assert!(!folder.path().join("report.html").exists());
    run(&["report", "model.json", "held-out.csv", "--horizon", "5000"]).ok();
    assert!(page(folder.path(), "report.html").contains("It is not simulated."), "a page without simulations");
    // Of one row no derivative is measured, and nothing can be simulated; of none there is nothing to say.
    fs::write(folder.path().join("one-row.csv"), robot_csv(1, 9.0)).expect("a file");
    run(&["report", "model.json", "one-row.csv", "-o", "short.html"]).ok();
    let html = page(folder.path(), "short.html");
    assert!(html.contains("It is not scored.") && html.contains("It is not simulated."), "one row");
    fs::write(folder.path().join("empty.csv"), robot_csv(0, 9.0)).expect("a file");
    run(&["report", "model.json", "empty.csv", "-o", "empty.html"]).fails(&["empty.csv has no rows"]);
    // A model of given equations alone has nothing to score.
    let recipe = "[columns]\nv = \"`v [m/s]`\"\n[states]\nx = { known = \"v\" }\nv = { known = \"-2*v + 3*u\" }\n\
                  [inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n";
    fs::write(folder.path().join("known.toml"), recipe).expect("a file");
    run(&["fit", "pwa", "-c", "known.toml", "one.csv", "-o", "known.json"]).ok();
    run(&["report", "known.json", "held-out.csv", "-o", "known.html"]).ok();
    let html = page(folder.path(), "known.html");
    assert!(html.contains("Its equations are given.") && html.contains("id=\"score-by-horizon\""), "given equations");
}

#[test]
fn names_are_escaped_and_columns_fit() {
    let folder = tempfile::tempdir().expect("a folder");
    let names: Vec<String> = (0..500).map(|column| format!("<script>{column} & ' it")).collect();
    for (file, phase) in [("seen.csv", 0.0), ("<i>held & out.csv", 1.0)] {
        let mut text = format!("t,{}\n", names.join(","));
        for row in 0..520 {
            let t = 0.01 * f64::from(row);
            let value = |column: u32| ((1.0 + 0.1 * f64::from(column)) * t + f64::from(column) + phase).sin();
            let values: Vec<String> = (0..500).map(|column| value(column).to_string()).collect();
            text.push_str(&format!("{t},{}\n", values.join(",")));
        }
        fs::write(folder.path().join(file), text).expect("a file");
    }
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let (states, inputs) = (names[..80].join(","), names[80..].join(","));
    let fit = ["fit", "pwa", "seen.csv", "--states", &states, "--inputs", &inputs, "--time", "t", "-o", "model.json"];
    run(&[&fit[..], &["--partition", "average", "--select", "bic", "--folds", "0"]].concat());
    run(&["report", "model.json", "<i>held & out.csv", "--starts", "5", "--title", "</title><b>"]);
    let html = page(folder.path(), "report.html");
    assert!(!html.contains("<script") && !html.contains("<i>") && !html.contains("</title><b>"));
    assert!(html.contains("&lt;script&gt;29 &amp; ' it") && html.contains("&lt;i&gt;held &amp; out.csv"));
    assert!(html.contains("Shown are the 24 largest errors of 80 targets."), "figures have room for so many");
    assert!(
        html.contains("and 441 more terms, which are in the model file"),
        "of very long equations the beginning is set"
    );
    assert!(html.contains("Shown are 60 of 501 terms. Shown are 24 of 80 equations."), "of their intervals too");
    assert!(html.contains("56 more equations are in the model file.") && html.contains("Shown are 12 of 500 columns."));
    assert!(html.len() < 1_500_000, "{} bytes", html.len());
}

/// The bounds of a fit stand on the page as on the terminal: maps that are bounded, and coefficients with limits.
#[test]
fn kept_results_of_fits_are_shown() {
    let folder = models(400);
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let shown = |fit: &[&str]| {
        let output = run(&[fit, &["-o", "kept.json", "--json"]].concat());
        fs::write(folder.path().join("fit.json"), &output.out).expect("a file");
        run(&["report", "kept.json", "--fit", "fit.json", "-o", "kept.html"]);
        (output.json(), page(folder.path(), "kept.html"))
    };
    let maps =
        ["fit", "pwa", "-c", "robot.toml", "one.csv", "two.csv", "--partition", "kmeans:4", "--partition-on", "v"];
    let (_, free) = shown(&maps);
    assert!(!free.contains("Bounds of the fit") && free.contains("95 % intervals of least squares"), "nothing is kept");
    let (report, html) = shown(&[&maps[..], &["--passive", "u:v"]].concat());
    assert_eq!(html.matches("Bounds of the fit").count(), 1);
    let bounds = &report["candidates"][0]["stability"];
    // Least squares do not tell how well coefficients are known that a bound has moved.
    assert_eq!(html.contains("95 % intervals of least squares"), bounds["moved"] == 0);
    assert_eq!(html.contains("Its maps are kept within bounds"), bounds["moved"] != 0);
    let sentences =
        ["Stable: all regions' maps of v over one sampling period contract by 1 in one metric", "Passive at u:v:"];
    for sentence in sentences {
        assert!(html.contains(sentence), "{sentence}");
    }
    let greatest = |of: &serde_json::Value| {
        let all = of.as_array().expect("numbers").iter();
        all.map(|value| value.as_f64().expect("a number")).fold(0.0, f64::max)
    };
    for list in [&bounds["free_radii"], &bounds["radii"], &bounds["norms"], &bounds["passivity"]["free_norms"]] {
        let number = format!("{:.4}<", greatest(list));
        assert!(html.contains(&number), "{number}");
    }
    let steps = ["--objective", "steps:5", "--folds", "0"];
    let (report, html) = shown(&[&maps[..], &steps].concat());
    assert_eq!(html.contains("Its coefficients were fitted to simulations"), report["objective"]["written"] == true);
    let recipe = page(folder.path(), "robot.toml");
    let limits = "[constraints]\ndamping = { coefficients = { v = [\"v\"] }, at_least = -1.0 }\n";
    fs::write(folder.path().join("limited.toml"), format!("{recipe}{limits}")).expect("a file");
    let (report, html) = shown(&["fit", "sindy", "-c", "limited.toml", "one.csv", "two.csv", "--library", "poly(1)"]);
    assert!(html.contains("damping, v of d(v)/dt</th>") && html.contains("at least"), "the limit");
    let equation = &report["regions"][0]["equations"][0];
    for key in ["rms", "held_out_rms", "free_rms", "free_held_out_rms"] {
        let number = fleetfoot::report::words::number(equation[key].as_f64().expect("a number"));
        assert!(html.contains(&format!("<td class=\"n\">{number}</td>")), "{key} {number}");
    }
}

/// Models of other targets and states are compared in their common ones, on simulations from the same rows, or not at
/// all.
#[test]
fn models_are_compared_in_shared_targets() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    for (name, phase) in [("a.csv", 0.0), ("b.csv", 1.0)] {
        fs::write(folder.path().join(name), robot_csv(900, phase).replace("v [m/s]", "v")).unwrap();
    }
    let narx = [
        "fit",
        "narx",
        "a.csv",
        "--states",
        "v",
        "--inputs",
        "u",
        "--lags-out",
        "9",
        "--lags-in",
        "9",
        "--degree",
        "1",
    ];
    run(&[&narx[..], &["-o", "narx.json"]].concat());
    run(&["fit", "sindy", "a.csv", "--states", "x,v", "--inputs", "u", "-o", "sindy.json"]);
    run(&["fit", "sindy", "a.csv", "--states", "x", "--inputs", "u", "-o", "other.json"]);
    for models in [["sindy.json", "narx.json"], ["narx.json", "sindy.json"]] {
        let text = run(&["report", models[0], models[1], "b.csv", "-o", "page.html", "--csv", "figures"]).out;
        assert!(text.contains("One step ahead the models are not compared: they have no target in common"), "{text}");
        assert!(text.contains("Simulated, ") && text.contains("Error of v, which all models have"), "{text}");
        let head = |figure: &str| {
            let text = fs::read_to_string(folder.path().join("figures").join(figure)).unwrap();
            text.lines().next().unwrap().to_owned()
        };
        // Every model has its curve, and its bars.
        let drawn = fs::read_dir(folder.path().join("figures"))
            .unwrap()
            .map(|file| file.unwrap().file_name().into_string().unwrap());
        let in_time: Vec<String> =
            drawn.filter(|name| name.starts_with("simulated-in-time")).map(|name| head(&name)).collect();
        assert!(in_time.iter().any(|head| head.contains("narx") && head.contains("sindy")), "{in_time:?}");
        let by_horizon = head("score-by-horizon.csv");
        assert!(by_horizon.contains("narx") && by_horizon.contains("sindy"), "{by_horizon}");
        let bars = fs::read_to_string(folder.path().join("figures/errors-by-target.csv")).unwrap();
        assert!(["next(v)", "d(v)/dt", "d(x)/dt"].iter().all(|target| bars.contains(target)), "{bars}");
        fs::remove_dir_all(folder.path().join("figures")).unwrap();
    }
    let text = run(&["report", "narx.json", "other.json", "b.csv", "-o", "page.html"]).out;
    assert!(text.contains("Simulated, the models are not compared") && text.contains("no state in common"), "{text}");
}
