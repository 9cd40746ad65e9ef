//! Cubic smoothing splines beside scipy's `make_smoothing_spline`: 100,000 rows at a given penalty, and the penalty chosen by generalised cross-validation.
//!
//! Irregular stamps, a motion with noise. One core. Values and slopes at all stamps are compared at the same penalty, values at the two chosen ones.
//!
//! Limits. The filter of a cubic spline takes some 45 operations a row, each row after the one before. A division and
//! ten dependent sums and products, about 45 cycles, are the least that a row takes on the way out. The way back takes
//! some 120, of which 70 depend on no other row and go by the register; 150 bytes a row are read and written. A score
//! of cross-validation takes some 86 operations a row, of registers that hold a number of eight penalties: 24 penalties
//! of a grid and 8 a round after it, one to three rounds. The table has the ratio of the time to that of so many
//! operations at the rate of a core's registers; likelihood takes about 30.
//!
//! Bias: ours hands out standard deviations of values and slopes with them, which the peer does not compute. The peer's cross-validation takes minutes at 100,000 rows and is timed at 20,000, ours at both.
//! The peer bounds its search by its own tolerance; the scores are flat there, and penalties may differ by percents.

use std::{error::Error, path::Path};

use fleetfoot_benches::{best_of, cpu_of, fma_rate, peak_rss_mib, peer, read_f64, write_f64};
use fleetfoot_data::with_threads;
use fleetfoot_signal::{Lambda, Smoothed, Spline, smooth};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const REPEATS: usize = 3;
const ROWS: usize = 100_000;
const FEWER: usize = 20_000;
const LAMBDA: f64 = 100.0;

struct Record {
    times: Vec<f64>,
    values: Vec<f64>,
}

fn record(rows: usize) -> Record {
    let mut random = Pcg64::seed_from_u64(1);
    let times: Vec<f64> = (0..rows).map(|row| row as f64 + 0.8 * random.random::<f64>()).collect();
    // The sum of twelve uniform numbers is normal enough.
    let mut noise = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
    let values = times.iter().map(|t| (0.05 * t).sin() + 0.4 * (0.013 * t).cos() + 0.1 * noise()).collect();
    Record { times, values }
}

/// Seconds by the clock and of the processor.
fn timed(record: &Record, spline: Spline, lambda: Lambda) -> Result<([f64; 2], Smoothed), Box<dyn Error>> {
    let run = || smooth(&record.times, &record.values, None, spline, lambda);
    let ((seconds, smoothed), processor) = with_threads(1, || (best_of(REPEATS, run), cpu_of(run)));
    Ok(([seconds, processor], smoothed?))
}

/// The peer's version, its seconds by the clock and of the processor, and its values with slopes.
fn theirs(record: &Record, lambda: Option<f64>, folder: &Path) -> Result<(String, [f64; 2], Vec<f64>), String> {
    let write = |name: &str, values: &[f64]| write_f64(&folder.join(name), values).map_err(|error| error.to_string());
    write("times.f64", &record.times)?;
    write("values.f64", &record.values)?;
    let asked = lambda.map_or_else(|| "gcv".to_owned(), |lambda| lambda.to_string());
    let answer = peer("smoothing.py", &[folder, Path::new(&asked)])?;
    let seconds = ["seconds", "processor"].map(|of| answer[of].as_f64().unwrap_or(f64::NAN));
    let fitted = read_f64(&folder.join("found.f64")).map_err(|error| error.to_string())?;
    Ok((answer["version"].as_str().unwrap_or_default().to_owned(), seconds, fitted))
}

/// The greatest difference over the greatest value.
fn apart(ours: &[f64], other: &[f64]) -> f64 {
    let size = other.iter().fold(f64::MIN_POSITIVE, |most, x| most.max(x.abs()));
    ours.iter().zip(other).map(|(a, b)| (a - b).abs() / size).fold(0.0, f64::max)
}

/// A line of a task's time, and its ratio to that of so many operations at the rate of a core's registers.
fn print_speed(name: &str, [seconds, processor]: [f64; 2], rows: usize, operations: usize) {
    let limit = fma_rate().map_or(f64::NAN, |rate| processor * rate / (operations * rows) as f64);
    println!(
        "{name:<24} {seconds:>8.4} s, {processor:>8.4} s of the processor: {:.0} ns a row, {limit:.1} times its operations",
        1e9 * processor / rows as f64
    );
}

fn beside(name: &str, [seconds, processor]: [f64; 2], reference: [f64; 2], apart: f64) {
    println!(
        "{name:<24} {seconds:>8.4} s, {processor:>8.4} s of the processor: {:.0} times ours, {:.0} by the clock; {apart:.1e} apart",
        processor / reference[1],
        seconds / reference[0]
    );
}

fn fixed_penalty(record: &Record, folder: &Path) -> Result<(), Box<dyn Error>> {
    let (seconds, cubic) = timed(record, Spline::Cubic, Lambda::Given(LAMBDA))?;
    println!("\nlambda given, {ROWS} rows: values and slopes; ours with their deviations");
    print_speed("fleetfoot cubic", seconds, ROWS, 165);
    let (quintic, _) = timed(record, Spline::Quintic, Lambda::Given(LAMBDA))?;
    print_speed("fleetfoot quintic", quintic, ROWS, 600);
    match theirs(record, Some(LAMBDA), folder) {
        Err(reason) => println!("scipy              absent: {reason}"),
        Ok((version, theirs, solution)) => {
            let (values, slopes) = solution.split_at(ROWS);
            let apart = apart(&cubic.derivatives[0], values).max(apart(&cubic.derivatives[1], slopes));
            beside(&format!("scipy {version}"), theirs, seconds, apart);
            if apart > 1e-8 {
                return Err("the spline is not that of scipy".into());
            }
        }
    }
    Ok(())
}

fn chosen(all: &Record, fewer: &Record, folder: &Path) -> Result<(), Box<dyn Error>> {
    println!("\nlambda chosen");
    // Twenty-four penalties of a grid and eight of each of two rounds.
    for (rule, lambda, operations) in [("likelihood", Lambda::Likelihood, 40 * 30), ("gcv", Lambda::Gcv, 40 * 86)] {
        let (seconds, smoothed) = timed(all, Spline::Cubic, lambda)?;
        println!("{ROWS} rows, {rule}: noise {:.5}, 0.1 is true", smoothed.noise);
        print_speed(&format!("fleetfoot {rule}"), seconds, ROWS, operations);
    }
    let (seconds, smoothed) = timed(fewer, Spline::Cubic, Lambda::Gcv)?;
    println!("{FEWER} rows");
    print_speed("fleetfoot gcv", seconds, FEWER, 40 * 86);
    match theirs(fewer, None, folder) {
        Err(reason) => println!("scipy                 absent: {reason}"),
        Ok((version, theirs, solution)) => {
            let apart = apart(&smoothed.derivatives[0], &solution[..FEWER]);
            beside(&format!("scipy {version} gcv"), theirs, seconds, apart);
        }
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("cubic smoothing splines; seconds, best of {REPEATS}, one core");
    let folder = tempfile::tempdir()?;
    let (all, fewer) = (record(ROWS), record(FEWER));
    fixed_penalty(&all, folder.path())?;
    chosen(&all, &fewer, folder.path())?;
    println!("\npeak memory {:.0} MiB", peak_rss_mib());
    Ok(())
}
