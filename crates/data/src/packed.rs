//! Symmetric matrices as a packed lower triangle, row by row: the layout of statistics and of model files.

/// Index of the first entry of row `i`, and with the number of rows the length of the triangle.
pub const fn packed_row(i: usize) -> usize {
    i * (i + 1) / 2
}

/// Index of entry (i, j), which is that of (j, i).
pub const fn packed(i: usize, j: usize) -> usize {
    if i >= j { packed_row(i) + j } else { packed_row(j) + i }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_stand_row_by_row() {
        let entries: Vec<usize> = (0..5).flat_map(|i| (0..=i).map(move |j| packed(i, j))).collect();
        assert_eq!(entries, (0..packed_row(5)).collect::<Vec<_>>());
        assert_eq!(packed(1, 3), packed(3, 1));
    }
}
