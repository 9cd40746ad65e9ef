//! Maps that contract in one metric: the bound, the metric and the price are checked from the model's own numbers.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, Side};
use fleetfoot_data::{Column as DataColumn, MemorySource, Silent, with_threads};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{Column, Model, Prediction, Role};
use fleetfoot_pwa::{Contracting, Error, Options, Problem, identify};
use fleetfoot_stats::{spectral_radius, svd};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::bounded::{self, H, Price, equation, goes_to_the_nearest, metric, run};

/// An oscillator whose states are measured with noise, so that maps of small regions are wrong by much; rows of next values.
fn oscillator(rows: usize, seed: u64) -> MemorySource {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut source = MemorySource::new(["x", "v", "u"].map(DataColumn::float).to_vec());
    for _ in 0..5 {
        let (mut x, mut v) = (1.0_f64, 0.0_f64);
        let mut columns = vec![Vec::new(); 3];
        for _ in 0..rows / 5 {
            let u: f64 = random.random_range(-2.0..2.0);
            let mut noise = || random.random_range(-0.4..0.4);
            let measured = [x + noise(), v + noise(), u];
            columns.iter_mut().zip(measured).for_each(|(column, value)| column.push(value));
            (x, v) = (0.98 * x + 0.2 * v, -0.2 * x + 0.97 * v + 0.3 * u);
        }
        source.push_uniform("run", H, columns);
    }
    source
}

fn problem() -> Problem {
    bounded::next_rows("u")
}

fn options(partitions: &str, bound: Option<f64>) -> Options {
    let mut options = bounded::options(partitions);
    options.stability = bound;
    options
}

/// M of a region of a model of next values whose first functions are its states.
fn map(model: &Model, region: usize, n: usize) -> Mat<f64> {
    Mat::from_fn(n, n, |i, j| model.latents[i].affine().unwrap().coefficients[region][j])
}

/// The largest singular value of M in the metric, by the Cholesky factor of the reported P alone.
fn norm(M: &Mat<f64>, P: &Mat<f64>) -> f64 {
    use faer::linalg::solvers::Solve;
    let T = P.llt(Side::Lower).unwrap().L().transpose().to_owned();
    let inverse = T.partial_piv_lu().solve(Mat::<f64>::identity(T.nrows(), T.ncols()));
    svd((&T * M * &inverse).as_ref()).unwrap().s[0]
}

#[test]
fn all_regions_contract_in_the_reported_metric() {
    let source = oscillator(2000, 1);
    let (free, bound) = (
        run(&problem(), &options("kmeans:30", None), &source),
        run(&problem(), &options("kmeans:30", Some(1.0)), &source),
    );
    let stability = bound.candidates[0].stability.as_ref().unwrap();
    assert_eq!(stability.variables, ["x", "v"]);
    assert!(stability.inputs.is_empty());
    let P = metric(stability);
    let grows = |model: &Model| (0..30).filter(|&region| spectral_radius(map(model, region, 2).as_ref()) > 1.0).count();
    assert!(grows(&free.model) > 0, "else there is nothing to show");
    assert_eq!(grows(&bound.model), 0);
    let mut stayed = 0;
    for (region, stable) in stability.regions.iter().enumerate() {
        let norm_of_map = norm(&map(&bound.model, region, 2), &P);
        assert!(norm_of_map <= 1.0 + 1e-9 && (norm_of_map - stable.norm).abs() < 1e-9, "{norm_of_map} {stable:?}");
        assert!((norm(&map(&free.model, region, 2), &P) - stable.free_norm).abs() < 1e-9);
        assert!(stable.gap <= 1e-7, "{stable:?}");
        let same = (0..2).all(|t| {
            bound.model.latents[t].affine().unwrap().coefficients[region]
                == free.model.latents[t].affine().unwrap().coefficients[region]
        });
        assert_eq!(same, stable.free_norm <= 1.0, "what contracts already stays to the bit");
        stayed += usize::from(same);
    }
    assert!(stayed > 0 && stayed < 30 && stability.moved() == 30 - stayed);
    // The price is told, and it is the free fit's own loss beside it.
    let score = &bound.candidates[0];
    assert!((score.free_loss - free.candidates[0].loss).abs() < 1e-12);
    // Noise made the regions wild: bound ones predict rows that did not train no worse here.
    assert!(score.loss < 1.02 * score.free_loss, "{} {}", score.loss, score.free_loss);
    // Whatever region follows on whatever: no product of maps is larger than 1 in the metric.
    let mut random = Pcg64::seed_from_u64(3);
    let mut product = Mat::<f64>::identity(2, 2);
    for _ in 0..500 {
        product = map(&bound.model, random.random_range(0..30), 2) * &product;
        assert!(norm(&product, &P) <= 1.0 + 1e-9);
    }
}

