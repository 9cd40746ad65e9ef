//! The columns of a pass over the rows of a system.

use std::ops::Range;

use fleetfoot_data::{Halo, Source};
use fleetfoot_library::Expr;
use fleetfoot_stats::scan::{self, Tile};

use super::{System, SystemError, weak::Weak};

/// Groups of columns, in their order: the functions or their stand-ins, the targets (of the weak form: their means),
/// further moments, the partition's columns, and the rates of the weak form.
pub(super) const REGRESSORS: usize = 0;
const TARGETS: usize = 1;
const ALSO: usize = 2;
const PARTITION: usize = 3;
const RATES: usize = 4;

/// The columns of a system, and the windows that they are integrated over.
pub(super) struct Columns {
    pub(super) rows: scan::Columns,
    pub(super) weak: Option<Weak>,
    pub(super) regressors: usize,
    pub(super) targets: usize,
}

impl Columns {
    /// With `regressors` in the place of the system's functions.
    pub(super) fn compile(system: &System, regressors: &[Expr], source: &dyn Source) -> Result<Self, SystemError> {
        let partition = system.partition.as_ref().map_or(&[][..], |partition| &partition.columns);
        let (targets, rates) = match &system.weak {
            None => (system.targets.clone(), Vec::new()),
            Some(weak) => weak.expressions(),
        };
        let groups: [&[Expr]; 5] = [regressors, &targets, &system.also, partition, &rates];
        Ok(Self {
            rows: scan::Columns::compile(&groups, system.weight.as_ref(), source)?,
            weak: system.weak.clone(),
            regressors: regressors.len(),
            targets: system.targets.len(),
        })
    }

    /// Neighbouring rows that a row, or a window around it, reaches for.
    pub(super) fn halo(&self) -> Halo {
        let (Halo { before, after }, reach) = (self.rows.halo(), self.weak.as_ref().map_or(0, |weak| weak.reach));
        Halo { before: before + reach, after: after + reach }
    }

    /// Regressors and targets, d.
    pub(super) fn dimension(&self) -> usize {
        self.regressors + self.targets
    }

    /// Rows to evaluate at once: their columns stay in second-level cache.
    pub(super) fn tile_rows(&self) -> usize {
        tile_rows(self.rows.count(), self.weak.as_ref())
    }
}

/// Rows of so many columns to evaluate at once.
pub(super) fn tile_rows(columns: usize, weak: Option<&Weak>) -> usize {
    const VALUES: usize = 1 << 17;
    let rows = (VALUES / columns.max(1)).clamp(256, 4096) / 256 * 256;
    // The rows around a tile are evaluated again for the next one.
    weak.map_or(rows, |weak| rows.max(8 * weak.reach))
}

/// Regressors, then targets.
pub(super) const REGRESSION: Range<usize> = REGRESSORS..TARGETS + 1;

/// The columns of further moments.
pub(super) fn also<'r>(tile: &Tile<'r>) -> Vec<&'r [f64]> {
    tile.columns(ALSO..ALSO + 1)
}

/// The columns of the partition.
pub(super) fn partition<'r>(tile: &Tile<'r>) -> Vec<&'r [f64]> {
    tile.columns(PARTITION..PARTITION + 1)
}

/// The columns that have a rate in the weak form.
pub(super) fn rates<'r>(tile: &Tile<'r>) -> Vec<&'r [f64]> {
    tile.columns(RATES..RATES + 1)
}
