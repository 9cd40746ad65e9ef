//! Maps that meet at the borders of their regions: closed forms, the equality-constrained problem solved whole, and borders walked over.

use faer::Mat;
use fleetfoot_data::Silent;
use fleetfoot_model::{Model, Rule};
use fleetfoot_pwa::{Options, Problem, Selection, Shrinkage, identify};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::refined::{Row, normal, options, problem, run, same_bits, source};

fn continuous(partitions: &str, folds: u16) -> Options {
    let mut options = options(partitions, folds);
    options.continuous = true;
    options
}

/// Rows of a function of `d` inputs between -1 and 1, with noise.
fn sampled(d: usize, rows: usize, noise: f64, seed: u64, f: impl Fn(&[f64]) -> f64) -> Vec<Row> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut row = |_| {
        let x: Vec<f64> = (0..d).map(|_| random.random_range(-1.0..1.0)).collect();
        let y = f(&x) + noise * normal(&mut random);
        (x, y)
    };
    (0..rows).map(&mut row).collect()
}

/// Problem whose only partition column is the first.
fn on_the_first(d: usize) -> Problem {
    let mut problem = problem(d);
    problem.partition_columns.truncate(1);
    problem
}

fn standardised(model: &Model, x: &[f64]) -> Vec<f64> {
    let partition = &model.partitions[0];
    x.iter().zip(partition.centre.iter().zip(&partition.scale)).map(|(x, (c, s))| (x - c) / s).collect()
}

fn region(model: &Model, x: &[f64]) -> usize {
    model.partitions[0].rule.assign_row(&standardised(model, x)).unwrap() as usize
}

fn value(model: &Model, region: usize, x: &[f64]) -> f64 {
    let latent = &model.latents[0];
    latent.affine().unwrap().coefficients[region]
        .iter()
        .zip(x)
        .fold(latent.affine().unwrap().constants[region], |sum, (c, x)| sum + c * x)
}

/// The largest difference of two maps where a straight way from one row to another changes its region.
fn largest_jump(model: &Model, rows: &[Row]) -> f64 {
    let mut largest: f64 = 0.0;
    for pair in rows.windows(2) {
        let at = |t: f64| -> Vec<f64> { pair[0].0.iter().zip(&pair[1].0).map(|(a, b)| a + t * (b - a)).collect() };
        let (mut low, mut high) = (0.0, 1.0);
        if region(model, &at(low)) == region(model, &at(high)) {
            continue;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if region(model, &at(middle)) == region(model, &at(low)) { low = middle } else { high = middle }
        }
        let [a, b] = [low, high].map(|t| region(model, &at(t)));
        largest = largest.max((value(model, a, &at(low)) - value(model, b, &at(low))).abs());
    }
    largest
}

#[test]
fn a_continuous_piecewise_line_is_recovered_exactly() {
    // Two kinks where the tree may cut, and another regressor.
    let f = |x: &[f64]| x[0].clamp(-0.5, 0.5) * 3.0 - 0.7 * x[1] + 2.0;
    let rows = sampled(2, 900, 0.0, 1, f);
    let identification = run(&on_the_first(2), &continuous("tree:2", 3), &source(&rows, 3));
    let (model, score) = (&identification.model, &identification.candidates[0]);
    let continuity = score.continuity.unwrap();
    // The first cut is in the middle. Four regions of three numbers, of which three borders take two each.
    assert_eq!((score.regions, continuity.borders, continuity.numbers), (4, 3, 6));
    assert!(continuity.jump < 1e-12 && largest_jump(model, &rows) < 1e-12, "{continuity:?}");
    // Cuts stand between two rows, up to 0.002 from the kinks.
    assert!(score.loss < 1e-5, "{}", score.loss);
    assert!((model.latents[0].affine().unwrap().coefficients[1][0] - 3.0).abs() < 0.02, "{:?}", model.latents[0]);
    for region in 0..4 {
        assert!((model.latents[0].affine().unwrap().coefficients[region][1] + 0.7).abs() < 1e-3);
    }
    assert!(model.method.ends_with(", continuous"), "{}", model.method);
}

#[test]
fn continuity_improves_only_maps_without_jumps() {
    let kink = sampled(2, 300, 0.3, 2, |x| x[0].abs() + x[1]);
    let [mut tied, mut free] = [continuous("kmeans:6", 5), options("kmeans:6", 5)];
    (tied.shrinkage, free.shrinkage) = (Shrinkage::Rows(0.0), Shrinkage::Rows(0.0));
    let identification = run(&on_the_first(2), &tied, &source(&kink, 1));
    let score = &identification.candidates[0];
    let apart = run(&on_the_first(2), &free, &source(&kink, 1));
    assert_eq!(score.continuity.unwrap().apart.to_bits(), apart.candidates[0].loss.to_bits());
    assert!(score.loss < apart.candidates[0].loss, "{} {}", score.loss, apart.candidates[0].loss);
    let jump = sampled(2, 600, 0.1, 3, |x| x[0].signum() + x[1]);
    let identification = run(&on_the_first(2), &continuous("refined:2", 5), &source(&jump, 1));
    let score = &identification.candidates[0];
    assert!(score.loss > 3.0 * score.continuity.unwrap().apart, "{score:?}");
    assert!(largest_jump(&identification.model, &jump) < 1e-12);
}

