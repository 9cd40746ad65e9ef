//! Closed loops around models, against closed forms.

use std::sync::Arc;

use crate::common::*;
use fleetfoot_data::{MemorySource, Silent};
use fleetfoot_dynamics::{
    End, Error, ParameterError, RolloutOptions, Simulator, Start, Step, Trajectory,
    controller::{Controller, ControllerState},
};
use fleetfoot_model::{Partition, Prediction, Role};

const DT: f64 = 0.001;

/// u = -gain x, at every step.
#[derive(Debug)]
struct Proportional {
    gain: f64,
    x: &'static str,
    u: &'static str,
}

struct ProportionalState(f64);

impl Controller for Proportional {
    fn reads(&self) -> Vec<String> {
        vec![self.x.into()]
    }

    fn drives(&self) -> Vec<String> {
        vec![self.u.into()]
    }

    fn validate(&self) -> Result<(), ParameterError> {
        if self.gain.is_finite() {
            return Ok(());
        }
        Err(ParameterError::new("gain", self.gain, "a finite number"))
    }

    fn start(&self) -> Box<dyn ControllerState> {
        Box::new(ProportionalState(self.gain))
    }
}

impl ControllerState for ProportionalState {
    fn control(&mut self, _: f64, columns: &[f64], inputs: &mut [f64]) {
        inputs[0] = -self.0 * columns[0];
    }
}

fn options(horizon: usize) -> RolloutOptions {
    let mut options = RolloutOptions::new(horizon);
    options.step = Step::Seconds(DT);
    options
}

fn run(simulator: &Simulator, source: &MemorySource, options: &RolloutOptions) -> Trajectory {
    simulator.trajectories(source, &[Start { episode: 0, row: 3 }], options, &Silent).unwrap().remove(0).unwrap()
}

#[test]
fn proportional_loop_follows_its_recursion() {
    // x' = u + 0.3, u = -4 x: Euler gives x_k = c + (1 - 4 h)^k (x_0 - c) with c = 0.3 / 4.
    let columns = vec![column("x", Role::State, false), column("u", Role::Input, false)];
    let model = model(
        columns,
        &["x", "u"],
        Partition::whole(),
        vec![("x", Prediction::Derivative, "forward(x)", vec![(0.3, vec![0.0, 1.0])])],
        &[],
    );
    let source = source(&["x", "u"], DT, vec![vec![vec![2.0; 600], vec![7.0; 600]]]);
    let controller: Arc<dyn Controller> = Arc::new(Proportional { gain: 4.0, x: "x", u: "u" });
    for general in [false, true] {
        let simulator = Simulator::new(&model).unwrap().driven_by(Arc::clone(&controller)).unwrap();
        assert!(simulator.is_affine());
        let simulator = if general { simulator.general() } else { simulator };
        assert_eq!(simulator.driven_inputs(), ["u"]);
        let done = run(&simulator, &source, &options(500));
        for k in 0..=500 {
            let exact = 0.075 + (1.0 - 4.0 * DT).powi(k) * (2.0 - 0.075);
            assert!((done.state(k as usize)[0] - exact).abs() < 1e-12, "{k}");
        }
        assert_eq!(done.inputs.len(), 500);
        assert!((0..500).all(|k| done.inputs[k] == -4.0 * done.state(k)[0]));
    }
}

#[test]
fn short_trajectories_keep_their_inputs() {
    let columns = vec![column("x", Role::State, false), column("u", Role::Input, false)];
    let model = model(
        columns,
        &["u"],
        Partition::whole(),
        vec![("x", Prediction::Derivative, "forward(x)", vec![(0.0, vec![1.0])])],
        &[],
    );
    // An unstable loop: x grows by 1.8 a step, and is 100 deviations away after eight.
    let controller = || Arc::new(Proportional { gain: -800.0, x: "x", u: "u" });
    let source = source(&["x", "u"], DT, vec![vec![vec![1.0; 100], vec![0.0; 100]]]);
    let mut options = options(50);
    options.divergence = 100.0;
    let fast = Simulator::new(&model).unwrap().driven_by(controller()).unwrap();
    let a = run(&fast, &source, &options);
    let b = run(&fast.general(), &source, &options);
    assert_eq!(a, b);
    assert_eq!((a.end, a.steps(), a.inputs.len()), (End::Diverged, 7, 7));
}

#[test]
fn lagged_inputs_continue_recorded_inputs() {
    let columns = vec![column("x", Role::State, false), column("u", Role::Input, false)];
    let model = model(
        columns,
        &["x", "lag(u, 2)"],
        Partition::whole(),
        vec![("x", Prediction::Next, "lead(x, 1)", vec![(0.0, vec![0.9, 0.5])])],
        &[],
    );
    let u: Vec<f64> = (0..50).map(|k| noise(k + 70)).collect();
    let source = source(&["x", "u"], DT, vec![vec![vec![1.0; 50], u.clone()]]);
    let controller = Arc::new(Proportional { gain: 0.2, x: "x", u: "u" });
    let done = run(&Simulator::new(&model).unwrap().driven_by(controller).unwrap(), &source, &options(30));
    let (mut x, mut given) = (1.0f64, vec![u[1], u[2]]);
    for k in 0..30 {
        given.push(-0.2 * x);
        x = 0.9 * x + 0.5 * given[k];
        assert!((done.state(k + 1)[0] - x).abs() < 1e-13, "{k}");
    }
}

#[test]
fn future_inputs_are_refused() {
    // A model that looks ahead at an input that is not known yet.
    let columns = vec![column("x", Role::State, false), column("u", Role::Input, false)];
    let ahead = model(
        columns,
        &["lead(u, 2)"],
        Partition::whole(),
        vec![("x", Prediction::Next, "lead(x, 1)", vec![(0.0, vec![0.5])])],
        &[],
    );
    let error = Simulator::new(&ahead).unwrap().driven_by(Arc::new(Proportional { gain: 1.0, x: "x", u: "u" }));
    assert!(matches!(error.err().unwrap(), Error::FutureState { ahead: 2, .. }));
}
