//! Equations from recordings, beside pysindy: canonical systems whose equations are known, and a quadrotor in wind.
//!
//! ```text
//! cargo run --release -p fleetfoot --example sindy_study -- systems
//! cargo run --release -p fleetfoot --example sindy_study -- neural-fly FOLDER
//! ```
//!
//! `systems` records six systems from ten starts each, as rows of states with their exact derivatives, and of states alone with 0, 0.1, 1 and 10 % of noise,
//! which both programs differentiate by central differences, without smoothing. Both find the equations among all monomials of the third degree (and
//! sines and cosines for the pendulum) from the same rows: pysindy by STLSQ at its own threshold, and at the best of 13, chosen by who knows the truth;
//! fleetfoot by the same STLSQ, by STLSQ at the thresholds that held-out episodes choose, and by an ensemble of STLSQ at pysindy's threshold.
//!
//! `neural-fly` needs the recordings of Neural-Fly (O'Connell et al., "Neural-Fly enables rapid learning for agile flight in strong winds", Science
//! Robotics 2022) as CSV files, and prints the errors of least squares and of STLSQ.
//!
//! `FLEETFOOT_PYTHON` names a Python that has pysindy; without it the peer's columns stay empty.

pub(crate) mod candidates;
pub(crate) mod comparison;
pub(crate) mod fit;
pub(crate) mod judge;
pub(crate) mod neural_fly;
pub(crate) mod peer;
pub(crate) mod recordings;
pub(crate) mod report;
pub(crate) mod systems;

use std::path::PathBuf;

use clap::{Parser, Subcommand};

/// Whatever goes wrong ends the study.
pub(crate) type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Equations from recordings, beside pysindy.
#[derive(Debug, Parser)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    study: Which,
}

#[derive(Debug, Subcommand)]
enum Which {
    /// Six systems whose equations are known.
    Systems {
        /// Seed of where the recordings begin and of the noise.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Repeat it with as many seeds, from the first; totals are over all of them.
        #[arg(long, default_value_t = 1)]
        seeds: u64,
    },
    /// Accelerations of a quadrotor in wind.
    NeuralFly {
        /// Folder with 35wind.csv, 70wind.csv, 70p20sint.csv and 100wind.csv.
        folder: PathBuf,
    },
}

fn main() -> Result<(), Failure> {
    match Arguments::parse().study {
        Which::Systems { seed, seeds } => {
            let studies = (seed..seed.saturating_add(seeds)).map(|seed| comparison::run(seed, &systems::SYSTEMS, true));
            let studies: Vec<comparison::Study> = studies.collect::<Result<_, _>>()?;
            studies.first().into_iter().for_each(report::systems);
            report::agreement(&studies);
            report::totals(&studies);
        }
        Which::NeuralFly { folder } => {
            let (rows, peer) = neural_fly::table(&folder)?;
            neural_fly::print(&rows, &peer);
        }
    }
    Ok(())
}
