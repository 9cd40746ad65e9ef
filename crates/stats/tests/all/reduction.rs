//! The reduction is exact: the same bits from any number of threads, any split of the episodes over sources, any order of merging.

use std::convert::Infallible;

use faer::MatRef;
use fleetfoot_data::{Cancelled, Column, Error, Halo, MemorySource, Silent, Source, with_threads};
use fleetfoot_stats::{Gram, Grid, Key, MergeError, Stats, reduce};
use proptest::prelude::*;

#[derive(Debug)]
struct Failed;

impl From<Error> for Failed {
    fn from(_: Error) -> Self {
        Failed
    }
}

impl From<Cancelled> for Failed {
    fn from(_: Cancelled) -> Self {
        Failed
    }
}

impl From<Infallible> for Failed {
    fn from(never: Infallible) -> Self {
        match never {}
    }
}

/// An episode of this many rows; its values depend on `tag` alone.
fn episode(source: &mut MemorySource, tag: usize, rows: usize) {
    let value =
        |row: usize, column: usize| ((row * 7 + column * 13 + tag * 101) as f64 * 0.37).sin() * 1e3 + column as f64;
    source.push_uniform("e", 0.01, (0..3).map(|column| (0..rows).map(|row| value(row, column)).collect()).collect());
}

fn source(episodes: &[(usize, usize)]) -> MemorySource {
    let mut source = MemorySource::new(["a", "b", "c"].map(Column::float).to_vec());
    for &(tag, rows) in episodes {
        episode(&mut source, tag, rows);
    }
    source
}

fn scan(source: &MemorySource, grid: &Grid) -> Stats {
    let mut stats = Stats::new("plan");
    reduce(
        source,
        &grid.chunks(source.episodes()),
        Halo::default(),
        &Silent,
        || Gram::new(3),
        |gram, _, block, tile| {
            let columns: Vec<f64> = (0..3).flat_map(|c| block.core(c)[tile.clone()].to_vec()).collect();
            gram.merge(&Gram::of_rows(MatRef::from_column_major_slice(&columns, tile.len(), 3), None));
            Ok::<_, Failed>(())
        },
        |chunk, gram| {
            let episode = source.episodes()[chunk.episode].id;
            let key = Key { episode, chunk: chunk.index, fold: chunk.fold, partition: 0, region: 0 };
            stats.insert(key, gram).map_err(|_| Failed)
        },
    )
    .expect("memory reads");
    stats
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn splits_merges_and_threads_give_the_same_bits(
        lengths in prop::collection::vec(0usize..9_000, 1..6),
        to_left in prop::collection::vec(any::<bool>(), 6),
        chunk_rows in 1usize..6_000,
    ) {
        // One fold: with more, the folds of an episode depend on the others, which a plan fixes beforehand.
        let grid = Grid { chunk_rows };
        let episodes: Vec<(usize, usize)> = lengths.into_iter().enumerate().collect();
        let whole = scan(&source(&episodes), &grid);
        for threads in [1, 2, 7] {
            let again = with_threads(threads, || scan(&source(&episodes), &grid));
            prop_assert_eq!(&again, &whole);
        }
        let part = |left: bool| -> Vec<(usize, usize)> {
            episodes.iter().copied().filter(|&(tag, _)| to_left[tag] == left).rev().collect()
        };
        let (mut left, right) = (scan(&source(&part(true)), &grid), scan(&source(&part(false)), &grid));
        let mut other = right.clone();
        other.merge(left.clone()).unwrap();
        left.merge(right).unwrap();
        prop_assert_eq!(&left, &whole);
        prop_assert_eq!(&other, &whole);
        prop_assert_eq!(left.total(|_| true), whole.total(|_| true));
    }
}

#[test]
fn the_same_rows_twice_and_other_plans_are_refused() {
    let grid = Grid { chunk_rows: 100 };
    let stats = scan(&source(&[(1, 250), (2, 50)]), &grid);
    let mut total = scan(&source(&[(2, 50)]), &grid);
    let before = total.clone();
    assert!(matches!(total.merge(stats.clone()), Err(MergeError::Duplicate(_))));
    assert_eq!(total, before, "a refused merge changes nothing");
    assert!(matches!(total.merge(Stats::new("another")), Err(MergeError::Plan { .. })));
    assert_eq!(stats.len(), 4);
}
