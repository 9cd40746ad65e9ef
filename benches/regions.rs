//! Regions that fit the dynamics, beside k-means: `refined:K`, `lattice:1..50` and `tree:1..6` on 1e6 rows of 16 random
//! columns. Eight targets follow ten maps between random linear separators in three of the columns, with noise; once
//! with regions by all columns, and once by the three. There is no peer at this size; all comparisons are made in the
//! same run.
//!
//! Lower bound of the work. k-means goes over the rows some ten times (16 K FMA a row). A scan of one partition sums
//! Gram matrices of 24 columns (300 FMA a row). Refinements see a sample of the rows, whatever their number, and the
//! scan sees all.

use std::{
    ops::Range,
    sync::atomic::{AtomicUsize, Ordering},
    time::Instant,
};

use fleetfoot::{
    Column, Episode, Silent, Source,
    library::Expr,
    model::{Column as ModelColumn, Equation, Prediction, Role},
    pwa::{Identification, Options, Problem, Specification, identify},
    with_threads,
};
use fleetfoot_benches::{cpu_seconds, peak_rss_mib, reset_peak_rss};
use fleetfoot_data::{Block, Halo, MemorySource};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const STATES: usize = 16;
const TARGETS: usize = 8;
const MODES: usize = 10;
/// Columns that separate the modes.
const TELLING: usize = 3;
/// Standard deviation of the noise; the targets' own is some two to three.
const NOISE: f64 = 0.3;
/// Most times of k-means' CPU seconds that refined regions may take, at ten regions.
const SLOWEST: f64 = 8.0;
/// Largest ratio of the error of joined cells to that of separately refined regions.
const FARTHEST: f64 = 1.03;
/// Regions at which all partitions are compared.
const COMPARED: [usize; 5] = [2, 5, 10, 20, 50];

