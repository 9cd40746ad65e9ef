//! Simulations between given times: within the tolerance, on the grid of the model, and each point independent of the
//! others.

use crate::common::{column, identity, parse, region};
use fleetfoot_dynamics::{Course, Error, InputSequence, Integration, Method, Points, Stepper, Tolerance};
use fleetfoot_model::{AffineMap, Equation, Latent, Model, Partition, Prediction, Role, Rule, Training};

const DT: f64 = 0.01;

/// States with these right sides, one region, a sampling period of 10 ms, and a standard deviation of 8.
fn given(rights: &[(&str, Prediction, &str)]) -> Model {
    let training = Training { state_covariance: identity(rights.len(), 64.0), ..Training::default() };
    let columns = rights.iter().map(|(name, ..)| column(name, Role::State, false)).collect();
    let mut model = Model::new("by hand", columns, DT, training);
    for &(subject, prediction, right) in rights {
        let right = parse(right);
        model.equations.push(Equation { subject: subject.into(), prediction, right, target: None, unit: None });
    }
    model.validate().unwrap();
    model
}

fn lorenz() -> Model {
    use Prediction::Derivative;
    given(&[("x", Derivative, "10*(y - x)"), ("y", Derivative, "x*(28 - z) - y"), ("z", Derivative, "x*y - 8/3*z")])
}

fn at(stepper: &Stepper, starts: &[&[f64]]) -> Points {
    let mut points = stepper.points(starts.len());
    for (b, start) in starts.iter().enumerate() {
        for (state, &value) in start.iter().enumerate() {
            points.column_mut(stepper.state_column(state), 0)[b] = value;
        }
    }
    points
}

/// The states at every time, and by how much the tolerance was missed.
fn run(stepper: &Stepper, starts: &[&[f64]], times: &[f64], how: &Integration) -> (Vec<Vec<f64>>, f64) {
    let grid = stepper.grid(times.to_vec()).unwrap();
    let (mut points, mut rows) = (at(stepper, starts), Vec::new());
    let inputs = InputSequence { values: &[], by_point: false, course: Course::Held };
    let missed = stepper.simulate(&mut points, &grid, inputs, how, |_, states| {
        rows.push(states.to_vec());
        true
    });
    (rows, missed)
}

fn every(seconds: f64, count: usize) -> Vec<f64> {
    (0..=count).map(|k| k as f64 * seconds).collect()
}

