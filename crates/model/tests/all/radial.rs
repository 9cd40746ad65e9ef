//! Radial latents: by a formula, by differences, in files, and of the candidates of a fit.

use std::sync::Arc;

use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{
    AffineMap, Basis, BasisMap, Gaussian, Map, MapKind, Model, Partition, RadialFunctions, Rule, describe,
};

use crate::models;

/// Of three functions the radial ones read the third and the first.
fn map() -> BasisMap {
    BasisMap {
        affine: AffineMap {
            constants: vec![0.5, -1.0],
            coefficients: vec![vec![1.0, -2.0, 0.0], vec![0.0, 0.25, 3.0]],
        },
        basis: Basis::Gaussian(Arc::new(Gaussian {
            inputs: vec![2, 0],
            centres: vec![vec![0.3, -0.4], vec![1.2, 0.1]],
            scale: vec![2.0, 0.5],
            width: 0.8,
        })),
        weights: vec![vec![4.0, -1.5], vec![0.0, 2.0]],
    }
}

const AT: [f64; 3] = [0.2, -0.7, 0.9];

#[test]
fn value_matches_formula() {
    let map = map();
    let [x, y, z] = AT;
    let phi = |c: f64, d: f64| (-(((z - c) / 2.0).powi(2) + ((x - d) / 0.5).powi(2)) / (2.0 * 0.8 * 0.8)).exp();
    let by_hand = 0.5 + x - 2.0 * y + 4.0 * phi(0.3, -0.4) - 1.5 * phi(1.2, 0.1);
    assert!((map.value(0, &AT) - by_hand).abs() < 1e-15);
    let other = -1.0 + 0.25 * y + 3.0 * z + 2.0 * phi(1.2, 0.1);
    assert!((map.value(1, &AT) - other).abs() < 1e-15);
    assert_eq!((map.functions(), map.features(), map.regions(), map.parameters()), (3, 5, 2, 7));
    assert!((0..3).all(|function| map.reads(function)));
}

#[test]
fn products_with_the_jacobian_are_differences() {
    let map = map();
    for region in 0..2 {
        let mut slopes = vec![1.0; 3];
        map.gradient(region, &AT, 2.0, &mut slopes);
        for (j, slope) in slopes.iter().enumerate() {
            let value = |by: f64| {
                let mut at = AT;
                at[j] += by;
                map.value(region, &at)
            };
            let difference = (value(1e-5) - value(-1e-5)) / 2e-5;
            // The product is added to what is there.
            assert!((slope - 1.0 - 2.0 * difference).abs() < 1e-8, "{region} {j}: {slope} {difference}");
        }
        let change = [0.3, -1.1, 0.7];
        let along: f64 = slopes.iter().zip(change).map(|(slope, change)| (slope - 1.0) / 2.0 * change).sum();
        assert!((map.tangent(region, &AT, &change) - along).abs() < 1e-14);
    }
}

/// Two states and an input, radial functions of two of them written out beside the others.
fn written_out(functions: &RadialFunctions, share: f64) -> Model {
    let mut maker = models::Maker::new(3, "pwa", &[("x", models::STATE), ("z", models::STATE), ("u", models::INPUT)]);
    let names: Vec<String> = ["x".to_owned(), "u".into(), "z".into()]
        .into_iter()
        .chain(functions.expressions().iter().map(Expr::to_string))
        .collect();
    let library = maker.library(&names.iter().map(String::as_str).collect::<Vec<_>>());
    let rule = maker.voronoi(2, 2);
    let partition = maker.partition("kmeans:2", &["x", "z"], rule);
    maker.latent("f_x", library, partition, share);
    maker.latent("f_z", library, partition, share);
    maker.equation("x", fleetfoot_model::Prediction::Derivative, "f_x");
    maker.equation("z", fleetfoot_model::Prediction::Derivative, "f_z");
    maker.finish()
}

fn functions() -> RadialFunctions {
    let scope = Scope::new(["x", "z", "u"]);
    RadialFunctions {
        inputs: ["x", "z"].map(|text| Expr::parse(text, &scope).unwrap()).to_vec(),
        centres: vec![vec![0.1, -0.2], vec![0.9, 0.3], vec![-0.7, 0.6]],
        scale: vec![0.8, 0.6],
        width: 1.25,
    }
}

