//! Filters of models, against dense algebra, in closed forms and on simulated systems whose noise is known.

use crate::common::*;
use faer::{Mat, linalg::solvers::Solve};
use fleetfoot_control::{
    ControlError, Error,
    filter::{
        Consistency, FilterError, FilterOptions, MeanBand, Measured, NoiseColour, ProcessFactor, SwitchedFilter,
        Switching,
    },
};
use fleetfoot_data::{EpisodeId, packed};
use fleetfoot_dynamics::{Stepper, StepperWorkspace};
use fleetfoot_model::{Model, Partition, Prediction, ResidualCorrelation, Role, Rule, Transitions};
use proptest::prelude::*;

/// A standard normal number from a key.
pub(crate) fn normal(key: u64) -> f64 {
    let uniform = |k: u64| 0.5 * (noise(k) + 1.0);
    let (u, v) = (1.0 - uniform(2 * key), uniform(2 * key + 1));
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Options that measure these states.
pub(crate) fn measured(states: &[(&str, f64)]) -> FilterOptions {
    let one = |&(state, deviation): &(&str, f64)| Measured { state: state.into(), deviation: Some(deviation) };
    FilterOptions { measured: states.iter().map(one).collect(), ..FilterOptions::default() }
}

/// Sets the residual covariance of every region, of very many rows.
fn with_noise(mut model: Model, covariance: &[f64]) -> Model {
    for region in model.summaries.iter_mut().flat_map(|summary| &mut summary.regions) {
        region.residual_covariance = covariance.to_vec();
        (region.rows, region.rank) = (1 << 60, 1);
    }
    model
}

/// `x+ = A x + B u + c`, one region, n states and one input.
fn linear(n: usize, seed: u64, covariance: &[f64]) -> Model {
    let names: Vec<String> = (0..n).map(|i| format!("x{i}")).chain(["u".to_owned()]).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let columns = (0..=n).map(|i| column(names[i], if i < n { Role::State } else { Role::Input }, false)).collect();
    let fitted = (0..n)
        .map(|i| {
            let row = (0..=n).map(|j| 0.5 * noise(seed * 1000 + (i * 20 + j) as u64) + if i == j { 0.5 } else { 0.0 });
            (names[i], Prediction::Next, "1", vec![(0.3 * noise(seed * 1000 + 900 + i as u64), row.collect())])
        })
        .collect();
    with_noise(model(columns, &names, Partition::whole(), fitted, &[]), covariance)
}

/// The mean and covariance of the last state given all measurements, by one dense least-squares problem over all states: the inverse of the information matrix.
fn batch(
    model: &Model,
    filter: &SwitchedFilter,
    inputs: &[f64],
    readings: &[Vec<f64>],
    r: &[f64],
) -> (Vec<f64>, Mat<f64>) {
    let (n, rows) = (filter.states().len(), readings.len());
    let coefficient = |i: usize, j: usize| model.latents[i].map.coefficient(0, j);
    let q = Mat::from_fn(n, n, |i, j| model.summaries[0].regions[0].residual_covariance[packed(i, j)]);
    let weight = q.partial_piv_lu().solve(Mat::<f64>::identity(n, n));
    let all = n * rows;
    let (mut information, mut right) = (Mat::<f64>::zeros(all, all), Mat::<f64>::zeros(all, 1));
    let sensors: Vec<usize> = filter.measured().collect();
    for s in 0..n {
        let read = sensors.iter().position(|&sensor| sensor == s).filter(|&k| readings[0][k].is_finite());
        if read.is_none() {
            let [mean, deviation] = filter.prior(s);
            information[(s, s)] += deviation.powi(-2);
            right[(s, 0)] += mean * deviation.powi(-2);
        }
    }
    for (row, reading) in readings.iter().enumerate() {
        for (k, &s) in sensors.iter().enumerate().filter(|(k, _)| reading[*k].is_finite()) {
            information[(row * n + s, row * n + s)] += r[k].powi(-2);
            right[(row * n + s, 0)] += reading[k] * r[k].powi(-2);
        }
        if row == 0 {
            continue;
        }
        // x_row - A x_(row-1) = B u + c, of covariance Q.
        let jacobian =
            Mat::from_fn(n, 2 * n, |i, j| if j < n { -coefficient(i, j) } else { f64::from(u8::from(j == n + i)) });
        let value = Mat::from_fn(n, 1, |i, _| coefficient(i, n) * inputs[row - 1] + model.latents[i].map.constant(0));
        let (normal, side) = (jacobian.transpose() * &weight * &jacobian, jacobian.transpose() * &weight * &value);
        for i in 0..2 * n {
            right[((row - 1) * n + i, 0)] += side[(i, 0)];
            for j in 0..2 * n {
                information[((row - 1) * n + i, (row - 1) * n + j)] += normal[(i, j)];
            }
        }
    }
    let lu = information.partial_piv_lu();
    let (mean, inverse) = (lu.solve(&right), lu.solve(Mat::<f64>::identity(all, all)));
    let last = all - n;
    ((0..n).map(|i| mean[(last + i, 0)]).collect(), Mat::from_fn(n, n, |i, j| inverse[(last + i, last + j)]))
}

#[test]
fn filtered_means_match_batch_solution() {
    /// States, process noise, sensors with their deviations.
    type Case<'a> = (usize, &'a [f64], &'a [(&'a str, f64)]);
    let cases: [Case<'_>; 3] = [
        (1, &[0.04], &[("x0", 0.3)]),
        (3, &[0.04, 0.01, 0.02, -0.005, 0.002, 0.03], &[("x0", 0.3), ("x2", 0.1)]),
        (4, &[0.01, 0.0, 0.02, 0.004, 0.0, 0.5, 0.0, 0.0, 0.0, 1e-4], &[("x3", 1e-3), ("x1", 2.0)]),
    ];
    for (seed, (n, covariance, sensors)) in cases.into_iter().enumerate() {
        let model = linear(n, seed as u64, covariance);
        let mut options = measured(sensors);
        if n > 1 {
            options.initial = vec![("x0".into(), 0.5, 2.0)];
        }
        let filter = SwitchedFilter::new(&model, &options).unwrap();
        let rows = 40;
        let inputs: Vec<f64> = (0..rows).map(|k| noise(k as u64 + 77)).collect();
        let missing = |row: usize, k: usize| row % 7 == 3 || (row == 0 && k == 1) || (row % 5 == 1 && k == 0);
        let read = |row: usize, k: usize| if missing(row, k) { f64::NAN } else { 2.0 * noise((row * 10 + k) as u64) };
        let readings: Vec<Vec<f64>> = (0..rows).map(|row| (0..sensors.len()).map(|k| read(row, k)).collect()).collect();
        let r: Vec<f64> = sensors.iter().map(|sensor| sensor.1).collect();
        let no_deviations = vec![f64::NAN; sensors.len()];
        let mut track = filter.start(&readings[0], &no_deviations);
        for row in 1..rows {
            filter.step(&mut track, &[inputs[row - 1]], 0.01, &readings[row], &no_deviations);
            if row < 5 || row == rows - 1 {
                let (mean, covariance) = batch(&model, &filter, &inputs, &readings[..=row], &r);
                for i in 0..n {
                    let (expected, estimate) = (mean[i], track.estimate().mean[i]);
                    // Information matrices of condition 1e7 leave as much of 1e-16.
                    assert!(
                        (expected - estimate).abs() < 1e-9 * expected.abs().max(1.0),
                        "{n} {row} {i}: {expected} {estimate}"
                    );
                    for j in 0..n {
                        let (expected, estimate) = (covariance[(i, j)], track.estimate().covariance[i * n + j]);
                        let size = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
                        assert!((expected - estimate).abs() < 1e-8 * size, "{n} {row} {i} {j}: {expected} {estimate}");
                    }
                }
            }
        }
    }
}

