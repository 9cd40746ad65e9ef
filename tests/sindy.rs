//! `fit sindy` from the command line: logs with known equations give those equations, and the rest of the command runs the models.

use std::{fmt::Write, fs};

use crate::runner::*;

pub(crate) fn fit(folder: &Path, arguments: &[&str]) -> Run {
    let all: Vec<&str> = ["fit", "sindy", "--json"].into_iter().chain(arguments.iter().copied()).collect();
    fleetfoot(folder, &all)
}

pub(crate) fn number(value: &serde_json::Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// `(label, [(function, coefficient)])` of the equations of a region.
pub(crate) fn equations(report: &serde_json::Value, region: usize) -> Vec<(String, Vec<(String, f64)>)> {
    let text = |value: &serde_json::Value| value.as_str().unwrap_or_default().to_owned();
    let terms = |equation: &serde_json::Value| {
        equation["terms"]
            .as_array()
            .unwrap()
            .iter()
            .map(|term| (text(&term["function"]), number(&term["coefficient"])))
            .collect()
    };
    let equations = report["regions"][region]["equations"].as_array().unwrap_or_else(|| panic!("{report}"));
    equations.iter().map(|equation| (text(&equation["label"]), terms(equation))).collect()
}

#[track_caller]
fn check(report: &serde_json::Value, region: usize, expected: &[(&str, &[(&str, f64)])], tolerance: f64) {
    let equations = equations(report, region);
    assert_eq!(equations.len(), expected.len(), "{equations:?}");
    for ((label, terms), (expected_label, expected_terms)) in equations.iter().zip(expected) {
        assert_eq!(label, expected_label);
        let mut terms = terms.clone();
        terms.sort_by(|a, b| a.0.cmp(&b.0));
        let mut expected_sorted = expected_terms.to_vec();
        expected_sorted.sort_by(|a, b| a.0.cmp(b.0));
        let names: Vec<&str> = terms.iter().map(|(function, _)| function.as_str()).collect();
        assert_eq!(names, expected_sorted.iter().map(|(function, _)| *function).collect::<Vec<_>>(), "{label}");
        for ((function, value), (_, exact)) in terms.iter().zip(&expected_sorted) {
            assert!((value - exact).abs() <= tolerance * exact.abs(), "{label}, {function}: {value}, not {exact}");
        }
    }
}

/// A folder with a file `name`.
fn folder(name: &str, text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join(name), text).expect("a file");
    folder
}

/// A trajectory of `x' = f(x)` by the classical Runge-Kutta method.
fn trajectory<const N: usize>(
    f: impl Fn([f64; N]) -> [f64; N],
    start: [f64; N],
    dt: f64,
    rows: usize,
) -> Vec<([f64; N], [f64; N])> {
    const STEPS: usize = 4;
    let h = dt / STEPS as f64;
    let moved = |x: [f64; N], k: [f64; N], h: f64| std::array::from_fn(|i| x[i] + h * k[i]);
    let mut x = start;
    let mut samples = Vec::with_capacity(rows);
    for _ in 0..rows {
        samples.push((x, f(x)));
        for _ in 0..STEPS {
            let a = f(x);
            let b = f(moved(x, a, h / 2.0));
            let c = f(moved(x, b, h / 2.0));
            let d = f(moved(x, c, h));
            x = std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
    }
    samples
}

/// Lorenz's system with its exact derivatives every 0.01 s: `t, x, y, z, dx, dy, dz`.
fn lorenz(rows: usize) -> String {
    lorenz_every(0.01, rows)
}

fn lorenz_every(dt: f64, rows: usize) -> String {
    let f = |[x, y, z]: [f64; 3]| [10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z];
    let mut text = String::from("t,x,y,z,dx,dy,dz\n");
    for (row, ([x, y, z], [dx, dy, dz])) in trajectory(f, [-8.0, 8.0, 27.0], dt, rows).into_iter().enumerate() {
        let _ = writeln!(text, "{},{x},{y},{z},{dx},{dy},{dz}", row as f64 * dt);
    }
    text
}

const EXACT: [&str; 6] = ["--derivative", "x=dx", "--derivative", "y=dy", "--derivative", "z=dz"];
const LORENZ: [(&str, &[(&str, f64)]); 3] = [
    ("d(x)/dt", &[("x", -10.0), ("y", 10.0)]),
    ("d(y)/dt", &[("x", 28.0), ("y", -1.0), ("x*z", -1.0)]),
    ("d(z)/dt", &[("z", -8.0 / 3.0), ("x*y", 1.0)]),
];

fn with<'a>(first: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    first.iter().chain(more).copied().collect()
}

