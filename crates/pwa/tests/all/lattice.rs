//! Cells joined to regions: closed forms, invariants, and comparison with `refined` and k-means on the same rows.

use fleetfoot_data::Silent;
use fleetfoot_model::{Model, Rule};
use fleetfoot_pwa::{Selection, identify, partition};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::refined::{Row, normal, options, problem, run, same_bits, source};

/// One map in two places, with another one in between; noise of 0.05.
fn sandwich(rows: usize, seed: u64) -> Vec<Row> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut row = |_| {
        let x: [f64; 2] = [random.random_range(-3.0..3.0), random.random_range(-1.0..1.0)];
        let y = if x[0].abs() < 1.0 { 2.0 * x[0] - x[1] } else { 1.0 - x[0] + 0.5 * x[1] };
        (x.to_vec(), y + 0.05 * normal(&mut random))
    };
    (0..rows).map(&mut row).collect()
}

/// The region of a row.
fn region(model: &Model, x: &[f64]) -> usize {
    let partition = &model.partitions[0];
    let z: Vec<f64> =
        x.iter().zip(partition.centre.iter().zip(&partition.scale)).map(|(x, (c, s))| (x - c) / s).collect();
    partition.rule.assign_row(&z).unwrap() as usize
}

/// Squared error over variance of a model's affine maps on rows.
fn error(model: &Model, rows: &[Row]) -> f64 {
    let latent = &model.latents[0];
    let mean = rows.iter().map(|row| row.1).sum::<f64>() / rows.len() as f64;
    let mut sums = [0.0; 2];
    for (x, y) in rows {
        let region = region(model, x);
        let constant = latent.affine().unwrap().constants[region]
            + latent.affine().unwrap().coefficients[region]
                .iter()
                .zip(x)
                .map(|(coefficient, x)| coefficient * x)
                .sum::<f64>();
        sums[0] += (y - constant).powi(2);
        sums[1] += (y - mean).powi(2);
    }
    sums[0] / sums[1]
}

#[test]
fn equal_maps_are_one_region() {
    let rows = sandwich(4000, 1);
    let mut wanted = options("average,kmeans:2,lattice:1..6", 5);
    wanted.keep_all = true;
    let identification = run(&problem(2), &wanted, &source(&rows, 1));
    let model = &identification.models[3];
    let within = |at: usize| rows.iter().filter(|row| (row.0[0].abs() < 1.0) == (region(model, &row.0) == at)).count();
    let right = within(0).max(within(1)) as f64 / rows.len() as f64;
    // No cell lies across a border, but for the little that separators of 4,000 rows are off.
    assert!(right > 0.99, "{right}");
    let losses: Vec<f64> = identification.candidates.iter().map(|score| score.loss).collect();
    assert!(losses[3] < 0.02 * losses[1] && losses[7] > 0.97 * losses[3], "{losses:?}");
    let fresh = error(model, &sandwich(4000, 2));
    // A row on the other side of a border costs up to a thousandth.
    assert!((fresh - losses[3]).abs() < 0.3 * losses[3] + 0.002, "{fresh} {losses:?}");
}

#[test]
fn levels_of_the_tree_report_the_errors_of_their_models() {
    let rows = sandwich(1500, 3);
    let mut wanted = options("average,lattice:2..8", 4);
    wanted.keep_all = true;
    let identification = run(&problem(2), &wanted, &source(&rows, 2));
    let lattice = identification.models[7].partitions[0].lattice.as_ref().unwrap();
    assert_eq!(lattice.levels.iter().map(|level| level.regions).collect::<Vec<_>>(), (1..=8).collect::<Vec<_>>());
    for (model, level) in identification.models.iter().zip(&lattice.levels) {
        let direct = error(model, &rows);
        assert!((level.training - direct).abs() < 1e-9, "{}: {} {direct}", level.regions, level.training);
    }
    assert!(lattice.levels.windows(2).all(|pair| pair[1].training <= pair[0].training), "{lattice:?}");
    for (level, score) in lattice.levels.iter().zip(&identification.candidates) {
        assert_eq!((level.held_out.to_bits(), level.bic.to_bits()), (score.loss.to_bits(), score.bic.to_bits()));
    }
    // The joins lead from eight regions to one, through the errors of the levels.
    let joined: Vec<f64> = lattice.joins.iter().map(|join| join.training).collect();
    let levels: Vec<f64> = lattice.levels.iter().rev().skip(1).map(|level| level.training).collect();
    assert!(joined.iter().zip(&levels).all(|(a, b)| (a - b).abs() < 1e-12), "{joined:?} {levels:?}");
    assert_eq!(joined.len(), 7);
    // A level alone is the same level.
    let alone = run(&problem(2), &options("lattice:8", 4), &source(&rows, 2));
    assert_eq!(alone.model.latents, identification.models[7].latents);
}

#[test]
fn noise_gets_no_regions_by_held_out_error() {
    let mut random = Pcg64::seed_from_u64(3);
    let noise: Vec<Row> =
        (0..900).map(|_| (vec![normal(&mut random), normal(&mut random)], normal(&mut random))).collect();
    let identification = run(&problem(2), &options("null,lattice:2..12", 5), &source(&noise, 1));
    assert!(
        identification.candidates[1..].iter().all(|score| score.loss > identification.candidates[0].loss),
        "{:?}",
        identification.candidates
    );
    assert_eq!(identification.chosen, 0);
    // Training errors alone would take as many regions as there are.
    let model = run(&problem(2), &options("lattice:2..12", 5), &source(&noise, 1)).model;
    let levels = &model.partitions[0].lattice.as_ref().unwrap().levels;
    assert!(levels[10].training < levels[0].training && levels[10].held_out > levels[0].held_out, "{levels:?}");
}

