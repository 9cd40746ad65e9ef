//! Filters find the noise of processes and sensors from their innovations, where simulations know it.

use fleetfoot_control::filter::{FilterOptions, Measured, ProcessFactor, SwitchedFilter};
use fleetfoot_model::{Partition, Prediction, Role};

use crate::{
    common::*,
    filters::{jumping, measured, normal, simulated},
};

#[test]
fn process_noise_is_estimated_from_innovations() {
    // The model knows a quarter of the noise.
    let (model, quieter) = (jumping(0.0, 0.1), jumping(0.0, 0.05));
    let filter =
        |process| SwitchedFilter::new(&quieter, &FilterOptions { process, ..measured(&[("x", 0.1)]) }).unwrap();
    let inputs: Vec<Vec<f64>> = (0..4000).map(|row| vec![(0.05 * f64::from(row)).sin()]).collect();
    let truth = simulated(&model, &[0.0, 0.0], &inputs, &[0.1, 0.1], 5);
    let reading = |row: usize| [truth[row][0] + 0.1 * normal(row as u64 + (1 << 42))];
    let run = |filter: &SwitchedFilter| {
        let mut track = filter.start(&reading(0), &[f64::NAN]);
        let mut likelihood = 0.0;
        for row in 1..=4000 {
            filter.step(&mut track, &inputs[row - 1], 0.01, &reading(row), &[f64::NAN]);
            likelihood += track.log_likelihood();
        }
        (track.process(), likelihood)
    };
    let (factor, likelihood) = run(&filter(ProcessFactor::Estimated));
    assert!((factor / 4.0 - 1.0).abs() < 0.15, "{factor}");
    assert!(likelihood > run(&filter(ProcessFactor::default())).1);
}

#[test]
fn sensor_noise_is_estimated_from_innovations() {
    let model = jumping(0.0, 0.05);
    let options =
        FilterOptions { measured: vec![Measured { state: "x".into(), deviation: None }], ..FilterOptions::default() };
    let filter = SwitchedFilter::new(&model, &options).unwrap();
    let inputs: Vec<Vec<f64>> = (0..4000).map(|row| vec![(0.05 * f64::from(row)).sin()]).collect();
    let truth = simulated(&model, &[0.0, 0.0], &inputs, &[0.05, 0.05], 3);
    let reading = |row: usize| [truth[row][0] + 0.2 * normal(row as u64 + (1 << 41))];
    let mut track = filter.start(&reading(0), &[f64::NAN]);
    for row in 1..=4000 {
        filter.step(&mut track, &inputs[row - 1], 0.01, &reading(row), &[f64::NAN]);
    }
    let deviation = track.estimated_deviation(&filter, 0);
    assert!((deviation / 0.2 - 1.0).abs() < 0.06, "{deviation}");
}

/// A sensor that is far quieter than the prior of the states: rows before which the velocity was unknown are no measure
/// of its noise.
#[test]
fn noise_of_a_quiet_sensor_is_estimated_from_unknown_states() {
    let columns = ["x", "v"].map(|name| column(name, Role::State, false));
    let fitted = vec![
        ("x", Prediction::Next, "lead(x, 1)", vec![(0.0, vec![1.0, 0.01])]),
        ("v", Prediction::Next, "lead(v, 1)", vec![(0.0, vec![-0.2, 0.98])]),
    ];
    let mut model = model(columns.to_vec(), &["x", "v"], Partition::whole(), fitted, &[]);
    let process = [1e-4, 1e-3];
    model.summaries[0].regions[0].residual_covariance = vec![1e-8, 0.0, 1e-6];
    for (deviation, seed) in [(5e-4, 1), (5e-3, 2), (5e-2, 3)] {
        let options = FilterOptions {
            measured: vec![Measured { state: "x".into(), deviation: None }],
            ..FilterOptions::default()
        };
        let filter = SwitchedFilter::new(&model, &options).unwrap();
        let truth = simulated(&model, &[0.3, -1.0], &vec![Vec::new(); 4000], &process, seed);
        let reading = |row: usize| [truth[row][0] + deviation * normal(row as u64 + (seed << 41))];
        let mut track = filter.start(&reading(0), &[f64::NAN]);
        let mut squares = 0.0;
        for row in 1..=4000 {
            filter.step(&mut track, &[], 0.01, &reading(row), &[f64::NAN]);
            squares += track.nis().0;
        }
        // 4000 squares tell a deviation to 1.1 %, and somewhat less where it is a small share of the innovations.
        let estimate = track.estimated_deviation(&filter, 0);
        assert!((estimate / deviation - 1.0).abs() < 0.06, "{deviation}: {estimate}");
        // The guess of the first rows is too large for the quietest one.
        assert!((0.7..1.1).contains(&(squares / 4000.0)), "{deviation}: {squares}");
    }
}