fn difference(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn coarse_grid_is_exact() {
    let stepper = Stepper::new(&lorenz()).unwrap();
    let start: &[&[f64]] = &[&[-8.0, 8.0, 27.0]];
    let times = every(0.1, 30);
    let exact = run(&stepper, start, &times, &Integration::Fixed { method: Method::Rk4, substeps: Some(4_000) }).0;
    let (states, missed) = run(&stepper, start, &times, &Integration::default());
    assert_eq!(missed, 0.0);
    // Errors grow by a factor of 15 in three seconds of this system.
    assert!(difference(&states, &exact) < 1e-4, "{}", difference(&states, &exact));
    // Steps of the sampling period, where the caller says no more.
    let periods = run(&stepper, start, &times, &Integration::Fixed { method: Method::Rk4, substeps: None }).0;
    let ten = run(&stepper, start, &times, &Integration::Fixed { method: Method::Rk4, substeps: Some(10) }).0;
    assert_eq!(periods, ten);
    // One step an interval is another system.
    let one = run(&stepper, start, &times, &Integration::Fixed { method: Method::Rk4, substeps: Some(1) }).0;
    assert!(difference(&one, &exact) > 1.0);
    // The tolerance is an error that is asked for.
    let loose = Integration::Adaptive(Tolerance { relative: 1e-4, ..Tolerance::default() });
    let error = difference(&run(&stepper, start, &times, &loose).0, &exact);
    assert!(error > 1e-6 && error < 1.0, "{error}");
}

#[test]
fn points_are_simulated_independently() {
    let stepper = Stepper::new(&lorenz()).unwrap();
    let starts: [&[f64]; 3] = [&[-8.0, 8.0, 27.0], &[1.0, 1.0, 1.0], &[f64::NAN, 0.0, 0.0]];
    let times = [0.0, 0.07, 0.2, 0.201, 1.0];
    let together = run(&stepper, &starts, &times, &Integration::default()).0;
    for (b, start) in starts.iter().enumerate() {
        let alone = run(&stepper, &[start], &times, &Integration::default()).0;
        for (many, one) in together.iter().zip(&alone) {
            (0..3).for_each(|s| assert_eq!(many[s * 3 + b].to_bits(), one[s].to_bits()));
        }
    }
    assert!(together[4].iter().step_by(3).take(2).all(|x| x.is_finite()));
}

#[test]
fn time_moves_with_the_stages() {
    let stepper = Stepper::new(&given(&[("x", Prediction::Derivative, "3*time()^2")])).unwrap();
    let (states, _) = run(&stepper, &[&[0.0]], &[0.0, 1.0, 2.0], &Integration::default());
    assert!((states[1][0] - 1.0).abs() < 1e-9 && (states[2][0] - 8.0).abs() < 1e-9, "{states:?}");
}

#[test]
fn jumping_right_sides_terminate() {
    // Down above zero and up below it: from 0.5 on the state stays where no step is short enough.
    let mut model = given(&[]);
    model.columns = vec![column("x", Role::State, false)];
    model.training = Training {
        target_mean: vec![0.0],
        target_covariance: vec![1.0],
        target_deviation: vec![f64::NAN],
        state_covariance: vec![1.0],
        ..Training::default()
    };
    model.libraries = vec![vec![parse("x")]];
    let mut partition = Partition::whole();
    partition.columns = vec![parse("x")];
    (partition.centre, partition.scale) = (vec![0.0], vec![1.0]);
    partition.rule = Rule::voronoi(vec![vec![1.0], vec![-1.0]]);
    model.add_partition(partition, vec![region("0", 1, 1), region("1", 1, 1)]);
    let (constants, coefficients) = (vec![-1.0, 1.0], vec![vec![0.0], vec![0.0]]);
    model.latents.push(Latent {
        beyond: Vec::new(),
        name: "f".into(),
        library: 0,
        partition: 0,
        map: AffineMap { constants, coefficients }.into(),
    });
    model.equations.push(Equation {
        subject: "x".into(),
        prediction: Prediction::Derivative,
        right: parse("f"),
        target: Some(parse("forward(x)")),
        unit: None,
    });
    let stepper = Stepper::new(&model).unwrap();
    let (states, missed) = run(&stepper, &[&[0.5]], &every(0.25, 4), &Integration::default());
    let expected = [0.5, 0.25, 0.0, 0.0, 0.0];
    for (state, expected) in states.iter().zip(expected) {
        assert!((state[0] - expected).abs() < 1e-4, "{state:?} {expected}");
    }
    assert!(missed > 0.0, "it is told");
}

#[test]
fn discrete_models_accept_their_grid_only() {
    let discrete = Stepper::new(&given(&[("x", Prediction::Next, "0.5*x")])).unwrap();
    for times in [vec![0.0, 0.1], vec![0.0, 0.01, 0.03], vec![0.0, 0.0102, 0.0204]] {
        let refused = discrete.grid(times.clone()).unwrap_err();
        assert!(matches!(refused, Error::OtherPeriod { .. }), "{times:?}: {refused}");
        assert!(refused.to_string().contains("0.01 s apart"), "{refused}");
    }
    // A clock that jitters is a clock.
    assert!(discrete.grid(vec![0.0, 0.0099, 0.0201, 0.0299, 0.04]).is_ok());
    let (states, _) = run(&discrete, &[&[8.0]], &every(DT, 3), &Integration::default());
    assert_eq!(states.concat(), [8.0, 4.0, 2.0, 1.0]);
    let mut lagged = given(&[("x", Prediction::Derivative, "-x")]);
    lagged.equations[0].right = parse("-lag(x, 1)");
    let lagged = Stepper::new(&lagged).unwrap();
    assert!(matches!(lagged.grid(vec![0.0, 0.1]), Err(Error::OtherPeriod { .. })));
    assert!(lagged.grid(every(DT, 5)).is_ok());
    // A model that does not know its period takes what it is given.
    let mut free = given(&[("x", Prediction::Next, "0.5*x")]);
    free.step = 0.0;
    assert!(Stepper::new(&free).unwrap().grid(vec![0.0, 0.3, 5.0]).is_ok());
    for (times, place) in [(vec![], 0), (vec![0.0, f64::NAN], 1), (vec![0.0, 0.01, 0.01], 2)] {
        assert!(matches!(discrete.grid(times), Err(Error::Times { place: at, .. }) if at == place));
    }
}

#[test]
fn grids_are_refined_to_sampling_periods() {
    let stepper = Stepper::new(&lorenz()).unwrap();
    let grid = stepper.grid(vec![0.0, 0.005, 0.035, 0.045]).unwrap();
    assert_eq!((0..grid.intervals()).map(|k| grid.periods(k)).collect::<Vec<_>>(), [1, 3, 1]);
    let (fine, places) = grid.refined().unwrap();
    assert_eq!(places, [0, 1, 4, 5]);
    for (time, expected) in fine.times().iter().zip([0.0, 0.005, 0.015, 0.025, 0.035, 0.045]) {
        assert!((time - expected).abs() < 1e-15);
    }
    assert_eq!(grid.interval(1).times(), [0.005, 0.035]);
    assert!(matches!(stepper.grid(vec![0.0, 1e9]).unwrap().refined(), Err(Error::Times { .. })));
}
