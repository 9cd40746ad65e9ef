//! Problems from every kind of statistic, refusals, and the adaptive lasso.

use crate::common::{Form, degenerate, random};
use faer::Mat;
use fleetfoot_sparse::{
    Penalty, Quadratic, Sign, SparseError, Strength,
    adaptive::{Initial, adaptive, degrees_of_freedom},
    certificate,
    coordinate::{CoordinateOptions, coordinate_descent, lambda_grid, lambda_max},
    lars::{LarsOptions, Method, lars},
};
use fleetfoot_stats::{Factor, Gram, ridge};

fn close(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    let scale = a.iter().chain(b).fold(0.0_f64, |scale, value| scale.max(value.abs()));
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance * scale)
}

#[test]
fn equal_statistics_give_equal_paths() {
    let rows = random(1, 50, 6);
    let weights: Vec<f64> = (0..50).map(|i| [1.0, 0.0, 2.5, 0.3][i % 4]).collect();
    let z = Mat::from_fn(50, 7, |i, j| if j < 6 { rows.x[(i, j)] } else { rows.y[i] });
    let mut factor = Factor::new(6, 1);
    factor.push(z.as_ref(), Some(&weights));
    // A row of integer weight is that many rows: here 1, 2.5 and 0.3 tenths of a row.
    let repeated: Vec<usize> = (0..50).flat_map(|i| vec![i; (10.0 * weights[i]).round() as usize]).collect();
    let x = Mat::from_fn(repeated.len(), 6, |i, j| rows.x[(repeated[i], j)]);
    let y: Vec<f64> = repeated.iter().map(|&i| rows.y[i]).collect();
    let problems = [
        Quadratic::from_rows(rows.x.as_ref(), &rows.y, Some(&weights), true).expect("rows"),
        Quadratic::from_square_root(&factor.square_root(), 0).expect("a square root"),
        Quadratic::from_gram(&Gram::of_rows(z.as_ref(), Some(&weights)), &[0, 1, 2, 3, 4, 5], 6).expect("a Gram"),
        Quadratic::from_rows(x.as_ref(), &y, None, true).expect("rows"),
    ];
    let penalty = Penalty::standardised();
    let paths: Vec<_> = problems.iter().map(|q| lars(q, &penalty, &LarsOptions::default()).expect("a path")).collect();
    for path in &paths[1..] {
        assert_eq!(path.knots.len(), paths[0].knots.len());
        for (a, b) in path.knots.iter().zip(&paths[0].knots) {
            assert!((a.l1 - b.l1).abs() < 1e-11 * paths[0].knots[0].l1);
            assert!(close(&a.dense(6), &b.dense(6), 1e-11));
            assert!(
                (a.intercept - b.intercept).abs() < 1e-10
                    && (a.mse - b.mse).abs() < 1e-11
                    && (a.r2 - b.r2).abs() < 1e-11
            );
        }
    }
}

#[test]
fn mean_squared_error_and_r2_match_rows() {
    for rows in [random(3, 40, 5), random(4, 9, 12)] {
        for form in crate::common::FORMS {
            let path = lars(&rows.problem(form), &Penalty::default(), &LarsOptions::default()).expect("a path");
            let mean = rows.y.iter().sum::<f64>() / rows.n() as f64;
            let total = rows.y.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / rows.n() as f64;
            for knot in &path.knots {
                let (_, mse) = rows.gradient(knot);
                assert!((knot.mse - mse).abs() < 1e-12 * total && (knot.r2 - (1.0 - mse / total)).abs() < 1e-12);
            }
        }
    }
}

