//! Agreement with scipy, where `FLEETFOOT_PYTHON` names a Python that has it.

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use fleetfoot_signal::{Interpolant, Interpolation, Lambda, Sections, Spline, decimate, savitzky_golay, smooth};

use crate::{
    common::{distance, normal, uniform},
    outside,
};

/// Rows `t y w`, and the file that has them.
struct Rows {
    times: Vec<f64>,
    values: Vec<f64>,
    weights: Vec<f64>,
    folder: tempfile::TempDir,
}

impl Rows {
    fn new(rows: u64) -> Self {
        let times: Vec<f64> = (0..rows).map(|row| row as f64 + 0.8 * uniform(1, row)).collect();
        let value = |(t, row): (&f64, u64)| 5.0 + (0.01 * t).sin() + 0.1 * normal(2, row);
        let values: Vec<f64> = times.iter().zip(0..).map(value).collect();
        let weights: Vec<f64> = (0..rows).map(|row| 0.5 + uniform(3, row)).collect();
        let folder = tempfile::tempdir().unwrap();
        let line = |row: usize| format!("{:?} {:?} {:?}\n", times[row], values[row], weights[row]);
        fs::write(folder.path().join("rows"), (0..times.len()).map(line).collect::<String>()).unwrap();
        Self { times, values, weights, folder }
    }

    fn ask(&self, python: &OsStr, work: &str, arguments: &[f64]) -> Vec<f64> {
        let output = Command::new(python)
            .arg(script())
            .arg(work)
            .arg(self.folder.path().join("rows"))
            .args(arguments.iter().map(|argument| format!("{argument:?}").trim_end_matches(".0").to_owned()))
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stdout).lines().map(|line| line.parse().unwrap()).collect()
    }
}

fn script() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/peers/signals.py")
}

#[test]
fn scipy_agrees() {
    let Some(python) = outside::python("numpy, scipy.signal, scipy.interpolate") else { return };
    splines(&python);
    filters(&python);
    interpolations(&python);
}

/// The peer solves a banded system in coefficients of B-splines, whose condition grows with the penalty: its own digits are what is left of 1e-8.
fn splines(python: &OsStr) {
    let rows = Rows::new(2000);
    for lambda in [1e-3, 1.0, 1e3, 1e6] {
        let answer = rows.ask(python, "spline", &[lambda]);
        let spline =
            smooth(&rows.times, &rows.values, Some(&rows.weights), Spline::Cubic, Lambda::Given(lambda)).unwrap();
        let (values, slopes) = answer.split_at(rows.times.len());
        let apart = (distance(&spline.derivatives[0], values), distance(&spline.derivatives[1], slopes));
        assert!(apart.0 < 1e-8 && apart.1 < 1e-8, "lambda {lambda}: {apart:?}");
    }
}

fn filters(python: &OsStr) {
    let rows = Rows::new(2000);
    let check = |values: Vec<f64>, work: &str, arguments: &[f64], tolerance: f64| {
        let apart = distance(&values, &rows.ask(python, work, arguments));
        assert!(apart < tolerance, "{work} {arguments:?}: {apart:e}");
    };
    for (window, degree, derivative) in [(5, 2, 0), (11, 3, 1), (21, 5, 2), (51, 4, 3), (7, 6, 0)] {
        let filtered = savitzky_golay(&rows.values, 0.5, window, degree, derivative).unwrap();
        let arguments = [window as f64, degree as f64, derivative as f64, 0.5];
        // The peer solves for its weights by least squares in powers of the row, and loses digits that depend on its linear algebra: exact arithmetic has them.
        check(filtered.clone(), "savgol", &arguments, 1e-10);
        check(filtered, "savgol_exact", &arguments, 1e-12);
    }
    for (order, cutoff) in [(1, 10.0), (2, 0.5), (4, 100.0), (5, 30.0), (8, 20.0)] {
        let filtered = Sections::butterworth(order, cutoff, 1000.0).unwrap().zero_phase(&rows.values).unwrap();
        check(filtered, "butterworth", &[order as f64, cutoff, 1000.0], 1e-10);
    }
    for (order, cutoff) in [(3, 100.0), (8, 40.0)] {
        let filtered = Sections::chebyshev(order, 0.5, cutoff, 1000.0).unwrap().zero_phase(&rows.values).unwrap();
        check(filtered, "chebyshev", &[order as f64, 0.5, cutoff, 1000.0], 1e-10);
    }
    for factor in [2, 10] {
        check(decimate(&rows.values, factor).unwrap(), "decimate", &[factor as f64], 1e-10);
    }
}

/// Values and slopes at the stamps and between them, over steps that differ by up to nine times.
fn interpolations(python: &OsStr) {
    let rows = Rows::new(2000);
    let at: Vec<f64> = rows.times.windows(2).flat_map(|pair| [pair[0], 0.7 * pair[0] + 0.3 * pair[1]]).collect();
    for (kind, work) in [(Interpolation::NotAKnot, "not_a_knot"), (Interpolation::ShapePreserving, "pchip")] {
        let [values, slopes, seconds] = Interpolant::new(&rows.times, &rows.values, kind).unwrap().all(&at);
        let answer = rows.ask(python, work, &[]);
        for (values, other) in [values, slopes, seconds].iter().zip(answer.chunks(at.len())) {
            let apart = distance(values, other);
            assert!(apart < 1e-12, "{work}: {apart:e}");
        }
    }
}
