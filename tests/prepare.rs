//! Clean episodes from raw logs, and the fits that take them as they are.

use std::{collections::BTreeSet, fs};

use fleetfoot::{
    Recipe, Silent,
    message::write::{Header, Imu, Pose, PoseStamped, Time},
    output::{McapOptions, McapWriter},
    read_rows,
};

use crate::runner::*;

const ROWS: usize = 3000;
const DT: f64 = 0.01;

/// A number from -1 to 1 that looks random.
fn noise(seed: u64, row: usize) -> f64 {
    let mixed = fleetfoot::data::mix(fleetfoot::data::mix(seed).wrapping_add(row as u64));
    (mixed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// The rows whose position is wrong by more than 0.5.
fn wrong() -> BTreeSet<usize> {
    (37..ROWS).step_by(113).collect()
}

/// A mass on a spring, x'' = -4 x - 0.6 x' + 2 u: a log of stamps, positions with noise of 2 mm and gross errors, and the force.
fn spring(seed: u64) -> String {
    let (mut x, mut v) = (0.0_f64, 0.0_f64);
    let wrong = wrong();
    let mut text = String::from("t,x [m],u\n");
    let force = |t: f64| (1.1 * t).sin() + 0.8 * (2.9 * t + seed as f64).cos() + 0.5 * (5.3 * t).sin();
    for row in 0..ROWS {
        let t = DT * row as f64;
        let error =
            if wrong.contains(&row) { 0.6 * (1.0 + noise(seed + 7, row).abs()) } else { 0.0035 * noise(seed, row) };
        text.push_str(&format!("{t:.6},{},{}\n", x + error, force(t)));
        // Steps of a hundredth of a row: the midpoint rule errs by 1e-10.
        for step in 0..100 {
            let (h, at) = (DT / 100.0, t + DT / 100.0 * (f64::from(step) + 0.5));
            let a = |x: f64, v: f64| -4.0 * x - 0.6 * v + 2.0 * force(at);
            let (half_x, half_v) = (x + 0.5 * h * v, v + 0.5 * h * a(x, v));
            (x, v) = (x + h * half_v, v + h * a(half_x, half_v));
        }
    }
    text
}

const RECIPE: &str = "columns = { x = \"`x [m]`\" }\nstates = { x = { unit = \"m\" } }\ninputs = { u = \"u\" }\n[library]\nfunctions = [\"1\", \"identity\"]\n\
                      [prepare]\nsecond_order = true\nclip = 0.2\n[[episodes]]\nmatch = \"run_1*\"\nfloor = \"wet\"\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for run in 0..2 {
        fs::write(folder.path().join(format!("run_{run}.csv")), spring(run)).expect("a file");
    }
    fs::write(folder.path().join("robot.toml"), RECIPE).expect("a file");
    folder
}

const PREPARE: [&str; 7] = ["prepare", "-c", "robot.toml", "run_0.csv", "run_1.csv", "-o", "clean"];

fn coefficient(model: &serde_json::Value, term: &str) -> f64 {
    let equations = model["regions"][0]["equations"].as_array().expect("equations");
    let terms = equations.iter().flat_map(|equation| equation["terms"].as_array().expect("terms"));
    let value = terms.filter(|entry| entry["function"] == term).find_map(|entry| entry["coefficient"].as_f64());
    value.unwrap_or_else(|| panic!("no term {term} in {model:#}"))
}

