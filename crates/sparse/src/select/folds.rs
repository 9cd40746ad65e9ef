//! Folds: training and test statistics, as weights of the members.

use std::collections::{BTreeMap, BTreeSet};

use faer::{Mat, MatRef};
use fleetfoot_data::{EpisodeId, mix};
use fleetfoot_stats::{FoldLayout, FoldRule, Key, Purge, SPANS};

use super::SelectError;
use crate::SparseError;

/// Training and test weights of every member in every fold: 0 or 1, so that a fold is a reweighting of [`Banks`](fleetfoot_sums::structured::Banks).
///
/// Members are known by their keys and rows ([`Banks::keys`](fleetfoot_sums::structured::Banks::keys), [`Banks::rows`](fleetfoot_sums::structured::Banks::rows)). Neighbouring rows of a log are
/// correlated, so no fold cuts through a chunk; which chunks are held out together is for [`FoldLayout`] to say, as for every method.
#[derive(Debug, Clone, PartialEq)]
pub struct Folds {
    train: Mat<f64>,
    test: Mat<f64>,
    rule: String,
}

/// Repeated random splits, [`Folds::random_splits`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomSplits {
    /// Share of the rows that is held out.
    pub share: f64,
    /// Number of splits.
    pub repeats: usize,
    /// Seed.
    pub seed: u64,
    /// Rows left out on both sides of a held-out span, where an episode is cut.
    pub purge: Purge,
}

impl Default for RandomSplits {
    /// 30 splits of 33 % (block-sparse bolasso paper, section 9.2).
    fn default() -> Self {
        Self { share: 0.33, repeats: 30, seed: 0, purge: Purge::TENTH }
    }
}

impl Folds {
    /// Folds by the one rule ([`FoldLayout::new`]): the rows of an episode are those of its members, in the order of the chunks. Where nobody says how many
    /// ([`FoldRule::Auto`]) and chunks are too long for ten folds of spans, there are five, or as many as episodes.
    ///
    /// # Errors
    /// Folds that cannot be made of these rows, or have no rows on one side: chunks may be longer than the spans that are asked for.
    pub fn of(keys: &[Key], rows: &[u64], rule: FoldRule, purge: Purge) -> Result<Self, SelectError> {
        let laid_out = Self::laid_out(keys, rows, rule, purge);
        match (rule, &laid_out) {
            (FoldRule::Auto, Err(SelectError::EmptyFold { .. })) => {
                let fewer =
                    [FoldRule::Count(SPANS), FoldRule::Episodes].map(|rule| Self::laid_out(keys, rows, rule, purge));
                fewer.into_iter().find(Result::is_ok).unwrap_or(laid_out)
            }
            _ => laid_out,
        }
    }

    fn laid_out(keys: &[Key], rows: &[u64], rule: FoldRule, purge: Purge) -> Result<Self, SelectError> {
        check_rows(keys, rows)?;
        let chunks = lengths(keys, rows, |key| (key.episode, key.chunk));
        let episodes = lengths(keys, rows, |key| key.episode);
        let whole = episodes.iter().map(|(id, rows)| (*id, *rows as usize));
        let layout = FoldLayout::new(rule, whole, purge)?;
        let (mut places, mut before) = (BTreeMap::new(), (None, 0));
        for (&(episode, chunk), &rows) in &chunks {
            let from = if before.0 == Some(episode) { before.1 } else { 0 };
            let to = from + rows as usize;
            places.insert((episode, chunk), layout.place(episode, episodes[&episode] as usize, from..to));
            before = (Some(episode), to);
        }
        let place = |m: usize| places[&(keys[m].episode, keys[m].chunk)];
        let k = usize::from(layout.folds());
        let test = Mat::from_fn(keys.len(), k, |m, fold| f64::from(u8::from(place(m).held_out == fold as u16)));
        let train = Mat::from_fn(keys.len(), k, |m, fold| f64::from(u8::from(place(m).trains(fold as u16))));
        Ok(Self { rule: layout.in_words(), ..Self::new(train, test)? })
    }

