//! Symmetric matrices of parameters between bounds: the nearest matrix by its eigenvalues, the conditions of the minimum, other parametrisations.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, Side};
use fleetfoot_data::{Column, MemorySource, Silent, mix, with_threads};
use fleetfoot_estimate::{
    Affine, Bounded, Estimate, EstimateError, MatrixLimit, Options, Parameter, Residual, nonlinear_least_squares,
};
use fleetfoot_library::{Expr, Scope};
use proptest::prelude::*;

/// Numbers between bounds that follow from a seed.
struct Numbers(u64);

impl Numbers {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        low + (high - low) * (mix(self.0) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn place(i: usize, j: usize) -> usize {
    let (i, j) = (i.max(j), i.min(j));
    i * (i + 1) / 2 + j
}

/// Names of the lower triangle by rows, `M11, M21, M22`.
fn names(n: usize) -> Vec<String> {
    (0..n).flat_map(|i| (0..=i).map(move |j| format!("M{}{}", i + 1, j + 1))).collect()
}

fn parameters(n: usize, start: f64) -> Vec<Parameter> {
    let diagonal = (0..n).flat_map(|i| (0..=i).map(move |j| i == j));
    names(n).into_iter().zip(diagonal).map(|(name, on)| Parameter::new(name, if on { start } else { 0.0 })).collect()
}

fn limit(n: usize, at_least: bool, bound: f64) -> MatrixLimit {
    let entries = (0..n * (n + 1) / 2).map(Affine::parameter).collect();
    MatrixLimit { name: "M".into(), entries, at_least, bound }
}

/// Rows of functions `d_k` and `y`, and the model `y = sum_k w_k M_k d_k`.
fn rows(columns: &[Vec<f64>], n: usize, weight: impl Fn(usize, usize) -> f64) -> (MemorySource, Vec<Residual>) {
    let names = names(n);
    let all: Vec<String> = (0..names.len()).map(|k| format!("d{k}")).chain(["y".to_owned()]).collect();
    let mut source = MemorySource::new(all.iter().map(|name| Column::float(name.as_str())).collect());
    source.push_uniform("rows", 1.0, columns.to_vec());
    let term = |(i, j): (usize, usize)| format!("{:?}*{}*d{}", weight(i, j), names[place(i, j)], place(i, j));
    let text: Vec<String> = (0..n).flat_map(|i| (0..=i).map(move |j| (i, j))).map(term).collect();
    let scope = Scope::open();
    let parse = |text: &str| Expr::parse(text, &scope).unwrap();
    (source, vec![Residual::new(parse("y"), parse(&text.join(" + ")))])
}

/// Every entry measured alone, 40 times, off the diagonal with the root of two: squares are those of Frobenius' norm.
fn measured(seed: u64, n: usize) -> (MemorySource, Vec<Residual>, Mat<f64>) {
    let mut random = Numbers(seed);
    let k = n * (n + 1) / 2;
    let truth: Vec<f64> = (0..k).map(|_| random.between(-1.0, 1.0)).collect();
    let mut columns = vec![Vec::new(); k + 1];
    let mut mean = vec![0.0; k];
    for row in 0..40 * k {
        let entry = row % k;
        let on = (0..n).any(|i| place(i, i) == entry);
        let value = truth[entry] + random.between(-0.3, 0.3);
        mean[entry] += value / 40.0;
        (0..k).for_each(|c| columns[c].push(f64::from(u8::from(c == entry))));
        columns[k].push(value * if on { 1.0 } else { 2.0_f64.sqrt() });
    }
    let (source, residuals) = rows(&columns, n, |i, j| if i == j { 1.0 } else { 2.0_f64.sqrt() });
    (source, residuals, Mat::from_fn(n, n, |i, j| mean[place(i, j)]))
}

fn fit(residuals: &[Residual], bounded: Bounded<'_>, source: &MemorySource) -> Estimate {
    nonlinear_least_squares(residuals, bounded, source, &Options::default(), &Silent).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    /// The nearest matrix by Frobenius' norm with eigenvalues between bounds has those of the matrix itself, clipped.
    #[test]
    fn the_nearest_matrix_has_clipped_eigenvalues(seed in 0_u64..500, n in 1_usize..5) {
        let (source, residuals, M) = measured(seed, n);
        let limits = [limit(n, true, 0.05), limit(n, false, 0.8)];
        let parameters = parameters(n, 0.4);
        let estimate = fit(&residuals, Bounded::new(&parameters, &limits), &source);
        let eigen = M.self_adjoint_eigen(Side::Lower).unwrap();
        let clipped = |i: usize, j: usize| -> f64 {
            (0..n).map(|k| eigen.U()[(i, k)] * eigen.S()[k].clamp(0.05, 0.8) * eigen.U()[(j, k)]).sum()
        };
        for i in 0..n {
            for j in 0..=i {
                // The squares are known to 1e-13 of themselves, distances to its root.
                prop_assert!((estimate.values[place(i, j)] - clipped(i, j)).abs() < 1e-6, "{i} {j}: {:e} {:?} {} {:e}", estimate.values[place(i, j)] - clipped(i, j), estimate.status, estimate.iterations, estimate.gradient);
            }
        }
        prop_assert!(estimate.status.converged(), "{:?}", estimate.status);
        for limit in &limits {
            prop_assert!(limit.clearance(&estimate.values) > 0.0);
        }
        prop_assert!(estimate.gradient < 1e-6, "{}", estimate.gradient);
    }
}

/// Rows weigh entries unevenly. The slopes at the end are a positive semidefinite matrix, orthogonal to the distance
/// from the bound, and no feasible step lowers the cost.
#[test]
fn the_conditions_of_the_minimum_hold() {
    let n = 3;
    let mut random = Numbers(4);
    let mut met = 0;
    for _ in 0..6 {
        let (k, rows_of) = (6, 200);
        let mut columns: Vec<Vec<f64>> = (0..k)
            .map(|c| (0..rows_of).map(|_| random.between(-1.0, 1.0) * [1.0, 0.3, 2.0, 0.1, 0.5, 1.0][c]).collect())
            .collect();
        let truth = [1.0, 0.4, 0.3, -0.5, 0.2, 0.1];
        let y = (0..rows_of)
            .map(|row| (0..k).map(|c| truth[c] * columns[c][row]).sum::<f64>() + random.between(-1.0, 1.0))
            .collect();
        columns.push(y);
        let (source, residuals) = rows(&columns, n, |_, _| 1.0);
        let limits = [limit(n, true, 0.0)];
        let start = parameters(n, 1.0);
        let estimate = fit(&residuals, Bounded::new(&start, &limits), &source);
        let free = fit(&residuals, Bounded::new(&start, &[]), &source);
        if limits[0].clearance(&free.values) > 0.0 {
            continue;
        }
        met += 1;
        assert!(estimate.cost > free.cost && estimate.status.converged(), "{:?}", estimate.status);
        let cost = |values: &[f64]| -> f64 {
            let left = |row: usize| columns[k][row] - (0..k).map(|c| values[c] * columns[c][row]).sum::<f64>();
            (0..rows_of).map(|row| left(row).powi(2)).sum()
        };
        assert!((cost(&estimate.values) - estimate.cost).abs() < 1e-9 * estimate.cost);
        let slope = |c: usize| -> f64 {
            let left = |row: usize| columns[k][row] - (0..k).map(|c| estimate.values[c] * columns[c][row]).sum::<f64>();
            (0..rows_of).map(|row| -columns[c][row] * left(row)).sum()
        };
        // d cost/2 = <S, dM>
        let S = Mat::from_fn(n, n, |i, j| slope(place(i, j)) * if i == j { 1.0 } else { 0.5 });
        let size = S.norm_l2();
        let least = S.self_adjoint_eigenvalues(Side::Lower).unwrap()[0];
        assert!(least >= -1e-5 * size, "{least} {size}");
        let M = Mat::from_fn(n, n, |i, j| estimate.values[place(i, j)]);
        assert!((&S * &M).norm_l2() <= 1e-5 * size * M.norm_l2());
        let mut within = 0;
        for step in [1e-1, 1e-2, 1e-3] {
            for _ in 0..1000 {
                let other: Vec<f64> = estimate.values.iter().map(|v| v + step * random.between(-1.0, 1.0)).collect();
                if limits[0].clearance(&other) >= 0.0 {
                    within += 1;
                    assert!(cost(&other) >= estimate.cost * (1.0 - 1e-10));
                }
            }
        }
        assert!(within > 100, "{within}");
    }
    assert!(met >= 3, "{met}");
}

/// At the border the standard errors are those of the matrices at the border: of `bound + size u u'` with its size and angle as parameters.
#[test]
fn standard_errors_lie_along_the_bound() {
    let columns = {
        let mut random = Numbers(7);
        let mut columns: Vec<Vec<f64>> =
            (0..3).map(|_| (0..300).map(|_| random.between(-1.0, 1.0)).collect()).collect();
        let y = (0..300).map(|row| {
            0.9 * columns[0][row] + 0.5 * columns[1][row] + 0.1 * columns[2][row] + random.between(-0.2, 0.2)
        });
        let y = y.collect();
        columns.push(y);
        columns
    };
    let (source, residuals) = rows(&columns, 2, |_, _| 1.0);
    let limits = [limit(2, true, 0.05)];
    let start = parameters(2, 0.5);
    let estimate = fit(&residuals, Bounded::new(&start, &limits), &source);
    assert!(limits[0].clearance(&estimate.values) < 1e-6, "{:?}", estimate.values);
    let scope = Scope::open();
    let model = "(0.05 + s*cos(a)^2)*d0 + s*cos(a)*sin(a)*d1 + (0.05 + s*sin(a)^2)*d2";
    let other = Residual::new(Expr::parse("y", &scope).unwrap(), Expr::parse(model, &scope).unwrap());
    let angles = [Parameter::new("s", 0.8), Parameter::new("a", 0.3)];
    let turned = nonlinear_least_squares(&[other], &angles, &source, &Options::default(), &Silent).unwrap();
    let (s, a) = (turned.values[0], turned.values[1]);
    let (sin, cos) = a.sin_cos();
    let expected = [0.05 + s * cos * cos, s * cos * sin, 0.05 + s * sin * sin];
    // dM by size and angle.
    let tangent =
        [[cos * cos, -2.0 * s * cos * sin], [cos * sin, s * (cos * cos - sin * sin)], [sin * sin, 2.0 * s * cos * sin]];
    // One parameter more counts as free in the variance.
    let factor = estimate.variance / turned.variance;
    for k in 0..3 {
        assert!((estimate.values[k] - expected[k]).abs() < 1e-6, "{k}: {:?} {expected:?}", estimate.values);
        let of = |i: usize, j: usize| tangent[k][i] * turned.covariance[(i, j)] * tangent[k][j];
        let square: f64 = (0..2).flat_map(|i| (0..2).map(move |j| (i, j))).map(|(i, j)| of(i, j)).sum();
        let error = (factor * square).sqrt();
        assert!(
            (estimate.standard_errors()[k] / error - 1.0).abs() < 1e-3,
            "{k}: {} {error}",
            estimate.standard_errors()[k]
        );
    }
}

#[test]
fn inactive_limits_change_no_bit() {
    let (source, residuals, _) = measured(3, 3);
    let start = parameters(3, 0.4);
    let free = fit(&residuals, Bounded::new(&start, &[]), &source);
    let wide = [limit(3, true, -5.0), limit(3, false, 5.0)];
    let within = fit(&residuals, Bounded::new(&start, &wide), &source);
    assert_eq!((free.values, free.cost, free.covariance), (within.values, within.cost, within.covariance));
    let tight = [limit(3, true, 0.1)];
    let run = |threads| with_threads(threads, || fit(&residuals, Bounded::new(&start, &tight), &source));
    assert_eq!(run(1), run(7));
}

#[test]
fn bad_matrices_and_infeasible_starts_are_refused() {
    let (source, residuals, _) = measured(3, 2);
    let refused = |start: f64, limit: MatrixLimit| {
        let start = parameters(2, start);
        let limits = [limit];
        nonlinear_least_squares(&residuals, Bounded::new(&start, &limits), &source, &Options::default(), &Silent)
            .unwrap_err()
    };
    let outside = refused(0.1, limit(2, true, 0.2));
    assert!(matches!(outside, EstimateError::Outside { .. }) && outside.to_string().contains("strictly"), "{outside}");
    let two = MatrixLimit { entries: vec![Affine::parameter(0), Affine::parameter(1)], ..limit(2, true, 0.0) };
    assert!(matches!(refused(1.0, two), EstimateError::NoMatrix { .. }));
    let none = MatrixLimit { entries: vec![Affine::parameter(9)], ..limit(2, true, 0.0) };
    assert!(matches!(refused(1.0, none), EstimateError::NoMatrix { .. }));
}
