//! Best cut of a node along a column.

use std::ops::Range;

use fleetfoot_stats::Gram;

use crate::examples::Examples;

/// Errors that differ by less of a node's total are equal.
pub(super) const ROUNDING: f64 = 1e-12;

/// Bins of the rows of a node along a column, at most.
const BINS: usize = 32;

/// Rows, and how well one map fits them.
pub(super) struct Node {
    /// Ascending.
    pub(super) rows: Vec<u32>,
    /// Least squared error, in units of the targets' variances over all rows.
    pub(super) error: f64,
    /// Squares of as many rows of those variances.
    pub(super) total: f64,
}

/// A cut of a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NodeCut {
    pub(super) column: usize,
    /// Error of both sides.
    pub(super) error: f64,
    pub(super) threshold: f64,
    /// The rows below, in the order of the column.
    at: usize,
    /// The tried cuts beside it: the best of all lies between them.
    between: (usize, usize),
}

/// The rows of a node in the order of a column.
struct Ordered<'a> {
    examples: &'a Examples,
    column: usize,
    /// Value and row.
    rows: Vec<(f64, u32)>,
}

impl Node {
    /// The best of some cuts along a column, evenly over the rows; `None` where none leaves `least` rows on both sides.
    pub(super) fn best(&self, examples: &Examples, column: usize, least: u64) -> Option<NodeCut> {
        let ordered = Ordered::new(examples, column, &self.rows);
        let n = ordered.rows.len();
        ordered.best(0..n, least, None)
    }

    /// The same cut, located to the row: the range between the tried cuts beside it is searched in ever finer bins.
    pub(super) fn sharpened(&self, examples: &Examples, coarse: NodeCut, least: u64) -> NodeCut {
        let ordered = Ordered::new(examples, coarse.column, &self.rows);
        let mut best = coarse;
        while let Some(finer) = ordered.best(best.between.0..best.between.1, least, Some(best.at)) {
            if finer.between == best.between {
                return finer;
            }
            best = finer;
        }
        best
    }

    /// The rows on both sides of a cut.
    pub(super) fn sides(&self, examples: &Examples, cut: &NodeCut) -> [Self; 2] {
        let value = |row: u32| Ordered::value(examples, cut.column, row);
        let (below, above): (Vec<u32>, Vec<u32>) = self.rows.iter().partition(|&&row| value(row) < cut.threshold);
        [below, above].map(|rows| {
            let gram = gram(examples, rows.iter().copied());
            Self::new(examples, rows, gram)
        })
    }
}

impl<'a> Ordered<'a> {
    fn new(examples: &'a Examples, column: usize, rows: &[u32]) -> Self {
        let mut rows: Vec<(f64, u32)> = rows.iter().map(|&row| (Self::value(examples, column, row), row)).collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Self { examples, column, rows }
    }

    fn value(examples: &Examples, column: usize, row: u32) -> f64 {
        let (chunk, at) = Examples::place(row);
        examples.chunks[chunk].column(column)[at]
    }

    /// Returns true if a cut before this row separates two values.
    fn separates(&self, at: usize) -> bool {
        at > 0 && at < self.rows.len() && self.rows[at - 1].0 < self.rows[at].0
    }

    /// Cuts to try within a range of the rows, its ends included: a known one, and those next to even places, about as
    /// many as bins.
    fn candidates(&self, range: &Range<usize>, least: usize, known: Option<usize>) -> Vec<usize> {
        let (first, last) = (range.start.max(least), range.end.min(self.rows.len().saturating_sub(least)));
        if first > last {
            return Vec::new();
        }
        let every = (last - first).div_ceil(BINS).max(1);
        // A place within equal values moves to their end, else to their beginning.
        let moved = |at: usize| {
            let up = (at..=last).find(|&at| self.separates(at));
            up.or_else(|| (first..at).rev().find(|&at| self.separates(at)))
        };
        let even = (first..=last).step_by(every).chain([last]).filter_map(moved);
        let mut places: Vec<usize> = even.chain(known).collect();
        places.sort_unstable();
        places.dedup();
        places
    }

