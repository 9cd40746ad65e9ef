//! Agreement with an interior-point solver on the quadratic program, which is written down from the rows.

use crate::common::{Form, Rows, degenerate, ordinary, penalties};
use clarabel::{
    algebra::CscMatrix,
    solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT},
};
use fleetfoot_sparse::{
    Penalty, Sign, Strength,
    coordinate::{CoordinateOptions, coordinate_descent, lambda_max},
    lars::{LarsOptions, lars},
};

/// The program in b+ and b-: coefficients of unit deviation, a target of unit deviation. The minimiser in these units, and its objective.
fn program(rows: &Rows, penalty: &Penalty, strength: Strength) -> (Vec<f64>, f64) {
    let (n, p) = (rows.n(), rows.p());
    let unit = |value: &dyn Fn(usize) -> f64| {
        let mean = (0..n).map(value).sum::<f64>() / n as f64;
        let deviation = ((0..n).map(|i| (value(i) - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
        ((0..n).map(|i| (value(i) - mean) / deviation).collect::<Vec<f64>>(), deviation)
    };
    let columns: Vec<(Vec<f64>, f64)> = (0..p).map(|j| unit(&|i| rows.x[(i, j)])).collect();
    let (y, tau) = unit(&|i| rows.y[i]);
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / n as f64;
    let factor = |j: usize| penalty.factors.get(j).copied().unwrap_or(1.0);
    let scale = |j: usize| if penalty.standardise { 1.0 } else { columns[j].1.recip() };
    let limit = |j: usize| strength.l1 / tau * factor(j) * scale(j);
    let side = |k: usize| if k < p { 1.0 } else { -1.0 };
    let allowed = |k: usize| {
        let sign = penalty.signs.get(k % p).copied().unwrap_or_default();
        factor(k % p).is_finite() && (sign == Sign::Free || (sign == Sign::NonNegative) == (k < p))
    };
    let kept: Vec<usize> = (0..2 * p).filter(|&k| allowed(k)).collect();
    let size = kept.len();
    let entry = |a: usize, b: usize| {
        let (k, l) = (kept[a], kept[b]);
        let mut value = side(k) * side(l) * product(&columns[k % p].0, &columns[l % p].0);
        if k % p == l % p {
            value += side(k) * side(l) * strength.l2 * factor(k % p) * scale(k % p).powi(2);
        }
        value
    };
    let (mut starts, mut indices, mut values) = (vec![0], Vec::new(), Vec::new());
    for b in 0..size {
        for a in 0..=b {
            indices.push(a);
            values.push(entry(a, b));
        }
        starts.push(indices.len());
    }
    let quadratic = CscMatrix::new(size, size, starts, indices, values);
    let linear: Vec<f64> = kept.iter().map(|&k| limit(k % p) - side(k) * product(&columns[k % p].0, &y)).collect();
    let mut negative = CscMatrix::identity(size);
    negative.nzval.fill(-1.0);
    // The tightest tolerance that rounding lets it reach.
    let solution = [1e-13, 1e-12, 1e-11, 1e-10, 1e-9].into_iter().find_map(|tolerance| {
        let settings = DefaultSettings {
            verbose: false,
            tol_gap_abs: tolerance,
            tol_gap_rel: tolerance,
            tol_feas: tolerance,
            max_iter: 500,
            ..DefaultSettings::default()
        };
        let (cones, zeros) = ([SupportedConeT::NonnegativeConeT(size)], vec![0.0; size]);
        let mut solver =
            DefaultSolver::new(&quadratic, &linear, &negative, &zeros, &cones, settings).expect("a program");
        solver.solve();
        (solver.solution.status == SolverStatus::Solved).then_some(solver.solution)
    });
    let solution = solution.unwrap_or_else(|| panic!("{}: not solved", rows.name));
    let mut coefficients = vec![0.0; p];
    kept.iter().zip(&solution.x).for_each(|(&k, x)| coefficients[k % p] += side(k) * x);
    (coefficients, solution.obj_val + 0.5)
}

fn check(rows: &Rows, what: &str, penalty: &Penalty, l1_ratio: f64) -> usize {
    let problem = rows.problem(Form::Root);
    let (tau, deviation) = (problem.target_deviation(), problem.deviation());
    let largest = lambda_max(&problem, penalty, l1_ratio).expect("a lambda");
    let mut compared = 0;
    for share in [0.5, 0.1, 0.01] {
        let lambda = share * largest;
        let strength = Strength::elastic_net(lambda, l1_ratio);
        let (theirs, objective) = program(rows, penalty, strength);
        let options = LarsOptions { l2: strength.l2, ..LarsOptions::default() };
        let path = lars(&problem, penalty, &options).expect("a path").at(&problem, strength.l1).expect("on the path");
        let options = CoordinateOptions { l1_ratio, ..CoordinateOptions::default() };
        let descent = coordinate_descent(&problem, penalty, &[lambda], &options).expect("a solution").remove(0);
        for (who, solution) in [("path", path), ("descent", descent)] {
            let apart = solution.certificate.objective / tau / tau - objective;
            assert!(apart.abs() < 1e-7, "{}, {what}, {who}, {share}: objectives {apart:e} apart", rows.name);
            // An interior point comes near as the root of its gap where ties leave no strict complementarity.
            if rows.unique && rows.ordinary() {
                let apart = |j: usize| (solution.coefficient(j) * deviation[j] / tau - theirs[j]).abs();
                let apart = (0..rows.p()).map(apart).fold(0.0, f64::max);
                assert!(apart < 1e-7, "{}, {what}, {who}, {share}: coefficients {apart:e} apart", rows.name);
            }
            compared += 1;
        }
    }
    compared
}

#[test]
fn the_quadratic_program_has_the_same_minimiser() {
    let extreme = ["constant", "zero", "huge", "tiny", "offsets"];
    let sane = |rows: &Rows| rows.n() > 2 && !extreme.iter().any(|word| rows.name.contains(word));
    let mut compared = 0;
    for rows in ordinary().iter().step_by(4).chain(degenerate().iter().filter(|rows| sane(rows))) {
        for (what, penalty) in penalties(rows.p()) {
            compared += check(rows, what, &penalty, 1.0);
            compared += check(rows, what, &penalty, 0.5);
        }
    }
    assert!(compared > 2000, "{compared}");
}
