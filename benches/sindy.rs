//! SINDy from rows to equations beside pysindy's `fit`. The cases are 1e6 rows x 3 states with all 56 monomials to
//! degree 5 (Lorenz), 1e7 such rows from a Parquet file, and 1e6 rows x 16 states with all 969 monomials to degree 3
//! (Lorenz 1996). The feature matrix of the last is too large here for pysindy.
//!
//! The states carry noise of a ten-thousandth of their deviation, as measured states do; central differences make it half a per cent of the slopes. Without noise the slopes are
//! polynomials of the states to a dozen digits, and the plan sums products of pairs, which keep them: that is timed too.
//!
//! All run with central differences and STLSQ. Timed is everything from the rows in memory (or the closed file) to the coefficients: pilot, plan, scan, factor,
//! thresholding. The answers are compared with pysindy's in the same run, and with the true equations where it cannot run.
//!
//! The limit is printed for every scan: the multiply-adds that its sums need at the rate of this processor in
//! registers, on all threads, and the bytes of its columns read once.
//!
//! Bias: fleetfoot's fit is the best of several, pysindy's the best of two. Our scan is repeated on rows that are in memory; the Parquet file is in the page cache. pysindy uses the
//! differences at the ends of the trajectory, we leave these two rows out. Peaks of memory are of the whole process, the rows included.

use std::{error::Error, path::Path, time::Instant};

use faer::Mat;
use fleetfoot_benches::{best_of, fma_rate, peak_rss_mib, peer, read_f64, write_f64};
use fleetfoot_data::{Column, MemorySource, Silent, Source, thread_count};
use fleetfoot_library::{Expr, Library, central_difference};
use fleetfoot_log::{Selection, open};
use fleetfoot_output::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions};
use fleetfoot_sparse::threshold::{Optimizer, Stlsq, Terms, optimize};
use fleetfoot_sums::system::{System, SystemPlan, SystemScan};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const STEP: f64 = 0.002;

/// A system of ordinary differential equations to be found again.
struct Case {
    name: &'static str,
    states: usize,
    rows: usize,
    degree: u32,
    threshold: f64,
    repeats: usize,
    /// Deviation of the noise on every state.
    noise: f64,
    slope: fn(&[f64], &mut [f64]),
}

/// Lorenz (1963).
fn lorenz(s: &[f64], out: &mut [f64]) {
    out[0] = 10.0 * (s[1] - s[0]);
    out[1] = s[0] * (28.0 - s[2]) - s[1];
    out[2] = s[0] * s[1] - 8.0 / 3.0 * s[2];
}

/// Lorenz (1996) with forcing 8: chaotic.
fn lorenz_96(s: &[f64], out: &mut [f64]) {
    let n = s.len();
    for k in 0..n {
        out[k] = (s[(k + 1) % n] - s[(k + n - 2) % n]) * s[(k + n - 1) % n] - s[k] + 8.0;
    }
}

/// The trajectory, a state a column: Runge-Kutta steps of fourth order, then noise.
fn trajectory(case: &Case) -> Vec<Vec<f64>> {
    let n = case.states;
    let mut columns = vec![Vec::new(); n];
    let mut s: Vec<f64> = (0..n).map(|k| 1.0 + 0.1 * (k as f64 * 1.3).sin()).collect();
    let (mut slopes, mut ahead) = (vec![vec![0.0; n]; 4], vec![0.0; n]);
    for row in 0..case.rows + 5_000 {
        // The way to the attractor is left out.
        if row >= 5_000 {
            columns.iter_mut().zip(&s).for_each(|(column, &value)| column.push(value));
        }
        for stage in 0..4 {
            let step = STEP * [0.0, 0.5, 0.5, 1.0][stage];
            let before = stage.saturating_sub(1);
            (0..n).for_each(|k| ahead[k] = s[k] + step * slopes[before][k]);
            (case.slope)(&ahead, &mut slopes[stage]);
        }
        for (k, s) in s.iter_mut().enumerate() {
            *s += STEP / 6.0 * (slopes[0][k] + 2.0 * slopes[1][k] + 2.0 * slopes[2][k] + slopes[3][k]);
        }
    }
    let mut random = Pcg64::seed_from_u64(6);
    for value in columns.iter_mut().flatten() {
        // Four uniform numbers have the variance 1/3 together.
        let uniform: f64 = (0..4).map(|_| random.random_range(-0.5..0.5)).sum();
        *value += case.noise * 3.0_f64.sqrt() * uniform;
    }
    columns
}

