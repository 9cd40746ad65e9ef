//! Latents with a recurrent cell: by the equations, by differences, in files and in text.

use fleetfoot_model::{Basis, BasisMap, Cell, Map, MapKind, Model, Recurrent, describe};

use crate::models;

const AT: [f64; 7] = [0.3, -0.8, 0.6, 0.1, -0.4, -0.7, 0.9];

fn map(model: &Model, latent: usize) -> &BasisMap {
    match &model.latents[latent].map {
        Map::Basis(map) => map,
        other => panic!("{other:?}"),
    }
}

fn recurrent(map: &BasisMap) -> &Recurrent {
    match &map.basis {
        Basis::Recurrent(recurrent) => recurrent,
        other => panic!("{other:?}"),
    }
}

fn logistic(z: f64) -> f64 {
    1.0 / (1.0 + (-z).exp())
}

/// The state behind the window, unit by unit.
fn by_formula(cell: &Recurrent) -> Vec<f64> {
    let units = cell.count();
    let (mut state, mut memory) = (vec![0.0; units], vec![0.0; units]);
    let dot = |weights: &[f64], values: &[f64]| weights.iter().zip(values).map(|(w, v)| w * v).sum::<f64>();
    for step in cell.inputs.chunks(cell.columns()) {
        let column = |(j, &input): (usize, &usize)| (AT[input] - cell.centre[j]) / cell.scale[j];
        let x: Vec<f64> = step.iter().enumerate().map(column).collect();
        let before = state.clone();
        let inputs = |row: usize| cell.biases[row] + dot(&cell.input_weights[row], &x);
        let states = |row: usize| dot(&cell.state_weights[row], &before);
        let sum = |gate: usize, k: usize| inputs(gate * units + k) + states(gate * units + k);
        for k in 0..units {
            state[k] = match cell.cell {
                Cell::Rnn => sum(0, k).tanh(),
                Cell::Gru => {
                    let (reset, update, row) = (logistic(sum(0, k)), logistic(sum(1, k)), 2 * units + k);
                    let candidate = (inputs(row) + reset * (states(row) + cell.state_biases[k])).tanh();
                    (1.0 - update) * candidate + update * before[k]
                }
                Cell::Lstm => {
                    memory[k] = logistic(sum(1, k)) * memory[k] + logistic(sum(0, k)) * sum(2, k).tanh();
                    logistic(sum(3, k)) * memory[k].tanh()
                }
            };
        }
    }
    state
}

#[test]
fn state_follows_the_equations_of_a_cell() {
    for (cell, numbers) in Cell::ALL.into_iter().zip([4 * 7, 12 * 7 + 4, 16 * 7]) {
        let model = models::recurrent(cell);
        let (map, cell_of) = (map(&model, 1), recurrent(map(&model, 1)));
        let state = by_formula(cell_of);
        let linear = map.affine.constants[0] + (0..7).map(|j| map.affine.coefficients[0][j] * AT[j]).sum::<f64>();
        let expected = linear + state.iter().zip(&map.weights[0]).map(|(unit, weight)| unit * weight).sum::<f64>();
        // A hundred roundings of numbers near 1.
        assert!((map.value(0, &AT) - expected).abs() < 1e-13, "{cell:?}");
        assert_eq!((map.functions(), map.features(), cell_of.count(), cell_of.steps()), (7, 11, 4, 3));
        assert_eq!(cell_of.numbers(), numbers, "{cell:?}");
        assert!(map.expression(8, &model.libraries[0]).is_none(), "a unit is not written out");
    }
}

#[test]
fn products_with_the_jacobian_are_differences() {
    for cell in Cell::ALL {
        for (model, region) in [(models::recurrent(cell), 0), (models::recurrent_regions(cell), 2)] {
            let map = map(&model, 0);
            let functions = map.functions();
            let at = &AT[..functions];
            let mut slopes = vec![1.0; functions];
            map.gradient(region, at, 2.0, &mut slopes);
            for (j, slope) in slopes.iter().enumerate() {
                let value = |by: f64| {
                    let mut at = at.to_vec();
                    at[j] += by;
                    map.value(region, &at)
                };
                // Central differences err by step^2 and rounding over step: 1e-9 of values near 1.
                let difference = (value(1e-6) - value(-1e-6)) / 2e-6;
                assert!((slope - 1.0 - 2.0 * difference).abs() < 1e-7, "{cell:?} {j}: {slope} {difference}");
            }
            let change: Vec<f64> = (0..functions).map(|j| 0.3 - 0.2 * j as f64).collect();
            let along: f64 = slopes.iter().zip(&change).map(|(slope, change)| (slope - 1.0) / 2.0 * change).sum();
            assert!((map.tangent(region, at, &change) - along).abs() < 1e-12, "{cell:?}");
        }
    }
}

#[test]
fn file_has_a_cell_once_and_reads_back() {
    for cell in Cell::ALL {
        let model = models::recurrent(cell);
        let text = model.to_json();
        assert_eq!(text.matches("\"input_weights\"").count(), 1, "{cell:?}");
        assert_eq!(text.contains("\"state_biases\""), cell == Cell::Gru);
        let again = Model::from_json(&text, "m.json").unwrap();
        assert_eq!((again.to_json(), &again), (text, &model));
        let arrays = map(&model, 0).arrays();
        let shape = |name: &str| arrays.iter().find(|array| array.name == name).map(|array| array.shape.clone());
        assert_eq!((shape("inputs"), shape("input_weights")), (Some(vec![3, 2]), Some(vec![4 * cell.gates(), 2])));
    }
}

#[test]
fn inconsistent_cells_are_refused() {
    let model = models::recurrent(Cell::Gru);
    let refused = |change: &dyn Fn(&mut Recurrent), words: &str| {
        let mut model = model.clone();
        for latent in &mut model.latents {
            let Map::Basis(map_of) = &mut latent.map else { panic!("a cell") };
            let mut changed = recurrent(map_of).clone();
            change(&mut changed);
            map_of.basis = Basis::Recurrent(changed.into());
        }
        let error = Model::from_json(&model.to_json(), "m.json").unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused(&|cell| cell.inputs[0] = 9, "does not have");
    refused(&|cell| cell.inputs.truncate(5), "a step of 1");
    refused(&|cell| cell.inputs.clear(), "does not have");
    refused(&|cell| cell.scale[1] = 0.0, "not positive");
    refused(&|cell| cell.scale.truncate(1), "1 scales");
    refused(&|cell| cell.state_weights[1].truncate(2), "another shape");
    refused(&|cell| cell.state_biases.clear(), "another shape");
    refused(&|cell| cell.cell = Cell::Rnn, "another shape");
    refused(&|cell| cell.biases[1] = f64::NAN, "not finite");
}

#[test]
fn text_shows_a_cell_as_one_term() {
    let text = describe(&models::recurrent(Cell::Lstm), 1);
    assert!(text.contains("1*network_f_x") && !text.contains("unit1"), "{text}");
    assert!(text.contains("4 units, the last state of a recurrent cell (lstm) over 3 rows"), "{text}");
}
