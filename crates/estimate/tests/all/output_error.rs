//! Output error: certificates, closed forms, coverage of intervals, scipy, and refusals.

use std::{fs, path::Path, process::Command, time::Instant};

use fleetfoot_data::{MemorySource, Silent, with_threads};
use fleetfoot_estimate::{
    EstimateError, OutputError, OutputErrorOptions, Parameter, Residual, equation_error, output_error,
};
use fleetfoot_model::{Column, Equation, Model, Prediction, Role, Training};

use crate::{
    outside,
    simulation::{expression, noise, source},
};

/// A system: states with their equations, inputs, parameters with their truth.
pub(crate) struct System {
    pub(crate) states: &'static [(&'static str, &'static str)],
    pub(crate) inputs: &'static [&'static str],
    pub(crate) parameters: &'static [(&'static str, f64)],
    pub(crate) slope: fn(&[f64], f64, &[f64]) -> Vec<f64>,
    pub(crate) beginning: [f64; 2],
}

pub(crate) const VAN_DER_POL: System = System {
    states: &[("x", "v"), ("v", "mu*(1 - x^2)*v - k*x")],
    inputs: &[],
    parameters: &[("mu", 1.2), ("k", 1.0)],
    slope: |x, _, p| vec![x[1], p[0] * (1.0 - x[0] * x[0]) * x[1] - p[1] * x[0]],
    beginning: [1.0, 0.0],
};

/// Angle of attack and pitch rate of a small aircraft.
pub(crate) const SHORT_PERIOD: System = System {
    states: &[("alpha", "za*alpha + q + zd*d"), ("q", "ma*alpha + mq*q + md*d")],
    inputs: &["d"],
    parameters: &[("za", -1.4), ("zd", -0.12), ("ma", -6.5), ("mq", -2.1), ("md", -9.0)],
    slope: |x, u, p| vec![p[0] * x[0] + x[1] + p[1] * u, p[2] * x[0] + p[3] * x[1] + p[4] * u],
    beginning: [0.0, 0.0],
};

/// The 3-2-1-1 of flight tests, in radians.
fn elevator(seconds: f64) -> f64 {
    match seconds {
        t if !(0.5..4.0).contains(&t) => 0.0,
        t if t < 2.0 => 0.05,
        t if t < 3.0 => -0.05,
        t if t < 3.5 => 0.05,
        _ => -0.05,
    }
}

/// Noise of the measurements, and of the states from row to row.
#[derive(Clone, Copy)]
pub(crate) struct Noise {
    pub(crate) measured: [f64; 2],
    pub(crate) process: [f64; 2],
}

const WHITE: Noise = Noise { measured: [0.05, 0.08], process: [0.0; 2] };
const GYRO: Noise = Noise { measured: [0.004, 0.008], process: [0.0; 2] };

impl System {
    pub(crate) fn model(&self, period: f64) -> Model {
        let column = |name: &str, role| Column::new(name, role);
        let states = self.states.iter().map(|(name, _)| column(name, Role::State));
        let columns = states.chain(self.inputs.iter().map(|name| column(name, Role::Input))).collect();
        let state_covariance = [1.0, 0.0, 1.0][..if self.states.len() == 1 { 1 } else { 3 }].to_vec();
        let training = Training { state_covariance, ..Training::default() };
        let mut model = Model::new("test", columns, period, training);
        model.equations = (self.states.iter())
            .map(|(name, right)| Equation {
                subject: (*name).into(),
                prediction: Prediction::Derivative,
                right: expression(right),
                target: None,
                unit: None,
            })
            .collect();
        model
    }

    /// The equations beside central differences, row by row.
    pub(crate) fn residuals(&self) -> Vec<Residual> {
        let of =
            |(name, right): &(&str, &str)| Residual::new(expression(&format!("central({name})")), expression(right));
        self.states.iter().map(of).collect()
    }

    /// Start of a search: thirty percent off the truth.
    pub(crate) fn start(&self) -> Vec<Parameter> {
        let off = |(j, (name, truth)): (usize, &(&str, f64))| Parameter::new(*name, truth * [1.3, 0.7][j % 2]);
        self.parameters.iter().enumerate().map(off).collect()
    }

