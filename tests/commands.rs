//! The way a user goes: every command, on files.

use std::fs;

use crate::runner::*;

fn logs() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("runs")).expect("a folder");
    for run in 0..4 {
        fs::write(folder.path().join(format!("runs/run_{run}.csv")), robot_csv(3000, f64::from(run))).expect("a file");
    }
    fs::write(folder.path().join("held-out.csv"), robot_csv(2000, 9.0)).expect("a file");
    let recipe = "[columns]\nv = \"`v [m/s]`\"\n[states]\nx = { known = \"v\", regressor = false }\nv = { derivative = \"forward\" }\n\
                  [inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n";
    fs::write(folder.path().join("robot.toml"), recipe).expect("a file");
    folder
}

#[test]
fn from_logs_to_a_scored_model() {
    let folder = logs();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();

    let info = run(&["info", "runs/run_0.csv", "--values", "--json"]).json();
    assert_eq!(info[0]["rows"], 3000);
    assert_eq!(info[0]["clock"]["column"], "t");
    assert!((info[0]["clock"]["period"].as_f64().unwrap() - 0.01).abs() < 1e-9);
    assert!(run(&["info", "runs"]).out.contains("run_3.csv"));

    let starter = run(&["init", "runs/run_0.csv"]).out;
    assert!(starter.contains("[states]") && starter.contains("v [m/s]") && starter.contains("column = \"t\""));
    run(&["init", "runs/run_0.csv", "-o", "new.toml"]);
    fleetfoot(folder.path(), &["init", "runs/run_0.csv", "-o", "new.toml"]).fails(&["exists already", "--force"]);

    let plan =
        run(&["fit", "pwa", "-c", "robot.toml", "runs", "--partition", "kmeans:4", "--dry-run", "--json"]).json();
    assert_eq!(
        (plan["rows"].as_u64(), plan["files"].as_u64(), plan["passes"].as_u64()),
        (Some(12000), Some(4), Some(3))
    );
    assert!(!folder.path().join("model.json").exists());

    let fit = run(&[
        "fit",
        "pwa",
        "-c",
        "robot.toml",
        "runs/*.csv",
        "--partition",
        "null,average,labels:mode,kmeans:2,8",
        "--partition-on",
        "v",
        "-o",
        "model.json",
        "--json",
    ])
    .json();
    assert_eq!(fit["candidates"][0]["mae_over_null"][0], 1.0);
    let error = |candidate: usize| fit["candidates"][candidate]["mae_over_null"][0].as_f64().unwrap();
    assert!(error(1) < 1.0 && error(2) < 1e-9 && error(4) < error(1), "{fit:#}");
    assert_eq!(fit["chosen"], 2, "the labels are the truth");
    assert!(fit["chosen_by"].as_str().unwrap().contains("within one standard error"), "{fit:#}");

    let score = run(&["score", "model.json", "held-out.csv", "--json"]).json();
    assert_eq!(score["rows"], 1999);
    assert!(score["targets"][0]["mae_over_null"]["value"].as_f64().unwrap() < 1e-9);
    assert_eq!(score["in_sample_episodes"].as_array().unwrap().len(), 0);
    let known = run(&["score", "model.json", "runs/run_1.csv"]);
    assert!(known.err.contains("in-sample"), "{}", known.err);

    let predict = run(&["predict", "model.json", "held-out.csv", "-o", "pred.parquet", "--json"]).json();
    assert_eq!((predict["rows"].as_u64(), predict["predicted"].as_u64()), (Some(2000), Some(2000)));
    assert_eq!(predict["compared"], 1999, "the last row has no forward difference");
    let columns = run(&["info", "pred.parquet"]).out;
    assert!(
        columns.contains("d(v)/dt residual") && columns.contains("region") && columns.contains("in_domain"),
        "{columns}"
    );

    let rollout = run(&[
        "rollout",
        "model.json",
        "held-out.csv",
        "--horizon",
        "50",
        "--starts",
        "20",
        "-o",
        "rollouts.parquet",
        "--json",
    ])
    .json();
    assert_eq!(rollout["rollouts"], 20);
    let last = rollout["model"]["mahalanobis"].as_array().unwrap().last().unwrap()[0].as_f64().unwrap();
    let persistence =
        rollout["baselines"]["persistence"]["mahalanobis"].as_array().unwrap().last().unwrap()[0].as_f64().unwrap();
    assert!(last < 0.02 * persistence, "{last} {persistence}");
    assert!(run(&["info", "rollouts.parquet"]).out.contains("1020 rows"));

    let show = run(&["show", "model.json"]).out;
    for word in ["d(x)/dt = v", "region slip", "region grip", "f_v = 1 - 5*v + 2*u", "(given)"] {
        assert!(show.contains(word), "`{word}` is missing from\n{show}");
    }
    assert_eq!(
        run(&["show", "model.json", "--json"]).out,
        fs::read_to_string(folder.path().join("model.json")).unwrap()
    );
}

