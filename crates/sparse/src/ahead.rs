//! Products of the columns that a path is about to take in, several at once.

use faer::{Accum, Mat, MatMut, Par, linalg::matmul::matmul};
use fleetfoot_data::{checkpoint, parallel_pieces};

use crate::kernel::Slab;

/// Columns that are multiplied at once: enough that all rows are not read for one of them alone, and few enough that most are taken in.
const AT_ONCE: usize = 16;
/// Values of the rows up to which a product is as good as several.
const FEW_VALUES: usize = 1 << 18;
/// Products that are kept: columns come back, or enter later than foreseen.
const KEPT: usize = 8;
/// Values that one thread multiplies at once.
const PIECE: usize = 1 << 16;

/// Products `A'a_j` of the columns of A that were foreseen.
#[derive(Default)]
pub(crate) struct Ahead {
    known: Vec<Known>,
}

/// Products of some columns with all.
struct Known {
    columns: Vec<usize>,
    /// Those with the first column of A, then those with the second (as many as `columns`), and so on.
    values: Vec<f64>,
}

impl Ahead {
    /// Returns true if products made ahead are faster for these rows.
    pub(crate) fn pays(a: &Slab) -> bool {
        a.rows() * a.columns() > FEW_VALUES
    }

    /// The products of column j with all; where they are not known, those of the columns that `next` foresees (at most as many as it is asked for) are made with
    /// them.
    pub(crate) fn of(&mut self, a: &Slab, j: usize, next: impl FnOnce(usize) -> Vec<usize>) -> impl Fn(usize) -> f64 {
        let find = |known: &[Known]| {
            let place = |known: &Known| known.columns.iter().position(|&column| column == j);
            known.iter().enumerate().find_map(|(block, known)| Some((block, place(known)?)))
        };
        let (block, place) = find(&self.known).unwrap_or_else(|| {
            let mut columns = next(AT_ONCE - 1);
            columns.retain(|&column| column != j && self.known.iter().all(|known| !known.columns.contains(&column)));
            columns.push(j);
            if self.known.len() == KEPT {
                self.known.remove(0);
            }
            let place = columns.len() - 1;
            self.known.push(Known::of(a, columns));
            (self.known.len() - 1, place)
        });
        let known = &self.known[block];
        move |i| known.values[i * known.columns.len() + place]
    }
}

impl Known {
    fn of(a: &Slab, columns: Vec<usize>) -> Self {
        let (m, k) = (a.rows(), columns.len());
        let some = Mat::from_fn(m, k, |i, at| a.column(columns[at])[i]);
        let mut values = vec![0.0; a.columns() * k];
        let at_once = (PIECE / a.stride()).max(1);
        parallel_pieces(&mut values, at_once * k, |piece, values| {
            checkpoint();
            let count = values.len() / k;
            let out = MatMut::from_column_major_slice_mut(values, k, count);
            let others = a.as_mat().subcols(piece * at_once, count);
            matmul(out, Accum::Replace, some.transpose(), others, 1.0, Par::Seq);
        });
        Self { columns, values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::dot;

    #[test]
    fn cached_products_match_columns() {
        let a = Slab::from_fn(37, 300, |i, j| ((i * (j + 3) + 5 * j) as f64 * 0.37).sin());
        let mut ahead = Ahead::default();
        let mut calls = 0;
        for j in [5, 6, 7, 250, 5, 30, 31, 100, 120, 140, 160, 180, 200, 220, 5, 6] {
            let next = |most: usize| {
                calls += 1;
                (j..300).take(most).collect()
            };
            let product = ahead.of(&a, j, next);
            assert!((0..300).all(|i| (product(i) - dot(a.column(i), a.column(j))).abs() < 1e-12));
        }
        // 6, 7, 31 and the second 5 were known, and the last 6 was made with the last 5.
        assert_eq!(calls, 11);
    }
}
