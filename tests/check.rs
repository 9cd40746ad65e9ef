//! `fleetfoot check`: faults that are put into sound logs have their names, and sound logs have none.

use std::{f64::consts::PI, fmt::Write as _, fs, path::Path};

use fleetfoot::{
    message::write::{Float64MultiArray, Header, Odometry, Time},
    output::{McapOptions, McapWriter},
};

use crate::runner::*;

/// A robot on a plane that drives and turns: place, heading, their rates, and two commands; rows of 10 ms.
fn sound(rows: usize, seed: f64) -> Vec<[f64; 9]> {
    let dt = 0.01;
    let (mut x, mut y, mut yaw, mut v, mut w) = (0.0f64, 0.0f64, 0.3f64, 0.2f64, 0.0f64);
    let mut log = Vec::with_capacity(rows);
    for row in 0..rows {
        let t = dt * row as f64;
        let throttle = (0.7 * t + seed).sin() + 0.4 * (2.9 * t).cos() + 0.2 * (7.3 * t + seed).sin();
        let steer = (0.4 * t).cos() + 0.7 * (1.7 * t + 2.0 * seed).sin();
        log.push([t, x, y, yaw, v * yaw.cos(), v * yaw.sin(), w, throttle, steer]);
        x += dt * v * yaw.cos();
        y += dt * v * yaw.sin();
        yaw = (yaw + dt * w + PI).rem_euclid(2.0 * PI) - PI;
        v += dt * (2.0 * throttle - 1.5 * v);
        w += dt * (6.0 * steer - 3.0 * w);
    }
    log
}

const RECIPE: &str = "[states]\nx = {}\ny = {}\nyaw = { kind = \"angle\" }\nvx = {}\nvy = {}\nyaw_rate = {}\n\
                      [inputs]\nthrottle = \"throttle\"\nsteer = \"steer\"\n";

fn text(rows: &[[f64; 9]]) -> String {
    let mut text = String::from("t,x,y,yaw,vx,vy,yaw_rate,throttle,steer\n");
    for row in rows {
        let cells: Vec<String> =
            row.iter().map(|value| if value.is_nan() { String::new() } else { format!("{value:.9}") }).collect();
        let _ = writeln!(text, "{}", cells.join(","));
    }
    text
}

/// The faults of a log and their places.
fn faults(path: &Path, text: &str, more: &[&str]) -> Vec<(String, String)> {
    fs::write(path.join("log.csv"), text).unwrap();
    fs::write(path.join("robot.toml"), RECIPE).unwrap();
    let report = fleetfoot(path, &[&["check", "log.csv", "--json"], more].concat()).ok().json();
    let field = |finding: &serde_json::Value, key: &str| finding[key].as_str().unwrap_or_default().to_owned();
    let findings = report["findings"].as_array().expect("findings").iter();
    findings.map(|finding| (field(finding, "fault"), field(finding, "place"))).collect()
}

#[test]
fn faults_in_sound_logs_have_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let rows = sound(4000, 0.0);
    let faults_after = |change: &dyn Fn(usize, &mut [f64; 9])| {
        let mut rows = rows.clone();
        rows.iter_mut().enumerate().for_each(|(at, row)| change(at, row));
        faults(path, &text(&rows), &["-c", "robot.toml"])
    };
    let is = |listed: Vec<(String, String)>, fault: &str, place: &str| {
        assert_eq!(listed, [(fault.to_owned(), place.to_owned())]);
    };
    assert_eq!(faults_after(&|_, _| {}), []);
    is(faults_after(&|at, row| row[4] = rows[at.saturating_sub(2)][4]), "delay", "vx");
    is(faults_after(&|at, row| row[6] += if at % 20 == 7 { 60.0 } else { 0.0 }), "gross-errors", "yaw_rate");
    is(faults_after(&|at, row| row[1] = if (900..1300).contains(&at) { 0.123 } else { row[1] }), "stuck", "x");
    is(faults_after(&|_, row| row[6] = row[6].to_degrees()), "unit", "yaw_rate");
    is(faults_after(&|_, row| row.swap(4, 5)), "swapped-axes", "vx");
    is(faults_after(&|_, row| row[6] = -row[6]), "sign", "yaw_rate");
    is(faults_after(&|_, row| row[8] = 0.5), "dead", "steer");
    is(faults_after(&|at, row| row[5] = if at % 30 < 3 { f64::NAN } else { row[5] }), "missing", "vy");
    is(faults_after(&|_, row| row[4] = row[4].min(0.4)), "saturated", "vx");
    is(faults_after(&|at, row| row[0] += [0.0, 0.003, -0.003, 0.001][at % 4]), "jitter", "stamps of the rows");
    // Messages that are lost.
    let kept: Vec<[f64; 9]> = rows.iter().enumerate().filter(|(at, _)| at % 40 != 11).map(|(_, row)| *row).collect();
    is(faults(path, &text(&kept), &["-c", "robot.toml"]), "dropped", "stamps of the rows");
    // A heading in degrees that jumps at 180.
    let degrees = faults_after(&|_, row| row[3] = row[3].to_degrees());
    assert!(degrees.contains(&("unit".into(), "yaw".into())), "{degrees:?}");
    let at_rest = faults_after(&|_, row| row[1..].fill(1.0));
    assert!(at_rest.contains(&("at-rest".into(), "all states".into())), "{at_rest:?}");
}

