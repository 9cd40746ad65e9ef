//! Dense designs: numpy arrays X and y as the statistics that every regression here is fitted on.
//!
//! Python makes a [`Design`] of X (n x p), y (n or n x q), row weights and group labels, in one pass over the arrays as
//! they lie. They may have any order, any strides and any type of number, and sparse rows too; there is no copy of the
//! whole. Then, for the rows of any union of groups (`None`: of all):
//!
//! - `design.of().problems(groups, intercept)` gives the [`Quadratic`](fleetfoot::sparse::Quadratic) of every target, for `lars`,
//!   `coordinate_descent` and all other solvers of `fleetfoot::sparse`;
//! - `design.of().root(groups)` gives the [`SquareRoot`](fleetfoot::stats::SquareRoot) of all targets at once, for thresholding
//!   (`SquareRoot::compressed`) and least squares;
//! - `design.of().mean_squares(groups, target, coefficients, intercepts, progress)` scores models on rows that they were not fitted on.
//!
//! Cross-validation labels the rows by fold (see `fold_groups` in `_folds.py`), makes one design, and asks for the problem of all groups but one.

use std::{ops::Range, sync::Arc};

use fleetfoot::sparse::{
    Quadratic,
    dense::{DenseDesign, DenseError, DenseRows, Nonzeros},
};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::{
    array::Array,
    error::Kind,
    matrix::Matrix,
    run::{Failure, run_any},
};

/// Columns of an array that are read together.
const COLUMNS_AT_ONCE: usize = 32;

/// X and y, borrowed from Python.
#[derive(Debug)]
pub(crate) struct Borrowed {
    x: Matrix,
    y: Matrix,
}

impl Borrowed {
    /// An array X (n x p) and y (n, or n x q).
    pub(crate) fn dense(x: Array, y: Array) -> Self {
        Self { x: Matrix::Dense(x), y: Matrix::Dense(y) }
    }
}

impl DenseRows for Borrowed {
    fn rows(&self) -> usize {
        self.x.rows()
    }

    fn regressors(&self) -> usize {
        self.x.columns()
    }

    fn targets(&self) -> usize {
        self.y.columns()
    }

    fn read(&self, rows: Range<usize>, out: &mut Vec<f64>) {
        self.x.read(rows.clone(), out);
        self.y.read(rows, out);
    }

    fn columns_at_once(&self) -> usize {
        match self.x {
            // A few lines of the cache in every row.
            Matrix::Dense(_) => COLUMNS_AT_ONCE,
            // All rows are read for any column.
            Matrix::Sparse(_) => self.regressors() + self.targets(),
        }
    }

    fn read_columns(&self, columns: Range<usize>, rows: Range<usize>, out: &mut Vec<f64>) {
        let p = self.regressors();
        self.x.read_columns(columns.start.min(p)..columns.end.min(p), rows.clone(), out);
        self.y.read_columns(columns.start.max(p) - p..columns.end.max(p) - p, rows, out);
    }

    fn density(&self) -> f64 {
        match &self.x {
            Matrix::Dense(_) => 1.0,
            Matrix::Sparse(rows) => rows.density(),
        }
    }

    fn nonzeros(&self, rows: Range<usize>) -> Option<Nonzeros> {
        match &self.x {
            Matrix::Dense(_) => None,
            Matrix::Sparse(sparse) => Some(sparse.nonzeros(rows)),
        }
    }
}

impl From<DenseError> for Failure {
    fn from(error: DenseError) -> Self {
        match error {
            DenseError::Cancelled(cancelled) => cancelled.into(),
            DenseError::Memory(error) => error.into(),
            error => Self::Other(Kind::Fit, error.to_string()),
        }
    }
}

/// Statistics of the rows of X and y, group by group. The arrays must not change while it lives.
#[pyclass(frozen, module = "fleetfoot._core")]
pub(crate) struct Design {
    of: Arc<DenseDesign>,
}

impl Design {
    /// The engine's design.
    pub(crate) fn of(&self) -> &DenseDesign {
        &self.of
    }

