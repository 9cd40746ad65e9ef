//! Models on values at hand: the bits of rollouts on a recording, and derivatives by finite differences.

use crate::common::{column, identity, parse, region, source, with_beyond, with_radial};
use fleetfoot_data::Silent;
use fleetfoot_dynamics::{
    Course, Error, InputSequence, Integration, Method, Points, RolloutOptions, Simulator, Start, Step, Stepper,
    StepperWorkspace, Tangent,
};
use fleetfoot_model::{AffineMap, Equation, Latent, Model, Partition, Prediction, Role, Rule, Training};

/// Two regions, two latents of one library, an angle, a lag, a product of latents, time, and an input. Or the same as
/// next values and differences.
fn model(prediction: [Prediction; 3]) -> Model {
    let columns = vec![
        column("v", Role::State, false),
        column("u", Role::Input, false),
        column("a", Role::State, true),
        column("idle", Role::Input, false),
        column("w", Role::State, false),
        column("note", Role::Auxiliary, false),
    ];
    let training = Training {
        target_mean: vec![0.0; 3],
        target_covariance: identity(3, 1.0),
        target_deviation: vec![f64::NAN; 3],
        state_covariance: identity(3, 1.0),
        ..Training::default()
    };
    let mut model = Model::new("by hand", columns, 0.05, training);
    model.libraries = vec![vec![parse("v"), parse("sin(a)"), parse("u^2"), parse("lag(w, 2)*v")]];
    let mut partition = Partition::whole();
    partition.columns = vec![parse("cos(a)"), parse("v")];
    (partition.centre, partition.scale) = (vec![0.1, 0.0], vec![0.7, 2.0]);
    partition.rule = Rule::voronoi(vec![vec![1.0, 0.5], vec![-1.0, -0.5]]);
    model.add_partition(partition, vec![region("0", 4, 3), region("1", 4, 3)]);
    for (name, constants, coefficients) in [
        ("f", vec![0.3, -0.2], vec![vec![-0.5, 0.7, 0.2, 0.1], vec![-0.3, 0.4, -0.1, 0.2]]),
        ("g", vec![0.1, 0.2], vec![vec![0.3, -0.6, 0.0, 0.0], vec![0.2, 0.5, 0.0, 0.1]]),
    ] {
        model.latents.push(Latent {
            beyond: Vec::new(),
            name: name.into(),
            library: 0,
            partition: 0,
            map: AffineMap { constants, coefficients }.into(),
        });
    }
    let rights = ["f*cos(a) + 0.1*u*g", "2*g + v", "0.5*f*g - 0.2*w + 0.05*sin(time())"];
    for ((subject, right), prediction) in ["v", "a", "w"].iter().zip(rights).zip(prediction) {
        model.equations.push(Equation {
            subject: (*subject).into(),
            prediction,
            right: parse(right),
            target: Some(parse(&format!("forward({subject})"))),
            unit: None,
        });
    }
    model.validate().unwrap();
    model
}

const NAMES: [&str; 6] = ["v", "u", "a", "idle", "w", "note"];
const KINDS: [[Prediction; 3]; 3] = [
    [Prediction::Derivative; 3],
    [Prediction::Next, Prediction::Difference, Prediction::Next],
    [Prediction::Derivative, Prediction::Difference, Prediction::Derivative],
];

fn value(column: usize, row: usize) -> f64 {
    0.8 * (0.7 * row as f64 + 1.3 * column as f64).sin()
}

/// A point at a row of the recording, with its past.
fn points(stepper: &Stepper, rows: &[usize], dt: f64) -> Points {
    let mut points = stepper.points(rows.len());
    for lag in 0..=stepper.history() {
        for column in 0..NAMES.len() {
            points.column_mut(column, lag).iter_mut().zip(rows).for_each(|(to, row)| *to = value(column, row - lag));
        }
        points.seconds_mut(lag).iter_mut().zip(rows).for_each(|(to, row)| *to = (row - lag) as f64 * dt);
    }
    points
}

