//! Rotations among the states: closed forms and conserved quantities of a turning body. No result depends on the
//! representation of a rotation.

use std::f64::consts::{PI, TAU};

use fleetfoot_data::{MemorySource, Silent};
use fleetfoot_dynamics::{
    Course, Error, InputSequence, Integration, Method, RolloutOptions, Rollouts, ShootingOptions, Starts, Step,
    Stepper, Stretches, Tolerance, rollout,
};
use fleetfoot_library::{Expr, Quaternion, rotation_vector_rates};
use fleetfoot_model::{Equation, Model, Prediction, Role, RotationKind, RotationPart, Training};
use proptest::prelude::*;

use crate::common::{column, identity, parse, source};

const DT: f64 = 0.01;
const QUATERNION: [&str; 4] = ["qw", "qx", "qy", "qz"];
const VECTOR: [&str; 3] = ["rx", "ry", "rz"];
const RATES: [&str; 3] = ["wx", "wy", "wz"];

/// Moments of inertia.
const J: [f64; 3] = [1.0, 2.0, 3.5];

fn names(kind: RotationKind) -> &'static [&'static str] {
    match kind {
        RotationKind::Quaternion => &QUATERNION,
        RotationKind::Vector => &VECTOR,
    }
}

/// An attitude whose rates are constant inputs, or with `torque_free` those of a rigid body.
fn body(kind: RotationKind, world: bool, torque_free: bool) -> Model {
    let parts = names(kind);
    let mut columns: Vec<_> = parts.iter().map(|name| column(name, Role::State, false)).collect();
    for (part, column) in columns.iter_mut().enumerate() {
        column.rotation = Some(RotationPart { group: "attitude".into(), kind, part });
    }
    let role = if torque_free { Role::State } else { Role::Input };
    columns.extend(RATES.map(|name| column(name, role, false)));
    let x: Vec<Expr> = parts.iter().map(|name| Expr::column(*name)).collect();
    let rates = RATES.map(Expr::column);
    let part = |i: usize| x[i].clone();
    let sides: Vec<Expr> = match kind {
        RotationKind::Quaternion => Quaternion::new(part(1), part(2), part(3), part(0)).rates(&rates, world).to_vec(),
        RotationKind::Vector => rotation_vector_rates(&[part(0), part(1), part(2)], &rates, world).to_vec(),
    };
    let states = parts.len() + if torque_free { 3 } else { 0 };
    let mut mean = vec![0.0; states];
    if kind == RotationKind::Quaternion {
        mean[0] = 1.0;
    }
    let training = Training { state_covariance: identity(states, 1.0), state_mean: mean, ..Training::default() };
    let mut model = Model::new("by hand", columns, DT, training);
    let mut give = |subject: &str, right: Expr| {
        let prediction = Prediction::Derivative;
        model.equations.push(Equation { subject: subject.into(), prediction, right, target: None, unit: None });
    };
    parts.iter().zip(sides).for_each(|(name, side)| give(name, side));
    if torque_free {
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            give(RATES[i], parse(&format!("{}*{}*{}", (J[j] - J[k]) / J[i], RATES[j], RATES[k])));
        }
    }
    model.validate().unwrap();
    model
}

fn length(x: &[f64]) -> f64 {
    x.iter().map(|part| part * part).sum::<f64>().sqrt()
}

/// A rotation by this vector, as it is written.
fn written(kind: RotationKind, phi: [f64; 3]) -> Vec<f64> {
    let mut x = match kind {
        RotationKind::Quaternion => RotationKind::Vector.quaternion(&phi).to_vec(),
        RotationKind::Vector => phi.to_vec(),
    };
    kind.retract(&mut x);
    x
}

/// The states after every step.
fn simulated(model: &Model, start: &[f64], inputs: &[f64], steps: usize, how: &Integration) -> Vec<Vec<f64>> {
    let stepper = Stepper::new(model).unwrap();
    let mut points = stepper.points(1);
    start.iter().enumerate().for_each(|(s, &value)| points.column_mut(stepper.state_column(s), 0)[0] = value);
    let grid = stepper.grid((0..=steps).map(|k| k as f64 * DT).collect()).unwrap();
    let inputs: Vec<f64> = (0..steps).flat_map(|_| inputs.iter().copied()).collect();
    let mut rows = Vec::new();
    stepper.simulate(
        &mut points,
        &grid,
        InputSequence { values: &inputs, by_point: false, course: Course::Held },
        how,
        |_, states| {
            rows.push(states.to_vec());
            true
        },
    );
    rows
}

