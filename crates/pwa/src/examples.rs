//! The rows that regions are fitted to targets on, refined or cut: one training set, standardised, in chunks of a fixed grid.

use std::ops::Range;

use faer::{MatMut, MatRef};
use fleetfoot_data::{Cancelled, Silent, parallel_all, parallel_fold};
use fleetfoot_stats::{Gram, Preconditioner, SquareRoot, kernel::padded};

use crate::{
    lattice::Columns,
    region_model::{Base, RegionModel},
    residual::{Maps, by_rows},
};

/// Rows of a chunk. The grid is fixed by row numbers alone, so that sums have the same bits on any number of threads.
const CHUNK: usize = 2048;

/// Partition columns, regressors, targets.
pub(crate) type Shape = (usize, usize, usize);

/// Rows with everything that a refinement or a tree asks of them.
pub(crate) struct Examples {
    /// Partition columns, d.
    pub(crate) dimensions: usize,
    pub(crate) regressors: usize,
    pub(crate) targets: usize,
    pub(crate) chunks: Vec<Chunk>,
    pub(crate) rows: usize,
    /// Sum of the weights.
    pub(crate) weight: f64,
    /// Variance of every target.
    pub(crate) variance: Vec<f64>,
    /// The map of all these rows.
    pub(crate) base: Base,
    pub(crate) preconditioner: Preconditioner,
}

/// Some of the rows.
pub(crate) struct Chunk {
    /// Standardised partition columns, column after column.
    pub(crate) z: Vec<f64>,
    /// Regressors by rows, and targets by rows of padded length.
    x: Vec<f64>,
    y: Vec<f64>,
    /// Regressors and targets in the coordinates of the preconditioner, column after column.
    pub(crate) work: Vec<f64>,
    pub(crate) weights: Option<Vec<f64>>,
    pub(crate) rows: usize,
}

impl Chunk {
    /// Rows of columns (partition columns, regressors, targets, and the weight where there are weights).
    pub(crate) fn new<C: AsRef<[f64]>>(
        columns: &[C],
        (d, p, q): Shape,
        (centre, scale): (&[f64], &[f64]),
        range: Range<usize>,
    ) -> Self {
        let n = range.len();
        let part: Vec<&[f64]> = columns.iter().map(|column| &column.as_ref()[range.clone()]).collect();
        let (z, rest) = part.split_at(d);
        let (regression, weights) = rest.split_at(p + q);
        let standard = |(column, (centre, scale)): (&&[f64], (&f64, &f64))| {
            column.iter().map(|value| (value - centre) / scale).collect::<Vec<f64>>()
        };
        let mut chunk = Self {
            z: z.iter().zip(centre.iter().zip(scale)).flat_map(standard).collect(),
            x: Vec::new(),
            y: Vec::new(),
            work: regression.concat(),
            weights: weights.first().map(|weights| weights.to_vec()),
            rows: n,
        };
        by_rows(&regression[..p], p, &mut chunk.x);
        by_rows(&regression[p..], padded(q), &mut chunk.y);
        chunk
    }

    /// Partition columns alone.
    pub(crate) fn places(columns: &[&[f64]], (centre, scale): (&[f64], &[f64]), rows: usize) -> Self {
        let standard = |(column, (centre, scale)): (&&[f64], (&f64, &f64))| {
            column.iter().map(|value| (value - centre) / scale).collect::<Vec<f64>>()
        };
        let z = columns.iter().zip(centre.iter().zip(scale)).flat_map(standard).collect();
        Self { z, x: Vec::new(), y: Vec::new(), work: Vec::new(), weights: None, rows }
    }

    /// The weight of a row.
    #[inline(always)]
    pub(crate) fn weight(&self, row: usize) -> f64 {
        self.weights.as_ref().map_or(1.0, |weights| weights[row])
    }

