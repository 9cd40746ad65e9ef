//! Residuals and Jacobian of all rows at given parameters: the interface between a descent and a problem.

use faer::Mat;
use fleetfoot_data::{Progress, Source};
use fleetfoot_stats::Factor;

pub(crate) use crate::evaluation::{Evaluation, LinearPart};
use crate::{
    EstimateError,
    limits::Limits,
    problem::Problem,
    rows::{Rows, Scan, unfold},
};

/// A sum of squares to be minimised between bounds.
pub(crate) trait Objective {
    /// Least and greatest value of every parameter.
    fn bounds(&self) -> &[[f64; 2]];

    /// Matrices of parameters that keep a bound, where there are any.
    fn limits(&self) -> Option<&Limits> {
        None
    }

    /// Residuals a row.
    fn residuals(&self) -> usize;

    /// Numbers that the rows are to determine.
    fn unknowns(&self) -> usize;

    /// Residuals and Jacobian at `theta`.
    fn evaluate(&self, theta: &[f64]) -> Result<Pass, EstimateError>;
}

/// Result of a pass.
pub(crate) enum Pass {
    Finite(Evaluation),
    /// Parameters that cannot be, and why.
    Refused(EstimateError),
}

/// A problem over the rows of a source.
pub(crate) struct Nonlinear<'a> {
    pub(crate) problem: &'a Problem,
    rows: Rows<'a>,
}

impl<'a> Nonlinear<'a> {
    pub(crate) fn new(
        problem: &'a Problem,
        source: &'a dyn Source,
        chunk_rows: usize,
        progress: &'a dyn Progress,
    ) -> Self {
        Self { problem, rows: Rows::new(&problem.layout, source, chunk_rows, progress) }
    }

    /// Compressed rows of all residuals, and the squares that each has of the cost, in them and beyond.
    fn stack(&self, factors: &[Factor]) -> (Mat<f64>, Vec<f64>, Vec<[f64; 2]>) {
        let slopes = &self.problem.slopes;
        let mut jacobian = Mat::zeros(slopes.iter().map(|of| of.len() + 1).sum(), self.problem.bounds.len());
        let (mut rhs, mut shares) = (Vec::with_capacity(jacobian.nrows()), Vec::with_capacity(factors.len()));
        for (parameters, factor) in slopes.iter().zip(factors) {
            let part = unfold(factor);
            for (column, &j) in parameters.iter().enumerate() {
                let values = part.columns.col_as_slice(column);
                jacobian.col_as_slice_mut(j)[rhs.len()..rhs.len() + values.len()].copy_from_slice(values);
            }
            shares.push([part.rhs.iter().map(|r| r * r).sum(), part.beyond]);
            rhs.extend(part.rhs);
        }
        (jacobian, rhs, shares)
    }

    fn score(&self, factors: &[Factor]) -> Vec<f64> {
        let (jacobian, rhs, _) = self.stack(factors);
        (0..jacobian.ncols()).map(|j| jacobian.col_as_slice(j).iter().zip(&rhs).map(|(a, r)| a * r).sum()).collect()
    }
}

impl Objective for Nonlinear<'_> {
    fn bounds(&self) -> &[[f64; 2]] {
        &self.problem.bounds
    }

    fn limits(&self) -> Option<&Limits> {
        self.problem.limits.as_ref()
    }

    fn residuals(&self) -> usize {
        self.problem.slopes.len()
    }

    fn unknowns(&self) -> usize {
        self.problem.bounds.len()
    }

    fn evaluate(&self, theta: &[f64]) -> Result<Pass, EstimateError> {
        let mut scores = Vec::new();
        let sums = match self.rows.scan(theta, |factors| scores.push(self.score(factors)))? {
            Scan::Complete(sums) => sums,
            Scan::Refused(error) => return Ok(Pass::Refused(error)),
        };
        let (jacobian, rhs, shares) = self.stack(&sums.factors);
        let cost = rhs.iter().map(|r| r * r).sum::<f64>() + shares.iter().map(|share| share[1]).sum::<f64>();
        let shares = shares.iter().map(|[within, beyond]| within + beyond).collect();
        let (targets, rows) = (sums.targets.iter().sum(), sums.rows);
        Ok(Pass::Finite(Evaluation {
            jacobian,
            rhs,
            cost,
            targets,
            rows,
            scores,
            linear: Vec::new(),
            shares,
            ended: 0,
        }))
    }
}