#[test]
fn fits_ignore_threads_and_file_order() {
    let folder = logs();
    for (partition, folds) in [("kmeans:3,6", "10"), ("refined:3", "2"), ("lattice:3", "2"), ("tree:2", "2")] {
        let fit = |threads: &str, files: &[&str], output: &str| {
            let mut arguments = vec!["fit", "pwa", "-c", "robot.toml", "--partition", partition, "--folds", folds];
            arguments.extend(["--threads", threads, "-o", output]);
            arguments.extend(files);
            fleetfoot(folder.path(), &arguments).ok();
            fs::read(folder.path().join(output)).unwrap()
        };
        let files = ["runs/run_0.csv", "runs/run_1.csv", "runs/run_2.csv"];
        let single = fit("1", &files, "a.json");
        assert!(single == fit("2", &["runs/run_2.csv", "runs/run_0.csv", "runs/run_1.csv"], "b.json"), "{partition}");
        assert!(single == fit("7", &files, "c.json"), "{partition}");
    }
}

#[test]
fn joined_cells_go_the_whole_way() {
    let folder = logs();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let fit = ["fit", "pwa", "-c", "robot.toml", "--folds", "4", "-o", "model.json", "--partition"];
    let fitted = run(&[&fit[..], &["average,lattice:2..4", "runs", "--json"]].concat()).json();
    let loss = |at: usize| fitted["candidates"][at]["loss"].as_f64().unwrap();
    assert!(loss(3) < 0.5 * loss(0), "{fitted:#}");
    let show = run(&["show", "model.json"]).out;
    assert!(show.contains("joined from") && show.contains("<- this model"), "{show}");
    let transitions = run(&["show", "model.json", "--transitions"]).out;
    assert!(transitions.contains("transitions of lattice:"), "{transitions}");
    run(&["score", "model.json", "held-out.csv"]);
    run(&["rollout", "model.json", "held-out.csv", "--horizon", "20", "--starts", "20"]);
    for to in ["c", "rust", "python", "latex", "npz"] {
        run(&["export", "model.json", "--to", to, "--prefix", "robot", "-o", "code"]);
    }
    let code = fs::read_to_string(folder.path().join("code/robot.c")).unwrap();
    assert!(code.contains("Region of each cell."), "{code}");
    // The regions stand in a statistic too, made once on all rows.
    run(&["scan", "-c", "robot.toml", "runs", "--partition", "lattice:3", "-o", "run.stats"]);
    let output =
        fleetfoot(folder.path(), &["fit", "pwa", "run.stats", "--partition", "lattice:3", "-o", "summed.json"]).ok();
    assert!(output.out.contains("lattice:3"), "{}", output.out);
}

