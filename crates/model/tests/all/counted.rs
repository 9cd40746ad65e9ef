//! A model whose transitions, phases and pairs of regions were counted.

use fleetfoot_model::{Model, Passage, PhaseBins, Phases, RegionPair, Transitions};

use crate::models;

/// Three regions that are left and come back, one that is never left, one whose rows are followed by none.
pub(crate) fn counts(most: u64) -> Vec<Vec<u64>> {
    vec![vec![70, 3, 0, 7, 1], vec![1, most, 2, 0, 0], vec![0, 0, 11, 0, 0], vec![2, 1, 0, 30, 0], vec![0, 0, 0, 0, 0]]
}

/// Two bins, the second without rows, and a region in which no stride began.
pub(crate) fn phases(most: u64) -> Phases {
    Phases {
        specification: "gait:2".into(),
        bins: PhaseBins::Cyclic { period: 1.0, count: 2 },
        rows: vec![vec![9, most, 0, 1, 2], vec![0; 5]],
        passages: vec![
            Passage { bin: 0, from: 0, to: 4, rows: most },
            Passage { bin: 0, from: 3, to: 3, rows: 8 },
            Passage { bin: 0, from: 4, to: 0, rows: 1 },
        ],
        strides: vec![vec![1, 2, 0, 0, 0], vec![0; 5], vec![0, 0, 7, 0, 0], vec![3, 0, 0, 0, 1], vec![0, 5, 0, 0, 0]],
        stride_rows: 99,
        falling: false,
    }
}

pub(crate) fn model(most: u64) -> Model {
    let mut model = models::pwa(5, 2);
    let partition = &mut model.partitions[0];
    partition.transitions = Some(Transitions { counts: counts(most) });
    partition.phases = Some(phases(most));
    let pair = |a, b, p| RegionPair { regions: [a, b], statistic: 12.5, freedom: 3, p };
    partition.pairs = vec![pair(0, 1, 0.25), pair(0, 4, 1e-12), pair(2, 3, f64::NAN)];
    model
}