fn names(states: usize) -> Vec<String> {
    (0..states).map(|k| format!("x{k}")).collect()
}

fn system(case: &Case) -> Result<System> {
    let states: Vec<Expr> = names(case.states).into_iter().map(Expr::column).collect();
    let functions = Library::polynomial(&states, case.degree)?.functions().to_vec();
    Ok(System::new(functions, states.iter().map(|state| central_difference(state, false)).collect()))
}

/// Coefficients (states x columns, the constant first), and the time of each part.
struct Fit {
    coefficients: Mat<f64>,
    seconds: [f64; 3],
    sums: usize,
    moments: bool,
    scan: SystemScan,
}

fn fit(case: &Case, source: &dyn Source) -> Result<Fit> {
    let start = Instant::now();
    let plan = SystemPlan::new(system(case)?, None, source)?;
    let planned = start.elapsed().as_secs_f64();
    let scan = plan.scan(source, &Silent)?;
    let scanned = start.elapsed().as_secs_f64();
    let problem = scan.root(0).compressed(true);
    let optimizer = Optimizer::Stlsq(Stlsq { threshold: case.threshold, ..Stlsq::default() });
    let mut coefficients = Mat::zeros(case.states, problem.columns());
    for target in 0..case.states {
        let trail = optimize(&problem, target, &optimizer, &Terms::default())?;
        let step = trail.steps.last().ok_or("a model")?;
        step.coefficients.iter().enumerate().for_each(|(j, &value)| coefficients[(target, j)] = value);
    }
    let solved = start.elapsed().as_secs_f64();
    let seconds = [planned, scanned - planned, solved - scanned];
    Ok(Fit { coefficients, seconds, sums: plan.sums(), moments: plan.is_polynomial(), scan })
}

/// Times a fit and prints its distance from the limits.
fn timed(case: &Case, source: &dyn Source, rate: Option<f64>) -> Result<(f64, Fit)> {
    let mut best = fit(case, source)?;
    for _ in 1..case.repeats {
        let next = fit(case, source)?;
        if next.seconds.iter().sum::<f64>() < best.seconds.iter().sum() {
            best = next;
        }
    }
    let [plan, scan, solve] = best.seconds;
    let seconds = plan + scan + solve;
    let method = if best.moments { "Chebyshev moments" } else { "products of pairs" };
    println!(
        "  fleetfoot, {} threads: {seconds:.3} s (plan {plan:.3}, scan {scan:.3}, factor and STLSQ {solve:.3}); peak {:.0} MiB; {method}, {} sums a row, {} chunks",
        thread_count(),
        peak_rss_mib(),
        best.sums,
        best.scan.units().len(),
    );
    let bytes = 8e-9 * (case.rows * (case.states + 1)) as f64;
    let flops = (best.sums * case.rows) as f64;
    if let Some(rate) = rate {
        let limit = flops / (rate * thread_count() as f64);
        println!(
            "  limit of the scan: {:.1} G multiply-adds, {limit:.3} s at {:.1} G/s a thread: {:.1} times; {bytes:.2} GB of columns, read at {:.1} GB/s",
            1e-9 * flops,
            1e-9 * rate,
            scan / limit,
            bytes / scan
        );
    }
    Ok((seconds, best))
}

