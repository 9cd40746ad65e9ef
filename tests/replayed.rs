//! Simulations never read the recording: columns that follow from states, outputs and inputs are computed, as aliases
//! or written out.

use std::fmt::Write as _;

use crate::runner::*;

/// A craft that climbs against drag and wind, in states whose log has other names: `t, /z, /v, /pitch, /w, /u, /wind` and derivatives.
fn craft(rows: usize, phase: f64) -> String {
    let dt = 0.01;
    let (mut z, mut v, mut pitch, mut w, mut slow) = (0.0f64, 1.0f64, 0.1f64, 0.0f64, None);
    let mut past = [1.0f64; 2];
    let mut text = String::from("t,odom_z,odom_v,odom_pitch,odom_w,cmd_u,wind,dv,dpitch,dw\n");
    for row in 0..rows {
        let t = row as f64 * dt;
        let u = 1.5 + (1.3 * t + phase).sin() + 0.5 * (0.4 * t * t.sqrt() + phase).cos();
        let wind = 0.3 * (0.9 * t + 2.0 * phase).cos();
        let lag = slow.unwrap_or(v);
        let rise = (pitch.cos() * v + 0.5 * u) * (1.0 + 0.1 * wind);
        let dv = u - 0.4 * v * v.abs() - 0.3 * wind * v;
        let late = 0.5 * (past[0] + past[1]);
        let dpitch = 0.8 * (u - late).sin() - 0.6 * pitch;
        let dw = 1.2 * lag - 0.7 * w + 0.2 * rise;
        let _ = writeln!(text, "{t},{z},{v},{pitch},{w},{u},{wind},{dv},{dpitch},{dw}");
        past = [v, past[0]];
        slow = Some(lag + (1.0 - (-dt / 0.2f64).exp()) * (v - lag));
        (z, v, pitch, w) = (z + dt * rise, v + dt * dv, pitch + dt * dpitch, w + dt * dw);
    }
    text
}

/// The recipe with aliases, and the same with their texts.
const ALIASED: &str = r#"
[columns]
z = "odom_z"
v = "odom_v"
pitch = "odom_pitch"
w = "odom_w"
u = "cmd_u"
rise = "(cos(odom_pitch)*odom_v + 0.5*cmd_u)*(1 + 0.1*wind)"
drag = "odom_v*abs(odom_v)"
gust = "wind*odom_v"
slow = "lag1(odom_v, 0.2)"
late = "delay(odom_v, 0.015)"
above = "sign(odom_v - 1.9)"
[states]
z = { known = "rise", regressor = false }
v = { derivative = "dv", library = ["u", "drag", "gust"] }
pitch = { derivative = "dpitch", library = ["sin(u - late)", "sin(u - v)", "pitch"] }
w = { derivative = "dw", library = ["slow", "w", "rise"] }
[inputs]
u = "cmd_u"
[model]
partition_on = ["above"]
"#;

fn inlined() -> String {
    [
        ("known = \"rise\"", "known = \"(cos(pitch)*v + 0.5*u)*(1 + 0.1*wind)\""),
        ("\"drag\", \"gust\"", "\"v*abs(v)\", \"wind*v\""),
        ("u - late", "u - delay(v, 0.015)"),
        ("[\"slow\", \"w\", \"rise\"]", "[\"lag1(v, 0.2)\", \"w\", \"(cos(pitch)*v + 0.5*u)*(1 + 0.1*wind)\"]"),
        ("partition_on = [\"above\"]", "partition_on = [\"sign(v - 1.9)\"]"),
    ]
    .iter()
    .fold(ALIASED.to_owned(), |text, (alias, written)| {
        assert!(text.contains(alias), "{alias}");
        text.replace(alias, written)
    })
}

fn craft_models(partition: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("train.csv", &craft(3000, 0.0));
    write("test.csv", &craft(1500, 1.0));
    write("aliased.toml", ALIASED);
    write("inlined.toml", &inlined());
    for name in ["aliased", "inlined"] {
        let (recipe, model) = (format!("{name}.toml"), format!("{name}.json"));
        let fit = [
            "fit",
            "sindy",
            "-c",
            &recipe,
            "train.csv",
            "--partition",
            partition,
            "--threshold",
            "0.001",
            "--ridge",
            "0",
        ];
        fleetfoot(folder.path(), &[&fit[..], &["-o", &model]].concat()).ok();
    }
    folder
}

