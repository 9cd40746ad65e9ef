//! Least-squares problems of arrays, for estimators and information criteria.

use fleetfoot::{
    data::{Silent, parallel_map},
    sparse::{
        Penalty, Quadratic, Sign,
        coordinate::Descended,
        lars::{LarsOptions, lars},
        select::{CriteriaOptions, SelectOptions, information_criteria, solve_grid},
    },
};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::{
    design::{Design, Fold, check_folds, first_problem},
    error::{Kind, OrRaise},
    estimator::Estimator,
    run::{Failure, guard, run_any},
};

/// The least-squares problems of the targets of one X, compressed.
#[pyclass(frozen, module = "fleetfoot._core")]
pub(crate) struct Problems {
    pub(crate) targets: Vec<Quadratic>,
}

/// Solutions of one target: coefficients (alphas x features), intercepts, duality gaps in the units of the objective
/// and relative to the target's mean square, and sweeps. The flag is true if the engine's tolerance was met.
type Solutions<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Vec<usize>,
    Bound<'py, PyArray1<bool>>,
);

#[pymethods]
impl Problems {
    /// The problems of all targets on the rows of some groups of a design (`None`: of all).
    #[staticmethod]
    #[pyo3(signature = (design, groups, intercept))]
    fn of(py: Python<'_>, design: &Design, groups: Option<Vec<usize>>, intercept: bool) -> PyResult<Self> {
        let groups = design.chosen(groups)?;
        let targets = run_any(py, None, |_| Ok(design.of().problems(groups.as_deref(), intercept)?))?;
        Ok(Self { targets })
    }

    /// From plain products `X'X` (p x p), `X'y` (p x q) and `y'y` (q) of `rows` rows, without an intercept.
    #[staticmethod]
    fn products(
        gram: PyReadonlyArray2<'_, f64>,
        xy: PyReadonlyArray2<'_, f64>,
        yy: PyReadonlyArray1<'_, f64>,
        rows: f64,
    ) -> PyResult<Self> {
        guard(|| {
            let (gram, xy, yy) = (gram.as_array(), xy.as_array(), yy.as_array());
            let columns: Vec<f64> = gram.t().iter().copied().collect();
            let target = |k: usize| Quadratic::from_dense_products(&columns, &xy.column(k).to_vec(), Some(yy[k]), rows);
            let targets = (0..yy.len().min(xy.ncols())).map(target).collect::<Result<_, _>>().or_raise(Kind::Fit)?;
            Ok(Self { targets })
        })
    }

    /// Number of targets.
    fn __len__(&self) -> usize {
        self.targets.len()
    }

    /// Root mean square of a target, about its mean where there is an intercept.
    fn deviation(&self, target: usize) -> PyResult<f64> {
        Ok(self.target(target)?.target_deviation())
    }

    /// The problem of all targets together, the coefficients of the first target first.
    fn joined(&self) -> PyResult<Self> {
        guard(|| Ok(Self { targets: vec![Quadratic::stacked(&self.targets).or_raise(Kind::Fit)?] }))
    }

    /// The intercept that goes with coefficients (p) of a target.
    fn intercept(&self, target: usize, coefficients: PyReadonlyArray1<'_, f64>) -> PyResult<f64> {
        Ok(self.target(target)?.intercept_of(&coefficients.as_array().to_vec()))
    }

    /// The least alpha at which all coefficients of a target are zero.
    fn largest_alpha(&self, target: usize, estimator: &Estimator, positive: bool) -> PyResult<f64> {
        guard(|| {
            let problem = self.target(target)?;
            estimator.of.lambda_max(problem, &penalty(problem.columns(), positive)).or_raise(Kind::Fit)
        })
    }

