//! Thresholding and greedy selection: certificates, sweeps, ensembles, and laws.

use faer::Mat;
use fleetfoot_data::{Silent, mix, with_threads};
use fleetfoot_sparse::{
    Penalty, Quadratic,
    lars::{LarsOptions, lars},
    threshold::{
        Choice, Criterion, CriterionOptions, EnsembleOptions, FoldProblem, Frols, FrolsChoice, Optimizer,
        PenalisedPath, Regularizer, Removal, Scaling, Sr3, Ssr, Status, Stlsq, SweepOptions, Terms, ThresholdError,
        Thresholds, ensemble, optimize, sweep, sweep_thresholds,
    },
};
use fleetfoot_stats::{Compressed, Factor};
use proptest::prelude::*;

/// The statistic of rows `[x y]` with q targets.
pub(crate) fn compressed(rows: &Mat<f64>, targets: usize, constant: bool) -> Compressed {
    let mut factor = Factor::new(rows.ncols() - targets, targets);
    factor.push(rows.as_ref(), None);
    factor.square_root().compressed(constant)
}

/// Numbers in (-1, 1) from a key.
fn noise(key: u64) -> f64 {
    (mix(key) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// n rows of p columns and targets that depend on a few of them: target t on columns t, t + 2 and t + 3.
fn rows(seed: u64, n: usize, p: usize, targets: usize, error: f64) -> Mat<f64> {
    let x = |i: usize, j: usize| {
        let uniform = noise(seed ^ ((i * 131 + j) as u64 + 1).wrapping_mul(0x9e37_79b9));
        (1.0 + j as f64) * (uniform + 0.4 * noise(seed ^ (i as u64) << 32))
    };
    Mat::from_fn(n, p + targets, |i, j| match j.checked_sub(p) {
        None => x(i, j),
        Some(t) => {
            let truth = 1.5 * x(i, t) - 0.7 * x(i, t + 2) + 0.4 * x(i, t + 3);
            truth + error * noise(seed ^ ((t * 7919 + i) as u64) << 20)
        }
    })
}

fn every_optimizer() -> Vec<Optimizer> {
    let relaxed = Sr3 { lambda: 0.02, unbias: true, ..Sr3::default() };
    vec![
        Optimizer::LeastSquares,
        Optimizer::Stlsq(Stlsq::default()),
        Optimizer::Stlsq(Stlsq { threshold: 0.02, scaling: Scaling::Share, ..Stlsq::default() }),
        Optimizer::Sr3(relaxed.clone()),
        Optimizer::Sr3(Sr3 { regularizer: Regularizer::L1, ..relaxed }),
        Optimizer::Ssr(Ssr::default()),
        Optimizer::Ssr(Ssr { removal: Removal::Residual, ..Ssr::default() }),
        Optimizer::Frols(Frols::default()),
        Optimizer::Path(PenalisedPath::default()),
    ]
}

#[test]
fn models_are_certified_and_errors_match_rows() {
    let data = rows(3, 200, 8, 2, 0.3);
    let problem = compressed(&data, 2, true);
    for optimizer in every_optimizer() {
        for target in 0..2 {
            let trail = optimize(&problem, target, &optimizer, &Terms::all()).expect("models");
            for step in &trail.steps {
                assert!(step.certificate.correlation < 1e-13, "{optimizer:?}: {:?}", step.certificate);
                assert!(step.certificate.dropped < 1.0 && step.certificate.kept >= 1.0);
                let error = |i: usize| {
                    let fit: f64 = (1..9).map(|j| step.coefficients[j] * data[(i, j - 1)]).sum();
                    (data[(i, 8 + target)] - step.coefficients[0] - fit).powi(2)
                };
                let direct: f64 = (0..200).map(error).sum();
                assert!((step.rss - direct).abs() < 1e-10 * direct, "{} {direct}", step.rss);
                let outside = |j: &usize| !step.support.contains(j);
                assert!((0..9).filter(outside).all(|j| step.coefficients[j] == 0.0));
            }
        }
    }
}

/// A sign and its cube, in units of their own: which of the two is a bit better is rounding, and the library's first is taken.
#[test]
fn the_first_of_equal_terms_is_taken() {
    for seed in 0..40 {
        let mut data = rows(seed, 150, 5, 1, 0.1);
        let unit = 1.0 + noise(seed).abs();
        for i in 0..150 {
            let sign = data[(i, 0)].signum();
            (data[(i, 1)], data[(i, 4)]) = (sign, unit * sign);
            data[(i, 5)] += 3.0 * sign;
        }
        let frols = Frols { max_terms: 4, choice: FrolsChoice::Last, ..Frols::default() };
        let trail = optimize(&compressed(&data, 1, true), 0, &Optimizer::Frols(frols), &Terms::all()).expect("models");
        assert!(trail.order[0] == 2 && !trail.order.contains(&5), "{seed}: {:?}", trail.order);
    }
}

#[test]
fn reduction_ratios_equal_error_decreases() {
    let data = rows(5, 300, 9, 1, 0.2);
    let problem = compressed(&data, 1, true);
    let total: f64 = (0..300).map(|i| data[(i, 9)].powi(2)).sum();
    let frols = Frols { max_terms: 10, choice: FrolsChoice::ErrorSum(0.05), ..Frols::default() };
    let trail = optimize(&problem, 0, &Optimizer::Frols(frols), &Terms::all()).expect("models");
    assert_eq!((trail.steps.len(), trail.order.len()), (11, 10));
    for pair in trail.steps.windows(2) {
        let err = pair[1].err.as_ref().and_then(|err| err.last()).expect("a ratio");
        assert!(((pair[0].rss - pair[1].rss) / total - err).abs() < 1e-12);
    }
    let left: Vec<f64> = trail.steps.iter().map(|step| step.rss / total).collect();
    assert!(left[trail.chosen] <= 0.05 && left[trail.chosen - 1] > 0.05, "{left:?}");
    let bic = FrolsChoice::Criterion(Criterion::Bic, CriterionOptions::default());
    let frols = Frols { choice: bic, ..Frols::default() };
    let trail = optimize(&problem, 0, &Optimizer::Frols(frols), &Terms::all()).expect("models");
    assert_eq!(trail.choice().support, [1, 3, 4]);
    // Fixed terms come first, and are not counted.
    let fixed = Terms { fixed: vec![7, 2], ..Terms::all() };
    let frols = Frols { max_terms: 2, choice: FrolsChoice::Last, ..Frols::default() };
    let trail = optimize(&problem, 0, &Optimizer::Frols(frols), &fixed).expect("models");
    assert_eq!((trail.steps.len(), &trail.order[..2]), (3, &[2, 7][..]));
    assert_eq!(trail.steps[0].support, [2, 7]);
}

#[test]
fn dependent_columns_are_named_and_get_the_least_norm() {
    let plain = rows(7, 60, 5, 1, 0.1);
    // The last column is the first one doubled.
    let data = Mat::from_fn(60, 7, |i, j| match j {
        5 => 2.0 * plain[(i, 0)],
        6 => plain[(i, 5)],
        _ => plain[(i, j)],
    });
    let problem = compressed(&data, 1, false);
    let alone = optimize(&compressed(&plain, 1, false), 0, &Optimizer::LeastSquares, &Terms::all()).expect("a model");
    let trail = optimize(&problem, 0, &Optimizer::LeastSquares, &Terms::all()).expect("a model");
    let (step, alone) = (trail.choice(), alone.choice());
    assert_eq!(step.confounded, [vec![0, 5]]);
    // Both carry half of what the one carried.
    assert!((step.coefficients[0] - 0.5 * alone.coefficients[0]).abs() < 1e-10);
    assert!((2.0 * step.coefficients[5] - 0.5 * alone.coefficients[0]).abs() < 1e-10);
    assert!((step.rss - alone.rss).abs() < 1e-10 * alone.rss);
    for optimizer in every_optimizer() {
        let models = optimize(&problem, 0, &optimizer, &Terms::all()).expect("a model");
        assert!(models.choice().coefficients.iter().all(|value| value.is_finite()), "{optimizer:?}");
    }
    // Fewer rows than columns.
    let wide = compressed(&rows(8, 4, 9, 1, 0.1), 1, true);
    for optimizer in every_optimizer() {
        let models = optimize(&wide, 0, &optimizer, &Terms::all()).expect("a model");
        assert!(models.steps.iter().all(|step| step.rss.is_finite()), "{optimizer:?}");
    }
}

#[test]
fn a_free_constant_is_a_free_intercept_for_the_lasso() {
    let data = rows(11, 80, 6, 1, 0.3);
    let mut factor = Factor::new(6, 1);
    factor.push(data.as_ref(), None);
    let root = factor.square_root();
    let centred = Quadratic::from_square_root(&root, 0).expect("a problem");
    let path = lars(&centred, &Penalty::default(), &LarsOptions::default()).expect("a path");
    let lasso = PenalisedPath { standardise: false, refit: false, ..PenalisedPath::default() };
    let constant = Terms { fixed: vec![0], ..Terms::all() };
    let trail = optimize(&root.compressed(true), 0, &Optimizer::Path(lasso), &constant).expect("a path");
    assert_eq!(trail.steps.len(), path.knots.len());
    for (step, knot) in trail.steps.iter().zip(&path.knots) {
        assert!((step.parameter - knot.l1).abs() < 1e-12 && (step.coefficients[0] - knot.intercept).abs() < 1e-11);
        assert!((1..7).all(|j| (step.coefficients[j] - knot.coefficient(j - 1)).abs() < 1e-11));
    }
}

#[test]
fn allowed_and_fixed_terms_are_kept_to() {
    let problem = compressed(&rows(13, 100, 7, 1, 0.3), 1, true);
    let allowed: Vec<bool> = (0..8).map(|j| j != 1 && j != 6).collect();
    let terms = Terms { allowed: Some(allowed), fixed: vec![5, 0], ..Terms::all() };
    for optimizer in every_optimizer() {
        let trail = optimize(&problem, 0, &optimizer, &terms).expect("models");
        for step in &trail.steps {
            assert!(step.support.contains(&0) && step.support.contains(&5), "{optimizer:?} {:?}", step.support);
            assert!(!step.support.contains(&1) && !step.support.contains(&6));
        }
    }
    let huge = Optimizer::Stlsq(Stlsq { threshold: 1e6, ..Stlsq::default() });
    let models = optimize(&problem, 0, &huge, &terms).expect("a model");
    assert_eq!((models.choice().support.as_slice(), models.choice().status), (&[0, 5][..], Status::Empty));
    let wrong = Terms { allowed: Some(vec![false; 8]), fixed: vec![2], ..Terms::all() };
    assert_eq!(optimize(&problem, 0, &huge, &wrong), Err(ThresholdError::FixedNotAllowed { column: 2 }));
    let beyond = Terms { fixed: vec![9], ..Terms::all() };
    assert!(matches!(optimize(&problem, 0, &huge, &beyond), Err(ThresholdError::NoSuchColumn { column: 9, .. })));
    assert!(optimize(&problem, 1, &huge, &Terms::all()).is_err());
    let negative = Optimizer::Stlsq(Stlsq { threshold: -0.1, ..Stlsq::default() });
    assert!(matches!(optimize(&problem, 0, &negative, &Terms::all()), Err(ThresholdError::Negative { .. })));
}

/// Folds of contiguous rows.
fn folds(data: &Mat<f64>, targets: usize, count: usize) -> Vec<FoldProblem> {
    let n = data.nrows();
    let part = |keep: &dyn Fn(usize) -> bool| {
        let kept: Vec<usize> = (0..n).filter(|&i| keep(i)).collect();
        compressed(&Mat::from_fn(kept.len(), data.ncols(), |i, j| data[(kept[i], j)]), targets, true)
    };
    let test = |fold: usize| move |i: usize| i * count / n == fold;
    (0..count).map(|fold| FoldProblem { train: part(&|i| !test(fold)(i)), test: part(&test(fold)) }).collect()
}

#[test]
fn sweeps_find_the_truth_by_folds_and_by_criteria() {
    let data = rows(17, 400, 9, 3, 1.0);
    let problem = compressed(&data, 3, true);
    let folds = folds(&data, 3, 5);
    let terms = vec![Terms::all(); 3];
    let mut wrong = Vec::new();
    for optimizer in every_optimizer().into_iter().skip(1) {
        for choice in [Choice::Auto, Choice::Criterion(Criterion::Bic), Choice::Criterion(Criterion::Ebic)] {
            let options = SweepOptions { choice, ..SweepOptions::default() };
            let run = || sweep(&problem, &folds, &terms, &optimizer, &options, &Silent).expect("models");
            let result = run();
            for (target, sweep) in result.iter().enumerate() {
                let truth = [1, 3, 4].map(|j| j + target);
                let support = &sweep.choice().support;
                // A criterion lets a column of noise in now and then; what is true is always in.
                // And on the lasso's path one may come in before the last true one does.
                let greedy = !matches!(optimizer, Optimizer::Path(_));
                let more = if choice == Choice::Auto && greedy { 0 } else { 2 };
                if !truth.iter().all(|j| support.contains(j)) || support.len() > 3 + more {
                    wrong.push(format!("{optimizer:?} {choice:?} {target}: {support:?}"));
                }
                let scores = sweep.folds.as_ref().expect("folds");
                assert!(scores.mean[scores.best] <= scores.mean[scores.one_standard_error]);
                // No model dominates one of the front, and every other is dominated or equalled.
                let steps = &sweep.trail.steps;
                for (k, step) in steps.iter().enumerate() {
                    let no_worse = |other: &usize| {
                        let other = &steps[*other];
                        other.terms() <= step.terms() && other.rss <= step.rss.max(sweep.trail.rounding)
                    };
                    let beaten = (0..steps.len()).filter(|&other| other != k).any(|other| no_worse(&other));
                    assert!(sweep.front.contains(&k) || beaten);
                }
            }
            assert_eq!(result, with_threads(3, run));
            assert_eq!(result, with_threads(1, run));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn held_out_errors_match_rows() {
    let data = rows(19, 90, 6, 1, 1.0);
    let problem = compressed(&data, 1, true);
    let folds = folds(&data, 1, 3);
    let thresholds = Thresholds::List(vec![0.05, 0.5, 0.2]);
    let optimizer = Optimizer::Stlsq(Stlsq::default());
    let options = SweepOptions { thresholds, choice: Choice::LeastError, ..SweepOptions::default() };
    let swept_models = sweep(&problem, &folds, &[Terms::all()], &optimizer, &options, &Silent).expect("models");
    let scores = swept_models[0].folds.as_ref().expect("folds");
    for (k, threshold) in [0.5, 0.2, 0.05].into_iter().enumerate() {
        assert_eq!(swept_models[0].trail.steps[k].parameter, threshold);
        for fold in 0..3 {
            // The terms of all rows, refitted on the training rows: whatever the threshold would keep of these.
            let support = &swept_models[0].trail.steps[k].support;
            let terms = Terms { allowed: Some((0..7).map(|j| support.contains(&j)).collect()), ..Terms::all() };
            let model = optimize(&folds[fold].train, 0, &Optimizer::LeastSquares, &terms).expect("a model");
            let b = &model.choice().coefficients;
            let error = |i: usize| (data[(i, 6)] - b[0] - (1..7).map(|j| b[j] * data[(i, j - 1)]).sum::<f64>()).powi(2);
            let direct = (fold * 30..(fold + 1) * 30).map(error).sum::<f64>() / 30.0;
            assert!((scores.errors[(k, fold)] - direct).abs() < 1e-10 * direct);
        }
        let mean = (0..3).map(|fold| scores.errors[(k, fold)]).sum::<f64>() / 3.0;
        assert!((scores.mean[k] - mean).abs() < 1e-12 * mean);
    }
    let none = sweep(&problem, &[], &[Terms::all()], &optimizer, &options, &Silent);
    assert!(matches!(none, Err(ThresholdError::Nothing { .. })), "a choice by folds without folds");
}

#[test]
fn ensembles_are_the_summary_of_their_models() {
    let data = rows(23, 150, 7, 2, 2.0);
    let problem = compressed(&data, 2, true);
    let replicate = |r: u64| {
        let drawn = Mat::from_fn(150, 9, |i, j| data[((mix(r * 1000 + i as u64) % 150) as usize, j)]);
        compressed(&drawn, 2, true)
    };
    let replicates: Vec<Compressed> = (0..12).map(replicate).collect();
    let optimizer = Optimizer::Stlsq(Stlsq { threshold: 0.3, ..Stlsq::default() });
    let terms = vec![Terms::all(), Terms { fixed: vec![0], ..Terms::all() }];
    let options = EnsembleOptions { probability: 0.6, ..EnsembleOptions::default() };
    let summaries = ensemble(&problem, &replicates, &terms, &optimizer, &options, &Silent).expect("an ensemble");
    for (target, summary) in summaries.iter().enumerate() {
        let models: Vec<Vec<f64>> = replicates
            .iter()
            .map(|rows| {
                optimize(rows, target, &optimizer, &terms[target]).expect("a model").choice().coefficients.clone()
            })
            .collect();
        for j in 0..8 {
            let mut values: Vec<f64> = models.iter().map(|model| model[j]).collect();
            let share = values.iter().filter(|value| **value != 0.0).count() as f64 / 12.0;
            assert_eq!((summary.inclusion[j], summary.offered[j]), (share, 12));
            assert!((summary.mean[j] - values.iter().sum::<f64>() / 12.0).abs() < 1e-14);
            values.sort_by(f64::total_cmp);
            assert_eq!(summary.median[j], 0.5 * (values[5] + values[6]));
            let fixed = terms[target].fixed.contains(&j);
            assert_eq!(summary.model.support.contains(&j), share >= 0.6 || fixed);
        }
        assert!(summary.model.certificate.correlation < 1e-13);
    }
    // Over candidates too: every model is offered all but two of them, the same ones from the same seed.
    let options = EnsembleOptions { leave_out: 2, draws: 20, seed: 5, ..EnsembleOptions::default() };
    let run = |options: &EnsembleOptions| ensemble(&problem, &[], &terms, &optimizer, options, &Silent);
    let summaries = run(&options).expect("an ensemble");
    assert_eq!(summaries[0].offered.iter().sum::<usize>(), 20 * 6);
    assert_eq!((summaries[1].offered[0], summaries[1].offered.iter().sum::<usize>()), (20, 20 * 6));
    assert_eq!(summaries, with_threads(1, || run(&options)).expect("an ensemble"));
    let other = run(&EnsembleOptions { seed: 6, ..options.clone() }).expect("an ensemble");
    assert_ne!(summaries[0].offered, other[0].offered);
    let all = run(&EnsembleOptions { leave_out: 8, ..options });
    assert_eq!(all, Err(ThresholdError::Dropped { dropped: 8, candidates: 8 }));
}

#[test]
fn models_without_error_have_no_terms_of_rounding() {
    let data = rows(29, 120, 8, 1, 0.0);
    let problem = compressed(&data, 1, true);
    let folds = folds(&data, 1, 4);
    for optimizer in every_optimizer().into_iter().skip(1) {
        let options = SweepOptions::default();
        let models = sweep(&problem, &folds, &[Terms::all()], &optimizer, &options, &Silent).expect("models");
        assert_eq!(models[0].choice().support, [1, 3, 4], "{optimizer:?}");
        assert_eq!(models[0].criteria.best(Criterion::Bic), models[0].chosen, "{optimizer:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Any threshold's model is one of the two whose thresholds it lies between, and a model stands at a threshold that gives it, as do those around.
    #[test]
    fn changes_are_all_the_changes(seed in 0_u64..10_000, share in 0.0..1.2_f64, index in 0_usize..4) {
        let problem = compressed(&rows(seed, 40, 7, 1, 3.0), 1, true);
        let scaling = [Scaling::Physical, Scaling::Length, Scaling::Share][index % 3];
        let sr3 = Optimizer::Sr3(Sr3 { scaling, max_iterations: 8, ..Sr3::default() });
        let stlsq = Optimizer::Stlsq(Stlsq { scaling, ..Stlsq::default() });
        let optimizer = if index == 3 { sr3 } else { stlsq };
        let changes = Thresholds::Changes { most: 10_000 };
        let all = sweep_thresholds(&problem, 0, &optimizer, &Terms::all(), &changes).expect("models").steps;
        prop_assert!(all[0].support.is_empty() && all.len() > 3);
        let threshold = share * all[0].parameter;
        let list = |list: Vec<f64>| {
            let list = Thresholds::List(list);
            sweep_thresholds(&problem, 0, &optimizer, &Terms::all(), &list).expect("models").steps
        };
        let one = list(vec![threshold]);
        let above = all.iter().rev().find(|step| step.parameter >= threshold);
        let below = all.iter().find(|step| step.parameter <= threshold);
        prop_assert!(above.iter().chain(&below).any(|step| step.support == one[0].support));
        for step in &all {
            for factor in [1.0 - 1e-9, 1.0, 1.0 + 1e-9] {
                let there = &list(vec![step.parameter * factor])[0];
                prop_assert_eq!(&there.support, &step.support);
            }
            let there = &list(vec![step.parameter])[0];
            prop_assert!((there.certificate.kept - step.certificate.kept).abs() <= 1e-9 * step.certificate.kept || there.certificate.kept == step.certificate.kept);
            prop_assert!((there.certificate.dropped - step.certificate.dropped).abs() <= 1e-9);
        }
        // Results taken over from the threshold before equal those of the threshold alone.
        let several = list((0..12).map(|k| threshold * 0.8_f64.powi(k)).collect());
        for step in &several {
            let alone = &list(vec![step.parameter])[0];
            prop_assert_eq!((&step.coefficients, step.iterations), (&alone.coefficients, alone.iterations));
            let close = |a: f64, b: f64| a == b || (a - b).abs() <= 1e-12 * b.abs();
            prop_assert!(close(step.certificate.dropped, alone.certificate.dropped));
            prop_assert!(close(step.certificate.kept, alone.certificate.kept));
        }
    }

    /// The order of the columns does not matter, but for rounding.
    #[test]
    fn columns_may_be_permuted(seed in 0_u64..10_000, key in 0_u64..10_000) {
        let data = rows(seed, 60, 7, 1, 1.0);
        let mut order: Vec<usize> = (0..7).collect();
        order.sort_by_key(|&j| mix(key ^ (j as u64) << 7));
        let turned = Mat::from_fn(60, 8, |i, j| data[(i, order.get(j).copied().unwrap_or(7))]);
        let (a, b) = (compressed(&data, 1, false), compressed(&turned, 1, false));
        for optimizer in every_optimizer() {
            let one = optimize(&a, 0, &optimizer, &Terms::all()).expect("a model");
            let other = optimize(&b, 0, &optimizer, &Terms::all()).expect("a model");
            for j in 0..7 {
                let (value, turned) = (one.choice().coefficients[order[j]], other.choice().coefficients[j]);
                prop_assert!((value - turned).abs() < 1e-9, "{:?}: {} {}", optimizer, value, turned);
            }
        }
    }

    /// Units: twice the target with twice the threshold is twice the model; relative thresholds see no units at all. Powers of two make it exact.
    #[test]
    fn units_scale(seed in 0_u64..10_000, power in -6_i32..7) {
        let data = rows(seed, 50, 6, 1, 1.0);
        let factor = 2.0_f64.powi(power);
        let larger = Mat::from_fn(50, 7, |i, j| if j == 6 { factor * data[(i, j)] } else { data[(i, j)] });
        let (a, b) = (compressed(&data, 1, true), compressed(&larger, 1, true));
        let stlsq = |threshold| Optimizer::Stlsq(Stlsq { threshold, ..Stlsq::default() });
        let one = optimize(&a, 0, &stlsq(0.2), &Terms::all()).expect("a model");
        let other = optimize(&b, 0, &stlsq(0.2 * factor), &Terms::all()).expect("a model");
        prop_assert_eq!(&one.choice().support, &other.choice().support);
        for (value, scaled) in one.choice().coefficients.iter().zip(&other.choice().coefficients) {
            prop_assert!((value * factor - scaled).abs() <= 1e-11 * factor * (1.0 + value.abs()));
        }
        // Columns in other units, a threshold without any.
        let unit = |j: usize| 2.0_f64.powi((j as i32 * power) % 9);
        let scaled = Mat::from_fn(50, 7, |i, j| unit(j) * data[(i, j)]);
        let share = Optimizer::Stlsq(Stlsq { threshold: 0.05, scaling: Scaling::Share, ..Stlsq::default() });
        let one = optimize(&a, 0, &share, &Terms::all()).expect("a model");
        let other = optimize(&compressed(&scaled, 1, true), 0, &share, &Terms::all()).expect("a model");
        prop_assert_eq!(&one.choice().support, &other.choice().support);
        for j in 1..7 {
            let back = other.choice().coefficients[j] * unit(j - 1) / unit(6);
            prop_assert!((one.choice().coefficients[j] - back).abs() < 1e-11);
        }
    }
}
