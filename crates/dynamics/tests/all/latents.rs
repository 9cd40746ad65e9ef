//! Models whose equations share latents, each with a separate library and partition, against hand-computed values.

use crate::common::{column, identity, parse, region, source};
use fleetfoot_data::{Silent, Source};
use fleetfoot_dynamics::{
    Method, Predicted, Predictor, PredictorWorkspace, RolloutOptions, RowStatus, ScoreOptions, Simulator, Starts, score,
};
use fleetfoot_model::{AffineMap, Equation, Latent, Model, Partition, Prediction, Role, Training};

/// `m v' = T cos(a) - D`, `w' = T sin(a)/m`, and the force along the path as a plain column: `force = T - D` with T = 2 + 3 a - a^2, D = 0.5 v^2.
fn shared() -> Model {
    let columns = vec![
        column("v", Role::State, false),
        column("w", Role::State, false),
        column("a", Role::Input, false),
        column("m", Role::Input, false),
        column("force", Role::Auxiliary, false),
    ];
    let training = Training {
        target_mean: vec![0.0; 3],
        target_covariance: identity(3, 1.0),
        target_deviation: vec![f64::NAN; 3],
        state_covariance: identity(2, 1.0),
        ..Training::default()
    };
    let mut model = Model::new("by hand", columns, 0.01, training);
    model.libraries = vec![vec![parse("a"), parse("a^2")], vec![parse("v"), parse("v^2"), parse("sin(v)")]];
    for (name, constant, coefficients) in [("T", 2.0, vec![3.0, -1.0]), ("D", 0.0, vec![0.0, 0.5, 0.0])] {
        let index = model.add_partition(Partition::whole(), vec![region("all", coefficients.len(), 3)]);
        model.latents.push(Latent {
            beyond: Vec::new(),
            name: name.into(),
            library: index,
            partition: index,
            map: AffineMap { constants: vec![constant], coefficients: vec![coefficients] }.into(),
        });
    }
    for (subject, prediction, right, target) in [
        ("v", Prediction::Derivative, "(T*cos(a) - D)/m", "forward(v)"),
        ("w", Prediction::Derivative, "T*sin(a)/m", "forward(w)"),
        ("force", Prediction::Value, "T - D", "force"),
    ] {
        model.equations.push(Equation {
            subject: subject.into(),
            prediction,
            right: parse(right),
            target: Some(parse(target)),
            unit: None,
        });
    }
    model.validate().unwrap();
    model
}

fn thrust(a: f64) -> f64 {
    2.0 + 3.0 * a - a * a
}

fn slopes(v: f64, a: f64, m: f64) -> [f64; 2] {
    [(thrust(a) * a.cos() - 0.5 * v * v) / m, thrust(a) * a.sin() / m]
}

const NAMES: [&str; 5] = ["v", "w", "a", "m", "force"];

/// Rows of columns by hand: Euler steps of 0.01 s of the model itself, inputs that vary.
fn rows(count: usize) -> Vec<Vec<f64>> {
    let mut columns = vec![Vec::new(); 5];
    let (mut v, mut w) = (0.3, -0.2);
    for k in 0..count {
        let (a, m) = (0.4 + 0.3 * (0.1 * k as f64).sin(), 2.0 + 0.5 * (0.07 * k as f64).cos());
        for (column, value) in columns.iter_mut().zip([v, w, a, m, thrust(a) - 0.5 * v * v]) {
            column.push(value);
        }
        let [dv, dw] = slopes(v, a, m);
        (v, w) = (v + 0.01 * dv, w + 0.01 * dw);
    }
    columns
}

#[test]
fn predictions_match_hand_computation() {
    let (model, columns) = (shared(), rows(300));
    let source = source(&NAMES, 0.01, vec![columns.clone()]);
    let predictor = Predictor::new(&model, &NAMES).unwrap();
    let block = source.read(0, 0..300, predictor.halo()).unwrap();
    let mut out = Predicted::default();
    predictor.predict(&block, 0..300, &mut PredictorWorkspace::default(), &mut out);
    for row in 0..299 {
        let [v, _, a, m, force] = [0, 1, 2, 3, 4].map(|j| columns[j][row]);
        let [dv, dw] = slopes(v, a, m);
        let predicted = [0, 1, 2].map(|equation| Predicted::equation(&out.predicted, 300, equation)[row]);
        assert!(
            (predicted[0] - dv).abs() < 1e-14
                && (predicted[1] - dw).abs() < 1e-14
                && (predicted[2] - force).abs() < 1e-14
        );
        assert_eq!((out.status[row], out.region[row]), (RowStatus::Complete, 0));
        // Statistics are a unit covariance about zero; of D's functions only v^2 is in use. The distance is that of the farther latent.
        assert!((out.distance[row] - a.hypot(a * a).max(v * v)).abs() < 1e-12);
    }
    let scores = score(&model, &source, &ScoreOptions::default(), &Silent).unwrap();
    assert_eq!(scores.rows, 299);
    assert!(scores.skipped.no_region == 0 && scores.skipped.non_finite == 0);
}

#[test]
fn rollouts_match_hand_computation() {
    let (mut model, columns) = (shared(), rows(200));
    // Equations of other columns than states take no part.
    model.equations.pop();
    model.training.target_mean.pop();
    model.training.target_covariance = identity(2, 1.0);
    model.training.target_deviation.pop();
    for summary in &mut model.summaries {
        summary.regions[0].residual_covariance = identity(2, 1.0);
    }
    let source = source(&NAMES, 0.01, vec![columns.clone()]);
    let simulator = Simulator::new(&model).unwrap();
    assert!(!simulator.is_affine(), "products of latents and columns take the general path");
    let mut options = RolloutOptions::new(150);
    options.method = Method::Euler;
    let starts = Starts::Random { count: 5, seed: 3 }.choose(&source, 150, 1, 150).unwrap();
    let trajectories = simulator.trajectories(&source, &starts, &options, &Silent).unwrap();
    assert_eq!(trajectories.len(), 5);
    for trajectory in trajectories.iter().flatten() {
        assert_eq!(trajectory.steps(), 150);
        for step in 0..=150 {
            let row = trajectory.start.row + step;
            for state in 0..2 {
                let error = trajectory.states[step * 2 + state] - columns[state][row];
                assert!(error.abs() < 1e-12, "step {step}: {error:e}");
            }
        }
    }
}

#[test]
fn shared_models_are_saved_printed_and_checked() {
    let model = shared();
    let again = Model::from_json(&model.to_json(), "test").unwrap();
    assert_eq!(
        (again.to_json(), &again.libraries, &again.equations),
        (model.to_json(), &model.libraries, &model.equations)
    );
    let text = fleetfoot_model::describe(&model, 5);
    assert!(text.contains("latent T: 2 of 2 functions\n  T = 2 + 3*a - 1*a^2\n"), "{text}");
    assert!(text.contains("latent D: 1 of 3 functions\n  D = 0.5*v^2\n"), "zeros are left out: {text}");
    assert!(text.contains("d(v)/dt = (T*cos(a) - D)/m"), "{text}");
    let mut broken = model.clone();
    broken.summaries[1].regions[0].mean.pop();
    let problem = broken.validate().unwrap_err();
    assert!(problem.contains("average") && problem.contains("[2, 3, 6, 6]"), "{problem}");
    let mut named = model;
    named.latents[1].name = "v".into();
    assert!(named.validate().unwrap_err().contains("the latent `v`"));
}
