//! The statistic of a system of equations: q targets over one library of p candidate functions, in one region or in those of a partition.
//!
//! A [`System`] has regressors and targets. A [`SystemPlan`] freezes the coordinates on a pilot sample and cuts the
//! rows into chunks; its one pass makes a [`SystemSums`]. It has one statistic a chunk and region, for all targets
//! together, which can be merged with those of other rows, parted by episode and kept. A [`SystemScan`] answers the
//! queries of fits, choices of terms, folds and replicates. Each answer is a weighted sum, in the square-root form that
//! solvers take.

mod columns;
mod plan;
mod polynomial;
mod ranges;
mod sampled;
mod scan;
mod statistic;
mod sums;
mod weak;
mod windows;

#[cfg(test)]
mod tests;

use fleetfoot_data::{Cancelled, EpisodeId, Error};
use fleetfoot_library::{Expr, UnknownColumn};
use fleetfoot_model::Partition;

pub use plan::SystemPlan;
pub use sampled::{sampled_mean_squares, sampled_variances};
pub use scan::{ChunkSums, SystemPass};
pub use statistic::SystemScan;
pub use sums::{EpisodeSums, SystemSums};
pub use weak::{LEAST_REACH, Rate, Weak, WeakTarget, weak_accuracy};

/// A regression `target_t = constant_t + sum_j b_jt function_j`, separate in every region.
#[derive(Debug, Clone, PartialEq)]
pub struct System {
    /// Candidate functions over the columns of a source (p). The constant is not among them: it is known of any rows, as their weight and means.
    pub functions: Vec<Expr>,
    /// Targets (q), measured or differences of measurements.
    pub targets: Vec<Expr>,
    /// More columns whose moments are wanted: states, measured targets.
    pub also: Vec<Expr>,
    /// Expressions whose mean squares are wanted, on the first rows of every chunk: the errors of differences.
    pub sampled: Vec<Expr>,
    /// Row weights, finite and not negative.
    pub weight: Option<Expr>,
    /// The regions; `None` is one region for all rows. A row without a region (an unseen label) takes part in nothing and is counted.
    pub partition: Option<Partition>,
    /// Windows in the place of rows, the weak form; `None` takes the rows as they are.
    pub weak: Option<Weak>,
}

impl System {
    /// One region, no weights, no further moments.
    pub fn new(functions: Vec<Expr>, targets: Vec<Expr>) -> Self {
        Self { functions, targets, also: Vec::new(), sampled: Vec::new(), weight: None, partition: None, weak: None }
    }

    /// Expressions of a row in the regression: functions, targets, and the columns of the partition.
    pub fn expressions(&self) -> impl Iterator<Item = &Expr> {
        let partition = self.partition.iter().flat_map(|partition| &partition.columns);
        self.functions.iter().chain(&self.targets).chain(partition)
    }

    /// Number of regions.
    pub fn regions(&self) -> usize {
        self.partition.as_ref().map_or(1, |partition| partition.rule.count())
    }

    /// Text of the system, one line a fact, without the numbers of the partition.
    fn text(&self) -> String {
        let mut text = String::new();
        let mut lines = |what: &str, expressions: &[Expr]| {
            expressions.iter().for_each(|expression| text.push_str(&format!("{what} : {expression}\n")));
        };
        lines("candidate of the equations", &self.functions);
        lines("left side of the equations", &self.targets);
        lines("moments of the equations", &self.also);
        lines("sampled for the equations", &self.sampled);
        lines("weight of the equations", self.weight.as_slice());
        if let Some(partition) = &self.partition {
            lines(&format!("partition {} over", partition.specification), &partition.columns);
        }
        text.push_str(&self.weak.as_ref().map_or_else(String::new, Weak::text));
        text
    }

    fn check(&self) -> Result<(), SystemError> {
        if self.targets.is_empty() {
            return Err(SystemError::NoTarget);
        }
        self.weak.as_ref().map_or(Ok(()), |weak| weak.check(self.targets.len()))?;
        let Some(partition) = &self.partition else {
            return Ok(());
        };
        let (columns, centre, scale) = (partition.columns.len(), partition.centre.len(), partition.scale.len());
        if self.regions() == 0 || centre != columns || scale != columns {
            return Err(SystemError::Partition { regions: self.regions(), columns, centre, scale });
        }
        Ok(())
    }
}

/// The rows behind one statistic: a chunk of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unit {
    /// The episode.
    pub episode: EpisodeId,
    /// The chunk of the episode, counted from its start.
    pub chunk: u32,
    /// Rows of positive weight that take part.
    pub rows: u64,
}

/// Reason why there is no statistic.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// Too many episodes.
    #[error(transparent)]
    Plan(#[from] fleetfoot_stats::PlanError),
    /// Nothing to regress.
    #[error("the system has no target: name at least one equation to fit")]
    NoTarget,
    /// A partition that cannot assign rows.
    #[error(
        "the partition has {regions} regions over {columns} columns with {centre} centres and {scale} scales: it needs at least one region, and a centre and a \
         scale for every column"
    )]
    Partition {
        /// Its regions.
        regions: usize,
        /// Its columns.
        columns: usize,
        /// Its centres.
        centre: usize,
        /// Its scales.
        scale: usize,
    },
    /// Windows that are none.
    #[error(
        "the weak form has windows of {reach} rows to either side and {window_targets} targets, and the system has {targets} targets: windows need {LEAST_REACH} rows to either \
         side, and a rate or a mean for every target"
    )]
    Weak {
        /// Rows to either side.
        reach: usize,
        /// Its targets.
        window_targets: usize,
        /// The system's targets.
        targets: usize,
    },
    /// Statistics that do not go together.
    #[error(transparent)]
    Merge(#[from] fleetfoot_stats::MergeError),
    /// The kept part of a plan is damaged.
    #[error("the coordinates of the plan are damaged or of another version")]
    Coordinates,
    /// The source has no such column.
    #[error(transparent)]
    UnknownColumn(#[from] UnknownColumn),
    /// The source cannot be read.
    #[error(transparent)]
    Data(#[from] Error),
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A row that cannot be summed.
    #[error(transparent)]
    Row(#[from] fleetfoot_stats::scan::RowError),
    /// Squares of values overflow f64.
    #[error(
        "the squares of `{function}` overflow, its values reach {least:e} to {most:e}: remove outliers or sentinel values from its columns, or leave the function \
         out"
    )]
    Overflow {
        /// The widest function.
        function: String,
        /// Its least value.
        least: f64,
        /// Its greatest value.
        most: f64,
    },
}
