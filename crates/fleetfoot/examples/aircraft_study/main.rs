//! The aircraft study: structure, parameters and hidden forces of a fleet from millions of rows of climbs (block-sparse bolasso paper, sections 8 and 9).
//!
//! ```text
//! cargo run --release -p fleetfoot --example aircraft_study -- -o study
//! ```
//!
//! 25 aircraft of one type, each with its own thrust, drag, lift and specific impulse (1 to 2 % apart), fly some thousands of simulated climbs. Nothing but
//! motion, mass and mass flow is given to the regression, with errors: accelerations that the equations do not explain, and a noisy mass flow. For
//! every aircraft alone, 45 candidate functions are scanned once; lambda is chosen on held-out flights; the bolasso selects (Figure 2). For the first
//! aircraft, flights are left out (Figure 3), and the prior's strength is varied (Figure 5). Tables go to stdout, all numbers to Parquet.

pub(crate) mod confounding;
pub(crate) mod equations;
pub(crate) mod errors;
pub(crate) mod fleet;
pub(crate) mod hidden;
pub(crate) mod latents;
pub(crate) mod nonlinear;
pub(crate) mod report;
pub(crate) mod selection;
pub(crate) mod tables;

use std::{path::PathBuf, time::Instant};

use clap::{Parser, ValueEnum};
use fleetfoot::Source;

/// Whatever goes wrong ends the study.
pub(crate) type Failure = Box<dyn std::error::Error + Send + Sync>;

/// What is resampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Resample {
    /// Rows, as in the paper.
    Rows,
    /// Whole flights.
    Flights,
}

/// The aircraft study.
#[derive(Debug, Parser)]
pub(crate) struct Arguments {
    /// Folder for the tables.
    #[arg(short, long, default_value = "aircraft-study")]
    pub(crate) output: PathBuf,
    /// Aircraft of the fleet.
    #[arg(long, default_value_t = 25)]
    pub(crate) aircraft: u32,
    /// Flights of each.
    #[arg(long, default_value_t = 387)]
    pub(crate) flights: u32,
    /// Bootstrap replicates.
    #[arg(long, default_value_t = 128)]
    pub(crate) replicates: usize,
    /// What is resampled.
    #[arg(long, value_enum, default_value = "rows")]
    pub(crate) resample: Resample,
    /// Share of the replicates that must select a function.
    #[arg(long, default_value_t = 1.0)]
    pub(crate) threshold: f64,
    /// Random thirds of the flights that are held out to choose lambda.
    #[arg(long, default_value_t = 30)]
    pub(crate) splits: usize,
    /// Take the largest lambda within one standard error of the best.
    #[arg(long)]
    pub(crate) one_standard_error: bool,
    /// Strength of the prior of the specific impulse.
    #[arg(long, default_value_t = 1000.0)]
    pub(crate) lambda_t: f64,
    /// Unexplained accelerations, m/s^2.
    #[arg(long, default_value_t = 0.02)]
    pub(crate) turbulence: f64,
    /// Relative error of the mass flow.
    #[arg(long, default_value_t = 0.03)]
    pub(crate) fuel_noise: f64,
    /// Flights of the first aircraft that nonlinear least squares is fitted without.
    #[arg(long, default_value_t = 20)]
    pub(crate) nonlinear: usize,
    /// Seed of resampling, splits and errors.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
}

fn main() -> Result<(), Failure> {
    let arguments = Arguments::parse();
    std::fs::create_dir_all(&arguments.output)?;
    let noise = fleet::Noise { turbulence: arguments.turbulence, fuel: arguments.fuel_noise, seed: arguments.seed };
    let mut times = report::Times::default();
    let mut fleet = Vec::new();
    for number in 0..arguments.aircraft {
        let airplane = fleet::airplane(number, noise)?;
        let began = Instant::now();
        let source = fleet::flights(&airplane, arguments.flights, noise)?;
        times.flights += began.elapsed();
        let began = Instant::now();
        let scan = selection::Scan::new(&source)?;
        times.scan += began.elapsed();
        let began = Instant::now();
        let aircraft = selection::select(&airplane, &source, &scan, &arguments)?;
        times.select += began.elapsed();
        eprintln!("{}", report::line(&aircraft));
        if number == 0 {
            let left = errors::leave_one_out(&source, &scan, &aircraft, arguments.lambda_t, arguments.nonlinear)?;
            tables::errors(&arguments.output.join("figure3.parquet"), &left)?;
            report::errors(&left);
            let shown = source.episodes().len() / 2;
            let estimates = hidden::estimate(&source, &scan, &[0.0, 10.0, 100.0, 1000.0], shown, &arguments)?;
            tables::latents(&arguments.output.join("figure5.parquet"), &source, shown, &estimates)?;
            report::hidden(&estimates);
        }
        fleet.push(aircraft);
    }
    tables::frequencies(&arguments.output.join("figure2.parquet"), &fleet)?;
    report::frequencies(&fleet);
    report::times(&fleet, &times);
    Ok(())
}
