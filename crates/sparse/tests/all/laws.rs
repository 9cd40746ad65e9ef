//! Laws of the minimiser as properties: scaling, permutation, shifts, and certificates of random problems.

use crate::common::{Form, integers, random};
use faer::Mat;
use fleetfoot_sparse::{
    Penalty, Quadratic, Sign,
    coordinate::{CoordinateOptions, coordinate_descent},
    lars::{LarsOptions, lars},
};
use proptest::prelude::*;

fn problem(x: &Mat<f64>, y: &[f64], form: Form) -> Quadratic {
    crate::common::Rows { name: "changed".into(), x: x.clone(), y: y.to_vec(), unique: true }.problem(form)
}

/// Coefficients of both solvers at a share of the way.
fn fits(problem: &Quadratic, penalty: &Penalty, lambda: f64, l2: f64) -> [Vec<f64>; 2] {
    let options = LarsOptions { l2, ..LarsOptions::default() };
    let path = lars(problem, penalty, &options).expect("a path").coefficients(lambda).expect("on the path");
    let options = CoordinateOptions { l1_ratio: lambda / (lambda + l2), ..CoordinateOptions::default() };
    let descent = coordinate_descent(problem, penalty, &[lambda + l2], &options).expect("a solution");
    [path, descent[0].dense(problem.columns())]
}

fn close(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    let scale = a.iter().chain(b).fold(1e-6_f64, |scale, value| scale.max(value.abs()));
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance * scale)
}

fn shape() -> impl Strategy<Value = (u64, usize, usize)> {
    (0_u64..10_000, 8_usize..40, 1_usize..8)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn scaling_the_target_scales_lambda_and_the_coefficients(
        (seed, n, p) in shape(), exponent in -60_i32..60, share in 0.02_f64..0.9, l2 in 0.0_f64..2.0,
    ) {
        let rows = random(seed, n + p, p);
        let factor = 10.0_f64.powi(exponent);
        let y: Vec<f64> = rows.y.iter().map(|y| factor * y).collect();
        for form in crate::common::FORMS {
            let (a, b) = (problem(&rows.x, &rows.y, form), problem(&rows.x, &y, form));
            let penalty = Penalty::default();
            let lambda = share * lars(&a, &penalty, &LarsOptions::default()).expect("a path").knots[0].l1;
            // The weight of the squares has no unit of the target.
            for (one, other) in fits(&a, &penalty, lambda, l2).iter().zip(path_only(&b, &penalty, factor * lambda, l2)) {
                let back: Vec<f64> = other.iter().map(|value| value / factor).collect();
                prop_assert!(close(one, &back, 1e-8), "{one:?} {back:?}");
            }
        }
    }

    #[test]
    fn units_of_columns_do_not_matter_when_standardised(
        (seed, n, p) in shape(), exponent in -50_i32..50, share in 0.02_f64..0.9, shift in -5.0_f64..5.0,
    ) {
        let rows = random(seed, n + p, p);
        let factor = |j: usize| if j.is_multiple_of(2) { 10.0_f64.powi(exponent) } else { -0.5 };
        let x = Mat::from_fn(n + p, p, |i, j| factor(j) * (rows.x[(i, j)] + shift));
        for form in crate::common::FORMS {
            let (a, b) = (problem(&rows.x, &rows.y, form), problem(&x, &rows.y, form));
            let penalty = Penalty::standardised();
            let lambda = share * lars(&a, &penalty, &LarsOptions::default()).expect("a path").knots[0].l1;
            for (one, other) in fits(&a, &penalty, lambda, 0.1).iter().zip(fits(&b, &penalty, lambda, 0.1)) {
                let back: Vec<f64> = other.iter().enumerate().map(|(j, value)| value * factor(j)).collect();
                prop_assert!(close(one, &back, 1e-8), "{one:?} {back:?}");
            }
        }
    }

    #[test]
    fn the_order_of_columns_does_not_matter((seed, n, p) in shape(), turn in 0_usize..8, share in 0.02_f64..0.9) {
        let rows = random(seed, n + p, p);
        let to = |j: usize| (j + turn) % p;
        let x = Mat::from_fn(n + p, p, |i, j| rows.x[(i, to(j))]);
        let factors: Vec<f64> = (0..p).map(|j| [1.0, 0.0, 3.0][j % 3]).collect();
        let signs: Vec<Sign> = (0..p).map(|j| [Sign::Free, Sign::NonNegative][j % 2]).collect();
        let turned = Penalty {
            factors: (0..p).map(|j| factors[to(j)]).collect(),
            signs: (0..p).map(|j| signs[to(j)]).collect(),
            ..Penalty::standardised()
        };
        let penalty = Penalty { factors, signs, ..Penalty::standardised() };
        for form in crate::common::FORMS {
            let (a, b) = (problem(&rows.x, &rows.y, form), problem(&x, &rows.y, form));
            let lambda = share * lars(&a, &penalty, &LarsOptions::default()).expect("a path").knots[0].l1;
            prop_assume!(lambda > 0.0);
            for (one, other) in fits(&a, &penalty, lambda, 0.0).iter().zip(fits(&b, &turned, lambda, 0.0)) {
                let mut back = vec![0.0; p];
                (0..p).for_each(|j| back[to(j)] = other[j]);
                prop_assert!(close(one, &back, 1e-8), "{one:?} {back:?}");
            }
        }
    }

    #[test]
    fn penalty_factors_scale_lambda((seed, n, p) in shape(), factor in 0.1_f64..10.0, share in 0.02_f64..0.9) {
        let rows = random(seed, n + p, p);
        let x = problem(&rows.x, &rows.y, Form::Root);
        let plain = Penalty::standardised();
        let scaled = Penalty { factors: vec![factor; p], ..Penalty::standardised() };
        let lambda = share * lars(&x, &plain, &LarsOptions::default()).expect("a path").knots[0].l1;
        let (a, b) = (fits(&x, &plain, lambda * factor, 0.0), fits(&x, &scaled, lambda, 0.0));
        prop_assert!(close(&a[0], &b[0], 1e-9) && close(&a[1], &b[1], 1e-9));
    }

    #[test]
    fn problems_of_few_values_are_certified(seed in 0_u64..100_000, n in 2_usize..16, p in 1_usize..16, kind in 0_usize..6) {
        let rows = integers(seed, n, p);
        let (what, penalty) = crate::common::penalties(p).swap_remove(kind);
        for form in crate::common::FORMS {
            let problem = rows.problem(form);
            let path = lars(&problem, &penalty, &LarsOptions::default()).expect("a path");
            prop_assert!(path.knots.last().is_some_and(|knot| knot.l1 == 0.0), "{what} {form:?} {:?}", path.status);
            for knot in &path.knots {
                let certificate = knot.certificate;
                prop_assert!(certificate.kkt < 1e-8 && certificate.gap < 1e-8, "{what} {form:?} {certificate:?}");
                prop_assert!(problem.target_deviation() == 0.0 || rows.violation(&penalty, knot) < 1e-8);
            }
        }
    }
}

/// The path, twice: an elastic net's two strengths do not scale alike, so descent would need another ratio.
fn path_only(problem: &Quadratic, penalty: &Penalty, lambda: f64, l2: f64) -> [Vec<f64>; 2] {
    let options = LarsOptions { l2, ..LarsOptions::default() };
    let path = lars(problem, penalty, &options).expect("a path").coefficients(lambda).expect("on the path");
    [path.clone(), path]
}
