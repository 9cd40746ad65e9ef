//! Code of recurrent cells against the model.

use std::sync::Arc;

use fleetfoot_codegen::{ExportOptions, Target, evaluate_at, export, test_vectors};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{Basis, Cell, Map, Model};

use crate::models;

/// The model of a cell whose functions all read the present row, so that their values are known without a past.
fn present(cell: Cell) -> Model {
    let mut model = models::recurrent(cell);
    let texts = ["x", "y", "u", "x*u", "y*u", "x*y", "u^2"];
    model.libraries[0] = texts.map(|text| Expr::parse(text, &Scope::open()).expect("a function")).to_vec();
    model
}

#[test]
fn code_of_cells_has_the_models_values() {
    for cell in Cell::ALL {
        let model = present(cell);
        let mut options = ExportOptions::new(Target::C);
        options.domain = false;
        let vector = test_vectors(&model, &options, 1, 5).expect("vectors").swap_remove(0);
        let points = (0..20u64).map(|point| {
            let draw = |at: u64| (fleetfoot_data::mix(3 * point + at) >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
            let mut vector = vector.clone();
            (vector.x, vector.u) = (vec![draw(0), draw(1)], vec![draw(2)]);
            vector
        });
        for point in evaluate_at(&model, &options, points.collect()).expect("values") {
            let (x, y, u) = (point.x[0], point.x[1], point.u[0]);
            let functions = [x, y, u, x * u, y * u, x * y, u * u];
            let result = point.results.iter().find(|result| result.function == "next").expect("a step");
            let expected = [model.latents[0].map.value(0, &functions), y + model.latents[1].map.value(0, &functions)];
            for (actual, expected) in result.values.iter().zip(expected) {
                // A hundred roundings of numbers near 1.
                assert!((actual - expected).abs() < 1e-13, "{cell:?} {actual} {expected}");
            }
        }
    }
}

#[test]
fn code_does_not_grow_with_the_window() {
    for cell in Cell::ALL {
        let source = |model: &Model| {
            let export = export(model, &ExportOptions::new(Target::C), &[]).expect("C");
            let source = export.files.iter().find(|file| file.name.ends_with(".c")).expect("a source");
            String::from_utf8(source.bytes.clone()).expect("text")
        };
        let model = models::recurrent(cell);
        let mut longer = model.clone();
        for latent in &mut longer.latents {
            let Map::Basis(map) = &mut latent.map else { panic!("a cell") };
            let Basis::Recurrent(recurrent) = &mut map.basis else { panic!("a cell") };
            let recurrent = Arc::make_mut(recurrent);
            recurrent.inputs = [[5, 6].repeat(9), recurrent.inputs.clone()].concat();
        }
        let [calls, calls_of_longer] = [&model, &longer].map(|model| source(model).matches("tanh(").count());
        assert!(calls > 0 && calls == calls_of_longer, "{cell:?} {calls} {calls_of_longer}");
    }
}
