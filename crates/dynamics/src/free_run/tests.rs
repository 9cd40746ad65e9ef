//! Free runs beside a plain loop over the rows.

use fleetfoot_data::{Column as DataColumn, MemorySource, Silent, with_threads};
use fleetfoot_library::Expr;
use fleetfoot_model::{AffineMap, Column, Equation, Latent, Model, Partition, Prediction, Role, Training};

use super::*;

/// `next(y) = b0 + b . (y, y(-1), u)`.
fn model(b: [f64; 4]) -> Model {
    let column = |name: &str, role| Column::new(name, role);
    let columns = vec![column("y", Role::State), column("u", Role::Input)];
    let mut model = Model::new("narx", columns, 0.01, Training::default());
    let (y, u) = (Expr::column("y"), Expr::column("u"));
    model.libraries = vec![vec![y.clone(), y.shifted(1), u]];
    model.add_partition(Partition::whole(), Vec::new());
    model.latents = vec![Latent {
        beyond: Vec::new(),
        name: "f_y".into(),
        library: 0,
        partition: 0,
        map: AffineMap { constants: vec![b[0]], coefficients: vec![b[1..].to_vec()] }.into(),
    }];
    model.equations = vec![Equation {
        subject: "y".into(),
        prediction: Prediction::Next,
        right: Expr::column("f_y"),
        target: Some(y.shifted(-1)),
        unit: None,
    }];
    model.summaries[0].regions = vec![fleetfoot_model::RegionSummary {
        name: "all".into(),
        rows: 100,
        mean: vec![0.0; 3],
        covariance: vec![0.0; 6],
        range: vec![[-10.0, 10.0]; 3],
        residual_covariance: vec![0.1],
        rank: 3,
        condition: 1.0,
        confounded: Vec::new(),
    }];
    model.training.target_mean = vec![0.25];
    model.training.target_covariance = vec![1.0];
    model.training.target_deviation = vec![1.0];
    model.training.state_covariance = vec![1.0];
    model
}

const TRUTH: [f64; 4] = [0.1, 1.2, -0.5, 0.7];

fn recording(rows: usize, phase: f64) -> (Vec<f64>, Vec<f64>) {
    let u: Vec<f64> = (0..rows).map(|k| (0.37 * k as f64 + phase).sin() + 0.3 * (0.051 * k as f64).cos()).collect();
    let mut y = vec![0.4, 0.5];
    for k in 1..rows - 1 {
        y.push(TRUTH[0] + TRUTH[1] * y[k] + TRUTH[2] * y[k - 1] + TRUTH[3] * u[k]);
    }
    (y, u)
}

fn source(episodes: &[(Vec<f64>, Vec<f64>)]) -> MemorySource {
    let mut source = MemorySource::new(vec![DataColumn::float("u"), DataColumn::float("y")]);
    for (y, u) in episodes {
        source.push_uniform("run", 0.01, vec![u.clone(), y.clone()]);
    }
    source
}

/// Rows `from..to` of a free run, by hand.
fn by_hand(b: [f64; 4], y: &[f64], u: &[f64], from: usize, to: usize) -> Vec<f64> {
    let mut run = vec![y[from - 1], y[from]];
    for &u in &u[from..to] {
        let k = run.len() - 1;
        run.push(b[0] + b[1] * run[k] + b[2] * run[k - 1] + b[3] * u);
    }
    run.split_off(2)
}

fn rrse(y: &[f64], yhat: &[f64]) -> f64 {
    let mean = y.iter().sum::<f64>() / y.len() as f64;
    let norm = |v: f64, w: f64| (v - w) * (v - w);
    let error: f64 = y.iter().zip(yhat).map(|(y, h)| norm(*y, *h)).sum();
    (error / y.iter().map(|y| norm(*y, mean)).sum::<f64>()).sqrt()
}

#[test]
fn free_run_errors_match_a_plain_loop() {
    let (y, u) = recording(400, 0.0);
    let source = source(&[(y.clone(), u.clone())]);
    let result = free_run(&model(TRUTH), &source, &FreeRunOptions::default(), &Silent).unwrap();
    assert_eq!(result.runs.len(), 1);
    assert_eq!((result.runs[0].start.row, result.runs[0].steps), (1, 398));
    assert!(result.outputs[0].errors.rrse < 1e-12);
    let wrong = [0.12, 1.1, -0.45, 0.8];
    let options = FreeRunOptions { keep: true, ..FreeRunOptions::default() };
    let result = free_run(&model(wrong), &source, &options, &Silent).unwrap();
    let run = by_hand(wrong, &y, &u, 1, 399);
    let errors = result.outputs[0].errors;
    assert!((errors.rrse - rrse(&y[2..], &run)).abs() < 1e-12, "{errors:?}");
    assert!((errors.fit - 100.0 * (1.0 - errors.rrse)).abs() < 1e-12);
    assert!((errors.persistence - rrse(&y[2..], &vec![y[1]; 398])).abs() < 1e-12);
    assert!((errors.null.unwrap() - rrse(&y[2..], &vec![0.25; 398])).abs() < 1e-12);
    assert_eq!(errors.rows, 398);
    let kept: Vec<f64> = (1..=398).map(|step| result.trajectories[0].state(step)[0]).collect();
    assert!(kept.iter().zip(&run).all(|(a, b)| (a - b).abs() < 1e-12));
}

