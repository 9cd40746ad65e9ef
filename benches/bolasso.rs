//! The bolasso of one aircraft (block-sparse bolasso paper, section 9): 128 row-bootstrap replicates of 334,531 rows x
//! 3 tasks x 45 columns. The peers are scikit-learn's `LassoLars` for each replicate, and numpy's weighted Grams with
//! `lars_path_gram`. Then 1,000 episode replicates from the statistic, beside the scan that made it.
//!
//! Rows are climbs of the simulated aircraft with turbulence, so that the equations have errors. The peers get the same
//! standardised block matrix, target and resampling counts in files. They time a few of the replicates, scaled to 128.
//! Selected columns and coefficients are compared replicate by replicate.
//!
//! Bias: the peers' block matrix is made beforehand, ours is made from the columns within the time; reading their files is not timed. `LassoLars` gets the
//! rows repeated (those with count zero left out, others multiplied by the root of their count, which is kinder than repetition). Our certificates are
//! within our time.

use std::{error::Error, path::Path, time::Instant};

use faer::{Accum, Mat, Par, linalg::matmul::matmul};
use fleetfoot_benches::{best_of, peak_rss_mib, peer, read_f64, write_f64};
use fleetfoot_data::{Halo, MemorySource, Silent, Source, thread_count};
use fleetfoot_library::{Design, DesignRows, Expr, Scope};
use fleetfoot_sim::plant::aircraft::{AircraftClimb, Airplane, Flight, Latent};
use fleetfoot_sparse::{
    bolasso::{
        BootstrapOptions, BootstrapUnit, Selection, bach_lambda, block_bootstrap, poisson_counts, row_bootstrap,
    },
    structured::Assembly,
};
use fleetfoot_sums::structured::{Banks, Candidates, Plan, Regression, Task, Term};

/// Rows of the subset of section 9.3 of the paper, and replicates.
const ROWS: usize = 334_531;
const REPLICATES: usize = 128;
/// Replicates that the peers are timed on.
const TIMED: usize = 4;
const SEED: u64 = 7;
/// lambda_0 in the units of the target, whose mean square is near the number of tasks.
const LAMBDA_0: f64 = 0.2;

fn main() -> Result<(), Box<dyn Error>> {
    let source = flights();
    println!("{} flights, {} rows, {} threads", source.episodes().len(), source.rows(), thread_count());
    let regression = regression()?;
    let (scan_seconds, (plan, scanned)) = best_of(3, || {
        let plan = Plan::new(regression.clone(), Vec::new(), 4096, &source).expect("a plan");
        let scanned = plan.scan(&source, &Silent).expect("a scan");
        (plan, scanned)
    });
    let banks = Banks::new(&scanned, |_| true);
    let weights = banks.total().into_iter().map(|root| {
        let mean_square = root.total[0] / root.weight + root.mean_y[0].powi(2);
        if mean_square > 0.0 { mean_square.recip() } else { 1e-6 }
    });
    let assembly = Assembly { weights: weights.collect(), ..Assembly::default() };
    let lambda = bach_lambda(LAMBDA_0, source.rows() as f64);
    let options =
        BootstrapOptions { replicates: REPLICATES, seed: SEED, threshold: 0.9, ..BootstrapOptions::new(lambda) };

    println!("\nrow bootstrap, {REPLICATES} replicates, lambda = {lambda:.3e}; seconds, best of 3");
    let (seconds, selection) = best_of(3, || row_bootstrap(&plan, &assembly, &source, &options, &Silent));
    let selection = selection?;
    let rss = peak_rss_mib();
    report("fleetfoot", seconds, &selection);
    floor(seconds);
    println!(
        "peak memory {rss:.0} MiB, of which {:.0} MiB are the flights",
        (source.rows() * Flight::columns().len() * 8) as f64 / 1048576.0
    );
    peers(&regression, &assembly, &source, &selection, seconds, lambda)?;

    println!("\nscan of the same rows {scan_seconds:.3} s");
    let options = BootstrapOptions { replicates: 1000, ..options };
    let (seconds, selection) = best_of(3, || {
        let banks = Banks::new(&scanned, |_| true);
        block_bootstrap(&regression.structure(), &banks, &assembly, BootstrapUnit::Episode, &options, &Silent)
    });
    report("1,000 episode replicates", seconds, &selection?);
    println!("share of the scan's time {:.3}", seconds / scan_seconds);
    Ok(())
}