#[test]
fn regions_are_counted_along_a_phase() {
    let folder = logs();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let fit = ["fit", "pwa", "-c", "robot.toml", "--folds", "0", "-o", "model.json", "--partition", "kmeans:3", "runs"];
    run(&[&fit[..], &["--phase", "wrap(2*t):6"]].concat());
    let transitions = run(&["show", "model.json", "--transitions"]).out;
    for part in ["along wrap(2*t):6", "0.00..1.05", "from stride to stride", "a stride begins where the phase wraps"] {
        assert!(transitions.contains(part), "{part}: {transitions}");
    }
    // The rows are 0.01 s apart, and the phase comes round every pi seconds.
    let rows = transitions.split(" rows (").nth(1).and_then(|rest| rest.split(" s)").next());
    let seconds: f64 = rows.and_then(|text| text.parse().ok()).expect("seconds");
    assert!((seconds - std::f64::consts::PI).abs() < 0.02, "{transitions}");
    run(&["report", "model.json", "held-out.csv", "-o", "page.html"]);
    let page = fs::read_to_string(folder.path().join("page.html")).unwrap();
    assert_eq!(page.matches("id=\"phase-1-1\"").count(), 1);
    assert!(page.contains(" along wrap(2*t):6"));
    run(&["export", "model.json", "--to", "c", "--prefix", "robot", "-o", "code"]);
    let code = fs::read_to_string(folder.path().join("code/robot_transitions.c")).unwrap();
    assert!(code.contains("robot_phase_share[ROBOT_PHASE_BIN_COUNT][ROBOT_REGION_COUNT]"), "{code}");
    assert_eq!(fleetfoot(folder.path(), &[&fit[..], &["--phase", "v:1"]].concat()).code, 2, "one bin is none");
    for (phase, words) in [("nothing", ["--phase", "nothing"]), ("1e9*t", ["wrap(", "labels:"])] {
        fleetfoot(folder.path(), &[&fit[..], &["--phase", phase]].concat()).fails(&words);
    }
}

#[test]
fn trees_go_the_whole_way() {
    let folder = logs();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let fit = ["fit", "pwa", "-c", "robot.toml", "--folds", "4", "-o", "model.json", "--partition"];
    let fitted = run(&[&fit[..], &["average,tree:1..3", "runs", "--json"]].concat()).json();
    assert_eq!(fitted["candidates"][1]["regions"], 2);
    assert_eq!(fitted["chosen"], 1, "{fitted:#}");
    // The log's friction changes above 0.5.
    let show = run(&["show", "model.json"]).out;
    assert!(show.contains("if v < 0.5") && show.contains(": region 1"), "{show}");
    let transitions = run(&["show", "model.json", "--transitions"]).out;
    assert!(transitions.contains("transitions of tree:1"), "{transitions}");
    run(&["score", "model.json", "held-out.csv"]);
    run(&["predict", "model.json", "held-out.csv", "-o", "predicted.parquet"]);
    run(&["rollout", "model.json", "held-out.csv", "--horizon", "20", "--starts", "20"]);
    for to in ["c", "rust", "python", "latex", "npz"] {
        run(&["export", "model.json", "--to", to, "--prefix", "robot", "-o", "code"]);
    }
    let text = |name: &str| fs::read_to_string(folder.path().join("code").join(name)).unwrap();
    assert!(text("robot.c").contains(">= 0.5") && text("robot.tex").contains("v \\ge 0.5"), "{}", text("robot.c"));
    run(&["report", "model.json", "held-out.csv", "-o", "page.html"]);
    assert!(fs::read_to_string(folder.path().join("page.html")).unwrap().contains("v &lt; 0.5"));
    // Made once on all rows in a statistic, and for equations and autoregressions.
    run(&["scan", "-c", "robot.toml", "runs", "--partition", "tree:2", "-o", "run.stats"]);
    let output =
        fleetfoot(folder.path(), &["fit", "pwa", "run.stats", "--partition", "tree:2", "-o", "summed.json"]).ok();
    assert!(output.out.contains("tree:2"), "{}", output.out);
    assert!(run(&["show", "summed.json"]).out.contains("if v < 0.5"));
    run(&["fit", "sindy", "-c", "robot.toml", "runs", "--partition", "tree:1", "--degree", "1", "-o", "sparse.json"]);
    assert!(run(&["show", "sparse.json"]).out.contains("if v < 0.5"));
    let narx = ["--time", "t", "--alias", "v=`v [m/s]`", "--outputs", "v", "--inputs", "u", "--order", "fixed"];
    let lags = ["--lags-out", "1", "--lags-in", "1", "--degree", "1", "--partition", "tree:1,2", "-o", "narx.json"];
    run(&[&["fit", "narx", "runs"][..], &narx, &lags].concat());
    assert!(run(&["show", "narx.json"]).out.contains("if v < 0.5"));
}

