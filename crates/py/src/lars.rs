//! Least angle regression and its lasso modification.

use fleetfoot::{
    data::{Silent, parallel_map},
    sparse::{
        Path, PathStatus, Penalty, Quadratic, Sign,
        lars::{LarsOptions, Method, lars},
    },
};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::{
    array::Array,
    design::{Design, Fold, check_folds, first_problem},
    error::Kind,
    run::{Failure, run_any},
};

/// A path: its values at its k knots, alpha descending.
#[pyclass(frozen, module = "fleetfoot._core")]
pub(crate) struct LarsPath {
    path: Path,
    columns: usize,
    interpolating: bool,
}

#[pymethods]
impl LarsPath {
    /// Penalty at every knot (k).
    #[getter]
    fn alphas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.of_knots(py, |knot| knot.l1)
    }

    /// Coefficients at every knot (k x p).
    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let dense: Vec<f64> = self.path.knots.iter().flat_map(|knot| knot.dense(self.columns)).collect();
        PyArray1::from_vec(py, dense).reshape((self.path.knots.len(), self.columns))
    }

    /// Intercept at every knot (k).
    #[getter]
    fn intercepts<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.of_knots(py, |knot| knot.intercept)
    }

    /// Residual sum of squares over the number of rows at every knot (k).
    #[getter]
    fn mse<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.of_knots(py, |knot| knot.mse)
    }

    /// Violation of the lasso's optimality conditions at every knot, as a correlation (k).
    #[getter]
    fn violations<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.of_knots(py, |knot| knot.certificate.kkt)
    }

    /// Active columns at the end, in the order in which they entered.
    #[getter]
    fn active(&self) -> Vec<usize> {
        let mut order: Vec<usize> = Vec::new();
        for pair in self.path.knots.windows(2) {
            let [above, below] = pair else { continue };
            // A column that left at the knot above may enter again, behind the others.
            order.retain(|j| above.support.binary_search(j).is_ok());
            order.extend(below.support.iter().filter(|j| above.support.binary_search(j).is_err()));
        }
        let end = self.path.knots.last().map_or(&[][..], |knot| &knot.support);
        order.retain(|j| end.binary_search(j).is_ok());
        order
    }

    /// Columns that stay out because they differ from the active ones by rounding only.
    #[getter]
    fn collinear(&self) -> Vec<usize> {
        self.path.collinear.clone()
    }

    /// True if rounding ended the path early.
    #[getter]
    fn stalled(&self) -> bool {
        self.path.status == PathStatus::Stalled
    }

    /// True if the end of the path interpolates all rows.
    #[getter]
    fn interpolating(&self) -> bool {
        self.interpolating
    }
}

impl LarsPath {
    /// Coefficients and intercept at any alpha: linear between knots, constant beyond the first and the last.
    fn between(&self, alpha: f64) -> (Vec<f64>, f64) {
        let knots = &self.path.knots;
        let after = knots.partition_point(|knot| knot.l1 > alpha);
        let (above, below) = (&knots[after.saturating_sub(1)], &knots[after.min(knots.len() - 1)]);
        let share = if above.l1 > below.l1 { (above.l1 - alpha) / (above.l1 - below.l1) } else { 1.0 };
        let mut coefficients = vec![0.0; self.columns];
        for (knot, share) in [(above, 1.0 - share), (below, share)] {
            let values = knot.support.iter().zip(&knot.coefficients);
            values.for_each(|(&j, value)| coefficients[j] += share * value);
        }
        (coefficients, (1.0 - share) * above.intercept + share * below.intercept)
    }

    fn of_knots<'py>(
        &self,
        py: Python<'py>,
        value: impl Fn(&fleetfoot::sparse::Solution) -> f64,
    ) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.path.knots.iter().map(value).collect())
    }
}

/// Request of a path: a dictionary in Python.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct LarsRequest {
    /// True if columns leave at zero coefficients.
    lasso: bool,
    /// True if coefficients must not be negative.
    positive: bool,
    /// Penalty at the end of the path.
    alpha_min: f64,
    /// The most steps.
    max_iter: usize,
}

impl LarsRequest {
    fn follow(&self, problem: &Quadratic) -> Result<LarsPath, Failure> {
        self.follow_up_to(problem, None)
    }

    /// The path of every target of a design whose rows were kept for few columns; `None` where one of them takes many.
    fn follow_few(&self, problems: &[Quadratic]) -> Result<Option<Vec<LarsPath>>, Failure> {
        let mut paths = Vec::with_capacity(problems.len());
        for problem in problems {
            let path = self.follow_up_to(problem, Some(problem.columns() / FEW + 1))?;
            if path.path.status == PathStatus::MaxFeatures {
                return Ok(None);
            }
            paths.push(path);
        }
        Ok(Some(paths))
    }

