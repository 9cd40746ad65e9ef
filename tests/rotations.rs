//! Rotations among the states of a recipe, from the log to the code. The log is of a rigid body without torques, with
//! its attitude as a quaternion of any sign.

use std::{f64::consts::TAU, fmt::Write as _, fs};

use crate::{outside::python, runner::*};

/// Moments of inertia.
const J: [f64; 3] = [1.0, 2.0, 3.0];
/// Seconds of a row.
const DT: f64 = 0.01;

/// Attitude w, x, y, z and rates of a rigid body: Euler's equations and the kinematics, by four steps of Runge and Kutta a row.
fn body(rows: usize, seed: u64) -> Vec<[f64; 7]> {
    let slopes = |s: &[f64; 7]| {
        let [w, x, y, z, a, b, c] = *s;
        [
            -0.5 * (x * a + y * b + z * c),
            0.5 * (w * a + y * c - z * b),
            0.5 * (w * b + z * a - x * c),
            0.5 * (w * c + x * b - y * a),
            (J[1] - J[2]) / J[0] * b * c,
            (J[2] - J[0]) / J[1] * c * a,
            (J[0] - J[1]) / J[2] * a * b,
        ]
    };
    let moved = |s: &[f64; 7], f: &[f64; 7], h: f64| -> [f64; 7] { std::array::from_fn(|i| s[i] + h * f[i]) };
    let shift = 1.0 + 0.7 * seed as f64;
    let mut s = [0.8, 0.36, -0.48, 0.0, 1.4 * shift.sin(), -1.1, 1.2 * shift.cos()];
    let mut trajectory = vec![s];
    let h = 0.25 * DT;
    while trajectory.len() < rows {
        for _ in 0..4 {
            let one = slopes(&s);
            let two = slopes(&moved(&s, &one, 0.5 * h));
            let three = slopes(&moved(&s, &two, 0.5 * h));
            let four = slopes(&moved(&s, &three, h));
            s = std::array::from_fn(|i| s[i] + h / 6.0 * (one[i] + 2.0 * two[i] + 2.0 * three[i] + four[i]));
        }
        trajectory.push(s);
    }
    trajectory
}