/// Largest difference from the true equations, relative to the largest coefficient; the supports must be equal.
fn check_truth(case: &Case, coefficients: &Mat<f64>, truth: impl Fn(usize) -> Vec<(String, f64)>) -> Result<f64> {
    let mut columns = vec!["1".to_owned()];
    columns.extend(system(case)?.functions.iter().map(Expr::to_string));
    let mut worst = 0.0_f64;
    for state in 0..case.states {
        let mut row = vec![0.0; columns.len()];
        for (name, value) in truth(state) {
            let place = columns.iter().position(|column| *column == name).ok_or(format!("no column {name}"))?;
            row[place] = value;
        }
        let largest = row.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        for (j, expected) in row.into_iter().enumerate() {
            if (coefficients[(state, j)] == 0.0) != (expected == 0.0) {
                return Err(
                    format!("x{state}': {} is {} and not {expected}", columns[j], coefficients[(state, j)]).into()
                );
            }
            worst = worst.max((coefficients[(state, j)] - expected).abs() / largest);
        }
    }
    Ok(worst)
}

fn lorenz_truth(state: usize) -> Vec<(String, f64)> {
    let terms: &[(&str, f64)] = match state {
        0 => &[("x0", -10.0), ("x1", 10.0)],
        1 => &[("x0", 28.0), ("x1", -1.0), ("x0*x2", -1.0)],
        _ => &[("x2", -8.0 / 3.0), ("x0*x1", 1.0)],
    };
    terms.iter().map(|&(name, value)| (name.to_owned(), value)).collect()
}

fn lorenz_96_truth(state: usize, n: usize) -> Vec<(String, f64)> {
    let product = |a: usize, b: usize| format!("x{}*x{}", a.min(b), a.max(b));
    let (before, ahead, far) = ((state + n - 1) % n, (state + 1) % n, (state + n - 2) % n);
    vec![("1".into(), 8.0), (format!("x{state}"), -1.0), (product(ahead, before), 1.0), (product(far, before), -1.0)]
}

/// pysindy on the same rows: the ratios, and the largest difference of the coefficients relative to the equation's largest.
fn beside_pysindy(case: &Case, columns: &[Vec<f64>], ours: f64, memory: f64, coefficients: &Mat<f64>) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let (input, output) = (folder.path().join("rows.f64"), folder.path().join("coefficients.f64"));
    write_f64(&input, &columns.concat())?;
    let words = [case.states.to_string(), STEP.to_string(), case.degree.to_string(), case.threshold.to_string()];
    let mut arguments = vec![input.as_path()];
    arguments.extend(words.iter().map(Path::new));
    arguments.push(&output);
    let mut answers = Vec::new();
    for _ in 0..2 {
        match peer("sindy.py", &arguments) {
            Ok(answer) => answers.push(answer),
            Err(reason) => {
                println!("  pysindy: absent ({reason})");
                return Ok(());
            }
        }
    }
    let number = |key: &str| answers.iter().filter_map(|answer| answer[key].as_f64()).fold(f64::INFINITY, f64::min);
    let (seconds, peak) = (number("seconds"), number("peak_mib"));
    let version = answers[0]["version"].as_str().unwrap_or("?");
    println!(
        "  pysindy {version}: fit {seconds:.2} s, peak {peak:.0} MiB (before the fit {:.0})",
        number("before_mib")
    );
    println!("  ratio: {:.0} times faster, {:.1} times less memory", seconds / ours, peak / memory);
    let theirs = read_f64(&output)?;
    let width = coefficients.ncols();
    let mut worst = 0.0_f64;
    for state in 0..case.states {
        let row = &theirs[state * width..(state + 1) * width];
        let largest = row.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        for (j, &value) in row.iter().enumerate() {
            assert_eq!(value == 0.0, coefficients[(state, j)] == 0.0, "supports of equation {state}, column {j}");
            worst = worst.max((value - coefficients[(state, j)]).abs() / largest);
        }
    }
    println!("  the same supports; largest difference of coefficients {worst:.1e} of their equation's largest");
    assert!(worst < 1e-6, "the answers agree");
    Ok(())
}

