//! Smoothing splines.

use fleetfoot_signal::{Lambda, SignalError, Smoothed, Spline, better, reject, smooth};
use proptest::prelude::*;

use crate::{
    common::{distance, normal, uniform},
    dense::Dense,
};

/// Irregular stamps about `dt` apart, values with noise, weights.
fn record(rows: usize, dt: f64, seed: u64) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let stamp = |row: u64| dt * (row as f64 + 0.9 * uniform(seed, row));
    let times: Vec<f64> = (0..rows as u64).map(stamp).collect();
    let value =
        |(row, &t): (usize, &f64)| 2.0 + (3.0 * t / (dt * rows as f64)).sin() + 0.1 * normal(seed + 1, row as u64);
    let values = times.iter().enumerate().map(value).collect();
    let weights = (0..rows as u64).map(|row| 0.5 + uniform(seed + 2, row)).collect();
    (times, values, weights)
}

const BOTH: [(Spline, usize); 2] = [(Spline::Cubic, 2), (Spline::Quintic, 3)];

fn check_against_dense(rows: usize, spline: Spline, m: usize, bandwidth: f64, missing: impl Fn(usize) -> bool) {
    let dt = 0.02;
    let (times, mut values, weights) = record(rows, dt, rows as u64);
    let kept: Vec<usize> = (0..rows).filter(|&row| !missing(row)).collect();
    let lambda = (bandwidth * dt).powi(2 * m as i32) / dt;
    // The kernel of the dense solution begins at 0; in units of dt its matrices are as well conditioned as they get.
    let at: Vec<f64> = times.iter().map(|t| t / dt).collect();
    let pick = |of: &[f64]| kept.iter().map(|&row| of[row]).collect::<Vec<f64>>();
    let (kept_times, kept_values, kept_weights) = (pick(&at), pick(&values), pick(&weights));
    let scaled = lambda / dt.powi(2 * m as i32 - 1);
    let dense = Dense { m, times: &kept_times, values: &kept_values, weights: &kept_weights, lambda: scaled };
    (0..rows).filter(|&row| missing(row)).for_each(|row| values[row] = f64::NAN);
    let smoothed = smooth(&times, &values, Some(&weights), spline, Lambda::Given(lambda)).unwrap();
    let (squares, freedom) = dense.residuals();
    let noise = (squares / (kept.len() as f64 - freedom)).sqrt();
    assert!((smoothed.noise / noise - 1.0).abs() < 1e-8, "{} {noise}", smoothed.noise);
    assert!((smoothed.freedom / freedom - 1.0).abs() < 1e-8, "{} {freedom}", smoothed.freedom);
    for k in 0..m {
        let unit = dt.powi(k as i32);
        let expected = dense.posterior(&at, k);
        let mean: Vec<f64> = expected.iter().map(|(mean, _)| mean / unit).collect();
        let deviation: Vec<f64> = expected.iter().map(|(_, variance)| noise * variance.sqrt() / unit).collect();
        let (of_mean, of_deviation) =
            (distance(&smoothed.derivatives[k], &mean), distance(&smoothed.deviations[k], &deviation));
        assert!(
            of_mean < 1e-8 && of_deviation < 1e-8,
            "{spline:?} {bandwidth} derivative {k}: {of_mean:e} {of_deviation:e}"
        );
    }
}

/// Values, derivatives and deviations are those of the dense solution. 1e-8 is its own error: its matrices have condition numbers up to 1e8.
#[test]
fn splines_match_dense_solution() {
    for (spline, m) in BOTH {
        for bandwidth in [1.0, 3.0, 8.0] {
            check_against_dense(40, spline, m, bandwidth, |_| false);
        }
        // Nearly an interpolation: over fewer rows, where the dense solution keeps its digits.
        check_against_dense(12, spline, m, 0.4, |_| false);
    }
}

/// Rows without a measurement, at the start, in the middle and at the end, are interpolated and extrapolated, their deviations too.
#[test]
fn missing_rows_are_filled_as_the_dense_solution_fills_them() {
    for (spline, m) in BOTH {
        check_against_dense(40, spline, m, 2.0, |row| row < 3 || row == 4 || (15..20).contains(&row) || row > 36);
    }
}

