//! Latents with a network: by the formula, by differences, written out, in files and in text.

use fleetfoot_library::Expr;
use fleetfoot_model::{Activation, Basis, BasisMap, Map, MapKind, Model, Network, describe};

use crate::models;

const AT: [f64; 3] = [0.3, -0.8, 0.6];

fn map(model: &Model, latent: usize) -> &BasisMap {
    match &model.latents[latent].map {
        Map::Basis(map) => map,
        other => panic!("{other:?}"),
    }
}

fn network(map: &BasisMap) -> &Network {
    match &map.basis {
        Basis::Network(network) => network,
        other => panic!("{other:?}"),
    }
}

#[test]
fn value_matches_formula() {
    let formulas: [fn(f64) -> f64; 3] = [f64::tanh, |z| z.max(0.0), |z| z.exp().ln_1p()];
    for (activation, formula) in Activation::ALL.into_iter().zip(formulas) {
        let model = models::network(activation);
        let (map, network_map) = (map(&model, 1), network(map(&model, 1)));
        let mut units: Vec<f64> =
            (0..2).map(|i| (AT[network_map.inputs[i]] - network_map.centre[i]) / network_map.scale[i]).collect();
        for layer in &network_map.layers {
            let sum = |(row, bias): (&Vec<f64>, &f64)| row.iter().zip(&units).map(|(w, z)| w * z).sum::<f64>() + bias;
            units = layer.weights.iter().zip(&layer.biases).map(sum).map(formula).collect();
        }
        let linear = map.affine.constants[0] + (0..3).map(|j| map.affine.coefficients[0][j] * AT[j]).sum::<f64>();
        let by_hand = linear + units.iter().zip(&map.weights[0]).map(|(unit, weight)| unit * weight).sum::<f64>();
        assert!((map.value(0, &AT) - by_hand).abs() < 1e-13, "{activation:?}");
        assert_eq!((map.functions(), map.features(), network_map.count(), network_map.numbers()), (3, 6, 3, 33));
        // Each unit written out over the columns has its value.
        let names = ["x", "y", "u"].map(Expr::column);
        for k in 0..3 {
            let text = map.expression(3 + k, &names).unwrap();
            let value =
                text.value(|name, _| AT[["x", "y", "u"].iter().position(|input| *input == name).unwrap()], |_| 0.0);
            assert!((value - units[k]).abs() < 1e-13, "{activation:?} {text}");
        }
    }
}

#[test]
fn products_with_the_jacobian_are_differences() {
    for activation in Activation::ALL {
        let model = models::network(activation);
        let map = map(&model, 0);
        let mut slopes = vec![1.0; 3];
        map.gradient(0, &AT, 2.0, &mut slopes);
        for (j, slope) in slopes.iter().enumerate() {
            let value = |by: f64| {
                let mut at = AT;
                at[j] += by;
                map.value(0, &at)
            };
            let difference = (value(1e-6) - value(-1e-6)) / 2e-6;
            assert!((slope - 1.0 - 2.0 * difference).abs() < 1e-7, "{activation:?} {j}: {slope} {difference}");
        }
        let change = [0.3, -1.1, 0.7];
        let along: f64 = slopes.iter().zip(change).map(|(slope, change)| (slope - 1.0) / 2.0 * change).sum();
        assert!((map.tangent(0, &AT, &change) - along).abs() < 1e-12, "{activation:?}");
    }
}

#[test]
fn a_file_has_hidden_layers_once_and_reads_back() {
    let model = models::network(Activation::Softplus);
    let text = model.to_json();
    assert_eq!((text.matches("\"softplus\"").count(), text.matches("\"hidden\"").count()), (1, 1));
    let again = Model::from_json(&text, "m.json").unwrap();
    assert_eq!((again.to_json(), &again), (text, &model));
    // Latents of another network have theirs.
    let mut other = model.clone();
    let Map::Basis(map_of) = &mut other.latents[1].map else { panic!("a network") };
    map_of.basis = map(&models::network_regions(), 0).basis.clone();
    map_of.weights = vec![vec![0.5; 6]];
    let input_columns = network(map_of).inputs.clone();
    assert_eq!(input_columns, [0, 1, 3]);
    assert_eq!(other.to_json().matches("\"hidden\"").count(), 2);
    assert!(Model::from_json(&other.to_json(), "m.json").unwrap_err().to_string().contains("does not have"));
}

#[test]
fn inconsistent_models_are_refused() {
    let model = models::network(Activation::Tanh);
    let refused = |change: &dyn Fn(&mut Network), words: &str| {
        let mut model = model.clone();
        for latent in &mut model.latents {
            let Map::Basis(map_of) = &mut latent.map else { panic!("a network") };
            let mut changed = network(map_of).clone();
            change(&mut changed);
            map_of.basis = Basis::Network(changed.into());
        }
        let error = Model::from_json(&model.to_json(), "m.json").unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused(&|network| network.inputs[0] = 9, "does not have");
    refused(&|network| network.scale[1] = 0.0, "not positive");
    refused(&|network| network.centre.truncate(1), "scales");
    refused(&|network| network.layers[1].weights[0].truncate(2), "layer 2");
    refused(&|network| network.layers[0].biases[1] = f64::NAN, "not finite");
    refused(&|network| network.layers.clear(), "without layers");
}

#[test]
fn text_shows_units_as_one_term() {
    let text = describe(&models::network(Activation::Tanh), 1);
    assert!(text.contains("1*network_f_x") && !text.contains("unit1"), "{text}");
    assert!(text.contains("3 units, the last of the hidden layers 5-3 (tanh)"), "{text}");
}
