//! A quadrotor on its log: the thrust of a motor behind its lag, and two moments of inertia. The data are not part of the project; figures from
//! their description.
//!
//! The published analysis cuts the log first, and starts every lag at its input there. It holds the motor command of a
//! row over the step that ends there, and differentiates the gyro by the second-order difference for uneven steps. It
//! regresses torque on angular acceleration through the origin.

use std::{fs, path::Path};

use fleetfoot_data::ScalarBuffer;

use super::*;

/// Mass, kg; distance of the motors from the axes of roll and pitch, m.
const MASS: f64 = 0.027;
const ARM: f64 = 0.028;

/// The rows of a file between two times; `None`, and a word about it, where the file is absent.
fn log(file: &str, from: f64, to: f64) -> Option<MemorySource> {
    let folder = std::env::var_os("FLEETFOOT_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), Into::into);
    let Ok(text) = fs::read_to_string(folder.join(file)) else {
        eprintln!("skipped: {file} is not in {} (set FLEETFOOT_DATA)", folder.display());
        return None;
    };
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').skip(1).collect();
    let mut time = Vec::new();
    let mut columns = vec![Vec::new(); names.len()];
    for line in lines {
        let values: Vec<f64> = line.split(',').map(|value| value.parse().unwrap()).collect();
        if from < values[0] && values[0] < to {
            time.push((1e9 * values[0]).round() as i64);
            columns.iter_mut().zip(&values[1..]).for_each(|(column, &value)| column.push(value));
        }
    }
    let mut source = MemorySource::new(names.into_iter().map(Column::float).collect());
    source.push(file, ScalarBuffer::from(time), columns.into_iter().map(ScalarBuffer::from).collect());
    Some(source)
}

/// The command of motor k behind its lag: held over the step that ends at its row.
fn motor(k: usize, tau: &str) -> String {
    format!("lag1(lead(m{k}, 1), {tau})")
}

fn thrust(scale: f64, tau: &str) -> LinearTarget {
    let sum = |power: &str| (1..=4).map(|k| motor(k, tau) + power).collect::<Vec<_>>().join(" + ");
    let functions = [parse("4"), parse(&sum("")), parse(&sum("^2"))].to_vec();
    LinearTarget::new(parse(&format!("{}*acc_z_mps2", MASS * scale)), functions)
}

fn near(value: f64, figure: f64, what: &str) {
    println!("{what}: {value} beside {figure}, {:.1e} of it", value / figure - 1.0);
    assert!((value / figure - 1.0).abs() < 1e-3, "{what}: {value} {figure}");
}

#[test]
fn thrust_curve_at_given_and_free_lag() {
    let Some(source) = log("crazyflie-thrust.csv", 35.0, 65.0) else { return };
    let fixed = [Parameter::new("tau", 0.0716).between(0.0716, 0.0716)];
    let given = solve(&[thrust(9.18 / 9.81, "tau")], &fixed, &source);
    for (coefficient, figure) in given.targets[0].coefficients.iter().zip([0.021262, -0.011167, 0.120127]) {
        near(*coefficient, figure, "at the given lag");
    }
    let free = [Parameter::new("tau", 0.05).between(0.01, 0.3)];
    let options = SeparableOptions { starts: 8, descents: 2, ..SeparableOptions::default() };
    let options = SeparableOptions { iteration: Options { chunk_rows: 2_048, ..options.iteration }, ..options };
    let solution = separable(&[thrust(1.0, "tau")], &free, &source, &options, &Silent).unwrap();
    assert!(solution.estimate.status.converged() && solution.estimate.gradient < 1e-9, "{:?}", solution.estimate);
    let tau = solution.parameter("tau").unwrap();
    println!(
        "tau = {tau} s, clustered {:?}, rms {} N, {} steps",
        solution.estimate.clustered_errors(),
        solution.targets[0].rms,
        solution.estimate.iterations
    );
    near(tau.value, 0.074_064, "the free lag, by a scalar search over the same sum of squares");
    // The figures belong to 0.074 s, the lag rounded: the minimum is flat.
    let rounded = [Parameter::new("tau", 0.074).between(0.074, 0.074)];
    let rounded = solve(&[thrust(1.0, "tau")], &rounded, &source);
    for (coefficient, figure) in rounded.targets[0].coefficients.iter().zip([0.02248, -0.01135, 0.12818]) {
        near(*coefficient, figure, "at 0.074 s, unscaled");
    }
    assert!((tau.value - 0.074).abs() < 5e-4 && rounded.targets[0].rms / solution.targets[0].rms - 1.0 < 1e-5);
}

#[test]
fn both_inertias() {
    let Some(source) = log("crazyflie-roll-pitch.csv", 55.0, 90.0) else { return };
    let force = |k: usize| format!("(0.021262 - 0.011167*{0} + 0.120127*{0}^2)", motor(k, "0.0716"));
    // The second-order difference for steps that differ: the two one-sided ones, each by the length of the other's step.
    let difference = |x: &str| {
        let (behind, ahead) = ("(time() - lag(time(), 1))", "(lead(time(), 1) - time())");
        format!("(backward({x})*{ahead} + forward({x})*{behind})/({behind} + {ahead})")
    };
    let inertia = |signs: [&str; 4], gyro: &str| {
        let sum: Vec<String> = (1..=4).map(|k| signs[k - 1].to_owned() + &force(k)).collect();
        let target = parse(&format!("{ARM}*(0 {})", sum.join(" ")));
        Residual::new(target, Expr::column("I") * parse(&difference(gyro)))
    };
    let fit = |residual: Residual| {
        let parameters = [Parameter::new("I", 1e-5)];
        let estimate =
            nonlinear_least_squares(&[residual], &parameters, &source, &Options::default(), &Silent).unwrap();
        println!("I = {} kg m2, clustered {:?}", estimate.uncertain("I").unwrap(), estimate.clustered_errors());
        estimate.values[0]
    };
    near(fit(inertia(["-", "-", "+", "+"], "gyro_x_rads")), 1.0285e-5, "roll");
    near(fit(inertia(["-", "+", "+", "-"], "gyro_y_rads")), 1.0876e-5, "pitch");
}