/// A polynomial of a degree below the order of the penalty costs nothing: it is its own spline, whatever the penalty, over any number of rows.
#[test]
fn polynomials_pass_unchanged() {
    let times: Vec<f64> = (0..100_000).map(|row| 1e-3 * (f64::from(row) + 0.4 * uniform(3, row as u64))).collect();
    let (value, slope) = (|t: &f64| 3.0 - 2.0 * t + 0.25 * t * t, |t: &f64| -2.0 + 0.5 * t);
    let values: Vec<f64> = times.iter().map(value).collect();
    for lambda in [1e-20, 1e-10, 1.0, 1e6] {
        let smoothed = smooth(&times, &values, None, Spline::Quintic, Lambda::Given(lambda)).unwrap();
        let slopes: Vec<f64> = times.iter().map(slope).collect();
        assert!(distance(&smoothed.derivatives[0], &values) < 1e-12, "{lambda}");
        // Values of 2,300, rounded to 4e-13 and 6e-4 s apart, tell a slope of 48 to 1e-9 of it where nothing smooths them, and better where something does.
        let tolerance = if lambda < 1e-15 { 1e-9 } else { 1e-11 };
        let apart = distance(&smoothed.derivatives[1], &slopes);
        assert!(apart < tolerance, "{lambda}: {apart:e}");
    }
}

fn reversed(of: &[f64], sign: f64) -> Vec<f64> {
    of.iter().rev().map(|x| sign * x).collect()
}

fn assert_mirrored(forward: &Smoothed, mirrored: &Smoothed, tolerance: f64) {
    for k in 0..forward.derivatives.len() {
        let sign = if k % 2 == 1 { -1.0 } else { 1.0 };
        let value = distance(&reversed(&mirrored.derivatives[k], sign), &forward.derivatives[k]);
        let deviation = distance(&reversed(&mirrored.deviations[k], 1.0), &forward.deviations[k]);
        assert!(value < tolerance && deviation < tolerance, "derivative {k}: {value:e} {deviation:e}");
    }
}

/// Filter and smoother run one way; the spline knows no direction. What differs is what a long record and a strong penalty lose in rounding.
#[test]
fn a_long_record_backwards_is_the_same_spline() {
    let (times, values, weights) = record(100_000, 1e-3, 11);
    let backwards: Vec<f64> = times.iter().rev().map(|t| 200.0 - t).collect();
    for (spline, m) in BOTH {
        for bandwidth in [0.5, 30.0, 3000.0] {
            let lambda = Lambda::Given((bandwidth * 1e-3_f64).powi(2 * m as i32) / 1e-3);
            let forward = smooth(&times, &values, Some(&weights), spline, lambda).unwrap();
            let mirrored =
                smooth(&backwards, &reversed(&values, 1.0), Some(&reversed(&weights, 1.0)), spline, lambda).unwrap();
            assert_mirrored(&forward, &mirrored, 1e-8);
        }
    }
}

/// The chosen penalty is at the least of the score computed by dense algebra.
#[test]
fn chosen_penalties_are_the_least_of_their_scores() {
    let (times, values, weights) = record(60, 1.0, 5);
    for (spline, m) in BOTH {
        let dense = |lambda| Dense { m, times: &times, values: &values, weights: &weights, lambda };
        let gcv = |lambda: f64| {
            let (squares, freedom) = dense(lambda).residuals();
            squares / (60.0 - freedom).powi(2)
        };
        let deviance = |lambda: f64| dense(lambda).deviance();
        let check = |choice: Lambda, score: &dyn Fn(f64) -> f64| {
            let chosen = smooth(&times, &values, Some(&weights), spline, choice).unwrap();
            assert!(!chosen.at_end);
            let least = score(chosen.lambda);
            // The search ends at 1e-4 of the logarithm of the bandwidth: 6e-4 of lambda at most.
            for factor in [0.2, 0.99, 1.01, 5.0] {
                assert!(score(chosen.lambda * factor) > least, "{spline:?} {choice:?} {factor}");
            }
        };
        check(Lambda::Gcv, &gcv);
        check(Lambda::Likelihood, &deviance);
    }
}

