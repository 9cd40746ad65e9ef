//! Constrained fits beside closed forms, the enumeration of active sets and non-negative paths.

use crate::common::{degenerate, gaussian, ordinary};
use faer::{Mat, linalg::solvers::Solve};
use fleetfoot_sparse::{
    Sign, Strength, certificate,
    constrained::{
        Constrained, ConstrainedError, ConstrainedOptions, ConstrainedStatus, Constraints, LinearConstraint,
        constrained,
    },
    lars::{LarsOptions, lars},
    structured::{Assembled, Assembly, assemble},
};
use fleetfoot_stats::{Factor, least_squares};
use fleetfoot_sums::structured::{Structure, TaskShape};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const INFINITY: f64 = f64::INFINITY;

/// A regression of one task and one latent, no intercept.
fn problem(x: &Mat<f64>, y: &[f64], assembly: Assembly) -> Assembled {
    let p = x.ncols();
    let mut factor = Factor::new(p, 1);
    factor.push(Mat::from_fn(x.nrows(), p + 1, |i, j| if j < p { x[(i, j)] } else { y[i] }).as_ref(), None);
    let task = TaskShape { latents: vec![0], centred: false, prior: false };
    let structure = Structure { functions: vec![p], tasks: vec![task] };
    assemble(&structure, &[factor.square_root()], &Assembly { weights: vec![1.0], ..assembly }).expect("a problem")
}

fn random_rows(seed: u64, n: usize, p: usize) -> (Mat<f64>, Vec<f64>) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let x = Mat::from_fn(n, p, |_, j| 0.3 * j as f64 + gaussian(&mut rng));
    let y = (0..n).map(|i| x[(i, 0)] - 2.0 * x[(i, p - 1)] + gaussian(&mut rng)).collect();
    (x, y)
}

fn row(name: &str, coefficients: &[f64], bound: f64) -> LinearConstraint {
    let coefficients = coefficients.iter().copied().enumerate().collect();
    LinearConstraint { name: name.to_owned(), coefficients, bound }
}

fn solve(assembled: &Assembled, constraints: &Constraints, lambda: f64) -> Constrained {
    let options = ConstrainedOptions::default();
    let solution = constrained(assembled, constraints, Strength::lasso(lambda), None, &options).expect("feasible");
    let certificate = solution.certificate;
    assert_eq!(solution.status, ConstrainedStatus::Solved, "{certificate:?}");
    assert!(certificate.kkt < 1e-9 && certificate.violation < 1e-9 && certificate.gap < 1e-9, "{certificate:?}");
    solution
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    let most = a.iter().chain(b).fold(1e-300_f64, |most, value| most.max(value.abs()));
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / most).fold(0.0, f64::max)
}

/// Coefficients and multipliers with the given rows `(c, d)` as equalities, by the plain system of the conditions.
fn with_equalities(x: &Mat<f64>, y: &[f64], rows: &[(&[f64], f64)]) -> (Vec<f64>, Vec<f64>) {
    let (n, p, w) = (x.nrows(), x.ncols(), rows.len());
    let products = x.transpose() * x;
    let system = Mat::from_fn(p + w, p + w, |i, j| match (i < p, j < p) {
        (true, true) => products[(i, j)] / n as f64,
        (true, false) => -rows[j - p].0[i],
        (false, true) => rows[i - p].0[j],
        (false, false) => 0.0,
    });
    let right = Mat::from_fn(p + w, 1, |i, _| match i.checked_sub(p) {
        None => (0..n).map(|k| x[(k, i)] * y[k]).sum::<f64>() / n as f64,
        Some(row) => rows[row].1,
    });
    let minimiser = system.partial_piv_lu().solve(&right);
    ((0..p).map(|i| minimiser[(i, 0)]).collect(), (p..p + w).map(|i| minimiser[(i, 0)]).collect())
}

