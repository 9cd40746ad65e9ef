//! Logs of simulated robots: runs in parallel, a file each, and the recipe for them.
//!
//! A [`World`] has every physical parameter of a robot; a [`Job`] has the number of its runs, their length and their
//! folder. The same world, seed and length give the same bytes on any number of threads, and a run does not depend on
//! how many others there are.

pub mod demo;
mod excitation_report;
mod mcap_sink;
mod names;
mod parquet_sink;
mod plan;
mod recipes;
mod recorder;
mod robot;
mod robots;
mod seeds;
#[cfg(test)]
mod tests;
mod world;
mod world_file;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

pub use excitation_report::Excitation;
use excitation_report::{Gathered, Terms};
use fleetfoot_data::{Column, Progress, parallel_map};
use fleetfoot_dataset::folder::{Folder, RECIPE};
use fleetfoot_fit::Error;
use fleetfoot_log::path_in_words;
use fleetfoot_recipe::starter_recipe;
use fleetfoot_sim::{End, Run, Scenario};
use names::{is_run, run_name};
pub use plan::{Plan, PlannedColumn, PlannedTopic, plan};
use recorder::{Output, Recorder, Seconds};
pub use seeds::run_seed;
use serde::{Serialize, Serializer};
use world::{SCENARIO, WORLD};
pub use world::{World, robots};

/// Format of logs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Messages of the sensors, as ROS 2 messages, with the truth on separate topics.
    Mcap,
    /// Rows of truth.
    Parquet,
}

impl Format {
    fn extension(self) -> &'static str {
        match self {
            Self::Mcap => "mcap",
            Self::Parquet => "parquet",
        }
    }
}

/// A job: the logs to generate.
#[derive(Debug, Clone)]
pub struct Job {
    /// The robot and its parameters.
    pub world: World,
    /// Number of runs.
    pub runs: u64,
    /// The number of the first run, which with the seed decides its random numbers.
    pub first_run: u64,
    /// The length of a run, s of simulated time.
    pub seconds: f64,
    /// Seed of the random numbers of all runs.
    pub seed: u64,
    /// The first and the last run's value of [`World::speed_parameter`], spread evenly over the runs; the world's where `None`.
    pub speed: Option<(f64, f64)>,
    /// Format of logs.
    pub format: Format,
    /// True to write the truth as messages too, on topics that begin with `/truth`.
    pub truth: bool,
    /// The folder of the logs.
    pub folder: PathBuf,
    /// Replace the runs of an earlier command in the folder.
    pub force: bool,
    /// Files that the job was made from, which are not replaced.
    pub inputs: Vec<PathBuf>,
}

impl Job {
    /// One run, of a length and in a format that suit the robot.
    pub fn new(world: World, folder: impl Into<PathBuf>) -> Self {
        let format = if world.robot.tables() { Format::Parquet } else { Format::Mcap };
        let seconds = world.robot.seconds();
        Self {
            world,
            runs: 1,
            first_run: 0,
            seconds,
            seed: 1,
            speed: None,
            format,
            truth: true,
            folder: folder.into(),
            force: false,
            inputs: Vec::new(),
        }
    }

    /// Refuses a job that cannot be done.
    fn check(&self) -> Result<(), Error> {
        let refuse = |problem: String| Err(Error::value(problem));
        if self.runs == 0 || self.runs > 1_000_000 {
            return refuse(format!("{} runs: write 1 to 1000000", self.runs));
        }
        if self.first_run.checked_add(self.runs).is_none() {
            return refuse(format!("the first run {}: there are no {} runs after it", self.first_run, self.runs));
        }
        if !(self.seconds > 0.0 && self.seconds <= 1e7) {
            return refuse(format!("runs of {} s: write seconds above 0, at most 1e7", self.seconds));
        }
        if self.format == Format::Parquet && !self.truth {
            return refuse(
                "a Parquet file holds only rows of truth, and they are left out: write MCAP, or keep the truth".into(),
            );
        }
        if self.speed.is_some() && self.world.speed_parameter().is_none() {
            return refuse(format!("the world of `{}` has no speed that could be set", self.world.robot()));
        }
        Ok(())
    }