#[test]
fn lorenz_by_every_optimiser() {
    let folder = folder("lorenz.csv", &lorenz(4000));
    let path = folder.path();
    let base = with(&["lorenz.csv", "--states", "x,y,z", "--library", "poly(3)"], &EXACT);
    for (more, tolerance) in [
        (&["--threshold", "0.5"][..], 1e-9),
        (&[], 1e-9),
        (&["--select", "bic"], 1e-9),
        (&["--optimizer", "ssr"], 1e-9),
        (&["--optimizer", "sr3", "--threshold", "0.5"], 1e-6),
    ] {
        let report = fit(path, &with(&base, more)).ok().json();
        check(&report, 0, &LORENZ, tolerance);
        let equation = &report["regions"][0]["equations"][1];
        assert!(number(&equation["r2"]) > 1.0 - 1e-12, "{more:?}: {equation}");
        assert!(equation["terms"].as_array().unwrap().iter().all(|term| number(&term["standard_error"]) < 1e-6));
    }
    // A greedy order takes terms that later ones make superfluous: with exact data these have coefficients of rounding.
    for optimizer in ["frols", "lasso"] {
        let report = fit(path, &with(&base, &["--optimizer", optimizer])).ok().json();
        for ((label, terms), (_, exact)) in equations(&report, 0).iter().zip(LORENZ) {
            for (function, value) in terms {
                let expected = exact.iter().find(|(name, _)| name == function).map_or(0.0, |(_, value)| *value);
                assert!((value - expected).abs() < 1e-9, "{optimizer}, {label}, {function}: {value}");
            }
            assert!(exact.iter().all(|(name, _)| terms.iter().any(|(function, _)| function == name)), "{terms:?}");
        }
    }
}

/// The functions of a signal are in an equation together or not at all; products are separate groups.
#[test]
fn lorenz_by_groups() {
    let folder = folder("lorenz.csv", &lorenz(4000));
    let path = folder.path();
    let base = with(&["lorenz.csv", "--states", "x,y,z", "--library", "poly(2)"], &EXACT);
    let report = fit(path, &with(&base, &["--groups", "signal"])).ok().json();
    assert_eq!(report["optimizer"].as_str().unwrap_or("group-lasso"), "group-lasso", "{report}");
    for ((label, terms), (_, exact)) in equations(&report, 0).iter().zip(LORENZ) {
        let has = |name: &str| terms.iter().any(|(function, _)| function == name);
        assert!(exact.iter().all(|(name, _)| has(name)), "{label}: {terms:?}");
        for signal in ["x", "y", "z"] {
            assert_eq!(has(signal), has(&format!("{signal}^2")), "{label}: {terms:?}");
        }
        for (function, value) in terms {
            let expected = exact.iter().find(|(name, _)| name == function).map_or(0.0, |(_, value)| *value);
            assert!((value - expected).abs() < 1e-8, "{label}, {function}: {value}");
        }
    }
    let sparse = ["--optimizer", "group-lasso", "--l1-ratio", "0.5", "--terms", "4"];
    let report = fit(path, &with(&base, &sparse)).ok().json();
    assert!(equations(&report, 0).iter().all(|(_, terms)| terms.len() <= 4), "{report}");
}

