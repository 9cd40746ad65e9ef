//! Starts of rollouts.

use std::collections::BTreeSet;

use fleetfoot_data::{Episode, Source, mix};

use crate::Error;

/// A row to start from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Start {
    /// Index of the episode in its source.
    pub episode: usize,
    /// Row in the episode: the first state of the rollout.
    pub row: usize,
}

/// Rule that chooses starts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Starts {
    /// This many, evenly spread over all possible rows.
    Even(usize),
    /// This many different ones, chosen by a seed.
    Random {
        /// Number of starts.
        count: usize,
        /// The seed.
        seed: u64,
    },
    /// These.
    At(Vec<Start>),
}

impl Starts {
    /// The starts, ordered by episode and row (those of [`Starts::At`] as given). Each has `before` rows in front and
    /// `after` rows behind inside its episode. If there are fewer possible rows than requested, all are used.
    ///
    /// The choice depends on the identities and lengths of the episodes, not on their order in the source.
    ///
    /// # Errors
    /// [`Error::TooShort`] when no episode is long enough; [`Error::BadStart`] for a given start that does not fit.
    pub fn choose(
        &self,
        source: &dyn Source,
        horizon: usize,
        before: usize,
        after: usize,
    ) -> Result<Vec<Start>, Error> {
        let episodes = source.episodes();
        let possible = |episode: &Episode| episode.rows.saturating_sub(before.saturating_add(after));
        let mut order: Vec<usize> = (0..episodes.len()).collect();
        order.sort_by_key(|&e| episodes[e].id);
        let total: usize = episodes.iter().map(possible).sum();
        let positions: Vec<usize> = match self {
            Starts::At(starts) => {
                return starts.iter().map(|&start| check(episodes, start, before, after)).collect();
            }
            _ if total == 0 => {
                return Err(too_short(episodes, horizon, before.saturating_add(after).saturating_add(1)));
            }
            Starts::Even(count) | Starts::Random { count, .. } if *count >= total => (0..total).collect(),
            Starts::Even(count) => {
                (0..*count).map(|i| ((2 * i as u128 + 1) * total as u128 / (2 * *count as u128)) as usize).collect()
            }
            Starts::Random { count, seed } => sample(*count, total, *seed),
        };
        let mut starts = Vec::with_capacity(positions.len());
        let (mut at, mut passed) = (0, 0);
        for position in positions {
            while passed + possible(&episodes[order[at]]) <= position {
                passed += possible(&episodes[order[at]]);
                at += 1;
            }
            starts.push(Start { episode: order[at], row: before + position - passed });
        }
        starts.sort_unstable();
        Ok(starts)
    }
}

fn check(episodes: &[Episode], start: Start, before: usize, after: usize) -> Result<Start, Error> {
    let (name, rows) =
        episodes.get(start.episode).map_or_else(|| (start.episode.to_string(), 0), |e| (e.name.clone(), e.rows));
    if start.row < before || start.row.saturating_add(after) >= rows {
        return Err(Error::BadStart { episode: name, row: start.row, before, after, rows });
    }
    Ok(start)
}

fn too_short(episodes: &[Episode], horizon: usize, needed: usize) -> Error {
    let longest = episodes.iter().max_by_key(|episode| episode.rows);
    Error::TooShort {
        horizon,
        needed,
        longest: longest.map_or(0, |episode| episode.rows),
        episode: longest.map(|episode| episode.name.clone()),
    }
}

/// `count` different positions below `total`, ascending (Floyd's algorithm, one counter-based draw a position).
fn sample(count: usize, total: usize, seed: u64) -> Vec<usize> {
    let mut chosen = BTreeSet::new();
    for bound in total - count..total {
        let draw = uniform(seed, bound as u64, bound as u64 + 1) as usize;
        if !chosen.insert(draw) {
            chosen.insert(bound);
        }
    }
    chosen.into_iter().collect()
}

/// A number below `bound` that depends on the seed and the key alone (the finaliser of SplitMix64, scaled by a wide product).
fn uniform(seed: u64, key: u64, bound: u64) -> u64 {
    let mut z = mix(seed).wrapping_add(key.wrapping_mul(0x9E37_79B9_7F4A_7C15));
    z = mix(z);
    ((u128::from(z) * u128::from(bound)) >> 64) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use fleetfoot_data::{Column, MemorySource};

    fn source(lengths: &[usize]) -> MemorySource {
        let mut source = MemorySource::new(vec![Column::float("x")]);
        for &length in lengths {
            source.push_uniform(format!("e{length}"), 0.01, vec![(0..length).map(|i| (i + length) as f64).collect()]);
        }
        source
    }

    #[test]
    fn starts_keep_their_rows_inside_the_episode() {
        let source = source(&[50, 8, 200, 11]);
        for starts in [Starts::Even(40), Starts::Random { count: 40, seed: 3 }, Starts::Even(100_000)] {
            let chosen = starts.choose(&source, 8, 2, 8).unwrap();
            let possible = 40 + 190 + 1;
            assert_eq!(chosen.len(), if starts == Starts::Even(100_000) { possible } else { 40 });
            assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]));
            for start in chosen {
                assert!(start.row >= 2 && start.row + 8 < source.episodes()[start.episode].rows);
            }
        }
    }

    #[test]
    fn random_starts_follow_the_seed_and_fill_the_range() {
        let source = source(&[1000]);
        let choose = |seed| Starts::Random { count: 300, seed }.choose(&source, 10, 1, 10).unwrap();
        assert_eq!(choose(1), choose(1));
        assert_ne!(choose(1), choose(2));
        let mean = choose(5).iter().map(|start| start.row as f64).sum::<f64>() / 300.0;
        // 989 possible rows: the mean of 300 draws lies within 4 standard errors of 495.
        assert!((mean - 495.0).abs() < 4.0 * 989.0 / 12f64.sqrt() / 300f64.sqrt(), "{mean}");
    }

    #[test]
    fn too_long_a_horizon_is_an_error_with_numbers() {
        let source = source(&[20, 30]);
        let error = Starts::Even(5).choose(&source, 40, 1, 40).unwrap_err().to_string();
        assert!(
            error.contains("40 steps") && error.contains("42") && error.contains("30") && error.contains("e30"),
            "{error}"
        );
        let start = |row| Starts::At(vec![Start { episode: 1, row }]).choose(&source, 10, 2, 10);
        assert!(start(1).is_err() && start(2).is_ok() && start(19).is_ok() && start(20).is_err());
        assert!(Starts::At(vec![Start { episode: 7, row: 3 }]).choose(&source, 10, 2, 10).is_err());
    }
}
