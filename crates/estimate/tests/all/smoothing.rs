//! States and coefficients together: dense algebra, the objective's gradient by differences, descent, gaps, missing values, inputs, sizes, threads.

use fleetfoot_data::{Column as DataColumn, Episode, MemorySource, Silent, Source, with_threads};
use fleetfoot_dynamics::Coefficient;
use fleetfoot_estimate::{EstimateError, Settled, SmoothingOptions, StateSmoother, Variances};
use fleetfoot_library::Expr;
use fleetfoot_model::{
    AffineMap, Column, Equation, Latent, Model, Partition, Prediction, RegionSummary, Role, Training,
};
use proptest::prelude::*;

use crate::simulation::{expression, noise as draw};

/// x' = a latent each, over the functions, beside its known part.
fn model(states: &[(&str, &str)], inputs: &[&str], functions: &[&str], period: f64) -> Model {
    let column = |name: &str, role| Column::new(name, role);
    let columns = states.iter().map(|(name, _)| column(name, Role::State));
    let columns = columns.chain(inputs.iter().map(|name| column(name, Role::Input))).collect();
    let n = states.len();
    let state_covariance = (0..n).flat_map(|i| (0..=i).map(move |j| if i == j { 1.0 } else { 0.0 })).collect();
    let mut model = Model::new("test", columns, period, Training { state_covariance, ..Training::default() });
    let latent = |name: &str| format!("of_{name}");
    model.latents = states
        .iter()
        .map(|(name, _)| Latent {
            beyond: Vec::new(),
            name: latent(name),
            library: 0,
            partition: 0,
            map: AffineMap { constants: vec![0.0], coefficients: vec![vec![0.0; functions.len()]] }.into(),
        })
        .collect();
    model.libraries = vec![functions.iter().map(|text| expression(text)).collect()];
    let p = functions.len();
    let region = RegionSummary {
        name: "all".into(),
        rows: 0,
        mean: vec![f64::NAN; p],
        covariance: vec![f64::NAN; p * (p + 1) / 2],
        range: vec![[f64::NEG_INFINITY, f64::INFINITY]; p],
        residual_covariance: Vec::new(),
        rank: p,
        condition: f64::NAN,
        confounded: Vec::new(),
    };
    model.add_partition(Partition::whole(), vec![region]);
    model.equations = states
        .iter()
        .map(|(name, known)| Equation {
            subject: (*name).into(),
            prediction: Prediction::Derivative,
            right: (expression(known) + Expr::column(latent(name).as_str())).simplified(),
            target: None,
            unit: None,
        })
        .collect();
    model
}

fn coefficient(latent: usize, function: usize) -> Coefficient {
    Coefficient { region: 0, latent, function: Some(function) }
}

fn all(states: usize, functions: usize) -> Vec<Coefficient> {
    (0..states).flat_map(|t| (0..functions).map(move |j| coefficient(t, j))).collect()
}

fn source(names: &[&str], episodes: Vec<(f64, Vec<Vec<f64>>)>) -> MemorySource {
    let mut source = MemorySource::new(names.iter().map(|name| DataColumn::float(*name)).collect());
    for (at, (period, columns)) in episodes.into_iter().enumerate() {
        source.push_uniform(format!("run{at}"), period, columns);
    }
    source
}

fn smoother(model: &Model, candidates: Vec<Coefficient>, rows: &dyn Source) -> StateSmoother {
    StateSmoother::new(model, candidates, rows, SmoothingOptions::default(), &Silent).unwrap()
}

/// Noise of deviation 1.
fn noise(rows: usize, seed: u64) -> Vec<f64> {
    (0..rows).map(|k| draw(seed as usize * 10_007 + k)).collect()
}

/// Gaussian elimination with the largest pivot.
fn solved(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for step in 0..n {
        let pivot = (step..n).max_by(|&i, &j| a[i][step].abs().total_cmp(&a[j][step].abs())).unwrap();
        a.swap(step, pivot);
        b.swap(step, pivot);
        for row in step + 1..n {
            let factor = a[row][step] / a[step][step];
            let (above, below) = a.split_at_mut(row);
            below[0].iter_mut().zip(&above[step]).skip(step).for_each(|(x, y)| *x -= factor * y);
            b[row] -= factor * b[step];
        }
    }
    for row in (0..n).rev() {
        let known: f64 = (row + 1..n).map(|j| a[row][j] * b[j]).sum();
        b[row] = (b[row] - known) / a[row][row];
    }
    b
}

