//! One pass over the rows: the statistics of every task, by episode and chunk.

use std::collections::BTreeMap;

use faer::{MatMut, MatRef};
use fleetfoot_data::{Cancelled, EpisodeId, Error, Halo, Progress, Source};
use fleetfoot_library::{Design, DesignRows, Expr, UnknownColumn};
use fleetfoot_stats::{
    Chunk, Fold, Gram, Grid, Key, MergeError, PlanError, Preconditioner, Stats, pilot_tiles, plan_hash, reduce,
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
    /// A value whose squares overflow.
    #[error(transparent)]
    TooLarge(#[from] fleetfoot_library::TooLarge),
    /// Too many episodes.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A row weight below zero.
    #[error("episode {episode}, row {row}: the weight is {value}; weights are not negative")]
    NegativeWeight {
        /// The episode.
        episode: String,
        /// Its row.
        row: usize,
        /// The weight.
        value: f64,
    },
}

/// A frozen plan: what is summed, in which coordinates, in which chunks. Scans of one plan can be merged, whoever made them.
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

/// What a scan found.
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

/// What became of an episode's rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RowCounts {
    /// Rows with all values.
    pub complete: u64,
    /// Rows that lack neighbours at the border of their episode.
    pub at_border: u64,
    /// Rows with a missing value.
    pub incomplete: u64,
}

impl RowCounts {
    /// Adds other rows.
    pub(crate) fn add(&mut self, other: Self) {
        self.complete += other.complete;
        self.at_border += other.at_border;
        self.incomplete += other.incomplete;
    }
}

/// The columns of a scan: every task's, the candidate functions, [`Plan::also`], the weight.
struct Columns {
    design: Design,
    tasks: Vec<usize>,
    functions: usize,
    also: usize,
    weighted: bool,
}

impl Columns {
    fn compile(regression: &Regression, also: &[Expr], source: &dyn Source) -> Result<Self, ScanError> {
        let tasks: Vec<Vec<Expr>> = (0..regression.tasks.len()).map(|task| regression.columns(task)).collect();
        let functions = regression.latents.iter().flat_map(|latent| &latent.functions);
        let expressions: Vec<Expr> =
            tasks.iter().flatten().chain(functions).chain(also).chain(&regression.weight).cloned().collect();
        let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        Ok(Self {
            design: Design::compile(&expressions, &names)?,
            tasks: tasks.iter().map(Vec::len).collect(),
            functions: regression.coefficients(),
            also: also.len(),
            weighted: regression.weight.is_some(),
        })
    }

    fn halo(&self) -> Halo {
        self.design.halo()
    }

    /// Index of the first column of every group: tasks, functions, also, weight.
    fn first(&self, group: usize) -> usize {
        let counts = self.tasks.iter().copied().chain([self.functions, self.also]);
        counts.take(group).sum()
    }