/// Writes the trajectory a piece at a time.
fn write(path: &Path, columns: &[Vec<f64>]) -> Result<()> {
    let mut described = vec![WriteColumn::new("t", WriteKind::Stamp)];
    described.extend(names(columns.len()).into_iter().map(|name| WriteColumn::new(name, WriteKind::Float)));
    let options = WriteOptions { row_group_rows: 1 << 20, ..WriteOptions::default() };
    let mut writer = ParquetWriter::create(path, described, &options)?;
    for from in (0..columns[0].len()).step_by(65_536) {
        let to = (from + 65_536).min(columns[0].len());
        let stamps: Vec<i64> = (from..to).map(|row| (row as f64 * STEP * 1e9).round() as i64).collect();
        let mut all = vec![Values::Integer(&stamps)];
        all.extend(columns.iter().map(|column| Values::Float(&column[from..to])));
        writer.write(&all)?;
    }
    writer.finish()?;
    Ok(())
}

fn in_memory(case: &Case, columns: Vec<Vec<f64>>) -> MemorySource {
    let mut source = MemorySource::new(names(case.states).into_iter().map(Column::float).collect());
    source.push_uniform(case.name, STEP, columns);
    source
}

fn main() -> Result<()> {
    let rate = fma_rate();
    let small = Case {
        name: "Lorenz, degree 5",
        states: 3,
        rows: 1_000_000,
        degree: 5,
        threshold: 0.1,
        repeats: 15,
        noise: 8e-4,
        slope: lorenz,
    };
    println!("{}: {} rows x {} states, 56 columns", small.name, small.rows, small.states);
    let columns = trajectory(&small);
    let source = in_memory(&small, columns.clone());
    let (seconds, fitted) = timed(&small, &source, rate)?;
    let memory = peak_rss_mib();
    println!("  true supports; coefficients to {:.1e}", check_truth(&small, &fitted.coefficients, lorenz_truth)?);
    beside_pysindy(&small, &columns, seconds, memory, &fitted.coefficients)?;
    drop((columns, source));

    let exact = Case { name: "Lorenz, degree 5, without noise", noise: 0.0, repeats: 5, ..small };
    println!("{}: {} rows x {} states", exact.name, exact.rows, exact.states);
    let (_, fitted) = timed(&exact, &in_memory(&exact, trajectory(&exact)), rate)?;
    println!("  true supports; coefficients to {:.1e}", check_truth(&exact, &fitted.coefficients, lorenz_truth)?);

    let long = Case { name: "Lorenz, degree 5, Parquet", rows: 10_000_000, repeats: 4, ..small };
    println!("{}: {} rows x {} states", long.name, long.rows, long.states);
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("lorenz.parquet");
    write(&path, &trajectory(&long))?;
    let (opened, source) = best_of(1, || open(&[&path], &Selection::new(names(long.states))));
    println!("  file of {:.2} GB, opened in {opened:.3} s", 1e-9 * std::fs::metadata(&path)?.len() as f64);
    let (_, fitted) = timed(&long, &source?, rate)?;
    println!("  true supports; coefficients to {:.1e}", check_truth(&long, &fitted.coefficients, lorenz_truth)?);

    let wide = Case {
        name: "Lorenz 1996, degree 3",
        states: 16,
        rows: 1_000_000,
        degree: 3,
        threshold: 0.3,
        repeats: 2,
        noise: 4e-4,
        slope: lorenz_96,
    };
    println!("{}: {} rows x {} states, 969 columns", wide.name, wide.rows, wide.states);
    let features = 8e-9 * 969.0 * wide.rows as f64;
    println!("  one copy of the matrix of features is {features:.2} GB; pysindy keeps several: it is not run");
    let source = in_memory(&wide, trajectory(&wide));
    let (_, fitted) = timed(&wide, &source, rate)?;
    let truth = |state: usize| lorenz_96_truth(state, wide.states);
    println!("  true supports; coefficients to {:.1e}", check_truth(&wide, &fitted.coefficients, truth)?);
    Ok(())
}