/// Central differences of order 2 are wrong by the square of the step: so are the coefficients, of the right terms.
#[test]
fn lorenz_by_finite_differences() {
    let error = |dt: f64, rows: usize| -> f64 {
        let folder = folder("lorenz.csv", &lorenz_every(dt, rows));
        let mut arguments = vec!["lorenz.csv", "--states", "x,y,z", "--threshold", "0.5", "--library", "poly(3)"];
        arguments.extend(["--derivative", "x=central", "--derivative", "y=central", "--derivative", "z=central"]);
        let report = fit(folder.path(), &arguments);
        let report = report.ok().json();
        check(&report, 0, &LORENZ, 0.05);
        equations(&report, 0)[1]
            .1
            .iter()
            .find(|(name, _)| name == "x")
            .map_or(f64::NAN, |(_, value)| (value - 28.0).abs())
    };
    let ratio = error(0.01, 4000) / error(0.005, 8000);
    assert!((3.5..4.5).contains(&ratio), "{ratio}");
}

/// Functions that explain the error of the differences are no dynamics. Clean states give the true terms at every rate
/// that resolves them, without a threshold.
#[test]
fn terms_ignore_errors_of_differences() {
    for dt in [0.002, 0.01] {
        let folder = folder("lorenz.csv", &lorenz_every(dt, 6000));
        let base = ["lorenz.csv", "--states", "x,y,z", "--library", "poly(3)"];
        for more in [&[][..], &["--select", "cv"], &["--select", "bic"], &["--normalize"]] {
            let report = fit(folder.path(), &with(&base, more)).ok().json();
            check(&report, 0, &LORENZ, 0.06);
        }
    }
}

#[test]
fn models_are_shown_scored_and_run() {
    let folder = folder("lorenz.csv", &lorenz(3000));
    let path = folder.path();
    let base = with(&["lorenz.csv", "--states", "x,y,z", "--threshold", "0.5"], &EXACT);
    fit(path, &with(&base, &["-o", "m.json", "--keep-all"])).ok();
    assert!(fs::read_dir(path).unwrap().any(|file| file.unwrap().file_name() == "m_terms2.json"));
    let shown = fleetfoot(path, &["show", "m.json"]).ok().out;
    for part in ["sindy stlsq", "d(z)/dt = f_z", "f_z = -2.66667*z + 1*x*y"] {
        assert!(shown.contains(part), "{part} is missing from {shown}");
    }
    let scores = fleetfoot(path, &["score", "m.json", "lorenz.csv", "--json"]).ok().json();
    assert!(number(&scores["rows"]) > 2990.0, "{scores}");
    fleetfoot(path, &["predict", "m.json", "lorenz.csv", "-o", "p.parquet"]).ok();
    let rolled = ["rollout", "m.json", "lorenz.csv", "--horizon", "20", "--starts", "5", "--method", "rk4", "--json"];
    fleetfoot(path, &rolled).ok();
    let plan = fit(path, &with(&base, &["--dry-run"])).ok().json();
    assert_eq!((plan["rows"].as_u64(), plan["candidates"].as_u64()), (Some(3000), Some(10)), "{plan}");
    let text = fleetfoot(path, &with(&["fit", "sindy", "--front"], &base)).ok().out;
    for part in ["d(y)/dt = 28*x - 1*y - 1*x*z", "standard error", "held out", "<- chosen"] {
        assert!(text.contains(part), "{part} is missing from {text}");
    }
}