/// On a process that is what the prior says, likelihood finds noise and penalty, and errors are as large as the deviations say.
#[test]
fn deviations_match_errors() {
    let (rows, dt, noise, density) = (20_000_usize, 0.01_f64, 0.05, 4.0_f64);
    let (mut f, mut slope) = (0.0, 0.0);
    let (mut truth, mut slopes) = (Vec::new(), Vec::new());
    for row in 0..rows as u64 {
        truth.push(f);
        slopes.push(slope);
        // The exact increments of the chain over dt.
        let (a, b) = (normal(1, row), normal(2, row));
        f += slope * dt + density.sqrt() * dt.powf(1.5) * a / 3.0_f64.sqrt();
        slope += density.sqrt() * dt.sqrt() * (3.0_f64.sqrt() * a / 2.0 + b / 2.0);
    }
    let times: Vec<f64> = (0..rows).map(|row| dt * row as f64).collect();
    let values: Vec<f64> = truth.iter().zip(0..).map(|(f, row)| f + noise * normal(3, row)).collect();
    let smoothed = smooth(&times, &values, None, Spline::Cubic, Lambda::Likelihood).unwrap();
    assert!((smoothed.noise / noise - 1.0).abs() < 0.02, "{}", smoothed.noise);
    let ratio = smoothed.lambda * density / (noise * noise);
    // Twenty thousand rows of a bandwidth of five rows tell lambda to some percent.
    assert!((ratio - 1.0).abs() < 0.2, "{ratio}");
    for (k, exact) in [truth, slopes].iter().enumerate() {
        let error = |row: usize| (smoothed.derivatives[k][row] - exact[row]) / smoothed.deviations[k][row];
        let mean = (0..rows).map(|row| error(row).powi(2)).sum::<f64>() / rows as f64;
        // Errors are correlated over some ten rows: 2,000 independent squares, three deviations of their mean.
        assert!((mean - 1.0).abs() < 0.1, "derivative {k}: {mean}");
    }
}

/// A channel without noise has no least score: the end is told.
#[test]
fn a_straight_line_stops_at_an_end() {
    let times: Vec<f64> = (0..100).map(f64::from).collect();
    let smoothed = smooth(&times, &times, None, Spline::Cubic, Lambda::Gcv).unwrap();
    assert!(smoothed.derivatives[1].iter().all(|slope| (slope - 1.0).abs() < 1e-10));
    assert!(smoothed.noise < 1e-10, "{}", smoothed.noise);
}

#[test]
fn bad_input_is_refused_with_its_row() {
    let try_it = |times: &[f64], values: &[f64], weights: Option<&[f64]>, lambda| {
        smooth(times, values, weights, Spline::Cubic, Lambda::Given(lambda)).unwrap_err()
    };
    let times = [0.0, 1.0, 1.0, 2.0];
    assert_eq!(try_it(&times, &[0.0; 4], None, 1.0), SignalError::Stamp { row: 2, time: 1.0, before: 1.0 });
    let times = [0.0, 1.0, 2.0, 3.0];
    assert_eq!(try_it(&times, &[0.0, f64::NAN, f64::NAN, 1.0], None, 1.0), SignalError::TooFew { count: 2, needed: 3 });
    assert_eq!(
        try_it(&times, &[0.0; 4], Some(&[1.0, -1.0, 1.0, 1.0]), 1.0),
        SignalError::Weight { row: 1, weight: -1.0 }
    );
    assert!(matches!(try_it(&times, &[0.0; 3], None, 1.0), SignalError::Length { count: 3, expected: 4, .. }));
    assert!(matches!(try_it(&times, &[0.0; 4], None, 0.0), SignalError::Parameter { .. }));
    assert!(matches!(
        try_it(&times, &[0.0, f64::INFINITY, 0.0, 0.0], None, 1.0),
        SignalError::NotFinite { row: 1, .. }
    ));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// Units of time and value, and the origin of both, are nobody's business.
    #[test]
    fn units_do_not_matter(seed in 0u64..1000, unit in -6.0..6.0_f64, size in -6.0..6.0_f64, rows in 6usize..200) {
        let (times, values, weights) = record(rows, 1.0, seed);
        let (unit, size) = (10.0_f64.powf(unit), 10.0_f64.powf(size));
        let lambda = 50.0;
        let original = smooth(&times, &values, Some(&weights), Spline::Cubic, Lambda::Given(lambda)).unwrap();
        let scaled_times: Vec<f64> = times.iter().map(|t| unit * t).collect();
        let scaled: Vec<f64> = values.iter().map(|y| size * (y - 1.0)).collect();
        let lambda = Lambda::Given(lambda * unit.powi(3));
        let other = smooth(&scaled_times, &scaled, Some(&weights), Spline::Cubic, lambda).unwrap();
        let back: Vec<f64> = other.derivatives[0].iter().map(|f| f / size + 1.0).collect();
        let slopes: Vec<f64> = other.derivatives[1].iter().map(|f| f * unit / size).collect();
        prop_assert!(distance(&back, &original.derivatives[0]) < 1e-10);
        prop_assert!(distance(&slopes, &original.derivatives[1]) < 1e-9);
        prop_assert!((other.noise / size / original.noise - 1.0).abs() < 1e-9);
    }
}

