//! All that is known when the statistic is complete.

use fleetfoot_stats::{FoldLayout, Preconditioner};

use crate::{
    Options, Problem,
    lattice::{Sets, Tree},
    phase::Scale,
    rows::Rows,
    scan::Scan,
    segmentation::Segmentation,
    stable::Loop,
    survey::Survey,
};

/// All that is known when the statistic is complete.
pub(crate) struct Fit<'a> {
    pub(crate) problem: &'a Problem,
    pub(crate) options: &'a Options,
    pub(crate) rows: &'a Rows,
    pub(crate) folds: Option<&'a FoldLayout>,
    pub(crate) survey: &'a Survey,
    pub(crate) segmentation: &'a Segmentation,
    pub(crate) scan: &'a Scan,
    /// Sums of the cells and their trees, where there are any.
    pub(crate) joined: Option<&'a (Sets, Vec<Tree>)>,
    pub(crate) preconditioner: &'a Preconditioner,
    /// Bins of the phase's values, if there is a phase.
    pub(crate) phase: Option<&'a Scale>,
    /// Loop whose bound the models' maps keep.
    pub(crate) bound: Option<Loop>,
}
