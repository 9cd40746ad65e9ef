//! Arguments of simulated logs.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    /// Sensor readings as ROS 2 messages, and the truth.
    Mcap,
    /// Rows of truth.
    Parquet,
}

/// Speeds of the first and the last run: `A:B`, or one number for all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Speed(pub(crate) f64, pub(crate) f64);

impl std::str::FromStr for Speed {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (first, last) = text.split_once(':').unwrap_or((text, text));
        match (first.trim().parse::<f64>(), last.trim().parse::<f64>()) {
            (Ok(first), Ok(last)) if first.is_finite() && last.is_finite() => Ok(Self(first, last)),
            _ => Err("write a number, or two as 0.1:0.5".to_owned()),
        }
    }
}

/// A number above zero.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("write a number above 0".to_owned()),
    }
}

#[derive(Debug, Args)]
pub(crate) struct Generate {
    /// Robot to simulate.
    #[arg(value_name = "ROBOT", value_parser = clap::builder::PossibleValuesParser::new(fleetfoot::generate::robots()))]
    pub(crate) robot: String,
    /// Folder of the logs, which must hold no other recordings (no default).
    #[arg(short, long, value_name = "DIR", required_unless_present = "print_world")]
    pub(crate) output: Option<PathBuf>,
    /// Simulated minutes of all runs together, shared evenly (default: --seconds of each).
    #[arg(long, value_name = "MINUTES", value_parser = positive, conflicts_with = "seconds")]
    pub(crate) minutes: Option<f64>,
    /// Simulated seconds of each run, unless it ends earlier (default: depends on the robot).
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    pub(crate) seconds: Option<f64>,
    /// Number of runs; each is a file.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub(crate) runs: u64,
    /// Number of the first run; a run does not depend on the others.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true, value_parser = clap::value_parser!(u64).range(..1_000_000_000))]
    pub(crate) first_run: u64,
    /// Speed, m/s; with two (A:B) runs are spread evenly from A to B (default: depends on the robot).
    #[arg(long, value_name = "A:B", allow_hyphen_values = true)]
    pub(crate) speed: Option<Speed>,
    /// Seed of all random numbers.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Format of the logs (default: mcap; parquet for robots without messages).
    #[arg(long, value_enum)]
    pub(crate) format: Option<LogFormat>,
    /// TOML file of physical parameters, or a generated log, for the world that it was made in (default: the robot's
    /// own world).
    #[arg(long, value_name = "FILE")]
    pub(crate) world: Option<PathBuf>,
    /// Physical parameter to set: its path in the world file and a value; may be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Excitation of the robot, over ranges that suit it (default: the world's).
    #[arg(long, value_name = "KIND", value_parser = clap::builder::PossibleValuesParser::new(fleetfoot::sim::Excitation::KINDS))]
    pub(crate) excitation: Option<String>,
    /// Controller of `control lqr` that commands the robot (default: the robot's own controller).
    #[arg(long, value_name = "FILE")]
    pub(crate) controller: Option<PathBuf>,
    /// Print all physical parameters with their units as a world file, and stop.
    #[arg(long)]
    pub(crate) print_world: bool,
    /// Logs without the truth, as a real robot writes them.
    #[arg(long)]
    pub(crate) no_truth: bool,
    /// Replace the runs and the recipe of an earlier command in the folder.
    #[arg(long)]
    pub(crate) force: bool,
    /// Print the files that would be written, then stop.
    #[arg(long)]
    pub(crate) dry_run: bool,
}
