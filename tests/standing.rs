//! Baselines beside the candidates of a fit, and fits to few rows.

use std::fs;

use crate::runner::*;

/// Uniform in [-1, 1), by counting.
fn uniform(key: u64) -> f64 {
    let mut z = key.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ (z >> 31)) as f64 / (u64::MAX / 2) as f64 - 1.0
}

/// `y(k+1) = a y + b u + c`, one map below, between and above two lines.
const MODES: [[f64; 3]; 3] = [[-0.4, 1.0, 1.5], [0.5, -1.0, -0.5], [-0.3, 0.5, -1.7]];

/// 58 rows of them.
fn three_modes(draw: u64) -> String {
    let (mut y, mut text) = (0.0, String::from("y,u\n"));
    for k in 0..59 {
        let u = 4.0 * uniform(1000 * draw + 2 * k);
        text.push_str(&format!("{y:?},{u:?}\n"));
        let mode = if 4.0 * y - u + 10.0 < 0.0 { 0 } else { 1 + usize::from(5.0 * y + u - 6.0 > 0.0) };
        let [a, b, c] = MODES[mode];
        y = a * y + b * u + c + 0.05 * uniform(1000 * draw + 2 * k + 1);
    }
    text
}

/// Without an option for partitions, few rows are cut into regions that fit the dynamics. Over the draws 0 to 11 they find 33 of 36 modes, k-means alone a quarter; two draws are
/// enough here.
#[test]
fn modes_are_identified_from_58_rows() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut count = 0;
    for draw in [1, 7] {
        fs::write(folder.path().join("few.csv"), three_modes(draw)).expect("a log");
        let text = "fit pwa few.csv --dt 1 --states y --inputs u --predict next --partition-on y,u -o few.json --json";
        let report = fleetfoot(folder.path(), &text.split(' ').collect::<Vec<_>>()).ok().json();
        let names: Vec<&str> = (report["candidates"].as_array().expect("candidates").iter())
            .filter_map(|candidate| candidate["partition"].as_str())
            .collect();
        // Ten regions have 30 numbers a target, and there are 58 rows.
        assert!(
            names.contains(&"refined:3") && names.contains(&"kmeans:5") && !names.contains(&"kmeans:10"),
            "{names:?}"
        );
        let text = fs::read_to_string(folder.path().join("few.json")).expect("a model");
        let model: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let latent = &model["model"]["latents"][0];
        let number = |value: &serde_json::Value| value.as_f64().unwrap_or(f64::NAN);
        let maps: Vec<[f64; 3]> = (latent["coefficients"].as_array().expect("regions").iter())
            .zip(latent["constants"].as_array().expect("regions"))
            .map(|(coefficients, constant)| [number(&coefficients[0]), number(&coefficients[1]), number(constant)])
            .collect();
        let near = |mode: &[f64; 3], map: &[f64; 3]| mode.iter().zip(map).all(|(a, b)| (a - b).abs() < 0.2);
        count += MODES.iter().filter(|mode| maps.iter().any(|map| near(mode, map))).count();
    }
    assert_eq!(count, 6, "modes of two draws");
}

/// Mean and persistence stand in the tables of all methods. For a model that is worth no more, the last note has the command to type.
#[test]
fn baselines_stand_beside_candidates() {
    let folder = tempfile::tempdir().expect("a folder");
    // A random walk: the row before is the best prediction, and u carries no information.
    let (mut y, mut walk, mut noise) = (0.0, String::from("t,y,u\n"), String::from("t,y,u\n"));
    for k in 0..600 {
        let u = uniform(5 * k);
        walk.push_str(&format!("{:.2},{y:?},{u:?}\n", k as f64 * 0.01));
        noise.push_str(&format!("{:.2},{:?},{u:?}\n", k as f64 * 0.01, uniform(5 * k + 1)));
        y += uniform(5 * k + 2);
    }
    fs::write(folder.path().join("walk.csv"), walk).expect("a log");
    fs::write(folder.path().join("noise.csv"), noise).expect("a log");
    let fit = |text: &str| fleetfoot(folder.path(), &text.split(' ').collect::<Vec<_>>()).ok();
    let output = fit("fit pwa walk.csv --time t --states y --inputs u --predict next --partition average -o walk.json");
    assert!(output.out.contains("(mean)") && output.out.contains("(persistence)"), "{}", output.out);
    assert!(output.out.contains("held out by time, the last"), "{}", output.out);
    let report =
        fit("fit pwa walk.csv --time t --states y --inputs u --predict next --partition average --json").json();
    let baseline = &report["baselines"][0];
    let before = baseline["persistence_rmse"].as_f64().unwrap_or(f64::NAN);
    assert!((before - (1.0_f64 / 3.0).sqrt()).abs() < 0.03, "steps of uniform deviation: {baseline}");
    let output = fit("fit sindy noise.csv --time t --states y --inputs u --predict next --degree 1 -o noise.json");
    assert!(output.out.contains("mean (rms)") && output.out.contains("persistence (rms)"), "{}", output.out);
    let output =
        fit("fit pwa noise.csv --time t --states y --inputs u --predict next --partition kmeans:20 -o noise.json");
    let notes: Vec<&str> = output.err.lines().filter(|line| line.starts_with("note: ")).collect();
    let last = notes.last().copied().unwrap_or_default();
    assert!(last.contains("no better than their mean") && last.contains("`fleetfoot check`"), "{}", output.err);
    let output =
        fit("fit narx noise.csv --time t --outputs y --inputs u --lags-out 1 --lags-in 1 --degree 1 -o noise.json");
    assert!(output.out.contains("(mean)"), "{}", output.out);
}

/// A machine that changes at the end: spans between its rows do not see it, the last rows do.
#[test]
fn late_changes_are_held_out_by_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let (mut y, mut text) = (0.0, String::from("y,u\n"));
    for k in 0..2000 {
        let u = uniform(3 * k);
        text.push_str(&format!("{y:?},{u:?}\n"));
        let gain = if k < 1600 { 1.0 } else { -1.0 };
        y = 0.5 * y + gain * u + 0.05 * uniform(3 * k + 1);
    }
    fs::write(folder.path().join("late.csv"), text).expect("a log");
    let text = "fit pwa late.csv --dt 1 --states y --inputs u --predict next --partition average --json";
    let report = fleetfoot(folder.path(), &text.split(' ').collect::<Vec<_>>()).ok().json();
    let (spans, time) = (&report["candidates"][0]["r2"][0], &report["by_time"]["targets"][0]["share"]);
    let (spans, time) = (1.0 - spans.as_f64().unwrap_or(f64::NAN), time.as_f64().unwrap_or(f64::NAN));
    assert_eq!(report["by_time"]["rows"], 399);
    assert!(time > 2.5 && spans < 1.0, "{time} by time, {spans} by spans");
}