    /// The best of some cuts within a range of the rows.
    fn best(&self, range: Range<usize>, least: u64, known: Option<usize>) -> Option<NodeCut> {
        let places = self.candidates(&range, least as usize, known);
        if places.is_empty() {
            return None;
        }
        let n = self.rows.len();
        let ends: Vec<usize> = std::iter::once(0).chain(places.iter().copied()).chain([n]).collect();
        let bins: Vec<Gram> = ends.windows(2).map(|pair| self.gram(pair[0]..pair[1])).collect();
        let error = |gram: &Gram| self.examples.error(gram);
        // Merged from the lower end, and from the upper.
        let mut errors = vec![0.0; places.len()];
        let mut below = Gram::new(bins[0].dimension());
        for (at, bin) in bins[..places.len()].iter().enumerate() {
            below.merge(bin);
            errors[at] += error(&below);
        }
        let mut above = Gram::new(bins[0].dimension());
        for (at, bin) in bins[1..].iter().enumerate().rev() {
            above.merge(bin);
            errors[at] += error(&above);
        }
        let best = (0..places.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b]))?;
        let beside = |at: Option<usize>, end: usize| at.and_then(|at| places.get(at).copied()).unwrap_or(end);
        let at = places[best];
        Some(NodeCut {
            column: self.column,
            error: errors[best],
            threshold: between(self.rows[at - 1].0, self.rows[at].0),
            at,
            between: (beside(best.checked_sub(1), range.start), beside(Some(best + 1), range.end)),
        })
    }

    fn gram(&self, range: Range<usize>) -> Gram {
        gram(self.examples, self.rows[range].iter().map(|&(_, row)| row))
    }
}

/// The Gram matrix of some rows in the coordinates of the examples' preconditioner.
fn gram(examples: &Examples, rows: impl Iterator<Item = u32> + Clone) -> Gram {
    let width = examples.regressors + examples.targets;
    let pick = |column: usize| {
        let value = |row: u32| {
            let (chunk, at) = Examples::place(row);
            let chunk = &examples.chunks[chunk];
            chunk.work[column * chunk.rows + at]
        };
        rows.clone().map(value).collect::<Vec<f64>>()
    };
    let columns: Vec<Vec<f64>> = (0..width).map(pick).collect();
    let weights: Option<Vec<f64>> = examples.chunks.first().is_some_and(|chunk| chunk.weights.is_some()).then(|| {
        let weight = |row: u32| {
            let (chunk, at) = Examples::place(row);
            examples.chunks[chunk].weight(at)
        };
        rows.clone().map(weight).collect()
    });
    Gram::of_columns(&columns.iter().map(Vec::as_slice).collect::<Vec<_>>(), weights.as_deref())
}