/// Any signs.
fn sign(row: usize, seed: u64) -> f64 {
    let hashed =
        (row as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(seed.wrapping_mul(0xD1B5_4A32_D192_ED03));
    if (hashed >> 40) & 1 == 0 { 1.0 } else { -1.0 }
}

/// The log with x first and w last, as robots write it; `flips`: of any sign, and a thousandth longer than it should be.
fn log(rows: &[[f64; 7]], seed: u64, flips: bool) -> String {
    let mut text = String::from("t,q.x,q.y,q.z,q.w,wx,wy,wz\n");
    for (row, [w, x, y, z, a, b, c]) in rows.iter().enumerate() {
        let f = if flips { sign(row, seed) } else { 1.0 };
        let _ = writeln!(text, "{},{},{},{},{},{a},{b},{c}", row as f64 * DT, f * x, f * y, f * z, f * w);
    }
    text
}

/// The same as rotation vectors; `flips`: every third one the other way round.
fn vector_log(rows: &[[f64; 7]], flips: bool) -> String {
    let mut text = String::from("t,rx,ry,rz,wx,wy,wz\n");
    for (row, [w, x, y, z, a, b, c]) in rows.iter().enumerate() {
        let sine = (x * x + y * y + z * z).sqrt();
        let mut angle = 2.0 * sine.atan2(*w);
        if flips && row % 3 == 0 {
            angle -= TAU;
        }
        let [x, y, z] = [x, y, z].map(|part| angle * part / sine);
        let _ = writeln!(text, "{},{x},{y},{z},{a},{b},{c}", row as f64 * DT);
    }
    text
}

const RECIPE: &str = r#"
[states]
wx = { unit = "rad/s" }
wy = { unit = "rad/s" }
wz = { unit = "rad/s" }
[states.attitude]
kind = "quaternion"
columns = ["q.x", "q.y", "q.z", "q.w"]
rate = ["wx", "wy", "wz"]
[library]
functions = ["poly(2)"]
"#;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: String, text: String| fs::write(folder.path().join(name), text).unwrap();
    for seed in 0..3 {
        let rows = body(600, seed);
        write(format!("plain{seed}.csv"), log(&rows, seed, false));
        write(format!("flips{seed}.csv"), log(&rows, seed, true));
        write(format!("vector{seed}.csv"), vector_log(&rows, false));
        write(format!("turned{seed}.csv"), vector_log(&rows, true));
    }
    write("body.toml".into(), RECIPE.into());
    let vector = RECIPE.replace("quaternion", "axis-angle");
    write("vector.toml".into(), vector.replace(r#""q.x", "q.y", "q.z", "q.w""#, r#""rx", "ry", "rz""#));
    folder
}

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    match value {
        serde_json::Value::Array(all) => all.iter().flat_map(numbers).collect(),
        serde_json::Value::Number(number) => vec![number.as_f64().unwrap()],
        _ => Vec::new(),
    }
}

/// The fit gives Euler's equations, for any signs in the log. Rollouts have one error of the attitude, in radians, and
/// it is as small as that of the rates.
#[test]
fn quaternions_of_any_sign_give_euler_equations() {
    let folder = folder();
    let path = folder.path();
    let fit = |recipe: &str, logs: &str, model: &str| {
        let logs = [0, 1].map(|seed| format!("{logs}{seed}.csv"));
        let arguments = ["fit", "sindy", "-c", recipe, &logs[0], &logs[1], "-o", model, "--json"];
        fleetfoot(path, &arguments).ok().json()
    };
    let rolled = |model: &str, log: &str| {
        let arguments = ["rollout", model, log, "--horizon", "40", "--method", "rk4", "--json"];
        fleetfoot(path, &arguments).ok().json()
    };
    for (recipe, [plain, flips]) in [("body.toml", ["plain", "flips"]), ("vector.toml", ["vector", "turned"])] {
        let (unflipped, flipped) = (fit(recipe, plain, "one.json"), fit(recipe, flips, "other.json"));
        let terms = |report: &serde_json::Value| -> Vec<(String, f64)> {
            let terms = report["regions"][0]["equations"].as_array().unwrap_or_else(|| panic!("{report}")).iter();
            let terms = terms.flat_map(|equation| equation["terms"].as_array().unwrap());
            terms.map(|term| (term["function"].to_string(), term["coefficient"].as_f64().unwrap())).collect()
        };
        let (unflipped, flipped) = (terms(&unflipped), terms(&flipped));
        assert_eq!(unflipped.len(), 3, "{unflipped:?}");
        let truth = [(J[1] - J[2]) / J[0], (J[2] - J[0]) / J[1], (J[0] - J[1]) / J[2]];
        for (((name, value), (same, changed)), truth) in unflipped.iter().zip(&flipped).zip(truth) {
            assert_eq!(name, same);
            // Central differences of order 6 leave 1e-10; the flips nothing but the order of sums.
            assert!(
                (value - truth).abs() < 1e-8 && (value - changed).abs() < 1e-12,
                "{name}: {value} {changed} {truth}"
            );
        }
        let (unflipped, flipped) =
            (rolled("one.json", &format!("{plain}2.csv")), rolled("one.json", &format!("{flips}2.csv")));
        assert_eq!(unflipped["states"], serde_json::json!(["wx", "wy", "wz", "attitude"]), "{unflipped}");
        let rmse = |report: &serde_json::Value| numbers(&report["model"]["rmse"]);
        let (errors, changed) = (rmse(&unflipped), rmse(&flipped));
        assert!(
            errors.len() == 160 && errors.iter().zip(&changed).all(|(a, b)| (a - b).abs() < 1e-12),
            "{errors:?} {changed:?}"
        );
        assert!(errors.iter().all(|error| *error < 1e-8), "{errors:?}");
        assert!(numbers(&unflipped["model"]["mahalanobis"]).iter().all(|score| score.abs() < 1e-7));
    }
}

/// The angles that rollouts of a model that errs are off by, beside those of scipy. A difference of 1e-12 rad is rounding of angles of 1e-4 and more.
#[test]
fn attitude_errors_are_those_of_scipy() {
    let Some(python) = python("numpy, scipy") else { return };
    let folder = folder();
    let path = folder.path();
    let fit = ["fit", "pwa", "-c", "body.toml", "flips0.csv", "--partition", "average", "-o", "m.json"];
    fleetfoot(path, &fit).ok();
    let asked =
        ["rollout", "m.json", "flips2.csv", "--horizon", "30", "--method", "rk4", "-o", "rollouts.csv", "--json"];
    let report = fleetfoot(path, &asked).ok().json();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/peers/rotations.py");
    let output =
        Command::new(python).arg(script).args(["rollouts.csv", "flips2.csv"]).current_dir(path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let expected: Vec<f64> =
        String::from_utf8(output.stdout).unwrap().split_whitespace().map(|number| number.parse().unwrap()).collect();
    let of = |key: &str| -> Vec<f64> {
        report["model"][key].as_array().unwrap().iter().map(|row| row[3].as_f64().unwrap()).collect()
    };
    assert_eq!(expected.len(), 60);
    for ((rmse, mean), pair) in of("rmse").iter().zip(of("mae")).zip(expected.chunks_exact(2)) {
        assert!((rmse - pair[0]).abs() < 1e-12 && (mean - pair[1]).abs() < 1e-12, "{rmse} {mean} {pair:?}");
        assert!(*rmse > 1e-6);
    }
}

/// Moments of inertia and the bias of a gyro by output error: the attitude determines them, the rates alone do not.
#[test]
fn attitudes_determine_parameters() {
    let folder = folder();
    let path = folder.path();
    let recipe = r#"
[states]
wx = { known = "(j2 - j3)*wy*wz" }
wy = { known = "(j3 - 1)/j2*wx*wz" }
wz = { known = "(1 - j2)/j3*wx*wy" }
[states.attitude]
kind = "quaternion"
column = "q"
rate = ["wx", "wy", "wz - drift"]
[parameters]
j2 = { initial = 1.7 }
j3 = { initial = 2.7 }
drift = { initial = 0.05 }
[estimate]
segment = 150
"#;
    fs::write(path.join("known.toml"), recipe).unwrap();
    let fit = |logs: &str, method: &str| {
        let logs = [0, 1].map(|seed| format!("{logs}{seed}.csv"));
        let arguments = ["fit", "parameters", "-c", "known.toml", "--method", method, &logs[0], &logs[1], "--json"];
        fleetfoot(path, &arguments)
    };
    let values = |output: Run| -> Vec<f64> {
        let report = output.ok().json();
        report["parameters"].as_array().unwrap().iter().map(|parameter| parameter["value"].as_f64().unwrap()).collect()
    };
    let (plain, changed) = (values(fit("plain", "output-error")), values(fit("flips", "output-error")));
    for ((plain, changed), truth) in plain.iter().zip(&changed).zip([2.0, 3.0, 0.0]) {
        assert!((plain - truth).abs() < 1e-6 && (plain - changed).abs() < 1e-9, "{plain} {changed}");
    }
    // Compared by its name, the attitude alone determines all three.
    fs::write(path.join("known.toml"), format!("{recipe}compare = \"attitude\"\n")).unwrap();
    let alone = values(fit("flips", "output-error"));
    assert!(alone.iter().zip([2.0, 3.0, 0.0]).all(|(value, truth)| (value - truth).abs() < 1e-6), "{alone:?}");
    // The kinematics are not differentiated: only simulations determine their parameters.
    fs::write(path.join("known.toml"), recipe.replace("segment = 150\n", "")).unwrap();
    fit("plain", "equation-error").fails(&["drift", "output-error"]);
}

/// The code steps as the engine does: its own test compares it at many points.
#[test]
fn exported_code_brings_rotations_back() {
    let folder = folder();
    let path = folder.path();
    for (recipe, log) in [("body.toml", "flips0.csv"), ("vector.toml", "turned0.csv")] {
        fleetfoot(path, &["fit", "sindy", "-c", recipe, log, "-o", "model.json"]).ok();
        for target in ["c", "rust", "python"] {
            fleetfoot(path, &["export", "model.json", "--to", target, "--prefix", "body", "-o", target]).ok();
        }
        let header = fs::read_to_string(path.join("c/body.h")).unwrap();
        let kind = if recipe == "body.toml" { "w of the quaternion" } else { "x of the rotation-vector" };
        assert!(header.contains(&format!("{kind} attitude")), "{header}");
        let compiled = Command::new("cc")
            .current_dir(path.join("c"))
            .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "body.c", "body_test.c", "-o", "test", "-lm"])
            .output();
        let Ok(compiled) = compiled else {
            eprintln!("no `cc` on this machine: exported code is not compiled");
            continue;
        };
        assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
        let test = Command::new(path.join("c/test")).output().unwrap();
        assert!(test.status.success(), "{}", String::from_utf8_lossy(&test.stdout));
    }
}