#[test]
fn columns_of_a_gram_matrix_may_be_chosen() {
    let rows = random(2, 40, 5);
    let z = Mat::from_fn(40, 6, |i, j| if j < 5 { rows.x[(i, j)] } else { rows.y[i] });
    let gram = Gram::of_rows(z.as_ref(), None);
    let some = Quadratic::from_gram(&gram, &[4, 1], 5).expect("a problem");
    let x = Mat::from_fn(40, 2, |i, j| rows.x[(i, [4, 1][j])]);
    let direct = Quadratic::from_rows(x.as_ref(), &rows.y, None, true).expect("a problem");
    let path = |problem: &Quadratic| lars(problem, &Penalty::default(), &LarsOptions::default()).expect("a path");
    let (a, b) = (path(&some), path(&direct));
    assert!(a.knots.iter().zip(&b.knots).all(|(a, b)| close(&a.dense(2), &b.dense(2), 1e-12)));
    assert_eq!(Quadratic::from_gram(&gram, &[0, 7], 5), Err(SparseError::NoSuchTarget { target: 7, targets: 6 }));
}

/// Unpenalised columns are what partialling out makes of them: regress target and columns on them, and fit what is left.
#[test]
fn unpenalised_columns_are_partialled_out() {
    let rows = random(13, 60, 7);
    let free = [2, 5];
    let factors = (0..7).map(|j| if free.contains(&j) { 0.0 } else { 1.0 }).collect();
    let penalty = Penalty { factors, ..Penalty::default() };
    let z = |value: &dyn Fn(usize) -> f64| {
        let mut factor = Factor::new(2, 1);
        let block = Mat::from_fn(60, 3, |i, j| if j < 2 { rows.x[(i, free[j])] } else { value(i) });
        factor.push(block.as_ref(), None);
        let fit = fleetfoot_stats::least_squares(&factor.square_root(), &[1.0, 1.0]);
        let left = |i: usize| value(i) - (0..2).map(|j| fit.coefficients[(j, 0)] * rows.x[(i, free[j])]).sum::<f64>();
        (0..60).map(left).collect::<Vec<f64>>()
    };
    let kept: Vec<usize> = (0..7).filter(|j| !free.contains(j)).collect();
    let columns: Vec<Vec<f64>> = kept.iter().map(|&j| z(&|i| rows.x[(i, j)])).collect();
    let x = Mat::from_fn(60, 5, |i, j| columns[j][i]);
    let y = z(&|i| rows.y[i]);
    let partialled = Quadratic::from_rows(x.as_ref(), &y, None, true).expect("rows");
    let expected = lars(&partialled, &Penalty::default(), &LarsOptions::default()).expect("a path");
    for form in crate::common::FORMS {
        let path = lars(&rows.problem(form), &penalty, &LarsOptions::default()).expect("a path");
        assert_eq!(path.knots.len(), expected.knots.len());
        for (a, b) in path.knots.iter().zip(&expected.knots) {
            let selected: Vec<f64> = kept.iter().map(|&j| a.coefficient(j)).collect();
            assert!((a.l1 - b.l1).abs() < 1e-11 * expected.knots[0].l1 && close(&selected, &b.dense(5), 1e-10));
            assert!(free.iter().all(|&j| a.coefficient(j) != 0.0));
        }
    }
}

#[test]
fn all_columns_unpenalised_is_least_squares_with_signs() {
    let rows = random(14, 40, 4);
    let signs = vec![Sign::NonNegative, Sign::NonPositive, Sign::Free, Sign::NonNegative];
    let penalty = Penalty { factors: vec![0.0; 4], signs, ..Penalty::default() };
    let problem = rows.problem(Form::Root);
    let path = lars(&problem, &penalty, &LarsOptions::default()).expect("a path");
    assert_eq!((path.knots.len(), path.knots[0].l1), (1, 0.0));
    assert!(path.knots[0].certificate.kkt < 1e-13 && rows.violation(&penalty, &path.knots[0]) < 1e-13);
    let other = coordinate_descent(&problem, &penalty, &[0.7], &CoordinateOptions::default()).expect("a solution");
    assert!(close(&other[0].dense(4), &path.knots[0].dense(4), 1e-11));
    assert_eq!(lambda_max(&problem, &penalty, 1.0), Ok(0.0));
}