/// `v' = u - 0.5 v - 0.3 v |v|` under an input that wanders, with the output of a lag of it: `t, v, u, dv, w, y`,
/// `w' = 3 lag(u) - 2 w`.
fn driven(rows: usize, tau: f64) -> String {
    let dt = 0.01;
    let (mut v, mut w, mut lagged) = (0.3f64, 0.0f64, None);
    let mut text = String::from("t,v,u,dv,w,dw,y\n");
    for row in 0..rows {
        let t = row as f64 * dt;
        let u = (1.7 * t).sin() + 0.8 * (0.6 * t * t.sqrt()).cos() + if (t / 0.9).fract() < 0.5 { 0.7 } else { -0.4 };
        let filtered = lagged.unwrap_or(u);
        let (dv, dw) = (u - 0.5 * v - 0.3 * v * v.abs(), 3.0 * filtered - 2.0 * w);
        let _ = writeln!(text, "{t},{v},{u},{dv},{w},{dw},{}", 2.0 * u.sin() - v * v);
        v += dt * dv;
        w += dt * dw;
        lagged = Some(filtered + (1.0 - (-dt / tau).exp()) * (u - filtered));
    }
    text
}

#[test]
fn recipes_set_nominal_and_fixed_terms() {
    let folder = folder("driven.csv", &driven(3000, 0.07));
    let path = folder.path();
    let recipe = r#"
[states]
v = { derivative = "dv", nominal = "u - 0.5*v", library = ["poly(1)", "v*abs(v)"], fixed = ["1"] }
w = { derivative = "dw", library = ["identity", "lag1(u, 0.07)"] }
[inputs]
u = "u"
[sindy]
threshold = 0.01
"#;
    fs::write(path.join("r.toml"), recipe).unwrap();
    let report = fit(path, &["-c", "r.toml", "driven.csv", "-o", "m.json"]).ok().json();
    let terms = equations(&report, 0);
    let names = |at: usize| terms[at].1.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>();
    assert_eq!((names(0), names(1)), (vec!["1", "v*abs(v)"], vec!["w", "lag1(u, 0.07)"]));
    assert!(terms[0].1[0].1.abs() < 1e-9 && (terms[0].1[1].1 + 0.3).abs() < 1e-9, "{terms:?}");
    assert!((terms[1].1[0].1 + 2.0).abs() < 1e-9 && (terms[1].1[1].1 - 3.0).abs() < 1e-9, "{terms:?}");
    let first = &report["regions"][0]["equations"][0];
    assert!(first["right"].as_str().unwrap().starts_with("u - 0.5*v"), "{first}");
    assert_eq!(first["terms"][0]["fixed"], true);
    // The filter goes along with the model.
    let scores = fleetfoot(path, &["score", "m.json", "driven.csv", "--json"]).ok().json();
    for output in scores["targets"].as_array().or(scores["outputs"].as_array()).into_iter().flatten() {
        assert!(output["r2"].as_f64().is_none_or(|r2| r2 > 0.999_999), "{scores}");
    }
    let rolled = fleetfoot(path, &["rollout", "m.json", "driven.csv", "--horizon", "50", "--starts", "5", "--json"]);
    rolled.ok();
    fleetfoot(path, &["predict", "m.json", "driven.csv", "-o", "p.parquet"]).ok();
}

/// On the circle x^2 + y^2 is the constant, and a fold's share of the only term is as often above that of all rows as
/// below it.
#[test]
fn a_circle_has_one_term_an_equation() {
    let mut text = String::from("t,x,y\n");
    for row in 0..2000 {
        let t = f64::from(row) * 0.01;
        let _ = writeln!(text, "{t},{},{}", t.cos(), -t.sin());
    }
    let folder = folder("circle.csv", &text);
    for select in ["one-se", "cv", "bic"] {
        let report = fit(folder.path(), &["circle.csv", "--states", "x,y", "--select", select]).ok().json();
        // Central differences of a sine at 10 ms are low by 1.7e-5.
        check(&report, 0, &[("d(x)/dt", &[("y", 1.0)]), ("d(y)/dt", &[("x", -1.0)])], 2e-5);
    }
}

