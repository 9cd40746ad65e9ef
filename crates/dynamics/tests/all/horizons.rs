//! Scores of rollouts against the horizon: by step, over whole rollouts, and where which baseline is better.

use crate::{common::*, rollouts::*};
use fleetfoot_data::{Silent, Source};
use fleetfoot_dynamics::{Baseline, Basis, Error, Method, Start, Starts, rollout};
use fleetfoot_model::{Partition, Prediction, Role};

#[test]
fn a_perfect_model_is_useful_over_the_whole_horizon() {
    let w = 3.0;
    let source = oscillator_source(w, 0.01, 600);
    let mut model = oscillator(w);
    model.training.state_covariance = vec![0.5, 0.0, 4.5];
    let rollouts = rollout(&model, &source, &Starts::Even(50), &options(100, Method::Rk4), &Silent).unwrap();
    let useful = rollouts.horizon.useful;
    assert_eq!((useful.steps, useful.beaten_by), (100, None));
    assert!((useful.seconds - 1.0).abs() < 1e-12);
    assert_eq!(rollouts.horizon.basis, Basis::Starts(50));
    assert_eq!(rollouts.horizon.baselines.len(), 3);
    // Persistence by hand at step 30.
    let x = |t: f64| [(w * t).cos(), -w * (w * t).sin()];
    let mut square = [0.0; 2];
    for outcome in &rollouts.outcomes {
        let t = outcome.start.row as f64 * 0.01;
        (0..2).for_each(|s| square[s] += (x(t + 0.3)[s] - x(t)[s]).powi(2) / 50.0);
    }
    let persistence = &rollouts.horizon.baselines.iter().find(|b| b.0 == Baseline::Persistence).unwrap().1;
    for s in 0..2 {
        assert!((persistence.rmse[29 * 2 + s] - square[s].sqrt()).abs() < 1e-9);
    }
    // Constant velocity is of second order for small times.
    let velocity = &rollouts.horizon.baselines.iter().find(|b| b.0 == Baseline::ConstantVelocity).unwrap().1;
    assert!(velocity.rmse[0] < 0.1 * persistence.rmse[0]);
}

/// A model that loses the first steps and wins the others is reported as better in these.
#[test]
fn spans_of_better_rollouts_are_reported_per_baseline() {
    // The recording stands still for a step and then rises by 1 a second; the model rises from the start, so the baselines win the first step alone.
    let columns = vec![column("x", Role::State, false)];
    let fitted = vec![("x", Prediction::Derivative, "forward(x)", vec![(1.0, vec![])])];
    let mut model = model(columns, &[], Partition::whole(), fitted, &[]);
    model.training.target_mean = vec![0.0];
    let x: Vec<f64> = (0..40).map(|k| if k < 12 { 0.0 } else { 0.1 * f64::from(k - 11) + 0.02 }).collect();
    let roll = |x: Vec<f64>| {
        let source = source(&["x"], 0.1, vec![vec![x]]);
        let starts = Starts::At(vec![Start { episode: 0, row: 10 }]);
        rollout(&model, &source, &starts, &options(20, Method::Euler), &Silent).unwrap().horizon
    };
    let horizon = roll(x.clone());
    let (useful, spans) = (&horizon.useful, |baseline| &horizon.better.iter().find(|b| b.0 == baseline).unwrap().1);
    assert_eq!((useful.steps, useful.seconds, useful.compared), (0, 0.0, 20));
    for span in [&useful.spans, spans(Baseline::Persistence), spans(Baseline::ConstantVelocity)] {
        assert_eq!(span.len(), 1);
        assert_eq!((span[0].first, span[0].last), (2, 20));
        assert!((span[0].from - 0.2).abs() < 1e-12 && (span[0].to - 2.0).abs() < 1e-12);
    }
    // Rows without measurements have no scores: every third row, then none.
    let sparse = |k: usize| k <= 10 || k % 3 == 2;
    let some = x.iter().enumerate().map(|(k, &x)| if sparse(k) { x } else { f64::NAN }).collect();
    let some = roll(some).useful;
    assert_eq!((some.compared, some.spans.len(), some.spans[0].first, some.spans[0].last), (7, 1, 4, 19));
    let none = roll(x.iter().enumerate().map(|(k, &x)| if k <= 10 { x } else { f64::NAN }).collect()).useful;
    assert_eq!((none.compared, none.steps, none.beaten_by, none.spans.len()), (0, 0, None, 0));
}

