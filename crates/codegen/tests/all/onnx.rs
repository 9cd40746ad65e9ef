//! Models as ONNX networks: what is written reads back, what cannot be written is refused, damage is an error.

use fleetfoot_codegen::{ExportError, ExportOptions, OnnxNetwork, Precision, Target, export};
use fleetfoot_library::Expr;
use fleetfoot_model::{Activation, Cell, Map, Model, Rule};

use crate::models;

#[path = "../../../../fuzz/fuzz_targets/body/onnx.rs"]
mod body;

/// A network of two layers over columns, of which the network skips one and reads the others in another order.
fn network(activation: Activation) -> Model {
    let mut model = models::network(activation);
    model.libraries[0][1] = Expr::column("a").shifted(1);
    model.equations[0].right = Expr::column("f_x");
    model
}

fn written(model: &Model, precision: Precision) -> Result<Vec<u8>, ExportError> {
    let mut options = ExportOptions::new(Target::Onnx);
    options.precision = precision;
    let mut exported = export(model, &options, &[])?;
    assert_eq!((exported.files.len(), exported.files[0].name.as_str()), (1, "model.onnx"));
    Ok(exported.files.swap_remove(0).bytes)
}

fn names(count: usize) -> Vec<String> {
    (0..count).map(|at| format!("c{at}")).collect()
}

fn read(bytes: &[u8]) -> Vec<Map> {
    OnnxNetwork::read(bytes, &names(3), &names(2)).unwrap_or_else(|error| panic!("{error}")).maps()
}

/// Rows of three values in [-2, 2).
fn rows() -> impl Iterator<Item = [f64; 3]> {
    (0..100u64)
        .map(|row| [0, 1, 2].map(|at| (fleetfoot_data::mix(3 * row + at) >> 11) as f64 / (1u64 << 51) as f64 - 2.0))
}

#[test]
fn written_networks_read_back() {
    for activation in Activation::ALL {
        let model = network(activation);
        // Sums in another order; 32-bit numbers have 24 bits, and values are below 100.
        for (precision, room) in [(Precision::Double, 1e-13), (Precision::Float, 1e-5)] {
            let maps = read(&written(&model, precision).expect("a network"));
            for row in rows() {
                for (map, latent) in maps.iter().zip(&model.latents) {
                    let (actual, expected) = (map.value(0, &row), latent.map.value(0, &row));
                    assert!((actual - expected).abs() < room, "{activation:?} {precision:?}: {actual} {expected}");
                }
            }
        }
    }
}

#[test]
fn written_cells_read_back() {
    for cell in Cell::ALL {
        let model = models::recurrent(cell);
        for (precision, room) in [(Precision::Double, 1e-13), (Precision::Float, 1e-5)] {
            let file = written(&model, precision).expect("a network");
            let network = OnnxNetwork::read(&file, &names(7), &names(2)).unwrap_or_else(|error| panic!("{error}"));
            for row in 0..50u64 {
                let draw = |at: u64| (fleetfoot_data::mix(7 * row + at) >> 11) as f64 / (1u64 << 51) as f64 - 2.0;
                let row: Vec<f64> = (0..7).map(draw).collect();
                for (map, latent) in network.maps().iter().zip(&model.latents) {
                    let (actual, expected) = (map.value(0, &row), latent.map.value(0, &row));
                    assert!((actual - expected).abs() < room, "{cell:?} {precision:?}: {actual} {expected}");
                }
            }
        }
    }
}

#[test]
fn affine_models_are_one_product() {
    let mut model = network(Activation::Tanh);
    for latent in &mut model.latents {
        if let Map::Basis(map) = &latent.map {
            latent.map = map.affine.clone().into();
        }
    }
    let maps = read(&written(&model, Precision::Double).expect("a network"));
    let latents: Vec<Map> = model.latents.into_iter().map(|latent| latent.map).collect();
    assert_eq!(maps, latents);
}

#[test]
fn models_beyond_networks_are_refused_by_name() {
    let refused = |model: &Model, words: &[&str]| {
        let message = written(model, Precision::Float).expect_err("a refusal").to_string();
        words.iter().for_each(|word| assert!(message.contains(word), "`{word}` is missing from: {message}"));
    };
    let changed = |change: fn(&mut Model)| {
        let mut model = network(Activation::Tanh);
        change(&mut model);
        model
    };
    refused(&models::network(Activation::Tanh), &["ONNX networks cannot have the equation", "f_x - 0.1*x"]);
    refused(&changed(|model| model.libraries[0][1] = Expr::column("a").sin()), &["the function sin(a)", "[columns]"]);
    refused(&changed(|model| model.libraries[0][1] = Expr::column("a").shifted(-1)), &["the function lead(a, 1)"]);
    // Of the equations one is given: all statistics are those of the other.
    let given = changed(|model| {
        model.equations[0].target = None;
        model.summaries[0].regions[0].residual_covariance.truncate(1);
        model.training.target_mean.truncate(1);
        model.training.target_deviation.truncate(1);
        model.training.target_covariance.truncate(1);
    });
    refused(&given, &["cannot have the equation d(x)/dt = f_x"]);
    let changed_partition = changed(|model| {
        model.partitions[0].rule = Rule::Linear { weights: vec![vec![]; 2], offsets: vec![0.0; 2] };
        for latent in &mut model.latents {
            let Map::Basis(map) = &mut latent.map else { continue };
            map.affine.constants.push(0.0);
            map.affine.coefficients.push(vec![0.0; 3]);
            map.weights.push(map.weights[0].clone());
        }
        let region = model.summaries[0].regions[0].clone();
        model.summaries[0].regions.push(region);
    });
    refused(&changed_partition, &["the partition average of f_x", "export the model as C"]);
    refused(&models::radial(), &["ONNX networks cannot have"]);
    let huge = changed(|model| model.latents[0].map.set(0, None, 1e39));
    refused(&huge, &["1e39", "32 bits", "constants"]);
    written(&huge, Precision::Double).expect("64 bits suffice");
}

#[test]
fn damaged_networks_do_no_harm() {
    let file = written(&network(Activation::Softplus), Precision::Float).expect("a network");
    let refused = refused_damages([3, 2], file);
    // Most cuts lose the graph's shape; most bits are those of weights.
    assert!((60..200).contains(&refused), "{refused}");
}

#[test]
fn damaged_cells_do_no_harm() {
    for cell in Cell::ALL {
        let file = written(&models::recurrent(cell), Precision::Float).expect("a cell");
        let refused = refused_damages([7, 2], file);
        assert!((60..200).contains(&refused), "{cell:?} {refused}");
    }
}

/// Of 200 damages of a file with so many inputs and outputs, how many are refused; none does harm.
fn refused_damages(sizes: [u8; 2], file: Vec<u8>) -> usize {
    let whole: Vec<u8> = sizes.into_iter().chain(file).collect();
    assert!(body::run(&whole));
    let refused = |case: u64| {
        let (mut bytes, draw) = (whole.clone(), fleetfoot_data::mix(case + 1) as usize);
        match case % 2 {
            0 => bytes.truncate(2 + draw % (whole.len() - 2)),
            _ => bytes[2 + draw % (whole.len() - 2)] ^= 1 << (draw >> 40 & 7),
        }
        !body::run(&bytes)
    };
    (0..200).filter(|case| refused(*case)).count()
}
