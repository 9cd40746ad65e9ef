//! Trend filtering, against its certificate, closed forms and a general solver of quadratic programs.

use clarabel::{
    algebra::CscMatrix,
    solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT},
};
use fleetfoot_signal::{Lambda, SignalError, Trend, trend_filter};
use proptest::prelude::*;

use crate::common::{distance, normal, uniform};

/// Irregular stamps about 0.1 s apart, pieces of lines with noise of 0.05, weights.
fn record(rows: u64, seed: u64) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let times: Vec<f64> = (0..rows).map(|row| 0.1 * (row as f64 + 0.8 * uniform(seed, row))).collect();
    let value = |(row, t): (u64, &f64)| (0.7 * t).sin() + 0.5 * (t - 2.0).abs() + 0.05 * normal(seed + 1, row);
    let values = (0..rows).zip(&times).map(value).collect();
    let weights = (0..rows).map(|row| 0.5 + uniform(seed + 2, row)).collect();
    (times, values, weights)
}

/// D, dense, row by row: the recursion of the definition.
fn differences(times: &[f64], degree: usize) -> Vec<Vec<f64>> {
    let n = times.len();
    let step = |rows: &[Vec<f64>]| -> Vec<Vec<f64>> {
        rows.windows(2).map(|pair| pair[1].iter().zip(&pair[0]).map(|(a, b)| a - b).collect()).collect()
    };
    let mut rows: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| f64::from(i == j)).collect()).collect();
    for j in 1..=degree {
        rows = step(&rows);
        for (i, row) in rows.iter_mut().enumerate() {
            let scale = j as f64 / (times[i + j] - times[i]);
            row.iter_mut().for_each(|entry| *entry *= scale);
        }
    }
    step(&rows)
}

struct Problem<'a> {
    values: &'a [f64],
    weights: &'a [f64],
    lambda: f64,
    d: Vec<Vec<f64>>,
}

impl Problem<'_> {
    fn objective(&self, x: &[f64]) -> f64 {
        let squares: f64 = x.iter().zip(self.values).zip(self.weights).map(|((x, y), w)| w * (y - x) * (y - x)).sum();
        let variation: f64 = self.d.iter().map(|row| row.iter().zip(x).map(|(d, x)| d * x).sum::<f64>().abs()).sum();
        0.5 * squares + self.lambda * variation
    }

    /// The program in x and bounds a: least 1/2 x'Wx - y'Wx + lambda 1'a, -a <= D x <= a.
    fn solved(&self) -> Vec<f64> {
        let (n, m) = (self.values.len(), self.d.len());
        let size = n + m;
        let diagonal: Vec<f64> = (0..size).map(|i| if i < n { self.weights[i] } else { 0.0 }).collect();
        let quadratic = CscMatrix::new(size, size, (0..=size).collect(), (0..size).collect(), diagonal);
        let linear: Vec<f64> =
            (0..size).map(|i| if i < n { -self.weights[i] * self.values[i] } else { self.lambda }).collect();
        let (mut starts, mut indices, mut entries) = (vec![0], Vec::new(), Vec::new());
        for c in 0..size {
            let column: Vec<(usize, f64)> = if c < n {
                let entries = (0..m).filter(|&j| self.d[j][c] != 0.0).map(|j| (j, self.d[j][c]));
                entries.clone().chain(entries.map(|(j, value)| (m + j, -value))).collect()
            } else {
                vec![(c - n, -1.0), (m + c - n, -1.0)]
            };
            for (row, value) in column {
                indices.push(row);
                entries.push(value);
            }
            starts.push(indices.len());
        }
        let constraints = CscMatrix::new(2 * m, size, starts, indices, entries);
        let settings = DefaultSettings {
            verbose: false,
            tol_gap_abs: 1e-12,
            tol_gap_rel: 1e-12,
            tol_feas: 1e-11,
            max_iter: 500,
            ..DefaultSettings::default()
        };
        let (cones, zeros) = ([SupportedConeT::NonnegativeConeT(2 * m)], vec![0.0; 2 * m]);
        let mut solver = DefaultSolver::new(&quadratic, &linear, &constraints, &zeros, &cones, settings).unwrap();
        solver.solve();
        let status = solver.solution.status;
        assert!(matches!(status, SolverStatus::Solved | SolverStatus::AlmostSolved), "{status:?}");
        solver.solution.x[..n].to_vec()
    }
}

/// Values are those of a general solver, and the objective is not above its own.
#[test]
fn trends_match_a_quadratic_program() {
    for degree in 1..=3 {
        for lambda in [1e-3, 0.05, 2.0] {
            let (times, values, weights) = record(120, 7 * degree as u64);
            let trend = trend_filter(&times, &values, Some(&weights), degree, Lambda::Given(lambda)).unwrap();
            let problem = Problem { values: &values, weights: &weights, lambda, d: differences(&times, degree) };
            let expected = problem.solved();
            let (objective, other) = (problem.objective(&trend.derivatives[0]), problem.objective(&expected));
            assert!(trend.converged && trend.gap <= 1e-6 * trend.objective, "{degree} {lambda}: gap {:e}", trend.gap);
            assert!(
                (trend.objective / objective - 1.0).abs() < 1e-9,
                "{degree} {lambda}: {} {objective}",
                trend.objective
            );
            assert!(objective < other * (1.0 + 1e-8), "{degree} {lambda}: {objective} {other}");
            // The objective curves with weights of a half at least: an error of 1e-9 of it is one of 1e-4 of the values' noise.
            let apart = distance(&trend.derivatives[0], &expected);
            assert!(apart < 1e-5, "{degree} {lambda}: {apart:e}");
        }
    }
}

