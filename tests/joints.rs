//! Joints whose sensors are fused by the command (beside a body: `fusion.rs`).

use std::fs;

use fleetfoot::{
    Recipe, Silent,
    message::write::{Header, Illuminance, Time},
    output::{McapOptions, McapWriter},
    read_rows,
};

use crate::runner::*;

const START: i64 = 1_700_000_000_000_000_000;

/// A number from -1 to 1 that looks random.
fn noise(seed: u64, row: usize) -> f64 {
    let mixed = fleetfoot::data::mix(fleetfoot::data::mix(seed).wrapping_add(row as u64));
    (mixed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

fn position(t: f64) -> f64 {
    4.0 * (1.1 * t).sin() + 0.3 * (5.0 * t).cos()
}

fn rate(t: f64) -> f64 {
    4.4 * (1.1 * t).cos() - 1.5 * (5.0 * t).sin()
}

fn acceleration(t: f64) -> f64 {
    -4.84 * (1.1 * t).sin() - 7.5 * (5.0 * t).cos()
}

/// An encoder at 200 Hz, wrapped at a turn, with a gross error now and then; a tachometer at 125 Hz, stamped 6 ms late,
/// with a bias of 0.2. A lamp at 50 Hz; and a rate that is the encoder's difference.
fn write_joint(path: &Path, wrapped: bool) {
    write_steps(path, wrapped, 20_000);
}

/// The same for so many milliseconds.
fn write_steps(path: &Path, wrapped: bool, steps: u32) {
    let mut writer = McapWriter::create(path, &McapOptions::default()).unwrap();
    let [encoder, tachometer, derived, lamp] =
        ["/encoder", "/tachometer", "/derived", "/lamp"].map(|name| writer.channel::<Illuminance<'_>>(name).unwrap());
    let header =
        |t: f64| Header { stamp: Time::from_nanoseconds(START + (t * 1e9).round() as i64).unwrap(), frame_id: "knee" };
    let mut last = (0.0, 0.0);
    // The log is in the order of its stamps: steps of a millisecond.
    for step in 0..steps {
        let t = 1e-3 * f64::from(step);
        let row = step as usize;
        let mut say = |channel, value: f64| {
            let read = Illuminance { header: header(t), illuminance: value, ..Illuminance::default() };
            let stamp = START + (t * 1e9).round() as i64;
            writer.write(channel, stamp, stamp, &read).unwrap();
        };
        if step % 5 == 0 {
            let off = if step % 2500 == 1250 { 0.5 } else { 0.0 };
            let value = position(t) + 2e-3 * noise(1, row) + off;
            let turn = std::f64::consts::TAU;
            say(encoder, if wrapped { value - turn * (value / turn).round() } else { value });
            say(derived, if step == 0 { rate(0.0) } else { (value - last.1) / (t - last.0) });
            last = (t, value);
        }
        if step % 8 == 6 {
            say(tachometer, rate(t - 0.006) + 0.2 + 0.05 * noise(2, row));
        }
        if step % 20 == 0 {
            say(lamp, (0.5 * t).sin());
        }
    }
    writer.finish().unwrap();
}

const RECIPE: &str = r#"
[columns]
light = "/lamp.illuminance"
[inputs]
light = {}
[joint.knee]
unit = "rad"
[sensor.encoder]
kind = "position"
channels = ["/encoder.illuminance"]
[sensor.tachometer]
kind = "rate"
channels = ["/tachometer.illuminance"]
delay = "auto"
bias = "auto"
[prepare]
clip = 0.1
"#;

fn prepare(folder: &Path, recipe: &str, flags: &[&str]) -> Run {
    fs::write(folder.join("joint.toml"), recipe).unwrap();
    fleetfoot(folder, &[&["prepare", "-c", "joint.toml", "run.mcap", "-o", "clean", "--force"][..], flags].concat())
}

/// Root mean square error of a column against the truth.
fn rms(folder: &Path, name: &str, truth: &dyn Fn(f64) -> f64) -> f64 {
    let names = [name.to_owned()];
    let file = folder.join("clean/run.clean.parquet");
    let rows = read_rows(&Recipe::default(), Some(&names), &[file], &Silent).unwrap();
    let values = &rows.columns[0].1;
    let square = |(value, stamp): (&f64, &i64)| (value - truth((stamp - START) as f64 * 1e-9)).powi(2);
    (values.iter().zip(&rows.stamps).map(square).sum::<f64>() / values.len() as f64).sqrt()
}

/// Delay, bias and noise are recovered and gross errors left out. States lie near the truth, and the output is ready
/// for a fit.
#[test]
fn the_motion_of_a_joint_is_prepared() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_joint(&path.join("run.mcap"), false);
    let report = prepare(path, RECIPE, &["--json"]).ok().json();
    let joint = &report["joints"][0];
    let [encoder, tachometer] = [0, 1].map(|at| &joint["sensors"][at]);
    let near = |name: &str, truth: f64, least: f64| {
        let value = tachometer[name].as_f64().unwrap();
        let deviation = tachometer[format!("{name}_deviation")].as_f64().unwrap();
        assert!(deviation > 0.0 && deviation < least && (value - truth).abs() < 4.0 * deviation, "{joint:#}");
    };
    near("delay", 0.006, 1e-3);
    near("bias", 0.2, 0.02);
    // Uniform errors: a root of three less than their ends.
    let ratio = encoder["noise"].as_f64().unwrap() * 3.0_f64.sqrt() / 2e-3;
    assert!((ratio - 1.0).abs() < 0.1, "{joint:#}");
    assert_eq!(encoder["rejected"][0]["rows"], 8, "{joint:#}");
    assert!(joint["converged"].as_bool().unwrap() && joint["correlations"].as_array().is_some());
    let errors = [
        rms(path, "knee", &position),
        rms(path, "knee_dot", &rate),
        rms(path, "knee_ddot", &acceleration),
        rms(path, "light", &|t| (0.5 * t).sin()),
    ];
    assert!(errors.iter().zip([6e-4, 0.012, 0.5, 0.01]).all(|(error, most)| *error < most), "{errors:?}");
    assert!(rms(path, "knee_deviation", &|_| 0.0) < 1e-3);
    let recipe = fs::read_to_string(path.join("clean/robot.toml")).unwrap();
    assert!(recipe.contains("[states.knee_dot]") && !recipe.contains("sensor"), "{recipe}");
    fleetfoot(path, &["fit", "sindy", "-c", "clean/robot.toml", "clean", "-o", "model.json", "--degree", "1"]).ok();
    let text = prepare(path, RECIPE, &[]).ok().out;
    assert!(text.contains("tachometer") && text.contains("jerk") && text.contains("delay, s"), "{text}");
}

/// A filter gives for a row the value that it would give if the log ended there. Its errors are larger than those of
/// the smoother, which has all of it.
#[test]
fn filters_do_not_use_later_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let known = RECIPE
        .replace("delay = \"auto\"\nbias = \"auto\"", "delay = 0.006\nbias = 0.2\nnoise = [0.03]")
        .replace("[\"/encoder.illuminance\"]", "[\"/encoder.illuminance\"]\nnoise = [1.2e-3]")
        .replace("clip = 0.1", "clip = 0.0");
    let filter = known.replace("unit = \"rad\"", "unit = \"rad\"\njerk = 60.0\nestimate = \"filter\"");
    let names = ["knee", "knee_dot", "knee_ddot", "knee_deviation"].map(str::to_owned);
    let read = |recipe: &str, steps: u32| {
        write_steps(&path.join("run.mcap"), false, steps);
        prepare(path, recipe, &[]).ok();
        let file = path.join("clean/run.clean.parquet");
        read_rows(&Recipe::default(), Some(&names), &[file], &Silent).unwrap()
    };
    let (part, whole) = (read(&filter, 7_500), read(&filter, 20_000));
    let rows = part.stamps.len();
    assert!(rows > 1_400 && part.stamps[..] == whole.stamps[..rows], "{rows}");
    for ((column, part), (_, whole)) in part.columns.iter().zip(&whole.columns) {
        let size = part.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
        for (part, whole) in part.iter().zip(whole) {
            // Both are scaled by what their own readings span.
            assert!((part - whole).abs() < 1e-9 * size, "{}: {part} {whole}", column.name);
        }
    }
    let filtered = [rms(path, "knee", &position), rms(path, "knee_dot", &rate)];
    read(&filter.replace("\"filter\"", "\"smoother\""), 20_000);
    let smoothed = [rms(path, "knee", &position), rms(path, "knee_dot", &rate)];
    assert!(
        filtered.iter().zip(smoothed).all(|(filter, smoother)| *filter > 1.2 * smoother),
        "{filtered:?} {smoothed:?}"
    );
    assert!(filtered[0] < 2e-3 && filtered[1] < 0.1, "{filtered:?}");
    prepare(path, &filter.replace("\"filter\"", "\"forward\""), &[]).fails(&["estimate", "smoother", "filter"]);
}

/// The same bytes on any number of threads; an angle that wraps is written wrapped, with the same rates.
#[test]
fn joints_ignore_threads_and_wrap_angles() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_joint(&path.join("run.mcap"), true);
    let angle = RECIPE.replace("unit = \"rad\"", "unit = \"rad\"\nkind = \"angle\"\nstudent = 4.0");
    let written = ["1", "2", "7"].map(|threads| {
        let output = prepare(path, &angle, &["--threads", threads, "--json"]).ok();
        (output.out, fs::read(path.join("clean/run.clean.parquet")).unwrap())
    });
    assert!(written[0] == written[1] && written[0] == written[2]);
    let turn = std::f64::consts::TAU;
    let off = rms(path, "knee", &|t| position(t) - turn * (position(t) / turn).round());
    // A gross error of half a radian near half a turn changes nothing that lasts.
    assert!(off < 1e-3 && rms(path, "knee_dot", &rate) < 0.012, "{off}");
}

