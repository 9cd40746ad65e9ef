//! The demonstration: its output, the commands that repeat it, and the same bytes on any number of threads.

use std::{collections::BTreeMap, fs};

use crate::runner::*;

/// Every file below a folder but the cache's, by its path.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            match path.is_dir() {
                true if !name.starts_with('.') => folders.push(path),
                true => {}
                false => drop(
                    files.insert(path.strip_prefix(folder).unwrap().display().to_string(), fs::read(&path).unwrap()),
                ),
            }
        }
    }
    files
}

fn number(value: &serde_json::Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

#[test]
fn finer_models_predict_better() {
    let folder = tempfile::tempdir().unwrap();
    let demo = folder.path().join("the demo");
    // The full size is that of the other sweeps (`make test-all`).
    let minutes = if std::env::var_os("FLEETFOOT_SWEEPS").is_some_and(|size| size == "full") { "1.2" } else { "0.6" };
    let output = fleetfoot(
        folder.path(),
        &["demo", "--paper", "--minutes", minutes, "-o", "the demo", "--json", "--threads", "1"],
    )
    .ok();
    let report = output.json();
    crate::keys::check_keys(&report, false, "demo");

    // Table I: the average is below null and ten regions are below the average, in all accelerations but perhaps one: fits minimise squared
    // errors, the table has absolute ones, and impacts make heavy tails. Nothing is asked of fifty regions:
    // with a minute of data they lose to ten.
    let table = &report["table_1"];
    assert_eq!(table["targets"].as_array().unwrap().len(), 8);
    let models = table["models"].as_array().unwrap();
    let names: Vec<&str> = models.iter().filter_map(|model| model["model"].as_str()).collect();
    assert_eq!(names, ["null", "average", "zbox:1.5", "kmeans:10", "kmeans:50"]);
    let errors = |model: usize| -> Vec<f64> {
        models[model]["mae_over_null"].as_array().unwrap().iter().map(|estimate| number(&estimate["value"])).collect()
    };
    for (fine, coarse) in [(1, 0), (3, 1)] {
        let (fine, coarse) = (errors(fine), errors(coarse));
        let below = fine.iter().zip(&coarse).filter(|(fine, coarse)| fine < coarse).count();
        assert!(below >= 7 && fine.iter().sum::<f64>() < 0.95 * coarse.iter().sum::<f64>(), "{fine:?} {coarse:?}");
    }
    assert!(table["ordering"].as_array().unwrap().len() == 3 && table["units"][0] == "m/s^2", "{table:#}");
    // Fig. 5: a faster belt makes faster steps; a robot that walks is slower than without slip (one that runs may be faster).
    let runs = report["gait"]["runs"].as_array().unwrap();
    assert!(runs.len() >= 6, "{runs:#?}");
    for run in runs {
        let rows: f64 = run["phases"].as_array().unwrap().iter().map(number).sum();
        assert_eq!(rows, number(&run["rows"]));
        assert!((number(&run["speed"]) / number(&run["belt_speed"]) - 1.0).abs() < 0.25, "{run:#}");
        let most = if number(&run["belt_speed"]) < 0.32 { 1.0 } else { 1.15 };
        assert!(number(&run["speed"]) < most * number(&run["no_slip_speed"]), "{run:#}");
    }
    let (slow, fast) = (&runs[0], &runs[runs.len() - 1]);
    assert!(number(&fast["stride_frequency"]) > 2.0 * number(&slow["stride_frequency"]), "{slow:#} {fast:#}");
    // Fig. 8: a step ahead some model is better than none, and a long while ahead it is a coarse one, with and without the controller.
    for key in ["figure_8", "figure_8_open_loop"] {
        let best = report[key]["best"].as_array().unwrap();
        let name = |reign: Option<&serde_json::Value>| reign.unwrap()["model"].as_str().unwrap().to_owned();
        assert!(name(best.first()) != "null", "{best:#?}");
        assert!(!name(best.last()).starts_with("kmeans"), "{best:#?}");
        assert_eq!(report[key]["seconds"].as_array().unwrap().len(), 200);
    }
    // Fig. 9: the rows of the runs, on the plane; the region changes somewhere, and not with every passage.
    let ratio = number(&report["figure_9b"]["transition_ratio"]);
    assert!(ratio > 0.02 && ratio < 0.9, "{ratio}");
    assert_eq!(report["figure_9a"]["transitions"], 0);
    assert!(number(&report["figure_9a"]["rows"]) > 20_000.0);

    // The first line of output is the path of the page, which is small enough to be sent.
    assert!(output.err.lines().next().is_some_and(|line| line.ends_with("report.html")), "{}", output.err);
    let page = fs::metadata(demo.join("report.html")).unwrap().len();
    assert!((100_000..1_000_000).contains(&page), "{page} bytes");

    // Its commands, pasted, on another number of threads: the same files.
    let before = contents(&demo);
    for name in [
        "model.json",
        "model_kmeans50.json",
        "model_null.json",
        "drive.html",
        "plane_drive.parquet",
        "train/robot.toml",
        "report.html",
    ] {
        assert!(before.contains_key(name), "{name} of {:?}", before.keys());
    }
    let commands: Vec<&str> = output.err.lines().filter_map(|line| line.strip_prefix("$ ")).collect();
    assert_eq!(commands.len(), 10, "{}", output.err);
    for command in commands {
        let done = Command::new("sh").arg("-c").arg(command).current_dir(folder.path()).output().unwrap();
        assert!(done.status.success(), "{command}: {}", String::from_utf8_lossy(&done.stderr));
    }
    let after = contents(&demo);
    assert_eq!(before.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
    for (name, bytes) in &before {
        assert!(*bytes == after[name], "{name} is different");
    }
}

#[test]
fn paper_results_are_printed() {
    let folder = tempfile::tempdir().unwrap();
    let output = fleetfoot(folder.path(), &["demo", "--paper", "--minutes", "0.4", "--seed", "3"]).ok();
    for words in [
        "Table I.",
        "alpha_r_rate'",
        "kmeans:50 is below kmeans:10 in all of them",
        "rad/s^2",
        "Fig. 5.",
        "Fig. 8, closed loop",
        "best model: ",
        "Fig. 9a.",
        "Fig. 9b.",
        "drive.html",
    ] {
        assert!(output.out.contains(words), "`{words}` is missing from\n{}", output.out);
    }
    assert!(folder.path().join("fleetfoot-demo/differential_drive.json").exists());
    // A second one replaces the first one's logs; a folder of other logs is left alone.
    fs::write(folder.path().join("fleetfoot-demo/test/my_own.mcap"), "precious").unwrap();
    fleetfoot(folder.path(), &["demo", "--paper", "--minutes", "0.4"]).fails(&["my_own.mcap"]);
    fleetfoot(folder.path(), &["demo", "--paper", "--minutes=-1"]).fails(&["--minutes", "above 0"]);
}

/// The log, its faults, equations with the machine's mass and friction, simulations of another run, and code that has
/// the model's values. Pasted, the short commands make the same files.
#[test]
fn the_default_demo_prints_equations() {
    let folder = tempfile::tempdir().unwrap();
    let output = fleetfoot(folder.path(), &["demo"]).ok();
    for words in [
        "Nothing wrong was found.",
        "<- chosen",
        "d(q)/dt = qd  (given)",
        "dry friction of",
        "measured (.) and simulated from its first value (o)",
        "better than persistence at every step, to 2.000 s",
    ] {
        assert!(output.out.contains(words), "`{words}` is missing from\n{}", output.out);
    }
    if Command::new("cc").arg("--version").output().is_ok() {
        assert!(output.out.contains("the C code has the model's values at 32 points"), "{}", output.out);
    }
    // The machine that was simulated has 95.1 kg and 20.39 N.
    let line = output.out.lines().find(|line| line.contains("dry friction of")).unwrap();
    let after = |words: &str| -> f64 {
        line.split(words).nth(1).and_then(|rest| rest.split_whitespace().next()).and_then(|n| n.parse().ok()).unwrap()
    };
    assert!(
        (after("a mass of ") / 95.1 - 1.0).abs() < 0.02 && (after("dry friction of ") / 20.39 - 1.0).abs() < 0.04,
        "{line}"
    );
    let demo = folder.path().join("fleetfoot-demo");
    assert!(demo.join("model/report.html").exists() && demo.join("model/c/model.c").exists());
    let before = contents(&demo);
    let commands: Vec<&str> = output.err.lines().filter_map(|line| line.strip_prefix("$ ")).collect();
    assert_eq!(commands.len(), 5, "{}", output.err);
    for command in commands.iter().filter(|command| !command.contains("-std=c99") && !command.contains(" auto ")) {
        let done = Command::new("sh").arg("-c").arg(command).current_dir(folder.path()).output().unwrap();
        assert!(done.status.success(), "{command}: {}", String::from_utf8_lossy(&done.stderr));
    }
    let after = contents(&demo);
    assert!(before == after, "{:?} {:?}", before.keys(), after.keys());
}
