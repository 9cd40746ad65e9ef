use std::sync::atomic::{AtomicBool, Ordering};

use fleetfoot_data::{Progress, Silent, mix};
use fleetfoot_learn::{Cell, Table, Window};
use fleetfoot_recipe::Recipe;
use fleetfoot_stats::Fold;

use super::{
    basis::basis,
    options::NetworkOptions,
    report::NetworkCandidate,
    rows::Rows,
    search::{choose, search},
    train::{solved, units},
};

fn options() -> NetworkOptions {
    NetworkOptions::new(&Recipe::parse("[network]\neffort = \"low\"\n", "r.toml").unwrap()).unwrap()
}

/// Two inputs and a target, in five folds.
fn rows(count: usize, target: impl Fn(f64, f64) -> f64) -> Rows {
    let uniform = |key: usize| 4.0 * ((mix(key as u64) >> 11) as f64 * 2f64.powi(-53)) - 2.0;
    let row = |at: usize| [uniform(2 * at), uniform(2 * at + 1)];
    let noise = |at: usize| 0.01 * uniform(1_000_000 + at);
    let values = (0..count).flat_map(|at| {
        let [x, z] = row(at);
        [x, z, target(x, z) + noise(at)]
    });
    Rows {
        table: Table::new(2, 1, values.collect()).unwrap(),
        inputs: vec![0, 1],
        window: None,
        persistence: vec![0.0; count],
        folds: (0..count).map(|at| Fold { held_out: (5 * at / count) as u16, purged: [None; 2] }).collect(),
        count: 5,
        rule: String::new(),
        complete: count,
    }
}

#[test]
fn a_curve_gets_a_network_and_a_plane_does_not() {
    let selection = search(&rows(1_000, |x, z| x.sin() * z), &options(), &Silent).unwrap();
    assert!(selection.chosen > 0 && selection.fitted.hidden.is_some());
    let names: Vec<&str> = selection.candidates.iter().map(|candidate| candidate.name.as_str()).collect();
    assert_eq!(names, ["linear", "network 8", "network 16"]);
    // Persistence predicts zero here, and the noise is all that is left.
    assert!(selection.held_out[0].rmse < 0.03 && selection.held_out[0].persistence > 0.5, "{:?}", selection.held_out);
    let selection = search(&rows(1_000, |x, z| x - 0.5 * z), &options(), &Silent).unwrap();
    assert!(selection.chosen == 0 && selection.fitted.hidden.is_none());
}

#[test]
fn a_stop_leaves_the_best_so_far() {
    /// Stops when networks of 16 units begin.
    #[derive(Default)]
    struct Stop(AtomicBool);
    impl Progress for Stop {
        fn advance(&self, _: usize, _: usize) {}
        fn cancelled(&self) -> bool {
            self.0.load(Ordering::Relaxed)
        }
        fn stage(&self, name: &str) {
            if name.contains("network 16") {
                self.0.store(true, Ordering::Relaxed);
            }
        }
    }
    let rows = rows(1_000, |x, z| x.sin() * z);
    let selection = search(&rows, &options(), &Stop::default()).unwrap();
    assert_eq!((selection.candidates.len(), selection.chosen), (2, 1));
    assert!(selection.notes.iter().any(|note| note.contains("stopped before network 16")), "{:?}", selection.notes);
    let [all, _] = rows.split(None);
    let error = selection.fitted.errors(&rows.table, &all).unwrap()[0].sqrt();
    assert!(error < 0.05, "{error}");
}

#[test]
fn smallest_candidate_within_one_error_is_chosen() {
    let of = |losses: [[f64; 4]; 3]| {
        let candidate = |losses: &[f64; 4]| NetworkCandidate::new((None, &[]), 1, losses.to_vec(), Vec::new());
        choose(&losses.iter().map(candidate).collect::<Vec<_>>())
    };
    // The first fold is hard for all: ratios tell what differences hide.
    assert_eq!(of([[9.0, 2.0, 2.0, 2.0], [4.5, 1.0, 1.0, 1.0], [4.4, 1.01, 1.0, 0.99]]), 1);
    assert_eq!(of([[1.0, 1.1, 0.9, 1.0], [0.9, 1.15, 0.8, 1.1], [2.0, 2.0, 2.0, 2.0]]), 0);
    // One that fails in a fold is never the one.
    assert_eq!(of([[1.0; 4], [f64::INFINITY, 0.1, 0.1, 0.1], [0.5; 4]]), 2);
}