    /// The speed of a run, counted from the first one.
    fn speed_of(&self, index: u64) -> Option<f64> {
        let (first, last) = self.speed?;
        let share = if self.runs > 1 { index as f64 / (self.runs - 1) as f64 } else { 0.5 };
        // Exact at both ends.
        Some((1.0 - share) * first + share * last)
    }

    /// The world of a run, counted from the first one.
    fn world_of(&self, index: u64) -> Result<World, Error> {
        let mut world = self.world.clone();
        if let (Some(parameter), Some(speed)) = (world.speed_parameter(), self.speed_of(index)) {
            world.set(parameter, &toml::Value::from(speed).to_string())?;
        }
        Ok(world)
    }

    /// Checks that runs can be built, before any is simulated: the first and the last one have the extreme speeds.
    fn check_worlds(&self) -> Result<(), Error> {
        [0, self.runs - 1].into_iter().try_for_each(|index| self.world_of(index).map(drop))
    }

    /// The name of a run's file, counted from the first one.
    fn name_of(&self, index: u64) -> String {
        let last = self.first_run + self.runs;
        run_name(self.world.robot(), self.first_run + index, last, self.format.extension())
    }

    /// Metadata of a run's file: enough to make it again.
    fn metadata(&self, index: u64, world: &World) -> BTreeMap<String, String> {
        let pairs = [
            ("fleetfoot.version", env!("CARGO_PKG_VERSION").to_owned()),
            (SCENARIO, world.robot().to_owned()),
            ("fleetfoot.seed", self.seed.to_string()),
            ("fleetfoot.run", (self.first_run + index).to_string()),
            ("fleetfoot.seconds", self.seconds.to_string()),
            (WORLD, world.to_toml()),
        ];
        pairs.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    }

    /// The command that generates this, but for the world file.
    fn command(&self) -> String {
        let mut out = format!("fleetfoot generate {} --seed {}", self.world.robot(), self.seed);
        out += &format!(" --runs {} --seconds {}", self.runs, self.seconds);
        if self.first_run > 0 {
            out += &format!(" --first-run {}", self.first_run);
        }
        if let Some((first, last)) = self.speed {
            out += &if first == last { format!(" --speed {first}") } else { format!(" --speed {first}:{last}") };
        }
        out + &format!(" --format {}{}", self.format.extension(), if self.truth { "" } else { " --no-truth" })
    }
}

/// A run that was generated.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct RunReport {
    /// Its number.
    pub run: u64,
    /// Its file.
    #[serde(serialize_with = "path_in_words")]
    pub file: PathBuf,
    /// Its value of [`World::speed_parameter`], where the job sets it.
    pub speed: Option<f64>,
    /// Simulated time, s.
    pub seconds: f64,
    /// Rows of truth that the robot went through, whether or not the format keeps them.
    pub rows: u64,
    /// Messages in the file.
    pub messages: u64,
    /// The file's size.
    pub bytes: u64,
    /// End of the run.
    #[serde(flatten, serialize_with = "end")]
    pub end: End,
    /// Excitation of its rows.
    pub excitation: Excitation,
}

/// `end`: `complete`, `early` or `fault`; where it is one of the latter, `ended_at` (s) and the `reason`.
fn end<S: Serializer>(end: &End, to: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct EndReport<'a> {
        end: &'static str,
        ended_at: Option<f64>,
        reason: Option<&'a str>,
    }
    let (end, early) = match end {
        End::Early { seconds, reason } => ("early", Some((*seconds, reason.as_str()))),
        End::Fault { seconds, reason } => ("fault", Some((*seconds, reason.as_str()))),
        _ => ("complete", None),
    };
    EndReport { end, ended_at: early.map(|(at, _)| at), reason: early.map(|(_, reason)| reason) }.serialize(to)
}

/// Generated runs.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Generated {
    /// In the order of their numbers.
    pub runs: Vec<RunReport>,
    /// Excitation of the rows of all runs together.
    pub excitation: Excitation,
    /// The recipe for the logs.
    #[serde(serialize_with = "path_in_words")]
    pub recipe: PathBuf,
    /// Notes for the user about the folder.
    pub notes: Vec<String>,
}

