//! Held-out rows, which no fit and no choice uses: the last part of every episode, or every fifth of many episodes.

use std::ops::Range;

use crate::error::Error;

/// Rows of logs to read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Part {
    /// All of them.
    #[default]
    All,
    /// Rows for fits and for choices between models.
    Training,
    /// Rows that are kept back until a model is chosen.
    Test,
}

/// One row of so many is kept back.
const SHARE: usize = 5;
/// Whole episodes are kept back where there are as many, and none of them has more than a third of the rows.
const EPISODES: usize = 5;
const MOST: usize = 3;
/// Rows of an episode that is parted, at least.
const FEW: usize = 10;

impl Part {
    /// The rows of this part: episodes by number, and rows of them. `rows` are the lengths of all episodes; the test begins `apart` rows behind the training.
    ///
    /// # Errors
    /// Nothing is left.
    pub(crate) fn of(self, rows: &[usize], apart: usize) -> Result<Vec<(usize, Range<usize>)>, Error> {
        let all: usize = rows.iter().sum();
        let whole = rows.len() >= EPISODES && rows.iter().all(|&rows| rows <= all / MOST);
        let part = |(episode, &rows): (usize, &usize)| {
            let border = match whole {
                true if episode % SHARE == SHARE / 2 => 0,
                true => rows,
                false if rows < FEW => rows,
                false => rows - rows / SHARE,
            };
            let range = match self {
                Self::All => 0..rows,
                Self::Training => 0..border,
                Self::Test if border == 0 => 0..rows,
                Self::Test => border.saturating_add(apart).min(rows)..rows,
            };
            (!range.is_empty()).then_some((episode, range))
        };
        let kept_rows: Vec<_> = rows.iter().enumerate().filter_map(part).collect();
        if kept_rows.is_empty() {
            return Err(Error::too_few_rows(
                all as u64,
                FEW as u64,
                format!("{all} rows are too few to keep a fifth of them back for a test; give longer logs"),
            ));
        }
        Ok(kept_rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_fifth_of_few_episodes_is_the_test() {
        let rows = [100, 50, 7];
        assert_eq!(Part::Training.of(&rows, 3).unwrap(), [(0, 0..80), (1, 0..40), (2, 0..7)]);
        assert_eq!(Part::Test.of(&rows, 3).unwrap(), [(0, 83..100), (1, 43..50)]);
        assert_eq!(Part::All.of(&rows, 3).unwrap(), [(0, 0..100), (1, 0..50), (2, 0..7)]);
        assert!(Part::Test.of(&[7], 0).is_err());
    }

    #[test]
    fn one_of_five_episodes_is_tested() {
        let rows = [30; 6];
        assert_eq!(Part::Test.of(&rows, 3).unwrap(), [(2, 0..30)]);
        assert_eq!(Part::Training.of(&rows, 3).unwrap().len(), 5);
        let rows = [1000, 30, 30, 30, 30];
        assert_eq!(Part::Test.of(&rows, 0).unwrap()[0], (0, 800..1000));
    }
}
