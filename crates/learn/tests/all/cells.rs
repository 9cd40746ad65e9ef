use faer::Mat;
use fleetfoot_data::Silent;
use fleetfoot_learn::{
    Activation, Cell, Error, Output, Samples, Shape, Table, Training, Units, Window, slope, statistic, train,
};

use crate::slopes::{is_same_on_all_threads, uniform};

const CELLS: [Cell; 3] = [Cell::Rnn, Cell::Gru, Cell::Lstm];

/// A cell of so many units over three steps of the same two of six inputs; the last two are read by the linear map alone.
fn shape(cell: Cell, units: usize) -> Shape {
    let window = Window { cell, steps: vec![vec![2, 3], vec![4, 1], vec![0, 5]] };
    Shape { inputs: 6, hidden: vec![units], activation: Activation::Tanh, window: Some(window) }
}

fn rows(count: usize) -> Samples {
    let table = Table::new(6, 2, (0..8 * count).map(|at| uniform(at as u64)).collect()).unwrap();
    let all: Vec<usize> = (0..count).collect();
    table.samples(&all, &Units::of(&table, &all).unwrap())
}

fn logistic(z: f64) -> f64 {
    1.0 / (1.0 + (-z).exp())
}

/// The last state by the equations of the cell, unit by unit, from the inputs of the steps.
fn by_formula(cell: Cell, units: usize, [w, r, b, c]: [&[f64]; 4], steps: &[[f64; 2]]) -> Vec<f64> {
    let (mut state, mut memory) = (vec![0.0; units], vec![0.0; units]);
    for x in steps {
        let before = state.clone();
        let inputs = |row: usize| b[row] + w[2 * row] * x[0] + w[2 * row + 1] * x[1];
        let states = |row: usize| (0..units).map(|k| r[row * units + k] * before[k]).sum::<f64>();
        let sum = |gate: usize, unit: usize| inputs(gate * units + unit) + states(gate * units + unit);
        for unit in 0..units {
            state[unit] = match cell {
                Cell::Rnn => sum(0, unit).tanh(),
                Cell::Gru => {
                    let [reset, update] = [0, 1].map(|gate| logistic(sum(gate, unit)));
                    let row = 2 * units + unit;
                    let candidate = (inputs(row) + reset * (states(row) + c[unit])).tanh();
                    (1.0 - update) * candidate + update * before[unit]
                }
                Cell::Lstm => {
                    let [i, f, o] = [0, 1, 3].map(|gate| logistic(sum(gate, unit)));
                    memory[unit] = f * memory[unit] + i * sum(2, unit).tanh();
                    o * memory[unit].tanh()
                }
            };
        }
    }
    state
}

/// The loss of rows whose output layer has these weights of the features and nothing else.
fn loss(shape: &Shape, parameters: &[f64], weights: &[f64], samples: &Samples) -> f64 {
    let mut output = Output(Mat::zeros(7 + weights.len(), 2));
    weights.iter().enumerate().for_each(|(k, weight)| output.0[(7 + k, 0)] = *weight);
    let tiles: Vec<usize> = (0..samples.tiles()).collect();
    slope(shape, parameters, &output, (samples, &tiles), &Silent).unwrap().loss
}

#[test]
fn states_follow_the_equations_of_cells() {
    // One row in the units of many, so that its loss with one weight tells the unit.
    let values: Vec<f64> = (0..80).map(|at| 3.0 * uniform(500 + at)).collect();
    let table = Table::new(6, 2, values).unwrap();
    let units = Units { centre: vec![0.0; 8], scale: vec![1.0; 8] };
    for cell in CELLS {
        let shape = shape(cell, 4);
        let parameters: Vec<f64> = shape.initial(7).iter().map(|number| 1.5 * number).collect();
        for row in 0..10 {
            let x = table.row(row);
            let steps = [[x[2], x[3]], [x[4], x[1]], [x[0], x[5]]];
            let expected = by_formula(cell, 4, shape.split_cell(&parameters), &steps);
            let sample = table.samples(&[row], &units);
            for (unit, expected) in expected.iter().enumerate() {
                let loss = |weight: f64| {
                    let mut weights = vec![0.0; 4];
                    weights[unit] = weight;
                    loss(&shape, &parameters, &weights, &sample)
                };
                // 2 loss(w) = (w h - y0)^2 + y1^2, so that loss(1) - loss(-1) = -2 h y0.
                let value = (loss(-1.0) - loss(1.0)) / (2.0 * x[6]);
                // Losses have some 1e-15 of their size, at most 10, and y0 is not far below 1.
                let room = 1e-14 / x[6].abs() * 10.0;
                assert!((value - expected).abs() < room, "{cell:?} {row} {unit}: {value} {expected}");
            }
        }
    }
}