#[test]
fn continuous_maps_have_a_cost() {
    let folder = logs();
    let fit = ["fit", "pwa", "-c", "robot.toml", "--folds", "4", "-o", "model.json", "--partition"];
    let run = |arguments: &[&str]| fleetfoot(folder.path(), &[&fit[..], arguments, &["runs"]].concat());
    let fitted = run(&["average,refined:2", "--continuous", "--json"]).ok().json();
    let continuous = &fitted["candidates"][1];
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    assert_eq!(
        (continuous["continuity"]["borders"].as_u64(), continuous["continuity"]["numbers"].as_u64()),
        (Some(1), Some(4))
    );
    assert!(number(&continuous["continuity"]["jump"]) < 1e-12 && fitted["candidates"][0].get("continuity").is_none());
    // The log's acceleration jumps.
    assert!(number(&continuous["loss"]) > 10.0 * number(&continuous["continuity"]["loss_apart"]), "{fitted:#}");
    let text = run(&["refined:2", "--continuous"]).ok().out;
    assert!(text.contains("loss apart") && text.contains("the maps meet at 1 border within"), "{text}");
    run(&["labels:mode", "--continuous"]).fails(&["labels:mode", "linear borders"]);
    run(&["refined:2", "--continuous", "--objective", "steps:5"]).fails(&["steps:5", "--continuous"]);
    fleetfoot(folder.path(), &["scan", "-c", "robot.toml", "runs", "--partition", "refined:2", "-o", "run.stats"]).ok();
    fleetfoot(folder.path(), &["fit", "pwa", "run.stats", "--continuous", "-o", "summed.json"])
        .fails(&["--continuous", "give the logs"]);
}