/// From positions alone, with gross errors in them, to the equation of the motion: `fit` takes the written recipe unchanged.
#[test]
fn the_written_recipe_fits_unchanged() {
    let folder = folder();
    let path = folder.path();
    let report = fleetfoot(path, &[&PREPARE[..], &["--json"]].concat()).ok().json();
    let clipped = 2 * (0.2 / DT) as usize;
    for episode in report["episodes"].as_array().expect("episodes") {
        assert_eq!(episode["clipped"], clipped);
        let channel = &episode["pieces"][0]["channels"][0];
        let rejected = &channel["rejected"];
        let kept = |row: &usize| (clipped / 2..ROWS - clipped / 2).contains(row);
        let inside: Vec<usize> = wrong().into_iter().filter(kept).collect();
        let spans = rejected["spans"].as_array().expect("places");
        let is_placed = |row: usize| {
            let t = DT * row as f64;
            spans.iter().any(|span| span[0].as_f64() <= Some(t + 1e-6) && span[1].as_f64() >= Some(t - 1e-6))
        };
        let count = inside.len() as u64;
        assert!(inside.into_iter().all(is_placed), "{rejected}");
        assert!(rejected["rows"].as_u64() <= Some(count + 3), "{rejected}");
        let noise = channel["noise"].as_f64().expect("a noise");
        // Uniform noise of 3.5 mm has a deviation of 3.5 / sqrt(3) mm.
        assert!((noise / 0.00202 - 1.0).abs() < 0.05, "{noise}");
    }
    let recipe = fs::read_to_string(path.join("clean/robot.toml")).expect("a recipe");
    assert!(recipe.contains("smoothed = ") && recipe.contains("floor = \"wet\""), "{recipe}");
    let fit = ["fit", "sindy", "-c", "clean/robot.toml", "clean", "-o", "model.json", "--json"];
    let output = fleetfoot(path, &fit).ok();
    let fitted = output.json();
    for (term, truth) in [("x", -4.0), ("x_dot", -0.6), ("u", 2.0)] {
        let value = coefficient(&fitted, term);
        // Smoothing takes a little of the fastest motion away.
        assert!((value - truth).abs() < 0.03 * truth.abs(), "{term}: {value}");
    }
    let number = output.err.split("scatter about them by x ").nth(1).and_then(|rest| rest.split(' ').next());
    let scatter: f64 = number.and_then(|text| text.parse().ok()).unwrap_or_else(|| panic!("{}", output.err));
    assert!((scatter / 0.00202 - 1.0).abs() < 0.05, "{scatter}");
    // A position's rate is known; the model simulates both, and what was measured is compared with its measurements.
    let output = fleetfoot(path, &["rollout", "model.json", "clean", "--horizon", "100", "--starts", "20"]).ok();
    assert!(output.out.contains("raw RMSE x") && !output.out.contains("raw RMSE x_dot"), "{}", output.out);
    // Of a raw log the model knows no column: it must be prepared first.
    fleetfoot(path, &["score", "model.json", "run_0.csv"]).fails(&["there is no column", "fleetfoot prepare"]);
}

/// The same bytes on any number of threads, and no folder is overwritten unasked.
#[test]
fn preparations_ignore_threads_and_keep_folders() {
    let folder = folder();
    let path = folder.path();
    fleetfoot(path, &[&PREPARE[..], &["--threads", "1"]].concat()).ok();
    let read = |name: &str| fs::read(path.join("clean").join(name)).expect("a file");
    let names = ["run_0.clean.parquet", "run_1.clean.parquet", "robot.toml"];
    let before = names.map(read);
    fleetfoot(path, &PREPARE).fails(&["--force", "clean"]);
    fleetfoot(path, &[&PREPARE[..], &["--threads", "7", "--force"]].concat()).ok();
    assert!(before == names.map(read));
}

/// Bounds end an episode; the rest is written in pieces, and a note counts the pieces that are too short.
#[test]
fn bounds_end_episodes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let rows = (0..1000).map(|row| {
        let t = 0.01 * f64::from(row);
        let level = if (400..420).contains(&row) || row == 440 { 9.0 } else { (2.0 * t).sin() };
        format!("{t},{},{}\n", level + 0.001 * noise(3, row as usize), f64::from(row % 7))
    });
    fs::write(path.join("log.csv"), format!("t,x,u\n{}", rows.collect::<String>())).expect("a file");
    let recipe = "states = { x = {} }\ninputs = { u = \"u\" }\n[channels.x]\nbounds = [-2.0, 2.0]\nmethod = \"savitzky-golay\"\nwindow = 9\n";
    fs::write(path.join("robot.toml"), recipe).expect("a file");
    let report = fleetfoot(path, &["prepare", "-c", "robot.toml", "log.csv", "-o", "clean", "--json"]).ok().json();
    let episode = &report["episodes"][0];
    assert_eq!(episode["out_of_bounds"]["rows"], 21);
    assert_eq!(episode["too_short"]["rows"], 20);
    let rows: Vec<u64> =
        episode["pieces"].as_array().expect("pieces").iter().filter_map(|piece| piece["rows"].as_u64()).collect();
    assert_eq!(rows, [400, 559]);
    assert_eq!(report["files"], serde_json::json!(["clean/log.clean.parquet", "clean/log-2.clean.parquet"]));
    let info = fleetfoot(path, &["info", "clean/log-2.clean.parquet"]).ok().out;
    assert!(info.contains("x_dot") && info.contains("x_ddot") && !info.contains("deviation"), "{info}");
}