/// Above the greatest useful penalty the trend is the polynomial of least squares; the degrees of freedom say so.
#[test]
fn a_strong_penalty_leaves_the_polynomial_of_least_squares() {
    for degree in 1..=3_usize {
        let (times, values, weights) = record(200, 3);
        let trend = trend_filter(&times, &values, Some(&weights), degree, Lambda::Given(1e9)).unwrap();
        assert_eq!((trend.freedom, trend.borders.len()), (degree + 1, 0));
        // Normal equations in powers of time about the middle.
        let t = |row: usize| (times[row] - 10.0) / 10.0;
        let size = degree + 1;
        let moment = |p: usize, y: bool| {
            (0..200).map(|row| weights[row] * t(row).powi(p as i32) * if y { values[row] } else { 1.0 }).sum::<f64>()
        };
        let matrix: Vec<Vec<f64>> = (0..size).map(|i| (0..size).map(|j| moment(i + j, false)).collect()).collect();
        let right: Vec<Vec<f64>> = (0..size).map(|i| vec![moment(i, true)]).collect();
        let c = crate::dense::solve(matrix, right);
        let expected: Vec<f64> = (0..200).map(|row| (0..size).map(|p| c[p][0] * t(row).powi(p as i32)).sum()).collect();
        let apart = distance(&trend.derivatives[0], &expected);
        assert!(apart < 1e-9, "{degree}: {apart:e}");
        let slope: Vec<f64> = (0..200)
            .map(|row| (1..size).map(|p| p as f64 * c[p][0] * t(row).powi(p as i32 - 1) / 10.0).sum())
            .collect();
        assert!(distance(&trend.derivatives[1], &slope) < 1e-7, "{degree}");
    }
}

/// Pieces of straight lines under noise: their corners are found, and slopes between them.
#[test]
fn trend_has_true_corners() {
    let times: Vec<f64> = (0..3000).map(|row| 0.01 * f64::from(row)).collect();
    let exact = |t: f64| {
        if t < 10.0 {
            2.0 * t
        } else if t < 18.0 {
            20.0
        } else {
            20.0 - 3.0 * (t - 18.0)
        }
    };
    let values: Vec<f64> = times.iter().zip(0..).map(|(&t, row)| exact(t) + 0.02 * normal(5, row)).collect();
    let trend = trend_filter(&times, &values, None, 1, Lambda::Likelihood).unwrap();
    assert!(
        trend.converged && !trend.at_end,
        "{} {:e} of {:e}, {}",
        trend.lambda,
        trend.gap,
        trend.objective,
        trend.at_end
    );
    // Three pieces are four numbers; an l1 penalty shrinks the corners that it finds, and false ones make up for it.
    assert!(trend.freedom <= 20, "{} numbers", trend.freedom);
    assert!((trend.noise / 0.02 - 1.0).abs() < 0.05, "{}", trend.noise);
    for corner in [10.0, 18.0] {
        assert!(trend.borders.iter().any(|&row| (times[row] - corner).abs() < 0.1), "{corner}");
    }
    for (t, slope) in [(5.0, 2.0), (14.0, 0.0), (25.0, -3.0)] {
        let row = (100.0 * t) as usize;
        assert!((trend.derivatives[1][row] - slope).abs() < 0.02, "{t}: {}", trend.derivatives[1][row]);
    }
}

/// Long pieces keep their digits: ten pieces of a cubic over 200,000 rows, whose fourth differences are of the order of rounding.
#[test]
fn long_pieces_converge() {
    let rows = 200_000;
    let times: Vec<f64> = (0..rows).map(|row| 1e-3 * f64::from(row)).collect();
    let values: Vec<f64> = times.iter().zip(0..).map(|(t, row)| (0.1 * t).sin() + 0.01 * normal(9, row)).collect();
    for (degree, lambda) in [(1, 3.0), (2, 10.0), (3, 30.0)] {
        let trend = trend_filter(&times, &values, None, degree, Lambda::Given(lambda)).unwrap();
        assert!(trend.converged, "{degree}: gap {:e} of {:e} after {}", trend.gap, trend.objective, trend.iterations);
        assert!((trend.noise / 0.01 - 1.0).abs() < 0.02, "{degree}: {}", trend.noise);
        let error: f64 =
            trend.derivatives[1].iter().zip(&times).map(|(x, t)| (x - 0.1 * (0.1 * t).cos()).powi(2)).sum();
        let rms = (error / f64::from(rows)).sqrt();
        assert!(rms < 0.01, "{degree}: {rms}");
    }
}

