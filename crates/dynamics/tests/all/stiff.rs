//! Stiff equations: implicit steps that a simulation chooses by itself, held against exact and published solutions.

use std::time::{Duration, Instant};

use crate::common::{column, identity, parse};
use fleetfoot_data::{Stop, stoppable};
use fleetfoot_dynamics::{Course, InputSequence, Integration, Method, Stepper, Tolerance};
use fleetfoot_model::{Equation, Model, Prediction, Role, Training};

const DT: f64 = 0.01;

/// A stepper of derivatives of states with a standard deviation of 1; `u` is an input.
fn derivatives(rights: &[(&str, &str)], inputs: &[&str]) -> Stepper {
    let training = Training { state_covariance: identity(rights.len(), 1.0), ..Training::default() };
    let mut columns: Vec<_> = rights.iter().map(|(name, _)| column(name, Role::State, false)).collect();
    columns.extend(inputs.iter().map(|name| column(name, Role::Input, false)));
    let mut model = Model::new("by hand", columns, DT, training);
    for &(subject, right) in rights {
        let (prediction, right) = (Prediction::Derivative, parse(right));
        model.equations.push(Equation { subject: subject.into(), prediction, right, target: None, unit: None });
    }
    Stepper::new(&model).unwrap()
}

/// The states at every time, times x states x starts, and by how much the tolerance was missed.
fn run(
    stepper: &Stepper,
    starts: &[&[f64]],
    times: &[f64],
    (values, course): (&[f64], Course),
    how: &Integration,
) -> (Vec<Vec<f64>>, f64) {
    let mut points = stepper.points(starts.len());
    for (b, start) in starts.iter().enumerate() {
        for (state, &value) in start.iter().enumerate() {
            points.column_mut(stepper.state_column(state), 0)[b] = value;
        }
    }
    points.seconds_mut(0).fill(times[0]);
    let (grid, mut rows) = (stepper.grid(times.to_vec()).unwrap(), Vec::new());
    let inputs = InputSequence { values, by_point: false, course };
    let missed = stepper.simulate(&mut points, &grid, inputs, how, |_, states| {
        rows.push(states.to_vec());
        true
    });
    (rows, missed)
}

const NO_INPUTS: (&[f64], Course) = (&[], Course::Held);

#[test]
fn stiff_equation_follows_moving_equilibrium() {
    let stepper = derivatives(&[("x", "-1000000*(x - cos(time())) - sin(time())")], &[]);
    let times: Vec<f64> = (0..=10).map(f64::from).collect();
    let begun = Instant::now();
    // On the slow solution, and far from it.
    let (states, missed) = run(&stepper, &[&[1.0], &[3.0]], &times, NO_INPUTS, &Integration::default());
    for (states, time) in states.iter().zip(&times).skip(1) {
        for x in states {
            assert!((x - time.cos()).abs() < 1e-7, "{x} at {time} s, {}", time.cos());
        }
    }
    assert_eq!(missed, 0.0);
    // Explicit steps would be more than three millions.
    assert!(begun.elapsed() < Duration::from_secs(10), "{:?}", begun.elapsed());
}

#[test]
fn van_der_pol_and_robertson_have_their_published_ends() {
    // Test Set for Initial Value Problem Solvers (Mazzia and Magherini, 2008): VDPOL at 2 s.
    let stepper = derivatives(&[("x", "v"), ("v", "((1 - x^2)*v - x)/0.000001")], &[]);
    let (states, missed) = run(&stepper, &[&[2.0, 0.0]], &[0.0, 1.0, 2.0], NO_INPUTS, &Integration::default());
    assert!((states[2][0] - 1.706_167_732_170_483).abs() < 1e-5, "{states:?}");
    assert!((states[2][1] + 0.892_809_701_024_797_5).abs() < 1e-5, "{states:?}");
    assert_eq!(missed, 0.0);
    // Robertson's reactions at 40 s (Hairer and Wanner, volume II).
    let rights = [("a", "-0.04*a + 10000*b*c"), ("b", "0.04*a - 10000*b*c - 30000000*b^2"), ("c", "30000000*b^2")];
    let how = Integration::Adaptive(Tolerance { relative: 1e-8, absolute: Some(vec![1e-12; 3]) });
    let states = run(&derivatives(&rights, &[]), &[&[1.0, 0.0, 0.0]], &[0.0, 40.0], NO_INPUTS, &how).0;
    for (x, exact) in states[1].iter().zip([0.715_827_068_8, 9.185_534_765e-6, 0.284_163_745_7]) {
        assert!((x / exact - 1.0).abs() < 1e-6, "{x} {exact}");
    }
}

