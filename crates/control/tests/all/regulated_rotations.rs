//! Regulators of rotations: gains in closed form at any set point, and closed loops that do not depend on how a rotation is written.

use std::{f64::consts::PI, sync::Arc};

use crate::{common::*, regulators::assert_model_is_the_law};
use fleetfoot_control::{
    controller::Regulator,
    design::{LqrOptions, lqr},
};
use fleetfoot_data::Silent;
use fleetfoot_dynamics::{
    End, Method, RolloutOptions, Start, Starts, Step, controller::Controller, rollout_closed_loop,
};
use fleetfoot_library::{Expr, Quaternion, rotation_vector_rates};
use fleetfoot_model::{Column, Equation, Model, Prediction, Role, RotationKind, RotationPart, Training};
use proptest::prelude::*;

const KINDS: [RotationKind; 2] = [RotationKind::Quaternion, RotationKind::Vector];
const RATES: [&str; 3] = ["wx", "wy", "wz"];
const TORQUES: [&str; 3] = ["ux", "uy", "uz"];

fn parts(kind: RotationKind) -> Vec<String> {
    kind.letters().iter().map(|letter| format!("q{letter}")).collect()
}

fn named(names: &[String], values: &[f64]) -> Vec<(String, f64)> {
    names.iter().cloned().zip(values.iter().copied()).collect()
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

/// An attitude with its kinematics about the axes of the body, and further equations.
fn body(kind: RotationKind, rates: Role, inputs: &[&str], states: &[(&str, &str)]) -> Model {
    let parts = parts(kind);
    let mut columns: Vec<Column> = parts.iter().map(|name| column(name, Role::State, false)).collect();
    for (part, column) in columns.iter_mut().enumerate() {
        column.rotation = Some(RotationPart { group: "attitude".into(), kind, part });
    }
    columns.extend(states.iter().map(|(name, _)| column(name, Role::State, false)));
    columns.extend(RATES.iter().filter(|_| rates == Role::Input).map(|name| column(name, Role::Input, false)));
    columns.extend(inputs.iter().map(|name| column(name, Role::Input, false)));
    let x: Vec<Expr> = parts.iter().map(|name| Expr::column(name.as_str())).collect();
    let (part, turning) = (|i: usize| x[i].clone(), RATES.map(Expr::column));
    let sides: Vec<Expr> = match kind {
        RotationKind::Quaternion => Quaternion::new(part(1), part(2), part(3), part(0)).rates(&turning, false).to_vec(),
        RotationKind::Vector => rotation_vector_rates(&[part(0), part(1), part(2)], &turning, false).to_vec(),
    };
    let count = parts.len() + states.len();
    let mut mean = vec![0.0; count];
    if kind == RotationKind::Quaternion {
        mean[0] = 1.0;
    }
    let training = Training { state_covariance: identity(count, 1.0), state_mean: mean, ..Training::default() };
    let mut model = Model::new("by hand", columns, 0.01, training);
    let mut give = |subject: &str, right: Expr| {
        let prediction = Prediction::Derivative;
        model.equations.push(Equation { subject: subject.into(), prediction, right, target: None, unit: None });
    };
    parts.iter().zip(sides).for_each(|(name, side)| give(name, side));
    states.iter().for_each(|(name, right)| give(name, parse(right)));
    model.validate().unwrap();
    model
}

/// A satellite of unequal moments of inertia, three torques.
fn satellite(kind: RotationKind) -> Model {
    let states = [("wx", "ux - 1.5*wy*wz"), ("wy", "0.5*ux*0 + 0.5*uy + 1.25*wz*wx"), ("wz", "0.25*uz - 0.3*wx*wy")];
    body(kind, Role::State, &TORQUES, &states)
}

fn satellite_options(setpoint: Vec<(String, f64)>) -> LqrOptions {
    LqrOptions {
        setpoint,
        q: vec![("attitude".into(), 4.0), ("wx".into(), 0.5), ("wy".into(), 0.5), ("wz".into(), 0.5)],
        r: named(&TORQUES.map(str::to_owned), &[0.2; 3]),
        period: Some(0.05),
        ..LqrOptions::default()
    }
}

/// The gains of x' = v, v' = b u by the same regulator.
fn double_integrator(b: f64) -> Vec<f64> {
    let columns =
        vec![column("x", Role::State, false), column("v", Role::State, false), column("u", Role::Input, false)];
    let right = format!("{b}*u");
    let given: Vec<(&str, Prediction, &str)> =
        vec![("x", Prediction::Derivative, "v"), ("v", Prediction::Derivative, right.as_str())];
    let mass = model(columns, &[], fleetfoot_model::Partition::whole(), vec![], &given);
    let options = LqrOptions {
        q: vec![("x".into(), 4.0), ("v".into(), 0.5)],
        r: vec![("u".into(), 0.2)],
        period: Some(0.05),
        ..LqrOptions::default()
    };
    lqr(&mass, &options).unwrap().regulator.laws[0].gain[0].clone()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// At any set point a satellite at rest is three double integrators. Its gains are theirs, for any attitude and
    /// representation, and the law's code is the law.
    #[test]
    fn gains_match_three_double_integrators(phi in prop::array::uniform3(-1.7f64..1.7)) {
        for kind in KINDS {
            let at = written(kind, phi);
            let design = lqr(&satellite(kind), &satellite_options(named(&parts(kind), &at))).unwrap();
            prop_assert!(design.setpoint.at_rest && design.regions[0].unreached.is_empty());
            let law = &design.regulator;
            prop_assert!(kind.difference(&law.rotations[0].at, &at).iter().all(|off| off.abs() < 1e-12));
            prop_assert_eq!(&law.errors()[..], ["wx", "wy", "wz", "attitude about x", "attitude about y", "attitude about z"]);
            for (axis, b) in [1.0, 0.5, 0.25].into_iter().enumerate() {
                let expected = double_integrator(b);
                for (error, gain) in law.laws[0].gain[axis].iter().enumerate() {
                    let wanted = if error % 3 == axis { expected[usize::from(error < 3)] } else { 0.0 };
                    prop_assert!((gain - wanted).abs() < 1e-8, "{kind:?} {axis} {error}: {gain} {wanted}");
                }
            }
            assert_model_is_the_law(law);
        }
    }
}

/// A closed loop from here: the final states, and true if it got there. Inputs hold their recorded values.
fn closed(model: &Model, regulator: &Regulator, start: &[f64], inputs: &[f64], seconds: f64) -> (Vec<f64>, End) {
    let rows = (seconds / 0.01) as usize + 2;
    let names: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
    let values = start.iter().chain(inputs).map(|&value| vec![value; rows]).collect();
    let source = source(&names, 0.01, vec![values]);
    let mut options = RolloutOptions::new(rows - 2);
    (options.method, options.step, options.keep, options.divergence) =
        (Method::Rk4, Step::Seconds(0.01), true, f64::MAX);
    let controller: Arc<dyn Controller> = Arc::new(regulator.clone());
    let start = Starts::At(vec![Start { episode: 0, row: 1 }]);
    let rolled = rollout_closed_loop(model, &controller, &source, &start, &options, &Silent).unwrap();
    let trajectory = &rolled.trajectories[0];
    let count = model.columns.iter().filter(|column| column.role == Role::State).count();
    (trajectory.states[trajectory.states.len() - count..].to_vec(), trajectory.end)
}

/// From almost half a turn away, turning, the loop comes to its set point, and by the same way whatever the sign of the quaternion.
#[test]
fn satellite_turns_to_every_form_of_setpoint() {
    let at = [0.4, -1.1, 0.8];
    let mut ends = Vec::new();
    for kind in KINDS {
        let (model, wanted) = (satellite(kind), written(kind, at));
        let mut options = satellite_options(named(&parts(kind), &wanted));
        options.integral = vec![("attitude".into(), 0.1)];
        options.limits = TORQUES.iter().map(|name| ((*name).to_owned(), -1.5, 1.5)).collect();
        let design = lqr(&model, &options).unwrap();
        assert_model_is_the_law(&design.regulator);
        let far = kind.moved(&wanted, [2.0, 1.6, -1.3]);
        for sign in if kind == RotationKind::Quaternion { vec![1.0, -1.0] } else { vec![1.0] } {
            let start: Vec<f64> = far.iter().map(|part| sign * part).chain([0.3, -0.2, 0.5]).collect();
            let (last, end) = closed(&model, &design.regulator, &start, &[0.0; 3], 60.0);
            assert_eq!(end, End::Horizon);
            let (attitude, rates) = last.split_at(kind.parts());
            let off = kind.difference(attitude, &wanted);
            assert!(off.iter().chain(rates).all(|off| off.abs() < 1e-4), "{kind:?} {sign} {off:?} {rates:?}");
            let (halfway, _) = closed(&model, &design.regulator, &start, &[0.0; 3], 1.5);
            ends.push(kind.quaternion(&halfway[..kind.parts()]));
        }
    }
    let apart = |a: &[f64; 4], b: &[f64; 4]| {
        RotationKind::Quaternion.difference(a, b).iter().map(|off| off.abs()).fold(0.0, f64::max)
    };
    // Signs change no bit; another way of writing is integrated with another error of fourth order.
    assert!(apart(&ends[0], &ends[1]) < 1e-14 && apart(&ends[0], &ends[2]) < 1e-6, "{ends:?}");
}

/// A rotor in wind whose turning is commanded. The search gives the attitude at rest, its thrust against gravity and
/// wind, and the loop keeps the place.
#[test]
fn attitude_at_rest_is_computed() {
    for kind in KINDS {
        let thrust = |axis: &str| match kind {
            RotationKind::Quaternion => format!("thrust*rotate(quat(qx, qy, qz, qw), vec(0, 0, 1)).{axis}"),
            // Of a rotation vector r by its angle a: the third column of the rotation matrix (Rodrigues).
            RotationKind::Vector => {
                let square = "max(qx^2 + qy^2 + qz^2, 1e-12)";
                let (sine, cosine) =
                    (format!("sin(sqrt({square}))/sqrt({square})"), format!("(1 - cos(sqrt({square})))/({square})"));
                match axis {
                    "x" => format!("thrust*({sine}*qy + {cosine}*qx*qz)"),
                    "y" => format!("thrust*(-({sine})*qx + {cosine}*qy*qz)"),
                    _ => format!("thrust*(1 - {cosine}*(qx^2 + qy^2))"),
                }
            }
        };
        let (x, y, z) = (thrust("x"), thrust("y"), thrust("z"));
        let sides = [format!("{x} + wind"), y, format!("{z} - 9.81")];
        let states = [
            ("x", "vx"),
            ("y", "vy"),
            ("z", "vz"),
            ("vx", sides[0].as_str()),
            ("vy", sides[1].as_str()),
            ("vz", sides[2].as_str()),
        ];
        let model = body(kind, Role::Input, &["thrust", "wind"], &states);
        let options = LqrOptions {
            setpoint: vec![
                ("x".into(), 1.0),
                ("y".into(), -2.0),
                ("z".into(), 3.0),
                ("wind".into(), 2.0),
                ("thrust".into(), 10.0),
            ],
            drive: ["wx", "wy", "wz", "thrust"].map(str::to_owned).to_vec(),
            r: vec![("wx".into(), 1.0), ("wy".into(), 1.0), ("wz".into(), 1.0), ("thrust".into(), 0.1)],
            ..LqrOptions::default()
        };
        // Ten newtons a kilogram are not what rests: without them it does.
        assert!(!lqr(&model, &options).unwrap().setpoint.at_rest, "{kind:?}");
        let options = LqrOptions { setpoint: options.setpoint[..4].to_vec(), ..options };
        let design = lqr(&model, &options).unwrap();
        assert!(design.setpoint.at_rest, "{kind:?} {:?}", design.notes);
        let rotation = &design.regulator.rotations[0];
        let [w, a, b, c] = kind.quaternion(&rotation.at);
        let up = [2.0 * (a * c + w * b), 2.0 * (b * c - w * a), w * w - a * a - b * b + c * c];
        let size = 9.81_f64.hypot(2.0);
        for (value, wanted) in up.into_iter().zip([-2.0 / size, 0.0, 9.81 / size]) {
            assert!((value - wanted).abs() < 1e-9, "{kind:?} {up:?}");
        }
        let thrust = design.setpoint.inputs.iter().find(|(name, _)| name == "thrust").unwrap().1;
        assert!((thrust - size).abs() < 1e-8, "{thrust}");
        let count = kind.parts();
        let mut start = kind.moved(&rotation.at, [0.4, -0.5, 1.2]);
        start.extend([0.0, 0.0, 0.0, 1.0, -1.0, 0.5]);
        let (last, end) = closed(&model, &design.regulator, &start, &[0.0, 0.0, 0.0, 9.0, 2.0], 60.0);
        assert_eq!(end, End::Horizon);
        let off = kind.difference(&last[..count], &rotation.at);
        for (value, wanted) in last[count..].iter().chain(&off).zip([1.0, -2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]) {
            assert!((value - wanted).abs() < 1e-4, "{kind:?} {last:?} {off:?}");
        }
        assert_model_is_the_law(&design.regulator);
    }
}

/// Angles name a rotation, too. A part of one alone is refused, as is a quaternion that is far from unit length; a
/// rotation is free as a whole.
#[test]
fn rotations_are_set_as_a_whole() {
    let model = satellite(RotationKind::Quaternion);
    let angles = [("yaw(attitude)", 0.5), ("pitch(attitude)", -0.2), ("roll(attitude)", 0.1)];
    let with = |setpoint: &[(&str, f64)]| {
        satellite_options(setpoint.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect())
    };
    let design = lqr(&model, &with(&angles)).unwrap();
    let at = |axis: usize, angle: f64| {
        let mut phi = [0.0; 3];
        phi[axis] = angle;
        phi
    };
    let kind = RotationKind::Quaternion;
    let wanted = kind.moved(&kind.moved(&written(kind, at(2, 0.5)), at(1, -0.2)), at(0, 0.1));
    assert!(kind.difference(&design.regulator.rotations[0].at, &wanted).iter().all(|off| off.abs() < 1e-14));
    let refused = |options: LqrOptions| lqr(&model, &options).unwrap_err().to_string();
    assert!(refused(with(&angles[..2])).contains("as a whole"));
    assert!(refused(with(&[("qw", 1.0)])).contains("as a whole"));
    let all = |w: f64| with(&[("qw", w), ("qx", 0.0), ("qy", 0.0), ("qz", 0.0)]);
    assert!(lqr(&model, &all(-1.0)).is_ok());
    let text = refused(all(1.1));
    assert!(text.contains("the length of attitude") && text.contains("1.1"), "{text}");
    assert!(refused(with(&[("yaw(atitude)", 0.0)])).contains("did you mean yaw(attitude)?"));
    let free = |names: &[&str]| LqrOptions {
        free: names.iter().map(|name| (*name).to_owned()).collect(),
        ..LqrOptions::default()
    };
    for names in [&["attitude"][..], &["qw", "qx", "qy", "qz"]] {
        let design = lqr(&model, &free(names)).unwrap();
        assert!(design.regulator.rotations.is_empty() && design.regulator.states.len() == 3, "{names:?}");
    }
    assert!(refused(free(&["qw", "qx"])).contains("as a whole"));
    assert!(refused(free(&["attitude about x"])).contains("as a whole"));
    // Half a turn is as far as it goes.
    let law = &design.regulator;
    let [mut state, mut inputs] = [law.start(), law.start()].map(|state| (state, [0.0; 3]));
    let columns =
        |turn: f64| -> Vec<f64> { [0.0; 3].into_iter().chain(kind.moved(&wanted, [turn, 0.0, 0.0])).collect() };
    state.0.control(0.0, &columns(PI - 0.01), &mut state.1);
    inputs.0.control(0.0, &columns(PI + 0.01), &mut inputs.1);
    assert!((state.1[0] + inputs.1[0]).abs() < 1e-9 && state.1[0] < 0.0, "{:?} {:?}", state.1, inputs.1);
}
