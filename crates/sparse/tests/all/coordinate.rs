//! Coordinate descent: certificates, and agreement with the path of LARS.

use faer::Mat;

use crate::common::{FORMS, Form, Rows, degenerate, ordinary, penalties, random};
use fleetfoot_sparse::{
    Penalty, Quadratic, Sign, Solution,
    coordinate::{CoordinateOptions, coordinate_descent, coordinate_descent_from, lambda_grid},
    lars::{LarsOptions, lars},
};

/// Difference of two sets of coefficients, in units of what moves the prediction by the target's deviation.
fn difference(rows: &Rows, a: &Solution, b: &Solution) -> f64 {
    let problem = rows.problem(Form::Root);
    let (deviation, tau) = (problem.deviation(), problem.target_deviation());
    (0..rows.p()).map(|j| (a.coefficient(j) - b.coefficient(j)).abs() * deviation[j] / tau).fold(0.0, f64::max)
}

fn check(rows: &Rows, form: Form, what: &str, penalty: &Penalty, l1_ratio: f64) {
    let problem = rows.problem(form);
    let who = format!("{}, {form:?}, {what}, l1_ratio = {l1_ratio}", rows.name);
    let options = CoordinateOptions { l1_ratio, ..CoordinateOptions::default() };
    let mut lambdas = lambda_grid(&problem, penalty, l1_ratio, 8, 1e-4).expect("a grid");
    // Not in order: a warm start from anywhere.
    lambdas.push(lambdas[3]);
    let solutions = coordinate_descent(&problem, penalty, &lambdas, &options).expect("solutions");
    for solution in &solutions {
        let certificate = solution.certificate;
        assert!(solution.converged, "{who}: lambda {:e}, kkt {:e}", solution.l1, certificate.kkt);
        assert!(certificate.kkt < 1e-8, "{who}: kkt {:e}, lambda {:e}", certificate.kkt, solution.l1);
        assert!(
            (0.0..rows.most_gap(form)).contains(&certificate.gap),
            "{who}: gap {:e}, lambda {:e}",
            certificate.gap,
            solution.l1
        );
        if problem.target_deviation() > 0.0 && problem.target_deviation() < 1e90 {
            let violation = rows.violation(penalty, solution);
            assert!(violation < 1e-8, "{who}: violation {violation:e}, kkt {:e}", certificate.kkt);
        }
        // The path for this ridge, at this lambda: the same objective, and the same coefficients where they are unique.
        let options = LarsOptions { l2: solution.l2, ..LarsOptions::default() };
        let other = lars(&problem, penalty, &options).expect("a path").at(&problem, solution.l1).expect("on the path");
        let (a, b) = (solution.certificate.objective, other.certificate.objective);
        assert!((a - b).abs() <= 1e-10 * problem.target_deviation().powi(2), "{who}: {a:e} and {b:e}");
        if rows.unique {
            let apart = difference(rows, solution, &other);
            assert!(apart < 1e-8, "{who}: lambda {:e}, {apart:e}", solution.l1);
        }
    }
    let (a, b) = (&solutions[3], &solutions[8]);
    assert!(!rows.unique || difference(rows, a, b) < 1e-9, "{who}: the start matters");
}

#[test]
fn ordinary_problems_agree_with_lars() {
    for rows in ordinary().iter().step_by(2) {
        for (what, penalty) in penalties(rows.p()) {
            for form in FORMS {
                check(rows, form, what, &penalty, 1.0);
                check(rows, form, what, &penalty, 0.6);
            }
        }
    }
}

#[test]
fn degenerate_problems_agree_with_lars() {
    for rows in degenerate() {
        for (what, penalty) in penalties(rows.p()) {
            for form in FORMS {
                check(&rows, form, what, &penalty, 1.0);
                check(&rows, form, what, &penalty, 0.9);
            }
        }
    }
}

#[test]
fn a_library_much_wider_than_the_data_is_solved() {
    let rows = random(2000, 90, 1200);
    let problem = rows.problem(Form::Root);
    let penalty = Penalty::standardised();
    let lambdas = lambda_grid(&problem, &penalty, 1.0, 12, 1e-2).expect("a grid");
    let solutions = coordinate_descent(&problem, &penalty, &lambdas, &CoordinateOptions::default()).expect("solutions");
    let path = lars(&problem, &penalty, &LarsOptions { lambda_min: lambdas[11], ..LarsOptions::default() });
    let path = path.expect("a path");
    for solution in &solutions {
        assert!(solution.converged && solution.certificate.kkt < 1e-11 && solution.certificate.gap < 1e-11);
        let other = path.coefficients(solution.l1).expect("on the path");
        let apart = (0..1200).map(|j| (solution.coefficient(j) - other[j]).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-9 * other.iter().fold(1.0, |scale: f64, value| scale.max(value.abs())), "{apart:e}");
    }
    assert!(solutions[0].support.is_empty() && solutions[11].support.len() > 20);
}

