//! Regulators made from models, against closed forms and in closed loop.

use std::sync::Arc;

use crate::common::*;
use fleetfoot_control::{
    ControlError, Error,
    controller::Regulator,
    design::{LqrOptions, Schedule, lqr},
};
use fleetfoot_data::Silent;
use fleetfoot_dynamics::{
    End, Method, RolloutOptions, Starts, Step, Stepper, StepperWorkspace, controller::Controller, rollout_closed_loop,
};
use fleetfoot_model::{Model, Partition, Prediction, Role, Rule};
use proptest::prelude::*;

/// x' = v, v' = u + w: a mass that wind moves.
pub(crate) fn mass() -> Model {
    let columns = vec![
        column("x", Role::State, false),
        column("v", Role::State, false),
        column("u", Role::Input, false),
        column("w", Role::Input, false),
    ];
    let given: Vec<(&str, Prediction, &str)> =
        vec![("x", Prediction::Derivative, "v"), ("v", Prediction::Derivative, "u + w")];
    model(columns, &[], Partition::whole(), vec![], &given)
}

/// Two regions by x or v: friction pulls back by 0.5 in one and pushes by 0.1 in the other, which also has a stronger
/// input.
fn two_regions(by: &str, border: f64) -> Model {
    let columns =
        vec![column("x", Role::State, false), column("v", Role::State, false), column("u", Role::Input, false)];
    let rule = Rule::Linear { weights: vec![vec![-1.0], vec![1.0]], offsets: vec![0.0, 0.0] };
    let fitted = vec![(
        "v",
        Prediction::Derivative,
        "forward(v)",
        // constant; v, u
        vec![(0.1, vec![-0.3, 2.0]), (-0.5, vec![-0.3, 1.0])],
    )];
    let given = [("x", Prediction::Derivative, "v")];
    model(columns, &["v", "u"], partition(&[by], &[border], &[1.0], rule), fitted, &given)
}

/// Two regions by the sign of v.
pub(crate) fn with_friction() -> Model {
    two_regions("v", 0.0)
}

pub(crate) fn at(named: &[(&str, f64)]) -> Vec<(String, f64)> {
    named.iter().map(|&(name, value)| (name.to_owned(), value)).collect()
}

/// A mass that is held at three metres against wind.
pub(crate) fn options() -> LqrOptions {
    LqrOptions {
        setpoint: at(&[("x", 3.0), ("w", 0.5)]),
        q: at(&[("x", 1.0), ("v", 0.1)]),
        r: at(&[("u", 0.01)]),
        drive: vec!["u".into()],
        period: Some(0.1),
        ..LqrOptions::default()
    }
}

#[test]
fn double_integrator_has_scipys_gain() {
    let options = options();
    let design = lqr(&mass(), &options).unwrap();
    let law = &design.regulator.laws[0];
    // scipy 1.17.1: X = solve_discrete_are([[1, .1], [0, 1]], [[.005], [.1]], diag([1, .1]), [[.01]]), K = solve(R + B'XB, B'XA).
    let x = [[6.022540785844572, 1.012422836565833], [1.012422836565833, 0.6091146407455232]];
    let (a, b) = ([[1.0, 0.1], [0.0, 1.0]], [0.005, 0.1]);
    let bx: Vec<f64> = (0..2).map(|j| b[0] * x[0][j] + b[1] * x[1][j]).collect();
    let weighed = 0.01 + bx[0] * b[0] + bx[1] * b[1];
    for j in 0..2 {
        let gain = (bx[0] * a[0][j] + bx[1] * a[1][j]) / weighed;
        assert!((law.gain[0][j] / gain - 1.0).abs() < 1e-11, "{} {gain}", law.gain[0][j]);
    }
    // At rest the input balances the wind, and more wind is balanced as it comes.
    assert!((law.inputs[0] + 0.5).abs() < 1e-12 && (law.measured[0][0] - 1.0).abs() < 1e-9, "{law:?}");
    assert_eq!(design.setpoint.states, at(&[("x", 3.0), ("v", 0.0)]));
    assert!(design.setpoint.at_rest && design.regions[0].unreached.is_empty() && design.regions[0].residual < 1e-13);
}