#[test]
fn inputs_and_advanced_states_are_listed() {
    let stepper = Stepper::new(&model(KINDS[0])).unwrap();
    assert_eq!(stepper.states().collect::<Vec<_>>(), ["v", "a", "w"]);
    assert_eq!(
        stepper.inputs().collect::<Vec<_>>(),
        ["u", "idle"],
        "inputs that nothing reads are inputs all the same"
    );
    assert_eq!((stepper.history(), stepper.uses_time(), stepper.is_continuous()), (2, true, true));
    let mut ahead = model(KINDS[0]);
    ahead.libraries[0][2] = parse("lead(u, 1)");
    assert!(matches!(Stepper::new(&ahead), Err(Error::FutureState { state, ahead: 1 }) if state == "u"));
    assert_eq!(Stepper::looking_ahead(&ahead).unwrap().ahead(), 1);
    ahead.libraries[0][2] = parse("lead(v, 1)");
    assert!(matches!(Stepper::looking_ahead(&ahead), Err(Error::FutureState { state, ahead: 1 }) if state == "v"));
}

/// The model, the same with radial functions of three of its four functions, and the same with other slopes outside of ranges that are left in most rows.
fn both(kind: [Prediction; 3]) -> [Model; 3] {
    [model(kind), with_radial(model(kind), &[3, 0, 1], 8), with_beyond(model(kind), [-0.2, 0.3], 9)]
}

#[test]
fn simulations_are_the_rollouts_on_a_recording() {
    let dt = 0.05;
    let columns: Vec<Vec<f64>> = (0..6).map(|column| (0..60).map(|row| value(column, row)).collect()).collect();
    let source = source(&NAMES, dt, vec![columns]);
    for (kind, model) in KINDS.into_iter().flat_map(|kind| both(kind).map(|model| (kind, model))) {
        let stepper = Stepper::new(&model).unwrap();
        for method in [Method::Euler, Method::Rk4] {
            let mut options = RolloutOptions::new(20);
            (options.method, options.step, options.divergence) = (method, Step::Seconds(dt), f64::INFINITY);
            let starts = [5, 9].map(|row| Start { episode: 0, row });
            let rolled = Simulator::new(&model).unwrap().trajectories(&source, &starts, &options, &Silent).unwrap();
            for (start, rolled) in starts.iter().zip(rolled) {
                let rolled = rolled.unwrap();
                let mut point = points(&stepper, &[start.row], dt);
                let inputs: Vec<f64> =
                    (0..20).flat_map(|step| [1, 3].map(|column| value(column, start.row + step))).collect();
                let times: Vec<f64> = (0..=20).map(|k| f64::from(k) * dt).collect();
                let inputs = InputSequence { values: &inputs, by_point: false, course: Course::Held };
                let mut rows = Vec::new();
                let (grid, how) = (stepper.grid(times).unwrap(), Integration::Fixed { method, substeps: Some(1) });
                stepper.simulate(&mut point, &grid, inputs, &how, |_, states| {
                    rows.extend_from_slice(states);
                    true
                });
                assert_eq!(rows.len(), rolled.states.len());
                // The first step is exactly `dt` in both; later ones are differences of rounded times here.
                (0..6).for_each(|i| assert_eq!(rows[i].to_bits(), rolled.states[i].to_bits()));
                for (value, other) in rows.iter().zip(&rolled.states) {
                    assert!((value - other).abs() < 1e-12, "{kind:?} {method:?}: {value} {other}");
                }
            }
        }
    }
}

#[test]
fn batch_steps_match_single_points() {
    let stepper = Stepper::new(&model(KINDS[2])).unwrap();
    let mut workspace = StepperWorkspace::default();
    let mut many = points(&stepper, &[5, 9, 17], 0.05);
    let together = stepper.next(&mut many, 0.1, Method::Rk4, &mut workspace).to_vec();
    for (b, row) in [5, 9, 17].into_iter().enumerate() {
        let mut alone = points(&stepper, &[row], 0.05);
        let next = stepper.next(&mut alone, 0.1, Method::Rk4, &mut workspace);
        (0..3).for_each(|s| assert_eq!(next[s].to_bits(), together[s * 3 + b].to_bits()));
        (0..6).for_each(|column| assert_eq!(alone.column(column, 0), [value(column, row)]));
        assert!((alone.seconds(0)[0] - row as f64 * 0.05).abs() < 1e-15);
    }
}