/// By default `prepare` takes the spline that fits a state better. A smooth motion at 10 Hz is a quintic one, whose
/// rate is better than a cubic one's by a third, and whose noise is estimated well. A state that noise pushes in every
/// row is a cubic one.
#[test]
fn states_choose_the_order_of_splines() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let (mut rate, mut pushed) = (0.0, 0.0);
    let motion = |t: f64| (0.7 * t).sin() + 0.5 * (2.3 * t).sin();
    let rows = (0..1200).map(|row| {
        let t = 0.1 * row as f64;
        // The sum of two looks more like a normal number.
        rate += 0.3 * (noise(91, row) + noise(92, row));
        pushed += 0.1 * rate;
        format!("{t:.1},{},{}\n", motion(t) + 1.7e-3 * noise(93, row), pushed + 1.7e-2 * noise(94, row))
    });
    fs::write(path.join("log.csv"), format!("t,smooth,pushed\n{}", rows.collect::<String>())).expect("a file");
    fs::write(path.join("robot.toml"), "states = { smooth = {}, pushed = {} }\n").expect("a file");
    let of = |flags: &[&str]| {
        let run = ["prepare", "-c", "robot.toml", "log.csv", "-o", "clean", "--force", "--json"];
        let report = fleetfoot(path, &[&run[..], flags].concat()).ok().json();
        let channels = report["episodes"][0]["pieces"][0]["channels"].as_array().expect("channels").clone();
        let file = [path.join("clean/log.clean.parquet")];
        let rows = read_rows(&Recipe::parse("", "test").unwrap(), None, &file, &Silent).unwrap();
        let column =
            |name: &str| rows.columns.iter().find(|(column, _)| column.name == name).map(|(_, values)| values.clone());
        let truth = |t: f64| 0.7 * (0.7 * t).cos() + 1.15 * (2.3 * t).cos();
        let rates = column("smooth_dot").expect("a rate");
        let squares = rates.iter().enumerate().map(|(row, rate)| (rate - truth(0.1 * row as f64)).powi(2)).sum::<f64>();
        (channels, (squares / rates.len() as f64).sqrt(), column("smooth_ddot").is_some())
    };
    let (channels, error, accelerates) = of(&[]);
    let by_name = |name: &str| channels.iter().find(|channel| channel["channel"] == name).expect("a channel");
    assert_eq!((&by_name("smooth")["method"], &by_name("pushed")["method"]), (&"quintic".into(), &"cubic".into()));
    assert!(!accelerates, "value and rate alone");
    // Uniform noise of 1.7 mm has a deviation of 0.98 mm.
    let noise_of = |channel: &serde_json::Value| channel["noise"].as_f64().expect("a noise") / 0.98e-3;
    assert!((noise_of(by_name("smooth")) - 1.0).abs() < 0.2, "{}", by_name("smooth"));
    let (cubic, by_cubic, _) = of(&["--method", "cubic"]);
    assert!(error < 0.75 * by_cubic, "{error} {by_cubic}");
    // From samples so far apart a cubic spline cannot estimate the noise, and a note reports it.
    assert!(noise_of(&cubic[0]) < 0.5 || cubic[0]["through_all"] == true, "{}", cubic[0]);
    let run = ["prepare", "-c", "robot.toml", "log.csv", "-o", "clean", "--force", "--lambda", "1e-3"];
    let report = fleetfoot(path, &[&run[..], &["--json"]].concat()).ok().json();
    assert_eq!(report["episodes"][0]["pieces"][0]["channels"][0]["method"], "cubic", "a number is a penalty of s^3");
    fleetfoot(path, &[&run[..], &["--method", "auto"]].concat()).fails(&["lambda", "s^5"]);
}