/// The squared errors of a region's rows are least among maps within the bound. None of many random steps is better by
/// more than the gap.
#[test]
fn no_map_within_the_bound_has_less_error() {
    let source = oscillator(1000, 2);
    let identification = run(&problem(), &options("average", Some(0.9)), &source);
    let stability = identification.candidates[0].stability.as_ref().unwrap();
    let P = metric(stability);
    let free = run(&problem(), &options("average", None), &source).model;
    let is_within = |map_of: &[[f64; 4]; 2]| norm(&Mat::from_fn(2, 2, |i, j| map_of[i][j + 1]), &P) <= 0.9;
    Price::new(&source, &free).is_least(&identification.model, is_within);
}

#[test]
fn bounded_models_are_the_nearest() {
    let source = oscillator(2000, 4);
    let identification = run(&problem(), &options("kmeans:8", Some(0.98)), &source);
    let stability = identification.candidates[0].stability.as_ref().unwrap();
    let (set, P) = (Contracting::new(&problem(), stability).unwrap(), metric(stability));
    let is_within = |model: &Model, region: usize, rounded: bool| {
        norm(&map(model, region, 2), &P) <= 0.98 + if rounded { 1e-9 } else { 0.0 }
    };
    let nearest = goes_to_the_nearest(&set, &identification.model, 0.3, is_within);
    let after = set.stability_of(stability, &nearest);
    assert!(after.regions.iter().all(|region| region.norm <= 0.98 + 1e-9 && region.radius <= region.norm + 1e-9));
}

#[test]
fn earlier_rows_are_part_of_the_map() {
    let source = oscillator(1500, 3);
    let mut problem = problem();
    problem.columns = [("x", Role::State), ("u", Role::Input), ("v", Role::Auxiliary)]
        .map(|(name, role)| Column::new(name, role))
        .to_vec();
    problem.library = vec![Expr::column("x"), Expr::lagged("x", 1), Expr::column("u")];
    problem.equations = vec![equation("x", Prediction::Next, "f_x", Some(Expr::lagged("x", -1)))];
    problem.partition_columns = vec![Expr::column("x"), Expr::lagged("x", 1)];
    let identification = run(&problem, &options("kmeans:20", Some(0.999)), &source);
    let stability = identification.candidates[0].stability.as_ref().unwrap();
    assert_eq!(stability.variables, ["x", "lag(x, 1)"]);
    assert!(stability.moved() > 0);
    let P = metric(stability);
    for region in 0..20 {
        let [a, b] = [0, 1].map(|j| identification.model.latents[0].affine().unwrap().coefficients[region][j]);
        let M = Mat::from_fn(2, 2, |i, j| [[a, b], [1.0, 0.0]][i][j]);
        assert!(norm(&M, &P) <= 0.999 + 1e-9);
        assert!(spectral_radius(M.as_ref()) <= 0.999 + 1e-9);
    }
}

#[test]
fn map_includes_given_equations_and_derivatives() {
    let source = oscillator(1500, 4);
    let mut problem = problem();
    problem.equations = vec![
        equation("x", Prediction::Derivative, "v", None),
        equation(
            "v",
            Prediction::Derivative,
            "f_v",
            Some((Expr::lagged("v", -1) - &Expr::column("v")) / Expr::number(0.05)),
        ),
    ];
    let identification = run(&problem, &options("kmeans:20", Some(1.0)), &source);
    let stability = identification.candidates[0].stability.as_ref().unwrap();
    let P = metric(stability);
    let maps: Vec<Mat<f64>> = (0..20)
        .map(|region| {
            let [a, b] = [0, 1].map(|j| identification.model.latents[0].affine().unwrap().coefficients[region][j]);
            Mat::from_fn(2, 2, |i, j| [[1.0, 0.05], [0.05 * a, 1.0 + 0.05 * b]][i][j])
        })
        .collect();
    match stability.variables.len() {
        2 => maps.iter().for_each(|M| assert!(norm(M, &P) <= 1.0 + 1e-9)),
        // The positions act as an input.
        _ => {
            assert_eq!(stability.inputs, ["x"]);
            maps.iter().for_each(|M| assert!(M[(1, 1)].abs() <= 1.0 + 1e-9));
        }
    }
}

#[test]
fn threads_do_not_matter_and_unbounded_models_are_refused() {
    let source = oscillator(1000, 6);
    let options = options("average,kmeans:12", Some(0.97));
    let one = with_threads(1, || run(&problem(), &options, &source));
    let three = with_threads(3, || run(&problem(), &options, &source));
    assert_eq!(one.model.to_json(), three.model.to_json());
    assert_eq!(one.candidates[1].stability, three.candidates[1].stability);
    let mut bent = problem();
    bent.library.push(Expr::parse("v^3", &Scope::open()).unwrap());
    let refused = identify(&bent, &options, &source, &Silent).unwrap_err();
    assert!(matches!(&refused, Error::Bends { state, .. } if state == "v"), "{refused}");
    let mut open = problem();
    open.library = vec![Expr::column("u")];
    let refused = identify(&open, &options, &source, &Silent).unwrap_err();
    assert!(matches!(refused, Error::NothingToBound), "{refused}");
}
