//! One-step predictions and scores against naive computations.

use crate::common::*;
use fleetfoot_data::{Halo, MemorySource, Silent, Source, with_threads};
use fleetfoot_dynamics::{
    Baseline, Basis, Domain, Error, Predicted, Predictor, PredictorWorkspace, RowStatus, ScoreOptions, Scores, score,
    student_t_95,
};
use fleetfoot_model::{Model, Partition, Prediction, Role, Rule, TrainedEpisode, UnseenLabel};

fn scores(model: &Model, source: &MemorySource) -> Scores {
    score(model, source, &ScoreOptions::default(), &Silent).unwrap()
}

fn predict(model: &Model, source: &MemorySource, episode: usize) -> Predicted {
    let columns: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let predictor = Predictor::new(model, &columns).unwrap();
    let rows = source.episodes()[episode].rows;
    let block = source.read(episode, 0..rows, predictor.halo()).unwrap();
    let mut out = Predicted::default();
    predictor.predict(&block, 0..rows, &mut PredictorWorkspace::default(), &mut out);
    out
}

/// y(k+1) = 0.9 y + 0.5 u + noise, fitted as next value; two episodes.
fn next_value() -> (Model, MemorySource, Vec<[Vec<f64>; 2]>) {
    let columns = vec![column("y", Role::State, false), column("u", Role::Input, false)];
    let mut model = model(
        columns,
        &["y", "u"],
        Partition::whole(),
        vec![("y", Prediction::Next, "lead(y, 1)", vec![(0.1, vec![0.8, 0.6])])],
        &[],
    );
    model.training.target_mean = vec![0.3];
    model.training.target_covariance = vec![4.0];
    let data: Vec<[Vec<f64>; 2]> = [300, 157, 80]
        .iter()
        .enumerate()
        .map(|(e, &rows)| {
            let u: Vec<f64> = (0..rows).map(|k| (k as f64 * 0.1 + e as f64).sin()).collect();
            let mut y = vec![1.0];
            for k in 1..rows {
                y.push(0.9 * y[k - 1] + 0.5 * u[k - 1] + 0.1 * noise((e * 1000 + k) as u64));
            }
            [y, u]
        })
        .collect();
    let source = source(&["y", "u"], 0.02, data.iter().map(|episode| episode.to_vec()).collect());
    (model, source, data)
}

#[test]
fn scores_equal_a_naive_computation() {
    let (model, source, data) = next_value();
    let scores = scores(&model, &source);
    let mut errors: Vec<Vec<f64>> = Vec::new();
    let (mut null, mut persistence, mut velocity, mut velocity_model) = (vec![], vec![], vec![], vec![]);
    for [y, u] in &data {
        let mut expected_errors = Vec::new();
        for k in 0..y.len() - 1 {
            let error = y[k + 1] - (0.1 + 0.8 * y[k] + 0.6 * u[k]);
            expected_errors.push(error);
            null.push(y[k + 1] - 0.3);
            persistence.push(y[k + 1] - y[k]);
            if k > 0 {
                velocity.push(y[k + 1] - (y[k] + (y[k] - y[k - 1])));
                velocity_model.push(error);
            }
        }
        errors.push(expected_errors);
    }
    let all: Vec<f64> = errors.concat();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let mae = |values: &[f64]| mean(&values.iter().map(|v| v.abs()).collect::<Vec<_>>());
    let rmse = |values: &[f64]| mean(&values.iter().map(|v| v * v).collect::<Vec<_>>()).sqrt();
    let close = |a: f64, b: f64| assert!((a - b).abs() <= 1e-12 * b.abs().max(1e-3), "{a} {b}");
    let target = &scores.targets[0];
    assert_eq!(target.name, "next(y)");
    assert_eq!((scores.rows as usize, scores.skipped.border), (all.len(), 3));
    close(target.mae.value, mae(&all));
    close(target.mae_over_null.value, mae(&all) / mae(&null));
    close(target.mae_over_sigma, mae(&all) / 2.0);
    close(target.rmse, rmse(&all));
    close(target.bias, mean(&all));
    close(target.max, all.iter().fold(0.0, |a: f64, b| a.max(b.abs())));
    let y: Vec<f64> = null.iter().map(|v| v + 0.3).collect();
    let spread = mean(&y.iter().map(|v| (v - mean(&y)).powi(2)).collect::<Vec<_>>());
    close(target.r2, 1.0 - rmse(&all).powi(2) / spread);
    close(target.deviation, spread.sqrt());
    close(scores.mahalanobis.value, mae(&all) / 2.0);
    close(scores.mahalanobis_measured, mae(&all) / spread.sqrt());
    let baseline = |which| target.baselines.iter().find(|b| b.baseline == which).unwrap();
    close(baseline(Baseline::Null).mae, mae(&null));
    close(baseline(Baseline::Persistence).mae, mae(&persistence));
    close(baseline(Baseline::Persistence).rmse, rmse(&persistence));
    close(baseline(Baseline::ConstantVelocity).mae, mae(&velocity));
    close(baseline(Baseline::ConstantVelocity).model_mae, mae(&velocity_model));
    assert_eq!(baseline(Baseline::ConstantVelocity).rows as usize, velocity.len());
    // Episodes, and the interval across them.
    assert_eq!((scores.episodes.len(), scores.basis), (3, Basis::Episodes(3)));
    let (mut square, total) = (0.0, all.len() as f64);
    for (episode, errors) in scores.episodes.iter().zip(&errors) {
        close(episode.mae[0], mae(errors));
        close(episode.mahalanobis, mae(errors) / 2.0);
        assert_eq!(episode.rows as usize, errors.len());
        assert!(!episode.in_training);
        square += (errors.len() as f64 * (mae(errors) - mae(&all))).powi(2);
    }
    let half = student_t_95(2) * (1.5 * square).sqrt() / total;
    // Of the logarithm, so that no end is below zero.
    close(target.mae.high, target.mae.value * (half / target.mae.value).exp());
    close(target.mae.low, target.mae.value / (half / target.mae.value).exp());
}

