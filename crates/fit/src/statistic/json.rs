//! JSON of a scan's plan, of its result, and of a statistic.

use std::collections::BTreeMap;

use fleetfoot_dataset::{ColumnRecord, EpisodeRecord, FileRecord, ReadPlan, Sizes, StatisticFile, json::value};
use fleetfoot_stats::scan::RowCounts;
use fleetfoot_sums::structured::Candidates;
use serde::{Serialize, Serializer};
use serde_json::Value;

use crate::statistic::{PlannedLatent, ScanOutcome, ScanPlan, TaskSummary, serves};

impl Serialize for ScanPlan {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Planned<'a> {
            #[serde(flatten)]
            reading: &'a ReadPlan,
            skipped: usize,
            tasks: &'a [String],
            latents: &'a [PlannedLatent],
            passes: usize,
            chunk_rows: usize,
            chunks: usize,
            bytes: usize,
        }
        Planned {
            reading: &self.reading,
            skipped: self.skipped,
            tasks: &self.tasks,
            latents: &self.latents,
            passes: 1 + self.equation_passes,
            chunk_rows: self.chunk_rows,
            chunks: self.chunks,
            bytes: self.bytes + self.equation_bytes,
        }
        .serialize(serializer)
    }
}

impl ScanOutcome {
    /// The scan and the file's content, for programs.
    pub fn to_json(&self) -> Value {
        let (file, report) = (&self.file, &self.report);
        value(Content {
            plan: file.plan_hash(),
            serves: serves(file),
            resumed: self.resumed,
            scanned: Scanned { files: report.files, episodes: report.episodes, rows: report.rows },
            skipped: &report.skipped,
            files: file.files.len(),
            episodes: file.episodes.len(),
            rows: file.scanned.counts().into(),
            chunks: file.chunks(),
            chunk_rows: file.plan.chunk_rows,
            bytes: self.sizes.total,
            bytes_before: self.before,
            notes: &report.notes,
        })
    }
}

#[derive(Serialize)]
struct Content<'a> {
    plan: String,
    serves: Vec<String>,
    resumed: bool,
    scanned: Scanned,
    skipped: &'a [String],
    files: usize,
    episodes: usize,
    rows: Rows,
    chunks: usize,
    chunk_rows: usize,
    bytes: u64,
    bytes_before: Option<u64>,
    notes: &'a [String],
}

/// Data read by one scan.
#[derive(Serialize)]
struct Scanned {
    files: usize,
    episodes: usize,
    rows: u64,
}

/// Rows of a scan: complete, at borders, incomplete.
#[derive(Serialize)]
struct Rows {
    complete: u64,
    at_border: u64,
    incomplete: u64,
}

impl From<RowCounts> for Rows {
    fn from(counts: RowCounts) -> Self {
        Self { complete: counts.complete, at_border: counts.at_border, incomplete: counts.incomplete }
    }
}

/// Content of the statistic, for programs: with the sizes that it was read by, and its tasks
/// ([`task_summaries`](StatisticFile::task_summaries)).
pub fn description(file: &StatisticFile, sizes: &Sizes, tasks: &[TaskSummary]) -> Value {
    let values = |values: BTreeMap<String, (usize, u64)>| {
        values.into_iter().map(|(value, (episodes, rows))| (value, Labelled { episodes, rows })).collect()
    };
    value(Held {
        plan: file.plan_hash(),
        version: &file.version,
        partial: file.is_partial(),
        serves: serves(file),
        rows: file.scanned.counts().into(),
        chunks: file.chunks(),
        chunk_rows: file.plan.chunk_rows,
        tasks,
        latents: file.plan.regression.latents.iter().map(Latent::from).collect(),
        columns: &file.columns,
        labels: file.by_label().into_iter().map(|(label, episodes)| (label, values(episodes))).collect(),
        files: file.files.iter().map(File::from).collect(),
        episodes: file.episodes.iter().map(|episode| Episode::new(episode, file)).collect(),
        bytes: sizes.total,
        sections: &sizes.sections,
        recipe: &file.recipe,
    })
}

#[derive(Serialize)]
struct Held<'a> {
    plan: String,
    version: &'a str,
    partial: bool,
    serves: Vec<String>,
    rows: Rows,
    chunks: usize,
    chunk_rows: usize,
    tasks: &'a [TaskSummary],
    latents: Vec<Latent<'a>>,
    columns: &'a [ColumnRecord],
    labels: BTreeMap<String, BTreeMap<String, Labelled>>,
    files: Vec<File<'a>>,
    episodes: Vec<Episode<'a>>,
    bytes: u64,
    sections: &'a [(String, u64)],
    recipe: &'a str,
}

/// Episodes and rows with one value of a label.
#[derive(Serialize)]
struct Labelled {
    episodes: usize,
    rows: u64,
}

/// A latent and its candidate functions.
#[derive(Serialize)]
struct Latent<'a> {
    name: &'a str,
    functions: Vec<String>,
}

impl<'a> From<&'a Candidates> for Latent<'a> {
    fn from(latent: &'a Candidates) -> Self {
        Self { name: &latent.name, functions: latent.functions.iter().map(ToString::to_string).collect() }
    }
}

#[derive(Serialize)]
struct File<'a> {
    name: &'a str,
    hash: String,
    bytes: u64,
}

impl<'a> From<&'a FileRecord> for File<'a> {
    fn from(file: &'a FileRecord) -> Self {
        Self { name: &file.name, hash: file.hash.to_string(), bytes: file.bytes }
    }
}

#[derive(Serialize)]
struct Episode<'a> {
    name: &'a str,
    id: String,
    file: String,
    labels: &'a BTreeMap<String, String>,
    rows: u64,
    complete: Option<u64>,
    period: f64,
}

impl<'a> Episode<'a> {
    fn new(episode: &'a EpisodeRecord, of: &StatisticFile) -> Self {
        Self {
            name: &episode.name,
            id: episode.id.to_string(),
            file: episode.file.to_string(),
            labels: &episode.labels,
            rows: episode.rows,
            complete: of.scanned.rows.get(&episode.id).map(|rows| rows.complete),
            period: episode.period,
        }
    }
}
