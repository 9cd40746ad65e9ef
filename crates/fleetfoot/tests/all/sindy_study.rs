//! The study beside pysindy: its recordings checked against what is known of the systems, its equations against the true ones, and both against pysindy where
//! a Python has it.

#[path = "../../examples/sindy_study/main.rs"]
#[allow(dead_code, reason = "the study's command has parts that its test does not call")]
mod study;

use std::{f64::consts::TAU, sync::OnceLock};

use study::{
    comparison::{Case, DATA, Study, run, thresholds},
    judge::Verdict,
    neural_fly,
    recordings::{self, RightSide},
    systems::{SYSTEMS, System},
};

fn system(name: &str) -> (&'static System, RightSide) {
    let system = SYSTEMS.iter().find(|system| system.name == name).expect("a system of the study");
    (system, RightSide::new(system).expect("a right side"))
}

fn derivative(right: &RightSide, state: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; state.len()];
    right.derivative(state, &mut out);
    out
}

#[test]
fn fixed_points_have_known_places() {
    let at = (8.0_f64 / 3.0 * 27.0).sqrt();
    // Rössler: z = (c - sqrt(c^2 - 4 a b)) / 2a, y = -z, x = a z.
    let z = (5.7 - (5.7_f64 * 5.7 - 4.0 * 0.2 * 0.2).sqrt()) / (2.0 * 0.2);
    let points: [(&str, Vec<f64>); 6] = [
        ("Lorenz", vec![at, at, 27.0]),
        ("Lotka-Volterra", vec![1.0, 0.5]),
        ("Van der Pol", vec![0.0, 0.0]),
        ("Rössler", vec![0.2 * z, -z, z]),
        ("damped pendulum", vec![std::f64::consts::PI, 0.0]),
        ("Lorenz 96, 5 states", vec![8.0; 5]),
    ];
    for (name, point) in points {
        let left = derivative(&system(name).1, &point);
        assert!(left.iter().all(|value| value.abs() < 1e-13), "{name}: {left:?}");
    }
}

/// `x - ln x + 4/3 y - 2/3 ln y` is constant on every orbit of Lotka and Volterra: what is left is the integrator's error.
#[test]
fn integration_is_exact_enough() {
    let recorded = recordings::record(system("Lotka-Volterra").0, 1).expect("a recording");
    for episode in &recorded.states {
        let invariant = |k: usize| {
            let (x, y) = (episode[0][k], episode[1][k]);
            x - x.ln() + 4.0 / 3.0 * y - 2.0 / 3.0 * y.ln()
        };
        let drift = (0..recordings::ROWS).map(|k| (invariant(k) - invariant(0)).abs()).fold(0.0, f64::max);
        assert!(drift < 1e-12, "{drift}");
    }
}

/// The energy per mass and squared length, `w^2 / 2 - g/l cos(angle)`, is lost to friction alone; on the ring of Lorenz 96 the products lose none.
#[test]
fn energies_change_as_the_systems_say() {
    let recorded = recordings::record(system("damped pendulum").0, 1).expect("a recording");
    let derivatives = recorded.derivatives.expect("exact derivatives");
    for (states, rates) in recorded.states.iter().zip(&derivatives) {
        for k in 0..recordings::ROWS {
            let (angle, rate) = (states[0][k], states[1][k]);
            let power = rate * rates[1][k] + 4.905 * angle.sin() * rates[0][k];
            assert!((power + 0.2 * rate * rate).abs() < 1e-12, "{power}");
        }
    }
    let right = system("Lorenz 96, 5 states").1;
    let x = [1.3, -2.0, 0.7, 4.1, 2.2];
    let power: f64 = derivative(&right, &x).iter().zip(&x).map(|(d, x)| d * x).sum();
    let expected: f64 = x.iter().map(|x| 8.0 * x - x * x).sum();
    assert!((power - expected).abs() < 1e-12, "{power} {expected}");
}

/// The period of the limit cycle for small mu is `2 pi (1 + mu^2/16 - 5 mu^4/3072 - ...)` (Andersen and Geer, SIAM J. Appl. Math. 42, 1982).
#[test]
fn van_der_pol_has_its_period() {
    let right = system("Van der Pol").1;
    let mut state = [2.0, 0.0];
    right.advance(&mut state, 100.0, 20_000);
    let (step, mut time, mut crossings) = (1e-3, 0.0, Vec::new());
    while crossings.len() < 6 {
        let before = state;
        right.advance(&mut state, step, 1);
        if before[0] < 0.0 && state[0] >= 0.0 {
            crossings.push(time + step * before[0] / (before[0] - state[0]));
        }
        time += step;
    }
    let period = (crossings[5] - crossings[0]) / 5.0;
    let mu = 0.5_f64;
    let series = TAU * (1.0 + mu.powi(2) / 16.0 - 5.0 * mu.powi(4) / 3072.0);
    // The terms that follow are below 1e-4 together.
    assert!((period - series).abs() < 1e-4, "{period} {series}");
}