#[test]
fn uncontrollable_modes_are_named() {
    let columns =
        vec![column("x", Role::State, false), column("y", Role::State, false), column("u", Role::Input, false)];
    let given: Vec<(&str, Prediction, &str)> =
        vec![("x", Prediction::Derivative, "u"), ("y", Prediction::Derivative, "0.2*y")];
    let model = model(columns, &[], Partition::whole(), vec![], &given);
    let error = lqr(&model, &LqrOptions::default()).unwrap_err();
    assert!(matches!(error, Error::Control(ControlError::NotStabilisable { .. })));
    let text = error.to_string();
    assert!(text.contains("a mode in y (eigenvalue") && text.contains("free"), "{text}");
    let design = lqr(&model, &LqrOptions { free: vec!["y".into()], ..LqrOptions::default() }).unwrap();
    assert_eq!(design.regulator.states.len(), 1);
}

#[test]
fn each_region_has_a_law_and_a_feedforward() {
    let options = LqrOptions { setpoint: at(&[("x", 1.0), ("v", 0.5)]), ..LqrOptions::default() };
    // x cannot rest while v is 0.5: the drift is told.
    let moving = lqr(&with_friction(), &options).unwrap();
    assert!(
        !moving.setpoint.at_rest && moving.notes.iter().any(|note| note.contains("d(x)/dt = 5")),
        "{:?}",
        moving.notes
    );
    let options = LqrOptions { free: vec!["x".into()], setpoint: at(&[("v", 0.5)]), ..options };
    let design = lqr(&with_friction(), &options).unwrap();
    assert_eq!(design.setpoint.region, Some(1));
    // In region 1: 0 = -0.5 - 0.3*0.5 + u; in region 0: 0 = 0.1 - 0.15 + 2u.
    assert!((design.regulator.laws[1].inputs[0] - 0.65).abs() < 1e-9, "{:?}", design.regulator.laws);
    assert!((design.regulator.laws[0].inputs[0] - 0.025).abs() < 1e-9, "{:?}", design.regulator.laws);
    assert!(design.regulator.partition.is_some());
    let mean = lqr(&with_friction(), &LqrOptions { schedule: Schedule::Mean, ..options }).unwrap();
    assert!(mean.regulator.partition.is_none() && mean.regulator.laws.len() == 1);
}

/// A spring that becomes stiffer beyond x = 0.2, as samples: fitted maps of x and v, their prediction of x at a
/// standstill off by so much.
fn spring(off: f64) -> Model {
    let columns =
        vec![column("x", Role::State, false), column("v", Role::State, false), column("u", Role::Input, false)];
    let rule = Rule::Linear { weights: vec![vec![-1.0], vec![1.0]], offsets: vec![0.0, 0.0] };
    // constant; x, v, u
    let next_x = vec![(off, vec![1.0, 0.01, 0.0]), (off, vec![1.0, 0.01, 0.0])];
    let next_v = vec![(0.0, vec![-0.2, 0.98, 0.02]), (0.2, vec![-1.2, 0.9, 0.02])];
    let fitted = vec![("x", Prediction::Next, "lead(x, 1)", next_x), ("v", Prediction::Next, "lead(v, 1)", next_v)];
    let mut made = model(columns, &["x", "v", "u"], partition(&["x"], &[0.2], &[1.0], rule), fitted, &[]);
    for region in &mut made.summaries[0].regions {
        // 100 rows of 4 numbers, residuals of 1e-4 and 1e-3.
        region.residual_covariance = vec![1e-8, 0.0, 1e-6];
    }
    made
}

