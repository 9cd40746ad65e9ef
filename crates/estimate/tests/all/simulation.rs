//! Coefficients by simulation error: closed forms, noise in the states, scipy, and refusals.

use std::{fs, path::Path, process::Command};

use fleetfoot_data::{Column as DataColumn, MemorySource, Silent, with_threads};
use fleetfoot_dynamics::Coefficient;
use fleetfoot_estimate::{EstimateError, MOST_PRODUCTS, Simulated, SimulationOptions, Status, simulation_error};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{
    AffineMap, Column, Equation, Latent, Model, Partition, Prediction, RegionSummary, Role, Rule, Training,
};
use fleetfoot_stats::{Factor, least_squares};

use crate::outside;

/// Noise of standard deviation one that is the same everywhere (the sum of twelve uniform numbers).
pub(crate) fn noise(key: usize) -> f64 {
    let uniform = |i: u64| {
        let mut z = (key as u64 * 12 + i).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ (z >> 31)) as f64 / u64::MAX as f64
    };
    (0..12).map(uniform).sum::<f64>() - 6.0
}

pub(crate) fn expression(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).expect("an expression")
}

/// A fitted equation: subject, prediction and, per region, the constant and the coefficients.
pub(crate) type Fitted<'a> = (&'a str, Prediction, Vec<(f64, Vec<f64>)>);

