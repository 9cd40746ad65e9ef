//! Predictive controllers of models: their regulator without limits, limits and bounds, regions, refusals.

use fleetfoot_control::{
    ControlError, Error,
    controller::{Controller, Regulator},
    design::{LqrOptions, MpcOptions, Schedule, lqr, mpc},
};
use proptest::prelude::*;

use crate::regulators::{at, mass, options, with_friction};

/// Position, speed and command of every sample of the mass, from rest at x under a wind.
fn flight(law: &Regulator, from: f64, wind: f64, samples: usize) -> Vec<[f64; 3]> {
    assert_eq!(law.reads(), ["x", "v", "w"]);
    let (mut state, mut u) = (law.start(), [0.0]);
    let ([mut x, mut v], h) = ([from, 0.0], law.period);
    (0..samples)
        .map(|sample| {
            state.control(sample as f64 * h, &[x, v, wind], &mut u);
            let row = [x, v, u[0]];
            let a = u[0] + wind;
            (x, v) = (x + h * v + 0.5 * h * h * a, v + h * a);
            row
        })
        .collect()
}

/// Sum of the squared errors of the position from 3, and of the commands, with the weights of [`options`].
fn cost(flight: &[[f64; 3]], wind: f64) -> f64 {
    flight.iter().map(|[x, v, u]| (x - 3.0).powi(2) + 0.1 * v * v + 0.01 * (u + wind).powi(2)).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Without limits the plan of any horizon begins with the regulator's command: its end has the regulator's cost.
    #[test]
    fn free_plan_is_the_regulator(
        from in -5.0f64..5.0,
        wind in -1.0f64..1.0,
        horizon in 1usize..30,
        integrates in any::<bool>(),
    ) {
        let lqr_options = LqrOptions {
            integral: if integrates { at(&[("x", 0.3)]) } else { Vec::new() },
            ..options()
        };
        let regulator = lqr(&mass(), &lqr_options).unwrap().regulator;
        let options = MpcOptions { lqr: lqr_options, horizon, ..MpcOptions::default() };
        let predictive = mpc(&mass(), &options).unwrap().regulator;
        prop_assert!(predictive.prediction.is_some() && regulator.prediction.is_none());
        prop_assert_eq!(&predictive.laws, &regulator.laws);
        let (ours, theirs) = (flight(&predictive, from, wind, 40), flight(&regulator, from, wind, 40));
        for (ours, theirs) in ours.iter().zip(&theirs) {
            // Commands are of the order of 50; a plan is solved to 1e-9 of the size of the input, 1.
            prop_assert!((ours[2] - theirs[2]).abs() < 1e-7, "{ours:?} {theirs:?}");
        }
    }
}

#[test]
fn limits_hold_and_bounds_are_kept() {
    let limited = LqrOptions { limits: vec![("u".into(), -2.0, 1.0)], ..options() };
    let regulator = lqr(&mass(), &limited).unwrap().regulator;
    let bounds = vec![("v".to_owned(), -0.5, 0.5)];
    let bounded = MpcOptions { lqr: limited.clone(), horizon: 40, bounds };
    let free = MpcOptions { bounds: Vec::new(), ..bounded.clone() };
    let paths: Vec<Vec<[f64; 3]>> =
        [&regulator, &mpc(&mass(), &free).unwrap().regulator, &mpc(&mass(), &bounded).unwrap().regulator]
            .map(|law| flight(law, 0.0, 0.25, 200))
            .into();
    for path in &paths {
        assert!(path.iter().all(|[_, _, u]| (-2.0..=1.0).contains(u)));
        assert!((path[199][0] - 3.0).abs() < 1e-6, "{:?}", path[199]);
    }
    let fastest = |path: &[[f64; 3]]| path.iter().map(|row| row[1].abs()).fold(0.0, f64::max);
    // The heaviest error that a violation saves is some 3 m, of which a ten-thousandth is left.
    assert!(
        fastest(&paths[2]) < 0.5 + 1e-3 && fastest(&paths[0]) > 1.0,
        "{} {}",
        fastest(&paths[2]),
        fastest(&paths[0])
    );
    // The plan knows the limits that cut the regulator off.
    assert!(cost(&paths[1], 0.25) < cost(&paths[0], 0.25), "{} {}", cost(&paths[1], 0.25), cost(&paths[0], 0.25));
}

