//! The paths of LARS: certificates at every knot, and between them.

use crate::common::{FORMS, Form, Rows, degenerate, ordinary, penalties};
use fleetfoot_sparse::{
    Path, PathStatus, Penalty, SparseError,
    lars::{LarsOptions, Method, lars},
};

/// Knots whose violations, found from the statistic and from the rows, are below 1e-8 of scale; lambda falls strictly; the end is reached.
fn check(rows: &Rows, form: Form, what: &str, penalty: &Penalty, options: &LarsOptions) -> Path {
    let problem = rows.problem(form);
    let path = lars(&problem, penalty, options).expect("a path");
    let who = format!("{}, {form:?}, {what}, l2 = {}", rows.name, options.l2);
    assert!(path.knots.windows(2).all(|pair| pair[0].l1 > pair[1].l1), "{who}: lambda must fall");
    assert!(matches!(path.status, PathStatus::Complete | PathStatus::Saturated), "{who}: {:?}", path.status);
    assert_eq!(path.knots.last().expect("a knot").l1, 0.0, "{who}");
    let sound = |solution: &fleetfoot_sparse::Solution, place: &str| {
        let certificate = solution.certificate;
        assert!(certificate.kkt < 1e-8, "{who}, {place}: kkt {:e}, lambda {:e}", certificate.kkt, solution.l1);
        assert!(
            (0.0..rows.most_gap(form)).contains(&certificate.gap),
            "{who}, {place}: gap {:e}, lambda {:e}",
            certificate.gap,
            solution.l1
        );
        if problem.target_deviation() > 0.0 && problem.target_deviation() < 1e90 {
            let violation = rows.violation(penalty, solution);
            assert!(violation < 1e-8, "{who}, {place}: violation {violation:e}, kkt {:e}", certificate.kkt);
        }
    };
    for (k, knot) in path.knots.iter().enumerate() {
        sound(knot, &format!("knot {k} of {}", path.knots.len()));
    }
    for pair in path.knots.windows(2) {
        let lambda = 0.3 * pair[0].l1 + 0.7 * pair[1].l1;
        sound(&path.at(&problem, lambda).expect("inside the path"), "between knots");
    }
    path
}

#[test]
fn every_knot_of_ordinary_problems_is_certified() {
    for rows in ordinary() {
        for (what, penalty) in penalties(rows.p()) {
            for form in FORMS {
                check(&rows, form, what, &penalty, &LarsOptions::default());
                check(&rows, form, what, &penalty, &LarsOptions { l2: 0.3, ..LarsOptions::default() });
            }
        }
    }
}

#[test]
fn every_knot_of_degenerate_problems_is_certified() {
    for rows in degenerate() {
        for (what, penalty) in penalties(rows.p()) {
            for form in FORMS {
                check(&rows, form, what, &penalty, &LarsOptions::default());
                check(&rows, form, what, &penalty, &LarsOptions { l2: 1e-3, ..LarsOptions::default() });
            }
        }
    }
}

#[test]
fn plain_lars_is_equiangular() {
    for rows in ordinary() {
        let problem = rows.problem(Form::Root);
        let options = LarsOptions { method: Method::Lars, ..LarsOptions::default() };
        let path = lars(&problem, &Penalty::standardised(), &options).expect("a path");
        assert_eq!(path.status, PathStatus::Complete, "{}", rows.name);
        // One column a step, all in the end.
        assert_eq!(path.knots.len(), rows.p() + 1, "{}", rows.name);
        let (deviation, tau) = (problem.deviation(), problem.target_deviation());
        for knot in &path.knots {
            let (gradient, _) = rows.gradient(knot);
            for j in 0..rows.p() {
                let (correlation, lambda) = ((gradient[j] / deviation[j]).abs() / tau, knot.l1 / tau);
                let active = knot.coefficient(j) != 0.0;
                let apart = if active { (correlation - lambda).abs() } else { (correlation - lambda).max(0.0) };
                assert!(apart < 1e-11, "{}: column {j}, {apart:e}", rows.name);
            }
        }
    }
}

#[test]
fn stopped_path_is_prefix_of_full_path() {
    let rows = crate::common::leaves_and_returns();
    let problem = rows.problem(Form::Root);
    let penalty = Penalty::standardised();
    let whole = lars(&problem, &penalty, &LarsOptions::default()).expect("a path");
    assert_eq!(whole.status, PathStatus::Complete);
    let dropped = whole.knots.windows(2).any(|pair| pair[0].support.iter().any(|&j| pair[1].coefficient(j) == 0.0));
    assert!(dropped, "the problem is meant to have columns that leave");

    let lambda_min = 0.37 * whole.knots[4].l1 + 0.63 * whole.knots[5].l1;
    let stopped = lars(&problem, &penalty, &LarsOptions { lambda_min, ..LarsOptions::default() }).expect("a path");
    assert_eq!(stopped.status, PathStatus::LambdaMin);
    assert_eq!(stopped.knots[..5], whole.knots[..5]);
    let last = stopped.knots.last().expect("a knot");
    assert_eq!(last.l1, lambda_min);
    let between = whole.coefficients(lambda_min).expect("on the path");
    assert!((0..24).all(|j| (between[j] - last.coefficient(j)).abs() < 1e-11));
    assert_eq!(
        stopped.coefficients(0.5 * lambda_min),
        Err(SparseError::BelowPath { lambda: 0.5 * lambda_min, end: lambda_min })
    );

    let options = LarsOptions { max_features: Some(3), ..LarsOptions::default() };
    let stopped = lars(&problem, &penalty, &options).expect("a path");
    assert_eq!(stopped.status, PathStatus::MaxFeatures);
    assert!(stopped.knots.iter().all(|knot| knot.support.len() <= 3));
    assert_eq!(stopped.knots[..], whole.knots[..stopped.knots.len()]);
    assert!(whole.knots[stopped.knots.len()].support.len() > 3, "it goes as far as it may");

    let options = LarsOptions { max_knots: Some(4), ..LarsOptions::default() };
    let stopped = lars(&problem, &penalty, &options).expect("a path");
    assert_eq!((stopped.status, stopped.knots.len()), (PathStatus::MaxKnots, 4));

    // A lambda_min above the first knot: nothing is active there.
    let lambda_min = 2.0 * whole.knots[0].l1;
    let stopped = lars(&problem, &penalty, &LarsOptions { lambda_min, ..LarsOptions::default() }).expect("a path");
    assert_eq!((stopped.status, stopped.knots.len(), stopped.knots[0].l1), (PathStatus::LambdaMin, 1, lambda_min));
    assert!(stopped.knots[0].support.is_empty() && whole.coefficients(lambda_min).is_ok());
}

