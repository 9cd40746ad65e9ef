//! A piecewise-affine model laid out for stepping: the numbers of the fast path.

use crate::{aligned::Aligned, cell::Cells};

/// A piecewise-affine model laid out for stepping.
///
/// A trajectory's values stand in **slots**: the states first (padded), then the recorded columns in use, cosines and sines.
pub(crate) struct AffineKernel {
    pub(crate) states: usize,
    /// Padded number of states.
    pub(crate) width: usize,
    pub(crate) slots: usize,
    /// Recorded columns: slot, column of the model.
    pub(crate) recorded: Vec<(usize, usize)>,
    /// Cosines and sines: slot, whether cosine, slot of the angle.
    pub(crate) circular: Vec<(usize, bool, usize)>,
    pub(crate) cells: Cells,
    /// Slots of the rows of the affine maps; `None` when row j belongs to slot j.
    pub(crate) terms: Option<Vec<u32>>,
    /// Rows of an affine map.
    pub(crate) rows: usize,
    /// Per region: rows x width.
    pub(crate) matrices: Aligned,
    /// Per region: width.
    pub(crate) constants: Aligned,
    /// Per state: the factor of the state itself.
    pub(crate) keep: Aligned,
    /// Per state: 1 where the step length multiplies the right side, else 0.
    pub(crate) continuous: Aligned,
    pub(crate) angles: Vec<usize>,
    /// Per region: ranges by slot.
    pub(crate) low: Aligned,
    pub(crate) high: Aligned,
    /// Of a model that goes on otherwise outside of the ranges: how. `None` where a region's map holds everywhere.
    pub(crate) beyond: Option<Beyond>,
}

/// Evaluation of right sides outside of the training ranges, from the groups of latents as on the general path.
pub(crate) struct Beyond {
    /// Per group of latents: the slots of its functions.
    pub(crate) functions: Vec<Vec<usize>>,
    /// Per state.
    pub(crate) sides: Vec<Side>,
}

/// The right side of an equation.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Side {
    Number(f64),
    Slot(usize),
    Latent { group: usize, column: usize },
}
