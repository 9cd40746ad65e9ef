//! `fit sparse` from the command line: from logs and from their statistic, shared latents and plain recipes, and the
//! other commands on its models.

use std::fs;

use crate::runner::*;

/// Six climbs and the recipe beside them.
fn climbs() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let generate = ["generate", "aircraft", "-o", "runs", "--runs", "6", "--seconds", "300", "--format", "parquet"];
    fleetfoot(folder.path(), &generate).ok();
    folder
}

fn fit(folder: &Path, arguments: &[&str]) -> Run {
    let all: Vec<&str> = ["fit", "sparse", "--json"].into_iter().chain(arguments.iter().copied()).collect();
    fleetfoot(folder, &all)
}

fn number(value: &serde_json::Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

const RECIPE: &str = "runs/robot.toml";

#[test]
fn the_aircraft_from_logs_to_equations() {
    let folder = climbs();
    let path = folder.path();
    let report = fit(path, &["-c", RECIPE, "runs", "-o", "data.json", "--keep", "run.stats"]).ok().json();
    assert!(number(&report["certificate"]["kkt"]) < 1e-8 && number(&report["certificate"]["gap"]) < 1e-6, "{report}");
    let tasks = report["tasks"].as_array().unwrap();
    let names: Vec<&str> = tasks.iter().map(|task| task["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["along", "normal", "fuel", "prior of Isp"]);
    assert!(number(&tasks[0]["r2"]) > 0.97 && number(&tasks[1]["r2"]) > 0.98, "{tasks:?}");
    assert!(tasks[2]["r2"].is_null(), "a target that is 0 has no variance to explain");
    assert!(tasks[..3].iter().all(|task| number(&task["held_out_rms"]) > 0.0) && tasks[3]["held_out_rms"].is_null());
    // Thrust on the order of 100 kN a unit of fan speed and density: the prior keeps it from shrinking to 0.
    let latents = report["latents"].as_array().unwrap();
    let sizes: Vec<usize> = latents.iter().map(|latent| latent["functions"].as_array().unwrap().len()).collect();
    assert_eq!(sizes, [15, 10, 10, 10]);
    assert!(
        latents[0]["functions"].as_array().unwrap().iter().any(|function| number(&function["coefficient"]).abs() > 1e4)
    );

    // The same from the statistic, and on any number of threads, to the byte.
    fit(path, &["-c", RECIPE, "runs", "-o", "one.json", "--threads", "1"]).ok();
    fit(path, &["-c", RECIPE, "run.stats", "-o", "stats.json", "--threads", "2"]).ok();
    fleetfoot(path, &["scan", "-c", RECIPE, "runs", "-o", "scanned.stats"]).ok();
    fit(path, &["-c", RECIPE, "scanned.stats", "-o", "scanned.json"]).ok();
    for other in ["one.json", "stats.json", "scanned.json"] {
        same(path, "data.json", other);
    }

    let shown = fleetfoot(path, &["show", "data.json"]).ok().out;
    for part in ["d(V)/dt = (T*cos(alpha) - D)/m - 9.80665*sin(gamma)", "d(m)/dt = -T/Isp", "latent T:", "T = ", "*N1*"]
    {
        assert!(shown.contains(part), "{part} is missing from {shown}");
    }
    let scores = fleetfoot(path, &["score", "data.json", "runs", "--json"]).ok().json();
    assert!(number(&scores["rows"]) > 1500.0, "{scores}");
    fleetfoot(path, &["predict", "data.json", "runs", "-o", "pred.parquet"]).ok();
    fleetfoot(path, &["rollout", "data.json", "runs", "--horizon", "50", "--starts", "4"]).ok();
}

#[test]
fn bolassos_priors_and_labels() {
    let folder = climbs();
    let path = folder.path();
    fit(path, &["-c", RECIPE, "runs", "--keep", "run.stats", "--lambda", "1e-3"]).ok();
    let bolasso = |arguments: &[&str]| {
        let all: Vec<&str> =
            ["run.stats", "--lambda", "0.1/sqrt(n)"].into_iter().chain(arguments.iter().copied()).collect();
        fit(path, &all).ok().json()
    };
    let hard = bolasso(&["--bolasso", "episodes:40", "--frequencies", "f.parquet"]);
    let soft = bolasso(&["--bolasso", "episodes:40", "--threshold", "0.5"]);
    let selected = |report: &serde_json::Value| -> Vec<bool> {
        let functions =
            report["latents"].as_array().unwrap().iter().flat_map(|latent| latent["functions"].as_array().unwrap());
        functions
            .map(|function| {
                let frequency = number(&function["frequency"]);
                assert!((0.0..=1.0).contains(&frequency));
                function["selected"].as_bool().unwrap()
            })
            .collect()
    };
    let (hard, soft) = (selected(&hard), selected(&soft));
    assert!(hard.iter().zip(&soft).all(|(hard, soft)| *soft || !hard), "what all agree on, half of them do");
    assert!(soft.iter().any(|&selected| selected));
    assert!(fs::metadata(path.join("f.parquet")).unwrap().len() > 500);
    // A stronger prior moves the impulse towards what is believed.
    let distance = |strength: &str| {
        let report = bolasso(&["--prior-strength", strength]);
        number(&report["tasks"][3]["rms"])
    };
    assert!(distance("1e4") < distance("1e-2"));
    let rows = fit(path, &["-c", RECIPE, "runs", "--lambda", "1e-3", "--bolasso", "rows:16"]).ok().json();
    assert!(rows["selection"].as_str().unwrap().contains("16 replicates of rows"), "{rows}");
    fit(path, &["run.stats", "--bolasso", "rows"]).fails(&["a statistic has no rows", "episodes"]);

    for (aircraft, run) in [("a", 0), ("a", 1), ("a", 2), ("b", 3), ("b", 4), ("b", 5)] {
        fs::create_dir_all(path.join("fleet").join(aircraft)).unwrap();
        let file = fs::read_dir(path.join("runs")).unwrap().flatten().map(|entry| entry.path());
        let mut logs: Vec<_> = file.filter(|file| file.extension().is_some_and(|e| e == "parquet")).collect();
        logs.sort();
        fs::copy(&logs[run], path.join("fleet").join(aircraft).join(logs[run].file_name().unwrap())).unwrap();
    }
    let by =
        ["-c", RECIPE, "fleet", "--key", "aircraft={dir1}", "--by", "aircraft", "--lambda", "1e-3", "-o", "m.json"];
    let report = fit(path, &by).ok().json();
    let values: Vec<&str> =
        report["models"].as_array().unwrap().iter().map(|model| model["value"].as_str().unwrap()).collect();
    assert_eq!(values, ["a", "b"]);
    assert!(path.join("m_a.json").exists() && path.join("m_b.json").exists());
    fit(path, &["run.stats", "--by", "aircraft"]).fails(&["--by aircraft", "no label", "--key"]);
}

#[test]
fn disturbed_climbs_are_most_influential() {
    let folder = climbs();
    let path = folder.path();
    // A climb that burns a fifth more fuel for the same thrust.
    let world = fleetfoot(path, &["generate", "aircraft", "--print-world"]).ok().out;
    let thirsty = world.replacen("coefficient = 277.0 ", "coefficient = 231.0 ", 1);
    assert_ne!(world, thirsty);
    fs::write(path.join("thirsty.toml"), thirsty).unwrap();
    let options = ["--world", "thirsty.toml", "--runs", "1", "--first-run", "6", "--seconds", "300"];
    let generate = [&["generate", "aircraft", "-o", "other", "--format", "parquet"][..], &options].concat();
    fleetfoot(path, &generate).ok();
    let odd = "other/aircraft_06.parquet";
    assert!(path.join(odd).exists());

    let all = ["-c", RECIPE, "runs", odd, "--lambda", "1e-3"];
    let with = |more: &[&'static str]| -> Vec<&str> { all.iter().chain(more).copied().collect() };
    fit(path, &with(&["-o", "plain.json", "--keep", "all.stats"])).ok();
    let report = fit(path, &with(&["-o", "left_out.json", "--influence"])).ok().json();
    same(path, "plain.json", "left_out.json");
    let influence = &report["influence"];
    let episodes = influence["episodes"].as_array().unwrap();
    let of = |key: &str| -> Vec<f64> { episodes.iter().map(|episode| number(&episode[key])).collect() };
    let distances = of("cooks_distance");
    assert_eq!(episodes.len(), 7);
    assert_eq!(episodes[0]["name"], "aircraft_06.parquet");
    assert!(distances.is_sorted_by(|a, b| a >= b) && distances[0] > 2.0 * distances[1], "{distances:?}");
    assert!(episodes.iter().all(|episode| number(&episode["held_out_rms"]) >= number(&episode["in_sample_rms"])));
    let mean = |key: &str| {
        let squares: f64 = of("share").iter().zip(of(key)).map(|(share, error)| share * error * error).sum();
        squares.sqrt()
    };
    // The in-sample errors come from the episodes' own moments and from those of all rows, and from the tasks' table.
    let in_sample = number(&influence["in_sample_rms"]);
    assert!((mean("in_sample_rms") / in_sample - 1.0).abs() < 1e-6, "{influence}");
    assert!((mean("held_out_rms") / number(&influence["held_out_rms"]) - 1.0).abs() < 1e-9, "{influence}");
    let tasks = report["tasks"].as_array().unwrap()[..3].iter();
    let squares: f64 = tasks.map(|task| (number(&task["rms"]) / number(&task["scale"])).powi(2)).sum();
    assert!((squares.sqrt() / in_sample - 1.0).abs() < 1e-6, "{squares} {influence}");
    // The climb changes the impulse, or the thrust that the fuel equation ties to it.
    let change = &episodes[0]["largest_change"];
    assert!(number(&change["standard_errors"]).abs() > 1.0, "{change}");
    assert!(["T: ", "Isp: "].iter().any(|latent| change["coefficient"].as_str().unwrap().starts_with(latent)));

    let text = fleetfoot(path, &["fit", "sparse", "all.stats", "--lambda", "1e-3", "--influence"]).ok().out;
    for part in
        ["with every episode predicted by the others", "7 of 7 episodes", "Cook's distance", "aircraft_06.parquet"]
    {
        assert!(text.contains(part), "{part} is missing from {text}");
    }
    let single = fit(path, &["-c", RECIPE, odd, "--lambda", "1e-3", "--influence"]).ok().json();
    assert!(single["influence"].is_null());
    assert!(single["notes"].to_string().contains("needs at least two"), "{}", single["notes"]);
}

#[test]
fn bolassos_have_intervals_of_selected_functions() {
    let folder = climbs();
    let path = folder.path();
    let bolasso = ["--lambda", "0.1/sqrt(n)", "--bolasso", "episodes:60", "--threshold", "0.7"];
    let report = fit(path, &[&["-c", RECIPE, "runs", "--keep", "run.stats"][..], &bolasso].concat()).ok().json();
    let latents = report["latents"].as_array().unwrap();
    let (mut intervals, mut around) = (0, 0);
    for function in latents.iter().flat_map(|latent| latent["functions"].as_array().unwrap()) {
        let Some(interval) = function["lasso_interval"].as_array() else {
            assert_eq!(function["selected"], false, "{function}");
            continue;
        };
        assert_eq!(function["selected"], true, "{function}");
        let (low, high, lasso) = (number(&interval[0]), number(&interval[1]), number(&function["lasso"]));
        assert!(low < high, "{function}");
        intervals += 1;
        // Replicates spread around the lasso on all rows, which at a quarter of the width beyond an end is still near.
        let room = 0.25 * (high - low);
        around += usize::from(low - room < lasso && lasso < high + room);
    }
    assert!(intervals > 8 && around == intervals, "{around} of {intervals}: {latents:?}");
    let text = fleetfoot(path, &[&["fit", "sparse", "run.stats"][..], &bolasso].concat()).ok().out;
    assert!(text.contains("95 % of lassos"), "{text}");
    let tables = text.lines().skip_while(|line| !line.starts_with("T: "));
    assert!(tables.filter(|line| line.starts_with("  ")).all(|line| line.chars().count() <= 100), "{text}");
    let plain = fleetfoot(path, &["fit", "sparse", "-c", RECIPE, "run.stats", "--lambda", "1e-3"]).ok().out;
    assert!(!plain.contains("95 %"), "{plain}");
}

#[test]
fn bounds_hold_at_every_row() {
    let folder = climbs();
    let path = folder.path();
    let text = fs::read_to_string(path.join(RECIPE)).unwrap();
    // The unbounded coefficient is lower than this somewhere: the bound is active.
    let bounded = text.replacen("D = { times = \"q\"", "D = { at_least = 2.8e4, times = \"q\"", 1);
    assert_ne!(bounded, text);
    fs::write(path.join("bounded.toml"), bounded).unwrap();
    let report = fit(path, &["-c", "bounded.toml", "runs", "--lambda", "1e-4", "--keep", "b.stats"]).ok().json();
    let [limit] = &report["limits"].as_array().unwrap()[..] else { panic!("{report}") };
    assert_eq!((&limit["name"], &limit["side"], number(&limit["bound"])), (&"D".into(), &"at least".into(), 2.8e4));
    assert!(number(&limit["nearest"]) >= 0.0 && number(&limit["cuts"]) > 0.0, "{limit}");
    assert!(limit["episode"].is_string() && limit["row"].is_number(), "{limit}");
    // The bound has its price, in the fit and beside it.
    let along = &report["tasks"][0];
    assert!(number(&along["rms"]) > number(&along["free_rms"]), "{along}");
    assert!(number(&along["held_out_rms"]) > 0.0 && number(&along["free_held_out_rms"]) > 0.0, "{along}");
    fit(path, &["-c", "bounded.toml", "b.stats", "--lambda", "1e-4"])
        .fails(&["D: a bound at every row", "needs the rows"]);
}

/// Angle, accelerations and torques of an arm of two links, the second of which hardly moves.
fn arm(folder: &Path) {
    let mut text = String::from("t,q,a1,a2,t1,t2\n");
    for row in 0..3_000 {
        let t = f64::from(row) * 0.01;
        let (q, a1, a2) = ((0.31 * t).sin() * 2.5, (1.7 * t).sin() * 3.0, 0.02 * (2.9 * t).cos());
        // Noise that no inertia explains, as large as the second link's share.
        let (n1, n2) = (0.2 * (31.0 * t).sin(), 0.3 * (47.0 * t).cos() - 0.03 * (2.9 * t).cos());
        let m = [0.9 + 0.5 * q.cos(), 0.2 + 0.25 * q.cos(), 0.2];
        text.push_str(&format!("{t},{q},{a1},{a2},{},{}\n", m[0] * a1 + m[1] * a2 + n1, m[1] * a1 + m[2] * a2 + n2));
    }
    fs::write(folder.join("arm.csv"), text).unwrap();
}

const ARM: &str = r#"
[time]
column = "t"
[latents]
M11 = { functions = ["1", "cos(q)"] }
M12 = { functions = ["1", "cos(q)"] }
M22 = { functions = ["1"] }
[tasks]
first = { target = "t1", right = "M11*a1 + M12*a2" }
second = { target = "t2", right = "M12*a1 + M22*a2" }
"#;

#[test]
fn inertias_are_positive_definite_on_request() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    arm(path);
    let with = |name: &str, constraints: &str| fs::write(path.join(name), format!("{ARM}{constraints}")).unwrap();
    with("free.toml", "");
    with("arm.toml", "[constraints]\ninertia = { matrix = [[\"M11\"], [\"M12\", \"M22\"]], at_least = 1e-3 }\n");
    let least = |report: &serde_json::Value| {
        let of = |latent: usize, at: usize| number(&report["latents"][latent]["functions"][at]["coefficient"]);
        let rows = (0..3_000).map(|row| ((0.31 * 0.01 * f64::from(row)).sin() * 2.5).cos());
        rows.map(|cos| {
            let m = [of(0, 0) + of(0, 1) * cos, of(1, 0) + of(1, 1) * cos, of(2, 0)];
            0.5 * (m[0] + m[2]) - (0.5 * (m[0] - m[2])).hypot(m[1])
        })
        .fold(f64::INFINITY, f64::min)
    };
    let free = fit(path, &["-c", "free.toml", "arm.csv", "-o", "free.json", "--lambda", "0"]).ok().json();
    assert!(least(&free) < -1e-2 && free["limits"].is_null(), "{free}");
    let report = fit(path, &["-c", "arm.toml", "arm.csv", "-o", "arm.json", "--lambda", "0"]).ok().json();
    assert!(least(&report) >= 1e-3 - 1e-12, "{report}");
    assert_eq!(report["limits"][0]["name"], "inertia");
    for (task, name) in ["first", "second"].into_iter().enumerate() {
        let (bound, free) = (&report["tasks"][task], &free["tasks"][task]);
        assert_eq!((bound["name"].as_str(), &bound["free_rms"]), (Some(name), &free["rms"]), "{report}");
        assert_eq!(bound["free_held_out_rms"], free["held_out_rms"], "{report}");
    }
    fit(path, &["-c", "arm.toml", "arm.csv", "-o", "two.json", "--lambda", "0", "--threads", "1"]).ok();
    same(path, "arm.json", "two.json");
    // The model's recipe has the constraint: it is fitted again to the same bytes.
    let text =
        fleetfoot(path, &["fit", "sparse", "-c", "arm.toml", "arm.csv", "-o", "again.json", "--lambda", "0"]).ok().out;
    assert!(text.contains("without bounds") && text.contains("inertia  at least 0.001000"), "{text}");

    for (constraints, parts) in [
        ("a = { of = \"M11\" }", &["[constraints] a", "nothing bounds it"][..]),
        ("a = { at_least = 0.0 }", &["[constraints] a", "write what is bounded"]),
        ("a = { of = \"q\", at_least = 0.0 }", &["[constraints] a", "no latent", "M11, M12, M22"]),
        ("a = { of = \"M11*M22\", at_least = 0.0 }", &["`M11` is multiplied with `M22`"]),
        ("a = { of = \"M11\", at_least = 2.0, at_most = 1.0 }", &["at_least = 2 is not below at_most = 1"]),
        ("a = { of = \"M11\", matrix = [[\"M22\"]], at_least = 0.0 }", &["both `of` and `matrix`"]),
        (
            "a = { matrix = [[\"M11\", \"M12\"], [\"M22\", \"M11\"]], at_least = 0.0 }",
            &["row 1, column 2", "`M12`", "`M22`"],
        ),
        ("a = { matrix = [[\"M11\"], [\"M12\"]], at_least = 0.0 }", &["row 2 has 1 entries", "2 in all"]),
        ("a = { of = \"M11\", at_least = 20.0 }\nb = { of = \"M11\", at_most = 10.0 }", &["a >= 20", "b <= 10"]),
    ] {
        with("wrong.toml", &format!("[constraints]\n{constraints}\n"));
        fit(path, &["-c", "wrong.toml", "arm.csv", "-o", "wrong.json", "--lambda", "0"]).fails(parts);
    }
    assert!(!path.join("wrong.json").exists());
}

#[test]
fn plain_recipes_equal_unpenalised_pwa() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    for run in 0..4 {
        fs::write(path.join(format!("run{run}.csv")), robot_csv(400, f64::from(run))).expect("a file");
    }
    let recipe = "[states]\nv = { column = \"v [m/s]\", derivative = \"dv\" }\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n[model]\ndegree = 2\n";
    fs::write(path.join("robot.toml"), recipe).unwrap();
    let logs = ["run0.csv", "run1.csv", "run2.csv", "run3.csv"];
    let with = |arguments: &[&'static str]| -> Vec<&str> { arguments.iter().copied().chain(logs).collect() };
    fit(path, &with(&["-c", "robot.toml", "-o", "sparse.json", "--lambda", "0"])).ok();
    fleetfoot(
        path,
        &[&["fit", "pwa"][..], &with(&["-c", "robot.toml", "--partition", "average", "-o", "pwa.json"])].concat(),
    )
    .ok();
    let latent = |file: &str| -> serde_json::Value {
        let text = fs::read_to_string(path.join(file)).unwrap();
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["model"]["latents"][0].clone()
    };
    let (sparse, pwa) = (latent("sparse.json"), latent("pwa.json"));
    assert_eq!(sparse["name"], pwa["name"]);
    assert!((number(&sparse["constants"][0]) - number(&pwa["constants"][0])).abs() < 1e-10);
    for (a, b) in sparse["coefficients"][0].as_array().unwrap().iter().zip(pwa["coefficients"][0].as_array().unwrap()) {
        assert!((number(a) - number(b)).abs() < 1e-9, "{sparse} {pwa}");
    }
    // A large lambda leaves the free constant alone.
    let none = fit(path, &with(&["-c", "robot.toml", "--lambda", "1e3"])).ok().json();
    let functions = none["latents"][0]["functions"].as_array().unwrap();
    let used: Vec<&str> = functions
        .iter()
        .filter(|function| number(&function["coefficient"]) != 0.0)
        .map(|function| function["function"].as_str().unwrap())
        .collect();
    assert_eq!(used, ["1"]);
    let chosen = fit(path, &with(&["-c", "robot.toml", "--select", "bic"])).ok().json();
    assert!(chosen["lambda"]["how"].as_str().unwrap().contains("BIC"), "{chosen}");
    fit(path, &with(&["-c", "robot.toml", "--l1-ratio", "0.5"])).ok();
    fit(path, &with(&["-c", "robot.toml", "--adaptive"])).ok();
    let plan = fit(path, &with(&["-c", "robot.toml", "--dry-run"])).ok().json();
    assert_eq!((plan["passes"].as_u64(), plan["rows"].as_u64()), (Some(1), Some(1600)));
}

/// Two equations of three signals: `a` and its powers are in both, `b` in one, `c` in none.
#[test]
fn groups_of_functions_enter_together() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let mut state = 7_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    for run in 0..6 {
        let mut text = String::from("t,a,b,c,y,z\n");
        for i in 0..300 {
            let [a, b, c] = [2.0 * noise(), 2.0 * noise(), 2.0 * noise()];
            let (y, z) = (1.0 + 2.0 * a - a * a + 0.3 * noise(), 0.5 * a * a * a + b - 3.0 * a + 0.3 * noise());
            text.push_str(&format!("{},{a},{b},{c},{y},{z}\n", 0.1 * f64::from(i)));
        }
        fs::write(path.join(format!("run{run}.csv")), text).expect("a file");
    }
    let latent = "{ of = [\"a\", \"b\", \"c\"], degree = 3 }";
    let recipe = format!(
        "[time]\ncolumn = \"t\"\n[latents]\nf = {latent}\ng = {latent}\n[tasks]\ny = {{ target = \"y\", right = \"f\" }}\n\
         z = {{ target = \"z\", right = \"g\" }}\n"
    );
    let recipe = recipe.replace("\ny = {", "\nfirst = {").replace("\nz = {", "\nsecond = {");
    fs::write(path.join("r.toml"), recipe).expect("a recipe");
    let logs = ["run0.csv", "run1.csv", "run2.csv", "run3.csv", "run4.csv", "run5.csv"];
    let run = |more: &[&'static str]| {
        let all: Vec<&str> = ["-c", "r.toml"].into_iter().chain(more.iter().copied()).chain(logs).collect();
        fit(path, &all).ok().json()
    };
    let selected = |report: &serde_json::Value, latent: usize| -> Vec<String> {
        let functions = report["latents"][latent]["functions"].as_array().unwrap();
        let chosen = functions.iter().filter(|function| function["selected"] == true);
        chosen.map(|function| function["function"].as_str().unwrap().to_owned()).collect()
    };
    let report = run(&["--groups", "signal"]);
    assert!(report["selection"].as_str().unwrap().starts_with("the group lasso"), "{report}");
    assert!(number(&report["certificate"]["gap"]) < 1e-10 && number(&report["certificate"]["kkt"]) < 1e-8);
    let (first, second) = (selected(&report, 0), selected(&report, 1));
    assert!(
        ["a", "a^2", "a^3"].iter().all(|name| first.iter().any(|selected_name| selected_name == name)),
        "{first:?}"
    );
    assert!(
        ["a", "a^2", "a^3", "b", "b^2", "b^3"]
            .iter()
            .all(|name| second.iter().any(|selected_name| selected_name == name)),
        "{second:?}"
    );
    for signal in ["a", "b", "c"] {
        let powers = [signal.to_owned(), format!("{signal}^2"), format!("{signal}^3")];
        assert!([0, 3].contains(&powers.iter().filter(|power| first.contains(power)).count()), "{first:?}");
    }
    // A function is in all equations or in none.
    let report = run(&["--groups", "term"]);
    let constant = |names: Vec<String>| names.into_iter().filter(|name| name != "1").collect::<Vec<String>>();
    assert_eq!(constant(selected(&report, 0)), constant(selected(&report, 1)));
    assert!(
        ["a", "a^2", "a^3", "b"]
            .iter()
            .all(|name| selected(&report, 0).iter().any(|selected_name| selected_name == name))
    );
    // Absolute values beside the norms let single functions leave; criteria choose too, and a model's recipe has the method.
    let report = run(&["--groups", "signal", "--l1-ratio", "0.8", "--select", "bic", "-o", "m.json"]);
    assert!(report["selection"].as_str().unwrap().starts_with("the sparse-group lasso"), "{report}");
    assert!(selected(&report, 0).iter().any(|name| name == "a^2"));
    let model = fs::read_to_string(path.join("m.json")).expect("a model");
    assert!(model.contains("groups = \\\"signal\\\"") && model.contains("sparse-group lasso"), "{model}");
    let named = run(&["--groups", "first=a,b", "--lambda", "0.05"]);
    let signals = selected(&named, 0);
    assert!(signals.iter().any(|name| name == "a*b") && signals.iter().any(|name| name == "b^3"), "{signals:?}");
    for (more, words) in [
        (&["--groups", "leg"][..], &["groups = leg", "signal, term"][..]),
        (&["--groups", "legs=d"], &["groups legs", "`d`"]),
        (&["--groups", "signal", "--bolasso", "episodes"], &["groups with a bolasso"]),
    ] {
        let all: Vec<&str> = ["-c", "r.toml"].into_iter().chain(more.iter().copied()).chain(logs).collect();
        fit(path, &all).fails(words);
    }
}

#[test]
fn impossible_fits_are_refused() {
    let folder = climbs();
    let path = folder.path();
    let edited = |from: &str, to: &str| {
        let text = fs::read_to_string(path.join(RECIPE)).unwrap();
        let changed = text.replacen(from, to, 1);
        assert_ne!(changed, text, "{from}");
        fs::write(path.join("bad.toml"), changed).unwrap();
        fit(path, &["-c", "bad.toml", "runs"])
    };
    edited("right = \"T*cos(alpha) - D\"", "right = \"T*cos(alpha) - DD\"").fails(&["[tasks] along right", "DD"]);
    edited("right = \"T*cos(alpha) - D\"", "right = \"T*D\"").fails(&["[tasks] along right", "product of two latents"]);
    edited(", scale = 1e4", "").fails(&["[tasks] fuel", "constant", "scale"]);
    edited("of = [\"rho\", \"M\"]", "of = [\"roh\", \"M\"]").fails(&["[latents] T of", "roh", "rho"]);
    edited("target = \"0\"", "targt = \"0\"").fails(&["bad.toml", "targt"]);
    edited("(T*cos(alpha) - D)/m - 9.80665*sin(gamma)", "9.80665*sin(gamma)").fails(&["[states] V equation", "known"]);
    for (flags, words) in [
        (["--lambda", "many"], ["lambda = many", "auto"]),
        (["--folds", "1"], ["folds = 1", "episodes"]),
        (["--bolasso", "days"], ["bolasso = days", "chunks"]),
        (["--threshold", "2"], ["threshold = 2", "at most 1"]),
    ] {
        let all: Vec<&str> = ["-c", RECIPE, "runs"].into_iter().chain(flags).collect();
        fit(path, &all).fails(&words);
    }
}

/// A constraint that the selected functions cannot keep differs from one that none can: the message distinguishes the
/// two.
#[test]
fn constraints_of_dropped_functions_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    fs::write(path.join("log.csv"), robot_csv(400, 0.0)).expect("a file");
    let recipe = "[columns]\nv = \"`v [m/s]`\"\n[time]\ncolumn = \"t\"\n[latents]\nA = { functions = [\"1\"] }\nB = { functions = [\"1\"] }\n\
                  [tasks]\none = { target = \"3*u + 0.01*v\", right = \"A*v + B*u\" }\n[constraints]\n";
    let write =
        |constraints: &str| fs::write(path.join("robot.toml"), format!("{recipe}{constraints}")).expect("a file");
    let run = |more: &[&str]| fit(path, &[&["-c", "robot.toml", "log.csv", "-o", "out.json"], more].concat());
    write("m = { matrix = [[\"A\"], [\"B - 3*A\", \"A\"]], at_least = 1.0 }\n");
    run(&["--lambda", "0.1"]).fails(&["the selected functions cannot keep m >= 1", "penalty = 0.0"]);
    assert!(!path.join("out.json").exists());
    run(&["--lambda", "0"]).ok();
    // Of a matrix there is a row for every direction that was cut, and one name.
    write("m = { matrix = [[\"A\"], [\"B\", \"A\"]], at_least = 1.0 }\nn = { of = \"A\", at_most = 0.1 }\n");
    let message = run(&[]).fails(&["no coefficients satisfy these constraints together", "n <= 0.1"]);
    assert_eq!(message.matches("m >= 1").count(), 1, "{message}");
}

/// Conditions of the optimum of the objective in docs/mathematics.md, with target and columns over their deviations:
/// `x_j' r / (n s^2) = lambda u_j sign(b_j)` where `b_j` is not 0, else at most `lambda u_j`.
#[test]
fn lassos_minimise_the_documented_objective() {
    let folder = tempfile::tempdir().expect("a folder");
    let rows = 500;
    let wave = |k: usize, frequency: f64| (frequency * k as f64).sin();
    let columns = [2.0, 0.3, 7.0].map(|size| (0..rows).map(|k| size * wave(k, 0.7 + 0.1 * size)).collect::<Vec<f64>>());
    let y: Vec<f64> =
        (0..rows).map(|k| 4.0 * columns[0][k] - 3.0 * columns[1][k] + 5.0 + 2.0 * wave(k * k, 0.31)).collect();
    let mut text = String::from("y,a,b,c\n");
    for k in 0..rows {
        text += &format!("{},{},{},{}\n", y[k], columns[0][k], columns[1][k], columns[2][k]);
    }
    fs::write(folder.path().join("log.csv"), text).expect("a file");
    let lambda = 0.05;
    let report =
        fit(folder.path(), &["log.csv", "--inputs", "a,b,c", "--predict", "y", "--lambda", "0.05"]).ok().json();
    let functions = report["latents"][0]["functions"].as_array().expect("functions");
    let of = |name: &str| number(&functions.iter().find(|function| function["function"] == name).expect(name)["lasso"]);
    let slopes = ["a", "b", "c"].map(of);
    assert!(slopes[0] > 1.0 && slopes[1] < 0.0, "{slopes:?}");
    let n = rows as f64;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / n;
    let deviation = |values: &[f64]| {
        let centre = mean(values);
        (values.iter().map(|value| (value - centre).powi(2)).sum::<f64>() / n).sqrt()
    };
    let scale = deviation(&y);
    let residual: Vec<f64> =
        (0..rows).map(|k| y[k] - of("1") - (0..3).map(|j| slopes[j] * columns[j][k]).sum::<f64>()).collect();
    for (column, slope) in columns.iter().zip(slopes) {
        let slant = column.iter().zip(&residual).map(|(x, r)| x * r).sum::<f64>() / (n * scale * scale);
        let most = lambda * deviation(column) / scale;
        // The solver's certificate is 1e-8 of the gradient at 0, and the text has all digits.
        match slope {
            0.0 => assert!(slant.abs() <= most * (1.0 + 1e-6), "{slant} {most}"),
            _ => assert!((slant - most * slope.signum()).abs() < 1e-6 * most, "{slope}: {slant} {most}"),
        }
    }
}
