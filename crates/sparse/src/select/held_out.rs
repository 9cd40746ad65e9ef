//! Errors on rows that did not train, from their square-root forms.

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::matmul};
use fleetfoot_stats::SquareRoot;

use super::SelectError;
use crate::{SparseError, structured::Assembly};
use fleetfoot_sums::structured::Structure;

/// Coefficients whose errors are computed at once.
const BATCH: usize = 64;

/// Held-out rows, ready to score solutions of the problem that they were kept from.
#[derive(Debug, Clone)]
pub struct HeldOut {
    tasks: Vec<HeldOutTask>,
    /// Scale of the columns in the training problem (p).
    scale: Vec<f64>,
    weight: f64,
}

#[derive(Debug, Clone)]
struct HeldOutTask {
    root: SquareRoot,
    target: usize,
    columns: Vec<usize>,
    weight: f64,
}

/// Coefficients of a solver, one column a lambda (p x lambdas), and their intercepts.
#[derive(Debug, Clone)]
pub(crate) struct Coefficients {
    pub(crate) values: Mat<f64>,
    pub(crate) intercepts: Vec<f64>,
}

impl HeldOut {
    /// The measured tasks of a structure; priors are not scored. `scale` is that of the training problem
    /// ([`Assembled::scale`](crate::structured::Assembled::scale)); scores weigh the tasks by [`Assembly::weights`].
    ///
    /// # Errors
    /// When there is not one statistic and one weight a task.
    pub fn tasks(
        structure: &Structure,
        roots: &[SquareRoot],
        assembly: &Assembly,
        scale: Vec<f64>,
    ) -> Result<Self, SelectError> {
        let expected = structure.tasks.len();
        for (what, length) in [("the held-out statistics", roots.len()), ("the task weights", assembly.weights.len())] {
            if length != expected {
                return Err(SparseError::Length { what, actual: length, expected }.into());
            }
        }
        let measured = (0..expected).filter(|&task| !structure.tasks[task].prior);
        let tasks: Vec<HeldOutTask> = measured
            .map(|task| HeldOutTask {
                root: roots[task].clone(),
                target: 0,
                columns: structure.columns(task),
                weight: assembly.weights[task],
            })
            .collect();
        let weight = tasks.iter().map(|task| task.root.weight).fold(0.0, f64::max);
        Ok(Self { tasks, scale, weight })
    }

    /// One target of one statistic, whose training problem is in raw units ([`Quadratic::from_square_root`](crate::Quadratic::from_square_root)).
    ///
    /// # Errors
    /// When the target does not exist.
    pub fn target(root: SquareRoot, target: usize) -> Result<Self, SelectError> {
        let (p, targets) = (root.regressors(), root.targets());
        if target >= targets {
            return Err(SparseError::NoSuchTarget { target, targets }.into());
        }
        let weight = root.weight;
        let task = HeldOutTask { root, target, columns: (0..p).collect(), weight: 1.0 };
        Ok(Self { tasks: vec![task], scale: vec![1.0; p], weight })
    }

    /// Sum of the row weights.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// Number of scored tasks.
    pub fn len(&self) -> usize {
        self.tasks.len()
    }

    /// Returns true if there is nothing to score.
    pub fn is_empty(&self) -> bool {
        self.tasks.is_empty()
    }

    /// Number of coefficients, p.
    pub fn coefficients(&self) -> usize {
        self.scale.len()
    }

    /// Weighted mean squared error of every task in the units of its target (tasks x lambdas).
    pub(crate) fn errors(&self, solved: &Coefficients) -> Mat<f64> {
        let count = solved.values.ncols();
        let theta = Mat::from_fn(self.scale.len(), count, |j, k| solved.values[(j, k)] / self.scale[j]);
        let mut errors = Mat::zeros(self.tasks.len(), count);
        for first in (0..count).step_by(BATCH) {
            let width = BATCH.min(count - first);
            for (t, task) in self.tasks.iter().enumerate() {
                let squares =
                    task.squares(theta.as_ref().subcols(first, width), &solved.intercepts[first..first + width]);
                squares.iter().enumerate().for_each(|(k, square)| errors[(t, first + k)] = square / task.root.weight);
            }
        }
        errors
    }

    /// `sum_t s_t mse_t` of a column of [`HeldOut::errors`].
    pub(crate) fn total(&self, errors: MatRef<'_, f64>, k: usize) -> f64 {
        self.tasks.iter().enumerate().map(|(t, task)| task.weight * errors[(t, k)]).sum()
    }
}

/// Weighted mean squared errors of models of one target (p x k, in raw units), whose intercepts are given.
pub(crate) fn mean_squares(root: SquareRoot, target: usize, models: MatRef<'_, f64>, intercepts: &[f64]) -> Vec<f64> {
    let weight = root.weight;
    let task = HeldOutTask { columns: (0..root.regressors()).collect(), root, target, weight: 1.0 };
    task.squares(models, intercepts).into_iter().map(|square| square / weight).collect()
}

impl HeldOutTask {
    /// `|R theta - z|^2 + residual + weight (mean error)^2`: a sum of squares throughout, nothing cancels.
    fn squares(&self, theta: MatRef<'_, f64>, intercepts: &[f64]) -> Vec<f64> {
        let (d, root) = (self.columns.len(), &self.root);
        let coefficients = Mat::from_fn(d, theta.ncols(), |k, l| theta[(self.columns[k], l)]);
        let mut left = Mat::zeros(d, theta.ncols());
        matmul(left.as_mut(), Accum::Replace, root.r.as_ref(), coefficients.as_ref(), 1.0, Par::Seq);
        let square = |l: usize| {
            let z = root.z.col_as_slice(self.target);
            let shape: f64 = left
                .col_as_slice(l)
                .iter()
                .zip(z)
                .map(|(col_as_slice, z)| (col_as_slice - z) * (col_as_slice - z))
                .sum();
            let predicted: f64 =
                coefficients.col_as_slice(l).iter().zip(&root.mean_x).map(|(theta, mean)| theta * mean).sum();
            let mean = root.mean_y[self.target] - intercepts[l] - predicted;
            shape + root.residual[self.target].max(0.0) + root.weight * mean * mean
        };
        (0..theta.ncols()).map(square).collect()
    }
}
