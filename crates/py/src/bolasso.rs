//! Bolasso: which features the lassos of many resamples of the rows agree on.

use std::sync::Arc;

use fleetfoot::{
    data::EpisodeId,
    library::Expr,
    sparse::{
        Sign,
        bolasso::{
            BolassoError, BootstrapOptions, BootstrapUnit, DenseBootstrap, Selection, block_bootstrap, dense_bootstrap,
            multinomial_counts, poisson_counts, row_bootstrap,
        },
        dense::DenseRows,
        structured::Assembly,
    },
    sums::structured::{Banks, Candidates, Plan, Regression, Task, Term},
};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

use crate::{
    array::{Array, Arrays},
    array_source::ArraySource,
    design::Borrowed,
    error::Kind,
    run::{Failure, guard, run_any},
};

/// Request of a bolasso: a dictionary in Python.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct BolassoRequest {
    /// Penalty of every target's lassos (q).
    alphas: Vec<f64>,
    /// Root mean square of every target about its mean (q): tasks are solved together, each in separate units.
    scales: Vec<f64>,
    intercept: bool,
    positive: bool,
    replicates: usize,
    seed: u64,
    /// Unit that a replicate draws: rows, blocks of rows, or groups.
    unit: String,
    /// Rows of every block or group, one after the other; of rows the whole.
    lengths: Vec<usize>,
}

/// Selection frequencies (q x p), mean signs (q x p), coefficients of all replicates (b x q x p) and their intercepts
/// (b x q). Then the largest violation of the optimality conditions as a correlation, replicates whose solver missed
/// its tolerance, and replicates without rows.
type BolassoResult<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray2<f64>>,
    f64,
    usize,
    usize,
);

/// The lassos of all targets on resamples of the rows of X (n x p) and y (n or n x q) with weights (n).
#[pyfunction]
#[pyo3(signature = (x, y, weights, request, progress=None))]
pub(crate) fn bolasso<'py>(
    x: &Bound<'py, PyAny>,
    y: &Bound<'py, PyAny>,
    weights: Option<&Bound<'py, PyAny>>,
    request: BolassoRequest,
    progress: Option<Py<PyAny>>,
) -> PyResult<BolassoResult<'py>> {
    let py = x.py();
    let (x, y) = (Array::of(x, "X")?, Array::of(y, "y")?);
    let (features, targets) = (x.columns(), y.columns());
    for given in [request.alphas.len(), request.scales.len()] {
        if given != targets {
            return Err(
                Kind::Request.error(format!("{given} alphas or scales for {targets} targets: give one a target"))
            );
        }
    }
    // A replicate's counts are fewer than its products.
    if features > MOST_PRODUCTS && 2 * x.rows() <= features * features {
        let selection = request.of_rows(py, Borrowed::dense(x, y), weights, progress)?;
        return unpacked(py, &selection, request.intercept, [targets, features]);
    }
    let names = |prefix: &str, count: usize| (0..count).map(|k| format!("{prefix}{k}")).collect::<Vec<String>>();
    let mut arrays = vec![(x, names("x", features)), (y, names("y", targets))];
    if let Some(weights) = weights {
        arrays.push((Array::of(weights, "sample_weight")?, vec!["weight".into()]));
    }
    let regression = request.regression(features, targets, weights.is_some());
    let source = ArraySource::new(Arrays::new("X".into(), arrays)?, &request.lengths)?;
    let (assembly, lambda) = request.assembly(features);
    let options = BootstrapOptions { replicates: request.replicates, lambda, seed: request.seed, threshold: 1.0 };
    let selection = run_any(py, progress, |progress| {
        progress.stage("resamples");
        let selection = match request.unit.as_str() {
            "rows" => {
                let plan =
                    Plan { regression, also: Vec::new(), chunk_rows: ROWS_OF_CHUNK, preconditioners: Vec::new() };
                row_bootstrap(&plan, &assembly, &source, &options, progress)
            }
            _ => {
                // A block is an episode of its own: its length was asked for, and chunks would be joined.
                let unit = BootstrapUnit::Episode;
                let plan = Plan::new(regression, Vec::new(), ROWS_OF_CHUNK, &source).map_err(BolassoError::from);
                plan.and_then(|plan| {
                    let banks = Banks::new(&plan.scan(&source, progress)?, |_| true);
                    block_bootstrap(&plan.regression.structure(), &banks, &assembly, unit, &options, progress)
                })
            }
        };
        selection.map_err(|error| match error {
            BolassoError::Cancelled(cancelled) => cancelled.into(),
            error => Failure::of(Kind::Fit)(&error),
        })
    })?;
    unpacked(py, &selection, request.intercept, [targets, features])
}

/// Rows that are summed together where resampling does not say.
const ROWS_OF_CHUNK: usize = 16_384;

/// Features up to which replicates are their products; of more, unless they have many more rows, the rows are resampled as they lie.
const MOST_PRODUCTS: usize = 512;

impl BolassoRequest {
    /// The lassos of the replicates on their rows.
    fn of_rows(
        &self,
        py: Python<'_>,
        rows: Borrowed,
        weights: Option<&Bound<'_, PyAny>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Selection> {
        let weights =
            weights.map(|weights| Ok::<_, PyErr>(Array::of(weights, "sample_weight")?.values(&[0], 0..rows.rows())));
        let weights = weights.transpose()?.and_then(|columns| columns.into_iter().next());
        let rows: Arc<dyn DenseRows> = Arc::new(rows);
        let (lambdas, intercept, positive) = (self.alphas.clone(), self.intercept, self.positive);
        run_any(py, progress, |progress| {
            progress.stage("resamples");
            let request = DenseBootstrap { lambdas, intercept, positive, counts: self.counts(), threshold: 1.0 };
            let bootstrap = dense_bootstrap(&rows, weights.as_deref(), &request, progress);
            bootstrap.map_err(|error| Failure::of(Kind::Fit)(&error))
        })
    }