/// An oscillation of ten rows or so a half-period is no integrated random walk, and to the likelihood alone all of it is noise about a straight line. Its neighbours tell that it is not: the curve follows,
/// and the noise is that of the sensor.
#[test]
fn an_oscillation_is_not_taken_for_noise() {
    for spline in [Spline::Cubic, Spline::Quintic] {
        for seed in 0..3 {
            let (rows, noise) = (4000_u64, 0.25);
            let motion = |t: f64| (31.0 * t).sin() + 0.3 * (62.0 * t + 1.0).cos();
            let times: Vec<f64> = (0..rows).map(|row| 0.01 * row as f64).collect();
            let mut values: Vec<f64> =
                times.iter().zip(0..).map(|(&t, row)| motion(t) + noise * normal(seed, row)).collect();
            for wrong in [0, 777, 2500] {
                let smoothed = smooth(&times, &values, None, spline, Lambda::Likelihood).unwrap();
                let error = times.iter().zip(&smoothed.derivatives[0]).map(|(&t, value)| (value - motion(t)).powi(2));
                let error = (error.sum::<f64>() / rows as f64).sqrt();
                if wrong == 0 {
                    assert!(
                        error < 0.8 * noise && (smoothed.noise / noise - 1.0).abs() < 0.35,
                        "{error} {smoothed:?}",
                        smoothed = smoothed.noise
                    );
                }
                // Gross errors are found under the bound, at an end of the record as well.
                values[wrong] += 1000.0;
            }
            let rejected = reject(&times, &values, None, spline, Lambda::Likelihood, 4.0).unwrap();
            assert!(
                [0, 777, 2500].iter().all(|row| rejected.rows.contains(row)) && rejected.rows.len() < 8,
                "{:?}",
                rejected.rows
            );
        }
    }
}

/// Choice between a cubic and a quintic channel: noisy draws of either prior get that spline, and a smooth motion gets
/// the quintic one.
#[test]
fn likelihood_prefers_the_true_spline() {
    let (rows, period) = (2000, 0.01);
    let times: Vec<f64> = (0..rows).map(|row| period * f64::from(row)).collect();
    let choose = |values: &[f64], by: Lambda| {
        let lambda = |spline| smooth(&times, values, None, spline, by).unwrap().lambda;
        better(&times, values, [lambda(Spline::Cubic), lambda(Spline::Quintic)], by).unwrap()
    };
    for seed in 0..10 {
        // Chains of integrators: the last number moves by white noise.
        let walk = |order: usize, force: f64| -> Vec<f64> {
            let mut state = [0.0; 3];
            (0..rows as u64)
                .map(|row| {
                    for k in 0..order - 1 {
                        state[k] += period * state[k + 1];
                    }
                    state[order - 1] += force * period.sqrt() * normal(60 + seed, row);
                    state[0] + 0.01 * normal(90 + seed, row)
                })
                .collect()
        };
        assert_eq!(choose(&walk(2, 1.0), Lambda::Likelihood), Spline::Cubic, "{seed}");
        assert_eq!(choose(&walk(3, 10.0), Lambda::Likelihood), Spline::Quintic, "{seed}");
        let smooth: Vec<f64> =
            times.iter().zip(0..).map(|(t, row)| (2.0 * t).sin() + 0.01 * normal(120 + seed, row)).collect();
        for by in [Lambda::Likelihood, Lambda::Gcv] {
            assert_eq!(choose(&smooth, by), Spline::Quintic, "{seed}");
        }
    }
    let short = [0.0, 1.0, 0.5];
    assert!(matches!(
        better(&[0.0, 1.0, 2.0], &short, [1.0, 1.0], Lambda::Likelihood),
        Err(SignalError::TooFew { count: 3, needed: 4 })
    ));
}

