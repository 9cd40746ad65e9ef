//! Gram matrices of the regions of a partition.

use faer::MatRef;

use crate::Gram;

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