/// Runs the robot and writes its logs, and a recipe for `fit` beside them.
///
/// No file is left when it fails or is cancelled. Progress is in simulated seconds.
///
/// # Errors
/// A job that cannot be done, a folder that holds other logs, and refusals of the system.
pub fn generate(job: &Job, progress: &dyn Progress) -> Result<Generated, Error> {
    job.check()?;
    job.check_worlds()?;
    let folder = Folder::create(&job.folder, job.force, &job.inputs, is_run)?;
    let scenario = job.world_of(0)?.scenario()?;
    let recipe = job.world.robot.recipe().recipe(job.format)?;
    let terms = Terms::new(&recipe, scenario.as_ref(), job.world.robot.spread());
    progress.stage("simulate");
    let seconds = Seconds::new(progress, job.seconds, job.runs);
    let done = parallel_map(job.runs as usize, &seconds.quiet(), |index| {
        generate_run(job, index as u64, &folder, &terms, &seconds)
    })?;
    let mut total = terms.nothing();
    done.iter().for_each(|(_, gathered)| total.merge(gathered));
    let excitation = terms.excitation(&total);
    let mut names: Vec<String> = (0..job.runs).map(|index| job.name_of(index)).collect();
    write_recipe(job, &scenario.columns(), &folder.staged(&names[0]), &folder.staged(RECIPE))?;
    names.push(RECIPE.to_owned());
    let (recipe, notes) = (folder.target(RECIPE), folder.notes());
    folder.commit(&names)?;
    Ok(Generated { runs: done.into_iter().map(|(report, _)| report).collect(), excitation, recipe, notes })
}

/// Simulates a run into its file.
fn generate_run(
    job: &Job,
    index: u64,
    folder: &Folder,
    terms: &Terms,
    seconds: &Seconds<'_>,
) -> Result<(RunReport, Gathered), Error> {
    let world = job.world_of(index)?;
    let scenario = world.scenario()?;
    let name = job.name_of(index);
    let path = folder.staged(&name);
    let output = Output::create(&path, job, job.metadata(index, &world), scenario.as_ref())?;
    let mut recorder = Recorder::new(output, terms, scenario.columns().len(), seconds.run());
    let run = Run { seconds: job.seconds, seed: run_seed(job.seed, job.first_run + index) };
    let end = record(scenario.as_ref(), run, &mut recorder)?;
    let (rows, messages, gathered) = recorder.finish()?;
    let size = std::fs::metadata(&path).map_err(|source| fleetfoot_dataset::Error::Write { path, source })?.len();
    let report = RunReport {
        run: job.first_run + index,
        file: folder.target(&name),
        speed: job.speed_of(index),
        seconds: match &end {
            End::Fault { seconds, .. } | End::Early { seconds, .. } => *seconds,
            _ => (rows as f64 * scenario.row_period()).min(job.seconds),
        },
        rows,
        messages,
        bytes: size,
        end,
        excitation: terms.excitation(&gathered),
    };
    Ok((report, gathered))
}

/// Runs a scenario; an error of its sink is turned back into one of this crate.
fn record(scenario: &dyn Scenario, run: Run, recorder: &mut Recorder<'_>) -> Result<End, Error> {
    scenario.run(run, recorder).map_err(|error| match error.downcast::<Error>() {
        Ok(error) => *error,
        Err(error) => match error.downcast::<fleetfoot_output::Error>() {
            Ok(error) => fleetfoot_dataset::Error::Output(*error).into(),
            Err(error) => Error::output(format!("the simulated log cannot be written: {error}")),
        },
    })
}

/// The recipe for the truth; where it is left out, one to be completed.
fn write_recipe(job: &Job, truth: &[Column], first: &Path, path: &Path) -> Result<(), Error> {
    let text = if job.truth {
        job.world.robot.recipe().text(job.format, &job.command(), truth)
    } else {
        starter_recipe(&fleetfoot_log::inspect(first)?)
    };
    Ok(fleetfoot_output::write_atomic(path, text.as_bytes())?)
}