/// A noisy oscillation with an input, some measurements missing.
fn oscillation(rows: usize, period: f64, seed: u64) -> Vec<Vec<f64>> {
    let (e, f) = (noise(rows, seed), noise(rows, seed + 1));
    let t = |k: usize| k as f64 * period;
    let missing = |k: usize, value: f64| if k % 7 == 3 { f64::NAN } else { value };
    vec![
        (0..rows).map(|k| missing(k, t(k).cos() + 0.1 * e[k])).collect(),
        (0..rows).map(|k| -t(k).sin() + 0.1 * f[k]).collect(),
        (0..rows).map(|k| (0.7 * t(k)).sin()).collect(),
    ]
}

#[test]
fn a_linear_system_is_smoothed_as_dense_least_squares_does() {
    // Hermite and Simpson's constraint of z' = A z + b u is linear in z: everything can be written down.
    let (rows, h, r, q) = (41, 0.05, [0.01, 0.02], [1e-5, 3e-6]);
    let columns = oscillation(rows, h, 3);
    let data = source(&["x", "v", "u"], vec![(h, columns.clone())]);
    let model = model(&[("x", "0"), ("v", "0.3*u")], &["u"], &["x", "v"], h);
    let smoother = smoother(&model, all(2, 2), &data);
    let variances = Variances { measurement: r.to_vec(), process: q.to_vec() };
    let a = [[0.0, 1.0], [-1.1, -0.2]];
    let coefficients = [a[0][0], a[0][1], a[1][0], a[1][1]];
    let settled = smoother.settle((&smoother.recorded(), &coefficients), &[], (&variances, 1e-12), &Silent).unwrap();
    assert!(settled.converged && settled.steps <= 2, "{} steps", settled.steps);

    // zeta = z1 - z0 - h/6 (f0 + 4 fm + f1), zm = (z0 + z1)/2 + h/8 (f0 - f1), row by row.
    let times = |m: [[f64; 2]; 2], x: [f64; 2]| [m[0][0] * x[0] + m[0][1] * x[1], m[1][0] * x[0] + m[1][1] * x[1]];
    let zeta = |z0: [f64; 2], z1: [f64; 2], u: [f64; 2]| {
        let rate = |z: [f64; 2], u: f64| {
            let rates = times(a, z);
            [rates[0], rates[1] + 0.3 * u]
        };
        let (f0, f1) = (rate(z0, u[0]), rate(z1, u[1]));
        let middle = [0, 1].map(|s| 0.5 * (z0[s] + z1[s]) + h / 8.0 * (f0[s] - f1[s]));
        let fm = rate(middle, 0.5 * (u[0] + u[1]));
        [0, 1].map(|s| z1[s] - z0[s] - h / 6.0 * (f0[s] + 4.0 * fm[s] + f1[s]))
    };
    let size = 2 * rows;
    let (mut normal, mut right) = (vec![vec![0.0; size]; size], vec![0.0; size]);
    let mut add = |entries: &[(usize, f64)], value: f64, variance: f64| {
        for &(i, x) in entries {
            entries.iter().for_each(|&(j, y)| normal[i][j] += x * y / variance);
            right[i] += x * value / variance;
        }
    };
    for k in 0..rows {
        for s in 0..2 {
            if columns[s][k].is_finite() {
                add(&[(2 * k + s, 1.0)], columns[s][k], r[s]);
            }
        }
        if k + 1 < rows {
            let u = [columns[2][k], columns[2][k + 1]];
            let (zero, unit) = ([0.0; 2], |s: usize| {
                let mut x = [0.0; 2];
                x[s] = 1.0;
                x
            });
            let constant = zeta(zero, zero, u);
            for s in 0..2 {
                let by = |z0, z1| zeta(z0, z1, u)[s] - constant[s];
                let entries = [
                    (2 * k, by(unit(0), zero)),
                    (2 * k + 1, by(unit(1), zero)),
                    (2 * k + 2, by(zero, unit(0))),
                    (2 * k + 3, by(zero, unit(1))),
                ];
                add(&entries, -constant[s], q[s]);
            }
        }
    }
    let dense = solved(normal, right);
    // The normal matrix has condition 1e5: its solution has eleven digits.
    for (value, dense) in settled.tracks.0[0].iter().zip(&dense) {
        assert!((value - dense).abs() < 1e-9, "{value} {dense}");
    }
}