#[test]
fn parameters_inside_expressions_are_estimated() {
    let folder = folder("driven.csv", &driven(4000, 0.07));
    let path = folder.path();
    let report = fit(
        path,
        &[
            "driven.csv",
            "--states",
            "w",
            "--inputs",
            "u",
            "--derivative",
            "w=dw",
            "--library",
            "w,lag1(u, tau)",
            "--parameter",
            "tau=0.03 in 0.01..0.3",
            "--threshold",
            "0.01",
            "-o",
            "m.json",
        ],
    )
    .ok()
    .json();
    let tau = &report["parameters"][0];
    assert!((number(&tau["value"]) - 0.07).abs() < 1e-6, "{tau}");
    let terms = &equations(&report, 0)[0].1;
    assert!(terms.len() == 2 && (terms[0].1 + 2.0).abs() < 1e-5 && (terms[1].1 - 3.0).abs() < 1e-5, "{terms:?}");
    fleetfoot(path, &["score", "m.json", "driven.csv"]).ok();
}

#[test]
fn discrete_time_and_plain_regression() {
    let mut text = String::from("t,x,u\n");
    let mut x = 0.5f64;
    for row in 0..800 {
        // Kept above the point below which the map runs away.
        let u = 0.5 + 0.5 * (0.37 * f64::from(row)).sin() + 0.3 * (0.11 * f64::from(row)).cos();
        let _ = writeln!(text, "{},{x},{u}", f64::from(row) * 0.1);
        x = 0.8 * x - 0.1 * x * x + 0.4 * u;
    }
    let first = folder("map.csv", &text);
    let base = ["map.csv", "--states", "x", "--inputs", "u", "--threshold", "0.01"];
    let next = fit(first.path(), &with(&base, &["--predict", "next"])).ok().json();
    check(&next, 0, &[("next(x)", &[("x", 0.8), ("u", 0.4), ("x^2", -0.1)])], 1e-9);
    let delta = fit(first.path(), &with(&base, &["--predict", "delta"])).ok().json();
    check(&delta, 0, &[("delta(x)", &[("x", -0.2), ("u", 0.4), ("x^2", -0.1)])], 1e-9);
    fleetfoot(first.path(), &["rollout", "model.json", "map.csv", "--horizon", "20", "--starts", "3"]).ok();
    let second = folder("driven.csv", &driven(1500, 0.07));
    let arguments =
        ["driven.csv", "--inputs", "u,v", "--predict", "y", "--library", "poly(2),sin", "--threshold", "0.01"];
    let regression = fit(second.path(), &arguments).ok().json();
    check(&regression, 0, &[("y", &[("v^2", -1.0), ("sin(u)", 2.0)])], 1e-8);
}

#[test]
fn equations_in_regions() {
    let folder = folder("robot.csv", &robot_csv(3000, 0.0));
    let arguments = [
        "robot.csv",
        "--alias",
        "v=`v [m/s]`",
        "--states",
        "v",
        "--inputs",
        "u",
        "--derivative",
        "v=dv",
        // In a region that saw little of v, a ridge would keep terms that no other region needs.
        "--ridge",
        "0",
        "--threshold",
        "0.1",
        "--partition",
        "labels:mode",
    ];
    let report = fit(folder.path(), &arguments).ok().json();
    let grip = [("d(v)/dt", &[("v", -2.0), ("u", 3.0)][..])];
    let slip = [("d(v)/dt", &[("1", 1.0), ("v", -5.0), ("u", 2.0)][..])];
    assert_eq!(report["regions"][0]["name"], "grip", "{report}");
    check(&report, 0, &grip, 1e-8);
    check(&report, 1, &slip, 1e-8);
    fleetfoot(folder.path(), &["score", "model.json", "robot.csv"]).ok();
    let clustered = fit(folder.path(), &with(&arguments[..13], &["--partition", "kmeans:2", "--folds", "5"]));
    assert_eq!(clustered.ok().json()["regions"].as_array().map(Vec::len), Some(2));
}