/// Notes name a burst of errors that are alike, and a stuck sensor, with the remedy; a preparation that fails leaves no
/// folder.
#[test]
fn suspicious_logs_get_notes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let write = |spoil: &dyn Fn(usize, f64) -> f64| {
        let rows = (0..ROWS).map(|row| {
            let t = DT * row as f64;
            format!("{t:.2},{}\n", spoil(row, (0.7 * t).sin() + 0.5 * (2.3 * t).cos() + 0.01 * noise(95, row)))
        });
        fs::write(path.join("log.csv"), format!("t,x\n{}", rows.collect::<String>())).expect("a file");
    };
    fs::write(path.join("robot.toml"), "states = { x = {} }\n").expect("a file");
    let prepare = |flags: &[&str]| {
        let run = ["prepare", "-c", "robot.toml", "log.csv", "-o", "clean", "--force"];
        fleetfoot(path, &[&run[..], flags].concat())
    };
    write(&|row, x| if (1000..1030).contains(&row) { x + 0.5 } else { x });
    let out = prepare(&[]).ok().out;
    assert!(
        out.contains("up to 30 of 30 rejected values are consecutive: a burst") && out.contains("--reject 0"),
        "{out}"
    );
    let hung = std::cell::Cell::new(0.0);
    let hang = |row: usize, x: f64| {
        if !(1000..1200).contains(&row) {
            hung.set(x);
        }
        hung.get()
    };
    write(&hang);
    let out = prepare(&[]).ok().out;
    assert!(out.contains("200 values repeated before a jump") && out.contains("--stuck 5"), "{out}");
    let out = prepare(&["--stuck", "5"]).ok().out;
    assert!(!out.contains("repeated before a jump") && !out.contains("are consecutive"), "{out}");
    // A sensor at rest has no noise; its curve does not take noise for motion.
    write(&|_, _| 1.5);
    let out = prepare(&[]).ok().out;
    assert!(out.contains("has no noise, is at rest") && !out.contains("interpolates every sample"), "{out}");
    fs::remove_dir_all(path.join("clean")).expect("a folder");
    prepare(&["--min-rows", "5000"]).fails(&["long enough"]);
    assert!(!path.join("clean").exists());
}

#[test]
fn unpreparable_logs_are_refused() {
    let folder = folder();
    let path = folder.path();
    let with = |more: &str, flags: &[&str]| {
        fs::write(path.join("robot.toml"), format!("{RECIPE}{more}")).expect("a file");
        fleetfoot(path, &[&PREPARE[..], flags].concat())
    };
    with("[channels.y]\nreject = 3.0\n", &[]).fails(&["[channels.y]", "neither a state nor an input"]);
    with("[channels.x]\nclip = 3.0\n", &[]).fails(&["clip", "[prepare]"]);
    with("", &["--method", "butterworth"]).fails(&["cutoff"]);
    with("", &["--method", "butterworth", "--cutoff", "80"]).fails(&["run_0.csv", "`x`", "half the rate"]);
    with("", &["--method", "cubic"]).fails(&["second_order", "quintic"]);
    with("", &["--lambda", "most"]).fails(&["lambda", "likelihood or gcv"]);
    with("", &["--clip", "20"]).fails(&["long enough"]);
    let rows = (0..200).map(|row| format!("{},,1\n", DT * f64::from(row)));
    fs::write(path.join("empty.csv"), format!("t,x [m],u\n{}", rows.collect::<String>())).expect("a file");
    let empty = fleetfoot(path, &["prepare", "-c", "robot.toml", "empty.csv", "-o", "clean"]);
    empty.fails(&["long enough", "empty.csv", "`x`"]);
    assert!(!path.join("clean/robot.toml").exists());
}

const START: i64 = 1_700_000_000_000_000_000;

/// A swing, and its rate; seconds.
fn swing(t: f64) -> [f64; 2] {
    [(2.0 * t).sin() + 0.2 * (9.0 * t).cos(), 2.0 * (2.0 * t).cos() - 1.8 * (9.0 * t).sin()]
}

