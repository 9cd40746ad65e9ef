//! Transitions between regions.

/// Counts of transitions: training rows of each region that were followed, one sample later in the same episode, by a
/// row of each. Regions x regions, from the row to the column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Transitions {
    /// The counts.
    pub counts: Vec<Vec<u64>>,
}

impl Transitions {
    /// The share of the rows of a region that a row of another one (or of itself) follows; NaN where none was followed.
    ///
    /// # Panics
    /// For an unknown region.
    pub fn probability(&self, from: usize, to: usize) -> f64 {
        self.counts[from][to] as f64 / self.counts[from].iter().sum::<u64>() as f64
    }

    /// Mean number of rows of a visit to a region, `1 / (1 - p)` with p the probability of staying; infinite if it was
    /// never left. It is the maximum likelihood estimate of a geometric distribution, in which a visit that the end of
    /// an episode cuts counts by its rows.
    ///
    /// # Panics
    /// For an unknown region.
    pub fn dwell(&self, region: usize) -> f64 {
        let all: u64 = self.counts[region].iter().sum();
        all as f64 / (all - self.counts[region][region]) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_and_dwells_match_counts() {
        // 0 0 0 1 1 0 2 2: the last row is followed by none.
        let transitions = Transitions { counts: vec![vec![2, 1, 1], vec![1, 1, 0], vec![0, 0, 1]] };
        assert_eq!(transitions.probability(0, 1), 0.25);
        assert_eq!((transitions.dwell(0), transitions.dwell(1)), (2.0, 2.0));
        assert_eq!(transitions.dwell(2), f64::INFINITY);
        assert!(Transitions { counts: vec![vec![0]] }.probability(0, 0).is_nan());
    }
}
