//! Thresholding between bounds, against an enumeration of held coefficients, another solver, and properties of all
//! models.

use faer::{Mat, linalg::solvers::Solve};
use fleetfoot_data::{Silent, mix};
use fleetfoot_sparse::{
    Strength,
    constrained::{ConstrainedOptions, ConstrainedStatus, Constraints, constrained},
    structured::{Assembly, assemble},
    threshold::{
        FoldProblem, Frols, Optimizer, PenalisedPath, Removal, Rivals, Scaling, Sr3, Ssr, Stlsq, Sweep, SweepOptions,
        Terms, ThresholdError, Thresholds, optimize, sweep,
    },
};
use fleetfoot_stats::{Compressed, Factor};
use fleetfoot_sums::structured::{Structure, TaskShape};
use proptest::prelude::*;

use crate::thresholds::compressed;

fn noise(key: u64) -> f64 {
    (mix(key) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Rows `[x y]` of p correlated columns in different units; the target has every other one, with changing signs.
fn rows(seed: u64, n: usize, p: usize, error: f64) -> Mat<f64> {
    let x = |i: usize, j: usize| {
        let uniform = noise(seed ^ ((i * 131 + j) as u64 + 1).wrapping_mul(0x9e37_79b9));
        10_f64.powi(j as i32 % 3 - 1) * (uniform + 0.8 * noise(seed ^ (i as u64) << 32))
    };
    let truth = |j: usize| [1.0, 0.0, -0.6, 0.0, 0.3][j % 5] / 10_f64.powi(j as i32 % 3 - 1);
    Mat::from_fn(n, p + 1, |i, j| match j {
        j if j < p => x(i, j),
        _ => (0..p).map(|j| truth(j) * x(i, j)).sum::<f64>() + error * noise(seed ^ (i as u64) << 20),
    })
}

/// Coefficients of least squares between bounds by trying every set of held ones: normal equations of the others, the least error of those that keep the bounds.
fn by_trial(rows: &Mat<f64>, bounds: &[[f64; 2]]) -> (Vec<f64>, f64) {
    let p = bounds.len();
    let (x, y) = (rows.as_ref().subcols(0, p), rows.as_ref().col(p));
    let mut best: (Vec<f64>, f64) = (Vec::new(), f64::INFINITY);
    for set in 0..3_usize.pow(p as u32) {
        let state: Vec<usize> = (0..p).map(|j| set / 3_usize.pow(j as u32) % 3).collect();
        let mut b: Vec<f64> = (0..p).map(|j| if state[j] == 0 { 0.0 } else { bounds[j][state[j] - 1] }).collect();
        if b.iter().any(|value| value.is_infinite()) {
            continue;
        }
        let free: Vec<usize> = (0..p).filter(|&j| state[j] == 0).collect();
        let left = Mat::from_fn(rows.nrows(), 1, |i, _| y[i] - (0..p).map(|j| x[(i, j)] * b[j]).sum::<f64>());
        let design = Mat::from_fn(rows.nrows(), free.len(), |i, k| x[(i, free[k])]);
        if !free.is_empty() {
            let least = (design.transpose() * &design).partial_piv_lu().solve(design.transpose() * &left);
            free.iter().enumerate().for_each(|(k, &j)| b[j] = least[(k, 0)]);
        }
        let rss: f64 = (0..rows.nrows()).map(|i| (y[i] - (0..p).map(|j| x[(i, j)] * b[j]).sum::<f64>()).powi(2)).sum();
        if b.iter().zip(bounds).all(|(b, [low, high])| low <= b && b <= high) && rss < best.1 {
            best = (b, rss);
        }
    }
    best
}

fn bounded(bounds: &[[f64; 2]]) -> Terms {
    Terms { bounds: Some(bounds.to_vec()), ..Terms::all() }
}

const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// One of the kinds of bounds: free, a sign, a short interval about 0 or beside it, a number.
fn bound(kind: usize, size: f64) -> [f64; 2] {
    match kind {
        0 => FREE,
        1 => [0.0, f64::INFINITY],
        2 => [f64::NEG_INFINITY, 0.0],
        3 => [-0.1 * size, 0.1 * size],
        4 => [0.2 * size, 0.5 * size],
        _ => [0.3 * size, 0.3 * size],
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn least_squares_between_bounds_is_the_best_of_all_sets(
        seed in 0_u64..1000, kinds in prop::collection::vec(0_usize..6, 5), error in 0.01_f64..2.0,
    ) {
        let rows = rows(seed, 60, 5, error);
        let bounds: Vec<[f64; 2]> =
            kinds.iter().enumerate().map(|(j, &kind)| bound(kind, 10_f64.powi(1 - j as i32 % 3))).collect();
        let problem = compressed(&rows, 1, false);
        let models = optimize(&problem, 0, &Optimizer::LeastSquares, &bounded(&bounds)).unwrap();
        let step = models.choice();
        let (b, rss) = by_trial(&rows, &bounds);
        // Condition 1e2 and its square in the oracle's normal equations.
        for (j, (coefficient, b)) in step.coefficients.iter().zip(&b).enumerate() {
            let unit = 10_f64.powi(j as i32 % 3 - 1);
            prop_assert!((coefficient - b).abs() * unit <= 1e-9, "{j}: {coefficient} {b}");
            prop_assert!(bounds[j][0] <= *coefficient && *coefficient <= bounds[j][1]);
            prop_assert_eq!(step.support.contains(&j), *coefficient != 0.0);
        }
        prop_assert!((step.rss - rss).abs() <= 1e-10 * rss.max(1.0));
        prop_assert!(step.certificate.correlation <= 1e-12, "{}", step.certificate.correlation);
    }
}

/// Of 24 columns with nearly equal ones among them: the conditions of the minimum, and what the interior-point solver finds.
#[test]
fn many_columns_agree_with_interior_point() {
    let p = 24;
    for seed in 0..8 {
        let rows = {
            let base = rows(seed, 400, p, 0.5);
            Mat::from_fn(400, p + 1, |i, j| if j == 7 { base[(i, 4)] + 1e-4 * base[(i, 7)] } else { base[(i, j)] })
        };
        let bounds: Vec<[f64; 2]> =
            (0..p).map(|j| bound((j * 7 + seed as usize) % 6, 10_f64.powi(1 - j as i32 % 3))).collect();
        let problem = compressed(&rows, 1, false);
        let models = optimize(&problem, 0, &Optimizer::LeastSquares, &bounded(&bounds)).unwrap();
        let step = models.choice();
        assert!(step.certificate.correlation <= 1e-11, "{seed}: {}", step.certificate.correlation);
        let other = interior_point(&rows, &bounds);
        let scale = |j: usize| 10_f64.powi(j as i32 % 3 - 1);
        let held = step.coefficients.iter().zip(&bounds).filter(|(b, bounds)| bounds.contains(b)).count();
        assert!(held >= 6, "{seed}: the bounds hold {held}");
        for j in 0..p {
            // Along the pair of nearly equal columns the interior point's active set is as good as its certificate, 1e-8.
            let level = if j == 4 || j == 7 { 1e-3 } else { 1e-6 };
            assert!(
                (step.coefficients[j] - other[j]).abs() * scale(j) < level,
                "{seed} {j}: {} {}",
                step.coefficients[j],
                other[j]
            );
        }
    }
}

/// Solution of the constrained fit of structured regressions.
fn interior_point(rows: &Mat<f64>, bounds: &[[f64; 2]]) -> Vec<f64> {
    let p = bounds.len();
    let mut factor = Factor::new(p, 1);
    factor.push(rows.as_ref(), None);
    let task = TaskShape { latents: vec![0], centred: false, prior: false };
    let structure = Structure { functions: vec![p], tasks: vec![task] };
    let assembly = Assembly { weights: vec![1.0], ..Assembly::default() };
    let assembled = assemble(&structure, &[factor.square_root()], &assembly).unwrap();
    let constraints = Constraints { bounds: bounds.to_vec(), ..Constraints::default() };
    let options = ConstrainedOptions::default();
    let fit = constrained(&assembled, &constraints, Strength::lasso(0.0), None, &options).unwrap();
    assert_eq!(fit.status, ConstrainedStatus::Solved);
    fit.theta
}

/// Signs against some of the truth: columns 2 and 7 may not be negative, column 4 not positive.
fn against(p: usize) -> Vec<[f64; 2]> {
    let mut bounds = vec![FREE; p];
    (bounds[2], bounds[4]) = ([0.0, f64::INFINITY], [f64::NEG_INFINITY, 0.0]);
    bounds[5] = [0.02, 0.04];
    bounds
}

fn folds(rows: &Mat<f64>, count: usize) -> Vec<FoldProblem> {
    let part = |fold: usize, inside: bool| {
        let members: Vec<usize> = (0..rows.nrows()).filter(|i| (i % count == fold) == inside).collect();
        compressed(&Mat::from_fn(members.len(), rows.ncols(), |i, j| rows[(members[i], j)]), 1, false)
    };
    (0..count).map(|fold| FoldProblem { train: part(fold, false), test: part(fold, true) }).collect()
}

fn swept(problem: &Compressed, folds: &[FoldProblem], terms: &Terms, optimizer: &Optimizer) -> Sweep {
    let rivals = Rivals { backward: matches!(optimizer, Optimizer::Stlsq(_)), zero: true, alone: None };
    let options = SweepOptions { thresholds: Thresholds::Changes { most: 60 }, rivals, ..SweepOptions::default() };
    sweep(problem, folds, std::slice::from_ref(terms), optimizer, &options, &Silent).unwrap().remove(0)
}

fn keeping() -> Vec<Optimizer> {
    vec![
        Optimizer::Stlsq(Stlsq { alpha: 0.0, scaling: Scaling::Share, ..Stlsq::default() }),
        Optimizer::Stlsq(Stlsq { alpha: 0.5, unbias: false, ..Stlsq::default() }),
        Optimizer::Ssr(Ssr { alpha: 0.0, ..Ssr::default() }),
        Optimizer::Ssr(Ssr { alpha: 0.0, removal: Removal::Residual, ..Ssr::default() }),
        Optimizer::LeastSquares,
    ]
}

#[test]
fn swept_models_are_best_within_bounds() {
    let p = 8;
    let rows = rows(3, 300, p, 0.3);
    let (problem, bounds) = (compressed(&rows, 1, false), against(p));
    for optimizer in keeping() {
        let plain = !matches!(&optimizer, Optimizer::Stlsq(stlsq) if !stlsq.unbias);
        let models = swept(&problem, &folds(&rows, 5), &bounded(&bounds), &optimizer);
        for step in &models.trail.steps {
            assert!(step.support.contains(&5), "the bounds of column 5 exclude 0: {:?}", step.support);
            for (j, b) in step.coefficients.iter().enumerate() {
                assert!(bounds[j][0] <= *b && *b <= bounds[j][1], "{optimizer:?} {j}: {b}");
                assert_eq!(step.support.contains(&j), *b != 0.0);
            }
            assert!(step.certificate.correlation < 1e-11, "{optimizer:?}: {}", step.certificate.correlation);
            if plain {
                let design = Mat::from_fn(300, step.terms() + 1, |i, k| rows[(i, *step.support.get(k).unwrap_or(&p))]);
                let limits: Vec<[f64; 2]> = step.support.iter().map(|&j| bounds[j]).collect();
                let (_, rss) = by_trial(&design, &limits);
                assert!((step.rss - rss).abs() <= 1e-10 * rss, "{optimizer:?}: {} {rss}", step.rss);
            }
        }
        if matches!(optimizer, Optimizer::LeastSquares) {
            continue;
        }
        // Backward from 8 terms, of which some are held at 0, to one.
        let sizes: Vec<usize> = models.trail.steps.iter().map(|step| step.terms()).collect();
        assert!(sizes.contains(&2) && sizes.contains(&4), "{optimizer:?}: {sizes:?}");
    }
}

/// The held-out error of a model is that of the bounded fit of its terms to the training rows.
#[test]
fn held_out_errors_match_bounded_fits() {
    let p = 6;
    let rows = rows(11, 120, p, 1.0);
    let (problem, bounds) = (compressed(&rows, 1, false), against(p));
    let models = swept(&problem, &folds(&rows, 4), &bounded(&bounds), &keeping()[0]);
    let scores = models.folds.as_ref().unwrap();
    let mut moved = 0;
    for (k, step) in models.trail.steps.iter().enumerate() {
        for fold in 0..4 {
            let part = |inside: bool| -> Vec<usize> { (0..120).filter(|i| (i % 4 == fold) == inside).collect() };
            let (train, test) = (part(false), part(true));
            let design_of = |rows_of: &[usize]| {
                Mat::from_fn(rows_of.len(), step.terms() + 1, |i, c| {
                    rows[(rows_of[i], *step.support.get(c).unwrap_or(&p))]
                })
            };
            let limits: Vec<[f64; 2]> = step.support.iter().map(|&j| bounds[j]).collect();
            let (b, _) = by_trial(&design_of(&train), &limits);
            moved += usize::from(b.iter().zip(&limits).any(|(b, limits)| limits.contains(b)));
            let test = design_of(&test);
            let square = |i: usize| {
                (test[(i, step.terms())] - (0..step.terms()).map(|c| test[(i, c)] * b[c]).sum::<f64>()).powi(2)
            };
            let error = (0..test.nrows()).map(square).sum::<f64>() / test.nrows() as f64;
            assert!(
                (scores.errors[(k, fold)] - error).abs() <= 1e-9 * error,
                "{k} {fold}: {} {error}",
                scores.errors[(k, fold)]
            );
        }
    }
    assert!(moved > 10, "{moved} fits of folds were held by a bound");
}

#[test]
fn bounds_that_hold_nothing_change_no_bit() {
    let rows = rows(5, 200, 8, 0.2);
    let (problem, folds) = (compressed(&rows, 1, false), folds(&rows, 5));
    for optimizer in keeping() {
        let free = swept(&problem, &folds, &Terms::all(), &optimizer);
        let wide = swept(&problem, &folds, &bounded(&[[-1e3, 1e3]; 8]), &optimizer);
        assert_eq!(free, wide, "{optimizer:?}");
    }
}

#[test]
fn methods_without_bounds_refuse_them() {
    let rows = rows(5, 50, 4, 0.2);
    let problem = compressed(&rows, 1, false);
    let bounds = vec![[0.0, f64::INFINITY]; 4];
    for optimizer in
        [Optimizer::Sr3(Sr3::default()), Optimizer::Frols(Frols::default()), Optimizer::Path(PenalisedPath::default())]
    {
        let error = optimize(&problem, 0, &optimizer, &bounded(&bounds)).unwrap_err();
        assert!(matches!(error, ThresholdError::BoundsNotKept { .. }), "{error}");
        assert!(error.to_string().contains("stlsq"), "{error}");
    }
    let least = |terms: &Terms| optimize(&problem, 0, &Optimizer::LeastSquares, terms).unwrap_err().to_string();
    assert!(least(&bounded(&[[1.0, 0.0]; 4])).contains("between 1 and 0"));
    assert!(least(&bounded(&[[f64::NAN, 0.0]; 4])).contains("column 0"));
    assert!(least(&bounded(&bounds[1..])).contains("bounds"));
}
