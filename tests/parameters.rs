//! `fit parameters`: numbers inside given equations, with intervals; the model that is written runs like any other.

use std::fs;

use crate::runner::*;

/// x' = v, v' = -k x - c v + g u with k = 4, c = 0.6, g = 2, by Runge-Kutta steps with held inputs. It is measured with
/// noise of deviation 0.01 and pushed by one of so much a row.
fn spring(rows: u32, seed: u32, pushed: f64) -> String {
    let (mut z, mut state, mut text) = ([1.0, 0.0], 12_345 + 977 * seed, String::from("t,x,v,u\n"));
    let mut noise = || {
        let mut uniform = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(u32::MAX)
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    };
    for k in 0..rows {
        let u = (0.9 * f64::from(k) * 0.05 + f64::from(seed)).sin().signum();
        text.push_str(&format!("{:.2},{},{},{u}\n", f64::from(k) * 0.05, z[0] + 0.01 * noise(), z[1] + 0.01 * noise()));
        let slope = |z: [f64; 2]| [z[1], -4.0 * z[0] - 0.6 * z[1] + 2.0 * u];
        let moved = |f: [f64; 2], h: f64| [z[0] + h * f[0], z[1] + h * f[1]];
        let one = slope(z);
        let two = slope(moved(one, 0.025));
        let three = slope(moved(two, 0.025));
        let four = slope(moved(three, 0.05));
        (0..2).for_each(|i| z[i] += 0.05 / 6.0 * (one[i] + 2.0 * two[i] + 2.0 * three[i] + four[i]));
        if pushed > 0.0 {
            z[1] += pushed * noise();
        }
    }
    text
}

const RECIPE: &str = r#"
[states]
x = { known = "v" }
v = { known = "-k*x - c*v + g*u" }
[inputs]
u = "u"
[time]
column = "t"
[parameters]
k = { initial = 3.0, unit = "1/s^2" }
c = { initial = 0.3, bounds = [0, 5] }
g = { initial = 1.0 }
"#;

fn folder(recipe: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for seed in 0..5 {
        fs::write(folder.path().join(format!("run{seed}.csv")), spring(300, seed, 0.0)).expect("a log");
    }
    fs::write(folder.path().join("robot.toml"), recipe).expect("a recipe");
    folder
}

const LOGS: [&str; 5] = ["run0.csv", "run1.csv", "run2.csv", "run3.csv", "run4.csv"];

fn fit(folder: &Path, options: &[&str]) -> Run {
    fleetfoot(folder, &[&["fit", "parameters", "-c", "robot.toml"], options, &LOGS[..]].concat())
}

#[test]
fn intervals_contain_the_truth() {
    let folder = folder(RECIPE);
    let output = fit(folder.path(), &["--json", "-o", "spring.json"]).ok();
    let report = output.json();
    for (parameter, truth) in report["parameters"].as_array().unwrap().iter().zip([4.0, 0.6, 2.0]) {
        let [low, high] = [0, 1].map(|end| parameter["interval"][end].as_f64().unwrap());
        assert!(low < truth && truth < high && high - low < 0.1, "{parameter}");
        assert!(parameter["standard_error"].as_f64().unwrap() > 0.0 && parameter["determined"] == true, "{parameter}");
    }
    assert!(report["held_out"]["over_persistence"].as_f64().unwrap() < 0.1 && report["converged"] == true, "{report}");
    assert_eq!((report["segments"].as_u64(), report["confounded"].as_array().unwrap().len()), (Some(5), 0));
    let noise = report["noise"][0]["deviation"].as_f64().unwrap();
    assert!((noise - 0.01).abs() < 1e-3, "{noise}");
    // The model keeps what is known of its parameters, and its recipe makes it again.
    let text = fs::read_to_string(folder.path().join("spring.json")).unwrap();
    let model: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert!(text.contains("parameter_covariance") && text.contains("\"k\""), "{model}");
    let shown = fleetfoot(folder.path(), &["show", "spring.json"]).ok().out;
    assert!(!shown.contains("k*x"), "{shown}");
    fleetfoot(folder.path(), &["score", "spring.json", "run0.csv"]).ok();
    let rolled =
        fleetfoot(folder.path(), &["rollout", "spring.json", "run0.csv", "--horizon", "50", "--method", "rk4"]).ok();
    assert!(rolled.out.contains("better than every baseline"), "{}", rolled.out);
    fleetfoot(folder.path(), &["export", "spring.json", "--to", "python", "-o", "code"]).ok();
    // A flag has the effect of the recipe's entry; segments, fixed and compared states are printed.
    let text = fit(folder.path(), &["--segment", "100", "--compare", "x", "--folds", "0", "--parameter", "g=2"]).ok();
    assert!(
        text.out.contains("15 segments") && text.err.contains("in-sample") && !text.out.contains("Held out"),
        "{}",
        text.out
    );
}