#[test]
fn training_episodes_are_recognised() {
    let (mut model, source, _) = next_value();
    model.training.episodes.push(TrainedEpisode { name: "renamed".into(), ..(&source.episodes()[1]).into() });
    let scores = scores(&model, &source);
    let known: Vec<bool> = scores.episodes.iter().map(|episode| episode.in_training).collect();
    assert_eq!(known, [false, true, false]);
}

#[test]
fn a_single_episode_has_intervals_over_spans() {
    let (model, _, data) = next_value();
    let source = source(&["y", "u"], 0.02, vec![data[0].to_vec()]);
    let scores = scores(&model, &source);
    assert_eq!(scores.basis, Basis::Spans(10));
    let mae = scores.targets[0].mae;
    assert!(mae.low < mae.value && mae.value < mae.high);
    // 299 rows in ten spans of 30 (the last has 29).
    let [y, u] = &data[0];
    let errors: Vec<f64> = (0..299).map(|k| (y[k + 1] - (0.1 + 0.8 * y[k] + 0.6 * u[k])).abs()).collect();
    let square: f64 = errors.chunks(30).map(|span| span.iter().map(|e| e - mae.value).sum::<f64>().powi(2)).sum();
    let half = student_t_95(9) * (10.0 / 9.0 * square).sqrt() / 299.0;
    assert!((mae.high - mae.value * (half / mae.value).exp()).abs() < 1e-12);
}

#[test]
fn the_same_scores_on_any_number_of_threads() {
    let (mut model, source) = random_hybrid(4, 1, 6, 5000);
    model.summaries[0].regions[2].range = vec![[-0.2, 0.2]; 5];
    let run = |threads| with_threads(threads, || score(&model, &source, &ScoreOptions::default(), &Silent)).unwrap();
    let once = run(1);
    assert_eq!(once, run(2));
    assert_eq!(once, run(7));
    assert_eq!(once.rows, 2 * 4999);
    assert!(once.outside_region > 0 && once.outside_training == 0);
    assert_eq!(once.calibration.iter().map(|bin| bin.rows).sum::<u64>(), once.sampled_rows);
    assert!(once.calibration.windows(2).all(|pair| pair[0].input <= pair[1].input));
    let output: f64 = once.calibration.iter().map(|bin| bin.output * bin.rows as f64).sum();
    assert!((output / once.rows as f64 - once.mahalanobis.value).abs() < 1e-12 * once.mahalanobis.value);
}