/// A library names a rotation, whatever its columns are called; with `regressor = true` it has the entries of its
/// matrix. A pendulum on a ball joint: gravity in the body's axes turns it.
#[test]
fn libraries_read_rotations_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut text = String::from("time,a0,a1,a2,a3,wx,wy,wz\n");
    let mut s = [0.9f64, 0.3, -0.3, 0.1, 0.4, -0.2, 0.6];
    let norm = s[..4].iter().map(|part| part * part).sum::<f64>().sqrt();
    s[..4].iter_mut().for_each(|part| *part /= norm);
    let slopes = |s: &[f64; 7]| {
        let [w, x, y, z, a, b, c] = *s;
        // World's z in the body's axes, times -9.81 on a rod of a metre along the body's -z, with friction.
        let [gx, gy] = [2.0 * (x * z - w * y), 2.0 * (y * z + w * x)].map(|part| -9.81 * part);
        [
            -0.5 * (x * a + y * b + z * c),
            0.5 * (w * a + y * c - z * b),
            0.5 * (w * b + z * a - x * c),
            0.5 * (w * c + x * b - y * a),
            gy - 0.2 * a,
            -gx - 0.2 * b,
            -0.2 * c,
        ]
    };
    for row in 0..1500 {
        let f = sign(row, 5);
        let [w, x, y, z, a, b, c] = s;
        let _ = writeln!(text, "{},{},{},{},{},{a},{b},{c}", row as f64 * DT, f * w, f * x, f * y, f * z);
        for _ in 0..4 {
            let moved = |f: &[f64; 7], h: f64| -> [f64; 7] { std::array::from_fn(|i| s[i] + h * f[i]) };
            let one = slopes(&s);
            let two = slopes(&moved(&one, 0.125 * DT));
            let three = slopes(&moved(&two, 0.125 * DT));
            let four = slopes(&moved(&three, 0.25 * DT));
            s = std::array::from_fn(|i| s[i] + DT / 24.0 * (one[i] + 2.0 * two[i] + 2.0 * three[i] + four[i]));
        }
    }
    fs::write(path.join("swing.csv"), text).unwrap();
    let states = "[states]\nwx = {}\nwy = {}\nwz = {}\n[states.attitude]\nkind = \"quaternion\"\ncolumns = [\"a0\", \"a1\", \"a2\", \"a3\"]\norder = \"wxyz\"\nrate = [\"wx\", \"wy\", \"wz\"]\n";
    let named = "[library]\nfunctions = [\"identity\", \"rotate_inv(attitude, vec(0, 0, 9.81)).x\", \"rotate_inv(attitude, vec(0, 0, 9.81)).y\"]\n";
    fs::write(path.join("named.toml"), format!("{states}{named}")).unwrap();
    fs::write(path.join("entries.toml"), format!("{states}regressor = true\n[library]\nfunctions = [\"identity\"]\n"))
        .unwrap();
    for (recipe, gravity) in [("named.toml", 1.0), ("entries.toml", 9.81)] {
        let report =
            fleetfoot(path, &["fit", "sindy", "-c", recipe, "swing.csv", "-o", "m.json", "--json"]).ok().json();
        let equations = report["regions"][0]["equations"].as_array().unwrap();
        let coefficients: Vec<Vec<f64>> = equations
            .iter()
            .map(|equation| {
                let terms = equation["terms"].as_array().unwrap().iter();
                let mut sorted: Vec<f64> = terms.map(|term| term["coefficient"].as_f64().unwrap()).collect();
                sorted.sort_by(f64::total_cmp);
                sorted
            })
            .collect();
        let truth = [vec![-gravity, -0.2], vec![-0.2, gravity], vec![-0.2]];
        for (fitted, truth) in coefficients.iter().zip(&truth) {
            assert_eq!(fitted.len(), truth.len(), "{report}");
            assert!(fitted.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-6), "{fitted:?} {truth:?}");
        }
    }
    // Rollouts read nothing of the recording.
    let rolled = fleetfoot(path, &["rollout", "m.json", "swing.csv", "--horizon", "50", "--method", "rk4"]).ok();
    assert!(rolled.out.contains("replayed from the recording: nothing"), "{}", rolled.out);
}

