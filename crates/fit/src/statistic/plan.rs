//! Plan of a scan: data to read, statistics to keep.

use std::collections::HashSet;

use fleetfoot_data::{Progress, Source};
use fleetfoot_dataset::{
    ContentHash, Dataset, Error as DatasetError, Logs, ReadPlan, StatisticFile,
    content::hash_logs,
    open::{OpenedStructure, estimate_structure},
};
use fleetfoot_recipe::Recipe;
use fleetfoot_task::StructuredTask;
use serde::Serialize;

use super::{
    ScanOptions,
    equations::{self, accepts_equations},
    scan::{chunk_bytes, default_chunk},
};
use crate::{error::Error, radial};

/// Plan of a scan: data to read, statistics to keep.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ScanPlan {
    /// Data that its passes would read, without files that are in the statistic already.
    pub reading: ReadPlan,
    /// Files that are there already.
    pub skipped: usize,
    /// Names of the tasks.
    pub tasks: Vec<String>,
    /// The latents.
    pub latents: Vec<PlannedLatent>,
    /// Rows of a chunk, at most.
    pub chunk_rows: usize,
    /// Chunks; at least, where the episodes are not known.
    pub chunks: usize,
    /// Bytes of the sums for `fit sparse`, about; one pass makes them.
    pub bytes: usize,
    /// Bytes of the sums of equations beside them, about; 0 where a scan makes none.
    pub equation_bytes: usize,
    /// Passes that the equations take beside the first, at most: clusterings, and sums whose chunks are of another length.
    pub equation_passes: usize,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

/// A latent that would be summed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct PlannedLatent {
    /// Its name.
    pub name: String,
    /// Number of candidate functions.
    pub functions: usize,
}

/// Opens the files and plans a scan. Robots' logs are not decoded for it.
///
/// # Errors
/// Those of opening files and of resolving the recipe.
pub fn plan_scan(
    recipe: &Recipe,
    options: &ScanOptions,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<ScanPlan, Error> {
    let logs: Logs = logs.into();
    let logs = &logs.by(recipe)?.0;
    let chunk_rows = options.chunk_rows.map(usize::from);
    match plan_new(recipe, chunk_rows, logs, progress) {
        // A scan skips what is there twice; hashing all bytes to know it beforehand would take as long as reading them.
        Err(Error::Dataset(DatasetError::Log(fleetfoot_log::Error::Duplicate { .. }))) => {
            let new = unknown(HashSet::new(), logs, recipe, progress)?;
            let plan = plan_new(recipe, chunk_rows, &new, progress)?;
            Ok(ScanPlan { skipped: logs.len() - new.len(), ..plan })
        }
        plan => plan,
    }
}

/// [`plan_scan`] of a scan that extends this statistic: its files are left out, and its chunks are used.
///
/// # Errors
/// As [`plan_scan`]; a recipe that differs from that of the statistic.
pub fn plan_append(
    file: &StatisticFile,
    recipe: &Recipe,
    options: &ScanOptions,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<ScanPlan, Error> {
    let logs: Logs = logs.into();
    let logs = &logs.by(recipe)?.0;
    let (expanded, fields, task) = Dataset::structure(recipe, logs)?;
    file.accepts_chunks(&task, options.chunk_rows.map(Into::into), "the statistic", "the recipe")?;
    accepts_equations(file, &expanded, &fields, ["the statistic", "the recipe"])?;
    let new = unknown(file.files.iter().map(|known| known.hash).collect(), logs, recipe, progress)?;
    let plan = match new.is_empty() {
        true => ScanPlan::new(&task, ReadPlan::default(), file.plan.chunk_rows, 0),
        false => plan_new(recipe, Some(file.plan.chunk_rows), &new, progress)?,
    };
    Ok(ScanPlan { skipped: logs.len() - new.len(), ..plan })
}

/// The logs whose content is not known, each content once.
fn unknown(
    mut known: HashSet<ContentHash>,
    logs: &Logs,
    recipe: &Recipe,
    progress: &dyn Progress,
) -> Result<Logs, Error> {
    let new = hash_logs(logs, recipe, progress)?.into_iter().filter(|file| known.insert(file.hash));
    Ok(new.map(|file| file.log).collect::<Vec<_>>().into())
}

fn plan_new(
    recipe: &Recipe,
    chunk_rows: Option<usize>,
    logs: &Logs,
    progress: &dyn Progress,
) -> Result<ScanPlan, Error> {
    radial::refuse(recipe, "scan")?;
    let chunk = |task: &StructuredTask, rows| chunk_rows.unwrap_or_else(|| default_chunk(task, rows));
    if let Some((task, columns, cost)) = estimate_structure(recipe, logs, progress)? {
        let reading = ReadPlan::of_messages(logs, columns, &cost);
        let chunk_rows = chunk(&task, reading.rows);
        let chunks = reading.rows.div_ceil(chunk_rows).max(logs.len());
        let (recipe, fields, _) = Dataset::structure(recipe, logs)?;
        let (equation_passes, equation_bytes) = equations::cost(&recipe, &fields, reading.rows);
        let plan = ScanPlan::new(&task, reading, chunk_rows, chunks);
        return Ok(ScanPlan { equation_bytes, equation_passes, ..plan });
    }
    let OpenedStructure { dataset, task, recipe, fields, .. } = Dataset::for_scan(recipe, logs, true, progress)?;
    let view = dataset.view()?;
    let chunk_rows = chunk(&task, view.rows());
    let chunks = view.episodes().iter().map(|episode| episode.rows.div_ceil(chunk_rows)).sum();
    let (equation_passes, equation_bytes) = equations::cost(&recipe, &fields, view.rows());
    Ok(ScanPlan {
        notes: dataset.notes().to_vec(),
        equation_bytes,
        equation_passes,
        ..ScanPlan::new(&task, ReadPlan::of_tables(logs, &dataset), chunk_rows, chunks)
    })
}

impl ScanPlan {
    fn new(task: &StructuredTask, reading: ReadPlan, chunk_rows: usize, chunks: usize) -> Self {
        let regression = &task.regression;
        Self {
            reading,
            skipped: 0,
            tasks: regression.tasks.iter().map(|task| task.name.clone()).collect(),
            latents: (regression.latents.iter())
                .map(|latent| PlannedLatent { name: latent.name.clone(), functions: latent.functions.len() })
                .collect(),
            chunk_rows,
            chunks,
            bytes: chunks.saturating_mul(chunk_bytes(task)),
            equation_bytes: 0,
            equation_passes: 0,
            notes: Vec::new(),
        }
    }
}
