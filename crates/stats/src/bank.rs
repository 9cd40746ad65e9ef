//! Statistics side by side: every reweighting of them is one matrix product.

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::matmul};
use fleetfoot_data::packed_row;

use crate::Gram;

/// Gram matrices of the same columns as the columns of one matrix of moments, so that folds, leave-one-out totals and bootstrap replicates
/// of all of them are the product of that matrix and a matrix of weights.
///
/// Moments are held about the mean of all rows: the mean of a reweighted total lies within its deviation of that, and nothing cancels.
#[derive(Debug, Clone)]
pub struct Bank {
    centre: Vec<f64>,
    rows: Vec<u64>,
    /// Weight, sums and packed sums of products about `centre`: (1 + d + d (d + 1) / 2) x members.
    moments: Mat<f64>,
}

impl Bank {
    /// These statistics, in this order.
    ///
    /// # Panics
    /// When their dimensions differ.
    pub fn new<'a>(grams: impl IntoIterator<Item = &'a Gram>) -> Self {
        let grams: Vec<&Gram> = grams.into_iter().collect();
        let d = grams.first().map_or(0, |gram| gram.dimension());
        let total: f64 = grams.iter().map(|gram| gram.weight).sum();
        let mut centre = vec![0.0; d];
        for gram in &grams {
            assert_eq!(gram.dimension(), d, "statistics of the same columns");
            let share = if total > 0.0 { gram.weight / total } else { 0.0 };
            centre.iter_mut().zip(&gram.mean).for_each(|(centre, mean)| *centre += share * mean);
        }
        let mut moments = Mat::zeros(1 + d + packed_row(d), grams.len());
        for (k, gram) in grams.iter().enumerate() {
            let (w, column) = (gram.weight, moments.col_as_slice_mut(k));
            column[0] = w;
            let shift: Vec<f64> = gram.mean.iter().zip(&centre).map(|(mean, centre)| mean - centre).collect();
            column[1..=d].iter_mut().zip(&shift).for_each(|(sum, shift)| *sum = w * shift);
            for i in 0..d {
                for j in 0..=i {
                    column[1 + d + packed_row(i) + j] = gram.scatter[packed_row(i) + j] + w * shift[i] * shift[j];
                }
            }
        }
        Self { centre, rows: grams.iter().map(|gram| gram.rows).collect(), moments }
    }

    /// Number of statistics.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Returns true if the bank has no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Rows of every statistic.
    pub fn rows(&self) -> &[u64] {
        &self.rows
    }

    /// Columns of every statistic, d.
    pub fn dimension(&self) -> usize {
        self.centre.len()
    }

    /// One of the statistics.
    ///
    /// # Panics
    /// When there is none with this index.
    pub fn member(&self, k: usize) -> Gram {
        self.gram(self.moments.col_as_slice(k), self.rows[k], self.dimension())
    }

    /// The total of all.
    pub fn total(&self) -> Gram {
        self.combine(Mat::from_fn(self.len(), 1, |_, _| 1.0).as_ref()).remove(0)
    }

    /// For every column of `weights` (members x b; finite, not negative) the statistic of all rows with each member's row weights multiplied by its
    /// weight. `rows` is the sum of the members' rows times their weights, rounded.
    ///
    /// The bits of a column of the answer do not depend on the other columns.
    ///
    /// # Panics
    /// When there is not one weight a member.
    pub fn combine(&self, weights: MatRef<'_, f64>) -> Vec<Gram> {
        assert_eq!(weights.nrows(), self.len(), "one weight a member");
        let d = self.dimension();
        let width = self.moments.nrows();
        let mut grams = Vec::with_capacity(weights.ncols());
        // Batches of one width, the last padded: the kernel that a column meets, and so its bits, are always the same.
        for first in (0..weights.ncols()).step_by(BATCH) {
            let count = BATCH.min(weights.ncols() - first);
            let padded = Mat::from_fn(self.len(), BATCH, |k, b| if b < count { weights[(k, first + b)] } else { 0.0 });
            let mut sums = Mat::zeros(width, BATCH);
            matmul(sums.as_mut(), Accum::Replace, self.moments.as_ref(), padded.as_ref(), 1.0, Par::Seq);
            for b in 0..count {
                let rows: f64 = (0..self.len()).map(|k| padded[(k, b)] * self.rows[k] as f64).sum();
                grams.push(self.gram(sums.col_as_slice(b), rows.round() as u64, d));
            }
        }
        grams
    }

    /// For each of `count` groups of members the total of all members of the other groups; `groups` names the group of every member.
    ///
    /// Sums from both ends meet, so nothing is subtracted, and the work grows with the members and not with their square.
    ///
    /// # Panics
    /// When there is not one group a member, or a group is not below `count`.
    pub fn without(&self, groups: &[usize], count: usize) -> Vec<Gram> {
        assert_eq!(groups.len(), self.len(), "one group a member");
        let (width, d) = (self.moments.nrows(), self.dimension());
        let mut sums = Mat::<f64>::zeros(width, count);
        let mut rows = vec![0_u64; count];
        for (member, &group) in groups.iter().enumerate() {
            add(sums.col_as_slice_mut(group), self.moments.col_as_slice(member));
            rows[group] += self.rows[member];
        }
        // Column g: the sum of the groups behind g.
        let mut behind = Mat::<f64>::zeros(width, count);
        let mut sum = vec![0.0; width];
        for group in (0..count).rev() {
            behind.col_as_slice_mut(group).copy_from_slice(&sum);
            add(&mut sum, sums.col_as_slice(group));
        }
        let all: u64 = rows.iter().sum();
        let mut before = vec![0.0; width];
        let mut grams = Vec::with_capacity(count);
        for group in 0..count {
            let rest = behind.col_as_slice_mut(group);
            add(rest, &before);
            grams.push(self.gram(rest, all - rows[group], d));
            add(&mut before, sums.col_as_slice(group));
        }
        grams
    }

    fn gram(&self, sums: &[f64], rows: u64, d: usize) -> Gram {
        Gram::from_moments(rows, sums[0], &self.centre, &sums[1..=d], &sums[1 + d..])
    }
}

