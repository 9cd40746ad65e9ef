//! `fit sindy` under constraints: coefficients keep the signs that they must have.

use std::{fmt::Write, fs};

use crate::{runner::*, sindy::*};

/// A damped oscillator, `v' = -4 q - 0.1 v + u`, whose acceleration was recorded 50 ms late: it leads the damping in quarter of a turn, as if it drove.
fn late(path: &Path, runs: usize) -> Vec<String> {
    let mut noise = 5_u64;
    let mut names = Vec::new();
    for run in 0..runs {
        let input = |t: f64| (1.7 * t + run as f64).sin() + 0.6 * (0.9 * t * t.sqrt() + 2.0 * run as f64).cos();
        let (mut q, mut v, dt) = (0.5, 0.0, 0.01);
        let mut rows: Vec<[f64; 4]> = Vec::new();
        for row in 0..900 {
            let t = f64::from(row) * dt;
            rows.push([q, v, input(t), -4.0 * q - 0.1 * v + input(t)]);
            let force = |q: f64, v: f64, t: f64| -4.0 * q - 0.1 * v + input(t);
            // Heun's method.
            let (a, w) = (force(q, v, t), v + dt * force(q, v, t));
            let b = force(q + dt * v, w, t + dt);
            (q, v) = (q + 0.5 * dt * (v + w), v + 0.5 * dt * (a + b));
        }
        let mut text = String::from("t,q,v,u,dv\n");
        for row in 5..900 {
            noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let error = 0.1 * ((noise >> 11) as f64 / (1_u64 << 53) as f64 - 0.5);
            let [q, v, u, _] = rows[row];
            writeln!(text, "{},{q},{v},{u},{}", row as f64 * dt, rows[row - 5][3] + error).unwrap();
        }
        names.push(format!("run{run}.csv"));
        fs::write(path.join(&names[run]), text).unwrap();
    }
    names
}

const LATE: &str = "[states]\nq = { column = \"q\", known = \"v\" }\nv = { column = \"v\", derivative = \"dv\" }\n[inputs]\nu = \"u\"\n[time]\ncolumn = \"t\"\n\
                    [library]\nfunctions = [\"q\", \"v\", \"u\", \"v*abs(v)\", \"q^3\"]\n";
const DAMPED: &str = "[constraints]\ndamping = { coefficients = { v = [\"v\", \"abs(v)*v\"] }, at_most = 0.0 }\n";

/// The conditions of the least squared error where damping does not drive, from the rows of the files.
fn conditions(path: &Path, files: &[String], terms: &[(String, f64)]) {
    let value = |name: &str| terms.iter().find(|(function, _)| function == name).map_or(0.0, |(_, value)| *value);
    let (mut slopes, mut sizes, mut target) = ([0.0; 5], [0.0_f64; 5], 0.0);
    for file in files {
        for line in fs::read_to_string(path.join(file)).unwrap().lines().skip(1) {
            let row: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            let [q, v, u, dv] = [row[1], row[2], row[3], row[4]];
            let functions = [q, v, u, v * v.abs(), q * q * q];
            let names = ["q", "v", "u", "v*abs(v)", "q^3"];
            let left = dv - names.iter().zip(functions).map(|(name, function)| value(name) * function).sum::<f64>();
            for j in 0..5 {
                slopes[j] += functions[j] * left;
                sizes[j] += functions[j] * functions[j];
            }
            target += dv * dv;
        }
    }
    for (j, name) in ["q", "v", "u", "v*abs(v)", "q^3"].into_iter().enumerate() {
        let slope = slopes[j] / (sizes[j] * target).sqrt();
        match value(name) {
            // A coefficient at its bound of zero would lessen the error with the other sign.
            0.0 if name == "v" => assert!(slope > 1e-3, "{name}: {slope}"),
            0.0 => {}
            // Rounding of 7,000 rows, condition 10.
            _ => assert!(slope.abs() < 1e-12, "{name}: {slope}"),
        }
    }
}