#[test]
fn full_lattice_equals_fits_of_cells() {
    let rows = sandwich(60, 4);
    let identification = run(&problem(2), &options("lattice:60", 0), &source(&rows, 1));
    let partition = &identification.model.partitions[0];
    let Rule::Joined { cells, regions } = &partition.rule else { panic!("{:?}", partition.rule) };
    // A cell a row, and a map through each.
    assert_eq!((regions.len(), partition.rule.count(), cells.count()), (60, 60, 60));
    assert!(partition.lattice.as_ref().unwrap().levels[0].training < 1e-12);
    assert!(error(&identification.model, &rows) < 1e-12);
}

#[test]
fn a_note_reports_fewer_cells_than_regions() {
    let identification = run(&problem(2), &options("lattice:90", 0), &source(&sandwich(60, 4), 1));
    assert!(
        identification.notes.iter().any(|note| note.contains("lattice:90") && note.contains("cells")),
        "{:?}",
        identification.notes
    );
    assert!(identification.candidates[0].regions <= 60);
}

#[test]
fn threads_and_order_change_no_bit() {
    let model = same_bits(&problem(2), &options("kmeans:3,lattice:2..5", 3), &sandwich(9000, 6));
    assert!(model.contains("joined"));
}

#[test]
fn constant_columns_are_accepted() {
    let rows: Vec<Row> = sandwich(600, 7).into_iter().map(|(x, y)| (vec![x[0], x[1], 7.0], y)).collect();
    let identification = run(&problem(3), &options("average,lattice:1,lattice:3", 3), &source(&rows, 1));
    assert!(
        (identification.candidates[0].loss - identification.candidates[1].loss).abs() < 1e-9,
        "{:?}",
        identification.candidates
    );
    assert!(
        identification.candidates[2].loss < 0.5 * identification.candidates[0].loss,
        "{:?}",
        identification.candidates
    );
    let mut on_nothing = problem(3);
    on_nothing.partition_columns.truncate(3);
    on_nothing.partition_columns.drain(..2);
    let one = run(&on_nothing, &options("average,lattice:3", 3), &source(&rows, 1));
    assert_eq!(one.candidates[1].regions, 1);
    assert!((one.candidates[0].loss - one.candidates[1].loss).abs() < 1e-9);
}

#[test]
fn joined_regions_come_near_to_refined_ones() {
    let rows = sandwich(20_000, 8);
    let mut wanted = options("kmeans:3,refined:3,lattice:3", 0);
    wanted.selection = Selection::Bic;
    wanted.keep_all = true;
    let identification = run(&problem(2), &wanted, &source(&rows, 1));
    let fresh = sandwich(5000, 9);
    let [clustered, refined, joined] = [0, 1, 2].map(|at| error(&identification.models[at], &fresh));
    assert!(joined < 0.02 * clustered && joined < 1.03 * refined, "{clustered} {refined} {joined}");
}

/// Five maps between linear separators in two of six columns; noise of 0.1 where the output deviates by one.
fn modes(rows: usize, seed: u64) -> Vec<Row> {
    let mut random = Pcg64::seed_from_u64(77);
    let mut table = |columns: usize| -> Vec<Vec<f64>> {
        (0..5).map(|_| (0..columns).map(|_| normal(&mut random)).collect()).collect()
    };
    let (separators, maps) = (table(2), table(7));
    let mut random = Pcg64::seed_from_u64(seed);
    let mut row = |_| {
        let x: Vec<f64> = (0..6).map(|_| normal(&mut random)).collect();
        let score = |cell: &usize| separators[*cell].iter().zip(&x).map(|(w, x)| w * x).sum::<f64>();
        let mode = (0..5).max_by(|a, b| score(a).total_cmp(&score(b))).unwrap();
        let y = maps[mode][6] + 0.4 * maps[mode].iter().zip(&x).map(|(c, x)| c * x).sum::<f64>();
        (x, y + 0.1 * normal(&mut random))
    };
    (0..rows).map(&mut row).collect()
}

#[test]
fn levels_match_separately_refined_regions() {
    let rows = modes(8000, 1);
    let mut wanted = options("refined:2,refined:3,refined:5,refined:8,lattice:2,lattice:3,lattice:5,lattice:8", 0);
    wanted.selection = Selection::Bic;
    wanted.keep_all = true;
    let identification = run(&problem(6), &wanted, &source(&rows, 1));
    let fresh = modes(8000, 2);
    let errors: Vec<f64> = identification.models.iter().map(|model| error(model, &fresh)).collect();
    println!("{errors:?}");
    for (refined, joined) in errors[..4].iter().zip(&errors[4..]) {
        assert!(*joined < 1.03 * refined, "{errors:?}");
    }
}

#[test]
fn partitions_alone_match_regression() {
    let source = source(&sandwich(900, 9), 1);
    let partitions = partition(&problem(2), &options("lattice:2,lattice:4", 5), &source, &Silent).unwrap();
    let fitted = identify(&problem(2), &options("lattice:4", 0), &source, &Silent).unwrap();
    assert_eq!(partitions.partitions[1].1.rule, fitted.model.partitions[0].rule);
}
