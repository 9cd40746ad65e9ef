//! The whole identification: K-50 with 10-fold cross-validation on 1e6 rows of 16 states and 8 targets, beside a careful scikit-learn script.
//!
//! Both sides have the same rows, folds (ten contiguous spans, with no gap beside them), starting centroids and number
//! of iterations of Lloyd's algorithm at most. They do the same work. Per fold: cluster the standardised training rows,
//! fit an affine map per region, measure squared and absolute errors on the held-out rows. Then the model of all rows.
//! Lower bound of the work: eleven clusterings (20 GFMA each by the plain product), and reading each row for eleven
//! partitions (a Gram of 24 columns: 300 FMA a row and partition).

use std::{sync::Mutex, time::Instant};

use fleetfoot::{
    Column, Progress, Silent,
    library::Expr,
    model::{Column as ModelColumn, Equation, Prediction, Role},
    pwa::{Options, Problem, Specification, identify},
    with_threads,
};
use fleetfoot_benches::{best_of, peak_rss_mib, peer, read_f64, write_f64};
use fleetfoot_data::MemorySource;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const STATES: usize = 16;
const TARGETS: usize = 8;
const CLUSTERS: usize = 50;
const ITERATIONS: usize = 25;

/// A gait-like signal: sixteen channels that follow two wandering phases, and targets that switch with them.
fn gait(rows: usize) -> Vec<Vec<f64>> {
    let mut random = Pcg64::seed_from_u64(7);
    let mut columns = vec![Vec::new(); STATES + TARGETS];
    let (mut left, mut right, mut drift) = (0.0f64, 1.0f64, 0.0f64);
    for _ in 0..rows {
        let mut noise = || random.random_range(-1.0..1.0);
        left += 0.03 + 0.01 * noise();
        right += 0.029 + 0.01 * noise();
        drift = 0.999 * drift + 0.05 * noise();
        for (j, column) in columns.iter_mut().take(STATES).enumerate() {
            let (harmonic, shift) = ((j / 4 + 1) as f64, j as f64);
            let phase = if j % 2 == 0 { left } else { right };
            column.push((harmonic * phase + shift).sin() + 0.4 * drift + 0.3 * noise());
        }
        let state: Vec<f64> = columns[..STATES].iter().map(|column| column[column.len() - 1]).collect();
        for t in 0..TARGETS {
            let contact = if state[t] + state[t + 8] > 0.3 { 4.0 } else { -1.0 };
            columns[STATES + t]
                .push(contact * state[(t + 3) % STATES] - 0.5 * state[t] + (state[t] * state[t + 1]) + 0.2 * noise());
        }
    }
    columns
}

fn problem() -> Problem {
    let names: Vec<String> = (0..STATES).map(|j| format!("s{j}")).collect();
    let targets: Vec<String> = (0..TARGETS).map(|t| format!("y{t}")).collect();
    let column = |name: &String, role| ModelColumn::new(name.clone(), role);
    let expressions = |names: &[String]| names.iter().map(|name| Expr::column(name.as_str())).collect::<Vec<_>>();
    Problem {
        columns: names
            .iter()
            .map(|n| column(n, Role::Input))
            .chain(targets.iter().map(|n| column(n, Role::Auxiliary)))
            .collect(),
        library: expressions(&names),
        equations: targets
            .iter()
            .map(|name| Equation {
                subject: name.clone(),
                prediction: Prediction::Value,
                right: Expr::column(format!("f_{name}")),
                target: Some(Expr::column(name.as_str())),
                unit: None,
            })
            .collect(),
        partition_columns: expressions(&names),
        weight: None,
        step: 0.001,
    }
}

/// Notes when each stage of an identification begins.
struct Stages(Mutex<Vec<(String, Instant)>>);

impl Progress for Stages {
    fn advance(&self, _: usize, _: usize) {}

    fn stage(&self, name: &str) {
        self.0.lock().expect("no panic elsewhere").push((name.to_owned(), Instant::now()));
    }
}

fn main() {
    let rows: usize =
        std::env::var("FLEETFOOT_BENCH_ROWS").ok().and_then(|text| text.parse().ok()).unwrap_or(1_000_000);
    let columns = gait(rows);
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("rows.f64");
    write_f64(&data, &columns.concat()).expect("the rows are written");
    // Starts: evenly spaced rows, standardised over all rows; the same array for every fold and both programs.
    let mut start = vec![0.0; CLUSTERS * STATES];
    for (j, column) in columns.iter().take(STATES).enumerate() {
        let mean = column.iter().sum::<f64>() / rows as f64;
        let deviation = (column.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / rows as f64).sqrt();
        for k in 0..CLUSTERS {
            start[k * STATES + j] = (column[(2 * k + 1) * rows / (2 * CLUSTERS)] - mean) / deviation;
        }
    }
    let start_file = folder.path().join("start.f64");
    write_f64(&start_file, &start).expect("the starts are written");

    let names = (0..STATES).map(|j| format!("s{j}")).chain((0..TARGETS).map(|t| format!("y{t}")));
    let mut source = MemorySource::new(names.map(Column::float).collect());
    source.push_uniform("gait", 0.001, columns);
    let mut options = Options::default();
    options.partitions = vec![Specification::KMeans(CLUSTERS)];
    options.folds = 10;
    options.purge = Some(0);
    options.iterations = ITERATIONS;
    options.start = Some(start);
    let problem = problem();
    println!(
        "K-{CLUSTERS}, 10-fold cross-validation, {rows} rows x {STATES} states, {TARGETS} targets, at most {ITERATIONS} iterations"
    );
    println!("{:<34}{:>10}{:>12}", "", "seconds", "peak MiB");
    let (seconds, _) =
        best_of(2, || with_threads(2, || identify(&problem, &options, &source, &Silent).expect("a model")));
    println!("{:<34}{seconds:>10.2}{:>12.0}", "fleetfoot, 2 threads", peak_rss_mib());
    let stages = Stages(Mutex::new(Vec::new()));
    let (_, fitted) =
        best_of(1, || with_threads(2, || identify(&problem, &options, &source, &stages).expect("a model")));
    stages.stage("end");
    for pair in stages.0.lock().expect("no panic elsewhere").windows(2) {
        println!("    {:<30}{:>10.2}", pair[0].0, (pair[1].1 - pair[0].1).as_secs_f64());
    }
    let losses = folder.path().join("losses.f64");
    match peer("fit.py", &[&data, &start_file, &losses]) {
        Err(reason) => println!("scikit-learn: absent ({reason})"),
        Ok(answer) => {
            let theirs = answer["seconds"].as_f64().unwrap_or(f64::NAN);
            let peak = answer["peak_mib"].as_f64().unwrap_or(f64::NAN);
            println!(
                "{:<34}{theirs:>10.2}{peak:>12.0}",
                format!("scikit-learn {}", answer["version"].as_str().unwrap_or(""))
            );
            println!("ratio {:.1}", theirs / seconds);
            let expected = read_f64(&losses).expect("the peer's losses");
            let score = &fitted.candidates[0];
            let mut worst = 0.0f64;
            for (ours, theirs) in score.losses.iter().zip(&expected) {
                worst = worst.max((ours - theirs).abs() / theirs);
            }
            for (ours, theirs) in score.over_null.iter().zip(&expected[10..]) {
                worst = worst.max((ours - theirs).abs() / theirs);
            }
            println!("largest relative difference of the fold losses and absolute errors: {worst:.1e}");
            assert!(worst < 1e-6, "the answers differ");
        }
    }
}
