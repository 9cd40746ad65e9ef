//! The columns of a pass over the rows of a system.

use std::ops::Range;

use fleetfoot_data::{Block, Halo, Source};
use fleetfoot_library::{Design, DesignRows, Expr};

use super::{System, SystemError, weak::Weak};

/// Regressors, targets (of the weak form: their means), further columns, the partition's columns, the weight, what has rates in the weak form: one design, in this
/// order.
pub(super) struct Columns {
    design: Design,
    pub(super) weak: Option<Weak>,
    pub(super) regressors: usize,
    pub(super) targets: usize,
    also: usize,
    partition: usize,
    weighted: bool,
}

impl Columns {
    /// With `regressors` in the place of the system's functions.
    pub(super) fn compile(system: &System, regressors: &[Expr], source: &dyn Source) -> Result<Self, SystemError> {
        let partition = system.partition.as_ref().map_or(&[][..], |partition| &partition.columns);
        let (targets, rates) = match &system.weak {
            None => (system.targets.clone(), Vec::new()),
            Some(weak) => weak.expressions(),
        };
        let expressions: Vec<Expr> =
            [regressors, &targets, &system.also, partition, system.weight.as_slice(), &rates].concat();
        let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        Ok(Self {
            design: Design::compile(&expressions, &names)?,
            weak: system.weak.clone(),
            regressors: regressors.len(),
            targets: system.targets.len(),
            also: system.also.len(),
            partition: partition.len(),
            weighted: system.weight.is_some(),
        })
    }

    /// Neighbouring rows that a row, or a window around it, reaches for.
    pub(super) fn halo(&self) -> Halo {
        let (Halo { before, after }, reach) = (self.row_halo(), self.weak.as_ref().map_or(0, |weak| weak.reach));
        Halo { before: before + reach, after: after + reach }
    }

    /// Neighbouring rows that the columns of one row reach for.
    pub(super) fn row_halo(&self) -> Halo {
        self.design.halo()
    }

    /// Regressors and targets, d.
    pub(super) fn dimension(&self) -> usize {
        self.regressors + self.targets
    }

    /// Rows to evaluate at once: their columns stay in second-level cache.
    pub(super) fn tile_rows(&self) -> usize {
        const VALUES: usize = 1 << 17;
        let rows = (VALUES / self.design.outputs().max(1)).clamp(256, 4096) / 256 * 256;
        // The rows around a tile are evaluated again for the next one.
        self.weak.as_ref().map_or(rows, |weak| rows.max(8 * weak.reach))
    }

    /// Evaluates a tile of core rows; refuses negative weights and values whose squares overflow.
    pub(super) fn evaluate(
        &self,
        block: &Block,
        episode: &str,
        tile: Range<usize>,
        rows: &mut DesignRows,
    ) -> Result<(), SystemError> {
        self.design.evaluate_for_squares(block, episode, tile, rows)?;
        let Some(weights) = self.split(rows).weights else {
            return Ok(());
        };
        match weights.iter().position(|&weight| weight < 0.0) {
            Some(at) => Err(SystemError::NegativeWeight {
                episode: episode.to_owned(),
                row: block.first + rows.index[at],
                value: weights[at],
            }),
            None => Ok(()),
        }
    }

    /// The columns of evaluated rows.
    pub(super) fn split<'r>(&self, rows: &'r DesignRows) -> Tile<'r> {
        let n = rows.rows();
        let (regression, rest) = rows.values.split_at(self.dimension() * n);
        let (also, rest) = rest.split_at(self.also * n);
        let (partition, rest) = rest.split_at(self.partition * n);
        let (weights, rates) = rest.split_at(usize::from(self.weighted) * n);
        Tile { regression, also, partition, weights: self.weighted.then_some(weights), rates }
    }
}

/// The columns of the complete rows of a tile, column-major.
pub(super) struct Tile<'r> {
    /// Regressors, then targets.
    pub(super) regression: &'r [f64],
    pub(super) also: &'r [f64],
    pub(super) partition: &'r [f64],
    pub(super) weights: Option<&'r [f64]>,
    /// What has a rate in the weak form.
    pub(super) rates: &'r [f64],
}

/// `count` columns of one matrix.
pub(super) fn slices(values: &[f64], count: usize) -> Vec<&[f64]> {
    let rows = values.len() / count.max(1);
    (0..count).map(|column| &values[column * rows..(column + 1) * rows]).collect()
}
