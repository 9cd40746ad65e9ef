use fleetfoot_data::{Progress, Silent, with_threads};
use fleetfoot_learn::{Activation, Error, Samples, Shape, Table, Trained, Training, Units, statistic, train};

use crate::slopes::uniform;

/// Rows of `inputs` uniform inputs and one target; every fifth does not train.
fn rows(count: usize, inputs: usize, target: impl Fn(usize, &[f64]) -> f64) -> [Samples; 2] {
    let mut values = Vec::new();
    for row in 0..count {
        let x: Vec<f64> = (0..inputs).map(|column| 2.0 * uniform((row * inputs + column) as u64)).collect();
        values.extend_from_slice(&x);
        values.push(target(row, &x));
    }
    let table = Table::new(inputs, 1, values).unwrap();
    let (fitted, held): (Vec<usize>, Vec<usize>) = (0..count).partition(|row| row % 5 != 0);
    let units = Units::of(&table, &fitted).unwrap();
    [table.samples(&fitted, &units), table.samples(&held, &units)]
}

fn shape(inputs: usize, hidden: &[usize]) -> Shape {
    Shape { inputs, hidden: hidden.to_vec(), activation: Activation::Tanh, window: None }
}

fn trained(shape: &Shape, [fitted, held]: &[Samples; 2], how: &Training) -> Trained {
    train(shape, fitted, held, how, &Silent).unwrap()
}

#[test]
fn network_target_is_learned_to_rounding() {
    // Two units and a linear map, exactly: the target is in reach of the network.
    let exact =
        |_, x: &[f64]| 0.3 * x[0] - x[1] + (0.9 * x[0] + 0.4 * x[1] - 0.3).tanh() - 0.7 * (x[1] - 0.6 * x[0]).tanh();
    let samples = rows(3_000, 2, exact);
    let options = Training { steps: 400, patience: 60, ..Training::default() };
    let result = trained(&shape(2, &[4]), &samples, &options);
    assert!(result.loss < 1e-7 && result.linear > 1e-3, "{result:?}");
}

#[test]
fn linear_target_stays_linear() {
    let samples = rows(1_000, 3, |row, x| 2.0 * x[0] - x[2] + 0.3 * uniform(1_000_000 + row as u64));
    let result = trained(&shape(3, &[8]), &samples, &Training::default());
    // Rows that did not train are predicted as well as by the linear map, not better.
    assert!((0.97..1.01).contains(&(result.loss / result.linear)), "{result:?}");
}

#[test]
fn collinear_inputs_are_solved() {
    // Lags of a smooth signal: nearly the same column ten times.
    let values: Vec<f64> = (0..2_000)
        .flat_map(|row| {
            let signal = |lag: usize| (0.02 * (row as f64 - lag as f64 * 1e-3)).sin();
            (0..10).map(signal).chain([signal(0).powi(3)]).collect::<Vec<f64>>()
        })
        .collect();
    let table = Table::new(10, 1, values).unwrap();
    let (fitted, held): (Vec<usize>, Vec<usize>) = (0..2_000).partition(|row| row % 7 != 0);
    let units = Units::of(&table, &fitted).unwrap();
    let samples = [table.samples(&fitted, &units), table.samples(&held, &units)];
    let result = trained(&shape(10, &[6]), &samples, &Training::default());
    assert!(result.loss < 1e-4 && result.linear > 1e-3, "{result:?}");
}

#[test]
fn seed_decides_network_on_any_threads() {
    let samples = rows(6_000, 2, |_, x| (x[0] * x[1]).sin());
    let how = Training { epochs: 4, steps: 4, batch: 12, ..Training::default() };
    let on = |threads, seed| {
        with_threads(threads, || trained(&shape(2, &[8, 6]), &samples, &Training { seed, ..how.clone() }))
    };
    let one = on(1, 5);
    assert!(on(2, 5) == one && on(7, 5) == one && on(1, 6) != one);
}

#[test]
fn impossible_training_is_an_error() {
    assert_eq!(Table::new(1, 1, vec![0.0, 1.0, f64::NAN, 2.0]), Err(Error::NotFinite { row: 1, column: 0 }));
    assert!(matches!(Table::new(2, 1, vec![0.0; 4]), Err(Error::Shape(_))));
    let table = Table::new(1, 1, vec![1.0, 0.5, 1.0, 0.7, 1.0, 0.1]).unwrap();
    assert_eq!(Units::of(&table, &[0]), Err(Error::TooFewRows { rows: 1, least: 2 }));
    assert_eq!(Units::of(&table, &[0, 1, 2]), Err(Error::Constant { column: 0 }));
    let units = Units { centre: vec![0.0; 2], scale: vec![1.0; 2] };
    let samples = [table.samples(&[0, 1], &units), table.samples(&[2], &units)];
    let of = |shape: &Shape, [fitted, held]: &[Samples; 2]| train(shape, fitted, held, &Training::default(), &Silent);
    assert_eq!(of(&shape(1, &[4]), &samples), Err(Error::TooFewRows { rows: 2, least: 3 }));
    assert!(matches!(of(&shape(2, &[4]), &samples), Err(Error::Shape(_))));
    for hidden in [&[][..], &[4, 0]] {
        assert!(matches!(of(&shape(1, hidden), &samples), Err(Error::Shape(_))));
    }
    let empty = [rows(20, 1, |_, x| x[0].sin())[0].clone(), table.samples(&[], &units)];
    assert_eq!(of(&shape(1, &[4]), &empty), Err(Error::TooFewRows { rows: 0, least: 1 }));
}

#[test]
fn cancellation_stops_training() {
    struct Stop;
    impl Progress for Stop {
        fn advance(&self, _: usize, _: usize) {}
        fn cancelled(&self) -> bool {
            true
        }
    }
    let [fitted, held] = rows(100, 1, |_, x| x[0].sin());
    let shape = shape(1, &[3]);
    assert_eq!(train(&shape, &fitted, &held, &Training::default(), &Stop), Err(Error::Cancelled));
    assert!(statistic(&shape, &shape.initial(0), &fitted, &Silent).is_ok());
}
