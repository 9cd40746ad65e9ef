//! The assembled problem of a statistic: weights of the tasks, penalty factors, signs.

use fleetfoot_data::setting::{INFO_VALUES, TASKS};
use fleetfoot_dataset::StatisticFile;
use fleetfoot_library::Expr;
use fleetfoot_sparse::{
    adaptive::{Initial, adaptive},
    estimator::{ElasticNet, Estimator},
    group::{GroupLasso, Groups},
    structured::{Assembled, Assembly, assemble},
};
use fleetfoot_stats::{Key, SquareRoot};
use fleetfoot_sums::structured::{Banks, Structure};
use fleetfoot_task::StructuredTask;

use super::SparseOptions;
use crate::error::Error;

/// A regression as the solvers see it.
pub(super) struct Problem<'a> {
    pub(super) task: &'a StructuredTask,
    pub(super) structure: Structure,
    pub(super) banks: Banks,
    /// The square-root form of every task over all members.
    pub(super) roots: Vec<SquareRoot>,
    pub(super) assembly: Assembly,
    pub(super) assembled: Assembled,
    /// Estimator at every lambda.
    pub(super) estimator: Estimator,
    /// The error of every task that counts as one.
    pub(super) scales: Vec<f64>,
}

impl<'a> Problem<'a> {
    /// From the members of a statistic that `wanted` selects.
    pub(super) fn new(
        task: &'a StructuredTask,
        file: &StatisticFile,
        options: &SparseOptions,
        wanted: impl Fn(&Key) -> bool,
    ) -> Result<Self, Error> {
        let structure = task.regression.structure();
        let banks = Banks::new(&file.scanned, wanted);
        let roots = if banks.keys().is_empty() { Vec::new() } else { banks.total() };
        if roots.iter().all(|root| root.weight <= 0.0) {
            return Err(Error::too_few_rows(
                0,
                1,
                format!(
                    "no rows: every row lacks a value, or has the weight 0; {INFO_VALUES} tells which columns have missing values"
                ),
            ));
        }
        let mut scales = Vec::with_capacity(roots.len());
        for (index, root) in roots.iter().enumerate() {
            scales.push(scale(task, index, root)?);
        }
        let weights = scales
            .iter()
            .enumerate()
            .map(|(index, scale)| task.strengths[index].unwrap_or(options.prior_strength) / (scale * scale));
        let mut assembly = Assembly {
            weights: weights.collect(),
            factors: task.penalties.clone(),
            signs: task.signs.clone(),
            raw: options.unscaled,
            ..Assembly::default()
        };
        let mut assembled = assemble(&structure, &roots, &assembly)?;
        if options.adaptive {
            assembly.factors = first_fit(&assembled)?;
            assembled.penalty.factors.clone_from(&assembly.factors);
        }
        let estimator = estimator(task, options)?;
        Ok(Self { task, structure, banks, roots, assembly, assembled, estimator, scales })
    }

    /// Rows of positive weight, of the task that has most.
    pub(super) fn rows(&self) -> f64 {
        self.roots.iter().map(|root| root.rows).max().unwrap_or(0) as f64
    }

    /// Number of episodes.
    pub(super) fn episodes(&self) -> usize {
        let mut episodes: Vec<_> = self.banks.keys().iter().map(|key| key.episode).collect();
        episodes.dedup();
        episodes.len()
    }

    /// A coefficient, for people: `T: N1*rho^2`.
    pub(super) fn name(&self, coefficient: usize) -> String {
        let latent = self.structure.latent_of()[coefficient];
        let candidates = &self.task.regression.latents[latent];
        let function = &candidates.functions[coefficient - self.task.regression.first(latent)];
        format!("{}: {function}", candidates.name)
    }
}

/// The penalty of the options on the functions of a task.
fn estimator(task: &StructuredTask, options: &SparseOptions) -> Result<Estimator, Error> {
    let Some(groups) = &options.groups else { return Ok(ElasticNet::new(options.l1_ratio).into()) };
    let latents = task.regression.latents.iter().enumerate();
    let functions: Vec<(usize, &Expr)> =
        latents.flat_map(|(index, latent)| latent.functions.iter().map(move |function| (index, function))).collect();
    Ok(GroupLasso { l1_ratio: options.l1_ratio, ..GroupLasso::new(Groups::new(groups.labels(&functions)?)) }.into())
}

/// The error of a task that counts as one: the recipe's value, else the standard deviation of the target, or for a
/// prior its root mean square.
fn scale(task: &StructuredTask, index: usize, root: &SquareRoot) -> Result<f64, Error> {
    if let Some(scale) = task.scales[index] {
        return Ok(scale);
    }
    let task = &task.regression.tasks[index];
    let (variance, mean) = (root.total[0] / root.weight, root.mean_y[0]);
    let size = (variance + mean * mean).sqrt();
    let is_constant = variance <= (1e-12 * mean).powi(2);
    // A rate that is constant is that of a state that varies.
    if is_constant && root.rows > 1 && mean != 0.0 && !task.prior && !task.target.reads_clock() {
        return Err(Error::undetermined(format!(
            "{}: the target `{}` has the same value {mean} in all rows: there is nothing to predict; leave it out, check its column, or add `scale`, the \
             error that counts as one, in its units",
            TASKS.entry(&task.name),
            task.target
        )));
    }
    let scale = if task.prior || is_constant { size } else { variance.sqrt() };
    if scale > 0.0 && scale.is_finite() {
        return Ok(scale);
    }
    Err(Error::undetermined(if task.prior {
        format!("{}: `{}` is zero or not finite everywhere in the data; give `prior_scale`", task.name, task.target)
    } else {
        format!(
            "{}: the target `{}` is zero or not finite everywhere in the data; add `scale`, the error that counts as one, in its units",
            TASKS.entry(&task.name),
            task.target
        )
    }))
}

/// Penalty factors of the adaptive lasso; from least squares, or from a slight ridge where columns depend on each other.
fn first_fit(assembled: &Assembled) -> Result<Vec<f64>, Error> {
    let (problem, penalty) = (&assembled.problem, &assembled.penalty);
    let adapted = match adaptive(problem, penalty, Initial::LeastSquares, 1.0) {
        Err(fleetfoot_sparse::SparseError::NeedsRidge { .. }) => {
            adaptive(problem, penalty, Initial::Ridge { l2: RIDGE }, 1.0)
        }
        other => other,
    };
    Ok(adapted?.factors)
}

/// Weight of the squares, for columns of unit scale, of the first fit where least squares has no single answer.
const RIDGE: f64 = 1e-8;
