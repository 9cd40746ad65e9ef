//! Region facts in a model beside the maps: phase, strides, and pairs of regions with the same map.

use fleetfoot_data::{Column as DataColumn, MemorySource, Silent, with_threads};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{Column, Equation, Model, Partition, PhaseBins, Prediction, RegionPair, Role};
use fleetfoot_pwa::{Error, Identification, Options, Phase, PhaseKind, Problem, Specification, identify};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Steps of the gait per row, in turns.
const RATE: f64 = 0.037;

/// A normal number (Box and Muller).
fn normal(random: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (random.random_range(f64::MIN_POSITIVE..1.0), random.random_range(0.0..1.0));
    (-2.0 * a.ln()).sqrt() * (2.0 * std::f64::consts::PI * b).cos()
}

/// Rows of x, u, the target, a mode that changes with the gait, and the gait's phase in turns. `differs` is added to
/// the coefficient of u in mode 2.
fn gait(rows: usize, episodes: usize, differs: f64, seed: u64) -> MemorySource {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut source = MemorySource::new(["x", "u", "dx", "mode", "phase"].map(DataColumn::float).to_vec());
    for _ in 0..episodes {
        let mut columns = vec![Vec::new(); 5];
        let mut phase: f64 = random.random_range(0.0..1.0);
        for _ in 0..rows / episodes {
            let (x, u): (f64, f64) = (random.random_range(-2.0..2.0), random.random_range(-1.0..1.0));
            let e = normal(&mut random);
            let mode = (3.0 * phase).floor().min(2.0);
            let slope = 1.0 + if mode == 2.0 { differs } else { 0.0 };
            let dx = if mode == 0.0 { 2.0 - x } else { slope * u - 0.5 * x };
            columns.iter_mut().zip([x, u, dx + 0.3 * e, mode, phase]).for_each(|(column, value)| column.push(value));
            phase = (phase + RATE * random.random_range(0.8..1.2)).fract();
        }
        source.push_uniform("run", 0.01, columns);
    }
    source
}

fn problem(partition: &str) -> Problem {
    let column = |name: &str, role| Column::new(name, role);
    Problem {
        columns: [
            column("x", Role::State),
            column("u", Role::Input),
            column("dx", Role::Auxiliary),
            column("mode", Role::Auxiliary),
        ]
        .into_iter()
        .chain((partition == "phase").then(|| column("phase", Role::Auxiliary)))
        .collect(),
        library: ["x", "u"].map(Expr::column).to_vec(),
        equations: vec![Equation {
            subject: "x".into(),
            prediction: Prediction::Derivative,
            right: Expr::column("f_x"),
            target: Some(Expr::column("dx")),
            unit: None,
        }],
        partition_columns: vec![Expr::column(partition)],
        weight: None,
        step: 0.01,
    }
}

fn options(partitions: &str, phase: Option<PhaseKind>) -> Options {
    let mut options = Options::default();
    options.partitions = Specification::parse_list(partitions).unwrap();
    options.folds = 0;
    options.phase = phase.map(|kind| Phase {
        specification: "gait".into(),
        column: Expr::column(if matches!(kind, PhaseKind::Cyclic { .. }) { "phase" } else { "mode" }),
        kind,
    });
    options
}

const CYCLE: PhaseKind = PhaseKind::Cyclic { bins: 6, period: None };

fn run(partition: &str, options: &Options, source: &MemorySource) -> Identification {
    identify(&problem(partition), options, source, &Silent).unwrap()
}

fn regions(model: &Model) -> &Partition {
    &model.partitions[0]
}