    /// The groups that are meant, as the engine takes them; a group that does not exist is an error.
    pub(crate) fn chosen(&self, groups: Option<Vec<usize>>) -> PyResult<Option<Vec<usize>>> {
        match groups.iter().flatten().find(|&&group| group >= self.of.groups()) {
            Some(group) => {
                Err(Kind::Request.error(format!("group {group} is asked for, the design has {}", self.of.groups())))
            }
            None => Ok(groups),
        }
    }
}

#[pymethods]
impl Design {
    /// Reads X (n x p; an array or scipy's compressed rows) and y (n, or n x q) with row weights (n) and a label below
    /// `groups` for every row (n). `few`: true if only a few solutions of the one group are needed.
    #[new]
    #[pyo3(signature = (x, y, weights=None, labels=None, groups=1, few=false, progress=None))]
    fn new(
        x: &Bound<'_, PyAny>,
        y: &Bound<'_, PyAny>,
        weights: Option<PyReadonlyArray1<'_, f64>>,
        labels: Option<PyReadonlyArray1<'_, u32>>,
        groups: usize,
        few: bool,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let rows = Borrowed { x: Matrix::of(x, "X")?, y: Matrix::Dense(Array::of(y, "y")?) };
        if rows.x.rows() != rows.y.rows() {
            let (given_rows, needed) = (rows.y.rows(), rows.x.rows());
            return Err(Kind::Data.error(format!("y has {given_rows} rows and X has {needed}: give one target a row")));
        }
        if rows.x.columns() == 0 || rows.y.columns() == 0 {
            return Err(Kind::Data.error("X and y need at least one column each"));
        }
        let weights = weights.map(|weights| weights.as_array().to_vec());
        let labels = labels.map_or_else(Vec::new, |labels| labels.as_array().to_vec());
        let of = run_any(x.py(), progress, |progress| {
            // Sparse rows would become dense as a whole.
            let few = few && labels.is_empty() && matches!(rows.x, Matrix::Dense(_));
            Ok(match few {
                true => DenseDesign::for_few(Arc::new(rows), weights, progress)?,
                false => DenseDesign::new(Arc::new(rows), weights, labels, groups, progress)?,
            })
        })?;
        Ok(Self { of: Arc::new(of) })
    }

    /// Rows, regressors, targets and groups.
    #[getter]
    fn shape(&self) -> (usize, usize, usize, usize) {
        (self.of.rows(), self.of.regressors(), self.of.targets(), self.of.groups())
    }

    /// True if the sums of the rows show that all values are finite; false if they do not show it.
    #[getter]
    fn seen_finite(&self) -> bool {
        self.of.is_seen_finite()
    }

    /// Mean squared errors on the rows of some groups, of k models of a target: coefficients (k x p, model after model) and intercepts (k).
    #[pyo3(signature = (groups, target, coefficients, intercepts, progress=None))]
    fn mean_squares<'py>(
        &self,
        py: Python<'py>,
        groups: Option<Vec<usize>>,
        target: usize,
        coefficients: PyReadonlyArray1<'py, f64>,
        intercepts: PyReadonlyArray1<'py, f64>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let groups = self.chosen(groups)?;
        let (coefficients, intercepts) = (coefficients.as_array().to_vec(), intercepts.as_array().to_vec());
        let squares = run_any(py, progress, |progress| {
            Ok(self.of.mean_squares(groups.as_deref(), target, &coefficients, &intercepts, progress)?)
        })?;
        Ok(PyArray1::from_vec(py, squares))
    }
}

/// A fold: the design that holds its rows, and the groups of these that train and that test.
pub(crate) type Fold = (Py<Design>, Vec<usize>, Vec<usize>);

/// Looks for groups that do not exist.
pub(crate) fn check_folds(folds: &[Fold]) -> PyResult<()> {
    for (design, train, test) in folds {
        design.get().chosen(Some(train.clone()))?;
        design.get().chosen(Some(test.clone()))?;
    }
    Ok(())
}

/// The problem of the first target on the rows of some groups.
pub(crate) fn first_problem(design: &DenseDesign, train: &[usize], intercept: bool) -> Result<Quadratic, Failure> {
    let problems = design.problems(Some(train), intercept)?;
    problems.into_iter().next().ok_or_else(|| Failure::Other(Kind::Internal, "a design without targets".into()))
}