#[test]
fn drift_within_its_error_counts_as_rest() {
    let options = LqrOptions { setpoint: at(&[("x", 0.5), ("v", 0.0)]), ..LqrOptions::default() };
    // Three standard errors: 3 * 1e-4 * sqrt(4 / 96) = 6.1e-5.
    let design = lqr(&spring(5e-5), &options).unwrap();
    assert!(design.setpoint.at_rest && design.notes.is_empty(), "{:?}", design.notes);
    assert_eq!((design.setpoint.region, design.regions.len()), (Some(1), 2));
    // 0 = 0.2 - 1.2 * 0.5 + 0.02 u; the mean of both regions would say 12.5.
    assert!((design.setpoint.inputs[0].1 - 20.0).abs() < 1e-2, "{:?}", design.setpoint);
    let moving = lqr(&spring(8e-5), &options).unwrap();
    assert!(!moving.setpoint.at_rest && moving.setpoint.region.is_none());
    assert!(moving.notes.iter().any(|note| note.contains("delta(x) = 8")), "{:?}", moving.notes);
    // A given equation has no doubt: a place cannot stand still while it moves.
    let rolling = LqrOptions { setpoint: at(&[("x", 1.0), ("v", 1e-3)]), ..LqrOptions::default() };
    assert!(!lqr(&with_friction(), &rolling).unwrap().setpoint.at_rest);
}

#[test]
fn set_point_beyond_the_limits_is_noted() {
    let options = LqrOptions {
        setpoint: at(&[("x", 0.5), ("v", 0.0)]),
        limits: vec![("u".into(), -1.0, 15.0)],
        ..LqrOptions::default()
    };
    let design = lqr(&spring(0.0), &options).unwrap();
    assert!(
        design.notes.iter().any(|note| note.contains("u = 20.0000, beyond its limits -1 to 15")),
        "{:?}",
        design.notes
    );
    let wide = LqrOptions { limits: vec![("u".into(), -1.0, 25.0)], ..options };
    assert!(lqr(&spring(0.0), &wide).unwrap().notes.is_empty());
}

/// A rollout of a model with its regulator from x = 0, v = 0.
fn closed(model: &Model, regulator: &Regulator, extra: &[(&str, f64)], seconds: f64) -> (Vec<f64>, End) {
    let rows = (seconds / 0.01) as usize + 2;
    let mut names = vec!["x", "v", "u"];
    names.extend(extra.iter().map(|(name, _)| *name));
    let mut values = vec![vec![0.0; rows]; 3];
    values.extend(extra.iter().map(|&(_, value)| vec![value; rows]));
    let source = source(&names, 0.01, vec![values]);
    let mut options = RolloutOptions::new(rows - 2);
    (options.method, options.step, options.keep, options.divergence) =
        (Method::Rk4, Step::Seconds(0.01), true, f64::MAX);
    let controller: Arc<dyn Controller> = Arc::new(regulator.clone());
    let start = Starts::At(vec![fleetfoot_dynamics::Start { episode: 0, row: 1 }]);
    let rolled = rollout_closed_loop(model, &controller, &source, &start, &options, &Silent).unwrap();
    let trajectory = &rolled.trajectories[0];
    (trajectory.states[trajectory.states.len() - 2..].to_vec(), trajectory.end)
}

#[test]
fn loop_reaches_setpoint_through_regions_and_wind() {
    let options = LqrOptions {
        setpoint: at(&[("x", 1.0)]),
        limits: vec![("u".into(), -2.0, 2.0)],
        integral: at(&[("x", 0.5)]),
        ..LqrOptions::default()
    };
    // From 0 to 1 over the border at 0.5, where the force and the input's effect jump.
    let model = two_regions("x", 0.5);
    let design = lqr(&model, &options).unwrap();
    assert_eq!((design.setpoint.region, design.regulator.laws.len()), (Some(1), 2));
    let (last, end) = closed(&model, &design.regulator, &[], 60.0);
    assert_eq!(end, End::Horizon);
    assert!((last[0] - 1.0).abs() < 1e-6 && last[1].abs() < 1e-6, "{last:?}");

    // Wind that the law does not measure is met by the integral, wind that it does at once.
    let wind = LqrOptions { setpoint: at(&[("x", 1.0), ("w", 0.0)]), drive: vec!["u".into()], ..options.clone() };
    let mut design = lqr(&mass(), &wind).unwrap();
    let (last, _) = closed(&mass(), &design.regulator, &[("w", 0.7)], 40.0);
    assert!((last[0] - 1.0).abs() < 1e-6, "{last:?}");
    design.regulator.measured.clear();
    design.regulator.laws[0].measured.clear();
    let (last, _) = closed(&mass(), &design.regulator, &[("w", 0.7)], 40.0);
    assert!((last[0] - 1.0).abs() < 1e-3, "{last:?}");
    let without = LqrOptions { integral: Vec::new(), ..wind };
    let mut design = lqr(&mass(), &without).unwrap();
    design.regulator.measured.clear();
    design.regulator.laws[0].measured.clear();
    let (last, _) = closed(&mass(), &design.regulator, &[("w", 0.7)], 40.0);
    assert!((last[0] - 1.0).abs() > 0.05, "without either it stays off: {last:?}");
}

