//! Moments of a polynomial plan side by side: every reweighting of them is one matrix product.

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::matmul};

use super::{PolynomialMoments, PolynomialPlan};
use crate::Gram;

/// Columns of weights that are multiplied at once.
const BATCH: usize = 32;

/// [`crate::Bank`] of moments: a Gram matrix is linear in them, and made when it is asked for.
#[derive(Debug, Clone)]
pub struct PolynomialBank {
    rows: Vec<u64>,
    /// Sums x members.
    sums: Mat<f64>,
}

impl PolynomialBank {
    /// These moments, in this order.
    ///
    /// # Panics
    /// When they belong to plans of different shapes.
    pub fn new<'a>(moments: impl IntoIterator<Item = &'a PolynomialMoments>) -> Self {
        let moments: Vec<&PolynomialMoments> = moments.into_iter().collect();
        let mut sums = Mat::zeros(moments.first().map_or(0, |member| member.sums()), moments.len());
        for (k, member) in moments.iter().enumerate() {
            assert_eq!(member.sums(), sums.nrows(), "moments of one plan");
            (0..sums.nrows()).for_each(|i| sums[(i, k)] = member.total(i));
        }
        Self { rows: moments.iter().map(|member| member.rows()).collect(), sums }
    }

    /// Number of members.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Returns true if the bank has no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Rows of every member.
    pub fn rows(&self) -> &[u64] {
        &self.rows
    }

    /// For every column of `weights` (members x b; finite, not negative) the Gram matrix ([`PolynomialPlan::gram`]) of all rows with each member's row weights
    /// multiplied by its weight. `rows` is the sum of the members' rows times their weights, rounded.
    ///
    /// The bits of a column of the answer do not depend on the other columns.
    ///
    /// # Panics
    /// When there is not one weight a member, or the moments belong to a plan of another shape.
    pub fn combine(&self, plan: &PolynomialPlan, weights: MatRef<'_, f64>) -> Vec<Gram> {
        assert_eq!(weights.nrows(), self.len(), "one weight a member");
        if self.is_empty() {
            return vec![plan.gram(&plan.moments()); weights.ncols()];
        }
        let mut grams = Vec::with_capacity(weights.ncols());
        // Batches of one width, the last padded: the kernel that a column meets, and so its bits, are always the same.
        for first in (0..weights.ncols()).step_by(BATCH) {
            let count = BATCH.min(weights.ncols() - first);
            let padded = Mat::from_fn(self.len(), BATCH, |k, b| if b < count { weights[(k, first + b)] } else { 0.0 });
            let mut sums = Mat::zeros(self.sums.nrows(), BATCH);
            matmul(sums.as_mut(), Accum::Replace, self.sums.as_ref(), padded.as_ref(), 1.0, Par::Seq);
            for b in 0..count {
                let rows: f64 = (0..self.len()).map(|k| padded[(k, b)] * self.rows[k] as f64).sum();
                grams.push(plan.gram_of(rows.round() as u64, sums.col_as_slice(b)));
            }
        }
        grams
    }
}