/// An inertial sensor at 500 Hz, which reports the mean rate of the last 20 ms, and a camera at 100 Hz between its
/// stamps, with noise of a millimetre. Half of the way both pause for some seconds.
pub(crate) fn two_rates(path: &Path, pause: f64) {
    let mut writer = McapWriter::create(path, &McapOptions::default()).unwrap();
    let imu = writer.channel::<Imu<'_>>("/imu").unwrap();
    let pose = writer.channel::<PoseStamped<'_>>("/camera").unwrap();
    let stamp = |t: f64| START + (t * 1e9).round() as i64;
    let header = |t: f64| Header { stamp: Time::from_nanoseconds(stamp(t)).unwrap(), frame_id: "body" };
    for row in 0..10_000 {
        let t = 0.002 * row as f64 + if row < 5000 { 0.0 } else { pause };
        let mean = (swing(t)[0] - swing(t - 0.02)[0]) / 0.02;
        let angular_velocity = [mean + 0.003 * noise(5, row), 0.0, 0.0];
        writer.write(imu, stamp(t), stamp(t), &Imu { header: header(t), angular_velocity, ..Imu::default() }).unwrap();
        if row % 5 == 2 {
            let t = t + 0.0007;
            let seen = Pose { position: [swing(t)[0] + 1.7e-3 * noise(6, row), 0.0, 0.0], ..Pose::default() };
            writer.write(pose, stamp(t), stamp(t), &PoseStamped { header: header(t), pose: seen }).unwrap();
        }
    }
    writer.finish().unwrap();
}

pub(crate) const TWO_RATES: &str = "[columns]\nx = \"/camera.pose.position.x\"\nw = \"/imu.angular_velocity.x\"\n[states]\nx = { unit = \"m\" }\nw = { unit = \"rad/s\" }\n\
                         [time]\nbase = \"/imu\"\n[prepare]\nclip = 0.2\n";

/// The root of the mean square of a written column beside a function of time.
fn apart(folder: &Path, column: &str, truth: impl Fn(f64) -> f64) -> f64 {
    let names = [column.to_owned()];
    let rows = read_rows(&Recipe::default(), Some(&names), &[folder.join("clean/run.clean.parquet")], &Silent).unwrap();
    let truth = rows.stamps.iter().map(|stamp| truth((stamp - START) as f64 * 1e-9));
    let squares: f64 = rows.columns[0].1.iter().zip(truth).map(|(value, truth)| (value - truth).powi(2)).sum();
    (squares / rows.stamps.len() as f64).sqrt()
}

fn prepared(folder: &Path, recipe: &str, flags: &[&str]) -> serde_json::Value {
    fs::write(folder.join("robot.toml"), recipe).expect("a file");
    let command = ["prepare", "-c", "robot.toml", "run.mcap", "-o", "clean", "--force", "--json"];
    fleetfoot(folder, &[&command[..], flags].concat()).ok().json()
}

/// A state whose topic is slower than the rows is smoothed at its samples. The values that a join puts between two of
/// them are no measurements, and the true ones no gross errors.
#[test]
fn slow_topics_are_smoothed_at_their_samples() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    two_rates(&path.join("run.mcap"), 0.0);
    let report = prepared(path, TWO_RATES, &[]);
    let piece = &report["episodes"][0]["pieces"][0];
    let (x, w) = (&piece["channels"][0], &piece["channels"][1]);
    assert_eq!((x["topic"].as_str(), w["topic"].as_str()), (Some("/camera"), None), "{piece:#}");
    assert_eq!((x["rejected"]["rows"].as_u64(), x["left_empty"]["rows"].as_u64()), (Some(0), Some(0)), "{x:#}");
    let (samples, rows) = (x["samples"].as_u64().unwrap_or(0), piece["rows"].as_u64().unwrap_or(0));
    assert!((1955..=1965).contains(&samples) && rows > 9700, "{samples} {rows}");
    let noise = x["noise"].as_f64().expect("a noise");
    // Uniform noise of 1.7 mm has a deviation of 0.98 mm; a cubic spline, whose rate is a random walk and not as smooth as this motion, follows a tenth of it.
    assert!((0.83e-3..1.0e-3).contains(&noise), "{noise}");
    // As the samples alone, smoothed from a table, have it: 0.60 mm and 0.050 m/s.
    let (value, rate) = (apart(path, "x", |t| swing(t)[0]), apart(path, "x_dot", |t| swing(t)[1]));
    assert!(value < 0.7e-3 && rate < 0.06, "{value} {rate}");
    // Told by the same random walk, deviations are on the safe side.
    let deviations = (apart(path, "x_deviation", |_| 0.0), apart(path, "x_dot_deviation", |_| 0.0));
    assert!(
        (0.8..1.3).contains(&(deviations.0 / value)) && (1.0..2.5).contains(&(deviations.1 / rate)),
        "{deviations:?} {value} {rate}"
    );
    // With the join of the recipe, the spline smooths the corners of the join.
    let joined = format!("{TWO_RATES}[join]\n\"/camera.pose.position.*\" = \"linear\"\n");
    let report = prepared(path, &joined, &[]);
    assert!(report["episodes"][0]["pieces"][0]["channels"][0]["topic"].is_null());
}

