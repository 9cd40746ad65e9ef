//! Group and sparse-group lasso: certificates, closed forms, the lasso and ridge as limits, a cone program as oracle, laws, and paths.

use crate::common::{FORMS, Form, Rows, degenerate, integers, ordinary, penalties, random};
use clarabel::{
    algebra::CscMatrix,
    solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT},
};
use faer::Mat;
use fleetfoot_sparse::{
    Path, PathStatus, Penalty, Quadratic, Sign, Solution, SparseError,
    coordinate::{CoordinateOptions, coordinate_descent, lambda_max},
    estimator::{Estimator, Stop},
    group::{GroupLasso, Groups},
    select::{CriteriaOptions, information_criteria},
};
use proptest::prelude::*;

const RATIOS: [f64; 4] = [0.0, 0.3, 0.95, 1.0];

/// Groups of three that are not neighbours, the last one smaller.
fn groups(p: usize) -> Groups {
    let count = p.div_ceil(3);
    Groups::new((0..p).map(|j| j % count).collect())
}

fn lasso(p: usize, l1_ratio: f64) -> GroupLasso {
    GroupLasso { l1_ratio, ..GroupLasso::new(groups(p)) }
}

fn largest(problem: &Quadratic, penalty: &Penalty, lasso: &GroupLasso) -> f64 {
    Estimator::from(lasso.clone()).lambda_max(problem, penalty).expect("a lambda")
}

fn solved(problem: &Quadratic, penalty: &Penalty, lasso: &GroupLasso, lambdas: &[f64]) -> Vec<Solution> {
    Estimator::from(lasso.clone()).solutions(problem, penalty, lambdas).expect("solutions")
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    let scale = a.iter().chain(b).fold(1e-300_f64, |scale, value| scale.max(value.abs()));
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / scale
}