#[test]
fn orthogonal_columns_are_shrunk_and_clipped() {
    // Columns of a Hadamard matrix: X'X = 8 I.
    let x =
        Mat::from_fn(
            8,
            4,
            |i, j| if (i >> j) & 1 == 0 && j < 3 || j == 3 && i.count_ones() % 2 == 0 { 1.0 } else { -1.0 },
        );
    let y: Vec<f64> = (0..8).map(|i| 3.0 * x[(i, 0)] - 2.0 * x[(i, 1)] + 0.4 * x[(i, 2)] + 1.5 * x[(i, 3)]).collect();
    let assembled = problem(&x, &y, Assembly { raw: true, ..Assembly::default() });
    let bounds = vec![[-INFINITY, 2.0], [-1.0, INFINITY], [0.1, 0.2], [0.0, INFINITY]];
    let constraints = Constraints { bounds: bounds.clone(), ..Constraints::default() };
    for lambda in [0.0, 0.3, 0.7, 2.5] {
        let fit = solve(&assembled, &constraints, lambda);
        let expected: Vec<f64> = [3.0_f64, -2.0, 0.4, 1.5]
            .iter()
            .zip(&bounds)
            .map(|(value, [low, high])| (value.signum() * (value.abs() - lambda).max(0.0)).clamp(*low, *high))
            .collect();
        assert!(apart(&fit.theta, &expected) < 1e-12, "{lambda}: {:?} {expected:?}", fit.theta);
        // The slope of 1/2 (theta - z)^2 + lambda |theta| at the upper bound of the first coefficient.
        let first = fit.active.iter().find(|active| active.name == "coefficient 0 <= 2");
        let slope = 3.0 - lambda - 2.0;
        assert_eq!(first.is_some(), slope > 0.0);
        assert!(first.is_none_or(|active| (active.multiplier - slope).abs() < 1e-12), "{:?}", fit.active);
    }
}