    /// Every group of members held out once: `group` names the group of a member; members without one always train.
    ///
    /// # Errors
    /// When there are fewer than two groups, or nothing is left to train on.
    pub fn by<G: Ord>(keys: &[Key], group: impl Fn(&Key) -> Option<G>) -> Result<Self, SelectError> {
        let groups: Vec<Option<G>> = keys.iter().map(group).collect();
        let distinct: Vec<&G> = groups.iter().flatten().collect::<BTreeSet<_>>().into_iter().collect();
        if distinct.len() < 2 {
            return Err(SelectError::TooFew { what: "groups", count: distinct.len(), needed: 2 });
        }
        let k = distinct.len();
        let held_out = |m: usize, fold: usize| groups[m].as_ref() == Some(distinct[fold]);
        let test = Mat::from_fn(keys.len(), k, |m, fold| f64::from(u8::from(held_out(m, fold))));
        let train = Mat::from_fn(keys.len(), k, |m, fold| 1.0 - test[(m, fold)]);
        Ok(Self { rule: format!("every one of {k} groups left out once"), ..Self::new(train, test)? })
    }

    /// Repeated random splits: in each, about [`RandomSplits::share`] of the rows is held out.
    ///
    /// With enough episodes for two on either side, whole episodes are drawn, in an order that is a hash of seed, split and episode; with fewer,
    /// one contiguous span of chunks is, which begins at random and may go round from the last chunk to the first, with its purge gaps.
    ///
    /// # Errors
    /// When the share is not between 0 and 1, there are no splits, or a split has no rows on one side.
    pub fn random_splits(keys: &[Key], rows: &[u64], options: &RandomSplits) -> Result<Self, SelectError> {
        check_rows(keys, rows)?;
        let &RandomSplits { share, repeats, seed, purge } = options;
        if !(share > 0.0 && share < 1.0) {
            return Err(SelectError::Share { value: share });
        }
        if repeats == 0 {
            return Err(SelectError::FoldCount { count: 0 });
        }
        let episodes = lengths(keys, rows, |key| key.episode);
        if episodes.len() as f64 * share.min(1.0 - share) >= 2.0 {
            let drawn: Vec<BTreeSet<EpisodeId>> = (0..repeats)
                .map(|repeat| {
                    let address = |episode: &EpisodeId| {
                        let (low, high) = (episode.0 as u64, (episode.0 >> 64) as u64);
                        let start = mix(mix(seed).wrapping_add(repeat as u64));
                        mix(mix(start.wrapping_add(low)).wrapping_add(high))
                    };
                    let mut order: Vec<(EpisodeId, u64)> = episodes.iter().map(|(id, n)| (*id, *n)).collect();
                    order.sort_by_key(|(id, _)| (address(id), *id));
                    take(order, share)
                })
                .collect();
            let of_episodes = Self::of_tests(keys, 0, repeats, |key, fold| drawn[fold].contains(&key.episode))?;
            return Ok(Self { rule: split_words(share, repeats, "episodes"), ..of_episodes });
        }
        let chunks: Vec<((EpisodeId, u32), u64)> =
            lengths(keys, rows, |key| (key.episode, key.chunk)).into_iter().collect();
        if chunks.len() < 2 {
            return Err(SelectError::TooFew { what: "chunks", count: chunks.len(), needed: 2 });
        }
        let drawn: Vec<BTreeSet<(EpisodeId, u32)>> = (0..repeats)
            .map(|repeat| {
                let random = mix(mix(seed).wrapping_add(repeat as u64));
                let start = (u128::from(random) * chunks.len() as u128) >> 64;
                let mut order = chunks.clone();
                order.rotate_left(start as usize);
                take(order, share)
            })
            .collect();
        let purge = purged_chunks(purge, share, &chunks);
        let of_spans =
            Self::of_tests(keys, purge, repeats, |key, fold| drawn[fold].contains(&(key.episode, key.chunk)))?;
        Ok(Self { rule: split_words(share, repeats, "rows, each one span"), ..of_spans })
    }

