//! Assembly of structured problems, against the block matrix written out, and the laws that its minimiser obeys.

use crate::common::{aircraft, gaussian, tasks, tasks::Tasks};
use faer::Mat;
use fleetfoot_sparse::{
    Path, PathStatus, Penalty, Quadratic, Strength, certificate,
    lars::{LarsOptions, lars},
    structured::{Assembled, Tikhonov, assemble},
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn assembled(tasks: &Tasks) -> Assembled {
    assemble(&tasks.structure, &tasks.roots(), &tasks.assembly).expect("a problem")
}

fn path(problem: &Quadratic, penalty: &Penalty) -> Path {
    lars(problem, penalty, &LarsOptions::default()).expect("a path")
}

/// Coefficients theta at one lambda.
fn theta(tasks: &Tasks, lambda: f64) -> Vec<f64> {
    let assembled = assembled(tasks);
    let path = path(&assembled.problem, &assembled.penalty);
    assembled.coefficients(&path.at(&assembled.problem, lambda).expect("on the path"))
}

/// Largest difference of theta, in units in which the columns have size 1, relative to the largest coefficient there or to the target's size `tau`.
fn apart((scale, tau): (&[f64], f64), a: &[f64], b: &[f64]) -> f64 {
    let most = scale.iter().zip(a.iter().zip(b)).map(|(s, (a, b))| s * a.abs().max(b.abs())).fold(tau, f64::max);
    scale.iter().zip(a.iter().zip(b)).map(|(s, (a, b))| s * (a - b).abs() / most).fold(0.0, f64::max)
}

fn first_knot(tasks: &Tasks) -> f64 {
    let assembled = assembled(tasks);
    path(&assembled.problem, &assembled.penalty).knots[0].l1
}

/// Gamma with fewer rows than coefficients, and a prior.
fn random_tikhonov(tasks: &Tasks, seed: u64) -> Tikhonov {
    let mut rng = Pcg64::seed_from_u64(seed);
    let scale = tasks.scale();
    let rows = rng.random_range(1..=tasks.p());
    let gamma = Mat::from_fn(rows, tasks.p(), |_, j| gaussian(&mut rng) * scale[j]);
    let prior = scale.iter().map(|scale| gaussian(&mut rng) / scale).collect();
    Tikhonov { strength: rng.random_range(0.1..50.0), gamma, prior }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn assembled_problem_matches_stacked_rows(seed in any::<u64>(), with_prior in any::<bool>(), raw in any::<bool>()) {
        let mut tasks = tasks::random(seed);
        tasks.assembly.raw = raw;
        if with_prior {
            tasks.assembly.tikhonov = Some(random_tikhonov(&tasks, seed));
        }
        let assembled_problem = assembled(&tasks);
        let scale = if raw { vec![1.0; tasks.p()] } else { tasks.scale() };
        for (a, b) in assembled_problem.scale.iter().zip(&scale) {
            prop_assert!((a / b - 1.0).abs() < 1e-11, "scales {:?}, from rows {scale:?}", assembled_problem.scale);
        }
        let (b, y) = tasks.stacked();
        let explicit = tasks.explicit(&b, &y, &assembled_problem.scale);
        prop_assert!((assembled_problem.problem.weight() / tasks.n() - 1.0).abs() < 1e-14);

        // The objective anywhere.
        let mut rng = Pcg64::seed_from_u64(seed);
        let deviation = explicit.deviation();
        let tau = explicit.target_deviation();
        for _ in 0..3 {
            let u: Vec<f64> = deviation.iter().map(|d| if *d > 0.0 { tau / d * gaussian(&mut rng) } else { 0.0 }).collect();
            let strength = Strength::lasso(tau * rng.random_range(0.0..1.0));
            let objective = |problem: &Quadratic| certificate(problem, &assembled_problem.penalty, strength, &u).expect("valid").objective;
            let (a, b) = (objective(&assembled_problem.problem), objective(&explicit));
            prop_assert!((a / b - 1.0).abs() < 1e-11, "{a:e} {b:e}");
        }
        // The path everywhere.
        let (a, b) = (path(&assembled_problem.problem, &assembled_problem.penalty), path(&explicit, &assembled_problem.penalty));
        // Interpolation of rows changes the last digits only: both ends are at lambda = 0.
        let end = |status| if status == PathStatus::Saturated { PathStatus::Complete } else { status };
        prop_assert_eq!(end(a.status), end(b.status));
        let first = b.knots[0].l1;
        for share in [1.0, 0.7, 0.4, 0.1, 0.01, 0.0] {
            let lambda = share * first.min(a.knots[0].l1);
            let (a, b) = (a.coefficients(lambda).expect("on"), b.coefficients(lambda).expect("on"));
            let apart = apart((&deviation, tau), &a, &b);
            prop_assert!(apart < 1e-8, "{share}: {apart:e}\n{a:?}\n{b:?}");
        }
        prop_assert!((a.knots[0].l1 - first).abs() <= 1e-10 * first);
    }

    /// Fewer rows than coefficients: the minimiser is not unique, but it is one of the stacked rows too.
    #[test]
    fn few_rows_are_enough(seed in any::<u64>()) {
        let tasks = tasks::few(seed);
        let assembled_problem = assembled(&tasks);
        let (b, y) = tasks.stacked();
        let explicit = tasks.explicit(&b, &y, &assembled_problem.scale);
        let path = path(&assembled_problem.problem, &assembled_problem.penalty);
        for knot in &path.knots {
            let theta = knot.dense(tasks.p());
            let certified = certificate(&explicit, &assembled_problem.penalty, Strength::lasso(knot.l1), &theta).expect("valid");
            prop_assert!(certified.kkt < 1e-7, "{:e} at {:e}", certified.kkt, knot.l1);
        }
    }

    /// Proposition 6.1 as printed: columns of a group times lambda_s / lambda_k, one lambda_s for all, coefficients scaled back.
    #[test]
    fn penalty_factors_are_the_column_scaling_of_proposition_6_1(seed in any::<u64>(), share in 0.01_f64..0.9) {
        let mut tasks = tasks::random(seed);
        let mut rng = Pcg64::seed_from_u64(!seed);
        let latents = tasks.structure.functions.len();
        // Of the objective of equation (17), a plain sum of squares: lambda_s of the first latent.
        let lambda_of: Vec<f64> = (0..latents).map(|_| rng.random_range(0.1..5.0)).collect();
        tasks.assembly.raw = true;
        tasks.assembly.latents = lambda_of.iter().map(|lambda| lambda / lambda_of[0]).collect();
        let lambda = share * first_knot(&tasks);
        let solution = theta(&tasks, lambda);

        let (b, y) = tasks.stacked();
        let latent_of = tasks.structure.latent_of();
        let factor = |j: usize| lambda_of[0] / lambda_of[latent_of[j]];
        let scaled = Mat::from_fn(b.nrows(), b.ncols(), |i, j| factor(j) * b[(i, j)]);
        let surrogate = tasks.explicit(&scaled, &y, &vec![1.0; tasks.p()]);
        let beta = path(&surrogate, &Penalty::default()).coefficients(lambda).expect("on the path");
        let expected: Vec<f64> = beta.iter().enumerate().map(|(j, beta)| factor(j) * beta).collect();
        let plain = tasks.explicit(&b, &y, &vec![1.0; tasks.p()]);
        let apart = apart((&plain.deviation(), plain.target_deviation()), &solution, &expected);
        prop_assert!(apart < 1e-8, "{apart:e} {solution:?} {expected:?}");
    }

    /// lambda_k = 0: the group's coefficients are those of least squares given the others, and at a large lambda they are alone.
    #[test]
    fn a_group_without_penalty_is_least_squares(seed in any::<u64>(), share in 0.02_f64..1.5) {
        let mut tasks = tasks::random(seed);
        let latents = tasks.structure.functions.len();
        let free = seed as usize % latents;
        tasks.assembly.latents = (0..latents).map(|latent| if latent == free { 0.0 } else { 1.0 }).collect();
        let lambda = share * first_knot(&tasks);
        let solution = theta(&tasks, lambda);
        let (b, y) = tasks.stacked();
        let left: Vec<f64> =
            (0..b.nrows()).map(|i| y[i] - (0..tasks.p()).map(|j| b[(i, j)] * solution[j]).sum::<f64>()).collect();
        let length = |values: &dyn Fn(usize) -> f64| (0..b.nrows()).map(|i| values(i).powi(2)).sum::<f64>().sqrt();
        let size = length(&|i| y[i]);
        for j in tasks.structure.range(free) {
            let product: f64 = (0..b.nrows()).map(|i| b[(i, j)] * left[i]).sum();
            prop_assert!(product.abs() <= 1e-9 * size * length(&|i| b[(i, j)]), "{product:e}");
        }
        if share >= 1.0 {
            for (j, value) in solution.iter().enumerate() {
                prop_assert!(tasks.structure.range(free).contains(&j) || *value == 0.0, "{solution:?}");
            }
        }
    }

    /// Proposition 7.1 without l1 penalty: `theta = (B'B + lambda_t Q)^-1 (B'Y + lambda_t Q prior)`, Q = Gamma'Gamma.
    #[test]
    fn ridge_limit_matches_closed_form(seed in any::<u64>()) {
        let mut tasks = tasks::random(seed);
        let tikhonov = random_tikhonov(&tasks, seed);
        let (b, y) = tasks.stacked();
        tasks.assembly.tikhonov = Some(tikhonov.clone());
        let solution = theta(&tasks, 0.0);
        // In units in which columns have length 1, so that the plain products are well enough conditioned.
        let p = tasks.p();
        let unit: Vec<f64> = (0..p).map(|j| (0..b.nrows()).map(|i| b[(i, j)].powi(2)).sum::<f64>().sqrt()).collect();
        let b = Mat::from_fn(b.nrows(), p, |i, j| b[(i, j)] / unit[j]);
        let gamma = Mat::from_fn(tikhonov.gamma.nrows(), p, |i, j| tikhonov.gamma[(i, j)] / unit[j]);
        let q = gamma.transpose() * &gamma;
        let normal = b.transpose() * &b + faer::Scale(tikhonov.strength) * &q;
        // The gradient at the solution, by plain products: nothing is inverted, so no condition number takes part.
        let delta = Mat::from_fn(p, 1, |j, _| solution[j] * unit[j]);
        let prior = Mat::from_fn(p, 1, |j, _| tikhonov.prior[j] * unit[j]);
        let y = Mat::from_fn(b.nrows(), 1, |i, _| y[i]);
        let right = b.transpose() * &y + faer::Scale(tikhonov.strength) * (&q * &prior);
        let gradient = &normal * &delta - &right;
        let size = (0..p).map(|j| (0..p).map(|k| (normal[(j, k)] * delta[(k, 0)]).abs()).sum::<f64>() + right[(j, 0)].abs());
        let size = size.fold(0.0, f64::max);
        for j in 0..p {
            prop_assert!(gradient[(j, 0)].abs() <= 1e-10 * size, "{:e} of {size:e}", gradient[(j, 0)]);
        }
    }

    /// Equation (41): with lambda_t to infinity a latent becomes the least-squares fit of its prior, at the rate 1 / lambda_t.
    #[test]
    fn a_strong_prior_is_obeyed(seed in any::<u64>()) {
        let mut tasks = tasks::random(seed);
        let Some(prior) = tasks.structure.tasks.iter().position(|shape| shape.prior) else { return Ok(()) };
        let range = tasks.structure.range(tasks.structure.functions.len() - 1);
        tasks.assembly.latents = Vec::new();
        let rows = &tasks.rows[prior];
        let k = range.len();
        let alone = Mat::from_fn(rows.nrows(), k, |i, j| rows[(i, j)]);
        let target: Vec<f64> = (0..rows.nrows()).map(|i| rows[(i, k)]).collect();
        let alone = Quadratic::from_rows(alone.as_ref(), &target, Some(&tasks.weights), false).expect("rows");
        let expected = path(&alone, &Penalty::default()).coefficients(0.0).expect("complete");
        let error = |strength: f64| {
            let mut tasks = tasks.clone();
            tasks.assembly.weights[prior] *= strength;
            let solution = theta(&tasks, 0.0);
            apart((&alone.deviation(), alone.target_deviation()), &solution[range.clone()], &expected)
        };
        let (near, nearer) = (error(1e6), error(1e8));
        prop_assert!(nearer < 1e-3 && nearer <= 0.02 * near + 1e-9, "{near:e} {nearer:e}");
    }

    #[test]
    fn units_and_order_do_not_matter(seed in any::<u64>(), share in 0.01_f64..0.9) {
        let tasks = tasks::random(seed);
        let mut rng = Pcg64::seed_from_u64(!seed);
        let mut factor = || 10.0_f64.powf(rng.random_range(-6.0..6.0));
        let lambda = share * first_knot(&tasks);
        let expected = theta(&tasks, lambda);
        let scale = tasks.scale();
        let p = tasks.p();
        let tau = assembled(&tasks).problem.target_deviation();
        let close = |solution: &[f64]| apart((&scale, tau), solution, &expected) < 1e-8;

        // Units of the functions: the coefficients have theirs.
        let units: Vec<f64> = (0..p).map(|_| factor()).collect();
        let mut changed = tasks.clone();
        for (task, rows) in changed.rows.iter_mut().enumerate() {
            for (column, &j) in tasks.structure.columns(task).iter().enumerate() {
                (0..rows.nrows()).for_each(|i| rows[(i, column)] *= units[j]);
            }
        }
        let solution: Vec<f64> = theta(&changed, lambda).iter().zip(&units).map(|(theta, unit)| theta * unit).collect();
        prop_assert!(close(&solution), "units of functions {solution:?} {expected:?}");

        // Units of an equation: its weight has their square.
        let mut changed = tasks.clone();
        for (task, rows) in changed.rows.iter_mut().enumerate() {
            let unit = factor();
            *rows = faer::Scale(unit) * &*rows;
            changed.assembly.weights[task] /= unit * unit;
        }
        prop_assert!(close(&theta(&changed, lambda)), "units of equations");

        // Units of all targets: coefficients and lambda have them.
        let mut changed = tasks.clone();
        let unit = factor();
        for rows in &mut changed.rows {
            let last = rows.ncols() - 1;
            (0..rows.nrows()).for_each(|i| rows[(i, last)] *= unit);
        }
        let solution: Vec<f64> = theta(&changed, unit * lambda).iter().map(|theta| theta / unit).collect();
        prop_assert!(close(&solution), "units of targets");

        // All task weights: lambda has their root, since the columns' scale has it too.
        let mut changed = tasks.clone();
        changed.assembly.weights.iter_mut().for_each(|weight| *weight *= unit * unit);
        prop_assert!(close(&theta(&changed, unit * lambda)), "weights of tasks");

        // All row weights: n has them.
        let mut changed = tasks.clone();
        changed.weights.iter_mut().for_each(|weight| *weight *= 3.0);
        prop_assert!(close(&theta(&changed, lambda)), "weights of rows");
    }

    #[test]
    fn permutations_permute(seed in any::<u64>(), share in 0.01_f64..0.9) {
        let tasks = tasks::random(seed);
        let lambda = share * first_knot(&tasks);
        let expected = theta(&tasks, lambda);
        let (scale, tau) = (tasks.scale(), assembled(&tasks).problem.target_deviation());

        // Tasks, and the functions of every latent, in reverse.
        let mut changed = tasks.clone();
        changed.rows.reverse();
        changed.assembly.weights.reverse();
        changed.structure.tasks.reverse();
        for (task, rows) in changed.rows.iter_mut().enumerate() {
            let mut first = 0;
            let before = rows.clone();
            for &latent in &changed.structure.tasks[task].latents {
                let count = tasks.structure.functions[latent];
                for k in 0..count {
                    (0..rows.nrows()).for_each(|i| rows[(i, first + k)] = before[(i, first + count - 1 - k)]);
                }
                first += count;
            }
        }
        let solution = theta(&changed, lambda);
        let mirrored: Vec<f64> =
            (0..tasks.structure.functions.len()).flat_map(|l| solution[tasks.structure.range(l)].iter().rev().copied()).collect();
        prop_assert!(apart((&scale, tau), &mirrored, &expected) < 1e-8, "functions {mirrored:?} {expected:?}");

        // Latents in reverse: another numbering, the tasks' columns stay where they are.
        let mut changed = tasks.clone();
        let latents = tasks.structure.functions.len();
        changed.structure.functions.reverse();
        changed.assembly.latents.reverse();
        for shape in &mut changed.structure.tasks {
            shape.latents.iter_mut().for_each(|latent| *latent = latents - 1 - *latent);
        }
        let solution = theta(&changed, lambda);
        let back: Vec<f64> =
            (0..latents).flat_map(|l| solution[changed.structure.range(latents - 1 - l)].to_vec()).collect();
        prop_assert!(apart((&scale, tau), &back, &expected) < 1e-8, "latents {back:?} {expected:?}");
    }
}

/// The climbs of one aircraft, exact derivatives, no noise: the coefficients come back although the columns, scaled to unit length, have a condition
/// number of 1e7 and their Gram matrix thus one of 1e14.
#[test]
fn least_squares_finds_the_coefficients_of_an_aircraft() {
    let climbs = aircraft::climbs(30, false);
    let banks = climbs.banks(4096);
    let assembled = assemble(&climbs.structure, &banks.total(), &climbs.assembly).expect("a problem");
    assert!(assembled.problem.weight() > 20_000.0);
    let worst = |theta: &[f64]| {
        let error = |range: std::ops::Range<usize>| {
            let size = |j: usize| assembled.scale[j] * climbs.truth[j].abs();
            let most = range.clone().map(size).fold(0.0, f64::max);
            let errors = range.map(|j| assembled.scale[j] * (theta[j] - climbs.truth[j]).abs() / most);
            errors.fold(0.0, f64::max)
        };
        (0..4).map(|latent| error(climbs.structure.range(latent))).fold(0.0, f64::max)
    };
    let free = Penalty { factors: vec![0.0; climbs.truth.len()], ..Penalty::default() };
    let fitted = path(&assembled.problem, &free);
    let theta = assembled.coefficients(fitted.knots.last().expect("a knot"));
    // The bound of Householder QR, condition times rounding, is 1e-9; of the Gram matrix nothing would be left.
    assert!(worst(&theta) < 1e-9, "{:e}", worst(&theta));

    let path = path(&assembled.problem, &assembled.penalty);
    assert_eq!(path.status, PathStatus::Complete);
    let theta = assembled.coefficients(path.knots.last().expect("a knot"));
    assert!(worst(&theta) < 1e-9, "{:e}", worst(&theta));
}

/// With turbulence the path has hundreds of knots, and every one is certified down to lambda = 0.
#[test]
fn the_path_of_an_aircraft_in_turbulence_is_complete() {
    let climbs = aircraft::climbs(30, true);
    let banks = climbs.banks(4096);
    let assembled = assemble(&climbs.structure, &banks.total(), &climbs.assembly).expect("a problem");
    let path = path(&assembled.problem, &assembled.penalty);
    let worst = path.knots.iter().map(|knot| knot.certificate.kkt).fold(0.0, f64::max);
    assert_eq!(path.status, PathStatus::Complete);
    assert!(path.knots.len() > 45 && worst < 1e-8);
}