fn normal(random: &mut Pcg64) -> f64 {
    let (u, v): (f64, f64) = (random.random_range(f64::MIN_POSITIVE..1.0), random.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Normal columns, and targets of ten modes that three columns separate.
fn rows(count: usize) -> Vec<Vec<f64>> {
    let mut random = Pcg64::seed_from_u64(11);
    let mut table = |rows: usize, columns: usize| -> Vec<Vec<f64>> {
        (0..rows).map(|_| (0..columns).map(|_| normal(&mut random)).collect()).collect()
    };
    let mut separators = table(MODES, STATES);
    separators.iter_mut().for_each(|row| row[TELLING..].fill(0.0));
    let maps: Vec<Vec<Vec<f64>>> = (0..MODES).map(|_| table(TARGETS, STATES + 1)).collect();
    let mut columns: Vec<Vec<f64>> = (0..STATES + TARGETS).map(|_| Vec::with_capacity(count)).collect();
    let mut random = Pcg64::seed_from_u64(12);
    for _ in 0..count {
        let x: Vec<f64> = (0..STATES).map(|_| normal(&mut random)).collect();
        let dot = |weights: &[f64]| weights.iter().zip(&x).map(|(w, x)| w * x).sum::<f64>();
        let best = |a: &usize, b: &usize| dot(&separators[*a]).total_cmp(&dot(&separators[*b]));
        let mode = (0..MODES).max_by(best).unwrap_or(0);
        for (t, map) in maps[mode].iter().enumerate() {
            let value = map[STATES] + 0.5 * dot(&map[..STATES]) + NOISE * normal(&mut random);
            columns[STATES + t].push(value);
        }
        columns.iter_mut().zip(&x).for_each(|(column, x)| column.push(*x));
    }
    columns
}

/// Regions by the first `partitioned` columns.
fn problem(partitioned: usize) -> Problem {
    let names = |letter: char, count: usize| (0..count).map(|j| format!("{letter}{j}")).collect::<Vec<String>>();
    let (states, targets) = (names('s', STATES), names('y', TARGETS));
    let column = |name: &String, role| ModelColumn::new(name.clone(), role);
    let inputs: Vec<Expr> = states.iter().map(|name| Expr::column(name.as_str())).collect();
    let equation = |name: &String| Equation {
        subject: name.clone(),
        prediction: Prediction::Value,
        right: Expr::column(format!("f_{name}")),
        target: Some(Expr::column(name.as_str())),
        unit: None,
    };
    let columns = states.iter().map(|name| column(name, Role::Input));
    Problem {
        columns: columns.chain(targets.iter().map(|name| column(name, Role::Auxiliary))).collect(),
        partition_columns: inputs[..partitioned].to_vec(),
        library: inputs,
        equations: targets.iter().map(equation).collect(),
        weight: None,
        step: 0.001,
    }
}

/// A source that counts the rows it gives, neighbours at borders left out.
struct Counted {
    rows: MemorySource,
    read: AtomicUsize,
}

impl Source for Counted {
    fn columns(&self) -> &[Column] {
        self.rows.columns()
    }

    fn episodes(&self) -> &[Episode] {
        self.rows.episodes()
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, fleetfoot_data::Error> {
        self.read.fetch_add(rows.len(), Ordering::Relaxed);
        self.rows.read(episode, rows, halo)
    }
}

/// Cost and result of a fit.
struct Run {
    seconds: f64,
    cpu: f64,
    /// Times that all rows were read.
    passes: f64,
    /// The largest resident set, the rows themselves among it.
    peak: f64,
    identification: Identification,
}

impl Run {
    fn of(partitions: &str, partitioned: usize, source: &Counted) -> Self {
        let mut options = Options::default();
        options.partitions = Specification::parse_list(partitions).expect("a partition");
        options.folds = 0;
        options.keep_all = true;
        reset_peak_rss();
        source.read.store(0, Ordering::Relaxed);
        let (before, cpu) = (Instant::now(), cpu_seconds());
        let identification =
            with_threads(2, || identify(&problem(partitioned), &options, source, &Silent).expect("a model"));
        let passes = source.read.load(Ordering::Relaxed) as f64 / source.rows() as f64;
        let (seconds, cpu) = (before.elapsed().as_secs_f64(), cpu_seconds() - cpu);
        Self { seconds, cpu, passes, peak: peak_rss_mib(), identification }
    }

    /// Squared error over variance of a candidate, mean over the targets.
    fn error(&self, candidate: usize) -> f64 {
        self.identification.candidates[candidate].r2.iter().map(|r2| 1.0 - r2).sum::<f64>() / TARGETS as f64
    }

    fn line(&self, name: &str, unit: f64) {
        println!(
            "{name:<18}{:>10.2}{:>10.2}{:>10.2}{:>10.2}{:>10.0}{:>10.4}",
            self.seconds,
            self.cpu,
            self.cpu / unit,
            self.passes,
            self.peak,
            self.error(self.identification.candidates.len() - 1)
        );
    }
}

fn main() {
    let count: usize =
        std::env::var("FLEETFOOT_BENCH_ROWS").ok().and_then(|text| text.parse().ok()).unwrap_or(1_000_000);
    let names = (0..STATES).map(|j| format!("s{j}")).chain((0..TARGETS).map(|t| format!("y{t}")));
    let mut rows_of = MemorySource::new(names.map(Column::float).collect());
    rows_of.push_uniform("rows", 0.001, rows(count));
    let source = Counted { rows: rows_of, read: AtomicUsize::new(0) };
    println!(
        "{} rows x {STATES} columns ({:.0} MiB with {TARGETS} targets of {MODES} modes), all rows train; 2 threads",
        source.rows(),
        (count * (STATES + TARGETS) * 8) as f64 / 1024.0 / 1024.0
    );
    for partitioned in [STATES, TELLING] {
        on_columns(partitioned, &source);
    }
}

/// All partitions by the first columns.
fn on_columns(partitioned: usize, source: &Counted) {
    let about = if partitioned == TELLING { ", those that tell the modes apart" } else { "" };
    println!("\nregions by {partitioned} columns{about}");
    println!(
        "{:<18}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}",
        "", "seconds", "CPU s", "ratio", "passes", "peak MiB", "error"
    );
    let run = |partitions: &str| Run::of(partitions, partitioned, source);
    let clustered = run("kmeans:10");
    clustered.line("kmeans:10", clustered.cpu);
    let refined = run("refined:10");
    refined.line("refined:10", clustered.cpu);
    run("tree:1..6").line("tree:1..6", clustered.cpu);
    let lattice = run("lattice:1..50");
    lattice.line("lattice:1..50", clustered.cpu);
    let objective = &refined.identification.candidates[0].objective;
    assert!(objective.windows(2).all(|pair| pair[1] <= pair[0]), "the objective falls: {objective:?}");
    assert!(refined.error(0) < clustered.error(0), "regions that fit the dynamics fit no worse than cells of k-means");
    let ratio = refined.cpu / clustered.cpu;
    println!("\nrefined:10 takes {ratio:.1} times the CPU time of kmeans:10 (at most {SLOWEST} wanted)");
    levels(&lattice);
    compare(&lattice, &run);
}

/// Checks the errors that the tree of joins gives for a level against those of its model on the rows.
fn levels(lattice: &Run) {
    let last = lattice.identification.models.last().expect("models");
    let levels = &last.partitions[0].lattice.as_ref().expect("a tree").levels;
    for (at, level) in levels.iter().enumerate() {
        let direct = lattice.error(at);
        assert!((level.training - direct).abs() < 1e-9 * direct, "{}: {} {direct}", level.regions, level.training);
    }
    println!("\nerrors of the lattice by regions, each equal to that of its model on the rows within 1e-9:");
    for row in levels.chunks(10) {
        let texts: Vec<String> = row.iter().map(|level| format!("{:>8.4}", level.training)).collect();
        println!("{:>4} ...{}", row[0].regions, texts.concat());
    }
}

/// One tree of all numbers of regions beside partitions that are made for one number.
fn compare(lattice: &Run, run: &dyn Fn(&str) -> Run) {
    println!(
        "\n{:<10}{:>10}{:>10}{:>10}{:>18}{:>16}{:>16}",
        "regions", "kmeans", "lattice", "refined", "lattice/refined", "kmeans CPU s", "refined CPU s"
    );
    for regions in COMPARED {
        let clustered = run(&format!("kmeans:{regions}"));
        let refined = run(&format!("refined:{regions}"));
        let (joined, alone) = (lattice.error(regions - 1), refined.error(0));
        println!(
            "{regions:<10}{:>10.4}{joined:>10.4}{alone:>10.4}{:>18.3}{:>16.2}{:>16.2}{}",
            clustered.error(0),
            joined / alone,
            clustered.cpu,
            refined.cpu,
            if joined > FARTHEST * alone { "  farther than 3 %" } else { "" }
        );
    }
}