#[test]
fn an_integral_at_a_limit_does_not_wind_up() {
    let options = LqrOptions {
        setpoint: at(&[("x", 1.0), ("w", 0.0)]),
        drive: vec!["u".into()],
        limits: vec![("u".into(), -0.3, 0.3)],
        integral: at(&[("x", 1.0)]),
        ..LqrOptions::default()
    };
    let design = lqr(&mass(), &options).unwrap();
    let mut state = design.regulator.start();
    let mut input = [0.0];
    // Far off for a long while, then at the set point: the input is back at once.
    (0..10_000).for_each(|k| state.control(f64::from(k) * 0.01, &[-50.0, 0.0, 0.0], &mut input));
    assert_eq!(input, [0.3]);
    state.control(100.0, &[1.0, 0.0, 0.0], &mut input);
    assert!(input[0].abs() < 0.3, "{input:?}");
    // A missing value leaves the input as it is.
    let before = input;
    state.control(100.01, &[f64::NAN, 0.0, 0.0], &mut input);
    assert_eq!(input, before);
}

#[test]
fn impossible_options_are_refused_by_name() {
    let refused = |options: LqrOptions| lqr(&mass(), &options).unwrap_err().to_string();
    let with = |setpoint: &[(&str, f64)]| LqrOptions { setpoint: at(setpoint), ..LqrOptions::default() };
    assert!(refused(with(&[("xx", 0.0)])).contains("did you mean x?"));
    assert!(refused(with(&[("x", f64::NAN)])).contains("finite"));
    assert!(refused(LqrOptions { r: at(&[("u", 0.0)]), ..LqrOptions::default() }).contains("positive weight"));
    assert!(refused(LqrOptions { free: vec!["x".into(), "v".into()], ..LqrOptions::default() }).contains("no state"));
    assert!(refused(LqrOptions { drive: vec!["x".into()], ..LqrOptions::default() }).contains("no input `x`"));
    let limits = vec![("u".to_owned(), 1.0, 0.0)];
    assert!(refused(LqrOptions { limits, ..LqrOptions::default() }).contains("above the lowest"));
    assert!(refused(LqrOptions { period: Some(-1.0), ..LqrOptions::default() }).contains("positive number of seconds"));
}

#[test]
fn units_change_nothing() {
    // The same robot in millimetres.
    let model = with_friction();
    let mut scaled = model.clone();
    scaled.partitions[0].scale = vec![1e3];
    for (constants, rows) in scaled
        .latents
        .iter_mut()
        .map(|latent| latent.affine_mut().unwrap())
        .map(|map| (&mut map.constants, &mut map.coefficients))
    {
        constants.iter_mut().for_each(|constant| *constant *= 1e3);
        rows.iter_mut().for_each(|row| row[1] *= 1e3);
    }
    let options = |unit: f64| LqrOptions {
        setpoint: at(&[("x", unit), ("v", 0.0)]),
        q: vec![("x".into(), 1.0 / (unit * unit)), ("v".into(), 0.1 / (unit * unit))],
        r: at(&[("u", 1.0)]),
        schedule: Schedule::Region,
        ..LqrOptions::default()
    };
    let (first, second) = (lqr(&model, &options(1.0)).unwrap(), lqr(&scaled, &options(1e3)).unwrap());
    for (a, b) in first.regulator.laws.iter().zip(&second.regulator.laws) {
        for (a, b) in a.gain[0].iter().zip(&b.gain[0]) {
            assert!((a - b * 1e3).abs() < 1e-9 * a.abs(), "{a} {b}");
        }
        assert!((a.inputs[0] - b.inputs[0]).abs() < 1e-9, "{a:?} {b:?}");
    }
}