#[test]
fn plain_faults_are_found_with_their_places() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let rows = sound(2000, 0.0);
    let report = |change: &dyn Fn(usize, &mut [f64; 9])| {
        let mut rows = rows.clone();
        rows.iter_mut().enumerate().for_each(|(at, row)| change(at, row));
        fs::write(path.join("log.csv"), text(&rows)).unwrap();
        fleetfoot(path, &["check", "log.csv"]).ok().out
    };
    // The row counts from 1, as its stamp from 0.
    let spike = report(&|at, row| row[4] = if at == 812 { 1000.0 } else { row[4] });
    assert!(spike.contains("vx: 1 of its 2000 values is far from both neighbours, most of all 1000"), "{spike}");
    assert!(
        spike.contains("in row 813 of log.csv, 8.120 s after its first") && spike.contains("1 finding."),
        "{spike}"
    );
    let clipped = report(&|_, row| row[6] = (20.0 * row[6]).clamp(-1.0, 1.0));
    assert!(clipped.contains("yaw_rate: ") && clipped.contains("are at -1 or 1, the ends of its range"), "{clipped}");
    // A held input of any values.
    let held = report(&|at, row| row[8] = (1e4 * ((at / 17 + 1) as f64).sin()).fract());
    assert!(held.contains("Nothing wrong was found."), "{held}");
    for (place, rate) in [("pos", "vel"), ("theta", "omega"), ("angle", "rate"), ("p", "v")] {
        let mut text = format!("t,{place},{rate}\n");
        for row in 0..2000 {
            let t = 0.01 * f64::from(row);
            let rate = |t: f64| t.cos() + 0.93 * (3.1 * t).cos();
            let _ = writeln!(text, "{t:.2},{:.9},{:.9}", t.sin() + 0.3 * (3.1 * t).sin(), rate(t - 0.05));
        }
        fs::write(path.join("late.csv"), text).unwrap();
        let late = fleetfoot(path, &["check", "late.csv"]).ok().out;
        assert!(late.contains(&format!("{rate}: it lags by 0.0500 s (5 rows) behind `{place}`")), "{late}");
    }
}

#[test]
fn backward_and_repeated_stamps_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let rows = sound(600, 0.0);
    let of_rows = |rows: &[[f64; 9]]| faults(path, &text(rows), &["--time", "t"]);
    let of_log = |fault: &str| vec![(fault.to_owned(), "log.csv".to_owned())];
    let reversed: Vec<[f64; 9]> = rows.iter().rev().copied().collect();
    assert_eq!(of_rows(&reversed), of_log("backward"));
    let mut repeated = rows.clone();
    repeated.insert(301, rows[300]);
    assert_eq!(of_rows(&repeated), of_log("repeated"));
    // A second session, whose clock begins anew.
    let other = sound(500, 0.5);
    let sessions: Vec<[f64; 9]> = rows.iter().chain(&other).copied().collect();
    assert_eq!(of_rows(&sessions), []);
}