fn report(name: &str, seconds: f64, selection: &Selection) {
    let mean = selection.sizes.iter().sum::<usize>() as f64 / selection.sizes.len() as f64;
    println!(
        "{name:<26} {seconds:>8.3} s  selects {mean:.1} on average, {} in 90 %, {} in all; kkt {:.1e}, {} stalled",
        selection.support.len(),
        selection.support(1.0).len(),
        selection.worst_kkt,
        selection.stalled
    );
}

/// The flops of the product over the machine's rate.
fn floor(seconds: f64) {
    let size = 2048;
    let a = Mat::from_fn(size, size, |i, j| ((i + 3 * j) % 7) as f64);
    let mut c = Mat::zeros(size, size);
    let (peak, ()) = best_of(3, || matmul(c.as_mut(), Accum::Replace, a.as_ref(), a.as_ref(), 1.0, Par::Seq));
    let rate = 2.0 * (size as f64).powi(3) / peak * thread_count() as f64;
    // T x T 120, D x D and L x L 55, Isp x Isp 55, T x D, T x L and T x Isp 150 each, targets 45 and 1, the weight 1.
    let flops = 2.0 * (120 + 55 + 55 + 3 * 150 + 46 + 1) as f64 * ROWS as f64 * REPLICATES as f64;
    let least = flops / rate;
    println!(
        "product {:.0} GFlop, {:.0} GFlop/s: at least {least:.3} s, {:.2} of the time",
        flops * 1e-9,
        rate * 1e-9,
        least / seconds
    );
}

fn flights() -> MemorySource {
    let airplane = Airplane::new(&AircraftClimb::default()).expect("the default aircraft");
    let mut source = MemorySource::new(Flight::columns());
    let mut left = ROWS;
    for number in 0.. {
        let mut flight = airplane.flight(number);
        let rows = flight.rows().min(left);
        flight.values.iter_mut().for_each(|column| column.truncate(rows));
        flight.append_to(&mut source);
        left -= rows;
        if left == 0 {
            break;
        }
    }
    source
}

/// Equations (32) to (34).
fn regression() -> Result<Regression, Box<dyn Error>> {
    let scope = Scope::new(Flight::columns().iter().map(|column| column.name.clone()));
    let parse = |text: &str| Expr::parse(text, &scope);
    let latents = Latent::ALL.iter().map(|latent| {
        let functions: Result<Vec<Expr>, _> = latent.features().iter().map(|text| parse(text)).collect();
        Ok::<_, Box<dyn Error>>(Candidates { name: latent.name().to_owned(), functions: functions? })
    });
    let task = |name: &str, target: &str, terms: &[(usize, &str)]| {
        let terms = terms.iter().map(|&(latent, text)| Ok(Term { latent, coefficient: parse(text)? }));
        let terms: Result<Vec<Term>, Box<dyn Error>> = terms.collect();
        Ok::<_, Box<dyn Error>>(Task { name: name.to_owned(), target: parse(target)?, terms: terms?, prior: false })
    };
    Ok(Regression {
        latents: latents.collect::<Result<_, _>>()?,
        tasks: vec![
            task("V", "m*V_dot + m*9.80665*sin(gamma)", &[(0, "cos(alpha)"), (1, "-1")])?,
            task("gamma", "m*V*gamma_dot + m*9.80665*cos(gamma)", &[(0, "sin(alpha)"), (2, "1")])?,
            task("m", "0*m", &[(0, "1"), (3, "m_dot")])?,
        ],
        weight: None,
    })
}

