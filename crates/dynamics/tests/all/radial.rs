//! Latents with radial functions equal those whose library has the same functions written out.

use crate::common::*;
use fleetfoot_data::{MemorySource, Silent, Source};
use fleetfoot_dynamics::{
    Method, Outside, Predicted, Predictor, PredictorWorkspace, RolloutOptions, Simulator, Start, Step,
};
use fleetfoot_library::Expr;
use fleetfoot_model::{Model, Prediction, RadialFunctions, Role, Rule};

/// A model in two regions whose library ends with radial functions written out, and the same with a table of centres.
fn models(prediction: Prediction) -> [Model; 2] {
    let functions = RadialFunctions {
        inputs: vec![parse("q"), parse("u")],
        centres: vec![vec![0.4, -0.3], vec![-0.6, 0.5], vec![0.1, 0.9]],
        scale: vec![0.7, 0.5],
        width: 0.9,
    };
    let radial: Vec<String> = functions.expressions().iter().map(Expr::to_string).collect();
    let library: Vec<&str> = ["q", "v", "u"].into_iter().chain(radial.iter().map(String::as_str)).collect();
    let columns =
        vec![column("q", Role::State, false), column("v", Role::State, false), column("u", Role::Input, false)];
    let rule = Rule::voronoi(vec![vec![-0.5], vec![0.6]]);
    let size = if prediction == Prediction::Next { 0.3 } else { 1.0 };
    let map = |seed: u64| (size * noise(seed), (0..6).map(|j| size * noise(seed + 1 + j)).collect::<Vec<f64>>());
    let fitted = vec![("q", prediction, "1", vec![map(10), map(20)]), ("v", prediction, "1", vec![map(30), map(40)])];
    let mut written = model(columns, &library, partition(&["v"], &[0.0], &[1.0], rule), fitted, &[]);
    for region in &mut written.summaries[0].regions {
        // Narrow ranges, so that rollouts leave them.
        region.range = vec![[-0.8, 0.8]; 6];
    }
    let mut gathered = written.clone();
    functions.gather(&mut gathered);
    gathered.validate().unwrap();
    // Values of radial functions are always between 0 and 1: what leaves the ranges are the others.
    for region in &mut written.summaries[0].regions {
        region.range[3..].fill([0.0, 1.0]);
    }
    [written, gathered]
}

fn recording() -> MemorySource {
    let values = |shift: f64| (0..80).map(|k| 0.9 * (0.21 * f64::from(k) + shift).sin()).collect::<Vec<f64>>();
    source(&["q", "v", "u"], 0.05, vec![vec![values(0.0), values(1.0), values(2.5)]])
}

#[test]
fn predictions_are_the_same() {
    let source = recording();
    let [written, gathered] = models(Prediction::Derivative).map(|model| {
        let predictor = Predictor::new(&model, &["q", "v", "u"]).unwrap();
        let block = source.read(0, 0..80, predictor.halo()).unwrap();
        let mut out = Predicted::default();
        predictor.predict(&block, 0..80, &mut PredictorWorkspace::default(), &mut out);
        out
    });
    assert_eq!((&written.region, &written.status), (&gathered.region, &gathered.status));
    for (left, other) in written.predicted.iter().zip(&gathered.predicted) {
        assert!((left - other).abs() < 1e-13, "{left} {other}");
    }
    // The place in the training domain is that of the functions that are left.
    assert!(gathered.distance.iter().all(|distance| distance.is_finite()));
}

#[test]
fn rollouts_are_the_same_wherever_they_go() {
    let source = recording();
    for (prediction, method) in [
        (Prediction::Derivative, Method::Rk4),
        (Prediction::Next, Method::Euler),
        (Prediction::Difference, Method::Euler),
    ] {
        for outside in [Outside::Tell, Outside::End] {
            let mut options = RolloutOptions::new(30);
            (options.method, options.step, options.outside) = (method, Step::Seconds(0.05), outside);
            let starts = [3, 20, 41].map(|row| Start { episode: 0, row });
            let [written, gathered] = models(prediction).map(|model| {
                Simulator::new(&model).unwrap().trajectories(&source, &starts, &options, &Silent).unwrap()
            });
            for (left, other) in written.into_iter().zip(gathered) {
                let (left, other) = (left.unwrap(), other.unwrap());
                assert_eq!(left.states.len(), other.states.len());
                for (a, b) in left.states.iter().zip(&other.states) {
                    assert!((a - b).abs() < 1e-11, "{prediction:?} {outside:?}: {a} {b}");
                }
            }
        }
    }
}

#[test]
fn held_inputs_give_radial_functions_at_the_border() {
    let source = recording();
    let model = &models(Prediction::Next)[1];
    let mut options = RolloutOptions::new(1);
    (options.step, options.outside) = (Step::Seconds(0.05), Outside::Hold);
    let block = source.read(0, 0..80, Default::default()).unwrap();
    let mut held = 0;
    for row in 1..60 {
        let start = [Start { episode: 0, row }];
        let trajectories = Simulator::new(model).unwrap().trajectories(&source, &start, &options, &Silent).unwrap();
        let states = &trajectories[0].as_ref().unwrap().states;
        let at = [0, 1, 2].map(|column| block.column(column)[row]);
        let border = at.map(|value| value.clamp(-0.8, 0.8));
        held += usize::from(at != border);
        let region = usize::from(at[1] > 0.05);
        for (s, latent) in model.latents.iter().enumerate() {
            assert!((states[2 + s] - latent.map.value(region, &border)).abs() < 1e-13, "{row} {s}");
        }
    }
    assert!(held > 10);
}