    /// Counts with which every replicate draws every row (replicates x rows).
    fn counts(&self) -> Vec<Vec<f64>> {
        if self.unit == "rows" {
            let rows = self.lengths.iter().sum();
            let counts = poisson_counts(self.seed, EpisodeId(0), 0, rows, self.replicates);
            return (0..self.replicates).map(|b| (0..rows).map(|row| counts[(b, row)]).collect()).collect();
        }
        let drawn = |replicate| multinomial_counts(self.seed, replicate, self.lengths.len());
        let rows = |counts: Vec<f64>| {
            counts.iter().zip(&self.lengths).flat_map(|(&count, &rows)| std::iter::repeat_n(count, rows)).collect()
        };
        (0..self.replicates).map(|replicate| rows(drawn(replicate))).collect()
    }

    /// A separate latent for every target: the tasks share the rows and their counts, and nothing else.
    fn regression(&self, features: usize, targets: usize, weighted: bool) -> Regression {
        let column = |name: String| Expr::column(name.as_str());
        let mut functions: Vec<Expr> = (0..features).map(|j| column(format!("x{j}"))).collect();
        functions.extend(self.intercept.then(|| Expr::number(1.0)));
        let name = |k: usize| format!("y{k}");
        Regression {
            latents: (0..targets).map(|k| Candidates { name: name(k), functions: functions.clone() }).collect(),
            tasks: (0..targets)
                .map(|k| Task {
                    name: name(k),
                    target: column(name(k)),
                    terms: vec![Term { latent: k, coefficient: Expr::number(1.0) }],
                    prior: false,
                })
                .collect(),
            weight: weighted.then(|| column("weight".into())),
        }
    }

    /// Tasks in units of their targets, raw features, the intercept free; and the strength that the latents' penalties are relative to.
    fn assembly(&self, features: usize) -> (Assembly, f64) {
        let weights: Vec<f64> =
            self.scales.iter().map(|scale| if *scale > 0.0 { scale.powi(-2) } else { 1.0 }).collect();
        let strengths: Vec<f64> = self.alphas.iter().zip(&weights).map(|(alpha, weight)| alpha * weight).collect();
        let lambda = strengths.iter().copied().fold(0.0, f64::max);
        let share = |strength: &f64| if lambda > 0.0 { strength / lambda } else { 1.0 };
        let per_target = |feature: f64, constant: f64| {
            let columns_of_feature = std::iter::repeat_n(feature, features).chain(self.intercept.then_some(constant));
            columns_of_feature.collect::<Vec<f64>>().repeat(self.alphas.len())
        };
        let sign = |value: f64| if value > 0.0 { Sign::NonNegative } else { Sign::Free };
        let signs = if self.positive { per_target(1.0, 0.0).into_iter().map(sign).collect() } else { Vec::new() };
        let latents = strengths.iter().map(share).collect();
        let factors = per_target(1.0, 0.0);
        (Assembly { weights, latents, factors, signs, raw: true, tikhonov: None }, lambda)
    }
}

fn unpacked<'py>(
    py: Python<'py>,
    selection: &Selection,
    intercept: bool,
    [targets, features]: [usize; 2],
) -> PyResult<BolassoResult<'py>> {
    let width = features + usize::from(intercept);
    let place = |k: usize, j: usize| k * width + j;
    let places = || (0..targets).flat_map(|k| (0..features).map(move |j| place(k, j)));
    let pick =
        |values: &[f64]| PyArray1::from_vec(py, places().map(|at| values[at]).collect()).reshape([targets, features]);
    let replicates = selection.coefficients.nrows();
    let all = (0..replicates).flat_map(|b| places().map(move |at| selection.coefficients[(b, at)]));
    let constant = |b: usize, k: usize| if intercept { selection.coefficients[(b, place(k, features))] } else { 0.0 };
    let constants = (0..replicates).flat_map(|b| (0..targets).map(move |k| constant(b, k)));
    Ok((
        pick(&selection.frequency)?,
        pick(&selection.sign)?,
        PyArray1::from_vec(py, all.collect()).reshape([replicates, targets, features])?,
        PyArray1::from_vec(py, constants.collect()).reshape([replicates, targets])?,
        selection.worst_kkt,
        selection.unconverged,
        selection.empty,
    ))
}

/// Counts with which every replicate draws every row (replicates x rows), of groups of these lengths one after the
/// other: Poisson(1) counts.
#[pyfunction]
pub(crate) fn row_counts<'py>(
    py: Python<'py>,
    seed: u64,
    lengths: Vec<usize>,
    replicates: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    guard(|| {
        let parts: Vec<_> = (lengths.iter().enumerate())
            .map(|(k, &rows)| poisson_counts(seed, EpisodeId(k as u128), 0, rows, replicates))
            .collect();
        let parts = &parts;
        let counts = (0..replicates)
            .flat_map(|b| parts.iter().flat_map(move |part| (0..part.ncols()).map(move |row| part[(b, row)])));
        PyArray1::from_vec(py, counts.collect()).reshape([replicates, lengths.iter().sum()])
    })
}

/// Counts with which every replicate draws every unit (replicates x units): as many draws with replacement as there are
/// units.
#[pyfunction]
pub(crate) fn unit_counts<'py>(
    py: Python<'py>,
    seed: u64,
    units: usize,
    replicates: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    guard(|| {
        let counts = (0..replicates).flat_map(|replicate| multinomial_counts(seed, replicate, units));
        PyArray1::from_vec(py, counts.collect()).reshape([replicates, units])
    })
}
