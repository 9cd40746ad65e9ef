//! Cubic smoothing splines beside scipy's `make_smoothing_spline`: 100,000 rows at a given penalty, and the penalty chosen by generalised cross-validation.
//!
//! Irregular stamps, a motion with noise. One core. Values and slopes at all stamps are compared at the same penalty, values at the two chosen ones.
//!
//! Bias: ours hands out standard deviations of values and slopes with them, which the peer does not compute. The peer's cross-validation takes minutes at 100,000 rows and is timed at 20,000, ours at both.
//! The peer bounds its search by its own tolerance; the scores are flat there, and penalties may differ by percents.

use std::{error::Error, path::Path};

use fleetfoot_benches::{best_of, peak_rss_mib, peer, read_f64, write_f64};
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

fn timed(record: &Record, spline: Spline, lambda: Lambda) -> Result<(f64, Smoothed), Box<dyn Error>> {
    let run = || smooth(&record.times, &record.values, None, spline, lambda);
    let (seconds, smoothed) = with_threads(1, || best_of(REPEATS, run));
    Ok((seconds, smoothed?))
}

/// The peer's version, its seconds, and its values with slopes.
fn theirs(record: &Record, lambda: Option<f64>, folder: &Path) -> Result<(String, f64, Vec<f64>), String> {
    let write = |name: &str, values: &[f64]| write_f64(&folder.join(name), values).map_err(|error| error.to_string());
    write("times.f64", &record.times)?;
    write("values.f64", &record.values)?;
    let asked = lambda.map_or_else(|| "gcv".to_owned(), |lambda| lambda.to_string());
    let answer = peer("smoothing.py", &[folder, Path::new(&asked)])?;
    let seconds = answer["seconds"].as_f64().unwrap_or(f64::NAN);
    let found = read_f64(&folder.join("found.f64")).map_err(|error| error.to_string())?;
    Ok((answer["version"].as_str().unwrap_or_default().to_owned(), seconds, found))
}

/// The greatest difference over the greatest value.
fn apart(own: &[f64], other: &[f64]) -> f64 {
    let size = other.iter().fold(f64::MIN_POSITIVE, |most, x| most.max(x.abs()));
    own.iter().zip(other).map(|(a, b)| (a - b).abs() / size).fold(0.0, f64::max)
}

fn given(record: &Record, folder: &Path) -> Result<(), Box<dyn Error>> {
    let (seconds, own) = timed(record, Spline::Cubic, Lambda::Given(LAMBDA))?;
    println!("\nlambda given, {ROWS} rows: values and slopes; ours with their deviations");
    println!("fleetfoot cubic    {seconds:>9.4} s  {:>6.0} ns a row", 1e9 * seconds / ROWS as f64);
    let (quintic, _) = timed(record, Spline::Quintic, Lambda::Given(LAMBDA))?;
    println!("fleetfoot quintic  {quintic:>9.4} s  {:>6.0} ns a row", 1e9 * quintic / ROWS as f64);
    match theirs(record, Some(LAMBDA), folder) {
        Err(reason) => println!("scipy              absent: {reason}"),
        Ok((version, theirs, found)) => {
            let (values, slopes) = found.split_at(ROWS);
            let apart = apart(&own.derivatives[0], values).max(apart(&own.derivatives[1], slopes));
            println!("scipy {version:<12} {theirs:>9.4} s  {:.0} times ours, {apart:.1e} apart", theirs / seconds);
            if apart > 1e-8 {
                return Err("the spline is not that of scipy".into());
            }
        }
    }
    Ok(())
}

fn chosen(all: &Record, fewer: &Record, folder: &Path) -> Result<(), Box<dyn Error>> {
    println!("\nlambda chosen");
    for (rule, lambda) in [("likelihood", Lambda::Likelihood), ("gcv", Lambda::Gcv)] {
        let (seconds, own) = timed(all, Spline::Cubic, lambda)?;
        println!("fleetfoot {rule:<11} {ROWS:>7} rows {seconds:>9.4} s  noise {:.5}, 0.1 is true", own.noise);
    }
    let (seconds, own) = timed(fewer, Spline::Cubic, Lambda::Gcv)?;
    println!("fleetfoot gcv         {FEWER:>7} rows {seconds:>9.4} s");
    match theirs(fewer, None, folder) {
        Err(reason) => println!("scipy                 absent: {reason}"),
        Ok((version, theirs, found)) => {
            let apart = apart(&own.derivatives[0], &found[..FEWER]);
            println!(
                "scipy {version} gcv    {FEWER:>7} rows {theirs:>9.4} s  {:.0} times ours, {apart:.1e} apart",
                theirs / seconds
            );
        }
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("cubic smoothing splines; seconds, best of {REPEATS}, one core");
    let folder = tempfile::tempdir()?;
    let (all, fewer) = (record(ROWS), record(FEWER));
    given(&all, folder.path())?;
    chosen(&all, &fewer, folder.path())?;
    println!("\npeak memory {:.0} MiB", peak_rss_mib());
    Ok(())
}
