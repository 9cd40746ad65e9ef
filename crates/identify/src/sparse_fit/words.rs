//! Words that the recipe's sections share.

use crate::FoldRule;

/// What [`folds`] reads.
pub(crate) const FOLDS: &str = "`auto`, a number of folds from 2 on, `episodes`, or `splits:30`";

/// Which rows are held out.
pub(crate) fn folds(text: &str) -> Option<FoldRule> {
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