#[test]
fn equalities_have_their_closed_form() {
    for seed in 0..20 {
        let (x, y) = random_rows(seed, 30, 6);
        let assembled = problem(&x, &y, Assembly::default());
        let forms = [[1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [0.0, 2.0, -1.0, 0.0, 0.5, 0.0]];
        let equalities = vec![row("sum", &forms[0], 1.5), row("balance", &forms[1], -0.3)];
        let constraints = Constraints { equalities, ..Constraints::default() };
        let fit = solve(&assembled, &constraints, 0.0);
        let (expected, multipliers) = with_equalities(&x, &y, &[(&forms[0], 1.5), (&forms[1], -0.3)]);
        assert!(apart(&fit.theta, &expected) < 1e-10, "{:?} {expected:?}", fit.theta);
        let named: Vec<f64> = fit.active.iter().map(|active| active.multiplier).collect();
        assert!(apart(&named, &multipliers) < 1e-9, "{named:?} {multipliers:?}");
    }
}

/// All subsets of at most p inequalities as equalities: the feasible one of least objective, by a solver of linear systems alone.
fn enumerate(x: &Mat<f64>, y: &[f64], forms: &[(Vec<f64>, f64)]) -> Option<Vec<f64>> {
    let mut best: Option<(f64, Vec<f64>)> = None;
    for subset in 0..1_u32 << forms.len() {
        if subset.count_ones() as usize > x.ncols() {
            continue;
        }
        let chosen = forms.iter().enumerate().filter(|(i, _)| subset >> i & 1 == 1);
        let chosen: Vec<(&[f64], f64)> = chosen.map(|(_, (form, bound))| (form.as_slice(), *bound)).collect();
        let (theta, _) = with_equalities(x, y, &chosen);
        let form = |form: &[f64]| form.iter().zip(&theta).map(|(c, theta)| c * theta).sum::<f64>();
        if !forms.iter().all(|(c, bound)| form(c) >= bound - 1e-9) {
            continue;
        }
        let left = |i: usize| y[i] - (0..x.ncols()).map(|j| x[(i, j)] * theta[j]).sum::<f64>();
        let rss: f64 = (0..x.nrows()).map(|i| left(i).powi(2)).sum();
        if best.as_ref().is_none_or(|(least, _)| rss < *least) {
            best = Some((rss, theta));
        }
    }
    best.map(|(_, theta)| theta)
}

#[test]
fn inequalities_agree_with_the_enumeration_of_active_sets() {
    let (mut held, mut infeasible) = (0, 0);
    for seed in 0..60 {
        let (x, y) = random_rows(seed, 12, 4);
        let mut rng = Pcg64::seed_from_u64(1000 + seed);
        let mut form = || ((0..4).map(|_| gaussian(&mut rng)).collect::<Vec<f64>>(), gaussian(&mut rng));
        let forms: Vec<(Vec<f64>, f64)> = (0..7).map(|_| form()).collect();
        let assembled = problem(&x, &y, Assembly::default());
        let inequalities = forms.iter().enumerate().map(|(i, (form, bound))| row(&format!("row {i}"), form, *bound));
        let constraints = Constraints { inequalities: inequalities.collect(), ..Constraints::default() };
        let Some(expected) = enumerate(&x, &y, &forms) else {
            let error =
                constrained(&assembled, &constraints, Strength::lasso(0.0), None, &ConstrainedOptions::default());
            assert!(matches!(error, Err(ConstrainedError::Infeasible { .. })), "{error:?}");
            infeasible += 1;
            continue;
        };
        let fit = solve(&assembled, &constraints, 0.0);
        assert!(apart(&fit.theta, &expected) < 1e-9, "{seed}: {:?} {expected:?}", fit.theta);
        held += usize::from(fit.active.len() > 1);
    }
    println!("{held} with several active rows, {infeasible} infeasible");
    assert!(held > 20 && infeasible > 0, "{held} {infeasible}");
}

/// Random and degenerate problems: without constraints the objective is the path's; with bounds that cut into its coefficients, the certificate holds and
/// the shrunk path, which keeps the bounds, is no better.
#[test]
fn wide_collinear_and_tied_columns_are_certified() {
    let mut bounded = 0;
    for rows in ordinary().iter().step_by(3).chain(&degenerate()) {
        let assembled = problem(&rows.x, &rows.y, Assembly::default());
        let path = lars(&assembled.problem, &assembled.penalty, &LarsOptions::default()).expect("a path");
        let size = certificate(&assembled.problem, &assembled.penalty, Strength::lasso(0.0), &vec![0.0; rows.p()]);
        let size = size.expect("valid").objective;
        for share in [0.5, 0.05, 0.002] {
            let lambda = share * path.knots.first().map_or(0.0, |knot| knot.l1);
            let Ok(solution) = path.at(&assembled.problem, lambda) else { continue };
            let (what, strength) = (format!("{} at {share}", rows.name), Strength::lasso(lambda));
            let fit = |constraints: &Constraints| {
                let result = constrained(&assembled, constraints, strength, None, &ConstrainedOptions::default());
                let fit = result.unwrap_or_else(|error| panic!("{what}: {error}"));
                let certificate = fit.certificate;
                assert!(fit.status == ConstrainedStatus::Solved && certificate.gap < 1e-8, "{what}: {certificate:?}");
                fit
            };
            let free = fit(&Constraints::default());
            let least = solution.certificate.objective;
            assert!((free.objective - least).abs() <= 1e-9 * size, "{what}: {:e} {least:e}", free.objective);
            let theta = assembled.coefficients(&solution);
            let ends = |(j, value): (usize, &f64)| match (*value != 0.0 && j % 2 == 0, *value > 0.0) {
                (false, _) => [-INFINITY, INFINITY],
                (true, true) => [-INFINITY, 0.6 * value],
                (true, false) => [0.6 * value, INFINITY],
            };
            let bounds: Vec<[f64; 2]> = theta.iter().enumerate().map(ends).collect();
            let result = fit(&Constraints { bounds: bounds.clone(), ..Constraints::default() });
            let coefficients: Vec<f64> =
                theta.iter().zip(&assembled.scale).map(|(theta, scale)| 0.6 * theta * scale).collect();
            let shrunk =
                certificate(&assembled.problem, &assembled.penalty, strength, &coefficients).expect("valid").objective;
            assert!(result.objective <= shrunk + 1e-9 * size && result.objective >= least - 1e-9 * size, "{what}");
            for (value, [low, high]) in result.theta.iter().zip(&bounds) {
                assert!(
                    *value >= low - 1e-9 * low.abs() && *value <= high + 1e-9 * high.abs(),
                    "{what}: {value} {low} {high}"
                );
            }
            bounded += usize::from(bounds.iter().any(|ends| ends[0].is_finite() || ends[1].is_finite()));
        }
    }
    println!("{bounded} bounded problems");
    assert!(bounded > 100, "{bounded}");
}

#[test]
fn signs_agree_with_the_non_negative_path() {
    for seed in 0..25 {
        let (x, y) = random_rows(seed, 25, 8);
        let mut rng = Pcg64::seed_from_u64(seed);
        let kinds = [Sign::Free, Sign::NonNegative, Sign::NonPositive];
        let signs: Vec<Sign> = (0..8).map(|_| kinds[rng.random_range(0..3_usize)]).collect();
        let factors: Vec<f64> = (0..8).map(|j| if j == 2 { 0.0 } else { rng.random_range(0.5..2.0) }).collect();
        let free = problem(&x, &y, Assembly { factors: factors.clone(), ..Assembly::default() });
        let signed = problem(&x, &y, Assembly { factors, signs: signs.clone(), ..Assembly::default() });
        let path = lars(&signed.problem, &signed.penalty, &LarsOptions::default()).expect("a path");
        let ends = |sign: &Sign| match sign {
            Sign::Free => [-INFINITY, INFINITY],
            Sign::NonNegative => [0.0, INFINITY],
            Sign::NonPositive => [-INFINITY, 0.0],
        };
        let bounds = Constraints { bounds: signs.iter().map(ends).collect(), ..Constraints::default() };
        for share in [0.0, 0.003, 0.1, 0.5] {
            let lambda = share * path.knots[0].l1;
            let expected = signed.coefficients(&path.at(&signed.problem, lambda).expect("on the path"));
            let by_penalty = solve(&signed, &Constraints::default(), lambda);
            let by_bounds = solve(&free, &bounds, lambda);
            for fit in [&by_penalty, &by_bounds] {
                assert!(apart(&fit.theta, &expected) < 1e-8, "{seed} {share}: {:?} {expected:?}", fit.theta);
                assert!(fit.theta.iter().zip(&expected).all(|(a, b)| (*a == 0.0) == (*b == 0.0)));
            }
        }
    }
}

#[test]
fn a_ridge_is_the_elastic_net_of_the_path() {
    let (x, y) = random_rows(5, 30, 7);
    let assembled = problem(&x, &y, Assembly::default());
    let options = LarsOptions { l2: 0.3, ..LarsOptions::default() };
    let path = lars(&assembled.problem, &assembled.penalty, &options).expect("a path");
    let l1 = 0.1 * path.knots[0].l1;
    let solution = path.at(&assembled.problem, l1).expect("on the path");
    let strength = Strength { l1, l2: 0.3 };
    let fit =
        constrained(&assembled, &Constraints::default(), strength, None, &ConstrainedOptions::default()).expect("free");
    assert!(apart(&fit.theta, &assembled.coefficients(&solution)) < 1e-9);
    assert!((fit.objective / solution.certificate.objective - 1.0).abs() < 1e-11);
    assert!((fit.mse / solution.mse - 1.0).abs() < 1e-11);
}

#[test]
fn a_support_leaves_the_others_at_zero() {
    let (x, y) = random_rows(8, 30, 6);
    let assembled = problem(&x, &y, Assembly::default());
    let support = [1, 4, 5];
    let constraints =
        Constraints { inequalities: vec![row("last", &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0], 0.5)], ..Constraints::default() };
    let options = ConstrainedOptions::default();
    let fit = constrained(&assembled, &constraints, Strength::lasso(0.0), Some(&support), &options).expect("feasible");
    let kept = Mat::from_fn(30, 3, |i, j| x[(i, support[j])]);
    let (expected, _) = with_equalities(&kept, &y, &[(&[0.0, 0.0, 1.0], 0.5)]);
    let inside: Vec<f64> = support.iter().map(|&j| fit.theta[j]).collect();
    assert!(apart(&inside, &expected) < 1e-10 && [0, 2, 3].iter().all(|&j| fit.theta[j] == 0.0), "{fit:?}");
    let none =
        constrained(&assembled, &Constraints::default(), Strength::lasso(0.0), Some(&[]), &options).expect("nothing");
    assert!(none.theta == [0.0; 6] && (none.mse - y.iter().map(|y| y * y).sum::<f64>() / 30.0).abs() < 1e-12);
    // A constraint on what is left out cannot be met.
    let first = Constraints { inequalities: vec![row("first", &[1.0], 0.5)], ..Constraints::default() };
    let error =
        constrained(&assembled, &first, Strength::lasso(0.0), Some(&support), &options).expect_err("infeasible");
    assert!(error.to_string().contains("first"), "{error}");
}