#[test]
fn predictions_follow_the_regions_in_any_tile() {
    let (model, source) = random_hybrid(4, 1, 6, 300);
    let whole = predict(&model, &source, 1);
    let columns: Vec<Vec<f64>> =
        (0..5).map(|c| source.read(1, 0..300, Halo::default()).unwrap().column(c).to_vec()).collect();
    let partition = &model.partitions[0];
    for row in 0..299 {
        let z: Vec<f64> = (0..4).map(|c| (columns[c][row] - partition.centre[c]) / partition.scale[c]).collect();
        let region = partition.rule.assign_row(&z).unwrap();
        assert_eq!(whole.region[row], region);
        for (t, latent) in model.latents.iter().enumerate() {
            let map = latent.affine().unwrap();
            let coefficients = &map.coefficients[region as usize];
            let expected: f64 =
                map.constants[region as usize] + (0..5).map(|j| coefficients[j] * columns[j][row]).sum::<f64>();
            let predicted = Predicted::equation(&whole.predicted, 300, t)[row];
            assert!((predicted - expected).abs() < 1e-12 * (1.0 + expected.abs()));
            let measured = (columns[t][row + 1] - columns[t][row]) / 0.01;
            assert!((Predicted::equation(&whole.measured, 300, t)[row] - measured).abs() < 1e-9);
        }
        // Unit covariances and zero means: the distance is the length of the regressors.
        let length = columns.iter().map(|c| c[row] * c[row]).sum::<f64>().sqrt();
        assert!((whole.distance[row] - length).abs() < 1e-12 * length);
    }
    assert_eq!(whole.status[299], RowStatus::Border);
    assert!(whole.predicted[299].is_finite(), "the model predicts the last row although nothing measures it");
    // Another cut of the rows gives the same bits.
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let predictor = Predictor::new(&model, &names).unwrap();
    let mut workspace = PredictorWorkspace::default();
    for rows in [0..7, 7..130, 130..131, 131..300] {
        let block = source.read(1, rows.clone(), predictor.halo()).unwrap();
        let mut part = Predicted::default();
        predictor.predict(&block, 0..rows.len(), &mut workspace, &mut part);
        for (at, row) in rows.enumerate() {
            assert_eq!(part.status[at], whole.status[row]);
            assert_eq!(part.distance[at].to_bits(), whole.distance[row].to_bits());
            for t in 0..4 {
                let value = Predicted::equation(&part.predicted, part.rows, t)[at];
                assert_eq!(value.to_bits(), Predicted::equation(&whole.predicted, 300, t)[row].to_bits());
            }
        }
    }
}

#[test]
fn the_place_in_the_training_domain() {
    let (mut model, _, _) = next_value();
    {
        let region = &mut model.summaries[0].regions[0];
        region.mean = vec![1.0, -1.0];
        region.covariance = vec![4.0, 1.0, 1.0];
        region.range = vec![[-2.0, 3.0], [-2.0, 2.0]];
    }
    let source = source(&["y", "u"], 0.02, vec![vec![vec![1.0, 3.0, 3.1, 0.0], vec![-1.0, 2.0, 0.0, f64::NAN]]]);
    let predicted = predict(&model, &source, 0);
    assert_eq!(predicted.distance[0], 0.0);
    // (2, 3) under [[4, 1], [1, 1]]: (4 - 12 + 36) / 3.
    assert!((predicted.distance[1] - (28.0f64 / 3.0).sqrt()).abs() < 1e-12);
    assert_eq!(predicted.domain, [Domain::Inside, Domain::Inside, Domain::OutsideTraining, Domain::Inside]);
    assert_eq!(predicted.status[3], RowStatus::Border);
    assert!(predicted.distance[3].is_nan());
}

#[test]
fn unscored_rows_are_counted_by_reason() {
    let columns = vec![
        column("y", Role::State, false),
        column("u", Role::Input, false),
        column("ground", Role::Auxiliary, false),
    ];
    let rule = Rule::Labels {
        values: vec![1.0, 2.0],
        names: vec!["1".into(), "2".into()],
        rules: vec![Rule::Whole, Rule::Whole],
        unseen: UnseenLabel::Refuse,
    };
    let mut model = model(
        columns,
        &["lag(y, 2)", "u"],
        partition(&["ground"], &[0.0], &[1.0], rule),
        vec![("y", Prediction::Next, "lead(y, 1)", vec![(0.0, vec![0.5, 0.1]), (0.0, vec![0.5, 1e300])])],
        &[],
    );
    model.training.target_covariance = vec![1.0];
    let rows = 50;
    let y: Vec<f64> = (0..rows).map(|k| if k == 20 { f64::NAN } else { noise(k) }).collect();
    let u: Vec<f64> = (0..rows).map(|k| if k == 40 { 1e10 } else { 1.0 }).collect();
    let ground: Vec<f64> = (0..rows)
        .map(|k| {
            if k == 30 {
                5.0
            } else if k == 40 {
                2.0
            } else {
                1.0
            }
        })
        .collect();
    let source =
        source(&["y", "u", "ground"], 0.1, vec![vec![y, u, ground], vec![vec![1.0; 3], vec![1.0; 3], vec![1.0; 3]]]);
    let scores = scores(&model, &source);
    // Border: rows 0, 1, 49, and all of an episode of three rows. Missing: rows 19 (target) and 22 (lag).
    assert_eq!(scores.skipped.border, 6);
    assert_eq!(scores.skipped.missing, 2);
    assert_eq!(scores.skipped.no_region, 1);
    assert_eq!(scores.skipped.non_finite, 1);
    assert_eq!(scores.rows, 53 - 10);
    assert_eq!(scores.episodes.len(), 1);
    assert_eq!(scores.basis, Basis::Spans(10));
}