/// The report of a rollout, and the rows of its file.
fn rolled(folder: &Path, model: &str, more: &[&str]) -> (serde_json::Value, Vec<u8>) {
    let run = ["rollout", model, "test.csv", "--horizon", "300", "--starts", "20", "--json", "-o", "out.parquet"];
    let report = fleetfoot(folder, &[&run[..], more].concat()).ok().json();
    (report, std::fs::read(folder.join("out.parquet")).unwrap())
}

#[test]
fn aliases_roll_out_like_their_text() {
    for partition in ["average", "kmeans:2"] {
        let folder = craft_models(partition);
        for method in ["euler", "rk4"] {
            let (aliased, _) = rolled(folder.path(), "aliased.json", &["--method", method]);
            let (inlined, _) = rolled(folder.path(), "inlined.json", &["--method", method]);
            assert_eq!(aliased["model"], inlined["model"], "{partition} {method}");
            assert_eq!(aliased["states"], serde_json::json!(["z", "v", "pitch", "w"]));
            // Functions of the states are not taken from the recording.
            for report in [&aliased, &inlined] {
                assert_eq!(report["replayed"], serde_json::json!(["u", "wind"]), "{partition} {method}");
            }
            // The model is exact where steps are those of the log.
            let error = aliased["model"]["rmse"][299][1].as_f64().unwrap();
            assert!(method != "euler" || error < 1e-6, "{partition}: {error:e}");
        }
        let output = fleetfoot(folder.path(), &["rollout", "aliased.json", "test.csv", "--horizon", "20"]).ok();
        assert!(output.out.contains("replayed from the recording: u, wind"), "{}", output.out);
    }
}

#[test]
fn exported_code_computes_functions_of_states() {
    let folder = craft_models("kmeans:2");
    let path = folder.path();
    let code = |name: &str, to: &str| {
        let model = format!("{name}.json");
        fleetfoot(path, &["export", &model, "--to", to, "--prefix", "craft", "-o", name]).ok();
    };
    for name in ["aliased", "inlined"] {
        code(name, "c");
        code(name, "rust");
        code(name, "python");
    }
    let read = |name: &str, file: &str| std::fs::read_to_string(path.join(name).join(file)).unwrap();
    // All but what names the models is the same.
    let body = |name: &str, file: &str, from: &str| {
        let text = read(name, file);
        let at = text.find(from).unwrap_or_else(|| panic!("{from} in {text}"));
        text[at..].replace("slow", "lag1(v, 0.2)").replace("SLOW", "LAG1_V_0_2")
    };
    assert_eq!(body("aliased", "craft.c", "static"), body("inlined", "craft.c", "static"));
    let header = read("aliased", "craft.h");
    let about = |text: &str| header.lines().any(|line| line.trim_start_matches([' ', '*']).starts_with(text));
    assert!(about("u[0] u") && about("u[1] wind") && !about("u[2] "), "{header}");
    assert!(header.contains("First-order lags are states: x[4] slow"), "{header}");
    let compiled = Command::new("cc")
        .current_dir(path.join("aliased"))
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "craft.c", "craft_test.c", "-o", "test", "-lm"])
        .output();
    match compiled {
        Err(_) => eprintln!("no `cc` on this machine: exported code is not compiled"),
        Ok(compiled) => {
            assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
            let test = Command::new(path.join("aliased").join("test")).output().unwrap();
            assert!(test.status.success(), "{}", String::from_utf8_lossy(&test.stdout));
        }
    }
}

/// `next(y) = 0.8 y - 0.25 sqrt(max(y, 0)) + 0.4 u`, measured with noise: `t, y, u`.
fn tank(rows: usize, seed: u64) -> String {
    let mut text = String::from("t,y,u\n");
    let mut y = 0.5f64;
    for row in 0..rows {
        let t = row as f64;
        let u = 0.6 + 0.5 * (0.05 * t + seed as f64).sin() + 0.4 * (0.013 * t * t.sqrt()).cos();
        let noise = ((row as f64 * 12.9898 + seed as f64 * 78.233).sin() * 43_758.547).fract();
        let _ = writeln!(text, "{},{},{u}", t * 0.1, y + 0.02 * noise);
        y = 0.8 * y - 0.25 * y.max(0.0).sqrt() + 0.4 * u;
    }
    text
}