#[test]
fn contradictions_are_named_and_only_they() {
    let (x, y) = random_rows(3, 20, 4);
    let assembled = problem(&x, &y, Assembly::default());
    let inequalities = vec![
        row("a + b >= 2", &[1.0, 1.0], 2.0),
        row("c >= 1", &[0.0, 0.0, 1.0], 1.0),
        row("a <= 0.5", &[-1.0], -0.5),
        row("b <= 1", &[0.0, -1.0], -1.0),
        row("d >= -7", &[0.0, 0.0, 0.0, 1.0], -7.0),
    ];
    let constraints = Constraints { inequalities, ..Constraints::default() };
    let error = constrained(&assembled, &constraints, Strength::lasso(0.1), None, &ConstrainedOptions::default());
    let Err(ConstrainedError::Infeasible { constraints }) = error else { panic!("{error:?}") };
    assert_eq!(constraints, ["a + b >= 2", "a <= 0.5", "b <= 1"]);
    let refused = |constraints: Constraints| {
        constrained(&assembled, &constraints, Strength::lasso(0.0), None, &ConstrainedOptions::default())
            .expect_err("refused")
            .to_string()
    };
    let bounds = vec![[0.0, 1.0], [2.0, 1.0], [-INFINITY, INFINITY], [0.0, 0.0]];
    assert!(
        refused(Constraints { bounds, ..Constraints::default() }).starts_with("coefficient 1 cannot lie between 2")
    );
    let beyond = vec![row("far", &[0.0, 0.0, 0.0, 0.0, 1.0], 0.0)];
    assert!(
        refused(Constraints { inequalities: beyond, ..Constraints::default() }).contains("coefficient 4; there are 4")
    );
    let nan = vec![row("odd", &[f64::NAN], 0.0)];
    assert!(refused(Constraints { equalities: nan, ..Constraints::default() }).contains("`odd`"));
    assert!(refused(Constraints { bounds: vec![[0.0, 1.0]], ..Constraints::default() }).contains("4 are needed"));
}

