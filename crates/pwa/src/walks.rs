//! Transitions from region to region, counted over the rows in their order.

use fleetfoot_model::{Phases, Transitions};

use crate::{
    phase::{Phase, Scale},
    strides::{self, Strides},
};

/// Regions of a partition that does not fit the dynamics whose pairs are counted along a phase, at most.
pub(crate) const MOST_REGIONS: usize = 1_000;

/// A row of an episode and its region.
type Step = (usize, u32);

/// Counts of neighbouring rows' regions; parts of an episode are merged in their order.
#[derive(Debug, Clone)]
pub(crate) struct Walks {
    regions: usize,
    /// From a region to a region, by rows.
    counts: Vec<u64>,
    episode: usize,
    first: Option<Step>,
    last: Option<Step>,
    /// Along a phase, where there is one.
    strides: Option<Strides>,
}

impl Walks {
    pub(crate) fn new(regions: usize, phase: Option<&Scale>) -> Self {
        let strides = phase.map(|scale| Strides::new(scale, regions));
        Self { regions, counts: vec![0; regions * regions], episode: 0, first: None, last: None, strides }
    }

    /// Appends rows of an episode: row numbers, ascending, and their regions.
    pub(crate) fn extend(&mut self, episode: usize, steps: impl Iterator<Item = Step>) {
        self.episode = episode;
        for step in steps {
            self.count(self.last, step);
            self.first = self.first.or(Some(step));
            self.last = Some(step);
        }
    }

    /// Appends rows of an episode along a phase.
    pub(crate) fn along(&mut self, scale: &Scale, episode: usize, steps: impl Iterator<Item = strides::Step>) {
        if let Some(strides) = &mut self.strides {
            strides.extend(scale, episode, steps);
        }
    }

    fn count(&mut self, before: Option<Step>, (row, region): Step) {
        if let Some((last, from)) = before
            && last + 1 == row
            && let Some(count) = self.counts.get_mut(from as usize * self.regions + region as usize)
        {
            *count += 1;
        }
    }

    /// Adds the rows that follow.
    pub(crate) fn merge(&mut self, next: &Self, phase: Option<&Scale>) {
        self.counts.iter_mut().zip(&next.counts).for_each(|(all, counts)| *all += counts);
        if let (Some(first), true) = (next.first, self.episode == next.episode) {
            self.count(self.last, first);
        }
        if next.last.is_some() {
            (self.episode, self.last) = (next.episode, next.last);
        }
        if let (Some(strides), Some(next), Some(scale)) = (&mut self.strides, &next.strides, phase) {
            strides.merge(next, scale);
        }
    }

    /// All that was counted; along a phase where there is one.
    pub(crate) fn counted(self, phase: Option<(&Phase, &Scale)>) -> (Transitions, Option<Phases>) {
        let counts = self.counts.chunks(self.regions.max(1)).map(<[u64]>::to_vec).collect();
        let phases = self.strides.zip(phase).map(|(strides, (phase, scale))| strides.phases(phase, scale));
        (Transitions { counts }, phases)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn parts_of_an_episode_count_as_the_whole(
            steps in prop::collection::vec((0u32..3, prop::bool::weighted(0.1)), 1..60), cut in 0usize..60
        ) {
            // Rows are missing now and then.
            let mut row = 0;
            let steps: Vec<Step> = steps.into_iter().map(|(region, gap)| { row += 1 + usize::from(gap); (row, region) }).collect();
            let mut whole = Walks::new(3, None);
            whole.extend(4, steps.iter().copied());
            let (left, right) = steps.split_at(cut.min(steps.len()));
            let (mut total, mut a, mut b) = (Walks::new(3, None), Walks::new(3, None), Walks::new(3, None));
            a.extend(4, left.iter().copied());
            b.extend(4, right.iter().copied());
            total.merge(&a, None);
            total.merge(&b, None);
            prop_assert_eq!(&total.counts, &whole.counts);
            let expected = steps.windows(2).filter(|pair| pair[0].0 + 1 == pair[1].0).count() as u64;
            prop_assert_eq!(whole.counts.iter().sum::<u64>(), expected);
            // Another episode begins anew.
            let mut other = Walks::new(3, None);
            other.extend(5, [(row + 1, 0)].into_iter());
            total.merge(&other, None);
            prop_assert_eq!(&total.counts, &whole.counts);
        }
    }
}