    /// Folds from weights (members x folds, finite, not negative).
    ///
    /// # Errors
    /// When the shapes disagree, or a fold has no member on one side.
    pub fn new(train: Mat<f64>, test: Mat<f64>) -> Result<Self, SelectError> {
        if train.nrows() != test.nrows() {
            let (rows, expected) = (test.nrows(), train.nrows());
            return Err(SelectError::Members { what: "the test weights", actual: rows, expected });
        }
        if train.ncols() != test.ncols() || train.ncols() == 0 {
            return Err(SelectError::FoldCount { count: train.ncols().min(test.ncols()) });
        }
        for (side, weights) in [("train", &train), ("test", &test)] {
            for fold in 0..weights.ncols() {
                let column = weights.col_as_slice(fold);
                if let Some(&value) = column.iter().find(|value| !(**value >= 0.0 && value.is_finite())) {
                    return Err(SparseError::Strength { name: "a member's weight", value }.into());
                }
                if column.iter().all(|&value| value == 0.0) {
                    return Err(SelectError::EmptyFold { fold, side });
                }
            }
        }
        Ok(Self { train, test, rule: "given folds".into() })
    }

    /// Folds from what each holds out; what is within `purge` chunks of that in the same episode does not train.
    fn of_tests(
        keys: &[Key],
        purge: u32,
        k: usize,
        held_out: impl Fn(&Key, usize) -> bool,
    ) -> Result<Self, SelectError> {
        let mut train = Mat::zeros(keys.len(), k);
        let mut test = Mat::zeros(keys.len(), k);
        for fold in 0..k {
            let chunks: BTreeSet<(EpisodeId, u32)> =
                keys.iter().filter(|key| held_out(key, fold)).map(|key| (key.episode, key.chunk)).collect();
            for (m, key) in keys.iter().enumerate() {
                let (first, last) = (key.chunk.saturating_sub(purge), key.chunk.saturating_add(purge));
                if chunks.contains(&(key.episode, key.chunk)) {
                    test[(m, fold)] = 1.0;
                } else if chunks.range((key.episode, first)..=(key.episode, last)).next().is_none() {
                    train[(m, fold)] = 1.0;
                }
            }
        }
        Self::new(train, test)
    }

    /// Rule by which rows are held out, for people.
    pub fn rule(&self) -> &str {
        &self.rule
    }

    /// Number of folds.
    pub fn len(&self) -> usize {
        self.train.ncols()
    }

    /// Returns true if there are no folds.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of members.
    pub fn members(&self) -> usize {
        self.train.nrows()
    }

    /// Training weights (members x folds).
    pub fn train(&self) -> MatRef<'_, f64> {
        self.train.as_ref()
    }

    /// Test weights (members x folds).
    pub fn test(&self) -> MatRef<'_, f64> {
        self.test.as_ref()
    }

    /// Returns true if a member is held out by more than one fold, as in repeated random splits.
    pub fn overlap(&self) -> bool {
        (0..self.members()).any(|m| (0..self.len()).filter(|&fold| self.test[(m, fold)] > 0.0).count() > 1)
    }
}

fn check_rows(keys: &[Key], rows: &[u64]) -> Result<(), SelectError> {
    if keys.len() == rows.len() {
        Ok(())
    } else {
        Err(SelectError::Members { what: "the list of rows", actual: rows.len(), expected: keys.len() })
    }
}

/// Rows of every unit, in order.
fn lengths<U: Ord>(keys: &[Key], rows: &[u64], unit: impl Fn(&Key) -> U) -> BTreeMap<U, u64> {
    let mut lengths = BTreeMap::new();
    keys.iter().zip(rows).for_each(|(key, rows)| *lengths.entry(unit(key)).or_insert(0) += rows);
    lengths
}

fn split_words(share: f64, repeats: usize, what: &str) -> String {
    format!("{repeats} random splits with {:.0} % of the {what} held out", 100.0 * share)
}

/// The purge gap of a random span in chunks.
fn purged_chunks(purge: Purge, share: f64, chunks: &[((EpisodeId, u32), u64)]) -> u32 {
    let longest = chunks.iter().map(|(_, rows)| *rows).max().unwrap_or(1).max(1);
    let span = share * chunks.iter().map(|(_, rows)| *rows as f64).sum::<f64>();
    let of = |rows: usize| (rows as u64).div_ceil(longest);
    let (all, tenth) = (of(purge.rows(span as usize)), Purge::TENTH.rows(span as usize) as u64 / longest);
    let chunks = all.min(tenth).max(of(purge.certain(span as usize)));
    u32::try_from(chunks).unwrap_or(u32::MAX)
}

