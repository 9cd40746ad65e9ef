//! Problems from dense rows in memory, read in place: one pass, and a statistic for every group of rows.

mod gather;
mod nonzeros;
mod pose;
mod sums;

use std::{fmt, ops::Range, sync::Arc};

use faer::MatRef;
use fleetfoot_data::{Cancelled, OutOfMemory, Progress, ensure_memory};
use fleetfoot_stats::{Factor, Gram, SquareRoot};

use crate::{Quadratic, SparseError};
pub use nonzeros::Nonzeros;
use sums::Sums;

/// Columns up to which the sums are those of preconditioned rows, and a problem is in square-root form. Beyond, they are plain products (Gram form): the
/// factorisations would cost more than the pass.
pub(crate) const ROOT_COLUMNS: usize = 512;
/// Rows times the square of the columns up to which rows are read anew for every problem, and factored directly.
const DIRECT: usize = 50_000_000;
/// Rows a column, and values, up to which rows stay rows where only a few solutions are wanted.
const FEW_ROWS: usize = 4;
const FEW_VALUES: usize = 1 << 25;

/// Rows of regressors and targets, in memory or as good as there: they are read more than once.
pub trait DenseRows: fmt::Debug + Send + Sync {
    /// Number of rows.
    fn rows(&self) -> usize;

    /// Number of regressors, p.
    fn regressors(&self) -> usize;

    /// Number of targets, q.
    fn targets(&self) -> usize;

    /// Appends some neighbouring rows to `out`, column after column: p regressors, then q targets.
    fn read(&self, rows: Range<usize>, out: &mut Vec<f64>);

    /// Columns, regressors and targets, that cost little more than their share of all when they are read by themselves.
    fn columns_at_once(&self) -> usize {
        self.regressors() + self.targets()
    }

    /// Appends some neighbouring columns of some neighbouring rows to `out`, column after column: p regressors, then q targets.
    fn read_columns(&self, columns: Range<usize>, rows: Range<usize>, out: &mut Vec<f64>) {
        let mut all = Vec::new();
        self.read(rows.clone(), &mut all);
        out.extend_from_slice(&all[columns.start * rows.len()..columns.end * rows.len()]);
    }

    /// Share of the regressors' values that are not zero, where those can be had by themselves ([`DenseRows::nonzeros`]); else 1.
    fn density(&self) -> f64 {
        1.0
    }

    /// The regressors of some neighbouring rows that are not zero, where [`DenseRows::density`] is below 1.
    fn nonzeros(&self, _rows: Range<usize>) -> Option<Nonzeros> {
        None
    }
}

