//! Statistics by key: every sum is exact, in whichever parts it was computed.

use std::collections::BTreeMap;

use fleetfoot_data::EpisodeId;

use crate::Gram;

/// Place of a row in cross-validation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Fold {
    /// The fold that holds the row out.
    pub held_out: u16,
    /// Folds whose held-out rows are so near in time that the row must not train them either (the purge gap).
    pub purged: [Option<u16>; 2],
}

impl Fold {
    /// Returns true if the row trains the model that is tested on `fold`.
    pub fn trains(&self, fold: u16) -> bool {
        self.held_out != fold && !self.purged.contains(&Some(fold))
    }
}

/// The key of one stored statistic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key {
    /// The episode.
    pub episode: EpisodeId,
    /// The chunk of the episode.
    pub chunk: u32,
    /// The chunk's place in cross-validation.
    pub fold: Fold,
    /// Index of the partition, among those that share the pass.
    pub partition: u16,
    /// The region of that partition.
    pub region: u32,
}

/// Why two statistics cannot be joined.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MergeError {
    /// The same rows on both sides.
    #[error("chunk {} of episode {} is in both statistics: the same log would count twice", .0.chunk, .0.episode)]
    Duplicate(Box<Key>),
    /// Not made with the same plan: columns, library, targets, preconditioner, chunk length or folds differ.
    #[error("the statistics were made with different plans ({left} and {right}): scan again with one plan")]
    Plan {
        /// Hash of one plan.
        left: String,
        /// Hash of the other.
        right: String,
    },
}

/// Sums over the rows of a chunk, which can be added to those of other chunks and kept as words of eight bytes.
pub trait Sum: Clone {
    /// Adds the rows of another.
    fn merge(&mut self, other: &Self);

    /// Size parameter that determines the number of words: its columns, or its sums.
    fn shape(&self) -> usize;

    /// Words of a sum of this shape; `None` where that overflows.
    fn words(shape: usize) -> Option<usize>;

    /// Hands on its words, in order.
    fn write(&self, put: &mut dyn FnMut([u8; 8]));

    /// Of the words that [`Sum::write`] handed on; `None` where they end.
    fn read(shape: usize, take: &mut dyn FnMut() -> Option<[u8; 8]>) -> Option<Self>;
}

/// Sums by key, all made with one plan. Merging is a union: nothing is rounded before a total is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Keyed<S> {
    plan: String,
    sums: BTreeMap<Key, S>,
}

/// Gram matrices by key.
pub type Stats = Keyed<Gram>;

impl<S: Sum> Keyed<S> {
    /// An empty statistic of the plan with this hash.
    pub fn new(plan: impl Into<String>) -> Self {
        Self { plan: plan.into(), sums: BTreeMap::new() }
    }

    /// Hash of the plan.
    pub fn plan(&self) -> &str {
        &self.plan
    }

    /// Adds the statistic of one key; a key that is there already is refused.
    pub fn insert(&mut self, key: Key, sum: S) -> Result<(), MergeError> {
        match self.sums.entry(key) {
            std::collections::btree_map::Entry::Occupied(_) => Err(MergeError::Duplicate(Box::new(key))),
            std::collections::btree_map::Entry::Vacant(slot) => {
                slot.insert(sum);
                Ok(())
            }
        }
    }

    /// Adds rows to those of a key.
    pub fn add(&mut self, key: Key, sum: S) {
        match self.sums.entry(key) {
            std::collections::btree_map::Entry::Occupied(mut total) => total.get_mut().merge(&sum),
            std::collections::btree_map::Entry::Vacant(slot) => _ = slot.insert(sum),
        }
    }

    /// Union by key. On error `self` is unchanged.
    pub fn merge(&mut self, other: Self) -> Result<(), MergeError> {
        self.accepts(&other)?;
        self.sums.extend(other.sums);
        Ok(())
    }

    /// Checks that [`Stats::merge`] would succeed.
    ///
    /// # Errors
    /// The error that the merge would return.
    pub fn accepts(&self, other: &Self) -> Result<(), MergeError> {
        if self.plan != other.plan {
            return Err(MergeError::Plan { left: self.plan.clone(), right: other.plan.clone() });
        }
        match other.sums.keys().find(|key| self.sums.contains_key(key)) {
            Some(key) => Err(MergeError::Duplicate(Box::new(*key))),
            None => Ok(()),
        }
    }

    /// Keeps the statistics whose keys are wanted.
    pub fn retain(&mut self, wanted: impl Fn(&Key) -> bool) {
        self.sums.retain(|key, _| wanted(key));
    }

    /// The sums, in key order, of the statistics that share what `name` makes of their keys.
    pub fn grouped(&self, name: impl Fn(&Key) -> Key) -> Self {
        Self { plan: self.plan.clone(), sums: self.totals(|key| Some(name(key))) }
    }

    /// Keys and statistics, in key order.
    pub fn iter(&self) -> impl Iterator<Item = (&Key, &S)> {
        self.sums.iter()
    }

    /// The sum, in key order, of the statistics that `wanted` selects; `None` when there are none.
    pub fn total(&self, wanted: impl Fn(&Key) -> bool) -> Option<S> {
        let mut selected = self.sums.iter().filter(|(key, _)| wanted(key)).map(|(_, sum)| sum);
        let mut total = selected.next()?.clone();
        for sum in selected {
            total.merge(sum);
        }
        Some(total)
    }

    /// Sums, in key order, grouped: `group` names the group of a key or drops it.
    pub fn totals<G: Ord>(&self, group: impl Fn(&Key) -> Option<G>) -> BTreeMap<G, S> {
        let mut totals: BTreeMap<G, S> = BTreeMap::new();
        for (key, sum) in &self.sums {
            if let Some(name) = group(key) {
                match totals.entry(name) {
                    std::collections::btree_map::Entry::Occupied(mut total) => total.get_mut().merge(sum),
                    std::collections::btree_map::Entry::Vacant(slot) => {
                        slot.insert(sum.clone());
                    }
                }
            }
        }
        totals
    }

    /// Shape of every statistic, the columns of Gram matrices; `None` when there are none.
    pub fn dimension(&self) -> Option<usize> {
        self.sums.values().next().map(Sum::shape)
    }

    /// Number of keys.
    pub fn len(&self) -> usize {
        self.sums.len()
    }

    /// Returns true if there are no statistics.
    pub fn is_empty(&self) -> bool {
        self.sums.is_empty()
    }
}