/// An unrecorded push on the speed alone: its gain is recovered, that of the position is small, and the report has
/// both. The truth lies in the intervals.
#[test]
fn process_noise_is_filtered() {
    let folder = folder(&format!("{RECIPE}[estimate]\nmethod = \"filter-error\"\n"));
    for seed in 0..5 {
        fs::write(folder.path().join(format!("run{seed}.csv")), spring(300, seed, 0.02)).expect("a log");
    }
    let report = fit(folder.path(), &["--json"]).ok().json();
    for (parameter, truth) in report["parameters"].as_array().unwrap().iter().zip([4.0, 0.6, 2.0]) {
        let [value, error] = ["value", "standard_error"].map(|key| parameter[key].as_f64().unwrap());
        // Three parameters are beyond three deviations once in a hundred and twenty logs.
        assert!((value - truth).abs() < 3.0 * error && error < 0.05, "{parameter}");
    }
    assert_eq!((report["method"].as_str(), report["converged"].as_bool()), (Some("filter-error"), Some(true)));
    let gains = report["gains"].as_array().unwrap();
    let [x, v] = [0, 1].map(|at| gains[at]["value"].as_f64().unwrap());
    // Of the speed by itself the steady variance of a prediction is p = p r/(p + r) + q: its gain is 0.83 with r = 0.01^2 and q = 0.02^2.
    assert!(
        x < 0.3 && (0.7..0.95).contains(&v) && gains[1]["name"] == "v" && gains[1]["at_bound"] == false,
        "{gains:?}"
    );
    let innovations = |i: usize, j: usize| report["innovations"][i][j].as_f64().unwrap();
    let deviation = report["noise"][1]["deviation"].as_f64().unwrap();
    assert!((innovations(1, 1).sqrt() / deviation - 1.0).abs() < 1e-6 && innovations(0, 1) == innovations(1, 0));
    assert!(report["held_out"]["over_persistence"].as_f64().unwrap() < 1.0, "{report}");
    let text = fit(folder.path(), &["--folds", "0"]).ok().out;
    for words in [
        "filter error: 5 segments",
        "of the innovations: x 0.0",
        "correlation of x and v",
        "Gains, from 0 (output error)",
        "v 0.8",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    // Without process noise a gain ends at 0 and the report explains it; the flag goes before the recipe.
    fs::write(folder.path().join("run0.csv"), spring(300, 0, 0.0)).expect("a log");
    let calm =
        fleetfoot(folder.path(), &["fit", "parameters", "-c", "robot.toml", "run0.csv", "--folds", "0", "--json"]);
    let calm = calm.ok().json();
    let bound = calm["gains"].as_array().unwrap().iter().filter(|gain| gain["at_bound"] == true).count();
    let warnings =
        calm["warnings"].as_array().unwrap().iter().filter(|text| text.as_str().unwrap().contains("at its bound 0"));
    assert!(bound > 0 && warnings.count() == bound, "{calm}");
    let output = fit(folder.path(), &["--folds", "0", "--method", "output-error", "--json"]).ok().json();
    assert!(output["gains"].is_null() && output["method"] == "output-error", "{output}");
}

#[test]
fn undetermined_parameters_are_named() {
    let twice = RECIPE.replace("-k*x", "-k*b*x").replace("[parameters]", "[parameters]\nb = { initial = 1.0 }");
    let folder = folder(&twice);
    let text = fit(folder.path(), &["--folds", "0"]).ok().out;
    assert!(text.contains("do not determine `b`") && text.contains("do not determine `k`"), "{text}");
    let fixed = twice.replace("b = { initial = 1.0 }", "b = { initial = 1.0, fixed = true }");
    fs::write(folder.path().join("robot.toml"), fixed).unwrap();
    let text = fit(folder.path(), &["--folds", "0", "--method", "equation-error"]).ok().out;
    assert!(text.contains("fixed") && !text.contains("do not determine"), "{text}");
}

#[test]
fn impossible_requests_are_refused_with_the_mend() {
    let folder = folder(RECIPE);
    let with = |from: &str, to: &str, options: &[&str], words: &[&str]| {
        fs::write(folder.path().join("robot.toml"), RECIPE.replace(from, to)).unwrap();
        fit(folder.path(), options).fails(words);
    };
    with("v = { known = \"-k*x - c*v + g*u\" }", "v = {}", &[], &["[states] v", "known"]);
    with("+ g*u", "", &[], &["[parameters] g", "no equation"]);
    with("[time]", "[model]\nweight = \"u\"\n[time]", &[], &["weight"]);
    with("k = {", "x = {", &[], &["[parameters] x", "column"]);
    with("", "", &["--compare", "w"], &["compare", "`w`", "state"]);
    with("", "", &["--segment", "1"], &["segment = 1", "two rows"]);
    with("", "", &["--method", "equation-error", "--segment", "50"], &["segment"]);
}

/// A body on an air bearing, `w' = W torque - 0.1 w`, W the inverse of its inertia, measured with noise. About its long
/// axis, tilted from the frame, it is light; about another it is so heavy that the rows hardly determine it.
fn bearing(rows: u32, seed: u64) -> String {
    let mut state = seed;
    let mut noise = || {
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    };
    let mobility = mobility();
    let (mut w, mut text) = ([0.0; 3], String::from("t,wx,wy,wz,tx,ty,tz\n"));
    for row in 0..rows {
        let t = 0.05 * f64::from(row);
        let torque = [(1.3 * t).sin(), (0.9 * t + 1.0).cos(), (2.1 * t).sin()].map(|value| 0.5 * value.signum());
        let measured = w.map(|w| w + 0.3 * noise());
        text.push_str(&format!(
            "{t:.2},{},{},{},{},{},{}\n",
            measured[0], measured[1], measured[2], torque[0], torque[1], torque[2]
        ));
        for _ in 0..100 {
            for i in 0..3 {
                w[i] += 0.0005 * ((0..3).map(|j| mobility[i][j] * torque[j]).sum::<f64>() - 0.1 * w[i]);
            }
        }
    }
    text
}

/// `R diag(2, 1.2, 0.01) R'`, R turns by 0.6 about z and then by 0.5 about x.
fn mobility() -> [[f64; 3]; 3] {
    let ((s, c), (n, m)) = (0.6_f64.sin_cos(), 0.5_f64.sin_cos());
    let turned = [[c, -s, 0.0], [m * s, m * c, -n], [n * s, n * c, m]];
    let size = [2.0, 1.2, 0.01];
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|k| turned[i][k] * size[k] * turned[j][k]).sum()))
}