#[test]
fn stiff_and_other_points_are_simulated_independently() {
    // The rate is a state, so that one point is stiff and the other is not.
    let stepper = derivatives(&[("x", "-k*(x - sin(time()))"), ("k", "0")], &[]);
    let starts: [&[f64]; 2] = [&[1.0, 1e5], &[1.0, 2.0]];
    let times = [0.0, 0.5, 3.0, 3.1];
    let together = run(&stepper, &starts, &times, NO_INPUTS, &Integration::default()).0;
    for (b, start) in starts.iter().enumerate() {
        let alone = run(&stepper, &[start], &times, NO_INPUTS, &Integration::default()).0;
        for (many, one) in together.iter().zip(&alone) {
            assert_eq!(many[b].to_bits(), one[0].to_bits());
        }
    }
}

#[test]
fn a_point_comes_back_to_explicit_steps() {
    // Stiff until 1 s, an oscillator afterwards.
    let stepper = derivatives(&[("x", "v"), ("v", "-x - 50000*(1 - tanh(50*(time() - 1)))*v")], &[]);
    let (states, _) = run(
        &stepper,
        &[&[1.0, 0.0]],
        &[0.0, 0.5, 4.0, 4.0 + std::f64::consts::TAU],
        NO_INPUTS,
        &Integration::default(),
    );
    // A whole turn of an oscillator without friction.
    assert!((states[3][0] - states[2][0]).abs() < 1e-5 && (states[3][1] - states[2][1]).abs() < 1e-5, "{states:?}");
}

#[test]
fn inputs_are_interpolated_on_request() {
    let stepper = derivatives(&[("x", "u")], &["u"]);
    let (times, u) = ([0.0, 0.25, 1.0, 1.5], [0.0, 2.0, -1.0, 3.0]);
    let fixed = |substeps| Integration::Fixed { method: Method::Rk4, substeps };
    for how in [Integration::default(), fixed(None), fixed(Some(1)), fixed(Some(3))] {
        let states = run(&stepper, &[&[0.0]], &times, (&u, Course::Lines), &how).0;
        let mut area = 0.0;
        for k in 1..4 {
            area += 0.5 * (u[k] + u[k - 1]) * (times[k] - times[k - 1]);
            assert!((states[k][0] - area).abs() < 1e-12, "{how:?}: {states:?}");
        }
        let held = run(&stepper, &[&[0.0]], &times, (&u, Course::Held), &how).0;
        assert!((held[3][0] - (2.0 * 0.75 - 0.5)).abs() < 1e-12, "{held:?}");
    }
    // Stiff, along a line: x follows u but for its rate over the gain.
    let stiff = derivatives(&[("x", "1000000*(u - x)")], &["u"]);
    let states = run(&stiff, &[&[0.0]], &[0.0, 1.0, 2.0], (&[0.0, 1.0, 3.0], Course::Lines), &Integration::default()).0;
    assert!((states[2][0] - (3.0 - 2e-6)).abs() < 1e-8, "{states:?}");
}

#[test]
fn a_simulation_stops_between_two_times() {
    let stepper = derivatives(&[("x", "v"), ("v", "-1000000*x")], &[]);
    for how in [Integration::default(), Integration::Fixed { method: Method::Rk4, substeps: Some(usize::MAX) }] {
        let (stop, begun) = (Stop::default(), Instant::now());
        let later = stop.clone();
        let waiting = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(100));
            later.set();
        });
        assert!(stoppable(&stop, || run(&stepper, &[&[1.0, 0.0]], &[0.0, 1e9], NO_INPUTS, &how)).is_err());
        waiting.join().unwrap();
        assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
    }
}
