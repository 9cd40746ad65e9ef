//! k-means: rows made ready once, started and iterated as often as wanted; labels and distances.

use fleetfoot::data::ensure_memory;
use fleetfoot::pwa::{
    KMeansError, KMeansOptions, KMeansStep, Points, Units, assign_rows, distances_to, kmeans_from, starting_centroids,
};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::{
    error::Kind,
    matrix::Matrix,
    run::{Failure, run_any},
};

impl From<KMeansError> for Failure {
    fn from(error: KMeansError) -> Self {
        match error {
            KMeansError::Cancelled(cancelled) => cancelled.into(),
            error @ KMeansError::Memory(_) => Self::Other(Kind::Memory, format!("{error}, as X[::10]")),
            error @ KMeansError::Value { .. } => Self::Other(Kind::Data, error.to_string()),
            error => Self::Other(Kind::Fit, error.to_string()),
        }
    }
}

/// Rows to cluster: the engine's own copy, shifted and scaled.
#[pyclass(frozen, module = "fleetfoot._core")]
pub(crate) struct KMeansPoints {
    points: Points,
    units: Units,
}

/// Centroids (k x d), inertia, iterations, whether they converged, the threshold of the shifts, and (inertia, changed labels, shift) of every iteration.
type Run<'py> = (Bound<'py, PyArray2<f64>>, f64, usize, bool, f64, Vec<(f64, usize, f64)>);

#[pymethods]
impl KMeansPoints {
    /// Reads X (n x d; an array or scipy's compressed rows) and row weights (n).
    #[new]
    #[pyo3(signature = (x, weights=None, progress=None))]
    fn new(
        x: &Bound<'_, PyAny>,
        weights: Option<PyReadonlyArray1<'_, f64>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let rows = Matrix::of(x, "X")?;
        let weights = weights.map(|weights| weights.as_array().to_vec());
        run_any(x.py(), progress, |progress| {
            let units = Units::of_rows(&rows, progress)?;
            let mut points = Points::of_rows(&rows, &units, progress)?;
            if let Some(weights) = weights {
                points.weigh(weights)?;
            }
            Ok(Self { points, units })
        })
    }

    /// Centroids (k x d) that greedy k-means++ chooses with these uniform numbers.
    #[pyo3(signature = (clusters, draws, progress=None))]
    fn plus_plus<'py>(
        &self,
        py: Python<'py>,
        clusters: usize,
        draws: PyReadonlyArray1<'py, f64>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let draws = draws.as_array().to_vec();
        let seeds =
            run_any(py, progress, |progress| Ok(starting_centroids(&self.points, clusters, &draws, progress)?))?;
        PyArray1::from_vec(py, self.units.restore(&seeds)).reshape((clusters, self.points.dimensions()))
    }

    /// Lloyd's iterations from centroids (k x d).
    #[pyo3(signature = (start, max_iter, tol, history=false, progress=None))]
    fn run<'py>(
        &self,
        py: Python<'py>,
        start: PyReadonlyArray2<'py, f64>,
        max_iter: usize,
        tol: f64,
        history: bool,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Run<'py>> {
        let start = start.as_array();
        let k = start.nrows();
        let start = self.units.standardise(&start.iter().copied().collect::<Vec<_>>());
        let options = KMeansOptions { k, max_iterations: max_iter, tolerance: tol };
        let run = run_any(py, progress, |progress| {
            progress.stage("k-means");
            Ok(kmeans_from(&self.points, &start, &options, history, progress)?)
        })?;
        let area = self.units.area();
        let centroids = PyArray1::from_vec(py, self.units.restore(&run.centroids));
        let step_tuple = |step: &KMeansStep| (step.inertia * area, step.changed, step.shift * area);
        let steps = run.history.iter().map(step_tuple).collect();
        Ok((
            centroids.reshape((k, self.points.dimensions()))?,
            run.inertia * area,
            run.iterations,
            run.converged,
            run.threshold * area,
            steps,
        ))
    }
}

/// Number of uniform random numbers that k-means++ needs.
#[pyfunction]
pub(crate) fn kmeans_draws(clusters: usize) -> usize {
    fleetfoot::pwa::plus_plus_draws(clusters)
}

/// Labels (n), rows of each centroid (k), and the weighted sum of squared distances.
type Nearest<'py> = (Bound<'py, PyArray1<i32>>, Vec<u64>, f64);

/// The nearest of centroids (k x d) to each row of X (n x d), with row weights (n) for the sum of squared distances.
#[pyfunction]
#[pyo3(signature = (x, centroids, weights=None, progress=None))]
pub(crate) fn kmeans_assign<'py>(
    x: &Bound<'py, PyAny>,
    centroids: PyReadonlyArray2<'py, f64>,
    weights: Option<PyReadonlyArray1<'py, f64>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Nearest<'py>> {
    let rows = Matrix::of(x, "X")?;
    let centroids = of_width(&rows, &centroids)?;
    let weights = weights.map(|weights| weights.as_array().to_vec());
    let assigned =
        run_any(x.py(), progress, |progress| Ok(assign_rows(&rows, &centroids, weights.as_deref(), progress)?))?;
    let labels = assigned.labels.into_iter().map(|label| label as i32).collect();
    Ok((PyArray1::from_vec(x.py(), labels), assigned.counts, assigned.inertia))
}

/// Distances (n x k) of each row of X (n x d) to centroids (k x d).
#[pyfunction]
#[pyo3(signature = (x, centroids, progress=None))]
pub(crate) fn kmeans_distances<'py>(
    x: &Bound<'py, PyAny>,
    centroids: PyReadonlyArray2<'py, f64>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows = Matrix::of(x, "X")?;
    let k = centroids.as_array().nrows();
    let centroids = of_width(&rows, &centroids)?;
    let distances = run_any(x.py(), progress, |progress| {
        ensure_memory(
            rows.rows().saturating_mul(8 * k),
            &format!("distances of {} rows to {k} centres", rows.rows()),
            "give fewer rows at a time",
        )?;
        let mut out = vec![0.0; rows.rows() * k];
        distances_to(&rows, &centroids, &mut out, progress)?;
        Ok(out)
    })?;
    PyArray1::from_vec(x.py(), distances).reshape((rows.rows(), k))
}

/// Centroids row by row, as wide as the rows.
fn of_width(rows: &Matrix, centroids: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<f64>> {
    let centroids = centroids.as_array();
    if centroids.ncols() != rows.columns() {
        let (width, needed) = (centroids.ncols(), rows.columns());
        return Err(Kind::Data.error(format!("X has {needed} columns, the cluster centres have {width}")));
    }
    Ok(centroids.iter().copied().collect())
}