/// Largest Lyapunov exponent, 1/s, from the growth of a small difference that is rescaled every `interval` (Benettin, Galgani, Strelcyn 1976).
fn lyapunov(right: &RightSide, mut state: Vec<f64>, interval: f64, count: usize) -> f64 {
    const SIZE: f64 = 1e-8;
    right.advance(&mut state, 20.0, 4_000);
    let mut near = state.clone();
    near[0] += SIZE;
    let mut sum = 0.0;
    for _ in 0..count {
        right.advance(&mut state, interval, 100);
        right.advance(&mut near, interval, 100);
        let apart = state.iter().zip(&near).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        sum += (apart / SIZE).ln();
        near.iter_mut().zip(&state).for_each(|(near, x)| *near = x + (*near - x) * SIZE / apart);
    }
    sum / (interval * count as f64)
}

#[test]
fn chaos_is_as_strong_as_published() {
    // Lorenz: 0.9056 (Sprott, Chaos and Time-Series Analysis, 2003).
    let lorenz = lyapunov(&system("Lorenz").1, vec![1.0, 1.0, 20.0], 0.5, 800);
    assert!((lorenz - 0.9056).abs() < 0.05, "{lorenz}");
    let ring = lyapunov(&system("Lorenz 96, 5 states").1, vec![8.01, 8.0, 8.0, 8.0, 8.0], 0.5, 400);
    assert!(ring > 0.2, "{ring}");
}

/// All cases of one seed, made once for the tests.
fn cases() -> &'static Study {
    static STUDY: OnceLock<Study> = OnceLock::new();
    STUDY.get_or_init(|| run(1, &SYSTEMS, false).expect("the study runs"))
}

fn of(data: usize) -> impl Iterator<Item = &'static Case> {
    cases().cases.iter().filter(move |case| case.data == DATA[data].0)
}

#[test]
fn equations_are_recovered_at_one_percent_noise() {
    for (data, tolerance) in [(0, 1e-13), (1, 3e-3), (2, 3e-3), (3, 5e-3)] {
        for case in of(data) {
            for verdict in [case.fixed, case.chosen, case.ensemble] {
                let right = verdict.is_right() && verdict.error < tolerance;
                assert!(right, "{} {}: {verdict}", case.system, case.data);
            }
        }
    }
}

/// A tenth of noise is too much for plain differences: the threshold alone lets terms in that the ensemble does not.
#[test]
fn ensemble_has_fewer_wrong_terms() {
    for case in of(4) {
        assert!(
            case.ensemble.wrong() <= case.fixed.wrong(),
            "{}: {} beside {}",
            case.system,
            case.ensemble,
            case.fixed
        );
    }
    let total = |of: fn(&Case) -> Verdict| cases().cases.iter().map(|case| of(case).wrong()).sum::<usize>();
    let (fixed, ensemble) = (total(|case| case.fixed), total(|case| case.ensemble));
    assert!(ensemble < fixed, "{ensemble} wrong terms, {fixed} without it");
}

/// Two of the systems, one with sines and cosines, at every threshold: the rest only takes longer.
#[test]
fn pysindy_finds_the_same() {
    let study = run(1, &SYSTEMS[3..5], true).expect("the study runs");
    let version = match &study.peer {
        Ok(version) => version,
        Err(reason) => {
            assert!(crate::outside::python("pysindy").is_none(), "pysindy was not run: {reason}");
            return;
        }
    };
    for case in &study.cases {
        let place = format!("{} {}, pysindy {version}", case.system, case.data);
        let peer = case.peer.as_ref().expect("an answer to every case");
        assert_eq!(peer.same, thresholds().len(), "{place}");
        // Least squares on both sides: condition times rounding, with room.
        assert!(peer.apart < 1e-9, "{place}: {}", peer.apart);
        assert_eq!((peer.fixed.missing, peer.fixed.extra), (case.fixed.missing, case.fixed.extra), "{place}");
    }
}

/// The figures that plain least squares reaches on these recordings, train and test, in the order of the table.
const NEURAL_FLY: [[f64; 2]; 4] = [[0.1469, 0.1704], [0.1918, 0.1729], [0.1285, 0.1016], [0.2213, 0.2299]];

#[test]
fn neural_fly_is_reproduced() {
    let Some(folder) = crate::outside::data("neural-fly") else { return };
    let (rows, _) = neural_fly::table(&folder).expect("a table");
    for (row, figures) in rows.iter().zip(NEURAL_FLY) {
        for (error, figure) in row.least_squares.iter().zip(figures) {
            // The figures are rounded to four digits.
            assert!((error - figure).abs() < 1e-4, "{} m/s: {error} beside {figure}", row.wind);
        }
        assert!(row.stlsq[0] >= row.least_squares[0], "fewer terms fit the training rows no better");
        if let Some((errors, apart)) = row.peer {
            assert!(apart < 1e-6, "{} m/s: coefficients {apart} apart", row.wind);
            for (ours, theirs) in row.stlsq.iter().zip(errors) {
                assert!((ours - theirs).abs() < 1e-9 * theirs, "{} m/s: {ours} beside {theirs}", row.wind);
            }
        }
    }
}