const RK4: Integration = Integration::Fixed { method: Method::Rk4, substeps: None };

/// A body that turns at constant rates: `q0 Exp(w t)` with rates about its own axes, `Exp(w t) q0` about those of the world. Fourth order leaves 3e-10 of 15 rad.
#[test]
fn constant_rates_have_a_closed_form() {
    let (rates, at) = ([1.3, -2.0, 1.8], [0.5, -0.7, 0.2]);
    for kind in [RotationKind::Quaternion, RotationKind::Vector] {
        for world in [false, true] {
            let start = written(kind, at);
            let states = simulated(&body(kind, world, false), &start, &rates, 500, &RK4);
            for (k, x) in states.iter().enumerate() {
                let turned = rates.map(|rate| rate * k as f64 * DT);
                let exact = match world {
                    false => kind.moved(&start, turned),
                    true => kind.moved(&written(kind, turned), at),
                };
                let off = length(&kind.difference(x, &exact));
                assert!(off < 1e-8, "{kind:?}, world {world}, step {k}: {off:e}");
                match kind {
                    RotationKind::Quaternion => assert!((length(x) - 1.0).abs() < 1e-15),
                    RotationKind::Vector => assert!(length(x) <= PI + 1e-12),
                }
            }
        }
    }
}

/// Energy and the size of the angular momentum belong to the rates. The momentum itself, in the axes of the world, is
/// conserved if the attitude turns with them.
#[test]
fn a_free_body_conserves_energy_and_momentum() {
    let adaptive = Integration::Adaptive(Tolerance { relative: 1e-11, ..Tolerance::default() });
    for kind in [RotationKind::Quaternion, RotationKind::Vector] {
        let n = kind.parts();
        let mut start = written(kind, [0.3, 0.4, -0.2]);
        start.extend([1.5, 0.1, -1.2]);
        for (how, tolerance) in [(RK4, 1e-7), (adaptive.clone(), 1e-8)] {
            let states = simulated(&body(kind, false, true), &start, &[], 1000, &how);
            let invariants = |x: &[f64]| {
                let [w, a, b, c] = kind.quaternion(&x[..n]);
                let rates = &x[n..];
                let l: [f64; 3] = std::array::from_fn(|i| J[i] * rates[i]);
                let numbers = [w, a, b, c, l[0], l[1], l[2]];
                let names = ["w", "x", "y", "z", "l.x", "l.y", "l.z"];
                let momentum = |axis: &str| {
                    let text = format!("rotate(quat(x, y, z, w), vec(`l.x`, `l.y`, `l.z`)).{axis}");
                    let program = fleetfoot_library::Program::compile(&[parse(&text)], &names).unwrap();
                    let leaves: Vec<f64> = program
                        .leaves()
                        .iter()
                        .map(|leaf| match *leaf {
                            fleetfoot_library::Leaf::Column { column, .. } => numbers[column],
                            fleetfoot_library::Leaf::Time { .. } => f64::NAN,
                        })
                        .collect();
                    let mut out = [0.0];
                    program.evaluate_row(&leaves, &mut out, &mut fleetfoot_library::Scratch::new());
                    out[0]
                };
                let energy = (0..3).map(|i| 0.5 * J[i] * rates[i] * rates[i]).sum::<f64>();
                [energy, momentum("x"), momentum("y"), momentum("z")]
            };
            let before = invariants(&start);
            for x in states.iter().skip(99).step_by(100) {
                for (invariant, first) in invariants(x).iter().zip(before) {
                    assert!((invariant - first).abs() < tolerance, "{kind:?}: {invariant} {first}");
                }
            }
            // It has turned: 1000 steps are some 3 turns.
            assert!(kind == RotationKind::Vector || states.iter().any(|x| x[0] < -0.3));
        }
    }
}

/// A recording of a turning body: rates that are inputs, and 120 rows.
fn recorded(kind: RotationKind, noise: f64) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let rates: Vec<[f64; 3]> = (0..120)
        .map(|k| [2.0 + (0.1 * k as f64).sin(), 3.0 * (0.07 * k as f64).cos(), -1.0 + 0.02 * k as f64])
        .collect();
    let mut rotations = vec![written(kind, [0.4, -0.2, 0.9])];
    for (k, rate) in rates.iter().enumerate().skip(1) {
        let wobble = [0.0, 1.0, 2.0].map(|shift| noise * (1.7 * k as f64 + shift).sin());
        let last = &rotations[k - 1];
        rotations.push(kind.moved(last, std::array::from_fn(|i| rate[i] * DT + wobble[i])));
    }
    let columns = (0..kind.parts()).map(|part| rotations.iter().map(|x| x[part]).collect()).collect();
    (columns, (0..3).map(|i| rates.iter().map(|rate| rate[i]).collect()).collect())
}