/// Columns that are no rotation are refused in words: with the file and the row if recorded, with the remedy if a
/// recipe names them.
#[test]
fn invalid_rotations_are_refused() {
    let folder = folder();
    let path = folder.path();
    let broken = log(&body(200, 0), 0, false);
    let broken: Vec<String> = broken
        .lines()
        .enumerate()
        .map(|(line, text)| {
            let mut cells: Vec<&str> = text.split(',').collect();
            // The 120th row after the title: a tracker that lost its body.
            if line == 121 {
                cells[1..5].fill("0");
            }
            cells.join(",")
        })
        .collect();
    fs::write(path.join("lost.csv"), broken.join("\n")).unwrap();
    let fit = |recipe: &str, more: &[&str]| {
        fs::write(path.join("own.toml"), recipe).unwrap();
        fleetfoot(path, &[&["fit", "sindy", "-c", "own.toml"], more].concat())
    };
    let message = fit(RECIPE, &["lost.csv"]).fails(&["lost.csv", "row 121", "attitude", "length 0", "--where"]);
    // The mend in the message works.
    let condition = message.split('"').nth(1).unwrap().to_owned();
    fit(RECIPE, &["lost.csv", "--where", &condition]).ok();
    let refused = |from: &str, to: &str, words: &[&str]| {
        assert!(RECIPE.contains(from));
        fit(&RECIPE.replace(from, to), &["plain0.csv"]).fails(words)
    };
    refused("rate = [\"wx\", \"wy\", \"wz\"]\n", "", &["attitude", "rate = [\"wx\""]);
    refused("[\"q.x\", \"q.y\", \"q.z\", \"q.w\"]", "[\"q.x\", \"q.y\", \"q.z\"]", &["3 columns", "w, x, y, z"]);
    refused("[\"q.x\", \"q.y\", \"q.z\", \"q.w\"]", "[\"q.x\", \"q.y\", \"q.z\", \"wx\"]", &["order = \"wxyz\""]);
    refused("kind = \"quaternion\"", "kind = \"quaternion\"\norder = \"wxyy\"", &["wxyy", "\"xyzw\""]);
    refused("kind = \"quaternion\"", "kind = \"quaternion\"\nknown = \"0\"", &["known", "rate"]);
    refused("kind = \"quaternion\"\n", "", &["columns", "kind = \"quaternion\""]);
    refused(
        "[library]",
        "[inputs]\nu = { column = \"wx\", kind = \"quaternion\" }\n[library]",
        &["[inputs] u", "states"],
    );
    refused("[library]", "[states.\"q.x\"]\nunit = \"rad\"\n[library]", &["q.x", "part of a rotation"]);
    // A state without a role is that part of the rotation.
    let whole =
        RECIPE.replace("[states]\n", "[states]\n\"q.w\" = {}\n").replace("[library]", "[states.\"q.z\"]\n[library]");
    fit(&whole, &["plain0.csv", "-o", "whole.json"]).ok();
    let text = fs::read_to_string(path.join("whole.json")).unwrap();
    assert_eq!(text.matches("\"quaternion\"").count(), 4, "{text}");
    refused("columns = [\"q.x\", \"q.y\", \"q.z\", \"q.w\"]", "column = \"p\"", &["p.w", "columns = [...]"]);
}

