//! Weights of rows: counts and shares of the same rows fit the same model.

use fleetfoot_data::Silent;
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::Model;
use fleetfoot_pwa::{Options, Problem, Selection, Shrinkage, Specification, identify, partition};
use proptest::prelude::*;

use crate::refined::{Row, normal, options, problem, source};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Four regions of two inputs, noise of 0.05.
fn quadrants(rows: usize) -> Vec<Row> {
    let mut random = Pcg64::seed_from_u64(17);
    let mut row = |_| {
        let x: [f64; 2] = [random.random_range(-1.0..1.0), random.random_range(-1.0..1.0)];
        let slope = if x[0] > 0.0 { 3.0 } else { -2.0 };
        let y = slope * x[1] + if x[1] > 0.1 { 2.0 * x[0] } else { 0.0 };
        (x.to_vec(), y + 0.05 * normal(&mut random))
    };
    (0..rows).map(&mut row).collect()
}

/// The problem with a weight that is an expression of the columns.
fn weighted(weight: &str) -> Problem {
    Problem { weight: Some(Expr::parse(weight, &Scope::new(["x0", "x1", "y"])).unwrap()), ..problem(2) }
}

/// Constants and coefficients of all regions.
fn numbers(model: &Model) -> Vec<f64> {
    let latent = &model.latents[0];
    latent
        .affine()
        .unwrap()
        .constants
        .iter()
        .chain(latent.affine().unwrap().coefficients.iter().flatten())
        .copied()
        .collect()
}

fn ways() -> Vec<Options> {
    let mut all: Vec<Options> =
        [("refined:3", 2), ("tree:4", 4)].map(|(partitions, folds)| options(partitions, folds)).to_vec();
    for shrinkage in [Shrinkage::Rows(30.0), Shrinkage::Auto] {
        let mut shrunk = options("kmeans:4", 4);
        shrunk.shrinkage = shrinkage;
        all.push(shrunk);
    }
    let mut chosen = options("average,kmeans:2,4", 4);
    chosen.selection = Selection::Bic;
    all.push(chosen);
    all
}

#[test]
fn partitions_alone_do_not_ask_for_the_scale_of_weights() {
    let rows = source(&quadrants(600), 4);
    for specification in ["refined:4", "lattice:4", "tree:4"] {
        let options = options(specification, 0);
        let of = |weight: &str| partition(&weighted(weight), &options, &rows, &Silent).unwrap().partitions;
        let rules = |partitions: Vec<(Specification, _)>| -> Vec<fleetfoot_model::Partition> {
            partitions.into_iter().map(|(_, partition)| partition).collect()
        };
        assert_eq!(rules(of("(1 + x0^2)/1073741824")), rules(of("(1 + x0^2)*64")), "{specification}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2))]
    #[test]
    fn the_scale_of_weights_does_not_matter(exponent in -9.0..9.0) {
        let rows = source(&quadrants(400), 4);
        let scale = 10f64.powf(exponent);
        for options in ways() {
            let fitted = |problem: &Problem| numbers(&identify(problem, &options, &rows, &Silent).unwrap().model);
            let pairs = [
                (fitted(&problem(2)), fitted(&weighted(&format!("{scale:e}")))),
                (fitted(&weighted("1.2 + x0")), fitted(&weighted(&format!("(1.2 + x0)*{scale:e}")))),
            ];
            for (one, other) in pairs {
                prop_assert_eq!(one.len(), other.len(), "{:?}", options);
                for (one, other) in one.iter().zip(&other) {
                    // Products with weights round anew.
                    prop_assert!((one - other).abs() < 1e-7 * (1.0 + one.abs()), "{} {}: {:?}", one, other, options);
                }
            }
        }
    }
}