#[test]
fn horizon_scores_equal_a_naive_computation() {
    let (mut model, _) = random_hybrid(3, 1, 4, 10);
    // A known state, so that the null model has a given equation to integrate.
    model.equations[0].target = None;
    model.equations[0].right = parse("x1");
    model.training.target_mean = vec![0.4, -0.3];
    model.training.target_covariance = identity(2, 1.0);
    model.training.target_deviation = vec![1.0; 2];
    model.training.state_covariance = vec![2.0, 0.5, 1.0, -0.2, 0.1, 0.7];
    for region in &mut model.summaries[0].regions {
        region.residual_covariance = identity(2, 1.0);
    }
    let episode = |e: usize, rows: usize| -> Vec<Vec<f64>> {
        (0..4)
            .map(|j| (0..rows).map(|k| (k as f64 * (0.05 + 0.01 * j as f64) + (3 * e + j) as f64).sin()).collect())
            .collect()
    };
    let source = source(&["x0", "x1", "x2", "u0"], 0.01, vec![episode(0, 90), episode(1, 200), episode(2, 130)]);
    let mut options = options(40, Method::Euler);
    options.keep = true;
    let rollouts = rollout(&model, &source, &Starts::Even(60), &options, &Silent).unwrap();
    assert_eq!((rollouts.horizon.basis, rollouts.trajectories.len()), (Basis::Episodes(3), 60));
    assert_eq!(rollouts.diverged(), 0);

    // S^-1 by cofactors.
    let s = [[2.0, 0.5, -0.2], [0.5, 1.0, 0.1], [-0.2, 0.1, 0.7f64]];
    let minor = |i: usize, j: usize| {
        let (r, c) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
        s[r[0]][c[0]] * s[r[1]][c[1]] - s[r[0]][c[1]] * s[r[1]][c[0]]
    };
    let determinant: f64 = (0..3).map(|j| s[0][j] * minor(0, j)).sum();
    let score = |e: [f64; 3]| -> f64 {
        let mut sum = 0.0;
        for i in 0..3 {
            for j in 0..3 {
                sum += e[i] * e[j] * minor(j, i) / determinant;
            }
        }
        sum.sqrt()
    };
    let k = 25;
    let mut predictors = vec![Vec::new(); 4];
    for trajectory in &rollouts.trajectories {
        let Start { episode, row } = trajectory.start;
        let block = source.read(episode, 0..source.episodes()[episode].rows, Default::default()).unwrap();
        let at = |row: usize| -> [f64; 3] { std::array::from_fn(|i| block.column(i)[row]) };
        let (first, before, measured) = (at(row), at(row - 1), at(row + k));
        // The null model: x1' and x2' constant, x0' = x1, in Euler steps.
        let mut null = first;
        for _ in 0..k {
            null = [null[0] + 0.01 * null[1], null[1] + 0.01 * 0.4, null[2] - 0.01 * 0.3];
        }
        let t = k as f64 * 0.01;
        let velocity: [f64; 3] = std::array::from_fn(|i| first[i] + t * (first[i] - before[i]) / 0.01);
        let model: [f64; 3] = std::array::from_fn(|i| trajectory.state(k)[i]);
        for (predictor, value) in predictors.iter_mut().zip([model, null, first, velocity]) {
            let error: [f64; 3] = std::array::from_fn(|i| measured[i] - value[i]);
            predictor.push((episode, error));
        }
    }
    let horizon = &rollouts.horizon;
    assert!((horizon.time[k - 1] - 0.25).abs() < 1e-12);
    let scores = std::iter::once(&horizon.model).chain(horizon.baselines.iter().map(|b| &b.1));
    for (errors, scored) in predictors.iter().zip(scores) {
        for i in 0..3 {
            let mae = errors.iter().map(|(_, e)| e[i].abs()).sum::<f64>() / 60.0;
            let rmse = (errors.iter().map(|(_, e)| e[i] * e[i]).sum::<f64>() / 60.0).sqrt();
            assert!((scored.mae[(k - 1) * 3 + i] - mae).abs() < 1e-12);
            assert!((scored.rmse[(k - 1) * 3 + i] - rmse).abs() < 1e-12);
        }
        let mean = errors.iter().map(|(_, e)| score(*e)).sum::<f64>() / 60.0;
        let square: f64 = (0..3)
            .map(|episode| {
                let errors_of_episode = errors.iter().filter(|(e, _)| *e == episode);
                errors_of_episode.map(|(_, e)| score(*e) - mean).sum::<f64>().powi(2)
            })
            .sum();
        let half = fleetfoot_dynamics::student_t_95(2) * (1.5 * square).sqrt() / 60.0;
        let estimate = scored.mahalanobis[k - 1];
        assert!((estimate.value - mean).abs() < 1e-10 * mean, "{} {mean}", estimate.value);
        assert!((estimate.high - mean - half).abs() < 1e-9 && (mean - estimate.low - half).abs() < 1e-9);
    }
}

