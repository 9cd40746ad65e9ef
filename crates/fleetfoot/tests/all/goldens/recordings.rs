//! Recordings of real machines, and of one simulated hybrid; `outside.rs` tells where they are looked for.

use std::path::PathBuf;

use fleetfoot::{FitReport, FitRequest, Narx, Pwa, Recipe, Silent, Sindy, Sparse, fit, fit_all};

use super::{
    book::{Entry, check},
    recipe,
};
use crate::outside::data;

/// A robot with two regions that are given, exact.
const HYBRID: &str = r#"
    [states]
    x = { derivative = "dx", regressor = false }
    phi = { derivative = "dphi", regressor = false }
    xd = { derivative = "ddx" }
    phid = { derivative = "ddphi" }
    [inputs]
    u1 = "u1"
    u2 = "u2"
    [time]
    column = "t"
    [model]
    partition = "average,labels:region,kmeans:2"
"#;

/// A quadrotor in wind.
const QUADROTOR: &str = r#"
    [columns]
    Tx = "R_13*T_sp"
    Ty = "R_23*T_sp"
    Tz = "R_33*T_sp"
    [states]
    v_x = { derivative = "forward" }
    v_y = { derivative = "forward" }
    v_z = { derivative = "forward" }
    [inputs]
    Tx = "Tx"
    Ty = "Ty"
    Tz = "Tz"
"#;

/// A damper with hysteresis.
const DAMPER: &str = r#"
    columns = { s = "sign(v)" }
    states = { f = {} }
    inputs = { E = "E", v = "v", s = "s" }
    time = { dt = 0.002 }
    narx = { lags_out = 1, lags_in = 1, terms = 15, test_share = 0.5 }
    model = { degree = 3 }
"#;

/// Fit to one of the recordings.
struct Case {
    name: &'static str,
    file: &'static str,
    recipe: &'static str,
    fit: fn(&mut Entry, &Recipe, &[PathBuf]),
}

const CASES: [Case; 5] = [
    Case { name: "fit pwa: a hybrid", file: "hybrid-diff-drive.csv", recipe: HYBRID, fit: pwa },
    Case { name: "fit pwa: a quadrotor", file: "neural-fly/35wind.csv", recipe: QUADROTOR, fit: pwa },
    Case { name: "fit sindy: a quadrotor", file: "neural-fly/35wind.csv", recipe: QUADROTOR, fit: sindy },
    Case { name: "fit sparse: a quadrotor", file: "neural-fly/70wind.csv", recipe: QUADROTOR, fit: sparse },
    Case { name: "fit narx: a damper", file: "bouc-wen.csv", recipe: DAMPER, fit: narx },
];

fn pwa(entry: &mut Entry, recipe: &Recipe, logs: &[PathBuf]) {
    let fitted = fit::<Pwa>(recipe, &FitRequest::default(), logs, &Silent).unwrap();
    let report = fitted.report.to_json();
    entry.model(&fitted.model);
    entry.report("report", &report);
    entry.field("loss", &report, "candidates/*/loss");
    entry.field("mae over null", &report, "candidates/*/mae_over_null/*");
    entry.score(&fitted.model, logs);
}

fn sindy(entry: &mut Entry, recipe: &Recipe, logs: &[PathBuf]) {
    let fitted = fit::<Sindy>(recipe, &FitRequest::default(), logs, &Silent).unwrap();
    let report = fitted.report.to_json();
    entry.model(&fitted.model);
    entry.report("report", &report);
    entry.field("rms", &report, "regions/*/equations/*/rms");
    entry.field("held out", &report, "regions/*/equations/*/held_out_rms");
    entry.rollouts(&fitted.model, logs);
}

fn sparse(entry: &mut Entry, recipe: &Recipe, logs: &[PathBuf]) {
    let fitted = fit_all::<Sparse>(recipe, &FitRequest::default(), logs, &Silent).unwrap();
    let report = fitted[0].report.to_json();
    entry.model(&fitted[0].model);
    entry.report("report", &report);
    entry.field("lambda", &report, "lambda/value");
    entry.field("held out", &report, "tasks/*/held_out_rms");
}

fn narx(entry: &mut Entry, recipe: &Recipe, logs: &[PathBuf]) {
    let fitted = fit::<Narx>(recipe, &FitRequest::default(), logs, &Silent).unwrap();
    let report = fitted.report.to_json();
    entry.model(&fitted.model);
    entry.report("report", &report);
    entry.field("one step", &report, "train/one_step/*/rmse");
    entry.field("free run", &report, "test/free_run/*/rrse");
}

#[test]
fn models_of_recordings_equal_goldens() {
    let mut entries = Vec::new();
    for case in &CASES {
        let Some(file) = data(case.file) else { return };
        let mut entry = Entry::new(case.name);
        (case.fit)(&mut entry, &recipe(case.recipe), &[file]);
        entries.push(entry);
    }
    check("recordings.txt", "all methods on recordings", entries);
}