#[test]
fn regions_along_phase_match_rows() {
    let source = gait(30_000, 3, 0.5, 1);
    let model = run("phase", &options("kmeans:4", Some(CYCLE)), &source).model;
    let regions = regions(&model);
    let phases = regions.phases.as_ref().unwrap();
    assert_eq!(phases.bins, PhaseBins::Cyclic { period: 1.0, count: 6 });
    // The same by hand: rows, passages and first rows of strides, episode by episode.
    use fleetfoot_data::{Halo, Source};
    let (mut rows, mut strides, mut length) = (vec![vec![0; 4]; 6], vec![vec![0; 4]; 4], 0);
    let mut passages = std::collections::BTreeMap::new();
    for episode in 0..3 {
        let block = source.read(episode, 0..10_000, Halo::default()).unwrap();
        let phase = block.core(4);
        let mut region = vec![0; 10_000];
        regions.assign(&[phase], &mut Vec::new(), &mut region);
        let bin = |row: usize| (6.0 * phase[row]) as usize;
        let mut last: Option<(usize, u32)> = None;
        for row in 0..10_000 {
            rows[bin(row)][region[row] as usize] += 1;
            if row > 0 {
                *passages.entry([bin(row - 1) as u32, region[row - 1], region[row]]).or_insert(0) += 1;
                if phase[row] < phase[row - 1]
                    && let Some((begun, from)) = last.replace((row, region[row]))
                {
                    strides[from as usize][region[row] as usize] += 1;
                    length += row - begun;
                }
            }
        }
    }
    assert_eq!((&phases.rows, &phases.strides, phases.stride_rows), (&rows, &strides, length as u64));
    let counted: Vec<([u32; 3], u64)> =
        phases.passages.iter().map(|passage| ([passage.bin, passage.from, passage.to], passage.rows)).collect();
    assert_eq!(counted, passages.into_iter().collect::<Vec<_>>());
    assert!((phases.rows_of_a_stride() * RATE - 1.0).abs() < 0.01, "{}", phases.rows_of_a_stride());
    // The transitions from sample to sample are the same, summed over the bins.
    let sum: u64 =
        phases.passages.iter().filter(|passage| (passage.from, passage.to) == (1, 1)).map(|passage| passage.rows).sum();
    assert_eq!(sum, regions.transitions.as_ref().unwrap().counts[1][1]);
    let again = Model::from_json(&model.to_json(), "test").unwrap();
    assert_eq!(again, model);
}

#[test]
fn labels_are_a_phase_too_and_threads_do_not_matter() {
    let source = gait(9_000, 2, 0.5, 2);
    let options = options("refined:3", Some(PhaseKind::Labels(DataColumn::float("mode"))));
    let on_one_thread = with_threads(1, || run("phase", &options, &source).model);
    let phases = regions(&on_one_thread).phases.as_ref().unwrap();
    assert_eq!(phases.bins, PhaseBins::Labels(vec!["0".into(), "1".into(), "2".into()]));
    assert!((phases.rows_of_a_stride() * RATE - 1.0).abs() < 0.01);
    for threads in [2, 7] {
        let other = with_threads(threads, || run("phase", &options, &source).model);
        assert_eq!(other.to_json(), on_one_thread.to_json(), "{threads} threads");
    }
    // A phase changes nothing but what is told of it.
    let mut without = options;
    without.phase = None;
    let mut plain = run("phase", &without, &source).model;
    plain.partitions[0].phases.clone_from(&on_one_thread.partitions[0].phases);
    assert_eq!(plain, on_one_thread);
}

#[test]
fn columns_that_are_no_phase_are_refused() {
    let mut options = options("kmeans:2", Some(CYCLE));
    if let Some(phase) = &mut options.phase {
        phase.column = Expr::parse("20*phase", &Scope::new(["phase"])).unwrap();
    }
    let error = identify(&problem("x"), &options, &gait(400, 1, 0.0, 1), &Silent).unwrap_err();
    assert!(matches!(error, Error::NoPhase { low, high, .. } if low >= 0.0 && high > 19.0), "{error}");
}