    /// Runge-Kutta steps with held inputs, as models are simulated.
    pub(crate) fn rows(&self, seed: usize, rows: usize, period: f64, noisy: Noise) -> Vec<Vec<f64>> {
        let p: Vec<f64> = self.parameters.iter().map(|parameter| parameter.1).collect();
        let mut x = self.beginning.to_vec();
        let mut columns = vec![Vec::new(); 2 + self.inputs.len()];
        for k in 0..rows {
            let key = 1_000_003 * seed + 8 * k;
            let u = elevator(k as f64 * period);
            (0..2).for_each(|i| columns[i].push(x[i] + noisy.measured[i] * noise(key + i)));
            columns[2..].iter_mut().for_each(|column| column.push(u));
            let moved = |f: &[f64], h: f64| x.iter().zip(f).map(|(x, f)| x + h * f).collect::<Vec<f64>>();
            let one = (self.slope)(&x, u, &p);
            let two = (self.slope)(&moved(&one, 0.5 * period), u, &p);
            let three = (self.slope)(&moved(&two, 0.5 * period), u, &p);
            let four = (self.slope)(&moved(&three, period), u, &p);
            for i in 0..2 {
                x[i] += period / 6.0 * (one[i] + 2.0 * two[i] + 2.0 * three[i] + four[i]);
                x[i] += noisy.process[i] * noise(key + 4 + i);
            }
        }
        columns
    }

    pub(crate) fn source(&self, period: f64, episodes: Vec<Vec<Vec<f64>>>) -> MemorySource {
        let names: Vec<&str> = self.states.iter().map(|state| state.0).chain(self.inputs.iter().copied()).collect();
        source(&names, period, episodes)
    }

    fn fit(&self, period: f64, episodes: Vec<Vec<Vec<f64>>>) -> OutputError {
        let options = OutputErrorOptions::default();
        output_error(&self.model(period), &self.start(), &self.source(period, episodes), &options, &Silent).unwrap()
    }

    /// Of every parameter, whether the truth lies within the interval.
    fn covered(&self, fitted: &OutputError) -> Vec<bool> {
        let within = |((truth, value), half): (((&str, f64), &f64), f64)| (value - truth.1).abs() <= half;
        self.parameters.iter().copied().zip(&fitted.values).zip(fitted.half_widths()).map(within).collect()
    }
}

#[test]
fn rows_without_noise_give_the_system() {
    for (system, period) in [(VAN_DER_POL, 0.1), (SHORT_PERIOD, 0.02)] {
        let quiet = Noise { measured: [0.0; 2], process: [0.0; 2] };
        let fitted = system.fit(period, vec![system.rows(1, 300, period, quiet), system.rows(1, 200, period, quiet)]);
        for ((name, truth), value) in system.parameters.iter().zip(&fitted.values) {
            assert!((value / truth - 1.0).abs() < 1e-9, "{name} {truth} {value} {fitted:?}");
        }
        assert!((fitted.beginnings[1].states[0] - system.beginning[0]).abs() < 1e-9);
    }
}

#[test]
fn minimum_has_a_certificate_and_noise_is_estimated() {
    let fitted = VAN_DER_POL.fit(0.1, (0..4).map(|seed| VAN_DER_POL.rows(seed, 300, 0.1, WHITE)).collect());
    println!("{:?} {:?} {:?} {}", fitted.values, fitted.deviations, fitted.status, fitted.passes);
    assert!(fitted.status.converged() && fitted.gradient < 1e-6, "{fitted:?}");
    for (deviation, truth) in fitted.deviations.iter().zip(WHITE.measured) {
        // 1,200 numbers tell a deviation to two percent.
        assert!((deviation / truth - 1.0).abs() < 0.08, "{deviation} {truth}");
    }
    assert_eq!((fitted.residuals, fitted.beginnings.len(), fitted.missing), (2400, 4, 0));
}