/// A rate that was computed from the encoder is no second measurement.
#[test]
fn impossible_joints_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_joint(&path.join("run.mcap"), false);
    let derived = RECIPE.replace("/tachometer.illuminance", "/derived.illuminance");
    prepare(path, &derived, &[]).fails(&["[joint.knee]", "`encoder` and `tachometer`", "correlated = true"]);
    let output = prepare(path, &derived.replace("unit = \"rad\"", "correlated = true"), &[]).ok();
    assert!(output.err.contains("deviations are too small"), "{}", output.err);
    for (recipe, words) in [
        (RECIPE.replace("unit = \"rad\"", "sensors = [\"encodr\"]"), vec!["[joint.knee] sensors", "encodr", "encoder"]),
        (RECIPE.replace("[joint.knee]\nunit = \"rad\"\n", ""), vec!["[sensor.encoder]", "no joint"]),
        (RECIPE.replace("kind = \"position\"", "kind = \"rate\""), vec!["position"]),
        (RECIPE.replace("delay = \"auto\"", "delay = \"late\""), vec!["[sensor.tachometer] delay", "auto"]),
        (RECIPE.replace("delay = \"auto\"", "lever = [0.0, 0.0, 0.0]"), vec!["[sensor.tachometer]", "body"]),
        (RECIPE.replace("delay = \"auto\"", "average = -1.0"), vec!["[sensor.tachometer] average = -1", "seconds"]),
        (RECIPE.replace("unit = \"rad\"", "huber = 3.0\nstudent = 4.0"), vec!["[joint.knee]", "huber and student"]),
        (RECIPE.replace("unit = \"rad\"", "unit = 3"), vec!["unit"]),
        (RECIPE.replace("light = {}", "knee_dot = { column = \"light\" }"), vec!["`knee_dot`", "written twice"]),
        (RECIPE.replace("clip = 0.1", "method = \"cubic\""), vec!["[joint]", "clip"]),
    ] {
        prepare(path, &recipe, &[]).fails(&words);
    }
}