#[test]
fn the_baselines_of_derivatives_and_differences() {
    let columns = || vec![column("y", Role::State, false)];
    let y: Vec<f64> = (0..100).map(noise).collect();
    let source = source(&["y"], 0.5, vec![vec![y.clone()]]);
    let fit = |prediction, target| {
        model(columns(), &["y"], Partition::whole(), vec![("y", prediction, target, vec![(0.0, vec![0.0])])], &[])
    };
    let mae = |values: Vec<f64>| values.iter().map(|v| v.abs()).sum::<f64>() / values.len() as f64;
    let scores_of = |model: &Model, which| {
        let scores = scores(model, &source);
        let baseline = scores.targets[0].baselines.iter().find(|b| b.baseline == which).unwrap();
        (baseline.mae, baseline.rows)
    };
    let check = |(value, rows): (f64, u64), expected: Vec<f64>| {
        assert_eq!(rows as usize, expected.len());
        assert!((value - mae(expected)).abs() < 1e-12);
    };
    let slope = |k: usize| (y[k + 1] - y[k]) / 0.5;
    let derivative = fit(Prediction::Derivative, "forward(y)");
    check(scores_of(&derivative, Baseline::Persistence), (1..99).map(|k| slope(k) - slope(k - 1)).collect());
    check(scores_of(&derivative, Baseline::ConstantVelocity), (0..99).map(slope).collect());
    let difference = fit(Prediction::Difference, "lead(y, 1) - y");
    check(scores_of(&difference, Baseline::Persistence), (0..99).map(|k| 0.5 * slope(k)).collect());
    check(
        scores_of(&difference, Baseline::ConstantVelocity),
        (1..99).map(|k| 0.5 * (slope(k) - slope(k - 1))).collect(),
    );
}

#[test]
fn angles_are_compared_the_short_way_round() {
    let columns = vec![column("yaw", Role::State, true)];
    let fitted = vec![("yaw", Prediction::Next, "lead(yaw, 1)", vec![(0.02, vec![1.0])])];
    let model = model(columns, &["yaw"], Partition::whole(), fitted, &[]);
    let pi = std::f64::consts::PI;
    // Steps of 0.01 rad across pi; the model predicts steps of 0.02.
    let yaw: Vec<f64> = (0..400).map(|k| (2.0 + 0.01 * f64::from(k) + pi).rem_euclid(2.0 * pi) - pi).collect();
    let source = source(&["yaw"], 0.01, vec![vec![yaw]]);
    let scores = scores(&model, &source);
    let target = &scores.targets[0];
    assert!((target.max - 0.01).abs() < 1e-12 && (target.bias + 0.01).abs() < 1e-12);
    for baseline in &target.baselines[1..] {
        let expected = if baseline.baseline == Baseline::Persistence { 0.01 } else { 0.0 };
        assert!((baseline.mae - expected).abs() < 1e-12, "{baseline:?}");
    }
}

#[test]
fn rows_that_cannot_be_scored_give_nan() {
    let (model, _, _) = next_value();
    let empty = source(&["y", "u"], 0.02, vec![vec![vec![1.0], vec![1.0]]]);
    let scores = scores(&model, &empty);
    assert_eq!((scores.rows, scores.skipped.border), (0, 1));
    assert!(scores.targets[0].mae.value.is_nan() && scores.calibration.is_empty());
    let strange = source(&["y", "v"], 0.02, vec![vec![vec![1.0], vec![1.0]]]);
    let error = score(&model, &strange, &ScoreOptions::default(), &Silent).unwrap_err();
    assert!(matches!(error, Error::UnknownColumn(_)) && error.to_string().contains("`u`"), "{error}");
    let mut given = model.clone();
    given.equations[0].target = None;
    given.training.target_mean.clear();
    given.training.target_covariance.clear();
    given.training.target_deviation.clear();
    given.summaries[0].regions[0].residual_covariance.clear();
    assert!(matches!(score(&given, &empty, &ScoreOptions::default(), &Silent), Err(Error::NothingFitted)));
}