/// A model of states of unit deviation.
pub(crate) fn model(
    states: &[&str],
    inputs: &[&str],
    library: &[&str],
    partition: Partition,
    fitted: &[Fitted<'_>],
    given: &[(&str, &str)],
    step: f64,
) -> Model {
    let column = |name: &&str, role| Column::new(*name, role);
    let columns = states.iter().map(|name| column(name, Role::State));
    let columns = columns.chain(inputs.iter().map(|name| column(name, Role::Input))).collect();
    let unit = |n: usize| (0..n).flat_map(|i| (0..=i).map(move |j| f64::from(u8::from(i == j)))).collect::<Vec<f64>>();
    let training = Training {
        state_covariance: unit(states.len()),
        target_mean: vec![0.0; fitted.len()],
        target_covariance: unit(fitted.len()),
        target_deviation: vec![1.0; fitted.len()],
        ..Training::default()
    };
    let mut model = Model::new("test", columns, step, training);
    model.libraries.push(library.iter().map(|text| expression(text)).collect());
    let (functions, regions) = (library.len(), partition.rule.count());
    model.add_partition(partition, (0..regions).map(|index| region(index, functions, unit(fitted.len()))).collect());
    for (subject, prediction, maps) in fitted {
        let name = format!("f_{subject}");
        let (constants, coefficients) = maps.iter().cloned().unzip();
        let (subject, target) = ((*subject).to_owned(), Some(expression(subject)));
        model.equations.push(Equation {
            subject,
            prediction: *prediction,
            right: Expr::column(name.as_str()),
            target,
            unit: None,
        });
        model.latents.push(Latent {
            beyond: Vec::new(),
            name,
            library: 0,
            partition: 0,
            map: AffineMap { constants, coefficients }.into(),
        });
    }
    for (subject, right) in given {
        let prediction = Prediction::Derivative;
        model.equations.push(Equation {
            subject: (*subject).into(),
            prediction,
            right: expression(right),
            target: None,
            unit: None,
        });
    }
    model.validate().expect("a model");
    model
}

/// Region summary of so many functions, as training might give it.
fn region(index: usize, functions: usize, residual_covariance: Vec<f64>) -> RegionSummary {
    RegionSummary {
        name: index.to_string(),
        rows: 1,
        mean: vec![0.0; functions],
        covariance: vec![0.0; functions * (functions + 1) / 2],
        range: vec![[-9.0, 9.0]; functions],
        residual_covariance,
        rank: functions,
        condition: 1.0,
        confounded: Vec::new(),
    }
}

pub(crate) fn source(names: &[&str], period: f64, episodes: Vec<Vec<Vec<f64>>>) -> MemorySource {
    let mut source = MemorySource::new(names.iter().map(|name| DataColumn::float(*name)).collect());
    for (number, columns) in episodes.into_iter().enumerate() {
        source.push_uniform(format!("run{number}"), period, columns);
    }
    source
}

/// To the last digits.
pub(crate) fn exact(steps: usize) -> SimulationOptions {
    let mut options = SimulationOptions::new(steps);
    let descent = &mut options.descent;
    (descent.gradient, descent.step, descent.cost, descent.max_iterations) = (1e-13, 1e-15, 1e-15, 100);
    options
}

pub(crate) fn fit(model: &Model, source: &MemorySource, options: &SimulationOptions) -> Simulated {
    simulation_error(model, source, options, &Silent).expect("a model")
}

/// x(k+1) = A x(k) + B u(k).
const A: [[f64; 2]; 2] = [[0.95, 0.20], [-0.25, 0.90]];
const B: [f64; 2] = [0.1, 0.3];

/// Episodes of the linear system, measured with noise of deviation `sigma`: x, y, u.
pub(crate) fn linear(seed: usize, rows: usize, sigma: f64) -> Vec<Vec<f64>> {
    let (mut state, mut columns) = ([1.0, 0.5], vec![Vec::new(); 3]);
    for k in 0..rows {
        let input = noise(seed * 7919 + 10 * k);
        columns[0].push(state[0] + sigma * noise(seed * 7919 + 10 * k + 1));
        columns[1].push(state[1] + sigma * noise(seed * 7919 + 10 * k + 2));
        columns[2].push(input);
        let next = |i: usize| A[i][0] * state[0] + A[i][1] * state[1] + B[i] * input;
        state = [next(0), next(1)];
    }
    columns
}

/// Coefficients of one step ahead by least squares, without a constant.
fn one_step(episodes: &[Vec<Vec<f64>>]) -> Vec<Vec<f64>> {
    let mut factor = Factor::new(4, 2);
    for columns in episodes {
        for sign in [1.0, -1.0] {
            // Rows and their mirror images have no mean: the intercept is zero.
            let rows = columns[0].len() - 1;
            let value = |i: usize, j: usize| match j {
                0..3 => columns[j][i],
                3 => 0.0,
                _ => columns[j - 4][i + 1],
            };
            factor.push(faer::Mat::from_fn(rows, 6, |i, j| sign * value(i, j)).as_ref(), None);
        }
    }
    let solution = least_squares(&factor.square_root(), &[1.0; 4]);
    (0..2).map(|t| (0..3).map(|j| solution.coefficients[(j, t)]).collect()).collect()
}

pub(crate) fn linear_model(coefficients: &[Vec<f64>]) -> Model {
    let equation = |t: usize| (["x", "y"][t], Prediction::Next, vec![(0.0, coefficients[t].clone())]);
    model(&["x", "y"], &["u"], &["x", "y", "u"], Partition::whole(), &[equation(0), equation(1)], &[], 0.1)
}

/// Greatest error of an entry of A and B.
fn error(coefficients: &[Vec<f64>]) -> f64 {
    let truth = |t: usize, j: usize| if j < 2 { A[t][j] } else { B[t] };
    let entries = (0..2).flat_map(|t| (0..3).map(move |j| (t, j)));
    entries.map(|(t, j)| (coefficients[t][j] - truth(t, j)).abs()).fold(0.0, f64::max)
}

fn coefficients(model: &Model) -> Vec<Vec<f64>> {
    model.latents.iter().map(|latent| latent.affine().unwrap().coefficients[0].clone()).collect()
}

#[test]
fn rows_without_noise_give_the_system() {
    let source = source(&["x", "y", "u"], 0.1, vec![linear(1, 200, 0.0), linear(2, 150, 0.0)]);
    let start = linear_model(&[vec![0.8, 0.1, 0.2], vec![-0.1, 0.7, 0.2]]);
    let fitted = fit(&start, &source, &exact(8));
    assert!(error(&coefficients(&fitted.model)) < 1e-12, "{:?}", coefficients(&fitted.model));
    assert!(fitted.status.converged() && fitted.cost[1] < 1e-20 * fitted.cost[0], "{fitted:?}");
    assert_eq!((fitted.segments, fitted.missing, fitted.residuals), (24 + 18, 0, 42 * 16));
}

/// Noise in the states that a step is fitted on pulls its coefficients towards zero by sigma^2 / (sigma^2 + variance),
/// whatever the number of rows. Over ten steps the known inputs and the dynamics weigh more than the first state.
#[test]
fn state_noise_biases_only_one_step_fits() {
    let mut won = 0;
    let mut sums = [0.0, 0.0];
    for seed in 0..10 {
        let episodes: Vec<Vec<Vec<f64>>> = (0..4).map(|episode| linear(10 * seed + episode, 500, 0.3)).collect();
        let start = one_step(&episodes);
        let source = source(&["x", "y", "u"], 0.1, episodes);
        let fitted = fit(&linear_model(&start), &source, &SimulationOptions::new(10));
        let errors = [error(&start), error(&coefficients(&fitted.model))];
        won += usize::from(errors[1] < errors[0]);
        (0..2).for_each(|i| sums[i] += errors[i] / 10.0);
    }
    println!(
        "greatest error of an entry: {:.4} one step ahead, {:.4} by ten steps, better in {won} of 10",
        sums[0], sums[1]
    );
    assert!(won == 10 && sums[1] < 0.4 * sums[0], "{won} {sums:?}");
}

/// x' = y, y' = -x + y - x^2 y, by Runge-Kutta steps far shorter than the rows are apart, and measured with noise.
fn van_der_pol(rows: usize, period: f64, sigma: f64) -> Vec<Vec<f64>> {
    let slope = |[x, y]: [f64; 2]| [y, -x + y - x * x * y];
    let (mut state, mut columns, parts) = ([1.0, 0.0], vec![Vec::new(); 2], 20);
    for k in 0..rows {
        (0..2).for_each(|i| columns[i].push(state[i] + sigma * noise(40 * k + i)));
        for _ in 0..parts {
            let h = period / f64::from(parts);
            let moved = |f: [f64; 2], h: f64| [state[0] + h * f[0], state[1] + h * f[1]];
            let one = slope(state);
            let two = slope(moved(one, 0.5 * h));
            let three = slope(moved(two, 0.5 * h));
            let four = slope(moved(three, h));
            (0..2).for_each(|i| state[i] += h / 6.0 * (one[i] + 2.0 * two[i] + 2.0 * three[i] + four[i]));
        }
    }
    columns
}

#[test]
fn scipy_has_the_same_minimum() {
    let Some(python) = outside::python("numpy, scipy.optimize") else { return };
    let (period, steps) = (0.1, 10);
    let columns = van_der_pol(400, period, 0.05);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("rows");
    fs::write(&file, (0..400).map(|k| format!("{:?} {:?}\n", columns[0][k], columns[1][k])).collect::<String>())
        .unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/peers/shooting.py");
    let output =
        Command::new(&python).arg(script).arg(&file).args([steps.to_string(), period.to_string()]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let peer: Vec<f64> = text.lines().map(|line| line.parse().unwrap()).collect();
    let fitted = [("y", Prediction::Derivative, vec![(0.0, vec![-0.9, 0.8, -0.8])])];
    let start = model(&["x", "y"], &[], &["x", "y", "x^2*y"], Partition::whole(), &fitted, &[("x", "y")], period);
    let fitted = fit(&start, &source(&["x", "y"], period, vec![columns]), &exact(steps));
    let coefficients_of_x = &coefficients(&fitted.model)[0];
    println!("{coefficients_of_x:?} {peer:?} {:?}", fitted.status);
    for (coefficient, peer) in coefficients_of_x.iter().zip(&peer) {
        assert!((coefficient - peer).abs() < 1e-8, "{coefficient} {peer}");
    }
    assert!((fitted.cost[1] / peer[3] - 1.0).abs() < 1e-12);
}

/// Regions with separate maps, zeros among them: zeros stay, and the other coefficients are recovered.
fn hybrid() -> (Model, MemorySource) {
    let truth = [(0.3, vec![-1.0, 0.0]), (0.0, vec![-0.4, 2.0])];
    let rule = Rule::voronoi(vec![vec![-1.0], vec![1.0]]);
    let mut regions = Partition::whole();
    (regions.columns, regions.centre, regions.scale, regions.rule) =
        (vec![expression("x")], vec![0.0], vec![1.0], rule);
    let maps = |factor: f64| {
        let scaled = |(constant, row): &(f64, Vec<f64>)| (constant * factor, row.iter().map(|c| c * factor).collect());
        truth.iter().map(scaled).collect()
    };
    let build = |factor: f64| {
        let fitted = [("x", Prediction::Derivative, maps(factor))];
        model(&["x"], &["u"], &["x", "u"], regions.clone(), &fitted, &[], 0.05)
    };
    let mut episodes = Vec::new();
    for episode in 0..12 {
        let (mut x, mut columns) = (if episode % 2 == 0 { 1.0 } else { -2.0 }, vec![Vec::new(), Vec::new()]);
        for k in 0..100 {
            let u = (0.07 * f64::from(k) + f64::from(episode)).sin() + 0.2;
            columns[0].push(x);
            columns[1].push(u);
            let (constant, row) = &truth[usize::from(x > 0.0)];
            x += 0.05 * (constant + row[0] * x + row[1] * u);
        }
        episodes.push(columns);
    }
    (build(0.8), source(&["x", "u"], 0.05, episodes))
}

#[test]
fn the_support_is_kept_and_threads_change_no_bit() {
    let (start, source) = hybrid();
    let mut options = SimulationOptions::new(6);
    options.descent.chunk_rows = 40;
    let fits: Vec<Simulated> = [1, 3].map(|threads| with_threads(threads, || fit(&start, &source, &options))).into();
    assert_eq!(fits[0].model, fits[1].model);
    assert_eq!((fits[0].cost, fits[0].passes), (fits[1].cost, fits[1].passes));
    assert_eq!(Coefficient::support(&fits[0].model), Coefficient::support(&start));
    assert_eq!(fits[0].coefficients.len(), 4);
    assert!(fits[0].cost[1] < 0.5 * fits[0].cost[0] && fits[0].passes <= options.passes(4, false), "{fits:?}");
}

#[test]
fn segments_with_missing_inputs_are_dropped() {
    let mut columns = linear(1, 101, 0.0);
    columns[2][13] = f64::NAN;
    columns[0][27] = f64::NAN;
    let source = source(&["x", "y", "u"], 0.1, vec![columns]);
    let fitted = fit(&linear_model(&[vec![0.9, 0.1, 0.2], vec![-0.1, 0.9, 0.2]]), &source, &exact(10));
    assert_eq!((fitted.segments, fitted.missing), (8, 1));
    assert_eq!(fitted.residuals, 8 * 20 - 1);
    assert!(error(&coefficients(&fitted.model)) < 1e-11);
}

/// A system that grows without bound from where the search begins: its segments end early, and the steps lead back to one that does not.
#[test]
fn diverging_start_recovers() {
    let source = source(&["x", "y", "u"], 0.1, vec![linear(3, 400, 0.0)]);
    let fitted = fit(&linear_model(&[vec![1.9, 0.2, 0.1], vec![-0.2, 1.7, 0.3]]), &source, &exact(12));
    assert!(fitted.ended[0] > 0 && fitted.ended[1] == 0, "{:?}", fitted.ended);
    assert!(error(&coefficients(&fitted.model)) < 1e-9, "{:?}", coefficients(&fitted.model));
}

#[test]
fn models_that_cannot_be_fitted_are_refused() {
    let rows = source(&["x", "y", "u"], 0.1, vec![linear(1, 30, 0.0)]);
    let refused = |model: &Model, steps: usize| {
        simulation_error(model, &rows, &SimulationOptions::new(steps), &Silent).expect_err("an error")
    };
    let zeros = linear_model(&[vec![0.0; 3], vec![0.0; 3]]);
    assert!(matches!(refused(&zeros, 5), EstimateError::NoParameters));
    let full = linear_model(&[vec![0.9, 0.1, 0.2], vec![-0.1, 0.9, 0.2]]);
    let long = refused(&full, 40).to_string();
    assert!(long.contains("40 steps") && long.contains("30"), "{long}");
    let library: Vec<String> = (0..MOST_PRODUCTS.isqrt()).map(|k| format!("x^{}", k + 1)).collect();
    let library: Vec<&str> = library.iter().map(String::as_str).collect();
    let fitted = [("x", Prediction::Next, vec![(1e-3, vec![1e-3; library.len()])])];
    let large = model(&["x"], &[], &library, Partition::whole(), &fitted, &[], 0.1);
    let message = refused(&large, 5).to_string();
    assert!(message.contains("16785409") && message.contains("16777216"), "{message}");
    let mut few = SimulationOptions::new(5);
    few.descent.max_iterations = 1;
    let fitted = fit(&full, &rows, &few);
    assert_eq!((fitted.status, fitted.passes), (Status::Iterations, 2));
}
