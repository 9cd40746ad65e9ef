//! The group lasso, and a problem made ready for it.

use super::{
    block::{Block, blocks},
    groups::Groups,
    shape::AtLambda,
};
use crate::{
    Certificate, Penalty, Quadratic, SparseError,
    certificate::certify,
    kernel::Slab,
    penalty::{Weights, check_ratio, check_strength},
};

/// The group lasso and the sparse-group lasso:
///
/// `1/(2n) rss + lambda ((1 - l1_ratio) sum_g w_g |v_g| + l1_ratio sum_j |v_j|)`, `v_j = f_j u_j b_j`
///
/// with penalty factors f and units u of the [`Penalty`], whose signs hold too.
///
/// Block coordinate descent on the compressed problem, a group at a time. If the penalty is the group's norm alone, the
/// step is exact (by the eigenvalues of its Gram block and a secular equation). If single coefficients may also become
/// zero, the steps are proximal. Working sets follow the sequential strong rule and are checked against all groups;
/// Newton steps give the last digits. Every solution has its duality gap, the dual point scaled by the exact dual norm.
/// The bits are the same on any number of threads.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupLasso {
    /// Groups of columns.
    pub groups: Groups,
    /// Share of the absolute values in the penalty: 0 is the group lasso, 1 the lasso.
    pub l1_ratio: f64,
    /// The violation of the optimality conditions, as a correlation, at which a solution is good ([`CoordinateOptions::tolerance`](crate::coordinate::CoordinateOptions)).
    pub tolerance: f64,
    /// The most sweeps over the working set, a lambda.
    pub max_epochs: usize,
    /// Lambdas of a path, in equal factors from the largest down.
    pub count: usize,
    /// The smallest of them over the largest.
    pub ratio: f64,
}

impl GroupLasso {
    /// The group lasso with these groups, paths of 100 lambdas over four decades.
    pub fn new(groups: Groups) -> Self {
        Self { groups, l1_ratio: 0.0, tolerance: 1e-9, max_epochs: 10_000, count: 100, ratio: 1e-4 }
    }

    /// The certificate of coefficients (p, raw units) at lambda, whoever computed them.
    ///
    /// # Errors
    /// When the penalty, the groups, an option or lambda is out of range, or a length is not that of the problem.
    pub fn certificate(
        &self,
        problem: &Quadratic,
        penalty: &Penalty,
        lambda: f64,
        coefficients: &[f64],
    ) -> Result<Certificate, SparseError> {
        check_strength("lambda", lambda)?;
        let posed = Posed::new(self, problem, penalty)?;
        let scaled = posed.scaled(problem, coefficients, "the coefficients")?;
        let delta = Slab::from_fn(problem.columns(), 1, |j, _| scaled[j]);
        let (mut certified, _) = certify(problem, &posed.weights, 0.0, &[posed.at(lambda)], &delta).remove(0);
        // A column that takes no part has no place in correlation form.
        if (0..problem.columns()).any(|j| coefficients[j] != 0.0 && !posed.weights.used(j)) {
            certified.kkt = f64::INFINITY;
        }
        Ok(certified)
    }
}

/// A problem with its groups, checked, in correlation form.
pub(super) struct Posed {
    pub(super) weights: Weights,
    pub(super) blocks: Vec<Block>,
    /// The block of every column.
    of: Vec<Option<usize>>,
}

impl Posed {
    pub(super) fn new(lasso: &GroupLasso, problem: &Quadratic, penalty: &Penalty) -> Result<Self, SparseError> {
        check_ratio(lasso.l1_ratio)?;
        let weights = Weights::new(problem, penalty)?;
        let group = lasso.groups.checked(problem.columns(), penalty)?;
        let blocks = blocks(&weights, &lasso.groups.of, &group, lasso.l1_ratio);
        let mut of = vec![None; problem.columns()];
        for (at, block) in blocks.iter().enumerate() {
            block.columns.iter().for_each(|&j| of[j] = Some(at));
        }
        Ok(Self { weights, blocks, of })
    }

    /// The penalty at lambda, in the units of the target.
    pub(super) fn at(&self, lambda: f64) -> AtLambda<'_> {
        AtLambda { blocks: &self.blocks, of: &self.of, lambda: lambda / self.weights.tau }
    }

    /// Raw coefficients in correlation form; 0 of columns that take no part.
    pub(super) fn scaled(&self, problem: &Quadratic, raw: &[f64], what: &'static str) -> Result<Vec<f64>, SparseError> {
        let (count, expected) = (raw.len(), problem.columns());
        if count != expected {
            return Err(SparseError::Length { what, actual: count, expected });
        }
        if let Some(column) = raw.iter().position(|value| !value.is_finite()) {
            return Err(SparseError::ColumnNotFinite { column });
        }
        let size = problem.target_length();
        let scaled = |(j, value): (usize, &f64)| {
            if self.weights.used(j) { value * (problem.length[j] / size) } else { 0.0 }
        };
        Ok(raw.iter().enumerate().map(scaled).collect())
    }
}