#[test]
fn the_adaptive_lasso_is_the_lasso_of_rescaled_columns() {
    let rows = random(15, 80, 6);
    let problem = rows.problem(Form::Root);
    let penalty = Penalty::default();
    let mut factor = Factor::new(6, 1);
    factor.push(Mat::from_fn(80, 7, |i, j| if j < 6 { rows.x[(i, j)] } else { rows.y[i] }).as_ref(), None);
    let root = factor.square_root();
    for (initial, l2) in [(Initial::LeastSquares, 0.0), (Initial::Ridge { l2: 0.2 }, 0.2)] {
        let adapted = adaptive(&problem, &penalty, initial, 1.5).expect("a penalty");
        let first = ridge(&root, &[1.0; 6], l2, None).coefficients;
        let expected: Vec<f64> = (0..6).map(|j| first[(j, 0)].abs().powf(-1.5)).collect();
        assert!(adapted.factors.iter().zip(&expected).all(|(a, b)| (a / b - 1.0).abs() < 1e-9));
        // b_j w_j = c_j: a plain lasso in columns x_j / w_j.
        let x = Mat::from_fn(80, 6, |i, j| rows.x[(i, j)] / expected[j]);
        let scaled = Quadratic::from_rows(x.as_ref(), &rows.y, None, true).expect("rows");
        let plain = lars(&scaled, &Penalty::default(), &LarsOptions::default()).expect("a path");
        let path = lars(&problem, &adapted, &LarsOptions::default()).expect("a path");
        assert_eq!(path.knots.len(), plain.knots.len());
        for (a, b) in path.knots.iter().zip(&plain.knots) {
            let back: Vec<f64> = (0..6).map(|j| b.coefficient(j) / expected[j]).collect();
            assert!(close(&a.dense(6), &back, 1e-9));
        }
    }
    let copies = degenerate().into_iter().find(|rows| rows.name == "duplicated").expect("the problem");
    let problem = copies.problem(Form::Root);
    let refused = adaptive(&problem, &penalty, Initial::LeastSquares, 1.0);
    assert_eq!(refused, Err(SparseError::NeedsRidge { columns: vec![3] }));
    assert!(adaptive(&problem, &penalty, Initial::Ridge { l2: 0.1 }, 1.0).is_ok());
    let refused = adaptive(&problem, &penalty, Initial::LeastSquares, 0.0);
    assert_eq!(refused, Err(SparseError::Exponent { value: 0.0 }));
}

#[test]
fn degrees_of_freedom_are_the_trace_of_the_hat_matrix() {
    // Orthogonal columns: each counts 1 / (1 + l2 / variance).
    let rows = degenerate().into_iter().find(|rows| rows.name == "equal correlations").expect("the problem");
    for form in crate::common::FORMS {
        let problem = rows.problem(form);
        for l2 in [0.0, 0.5] {
            let options = LarsOptions { l2, ..LarsOptions::default() };
            let path = lars(&problem, &Penalty::default(), &options).expect("a path");
            for knot in &path.knots {
                let degrees_of_freedom = degrees_of_freedom(&problem, &Penalty::default(), knot).expect("a number");
                assert!(
                    (degrees_of_freedom - knot.support.len() as f64 / (1.0 + l2)).abs() < 1e-12,
                    "{degrees_of_freedom}"
                );
            }
            assert_eq!(path.knots.last().expect("a knot").support.len(), 7);
        }
    }
}

