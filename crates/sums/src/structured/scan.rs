//! One pass over the rows: the statistics of every task, by episode and chunk.

use std::collections::BTreeMap;

use faer::{MatMut, MatRef};
use fleetfoot_data::{Cancelled, EpisodeId, Error, Progress, Source};
use fleetfoot_library::{Expr, UnknownColumn};
use fleetfoot_stats::{
    Chunk, Fold, Gram, Grid, Key, MergeError, PlanError, Preconditioner, Stats, plan_hash,
    scan::{Columns, RegionRanges, RowCounts, RowError, Tile, extremes, scan, widen},
};

use super::Regression;

/// Why a scan failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScanError {
    /// The source has no such column.
    #[error(transparent)]
    UnknownColumn(#[from] UnknownColumn),
    /// The source cannot be read.
    #[error(transparent)]
    Data(#[from] Error),
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Statistics that do not go together.
    #[error(transparent)]
    Merge(#[from] MergeError),
    /// A row that cannot be summed.
    #[error(transparent)]
    Row(#[from] RowError),
    /// Too many episodes.
    #[error(transparent)]
    Plan(#[from] PlanError),
}

/// A frozen plan: expressions to sum, their coordinates, and the chunks. Scans of one plan can be merged, whoever made
/// them.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The regression.
    pub regression: Regression,
    /// More columns whose moments are wanted (targets of equations, states).
    pub also: Vec<Expr>,
    /// Rows of a chunk, at most.
    pub chunk_rows: usize,
    /// Coordinates of every task.
    pub preconditioners: Vec<Preconditioner>,
}

/// The statistic of one task.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskStats {
    /// Its coordinates.
    pub preconditioner: Preconditioner,
    /// Gram matrices of the preconditioned columns and the target, by key.
    pub stats: Stats,
}

/// Result of a scan.
#[derive(Debug, Clone, PartialEq)]
pub struct Scanned {
    /// Statistics of every task.
    pub tasks: Vec<TaskStats>,
    /// Moments of [`Plan::also`], raw.
    pub also: Stats,
    /// Least and greatest value of every candidate function, latent by latent, in every episode.
    pub ranges: BTreeMap<EpisodeId, Vec<[f64; 2]>>,
    /// Rows of every episode. An episode without rows may be missing here.
    pub rows: BTreeMap<EpisodeId, RowCounts>,
}

/// The columns of a scan: every task's, the candidate functions, [`Plan::also`].
fn columns(regression: &Regression, also: &[Expr], source: &dyn Source) -> Result<Columns, ScanError> {
    let tasks: Vec<Vec<Expr>> = (0..regression.tasks.len()).map(|task| regression.columns(task)).collect();
    let functions: Vec<Expr> = regression.latents.iter().flat_map(|latent| latent.functions.iter().cloned()).collect();
    let groups: Vec<&[Expr]> = tasks.iter().map(Vec::as_slice).chain([functions.as_slice(), also]).collect();
    Ok(Columns::compile(&groups, regression.weight.as_ref(), source)?)
}

impl Plan {
    /// Makes a plan for a source: the coordinates come from a strided pilot sample of its rows.
    ///
    /// # Errors
    /// When a column does not exist, the source cannot be read, or there are too many episodes.
    pub fn new(
        regression: Regression,
        also: Vec<Expr>,
        chunk_rows: usize,
        source: &dyn Source,
    ) -> Result<Self, ScanError> {
        let columns = columns(&regression, &also, source)?;
        let tasks = regression.tasks.len();
        let numbers = |d: usize| (d + 1) * (d + 2) / 2;
        let bytes =
            8 * (0..tasks).chain([tasks + 1]).map(|group| numbers(columns.width(group..group + 1))).sum::<usize>();
        Grid::check(source.episodes(), 1, bytes)?;
        let pilot = columns.pilot::<ScanError>(0..tasks, source)?;
        let mut pilot = pilot.as_slice();
        let preconditioners = (0..tasks)
            .map(|task| {
                let (columns_of_task, rest) = pilot.split_at(columns.width(task..task + 1));
                pilot = rest;
                Preconditioner::of_pilot(columns_of_task, columns_of_task.len() - 1)
            })
            .collect();
        Ok(Self { regression, also, chunk_rows, preconditioners })
    }

    /// Text of the plan, for people and for comparison: one line a fact.
    pub fn text(&self) -> String {
        let mut text = format!("chunk_rows = {}\n", self.chunk_rows);
        for latent in &self.regression.latents {
            for function in &latent.functions {
                text.push_str(&format!("{} : {function}\n", latent.name));
            }
        }
        for task in &self.regression.tasks {
            let terms = task.terms.iter();
            let terms: Vec<String> = terms
                .map(|term| format!("({}) * {}", term.coefficient, self.regression.latents[term.latent].name))
                .collect();
            let kind = if task.prior { "prior " } else { "" };
            text.push_str(&format!("{kind}{} : {} = {}\n", task.name, task.target, terms.join(" + ")));
        }
        if let Some(weight) = &self.regression.weight {
            text.push_str(&format!("weight : {weight}\n"));
        }
        for column in &self.also {
            text.push_str(&format!("moments : {column}\n"));
        }
        text
    }

    /// Hash of the plan, coordinates included.
    pub fn hash(&self) -> String {
        let mut text = self.text();
        for preconditioner in &self.preconditioners {
            text = plan_hash(text.as_bytes(), preconditioner);
        }
        text
    }

    /// Scans all rows of a source once.
    ///
    /// # Errors
    /// When a column does not exist, the source cannot be read, a weight is negative, or the user stops it.
    pub fn scan(&self, source: &dyn Source, progress: &dyn Progress) -> Result<Scanned, ScanError> {
        let columns = columns(&self.regression, &self.also, source)?;
        let chunks = Grid { chunk_rows: self.chunk_rows }.chunks(source.episodes());
        let mut sums = self.empty();
        scan(
            &columns,
            source,
            &chunks,
            progress,
            || Part::new(&columns, self.regression.tasks.len()),
            |part, _, tile| {
                part.add(&columns, &self.preconditioners, tile);
                Ok(())
            },
            |chunk, counts, part| sums.insert(source.episodes()[chunk.episode].id, chunk, counts, part),
        )?;
        Ok(sums)
    }

    /// Result of a scan of no rows.
    pub fn empty(&self) -> Scanned {
        let hash = self.hash();
        let tasks = self.preconditioners.iter();
        Scanned {
            tasks: tasks
                .map(|preconditioner| TaskStats { preconditioner: preconditioner.clone(), stats: Stats::new(&hash) })
                .collect(),
            also: Stats::new(&hash),
            ranges: BTreeMap::new(),
            rows: BTreeMap::new(),
        }
    }
}

struct Part {
    tasks: Vec<Gram>,
    also: Gram,
    ranges: Vec<[f64; 2]>,
    work: Vec<f64>,
}

impl Part {
    /// No rows of columns, of which the first `tasks` groups are those of tasks.
    fn new(columns: &Columns, tasks: usize) -> Self {
        let width = |group: usize| columns.width(group..group + 1);
        Self {
            tasks: (0..tasks).map(|task| Gram::new(width(task))).collect(),
            also: Gram::new(width(tasks + 1)),
            ranges: vec![RegionRanges::EMPTY; width(tasks)],
            work: Vec::new(),
        }
    }

    fn add(&mut self, columns: &Columns, preconditioners: &[Preconditioner], tile: &Tile<'_>) {
        let (n, weights) = (tile.len(), tile.weights());
        for (task, preconditioner) in preconditioners.iter().enumerate() {
            let d = columns.width(task..task + 1);
            self.work.clear();
            self.work.extend_from_slice(tile.values(task..task + 1));
            preconditioner.apply(MatMut::from_column_major_slice_mut(&mut self.work, n, d));
            let z = MatRef::from_column_major_slice(&self.work, n, d);
            self.tasks[task].merge(&Gram::of_rows(z, weights));
        }
        let [functions, also] = [0, 1].map(|after| preconditioners.len() + after);
        extremes(&tile.columns(functions..functions + 1), &mut self.ranges);
        let also = MatRef::from_column_major_slice(tile.values(also..also + 1), n, self.also.dimension());
        self.also.merge(&Gram::of_rows(also, weights));
    }
}

impl Scanned {
    /// The rows of all episodes.
    pub fn counts(&self) -> RowCounts {
        let mut total = RowCounts::default();
        self.rows.values().for_each(|&counts| total.add(counts));
        total
    }

    /// Adds a scan of other rows with the same plan: a union by key.
    ///
    /// # Errors
    /// Another plan, or rows that are on both sides; `self` is then unchanged.
    pub fn merge(&mut self, other: Self) -> Result<(), MergeError> {
        for (task, part) in self.tasks.iter().zip(&other.tasks) {
            task.stats.accepts(&part.stats)?;
        }
        self.also.accepts(&other.also)?;
        for (task, part) in self.tasks.iter_mut().zip(other.tasks) {
            task.stats.merge(part.stats)?;
        }
        self.also.merge(other.also)?;
        self.ranges.extend(other.ranges);
        self.rows.extend(other.rows);
        Ok(())
    }

    /// Keeps the wanted episodes; the result equals a scan of them alone.
    pub fn retain(&mut self, wanted: impl Fn(EpisodeId) -> bool) {
        self.tasks.iter_mut().for_each(|task| task.stats.retain(|key| wanted(key.episode)));
        self.also.retain(|key| wanted(key.episode));
        self.ranges.retain(|&episode, _| wanted(episode));
        self.rows.retain(|&episode, _| wanted(episode));
    }

    /// Sums the chunks of every episode: one statistic an episode, which can no longer be split.
    pub fn compact(&mut self) {
        let episode = |key: &Key| Key { chunk: 0, fold: Fold::default(), ..*key };
        self.tasks.iter_mut().for_each(|task| task.stats = task.stats.grouped(episode));
        self.also = self.also.grouped(episode);
    }

    fn insert(&mut self, episode: EpisodeId, chunk: &Chunk, counts: RowCounts, part: Part) -> Result<(), ScanError> {
        let key = Key { episode, chunk: chunk.index, fold: chunk.fold, partition: 0, region: 0 };
        self.rows.entry(episode).or_default().add(counts);
        for (task, gram) in self.tasks.iter_mut().zip(part.tasks) {
            task.stats.insert(key, gram)?;
        }
        self.also.insert(key, part.also)?;
        let ranges = self.ranges.entry(episode).or_insert_with(|| part.ranges.clone());
        widen(ranges, &part.ranges);
        Ok(())
    }
}