/// The first units whose rows come nearest to a share of all: at least one, and not all.
fn take<U: Ord>(order: Vec<(U, u64)>, share: f64) -> BTreeSet<U> {
    let wanted = share * order.iter().map(|(_, rows)| *rows as f64).sum::<f64>();
    let most = order.len().saturating_sub(1);
    let mut taken = BTreeSet::new();
    let mut sum = 0.0;
    for (unit, rows) in order.into_iter().take(most) {
        let after = sum + rows as f64;
        if !taken.is_empty() && (after - wanted).abs() > (sum - wanted).abs() {
            break;
        }
        taken.insert(unit);
        sum = after;
    }
    taken
}

#[cfg(test)]
mod tests {
    use fleetfoot_stats::{Fold, FoldError};
    use proptest::prelude::*;

    use super::*;

    fn key(episode: u128, chunk: u32) -> Key {
        Key { episode: EpisodeId(episode), chunk, fold: Fold::default(), partition: 0, region: 0 }
    }

    fn members(lengths: &[(u32, u64)]) -> (Vec<Key>, Vec<u64>) {
        let keys =
            lengths.iter().enumerate().flat_map(|(e, &(chunks, _))| (0..chunks).map(move |c| key(e as u128 * 7, c)));
        let rows = lengths.iter().flat_map(|&(chunks, rows)| vec![rows; chunks as usize]);
        (keys.collect(), rows.collect())
    }

    fn sides(folds: &Folds, fold: usize) -> (Vec<usize>, Vec<usize>) {
        let of = |weights: MatRef<'_, f64>| (0..folds.members()).filter(|&m| weights[(m, fold)] > 0.0).collect();
        (of(folds.train()), of(folds.test()))
    }

    #[test]
    fn spans_have_gaps_on_both_sides() {
        // Two episodes of 120 chunks of one row: ten spans of twelve chunks, a gap of one.
        let (keys, rows) = members(&[(120, 1), (120, 1)]);
        let folds = Folds::of(&keys, &rows, FoldRule::Count(10), Purge::TENTH).unwrap();
        let (train, test) = sides(&folds, 3);
        assert_eq!(test, (36..48).chain(156..168).collect::<Vec<_>>());
        let wanted = |m: &usize| !(35..49).contains(&(m % 120));
        assert_eq!(train, (0..240).filter(wanted).collect::<Vec<_>>());
        assert!(!folds.overlap());
        assert_eq!(folds.rule(), "10 folds of spans, 10 an episode of up to 12 rows, a gap of 1 row on either side");
    }

    #[test]
    fn data_that_cannot_be_split_are_refused() {
        let (keys, rows) = members(&[(3, 10)]);
        let of = |count| Folds::of(&keys, &rows, FoldRule::Count(count), Purge::TENTH);
        // Ten spans of three rows, but chunks of ten.
        assert_eq!(of(10), Err(SelectError::EmptyFold { fold: 0, side: "test" }));
        assert!(of(10).unwrap_err().to_string().starts_with("fold 1 has no rows to test: "));
        assert_eq!(
            Folds::of(&keys, &rows, FoldRule::Auto, Purge::TENTH),
            Err(SelectError::EmptyFold { fold: 1, side: "test" })
        );
        assert!(matches!(of(40), Err(SelectError::Folds(FoldError::Rows { .. }))));
        let episodes = Folds::of(&keys, &rows, FoldRule::Episodes, Purge::TENTH);
        assert!(matches!(episodes, Err(SelectError::Folds(FoldError::Episodes { episodes: 1 }))));
        let options = RandomSplits { share: 1.0, ..RandomSplits::default() };
        assert_eq!(Folds::random_splits(&keys, &rows, &options), Err(SelectError::Share { value: 1.0 }));
    }