/// Runs the peers on the same rows and counts.
fn peers(
    regression: &Regression,
    assembly: &Assembly,
    source: &MemorySource,
    selection: &Selection,
    seconds: f64,
    lambda: f64,
) -> Result<(), Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    write_problem(regression, assembly, source, folder.path())?;
    let p = regression.coefficients();
    let numbers = [source.rows(), p, regression.tasks.len(), TIMED].map(|value| value.to_string());
    for (name, text) in [("gram", "numpy Grams, lars_path_gram"), ("rows", "LassoLars")] {
        let lambda = format!("{lambda:e}");
        let arguments = [folder.path(), Path::new(name), Path::new(&lambda)];
        let arguments: Vec<&Path> = arguments.into_iter().chain(numbers.iter().map(Path::new)).collect();
        match peer("bolasso.py", &arguments) {
            Err(reason) => println!("{text:<28} absent: {reason}"),
            Ok(answer) => {
                let theirs = answer["seconds"].as_f64().unwrap_or(f64::NAN) / TIMED as f64 * REPLICATES as f64;
                let version = answer["version"].as_str().unwrap_or_default();
                let coefficients = read_f64(&folder.path().join("coefficients.f64"))?;
                let (mut apart, mut other) = (0.0_f64, 0);
                for (replicate, theirs) in coefficients.chunks_exact(p).enumerate() {
                    for j in 0..p {
                        let ours = selection.coefficients[(replicate, j)];
                        let largest =
                            (0..TIMED).map(|k| selection.coefficients[(k, j)].abs()).fold(theirs[j].abs(), f64::max);
                        apart = apart.max((ours - theirs[j]).abs() / largest.max(f64::MIN_POSITIVE));
                        other += usize::from((ours != 0.0) != (theirs[j] != 0.0));
                    }
                }
                println!(
                    "{text:<28} {theirs:>9.1} s (scikit-learn {version}; {TIMED} timed)  {:.0} times ours; {other} columns selected otherwise, {apart:.1e} apart",
                    theirs / seconds
                );
                if other > 0 || apart > 1e-4 {
                    return Err(format!("the replicates are not those of {text}").into());
                }
            }
        }
    }
    Ok(())
}

/// The block matrix with the roots of the task weights (task after task, column-major), the target, and the counts of the timed replicates.
fn write_problem(
    regression: &Regression,
    assembly: &Assembly,
    source: &MemorySource,
    folder: &Path,
) -> Result<(), Box<dyn Error>> {
    let (n, p, tasks) = (source.rows(), regression.coefficients(), regression.tasks.len());
    let structure = regression.structure();
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let mut b = vec![0.0; n * tasks * p];
    let mut y = vec![0.0; n * tasks];
    let mut counts = vec![0.0; n * TIMED];
    for task in 0..tasks {
        let design = Design::compile(&regression.columns(task), &names)?;
        let mut first = task * n;
        let root = assembly.weights[task].sqrt();
        for (episode, info) in source.episodes().iter().enumerate() {
            let block = source.read(episode, 0..info.rows, Halo::default())?;
            let mut rows = DesignRows::default();
            design.evaluate(&block, 0..info.rows, &mut rows);
            assert_eq!(rows.rows(), info.rows, "complete rows");
            for (column, j) in structure.columns(task).into_iter().enumerate() {
                let target = &mut b[j * n * tasks + first..j * n * tasks + first + info.rows];
                target.iter_mut().zip(rows.output(column)).for_each(|(entry, value)| *entry = root * value);
            }
            let target = rows.output(structure.columns(task).len());
            y[first..first + info.rows].iter_mut().zip(target).for_each(|(entry, value)| *entry = root * value);
            if task == 0 {
                let drawn = poisson_counts(SEED, info.id, 0, info.rows, TIMED);
                for replicate in 0..TIMED {
                    let counts = &mut counts[replicate * n + first..replicate * n + first + info.rows];
                    counts.iter_mut().enumerate().for_each(|(row, count)| *count = drawn[(replicate, row)]);
                }
            }
            first += info.rows;
        }
    }
    let start = Instant::now();
    write_f64(&folder.join("b.f64"), &b)?;
    write_f64(&folder.join("y.f64"), &y)?;
    write_f64(&folder.join("counts.f64"), &counts)?;
    println!("peers' files written in {:.1} s", start.elapsed().as_secs_f64());
    Ok(())
}
