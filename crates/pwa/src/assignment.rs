//! Rows of a tile on their way to the regions of all partitions.

use std::cell::{OnceCell, RefCell};

use fleetfoot_model::{Partition, Rule, join};

use crate::{rows::Tile, segmentation::Segmentation};

/// Assigns the rows of a tile to the regions of a partition.
pub(crate) struct Assigner<'a> {
    pub(crate) segmentation: &'a Segmentation,
}

thread_local! {
    static STANDARDISED: RefCell<Vec<f64>> = const { RefCell::new(Vec::new()) };
}

impl<'a> Assigner<'a> {
    pub(crate) fn new(segmentation: &'a Segmentation) -> Self {
        Self { segmentation }
    }

    /// The rows of a tile, for all partitions.
    pub(crate) fn on<'t>(&'t self, tile: &'t Tile<'t>) -> Assignment<'t> {
        let cells = self.segmentation.lattices.iter().map(|_| OnceCell::new()).collect();
        Assignment { segmentation: self.segmentation, tile, cells }
    }
}

/// The rows of a tile on their way to regions. Cells of a training set are found once for all that are joined of them.
pub(crate) struct Assignment<'t> {
    segmentation: &'t Segmentation,
    tile: &'t Tile<'t>,
    cells: Vec<OnceCell<Vec<u32>>>,
}

impl Assignment<'_> {
    /// The region of every row.
    pub(crate) fn assign(&self, partition: usize, regions: &mut Vec<u32>) {
        let (label, set) = (self.segmentation.labels[partition], self.segmentation.sets[partition]);
        let partition = &self.segmentation.partitions[partition];
        match &partition.rule {
            Rule::Joined { regions: table, .. } => {
                regions.clear();
                regions.extend_from_slice(self.cells(set));
                join(table, regions);
            }
            _ => self.by(partition, label, regions),
        }
    }

    /// The cell of every row, of those of a training set.
    pub(crate) fn cells(&self, set: usize) -> &[u32] {
        self.cells[set].get_or_init(|| {
            let mut cells = Vec::new();
            self.by(&self.segmentation.lattices[set].partition, None, &mut cells);
            cells
        })
    }

    /// By a partition's own rule.
    fn by(&self, partition: &Partition, label: Option<usize>, regions: &mut Vec<u32>) {
        regions.clear();
        regions.resize(self.tile.len(), 0);
        if partition.rule.count() > 1 || label.is_some() {
            STANDARDISED.with_borrow_mut(|work| partition.assign(&self.tile.places(label), work, regions));
        }
    }
}
