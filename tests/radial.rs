//! `--radial`: smooth functions of states and inputs, from the fit to the code.

use std::fs;

use crate::runner::*;

/// Uniform in [-1, 1).
fn draw(key: u64) -> f64 {
    2.0 * (fleetfoot::data::mix(key) >> 11) as f64 / 9_007_199_254_740_992.0 - 1.0
}

/// `y = z sin x`, and a text beside it.
fn surface(rows: u64) -> String {
    let mut text = String::from("x,z,y,ground\n");
    for k in 0..rows {
        let (x, z) = (3.0 * draw(2 * k), 0.5 + 1.5 * draw(2 * k + 1));
        let y = z * x.sin() + 0.01 * draw(900_000 + k);
        text.push_str(&format!("{x:?},{z:?},{y:?},{}\n", ["ice", "grass"][k as usize % 2]));
    }
    text
}

/// A pendulum that swings far, let go at rest, by small steps.
fn pendulum(rows: usize, mut q: f64) -> String {
    let (mut text, mut v) = (String::from("t,q,v\n"), 0.0);
    for k in 0..rows {
        text.push_str(&format!("{:.2},{q:?},{v:?}\n", 0.02 * k as f64));
        for _ in 0..40 {
            (q, v) = (q + 5e-4 * v, v - 5e-4 * (9.0 * q.sin() + 0.4 * v));
        }
    }
    text
}

fn folder(files: &[(&str, String)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    files.iter().for_each(|(name, text)| fs::write(folder.path().join(name), text).expect("a log"));
    folder
}

const SURFACE: [&str; 7] = ["surface.csv", "--predict", "y", "--inputs", "x,z", "--dt", "1"];

fn fit(folder: &Path, method: &str, options: &[&str]) -> Run {
    fleetfoot(folder, &[&["fit", method], &SURFACE[..], options].concat())
}

#[test]
fn curved_surfaces_are_fitted() {
    let folder = folder(&[("surface.csv", surface(1500))]);
    let pwa = |options: &[&str]| {
        let report = fit(folder.path(), "pwa", &[&["--partition", "average", "--json"], options].concat()).ok().json();
        report["candidates"][0]["r2"][0].as_f64().expect("R2")
    };
    let (plane, radial) = (pwa(&[]), pwa(&["--radial", "20", "-o", "pwa.json"]));
    assert!(plane < 0.4 && radial > 0.97, "{plane} {radial}");
    let sindy = |options: &[&str]| {
        let report = fit(folder.path(), "sindy", &[&["--json"], options].concat()).ok().json();
        let equation = report["regions"][0]["equations"][0].clone();
        (equation["r2"].as_f64().expect("R2"), report["candidates"].clone())
    };
    let (plane, _) = sindy(&["--degree", "1"]);
    let (radial, candidates) = sindy(&["--radial", "20", "-o", "sindy.json"]);
    assert!(plane < 0.4 && radial > 0.97, "{plane} {radial}");
    let names: Vec<&str> = candidates.as_array().expect("names").iter().filter_map(|name| name.as_str()).collect();
    assert_eq!((names.len(), names[..4].join(" ").as_str(), names[22]), (23, "1 x z radial1", "radial20"));
    for (file, method) in [("pwa.json", "pwa average"), ("sindy.json", "sindy")] {
        let model: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(folder.path().join(file)).expect("a model")).expect("JSON");
        let model = &model["model"];
        assert!(model["method"].as_str().expect("a method").starts_with(method));
        assert_eq!(model["libraries"][0], serde_json::json!(["x", "z"]));
        let latent = &model["latents"][0];
        assert_eq!(latent["radial"]["centres"].as_array().map(Vec::len), Some(20));
        assert_eq!(latent["radial"]["weights"][0].as_array().map(Vec::len), Some(20));
        assert!(latent["radial"]["width"].as_f64().is_some_and(|width| width > 0.3 && width < 1.5));
        // The same number on other rows, and on these.
        let scored = fleetfoot(folder.path(), &["score", file, "surface.csv", "--json"]).ok().json();
        let r2 = scored["targets"][0]["r2"].as_f64().unwrap_or_else(|| panic!("{scored}"));
        assert!((r2 - radial).abs() < 0.02, "{r2} {radial}");
        let shown = fleetfoot(folder.path(), &["show", file]).ok().out;
        assert!(shown.contains("radial1 to radial20: exp(-|(u - c)/s|^2/(2*w^2)) of u = (x, z)"), "{shown}");
    }
}

#[test]
fn regions_have_their_weights_on_any_threads() {
    let folder = folder(&[("surface.csv", surface(1200))]);
    for (method, more) in [("pwa", "-p"), ("sindy", "--partition")] {
        let mut files = Vec::new();
        for threads in ["1", "3"] {
            let file = format!("{method}{threads}.json");
            let options = [more, "kmeans:2", "--partition-on", "x", "--radial", "9", "--threads", threads, "-o", &file];
            fit(folder.path(), method, &options).ok();
            files.push(fs::read(folder.path().join(&file)).expect("a model"));
        }
        assert!(files[0] == files[1], "{method}: the bytes of a model depend on threads");
        let model: serde_json::Value = serde_json::from_slice(&files[0]).expect("JSON");
        let radial = &model["model"]["latents"][0]["radial"];
        assert_eq!(radial["weights"].as_array().map(Vec::len), Some(2));
        assert_ne!(radial["weights"][0], radial["weights"][1]);
    }
}

