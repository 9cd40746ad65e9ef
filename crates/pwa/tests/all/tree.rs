//! Trees of cuts on systems of known truth, and their invariants.

use fleetfoot_data::Silent;
use fleetfoot_model::{Branch, Rule, Tree};
use fleetfoot_pwa::{Specification, identify, partition};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::refined::{Row, normal, options, problem, run, same_bits, source};

/// Three maps of three inputs: below 0.3 of the second input, and on both sides of -1 of the third beyond; noise of so much.
fn boxes(rows: usize, noise: f64, seed: u64) -> Vec<Row> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut row = |_| {
        let x: [f64; 3] = std::array::from_fn(|_| random.random_range(-2.0..2.0));
        let y = match (x[1] < 0.3, x[2] < -1.0) {
            (true, _) => 1.0 + x[0] - x[2],
            (false, true) => -2.0 * x[0] + 0.5 * x[1],
            (false, false) => 3.0 + x[2] + x[1],
        };
        (x.to_vec(), y + noise * normal(&mut random))
    };
    (0..rows).map(&mut row).collect()
}

fn tree(rule: &Rule) -> &Tree {
    match rule {
        Rule::Tree(tree) => tree,
        other => panic!("{other:?}"),
    }
}

#[test]
fn cuts_and_depth_of_the_truth_are_recovered() {
    let rows = boxes(3000, 0.1, 1);
    let identification = run(&problem(3), &options("average,kmeans:3,10,tree:1..5", 5), &source(&rows, 1));
    assert_eq!(
        identification.candidates[identification.chosen].specification,
        Specification::Tree(2),
        "{:?}",
        identification.candidates
    );
    let partition = &identification.model.partitions[0];
    // Columns are cut as they are.
    assert_eq!((&partition.centre, &partition.scale), (&vec![0.0; 3], &vec![1.0; 3]));
    let cuts = &tree(&partition.rule).cuts;
    assert_eq!(cuts.len(), 2);
    assert_eq!((cuts[0].column, cuts[1].column, cuts[0].below), (1, 2, Branch::Region(0)));
    // Rows are 0.0013 apart, of the upper half 0.0027.
    assert!((cuts[0].threshold - 0.3).abs() < 0.01 && (cuts[1].threshold + 1.0).abs() < 0.02, "{cuts:?}");
    // The held-out loss is that of the noise and of a row or two at a border.
    let losses: Vec<f64> = identification.candidates.iter().map(|score| score.loss).collect();
    let noise = 0.01 / (identification.sigma[0] * identification.sigma[0]);
    assert!(losses[4] < 3.0 * noise && losses[4] < 0.05 * losses[2], "{losses:?} {noise}");
    // Deeper trees have the same cuts: more do not pay.
    assert!(identification.candidates[4..].iter().all(|score| score.regions == 3), "{:?}", identification.candidates);
    let [p, q] = [1, 2].map(|region| &identification.model.latents[0].affine().unwrap().coefficients[region]);
    assert!((p[0] + 2.0).abs() < 0.05 && (p[1] - 0.5).abs() < 0.05 && (q[2] - 1.0).abs() < 0.05, "{p:?} {q:?}");
    assert!(identification.model.partitions[0].transitions.is_some());
}

#[test]
fn noise_gets_no_cuts_by_held_out_error() {
    let mut random = Pcg64::seed_from_u64(3);
    let rows: Vec<Row> =
        (0..900).map(|_| (vec![normal(&mut random), normal(&mut random)], normal(&mut random))).collect();
    let identification = run(&problem(2), &options("average,tree:3", 5), &source(&rows, 1));
    assert_eq!(identification.candidates[1].regions, 1, "{:?}", identification.candidates);
    assert!((identification.candidates[0].loss - identification.candidates[1].loss).abs() < 1e-12);
}

