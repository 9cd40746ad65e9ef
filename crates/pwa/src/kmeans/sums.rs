//! Sums of rows that do not depend on the order of the additions.
//!
//! The rounding of a value is below `max|x| n^2 2^-103`, under the rounding of an ordinary sum for up to 1e8 rows.

/// The two quanta, as the constants whose addition and subtraction rounds to them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quanta {
    coarse: f64,
    fine: f64,
}

impl Quanta {
    /// Quanta for sums of up to `rows` values of magnitude up to `largest`.
    pub(super) fn new(rows: usize, largest: f64) -> Self {
        let rows = exponent_above(rows.max(1) as f64);
        let coarse = rows + exponent_above(largest) - 51;
        let fine = rows + (coarse - 1) - 51;
        Self { coarse: rounder(coarse), fine: rounder(fine) }
    }

    #[inline(always)]
    fn split(self, value: f64) -> (f64, f64) {
        let high = (value + self.coarse) - self.coarse;
        let rest = value - high;
        (high, (rest + self.fine) - self.fine)
    }
}

/// The smallest `e` with `value < 2^e`, not below the range where quanta are normal numbers.
fn exponent_above(value: f64) -> i32 {
    let biased = (value.to_bits() >> 52) as i32 & 0x7ff;
    (biased - 1022).max(-700)
}

/// `1.5 * 2^(52 + q)`: in its neighbourhood numbers are `2^q` apart.
fn rounder(quantum: i32) -> f64 {
    1.5 * 2f64.powi(52 + quantum)
}

/// Sums and counts of the rows of each cluster; adding and merging are exact.
#[derive(Debug, Clone)]
pub(super) struct Sums {
    dimensions: usize,
    quanta: Quanta,
    /// For each cluster the coarse parts, then the fine parts.
    values: Vec<f64>,
    /// Differences may be negative until they are merged.
    counts: Vec<i64>,
    /// Sums of weights, where rows have weights.
    masses: Option<Masses>,
}

/// Sums of weights.
#[derive(Debug, Clone)]
struct Masses {
    quanta: Quanta,
    /// For each cluster the coarse and the fine part.
    values: Vec<[f64; 2]>,
}

impl Sums {
    pub(super) fn new(clusters: usize, dimensions: usize, quanta: Quanta) -> Self {
        Self {
            dimensions,
            quanta,
            values: vec![0.0; 2 * clusters * dimensions],
            counts: vec![0; clusters],
            masses: None,
        }
    }

    /// Sums of weighted rows, with the quanta of the weights.
    pub(super) fn weighted(clusters: usize, dimensions: usize, quanta: Quanta, weights: Quanta) -> Self {
        let masses = Masses { quanta: weights, values: vec![[0.0; 2]; clusters] };
        Self { masses: Some(masses), ..Self::new(clusters, dimensions, quanta) }
    }

    /// Sums of nothing, of this shape and these quanta.
    pub(super) fn emptied(&self) -> Self {
        let (clusters, d) = (self.counts.len(), self.dimensions);
        match &self.masses {
            None => Self::new(clusters, d, self.quanta),
            Some(masses) => Self::weighted(clusters, d, self.quanta, masses.quanta),
        }
    }

    /// Moves a row to a cluster, from another one where it was in one. `row` is overwritten where there are weights.
    #[inline(always)]
    pub(super) fn transfer(&mut self, from: Option<usize>, to: usize, row: &mut [f64], weight: Option<f64>) {
        if let Some(weight) = weight {
            if weight == 0.0 {
                return;
            }
            row.iter_mut().for_each(|x| *x *= weight);
            if let Some(Masses { quanta, values }) = &mut self.masses {
                let (coarse, fine) = quanta.split(weight);
                for (cluster, sign) in from.map(|from| (from, -1.0)).into_iter().chain([(to, 1.0)]) {
                    values[cluster][0] += sign * coarse;
                    values[cluster][1] += sign * fine;
                }
            }
        }
        if let Some(from) = from {
            self.subtract(from, row);
        }
        self.add(to, row);
    }

    /// Adds a row to a cluster.
    #[inline(always)]
    pub(super) fn add(&mut self, cluster: usize, row: &[f64]) {
        self.counts[cluster] += 1;
        let quanta = self.quanta;
        let (high, low) = self.parts(cluster);
        for ((x, high), low) in row.iter().zip(high).zip(low) {
            let (coarse, fine) = quanta.split(*x);
            *high += coarse;
            *low += fine;
        }
    }