/// J by the formulas at the head of the module, of one segment.
fn objective(
    columns: &[Vec<f64>],
    z: &[f64],
    rate: impl Fn([f64; 2]) -> [f64; 2],
    h: f64,
    (r, q): ([f64; 2], [f64; 2]),
) -> f64 {
    let rows = columns[0].len();
    let at = |k: usize| [z[2 * k], z[2 * k + 1]];
    let mut sum = 0.0;
    for k in 0..rows {
        for s in 0..2 {
            if columns[s][k].is_finite() {
                sum += 0.5 * (columns[s][k] - at(k)[s]).powi(2) / r[s];
            }
        }
        if k + 1 < rows {
            let (z0, z1) = (at(k), at(k + 1));
            let (f0, f1) = (rate(z0), rate(z1));
            let fm = rate([0, 1].map(|s| 0.5 * (z0[s] + z1[s]) + h / 8.0 * (f0[s] - f1[s])));
            sum += (0..2)
                .map(|s| 0.5 * (z1[s] - z0[s] - h / 6.0 * (f0[s] + 4.0 * fm[s] + f1[s])).powi(2) / q[s])
                .sum::<f64>();
        }
    }
    sum
}

/// A noisy Van der Pol oscillation by small steps of Euler.
fn van_der_pol(rows: usize, h: f64, start: [f64; 2], deviation: f64, seed: u64) -> Vec<Vec<f64>> {
    let (e, f) = (noise(rows, seed), noise(rows, seed + 100));
    let [mut x, mut v] = start;
    let mut columns = vec![Vec::new(), Vec::new()];
    for k in 0..rows {
        columns[0].push(x + deviation * e[k]);
        columns[1].push(v + deviation * f[k]);
        for _ in 0..400 {
            let by = h / 400.0;
            (x, v) = (x + by * v, v + by * (-x + 0.5 * v - 0.5 * x * x * v));
        }
    }
    columns
}

const FUNCTIONS: [&str; 4] = ["x", "v", "x^2*v", "x^3"];
/// x' = v, v' = -x + v/2 - x^2 v/2.
const TRUE: [f64; 8] = [0.0, 1.0, 0.0, 0.0, -1.0, 0.5, -0.5, 0.0];

#[test]
fn minimum_is_local_and_holds_the_truth() {
    let (rows, h) = (400, 0.05);
    let columns = van_der_pol(rows, h, [2.0, 0.0], 0.1, 5);
    let data = source(&["x", "v"], vec![(h, columns.clone())]);
    let model = model(&[("x", "0"), ("v", "0")], &[], &FUNCTIONS, h);
    let smoother = smoother(&model, all(2, 4), &data);
    let noise = smoother.noise();
    // White noise of deviation 0.1, by some 400 third differences.
    noise.iter().for_each(|deviation| assert!((deviation / 0.01 - 1.0).abs() < 0.3, "{deviation}"));
    let (r, q) = ([0.01; 2], [1e-6; 2]);
    let variances = Variances { measurement: r.to_vec(), process: q.to_vec() };
    let moving = [1, 4, 5, 6];
    let start = TRUE.map(|value| 0.8 * value);
    let settled = smoother.settle((&smoother.recorded(), &start), &moving, (&variances, 1e-13), &Silent).unwrap();
    assert!(settled.converged);
    let rate = |c: &[f64]| {
        let c = c.to_vec();
        move |[x, v]: [f64; 2]| {
            let phi = [x, v, x * x * v, x.powi(3)];
            [0, 1].map(|t| (0..4).map(|j| c[4 * t + j] * phi[j]).sum())
        }
    };
    let value = |z: &[f64], c: &[f64]| objective(&columns, z, rate(c), h, (r, q));
    let (z, c) = (&settled.tracks.0[0], &settled.coefficients);
    let least = value(z, c);
    // The same sum in another order.
    assert!((least / settled.cost - 1.0).abs() < 1e-10, "{least} {}", settled.cost);
    for (at, length) in [(0, 1e-4), (37, 1e-4), (2 * rows - 1, 1e-4)] {
        for sign in [-1.0, 1.0] {
            let mut moved = z.clone();
            moved[at] += sign * length;
            assert!(value(&moved, c) > least, "state {at}");
        }
    }
    for (index, &at) in moving.iter().enumerate() {
        let error = settled.covariance[index][index].sqrt();
        // Four coefficients of one seed: beyond 4 standard errors once in four thousand.
        assert!((c[at] - TRUE[at]).abs() < 4.0 * error, "{at}: {} +- {error}", c[at]);
        assert!(error < 0.02, "{error}");
        for sign in [-1.0, 1.0] {
            let mut moved = c.clone();
            moved[at] += sign * 0.1 * error;
            assert!(value(z, &moved) > least, "coefficient {at}");
        }
    }
    assert!([0, 2, 3, 7].iter().all(|&at| c[at] == 0.0), "what does not move stays");
}