/// Every method reads the curve of the slower topic off at the rows.
#[test]
fn every_method_comes_to_the_rows() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    two_rates(&path.join("run.mcap"), 0.0);
    for (flags, value, rate) in [
        (&["--method", "quintic"][..], 0.5e-3, 0.05),
        (&["--method", "trend-filter"], 0.7e-3, 0.1),
        (&["--method", "trend-filter", "--degree", "3", "--lambda", "gcv"], 0.7e-3, 0.1),
        (&["--method", "savitzky-golay"], 0.7e-3, 0.1),
        (&["--method", "butterworth", "--cutoff", "8"], 0.7e-3, 0.1),
        (&["--method", "not-a-knot"], 1.2e-3, 0.3),
        (&["--method", "pchip"], 1.2e-3, 0.3),
    ] {
        let report = prepared(path, TWO_RATES, flags);
        let channel = &report["episodes"][0]["pieces"][0]["channels"][0];
        assert_eq!(channel["method"], flags[1]);
        let errors = (apart(path, "x", |t| swing(t)[0]), apart(path, "x_dot", |t| swing(t)[1]));
        assert!(errors.0 < value && errors.1 < rate, "{flags:?}: {errors:?}");
    }
}

/// Samples on the other side of a pause belong to another episode. A curve that is late reaches beyond its last row,
/// and does not go on to them.
#[test]
fn a_pause_is_not_bridged() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    two_rates(&path.join("run.mcap"), 7.3713);
    let late = TWO_RATES.replace("clip = 0.2", "clip = 0") + "[channels.x]\ndelay = 0.05\n";
    for flags in [&["--method", "cubic"][..], &["--method", "savitzky-golay"], &["--method", "pchip"]] {
        let report = prepared(path, &late, flags);
        let episodes = report["episodes"].as_array().expect("episodes");
        assert_eq!(episodes.len(), 2, "{report:#}");
        let [before, after] = [0, 1].map(|at| &episodes[at]["pieces"][0]["channels"][0]);
        assert_eq!((&before["topic"], &after["topic"]), (&"/camera".into(), &"/camera".into()));
        let empty = |channel: &serde_json::Value| channel["left_empty"]["rows"].as_u64().expect("a count");
        assert_eq!(empty(before), empty(after), "{flags:?}: {before:#} {after:#}");
        // Of the filter its window, 11 samples of a period that no pause is part of.
        let smoothed = |channel: &serde_json::Value| channel["smoothed"].as_f64().expect("seconds");
        let window = 0.11;
        let has_filter_window =
            |channel| flags[1] != "savitzky-golay" || (smoothed(channel) / window - 1.0).abs() < 1e-6;
        assert!(has_filter_window(before) && has_filter_window(after), "{before:#} {after:#}");
    }
}

/// The mean of the last 20 ms is late by 10 ms; with that setting the curve belongs to its stamps.
#[test]
fn means_are_late_by_half_their_window() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    two_rates(&path.join("run.mcap"), 0.0);
    prepared(path, TWO_RATES, &[]);
    let late = apart(path, "w", |t| swing(t)[1]);
    let recipe = format!("{TWO_RATES}[channels.w]\naverage = 0.02\n");
    prepared(path, &recipe, &[]);
    let averaged = apart(path, "w", |t| swing(t)[1]);
    // The mean takes 0.13 % of 1.8 from a motion of 9 rad/s; the rest is the noise of the curve.
    assert!(late > 0.1 && averaged < 4e-3, "{late} {averaged}");
    let delayed = format!("{TWO_RATES}[channels.w]\ndelay = 0.01\n");
    prepared(path, &delayed, &[]);
    let other = apart(path, "w", |t| swing(t)[1]);
    assert_eq!(averaged.to_bits(), other.to_bits());
}