/// The wobble of a law at work: columns that go round the set point, with gaps.
fn shown(law: &Regulator, key: u64) -> Vec<f64> {
    let states = law.states.iter().map(|state| (state.at, state.size));
    // The parts of rotations are of any length: that of a quaternion does not matter.
    let parts = law.rotations.iter().flat_map(|rotation| rotation.at.iter().map(|&at| (at, 0.3)));
    let known: Vec<(f64, f64)> =
        states.chain(parts).chain(law.measured.iter().map(|column| (column.at, column.size))).collect();
    let count = law.reads().len();
    (0..count)
        .map(|i| {
            let (at, size) = known.get(i).copied().unwrap_or((0.0, 1.0));
            if key % 17 == 5 && i == 0 { f64::NAN } else { at + 2.5 * size * noise(key * 31 + i as u64) }
        })
        .collect()
}

/// The law and its model, sample by sample beside each other.
pub(crate) fn assert_model_is_the_law(law: &Regulator) {
    let model = law.model().unwrap();
    model.validate().unwrap();
    let stepper = Stepper::new(&model).unwrap();
    let (m, q) = (law.inputs.len(), law.integrated.len());
    let mut state = law.start();
    let mut inputs = vec![0.2; m];
    let mut values: Vec<f64> = inputs.iter().copied().chain(std::iter::repeat_n(0.0, q)).collect();
    let (mut points, mut workspace) = (stepper.points(1), StepperWorkspace::default());
    let mut moved = 0;
    for k in 0..400u64 {
        let columns = shown(law, k);
        state.control(k as f64 * law.period, &columns, &mut inputs);
        (0..m + q).for_each(|i| points.column_mut(stepper.state_column(i), 0)[0] = values[i]);
        for (i, name) in stepper.inputs().enumerate() {
            let at = law.reads().iter().position(|read| read == name).unwrap();
            points.column_mut(stepper.input_column(i), 0)[0] = columns[at];
        }
        let next = stepper.next(&mut points, law.period, Method::Rk4, &mut workspace).to_vec();
        // A missing value leaves all inputs as they are: exported code keeps its variable, the engine reports that there is no number.
        if columns.iter().all(|value| value.is_finite()) {
            assert!(next.iter().all(|value| value.is_finite()), "{k}: {next:?}");
            values = next;
        }
        for (j, (a, b)) in inputs.iter().zip(&values).enumerate() {
            // Sums of the same terms in another order.
            assert!((a - b).abs() <= 1e-12 * a.abs().max(1.0), "sample {k}, input {j}: {a} {b}");
        }
        moved += usize::from(inputs.iter().any(|u| *u != 0.2));
    }
    assert!(moved > 300);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn law_and_exported_model_give_equal_commands(
        limit in 0.05f64..3.0, weight in 0.01f64..10.0, at in -2.0f64..2.0, limited: bool, integral: bool,
    ) {
        let options = LqrOptions {
            setpoint: at_names(at),
            limits: if limited { vec![("u".into(), -limit, limit)] } else { Vec::new() },
            integral: if integral { vec![("x".into(), weight)] } else { Vec::new() },
            ..LqrOptions::default()
        };
        for model in [two_regions("x", 0.5), two_regions("u", 0.2), with_friction()] {
            assert_model_is_the_law(&lqr(&model, &options).unwrap().regulator);
        }
        let wind = LqrOptions { drive: vec!["u".into()], setpoint: vec![("w".into(), at)], ..options };
        assert_model_is_the_law(&lqr(&mass(), &wind).unwrap().regulator);
    }
}

