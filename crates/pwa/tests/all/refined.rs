//! Refined partitions on systems of known truth, beside k-means; and their invariants.

use fleetfoot_data::{Column as DataColumn, MemorySource, Silent, with_threads};
use fleetfoot_library::Expr;
use fleetfoot_model::{Column, Equation, Prediction, Role};
use fleetfoot_pwa::{Identification, Options, Problem, Score, Specification, identify, partition};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Inputs and output.
pub(crate) type Row = (Vec<f64>, f64);

/// A function of so many inputs, and its name.
type Function = (&'static str, usize, fn(&[f64]) -> f64);

/// Columns `x0 .. x(d-1)` and `y`.
pub(crate) fn source(rows: &[Row], episodes: usize) -> MemorySource {
    let d = rows[0].0.len();
    let mut names: Vec<String> = (0..d).map(|j| format!("x{j}")).collect();
    names.push("y".into());
    let mut source = MemorySource::new(names.iter().map(DataColumn::float).collect::<Vec<_>>());
    for part in rows.chunks(rows.len().div_ceil(episodes)) {
        let mut columns: Vec<Vec<f64>> = (0..d).map(|j| part.iter().map(|row| row.0[j]).collect()).collect();
        columns.push(part.iter().map(|row| row.1).collect());
        source.push_uniform("run", 0.01, columns);
    }
    source
}

/// `y = f(x0, ..)`, with regions on all x.
pub(crate) fn problem(d: usize) -> Problem {
    let column = |name: String, role| Column::new(name, role);
    let inputs: Vec<Expr> = (0..d).map(|j| Expr::column(format!("x{j}"))).collect();
    let columns = (0..d).map(|j| column(format!("x{j}"), Role::State)).chain([column("y".into(), Role::Auxiliary)]);
    Problem {
        columns: columns.collect(),
        library: inputs.clone(),
        equations: vec![Equation {
            subject: "y".into(),
            prediction: Prediction::Value,
            right: Expr::column("f_y"),
            target: Some(Expr::column("y")),
            unit: None,
        }],
        partition_columns: inputs,
        weight: None,
        step: 0.01,
    }
}

pub(crate) fn options(partitions: &str, folds: u16) -> Options {
    let mut options = Options::default();
    options.partitions = Specification::parse_list(partitions).unwrap();
    options.folds = folds;
    options
}

pub(crate) fn run(problem: &Problem, options: &Options, source: &MemorySource) -> Identification {
    identify(problem, options, source, &Silent).unwrap()
}

/// Model of rows of six episodes of 1,500, as text. Checks that its bits are the same on one, two and seven threads,
/// and for the episodes in the other order.
pub(crate) fn same_bits(problem: &Problem, options: &Options, rows: &[Row]) -> String {
    let result_bits = |source: &MemorySource| {
        let identification = run(problem, options, source);
        let mut model = identification.model;
        model.training.episodes.sort();
        let numbers = |score: &Score| (score.loss.to_bits(), score.continuity.as_ref().map(|numbers| numbers.numbers));
        (model.to_json(), identification.candidates.iter().map(numbers).collect::<Vec<_>>(), identification.notes)
    };
    assert_eq!(rows.len(), 6 * 1500);
    let whole = source(rows, 6);
    let alone = with_threads(1, || result_bits(&whole));
    for threads in [2, 7] {
        assert_eq!(with_threads(threads, || result_bits(&whole)), alone, "{threads} threads");
    }
    let reversed: Vec<Row> = rows.chunks(1500).rev().flatten().cloned().collect();
    assert_eq!(result_bits(&source(&reversed, 6)), alone, "episodes in the other order");
    alone.0
}

pub(crate) fn normal(random: &mut Pcg64) -> f64 {
    let (u, v): (f64, f64) = (random.random_range(f64::MIN_POSITIVE..1.0), random.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// A PWARX system of three modes in (y, u); no mode's rows lie together, and the middle mode has most. Rows with the mode of each.
fn pwarx(rows: usize, seed: u64) -> (Vec<Row>, Vec<usize>) {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut y = 0.0;
    (0..rows)
        .map(|_| {
            let u: f64 = random.random_range(-4.0..4.0);
            let mode = mode(y, u);
            let [a, b, c] = MODES[mode];
            let next = a * y + b * u + c + 0.1 * normal(&mut random);
            let row = (vec![y, u], next);
            y = next;
            (row, mode)
        })
        .unzip()
}

fn mode(y: f64, u: f64) -> usize {
    if 4.0 * y - u + 10.0 < 0.0 {
        0
    } else if 5.0 * y + u - 6.0 > 0.0 {
        2
    } else {
        1
    }
}

/// Coefficients of y and u, and the constant.
const MODES: [[f64; 3]; 3] = [[-0.4, 1.0, 1.5], [0.5, -1.0, -0.5], [-0.3, 0.5, -1.7]];

/// Share of the rows whose region is their mode, with the best naming of regions by modes; and the mode that each region stands for.
fn recovered(identification: &Identification, rows: &[Row], modes: &[usize]) -> (f64, Vec<usize>) {
    let partition = &identification.model.partitions[0];
    let mut counts = vec![[0usize; 3]; partition.rule.count()];
    for ((x, _), &mode) in rows.iter().zip(modes) {
        let z: Vec<f64> =
            x.iter().zip(partition.centre.iter().zip(&partition.scale)).map(|(x, (c, s))| (x - c) / s).collect();
        counts[partition.rule.assign_row(&z).unwrap() as usize][mode] += 1;
    }
    let best = |count: &[usize; 3]| (0..3).max_by_key(|&mode| count[mode]).unwrap();
    let names: Vec<usize> = counts.iter().map(best).collect();
    let right: usize = counts.iter().zip(&names).map(|(count, &mode)| count[mode]).sum();
    (right as f64 / rows.len() as f64, names)
}

#[test]
fn modes_independent_of_density_are_recovered() {
    for seed in 0..5 {
        let (rows, modes) = pwarx(1000, seed);
        let source = source(&rows, 1);
        let refined = run(&problem(2), &options("refined:3", 0), &source);
        let (share, names) = recovered(&refined, &rows, &modes);
        let clustered = recovered(&run(&problem(2), &options("kmeans:3", 0), &source), &rows, &modes).0;
        assert!(share >= 0.98, "seed {seed}: {share} of the modes");
        assert!(clustered < 0.9, "seed {seed}: k-means finds {clustered}");
        let off = off(&refined, &names);
        assert!(off.iter().all(|off| off.abs() < 4.0), "seed {seed}: {off:?} standard errors");
    }
}

/// Deviations of the regions' slopes from those of their modes, in standard errors of ordinary least squares by the
/// model's region summaries.
fn off(identification: &Identification, names: &[usize]) -> Vec<f64> {
    let latent = &identification.model.latents[0];
    let slopes = names.iter().enumerate().flat_map(|(region, &mode)| {
        let info = &identification.model.summaries[0].regions[region];
        let (xx, xy, yy) = (info.covariance[0], info.covariance[1], info.covariance[2]);
        let noise = info.residual_covariance[0] / info.rows as f64;
        let determinant = xx * yy - xy * xy;
        let errors = [(noise * yy / determinant).sqrt(), (noise * xx / determinant).sqrt()];
        [0, 1].map(|j| (latent.affine().unwrap().coefficients[region][j] - MODES[mode][j]) / errors[j])
    });
    slopes.collect()
}

/// Of 58 rows a set may have a border that its rows do not determine: one row in fifty on the other side is as likely.
#[test]
fn modes_of_few_rows_are_recovered() {
    let shares = (0..8).map(|seed| {
        let (rows, modes) = pwarx(58, seed);
        recovered(&run(&problem(2), &options("refined:3", 0), &source(&rows, 1)), &rows, &modes).0
    });
    let shares: Vec<f64> = shares.collect();
    assert!(shares.iter().filter(|share| **share >= 0.98).count() >= 7, "{shares:?}");
}

/// Regions are refined on 65,536 of these rows. One in ten thousand of the others would lie on the wrong side of a
/// border drawn by those alone.
#[test]
fn borders_of_a_sample_are_drawn_by_all_rows() {
    for seed in [0, 1] {
        let (rows, modes) = pwarx(300_000, seed);
        let identification = run(&problem(2), &options("refined:3", 0), &source(&rows, 1));
        let (share, names) = recovered(&identification, &rows, &modes);
        // If the maps cross at a border, rows beside it do not tell its place, and do no harm.
        assert!(share >= 1.0 - 5e-5, "seed {seed}: {} rows are wrong", (300_000.0 * (1.0 - share)).round());
        let off = off(&identification, &names);
        assert!(off.iter().all(|off| off.abs() < 3.5), "seed {seed}: {off:?} standard errors");
    }
}

#[test]
fn held_out_rows_choose_mode_count() {
    let (rows, _) = pwarx(1000, 7);
    let identification = run(&problem(2), &options("average,refined:2..5", 5), &source(&rows, 1));
    assert_eq!(
        identification.candidates[identification.chosen].specification,
        Specification::Refined(3),
        "{:?}",
        identification.candidates
    );
    let objective = &identification.candidates[identification.chosen].objective;
    assert!(objective.len() > 1 && objective.windows(2).all(|pair| pair[1] < pair[0]), "{objective:?}");
}

#[test]
fn noise_gets_no_regions_by_held_out_error() {
    let mut random = Pcg64::seed_from_u64(3);
    let rows: Vec<Row> =
        (0..600).map(|_| (vec![normal(&mut random), normal(&mut random)], normal(&mut random))).collect();
    let identification = run(&problem(2), &options("null,refined:6", 5), &source(&rows, 1));
    // Regions refined on the held-out rows too would explain some of them.
    let [null, refined] = [0, 1].map(|at| identification.candidates[at].loss);
    assert!(refined > null, "{refined} {null}");
    assert_eq!(identification.chosen, 0);
}

/// Functions with kinks, steps and curves; inputs uniform between -1 and 1.
fn functions() -> Vec<Function> {
    vec![
        ("waves", 2, |x| (4.0 * x[0] - 5.0 * x[1] * x[1]).sin() + 2.0 * x[1]),
        ("wedge", 2, |x| (x[0].abs() - 0.3 * x[1]).max(0.8 * x[1] + 0.2)),
        ("saturation", 3, |x| (2.0 * x[0] + x[1]).clamp(-1.0, 1.0) + 0.5 * x[2].abs()),
        ("friction", 4, |x| x[0].signum() * (0.5 + 0.3 * x[1]) + x[2] * x[3].max(0.0)),
        ("largest", 5, |x| (x[0] + x[1]).max(x[2] - x[3]).max(0.5 * x[4])),
    ]
}

fn sampled(f: fn(&[f64]) -> f64, d: usize, rows: usize, seed: u64) -> Vec<Row> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut row = |_| {
        let x: Vec<f64> = (0..d).map(|_| random.random_range(-1.0..1.0)).collect();
        let y = f(&x);
        (x, y)
    };
    (0..rows).map(&mut row).collect()
}

#[test]
fn refined_regions_explain_more_than_kmeans() {
    for (name, d, f) in functions() {
        let identification = run(&problem(d), &options("kmeans:6,refined:6", 5), &source(&sampled(f, d, 1000, 11), 1));
        let [clustered, refined] = [0, 1].map(|at| identification.candidates[at].loss);
        assert!(refined < 0.8 * clustered, "{name}: {refined} {clustered}");
    }
}

#[test]
fn threads_and_order_change_no_bit() {
    let (_, d, f) = functions()[2];
    same_bits(&problem(d), &options("refined:2..3", 3), &sampled(f, d, 9000, 5));
}

#[test]
fn regions_with_too_few_rows_are_removed() {
    let (rows, _) = pwarx(40, 1);
    let identification = run(&problem(2), &options("refined:30", 0), &source(&rows, 1));
    let partition = &identification.model.partitions[0];
    assert!((2..=10).contains(&partition.rule.count()), "{}", partition.rule.count());
    assert!(identification.model.summaries[0].regions.iter().all(|region| region.rows >= 4));
    assert!(
        identification.notes.iter().any(|note| note.contains("have enough rows for a separate map")),
        "{:?}",
        identification.notes
    );
}

#[test]
fn a_sample_is_refined_and_all_rows_are_fitted() {
    let (rows, modes) = pwarx(20_000, 2);
    let mut small = options("refined:3", 0);
    small.memory = 2_000 * 144;
    let identification = run(&problem(2), &small, &source(&rows, 1));
    assert!(identification.notes.iter().any(|note| note.contains("a sample of")), "{:?}", identification.notes);
    assert_eq!(identification.model.summaries[0].regions.iter().map(|region| region.rows).sum::<u64>(), 20_000);
    assert!(recovered(&identification, &rows, &modes).0 > 0.98);
}

#[test]
fn one_region_and_constant_columns_are_accepted() {
    let (name, d, f) = functions()[1];
    let rows: Vec<Row> = sampled(f, d, 300, 4).into_iter().map(|(x, y)| (vec![x[0], x[1], 7.0], y)).collect();
    let identification = run(&problem(3), &options("average,refined:1,refined:3", 3), &source(&rows, 1));
    assert!((identification.candidates[0].loss - identification.candidates[1].loss).abs() < 1e-12, "{name}");
    assert!(
        identification.candidates[2].loss < 0.5 * identification.candidates[0].loss,
        "{name}: {:?}",
        identification.candidates
    );
}

#[test]
fn regions_on_too_many_columns_are_refused() {
    let rows = sampled(|x| x[0], 80, 400, 1);
    let error = identify(&problem(80), &options("refined:60", 0), &source(&rows, 1), &Silent).unwrap_err().to_string();
    assert!(error.contains("4860 numbers") && error.contains("4096") && error.contains("--partition-on"), "{error}");
}

#[test]
fn partitions_alone_match_regression() {
    let (rows, _) = pwarx(300, 9);
    let partitions = partition(&problem(2), &options("refined:3", 5), &source(&rows, 1), &Silent).unwrap();
    let fitted = identify(&problem(2), &options("refined:3", 0), &source(&rows, 1), &Silent).unwrap();
    assert_eq!(partitions.partitions[0].1.rule, fitted.model.partitions[0].rule);
    assert_eq!(partitions.partitions[0].1.rule.count(), 3);
}

#[test]
fn the_regions_of_every_label_are_refined_by_themselves() {
    // A kink over x0 on one ground, over x1 on the other.
    let mut random = Pcg64::seed_from_u64(12);
    let mut row = |at: usize| {
        let x: [f64; 2] = [random.random_range(-1.0..1.0), random.random_range(-1.0..1.0)];
        let ground = (at / 150 % 2) as f64;
        (vec![x[0], x[1], ground], if ground == 0.0 { x[0].abs() } else { 1.0 - x[1].abs() })
    };
    let rows: Vec<Row> = (0..1200).map(&mut row).collect();
    let identification = run(&problem(2), &options("refined:2,labels:x2,labels:x2+refined:2", 4), &source(&rows, 4));
    let losses: Vec<f64> = identification.candidates.iter().map(|score| score.loss).collect();
    assert!(losses[2] < 1e-3 && losses[0] > 0.1 && losses[1] > 0.1, "{losses:?}");
    assert_eq!(identification.candidates[identification.chosen].regions, 4);
    let names: Vec<&str> =
        identification.model.summaries[0].regions.iter().map(|region| region.name.as_str()).collect();
    assert_eq!(names, ["0/0", "0/1", "1/0", "1/1"]);
}