#[test]
fn the_certificate_refuses_wrong_solutions() {
    let rows = random(16, 30, 4);
    let problem = rows.problem(Form::Root);
    let penalty = Penalty { signs: vec![Sign::NonNegative; 4], ..Penalty::default() };
    let lambda = 0.1 * lambda_max(&problem, &penalty, 1.0).expect("a lambda");
    let strength = Strength::lasso(lambda);
    let path = lars(&problem, &penalty, &LarsOptions::default()).expect("a path");
    let mut coefficients = path.coefficients(lambda).expect("on the path");
    let good = certificate(&problem, &penalty, strength, &coefficients).expect("a certificate");
    assert!(good.kkt < 1e-14 && good.gap < 1e-14);
    let moved = coefficients.iter().position(|&value| value != 0.0).expect("an active column");
    coefficients[moved] *= 1.0 + 1e-3;
    let worse = certificate(&problem, &penalty, strength, &coefficients).expect("a certificate");
    // The gap bounds what was lost, and not by much.
    let lost = 2.0 * (worse.objective - good.objective) / problem.target_deviation().powi(2);
    assert!(worse.kkt > 1e-5 && worse.gap >= lost && lost > 0.0, "{worse:?} {lost:e}");
    coefficients[moved] = -1.0;
    assert_eq!(certificate(&problem, &penalty, strength, &coefficients).expect("a certificate").kkt, f64::INFINITY);
    let zero = certificate(&problem, &penalty, strength, &[0.0; 4]).expect("a certificate");
    assert!(
        zero.kkt > 0.01 && zero.gap > 0.01 && (zero.objective / problem.target_deviation().powi(2) - 0.5).abs() < 1e-12
    );
}