/// The mean and covariance of the last state given all measurements, of a model in one region whose whitened residuals
/// have these autocovariances (of lag 0, 1, ...). They come from conditioning the normal distribution of everything,
/// beginning and residuals of all rows: no autoregression, and no residual among the states.
fn conditioned(
    model: &Model,
    filter: &SwitchedFilter,
    inputs: &[f64],
    readings: &[Vec<f64>],
    (r, autocovariances): (&[f64], &[Mat<f64>]),
) -> (Vec<f64>, Mat<f64>) {
    let (n, rows) = (filter.states().len(), readings.len());
    let coefficient = |i: usize, j: usize| model.latents[i].map.coefficient(0, j);
    let a = Mat::from_fn(n, n, coefficient);
    let q = Mat::from_fn(n, n, |i, j| model.summaries[0].regions[0].residual_covariance[packed(i.max(j), i.min(j))]);
    let lower = q.llt(faer::Side::Lower).unwrap().L().to_owned();
    // Random draws: the first state, then the residuals of every step.
    let all = n * rows;
    let mut drawn = Mat::<f64>::zeros(all, all);
    let (mut mean, sensors) = (vec![0.0; n], filter.measured().collect::<Vec<_>>());
    for s in 0..n {
        let read = sensors.iter().position(|&sensor| sensor == s).filter(|&k| readings[0][k].is_finite());
        let [prior, deviation] = filter.prior(s);
        (mean[s], drawn[(s, s)]) = read.map_or((prior, deviation * deviation), |k| (readings[0][k], r[k] * r[k]));
    }
    for i in n..all {
        for j in n..all {
            let (one, other) = (i / n, j / n);
            let covariance = &autocovariances[one.abs_diff(other)];
            drawn[(i, j)] = if one >= other { covariance[(i % n, j % n)] } else { covariance[(j % n, i % n)] };
        }
    }
    // The state of a row as a function of it.
    let mut function = Mat::from_fn(n, all, |i, j| f64::from(u8::from(i == j)));
    let (mut observed, mut left, mut variances) = (Vec::new(), Vec::new(), Vec::new());
    for row in 1..rows {
        function = &a * &function;
        for i in 0..n {
            (0..n).for_each(|t| function[(i, row * n + t)] = lower[(i, t)]);
        }
        let next = |i: usize| {
            let states: f64 = (0..n).map(|j| coefficient(i, j) * mean[j]).sum();
            states + coefficient(i, n) * inputs[row - 1] + model.latents[i].map.constant(0)
        };
        mean = (0..n).map(next).collect();
        for (k, &s) in sensors.iter().enumerate().filter(|(k, _)| readings[row][*k].is_finite()) {
            observed.push((0..all).map(|j| function[(s, j)]).collect::<Vec<f64>>());
            left.push(readings[row][k] - mean[s]);
            variances.push(r[k] * r[k]);
        }
    }
    let seen = Mat::from_fn(observed.len(), all, |i, j| observed[i][j]);
    let cross = &function * &drawn * seen.transpose();
    let mut spread = &seen * &drawn * seen.transpose();
    variances.iter().enumerate().for_each(|(i, variance)| spread[(i, i)] += variance);
    let lu = spread.partial_piv_lu();
    let moved = &cross * lu.solve(Mat::from_fn(left.len(), 1, |i, _| left[i]));
    let covariance = &function * &drawn * function.transpose() - &cross * lu.solve(cross.transpose().to_owned());
    ((0..n).map(|i| mean[i] + moved[(i, 0)]).collect(), covariance)
}