/// The samples of [`with_friction`]: forward Euler is exact enough for a comparison of laws on the same path.
fn slide(law: &Regulator, from: f64, samples: usize) -> (f64, Vec<f64>) {
    assert_eq!(law.reads(), ["v"]);
    let (mut state, mut u, mut v) = (law.start(), [0.0], from);
    let (mut cost, mut path) = (0.0, Vec::new());
    for sample in 0..samples {
        state.control(sample as f64 * law.period, &[v], &mut u);
        let (pull, gain, rest) = if v < 0.0 { (0.1, 2.0, 0.65) } else { (-0.5, 1.0, 0.65) };
        cost += (v - 0.5f64).powi(2) + 0.01 * (u[0] - rest).powi(2);
        path.push(u[0]);
        for _ in 0..100 {
            v += 0.01 * law.period * (pull - 0.3 * v + gain * u[0]);
        }
    }
    path.push(v);
    (cost, path)
}

#[test]
fn plan_crosses_regions_to_the_set_point() {
    let lqr_options = LqrOptions {
        free: vec!["x".into()],
        setpoint: at(&[("v", 0.5)]),
        q: at(&[("v", 1.0)]),
        r: at(&[("u", 0.01)]),
        limits: vec![("u".into(), -1.0, 1.0)],
        period: Some(0.1),
        schedule: Schedule::Region,
        ..LqrOptions::default()
    };
    let regulator = lqr(&with_friction(), &lqr_options).unwrap().regulator;
    let options = MpcOptions { lqr: lqr_options, horizon: 20, ..MpcOptions::default() };
    let predictive = mpc(&with_friction(), &options).unwrap().regulator;
    assert_eq!(predictive.prediction.as_ref().map(|prediction| prediction.steps.len()), Some(2));
    let ((cost, path), (other, _)) = (slide(&predictive, -1.0, 60), slide(&regulator, -1.0, 60));
    assert!((path[60] - 0.5).abs() < 1e-3, "{path:?}");
    assert!(path[..60].iter().all(|u| (-1.0..=1.0).contains(u)));
    assert!(cost <= other * (1.0 + 1e-6), "{cost} {other}");
    // A second run has the same bits.
    assert_eq!(slide(&predictive, -1.0, 60).1, path);
}

#[test]
fn impossible_plans_are_refused() {
    let with = |horizon: usize, bounds: &[(&str, f64, f64)]| {
        let bounds = bounds.iter().map(|&(name, low, high)| (name.to_owned(), low, high)).collect();
        mpc(&mass(), &MpcOptions { lqr: options(), horizon, bounds })
    };
    for horizon in [0, 201] {
        let text = with(horizon, &[]).unwrap_err().to_string();
        assert!(text.contains(&horizon.to_string()) && text.contains("1 to 200"), "{text}");
    }
    let error = with(20, &[("x", -1.0, 1.0)]).unwrap_err();
    assert!(matches!(error, Error::Control(ControlError::Excluded { .. })), "{error}");
    assert!(error.to_string().contains("set point x = 3") && error.to_string().contains("widen"), "{error}");
    let text = with(20, &[("z", -1.0, 1.0)]).unwrap_err().to_string();
    assert!(text.contains("bounds: the model has no kept state `z`"), "{text}");
    let text = with(20, &[("v", 1.0, -1.0)]).unwrap_err().to_string();
    assert!(text.contains("bounds: v = -1"), "{text}");
    // An edited file: numbers that no plan can be made of.
    let mut law = with(20, &[("v", -1.0, 1.0)]).unwrap().regulator;
    law.validate().unwrap();
    law.prediction.as_mut().unwrap().horizon = 1_000_000_000;
    assert!(law.validate().unwrap_err().to_string().contains("1 to 200 samples"));
    law.prediction.as_mut().unwrap().horizon = 20;
    law.prediction.as_mut().unwrap().input_weights[0] = 0.0;
    assert!(law.validate().unwrap_err().to_string().contains("positive weights of inputs"));
    law.prediction.as_mut().unwrap().input_weights.clear();
    assert!(law.validate().unwrap_err().to_string().contains("prediction"));
}