fn tanks() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("train.csv"), tank(1500, 1)).unwrap();
    std::fs::write(folder.path().join("test.csv"), tank(600, 2)).unwrap();
    folder
}

const NARX: [&str; 12] =
    ["fit", "narx", "train.csv", "--outputs", "y", "--lags-out", "1", "--lags-in", "1", "--degree", "1", "--json"];

#[test]
fn functions_of_outputs_use_simulated_outputs() {
    let folder = tanks();
    let fit = |more: &[&str]| fleetfoot(folder.path(), &[&NARX[..], more].concat());
    let alias = ["--inputs", "u,s", "--alias", "s=sqrt(max(y,0))", "--free-run", "test.csv", "-o", "narx.json"];
    let report = fit(&[&alias[..], &["--terms", "all"]].concat()).ok().json();
    let files = &report["files"]["by_file"][0];
    assert_eq!(files["replayed"], serde_json::json!(["u"]));
    // The recursion by hand, from the first row.
    let terms = &report["regions"][0]["equations"][0]["terms"];
    let of = |name: &str| {
        let term = terms.as_array().unwrap().iter().find(|term| term["function"] == name);
        term.map_or(0.0, |term| term["coefficient"].as_f64().unwrap())
    };
    let rows: Vec<Vec<f64>> = tank(600, 2)
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|value| value.parse().unwrap()).collect())
        .collect();
    let (mut y, mut square) = (rows[0][1], 0.0);
    for pair in rows.windows(2) {
        y = of("1") + of("y") * y + of("u") * pair[0][2] + of("s") * y.max(0.0).sqrt();
        square += (y - pair[1][1]).powi(2);
    }
    let rmse = (square / (rows.len() - 1) as f64).sqrt();
    let reported = files["free_run"][0]["rmse"].as_f64().unwrap();
    assert!(
        (reported - rmse).abs() < 1e-9 * rmse && of("s") != 0.0,
        "{reported} by the engine, {rmse} by the recursion"
    );
    let table = fleetfoot(folder.path(), &[&NARX[..11], &alias[..]].concat()).ok().out;
    assert!(table.contains("free run: replayed from the recording: u"), "{table}");
    // Selection by free runs sees the same.
    let chosen = fit(&[&alias[..], &["--terms", "auto"]].concat()).ok().json();
    assert_eq!(chosen["train"]["replayed"], serde_json::json!(["u"]));
}

#[test]
fn direct_functions_of_outputs_are_refused() {
    let folder = tanks();
    let fit = |more: &[&str]| fleetfoot(folder.path(), &[&NARX[..], more].concat());
    fit(&["--inputs", "u,s", "--alias", "s=y+0*u", "--direct", "-o", "m.json"]).fails(&[
        "`s`",
        "y + 0*u",
        "`y`",
        "--direct",
        "lag(s, 1)",
    ]);
    fit(&["--inputs", "u,s", "--alias", "s=central(y)", "-o", "m.json"]).fails(&["`s`", "`y`"]);
    assert!(!folder.path().join("m.json").exists());
    // Of inputs alone, or of the past, it may be.
    fit(&["--inputs", "u,s", "--alias", "s=abs(u)", "--direct", "-o", "m.json"]).ok();
    fit(&["--inputs", "u,s", "--alias", "s=lag(y,2)+0*u", "--direct", "-o", "m.json"]).ok();
}

#[test]
fn functions_of_later_rows_do_not_simulate() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("log.csv"), craft(800, 0.0)).unwrap();
    let fit =
        ["fit", "sindy", "log.csv", "--states", "odom_v", "--inputs", "cmd_u", "--alias", "slope=central(odom_v)"];
    fleetfoot(folder.path(), &[&fit[..], &["--library", "slope", "--threshold", "0.001", "-o", "m.json"]].concat())
        .ok();
    fleetfoot(folder.path(), &["score", "m.json", "log.csv"]).ok();
    for arguments in [&["rollout", "m.json", "log.csv"][..], &["export", "m.json", "--to", "c", "-o", "c"]] {
        fleetfoot(folder.path(), arguments).fails(&["`slope` = ", "`odom_v` 1 row ahead", "lag(slope, 1)"]);
    }
}