#[test]
fn substeps_match_steps_and_keep_the_past() {
    let stepper = Stepper::new(&model(KINDS[0])).unwrap();
    let inputs = [0.3, 0.0, -0.4, 0.0, 0.2, 0.0];
    let run = |parts: usize| {
        let (mut point, mut rows) = (points(&stepper, &[8], 0.05), Vec::new());
        let inputs = InputSequence { values: &inputs, by_point: false, course: Course::Held };
        // A model that looks back by rows is simulated row by row.
        let grid = stepper.grid(vec![0.0, 0.05, 0.1, 0.15]).unwrap();
        let how = Integration::Fixed { method: Method::Rk4, substeps: Some(parts) };
        stepper.simulate(&mut point, &grid, inputs, &how, |_, states| {
            rows = states.to_vec();
            true
        });
        (rows, point.column(4, 2).to_vec())
    };
    let (fine, past) = run(64);
    let error = |parts: usize| {
        let (states, past_states) = run(parts);
        assert!((past_states[0] - past[0]).abs() < 1e-6, "two rows back is the first row simulated");
        states.iter().zip(&fine).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    assert!(error(1) > 8.0 * error(2) && error(2) > 8.0 * error(4) && error(4) > 0.0, "fourth order");
}

#[test]
fn tangents_are_finite_differences() {
    for (kind, model) in KINDS.into_iter().flat_map(|kind| both(kind).map(|model| (kind, model))) {
        let stepper = Stepper::new(&model).unwrap();
        let tangent = Tangent::new(&stepper).unwrap();
        let (variables, mut workspace) = ([0, 2, 4, 1, 3], StepperWorkspace::default());
        for row in [5, 12, 31] {
            for step in [None, Some((0.08, Method::Euler)), Some((0.08, Method::Rk4))] {
                let mut value = |shift: Option<(usize, f64)>| -> Vec<f64> {
                    let mut point = points(&stepper, &[row], 0.05);
                    if let Some((column, by)) = shift {
                        point.column_mut(column, 0)[0] += by;
                    }
                    match step {
                        Some((dt, method)) => stepper.next(&mut point, dt, method, &mut workspace).to_vec(),
                        None if stepper.is_continuous() => {
                            stepper.evaluate(&point, &mut workspace);
                            (0..3).map(|s| stepper.right_side(s, 1, &workspace)[0]).collect()
                        }
                        None => stepper.next(&mut point, 0.05, Method::Euler, &mut workspace).to_vec(),
                    }
                };
                let base = value(None);
                let slopes: Vec<Vec<f64>> = variables
                    .iter()
                    .map(|&column| {
                        let (up, down) = (value(Some((column, 1e-6))), value(Some((column, -1e-6))));
                        up.iter().zip(&down).map(|(up, down)| (up - down) / 2e-6).collect()
                    })
                    .collect();
                let mut point = points(&stepper, &[row], 0.05);
                let linearized = match step {
                    None => tangent.linearize(&stepper, &point, &mut StepperWorkspace::default()),
                    Some((dt, method)) => {
                        tangent.linearize_step(&stepper, &mut point, dt, method, &mut StepperWorkspace::default())
                    }
                };
                let x: Vec<f64> = variables.iter().map(|&column| point.column(column, 0)[0]).collect();
                for s in 0..3 {
                    let row: Vec<f64> = [&linearized[0].a[s * 3..][..3], &linearized[0].b[s * 2..][..2]].concat();
                    for (j, slope) in row.iter().enumerate() {
                        assert!(
                            (slope - slopes[j][s]).abs() < 1e-7,
                            "{kind:?} {step:?} {s} {j}: {slope} {}",
                            slopes[j][s]
                        );
                    }
                    let linear: f64 = row.iter().zip(&x).map(|(slope, x)| slope * x).sum();
                    assert!((linear + linearized[0].c[s] - base[s]).abs() < 1e-12);
                }
            }
        }
    }
}
