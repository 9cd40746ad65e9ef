//! A gyroscope without an accelerometer, and Student's loss.

use super::{
    Recording, known, options, problem,
    simulation::{LEVER, OFFSET},
};
use crate::{
    Loss, SignalError,
    fuse::{BodyRun, FuseOptions, ImuRecord, Prior, fuse, problem::STEPS, rotation::Vector, state::StateError},
};

/// The run without its forces.
fn alone(recording: &Recording) -> BodyRun<'_> {
    let run = recording.run();
    BodyRun { imu: ImuRecord { forces: &[], ..run.imu }, ..run }
}

/// The lever is given: nothing tells it.
fn given() -> FuseOptions {
    FuseOptions { lever: LEVER.into(), fit_noise: true, ..known() }
}

/// Attitude, bias and offset are known as with an accelerometer; position, velocity and acceleration by the chain. Errors are as large as stated.
#[test]
fn motion_is_estimated_from_gyroscope_and_poses() {
    let recording = Recording::new(8.0, 8);
    let fused = fuse(&[alone(&recording)], &given()).unwrap();
    assert!(fused.converged);
    let offset = fused.constants.offset;
    assert!((offset.value - OFFSET).abs() < 3.5 * offset.deviation && offset.deviation < 8e-4, "{offset:?}");
    let noise = fused.noise;
    let ratios =
        [Vector::from(noise.imu.gyro).norm() / 1e-3 / 3.0_f64.sqrt(), noise.position / 1e-3, noise.attitude / 3e-3];
    assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.15), "{ratios:?} {}", noise.jerk);
    let states = &fused.tracks[0].states;
    let mut squares = StateError::zeros();
    for state in &states[20..states.len() - 20] {
        let score = recording.alone_error(state).component_div(&StateError::from(state.deviations));
        squares += score.component_mul(&score);
    }
    let rms = (squares / (states.len() - 40) as f64).map(f64::sqrt);
    // The motion is no white jerk, so that errors of the acceleration are what its density says in the mean alone.
    assert!(rms.max() < 2.0 && rms.min() > 0.2, "{rms}");
    // Between the nodes the chain goes on.
    let imu = ImuRecord { forces: &[], ..recording.imu() };
    let time = 0.5 * (states[300].time + states[301].time);
    let state = fused.tracks[0].at(&imu, fused.constants.gravity, &fused.noise, time).unwrap();
    let error = recording.alone_error(&state);
    assert!(error.fixed_rows::<3>(3).norm() < 3e-3 && error.fixed_rows::<3>(0).norm() < 5e-3, "{error}");
}

/// At the solution the cost has no slope along any unknown.
#[test]
fn the_solution_without_forces_is_the_least() {
    let recording = Recording::new(0.6, 4);
    let options = FuseOptions { fit_noise: false, ..given() };
    let mut problem = problem(&[alone(&recording)], &options);
    problem.options.gravity.deviation = 0.0;
    problem.setting.biases[1].deviation = f64::INFINITY;
    problem.setting.noise.jerk = 30.0;
    problem.descend(STEPS).unwrap();
    problem.move_nodes();
    assert!((0..20).any(|_| problem.descend(STEPS).unwrap().converged));
    let whole = problem.whole().unwrap();
    let spread = problem.spread(&whole, |_, _, joint| joint.node.diagonal()).unwrap();
    let states = problem.tracks[0].states.clone();
    let mut worst: f64 = 0.0;
    for node in 0..states.len() {
        for i in 0..15 {
            let h = 1e-4 * spread[0][node][i].sqrt();
            let of = |h: f64| {
                let mut moved = states.clone();
                moved[node] = moved[node].moved(&StateError::ith(i, h));
                problem.cost(&[moved], &problem.border).unwrap()
            };
            worst = worst.max(((of(h) - of(-h)) / 2e-4).abs());
        }
    }
    assert!(worst < 1e-4, "{worst:e}");
}

#[test]
fn parameters_undetermined_without_forces_are_refused() {
    let recording = Recording::new(2.0, 1);
    let lever = Prior { value: [0.0; 3], deviation: f64::INFINITY };
    let error = fuse(&[alone(&recording)], &FuseOptions { lever, ..given() }).unwrap_err();
    assert!(error.to_string().contains("the lever cannot be estimated"), "{error}");
    let error = fuse(&[alone(&recording), recording.run()], &given()).unwrap_err();
    assert!(
        matches!(error, SignalError::NotFused { .. }) && error.to_string().contains("fuse the two kinds separately"),
        "{error}"
    );
}

/// Under Student's loss gross errors count next to nothing without a gate, and what is found is what is found without them.
#[test]
fn student_loss_rejects_outliers_without_a_gate() {
    let mut recording = Recording::new(3.0, 3);
    let student = FuseOptions { loss: Loss::Student(4.0), gate: 0.0, ..options() };
    let clean = fuse(&[recording.run()], &student).unwrap();
    for row in (40..250).step_by(37) {
        recording.positions[row][row % 3] += 0.05 * if row % 2 == 0 { 1.0 } else { -1.0 };
    }
    let fused = fuse(&[recording.run()], &student).unwrap();
    assert!(clean.converged && fused.converged);
    let pairs = clean.tracks[0].states.iter().zip(&fused.tracks[0].states);
    let apart = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let worst = pairs.map(|(a, b)| apart(&a.position, &b.position)).fold(0.0, f64::max);
    assert!(worst < 1e-3, "{worst}");
    assert!(fused.tracks[0].positions_rejected.is_empty());
}
