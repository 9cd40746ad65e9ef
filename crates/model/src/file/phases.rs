//! Phases and pairs of regions as text.

use serde::{Deserialize, Serialize};

use super::Real;
use crate::{Passage, PhaseBins, Phases, RegionPair};

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PhasesText {
    specification: String,
    bins: BinsText,
    rows: Vec<Vec<u64>>,
    /// Bin, region, region one sample later, rows.
    passages: Vec<(u32, u32, u32, u64)>,
    strides: Vec<Vec<u64>>,
    stride_rows: u64,
    falling: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
enum BinsText {
    Cyclic { period: Real, count: usize },
    Labels(Vec<String>),
}

impl From<&Phases> for PhasesText {
    fn from(phases: &Phases) -> Self {
        Self {
            specification: phases.specification.clone(),
            bins: match &phases.bins {
                PhaseBins::Cyclic { period, count } => BinsText::Cyclic { period: Real(*period), count: *count },
                PhaseBins::Labels(names) => BinsText::Labels(names.clone()),
            },
            rows: phases.rows.clone(),
            passages: phases.passages.iter().map(|one| (one.bin, one.from, one.to, one.rows)).collect(),
            strides: phases.strides.clone(),
            stride_rows: phases.stride_rows,
            falling: phases.falling,
        }
    }
}

impl PhasesText {
    pub(super) fn into_phases(self) -> Phases {
        Phases {
            specification: self.specification,
            bins: match self.bins {
                BinsText::Cyclic { period, count } => PhaseBins::Cyclic { period: period.0, count },
                BinsText::Labels(names) => PhaseBins::Labels(names),
            },
            rows: self.rows,
            passages: self.passages.into_iter().map(|(bin, from, to, rows)| Passage { bin, from, to, rows }).collect(),
            strides: self.strides,
            stride_rows: self.stride_rows,
            falling: self.falling,
        }
    }
}

/// The two regions, the statistic, its degrees of freedom, the probability.
#[derive(Serialize, Deserialize)]
pub(super) struct PairText(u32, u32, Real, usize, Real);

impl From<&RegionPair> for PairText {
    fn from(region_pair: &RegionPair) -> Self {
        Self(
            region_pair.regions[0],
            region_pair.regions[1],
            Real(region_pair.statistic),
            region_pair.freedom,
            Real(region_pair.p),
        )
    }
}

impl PairText {
    pub(super) fn into_pair(self) -> RegionPair {
        let Self(a, b, statistic, freedom, p) = self;
        RegionPair { regions: [a, b], statistic: statistic.0, freedom, p: p.0 }
    }
}