#[test]
fn filter_with_coloured_noise_equals_joint_conditioning() {
    let rows = 30;
    // Of order 1 every lag is a power of the first; of order 2 a recursion of one number.
    let first = Mat::from_fn(3, 3, |i, j| [[0.8, 0.1, 0.0], [-0.2, 0.5, 0.1], [0.0, 0.3, 0.6]][i][j]);
    let mut powers = vec![Mat::<f64>::identity(3, 3)];
    (1..rows).for_each(|row| powers.push(&first * &powers[row - 1]));
    let mut second = vec![1.0, 1.2 / 1.5];
    (2..rows).for_each(|row| second.push(1.2 * second[row - 1] - 0.5 * second[row - 2]));
    let second: Vec<Mat<f64>> = second.into_iter().map(|value| Mat::from_fn(1, 1, |_, _| value)).collect();
    let of = |matrix: &Mat<f64>| {
        (0..matrix.nrows().pow(2)).map(|at| matrix[(at / matrix.nrows(), at % matrix.nrows())]).collect()
    };
    /// Autocovariances, how many lags are kept, process noise, sensors with their deviations.
    type Case<'a> = (&'a [Mat<f64>], usize, &'a [f64], &'a [(&'a str, f64)]);
    let cases: [Case<'_>; 2] = [
        (&powers, 1, &[0.04, 0.01, 0.02, -0.005, 0.002, 0.03], &[("x0", 0.3), ("x2", 0.1)]),
        (&second, 2, &[0.04], &[("x0", 0.3)]),
    ];
    for (seed, (autocovariances, lags, covariance, sensors)) in cases.into_iter().enumerate() {
        let n = autocovariances[0].nrows();
        let mut model = linear(n, seed as u64 + 20, covariance);
        let known = ResidualCorrelation { lags: autocovariances[1..=lags].iter().map(of).collect() };
        model.partitions[0].correlation = Some(known);
        let filter = SwitchedFilter::new(&model, &measured(sensors)).unwrap();
        assert_eq!(filter.colour().map(|colour| colour.order()), Some(lags));
        let inputs: Vec<f64> = (0..rows).map(|k| noise(k as u64 + 77)).collect();
        let missing = |row: usize, k: usize| row % 7 == 3 || (row == 0 && k == 1) || (row % 5 == 1 && k == 0);
        let read = |row: usize, k: usize| if missing(row, k) { f64::NAN } else { 2.0 * noise((row * 10 + k) as u64) };
        let readings: Vec<Vec<f64>> = (0..rows).map(|row| (0..sensors.len()).map(|k| read(row, k)).collect()).collect();
        let r: Vec<f64> = sensors.iter().map(|sensor| sensor.1).collect();
        let no_deviations = vec![f64::NAN; sensors.len()];
        let mut track = filter.start(&readings[0], &no_deviations);
        for row in 1..rows {
            filter.step(&mut track, &[inputs[row - 1]], 0.01, &readings[row], &no_deviations);
            let (mean, covariance) = conditioned(&model, &filter, &inputs, &readings[..=row], (&r, autocovariances));
            for i in 0..n {
                let (expected, estimate) = (mean[i], track.estimate().mean[i]);
                assert!(
                    (expected - estimate).abs() < 1e-9 * expected.abs().max(1.0),
                    "{n} {row} {i}: {expected} {estimate}"
                );
                for j in 0..n {
                    let (expected, estimate) = (covariance[(i, j)], track.estimate().covariance[i * n + j]);
                    let size = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
                    assert!((expected - estimate).abs() < 1e-9 * size, "{n} {row} {i} {j}: {expected} {estimate}");
                }
            }
        }
        // White noise of the same size is another filter.
        let white = FilterOptions { noise: NoiseColour::White, ..measured(sensors) };
        let white = SwitchedFilter::new(&model, &white).unwrap();
        let mut other = white.start(&readings[0], &no_deviations);
        (1..rows).for_each(|row| white.step(&mut other, &[inputs[row - 1]], 0.01, &readings[row], &no_deviations));
        assert!((other.estimate().mean[0] - track.estimate().mean[0]).abs() > 1e-3);
    }
}

/// A walk in two regions, left and right of `x = border`, that pull to -1 and 1 and drive v.
pub(crate) fn jumping(border: f64, q: f64) -> Model {
    let columns =
        vec![column("x", Role::State, false), column("v", Role::State, false), column("u", Role::Input, false)];
    // argmax(-(x - border), x - border).
    let split = partition(
        &["x"],
        &[border],
        &[1.0],
        Rule::Linear { weights: vec![vec![-1.0], vec![1.0]], offsets: vec![0.0, 0.0] },
    );
    let fitted = vec![
        ("x", Prediction::Next, "1", vec![(-0.05, vec![0.95, 0.1, 0.0]), (0.05, vec![0.95, 0.1, 0.0])]),
        ("v", Prediction::Next, "1", vec![(0.0, vec![0.05, 0.8, 0.3]), (0.02, vec![-0.1, 0.9, 0.1])]),
    ];
    with_noise(model(columns, &["x", "v", "u"], split, fitted, &[]), &[q * q, 0.0, q * q])
}

#[test]
fn a_region_without_mass_changes_no_bit() {
    let far = jumping(-1e6, 0.05);
    let mut one = far.clone();
    let regions = vec![one.summaries[0].regions[1].clone()];
    (one.partitions[0], one.summaries[0]) = (Partition::whole(), regions.into());
    for latent in &mut one.latents {
        let map = latent.affine_mut().unwrap();
        map.constants.remove(0);
        map.coefficients.remove(0);
    }
    let run = |model: &Model| {
        let filter = SwitchedFilter::new(model, &measured(&[("x", 0.2)])).unwrap();
        let mut track = filter.start(&[0.4], &[f64::NAN]);
        for row in 0..200 {
            let reading = if row % 9 == 4 { f64::NAN } else { noise(row) };
            filter.step(&mut track, &[noise(row + 500)], 0.01, &[reading], &[f64::NAN]);
        }
        track.estimate().clone()
    };
    assert_eq!(run(&far), run(&one));
}

/// States of a model with its own noise, from a point: rows x states.
pub(crate) fn simulated(
    model: &Model,
    start: &[f64],
    inputs: &[Vec<f64>],
    deviations: &[f64],
    seed: u64,
) -> Vec<Vec<f64>> {
    let stepper = Stepper::new(model).unwrap();
    let (mut points, mut workspace) = (stepper.points(1), StepperWorkspace::default());
    let mut states = vec![start.to_vec()];
    for (row, input) in inputs.iter().enumerate() {
        let x = states.last().unwrap().clone();
        x.iter().enumerate().for_each(|(s, &x)| points.column_mut(stepper.state_column(s), 0)[0] = x);
        input.iter().enumerate().for_each(|(i, &u)| points.column_mut(stepper.input_column(i), 0)[0] = u);
        let next = stepper.next(&mut points, model.step, fleetfoot_dynamics::Method::Rk4, &mut workspace).to_vec();
        let key = |s: usize| seed * 1_000_003 + (row * 16 + s) as u64;
        states.push(next.iter().zip(deviations).enumerate().map(|(s, (x, d))| x + d * normal(key(s))).collect());
    }
    states
}

/// Consistency of a filter over seeds.
#[derive(Debug)]
struct FilterScores {
    mean: MeanBand,
    share: f64,
    /// Root mean square of the errors of all states.
    error: f64,
}

/// A filter on simulations of its model with known noise, from a row on.
fn nees(
    model: &Model,
    options: &FilterOptions,
    deviations: &[f64],
    rows: std::ops::Range<usize>,
    seeds: u64,
) -> FilterScores {
    let filter = SwitchedFilter::new(model, options).unwrap();
    let n = filter.states().len();
    let all: Vec<usize> = (0..n).collect();
    let mut consistency = Consistency::new(n);
    let mut error = 0.0;
    for seed in 0..seeds {
        let inputs: Vec<Vec<f64>> = (0..rows.end)
            .map(|row| (0..filter.inputs().len()).map(|i| (0.05 * row as f64 + i as f64 + seed as f64).sin()).collect())
            .collect();
        // The truth begins where the filter thinks that it may.
        let drawn = |s: usize| filter.prior(s)[0] + filter.prior(s)[1] * normal(seed * 64 + s as u64 + (1 << 43));
        let truth = simulated(model, &(0..n).map(drawn).collect::<Vec<_>>(), &inputs, deviations, seed + 1);
        let reading = |row: usize| -> Vec<f64> {
            let sensors = filter.measured().zip(filter.deviations()).enumerate();
            sensors
                .map(|(k, (s, d))| {
                    truth[row][s] + d.unwrap() * normal(seed * 7_000_003 + (row * 8 + k) as u64 + (1 << 40))
                })
                .collect()
        };
        let no_deviations = vec![f64::NAN; options.measured.len()];
        let mut track = filter.start(&reading(0), &no_deviations);
        let mut squares = Vec::new();
        for row in 1..=rows.end {
            filter.step(&mut track, &inputs[row - 1], model.step, &reading(row), &no_deviations);
            let errors: Vec<f64> = truth[row].iter().zip(&track.estimate().mean).map(|(x, m)| x - m).collect();
            error += if row > rows.start { errors.iter().map(|e| e * e).sum::<f64>() } else { 0.0 };
            squares.push(track.estimate().square(&all, &errors));
        }
        consistency.add(EpisodeId(u128::from(seed) + 1), squares.split_off(rows.start));
    }
    FilterScores {
        mean: consistency.mean().unwrap(),
        share: consistency.share(),
        error: (error / (rows.len() as f64 * seeds as f64)).sqrt(),
    }
}

#[test]
fn errors_match_their_stated_covariance() {
    // The border is crossed every few rows, and x is measured no better than to a third of the distance of the regions' rests.
    let mut model = jumping(0.0, 0.1);
    let all = |model: &Model, options: &FilterOptions| nees(model, options, &[0.1, 0.1], 0..400, 40);
    let by_state = all(&model, &measured(&[("x", 0.3)]));
    assert!(by_state.mean.holds(), "{by_state:?}");
    assert!((by_state.share - 0.95).abs() < 0.01, "{by_state:?}");
    // Process noise that is said to have a tenth of its variance shows.
    let wrong = FilterOptions { process: ProcessFactor::Given(0.1), ..measured(&[("x", 0.3)]) };
    assert!(!all(&model, &wrong).mean.holds());
    // By transitions errors are told as well, but are half as large again: where the state is says more than how long the regions last.
    model.partitions[0].transitions = Some(Transitions { counts: vec![vec![900, 100], vec![100, 900]] });
    let by_counts = all(&model, &FilterOptions { switching: Switching::Transitions, ..measured(&[("x", 0.3)]) });
    assert!(by_counts.mean.holds() && by_state.error < 0.7 * by_counts.error, "{by_state:?} {by_counts:?}");
}

#[test]
fn errors_under_coloured_noise_match_their_covariance() {
    // Residuals go on by 0.9 of those before; the border is crossed every few rows.
    let (white, step) = (jumping(0.0, 0.1), 0.9f64);
    let mut model = white.clone();
    model.partitions[0].correlation = Some(ResidualCorrelation { lags: vec![vec![step, 0.0, 0.0, step]] });
    let mean = |noise: NoiseColour| {
        let filter = SwitchedFilter::new(&model, &FilterOptions { noise, ..measured(&[("x", 0.3)]) }).unwrap();
        let (mut nis, mut nees) = (Consistency::new(1), Consistency::new(2));
        for seed in 0..40u64 {
            let key = |row: usize, s: usize| seed * 1_000_003 + (row * 16 + s) as u64;
            let inputs: Vec<Vec<f64>> = (0..400).map(|row| vec![(0.05 * f64::from(row) + seed as f64).sin()]).collect();
            let (mut x, mut residual) =
                (vec![normal(key(0, 5)), normal(key(0, 6))], [normal(key(0, 7)), normal(key(0, 8))]);
            (0..2).for_each(|s| x[s] = filter.prior(s)[0] + filter.prior(s)[1] * x[s]);
            let seen = |x: &[f64], row: usize| [x[0] + 0.3 * normal(key(row, 9) + (1 << 40))];
            let mut track = filter.start(&seen(&x, 0), &[f64::NAN]);
            for (row, input) in inputs.iter().enumerate() {
                let next = simulated(&white, &x, std::slice::from_ref(input), &[0.0; 2], 0).remove(1);
                for s in 0..2 {
                    residual[s] = step * residual[s] + (1.0 - step * step).sqrt() * normal(key(row + 1, s));
                    x[s] = next[s] + 0.1 * residual[s];
                }
                filter.step(&mut track, input, model.step, &seen(&x, row + 1), &[f64::NAN]);
                nis.add(EpisodeId(u128::from(seed) + 1), [track.nis().0]);
                let errors = [x[0] - track.estimate().mean[0], x[1] - track.estimate().mean[1]];
                nees.add(EpisodeId(u128::from(seed) + 1), [track.estimate().square(&[0, 1], &errors)]);
            }
        }
        (nis.mean().unwrap(), nees.mean().unwrap())
    };
    let (nis, nees) = mean(NoiseColour::FromResiduals);
    println!("coloured: {nis:?} {nees:?}");
    assert!(nis.holds() && nees.holds(), "{nis:?} {nees:?}");
    let (nis, nees) = mean(NoiseColour::White);
    println!("white: {nis:?} {nees:?}");
    assert!(nis.mean > 1.1 && nees.mean > 2.0, "{nis:?} {nees:?}");
}

/// The hybrid robot (`hybrid-diff-drive`): x' = xd + f1, phi' = phid + f2, with (f1, f2) = (-1, 1) where xd > 0.
fn hybrid(h: f64, density: f64) -> Model {
    let columns = ["x", "phi", "xd", "phid"].map(|name| column(name, Role::State, false));
    let columns: Vec<_> =
        columns.into_iter().chain(["u1", "u2"].map(|name| column(name, Role::Input, false))).collect();
    let split = partition(
        &["xd"],
        &[0.0],
        &[1.0],
        Rule::Linear { weights: vec![vec![-1.0], vec![1.0]], offsets: vec![0.0, 0.0] },
    );
    let library = ["xd", "phid", "u1", "u2"];
    let fitted = vec![
        ("x", Prediction::Derivative, "dx", vec![(0.0, vec![1.0, 0.0, 0.0, 0.0]), (-1.0, vec![1.0, 0.0, 0.0, 0.0])]),
        ("phi", Prediction::Derivative, "dphi", vec![(0.0, vec![0.0, 1.0, 0.0, 0.0]), (1.0, vec![0.0, 1.0, 0.0, 0.0])]),
        ("xd", Prediction::Derivative, "ddx", vec![(0.0, vec![-0.175, 0.0, 0.5, 0.0]); 2]),
        ("phid", Prediction::Derivative, "ddphi", vec![(0.0, vec![0.0, -0.266667, 0.0, 0.6]); 2]),
    ];
    let mut columns = columns;
    columns.extend(["dx", "dphi", "ddx", "ddphi"].map(|name| column(name, Role::Auxiliary, false)));
    let mut model = model(columns, &library, split, fitted, &[]);
    model.step = h;
    // A derivative's residual of one row at a time: the density by the step.
    let s = density / h;
    with_noise(model, &[s, 0.0, s, 0.0, 0.0, s, 0.0, 0.0, 0.0, s])
}

#[test]
fn filter_follows_hybrid_robot_across_border() {
    let (h, density) = (0.01, 1e-3);
    let model = hybrid(h, density);
    let d = (density * h).sqrt();
    // Without its speeds the robot in one region may as well be one in the other that is slower by 1 m/s, until both have accelerated: two seconds.
    let positions = [("x", 0.02), ("phi", 0.02)];
    let speeds = [("x", 0.02), ("phi", 0.02), ("xd", 0.1), ("phid", 0.1)];
    for (sensors, rows) in [(&positions[..], 200..900), (&speeds[..], 0..900)] {
        let consistency = nees(&model, &measured(sensors), &[d; 4], rows.clone(), 20);
        println!("hybrid robot, {} sensors: {consistency:?}", sensors.len());
        assert!(consistency.mean.holds() && (consistency.share - 0.95).abs() < 0.015, "{consistency:?}");
        // Regions that switch by chance whose speeds nobody measures are taken for each other for good.
        let mut model = model.clone();
        model.partitions[0].transitions = Some(Transitions { counts: vec![vec![980, 20], vec![20, 980]] });
        let by_counts = FilterOptions { switching: Switching::Transitions, ..measured(sensors) };
        let by_counts = nees(&model, &by_counts, &[d; 4], rows, 20);
        println!("hybrid robot, {} sensors, by transitions: {by_counts:?}", sensors.len());
        assert!(by_counts.error > consistency.error, "{by_counts:?} {consistency:?}");
    }
}

#[test]
fn covariances_stay_symmetric_and_definite() {
    // A sensor a million times better than the prior, for a long time, and then none.
    let model = hybrid(0.01, 1e-9);
    let filter = SwitchedFilter::new(&model, &measured(&[("x", 1e-6)])).unwrap();
    let mut track = filter.start(&[0.0], &[f64::NAN]);
    for row in 0..5000u64 {
        let reading = if row < 4000 { 0.1 * (0.01 * row as f64).sin() } else { f64::NAN };
        filter.step(&mut track, &[0.1, -0.1], 0.01, &[reading], &[f64::NAN]);
        let covariance = &track.estimate().covariance;
        for i in 0..4 {
            assert!(covariance[i * 4 + i] > 0.0);
            for j in 0..4 {
                assert_eq!(covariance[i * 4 + j].to_bits(), covariance[j * 4 + i].to_bits());
            }
        }
        assert!(track.estimate().square(&[0, 1, 2, 3], &[1.0, 0.0, 0.0, 0.0]).is_finite(), "{row}: {covariance:?}");
        let all: f64 = track.probabilities().iter().sum();
        assert!((all - 1.0).abs() < 1e-12, "{all}");
    }
}

#[test]
fn missing_rows_are_predicted_across() {
    let model = jumping(0.0, 0.1);
    let filter = SwitchedFilter::new(&model, &measured(&[("x", 0.3)])).unwrap();
    let run = |missing: bool| {
        let mut track = filter.start(&[0.3], &[f64::NAN]);
        for row in 0..40 {
            let reading = [noise(row + 30)];
            if missing {
                filter.step(&mut track, &[0.5], 0.04, &reading, &[f64::NAN]);
            } else {
                (0..3).for_each(|_| filter.step(&mut track, &[0.5], 0.01, &[f64::NAN], &[f64::NAN]));
                filter.step(&mut track, &[0.5], 0.01, &reading, &[f64::NAN]);
            }
        }
        track.estimate().clone()
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn models_that_cannot_be_filtered_are_refused() {
    let model = jumping(0.0, 0.1);
    let refused = |options: &FilterOptions| SwitchedFilter::new(&model, options).err().unwrap();
    assert!(matches!(refused(&FilterOptions::default()), Error::Filter(FilterError::NotMeasured { .. })));
    assert!(matches!(refused(&measured(&[("w", 1.0)])), Error::Control(ControlError::Unknown { .. })));
    assert!(matches!(refused(&measured(&[("x", 0.0)])), Error::Control(ControlError::Value { .. })));
    let by_counts = FilterOptions { switching: Switching::Transitions, ..measured(&[("x", 1.0)]) };
    assert!(matches!(refused(&by_counts), Error::Filter(FilterError::NoTransitions)));
    let coloured = FilterOptions { noise: NoiseColour::Coloured, ..measured(&[("x", 1.0)]) };
    assert!(matches!(refused(&coloured), Error::Filter(FilterError::NoCorrelation)));
    let unknown = with_noise(model.clone(), &[f64::NAN; 3]);
    let error = SwitchedFilter::new(&unknown, &measured(&[("x", 1.0)])).err().unwrap();
    assert!(matches!(error, Error::Filter(FilterError::NoResiduals { .. })), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn the_order_of_regions_does_not_matter(seed in 0u64..1000, turn in 1usize..4) {
        let regions = 4;
        let (model, _) = random_hybrid(3, 1, regions, 5);
        let model = with_noise(model, &identity(3, 0.01));
        let mut turned = model.clone();
        let at = |region: usize| (region + turn) % regions;
        let seen = (0..regions).map(|region| model.summaries[0].regions[at(region)].clone());
        turned.summaries[0].regions = seen.collect();
        let partition = &mut turned.partitions[0];
        if let Rule::Linear { weights, offsets } = &model.partitions[0].rule {
            partition.rule = Rule::Linear {
                weights: (0..regions).map(|region| weights[at(region)].clone()).collect(),
                offsets: (0..regions).map(|region| offsets[at(region)]).collect(),
            };
        }
        for (latent, from) in turned.latents.iter_mut().zip(&model.latents) {
            let (map, from) = (latent.affine_mut().unwrap(), from.affine().unwrap());
            map.constants = (0..regions).map(|region| from.constants[at(region)]).collect();
            map.coefficients = (0..regions).map(|region| from.coefficients[at(region)].clone()).collect();
        }
        let run = |model: &Model| {
            let filter = SwitchedFilter::new(model, &measured(&[("x0", 0.3), ("x1", 0.5)])).unwrap();
            let mut track = filter.start(&[noise(seed), noise(seed + 1)], &[f64::NAN; 2]);
            for row in 0..60 {
                let readings = [2.0 * noise(seed * 100 + row), 2.0 * noise(seed * 100 + 7000 + row)];
                filter.step(&mut track, &[noise(seed * 100 + 9000 + row)], model.step, &readings, &[f64::NAN; 2]);
            }
            (track.estimate().clone(), track.probabilities().to_vec(), track.log_likelihood())
        };
        let ((a, p, l), (b, q, m)) = (run(&model), run(&turned));
        // Sums of the same numbers in another order.
        prop_assert!(a.mean.iter().zip(&b.mean).all(|(a, b)| (a - b).abs() < 1e-9 * a.abs().max(1.0)), "{:?} {:?}", a, b);
        prop_assert!(a.covariance.iter().zip(&b.covariance).all(|(a, b)| (a - b).abs() < 1e-9), "{:?} {:?}", a, b);
        prop_assert!((0..regions).all(|region| (p[at(region)] - q[region]).abs() < 1e-9), "{:?} {:?}", p, q);
        prop_assert!((l - m).abs() < 1e-8, "{l} {m}");
    }
}