/// Modes 1 and 2 as they are, on rows of one episode.
fn pair(differs: f64, seed: u64) -> RegionPair {
    let model = run("x", &options("labels:mode", Some(CYCLE)), &gait(600, 1, differs, seed)).model;
    let pairs = &regions(&model).pairs;
    assert_eq!(pairs.iter().map(|pair| pair.regions).collect::<Vec<_>>(), [[0, 1], [0, 2], [1, 2]]);
    assert!(pairs[..2].iter().all(|pair| pair.p < 1e-9), "mode 0 is another one");
    pairs[2]
}

#[test]
fn tests_of_equal_maps_reject_at_their_level() {
    let mut p: Vec<f64> = (0..300).map(|seed| pair(0.0, seed).p).collect();
    p.sort_by(f64::total_cmp);
    let n = p.len() as f64;
    let distance = p.iter().enumerate().map(|(i, p)| (p - i as f64 / n).abs().max(((i + 1) as f64 / n - p).abs()));
    let distance = distance.fold(0.0, f64::max);
    // Kolmogorov: greater than 1.63 / sqrt(n) once in a hundred, with fixed seeds.
    assert!(distance < 1.63 / n.sqrt(), "{distance}");
    // Off by 0.3, where its error is about 0.3 sqrt(3) sqrt(2 / 200).
    let far = (0..50).filter(|&seed| pair(0.4, seed).p < 1e-3).count();
    assert!(far >= 48, "{far}");
}

/// Rows of one map in two labels that change every 40 rows, where regressors and noise are correlated over some 20 rows.
fn slow(rows: usize, seed: u64) -> MemorySource {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut source = MemorySource::new(["x", "u", "dx", "mode", "phase"].map(DataColumn::float).to_vec());
    let mut columns = vec![Vec::new(); 5];
    let mut past = [0.0; 3];
    for row in 0..rows {
        past = past.map(|value| 0.9 * value + normal(&mut random));
        let [x, u, e] = past;
        let (mode, phase) = ((row / 40 % 2) as f64, row as f64 / 80.0);
        let values = [x, u, 1.0 - 0.5 * x + u + e, mode, phase.fract()];
        columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
    }
    source.push_uniform("run", 0.01, columns);
    source
}

#[test]
fn correlated_rows_do_not_separate_equal_regions() {
    let shares_of_pairs = |seed: u64| {
        let fitted = run("x", &options("labels:mode", Some(CYCLE)), &slow(8_000, seed));
        // Of one map for both the residuals are those of one region, up to what chance fits.
        let pair = regions(&fitted.model).pairs[0];
        (pair.p, pair.statistic / fitted.effective_rows * 8_000.0)
    };
    let shares: Vec<(f64, f64)> = (0..200).map(shares_of_pairs).collect();
    let below = shares.iter().filter(|(p, _)| *p < 0.05).count();
    // Of 200 tests 10 are below 0.05 by chance, and 20 or more in less than three of a thousand cases. Correlated rows that all count would say so far more often: 7.81 is the
    // quantile of three degrees of freedom.
    let naive = shares.iter().filter(|(_, statistic)| *statistic > 7.81).count();
    assert!(below < 20 && naive > 40, "{below} {naive}");
}

#[test]
fn a_lattice_joins_by_the_same_growth() {
    let identification = run("phase", &options("average,lattice:2", None), &gait(6_000, 1, 0.0, 3));
    let model = identification.models.first().unwrap_or(&identification.model);
    let regions = regions(model);
    let lattice = regions.lattice.as_ref().unwrap();
    let [pair] = regions.pairs.as_slice() else { panic!("one pair of two regions") };
    // Of one target the ratio of determinants is that of the errors, which the tree knows of its joins.
    let error =
        |regions: usize| lattice.levels.iter().find(|level| level.regions == regions).map(|level| level.training);
    let expected = identification.effective_rows * (lattice.joins[0].training / error(2).unwrap()).ln();
    // The test weighs regions by their noise, which is the same up to chance: some hundredths.
    assert!((pair.statistic / expected - 1.0).abs() < 0.05, "{} {expected}", pair.statistic);
}