#[test]
fn ensembles_seeds_and_threads() {
    let folder = folder("lorenz.csv", &lorenz(2000));
    let path = folder.path();
    let base = with(&["lorenz.csv", "--states", "x,y,z", "--threshold", "0.5"], &EXACT);
    let bytes = |more: &[&str], name: &str| {
        fit(path, &with(&with(&base, more), &["-o", name])).ok();
        fs::read(path.join(name)).unwrap()
    };
    let single = bytes(&["--ensemble", "chunks:20", "--threads", "1"], "a.json");
    assert!(single == bytes(&["--ensemble", "chunks:20", "--threads", "2"], "b.json"), "threads change the model");
    let auto = ["lorenz.csv", "--states", "x,y,z", "--threads"];
    let of = |threads: &str, name: &str| {
        fit(path, &with(&auto, &[threads, "-o", name])).ok();
        fs::read(path.join(name)).unwrap()
    };
    assert!(of("1", "c.json") == of("2", "d.json"), "threads change the model");
    let report = fit(path, &with(&base, &["--ensemble", "chunks:20", "--seed", "3"])).ok().json();
    check(&report, 0, &LORENZ, 1e-8);
    let inclusion = report["regions"][0]["equations"][0]["inclusion"].as_array().unwrap();
    assert!(
        inclusion.iter().all(|share| (0.0..=1.0).contains(&number(share))) && inclusion.len() == 10,
        "{inclusion:?}"
    );
    let drawn = |seed: &str| {
        let more = ["--ensemble", "library:20", "--seed", seed];
        fit(path, &with(&base, &more)).ok().json()["regions"][0]["equations"][0]["inclusion"].clone()
    };
    assert_eq!(drawn("1"), drawn("1"));
    assert_ne!(drawn("1"), drawn("2"), "another seed leaves other terms out");
}

#[test]
fn bad_input_is_explained() {
    let folder = folder("lorenz.csv", &lorenz(300));
    let path = folder.path();
    let states = ["lorenz.csv", "--states", "x,y,z"];
    for (arguments, words) in [
        (with(&["lorenz.csv"], &[]), &["no states", "--states"][..]),
        (with(&["lorenz.csv", "--states", "x,yy"], &[]), &["[states] yy", "no column"]),
        (with(&states, &["--library", "poly(3"]), &["[library] functions", "poly(3"]),
        (with(&states, &["--library", "x*q"]), &["q"]),
        (with(&states, &["--library", "poly(60)"]), &["39711", "10000", "fewer candidates"]),
        (with(&states, &["--library", "poly(12)"]), &["300", "455", "fewer candidates"]),
        (with(&states, &["--threshold", "-1"]), &["threshold = -1", "zero or more"]),
        (with(&states, &["--threshold", "big"]), &["threshold = big", "auto"]),
        (with(&states, &["--optimizer", "frols", "--threshold", "0.1"]), &["frols has no threshold"]),
        (with(&states, &["--ensemble", "rows:10"]), &["ensemble = rows:10", "chunks"]),
        (with(&states, &["--groups", "term"]), &["groups = term", "fit sparse"]),
        (with(&states, &["--groups", "legs=q"]), &["groups legs", "`q`"]),
        (with(&states, &["--l1-ratio", "0.5"]), &["l1_ratio", "group-lasso"]),
        (with(&states, &["--nominal", "q=1"]), &["`q` is not a state"]),
        (with(&states, &["--nominal", "x=y*w"]), &["[states] x nominal", "w"]),
        (with(&states, &["--fixed", "x=w^2"]), &["[states] x fixed", "w"]),
        (with(&states, &["--parameter", "tau=fast"]), &["--parameter tau=fast", "0.01..0.3"]),
        (with(&states, &["--parameter", "tau=1"]), &["[parameters] tau", "no library item"]),
        (with(&states, &["--parameter", "x=1"]), &["[parameters] x", "rename"]),
        (with(&states, &["--partition", "kmeans:2,3"]), &["one partition"]),
        (with(&states, &["--partition", "null"]), &["null model"]),
        (with(&states, &["--weight", "0*x"]), &["no rows"]),
        (with(&states, &["-o", "lorenz.csv"]), &["one of the inputs"]),
    ] {
        let output = fit(path, &arguments);
        assert_eq!(output.code, 1, "{arguments:?}: {}{}", output.out, output.err);
        output.fails(words);
    }
    let output = fit(path, &with(&states, &["--optimizer", "magic"]));
    assert!(output.code == 2 && output.err.contains("magic") && output.err.contains("stlsq"), "{}", output.err);
    fs::write(path.join("r.toml"), "[sindy]\noptimizer = \"magic\"\n").unwrap();
    fit(path, &with(&states, &["-c", "r.toml"])).fails(&["r.toml", "optimizer = \"magic\"", "`stlsq`"]);
    fs::write(path.join("r.toml"), "[states]\nx = { known = \"y\", nominal = \"z\" }\ny = {}\n").unwrap();
    fit(path, &["-c", "r.toml", "lorenz.csv"]).fails(&["[states] x", "`known`", "nominal"]);
    fs::write(path.join("r.toml"), "[states]\nx = { libary = [\"sin\"] }\n").unwrap();
    fit(path, &["-c", "r.toml", "lorenz.csv"]).fails(&["r.toml", "libary"]);
}

