//! `frequency`: the response of a simulated stage equals its closed form, a model's lies within its interval, and dry
//! friction shows at odd multiples. Also refusals.

use std::f64::consts::TAU;

use crate::runner::*;

/// Seconds between rows, mass, viscous friction and force for a volt of the stage.
const STAGE: [f64; 4] = [0.005, 95.1, 203.5, 35.15];

/// Logs of a stage under an odd multisine of 4 s: two runs of 44 s.
fn stage(folder: &Path, dry: f64, name: &str) {
    let excitation = "excitation={kind = \"multisine\", deviation = 2.0, lowest = 0.25, highest = 20.0, odd = true}";
    let friction = format!("dry={dry}");
    let words = ["generate", "stage", "--runs", "2", "--seconds", "44", "--format", "parquet", "-o", name];
    let set = ["--set", excitation, "--set", &friction, "--set", "offset=0.0"];
    fleetfoot(folder, &[words.as_slice(), &set].concat()).ok();
}

/// `v[k+1] = a v[k] + b u[k]` with `a = exp(-c T/m)` and `b = g/c (1 - a)`: the stage without dry friction, its voltage
/// held from row to row.
fn closed_form(frequency: f64) -> [f64; 2] {
    let [step, mass, viscous, gain] = STAGE;
    let a = (-viscous * step / mass).exp();
    let b = gain / viscous * (1.0 - a);
    let turn = TAU * frequency * step;
    let [real, imaginary] = [turn.cos() - a, turn.sin()];
    let square = real * real + imaginary * imaginary;
    [b * real / square, -b * imaginary / square]
}

/// Frequencies, responses and radii of the excited lines.
fn excited(response: &serde_json::Value) -> Vec<(f64, [f64; 2], f64)> {
    let all = |name: &str| -> Vec<f64> {
        response[name].as_array().expect(name).iter().map(|value| value.as_f64().unwrap_or(f64::NAN)).collect()
    };
    let [frequency, real, imaginary, radius] = ["frequency", "real", "imaginary", "radius"].map(all);
    let is_excited = |at: &usize| response["excited"][at] == true;
    (0..frequency.len()).filter(is_excited).map(|at| (frequency[at], [real[at], imaginary[at]], radius[at])).collect()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[test]
fn responses_match_their_closed_form() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stage(path, 0.0, "linear");
    let words = ["frequency", "linear", "--input", "u", "--output", "qd", "--json"];
    // A period of the multisine: 800 rows. Beginnings decay by exp(-2.1 * 4) a period.
    let report = fleetfoot(path, &[words.as_slice(), &["--period", "4", "--skip", "3"]].concat()).ok().json();
    let lines = excited(&report["measured"]);
    assert!(lines.len() > 25, "{}", lines.len());
    for (frequency, value, _) in &lines {
        let truth = closed_form(*frequency);
        assert!(distance(*value, truth) < 1e-6 * truth[0].hypot(truth[1]), "{frequency}: {value:?} {truth:?}");
    }
    // Averaged spectra of a random excitation: leakage is a bias, which the window keeps small above the corner.
    let random = ["generate", "stage", "--seconds", "120", "--format", "parquet", "--excitation", "random-steps"];
    let set = ["--set", "dry=0.0", "--set", "offset=0.0", "-o", "random"];
    fleetfoot(path, &[random.as_slice(), &set].concat()).ok();
    let words_of_random = ["frequency", "random", "--input", "u", "--output", "qd", "--json", "--segment", "5"];
    let report = fleetfoot(path, &words_of_random).ok().json();
    assert_eq!(report["samples"], 1024);
    for (frequency, value, _) in excited(&report["measured"]).iter().filter(|line| line.0 > 1.0) {
        let truth = closed_form(*frequency);
        assert!(distance(*value, truth) < 0.05 * truth[0].hypot(truth[1]), "{frequency}: {value:?} {truth:?}");
    }
    // A linear stage moves at no other multiple.
    let report = fleetfoot(path, &[words.as_slice(), &["--period", "4", "--skip", "3"]].concat()).ok().json();
    let levels = &report["measured"]["distortion"];
    let level = |levels: &serde_json::Value, name: &str| {
        levels[name].as_f64().expect(name) / levels["excited"].as_f64().expect("excited")
    };
    assert!(level(levels, "odd") < 1e-6 && level(levels, "even") < 1e-6, "{levels}");
    // Dry friction is an odd function: odd multiples far above even ones.
    stage(path, 20.39, "dry");
    let words = ["frequency", "dry", "--input", "u", "--output", "qd", "--json", "--period", "4", "--skip", "3"];
    let report = fleetfoot(path, &words).ok().json();
    let levels = &report["measured"]["distortion"];
    assert!(level(levels, "odd") > 0.01 && level(levels, "odd") > 10.0 * level(levels, "even"), "{levels}");
}

#[test]
fn pages_show_model_and_log_responses() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stage(path, 0.0, "linear");
    let fit =
        ["fit", "pwa", "linear", "--states", "qd", "--inputs", "u", "--predict", "next", "--partition", "average"];
    fleetfoot(path, &[fit.as_slice(), &["-o", "model.json", "--quiet"]].concat()).ok();
    let words = ["frequency", "model.json", "linear", "--input", "u", "--output", "qd", "--period", "4", "--skip", "3"];
    let files = ["--page", "bode.html", "--svg", "figures", "--json"];
    let report = fleetfoot(path, &[words.as_slice(), &files].concat()).ok().json();
    for (frequency, value, _) in excited(&report["model"]) {
        let truth = closed_form(frequency);
        assert!(distance(value, truth) < 1e-4 * truth[0].hypot(truth[1]), "{frequency}: {value:?} {truth:?}");
    }
    let page = std::fs::read_to_string(path.join("bode.html")).expect("a page");
    assert!(page.contains("Frequency response") && page.contains("<svg"), "a page with figures");
    for figure in ["gain", "phase", "coherence"] {
        assert!(path.join(format!("figures/{figure}.svg")).is_file(), "{figure}");
    }
    let text = fleetfoot(path, &words).ok().out;
    assert!(text.contains("the model lies within the interval"), "{text}");
}

#[test]
fn requests_that_cannot_be_met_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    stage(path, 0.0, "linear");
    let refused = |options: &[&str], message: &str| {
        let words = ["frequency", "linear", "--input", "u", "--output", "qd"];
        fleetfoot(path, &[words.as_slice(), options].concat()).fails(&[message]);
    };
    refused(&["--period", "4.0021"], "whole number");
    refused(&["--period", "0.01"], "four samples");
    refused(&["--period", "4", "--skip", "20"], "the longest episode has");
    refused(&["--segment", "0.01"], "too short");
    fleetfoot(path, &["frequency", "linear", "--input", "volt", "--output", "qd"]).fails(&["volt"]);
}
