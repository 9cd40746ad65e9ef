//! Mask of the rows of a file that are used (a bit a row), with the place in the file of the k-th used row.

/// Rows between two stored ranks.
const STRIDE: usize = 4096;

/// The rows of a file that belong to an episode. Costs nothing while every row does.
#[derive(Debug, Default)]
pub(crate) struct RowMask {
    /// Bits of dropped rows; shorter than the file when the rest is used.
    dropped: Vec<u64>,
    /// Used rows before each stride.
    ranks: Vec<usize>,
}

impl RowMask {
    /// Drops a row.
    pub(crate) fn drop_row(&mut self, row: usize) {
        let word = row / 64;
        if self.dropped.len() <= word {
            self.dropped.resize(word + 1, 0);
        }
        self.dropped[word] |= 1 << (row % 64);
    }

    /// Makes [`RowMask::place`] ready; call once after the last [`RowMask::drop_row`].
    pub(crate) fn finish(&mut self) {
        let mut used = 0;
        self.ranks.clear();
        for stride in self.dropped.chunks(STRIDE / 64) {
            self.ranks.push(used);
            used += stride.len() * 64 - stride.iter().map(|word| word.count_ones() as usize).sum::<usize>();
        }
        self.dropped.shrink_to_fit();
    }

    /// The row of the file that is the `k`-th used row.
    pub(crate) fn place(&self, k: usize) -> usize {
        let stride = self.ranks.partition_point(|&rank| rank <= k);
        let Some(stride) = stride.checked_sub(1) else {
            return k;
        };
        let (mut word, mut left) = (stride * (STRIDE / 64), k - self.ranks[stride]);
        while let Some(&bits) = self.dropped.get(word) {
            let here = 64 - bits.count_ones() as usize;
            if left < here {
                let mut used = !bits;
                for _ in 0..left {
                    used &= used - 1;
                }
                return word * 64 + used.trailing_zeros() as usize;
            }
            left -= here;
            word += 1;
        }
        word * 64 + left
    }

    /// Returns true if a row is dropped.
    pub(crate) fn is_dropped(&self, row: usize) -> bool {
        self.dropped.get(row / 64).is_some_and(|word| word >> (row % 64) & 1 == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_agree_with_counting() {
        for (step, limit) in [(1usize, 0usize), (2, 20_000), (3, 9_000), (64, 20_000), (1000, 15_000)] {
            let mut mask = RowMask::default();
            (0..limit).filter(|row| row % step == 0).for_each(|row| mask.drop_row(row));
            mask.finish();
            let used: Vec<usize> = (0..20_500).filter(|&row| !mask.is_dropped(row)).collect();
            assert_eq!(used.len(), 20_500 - (0..limit).filter(|row| row % step == 0).count());
            for (k, &row) in used.iter().enumerate() {
                assert_eq!(mask.place(k), row, "step {step} k {k}");
            }
        }
    }

    #[test]
    fn a_wholly_dropped_beginning() {
        let mut mask = RowMask::default();
        (0..10_000).for_each(|row| mask.drop_row(row));
        mask.finish();
        assert_eq!(mask.place(0), 10_000);
        assert_eq!(mask.place(7), 10_007);
    }
}