/// The least squares of all regions' maps under `A_i x + b_i - A_j x - b_j = c (w . z + d)` for every border, from one linear system of maps, c and multipliers.
fn constrained(model: &Model, borders: &[(usize, usize)], rows: &[Row]) -> Vec<Vec<f64>> {
    let Rule::Linear { weights, offsets } = &model.partitions[0].rule else { panic!("{:?}", model.partitions[0].rule) };
    let partition = &model.partitions[0];
    let (k, p, d) = (weights.len(), rows[0].0.len(), partition.columns.len());
    let maps = k * (p + 1);
    let (unknown, equations) = (maps + borders.len(), borders.len() * (p + 1));
    let mut system = Mat::<f64>::zeros(unknown + equations, unknown + equations);
    let mut right = Mat::<f64>::zeros(unknown + equations, 1);
    for (x, y) in rows {
        let first = region(model, &x[..d]) * (p + 1);
        let full: Vec<f64> = x.iter().copied().chain([1.0]).collect();
        for i in 0..=p {
            right[(first + i, 0)] += full[i] * y;
            for j in 0..=p {
                system[(first + i, first + j)] += full[i] * full[j];
            }
        }
    }
    for (at, &(i, j)) in borders.iter().enumerate() {
        let mut normal = vec![0.0; p + 1];
        normal[p] = offsets[i] - offsets[j];
        for column in 0..d {
            let slope = (weights[i][column] - weights[j][column]) / partition.scale[column];
            normal[column] = slope;
            normal[p] -= slope * partition.centre[column];
        }
        for (row, normal) in normal.iter().enumerate() {
            let equation = unknown + at * (p + 1) + row;
            for (column, value) in [(i * (p + 1) + row, 1.0), (j * (p + 1) + row, -1.0), (maps + at, -normal)] {
                system[(equation, column)] = value;
                system[(column, equation)] = value;
            }
        }
    }
    // Constraints around closed walks depend on each other: the pseudo-inverse chooses among their multipliers.
    let solution = system.svd().unwrap().pseudoinverse() * &right;
    (0..k).map(|region| (0..=p).map(|i| solution[(region * (p + 1) + i, 0)]).collect()).collect()
}

#[test]
fn the_fit_has_the_least_error_of_all_continuous_maps() {
    for (seed, d, regions, on) in [(1, 1, 3, 1), (2, 2, 4, 1), (3, 3, 3, 3), (4, 2, 5, 2)] {
        let rows = sampled(d, 400, 0.2, seed, |x| (3.0 * x[0]).sin() + x[x.len() - 1]);
        let mut problem = problem(d);
        problem.partition_columns.truncate(on);
        let identification = run(&problem, &continuous(&format!("kmeans:{regions}"), 0), &source(&rows, 1));
        let model = &identification.model;
        // Neighbours by the two best scores of a row, as the borders' definition has it.
        let Rule::Linear { weights, offsets } = &model.partitions[0].rule else { panic!() };
        let mut borders = std::collections::BTreeSet::new();
        for (x, _) in &rows {
            let z = standardised(model, &x[..on]);
            let mut scores: Vec<(f64, usize)> = (0..regions)
                .map(|k| (weights[k].iter().zip(&z).fold(offsets[k], |sum, (w, z)| sum + w * z), k))
                .collect();
            scores.sort_by(|a, b| b.0.total_cmp(&a.0));
            borders.insert((scores[0].1.min(scores[1].1), scores[0].1.max(scores[1].1)));
        }
        assert_eq!(identification.candidates[0].continuity.unwrap().borders, borders.len());
        let expected = constrained(model, &borders.into_iter().collect::<Vec<_>>(), &rows);
        for (region, expected) in expected.iter().enumerate() {
            let latent = &model.latents[0];
            let coefficient = latent.affine().unwrap().coefficients[region]
                .iter()
                .chain([&latent.affine().unwrap().constants[region]]);
            for (number, expected) in coefficient.zip(expected) {
                // The oracle squares the rows and inverts a saddle: half of the digits are gone.
                assert!((number - expected).abs() < 1e-6, "{seed}: {number} {expected}");
            }
        }
        assert!(largest_jump(model, &rows) < 1e-11, "{seed}");
    }
}