fn log(kind: RotationKind, rotation: &[Vec<f64>], rates: &[Vec<f64>]) -> MemorySource {
    let names: Vec<&str> = names(kind).iter().copied().chain(RATES).collect();
    source(&names, DT, vec![rotation.iter().chain(rates).cloned().collect()])
}

/// The same rotations, written another way at some rows: vectors where that is not much longer, since their equations end at a whole turn.
fn rewritten(kind: RotationKind, rotation: &[Vec<f64>], at: impl Fn(usize) -> bool) -> Vec<Vec<f64>> {
    let mut rotation = rotation.to_vec();
    for row in (0..rotation[0].len()).filter(|&row| at(row)) {
        let angle = length(&rotation.iter().map(|column| column[row]).collect::<Vec<_>>());
        if kind == RotationKind::Vector && angle < 2.0 {
            continue;
        }
        let factor = if kind == RotationKind::Quaternion { -1.0 } else { 1.0 - TAU / angle };
        rotation.iter_mut().for_each(|column| column[row] *= factor);
    }
    rotation
}

fn rolled(kind: RotationKind, source: &MemorySource) -> Rollouts {
    let mut options = RolloutOptions::new(25);
    (options.keep, options.method) = (true, Method::Rk4);
    rollout(&body(kind, false, false), source, &Starts::Even(9), &options, &Silent).unwrap()
}

/// A rotation has one error, its angle. The score is that of the rotation vector under a covariance of three: 4 I for a
/// quaternion whose parts have variances of 1.
#[test]
fn errors_are_angles() {
    for kind in [RotationKind::Quaternion, RotationKind::Vector] {
        let (rotation, rates) = recorded(kind, 0.003);
        let rollouts = rolled(kind, &log(kind, &rotation, &rates));
        assert_eq!(rollouts.horizon.states, ["attitude"]);
        assert_eq!(rollouts.states.len(), kind.parts());
        let row = |row: usize| rotation.iter().map(|column| column[row]).collect::<Vec<_>>();
        for step in [1, 10, 25] {
            let (mut square, mut score, mut still) = (0.0, 0.0, 0.0);
            for trajectory in &rollouts.trajectories {
                let start = trajectory.start.row;
                let angle = length(&kind.difference(&row(start + step), trajectory.state(step)));
                square += angle * angle / 9.0;
                score += angle / if kind == RotationKind::Quaternion { 2.0 } else { 1.0 } / 9.0;
                still += length(&kind.difference(&row(start + step), &row(start))).powi(2) / 9.0;
            }
            let errors = &rollouts.horizon.model;
            assert!((errors.rmse[step - 1] - square.sqrt()).abs() < 1e-12 && square > 1e-6, "{kind:?} {step}");
            assert!((errors.mahalanobis[step - 1].value - score).abs() < 1e-12);
            let (_, persistence) = &rollouts.horizon.baselines[0];
            assert!((persistence.rmse[step - 1] - still.sqrt()).abs() < 1e-12);
        }
    }
}

/// A body that turns on as it did is foreseen by constant velocity, through half turns and more.
#[test]
fn constant_velocity_turns_on() {
    for kind in [RotationKind::Quaternion, RotationKind::Vector] {
        let start = written(kind, [0.1, 0.5, -0.3]);
        let turned = (0..120).map(|k| kind.moved(&start, [4.0, -3.0, 5.0].map(|rate| rate * k as f64 * DT)));
        let turned: Vec<Vec<f64>> = turned.collect();
        let rotation: Vec<Vec<f64>> = (0..kind.parts()).map(|part| turned.iter().map(|x| x[part]).collect()).collect();
        let rollouts = rolled(kind, &log(kind, &rotation, &vec![vec![0.0; 120]; 3]));
        let (_, velocity) = &rollouts.horizon.baselines[1];
        assert!(velocity.rmse.iter().all(|error| *error < 1e-12), "{:?}", velocity.rmse);
        assert!(rollouts.horizon.model.rmse[24] > 1.0);
    }
}