    fn group<'r>(&self, rows: &'r DesignRows, group: usize) -> &'r [f64] {
        &rows.values[self.first(group) * rows.rows()..self.first(group + 1) * rows.rows()]
    }

    fn weights<'r>(&self, rows: &'r DesignRows, episode: &str, first: usize) -> Result<Option<&'r [f64]>, ScanError> {
        let weights = self.weighted.then(|| rows.output(self.first(self.tasks.len() + 2)));
        if let Some(at) = weights.and_then(|weights| weights.iter().position(|&weight| weight < 0.0)) {
            let value = weights.map_or(f64::NAN, |weights| weights[at]);
            return Err(ScanError::NegativeWeight { episode: episode.to_owned(), row: first + rows.index[at], value });
        }
        Ok(weights)
    }
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
        let columns = Columns::compile(&regression, &also, source)?;
        let numbers = |d: usize| (d + 1) * (d + 2) / 2;
        let bytes = 8 * columns.tasks.iter().chain([&columns.also]).map(|&d| numbers(d)).sum::<usize>();
        Grid::check(source.episodes(), 1, bytes)?;
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); columns.first(columns.tasks.len())];
        let mut rows = DesignRows::default();
        pilot_tiles(source, columns.halo(), |episode, block, tile| {
            columns.design.evaluate_for_squares(block, &episode.name, tile, &mut rows)?;
            for (column, all) in values.iter_mut().enumerate() {
                all.extend_from_slice(rows.output(column));
            }
            Ok::<_, ScanError>(())
        })?;
        let length = values.first().map_or(0, Vec::len);
        let preconditioners = (0..columns.tasks.len())
            .map(|task| {
                let joined = values[columns.first(task)..columns.first(task + 1)].concat();
                let pilot = MatRef::from_column_major_slice(&joined, length, columns.tasks[task]);
                Preconditioner::from_pilot(pilot, columns.tasks[task] - 1)
            })
            .collect();
        Ok(Self { regression, also, chunk_rows, preconditioners })
    }

    /// What the plan says, for people and for comparison: one line a fact.
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
            text = plan_hash(&text, preconditioner);
        }
        text
    }

    /// Scans all rows of a source once.
    ///
    /// # Errors
    /// When a column does not exist, the source cannot be read, a weight is negative, or the user stops it.
    pub fn scan(&self, source: &dyn Source, progress: &dyn Progress) -> Result<Scanned, ScanError> {
        let columns = Columns::compile(&self.regression, &self.also, source)?;
        let chunks = Grid { chunk_rows: self.chunk_rows }.chunks(source.episodes());
        let mut found = self.empty();
        reduce(
            source,
            &chunks,
            columns.halo(),
            progress,
            || Part::new(&columns),
            |part, chunk, block, tile| {
                let mut rows = std::mem::take(&mut part.rows);
                columns.design.evaluate_for_squares(block, &source.episodes()[chunk.episode].name, tile, &mut rows)?;
                part.counts.at_border += rows.at_border;
                part.counts.incomplete += rows.incomplete;
                let weights = columns.weights(&rows, &source.episodes()[chunk.episode].name, block.first)?;
                part.add(&columns, &self.preconditioners, &rows, weights);
                part.rows = rows;
                Ok::<_, ScanError>(())
            },
            |chunk, part| found.insert(source.episodes()[chunk.episode].id, chunk, part),
        )?;
        Ok(found)
    }

    /// What a scan of no rows finds.
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
    counts: RowCounts,
    rows: DesignRows,
    work: Vec<f64>,
}

impl Part {
    fn new(columns: &Columns) -> Self {
        Self {
            tasks: columns.tasks.iter().map(|&d| Gram::new(d)).collect(),
            also: Gram::new(columns.also),
            ranges: vec![[f64::INFINITY, f64::NEG_INFINITY]; columns.functions],
            counts: RowCounts::default(),
            rows: DesignRows::default(),
            work: Vec::new(),
        }
    }

    fn add(
        &mut self,
        columns: &Columns,
        preconditioners: &[Preconditioner],
        rows: &DesignRows,
        weights: Option<&[f64]>,
    ) {
        let n = rows.rows();
        self.counts.complete += n as u64;
        if n == 0 {
            return;
        }
        for (task, preconditioner) in preconditioners.iter().enumerate() {
            self.work.clear();
            self.work.extend_from_slice(columns.group(rows, task));
            preconditioner.apply(MatMut::from_column_major_slice_mut(&mut self.work, n, columns.tasks[task]));
            let z = MatRef::from_column_major_slice(&self.work, n, columns.tasks[task]);
            self.tasks[task].merge(&Gram::of_rows(z, weights));
        }
        let groups = columns.tasks.len();
        let functions = columns.group(rows, groups).chunks_exact(n);
        for (range, values) in self.ranges.iter_mut().zip(functions) {
            let (least, most) =
                values.iter().fold((range[0], range[1]), |(least, most), &value| (least.min(value), most.max(value)));
            *range = [least, most];
        }
        let also = MatRef::from_column_major_slice(columns.group(rows, groups + 1), n, columns.also);
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

    /// Keeps the episodes that are wanted: what is left is what a scan of them alone finds.
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

    fn insert(&mut self, episode: EpisodeId, chunk: &Chunk, part: Part) -> Result<(), ScanError> {
        let key = Key { episode, chunk: chunk.index, fold: chunk.fold, partition: 0, region: 0 };
        self.rows.entry(episode).or_default().add(part.counts);
        for (task, gram) in self.tasks.iter_mut().zip(part.tasks) {
            task.stats.insert(key, gram)?;
        }
        self.also.insert(key, part.also)?;
        let ranges = self.ranges.entry(episode).or_insert_with(|| part.ranges.clone());
        for (all, some) in ranges.iter_mut().zip(&part.ranges) {
            *all = [all[0].min(some[0]), all[1].max(some[1])];
        }
        Ok(())
    }
}
