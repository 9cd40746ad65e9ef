//! Covariance of the parameters, and parameters that the rows do not determine.

use faer::Mat;
use fleetfoot_stats::svd;

use crate::{EstimateError, evaluate::Evaluation, step::rank_level};

/// The inverse of J'J over the free parameters, as a root: `H^-1 = root root'`.
pub(crate) struct Inverse {
    /// (p x rank); rows of fixed parameters are 0.
    root: Mat<f64>,
    /// Condition of the independent free columns of J, each scaled to unit length.
    pub(crate) condition: f64,
    /// Free parameters that the rows do not determine.
    pub(crate) undetermined: Vec<usize>,
}

impl Inverse {
    /// `held` are directions (of the free parameters each) in which nothing moves.
    pub(crate) fn new(
        at: &Evaluation,
        scale: &[f64],
        free: &[usize],
        held: &[Vec<f64>],
    ) -> Result<Self, EstimateError> {
        if !held.is_empty() {
            return Self::along(at, scale, free, held);
        }
        let scaled = Mat::from_fn(at.rhs.len(), free.len(), |i, k| at.jacobian[(i, free[k])] / scale[free[k]]);
        let factors = svd(scaled.as_ref()).ok_or(EstimateError::Overflow)?;
        let least = factors.s.first().map_or(0.0, |largest| largest * rank_level(free.len()));
        let rank = factors.s.iter().filter(|&&s| s > least).count();
        let mut root = Mat::zeros(scale.len(), rank);
        for (k, &j) in free.iter().enumerate() {
            (0..rank).for_each(|i| root[(j, i)] = factors.v[(k, i)] / factors.s[i] / scale[j]);
        }
        let unseen = |k: usize| (rank..free.len()).any(|i| factors.v[(k, i)].abs() > 1e-6);
        Ok(Self {
            root,
            condition: if rank > 0 { factors.s[0] / factors.s[rank - 1] } else { 1.0 },
            undetermined: (0..free.len()).filter(|&k| unseen(k)).map(|k| free[k]).collect(),
        })
    }

    /// In the plane orthogonal to the held directions.
    fn along(at: &Evaluation, scale: &[f64], free: &[usize], held: &[Vec<f64>]) -> Result<Self, EstimateError> {
        let f = free.len();
        let normals = Mat::from_fn(f, held.len(), |k, h| held[h][k] / scale[free[k]]);
        let across = svd(normals.as_ref()).ok_or(EstimateError::Overflow)?;
        let least = across.s.first().map_or(0.0, |largest| largest * 1e-10);
        let count = across.s.iter().filter(|&&s| s > least).count();
        let plane = Mat::<f64>::identity(f, f) - across.u.subcols(0, count) * across.u.subcols(0, count).transpose();
        let plane = svd(plane.as_ref()).ok_or(EstimateError::Overflow)?;
        let basis = plane.u.subcols(0, f - count.min(f));
        let scaled = Mat::from_fn(at.rhs.len(), f, |i, k| at.jacobian[(i, free[k])] / scale[free[k]]);
        let factors = svd((&scaled * basis).as_ref()).ok_or(EstimateError::Overflow)?;
        let least = factors.s.first().map_or(0.0, |largest| largest * rank_level(f));
        let rank = factors.s.iter().filter(|&&s| s > least).count();
        let along = basis * &factors.v;
        let mut root = Mat::zeros(scale.len(), rank);
        for (k, &j) in free.iter().enumerate() {
            (0..rank).for_each(|i| root[(j, i)] = along[(k, i)] / factors.s[i] / scale[j]);
        }
        let unseen = |k: usize| (rank..along.ncols()).any(|i| along[(k, i)].abs() > 1e-6);
        Ok(Self {
            root,
            condition: if rank > 0 { factors.s[0] / factors.s[rank - 1] } else { 1.0 },
            undetermined: (0..f).filter(|&k| unseen(k)).map(|k| free[k]).collect(),
        })
    }

    /// `variance H^-1` (p x p).
    pub(crate) fn covariance(&self, variance: f64) -> Mat<f64> {
        let p = self.root.nrows();
        let entry =
            |a: usize, b: usize| (0..self.root.ncols()).map(|i| self.root[(a, i)] * self.root[(b, i)]).sum::<f64>();
        Mat::from_fn(p, p, |a, b| variance * entry(a.min(b), a.max(b)))
    }

    /// `variance H^-1 middle H^-1` (p x p).
    pub(crate) fn sandwich(&self, middle: &Mat<f64>, variance: f64) -> Mat<f64> {
        let inner = self.root.transpose() * middle * &self.root;
        let outer = &self.root * inner * self.root.transpose();
        Mat::from_fn(outer.nrows(), outer.ncols(), |a, b| variance * outer[(a.min(b), a.max(b))])
    }

    /// `H^-1 (sum_c g_c g_c') H^-1 C/(C - 1)` over the scores g of C chunks: errors may be correlated within a chunk
    /// (Liang and Zeger 1986). `None` for one chunk, and if there are no more chunks of positive weight than
    /// parameters: their scores sum to zero.
    pub(crate) fn clustered(&self, scores: &[Vec<f64>]) -> Option<Mat<f64>> {
        let p = self.root.nrows();
        let count = scores.iter().filter(|score| score.iter().any(|&g| g != 0.0)).count();
        if count < 2 || count <= p {
            return None;
        }
        let project = |score: &Vec<f64>| {
            let inner: Vec<f64> = (0..self.root.ncols())
                .map(|i| self.root.col_as_slice(i).iter().zip(score).map(|(root, g)| root * g).sum())
                .collect();
            (0..p).map(|a| (0..inner.len()).map(|i| self.root[(a, i)] * inner[i]).sum()).collect::<Vec<f64>>()
        };
        let influence: Vec<Vec<f64>> = scores.iter().map(project).collect();
        let factor = count as f64 / (count as f64 - 1.0);
        let entry = |a: usize, b: usize| influence.iter().map(|values| values[a] * values[b]).sum::<f64>();
        Some(Mat::from_fn(p, p, |a, b| factor * entry(a.min(b), a.max(b))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_with_zero_scores_are_ignored() {
        let inverse = Inverse { root: Mat::identity(2, 2), condition: 1.0, undetermined: Vec::new() };
        let scores = |some: &[[f64; 2]]| some.iter().map(|score| score.to_vec()).collect::<Vec<_>>();
        // At a minimum the scores sum to zero: as many chunks as parameters leave no freedom.
        assert!(inverse.clustered(&scores(&[[1.0, 2.0], [-1.0, -2.0], [0.0, 0.0], [0.0, 0.0]])).is_none());
        let clustered =
            inverse.clustered(&scores(&[[1.0, 2.0], [-1.0, -1.0], [0.0, 0.0], [0.0, -1.0]])).expect("three chunks");
        assert_eq!((clustered[(0, 0)], clustered[(1, 1)]), (1.5 * 2.0, 1.5 * 6.0));
    }
}