    /// For every row the squared error of a region's map, in units of the targets' variances.
    pub(crate) fn errors(&self, maps: &Maps, region: u32, variance: &[f64], out: &mut [f64]) {
        let width = padded(variance.len());
        let mut residuals = vec![0.0; self.rows * width];
        maps.residuals(&vec![region; self.rows], &self.x, &self.y, &mut residuals);
        for (out, residual) in out.iter_mut().zip(residuals.chunks_exact(width)) {
            *out = residual.iter().zip(variance).map(|(e, variance)| e * e / variance).sum();
        }
    }

    /// A standardised partition column.
    pub(crate) fn column(&self, column: usize) -> &[f64] {
        &self.z[column * self.rows..(column + 1) * self.rows]
    }
}

impl Examples {
    /// Those of some rows of columns (partition columns, regressors, targets, and the weight where there are weights); `None` where none weigh anything.
    pub(crate) fn new(columns: &[Vec<f64>], shape: Shape, units: (&[f64], &[f64]), rows: &[usize]) -> Option<Self> {
        let (d, p, q) = shape;
        let gather = |column: &Vec<f64>| rows.iter().map(|&row| column[row]).collect();
        let columns: Vec<Vec<f64>> = columns.iter().map(gather).collect();
        let n = rows.len();
        if n == 0 {
            return None;
        }
        let mut chunks: Vec<Chunk> = (0..n.div_ceil(CHUNK))
            .map(|at| Chunk::new(&columns, shape, units, at * CHUNK..((at + 1) * CHUNK).min(n)))
            .collect();
        let regression = columns[d..d + p + q].concat();
        let preconditioner = Preconditioner::from_pilot(MatRef::from_column_major_slice(&regression, n, p + q), p);
        for chunk in &mut chunks {
            preconditioner.apply(MatMut::from_column_major_slice_mut(&mut chunk.work, chunk.rows, p + q));
        }
        let mut whole = Gram::new(p + q);
        for chunk in &chunks {
            whole.merge(&Gram::of_rows(chunk.regression(p + q), chunk.weights.as_deref()));
        }
        (whole.weight > 0.0).then(|| {
            let base = Base::new(preconditioner.square_root(&whole));
            let variance = |total: &f64| if *total > 0.0 { total / whole.weight } else { 1.0 };
            Self {
                dimensions: d,
                regressors: p,
                targets: q,
                rows: n,
                weight: whole.weight,
                variance: base.root.total.iter().map(variance).collect(),
                base,
                preconditioner,
                chunks,
            }
        })
    }

    /// A row: its chunk, and its number there.
    pub(crate) fn place(row: u32) -> (usize, usize) {
        (row as usize / CHUNK, row as usize % CHUNK)
    }

    /// The standardised partition columns, chunk by chunk.
    pub(crate) fn places(&self) -> Vec<Columns<'_>> {
        self.chunks.iter().map(|chunk| (0..self.dimensions).map(|column| chunk.column(column)).collect()).collect()
    }

    /// The Gram matrix of the rows of each of `count` regions, in the preconditioner's coordinates; `regions` by chunk and row.
    pub(crate) fn grams(&self, regions: &[Vec<u32>], count: usize) -> Vec<Gram> {
        let width = self.regressors + self.targets;
        let mut grams = vec![Gram::new(width); count];
        let of_chunk = |at: usize| {
            let chunk: &Chunk = &self.chunks[at];
            let parts = Gram::by_region(chunk.regression(width), chunk.weights.as_deref(), &regions[at], count);
            Ok::<_, Cancelled>(parts)
        };
        let merge = |parts: Vec<(u32, Gram)>| {
            parts.into_iter().for_each(|(region, gram)| grams[region as usize].merge(&gram));
            Ok(())
        };
        // Silence is never cancelled.
        let _ = parallel_fold(self.chunks.len(), &Silent, of_chunk, merge);
        grams
    }

    /// The square-root form of a Gram matrix of these rows.
    pub(crate) fn root(&self, gram: &Gram) -> SquareRoot {
        self.preconditioner.square_root(gram)
    }

    /// The least squared error of one map on the rows of a Gram matrix, in units of the targets' variances.
    pub(crate) fn error(&self, gram: &Gram) -> f64 {
        if gram.weight > 0.0 { self.scaled(&self.preconditioner.residual(gram)) } else { 0.0 }
    }

    /// Sum over the targets of squared errors in units of their variances.
    pub(crate) fn scaled(&self, squares: &[f64]) -> f64 {
        squares.iter().zip(&self.variance).map(|(square, variance)| square / variance).sum()
    }

    /// `work` on every chunk, in order.
    pub(crate) fn map<R: Send>(&self, work: impl Fn(usize, &Chunk) -> R + Sync) -> Vec<R> {
        parallel_all(self.chunks.len(), |at| work(at, &self.chunks[at]))
    }

    /// For every row of a chunk the squared error of a region's map, in units of the targets' variances.
    pub(crate) fn errors(&self, chunk: &Chunk, maps: &Maps, region: u32, out: &mut [f64]) {
        chunk.errors(maps, region, &self.variance, out);
    }

    /// Maps laid out for rows.
    pub(crate) fn maps(&self, models: &[RegionModel]) -> Maps {
        Maps::new(models, self.regressors, self.targets)
    }
}