#[test]
fn candidates_become_a_table_of_centres() {
    let (functions, model) = (functions(), written_out(&functions(), 0.9));
    let mut gathered = model.clone();
    functions.gather(&mut gathered);
    gathered.validate().unwrap();
    assert_eq!(gathered.libraries[0].len(), 3);
    for (latent, from) in gathered.latents.iter().zip(&model.latents) {
        assert!(latent.affine().is_none() && from.affine().is_some());
        for region in 0..2 {
            assert_eq!(latent.map.constant(region), from.map.constant(region));
            (0..6).for_each(|j| assert_eq!(latent.map.coefficient(region, j), from.map.coefficient(region, j), "{j}"));
        }
        // Written out again they are the candidates.
        for k in 3..6 {
            let expression = latent.map.expression(k, &gathered.libraries[0]).unwrap();
            assert_eq!(expression, model.libraries[0][k]);
        }
    }
    for (region, from) in gathered.summaries[0].regions.iter().zip(&model.summaries[0].regions) {
        assert_eq!((region.mean.as_slice(), region.covariance.as_slice()), (&from.mean[..3], &from.covariance[..6]));
        assert_eq!((region.range.as_slice(), region.rows), (&from.range[..3], from.rows));
    }
    let text = describe(&gathered, 9);
    assert!(text.contains("radial1 to radial3: exp(-|(u - c)/s|^2/(2*w^2)) of u = (x, z), width w = 1.25"), "{text}");
    assert!(text.contains("*radial2") && text.contains("radial3  -0.7, 0.6"), "{text}");
    // A model without them stays as it is.
    let mut other = models::sindy();
    let before = other.to_json();
    functions.gather(&mut other);
    assert_eq!(other.to_json(), before);
}

#[test]
fn unused_input_is_added_to_the_library() {
    let functions = functions();
    let mut model = written_out(&functions, 0.9);
    // Without x and its coefficient.
    for latent in &mut model.latents {
        latent.affine_mut().unwrap().coefficients.iter_mut().for_each(|row| *row = row[1..].to_vec());
    }
    model.libraries[0].remove(0);
    for region in &mut model.summaries[0].regions {
        (region.mean, region.range) = (vec![0.5; 5], vec![[0.0, 1.0]; 5]);
        region.covariance = vec![0.25; 15];
    }
    model.validate().unwrap();
    functions.gather(&mut model);
    model.validate().unwrap();
    let names: Vec<String> = model.libraries[0].iter().map(ToString::to_string).collect();
    assert_eq!(names, ["u", "z", "x"]);
    let Map::Basis(radial) = &model.latents[0].map else { panic!("{:?}", model.latents[0]) };
    assert_eq!(radial.basis.inputs(), [2, 1]);
    let region = &model.summaries[0].regions[0];
    assert!(region.mean[2].is_nan() && region.covariance[5].is_nan() && region.mean[1] == 0.5);
    assert_eq!(region.range[2], [f64::NEG_INFINITY, f64::INFINITY]);
}

#[test]
fn centres_match_partition_and_set_widths() {
    let scope = Scope::new(["x", "z"]);
    let partition = Partition {
        columns: ["x", "z"].map(|text| Expr::parse(text, &scope).unwrap()).to_vec(),
        centre: vec![10.0, 0.0],
        scale: vec![2.0, 1.0],
        rule: Rule::voronoi(vec![vec![0.0, 0.0], vec![3.0, 4.0], vec![0.0, 1.0]]),
        ..Partition::whole()
    };
    let radial_functions = RadialFunctions::around(&partition).unwrap();
    assert_eq!(radial_functions.centres, [[10.0, 0.0], [16.0, 4.0], [10.0, 1.0]]);
    // Nearest others: 1, sqrt(9 + 9), 1.
    assert!((radial_functions.width - (2.0 + 18f64.sqrt()) / 3.0).abs() < 1e-15);
    assert_eq!(RadialFunctions::around(&Partition::whole()), None);
    let one = Partition { rule: Rule::voronoi(vec![vec![0.5, 0.5]]), ..partition };
    assert_eq!(RadialFunctions::around(&one).unwrap().width, 1.0);
}

fn gaussian(map: &mut BasisMap) -> &mut Gaussian {
    match &mut map.basis {
        Basis::Gaussian(gaussian) => Arc::make_mut(gaussian),
        other => panic!("{other:?}"),
    }
}

#[test]
fn inconsistent_models_are_refused() {
    let mut model = models::radial();
    let json = |model: &Model| Model::from_json(&model.to_json(), "m.json").map(|_| ()).map_err(|e| e.to_string());
    json(&model).unwrap();
    let mut change = |change: &dyn Fn(&mut BasisMap), words: &str| {
        let before = model.latents[0].map.clone();
        let Map::Basis(radial) = &mut model.latents[0].map else { panic!("a radial latent") };
        change(radial);
        let error = json(&model).unwrap_err();
        assert!(error.contains(words), "{error}");
        model.latents[0].map = before;
    };
    change(&|radial| radial.weights.clear(), "weights for 0 of 1 regions");
    change(&|radial| radial.weights[0].truncate(1), "functions of the basis each");
    change(&|radial| gaussian(radial).inputs[0] = 7, "does not have");
    change(&|radial| gaussian(radial).width = 0.0, "not positive");
    change(&|radial| gaussian(radial).scale[0] = f64::NAN, "not positive");
    change(&|radial| gaussian(radial).centres[1][0] = f64::INFINITY, "not finite");
    change(&|radial| gaussian(radial).scale.truncate(1), "scales");
}