#[test]
fn units_are_checked_and_printed() {
    let mut text = String::from("t,x [m],v [m/s],a [m/s^2]\n");
    for row in 0..2000 {
        let t = f64::from(row) * 0.01;
        let (x, v) = ((1.3 * t).sin(), (0.7 * t).cos());
        let _ = writeln!(text, "{t},{x},{v},{}", -2.0 * x - 0.5 * v + 9.0);
    }
    let folder = folder("log.csv", &text);
    let aliases = ["--alias", "x=`x [m]`", "--alias", "v=`v [m/s]`", "--alias", "a=`a [m/s^2]`"];
    let base = with(&["log.csv", "--states", "v", "--inputs", "x", "--derivative", "v=a"], &aliases);
    let report = fit(folder.path(), &with(&base, &["--library", "poly(1)"])).ok().json();
    let units: Vec<_> = report["regions"][0]["equations"][0]["terms"]
        .as_array()
        .unwrap()
        .iter()
        .map(|term| (term["function"].as_str().unwrap().to_owned(), term["unit"].as_str().unwrap_or("?").to_owned()))
        .collect();
    let unit = |name: &str| units.iter().find(|(function, _)| function == name).map(|(_, unit)| unit.as_str());
    for (name, expected) in [("1", "m/s^2"), ("v", "1/s"), ("x", "1/s^2")] {
        let text = unit(name).unwrap_or_else(|| panic!("{units:?}"));
        let same = |text: &str| fleetfoot::library::Unit::parse(text).expect("a unit");
        assert_eq!(same(text), same(expected), "{name}");
    }
    let output = fit(folder.path(), &with(&base, &["--library", "poly(1),sin(x),x - v"])).ok();
    assert!(output.err.contains("sin(x)") && output.err.contains("x - v"), "{}", output.err);
}

