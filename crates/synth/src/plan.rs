//! Plan of a job, made by a short run that leaves no files.

use fleetfoot_data::{Progress, Silent};
use fleetfoot_dataset::folder::Folder;
use fleetfoot_fit::Error;
use fleetfoot_sim::Run;
use serde::Serialize;

use super::{
    Format, Job,
    excitation_report::Terms,
    mcap_sink::message_type,
    names::is_run,
    record,
    recorder::{Output, Recorder, Seconds, keeps},
    run_seed,
};

/// Rows of the short run, about.
const SAMPLE_ROWS: f64 = 4000.0;

/// Plan of a job.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Plan {
    /// Runs.
    pub runs: u64,
    /// Length of a run, s.
    pub seconds: f64,
    /// Rows of truth of all runs at most: a run may end early.
    pub rows: u64,
    /// Messages of all runs, about; none in Parquet.
    pub messages: u64,
    /// Bytes of all files, about: those of the short run, scaled by rows.
    pub bytes: u64,
    /// Topics of MCAP files.
    pub topics: Vec<PlannedTopic>,
    /// Columns of the rows of truth.
    pub columns: Vec<PlannedColumn>,
    /// Length of the short run that bytes and messages are estimated from, s.
    pub sampled_seconds: f64,
    /// Files of an earlier command that would be replaced.
    #[serde(rename = "replaced_files")]
    pub replaced: usize,
}

/// A topic that would be written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct PlannedTopic {
    /// Its name.
    pub name: String,
    /// The ROS 2 type of its messages.
    #[serde(rename = "type")]
    pub message_type: &'static str,
}

/// A column that would be written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct PlannedColumn {
    /// Its name.
    pub name: String,
    /// Its unit, where it has one.
    pub unit: Option<String>,
}

/// Plans [`super::generate`].
///
/// # Errors
/// Those that [`super::generate`] would begin with.
pub fn plan(job: &Job, progress: &dyn Progress) -> Result<Plan, Error> {
    job.check()?;
    job.check_worlds()?;
    let replaced = Folder::check(&job.folder, job.force, is_run)?.len();
    let world = job.world_of(0)?;
    let scenario = world.scenario()?;
    let recipe = job.world.robot.recipe().recipe(job.format)?;
    let columns = scenario.columns();
    let terms = Terms::new(&recipe, scenario.as_ref(), job.world.robot.spread());
    let seconds = (SAMPLE_ROWS * scenario.row_period()).min(job.seconds);
    progress.stage("sample");
    let temporary = tempfile::tempdir();
    let folder = temporary.map_err(|source| fleetfoot_dataset::Error::Write { path: std::env::temp_dir(), source })?;
    let path = folder.path().join("sample");
    let output = Output::create(&path, job, job.metadata(0, &world), scenario.as_ref())?;
    let telling = Seconds::new(&Silent, seconds, 1);
    let mut recorder = Recorder::new(output, &terms, columns.len(), telling.run());
    record(scenario.as_ref(), Run { seconds, seed: run_seed(job.seed, job.first_run) }, &mut recorder)?;
    let (rows, messages, _) = recorder.finish()?;
    let bytes = std::fs::metadata(&path).map_err(|source| fleetfoot_dataset::Error::Write { path, source })?.len();
    let planned = job.runs * (job.seconds / scenario.row_period()).round().max(1.0) as u64;
    // By rows, not by time: the short run may have ended early.
    let scaled = |count: u64| (count as f64 * planned as f64 / rows.max(1) as f64).round() as u64;
    let topics = scenario.topics().into_iter().filter(|topic| keeps(job, topic) && job.format == Format::Mcap);
    Ok(Plan {
        runs: job.runs,
        seconds: job.seconds,
        rows: planned,
        messages: scaled(messages),
        bytes: scaled(bytes),
        topics: topics
            .map(|topic| PlannedTopic { message_type: message_type(&topic.kind).unwrap_or_default(), name: topic.name })
            .collect(),
        columns: (columns.into_iter()).map(|column| PlannedColumn { name: column.name, unit: column.unit }).collect(),
        sampled_seconds: rows as f64 * scenario.row_period(),
        replaced,
    })
}
