//! Rule by which rows of a statistic are held out, as users write it.

use fleetfoot_library::Expr;
use fleetfoot_sparse::select::{Folds, RandomSplits, SelectError};
use fleetfoot_stats::{FoldRule as Layout, Key, Purge};

/// Rule by which rows are held out.
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
    /// Number of folds, at most; `episodes`: number of episodes, if known.
    pub(crate) fn expected(self, episodes: Option<usize>) -> usize {
        match self {
            Self::Auto => 10,
            Self::Count(count) | Self::Splits(count) => count,
            Self::Episodes => episodes.unwrap_or(10),
        }
    }

    /// The folds of the chunks of a statistic.
    ///
    /// # Errors
    /// Folds that cannot be made.
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

/// Values that [`parse`] accepts.
pub(crate) const WORDS: &str = "`auto`, a number of folds from 2 on, `episodes`, or `splits:30`";

/// Reads a rule by which rows are held out; `None` for any other text.
pub(crate) fn parse(text: &str) -> Option<FoldRule> {
    let number =
        |text: &str, least: usize| text.parse().ok().filter(|&count: &usize| count >= least && count <= 10_000);
    match text.split_once(':') {
        None if text == "auto" => Some(FoldRule::Auto),
        None if text == "episodes" => Some(FoldRule::Episodes),
        None => number(text, 2).map(FoldRule::Count),
        Some(("splits", count)) => number(count, 1).map(FoldRule::Splits),
        Some(_) => None,
    }
}

/// The gap beside held-out rows. A row shares samples with `shared` rows on either side, and is correlated with
/// `correlated` rows; if that number is unknown, the gap is a tenth of a span.
pub(crate) fn purge(shared: usize, correlated: Option<f64>) -> Purge {
    Purge::Alike { shared, correlated: correlated.map_or(usize::MAX, |rows| rows.ceil() as usize) }
}

/// Rows over which logs were smoothed for so many seconds, `step` s apart; 0 where they were not, or have no clock.
pub(crate) fn smoothed_rows(seconds: Option<f64>, step: f64) -> usize {
    seconds.filter(|_| step > 0.0).map_or(0, |seconds| (seconds / step).ceil() as usize)
}

/// Neighbours on either side that are made of the same samples as a row: lags and differences in the expressions reach over them.
pub(crate) fn reached<'e>(expressions: impl IntoIterator<Item = &'e Expr>) -> usize {
    let (back, ahead) = expressions.into_iter().fold((0, 0), |(back, ahead), expression| {
        let (lag_rows, lead_rows) = expression.reach();
        (lag_rows.max(back), lead_rows.max(ahead))
    });
    (back as usize).saturating_add(ahead as usize)
}