#[test]
fn columns_left_out_are_named() {
    for rows in degenerate() {
        for form in FORMS {
            let path = lars(&rows.problem(form), &Penalty::standardised(), &LarsOptions::default()).expect("a path");
            let expected: (&[usize], &[usize]) = match rows.name.as_str() {
                "constant column" | "zero column" => (&[], &[2]),
                "equal correlations" | "large offsets" => (&[], &[]),
                // The path ends where the target is explained: nothing else was ever needed.
                "no noise" => (&[], &[]),
                _ => {
                    let pair = ["duplicated", "negated", "scaled copy"].contains(&rows.name.as_str());
                    assert!(!pair || path.collinear.len() == 1, "{}: {:?}", rows.name, path.collinear);
                    assert!(rows.name != "three copies" || path.collinear.len() == 3, "{:?}", path.collinear);
                    assert!(rows.name != "sum of two" || path.collinear.len() == 1, "{:?}", path.collinear);
                    continue;
                }
            };
            assert_eq!((&path.collinear[..], &path.constant[..]), expected, "{}, {form:?}", rows.name);
        }
    }
    let wide = crate::common::random(20, 12, 30);
    let path = lars(&wide.problem(Form::Root), &Penalty::standardised(), &LarsOptions::default()).expect("a path");
    assert_eq!(path.status, PathStatus::Saturated);
    let last = path.knots.last().expect("a knot");
    assert!(last.support.len() == 11 && path.collinear.len() == 19 && 1.0 - last.r2 < 1e-20);
}

#[test]
fn exactly_explained_targets_end_with_the_truth() {
    let rows = degenerate().into_iter().find(|rows| rows.name == "no noise").expect("the problem");
    let path = lars(&rows.problem(Form::Root), &Penalty::standardised(), &LarsOptions::default()).expect("a path");
    let last = path.knots.last().expect("a knot");
    assert_eq!(last.support, [0, 4]);
    assert!((last.coefficient(0) - 2.0).abs() < 1e-12 && (last.coefficient(4) + 1.0).abs() < 1e-12);
    assert!((last.intercept - 1.0).abs() < 1e-10, "{}", last.intercept);
}

/// The square-root form keeps the digits of a QR where the Gram matrix has lost them.
#[test]
fn ill_conditioned_columns_end_at_least_squares() {
    let rows = crate::common::polynomials();
    let n = rows.n();
    let z = faer::Mat::from_fn(n, 8, |i, j| if j < 7 { rows.x[(i, j)] } else { rows.y[i] });
    let mut factor = fleetfoot_stats::Factor::new(7, 1);
    factor.push(z.as_ref(), None);
    let root = factor.square_root();
    let exact = fleetfoot_stats::least_squares(&root, &root.deviation());
    let end = |form: Form| {
        let path = lars(&rows.problem(form), &Penalty::standardised(), &LarsOptions::default()).expect("a path");
        path.knots.last().expect("a knot").dense(7)
    };
    let error = |coefficients: &[f64]| {
        let apart = |j: usize| (coefficients[j] - exact.coefficients[(j, 0)]).abs() / exact.coefficients[(j, 0)].abs();
        (0..7).map(apart).fold(0.0, f64::max)
    };
    let (root, gram) = (error(&end(Form::Root)), error(&end(Form::Gram)));
    assert!(exact.condition > 1e6 && root < 1e-8 && gram > 100.0 * root, "{root:e} {gram:e}");
}

/// If the Gram matrix has lost all digits, its path ends before the first wrong knot; the square-root form goes all the
/// way.
#[test]
fn ill_conditioned_paths_end_early() {
    let mut ended = 0;
    for seed in 0..4 {
        for spread in [1.0, 0.3, 0.1] {
            let rows = crate::common::features(seed, spread);
            for (what, penalty) in penalties(rows.p()) {
                check(&rows, Form::Root, what, &penalty, &LarsOptions::default());
                let problem = rows.problem(Form::Gram);
                let path = lars(&problem, &penalty, &LarsOptions::default()).expect("a path");
                assert!(path.knots.iter().all(|knot| knot.certificate.kkt <= 1e-8), "{}, {what}", rows.name);
                if path.status == PathStatus::Stalled {
                    let end = path.knots[path.knots.len() - 1].l1;
                    assert!(end > 0.0 && path.coefficients(0.5 * end).is_err());
                    ended += 1;
                }
            }
        }
    }
    assert!(ended > 0, "the features are meant to be too much for a Gram matrix");
}
