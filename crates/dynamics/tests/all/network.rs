//! Latents with a network do what the same units do that are written out in a library.

use std::sync::Arc;

use crate::common::*;
use fleetfoot_data::{Silent, Source};
use fleetfoot_dynamics::{
    Method, Outside, Predicted, Predictor, PredictorWorkspace, RolloutOptions, Simulator, Start, Step,
};
use fleetfoot_model::{Activation, AffineMap, Basis, BasisMap, DenseLayer, Model, Network, Prediction, Role, Rule};

/// A model in two regions whose library ends with the units of a network of two layers written out, and the same with the network.
fn models(prediction: Prediction, activation: Activation) -> [Model; 2] {
    let layer = |units: usize, inputs: usize, seed: u64| DenseLayer {
        weights: (0..units).map(|i| (0..inputs).map(|j| noise(seed + (10 * i + j) as u64)).collect()).collect(),
        biases: (0..units).map(|i| noise(seed + 500 + i as u64)).collect(),
    };
    let network = Network {
        inputs: vec![2, 0],
        centre: vec![0.2, -0.1],
        scale: vec![0.7, 0.5],
        activation,
        layers: vec![layer(4, 2, 1000), layer(3, 4, 2000)],
    };
    let inputs = [parse("u"), parse("q")];
    let units: Vec<String> = (0..3).map(|k| network.expression(k, &inputs).to_string()).collect();
    let library: Vec<&str> = ["q", "v", "u"].into_iter().chain(units.iter().map(String::as_str)).collect();
    let columns =
        vec![column("q", Role::State, false), column("v", Role::State, false), column("u", Role::Input, false)];
    let rule = Rule::voronoi(vec![vec![-0.5], vec![0.6]]);
    let size = if prediction == Prediction::Next { 0.2 } else { 1.0 };
    let map = |seed: u64| (size * noise(seed), (0..6).map(|j| size * noise(seed + 1 + j)).collect::<Vec<f64>>());
    let fitted = vec![("q", prediction, "1", vec![map(10), map(20)]), ("v", prediction, "1", vec![map(30), map(40)])];
    let written = model(columns, &library, partition(&["v"], &[0.0], &[1.0], rule), fitted, &[]);
    let mut gathered = written.clone();
    let basis = Basis::Network(Arc::new(network));
    gathered.libraries[0].truncate(3);
    for latent in &mut gathered.latents {
        let AffineMap { constants, coefficients } = latent.affine().unwrap().clone();
        let [linear, weights] =
            [0..3, 3..6].map(|part| coefficients.iter().map(|row| row[part.clone()].to_vec()).collect());
        let affine = AffineMap { constants, coefficients: linear };
        latent.map = BasisMap { affine, basis: basis.clone(), weights }.into();
    }
    for region in &mut gathered.summaries[0].regions {
        region.range.truncate(3);
        region.mean.truncate(3);
        region.covariance.truncate(6);
    }
    gathered.validate().unwrap();
    [written, gathered]
}

fn recording() -> fleetfoot_data::MemorySource {
    let values = |shift: f64| (0..80).map(|k| 0.9 * (0.21 * f64::from(k) + shift).sin()).collect::<Vec<f64>>();
    source(&["q", "v", "u"], 0.05, vec![vec![values(0.0), values(1.0), values(2.5)]])
}

#[test]
fn predictions_and_rollouts_are_the_same() {
    let source = recording();
    for activation in Activation::ALL {
        for prediction in [Prediction::Derivative, Prediction::Next] {
            let both = models(prediction, activation);
            let [written, gathered] = both.each_ref().map(|model| {
                let predictor = Predictor::new(model, &["q", "v", "u"]).unwrap();
                let block = source.read(0, 0..80, predictor.halo()).unwrap();
                let mut out = Predicted::default();
                predictor.predict(&block, 0..80, &mut PredictorWorkspace::default(), &mut out);
                out
            });
            assert_eq!(written.status, gathered.status);
            for (left, other) in written.predicted.iter().zip(&gathered.predicted) {
                assert!((left - other).abs() < 1e-12 || left.is_nan(), "{activation:?} {left} {other}");
            }
            let mut options = RolloutOptions::new(30);
            options.method = if prediction == Prediction::Next { Method::Euler } else { Method::Rk4 };
            (options.step, options.outside) = (Step::Seconds(0.05), Outside::Tell);
            let starts = [3, 20, 41].map(|row| Start { episode: 0, row });
            let [written, gathered] = both
                .each_ref()
                .map(|model| Simulator::new(model).unwrap().trajectories(&source, &starts, &options, &Silent).unwrap());
            for (left, other) in written.into_iter().zip(gathered) {
                let (left, other) = (left.unwrap(), other.unwrap());
                assert_eq!(left.states.len(), other.states.len());
                assert!(left.states.len() > 10);
                for (a, b) in left.states.iter().zip(&other.states) {
                    assert!((a - b).abs() < 1e-11, "{activation:?} {prediction:?}: {a} {b}");
                }
            }
        }
    }
}