impl Chunk {
    fn regression(&self, width: usize) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.work, self.rows, width)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Two inputs and a target with a curve.
    pub(crate) fn waves(rows: usize) -> Vec<[f64; 3]> {
        let row = |i: usize| {
            let (a, b) = ((i as f64 * 0.731).sin() * 2.0, (i as f64 * 0.417).cos() * 1.5);
            [a, b, (1.3 * a).sin() + b.abs()]
        };
        (0..rows).map(row).collect()
    }

    /// Examples of rows (x0, x1, y), with x0 and x1 as partition columns.
    pub(crate) fn rows_of(rows: &[[f64; 3]]) -> Examples {
        let column = |j: usize| rows.iter().map(|row| row[j]).collect::<Vec<f64>>();
        let all: Vec<usize> = (0..rows.len()).collect();
        Examples::new(&[0, 1, 0, 1, 2].map(column), (2, 2, 1), (&[0.0; 2], &[1.0; 2]), &all).unwrap()
    }

    #[test]
    fn sums_do_not_depend_on_chunks() {
        let rows = waves(3 * CHUNK + 17);
        let examples = rows_of(&rows);
        assert_eq!((examples.chunks.len(), examples.rows), (4, rows.len()));
        let regions: Vec<Vec<u32>> = examples.map(|_, chunk| (0..chunk.rows).map(|row| (row % 2) as u32).collect());
        let grams = examples.grams(&regions, 3);
        assert_eq!(grams.iter().map(|gram| gram.rows).sum::<u64>(), rows.len() as u64);
        assert_eq!(grams[2].rows, 0);
        // The least squares of a region, against its normal equations by hand: its residuals are orthogonal to the regressors.
        let root = examples.root(&grams[0]);
        let model = RegionModel::new(fleetfoot_stats::least_squares(&root, &examples.base.scale));
        let residual = |row: &[f64; 3]| {
            row[2] - model.intercept[0] - model.coefficients[(0, 0)] * row[0] - model.coefficients[(1, 0)] * row[1]
        };
        let sampled = rows.chunks(CHUNK).flat_map(|chunk| chunk.iter().step_by(2));
        for j in 0..2 {
            let product: f64 = sampled.clone().map(|row| residual(row) * row[j]).sum();
            assert!(product.abs() < 1e-9 * rows.len() as f64, "{product}");
        }
        let mut errors = vec![0.0; examples.chunks[0].rows];
        examples.errors(&examples.chunks[0], &examples.maps(std::slice::from_ref(&model)), 0, &mut errors);
        for (error, row) in errors.iter().zip(&rows) {
            assert!((error - residual(row).powi(2) / examples.variance[0]).abs() < 1e-12);
        }
    }
}
