//! Gram matrices of the regions of a partition.

use faer::MatRef;

use crate::{Gram, kernel::MANY_COLUMNS};

/// Rows whose products cost more than a merge, several times over.
const ROWS_A_MERGE: usize = 32;

/// Gram matrices of those regions of a partition that have rows.
#[derive(Debug, Clone)]
pub struct RegionGrams(Vec<Option<Gram>>);

impl RegionGrams {
    /// No rows, of so many regions.
    pub fn new(regions: usize) -> Self {
        Self(vec![None; regions])
    }

    /// Number of regions.
    pub fn regions(&self) -> usize {
        self.0.len()
    }

    /// Adds rows (n x d) to their regions, `u32::MAX` to none; without `regions` all to the first.
    pub fn add(&mut self, rows: MatRef<'_, f64>, weights: Option<&[f64]>, regions: Option<&[u32]>) {
        match regions {
            None => self.put(0, Gram::of_rows(rows, weights)),
            Some(regions) => {
                for (region, gram) in Gram::by_region(rows, weights, regions, self.0.len()) {
                    self.put(region as usize, gram);
                }
            }
        }
    }

    /// Adds rows to their regions as [`RegionGrams::add`] does, and to the one region of `whole`: the sum of all regions, where that is less work than the
    /// products once more.
    pub fn add_with_whole(
        &mut self,
        rows: MatRef<'_, f64>,
        weights: Option<&[f64]>,
        regions: &[u32],
        whole: &mut Self,
    ) {
        let by_region = Gram::by_region(rows, weights, regions, self.0.len());
        let cheap = rows.ncols() >= MANY_COLUMNS && by_region.len() * ROWS_A_MERGE <= rows.nrows();
        if cheap && regions.iter().all(|&region| region != u32::MAX) {
            by_region.iter().for_each(|(_, gram)| whole.put(0, gram.clone()));
        } else {
            whole.add(rows, weights, None);
        }
        by_region.into_iter().for_each(|(region, gram)| self.put(region as usize, gram));
    }

    /// Adds other rows of the same regions.
    pub fn merge(&mut self, other: Self) {
        other.into_regions().for_each(|(region, gram)| self.put(region as usize, gram));
    }

    /// The regions that have rows, in order.
    pub fn iter(&self) -> impl Iterator<Item = (u32, &Gram)> {
        self.0.iter().enumerate().filter_map(|(region, gram)| Some((region as u32, gram.as_ref()?)))
    }

    /// The same, for good.
    pub fn into_regions(self) -> impl Iterator<Item = (u32, Gram)> {
        self.0.into_iter().enumerate().filter_map(|(region, gram)| Some((region as u32, gram?)))
    }

    fn put(&mut self, region: usize, gram: Gram) {
        match &mut self.0[region] {
            Some(total) => total.merge(&gram),
            none => *none = Some(gram),
        }
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;

    use super::*;

    #[test]
    fn the_whole_is_the_sum_of_the_regions() {
        for (d, unused) in [(3, false), (MANY_COLUMNS + 3, false), (MANY_COLUMNS + 3, true)] {
            let rows = Mat::from_fn(200, d, |i, j| (0.731 * (i * (2 * j + 3)) as f64).sin() + j as f64);
            let weights: Vec<f64> = (0..200).map(|i| f64::from(i % 3)).collect();
            let regions: Vec<u32> = (0..200).map(|i| if unused && i == 5 { u32::MAX } else { i % 2 }).collect();
            let (mut parts, mut whole) = (RegionGrams::new(2), RegionGrams::new(1));
            parts.add_with_whole(rows.as_ref(), Some(&weights), &regions, &mut whole);
            let (mut same, mut all) = (RegionGrams::new(2), RegionGrams::new(1));
            same.add(rows.as_ref(), Some(&weights), Some(&regions));
            all.add(rows.as_ref(), Some(&weights), None);
            assert!(parts.iter().eq(same.iter()));
            let (sum, expected) = (whole.iter().next().unwrap().1, all.iter().next().unwrap().1);
            assert_eq!((sum.rows, sum.weight), (expected.rows, expected.weight));
            for (value, expected) in sum.scatter.iter().zip(&expected.scatter) {
                assert!((value - expected).abs() < 1e-11 * 200.0, "{d}: {value} {expected}");
            }
        }
    }
}
