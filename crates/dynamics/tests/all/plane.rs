//! Projections onto a plane against their definition, row by row.

use std::collections::BTreeMap;

use crate::common::{column, model, parse, partition, random_hybrid, source};
use fleetfoot_data::{Halo, MemorySource, Silent, Source, with_threads};
use fleetfoot_dynamics::{Axis, Error, Mahalanobis, Predicted, Predictor, PredictorWorkspace, RowStatus, plane};
use fleetfoot_model::{Model, Prediction, Role, Rule};

const BINS: usize = 7;

/// Cell, region and score of every row of an episode.
fn rows(model: &Model, source: &MemorySource, episode: usize, axes: &[Axis; 2]) -> Vec<(usize, u32, Option<f64>)> {
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let predictor = Predictor::new(model, &names).unwrap();
    let metric = Mahalanobis::of_covariance(&model.training.target_covariance, model.training.target_mean.len());
    let count = source.episodes()[episode].rows;
    let block = source.read(episode, 0..count, Halo::default()).unwrap();
    let mut predicted = Predicted::default();
    predictor.predict(&block, 0..count, &mut PredictorWorkspace::default(), &mut predicted);
    let bin = |axis: &Axis, row: usize| {
        let value = block.column(source.column_index(axis.expression.as_column().unwrap()).unwrap())[row];
        ((value - axis.low) / (axis.high - axis.low) * BINS as f64).floor() as usize
    };
    (0..count)
        .map(|row| {
            let errors: Vec<f64> =
                predicted.residual.chunks_exact(count).take(model.fitted().count()).map(|e| e[row]).collect();
            let score = (predicted.status[row] == RowStatus::Complete).then(|| metric.score(&errors));
            (bin(&axes[0], row) * BINS + bin(&axes[1], row), predicted.region[row], score)
        })
        .collect()
}

#[test]
fn cells_equal_the_definition_on_any_number_of_threads() {
    // Longer than a chunk, so that passages are cut.
    let (model, source) = random_hybrid(3, 1, 6, 70_000);
    let axes = ["x0", "x1"].map(|name| Axis::of_model(&model, parse(name), &source, &Silent).unwrap());
    let cells = plane(&model, &source, &axes, BINS, &Silent).unwrap();
    for threads in [1, 7] {
        assert_eq!(with_threads(threads, || plane(&model, &source, &axes, BINS, &Silent).unwrap()), cells);
    }
    let mut expected: BTreeMap<usize, (u64, u64, u64, u64, f64)> = BTreeMap::new();
    for episode in 0..2 {
        let mut last: Option<(usize, u32)> = None;
        let mut counted = false;
        for (cell, region, score) in rows(&model, &source, episode, &axes) {
            let sums = expected.entry(cell).or_default();
            sums.0 += 1;
            let stays = last.is_some_and(|(before, _)| before == cell);
            if !stays {
                sums.1 += 1;
                counted = false;
            }
            if last.is_some_and(|(_, before)| before != region) && !counted {
                sums.2 += 1;
                counted = true;
            }
            if let Some(score) = score {
                sums.3 += 1;
                sums.4 += score;
            }
            last = Some((cell, region));
        }
    }
    let (mut passages, mut transitions) = (0, 0);
    for (index, cell) in cells.cells.iter().enumerate() {
        let (rows, stays, changes, scored, score) = expected.get(&index).copied().unwrap_or_default();
        assert_eq!(
            (cell.rows, cell.passages, cell.transitions, cell.scored),
            (rows, stays, changes, scored),
            "{index}"
        );
        assert!((cell.score - score).abs() <= 1e-10 * score.max(1.0));
        (passages, transitions) = (passages + stays, transitions + changes);
    }
    assert!(transitions > 20 && transitions < passages, "{transitions} of {passages}");
    assert_eq!((cells.total().rows, cells.outside), (140_000, 0));
    assert_eq!(cells.total().scored, 139_998, "the forward difference lacks the last row of each episode");
}

#[test]
fn angles_take_a_turn_and_rows_outside_are_counted() {
    let columns = vec![column("a", Role::State, true), column("b", Role::State, true), column("x", Role::State, false)];
    let regions = partition(&["x"], &[0.0], &[1.0], Rule::voronoi(vec![vec![-1.0], vec![1.0]]));
    let maps = vec![(0.0, vec![1.0]), (0.0, vec![-1.0])];
    let model = model(columns, &["x"], regions, vec![("x", Prediction::Value, "x", maps)], &[]);
    // One bin of a turn each way, the region changes with every row but the first; a missing angle ends the passage.
    let a = vec![-0.1, 6.2, 6.2, f64::NAN, 6.2, 0.1];
    let x = vec![-1.0, 1.0, -1.0, 1.0, 1.0, 1.0];
    let source = source(&["a", "b", "x"], 0.01, vec![vec![a, vec![0.5; 6], x]]);
    let axes = ["a", "a - b"].map(|text| Axis::of_model(&model, parse(text), &source, &Silent).unwrap());
    assert!(axes[0].periodic && axes[1].periodic);
    let cells = plane(&model, &source, &axes, 2, &Silent).unwrap();
    assert_eq!(cells.outside, 1);
    let cell = cells.cell(1, 1);
    assert_eq!((cell.rows, cell.passages, cell.transitions), (4, 2, 1));
    assert_eq!((cells.cell(0, 1).rows, cells.cell(0, 1).transitions), (1, 0));
    // y = x where x < 0 and y = -x where x > 0: the errors are 0 and 2 in units of the targets' unit covariance.
    assert!((cell.score - 4.0).abs() < 1e-12 && cell.mean_score() == 1.0, "{cell:?}");

    let flat = Axis::range(parse("x"), 1.0, 1.0);
    let refused = plane(&model, &source, &[flat, axes[0].clone()], 2, &Silent).unwrap_err();
    assert!(matches!(refused, Error::Plane(_)) && refused.to_string().contains("[1, 1)"), "{refused}");
    assert!(plane(&model, &source, &axes, 0, &Silent).is_err());
    let mixed = Axis::of_model(&model, parse("a*x"), &source, &Silent).unwrap();
    assert!(!mixed.periodic && mixed.low == -6.2 && mixed.high > 6.2);
}