/// 200 seeds with FLEETFOOT_SWEEPS=full, else 8: how often the truth lies within the stated intervals.
#[test]
fn intervals_have_their_stated_coverage() {
    let full = std::env::var("FLEETFOOT_SWEEPS").is_ok_and(|value| value == "full");
    let seeds = if full { 200 } else { 8 };
    for (name, system, rows, period, noisy) in
        [("van der pol", VAN_DER_POL, 300, 0.1, WHITE), ("short period", SHORT_PERIOD, 300, 0.02, GYRO)]
    {
        let mut covered = vec![0; system.parameters.len()];
        for seed in 0..seeds {
            let fitted = system.fit(period, vec![system.rows(seed + 1, rows, period, noisy)]);
            covered
                .iter_mut()
                .zip(system.covered(&fitted))
                .for_each(|(sum, is_covered)| *sum += usize::from(is_covered));
        }
        let share = covered.iter().sum::<usize>() as f64 / (seeds * covered.len()) as f64;
        println!("{name}: {covered:?} of {seeds}, {:.1} %", 100.0 * share);
        // Three deviations of the share over independent seeds.
        let slack = 3.0 * (0.95 * 0.05 / seeds as f64).sqrt();
        assert!(share > 0.95 - slack && (full || share <= 1.0), "{share}");
        assert!(!full || (0.93..=0.97).contains(&share), "{share}");
    }
}

/// Process noise leaves residuals that last: the corrected intervals are wider, and they hold the truth more often than those for white residuals.
#[test]
fn lasting_residuals_widen_the_intervals() {
    let noisy = Noise { measured: [0.004, 0.008], process: [0.002, 0.004] };
    let (mut wider, mut lasting) = (0, 0);
    for seed in 0..5 {
        let fitted = SHORT_PERIOD.fit(0.02, vec![SHORT_PERIOD.rows(seed + 1, 400, 0.02, noisy)]);
        wider += usize::from(fitted.covariance[(2, 2)] > 2.0 * fitted.white[(2, 2)]);
        lasting += usize::from(fitted.memory > 3);
    }
    assert!(wider >= 4 && lasting >= 4, "{wider} {lasting}");
}

/// A sensor's offset that turns over once in four hundred rows is correlated for longer than a fifth of them, the
/// longest lag that is tried.
#[test]
fn correlation_beyond_the_examined_lags_is_flagged() {
    let mut columns = SHORT_PERIOD.rows(1, 400, 0.02, GYRO);
    let white = SHORT_PERIOD.fit(0.02, vec![columns.clone()]);
    assert!(!white.lasting && white.memory < 10, "{}", white.memory);
    columns[1].iter_mut().enumerate().for_each(|(k, q)| *q += 0.03 * (k as f64 / 60.0).sin());
    let fitted = SHORT_PERIOD.fit(0.02, vec![columns]);
    assert!(fitted.lasting && fitted.memory > 60, "{} {}", fitted.lasting, fitted.memory);
}

#[test]
fn threads_change_no_bit() {
    let fit = || SHORT_PERIOD.fit(0.02, (0..5).map(|seed| SHORT_PERIOD.rows(seed, 150, 0.02, GYRO)).collect());
    let fits: Vec<OutputError> = [1, 3].map(|threads| with_threads(threads, fit)).into();
    assert_eq!(fits[0].values, fits[1].values);
    assert_eq!((&fits[0].covariance, fits[0].passes), (&fits[1].covariance, fits[1].passes));
}

