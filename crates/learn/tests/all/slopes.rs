use fleetfoot_data::{Silent, mix, with_threads};
use fleetfoot_learn::{Activation, Output, Samples, Shape, Table, Units, slope, statistic};

/// Uniform numbers between -1 and 1.
pub(crate) fn uniform(key: u64) -> f64 {
    (mix(key) >> 11) as f64 * 2f64.powi(-52) - 1.0
}

/// Rows of three inputs and two targets, as many as that they fill tiles in part.
pub(crate) fn samples(rows: usize) -> Samples {
    let values: Vec<f64> = (0..5 * rows).map(|at| uniform(at as u64)).collect();
    let table = Table::new(3, 2, values).unwrap();
    let all: Vec<usize> = (0..rows).collect();
    table.samples(&all, &Units::of(&table, &all).unwrap())
}

fn shape(hidden: &[usize], activation: Activation) -> Shape {
    Shape { inputs: 3, hidden: hidden.to_vec(), activation, window: None }
}

/// The loss of all rows.
fn loss(shape: &Shape, parameters: &[f64], output: &Output, samples: &Samples) -> f64 {
    let tiles: Vec<usize> = (0..samples.tiles()).collect();
    slope(shape, parameters, output, (samples, &tiles), &Silent).unwrap().loss
}

#[test]
fn gradients_match_central_differences() {
    let samples = samples(300);
    for (hidden, activation) in [
        (&[4][..], Activation::Tanh),
        (&[5, 4], Activation::Tanh),
        (&[4, 3, 5], Activation::Softplus),
        (&[6, 4], Activation::Relu),
    ] {
        let shape = shape(hidden, activation);
        let mut parameters = shape.initial(3);
        let mut output = statistic(&shape, &parameters, &samples, &Silent).unwrap().solve(1e-3).unwrap();
        let gradient = slope(&shape, &parameters, &output, (&samples, &[0, 1]), &Silent).unwrap();
        assert_eq!(gradient.hidden.len(), shape.parameters());
        let size = gradient.hidden.iter().fold(0.0_f64, |most, entry| most.max(entry.abs()));
        for at in 0..parameters.len() {
            let (whole, step) = (parameters[at], 1e-6);
            let mut shifted = |to: f64| {
                parameters[at] = to;
                loss(&shape, &parameters, &output, &samples)
            };
            let difference = (shifted(whole + step) - shifted(whole - step)) / (2.0 * step);
            shifted(whole);
            assert!(
                (difference - gradient.hidden[at]).abs() < 1e-6 * size,
                "{activation:?} {at}: {difference} {}",
                gradient.hidden[at]
            );
        }
        for (target, features) in gradient.weights.chunks(shape.features()).enumerate() {
            for (feature, entry) in features.iter().enumerate() {
                let (place, step) = ((4 + feature, target), 1e-6);
                let whole = output.0[place];
                let mut shifted = |to: f64| {
                    output.0[place] = to;
                    loss(&shape, &parameters, &output, &samples)
                };
                let difference = (shifted(whole + step) - shifted(whole - step)) / (2.0 * step);
                shifted(whole);
                assert!((difference - entry).abs() < 1e-5, "{activation:?} {place:?}: {difference} {entry}");
            }
        }
    }
}

#[test]
fn sums_tell_the_error_that_rows_have() {
    let (samples, shape) = (samples(700), shape(&[6], Activation::Tanh));
    let parameters = shape.initial(1);
    let sums = statistic(&shape, &parameters, &samples, &Silent).unwrap();
    assert_eq!((sums.rows, sums.width()), (700, 10));
    for ridge in [0.0, 1e-2, 10.0] {
        let output = sums.solve(ridge).unwrap();
        let rows = loss(&shape, &parameters, &output, &samples) * 2.0 / 1400.0;
        assert!((sums.error(&output) - rows).abs() < 1e-12, "{rows}");
    }
    // A ridge without end leaves the linear map.
    let [bounded, linear] =
        [sums.error(&sums.solve(1e12).unwrap()), sums.linear().error(&sums.linear().solve(0.0).unwrap())];
    assert!((bounded - linear).abs() < 1e-9 && sums.error(&sums.solve(0.0).unwrap()) < linear);
    // The solution is a minimum: any other output layer is worse.
    let mut output = sums.solve(0.0).unwrap();
    let least = sums.error(&output);
    output.0[(5, 1)] += 1e-3;
    assert!(sums.error(&output) > least);
}

/// Sums, output layer and slope on 1, 2 and 7 threads.
pub(crate) fn is_same_on_all_threads(shape: &Shape, samples: &Samples) -> bool {
    let parameters = shape.initial(9);
    let on = |threads| {
        with_threads(threads, || {
            let sums = statistic(shape, &parameters, samples, &Silent).unwrap();
            let output = sums.solve(1e-6).unwrap();
            let tiles: Vec<usize> = (0..samples.tiles()).collect();
            (slope(shape, &parameters, &output, (samples, &tiles), &Silent).unwrap(), sums, output)
        })
    };
    let one = on(1);
    [2, 7].into_iter().all(|threads| on(threads) == one)
}

#[test]
fn threads_change_no_bit() {
    assert!(is_same_on_all_threads(&shape(&[7, 5], Activation::Tanh), &samples(9_000)));
}