/// Two rollouts of a model that stands still while the truth moves by 3 and 4 a step: distances of 5 a step.
#[test]
fn displacements_are_reported_by_step_and_rollout() {
    let columns = vec![column("x", Role::State, false), column("y", Role::State, false)];
    let still = || vec![(0.0, vec![0.0, 0.0])];
    let fitted = vec![("x", Prediction::Derivative, "1", still()), ("y", Prediction::Derivative, "1", still())];
    let model = model(columns, &["x", "y"], Partition::whole(), fitted, &[]);
    let line = |slope: f64| (0..8).map(|k| slope * f64::from(k)).collect::<Vec<f64>>();
    let source = source(&["x", "y"], 0.5, vec![vec![line(3.0), line(4.0)], vec![line(-3.0), line(4.0)]]);
    let mut options = options(4, Method::Euler);
    options.position = vec!["x".into(), "y".into()];
    let horizon = rollout(&model, &source, &Starts::Even(4), &options, &Silent).unwrap().horizon;
    for (k, distance) in horizon.model.displacement.iter().enumerate() {
        assert!((distance.value - 5.0 * (k + 1) as f64).abs() < 1e-12 && distance.high - distance.value < 1e-9);
    }
    let summary = horizon.model.displacement_summary.unwrap();
    for (estimate, value) in [(summary.average, 12.5), (summary.last, 20.0), (summary.drift, 10.0)] {
        assert!((estimate.value - value).abs() < 1e-12, "{estimate:?}");
    }
    // Unit covariance: the score is the distance.
    assert!((horizon.model.summary.average.value - 12.5).abs() < 1e-12);
    assert!(horizon.baselines.iter().all(|(_, score)| score.displacement.len() == 4));
    options.position = vec!["z".into()];
    let error = rollout(&model, &source, &Starts::Even(4), &options, &Silent).unwrap_err();
    assert!(matches!(error, Error::UnknownColumn(_)), "{error}");
    options.position.clear();
    let without = rollout(&model, &source, &Starts::Even(4), &options, &Silent).unwrap().horizon;
    assert!(without.model.displacement.is_empty() && without.model.displacement_summary.is_none());
}