#[test]
fn topics_without_overlap_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut writer = McapWriter::create(path.join("run.mcap"), &McapOptions::default()).unwrap();
    let once = writer.channel::<Float64MultiArray<'_>>("/odom_limits").unwrap();
    let odom = writer.channel::<Odometry<'_>>("/odom").unwrap();
    let start = 1_790_000_000_000_000_000;
    writer.write(once, start, start, &Float64MultiArray { data: &[1.0, 2.0], ..Float64MultiArray::default() }).unwrap();
    for (row, [_, x, y, _, vx, ..]) in sound(1000, 0.0).into_iter().enumerate() {
        let log = start + 500_000_000 + row as i64 * 10_000_000;
        let header = Header { stamp: Time::from_nanoseconds(log).unwrap(), frame_id: "odom" };
        let mut message = Odometry { header, child_frame_id: "base_link", ..Odometry::default() };
        (message.pose.position, message.twist.linear) = ([x, y, 0.0], [vx, 0.0, 0.0]);
        writer.write(odom, log, log, &message).unwrap();
    }
    writer.finish().unwrap();
    let report = fleetfoot(path, &["check", "run.mcap", "--json"]).ok().json();
    let findings = report["findings"].as_array().unwrap();
    let apart = findings.iter().find(|finding| finding["fault"] == "no-overlap").unwrap();
    assert_eq!(apart["place"], "/odom_limits");
    assert!((apart["value"].as_f64().unwrap() - 0.5).abs() < 1e-6, "{apart}");
    let names = report["channels"].as_array().unwrap().iter().map(|channel| channel["name"].as_str().unwrap());
    let names: Vec<&str> = names.collect();
    assert!(names.contains(&"/odom.pose.pose.position.x") && names.iter().all(|name| !name.contains("limits")));
}

#[test]
fn sound_logs_have_no_fault() {
    let folder = tempfile::tempdir().unwrap();
    for seed in 0..20 {
        let rows = sound(1500 + 100 * seed, seed as f64);
        // With the roles of a recipe, and as a table of which nothing is known.
        assert_eq!(faults(folder.path(), &text(&rows), &["-c", "robot.toml"]), [], "{seed}");
        assert_eq!(faults(folder.path(), &text(&rows), &[]), [], "{seed}");
    }
}

#[test]
fn findings_name_a_mend_and_strict_fails() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut rows = sound(2000, 1.0);
    fs::write(path.join("sound.csv"), text(&rows)).unwrap();
    rows.iter_mut().for_each(|row| row[8] = 0.5);
    fs::write(path.join("log.csv"), text(&rows)).unwrap();
    let output = fleetfoot(path, &["check", "log.csv"]).ok().out;
    for part in
        ["2000 rows, 100", "8 channels looked at", "steer: it is 0.5 in every row", "-> leave it out", "1 finding."]
    {
        assert!(output.contains(part), "{part} is missing from {output}");
    }
    fleetfoot(path, &["check", "log.csv", "--strict"]).fails(&["--strict: 1 finding"]);
    let sound = fleetfoot(path, &["check", "sound.csv", "--strict"]).ok().out;
    assert!(sound.contains("Nothing wrong was found."), "{sound}");
    // The same on any number of threads.
    let of = |threads: &str| fleetfoot(path, &["check", "log.csv", "--json", "--threads", threads]).ok().out;
    assert_eq!(of("1"), of("3"));
    fleetfoot(path, &["check", "none.csv"]).fails(&["none.csv"]);
}

#[test]
fn info_has_correlations_and_response_lags() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let level = |k: usize| (((k / 50) * (k / 50)) as f64).sin();
    let mut text = String::from("t,r,v,opposite,still\n");
    for k in 0..1500usize {
        let (r, v) = (level(k), level(k.saturating_sub(7)));
        let _ = writeln!(text, "{:.2},{r:.9},{v:.9},{:.9},1", 0.01 * k as f64, 3.0 - 2.0 * r);
    }
    fs::write(path.join("log.csv"), text).unwrap();
    let report =
        fleetfoot(path, &["info", "log.csv", "--correlation", "--columns", "r,opposite,v", "--json"]).ok().json();
    assert!(
        (report["matrix"][0][1].as_f64().unwrap() + 1.0).abs() < 1e-9
            && report["matrix"][0][2].as_f64().unwrap() < 0.99
    );
    let text = fleetfoot(path, &["info", "log.csv", "--correlation", "--columns", "r,opposite"]).ok().out;
    assert!(text.contains("-1.000 r and opposite"), "{text}");
    let report = fleetfoot(path, &["info", "log.csv", "--lag", "r,v", "--reach", "20", "--json"]).ok().json();
    assert_eq!([&report["nearest"], &report["alike"]], [&serde_json::json!(7), &serde_json::json!(7)]);
    let shift = report["shifts"].as_array().unwrap().iter().find(|entry| entry["rows"] == 7).unwrap();
    assert!(shift["difference"].as_f64().unwrap() < 1e-12 && shift["pairs"] == 1493, "{shift}");
    let short = fleetfoot(path, &["info", "log.csv", "--lag", "r,v", "--reach", "3"]).ok();
    assert!(short.err.contains("the lag may be longer"), "{}", short.err);
    fleetfoot(path, &["info", "log.csv", "--correlation", "--columns", "r,speed"]).fails(&["speed"]);
    fleetfoot(path, &["info", "log.csv", "--lag", "r,v", "--reach", "5000"]).fails(&["1500 rows"]);
}