/// A state that is not compared needs no measurement beyond the first row; segments cut an episode and leave no row
/// out.
#[test]
fn outputs_and_segments_are_chosen() {
    let mut columns = SHORT_PERIOD.rows(3, 300, 0.02, GYRO);
    columns[0][50] = f64::NAN;
    let rows = SHORT_PERIOD.source(0.02, vec![columns]);
    let mut options = OutputErrorOptions::default();
    (options.outputs, options.rows) = (vec!["q".into()], Some(120));
    let parameters: Vec<Parameter> = SHORT_PERIOD
        .start()
        .into_iter()
        .map(|parameter| if parameter.name == "zd" { parameter.between(-0.12, -0.05) } else { parameter })
        .collect();
    let fitted = output_error(&SHORT_PERIOD.model(0.02), &parameters, &rows, &options, &Silent).unwrap();
    assert_eq!((fitted.outputs.clone(), fitted.residuals, fitted.beginnings.len()), (vec!["q".to_owned()], 300, 3));
    options.outputs = vec!["p".into()];
    let refused = output_error(&SHORT_PERIOD.model(0.02), &parameters, &rows, &options, &Silent).unwrap_err();
    assert!(refused.to_string().contains("alpha, q"), "{refused}");
}

#[test]
fn problems_that_cannot_be_estimated_are_refused() {
    let rows = VAN_DER_POL.source(0.1, vec![VAN_DER_POL.rows(1, 200, 0.1, WHITE)]);
    let model = VAN_DER_POL.model(0.1);
    let refused = |parameters: &[Parameter]| {
        output_error(&model, parameters, &rows, &OutputErrorOptions::default(), &Silent).expect_err("an error")
    };
    let mut more = VAN_DER_POL.start();
    more.push(Parameter::new("c", 1.0));
    assert!(matches!(refused(&more), EstimateError::Unused { name } if name == "c"));
    let wild = [Parameter::new("mu", 900.0), Parameter::new("k", -900.0)];
    assert!(matches!(refused(&wild), EstimateError::Diverges { row: 0, .. }));
    // A parameter twice: the rows tell the product alone.
    let mut twice = model.clone();
    twice.equations[1].right = expression("mu*(1 - x^2)*v - k*c*x");
    let fitted = output_error(&twice, &more, &rows, &OutputErrorOptions::default(), &Silent).unwrap();
    assert_eq!(fitted.undetermined, [1, 2]);
    assert!(fitted.standard_errors()[1].is_infinite() && fitted.standard_errors()[0].is_finite());
}

/// Equation error with exact derivatives in the columns is ordinary least squares, each equation by its own noise.
#[test]
fn equations_weigh_by_their_noise() {
    let (n, slope) = (400, 0.7);
    let x: Vec<f64> = (0..n).map(|k| (0.1 * k as f64).sin()).collect();
    let y = |sigma: f64, from: usize| (0..n).map(|k| slope * x[k] + sigma * noise(from + k)).collect::<Vec<f64>>();
    let columns = vec![x.clone(), y(0.1, 10_000), y(1.0, 20_000)];
    let exact = |weights: [f64; 2]| {
        let of = |at: usize| -> f64 { x.iter().zip(&columns[at + 1]).map(|(x, y)| x * y).sum() };
        (weights[0] * of(0) + weights[1] * of(1)) / ((weights[0] + weights[1]) * x.iter().map(|x| x * x).sum::<f64>())
    };
    let rows = source(&["x", "a", "b"], 0.1, vec![columns.clone()]);
    let residuals = ["a", "b"].map(|name| Residual::new(expression(name), expression("c*x")));
    let estimate =
        equation_error(&residuals, &[Parameter::new("c", 0.0)], &rows, &Default::default(), &Silent).unwrap();
    let weights = [estimate.deviations[0].powi(-2), estimate.deviations[1].powi(-2)];
    assert!(estimate.settled && (estimate.deviations[1] / estimate.deviations[0] - 10.0).abs() < 1.0);
    assert!((estimate.estimate.values[0] - exact(weights)).abs() < 1e-9, "{:?}", estimate.estimate.values);
}

/// Parameters, gains by filter error, deviations and seconds of the peer.
pub(crate) fn peer(flags: &[&str], name: &str, system: &System, columns: &[Vec<f64>], period: f64) -> Option<Vec<f64>> {
    let python = outside::python("numpy, scipy.optimize")?;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("rows");
    let rows = columns[0].len();
    let line = |k: usize| columns.iter().map(|column| format!("{:?} ", column[k])).collect::<String>() + "\n";
    fs::write(&file, (0..rows).map(line).collect::<String>()).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/peers/output_error.py");
    let mut command = Command::new(&python);
    command.arg(script).args(flags).arg(name).arg(&file).args([period.to_string(), rows.to_string()]);
    let output = command.args(system.start().iter().map(|parameter| parameter.initial.to_string())).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8_lossy(&output.stdout).lines().map(|line| line.parse().unwrap()).collect())
}