fn at_names(x: f64) -> Vec<(String, f64)> {
    vec![("x".to_owned(), x)]
}

/// The cost of a law: the sum along its closed loop, without any Riccati equation.
fn paid(a: [[f64; 2]; 2], b: [f64; 2], gain: [f64; 2], q: [f64; 2], r: f64, start: [f64; 2]) -> f64 {
    let (mut x, mut sum) = (start, 0.0);
    for _ in 0..20_000 {
        let u = -(gain[0] * x[0] + gain[1] * x[1]);
        sum += q[0] * x[0] * x[0] + q[1] * x[1] * x[1] + r * u * u;
        x = [0, 1].map(|i| a[i][0] * x[0] + a[i][1] * x[1] + b[i] * u);
    }
    sum
}

#[test]
fn lqr_gain_has_the_least_cost_from_any_start() {
    // In region 1 of the model with friction, v' = -0.3 v + u: the step has a closed form.
    let (h, k) = (0.05f64, 0.3f64);
    let decay = (-k * h).exp();
    let a = [[1.0, (1.0 - decay) / k], [0.0, decay]];
    let b = [(h - (1.0 - decay) / k) / k, (1.0 - decay) / k];
    let (q, r) = ([4.0, 0.5], 0.2);
    let options = LqrOptions {
        setpoint: at(&[("x", 1.0)]),
        q: at(&[("x", q[0]), ("v", q[1])]),
        r: at(&[("u", r)]),
        period: Some(h),
        ..LqrOptions::default()
    };
    let design = lqr(&two_regions("x", 0.5), &options).unwrap();
    let gain = &design.regulator.laws[1].gain[0];
    let gain = [gain[0], gain[1]];
    for start in [[1.0, 0.0], [0.0, 1.0], [0.6, -0.9]] {
        let best = paid(a, b, gain, q, r, start);
        for (i, step) in [(0, 1e-3), (0, -1e-3), (1, 1e-3), (1, -1e-3)] {
            let mut other = gain;
            other[i] *= 1.0 + step;
            // The cost is flat at its minimum: a gain that is off by 1e-3 costs about 1e-6 more.
            let more = paid(a, b, other, q, r, start) / best - 1.0;
            assert!(more > 0.0 && more < 1e-4, "{start:?} {i} {step}: {more:e}");
        }
    }
}

#[test]
fn uncontrollable_region_borrows_a_law_with_a_note() {
    // Below x = 0.5 nothing drives v, which grows.
    let columns =
        vec![column("x", Role::State, false), column("v", Role::State, false), column("u", Role::Input, false)];
    let rule = Rule::Linear { weights: vec![vec![-1.0], vec![1.0]], offsets: vec![0.0, 0.0] };
    let maps = vec![(0.1, vec![0.2, 0.0]), (-0.5, vec![-0.3, 1.0])];
    let fitted = vec![("v", Prediction::Derivative, "forward(v)", maps)];
    let given = [("x", Prediction::Derivative, "v")];
    let model = model(columns, &["v", "u"], partition(&["x"], &[0.5], &[1.0], rule), fitted, &given);
    let design = lqr(&model, &LqrOptions { setpoint: at(&[("x", 1.0)]), ..LqrOptions::default() }).unwrap();
    let [inner, outer] = &design.regions[..] else { panic!("{:?}", design.regions) };
    assert!(inner.borrowed && inner.unreached.iter().any(|mode| mode.contains("v")), "{inner:?}");
    assert!(!outer.borrowed && outer.unreached.is_empty() && outer.radius < 1.0, "{outer:?}");
    assert_eq!(design.regulator.laws[0], design.regulator.laws[1]);
    // The set point in that region is refused, with what is wrong.
    let error = lqr(&model, &LqrOptions { setpoint: at(&[("x", 0.0)]), ..LqrOptions::default() });
    let text = error.map(|design| format!("{:?}", design.notes)).unwrap_or_else(|error| error.to_string());
    assert!(text.contains("no input reaches") || text.contains("no region is at rest"), "{text}");
}