#[test]
fn redundant_and_degenerate_constraints_change_nothing() {
    for seed in 0..20 {
        let (x, y) = random_rows(seed, 15, 3);
        let assembled = problem(&x, &y, Assembly::default());
        let plain = vec![row("a", &[1.0, 0.0, 0.0], 2.0), row("b", &[0.0, 0.0, 1.0], 1.0)];
        let mut crowded = plain.clone();
        // The same again, in other units, implied by sums, and more rows than coefficients through the same point.
        crowded.push(row("a again", &[1.0, 0.0, 0.0], 2.0));
        crowded.push(row("a in other units", &[1e6, 0.0, 0.0], 2e6));
        crowded.push(row("a + b", &[1.0, 0.0, 1.0], 3.0));
        crowded.push(row("a + 2 b", &[1.0, 0.0, 2.0], 4.0));
        crowded.push(row("loose", &[1.0, 0.0, 0.0], -50.0));
        let of = |inequalities: Vec<LinearConstraint>| Constraints { inequalities, ..Constraints::default() };
        let expected = solve(&assembled, &of(plain), 0.0);
        let fit = solve(&assembled, &of(crowded), 0.0);
        assert!(apart(&fit.theta, &expected.theta) < 1e-9, "{seed}: {:?} {:?}", fit.theta, expected.theta);
        assert!(!fit.active.iter().any(|active| active.name == "loose"));
        let equalities = vec![row("sum", &[1.0, 1.0, 1.0], 1.0), row("twice", &[2.0, 2.0, 2.0], 2.0)];
        let twice = solve(&assembled, &Constraints { equalities: equalities.clone(), ..Constraints::default() }, 0.0);
        let once =
            solve(&assembled, &Constraints { equalities: equalities[..1].to_vec(), ..Constraints::default() }, 0.0);
        assert!(apart(&twice.theta, &once.theta) < 1e-9);
    }
}