/// Why a dense design makes no problem.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DenseError {
    /// The rows, the weights or their sums are invalid.
    #[error(transparent)]
    Problem(#[from] SparseError),
    /// A group label that is not below the number of groups.
    #[error("row {} has the group {label}: groups are 0 to {most}", row + 1)]
    Group {
        /// The row.
        row: usize,
        /// Its label.
        label: u32,
        /// The largest label there may be.
        most: usize,
    },
    /// The stored sums or rows need more memory than there is.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A dense design of n rows, p regressors and q targets. Its rows belong to groups, and the statistic of any union of
/// groups is at hand.
///
/// The storage depends on the shape. Few rows are read in place for every problem, and factored directly: no more than
/// twice the columns, or few enough for a quick factorisation. Many rows are read once, in parallel, and their products
/// are summed group by group. The sums use the coordinates that a pilot sample gives
/// ([`Preconditioner`](fleetfoot_stats::Preconditioner)), so that little is lost to the square of the condition number.
/// Plain products are summed for more than 512 columns, or for few nonzero values in columns that are far from
/// dependent. Beside the statistics only the blocks in flight are held.
///
/// Answers do not depend on the number of threads.
#[derive(Debug)]
pub struct DenseDesign {
    rows: Arc<dyn DenseRows>,
    /// Row weights; `None`: all 1.
    weights: Option<Vec<f64>>,
    /// Group of every row; empty where there is one.
    labels: Vec<u32>,
    groups: usize,
    /// `None`: the rows are read anew.
    sums: Option<Sums>,
    /// True if problems keep their rows, however many.
    keeps_rows: bool,
}

impl DenseDesign {
    /// Reads a design: row weights (n; `None`: all 1), and for every row a label below `groups` (n; empty: one group).
    ///
    /// # Errors
    /// When the lengths disagree, a weight is negative, a label is too large, there are no rows, or the user stops it.
    pub fn new(
        rows: Arc<dyn DenseRows>,
        weights: Option<Vec<f64>>,
        labels: Vec<u32>,
        groups: usize,
        progress: &dyn Progress,
    ) -> Result<Self, DenseError> {
        Self::made((rows, weights), (labels, groups), false, progress)
    }

    /// One group, of whose problems a few sparse solutions are wanted: more than 512 columns of up to four times as many rows are then not multiplied with
    /// each other. Solvers form the products of the columns that take part, and know the others by the residual, in rows times columns.
    ///
    /// # Errors
    /// As [`DenseDesign::new`].
    pub fn for_few(
        rows: Arc<dyn DenseRows>,
        weights: Option<Vec<f64>>,
        progress: &dyn Progress,
    ) -> Result<Self, DenseError> {
        Self::made((rows, weights), (Vec::new(), 1), true, progress)
    }

    /// Returns true if rows are kept because few solutions are wanted.
    pub fn keeps_rows(&self) -> bool {
        self.keeps_rows
    }

    /// The same rows as [`DenseDesign::new`] takes them, in one group.
    ///
    /// # Errors
    /// When the user stops it.
    pub fn for_many(&self, progress: &dyn Progress) -> Result<Self, DenseError> {
        Self::new(self.rows.clone(), self.weights.clone(), Vec::new(), 1, progress)
    }

    fn made(
        (rows, weights): (Arc<dyn DenseRows>, Option<Vec<f64>>),
        (labels, groups): (Vec<u32>, usize),
        few: bool,
        progress: &dyn Progress,
    ) -> Result<Self, DenseError> {
        let n = rows.rows();
        let given = [("the row weights", weights.as_ref().map_or(n, Vec::len)), ("the groups", labels.len())];
        for (what, length) in given {
            if length != n && !(length == 0 && what == "the groups") {
                return Err(SparseError::Length { what, actual: length, expected: n }.into());
            }
        }
        if let Some(weights) = &weights
            && let Some(row) = weights.iter().position(|weight| !(*weight >= 0.0 && weight.is_finite()))
        {
            return Err(SparseError::RowWeight { row, value: weights[row] }.into());
        }
        let groups = if labels.is_empty() { 1 } else { groups.max(1) };
        if let Some(row) = labels.iter().position(|&label| label as usize >= groups) {
            return Err(DenseError::Group { row, label: labels[row], most: groups - 1 });
        }
        if n == 0 {
            return Err(SparseError::NoRows.into());
        }
        let mut design = Self { rows, weights, labels, groups, sums: None, keeps_rows: false };
        let d = design.columns();
        design.ensure_memory()?;
        if few && d > ROOT_COLUMNS && n <= FEW_ROWS * d && n.saturating_mul(d) <= FEW_VALUES {
            design.keeps_rows = true;
        } else if n > 2 * d && n.saturating_mul(d * d) > DIRECT {
            let sums = Sums::of_nonzeros(&design, progress)?;
            design.sums = Some(match sums {
                Some(sums) => sums,
                None => Sums::scan(&design, progress)?,
            });
        }
        Ok(design)
    }

    /// Asks for the memory that the rows take where they are factored directly, or their products where they are summed: a matrix for each group, and one
    /// on its way into it.
    fn ensure_memory(&self) -> Result<(), OutOfMemory> {
        let (n, d) = (self.rows.rows(), self.columns());
        ensure_memory(
            (d.saturating_mul(n.min(d))).saturating_mul(8 * (self.groups + 1)),
            &format!("a regression on {n} rows and {d} columns"),
            "give fewer columns, or fewer folds",
        )
    }

    /// Number of regressors, p.
    pub fn regressors(&self) -> usize {
        self.rows.regressors()
    }

    /// Number of targets, q.
    pub fn targets(&self) -> usize {
        self.rows.targets()
    }

    /// Number of groups.
    pub fn groups(&self) -> usize {
        self.groups
    }

    /// Number of rows of all groups.
    pub fn rows(&self) -> usize {
        self.rows.rows()
    }

    /// Returns true if the sums of the rows show that every value of a row with weight is finite. The sums cannot show
    /// it if rows are read anew for every problem, or if squares overflow.
    pub fn is_seen_finite(&self) -> bool {
        self.sums.as_ref().is_some_and(Sums::is_finite)
    }

    fn columns(&self) -> usize {
        self.regressors() + self.targets()
    }

    /// The problems of all targets on the rows of some groups (`None`: of all), with a free intercept or none.
    ///
    /// No more rows than regressors stay rows; otherwise the form is that of a square root up to 512 columns, and of Gram matrices beyond.
    ///
    /// # Errors
    /// When the groups hold no row of positive weight, a value is not finite, or the user stops it.
    pub fn problems(&self, groups: Option<&[usize]>, intercept: bool) -> Result<Vec<Quadratic>, DenseError> {
        let chosen = self.chosen(groups);
        let q = self.targets();
        match &self.sums {
            Some(sums) if sums.is_plain() => of_gram(&sums.total(&chosen), q, intercept),
            Some(sums) => of_root(&sums.root(&chosen), intercept),
            None => {
                let used = self.used(&chosen);
                if used.len() <= self.regressors() || self.keeps_rows {
                    self.posed(&used, intercept)
                } else if self.columns() > ROOT_COLUMNS {
                    of_gram(&self.gram(&used), q, intercept)
                } else {
                    of_root(&self.factor(&used).square_root(), intercept)
                }
            }
        }
    }

    /// The square-root form of the rows of some groups (`None`: of all), all targets at once.
    pub fn root(&self, groups: Option<&[usize]>) -> SquareRoot {
        let chosen = self.chosen(groups);
        match &self.sums {
            Some(sums) => sums.root(&chosen),
            None => self.factor(&self.used(&chosen)).square_root(),
        }
    }

    /// Weighted mean squared errors, on the rows of some groups, of k models of one target: coefficients (p x k, one model after the other) and
    /// intercepts (k).
    ///
    /// # Errors
    /// When the shapes disagree, the target does not exist, the groups hold no row of positive weight, or the user stops it.
    pub fn mean_squares(
        &self,
        groups: Option<&[usize]>,
        target: usize,
        coefficients: &[f64],
        intercepts: &[f64],
        progress: &dyn Progress,
    ) -> Result<Vec<f64>, DenseError> {
        let (p, k, targets) = (self.regressors(), intercepts.len(), self.targets());
        if coefficients.len() != p * k {
            let (what, count) = ("the coefficients", coefficients.len());
            return Err(SparseError::Length { what, actual: count, expected: p * k }.into());
        }
        if target >= targets {
            return Err(SparseError::NoSuchTarget { target, targets }.into());
        }
        let models = MatRef::from_column_major_slice(coefficients, p, k);
        let chosen = self.chosen(groups);
        let errors = match &self.sums {
            Some(sums) if !(sums.is_plain() && self.rows_are_cheaper(&chosen, k)) => {
                sums.mean_squares(&chosen, target, models, intercepts)
            }
            _ => self.errors_of_rows(&self.used(&chosen), target, models, intercepts, progress)?,
        };
        if k > 0 && errors.is_empty() { Err(SparseError::NoRows.into()) } else { Ok(errors) }
    }

    /// Returns true if k models from the rows cost less than one factor of their products and k products with it.
    fn rows_are_cheaper(&self, chosen: &[bool], k: usize) -> bool {
        let (p, rows) = (self.regressors() as f64, self.used(chosen).len() as f64);
        rows * k as f64 <= p * (p / 3.0 + k as f64 / 2.0)
    }

    /// For each group: true if it is among `groups` (`None`: all).
    fn chosen(&self, groups: Option<&[usize]>) -> Vec<bool> {
        match groups {
            None => vec![true; self.groups],
            Some(groups) => (0..self.groups).map(|group| groups.contains(&group)).collect(),
        }
    }

    fn factor(&self, used: &[usize]) -> Factor {
        let mut factor = Factor::new(self.regressors(), self.targets());
        self.blocks(used, |values, rows, weights| {
            factor.push(MatRef::from_column_major_slice(values, rows, self.columns()), weights);
        });
        factor
    }

    fn gram(&self, used: &[usize]) -> Gram {
        let mut gram = Gram::new(self.columns());
        self.blocks(used, |values, rows, weights| {
            gram.merge(&Gram::of_rows(MatRef::from_column_major_slice(values, rows, self.columns()), weights));
        });
        gram
    }
}

fn of_root(root: &SquareRoot, intercept: bool) -> Result<Vec<Quadratic>, DenseError> {
    if intercept {
        return (0..root.targets()).map(|t| Ok(Quadratic::from_square_root(root, t)?)).collect();
    }
    let compressed = root.compressed(false);
    (0..root.targets()).map(|t| Ok(Quadratic::from_compressed(&compressed, t)?)).collect()
}

fn of_gram(gram: &Gram, targets: usize, intercept: bool) -> Result<Vec<Quadratic>, DenseError> {
    let p = gram.dimension() - targets;
    let columns: Vec<usize> = (0..p).collect();
    let problem = |t: usize| match intercept {
        true => Quadratic::from_gram(gram, &columns, p + t),
        false => Quadratic::from_gram_at_origin(gram, &columns, p + t),
    };
    (0..targets).map(|t| Ok(problem(t)?)).collect()
}

#[cfg(test)]
mod tests;