/// The derivatives by beginning, gains and measurements on the way against central differences, in steps that leave the unit sphere (Euler) and hardly do. Differences of
/// 1e-6 are off by some 1e-9.
#[test]
fn tangents_follow_rotations_back() {
    for kind in [RotationKind::Quaternion, RotationKind::Vector] {
        let (rotation, rates) = recorded(kind, 0.003);
        let turned = rewritten(kind, &rotation, |row| row % 3 == 1);
        let log = log(kind, &turned, &rates);
        let n = kind.parts();
        for method in [Method::Euler, Method::Rk4] {
            let mut options = ShootingOptions::new(1);
            (options.method, options.step) = (method, Step::Seconds(0.05));
            let stretches = Stretches::new(&body(kind, false, false), &log, &[], &options).unwrap();
            let stretch = stretches.cut(Some(40))[0];
            let block = stretches.read(stretch).unwrap();
            let beginning: Vec<f64> = (0..n).map(|part| rotation[part][0] + 0.02 * part as f64).collect();
            let gains: Vec<f64> = (0..n).map(|part| 0.2 + 0.1 * part as f64).collect();
            let path = stretches.simulate(&block, stretch, &beginning, &gains).unwrap();
            // Three numbers of a quaternion but at the beginning, whose length is free.
            let there = |row: &[f64]| row.iter().filter(|error| error.is_finite()).count();
            let rows: Vec<usize> = path.errors.chunks_exact(n).map(there).collect();
            assert!(rows[0] == n && rows[1..].iter().all(|count| *count == 3), "{kind:?} {rows:?}");
            assert!(path.errors.iter().all(|error| error.is_nan() || error.abs() < 1.5), "{kind:?}");
            for moved in 0..2 * n {
                let errors = |h: f64| {
                    let (mut beginning, mut gains) = (beginning.clone(), gains.clone());
                    if moved < n {
                        gains[moved] += h
                    } else {
                        beginning[moved - n] += h
                    }
                    stretches.simulate(&block, stretch, &beginning, &gains).unwrap().errors
                };
                let (high, low) = (errors(1e-6), errors(-1e-6));
                let slopes = if moved < n { &path.by_gains } else { &path.by_beginning };
                for at in (0..path.errors.len()).filter(|&at| path.errors[at].is_finite()) {
                    let (slope, difference) = (slopes[n * at + moved % n], (low[at] - high[at]) / 2e-6);
                    let near = (slope - difference).abs() < 1e-7 * slope.abs().max(1.0);
                    assert!(near, "{kind:?} {method:?} {moved} {at}: {slope} {difference}");
                }
            }
        }
    }
}

#[test]
fn incomplete_rotations_are_refused() {
    let mut model = body(RotationKind::Quaternion, false, false);
    model.equations.pop();
    let message = Stepper::new(&model).err().unwrap().to_string();
    assert!(matches!(Stepper::new(&model), Err(Error::Inconsistent(_))) && message.contains("attitude"), "{message}");
    let mut model = body(RotationKind::Quaternion, false, false);
    model.columns[2].rotation = None;
    assert!(model.validate().unwrap_err().contains("lacks a part"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// However the rows of a recording write their rotations, rollouts are as far from it.
    #[test]
    fn scores_do_not_depend_on_how_rotations_are_written(flips in prop::collection::vec(any::<bool>(), 120)) {
        for kind in [RotationKind::Quaternion, RotationKind::Vector] {
            // A vector that begins longer than half a turn makes its first step by other numbers: 1e-11.
            let tolerance = if kind == RotationKind::Quaternion { 1e-12 } else { 1e-9 };
            let (rotation, rates) = recorded(kind, 0.003);
            let one = rolled(kind, &log(kind, &rotation, &rates)).horizon;
            let other = rolled(kind, &log(kind, &rewritten(kind, &rotation, |row| flips[row]), &rates)).horizon;
            for (one, other) in [(&one.model, &other.model), (&one.baselines[1].1, &other.baselines[1].1)] {
                let pairs = one.rmse.iter().zip(&other.rmse).chain(one.mae.iter().zip(&other.mae));
                let scores = one.mahalanobis.iter().map(|score| &score.value).zip(other.mahalanobis.iter().map(|score| &score.value));
                for (a, b) in pairs.chain(scores) {
                    prop_assert!((a - b).abs() < tolerance, "{kind:?}: {a} {b}");
                }
            }
        }
    }
}