/// The least eigenvalue of a symmetric matrix of three rows, by bisection on the signs of its leading minors.
fn least(matrix: [[f64; 3]; 3]) -> f64 {
    let definite = |shift: f64| {
        let at = |i: usize, j: usize| matrix[i][j] - if i == j { shift } else { 0.0 };
        let two = at(0, 0) * at(1, 1) - at(0, 1) * at(1, 0);
        let three = at(0, 0) * (at(1, 1) * at(2, 2) - at(1, 2) * at(2, 1))
            - at(0, 1) * (at(1, 0) * at(2, 2) - at(1, 2) * at(2, 0))
            + at(0, 2) * (at(1, 0) * at(2, 1) - at(1, 1) * at(2, 0));
        at(0, 0) > 0.0 && two > 0.0 && three > 0.0
    };
    let (mut low, mut high) = (-100.0, 100.0);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if definite(middle) { low = middle } else { high = middle }
    }
    low
}

const BEARING: &str = r#"
[inputs]
tx = "tx"
ty = "ty"
tz = "tz"
[time]
column = "t"
"#;

#[test]
fn inertias_stay_positive_under_noise() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let states = "[states]\nwx = { known = \"W11*tx + W12*ty + W13*tz - c*wx\" }\nwy = { known = \"W12*tx + W22*ty + W23*tz - c*wy\" }\nwz = { known = \"W13*tx + W23*ty + W33*tz - c*wz\" }\n";
    let open = "[parameters]\nW11 = { initial = 1.0 }\nW22 = { initial = 1.0 }\nW33 = { initial = 1.0 }\nW12 = { initial = 0.0 }\nW13 = { initial = 0.0 }\nW23 = { initial = 0.0 }\nc = { initial = 0.2, bounds = [0.0, 2.0] }\n";
    let kept = "[constraints]\nmobility = { matrix = [[\"W11\"], [\"W12\", \"W22\"], [\"W13\", \"W23\", \"W33\"]], at_least = 0.005 }\n";
    // At the bound the matrix less the bound has rank two: a factor of two columns, without any constraint.
    let factor = states
        .replace("W11", "(0.005 + a^2)")
        .replace("W12", "(a*b)")
        .replace("W13", "(a*d)")
        .replace("W22", "(0.005 + b^2 + e^2)")
        .replace("W23", "(b*d + e*f)")
        .replace("W33", "(0.005 + d^2 + f^2)");
    let turned = "[parameters]\na = { initial = 1.0 }\nb = { initial = 0.2 }\nd = { initial = 0.2 }\ne = { initial = 1.0 }\nf = { initial = 0.5 }\nc = { initial = 0.2, bounds = [0.0, 2.0] }\n";
    let write = |name: &str, text: String| fs::write(path.join(name), text).unwrap();
    write("free.toml", format!("{states}{BEARING}{open}"));
    write("kept.toml", format!("{states}{BEARING}{open}{kept}"));
    write("factor.toml", format!("{factor}{BEARING}{turned}"));
    let run = |recipe: &str, more: &[&str]| {
        let arguments =
            [&["fit", "parameters", "-c", recipe, "body.csv", "-o", "model.json", "--folds=0", "--json"][..], more]
                .concat();
        fleetfoot(path, &arguments).ok().json()
    };
    let value = |report: &serde_json::Value, name: &str| -> f64 {
        let all = report["parameters"].as_array().unwrap();
        all.iter().find(|parameter| parameter["name"] == name).unwrap()["value"].as_f64().unwrap()
    };
    let matrix = |report: &serde_json::Value| -> [[f64; 3]; 3] {
        let of = |i: usize, j: usize| value(report, &format!("W{}{}", i.min(j) + 1, i.max(j) + 1));
        [0, 1, 2].map(|i| [0, 1, 2].map(|j| of(i, j)))
    };
    let away = |estimate: [[f64; 3]; 3]| -> f64 {
        let truth = mobility();
        (0..3).flat_map(|i| (0..3).map(move |j| (i, j))).map(|(i, j)| (estimate[i][j] - truth[i][j]).powi(2)).sum()
    };
    let (mut negative, mut nearer) = (0, 0);
    for seed in 1..7 {
        write("body.csv", bearing(300, seed));
        let free = run("free.toml", &[]);
        let report = run("kept.toml", &[]);
        let bound = least(matrix(&report));
        assert!(bound >= 0.005 - 1e-12 && report["converged"] == true, "{bound} {report}");
        let limit = &report["limits"][0];
        assert!((limit["nearest"].as_f64().unwrap() - (bound - 0.005)).abs() < 1e-9, "{limit}");
        assert!((limit["free_nearest"].as_f64().unwrap() - (least(matrix(&free)) - 0.005)).abs() < 1e-9, "{limit}");
        let noise = |report: &serde_json::Value, key: &str| -> f64 {
            report["noise"].as_array().unwrap().iter().map(|channel| channel[key].as_f64().unwrap().ln()).sum()
        };
        assert!((noise(&report, "free_deviation") - noise(&free, "deviation")).abs() < 1e-9);
        if least(matrix(&free)) >= 0.005 {
            for name in ["W11", "W12", "W33", "c"] {
                assert_eq!(value(&report, name), value(&free, name), "{seed} {name}");
            }
            continue;
        }
        negative += usize::from(least(matrix(&free)) < 0.0);
        nearer += usize::from(away(matrix(&report)) < away(matrix(&free)));
        assert!(noise(&report, "deviation") > noise(&report, "free_deviation") && bound < 0.005 + 1e-6, "{bound}");
        let other = run("factor.toml", &[]);
        let [a, b, d, e, f] = ["a", "b", "d", "e", "f"].map(|name| value(&other, name));
        let expected = [
            ("W11", 0.005 + a * a),
            ("W12", a * b),
            ("W13", a * d),
            ("W22", 0.005 + b * b + e * e),
            ("W23", b * d + e * f),
            ("W33", 0.005 + d * d + f * f),
            ("c", value(&other, "c")),
        ];
        for (name, expected) in expected {
            // Costs are known to 1e-13, places to its root.
            assert!(
                (value(&report, name) - expected).abs() < 1e-5,
                "{seed} {name}: {} {expected}",
                value(&report, name)
            );
        }
    }
    assert!(
        negative >= 2 && 2 * nearer > negative,
        "{negative} of 6 have a negative eigenvalue, {nearer} are nearer with the bound"
    );
    // Row by row, and by filter error.
    for method in ["equation-error", "filter-error"] {
        let report = run("kept.toml", &["--method", method]);
        assert!(least(matrix(&report)) >= 0.005 - 1e-12, "{method}: {report}");
    }
    let text =
        fleetfoot(path, &["fit", "parameters", "-c", "kept.toml", "body.csv", "-o", "text.json", "--folds=3"]).ok().out;
    assert!(text.contains("Without bounds of matrices") && text.contains("mobility"), "{text}");
    for (constraints, parts) in [
        ("a = { matrix = [[\"W11\"], [\"W12\", \"tx\"]], at_least = 0.0 }", &["[constraints] a", "reads columns"][..]),
        ("a = { of = \"W11*W22\", at_least = 0.0 }", &["`W11` is multiplied with `W22`", "two parameters"]),
        ("a = { of = \"tx\", at_least = 0.0 }", &["no parameter is in it"]),
        ("a = { of = \"W11 - W22\", at_least = 0.0 }", &["limit `a`", "strictly"]),
        ("a = { coefficients = { wx = [\"W11\"] }, at_least = 0.0 }", &["[constraints] a coefficients", "`bounds`"]),
    ] {
        write("wrong.toml", format!("{states}{BEARING}{open}[constraints]\n{constraints}\n"));
        fleetfoot(path, &["fit", "parameters", "-c", "wrong.toml", "body.csv", "-o", "wrong.json"]).fails(parts);
    }
}
