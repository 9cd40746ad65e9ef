//! Rows that stay rows: centred and weighted, some columns at a time.

use std::borrow::Cow;

use fleetfoot_data::checkpoint;

use super::{DenseDesign, DenseError};
use crate::{Quadratic, kernel::Slab, rows::Centring};

/// Rows read for one that is used, up to which columns are read by themselves.
const SPARE: usize = 4;

impl DenseDesign {
    /// The problems of all targets on some rows, ascending, all of which are kept.
    pub(super) fn posed(&self, used: &[usize], intercept: bool) -> Result<Vec<Quadratic>, DenseError> {
        let (p, d, n) = (self.regressors(), self.columns(), used.len());
        let weights = self.weights.as_ref().map(|weights| used.iter().map(|&row| weights[row]).collect());
        let centring = Centring::new(n, weights, intercept, p)?;
        let (first, last) = (used[0], used[n - 1]);
        let whole = last - first + 1 == n;
        let apart = self.rows.columns_at_once() < d && last - first < SPARE * n;
        let gathered = if apart { Vec::new() } else { self.gathered(used).0 };
        let at_once = if apart { self.rows.columns_at_once() } else { (p / PARTS).max(1) };
        let read = |columns: std::ops::Range<usize>| -> Cow<'_, [f64]> {
            if !apart {
                return Cow::Borrowed(&gathered[columns.start * n..columns.end * n]);
            }
            let mut values = Vec::with_capacity(columns.len() * (last - first + 1));
            self.rows.read_columns(columns, first..last + 1, &mut values);
            if whole {
                return Cow::Owned(values);
            }
            values
                .chunks_exact(last - first + 1)
                .flat_map(|column| used.iter().map(|&row| column[row - first]))
                .collect()
        };
        let mut a = Slab::zeros(n, p);
        let centring_of = a.fill_columns(at_once, |from, columns| {
            checkpoint();
            let stride = n.next_multiple_of(crate::kernel::LANES);
            let count = columns.len() / stride;
            let values = read(from..from + count);
            let pairs = columns.chunks_exact_mut(stride).zip(values.chunks_exact(n));
            pairs.map(|(column, values)| centring.unit_column(values, &mut column[..n])).collect()
        });
        let targets = read(p..d);
        let mut problems = Vec::with_capacity(d - p);
        let mut targets = targets.chunks_exact(n).peekable();
        while let Some(target) = targets.next() {
            // The last one takes the columns, the others a copy.
            let a = if targets.peek().is_some() { a.clone() } else { std::mem::replace(&mut a, Slab::zeros(0, 0)) };
            problems.push(centring.problem_of_unit_columns(a, &centring_of, target)?);
        }
        Ok(problems)
    }
}

/// Parts in which columns that lie in memory are centred.
const PARTS: usize = 64;