fn length(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

/// Weights of the groups by their definition: the root of the number of penalised columns.
fn weights(groups: &Groups, penalty: &Penalty) -> Vec<f64> {
    let factor = |j: usize| penalty.factors.get(j).copied().unwrap_or(1.0);
    let counts = |j: &usize| factor(*j) > 0.0 && factor(*j).is_finite();
    let size = |g: usize| (0..groups.of.len()).filter(|&j| groups.of[j] == g).filter(counts).count() as f64;
    (0..groups.len()).map(|g| size(g).sqrt()).collect()
}

/// The largest violation of the optimality conditions as a correlation, from the rows and the definition.
fn violation(rows: &Rows, penalty: &Penalty, lasso: &GroupLasso, solution: &Solution) -> f64 {
    let (n, p) = (rows.n() as f64, rows.p());
    let (gradient, _) = rows.gradient(solution);
    let deviation = |value: &dyn Fn(usize) -> f64| {
        let mean = (0..rows.n()).map(value).sum::<f64>() / n;
        ((0..rows.n()).map(|i| (value(i) - mean).powi(2)).sum::<f64>() / n).sqrt()
    };
    let tau = deviation(&|i| rows.y[i]);
    let size: Vec<f64> = (0..p).map(|j| deviation(&|i| rows.x[(i, j)])).collect();
    let factor = |j: usize| penalty.factors.get(j).copied().unwrap_or(1.0);
    let unit = |j: usize| factor(j) * if penalty.standardise { size[j] } else { 1.0 };
    let sign = |j: usize| penalty.signs.get(j).copied().unwrap_or_default();
    let largest = |j: usize| (0..rows.n()).map(|i| rows.x[(i, j)].abs()).fold(0.0, f64::max);
    let varies = |j: usize| size[j] > 1e-13 * largest(j);
    let weights = weights(&lasso.groups, penalty);
    let lambda = solution.l1;
    let mut worst = 0.0_f64;
    for (g, weight) in weights.iter().enumerate() {
        let members = (0..p).filter(|&j| lasso.groups.of[j] == g && factor(j).is_finite() && varies(j));
        let members: Vec<usize> = members.collect();
        let v: Vec<f64> = members.iter().map(|&j| unit(j) * solution.coefficient(j)).collect();
        let (l1, limit) = (lambda * lasso.l1_ratio, lambda * (1.0 - lasso.l1_ratio) * weight);
        let push = |j: usize| match sign(j) {
            Sign::Free => gradient[j].abs(),
            Sign::NonNegative => gradient[j].max(0.0),
            Sign::NonPositive => (-gradient[j]).max(0.0),
        };
        let beyond = |&j: &usize| (push(j) / unit(j) - l1).max(0.0);
        let penalised: Vec<usize> = members.iter().copied().filter(|&j| unit(j) > 0.0).collect();
        let reach = length(&penalised.iter().map(beyond).collect::<Vec<f64>>());
        let mut square = 0.0;
        for (at, &j) in members.iter().enumerate() {
            let value = solution.coefficient(j);
            assert!(sign(j).allows(value), "{}: column {j} has {value}", rows.name);
            let left = if unit(j) == 0.0 {
                if value == 0.0 { push(j) } else { gradient[j].abs() }
            } else if length(&v) == 0.0 {
                if reach > limit { unit(j) * beyond(&j) * (1.0 - limit / reach) } else { 0.0 }
            } else if value == 0.0 {
                unit(j) * beyond(&j)
            } else {
                (gradient[j] - unit(j) * (l1 * value.signum() + limit * v[at] / length(&v))).abs()
            };
            square += (left / (size[j] * tau)).powi(2);
        }
        worst = worst.max(square.sqrt());
    }
    worst
}

/// Solves at some shares of the largest lambda, and certifies.
fn check(rows: &Rows, form: Form, what: &str, penalty: &Penalty, lasso: &GroupLasso) -> usize {
    let problem = rows.problem(form);
    let top = largest(&problem, penalty, lasso);
    let lambdas: Vec<f64> = [1.0 + 1e-9, 0.7, 0.2, 0.03, 1e-3].iter().map(|share| share * top).collect();
    let solutions = solved(&problem, penalty, lasso, &lambdas);
    for (solution, lambda) in solutions.iter().zip(&lambdas) {
        let certificate = solution.certificate;
        let place = format!("{}, {what}, {form:?}, l1_ratio {}, lambda {lambda:e}", rows.name, lasso.l1_ratio);
        assert!(solution.converged, "{place}: {certificate:?}");
        assert!(certificate.kkt < 1e-8 && certificate.gap < rows.most_gap(form), "{place}: {certificate:?}");
        if problem.target_deviation() > 0.0 && form == Form::Root {
            let violation = violation(rows, penalty, lasso, solution);
            assert!(violation < 1e-7, "{place}: {violation:e}");
        }
    }
    let penalised = |j: &usize| penalty.factors.get(*j).is_none_or(|factor| *factor > 0.0);
    assert_eq!(
        solutions[0].support.iter().filter(|j| penalised(j)).count(),
        0,
        "{} {what}: above the largest",
        rows.name
    );
    solutions.len()
}

#[test]
fn solutions_of_every_penalty_are_certified() {
    let mut solutions = 0;
    for rows in ordinary().iter().step_by(3) {
        for (what, penalty) in penalties(rows.p()) {
            for form in FORMS {
                for l1_ratio in RATIOS {
                    solutions += check(rows, form, what, &penalty, &lasso(rows.p(), l1_ratio));
                }
            }
        }
    }
    assert_eq!(solutions, 14 * 6 * 2 * 4 * 5);
}

#[test]
fn degenerate_problems_are_certified() {
    let mut solutions = 0;
    for rows in degenerate().iter().filter(|rows| rows.n() > 2) {
        for l1_ratio in [0.0, 0.4] {
            for form in FORMS {
                solutions += check(rows, form, "standardised", &Penalty::standardised(), &lasso(rows.p(), l1_ratio));
            }
        }
    }
    assert!(solutions > 800, "{solutions}");
}

#[test]
fn largest_lambda_admits_the_first_group() {
    for rows in ordinary().iter().step_by(4) {
        for l1_ratio in RATIOS {
            let (problem, penalty, lasso) =
                (rows.problem(Form::Root), Penalty::standardised(), lasso(rows.p(), l1_ratio));
            let top = largest(&problem, &penalty, &lasso);
            let solutions = solved(&problem, &penalty, &lasso, &[top * (1.0 + 1e-9), top * (1.0 - 1e-6)]);
            assert!(solutions[0].support.is_empty() && !solutions[1].support.is_empty(), "{} {l1_ratio}", rows.name);
        }
    }
}

#[test]
fn groups_of_one_are_the_lasso() {
    let mut compared = 0;
    for rows in ordinary().iter().step_by(3) {
        for (what, penalty) in penalties(rows.p()) {
            let problem = rows.problem(Form::Root);
            let top = lambda_max(&problem, &penalty, 1.0).expect("a lambda");
            let lambdas = [0.5 * top, 0.1 * top, 0.01 * top];
            let options = CoordinateOptions::default();
            let expected = coordinate_descent(&problem, &penalty, &lambdas, &options).expect("solutions");
            let p = rows.p();
            let ones = |l1_ratio: f64| GroupLasso { l1_ratio, ..GroupLasso::new(Groups::new((0..p).collect())) };
            for lasso in [ones(0.0), ones(0.4), lasso(p, 1.0)] {
                assert!((largest(&problem, &penalty, &lasso) - top).abs() <= 1e-12 * top, "{} {what}", rows.name);
                for (solution, expected) in solved(&problem, &penalty, &lasso, &lambdas).iter().zip(&expected) {
                    let apart = apart(&solution.dense(p), &expected.dense(p));
                    assert!(apart < 1e-10, "{}, {what}: {apart:e}", rows.name);
                    assert!(
                        (solution.certificate.objective - expected.certificate.objective).abs()
                            < 1e-11 * expected.mse.max(solution.certificate.objective)
                    );
                    compared += 1;
                }
            }
        }
    }
    assert_eq!(compared, 14 * 6 * 3 * 3);
}

#[test]
fn one_group_is_a_ridge() {
    for rows in ordinary().iter().step_by(5).chain(&[random(20, 12, 30)]) {
        let (p, penalty) = (rows.p(), Penalty::standardised());
        let problem = rows.problem(Form::Root);
        let deviation = problem.deviation();
        let lasso = GroupLasso::new(Groups::new(vec![0; p]));
        let top = largest(&problem, &penalty, &lasso);
        for share in [0.9, 0.3, 0.01] {
            let dense = solved(&problem, &penalty, &lasso, &[share * top]).remove(0).dense(p);
            let v: Vec<f64> = dense.iter().zip(&deviation).map(|(b, deviation)| b * deviation).collect();
            let l2 = share * top * (p as f64).sqrt() / length(&v);
            let options = CoordinateOptions { l1_ratio: 0.0, ..CoordinateOptions::default() };
            let ridge = coordinate_descent(&problem, &penalty, &[l2], &options).expect("a ridge").remove(0);
            let apart = apart(&dense, &ridge.dense(p));
            assert!(apart < 1e-8, "{} {share}: {apart:e}", rows.name);
        }
    }
}

#[test]
fn orthogonal_groups_shrink_in_closed_form() {
    let sign = |i: usize, j: usize| if (i & j).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 };
    let truth = [3.0, -1.0, 0.5, 0.2, 2.0, 0.0];
    let x = Mat::from_fn(8, 6, |i, j| sign(i, j + 1));
    let y: Vec<f64> = (0..8).map(|i| (0..6).map(|j| truth[j] * sign(i, j + 1)).sum()).collect();
    let problem = Quadratic::from_rows(x.as_ref(), &y, None, true).expect("rows");
    let (of, lambda) = (vec![0, 0, 1, 1, 2, 2], 0.6);
    for l1_ratio in [0.0, 0.25, 0.5] {
        let lasso = GroupLasso { l1_ratio, ..GroupLasso::new(Groups { of: of.clone(), weights: vec![1.0, 0.8, 2.0] }) };
        let solution = solved(&problem, &Penalty::default(), &lasso, &[lambda]).remove(0);
        for (g, weight) in [1.0, 0.8, 2.0].into_iter().enumerate() {
            let soft = |value: f64| (value.abs() - lambda * l1_ratio).max(0.0).copysign(value);
            let s = [soft(truth[2 * g]), soft(truth[2 * g + 1])];
            let share = (1.0 - lambda * (1.0 - l1_ratio) * weight / length(&s)).max(0.0);
            for k in 0..2 {
                let apart = solution.coefficient(2 * g + k) - share * s[k];
                assert!(apart.abs() < 1e-13, "{l1_ratio} {g} {k}: {apart:e}");
            }
        }
    }
}