#[test]
fn huge_and_tiny_units_change_nothing() {
    let (x, y) = random_rows(4, 20, 5);
    let inequalities = vec![row("a", &[1.0, 0.0, 0.0, 0.0, 1.0], 0.4), row("b", &[0.0, 1.0, -1.0, 3.0, 0.0], 4.0)];
    let constraints = Constraints { inequalities, ..Constraints::default() };
    let expected = solve(&problem(&x, &y, Assembly::default()), &constraints, 0.05);
    assert!(expected.active.len() == 2, "{:?}", expected.active);
    let unit = [1e-9, 1e7, 1.0, 1e-4, 1e11];
    for target in [1e-8, 1e9] {
        let scaled = Mat::from_fn(20, 5, |i, j| x[(i, j)] * unit[j]);
        let y: Vec<f64> = y.iter().map(|y| y * target).collect();
        let mut constraints = constraints.clone();
        for row in &mut constraints.inequalities {
            row.coefficients.iter_mut().for_each(|(j, value)| *value *= unit[*j]);
            row.bound *= target;
        }
        let fit = solve(&problem(&scaled, &y, Assembly::default()), &constraints, 0.05 * target);
        let back: Vec<f64> = fit.theta.iter().zip(unit).map(|(theta, unit)| theta * unit / target).collect();
        assert!(apart(&back, &expected.theta) < 1e-9, "{back:?} {:?}", expected.theta);
        assert!((fit.objective / target / target / expected.objective - 1.0).abs() < 1e-9);
        for (a, b) in fit.active.iter().zip(&expected.active) {
            assert!(a.name == b.name && (a.multiplier / target / b.multiplier - 1.0).abs() < 1e-7, "{a:?} {b:?}");
        }
    }
}

/// Powers of a variable far from zero, condition 1e7: with a coefficient at its bound the others are least squares of what is left, by Householder QR.
#[test]
fn ill_conditioned_columns_keep_accuracy() {
    let n = 400;
    let mut rng = Pcg64::seed_from_u64(1);
    let t: Vec<f64> = (0..n).map(|i| 2.0 + i as f64 / n as f64).collect();
    let x = Mat::from_fn(n, 5, |i, j| t[i].powi(j as i32));
    let y: Vec<f64> = t.iter().map(|t| (3.0 * t).sin() + 0.1 * gaussian(&mut rng)).collect();
    let assembled = problem(&x, &y, Assembly::default());
    for (column, shift) in [(1, 2.0), (3, 0.5), (4, 0.2)] {
        let free = solve(&assembled, &Constraints::default(), 0.0);
        let bound = free.theta[column] + shift;
        let mut bounds = vec![[-INFINITY, INFINITY]; 5];
        bounds[column] = [bound, INFINITY];
        let fit = solve(&assembled, &Constraints { bounds, ..Constraints::default() }, 0.0);
        assert_eq!(fit.active.len(), 1);
        let others: Vec<usize> = (0..5).filter(|&j| j != column).collect();
        // The constant is the intercept of the peer.
        let regressors: Vec<usize> = others.iter().copied().filter(|&j| j != 0).collect();
        let mut factor = Factor::new(regressors.len(), 1);
        let left = |i: usize| y[i] - bound * x[(i, column)];
        let d = regressors.len();
        factor.push(Mat::from_fn(n, d + 1, |i, j| if j < d { x[(i, regressors[j])] } else { left(i) }).as_ref(), None);
        let peer = least_squares(&factor.square_root(), &vec![1.0; d]);
        let theta: Vec<f64> = regressors.iter().map(|&j| fit.theta[j]).collect();
        let expected: Vec<f64> = (0..d).map(|j| peer.coefficients[(j, 0)]).collect();
        // Two backward stable solvers of condition 1e7 may differ by 1e-9 of the largest coefficient.
        assert!(apart(&theta, &expected) < 1e-8, "{column}: {theta:?} {expected:?}");
        assert!((fit.mse * n as f64 / peer.rss[0] - 1.0).abs() < 1e-11, "{} {}", fit.mse * n as f64, peer.rss[0]);
    }
}