    /// The solutions of a target at all alphas, each from the one before, the first from `start` (p).
    #[pyo3(signature = (target, alphas, estimator, positive, start))]
    fn descend<'py>(
        &self,
        py: Python<'py>,
        target: usize,
        alphas: PyReadonlyArray1<'_, f64>,
        estimator: &Estimator,
        positive: bool,
        start: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Solutions<'py>> {
        let problem = self.target(target)?;
        let alphas = alphas.as_array().to_vec();
        let start = start.map(|start| start.as_array().to_vec());
        let descended = run_any(py, None, |_| {
            let penalty = penalty(problem.columns(), positive);
            let descended = estimator.of.descend(problem, &penalty, &alphas, start.as_deref());
            descended.map_err(|error| Failure::of(Kind::Fit)(&error))
        })?;
        solutions(py, problem, &descended)
    }

    /// The alpha of the knot of a target's lasso path with the least AIC, BIC or EBIC.
    fn criterion_alpha(&self, py: Python<'_>, target: usize, positive: bool, criterion: &str) -> PyResult<f64> {
        let problem = self.target(target)?;
        let which = match criterion {
            "aic" => 0,
            "bic" => 1,
            "ebic" => 2,
            other => return Err(Kind::Request.error(format!("criterion={other:?}: give \"aic\", \"bic\" or \"ebic\""))),
        };
        run_any(py, None, |_| {
            let penalty = penalty(problem.columns(), positive);
            let path = lars(problem, &penalty, &LarsOptions::default()).map_err(|e| Failure::of(Kind::Fit)(&e))?;
            let criteria = information_criteria(problem, &penalty, &path, &CriteriaOptions::default());
            let criteria = criteria.map_err(|error| Failure::of(Kind::Fit)(&error))?;
            Ok(criteria.lambdas[criteria.best[which]])
        })
    }

    /// Least squares on some features of a target: coefficients (p) and intercept. Of features that depend on each other, the first carry the fit.
    fn refit<'py>(
        &self,
        py: Python<'py>,
        target: usize,
        support: Vec<usize>,
        positive: bool,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, f64)> {
        let problem = self.target(target)?;
        let p = problem.columns();
        let mut penalty = penalty(p, positive);
        penalty.factors = vec![f64::INFINITY; p];
        for j in support {
            match penalty.factors.get_mut(j) {
                Some(factor) => *factor = 0.0,
                None => return Err(Kind::Request.error(format!("feature {j} of {p} is in the support"))),
            }
        }
        let path = run_any(py, None, |_| {
            lars(problem, &penalty, &LarsOptions::default()).map_err(|error| Failure::of(Kind::Fit)(&error))
        })?;
        let Some(knot) = path.knots.last() else {
            return Err(Kind::Internal.error("a path without knots"));
        };
        Ok((PyArray1::from_vec(py, knot.dense(p)), knot.intercept))
    }
}

impl Problems {
    fn target(&self, target: usize) -> PyResult<&Quadratic> {
        let count = self.targets.len();
        self.targets.get(target).ok_or_else(|| Kind::Request.error(format!("target {target} of {count}")))
    }
}

/// Equal penalties in raw units, and signs.
pub(crate) fn penalty(features: usize, positive: bool) -> Penalty {
    let signs = if positive { vec![Sign::NonNegative; features] } else { Vec::new() };
    Penalty { signs, ..Penalty::default() }
}

fn solutions<'py>(py: Python<'py>, problem: &Quadratic, descended: &[Descended]) -> PyResult<Solutions<'py>> {
    let p = problem.columns();
    let coefficients: Vec<f64> = descended.iter().flat_map(|descended| descended.solution.dense(p)).collect();
    let collect = |value: &dyn Fn(&Descended) -> f64| PyArray1::from_vec(py, descended.iter().map(value).collect());
    // The objective of zero coefficients, which the certificate's gap is relative to.
    let half = 0.5 * problem.target_deviation().powi(2);
    Ok((
        PyArray1::from_vec(py, coefficients).reshape([descended.len(), p])?,
        collect(&|descended| descended.solution.intercept),
        collect(&|descended| half * descended.solution.certificate.gap),
        collect(&|descended| 0.5 * descended.solution.certificate.gap),
        descended.iter().map(|descended| descended.epochs).collect(),
        PyArray1::from_vec(py, descended.iter().map(|descended| descended.solution.converged).collect()),
    ))
}

/// Mean squared errors of the first target on the held-out rows of every fold (alphas x folds). Then the indices of
/// alphas at which the solver of some fold missed its tolerance.
#[pyfunction]
#[pyo3(signature = (folds, alphas, intercept, estimator, positive, progress=None))]
pub(crate) fn fold_errors<'py>(
    py: Python<'py>,
    folds: Vec<Fold>,
    alphas: PyReadonlyArray1<'_, f64>,
    intercept: bool,
    estimator: &Estimator,
    positive: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Vec<usize>)> {
    check_folds(&folds)?;
    let alphas = alphas.as_array().to_vec();
    let options = SelectOptions { estimator: estimator.of.clone(), ..SelectOptions::default() };
    let fold_losses = run_any(py, progress, |progress| {
        progress.stage("folds");
        parallel_map(folds.len(), progress, |fold| {
            let (design, train, test) = &folds[fold];
            let design = design.get().of();
            let problem = first_problem(design, train, intercept)?;
            let penalty = penalty(problem.columns(), positive);
            let solved = solve_grid(&problem, &penalty, &alphas, &options).map_err(|e| Failure::of(Kind::Fit)(&e))?;
            let values = (0..alphas.len()).flat_map(|k| solved.coefficients.col_as_slice(k)).copied();
            let values: Vec<f64> = values.collect();
            let errors = design.mean_squares(Some(test), 0, &values, &solved.intercepts, &Silent)?;
            Ok::<_, Failure>((errors, solved.exact))
        })
    })?;
    let errors = (0..alphas.len()).flat_map(|k| fold_losses.iter().map(move |(errors, _)| errors[k]));
    let errors = PyArray1::from_vec(py, errors.collect()).reshape([alphas.len(), folds.len()])?;
    let inexact = (0..alphas.len()).filter(|&k| fold_losses.iter().any(|(_, exact)| !exact[k])).collect();
    Ok((errors, inexact))
}
