//! Distribution of regions along a phase, and transitions from stride to stride.

/// Distribution of the training rows along a gait, or another phase, and their regions there.
#[derive(Debug, Clone, PartialEq)]
pub struct Phases {
    /// The phase as the user wrote it: `alpha_l:12`, `labels:stance`.
    pub specification: String,
    /// Bins of the phase.
    pub bins: PhaseBins,
    /// Rows of each region in each bin: bins x regions.
    pub rows: Vec<Vec<u64>>,
    /// Transitions one sample later, by the bin of the row before: those that occurred, ascending.
    pub passages: Vec<Passage>,
    /// Strides that began in a region, counted by the region in which the next one began (the return map of Poincaré):
    /// regions x regions.
    pub strides: Vec<Vec<u64>>,
    /// Rows of all these strides.
    pub stride_rows: u64,
    /// True if the phase falls in time; a stride then begins where it wraps from 0 to the end.
    pub falling: bool,
}

/// Bins of a phase.
#[derive(Debug, Clone, PartialEq)]
pub enum PhaseBins {
    /// Equal parts of a period. A stride begins where the phase wraps.
    Cyclic {
        /// The period, in the phase's unit: 2 pi, or 1.
        period: f64,
        /// Number of bins.
        count: usize,
    },
    /// The values of a column, by name, ascending. A stride begins where the first one is entered.
    Labels(Vec<String>),
}

/// Rows of a bin that are in one region and are followed by a row of another (or of the same), one sample later.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Passage {
    /// The bin of the row before.
    pub bin: u32,
    /// The region of the row before.
    pub from: u32,
    /// The region of the row behind.
    pub to: u32,
    /// Number of rows.
    pub rows: u64,
}

impl PhaseBins {
    /// Number of bins.
    pub fn count(&self) -> usize {
        match self {
            Self::Cyclic { count, .. } => *count,
            Self::Labels(names) => names.len(),
        }
    }

    /// The name of a bin, for people: where it begins and ends, or the label.
    ///
    /// # Panics
    /// For an unknown label.
    pub fn name(&self, bin: usize) -> String {
        match self {
            Self::Cyclic { period, count } => {
                let at = |edge: usize| format!("{:.2}", period * edge as f64 / *count as f64);
                format!("{}..{}", at(bin), at(bin + 1))
            }
            Self::Labels(names) => names[bin].clone(),
        }
    }
}

impl Phases {
    /// The share of a bin's rows that are in a region; NaN of a bin without rows.
    ///
    /// # Panics
    /// For an unknown bin or region.
    pub fn share(&self, bin: usize, region: usize) -> f64 {
        ratio(self.rows[bin][region], &self.rows[bin])
    }

    /// The share of a region's rows in a bin that a row of each region (or of itself) follows: regions x regions, from
    /// the row to the column. NaN if none was followed.
    pub fn probabilities(&self, bin: usize) -> Vec<Vec<f64>> {
        let regions = self.strides.len();
        let mut counts = vec![vec![0; regions]; regions];
        for passage in self.passages.iter().filter(|passage| passage.bin as usize == bin) {
            counts[passage.from as usize][passage.to as usize] = passage.rows;
        }
        counts.iter().map(|row| row.iter().map(|&count| ratio(count, row)).collect()).collect()
    }

    /// The share of the strides that began in a region which one that began in each follows; NaN where none was followed.
    ///
    /// # Panics
    /// For an unknown region.
    pub fn stride_probability(&self, from: usize, to: usize) -> f64 {
        ratio(self.strides[from][to], &self.strides[from])
    }

    /// Strides that were followed by another.
    pub fn stride_count(&self) -> u64 {
        self.strides.iter().flatten().sum()
    }

    /// Rows of a stride on average; NaN without strides.
    pub fn rows_of_a_stride(&self) -> f64 {
        self.stride_rows as f64 / self.stride_count() as f64
    }

    /// Checks that its parts fit together, and to this many regions.
    pub(crate) fn check(&self, regions: usize) -> Result<(), String> {
        let bins = self.bins.count();
        let fits = self.rows.len() == bins
            && self.rows.iter().chain(&self.strides).all(|row| row.len() == regions)
            && self.strides.len() == regions;
        if !fits {
            return Err(format!(
                "phase {}: its counts are not those of {bins} bins and {regions} regions",
                self.specification
            ));
        }
        let known =
            |passage: &Passage| (passage.bin as usize) < bins && (passage.from.max(passage.to) as usize) < regions;
        if !self.passages.iter().all(known) {
            return Err(format!(
                "phase {}: a passage between regions or in a bin that there is not",
                self.specification
            ));
        }
        match self.bins {
            PhaseBins::Cyclic { period, count } if !(period > 0.0 && period.is_finite() && count > 0) => {
                Err(format!("phase {}: {count} bins of a period of {period}", self.specification))
            }
            _ => Ok(()),
        }
    }
}

fn ratio(count: u64, all: &[u64]) -> f64 {
    count as f64 / all.iter().sum::<u64>() as f64
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Two bins, three regions, the last of which was never seen.
    pub(crate) fn phases() -> Phases {
        Phases {
            specification: "q:2".into(),
            bins: PhaseBins::Cyclic { period: 1.0, count: 2 },
            rows: vec![vec![3, 1, 0], vec![0, 4, 0]],
            passages: vec![
                Passage { bin: 0, from: 0, to: 0, rows: 2 },
                Passage { bin: 0, from: 0, to: 1, rows: 1 },
                Passage { bin: 1, from: 1, to: 1, rows: 3 },
            ],
            strides: vec![vec![1, 3, 0], vec![2, 0, 0], vec![0, 0, 0]],
            stride_rows: 33,
            falling: false,
        }
    }

    #[test]
    fn shares_match_counts() {
        let phases = phases();
        assert_eq!((phases.share(0, 0), phases.share(1, 1)), (0.75, 1.0));
        assert_eq!(phases.probabilities(0)[0][..2], [2.0 / 3.0, 1.0 / 3.0]);
        assert!(phases.probabilities(0)[1][0].is_nan());
        assert_eq!((phases.stride_probability(0, 1), phases.stride_count(), phases.rows_of_a_stride()), (0.75, 6, 5.5));
        assert!(phases.stride_probability(2, 2).is_nan());
        assert_eq!((phases.bins.name(0), phases.bins.name(1)), ("0.00..0.50".into(), "0.50..1.00".into()));
        assert!(phases.check(3).is_ok() && phases.check(2).is_err());
    }

    #[test]
    fn inconsistent_phases_are_refused() {
        for (problem, broken) in [
            (
                "not those of 3 bins",
                Phases { bins: PhaseBins::Labels(vec!["a".into(), "b".into(), "c".into()]), ..phases() },
            ),
            ("a passage", Phases { passages: vec![Passage { bin: 2, from: 0, to: 0, rows: 1 }], ..phases() }),
            ("a passage", Phases { passages: vec![Passage { bin: 0, from: 0, to: 3, rows: 1 }], ..phases() }),
            ("a period of NaN", Phases { bins: PhaseBins::Cyclic { period: f64::NAN, count: 2 }, ..phases() }),
        ] {
            let error = broken.check(3).unwrap_err();
            assert!(error.contains(problem), "{error}");
        }
    }
}