/// A channel that is a polynomial, or at rest, is its own trend.
#[test]
fn trend_of_noiseless_channel_is_itself() {
    let times: Vec<f64> = (0..500).map(|row| 0.01 * f64::from(row)).collect();
    for lambda in [Lambda::Given(1.0), Lambda::Likelihood, Lambda::Gcv] {
        for values in [vec![3.0; 500], times.clone(), times.iter().map(|t| 1e3 + t * t).collect()] {
            let trend = trend_filter(&times, &values, None, 2, lambda).unwrap();
            assert!(distance(&trend.derivatives[0], &values) < 1e-10, "{lambda:?}");
        }
    }
}

/// Rows without a measurement lie on the pieces of the others.
#[test]
fn missing_rows_are_filled() {
    let (times, mut values, _) = record(200, 4);
    let kept: Vec<usize> = (0..200).filter(|row| row % 5 != 2).collect();
    let pick = |of: &[f64]| kept.iter().map(|&row| of[row]).collect::<Vec<f64>>();
    for degree in 1..=3 {
        let alone = trend_filter(&pick(&times), &pick(&values), None, degree, Lambda::Given(0.1)).unwrap();
        (0..200).filter(|row| row % 5 == 2).for_each(|row| values[row] = f64::NAN);
        let trend = trend_filter(&times, &values, None, degree, Lambda::Given(0.1)).unwrap();
        assert_eq!(pick(&trend.derivatives[0]), alone.derivatives[0]);
        assert_eq!(trend.measured, kept.len());
        assert!(trend.derivatives.iter().flatten().all(|value| value.is_finite()));
        let row = 102;
        let (low, high) = (trend.derivatives[0][row - 1], trend.derivatives[0][row + 1]);
        assert!((trend.derivatives[0][row] - 0.5 * (low + high)).abs() < 0.05);
    }
}

#[test]
fn bad_input_is_refused() {
    let (times, values, weights) = record(20, 1);
    let try_it =
        |degree, lambda| trend_filter(&times, &values, Some(&weights), degree, Lambda::Given(lambda)).unwrap_err();
    assert!(matches!(try_it(0, 1.0), SignalError::Parameter { what: "degree", .. }));
    assert!(matches!(try_it(4, 1.0), SignalError::Parameter { what: "degree", .. }));
    assert!(matches!(try_it(2, 0.0), SignalError::Parameter { what: "lambda", .. }));
    let few = trend_filter(&times[..4], &values[..4], None, 3, Lambda::Given(1.0)).unwrap_err();
    assert_eq!(few, SignalError::TooFew { count: 4, needed: 5 });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Units of time and value, and their origins, are nobody's business; backwards it is the same trend.
    #[test]
    fn units_and_direction_do_not_matter(seed in 0u64..1000, rows in 8u64..120, unit in -3.0..3.0_f64, degree in 1usize..=3) {
        let (times, values, weights) = record(rows, seed);
        let unit = 10.0_f64.powf(unit);
        let forward = trend_filter(&times, &values, Some(&weights), degree, Lambda::Given(0.1)).unwrap();
        let end = times[times.len() - 1];
        let mirrored: Vec<f64> = times.iter().rev().map(|t| unit * (end - t)).collect();
        let backwards: Vec<f64> = values.iter().rev().map(|y| 4.0 * y + 1.0).collect();
        let back_weights: Vec<f64> = weights.iter().rev().copied().collect();
        let lambda = Lambda::Given(0.1 * 4.0 * unit.powi(degree as i32));
        let other: Trend = trend_filter(&mirrored, &backwards, Some(&back_weights), degree, lambda).unwrap();
        let restored: Vec<f64> = other.derivatives[0].iter().rev().map(|x| (x - 1.0) / 4.0).collect();
        prop_assert!(forward.converged && other.converged);
        // Both are within their gaps of the one least value: 1e-10 of the objective, 1e-5 of the noise.
        prop_assert!(distance(&restored, &forward.derivatives[0]) < 1e-5);
    }

    /// The certificate: no curve near by has a lesser objective, by more than the gap.
    #[test]
    fn nothing_near_is_less(seed in 0u64..1000, degree in 1usize..=3, lambda in -3.0..1.0_f64) {
        let (times, values, weights) = record(60, seed);
        let lambda = 10.0_f64.powf(lambda);
        let trend = trend_filter(&times, &values, Some(&weights), degree, Lambda::Given(lambda)).unwrap();
        let problem = Problem { values: &values, weights: &weights, lambda, d: differences(&times, degree) };
        let objective = problem.objective(&trend.derivatives[0]);
        for trial in 0..20 {
            let size = 10.0_f64.powi(-(trial % 5) - 1);
            let moved: Vec<f64> = (0..60).zip(&trend.derivatives[0]).map(|(row, x)| x + size * normal(seed + 50 + trial as u64, row)).collect();
            prop_assert!(problem.objective(&moved) >= objective - trend.gap - 1e-12 * objective);
        }
    }
}
