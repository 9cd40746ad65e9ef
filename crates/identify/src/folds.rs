//! Which rows of a statistic are held out, as users ask for it.

use fleetfoot_sparse::select::{Folds, RandomSplits, SelectError};
use fleetfoot_stats::{FoldRule as Layout, Key, Purge};

/// Which rows are held out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FoldRule {
    /// Ten folds, or five of few rows.
    #[default]
    Auto,
    /// So many folds: whole episodes where there are enough, else spans of every episode.
    Count(usize),
    /// Every episode once.
    Episodes,
    /// Random splits, a third held out.
    Splits(usize),
}

impl FoldRule {
    /// The folds of the chunks of a statistic.
    ///
    /// # Errors
    /// Folds that cannot be made as they are asked for.
    pub(crate) fn folds(self, keys: &[Key], rows: &[u64], seed: u64, purge: Purge) -> Result<Folds, SelectError> {
        let of = |layout| Folds::of(keys, rows, layout, purge);
        match self {
            Self::Auto => of(Layout::Auto),
            Self::Count(count) => of(Layout::Count(count)),
            Self::Episodes => of(Layout::Episodes),
            Self::Splits(repeats) => {
                Folds::random_splits(keys, rows, &RandomSplits { repeats, seed, purge, ..RandomSplits::default() })
            }
        }
    }
}

/// The gap beside held-out rows that are correlated with so many others; a tenth of a span where that is not known.
pub(crate) fn purge(correlated: Option<f64>) -> Purge {
    correlated.map_or(Purge::TENTH, |rows| Purge::Correlated(rows.ceil() as usize))
}