/// A collision in a few rows holds most of the variance: a note names the rows to which the fit is fitted, and without
/// them there is none.
#[test]
fn rows_with_most_variance_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::from("t,v,u\n");
    let (mut v, dt) = (0.0_f64, 0.01);
    for row in 0..5000 {
        let (t, u) = (f64::from(row) * dt, (f64::from(row) * 0.013).sin());
        text.push_str(&format!("{t},{v},{u}\n"));
        v += dt * (2.0 * u - v);
        if row == 3210 {
            v -= 40.0;
        }
        if row == 3214 {
            v += 40.0;
        }
    }
    fs::write(folder.path().join("log.csv"), text).unwrap();
    let fit = |more: &[&str]| {
        let fixed = ["fit", "sindy", "--states", "v", "--inputs", "u", "log.csv", "-o", "m.json"];
        fleetfoot(folder.path(), &[&fixed, more].concat()).ok()
    };
    let words = "of its variance (the heaviest: from row ";
    let notes = fit(&[]).err;
    let at = notes.find(words).unwrap_or_else(|| panic!("{notes}")) + words.len();
    let row: usize = notes[at..].split(' ').next().and_then(|word| word.parse().ok()).expect("a row");
    assert!(row <= 3211 && row + 100 > 3211, "{notes}");
    assert!(notes.contains("d(v)/dt: 0.") && notes.contains("of log.csv on") && notes.contains("--where"), "{notes}");
    let without = fit(&["--where", "abs(v) < 20"]);
    assert!(!without.err.contains(words), "{}", without.err);
    assert!(without.out.contains("d(v)/dt = -0.99") && without.out.contains("*v + 2.000"), "{}", without.out);
}

/// Before a long fit a note has its duration, and a remedy that shortens it; `--dry-run` has both as well.
#[test]
fn long_fits_say_so_beforehand() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("log.csv"), robot_csv(3000, 0.3)).unwrap();
    let plain = "[columns]\nv = \"v [m/s]\"\n[states]\nx = {}\nv = {}\n[inputs]\nu = \"u\"\n";
    fs::write(path.join("plain.toml"), plain).unwrap();
    let functions: Vec<String> = (1..1500).map(|k| format!("\"sin({k}*x)\"")).collect();
    let tasks = format!(
        "[latents]\nf = {{ functions = [{}] }}\n[tasks]\nfirst = {{ target = \"v\", right = \"f\" }}\n",
        functions.join(", ")
    );
    fs::write(path.join("tasks.toml"), format!("{plain}{tasks}")).unwrap();
    let sindy =
        |library: &'static str| ["fit", "sindy", "-c", "plain.toml", "log.csv", "--library", library, "-o", "m.json"];
    let dry = |command: &[&str]| fleetfoot(path, &[command, &["--dry-run", "--json"]].concat()).ok();
    let long = [
        dry(&sindy("fourier(600)")),
        dry(&["fit", "pwa", "-c", "plain.toml", "log.csv", "--lags", "400", "-p", "average,kmeans:20", "-o", "m.json"]),
        dry(&["fit", "sparse", "-c", "tasks.toml", "log.csv", "-o", "m.json"]),
    ];
    for output in &long {
        assert!(
            output.err.contains("note: this takes about ") && output.err.contains("fewer folds (--folds 2)"),
            "{}",
            output.err
        );
        assert!(output.json()["operations"].as_f64().unwrap() > 1e10, "{}", output.out);
    }
    let short = dry(&sindy("fourier(3)"));
    assert!(!short.err.contains("this takes"), "{}", short.err);
    assert!(short.json()["operations"].as_f64().unwrap() < 1e8, "{}", short.out);
    // The count is the same in every run, and a note in none that is quiet.
    let quiet = fleetfoot(path, &[&sindy("fourier(600)")[..], &["--dry-run", "--json", "--quiet"]].concat()).ok();
    assert_eq!((quiet.out.as_str(), quiet.err.as_str()), (long[0].out.as_str(), ""));
    // The fit prints the note before its work; the test does not wait for its end.
    let mut fit = Command::new(env!("CARGO_BIN_EXE_fleetfoot"))
        .current_dir(path)
        .args(sindy("fourier(60)"))
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let lines = std::io::BufRead::lines(std::io::BufReader::new(fit.stderr.take().unwrap()));
    let note = lines.map_while(Result::ok).find(|line| line.contains("this takes about "));
    fit.kill().unwrap();
    fit.wait().unwrap();
    assert!(note.is_some_and(|note| note.contains("fewer functions in the library")));
}
