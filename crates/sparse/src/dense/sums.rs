//! Many rows: their products, summed group by group in one parallel pass.

use faer::{MatMut, MatRef};
use fleetfoot_data::{Progress, parallel_fold};
use fleetfoot_stats::{Gram, Preconditioner, SquareRoot};

use super::{DenseDesign, DenseError, ROOT_COLUMNS};
use crate::select::mean_squares;

/// Values of a block that is in flight: they stay in the cache of a core from the reading to the products.
const BLOCK_VALUES: usize = 1 << 17;
/// The same where groups alternate: every group of a block is a product of its own, which should have rows enough.
const MIXED_VALUES: usize = 1 << 21;
/// The most rows of a block.
const BLOCK_ROWS: usize = 4096;
/// Rows that a product takes at once: a block is made of whole ones.
const TILE: usize = 512;
/// Rows of the pilot sample at least, and a column: enough to tell columns apart, and few enough to factor.
const PILOT_ROWS: usize = 1000;
const PILOT_ROWS_A_COLUMN: usize = 4;
/// Neighbouring rows of a run of the sample: short, because neighbours in time are alike.
const PILOT_RUN: usize = 4;

/// Gram matrices of the groups, in the coordinates of a preconditioner.
#[derive(Debug)]
pub(super) struct Sums {
    preconditioner: Preconditioner,
    grams: Vec<Gram>,
    plain: bool,
}

impl Sums {
    pub(super) fn new(preconditioner: Preconditioner, grams: Vec<Gram>, plain: bool) -> Self {
        Self { preconditioner, grams, plain }
    }

    /// Reads all rows once.
    pub(super) fn scan(design: &DenseDesign, progress: &dyn Progress) -> Result<Self, DenseError> {
        let (n, d) = (design.rows.rows(), design.columns());
        let plain = d > ROOT_COLUMNS;
        let preconditioner =
            if plain { Preconditioner::identity(design.regressors(), design.targets()) } else { pilot(design) };
        let block = block_rows(design);
        let mut grams = vec![Gram::new(d); design.groups];
        progress.stage("products of the rows");
        parallel_fold(
            n.div_ceil(block),
            progress,
            |part| {
                let rows = part * block..((part + 1) * block).min(n);
                let mut values = Vec::with_capacity(d * rows.len());
                design.rows.read(rows.clone(), &mut values);
                preconditioner.apply(MatMut::from_column_major_slice_mut(&mut values, rows.len(), d));
                let z = MatRef::from_column_major_slice(&values, rows.len(), d);
                let weights = design.weights.as_ref().map(|weights| &weights[rows.clone()]);
                let labels = design.labels.get(rows).unwrap_or(&[]);
                Ok::<_, DenseError>(match labels.first() {
                    None => vec![(0, Gram::of_rows(z, weights))],
                    Some(&one) if labels.iter().all(|&label| label == one) => vec![(one, Gram::of_rows(z, weights))],
                    Some(_) => Gram::by_region(z, weights, labels, design.groups),
                })
            },
            |by_group: Vec<(u32, Gram)>| {
                by_group.iter().for_each(|(group, gram)| grams[*group as usize].merge(gram));
                Ok(())
            },
        )?;
        Ok(Self { preconditioner, grams, plain })
    }

    /// Returns true if the sums are plain products, in the coordinates of the rows.
    pub(super) fn is_plain(&self) -> bool {
        self.plain
    }

    /// Returns true if all sums are finite.
    pub(super) fn is_finite(&self) -> bool {
        self.grams.iter().all(|gram| gram.mean.iter().chain(&gram.scatter).all(|value| value.is_finite()))
    }

    /// The sum of some groups.
    pub(super) fn total(&self, chosen: &[bool]) -> Gram {
        let mut total = Gram::new(self.preconditioner.dimension());
        self.grams.iter().zip(chosen).filter(|(_, chosen)| **chosen).for_each(|(gram, _)| total.merge(gram));
        total
    }

    /// The square-root form of some groups.
    pub(super) fn root(&self, chosen: &[bool]) -> SquareRoot {
        self.preconditioner.square_root(&self.total(chosen))
    }

    /// Weighted mean squared errors of models on some groups; none where they hold no rows.
    pub(super) fn mean_squares(
        &self,
        chosen: &[bool],
        target: usize,
        models: MatRef<'_, f64>,
        intercepts: &[f64],
    ) -> Vec<f64> {
        let root = self.root(chosen);
        if root.weight > 0.0 { mean_squares(root, target, models, intercepts) } else { Vec::new() }
    }
}

/// Rows of a block.
fn block_rows(design: &DenseDesign) -> usize {
    let (n, d) = (design.rows.rows(), design.columns());
    let rows = |values: usize| (values / d / TILE * TILE).clamp(TILE, BLOCK_ROWS);
    let turns = design.labels.windows(2).filter(|pair| pair[0] != pair[1]).count();
    if turns > n / rows(BLOCK_VALUES) { rows(MIXED_VALUES) } else { rows(BLOCK_VALUES) }
}

/// The coordinates that some runs of rows, spread evenly over all, ask for.
fn pilot(design: &DenseDesign) -> Preconditioner {
    let (n, d) = (design.rows.rows(), design.columns());
    let wanted = PILOT_ROWS.max(PILOT_ROWS_A_COLUMN * d).min(n);
    let runs = wanted.div_ceil(PILOT_RUN).max(2);
    let start = |run: usize| (run as u128 * (n - PILOT_RUN.min(n)) as u128 / (runs as u128 - 1)) as usize;
    let used: Vec<usize> = match wanted {
        all if all == n => (0..n).collect(),
        _ => (0..runs).flat_map(|run| start(run)..start(run) + PILOT_RUN).collect(),
    };
    let (values, _) = design.gathered(&used);
    Preconditioner::from_pilot(MatRef::from_column_major_slice(&values, used.len(), d), design.regressors())
}