/// A target of noise alone, and lambdas far apart: between two of them hundreds of columns come, and dozens of signs turn.
#[test]
fn columns_that_enter_and_leave_are_solved() {
    for (n, p) in [(700, 400), (350, 500)] {
        let mut rows = random(2001, n, p);
        rows.y = random(2002, n, 1).y;
        for form in FORMS {
            let problem = rows.problem(form);
            let penalty = Penalty::standardised();
            let lambdas = lambda_grid(&problem, &penalty, 1.0, 5, 1e-2).expect("a grid");
            let solutions = coordinate_descent(&problem, &penalty, &lambdas, &CoordinateOptions::default());
            let solutions = solutions.expect("solutions");
            let options = LarsOptions { lambda_min: lambdas[4], ..LarsOptions::default() };
            let path = lars(&problem, &penalty, &options).expect("a path");
            for solution in &solutions {
                assert!(solution.converged && solution.certificate.kkt < 1e-9, "{:e}", solution.certificate.kkt);
                let other = path.coefficients(solution.l1).expect("on the path");
                let apart = (0..p).map(|j| (solution.coefficient(j) - other[j]).abs()).fold(0.0, f64::max);
                assert!(apart <= 1e-8 * other.iter().fold(0.0, |most: f64, value| most.max(value.abs())), "{apart:e}");
            }
            assert!(solutions[4].support.len() > 200, "{}", solutions[4].support.len());
        }
    }
}

/// Many more columns than rows, down to where as many are active as there are rows: exchanges that let in more than that go back, and the way is the same.
#[test]
fn active_sets_grow_up_to_the_number_of_rows() {
    let (n, p) = (150, 600);
    for seed in 2000..2006 {
        let problem = random(seed, n, p).problem(Form::Root);
        let penalty = Penalty::standardised();
        let lambdas = lambda_grid(&problem, &penalty, 1.0, 30, 1e-3).expect("a grid");
        let options = CoordinateOptions { max_epochs: 1000, ..CoordinateOptions::default() };
        let zeros = vec![0.0; p];
        let solutions = coordinate_descent_from(&problem, &penalty, &lambdas, &options, &zeros).expect("solutions");
        let active = solutions.last().map_or(0, |point| point.solution.coefficients.len());
        assert!(active > n - 10, "{active}");
        for point in &solutions {
            let (solution, epochs) = (&point.solution, point.epochs);
            let active = solution.support.len();
            assert!(solution.converged && solution.certificate.kkt < 1e-9, "{seed}: {active} after {epochs}");
            assert!(epochs < 60, "{seed}: {active} after {epochs}");
        }
    }
}

#[test]
fn not_converging_is_a_status() {
    let rows = crate::common::polynomials();
    let problem = rows.problem(Form::Root);
    let penalty = Penalty::standardised();
    let lambda = 1e-5 * problem.target_deviation();
    let options = CoordinateOptions { max_epochs: 1, ..CoordinateOptions::default() };
    let stopped = coordinate_descent(&problem, &penalty, &[lambda], &options).expect("a solution").remove(0);
    assert!(!stopped.converged && stopped.certificate.kkt > 1e-6, "{:?}", stopped.certificate);
    let solutions = coordinate_descent(&problem, &penalty, &[lambda], &CoordinateOptions::default());
    let point = solutions.expect("a solution").remove(0);
    assert!(point.converged && point.certificate.objective < stopped.certificate.objective);
}