#[test]
fn bad_input_is_refused_with_its_reason() {
    let rows = random(17, 10, 3);
    let of = |x: &Mat<f64>, y: &[f64], weights: Option<&[f64]>| Quadratic::from_rows(x.as_ref(), y, weights, true);
    let (x, y) = (&rows.x, &rows.y);
    let mut broken = x.clone();
    broken[(4, 1)] = f64::NAN;
    assert_eq!(of(&broken, y, None), Err(SparseError::ColumnNotFinite { column: 1 }));
    // A row without weight leaves no trace.
    let weights: Vec<f64> = (0..10).map(|i| f64::from(i != 4)).collect();
    assert!(of(&broken, y, Some(&weights)).is_ok());
    let mut target = y.clone();
    target[0] = f64::INFINITY;
    assert_eq!(of(x, &target, None), Err(SparseError::TargetNotFinite));
    assert_eq!(of(x, &y[1..], None), Err(SparseError::Length { what: "the target", actual: 9, expected: 10 }));
    assert_eq!(of(x, y, Some(&[0.0; 10])), Err(SparseError::NoRows));
    assert_eq!(of(&Mat::zeros(0, 3), &[], None), Err(SparseError::NoRows));
    let negative: Vec<f64> = (0..10).map(|i| if i == 2 { -1.0 } else { 1.0 }).collect();
    assert_eq!(of(x, y, Some(&negative)), Err(SparseError::RowWeight { row: 2, value: -1.0 }));

    let mut factor = Factor::new(3, 1);
    factor.push(Mat::from_fn(10, 4, |i, j| if j < 3 { broken[(i, j)] } else { y[i] }).as_ref(), None);
    let root = factor.square_root();
    assert_eq!(Quadratic::from_square_root(&root, 0), Err(SparseError::ColumnNotFinite { column: 1 }));
    assert_eq!(Quadratic::from_square_root(&root, 1), Err(SparseError::NoSuchTarget { target: 1, targets: 1 }));
    assert_eq!(Quadratic::from_square_root(&Factor::new(3, 1).square_root(), 0), Err(SparseError::NoRows));

    let gram = |diagonal: f64, other: f64| Mat::from_fn(2, 2, |i, j| if i == j { diagonal } else { other });
    let products = |g: Mat<f64>, xy: [f64; 2], yy: f64| Quadratic::from_products(g.as_ref(), &xy, yy, 5.0);
    assert!(products(gram(2.0, 1.0), [1.0, 1.0], 1.0).is_ok());
    let refused = |column: usize, other: usize| Err(SparseError::NotMoments { column, other, targets: 2 });
    assert_eq!(products(gram(2.0, 3.0), [1.0, 1.0], 1.0), refused(0, 1));
    assert_eq!(products(gram(-2.0, 1.0), [1.0, 1.0], 1.0), refused(0, 0));
    assert_eq!(products(gram(2.0, 1.0), [9.0, 1.0], 1.0), refused(0, 2));
    assert_eq!(products(gram(2.0, 1.0), [1.0, 1.0], -1.0), refused(2, 2));
    assert_eq!(products(gram(f64::NAN, 1.0), [1.0, 1.0], 1.0), Err(SparseError::ColumnNotFinite { column: 0 }));
    assert_eq!(Quadratic::from_products(gram(2.0, 1.0).as_ref(), &[1.0, 1.0], 1.0, 0.0), Err(SparseError::NoRows));

    let problem = rows.problem(Form::Root);
    let path = |penalty: Penalty, options: LarsOptions| lars(&problem, &penalty, &options).map(|path| path.knots.len());
    let plain = Penalty::default;
    let factors = Penalty { factors: vec![1.0, -1.0, 1.0], ..plain() };
    assert_eq!(path(factors, LarsOptions::default()), Err(SparseError::PenaltyFactor { column: 1, value: -1.0 }));
    let short = Penalty { factors: vec![1.0], ..plain() };
    let length = SparseError::Length { what: "the penalty factors", actual: 1, expected: 3 };
    assert_eq!(path(short, LarsOptions::default()), Err(length));
    let options = LarsOptions { lambda_min: -1.0, ..LarsOptions::default() };
    assert_eq!(path(plain(), options), Err(SparseError::Strength { name: "lambda_min", value: -1.0 }));
    let options = LarsOptions { l2: f64::INFINITY, ..LarsOptions::default() };
    assert_eq!(path(plain(), options), Err(SparseError::Strength { name: "l2", value: f64::INFINITY }));
    let signs = Penalty { signs: vec![Sign::Free, Sign::Free, Sign::NonPositive], ..plain() };
    let options = LarsOptions { method: Method::Lars, ..LarsOptions::default() };
    assert_eq!(path(signs, options), Err(SparseError::SignsNeedLasso { column: 2 }));

    let descent = |lambda: f64, options: CoordinateOptions| {
        coordinate_descent(&problem, &plain(), &[lambda], &options).map(|solutions| solutions.len())
    };
    let options = CoordinateOptions { l1_ratio: 1.5, ..CoordinateOptions::default() };
    assert_eq!(descent(1.0, options), Err(SparseError::L1Ratio { value: 1.5 }));
    let options = CoordinateOptions { tolerance: 0.0, ..CoordinateOptions::default() };
    assert_eq!(descent(1.0, options), Err(SparseError::Tolerance { value: 0.0 }));
    assert_eq!(descent(-0.1, CoordinateOptions::default()), Err(SparseError::Strength { name: "lambda", value: -0.1 }));
    assert_eq!(lambda_grid(&problem, &plain(), 0.0, 5, 0.1), Err(SparseError::NoLambdaMax { value: 0.0 }));
    assert_eq!(lambda_grid(&problem, &plain(), 1.0, 0, 0.1), Err(SparseError::Grid { count: 0, ratio: 0.1 }));
    let text = SparseError::PenaltyFactor { column: 1, value: -1.0 }.to_string();
    assert!(text.contains("column 1") && text.contains("-1"), "{text}");
}

#[test]
fn pure_ridge_matches_small_solves() {
    let rows = random(18, 40, 5);
    let mut factor = Factor::new(5, 1);
    factor.push(Mat::from_fn(40, 6, |i, j| if j < 5 { rows.x[(i, j)] } else { rows.y[i] }).as_ref(), None);
    let expected = ridge(&factor.square_root(), &[1.0; 5], 0.4, None);
    let options = CoordinateOptions { l1_ratio: 0.0, ..CoordinateOptions::default() };
    for form in crate::common::FORMS {
        let solutions =
            coordinate_descent(&rows.problem(form), &Penalty::default(), &[0.4], &options).expect("a solution");
        assert!(solutions[0].converged && close(&solutions[0].dense(5), expected.coefficients.col_as_slice(0), 1e-11));
        assert!((solutions[0].intercept - expected.intercept[0]).abs() < 1e-10);
    }
}