#[test]
fn eliminated_objective_is_the_minimum_over_states() {
    let (rows, h) = (60, 0.05);
    let columns = van_der_pol(rows, h, [1.0, 0.5], 0.05, 11);
    let data = source(&["x", "v"], vec![(h, columns)]);
    let model = model(&[("x", "0"), ("v", "0")], &[], &["x", "v"], h);
    let smoother = smoother(&model, all(2, 2), &data);
    let variances = Variances { measurement: vec![0.0025; 2], process: vec![1e-4; 2] };
    let at = [0.1, 0.9, -0.8, 0.2];
    let states = smoother.settle((&smoother.recorded(), &at), &[], (&variances, 1e-14), &Silent).unwrap();
    let problem = smoother.information((&states.tracks, &at), &[0, 1, 2, 3], &variances, &Silent).unwrap();
    let twice = |c: &[f64]| problem.error(faer::Mat::from_fn(4, 1, |j, _| c[j]).as_ref())[0];
    assert!((twice(&at) / (2.0 * states.cost) - 1.0).abs() < 1e-9);
    // To second order in a small step the least J of other coefficients.
    for j in 0..4 {
        let mut moved = at;
        moved[j] += 1e-3;
        let settled = smoother.settle((&states.tracks, &moved), &[], (&variances, 1e-14), &Silent).unwrap();
        let (expected, change) = (2.0 * settled.cost - 2.0 * states.cost, twice(&moved) - twice(&at));
        assert!((change - expected).abs() < 0.02 * expected.abs() + 1e-6, "{j}: {change} {expected}");
    }
}

#[test]
fn gaps_and_missing_inputs_split_a_recording() {
    let h = 0.05;
    let mut columns = oscillation(60, h, 9);
    columns[2][30] = f64::NAN;
    let data = source(&["x", "v", "u"], vec![(h, columns.clone())]);
    let model = model(&[("x", "0"), ("v", "0.3*u")], &["u"], &["x", "v"], h);
    let parted = smoother(&model, all(2, 2), &data);
    assert_eq!((parted.segments(), parted.rows(), parted.intervals()), (2, 59, 57));
    // The same as two episodes.
    let part = |rows: std::ops::Range<usize>| columns.iter().map(|column| column[rows.clone()].to_vec()).collect();
    let apart = source(&["x", "v", "u"], vec![(h, part(0..30)), (h, part(31..60))]);
    let two = smoother(&model, all(2, 2), &apart);
    let variances = Variances { measurement: vec![0.01; 2], process: vec![1e-5; 2] };
    let settle = |smoother: &StateSmoother| {
        smoother.settle((&smoother.recorded(), &[0.0, 1.0, -1.0, 0.0]), &[1, 2], (&variances, 1e-12), &Silent).unwrap()
    };
    let (a, b) = (settle(&parted), settle(&two));
    a.coefficients.iter().zip(&b.coefficients).for_each(|(a, b)| assert!((a - b).abs() < 1e-9, "{a} {b}"));
    // A step of four periods is a gap, and shorter ones are steps.
    let mut rows = MemorySource::new(["x", "v", "u"].map(DataColumn::float).to_vec());
    let stamps: Vec<i64> = (0..60).map(|k| 50_000_000 * if k < 20 { k } else { k + 3 }).collect();
    rows.push("run", stamps.into(), oscillation(60, h, 9).into_iter().map(Into::into).collect());
    assert_eq!(smoother(&model, all(2, 2), &rows).segments(), 2);
}