#[test]
fn a_start_costs_or_saves_sweeps_and_leaves_the_solution() {
    let rows = random(5, 60, 20);
    let options = CoordinateOptions { l1_ratio: 0.9, ..CoordinateOptions::default() };
    for form in FORMS {
        let problem = rows.problem(form);
        for sign in [Sign::Free, Sign::NonNegative] {
            let penalty = Penalty { signs: vec![sign; 20], ..Penalty::default() };
            let lambda = 0.05 * problem.target_deviation();
            let from = |start: &[f64]| {
                let solutions = coordinate_descent_from(&problem, &penalty, &[lambda], &options, start);
                solutions.expect("a solution").remove(0)
            };
            let cold = from(&[0.0; 20]);
            let plain = coordinate_descent(&problem, &penalty, &[lambda], &options).expect("a solution").remove(0);
            assert_eq!(cold.solution, plain);
            assert!(cold.epochs > 0 && !plain.support.is_empty());
            let again = from(&plain.dense(20));
            assert_eq!(again.epochs, 0);
            let far: Vec<f64> = (0..20).map(|j| if j % 2 == 0 { 1e3 } else { -1e3 }).collect();
            let far = from(&far);
            assert!(far.solution.converged && far.epochs > 0);
            for other in [&again.solution, &far.solution] {
                assert_eq!(other.support, plain.support);
                assert!(difference(&rows, other, &plain) < 1e-9);
            }
        }
        let wrong = coordinate_descent_from(&problem, &Penalty::default(), &[1.0], &options, &[0.0; 3]);
        assert!(wrong.is_err());
        let wrong = coordinate_descent_from(&problem, &Penalty::default(), &[1.0], &options, &[f64::NAN; 20]);
        assert!(wrong.is_err());
    }
}

#[test]
fn tiny_penalty_on_dependent_columns_counts() {
    // x0 = x1 = -x2 = -x3 and y = x0: at the minimum the coefficients along x0 sum to (nearly) 1 and none pulls against another.
    let rows = Mat::from_fn(2, 4, |i, j| if (i == 0) == (j < 2) { -1.0 } else { 1.0 });
    let problem = Quadratic::from_rows(rows.as_ref(), &[-1.0, 1.0], None, false).expect("a problem");
    let (lambda, far) = (1e-10, [1.0, 1.0, 1.0, 1000.0]);
    let options = CoordinateOptions { max_epochs: 1, ..CoordinateOptions::default() };
    let solve = |options: &CoordinateOptions, start: &[f64]| {
        let solutions = coordinate_descent_from(&problem, &Penalty::default(), &[lambda], options, start);
        solutions.expect("a solution").remove(0).solution
    };
    let excess = |solution: &Solution| {
        let objective = |w: &[f64]| {
            let along = w[0] + w[1] - w[2] - w[3];
            0.5 * (1.0 - along).powi(2) + lambda * w.iter().map(|w| w.abs()).sum::<f64>()
        };
        objective(&solution.dense(4)) - objective(&[1.0 - lambda, 0.0, 0.0, 0.0])
    };
    // The gap, in units of half the target's mean square 1, bounds what is left to gain.
    let stopped = solve(&options, &far);
    assert!(!stopped.converged && excess(&stopped) > 1e-8);
    assert!(0.5 * stopped.certificate.gap >= 0.999 * excess(&stopped), "{:?}", stopped.certificate);
    let points = solve(&CoordinateOptions::default(), &[0.0; 4]);
    assert!(points.converged && excess(&points) < 1e-15, "{:e} {:?}", excess(&points), points.certificate);
}

#[test]
fn grid_starts_at_the_first_column() {
    let rows = random(3, 40, 6);
    for (what, penalty) in penalties(6) {
        for form in FORMS {
            let problem = rows.problem(form);
            let lambdas = lambda_grid(&problem, &penalty, 0.5, 3, 0.25).expect("a grid");
            assert!((lambdas[1] / lambdas[0] - 0.5).abs() < 1e-14 && (lambdas[2] / lambdas[0] - 0.25).abs() < 1e-14);
            let path = lars(&problem, &penalty, &LarsOptions::default()).expect("a path");
            assert!((0.5 * lambdas[0] / path.knots[0].l1 - 1.0).abs() < 1e-12, "{what}");
        }
    }
}

#[test]
fn path_to_zero_ends_like_lars() {
    // More columns than rows: without a penalty there are many solutions, and one that the path goes to.
    for (seed, n, p) in [(2010, 40, 60), (2011, 70, 100)] {
        let problem = random(seed, n, p).problem(Form::Root);
        let penalty = Penalty::standardised();
        let path = lars(&problem, &penalty, &LarsOptions::default()).expect("a path");
        let mut lambdas: Vec<f64> = path.knots.iter().map(|knot| knot.l1).filter(|&l1| l1 > 0.0).collect();
        lambdas.push(0.0);
        let solutions =
            coordinate_descent(&problem, &penalty, &lambdas, &CoordinateOptions::default()).expect("solutions");
        let (end, other) = (solutions.last().expect("the end"), path.at(&problem, 0.0).expect("on the path"));
        assert!(end.converged && end.support.len() < n, "{} {:?}", end.support.len(), end.certificate);
        for j in 0..p {
            let (a, b) = (end.coefficient(j), other.coefficient(j));
            assert!((a - b).abs() < 1e-6, "{seed}: coefficient {j} is {a:e}, and {b:e} on the path");
        }
    }
}