/// The minimiser by an interior-point solver: coefficients of unit deviation, `min 1/2 d'Gd - c'd + l1 sum e + sum w t`, `|d_j| <= e_j`, `|d_g| <= t_g`.
fn cone_program(rows: &Rows, lasso: &GroupLasso, lambda: f64) -> (Vec<f64>, f64) {
    let (n, p) = (rows.n(), rows.p());
    let unit = |value: &dyn Fn(usize) -> f64| {
        let mean = (0..n).map(value).sum::<f64>() / n as f64;
        let deviation = ((0..n).map(|i| (value(i) - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
        ((0..n).map(|i| (value(i) - mean) / deviation).collect::<Vec<f64>>(), deviation)
    };
    let columns: Vec<Vec<f64>> = (0..p).map(|j| unit(&|i| rows.x[(i, j)]).0).collect();
    let (y, tau) = unit(&|i| rows.y[i]);
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / n as f64;
    let groups = lasso.groups.len();
    let weights = weights(&lasso.groups, &Penalty::default());
    let size = 2 * p + groups;
    let (mut starts, mut indices, mut values) = (vec![0], Vec::new(), Vec::new());
    for b in 0..size {
        for a in 0..=b.min(p) {
            if a < p && b < p {
                indices.push(a);
                values.push(product(&columns[a], &columns[b]));
            }
        }
        starts.push(indices.len());
    }
    let quadratic = CscMatrix::new(size, size, starts, indices, values);
    let mut linear: Vec<f64> = columns.iter().map(|column| -product(column, &y)).collect();
    linear.extend(vec![lambda / tau * lasso.l1_ratio; p]);
    linear.extend(weights.iter().map(|weight| lambda / tau * (1.0 - lasso.l1_ratio) * weight));
    // Rows of `A x + s = 0`: s = e - d, e + d, then (t_g, d_g) for every group.
    let mut triplets: Vec<(usize, usize, f64)> = Vec::new();
    for j in 0..p {
        triplets.extend([(j, j, 1.0), (j, p + j, -1.0), (p + j, j, -1.0), (p + j, p + j, -1.0)]);
    }
    let mut cones = vec![SupportedConeT::NonnegativeConeT(2 * p)];
    let mut row = 2 * p;
    for g in 0..groups {
        let members: Vec<usize> = (0..p).filter(|&j| lasso.groups.of[j] == g).collect();
        triplets.push((row, 2 * p + g, -1.0));
        members.iter().enumerate().for_each(|(at, &j)| triplets.push((row + 1 + at, j, -1.0)));
        cones.push(SupportedConeT::SecondOrderConeT(members.len() + 1));
        row += members.len() + 1;
    }
    let (mut i, mut j, mut v) = (Vec::new(), Vec::new(), Vec::new());
    triplets.iter().for_each(|&(a, b, value)| {
        i.push(a);
        j.push(b);
        v.push(value);
    });
    let constraints = CscMatrix::new_from_triplets(row, size, i, j, v);
    let solution = [1e-13, 1e-12, 1e-11, 1e-10, 1e-9].into_iter().find_map(|tolerance| {
        let settings = DefaultSettings {
            verbose: false,
            tol_gap_abs: tolerance,
            tol_gap_rel: tolerance,
            tol_feas: tolerance,
            max_iter: 500,
            ..DefaultSettings::default()
        };
        let mut solver = DefaultSolver::new(&quadratic, &linear, &constraints, &vec![0.0; row], &cones, settings)
            .expect("a program");
        solver.solve();
        (solver.solution.status == SolverStatus::Solved).then_some(solver.solution)
    });
    let solution = solution.unwrap_or_else(|| panic!("{}: not solved", rows.name));
    (solution.x[..p].to_vec(), solution.obj_val + 0.5)
}

#[test]
fn the_cone_program_has_the_same_minimiser() {
    let mut compared = 0;
    for rows in ordinary().iter().step_by(5) {
        let (problem, penalty) = (rows.problem(Form::Root), Penalty::standardised());
        let (tau, deviation) = (problem.target_deviation(), problem.deviation());
        for l1_ratio in [0.0, 0.3, 0.9] {
            let lasso = lasso(rows.p(), l1_ratio);
            let top = largest(&problem, &penalty, &lasso);
            for share in [0.5, 0.1, 0.01] {
                let solution = solved(&problem, &penalty, &lasso, &[share * top]).remove(0);
                let (theirs, objective) = cone_program(rows, &lasso, share * top);
                let above = solution.certificate.objective / tau / tau - objective;
                assert!(above.abs() < 1e-8, "{} {l1_ratio} {share}: objectives {above:e} apart", rows.name);
                let apart = |j: usize| (solution.coefficient(j) * deviation[j] / tau - theirs[j]).abs();
                let apart = (0..rows.p()).map(apart).fold(0.0, f64::max);
                assert!(apart < 1e-5, "{} {l1_ratio} {share}: coefficients {apart:e} apart", rows.name);
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 8 * 9);
}

#[test]
fn certificate_bounds_distance_to_minimum() {
    for seed in 0..12 {
        let rows = random(seed, 40, 9);
        for l1_ratio in [0.0, 0.5] {
            let (problem, penalty, lasso) = (rows.problem(Form::Root), Penalty::standardised(), lasso(9, l1_ratio));
            let lambda = 0.2 * largest(&problem, &penalty, &lasso);
            let best = solved(&problem, &penalty, &lasso, &[lambda]).remove(0);
            let half = 0.5 * problem.target_deviation().powi(2);
            for step in [0.0, 1e-4, 0.1, -0.5] {
                let other: Vec<f64> = best.dense(9).iter().map(|b| b * (1.0 + step)).collect();
                let certificate = lasso.certificate(&problem, &penalty, lambda, &other).expect("a certificate");
                let above = (certificate.objective - best.certificate.objective) / half;
                assert!(
                    above >= -1e-12 && above <= certificate.gap + 1e-12,
                    "{seed} {l1_ratio} {step}: {above:e} {certificate:?}"
                );
                assert_eq!(certificate.kkt < 1e-8, step == 0.0);
            }
        }
    }
}

#[test]
fn starts_and_orders_of_lambda_lead_to_the_same_minimiser() {
    let rows = random(7, 60, 12);
    let (problem, penalty) = (rows.problem(Form::Root), Penalty::standardised());
    for l1_ratio in [0.0, 0.5] {
        let lasso = lasso(12, l1_ratio);
        let top = largest(&problem, &penalty, &lasso);
        let down = solved(&problem, &penalty, &lasso, &[0.5 * top, 0.1 * top, 0.02 * top]);
        let up = solved(&problem, &penalty, &lasso, &[0.02 * top, 0.1 * top, 0.5 * top]);
        for (a, b) in down.iter().zip(up.iter().rev()) {
            assert!(apart(&a.dense(12), &b.dense(12)) < 1e-10);
        }
        let start = vec![100.0; 12];
        let estimator = Estimator::from(lasso.clone());
        let from = estimator.descend(&problem, &penalty, &[0.1 * top], Some(&start)).expect("a solution").remove(0);
        assert!(apart(&from.solution.dense(12), &down[1].dense(12)) < 1e-10);
        let again = estimator.descend(&problem, &penalty, &[0.1 * top], Some(&down[1].dense(12))).expect("a solution");
        assert_eq!(again[0].epochs, 0);
    }
}

#[test]
fn degrees_of_freedom_are_the_divergence_of_the_fit() {
    let rows = random(3, 30, 9);
    let penalty = Penalty::default();
    for l1_ratio in [0.0, 0.4] {
        let lasso = lasso(9, l1_ratio);
        let estimator = Estimator::from(lasso.clone());
        let fitted = |y: &[f64], lambda: f64| {
            let problem = Quadratic::from_rows(rows.x.as_ref(), y, None, true).expect("rows");
            let solution = solved(&problem, &penalty, &lasso, &[lambda]).remove(0);
            let value =
                |i: usize| solution.intercept + (0..9).map(|j| rows.x[(i, j)] * solution.coefficient(j)).sum::<f64>();
            ((0..30).map(value).collect::<Vec<f64>>(), problem, solution)
        };
        let top = largest(&rows.problem(Form::Root), &penalty, &lasso);
        for share in [0.5, 0.05] {
            let lambda = share * top;
            let (_, problem, fitted_solution) = fitted(&rows.y, lambda);
            let df = estimator.degrees_of_freedom(&problem, &penalty, &fitted_solution).expect("degrees");
            let step = 1e-5;
            let slope = |i: usize| {
                let moved = |by: f64| {
                    let mut y = rows.y.clone();
                    y[i] += by;
                    fitted(&y, lambda).0[i]
                };
                (moved(step) - moved(-step)) / (2.0 * step)
            };
            let divergence: f64 = (0..30).map(slope).sum::<f64>() - 1.0;
            assert!((df - divergence).abs() < 1e-4 * df.max(1.0), "{l1_ratio} {share}: {df} {divergence}");
            assert!(df < fitted_solution.support.len() as f64);
        }
    }
}

#[test]
fn the_lasso_of_many_tasks_is_a_group_a_column() {
    for (seed, intercept) in [(0, true), (1, false), (4, true)] {
        let (n, p, q) = (40, 7, 3);
        let rows = random(seed, n, p);
        let targets: Vec<Vec<f64>> = (0..q)
            .map(|t| {
                (0..n).map(|i| rows.x[(i, t)] - 0.5 * rows.x[(i, 5)] * t as f64 + rows.y[(i + 7 * t) % n]).collect()
            })
            .collect();
        let problem = |y: &Vec<f64>| Quadratic::from_rows(rows.x.as_ref(), y, None, intercept).expect("rows");
        let problems: Vec<Quadratic> = targets.iter().map(problem).collect();
        let stacked = Quadratic::stacked(&problems).expect("one problem");
        let of: Vec<usize> = (0..p * q).map(|k| k % p).collect();
        let lasso = GroupLasso::new(Groups { of, weights: vec![1.0; p] });
        let penalty = Penalty::default();
        let top = largest(&stacked, &penalty, &lasso);
        for share in [0.6, 0.1] {
            let solution = solved(&stacked, &penalty, &lasso, &[share * top]).remove(0);
            assert!(solution.certificate.gap < 1e-10 && solution.certificate.kkt < 1e-9);
            let b = solution.dense(p * q);
            // X'R / n, from the rows.
            let mean = |j: usize| if intercept { (0..n).map(|i| rows.x[(i, j)]).sum::<f64>() / n as f64 } else { 0.0 };
            let means: Vec<f64> = (0..p).map(mean).collect();
            let mut gradient = vec![vec![0.0; q]; p];
            for (t, target) in targets.iter().enumerate() {
                let part = &b[t * p..(t + 1) * p];
                let constant = problems[t].intercept_of(part);
                for i in 0..n {
                    let left = target[i] - constant - (0..p).map(|j| rows.x[(i, j)] * part[j]).sum::<f64>();
                    (0..p).for_each(|j| gradient[j][t] += (rows.x[(i, j)] - means[j]) * left / n as f64);
                }
            }
            for j in 0..p {
                let row: Vec<f64> = (0..q).map(|t| b[t * p + j]).collect();
                assert!(row.iter().all(|value| *value != 0.0) || row.iter().all(|value| *value == 0.0));
                let size = length(&row);
                for (value, gradient) in row.iter().zip(&gradient[j]).filter(|_| size > 0.0) {
                    assert!((gradient - share * top * value / size).abs() < 1e-8 * top);
                }
                assert!(length(&gradient[j]) <= share * top * (1.0 + 1e-8));
            }
        }
    }
    let [a, b] = [random(0, 20, 3), random(1, 21, 3)].map(|rows| rows.problem(Form::Root));
    assert_eq!(Quadratic::stacked(&[a, b]), Err(SparseError::OtherRows { actual: 21.0, expected: 20.0 }));
    assert_eq!(Quadratic::stacked(&[]), Err(SparseError::NoRows));
}

#[test]
fn targets_in_gram_form_are_stacked_alike() {
    let (a, b) = (random(5, 30, 4), random(6, 30, 4));
    let other = Rows { y: b.y.clone(), ..a.clone() };
    let lasso = GroupLasso::new(Groups::new((0..8).map(|k| k % 4).collect()));
    let find = |form: Form| {
        let stacked = Quadratic::stacked(&[a.problem(form), other.problem(form)]).expect("one problem");
        let lambda = 0.1 * largest(&stacked, &Penalty::standardised(), &lasso);
        solved(&stacked, &Penalty::standardised(), &lasso, &[lambda]).remove(0).dense(8)
    };
    assert!(apart(&find(Form::Root), &find(Form::Gram)) < 1e-9);
}

#[test]
fn a_path_of_groups_is_chosen_from_like_any_other() {
    let rows = random(9, 90, 12);
    let problem = rows.problem(Form::Root);
    let penalty = Penalty::standardised();
    let estimator = Estimator::from(lasso(12, 0.2));
    let path = estimator.path(&problem, &penalty, &Stop::default()).expect("a path");
    assert_eq!((path.status, path.knots.len()), (PathStatus::LambdaMin, 100));
    assert!(path.knots.windows(2).all(|pair| pair[0].l1 > pair[1].l1));
    let criteria = information_criteria(&problem, &penalty, &path, &CriteriaOptions::default()).expect("criteria");
    // Of the first knot, at most one direction of the group that enters there.
    assert!(criteria.degrees_of_freedom[0] < 2.5);
    for (knot, df) in path.knots.iter().zip(&criteria.degrees_of_freedom) {
        assert!(*df >= 1.0 && *df <= 1.0 + knot.support.len() as f64 + 1e-9, "{df} of {}", knot.support.len());
    }
    let lambda = criteria.lambdas[criteria.best[1]];
    let knot = path.coefficients(lambda).expect("a knot");
    assert_eq!(knot, path.knots[criteria.best[1]].dense(12));
    let between = 0.5 * (path.knots[3].l1 + path.knots[4].l1);
    assert_eq!(path.coefficients(between), Err(SparseError::BetweenKnots { lambda: between }));
    assert!(path.at(&problem, between).expect("a solution").certificate.kkt < 1e-9);
    let stop = Stop { lambda: 0.0, max_features: Some(6) };
    let stopped: Path = estimator.path(&problem, &penalty, &stop).expect("a path");
    assert_eq!(stopped.status, PathStatus::MaxFeatures);
    assert!(stopped.knots.iter().all(|knot| knot.support.len() <= 6));
    let (solution, short) = estimator.at(&problem, &penalty, lambda).expect("a solution");
    assert!(apart(&solution.dense(12), &knot) < 1e-9 && short.knots.len() == 1);
}

/// With fewer rows than columns the first supports hold columns that depend on each other: along some directions only the penalty changes.
#[test]
fn supports_beyond_rank_end_at_zeros() {
    let mut solutions = 0;
    for seed in (0..150).chain([8747]) {
        for rows in [random(seed, 4, 6), integers(seed, 5, 9)] {
            for ratio in RATIOS {
                let lasso = lasso(rows.p(), ratio);
                solutions += check(&rows, Form::Root, "standardised", &Penalty::standardised(), &lasso);
            }
        }
    }
    assert_eq!(solutions, 151 * 2 * RATIOS.len() * 5);
}

#[test]
fn options_out_of_range_are_refused() {
    let rows = random(1, 20, 4);
    let problem = rows.problem(Form::Root);
    let run = |lasso: GroupLasso| {
        Estimator::from(lasso).solutions(&problem, &Penalty::default(), &[1.0]).map(|solution| solution.len())
    };
    let plain = GroupLasso::new(Groups::new(vec![0, 0, 1, 1]));
    let what = "the list of the columns' groups";
    let short = GroupLasso::new(Groups::new(vec![0, 0, 1]));
    assert_eq!(run(short), Err(SparseError::Length { what, actual: 3, expected: 4 }));
    let far = GroupLasso::new(Groups::new(vec![0, 0, 1, 9]));
    assert_eq!(run(far), Err(SparseError::GroupNumber { column: 3, group: 9, columns: 4 }));
    let weights =
        |weights: Vec<f64>| GroupLasso { groups: Groups { weights, ..plain.groups.clone() }, ..plain.clone() };
    assert_eq!(run(weights(vec![1.0, -1.0])), Err(SparseError::GroupWeight { group: 1, value: -1.0 }));
    let what = "the list of the groups' weights";
    assert_eq!(run(weights(vec![1.0])), Err(SparseError::Length { what, actual: 1, expected: 2 }));
    assert_eq!(run(GroupLasso { l1_ratio: 1.5, ..plain.clone() }), Err(SparseError::L1Ratio { value: 1.5 }));
    assert_eq!(run(GroupLasso { tolerance: 0.0, ..plain.clone() }), Err(SparseError::Tolerance { value: 0.0 }));
    // A group without weight is least squares on its columns.
    let free = run(weights(vec![0.0, 1.0]));
    assert_eq!(free, Ok(1));
}

fn shape() -> impl Strategy<Value = (u64, usize, usize, usize)> {
    (0_u64..10_000, 4_usize..40, 1_usize..12, 0_usize..4)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn random_problems_are_certified((seed, n, p, ratio) in shape(), kind in 0_usize..6, few in any::<bool>()) {
        let rows = if few { integers(seed, n, p) } else { random(seed, n, p) };
        let (what, penalty) = penalties(p).swap_remove(kind);
        for form in FORMS {
            check(&rows, form, what, &penalty, &lasso(p, RATIOS[ratio]));
        }
    }

    #[test]
    fn units_and_order_do_not_matter((seed, n, p, ratio) in shape(), exponent in -30_i32..30, turn in 0_usize..12) {
        let rows = random(seed, n + p, p);
        let factor = |j: usize| if j.is_multiple_of(2) { 10.0_f64.powi(exponent) } else { -0.5 };
        let to = |j: usize| (j + turn) % p;
        let x = Mat::from_fn(n + p, p, |i, j| factor(to(j)) * rows.x[(i, to(j))]);
        let y: Vec<f64> = rows.y.iter().map(|y| -1e20 * y).collect();
        let other = Rows { x, y, ..rows.clone() };
        let penalty = Penalty::standardised();
        let one = lasso(p, RATIOS[ratio]);
        let turned = Groups::new((0..p).map(|j| one.groups.of[to(j)]).collect());
        let two = GroupLasso { groups: turned, ..one.clone() };
        for form in FORMS {
            let (a, b) = (rows.problem(form), other.problem(form));
            let lambda = 0.1 * largest(&a, &penalty, &one);
            let expected = solved(&a, &penalty, &one, &[lambda]).remove(0).dense(p);
            let dense = solved(&b, &penalty, &two, &[1e20 * lambda]).remove(0).dense(p);
            let mut back = vec![0.0; p];
            (0..p).for_each(|j| back[to(j)] = -dense[j] * factor(to(j)) / 1e20);
            // In raw units columns differ by decades: compared in units of their deviation.
            let deviation = a.deviation();
            let scaled = |b: &[f64]| b.iter().zip(&deviation).map(|(b, s)| b * s).collect::<Vec<f64>>();
            prop_assert!(apart(&scaled(&expected), &scaled(&back)) < 1e-7, "{expected:?} {back:?}");
        }
    }
}