#[test]
fn only_missing_inputs_end_a_run() {
    let (mut y, mut u) = recording(200, 0.4);
    u[50] = f64::NAN;
    y[100] = f64::NAN;
    let source = source(&[(y.clone(), u.clone())]);
    let wrong = [0.12, 1.1, -0.45, 0.8];
    let result = free_run(&model(wrong), &source, &FreeRunOptions::default(), &Silent).unwrap();
    let ends: Vec<_> = result.runs.iter().map(|run| (run.start.row, run.start.row + run.steps)).collect();
    // The step from row 50 needs the input of row 50.
    assert_eq!(ends, [(1, 50), (51, 199)]);
    assert_eq!(result.outputs[0].errors.rows, 49 + 148 - 1);
    let mut all: Vec<f64> = by_hand(wrong, &y, &u, 1, 50);
    all.extend(by_hand(wrong, &y, &u, 51, 199));
    let (measured, run): (Vec<f64>, Vec<f64>) =
        (2..=50).chain(52..200).map(|row| y[row]).zip(all).filter(|(y, _)| y.is_finite()).unzip();
    assert!((result.outputs[0].errors.rrse - rrse(&measured, &run)).abs() < 1e-12);
}

#[test]
fn a_horizon_starts_again_from_the_recording() {
    let (y, u) = recording(101, 0.2);
    let source = source(&[(y.clone(), u.clone())]);
    let wrong = [0.12, 1.1, -0.45, 0.8];
    let options = FreeRunOptions { horizon: Some(30), ..FreeRunOptions::default() };
    let result = free_run(&model(wrong), &source, &options, &Silent).unwrap();
    let ends: Vec<_> = result.runs.iter().map(|run| (run.start.row, run.steps)).collect();
    assert_eq!(ends, [(1, 30), (31, 30), (61, 30), (91, 9)]);
    let run: Vec<f64> =
        [(1, 31), (31, 61), (61, 91), (91, 100)].iter().flat_map(|&(a, b)| by_hand(wrong, &y, &u, a, b)).collect();
    assert!((result.outputs[0].errors.rrse - rrse(&y[2..], &run)).abs() < 1e-12);
}

#[test]
fn unstable_model_diverges_without_finite_score() {
    let (y, u) = recording(400, 0.0);
    let source = source(&[(y.clone(), u.clone())]);
    let unstable = [0.0, 2.0, 0.0, 0.0];
    let result = free_run(&model(unstable), &source, &FreeRunOptions::default(), &Silent).unwrap();
    // Doubling from 0.5: 1,000 standard deviations away after 11 steps.
    let lost = result.runs[0].lost_at.unwrap();
    assert_eq!((result.runs[0].end, lost), (End::Diverged, 12), "{:?}", result.runs[0]);
    assert!(result.outputs[0].errors.rrse.is_infinite() && result.outputs[0].errors.lost as usize == 400 - lost);
    let options = FreeRunOptions { divergence: f64::INFINITY, ..FreeRunOptions::default() };
    let result = free_run(&model(unstable), &source, &options, &Silent).unwrap();
    assert_eq!(result.runs[0].end, End::Horizon, "a double holds 2^398");
}

#[test]
fn threads_change_no_bit_and_short_episodes_are_counted() {
    let mut episodes: Vec<_> = (0..7).map(|i| recording(60 + 13 * i, i as f64)).collect();
    episodes.push((vec![1.0, 2.0], vec![0.0, 0.0]));
    let source = source(&episodes);
    let wrong = model([0.12, 1.1, -0.45, 0.8]);
    let run = || free_run(&wrong, &source, &FreeRunOptions::default(), &Silent).unwrap();
    let (one, three) = (with_threads(1, run), with_threads(3, run));
    assert_eq!(one, three);
    assert_eq!((one.runs.len(), one.skipped), (7, 1));
    let short = self::source(&[(vec![1.0, 2.0], vec![0.0, 0.0])]);
    let error = free_run(&wrong, &short, &FreeRunOptions::default(), &Silent).unwrap_err().to_string();
    assert!(error.contains("can start a free run") && error.contains('2'), "{error}");
}