    #[test]
    fn long_chunks_are_held_out_by_episodes() {
        let (keys, rows) = members(&[(5, 100); 6]);
        let auto = Folds::of(&keys, &rows, FoldRule::Auto, Purge::TENTH).unwrap();
        assert_eq!((auto.len(), auto.rule()), (5, "5 folds of 6 whole episodes"));
        let (keys, rows) = members(&[(1, 100); 3]);
        let auto = Folds::of(&keys, &rows, FoldRule::Auto, Purge::TENTH).unwrap();
        assert_eq!((auto.len(), auto.rule()), (3, "every one of 3 episodes left out once"));
        assert!(Folds::of(&keys, &rows, FoldRule::Count(10), Purge::TENTH).is_err());
    }

    #[test]
    fn groups_are_held_out_and_rows_without_group_train() {
        let (keys, _) = members(&[(2, 10), (1, 10), (3, 10)]);
        let folds = Folds::by(&keys, |key| (key.episode.0 > 0).then_some(key.episode)).unwrap();
        assert_eq!(folds.len(), 2);
        assert_eq!(sides(&folds, 0), (vec![0, 1, 3, 4, 5], vec![2]));
        assert_eq!(sides(&folds, 1), (vec![0, 1, 2], vec![3, 4, 5]));
    }

    #[test]
    fn an_episode_more_does_not_reorder_the_others() {
        let (keys, rows) = members(&[(1, 10); 30]);
        let options = RandomSplits { repeats: 50, ..RandomSplits::default() };
        let all = Folds::random_splits(&keys, &rows, &options).unwrap();
        let fewer = Folds::random_splits(&keys[1..], &rows[1..], &options).unwrap();
        let moved: usize =
            (0..50).map(|fold| (1..30).filter(|&m| all.test[(m, fold)] != fewer.test[(m - 1, fold)]).count()).sum();
        // Only those at the border of the share may change sides.
        assert!(moved <= 50, "{moved}");
        // Every episode is held out about a third of the time: 16.7 of 50, deviation 3.3.
        for m in 0..30 {
            let count = (0..50).filter(|&fold| all.test[(m, fold)] > 0.0).count();
            assert!((4..=30).contains(&count), "{m}: {count}");
        }
    }

    proptest! {
        #[test]
        fn every_member_is_held_out_once(lengths in prop::collection::vec((20_u32..60, 1_u64..50), 1..12), k in 2_usize..8) {
            let (keys, rows) = members(&lengths);
            let folds = Folds::of(&keys, &rows, FoldRule::Count(k), Purge::Exactly(0)).unwrap();
            for m in 0..keys.len() {
                let count = (0..k).filter(|&fold| folds.test[(m, fold)] > 0.0).count();
                prop_assert_eq!(count, 1);
                for fold in 0..k {
                    prop_assert_eq!(folds.train[(m, fold)] + folds.test[(m, fold)], 1.0);
                }
            }
            // No fold of whole episodes is fuller than another by more than the longest.
            let filled: Vec<u64> = (0..k).map(|fold| (0..keys.len()).filter(|&m| folds.test[(m, fold)] > 0.0).map(|m| rows[m]).sum()).collect();
            let largest = lengths.iter().map(|&(chunks, rows)| u64::from(chunks) * rows).max().unwrap();
            if lengths.len() >= k.max(SPANS) {
                prop_assert!(filled.iter().max().unwrap() - filled.iter().min().unwrap() <= largest);
            }
        }

        #[test]
        fn splits_hold_out_their_share(lengths in prop::collection::vec((1_u32..6, 1_u64..50), 8..30), seed in any::<u64>()) {
            let (keys, rows) = members(&lengths);
            let options = RandomSplits { seed, repeats: 5, ..RandomSplits::default() };
            let folds = Folds::random_splits(&keys, &rows, &options).unwrap();
            let total: u64 = rows.iter().sum();
            let largest = lengths.iter().map(|&(chunks, rows)| u64::from(chunks) * rows).max().unwrap();
            for fold in 0..5 {
                let (train, test) = sides(&folds, fold);
                prop_assert_eq!(train.len() + test.len(), keys.len());
                let held: u64 = test.iter().map(|&m| rows[m]).sum();
                prop_assert!((held as f64 - 0.33 * total as f64).abs() <= largest as f64);
                for (a, b) in train.iter().flat_map(|&a| test.iter().map(move |&b| (a, b))) {
                    prop_assert!(keys[a].episode != keys[b].episode);
                }
            }
        }
    }
}