/// A filter of a quaternion and its rates, all measured with noise and of any sign, of a body that torques turn. Its
/// estimates are unit quaternions, nearer to the truth than the measurements, with errors as large as it predicts.
#[test]
fn filters_keep_rotations() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut state = 7u64;
    let mut noise = || {
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        0.02 * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0)
    };
    for seed in 0..3 {
        let mut s = [0.8, 0.36, -0.48, 0.0, 1.0, -0.5, 0.3 * seed as f64];
        let mut text = String::from("t,q.w,q.x,q.y,q.z,wx,wy,wz,m.w,m.x,m.y,m.z,nx,ny,nz,ux,uy,uz,dx,dy,dz\n");
        for row in 0..1000 {
            let t = row as f64 * DT;
            let u = [1.3, 0.9, 0.7].map(|rate| (rate * t + seed as f64).sin() + 0.4 * (3.1 * rate * t).cos());
            let pushed = |w: &[f64]| -> [f64; 3] { std::array::from_fn(|i| 2.0 * u[i] - 0.5 * w[i]) };
            let _ = write!(text, "{t}");
            s.iter().for_each(|value| _ = write!(text, ",{value}"));
            let f = sign(row, seed);
            s[..4].iter().for_each(|value| _ = write!(text, ",{}", f * (value + noise())));
            s[4..].iter().for_each(|value| _ = write!(text, ",{}", value + noise()));
            u.iter().chain(&pushed(&s[4..])).for_each(|value| _ = write!(text, ",{value}"));
            text.push('\n');
            let slopes = |s: &[f64; 7]| {
                let [w, x, y, z, a, b, c] = *s;
                let [p, q, r] = pushed(&s[4..]);
                let first = -0.5 * (x * a + y * b + z * c);
                let rest = [w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a].map(|part| 0.5 * part);
                [first, rest[0], rest[1], rest[2], p, q, r]
            };
            let moved = |f: &[f64; 7], h: f64| -> [f64; 7] { std::array::from_fn(|i| s[i] + h * f[i]) };
            let one = slopes(&s);
            let two = slopes(&moved(&one, 0.5 * DT));
            let three = slopes(&moved(&two, 0.5 * DT));
            let four = slopes(&moved(&three, DT));
            s = std::array::from_fn(|i| s[i] + DT / 6.0 * (one[i] + 2.0 * two[i] + 2.0 * three[i] + four[i]));
        }
        fs::write(path.join(format!("body{seed}.csv")), text).unwrap();
    }
    let mut recipe = RECIPE.replace("[\"q.x\", \"q.y\", \"q.z\", \"q.w\"]", "[\"q.w\", \"q.x\", \"q.y\", \"q.z\"]");
    for axis in ["x", "y", "z"] {
        recipe = recipe.replace(&format!("w{axis} = {{"), &format!("w{axis} = {{ derivative = \"d{axis}\","));
    }
    recipe = recipe.replace("[library]", "[inputs]\nux = \"ux\"\nuy = \"uy\"\nuz = \"uz\"\n[library]");
    fs::write(path.join("body.toml"), recipe).unwrap();
    let fit = ["fit", "pwa", "-c", "body.toml", "body0.csv", "body1.csv", "--partition", "average", "-o", "m.json"];
    fleetfoot(path, &fit).ok();
    let pairs = |a: [&str; 7]| {
        let names = ["q.w", "q.x", "q.y", "q.z", "wx", "wy", "wz"];
        names.iter().zip(a).map(|(name, value)| format!("{name}={value}")).collect::<Vec<_>>().join(",")
    };
    let (measured, sensors) = (pairs(["0.02"; 7]), pairs(["m.w", "m.x", "m.y", "m.z", "nx", "ny", "nz"]));
    let truth = pairs(["q.w", "q.x", "q.y", "q.z", "wx", "wy", "wz"]);
    let asked = ["--measured", &measured, "--sensors", &sensors, "--truth", &truth, "-o", "filtered.csv", "--json"];
    let report = fleetfoot(path, &[&["filter", "m.json", "body2.csv"], &asked[..]].concat()).ok().json();
    for estimate in report["truth"].as_array().unwrap() {
        let (error, raw) = (estimate["rmse"].as_f64().unwrap(), estimate["measured_rmse"].as_f64().unwrap());
        assert!(error < 0.4 * raw && (raw - 0.02).abs() < 2e-3, "{estimate}");
    }
    // The attitude has three degrees of freedom, and so have the rates; errors of a filter without process noise last, so that their mean square is known badly.
    let (nees, nis) = (&report["nees"], &report["nis"]);
    assert_eq!(nees["freedom"], 6, "{nees}");
    assert!((0.2..3.0).contains(&nees["mean"].as_f64().unwrap()), "{nees}");
    assert!((0.9..1.1).contains(&nis["mean"].as_f64().unwrap()), "{nis}");
    let text = fs::read_to_string(path.join("filtered.csv")).unwrap();
    let mut lines = text.lines();
    let title: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place =
        |name: &str| title.iter().position(|column| *column == name).unwrap_or_else(|| panic!("{name} in {title:?}"));
    let places = ["q.w", "q.x", "q.y", "q.z"].map(place);
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        let square: f64 = places.iter().map(|&at| cells[at].parse::<f64>().unwrap().powi(2)).sum();
        assert!((square - 1.0).abs() < 1e-12, "{line}");
    }
}