#[test]
fn from_logs_to_rollouts_and_to_code() {
    let logs = [("run0.csv", 2.6), ("run1.csv", -2.2), ("run2.csv", 1.5), ("run3.csv", 2.0)];
    let folder = folder(&logs.map(|(name, q)| (name, pendulum(400, q))));
    let run = |arguments: &[&str]| fleetfoot(folder.path(), arguments).ok();
    let fit = ["fit", "pwa", "run0.csv", "run1.csv", "run2.csv", "--states", "q,v", "-p", "average"];
    run(&[&fit[..], &["-o", "line.json"]].concat());
    run(&[&fit[..], &["--radial", "20", "-o", "radial.json"]].concat());
    let simulated = |model: &str| {
        let report = run(&["rollout", model, "run3.csv", "--horizon", "100", "--json"]).json();
        report["model"]["summary"]["average"]["value"].as_f64().expect("an error")
    };
    let (line, radial) = (simulated("line.json"), simulated("radial.json"));
    assert!(radial < 0.5 * line, "{radial} {line}");
    for to in ["c", "rust", "python", "latex", "npz"] {
        run(&["export", "radial.json", "--to", to, "--prefix", "robot", "-o", "code"]);
    }
    let code = folder.path().join("code");
    let source = fs::read_to_string(code.join("robot.c")).expect("C");
    // Centres are a table, and the exponential stands in loops: of the right sides, and of their Jacobian.
    assert!(source.contains("Centres of the radial functions"), "{source}");
    let exponentials = source.matches("exp(").count();
    assert!(exponentials <= 4, "{exponentials} exponentials\n{source}");
    let tex = fs::read_to_string(code.join("robot.tex")).expect("LaTeX");
    assert!(tex.contains("radial1 to radial20"), "{tex}");
    if Command::new("cc").arg("--version").output().is_err() {
        eprintln!("no `cc` on this machine: exported code is not compiled");
        return;
    }
    let cc = Command::new("cc")
        .current_dir(&code)
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "robot.c", "robot_test.c", "-o", "robot", "-lm"])
        .output()
        .expect("cc");
    assert!(cc.status.success(), "{}", String::from_utf8_lossy(&cc.stderr));
    assert!(Command::new(code.join("robot")).output().expect("the test").status.success());
}

#[test]
fn impossible_radial_functions_are_refused() {
    let folder = folder(&[("surface.csv", surface(60)), ("run.csv", pendulum(300, 1.0))]);
    for method in ["pwa", "sindy"] {
        let attempt = |options: &[&str]| fit(folder.path(), method, options);
        attempt(&["--radial", "0"]).fails(&["[library] radial = 0 (--radial 0)", "from 1 to 2000"]);
        attempt(&["--radial", "2001"]).fails(&["--radial 2001", "from 1 to 2000"]);
        attempt(&["--radial", "80"]).fails(&["--radial 80", "60 complete rows", "give a smaller number"]);
        let text =
            ["fit", method, "surface.csv", "--predict", "y", "--inputs", "x,ground", "--dt", "1", "--radial", "5"];
        fleetfoot(folder.path(), &text).fails(&["ground", "text"]);
    }
    let states = ["run.csv", "--states", "q,v", "--radial", "5"];
    fleetfoot(folder.path(), &[&["fit", "sparse"], &states[..]].concat())
        .fails(&["`fit sparse` has no radial functions", "`fit pwa` or `fit sindy`"]);
    let narx = ["fit", "narx", "run.csv", "--outputs", "q", "--radial", "5"];
    fleetfoot(folder.path(), &narx).fails(&["`fit narx` has no radial functions"]);
    fs::write(folder.path().join("r.toml"), "[states]\nq = {}\nv = {}\n[library]\nradial = 5\n").unwrap();
    fleetfoot(folder.path(), &["scan", "-c", "r.toml", "run.csv", "-o", "run.stats"])
        .fails(&["`scan` has no radial functions"]);
    let plain = ["scan", "run.csv", "--states", "q,v", "-o", "run.stats"];
    fleetfoot(folder.path(), &plain).ok();
    for method in ["pwa", "sindy"] {
        fleetfoot(folder.path(), &["fit", method, "run.stats", "--radial", "5"]).fails(&[
            "--radial 5",
            "computed from rows, which a statistic lacks",
            "give the logs",
        ]);
    }
}

/// A radial function has no unit, so that its coefficient has that of the left side.
#[test]
fn weights_have_units_of_the_left_side() {
    let recipe = "[states]\nq = { unit = \"rad\" }\nv = { unit = \"rad/s\" }\n[library]\nradial = 8\n";
    let folder = folder(&[("run.csv", pendulum(400, 2.6)), ("r.toml", recipe.into())]);
    let fit = ["fit", "sindy", "-c", "r.toml", "run.csv", "--smooth-states", "off", "--json"];
    let report = fleetfoot(folder.path(), &fit).ok().json();
    let terms = report["regions"][0]["equations"][1]["terms"].as_array().expect("terms").clone();
    let of = |term: &serde_json::Value| term["function"].as_str().is_some_and(|name| name.starts_with("radial"));
    let radial: Vec<_> = terms.iter().filter(|term| of(term)).collect();
    assert!(!radial.is_empty() && radial.iter().all(|term| term["unit"] == "rad/s^2"), "{terms:?}");
}