/// The shortest decimal number above `low` and not above `high`.
fn between(low: f64, high: f64) -> f64 {
    if low < 0.0 && high >= 0.0 {
        return 0.0;
    }
    let middle = low + 0.5 * (high - low);
    let rounded = |digits: usize| format!("{middle:.digits$e}").parse::<f64>().ok();
    (0..17).filter_map(rounded).find(|&value| value > low && value <= high).unwrap_or(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::tests::rows_of;
    use proptest::prelude::*;

    /// A node of all rows (x0, x1, y).
    fn node(rows: &[[f64; 3]]) -> (Examples, Node) {
        let examples = rows_of(rows);
        let all: Vec<u32> = (0..rows.len() as u32).collect();
        let whole = gram(&examples, all.iter().copied());
        let node = Node::new(&examples, all, whole);
        (examples, node)
    }

    /// The least squared error of `a + b x0 + c x1` on some rows over the variance of all, from normal equations by elimination.
    fn residual(rows: &[[f64; 3]], all: &[[f64; 3]]) -> f64 {
        let mean = |of: &[[f64; 3]], j: usize| of.iter().map(|row| row[j]).sum::<f64>() / of.len() as f64;
        let product = |i: usize, j: usize| {
            let (a, b) = (mean(rows, i), mean(rows, j));
            rows.iter().map(|row| (row[i] - a) * (row[j] - b)).sum::<f64>()
        };
        let s = |i, j| product(i, j) - product(i, 0) * product(0, j) / product(0, 0).max(1e-300);
        let left = s(2, 2) - s(2, 1) * s(1, 2) / s(1, 1).max(1e-300);
        let y = mean(all, 2);
        left / (all.iter().map(|row| (row[2] - y).powi(2)).sum::<f64>() / all.len() as f64)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn an_exhaustive_search_takes_the_best_cut(
            rows in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64), 16..30)
        ) {
            let rows: Vec<[f64; 3]> = rows.into_iter().map(|(a, b, c)| [a, b, c]).collect();
            let (examples, node) = node(&rows);
            for column in 0..2 {
                let cut = node.best(&examples, column, 5).unwrap();
                let mut sorted = rows.clone();
                sorted.sort_by(|a, b| a[column].total_cmp(&b[column]));
                let of = |at: usize| residual(&sorted[..at], &rows) + residual(&sorted[at..], &rows);
                let least = (5..=rows.len() - 5).map(of).fold(f64::INFINITY, f64::min);
                // The oracle squares: its own rounding is some 1e-16 of the total over what is left of it.
                prop_assert!((cut.error - least).abs() < 1e-8 * rows.len() as f64, "{} {least}", cut.error);
                let [below, above] = node.sides(&examples, &cut);
                prop_assert!((below.error + above.error - cut.error).abs() < 1e-9 * rows.len() as f64);
                prop_assert!(below.rows.len() >= 5 && above.rows.len() >= 5);
            }
        }
    }

    #[test]
    fn cut_lies_between_rows_of_a_jump() {
        let row = |i: usize| {
            let x = ((i * 7919) % 5000) as f64 / 2500.0 - 1.0;
            let other = ((i * 104_729) % 5003) as f64 / 2501.5 - 1.0;
            [x, other, if x < 0.2348 { 1.0 + other } else { 3.0 - x }]
        };
        let (examples, node) = node(&(0..5000).map(row).collect::<Vec<_>>());
        let coarse = node.best(&examples, 0, 15).unwrap();
        let sharp = node.sharpened(&examples, coarse, 15);
        // Rows are 0.0004 apart.
        assert!((sharp.threshold - 0.2348).abs() < 0.0005, "{sharp:?} {coarse:?}");
        assert!(sharp.error < 1e-9 && coarse.error > 1.0, "{sharp:?} {coarse:?}");
    }

    #[test]
    fn equal_values_stay_together_and_constants_are_not_cut() {
        let row = |i: usize| [f64::from(u8::from(i.is_multiple_of(3))), 7.0, (i % 3) as f64 + 0.01 * (i as f64).sin()];
        let (examples, node) = node(&(0..90).map(row).collect::<Vec<_>>());
        let cut = node.best(&examples, 0, 15).unwrap();
        assert_eq!((cut.threshold, cut.at), (0.5, 60));
        assert_eq!(node.sharpened(&examples, cut, 15), cut);
        assert!(node.best(&examples, 1, 15).is_none());
        assert!(node.best(&examples, 0, 31).is_none());
    }

    #[test]
    fn thresholds_are_short() {
        assert_eq!(between(0.29, 0.31), 0.3);
        assert_eq!(between(-0.1, 0.4), 0.0);
        assert_eq!(between(-0.4, 0.0), 0.0);
        assert_eq!(between(0.0, 0.4), 0.2);
        assert_eq!(between(1234.1, 1234.9), 1234.5);
        let tight = (1.0f64, 1.0 + f64::EPSILON);
        assert_eq!(between(tight.0, tight.1), tight.1);
        assert_eq!(between(-2e300, -1e300), -1.5e300);
    }
}