/// Direction, growth, time warping, cosines of angles, explained variance and the reference, each by its definition on
/// the trajectories that were kept.
#[test]
fn scores_of_paths_follow_their_definitions() {
    let mut columns = vec![
        column("x", Role::State, false),
        column("y", Role::State, false),
        column("yaw", Role::State, true),
        column("r", Role::Input, false),
    ];
    columns[3].role = Role::Input;
    let rate = |value: f64| vec![(value, vec![0.0; 4])];
    let fitted = vec![
        ("x", Prediction::Derivative, "1", rate(1.0)),
        ("y", Prediction::Derivative, "1", rate(0.5)),
        ("yaw", Prediction::Derivative, "1", rate(0.3)),
    ];
    let mut model = model(columns, &["x", "y", "yaw", "r"], Partition::whole(), fitted, &[]);
    model.training.state_covariance = vec![1.0, 0.0, 1.0, 0.0, 0.0, 1.0];
    let wave = |phase: f64, slope: f64| -> Vec<f64> {
        (0..60).map(|k| slope * f64::from(k) + (0.31 * f64::from(k) + phase).sin()).collect()
    };
    let turn: Vec<f64> = (0..60).map(|k| fleetfoot_dynamics::wrap(3.0 + 0.2 * f64::from(k))).collect();
    let episode = |phase: f64| vec![wave(phase, 0.4), wave(phase + 1.0, 0.1), turn.clone(), wave(phase, 0.0)];
    let source = source(&["x", "y", "yaw", "r"], 0.5, vec![episode(0.0), episode(0.7)]);
    let mut options = options(20, Method::Euler);
    options.position = vec!["x".into(), "y".into()];
    (options.interval, options.band, options.keep) = (3, Some(4), true);
    options.references = ["d(x)/dt = r", "y=0.5*r"]
        .map(|text| fleetfoot_dynamics::Reference::parse(text, ["x", "y", "yaw", "r"].into_iter()).unwrap())
        .into();
    let rollouts = rollout(&model, &source, &Starts::Even(6), &options, &Silent).unwrap();
    let n = rollouts.trajectories.len() as f64;
    let recorded = |start: Start, name: usize, k: usize| source_value(&source, start, name, k);
    let hypot = |p: [f64; 2]| p[0].hypot(p[1]);
    let cosine = |a: [f64; 2], b: [f64; 2]| (a[0] * b[0] + a[1] * b[1]) / (hypot(a) * hypot(b));
    let path = |of: &dyn Fn(usize, usize) -> f64| -> Vec<[f64; 2]> { (0..=20).map(|k| [of(0, k), of(1, k)]).collect() };
    let pair = |a: &[[f64; 2]], b: &[[f64; 2]]| -> [f64; 4] {
        let distance: Vec<f64> = a.iter().zip(b).map(|(a, b)| hypot([a[0] - b[0], a[1] - b[1]])).collect();
        let step = |p: &[[f64; 2]], k: usize| [p[k][0] - p[k - 1][0], p[k][1] - p[k - 1][1]];
        let direction = (1..=20).map(|k| cosine(step(a, k), step(b, k))).sum::<f64>() / 20.0;
        // The first distance is that after a step.
        let growth = (1..=17).map(|i| (distance[i + 3] - distance[i]) / distance[i]).sum::<f64>() / 17.0;
        // All cells of the table, in full.
        let mut table = vec![vec![f64::INFINITY; 22]; 22];
        table[0][0] = 0.0;
        for i in 1..=21usize {
            for j in (1..=21usize).filter(|j| i.abs_diff(*j) <= 4) {
                let cost = hypot([a[i - 1][0] - b[j - 1][0], a[i - 1][1] - b[j - 1][1]]).powi(2);
                table[i][j] = cost + table[i - 1][j].min(table[i][j - 1]).min(table[i - 1][j - 1]);
            }
        }
        [distance[1..].iter().sum::<f64>() / 20.0, direction, growth, table[21][21].sqrt()]
    };
    let (mut model_sum, mut reference_sum, mut pair_sum, mut cosines) = ([0.0; 4], [0.0; 4], [0.0; 4], 0.0);
    let (mut errors, mut values) = (Vec::new(), Vec::new());
    for trajectory in &rollouts.trajectories {
        let start = trajectory.start;
        let real = path(&|i, k| recorded(start, i, k));
        let simulated = path(&|i, k| trajectory.state(k)[i]);
        let mut ideal = vec![real[0]];
        for k in 1..=20 {
            let r = recorded(start, 3, k - 1);
            ideal.push([ideal[k - 1][0] + 0.5 * r, 0.5 * r]);
        }
        for (sum, scores) in [
            (&mut model_sum, pair(&simulated, &real)),
            (&mut reference_sum, pair(&ideal, &real)),
            (&mut pair_sum, pair(&simulated, &ideal)),
        ] {
            (0..4).for_each(|i| sum[i] += scores[i] / n);
        }
        for k in 1..=20 {
            cosines += (recorded(start, 2, k) - trajectory.state(k)[2]).cos() / 20.0 / n;
            errors.push(real[k][0] - simulated[k][0]);
            values.push(real[k][0]);
        }
    }
    let check = |distance: f64, path: &fleetfoot_dynamics::PathScores, expected: [f64; 4]| {
        let measures =
            [distance, path.average_alignment.value, path.propagated_error.value, path.warping_distance.value];
        measures
            .iter()
            .zip(expected)
            .for_each(|(measure, value)| assert!((measure - value).abs() < 1e-9 * value.abs().max(1.0)));
        assert!(path.average_alignment.low < path.average_alignment.high, "two episodes have an interval");
    };
    let horizon = &rollouts.horizon;
    let distance = |score: &fleetfoot_dynamics::HorizonScore| score.displacement_summary.unwrap().average.value;
    check(distance(&horizon.model), horizon.model.path.as_ref().unwrap(), model_sum);
    let (_, ideal) = horizon.baselines.iter().find(|(which, _)| *which == Baseline::Reference).unwrap();
    check(distance(ideal), ideal.path.as_ref().unwrap(), reference_sum);
    let beside = horizon.beside_reference.as_ref().unwrap();
    check(beside.displacement.average.value, &beside.path, pair_sum);
    // A state without a reference has no score, so that no Mahalanobis score exists and no horizon is compared with it.
    assert!(ideal.mahalanobis.iter().all(|score| score.value.is_nan()) && horizon.better.len() == 3);
    assert!((horizon.model.average_orientation.unwrap().value - cosines).abs() < 1e-12);
    let variance = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        values.iter().map(|value| (value - mean).powi(2)).sum::<f64>()
    };
    let explained = 1.0 - variance(&errors) / variance(&values);
    assert!((horizon.model.explained_variance[0].value - explained).abs() < 1e-12);
    let last: Vec<usize> = (0..rollouts.trajectories.len()).map(|i| i * 20 + 19).collect();
    let at = |of: &[f64]| last.iter().map(|&i| of[i]).collect::<Vec<f64>>();
    let explained = 1.0 - variance(&at(&errors)) / variance(&at(&values));
    assert!((horizon.model.explained_variance_by_step[19 * 3] - explained).abs() < 1e-12);
    // Faults of a reference name it.
    let refused = |text: &str| {
        let mut options = options.clone();
        let parsed = fleetfoot_dynamics::Reference::parse(text, ["x", "y", "yaw", "r"].into_iter());
        parsed.and_then(|reference| {
            options.references.push(reference);
            rollout(&model, &source, &Starts::Even(6), &options, &Silent).map(drop)
        })
    };
    for (text, part) in [("x", "no `=`"), ("x=r", "second reference"), ("z=r", "z"), ("yaw=q", "q")] {
        let error = refused(text).unwrap_err().to_string();
        assert!(error.contains(part), "{text}: {error}");
    }
}

fn source_value(source: &dyn Source, start: Start, column: usize, k: usize) -> f64 {
    let rows = start.row + k..start.row + k + 1;
    source.read(start.episode, rows, fleetfoot_data::Halo::default()).unwrap().column(column)[0]
}