    fn follow_up_to(&self, problem: &Quadratic, max_features: Option<usize>) -> Result<LarsPath, Failure> {
        let columns = problem.columns();
        let signs = if self.positive { vec![Sign::NonNegative; columns] } else { Vec::new() };
        let options = LarsOptions {
            method: if self.lasso { Method::Lasso } else { Method::Lars },
            lambda_min: self.alpha_min,
            max_knots: Some(self.max_iter.saturating_add(1)),
            max_features,
            ..LarsOptions::default()
        };
        let path = lars(problem, &Penalty { signs, ..Penalty::default() }, &options);
        let path = path.map_err(|error| Failure::of(Kind::Fit)(&error))?;
        let interpolating = path.status == PathStatus::Saturated;
        Ok(LarsPath { path, columns, interpolating })
    }
}

/// The paths of all targets of a design on the rows of some groups (`None`: all), with a free intercept or none.
#[pyfunction]
#[pyo3(signature = (design, groups, intercept, request, progress=None))]
pub(crate) fn lars_paths(
    py: Python<'_>,
    design: &Design,
    groups: Option<Vec<usize>>,
    intercept: bool,
    request: LarsRequest,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<LarsPath>> {
    let groups = design.chosen(groups)?;
    run_any(py, progress, |_| {
        let problems = design.of().problems(groups.as_deref(), intercept)?;
        if !design.of().keeps_rows() {
            return problems.iter().map(|problem| request.follow(problem)).collect();
        }
        if let Some(paths) = request.follow_few(&problems)? {
            return Ok(paths);
        }
        drop(problems);
        let problems = design.of().for_many(&Silent)?.problems(None, intercept)?;
        problems.iter().map(|problem| request.follow(problem)).collect()
    })
}

/// Of how many columns one is few.
const FEW: usize = 4;

/// The path of products X'X (p x p), X'y (p) and y'y (`None`: not known) of `rows` rows.
#[pyfunction]
pub(crate) fn lars_path_of_products(
    py: Python<'_>,
    gram: &Bound<'_, PyAny>,
    xy: &Bound<'_, PyAny>,
    yy: Option<f64>,
    rows: f64,
    request: LarsRequest,
) -> PyResult<LarsPath> {
    let (gram, xy) = (Array::of(gram, "Gram")?, Array::of(xy, "Xy")?);
    let columns: Vec<usize> = (0..gram.columns()).collect();
    run_any(py, None, |_| {
        let joined = |columns: Vec<_>| {
            columns.iter().flat_map(|column: &fleetfoot::data::ScalarBuffer<f64>| column.to_vec()).collect::<Vec<f64>>()
        };
        let products = joined(gram.values(&columns, 0..gram.rows()));
        let problem = Quadratic::from_dense_products(&products, &joined(xy.values(&[0], 0..xy.rows())), yy, rows);
        request.follow(&problem.map_err(|error| Failure::of(Kind::Fit)(&error))?)
    })
}

/// Lambdas, and the errors of every fold there.
type FoldErrors<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// Knots of the paths of all folds, ascending, about `most` of them. Then mean squared errors of the first target there
/// on the held-out rows (alphas x folds).
#[pyfunction]
#[pyo3(signature = (folds, intercept, request, most, progress=None))]
pub(crate) fn lars_fold_errors<'py>(
    py: Python<'py>,
    folds: Vec<Fold>,
    intercept: bool,
    request: LarsRequest,
    most: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<FoldErrors<'py>> {
    check_folds(&folds)?;
    let (alphas, errors) = run_any(py, progress, |progress| {
        progress.stage("paths of the folds");
        let paths = parallel_map(folds.len(), progress, |fold| {
            let (design, train, _) = &folds[fold];
            request.follow(&first_problem(design.get().of(), train, intercept)?)
        })?;
        let mut knots: Vec<f64> = paths.iter().flat_map(|path| &path.path.knots).map(|knot| knot.l1).collect();
        knots.sort_by(f64::total_cmp);
        knots.dedup();
        let alphas: Vec<f64> = knots.iter().copied().step_by((knots.len() / most.max(1)).max(1)).collect();
        progress.stage("held-out errors");
        let errors = parallel_map(folds.len(), progress, |fold| {
            let (design, _, test) = &folds[fold];
            let (models, intercepts): (Vec<Vec<f64>>, Vec<f64>) =
                alphas.iter().map(|&alpha| paths[fold].between(alpha)).unzip();
            Ok::<_, Failure>(design.get().of().mean_squares(Some(test), 0, &models.concat(), &intercepts, &Silent)?)
        })?;
        Ok((alphas, errors))
    })?;
    let shape = (alphas.len(), folds.len());
    let by_alpha = (0..shape.0).flat_map(|k| errors.iter().map(move |errors| errors[k])).collect();
    Ok((PyArray1::from_vec(py, alphas), PyArray1::from_vec(py, by_alpha).reshape(shape)?))
}