#[test]
fn heavy_rows_are_named() {
    let folder = logs();
    let text = robot_csv(30_000, 2.0);
    let fall = |(row, line): (usize, &str)| {
        let mut values: Vec<String> = line.split(',').map(str::to_owned).collect();
        if (20_000..20_100).contains(&row) {
            values[5] = format!("{}", 900.0 * (row as f64).sin());
        }
        values.join(",")
    };
    let rows: Vec<String> = text.lines().enumerate().map(fall).collect();
    fs::write(folder.path().join("fall.csv"), rows.join("\n")).unwrap();
    let fit = ["fit", "pwa", "--time", "t", "--alias", "v=`v [m/s]`", "--states", "v", "--inputs", "u", "-o", "m.json"];
    let run = |more: &[&str]| fleetfoot(folder.path(), &[&fit[..], more].concat()).ok();
    for folds in ["0", "5"] {
        let output = run(&["--predict", "dv", "--folds", folds, "fall.csv"]);
        assert!(output.err.contains("dv: ") && output.err.contains("of its variance"), "{}", output.err);
        // The chunk that the fall lies in, of a few hundred rows.
        let row: usize = output.err.split("from row ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!((19_000..=20_100).contains(&row), "{row}");
    }
    assert!(!run(&["--predict", "dv", "runs/run_0.csv"]).err.contains("of its variance"));
}

#[test]
fn refined_models_go_the_whole_way() {
    let folder = logs();
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let fit = ["fit", "pwa", "-c", "robot.toml", "runs", "--folds", "4", "--partition"];
    let fitted =
        run(&[&fit[..], &["average,refined:2..3", "--keep-all", "--json", "-o", "model.json"]].concat()).json();
    assert_eq!(
        (fitted["chosen"].as_u64(), fitted["candidates"][1]["partition"].as_str()),
        (Some(1), Some("refined:2"))
    );
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    let objective = numbers(&fitted["candidates"][1]["objective_by_pass"]);
    assert!(objective.windows(2).all(|pair| pair[1] <= pair[0]), "{objective:?}");
    assert!(fitted["candidates"][0].get("objective_by_pass").is_none(), "{fitted:#}");
    let loss = |at: usize| fitted["candidates"][at]["loss"].as_f64().unwrap();
    assert!(loss(1) < 0.01 * loss(0), "{fitted:#}");
    run(&["score", "model.json", "held-out.csv"]);

    let show = run(&["show", "model.json"]).out;
    assert!(show.contains("partition refined:2: 2 regions"), "{show}");
    let transitions = run(&["show", "model.json", "--transitions"]).out;
    assert!(
        transitions.contains("transitions of refined:2")
            && transitions.contains("mean dwell in rows")
            && transitions.contains(" s)\n"),
        "{transitions}"
    );
    // Two regions pass rows to each other; each has its name.
    assert!(transitions.contains("separate maps of neighbours"), "{transitions}");
    let pair = transitions.lines().find(|line| line.split_whitespace().take(2).eq(["0", "1"])).expect("a pair");
    assert!(!pair.contains("one map suffices"), "{transitions}");
    fleetfoot(folder.path(), &["show", "model_average.json", "--transitions"]).fails(&[
        "model_average.json",
        "refined:K",
        "--phase",
    ]);
    assert_eq!(fleetfoot(folder.path(), &["show", "model.json", "--all-pairs"]).code, 2);
    assert!(
        run(&["show", "model.json", "--transitions", "--all-pairs"]).out.contains("separate maps of pairs of regions")
    );

    run(&["predict", "model.json", "held-out.csv", "-o", "predicted.parquet"]);
    run(&["rollout", "model.json", "held-out.csv", "--horizon", "20", "--starts", "20"]);
    for to in ["c", "rust", "python", "latex", "npz"] {
        run(&["export", "model.json", "--to", to, "--prefix", "robot", "-o", "code"]);
    }
    let code = fs::read_to_string(folder.path().join("code/robot.c")).unwrap();
    assert!(code.contains("Region of the partition refined:2"), "{code}");
}

#[test]
fn gaps_split_a_file_into_episodes() {
    let folder = tempfile::tempdir().unwrap();
    let text = robot_csv(4000, 0.4);
    let lines: Vec<&str> = text.lines().collect();
    let part = |rows: std::ops::Range<usize>| lines[1 + rows.start..1 + rows.end].join("\n");
    let (first, second) = (part(0..1800), part(1900..4000));
    let write =
        |name: &str, body: String| fs::write(folder.path().join(name), format!("{}\n{body}\n", lines[0])).unwrap();
    write("whole.csv", format!("{first}\n{second}"));
    write("second.csv", second);
    write("first.csv", first);
    let fit = |partition: &str, files: &[&str], output: &str| {
        let mut arguments = vec!["fit", "pwa", "--alias", "v=`v [m/s]`", "--states", "v", "--inputs", "u"];
        arguments.extend(["--partition", partition, "--lags", "2", "--folds", "2", "-o", output]);
        arguments.extend(files);
        fleetfoot(folder.path(), &arguments).ok();
        let mut model: serde_json::Value =
            serde_json::from_slice(&fs::read(folder.path().join(output)).unwrap()).unwrap();
        model["checksum"] = serde_json::Value::Null;
        let mut ids: Vec<String> = Vec::new();
        for episode in model["model"]["training"]["episodes"].as_array().unwrap() {
            ids.push(episode[0].to_string());
        }
        ids.sort();
        model["model"]["training"]["episodes"] = serde_json::Value::Null;
        (ids, model)
    };
    for partition in ["kmeans:4", "refined:3", "lattice:3", "tree:2"] {
        assert_eq!(fit(partition, &["whole.csv"], "a.json"), fit(partition, &["second.csv", "first.csv"], "b.json"));
    }
}

#[test]
fn discrete_models_lags_and_plain_regression() {
    let folder = logs();
    let fit = |arguments: &[&str]| {
        let mut all = vec!["fit", "pwa", "runs", "--json", "--time", "t", "--alias", "v=`v [m/s]`"];
        all.extend(arguments);
        fleetfoot(folder.path(), &all).ok().json()
    };
    let next =
        fit(&["--states", "v", "--inputs", "u", "--predict", "next", "--partition", "labels:mode", "-o", "next.json"]);
    assert_eq!(next["targets"][0], "next(v)");
    assert!(next["candidates"][0]["mae_over_null"][0].as_f64().unwrap() < 1e-9);
    let show = fleetfoot(folder.path(), &["show", "next.json"]).ok().out;
    assert!(show.contains("0.98*v") && show.contains("0.03*u"), "{show}");
    let rollout =
        fleetfoot(folder.path(), &["rollout", "next.json", "held-out.csv", "--horizon", "100", "--json"]).ok().json();
    assert_eq!(rollout["diverged"], 0);

    let lags = fit(&[
        "--states",
        "v",
        "--inputs",
        "u",
        "--predict",
        "delta",
        "--lags",
        "2",
        "--partition",
        "average",
        "-o",
        "lags.json",
    ]);
    assert_eq!(lags["rows_at_border"], 4 * 3, "two past rows and one ahead for each of four episodes");

    let plain = fit(&["--inputs", "u,v", "--predict", "dv", "--partition", "labels:mode", "-o", "plain.json"]);
    assert_eq!(plain["targets"][0], "dv");
    assert!(plain["candidates"][0]["mae_over_null"][0].as_f64().unwrap() < 1e-9);
    fleetfoot(folder.path(), &["rollout", "plain.json", "held-out.csv"]).fails(&["advances a state"]);
}

/// Rows that a condition leaves out are in no fit, and a model uses such rows only, unless another condition is given.
#[test]
fn conditions_select_rows() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let all = robot_csv(3000, 1.0);
    write("all.csv", &all);
    let rows: Vec<&str> = all.lines().collect();
    // Stamps in (5, 12]: rows 502 to 1201 of the file.
    write("part.csv", &format!("{}\n{}\n", rows[0], rows[502..1202].join("\n")));
    let recipe = |condition: &str| {
        format!(
            "[columns]\nv = \"`v [m/s]`\"\n[states]\nv = {{ derivative = \"forward\" }}\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n{condition}"
        )
    };
    write("robot.toml", &recipe(""));
    write("where.toml", &recipe("where = \"5 < t <= 12\"\n"));
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let part = run(&["fit", "pwa", "-c", "robot.toml", "part.csv", "--partition", "average", "-o", "part.json"]);
    let by_recipe = run(&["fit", "pwa", "-c", "where.toml", "all.csv", "--partition", "average", "-o", "where.json"]);
    run(&[
        "fit",
        "pwa",
        "-c",
        "robot.toml",
        "all.csv",
        "--where",
        "5 < t and t <= 12",
        "--partition",
        "average",
        "-o",
        "flag.json",
    ]);
    assert_eq!(part.out.replace("part.json", ""), by_recipe.out.replace("where.json", ""));
    assert!(by_recipe.err.contains("where 5 < t <= 12: 700 of 3000 rows, in one stretch"), "{}", by_recipe.err);
    let equations = |model: &str| {
        let shown = run(&["show", model]).out;
        shown[shown.find("equations").unwrap()..].to_owned()
    };
    assert_eq!(equations("part.json"), equations("where.json"));
    assert_eq!(equations("part.json"), equations("flag.json"));

    let rows = |condition: &[&str]| {
        run(&[&["score", "where.json", "all.csv", "--json"], condition].concat()).json()["rows"].as_u64()
    };
    assert_eq!(
        [rows(&[]), rows(&["--where", "all"]), rows(&["--where", "mode == 'slip'"])].map(|rows| rows.is_some()),
        [true; 3]
    );
    assert_eq!((rows(&[]), rows(&["--where", "all"])), (Some(699), Some(2999)));
    let slip = all.lines().filter(|line| line.contains(",slip,")).count() as u64;
    assert!(rows(&["--where", "mode == 'slip'"]).is_some_and(|rows| rows < slip && rows + 200 > slip), "{slip}");
    // The bytes do not depend on threads; a statistic is of the same rows.
    run(&["--threads", "1", "fit", "pwa", "-c", "where.toml", "all.csv", "--partition", "average", "-o", "one.json"]);
    let bytes = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("one.json") == bytes("where.json"));
    run(&["scan", "-c", "where.toml", "all.csv", "-o", "where.stats"]);
    assert!(run(&["stats", "info", "where.stats"]).out.contains("699"));
    // Its rows are chosen: neither a fit nor another scan takes others, and a model of it has the condition.
    let refused = |arguments: &[&str], words: &[&str]| fleetfoot(folder.path(), arguments).fails(words);
    refused(
        &["fit", "sparse", "where.stats", "--where", "t < 9", "-o", "x.json"],
        &["t < 9", "5 < t <= 12", "scan the logs again"],
    );
    refused(&["fit", "pwa", "where.stats", "--where", "all", "-o", "x.json"], &["another condition"]);
    run(&["fit", "pwa", "-c", "robot.toml", "where.stats", "--partition", "average", "-o", "sums.json"]);
    assert!(String::from_utf8(bytes("sums.json")).unwrap().contains("5 < t <= 12"));
    run(&["scan", "-c", "robot.toml", "all.csv", "--plan", "where.stats", "-o", "x.stats"]
        .map(|word| word.replace("robot", "where"))
        .each_ref()
        .map(String::as_str));
    refused(
        &["scan", "-c", "robot.toml", "all.csv", "--plan", "where.stats", "-o", "y.stats"],
        &["5 < t <= 12", "all"],
    );
    run(&["scan", "-c", "robot.toml", "all.csv", "-o", "all.stats"]);
    refused(&["stats", "merge", "where.stats", "all.stats", "-o", "y.stats"], &["rows where 5 < t <= 12"]);
    fleetfoot(folder.path(), &["fit", "pwa", "-c", "robot.toml", "all.csv", "--where", "t > 1e9"])
        .fails(&["none of the 3000 rows satisfies"]);
    fleetfoot(folder.path(), &["fit", "pwa", "-c", "robot.toml", "all.csv", "--where", "velocity > 0"])
        .fails(&["velocity", "[time] where"]);
}