    /// Takes a row out of a cluster.
    #[inline(always)]
    pub(super) fn subtract(&mut self, cluster: usize, row: &[f64]) {
        self.counts[cluster] -= 1;
        let quanta = self.quanta;
        let (high, low) = self.parts(cluster);
        for ((x, high), low) in row.iter().zip(high).zip(low) {
            let (coarse, fine) = quanta.split(*x);
            *high -= coarse;
            *low -= fine;
        }
    }

    #[inline(always)]
    fn parts(&mut self, cluster: usize) -> (&mut [f64], &mut [f64]) {
        let d = self.dimensions;
        self.values[2 * cluster * d..2 * (cluster + 1) * d].split_at_mut(d)
    }

    /// Adds another set of sums of the same shape and quanta.
    pub(super) fn merge(&mut self, other: &Sums) {
        self.values.iter_mut().zip(&other.values).for_each(|(sum, value)| *sum += value);
        self.counts.iter_mut().zip(&other.counts).for_each(|(sum, value)| *sum += value);
        if let (Some(masses), Some(others)) = (&mut self.masses, &other.masses) {
            for (sum, value) in masses.values.iter_mut().zip(&others.values) {
                sum[0] += value[0];
                sum[1] += value[1];
            }
        }
    }

    /// Rows of each cluster; those of weight zero do not count.
    pub(super) fn counts(&self) -> &[i64] {
        &self.counts
    }

    /// Writes the mean of every cluster that has rows into its row of `centroids` (k x d).
    pub(super) fn means(&self, centroids: &mut [f64]) {
        let d = self.dimensions;
        for (cluster, centroid) in centroids.chunks_exact_mut(d).enumerate() {
            let count = self.counts[cluster];
            if count > 0 {
                let mass = self.masses.as_ref().map_or(count as f64, |masses| masses.values[cluster].iter().sum());
                let (high, low) = self.values[2 * cluster * d..2 * (cluster + 1) * d].split_at(d);
                for j in 0..d {
                    centroid[j] = (high[j] + low[j]) / mass;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sums_do_not_depend_on_the_order(rows in prop::collection::vec(prop::array::uniform3(-1e6..1e6f64), 1..200), split in 0usize..200) {
            let largest = rows.iter().flatten().fold(0.0f64, |a, x| a.max(x.abs()));
            let quanta = Quanta::new(rows.len(), largest);
            let mut forward = Sums::new(1, 3, quanta);
            rows.iter().for_each(|row| forward.add(0, row));
            let (mut left, mut right) = (Sums::new(1, 3, quanta), Sums::new(1, 3, quanta));
            for (i, row) in rows.iter().enumerate().rev() {
                if i < split { left.add(0, row) } else { right.add(0, row) }
                // Noise that is taken back again must leave no trace.
                left.add(0, &rows[(i * 7) % rows.len()]);
                left.subtract(0, &rows[(i * 7) % rows.len()]);
            }
            right.merge(&left);
            prop_assert_eq!(&forward.values, &right.values);
            prop_assert_eq!(forward.counts(), right.counts());
            let mut mean = [0.0; 3];
            forward.means(&mut mean);
            for j in 0..3 {
                let plain = rows.iter().map(|row| row[j]).sum::<f64>() / rows.len() as f64;
                prop_assert!((mean[j] - plain).abs() <= 1e-15 * largest * rows.len() as f64, "{} {}", mean[j], plain);
            }
        }
    }

    #[test]
    fn mean_is_accurate_despite_cancellation() {
        // One large value, taken back, among small ones: a plain sum loses the small digits.
        let mut sums = Sums::new(1, 1, Quanta::new(1000, 1e12));
        sums.add(0, &[1e12]);
        (0..998).for_each(|_| sums.add(0, &[0.1]));
        sums.add(0, &[-1e12]);
        let mut mean = [0.0];
        sums.means(&mut mean);
        assert!((mean[0] - 0.0998).abs() < 1e-13, "{}", mean[0]);
        let mut zeros = Sums::new(2, 1, Quanta::new(10, 0.0));
        zeros.add(0, &[0.0]);
        let mut centroids = [7.0, 7.0];
        zeros.means(&mut centroids);
        assert_eq!(centroids, [0.0, 7.0]);
    }
}