#[test]
fn coefficients_keep_their_required_signs() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let files = late(path, 8);
    let logs: Vec<&str> = files.iter().map(String::as_str).collect();
    let with =
        |arguments: &[&'static str]| -> Vec<&str> { arguments.iter().copied().chain(logs.iter().copied()).collect() };
    fs::write(path.join("free.toml"), LATE).unwrap();
    fs::write(path.join("damped.toml"), format!("{LATE}{DAMPED}")).unwrap();
    let terms = |report: &serde_json::Value| equations(report, 0)[0].1.clone();
    let of = |report: &serde_json::Value, name: &str| {
        terms(report).iter().find(|(function, _)| function == name).map_or(0.0, |(_, value)| *value)
    };
    let free = fit(path, &with(&["-c", "free.toml", "-o", "free.json"])).ok().json();
    // 4/s^2 times 50 ms are 0.2/s, of which the damping takes its 0.1/s.
    assert!((of(&free, "v") - 0.1).abs() < 0.03 && free["limits"].is_null(), "{free}");
    let report = fit(path, &with(&["-c", "damped.toml", "-o", "damped.json"])).ok().json();
    assert!(of(&report, "v") == 0.0 && of(&report, "v*abs(v)") <= 0.0 && of(&report, "q") < -3.5, "{report}");
    conditions(path, &files, &terms(&report));
    let equation = |report: &serde_json::Value| report["regions"][0]["equations"][0].clone();
    let (constrained, other) = (equation(&report), equation(&free));
    for (price, plain) in [("free_rms", "rms"), ("free_held_out_rms", "held_out_rms")] {
        assert_eq!(constrained[price], other[plain], "{report}");
        assert!(number(&constrained[plain]) > 1.02 * number(&constrained[price]), "{report}");
    }
    let limits = report["limits"].as_array().unwrap();
    assert_eq!(limits[0]["name"], "damping, v of d(v)/dt");
    assert_eq!((limits[0]["side"].as_str(), number(&limits[0]["nearest"])), (Some("at most"), 0.0));
    assert_eq!(limits[0]["cuts"], 1, "{report}");

    // From one thread, and from the statistic of the logs, by the recipe of the scan.
    fit(path, &with(&["-c", "damped.toml", "-o", "one.json", "--threads", "1"])).ok();
    same(path, "damped.json", "one.json");
    fleetfoot(path, &[&["scan"][..], &with(&["-c", "damped.toml", "-o", "late.stats"])].concat()).ok();
    let again = fit(path, &["late.stats", "-o", "statistic.json"]).ok().json();
    assert_eq!(equation(&again)["terms"], constrained["terms"]);
    // A bound that excludes 0 keeps its term; the bounds are those of every region and member.
    let push = "[constraints]\nspring = { coefficients = { v = [\"q\"] }, at_least = -3.0 }\npush = { coefficients = { v = [\"v\"] }, at_least = -0.3, at_most = -0.1 }\n";
    fs::write(path.join("push.toml"), format!("{LATE}{push}")).unwrap();
    for more in [
        &["--optimizer", "ols"][..],
        &["--optimizer", "ssr"],
        &["--threshold", "0.01"],
        &["--partition", "kmeans:2"],
        &["--ensemble", "chunks:10"],
    ] {
        let arguments = [&["-c", "push.toml", "-o", "push.json"][..], more].concat();
        let all: Vec<&str> = arguments.into_iter().chain(logs.iter().copied()).collect();
        let report = fit(path, &all).ok().json();
        for region in 0..report["regions"].as_array().unwrap().len() {
            let terms = &equations(&report, region)[0].1;
            let value = |name: &str| terms.iter().find(|(function, _)| function == name).map(|(_, value)| *value);
            assert_eq!((value("q"), value("v")), (Some(-3.0), Some(-0.1)), "{more:?}: {terms:?}");
        }
        let term = &equation(&report)["terms"][0];
        assert!(term["function"] == "q" && term["standard_error"].is_null(), "{report}");
    }
    let text =
        fleetfoot(path, &[&["fit", "sindy"][..], &with(&["-c", "damped.toml", "-o", "text.json"])].concat()).ok().out;
    assert!(text.contains("without bounds") && text.contains("damping, v*abs(v) of d(v)/dt  at most 0"), "{text}");

    for (constraints, parts) in [
        ("a = { of = \"v\", at_most = 0.0 }", &["[constraints] a", "fit sparse", "coefficients = { q ="][..]),
        ("a = { coefficients = { v = [\"v\"] } }", &["[constraints] a", "nothing bounds it"]),
        (
            "a = { coefficients = { v = [\"v\"] }, at_least = 1.0 }\nb = { coefficients = { v = [\"v\"] }, at_most = -1.0 }",
            &["[constraints] a and b", "v of d(v)/dt", "at least 1 and at most -1"],
        ),
        (
            "a = { coefficients = { w = [\"v\"] }, at_most = 0.0 }",
            &["no coefficients of `w` are fitted", "there are v"],
        ),
        ("a = { coefficients = { v = [\"v^2\"] }, at_most = 0.0 }", &["`v^2` is no candidate of v", "v*abs(v)"]),
        ("a = { coefficients = { v = [\"v\"] }, at_least = 1.0, at_most = 0.0 }", &["at_least = 1 is not below"]),
        ("a = { coefficients = { v = [\"v\"] }, of = \"v\", at_most = 0.0 }", &["write two constraints"]),
        (
            "a = { coefficients = { v = [\"v\"] }, at_least = 1.0 }\nb = { coefficients = { v = [\"v\"] }, at_most = 0.0 }",
            &["[constraints] a and b", "at least 1 and at most 0"],
        ),
    ] {
        fs::write(path.join("wrong.toml"), format!("{LATE}[constraints]\n{constraints}\n")).unwrap();
        fit(path, &with(&["-c", "wrong.toml", "-o", "wrong.json"])).fails(parts);
    }
    for (more, part) in [
        ("--optimizer=frols", "stlsq, ssr and ols"),
        ("--objective=steps:10", "no bounds"),
        ("--smooth-states=on", "smooth_states = on"),
    ] {
        fit(path, &with(&[more, "-c", "damped.toml", "-o", "wrong.json"])).fails(&["[constraints] damping", part]);
    }
    assert!(!path.join("wrong.json").exists());

    // The same words bound the coefficients of a latent.
    let latents = "[columns]\nq = \"q\"\nv = \"v\"\nu = \"u\"\ndv = \"dv\"\n[time]\ncolumn = \"t\"\n[latents]\nF = { functions = [\"q\", \"v\", \"u\", \"v*abs(v)\", \"q^3\"] }\n[tasks]\na = { target = \"dv\", right = \"F\" }\n";
    fs::write(path.join("latents.toml"), format!("{latents}{}", DAMPED.replace("v = [", "F = ["))).unwrap();
    let sparse = fleetfoot(
        path,
        &[&["fit", "sparse", "--json", "--lambda", "0"][..], &with(&["-c", "latents.toml", "-o", "sparse.json"])]
            .concat(),
    )
    .ok()
    .json();
    let ols = fit(path, &with(&["-c", "damped.toml", "-o", "ols.json", "--optimizer", "ols"])).ok().json();
    for function in sparse["latents"][0]["functions"].as_array().unwrap() {
        let (name, value) = (function["function"].as_str().unwrap(), number(&function["coefficient"]));
        // The interior point's certificate.
        assert!((value - of(&ols, name)).abs() < 1e-7, "{name}: {value} {}", of(&ols, name));
    }
    assert_eq!(sparse["limits"][0]["name"], "damping, v of F");
}