#[test]
fn gradients_through_time_match_central_differences() {
    let samples = rows(300);
    for cell in CELLS {
        let shape = shape(cell, 4);
        let mut parameters = shape.initial(3);
        assert_eq!(parameters.len(), shape.parameters());
        let output = statistic(&shape, &parameters, &samples, &Silent).unwrap().solve(1e-3).unwrap();
        let gradient = slope(&shape, &parameters, &output, (&samples, &[0, 1]), &Silent).unwrap().hidden;
        let size = gradient.iter().fold(0.0_f64, |most, entry| most.max(entry.abs()));
        for at in 0..parameters.len() {
            let (whole, step) = (parameters[at], 1e-6);
            let mut shifted = |to: f64| {
                parameters[at] = to;
                slope(&shape, &parameters, &output, (&samples, &[0, 1]), &Silent).unwrap().loss
            };
            let difference = (shifted(whole + step) - shifted(whole - step)) / (2.0 * step);
            shifted(whole);
            assert!((difference - gradient[at]).abs() < 1e-6 * size, "{cell:?} {at}: {difference} {}", gradient[at]);
        }
    }
}

#[test]
fn threads_change_no_bit_of_cells() {
    let samples = rows(9_000);
    for cell in CELLS {
        assert!(is_same_on_all_threads(&shape(cell, 5), &samples), "{cell:?}");
    }
}

/// Rows of a signal's last eight values, and a target that counts the sign of each by its neighbour: no linear map explains it.
fn remembered() -> [Samples; 2] {
    let signal: Vec<f64> = (0..2_000).map(|at| 2.0 * uniform(at)).collect();
    let target = |past: &[f64]| past.windows(2).fold(0.0_f64, |sum, pair| (0.5 * sum + pair[0] * pair[1]).tanh());
    let values = signal.windows(8).flat_map(|past| past.iter().copied().chain([target(past)])).collect();
    let table = Table::new(8, 1, values).unwrap();
    let (fitted, held): (Vec<usize>, Vec<usize>) = (0..table.rows()).partition(|row| row % 5 != 0);
    let mut units = Units::of(&table, &fitted).unwrap();
    window(Cell::Gru).share(&mut units);
    assert!(units.centre[..8].iter().all(|centre| *centre == units.centre[7]));
    [table.samples(&fitted, &units), table.samples(&held, &units)]
}

fn change_steps(shape: &mut Shape, steps: &[&[usize]]) {
    let steps: Vec<Vec<usize>> = steps.iter().map(|step| step.to_vec()).collect();
    shape.window.iter_mut().for_each(|window| window.steps.clone_from(&steps));
}

fn window(cell: Cell) -> Window {
    Window { cell, steps: (0..8).map(|at| vec![at]).collect() }
}

#[test]
fn gated_cells_learn_recursive_targets() {
    let [fitted, held] = remembered();
    let options = Training { epochs: 30, steps: 30, ..Training::default() };
    for cell in [Cell::Gru, Cell::Lstm] {
        let shape = Shape { inputs: 8, hidden: vec![8], activation: Activation::Tanh, window: Some(window(cell)) };
        let trained = train(&shape, &fitted, &held, &options, &Silent).unwrap();
        assert!(trained.loss < 0.1 * trained.linear, "{cell:?} {} {}", trained.loss, trained.linear);
    }
}

#[test]
fn impossible_windows_are_refused() {
    let refused = |change: fn(&mut Shape)| {
        let mut shape = shape(Cell::Gru, 3);
        change(&mut shape);
        matches!(train(&shape, &rows(300), &rows(300), &Training::default(), &Silent), Err(Error::Shape(_)))
    };
    assert!(refused(|shape| shape.hidden.push(4)));
    assert!(refused(|shape| change_steps(shape, &[&[0, 6]])));
    assert!(refused(|shape| change_steps(shape, &[&[0, 1], &[2]])));
    assert!(refused(|shape| change_steps(shape, &[])));
}