#[test]
fn every_label_has_a_separate_tree() {
    let mut random = Pcg64::seed_from_u64(12);
    let mut row = |at: usize| {
        let x: [f64; 2] = [random.random_range(-1.0..1.0), random.random_range(-1.0..1.0)];
        let ground = (at / 150 % 3) as f64;
        let y = match ground as u8 {
            0 => f64::from(u8::from(x[0] > 0.2)),
            1 => x[1],
            _ => 3.0 * f64::from(u8::from(x[1] > -0.4)) * x[0],
        };
        (vec![x[0], x[1], ground], y + 0.01 * normal(&mut random))
    };
    let rows: Vec<Row> = (0..1800).map(&mut row).collect();
    let identification = run(&problem(2), &options("tree:3,labels:x2,labels:x2+tree:2", 4), &source(&rows, 3));
    let losses: Vec<f64> = identification.candidates.iter().map(|score| score.loss).collect();
    assert!(losses[2] < 0.05 && losses[2] < 0.2 * losses[1], "{losses:?}");
    let partition = &identification.model.partitions[0];
    let names: Vec<&str> =
        identification.model.summaries[0].regions.iter().map(|region| region.name.as_str()).collect();
    assert_eq!(names, ["0/0", "0/1", "1", "2/0", "2/1"]);
    let Rule::Labels { rules, .. } = &partition.rule else { panic!("{:?}", partition.rule) };
    assert_eq!((tree(&rules[0]).cuts[0].column, &rules[1], tree(&rules[2]).cuts[0].column), (0, &Rule::Whole, 1));
}

#[test]
fn threads_and_order_change_no_bit() {
    let model = same_bits(&problem(3), &options("tree:1..4", 3), &boxes(9000, 0.3, 5));
    assert!(model.contains("\"tree\""));
}

#[test]
fn a_sample_is_cut_and_all_rows_are_fitted() {
    let rows = boxes(20_000, 0.1, 2);
    let mut small = options("tree:2", 0);
    small.memory = 2_000 * 192;
    let identification = run(&problem(3), &small, &source(&rows, 1));
    assert!(
        identification.notes.iter().any(|note| note.contains("tree:2: grown on a sample of")),
        "{:?}",
        identification.notes
    );
    assert_eq!(identification.model.summaries[0].regions.iter().map(|region| region.rows).sum::<u64>(), 20_000);
    let cuts = &tree(&identification.model.partitions[0].rule).cuts;
    assert!(cuts.len() == 2 && (cuts[0].threshold - 0.3).abs() < 0.02, "{cuts:?}");
}

#[test]
fn partitions_alone_match_regression() {
    let source = source(&boxes(900, 0.1, 9), 1);
    let partitions = partition(&problem(3), &options("tree:1,tree:3", 5), &source, &Silent).unwrap();
    let fitted = identify(&problem(3), &options("tree:3", 0), &source, &Silent).unwrap();
    assert_eq!(partitions.partitions[1].1.rule, fitted.model.partitions[0].rule);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn cuts_follow_each_columns_scale(
        seed in 0u64..1000, exponents in prop::array::uniform3(-6i32..6), target in -6i32..6
    ) {
        // Powers of two change no digit.
        let factors = exponents.map(|exponent| 2f64.powi(exponent));
        let rows = boxes(400, 0.2, seed);
        let scaled: Vec<Row> = rows
            .iter()
            .map(|(x, y)| (x.iter().zip(factors).map(|(x, f)| x * f).collect(), y * 2f64.powi(target)))
            .collect();
        let cuts = |rows: &[Row]| {
            let model = run(&problem(3), &options("tree:3", 0), &source(rows, 1)).model;
            (model.partitions[0].rule.clone(), model.summaries[0].regions.iter().map(|r| r.rows).collect::<Vec<_>>())
        };
        let ((plain, sizes), (other, other_sizes)) = (cuts(&rows), cuts(&scaled));
        // The same rows lie on the same sides, though the shortest number between two rows is another one.
        prop_assert_eq!(sizes, other_sizes);
        for (a, b) in tree(&plain).cuts.iter().zip(&tree(&other).cuts) {
            prop_assert_eq!((a.column, a.below, a.above), (b.column, b.below, b.above));
        }
    }
}