#[test]
fn bits_do_not_depend_on_threads() {
    let h = 0.05;
    let episode = |seed: u64| (h, van_der_pol(80, h, [1.0 + 0.3 * seed as f64, 0.0], 0.1, 40 + seed));
    let data = source(&["x", "v"], (0..5).map(episode).collect());
    let model = model(&[("x", "0"), ("v", "0")], &[], &FUNCTIONS, h);
    let variances = Variances { measurement: vec![0.01; 2], process: vec![1e-6; 2] };
    let run = |threads: usize| -> Settled {
        with_threads(threads, || {
            let smoother = smoother(&model, all(2, 4), &data);
            let from = (&smoother.recorded(), &TRUE[..]);
            smoother.settle(from, &[1, 4, 5, 6], (&variances, 1e-9), &Silent).unwrap()
        })
    };
    let one = run(1);
    for threads in [2, 7] {
        let other = run(threads);
        assert_eq!(one.tracks, other.tracks);
        assert_eq!((one.cost.to_bits(), one.coefficients.clone()), (other.cost.to_bits(), other.coefficients));
    }
}

/// A source that must not be read.
struct Unread(Vec<Episode>, Vec<DataColumn>);

impl Source for Unread {
    fn columns(&self) -> &[DataColumn] {
        &self.1
    }

    fn episodes(&self) -> &[Episode] {
        &self.0
    }

    fn read(
        &self,
        _: usize,
        _: std::ops::Range<usize>,
        _: fleetfoot_data::Halo,
    ) -> Result<fleetfoot_data::Block, fleetfoot_data::Error> {
        panic!("it was read")
    }
}

#[test]
fn sizes_are_refused_before_anything_is_read() {
    let h = 0.05;
    let data = source(&["x", "v"], vec![(h, van_der_pol(50, h, [1.0, 0.0], 0.1, 1))]);
    let unread = Unread(data.episodes().to_vec(), data.columns().to_vec());
    let known = model(&[("x", "0"), ("v", "0")], &[], &FUNCTIONS, h);
    let mut options = SmoothingOptions::default();
    options.memory = 50_000.0;
    let refused = StateSmoother::new(&known, all(2, 4), &unread, options, &Silent).err().unwrap();
    assert!(
        matches!(refused, EstimateError::TooManyRowsToSmooth { rows: 50, states: 2, most } if most < 50),
        "{refused}"
    );
    assert!(refused.to_string().contains("--smooth-states off"), "{refused}");
    let many: Vec<Coefficient> = all(2, 4).into_iter().cycle().take(1_001).collect();
    let refused = StateSmoother::new(&known, many, &unread, SmoothingOptions::default(), &Silent).err().unwrap();
    assert!(matches!(refused, EstimateError::TooManyToSmooth { count: 1_001, most: 1_000 }), "{refused}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// From wherever a descent begins, and whatever moves, it ends no higher than it began.
    #[test]
    fn descent_never_raises_the_cost(seed in 0_u64..1_000, factor in 0.2_f64..2.0, share in 1_u32..7) {
        let h = 0.05;
        let data = source(&["x", "v"], vec![(h, van_der_pol(60, h, [1.5, 0.3], 0.3, seed))]);
        let model = model(&[("x", "0"), ("v", "0")], &[], &FUNCTIONS, h);
        let smoother = smoother(&model, all(2, 4), &data);
        let variances = Variances { measurement: vec![0.09; 2], process: vec![0.09 * 10_f64.powi(-(share as i32)); 2] };
        let start = TRUE.map(|value| factor * value);
        let mut options = SmoothingOptions::default();
        options.iterations = 0;
        let still = StateSmoother::new(&model, all(2, 4), &data, options, &Silent).unwrap();
        let from = (&smoother.recorded(), &start[..]);
        let before = still.settle(from, &[1, 4, 5, 6], (&variances, 1e-9), &Silent).unwrap();
        let states = smoother.settle(from, &[], (&variances, 1e-9), &Silent).unwrap();
        let both = smoother.settle((&states.tracks, &start), &[1, 4, 5, 6], (&variances, 1e-9), &Silent).unwrap();
        prop_assert_eq!(before.steps, 0);
        prop_assert!(states.cost <= before.cost && both.cost <= states.cost, "{} {} {}", before.cost, states.cost, both.cost);
    }
}
