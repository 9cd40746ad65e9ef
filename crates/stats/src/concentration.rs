//! Columns whose variance comes mostly from few rows.

use std::{collections::BTreeMap, ops::Range};

use fleetfoot_data::EpisodeId;

use crate::{Gram, Stats};

/// The share of the rows that is few.
const FEW: f64 = 0.02;
/// The same of a single chunk: those of large problems are long.
const FEW_OF_ONE: f64 = 0.1;
/// The share of the variance that is most of it.
const MOST: f64 = 0.5;

/// Few rows that hold most of a column's variance: least squares are a fit of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Concentration {
    /// Their share of all rows.
    pub rows: f64,
    /// Their share of the sum of squares about the mean.
    pub squares: f64,
    /// Place of the heaviest rows: an episode, and a range of its rows.
    pub place: (EpisodeId, Range<u64>),
}

impl Concentration {
    /// The fewest chunks, of so many rows, that hold most of the variance of a column, where they have few of all rows, or are one; `None` where it is spread, or where there is no such
    /// column.
    pub fn of(sums: &Stats, column: usize, chunk_rows: usize) -> Option<Self> {
        let chunks: BTreeMap<(EpisodeId, u32), Gram> = sums.totals(|key| Some((key.episode, key.chunk)));
        let all = sums.total(|_| true).filter(|all| column < all.dimension())?;
        let about_mean =
            |gram: &Gram| gram.get(column, column) + gram.weight * (gram.mean[column] - all.mean[column]).powi(2);
        let mut heaviest: Vec<((EpisodeId, u32), f64, f64)> =
            chunks.iter().map(|(place, gram)| (*place, about_mean(gram), gram.rows as f64)).collect();
        // By what a row of them weighs; equal ones in their order.
        heaviest.sort_by(|a, b| (b.1 / b.2.max(1.0)).total_cmp(&(a.1 / a.2.max(1.0))));
        let (mut rows, mut squares) = (0.0, 0.0);
        for (count, (_, chunk_squares, chunk_row_count)) in heaviest.iter().enumerate() {
            rows += chunk_row_count / all.rows as f64;
            squares += chunk_squares / all.get(column, column);
            if rows > if count == 0 { FEW_OF_ONE } else { FEW } {
                return None;
            }
            if squares >= MOST {
                let chunks: Vec<(EpisodeId, u32)> = heaviest[..=count].iter().map(|(place, ..)| *place).collect();
                return Some(Self { rows, squares, place: stretch(&chunks, chunk_rows as u64) });
            }
        }
        None
    }
}

/// The rows of consecutive chunks around the first of some.
fn stretch(chunks: &[(EpisodeId, u32)], chunk_rows: u64) -> (EpisodeId, Range<u64>) {
    let (episode, heaviest) = chunks[0];
    let has = |chunk: u32| chunks.contains(&(episode, chunk));
    let (mut first, mut last) = (heaviest, heaviest);
    while first > 0 && has(first - 1) {
        first -= 1;
    }
    while has(last + 1) {
        last += 1;
    }
    (episode, u64::from(first) * chunk_rows..u64::from(last + 1) * chunk_rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fold, Key};
    use faer::Mat;

    /// Two episodes of chunks of ten rows; a row's value is its number in -1 to 1 but where `value` says otherwise.
    fn sums(chunks: u32, value: impl Fn(u128, u32, usize) -> Option<f64>) -> Stats {
        let mut sums = Stats::new("test");
        for episode in [3, 7] {
            for chunk in 0..chunks {
                let plain = |row: usize| if row.is_multiple_of(2) { 1.0 } else { -1.0 };
                let z = Mat::from_fn(10, 1, |row, _| value(episode, chunk, row).unwrap_or_else(|| plain(row)));
                let key = Key { episode: EpisodeId(episode), chunk, fold: Fold::default(), partition: 0, region: 0 };
                sums.insert(key, Gram::of_rows(z.as_ref(), None)).unwrap();
            }
        }
        sums
    }

    fn of(sums: &Stats) -> Option<Concentration> {
        Concentration::of(sums, 0, 10)
    }

    #[test]
    fn only_concentrated_variance_is_detected() {
        assert_eq!(of(&sums(100, |_, _, _| None)), None);
        let fall = |episode, chunk, row| {
            (episode == 7 && (chunk == 41 || chunk == 42 && row < 3)).then_some([90.0, -90.0][row % 2])
        };
        let fall = of(&sums(100, fall)).unwrap();
        assert_eq!((fall.place, fall.rows), ((EpisodeId(7), 410..420), 0.005));
        // 10 of 13 such rows, beside 1,987 of one.
        let expected = 81_000.0 / (13.0 * 8100.0 + 1987.0);
        assert!((fall.squares - expected).abs() < 1e-3, "{} {expected}", fall.squares);
        let wider = |episode, chunk, row| (episode == 3 && chunk < 4).then_some([90.0, -90.0][row % 2]);
        let fall = of(&sums(100, wider)).unwrap();
        assert_eq!((fall.place, fall.rows), ((EpisodeId(3), 0..30), 0.015));
        // One in 25 rows is not few, and a constant has no variance.
        assert_eq!(of(&sums(100, |_, chunk, row| (chunk < 5).then_some([90.0, -90.0][row % 2]))).map(|c| c.rows), None);
        assert_eq!(of(&sums(100, |_, _, _| Some(2.0))), None);
    }
}
