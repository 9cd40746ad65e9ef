//! Logs to fit on and logs to score on.

use std::path::{Path, PathBuf};

use fleetfoot_control::controller::DifferentialDrive;
use fleetfoot_data::Progress;
use fleetfoot_fit::Error;
use fleetfoot_sim::HexapodTreadmill;

use crate::{Generated, Job, World, generate};

/// Runs to fit on, and as many to score on: one at each speed of the belt, 0.05 m/s apart. Fewer than the folds of cross-validation, so that these cut
/// every run into spans: a gait that exists at one speed only is not held out as a whole.
const RUNS: u64 = 9;
/// Share of the time that is for scoring.
const HELD_OUT: f64 = 0.2;
/// Rows of a run that is used, at least.
const LEAST_ROWS: u64 = 500;
/// Speeds of the belt, m/s (III-A).
const SPEEDS: (f64, f64) = (0.1, 0.5);

/// Generated logs.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct DemoLogs {
    /// Logs to fit on.
    pub training: Generated,
    /// Logs to score on: other runs of the same robot at the same speeds.
    pub held_out: Generated,
    /// Seconds of a run to fit on, and of one to score on.
    pub seconds: (f64, f64),
    /// Seed of all runs.
    pub seed: u64,
    /// Drive model of the robot's program (equation (2)).
    pub drive: DifferentialDrive,
}

impl DemoLogs {
    /// The files to fit on: those of the runs that lasted.
    pub fn training_files(&self) -> Vec<PathBuf> {
        lasted(&self.training)
    }

    /// The files to score on, of the runs that lasted.
    pub fn held_out_files(&self) -> Vec<PathBuf> {
        lasted(&self.held_out)
    }

    /// Arguments of `fleetfoot generate` for the training logs or the held-out ones, without the folder.
    pub fn arguments(&self, held_out: bool) -> String {
        let (seconds, (low, high)) = (if held_out { self.seconds.1 } else { self.seconds.0 }, SPEEDS);
        let first = if held_out { format!(" --first-run {RUNS}") } else { String::new() };
        format!("hexapod --seed {} --runs {RUNS} --seconds {seconds} --speed {low}:{high}{first}", self.seed)
    }
}

/// Runs with rows. A run that ends at once, the robot beside its belt, gives a log without rows, which is no recording.
fn lasted(generated: &Generated) -> Vec<PathBuf> {
    generated.runs.iter().filter(|run| run.rows >= LEAST_ROWS).map(|run| run.file.clone()).collect()
}

/// Simulates `minutes` of a hexapod on a treadmill in all, runs of one length: those to fit on into `folder/train`, the others into `folder/test`. Logs
/// of an earlier demonstration there are replaced.
///
/// # Errors
/// Minutes that are not positive or too few, and those of [`generate`].
pub fn generate_logs(folder: &Path, seed: u64, minutes: f64, progress: &dyn Progress) -> Result<DemoLogs, Error> {
    let world = World::of("hexapod")?;
    let parameters: HexapodTreadmill = toml::from_str(&world.to_toml()).map_err(|error| {
        fleetfoot_recipe::Error::Recipe { name: "world of hexapod".into(), problem: error.to_string() }
    })?;
    // Whole milliseconds: no digits that nobody needs in the commands that repeat it.
    let each = |share: f64| (share * minutes * 60_000.0 / RUNS as f64).round() / 1000.0;
    let seconds = (each(1.0 - HELD_OUT), each(HELD_OUT));
    let job = |name: &str, first_run: u64, seconds: f64| {
        let mut job = Job::new(world.clone(), folder.join(name));
        (job.runs, job.first_run, job.seconds, job.seed) = (RUNS, first_run, seconds, seed);
        job.speed = Some(SPEEDS);
        job.force = true;
        job
    };
    let (training, held_out) =
        (generate(&job("train", 0, seconds.0), progress)?, generate(&job("test", RUNS, seconds.1), progress)?);
    let logs = DemoLogs { training, held_out, seconds, seed, drive: parameters.drive() };
    if logs.training_files().len() < 2 || logs.held_out_files().is_empty() {
        return Err(Error::undetermined(format!(
            "runs of {} and {} s are too short, or the robot left its belt in nearly all of them: give more minutes",
            seconds.0, seconds.1
        )));
    }
    Ok(logs)
}