/// Beside the peer: the optimum to 1e-8, and a line with the seconds of both.
fn beside_scipy(name: &str, system: &System, columns: &[Vec<f64>], period: f64, outputs: &[&str]) {
    let Some(peer) = peer(&[], name, system, columns, period) else { return };
    let mut options = OutputErrorOptions::default();
    options.outputs = outputs.iter().map(|name| (*name).to_owned()).collect();
    let rows = system.source(period, vec![columns.to_vec()]);
    let (model, start) = (system.model(period), system.start());
    let begun = Instant::now();
    let fitted = with_threads(1, || output_error(&model, &start, &rows, &options, &Silent)).unwrap();
    let seconds = begun.elapsed().as_secs_f64();
    let theirs = peer[peer.len() - 1];
    let all: Vec<f64> = fitted.values.iter().chain(&fitted.deviations).copied().collect();
    let apart = all.iter().zip(&peer).map(|(value, peer)| (value / peer - 1.0).abs()).fold(0.0, f64::max);
    println!(
        "{name}: {} rows, {apart:.1e} apart; {seconds:.4} s, scipy {theirs:.3} s: {:.0} times; {} passes, {} rounds",
        columns[0].len(),
        theirs / seconds,
        fitted.passes,
        fitted.rounds
    );
    fitted.names.iter().zip(fitted.values.iter().zip(fitted.half_widths())).for_each(|(name, (value, half))| {
        println!("  {name} = {value:.6} +- {half:.6}");
    });
    assert!(fitted.status.converged() && apart < 1e-8, "{all:?} {peer:?} {:?}", fitted.status);
}

#[test]
fn scipy_has_the_same_optimum() {
    let columns = VAN_DER_POL.rows(5, 150, 0.1, WHITE);
    beside_scipy("van_der_pol", &VAN_DER_POL, &columns, 0.1, &[]);
    let columns = SHORT_PERIOD.rows(5, 400, 0.02, GYRO);
    beside_scipy("short_period", &SHORT_PERIOD, &columns, 0.02, &[]);
}

/// A machine's mass and friction (the published identification says 95.1, 203.5, 20.39, -3.16), from its position alone: free runs of 25 seconds.
const EMPS: System = System {
    states: &[("q", "v"), ("v", "(35.15065188*u - viscous*v - coulomb*tanh(v/0.01) - offset)/mass")],
    inputs: &["u"],
    parameters: &[("mass", 95.1), ("viscous", 203.5), ("coulomb", 20.39), ("offset", -3.16)],
    slope: |_, _, _| Vec::new(),
    beginning: [0.0, 0.0],
};

#[test]
fn a_machine_has_the_optimum_of_scipy() {
    let Some(file) = outside::data("emps.csv") else { return };
    let text = fs::read_to_string(file).unwrap();
    let number = |line: &str, at: usize| line.split(',').nth(at).unwrap().parse::<f64>().unwrap();
    // A row in ten, with the mean of the voltage until the next: what is held over the step.
    let rows: Vec<[f64; 2]> = text.lines().skip(1).map(|line| [number(line, 1), number(line, 3)]).collect();
    let q: Vec<f64> = rows.iter().step_by(10).map(|row| row[0]).collect();
    let u = rows.chunks(10).map(|chunk| chunk.iter().map(|row| row[1]).sum::<f64>() / chunk.len() as f64).collect();
    let v = (0..q.len()).map(|k| (q[(k + 1).min(q.len() - 1)] - q[k.saturating_sub(1)]) / 0.02).collect();
    beside_scipy("emps", &EMPS, &[q, v, u], 0.01, &["q"]);
}