fn add(sums: &mut [f64], values: &[f64]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
}

/// Columns of weights that are multiplied at once.
const BATCH: usize = 32;

#[cfg(test)]
mod tests {
    use super::*;

    fn gram(seed: usize, n: usize) -> Gram {
        let rows = Mat::from_fn(n, 3, |i, j| 1e3 * j as f64 + ((i * (j + 2) + seed * 13) as f64 * 0.71).sin());
        Gram::of_rows(rows.as_ref(), None)
    }

    #[test]
    fn weights_of_zero_and_one_are_merges() {
        let grams: Vec<Gram> = (0..7).map(|k| gram(k, 20 + k)).collect();
        let bank = Bank::new(&grams);
        let weights = Mat::from_fn(7, 40, |k, b| f64::from(u8::from(((b + 1) >> (k % 6)) & 1 == 1)));
        for (b, combined) in bank.combine(weights.as_ref()).iter().enumerate() {
            let mut expected = Gram::new(3);
            (0..7).filter(|&k| weights[(k, b)] > 0.0).for_each(|k| expected.merge(&grams[k]));
            assert_eq!(combined.rows, expected.rows);
            for (a, b) in combined.scatter.iter().zip(&expected.scatter) {
                assert!((a - b).abs() <= 1e-12 * expected.weight, "{a} {b}");
            }
            for (a, b) in combined.mean.iter().zip(&expected.mean) {
                assert!((a - b).abs() <= 1e-13 * b.abs().max(1.0), "{a} {b}");
            }
            let alone = bank.combine(weights.as_ref().subcols(b, 1)).remove(0);
            assert_eq!(&alone, combined);
        }
    }

    #[test]
    fn the_rest_is_the_merge_of_the_others() {
        let grams: Vec<Gram> = (0..7).map(|k| gram(k, 20 + k)).collect();
        let groups = [0, 0, 1, 2, 1, 3, 3];
        for (group, rest) in Bank::new(&grams).without(&groups, 4).iter().enumerate() {
            let mut expected = Gram::new(3);
            (0..7).filter(|&k| groups[k] != group).for_each(|k| expected.merge(&grams[k]));
            assert_eq!((rest.rows, rest.weight), (expected.rows, expected.weight));
            rest.scatter.iter().zip(&expected.scatter).for_each(|(a, b)| assert!((a - b).abs() < 1e-10, "{a} {b}"));
            rest.mean.iter().zip(&expected.mean).for_each(|(a, b)| assert!((a - b).abs() <= 1e-13 * b.abs().max(1.0)));
        }
    }

    #[test]
    fn a_count_is_a_repetition() {
        let grams: Vec<Gram> = (0..3).map(|k| gram(k, 30)).collect();
        let counts = [2.0, 0.0, 3.0];
        let combined = Bank::new(&grams).combine(Mat::from_fn(3, 1, |k, _| counts[k]).as_ref()).remove(0);
        let mut expected = Gram::new(3);
        for k in [0, 0, 2, 2, 2] {
            expected.merge(&grams[k]);
        }
        assert_eq!((combined.rows, combined.weight), (expected.rows, expected.weight));
        combined.scatter.iter().zip(&expected.scatter).for_each(|(a, b)| assert!((a - b).abs() < 1e-10, "{a} {b}"));
    }
}