/// The density that compares the splines, against that of a dense normal distribution: covariances of the process from a start of great variance, conditioned on the first three measurements.
#[test]
fn the_better_spline_has_the_greater_dense_density() {
    let times: Vec<f64> = (0..14).map(|row| 0.1 * (f64::from(row) + 0.4 * uniform(7, row as u64))).collect();
    for seed in 0..20 {
        let mut values: Vec<f64> =
            times.iter().zip(0..).map(|(t, row)| (4.0 * t).sin() + 0.1 * normal(200 + seed, row)).collect();
        values[1] = f64::NAN;
        let lambdas =
            [0.5e-3 * 10.0_f64.powf(2.0 * uniform(300, seed)), 0.5e-4 * 10.0_f64.powf(3.0 * uniform(301, seed))];
        let densities = [surprise(&times, &values, 2, lambdas[0]), surprise(&times, &values, 3, lambdas[1])];
        // If they differ by little, a start of great variance is no vague one.
        if (densities[0] - densities[1]).abs() < 1e-2 {
            continue;
        }
        let expected = if densities[1] < densities[0] { Spline::Quintic } else { Spline::Cubic };
        assert_eq!(better(&times, &values, lambdas, Lambda::Likelihood).unwrap(), expected, "{seed}: {densities:?}");
    }
}

/// Minus twice the logarithm of the density of the measurements behind the first three, given these, the variance profiled out, up to a constant: by conditional covariances of all measured rows.
fn surprise(times: &[f64], values: &[f64], order: i32, lambda: f64) -> f64 {
    let rows: Vec<usize> = (0..times.len()).filter(|&row| !values[row].is_nan()).collect();
    let factorial = |n: i32| (1..=n).map(f64::from).product::<f64>();
    // The integral of (s - u)^(m-1) (t - u)^(m-1) / (m-1)!^2 over u from 0 to the earlier, by Boole's rule, which is exact to degree five.
    let covariance = |s: f64, t: f64| {
        let f = |u: f64| (s - u).powi(order - 1) * (t - u).powi(order - 1) / factorial(order - 1).powi(2);
        let end = s.min(t);
        let at = |quarter: f64| f(0.25 * quarter * end);
        let integral = end / 90.0 * (7.0 * at(0.0) + 32.0 * at(1.0) + 12.0 * at(2.0) + 32.0 * at(3.0) + 7.0 * at(4.0));
        let start: f64 = (0..order).map(|k| 1e6 * (s * t).powi(k)).sum();
        integral + start * lambda
    };
    let n = rows.len();
    // Variances in units of that of an error: the process has one over lambda.
    let mut k = vec![vec![0.0; n]; n];
    for (a, &i) in rows.iter().enumerate() {
        for (b, &j) in rows.iter().enumerate() {
            k[a][b] = covariance(times[i], times[j]) / lambda + if a == b { 1.0 } else { 0.0 };
        }
    }
    // Cholesky's factor row by row: its diagonal and the solution are the innovations in order.
    let (mut squares, mut logarithms) = (0.0, 0.0);
    let mut l = vec![vec![0.0; n]; n];
    let mut white = vec![0.0; n];
    for a in 0..n {
        for b in 0..=a {
            let sum: f64 = (0..b).map(|c| l[a][c] * l[b][c]).sum();
            l[a][b] = if a == b { (k[a][a] - sum).sqrt() } else { (k[a][b] - sum) / l[b][b] };
        }
        let sum: f64 = (0..a).map(|c| l[a][c] * white[c]).sum();
        white[a] = (values[rows[a]] - sum) / l[a][a];
        if a >= 3 {
            squares += white[a] * white[a];
            logarithms += 2.0 * l[a][a].ln();
        }
    }
    (n - 3) as f64 * f64::ln(squares) + logarithms
}