/// Rows of three past values of two columns, out of order in the table, and a target.
fn windowed(cell: Cell) -> (Rows, NetworkOptions) {
    let uniform = |key: usize| 4.0 * ((mix(key as u64) >> 11) as f64 * 2f64.powi(-53)) - 2.0;
    let values =
        (0..400).flat_map(|row| (0..7).map(move |column| uniform(7 * row + column) * f64::from(column as u32 + 1)));
    let rows = Rows {
        table: Table::new(6, 1, values.collect()).unwrap(),
        inputs: vec![8, 1, 0, 3, 2, 5],
        window: Some(Window { cell, steps: vec![vec![1, 5], vec![0, 3], vec![4, 2]] }),
        persistence: vec![0.0; 400],
        folds: vec![Fold::default(); 400],
        count: 0,
        rule: String::new(),
        complete: 400,
    };
    (rows, options())
}

#[test]
fn model_of_a_cell_has_the_trained_errors() {
    for cell in [Cell::Rnn, Cell::Gru, Cell::Lstm] {
        let (rows, options) = windowed(cell);
        let [all, _] = rows.split(None);
        let shape = rows.shape(&[5], &options);
        let units = units(&rows.table, &all, rows.window.as_ref()).unwrap();
        let fitted = solved(&shape, shape.initial(3), 1e-3, (&rows.table, &all, units.clone()), &Silent).unwrap();
        let basis = basis(&shape, &shape.initial(3), &rows.inputs, &units);
        let output = &fitted.output.0;
        let error = |&row: &usize| {
            let row = rows.table.row(row);
            let mut library = [0.0; 9];
            rows.inputs.iter().zip(row).for_each(|(&input, x)| library[input] = *x);
            let inputs: Vec<f64> = basis.inputs().iter().map(|&input| library[input]).collect();
            let mut state = [0.0; 5];
            basis.evaluate(&inputs, &mut state);
            let x = row[..6].iter().zip(units.centre.iter().zip(&units.scale)).map(|(x, (c, s))| (x - c) / s);
            let features = x.chain(state).enumerate();
            let value = features.fold(output[(0, 0)], |sum, (k, feature)| sum + output[(1 + k, 0)] * feature);
            (units.centre[6] + units.scale[6] * value - row[6]).powi(2)
        };
        let expected = all.iter().map(error).sum::<f64>() / 400.0;
        let actual = fitted.errors(&rows.table, &all).unwrap()[0];
        // Training has its own tanh, to 3e-16.
        assert!((actual - expected).abs() < 1e-11 * expected, "{cell:?} {actual} {expected}");
    }
}

#[test]
fn settings_of_hidden_layers_conflict_with_cells() {
    let message = |text: &str| {
        let recipe = Recipe::parse(&format!("[network]\n{text}\n"), "r.toml").unwrap();
        NetworkOptions::new(&recipe).unwrap_err().to_string()
    };
    let refused = message("cell = \"lstm\"\nactivation = \"relu\"");
    assert!(refused.contains("--cell lstm: the cell has its own functions; remove --activation"), "{refused}");
    let refused = message("cell = \"gru\"\nhidden = \"8,4\"");
    assert!(refused.contains("--hidden 8,4: --cell gru is one layer") && refused.contains("--hidden 8"), "{refused}");
    let recipe =
        Recipe::parse("[network]\ncell = \"none\"\nhidden = \"8,4\"\nactivation = \"relu\"\n", "r.toml").unwrap();
    assert_eq!(NetworkOptions::new(&recipe).unwrap().sizes(), [[8, 4]]);
    let recipe = Recipe::parse("[network]\ncell = \"rnn\"\neffort = \"high\"\n", "r.toml").unwrap();
    assert_eq!(NetworkOptions::new(&recipe).unwrap().sizes(), [[8], [16], [32], [64]]);
}
