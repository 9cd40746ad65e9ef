//! Sums of a pass, by episode and chunk: they are merged, parted by episode, and kept.

use std::collections::BTreeMap;

use fleetfoot_data::EpisodeId;
use fleetfoot_stats::{
    Fold, Key, Keyed, MergeError, PolynomialMoments, Stats, Sum,
    scan::{RegionRanges, RowCounts},
};

use super::{SystemPlan, plan::Coordinates};

/// The sums of a [`SystemPlan`] over some rows.
#[derive(Debug, Clone, PartialEq)]
pub struct SystemSums {
    /// Gram matrices of preconditioned functions and targets, by chunk and region; none where moments are summed.
    pub grams: Stats,
    /// Chebyshev moments by chunk; none where products are summed.
    pub moments: Keyed<PolynomialMoments>,
    /// Moments of [`System::also`](super::System), raw, by chunk.
    pub also: Stats,
    /// Moments of [`System::sampled`](super::System), raw, over the sampled rows of every chunk.
    pub sampled: Stats,
    /// Facts about every episode.
    pub episodes: BTreeMap<EpisodeId, EpisodeSums>,
}

/// Rows of an episode, and the ranges of its functions.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EpisodeSums {
    /// Its rows.
    pub counts: RowCounts,
    /// Complete rows that no region took.
    pub unassigned: u64,
    /// Least and greatest value of every function in every region (regions x functions, in the order of the scan).
    pub ranges: RegionRanges,
}

impl EpisodeSums {
    /// Adds other rows of the same functions and regions.
    pub(super) fn add(&mut self, other: &Self) {
        self.counts.add(other.counts);
        self.unassigned += other.unassigned;
        self.ranges.merge(&other.ranges);
    }
}

impl SystemSums {
    /// Adds the sums of other rows with the same plan: a union by key.
    ///
    /// # Errors
    /// Another plan, or rows that are on both sides; `self` is then unchanged.
    pub fn merge(&mut self, other: Self) -> Result<(), MergeError> {
        self.grams.accepts(&other.grams)?;
        self.moments.accepts(&other.moments)?;
        self.also.accepts(&other.also)?;
        self.sampled.accepts(&other.sampled)?;
        self.grams.merge(other.grams)?;
        self.moments.merge(other.moments)?;
        self.also.merge(other.also)?;
        self.sampled.merge(other.sampled)?;
        self.episodes.extend(other.episodes);
        Ok(())
    }

    /// Keeps the wanted episodes; the result equals a pass over them alone.
    pub fn retain(&mut self, wanted: impl Fn(EpisodeId) -> bool) {
        self.grams.retain(|key| wanted(key.episode));
        self.moments.retain(|key| wanted(key.episode));
        self.also.retain(|key| wanted(key.episode));
        self.sampled.retain(|key| wanted(key.episode));
        self.episodes.retain(|&episode, _| wanted(episode));
    }

    /// Sums the chunks of every episode, region by region. The result cannot be split into chunks any more.
    pub fn compact(&mut self) {
        fn whole<S: Sum>(sums: &mut Keyed<S>) {
            *sums = sums.grouped(|key| Key { chunk: 0, fold: Fold::default(), ..*key });
        }
        whole(&mut self.grams);
        whole(&mut self.moments);
        whole(&mut self.also);
        whole(&mut self.sampled);
    }

    /// The rows of all episodes.
    pub fn counts(&self) -> RowCounts {
        let mut total = RowCounts::default();
        self.episodes.values().for_each(|episode| total.add(episode.counts));
        total
    }

    /// Returns true if these sums, read from a file, have the columns and regions of a plan, and every chunk has a
    /// known episode.
    pub fn are_of(&self, plan: &SystemPlan) -> bool {
        let system = &plan.system;
        let regions = system.regions();
        let is = |known: Option<usize>, wanted: usize| known.is_none_or(|known| known == wanted);
        let of_episode = |key: &Key| self.episodes.contains_key(&key.episode);
        let keys = || self.also.iter().chain(self.sampled.iter()).map(|(key, _)| key);
        let summed = match &plan.coordinates {
            Coordinates::General(preconditioner) => {
                self.moments.is_empty() && is(self.grams.dimension(), preconditioner.dimension())
            }
            Coordinates::Polynomial(polynomial) => {
                self.grams.is_empty() && is(self.moments.dimension(), polynomial.plan.sums())
            }
        };
        let of_plan = |episode: &EpisodeSums| {
            episode.ranges.0.len() == regions
                && episode.ranges.0.iter().all(|ranges| ranges.len() == system.functions.len())
        };
        summed
            && is(self.also.dimension(), system.also.len())
            && is(self.sampled.dimension(), system.sampled.len())
            && self.grams.iter().all(|(key, _)| (key.region as usize) < regions && of_episode(key))
            && self.moments.iter().all(|(key, _)| key.region == 0 && of_episode(key))
            && keys().all(of_episode)
            && self.episodes.values().all(of_plan)
    }
}

impl SystemPlan {
    /// Sums of a pass over no rows.
    pub fn empty(&self) -> SystemSums {
        let hash = self.hash();
        SystemSums {
            grams: Stats::new(&hash),
            moments: Keyed::new(&hash),
            also: Stats::new(&hash),
            sampled: Stats::new(&hash),
            episodes: BTreeMap::new(),
        }
    }

    /// An episode of which no row is known.
    pub fn no_rows(&self) -> EpisodeSums {
        let ranges = RegionRanges::new(self.system.regions(), self.system.functions.len());
        EpisodeSums { ranges, ..EpisodeSums::default() }
    }
}
