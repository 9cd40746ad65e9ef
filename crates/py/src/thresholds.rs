//! Sparse models by thresholding and by forward regression: STLSQ, SR3, FROLS.

use fleetfoot::{
    sparse::threshold::{Frols, FrolsChoice, Joint, Regularizer, Scaling, Sr3, Status, Stlsq, Terms, ThresholdError},
    stats::Compressed,
};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::{
    design::Design,
    error::Kind,
    run::{Failure, run_any},
};

impl From<ThresholdError> for Failure {
    fn from(error: ThresholdError) -> Self {
        match error {
            ThresholdError::Cancelled(cancelled) => cancelled.into(),
            error => Self::Other(Kind::Fit, error.to_string()),
        }
    }
}

/// Models of q targets on p columns.
#[pyclass(frozen, module = "fleetfoot._core")]
pub(crate) struct SparseModels {
    joint: Joint,
    columns: usize,
}

#[pymethods]
impl SparseModels {
    /// Coefficients (q x p).
    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, self.joint.steps.iter().map(|step| step.coefficients.as_slice()), self.columns)
    }

    /// Coefficients before the last refit (q x p).
    #[getter]
    fn decided<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, self.joint.decided.iter().map(Vec::as_slice), self.columns)
    }

    /// Coefficients of every iteration (k x q x p).
    #[getter]
    fn history<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let values: Vec<f64> = self.joint.history.iter().flatten().flatten().copied().collect();
        PyArray1::from_vec(py, values).reshape((self.joint.history.len(), self.joint.steps.len(), self.columns))
    }

    /// Relaxed coefficients of SR3 (q x p); of the others (0 x p).
    #[getter]
    fn relaxed<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, self.joint.relaxed.iter().map(Vec::as_slice), self.columns)
    }

    /// Error reduction ratios of forward regression, in order of entry, of each target.
    #[getter]
    fn ratios(&self) -> Vec<Vec<f64>> {
        self.joint.ratios.clone()
    }

    /// Iterations made.
    #[getter]
    fn iterations(&self) -> usize {
        self.joint.iterations
    }

    /// True if they ended by their rule.
    #[getter]
    fn converged(&self) -> bool {
        self.joint.converged
    }

    /// Targets that have lost all their terms.
    #[getter]
    fn empty(&self) -> Vec<usize> {
        let steps = self.joint.steps.iter().enumerate();
        steps.filter(|(_, step)| step.status == Status::Empty).map(|(target, _)| target).collect()
    }
}

fn matrix<'py, 'a>(
    py: Python<'py>,
    rows: impl ExactSizeIterator<Item = &'a [f64]>,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let count = rows.len();
    PyArray1::from_vec(py, rows.flatten().copied().collect()).reshape((count, columns))
}

/// Runs an optimiser on the problem of all rows.
fn models(
    py: Python<'_>,
    design: &Design,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&Compressed) -> Result<Joint, ThresholdError> + Send,
) -> PyResult<SparseModels> {
    let columns = design.of().regressors();
    let joint = run_any(py, progress, |_| Ok(work(&design.of().root(None).compressed(false))?))?;
    Ok(SparseModels { joint, columns })
}

fn scaling(normalize: bool) -> Scaling {
    if normalize { Scaling::Length } else { Scaling::Physical }
}

/// A row of a matrix of first guesses or weights.
fn row(matrix: &PyReadonlyArray2<'_, f64>, target: usize) -> Option<Vec<f64>> {
    let matrix = matrix.as_array();
    (target < matrix.nrows()).then(|| matrix.row(target).to_vec())
}

/// Options of STLSQ: a dictionary in Python.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct StlsqRequest {
    threshold: f64,
    alpha: f64,
    max_iter: usize,
    normalize: bool,
    unbias: bool,
    /// Columns that are neither penalised nor dropped.
    fixed: Vec<usize>,
}

/// Sequentially thresholded least squares of all targets; `initial` (q x p) is a first guess.
#[pyfunction]
#[pyo3(signature = (design, request, initial=None, progress=None))]
pub(crate) fn stlsq(
    py: Python<'_>,
    design: &Design,
    request: StlsqRequest,
    initial: Option<PyReadonlyArray2<'_, f64>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<SparseModels> {
    let each: Vec<(Stlsq, Terms)> = (0..design.of().targets())
        .map(|target| {
            let stlsq = Stlsq {
                threshold: request.threshold,
                alpha: request.alpha,
                max_iterations: request.max_iter,
                scaling: scaling(request.normalize),
                unbias: request.unbias,
                initial: initial.as_ref().and_then(|initial| row(initial, target)),
            };
            (stlsq, Terms { fixed: request.fixed.clone(), ..Terms::all() })
        })
        .collect();
    models(py, design, progress, |problem| Stlsq::jointly(problem, &each))
}

/// Options of SR3: a dictionary in Python.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Sr3Request {
    /// "l0", "l1" or "l2".
    regularizer: String,
    nu: f64,
    tol: f64,
    max_iter: usize,
    normalize: bool,
    unbias: bool,
}

/// Sparse relaxed regularised regression of all targets; `weights` (q x p) are the penalties, `initial` (q x p) is a first guess in raw units.
#[pyfunction]
#[pyo3(signature = (design, request, weights, initial=None, progress=None))]
pub(crate) fn sr3(
    py: Python<'_>,
    design: &Design,
    request: Sr3Request,
    weights: PyReadonlyArray2<'_, f64>,
    initial: Option<PyReadonlyArray2<'_, f64>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<SparseModels> {
    let regularizer = match request.regularizer.as_str() {
        "l0" => Regularizer::L0,
        "l1" => Regularizer::L1,
        "l2" => Regularizer::L2,
        other => {
            return Err(Kind::Request.error(format!("regularizer={other:?}: give \"l0\", \"l1\" or \"l2\"")));
        }
    };
    let each: Vec<(Sr3, Terms)> = (0..design.of().targets())
        .map(|target| {
            let sr3 = Sr3 {
                lambda: 1.0,
                factors: row(&weights, target),
                regularizer,
                nu: request.nu,
                tolerance: request.tol,
                max_iterations: request.max_iter,
                scaling: scaling(request.normalize),
                unbias: request.unbias,
                initial: initial.as_ref().and_then(|initial| row(initial, target)),
            };
            (sr3, Terms::all())
        })
        .collect();
    models(py, design, progress, |problem| Sr3::jointly(problem, &each))
}

/// Options of FROLS: a dictionary in Python.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct FrolsRequest {
    max_terms: usize,
    alpha: f64,
    kappa: f64,
    normalize: bool,
    unbias: bool,
}

/// Forward regression of all targets.
#[pyfunction]
#[pyo3(signature = (design, request, progress=None))]
pub(crate) fn frols(
    py: Python<'_>,
    design: &Design,
    request: FrolsRequest,
    progress: Option<Py<PyAny>>,
) -> PyResult<SparseModels> {
    let frols = Frols {
        max_terms: request.max_terms,
        alpha: request.alpha,
        scaling: scaling(request.normalize),
        unbias: request.unbias,
        choice: FrolsChoice::LeastRatio { kappa: request.kappa },
    };
    let terms = vec![Terms::all(); design.of().targets()];
    models(py, design, progress, |problem| frols.jointly(problem, &terms))
}
