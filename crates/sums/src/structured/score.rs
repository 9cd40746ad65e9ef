//! Errors of coefficients in every task, from the tasks' statistics.

use faer::Mat;
use fleetfoot_stats::SquareRoot;

use super::Structure;

/// The error of a task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaskError {
    /// Mean squared error, in the target's units squared.
    pub mse: f64,
    /// Variance of the target (divisor: weight).
    pub variance: f64,
}

impl TaskError {
    /// Root of the mean squared error.
    pub fn rms(&self) -> f64 {
        self.mse.sqrt()
    }

    /// Share of the target's variance that is explained. NaN for a target that does not vary: its equation is a
    /// balance, and has nothing to explain.
    pub fn r2(&self) -> f64 {
        if self.variance > 0.0 { 1.0 - self.mse / self.variance } else { f64::NAN }
    }
}

impl Structure {
    /// The error of every task at the coefficients theta (p, raw units), on the rows behind the statistics: those of the fit, or others. A sum of squares
    /// throughout ([`SquareRoot::error`]).
    ///
    /// # Panics
    /// When there is not one statistic of the right shape a task, or not p coefficients.
    pub fn errors(&self, roots: &[SquareRoot], theta: &[f64]) -> Vec<TaskError> {
        assert_eq!(
            (roots.len(), theta.len()),
            (self.tasks.len(), self.coefficients()),
            "a statistic a task, p coefficients"
        );
        let of_task = |(task, root): (usize, &SquareRoot)| {
            let columns = self.columns(task);
            let beta = Mat::from_fn(columns.len(), 1, |row, _| theta[columns[row]]);
            let weight = if root.weight > 0.0 { root.weight } else { f64::NAN };
            TaskError { mse: root.error(beta.as_ref(), &[0.0])[0] / weight, variance: root.total[0] / weight }
        };
        roots.iter().enumerate().map(of_task).collect()
    }
}

#[cfg(test)]
mod tests {
    use fleetfoot_stats::{Gram, Preconditioner};

    use super::*;
    use crate::structured::TaskShape;

    #[test]
    fn errors_match_rows() {
        let rows = [[1.0, 2.0, 3.0], [0.5, -1.0, 2.0], [2.0, 0.0, -1.0], [1.5, 1.0, 0.5]];
        let x = Mat::from_fn(4, 3, |i, j| rows[i][j]);
        let root = Preconditioner::identity(2, 1).square_root(&Gram::of_rows(x.as_ref(), None));
        let shape = |latents: Vec<usize>| TaskShape { latents, centred: false, prior: false };
        let structure = Structure { functions: vec![1, 1], tasks: vec![shape(vec![1, 0])] };
        let theta = [0.7, -0.2];
        let error = structure.errors(&[root], &theta)[0];
        let squares = rows.iter().map(|[a, b, y]| (y - a * theta[1] - b * theta[0]).powi(2)).sum::<f64>();
        let mean = rows.iter().map(|row| row[2]).sum::<f64>() / 4.0;
        let variance = rows.iter().map(|row| (row[2] - mean).powi(2)).sum::<f64>() / 4.0;
        assert!((error.mse - squares / 4.0).abs() < 1e-14 && (error.variance - variance).abs() < 1e-14);
        assert!((error.r2() - (1.0 - squares / 4.0 / variance)).abs() < 1e-14);
    }
}