#[test]
fn three_regions_meet_with_one_free_number() {
    // The greatest of three planes, and what it is a kink of.
    let planes = [[1.0, 0.2], [-0.6, 0.9], [-0.5, -1.0]];
    let largest = |x: &[f64]| planes.iter().map(|w| w[0] * x[0] + w[1] * x[1]).fold(f64::NEG_INFINITY, f64::max);
    let rows = sampled(2, 1500, 0.0, 5, |x| 2.0 * largest(x) + x[0] - 3.0);
    let identification = run(&problem(2), &continuous("kmeans:3,refined:3", 3), &source(&rows, 1));
    for score in &identification.candidates {
        let continuity = score.continuity.unwrap();
        assert_eq!((continuity.borders, continuity.numbers), (3, 4), "{:?}", score.specification);
        assert!(continuity.jump < 1e-12);
    }
    // Refined separators are the kinks, up to a row or two.
    assert!(
        identification.candidates[1].loss < 0.02
            && 2.0 * identification.candidates[1].loss < identification.candidates[0].loss,
        "{:?}",
        identification.candidates
    );
    // A cut that ends at another has no kink of its own.
    let boxes = sampled(2, 2000, 0.05, 6, |x| if x[0] < 0.1 { f64::from(u8::from(x[1] > -0.2)) } else { 3.0 + x[1] });
    let identification = run(&problem(2), &continuous("tree:2", 0), &source(&boxes, 1));
    let score = &identification.candidates[0];
    assert_eq!((score.regions, score.continuity.unwrap().numbers), (3, 4), "{score:?}");
    assert!(largest_jump(&identification.model, &boxes) < 1e-12);
}

#[test]
fn borders_that_do_not_meet_are_free() {
    // Regions on both sides of a third, along an oblique direction.
    let rows = sampled(2, 1200, 0.0, 7, |x| (x[0] + x[1]).clamp(-0.7, 0.6));
    let identification = run(&problem(2), &continuous("refined:3", 3), &source(&rows, 1));
    let continuity = identification.candidates[0].continuity.unwrap();
    assert!(largest_jump(&identification.model, &rows) < 1e-12);
    assert!(identification.candidates[0].loss < 0.01, "{:?}", identification.candidates[0]);
    assert_eq!((continuity.borders, continuity.numbers), (2, 5), "{continuity:?}");
}

#[test]
fn continuous_maps_keep_shrinkage_and_selection() {
    let rows = sampled(2, 200, 0.4, 8, |x| (2.0 * x[0]).tanh());
    let mut wanted = continuous("average,kmeans:2,4,8", 5);
    wanted.shrinkage = Shrinkage::Auto;
    wanted.selection = Selection::Bic;
    wanted.keep_all = true;
    let identification = run(&on_the_first(2), &wanted, &source(&rows, 1));
    assert!(identification.candidates[0].continuity.is_none());
    for (model, score) in identification.models.iter().zip(&identification.candidates).skip(1) {
        assert!(largest_jump(model, &rows) < 1e-11, "{:?}", score.specification);
        assert_eq!(score.continuity.unwrap().numbers, score.regions + 2);
    }
    // Pulled with all might the maps are the one of all.
    wanted.shrinkage = Shrinkage::Rows(1e9);
    let identification = run(&on_the_first(2), &wanted, &source(&rows, 1));
    let [average, pulled] =
        [0, 3].map(|at| identification.models[at].latents[0].affine().unwrap().coefficients[0].clone());
    assert!(average.iter().zip(&pulled).all(|(a, b)| (a - b).abs() < 1e-5), "{average:?} {pulled:?}");
}

#[test]
fn partitions_without_linear_borders_are_refused() {
    let rows = sampled(2, 200, 0.1, 9, |x| x[0]);
    let refused = |problem: &Problem, partitions: &str| {
        identify(problem, &continuous(partitions, 3), &source(&rows, 1), &Silent).unwrap_err().to_string()
    };
    for partitions in ["zscore:1", "average,lattice:3", "labels:x1", "labels:x1+kmeans:2"] {
        let error = refused(&problem(2), partitions);
        assert!(error.contains("linear borders") && error.contains("--continuous"), "{error}");
    }
    let mut blind = problem(2);
    blind.library.truncate(1);
    let error = refused(&blind, "kmeans:3");
    assert!(error.contains("the partition column x1 is not a regressor"), "{error}");
}

#[test]
fn threads_and_order_change_no_bit() {
    let rows = sampled(3, 9000, 0.2, 10, |x| (2.0 * x[0] + x[1]).sin() + x[2].abs());
    same_bits(&problem(3), &continuous("kmeans:3,refined:3,tree:2", 3), &rows);
}