/// A pager that has ended reads no more: the fit is written all the same.
#[cfg(unix)]
#[test]
fn quiet_suppresses_notes() {
    use std::process::{Command, Stdio};
    let folder = logs();
    let mut child = Command::new(env!("CARGO_BIN_EXE_fleetfoot"))
        .current_dir(folder.path())
        .args(["fit", "pwa", "-c", "robot.toml", "--folds", "4", "--partition", "average", "-o", "model.json", "runs"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stderr.take());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(folder.path().join("model.json").is_file());
}

/// A failed write of the output is an error, unless the reader has closed the pipe.
#[cfg(target_os = "linux")]
#[test]
fn full_disks_are_an_error() {
    let folder = logs();
    let full = fs::File::options().write(true).open("/dev/full").expect("a device");
    let output = Command::new(env!("CARGO_BIN_EXE_fleetfoot"))
        .current_dir(folder.path())
        .args(["info", "runs"])
        .stdout(full)
        .output()
        .expect("the command runs");
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && message.contains("standard output cannot be written"), "{message}");
}

/// Choices that depend on numbers of rows (regions, terms, lambda) are the same for weights that are counts and for
/// shares.
#[test]
fn scales_of_weights_change_no_method() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("run.csv"), robot_csv(1_200, 0.3).replace("v [m/s]", "v")).expect("a file");
    let fitted = |method: &str, more: &[&str], weight: &str| -> Vec<f64> {
        let columns = ["run.csv", "--inputs", "u", "--weight", weight, "-o", "model.json"];
        fleetfoot(folder.path(), &[&["fit", method][..], &columns, more].concat()).ok();
        let text = fs::read_to_string(folder.path().join("model.json")).expect("a model");
        let model: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let latents = model["model"]["latents"].as_array().expect("latents").iter();
        let numbers = |latent: &serde_json::Value| -> Vec<f64> {
            let rows = latent["coefficients"].as_array().into_iter().flatten();
            let all = rows.flat_map(|row| row.as_array().into_iter().flatten());
            all.chain(latent["constants"].as_array().into_iter().flatten()).filter_map(|value| value.as_f64()).collect()
        };
        latents.flat_map(numbers).collect()
    };
    for (method, more) in [
        ("pwa", &["--states", "v", "--partition", "average,refined:2,3"][..]),
        ("pwa", &["--states", "v", "--partition", "average,kmeans:2,4", "--select", "bic"]),
        ("sindy", &["--states", "v", "--degree", "3", "--select", "bic"]),
        ("sparse", &["--predict", "v", "--degree", "2", "--select", "bic"]),
        ("sparse", &["--predict", "v", "--degree", "2", "--lambda", "0.3/sqrt(n)"]),
        ("narx", &["--states", "v", "--select", "bic"]),
    ] {
        let plain = fitted(method, more, "1.2 + 0.5*u");
        assert!(!plain.is_empty(), "{method}");
        for weight in ["1e-9*(1.2 + 0.5*u)", "1e9*(1.2 + 0.5*u)"] {
            let scaled = fitted(method, more, weight);
            assert_eq!(scaled.len(), plain.len(), "{method} {more:?} {weight}");
            let size = plain.iter().fold(0.0, |size: f64, value| size.max(value.abs()));
            let near = scaled.iter().zip(&plain).all(|(scaled, plain)| (scaled - plain).abs() < 1e-7 * size);
            assert!(near, "{method} {more:?} {weight}: {scaled:?} {plain:?}");
        }
    }
}
